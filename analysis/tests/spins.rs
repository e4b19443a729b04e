//! The spin of tumbling bodies over passes of weeks.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_analysis::series::Series;
use sunglint_analysis::spin::{
    Body, Interval, NoSpin, Spin, SpinFound, SpinOptions, SpinPass, by_pass, find_spin,
};
use sunglint_analysis::synodic::Bisectors;
use sunglint_testkit::Campaign;

const EARTH_M: f64 = 6_371_000.0;
const DAY_S: f64 = 86_400.0;
const LATITUDE: f64 = 0.85;

/// A rocket's upper stage that tumbles about an axis across its length or nearly so (synthetic).
struct Tumbler {
    period_s: f64,
    /// Ṗ/P a day.
    drift: f64,
    axis: DVec3,
    passes: Vec<SpinPass>,
    world: World,
}

fn direction(random: &mut Random) -> DVec3 {
    let mut one = || -> f64 { StandardNormal.sample(random) };
    DVec3::new(one(), one(), one()).normalize()
}

/// An orbit, the ground and the Sun, by plain geometry: a circle whose node moves, a sphere that turns, a Sun in the ecliptic.
struct World {
    radius_m: f64,
    inclination: f64,
    node: f64,
    node_rate: f64,
    along: f64,
    mean_motion: f64,
    sidereal: f64,
    sun: f64,
}

impl World {
    fn new(random: &mut Random) -> Self {
        let radius_m = EARTH_M + random.random_range(400e3..1500e3);
        let inclination = random.random_range(50.0_f64..100.0).to_radians();
        let km = radius_m * 1e-3;
        Self {
            radius_m,
            inclination,
            node: TAU * random.random::<f64>(),
            node_rate: (-2.06474e14 * km.powf(-3.5) * inclination.cos()).to_radians() / DAY_S,
            along: TAU * random.random::<f64>(),
            mean_motion: (3.986_004_418e14 / radius_m.powi(3)).sqrt(),
            sidereal: TAU * random.random::<f64>(),
            sun: TAU * random.random::<f64>(),
        }
    }

    fn body(&self, t: f64) -> DVec3 {
        let (su, cu) = (self.along + self.mean_motion * t).sin_cos();
        let (sn, cn) = (self.node + self.node_rate * t).sin_cos();
        let (si, ci) = self.inclination.sin_cos();
        self.radius_m * DVec3::new(cn * cu - sn * su * ci, sn * cu + cn * su * ci, su * si)
    }

    fn station(&self, t: f64) -> DVec3 {
        let (s, c) = (self.sidereal + 7.292_115e-5 * t).sin_cos();
        EARTH_M * DVec3::new(LATITUDE.cos() * c, LATITUDE.cos() * s, LATITUDE.sin())
    }

    fn sun(&self, t: f64) -> DVec3 {
        let (s, c) = (self.sun + TAU * t / (365.25 * DAY_S)).sin_cos();
        let (so, co) = 0.409_f64.sin_cos();
        DVec3::new(c, s * co, s * so)
    }

    fn is_seen(&self, t: f64) -> bool {
        let (body, station, sun) = (self.body(t), self.station(t), self.sun(t));
        let up = station.normalize();
        let high = (body - station).normalize().dot(up) > 0.3;
        let dark = sun.dot(up) < -0.14;
        let behind = body.dot(sun) < 0.0 && (body - body.dot(sun) * sun).length() < EARTH_M;
        high && dark && !behind
    }

    /// From and to of what can be seen in thirty days.
    fn passes(&self) -> Vec<(f64, f64)> {
        let mut found: Vec<(f64, f64)> = Vec::new();
        let step = 20.0;
        for k in 0..(30.0 * DAY_S / step) as usize {
            let t = k as f64 * step;
            if !self.is_seen(t) {
                continue;
            }
            match found.last_mut() {
                Some(last) if t - last.1 < 1.5 * step => last.1 = t,
                _ => found.push((t, t)),
            }
        }
        found.retain(|(a, b)| b - a >= 150.0);
        found
    }
}

/// The light of a cylinder with two lids, of radius 1 and length 6 (Lambert's law, closed form), with a lobe about its mirror directions.
struct Stage {
    lids: [f64; 2],
    gloss: f64,
    width: f64,
}

