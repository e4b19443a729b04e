//! The engine: what it finds a scene to need, and whether the error that it states holds.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod glints;
mod scenes;
mod sums;
mod tracer;

use glam::DVec3;
use scenes::scene;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::engine::{Switch, Switches};
use sunglint_simulator::light::{
    Course, Engine, Globe, Lighting, Need, Options, Source, Stated, View,
};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Shape, Target};
use tracer::Tracer;

/// A way on which neither the Earth nor the distance counts.
fn far_away() -> Course {
    Course {
        epochs: 1,
        geometries: 1,
        range_m: 1e12,
        earthshine: 0.0,
        phase_rad: 0.0,
        ..Course::default()
    }
}

fn engine(target: &Target, tolerance: f64, switches: Switches) -> Engine {
    Engine::new(target, &Options { tolerance, switches, ..Options::default() }, &far_away())
        .unwrap()
}

fn need(target: &Target, tolerance: f64, effect: &str) -> Need {
    let engine = engine(target, tolerance, Switches::default());
    engine.needs().iter().find(|n| n.effect == effect).unwrap().clone()
}

/// A built-in target, all of it of another material.
fn painted(name: &str, material: Material) -> Target {
    let mut target = Target::built_in(name).unwrap();
    target.parts.iter_mut().for_each(|p| p.material = 0);
    target.materials = vec![material];
    target
}

fn grey(reflectance: f64) -> Spectrum<sunglint_radiometry::spectrum::Reflectance> {
    Spectrum::constant(reflectance, 300.0, 1240.0).unwrap()
}

fn beckmann(alpha: f64) -> Material {
    let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
    Material::microfacet("rough", lobe, Fresnel::constant(grey(0.5)).unwrap())
}

/// Truth: what the bodies are. A box with wings hides parts of itself, a sphere does not.
#[test]
fn convex_bodies_need_no_shadows() {
    for (name, hides) in [
        ("box_wing", true),
        ("corner", true),
        ("box_with_panels", true),
        ("mirror_sphere", false),
        ("lambert_sphere", false),
    ] {
        let target = Target::built_in(name).unwrap();
        let hiding = need(&target, 1e-3, "hiding and shadows");
        assert_eq!((hiding.needed, hiding.is_modelled()), (hides, hides), "{name}: {hiding:?}");
        assert_eq!(hiding.why.contains("convex closed body"), !hides, "{name}: {}", hiding.why);
        let bounce = need(&target, 1e-3, "inter-reflection");
        assert_eq!((bounce.needed, bounce.is_modelled()), (hides, hides), "{name}: {bounce:?}");
        assert_eq!(bounce.bound == Some(0.0), !hides, "{name}: {bounce:?}");
    }
}

/// Truth: (δ²/8)(6.9 − 1)/α² where a Beckmann lobe has fallen to e^−6.9, by hand with δ = 4.731e-3: 0.13 at α = 0.0113, 4.6e-5 at α = 0.6, so that of
/// the rough one only the horizon is left, 2δ/3π = 1.004e-3 (physics of a disc half below the horizon). Tolerance: 15 % for the higher orders that are
/// said on top, 1 % for the horizon.
#[test]
fn narrow_lobes_need_the_disc_and_rough_ones_do_not() {
    let near = |found: f64, truth: f64, tolerance: f64| {
        assert!((found / truth - 1.0).abs() < tolerance, "{found} is not {truth}");
    };
    let disc = |material, tolerance| need(&painted("box_wing", material), tolerance, "solar disc");
    let narrow = disc(beckmann(0.0113), 2e-3);
    near(narrow.bound.unwrap(), 0.1293, 0.15);
    assert!(narrow.needed);
    for tolerance in [2e-3, 5e-4] {
        let rough = disc(beckmann(0.6), tolerance);
        near(rough.bound.unwrap(), 1.004e-3, 0.01);
        assert_eq!(rough.needed, tolerance < 1e-3, "{rough:?}");
    }
    // A diffuse sphere has no horizon that a facet's whole area meets: δ²/4 of the cosine.
    let sphere = need(&Target::built_in("lambert_sphere").unwrap(), 1e-3, "solar disc");
    near(sphere.bound.unwrap(), 4.731e-3_f64.powi(2) / 4.0, 0.01);
    assert!(!sphere.needed);
}

