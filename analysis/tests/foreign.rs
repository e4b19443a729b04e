//! Periods of curves as others hand them in: several passes without a range, filters, several objects, rows twice, words for missing magnitudes. All are synthetic: a body's light is a rectified cosine with an exponential, which is no
//! sum of a few harmonics.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_analysis::curves::{Curves, CurvesError};
use sunglint_analysis::period::verdict::Outcome;
use sunglint_analysis::period::{FoundPeriod, PeriodOptions, find_period};
use sunglint_analysis::series::Series;
use sunglint_analysis::sessions::{self, Session, search};
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::light_curve::published::{MagnitudeOptions, ObjectRows, PublishedError};

/// A folder of its own, taken away at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("sunglint-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Magnitude of the body at a part of a turn: two unlike humps and an exponential of a sine, about 1 mag in all.
fn magnitude(turns: f64) -> f64 {
    let (sin, hump) = (std::f64::consts::TAU * turns).sin_cos();
    let humps = 0.7 * hump.max(0.0).powf(1.5) + 0.35 * (-hump).max(0.0).powf(1.5);
    7.0 - humps - 0.12 * sin.exp()
}

struct Noise(Random, Normal<f64>);

impl Noise {
    fn new(seed: u64, sigma: f64) -> Self {
        Self(Random::seed_from_u64(seed), Normal::new(0.0, sigma).unwrap())
    }

    fn next(&mut self) -> f64 {
        self.1.sample(&mut self.0)
    }
}

/// Times of day 0 + `s` as a modified Julian date (UTC), good to a microsecond.
fn mjd(s: f64) -> String {
    format!("{:.11}", 60_374.75 + s / 86_400.0)
}

fn read(paths: &[PathBuf], options: &MagnitudeOptions) -> Result<Curves, CurvesError> {
    Curves::read(paths, options, &[])
}

fn found(curves: Curves) -> FoundPeriod {
    found_with(curves, &PeriodOptions::default())
}