impl Stage {
    fn light(&self, along: DVec3, sun: DVec3, eye: DVec3) -> f64 {
        let across = |d: DVec3| d - d.dot(along) * along;
        let (s, o) = (across(sun), across(eye));
        let alpha = s.angle_between(o);
        let side = 6.0 * s.length() * o.length() * ((PI - alpha) * alpha.cos() + alpha.sin()) / 2.0;
        let lid = |n: DVec3| PI * n.dot(sun).max(0.0) * n.dot(eye).max(0.0);
        let tilt = FRAC_PI_2 - along.angle_between((sun + eye).normalize());
        let glint = self.gloss * (-(tilt / self.width).powi(2)).exp() * (0.5 * alpha).cos();
        side + self.lids[0] * lid(along) + self.lids[1] * lid(-along) + glint
    }
}

fn tumbler(seed: u64) -> Tumbler {
    let mut random = Random::seed_from_u64(seed);
    let random = &mut random;
    let period_s = 2.0 * 60.0_f64.powf(random.random());
    let drift = random.random_range(-1e-3..1e-3);
    let axis = direction(random);
    let tilt = random.random_range(70.0_f64..90.0).to_radians();
    let stage = Stage {
        lids: [random.random_range(0.1..2.0), random.random_range(0.1..2.0)],
        gloss: random.random_range(0.0..30.0),
        width: random.random_range(2.0_f64..10.0).to_radians(),
    };
    let noise_mag = 0.02 * 7.0_f64.powf(random.random());
    let wanted = random.random_range(3..=20);
    let (world, mut spans) = loop {
        let world = World::new(random);
        let spans = world.passes();
        if spans.len() >= 3 {
            break (world, spans);
        }
    };
    while spans.len() > wanted {
        let out = random.random_range(0..spans.len());
        spans.remove(out);
    }
    let (east, first) = (axis.any_orthonormal_vector(), TAU * random.random::<f64>());
    let north = axis.cross(east);
    let along = |t: f64| {
        let turns = turns(period_s, drift, t);
        let (s, c) = (first + TAU * turns.fract()).sin_cos();
        tilt.sin() * (c * east + s * north) + tilt.cos() * axis
    };
    let step = (period_s / 60.0).clamp(0.1, 1.0);
    let passes = spans.iter().enumerate().map(|(k, (from, to))| {
        let zero = f64::exp(random.random_range(-0.5..0.5));
        let seen = |t: f64| {
            let (body, sun) = (world.body(t), world.sun(t));
            (sun, (world.station(t) - body).normalize())
        };
        let n = ((to - from) / step) as usize;
        let time: Vec<f64> = (0..n).map(|i| from + i as f64 * step).collect();
        let value: Vec<f64> = time
            .iter()
            .map(|t| {
                let (sun, eye) = seen(*t);
                let off: f64 = StandardNormal.sample(random);
                zero * stage.light(along(*t), sun, eye) * 10.0_f64.powf(-0.4 * noise_mag * off)
            })
            .collect();
        let moments: Vec<_> = (0..=((to - from) / 5.0) as usize + 1)
            .map(|i| from + 5.0 * i as f64)
            .map(|t| (t, seen(t).0, seen(t).1))
            .collect();
        SpinPass {
            name: format!("pass {}", k + 1),
            series: vec![Series::new("v", &time, &value, None).unwrap()],
            path: Bisectors::new(&moments).unwrap(),
        }
    });
    let passes = passes.collect();
    Tumbler { period_s, drift, axis, passes, world }
}

/// Turns since the first moment. The frequency is that of a period that changes evenly with time, to first order of the drift.
fn turns(period_s: f64, drift: f64, t: f64) -> f64 {
    t / period_s * (1.0 - 0.5 * drift * t / DAY_S)
}

/// Harmonics of the turn in the oracle's fits, and slips of the phase that it sums over, turns.
const ORACLE_HARMONICS: usize = 4;
const ORACLE_SLIPS: [f64; 7] = [0.002, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16];

