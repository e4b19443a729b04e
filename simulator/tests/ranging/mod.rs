//! Laser returns against closed forms and rays.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod bounces;
mod cubes;

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::PI;
use sunglint_simulator::light::{Faceted, View};
use sunglint_simulator::ranging::glint::{self, Mirror};
use sunglint_simulator::ranging::{
    Beam, BeamShape, DepthBins, DepthError, Profile, Receiver, Shot, Stand, detection_probability,
};
use sunglint_simulator::target::{Shape, Target};

/// h c in J nm (CODATA 2018: h and c are exact).
const HC_J_NM: f64 = 6.626_070_15e-34 * 299_792_458.0 * 1e9;

/// The space debris laser of the thesis, table A.1.
fn graz() -> Beam {
    Beam {
        wavelength_nm: 1064.0,
        linewidth_nm: 1.0,
        pulse_energy_j: 0.140,
        pulse_length_s: 7e-9,
        repetition_rate_hz: 200.0,
        divergence_rad: (5.0_f64 / 3600.0).to_radians(),
        radius_m: 0.06,
        shape: BeamShape::TopHat,
    }
}

const RECEIVER: Receiver = Receiver { area_m2: 0.11, efficiency: 0.2 };
const BINS: DepthBins = DepthBins { from_m: -5.0, step_m: 0.05, count: 200 };

fn target(parts: &str) -> Target {
    let text = format!(
        "{parts}\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.4\n"
    );
    Target::parse("target.toml", text).expect("a target")
}

fn shot<'a>(beam: &'a Beam, toward: DVec3, range_m: f64) -> Shot<'a> {
    let (stand, off_axis_m) = (Stand { toward, range_m }, DVec3::ZERO);
    let (laser, telescope) = (stand, stand);
    Shot { beam, receiver: &RECEIVER, laser, telescope, off_axis_m, sun_body: DVec3::X }
}

fn returned(target: &Target, shot: &Shot, reflectance: &[f64], bins: DepthBins) -> Profile {
    let body = Faceted::new(target).expect("a scene");
    shot.profile(&mut body.eye(), reflectance, bins).expect("a profile")
}

/// Counts of a fluence on the body that sends back `w` m² sr⁻¹, written out.
fn counts(fluence: f64, w: f64, range_m: f64) -> f64 {
    fluence * w / (range_m * range_m) * 0.11 * 0.2 * 1064.0 / HC_J_NM
}

/// Truth: fig. 3.5 and eq. A.3 of the thesis as corrected: sunlight of 0.66 W m⁻² nm⁻¹ over the light within a pulse behind air of 0.97 is 1.6e-5 at 1,000 km
/// and 2.0e-2 at 36,000 km. Tolerance: half of the last digit.
#[test]
fn sun_over_laser_is_as_published() {
    let ratio = |range_m| 0.66 / (0.97 * graz().peak_spectral_irradiance(range_m));
    assert!((ratio(1e6) - 1.6e-5).abs() < 0.05e-5, "{}", ratio(1e6));
    assert!((ratio(36e6) - 2.0e-2).abs() < 0.05e-2, "{}", ratio(36e6));
    // The mean over pulses and pauses is 7e5 times less than within a pulse: 200 Hz times 7 ns.
    let beam = graz();
    let mean = beam.mean_irradiance_w_m2(1e6) / beam.linewidth_nm;
    assert!((mean / beam.peak_spectral_irradiance(1e6) / 1.4e-6 - 1.0).abs() < 1e-12);
}

/// Truth: closed form, n̄ = W/(πw²) ρ/π A cos²θ · A_tel η λ/(hc r²) of a diffuse plate, all its light from a depth that is linear over it. Rounding.
#[test]
fn a_diffuse_plate() {
    let plate =
        target("[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [0.6, 0.8]\nfaces = [\"+z\"]");
    let beam = graz();
    let toward = DVec3::new(0.6, 0.0, 0.8);
    let found = returned(&plate, &shot(&beam, toward, 1e6), &[0.4], BINS);
    let w = 1e6 * (2.5_f64 / 3600.0).to_radians().tan() + 0.06;
    let expected = counts(0.140 / (PI * w * w), 0.4 / PI * 0.48 * 0.64, 1e6);
    assert!((found.total / expected - 1.0).abs() < 1e-12, "{} {expected}", found.total);
    assert_eq!(found.outside, 0.0);
    // ±0.3 m along x stand 0.36 m apart in depth: from −0.18 to 0.18 m, evenly.
    for (k, photons) in found.photons.iter().enumerate() {
        let (low, high) = (-5.0 + 0.05 * k as f64, -5.0 + 0.05 * (k + 1) as f64);
        let share = (high.min(0.18) - low.max(-0.18)).max(0.0) / 0.36;
        assert!((photons - expected * share).abs() < 1e-12 * expected, "bin {k}");
        assert!((found.area_m2[k] - 0.48 * 0.8 * share).abs() < 1e-12, "bin {k}");
    }
    assert!(found.mean_depth_m().abs() < 1e-12);
}

