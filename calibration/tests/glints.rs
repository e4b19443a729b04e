//! Light that changes within a bin: right from raw tags, flagged without them.
#![allow(clippy::unwrap_used)]

use crate::events::{Detector, Events};
use hifitime::{Duration, Epoch};
use std::convert::Infallible;
use sunglint_calibration::counts::{
    Bin, CountChannel, Gate, OffOptions, OffTarget, Options, Reduction, Sample, Span, Spans, View,
};
use sunglint_calibration::detector::{FineBins, Limit, Linearity};
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::DeadTime;

/// The slowest of the station's counters.
const TAU_S: f64 = 1e-5;
const BIN_S: f64 = 0.1;
const BIN_PS: i64 = 100_000_000_000;
const BASE_HZ: f64 = 1000.0;

/// Five bins with a glint in the middle one.
fn night(light_hz: &dyn Fn(f64) -> f64, most_hz: f64, seed: u64) -> Vec<Vec<i64>> {
    let mut events = Events::new(Detector::NonParalysable(TAU_S), seed);
    let mut bins = vec![Vec::new(); 5];
    while let Some(time_s) = events.next_of(light_hz, most_hz, 5.0 * BIN_S) {
        let time_ps = (time_s * 1e12) as i64;
        bins[((time_ps / BIN_PS) as usize).min(4)].push(time_ps);
    }
    bins
}

/// The middle bin's rate and flags through the whole chain, with tags or without.
fn reduce(bins: &[Vec<i64>], with_tags: bool) -> Vec<Sample> {
    let at =
        |s: f64| Epoch::from_gregorian_utc_at_midnight(2026, 11, 21) + Duration::from_seconds(s);
    let law = DeadTime::NonParalysable { dead_time_s: TAU_S };
    let channels = [CountChannel {
        name: "id400".into(),
        column: 0,
        linearity: Linearity::new(&law).unwrap(),
        dark_rate_hz: 0.0,
        fibre: None,
    }];
    let records = bins.iter().enumerate().map(|(i, tags)| {
        let record = CountRecord {
            start: at(i as f64 * BIN_S),
            start_ps: i as i64 * BIN_PS,
            length_ps: BIN_PS,
            counts: vec![tags.len() as u64],
            missed: vec![0],
            flags: CountFlags::empty(),
        };
        Ok::<_, Infallible>(Bin { record, tags_ps: vec![with_tags.then(|| tags.clone())] })
    });
    let visit = Span { from: at(0.0), to: at(5.0 * BIN_S), view: View::Target(0) };
    let spans = Spans::new([visit]);
    let Ok(off) =
        OffTarget::measure::<Infallible>(Vec::new(), &channels, &spans, &OffOptions::default());
    let options = Options {
        gate: Gate { most_q: None, divide: false, ..Gate::default() },
        ..Options::default()
    };
    let run = Reduction::<std::vec::IntoIter<Result<Bin, Infallible>>>::new(
        records.collect::<Vec<_>>(),
        &channels,
        &spans,
        &[],
        &off,
        options,
    );
    run.map(|sample| sample.unwrap()).collect()
}

/// Truth: the light that the photons were drawn from: a base of 1 kHz and a normal glint of σ = 8 ms, anywhere in the middle of the bin of 0.1 s, whose integral
/// is known: peak · 8 ms · √(2π). From tags the mean over the draws is right to 2e-3 (what fine bins of 1 ms leave) and 3.5 times its noise, and the
/// stated σ covers 68 % (binomial, 3.5 σ); without them it falls short by more than 2.5 % (20 % at nτ = 1; 7 % of a rectangular glint alone at nτ = 0.1 over a fifth of the bin) and
/// each draw is flagged. Of the others, and of those with tags, at most 2 and 3 % are flagged by their noise.
#[test]
fn a_glint_within_a_bin_is_right_from_tags_and_flagged_without() {
    for (peak_hz, draws, short) in [(1e4, 400, 0.025), (1e5, 100, 0.2)] {
        let (mut fine, mut coarse, mut variance, mut covered) = (0.0, 0.0, 0.0, 0.0_f64);
        let sigma_s: f64 = 0.008;
        let truth_hz = BASE_HZ + peak_hz * sigma_s * std::f64::consts::TAU.sqrt() / BIN_S;
        let (mut quiet_flagged, mut fine_flagged) = (0, 0);
        for seed in 0..draws {
            let middle_s = 0.235 + 0.03 * (seed as f64 / draws as f64);
            let light =
                |t: f64| BASE_HZ + peak_hz * (-0.5 * ((t - middle_s) / sigma_s).powi(2)).exp();
            let bins = night(&light, BASE_HZ + peak_hz, seed);
            let with = reduce(&bins, true)[2].channels[0];
            assert!(with.from_tags);
            fine_flagged += u32::from(with.flags.contains(Flags::FAST_GLINT));
            fine += with.rate_hz;
            variance += with.sigma_hz.powi(2);
            covered += f64::from((with.rate_hz - truth_hz).abs() <= with.sigma_hz);
            let without = reduce(&bins, false);
            assert!(
                without[2].channels[0].flags.contains(Flags::FAST_GLINT),
                "{seed}: {:?}",
                without[2]
            );
            quiet_flagged += [0, 4]
                .iter()
                .filter(|i| without[**i].channels[0].flags.contains(Flags::FAST_GLINT))
                .count();
            coarse += without[2].channels[0].rate_hz;
        }
        let n = draws as f64;
        let (bias, noise) = (fine / n / truth_hz - 1.0, variance.sqrt() / n / truth_hz);
        let coarse = coarse / n / truth_hz - 1.0;
        let coverage = covered / n;
        println!(
            "{peak_hz}: fine {bias:+.1e} ± {noise:.1e}, coverage {coverage:.3}, coarse {coarse:+.3}, quiet flagged {quiet_flagged}"
        );
        assert!(bias.abs() < 2e-3 + 3.5 * noise, "{peak_hz}: {bias} ± {noise}");
        assert!((coverage - 0.683).abs() < 3.5 * (0.683 * 0.317 / n).sqrt() + 0.01, "{coverage}");
        assert!(f64::from(fine_flagged) <= 0.03 * n, "{fine_flagged} of {n}");
        assert!(coarse < -short, "{coarse}");
        assert!(quiet_flagged <= draws as usize / 50);
    }
}