/// When a pass shows the body's sides, by the true clock: a second harmonic whose crests are half a turn apart.
struct Timing {
    time_s: f64,
    span_s: f64,
    /// How far ahead of the bisector the crests are in the middle, turns, and by how much that changes over the pass; with their variances by the light's noise.
    slip: (f64, f64),
    change: (f64, f64),
    /// Longitude of the bisector about the axis, turns, counted through the gaps; its change over the pass.
    longitude: f64,
    turned: f64,
    /// Twice the log of the likelihood that odd harmonics add.
    odd: f64,
}

/// A least-squares fit: coefficients, their covariance, χ² over the variance of the noise.
fn fitted(rows: &DMatrix<f64>, values: &DVector<f64>) -> Option<(DVector<f64>, DMatrix<f64>, f64)> {
    let (n, p) = rows.shape();
    let inverse = (rows.transpose() * rows).try_inverse()?;
    let x = &inverse * rows.transpose() * values;
    let squares = (values - rows * &x).norm_squared();
    let noise = squares / (n.checked_sub(p).filter(|f| *f > 0)? as f64);
    Some((x, inverse * noise, squares))
}

/// Timing that the oracle reads off a pass; `None` where it shows less than a turn.
fn timing(body: &Tumbler, pass: &SpinPass, longitude: &dyn Fn(f64) -> f64) -> Option<Timing> {
    let series = &pass.series[0];
    let (first, last) = (series.time_s[0], *series.time_s.last()?);
    let (time_s, span_s) = (0.5 * (first + last), last - first);
    let clock = |t: f64| turns(body.period_s, body.drift, t) - longitude(t);
    if span_s < body.period_s {
        return None;
    }
    let all: Vec<usize> = (1..=ORACLE_HARMONICS).collect();
    let even: Vec<usize> = all.iter().copied().filter(|h| h % 2 == 0).collect();
    let design = |harmonics: &[usize]| {
        DMatrix::from_fn(series.len(), 2 + 4 * harmonics.len(), |i, k| {
            let t = series.time_s[i];
            let about = (t - time_s) / span_s;
            let drift = if k % 2 == 0 { 1.0 } else { about };
            if k < 2 {
                return drift;
            }
            let h = harmonics[(k - 2) / 4] as f64;
            let (sin, cos) = (TAU * h * clock(t)).sin_cos();
            drift * if (k - 2) % 4 < 2 { cos } else { sin }
        })
    };
    let values = DVector::from_column_slice(&series.value);
    let (x, covariance, squares) = fitted(&design(&all), &values)?;
    let odd = fitted(&design(&even), &values)
        .map_or(0.0, |without| series.len() as f64 * (without.2 / squares).ln());
    // The second harmonic: from the seventh on cos, cos · t, sin, sin · t. Its crests are where the side faces the bisector, a quarter of a turn from it.
    let (c, ct, s, st) = (-x[6], -x[7], -x[8], -x[9]);
    let square = c * c + s * s;
    let per_turn = 2.0 * TAU;
    let of = |a: usize, b: usize| (covariance[(a, a)] + covariance[(b, b)]) / 2.0 / square;
    let change = (c * st - s * ct) / square / per_turn;
    let moved: Vec<f64> =
        (0..=20).map(|k| longitude(first + 0.05 * f64::from(k) * span_s)).collect();
    let mean = moved.iter().sum::<f64>() / 21.0;
    let about = |k: usize| 0.05 * k as f64 - 0.5;
    let steps: f64 = (0..21).map(|k| about(k).powi(2)).sum();
    Some(Timing {
        time_s,
        span_s,
        slip: (s.atan2(c) / per_turn, of(6, 8) / per_turn.powi(2)),
        change: (change, of(7, 9) / per_turn.powi(2)),
        longitude: mean,
        turned: moved.iter().enumerate().map(|(k, l)| about(k) * l).sum::<f64>() / steps,
        odd,
    })
}

