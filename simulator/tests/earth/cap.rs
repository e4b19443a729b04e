//! The rule over the cap with tables.

use super::truth;
use glam::{DMat3, DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus as Rng;
use sunglint_simulator::light::earth::grid::{AlbedoGrid, Cells};
use sunglint_simulator::light::{EarthAlbedo, Globe, engine, shine};

pub const EARTH_M: f64 = 6_371_000.0;

/// A grid of even cells; their albedos by row from the south and column from −180°.
pub fn grid(step_deg: f64, albedo: &mut dyn FnMut(usize, usize) -> f64) -> AlbedoGrid {
    let rows = (180.0 / step_deg).round() as usize;
    let mut cells = Cells::default();
    for row in 0..rows {
        for column in 0..2 * rows {
            let middle = |k: usize| (k as f64 + 0.5) * step_deg;
            cells.places_deg.push([middle(row) - 90.0, middle(column) - 180.0]);
            cells.albedo.push(albedo(row, column));
        }
    }
    AlbedoGrid::new(&cells, &[], false, None).unwrap()
}

pub fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = DVec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        if v.length() < 1.0 && v.length() > 0.1 {
            return v.normalize();
        }
    }
}

pub fn rotation(rng: &mut Rng) -> DQuat {
    let (a, b) = (direction(rng), direction(rng));
    let y = a.cross(b).normalize();
    DQuat::from_mat3(&DMat3::from_cols(a, y, a.cross(y)))
}

fn below(height_m: f64, sun_altitude_deg: f64, to_ground: DQuat) -> Globe {
    let altitude = sun_altitude_deg.to_radians();
    let sun = DVec3::new(altitude.cos(), 0.0, altitude.sin());
    let distance_m = EARTH_M + height_m;
    Globe { toward: DVec3::NEG_Z, distance_m, radius_m: EARTH_M, sun, to_ground }
}

/// Truth: the figures that are published for a uniform Earth (nadir facet at 550 km: 0.252, 0.044, 0.0076, 0.0012 of sunlight), to 2 % and half of their last digit; and the uniform Earth
/// of the program, point by point, to the rounding of the table's numbers to 24 bits (6e-8 of each), and of the sums (1e-12).
#[test]
fn a_table_of_one_value_is_an_even_earth() {
    let mut rng = Rng::seed_from_u64(1);
    let earth = EarthAlbedo::tabulated("even", grid(5.0, &mut |_, _| 0.30));
    for (altitude, expected, digit) in
        [(90.0, 0.252, 5e-4), (10.0, 0.044, 5e-4), (0.0, 0.0076, 5e-5), (-6.0, 0.0012, 5e-5)]
    {
        let globe = below(550e3, altitude, rotation(&mut rng));
        let nodes = earth.shines(&globe, 21, 550.0);
        let found: f64 = nodes.iter().map(|(d, e)| e * d.dot(globe.toward)).sum();
        assert!((found - expected).abs() < 0.02 * expected + digit, "{altitude}°: {found}");
        let even = shine::cap(&globe, 21);
        assert_eq!(nodes.len(), even.len());
        for ((a, light), (b, one)) in nodes.iter().zip(&even) {
            assert!(a == b && (light - 0.30 * one).abs() <= 1e-7 * light + 1e-12, "{light} {one}");
        }
    }
}

/// Truth: the double loop (cells of 0.25°), for a northern hemisphere of 0.6 and a southern of 0, seen from above a pole, from above the equator, and from far away. Tolerance: 0.5 % of what
/// an even Earth of 0.6 would send for the rule of 21 points (pieces of the cap are cut by the equator), 0.1 % for the loop. From above the south pole
/// at 550 km nothing bright is in sight; the horizon is 23° away.
#[test]
fn a_bright_hemisphere_shines_where_it_is_seen() {
    let north = |row: usize, _: usize| if row >= 90 { 0.6 } else { 0.0 };
    let earth = EarthAlbedo::tabulated("north", grid(1.0, &mut { north }));
    let albedo = |lat: f64, _: f64| if lat > 0.0 { 0.6 } else { 0.0 };
    let all = |_: f64, _: f64| 0.6;
    for (height_m, lat_deg, sun) in [
        (550e3, 90.0, DVec3::new(0.5, 0.0, 0.4)),
        (550e3, -90.0, DVec3::new(0.5, 0.0, -0.4)),
        (550e3, 0.0, DVec3::new(0.9, 0.2, 0.1)),
        (550e3, 0.0, DVec3::new(0.1, 0.9, -0.3)),
        (550e3, 12.0, DVec3::new(0.3, 0.9, 0.3)),
        (20_000e3, 0.0, DVec3::new(0.8, 0.5, 0.2)),
        (20_000e3, -50.0, DVec3::new(0.8, 0.5, 0.2)),
    ] {
        let (up, sun) = (truth::vertical(f64::to_radians(lat_deg), 0.7), sun.normalize());
        let position = (EARTH_M + height_m) * up;
        // Axes of the body are those of the Earth.
        let globe = Globe {
            toward: -up,
            distance_m: position.length(),
            radius_m: EARTH_M,
            sun,
            to_ground: DQuat::IDENTITY,
        };
        let nadir = |d: DVec3| d.dot(-up).max(0.0);
        let found: f64 = earth.shines(&globe, 21, 550.0).iter().map(|(d, e)| e * nadir(*d)).sum();
        let [expected, even] = [&albedo as &dyn Fn(f64, f64) -> f64, &all]
            .map(|albedo| truth::shine(position, EARTH_M, sun, 0.25, albedo, &nadir));
        assert!(
            (found - expected).abs() < 6e-3 * even,
            "{height_m} m, {lat_deg}°: {found}, expected {expected} of {even}"
        );
        match lat_deg {
            -90.0 => assert_eq!(found, 0.0),
            90.0 => assert!(expected > 0.99 * even && even > 0.0),
            _ => assert!(expected < 0.999 * even && expected > 0.01 * even, "{expected} {even}"),
        }
    }
}

