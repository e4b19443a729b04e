//! The files that went into a result.

use serde_json::{Value, json};
use sunglint_radiometry::light_curve::Input;

/// A list of files with their hashes.
pub(crate) fn json(inputs: &[Input]) -> Value {
    inputs.iter().map(|i| json!({ "file": i.file, "sha256": i.sha256 })).collect()
}
