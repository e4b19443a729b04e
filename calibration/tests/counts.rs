//! Bins to linear rates: off-target stretches, gate, coupling, and what is flagged.
#![allow(clippy::unwrap_used)]

use hifitime::{Duration, Epoch};
use std::convert::Infallible;
use sunglint_calibration::counts::{
    Away, BackgroundSource, Between, Bin, CountChannel, Curves, Gate, NotCarried, OffOptions,
    OffTarget, Options, Reduction, Sample, Seen, SkyLevel, SkyLevels, SkyTally, Span, Spans,
    Summary, View, away, coupling,
};
use sunglint_calibration::detector::Linearity;
use sunglint_calibration::track::{NoPlace, Place, Track, TrackPoint};
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_radiometry::light_curve::{Flags, LightCurve, Provenance};
use sunglint_radiometry::station::{DeadTime, Fibre};

fn at(seconds: f64) -> Epoch {
    Epoch::from_gregorian_utc_at_midnight(2026, 11, 21) + Duration::from_seconds(seconds)
}

/// A bin of 1 s.
fn bin(second: i64, counts: u64) -> Bin {
    Bin::from(CountRecord {
        start: at(second as f64),
        start_ps: second * 1_000_000_000_000,
        length_ps: 1_000_000_000_000,
        counts: vec![counts],
        missed: vec![0],
        flags: CountFlags::empty(),
    })
}

fn channel(law: &DeadTime, fibre: Option<Fibre>) -> CountChannel {
    let linearity = Linearity::new(law).unwrap();
    CountChannel { name: "spad".into(), column: 0, linearity, dark_rate_hz: 30.0, fibre }
}

fn span(from: f64, to: f64, view: View) -> Span {
    Span { from: at(from), to: at(to), view }
}

fn place(x: f64, y: f64) -> Place {
    Place { offset_px: [x, y].into(), covariance_px2: [0.0; 3] }
}

/// Frames at whole seconds from 0, half of one long.
fn track(places: &[Option<Place>]) -> Track {
    let point = |(i, place): (usize, &Option<Place>)| TrackPoint {
        time: at(i as f64),
        exposure_s: 0.5,
        place: *place,
    };
    Track { points: places.iter().enumerate().map(point).collect() }
}

fn ok(bins: &[Bin]) -> Vec<Result<Bin, Infallible>> {
    bins.iter().cloned().map(Ok).collect()
}

fn reduce(
    bins: &[Bin],
    channels: &[CountChannel],
    spans: &[Span],
    tracks: &[Track],
    gate: Gate,
    off: OffOptions,
) -> (Vec<Sample>, Summary) {
    let spans = Spans::new(spans.iter().copied());
    let Ok(off) = OffTarget::measure(ok(bins), channels, &spans, &off);
    let options = Options { gate, ..Options::default() };
    let mut run = Reduction::new(ok(bins), channels, &spans, tracks, &off, options);
    let samples = run.by_ref().map(|sample| sample.unwrap()).collect();
    (samples, run.summary().clone())
}

const NO_GATE: Gate = Gate { most_q: None, divide: false, apart_s: 10.0, wander_px2_per_s: None };

