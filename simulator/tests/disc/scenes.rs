//! Shadows under the disc, terms, points near by, things that are tiny.

use super::kit::*;
use glam::{DVec2, DVec3};
use sunglint_simulator::light::{Lighting, Scene, SunOptions, View};
use sunglint_simulator::mesh::shapes::plate;
use sunglint_simulator::surface::{Distribution, Material};
use sunglint_simulator::target::{Shape, Target};

/// Truth: the area that a plate's edge at some height leaves of another below, direction by direction (a rectangle's width), averaged over
/// the disc by rings of our own. The stated error covers the true one at all places of the edge, also where only a part of the
/// penumbra reaches the plate; away from its borders 1e-4 of the plate is kept.
#[test]
fn penumbras() {
    let (mut worst, mut inner, mut share) = (0.0_f64, 0.0_f64, 0.0_f64);
    for height in [1.0, 10.0] {
        for k in -30..=30 {
            let edge = 0.1 * SUN * height * f64::from(k);
            for (border, shadow) in [(true, edge - 0.5), (true, edge + 0.5), (false, edge)] {
                let edge = shadow + height * 0.2_f64.tan();
                let mut target = facet(white());
                let sheet = Shape::Mesh(plate(DVec2::splat(40.0), true, true));
                add(&mut target, white(), sheet, DVec3::new(edge - 20.0, 0.0, height));
                let sun = tilted(0.2);
                // So low that the sheet hides nothing of the lower plate, and shows nothing of itself but its edge's shadow.
                let scene = Scene::with_sun(&target, SunOptions::default()).unwrap();
                let (mut w, mut e) = (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
                let to = DVec3::new(0.99, 0.0, 0.14).normalize();
                let light = lighting(sun, to);
                scene.evaluator().light(&light, &mut w, &mut e).unwrap();
                let width = |at: f64| (0.5 - at).clamp(0.0, 1.0);
                let grey = 292.0 / 0.523;
                let truth = average(sun, grey, 400, |d| width(edge - height * d.x / d.z) * d.z);
                let truth = truth * to.z / std::f64::consts::PI;
                let scale = to.z / std::f64::consts::PI;
                let off = (w[0] - truth).abs() / scale;
                worst = worst.max(off);
                if !border {
                    inner = inner.max(off);
                }
                share = share.max(off / (e[0] / scale + 1e-5));
                assert!(
                    off <= e[0] / scale + 1e-5,
                    "{height} {edge}: {off:.1e} {:.1e}",
                    e[0] / scale
                );
            }
        }
    }
    eprintln!("penumbras: {worst:.1e} at borders, {inner:.1e} within, {share:.2} of the claim");
    assert!(inner < 1e-4);
}

/// Truth: the collimated engine. Without a disc the terms are the materials' spectra; with one they come first.
#[test]
fn terms_come_in_the_order_of_weights() {
    let target = Target::built_in("box_wing").unwrap();
    let plain = Scene::new(&target).unwrap();
    let terms = plain.terms().unwrap();
    assert_eq!(terms.len(), plain.weight_count());
    for (term, rho) in terms.iter().zip(plain.spectra()) {
        assert_eq!(term.spectrum.value(), rho.value());
    }
    let options = SunOptions { eclipse: true, ..SunOptions::default() };
    let scene = Scene::with_sun(&target, options).unwrap();
    let all = scene.terms().unwrap();
    assert_eq!((all.len(), scene.term_count()), (5 * terms.len(), 5 * terms.len()));
    for material in 0..target.materials.len() {
        for profile in 0..5 {
            for k in scene.terms_of(material, profile).unwrap() {
                assert_eq!(all[k].material, Some(material));
            }
        }
    }
    let (sun, to) =
        (DVec3::new(0.7, 0.6, 0.25).normalize(), DVec3::new(0.6, -0.1, 0.3).normalize());
    let mut out = vec![0.0; plain.weight_count()];
    plain.evaluator().direct(sun, View::Distant(to), &mut out).unwrap();
    let collimated = Lighting { sun_radius_rad: 0.0, ..lighting(sun, to) };
    let (mut w, mut e) = (vec![0.0; plain.weight_count()], vec![0.0; plain.weight_count()]);
    plain.evaluator().light(&collimated, &mut w, &mut e).unwrap();
    assert_eq!(w, out);
    // Paints feel the disc by less than 1e-3, and what is stated covers no less than rounding.
    let (total, plain): (f64, f64) =
        (at(&scene, &lighting(sun, to), 550.0).0, target_sum(&terms, &out));
    assert!((total / plain - 1.0).abs() < 1e-3, "{total} {plain}");
}

fn target_sum(terms: &[sunglint_simulator::light::Term], weights: &[f64]) -> f64 {
    terms.iter().zip(weights).map(|(t, w)| t.spectrum.at(550.0) * w).sum()
}

/// Truth: the distant observer. From 1000 km a plate and a sphere look as from infinity: 2e-6 (paint), 1e-4 in a glint that
/// changes over the plate.
#[test]
fn a_point_far_away_is_a_direction() {
    let sun = tilted(0.5);
    let to = tilted(-0.5 + 0.3 * SUN);
    for (material, limit) in
        [(white(), 2e-6), (rough(Distribution::Ggx, 0.003), 1e-4), (mirror(), 1e-4)]
    {
        let target = facet(material);
        let near = Lighting { view: View::At(1e6 * to), ..lighting(sun, to) };
        let (a, b) = (weigh(&target, &near, 550.0).0, weigh(&target, &lighting(sun, to), 550.0).0);
        assert!((a / b - 1.0).abs() < limit, "{}: {a} {b}", target.materials[0].name);
    }
}

/// Truth: geometry knows no unit. A plate of a nanometre sends (1e-9)² of what one of a metre does, 1e-12; and nothing is ever no number:
/// edge-on, from behind, at 180° of phase, in the Sun's direction.
#[test]
fn tiny_things_and_odd_directions() {
    for material in
        [mirror(), rough(Distribution::Ggx, 1e-3), rough(Distribution::Beckmann, 1e-5), white()]
    {
        let large = facet(material.clone());
        let mut tiny = Target::default();
        add(&mut tiny, material, Shape::Mesh(plate(DVec2::splat(1e-9), true, false)), DVec3::ZERO);
        let directions =
            [0.0, 0.3, -0.3, 1.5, std::f64::consts::FRAC_PI_2, 1.6, 3.0, -1.5].map(tilted);
        for sun in directions {
            for to in directions.into_iter().chain([-sun, sun]) {
                let light = lighting(sun, to);
                let (a, b) = (weigh(&large, &light, 550.0), weigh(&tiny, &light, 550.0));
                assert!(a.0.is_finite() && a.1.is_finite() && a.0 >= -a.1, "{a:?}");
                assert!((1e18 * b.0 - a.0).abs() <= 1e-9 * a.0.abs(), "{sun} {to}: {a:?} {b:?}");
            }
        }
    }
}

/// Truth: none is needed; a scene made without a disc refuses a flat mirror, one with a disc takes it.
#[test]
fn flat_mirrors_need_the_disc() {
    let target = facet(mirror());
    assert!(Scene::new(&target).unwrap_err().to_string().contains("flat mirror"));
    assert!(Scene::with_sun(&target, SunOptions::default()).is_ok());
    let _: Material = white();
}
