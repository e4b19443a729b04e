//! Polarisation by one reflection, against closed forms and another renderer.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::DVec3;
use sunglint_formats::ecsv;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::engine::{Switch, Switches};
use sunglint_simulator::light::{Analyser, Course, Engine, Lighting, Options, Scene, View};
use sunglint_simulator::pass::{Overrides, PassFile};
use sunglint_simulator::surface::{
    ComplexIndex, Distribution, Fresnel, Lobe, Masking, Material, PolarisedPart,
};
use sunglint_simulator::target::Target;

const NM: f64 = 550.0;

fn lobe(alpha: f64) -> Lobe {
    Lobe::isotropic(Distribution::Ggx, alpha, Masking::HeightCorrelated).unwrap()
}

fn metal(n: f64, k: f64) -> Fresnel {
    let index = ComplexIndex::new("metal", vec![300.0, 1200.0], vec![n; 2], vec![k; 2]).unwrap();
    Fresnel::conductor(&index).unwrap()
}

fn glass(n: f64) -> Fresnel {
    Fresnel::dielectric(n, 300.0, 1200.0).unwrap()
}

/// Light of a target at one wavelength, W/sr for an irradiance of 1 per nm, direct and from afar.
fn light(target: &Target, sun: DVec3, observer: DVec3) -> f64 {
    let scene = Scene::new(target).unwrap();
    let mut weights = vec![0.0; scene.weight_count()];
    scene.evaluator().direct(sun, View::Distant(observer), &mut weights).unwrap();
    let mut at = 0;
    let mut sum = 0.0;
    for material in &target.materials {
        let own = &weights[at..at + material.spectra().len()];
        sum += material.times_spectra(NM, own);
        at += own.len();
    }
    sum
}

fn black(material: &Material) -> Material {
    Material::black(&material.name).unwrap()
}

/// Degree of linear polarisation of a target's direct light.
fn degree(target: &Target, sun: DVec3, observer: DVec3) -> f64 {
    let mut polarised = target.clone();
    for material in &mut polarised.materials {
        *material = match material.polarised().unwrap() {
            PolarisedPart::Of(part) => *part,
            _ => black(material),
        };
    }
    light(&polarised, sun, observer) / light(target, sun, observer)
}

fn sphere(material: Material) -> Target {
    let mut target = Target::parse(
        "sphere.toml",
        "[[part]]\nname = \"sphere\"\nshape = \"sphere\"\nradius_m = 1.0\nmaterial = \"m\"\n\
         [[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.5\n",
    )
    .unwrap();
    target.materials[0] = material;
    target
}

fn at_phase(deg: f64) -> (DVec3, DVec3) {
    let (sin, cos) = deg.to_radians().sin_cos();
    (DVec3::X, DVec3::new(cos, sin, 0.0))
}

/// R_s and R_p by Fresnel's equations with complex amplitudes (Born and Wolf §1.5 and §14.2), here in another form than the program's: by Snell's complex angle.
fn reflectances(n: f64, k: f64, theta: f64) -> [f64; 2] {
    type C = (f64, f64);
    let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let div = |a: C, b: C| {
        let m = b.0 * b.0 + b.1 * b.1;
        ((a.0 * b.0 + a.1 * b.1) / m, (a.1 * b.0 - a.0 * b.1) / m)
    };
    let root = |a: C| {
        let (r, phi) = (a.0.hypot(a.1).sqrt(), 0.5 * a.1.atan2(a.0));
        (r * phi.cos(), r * phi.sin())
    };
    let index = (n, k);
    let sin_t = div((theta.sin(), 0.0), index);
    let sin2 = mul(sin_t, sin_t);
    let cos_t = root((1.0 - sin2.0, -sin2.1));
    let cos_i = (theta.cos(), 0.0);
    let power = |a: C, b: C| {
        let r = div((a.0 - b.0, a.1 - b.1), (a.0 + b.0, a.1 + b.1));
        r.0 * r.0 + r.1 * r.1
    };
    [power(cos_i, mul(index, cos_t)), power(mul(index, cos_i), cos_t)]
}

