//! BENCH.toml: the axes, the meter and the optics of a goniometer. It is written once for a bench, not for each run.

use super::channels::{
    Band, FilesPlan, MonochromatorPlan, Reads, SpectrometerPlan, bands, check_spectrometer,
    wavelengths,
};
use crate::retro::plan::{MeterPlan, VIRTUAL};
use crate::retro::stop::{Shape, Stop};
use serde::Deserialize;
use std::path::PathBuf;
use sunglint_formats::toml::{Document, Fraction, NonNegative, Positive, Within};
use sunglint_formats::{FileError, ParseError};

/// Why a file describes no bench.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// Values that no bench can have, with line and key.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Numbers that are written here are good ones.
fn good<T>(number: Option<T>) -> T {
    match number {
        Some(number) => number,
        None => unreachable!("a default is in its range"),
    }
}

/// The file as it is written.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Written {
    name: Option<String>,
    #[serde(rename = "virtual")]
    virtual_bench: Option<PathBuf>,
    axis: Axes,
    meter: Option<MeterPlan>,
    spectrometer: Option<SpectrometerPlan>,
    monochromator: Option<MonochromatorPlan>,
    files: Option<FilesPlan>,
    laser: Option<Laser>,
    beam: Beam,
    aperture: Aperture,
    sample: SampleSize,
    field: Option<Field>,
    reach: Reach,
    scan: Scan,
    reference: Reference,
    signature: SignatureScan,
    floor: FloorScan,
    zero: ZeroScan,
}

/// The axes of a goniometer. The first two are needed.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Axes {
    /// Turns the sample in the plane of incidence: the angle of incidence.
    pub sample: Axis,
    /// Turns the detector: its angle from the sample's normal, or from the lamp.
    pub detector: DetectorAxis,
    /// Turns the detector's plane about the sample's normal, out of the plane of incidence.
    pub azimuth: Option<Axis>,
    /// Turns the sample about its normal: the azimuth of the light on it.
    pub turn: Option<Axis>,
}

macro_rules! axis {
    ($(#[$doc:meta])* $name:ident { $($(#[$more:meta])* $field:ident: $kind:ty = $value:expr),* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            /// Address of the device in the catalogue of drivers.
            pub device: String,
            /// Options for its driver, `NAME=VALUE` each.
            pub with: Vec<String>,
            /// Whether the reference is looked for first.
            pub home: bool,
            /// The stage's angle where the bench's angle is 0, deg, as far as it is known beforehand.
            pub zero_deg: Within<-360, 360>,
            /// True where the stage counts the other way round.
            pub reversed: bool,
            /// How far from the angle that was asked for it may stand, deg.
            pub tolerance_deg: Positive,
            /// On the way down it goes so much too far and comes back up, deg: the play of the gears lies on one side.
            pub approach_deg: NonNegative,
            /// Speed for the estimate of the time, degrees per second.
            pub speed_deg_per_s: Positive,
            /// How long a move may take, s.
            pub timeout_s: Positive,
            $($(#[$more])* pub $field: $kind,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    device: VIRTUAL.into(),
                    with: vec![],
                    home: false,
                    zero_deg: good(Within::new(0.0)),
                    reversed: false,
                    tolerance_deg: good(Positive::new(0.05)),
                    approach_deg: good(NonNegative::new(0.5)),
                    speed_deg_per_s: good(Positive::new(10.0)),
                    timeout_s: good(Positive::new(120.0)),
                    $($field: $value,)*
                }
            }
        }
    };
}

axis!(
    /// An axis in the file.
    Axis {}
);
axis!(
    /// The detector's axis in the file.
    DetectorAxis {
        /// Where its angle counts from.
        from: From = From::Normal
    }
);

impl DetectorAxis {
    /// The axis without its own keys.
    #[must_use]
    pub fn axis(&self) -> Axis {
        Axis {
            device: self.device.clone(),
            with: self.with.clone(),
            home: self.home,
            zero_deg: self.zero_deg,
            reversed: self.reversed,
            tolerance_deg: self.tolerance_deg,
            approach_deg: self.approach_deg,
            speed_deg_per_s: self.speed_deg_per_s,
            timeout_s: self.timeout_s,
        }
    }
}

/// Where the detector's angle counts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum From {
    /// From the sample's normal: the arm is mounted on the sample's stage.
    Normal,
    /// From the lamp: the arm stands on the table.
    Lamp,
}

