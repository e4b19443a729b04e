//! Runs with several channels on the virtual goniometer: a spectrometer, a monochromator, files that somebody else writes.
//!
//! Truth: the virtual goniometer's closed forms: Planck's law for the lamp, a band in the sample's lobe, a power law for its Lambert part (virtual/src/goniometer/light.rs). It makes counts pixel by pixel and
//! shares no formula with the reduction.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::goniometer::{Robot, bench, directions};
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, DeviceClock, VirtualClock};
use sunglint_drivers::device::{InBeam, RotationStage};
use sunglint_formats::toml::Document;
use sunglint_materials::goniometer::bench::Bench;
use sunglint_materials::goniometer::channels::Reads;
use sunglint_materials::goniometer::files::{COPIES, Folder};
use sunglint_materials::goniometer::folder;
use sunglint_materials::goniometer::line::{BENCH, Begun, FILES, Line, Log, PLAN};
use sunglint_materials::goniometer::measure::{Detector, Devices, RunError, done_of, measure_with};
use sunglint_materials::goniometer::pose::Kinematics;
use sunglint_materials::goniometer::reduce::{GoniometerError, Reduced, reduce};
use sunglint_materials::goniometer::tasks::{Part, Tasks, tasks};
use sunglint_materials::log::{InMemory, Record, RecordError};
use sunglint_materials::plan::Planned;
use sunglint_materials::reading::State;
use sunglint_materials::retro::measure::{Hands, HandsError};
use sunglint_virtual::goniometer::devices::VirtualGoniometer;
use sunglint_virtual::goniometer::light::{Arms, Bench as Light};
use sunglint_virtual::goniometer::options::Options;

/// A bench that looks at itself in few steps.
const FEW: &str = "[scan]\nreadings = 3\nreference_every = 15\n[signature]\nstep_deg = 0.3\n[zero]\nstep_deg = 1\n[floor]\nstep_deg = 20\n";

fn spectral(seed: u64) -> Options {
    let mut options = Options { seed, ..Options::default() };
    (options.sample.alpha, options.sample.reflectance) = (0.2, 0.5);
    options.sample.base_reflectance = 0.3;
    (options.spectrum.band_depth, options.spectrum.base_exponent) = (0.5, 1.5);
    (options.zero.sample_deg, options.zero.detector_deg) = (0.21, -0.17);
    (options.lamp.drift_per_h, options.lamp.wave, options.lamp.noise) = (0.02, 0.005, 0.002);
    options.stray.floor_per_sr = 1e-4;
    options.spectrometer.counts_per_s_per_w = 7e10;
    options
}

fn with_spectrometer(integration_s: &str) -> Bench {
    bench(&format!(
        "virtual = \"goniometer.toml\"\n[axis.azimuth]\n[spectrometer]\nbands = {{ from_nm = 450, to_nm = 700, step_nm = 10 }}\nintegration_s = {integration_s}\n{FEW}"
    ))
}

/// Events of a run in memory.
#[derive(Default)]
struct Told {
    lines: Vec<Line>,
    events: Vec<String>,
}