/// Three unit squares that look at one another.
fn corner() -> Mesh {
    let points = [
        [0., 0., 0.],
        [1., 0., 0.],
        [1., 1., 0.],
        [0., 1., 0.],
        [0., 0., 1.],
        [1., 0., 1.],
        [0., 1., 1.],
    ];
    let quads = [[0, 1, 2, 3], [0, 4, 5, 1], [0, 3, 6, 4]];
    let halves = |q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]];
    Mesh {
        vertices: points.map(DVec3::from).to_vec(),
        triangles: quads.iter().flat_map(halves).collect(),
        ..Mesh::default()
    }
}

/// Truth: of the direction midway between Sun and observer, the part across the plane of both moves by 1/(2 cos γ/2) of what the Sun moves (by hand: h =
/// (i + o)/|i + o|): at a phase angle of 120° the error is four times that at 0°.
#[test]
fn light_from_behind_widens_the_disc() {
    let target = painted("box_wing", beckmann(0.1));
    let bound = |phase_rad: f64| {
        let course = Course { phase_rad, ..far_away() };
        let engine = Engine::new(&target, &Options::default(), &course).unwrap();
        engine.needs().iter().find(|n| n.effect == "solar disc").unwrap().bound.unwrap()
    };
    // (δ²/8) 5.9/α² = 1.65e-3, of which the next order is said on top.
    let (ahead, behind) = (bound(0.0), bound(2.0 * std::f64::consts::FRAC_PI_3));
    assert!((behind / (4.0 * ahead) - 1.0).abs() < 0.01, "{behind} {ahead}");
}

/// Truth: three unit squares in a corner send 0.40009 of diffuse light to one another (Hottel), at most ρF/(1 − ρF) of the first light; by hand for ρ
/// = 0.001; that of white walls is modelled. Tolerance: 8 %: the fraction is a mean over twelve points a face.
#[test]
fn a_dark_body_needs_no_second_bounce() {
    let bounce = |reflectance: f64| {
        let mut target = painted("corner", Material::lambert("grey", grey(reflectance)).unwrap());
        target.parts.truncate(1);
        target.parts[0].shape = Shape::Mesh(corner());
        need(&target, 1e-3, "inter-reflection")
    };
    let (white, dark) = (bounce(0.9), bounce(0.001));
    assert!(white.is_modelled() && !dark.needed, "{white:?} {dark:?}");
    let (found, rho) = (dark.bound.unwrap(), 0.001);
    let truth = rho * 0.40009 / (1.0 - rho * 0.40009);
    assert!((found / truth - 1.0).abs() < 0.08, "{found} {truth}");
}

/// A switch and the tolerance decide; what is left out is the sum of the bounds.
#[test]
fn tolerance_and_switches_decide_and_bounds_add_up() {
    let target = Target::built_in("box_wing").unwrap();
    let needed = |tolerance, switches| {
        let engine = engine(&target, tolerance, switches);
        let find = |e: &str| engine.needs().iter().find(|n| n.effect == e).unwrap().needed;
        let sum: f64 =
            engine.needs().iter().filter(|n| !n.is_modelled()).filter_map(|n| n.bound).sum();
        assert_eq!(engine.left_out(), sum);
        (find("solar disc"), find("moonshine"))
    };
    let auto = Switches::default();
    assert_eq!(needed(1e-2, auto), (false, false));
    assert_eq!(needed(1e-5, auto), (true, false));
    assert_eq!(needed(1e-6, auto), (true, true));
    let switches = Switches { solar_disc: Switch::Off, moonshine: Switch::On, ..auto };
    assert_eq!(needed(1e-5, switches), (false, true));
}

