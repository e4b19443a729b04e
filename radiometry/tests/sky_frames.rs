//! Frames, sites, directions, the Sun and Moon where closed forms are known.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::{DMat3, DVec3};
use hifitime::Epoch;
use proptest::prelude::*;
use sunglint_formats::ecsv;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::constants::SUN_RADIUS_M;
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Equatorial, Geodetic, Horizontal, Observer, Site, SiteError,
    SkyError, SkyFrame, Star, SunPlace, Twilight, separation_deg, separation_rad,
};
use sunglint_testkit::fixture;

const ARCSEC_RAD: f64 = 4.848_136_811_095_36e-6;
const LIGHT_M_S: f64 = 299_792_458.0;
const AU_M: f64 = 149_597_870_700.0;

fn utc(text: &str) -> Epoch {
    parse_utc(text).unwrap()
}

fn site(latitude_deg: f64, longitude_deg: f64, height_m: f64) -> Site {
    Site::new(Geodetic { latitude_deg, longitude_deg, height_m }).unwrap()
}

fn observer() -> Observer {
    let place = site(48.782389, 9.196417, 399.0);
    Observer::at(utc("2024-08-12T22:30:00Z"), &place, EarthOrientation::embedded()).unwrap()
}

fn distance_from_identity(matrix: DMat3) -> f64 {
    let off = matrix - DMat3::IDENTITY;
    off.to_cols_array().into_iter().fold(0.0, |most, x| x.abs().max(most))
}

/// pyerfa 2.0.1.5 `c2t06a`, `era00`, `eo06a`, with the same Earth orientation: 1e-12 (6 µm at the surface); ERA to 1e-12 rad.
#[test]
fn the_rotation_is_pyerfas() {
    let path = fixture("sky/frames.ecsv");
    let table = ecsv::read_str(&path, &std::fs::read_to_string(&path).unwrap()).unwrap();
    for row in 0..table.rows() {
        let number = |name: &str| table.f64(name).unwrap()[row];
        let earth = EarthOrientation::constant(
            number("ut1_minus_utc_s"),
            number("x_pole_arcsec"),
            number("y_pole_arcsec"),
        )
        .unwrap();
        let epoch = utc(table.text("epoch_utc").unwrap()[row].as_deref().unwrap());
        let frame = SkyFrame::new(epoch, &earth).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let ours = frame.gcrs_to_itrs().row(i)[j];
                let theirs = number(&format!("m{i}{j}"));
                assert!((ours - theirs).abs() < 1e-12, "row {row}, m{i}{j}: {ours} {theirs}");
            }
        }
        assert!((frame.earth_rotation_angle_rad() - number("era_rad")).abs() < 1e-12);
        let origins = frame.equation_of_origins_rad() - number("equation_of_origins_rad");
        assert!(origins.abs() < 1e-12);
        // astropy's get_sun takes the light time to first order: 0.01″.
        let sun = DVec3::new(number("sun_x"), number("sun_y"), number("sun_z"));
        let arcsec = separation_deg(frame.sun().direction_gcrs, sun) * 3600.0;
        assert!(arcsec < 0.01, "row {row}: the Sun {arcsec}″");
    }
}

#[test]
fn rotations_are_orthonormal() {
    let mut epoch = utc("1990-01-01T00:00:00Z");
    while epoch < utc("2090-01-01T00:00:00Z") {
        let observer =
            Observer::at(epoch, &site(-24.6, -70.4, 2635.0), EarthOrientation::embedded()).unwrap();
        let frame = observer.frame();
        for matrix in [
            frame.gcrs_to_itrs(),
            frame.gcrs_to_cirs(),
            frame.tirs_to_itrs(),
            observer.gcrs_to_enu(),
        ] {
            assert!(distance_from_identity(matrix * matrix.transpose()) < 1e-14);
            assert!((matrix.determinant() - 1.0).abs() < 1e-14);
        }
        assert!(distance_from_identity(frame.gcrs_to_itrs() * frame.itrs_to_gcrs()) < 1e-14);
        epoch += hifitime::Unit::Day * 997.3;
    }
}

