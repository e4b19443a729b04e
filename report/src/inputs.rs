//! The files that went into a result.

use crate::json_of;
use serde_json::Value;
use sunglint_radiometry::light_curve::Input;

/// A list of files with their hashes.
pub(crate) fn json(inputs: &[Input]) -> Value {
    json_of(inputs)
}
