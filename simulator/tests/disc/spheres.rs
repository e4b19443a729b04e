//! Spheres under the disc.

use super::kit::*;
use glam::DVec2;
use glam::DVec3;
use std::f64::consts::PI;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Lighting, Scene, SunOptions, View};
use sunglint_simulator::mesh::shapes::plate;
use sunglint_simulator::surface::{Distribution, Material};
use sunglint_simulator::target::{Shape, Target};

fn sphere(material: Material) -> Target {
    let mut target = Target::default();
    add(&mut target, material, Shape::Sphere { radius_m: 1.0 }, DVec3::ZERO);
    target
}

fn of(scene: &Scene, phase_deg: f64) -> (f64, f64) {
    at(scene, &lighting(DVec3::Z, tilted(phase_deg.to_radians())), 550.0)
}

/// Truth: a mirror sphere sends R²/4 of the irradiance everywhere, whatever the Sun's size: 1e-4 (1e-5 is met: what the edge of
/// the disc shines more on a sphere than on a plane), to 180°.
#[test]
fn a_mirror_sphere_is_the_same_from_everywhere() {
    let scene = Scene::with_sun(&sphere(mirror()), SunOptions::default()).unwrap();
    for phase_deg in [0.0, 30.0, 90.0, 150.0, 179.0, 179.9, 180.0] {
        let (w, error) = of(&scene, phase_deg);
        assert!((4.0 * w - 1.0).abs() < 1.5e-5, "{phase_deg}: {w}");
        assert!(error < 1e-4 * w);
    }
}

/// Truth: the Lambert sphere's closed form (Russell 1916), averaged over the disc by rings of our own. 1e-4 to 179.9°; at 180° what goes
/// round the edge, to 1 %.
#[test]
fn a_lambert_sphere_near_opposition_to_the_sun() {
    let options = SunOptions { eclipse: true, ..SunOptions::default() };
    let scene = Scene::with_sun(&sphere(white()), options).unwrap();
    for (phase_deg, limit) in
        [(0.0, 1e-5), (90.0, 1e-5), (170.0, 1e-4), (178.0, 1e-4), (179.5, 1e-4), (179.9, 2e-4)]
    {
        let to = tilted(f64::to_radians(phase_deg));
        let truth = average(DVec3::Z, 550.0, 400, |d| {
            let left = PI - 2.0 * (d - to).length().atan2((d + to).length());
            let small = left.powi(3) / 3.0 - left.powi(5) / 30.0 + left.powi(7) / 840.0;
            2.0 / (3.0 * PI) * if left < 0.05 { small } else { left.sin() - left * left.cos() }
        });
        let (ours, error) = of(&scene, phase_deg);
        assert!((ours / truth - 1.0).abs() < limit, "{phase_deg}: {ours} {truth}");
        assert!(
            (ours - truth).abs() <= error + 2e-5 * truth,
            "{phase_deg}: {ours} {truth} {error}"
        );
    }
}

/// Truth: the limit ρR²/4 for α → 0, and that nature makes no jumps: along α (steps of 0.2 %: 1e-4) and along the
/// phase to 179° the second differences stay small, for both distributions.
#[test]
fn rough_spheres_make_a_smooth_curve() {
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for phase_deg in [0.0, 60.0, 120.0, 170.0, 178.0, 179.0] {
            let at = |alpha: f64| {
                let scene =
                    Scene::with_sun(&sphere(rough(distribution, alpha)), SunOptions::default());
                of(&scene.unwrap(), phase_deg).0
            };
            let finest = at(1e-5);
            assert!((4.0 * finest - 1.0).abs() < 2e-3, "{distribution:?} {phase_deg}: {finest}");
            let mut alpha = 1e-5;
            while alpha < 0.9 {
                let [a, b, c] = [alpha, 1.002 * alpha, 1.004 * alpha].map(at);
                assert!(
                    (a - 2.0 * b + c).abs() < 1e-4 * b,
                    "{distribution:?} {phase_deg} {alpha}: {a} {b} {c}"
                );
                alpha *= 1.9;
            }
        }
        for alpha in [1e-5, 1e-3, 0.01, 0.1, 1.0] {
            let scene = Scene::with_sun(&sphere(rough(distribution, alpha)), SunOptions::default())
                .unwrap();
            for phase_deg in (1..179).step_by(16).map(f64::from).chain([175.0, 178.5, 178.98]) {
                let [a, b, c] = [0.0, 0.002, 0.004].map(|more| of(&scene, phase_deg + more).0);
                assert!((a - 2.0 * b + c).abs() < 5e-5 * b, "{distribution:?} {alpha} {phase_deg}");
            }
        }
    }
}

