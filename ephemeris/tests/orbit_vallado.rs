//! SGP4 against the published verification set.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use sunglint_ephemeris::orbit::{DecayCause, TleOrbit, tle};
use sunglint_formats::ecsv;
use sunglint_formats::time::format_utc;
use sunglint_testkit::fixture;

/// One run of the set: elements, the times that were asked for, and what was published.
struct Run {
    line1: String,
    line2: String,
    start: f64,
    stop: f64,
    step: f64,
    /// Minutes, km, km/s.
    rows: Vec<[f64; 7]>,
}

fn runs() -> Vec<Run> {
    let elements = std::fs::read_to_string(fixture("orbits/SGP4-VER.TLE")).unwrap();
    let output = std::fs::read_to_string(fixture("orbits/tcppver.out")).unwrap();
    let mut runs = Vec::new();
    let lines: Vec<&str> = elements.lines().filter(|l| !l.starts_with('#')).collect();
    for pair in lines.chunks_exact(2) {
        let times: Vec<f64> =
            pair[1][69..].split_whitespace().map(|t| t.parse().unwrap()).collect();
        runs.push(Run {
            line1: pair[0].trim_end().to_owned(),
            line2: pair[1][..69].to_owned(),
            start: times[0],
            stop: times[1],
            step: times[2],
            rows: Vec::new(),
        });
    }
    let mut index = None;
    for line in output.lines() {
        if line.ends_with("xx") {
            index = Some(index.map_or(0, |i| i + 1));
            continue;
        }
        let numbers: Vec<f64> =
            line.split_whitespace().take(7).map(|n| n.parse().unwrap()).collect();
        runs[index.unwrap()].rows.push(numbers.try_into().unwrap());
    }
    assert_eq!(index, Some(runs.len() - 1));
    runs
}

/// The line with the checksum that its columns have.
fn with_checksum(line: &str) -> String {
    let sum: u32 =
        line[..68].chars().map(|c| if c == '-' { 1 } else { c.to_digit(10).unwrap_or(0) }).sum();
    format!("{}{}", &line[..68], sum % 10)
}

impl Run {
    /// With the checksums that three of the sets lack.
    fn orbit(&self) -> TleOrbit {
        let text = format!("{}\n{}\n", with_checksum(&self.line1), with_checksum(&self.line2));
        tle::parse("set", &text).unwrap()[0].orbit().unwrap()
    }
}

/// Distances from a state in km and km/s.
fn distance(orbit: &TleOrbit, minutes: f64, truth: &[f64]) -> (f64, f64) {
    let state = orbit.teme_after(minutes).unwrap();
    let (position, velocity) = (DVec3::from_slice(truth), DVec3::from_slice(&truth[3..]));
    ((state.position_m / 1e3 - position).length(), (state.velocity_m_s / 1e3 - velocity).length())
}

/// Truth: Vallado, Crawford, Hujsak, Kelso 2006 (AIAA 2006-6753), the verification set and its output, printed to 1e-8 km and
/// 1e-9 km/s: half of that rounding in each of three axes is 9e-9 km and 9e-10 km/s. Promised are 1e-6 km and held here is
/// 1e-8 km, but for the one run of 1.8 million minutes (3.5 years), where the time itself is rounded to 2e-10 min of a fall
/// at 10 km/s: 2e-7 km. That output was made in the published code's improved mode `i`; object 23599 is where mode `a`, which
/// we use, differs.
#[test]
fn the_verification_set() {
    let (mut rows, mut worst_km, mut worst_km_s) = (0, 0.0_f64, 0.0_f64);
    for run in runs() {
        let orbit = run.orbit();
        let number = orbit.tle().norad_id;
        for row in &run.rows {
            let minutes = row[0];
            // Asserted for itself below.
            if (number == 23599 && minutes > 410.0) || number == 33334 {
                continue;
            }
            let (km, km_s) = distance(&orbit, minutes, &row[1..]);
            let far = minutes.abs() > 1e6;
            assert!(km < if far { 3e-7 } else { 1e-8 }, "{number} at {minutes} min: {km:e} km");
            assert!(km_s < 1e-9, "{number} at {minutes} min: {km_s:e} km/s");
            if !far {
                worst_km = worst_km.max(km);
                worst_km_s = worst_km_s.max(km_s);
            }
            rows += 1;
        }
    }
    assert_eq!(rows, 667 - 16 - 1);
    println!("{rows} states: at most {worst_km:.1e} km and {worst_km_s:.1e} km/s");
}

