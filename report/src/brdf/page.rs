//! A material as a page: lobes, cuts, spectra, hemispherical reflectance, a ball and a box with a wing.

use super::show::is_extrapolated;
use crate::page::{Chart, Kind, Line, Page, Scale, Section};
use sunglint_materials::look::{Look, PhaseCurve};
use sunglint_materials::samples::direction;
use sunglint_simulator::surface::Material;

/// Geometries whose spectra are shown: angles of light and observer, the azimuth between them, degrees.
const GEOMETRIES: [(f64, f64, f64); 3] =
    [(30.0, 0.0, 0.0), (45.0, 45.0, 180.0), (60.0, 30.0, 90.0)];
/// Wavelengths of a spectrum, and what is left out of a range that goes far beyond what a detector sees, nm.
const STEPS: usize = 120;
const SHOWN_NM: (f64, f64) = (250.0, 2500.0);

/// Phase curves that stand on the page beside the looks.
#[derive(Debug, Clone)]
pub struct Bodies {
    /// A ball; none of a material with a tangent.
    pub ball: Option<PhaseCurve>,
    /// A box with a wing.
    pub box_wing: PhaseCurve,
}

fn line(name: &str, hue: usize, points: impl IntoIterator<Item = (f64, f64)>) -> Line {
    let (x, y) = points.into_iter().unzip();
    Line { hue, ..Line::dots(name, None, x, y).of_kind(Kind::Line) }
}

fn chart(
    id: &'static str,
    (title, label, x_label): (&str, &str, &str),
    scale: Scale,
    lines: Vec<Line>,
) -> Chart {
    Chart { x_label: x_label.into(), ..Chart::new(id, title, label, scale, lines) }
}

/// The page of a material at a wavelength; light comes from the azimuth `phi_i_deg`.
pub fn page(material: &Material, look: &Look, bodies: &Bodies, nm: f64, phi_i_deg: f64) -> String {
    let angle = "angle of the observer, degrees; the mirrored side is positive";
    let cuts = look.slices.iter().enumerate();
    let cuts = cuts.map(|(k, (t, all))| line(&format!("light at {t}°"), k, all.iter().copied()));
    let lobes = look.slices.iter().enumerate().map(|(k, (theta, all))| {
        let lit = all.iter().map(|(a, f)| (*a, f * a.to_radians().cos()));
        let most = lit.clone().map(|p| p.1).fold(f64::MIN_POSITIVE, f64::max);
        line(&format!("light at {theta}°"), k, lit.map(|(a, f)| (a, f / most)).collect::<Vec<_>>())
    });
    let mut others = vec![
        chart(
            "cuts",
            ("BRDF in the plane of incidence", "f, 1/sr", angle),
            Scale::Log,
            cuts.collect(),
        ),
        chart(
            "lobes",
            ("Lobes, each over its largest value", "f cosθ, relative", angle),
            Scale::Linear,
            lobes.collect(),
        ),
        chart(
            "hemispherical",
            (
                "What it reflects in all directions",
                "hemispherical reflectance",
                "angle of incidence, degrees",
            ),
            Scale::Linear,
            vec![line("this material", 0, look.albedo.iter().copied())],
        ),
    ];
    others.extend(spectra(material, phi_i_deg));
    let phase = "phase angle, degrees";
    let white = |(deg, _): &(f64, f64)| {
        let phase = deg.to_radians();
        let lit = phase.sin() + (std::f64::consts::PI - phase) * phase.cos();
        (*deg, 2.0 / (3.0 * std::f64::consts::PI) * lit)
    };
    if let Some(ball) = &bodies.ball {
        let own = line("this material", 0, ball.iter().copied());
        let white = line("white Lambert surface", 1, ball.iter().map(white));
        let what = ("A ball of 1 m radius: intensity over irradiance", "I/E, m²/sr", phase);
        others.push(chart("ball", what, Scale::Log, vec![own, white]));
    }
    let what = (
        "A box of 1 × 1 × 1.3 m with a wing of 8 m² towards the Sun, mean over a turn",
        "I/E, m²/sr",
        phase,
    );
    let own = line("this material", 0, bodies.box_wing.iter().copied());
    others.push(chart("boxwing", what, Scale::Log, vec![own]));
    let at = |theta: f64| look.albedo.iter().find(|a| a.0 == theta).map_or(f64::NAN, |a| a.1);
    let doubt = |name: &str, o: f64, phi: f64| {
        let (i, o) = (direction(30.0, phi_i_deg), direction(o, phi_i_deg + phi));
        let doubt = material.ln_doubt(i, o)?;
        let percent = format!("{:.0} %", 100.0 * doubt.exp_m1());
        Some([name.to_owned(), percent, "95 %, light at 30°".into()])
    };
    let whither = |theta: f64| -> String {
        match is_extrapolated(material, theta, phi_i_deg) {
            true => "in all directions; extrapolated".into(),
            false => "in all directions".into(),
        }
    };
    let mut figures = vec![
        ["reflects at 0°".to_owned(), format!("{:.3}", at(0.0)), whither(0.0)],
        ["at 75°".to_owned(), format!("{:.3}", at(75.0)), whither(75.0)],
    ];
    figures.extend(doubt("doubt in the mirrored direction", 30.0, 180.0));
    figures.extend(doubt("doubt elsewhere", 0.0, 0.0));
    let mut sections = Vec::new();
    if !look.warnings.is_empty() {
        let text = look.warnings.clone();
        sections.push(Section { title: "To know".into(), text, ..Section::default() });
    }
    let (typical, most) = look.reciprocity;
    Page {
        title: material.name.clone(),
        subtitle: format!("at {nm} nm"),
        verdict: match typical.is_finite() && most.is_finite() {
            true => format!(
                "{}. With light and observer exchanged it differs by a factor of {:.4} in the median, {:.4} at most.",
                material.describe(),
                typical.exp(),
                most.exp()
            ),
            false => format!("{}. It reflects nothing here.", material.describe()),
        },
        figures,
        curves_title: "What it does with light".into(),
        others,
        sections,
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
        ..Page::default()
    }
    .html()
}

/// π f against wavelength; none where the spectra have no range in common.
fn spectra(material: &Material, phi_i_deg: f64) -> Option<Chart> {
    let ranges = || material.spectra().iter().map(|s| s.range_nm()).filter(|r| r.1 > 1.0);
    let from = ranges().map(|r| r.0).fold(SHOWN_NM.0, f64::max);
    let to = ranges().map(|r| r.1).fold(SHOWN_NM.1, f64::min);
    if to <= from {
        return None;
    }
    let lines = GEOMETRIES.iter().enumerate().map(|(hue, (theta_i, theta_o, phi))| {
        let (i, o) = (direction(*theta_i, phi_i_deg), direction(*theta_o, phi_i_deg + phi));
        let at = |k: usize| {
            let nm = from + (to - from) * k as f64 / STEPS as f64;
            (nm, std::f64::consts::PI * material.brdf(nm, i, o))
        };
        let name = format!("{theta_i}° to {theta_o}°, azimuth {phi}°");
        line(&name, hue, (0..=STEPS).map(at).collect::<Vec<_>>())
    });
    let what = ("Spectra", "reflectance factor π f", "wavelength, nm");
    Some(chart("spectra", what, Scale::Log, lines.collect()))
}