/// Truth: Mitsuba 3.9.1 (`llvm_ad_mono_polarized`, a sphere in GGX and Beckmann of α 0.1, 0.3 and 0.6, whose values are equal in all digits) for aluminium; the closed form (R_s − R_p)/(R_s + R_p) at half the phase
/// angle for n = 1.5 and a metal like titanium. All are given to 5 digits. A sphere has all directions of facets, so it is the hardest of the convex bodies.
#[test]
fn a_sphere_is_polarised_as_its_facets_are() {
    let phases = [10.0, 30.0, 60.0, 90.0, 120.0, 150.0];
    let known: [(Fresnel, [f64; 6]); 3] = [
        (metal(0.958, 6.69), [0.00032, 0.00290, 0.01199, 0.02888, 0.05860, 0.11479]),
        (glass(1.5), [0.01018, 0.09367, 0.39192, 0.83148, 0.97980, 0.57810]),
        (metal(2.9, 3.1), [0.00245, 0.02227, 0.09175, 0.21793, 0.41903, 0.65512]),
    ];
    for (fresnel, degrees) in known {
        for alpha in [0.1, 0.3, 0.6] {
            let target = sphere(Material::microfacet("m", lobe(alpha), fresnel.clone()));
            for (phase, known) in phases.into_iter().zip(degrees) {
                let (sun, observer) = at_phase(phase);
                let found = degree(&target, sun, observer);
                assert!((found - known).abs() < 8e-6, "{alpha} {phase}: {found} {known}");
            }
        }
    }
}

/// Truth: the closed form, for a body that shades itself: one bare material on all parts of the box-wing. Also a mirror. Tolerance 1e-5: the reflectances are interpolated between angles to 1e-6.
#[test]
fn one_material_has_one_polarisation_whatever_the_body() {
    for (n, k) in [(0.958, 6.69), (2.9, 3.1), (1.5, 0.0)] {
        let fresnel = if k == 0.0 { glass(n) } else { metal(n, k) };
        let mut target = Target::built_in("box_wing").unwrap();
        for material in &mut target.materials {
            *material = Material::microfacet(&material.name, lobe(0.25), fresnel.clone());
        }
        for (sun, observer) in directions() {
            let theta = 0.5 * sun.angle_between(observer);
            let [s, p] = reflectances(n, k, theta);
            let found = degree(&target, sun, observer);
            let expected = (s - p) / (s + p);
            assert!((found - expected).abs() < 1e-5 * (1.0 + 1.0 / (s + p)), "{found} {expected}");
        }
    }
}

fn directions() -> Vec<(DVec3, DVec3)> {
    [
        ([0.3, -0.5, 0.8], [0.1, 0.9, 0.3]),
        ([0.9, 0.2, 0.3], [0.5, -0.1, 0.8]),
        ([0.2, 0.7, 0.6], [-0.4, 0.6, 0.5]),
        ([-0.5, 0.1, 0.8], [0.8, 0.3, 0.2]),
        ([0.6, 0.6, -0.2], [0.6, -0.4, 0.5]),
    ]
    .map(|(a, b)| (DVec3::from(a).normalize(), DVec3::from(b).normalize()))
    .to_vec()
}

/// Truth: by hand. A Lambert part dilutes by its share of the light; a coat over paint is polarised as the coat alone; what has no index is not known; a mirror's light is
/// polarised wholly at Brewster's angle.
#[test]
fn diffuse_light_dilutes_and_unknown_is_said() {
    let grey = || Spectrum::constant(0.4, 300.0, 1200.0).unwrap();
    let coat = Material::microfacet("coat", lobe(0.2), glass(1.5));
    let paint = Material::blend("paint", grey(), lobe(0.2), glass(1.5)).unwrap();
    let (sun, observer) = at_phase(80.0);
    let whole = light(&sphere(paint.clone()), sun, observer);
    let gloss = light(&sphere(coat.clone()), sun, observer);
    let alone = degree(&sphere(coat), sun, observer);
    let found = degree(&sphere(paint), sun, observer);
    assert!((found - alone * gloss / whole).abs() < 1e-9, "{found}");
    assert!(found > 0.01 && found < 0.5 * alone, "{found} {alone}");
    let lambert = Material::lambert("l", grey()).unwrap();
    assert!(matches!(lambert.polarised().unwrap(), PolarisedPart::Nothing));
    let flat = Material::microfacet("f", lobe(0.2), Fresnel::constant(grey()).unwrap());
    assert!(matches!(flat.polarised().unwrap(), PolarisedPart::Unknown));
    let mirror = sphere(Material::mirror("g", glass(1.5)));
    let (sun, observer) = at_phase(2.0 * 1.5_f64.atan().to_degrees());
    assert!((degree(&mirror, sun, observer) - 1.0).abs() < 1e-9);
}