/// The light.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Laser {
    /// Vacuum wavelength, nm.
    pub wavelength_nm: Positive,
}

impl Default for Laser {
    fn default() -> Self {
        Self { wavelength_nm: good(Positive::new(632.8)) }
    }
}

/// The beam.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Beam {
    /// Diameter at the sample where it has fallen to 1/e², mm.
    pub diameter_mm: Positive,
    /// Transmission of a filter in the beam while the detector stands in it.
    pub filter_transmission: Fraction,
    /// Relative standard uncertainty of that.
    pub filter_relative_sigma: NonNegative,
    /// Transmissions of that filter in each channel of a run with several, in their order, in place of the one number.
    pub filter_transmissions: Option<Vec<Fraction>>,
    /// The light's polarisation, in words.
    pub polarisation: Option<String>,
    /// (I_s − I_p)/(I_s + I_p) of the light: 1 across the plane of incidence, −1 in it, 0 without polarisation, circular, or at 45°.
    pub polarised: Option<Within<-1, 1>>,
}

impl Default for Beam {
    fn default() -> Self {
        Self {
            diameter_mm: good(Positive::new(2.0)),
            filter_transmission: good(Fraction::new(1.0)),
            filter_relative_sigma: good(NonNegative::new(0.0)),
            filter_transmissions: None,
            polarisation: None,
            polarised: None,
        }
    }
}

/// The stop before the detector.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Aperture {
    /// Diameter, mm.
    pub diameter_mm: Positive,
    /// Distance from the sample, mm.
    pub distance_mm: Positive,
    /// Relative standard uncertainty of the solid angle.
    pub relative_sigma: NonNegative,
    /// The detector's polarisation filter, in words.
    pub polarisation: Option<String>,
    /// (T_s − T_p)/(T_s + T_p) of what the detector takes in: of a filter, or of a detector that tells polarisations apart. None is 0 where there are no words of a filter.
    pub polarised: Option<Within<-1, 1>>,
}

impl Default for Aperture {
    fn default() -> Self {
        Self {
            diameter_mm: good(Positive::new(10.0)),
            distance_mm: good(Positive::new(500.0)),
            relative_sigma: good(NonNegative::new(0.005)),
            polarisation: None,
            polarised: None,
        }
    }
}

/// The sample's size.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SampleSize {
    /// Width in the plane of incidence, mm.
    pub width_mm: Positive,
    /// Height across that, mm.
    pub height_mm: Positive,
    /// A direction whose beam lies on the sample and in the detector's field by a smaller part is refused.
    pub least_part: Fraction,
    /// Refractive index n + ik of its facets: how far they polarise. None is glass's 1.5, which polarises more than nearly all that shines.
    pub index: Option<(Positive, NonNegative)>,
}

impl Default for SampleSize {
    fn default() -> Self {
        Self {
            width_mm: good(Positive::new(50.0)),
            height_mm: good(Positive::new(50.0)),
            least_part: good(Fraction::new(0.5)),
            index: None,
        }
    }
}

/// The round field on the sample that the detector sees. Without it, it sees all.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// Diameter as seen along the detector's axis, mm.
    pub diameter_mm: Positive,
}

/// Directions that the bench reaches.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reach {
    /// The least angle between lamp and detector, deg: closer, the detector shades the sample.
    pub least_phase_deg: Within<0, 180>,
    /// The largest angle of incidence, deg.
    pub most_theta_i_deg: Within<0, 90>,
    /// The largest angle of the detector from the normal, deg.
    pub most_theta_o_deg: Within<0, 90>,
}

impl Default for Reach {
    fn default() -> Self {
        Self {
            least_phase_deg: good(Within::new(5.0)),
            most_theta_i_deg: good(Within::new(85.0)),
            most_theta_o_deg: good(Within::new(85.0)),
        }
    }
}

/// How directions are read.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scan {
    /// Readings at a direction.
    pub readings: u32,
    /// Wait between readings, s.
    pub interval_s: NonNegative,
    /// Directions between two looks at the reference direction.
    pub reference_every: u32,
}

impl Default for Scan {
    fn default() -> Self {
        Self { readings: 5, interval_s: good(NonNegative::new(0.0)), reference_every: 50 }
    }
}

