//! Corner cubes: closed forms, ray traces of another program, published cross-sections.

use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use sunglint_simulator::ranging::cubes::{
    Array, Back, CornerCube, Glass, none_of_speckled, velocity_aberration,
};
use sunglint_simulator::target::Target;

const NM: f64 = 532.0;

fn cube(back: Back) -> CornerCube {
    CornerCube {
        position_m: DVec3::ZERO,
        normal: DVec3::Z,
        edge: DVec3::X,
        diameter_m: 0.0381,
        glass: Glass::FusedSilica,
        back,
        dihedral_rad: 0.0,
    }
}

fn tilted(degrees: f64, azimuth: f64) -> DVec3 {
    DQuat::from_rotation_z(azimuth) * DQuat::from_rotation_y(degrees.to_radians()) * DVec3::Z
}

/// Truth: the closed form of two discs, η = (2/π)(asin µ − √2 µ tan θ'), µ = √(1 − 2 tan²θ') (Degnan 1993), which a ray trace of another program met to 4e-4, at any azimuth; nothing beyond 57.5° in silica, 35.3° hollow.
#[test]
fn the_active_area_is_the_closed_form() {
    let solid = CornerCube { glass: Glass::Index(1.4607), ..cube(Back::Uncoated) };
    let hollow = CornerCube { glass: Glass::Hollow, ..cube(Back::Perfect) };
    let front = PI / 4.0 * 0.0381_f64.powi(2);
    for (cube, n) in [(solid, 1.4607), (hollow, 1.0)] {
        for degrees in [0.0_f64, 5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 57.0] {
            let within = (degrees.to_radians().sin() / n).asin();
            let square = 1.0 - 2.0 * within.tan().powi(2);
            let mu = square.max(0.0).sqrt();
            let share = if square > 0.0 {
                2.0 / PI * (mu.asin() - 2.0_f64.sqrt() * mu * within.tan())
            } else {
                0.0
            };
            for azimuth in [0.0, 0.7, 2.0] {
                let found = cube.active_area_m2(NM, tilted(degrees, azimuth));
                let expected = front * share * degrees.to_radians().cos();
                assert!(
                    (found - expected).abs() < 1e-6 * front,
                    "{n} {degrees}: {found} {expected}"
                );
            }
        }
    }
    // The table of the ray trace, n = 1.4607.
    for (degrees, traced) in [(10.0, 0.7739), (20.0, 0.5404), (30.0, 0.3244), (40.0, 0.1490)] {
        let found = solid.active_area_m2(NM, tilted(degrees, 0.3)) / front;
        assert!((found - traced).abs() < 5e-4, "{degrees}: {found}");
    }
    assert_eq!(solid.active_area_m2(NM, tilted(58.0, 0.1)), 0.0);
    assert_eq!(hollow.active_area_m2(NM, tilted(35.5, 0.1)), 0.0);
    assert_eq!(solid.active_area_m2(NM, DVec3::NEG_Z), 0.0);
    // Malitson 1965 at 532 nm.
    assert!((Glass::FusedSilica.index(532.0) - 1.4607).abs() < 1e-4);
}

