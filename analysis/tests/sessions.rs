//! Periods over sessions, on made-up nights and on those of five real bodies.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::TAU;
use sunglint_analysis::sessions::{Options, Outcome, Session, SessionPeriods, search};
use sunglint_numerics::progress::Silent;
use sunglint_testkit::{Campaign, shared, skip};

/// Made-up nights (synthetic): a body of eight harmonics, sessions of 2 to 8 h within 3 to 30 days, a zero point each, white and red noise, outliers.
struct Made {
    period_s: f64,
    sessions: Vec<Session>,
    /// Amplitude over the noise.
    ratio: f64,
}

fn made(seed: u64) -> Made {
    let mut random = Random::seed_from_u64(seed);
    let random = &mut random;
    let normal = Normal::new(0.0, 1.0).unwrap();
    let period_s = 3600.0 * 10_f64.powf(random.random_range(2.5_f64.log10()..24_f64.log10()));
    // Harmonics that fall with their number; the second leads, as two sides of a body make it.
    let harmonics: Vec<[f64; 2]> = (1..=8)
        .map(|k| {
            let size = match k {
                1 => random.random_range(0.1..1.0),
                2 => 1.0,
                k => 10_f64.powf(random.random_range(-1.0..0.0)) * 2.0 / f64::from(k),
            };
            let phase = TAU * random.random::<f64>();
            [size * phase.cos(), size * phase.sin()]
        })
        .collect();
    let light = |t: f64| {
        harmonics
            .iter()
            .zip(1..)
            .map(|([a, b], k)| {
                let (s, c) = (TAU * f64::from(k) * t / period_s).sin_cos();
                a * c + b * s
            })
            .sum::<f64>()
    };
    let all: Vec<f64> = (0..500).map(|i| light(period_s * f64::from(i) / 500.0)).collect();
    let (low, high) =
        all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), m| (a.min(*m), b.max(*m)));
    let amplitude = random.random_range(0.05..0.8);
    let scale = amplitude / (high - low);
    let ratio = 10_f64.powf(random.random_range(1.5_f64.log10()..75_f64.log10()));
    let noise = amplitude / ratio;
    let rho: f64 = if random.random_range(0..2) == 0 { 0.0 } else { 0.5 };
    let days = random.random_range(3..=30_u32);
    let number = random.random_range(3..=8_u32).min(days);
    let mut nights: Vec<u32> = (0..days).collect();
    for i in 0..number as usize {
        let other = random.random_range(i..nights.len());
        nights.swap(i, other);
    }
    let step_s = random.random_range(60.0..400.0);
    let sessions = nights[..number as usize]
        .iter()
        .map(|night| {
            let from = 86_400.0 * f64::from(*night) + random.random_range(0.0..10_800.0);
            let length = 3600.0 * random.random_range(2.0..8.0);
            let zero = random.random_range(-3.0..15.0);
            let mut red = 0.0;
            let mut session = Session { name: format!("night {night}"), ..Session::default() };
            for i in 0..(length / step_s) as u32 {
                let white: f64 = normal.sample(random);
                red = rho * red + (1.0 - rho * rho).sqrt() * white;
                let t = from + step_s * (f64::from(i) + 0.3 * random.random::<f64>());
                let outlier = if random.random_range(0..100) == 0 {
                    8.0 * noise * normal.sample(random)
                } else {
                    0.0
                };
                session.time_s.push(t);
                session.magnitude.push(zero + scale * light(t) + noise * red + outlier);
            }
            session
        })
        .collect();
    Made { period_s, sessions, ratio }
}

fn right(found: f64, truth: f64) -> bool {
    (found / truth - 1.0).abs() < 0.01
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Judged {
    Single,
    Family,
    FamilyLater,
    Open,
    Wrong,
    FamilyWithout,
}

fn judged(found: &SessionPeriods, truth: f64) -> Judged {
    let place = found.members.iter().position(|m| right(m.period_s, truth));
    match (found.verdict, place) {
        (Outcome::Single, Some(_)) => Judged::Single,
        (Outcome::Single, None) => Judged::Wrong,
        (Outcome::Family, Some(0)) => Judged::Family,
        (Outcome::Family, Some(_)) => Judged::FamilyLater,
        (Outcome::Family, None) => Judged::FamilyWithout,
        _ => Judged::Open,
    }
}

#[test]
fn campaign_session_periods() {
    let mut campaign = Campaign::start("session_periods", 500);
    let mut counts = [0_usize; 6];
    for seed in campaign.seeds() {
        let made = made(seed);
        let begin = sunglint_testkit::cpu_s();
        let found = search(&made.sessions, &Options::default(), &Silent).unwrap();
        let took = sunglint_testkit::cpu_s() - begin;
        let answer = judged(&found, made.period_s);
        counts[answer as usize] += 1;
        let inside = found.members.first().is_some_and(|m| m.interval_s.contains(made.period_s));
        eprintln!(
            "seed {seed} {answer:?} truth {:.3} h ratio {:.1} sessions {} best {:?} gaps {:?} seen {:?} inside {inside} counts {:?} rho {:.2} {took:.2} s |{}",
            made.period_s / 3600.0,
            made.ratio,
            made.sessions.len(),
            found.best_s.map(|b| b.map(|s| (s / 36.0).round() / 100.0)),
            found.smallest_gap,
            found.members.first().map(|m| m.phase_seen),
            found.members.first().map(|m| m.cycle_counts),
            found.correlation[1],
            found.reason.clone().unwrap_or_default()
        );
    }
    eprintln!("single, family, truth later, open, wrong, family without: {counts:?}");
    campaign.finish();
}

/// Truth: published periods (LCDB, in the files' headers).
#[test]
fn five_real_bodies() {
    let Some(folder) = shared("real/rotation") else {
        return skip("five_real_bodies", "no shared/real beside the checkout");
    };
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for file in files.iter().filter(|f| f.extension().is_some_and(|e| e == "csv")) {
        let text = std::fs::read_to_string(file).unwrap();
        let hours: f64 = text
            .split("published period ")
            .nth(1)
            .unwrap()
            .split(' ')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        let curves = sunglint_analysis::curves::Curves::read(
            std::slice::from_ref(file),
            &Default::default(),
            &[],
        )
        .unwrap();
        assert!(curves.are_sessions());
        let begin = sunglint_testkit::cpu_s();
        let found =
            sunglint_analysis::sessions::find_over_sessions(curves, &Options::default(), &Silent)
                .unwrap();
        let took = sunglint_testkit::cpu_s() - begin;
        let f = &found.found;
        eprintln!(
            "{}: {:?} truth {hours} h, {:?}; gaps {:?}, {} frequencies, {:?}, {took:.2} s",
            file.display(),
            f.verdict,
            f.members
                .iter()
                .map(|m| (
                    m.period_s / 3600.0,
                    m.interval_s.low / 3600.0,
                    m.interval_s.high / 3600.0,
                    m.cycle_counts,
                    m.gaps,
                    m.phase_seen
                ))
                .collect::<Vec<_>>(),
            f.smallest_gap,
            f.frequencies,
            f.correlation
        );
    }
}
