//! Photons that were scattered more than once, against a path tracer of this file: its own intersections, BRDFs and lengths.

use super::{RECEIVER, counts, graz, meets};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_simulator::light::bounce::{Bounce, BounceOptions};
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::light::{Effect as _, Faceted, Lighting, Scene, View};
use sunglint_simulator::ranging::{
    Beam, BeamShape, Bounces, BouncesError, DepthBins, Profile, Shot, Stand,
};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Shape, Target};

const BINS: DepthBins = DepthBins { from_m: -3.5, step_m: 0.1, count: 90 };
const OPTIONS: BounceOptions =
    BounceOptions { tolerance: 2e-3, seed: 3, most_paths: 1 << 17, analyser: None };

/// ρ, and the roughness of a Beckmann lobe.
type Paint = (f64, Option<f64>);

fn painted(name: &str, paint: Paint) -> Target {
    let spectrum = || Spectrum::<Reflectance>::constant(paint.0, 300.0, 1240.0).unwrap();
    let mut target = Target::built_in(name).unwrap();
    target.parts.iter_mut().for_each(|p| p.material = 0);
    target.materials = vec![match paint.1 {
        None => Material::lambert("m", spectrum()).unwrap(),
        Some(alpha) => {
            let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
            Material::microfacet("m", lobe, Fresnel::constant(spectrum()).unwrap())
        }
    }];
    target
}

/// Walter et al. 2007, eqs. 20, 25, 27 (exact Smith masking), no Fresnel but ρ.
fn brdf((rho, alpha): Paint, i: DVec3, o: DVec3, n: DVec3) -> f64 {
    let (ci, co) = (i.dot(n), o.dot(n));
    if ci <= 0.0 || co <= 0.0 {
        return 0.0;
    }
    let Some(alpha) = alpha else { return rho * FRAC_1_PI };
    let ch = (i + o).normalize().dot(n);
    let d = (-(1.0 / (ch * ch) - 1.0) / (alpha * alpha)).exp() / (PI * alpha * alpha * ch.powi(4));
    let masking = |c: f64| {
        let a = 1.0 / (alpha * (1.0 / (c * c) - 1.0).max(1e-300).sqrt());
        2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
    };
    rho * d * masking(ci) * masking(co) / (4.0 * ci * co)
}

/// Paths from the telescope: in each bin the light of two scatterings and more, m² sr⁻¹ times what the beam has at their first point, and the sum of its squares;
/// the last pair is the whole.
fn traced(target: &Target, paint: Paint, shot: &Shot, paths: u32) -> Vec<(f64, f64)> {
    let mut triangles = Vec::new();
    for part in &target.parts {
        let Shape::Mesh(mesh) = &part.shape else { unreachable!("flat faces alone") };
        let point = |k: u32| part.placement.point(mesh.vertices[k as usize]);
        triangles.extend(mesh.triangles.iter().map(|t| t.map(point)));
    }
    let first = |from: DVec3, along: DVec3| {
        let hits = triangles.iter().filter_map(|t| Some((meets(from, along, *t)?, t)));
        hits.filter(|h| h.0 > 1e-9).min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let normal = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a).normalize();
    let reach = triangles.iter().flatten().map(|v| v.length()).fold(0.0, f64::max);
    let (laser, telescope) = (shot.laser.toward, shot.telescope.toward);
    let (x, y) = telescope.any_orthonormal_pair();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    let mut sums = vec![(0.0, 0.0); BINS.count + 1];
    let window = 4.0 * reach * reach / f64::from(paths);
    for _ in 0..paths {
        let mut across = || reach * (2.0 * random.random::<f64>() - 1.0);
        let origin = across() * x + across() * y + 10.0 * telescope;
        let Some((t, mut on)) = first(origin, -telescope) else { continue };
        let (mut at, mut to) = (origin - t * telescope, telescope);
        let (mut way, mut light, mut whole) = (-at.dot(telescope), window, 0.0);
        for order in 1..40 {
            let n = normal(on);
            if n.dot(to) <= 0.0 {
                break;
            }
            let cos = n.dot(laser);
            if order > 1 && cos > 0.0 && first(at, laser).is_none() {
                let off = (at - shot.off_axis_m).reject_from(laser).length();
                let beam = shot.beam.fluence_j_m2(shot.laser.range_m, off);
                let value = light * brdf(paint, laser, to, n) * cos * beam;
                let depth = 0.5 * (way - at.dot(laser));
                let bin = ((depth - BINS.from_m) / BINS.step_m).floor() as usize;
                sums[bin].0 += value;
                sums[bin].1 += value * value;
                whole += value;
            }
            // By the cosine: the estimator is π f.
            let (u, v) = n.any_orthonormal_pair();
            let (square, (sin, cos)) =
                (random.random::<f64>(), (TAU * random.random::<f64>()).sin_cos());
            let along =
                (square.sqrt() * (cos * u + sin * v) + (1.0 - square).sqrt() * n).normalize();
            let Some((t, next)) = first(at, along) else { break };
            light *= PI * brdf(paint, along, to, n);
            way += t;
            (at, on, to) = (at + t * along, next, -along);
        }
        sums[BINS.count].0 += whole;
        sums[BINS.count].1 += whole * whole;
    }
    sums
}

