//! Where a light curve came from.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::path::Path;
use sunglint_formats::ParseError;

/// Where a light curve came from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Provenance {
    /// The program and its version.
    pub program: String,
    /// The command that made it.
    pub command: String,
    /// The station's name.
    pub station: String,
    /// The target: a name, a catalogue number.
    pub target: String,
    /// Files that went in.
    pub inputs: Vec<Input>,
    /// Anything else that a reader must know: zero points, models, fallbacks.
    pub notes: Vec<String>,
    /// Metadata that another version or program wrote besides, kept as they are.
    #[serde(flatten)]
    pub other: Map<String, Value>,
}

/// A file that went into a light curve.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The file as it was named.
    pub file: String,
    /// SHA-256 of its bytes, 64 hexadecimal digits.
    pub sha256: String,
}

impl Provenance {
    /// Returns the provenance as files hold it.
    pub fn to_json(&self) -> Value {
        // Maps with text keys always serialise.
        serde_json::to_value(self).unwrap_or(Value::Null)
    }

    /// Reads a file's metadata; a file without any has an unknown provenance, one that is wrong is refused.
    pub(super) fn from_json(path: &Path, value: Option<&Value>) -> Result<Self, ParseError> {
        let Some(value) = value else { return Ok(Self::default()) };
        serde_json::from_value(value.clone()).map_err(|error| {
            ParseError::new(
                path,
                error.to_string(),
                "program, command, station, target, inputs [{file, sha256}], notes [text]",
            )
            .in_field("provenance")
        })
    }
}