/// Truth: what a table says at most and at least: whatever the table, the light of all directions is between that of an even Earth of its least and of its largest albedo;
/// and a facet that faces the Earth gets no more than what bounds earthshine.
#[test]
fn no_light_is_made() {
    let mut rng = Rng::seed_from_u64(2);
    for step in [30.0, 10.0, 2.0] {
        let (least, most) = (0.5 * rng.random::<f64>(), 0.5 + 0.5 * rng.random::<f64>());
        let random = &mut |_, _| least + (most - least) * rng.random::<f64>();
        let earth = EarthAlbedo::tabulated("random", grid(step, random));
        let (least, most) = earth.grid().unwrap().range();
        for _ in 0..50 {
            let height = 3e5 * 100.0_f64.powf(rng.random());
            let globe = below(height, 180.0 * rng.random::<f64>() - 90.0, rotation(&mut rng));
            let sum = |nodes: &[(DVec3, f64)]| nodes.iter().map(|n| n.1).sum::<f64>();
            for order in [1, 2, 3, 5, 8, 13, 21] {
                let even = sum(&shine::cap(&globe, order));
                let found = sum(&earth.shines(&globe, order, 550.0));
                assert!(found >= least * even - 1e-12 && found <= most * even + 1e-12);
            }
            let facing = |(d, e): &(DVec3, f64)| e * d.dot(globe.toward).max(0.0);
            let facet: f64 = earth.shines(&globe, 21, 550.0).iter().map(facing).sum();
            assert!(facet <= engine::earthshine(&globe, earth.most()) + 1e-12, "{facet}");
        }
    }
}

/// Truth: arithmetic. The mean of a grid weighs cells with their area: for ρ = sin² φ (the value at the middles of 1° rows) 1/3, to 1e-4 for the rows; and what a grid has at a
/// wavelength between two layers is on the line between them.
#[test]
fn means_and_wavelengths() {
    let square = |row: usize, _: usize| (row as f64 + 0.5 - 90.0).to_radians().sin().powi(2);
    let mean = grid(1.0, &mut { square }).means();
    assert!((mean[0] - 1.0 / 3.0).abs() < 1e-4, "{mean:?}");
    let places_deg = vec![[-45.0, -90.0], [-45.0, 90.0], [45.0, -90.0], [45.0, 90.0]];
    let cells = Cells { places_deg, albedo: [0.1, 0.3, 0.5].repeat(4) };
    let grid = AlbedoGrid::new(&cells, &[400.0, 500.0, 700.0], false, None).unwrap();
    let spectra = grid.spectra().unwrap();
    assert_eq!((grid.layers(), grid.size(), grid.known_nm()), (3, (2, 4 / 2), (400.0, 700.0)));
    let earth = EarthAlbedo::tabulated("three", grid);
    for (nm, expected) in [(400.0, 0.1), (450.0, 0.2), (600.0, 0.4), (700.0, 0.5)] {
        let by_terms: f64 = spectra.iter().zip([0.1, 0.3, 0.5]).map(|(s, a)| s.at(nm) * a).sum();
        assert!((by_terms - expected).abs() < 1e-12, "{nm}");
        assert!((earth.mean_at(nm) - expected).abs() < 1e-7, "{nm}");
    }
    // What is unknown is not given a spectrum: the terms end with the table.
    assert!(spectra.iter().all(|s| s.range_nm() == (400.0, 700.0)));
}
