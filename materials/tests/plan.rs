//! Plans: incident elevations and outgoing directions against closed forms, a rig's reach.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};
use sunglint_materials::ndf::{Ndf, NdfOptions, extract};
use sunglint_materials::plan::{PlanError, PlanOptions, Rig, plan, to_table};
use sunglint_materials::table::{Reading, RetroFlags, RetroTable};

/// GGX in closed form (Walter et al. 2007), F₀ = 1: retro-reflection along an azimuth.
fn f(alpha: [f64; 2], theta: f64, phi: f64) -> f64 {
    let [x, y] = alpha;
    let tan2 = theta.tan().powi(2);
    let across = (phi.cos() / x).powi(2) + (phi.sin() / y).powi(2);
    let along = (phi.cos() * x).powi(2) + (phi.sin() * y).powi(2);
    let density = 1.0 / (PI * x * y * (theta.cos().powi(2) * (1.0 + tan2 * across)).powi(2));
    density * 2.0 / (1.0 + (1.0 + along * tan2).sqrt()) / (4.0 * theta.cos().powi(2))
}

fn ndf(alpha: [f64; 2]) -> Ndf {
    let azimuths: &[f64] =
        if alpha[0] == alpha[1] { &[0.0] } else { &[0.0, 30.0, 60.0, 90.0, 120.0, 150.0] };
    let mut readings = Vec::new();
    for azimuth_deg in azimuths {
        for k in 0..151 {
            let angle_deg = -10.0 + 0.5 * f64::from(k);
            let f_per_sr = f(alpha, angle_deg.to_radians(), azimuth_deg.to_radians());
            let flags = RetroFlags::empty();
            readings.push(Reading {
                angle_deg,
                azimuth_deg: *azimuth_deg,
                f_per_sr,
                sigma_f_per_sr: 0.0,
                flags,
            });
        }
    }
    let run = RetroTable { readings, ..RetroTable::default() };
    extract(&run, &NdfOptions { resamplings: 0, ..NdfOptions::default() }).unwrap()
}

/// Truth: a narrow lobe's σ is cosθ: ∫ cos(π u²/2) du, Fresnel's integral, is cut into equal parts. Tolerance 1e-3 of it, as α = 0.02 differs from 0.
#[test]
fn incident_elevations_of_a_narrow_lobe() {
    let made = plan(&ndf([0.02; 2]), &PlanOptions::default()).unwrap();
    let fresnel = |u: f64| {
        let n = 4000;
        let at = |k: i32| (FRAC_PI_2 * (u * (f64::from(k) + 0.5) / f64::from(n)).powi(2)).cos();
        (0..n).map(at).sum::<f64>() * u / f64::from(n)
    };
    let u = |theta: f64| (theta / FRAC_PI_2).sqrt();
    let whole = fresnel(u(89.9_f64.to_radians()));
    for (j, theta) in made.theta_i_rad.iter().enumerate() {
        assert!((fresnel(u(*theta)) / whole - j as f64 / 7.0).abs() < 1e-3, "{j}: {theta}");
    }
    assert!((made.theta_i_rad[7].to_degrees() - 89.9).abs() < 1e-9);
    // A wide lobe is seen from the horizon too: its elevations are spread further out.
    let wide = plan(&ndf([0.6; 2]), &PlanOptions::default()).unwrap();
    assert!((1..7).all(|j| wide.theta_i_rad[j] > made.theta_i_rad[j]));
}

/// Truth: from the normal, GGX's part of visible normals within θ is tan²θ/(α² + tan²θ) (∫ D cosθ dω). Tolerance 4e-3: 128 nodes between which the
/// density is linear.
#[test]
fn outgoing_directions_from_the_normal() {
    let alpha = 0.3;
    let options = PlanOptions { wide: 0.0, ..PlanOptions::default() };
    let made = plan(&ndf([alpha; 2]), &options).unwrap();
    for cell in made.cells.iter().filter(|c| c.index[1] == 0) {
        let half = 0.5 * cell.outgoing.z.clamp(-1.0, 1.0).acos();
        let part = half.tan().powi(2) / (alpha * alpha + half.tan().powi(2));
        assert!((part - cell.u[0]).abs() < 4e-3, "{:?}: {part}", cell.u);
        let phi = (2.0 * cell.u[1] - 1.0) * PI;
        let across = DVec3::new(phi.cos(), phi.sin(), 0.0);
        if half > 0.01 && cell.outgoing.z > 0.0 {
            assert!(cell.outgoing.truncate().normalize().dot(across.truncate()) > 0.9999);
        }
    }
}