/// The set's expected failures, with the numbers that the published code prints (python-sgp4 2.27, tests.py: mean
/// eccentricity −0.001329 and −0.001208, radius 0.996159, 0.996252 and 0.830534 Earth radii, perturbed eccentricity
/// −122.217193), at the same minute.
#[test]
fn the_expected_failures() {
    let mut failures = Vec::new();
    for run in runs() {
        let orbit = run.orbit();
        let (mut minutes, mut failure) = (run.start, None);
        while failure.is_none() && minutes <= run.stop {
            failure = orbit.teme_after(minutes).err().map(|cause| (minutes, cause));
            minutes += run.step;
        }
        if let Some((minutes, cause)) = failure {
            // What was published ends there, too; of 33334 a line for minute 0 was printed before the error was looked at.
            let last = run.rows.last().unwrap()[0];
            assert!(last < minutes || orbit.tle().norad_id == 33334, "{last} {minutes}");
            failures.push((orbit.tle().norad_id, minutes, cause));
        }
    }
    let earth = 6378.135;
    let expected = [
        (22312, 494.202_867_2, DecayCause::MeanEccentricity(-0.001_329)),
        (28350, 1560.0, DecayCause::MeanEccentricity(-0.001_208)),
        (28872, 55.0, DecayCause::BelowSurface(0.996_159 * earth)),
        (29141, 440.0, DecayCause::BelowSurface(0.996_252 * earth)),
        (33333, 25.0, DecayCause::SemiLatusRectum),
        (33334, 0.0, DecayCause::PerturbedEccentricity(-122.217_193)),
        (20413, 1_844_345.0, DecayCause::BelowSurface(0.830_534 * earth)),
    ];
    assert_eq!(failures.len(), expected.len(), "{failures:?}");
    for (found, expected) in failures.iter().zip(&expected) {
        assert_eq!(found.0, expected.0);
        assert!((found.1 - expected.1).abs() < 1e-6, "{found:?}");
        match (found.2, expected.2) {
            (DecayCause::MeanEccentricity(a), DecayCause::MeanEccentricity(b))
            | (DecayCause::PerturbedEccentricity(a), DecayCause::PerturbedEccentricity(b)) => {
                assert!((a - b).abs() < 1e-6, "{found:?}");
            }
            (DecayCause::BelowSurface(a), DecayCause::BelowSurface(b)) => {
                assert!((a - b).abs() < 0.006, "{found:?}, {b}");
            }
            (a, b) => assert_eq!(a, b),
        }
    }
}

/// Truth: the published code itself in its mode `a` (python-sgp4 2.27, Vallado's C++), 17 digits: every state of the set to
/// 1e-8 km, 23599 included, and every failure with the same code at the same minute.
#[test]
fn the_published_code_in_the_same_mode() {
    let path = fixture("orbits/afspc.ecsv");
    let table = ecsv::read(&path).unwrap();
    let column = |name: &str| table.f64(name).unwrap().into_owned();
    let (run_of, minutes, errors) = (column("run"), column("minutes"), column("error"));
    let axes: Vec<Vec<f64>> =
        ["x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s"].map(column).to_vec();
    let orbits: Vec<TleOrbit> = runs().iter().map(Run::orbit).collect();
    let mut worst = 0.0_f64;
    for row in 0..table.rows() {
        let orbit = &orbits[run_of[row] as usize];
        if errors[row] != 0.0 {
            let code = match orbit.teme_after(minutes[row]).unwrap_err() {
                DecayCause::MeanEccentricity(_) => 1.0,
                DecayCause::PerturbedEccentricity(_) => 3.0,
                DecayCause::SemiLatusRectum => 4.0,
                DecayCause::BelowSurface(_) => 6.0,
                _ => 0.0,
            };
            assert_eq!(code, errors[row], "run {} at {}", run_of[row], minutes[row]);
            continue;
        }
        let truth: Vec<f64> = axes.iter().map(|axis| axis[row]).collect();
        let (km, km_s) = distance(orbit, minutes[row], &truth);
        let far = minutes[row] > 1e6;
        assert!(
            km < if far { 3e-7 } else { 1e-8 },
            "run {} at {}: {km:e}",
            run_of[row],
            minutes[row]
        );
        assert!(km_s < if far { 3e-10 } else { 1e-11 }, "run {}: {km_s:e}", run_of[row]);
        worst = if far { worst } else { worst.max(km) };
    }
    assert!(table.rows() > 660);
    println!("{} states: at most {worst:.1e} km", table.rows());
}