/// Truth: by hand. Off rates of 100 and 200 Hz with their middles at 5 s and 35 s, the target's 1000 Hz at 20.5 s: the line is at 100 + 100·15.5/30, the sag of a
/// parabola w(1−w)·100; counting √(100/10) and √(200/10) of ten bins of 1 s each, √1000 of the bin.
#[test]
fn the_background_is_taken_between_its_neighbours() {
    let mut bins = Vec::new();
    for second in 0..40 {
        bins.push(bin(
            second,
            if second < 10 {
                100
            } else if second < 30 {
                1000
            } else {
                200
            },
        ));
    }
    let spans = [
        span(0.0, 10.0, View::Sky),
        span(10.0, 30.0, View::Target(0)),
        span(30.0, 40.0, View::Sky),
    ];
    let channels = [channel(&DeadTime::None, None)];
    let run = |between, near_s| {
        let off = OffOptions { between, near_s, ..OffOptions::default() };
        reduce(&bins, &channels, &spans, &[], NO_GATE, off)
    };
    let (samples, summary) = run(Between::Linear, 1800.0);
    assert_eq!((samples.len(), summary.bins, summary.outside), (20, 40, 20));
    let sample = &samples[10].channels[0];
    let w: f64 = 15.5 / 30.0;
    let background = 100.0 + 100.0 * w;
    let parts = [(1.0 - w) * 10_f64.sqrt(), w * 20_f64.sqrt(), 100.0 * w * (1.0 - w)];
    let sigma = parts.iter().map(|p| p * p).sum::<f64>().sqrt();
    assert!((sample.background_hz.value - background).abs() < 1e-6, "{sample:?}");
    assert!((sample.background_hz.sigma - sigma).abs() < 1e-6, "{sample:?}");
    assert!((sample.rate_hz - (1000.0 - background)).abs() < 1e-6);
    assert!((sample.sigma_hz - 1000_f64.sqrt().hypot(sigma)).abs() < 1e-6);
    assert!((sample.measured_hz.value - 1000.0).abs() < 1e-9 && sample.flags.is_empty());
    let (samples, _) = run(Between::Constant, 1800.0);
    assert!((samples[3].channels[0].background_hz.value - 150.0).abs() < 1e-9);
    // Only the first piece is near: its rate, whatever came later. None near: the station's 30 Hz, and said so.
    let (samples, _) = run(Between::Linear, 8.0);
    assert!((samples[0].channels[0].background_hz.value - 100.0).abs() < 1e-9);
    let far = &samples[10].channels[0];
    assert!(
        far.background_hz.to_array() == [30.0, 0.0] && far.flags == Flags::NO_OFF_TARGET,
        "{far:?}"
    );
    assert!((far.rate_hz - 970.0).abs() < 1e-9);
}

/// Truth: by hand. Dead time 1 µs: lin(500 kHz) − lin(100 kHz) = 1 MHz − 1/9 MHz, and not lin of the difference. A measured dark stretch stands in before the station's rate.
#[test]
fn rates_are_linearised_before_they_are_subtracted() {
    let law = channel(&DeadTime::NonParalysable { dead_time_s: 1e-6 }, None);
    let bins: Vec<Bin> = (0..8).map(|s| bin(s, if s < 4 { 100_000 } else { 500_000 })).collect();
    for (view, flags) in
        [(View::Sky, Flags::FAST_GLINT), (View::Dark, Flags::FAST_GLINT | Flags::NO_OFF_TARGET)]
    {
        let spans = [span(0.0, 4.0, view), span(4.0, 8.0, View::Target(0))];
        let (samples, _) =
            reduce(&bins, std::slice::from_ref(&law), &spans, &[], NO_GATE, OffOptions::default());
        let sample = &samples[2].channels[0];
        assert!((sample.rate_hz - 8e6 / 9.0).abs() < 2.0, "{sample:?}");
        assert!((sample.lost_fraction - 0.5).abs() < 1e-9);
        assert_eq!(sample.flags, flags - Flags::FAST_GLINT);
        // The first bin of the visit borders on much less light: where in the bin it came is not known.
        assert_eq!(samples[0].channels[0].flags, flags);
    }
}

