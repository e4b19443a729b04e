//! Report of the confusion of materials.

use crate::plot::{Axis, Heat, Panel};
use crate::{json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_inference::unmix::MaterialConfusion;

/// Text of the matrix.
pub(super) fn text(told: &MaterialConfusion) -> String {
    let c = &told.confusion;
    let mut text = format!(
        "  confusion of {} samples: of the light that is a row's in truth (the scene simulated), the part that a column was said to have\n",
        c.samples
    );
    let _ = write!(text, "  {:<20}", "");
    for name in &told.names {
        let _ = write!(text, " {name:>12}");
    }
    text.push('\n');
    for (name, row) in told.names.iter().zip(c.matrix.rows()) {
        let _ = write!(text, "  {name:<20}");
        for value in row {
            let value = if value.is_finite() { format!("{value:.4}") } else { "-".into() };
            let _ = write!(text, " {value:>12}");
        }
        text.push('\n');
    }
    text
}

#[derive(Serialize)]
struct ConfusionJson<'a> {
    materials: &'a [String],
    matrix: Vec<Vec<f64>>,
    worst: f64,
    samples: usize,
    left_out_samples: usize,
    other_light: f64,
}

/// Summary with its documented keys.
pub(super) fn json(told: &MaterialConfusion) -> Value {
    let rows = told.confusion.matrix.rows().into_iter();
    json_of(&ConfusionJson {
        materials: &told.names,
        matrix: rows.map(|r| r.iter().map(|v| rounded(*v)).collect::<Vec<_>>()).collect(),
        worst: rounded(told.confusion.worst()),
        samples: told.confusion.samples,
        left_out_samples: told.confusion.left_out,
        other_light: rounded(told.others),
    })
}

/// Panel of the matrix. Rows from the bottom, as everywhere in figures.
pub(super) fn panel(told: &MaterialConfusion) -> Panel {
    let n = told.names.len();
    let edges: Vec<f64> = (0..=n).map(|i| i as f64 + 0.5).collect();
    let cells = (0..n).flat_map(|found| (0..n).map(move |truth| (truth, found)));
    let numbered: Vec<String> =
        told.names.iter().enumerate().map(|(k, name)| format!("{} {name}", k + 1)).collect();
    let heat = Heat {
        x_edges: edges.clone(),
        y_edges: edges,
        values: cells.map(|cell| told.confusion.matrix[cell]).collect(),
        label: vec!["part of".into(), "the light".into()],
        decades: None,
    };
    let x = Axis::linear(format!("found: {}", numbered.join(", ")));
    Panel { heat: Some(heat), ..Panel::new(x, Axis::linear("in truth"), vec![]) }
}