/// 23599 (period 322 min, inclination 6.9°: Lyddane's choice) from 420 min on: the node has just passed 0°. Mode `a` counts
/// it from 360° downwards, mode `i`, in which the set was printed, from 0° to negative angles; Lyddane's formula holds the
/// node itself, not its sine, and gives another mean longitude: 0.9 km along the track. Before, the modes agree.
#[test]
fn object_23599_differs_where_its_node_passes_zero() {
    let runs = runs();
    let run = runs.iter().find(|r| r.line1.contains("23599U")).unwrap();
    let orbit = run.orbit();
    for row in &run.rows {
        let (km, _) = distance(&orbit, row[0], &row[1..]);
        if row[0] > 410.0 {
            assert!((0.2..1.0).contains(&km), "{} min: {km} km", row[0]);
        } else {
            assert!(km < 1e-8, "{} min: {km} km", row[0]);
        }
    }
}

/// 11801 and 88888 are elements of 1980 without an ephemeris type or a designator: the reader of the `sgp4` crate refuses
/// 11801 ("Parsing an integer field failed"), ours reads them. 33333, 33334 and 33335 were changed by hand without their
/// checksums: ours refuses them, and says what the sums are.
#[test]
fn what_the_set_cannot_parse() {
    for run in runs() {
        let text = format!("{}\n{}\n", run.line1, run.line2);
        let crates = sgp4::Elements::from_tle(None, run.line1.as_bytes(), run.line2.as_bytes());
        match (tle::parse("set", &text), &run.line1[2..7]) {
            (Err(error), number @ ("33333" | "33334" | "33335")) => {
                let sum = if number == "33333" {
                    2
                } else if number == "33334" {
                    6
                } else {
                    3
                };
                let expected = format!("expected {sum}, the checksum");
                assert!(error.to_string().contains(&expected), "{error}");
                assert_eq!(error.line, Some(1));
            }
            (Ok(sets), number) => {
                assert!(!number.starts_with("3333"));
                assert_eq!(crates.is_err(), number == "11801");
                if number == "11801" {
                    assert_eq!(sets[0].international_designator, None);
                    assert_eq!(format_utc(sets[0].epoch, 6), "1980-08-17T07:06:40.136832Z");
                }
            }
            (Err(error), _) => panic!("{error}"),
        }
    }
}

/// Truth: the same published states, from the second half of each run's rows on: an orbit that was made ready for that stretch has them as
/// well, with the same tolerances; also for times before the stretch, which it was not made ready for, and on the other side of the elements.
#[test]
fn an_orbit_that_is_ready_for_a_stretch_is_the_same_orbit() {
    let mut resonant = 0;
    for run in runs() {
        let orbit = run.orbit();
        let number = orbit.tle().norad_id;
        let at = |minutes: f64| orbit.tle().epoch + minutes * hifitime::Unit::Minute;
        let (Some(middle), Some(last)) = (run.rows.get(run.rows.len() / 2), run.rows.last()) else {
            continue;
        };
        if middle[0].abs() > 1e8 || number == 23599 || number == 33334 {
            continue;
        }
        let near = orbit.near(at(middle[0]), at(last[0]));
        resonant += usize::from(near != orbit);
        for row in &run.rows {
            let (km, km_s) = distance(&near, row[0], &row[1..]);
            let far = row[0].abs() > 1e6;
            assert!(km < if far { 3e-7 } else { 1e-8 }, "{number} at {} min: {km:e} km", row[0]);
            assert!(km_s < 1e-9, "{number} at {} min: {km_s:e} km/s", row[0]);
        }
    }
    assert!(resonant >= 5, "{resonant}");
}
