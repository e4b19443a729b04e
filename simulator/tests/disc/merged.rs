//! The disc over what is curved, and over what is sampled: against averages written out here.

use super::kit::{SUN, add, lighting, rough, white};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;
use sunglint_ephemeris::orbit::eclipse::Discs;
use sunglint_simulator::light::disc::eclipse::{fractions, globe};
use sunglint_simulator::light::{Lighting, Scene, SceneOptions, SunOptions, View};
use sunglint_simulator::mesh::shapes::{Faceting, icosphere, plate};
use sunglint_simulator::surface::{Distribution, Material};
use sunglint_simulator::target::{Curved, Shape, Target};

fn cylinder(material: Material) -> Target {
    let mut target = Target::default();
    let shape = Curved::Frustum { bottom_radius_m: 0.5, top_radius_m: 0.5, height_m: 2.0 };
    add(&mut target, material, Shape::Curved(shape), DVec3::ZERO);
    target
}

/// W under a Sun of no extent in this direction, from the engine without a disc, whose cylinders have their truths elsewhere.
fn collimated(target: &Target, sun: DVec3, to: DVec3) -> f64 {
    let scene = Scene::new(target).unwrap();
    let mut out = vec![0.0; scene.weight_count()];
    scene.evaluator().direct(sun, View::Distant(to), &mut out).unwrap();
    out.iter().sum()
}

/// The grey disc's average of that, by rings and spokes, with the law of the exponent ½ (its first profile).
fn averaged(target: &Target, sun: DVec3, to: DVec3) -> f64 {
    let (u, v) = sun.any_orthonormal_pair();
    let (rings, spokes) = (24, 48);
    let (mut sum, mut all) = (0.0, 0.0);
    for r in 0..rings {
        // Even in area.
        let rho = ((f64::from(r) + 0.5) / f64::from(rings)).sqrt();
        let brightness = (1.0 - rho * rho).powf(0.25);
        for s in 0..spokes {
            let (sin, cos) = (TAU * (f64::from(s) + 0.5) / f64::from(spokes)).sin_cos();
            let place = sun + SUN * rho * (cos * u + sin * v);
            sum += brightness * collimated(target, place.normalize(), to);
            all += brightness;
        }
    }
    sum / all
}

/// Truth: the average over 1,152 places of the disc, of which each is a collimated Sun. 1e-4 of paint and of a lobe ten times as wide as the disc; 2 % of one
/// as wide as four of it, where the claim covers what is left.
#[test]
fn a_cylinder_under_the_disc() {
    let (sun, to) = (DVec3::new(0.8, 0.1, 0.5).normalize(), DVec3::new(0.7, 0.5, -0.4).normalize());
    for (material, tolerance) in [
        (white(), 1e-4),
        (rough(Distribution::Beckmann, 0.05), 1e-3),
        (rough(Distribution::Ggx, 0.02), 2e-2),
    ] {
        let target = cylinder(material);
        let scene = Scene::with_sun(&target, SunOptions::default()).unwrap();
        let (mut weights, mut errors) =
            (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
        scene.evaluator().light(&lighting(sun, to), &mut weights, &mut errors).unwrap();
        // The grey profile comes first; of the others L is 0 where the exponent is ½.
        let count = scene.weight_count();
        let found: f64 = weights[..count].iter().sum();
        let error: f64 = errors.iter().sum();
        let truth = averaged(&target, sun, to);
        let apart = (found - truth).abs();
        assert!(apart <= tolerance * truth, "{found} {truth} ± {error}");
        assert!(apart <= error + 1e-5 * truth, "{found} {truth} ± {error}");
    }
}

/// Bodies with many facets that hide one another: rows of balls of flat triangles over a plate.
fn crowd() -> Target {
    let mut target = Target::default();
    add(&mut target, white(), Shape::Mesh(plate(DVec2::splat(4.0), true, true)), DVec3::ZERO);
    for k in 0..4 {
        let at = DVec3::new(f64::from(k) - 1.5, 0.3 * f64::from(k) - 0.5, 0.8);
        let ball = icosphere(0.45, 4, Faceting::SameArea);
        add(&mut target, white(), Shape::Mesh(ball), at);
    }
    target
}

/// Truth: the exact engine under the same disc, facet by facet: what is sampled agrees within both claims, in full light and where the Earth hides a part. In full light
/// it is the collimated exact sum, to the same.
#[test]
fn a_sampled_body_under_the_disc() {
    let target = crowd();
    let sun = SunOptions { eclipse: true, ..SunOptions::default() };
    let options = |tolerance| SceneOptions { tolerance, sun: Some(sun), ..SceneOptions::default() };
    let sampled = Scene::with_options(&target, options(3e-2)).unwrap();
    let exact = Scene::with_options(&target, options(0.0)).unwrap();
    assert!(sampled.report().sampling.is_some(), "{:?}", sampled.report().why_exact);
    let (to_sun, to) =
        (DVec3::new(0.5, 0.2, 0.8).normalize(), DVec3::new(-0.3, 0.4, 0.9).normalize());
    let discs =
        |depth: f64| Discs { sun_rad: SUN, earth_rad: 1.1, separation_rad: 1.1 + depth * SUN };
    for depth in [None, Some(0.5), Some(-0.4)] {
        let shadow =
            depth.map(|d| globe(&discs(d), to_sun, DVec3::new(0.9, 0.1, -0.3).normalize(), 7e6));
        let lighting = Lighting { shadow, ..lighting(to_sun, to) };
        let of = |scene: &Scene| {
            let (mut weights, mut errors) =
                (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
            scene.evaluator().light(&lighting, &mut weights, &mut errors).unwrap();
            let count = scene.weight_count();
            (weights[..count].iter().sum::<f64>(), errors.iter().sum::<f64>())
        };
        let ((found, error), (truth, own)) = (of(&sampled), of(&exact));
        assert!(
            (found - truth).abs() <= error + own,
            "{depth:?}: {found} ± {error}, {truth} ± {own}"
        );
        assert!(error < 0.05 * found, "{depth:?}: {error} of {found}");
        // Not the sum without a shadow: the shadow leaves the fraction of the grey disc, to what the direction of its light changes.
        let left = depth.map_or(1.0, |d| fractions(&discs(d))[0]);
        let full = collimated(&target, to_sun, to);
        assert!((found / (left * full) - 1.0).abs() < 0.03, "{depth:?}: {found} {left} {full}");
    }
}