/// Truth: Mitsuba 3.9.1's Stokes vectors of a cube, a grey wing and an aluminium shield that shade one another (`simulator/scenes/polarisation.ecsv`, by `benches/polarisation_truths.py`, whose
/// directions of polarisation are perpendicular to the plane of Sun and observer to 1e-4 degrees, without circular light). Tolerances: 1e-3 and 1 % of the degree, as asked for, and four times the noise.
#[test]
fn another_renderer_agrees_on_a_body_that_shades_itself() {
    let text = include_str!("../scenes/polarisation.ecsv");
    let table = ecsv::read_str("polarisation.ecsv", text).unwrap();
    let column = |name: &str| table.f64(name).unwrap();
    let vector = |name: &str, row: usize| {
        DVec3::from(["x", "y", "z"].map(|axis| column(&format!("{name}_{axis}"))[row])).normalize()
    };
    let mut target = Target::parse(
        "three.toml",
        "[[part]]\nname = \"body\"\nshape = \"box\"\nsize_m = [1, 1, 1]\nmaterial = \"titanium\"\n\
         [[part]]\nname = \"wing\"\nshape = \"plate\"\nsize_m = [3, 1]\noffset_m = [2.2, 0, 0]\nmaterial = \"grey\"\n\
         [[part]]\nname = \"shield\"\nshape = \"plate\"\nsize_m = [1.5, 1.5]\noffset_m = [0, 0, 1]\nmaterial = \"aluminium\"\n\
         [[material]]\nname = \"titanium\"\nmodel = \"lambert\"\nreflectance = 0.3\n\
         [[material]]\nname = \"grey\"\nmodel = \"lambert\"\nreflectance = 0.3\n\
         [[material]]\nname = \"aluminium\"\nmodel = \"lambert\"\nreflectance = 0.3\n",
    )
    .unwrap();
    let lobe = |alpha| Lobe::isotropic(Distribution::Ggx, alpha, Masking::Separable).unwrap();
    target.materials[0] = Material::microfacet("titanium", lobe(0.25), metal(2.9, 3.1));
    target.materials[2] = Material::microfacet("aluminium", lobe(0.35), metal(0.958, 6.69));
    for row in 0..table.rows() {
        let found = degree(&target, vector("sun", row), vector("observer", row));
        let (known, noise) = (column("degree")[row], column("degree_sigma")[row]);
        println!("{found:.6} {known:.6} ± {noise:.6}");
        let off = (found - known).abs();
        assert!(off < 1e-3 && off < 0.01 * known + 4.0 * noise, "{row}: {found} {known}");
    }
}

/// Light of a target at one wavelength as sunlight makes it, m² sr⁻¹, and its stated error: scattered once without an analyser, else all of it behind that.
fn behind(target: &Target, analyser: Option<Analyser>, sun: DVec3, observer: DVec3) -> [f64; 2] {
    let inter_reflection = if analyser.is_some() { Switch::On } else { Switch::Off };
    let analyser = analyser.or(Some(Analyser::Open));
    let switches = Switches { inter_reflection, analyser, ..Switches::OFF };
    // As many light paths as half a second holds.
    let options = Options { switches, budget_s: 0.5, ..Options::default() };
    let course = Course { range_m: 1e12, earthshine: 0.0, ..Course::default() };
    let engine = Engine::new(target, &options, &course).unwrap();
    let lighting = Lighting {
        sun_body: sun,
        sun_radius_rad: 0.0,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        earth: None,
        moon: None,
        view: View::Distant(observer),
    };
    let mut weights = vec![0.0; engine.terms().len()];
    let mut errors = weights.clone();
    engine.worker().light(&lighting, &mut weights, &mut errors).unwrap();
    [weights, errors]
        .map(|row| engine.terms().iter().zip(row).map(|(term, w)| term.spectrum.at(NM) * w).sum())
}

