//! Target, Sun and station at one moment. (Directions and ranges are held against other programs in `orbit_places.rs`.)

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::{Epoch, Unit};
use sunglint_ephemeris::geometry::{Geometry, GeometryError};
use sunglint_ephemeris::orbit::eclipse::EarthShape;
use sunglint_ephemeris::orbit::{Ephemeris, EphemerisRow, Orbit, OrbitError};
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::air::{Air, AirOptions, Profile};
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site, SkyError, SkyFrame};

const LIGHT: f64 = 299_792_458.0;

fn site() -> Site {
    Site::new(Geodetic { latitude_deg: 48.782389, longitude_deg: 9.196417, height_m: 399.0 })
        .unwrap()
}

fn middle() -> Epoch {
    parse_utc("2024-08-12T22:30:00Z").unwrap()
}

fn observer() -> Observer {
    Observer::at(middle(), &site(), EarthOrientation::embedded()).unwrap()
}

/// Something at a place in the GCRS that depends on the seconds from the middle, as a table with steps of 1 s.
fn moving(place: impl Fn(f64) -> (DVec3, DVec3)) -> Orbit {
    let rows: Vec<EphemerisRow> = (-10..=10)
        .map(|i| {
            let (position_m, velocity) = place(f64::from(i));
            let epoch = middle() + f64::from(i) * Unit::Second;
            EphemerisRow { epoch, position_m, velocity_m_s: Some(velocity) }
        })
        .collect();
    Orbit::from(Ephemeris::new("moving", &rows).unwrap())
}

/// Truth: the light cone of something that moves in a straight line, |p + v t − o| = −c t, a quadratic equation. A nanosecond of
/// the epoch is 8 µm of a satellite and 0.3 m of light.
#[test]
fn the_light_left_when_it_must() {
    let observer = observer();
    let up = observer.position_gcrs_m().normalize();
    for (distance, velocity) in [(5e5, 7.5e3), (3.6e7, 3e3), (1.2e9, 3e4)] {
        let (p, v) = (
            observer.position_gcrs_m() + up * distance,
            (up.cross(DVec3::Z).normalize() + up) * velocity,
        );
        let geometry = Geometry::at(&moving(|t| (p + v * t, v)), &observer).unwrap();
        // (v² − c²) t² + 2 (d·v) t + d² = 0, the root in the past.
        let d = p - observer.position_gcrs_m();
        let (a, b, c) = (v.length_squared() - LIGHT * LIGHT, d.dot(v), d.length_squared());
        let t = (-b + (b * b - a * c).sqrt()) / a;
        assert!(t < 0.0);
        assert!((geometry.light_time_s() + t).abs() < 2e-9, "{} {t}", geometry.light_time_s());
        assert!((geometry.range_m - (d + v * t).length()).abs() < 1e-3);
        assert!((geometry.range_m / LIGHT - geometry.light_time_s()).abs() < 1e-9);
        assert!((geometry.target.position_m - (p + v * t)).length() < 1e-3);
        let end = geometry.target.position_m + geometry.to_observer * geometry.range_m;
        assert!((end - observer.position_gcrs_m()).length() < 1e-6);
        // What `Observer::apparent` extrapolates linearly is exact for this target.
        let apparent = observer.apparent(p, v).unwrap();
        assert!(apparent.horizontal.separation_deg(geometry.horizontal) * 3600.0 < 1e-3);
    }
}

/// Truth: by construction. What stands 500 km above the site in the turning ITRS has the site's coordinates, is at the zenith
/// but for its light time (in which it moved by 0.9 m) and the site's aberration, and its phase angle is the Sun's zenith
/// angle's complement to 180°.
#[test]
fn what_stands_above_the_site() {
    let observer = observer();
    let place = Geodetic { height_m: 500e3, ..site().geodetic() }.to_itrs_m().unwrap();
    let orbit = moving(|t| {
        let epoch = middle() + t * Unit::Second;
        let frame = SkyFrame::new(epoch, EarthOrientation::embedded()).unwrap();
        (frame.itrs_to_gcrs() * place, frame.gcrs_velocity_m_s(place, DVec3::ZERO))
    });
    let geometry = Geometry::at(&orbit, &observer).unwrap();
    let point = geometry.sub_point(observer.frame()).unwrap();
    assert!((point.latitude_deg - 48.782389).abs() < 1e-9);
    assert!((point.longitude_deg - 9.196417).abs() < 1e-9);
    assert!((point.height_m - 500e3).abs() < 1e-3);
    assert!((geometry.height_m(observer.frame()).unwrap() - 500e3).abs() < 1e-3);
    assert!(geometry.zenith_deg() < 1e-4, "{}", geometry.zenith_deg());
    assert!((geometry.range_m - (500e3 - 399.0)).abs() < 1e-2);
    assert!(!geometry.behind_earth(&observer));
    let air = Air::new(&AirOptions::new(Profile::midlatitude_winter())).unwrap();
    let path = air.path(geometry.air_zenith()).unwrap();
    assert!(path.apparent_deg <= geometry.zenith_deg());
    // The Sun is 26° below the horizon: the light comes from below, and the Earth is in its way.
    let sun = geometry.sun_altitude_deg(&observer);
    assert!((-30.0..-20.0).contains(&sun));
    assert!((geometry.phase_deg() - (90.0 + sun)).abs() < 0.01, "{} {sun}", geometry.phase_deg());
    assert_eq!(geometry.sunlit, 0.0);
    assert!((geometry.sun_separation_deg(&observer) - (90.0 - sun)).abs() < 1e-3);
    let moon = observer.moon().horizontal.zenith_deg();
    assert!((geometry.moon_separation_deg(&observer) - moon).abs() < 1e-3);
}