/// The direction that is looked at again and again, for the lamp's drift.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reference {
    /// Angle of incidence, deg.
    pub theta_i_deg: Within<0, 89>,
    /// Angle of the detector, deg, on the mirrored side.
    pub theta_o_deg: Within<0, 89>,
}

impl Default for Reference {
    fn default() -> Self {
        Self { theta_i_deg: good(Within::new(30.0)), theta_o_deg: good(Within::new(30.0)) }
    }
}

/// The scans straight through, without a sample.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SignatureScan {
    /// Whether it is measured.
    pub measure: bool,
    /// Angle of the sample's stage meanwhile, deg: the light then goes along the empty mount.
    pub theta_i_deg: Within<0, 180>,
    /// How far to both sides, deg.
    pub half_width_deg: Positive,
    /// Step, deg.
    pub step_deg: Positive,
}

impl Default for SignatureScan {
    fn default() -> Self {
        Self {
            measure: true,
            theta_i_deg: good(Within::new(90.0)),
            half_width_deg: good(Positive::new(3.0)),
            step_deg: good(Positive::new(0.1)),
        }
    }
}

/// The scan for stray light.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FloorScan {
    /// Whether it is measured.
    pub measure: bool,
    /// Step of the detector, deg.
    pub step_deg: Positive,
}

impl Default for FloorScan {
    fn default() -> Self {
        Self { measure: true, step_deg: good(Positive::new(10.0)) }
    }
}

/// The scans for the axes' zeros: through the sample's lobe, lit from both sides.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ZeroScan {
    /// Whether it is measured.
    pub measure: bool,
    /// Angle of incidence, deg.
    pub theta_i_deg: Within<1, 80>,
    /// How far to both sides of the mirrored direction, deg.
    pub half_width_deg: Positive,
    /// Step, deg.
    pub step_deg: Positive,
    /// Standard uncertainty of a zero that is not measured, deg.
    pub sigma_deg: NonNegative,
}

impl Default for ZeroScan {
    fn default() -> Self {
        Self {
            measure: true,
            theta_i_deg: good(Within::new(20.0)),
            half_width_deg: good(Positive::new(6.0)),
            step_deg: good(Positive::new(0.2)),
            sigma_deg: good(NonNegative::new(0.3)),
        }
    }
}

/// A bench.
#[derive(Debug, Clone)]
pub struct Bench {
    /// Name of the sample or the run, where the file gives one.
    pub name: Option<String>,
    /// Axes.
    pub axes: Axes,
    /// The meter; of a bench that has none as usual.
    pub meter: MeterPlan,
    /// Detector of the run.
    pub reads: Reads,
    /// Channels, by rising wavelength: one of a meter without a monochromator.
    pub bands: Vec<Band>,
    /// Vacuum wavelength, nm; of several channels the middle one's.
    pub wavelength_nm: f64,
    /// The beam.
    pub beam: Beam,
    /// The stop before the detector.
    pub stop: Stop,
    /// Relative standard uncertainty of its solid angle.
    pub stop_sigma: f64,
    /// Polarisation of the detector, in words.
    pub detector_polarisation: Option<String>,
    /// (T_s − T_p)/(T_s + T_p) of the detector.
    pub detector_polarised: Option<f64>,
    /// The sample's size.
    pub sample: SampleSize,
    /// Diameter of the detector's field at the sample, mm.
    pub field_mm: Option<f64>,
    /// Directions that it reaches.
    pub reach: Reach,
    /// How directions are read.
    pub scan: Scan,
    /// The reference direction.
    pub reference: Reference,
    /// The scans straight through.
    pub signature: SignatureScan,
    /// The scan for stray light.
    pub floor: FloorScan,
    /// The scans for the axes' zeros.
    pub zero: ZeroScan,
    /// The file's text.
    pub source: String,
    /// The file of a virtual goniometer that stands in for the devices.
    pub virtual_bench: Option<Document>,
}

