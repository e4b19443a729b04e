//! Samples of known materials, measured as a lab does: retro-reflection, plan, values. Closed forms, none of them the project's.

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::OnceLock;
use sunglint_materials::assemble::{AssembleOptions, Assembled, assemble};
use sunglint_materials::ndf::{Ndf, NdfOptions, extract};
use sunglint_materials::plan::{PlanOptions, Rig, plan};
use sunglint_materials::samples::{Sample, Samples};
use sunglint_materials::table::{Reading, RetroFlags, RetroTable};
use sunglint_numerics::progress::Silent;

pub const WAVELENGTHS_NM: [f64; 3] = [400.0, 550.0, 800.0];

/// A material: its name and f \[sr⁻¹\] before its spectrum.
pub type Known = (&'static str, fn(DVec3, DVec3) -> f64);

/// The three that are assembled.
pub const MATERIALS: [Known; 3] = [("lambert", lambert), ("beckmann", beckmann), ("ggx", ggx)];

/// One whose masking is not the one that the values are compared with, over diffuse light that its NDF takes for microfacets.
pub const OTHER: Known = ("other", other);

/// The spectrum of all.
pub fn spectrum(nm: f64) -> f64 {
    0.4 + 0.4 * (nm - 400.0) / 400.0
}

fn lambert(_: DVec3, _: DVec3) -> f64 {
    1.0 / PI
}

/// α = 0.2, height-correlated masking (Walter et al. 2007, eqs. 25, 26; Heitz 2014, eqs. 72, 99), so that retro-reflection is that of a real surface
/// (fully correlated there).
fn ggx(i: DVec3, o: DVec3) -> f64 {
    let a2: f64 = 0.04;
    let h = (i + o).normalize();
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let lambda = |v: DVec3| 0.5 * ((1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt() - 1.0);
    d * masking(i, o, lambda) / (4.0 * i.z * o.z)
}

/// GGX of 0.3 with height-correlated masking whatever the azimuths, so that it is darker in retro-reflection than microfacets are, and 0.05/π.
fn other(i: DVec3, o: DVec3) -> f64 {
    let a2: f64 = 0.09;
    let h = (i + o).normalize();
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let lambda = |v: DVec3| 0.5 * ((1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt() - 1.0);
    0.5 * d / (1.0 + lambda(i) + lambda(o)) / (4.0 * i.z * o.z) + 0.05 / PI
}

/// A white paint: GGX of 0.25 with F = 0.04 over 0.5/π.
pub fn paint(i: DVec3, o: DVec3) -> f64 {
    let a2: f64 = 0.0625;
    let h = (i + o).normalize();
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let lambda = |v: DVec3| 0.5 * ((1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt() - 1.0);
    0.04 * d * masking(i, o, lambda) / (4.0 * i.z * o.z) + 0.5 / PI
}

/// A glossy paint: GGX of 0.15 with F₀ = 0.04 (Schlick) over 0.6/π.
pub fn glossy(i: DVec3, o: DVec3) -> f64 {
    let a2: f64 = 0.0225;
    let h = (i + o).normalize();
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let lambda = |v: DVec3| 0.5 * ((1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt() - 1.0);
    let f = 0.04 + 0.96 * (1.0 - i.dot(h)).powi(5);
    f * d / (1.0 + lambda(i) + lambda(o)) / (4.0 * i.z * o.z) + 0.6 / PI
}

/// GGX of 0.4 whose Fresnel term rises (Schlick from 0.1), each direction masked by itself.
fn rising(i: DVec3, o: DVec3) -> f64 {
    let a2: f64 = 0.16;
    let h = (i + o).normalize();
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let one = |v: DVec3| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt());
    let f = 0.1 + 0.9 * (1.0 - i.dot(h)).powi(5);
    f * d * one(i) * one(o) / (4.0 * i.z * o.z)
}

fn beckmann(i: DVec3, o: DVec3) -> f64 {
    let alpha = 0.2;
    let h = (i + o).normalize();
    let tan2 = 1.0 / (h.z * h.z) - 1.0;
    let d = (-tan2 / (alpha * alpha)).exp() / (PI * alpha * alpha * h.z.powi(4));
    let lambda = |v: DVec3| {
        let tan = (1.0 / (v.z * v.z) - 1.0).max(1e-20).sqrt();
        let a = 1.0 / (alpha * tan);
        0.5 * (erf(a) - 1.0 + (-a * a).exp() / (a * PI.sqrt()))
    };
    d * masking(i, o, lambda) / (4.0 * i.z * o.z)
}

/// G₁ of both where they are in one direction (masked together), independent elsewhere; between, by their angle (Heitz 2014, eq. 102, after Ashikhmin).
fn masking(i: DVec3, o: DVec3, lambda: impl Fn(DVec3) -> f64) -> f64 {
    let (a, b) = (lambda(i), lambda(o));
    let (p, q) = (i.truncate(), o.truncate());
    let apart = if p.length() * q.length() > 1e-12 { p.angle_to(q).abs() } else { FRAC_PI_2 };
    let independent = 4.41 * apart / (4.41 * apart + 1.0);
    1.0 / (1.0 + a.max(b) + independent * a.min(b))
}

/// Abramowitz and Stegun 7.1.5 and 7.1.14.
fn erf(x: f64) -> f64 {
    if x < 3.0 {
        let (mut term, mut sum) = (x, x);
        for n in 1..80 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        2.0 / PI.sqrt() * sum
    } else {
        let mut c = x;
        for k in (1..60).rev() {
            c = x + 0.5 * f64::from(k) / c;
        }
        1.0 - (-x * x).exp() / (PI.sqrt() * c)
    }
}

/// The NDF by retro-reflection every half degree up to 89°.
pub fn density(law: fn(DVec3, DVec3) -> f64) -> Ndf {
    density_beside(law, false)
}

/// The same; with diffuse light taken off it, where that is seen.
pub fn density_beside(law: fn(DVec3, DVec3) -> f64, diffuse: bool) -> Ndf {
    let reading = |k: i32| {
        let angle_deg = 0.5 * f64::from(k);
        let v = DVec3::new(angle_deg.to_radians().sin(), 0.0, angle_deg.to_radians().cos());
        Reading {
            angle_deg,
            azimuth_deg: 0.0,
            f_per_sr: law(v, v),
            sigma_f_per_sr: 0.0,
            flags: RetroFlags::empty(),
        }
    };
    let mut readings: Vec<Reading> = (-20..=178).map(reading).collect();
    readings.retain(|r| r.f_per_sr > 1e-200);
    let run = RetroTable { readings, wavelength_nm: Some(550.0), ..RetroTable::default() };
    let options =
        NdfOptions { resamplings: 0, zero_deg: Some(0.0), diffuse, ..NdfOptions::default() };
    extract(&run, &options).unwrap()
}

/// Returns the samples that are measured on a plan.
pub fn measured(law: fn(DVec3, DVec3) -> f64, ndf: &Ndf, options: &PlanOptions) -> Samples {
    let made = plan(ndf, options).unwrap();
    let deg =
        |v: DVec3| (v.truncate().length().atan2(v.z).to_degrees(), v.y.atan2(v.x).to_degrees());
    let rows = made.steps.iter().map(|step| {
        let theta = made.theta_i_rad[step.incident[1]];
        let theta = step.marks_deg.map_or(theta, |m| m[0].to_radians());
        let phi = made.phi_i_rad[step.incident[0]];
        let i = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let (theta_o_deg, phi_o_deg) = deg(step.outgoing);
        let f = law(i, step.outgoing);
        Sample {
            theta_i_deg: theta.to_degrees(),
            phi_i_deg: phi.to_degrees(),
            theta_o_deg,
            phi_o_deg,
            brdf_per_sr: WAVELENGTHS_NM.iter().map(|nm| spectrum(*nm) * f).collect(),
            sigma_per_sr: vec![],
        }
    });
    Samples { wavelength_nm: WAVELENGTHS_NM.to_vec(), rows: rows.collect(), ..Samples::default() }
}

/// From a plan over the whole hemisphere: by number of elevations and side.
pub fn from_plan(
    law: fn(DVec3, DVec3) -> f64,
    (theta_i, side): (usize, usize),
    options: &AssembleOptions,
) -> Assembled {
    let ndf = density(law);
    let plan = PlanOptions { theta_i, side, ..PlanOptions::default() };
    assemble(&measured(law, &ndf, &plan), &ndf, options, &Silent).unwrap()
}

/// A file that is coarser than the program's, where it is not the file that limits: a third of the time.
pub fn coarse() -> AssembleOptions {
    AssembleOptions { theta_i: 48, side: 81, normals: 64, ..AssembleOptions::default() }
}

/// One of the three from some 3000 measurements over the whole hemisphere; assembled once for all tests.
pub fn whole(name: &str) -> &'static Assembled {
    static MADE: [OnceLock<Assembled>; 3] = [const { OnceLock::new() }; 3];
    let at = MATERIALS.iter().position(|known| known.0 == name).unwrap();
    let options = AssembleOptions::default();
    MADE[at].get_or_init(|| from_plan(MATERIALS[at].1, (16, 17), &options))
}

/// Those three, and three that the NDF does not describe.
pub const SIX: [Known; 6] =
    [MATERIALS[0], MATERIALS[1], MATERIALS[2], OTHER, ("paint", paint), ("rising", rising)];

/// Returns what comes of one of the six from a rig in one plane, with its NDF; assembled once for all tests.
pub fn of_rig(name: &str) -> &'static (Ndf, Assembled) {
    static MADE: [OnceLock<(Ndf, Assembled)>; 6] = [const { OnceLock::new() }; 6];
    let at = SIX.iter().position(|known| known.0 == name).unwrap();
    MADE[at].get_or_init(|| {
        let (_, law) = SIX[at];
        let ndf = density(law);
        let plan = PlanOptions { theta_i: 12, ..PlanOptions::of_rig(Rig::default()) };
        let made = assemble(&measured(law, &ndf, &plan), &ndf, &coarse(), &Silent).unwrap();
        (ndf, made)
    })
}

/// The glossy paint on a plan of its lobe, with the diffuse light taken off the NDF; assembled once.
pub fn glossy_whole() -> &'static Assembled {
    static MADE: OnceLock<Assembled> = OnceLock::new();
    MADE.get_or_init(|| {
        let ndf = density_beside(glossy, true);
        let plan = PlanOptions { theta_i: 16, side: 17, ..PlanOptions::default() };
        assemble(&measured(glossy, &ndf, &plan), &ndf, &AssembleOptions::default(), &Silent)
            .unwrap()
    })
}