fn found(target: &Target, shot: &Shot, rho: &[f64]) -> Profile {
    let body = Faceted::new(target).unwrap();
    let mut profile = shot.profile(&mut body.eye(), rho, BINS).unwrap();
    let alone = profile.clone();
    let bounces = Bounces::new(target, 1064.0, Switch::Auto, &OPTIONS).unwrap();
    assert!(bounces.need().needed, "{:?}", bounces.need());
    shot.add_bounces(&mut bounces.eye(), &mut profile).unwrap();
    let bounced = profile.bounced.as_ref().unwrap();
    assert!((profile.total - alone.total - bounced.total).abs() < 1e-12 * alone.total);
    for k in 0..BINS.count {
        let sum = alone.photons[k] + bounced.photons[k];
        assert!((profile.photons[k] - sum).abs() <= 1e-12 * alone.total, "bin {k}");
    }
    profile
}

fn stands(a: DVec3, b: DVec3) -> (Stand, Stand) {
    let stand = |d: DVec3| Stand { toward: d.normalize(), range_m: 1e6 };
    (stand(a), stand(b))
}

/// Truth: the path tracer above, 400,000 paths; wide and narrow beams, laser and telescope in one place and 40° apart, diffuse and shining. Tolerance: each bin to 6 standard errors of
/// both together (ours know their own by eight scrambles alone); the whole to the claimed error and three of the tracer's; the claim is the tolerance of all light at most (of lobes ten times that).
#[test]
fn photons_between_surfaces_come_at_half_of_their_way() {
    let (d, apart) = (DVec3::new(0.7, -0.2, 0.6), DVec3::new(0.7, 0.55, 0.6));
    let narrow = Beam { divergence_rad: 1.2e-6, shape: BeamShape::Gaussian, ..graz() };
    let cases: [(&str, Paint, DVec3, Beam); 5] = [
        ("corner", (0.8, None), d, graz()),
        ("corner", (0.8, None), apart, narrow),
        ("corner", (0.9, Some(0.5)), d, graz()),
        ("corner", (0.9, Some(0.4)), apart, graz()),
        ("box_wing_diffuse", (0.9, None), DVec3::new(0.45, 0.75, 0.4), graz()),
    ];
    for (name, paint, toward, beam) in cases {
        let target = painted(name, paint);
        let (laser, telescope) = stands(toward, if name == "corner" { d } else { toward });
        let off_axis_m = DVec3::new(0.1, 0.0, 0.1);
        let sun_body = DVec3::X;
        let shot =
            Shot { beam: &beam, receiver: &RECEIVER, laser, telescope, off_axis_m, sun_body };
        let profile = found(&target, &shot, &[paint.0]);
        let bounced = profile.bounced.as_ref().unwrap();
        let truth = traced(&target, paint, &shot, 400_000);
        let photons =
            |(sum, square): (f64, f64)| (counts(1.0, sum, 1e6), counts(1.0, square.sqrt(), 1e6));
        for (k, both) in truth[..BINS.count].iter().enumerate() {
            let (expected, sigma) = photons(*both);
            let off = (bounced.photons[k] - expected).abs();
            let floor = 2e-5 * profile.total;
            assert!(
                off <= 6.0 * sigma.hypot(bounced.sigma[k]) + floor,
                "{name} {paint:?} bin {k}: {} ± {}, {expected} ± {sigma}",
                bounced.photons[k],
                bounced.sigma[k]
            );
        }
        let (expected, sigma) = photons(truth[BINS.count]);
        let share = expected / profile.total;
        assert!((bounced.total - expected).abs() <= bounced.error + 3.0 * sigma, "{name}");
        // Lobes that see each other want more paths than are allowed: then the claim says so.
        let most = if paint.1.is_some() { 10.0 } else { 1.0 };
        assert!(bounced.error <= most * OPTIONS.tolerance * profile.total, "{name}");
        assert!(share > 0.01 && bounced.outside.abs() < 1e-3 * bounced.total, "{name}: {share}");
    }
}