/// SOFA's own chain `atciq` + `atioq` (pressure 0, `sofars` 0.6.2) against our one matrix: 1e-6″ (1e-5″ in hour angle, whose
/// declination cosine we leave in).
#[test]
fn star_places_are_sofas_chain() {
    let place = site(48.782389, 9.196417, 399.0);
    let earth = EarthOrientation::constant(-0.31, 0.12, 0.34).unwrap();
    let observer = Observer::at(utc("2024-08-12T22:30:00Z"), &place, &earth).unwrap();
    let times = observer.frame().times();
    let (tt1, tt2) = (times.tt.midnight, times.tt.fraction);
    let (heliocentric, barycentric) = sofars::eph::epv00(tt1, tt2).unwrap();
    let (x, y, s) = sofars::pnp::xys06a(tt1, tt2);
    let mut context = sofars::astro::IauAstrom::default();
    sofars::astro::apco(
        tt1,
        tt2,
        &barycentric,
        &heliocentric[0],
        x,
        y,
        s,
        sofars::erst::era00(times.ut1.midnight, times.ut1.fraction),
        9.196417_f64.to_radians(),
        48.782389_f64.to_radians(),
        399.0,
        0.12 * ARCSEC_RAD,
        0.34 * ARCSEC_RAD,
        sofars::pnp::sp00(tt1, tt2),
        0.0,
        0.0,
        &mut context,
    );
    for star in Catalogue::embedded().stars() {
        let (ra, dec) = (star.icrs.ra_deg.to_radians(), star.icrs.dec_deg.to_radians());
        let mas = ARCSEC_RAD / 1e3;
        let (ri, di) = sofars::astro::atciq(
            ra,
            dec,
            star.pm_ra_mas_yr.unwrap_or(0.0) * mas / dec.cos(),
            star.pm_dec_mas_yr.unwrap_or(0.0) * mas,
            star.parallax_mas.unwrap_or(0.0) / 1e3,
            0.0,
            &mut context,
        );
        let (azimuth, zenith, hour_angle, _, _) = sofars::astro::atioq(ri, di, &context);
        let ours = observer.star(star);
        let theirs = Horizontal::new(azimuth.to_degrees(), 90.0 - zenith.to_degrees());
        assert!(ours.horizontal.separation_deg(theirs) * 3600.0 < 1e-6, "{star}");
        let hour_angle_off =
            (ours.hour_angle_deg - hour_angle.to_degrees() + 180.0).rem_euclid(360.0) - 180.0;
        assert!(hour_angle_off.abs() * 3600.0 * di.cos() < 1e-5, "{star}: {hour_angle_off}");
        let ra_of_date_deg = (ri - observer.frame().equation_of_origins_rad()).to_degrees();
        let of_date = Equatorial { ra_deg: ra_of_date_deg, dec_deg: di.to_degrees() };
        assert!(separation_deg(of_date.direction(), ours.of_date.direction()) * 3600.0 < 1e-6);
    }
}

/// The nominal radius at 1 au is asin(695 700 km / 149 597 870.7 km) = 959.231″ = 0.266453° (959.63″ is the older
/// almanacs' 695 990 km).
#[test]
fn the_suns_angular_radius_follows_its_distance() {
    let sun = SunPlace { direction_gcrs: DVec3::X, distance_m: AU_M };
    assert!((sun.angular_radius_deg() * 3600.0 - 959.231).abs() < 1e-3);
    assert_eq!(sun.distance_au(), 1.0);
    // The physics of a star that fills a hemisphere: at its surface the radius is 90°.
    let close = SunPlace { direction_gcrs: DVec3::X, distance_m: SUN_RADIUS_M };
    assert!((close.angular_radius_deg() - 90.0).abs() < 1e-9);

    // Perihelion of January and aphelion of July 2024: 0.98331 and 1.01673 au (Astronomical Almanac).
    let at = |text: &str| SkyFrame::new(utc(text), EarthOrientation::embedded()).unwrap().sun();
    assert!((at("2024-01-03T00:39:00Z").distance_au() - 0.98331).abs() < 1e-5);
    assert!((at("2024-07-05T05:06:00Z").distance_au() - 1.01673).abs() < 1e-5);
}

