//! The density of microfacet normals: text, summary, figure.

use crate::plot::{Axis, COLOURS, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;
use sunglint_materials::ndf::Convergence;
use sunglint_materials::ndf::{
    DiffuseOrigin, Ndf, NdfFlags, NdfOptions, ShapeFit, TailKind, ZeroOrigin, to_table,
};
use sunglint_materials::table::RetroTable;
use sunglint_radiometry::light_curve::Input;
use sunglint_simulator::surface::{Distribution, Lobe, Masking};

/// All forms of the result; `run` is what it was made of.
pub fn product(
    ndf: &Ndf,
    run: &RetroTable,
    inputs: &[Input],
    warnings: &[String],
    options: &NdfOptions,
) -> Product {
    let mut table = to_table(ndf);
    table.meta.insert("wavelength_nm".into(), json_of(&run.wavelength_nm));
    table.meta.insert("cone_half_angle_deg".into(), json_of(&run.cone_half_angle_deg));
    table.meta.insert("seed".into(), json_of(&options.seed));
    table.meta.insert("median".into(), json_of(&options.median));
    table.meta.insert("inputs".into(), json_of(&inputs));
    Product {
        name: "ndf".into(),
        figure: Some(figure(ndf, run)),
        json: summary(ndf, run, inputs, warnings, options.seed),
        table,
        ..Product::default()
    }
}

fn with_sigma(value: f64, sigma: Option<f64>) -> String {
    match sigma {
        Some(sigma) => format!("{value:.5} ± {sigma:.5}"),
        None => format!("{value:.5}"),
    }
}

/// The text.
pub fn text(ndf: &Ndf, run: &RetroTable) -> String {
    let mut text = String::new();
    let c = &ndf.convergence;
    let _ = writeln!(
        text,
        "F0        {}, with another continuation beyond the last angle by up to {:.5} otherwise",
        with_sigma(ndf.f0, ndf.f0_sigma),
        ndf.f0_bound
    );
    let _ = writeln!(
        text,
        "D         {:.5} sr⁻¹ towards the normal, {} elevations × {} azimuths",
        ndf.density[0],
        ndf.theta_rad.len(),
        ndf.phi_rad.len()
    );
    let _ = writeln!(
        text,
        "iteration {} rounds, residual {:.1e}, eigenvalue gap {:.3}",
        c.iterations, c.residual, c.eigenvalue_gap
    );
    for p in &ndf.profiles {
        let origin = match p.zero.origin {
            ZeroOrigin::Fitted => format!("± {:.4}° (from both sides)", p.zero.sigma_deg),
            ZeroOrigin::Law => {
                format!("± {:.4}° (by a law that meets the readings)", p.zero.sigma_deg)
            }
            ZeroOrigin::Given if p.zero.sigma_deg > 0.0 => {
                format!("± {:.4}° (given)", p.zero.sigma_deg)
            }
            ZeroOrigin::Given => "(given)".to_owned(),
            ZeroOrigin::Assumed if p.zero.sigma_deg > 0.0 => format!(
                "± {:.4}° (the stage's own, as the run states it: not decided by the readings)",
                p.zero.sigma_deg
            ),
            ZeroOrigin::Assumed => "(the stage's own: not decided by the readings)".to_owned(),
        };
        let plane = if ndf.is_isotropic() {
            String::new()
        } else {
            format!("in the plane at {:.1}°: ", p.azimuth_deg)
        };
        let _ = writeln!(text, "{plane}normal at {:.4}° {origin}", p.zero.angle_deg);
        let _ = writeln!(
            text,
            "  measured to {:.2}° by {:.3}°, beyond that {}",
            p.measured_to_deg,
            p.step_deg,
            tail_name(p.tail)
        );
        for (name, fit) in [("Beckmann", p.beckmann), ("GGX", p.ggx)] {
            let _ = writeln!(
                text,
                "  {name:<9} α {}{}, misfit {:.4} (rms of ln f)",
                with_sigma(fit.alpha, fit.sigma),
                fit.seen_alpha.map_or(String::new(), |seen| format!(" (as seen {seen:.5})")),
                fit.misfit
            );
        }
    }
    for p in ndf.profiles.iter().filter(|p| p.diffuse.origin == DiffuseOrigin::Fitted) {
        let (rho, bound) = (p.diffuse.reflectance(), std::f64::consts::PI * p.diffuse.bound_per_sr);
        let _ = writeln!(text, "diffuse light of reflectance {rho:.4} ± {bound:.4}, taken off");
    }
    if let Some(least) = ndf.smallest_alpha {
        let cone = run.cone_half_angle_deg.unwrap_or_default();
        let _ = writeln!(
            text,
            "the rig's cone of ± {cone:.3}° blurs the half-vector by half of it: no α below {least:.5} is seen"
        );
    }
    if ndf.smallest_alpha.is_none() {
        text.push_str("the run does not state its cone of light (cone_half_angle_deg): every α is that of the lobe as it is seen, or less\n");
    }
    if ndf.resamplings == 0 {
        text.push_str("no uncertainties: those of the readings (sigma_f_per_sr) are not known\n");
    }
    text
}

fn tail_name(tail: TailKind) -> &'static str {
    match tail {
        TailKind::Ggx => "a GGX lobe",
        TailKind::Beckmann => "a Beckmann lobe",
        TailKind::Exponential => "an exponential",
        TailKind::Linear => "a straight line",
    }
}

