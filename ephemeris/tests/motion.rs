//! Rates of targets in the axes of mounts.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use hifitime::{Epoch, Unit};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::motion::{AxisMotion, Motion, equatorial_axes, horizontal_axes};
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
use sunglint_ephemeris::passes::{Conditions, Search};
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site};
use sunglint_radiometry::station::Horizon;
use sunglint_testkit::{peer_python, run_python};

const ISS: &str = "ISS (ZARYA)
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
";

fn site() -> Site {
    Site::new(Geodetic { latitude_deg: 48.78, longitude_deg: 9.2, height_m: 399.0 }).unwrap()
}

fn wrapped(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

/// Moments of passes, every 7 s.
fn moments(orbit: &Orbit, from: Epoch) -> Vec<Epoch> {
    let (site, earth) = (site(), EarthOrientation::embedded());
    let conditions = Conditions { min_altitude_deg: 10.0, sun_below_deg: 90.0 };
    let window = (from, from + 1.0 * Unit::Day);
    let search = Search::new(&site, &Horizon::Flat(0.0), window, conditions, earth).unwrap();
    let passes = search.passes(orbit).passes;
    let times = passes.iter().flat_map(|pass| {
        let count = (pass.span.seconds() / 7.0) as i32;
        (0..count).map(|i| pass.span.from + f64::from(i) * 7.0 * Unit::Second)
    });
    times.collect()
}

/// Truth: central differences of the places that `Geometry` gives, ±50 ms. Their own error is 1e-8 rad/s at 1.2 °/s (the third derivative times dt²/6), and SGP4's velocity is not quite the
/// derivative of its place (a centimetre a second, 4e-8 rad/s at 400 km). 1e-7 rad/s is 0.02″/s.
#[test]
fn rates_are_the_differences_of_places() {
    let elements = tle::parse("iss.tle", ISS).unwrap().remove(0);
    let from = elements.epoch;
    let orbit = Orbit::from(TleOrbit::new(elements).unwrap());
    let moments = moments(&orbit, from);
    assert!(moments.len() > 150, "{}", moments.len());
    let enu_at = |epoch: Epoch| {
        let observer = Observer::at(epoch, &site(), EarthOrientation::embedded()).unwrap();
        Geometry::at(&orbit, &observer).unwrap().horizontal.east_north_up()
    };
    let (mut worst, mut fastest) = (0.0_f64, 0.0_f64);
    for epoch in moments {
        let observer = Observer::at(epoch, &site(), EarthOrientation::embedded()).unwrap();
        let motion = Motion::at(&orbit, &observer).unwrap();
        let [before, after] = [-0.05, 0.05].map(|s| enu_at(epoch + s * Unit::Second));
        worst = worst.max((motion.enu_per_s - (after - before) / 0.1).length());
        fastest = fastest.max(motion.enu_per_s.length());
        for equatorial in [false, true] {
            let turned = |enu| if equatorial { equatorial_axes(enu, 48.78) } else { enu };
            let [a, b] = [before, after].map(|enu| AxisMotion::of(turned(enu), enu).angle_deg);
            let got = if equatorial { motion.equatorial(48.78) } else { motion.horizontal() };
            let first = wrapped(b[0] - a[0]) / 0.1;
            let second = (b[1] - a[1]) / 0.1;
            assert!(
                (got.deg_s[0] - first).abs() < 1e-5 * (1.0 + first.abs().powi(3)),
                "{epoch} {got:?} {first}"
            );
            assert!(
                (got.deg_s[1] - second).abs() < 1e-5 * (1.0 + first.abs().powi(2)),
                "{epoch} {got:?} {second}"
            );
        }
    }
    eprintln!("worst {worst:.1e} rad/s of at most {fastest:.4} rad/s");
    assert!(worst < 1e-7, "{worst:e}");
}

/// Truth: arithmetic: the celestial pole stands at the site's latitude in the north; the way back is the way there.
#[test]
fn axes_of_the_equator_turn_back() {
    let latitude = 48.78_f64;
    let pole = glam::DVec3::new(0.0, latitude.to_radians().cos(), latitude.to_radians().sin());
    assert!((equatorial_axes(pole, latitude) - glam::DVec3::Z).length() < 1e-15);
    let west = AxisMotion::of(equatorial_axes(-glam::DVec3::X, latitude), glam::DVec3::ZERO);
    assert!(
        (west.angle_deg[0] - 90.0).abs() < 1e-12,
        "the west point stands at an hour angle of 6 h"
    );
    let any = glam::DVec3::new(0.3, -0.5, 0.7).normalize();
    assert!((horizontal_axes(equatorial_axes(any, latitude), latitude) - any).length() < 1e-15);
}

/// Truth: Skyfield's places of station and satellite (with sgp4), the light taken back along the line: differences of the angles over ±20 ms. Places differ by some arcsec (UT1, the
/// microseconds of Skyfield's times, aberration), and a rate of the first axis with them, by that over the distance from the pole of the axes: 3e-4 of itself at 8°.
#[test]
fn rates_are_skyfields() {
    let Some(python) = peer_python("rates_are_skyfields", &["skyfield", "sgp4"]) else { return };
    let elements = tle::parse("iss.tle", ISS).unwrap().remove(0);
    let orbit = Orbit::from(TleOrbit::new(elements.clone()).unwrap());
    let moments = moments(&orbit, elements.epoch);
    let chosen: Vec<Epoch> = moments.into_iter().step_by(10).collect();
    let times: Vec<String> =
        chosen.iter().map(|t| format!("{:.9}", t.to_mjd_utc_days() - 40_587.0)).collect();
    let lines: Vec<&str> = ISS.lines().collect();
    let script = r#"
import sys
import numpy as np
from datetime import datetime, timedelta, timezone
from skyfield.api import EarthSatellite, load, wgs84
ts = load.timescale(builtin=True)
l1, l2, times = sys.argv[1:4]
sat = EarthSatellite(l1, l2, 'x', ts)
site = wgs84.latlon(48.78, 9.2, 399.0)
for days in times.split(','):
    def at(s):
        base = datetime(1970, 1, 1, tzinfo=timezone.utc)
        return ts.from_datetime(base + timedelta(days=float(days), seconds=s))
    def seen(s):
        t = at(s)
        here = site.at(t).xyz.km
        line = sat.at(t).xyz.km - here
        line = sat.at(at(s - np.linalg.norm(line) / 299792.458)).xyz.km - here
        n, e, u = site.rotation_at(t) @ (line / np.linalg.norm(line))
        lat = np.radians(48.78)
        m, w, p = u * np.cos(lat) - n * np.sin(lat), -e, u * np.sin(lat) + n * np.cos(lat)
        return np.degrees([np.arctan2(e, n), np.arcsin(u), np.arctan2(w, m), np.arcsin(p)])
    h = 0.02
    rate = ((seen(h) - seen(-h) + 180) % 360 - 180) / (2 * h)
    print(*seen(0)[:2], *rate)
"#;
    let out = run_python(&python, script, &[lines[1], lines[2], &times.join(",")]);
    let rows: Vec<Vec<f64>> = out
        .lines()
        .map(|line| line.split_whitespace().map(|n| n.parse().unwrap()).collect())
        .collect();
    assert_eq!(rows.len(), chosen.len());
    for (epoch, row) in chosen.iter().zip(rows) {
        let observer = Observer::at(*epoch, &site(), EarthOrientation::embedded()).unwrap();
        let motion = Motion::at(&orbit, &observer).unwrap();
        let (horizontal, equatorial) = (motion.horizontal(), motion.equatorial(48.78));
        // 86 µs of the days' text, 0.1 s of UT1 in Skyfield's table, light time and aberration: 10″ of place at 1°/s.
        let flat = horizontal.angle_deg[1].to_radians().cos();
        assert!(wrapped(horizontal.angle_deg[0] - row[0]).abs() * flat < 0.01, "{epoch}");
        assert!((horizontal.angle_deg[1] - row[1]).abs() < 0.01, "{epoch}");
        // 20″ of place move the first axis' rate by that over the distance from the axes' pole, and the second's by so much of the whole rate.
        let near = |got: [f64; 2], truth: &[f64], second_deg: f64| {
            let part = 1e-4 + 20.0 / 206_265.0 / second_deg.to_radians().cos();
            let whole = truth[0].hypot(truth[1]);
            (0..2).all(|i| (got[i] - truth[i]).abs() < part * whole)
        };
        let [h, e] = [horizontal, equatorial];
        assert!(near(h.deg_s.to_array(), &row[2..4], h.angle_deg[1]), "{epoch} {h:?} {row:?}");
        assert!(near(e.deg_s.to_array(), &row[4..6], e.angle_deg[1]), "{epoch} {e:?} {row:?}");
    }
}