/// Truth: on the axis a perfect mirror has 4πA²/λ²; a bare cube of silica 0.2663 of it, through a front that passes 0.965 twice 0.248; one with aluminium of 0.7 + 5.5i behind 0.616 (ray trace and Jones product of another
/// program; published 0.264 for total reflection). 57.7 and 14.3 Mm² for 38.1 mm. Off the axis of a perfect disc the Airy pattern.
#[test]
fn cross_sections_on_the_axis() {
    let hollow = CornerCube { glass: Glass::Hollow, ..cube(Back::Perfect) };
    let ideal = hollow.ideal_m2(NM);
    assert!((ideal / 57.7e6 - 1.0).abs() < 1e-3, "{ideal}");
    let on_axis = |cube: CornerCube| cube.cross_section_m2(NM, DVec3::Z, DVec3::ZERO) / ideal;
    assert!((on_axis(hollow) - 1.0).abs() < 1e-12);
    let bare = on_axis(cube(Back::Uncoated));
    assert!((bare - 0.248).abs() < 1e-3, "{bare}");
    assert!((bare * ideal / 14.3e6 - 1.0).abs() < 5e-3);
    // The ray trace took no account of the front's passage for the metal.
    let coated = CornerCube { glass: Glass::Index(1.4607), ..cube(Back::Metal { n: 0.7, k: 5.5 }) };
    let pass = 1.0 - (0.4607_f64 / 2.4607).powi(2);
    let found = on_axis(coated) / pass.powi(2);
    assert!((found - 0.616).abs() < 3e-3 || (on_axis(coated) - 0.616).abs() < 3e-3, "{found}");
    // (2 J₁(x)/x)² with J₁ by its integral.
    let bessel = |x: f64| {
        let n = 2000;
        (0..n)
            .map(|i| PI * (f64::from(i) + 0.5) / f64::from(n))
            .map(|t| (t - x * t.sin()).cos())
            .sum::<f64>()
            / f64::from(n)
    };
    for microradians in [5.0, 15.0, 25.0, 40.0] {
        let offset = DVec3::new(0.6, 0.8, 0.0) * microradians * 1e-6;
        let x = PI * 0.0381 / (NM * 1e-9) * microradians * 1e-6;
        let airy = (2.0 * bessel(x) / x).powi(2);
        let found = hollow.cross_section_m2(NM, DVec3::Z, offset) / ideal;
        assert!((found - airy).abs() < 1e-6, "{microradians}: {found} {airy}");
    }
}

/// Truth: energy. ∬ σ dΩ over all directions is 4π × (throughput) × (front), 0.931 of the light on it. What lies beyond ±w falls as 1/w, as beyond any edge of an aperture, so that 2 E(440 µrad) − E(220 µrad) is the whole: 2e-3, the next
/// power. Another program's Fourier transform on a grid has 0.9025 within ±220 µrad (1 %: its pixels' edge).
#[test]
fn what_comes_back_is_what_went_in() {
    let bare = cube(Back::Uncoated);
    let front = PI / 4.0 * 0.0381_f64.powi(2);
    let through = bare.throughput(NM, DVec3::Z);
    assert!((through - 0.931).abs() < 1e-3, "{through}");
    // Steps of 4 µrad: the pattern is band-limited, λ/D being 14 µrad.
    let step = 4e-6;
    let within = |half: f64| {
        let steps = (2.0 * half / step).round() as i32;
        let at = |k: i32| -half + (f64::from(k) + 0.5) * step;
        let mut sum = 0.0;
        for i in 0..steps {
            for j in 0..steps {
                sum += bare.cross_section_m2(NM, DVec3::Z, DVec3::new(at(i), at(j), 0.0));
            }
        }
        sum * step * step / (4.0 * PI * front)
    };
    let (inner, outer) = (within(220e-6), within(440e-6));
    assert!((inner / 0.9025 - 1.0).abs() < 1e-2, "{inner}");
    assert!((2.0 * outer - inner - through).abs() < 2e-3, "{inner} {outer} {through}");
}

/// Truth: six beams at (4√6/3) n δ = 3.266 n δ from the axis, 60° apart; 1.25″ in silica are 28.9 µrad (closed form; traced by another program).
#[test]
fn dihedral_offsets_part_the_beam_in_six() {
    let dihedral_rad = (1.25_f64 / 3600.0).to_radians();
    let beams = CornerCube { dihedral_rad, ..cube(Back::Uncoated) }.beams(NM, DVec3::Z);
    assert_eq!(beams.len(), 6);
    for beam in &beams {
        let expected = 4.0 * 6.0_f64.sqrt() / 3.0 * 1.4607 * dihedral_rad;
        assert!((beam.length() / expected - 1.0).abs() < 1e-3, "{beam}");
        assert!((beam.length() - 28.9e-6).abs() < 0.05e-6);
    }
    let mut azimuths: Vec<f64> = beams.iter().map(|b| b.y.atan2(b.x).to_degrees()).collect();
    azimuths.sort_by(f64::total_cmp);
    assert!(azimuths.windows(2).all(|w| (w[1] - w[0] - 60.0).abs() < 0.1), "{azimuths:?}");
}

