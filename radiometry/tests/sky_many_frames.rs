//! Frames at many epochs of a night.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use hifitime::Unit;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::{EarthOrientation, SkyFrame, SkyFrames};

/// Truth: the frame calculated in full, itself held against astropy. Promised: 1e-10 rad and 1 m; at the middle of every hour
/// of 60 days, where linear interpolation is worst, over a fortnight of nutation and more; and through the leap second of
/// 2016.
#[test]
fn shared_frames_are_the_frames() {
    let (mut angle, mut metres, mut speed, mut origins) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for (start, hours, step) in [("2026-01-10T03:00:00Z", 1440, 13), ("2016-12-31T22:10:00Z", 4, 1)]
    {
        let from = parse_utc(start).unwrap();
        let earth = EarthOrientation::embedded();
        let frames = SkyFrames::over(from, from + f64::from(hours) * Unit::Hour, earth).unwrap();
        for hour in (0..hours).step_by(step) {
            for part in [0.0, 0.5, 0.83] {
                let epoch = from + (f64::from(hour) + part) * Unit::Hour;
                let (ours, full) =
                    (frames.at(epoch).unwrap(), SkyFrame::new(epoch, earth).unwrap());
                let difference = ours.gcrs_to_itrs() - full.gcrs_to_itrs();
                for axis in [difference.x_axis, difference.y_axis, difference.z_axis] {
                    angle = angle.max(axis.length());
                }
                let sun = ours.sun_position_gcrs_m() - full.sun_position_gcrs_m();
                metres = metres.max(sun.length());
                speed = speed.max((ours.earth_velocity_m_s() - full.earth_velocity_m_s()).length());
                origins = origins
                    .max((ours.equation_of_origins_rad() - full.equation_of_origins_rad()).abs());
                assert_eq!(ours.times(), full.times());
                assert_eq!(ours.tirs_to_itrs(), full.tirs_to_itrs());
                if part == 0.0 {
                    assert!(angle < 1e-10);
                }
            }
        }
    }
    println!(
        "at most {angle:.1e} rad, {metres:.1e} m of the Sun, {speed:.1e} m/s, origins {origins:.1e} rad"
    );
    assert!(angle < 1e-10 && metres < 1.0 && speed < 1e-3 && origins < 1e-10);
}

/// Truth: the frame calculated in full. 1e-10 rad as in a stretch, and 2 m of the Sun (1e-11 rad), with epochs all over half a year in no order, beside them by an exposure, and
/// around the leap second of 2016; where knots would be more than epochs, or before the first leap second, frames are the full ones to the bit.
#[test]
fn frames_of_scattered_epochs_are_the_frames() {
    let earth = EarthOrientation::embedded();
    let (mut angle, mut metres, mut speed, mut origins) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for (start, days) in [("2025-12-20T03:00:00Z", 180.0), ("2016-12-29T22:10:00Z", 60.0)] {
        let from = parse_utc(start).unwrap();
        let spread = |k: u32| f64::from(k).mul_add(0.618_033_988_749_894_9, 0.3).fract();
        let epochs: Vec<_> =
            (0..2000).map(|k| from + spread(k) * days * 24.0 * Unit::Hour).collect();
        let frames = SkyFrames::among(&epochs, earth).unwrap();
        let mut exact = 0;
        for epoch in epochs.iter().flat_map(|e| [*e, *e + 7.0 * Unit::Second]) {
            let (ours, full) = (frames.at(epoch).unwrap(), SkyFrame::new(epoch, earth).unwrap());
            let difference = ours.gcrs_to_itrs() - full.gcrs_to_itrs();
            exact += usize::from(difference == glam::DMat3::ZERO);
            for axis in [difference.x_axis, difference.y_axis, difference.z_axis] {
                angle = angle.max(axis.length());
            }
            let sun = ours.sun_position_gcrs_m() - full.sun_position_gcrs_m();
            metres = metres.max(sun.length());
            speed = speed.max((ours.earth_velocity_m_s() - full.earth_velocity_m_s()).length());
            origins = origins
                .max((ours.equation_of_origins_rad() - full.equation_of_origins_rad()).abs());
            assert_eq!(ours.times(), full.times());
            assert_eq!(ours.tirs_to_itrs(), full.tirs_to_itrs());
        }
        assert!(exact < 400, "{exact} of 4,000 frames were calculated in full");
    }
    println!(
        "at most {angle:.1e} rad, {metres:.1e} m of the Sun, {speed:.1e} m/s, origins {origins:.1e} rad"
    );
    assert!(angle < 1e-10 && metres < 2.0 && speed < 1e-3 && origins < 1e-10);

    let few: Vec<_> = [0.0, 40.0, 80.0]
        .map(|days| parse_utc("1972-01-01T00:00:05Z").unwrap() + days * 24.0 * Unit::Hour)
        .to_vec();
    let many: Vec<_> =
        few.iter().flat_map(|e| (0..100).map(move |k| *e + f64::from(k) * Unit::Second)).collect();
    for epochs in [few, many] {
        let frames = SkyFrames::among(&epochs, earth).unwrap();
        for epoch in epochs {
            let (ours, full) = (frames.at(epoch).unwrap(), SkyFrame::new(epoch, earth).unwrap());
            assert_eq!(ours.gcrs_to_itrs(), full.gcrs_to_itrs());
        }
    }
}

#[test]
fn outside_the_stretch_frames_are_calculated_in_full() {
    let earth = EarthOrientation::embedded();
    let from = parse_utc("2024-08-12T22:30:00Z").unwrap();
    let frames = SkyFrames::over(from, from + 10.0 * Unit::Minute, earth).unwrap();
    for epoch in [from - 1.0 * Unit::Second, from + 3.0 * Unit::Hour] {
        let (ours, full) = (frames.at(epoch).unwrap(), SkyFrame::new(epoch, earth).unwrap());
        assert_eq!(ours.gcrs_to_itrs(), full.gcrs_to_itrs());
        assert_eq!(ours.sun(), full.sun());
    }
    let late = parse_utc("2100-06-01").unwrap();
    assert!(SkyFrames::over(from, late, earth).is_err() && frames.at(late).is_err());
}