/// Truth: 100 Hz were put in; a star of 5,000 Hz in one of the bins, a saturated one and one whose counter overflowed must not count, and are counted.
#[test]
fn a_star_in_the_background_is_left_out() {
    let mut bins: Vec<Bin> = (0..30).map(|s| bin(s, 90 + (s as u64 * 7) % 21)).collect();
    bins[4].record.counts[0] = 5000;
    bins[7].record.flags |= CountFlags::OVERFLOW;
    bins[9].record.missed[0] = 3;
    let spans = Spans::new([span(0.0, 30.0, View::Sky)]);
    let channels = [channel(&DeadTime::None, None)];
    let off = OffOptions { piece_s: 10.0, ..OffOptions::default() };
    let Ok(found) = OffTarget::measure(ok(&bins), &channels, &spans, &off);
    assert_eq!(found.pieces().len(), 3);
    let first = found.pieces()[0].rates[0].unwrap();
    assert_eq!((first.bins, first.clipped, first.excluded), (7, 1, 2));
    assert!((first.rate_hz - 100.0).abs() < 5.0, "{first:?}");
    assert_eq!(found.at(at(12.0), 0).source, BackgroundSource::Between);
    assert_eq!(found.at(at(29.0), 0).source, BackgroundSource::Nearest);
}

/// Level of the sky in a camera's frames at a time, and their setting.
type Frames<'a> = &'a dyn Fn(f64) -> Option<(f64, usize)>;

