//! The library of fitted materials.

use sunglint_materials::look::{self, Look};
use sunglint_materials::samples::direction;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};

/// Truth: energy and reciprocity, and what the folder's README promises: each file names its measurement and a licence that allows it, reads as a material, and says how well it is known. Tolerance 1e-3 of albedo (its own
/// quadrature).
#[test]
fn the_gallery_is_what_it_says() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("gallery");
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        count += 1;
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(readme.contains(&format!("`{name}`")), "{name} is not in the README");
        let text = std::fs::read_to_string(&path).unwrap();
        for line in ["# source: ", "# licence: MIT"] {
            assert!(text.contains(line), "{name}: {line}");
        }
        let nm = if text.contains("532 nm") { 532.0 } else { 650.0 };
        let material = look::read(path.to_str().unwrap(), nm).unwrap();
        assert!(material.ln_doubt(direction(30.0, 0.0), direction(30.0, 180.0)).unwrap() > 0.05);
        let look = Look::new(&material, name, nm, 0.0).unwrap();
        assert!(look.albedo.iter().all(|a| a.1 <= 1.0 + 1e-3), "{name}: {:?}", look.albedo);
        assert!(look.reciprocity.1 < 1e-9, "{name}: {:?}", look.reciprocity);
        assert!(look::ball(&material, nm).unwrap().unwrap().iter().all(|p| p.1 > 0.0));
        assert!(look::box_wing(&material, nm).iter().all(|p| p.1 >= 0.0));
    }
    assert!(count >= 3, "{count}");
}

/// Truth: closed forms: a white Lambert ball of 1 m, 2/(3π)(sin φ + (π − φ) cos φ); the wing's 8 m² cos φ/π, and of the box's turning sides 4 · 1.3 m² times the mean of cos θ_i cos θ_o over a turn, (sin φ + (π − φ) cos φ)/(4π), times ρ/π.
/// Tolerance 1e-3 (steps of the turn, largest where it mirrors nothing: 1.5°).
#[test]
fn bodies_of_a_lambert_surface() {
    use std::f64::consts::PI;
    let white = Material::built_in("white").unwrap();
    let rho = PI * white.brdf(550.0, glam::DVec3::Z, glam::DVec3::Z);
    for (deg, found) in look::ball(&white, 550.0).unwrap().unwrap() {
        let phi: f64 = f64::to_radians(deg);
        let truth = rho * 2.0 / (3.0 * PI) * (phi.sin() + (PI - phi) * phi.cos());
        assert!((found / truth - 1.0).abs() < 1e-3, "{deg}: {found} {truth}");
    }
    for (deg, found) in look::box_wing(&white, 550.0) {
        let phi: f64 = f64::to_radians(deg);
        let sides = 4.0 * 1.3 * (phi.sin() + (PI - phi) * phi.cos()) / (4.0 * PI);
        let truth = rho / PI * (8.0 * phi.cos().max(0.0) + sides);
        assert!((found - truth).abs() < 1e-3 * (truth + 0.05), "{deg}: {found} {truth}");
    }
}

/// Truth: closed form of a narrow GGX lobe of constant reflectance F: each of the four sides mirrors the Sun once a turn, ∫ D du = 1/(2α) over the tilt u in the plane, so that the mean over a turn is A F/(4πα), at
/// any phase angle. Tolerance 1 %: masking and the lobe's own width at 10 to 120°.
#[test]
fn a_narrow_glint_of_turning_sides_is_not_missed() {
    use std::f64::consts::PI;
    for alpha in [1e-3, 1e-4] {
        let lobe = Lobe::isotropic(Distribution::Ggx, alpha, Masking::Separable).unwrap();
        let grey = Spectrum::constant(0.9, 300.0, 1240.0).unwrap();
        let material = Material::microfacet("metal", lobe, Fresnel::constant(grey).unwrap());
        let truth = 1.3 * 0.9 / (4.0 * PI * alpha);
        for (deg, found) in look::box_wing(&material, 550.0) {
            if (10.0..=120.0).contains(&deg) {
                assert!((found / truth - 1.0).abs() < 0.01, "{alpha}, {deg}: {found} {truth}");
            }
        }
    }
}
