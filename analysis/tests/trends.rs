//! Removal of a pass's trends from the light; and how far the spin's period may be from the one that is seen.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::{Duration, Epoch};
use std::f64::consts::TAU;
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Bisectors;
use sunglint_analysis::trend::{TrendError, Ways, air_factor, divide, phase_trend, range_factor};
use sunglint_radiometry::air::{Air, Sampling, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples,
};
use sunglint_radiometry::station::Station;

/// 600 samples of 600 s: range and phase angle run, light of two lobes a turn of 15 s times what range and phase do to it.
fn curve(by_phase: impl Fn(f64) -> f64) -> LightCurve {
    let start = Epoch::from_gregorian_utc(2020, 11, 18, 18, 0, 0, 0);
    let seconds: Vec<f64> = (0..600).map(f64::from).collect();
    let range: Vec<f64> = seconds.iter().map(|t| 8e5 + 10.0 * (t - 300.0).powi(2)).collect();
    let phase: Vec<f64> = seconds.iter().map(|t| 30.0 + 0.15 * t).collect();
    let rate = seconds.iter().zip(range.iter().zip(&phase)).map(|(t, (r, p))| {
        let turn = 1.0 + 0.5 * (TAU * t / 15.0).cos() + 0.2 * (2.0 * TAU * t / 15.0).sin();
        1e4 * turn * (1e6 / r).powi(2) * by_phase(*p)
    });
    let channel = ChannelCurve {
        name: "spcm".into(),
        rate_hz: rate.collect(),
        sigma_hz: vec![100.0; 600],
        flags: vec![Flags::empty(); 600],
        model_error_hz: None,
        common_sigma_hz: None,
    };
    let time = seconds.iter().map(|t| start + Duration::from_seconds(*t)).collect();
    LightCurve {
        kind: RateKind::Calibrated,
        samples: Samples {
            range_m: Some(range),
            phase_deg: Some(phase),
            ..Samples::new(time, 0.1)
        },
        channels: vec![channel],
        provenance: Provenance::default(),
        other: Default::default(),
    }
}

/// Truth: the magnitudes that were put in, −0.8 + 1.1 x + 0.4 x² with x the phase angle from its middle over 90°. Tolerance: 0.01 mag a 90°: the turn's ripple averages to that over stretches of
/// 50 s, and a stretch's mean is of its light, not of its magnitude.
#[test]
fn range_and_phase_are_removed() {
    let mut curve = curve(|p| {
        let x = (p - 74.925) / 90.0;
        10_f64.powf(-0.4 * (-0.8 + 1.1 * x + 0.4 * x * x))
    });
    let range = range_factor(&curve).unwrap();
    divide(&mut curve.channels[0], &range);
    // At 1,000 km nothing changes: the range there is 800 km + 10 · t² m.
    let at =
        curve.samples.range_m.as_ref().unwrap().iter().position(|r| (r - 1e6).abs() < 3e3).unwrap();
    assert!((range[at] - 1.0).abs() < 7e-3);
    let trend = phase_trend(&curve, &curve.channels[0]).unwrap();
    assert!((trend.middle_deg - 74.925).abs() < 1e-9);
    assert!((trend.magnitudes[0] - 1.1).abs() < 0.03, "{:?}", trend.magnitudes);
    assert!((trend.magnitudes[1] - 0.4).abs() < 0.1, "{:?}", trend.magnitudes);
    divide(&mut curve.channels[0], &trend.factor);
    let mean =
        |of: std::ops::Range<usize>| curve.channels[0].rate_hz[of].iter().sum::<f64>() / 60.0;
    // Four whole turns at either end and in the middle.
    let (first, middle, last) = (mean(0..60), mean(270..330), mean(540..600));
    assert!((first / middle - 1.0).abs() < 0.01 && (last / middle - 1.0).abs() < 0.01);
    // 1.1 mag/90° over 90° is a factor of 2.75: before, it was there.
    assert!((trend.factor[0] / trend.factor[599] - 10_f64.powf(0.4 * 1.1)).abs() < 0.1);
}

#[test]
fn what_is_not_known_is_said() {
    let mut dark = curve(|_| 1.0);
    dark.channels[0].rate_hz[100..200].fill(-5.0);
    let error = phase_trend(&dark, &dark.channels[0]).unwrap_err();
    assert!(matches!(error, TrendError::NotPositive { samples: 50, .. }), "{error}");
    dark.samples.range_m = None;
    assert_eq!(range_factor(&dark).unwrap_err().to_string(), "the light curve has no range_m");
    dark.samples.phase_deg = Some(vec![40.0; 600]);
    let error = phase_trend(&dark, &dark.channels[0]).unwrap_err();
    assert!(matches!(error, TrendError::Flat { samples: 600, .. }), "{error}");
}