/// Log of the likelihood of a clock that goes with the bisector `excess` times more than the true one, with its frequency and drift free and the turns between passes counted.
fn oracle_log(timings: &[Timing], excess: f64) -> f64 {
    let middle = timings.iter().map(|t| t.time_s).sum::<f64>() / timings.len() as f64;
    let days = |t: &Timing| (t.time_s - middle) / DAY_S;
    let rows = DMatrix::from_fn(timings.len(), 3, |i, k| days(&timings[i]).powi(k as i32));
    let seen = timings.iter().map(|t| t.slip.0 - excess * t.longitude);
    let values = DVector::from_iterator(timings.len(), seen);
    let mut logs = Vec::new();
    for slip in ORACLE_SLIPS {
        let weights: Vec<f64> = timings.iter().map(|t| (t.slip.1 + slip * slip).recip()).collect();
        let weighted = DMatrix::from_fn(timings.len(), 3, |i, k| rows[(i, k)] * weights[i].sqrt());
        let y = DVector::from_fn(timings.len(), |i, _| values[i] * weights[i].sqrt());
        let normal = weighted.transpose() * &weighted;
        let Some(inverse) = normal.clone().try_inverse() else { continue };
        let x = &inverse * weighted.transpose() * &y;
        let left = (&y - &weighted * &x).norm_squared();
        // The three unknowns are summed over, not fitted.
        let log =
            0.5 * (weights.iter().map(|w| w.ln()).sum::<f64>() - normal.determinant().ln() - left);
        for within in ORACLE_SLIPS {
            let changes: f64 = timings
                .iter()
                .map(|t| {
                    let variance = t.change.1 + within * within;
                    let faster = (x[1] + 2.0 * x[2] * days(t)) * t.span_s / DAY_S;
                    let off = t.change.0 - excess * t.turned - faster;
                    -0.5 * (off * off / variance + variance.ln())
                })
                .sum();
            logs.push(log + changes);
        }
    }
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + (logs.iter().map(|l| (l - most).exp()).sum::<f64>() / logs.len() as f64).ln()
}

/// An oracle: it knows axis, sense, true clock and the turns between passes, and that the side is seen twice a turn. Returns the log odds of the true period against the one that may be taken for it: twice
/// the period where odd harmonics show that the halves of a turn are unlike, else half of it. NaN with fewer than three passes of a turn.
fn oracle(body: &Tumbler) -> f64 {
    let east = body.axis.any_orthonormal_vector();
    let north = body.axis.cross(east);
    let plain = |t: f64| {
        let at = body.world.body(t);
        let bisector = body.world.sun(t) + (body.world.station(t) - at).normalize();
        bisector.dot(north).atan2(bisector.dot(east)) / TAU
    };
    // Whole turns through the gaps, as one would count who sees through the Earth.
    let step = 10.0;
    let mut counted: Vec<f64> = Vec::new();
    for k in 0..(30.5 * DAY_S / step) as usize {
        let here = plain(k as f64 * step);
        let before = counted.last().copied().unwrap_or(here);
        counted.push(here + (before - here).round());
    }
    let longitude = |t: f64| {
        let (here, near) = (plain(t), counted[(t / step).round() as usize]);
        here + (near - here).round()
    };
    let mut timings: Vec<Timing> =
        body.passes.iter().filter_map(|pass| timing(body, pass, &longitude)).collect();
    if timings.len() < 3 {
        return f64::NAN;
    }
    // Which crest a pass shows is known: the one near the others'.
    let sum = timings.iter().fold((0.0, 0.0), |sum: (f64, f64), t| {
        let (sin, cos) = (2.0 * TAU * t.slip.0).sin_cos();
        (sum.0 + sin, sum.1 + cos)
    });
    let usual = sum.0.atan2(sum.1) / (2.0 * TAU);
    for t in &mut timings {
        let off = t.slip.0 - usual;
        t.slip.0 = off - 0.5 * (2.0 * off).round();
    }
    // Eight unknowns of odd harmonics a pass are expected to add as much.
    let odd: f64 = timings.iter().map(|t| t.odd - 8.0).sum();
    let unlike = odd > 5.0 * (16.0 * timings.len() as f64).sqrt();
    let excess = if unlike { 1.0 } else { -0.5 };
    oracle_log(&timings, 0.0) - oracle_log(&timings, excess)
}