/// Targets of `benches/polarisation_bounces.py`, by their names there.
fn of_three(name: &str, kinds: [&str; 3]) -> Target {
    let mut target = match name {
        "box_wing" => Target::built_in("box_wing").unwrap(),
        "plate" => Target::parse(
            "plate.toml",
            "[[part]]\nname = \"x\"\nshape = \"plate\"\nsize_m = [2, 2]\nmaterial = \"m\"\n\
             [[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.5\n",
        )
        .unwrap(),
        _ => {
            let side = |name, offset, turn| {
                format!(
                    "[[part]]\nname = \"{name}\"\nshape = \"plate\"\nsize_m = [1, 1]\noffset_m = {offset}\n\
                     euler_zyx_deg = {turn}\nmaterial = \"m\"\n"
                )
            };
            let sides = [
                side("x", "[0, 0.5, 0.5]", "[0, 90, 0]"),
                side("y", "[0.5, 0, 0.5]", "[0, 0, -90]"),
                side("z", "[0.5, 0.5, 0]", "[0, 0, 0]"),
            ];
            let m = "[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.5\n";
            Target::parse("corner.toml", &(sides.concat() + m)).unwrap()
        }
    };
    let lobe = Lobe::isotropic(Distribution::Ggx, 0.25, Masking::Separable).unwrap();
    target.materials = kinds
        .iter()
        .map(|kind| match *kind {
            "aluminium" => Material::microfacet("aluminium", lobe, metal(0.958, 6.69)),
            "titanium" => Material::microfacet("titanium", lobe, metal(2.9, 3.1)),
            "glass" => Material::microfacet("glass", lobe, glass(1.5)),
            _ => {
                Material::lambert("grey", Spectrum::constant(0.6, 300.0, 1200.0).unwrap()).unwrap()
            }
        })
        .collect();
    for part in &mut target.parts {
        part.material = match part.name.as_str() {
            name if name == "y" || name.starts_with("wing_plus") => 1,
            name if name == "z" || name.starts_with("wing_minus") => 2,
            _ => 0,
        };
    }
    target
}

/// Truth: Mitsuba 3.9.1's Stokes vectors of a plate, the box-wing and a corner of three plates in aluminium, a metal like titanium, n = 1.5 and grey, light between surfaces of all orders in it
/// (`simulator/scenes/polarisation_bounces.ecsv`, by `benches/polarisation_bounces.py`). It changes degrees by up to a factor of ten and directions by up to 90°. Tolerances: 1e-3 of the degree and 1 % of it, and 0.5° where it is above
/// 0.005, as asked for; with four times the noise of the truth, and what is stated of our light paths.
#[test]
fn another_renderer_agrees_on_polarised_light_between_surfaces() {
    let text = include_str!("../scenes/polarisation_bounces.ecsv");
    let table = ecsv::read_str("polarisation_bounces.ecsv", text).unwrap();
    let number = |name: &str, row: usize| table.f64(name).unwrap()[row];
    let word = |name: &str, row: usize| table.text(name).unwrap()[row].clone().unwrap();
    let vector = |name: &str, row: usize| {
        DVec3::from(["x", "y", "z"].map(|axis| number(&format!("{name}_{axis}"), row))).normalize()
    };
    for row in 0..table.rows() {
        let kinds = ["first", "second", "third"].map(|name| word(name, row));
        let target = of_three(&word("target", row), kinds.each_ref().map(String::as_str));
        let (sun, observer) = (vector("sun", row), vector("observer", row));
        let [once, _] = behind(&target, None, sun, observer);
        let passes = [Analyser::Across, Analyser::Left, Analyser::Right]
            .map(|analyser| behind(&target, Some(analyser), sun, observer));
        let [b, c, d] = passes.map(|[light, _]| light - once);
        let stated = passes.map(|[_, error]| error).into_iter().fold(0.0, f64::max);
        let all = once + (b + c + d) * 2.0 / 3.0;
        let q = degree(&target, sun, observer) * once + (2.0 * b - c - d) * 2.0 / 3.0;
        let (q, u) = (q / all, (c - d) * 2.0 / 3.0_f64.sqrt() / all);
        let own = stated / all;
        let known = [number("q", row), number("u", row)];
        let noise = 4.0 * number("q_sigma", row).hypot(number("u_sigma", row));
        let (found, truth) = (q.hypot(u), known[0].hypot(known[1]));
        let turned = (0.5 * u.atan2(q) - 0.5 * known[1].atan2(known[0])).to_degrees();
        let turned = (turned + 90.0).rem_euclid(180.0) - 90.0;
        let more = all / once / number("more", row) - 1.0;
        println!(
            "{} {kinds:?} {:.5} {truth:.5} ± {noise:.5} {own:.5}, {turned:.2}°, {more:.4}",
            word("target", row),
            found
        );
        let off = (found - truth).abs();
        assert!(off < (1e-3_f64).min(0.01 * truth) + noise + own, "{row}: {found} {truth}");
        if truth > 0.005 {
            let noise_deg = ((noise + own) / truth).to_degrees() / 2.0;
            assert!(turned.abs() < 0.5 + noise_deg, "{row}: turned by {turned}");
        }
        let most = 4.0 * number("more_sigma", row) + own;
        assert!(more.abs() < 1e-3 + most, "{row}: {more} {most}");
    }
}

