//! A plate of a fitted material, as `brdf fit` writes it, under the Sun: lobes, a coherent mirror narrower than the disc, diffuse light.

use super::kit::*;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_formats::toml::Document;
use sunglint_simulator::surface::Material;
use sunglint_simulator::surface::file::{MaterialFile, material};

/// Like the solar array of a satellite (the numbers are near those that its fit gives); `alpha` is the mirror's.
fn fitted(alpha: f64) -> Material {
    let text = format!(
        r#"
[[material]]
name = "array"
model = "composite"
fresnel = "dielectric"
n = 3.0
mirror = {{ share = 0.5, g = 2.0, alpha = {alpha} }}
diffuse = {{ reflectance = 0.01, power = 0.5 }}
[[material.lobe]]
distribution = "abg"
a_per_sr = 0.002
b = 0.0008
g = 2.6
[[material.lobe]]
distribution = "ggx"
alpha = 0.3
share = 0.2
[material.doubt]
peak_ln = 0.3
wings_ln = 0.5
grazing_ln = 0.8
"#
    );
    #[derive(serde::Deserialize)]
    struct File {
        material: Vec<MaterialFile>,
    }
    let document = Document::new("m.toml", &text).unwrap();
    let file: File = document.parse().unwrap();
    material(&document, "material[0]", &file.material[0]).unwrap().0
}

/// The same, written from the formulas: Fresnel's equations, Pfisterer's ABg, Walter's GGX and Beckmann with Smith's masking, Minnaert's diffuse light.
fn formula(alpha: f64, i: DVec3, o: DVec3) -> f64 {
    let h = (i + o).normalize();
    let cos = i.dot(h);
    let n: f64 = 3.0;
    let inside = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let s = ((cos - n * inside) / (cos + n * inside)).powi(2);
    let p = ((n * cos - inside) / (n * cos + inside)).powi(2);
    let fresnel = 0.5 * (s + p);
    let x = (i.x + o.x).hypot(i.y + o.y);
    let abg = 0.002 / (0.0008 + x.powf(2.6));
    let tan2 = 1.0 / (h.z * h.z) - 1.0;
    let ggx = {
        let a2: f64 = 0.09;
        let d = (1.0 + tan2 / a2).powi(-2) / (PI * a2 * h.z.powi(4));
        let g = |v: DVec3| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt());
        0.2 * d * g(i) * g(o) / (4.0 * i.z * o.z)
    };
    // So smooth a mirror masks nothing: 1 − G is below 1e-9 up to 85°.
    let d = (-tan2 / (alpha * alpha)).exp() / (PI * alpha * alpha * h.z.powi(4));
    let mirror = 0.5 * (-(2.0 * cos).powi(2)).exp() * d / (4.0 * i.z * o.z);
    fresnel * (abg + ggx + mirror) + 0.01 * 2.5 / TAU * (i.z * o.z).sqrt()
}

/// Truth: f cosθ_i cosθ_o from the formulas above, averaged over the darkened disc by rings of our own (400²). In the glint, at its flank, in the wings, near grazing and towards the light; the mirror's
/// lobe is 0.17° wide, the disc 0.27°. Tolerance: what is stated and 1e-3.
#[test]
fn a_plate_of_a_fitted_material() {
    let target = facet(fitted(0.0015));
    for theta_deg in [5.0_f64, 41.4, 60.0, 75.0] {
        let sun = tilted(theta_deg.to_radians());
        for off_deg in [0.0_f64, 0.1, 0.3, 0.6, -0.4, 2.0, -20.0, -70.0] {
            let to = tilted(-(theta_deg + off_deg).to_radians().min(1.5));
            for aside in [0.0_f64, 0.002, 0.3] {
                let to = (to + aside * DVec3::Y).normalize();
                let (found, stated) = weigh(&target, &lighting(sun, to), 550.0);
                let truth = average(sun, 550.0, 400, |d| formula(0.0015, d, to) * d.z * to.z);
                let off = (found - truth).abs();
                assert!(
                    off <= stated + 1e-3 * truth,
                    "{theta_deg} {off_deg} {aside}: {found:e} {truth:e} {stated:e}"
                );
            }
        }
    }
}

/// Truth: the file's own numbers, by region: 3° about the mirrored direction, beyond 75° from the normal, elsewhere.
#[test]
fn the_doubt_of_a_fitted_material_is_kept() {
    let made = fitted(0.0015);
    let at = |a: f64, b: f64| made.ln_doubt(tilted(a.to_radians()), tilted(b.to_radians()));
    assert_eq!(at(30.0, -31.0), Some(0.3));
    assert_eq!(at(30.0, 20.0), Some(0.5));
    assert_eq!(at(30.0, 80.0), Some(0.8));
    assert_eq!(at(30.0, 95.0), None);
    assert_eq!(white().ln_doubt(tilted(0.1), tilted(0.2)), None);
}

/// Truth: ∫ f cosθ_i cosθ_o over the lit and seen part of a sphere of 1 m, summed in longitude and latitude from the formulas (midpoints, 4 million); a mirror of 1.7°, which that grid resolves.
/// Tolerance 1e-3.
#[test]
fn a_sphere_of_a_fitted_material() {
    let made = fitted(0.03);
    for phase in [20.0_f64, 90.0, 140.0] {
        let phase = phase.to_radians();
        let mut sum = vec![0.0; made.spectra().len()];
        made.add_sphere_weights(phase, 1.0, &mut sum).unwrap();
        let found = made.times_spectra(550.0, &sum);
        let half = 0.5 * (PI - phase);
        let (i, o) = (
            DVec3::new((0.5 * phase).cos(), (0.5 * phase).sin(), 0.0),
            DVec3::new((0.5 * phase).cos(), -(0.5 * phase).sin(), 0.0),
        );
        let n = 2000;
        let mut truth = 0.0;
        for j in 0..n {
            let longitude = half * (2.0 * (f64::from(j) + 0.5) / f64::from(n) - 1.0);
            for k in 0..n / 2 {
                let latitude = FRAC_PI_2 * (f64::from(k) + 0.5) / f64::from(n / 2);
                let normal = DVec3::new(
                    latitude.cos() * longitude.cos(),
                    latitude.cos() * longitude.sin(),
                    latitude.sin(),
                );
                let east = DVec3::new(-longitude.sin(), longitude.cos(), 0.0);
                let north = normal.cross(east);
                let local = |d: DVec3| DVec3::new(d.dot(east), d.dot(north), d.dot(normal));
                let (i, o) = (local(i), local(o));
                if i.z > 1e-12 && o.z > 1e-12 {
                    // Both halves of the latitude.
                    let area = 2.0
                        * latitude.cos()
                        * (2.0 * half / f64::from(n))
                        * (FRAC_PI_2 / f64::from(n / 2));
                    truth += area * i.z * o.z * formula(0.03, i, o);
                }
            }
        }
        println!("{phase}: {found} {truth}");
        assert!((found / truth - 1.0).abs() < 1e-3, "{phase}: {found} {truth}");
    }
}