fn found_with(curves: Curves, options: &PeriodOptions) -> FoundPeriod {
    #[derive(Debug)]
    struct Failed(#[allow(dead_code, reason = "shown where a test fails")] String);
    impl From<sunglint_analysis::period::PeriodError> for Failed {
        fn from(e: sunglint_analysis::period::PeriodError) -> Self {
            Self(e.to_string())
        }
    }
    impl From<sunglint_analysis::series::SeriesError> for Failed {
        fn from(e: sunglint_analysis::series::SeriesError) -> Self {
            Self(e.to_string())
        }
    }
    find_period::<Failed>(curves, options, None, &Silent).unwrap()
}

fn asked(paths: &[PathBuf]) -> FoundPeriod {
    found(read(paths, &MagnitudeOptions::default()).unwrap())
}

/// One pass of six minutes of a day, 0.7 s a step.
fn pass(day: f64, period_s: f64, zero: f64, seed: u64) -> Vec<(f64, f64)> {
    let mut noise = Noise::new(seed, 0.03);
    (0..510)
        .map(|i| {
            let t = 0.7 * f64::from(i);
            (86_400.0 * day + t, zero + magnitude(0.13 * day + t / period_s) + noise.next())
        })
        .collect()
}

fn text(rows: &[(f64, f64)]) -> String {
    let mut text = String::from("# synthetic\nmjd_utc,mag\n");
    for (t, m) in rows {
        let _ = writeln!(text, "{},{m:.4}", mjd(*t));
    }
    text
}

/// Truth: the period that was put in, 18.83 s, the same in four passes of six minutes on four days, a file each and no range: passes of a near body, whose turns in between nobody counts. Joined as nights, the search
/// begins above it: the answer is no single other period. Tolerance: 3 σ as stated.
#[test]
fn passes_without_a_range_stay_apart() {
    let folder = Folder::new("passes-apart");
    let days = [0.0, 1.03, 2.05, 3.09];
    let all: Vec<Vec<(f64, f64)>> = days
        .iter()
        .enumerate()
        .map(|(k, day)| pass(*day, 18.83, 0.3 * k as f64, 40 + k as u64))
        .collect();
    let files: Vec<PathBuf> = all
        .iter()
        .enumerate()
        .map(|(k, rows)| folder.write(&format!("q{k}.csv"), &text(rows)))
        .collect();
    let curves = read(&files, &MagnitudeOptions::default()).unwrap();
    assert!(!curves.are_sessions());
    let found = found(curves);
    let best = found.verdict.best.unwrap();
    assert!((best.period_s - 18.83).abs() < 3.0 * best.sigma_s, "{best:?}");
    assert!(best.sigma_s > 1e-4 && best.sigma_s < 0.01, "{best:?}");
    let tracks = found.tracks.unwrap();
    assert!(tracks.periods.len() == 4 && !tracks.differ(), "{tracks:?}");
    let nights: Vec<Session> = all
        .iter()
        .map(|rows| Session {
            time_s: rows.iter().map(|r| r.0).collect(),
            magnitude: rows.iter().map(|r| r.1).collect(),
            ..Session::default()
        })
        .collect();
    let joined = search(&nights, &sessions::Options::default(), &Silent).unwrap();
    let holds = joined.members.iter().any(|m| (m.period_s / 18.83 - 1.0).abs() < 0.01);
    assert!(joined.searched_s.unwrap().low > 18.83 * 1.5, "{:?}", joined.searched_s);
    assert!(joined.verdict == sessions::Outcome::NotDecided || holds, "{joined:?}");
}

/// Truth: periods that were put in, 18.83 to 18.95 s in four passes: no one period. The stated uncertainty holds all, and it is said. One file with ranges of 900 km and one a pass without them alike.
#[test]
fn passes_that_differ_are_told() {
    let folder = Folder::new("passes-differ");
    let periods = [18.83, 18.87, 18.91, 18.95];
    let mut one = String::from("# synthetic\nmjd_utc,mag,range_km\n");
    let mut files = Vec::new();
    for (k, period_s) in periods.iter().enumerate() {
        let rows = pass(1.03 * k as f64, *period_s, 0.0, 60 + k as u64);
        for (t, m) in &rows {
            let _ = writeln!(one, "{},{m:.4},900", mjd(*t));
        }
        files.push(folder.write(&format!("p{k}.csv"), &text(&rows)));
    }
    let one = vec![folder.write("one.csv", &one)];
    for paths in [one, files] {
        let found = asked(&paths);
        let best = found.verdict.best.unwrap();
        for period_s in periods {
            assert!((best.period_s - period_s).abs() < best.sigma_s + 0.01, "{best:?}");
        }
        assert!(best.sigma_s < 0.2, "{best:?}");
        let tracks = found.tracks.as_ref().unwrap();
        assert!(tracks.periods.len() == 4 && tracks.differ(), "{tracks:?}");
        for (own, period_s) in tracks.periods.iter().zip(periods) {
            let e = own.estimate;
            assert!((e.period_s - period_s).abs() < 5.0 * e.sigma_s, "{own:?}");
        }
        assert!(found.warnings.iter().any(|w| w.contains("changes from track to track")));
    }
}

/// Truth: a constant body through a wheel of two filters, 30 s each, 0.6 mag apart: it has no period, and the wheel's is none. A body that turns in 41.7 s through the same wheel has that one.
#[test]
fn a_filter_wheel_is_no_period() {
    let folder = Folder::new("wheel");
    for turning in [false, true] {
        let mut noise = Noise::new(7, 0.05);
        let mut text = String::from("# synthetic\nmjd_utc,mag,filter\n");
        for i in 0..600 {
            let t = 3.0 * f64::from(i);
            let red = (t / 30.0) as u32 % 2;
            let body = if turning { magnitude(t / 41.7) } else { 8.0 };
            let m = body + 0.6 * f64::from(red) + noise.next();
            let _ = writeln!(text, "{},{m:.4},{}", mjd(t), ["V", "R"][red as usize]);
        }
        let path = folder.write("wheel.csv", &text);
        let found = asked(std::slice::from_ref(&path));
        let names: Vec<&str> = found.series.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["R", "V"]);
        match &found.verdict.outcome {
            Outcome::NotEnough(_) => assert!(!turning, "{:?}", found.verdict),
            Outcome::One(e) => assert!(turning && (e.period_s - 41.7).abs() < 0.2, "{e:?}"),
            Outcome::Family(all) => {
                assert!(turning, "{all:?}");
                assert!(all.iter().any(|m| (m.estimate.period_s - 41.7).abs() < 0.2), "{all:?}");
            }
            _ => panic!("{:?}", found.verdict.outcome),
        }
        let only = Curves::read(&[path], &MagnitudeOptions::default(), &["R".into()]).unwrap();
        assert_eq!(only.series().unwrap().len(), 1);
    }
}