/// A body far from everything, under the Sun's disc.
fn lighting(sun_body: DVec3, to: DVec3, sun_radius_rad: f64) -> Lighting {
    let earth = Globe {
        toward: -to,
        distance_m: 1e15,
        radius_m: 6.4e6,
        sun: sun_body,
        to_ground: glam::DQuat::IDENTITY,
    };
    let view = View::Distant(to);
    Lighting {
        sun_body,
        sun_radius_rad,
        earth: Some(earth),
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view,
    }
}

/// A random scene's light by the engine and by paths: the light, the stated error, the paths' light and their standard error.
fn compared(seed: u64, paths: usize) -> [f64; 4] {
    found(&scene(seed), Switches::default(), paths, 7000 + seed)
}

fn found(random: &scenes::RandomScene, switches: Switches, paths: usize, seed: u64) -> [f64; 4] {
    let (View::Distant(to) | View::At(to)) = random.view;
    let course = Course {
        phase_rad: random.sun.angle_between(to),
        range_m: if let View::At(q) = random.view { q.length() } else { 1e12 },
        earthshine: random.earth.map_or(0.0, |_| Course::default().earthshine),
        ..far_away()
    };
    let options = Options { switches, ..Options::default() };
    let engine = Engine::new(&random.target, &options, &course).unwrap();
    let mut weights = vec![0.0; engine.terms().len()];
    let mut errors = weights.clone();
    let none = lighting(random.sun, to, random.sun_radius_rad);
    let earth = random.earth.or(none.earth);
    let lighting = Lighting { view: random.view, earth, ..none };
    engine.worker().light(&lighting, &mut weights, &mut errors).unwrap();
    let (mut light, mut stated) = (0.0, Stated::default());
    for (term, (weight, error)) in engine.terms().iter().zip(weights.iter().zip(&errors)) {
        let tau = term.spectrum.at(550.0);
        light += tau * weight;
        stated.add(term.way(), tau.abs() * error);
    }
    let (truth, sigma) = Tracer::new(random).intensity(paths, seed);
    [light, stated.total(), truth, sigma]
}

/// Truth: the path tracer. A white sphere in front of a white plate and as large as it: facets alone see nothing of each other, but sphere and plate do. What is stated covers the
/// difference (three standard errors of the paths), and the light of more than one scattering is a good part of all.
#[test]
fn a_sphere_and_a_plate_send_light_to_each_other() {
    let text = r#"
[[part]]
name = "sphere"
shape = "sphere"
radius_m = 0.4
offset_m = [0, 0, 0.5]
material = "white"
[[part]]
name = "plate"
shape = "box"
size_m = [1, 1, 0.02]
material = "white"
[[material]]
name = "white"
model = "lambert"
reflectance = 0.9
"#;
    let target = Target::parse("sphere.toml", text).unwrap();
    let need = need(&target, 1e-3, "inter-reflection");
    assert!(need.is_modelled(), "{need:?}");
    let sun = DVec3::new(0.5, 0.2, 0.8).normalize();
    let view = View::Distant(DVec3::new(0.8, -0.1, 0.5).normalize());
    let paints = vec![scenes::Paint { reflectance: 0.9, lobe: None }; 2];
    let random =
        scenes::RandomScene { target, paints, sun, view, earth: None, sun_radius_rad: 4.65e-3 };
    let [light, stated, truth, sigma] = found(&random, Switches::default(), 60_000, 5);
    assert!((light - truth).abs() <= stated + 3.0 * sigma, "{light} {truth} {stated} {sigma}");
    assert!(stated + 3.0 * sigma < 0.03 * truth, "{stated} {sigma} {truth}");
}

