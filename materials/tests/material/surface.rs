//! Real surfaces: several parts through a table of several incidences.

use super::fit::{abg, beckmann, ggx};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use sunglint_formats::{fred, zemax};
use sunglint_materials::exchange::{self, Exchange};
use sunglint_materials::fit::surface::{
    Cone, Flaw, Floor, Kind, Recipe, Rise, SurfaceFit, SurfaceOptions, fit_surface,
    hemisphere::{self, Hemisphere},
};
use sunglint_materials::fit::{FitError, FitOptions, fit};
use sunglint_materials::ingest::once;
use sunglint_materials::read;
use sunglint_materials::samples::{Sample, Samples, direction, turned};
use sunglint_numerics::progress::Silent;
use sunglint_testkit::{Campaign, shared, skip};

type Truth<'a> = &'a dyn Fn(DVec3, DVec3) -> f64;

/// A table in the plane of incidence and, at `azimuths`, out of it, with errors of a part of each value.
fn table(f: Truth<'_>, incidences: &[f64], azimuths: &[f64], noise: f64, seed: u64) -> Samples {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut rows = Vec::new();
    for theta_i in incidences {
        for azimuth in azimuths {
            for k in -40..=40 {
                let theta_o = 2.0 * f64::from(k);
                // Out of the plane one half is enough.
                if *azimuth != 180.0 && k <= 0 {
                    continue;
                }
                let (i, o) = (direction(*theta_i, 0.0), direction(theta_o, *azimuth));
                // Box and Muller.
                let (u, v): (f64, f64) = (rng.random(), rng.random());
                let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (2.0 * PI * v).cos();
                rows.push(Sample {
                    theta_i_deg: *theta_i,
                    phi_i_deg: 0.0,
                    theta_o_deg: theta_o,
                    phi_o_deg: *azimuth,
                    brdf_per_sr: vec![f(i, o) * (noise * normal).exp()],
                    sigma_per_sr: vec![],
                });
            }
        }
    }
    Samples { wavelength_nm: vec![550.0], rows, ..Samples::default() }
}

fn pointwise() -> SurfaceOptions {
    let mut options = SurfaceOptions::default();
    options.cone = Cone { detector_deg: 0.0, source_deg: 0.0 };
    options
}

fn recipe(lobes: &[Kind], floor: Floor) -> Recipe {
    Recipe { lobes: lobes.to_vec(), mirror: false, rise: Rise::Constant, floor }
}

fn show(fit: &SurfaceFit) {
    eprintln!("{} {:?} doubt {:?}", fit.name, fit.rms_ln, fit.doubt);
    for i in &fit.incidences {
        eprintln!("{i:?}");
    }
    for flaw in &fit.flaws {
        eprintln!("! {flaw}");
    }
}

/// Truth: ∫ cosθ dω/π = 1 over the hemisphere of a Lambert surface, and e^(−(x/w)²) in direction cosines about the mirrored direction, whose area is πw² while it lies inside
/// the disc. Tolerance: 2 % in the plane (steps of 1°; the horizon's last half step), 3 % for samples out of it every 5° and 10° (the horizon's last 5°); 12 % of the bell there, whose half-width is
/// 7°, which is what the stated doubt says.
#[test]
fn hemispherical_reflectance_is_the_integral() {
    let w: f64 = 0.12;
    for theta_i in [0.0, 5.0, 41.4, 60.0, 75.0] {
        let i = turned(direction(theta_i, 0.0), DVec3::Z).0;
        let plane: Vec<DVec3> = (-89..=89).map(|k| direction(f64::from(k), 180.0)).collect();
        let mut grid = vec![DVec3::Z];
        for theta in 1..=17 {
            grid.extend((0..=18).map(|k| direction(5.0 * f64::from(theta), 10.0 * f64::from(k))));
        }
        for (o, most) in [(&plane, 0.02), (&grid, 0.03)] {
            let flat = vec![1.0 / PI; o.len()];
            let found = Hemisphere::new(i, o, &flat);
            let lambert = found.of(&flat);
            assert!((lambert - 1.0).abs() < most, "{theta_i}: {lambert}");
            assert!((found.coverage - lambert).abs() < 1e-9 && found.ln_doubt < 1e-9);
            // Beyond, the horizon cuts the bell.
            if theta_i <= 42.0 {
                let bell = |o: &DVec3| (-((o.x + i.x).powi(2) + o.y * o.y) / (w * w)).exp();
                let value: Vec<f64> = o.iter().map(bell).collect();
                let found = Hemisphere::new(i, o, &value);
                let ratio = found.of(&value) / (PI * w * w);
                let most = if o.len() == plane.len() { 0.01 } else { 0.12 };
                eprintln!("{theta_i}: {ratio} {}", found.ln_doubt);
                assert!((ratio - 1.0).abs() < most, "{theta_i}: {ratio}");
                assert!(found.is_resolved());
            }
        }
    }
    // The peak: the sample nearest to the mirrored direction, and its neighbour where it lies between two.
    let o: Vec<DVec3> = (0..90).map(|k| direction(f64::from(k), 180.0)).collect();
    let at = |theta: f64| hemisphere::peak(direction(theta, 0.0), &o, 0.24_f64.to_radians(), 0.1);
    assert_eq!(at(60.0), [60]);
    assert_eq!(at(41.4), [41, 42]);
    assert!(hemisphere::peak(direction(60.0, 0.0), &o[..50], 0.004, 0.1).is_empty());
}

/// ∫ f cosθ dω by fine rings about the mirrored ray, whose radii grow by factors: 800 × 360 directions, no part of the project's rules.
fn reflected(f: Truth<'_>, theta_i_deg: f64) -> f64 {
    let i = direction(theta_i_deg, 180.0);
    let mirrored = direction(theta_i_deg, 0.0);
    let (along, across) = (direction(theta_i_deg + 90.0, 0.0), DVec3::Y);
    let edge = |k: u32| if k == 0 { 0.0 } else { 1e-5 * (PI / 1e-5).powf(f64::from(k) / 800.0) };
    let mut sum = 0.0;
    for k in 0..800 {
        let (a, b) = (edge(k), edge(k + 1));
        let (sin, cos) = (0.5 * (a + b)).sin_cos();
        for j in 0..360 {
            let (y, x) = ((f64::from(j) + 0.5).to_radians()).sin_cos();
            let o = mirrored * cos + (along * x + across * y) * sin;
            if o.z > 1e-6 {
                sum += (a.cos() - b.cos()) * PI / 180.0 * f(i, o) * o.z;
            }
        }
    }
    sum
}

/// Truth: the law's own integral. A table in the plane of incidence does not say how wide a lobe is across it: of microfacets, whose lobe is not round about the mirrored ray, and of Harvey's
/// law, which is, the stated doubt and 3 % hold it everywhere, with errors up to 8 %; half of the doubts are below 10 %.
#[test]
fn samples_in_one_plane_say_what_they_do_not_see() {
    let plane: Vec<DVec3> = (-178..=178).map(|k| direction(0.5 * f64::from(k), 0.0)).collect();
    let harvey = |w: f64| {
        move |i: DVec3, o: DVec3| {
            0.02 + 0.1 / (w * w + (o.x + i.x).powi(2) + (o.y + i.y).powi(2)).powf(1.1)
        }
    };
    let round = [0.05, 0.2, 0.5].map(harvey);
    let rough = [0.05, 0.1, 0.2, 0.3, 0.5].map(|alpha| ggx(0.5, alpha, alpha, false, 0.1));
    let laws = round.iter().map(|f| f as Truth<'_>).chain(rough.iter().map(|f| f as Truth<'_>));
    let (mut worst, mut doubts, mut beyond) = (0.0_f64, Vec::new(), Vec::new());
    for (k, law) in laws.enumerate() {
        for theta in [10.0, 30.0, 45.0, 60.0, 75.0] {
            let i = direction(theta, 180.0);
            let value: Vec<f64> = plane.iter().map(|o| law(i, *o)).collect();
            let found = Hemisphere::new(i, &plane, &value);
            let off = (found.of(&value) / reflected(law, theta)).ln();
            eprintln!("{k} {theta}: {off:.4}, stated {:.4}", found.ln_doubt);
            beyond.push(off.abs() - found.ln_doubt);
            worst = worst.max(off.abs());
            doubts.push(found.ln_doubt);
        }
    }
    doubts.sort_by(f64::total_cmp);
    assert!(doubts[doubts.len() / 2] < 0.1, "{doubts:?}");
    beyond.sort_by(f64::total_cmp);
    eprintln!("beyond the doubt: {beyond:.3?}");
    assert!(beyond[beyond.len() - 1] < 0.03, "{beyond:?}");
    // So that this means something.
    assert!(worst > 0.08, "{worst}");
}