/// Truth: geometry. Every cell above the horizon has its measurement, in its direction; a direction is measured once, and of an isotropic sample each with its mirror image (to 0.01°), all
/// around where the light comes along the normal; the way is shorter than row by row.
#[test]
fn a_plan_over_the_hemisphere() {
    for (alpha, azimuths) in [([0.1, 0.1], 1), ([0.1, 0.3], 5)] {
        let options = PlanOptions { theta_i: 4, phi_i: 5, side: 12, ..PlanOptions::default() };
        let made = plan(&ndf(alpha), &options).unwrap();
        assert_eq!(made.cells.len(), azimuths * 4 * 144);
        let mut used = vec![false; made.steps.len()];
        for cell in &made.cells {
            assert_eq!(cell.step.is_some(), cell.outgoing.z > 1e-6);
            if let Some(step) = cell.step {
                used[step] = true;
                let step = made.steps[step];
                let (o, p) = (cell.outgoing, step.outgoing);
                let along = p - o;
                let mirrored = glam::DVec3::new(p.x, -p.y, p.z) - o;
                let around = (p.x.hypot(p.y) - o.x.hypot(o.y)).hypot(p.z - o.z);
                if azimuths > 1 {
                    assert!(along.length() < 1e-5);
                } else if step.incident[1] == 0 {
                    assert!(around < 3e-4 && p.y == 0.0);
                } else {
                    assert!(along.length().min(mirrored.length()) < 3e-4 && p.y >= 0.0);
                }
                assert_eq!(step.incident[..], cell.index[..2]);
            }
        }
        assert!(used.iter().all(|u| *u));
        // From the normal the first column and one of two equal rows at the ends of the circle are single directions.
        let first = made.steps.iter().filter(|s| s.incident == [0, 0]).count();
        let most = if azimuths > 1 { 11 * 11 + 1 } else { 12 };
        assert!(first <= most, "{first}");
        let cells = made.cells.iter().filter(|c| c.step.is_some()).count() as f64;
        let steps = made.steps.len() as f64;
        // Before, each direction was measured: 0.94 and more of the cells.
        assert!(azimuths > 1 || steps / cells < 0.5, "{steps} of {cells}");
        assert!(made.travel_deg < 0.7 * made.unordered_travel_deg, "{}", made.travel_deg);
        let table = to_table(&made);
        assert_eq!((table.rows(), table.meta_text("kind")), (made.cells.len(), Some("brdf_plan")));
    }
}

/// Truth: what the rig is said to reach.
#[test]
fn a_rig_in_its_plane() {
    let rig = Rig::default();
    let made = plan(&ndf([0.1; 2]), &PlanOptions::of_rig(rig)).unwrap();
    assert!(made.theta_i_rad.iter().all(|t| *t <= 55_f64.to_radians() + 1e-12));
    let mut seen = Vec::new();
    for step in &made.steps {
        let [i, o] = step.marks_deg.unwrap();
        assert!(
            i.fract() == 0.0 && o.fract() == 0.0 && (0.0..=55.0).contains(&i) && o.abs() <= 89.0
        );
        assert!((i + o).abs() >= 30.0, "{i} {o}");
        assert!(!seen.contains(&[i, o]));
        seen.push([i, o]);
        // The light is at φ = 0: the detector opposite it at a positive angle.
        let expected = DVec3::new(-o.to_radians().sin(), 0.0, o.to_radians().cos());
        assert!((step.outgoing - expected).length() < 1e-9);
    }
    for cell in &made.cells {
        let Some(step) = cell.step else { continue };
        let is_in_plane = [0, 16, 32].contains(&cell.index[2]);
        let off = made.steps[step].outgoing.angle_between(cell.outgoing).to_degrees();
        assert!((is_in_plane || cell.index[3] == 0) && off < 0.51, "{:?} {off}", cell.index);
    }
    // From one end to the other, then back.
    let deg = |s: &sunglint_materials::plan::Step| s.marks_deg.unwrap()[1];
    for pair in made.steps.chunk_by(|a, b| a.incident == b.incident) {
        let up = pair.windows(2).all(|p| deg(&p[0]) < deg(&p[1]));
        let down = pair.windows(2).all(|p| deg(&p[0]) > deg(&p[1]));
        assert!(up || down);
    }
}