/// The Earth's own motion cancels in the GCRS: an object's apparent place computed in the barycentric frame (its state
/// plus the Earth's, light time there, the whole aberration) is the place computed in the GCRS to 0.005″.
#[test]
fn annual_aberration_of_near_objects_cancels() {
    let observer = observer();
    let earth_m_s = observer.frame().earth_velocity_m_s();
    for (position_m, velocity_m_s) in [
        (DVec3::new(4.21e6, 1.83e6, 5.32e6), DVec3::new(-6.0e3, 1.0e3, 4.4e3)),
        (DVec3::new(-2.0e7, 3.1e7, 2.1e7), DVec3::new(-2.5e3, -1.7e3, 0.1e3)),
        (DVec3::new(3.0e8, -2.0e8, 1.1e8), DVec3::new(0.5e3, 0.9e3, 0.1e3)),
    ] {
        let seen = observer.apparent(position_m, velocity_m_s).unwrap();
        // Barycentric: the object moves with the Earth and its own velocity, the observer likewise.
        let object_m_s = earth_m_s + velocity_m_s;
        let mut line = position_m - observer.position_gcrs_m();
        for _ in 0..5 {
            let light_s = line.length() / LIGHT_M_S;
            line = position_m - object_m_s * light_s - observer.position_gcrs_m();
        }
        let v = (earth_m_s + observer.velocity_gcrs_m_s()) / LIGHT_M_S;
        let gamma_inverse = (1.0 - v.length_squared()).sqrt();
        let natural = line.normalize();
        let apparent = natural * gamma_inverse + v * (1.0 + natural.dot(v) / (1.0 + gamma_inverse));
        let arcsec = separation_deg(apparent, seen.direction_gcrs) * 3600.0;
        assert!(arcsec < 0.005, "{arcsec}″ at {} km", seen.range_m / 1e3);
        // And it is not the straight line: light time and diurnal aberration are in it.
        let straight = observer.geometric(position_m).unwrap();
        assert!(separation_deg(straight.direction_gcrs, seen.direction_gcrs) * 3600.0 > 0.1);
    }
}

/// A satellite's own velocity shifts the Sun by v/c (7.5 km/s: 5.2″), and its place by parallax.
#[test]
fn the_sun_from_a_satellite_moves_by_v_over_c() {
    let frame = observer().frame().clone();
    let still = frame.sun_from(DVec3::new(7e6, 0.0, 0.0), DVec3::ZERO).unwrap();
    let across = still.direction_gcrs.any_orthonormal_vector() * 7.5e3;
    let moving = frame.sun_from(DVec3::new(7e6, 0.0, 0.0), across).unwrap();
    let shift_rad = separation_rad(still.direction_gcrs, moving.direction_gcrs);
    assert!((shift_rad - 7.5e3 / LIGHT_M_S).abs() < 1e-8, "{shift_rad}");
    let parallax_rad = separation_rad(still.direction_gcrs, frame.sun().direction_gcrs);
    assert!(parallax_rad < 7e6 / 0.98 / AU_M);
    assert!(matches!(
        frame.sun_from(frame.sun_position_gcrs_m(), DVec3::ZERO),
        Err(SkyError::AtObserver { .. })
    ));
    assert!(matches!(
        frame.moon_from(frame.moon_position_gcrs_m(), DVec3::ZERO),
        Err(SkyError::AtObserver { .. })
    ));
    assert!(matches!(frame.sun_from(DVec3::NAN, DVec3::ZERO), Err(SkyError::NotFinite { .. })));
}