/// Truth: by hand. A sky that grows three-fold in 200 s, as 3^(t/200), from 10⁵ Hz above a dark rate of 30 Hz; in the camera as its power 1/1.1. In the middle it is √3 times as bright as at the begin, to 0.1 % for the looks' lengths; the line
/// is 13 % above that. Frames of another exposure at the target (or another one for each frame, as automatic exposure has them) do not carry it, and that is said; nor do none, or those that stay as they are.
#[test]
fn a_background_that_is_carried_is_told_from_one_on_a_line() {
    let grown = |s: f64| 3_f64.powf(s / 200.0);
    let bins: Vec<Bin> =
        (0..200).map(|s| bin(s, (30.0 + 1e5 * grown(s as f64 + 0.5)).round() as u64)).collect();
    let spans = Spans::new([
        span(0.0, 20.0, View::Sky),
        span(20.0, 180.0, View::Target(0)),
        span(180.0, 200.0, View::Sky),
    ]);
    let channels = [channel(&DeadTime::None, None)];
    let taken = |levels: &dyn Fn(f64) -> Option<(f64, usize)>| {
        let Ok(off) = OffTarget::measure(ok(&bins), &channels, &spans, &OffOptions::default());
        let frames = (0..100).filter_map(|i| {
            let s = 2.0 * f64::from(i) + 1.0;
            let (level, setting) = levels(s)?;
            Some(SkyLevel { time: at(s), level, sigma: 0.05, setting })
        });
        let off = off.carried_by(SkyLevels::new(frames));
        let options = Options { gate: NO_GATE, ..Options::default() };
        let mut run = Reduction::new(ok(&bins), &channels, &spans, &[], &off, options);
        let samples: Vec<Sample> = run.by_ref().map(|sample| sample.unwrap()).collect();
        let mut tally = SkyTally::default();
        samples.iter().for_each(|sample| tally.add(&sample.channels[0]));
        (samples[79].channels[0], tally)
    };
    let (middle, line) = (30.0 + 1e5 * grown(99.5), 30.0 + 0.5e5 * (grown(10.0) + grown(190.0)));
    let at_target = |s: f64| (20.0..180.0).contains(&s);
    let level = |s: f64| 50.0 * grown(s).powf(1.0 / 1.1);
    let (sample, tally) = taken(&|s| Some((level(s), 0)));
    assert_eq!(sample.background_from, Some(BackgroundSource::Carried));
    assert!((sample.background_hz.value / middle - 1.0).abs() < 1e-3, "{sample:?} {middle}");
    assert_eq!((tally.carried, tally.on_line(), tally.doubt()), (160, 0, None));
    let on_line: [(Frames<'_>, NotCarried); 5] = [
        (&|s| Some((level(s), usize::from(at_target(s)))), NotCarried::OtherSettings),
        (&|s| Some((level(s), s as usize)), NotCarried::OtherSettings),
        (&|s| (!at_target(s)).then(|| (level(s), 0)), NotCarried::NoFrames),
        (&|_| None, NotCarried::NoFrames),
        (&|_| Some((50.0, 0)), NotCarried::OtherChange),
    ];
    for (levels, why) in on_line {
        let (sample, tally) = taken(levels);
        assert_eq!(sample.background_from, Some(BackgroundSource::OnLine(why)));
        assert!((sample.background_hz.value / line - 1.0).abs() < 0.01, "{sample:?} {line}");
        assert!(tally.on_line() > 140 && tally.carried < 20, "{tally:?}");
        assert_eq!(tally.reason(), Some(why));
        // The line is a quarter of the change uncertain in the middle, 17 % in the mean; nothing but sky is in the rates.
        assert!(tally.doubt().unwrap() > 1.0, "{tally:?}");
    }
}

/// Truth: by hand. The target moves from (−6, 0) to (6, 0) px in frames a second apart; σ = (3, 4), the centre at (0, 0). At 2.5 s (bin 2…3) it passes from x = −1.2 to
/// 1.2 or so: the coupling is the mean of exp(−x²/18) over the bin (erf, by 1,000 steps).
#[test]
fn the_gate_keeps_and_the_coupling_divides() {
    let places: Vec<_> = (0..=5).map(|i| Some(place(-6.0 + 2.4 * f64::from(i), 0.0))).collect();
    let fibre = Fibre { offset_px: [0.0; 2].into(), sigma_px: [3.0, 4.0].into() };
    let channels = [channel(&DeadTime::None, Some(fibre))];
    let bins: Vec<Bin> = (0..6).map(|s| bin(s, 10_030)).collect();
    let spans = [span(0.0, 6.0, View::Target(0))];
    let (samples, summary) =
        reduce(&bins, &channels, &spans, &[track(&places)], Gate::default(), OffOptions::default());
    let flags: Vec<Flags> =
        samples.iter().map(|s| s.channels[0].flags - Flags::NO_OFF_TARGET).collect();
    // q at the middles: x = −4.8, −2.4, 0, 2.4, 4.8, and none after the last frame.
    let (on, off) = (Flags::empty(), Flags::OFF_AXIS);
    assert_eq!(flags, [off, on, on, on, off, Flags::UNDETECTED]);
    let mean = |from: f64| {
        (0..1000)
            .map(|i| (-(from + 2.4 * (f64::from(i) + 0.5) / 1000.0).powi(2) / 18.0).exp())
            .sum::<f64>()
            / 1000.0
    };
    for (i, sample) in samples.iter().enumerate() {
        let channel = &sample.channels[0];
        if flags[i].is_empty() {
            let coupling = mean(-6.0 + 2.4 * i as f64);
            assert!((channel.coupling.value - coupling).abs() < 1e-5, "{channel:?} {coupling}");
            assert!((channel.rate_hz - 10_000.0 / coupling).abs() < 0.2);
        } else {
            assert!(channel.rate_hz.is_nan() && channel.measured_hz.value == 10_030.0);
        }
    }
    assert_eq!((summary.channels[0].with_rate, summary.channels[0].flags["OFF_AXIS"]), (3, 2));
    let switched = Gate { divide: false, ..Gate::default() };
    let (samples, _) =
        reduce(&bins, &channels, &spans, &[track(&places)], switched, OffOptions::default());
    assert!((samples[1].channels[0].rate_hz - 10_000.0).abs() < 1e-9);
    let (samples, _) = reduce(&bins, &channels, &spans, &[], NO_GATE, OffOptions::default());
    assert!(samples.iter().all(|s| (s.channels[0].rate_hz - 10_000.0).abs() < 1e-9));
    // A frame that lost the target, a single frame, no frame.
    for places in [[places[0], None, places[2]].as_slice(), &places[..1], &[]] {
        let (samples, _) = reduce(
            &bins[..2],
            &channels,
            &spans,
            &[track(places)],
            Gate::default(),
            OffOptions::default(),
        );
        assert!(samples.iter().all(|s| s.channels[0].flags.contains(Flags::UNDETECTED)));
    }
}

/// Truth: the mean and the scatter of exp(−q/2) over 40,000 places on a lattice of a normal distribution's quantiles (product of two), to 1e-3.
#[test]
fn an_uncertain_place_spreads_the_coupling() {
    let fibre = Fibre { offset_px: [1.0, -2.0].into(), sigma_px: [3.0, 5.0].into() };
    let place = Place { offset_px: [3.0, 1.0].into(), covariance_px2: [1.44, 0.81, 0.6] };
    // Cholesky's factor of the covariance, by hand: 1.2, 0.5, √(0.81 − 0.25).
    let (mut sum, mut sum2, mut weight) = (0.0, 0.0, 0.0);
    for i in -100..=100 {
        for j in -100..=100 {
            let (a, b) = (0.06 * f64::from(i), 0.06 * f64::from(j));
            let w = (-0.5 * (a * a + b * b)).exp();
            let (x, y) = (2.0 + 1.2 * a, 3.0 + 0.5 * a + 0.56_f64.sqrt() * b);
            let c = (-0.5 * (x * x / 9.0 + y * y / 25.0)).exp();
            sum += w * c;
            sum2 += w * c * c;
            weight += w;
        }
    }
    let mean = sum / weight;
    let found = coupling(&fibre, &place);
    assert!((found.mean - mean).abs() < 1e-6, "{found:?} {mean}");
    assert!((found.sigma - (sum2 / weight - mean * mean).sqrt()).abs() < 1e-6, "{found:?}");
}

/// Truth: what was put in: each flag of a record, and what it does to the rate.
#[test]
fn what_the_counter_says_is_carried_over() {
    let mut bins: Vec<Bin> = (0..12).map(|s| bin(s, 1000)).collect();
    let given = [
        (1, CountFlags::OVERFLOW, Flags::OVERFLOW, true),
        (2, CountFlags::CLOCK_FREE, Flags::CLOCK_FREE, true),
        (3, CountFlags::SATURATED, Flags::SATURATED, false),
        (4, CountFlags::ERROR, Flags::GAP, false),
        (6, CountFlags::PARTIAL, Flags::empty(), true),
        (7, CountFlags::GAP, Flags::GAP, true),
    ];
    for (i, flag, ..) in given {
        bins[i].record.flags |= flag;
    }
    bins[5].record.missed[0] = 7;
    bins[8].record.counts[0] = 0;
    bins[9].record.length_ps = 0;
    let spans = [span(0.0, 11.5, View::Target(0))];
    let channels = [channel(&DeadTime::None, None)];
    let (samples, summary) = reduce(&bins, &channels, &spans, &[], NO_GATE, OffOptions::default());
    let of =
        |second: f64| samples.iter().find(|s| s.time == at(second + 0.5)).map(|s| s.channels[0]);
    let flags = |second: usize| of(second as f64).unwrap().flags - Flags::NO_OFF_TARGET;
    for (i, _, flag, has_rate) in given {
        assert_eq!(flags(i), flag, "{i}");
        assert_eq!(of(i as f64).unwrap().rate_hz.is_finite(), has_rate, "{i}");
    }
    assert_eq!(flags(5), Flags::OVERFLOW);
    // Nothing counted is a rate, below the dark rate, with the uncertainty of one count.
    let nothing = of(8.0).unwrap();
    assert!(nothing.rate_hz == -30.0 && nothing.sigma_hz == 1.0, "{nothing:?}");
    // The last bin leaves the visit halfway.
    assert_eq!((flags(11), of(11.0).unwrap().rate_hz.is_nan()), (Flags::OFF_TARGET, true));
    assert_eq!((summary.bins, summary.without_length, summary.channels[0].samples), (12, 1, 12));
    let text = summary.to_string();
    assert!(
        text.starts_with(
            "12 bins, 0 of no visit, 1 without length, 0 overlapping\nspad: 12 samples, "
        ),
        "{text}"
    );
}

/// Truth: bins 3 to 5 were never there: one sample of 3 s stands for them; a bin that comes twice is counted; both are no neighbours.
#[test]
fn missing_bins_are_one_gap() {
    let mut bins: Vec<Bin> = [0, 1, 2, 6, 7, 7].map(|s| bin(s, 1000)).to_vec();
    bins[3].record.flags |= CountFlags::GAP;
    let spans = [span(0.0, 10.0, View::Target(0))];
    let channels = [channel(&DeadTime::None, None)];
    let (samples, summary) = reduce(&bins, &channels, &spans, &[], NO_GATE, OffOptions::default());
    assert_eq!((samples.len(), summary.overlapping), (7, 1));
    let gap = &samples[3];
    assert_eq!((gap.time, gap.exposure_s), (at(4.5), 3.0));
    assert!(gap.channels[0].flags == Flags::GAP && gap.channels[0].measured_hz.value.is_nan());
    assert_eq!(samples[4].channels[0].flags, Flags::NO_OFF_TARGET);
    // As light curves, which say no number that they do not have.
    let mut curves = Curves::new(&channels);
    samples.iter().for_each(|sample| curves.push(sample));
    for curve in curves.finish(Provenance::default()) {
        let table = curve.to_table().unwrap();
        let back = LightCurve::from_table("c.ecsv", &table).unwrap();
        assert_eq!((back.kind, back.len()), (curve.kind, 7));
        assert_eq!(back.channels[0].flags, curve.channels[0].flags);
    }
}

/// Truth: by hand: frames 3 to 6 are away or empty, frame 8 alone.
#[test]
fn off_target_stretches_are_found_in_frames() {
    let near = Some(place(1.0, 0.0));
    let far = Some(place(90.0, 0.0));
    let places = [near, near, near, far, far, None, far, near, far, near];
    let options =
        Away { distance_px: 60.0, from_px: [0.0; 2].into(), undetected: true, least_s: 1.0 };
    let found = away(&track(&places), &options);
    assert_eq!(found, [span(3.0, 6.0, View::Sky)]);
    let detected = Away { undetected: false, ..options };
    assert_eq!(away(&track(&places), &detected), [span(3.0, 4.0, View::Sky)]);
    // Within a visit they are the background, and the samples there are none of the target.
    let spans = Spans::new([span(0.0, 9.0, View::Target(4)), found[0]]);
    assert_eq!(spans.seen(at(4.0), at(5.0)), Seen::Whole(View::Sky, 0));
    assert_eq!(spans.seen(at(2.5), at(3.5)), Seen::Partly(4));
    assert_eq!(spans.seen(at(1.0), at(2.0)), Seen::Whole(View::Target(4), 0));
    assert_eq!(spans.seen(at(9.5), at(9.6)), Seen::Nothing);
    assert_eq!((spans.visit_at(at(4.0)), spans.visit_at(at(9.0))), (Some(4), None));
}

/// Truth: by hand: a quarter of the way, variances (¾)² and (¼)² of theirs, and the Brownian bridge's ¼·¾·2 s·D.
#[test]
fn a_place_between_frames_has_the_uncertainty_of_both() {
    let with = |x: f64, variance: f64| {
        Some(Place {
            offset_px: [x, 2.0 * x].into(),
            covariance_px2: [variance, 2.0 * variance, 0.5 * variance],
        })
    };
    let mut track = track(&[with(1.0, 0.16), with(3.0, 0.32), None]);
    track.points[1].time = at(2.0);
    track.points[2].time = at(4.0);
    let found = track.at(at(0.5), 10.0, 0.4).unwrap();
    assert_eq!(found.place.offset_px.to_array(), [1.5, 3.0]);
    assert_eq!(found.drift_px_per_s.to_array(), [1.0, 2.0]);
    let variance = 0.5625 * 0.16 + 0.0625 * 0.32;
    let bridge = 0.1875 * 2.0 * 0.4;
    let expected = [variance + bridge, 2.0 * variance + bridge, 0.5 * variance];
    for (found, expected) in found.place.covariance_px2.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12);
    }
    assert_eq!(track.at(at(3.0), 10.0, 0.0), Err(NoPlace::Undetected));
    assert_eq!(track.at(at(1.0), 1.0, 0.0), Err(NoPlace::Apart));
    assert_eq!(track.at(at(-1.0), 10.0, 0.0), Err(NoPlace::Outside));
    assert_eq!(track.at(at(4.5), 10.0, 0.0), Err(NoPlace::Outside));
    assert_eq!(track.at(at(0.0), 10.0, 0.0).unwrap().place.offset_px.to_array(), [1.0, 2.0]);
    assert!(track.is_in_order());
}

