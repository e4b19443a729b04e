//! The visible part of the Sun's disc. (Contacts are held against the shadow's cones in `orbit_places.rs`.)

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::Unit;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use sunglint_ephemeris::orbit::eclipse::{
    ContactKind, Discs, EARTH_EQUATORIAL_RADIUS_M, EarthShape, Shadow, contacts, visible_fraction,
};
use sunglint_ephemeris::orbit::{Ephemeris, EphemerisRow, Orbit, tle};
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::{EarthOrientation, SkyFrame, SunPlace};

/// The Sun as one sees it from the Earth, radians.
const SUN: f64 = 0.004_65;

fn fraction(sun_rad: f64, earth_rad: f64, separation_rad: f64) -> f64 {
    Discs { sun_rad, earth_rad, separation_rad }.visible_fraction()
}

/// Truth: counting. 10⁶ places on the Sun's cap, each of the same solid angle, and how many of them are outside the Earth's cap.
/// The edge cuts some 2000 of them: 1e-3 is allowed, and 3e-4 met.
#[test]
fn the_fraction_is_what_counting_finds() {
    let counted = |a: f64, b: f64, c: f64| {
        let earth = DVec3::new(c.sin(), 0.0, c.cos());
        let (rings, around) = (1000_u32, 1000_u32);
        let mut visible = 0;
        for i in 0..rings {
            // Even in 1 − cos.
            let z = 1.0 - (1.0 - a.cos()) * (f64::from(i) + 0.5) / f64::from(rings);
            let sin = ((1.0 - z) * (1.0 + z)).sqrt();
            for j in 0..around {
                let (s, co) = ((f64::from(j) + 0.5) * 2.0 * PI / f64::from(around)).sin_cos();
                let place = DVec3::new(sin * co, sin * s, z);
                // The angle by its half's sine, which does not cancel.
                visible += i32::from((place - earth).length() > 2.0 * (0.5 * b).sin());
            }
        }
        f64::from(visible) / f64::from(rings * around)
    };
    let mut worst = 0.0_f64;
    for (a, b) in [(SUN, 1.15), (SUN, 0.15), (SUN, 0.00465), (SUN, 0.002), (0.5, 0.3), (0.3, 1.5)] {
        for part in [-0.95, -0.6, -0.2, 0.0, 0.1, 0.5, 0.9] {
            let c = f64::abs(b + part * a);
            let (ours, truth) = (fraction(a, b, c), counted(a, b, c));
            worst = worst.max((ours - truth).abs());
            assert!((ours - truth).abs() < 1e-3, "{a} {b} {c}: {ours}, counted {truth}");
        }
    }
    println!("at most {worst:.1e}");
}

/// Truth: closed forms. An Earth that fills half the sky has a great circle for an edge, which halves what it meets at the
/// centre; small discs are planar (the lens of two circles; beyond that (radius)²); two discs of one size at a distance of
/// one radius hide 2/3 − √3/(2π) of each other; an annular eclipse leaves a ring.
#[test]
fn closed_forms() {
    assert!((fraction(SUN, FRAC_PI_2, FRAC_PI_2) - 0.5).abs() < 1e-12);
    assert!((fraction(0.4, FRAC_PI_2, FRAC_PI_2) - 0.5).abs() < 1e-14);
    let lens = 2.0 / 3.0 - 3.0_f64.sqrt() / (2.0 * PI);
    assert!((1.0 - fraction(1e-4, 1e-4, 1e-4) - lens).abs() < 1e-8);
    for (r, big, d) in
        [(1e-4_f64, 3e-4_f64, 3.2e-4_f64), (2e-4, 1e-4, 1.5e-4), (1e-4, 3e-4, 2.1e-4)]
    {
        let cosine = |x: f64, y: f64| ((d * d + x * x - y * y) / (2.0 * d * x)).acos();
        let kite = ((-d + r + big) * (d + r - big) * (d - r + big) * (d + r + big)).sqrt();
        let hidden = r * r * cosine(r, big) + big * big * cosine(big, r) - 0.5 * kite;
        let truth = 1.0 - hidden / (PI * r * r);
        assert!((fraction(r, big, d) - truth).abs() < 1e-7, "{r} {big} {d}");
    }
    // Two million km behind the Earth.
    let au = 149_597_870_700.0;
    let position = DVec3::new(-2e9, 0.0, 0.0);
    let sun = SunPlace { direction_gcrs: DVec3::X, distance_m: au + 2e9 };
    let ring = 1.0 - (6_378_137.0 / 2e9_f64).powi(2) / (6.957e8 / (au + 2e9)).powi(2);
    let ours = visible_fraction(position, &sun, EarthShape::default());
    // Caps are flat to (radius)²/4.
    assert!((ours - ring).abs() < 1e-5, "{ours} {ring}");
    assert_eq!(Discs::at(position, &sun, EarthShape::default()).shadow(), Shadow::Annular);
}