/// The Moon's light at the total lunar eclipse of 2025-03-14 06:59 UTC and at the solar eclipse of 2024-04-08 18:17 UTC.
#[test]
fn the_moons_phase_at_eclipses() {
    let at = |text: &str| SkyFrame::new(utc(text), EarthOrientation::embedded()).unwrap();
    let full = at("2025-03-14T06:59:00Z").moon();
    assert!(full.phase_angle_deg < 0.6 && full.illuminated_fraction() > 0.9999, "{full:?}");
    let eclipse = at("2024-04-08T18:17:00Z");
    let new = eclipse.moon();
    assert!(new.phase_angle_deg > 179.0 && new.illuminated_fraction() < 1e-4, "{new:?}");
    // gamma = 0.343 Earth radii (NASA's canon of eclipses): the shadow's axis passes the Earth's centre by that.
    let sun_to_moon = (eclipse.moon_position_gcrs_m() - eclipse.sun_position_gcrs_m()).normalize();
    let miss = eclipse.moon_position_gcrs_m().cross(sun_to_moon).length() / 6.378137e6;
    assert!((miss - 0.343).abs() < 0.01, "{miss}");
}

#[test]
fn twilight_goes_by_the_suns_true_altitude() {
    for (altitude_deg, expected) in [
        (10.0, Twilight::Day),
        (-0.8, Twilight::Day),
        (-0.9, Twilight::Civil),
        (-7.0, Twilight::Nautical),
        (-13.0, Twilight::Astronomical),
        (-18.5, Twilight::Night),
    ] {
        assert_eq!(Twilight::of_sun_altitude_deg(altitude_deg), expected);
    }
    assert_eq!(observer().twilight(), Twilight::Night);
    assert_eq!(Twilight::Nautical.to_string(), "nautical twilight");
}

/// A satellite at the zenith and at the nadir, at the site itself, and nothing at all.
#[test]
fn the_zenith_the_nadir_and_the_site_itself() {
    for place in [site(48.8, 9.2, 399.0), site(90.0, 0.0, 0.0), site(-90.0, 77.0, 2800.0)] {
        let observer =
            Observer::at(utc("2024-08-12T22:30:00Z"), &place, EarthOrientation::embedded())
                .unwrap();
        let up = observer.gcrs_direction_of(Horizontal::new(0.0, 90.0));
        let above = observer.geometric(observer.position_gcrs_m() + up * 5e5).unwrap();
        // The position of 6.4e6 m holds 1e-9 m: 1e-14 rad at 500 km.
        assert!(above.horizontal.zenith_deg() < 1e-9);
        assert!((above.range_m - 5e5).abs() < 1e-6);
        let below = observer.geometric(observer.position_gcrs_m() - up * 1.2e7).unwrap();
        assert!((below.horizontal.zenith_deg() - 180.0).abs() < 1e-9);
        assert!((below.horizontal.altitude_deg() + 90.0).abs() < 1e-9);
        let here = observer.position_gcrs_m();
        assert!(matches!(observer.geometric(here), Err(SkyError::AtObserver { .. })));
        let riding = observer.apparent(here, observer.velocity_gcrs_m_s());
        assert!(matches!(riding, Err(SkyError::AtObserver { .. })));
        let nowhere = DVec3::new(f64::NAN, 0.0, 0.0);
        assert!(matches!(observer.geometric(nowhere), Err(SkyError::NotFinite { .. })));
        assert!(matches!(observer.apparent(here * 2.0, nowhere), Err(SkyError::NotFinite { .. })));
        assert!(matches!(observer.horizontal_of(DVec3::ZERO), Err(SkyError::AtObserver { .. })));
    }
}