fn scene(target: &str) -> String {
    format!(
        "[target]\n{target}\n[orbit]\nlines = [\n\
         \"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\",\n\
         \"2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\"]\n\
         [station]\nname = \"ufo\"\n[times]\nfrom = 2008-09-21T18:46:00Z\nto = 2008-09-21T18:51:00Z\nstep_s = 30\n"
    )
}

/// Truth: the closed form at half of each sample's phase angle, for a sphere of glass facets, in all channels and V; 1e-4 for the stated error's part in the light.
#[test]
fn a_pass_is_polarised_by_its_phase() {
    let glass = "[[target.part]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"glass\"\n\
                 [[target.material]]\nname = \"glass\"\nmodel = \"microfacet\"\n\
                 distribution = \"ggx\"\nalpha = 0.3\nfresnel = \"dielectric\"\nn = 1.5";
    let pass = PassFile::parse("p.toml", &scene(glass)).unwrap();
    let pass = pass.resolve(Overrides::default()).unwrap();
    let simulation = pass.simulate(&|_| ()).unwrap();
    let found = simulation.polarisation(&|_| ()).unwrap();
    assert!(found.unknown.is_empty());
    let mut compared = 0;
    for (row, place) in simulation.places.iter().enumerate() {
        let [s, p] = reflectances(1.5, 0.0, 0.5 * place.geometry.phase_rad);
        let expected = (s - p) / (s + p);
        for (degrees, errors) in
            found.channels.iter().zip(&found.channels_error).chain([(&found.v, &found.v_error)])
        {
            if degrees[row].is_finite() {
                let off = (degrees[row] - expected).abs();
                assert!(
                    off <= errors[row] + 1e-4,
                    "{row}: {} {expected} {}",
                    degrees[row],
                    errors[row]
                );
                // At the edge of the Earth's shadow the light itself is hardly known.
                assert!(
                    errors[row] < 0.05 || place.sunlit_error > 0.01,
                    "{row}: {} {}",
                    errors[row],
                    place.sunlit_error
                );
                compared += 1;
            }
        }
    }
    assert!(compared > 20, "{compared}");
}

/// Truth: the same pass with the materials of unknown polarisation blackened, all effects on: what the light lost by that is theirs, and may be polarised wholly. The stated error is at least that, and
/// at least what the stated error of the light alone makes of it.
#[test]
fn what_may_be_polarised_is_in_the_error() {
    let pass = PassFile::parse("p.toml", &scene("built_in = \"box_wing\"")).unwrap();
    let pass = pass.resolve(Overrides::default()).unwrap();
    let simulation = pass.simulate(&|_| ()).unwrap();
    let found = simulation.polarisation(&|_| ()).unwrap();
    assert!(!found.unknown.is_empty() && found.unknown.len() < pass.target.materials.len());
    let mut blackened = pass.clone();
    for material in &mut blackened.target.materials {
        if found.unknown.contains(&material.name) {
            *material = black(material);
        }
    }
    let blackened = blackened.simulate(&|_| ()).unwrap();
    let (mut compared, mut most) = (0, 0.0_f64);
    let mut compare = |degree: f64, error: f64, share: f64, stated: f64| {
        if !degree.is_finite() {
            return;
        }
        // The rounding of sums of some ten terms.
        assert!(error >= share - 1e-12, "{error} {share}");
        assert!(error >= (1.0 + degree) * stated * (1.0 - 1e-12), "{error} {degree} {stated}");
        assert!((0.0..=1.0).contains(&degree), "{degree}");
        (compared, most) = (compared + 1, most.max(share));
    };
    for row in 0..simulation.places.len() {
        for (c, channel) in simulation.channels.iter().enumerate() {
            let hz = channel.rate_hz[row];
            let share = 1.0 - blackened.channels[c].rate_hz[row] / hz;
            let stated = channel.error_hz[row] / hz;
            compare(found.channels[c][row], found.channels_error[c][row], share, stated);
        }
        let fainter = blackened.magnitudes[[row, 2]] - simulation.magnitudes[[row, 2]];
        let left = if fainter.is_nan() { 0.0 } else { 10_f64.powf(-0.4 * fainter) };
        let stated = 1.0 - 10_f64.powf(-0.4 * simulation.magnitude_errors[[row, 2]]);
        compare(found.v[row], found.v_error[row], 1.0 - left, stated);
    }
    assert!(compared > 40 && most > 0.1, "{compared} {most}");
}

