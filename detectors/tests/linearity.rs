//! Linearity runs on a virtual rig: detectors that lose photons one by one, by their dead time or by their pixels' recovery and their comparator, under steps of light.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::sync::Arc;
use sunglint_calibration::detector::fit::{Choice, FitError, fit};
use sunglint_detectors::linearity::*;
use sunglint_detectors::reading::{Pace, RunError};
use sunglint_drivers::clock::{Cancel, Clock as _, DeviceClock, VirtualClock};
use sunglint_drivers::device::{FilterWheel, Source};
use sunglint_formats::toml::Document;
use sunglint_materials::log::{InMemory, Record, RecordError};
use sunglint_radiometry::station::DeadTime;
use sunglint_testkit::Campaign;
use sunglint_virtual::counting::detector::Detector;
use sunglint_virtual::counting::devices::VirtualCounting;
use sunglint_virtual::counting::options::{Kind, Options, Sensor, Slot};

fn slots(transmissions: &[f64]) -> Vec<Slot> {
    transmissions.iter().map(|t| Slot { cut_on_nm: 0.0, transmission: *t }).collect()
}

/// A rig without a lamp: only its sources.
fn rig(sensor: Sensor, a_hz: f64, b_hz: f64, transmissions: &[f64], seed: u64) -> Options {
    let mut options = Options { seed, wheel: slots(transmissions), sensor, ..Options::default() };
    options.lamp.intensity_w_per_sr_nm = 0.0;
    (options.sources.a_hz, options.sources.b_hz) = (a_hz, b_hz);
    options
}

fn plan(text: &str) -> LinearityPlan {
    let text = format!("virtual = \"rig.toml\"\n{text}");
    LinearityPlan::new(&Document::new("plan.toml", &text).unwrap(), Some("")).unwrap()
}

fn take(
    plan: &LinearityPlan,
    options: &Options,
    before: &[Line],
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let clock = VirtualClock::new();
    if let Some(last) = before.last() {
        clock.sleep(std::time::Duration::from_secs_f64(last.time_s + 60.0));
    }
    let zero_utc = Some(hifitime::Epoch::from_gregorian_utc_at_midnight(2026, 1, 1));
    let pace =
        Pace { clock: DeviceClock { clock: Arc::new(clock), zero_utc }, cancel: Cancel::new() };
    let bench = VirtualCounting::new(options.clone(), before.len() as u64).unwrap();
    let (mut counter, mut wheel) = (bench.counter(), bench.wheel());
    let (mut a, mut b) = (bench.source(0), bench.source(1));
    let mut sources: Vec<&mut dyn Source> = vec![&mut a];
    if plan.sources.len() > 1 {
        sources.push(&mut b);
    }
    let wheel: Option<&mut dyn FilterWheel> =
        if plan.wheel.is_some() { Some(&mut wheel) } else { None };
    let mut rig = Rig { counter: &mut counter, wheel, sources, pace };
    measure(&mut rig, plan, before, 0.0, record)
}

fn found(plan: &LinearityPlan, options: &Options) -> Result<Choice, FitError> {
    let mut record = InMemory::default();
    take(plan, options, &[], &mut record).unwrap();
    fit(&exposures(plan, &record.0), &plan.transmissions(), plan.pixels)
}

const STEPS: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.03];

/// Steps of the plan: known, or unknown at two levels.
fn steps_plan(known: bool, exposure_s: f64, repeats: u32) -> String {
    let mut text = format!("[scan]\nexposure_s = {exposure_s}\nrepeats = {repeats}\n[wheel]\n");
    for (k, transmission) in STEPS.iter().enumerate() {
        text += &format!("[[wheel.step]]\nslot = {}\n", k + 1);
        if known {
            text += &format!("transmission = {transmission}\n");
        }
    }
    let levels = if known { "" } else { "levels = [1, 0.4, 0.12]\n" };
    text + "[[source]]\n" + levels
}

fn value(choice: &Choice, name: &str) -> (f64, f64, f64) {
    let told = choice.told().unwrap_or_else(|| panic!("not told: {choice:?}"));
    let found = told.found.iter().find(|f| f.name == name).unwrap();
    (found.value, found.low, found.high)
}