/// Truth: the triangle of target, Sun and station, whose third angle the law of cosines gives; in the GCRS the directions
/// differ from those of the target's rest frame by its velocity over c.
#[test]
fn phase_and_rest_frame() {
    let observer = observer();
    let p = observer.position_gcrs_m() * 1.3 + DVec3::new(4e5, -8e5, 9e5);
    let v = DVec3::new(-5.0e3, 4.0e3, 3.5e3);
    let geometry = Geometry::at(&moving(|t| (p + v * t, v)), &observer).unwrap();
    let sun = observer.frame().sun_position_gcrs_m();
    let (to_sun, to_site) =
        (sun - geometry.target.position_m, observer.position_gcrs_m() - geometry.target.position_m);
    let third = (sun - observer.position_gcrs_m()).length_squared();
    let cosine = (to_sun.length_squared() + to_site.length_squared() - third)
        / (2.0 * to_sun.length() * to_site.length());
    // Aberration of the Sun, 20″ and 5″.
    assert!((geometry.phase_rad - cosine.acos()).abs() < 1.5e-4);

    // Lorentz: k' of a photon from the Sun (direction −s), and of one to the observer (direction +o).
    let (to_sun, to_observer) = geometry.rest_frame_directions();
    let beta = v / LIGHT;
    let boosted = |k: DVec3| (k - beta).normalize();
    let at_rest = observer.frame().sun_from(geometry.target.position_m, DVec3::ZERO).unwrap();
    assert!((to_sun + boosted(-at_rest.direction_gcrs)).length() < 1e-8);
    assert!((to_observer - boosted(geometry.to_observer)).length() < 1e-8);
    assert!((to_observer - geometry.to_observer).length() > 1e-6);
}

#[test]
fn what_is_behind_the_earth_or_in_its_shadow() {
    let observer = observer();
    let away = -observer.position_gcrs_m().normalize();
    let geometry = Geometry::at(&moving(|_| (away * 7e6, DVec3::ZERO)), &observer).unwrap();
    assert!(geometry.behind_earth(&observer));
    assert!(geometry.horizontal.altitude_deg() < -85.0);
    // At night the far side is lit.
    assert_eq!(geometry.sunlit, 1.0);
    // Just inside the limb of the sphere but outside the ellipsoid's over the pole: the shape matters.
    let sun = observer.frame().sun().direction_gcrs;
    let side = (DVec3::Z - sun * sun.z).normalize();
    let place = -sun * 2e6 + side * (6_378_137.0 - 12_000.0);
    let orbit = moving(|_| (place, DVec3::ZERO));
    let lit = |earth| Geometry::over(&orbit, &observer, earth).unwrap().sunlit;
    assert!(lit(EarthShape::default()) < 0.2, "{}", lit(EarthShape::default()));
    assert!(lit(EarthShape::Ellipsoid) > 0.5, "{}", lit(EarthShape::Ellipsoid));
}

#[test]
fn no_geometry_is_an_error() {
    let observer = observer();
    let at_site = observer.position_gcrs_m() + observer.position_gcrs_m().normalize() * 1e-5;
    let orbit = moving(|_| (at_site, DVec3::ZERO));
    let error = Geometry::at(&orbit, &observer).unwrap_err();
    assert!(matches!(error, GeometryError::Sky(SkyError::AtObserver { .. })), "{error}");
    // The light that arrives at the first row left before it.
    let first = Observer::at(middle() - 10.0 * Unit::Second, &site(), EarthOrientation::embedded())
        .unwrap();
    let error = Geometry::at(&moving(|_| (DVec3::X * 4e7, DVec3::ZERO)), &first).unwrap_err();
    assert!(matches!(error, GeometryError::Orbit(OrbitError::OutsideEphemeris { .. })), "{error}");
}
