//! Spins of near bodies over several passes, made up from directions alone.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::{DQuat, DVec3};
use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::TAU;
use sunglint_analysis::passes::{Kind, Pass, Sense, Spin, spin_over_passes};
use sunglint_analysis::period::verdict::Options;
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Bisectors;
use sunglint_testkit::Campaign;

const EARTH_M: f64 = 6_371_000.0;
const GM: f64 = 3.986_004_418e14;
const DAY_S: f64 = 86_400.0;

/// A made-up tumbling body (synthetic): a circular orbit, a station on a turning Earth, the Sun along the ecliptic. The body is a set of glossy directions that turn about an axis: its light depends on where the
/// bisector of Sun and station stands in the body, and on nothing else. No phase, longitude or period of what is seen is in it.
struct Made {
    passes: Vec<Pass>,
    axis: DVec3,
    frequency_hz: f64,
    /// Change of the frequency, Hz/s.
    rate: f64,
}

fn direction(random: &mut Random) -> DVec3 {
    let z = random.random_range(-1.0..1.0_f64);
    let (s, c) = (TAU * random.random::<f64>()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * c, r * s, z)
}

fn made(seed: u64) -> Made {
    let mut random = Random::seed_from_u64(seed);
    let random = &mut random;
    let normal = Normal::new(0.0, 1.0).unwrap();
    let height_m = 1e3 * random.random_range(400.0..1500.0);
    let a = EARTH_M + height_m;
    let motion = (GM / a.powi(3)).sqrt();
    let inclination = random.random_range(0.6..1.75_f64);
    let node = TAU * random.random::<f64>();
    let along = TAU * random.random::<f64>();
    let latitude = random.random_range(0.3..1.0_f64);
    let turn = TAU / 86_164.0905;
    let sun_at = TAU * random.random::<f64>();
    let place = |t: f64| {
        let (s, c) = (along + motion * t).sin_cos();
        let (sn, cn) = node.sin_cos();
        let (si, ci) = inclination.sin_cos();
        a * DVec3::new(c * cn - s * ci * sn, c * sn + s * ci * cn, s * si)
    };
    let station = |t: f64| {
        let (s, c) = (turn * t).sin_cos();
        let (sl, cl) = latitude.sin_cos();
        EARTH_M * DVec3::new(cl * c, cl * s, sl)
    };
    let sun = |t: f64| {
        let (s, c) = (sun_at + TAU * t / (365.25 * DAY_S)).sin_cos();
        DVec3::new(c, s * 0.917_5, s * 0.397_8)
    };
    let is_seen = |t: f64| {
        let (p, o, s) = (place(t), station(t), sun(t));
        let up = (p - o).normalize().dot(o.normalize());
        let dark = s.dot(o.normalize()) < -0.1;
        let lit = p.dot(s) > 0.0 || (p - s * p.dot(s)).length() > EARTH_M;
        up > 0.34 && dark && lit
    };
    let axis = direction(random);
    let period_s = 10_f64.powf(random.random_range(2_f64.log10()..120_f64.log10()));
    let frequency_hz = 1.0 / period_s;
    let drift_day = random.random_range(-1e-3..1e-3);
    let rate = -frequency_hz * drift_day / DAY_S;
    let normals: Vec<(DVec3, f64, f64)> = (0..random.random_range(3..6))
        .map(|_| (direction(random), random.random_range(0.2..1.0), random.random_range(2.0..12.0)))
        .collect();
    let noise = random.random_range(0.01..0.08);
    let wanted = random.random_range(3..=20);
    let step = (period_s / 40.0).clamp(0.1, 1.0);
    let mut windows = Vec::new();
    let mut t = 0.0;
    while t < 30.0 * DAY_S {
        if is_seen(t) {
            let from = t;
            while is_seen(t) {
                t += 10.0;
            }
            if t - from > 180.0_f64.max(8.0 * period_s) {
                windows.push((from, t));
            }
        }
        t += 20.0;
    }
    for i in 0..windows.len() {
        let other = random.random_range(i..windows.len());
        windows.swap(i, other);
    }
    windows.truncate(wanted);
    windows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let passes = windows
        .iter()
        .map(|(from, to)| {
            let zero = 10_f64.powf(random.random_range(-0.5..0.5));
            let n = ((to - from) / step) as usize;
            let mut moments = Vec::new();
            let (mut time, mut value) = (Vec::new(), Vec::new());
            for i in 0..n {
                let t = from + step * i as f64;
                let (p, o, s) = (place(t), station(t), sun(t));
                let to_observer = (o - p).normalize();
                let bisector = (s + to_observer).normalize();
                let angle = TAU * (frequency_hz * t + 0.5 * rate * t * t).fract();
                let body = DQuat::from_axis_angle(axis, -angle) * bisector;
                let light: f64 = normals
                    .iter()
                    .map(|(n, size, width)| size * (width * (n.dot(body) - 1.0)).exp())
                    .sum();
                time.push(t);
                value.push(zero * (0.2 + light + noise * normal.sample(random)));
                if i % 10 == 0 || i + 1 == n {
                    moments.push((t, s, to_observer));
                }
            }
            Pass {
                series: vec![Series::new("clear", &time, &value, None).unwrap()],
                path: Bisectors::new(&moments),
            }
        })
        .collect();
    Made { passes, axis, frequency_hz, rate }
}