/// Truth: the dead time with which photons were lost one by one; loads nτ from 0.3 to 0.45 at the brightest, 2e6 photons at the brightest (6e6 where transmissions are unknown), steps of known transmission, of unknown transmission at three levels, and two
/// sources alone and together, in turn; both laws.
///
/// Promise: the law is told, its dead time within 1 %, and within its interval of 95 % in as many runs (binomial p > 0.01). docs/uncertainty.md counts the runs.
#[test]
fn campaign_linearity() {
    let columns = &["below", "above", "pull", "half", "error"];
    let mut campaign = Campaign::in_shards("linearity", 200, 2, columns);
    let (mut largest, mut outside) = (0.0_f64, 0);
    for seed in campaign.seeds() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(4000 + seed);
        let kind = if seed % 2 == 0 { Kind::NonParalysable } else { Kind::Paralysable };
        let dead_time_ns = 20.0 * 100_f64.powf(random.random::<f64>());
        let load = 0.3 + 0.15 * random.random::<f64>();
        let most_hz = load / (1e-9 * dead_time_ns);
        let sensor = Sensor { kind, dead_time_ns, dark_hz: 1e-3 * most_hz, ..Sensor::default() };
        let exposure_s = 2e6 / most_hz;
        let (plan, options) = match (seed / 2) % 3 {
            0 => (plan(&steps_plan(true, exposure_s, 6)), rig(sensor, most_hz, 0.0, &STEPS, seed)),
            1 => (
                plan(&steps_plan(false, 3.0 * exposure_s, 6)),
                rig(sensor, most_hz, 0.0, &STEPS, seed),
            ),
            _ => {
                let text = format!(
                    "[scan]\nexposure_s = {exposure_s}\nrepeats = 20\n[[source]]\nlevels = [1, 0.5]\n[[source]]\nlevels = [1, 0.5]\n"
                );
                (plan(&text), rig(sensor, 0.5 * most_hz, 0.5 * most_hz, &[1.0], seed))
            }
        };
        let choice = found(&plan, &options).unwrap();
        let name = if seed % 2 == 0 { "non_paralysable" } else { "paralysable" };
        assert_eq!(choice.told().map(|t| t.name), Some(name), "seed {seed}: {choice:#?}");
        let (ns, low, high) = value(&choice, "dead_time_ns");
        let error = (ns / dead_time_ns - 1.0).abs();
        println!("seed {seed}: {name} {dead_time_ns:.2} ns, found {ns:.2} ({low:.2} to {high:.2})");
        assert!(error < 0.01, "seed {seed}: {ns} for {dead_time_ns}");
        outside += u64::from(!(low..=high).contains(&dead_time_ns));
        let (off, half) = (ns / dead_time_ns - 1.0, 0.5 * (high - low) / dead_time_ns);
        let [below, above] = [low > dead_time_ns, high < dead_time_ns].map(f64::from);
        campaign.keep(seed, &[below, above, off / (half / 1.96), half, off]);
        largest = largest.max(error);
    }
    let runs = campaign.seeds().count() as u64;
    assert!(sunglint_testkit::chance_of_misses(runs, outside, 0.05) > 0.01, "{outside} of {runs}");
    campaign.largest("largest_relative_error_of_the_dead_time", largest);
    if runs == 200 {
        campaign.largest("share_outside_95_percent", outside as f64 / runs as f64);
    }
    campaign.finish();
}

/// Truth: pixels that fire with the chance to which each has recovered, behind a comparator; 667 pixels, 50 ns, pulses of 10 to 30 ns. The curve that is found from steps of known transmission is held against other events
/// of the same detector, 1.6e6 photons each (0.08 % of noise), from 1e4 to 1e7 Hz.
///
/// Promise: within 0.5 % everywhere.
#[test]
fn campaign_mppc() {
    let mut campaign = Campaign::start("mppc", 20);
    let mut largest = 0.0_f64;
    let transmissions = [1.0, 0.5, 0.2, 0.05, 0.01, 1e-3];
    for seed in campaign.seeds() {
        let pulse_ns = 10.0 + seed as f64;
        let sensor = Sensor { kind: Kind::Pixels, pulse_ns, dark_hz: 3e3, ..Sensor::default() };
        let mut text = String::from(
            "[detector]\npixels = 667\n[scan]\nexposure_s = 0.05\nrepeats = 20\n[[source]]\n[wheel]\n",
        );
        for (k, transmission) in transmissions.iter().enumerate() {
            text += &format!("[[wheel.step]]\nslot = {}\ntransmission = {transmission}\n", k + 1);
        }
        let options = rig(sensor.clone(), 1.2e7, 0.0, &transmissions, seed);
        let choice = found(&plan(&text), &options).unwrap();
        assert!(!choice.left.is_empty(), "seed {seed}: {choice:#?}");
        let law = &choice.fitted[choice.left[0]].law;
        for k in 0..7 {
            let hz = 1e4 * 10_f64.powf(f64::from(k) / 2.0);
            let exposure_s = 1.6e6 / hz;
            let counts = Detector::new(&sensor, 777 * (seed + 1) + k as u64).counts(hz, exposure_s);
            let error = law.counted_hz(hz).unwrap() / (counts as f64 / exposure_s) - 1.0;
            assert!(error.abs() < 5e-3, "seed {seed}, {hz} Hz: {error}, {choice:#?}");
            largest = largest.max(error.abs());
        }
    }
    println!("{largest}");
    campaign.largest("largest_relative_error_of_the_curve", largest);
    campaign.finish();
}