/// Truth: the rows: 300 of one object and 200 of another. Refused with both names; each alone is read.
#[test]
fn several_objects_are_refused() {
    let folder = Folder::new("objects");
    let mut noise = Noise::new(8, 0.05);
    let mut text = String::from("# synthetic\nmjd_utc,mag,object\n");
    for i in 0..500 {
        let (t, name) = (f64::from(i), if i < 300 { "SAT A" } else { "SAT B" });
        let _ = writeln!(text, "{},{:.4},{name}", mjd(t), magnitude(t / 21.0) + noise.next());
    }
    let paths = [folder.write("two.csv", &text)];
    let refused = read(&paths, &MagnitudeOptions::default()).unwrap_err();
    let words = refused.to_string();
    assert!(matches!(refused, CurvesError::Published(PublishedError::Objects { .. })), "{words}");
    assert!(words.contains("SAT A (300 rows), SAT B (200 rows)"), "{words}");
    for (name, n) in [("SAT A", 300), ("SAT B", 200)] {
        let options = MagnitudeOptions { rows: ObjectRows::Of(name.into()), ..Default::default() };
        assert_eq!(read(&paths, &options).unwrap().curves[0].curve.len(), n);
    }
    let options = MagnitudeOptions { rows: ObjectRows::Of("SAT C".into()), ..Default::default() };
    assert!(read(&paths, &options).unwrap_err().to_string().contains("SAT A (300 rows)"));
}

/// Truth: every row once says all that every row twice says: the same verdict to the bit.
#[test]
fn rows_twice_say_nothing_new() {
    let folder = Folder::new("twice");
    let rows = pass(0.0, 18.83, 0.0, 5);
    let twice: Vec<(f64, f64)> = rows.iter().flat_map(|r| [*r, *r]).collect();
    let once = asked(&[folder.write("once.csv", &text(&rows))]);
    let twice = asked(&[folder.write("twice.csv", &text(&twice))]);
    assert_eq!(once.verdict, twice.verdict);
    let said = twice.warnings.iter().any(|w| w.contains("510 rows given twice"));
    assert!(said, "{:?}", twice.warnings);
}

/// Truth: the period that was put in, 18.83 s; 2 % of the magnitudes are words for a missing one. The same answer as where those rows are not there at all, to a tenth of its uncertainty (the level of the light about a sample, which weighs it, is taken over other
/// neighbours).
#[test]
fn words_for_missing_magnitudes_are_none() {
    let folder = Folder::new("words");
    let rows = pass(0.0, 18.83, 0.0, 6);
    let is_lost = |i: usize| i % 50 == 7;
    let kept: Vec<(f64, f64)> =
        rows.iter().enumerate().filter(|(i, _)| !is_lost(*i)).map(|(_, r)| *r).collect();
    let truth = asked(&[folder.write("kept.csv", &text(&kept))]).verdict;
    for word in [99.99, -9.99, 0.0, -99.0] {
        let all: Vec<(f64, f64)> = rows
            .iter()
            .enumerate()
            .map(|(i, r)| if is_lost(i) { (r.0, word) } else { *r })
            .collect();
        let found = asked(&[folder.write("words.csv", &text(&all))]);
        let (a, b) = (found.verdict.best.unwrap(), truth.best.unwrap());
        assert!((a.period_s - b.period_s).abs() < 0.1 * b.sigma_s, "{word}: {a:?} {b:?}");
        assert!((a.sigma_s / b.sigma_s - 1.0).abs() < 0.05, "{word}: {a:?} {b:?}");
        assert!(found.warnings.iter().any(|w| w.contains("11 magnitudes are words")), "{word}");
    }
    // Differences about 0 are none of these words.
    let about_0: Vec<(f64, f64)> =
        rows.iter().map(|r| (r.0, ((r.1 - 6.6) * 10.0).round() / 10.0)).collect();
    let found = asked(&[folder.write("about.csv", &text(&about_0))]);
    assert_eq!(found.series[0].len(), rows.len());
}