/// Columns: what was put in; the answer (0: one spin, 1: two, 2: none) where nothing is known of the body, and where it is known to be long (by the same search); the oracle's odds.
const COLUMNS: [&str; 20] = [
    "period_s",
    "drift",
    "passes",
    "answer",
    "share",
    "relative",
    "half_width",
    "held",
    "drift_held",
    "sense",
    "sense_right",
    "even_share",
    "long_answer",
    "long_relative",
    "long_held",
    "long_drift_held",
    "long_sense",
    "long_sense_right",
    "oracle_log_odds",
    "cpu_s",
];

/// Counts of single answers.
#[derive(Debug, Default)]
struct Singles {
    all: f64,
    /// Another period (off by more than 5 %).
    wrong: f64,
    /// Beyond the stated intervals of 95 %.
    outside: f64,
    drift_outside: f64,
    sense_told: f64,
    sense_wrong: f64,
    /// Those of bodies that the oracle tells.
    of_told: f64,
}

/// Truth: the spin that was put in: periods of 2 to 120 s, drifts of up to 1e-3 a day, axes all over the sky, 3 to 20 passes in thirty days, a zero point free in each, noise of 0.02 to 0.14 mag.
///
/// Asked: period, sense and drift in their intervals of 95 % in 92 to 98 %, at most 1 % of single answers wrong, 70 % answered of those that an oracle tells which knows axis and turns.
/// Rocket bodies are long, which their user may say: with that the 70 % are judged. Tolerance: of some 100 intervals and more, one in ten outside would have a chance of 2 %.
#[test]
fn campaign_tumbling_stages() {
    let mut campaign = Campaign::in_shards("tumbling_stages", 300, 3, &COLUMNS);
    for seed in campaign.seeds() {
        let row = asked(seed);
        println!("seed {seed}: {row:.3?}");
        campaign.keep(seed, &row);
    }
    let column = |name: &str| campaign.column(name);
    let oracle = column("oracle_log_odds");
    let is_told: Vec<bool> = oracle.iter().map(|odds| *odds > 99_f64.ln()).collect();
    let singles = |names: [&str; 6]| {
        let [answer, off, held, drift_held, sense, right] = names.map(column);
        let mut found = Singles::default();
        for k in (0..answer.len()).filter(|k| answer[*k] == 0.0) {
            let one = |holds: bool| f64::from(u8::from(holds));
            found.all += 1.0;
            found.wrong += one(off[k].abs() > 0.05);
            found.outside += one(held[k] == 0.0);
            found.drift_outside += one(drift_held[k] == 0.0);
            found.sense_told += one(sense[k] >= 0.99);
            found.sense_wrong += one(sense[k] >= 0.99 && right[k] == 0.0);
            found.of_told += one(is_told[k]);
        }
        found
    };
    let any = singles(["answer", "relative", "held", "drift_held", "sense", "sense_right"]);
    let long = singles([
        "long_answer",
        "long_relative",
        "long_held",
        "long_drift_held",
        "long_sense",
        "long_sense_right",
    ]);
    let answers = column("answer");
    let two = answers.iter().filter(|a| **a == 1.0).count() as f64;
    let first =
        answers.iter().zip(column("relative")).filter(|(a, off)| **a == 1.0 && off.abs() < 0.05);
    let first = first.count() as f64;
    let n = answers.len() as f64;
    let told = is_told.iter().filter(|t| **t).count() as f64;
    println!(
        "{n} bodies, {told} told by the oracle; nothing known: {any:?}, two answers of {two}, {first} with the true one first; long: {long:?}"
    );
    // Rows of older commits have no answer of a long body, and no oracle.
    let anew = column("long_answer").iter().filter(|answer| !answer.is_nan()).count();
    let whole = campaign.is_whole();
    if !whole {
        // The first two bodies are seen too seldom; the third has one answer, whatever is known of it.
        assert!(any.all >= 1.0 && any.wrong == 0.0, "{any:?}");
        assert!(long.all >= 1.0 && long.wrong == 0.0, "{long:?}");
    }
    campaign.largest("one_answer", any.all);
    campaign.largest("another_period", any.wrong);
    campaign.largest("period_outside", any.outside);
    campaign.largest("drift_outside", any.drift_outside);
    campaign.largest("two_answers", two);
    campaign.largest("of_them_the_first_is_true", first);
    campaign.largest("sense_told", any.sense_told);
    campaign.largest("sense_wrong", any.sense_wrong);
    campaign.largest("asked_as_long", anew as f64);
    campaign.largest("oracle_tells", told);
    campaign.largest("of_them_one_answer", any.of_told);
    campaign.largest("long_one_answer", long.all);
    campaign.largest("long_another_period", long.wrong);
    campaign.largest("long_period_outside", long.outside);
    campaign.largest("long_drift_outside", long.drift_outside);
    campaign.largest("long_sense_told", long.sense_told);
    campaign.largest("long_sense_wrong", long.sense_wrong);
    campaign.largest("long_of_them_one_answer", long.of_told);
    campaign.finish();
    if whole {
        for found in [&any, &long] {
            assert!(found.wrong <= 0.01 * found.all, "{found:?}");
            let most = 0.1 * found.all;
            assert!(found.outside <= most && found.drift_outside <= most, "{found:?}");
        }
        let all = anew == answers.len();
        assert!(!all || long.of_told >= 0.7 * told, "{long:?} of {told}");
    }
}