/// A Zemax file of a law: its azimuths about the mirrored ray and radial angles, with a TIS for each incidence (synthetic).
fn zemax_file(f: Truth<'_>, incidences: &[f64], radials: &[f64], tis: &[f64]) -> zemax::ZemaxBsdf {
    let azimuths: Vec<f64> = (0..=9).map(|k| 20.0 * f64::from(k)).collect();
    let mut value_per_sr = Vec::new();
    for theta in incidences {
        let mirrored = direction(*theta, 0.0);
        let to_normal = direction(*theta - 90.0, 0.0);
        for azimuth in &azimuths {
            for radial in radials {
                let (sin, cos) = radial.to_radians().sin_cos();
                let (y, x) = azimuth.to_radians().sin_cos();
                let o = mirrored * cos + (to_normal * x + DVec3::Y * y) * sin;
                value_per_sr.push(if o.z > 0.02 { f(direction(*theta, 180.0), o) } else { 0.0 });
            }
        }
    }
    zemax::ZemaxBsdf {
        comments: vec!["synthetic".into()],
        source: "Measured".into(),
        plane_symmetrical: true,
        transmitted: false,
        incidence_deg: incidences.to_vec(),
        azimuth_deg: azimuths,
        radial_deg: radials.to_vec(),
        tis: tis.to_vec(),
        value_per_sr,
    }
}

const RADIALS: [f64; 14] =
    [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 45.0, 60.0, 80.0, 100.0];

/// Truth: the law's own integral over 288,000 directions. Narrow lobes in Zemax's grid about the mirrored ray, 0.60 at all incidences: the table's reflectance is that to 6 % (radii that grow
/// by factors of two), at the normal as obliquely, and what the file says is kept in what is written. Samples 5° apart say nothing of a lobe of 1°, and neither the fit nor Zemax's file gets a
/// number then.
#[test]
fn narrow_peaks_out_of_the_plane_are_weighed() {
    let incidences = [0.0, 20.0, 40.0, 60.0];
    for alpha in [0.01, 0.03] {
        let law = ggx(0.5, alpha, alpha, false, 0.1);
        let truth = incidences.map(|theta| reflected(&law, theta));
        let file = zemax_file(&law, &incidences, &RADIALS, &truth);
        let text = zemax::to_string(&file);
        let path = Path::new("made.bsdf");
        let samples =
            exchange::read_bytes(path, text.as_bytes(), Exchange::Zemax, Some(550.0)).unwrap();
        for (theta, truth) in incidences.iter().zip(truth) {
            let rows: Vec<&Sample> =
                samples.rows.iter().filter(|r| r.theta_i_deg == *theta).collect();
            let o: Vec<DVec3> = rows.iter().map(|r| r.directions().1).collect();
            let value: Vec<f64> = rows.iter().map(|r| r.brdf_per_sr[0]).collect();
            let found = Hemisphere::new(direction(*theta, 180.0), &o, &value);
            eprintln!("{alpha} {theta}: {} of {truth}, {}", found.of(&value), found.ln_doubt);
            assert!((found.of(&value) / truth - 1.0).abs() < 0.06 && found.is_resolved());
        }
        let mut options = pointwise();
        options.recipes = vec![recipe(&[Kind::Ggx], Floor::Lambert)];
        let found = fit_surface(&samples, &options, &Silent).unwrap();
        assert!(found.flaws.is_empty() && found.incidences[1].tis == Some(truth[1]));
        assert_eq!(exchange::to_zemax(&samples, 0).unwrap().tis, truth);
        assert!(exchange::other_than_stated(&samples).is_empty());
        // A file whose values are a third of what it says.
        let third = |i: DVec3, o: DVec3| 0.3 * law(i, o);
        let text = zemax::to_string(&zemax_file(&third, &incidences, &RADIALS, &truth));
        let samples =
            exchange::read_bytes(path, text.as_bytes(), Exchange::Zemax, Some(550.0)).unwrap();
        assert_eq!(exchange::other_than_stated(&samples).len(), 4);
        let found = fit_surface(&samples, &options, &Silent).unwrap();
        assert_eq!(found.flaws.iter().filter(|f| matches!(f, Flaw::Tis { .. })).count(), 4);
    }
    let law = ggx(0.5, 0.01, 0.01, false, 0.1);
    let radials: Vec<f64> = (0..20).map(|k| 5.0 * f64::from(k)).collect();
    let text = zemax::to_string(&zemax_file(&law, &incidences, &radials, &[0.6; 4]));
    let path = Path::new("made.bsdf");
    let mut samples =
        exchange::read_bytes(path, text.as_bytes(), Exchange::Zemax, Some(550.0)).unwrap();
    let mut options = pointwise();
    options.recipes = vec![recipe(&[Kind::Ggx], Floor::Lambert)];
    let found = fit_surface(&samples, &options, &Silent).unwrap();
    assert!(found.incidences.iter().all(|i| i.hemispherical_table.is_nan()), "{found:?}");
    samples.meta.shift_remove("tis");
    let error = exchange::to_zemax(&samples, 0).unwrap_err().to_string();
    assert!(error.contains("too far apart"), "{error}");
}