/// Truth: the catalogue's own columns: samples in the penumbra are no light of the body alone, and a range of 0 is none.
#[test]
fn the_penumbra_and_ranges_of_0_are_left_out() {
    let folder = Folder::new("penumbra");
    let rows = pass(0.0, 18.83, 0.0, 9);
    let mut text = String::from(
        "# synthetic\n# Date Time StdMag Mag Filter Penumbra Distance Phase Channel Track\n",
    );
    for (i, (t, m)) in rows.iter().enumerate() {
        let (dark, range_km) = (u8::from(i >= 450), if i % 50 == 3 { 0.0 } else { 900.0 });
        let m = m + if i >= 450 { 0.05 * (i - 450) as f64 } else { 0.0 };
        let _ = writeln!(
            text,
            "2024-03-05 18:{:02}:{:09.6} {m:.3} {m:.4} Clear {dark} {range_km:.1} 50.2 3 999",
            (t / 60.0) as u32,
            t % 60.0
        );
    }
    let curves = read(&[folder.write("track.txt", &text)], &MagnitudeOptions::default()).unwrap();
    let series: Vec<Series> = curves.series().unwrap();
    // Of the first 450 samples nine have no range, of the others two.
    assert_eq!((series[0].len(), series[0].left_out.flagged), (441, 58));
    let found = found(curves);
    assert!(found.warnings.iter().any(|w| w.contains("60 samples are in the Earth's shadow")));
    assert!(found.warnings.iter().any(|w| w.contains("11 samples have a range of 0")));
    let best = found.verdict.best.unwrap();
    assert!((best.period_s - 18.83).abs() < 3.0 * best.sigma_s, "{best:?}");
}

fn series(name: &str, time: &[f64], value: &[f64], exposure_s: f64) -> Series {
    let mut series = Series::new(name, time, value, None).unwrap();
    series.exposure_s = exposure_s;
    series
}

fn verdict(series: &Series) -> sunglint_analysis::period::Verdict {
    sunglint_analysis::period::verdict(
        std::slice::from_ref(series),
        &sunglint_analysis::period::Options::default(),
    )
    .unwrap()
}

fn holds(outcome: &Outcome, period_s: f64) -> bool {
    match outcome {
        Outcome::One(e) => (e.period_s / period_s - 1.0).abs() < 2e-3,
        Outcome::Family(all) => {
            all.iter().any(|m| (m.estimate.period_s / period_s - 1.0).abs() < 2e-3)
        }
        _ => false,
    }
}

