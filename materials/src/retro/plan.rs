//! RUN.toml: the rig, what is read of it, and what is known about it.

use super::stop::Shape;
use super::{Known, Reference, Setup, Spot, Stop};
use serde::Deserialize;
use std::path::PathBuf;
use sunglint_formats::toml::{Document, Finite, Fraction, NonNegative, Positive, Within};
use sunglint_formats::{FileError, ParseError};

/// Why a file is no plan of a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunPlanError {
    /// Values that no run can have, with line and key.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// More readings than a run takes.
    #[error("{file}: {angles} angles of {readings} readings: at most 100000 of 10000")]
    TooMany {
        /// The plan's file.
        file: String,
        /// Angles.
        angles: usize,
        /// Readings at each.
        readings: u32,
    },
}

/// The address of a virtual rig's devices.
pub const VIRTUAL: &str = "virtual";

/// The file as it is written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    name: Option<String>,
    #[serde(default, rename = "virtual")]
    virtual_rig: Option<PathBuf>,
    #[serde(default)]
    stage: StagePlan,
    #[serde(default)]
    meter: MeterPlan,
    #[serde(default)]
    scan: Scan,
    laser: Laser,
    #[serde(default)]
    incident: Option<Incident>,
    #[serde(default)]
    standard: Option<Standard>,
    #[serde(default)]
    splitter: Option<Splitter>,
    #[serde(default)]
    lens: Option<Lens>,
    stop: WrittenStop,
    #[serde(default)]
    sample: Option<Sample>,
    #[serde(default)]
    mount: Mount,
}

/// The stage in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StagePlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// Whether the reference is looked for first.
    pub home: bool,
    /// How far from the angle that was asked for it may stand, deg.
    pub tolerance_deg: Positive,
    /// On the way down it goes so much too far and comes back up, deg: the play of the gears lies on one side.
    pub approach_deg: NonNegative,
    /// Standard uncertainty of an angle, deg.
    pub angle_sigma_deg: NonNegative,
    /// How long a move may take, s.
    pub timeout_s: Positive,
}

/// Numbers that are written here are good ones.
fn good<T>(number: Option<T>) -> T {
    match number {
        Some(number) => number,
        None => unreachable!("a default is in its range"),
    }
}

impl Default for StagePlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            home: false,
            tolerance_deg: good(Positive::new(0.05)),
            approach_deg: good(NonNegative::new(1.0)),
            angle_sigma_deg: good(NonNegative::new(0.01)),
            timeout_s: good(Positive::new(60.0)),
        }
    }
}

/// The meter in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeterPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// A range by its name; as the meter stands without.
    pub range: Option<String>,
    /// Wait after a move and after a change of range, s.
    pub settle_s: NonNegative,
    /// How long a reading may take, s.
    pub timeout_s: Positive,
}

impl Default for MeterPlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            range: None,
            settle_s: good(NonNegative::new(1.0)),
            timeout_s: good(Positive::new(10.0)),
        }
    }
}

/// Scan: the angles that are read, and how often.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scan {
    /// First angle, deg.
    pub from_deg: Within<-90, 90>,
    /// Last angle, deg.
    pub to_deg: Within<-90, 90>,
    /// Step, deg.
    pub step_deg: Positive,
    /// Angles in their place, in any order, deg.
    pub angles_deg: Option<Vec<Within<-90, 90>>>,
    /// Readings at an angle.
    pub readings: u32,
    /// Wait between readings, s.
    pub interval_s: NonNegative,
    /// Whether the same angles are read without a sample first.
    pub signature: bool,
}

impl Default for Scan {
    fn default() -> Self {
        Self {
            from_deg: good(Within::new(-10.0)),
            to_deg: good(Within::new(65.0)),
            step_deg: good(Positive::new(0.5)),
            angles_deg: None,
            readings: 10,
            interval_s: good(NonNegative::new(0.0)),
            signature: true,
        }
    }
}

