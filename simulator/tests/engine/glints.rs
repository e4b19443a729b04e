//! Glints that the Sun's disc brings where its middle does not, and what is stated where the disc is left out.

use super::{engine, far_away, grey, lighting};
use glam::{DQuat, DVec3};
use std::f64::consts::{PI, TAU};
use sunglint_simulator::light::engine::{Aspects, Switch, Switches};
use sunglint_simulator::light::{Course, Engine, Lighting, Options};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::Target;

const SUN: f64 = 4.65e-3;

fn plate(distribution: Distribution, alpha: f64) -> Target {
    let text = "[[part]]\nname = \"p\"\nshape = \"box\"\nsize_m = [1, 1, 1]\nfaces = [\"+z\"]\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 1\n";
    let mut target = Target::parse("plate.toml", text).unwrap();
    let lobe = Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
    target.materials = vec![Material::microfacet("m", lobe, Fresnel::constant(grey(1.0)).unwrap())];
    target
}

/// erf by Simpson's rule: 1e-7 for what is asked here.
fn erf(x: f64) -> f64 {
    if x > 5.0 {
        return 1.0;
    }
    let n = 60;
    let h = x / f64::from(n);
    let at = |k: u32| (-(h * f64::from(k)).powi(2)).exp();
    let inner: f64 = (1..n).map(|k| at(k) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
    (at(0) + inner + at(n)) * h / 3.0 * 2.0 / PI.sqrt()
}

/// f cosθ_i of a lobe with F = 1 as Walter et al. (2007) write it.
fn formula(kind: Distribution, alpha: f64, i: DVec3, o: DVec3) -> f64 {
    if i.z <= 0.0 {
        return 0.0;
    }
    let h = (i + o).normalize();
    let t2 = (1.0 / (h.z * h.z) - 1.0) / (alpha * alpha);
    let masking = |v: DVec3| {
        let x = v.z / (alpha * (1.0 - v.z * v.z).max(1e-30).sqrt());
        match kind {
            Distribution::Ggx => 2.0 / (1.0 + (1.0 + 1.0 / (x * x)).sqrt()),
            Distribution::Beckmann => {
                1.0 / (1.0 + 0.5 * (erf(x) - 1.0) + (-x * x).exp() / (2.0 * x * PI.sqrt()))
            }
        }
    };
    let bell = match kind {
        Distribution::Ggx => (1.0 + t2).powi(-2),
        Distribution::Beckmann => (-t2).exp(),
    };
    bell / (PI * alpha * alpha * h.z.powi(4)) * masking(i) * masking(o) / (4.0 * o.z)
}

/// The mean over the disc, darkened by μ^a with a = −0.023 + 0.292/0.55 (Hestroffer and Magnan 1998): midpoints in √μ (1,000, whose own error is 4e-6 of such lobes: it falls
/// with the square of their number, and is 1.5e-4 of 160) and in the angle.
fn average(sun: DVec3, value: impl Fn(DVec3) -> f64) -> f64 {
    let (rings, around) = (1000, 48);
    let (u, v) = sun.any_orthonormal_pair();
    let (mut sum, mut all) = (0.0, 0.0);
    for k in 0..rings {
        let t = (f64::from(k) + 0.5) / f64::from(rings);
        let mu = t * t;
        let weight = t * t * t * mu.powf(-0.023 + 0.292 / 0.55);
        let sine = SUN.sin() * ((1.0 - mu) * (1.0 + mu)).sqrt();
        let cosine = (1.0 - sine * sine).sqrt();
        for j in 0..around {
            let (s, c) = (TAU * (f64::from(j) + 0.5) / f64::from(around)).sin_cos();
            sum += weight * value(cosine * sun + sine * (c * u + s * v)) / cosine;
        }
        all += weight * f64::from(around);
    }
    sum / all
}

/// The light and its stated error at 550 nm.
fn light(engine: &Engine, lighting: &Lighting) -> (f64, f64) {
    let mut weights = vec![0.0; engine.terms().len()];
    let mut errors = weights.clone();
    engine.worker().light(lighting, &mut weights, &mut errors).unwrap();
    let tau = || engine.terms().iter().map(|t| t.spectrum.at(550.0));
    let light = tau().zip(&weights).map(|(tau, w)| tau * w).sum();
    let stated = tau().zip(&errors).map(|(tau, e)| tau.abs() * e).sum();
    (light, stated)
}

/// Truth: a sum over the disc of the lobes' formulas ([`average`]; lobes from α 0.004, whose bell on the disc is 1.7 radii wide). 60 plates whose lobe lies up to three times lobe and disc away from the observer. Without the
/// disc what is stated covers the difference on all of them, and is not more than ten times that in the median; with the disc left to the program the same holds, and where it says that
/// a tolerance is met, it is.
#[test]
fn what_the_disc_brings_is_stated() {
    let (mut shares, mut dark) = (Vec::new(), 0);
    for k in 0..60_u32 {
        let u = sobol_burley::sample_4d(k, 0, 77).map(f64::from);
        let kind = if k % 2 == 0 { Distribution::Ggx } else { Distribution::Beckmann };
        let alpha = 0.004 * 100_f64.powf(u[0]);
        let tolerance = [1e-1, 1e-2, 1e-3, 1e-4][(k / 2 % 4) as usize];
        let theta = 1.4 * u[1];
        let sun = DVec3::new(theta.sin(), 0.0, theta.cos());
        let mirrored = DVec3::new(-sun.x, 0.0, sun.z);
        let away = 3.0 * u[2] * (2.0 * alpha + SUN);
        let across = DQuat::from_axis_angle(mirrored, TAU * u[3]) * DVec3::Y;
        let to = DQuat::from_axis_angle(across, away) * mirrored;
        if to.z < 0.02 {
            continue;
        }
        let truth = to.z * average(sun, |d| formula(kind, alpha, d, to));
        let target = plate(kind, alpha);
        let now = lighting(sun, to, SUN);
        let mut aspects = Aspects::default();
        aspects.add(sun, to);
        let course = Course {
            moon: false,
            sun_radius_rad: SUN,
            phase_rad: sun.angle_between(to),
            aspects,
            ..far_away()
        };
        for switch in [Switch::Off, Switch::Auto] {
            let switches = Switches { solar_disc: switch, ..Switches::default() };
            let options = Options { tolerance, switches, ..Options::default() };
            let (found, stated) = light(&Engine::new(&target, &options, &course).unwrap(), &now);
            let off = (found - truth).abs();
            let case = format!("{k} {kind:?} {alpha} {switch:?}: {found} ± {stated}, {truth}");
            // The sum's own error; below 1e-9 sr⁻¹ is no light.
            assert!(off <= stated + 2e-5 * truth + 1e-9, "{case}");
            if switch == Switch::Off && truth > 1e-9 {
                shares.push(stated / off);
                dark += u32::from(truth > 2.0 * found);
            } else if truth > 1e-9 && stated <= tolerance * found {
                assert!(off <= (tolerance + 2e-5) * truth, "{case}");
            }
        }
    }
    shares.sort_by(f64::total_cmp);
    println!("stated over actual {:?}, mostly the limb's {dark}", shares[shares.len() / 2]);
    assert!(shares[shares.len() / 2] < 10.0, "{shares:?}");
    // Sums that are mostly the limb's are among them.
    assert!(dark > 0);
}

/// Truth: R²/4 of a mirror sphere at every phase angle (all that falls on πR² goes evenly to 4π), and W = 2/(3π)(sin γ + (π − γ) cos γ) of a white one with the Sun's disc: a
/// mean of that over the disc. Without the disc and with a Moon somewhere what is stated covers the difference, and is below 1e-4 up to 90° and little at 170°.
#[test]
fn spheres_state_little() {
    let off = Switches { solar_disc: Switch::Off, ..Switches::default() };
    let white = |d: DVec3, to: DVec3| {
        let phase = d.angle_between(to);
        2.0 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos())
    };
    for (name, phase_deg, most) in [
        ("mirror_sphere", 5.0_f64, 1e-4),
        ("mirror_sphere", 90.0, 1e-4),
        ("mirror_sphere", 170.0, 1e-3),
        ("lambert_sphere", 5.0, 1e-4),
        ("lambert_sphere", 90.0, 1e-4),
        // Of so thin a crescent a full Moon that lights the rest is 5e-3.
        ("lambert_sphere", 170.0, 1e-2),
    ] {
        let phase = phase_deg.to_radians();
        let (sun, to) = (DVec3::X, DVec3::new(phase.cos(), phase.sin(), 0.0));
        let truth = match name {
            "mirror_sphere" => 0.25,
            _ => average(sun, |d| white(d, to)),
        };
        let target = Target::built_in(name).unwrap();
        let (found, stated) = light(&engine(&target, 1e-3, off), &lighting(sun, to, SUN));
        let difference = (found - truth).abs();
        // A full Moon sends 2.5e-6 of sunlight to where it is seen at any phase angle; the sum's own error is 1e-6.
        assert!(
            difference <= stated + 1e-6 * truth,
            "{name} {phase_deg}: {found} ± {stated}, {truth}"
        );
        assert!(stated <= most * truth, "{name} {phase_deg}: {stated}");
    }
}