/// Truth: periods that were put in, below two steps of the even samples, with exposures of a fiftieth of a step: what is seen is another period, and the truth is in the family. The same samples with exposures that are not known are
/// presumed to be full, and that is said.
#[test]
fn even_samples_of_short_exposures_do_not_hide_a_faster_period() {
    for (step, period_s) in [(5.0, 4.87), (2.0, 3.71), (2.0, 2.913), (1.0, 0.9513)] {
        let mut noise = Noise::new(31, 0.02);
        let time: Vec<f64> = (0..600).map(|i| step * f64::from(i)).collect();
        let value: Vec<f64> =
            time.iter().map(|t| 10.0 - magnitude(t / period_s) + noise.next()).collect();
        let found = verdict(&series("c", &time, &value, 0.02 * step));
        assert!(!matches!(found.outcome, Outcome::One(_)), "{period_s}: {:?}", found.outcome);
        let refused = matches!(found.outcome, Outcome::NotEnough(_));
        assert!(refused || holds(&found.outcome, period_s), "{period_s}: {:?}", found.outcome);
        let unknown = verdict(&series("c", &time, &value, 0.0)).folding;
        assert!(refused || unknown.is_some_and(|f| f.exposure_s.is_none()), "{unknown:?}");
    }
}

/// Truth: the period that was put in, 73 steps of even samples: nothing shorter is an answer. Exposures that fill the step, or that are not known, leave it alone; so do exposures of a fifth of a step, as the body's seven harmonics would be averaged away at f_s ± f.
#[test]
fn even_samples_of_slow_bodies_have_one_period() {
    let mut noise = Noise::new(32, 0.02);
    let time: Vec<f64> = (0..2000).map(|i| 0.1 * f64::from(i)).collect();
    let lobe = |turn: f64, at: f64, width: f64| {
        (width * ((std::f64::consts::TAU * (turn - at)).cos() - 1.0)).exp()
    };
    let light = |t: f64| 1.0 + lobe(t / 7.3, 0.2, 20.0) + 0.5 * lobe(t / 7.3, 0.6, 35.0);
    let value: Vec<f64> = time.iter().map(|t| light(*t) + noise.next()).collect();
    for exposure_s in [0.1, 0.0, 0.03] {
        let found = verdict(&series("c", &time, &value, exposure_s));
        let e = found.best.unwrap();
        assert!((e.period_s - 7.3).abs() < 4.0 * e.sigma_s, "{e:?}");
        if let Outcome::Family(all) = &found.outcome {
            assert!(all.iter().all(|m| m.estimate.period_s > 7.2), "{exposure_s}: {all:?}");
        }
    }
}