/// At a pole the horizon is the equator: altitudes are declinations and the azimuth counts back from the longitude's meridian.
#[test]
fn poles_and_date_line() {
    let earth = EarthOrientation::zero();
    let epoch = utc("2024-08-12T22:30:00Z");
    let north = Observer::at(epoch, &site(90.0, 0.0, 0.0), &earth).unwrap();
    let south = Observer::at(epoch, &site(-90.0, 0.0, 0.0), &earth).unwrap();
    let vega = Catalogue::embedded().find("Vega").unwrap();
    let place = north.star(vega);
    assert!((place.horizontal.altitude_deg() - place.of_date.dec_deg).abs() * 3600.0 < 0.001);
    let from_south = south.star(vega).horizontal.altitude_deg();
    assert!((from_south + place.horizontal.altitude_deg()).abs() * 3600.0 < 0.001);

    // A star at the celestial pole itself, with a proper motion.
    for dec_deg in [90.0, -90.0] {
        let mut polar = Star::at("pole", Equatorial { ra_deg: 30.0, dec_deg }).unwrap();
        polar.pm_ra_mas_yr = Some(1000.0);
        polar.pm_dec_mas_yr = Some(0.0);
        let moved = separation_deg(
            north.star_direction_gcrs(&polar),
            north.star_direction_gcrs(&Star::at("still", polar.icrs).unwrap()),
        );
        assert!((moved * 3600.0 - 24.61).abs() < 0.01, "1″ a year for 24.61 years: {moved}");
    }

    let east = Observer::at(epoch, &site(10.0, 180.0, 0.0), &earth).unwrap();
    let west = Observer::at(epoch, &site(10.0, -180.0, 0.0), &earth).unwrap();
    assert!(east.star(vega).horizontal.separation_deg(west.star(vega).horizontal) < 1e-12);
    assert!((east.position_gcrs_m() - west.position_gcrs_m()).length() < 1e-8);
}

#[test]
fn impossible_sites_are_refused() {
    let make = |latitude_deg, longitude_deg, height_m| {
        Site::new(Geodetic { latitude_deg, longitude_deg, height_m })
    };
    for bad in [90.000_001, -91.0, f64::NAN] {
        assert!(matches!(make(bad, 0.0, 0.0), Err(SiteError::Latitude { .. })));
    }
    for bad in [361.0, -180.5, f64::INFINITY, f64::NAN] {
        assert!(matches!(make(0.0, bad, 0.0), Err(SiteError::Longitude { .. })));
    }
    for bad in [-2000.0, 6.4e6, f64::NAN] {
        assert!(matches!(make(0.0, 0.0, bad), Err(SiteError::Height { .. })));
    }
    for bad in [DVec3::ZERO, DVec3::NAN, DVec3::new(f64::INFINITY, 0.0, 0.0)] {
        assert!(matches!(Geodetic::from_itrs_m(bad), Err(SiteError::NoPlace { .. })));
    }
    // WGS 84: the semi-axes themselves.
    assert!((site(0.0, 0.0, 0.0).itrs_m() - DVec3::X * 6_378_137.0).length() < 1e-9);
    assert!((site(90.0, 0.0, 0.0).itrs_m().z - 6_356_752.314_245).abs() < 1e-6);
}

/// The site moves at ω·R·cos φ, eastwards; its velocity is the derivative of its position.
#[test]
fn the_sites_velocity_is_the_derivative_of_its_position() {
    let place = site(-24.6272, -70.4048, 2635.0);
    let at = |text: &str| {
        Observer::at(utc(text), &place, &EarthOrientation::constant(0.05, 0.1, 0.3).unwrap())
            .unwrap()
    };
    let (before, now, after) =
        (at("2026-03-14T04:20:29Z"), at("2026-03-14T04:20:30Z"), at("2026-03-14T04:20:31Z"));
    let difference = (after.position_gcrs_m() - before.position_gcrs_m()) / 2.0;
    // Third derivative: 465 m/s · ω²/6 = 4e-7 m/s; precession and nutation 7e-5 m/s.
    assert!((difference - now.velocity_gcrs_m_s()).length() < 2e-4);
    let east = now.gcrs_to_enu() * now.velocity_gcrs_m_s();
    assert!((east.x - 423.0).abs() < 1.0 && east.y.abs() < 0.01 && east.z.abs() < 0.01, "{east}");
}