#[derive(Serialize)]
struct ShapeJson {
    alpha: f64,
    seen_alpha: Option<f64>,
    sigma: Option<f64>,
    f0: f64,
    misfit: f64,
}

#[derive(Serialize)]
struct ProfileJson<'a> {
    azimuth_deg: f64,
    zero: ZeroJson<'a>,
    measured_to_deg: f64,
    step_deg: f64,
    tail: &'a TailKind,
    fits: FitsJson,
    diffuse: DiffuseJson<'a>,
}

#[derive(Serialize)]
struct ZeroJson<'a> {
    angle_deg: f64,
    sigma_deg: f64,
    origin: &'a ZeroOrigin,
}

#[derive(Serialize)]
struct FitsJson {
    beckmann: ShapeJson,
    ggx: ShapeJson,
}

#[derive(Serialize)]
struct DiffuseJson<'a> {
    reflectance: f64,
    bound: f64,
    origin: &'a DiffuseOrigin,
}

#[derive(Serialize)]
struct NdfJson<'a> {
    wavelength_nm: Option<f64>,
    readings: usize,
    f0: f64,
    f0_sigma: Option<f64>,
    f0_bound: f64,
    d_normal_per_sr: f64,
    convergence: &'a Convergence,
    elevations: usize,
    azimuths: usize,
    extrapolated_nodes: usize,
    profiles: Vec<ProfileJson<'a>>,
    smallest_alpha: Option<f64>,
    resamplings: usize,
    seed: u64,
    warnings: &'a [String],
    inputs: &'a [Input],
}

fn summary(ndf: &Ndf, run: &RetroTable, inputs: &[Input], warnings: &[String], seed: u64) -> Value {
    let fit = |f: &ShapeFit| ShapeJson {
        alpha: rounded(f.alpha),
        seen_alpha: f.seen_alpha.map(rounded),
        sigma: f.sigma.map(rounded),
        f0: rounded(f.f0),
        misfit: rounded(f.misfit),
    };
    let profiles = ndf.profiles.iter().map(|p| ProfileJson {
        azimuth_deg: rounded(p.azimuth_deg),
        zero: ZeroJson {
            angle_deg: rounded(p.zero.angle_deg),
            sigma_deg: rounded(p.zero.sigma_deg),
            origin: &p.zero.origin,
        },
        measured_to_deg: rounded(p.measured_to_deg),
        step_deg: rounded(p.step_deg),
        tail: &p.tail,
        fits: FitsJson { beckmann: fit(&p.beckmann), ggx: fit(&p.ggx) },
        diffuse: DiffuseJson {
            reflectance: rounded(p.diffuse.reflectance()),
            bound: rounded(std::f64::consts::PI * p.diffuse.bound_per_sr),
            origin: &p.diffuse.origin,
        },
    });
    let beyond = ndf.flags.iter().filter(|f| f.contains(NdfFlags::EXTRAPOLATED)).count();
    json_of(&NdfJson {
        wavelength_nm: run.wavelength_nm,
        readings: run.readings.len(),
        f0: rounded(ndf.f0),
        f0_sigma: ndf.f0_sigma.map(rounded),
        f0_bound: rounded(ndf.f0_bound),
        d_normal_per_sr: rounded(ndf.density[0]),
        convergence: &ndf.convergence,
        elevations: ndf.theta_rad.len(),
        azimuths: ndf.phi_rad.len(),
        extrapolated_nodes: beyond,
        profiles: profiles.collect(),
        smallest_alpha: ndf.smallest_alpha.map(rounded),
        resamplings: ndf.resamplings,
        seed,
        warnings,
        inputs,
    })
}