impl Bench {
    /// A bench from its document; `virtual_bench` is the text of the virtual goniometer where it does not come from the file that is named.
    ///
    /// # Errors
    /// Values that no bench can have, with line and key.
    pub fn new(document: &Document, virtual_bench: Option<&str>) -> Result<Self, BenchError> {
        let written: Written = document.parse()?;
        let virtual_bench = match (&written.virtual_bench, virtual_bench) {
            (None, _) => None,
            (Some(path), Some(text)) => Some(Document::new(document.resolve(path), text)?),
            (Some(path), None) => Some(Document::read(document.resolve(path))?),
        };
        check(document, &written)?;
        let (reads, bands) = reads(document, &written)?;
        if let Some(each) = &written.beam.filter_transmissions
            && (each.len() != bands.len() || matches!(reads, Reads::Meter))
        {
            let key = "beam.filter_transmissions";
            let expected = format!(
                "one number for each of the {} channels of [spectrometer], [monochromator] or [files]",
                bands.len()
            );
            return Err(document.error_at(key, expected).into());
        }
        let mut scan = written.scan;
        if let Reads::Files(files) = &reads {
            scan.readings = files.readings;
        }
        let stop = Stop {
            shape: Shape::Disc { diameter_mm: written.aperture.diameter_mm.get() },
            tilt_deg: 0.0,
            distance_mm: written.aperture.distance_mm.get(),
        };
        Ok(Self {
            name: written.name,
            axes: written.axis,
            meter: written.meter.unwrap_or_default(),
            wavelength_nm: bands[bands.len() / 2].nm,
            reads,
            bands,
            beam: written.beam,
            stop,
            stop_sigma: written.aperture.relative_sigma.get(),
            detector_polarised: written.aperture.polarised.map(Within::get),
            detector_polarisation: written.aperture.polarisation,
            sample: written.sample,
            field_mm: written.field.map(|field| field.diameter_mm.get()),
            reach: written.reach,
            scan,
            reference: written.reference,
            signature: written.signature,
            floor: written.floor,
            zero: written.zero,
            source: document.source().to_owned(),
            virtual_bench,
        })
    }

    /// The share of what is measured that is polarised across the plane of incidence less that in it, of beam q and detector r together: f is measured as f (1 + D (q + r)/(1 + q r)) of a surface whose
    /// facets reflect light without polarisation to the degree D. None where it is not said; a virtual goniometer's light has none.
    #[must_use]
    pub fn polarised(&self) -> Option<f64> {
        let said = |number: Option<f64>, none: bool| number.or(none.then_some(0.0));
        let beam = said(self.beam.polarised.map(Within::get), self.virtual_bench.is_some())?;
        let detector = said(self.detector_polarised, self.detector_polarisation.is_none())?;
        Some((beam + detector) / (1.0 + beam * detector))
    }

    /// The four axes, those that there are: sample, detector, azimuth, turn.
    #[must_use]
    pub fn all_axes(&self) -> [Option<Axis>; 4] {
        let Axes { sample, detector, azimuth, turn } = &self.axes;
        [Some(sample.clone()), Some(detector.axis()), azimuth.clone(), turn.clone()]
    }
}

/// A bench with three axes and all else as usual, in front of a virtual goniometer: for whoever has no bench.
pub const VIRTUAL_BENCH: &str = "virtual = \"goniometer.toml\"\n\n[axis.azimuth]\n";

/// A bench with all four axes and all else as usual: what is planned for where no bench is named.
pub const USUAL_BENCH: &str = "virtual = \"goniometer.toml\"\n\n[axis.azimuth]\n\n[axis.turn]\n";

/// Names of the four axes.
pub const AXES: [&str; 4] = ["sample", "detector", "azimuth", "turn"];

/// Device of an axis that a person turns.
pub const HAND: &str = "hand";

impl Axis {
    /// Whether a person turns it.
    #[must_use]
    pub fn is_by_hand(&self) -> bool {
        self.device == HAND
    }
}

/// The detector and its channels.
fn reads(document: &Document, written: &Written) -> Result<(Reads, Vec<Band>), BenchError> {
    Ok(match (&written.spectrometer, &written.monochromator, &written.files) {
        (Some(plan), ..) => {
            check_spectrometer(document, plan)?;
            let bands = bands(document, "spectrometer", &plan.channels_nm, plan.bands.as_ref())?;
            (Reads::Spectrometer(plan.clone()), bands)
        }
        (_, Some(plan), _) => (Reads::Monochromator(plan.clone()), wavelengths(document, plan)?),
        (.., Some(plan)) => {
            let bands = bands(document, "files", &plan.channels_nm, plan.bands.as_ref())?;
            (Reads::Files(plan.clone()), bands)
        }
        _ => {
            let nm = written.laser.clone().unwrap_or_default().wavelength_nm.get();
            (Reads::Meter, vec![Band { nm, width_nm: 0.0 }])
        }
    })
}