/// Truth: closed form, of a laser 60° to one side of a telescope above a diffuse plate: fluence at the laser's range, A cosθ_i cosθ_o ρ/π, the telescope's range
/// to the square; half of the way is linear over the plate, ±0.15 m sin 60° for x = ±0.3 m (the telescope's part is 0). Rounding.
#[test]
fn a_laser_away_from_the_telescope() {
    let plate =
        target("[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [0.6, 0.8]\nfaces = [\"+z\"]");
    let beam = graz();
    let toward = DVec3::new(0.75_f64.sqrt(), 0.0, 0.5);
    let aimed = Shot { laser: Stand { toward, range_m: 7e5 }, ..shot(&beam, DVec3::Z, 1e6) };
    let found = returned(&plate, &aimed, &[0.4], BINS);
    let w = 7e5 * (2.5_f64 / 3600.0).to_radians().tan() + 0.06;
    let expected = counts(0.140 / (PI * w * w), 0.4 / PI * 0.48 * 0.5, 1e6);
    assert!((found.total / expected - 1.0).abs() < 1e-12, "{} {expected}", found.total);
    let reach = 0.15 * 0.75_f64.sqrt();
    for (k, photons) in found.photons.iter().enumerate() {
        let (low, high) = (-5.0 + 0.05 * k as f64, -5.0 + 0.05 * (k + 1) as f64);
        let share = (high.min(reach) - low.max(-reach)).max(0.0) / (2.0 * reach);
        assert!((photons - expected * share).abs() < 1e-12 * expected, "bin {k}");
        // The area is that across the telescope's line of sight.
        assert!((found.area_m2[k] - 0.48 * share).abs() < 1e-12, "bin {k}");
    }
}

/// Truth: closed forms of spheres at phase angle 0: W = 2/3 ρR² of Lambert's, ρR²/4 of a mirror (total: 1e-9); depth below the front z has cosθ = 1 − z/R
/// and the share 3(1 − z/R)² dz/R of a Lambert sphere's light. Its 5,120 facets: 2e-3 of all light in the sums over bins.
#[test]
fn spheres() {
    let beam = graz();
    let fluence = beam.fluence_j_m2(1e6, 0.0);
    let mut sphere =
        target("[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 1.5\noffset_m = [0, 0, 2]");
    let found = returned(&sphere, &shot(&beam, DVec3::Z, 1e6), &[0.4], BINS);
    let expected = counts(fluence, 2.0 / 3.0 * 0.4 * 2.25, 1e6);
    assert!((found.total / expected - 1.0).abs() < 1e-9, "{} {expected}", found.total);
    let (mut sum, mut truth) = (0.0, 0.0);
    for (k, photons) in found.photons.iter().enumerate() {
        // The front stands at −3.5 m.
        let depth = |edge: f64| ((edge + 3.5) / 1.5).clamp(0.0, 1.0);
        let below = |edge: f64| 1.0 - (1.0 - depth(edge)).powi(3);
        truth += below(-5.0 + 0.05 * (k + 1) as f64) - below(-5.0 + 0.05 * k as f64);
        sum += photons / expected;
        assert!((sum - truth).abs() < 2e-3, "bin {k}: {sum} {truth}");
    }

    sphere.materials[0] = sunglint_simulator::surface::Material::built_in("unit").unwrap();
    let mirror = "name = \"t\"\n[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 1.5\noffset_m = [0, 0, 2]\nmaterial = \"m\"\n\
                  [[material]]\nname = \"m\"\nmodel = \"mirror\"\nreflectance = 0.9\n";
    let mirror = Target::parse("m.toml", mirror).unwrap();
    let found = returned(&mirror, &shot(&beam, DVec3::Z, 1e6), &[0.9], BINS);
    let expected = counts(fluence, 0.9 * 2.25 / 4.0, 1e6);
    assert!((found.total / expected - 1.0).abs() < 1e-9);
    // All of it from the front, which lies on the edge between two bins.
    assert!((found.photons[29] + found.photons[30] - found.total).abs() < 1e-9 * expected);
}