/// Truth: the path tracer. A corner of three white walls looks at the Earth, the Sun stands behind it: all its light is the Earth's, and a good part of it (ρF and more, with
/// F = 0.40 by Hottel) has met two walls or more. What is stated covers the difference (three standard errors of the paths) and is below 10 % where bounces are
/// modelled (4,096 paths a panel of the cap, for which nothing but the Earth's light asks); where they are switched off it covers what is missing.
#[test]
fn earthshine_bounces_in_a_corner() {
    let mut target = painted("corner", Material::lambert("white", grey(0.9)).unwrap());
    target.parts.truncate(1);
    target.parts[0].shape = Shape::Mesh(corner());
    let sun = DVec3::new(-0.9, -0.3, -0.4).normalize();
    let (toward, to) = (DVec3::ONE.normalize(), DVec3::new(0.6, 0.8, 0.5).normalize());
    let earth = Globe {
        toward,
        distance_m: 6.9e6,
        radius_m: 6.371e6,
        sun,
        to_ground: glam::DQuat::IDENTITY,
    };
    let paints = vec![scenes::Paint { reflectance: 0.9, lobe: None }];
    let (view, earth, sun_radius_rad) = (View::Distant(to), Some(earth), 4.65e-3);
    let random = scenes::RandomScene { target, paints, sun, view, earth, sun_radius_rad };
    let [light, stated, truth, sigma] = found(&random, Switches::default(), 60_000, 5);
    assert!((light - truth).abs() <= stated + 3.0 * sigma, "{light} {truth} {stated} {sigma}");
    assert!(stated < 0.1 * truth && sigma < 0.01 * truth, "{stated} {sigma} {truth}");
    let off = Switches { inter_reflection: Switch::Off, ..Switches::default() };
    let [light, stated, truth, sigma] = found(&random, off, 60_000, 6);
    assert!((light - truth).abs() <= stated + 3.0 * sigma, "{light} {truth} {stated} {sigma}");
    assert!(truth - light > 0.2 * truth, "{light} {truth}");
}

/// Truth: what the scene is. What bounces of the Earth's light is said: modelled beside the bounces of sunlight, left out with its bound where these are, nothing where no surface sees
/// another or there is no Earth to speak of.
#[test]
fn what_bounces_of_earthshine_is_said() {
    let need = |name: &str, earthshine: f64, switches: Switches| {
        let course = Course { earthshine, ..far_away() };
        let options = Options { switches, ..Options::default() };
        let engine = Engine::new(&Target::built_in(name).unwrap(), &options, &course).unwrap();
        let find = |e: &str| engine.needs().iter().find(|n| n.effect == e).unwrap().clone();
        (find("bounced earthshine"), find("inter-reflection"))
    };
    let (low, _) = need("corner", 0.3, Switches::default());
    assert!(low.is_modelled() && low.why.contains("patches"), "{low:?}");
    let (far, _) = need("corner", 1e-6, Switches::default());
    assert!(!far.needed && far.bound.unwrap() > 0.0, "{far:?}");
    let off = Switches { inter_reflection: Switch::Off, ..Switches::default() };
    let (off, of_sunlight) = need("corner", 0.3, off);
    assert!(!off.needed && off.why.contains("switched off"), "{off:?}");
    assert!((off.bound.unwrap() - 0.3 * of_sunlight.bound.unwrap()).abs() < 1e-15, "{off:?}");
    let (convex, _) = need("lambert_sphere", 0.3, Switches::default());
    assert!(!convex.needed && convex.bound == Some(0.0), "{convex:?}");
}