/// Looks that one thing reads the light.
fn check_detectors(document: &Document, written: &Written) -> Result<(), BenchError> {
    let there = [
        ("meter", written.meter.is_some()),
        ("spectrometer", written.spectrometer.is_some()),
        ("monochromator", written.monochromator.is_some()),
        ("files", written.files.is_some()),
    ];
    let names: Vec<&str> = there.iter().filter(|(_, is)| *is).map(|(name, _)| *name).collect();
    let pair = |names: &[&str]| names == ["meter"] || names == ["meter", "monochromator"];
    if names.len() > 1 && !pair(&names) {
        let expected = format!(
            "one detector, and the file has [{}]: [meter], [meter] with [monochromator], [spectrometer], or [files]",
            names.join("], [")
        );
        return Err(document.error_at(names[names.len() - 1], expected).into());
    }
    if written.laser.is_some() && names.iter().any(|name| *name != "meter") {
        let expected = "no [laser] beside [spectrometer], [monochromator] or [files]: their channels say the wavelengths";
        return Err(document.error_at("laser", expected).into());
    }
    if let Some(files) = &written.files {
        if written.virtual_bench.is_some() {
            let expected = "[files] on a bench with real axes or axes of device = \"hand\": a virtual bench writes no files";
            return Err(document.error_at("files", expected).into());
        }
        if !(1..=1000).contains(&files.readings) {
            return Err(document.error_at("files.readings", "1 to 1000 files").into());
        }
        if files.pattern.is_empty() || files.pattern.contains(['/', '\\']) {
            let expected = "a name with * and ?, such as *.csv, without a folder";
            return Err(document.error_at("files.pattern", expected).into());
        }
        if written.scan.readings != Scan::default().readings {
            let expected =
                "no such key beside [files]: its readings says how many files a place has";
            return Err(document.error_at("scan.readings", expected).into());
        }
    }
    let axes = &written.axis;
    let by_hand = [
        ("sample", Some(axes.sample.clone())),
        ("detector", Some(axes.detector.axis())),
        ("azimuth", axes.azimuth.clone()),
        ("turn", axes.turn.clone()),
    ];
    for (name, axis) in by_hand.into_iter().filter_map(|(name, axis)| Some((name, axis?))) {
        if axis.is_by_hand() && axis.home {
            let expected = "no home of an axis that a person turns (device = \"hand\")";
            return Err(document.error_at(&format!("axis.{name}.home"), expected).into());
        }
        if axis.is_by_hand() && !axis.with.is_empty() {
            let expected = "no options of an axis that a person turns (device = \"hand\")";
            return Err(document.error_at(&format!("axis.{name}.with"), expected).into());
        }
    }
    Ok(())
}

/// Longest time in a file, s.
const LONGEST_S: f64 = 1e6;

/// Looks that no time is longer than clocks can wait.
fn check_times(document: &Document, written: &Written) -> Result<(), BenchError> {
    let axes = &written.axis;
    let mut times = vec![
        ("axis.sample.timeout_s", axes.sample.timeout_s.get()),
        ("axis.detector.timeout_s", axes.detector.timeout_s.get()),
        ("scan.interval_s", written.scan.interval_s.get()),
    ];
    times.extend(axes.azimuth.iter().map(|axis| ("axis.azimuth.timeout_s", axis.timeout_s.get())));
    times.extend(axes.turn.iter().map(|axis| ("axis.turn.timeout_s", axis.timeout_s.get())));
    if let Some(plan) = &written.meter {
        times.push(("meter.settle_s", plan.settle_s.get()));
        times.push(("meter.timeout_s", plan.timeout_s.get()));
    }
    if let Some(plan) = &written.spectrometer {
        times.push(("spectrometer.settle_s", plan.settle_s.get()));
        times.push(("spectrometer.timeout_s", plan.timeout_s.get()));
    }
    if let Some(plan) = &written.monochromator {
        times.push(("monochromator.timeout_s", plan.timeout_s.get()));
        times.push(("monochromator.move_s", plan.move_s.get()));
    }
    if let Some(plan) = &written.files {
        times.push(("files.complete_s", plan.complete_s.get()));
        times.push(("files.each_s", plan.each_s.get()));
    }
    match times.into_iter().find(|(_, s)| *s > LONGEST_S) {
        Some((key, _)) => Err(document.error_at(key, "at most 1000000 s").into()),
        None => Ok(()),
    }
}

