//! Where there is no derivative, where there is no formula, and what is refused.

use super::bodies::*;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, PI};
use sunglint_simulator::light::{
    DerivativeError, Method, Parameter, Roughness, Scene, SceneOptions, View,
};
use sunglint_simulator::target::Target;

/// Truth: numbers. Edge-on facets, Sun behind the observer, edges along the light, the Sun on a hinge's axis: no NaN, no infinity.
#[test]
fn kinks_are_finite() {
    let mut suns = AXES.to_vec();
    suns.extend(AXES.map(|a| -a));
    suns.extend([DVec3::new(1.0, 1.0, 0.0), DVec3::ONE, DVec3::new(1.0, 1e-15, 0.0)]);
    suns.extend([DVec3::new(1.0, 0.0, 1e-9), DVec3::new(0.0, 1.0, -1e-12)]);
    let mut targets: Vec<Target> = ["box_wing", "corner", "hexagon", "lambert_sphere"]
        .map(|n| Target::built_in(n).unwrap())
        .to_vec();
    targets.extend([winged(None), winged(Some((-0.1, 0.1)))]);
    for target in targets {
        let scene = Scene::new(&target).unwrap();
        for sun in &suns {
            for to in &suns {
                let (w, dw, errors, _) = derive(&scene, *sun, View::Distant(*to), &all());
                let mut all = w.iter().chain(&dw).chain(&errors);
                assert!(all.all(|v| v.is_finite()), "{}: {sun} {to}: {dw:?}", target.name);
            }
        }
    }
}

/// Truth: W = A/π cosθ_i cosθ_o of a plate has dW/dθ_i = −A/π cosθ_o where the Sun has just risen, and 0 where it has not. Rounding.
#[test]
fn one_sided_at_the_horizon() {
    let mut target = Target::default();
    add(&mut target, sheet(DVec2::ONE), at(DVec3::ZERO), white());
    let scene = Scene::new(&target).unwrap();
    for (z, truth) in [(1e-9, FRAC_1_PI), (-1e-9, 0.0)] {
        let sun = DVec3::new(1.0, 0.0, z);
        let up = [Parameter::Sun(DVec3::Z)];
        let (_, dw, ..) = derive(&scene, sun, View::Distant(DVec3::Z), &up);
        assert!((dw[0] - truth).abs() < 1e-12, "{} for {truth}", dw[0]);
    }
}

/// Truth: two sheets side by side throw the shadow of one: the seam between them, where two edges coincide, counts for nothing; and one
/// behind another with the same edge in the Sun counts once. The closed form of a plate half shaded by an edge. 1e-12.
#[test]
fn coincident_edges_count_once() {
    let (height, edge) = (1.0, 0.1);
    let lower = || {
        let mut target = Target::default();
        add(&mut target, sheet(DVec2::ONE), at(DVec3::ZERO), white());
        target
    };
    let cover = |target: &mut Target, x: f64, y: f64, z: f64, size: DVec2| {
        add(target, sheet(size), at(DVec3::new(x, y, z)), white());
    };
    // Both halves of the cover meet at y = 0; or a second cover farther up, whose edge lies in the same plane with the Sun.
    let a: f64 = 0.2;
    let mut seam = lower();
    cover(&mut seam, edge - 4.0, 2.0, height, DVec2::new(8.0, 4.0));
    cover(&mut seam, edge - 4.0, -2.0, height, DVec2::new(8.0, 4.0));
    let mut twice = lower();
    cover(&mut twice, edge - 4.0, 0.0, height, DVec2::new(8.0, 8.0));
    cover(&mut twice, edge - 4.0, 0.1, height, DVec2::new(8.0, 8.0));
    for target in [seam, twice] {
        let scene = Scene::new(&target).unwrap();
        let sun = DVec3::new(a.sin(), 0.0, a.cos());
        let to = DVec3::new(0.5, 0.1, 0.8).normalize();
        let along = Parameter::Sun(DVec3::new(a.cos(), 0.0, -a.sin()));
        let (_, dw, ..) = derive(&scene, sun, View::Distant(to), &[along]);
        let lit = 0.5 - edge + height * a.tan();
        let truth = (height / a.cos() - lit * a.sin()) * to.z * FRAC_1_PI;
        assert!((dw[0] - truth).abs() < 1e-12, "{} for {truth}", dw[0]);
    }
}