impl Record<Line> for Told {
    fn line(&mut self, line: &Line) -> Result<(), RecordError> {
        self.lines.push(line.clone());
        Ok(())
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn event(&mut self, text: &str) -> Result<(), RecordError> {
        self.events.push(text.to_owned());
        Ok(())
    }
}

/// Goes on with a run on the virtual bench.
fn go_on(
    bench: &Bench,
    options: &Options,
    list: &Tasks,
    before: &[Line],
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let read = before.iter().filter(|line| line.state.is_reading()).count();
    let made = VirtualGoniometer::new(options.clone(), read as u64).unwrap();
    let mut stages: Vec<_> = (0..4).map(|k| made.stage(k)).collect();
    let (mut meter, mut spectrometer) = (made.meter(), made.spectrometer());
    let mut monochromator =
        matches!(bench.reads, Reads::Monochromator(_)).then(|| made.monochromator());
    let mut hands = Robot(made);
    let clock = VirtualClock::new();
    if let Some(last) = before.last() {
        clock.sleep(Duration::from_secs_f64(last.time_s + 60.0));
    }
    let zero_utc = Some(hifitime::Epoch::from_gregorian_utc_at_midnight(2026, 1, 1));
    let mut each = stages.iter_mut().map(|stage| stage as &mut dyn RotationStage);
    let stages = bench.all_axes().map(|axis| {
        let stage = each.next().unwrap();
        axis.map(|_| stage)
    });
    let detector = match (&bench.reads, &mut monochromator) {
        (Reads::Spectrometer(_), _) => Detector::Spectrometer(&mut spectrometer),
        (_, Some(monochromator)) => Detector::Monochromator(monochromator, &mut meter),
        _ => Detector::Meter(&mut meter),
    };
    let mut devices = Devices {
        stages,
        detector,
        hands: &mut hands,
        clock: DeviceClock { clock: Arc::new(clock), zero_utc },
        cancel: Cancel::new(),
    };
    measure_with(&mut devices, bench, &list.tasks, before, 0.0, record)
}

/// Words of a run about channels that saturate in the beam.
const OVER: &str = "over the detector's range in the beam";

fn reduced(bench: &Bench, list: &Tasks, lines: &[Line]) -> Reduced {
    let kinematics = Kinematics::new(bench);
    reduce(lines, bench, &kinematics, &list.tasks, &list.missing, &list.unreachable).unwrap()
}

fn whole(bench: &Bench, options: &Options, planned: &[Planned]) -> (Vec<Line>, Tasks, Reduced) {
    let list = tasks(bench, &Kinematics::new(bench), planned);
    let mut told = Told::default();
    go_on(bench, options, &list, &[], &mut told).unwrap();
    // Where the beam saturates, the run says so, and nothing else.
    assert!(told.events.iter().all(|text| text.contains(OVER)), "{:?}", told.events);
    let found = reduced(bench, &list, &told.lines);
    let over = found.warnings.iter().any(|text| text.contains("the beam is over its"));
    assert_eq!(!told.events.is_empty(), over, "{:?}", told.events);
    (told.lines, list, found)
}

/// How far values lie from the closed form: the part within twice their stated doubt and `tolerance`, the largest difference over the closed form beyond five times the doubt, and the root mean
/// square over the doubt.
fn against(found: &Reduced, light: &Light, tolerance: f64) -> (f64, f64, f64) {
    let (mut within, mut all, mut worst, mut squares) = (0.0, 0.0, 0.0_f64, 0.0);
    for row in &found.samples.rows {
        let (i, o) = row.directions();
        for (k, nm) in found.samples.wavelength_nm.iter().enumerate() {
            let exact = light.radiance_at(i, o, *nm) / o.z;
            let (value, sigma) = (row.brdf_per_sr[k], row.sigma_per_sr[k]);
            let doubt = sigma.hypot(found.scale_sigma * exact);
            let off = (value - exact).abs();
            all += 1.0;
            within += f64::from(u8::from(off <= 2.0 * doubt + tolerance * exact));
            worst = worst.max((off - 5.0 * doubt) / exact);
            squares += ((value - exact) / doubt).powi(2);
        }
    }
    (within / all, worst, (squares / all).sqrt())
}

/// Bands of 10 nm over a lobe with a band of σ 40 nm and depth 0.5, a lamp of 3000 K, a detector whose sensitivity is a bell. Promises: at least 90 % of all values within twice the stated doubt and
/// 0.6 % of the closed form at the band's middle (its curvature over 10 nm is 0.13 %, half a pixel of shift in its steepest place 0.2 %, the lamp's slope over the band 0.05 %, the cone's blur of α = 0.2 and
/// what the parabola of the zeros takes of it 0.1 %); none off by more than five times the doubt and 2 %. Zeros within 4 σ and 0.02°.
#[test]
fn a_spectrometer_has_values_of_all_channels() {
    let bench = with_spectrometer("[0.0002, 0.002, 0.02, 0.2, 2]");
    let options = spectral(3);
    let (lines, list, found) = whole(&bench, &options, &directions(&[15.0, 40.0, 65.0]));
    let light = Light::new(options.clone()).unwrap();
    assert_eq!(found.samples.wavelength_nm.len(), 26);
    assert_eq!(
        found.samples.rows.len(),
        list.tasks.iter().filter(|t| t.part == Part::Direction).count()
    );
    let (within, worst, rms) = against(&found, &light, 6e-3);
    eprintln!("spectrometer: {within:.4} within, worst {worst:.4} beyond, rms {rms:.2}");
    assert!(within >= 0.9 && worst < 0.02, "{within} {worst} {rms}");
    let zeros = &found.instrument.zeros;
    for (zero, exact) in [(zeros.sample_deg, 0.21), (zeros.detector_deg, -0.17)] {
        assert!((zero.value - exact).abs() < 4.0 * zero.sigma + 0.02, "{zeros:?}");
    }
    // The integrations follow the light, and each has a dark of its own at both ends.
    let ranges: BTreeSet<&str> = lines.iter().map(|line| line.range.as_str()).collect();
    assert_eq!(ranges.len(), 5, "{ranges:?}");
    let darks = lines.iter().filter(|l| l.part == Part::Dark && l.state == State::Kept).count();
    assert_eq!(darks, 10);
    let it = &found.instrument;
    assert!(it.incident_w.value.is_nan() && it.channels.len() == 26);
    assert!(it.channels.iter().all(|channel| channel.unit == Some("ct / s")));
    // The table goes through a file.
    let table = found.samples.to_table();
    let again =
        sunglint_materials::samples::Samples::from_table("samples.ecsv", &table, None).unwrap();
    assert_eq!(again.wavelength_nm, found.samples.wavelength_nm);
    let text = serde_json::to_string(&it).unwrap();
    assert!(!text.contains("incident_w") && text.contains("\"channels\""), "{text}");
}

/// A beam that saturates the pixels about the middle, whatever the integration. Truth: the closed form of the brightest pixel of a channel. Those channels are left out and named, and the others are as good as ever.
#[test]
fn channels_that_saturate_are_left_out_alone() {
    let bench = with_spectrometer("[0.0002, 0.002, 0.02, 0.2, 2]");
    let mut options = spectral(4);
    options.spectrometer.counts_per_s_per_w = 1.8e11;
    // A lamp that is steady, so that a channel near the edge is on one side of it.
    (options.lamp.drift_per_h, options.lamp.wave, options.lamp.noise) = (0.0, 0.0, 0.0);
    let (_, _, found) = whole(&bench, &options, &directions(&[40.0]));
    let light = Light::new(options.clone()).unwrap();
    let it = &options.spectrometer;
    let counts = |nm: f64| {
        let bell = (-0.5 * ((nm - it.peak_nm) / it.sensitive_nm).powi(2)).exp();
        it.bias_counts + 2e-4 * it.counts_per_s_per_w * bell * 2e-3 * light.lamp_part(nm)
    };
    // Pixels of a band may lie anywhere in it; noise is some 130 counts.
    let most = |nm: f64| (-10..=10).map(|k| counts(nm + 0.5 * f64::from(k))).fold(0.0, f64::max);
    let known = &found.samples.wavelength_nm;
    let (mut over, mut good) = (0, 0);
    for band in &bench.bands {
        let full = most(band.nm) / it.saturation_counts;
        if full > 1.02 {
            assert!(!known.contains(&band.nm), "{} {full}", band.nm);
            over += 1;
        } else if full < 0.98 {
            assert!(known.contains(&band.nm), "{} {full}", band.nm);
            good += 1;
        }
    }
    assert!(over > 3 && good > 3, "{over} {good}");
    assert!(
        found.warnings.iter().any(|w| w.contains("left out") && w.contains("over its")),
        "{:?}",
        found.warnings
    );
    let (within, worst, _) = against(&found, &light, 6e-3);
    assert!(within >= 0.9 && worst < 0.02, "{within} {worst}");
}

/// A beam that saturates all channels. Truth: it has readings, all over range; to go on with the run would not help. The run says it at the beam, and the values' error is that of the beam.
#[test]
fn a_beam_that_saturates_all_channels_is_said() {
    let bench = with_spectrometer("[0.0002, 0.002, 0.02]");
    let mut options = spectral(9);
    options.spectrometer.counts_per_s_per_w = 1e14;
    let list = tasks(&bench, &Kinematics::new(&bench), &directions(&[40.0])[..6]);
    let mut told = Told::default();
    go_on(&bench, &options, &list, &[], &mut told).unwrap();
    let first = &told.events[0];
    assert!(first.contains("26 of 26 channels") && first.contains(OVER), "{first}");
    let kinematics = Kinematics::new(&bench);
    let (missing, unreachable) = (&list.missing, &list.unreachable);
    let error = reduce(&told.lines, &bench, &kinematics, &list.tasks, missing, unreachable);
    assert!(matches!(error.unwrap_err(), GoniometerError::BeamOver));
}

/// Truth: the set of tasks. A run that is broken off after any line and gone on with has each measurement once and values of the same closed form.
#[test]
fn a_spectrometers_run_goes_on_after_any_line() {
    for text in [
        "[spectrometer]\nchannels_nm = [[500, 20], [550, 10], [650, 20]]\nintegration_s = [0.0002, 0.02, 2]\n",
        "[monochromator]\nwavelengths_nm = [500, 550, 650]\n",
    ] {
        let bench = bench(&format!("virtual = \"goniometer.toml\"\n[axis.azimuth]\n{text}{FEW}"));
        let options = spectral(5);
        let (lines, list, _) = whole(&bench, &options, &directions(&[30.0])[..24]);
        let all: HashSet<_> = list.tasks.iter().map(|t| (t.part, t.number)).collect();
        assert_eq!(done_of(&lines, &bench), all);
        // Steps of a hundred are taken although the bias is more than a hundredth of the converter.
        let ranges: BTreeSet<&str> = lines
            .iter()
            .filter(|line| line.part == Part::Direction && !line.channels.is_empty())
            .map(|line| line.range.as_str())
            .collect();
        assert!(text.starts_with("[mono") || ranges.contains("2s"), "{ranges:?}");
        let light = Light::new(options.clone()).unwrap();
        for k in 0..30 {
            let cut = ((k * lines.len()) / 30 + k % 5).min(lines.len());
            let before = &lines[..cut];
            let mut again = InMemory(before.to_vec());
            go_on(&bench, &options, &list, before, &mut again).unwrap();
            let found = done_of(&again.0, &bench);
            let extra = found.difference(&all).filter(|(part, _)| *part == Part::Reference).count();
            assert_eq!(found.len(), all.len() + extra, "{cut}");
            // Only a look at the reference that was cut between two wavelengths is read twice.
            let mut kept = HashSet::new();
            for line in again.0.iter().filter(|l| l.state == State::Kept) {
                let key = (line.part, line.number, line.wavelength_nm.map(f64::to_bits));
                assert!(kept.insert(key) || line.part == Part::Reference, "{cut}: {key:?}");
            }
            let each = if text.starts_with("[mono") { 3 } else { 1 };
            assert_eq!(kept.len(), each * found.len(), "{cut}");
            if k % 6 == 0 {
                let found = reduced(&bench, &list, &again.0);
                let (within, worst, _) = against(&found, &light, 8e-3);
                assert!(within >= 0.9 && worst < 0.02, "{cut}: {within} {worst}");
            }
        }
    }
}

/// Truth: a look tells the lamp at one time. One that is broken off between two wavelengths is read anew at all of them; a direction only at those that are left.
#[test]
fn a_look_that_is_cut_between_two_wavelengths_is_read_anew() {
    let bench = bench(&format!(
        "virtual = \"goniometer.toml\"\n[axis.azimuth]\n[monochromator]\nwavelengths_nm = [500, 550, 650]\n{FEW}"
    ));
    let options = spectral(5);
    let (lines, list, _) = whole(&bench, &options, &directions(&[30.0])[..24]);
    for (part, anew) in [(Part::Reference, 3), (Part::Direction, 2)] {
        let is_first = |line: &Line| line.part == part && line.state == State::Kept;
        // The last place of the part, after its first wavelength.
        let number = lines.iter().rfind(|line| is_first(line)).unwrap().number;
        let is_of = |line: &Line| is_first(line) && line.number == number;
        let cut = lines.iter().position(is_of).unwrap() + 1;
        let mut again = InMemory(lines[..cut].to_vec());
        go_on(&bench, &options, &list, &lines[..cut], &mut again).unwrap();
        assert_eq!(again.0[cut..].iter().filter(|line| is_of(line)).count(), anew, "{part:?}");
    }
}

/// A monochromator before the meter: 6 wavelengths at each place. Promises as of the spectrometer; a wavelength is one, so that there is no band to average over.
#[test]
fn a_monochromator_has_values_of_all_wavelengths() {
    let bench = bench(&format!(
        "virtual = \"goniometer.toml\"\n[axis.azimuth]\n[monochromator]\nwavelengths_nm = [450, 500, 550, 600, 650, 700]\n{FEW}"
    ));
    let options = spectral(6);
    let (lines, _, found) = whole(&bench, &options, &directions(&[20.0, 55.0]));
    let light = Light::new(options.clone()).unwrap();
    assert_eq!(found.samples.wavelength_nm, [450.0, 500.0, 550.0, 600.0, 650.0, 700.0]);
    let (within, worst, rms) = against(&found, &light, 4e-3);
    eprintln!("monochromator: {within:.4} within, worst {worst:.4} beyond, rms {rms:.2}");
    assert!(within >= 0.9 && worst < 0.02, "{within} {worst} {rms}");
    // Powers are in W: that of the brightest wavelength's beam.
    let lamp = light.lamp_w(0.0) * light.lamp_part(700.0);
    let incident = found.instrument.incident_w.value;
    assert!((incident / lamp - 1.0).abs() < 0.02, "{incident} {lamp}");
    assert!(lines.iter().all(|line| line.wavelength_nm.is_some() && line.channels.is_empty()));
}

/// Truth: the options of the faults. A spectrum that lacks its second half is told and read again; a cable that is out ends the run with the number of the place, and what was read before is there.
#[test]
fn a_spectrometer_that_answers_short_or_not_at_all() {
    let bench = bench(&format!(
        "virtual = \"goniometer.toml\"\n[axis.azimuth]\n[spectrometer]\nchannels_nm = [[550, 10], [650, 20]]\nintegration_s = 0.0002\n{FEW}"
    ));
    let mut options = spectral(7);
    options.fault.short_at_reading = Some(50);
    let list = tasks(&bench, &Kinematics::new(&bench), &directions(&[30.0]));
    let mut told = Told::default();
    go_on(&bench, &options, &list, &[], &mut told).unwrap();
    assert_eq!(told.events.len(), 1, "{:?}", told.events);
    assert!(told.events[0].contains("answered 512 values, expected 1024"), "{:?}", told.events);
    let whole = told.lines;
    options.fault.unplugged_at_reading = Some(200);
    let mut told = Told::default();
    let error = go_on(&bench, &options, &list, &[], &mut told).unwrap_err().to_string();
    assert!(error.contains("its cable is out") && error.starts_with("at "), "{error}");
    let read = told.lines.iter().filter(|l| l.state.is_reading()).count();
    assert_eq!(read, 200 - 1, "one spectrum was short, and no longer counts");
    options.fault.unplugged_at_reading = None;
    let before = told.lines.clone();
    let mut again = InMemory(before.clone());
    go_on(&bench, &options, &list, &before, &mut again).unwrap();
    // Not a number is not itself.
    let texts = |lines: &[Line]| lines.iter().map(|l| format!("{l:?}")).collect::<Vec<_>>();
    assert!(texts(&again.0[..before.len()]) == texts(&before), "lines were lost or changed");
    assert_eq!(done_of(&again.0, &bench), done_of(&whole, &bench));
}

/// A folder for a test, which goes when the test ends.
struct Place(PathBuf);

impl Place {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("sunglint-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const PLAN_TEXT: &str = "# %ECSV 1.0\n";

/// Truth: the lines that were written. A folder whose table ends at any byte is read up to its last whole line, with all channels.
#[test]
fn readings_of_channels_survive_a_cut_at_any_byte() {
    let place = Place::new("cut-channels");
    let bench = bench(&format!(
        "virtual = \"goniometer.toml\"\n[axis.azimuth]\n[spectrometer]\nchannels_nm = [[550, 10], [650, 20]]\n{FEW}"
    ));
    let clock = DeviceClock {
        clock: Arc::new(VirtualClock::new()),
        zero_utc: Some(hifitime::Epoch::from_gregorian_utc_at_midnight(2026, 1, 1)),
    };
    let run = place.0.join("run");
    let files = [(PLAN, PLAN_TEXT), (BENCH, bench.source.as_str())];
    let mut log = Log::create_with(&run, &files, Line::header_of(&bench), clock).unwrap();
    let line = |state, channels: [f64; 2]| Line {
        time_s: 1.5,
        part: Part::Direction,
        number: 3,
        stages: [Some(1.0), Some(2.0), Some(0.0), None],
        power_w: f64::NAN,
        state,
        range: "0.05s".into(),
        wavelength_nm: None,
        channels: channels.to_vec(),
        noise: Vec::new(),
        file: None,
    };
    let written = [
        line(State::Read, [1234.5, f64::INFINITY]),
        line(State::Over, [f64::INFINITY; 2]),
        line(State::Kept, [f64::NAN; 2]),
    ];
    let readings = run.join("readings.ecsv");
    let start = std::fs::read(&readings).unwrap().len();
    for one in &written {
        log.line(one).unwrap();
    }
    let bytes = std::fs::read(&readings).unwrap();
    let ends: Vec<usize> =
        (start..bytes.len()).filter(|k| bytes[*k] == b'\n').map(|k| k + 1).collect();
    assert_eq!(ends.len(), 3);
    for cut in start..=bytes.len() {
        std::fs::write(&readings, &bytes[..cut]).unwrap();
        let begun = Begun::read(&run, &FILES).unwrap();
        let whole = ends.iter().filter(|end| **end <= cut).count();
        assert_eq!(begun.lines.len(), whole, "{cut}");
        for (found, line) in begun.lines.iter().zip(&written) {
            // Not a number is not itself.
            assert_eq!(format!("{found:?}"), format!("{line:?}"), "{cut}");
        }
    }
}

/// A person who turns axes and puts things into the beam, beside an instrument that writes a file when a spectrum is wanted.
struct Ftir {
    folder: PathBuf,
    light: Light,
    arms: Arms,
    place: InBeam,
    count: u32,
    /// Everything that was asked.
    asked: Vec<String>,
    wrong: bool,
    threads: Vec<std::thread::JoinHandle<()>>,
}

/// Wavenumbers of the instrument, cm⁻¹.
fn wavenumbers() -> impl Iterator<Item = f64> {
    (0..400).map(|k| 14_000.0 + 20.0 * f64::from(k))
}

impl Ftir {
    /// A spectrum with a noise of 2e-4 of the beam's, drawn by a formula.
    fn text(&self) -> String {
        let mut text = String::from("# synthetic\nwavenumber_per_cm,single_beam\n");
        let [grey, lobe, base] = self.light.parts(self.place, &self.arms);
        for (k, per_cm) in wavenumbers().enumerate() {
            let nm = 1e7 / per_cm;
            let strength = self.light.sample_parts(nm);
            let light =
                self.light.lamp_part(nm) * (grey + strength.lobe * lobe + strength.base * base);
            let x = (f64::from(self.count) * 12.9898 + k as f64 * 78.233).sin() * 43_758.545_3;
            let noise = 1e-7 * (x - x.floor() - 0.5);
            text += &format!("{per_cm},{}\n", 10.0 * (light + noise));
        }
        text
    }
}

impl Hands for Ftir {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.asked.push(place.name().into());
        self.place = place;
        Ok(())
    }

    fn turn(&mut self, axis: &str, deg: f64) -> Result<(), HandsError> {
        self.asked.push(format!("{axis} {deg:.2}"));
        match axis {
            "sample" => self.arms.incidence_deg = deg,
            "detector" => self.arms.detector_deg = deg,
            _ => return Err("no such axis".into()),
        }
        Ok(())
    }

    fn record(&mut self, text: &str) {
        self.asked.push(text.to_owned());
        let text = self.text();
        let (folder, number) = (self.folder.clone(), self.count);
        let wrong = std::mem::take(&mut self.wrong);
        self.count += 1;
        self.threads.push(std::thread::spawn(move || {
            let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
            let wait = |ms| std::thread::sleep(Duration::from_millis(ms));
            wait(100);
            if wrong {
                // Another grid, another unit, no spectrum, the content of a file that was taken; a file of another kind.
                let short: String = text.lines().take(300).map(|l| format!("{l}\n")).collect();
                write("wrong-grid.csv", &short);
                write("wrong-unit.csv", &text.replace("single_beam", "reflectance"));
                write("wrong-log.csv", &text.replace("single_beam", "absorbance"));
                write("wrong-text.csv", "hello\n");
                std::fs::copy(folder.join("s0000.csv"), folder.join("wrong-twice.csv")).unwrap();
                write("notes.txt", "hello\n");
                let old = std::fs::File::create(folder.join("wrong-old.csv")).unwrap();
                old.set_modified(std::time::SystemTime::now() - Duration::from_secs(3600)).unwrap();
                std::fs::write(folder.join("wrong-old.csv.tmp"), &text).unwrap();
                drop(old);
                let path = folder.join("wrong-old.csv");
                std::fs::write(&path, text.replace("# synthetic", "# synthetic, older")).unwrap();
                let old = std::fs::File::options().write(true).open(&path).unwrap();
                old.set_modified(std::time::SystemTime::now() - Duration::from_secs(3600)).unwrap();
                wait(1200);
            }
            // In two halves, as a slow disk has it.
            let name = format!("s{number:04}.csv");
            let half = text.len() / 2;
            write(&name, &text[..half]);
            wait(150);
            write(&name, &text);
        }));
    }
}

fn by_hand(options: &Options, inbox: &Path) -> (Bench, Ftir) {
    let text = "[axis.sample]\ndevice = \"hand\"\n[axis.detector]\ndevice = \"hand\"\n[files]\nfolder = \"inbox\"\npattern = \"*.csv\"\nchannels_nm = [[500, 20], [550, 10], [650, 20]]\ncomplete_s = 0.4\n[scan]\nreference_every = 5\n[signature]\nmeasure = false\n[zero]\nmeasure = false\nsigma_deg = 0.01\n[floor]\nmeasure = false\n";
    let bench = Bench::new(&Document::new("bench.toml", text).unwrap(), None).unwrap();
    let light = Light::new(options.clone()).unwrap();
    let arms = Arms { incidence_deg: 0.0, detector_deg: 0.0, azimuth_deg: 0.0, turn_deg: 0.0 };
    let ftir = Ftir {
        folder: inbox.to_path_buf(),
        light,
        arms,
        place: InBeam::Nothing,
        count: 0,
        asked: Vec::new(),
        wrong: false,
        threads: Vec::new(),
    };
    (bench, ftir)
}

/// A person and an FTIR that cannot be driven: hands turn the axes, files come into a folder. Files that do not fit are refused with the reason and the run waits on; the run is broken off and gone on with; no file is taken twice.
/// Truth: the closed form; the beam is taken whole (there is no signature here), within the 5 % that are stated for that.
#[test]
fn a_person_and_files_in_a_folder() {
    let place = Place::new("ftir");
    let inbox = place.0.join("inbox");
    std::fs::create_dir_all(&inbox).unwrap();
    std::fs::write(inbox.join("before.csv"), "wavelength_nm,y\n1,1\n").unwrap();
    let mut options = spectral(8);
    (options.zero.sample_deg, options.zero.detector_deg) = (0.0, 0.0);
    (options.lamp.drift_per_h, options.lamp.wave, options.stray.floor_per_sr) = (0.0, 0.0, 0.0);
    let (bench, mut ftir) = by_hand(&options, &inbox);
    let Reads::Files(plan) = &bench.reads else { panic!("files") };
    let planned: Vec<Planned> = [(0.0, 30.0), (0.0, 50.123), (40.0, 40.0), (40.0, 20.0)]
        .iter()
        .enumerate()
        .map(|(k, (theta_i_deg, theta_o_deg))| Planned {
            step: k + 1,
            theta_i_deg: *theta_i_deg,
            phi_i_deg: 0.0,
            theta_o_deg: *theta_o_deg,
            phi_o_deg: 180.0,
        })
        .collect();
    let list = tasks(&bench, &Kinematics::new(&bench), &planned);
    let run = place.0.join("run");
    let files = [(PLAN, PLAN_TEXT), (BENCH, bench.source.as_str())];
    let clock = DeviceClock::live();
    let mut log = Log::create_with(&run, &files, Line::header_of(&bench), clock.clone()).unwrap();
    let mut before: Vec<Line> = Vec::new();
    // Two parts of the run: the first one is stopped at its sixth measurement.
    for part in 0..2 {
        let cancel = Cancel::new();
        let mut folder = Folder::new(plan, &bench.bands, &inbox, &run, &before).unwrap();
        ftir.wrong = part == 1;
        let until = if part == 0 { 5 } else { list.tasks.len() };
        let mut devices = Devices {
            stages: [None, None, None, None],
            detector: Detector::Files(&mut folder),
            hands: &mut ftir,
            clock: clock.clone(),
            cancel,
        };
        measure_with(&mut devices, &bench, &list.tasks[..until], &before, 0.0, &mut log).unwrap();
        before = Begun::read(&run, &FILES).unwrap().lines;
    }
    for thread in ftir.threads.drain(..) {
        thread.join().unwrap();
    }
    let events = std::fs::read_to_string(run.join("events.jsonl")).unwrap();
    for said in [
        "wrong-grid.csv is not taken: it has 298 values",
        "wrong-unit.csv is not taken",
        "wrong-log.csv is not taken: its values are absorbance",
        "wrong-text.csv is not taken",
        "wrong-twice.csv is not taken: it has the same content as s0000.csv",
        "wrong-old.csv is not taken: it was written before",
    ] {
        assert!(events.contains(said), "{said}: {events}");
    }
    assert!(!events.contains("notes.txt") && !events.contains("before.csv"), "{events}");
    // Each measurement once, each file once, with a copy whose content is the recorded one.
    assert_eq!(done_of(&before, &bench).len(), list.tasks.len());
    let taken: Vec<_> = before.iter().filter_map(|line| line.file.clone()).collect();
    let names: HashSet<&str> = taken.iter().map(|file| file.name.as_str()).collect();
    assert_eq!((taken.len(), names.len()), (list.tasks.len(), list.tasks.len()));
    for file in &taken {
        let copy = run.join(COPIES).join(format!("{}_{}", &file.sha256[..12], file.name));
        let bytes = std::fs::read(copy).unwrap();
        assert_eq!(sunglint_formats::sha256(&bytes), file.sha256);
        assert_eq!(bytes, std::fs::read(inbox.join(&file.name)).unwrap());
    }
    // An angle that a person cannot set finer is asked for, and recorded, as it is asked.
    assert!(ftir.asked.iter().any(|asked| asked == "detector 50.12"), "{:?}", ftir.asked);
    let stood = before.iter().find(|line| line.part == Part::Direction && line.number == 2);
    assert_eq!(stood.unwrap().stages[1], Some(50.12));
    let found = reduced(&bench, &list, &before);
    assert_eq!(found.samples.rows.len(), planned.len());
    let (within, worst, rms) = against(&found, &ftir.light, 5e-3);
    eprintln!("files: {within:.4} within, worst {worst:.4} beyond, rms {rms:.2}");
    assert!(within >= 0.9 && worst < 0.02, "{within} {worst} {rms}");
    assert!(folder::is_run(&run));
}

/// Truth: which detectors can be together. Each wrong bench is refused with its line, key and what to do.
#[test]
fn wrong_detectors_are_refused_with_line_and_key() {
    let refused = |text: &str, is_virtual: bool| {
        let head = if is_virtual { "virtual = \"g.toml\"\n" } else { "" };
        let document = Document::new("bench.toml", format!("{head}{text}")).unwrap();
        Bench::new(&document, Some("")).unwrap_err().to_string()
    };
    let hands = "[axis.sample]\ndevice = \"hand\"\n[axis.detector]\ndevice = \"hand\"\n";
    for (text, is_virtual, parts) in [
        (
            "[meter]\n[spectrometer]\nchannels_nm = [[500, 10]]\n",
            true,
            ["bench.toml:3: spectrometer", "one detector"],
        ),
        (
            "[spectrometer]\nchannels_nm = [[500, 10]]\n[monochromator]\nwavelengths_nm = [500]\n",
            true,
            ["monochromator", "one detector"],
        ),
        (
            "[laser]\n[spectrometer]\nchannels_nm = [[500, 10]]\n",
            true,
            ["bench.toml:2: laser", "their channels say the wavelengths"],
        ),
        ("[spectrometer]\n", true, ["spectrometer.channels_nm", "bands = {"]),
        (
            "[spectrometer]\nchannels_nm = [[500, 10], [450, 10]]\n",
            true,
            ["spectrometer.channels_nm", "rising middles"],
        ),
        (
            "[spectrometer]\nchannels_nm = [[500, 0]]\n",
            true,
            ["spectrometer.channels_nm", "wider than 0"],
        ),
        (
            "[spectrometer]\nchannels_nm = [[500, 10]]\nintegration_s = \"long\"\n",
            true,
            ["bench.toml:4: spectrometer.integration_s", "\"auto\""],
        ),
        (
            "[spectrometer]\nchannels_nm = [[500, 10]]\nintegration_s = [1, 0.1]\n",
            true,
            ["spectrometer.integration_s", "rising"],
        ),
        (
            "[spectrometer]\nchannels_nm = [[500, 10]]\naverage = 0\n",
            true,
            ["spectrometer.average", "1 to 10000"],
        ),
        (
            "[spectrometer]\nbands = { from_nm = 500, to_nm = 400, step_nm = 10 }\n",
            true,
            ["spectrometer.bands", "from_nm up to to_nm"],
        ),
        (
            "[spectrometer]\ndevice = \"ocean\"\nchannels_nm = [[500, 10]]\n",
            true,
            ["spectrometer.device", "`virtual`"],
        ),
        (
            "[monochromator]\nwavelengths_nm = [500, 450]\n",
            true,
            ["bench.toml:3: monochromator.wavelengths_nm", "rising"],
        ),
        (
            "[beam]\nfilter_transmissions = [0.1]\n",
            true,
            ["beam.filter_transmissions", "one number for each"],
        ),
        (
            "[beam]\nfilter_transmissions = [0.1]\n[monochromator]\nwavelengths_nm = [500, 550]\n",
            true,
            ["beam.filter_transmissions", "each of the 2 channels"],
        ),
        (
            "[files]\nfolder = \"x\"\nchannels_nm = [[500, 10]]\n",
            true,
            ["files", "writes no files"],
        ),
        (
            "[spectrometer]\nbands = { from_nm = 500, to_nm = 555, step_nm = 10 }\n",
            true,
            ["spectrometer.bands", "a whole number of steps"],
        ),
        (
            "[spectrometer]\nbands = { from_nm = 1, to_nm = 101, step_nm = 10 }\n",
            true,
            ["bench.toml:3: spectrometer.bands", "above 0 nm"],
        ),
        (
            "[spectrometer]\nchannels_nm = [[500, 10]]\nsettle_s = 1e20\n",
            true,
            ["spectrometer.settle_s", "at most 1000000 s"],
        ),
        ("[meter]\ntimeout_s = 1e20\n", true, ["meter.timeout_s", "at most 1000000 s"]),
        ("[beam]\nfilter_transmission = 0\n", true, ["beam.filter_transmission", "above 0"]),
        (
            "[beam]\nfilter_transmissions = [0.1, 0]\n[monochromator]\nwavelengths_nm = [500, 550]\n",
            true,
            ["beam.filter_transmissions", "above 0"],
        ),
        (
            "[beam]\nfilter_transmission = 0.1\nfilter_transmissions = [0.1, 0.1]\n[monochromator]\nwavelengths_nm = [500, 550]\n",
            true,
            ["beam.filter_transmissions", "not both"],
        ),
        ("[sample]\nindex = [1000, 0]\n", true, ["sample.index", "0.01 to 100"]),
    ] {
        let said = refused(text, is_virtual);
        assert!(parts.iter().all(|part| said.contains(part)), "{text}: {said}");
    }
    for (text, parts) in [
        (
            "[files]\nfolder = \"x\"\nchannels_nm = [[500, 10]]\npattern = \"a/*\"\n",
            ["files.pattern", "without a folder"],
        ),
        (
            "[files]\nfolder = \"x\"\nchannels_nm = [[500, 10]]\nreadings = 0\n",
            ["files.readings", "1 to 1000"],
        ),
        (
            "[scan]\nreadings = 7\n[files]\nfolder = \"x\"\nchannels_nm = [[500, 10]]\n",
            ["scan.readings", "its readings"],
        ),
        (
            "[axis.azimuth]\ndevice = \"hand\"\nhome = true\n[files]\nfolder = \"x\"\nchannels_nm = [[500, 10]]\n",
            ["axis.azimuth.home", "a person turns"],
        ),
    ] {
        let said = refused(&format!("{hands}{text}"), false);
        assert!(parts.iter().all(|part| said.contains(part)), "{text}: {said}");
    }
}