fn truth(made: &Made, found: &Spin) -> (f64, f64) {
    let f = made.frequency_hz + made.rate * found.middle_s;
    (1.0 / f, -made.rate / (f * f))
}

/// Truth: period, drift and axis that the bodies were made with. Tolerance: intervals of 95 % hold period and drift in 90 % of the single answers at least (of a part of the campaign chance allows that), no more than 1 % of
/// the single answers lie off by more than 1 %, no sense that is told is wrong in more than 5 %.
#[test]
fn campaign_tumbling_bodies() {
    let mut campaign = Campaign::start("tumbling_bodies", 300);
    let (mut seen, mut single, mut family, mut without, mut wrong) = (0, 0, 0, 0, 0);
    let (mut period_held, mut drift_held, mut senses, mut senses_right) = (0, 0, 0, 0);
    for seed in campaign.seeds() {
        let made = made(seed);
        if made.passes.len() < 3 {
            continue;
        }
        seen += 1;
        let found = spin_over_passes(&made.passes, &Options::default()).unwrap();
        assert_eq!(found.kind, Kind::Sidereal);
        let (period_s, drift) = truth(&made, &found);
        let near = |p: f64| (p / period_s - 1.0).abs() < 0.01;
        match found.periods.as_slice() {
            [] => {}
            [one] => {
                single += 1;
                if !near(one.period_s) {
                    wrong += 1;
                    eprintln!("seed {seed}: wrong, truth {period_s}: {one:?}");
                    continue;
                }
                period_held += usize::from(one.interval_s.contains(period_s));
                drift_held += usize::from(one.drift_interval.contains(drift));
                if let Some(sense) = one.sense {
                    senses += 1;
                    let is_right = (made.axis.z > 0.0) == (sense == Sense::Prograde);
                    senses_right += usize::from(is_right);
                }
                eprintln!(
                    "seed {seed}: truth {period_s:.6}, found {:.6} in {:.6} to {:.6} ({}), drift {drift:.2e} in {:.2e} to {:.2e} ({}), {} passes, scatter {:.2}, sky {:.3}",
                    one.period_s,
                    one.interval_s.low,
                    one.interval_s.high,
                    one.interval_s.contains(period_s),
                    one.drift_interval.low,
                    one.drift_interval.high,
                    one.drift_interval.contains(drift),
                    one.passes.len(),
                    one.scatter,
                    one.sky_share.unwrap_or(1.0)
                );
            }
            several => {
                family += 1;
                if !several.iter().any(|m| near(m.period_s)) {
                    without += 1;
                }
            }
        }
    }
    eprintln!(
        "{seen} bodies with 3 passes or more: single {single}, of them wrong {wrong}; period in its interval {period_held}, drift {drift_held}, sense told {senses}, right {senses_right}; family {family}, without the truth {without}"
    );
    let good = single - wrong;
    assert!(100 * wrong <= single.max(99), "{wrong} of {single} wrong");
    assert!(10 * period_held >= 9 * good, "{period_held} of {good}");
    assert!(10 * drift_held >= 9 * good, "{drift_held} of {good}");
    assert!(20 * senses_right >= 19 * senses, "{senses_right} of {senses}");
    campaign.largest("bodies", f64::from(seen));
    campaign.largest("single", single as f64);
    campaign.largest("single_wrong", wrong as f64);
    campaign.largest("period_in_interval", period_held as f64);
    campaign.largest("drift_in_interval", drift_held as f64);
    campaign.largest("sense_told", f64::from(senses));
    campaign.largest("sense_right", senses_right as f64);
    campaign.largest("family", f64::from(family));
    campaign.largest("family_without", f64::from(without));
    campaign.finish();
}

/// Truth: without elements nobody knows how the bisector turned: whatever is found is called synodic, and no sense and no axis is told. One pass is refused with the number that is needed.
#[test]
fn without_elements_a_period_is_synodic() {
    for seed in [2, 5] {
        let mut made = made(seed);
        made.passes.iter_mut().for_each(|p| p.path = None);
        let found = spin_over_passes(&made.passes, &Options::default()).unwrap();
        assert_eq!(found.kind, Kind::Synodic);
        assert!(found.periods.iter().all(|p| p.sense.is_none() && p.axis.is_none()));
        let one = spin_over_passes(&made.passes[..1], &Options::default()).unwrap();
        assert!(one.reason.unwrap().ends_with("at least 2 are needed"));
    }
}