/// Looks at the filter in the beam, by whose transmission the beam is divided.
fn check_filter(document: &Document, beam: &Beam) -> Result<(), BenchError> {
    let expected = "above 0, at most 1: a filter that lets nothing through leaves no beam";
    if beam.filter_transmission.get() <= 0.0 {
        return Err(document.error_at("beam.filter_transmission", expected).into());
    }
    let Some(each) = &beam.filter_transmissions else { return Ok(()) };
    if each.iter().any(|one| one.get() <= 0.0) {
        return Err(document.error_at("beam.filter_transmissions", expected).into());
    }
    if beam.filter_transmission.get() < 1.0 {
        let expected = "filter_transmission or filter_transmissions, not both";
        return Err(document.error_at("beam.filter_transmissions", expected).into());
    }
    Ok(())
}

fn check(document: &Document, written: &Written) -> Result<(), BenchError> {
    let wrong = |key: &str, expected: &str| -> Result<(), BenchError> {
        Err(document.error_at(key, expected).into())
    };
    check_detectors(document, written)?;
    check_times(document, written)?;
    check_filter(document, &written.beam)?;
    if let Some((n, k)) = written.sample.index
        && (!(0.01..=100.0).contains(&n.get()) || k.get() > 100.0)
    {
        return wrong("sample.index", "n of 0.01 to 100 and k of 0 to 100");
    }
    let axes = &written.axis;
    let usual = MeterPlan::default();
    let has_meter = written.spectrometer.is_none() && written.files.is_none();
    let meter = has_meter.then(|| &written.meter.as_ref().unwrap_or(&usual).device);
    let devices = [
        ("axis.sample.device", Some(&axes.sample.device)),
        ("axis.detector.device", Some(&axes.detector.device)),
        ("axis.azimuth.device", axes.azimuth.as_ref().map(|axis| &axis.device)),
        ("axis.turn.device", axes.turn.as_ref().map(|axis| &axis.device)),
        ("meter.device", meter),
        ("spectrometer.device", written.spectrometer.as_ref().map(|plan| &plan.device)),
        ("monochromator.device", written.monochromator.as_ref().map(|plan| &plan.device)),
    ];
    for (key, device) in devices.into_iter().filter_map(|(key, d)| Some((key, d?))) {
        if (device == VIRTUAL) != written.virtual_bench.is_some() {
            return wrong(
                key,
                match written.virtual_bench {
                    Some(_) => "`virtual`, as the file names a virtual goniometer",
                    None => {
                        "an address (sunglint devices list --drivers), or virtual = \"goniometer.toml\" for the whole bench"
                    }
                },
            );
        }
    }
    if axes.detector.from == From::Lamp && axes.azimuth.is_some() {
        let expected = "`normal`: an arm that turns about the sample's normal (axis.azimuth) counts from it; leave [axis.azimuth] out where the arm stands on the table";
        return wrong("axis.detector.from", expected);
    }
    if !(3..=1000).contains(&written.scan.readings) {
        return wrong("scan.readings", "3 to 1000: fewer tell no scatter and no outlier");
    }
    if !(5..=100_000).contains(&written.scan.reference_every) {
        return wrong("scan.reference_every", "5 to 100000 directions");
    }
    let degree = |number: Option<Within<-1, 1>>| number.map_or(0.0, Within::get);
    if degree(written.beam.polarised) * degree(written.aperture.polarised) < -0.99 {
        let expected = "a detector that takes in some of the beam ([beam] polarised): crossed polarisers have no incident power to divide by";
        return wrong("aperture.polarised", expected);
    }
    let steps = |half: Positive, step: Positive| half.get() / step.get();
    let signature = &written.signature;
    if !(4.0..=1000.0).contains(&steps(signature.half_width_deg, signature.step_deg)) {
        return wrong("signature.step_deg", "4 to 1000 steps in half_width_deg");
    }
    let zero = &written.zero;
    if !(4.0..=1000.0).contains(&steps(zero.half_width_deg, zero.step_deg)) {
        return wrong("zero.step_deg", "4 to 1000 steps in half_width_deg");
    }
    if !(0.5..=45.0).contains(&written.floor.step_deg.get()) {
        return wrong("floor.step_deg", "0.5 to 45 degrees");
    }
    Ok(())
}