/// Truth: a 1.0-inch bare cube without offset returns about 0.5 million m² at LAGEOS' velocity aberration of 32 to 40 µrad, in six lobes about the central peak (Arnold, abstract of *Thermal-optical design of a geodetic satellite for one
/// millimeter accuracy*). Tolerance: a factor of 1.3 for "about".
#[test]
fn an_inch_without_offset_is_the_published_one() {
    let inch = CornerCube { diameter_m: 0.0254, ..cube(Back::Uncoated) };
    let mut ring = Vec::new();
    for k in 0..72 {
        let (sin, cos) = (f64::from(k) * PI / 36.0).sin_cos();
        let at =
            |radius: f64| inch.cross_section_m2(NM, DVec3::Z, DVec3::new(cos, sin, 0.0) * radius);
        ring.push([32e-6, 36e-6, 40e-6].map(at).iter().sum::<f64>() / 3.0);
    }
    let mean = ring.iter().sum::<f64>() / 72.0;
    assert!((0.5e6 / 1.3..0.5e6 * 1.3).contains(&mean), "{mean}");
    let peaks = (0..72)
        .filter(|k| ring[*k] > ring[(k + 71) % 72] && ring[*k] >= ring[(k + 1) % 72])
        .count();
    assert_eq!(peaks, 6, "{ring:?}");
}

/// Truth: the ILRS list's 15 Mm² (Arnold; within 20 %, as asked) at 35 µrad, the mean over attitudes; a prototype of another program has 16.5, 15.7 and 14.6 Mm² at 32, 35 and 38 µrad, from the same array (3 %: it averaged its pattern over azimuth).
#[test]
fn lageos_is_the_listed_one() {
    let array = Target::built_in("lageos").unwrap().retros;
    assert_eq!(array.cubes.len(), 426);
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let mean = |microradians: f64| {
        let n = 400;
        let one = |k: i32| {
            let z: f64 = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(n);
            let (sin, cos) = (golden * f64::from(k)).sin_cos();
            let across = (1.0 - z * z).sqrt();
            let toward = DVec3::new(across * cos, across * sin, z);
            let side = DQuat::from_axis_angle(toward, 2.399 * f64::from(k) * 7.0)
                * toward.any_orthonormal_vector();
            array.cross_section_m2(NM, toward, microradians * 1e-6 * side)
        };
        (0..n).map(one).sum::<f64>() / f64::from(n) / 1e6
    };
    for (microradians, other) in [(32.0, 16.5), (35.0, 15.7), (38.0, 14.6)] {
        let found = mean(microradians);
        println!("{microradians} µrad: {found:.2} Mm²");
        assert!((found / other - 1.0).abs() < 0.03, "{microradians}: {found}");
    }
    assert!((mean(35.0) / 15.0 - 1.0).abs() < 0.2);
}

/// Truth: α = (2v/c) √(1 − sin²θ_h cos²ω) of a circular orbit: LAGEOS overhead 38.1 µrad (5,860 km: v = 5.71 km/s).
#[test]
fn the_beam_comes_back_beside_the_station() {
    let speed = (3.986_004_418e14_f64 / (6_378_137.0 + 5_860e3)).sqrt();
    let overhead = velocity_aberration(DVec3::X * speed, DVec3::NEG_Z);
    assert!((overhead.length() - 38.1e-6).abs() < 0.1e-6, "{overhead}");
    assert!(overhead.x < 0.0 && overhead.z == 0.0);
    let low = DVec3::new(0.6, 0.0, -0.8);
    let found = velocity_aberration(DVec3::X * speed, low).length();
    assert!((found / (overhead.length() * 0.8) - 1.0).abs() < 1e-12, "{found}");
}

