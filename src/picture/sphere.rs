//! What a sphere reflects against phase angle, rough mirrors beside Lambert's law and a mirror (thesis fig. G.4).

use super::PictureArgs;
use crate::output::{Console, Usage};
use serde_json::json;
use std::f64::consts::PI;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};

/// Steps of the phase angle, degrees.
const STEP_DEG: f64 = 1.0;

/// Makes the curves.
pub fn run(args: &PictureArgs, console: Console) -> anyhow::Result<()> {
    if let Some(bad) = args.alpha.iter().find(|a| !(1e-5..=2.0).contains(*a)) {
        return Err(Usage(format!("--alpha is {bad}, expected 1e-5 to 2")).into());
    }
    let (from, to) = (300.0, 1240.0);
    let white = || Spectrum::constant(1.0, from, to);
    let mut spheres = vec![
        ("lambert".to_owned(), "Lambert".to_owned(), Material::lambert("Lambert", white()?)?),
        (
            "mirror".to_owned(),
            "mirror".to_owned(),
            Material::mirror("mirror", Fresnel::constant(white()?)?),
        ),
    ];
    for alpha in &args.alpha {
        let lobe = Lobe::isotropic(Distribution::Beckmann, *alpha, Masking::default())?;
        let name = format!("α = {alpha}");
        let column = format!("alpha_{alpha}").replace(['.', '-'], "_");
        spheres.push((
            column,
            name.clone(),
            Material::microfacet(name, lobe, Fresnel::constant(white()?)?),
        ));
    }
    let phases: Vec<f64> = (0..=(180.0 / STEP_DEG) as usize).map(|i| i as f64 * STEP_DEG).collect();
    let mut table = Table::default();
    let title = "What a sphere of reflectance 1 sends to the observer";
    table.meta.insert("title".into(), json!(title));
    table.meta.insert(
        "comments".into(),
        json!(["intensity over irradiance and cross-section, I/(E pi R^2), sr^-1; collimated light scattered once; Beckmann with separable masking of Smith"]),
    );
    table.columns.push(Column::f64("phase_deg", Some("deg"), phases.clone()));
    let mut series = Vec::new();
    let mut list = Vec::new();
    let mut text = format!(
        "{title}: I/(E πR²), sr⁻¹\n  {:<12}{:>12}{:>12}{:>12}{:>12}\n",
        "", "0°", "60°", "120°", "170°"
    );
    for (i, (column, name, material)) in spheres.iter().enumerate() {
        let mut ratio = Vec::with_capacity(phases.len());
        for phase in &phases {
            let mut weights = vec![0.0; material.spectra().len()];
            material.add_sphere_weights(phase.to_radians().min(PI), 1.0, &mut weights)?;
            ratio.push(weights.iter().sum::<f64>() / PI);
        }
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
        series.push(if i < 2 {
            line.with_colour_and_dash(sunglint_report::plot::RGBColor(40, 40, 40), i)
        } else {
            line
        });
        list.push(
            json!({ "name": name, "at_0_deg": rounded(at(0.0)), "at_90_deg": rounded(at(90.0)) }),
        );
        let described = format!("{name}: I/(E pi R^2)").replace('α', "alpha");
        table.columns.push(Column::f64(column, Some("1 / sr"), ratio).described(described));
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
        json: json!({ "title": title, "unit": "1 / sr", "spheres": list }),
        ..Product::default()
    };
    args.out.finish(&product, &text, console)
}