/// Truth: closed forms written from the papers in the tests of single laws. Tolerance: 1 % of parameters without noise (numerical derivatives, a search that ends).
#[test]
fn known_surfaces_are_found() {
    let two = |i: DVec3, o: DVec3| {
        ggx(0.4, 0.05, 0.05, false, 0.0)(i, o) + ggx(0.2, 0.35, 0.35, false, 0.0)(i, o)
    };
    let samples = table(&two, &[8.0, 30.0, 50.0, 68.0], &[180.0], 0.002, 1);
    let mut options = pointwise();
    options.recipes =
        vec![recipe(&[Kind::Ggx, Kind::Ggx], Floor::None), recipe(&[Kind::Ggx], Floor::Lambert)];
    let found = fit_surface(&samples, &options, &Silent).unwrap();
    assert_eq!(found.recipe, options.recipes[0], "{:?}", found.tried);
    let mut alphas: Vec<(f64, f64)> =
        found.numbers.chunks(2).map(|n| (n[1].value, n[0].value)).collect();
    alphas.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (found, truth) in alphas.iter().zip([(0.05, 0.4), (0.35, 0.2)]) {
        assert!((found.0 / truth.0 - 1.0).abs() < 0.01, "{alphas:?}");
        assert!((found.1 / truth.1 - 1.0).abs() < 0.01, "{alphas:?}");
    }
    assert!(found.is_faithful() && found.albedo.iter().all(|a| a.1 <= 1.0));
    // What a scene takes is what was fitted.
    let material = found.surface.material("made").unwrap();
    let (i, o) = (direction(40.0, 0.0), direction(35.0, 170.0));
    let ratio = material.brdf(550.0, i, o) / two(i, o);
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    assert!(found.to_toml("made").contains("[material.doubt]"));

    // A value that lies apart on one side of the mirrored direction is left; what lies apart on both sides is not.
    let mut one = samples.clone();
    let off = one.rows.iter().position(|r| r.theta_i_deg == 50.0 && r.theta_o_deg == 40.0).unwrap();
    one.rows[off].brdf_per_sr[0] *= 5.0;
    let other = fit_surface(&one, &options, &Silent).unwrap();
    assert!(other.outliers >= 1);
    // Lobes have no order.
    let sorted = |fit: &SurfaceFit| {
        let mut all: Vec<f64> = fit.numbers.iter().map(|n| n.value).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    for (a, b) in sorted(&found).iter().zip(sorted(&other)) {
        assert!((a / b - 1.0).abs() < 0.03, "{a} {b}");
    }
}

/// Truth: the fitted material itself, averaged over the instrument's disc point by point (10,000 directions): the closed form by which the fit sees a mirror through a cone is that of a
/// Gaussian of the same second moment. Tolerance: 6 % of energy, 20 % of the peak (that of a Gaussian for a disc whose radius is twice the mirror's half-width across the plane).
#[test]
fn a_mirror_through_a_cone_keeps_its_energy() {
    let mirror =
        |i: DVec3, o: DVec3| beckmann(0.3, 0.004, 0.0)(i, o) + ggx(0.1, 0.3, 0.3, false, 0.0)(i, o);
    // The table is made with a disc of 0.5°, in steps of 0.25° about the mirrored direction.
    let radius = 0.5_f64.to_radians();
    let seen = |i: DVec3, o: DVec3| {
        let (x, y) = o.any_orthonormal_pair();
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 0..400 {
            let r = radius * ((f64::from(k) + 0.5) / 400.0).sqrt();
            let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
            let d = (o + (x * cos + y * sin) * r).normalize();
            sum += mirror(i, d) * d.z;
            count += 1.0;
        }
        sum / count / o.z
    };
    let mut rows = Vec::new();
    for theta_i in [10.0, 35.0, 55.0, 70.0] {
        let mut angles: Vec<f64> = (-40..=40).map(|k| 2.0 * f64::from(k)).collect();
        angles.extend((-12..=12).map(|k| theta_i + 0.25 * f64::from(k)));
        for theta_o in angles {
            rows.push(Sample {
                theta_i_deg: theta_i,
                phi_i_deg: 0.0,
                theta_o_deg: theta_o,
                phi_o_deg: 180.0,
                brdf_per_sr: vec![seen(direction(theta_i, 0.0), direction(theta_o, 180.0))],
                sigma_per_sr: vec![],
            });
        }
    }
    let samples = Samples { wavelength_nm: vec![550.0], rows, ..Samples::default() };
    let mut options = SurfaceOptions::default();
    options.cone = Cone { detector_deg: 0.5, source_deg: 0.0 };
    options.recipes = vec![Recipe { mirror: true, ..recipe(&[Kind::Ggx], Floor::None) }];
    let found = fit_surface(&samples, &options, &Silent).unwrap();
    show(&found);
    let number = |name: &str| found.numbers.iter().find(|n| n.name == name).unwrap().value;
    let (share, g, alpha) = (number("mirror_share"), number("mirror_g"), number("mirror_alpha"));
    assert!((share / 0.3 - 1.0).abs() < 0.06 && g < 0.3, "share {share} g {g}");
    assert!((alpha / 0.004 - 1.0).abs() < 0.12, "{alpha}");
    for i in &found.incidences {
        assert!((i.hemispherical_ratio - 1.0).abs() < 0.06, "{i:?}");
        assert!((i.peak.unwrap().ratio - 1.0).abs() < 0.2, "{i:?}");
    }
}

/// Truth: what the table has. Four values and two azimuths of incidence are refused with the reason.
#[test]
fn tables_that_do_not_suffice_say_why() {
    let lambert = |_: DVec3, _: DVec3| 0.1;
    let said = |samples: &Samples| match fit_surface(samples, &pointwise(), &Silent) {
        Err(FitError::Law { reason, .. }) => reason,
        other => panic!("{other:?}"),
    };
    let mut none = table(&lambert, &[10.0, 40.0], &[180.0], 0.0, 1);
    none.rows.truncate(4);
    assert!(said(&none).contains("no incidence with five values"));
    let mut turned = table(&lambert, &[10.0, 40.0, 60.0], &[180.0], 0.0, 1);
    turned.rows[100].phi_i_deg = 40.0;
    assert!(said(&turned).contains("several azimuths"));
    // A surface that is Lambert to all digits is that, without NaN.
    let lambert = table(&lambert, &[10.0, 40.0, 60.0], &[180.0], 0.0, 1);
    let found = fit_surface(&lambert, &pointwise(), &Silent).unwrap();
    assert_eq!(found.name, "lambert");
    assert!((found.numbers[0].value / (0.1 * PI) - 1.0).abs() < 1e-6);
    assert!(found.incidences.iter().all(|i| i.rms_ln.is_finite() && i.albedo.is_finite()));
}

/// Standard normal numbers (Box and Muller).
fn normals(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    move || {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (2.0 * PI * v).cos()
    }
}

/// A table in the plane of incidence every degree.
fn in_plane(incidences: &[f64], value: &mut dyn FnMut(DVec3, DVec3) -> f64) -> Samples {
    let mut rows = Vec::new();
    for theta_i in incidences {
        for k in -84..=84 {
            let theta_o = f64::from(k);
            rows.push(Sample {
                theta_i_deg: *theta_i,
                phi_i_deg: 0.0,
                theta_o_deg: theta_o,
                phi_o_deg: 180.0,
                brdf_per_sr: vec![value(direction(*theta_i, 0.0), direction(theta_o, 180.0))],
                sigma_per_sr: vec![],
            });
        }
    }
    Samples { wavelength_nm: vec![550.0], rows, ..Samples::default() }
}

/// Truth: the closed forms, 1 % noise: a glint of 1° on a wide lobe and Lambert light, with light from one and from two angles. Tolerance: 10 % of the reflectance, 15 % of the value in the mirrored direction,
/// which is a thousand times that beside it. It is said that the incidences are few, and the doubt of one is wide.
#[test]
fn a_glint_is_kept_with_few_incidences() {
    let law = |i: DVec3, o: DVec3| {
        ggx(0.4, 0.01, 0.01, false, 0.15)(i, o) + ggx(0.2, 0.25, 0.25, false, 0.0)(i, o)
    };
    for incidences in [&[30.0][..], &[30.0, 60.0]] {
        let mut normal = normals(1);
        let samples = in_plane(incidences, &mut |i, o| law(i, o) * (1.0 + 0.01 * normal()));
        let found = fit_surface(&samples, &pointwise(), &Silent).unwrap();
        show(&found);
        let albedo = found.albedo.iter().find(|a| a.0 == 30.0).unwrap().1;
        let truth = reflected(&law, 30.0);
        assert!((albedo / truth - 1.0).abs() < 0.1, "{albedo} {truth}");
        let (i, o) = (direction(30.0, 0.0), direction(30.0, 180.0));
        let none = Cone { detector_deg: 0.0, source_deg: 0.0 };
        let ratio = found.seen(i, o, &none) / law(i, o);
        assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
        let few = found.flaws.iter().any(|f| matches!(f, Flaw::FewIncidences { .. }));
        assert!(few && found.is_faithful(), "{:?}", found.flaws);
        assert!(incidences.len() > 1 || found.doubt.wings_ln >= 1.0);
    }
}

/// Truth: the same surface with light from two azimuths, of which no law of one lobe holds glint and wide lobe together: the fit says that the peak or the reflectance is off, in place of
/// taking the glint for an outlier.
#[test]
fn a_law_of_one_lobe_that_loses_the_glint_says_so() {
    let law = |i: DVec3, o: DVec3| {
        ggx(0.4, 0.01, 0.01, false, 0.15)(i, o) + ggx(0.2, 0.25, 0.25, false, 0.0)(i, o)
    };
    let mut normal = normals(1);
    let mut samples = in_plane(&[30.0], &mut |i, o| law(i, o) * (1.0 + 0.01 * normal()));
    let other = samples.rows.iter().cloned().map(|mut row| {
        row.phi_i_deg += 40.0;
        row.phi_o_deg += 40.0;
        row
    });
    let other: Vec<Sample> = other.collect();
    samples.rows.extend(other);
    let found = fit(&samples, &FitOptions::default()).unwrap();
    assert!(!found.is_faithful() && !found.laws[0].is_faithful, "{:?}", found.laws[0]);
}

/// Truth: the closed form, errors of 1 % and of 0.002 sr⁻¹, two thirds of the diffuse light's 0.0032 sr⁻¹: a tenth of the values is below 0. With that error said, all values count, no number is off
/// by more than three of its standard deviations, and of 15 intervals of 95 % 12 or more hold the truth (13 are below the expectation by one).
#[test]
fn values_around_zero_do_not_bend_the_law() {
    let law = ggx(0.5, 0.1, 0.1, false, 0.01);
    let mut inside = 0;
    for seed in 1..=5 {
        let mut normal = normals(seed);
        let samples = in_plane(&[10.0, 30.0, 50.0, 70.0], &mut |i, o| {
            law(i, o) * (1.0 + 0.01 * normal()) + 0.002 * normal()
        });
        let mut options = pointwise();
        options.recipes = vec![recipe(&[Kind::Ggx], Floor::Lambert)];
        options.additive_per_sr = 0.002;
        let found = fit_surface(&samples, &options, &Silent).unwrap();
        assert_eq!((found.left_out.not_above_zero, found.values), (0, samples.rows.len()));
        for (number, truth) in found.numbers.iter().zip([0.5, 0.1, 0.01]) {
            let interval = number.interval.unwrap();
            eprintln!("{seed} {}: {} in {interval:?}", number.name, number.value);
            inside += u32::from(interval.contains(truth));
            let off = (number.value / truth).ln() / number.sigma_ln.unwrap();
            assert!(off.abs() < 4.0, "{} {off}", number.name);
        }
        // Without, values below 0 are left out, and it is said.
        let mut below = samples.clone();
        below.rows[0].brdf_per_sr[0] = -0.001;
        below.rows[1].brdf_per_sr[0] = 0.0;
        options.additive_per_sr = 0.0;
        let found = fit_surface(&below, &options, &Silent).unwrap();
        assert!(found.left_out.not_above_zero >= 2);
        assert!(found.flaws.iter().any(|f| f.to_string().contains("--additive-per-sr")));
    }
    assert!(inside >= 12, "{inside} of 15");
}

/// Truth: a GGX lobe, which is reciprocal, of 0.1 % noise; at incidences of half degrees, so that directions and their exchange lie 0.5° apart on the flank of a narrow lobe: no fault. The same with the
/// light of one incidence 30 % brighter is none of a reciprocal surface.
#[test]
fn reciprocity_is_judged_at_the_same_directions() {
    let law = ggx(0.5, 0.02, 0.02, false, 0.001);
    let mut normal = normals(3);
    let mut samples =
        in_plane(&[10.5, 14.5, 30.5, 50.5], &mut |i, o| law(i, o) * (1.0 + 0.001 * normal()));
    let mut options = pointwise();
    options.recipes = vec![recipe(&[Kind::Ggx], Floor::Lambert)];
    let said = |samples: &Samples| {
        let found = fit_surface(samples, &options, &Silent).unwrap();
        found.flaws.iter().any(|f| matches!(f, Flaw::NotReciprocal { .. }))
    };
    assert!(!said(&samples));
    for row in samples.rows.iter_mut().filter(|r| r.theta_i_deg == 30.5) {
        row.brdf_per_sr[0] *= 1.3;
    }
    assert!(said(&samples));
}

/// Truth: the closed form below a detector's limit of 20 sr⁻¹. The cut values are left out, it is said, and the roughness is that of the lobe to 5 %; rounding to three digits is no limit.
#[test]
fn saturated_peaks_are_left_out() {
    let law = ggx(0.6, 0.03, 0.03, false, 0.1);
    let mut normal = normals(2);
    let samples = in_plane(&[10.0, 30.0, 50.0, 70.0], &mut |i, o| {
        f64::min(law(i, o) * (1.0 + 0.01 * normal()), 20.0)
    });
    let mut options = pointwise();
    options.recipes = vec![recipe(&[Kind::Ggx], Floor::Lambert)];
    let found = fit_surface(&samples, &options, &Silent).unwrap();
    show(&found);
    let cut = samples.rows.iter().filter(|r| r.brdf_per_sr[0] == 20.0).count();
    assert!(cut > 10 && found.left_out.saturated == cut);
    let said = |f: &Flaw| matches!(f, Flaw::Saturated { per_sr, .. } if *per_sr == 20.0);
    assert!(found.flaws.iter().any(said));
    assert!(notes_of(&samples).contains("f = 20.0000 sr⁻¹ in several directions"));
    assert!((found.numbers[1].value / 0.03 - 1.0).abs() < 0.05, "{:?}", found.numbers);
    // A detector clips its signal, f cos θ_o, here at 8 sr⁻¹ with a converter's noise of 0.05 %: in f the plateau leans.
    let mut converter = normals(3);
    let (mut clipped, mut values) = (0, Vec::new());
    let leaning = in_plane(&[10.0, 30.0, 50.0, 70.0], &mut |i, o| {
        let seen = law(i, o) * o.z * (1.0 + 0.01 * normal());
        clipped += usize::from(seen > 8.0);
        values.push(seen);
        seen.min(8.0) * (1.0 + 5e-4 * converter()) / o.z
    });
    let found = fit_surface(&leaning, &options, &Silent).unwrap();
    let said = |f: &Flaw| matches!(f, Flaw::Saturated { signal: true, .. });
    assert!(found.flaws.iter().any(said), "{:?}", found.flaws);
    // Those that came within the noise of the limit may be left out, too.
    let left_out = found.left_out.saturated;
    let near = values.iter().filter(|v| **v > 8.0 * (1.0 - 6e-3)).count();
    assert!(left_out >= clipped && left_out <= near, "{left_out} {clipped} {near}");
    assert!((found.numbers[1].value / 0.03 - 1.0).abs() < 0.05, "{:?}", found.numbers);
    let wide = ggx(0.6, 0.3, 0.3, false, 0.1);
    let rounded = in_plane(&[10.0, 30.0, 50.0], &mut |i, o| (wide(i, o) * 1e3).round() / 1e3);
    assert_eq!(fit_surface(&rounded, &options, &Silent).unwrap().left_out.saturated, 0);
    assert!(notes_of(&leaning).contains("f cos θ_o = "));
    assert!(!notes_of(&rounded).contains("saturated"));
}

/// Notes on a table that is taken as a material.
fn notes_of(samples: &Samples) -> String {
    let mut text = String::from("# lambda = 550 nm\n# phi_i theta_i phi_o theta_o brdf\n");
    for row in &samples.rows {
        let [i, o] = [[row.phi_i_deg, row.theta_i_deg], [row.phi_o_deg, row.theta_o_deg]];
        // Of one plane the angle goes from 0 and the azimuth says the side.
        let (side, angle) = if o[1] < 0.0 { (o[0] - 180.0, -o[1]) } else { (o[0], o[1]) };
        text += &format!("{} {} {angle} {side} {:?}\n", i[1], i[0], row.brdf_per_sr[0]);
    }
    let file = std::env::temp_dir().join(format!("sunglint_notes_{}.txt", std::process::id()));
    std::fs::write(&file, text).unwrap();
    let read = sunglint_materials::look::read(file.to_str().unwrap(), 550.0).unwrap();
    std::fs::remove_file(&file).unwrap();
    read.notes().join("; ")
}

/// Truth: files that contradict what is asked, and what is meant by their names (synthetic). Another wavelength than the file's is refused; values times the cosine are divided by it; a table whose mirrored
/// ray is at the light's azimuth is noticed; of repeated rows the median is kept.
#[test]
fn files_that_mean_something_else_are_noticed() {
    let path = Path::new("made.txt");
    let text = "# lambda = 532 nm\n# phi_i theta_i phi_o theta_o brdf\n10 0 20 180 0.5\n";
    let read = |nm| exchange::read_bytes(path, text.as_bytes(), Exchange::Columns, nm);
    let error = read(Some(650.0)).unwrap_err().to_string();
    assert!(error.contains("532") && error.contains("650"), "{error}");
    assert_eq!(read(Some(532.0)).unwrap(), read(None).unwrap());

    let text = "NUM_POINTS 1\nVARS theta_i,phi_i,theta_s,phi_s,ccBSDF\n0.5,0,1.0471975511965976,3.14,0.25\n";
    let samples = exchange::read_bytes(path, text.as_bytes(), Exchange::Astm, Some(532.0)).unwrap();
    assert!((samples.rows[0].brdf_per_sr[0] - 0.5).abs() < 1e-12);
    assert!(exchange::warnings(&samples)[0].contains("cosine"));

    let law = ggx(0.5, 0.1, 0.1, false, 0.01);
    let mut samples = in_plane(&[10.0, 30.0, 50.0, 70.0], &mut |i, o| law(i, o));
    assert!(exchange::warnings(&samples).is_empty());
    for row in &mut samples.rows {
        row.phi_o_deg -= 180.0;
    }
    assert!(exchange::warnings(&samples)[0].contains("phi_i_deg + 180"));

    let clean = in_plane(&[10.0, 30.0], &mut |i, o| law(i, o));
    let mut rows = Vec::new();
    for row in &clean.rows {
        let mut wrong = row.clone();
        wrong.brdf_per_sr[0] *= 5.0;
        rows.extend([wrong, row.clone(), row.clone(), row.clone(), row.clone()]);
    }
    let (found, said) = once(Samples { rows, ..clean.clone() });
    let values = |s: &Samples| s.rows.iter().map(|r| r.brdf_per_sr[0]).collect::<Vec<_>>();
    assert_eq!(values(&found), values(&clean));
    assert!(found.rows[0].sigma_per_sr[0] > 0.0 && said.unwrap().contains("338 directions"));
}

/// BRDF of two unit vectors, sr⁻¹.
type Value = Box<dyn Fn(DVec3, DVec3) -> f64>;

/// A made-up surface: its recipe, its BRDF, and its numbers in the order of the recipe.
fn made_up(seed: u64) -> (Recipe, Value, Vec<f64>, f64) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7000 + seed);
    let mut from = |a: f64, b: f64| a * (b / a).powf(rng.random::<f64>());
    let noise = from(0.01, 0.05);
    let (alpha, wide) = (from(0.04, 0.12), from(0.25, 0.5));
    let (s1, s2, rho) = (from(0.1, 0.5), from(0.1, 0.4), from(0.02, 0.3));
    let normal = from(0.04, 0.2);
    let (truth, f, p): (Recipe, Value, Vec<f64>) = match seed % 6 {
        0 => (
            recipe(&[Kind::Ggx], Floor::Lambert),
            Box::new(ggx(s1, alpha, alpha, false, rho)),
            vec![s1, alpha, rho],
        ),
        1 => (
            recipe(&[Kind::Beckmann], Floor::Lambert),
            Box::new(beckmann(s1, alpha, rho)),
            vec![s1, alpha, rho],
        ),
        2 => {
            let (b, g) = (alpha * alpha, 2.0 + 0.5 * s2);
            let a = 0.05 * s1;
            // A share is what the lobe reflects at normal incidence: midpoints in ln x.
            let steps = 20_000;
            let share: f64 = (0..steps)
                .map(|k| {
                    let x = (-20.0 * (f64::from(k) + 0.5) / f64::from(steps)).exp();
                    20.0 / f64::from(steps) * x * TAU * x * a / (b + x.powf(g))
                })
                .sum();
            (
                recipe(&[Kind::Abg], Floor::Lambert),
                Box::new(abg(a, b, g, rho)),
                vec![share, b, g, rho],
            )
        }
        3 => {
            let one = ggx(s1, alpha, alpha, false, 0.0);
            let other = ggx(s2, wide, wide, false, 0.0);
            (
                recipe(&[Kind::Ggx, Kind::Ggx], Floor::None),
                Box::new(move |i, o| one(i, o) + other(i, o)),
                vec![s1, alpha, s2, wide],
            )
        }
        4 => {
            let (one, other) = (beckmann(s1, alpha, 0.0), ggx(s2, wide, wide, false, 0.0));
            (
                recipe(&[Kind::Beckmann, Kind::Ggx], Floor::None),
                Box::new(move |i, o| one(i, o) + other(i, o)),
                vec![s1, alpha, s2, wide],
            )
        }
        _ => (
            Recipe { rise: Rise::Schlick, ..recipe(&[Kind::Ggx], Floor::Lambert) },
            Box::new(ggx(normal, alpha, alpha, true, rho)),
            vec![normal, 1.0, alpha, rho],
        ),
    };
    (truth, f, p, noise)
}