#[test]
fn separations_are_stable_at_both_ends() {
    let a = Equatorial { ra_deg: 123.0, dec_deg: 45.0 }.direction();
    for exponent in 3..15 {
        let angle_rad = 10.0_f64.powi(-exponent);
        let b = (a + a.any_orthonormal_vector() * angle_rad.tan()) * 7.0;
        assert!((separation_rad(a, b) / angle_rad - 1.0).abs() < 1e-2, "{angle_rad}");
        let far_rad = std::f64::consts::PI - separation_rad(a, -b);
        assert!((far_rad - angle_rad).abs() < 1e-15 + 1e-9 * angle_rad, "{angle_rad}");
    }
    assert_eq!(separation_rad(a, a), 0.0);
    assert_eq!(separation_deg(DVec3::X, -DVec3::X), 180.0);
}

proptest! {
    /// SOFA's `gc2gd` takes one step of Fukushima's iteration: 1e-9 m for sites, 5e-6″ of latitude in high orbits (measured).
    #[test]
    fn geodetic_there_and_back(
        latitude_deg in -90.0..=90.0_f64,
        longitude_deg in -180.0..=180.0_f64,
        low_height_m in -1000.0..1.0e5_f64,
        high_height_m in 1.0e5..4.0e7_f64,
        high: bool,
    ) {
        let height_m = if high { high_height_m } else { low_height_m };
        let there = Geodetic { latitude_deg, longitude_deg, height_m };
        let itrs_m = there.to_itrs_m().unwrap();
        let back = Geodetic::from_itrs_m(itrs_m).unwrap();
        let (limit_m, limit_deg) = if high { (2e-3, 2e-9) } else { (1e-7, 1e-12) };
        prop_assert!((back.to_itrs_m().unwrap() - itrs_m).length() < limit_m);
        prop_assert!((back.latitude_deg - latitude_deg).abs() < limit_deg);
        prop_assert!((back.height_m - height_m).abs() < 1e-6);
    }

    #[test]
    fn horizontal_there_and_back(azimuth_deg in 0.0..360.0_f64, altitude_deg in -90.0..=90.0_f64) {
        let observer = observer();
        let there = Horizontal::new(azimuth_deg, altitude_deg);
        let back = observer.horizontal_of(observer.gcrs_direction_of(there)).unwrap();
        prop_assert!(back.separation_deg(there) < 1e-12);
        prop_assert!((back.altitude_deg() - altitude_deg).abs() < 1e-12);
        prop_assert!((back.altitude_deg() + back.zenith_deg() - 90.0).abs() < 1e-12);
        let around = (back.azimuth_deg() - azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
        prop_assert!(around.abs() * altitude_deg.to_radians().cos() < 1e-12);
        prop_assert!((0.0..360.0).contains(&back.azimuth_deg()));
    }

    #[test]
    fn equatorial_there_and_back(ra_deg in 0.0..360.0_f64, dec_deg in -89.999..89.999_f64) {
        let back = Equatorial::of_direction(Equatorial { ra_deg, dec_deg }.direction() * 3.0);
        prop_assert!((back.dec_deg - dec_deg).abs() < 1e-12);
        let around = (back.ra_deg - ra_deg + 180.0).rem_euclid(360.0) - 180.0;
        prop_assert!(around.abs() < 1e-9);
    }

    /// A star by hand anywhere, the poles included: no NaN, and within the annual and diurnal aberration (21″), precession
    /// aside, of where it is.
    #[test]
    fn every_place_on_the_sky_has_a_place(ra_deg in -180.0..=360.0_f64, dec_deg in -90.0..=90.0_f64) {
        let mut star = Star::at("here", Equatorial { ra_deg, dec_deg }).unwrap();
        star.pm_ra_mas_yr = Some(100.0);
        star.pm_dec_mas_yr = Some(-50.0);
        let observer = observer();
        let place = observer.star(&star);
        prop_assert!(place.horizontal.altitude_deg().is_finite());
        prop_assert!((place.direction_gcrs.length() - 1.0).abs() < 1e-14);
        let arcsec = separation_deg(place.direction_gcrs, star.icrs.direction()) * 3600.0;
        // Aberration, light deflection (at most 1.8″ at the limb), and 25 years of motion.
        prop_assert!(arcsec < 20.9 + 1.9 + 2.8, "{}", arcsec);
    }
}
