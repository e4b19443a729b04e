//! Colour of a fitted surface: a spectrum divided among its parts.

use super::fit::{beckmann, ggx};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::PI;
use sunglint_materials::fit::surface::colour::{ColourError, Division, SpectrumGeometry, divide};
use sunglint_materials::fit::surface::{
    Cone, Floor, Kind, Recipe, Rise, SurfaceFit, SurfaceOptions, fit_surface,
};
use sunglint_materials::samples::{Sample, Samples, direction};
use sunglint_numerics::progress::Silent;
use sunglint_simulator::surface::Material;
use sunglint_testkit::Campaign;

const AT_NM: f64 = 532.0;

/// A made-up surface.
struct Truth {
    recipe: Recipe,
    /// F at normal incidence at 532 nm; Schlick's where it rises.
    f0: f64,
    rises: bool,
    alpha: f64,
    /// g of a mirror of the same F at 532 nm, without one 0.
    g: f64,
    rho: f64,
    /// Colours of F and of the diffuse part by wavelength, 1 at 532 nm.
    of_f: fn(f64) -> f64,
    of_rho: fn(f64) -> f64,
}

fn flat(_: f64) -> f64 {
    1.0
}

/// A paint that reflects red light more.
fn red(nm: f64) -> f64 {
    (0.35 + 0.65 / (1.0 + (-(nm - 600.0) / 40.0).exp()))
        / (0.35 + 0.65 / (1.0 + (-(AT_NM - 600.0) / 40.0).exp()))
}

/// A metal as gold is.
fn golden(nm: f64) -> f64 {
    (0.4 + 0.55 / (1.0 + (-(nm - 520.0) / 15.0).exp()))
        / (0.4 + 0.55 / (1.0 + (-(AT_NM - 520.0) / 15.0).exp()))
}

fn blue(nm: f64) -> f64 {
    (AT_NM / nm).powf(1.2)
}

const MIRROR_ALPHA: f64 = 0.004;

impl Truth {
    fn lobe(&self, nm: f64, i: DVec3, o: DVec3) -> f64 {
        let f = self.f0 * (self.of_f)(nm);
        ggx(f, self.alpha, self.alpha, self.rises, 0.0)(i, o)
    }

    /// F of the mirror, and what is coherent.
    fn mirrored(&self, nm: f64, cos: f64) -> f64 {
        if self.g == 0.0 {
            return 0.0;
        }
        let f = self.f0 * (self.of_f)(nm);
        let f = if self.rises { f + (1.0 - f) * (1.0 - cos).powi(5) } else { f };
        f * (-(self.g * AT_NM / nm * cos).powi(2)).exp()
    }

    fn f(&self, nm: f64, i: DVec3, o: DVec3) -> f64 {
        let cos = i.dot((i + o).normalize());
        self.lobe(nm, i, o)
            + self.mirrored(nm, cos) * beckmann(1.0, MIRROR_ALPHA, 0.0)(i, o)
            + self.rho * (self.of_rho)(nm) / PI
    }

    /// Directional–hemispherical reflectance: the lobe in steps of 1° about the mirrored direction.
    fn albedo(&self, nm: f64, theta_i_deg: f64) -> f64 {
        let i = direction(theta_i_deg, 0.0);
        let mut sum = self.rho * (self.of_rho)(nm) + self.mirrored(nm, i.z);
        let (n, m) = (240, 240);
        for a in 0..n {
            let z = (f64::from(a) + 0.5) / f64::from(n);
            for b in 0..m {
                let phi = 2.0 * PI * (f64::from(b) + 0.5) / f64::from(m);
                let s = (1.0 - z * z).sqrt();
                let o = DVec3::new(s * phi.cos(), s * phi.sin(), z);
                sum += self.lobe(nm, i, o) * z * 2.0 * PI / f64::from(n * m);
            }
        }
        sum
    }

    /// Radiant intensity of a sphere of 1 m at a phase angle, over the irradiance: the mirror's is that of a mirror ball, F/4.
    fn sphere(&self, nm: f64, phase: f64) -> f64 {
        let sun = DVec3::new(phase.sin(), 0.0, phase.cos());
        let mut sum = 0.25 * self.mirrored(nm, (0.5 * phase).cos());
        let n = 160;
        for a in 0..n {
            let z = (f64::from(a) + 0.5) / f64::from(n);
            for b in 0..2 * n {
                let phi = PI * (f64::from(b) + 0.5) / f64::from(n);
                let s = (1.0 - z * z).sqrt();
                let normal = DVec3::new(s * phi.cos(), s * phi.sin(), z);
                let (ci, co) = (normal.dot(sun), z);
                if ci <= 0.0 {
                    continue;
                }
                // In the surface's axes, isotropic.
                let (i, o) = local(normal, sun);
                let f = self.lobe(nm, i, o) + self.rho * (self.of_rho)(nm) / PI;
                sum += f * ci * co * PI / f64::from(n * n);
            }
        }
        sum
    }
}