/// Truth: two frequencies that were put in, without a common period: neither one period nor a family without both is the answer. Tolerance of the two: 1 %. A body of one period with many harmonics is not taken for two.
#[test]
fn two_periods_at_once_are_no_single_one() {
    for (a, b, beat) in [
        (17.1, 30.7, 0.0),
        (17.1, 30.7, 0.1),
        (23.7, 40.9, 0.15),
        (13.3, 47.9, 0.1),
        (12.0, 50.0, 0.0),
        (12.0, 31.0, 0.3),
    ] {
        let mut noise = Noise::new(33, 0.03);
        let time: Vec<f64> = (0..900).map(|i| 0.7 * f64::from(i) + 0.1 * noise.next()).collect();
        let value: Vec<f64> = time
            .iter()
            .map(|t| {
                let (p, q) = (std::f64::consts::TAU * t / a, std::f64::consts::TAU * t / b);
                let light = 0.4 * p.sin() + 0.35 * (q + 1.0).sin() + beat * (p + q).sin();
                10.0 + light + noise.next()
            })
            .collect();
        let found = verdict(&series("c", &time, &value, 0.1));
        match &found.outcome {
            Outcome::Two(one, other) => {
                let near = |e: f64, truth: f64| (e / truth - 1.0).abs() < 0.01;
                let (p, q) = (one.period_s, other.period_s);
                assert!(near(p.min(q), a) && near(p.max(q), b), "{a} {b}: {one:?} {other:?}");
            }
            Outcome::Family(_) if holds(&found.outcome, a) && holds(&found.outcome, b) => {}
            // 9 : 5, of a common period with four turns; and 1 : 4 but for two turns.
            Outcome::NotEnough(_) if [17.1, 12.0].contains(&a) => {}
            other => panic!("{a} {b}: {other:?}"),
        }
    }
    // Two opposite glints of one body, each seen for a half of the data: not two periods.
    for period_s in [9.5, 12.1, 19.3] {
        let mut noise = Noise::new(36, 0.02);
        let time: Vec<f64> = (0..1600).map(|i| 0.25 * f64::from(i)).collect();
        let value: Vec<f64> = time
            .iter()
            .map(|t| {
                let turn = std::f64::consts::TAU * t / period_s;
                let glint = |at: f64| (60.0 * ((turn - at).cos() - 1.0)).exp();
                let seen = 1.0 / (1.0 + ((t - 200.0) / 10.0).exp());
                10.0 - 1.5 * (seen * glint(0.0) + (1.0 - seen) * glint(std::f64::consts::PI))
                    + noise.next()
            })
            .collect();
        let found = verdict(&series("c", &time, &value, 0.1));
        let right = holds(&found.outcome, period_s) || holds(&found.outcome, 0.5 * period_s);
        let refused = matches!(found.outcome, Outcome::NotEnough(_));
        let wide = found.drift_turns > 0.0
            && found.best.is_some_and(|e| (e.period_s - period_s).abs() < 3.0 * e.sigma_s);
        assert!(right || refused || wide, "{period_s}: {:?}", found.outcome);
    }
    // One period whose light changes over the data, by half a wave and by a whole one.
    for turns in [0.5, 1.0] {
        let mut noise = Noise::new(35, 0.03);
        let time: Vec<f64> = (0..900).map(|i| 0.7 * f64::from(i) + 0.1 * noise.next()).collect();
        let value: Vec<f64> = time
            .iter()
            .map(|t| {
                let p = std::f64::consts::TAU * t / 19.3;
                let grows = 1.0 + 0.6 * (std::f64::consts::TAU * turns * t / 630.0).sin();
                10.0 + grows * (0.3 * p.sin() + 0.2 * (2.0 * p + 0.4).sin()) + noise.next()
            })
            .collect();
        let found = verdict(&series("c", &time, &value, 0.1));
        assert!(holds(&found.outcome, 19.3), "{turns}: {:?}", found.outcome);
    }
    let mut noise = Noise::new(34, 0.01);
    let time: Vec<f64> = (0..900).map(|i| 0.7 * f64::from(i) + 0.1 * noise.next()).collect();
    let value: Vec<f64> = time
        .iter()
        .map(|t| {
            let turn = std::f64::consts::TAU * t / 61.0;
            (60.0 * (turn.cos() - 1.0)).exp() + 0.4 * (90.0 * ((turn - 2.0).cos() - 1.0)).exp()
        })
        .map(|v| v + noise.next())
        .collect();
    let found = verdict(&series("c", &time, &value, 0.1));
    assert!(found.harmonics >= 10, "{}", found.harmonics);
    assert!(holds(&found.outcome, 61.0), "{:?}", found.outcome);
}

/// Truth: the period that was put in, 18.83 s, with its uncertainty without outliers; 2 % of the samples are 3 mag too bright or too faint. Tolerance: twice that uncertainty, and 3 σ. Glints of one sample that come again are not left out.
#[test]
fn samples_that_stand_alone_are_left_out() {
    let folder = Folder::new("alone");
    let rows = pass(0.0, 18.83, 0.0, 21);
    let clean = asked(&[folder.write("clean.csv", &text(&rows))]).verdict.best.unwrap();
    let mut random = Noise::new(77, 1.0);
    let wrong: Vec<(f64, f64)> = rows
        .iter()
        .map(|(t, m)| match random.next() {
            x if x > 2.2 => (*t, m - 3.0),
            x if x < -2.4 => (*t, m + 3.0),
            _ => (*t, *m),
        })
        .collect();
    let changed = rows.iter().zip(&wrong).filter(|(a, b)| a != b).count();
    assert!((6..25).contains(&changed), "{changed}");
    let found = asked(&[folder.write("wrong.csv", &text(&wrong))]);
    let best = found.verdict.best.unwrap();
    assert!(found.warnings.iter().any(|w| w.contains("alone, far from")), "{:?}", found.warnings);
    assert!(best.sigma_s < 2.0 * clean.sigma_s, "{best:?} {clean:?}");
    assert!((best.period_s - 18.83).abs() < 3.0 * best.sigma_s, "{best:?}");
    let glints: Vec<(f64, f64)> = rows
        .iter()
        .map(|(t, m)| {
            let turn = t / 18.83 - 0.41;
            (*t, if turn - turn.floor() < 0.7 / 18.83 { m - 3.0 } else { *m })
        })
        .collect();
    let found = asked(&[folder.write("glints.csv", &text(&glints))]);
    assert_eq!(found.series[0].len(), rows.len(), "{:?}", found.warnings);
}