const MPPC_STEPS: [f64; 6] = [1.0, 0.5, 0.2, 0.05, 0.01, 1e-3];

/// Steps of known transmission, six seconds in all under light.
fn mppc_plan(detector: &str) -> LinearityPlan {
    let mut text =
        format!("{detector}\n[scan]\nexposure_s = 0.05\nrepeats = 20\n[[source]]\n[wheel]\n");
    for (k, transmission) in MPPC_STEPS.iter().enumerate() {
        text += &format!("[[wheel.step]]\nslot = {}\ntransmission = {transmission}\n", k + 1);
    }
    plan(&text)
}

/// An MPPC whose pulses decay and add up; every second one with crosstalk and afterpulses.
fn mppc(seed: u64) -> Sensor {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(9000 + seed);
    let mut of = |a: f64, b: f64| a + (b - a) * random.random::<f64>();
    let noisy = f64::from(u8::from(!seed.is_multiple_of(2)));
    Sensor {
        kind: Kind::Mppc,
        pixels: if seed.is_multiple_of(3) { 400 } else { 1600 },
        recovery_ns: of(20.0, 60.0),
        pulse_ns: of(5.0, 25.0),
        level: of(0.3, 0.7),
        crosstalk: noisy * of(0.0, 0.1),
        afterpulse: noisy * of(0.0, 0.05),
        afterpulse_ns: of(20.0, 100.0),
        dark_hz: 3e3,
        ..Sensor::default()
    }
}

/// Truth: avalanches of 400 or 1,600 pixels that charge again exponentially and give pulses as high as they were charged, which decay within 5 to 25 ns and add up before a comparator at 0.3 to 0.7 of one; every second
/// detector with crosstalk (to 10 %) and afterpulses (to 5 %). No law has all of that. The curve that is found from steps of known transmission is held against other events of the same detector, 1.6e6 photons each (0.08 % of noise),
/// from 1e4 to 1e7 Hz. The unit of the light is its own: afterpulses are as many more counts at all rates.
///
/// Promise: a law is left, and its curve is within 0.5 % everywhere. Where pulses decay within 15 ns or more, the law is told: none of the others fits.
#[test]
fn campaign_mppc_pulses() {
    let mut campaign = Campaign::with_part("mppc_pulses", 20, 2);
    let mut largest = 0.0_f64;
    for seed in campaign.seeds() {
        let sensor = mppc(seed);
        let plan = mppc_plan(&format!("[detector]\npixels = {}", sensor.pixels));
        let options = rig(sensor.clone(), 1.2e7, 0.0, &MPPC_STEPS, seed);
        let choice = found(&plan, &options).unwrap();
        assert!(!choice.left.is_empty(), "seed {seed}: {choice:#?}");
        let best = &choice.fitted[choice.left[0]];
        if sensor.pulse_ns > 15.0 {
            assert_eq!(choice.told().map(|t| t.name), Some("decaying_pulses"), "{choice:#?}");
        }
        let mut worst = 0.0_f64;
        for k in 0..7 {
            let hz = 1e4 * 10_f64.powf(f64::from(k) / 2.0);
            let exposure_s = 1.6e6 / hz;
            let counts = Detector::new(&sensor, 777 * (seed + 1) + k as u64).counts(hz, exposure_s);
            let light_hz = hz * best.level_hz[0] / 1.2e7;
            let error = best.law.counted_hz(light_hz).unwrap() * exposure_s / counts as f64 - 1.0;
            assert!(error.abs() < 5e-3, "seed {seed}, {hz} Hz: {error}, {best:#?}");
            worst = worst.max(error.abs());
        }
        println!("seed {seed}: {} {:?}, off by {worst:.5}; {sensor:?}", best.name, best.found);
        largest = largest.max(worst);
    }
    campaign.largest("largest_relative_error_of_the_curve", largest);
    campaign.finish();
}