/// Truth: a random walk of 0.5 px²/s per axis, drawn step by step, seen with 0.2 px of noise: found to 15 % (1,000 frames; the median's own noise is 6 %), with a tenth of
/// the detections wrong to 40 %. A straight way with the same noise wanders by less than a twentieth of it.
#[test]
fn a_wander_is_found() {
    use rand::{RngExt as _, SeedableRng as _};
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(8);
    let mut normal = || {
        let (a, b) = (random.random::<f64>(), random.random::<f64>());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let mut walk = |step: f64, wrong: usize| {
        let (mut x, mut y) = (0.0, 0.0);
        let places: Vec<_> = (0..1000)
            .map(|i| {
                x += step * normal() + 0.3;
                y += step * normal();
                let off = if i % wrong == 7 { 30.0 } else { 0.0 };
                let offset_px = [x + 0.2 * normal() + off, y + 0.2 * normal()].into();
                Some(Place { offset_px, covariance_px2: [0.04, 0.04, 0.0] })
            })
            .collect();
        track(&places).wander_px2_per_s()
    };
    let found = walk(0.5_f64.sqrt(), 10_000);
    assert!((found / 0.5 - 1.0).abs() < 0.15, "{found}");
    let found = walk(0.5_f64.sqrt(), 20);
    assert!((found / 0.5 - 1.0).abs() < 0.4, "{found}");
    assert!(walk(0.0, 10_000) < 0.025);
}

/// Truth: the bins that were made: ten hours of 0.1 s, made and used one by one, half of each minute on a target. Each of the bins comes out once, in
/// order, or is said to lie outside.
#[test]
fn a_night_loses_and_doubles_nothing() {
    let night = || {
        (0..360_000_i64).map(|i| {
            let mut bin = bin(0, 100 + (i % 7) as u64);
            bin.record.start = at(0.1 * i as f64);
            bin.record.start_ps = i * 100_000_000_000;
            bin.record.length_ps = 100_000_000_000;
            Ok::<_, Infallible>(bin)
        })
    };
    let minute = |i: i32| {
        let from = 60.0 * f64::from(i);
        let sky = if i % 5 == 0 { View::Sky } else { View::Dark };
        [span(from, from + 30.0, View::Target(i as usize)), span(from + 30.0, from + 60.0, sky)]
    };
    let spans = Spans::new((0..600).flat_map(minute));
    let channels = [channel(&DeadTime::None, None)];
    let Ok(off) = OffTarget::measure(night(), &channels, &spans, &OffOptions::default());
    assert_eq!(off.pieces().len(), 600);
    let options = Options { gate: NO_GATE, ..Options::default() };
    let mut run = Reduction::new(night(), &channels, &spans, &[], &off, options);
    let (mut samples, mut last) = (0, at(-1.0));
    for sample in run.by_ref() {
        let Ok(sample) = sample;
        assert!(sample.time > last && sample.channels[0].rate_hz.abs() < 70.0);
        (last, samples) = (sample.time, samples + 1);
    }
    let summary = run.summary();
    assert_eq!((summary.bins, samples + summary.outside), (360_000, 360_000));
    assert_eq!(samples, summary.channels[0].samples);
    // A bin that begins on a span's edge by rounding may lie on either side of it.
    assert!(samples.abs_diff(180_000) <= 600, "{samples}");
}