/// Truth: a ring of uniform density seen from the side is the arcsine law: two humps at ±R sin ψ of root mean square R sin ψ/√2 (closed form): 0.561 m from the middle at a nadir angle of 40°, for TOPEX's ring of 0.82 m with half of it each way.
#[test]
fn a_ring_has_two_humps() {
    let array = Target::built_in("topex").unwrap().retros;
    assert_eq!(array.cubes.len(), 192);
    let psi = 40.0_f64.to_radians();
    let toward = DVec3::new(psi.sin(), 0.0, psi.cos());
    let mut all: Vec<f64> = array.cubes.iter().map(|c| -c.position_m.dot(toward)).collect();
    let middle = all.iter().sum::<f64>() / 192.0;
    all.iter_mut().for_each(|d| *d -= middle);
    let rms = (all.iter().map(|d| d * d).sum::<f64>() / 192.0).sqrt();
    assert!((rms / (0.82 * psi.sin() * FRAC_1_SQRT_2) - 1.0).abs() < 2e-3, "{rms}");
    // Each hump, the quarter of the cubes nearest to its end: within the outermost 15 % of the width.
    all.sort_by(f64::total_cmp);
    let (near, far) = (all[47], all[144]);
    assert!(far - near > 0.65 * 2.0 * 0.82 * psi.sin(), "{near} {far}");
    // The near hump is brighter: its fronts lean towards the station.
    let halves = [-1.0, 1.0].map(|side: f64| {
        let chosen =
            array.cubes.iter().filter(|c| side * (-c.position_m.dot(toward) - middle) > 0.0);
        Array { cubes: chosen.copied().collect() }.cross_section_m2(
            NM,
            toward,
            DVec3::new(0.0, 40e-6, 0.0),
        )
    });
    assert!(halves[0] > 2.0 * halves[1], "{halves:?}");
}

/// Truth: Bose–Einstein and Poisson in closed form, and 400,000 draws of another program with scintillation of σ² = 0.2: detection of n̄ = 1 in 0.632, 0.590, 0.500 and 0.476 of the shots, of n̄ = 10 in 1.000, 0.993, 0.909 and 0.893.
#[test]
fn speckle_and_scintillation_hide_shots() {
    for (mean, published) in
        [(1.0, [0.632, 0.590, 0.500, 0.476]), (10.0, [1.000, 0.993, 0.909, 0.893])]
    {
        let found = [(1e12, 0.0), (4.0, 0.0), (1.0, 0.0), (1.0, 0.2)]
            .map(|(cells, scintillation)| 1.0 - none_of_speckled(mean, cells, scintillation));
        for (found, published) in found.iter().zip(published) {
            assert!((found - published).abs() < 1.5e-3, "{mean}: {found} {published}");
        }
    }
}

/// Truth: L√(n² − sin²θ) of glass by hand: a cube of 38.1 mm has its vertex 26.94 mm deep, and returns from 39.35 mm behind its front.
#[test]
fn glass_lengthens_the_way() {
    let bare = cube(Back::Uncoated);
    assert!((bare.vertex_depth_m() - 0.026_941).abs() < 1e-6);
    assert!((bare.depth_m(NM, DVec3::Z) - 0.039_352).abs() < 3e-6);
    let moved = CornerCube { position_m: DVec3::new(0.0, 0.0, 0.3), ..bare };
    // LAGEOS' centre of mass: leading edge by one cube, 0.300 − 0.039 m.
    assert!((moved.depth_m(NM, DVec3::Z) + 0.260_6).abs() < 1e-4);
}

/// Wrong numbers are refused with the key.
#[test]
fn wrong_cubes_are_refused() {
    let part = "[[part]]\nname = \"a\"\nshape = \"sphere\"\nradius_m = 1\nmaterial = \"white\"\n[[retro]]\n";
    for (keys, expected) in [
        ("diameter_mm = 38.1\ncount = 0\n", "retro[0].count"),
        ("diameter_mm = -1\n", "diameter_mm"),
        ("diameter_mm = 38.1\naxis = [0, 0, 0]\n", "retro[0].axis"),
        ("diameter_mm = 38.1\nindex = 0.5\n", "a refractive index from 1 to 5"),
        ("diameter_mm = 38.1\nindex = 1.5\nmaterial = \"hollow\"\n", "either material or index"),
        (
            "diameter_mm = 38.1\nmaterial = \"hollow\"\nback = \"uncoated\"\n",
            "a hollow cube needs one",
        ),
        ("diameter_mm = 38.1\ndihedral_arcsec = 1e9\n", "at most 600"),
        ("diameter_mm = 38.1\nangle = 1\n", "angle"),
        ("count = 3\n", "diameter_mm"),
    ] {
        let error = Target::parse("t.toml", format!("{part}{keys}")).unwrap_err().to_string();
        assert!(error.contains(expected), "{keys}: {error}");
    }
}