fn asked(seed: u64) -> [f64; COLUMNS.len()] {
    let body = tumbler(seed);
    let before = sunglint_testkit::cpu_s();
    let found = find_spin(&body.passes, &SpinOptions::default()).unwrap();
    let cpu_s = sunglint_testkit::cpu_s() - before;
    // Its frequency falls evenly.
    let truth = body.period_s / (1.0 - body.drift * found.epoch_s / DAY_S);
    for spin in &found.spins {
        println!(
            "   {} a turn: share {:.3}, {:.6} ({:.6} to {:.6}) of {truth:.6} s; drift {:.2e} ({:.2e} to {:.2e}) of {:.2e}; axis within {:.1}, off by {:.1} degrees, sense {:.4}, slip {:.4}",
            spin.repeats,
            spin.share,
            spin.period_s.value,
            spin.period_s.from,
            spin.period_s.to,
            spin.drift_per_day.value,
            spin.drift_per_day.from,
            spin.drift_per_day.to,
            body.drift,
            spin.axis_within_deg,
            spin.axis.angle_between(body.axis).to_degrees(),
            spin.sense,
            spin.slip_turns
        );
    }
    let is = |holds: bool| f64::from(u8::from(holds));
    let holds = |i: Interval, x: f64| is((i.from..=i.to).contains(&x));
    let answer = |found: &SpinFound| match (found.only(), found.spins.first()) {
        (Some(_), _) => 0.0,
        (None, Some(_)) => 1.0,
        (None, None) => 2.0,
    };
    let mut row = [f64::NAN; COLUMNS.len()];
    (row[0], row[1], row[2]) = (body.period_s, body.drift, body.passes.len() as f64);
    row[3] = answer(&found);
    if let Some(best) = found.spins.first() {
        row[4] = best.share;
        row[5] = best.period_s.value / truth - 1.0;
        row[6] = 0.5 * (best.period_s.to - best.period_s.from) / truth;
        row[7] = holds(best.period_s, truth);
        row[8] = holds(best.drift_per_day, body.drift);
        row[9] = best.sense;
        row[10] = is(best.axis.dot(body.axis) > 0.0);
    }
    row[11] = found.even_share.unwrap_or(f64::NAN);
    let long = found.knowing(Body::Long);
    row[12] = answer(&long);
    if let Some(best) = long.spins.first() {
        row[13] = best.period_s.value / truth - 1.0;
        row[14] = holds(best.period_s, truth);
        row[15] = holds(best.drift_per_day, body.drift);
        row[16] = best.sense;
        row[17] = is(best.axis.dot(body.axis) > 0.0);
    }
    row[18] = oracle(&body);
    row[19] = cpu_s;
    row
}

/// Truth: what the oracle knows. Of the bodies of seeds 10,000 to 10,299 it tells 291 at odds of 99 to 1 (all 173 in 10 passes and more, 62 of 65 in 6 to 9, 56 of 62 in fewer); here the first two, in 11 and 17 passes.
#[test]
fn an_oracle_tells_a_turn_from_two() {
    for seed in [10_000, 10_001] {
        let odds = oracle(&tumbler(seed));
        assert!(odds > 99_f64.ln(), "{seed}: {odds}");
    }
}