/// Light and observer (+z) in the axes of a facet.
fn local(normal: DVec3, sun: DVec3) -> (DVec3, DVec3) {
    let (x, y) = normal.any_orthonormal_pair();
    let into = |v: DVec3| DVec3::new(v.dot(x), v.dot(y), v.dot(normal));
    (into(sun), into(DVec3::Z))
}

/// Σ A cosθ_i cosθ_o f over three sides of a box and a wing.
fn box_wing(f: &dyn Fn(DVec3, DVec3) -> f64, phase: f64) -> f64 {
    let sun = DVec3::new(phase.sin(), 0.0, phase.cos());
    let normals = [(1.0, 10.0, 30.0), (1.0, 60.0, -70.0), (1.3, 75.0, 150.0), (8.0, 35.0, 20.0)];
    let side = |(area, theta, phi): &(f64, f64, f64)| {
        let normal = direction(*theta, *phi);
        let (i, o) = local(normal, sun);
        if i.z <= 0.0 || o.z <= 0.0 { 0.0 } else { area * i.z * o.z * f(i, o) }
    };
    normals.iter().map(side).sum()
}

/// Colour indices of six bands of 100 nm from 400 nm, against the second one.
fn indices(light: &dyn Fn(f64) -> f64) -> Vec<f64> {
    let bands: Vec<f64> = (0..6)
        .map(|b| (0..10).map(|k| light(405.0 + 100.0 * f64::from(b) + 10.0 * f64::from(k))).sum())
        .collect();
    bands.iter().map(|i| -2.5 * (i / bands[1]).log10()).collect()
}

fn all_indices(truth: &Truth) -> Vec<f64> {
    let mut all = Vec::new();
    for deg in [30.0_f64, 90.0] {
        // A sphere's integral is smooth in wavelength: every 25 nm.
        let nodes: Vec<f64> =
            (0..25).map(|k| truth.sphere(400.0 + 25.0 * f64::from(k), deg.to_radians())).collect();
        all.extend(indices(&|nm| {
            let x = (nm - 400.0) / 25.0;
            let k = (x as usize).min(23);
            nodes[k] + (x - k as f64) * (nodes[k + 1] - nodes[k])
        }));
        all.extend(indices(&|nm| box_wing(&|i, o| truth.f(nm, i, o), deg.to_radians())));
    }
    all
}

fn all_indices_of(material: &Material) -> Vec<f64> {
    let mut all = Vec::new();
    for deg in [30.0_f64, 90.0] {
        let mut sum = vec![0.0; material.spectra().len()];
        material.add_sphere_weights(deg.to_radians(), 1.0, &mut sum).unwrap();
        all.extend(indices(&|nm| material.times_spectra(nm, &sum)));
        all.extend(indices(&|nm| box_wing(&|i, o| material.brdf(nm, i, o), deg.to_radians())));
    }
    all
}

fn fitted(truth: &Truth, noise: f64, rng: &mut Xoshiro256PlusPlus) -> SurfaceFit {
    let mut rows = Vec::new();
    for theta_i in [8.0, 30.0, 50.0, 68.0] {
        let mut angles: Vec<f64> = (-20..=20).map(|k| 4.0 * f64::from(k)).collect();
        angles.extend((-8..=8).map(|k| theta_i + 0.3 * f64::from(k)));
        for theta_o in angles {
            let (u, v): (f64, f64) = (rng.random(), rng.random());
            let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (2.0 * PI * v).cos();
            let f = truth.f(AT_NM, direction(theta_i, 0.0), direction(theta_o, 180.0));
            rows.push(Sample {
                theta_i_deg: theta_i,
                phi_i_deg: 0.0,
                theta_o_deg: theta_o,
                phi_o_deg: 180.0,
                brdf_per_sr: vec![f * (noise * normal).exp()],
                sigma_per_sr: vec![],
            });
        }
    }
    let samples = Samples { wavelength_nm: vec![AT_NM], rows, ..Samples::default() };
    let mut options = SurfaceOptions::default();
    options.cone = Cone { detector_deg: 0.0, source_deg: 0.0 };
    options.recipes = vec![truth.recipe.clone()];
    fit_surface(&samples, &options, &Silent).unwrap()
}