/// f cosθ_i cosθ_o of white paint (`None`) or of a GGX lobe (Walter et al. 2007, masking separable) by formulas of our own.
fn sent(alpha: Option<f64>, n: DVec3, sun: DVec3, to: DVec3) -> f64 {
    let (cos_i, cos_o) = (n.dot(sun), n.dot(to));
    let Some(alpha) = alpha else { return cos_i * cos_o / PI };
    let square = alpha * alpha;
    let z = n.dot((sun + to).normalize());
    let d = square / (PI * (z * z * (square - 1.0) + 1.0).powi(2));
    let g = |c: f64| 2.0 / (1.0 + (1.0 + square * (1.0 - c * c) / (c * c)).sqrt());
    0.25 * d * g(cos_i) * g(cos_o)
}

/// A sphere of 1 m from a point, under light from one direction, by a sum over its surface; `open` says whether light passes along a ray from a point.
fn near_sphere(
    alpha: Option<f64>,
    (sun, q): (DVec3, DVec3),
    n: u32,
    open: &dyn Fn(DVec3, DVec3) -> bool,
) -> f64 {
    // The axis stands on the plane of Sun and observer.
    let axis = sun.cross(q).normalize();
    let (u, v) = (sun, axis.cross(sun));
    let mut sum = 0.0;
    for k in 0..n {
        let z = (f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0;
        let r = (1.0 - z * z).sqrt();
        for j in 0..2 * n {
            let (s, c) = ((f64::from(j) + 0.5) * PI / f64::from(n)).sin_cos();
            let at = z * axis + r * (c * u + s * v);
            let away = q - at;
            if at.dot(sun) > 0.0 && at.dot(away) > 0.0 && open(at, sun) && open(at, away) {
                let nearness = q.length_squared() / away.length_squared();
                sum += nearness * sent(alpha, at, sun, away.normalize());
            }
        }
    }
    sum * 2.0 * PI / f64::from(n * n)
}

/// ⟨value⟩ over 8 × 8 places of the disc, of which the weights are made 1.
fn few(sun: DVec3, value: impl Fn(DVec3) -> f64) -> f64 {
    average(sun, 550.0, 8, value) / average(sun, 550.0, 8, |_| 1.0)
}

fn near(sun: DVec3, q: DVec3) -> Lighting {
    Lighting { view: View::At(q), ..lighting(sun, q.normalize()) }
}

fn painted(alpha: Option<f64>) -> Material {
    alpha.map_or_else(white, |alpha| rough(Distribution::Ggx, alpha))
}

/// Truth: the sum over the sphere's surface (300 × 600 places) and over rings of the disc (8 × 8 places). Tolerance: 3e-4 of the value, for the sums. Alone, and beside a small dark box that hides nothing.
/// For a distant observer the values are up to a factor of 2 away.
#[test]
fn a_sphere_from_near_by_under_the_disc() {
    let free = |_: DVec3, _: DVec3| true;
    let black = Material::lambert("black", Spectrum::constant(1e-6, 300.0, 1240.0).unwrap());
    let black = black.unwrap();
    let sun = DVec3::X;
    for (alpha, phase_deg) in [(None, 45.0), (None, 100.0), (Some(0.05), 45.0)] {
        let mut beside = sphere(painted(alpha));
        let small = Shape::Mesh(plate(DVec2::splat(0.1), true, false));
        add(&mut beside, black.clone(), small, DVec3::new(0.0, 0.0, -3.0));
        for range_m in [1.5, 10.0, 100.0] {
            let (sin, cos) = f64::to_radians(phase_deg).sin_cos();
            let q = range_m * DVec3::new(cos, sin, 0.0);
            let truth = few(sun, |d| near_sphere(alpha, (d, q), 300, &free));
            let alone = weigh(&sphere(painted(alpha)), &near(sun, q), 550.0);
            let two = weigh(&beside, &near(sun, q), 550.0);
            for (ours, error) in [alone, two] {
                assert!(
                    (ours / truth - 1.0).abs() < 3e-4,
                    "{alpha:?} {phase_deg} {range_m}: {ours} {truth}"
                );
                assert!(error < 1e-3 * ours, "{alpha:?} {range_m}: {ours} {error}");
            }
        }
    }
}

/// ∫ f cosθ_i cosθ_o (d/s)² dA over what is lit and seen of a sphere of 1 m from a distance d, by midpoints between exact ends, where the integrand vanishes with its slope: 1e-8 of Lambert light.
fn seen_and_lit(alpha: Option<f64>, phase: f64, away: f64) -> f64 {
    const N: usize = 400;
    let step = PI / N as f64;
    let place = |k: usize| (-0.5 * PI + (k as f64 + 0.5) * step).sin_cos();
    let q = away * DVec3::new(phase.cos(), phase.sin(), 0.0);
    let most = away.recip().acos();
    let mut sum = 0.0;
    for j in 0..N {
        let (s, c) = place(j);
        let (latitude, height) = (most * s, most * c * step);
        let seen = (1.0 / (away * latitude.cos())).min(1.0).acos();
        let (from, to) = ((phase - seen).max(-0.5 * PI), (phase + seen).min(0.5 * PI));
        for k in (0..N).filter(|_| to > from) {
            let (s, c) = place(k);
            let (longitude, width) =
                (0.5 * (from + to + (to - from) * s), 0.5 * (to - from) * c * step);
            let (sin, cos) = longitude.sin_cos();
            let n = DVec3::new(latitude.cos() * cos, latitude.cos() * sin, latitude.sin());
            let to_q = q - n;
            let nearness = (away / to_q.length()).powi(2);
            let light = sent(alpha, n, DVec3::X, to_q.normalize());
            sum += light * nearness * latitude.cos() * width * height;
        }
    }
    sum
}

/// W of a sphere of white or of a rough metal under a Sun of no width, and its claimed error, where facets near by may be off by so much.
fn to_a_tolerance(alpha: Option<f64>, q: DVec3, tolerance: f64) -> (f64, f64) {
    let scene = Scene::with_sun(&sphere(painted(alpha)), SunOptions::default()).unwrap();
    let (mut weights, mut errors) = (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
    let mut evaluator = scene.evaluator();
    evaluator.set_near_tolerance(tolerance);
    let lighting = Lighting { sun_radius_rad: 1e-6, ..near(DVec3::X, q) };
    evaluator.light(&lighting, &mut weights, &mut errors).unwrap();
    let terms = scene.terms().unwrap();
    let sum = |row: &[f64]| -> f64 {
        row.iter().zip(&terms).map(|(w, t)| w * t.spectrum.at(550.0).abs()).sum()
    };
    (sum(&weights), sum(&errors))
}

/// Truth: the integral above, of Lambert light and lobes, with a tolerance so wide that a sphere 100 radii away is taken as far away, where its distance changes 0.2 to 6 % of its light (beyond 165° it is integrated). Tolerance: the stated error, and 1e-6 for the integral.
#[test]
fn the_error_of_a_far_sphere_holds_the_change_by_its_distance() {
    let away = 100.0;
    for alpha in [None, Some(0.05), Some(0.1), Some(0.3)] {
        for phase_deg in [0.0_f64, 20.0, 60.0, 90.0, 120.0, 150.0, 170.0, 178.0] {
            let phase = phase_deg.to_radians();
            let q = away * DVec3::new(phase.cos(), phase.sin(), 0.0);
            let truth = seen_and_lit(alpha, phase, away);
            let (ours, error) = to_a_tolerance(alpha, q, 1e-2);
            let off = (ours - truth).abs();
            eprintln!(
                "{alpha:?} {phase_deg}: {:.1e} off, {:.1e} stated",
                off / truth,
                error / truth
            );
            assert!(off <= error + 1e-6 * truth, "{alpha:?} {phase_deg}: {ours} {truth} {error}");
        }
    }
}

/// Truth: the integral above, under a Sun of no width. Tolerance: the stated error and 1e-6, whether the sphere is integrated from its distance or taken as far away; at 3·10⁶ radii, where it is, the
/// stated error is below 1e-4 up to 170°. (Measured: 7e-6 off at 170° there, 8e-6 stated.)
#[test]
fn a_sphere_from_far_away_is_within_its_error() {
    let mut worst = 0.0_f64;
    for phase_deg in [0.0_f64, 45.0, 90.0, 135.0, 170.0, 178.0] {
        for away in [1e2, 1e4, 3e5, 3e6] {
            let phase = phase_deg.to_radians();
            let q = away * DVec3::new(phase.cos(), phase.sin(), 0.0);
            let truth = seen_and_lit(None, phase, away);
            // As for a tolerance of 0.1 %.
            let (ours, error) = to_a_tolerance(None, q, 1e-6);
            let off = (ours / truth - 1.0).abs();
            eprintln!("{phase_deg} {away:e}: {off:.1e} off, {:.1e} stated", error / ours);
            assert!(off <= error / truth + 1e-6, "{phase_deg} {away}: {ours} {truth} {error}");
            if away > 1e6 && phase_deg <= 170.0 {
                assert!(error < 1e-4 * ours, "{phase_deg}: {ours} {error}");
                worst = worst.max(error / ours);
            }
        }
    }
    // So that this means something: the sphere was taken as far away.
    assert!(worst > 1e-6, "{worst}");
}

/// Truth: the same sum, with a plate in the Sun's way to a part of the sphere. Tolerance: the stated error and 2e-3 of the value, for the shadow's edge between the places of the sum.
#[test]
fn a_shaded_sphere_from_near_by_under_the_disc() {
    let black = Material::lambert("black", Spectrum::constant(1e-6, 300.0, 1240.0).unwrap());
    let middle = DVec3::new(0.3, 0.0, 2.0);
    let half = DVec2::new(0.25, 0.4);
    let open = |at: DVec3, along: DVec3| {
        let t = (middle.z - at.z) / along.z;
        let p = at + t * along - middle;
        t <= 0.0 || p.x.abs() > half.x || p.y.abs() > half.y
    };
    for range_m in [4.0, 10.0] {
        let q = range_m * tilted(1.0);
        let mut target = sphere(white());
        let shape = Shape::Mesh(plate(2.0 * half, true, true));
        add(&mut target, black.clone().unwrap(), shape, middle);
        let truth = few(DVec3::Z, |d| near_sphere(None, (d, q), 300, &open));
        let whole = near_sphere(None, (DVec3::Z, q), 300, &|_, _| true);
        assert!(truth < 0.95 * whole, "{truth} {whole}");
        let (ours, error) = weigh(&target, &near(DVec3::Z, q), 550.0);
        assert!((ours - truth).abs() < error + 2e-3 * truth, "{range_m}: {ours} {truth} {error}");
        assert!(error < 0.02 * ours, "{range_m}: {ours} {error}");
    }
}

/// Truth: the image of a ball that mirrors spreads by its curvature in both planes, R cosθ/2 along the plane of Sun and observer and R/(2 cosθ) across (Coddington); the limit for α → 0, to 1 %
/// (α is 0.003, the disc has 0.005).
#[test]
fn a_glossy_sphere_from_near_by_nears_the_mirror() {
    let phase = 45.0_f64.to_radians();
    for range_m in [1.5, 10.0] {
        let (mut low, mut high) = (0.0, phase);
        for _ in 0..60 {
            let t: f64 = 0.5 * (low + high);
            let out = (range_m * (phase - t).sin()).atan2(range_m * (phase - t).cos() - 1.0);
            if out > t { low = t } else { high = t }
        }
        let at = DVec3::new(low.cos(), low.sin(), 0.0);
        let q = range_m * DVec3::new(phase.cos(), phase.sin(), 0.0);
        let (s, c) = ((q - at).length(), low.cos());
        let truth = range_m * range_m / ((1.0 + 2.0 * s / c) * (1.0 + 2.0 * s * c));
        let glossy = sphere(rough(Distribution::Beckmann, 0.003));
        let (ours, error) = weigh(&glossy, &near(DVec3::X, q), 550.0);
        assert!((ours / truth - 1.0).abs() < 1e-2, "{range_m}: {ours} {truth} {error}");
    }
}