/// Truth: conservation: under an even beam the photons of all bins are those of sunlight from the laser's direction, all orders, by patches and form factors (held against another renderer
/// elsewhere). Tolerance: the errors of both. The corner's own depth: light by floor and wall of a pair at right angles cannot be later than their edge is deep, up to the box.
#[test]
fn the_photons_of_all_orders_are_what_form_factors_give() {
    let target = painted("corner", (0.8, None));
    let toward = DVec3::new(0.6, 0.1, 0.75).normalize();
    let beam = Beam { divergence_rad: 1e-2, ..graz() };
    let (laser, telescope) = stands(toward, toward);
    let (off_axis_m, sun_body) = (DVec3::ZERO, toward);
    let shot = Shot { beam: &beam, receiver: &RECEIVER, laser, telescope, off_axis_m, sun_body };
    let profile = found(&target, &shot, &[0.8]);
    let bounced = profile.bounced.as_ref().unwrap();
    let scene = Scene::new(&target).unwrap();
    let bounce = Bounce::new(&scene, &OPTIONS).unwrap();
    let count = bounce.terms().len();
    let (mut weights, mut errors) = (vec![0.0; count], vec![0.0; count]);
    let lighting = Lighting {
        sun_body: toward,
        sun_radius_rad: 0.0,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(toward),
    };
    bounce.light().add(&lighting, &mut weights, &mut errors).unwrap();
    let at = |row: &[f64]| -> f64 {
        bounce.terms().iter().zip(row).map(|(t, w)| t.spectrum.at(1064.0) * w).sum()
    };
    let fluence = beam.fluence_j_m2(1e6, 0.0);
    let (expected, error) = (counts(fluence, at(&weights), 1e6), counts(fluence, at(&errors), 1e6));
    assert!(
        (bounced.total - expected).abs() <= bounced.error + error,
        "{} {expected}",
        bounced.total
    );
    assert!(bounced.error + error < 0.05 * expected);
    // Through the air: all of it alike.
    let thin = profile.clone().through(0.5, 0.5);
    let less = thin.bounced.unwrap();
    assert!((less.total / bounced.total - 0.25).abs() < 1e-15);
    assert!((less.error / bounced.error - 0.25).abs() < 1e-15);
}

/// Truth: by reasoning: a convex body, and one whose surfaces turn away from each other, sends nothing to itself: nothing is traced. Tables that end before the laser's wavelength are refused by name.
#[test]
fn convex_bodies_need_no_paths() {
    for name in ["lambert_sphere", "mirror_sphere"] {
        let bounces =
            Bounces::new(&Target::built_in(name).unwrap(), 532.0, Switch::Auto, &OPTIONS).unwrap();
        assert_eq!((bounces.need().needed, bounces.need().bound), (false, Some(0.0)), "{name}");
    }
    let target = Target::built_in("box_wing").unwrap();
    let error = Bounces::new(&target, 2100.0, Switch::Auto, &OPTIONS).unwrap_err();
    assert!(matches!(error, BouncesError::Wavelength { .. }) && error.to_string().contains("2100"));
    let error =
        Bounces::new(&target, 532.0, Switch::Auto, &BounceOptions { tolerance: 0.0, ..OPTIONS });
    let off = Bounces::new(&target, 532.0, Switch::Off, &OPTIONS).unwrap();
    assert!(!off.need().needed && off.need().why.contains("switched off"), "{:?}", off.need());
    assert!(matches!(error.unwrap_err(), BouncesError::Tolerance(_)));
}