/// Truth: 10⁶ rays to even places of the Sun's cap against the ellipsoid, in space. The approximation (a Sun that is kept
/// round where space is stretched) is said to err by 2e-3 at most; counting errs by 3e-4.
#[test]
fn the_ellipsoid_hides_what_its_rays_meet() {
    let (equator, pole) = (6_378_137.0_f64, 6_356_752.314_245_f64);
    let mut worst = 0.0_f64;
    for to_sun in
        [DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.7, 0.5, 0.4), DVec3::new(0.6, -0.7, -0.38)]
    {
        let sun = SunPlace { direction_gcrs: to_sun.normalize(), distance_m: 1.496e11 };
        let axis = sun.direction_gcrs;
        let around = axis.any_orthonormal_vector();
        for (turn, behind_m) in
            [(0.3_f64, 2.8e6_f64), (1.1, 2.8e6), (1.8, 6e6), (2.9, 4e7), (4.4, 1e6)]
        {
            let side = around * turn.cos() + axis.cross(around) * turn.sin();
            // On the limb of the ellipsoid as the parallel light of the Sun's centre grazes it, by bisection.
            let place = |off_m: f64| side * off_m - axis * behind_m;
            let hits = |origin: DVec3, ray: DVec3| {
                let scale = DVec3::new(1.0 / equator, 1.0 / equator, 1.0 / pole);
                let (o, d) = (origin * scale, ray * scale);
                let b = o.dot(d);
                b < 0.0 && b * b - d.length_squared() * (o.length_squared() - 1.0) > 0.0
            };
            let (mut low, mut high) = (6.0e6, 6.6e6);
            while high - low > 1.0 {
                let middle = 0.5 * (low + high);
                if hits(place(middle), axis) { low = middle } else { high = middle }
            }
            for further in [-0.6, 0.0, 0.5] {
                let position = place(low + further * behind_m * sun.angular_radius_rad());
                let (mut visible, n) = (0, 1000);
                for i in 0..n {
                    let z = 1.0
                        - (1.0 - sun.angular_radius_rad().cos()) * (f64::from(i) + 0.5)
                            / f64::from(n);
                    let sin = ((1.0 - z) * (1.0 + z)).sqrt();
                    for j in 0..n {
                        let (s, c) = ((f64::from(j) + 0.5) * 2.0 * PI / f64::from(n)).sin_cos();
                        let ray = axis * z + (around * c + axis.cross(around) * s) * sin;
                        visible += i32::from(!hits(position, ray));
                    }
                }
                let truth = f64::from(visible) / f64::from(n * n);
                let ours = visible_fraction(position, &sun, EarthShape::Ellipsoid);
                assert!((0.02..0.98).contains(&truth), "{truth}: a case that tests nothing");
                worst = worst.max((ours - truth).abs());
            }
        }
    }
    println!("ellipsoid: at most {worst:.1e}");
    assert!(worst < 2e-3, "{worst}");
}

