//! Light of a body for directions that are given: text, JSON, table, rows of a long table.

use crate::{Product, explain};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::text::counted;
use sunglint_formats::{Column, Table};
use sunglint_simulator::intensity::{Intensities, Intensity, Weight};
use sunglint_simulator::light::percent;

/// Columns for the name of a term.
const NAME: usize = 40;
/// Part of the largest error below which that of a term of 0 does not count.
const NEGLIGIBLE: f64 = 1e-6;

/// A name in at most so many columns.
fn shortened(name: &str, columns: usize) -> String {
    if name.chars().count() <= columns {
        return name.to_owned();
    }
    name.chars().take(columns - 1).chain(['…']).collect()
}

/// The light of one aspect, and how it is to be shown.
#[derive(Debug)]
pub struct IntensityReport<'a> {
    /// The target's name.
    pub target: &'a str,
    /// Target, prepared for its aspects.
    pub all: &'a Intensities,
    /// The light.
    pub light: &'a Intensity,
}

/// The document of one aspect.
#[derive(Serialize)]
struct Document<'a> {
    target: &'a str,
    tolerance: f64,
    budget_s: f64,
    #[serde(flatten)]
    light: &'a Intensity,
    needs: Vec<explain::NeedJson<'a>>,
}

impl IntensityReport<'_> {
    /// Table and JSON document.
    ///
    /// # Errors
    /// None in practice: a document of numbers and texts.
    pub fn product(&self) -> Result<Product, serde_json::Error> {
        let (options, needs) = (self.all.options(), self.all.needs());
        let document = Document {
            target: self.target,
            tolerance: options.tolerance,
            budget_s: options.budget_s,
            light: self.light,
            needs: explain::json(&needs),
        };
        let light = &self.light.light;
        let column = |name: &str, unit, f: &dyn Fn(usize) -> f64| {
            Column::f64(name, Some(unit), (0..light.len()).map(f).collect())
        };
        let mut columns = vec![
            column("wavelength_nm", "nm", &|s| light[s].wavelength_nm),
            column("per_irradiance_m2_per_sr", "m2 / sr", &|s| light[s].per_irradiance_m2_per_sr),
            column("error_m2_per_sr", "m2 / sr", &|s| light[s].error_m2_per_sr),
            column("intensity_w_per_sr_nm", "W / (sr nm)", &|s| light[s].intensity_w_per_sr_nm),
        ];
        if self.all.has_material_doubt() {
            let half = |s: usize| light[s].material_m2_per_sr.unwrap_or(f64::NAN);
            columns.push(column("material_m2_per_sr", "m2 / sr", &half));
        }
        let table = Table { columns, ..Table::default() };
        let json = serde_json::to_value(document)?;
        Ok(Product { name: "light".into(), table, json, ..Product::default() })
    }

    /// The weights of single materials, within 80 columns. A term that is 0 and whose error does not count beside the largest one is only counted.
    fn terms(&self) -> String {
        let single = || self.light.weights.iter().filter(|weight| weight.material.is_some());
        let largest = single().map(|w| w.error_m2_per_sr).fold(0.0, f64::max);
        let counts =
            |w: &&Weight| w.weight_m2_per_sr != 0.0 || w.error_m2_per_sr > NEGLIGIBLE * largest;
        let mut text =
            format!("\n  {:<NAME$}  {:>16}  {:>12}\n", "light of", "W, m²/sr", "stated error");
        for weight in single().filter(counts) {
            let material = weight.material.as_deref().unwrap_or_default();
            let name = shortened(&format!("{}, {material}", weight.source), NAME);
            let _ = writeln!(
                text,
                "  {name:<NAME$}  {:>16.9e}  {:>12.2e}",
                weight.weight_m2_per_sr, weight.error_m2_per_sr,
            );
        }
        let rest = single().count() - single().filter(counts).count();
        if rest > 0 {
            let _ = writeln!(
                text,
                "  {} of 0, with an error of next to nothing: --json has them",
                counted(rest, "term")
            );
        }
        text
    }

    /// The text.
    pub fn text(&self) -> String {
        let (light, options) = (self.light, self.all.options());
        let mut text = format!("{}, phase angle {:.4}°\n", self.target, light.phase_deg);
        text.push_str(&explain::short(&self.all.needs(), options.tolerance));
        text.push_str("\n  wavelength     I/E, m²/sr          stated error        I, W/(sr nm)\n");
        for at in &light.light {
            let share = at.error_m2_per_sr / at.per_irradiance_m2_per_sr;
            let share = if share.is_finite() { percent(share) } else { "-".into() };
            let _ = writeln!(
                text,
                "  {:>7.1} nm  {:>16.9e}  {:>9.2e} ({share})  {:>16.9e}",
                at.wavelength_nm,
                at.per_irradiance_m2_per_sr,
                at.error_m2_per_sr,
                at.intensity_w_per_sr_nm,
            );
        }
        text.push_str(&self.terms());
        // Light that went by several materials has a term for each product of their spectra.
        let mut several: Vec<(&str, usize)> = Vec::new();
        for weight in light.weights.iter().filter(|weight| weight.material.is_none()) {
            match several.last_mut() {
                Some((source, terms)) if *source == weight.source => *terms += 1,
                _ => several.push((weight.source, 1)),
            }
        }
        for (source, terms) in several {
            let _ = writeln!(text, "  {terms} terms of {source}: --json has them");
        }
        for by in light.by_albedo.iter().flatten() {
            let values: Vec<String> =
                by.derivative_m2_per_sr.iter().map(|v| format!("{v:.9e}")).collect();
            let _ =
                writeln!(text, "  d(I/E)/d ln(albedo of {}): {}", by.material, values.join(", "));
        }
        let half = light.light.iter().filter_map(|at| {
            let share = at.material_m2_per_sr? / at.per_irradiance_m2_per_sr;
            Some(format!("{} at {} nm", percent(share), at.wavelength_nm))
                .filter(|_| share.is_finite())
        });
        let half: Vec<String> = half.collect();
        if !half.is_empty() {
            let _ = writeln!(
                text,
                "\nthe materials are known to (95 %): {}; not in the stated error",
                half.join(", ")
            );
        }
        let asked = percent(options.tolerance);
        let stated = light.stated_relative.map_or("no light".into(), percent);
        let _ = match light.limited_by {
            None => writeln!(text, "\npromise: asked {asked}, stated {stated}"),
            Some(limit) => {
                writeln!(text, "\npromise: asked {asked}, stated {stated}, limited by {limit}")
            }
        };
        text
    }
}

/// The names of the columns of [`row`], for these wavelengths.
pub fn header(all: &Intensities) -> String {
    let mut text = "phase_deg,stated_relative,met,limited_by".to_owned();
    for nm in &all.options().wavelength_nm {
        let _ = write!(text, ",i_{nm}nm_m2_per_sr,error_{nm}nm_m2_per_sr");
        if all.has_material_doubt() {
            let _ = write!(text, ",material_{nm}nm_m2_per_sr");
        }
    }
    text.push('\n');
    text
}

/// A row of comma-separated values, with all digits.
pub fn row(light: &Intensity, text: &mut String) {
    let stated = light.stated_relative.map_or(String::new(), |s| s.to_string());
    let limit = light.limited_by.unwrap_or("");
    let _ = write!(text, "{},{stated},{},{limit}", light.phase_deg, light.met);
    for at in &light.light {
        let _ = write!(text, ",{},{}", at.per_irradiance_m2_per_sr, at.error_m2_per_sr);
        if let Some(half) = at.material_m2_per_sr {
            let _ = write!(text, ",{half}");
        }
    }
    text.push('\n');
}