/// Columns: the kind of surface, noise, whether the simplest true recipe was chosen, numbers with an interval, those that it holds, numbers that are none, the errors of ln over their stated
/// standard deviations, and seconds of the processor.
const MADE_UP: [&str; 12] = [
    "kind", "noise", "chosen", "numbers", "inside", "nan", "z1", "z2", "z3", "z4", "values",
    "cpu_s",
];

/// Truth: closed forms written from the papers, errors of 1 to 5 %, of surfaces of one lobe and Lambert light (GGX, Beckmann, ABg, GGX with Schlick's rise) and of two lobes.
///
/// Asked: the stated 95 % intervals hold 92 to 98 % of the numbers, the simplest true recipe is chosen in 90 %, nothing is NaN. Of a part: as many held as a binomial's three standard deviations allow.
#[test]
fn campaign_made_up_surfaces() {
    let mut campaign = Campaign::in_shards("made_up_surfaces", 200, 2, &MADE_UP);
    for seed in campaign.seeds() {
        let (truth, f, p, noise) = made_up(seed);
        let samples = table(&*f, &[10.0, 30.0, 50.0, 65.0], &[180.0, 90.0, 150.0], noise, seed);
        let mut options = pointwise();
        options.most_lobes = 2;
        let before = sunglint_testkit::cpu_s();
        let mut found = fit_surface(&samples, &options, &Silent).unwrap();
        let cpu_s = sunglint_testkit::cpu_s() - before;
        let chosen = found.recipe == truth;
        if !chosen {
            println!("{seed}: {} for {}: {:?}", found.name, truth.name(), &found.tried[..4]);
            options.recipes = vec![truth];
            found = fit_surface(&samples, &options, &Silent).unwrap();
        }
        let mut numbers = found.numbers.clone();
        // Lobes of one kind have no order.
        if seed % 6 == 3 && numbers[1].value > numbers[3].value {
            numbers.rotate_left(2);
        }
        let is = |holds: bool| f64::from(u8::from(holds));
        let mut row = [f64::NAN; MADE_UP.len()];
        (row[0], row[1], row[2]) = ((seed % 6) as f64, noise, is(chosen));
        (row[3], row[4], row[5]) = (0.0, 0.0, 0.0);
        for (k, (number, truth)) in numbers.iter().zip(&p).enumerate() {
            row[5] += is(!number.value.is_finite() || number.sigma_ln.is_some_and(f64::is_nan));
            let Some((interval, sigma)) = number.interval.zip(number.sigma_ln) else { continue };
            row[5] += is(!(interval.low.is_finite() && interval.high.is_finite()));
            row[3] += 1.0;
            row[4] += is(interval.contains(*truth));
            row[6 + k] = (number.value / truth).ln() / sigma;
        }
        (row[10], row[11]) = (found.independent_values, cpu_s);
        println!("seed {seed}: {row:.3?}");
        campaign.keep(seed, &row);
    }
    let sum = |name: &str| campaign.column(name).iter().sum::<f64>();
    let surfaces = campaign.column("kind").len() as f64;
    let (numbers, inside, chosen) = (sum("numbers"), sum("inside"), sum("chosen"));
    let squares = ["z1", "z2", "z3", "z4"].map(|z| campaign.column(z)).concat();
    let squares: Vec<f64> = squares.iter().filter(|z| z.is_finite()).map(|z| z * z).collect();
    let width = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    println!(
        "{inside} of {numbers} inside, errors {width:.3} σ rms, {chosen} of {surfaces} chosen"
    );
    let nan = sum("nan");
    assert_eq!(nan, 0.0);
    let share = inside / numbers;
    if campaign.is_whole() {
        assert!((0.92..=0.98).contains(&share) && chosen >= 0.9 * surfaces, "{share} {chosen}");
    } else {
        let room = 3.0 * (0.05 * 0.95 / numbers).sqrt();
        assert!(share >= 0.95 - room && chosen >= surfaces - 1.0, "{share} {chosen}");
    }
    campaign.largest("numbers_with_an_interval", numbers);
    campaign.largest("outside_95_percent", numbers - inside);
    campaign.largest("another_recipe", surfaces - chosen);
    campaign.largest("not_a_number", nan);
    campaign.finish();
}