/// Truth: a weighted mean of the transmission lies between its extremes over the channel; the mean of its square between the square of the mean (Jensen) and the mean. Interpolated angles meet
/// those computed one by one; tolerance 1e-4, that of the air's own tables.
#[test]
fn the_airs_factor_is_a_mean_of_its_transmission() {
    let station = Station::built_in("ufo").unwrap().unwrap();
    let air = Air::new(&station.air_options().unwrap()).unwrap();
    let channel = station.channel("g").unwrap();
    let angles: Vec<f64> = (0..200).map(|k| 0.4 * f64::from(k)).collect();
    let factor = |angles: &[f64], ways| {
        air_factor(&station, channel, sun_at_1_au(), &air, angles, ways).unwrap()
    };
    let (once, twice) = (factor(&angles, Ways::Once), factor(&angles, Ways::Twice));
    for k in [0, 77, 150, 199] {
        let alone = factor(&angles[k..=k], Ways::Once)[0];
        assert!((once[k] / alone - 1.0).abs() < 1e-4, "{}: {} {alone}", angles[k], once[k]);
        let sampling = Sampling::native(350.0, 750.0).unwrap();
        let all = air.transmission(Zenith::True(angles[k]), &sampling).unwrap();
        let most = all.iter().copied().fold(0.0, f64::max);
        assert!(once[k] > 0.0 && once[k] < most, "{}: {}", angles[k], once[k]);
        assert!(twice[k] >= once[k].powi(2) * (1.0 - 1e-9) && twice[k] < once[k]);
    }
    assert!(once.windows(2).all(|w| w[1] < w[0]), "lower is dimmer");
    assert!(air_factor(&station, channel, sun_at_1_au(), &air, &[95.0], Ways::Once).is_err());
}

/// Truth: Sun and observer turn together by 0.6 deg/s in a plane, and so does their bisector: a body of 20 s turns by 360 ± 12 degrees a period, 1/P = 1/20 ± 0.6/360 1/s.
#[test]
fn the_bisector_bounds_the_sidereal_period() {
    let at = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(cos, sin, 0.0)
    };
    let moments: Vec<_> =
        (0..=100).map(f64::from).map(|t| (t, at(0.6 * t), at(0.6 * t + 50.0))).collect();
    let path = Bisectors::new(&moments).unwrap();
    let found = path.bounds(20.0);
    assert!((found.fastest_deg_s - 0.6).abs() < 1e-9 && (found.moved_deg - 60.0).abs() < 1e-9);
    let by = 0.6 / 360.0;
    assert!((found.from_to_s.0 - 1.0 / (0.05 + by)).abs() < 1e-9);
    assert!((found.from_to_s.1 - 1.0 / (0.05 - by)).abs() < 1e-9);
    assert_eq!(path.bounds(1e4).from_to_s.1, f64::INFINITY);
    assert!(Bisectors::new(&moments[..1]).is_none());
    assert!(Bisectors::new(&[(0.0, at(0.0), at(180.0)), (1.0, at(0.0), at(90.0))]).is_none());
    // About the plane's normal it turns evenly, by 1/6 of a turn; about the opposite axis the other way; and not about an axis that it meets.
    let turn = path.turned(DVec3::Z).unwrap();
    assert!(
        (turn.at(50.0) - 30.0 / 360.0).abs() < 1e-12 && (turn.at(1e3) - 1.0 / 6.0).abs() < 1e-12
    );
    assert!((path.turned(-DVec3::Z).unwrap().at(50.0) + 30.0 / 360.0).abs() < 1e-12);
    assert!(path.turned(at(25.0)).is_none() && path.turned(DVec3::ZERO).is_none());
    let (slope_hz, bend) = turn.split();
    assert!((slope_hz - by).abs() < 1e-12 && bend.most() < 1e-12);
}

/// Truth: a bisector of given longitude and latitude about an axis: its turn is that longitude, over whole turns too; on its clock a body of 7 s shows the same face every 7 s.
#[test]
fn a_clock_goes_with_the_body() {
    let longitude = |t: f64| 0.9 * t / 100.0 + 0.3 * (t / 40.0).sin();
    let moments: Vec<_> = (0..=1000)
        .map(|k| 0.2 * f64::from(k))
        .map(|t| {
            let (sin, cos) = (std::f64::consts::TAU * longitude(t)).sin_cos();
            let direction = DVec3::new(0.8 * cos, 0.8 * sin, 0.6);
            (t, direction, direction)
        })
        .collect();
    let turn = Bisectors::new(&moments).unwrap().turned(DVec3::new(0.0, 0.0, 2.0)).unwrap();
    for k in 0..50 {
        // Between moments the line errs by at most h²/8 times the second derivative, 0.2²/8 · 0.3/40².
        let t = 4.03 * f64::from(k);
        let error = turn.at(t) - (longitude(t.min(200.0)) - longitude(0.0));
        assert!(error.abs() < 1e-6, "{t}: {error:e}");
    }
    // Moments at which t/7 − λ(t) is whole: on the clock they are 7 s apart.
    let mut at = 0.0;
    let seen: Vec<f64> = (0..20)
        .map(|k| {
            for _ in 0..200 {
                at = 7.0 * (f64::from(k) + longitude(at));
            }
            at
        })
        .collect();
    let series = Series::new("c", &seen, &[1.0; 20], None).unwrap();
    let clocked = turn.clocked(&series, 1.0 / 7.0).unwrap();
    for pair in clocked.time_s.windows(2) {
        assert!((pair[1] - pair[0] - 7.0).abs() < 2e-5, "{pair:?}");
    }
    // A body that turns more slowly than the bisector would see its clock run backwards.
    assert!(turn.clocked(&series, 1e-3).is_none());
}