/// A target before the Earth, beside it, at its surface, and within the equatorial sphere over a pole.
#[test]
fn the_edges_of_the_world() {
    let sun = SunPlace { direction_gcrs: DVec3::X, distance_m: 1.5e11 };
    let see =
        |x: f64, y: f64, z: f64| visible_fraction(DVec3::new(x, y, z), &sun, EarthShape::default());
    assert_eq!(see(7e6, 0.0, 0.0), 1.0);
    assert_eq!(see(0.0, 4.2e7, 0.0), 1.0);
    assert_eq!(see(-7e6, 0.0, 0.0), 0.0);
    assert_eq!(see(EARTH_EQUATORIAL_RADIUS_M, 0.0, 0.0), 1.0);
    assert!((see(0.0, EARTH_EQUATORIAL_RADIUS_M, 0.0) - 0.5).abs() < 1e-6);
    assert!((see(0.0, 0.0, 6.36e6) - 0.5).abs() < 1e-6);
    // The limb of the ellipsoid is 21 km lower over a pole, where it is 0 at the equator.
    let over = |earth, x: f64, y: f64, z: f64| {
        Discs::at(DVec3::new(x, y, z), &sun, earth).separation_rad
            - Discs::at(DVec3::new(x, y, z), &sun, earth).earth_rad
    };
    let sphere = EarthShape::default();
    assert!(
        (over(EarthShape::Ellipsoid, -2e6, 6.5e6, 0.0) - over(sphere, -2e6, 6.5e6, 0.0)).abs()
            < 1e-12
    );
    let polar = over(EarthShape::Ellipsoid, -2e6, 0.0, 6.5e6)
        - over(EarthShape::Sphere { radius_m: 6_356_752.3 }, -2e6, 0.0, 6.5e6);
    // Over a pole the terminator's limb is that of the polar radius but for the Earth's curvature along the line of sight.
    assert!(polar.abs() < 4e-3, "{polar}");
    let gain = over(EarthShape::Ellipsoid, -2e6, 0.0, 6.5e6) - over(sphere, -2e6, 0.0, 6.5e6);
    assert!((0.002..0.012).contains(&gain), "{gain}");
}

/// A low polar orbit: the fraction leaves 1 and reaches 0 within 2 ms of the contacts that say so, and windows cut through
/// the shadow.
#[test]
fn contacts_stand_where_the_fraction_turns() {
    let line1 = "1 28057U 03049A   06177.78615833  .00000060  00000-0  35940-4 0  1836";
    let line2 = "2 28057  98.4283 247.6961 0000884  88.1964 271.9322 14.35478080140550";
    let orbit =
        Orbit::from(tle::parse("t", &format!("{line1}\n{line2}")).unwrap()[0].orbit().unwrap());
    let from = parse_utc("2006-06-27T00:00:00Z").unwrap();
    let earth = EarthOrientation::embedded();
    let all =
        contacts(&orbit, from, from + 6.0 * Unit::Hour, earth, EarthShape::default()).unwrap();
    assert!(all.len() >= 12, "{}", all.len());
    assert!(all.windows(2).all(|pair| pair[0].epoch < pair[1].epoch));
    let visible = |epoch| {
        let frame = SkyFrame::new(epoch, earth).unwrap();
        let state = orbit.state(epoch, &frame).unwrap();
        let sun = frame.sun_from(state.position_m, DVec3::ZERO).unwrap();
        visible_fraction(state.position_m, &sun, EarthShape::default())
    };
    for contact in &all {
        let step = 2.0 * Unit::Millisecond;
        let (before, after) = (visible(contact.epoch - step), visible(contact.epoch + step));
        match contact.kind {
            ContactKind::PenumbraEntry => assert!(before == 1.0 && after < 1.0),
            ContactKind::UmbraEntry => assert!(before > 0.0 && after == 0.0),
            ContactKind::UmbraExit => assert!(before == 0.0 && after > 0.0),
            ContactKind::PenumbraExit => assert!(before < 1.0 && after == 1.0),
        }
    }
    // A window within the umbra has no contact, one that begins in it has no entry.
    let entry = all.iter().position(|c| c.kind == ContactKind::UmbraEntry).unwrap();
    let (inside, exit) = (all[entry].epoch + 1.0 * Unit::Minute, all[entry + 1].epoch);
    let within =
        contacts(&orbit, inside, inside + 1.0 * Unit::Minute, earth, EarthShape::default());
    assert_eq!(within.unwrap(), []);
    let half =
        contacts(&orbit, inside, exit + 1.0 * Unit::Minute, earth, EarthShape::default()).unwrap();
    assert_eq!(
        half.iter().map(|c| c.kind).collect::<Vec<_>>(),
        [ContactKind::UmbraExit, ContactKind::PenumbraExit]
    );
}