/// GGX's lobe of a dielectric and Lambert light, lit by light of which a share is polarised in the plane of incidence and the rest across it: the field's components in and across each facet's own plane of
/// incidence, with Fresnel's amplitudes by Snell's law.
fn in_polarised_light(n: f64, alpha: f64, rho: f64, in_plane: f64) -> impl Fn(DVec3, DVec3) -> f64 {
    let lobe = ggx(1.0, alpha, alpha, false, 0.0);
    move |i, o| {
        let h = (i + o).normalize();
        let cos = i.dot(h);
        let inside = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
        let r_s = (cos - n * inside) / (cos + n * inside);
        let r_p = (n * cos - inside) / (n * cos + inside);
        let s = i.cross(h).normalize();
        let p = s.cross(i);
        let across = DVec3::Z.cross(i).normalize();
        let along = across.cross(i);
        let of = |field: DVec3| (r_s * field.dot(s)).powi(2) + (r_p * field.dot(p)).powi(2);
        lobe(i, o) * (in_plane * of(along) + (1.0 - in_plane) * of(across)) + rho / PI
    }
}

/// Truth: Fresnel's amplitudes for the field on each facet, 2 % noise. A laser's light, most of it polarised in the plane of incidence: the share, the index, the roughness are in their intervals
/// (of four standard deviations), and the material is the one in light without polarisation to 3 %, where what is measured is up to 1.4 times that. Without polarisation none is found; samples in
/// the plane of incidence do not tell it.
#[test]
fn polarised_light_is_told_from_the_surface() {
    let (n, alpha, rho) = (1.5, 0.25, 0.03);
    let plain = in_polarised_light(n, alpha, rho, 0.5);
    let mut options = pointwise();
    options.most_lobes = 1;
    let incidences = [10.0, 30.0, 50.0, 70.0];
    for in_plane in [0.85, 0.5] {
        let law = in_polarised_light(n, alpha, rho, in_plane);
        let samples = table(&law, &incidences, &[180.0, 90.0, 135.0], 0.02, 4);
        let found = fit_surface(&samples, &options, &Silent).unwrap();
        show(&found);
        let rise = if in_plane == 0.5 { Rise::Dielectric } else { Rise::Polarised };
        assert_eq!(found.recipe, Recipe { rise, ..recipe(&[Kind::Ggx], Floor::Lambert) });
        let truth = |name: &str| match name {
            "n" => n,
            "alpha" => alpha,
            "diffuse" => rho,
            "in_plane_share" => in_plane,
            _ => 1.0,
        };
        for number in &found.numbers {
            // The index beyond 1, which is what is reflected, is not a logarithm's own.
            let off = (number.value / truth(number.name)).ln() / number.sigma_ln.unwrap();
            assert!(off.abs() < 4.0, "{number:?}");
        }
        let material = found.surface.material("plain").unwrap();
        let mut apart = 1.0_f64;
        for (a, b, phi) in [(20.0, 60.0, 180.0), (50.0, 60.0, 90.0), (60.0, 60.0, 150.0)] {
            let (i, o) = (direction(a, 0.0), direction(b, phi));
            let ratio = material.brdf(600.0, i, o) / plain(i, o);
            assert!((ratio - 1.0).abs() < 0.03, "{a} {b} {phi}: {ratio}");
            apart = apart.max((law(i, o) / plain(i, o)).ln().abs().exp());
        }
        assert!(in_plane == 0.5 || apart > 1.4, "{apart}");
    }
    let law = in_polarised_light(n, alpha, rho, 0.85);
    let samples = table(&law, &incidences, &[180.0], 0.02, 4);
    let found = fit_surface(&samples, &options, &Silent).unwrap();
    assert!(found.tried.iter().all(|t| !t.recipe.contains("polarised")), "{}", found.name);
}