impl Scan {
    /// The angles in the order in which they are read, deg.
    pub fn angles(&self) -> Vec<f64> {
        if let Some(angles) = &self.angles_deg {
            return angles.iter().map(|angle| angle.get()).collect();
        }
        let (from, to, step) = (self.from_deg.get(), self.to_deg.get(), self.step_deg.get());
        // The last digit of a step is not lost over the scan.
        let count = ((to - from) / step + 1e-9).floor().max(0.0) as u64;
        (0..=count).map(|k| from + step * k as f64).collect()
    }
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Laser {
    wavelength_nm: Positive,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Incident {
    filter_transmission: Fraction,
    #[serde(default)]
    relative_sigma: Option<NonNegative>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Standard {
    reflectance: Positive,
    #[serde(default)]
    relative_sigma: Option<NonNegative>,
    angle_deg: Within<-89, 89>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Splitter {
    reflectance: Fraction,
    #[serde(default)]
    relative_sigma: Option<NonNegative>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Lens {
    transmission: Fraction,
    #[serde(default)]
    relative_sigma: Option<NonNegative>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenStop {
    #[serde(default)]
    diameter_mm: Option<Positive>,
    #[serde(default)]
    width_mm: Option<Positive>,
    #[serde(default)]
    height_mm: Option<Positive>,
    #[serde(default)]
    tilt_deg: Option<Finite>,
    distance_mm: Positive,
    #[serde(default)]
    relative_sigma: Option<NonNegative>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sample {
    width_mm: Positive,
    beam_diameter_mm: Positive,
    #[serde(default)]
    off_centre_mm: Option<NonNegative>,
    #[serde(default)]
    most_spilled: Option<Positive>,
}

#[derive(Debug, Clone, PartialEq, Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Mount {
    #[serde(default)]
    zero_deg: Option<Within<-90, 90>>,
    #[serde(default)]
    zero_sigma_deg: Option<NonNegative>,
    #[serde(default)]
    most_offset_deg: Option<NonNegative>,
}

/// Planned measurement: a run that was begun can only be gone on with if this is the same.
#[derive(Debug, Clone, PartialEq)]
pub struct Measuring {
    /// The stage.
    pub stage: StagePlan,
    /// The meter.
    pub meter: MeterPlan,
    /// Scan: the angles that are read, and how often.
    pub scan: Scan,
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// The angle at which a standard is read in place of the incident power, deg.
    pub standard_deg: Option<f64>,
}

/// A run as it is planned.
#[derive(Debug, Clone)]
pub struct RunPlan {
    /// Name of the sample.
    pub name: String,
    /// Planned measurement.
    pub measuring: Measuring,
    /// Setup of the rig.
    pub setup: Setup,
    /// The file's text.
    pub source: String,
    /// The file of a virtual rig that stands in for the devices.
    pub rig: Option<Document>,
}

impl RunPlan {
    /// A plan from its document; `rig` is the text of the virtual rig where it does not come from the file that is named.
    ///
    /// # Errors
    /// Values that no run can have, with line and key.
    pub fn new(document: &Document, rig: Option<&str>) -> Result<Self, RunPlanError> {
        let written: Written = document.parse()?;
        check(document, &written)?;
        let rig = match (&written.virtual_rig, rig) {
            (None, _) => None,
            (Some(path), Some(text)) => Some(Document::new(document.resolve(path), text)?),
            (Some(path), None) => Some(Document::read(document.resolve(path))?),
        };
        let setup = setup(&written);
        let stem = document.path().file_stem().unwrap_or_default().to_string_lossy();
        Ok(Self {
            name: written.name.unwrap_or_else(|| stem.into_owned()),
            measuring: Measuring {
                stage: written.stage,
                meter: written.meter,
                scan: written.scan,
                wavelength_nm: written.laser.wavelength_nm.get(),
                standard_deg: written.standard.map(|standard| standard.angle_deg.get()),
            },
            setup,
            source: document.source().to_owned(),
            rig,
        })
    }
}

fn check(document: &Document, written: &Written) -> Result<(), RunPlanError> {
    let angles = written.scan.angles();
    let wrong = |key: &str, expected: &str| -> Result<(), RunPlanError> {
        Err(document.error_at(key, expected).into())
    };
    if written.scan.readings < 3 {
        return wrong("scan.readings", "3 or more: fewer tell no scatter and no outlier");
    }
    if written.scan.readings > 10_000 || angles.len() > 100_000 {
        return Err(RunPlanError::TooMany {
            file: document.path().display().to_string(),
            angles: angles.len(),
            readings: written.scan.readings,
        });
    }
    if angles.is_empty() || written.scan.to_deg < written.scan.from_deg {
        return wrong("scan.to_deg", "an angle that is not before from_deg");
    }
    for (key, device) in
        [("stage.device", &written.stage.device), ("meter.device", &written.meter.device)]
    {
        if (device == VIRTUAL) != written.virtual_rig.is_some() {
            let expected = match written.virtual_rig {
                Some(_) => "`virtual`, as the file names a virtual rig",
                None => {
                    "an address (sunglint devices list --drivers), or virtual = \"rig.toml\" for the whole rig"
                }
            };
            return wrong(key, expected);
        }
    }
    match (&written.standard, &written.splitter) {
        (Some(_), Some(_)) => {
            return wrong(
                "splitter",
                "no such table beside [standard], whose light goes the same way",
            );
        }
        (Some(_), None) if written.incident.is_some() => {
            return wrong("incident", "no such table beside [standard]");
        }
        (None, None) => {
            return wrong(
                "splitter.reflectance",
                "it at the laser's polarisation, or a [standard]",
            );
        }
        _ => {}
    }
    let stop = &written.stop;
    let is_disc = stop.diameter_mm.is_some();
    let is_plate = stop.width_mm.is_some() && stop.height_mm.is_some();
    if is_disc == is_plate || (is_disc && (stop.width_mm.is_some() || stop.height_mm.is_some())) {
        return wrong("stop", "either diameter_mm, or width_mm and height_mm");
    }
    Ok(())
}

fn setup(written: &Written) -> Setup {
    let sigma = |sigma: &Option<NonNegative>| sigma.map_or(0.0, NonNegative::get);
    let reference = match &written.standard {
        Some(standard) => Reference::Standard {
            f_per_sr: Known {
                value: standard.reflectance.get() * std::f64::consts::FRAC_1_PI,
                relative_sigma: sigma(&standard.relative_sigma),
            },
            angle_deg: standard.angle_deg.get(),
        },
        None => Reference::Power {
            transmission: written.incident.as_ref().map_or(Known::exact(1.0), |filter| Known {
                value: filter.filter_transmission.get(),
                relative_sigma: sigma(&filter.relative_sigma),
            }),
            splitter: written.splitter.as_ref().map_or(Known::exact(1.0), |splitter| Known {
                value: splitter.reflectance.get(),
                relative_sigma: sigma(&splitter.relative_sigma),
            }),
            lens: written.lens.as_ref().map_or(Known::exact(1.0), |lens| Known {
                value: lens.transmission.get(),
                relative_sigma: sigma(&lens.relative_sigma),
            }),
        },
    };
    let stop = &written.stop;
    let shape = match (stop.diameter_mm, stop.width_mm, stop.height_mm) {
        (None, Some(width), Some(height)) => {
            Shape::Rectangle { width_mm: width.get(), height_mm: height.get() }
        }
        (diameter, ..) => Shape::Disc { diameter_mm: diameter.map_or(0.0, Positive::get) },
    };
    let tilt_deg = stop.tilt_deg.map_or(0.0, Finite::get);
    let mount = &written.mount;
    Setup {
        wavelength_nm: written.laser.wavelength_nm.get(),
        reference,
        stop: (
            Stop { shape, tilt_deg, distance_mm: stop.distance_mm.get() },
            sigma(&stop.relative_sigma),
        ),
        spot: written.sample.as_ref().map(|sample| {
            let spot = Spot {
                beam_diameter_mm: sample.beam_diameter_mm.get(),
                sample_width_mm: sample.width_mm.get(),
                off_centre_mm: sigma(&sample.off_centre_mm),
            };
            (spot, sample.most_spilled.map_or(1e-3, Positive::get))
        }),
        angle_sigma_deg: written.stage.angle_sigma_deg.get(),
        zero_deg: mount.zero_deg.map(|zero| zero.get()),
        zero_sigma_deg: mount.zero_sigma_deg.map_or(0.5, NonNegative::get),
        most_offset_deg: mount.most_offset_deg.map_or(5.0, NonNegative::get),
    }
}
