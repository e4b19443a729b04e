//! The nights of a folder: which passes are there, and several as one curve.

use crate::product::Outcome;
use crate::watch::{Failure, run};
use crate::workflows::{moment, unknown};
use pyo3::prelude::*;
use std::path::PathBuf;
use sunglint_archive::file::Kind;
use sunglint_archive::{Found, Index, Query, join};
use sunglint_report::Product;

/// Conditions, as Python names them.
#[derive(Debug, FromPyObject)]
#[pyo3(from_item_all)]
struct Wanted {
    object: Option<String>,
    channel: Vec<String>,
    kind: Vec<String>,
    station: Option<String>,
    start: Option<String>,
    end: Option<String>,
    phase_below_deg: Option<f64>,
    phase_above_deg: Option<f64>,
    min_samples: Option<u32>,
}

impl Wanted {
    fn query(self) -> Result<Query, Failure> {
        let mut kinds = Vec::new();
        for name in &self.kind {
            let known = "recorded, raw, linear, calibrated, predicted or magnitudes";
            kinds.push(Kind::of(name).ok_or_else(|| unknown("kind", name, known))?);
        }
        let query = Query {
            object: self.object,
            channels: self.channel,
            kinds,
            station: self.station,
            from: moment("start", self.start.as_deref())?,
            to: moment("end", self.end.as_deref())?,
            phase_below_deg: self.phase_below_deg,
            phase_above_deg: self.phase_above_deg,
            min_samples: self.min_samples,
        };
        query.check()?;
        Ok(query)
    }
}

fn outcome(found: &Found, product: Product) -> Outcome {
    let damaged = found.damaged.iter();
    let mut warnings = found.warnings.clone();
    warnings.extend(damaged.map(|d| format!("{} is damaged and left out: {}", d.file, d.why)));
    Outcome::new(product, found.text(), warnings)
}

/// Brings the index up to date and asks it; with `as_curve` the light of the passes as one curve.
#[pyfunction]
#[pyo3(signature = (folder, wanted, index=None, fresh=false, as_curve=false, progress=None))]
fn archive(
    py: Python<'_>,
    folder: PathBuf,
    wanted: Wanted,
    index: Option<PathBuf>,
    fresh: bool,
    as_curve: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch| {
        let query = wanted.query()?;
        let mut index = Index::open(&folder, index.as_deref())?;
        index.update(fresh, watch)?;
        let mut found = query.ask(&index);
        let json = serde_json::to_value(&found)?;
        let (name, table) = match as_curve {
            true => {
                let joined = join::join(&found, &query, index.root())?;
                found.warnings.extend(joined.warnings);
                ("archive_curve", joined.table)
            }
            false => ("archive", found.table()),
        };
        let product = Product { name: name.into(), table, json, ..Product::default() };
        Ok(outcome(&found, product))
    })
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(archive, module)?)
}