#[test]
fn what_cannot_be_planned_is_refused() {
    let ndf = ndf([0.2; 2]);
    let wrong = |options: PlanOptions, words: &str| {
        let error = plan(&ndf, &options).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        error
    };
    let rig = Rig::default();
    wrong(PlanOptions { side: 32, ..PlanOptions::of_rig(rig) }, "side: found 32, expected an odd");
    wrong(PlanOptions { theta_i: 1, ..PlanOptions::default() }, "theta_i: found 1");
    wrong(PlanOptions { most_theta_i_deg: 90.0, ..PlanOptions::default() }, "below 90°");
    wrong(PlanOptions { wide: 1.0, ..PlanOptions::default() }, "wide: found 1");
    let blind = Rig { least_phase_deg: 179.0, ..rig };
    let error = wrong(PlanOptions::of_rig(blind), "the rig reaches none of");
    assert!(matches!(error, PlanError::Unreachable { .. }));
}

/// Truth: geometry, arithmetic. Plans of few measurements have so many, all of them of the plan that they were chosen from and within the bench's reach; the fewer are among the more. They lie as the lobe does:
/// half of the normals that they mirror at are tilted by less than four times the lobe's own width, tan⁻¹α (spread over all directions alike by less than 45°). Their time is that of settling and readings at least.
#[test]
fn a_plan_of_few_measurements() {
    use sunglint_formats::toml::Document;
    use sunglint_materials::goniometer::bench::{Bench, USUAL_BENCH};
    use sunglint_materials::goniometer::budget::{Budget, within_budget};
    use sunglint_numerics::progress::Silent;
    let bench = Bench::new(&Document::new("bench", USUAL_BENCH).unwrap(), Some("")).unwrap();
    let mut middle = Vec::new();
    for alpha in [0.05, 0.15, 0.4] {
        let ndf = ndf([alpha; 2]);
        let pool = plan(&ndf, &PlanOptions::to_choose_from(85.0)).unwrap();
        let of = |budget| within_budget(&pool, &ndf, &bench, budget, &Silent);
        let many = of(Budget::Directions(120)).unwrap();
        let few = of(Budget::Directions(60)).unwrap();
        assert_eq!((few.steps.len(), many.steps.len()), (60, 120));
        for step in &few.steps {
            assert!(many.steps.contains(step) && pool.steps.contains(step));
        }
        let mut tilts = Vec::new();
        for one in many.planned() {
            assert!(one.theta_o_deg <= 85.0 && one.theta_i_deg <= 85.0, "{one:?}");
            let unit = |theta: f64, phi: f64| {
                let (theta, phi) = (theta.to_radians(), phi.to_radians());
                DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
            };
            let (i, o) =
                (unit(one.theta_i_deg, one.phi_i_deg), unit(one.theta_o_deg, one.phi_o_deg));
            assert!(i.angle_between(o).to_degrees() >= 5.0 - 1e-6, "{one:?}");
            tilts.push((i + o).normalize().z.acos().to_degrees());
        }
        tilts.sort_by(f64::total_cmp);
        middle.push(tilts[60]);
        let table = to_table(&many);
        let (read, _) =
            sunglint_materials::plan::planned(std::path::Path::new("plan.ecsv"), &table).unwrap();
        assert_eq!(read.len(), 120);
        for (a, b) in read.iter().zip(many.planned()) {
            let off = (a.theta_i_deg - b.theta_i_deg).hypot(a.theta_o_deg - b.theta_o_deg);
            assert!(a.step == b.step && off < 0.02, "{a:?} {b:?}");
        }
        let times = many.chosen.unwrap().times.unwrap();
        // Two looks more than each 50th direction, settling and five readings are 1.25 s.
        assert!((4..=6).contains(&times.references) && times.total_s > times.own_s + 150.0);
        let timed = of(Budget::Hours(1.05 * times.total_s / 3600.0)).unwrap();
        let hours = timed.chosen.unwrap().times.unwrap().total_s / 3600.0;
        assert!(timed.steps.len() >= 115 && hours <= 1.05 * times.total_s / 3600.0, "{hours}");
        let short = of(Budget::Hours(0.01)).unwrap_err().to_string();
        assert!(short.contains("measures itself"), "{short}");
        assert!(of(Budget::Directions(23)).unwrap_err().to_string().contains("24 or more"));
        let error = of(Budget::Directions(9999)).unwrap_err();
        assert!(matches!(error, PlanError::TooMany { asked: 9999, .. }), "{error}");
    }
    eprintln!("middle tilts {middle:?}");
    assert!(middle.is_sorted() && middle[0] < 11.4 && middle[1] < 34.1, "{middle:?}");
    // An anisotropic sample: all azimuths of incidence.
    let ndf = ndf([0.1, 0.3]);
    let options =
        PlanOptions { theta_i: 6, phi_i: 5, side: 9, ..PlanOptions::to_choose_from(80.0) };
    let pool = plan(&ndf, &options).unwrap();
    let few = within_budget(&pool, &ndf, &bench, Budget::Directions(100), &Silent).unwrap();
    let azimuths: std::collections::BTreeSet<usize> =
        few.steps.iter().map(|s| s.incident[0]).collect();
    assert!(few.steps.len() == 100 && azimuths.len() >= 3, "{azimuths:?}");
}