/// A surface of a kind that goes with the seed. Its diffuse part is darkened where the sum would reflect more than 0.85 at the normal at some wavelength: there is no such surface at 60°.
fn made_up(seed: u64, rng: &mut Xoshiro256PlusPlus) -> Truth {
    let mut truth = drawn(seed, rng);
    let most = |of: &dyn Fn(f64) -> f64| {
        (0..=120).map(|k| of(400.0 + 5.0 * f64::from(k))).fold(0.0, f64::max)
    };
    let room = 0.85 - most(&|nm| truth.f0 * (truth.of_f)(nm));
    let brightest = truth.rho * most(&|nm| (truth.of_rho)(nm));
    // Metals have no diffuse part.
    if brightest > room && brightest > 0.0 {
        truth.rho *= room.max(0.1) / brightest;
    }
    truth
}

fn drawn(seed: u64, rng: &mut Xoshiro256PlusPlus) -> Truth {
    let mut from = |a: f64, b: f64| a * (b / a).powf(rng.random::<f64>());
    let (alpha, rho) = (from(0.1, 0.35), from(0.05, 0.5));
    let of_rho = [red as fn(f64) -> f64, blue, flat][(seed / 4 % 3) as usize];
    let one = |rise, floor, mirror| Recipe { lobes: vec![Kind::Ggx], mirror, rise, floor };
    match seed % 4 {
        // Gloss over paint.
        0 => Truth {
            recipe: one(Rise::Schlick, Floor::Lambert, false),
            f0: from(0.03, 0.06),
            rises: true,
            alpha,
            g: 0.0,
            rho,
            of_f: flat,
            of_rho,
        },
        // A metal.
        1 => Truth {
            recipe: one(Rise::Constant, Floor::None, false),
            f0: from(0.4, 0.7),
            rises: false,
            alpha,
            g: 0.0,
            rho: 0.0,
            of_f: [golden as fn(f64) -> f64, blue, flat][(seed / 4 % 3) as usize],
            of_rho: flat,
        },
        // Glass before cells: a mirror with gloss beside it over diffuse light.
        2 => Truth {
            recipe: one(Rise::Schlick, Floor::Lambert, true),
            f0: 0.05,
            rises: true,
            alpha,
            g: from(0.5, 1.6),
            rho: 0.3 * rho,
            of_f: flat,
            of_rho,
        },
        // Between metal and dielectric: what lies at either end.
        _ => {
            let of_f = [flat as fn(f64) -> f64, red][(seed / 4 % 2) as usize];
            let of_rho = red;
            Truth {
                recipe: one(Rise::Constant, Floor::Lambert, false),
                f0: from(0.15, 0.25),
                rises: false,
                alpha,
                g: 0.0,
                rho: from(0.1, 0.3),
                of_f,
                of_rho,
            }
        }
    }
}