/// Truth: the period that was put in, 61.3 s, in 150,000 samples over two and a half hours: their means tell it as well, and what they cannot tell is said.
#[test]
fn many_samples_are_put_together() {
    let folder = Folder::new("many");
    let mut noise = Noise::new(35, 0.05);
    let mut rows = Vec::new();
    let mut t = 0.0;
    for _ in 0..150_000 {
        // Steps of 0.01 to 0.11 s.
        t += 0.06 * (1.0 + 16.0 * noise.next()).clamp(0.2, 1.8);
        rows.push((t, magnitude(t / 61.3) + noise.next()));
    }
    let curves = read(&[folder.write("many.csv", &text(&rows))], &MagnitudeOptions::default());
    // Periods above 20 s: those below are three quarters of the work.
    let mut options = PeriodOptions::default();
    options.search.shortest_s = Some(20.0);
    let found = found_with(curves.unwrap(), &options);
    assert!(holds(&found.verdict.outcome, 61.3), "{:?}", found.verdict.outcome);
    assert!(found.warnings.iter().any(|w| w.contains("150000 samples are put together")));
    assert!(found.series[0].len() < 60_000, "{}", found.series[0].len());
}

/// Truth: how the light was made: one value, 8.125 mag, with noise of 3 mmag, rounded to 0.01 mag (levels 8.12 and 8.13 and few beside). Uncertainties that the file says, or none. It is constant, for the reason of its
/// rounding, on 20 of 20 seeds. The same noise with four digits is not said to be rounded; a body of 1 mag rounded to 0.1 mag has its period.
#[test]
fn light_that_rounding_hides_is_constant() {
    let folder = Folder::new("rounded");
    let curve = |places: usize, with_sigma: bool, light: &mut dyn FnMut(f64) -> f64| {
        let mut text =
            format!("# synthetic\nmjd_utc,mag{}\n", if with_sigma { ",sigma_mag" } else { "" });
        for i in 0..300 {
            let (t, end) = (f64::from(i), if with_sigma { ",0.01" } else { "" });
            let _ = writeln!(text, "{},{:.places$}{end}", mjd(t), light(t));
        }
        [folder.write("curve.csv", &text)]
    };
    for seed in 0..20 {
        for with_sigma in [false, true] {
            let mut noise = Noise::new(900 + seed, 0.003);
            let paths = curve(2, with_sigma, &mut |_| 8.125 + noise.next());
            // Where most neighbours are alike, no noise is known, and the file is refused with the same reason.
            let words = match read(&paths, &MagnitudeOptions::default()) {
                Err(refused) => refused.to_string(),
                Ok(curves) => {
                    let verdict = found(curves).verdict;
                    assert!(verdict.best.is_none(), "{seed}: {verdict:?}");
                    match verdict.outcome {
                        Outcome::NotEnough(reason) => reason.to_string(),
                        other => panic!("{seed}: {other:?}"),
                    }
                }
            };
            assert!(words.contains("light is constant") && words.contains("0.01 mag"), "{words}");
        }
        let mut noise = Noise::new(900 + seed, 0.003);
        let fine = asked(&curve(4, true, &mut |_| 8.125 + noise.next()));
        let Outcome::NotEnough(reason) = fine.verdict.outcome else { panic!("{seed}") };
        assert!(!reason.to_string().contains("constant"), "{reason}");
    }
    let same = curve(2, false, &mut |_| 8.12);
    let words = read(&same, &MagnitudeOptions::default()).unwrap_err().to_string();
    assert!(words.contains("300 rows of 8.12: constant light"), "{words}");
    let mut noise = Noise::new(11, 0.03);
    let turning = asked(&curve(1, true, &mut |t| magnitude(t / 18.83) + noise.next()));
    assert!(holds(&turning.verdict.outcome, 18.83), "{:?}", turning.verdict.outcome);
}