/// Truth: the same pass at a tolerance of 1e-4. Glossy paint on two boards that face one another, and a plate of glass facets: polarised, diffuse and bounced light. At 5 % the bounced light is
/// coarse or left out. The difference is within the stated error in at least 95 % of the rows.
#[test]
fn a_coarse_run_is_within_its_error_of_a_fine_one() {
    let target = "[[target.part]]\nname = \"floor\"\nshape = \"plate\"\nsize_m = [1.5, 1.5]\nmaterial = \"paint\"\n\
                  [[target.part]]\nname = \"body\"\nshape = \"box\"\nsize_m = [0.5, 0.5, 0.8]\noffset_m = [0.3, 0.1, 0.45]\nmaterial = \"paint\"\n\
                  [[target.part]]\nname = \"wing\"\nshape = \"plate\"\nsize_m = [1, 0.6]\noffset_m = [-0.5, 0, 0.6]\nmaterial = \"glass\"\n\
                  [[target.material]]\nname = \"paint\"\nmodel = \"blend\"\nbase = { reflectance = 0.6 }\n\
                  distribution = \"ggx\"\nalpha = 0.3\nfresnel = \"dielectric\"\nn = 1.5\n\
                  [[target.material]]\nname = \"glass\"\nmodel = \"microfacet\"\n\
                  distribution = \"ggx\"\nalpha = 0.4\nfresnel = \"dielectric\"\nn = 1.5";
    let spin = "\n[attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\nepoch_utc = 2008-09-21T18:46:00Z\naxis_gcrs = [0.3, 0.5, 0.8]\nperiod_s = 90.0\n";
    let text = scene(target).replace("step_s = 30", "step_s = 6") + spin;
    let at = |tolerance: f64| {
        let pass = PassFile::parse("p.toml", &text).unwrap();
        let mut pass = pass.resolve(Overrides::default()).unwrap();
        pass.tolerance = tolerance;
        let simulation = pass.simulate(&|_| ()).unwrap();
        simulation.polarisation(&|_| ()).unwrap()
    };
    let (coarse, fine) = (at(0.05), at(1e-4));
    let (mut rows, mut within, mut differ) = (0, 0, 0.0_f64);
    let of = |p: &sunglint_simulator::pass::Polarisation| {
        let values: Vec<f64> = p.channels.iter().flatten().chain(&p.v).copied().collect();
        let errors: Vec<f64> =
            p.channels_error.iter().flatten().chain(&p.v_error).copied().collect();
        (values, errors)
    };
    let ((found, errors), (known, _)) = (of(&coarse), of(&fine));
    for ((found, error), known) in found.iter().zip(&errors).zip(&known) {
        if known.is_finite() && found.is_finite() {
            let off = (found - known).abs();
            (rows, within) = (rows + 1, within + usize::from(off <= *error));
            differ = differ.max(off);
        }
    }
    println!("{within} of {rows} within; at most {differ}");
    assert!(rows > 100 && 100 * within >= 95 * rows, "{within} of {rows}");
    // The two runs do differ: else they would say nothing.
    assert!(differ > 1e-4, "{differ}");
}
