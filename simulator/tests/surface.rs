//! Materials: reciprocity, energy, distributions, masking, Fresnel terms, files.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::DVec3;
use sunglint_formats::toml::Document;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_simulator::surface::conductor::fresnel;
use sunglint_simulator::surface::file::{MaterialFile, material};
use sunglint_simulator::surface::{ComplexIndex, Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_testkit::{peer_python, run_python};

const DISTRIBUTIONS: [Distribution; 2] = [Distribution::Beckmann, Distribution::Ggx];
const MASKINGS: [Masking; 2] = [Masking::Separable, Masking::HeightCorrelated];
const ALPHAS: [f64; 7] = [1e-3, 0.01, 0.05, 0.15, 0.4, 1.0, 2.0];

fn flat(value: f64) -> Spectrum<Reflectance> {
    Spectrum::constant(value, 300.0, 1240.0).unwrap()
}

fn slope() -> Spectrum<Reflectance> {
    Spectrum::new(vec![300.0, 700.0, 1240.0], vec![0.05, 0.9, 1.0]).unwrap()
}

fn direction(theta_deg: f64, phi_deg: f64) -> DVec3 {
    let (theta, phi) = (theta_deg.to_radians(), phi_deg.to_radians());
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

fn fresnels() -> Vec<Fresnel> {
    let gold = ComplexIndex::named("gold").unwrap();
    vec![
        Fresnel::constant(flat(1.0)).unwrap(),
        Fresnel::schlick(slope()).unwrap(),
        Fresnel::conductor(&gold).unwrap(),
    ]
}

fn lobes() -> Vec<Lobe> {
    let mut lobes = Vec::new();
    for distribution in DISTRIBUTIONS {
        for masking in MASKINGS {
            for alpha in ALPHAS {
                lobes.push(Lobe::isotropic(distribution, alpha, masking).unwrap());
            }
            lobes.push(Lobe::anisotropic(distribution, 0.05, 0.6, masking).unwrap());
        }
    }
    lobes
}

fn blends() -> Vec<Material> {
    let coat = |distribution, alpha, masking, fresnel| {
        let lobe = Lobe::isotropic(distribution, alpha, masking).unwrap();
        Material::blend("paint", slope(), lobe, fresnel).unwrap()
    };
    let mut made = Vec::new();
    for distribution in DISTRIBUTIONS {
        for fresnel in fresnels() {
            made.push(coat(distribution, 0.15, Masking::HeightCorrelated, fresnel));
        }
        let schlick = Fresnel::schlick(flat(0.04)).unwrap();
        made.push(coat(distribution, 0.01, Masking::Separable, schlick));
        let tinted = Fresnel::constant(slope()).unwrap();
        made.push(coat(distribution, 1.0, Masking::Separable, tinted));
    }
    made
}

fn all() -> Vec<Material> {
    let mut made: Vec<Material> = Vec::new();
    let fresnels = fresnels();
    for lobe in lobes() {
        made.extend(fresnels.iter().map(|f| Material::microfacet("m", lobe, f.clone())));
    }
    made.extend(blends());
    made.extend(Material::built_in_names().iter().map(|n| Material::built_in(n).unwrap()));
    made
}

/// Truth: Helmholtz reciprocity; f is the same with light and eye exchanged. Tolerance: rounding, and of the interpolation in n + ik cancelling weights.
#[test]
fn every_material_is_reciprocal_finite_and_dark_from_behind() {
    let angles = [0.0, 1e-6, 20.0, 57.0, 80.0, 89.0, 89.99, 90.0 - 1e-9];
    let azimuths = [0.0, 37.0, 90.0, 179.0, 180.0];
    for material in all() {
        for (a, b) in angles.iter().flat_map(|a| angles.iter().map(move |b| (*a, *b))) {
            for phi in azimuths {
                let (i, o) = (direction(a, 11.0), direction(b, 11.0 + phi));
                let (there, back) = (material.brdf(633.0, i, o), material.brdf(633.0, o, i));
                let what = material.describe();
                assert!(there.is_finite() && there >= 0.0, "{what} {a} {b} {phi}: {there}");
                let error = (there - back).abs();
                assert!(error <= 1e-12 * there.abs(), "{what} {a} {b} {phi}: {there} {back}");
                let mut sum = vec![0.0; material.spectra().len()];
                for (i, o) in [(i, -o), (-i, o), (-i, -o), (i, DVec3::X), (DVec3::X, o)] {
                    material.add_weights(i, o, 1.0, &mut sum);
                }
                assert!(sum.iter().all(|w| w.to_bits() == 0), "{what}: {sum:?}");
            }
        }
    }
}

/// Truth: conservation of energy. Tolerance: rounding; a paint is darker by what its tables may err.
#[test]
fn no_material_reflects_more_than_came() {
    for material in all() {
        for theta in [0.0, 60.0, 85.0, 89.99] {
            let weights = material.albedo_weights(direction(theta, 20.0)).unwrap();
            for nm in [300.0, 633.0, 1240.0] {
                let albedo = material.times_spectra(nm, &weights);
                let what = material.describe();
                assert!((0.0..=1.0 + 1e-12).contains(&albedo), "{what} {theta} {nm}: {albedo}");
            }
        }
        assert!(material.spectra().iter().flat_map(|s| s.value()).all(|v| (0.0..=1.0).contains(v)));
    }
}

/// Truth: a white base under a dielectric coat loses nothing, whatever the coat's roughness. Tolerance: 2e-4, ten times what the tables may err,
/// all of it on the dark side.
#[test]
fn every_roughness_makes_a_paint() {
    for distribution in DISTRIBUTIONS {
        for alpha in [1e-5, 1e-3, 0.01, 0.05, 0.15, 0.2, 0.3, 0.6, 1.0, 2.0] {
            let lobe = Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
            let coat = Fresnel::schlick(flat(0.04)).unwrap();
            let paint = Material::blend("paint", flat(1.0), lobe, coat).unwrap();
            for theta in [0.0, 45.0, 80.0] {
                let albedo = paint.albedo(500.0, direction(theta, 0.0)).unwrap();
                let what = format!("{distribution:?} {alpha} {theta}: {albedo}");
                assert!((1.0 - 2e-4..=1.0 + 1e-12).contains(&albedo), "{what}");
            }
        }
    }
}

/// Truth: a smooth surface with F = 1 reflects all, and a paint with a white base too, whatever its coat. Tolerance: α² of lost light; twice what each of the tables of a paint may err (2e-5).
#[test]
fn nothing_is_lost_where_nothing_can_be() {
    for distribution in DISTRIBUTIONS {
        let lobe = Lobe::isotropic(distribution, 1e-3, Masking::Separable).unwrap();
        let one = Fresnel::constant(flat(1.0)).unwrap();
        let albedo =
            Material::microfacet("m", lobe, one).albedo(500.0, direction(30.0, 0.0)).unwrap();
        assert!((albedo - 1.0).abs() < 3e-6, "{distribution:?}: {albedo}");
        for fresnel in [flat(0.04), slope()].map(|r| Fresnel::schlick(r).unwrap()) {
            let lobe = Lobe::isotropic(distribution, 0.3, Masking::Separable).unwrap();
            let paint = Material::blend("paint", flat(1.0), lobe, fresnel).unwrap();
            for theta in [0.0, 45.0, 80.0, 89.0] {
                let albedo = paint.albedo(500.0, direction(theta, 0.0)).unwrap();
                assert!((albedo - 1.0).abs() < 8e-5, "{distribution:?} {theta}: {albedo}");
            }
        }
    }
}

/// The midpoint rule over slopes x = α_x r cos φ, y = α_y r sin φ, a way of its own: Σ of (normal, area of slopes).
fn over_slopes(lobe: &Lobe, mut add: impl FnMut(DVec3, f64)) {
    let (alpha_x, alpha_y) = lobe.alpha();
    let (radii, turns) = (8000, 256);
    for j in 0..radii {
        // r = tan ψ with ψ = (π/2) t²(3−2t), so that the midpoint rule converges fast at both ends.
        let t = (f64::from(j) + 0.5) / f64::from(radii);
        let psi = std::f64::consts::FRAC_PI_2 * t * t * (3.0 - 2.0 * t);
        let width = std::f64::consts::FRAC_PI_2 * 6.0 * t * (1.0 - t) / f64::from(radii);
        let (r, dr) = (psi.tan(), width / psi.cos().powi(2));
        for k in 0..turns {
            let phi = (f64::from(k) + 0.5) * std::f64::consts::TAU / f64::from(turns);
            let (x, y) = (alpha_x * r * phi.cos(), alpha_y * r * phi.sin());
            let area = alpha_x * alpha_y * r * dr * std::f64::consts::TAU / f64::from(turns);
            add(DVec3::new(-x, -y, 1.0).normalize(), area);
        }
    }
}

/// Truth: ∫ D cosθ dω = 1 and, for each direction, ∫ G₁ D max(0, ω·m) dm = cosθ (Heitz 2014, eqs. 9 and 14), by the midpoint rule. Tolerance: 1e-10 and,
/// since the clamped cosine has a kink, 2e-5 (256 azimuths across it).
#[test]
fn distributions_are_normalised_and_masking_is_smiths() {
    for (alpha_x, alpha_y) in [(0.01, 0.01), (0.4, 0.4), (0.1, 0.6), (2.0, 2.0)] {
        for distribution in DISTRIBUTIONS {
            let lobe =
                Lobe::anisotropic(distribution, alpha_x, alpha_y, Masking::Separable).unwrap();
            let views: Vec<DVec3> = [(0.0, 0.0), (40.0, 25.0), (75.0, 70.0), (89.0, 130.0)]
                .map(|(t, p)| direction(t, p))
                .into();
            let (mut whole, mut seen) = (0.0, vec![0.0; views.len()]);
            over_slopes(&lobe, |m, area| {
                // dω = cos³θ dx dy.
                let share = lobe.density(m) * m.z.powi(3) * area;
                whole += share * m.z;
                for (sum, view) in seen.iter_mut().zip(&views) {
                    *sum += share * view.dot(m).max(0.0);
                }
            });
            assert!((whole - 1.0).abs() < 1e-10, "{distribution:?} {alpha_x}: {whole}");
            for (sum, view) in seen.iter().zip(&views) {
                let ratio = lobe.masking_one(*view) * sum / view.z;
                assert!((ratio - 1.0).abs() < 2e-5, "{lobe:?} {view}: {ratio}");
            }
        }
    }
}

/// Truth: `beckmann` of the peer's exact sums (Python, with erfc), stored in `surface_beckmann.txt`. Tolerance: 1e-12, and in the far wings, where D is
/// e^(−tan²θ/α²), that exponent times 2e-15: the peer's 1 − cos²θ_h cancels.
#[test]
fn beckmann_is_the_peers() {
    let mut rows = 0;
    for line in include_str!("surface_beckmann.txt").lines().filter(|l| !l.starts_with('#')) {
        let v: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let lobe = Lobe::isotropic(Distribution::Beckmann, v[0], Masking::Separable).unwrap();
        let found = lobe.reflection(direction(v[1], 0.0), direction(v[2], 180.0));
        let exponent = (0.5 * (v[1] - v[2])).to_radians().tan().powi(2) / (v[0] * v[0]);
        let tolerance = 1e-12_f64.max(2e-15 * exponent) * v[3].abs() + 1e-300;
        assert!((found - v[3]).abs() <= tolerance, "{line}: {found}");
        rows += 1;
    }
    assert_eq!(rows, 48);
}

/// Truth: Fresnel's equations with numpy's complex numbers. Tolerance: 1e-12 of the law, 1e-6 of the interpolation between angles.
#[test]
fn fresnel_is_numpys_and_the_interpolation_holds() {
    let materials = ["aluminium", "silver", "gold", "copper", "silicon", "kapton", "germanium"];
    for name in materials {
        let index = ComplexIndex::named(name).unwrap();
        let term = Fresnel::conductor(&index).unwrap();
        println!(
            "{name}: {} angles, {} wavelengths, {:.1e}",
            term.spectra().len(),
            term.spectra()[0].value().len(),
            term.error()
        );
        assert!(term.error() <= 1e-6);
        assert!(index.range_nm() == term.spectra()[0].range_nm());
    }
    // By hand: aluminium at 516.6 nm, n = 0.8734, k = 6.2418: ((n−1)² + k²)/((n+1)² + k²) = 38.976/42.470.
    assert!((fresnel(0.8734, 6.2418, 1.0) - 0.917_735).abs() < 1e-5);
    let Some(python) = peer_python("fresnel_is_numpys_and_the_interpolation_holds", &["numpy"])
    else {
        return;
    };
    let script = "import numpy as np\nfor n, k in ((.8734, 6.2418), (.05, 4.), (1.5, 0.), (4., .01), (1.02, .9)):\n    for t in (0., 10., 45., 70., 80., 88., 89.9, 89.999):\n        c = np.cos(np.radians(t)); m = complex(n, k); q = np.sqrt(m * m - 1 + c * c)\n        print(n, k, t, repr(float(.5 * (abs((c - q) / (c + q))**2 + abs((m * m * c - q) / (m * m * c + q))**2))))\n";
    let gold = run_python(&python, script, &[]);
    for line in gold.lines() {
        let v: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let cos = v[2].to_radians().cos();
        assert!((fresnel(v[0], v[1], cos) - v[3]).abs() < 1e-12, "{line}");
        // An index that is the same at two wavelengths.
        let index =
            ComplexIndex::new("x", vec![400.0, 500.0], vec![v[0]; 2], vec![v[1]; 2]).unwrap();
        let term = Fresnel::conductor(&index).unwrap();
        let mut weights = vec![0.0; term.spectra().len()];
        term.add_weights(cos, 1.0, &mut weights);
        let found: f64 = term.spectra().iter().zip(&weights).map(|(s, w)| s.at(450.0) * w).sum();
        assert!((found - v[3]).abs() < 1.1e-6, "{line}: {found}");
    }
    assert_eq!(gold.lines().count(), 40);
}

fn error(text: &str) -> String {
    let document = Document::new("m.toml", text).unwrap();
    match document.parse::<MaterialFile>() {
        Err(error) => error.to_string(),
        Ok(file) => material(&document, "", &file).unwrap_err().to_string(),
    }
}

#[test]
fn files_say_what_is_wrong_and_where() {
    let rough = "name = \"a\"\nmodel = \"microfacet\"\nreflectance = 0.5\ndistribution = \"ggx\"\n";
    for (text, line, words) in [
        (format!("{rough}alpha = 0"), 5, "mirror"),
        (format!("{rough}alpha = 3.0"), 5, "from 1e-5 to 2"),
        (format!("{rough}alpha_x = 0.2"), 1, "also alpha_y"),
        (format!("{rough}alpha = 0.2\nalpha_x = 0.2"), 5, "either"),
        (format!("{rough}alpha = 0.2\nbase = {{ reflectance = 0.5 }}"), 6, "no `base`"),
        (format!("{rough}alpha = 0.2\nrefractive_index = \"gold\""), 6, "conductor"),
        (format!("{rough}alpha = 0.2\nfresnel = \"conductor\""), 3, "n + ik"),
        (format!("{rough}alpha = 0.2\nroughness = 0.2"), 6, "unknown key"),
        ("name = \"a\"\nmodel = \"lambert\"\nreflectance = 1.2".into(), 3, "fraction"),
        ("name = \"a\"\nmodel = \"lambert\"\nreflectance = 0.2\nalpha = 0.1".into(), 4, "no `alpha`"),
        ("name = \"a\"\nmodel = \"lambert\"\nreflectance_file = \"none.csv\"".into(), 3, "can be read"),
        ("name = \"a\"\nmodel = \"mirror\"\nfresnel = \"conductor\"\nrefractive_index = \"aluminum\"".into(), 4, "did you mean aluminium"),
    ] {
        let said = error(&text);
        assert!(said.starts_with(&format!("m.toml:{line}: ")) && said.contains(words), "{said}");
    }
}

/// Files lie beside the document, and are named with their hash (synthetic).
#[test]
fn files_become_materials() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("paint.toml");
    let text = "name = \"paint\"\nmodel = \"blend\"\nreflectance = 0.04\nfresnel = \"schlick\"\ndistribution = \"beckmann\"\nalpha = 0.2\nbase = { reflectance_file = \"white.csv\" }\n";
    std::fs::write(
        folder.path().join("white.csv"),
        "wavelength_nm,reflectance\n400,0.7\n900,0.9\n",
    )
    .unwrap();
    let document = Document::new(&path, text).unwrap();
    let (paint, sources) = material(&document, "", &document.parse().unwrap()).unwrap();
    assert_eq!(paint.name, "paint");
    assert!(sources.len() == 1 && sources[0].0.ends_with("white.csv") && sources[0].1.len() == 64);
    assert_eq!(paint.spectra().len(), 3);
    assert!(paint.albedo(650.0, DVec3::Z).unwrap() > 0.75);
}

/// Truth: the materials of the peer's scenes (`MATERIALS`), digit for digit.
#[test]
fn the_tables_of_illustration_are_as_published() {
    let mli = Material::built_in("mli").unwrap();
    assert_eq!(mli.spectra()[0].at(560.0), 0.52);
    assert_eq!(Material::built_in("aluminium").unwrap().spectra()[0].at(820.0), 0.868);
    assert_eq!(Material::built_in("solar_cell").unwrap().spectra()[0].at(500.0), 0.06);
    assert!(Material::built_in("aluminum").is_none());
}