/// The error that a result states covers the true error, for random bodies, attitudes, paints, lights and observers: boxes, spheres, hinged panels, Lambert, Beckmann and GGX, the
/// Sun's disc, the Earth below, near observers, all orders of scattering ([`scenes::scene`]).
///
/// Truth: the path tracer of `tracer.rs`, with its own intersections and its own BRDFs: the Sun's limb-darkened disc, the Earth's cap, nine bounces. What is stated must cover the
/// difference in 95 % of the scenes, within two standard errors of the paths: as many misses as there are must not be less likely than 1 % if each scene misses with 5 %.
#[test]
fn campaign_stated_error() {
    let mut campaign = sunglint_testkit::Campaign::start("stated_error", 200);
    let (mut missed, mut lit, mut worst) = (0, 0, 0.0_f64);
    for seed in campaign.seeds() {
        let [light, stated, truth, sigma] = compared(seed, 40_000);
        let off = (light - truth).abs();
        lit += usize::from(truth > 0.0);
        if off > stated + 2.0 * sigma {
            missed += 1;
            let beyond = (off - stated) / sigma;
            eprintln!(
                "seed {seed}: {light:.5e} against {truth:.5e} ± {:.1e}, stated {:.1e}: off {:.1e}, {beyond:.1} standard errors beyond",
                sigma / truth,
                stated / truth,
                off / truth
            );
        }
        worst = worst.max((off - stated) / sigma.max(1e-12));
    }
    let n = campaign.seeds().count();
    eprintln!(
        "{missed} of {n} missed, {lit} lit, worst {worst:.2} standard errors beyond what is stated"
    );
    let p = sunglint_testkit::chance_of_misses(n as u64, missed, 0.05);
    assert!(p > 0.01, "{missed} of {n} missed, p = {p:.1e}");
    assert!(2 * lit > n);
    campaign.largest("largest_standard_errors_beyond", worst);
    campaign.finish();
}

/// Truth: what stands in the way of the Sun does not stand in the way of the Earth. In the umbra the Sun's own terms are 0 and the Earth's as in full light; behind half
/// of the disc the Sun's terms are half (paint square to it, grey), and what is unsure of the half is in the errors.
#[test]
fn a_shadow_takes_the_suns_light_alone() {
    let target = painted("box_wing", Material::lambert("white", grey(0.8)).unwrap());
    let switches =
        Switches { inter_reflection: Switch::Off, earthshine: Switch::On, ..Switches::default() };
    let engine = engine(&target, 1e-3, switches);
    let (sun, to) = (DVec3::new(0.8, 0.0, 0.6), DVec3::new(0.6, 0.2, -0.7).normalize());
    let earth = Globe {
        toward: DVec3::NEG_Z,
        distance_m: 6.9e6,
        radius_m: 6.378e6,
        sun,
        to_ground: glam::DQuat::IDENTITY,
    };
    let lit = Lighting { earth: Some(earth), ..lighting(sun, to, 4.65e-3) };
    let of = |sunlit: f64, sunlit_error: f64| {
        let (mut weights, mut errors) =
            (vec![0.0; engine.terms().len()], vec![0.0; engine.terms().len()]);
        let lighting = Lighting { sunlit, sunlit_error, ..lit };
        engine.worker().light(&lighting, &mut weights, &mut errors).unwrap();
        let sum = |row: &[f64], source: Source| -> f64 {
            let terms = engine.terms().iter().zip(row);
            terms.filter(|(t, _)| t.source == source).map(|(_, w)| w.abs()).sum()
        };
        let own = |source| (sum(&weights, source), sum(&errors, source));
        (own(Source::Direct), own(Source::Earthshine))
    };
    let ((full, exact), (earthlit, _)) = of(1.0, 0.0);
    assert!(full > 0.1 && earthlit > 1e-3 && exact < 1e-3 * full, "{full} {earthlit} {exact}");
    let ((dark, none), (still, _)) = of(0.0, 0.0);
    assert_eq!((dark, none, still), (0.0, 0.0, earthlit));
    let ((half, unsure), _) = of(0.5, 0.1);
    assert!((half / full - 0.5).abs() < 1e-12 && (unsure / full - 0.1).abs() < 1e-3);
    let ((dark, glow), _) = of(0.0, 0.02);
    assert!(dark == 0.0 && (glow / full - 0.02).abs() < 1e-3, "{glow} {full}");
}