/// Truth: a glint of 0.3 ms at nτ = 3 lies within one or two fine bins of 1 ms: not even tags make it right, and that is said. Constant light of the same mean is not flagged.
#[test]
fn a_glint_within_a_fine_bin_is_flagged() {
    let light = |t: f64| BASE_HZ + if (0.25..0.2503).contains(&t) { 3e5 } else { 0.0 };
    let flagged = (0..50).filter(|seed| {
        reduce(&night(&light, 4e5, *seed), true)[2].channels[0].flags.contains(Flags::FAST_GLINT)
    });
    let flagged = flagged.count();
    let constant = (0..50).filter(|seed| {
        reduce(&night(&|_| 1600.0, 1600.0, *seed), true)[2].channels[0]
            .flags
            .contains(Flags::FAST_GLINT)
    });
    let constant = constant.count();
    println!("{flagged} of 50 flagged, {constant} of constant light");
    assert!(flagged >= 45 && constant == 0, "{flagged} {constant}");
}

/// Truth: a glint of 20 ms at 30 times 1/τ: its counts stand at nine tenths of 1/τ and more, where no rate can be told; from tags the bin is saturated and not
/// bent down to the mean that its counts would say.
#[test]
fn a_saturated_glint_is_no_number() {
    let light = |t: f64| BASE_HZ + if (0.24..0.26).contains(&t) { 3e6 } else { 0.0 };
    let bins = night(&light, 3.1e6, 1);
    let with = reduce(&bins, true)[2].channels[0];
    assert!(with.flags.contains(Flags::SATURATED) && with.rate_hz.is_nan(), "{with:?}");
    let without = reduce(&bins, false)[2].channels[0];
    assert!(without.flags.contains(Flags::FAST_GLINT), "{without:?}");
    // A whole stretch of it.
    let all = night(&|_| 3e6, 3e6, 2);
    for with_tags in [true, false] {
        for sample in reduce(&all, with_tags) {
            assert!(sample.channels[0].flags.contains(Flags::SATURATED));
            assert!(
                sample.channels[0].rate_hz.is_nan() && sample.channels[0].measured_hz.value > 9e4
            );
        }
    }
}

#[test]
fn tags_that_are_not_of_the_bin_are_refused() {
    let law = Linearity::new(&DeadTime::NonParalysable { dead_time_s: TAU_S }).unwrap();
    let error = |tags: &[i64]| {
        law.linearise_tags(tags, 0, BIN_PS, &FineBins::default()).unwrap_err().to_string()
    };
    assert_eq!(error(&[5, 4]), "time tag 2 of the bin is at 4 ps, expected 5 to 100000000000 ps");
    assert!(error(&[-1]).contains("time tag 1"));
    assert!(error(&[BIN_PS]).contains("time tag 1"));
    assert!(law.linearise_tags(&[], 0, 0, &FineBins::default()).is_err());
    let none = law.linearise_tags(&[], 0, BIN_PS, &FineBins::default()).unwrap();
    assert!(none.linear.rate_hz == 0.0 && none.linear.sigma_hz == 10.0);
    // Two tags in one picosecond, at a bin's edge.
    assert!(law.linearise_tags(&[0, 0, BIN_PS - 1], 0, BIN_PS, &FineBins::default()).is_ok());
    assert_ne!(Limit::Law, Limit::Stated);
}