/// Truth: the spin of a body of twelve passes. Tolerance: the stated 95 % intervals, the sense, 5° of the axis; passes that are given in another order, or all at once, are the same to the bit.
#[test]
fn a_spin_over_passes_has_axis_and_sense() {
    let body = tumbler(2);
    let found = find_spin(&body.passes, &SpinOptions::default()).unwrap();
    let spin = *found.only().unwrap();
    let truth = body.period_s / (1.0 - body.drift * found.epoch_s / DAY_S);
    assert!((spin.period_s.from..=spin.period_s.to).contains(&truth), "{spin:?} {truth}");
    assert!(spin.period_s.to - spin.period_s.from < 0.02 * truth, "{spin:?}");
    assert!(spin.knows_sense() && spin.axis.angle_between(body.axis) < 5.0_f64.to_radians());
    let told = found.passes.iter().filter_map(|p| Some((p.apparent_s?, p.model_s?)));
    let off: Vec<f64> = told.map(|(seen, model)| (seen / model - 1.0).abs()).collect();
    assert!(off.len() >= 10 && off.iter().all(|o| *o < 0.02), "{off:?}");
    let all = body.passes.iter().rev().flat_map(|p| p.series.clone()).collect();
    let parted = by_pass(all, 600.0);
    let same: Vec<_> = body.passes.iter().map(|p| p.series.clone()).collect();
    assert_eq!(parted, same);
}

/// Truth: the spin of a body whose passes leave two answers where nothing is known of it. As a long one it has the true one alone, with the same numbers; nothing changes for a body that is told already.
#[test]
fn a_long_body_shows_its_side_twice_a_turn() {
    let mut body = tumbler(2);
    body.passes.truncate(4);
    let found = find_spin(&body.passes, &SpinOptions::default()).unwrap();
    assert!(found.only().is_none() && found.spins.len() == 2, "{:?}", found.spins);
    let truth = body.period_s / (1.0 - body.drift * found.epoch_s / DAY_S);
    let is_true = |s: &&Spin| (s.period_s.value / truth - 1.0).abs() < 0.05;
    let right = *found.spins.iter().find(is_true).unwrap();
    let long = found.clone().knowing(Body::Long);
    let only = *long.only().unwrap();
    assert_eq!((only.period_s, only.axis), (right.period_s, right.axis), "{long:?}");
    assert_eq!(long.knowing(Body::Any).spins, found.spins);
}

/// Two passes, and passes of noise, have no spin, and say so.
#[test]
fn too_few_passes_have_no_spin() {
    let mut body = tumbler(2);
    body.passes.truncate(2);
    let found = find_spin(&body.passes, &SpinOptions::default()).unwrap();
    assert!(found.only().is_none());
    assert!(matches!(found.refused, Some(NoSpin::Passes { of: 2, .. })), "{:?}", found.refused);
    let mut body = tumbler(2);
    let mut random = Random::seed_from_u64(1);
    for pass in &mut body.passes {
        for value in &mut pass.series[0].value {
            let off: f64 = StandardNormal.sample(&mut random);
            *value = 1.0 + 0.05 * off;
        }
    }
    let found = find_spin(&body.passes, &SpinOptions::default()).unwrap();
    assert!(found.spins.is_empty() && found.refused.is_some(), "{:?}", found.spins);
}

/// Truth: of three passes two are of one body and the third is of another, which turns 1.37 times as fast: two agree, the reason says two, and two passes say in what time they repeat.
#[test]
fn passes_that_agree_are_counted_once() {
    let mut body = tumbler(2);
    body.passes.truncate(3);
    let (middle, other) = (body.passes[2].series[0].time_s[0], &mut body.passes[2].series[0]);
    for t in &mut other.time_s {
        *t = middle + (*t - middle) / 1.37;
    }
    let found = find_spin(&body.passes, &SpinOptions::default()).unwrap();
    let shown = found.passes.iter().filter(|p| p.apparent_s.is_some()).count();
    match found.refused {
        Some(NoSpin::Apart { agree, of: 3 }) => assert_eq!((agree, shown), (2, 2)),
        other => panic!("{other:?}"),
    }
}