/// Truth: closed forms written from the papers, integrated here over spheres and summed over the sides of a box with a wing. Fitted at 532 nm with 1 % noise; one spectrum from 400 to 1,000 nm at 30°, by turns at
/// the normal and hemispherical. Tolerance, as promised: where the division is determined, colour indices of six bands at phase angles 30 and 90° within 0.03 mag; else inside both extremes, and 0.03 mag, in 95 %. What
/// scaling the whole spectrum would give is shown beside it.
#[test]
fn campaign_colour() {
    let mut campaign = Campaign::start("colour", 100);
    let tried = campaign.seeds().end - campaign.seeds().start;
    let (mut off, mut off_scaled) = (0.0_f64, 0.0_f64);
    let (mut undetermined, mut inside, mut determined, mut over) = (0, 0, 0_u64, 0);
    // Not the seeds of 4200, at which the rules were chosen.
    for seed in campaign.seeds() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(5200 + seed);
        let truth = made_up(seed, &mut rng);
        let fit = fitted(&truth, 0.01, &mut rng);
        let nm: Vec<f64> = (0..121).map(|k| 400.0 + 5.0 * f64::from(k)).collect();
        let (geometry, value): (_, Vec<f64>) = if seed / 2 % 2 == 0 {
            let (i, o) = (direction(30.0, 0.0), direction(0.0, 0.0));
            let geometry = SpectrumGeometry::Directional {
                theta_i_deg: 30.0,
                theta_o_deg: 0.0,
                azimuth_deg: 0.0,
            };
            (geometry, nm.iter().map(|nm| truth.f(*nm, i, o)).collect())
        } else {
            let geometry = SpectrumGeometry::Hemispherical { theta_i_deg: 30.0 };
            (geometry, nm.iter().map(|nm| truth.albedo(*nm, 30.0)).collect())
        };
        let colour = divide(&fit, geometry, &nm, &value).unwrap();
        let ours = all_indices_of(&colour.material(&fit, "made").unwrap());
        let wanted = all_indices(&truth);
        let [neutral, alike] = colour.extremes(&fit, "made").unwrap();
        let (neutral, alike) = (all_indices_of(&neutral), all_indices_of(&alike));
        let apart =
            |a: &[f64]| a.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0_f64, f64::max);
        println!(
            "{seed}: {:?} {geometry:?} off {:.4} mag, scaled {:.4}, neutral {:.4}; share {:.3}",
            colour.division,
            apart(&ours),
            apart(&alike),
            apart(&neutral),
            colour.specular_share
        );
        if colour.division == Division::Undetermined {
            for (k, wanted) in wanted.iter().enumerate() {
                let (a, b) = (neutral[k].min(alike[k]), neutral[k].max(alike[k]));
                undetermined += 1;
                inside += i32::from(*wanted > a - 0.03 && *wanted < b + 0.03);
            }
        } else {
            determined += 1;
            over += i32::from(apart(&ours) > 0.03);
            off = off.max(apart(&ours));
            off_scaled = off_scaled.max(apart(&alike));
        }
    }
    println!(
        "determined {determined}, {over} off by more than 0.03, at most {off:.4} mag (scaled {off_scaled:.4}); {inside} of {undetermined} inside"
    );
    campaign.largest("off_mag", off);
    campaign.finish();
    assert!(2 * determined >= tried && over == 0, "{over} of {determined}: {off}");
    // What the division is for.
    assert!(off_scaled > 3.0 * off, "{off_scaled} {off}");
    assert!(100 * inside >= 95 * undetermined);
}

/// Truth: what the file says is what the library gives: a scene reads the TOML; and what cannot be divided is refused with the reason.
#[test]
fn coloured_materials_are_read_by_scenes() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let truth = made_up(2, &mut rng);
    let fit = fitted(&truth, 0.005, &mut rng);
    let nm: Vec<f64> = (0..61).map(|k| 400.0 + 10.0 * f64::from(k)).collect();
    let geometry =
        SpectrumGeometry::Directional { theta_i_deg: 30.0, theta_o_deg: 0.0, azimuth_deg: 0.0 };
    let value: Vec<f64> =
        nm.iter().map(|nm| truth.f(*nm, direction(30.0, 0.0), DVec3::Z)).collect();
    let colour = divide(&fit, geometry, &nm, &value).unwrap();
    let file = std::env::temp_dir().join(format!("sunglint_colour_{}.toml", std::process::id()));
    std::fs::write(&file, colour.to_toml(&fit, "cells")).unwrap();
    let read = sunglint_materials::look::read(file.to_str().unwrap(), 600.0).unwrap();
    std::fs::remove_file(&file).unwrap();
    let made = colour.material(&fit, "cells").unwrap();
    for nm in [420.0, 532.0, 850.0] {
        let (i, o) = (direction(40.0, 0.0), direction(40.0, 180.0));
        let (a, b) = (read.brdf(nm, i, o), made.brdf(nm, i, o));
        assert!((a / b - 1.0).abs() < 1e-9, "{nm}: {a} {b}");
        // g of the mirror goes as 1/λ, and the mirror is nearly all of the light there; 5 % of g² from the fit.
        let ratio = a / truth.f(nm, i, o);
        assert!((ratio - 1.0).abs() < 0.08, "{nm}: {ratio}");
    }
    let refused = divide(&fit, geometry, &[600.0, 700.0], &[0.1, 0.2]);
    assert!(matches!(refused, Err(ColourError::Apart { .. })));
    let below = SpectrumGeometry::Hemispherical { theta_i_deg: 95.0 };
    assert!(matches!(divide(&fit, below, &nm, &value), Err(ColourError::Horizon { .. })));
    assert!(matches!(divide(&fit, geometry, &nm, &value[1..]), Err(ColourError::Spectrum { .. })));
}