/// Truth: conservation of energy: a diffuse wall much wider than the spot takes the whole pulse, whatever its shape: n̄ = W ρ/π · A_tel η λ/(hc r²). The Gaussian's tail
/// beyond 60 m is 1e-21. 1e-3 is what the issue asks for; the top hat's edge is found to 4e-3 of its radius, in or out by chance.
#[test]
fn a_wall_takes_the_whole_pulse() {
    let wall =
        target("[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [120, 120]\nfaces = [\"+z\"]");
    for (shape, off) in
        [(BeamShape::TopHat, 0.0), (BeamShape::Gaussian, 0.0), (BeamShape::Gaussian, 9.0)]
    {
        let beam = Beam { shape, ..graz() };
        let aimed = Shot { off_axis_m: DVec3::new(off, 0.0, 0.0), ..shot(&beam, DVec3::Z, 1e6) };
        let found = returned(&wall, &aimed, &[0.4], BINS);
        let expected = counts(0.140, 0.4 / PI, 1e6);
        assert!(
            (found.total / expected - 1.0).abs() < 1e-3,
            "{shape:?}: {}",
            found.total / expected
        );
    }
}

/// Truth: closed form: a Gaussian beam has e^{−2(ρ/w)²} of its middle at ρ, twice the top hat's in the middle. A small plate there: 1e-5 (its own size).
#[test]
fn a_plate_off_the_axis_gets_less() {
    let plate =
        target("[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [0.1, 0.1]\nfaces = [\"+z\"]");
    let beam = Beam { shape: BeamShape::Gaussian, ..graz() };
    let w = beam.spot_radius_m(1e6);
    let total = |off: f64| {
        let aimed = Shot { off_axis_m: DVec3::new(0.0, off, 0.0), ..shot(&beam, DVec3::Z, 1e6) };
        returned(&plate, &aimed, &[0.4], BINS).total
    };
    assert!((total(w) / total(0.0) - (-2.0_f64).exp()).abs() < 1e-5);
    let flat = returned(&plate, &shot(&graz(), DVec3::Z, 1e6), &[0.4], BINS).total;
    assert!((total(0.0) / flat - 2.0).abs() < 1e-4);
}

fn square(half_m: f64) -> [DVec3; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| DVec3::new(x * half_m, y * half_m, 0.0))
}

/// Truth: the image source. A mirror that faces laser and receiver returns the beam's own fluence at twice the range, (R/4 of what arrives, but for R₀): 1e-3
/// for 10 m at 1,000 km, where diffraction rounds the edge only. Tilted by more than its half-width over the range it returns nothing; one much smaller than the Fresnel
/// zone returns H (A/λr)² (Fraunhofer): 1e-3 for 1 cm.
#[test]
fn a_flat_mirror_shows_the_laser_at_twice_the_range() {
    let beam = graz();
    let laser = DVec3::new(0.0, 0.0, 1e6);
    let at = |half_m: f64, offset: DVec3| {
        let corners = square(half_m).map(|c| c + offset);
        let mirror = Mirror { corners: &corners, normal: DVec3::Z, reflectance: 0.9 };
        glint::fluence_j_m2(&mirror, &beam, (laser, DVec3::NEG_Z), laser)
    };
    let image = 0.9 * beam.fluence_j_m2(2e6, 0.0);
    assert!((at(5.0, DVec3::ZERO) / image - 1.0).abs() < 1e-3, "{}", at(5.0, DVec3::ZERO) / image);
    assert!((image / (0.9 * beam.fluence_j_m2(1e6, 0.0)) - 0.25).abs() < 0.002);
    // The foot of the laser's line on the mirror's plane lies 1 m outside, and on the very edge.
    assert!(at(5.0, DVec3::new(6.5, 0.0, 0.0)) < 1e-3 * image);
    assert!((at(5.0, DVec3::new(5.0, 0.0, 0.0)) / image - 0.5).abs() < 1e-3);
    let area: f64 = 1e-4;
    let fraunhofer = 0.9 * beam.fluence_j_m2(2e6, 0.0) * 4.0 * (area / (1064e-9 * 1e6)).powi(2);
    assert!((at(0.005, DVec3::ZERO) / fraunhofer - 1.0).abs() < 1e-3);
    // From behind it shows nothing.
    let corners = square(5.0);
    let mirror = Mirror { corners: &corners, normal: DVec3::NEG_Z, reflectance: 0.9 };
    assert_eq!(glint::fluence_j_m2(&mirror, &beam, (laser, DVec3::NEG_Z), laser), 0.0);
}