/// Rows of a body that turns in 1300 s, seen every 90 s, without uncertainties; `late` moves a sample's time.
fn slow(late: impl Fn(usize) -> f64) -> String {
    let mut noise = Noise::new(21, 0.02);
    let mut text = String::from("# synthetic\nmjd_utc,mag\n");
    for i in 0..150 {
        let t = 90.0 * i as f64 + late(i);
        let m = 12.0 + 0.5 * (std::f64::consts::TAU * t / 1300.0).sin() + noise.next();
        let _ = writeln!(text, "{},{m:.3}", mjd(t));
    }
    text
}

/// Truth: the period that was put in, 1300 s, of samples every 90 s without uncertainties, and of samples every 60 s but for 50 ms either way. Tolerance: 4 σ as stated. Where too few samples show their noise, the option that says it is named first.
#[test]
fn slow_samples_without_uncertainties_are_read() {
    let folder = Folder::new("slow");
    let minute = |i: usize| -30.0 * i as f64 + [0.05, -0.04, 0.0][i % 3];
    for text in [slow(|_| 0.0), slow(minute)] {
        let found = asked(&[folder.write("slow.csv", &text)]);
        assert_eq!(found.series[0].len(), 150);
        let best = found.verdict.best.unwrap();
        assert!(holds(&found.verdict.outcome, 1300.0), "{:?}", found.verdict.outcome);
        assert!((best.period_s - 1300.0).abs() < 4.0 * best.sigma_s, "{best:?}");
        let said = found.warnings.iter().any(|w| w.contains("own change between them counts"));
        assert!(said, "{:?}", found.warnings);
    }
    let few: String = slow(|_| 0.0).lines().take(7).fold(String::new(), |a, l| a + l + "\n");
    let refused = read(&[folder.write("few.csv", &few)], &MagnitudeOptions::default()).unwrap_err();
    let words = refused.to_string();
    assert!(words.contains("used: no uncertainties, and samples more than 270 s apart"), "{words}");
    assert!(words.contains("of 5 rows the longest track has 5 samples"), "{words}");
}

/// Truth: the period that was put in, 18.83 s, and the steps of 1e-5 d (0.864 s) to which Julian dates were rounded. It is said, and no period below two samples is looked for. Dates of eleven places are not called rounded.
#[test]
fn rounded_times_are_told() {
    let folder = Folder::new("rounded-times");
    let rows: Vec<(f64, f64)> =
        (0..400).map(|i| 2.0 * f64::from(i)).map(|t| (t, magnitude(t / 18.83))).collect();
    let of = |places: usize| {
        let mut noise = Noise::new(31, 0.03);
        let mut text = String::from("# synthetic\njd_utc,mag\n");
        for (t, m) in &rows {
            let _ =
                writeln!(text, "{:.places$},{:.4}", 2_460_375.25 + t / 86_400.0, m + noise.next());
        }
        text
    };
    for (places, is_told) in [(5, true), (9, false)] {
        let found = asked(&[folder.write("jd.csv", &of(places))]);
        let told = found.warnings.iter().any(|w| w.contains("times are rounded to 0.864 s"));
        assert_eq!(told, is_told, "{:?}", found.warnings);
        assert!(found.verdict.uneven.is_none(), "{:?}", found.verdict.uneven);
        assert!(holds(&found.verdict.outcome, 18.83), "{places}: {:?}", found.verdict.outcome);
    }
}