/// A detector of which no law is true says so, and where: an MPPC whose comparator is above one pulse counts crosstalk, and pulses that meet, which grow with the square of the light. Truth: the counts themselves, of which a law of dead time
/// has too few at the brightest or too many at the dimmest, by more than 5 %.
#[test]
fn where_no_law_fits_is_said_by_region() {
    let sensor = Sensor { level: 1.5, crosstalk: 0.02, ..mppc(1) };
    let options = rig(sensor, 1.2e7, 0.0, &MPPC_STEPS, 1);
    let choice = found(&mppc_plan("[detector]\npixels = 1600"), &options).unwrap();
    assert!(choice.left.is_empty() && law_toml(&choice).is_none(), "{choice:#?}");
    for fitted in &choice.fitted {
        let regions = &fitted.regions;
        assert_eq!(regions.iter().map(|r| r.lights).sum::<usize>(), 6, "{regions:?}");
        assert!(regions.windows(2).all(|w| w[0].counted_hz.1 < w[1].counted_hz.0), "{regions:?}");
        let worst = regions.iter().map(|r| r.worst.abs()).fold(0.0, f64::max);
        let chi2: f64 = regions.iter().map(|r| r.chi2).sum();
        assert!(!fitted.fits && worst > 0.05 && chi2 > 1000.0, "{regions:?}");
    }
}

/// Truth: a dead time of 400 ns and a recovery of 300 ns, with which photons were lost one by one, at loads to 0.6. The law is told, both times within their intervals of 95 % and 10 %; a detector with the dead time alone is not given
/// a recovery.
#[test]
fn a_recovery_is_told_from_a_dead_time() {
    let steps = plan(&steps_plan(true, 5.0, 10));
    let sensor = Sensor {
        kind: Kind::Recovery,
        dead_time_ns: 400.0,
        recovery_ns: 300.0,
        dark_hz: 100.0,
        ..Sensor::default()
    };
    let choice = found(&steps, &rig(sensor.clone(), 1.5e6, 0.0, &STEPS, 5)).unwrap();
    assert_eq!(choice.told().map(|t| t.name), Some("exponential_recovery"), "{choice:#?}");
    for (name, truth) in [("dead_time_ns", 400.0), ("recovery_ns", 300.0)] {
        let (found, low, high) = value(&choice, name);
        assert!(
            low < truth && truth < high && (found / truth - 1.0).abs() < 0.1,
            "{name} {found} {low} {high}"
        );
    }
    let text = law_toml(&choice).unwrap();
    assert!(
        text.contains("\"exponential_recovery\"\ndead_time_ns = ")
            && text.contains("\nrecovery_ns = "),
        "{text}"
    );
    let plain = Sensor { kind: Kind::NonParalysable, ..sensor };
    let choice = found(&steps, &rig(plain, 1.5e6, 0.0, &STEPS, 5)).unwrap();
    assert_eq!(choice.told().map(|t| t.name), Some("non_paralysable"), "{choice:#?}");
}

/// Where light is too dim for its dead time to bend the counts, no law is chosen over none; where both laws fit, both are left, and the station gets the table in place of one of them; a detector that follows
/// neither law within the noise gets none.
#[test]
fn a_law_is_chosen_only_where_the_data_tell() {
    let sensor = |kind, dead_time_ns: f64| Sensor {
        kind,
        dead_time_ns,
        dark_hz: 100.0,
        ..Sensor::default()
    };
    let steps = plan(&steps_plan(true, 0.05, 5));
    // nτ = 1e-4, 1e5 counts.
    let dim = rig(sensor(Kind::NonParalysable, 0.05), 2e6, 0.0, &STEPS, 3);
    let choice = found(&steps, &dim).unwrap();
    assert_eq!(choice.told().map(|t| t.name), Some("none"), "{choice:#?}");
    assert!(law_toml(&choice).unwrap().contains("dead_time_model = \"none\""));
    let limit = choice.fitted.iter().find(|f| f.name == "non_paralysable").unwrap().found[0];
    assert!(limit.low == 0.0 && limit.high > 0.05 && limit.high < 10.0, "{limit:?}");
    // nτ = 0.05: the laws differ by half of its square.
    let middle = rig(sensor(Kind::NonParalysable, 25.0), 2e6, 0.0, &STEPS, 3);
    let choice = found(&steps, &middle).unwrap();
    assert_eq!(choice.left.len(), 2, "{choice:#?}");
    let text = law_toml(&choice).unwrap();
    assert!(text.contains("cannot tell") && text.contains("linearity = "), "{text}");
    let table = table_csv("x", &choice, &choice.fitted[choice.left[0]]);
    let curve = sunglint_formats::curve::read_str("l.csv", &table, None).unwrap();
    assert_eq!((curve.x_name.as_str(), curve.y_name.as_str()), ("measured_hz", "true_hz"));
    let back = DeadTime::Table { measured_hz: curve.x, true_hz: curve.y };
    let truth = 1e6 / (1.0 + 1e6 * 25e-9);
    assert!((back.counted_hz(1e6).unwrap() / truth - 1.0).abs() < 1e-3);
    // Known transmissions that are wrong by 5 % at one step.
    let mut wrong = STEPS;
    wrong[1] = 0.525;
    let options = rig(sensor(Kind::NonParalysable, 100.0), 2e6, 0.0, &wrong, 3);
    let choice = found(&steps, &options).unwrap();
    assert!(choice.left.is_empty() && law_toml(&choice).is_none(), "{choice:#?}");
}