/// D, σ and the readings against the angle.
fn figure(ndf: &Ndf, run: &RetroTable) -> Figure {
    let n = ndf.theta_rad.len();
    let degrees: Vec<f64> = ndf.theta_rad.iter().map(|t| t.to_degrees()).collect();
    let along = |values: &[f64], row: usize| -> Vec<(f64, f64)> {
        degrees.iter().copied().zip(values[row * n..(row + 1) * n].iter().copied()).collect()
    };
    // Of an anisotropic sample a few azimuths stand for all.
    let rows: Vec<usize> = if ndf.is_isotropic() {
        vec![0]
    } else {
        (0..4).map(|k| k * ndf.phi_rad.len() / 4).collect()
    };
    let name = |what: &str, row: usize| match ndf.is_isotropic() {
        true => what.to_owned(),
        false => format!("{what} at φ = {:.0}°", ndf.phi_rad[row].to_degrees()),
    };
    let mut density = Vec::new();
    let mut area = Vec::new();
    for (k, row) in rows.iter().enumerate() {
        density.push(Series::line(name("D", *row), k, along(&ndf.density, *row)));
        area.push(Series::line(name("σ", *row), k, along(&ndf.projected_area, *row)));
    }
    if let (true, Some(profile)) = (ndf.is_isotropic(), ndf.profiles.first()) {
        let kinds = [(Distribution::Beckmann, "Beckmann"), (Distribution::Ggx, "GGX")];
        for (k, ((kind, name), fit)) in
            kinds.into_iter().zip([profile.beckmann, profile.ggx]).enumerate()
        {
            let label = format!("{name}, α {:.4}", fit.alpha);
            let line = Series::line(label, k + 1, fitted(kind, &fit, &degrees));
            // A good fit would hide what it fits.
            density.push(line.with_colour_and_dash(COLOURS[k + 1], 1));
        }
        let beyond = ndf.flags.iter().position(|f| f.contains(NdfFlags::EXTRAPOLATED));
        if let Some(k) = beyond {
            density.push(Series::dots("not measured", 6, along(&ndf.density, 0)[k..].to_vec()));
        }
    }
    let peak = ndf.density.iter().fold(0.0_f64, |a, d| a.max(*d));
    let least = ndf.density.iter().copied().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let floor = least.max(1e-8 * peak);
    let d_axis = Axis::log("D (sr⁻¹)").from_to(floor, 2.0 * peak);
    let angle = || Axis::linear("angle from the normal (deg)").from_to(0.0, 90.0);
    let readings = run.readings.iter().map(|r| (r.angle_deg, r.f_per_sr)).collect();
    let title = match run.wavelength_nm {
        Some(nm) => format!("Density of microfacet normals at {nm} nm, F₀ = {:.4}", ndf.f0),
        None => format!("Density of microfacet normals, F₀ = {:.4}", ndf.f0),
    };
    Figure {
        title,
        panels: vec![
            Panel::new(angle(), d_axis, density),
            Panel::new(angle(), Axis::linear("projected area σ"), area),
            Panel::new(
                Axis::linear("angle of the stage (deg)"),
                Axis::log("retro-reflection f (sr⁻¹)"),
                vec![Series::dots("readings", 0, readings)],
            ),
        ],
    }
}

fn fitted(kind: Distribution, fit: &ShapeFit, degrees: &[f64]) -> Vec<(f64, f64)> {
    let Ok(lobe) = Lobe::isotropic(kind, fit.alpha, Masking::Separable) else {
        return Vec::new();
    };
    let at = |deg: &f64| {
        let (sin, cos) = deg.to_radians().min(FRAC_PI_2 - 1e-9).sin_cos();
        (*deg, lobe.density(glam::DVec3::new(sin, 0.0, cos)))
    };
    degrees.iter().map(at).collect()
}