fn real(file: &str) -> Option<PathBuf> {
    shared(&format!("real/{file}"))
}

/// Truth: GGX over Lambert (synthetic), once measured to 80° and once to 60° only. Where no sample is grazing, nothing tells how far off the law is there: at least a factor of e.
#[test]
fn regions_without_samples_are_doubtful() {
    let law = ggx(0.4, 0.2, 0.2, false, 0.1);
    let mut samples = table(&law, &[10.0, 30.0, 45.0, 60.0], &[180.0], 0.02, 5);
    let mut options = pointwise();
    options.recipes = vec![recipe(&[Kind::Ggx], Floor::Lambert)];
    let whole = fit_surface(&samples, &options, &Silent).unwrap();
    assert!(whole.rms_ln.grazing.is_some() && whole.doubt.grazing_ln < 0.5, "{:?}", whole.doubt);
    samples.rows.retain(|row| row.theta_o_deg.abs() <= 60.0);
    let part = fit_surface(&samples, &options, &Silent).unwrap();
    assert!(part.rms_ln.grazing.is_none() && part.doubt.grazing_ln >= 1.0, "{:?}", part.doubt);
    assert!(part.doubt.wings_ln < 0.5, "{:?}", part.doubt);
}

/// Truth: the measured values. Solar array and chassis of a Starlink satellite (532 nm) and a black coat (650 nm); the figures are those that
/// the issue asks for.
#[test]
fn real_surfaces_are_fitted() {
    let name = "real_surfaces_are_fitted";
    for (file, nm, most_rms) in [
        ("starlink_solar_array_brdf_532nm.csv", None, 0.24),
        ("starlink_chassis_brdf_532nm.csv", None, 0.25),
        ("fred_zemax/AnoBlackEC1onAlum.fred.txt", Some(650.0), 0.10),
    ] {
        let Some(path) = real(file) else {
            return skip(name, "no shared/real beside the checkout");
        };
        let (samples, _) = read::samples(&path, nm).unwrap();
        let mut options = SurfaceOptions::default();
        options.floor_per_sr = Some(1e-4);
        let found = fit_surface(&samples, &options, &Silent).unwrap();
        eprintln!("{file}");
        show(&found);
        assert!(found.rms_ln.all <= most_rms, "{file}: {}", found.rms_ln.all);
        assert!(found.albedo.iter().all(|a| a.1 <= 1.0 + 1e-6), "{:?}", found.albedo);
        // Inner incidences that were left out: the median half-width over all their samples is at most twice what these are off by, rms.
        let inner = || found.incidences.iter().filter_map(|i| Some((i.values as f64, i.unseen?)));
        let inner = || inner().filter(|(_, unseen)| !unseen.extrapolated);
        let count: f64 = inner().map(|(n, _)| n).sum();
        let square: f64 = inner().map(|(n, u)| n * u.rms_ln * u.rms_ln).sum();
        let rms = (square / count).sqrt();
        let half = sunglint_numerics::order::median(inner().map(|(_, u)| u.half_width_ln)).unwrap();
        eprintln!("{file}: left out {rms:.3} rms, half-width {half:.3}");
        assert!(half <= 2.0 * rms, "{file}: {half} {rms}");
        for i in &found.incidences {
            // A table that is too coarse for its peak may gain by that alone.
            let gains = i.hemispherical_table * (-i.hemispherical_ln_doubt).exp() > 0.95;
            // Samples beside a peak of a tenth of a degree do not tell what it holds, which is said.
            let unknown = i.hemispherical_table.is_nan() && i.hemispherical_ln_doubt > 1.0;
            let beside = unknown && i.peak.unwrap().off_deg > 0.3;
            let doubted = i.hemispherical_table > 0.95 || beside;
            let (e, p) = if doubted { (0.25, 0.40) } else { (0.10, 0.25) };
            let p = if i.theta_i_deg == 70.0 { 0.35 } else { p };
            assert!((i.hemispherical_ratio - 1.0).abs() <= e, "{file}: {i:?}");
            assert!((i.peak.unwrap().ratio - 1.0).abs() <= p, "{file}: {i:?}");
            let said = found.flaws.iter().any(|f| {
                matches!(f, Flaw::TableGains { theta_i_deg, .. } if *theta_i_deg == i.theta_i_deg)
            });
            assert_eq!(gains, said);
            let unseen = i.unseen.unwrap();
            if !unseen.extrapolated {
                assert!(unseen.inside >= 0.9, "{file}: {unseen:?}");
                assert!(unseen.half_width_ln <= 2.5 * unseen.rms_ln, "{file}: {unseen:?}");
            }
        }
        // The simulator's material is the law: off the peak pointwise, reciprocal everywhere.
        let material = found.surface.material("real").unwrap();
        for (a, b, phi) in [(20.0, 60.0, 180.0), (41.0, 10.0, 90.0), (75.0, 50.0, 150.0)] {
            let (i, o) = (direction(a, 0.0), direction(b, phi));
            let (there, back) = (material.brdf(600.0, i, o), material.brdf(600.0, o, i));
            assert!((there / back - 1.0).abs() < 1e-12, "{there} {back}");
            // What is seen in polarised light is another.
            let law = found.seen(i, o, &Cone { detector_deg: 0.0, source_deg: 0.0 });
            let is_plain = found.recipe.rise != Rise::Polarised;
            assert!(!is_plain || (there / law - 1.0).abs() < 1e-9, "{there} {law}");
        }
    }
}