/// One level and unknown transmissions tell nothing: refused, in words.
#[test]
fn too_little_is_refused() {
    let text = steps_plan(false, 0.01, 3).replace("levels = [1, 0.4, 0.12]\n", "");
    let options = rig(Sensor::default(), 1e5, 0.0, &STEPS, 1);
    let error = found(&plan(&text), &options).unwrap_err();
    assert!(matches!(error, FitError::TooFew { .. }), "{error}");
    for (text, words) in [
        ("[scan]\nexposure_s = 1\nrepeats = 1\n[[source]]\n", "scan.repeats"),
        ("[scan]\nexposure_s = 1\nrepeats = 3\n", "source"),
        ("[scan]\nexposure_s = 1\nrepeats = 3\n[[source]]\nlevels = [0]\n", "source.levels"),
        ("[scan]\nexposure_s = 1\nrepeats = 3\n[[source]]\n[wheel]\nstep = []\n", "wheel.step"),
    ] {
        let text = format!("virtual = \"rig.toml\"\n{text}");
        let document = Document::new("plan.toml", &text).unwrap();
        let error = LinearityPlan::new(&document, Some("")).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// Stops after so many lines, as a kill would.
struct Killed(Vec<Line>, usize);

impl Record<Line> for Killed {
    fn line(&mut self, line: &Line) -> Result<(), RecordError> {
        if self.0.len() == self.1 {
            let source = std::io::Error::other("killed");
            return Err(RecordError::Write { file: "readings.ecsv", source });
        }
        self.0.push(line.clone());
        Ok(())
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn event(&mut self, _: &str) -> Result<(), RecordError> {
        Ok(())
    }
}

/// A run that is killed after any number of exposures goes on: each light has its repeats, none more.
#[test]
fn a_killed_linearity_run_goes_on() {
    let plan = plan(&steps_plan(true, 0.001, 3));
    let options = rig(Sensor::default(), 1e5, 0.0, &STEPS, 1);
    let places = places(&plan).len();
    assert_eq!(places, 6);
    for stop in 0..places * 3 {
        let mut killed = Killed(vec![], stop);
        take(&plan, &options, &[], &mut killed).unwrap_err();
        let mut rest = InMemory::default();
        take(&plan, &options, &killed.0, &mut rest).unwrap();
        let mut lines = killed.0;
        lines.extend(rest.0);
        assert_eq!(done(&lines, places), vec![3; places], "{stop}");
    }
}

/// The plan of docs/lab-efficiency.md on the rig of that page. Truth: its dead time of 1 µs, within 1 %, and its transmissions, within 1 %, two of which the plan does not know.
#[test]
fn the_pages_steps_give_the_pages_dead_time() {
    let page =
        std::fs::read_to_string(sunglint_testkit::repository().join("docs/lab-efficiency.md"));
    let page = page.unwrap();
    let block = |key: &str| {
        let blocks = page.split("```toml\n").skip(1).map(|b| b.split("```").next().unwrap());
        blocks.into_iter().find(|b| b.contains(key)).unwrap().to_owned()
    };
    let rig = Document::new("source.toml", block("sources = {")).unwrap();
    let options = Options::read(&rig).unwrap();
    let document = Document::new("steps.toml", block("[[wheel.step]]")).unwrap();
    let plan = LinearityPlan::new(&document, Some("")).unwrap();
    let choice = found(&plan, &options).unwrap();
    let (ns, low, high) = value(&choice, "dead_time_ns");
    assert!((ns / 1000.0 - 1.0).abs() < 0.01 && low < 1000.0 && high > 1000.0, "{ns} {low} {high}");
    for (found, slot) in choice.told().unwrap().transmission.iter().zip(&options.wheel) {
        assert!((found / slot.transmission - 1.0).abs() < 0.01, "{found} {slot:?}");
    }
}
