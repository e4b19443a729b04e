//! Reflection of a sphere against phase angle, rough mirrors beside Lambert's law and a mirror (thesis fig. G.4).

use crate::plot::{Axis, Figure, Panel, RGBColor, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use sunglint_formats::{Column, Table};
use sunglint_simulator::picture::spheres::{STEP_DEG, SphereRatio};

#[derive(Serialize)]
struct SphereJson<'a> {
    name: &'a str,
    at_0_deg: f64,
    at_90_deg: f64,
}

#[derive(Serialize)]
struct SpheresJson<'a> {
    title: &'a str,
    unit: &'a str,
    spheres: Vec<SphereJson<'a>>,
}

/// All forms of the curves, and the text.
pub fn product(spheres: &[SphereRatio]) -> (Product, String) {
    let phases: Vec<f64> = (0..=(180.0 / STEP_DEG) as usize).map(|i| i as f64 * STEP_DEG).collect();
    let mut table = Table::default();
    let title = "What a sphere of reflectance 1 sends to the observer";
    table.meta.insert("title".into(), json_of(&title));
    table.meta.insert(
        "comments".into(),
        json_of(&["intensity over irradiance and cross-section, I/(E pi R^2), sr^-1; collimated light scattered once; Beckmann with separable masking of Smith"]),
    );
    table.columns.push(Column::f64("phase_deg", Some("deg"), phases.clone()));
    let mut series = Vec::new();
    let mut list = Vec::new();
    let mut text = format!(
        "{title}: I/(E πR²), sr⁻¹\n  {:<12}{:>12}{:>12}{:>12}{:>12}\n",
        "", "0°", "60°", "120°", "170°"
    );
    for (i, SphereRatio { column, name, is_ideal, ratio }) in spheres.iter().enumerate() {
        let at = |deg: f64| ratio[(deg / STEP_DEG) as usize];
        text.push_str(&format!("  {name:<12}"));
        for deg in [0.0, 60.0, 120.0, 170.0] {
            text.push_str(&format!("{:>12.5}", at(deg)));
        }
        text.push('\n');
        // A mirror has no limit at 180°.
        let shown = phases.iter().copied().zip(ratio.iter().copied());
        let points = shown.filter(|(deg, _)| *deg < 180.0 || column != "mirror").collect();
        let line = Series::line(name.clone(), i, points);
        series.push(if *is_ideal {
            line.with_colour_and_dash(RGBColor(40, 40, 40), i)
        } else {
            line
        });
        list.push(SphereJson { name, at_0_deg: rounded(at(0.0)), at_90_deg: rounded(at(90.0)) });
        let described = format!("{name}: I/(E pi R^2)").replace('α', "alpha");
        table
            .columns
            .push(Column::f64(column.clone(), Some("1 / sr"), ratio.clone()).described(described));
    }
    let x = Axis::linear("phase angle (°)").from_to(0.0, 180.0);
    let y = Axis::linear("I / (E πR²)  (sr⁻¹)");
    let figure = Figure {
        title: "Reflection ratio of a sphere: Beckmann roughness α beside Lambert and a mirror"
            .into(),
        panels: vec![Panel::new(x, y, series)],
    };
    let product = Product {
        name: "sphere".into(),
        table,
        figure: Some(figure),
        json: json_of(&SpheresJson { title, unit: "1 / sr", spheres: list }),
        ..Product::default()
    };
    (product, text)
}