/// Truth: a cylinder of radius R and height H seen from its side at phase angle γ in the plane across its axis sends
/// R H/π · ½ (sin γ + (π − γ) cos γ), its derivative −½ R H/π (π − γ) sin γ. Differences, within the error that they state and 1e-6.
#[test]
fn cylinder_by_differences() {
    let text = "[[part]]\nname = \"it\"\nshape = \"cylinder\"\nradius_m = 0.5\nheight_m = 2\nmaterial = \"unit\"\n";
    let scene = Scene::new(&Target::parse("cylinder.toml", text.to_owned()).unwrap()).unwrap();
    for phase in [0.4, 1.2, 2.2] {
        let to = DVec3::new(f64::cos(phase), f64::sin(phase), 0.0);
        let along = DVec3::new(-to.y, to.x, 0.0);
        let parameters = [Parameter::Observer(along), Parameter::Attitude(DVec3::Z)];
        let (_, dw, errors, done) = derive(&scene, DVec3::X, View::Distant(to), &parameters);
        assert_eq!(done.method, Method::Differences);
        let truth = -0.5 * FRAC_1_PI * (PI - phase) * phase.sin();
        for ((found, truth), error) in dw.iter().zip([truth, 0.0]).zip(&errors) {
            assert!((found - truth).abs() < 1e-6, "{found} for {truth}");
            assert!((found - truth).abs() <= error + 1e-12, "{found} for {truth} ± {error}");
        }
    }
}

/// Truth: the scene prepared without a tolerance. A scene that would be sampled is summed exactly here: the same bits.
#[test]
fn tolerances_do_not_matter() {
    let target = Target::built_in("box_wing").unwrap();
    let exact = Scene::new(&target).unwrap();
    let options = SceneOptions { tolerance: 1e-2, ..SceneOptions::default() };
    let rough = Scene::with_options(&target, options).unwrap();
    let (sun, to) = directions(&mut rng(3));
    let both = [exact, rough].map(|s| derive(&s, sun, View::Distant(to), &all()));
    assert_eq!((&both[0].0, &both[0].1), (&both[1].0, &both[1].1));
}

/// Truth: what the text of each error promises.
#[test]
fn refusals() {
    let target = Target::built_in("box_wing").unwrap();
    let scene = Scene::new(&target).unwrap();
    let mut eye = scene.evaluator();
    let count = scene.weight_count();
    let white = scene.materials().iter().position(|m| m.name == "white").unwrap();
    let mut ask = |sun: DVec3, parameter: Parameter, room: usize| {
        let (mut w, mut dw) = (vec![0.0; count], vec![0.0; room]);
        eye.direct_derivatives(sun, View::Distant(DVec3::X), &[parameter], &mut w, &mut dw)
    };
    let nan = Parameter::Attitude(DVec3::new(0.0, f64::NAN, 0.0));
    assert!(matches!(ask(DVec3::X, nan, count), Err(DerivativeError::NotFinite { .. })));
    let turn = Parameter::Attitude(DVec3::X);
    assert!(matches!(ask(DVec3::X, turn, count + 1), Err(DerivativeError::Room { .. })));
    assert!(matches!(ask(DVec3::ZERO, turn, count), Err(DerivativeError::Direction(_))));
    let rough = |material| Parameter::Roughness { material, of: Roughness::Alpha };
    assert!(matches!(ask(DVec3::X, rough(99), count), Err(DerivativeError::Missing { .. })));
    let none = ask(DVec3::X, rough(white), count).unwrap_err();
    assert!(none.to_string().contains("microfacets"), "{none}");
    assert!(ask(DVec3::X, turn, count).is_ok());
}