/// Truth: the measured values of two tables of Zemax: the black coat again, and brown vinyl; the figures of docs/lab-laws.md, rounded up.
#[test]
fn tables_of_zemax_are_fitted() {
    for (file, most_rms) in [("AnoBlackEC1onAlum", 0.12), ("BrownVinyl", 0.23)] {
        let Some(path) = real(&format!("fred_zemax/{file}.zemax.bsdf")) else {
            return skip("tables_of_zemax_are_fitted", "no shared/real beside the checkout");
        };
        let (samples, _) = read::samples(&path, Some(650.0)).unwrap();
        let found = fit_surface(&samples, &SurfaceOptions::default(), &Silent).unwrap();
        eprintln!("{file} {:?}", found.numbers);
        show(&found);
        assert!(found.rms_ln.all <= most_rms, "{file}: {}", found.rms_ln.all);
        for i in &found.incidences {
            assert!((i.hemispherical_ratio - 1.0).abs() <= 0.10, "{file}: {i:?}");
            assert!((i.peak.unwrap().ratio - 1.0).abs() <= 0.25, "{file}: {i:?}");
        }
    }
}

/// Truth: a black coat measured once, as FRED's and as Zemax's table (ua-loft/bsdf-tools). Tolerance: 0.15 rms in ln f, which is what the interpolation between both grids gives there (0.07
/// to 0.14 found with numpy); with Zemax's azimuth the other way it would be 0.3 to 0.6.
#[test]
fn fred_and_zemax_say_the_same() {
    let name = "fred_and_zemax_say_the_same";
    let (Some(f), Some(z), Some(vinyl)) = (
        real("fred_zemax/AnoBlackEC1onAlum.fred.txt"),
        real("fred_zemax/AnoBlackEC1onAlum.zemax.bsdf"),
        real("fred_zemax/BrownVinyl.zemax.bsdf"),
    ) else {
        return skip(name, "no shared/real beside the checkout");
    };
    assert_eq!(read::exchange_format(&f), Some(Exchange::Fred));
    assert_eq!(read::exchange_format(&z), Some(Exchange::Zemax));
    let (fred_samples, _) = read::samples(&f, Some(650.0)).unwrap();
    let (zemax_samples, _) = read::samples(&z, Some(650.0)).unwrap();
    let turned = |r: &Sample| {
        let (i, o) = r.directions();
        turned(i, o).1
    };
    for theta in [10.0, 30.0, 50.0, 70.0] {
        let of = |s: &Samples| -> Vec<(DVec3, f64)> {
            let rows = s.rows.iter().filter(|r| r.theta_i_deg == theta);
            rows.map(|r| (turned(r), r.brdf_per_sr[0])).collect()
        };
        let (a, b) = (of(&fred_samples), of(&zemax_samples));
        let (mut sum, mut count) = (0.0, 0.0);
        for (o, value) in &a {
            let best = b.iter().map(|(p, v)| (o.angle_between(*p), v));
            let (off, near) = best.min_by(|x, y| x.0.total_cmp(&y.0)).unwrap();
            if off < 2.5_f64.to_radians() {
                sum += (value / near).ln().powi(2);
                count += 1.0;
            }
        }
        let rms = f64::sqrt(sum / count);
        eprintln!("{theta}: {rms:.3} over {count}");
        assert!(count > 60.0 && rms < 0.2, "{theta}: {rms}");
    }
    // What is written reads the same to 1e-6, with no digit lost in the file's own form.
    for path in [&z, &vinyl] {
        let text = std::fs::read_to_string(path).unwrap();
        let file = zemax::read_str(path, &text).unwrap();
        assert_eq!(zemax::read_str("x", &zemax::to_string(&file)).unwrap(), file);
        let samples =
            exchange::read_bytes(path, text.as_bytes(), Exchange::Zemax, Some(650.0)).unwrap();
        let written = exchange::to_zemax(&samples, 0).unwrap();
        let again = exchange::read_bytes(
            Path::new("x"),
            zemax::to_string(&written).as_bytes(),
            Exchange::Zemax,
            Some(650.0),
        )
        .unwrap();
        assert_eq!(samples.rows.len(), again.rows.len());
        for (a, b) in samples.rows.iter().zip(&again.rows) {
            let (x, y) = (a.directions().1, b.directions().1);
            assert!((x - y).length() < 1e-6, "{a:?} {b:?}");
            assert!((a.brdf_per_sr[0] / b.brdf_per_sr[0] - 1.0).abs() < 1e-12);
        }
    }
    let text = std::fs::read_to_string(&f).unwrap();
    let file = fred::read_str(&f, &text).unwrap();
    assert_eq!(fred::read_str("x", &fred::to_string(&file)).unwrap(), file);
    assert_eq!(exchange::to_fred(&fred_samples, 0), file);
    let error = exchange::to_zemax(&fred_samples, 0).unwrap_err();
    assert!(error.to_string().contains("write FRED's"), "{error}");
}

