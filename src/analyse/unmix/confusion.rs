//! The shares that were found beside those that a scene's own light has.

use super::super::numbers::Curve;
use anyhow::bail;
use ndarray::Array2;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_analysis::unmix::{Confusion, Unmixed};
use sunglint_report::plot::{Axis, Heat, Panel};
use sunglint_report::rounded;
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::Pass;

/// How the endmembers are taken for one another.
pub struct Told {
    confusion: Confusion,
    names: Vec<String>,
    /// The part of the scene's light that is of none of them.
    pub others: f64,
}

impl Told {
    /// The scene simulated at the curve's times (direct sunlight), its materials' light beside the shares that were found. An endmember is a material by its name.
    pub fn of(
        pass: &Pass,
        curve: &Curve,
        names: &[String],
        found: &[Unmixed],
    ) -> anyhow::Result<Self> {
        let known: Vec<&str> = pass.target.materials.iter().map(|m| m.name.as_str()).collect();
        if let Some(other) = names.iter().find(|n| !known.contains(&n.as_str())) {
            bail!(
                "--confusion: the scene's target {} has no material {other} (it has {}): endmembers have to be the target's own",
                pass.target.name,
                known.join(", ")
            );
        }
        let mut pass = pass.clone();
        pass.times.clone_from(&curve.samples().time);
        pass.exposure_s.clone_from(&curve.samples().exposure_s);
        pass.effects = Switches::OFF;
        let simulation = pass.simulate(&|_| ())?;
        let mut truth = Array2::from_elem((found.len(), names.len()), f64::NAN);
        let (mut all, mut theirs) = (0.0, 0.0);
        for (i, weights) in simulation.weights.rows().into_iter().enumerate() {
            let of = |name: &String| -> f64 {
                let terms = weights.iter().zip(&simulation.weight_materials);
                terms.filter(|(_, material)| *material == name).map(|(w, _)| w).sum()
            };
            let light: Vec<f64> = names.iter().map(of).collect();
            let sum: f64 = light.iter().sum();
            all += weights.sum();
            theirs += sum;
            if sum > 0.0 {
                truth.row_mut(i).assign(&ndarray::Array1::from_iter(light.iter().map(|l| l / sum)));
            }
        }
        let share = |(i, m): (usize, usize)| {
            found[i].mixture.as_ref().map_or(f64::NAN, |mixture| mixture.shares[m])
        };
        let shares = Array2::from_shape_fn(truth.dim(), share);
        let confusion = Confusion::of(truth.view(), shares.view())?;
        if confusion.samples == 0 {
            bail!("--confusion: no sample has both shares and light of the scene's materials");
        }
        let others = if all > 0.0 { 1.0 - theirs / all } else { 0.0 };
        Ok(Self { confusion, names: names.to_vec(), others })
    }

    pub fn text(&self) -> String {
        let c = &self.confusion;
        let mut text = format!(
            "  confusion of {} samples: of the light that is a row's in truth (the scene simulated), the part that a column was said to have\n",
            c.samples
        );
        let _ = write!(text, "  {:<20}", "");
        for name in &self.names {
            let _ = write!(text, " {name:>12}");
        }
        text.push('\n');
        for (name, row) in self.names.iter().zip(c.matrix.rows()) {
            let _ = write!(text, "  {name:<20}");
            for value in row {
                let value = if value.is_finite() { format!("{value:.4}") } else { "-".into() };
                let _ = write!(text, " {value:>12}");
            }
            text.push('\n');
        }
        text
    }

    pub fn json(&self) -> Value {
        let number = |v: &f64| if v.is_finite() { json!(rounded(*v)) } else { Value::Null };
        let rows = self.confusion.matrix.rows().into_iter();
        json!({
            "materials": self.names,
            "matrix": rows.map(|r| r.iter().map(number).collect::<Vec<_>>()).collect::<Vec<_>>(),
            "worst": number(&self.confusion.worst()),
            "samples": self.confusion.samples,
            "left_out_samples": self.confusion.left_out,
            "other_light": rounded(self.others),
        })
    }

    /// Rows from the bottom, as everywhere in figures.
    pub fn panel(&self) -> Panel {
        let n = self.names.len();
        let edges: Vec<f64> = (0..=n).map(|i| i as f64 + 0.5).collect();
        let cells = (0..n).flat_map(|found| (0..n).map(move |truth| (truth, found)));
        let numbered: Vec<String> =
            self.names.iter().enumerate().map(|(k, name)| format!("{} {name}", k + 1)).collect();
        let heat = Heat {
            x_edges: edges.clone(),
            y_edges: edges,
            values: cells.map(|cell| self.confusion.matrix[cell]).collect(),
            label: vec!["part of".into(), "the light".into()],
            decades: None,
        };
        let x = Axis::linear(format!("found: {}", numbered.join(", ")));
        Panel { heat: Some(heat), ..Panel::new(x, Axis::linear("in truth"), vec![]) }
    }
}