/// Whether a ray meets a triangle, and where (Möller and Trumbore 1997), either side.
fn meets(origin: DVec3, ray: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (e, f) = (b - a, c - a);
    let p = ray.cross(f);
    let det = e.dot(p);
    if det.abs() < 1e-15 {
        return None;
    }
    let s = (origin - a) / det;
    let (u, q) = (s.dot(p), s.cross(e));
    let v = ray.dot(q);
    let t = f.dot(q);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

/// Truth: 200,000 rays from the observer to the box-wing, first triangle met, depth and reflected light of each (laser and receiver in one place: what is seen is
/// lit); no code shared but the materials' weights. Tolerance: 5 standard errors in each bin of both histograms.
#[test]
fn the_box_wing_histograms_agree_with_rays() {
    let target = Target::built_in("box_wing_diffuse").unwrap();
    let toward = DVec3::new(0.5, 0.35, 0.79).normalize();
    let bins = DepthBins { from_m: -2.0, step_m: 0.1, count: 40 };
    let beam = graz();
    let body = Faceted::new(&target).unwrap();
    let scene = body.scene();
    let rho: Vec<f64> = scene.spectra().map(|s| s.at(1064.0)).collect();
    let found = shot(&beam, toward, 1e6).profile(&mut body.eye(), &rho, bins).unwrap();
    assert_eq!(found.outside, 0.0);

    let mut triangles = Vec::new();
    for part in &target.parts {
        let Shape::Mesh(mesh) = &part.shape else { unreachable!("box-wing has flat faces") };
        for t in &mesh.triangles {
            let corners = t.map(|k| part.placement.point(mesh.vertices[k as usize]));
            triangles.push((corners, part.material));
        }
    }
    let (x, y) = toward.any_orthonormal_pair();
    let half = 3.2;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(11);
    let rays = 200_000;
    let (mut light, mut squares, mut hits) = ([0.0; 40], [0.0; 40], [0.0; 40]);
    for _ in 0..rays {
        let (u, v): (f64, f64) = (random.random(), random.random());
        let origin = half * ((2.0 * u - 1.0) * x + (2.0 * v - 1.0) * y) + 10.0 * toward;
        let first = triangles
            .iter()
            .filter_map(|(corners, m)| meets(origin, -toward, *corners).map(|t| (t, corners, *m)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((t, [a, b, c], material)) = first else { continue };
        let cos = (*b - *a).cross(*c - *a).normalize().dot(toward);
        assert!(cos > 0.0, "a closed body shows its outside");
        let k = (((t - 10.0) - bins.from_m) / bins.step_m).floor() as usize;
        let value = rho[scene.weights_of(material).start] / PI * cos;
        light[k] += value;
        squares[k] += value * value;
        hits[k] += 1.0;
    }
    let window = 4.0 * half * half / f64::from(rays);
    for k in 0..40 {
        let expected = counts(beam.fluence_j_m2(1e6, 0.0), light[k] * window, 1e6);
        let sigma = counts(beam.fluence_j_m2(1e6, 0.0), squares[k].sqrt() * window, 1e6);
        let floor = 1e-9 * found.total;
        assert!(
            (found.photons[k] - expected).abs() <= 5.0 * sigma + floor,
            "bin {k}: {} {expected}",
            found.photons[k]
        );
        let sigma = window * f64::sqrt(hits[k]);
        assert!((found.area_m2[k] - hits[k] * window).abs() <= 5.0 * sigma + 2e-5, "bin {k}");
    }
}

/// Truth: the engine's own direct weights, exact by other tests: in the mean of a wide beam the bins hold all of it.
#[test]
fn the_bins_hold_what_the_engine_sums() {
    let body = Faceted::new(&Target::built_in("box_wing").unwrap()).unwrap();
    let scene = body.scene();
    let mut evaluator = scene.evaluator();
    let beam = Beam { divergence_rad: 1e-2, ..graz() };
    let rho: Vec<f64> = scene.spectra().map(|s| s.at(532.0)).collect();
    let toward = DVec3::new(0.3, -0.8, 0.5).normalize();
    let found = shot(&beam, toward, 1e6).profile(&mut body.eye(), &rho, BINS).unwrap();
    let mut weights = vec![0.0; scene.weight_count()];
    evaluator.direct(toward, View::Distant(toward), &mut weights).unwrap();
    let w: f64 = weights.iter().zip(&rho).map(|(w, r)| w * r).sum();
    let expected = counts(beam.fluence_j_m2(1e6, 0.0), w, 1e6);
    assert!((found.total / expected - 1.0).abs() < 1e-12);
    assert!((found.photons.iter().sum::<f64>() / expected - 1.0).abs() < 1e-12);
}

fn recorded(bins: DepthBins, photons: Vec<f64>) -> Profile {
    let (total, area_m2) = (photons.iter().sum(), vec![0.0; photons.len()]);
    Profile { bins, photons, area_m2, total, outside: 0.0, retro: 0.0, bounced: None }
}

/// Truth: Poisson statistics in closed form: P = 1 − e^{−n̄}; of two equal bins of n the first photon falls into the near one with 1 − e^{−n}, into the far one with
/// e^{−n}(1 − e^{−n}).
#[test]
fn a_detector_that_stops_at_the_first_photon_sees_the_near_side() {
    assert!((detection_probability(1e-9) / 1e-9 - 1.0).abs() < 1e-9);
    assert_eq!(detection_probability(0.0), 0.0);
    let bins = DepthBins { from_m: 0.0, step_m: 1.0, count: 2 };
    let photons = vec![1.5, 1.5];
    let profile = recorded(bins, photons);
    let first = profile.first_photon();
    let near = 1.0 - (-1.5_f64).exp();
    assert!((first[0] - near).abs() < 1e-15 && (first[1] - (1.0 - near) * near).abs() < 1e-15);
    assert!((first.iter().sum::<f64>() - detection_probability(3.0)).abs() < 1e-15);
    // There and back: 2 d/c.
    assert!((profile.delays_s()[0] - 1.0 / 299_792_458.0).abs() < 1e-20);
    // A blur keeps photons and mean where the bins are wide enough for it.
    let bins = DepthBins { from_m: -10.0, step_m: 0.1, count: 200 };
    let mut photons = vec![0.0; 200];
    photons[80] = 2.0;
    let profile = recorded(bins, photons);
    let blurred = profile.blurred(0.5);
    assert!((blurred.iter().sum::<f64>() - 2.0).abs() < 1e-12);
    let variance: f64 =
        blurred.iter().enumerate().map(|(k, n)| n / 2.0 * (0.1 * (k as f64 - 80.0)).powi(2)).sum();
    // Sheppard: bins of 0.1 add their own 0.1²/12.
    assert!((variance - 0.25 - 0.01 / 12.0).abs() < 1e-6, "{variance}");
}

#[test]
fn what_is_no_range_or_bin_is_refused() {
    let body = Faceted::new(&Target::built_in("box_wing").unwrap()).unwrap();
    let beam = graz();
    let mut eye = body.eye();
    let rho = vec![0.5; body.scene().weight_count()];
    let mut of = |shot: Shot, bins| shot.profile(&mut eye, &rho, bins).unwrap_err();
    for bins in [
        DepthBins { step_m: 0.0, ..BINS },
        DepthBins { from_m: f64::NAN, ..BINS },
        DepthBins { count: 0, ..BINS },
        DepthBins { count: 2_000_000, ..BINS },
    ] {
        assert!(matches!(of(shot(&beam, DVec3::Z, 1e6), bins), DepthError::Bins { .. }));
    }
    assert!(matches!(of(shot(&beam, DVec3::Z, -1.0), BINS), DepthError::Range { .. }));
    assert!(matches!(of(shot(&beam, DVec3::ZERO, 1e6), BINS), DepthError::Direction(_)));
}