/// Truth: the samples are those of the plan itself, made by its table's columns, less three that are taken out (one of them a value of 0) and more by one that is none of its. Nothing else may
/// be missing; half a degree is allowed.
#[test]
fn a_plan_says_what_was_not_measured() {
    use sunglint_materials::plan::{missing, planned};
    use sunglint_materials::samples::{Sample, Samples};
    let ndf = ndf([0.2; 2]);
    for options in [
        PlanOptions { theta_i: 4, side: 9, ..PlanOptions::default() },
        PlanOptions { theta_i: 4, side: 9, ..PlanOptions::of_rig(Rig::default()) },
    ] {
        let made = plan(&ndf, &options).unwrap();
        let table = to_table(&made);
        let (steps, quarter) = planned(std::path::Path::new("plan.ecsv"), &table).unwrap();
        assert_eq!((steps.len(), quarter), (made.steps.len(), false));
        // At normal incidence all azimuths are one.
        let last = steps.len() - 1;
        let sample = |k: usize, off_deg: f64| Sample {
            // An isotropic sample may have been turned.
            theta_i_deg: steps[k].theta_i_deg,
            phi_i_deg: steps[k].phi_i_deg + 40.0,
            theta_o_deg: steps[k].theta_o_deg + off_deg,
            phi_o_deg: steps[k].phi_o_deg + 40.0,
            brdf_per_sr: vec![if k == last - 2 { 0.0 } else { 0.1 }],
            sigma_per_sr: vec![],
        };
        let mut rows: Vec<Sample> = (0..=last)
            .filter(|k| ![last - 7, last - 4].contains(k))
            .map(|k| sample(k, 0.01))
            .collect();
        rows.push(Sample { theta_i_deg: 33.3, ..rows[0].clone() });
        let samples = Samples { wavelength_nm: vec![550.0], rows, ..Samples::default() };
        let (none, others) = missing(&steps, &samples, true, 0.1);
        let numbers: Vec<usize> = none.iter().map(|p| p.step).collect();
        assert_eq!((numbers, others), (vec![last - 6, last - 3, last - 1], 1));
        let other = sunglint_formats::Table::default();
        assert!(
            planned(std::path::Path::new("x"), &other)
                .unwrap_err()
                .to_string()
                .contains("brdf_plan")
        );
    }
}