/// Files that are cut off or of a format that is not read say so, and name the formats that are (synthetic).
#[test]
fn files_that_cannot_be_read_say_what_can() {
    let folder = std::env::temp_dir().join(format!("sunglint-foreign-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let message = |name: &str, content: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, content).unwrap();
        read::samples(&path, Some(550.0)).unwrap_err().to_string()
    };
    let mut merl: Vec<u8> = [90_i32, 90, 180].iter().flat_map(|n| n.to_le_bytes()).collect();
    merl.extend((0..125).flat_map(|k| (0.1 + f64::from(k)).to_le_bytes()));
    let utia: Vec<u8> = (0..500).flat_map(|k| (0.1 + f64::from(k)).to_le_bytes()).collect();
    let mitsuba = "<scene version=\"3.0.0\"><bsdf type=\"roughconductor\"/></scene>\n";
    for (name, content, said) in [
        ("merl.binary", &merl[..], "1012 bytes, expected 34992012 for [90, 90, 180] cells"),
        ("utia.bin", &utia, "4000 bytes, expected 1990656"),
        ("a.xml", mitsuba.as_bytes(), "MERL"),
        ("a.ssdd", b"VERSION 0.2\n\nDATA_TYPE brdf\nDATA ascii\n0.3183\n", "FRED, Zemax, ASTM"),
        (
            "lt.bsdf",
            b"# LightTools\nAOI 0\nPOI 0\nWavelength 550\n0 0 0.159\n",
            "FRED, Zemax, ASTM",
        ),
        ("a.dat", b"ABG 2\nbrown_vinyl\n0 0.0\n1 1.5e-1 1.2e-2 1.5\n", "FRED, Zemax, ASTM"),
        ("a.bin", &[0xff, 0xfe, 0x00, 0x81], "FRED, Zemax, ASTM"),
    ] {
        let message = message(name, content);
        assert!(message.contains(said), "{message}");
    }
    // What is wrong with a table of our own is its own.
    let own = message("a.csv", b"theta_i_deg,phi_i_deg,theta_o_deg,brdf_550nm_per_sr\n0,0,1,2\n");
    assert!(own.contains("phi_o_deg") && !own.contains("FRED"), "{own}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A lobe about the mirrored ray, 1/sr.
fn lobe(radial_deg: f64) -> f64 {
    3.0 * (-(radial_deg / 8.0).powi(2)).exp() + 0.1
}

/// A table on a grid about the mirrored ray, whose angles are rounded. By the triangle of normal, mirrored ray and direction.
fn lobe_table(decimals: i32, jitter_deg: f64) -> Samples {
    let unit = 10.0_f64.powi(decimals);
    let round = |rad: f64| (rad.to_degrees() * unit).round() / unit;
    let mut rows = Vec::new();
    for theta in [0.0_f64, 10.0, 37.5] {
        for radial in LOBE_RADIALS {
            for azimuth in (0..360).step_by(30).map(f64::from) {
                let off = jitter_deg * (7.0 * azimuth + 13.0 * radial + theta).sin();
                let (t, r) = (theta.to_radians(), (radial + off).to_radians());
                let a = (azimuth + 3.0 * off).to_radians();
                let cos_o = t.cos() * r.cos() + t.sin() * r.sin() * a.cos();
                let o = cos_o.clamp(-1.0, 1.0).acos();
                let phi = match theta {
                    0.0 => a,
                    _ => (r.sin() * a.sin() * t.sin()).atan2(r.cos() - t.cos() * cos_o),
                };
                rows.push(Sample {
                    theta_i_deg: theta,
                    phi_i_deg: 0.0,
                    theta_o_deg: round(o),
                    phi_o_deg: 180.0 + round(phi),
                    brdf_per_sr: vec![lobe(radial)],
                    sigma_per_sr: Vec::new(),
                });
            }
        }
    }
    let mut meta = sunglint_formats::Meta::new();
    meta.insert("tis".into(), serde_json::json!([[0.0, 0.5], [10.0, 0.5], [37.5, 0.5]]));
    Samples { wavelength_nm: vec![550.0], rows, meta }
}

const LOBE_RADIALS: [f64; 8] = [0.0, 0.1, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0];

/// Truth: the lobe's formula. Values are those of the formula to 1e-6 (their places are known to 1e-4°, which is 1e-5 of the values at most, but they are stored beside the grid's own angles).
#[test]
fn a_grid_of_rounded_angles_is_written_for_zemax() {
    for decimals in [4, 8] {
        let file = exchange::to_zemax(&lobe_table(decimals, 0.0), 0).unwrap();
        assert_eq!(file.incidence_deg, [0.0, 10.0, 37.5]);
        let near = |found: &[f64], expected: &[f64], most: f64| {
            assert_eq!(found.len(), expected.len(), "{found:?}");
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < most), "{found:?}");
        };
        near(&file.radial_deg, &LOBE_RADIALS, 1e-4);
        assert_eq!(file.azimuth_deg, [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0]);
        let expected = LOBE_RADIALS.map(lobe).repeat(3 * 7);
        near(&file.value_per_sr, &expected, 1e-6);
    }
    // What lies about no grid is none, and its count is that of the table.
    let error = exchange::to_zemax(&lobe_table(8, 0.3), 0).unwrap_err().to_string();
    assert!(error.contains("no grid") && error.contains("write FRED's"), "{error}");
}

/// Truth: f = 2 e^(−radial/15°) (synthetic), measured in the plane of incidence every 5°; of two incidences that are 2.5° off each other no angle about the mirrored ray is the other's. Places between measured ones are on
/// the straight line of ln f, which is the law itself, to 1e-6; beyond the last one there is 0; the comment counts them.
#[test]
fn zemax_files_have_no_holes_between_measured_angles() {
    let law = |radial_deg: f64| 2.0 * (-radial_deg / 15.0).exp();
    let mut rows = Vec::new();
    for theta in [20.0, 42.5, 60.0] {
        for theta_o in (-80..=80).step_by(5).map(f64::from) {
            rows.push(Sample {
                theta_i_deg: theta,
                phi_i_deg: 180.0,
                theta_o_deg: theta_o,
                phi_o_deg: 0.0,
                brdf_per_sr: vec![law((theta_o - theta).abs())],
                sigma_per_sr: Vec::new(),
            });
        }
        // The mirrored ray itself, so that no place beside it lies beyond the first.
        let seen = Sample { theta_o_deg: theta, brdf_per_sr: vec![law(0.0)], ..rows[0].clone() };
        if theta == 42.5 {
            rows.push(Sample { theta_i_deg: theta, ..seen });
        }
    }
    let mut meta = sunglint_formats::Meta::new();
    meta.insert("tis".into(), serde_json::json!([[20.0, 0.5], [42.5, 0.5], [60.0, 0.5]]));
    let samples = Samples { wavelength_nm: vec![550.0], rows, meta };
    let file = exchange::to_zemax(&samples, 0).unwrap();
    let (azimuths, radials) = (file.azimuth_deg.len(), file.radial_deg.len());
    assert_eq!(file.azimuth_deg, [0.0, 180.0]);
    let mut at_0 = 0;
    for (t, theta) in file.incidence_deg.iter().enumerate() {
        for (a, azimuth) in file.azimuth_deg.iter().enumerate() {
            // The azimuth 0 leads through the normal to the side that the light comes from.
            let most = if *azimuth == 0.0 { 80.0 + theta } else { 80.0 - theta };
            for (r, radial) in file.radial_deg.iter().enumerate() {
                let value = file.value_per_sr[(t * azimuths + a) * radials + r];
                if *radial <= most + 1e-6 {
                    assert!((value / law(*radial) - 1.0).abs() < 1e-6, "{theta} {radial} {value}");
                } else {
                    assert_eq!(value, 0.0);
                    at_0 += 1;
                }
            }
        }
    }
    assert!(at_0 > 10 && file.comments[1].contains("were not measured"), "{:?}", file.comments);
}

/// Truth: GGX 0.2 over Lambert from the formula (synthetic). What the written tensor file gives at the samples is as far from them as is said, and 95 of 100 are within 4 %; it is
/// asked of the samples' formula, not of the table that was written. Mitsuba evaluates files of the same writer in other tests.
#[test]
fn tensor_files_say_how_well_they_give_the_samples() {
    let law = ggx(0.4, 0.2, 0.2, false, 0.1);
    let samples = table(&law, &[0.0, 15.0, 30.0, 45.0, 60.0, 75.0], &[180.0, 90.0, 45.0], 0.0, 3);
    let made = exchange::to_rgl(&samples).unwrap();
    let read = sunglint_simulator::surface::measured::material("m", "m.bsdf", &made.file).unwrap();
    let mut off: Vec<f64> = Vec::new();
    for row in &samples.rows {
        let (i, o) = row.directions();
        off.push((read.brdf(550.0, i, o) / law(i, o)).ln().abs());
    }
    off.sort_by(f64::total_cmp);
    let most = off[off.len() * 95 / 100];
    eprintln!("{made:?}", made = (made.compared, made.median_ln, made.most_ln));
    assert!(made.compared == off.len() && (most / made.most_ln - 1.0).abs() < 0.05, "{most}");
    assert!(most < 0.04, "{most}");
}

/// Truth: f cos θ_o of a Lambert surface (synthetic): its largest value is at the same angle from the normal on both sides, for every incidence, and no detector was at its end.
#[test]
fn values_alike_at_one_angle_from_the_normal_are_no_saturation() {
    let mut samples = lobe_table(8, 0.0);
    samples.rows.clear();
    for theta in [0.0, 15.0, 30.0, 45.0] {
        for o in (-8..9_i32).filter(|o| *o != 0).map(|o| 10.0 * f64::from(o)) {
            samples.rows.push(Sample {
                theta_i_deg: theta,
                phi_i_deg: 0.0,
                theta_o_deg: o.abs(),
                phi_o_deg: if o > 0.0 { 180.0 } else { 0.0 },
                brdf_per_sr: vec![0.5 / PI * o.to_radians().cos()],
                sigma_per_sr: Vec::new(),
            });
        }
    }
    let found = fit_surface(&samples, &SurfaceOptions::default(), &Silent).unwrap();
    assert_eq!(found.left_out.saturated, 0);
}

/// Truth: the numbers that the text holds, in degrees (synthetic; the layout is libbsdf's). The mirrored light is at the light's azimuth + 180° in both. Of two wavelengths one has to be said.
#[test]
fn astm_tables_are_recognised() {
    let text = "NUM_POINTS 2\nVARS theta_i,phi_i,theta_s,phi_s,532nm,650nm\n0.5,0,0.5,3.141592653589793,12.5,10\n0.5,0,0.25,0,0.1,0.2\n";
    assert_eq!(Exchange::of(text.as_bytes()), Some(Exchange::Astm));
    let path = Path::new("made.astm");
    let read = |nm| exchange::read_bytes(path, text.as_bytes(), Exchange::Astm, nm);
    let samples = read(Some(650.0)).unwrap();
    let row = &samples.rows[0];
    assert_eq!((samples.wavelength_nm[0], row.brdf_per_sr[0]), (650.0, 10.0));
    let (i, o) = row.directions();
    assert!((o - DVec3::new(-i.x, -i.y, i.z)).length() < 1e-12 && row.theta_i_deg > 28.6);
    for nm in [None, Some(600.0)] {
        let message = read(nm).unwrap_err().to_string();
        assert!(message.contains("532nm, 650nm"), "{message}");
    }
}