/// A circular orbit whose plane leaves the anti-solar point by a little less than the penumbra's edge. Truth: on it the Sun's
/// centre is nearest at β and follows cos c = cos β cos θ, so that the touch lasts 2 arccos(cos(a+b)/cos β)/ω: 12 s here, a
/// fifth of a step of the search. The Sun's own motion in that time changes it by some per cent; a tenth is allowed. Just
/// outside there is nothing.
#[test]
fn a_grazing_eclipse_is_found() {
    let earth = &EarthOrientation::zero();
    let middle = parse_utc("2026-03-14T12:00:00Z").unwrap();
    let frame = SkyFrame::new(middle, earth).unwrap();
    let (radius, rate) = (7.5e6_f64, 9.7e-4_f64);
    let edge = (EARTH_EQUATORIAL_RADIUS_M / radius).asin() + frame.sun().angular_radius_rad();
    for (inside_rad, contacts_expected) in [(1e-5, 2), (-1e-5, 0)] {
        let beta = edge - inside_rad;
        let mut to_sun = frame.sun().direction_gcrs;
        let (mut first, mut second) = (DVec3::X, DVec3::Y);
        // The Sun's parallax at the target is five times what it is inside by.
        for _ in 0..3 {
            let side = to_sun.cross(DVec3::Z).normalize();
            first = -to_sun * beta.cos() + side * beta.sin();
            second = to_sun.cross(side);
            to_sun = frame.sun_from(first * radius, DVec3::ZERO).unwrap().direction_gcrs;
        }
        let rows: Vec<EphemerisRow> = (-60..=60)
            .map(|i| {
                let seconds = 10.0 * f64::from(i);
                let (sin, cos) = (rate * seconds).sin_cos();
                EphemerisRow {
                    epoch: middle + seconds * Unit::Second,
                    position_m: (first * cos + second * sin) * radius,
                    velocity_m_s: Some((second * cos - first * sin) * radius * rate),
                }
            })
            .collect();
        let orbit = Orbit::from(Ephemeris::new("grazing", &rows).unwrap());
        for late_s in 0..13 {
            let from = middle - (500.0 - 5.0 * f64::from(late_s)) * Unit::Second;
            let to = middle + 500.0 * Unit::Second;
            let found = contacts(&orbit, from, to, earth, EarthShape::default()).unwrap();
            assert_eq!(found.len(), contacts_expected, "{late_s}");
            if let [entry, exit] = &found[..] {
                assert_eq!(
                    (entry.kind, exit.kind),
                    (ContactKind::PenumbraEntry, ContactKind::PenumbraExit)
                );
                let length_s = (exit.epoch - entry.epoch).to_seconds();
                let truth_s = 2.0 * (edge.cos() / beta.cos()).acos() / rate;
                assert!((length_s / truth_s - 1.0).abs() < 0.1, "{length_s} s, {truth_s} s");
            }
        }
    }
}

proptest! {
    /// The overlap is one area seen from two sides; it grows as the discs approach; the fraction is a fraction, at tangency
    /// and everywhere.
    #[test]
    fn the_overlap_has_two_sides(a in 1e-3_f64..1.0, b in 1e-3_f64..1.5, place in 0.0_f64..1.0, nudge in -1e-9_f64..1e-9) {
        let cap = |r: f64| 4.0 * PI * (0.5 * r).sin().powi(2);
        let (nearest, furthest) = ((a - b).abs(), a + b);
        let c = nearest + place * (furthest - nearest);
        let of_a = (1.0 - fraction(a, b, c)) * cap(a);
        let of_b = (1.0 - fraction(b, a, c)) * cap(b);
        prop_assert!((of_a - of_b).abs() < 1e-12 * cap(a.max(b)) + 1e-14, "{of_a} {of_b}");
        prop_assert!(fraction(a, b, c + 1e-3) >= fraction(a, b, c) - 1e-12);
        for edge in [nearest, furthest] {
            let f = fraction(a, b, (edge + nudge).max(0.0));
            prop_assert!((0.0..=1.0).contains(&f));
            let limit = if edge == furthest { 1.0 } else if a <= b { 0.0 } else { 1.0 - cap(b) / cap(a) };
            prop_assert!((f - limit).abs() < 1e-5, "{f} {limit}");
        }
    }
}
