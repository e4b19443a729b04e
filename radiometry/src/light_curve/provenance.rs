//! Where a light curve came from.

use serde_json::{Value, json};

/// Where a light curve came from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Provenance {
    /// The program and its version.
    pub program: String,
    /// The command that made it.
    pub command: String,
    /// The station's name.
    pub station: String,
    /// The target: a name, a catalogue number.
    pub target: String,
    /// Files that went in, with their SHA-256.
    pub inputs: Vec<(String, String)>,
    /// Anything else that a reader must know: zero points, models, fallbacks.
    pub notes: Vec<String>,
}

impl Provenance {
    pub(crate) fn to_json(&self) -> Value {
        let inputs: serde_json::Map<String, Value> =
            self.inputs.iter().map(|(file, sha256)| (file.clone(), json!(sha256))).collect();
        json!({
            "program": self.program, "command": self.command, "station": self.station, "target": self.target,
            "inputs_sha256": inputs, "notes": self.notes,
        })
    }

    pub(crate) fn from_json(value: Option<&Value>) -> Self {
        let text = |key: &str| {
            value.and_then(|v| v.get(key)).and_then(Value::as_str).unwrap_or_default().to_owned()
        };
        let strings = |v: &Value| v.as_str().unwrap_or_default().to_owned();
        let inputs = value.and_then(|v| v.get("inputs_sha256")).and_then(Value::as_object);
        let notes = value.and_then(|v| v.get("notes")).and_then(Value::as_array);
        Self {
            program: text("program"),
            command: text("command"),
            station: text("station"),
            target: text("target"),
            inputs: inputs
                .map(|m| m.iter().map(|(k, v)| (k.clone(), strings(v))).collect())
                .unwrap_or_default(),
            notes: notes.map(|n| n.iter().map(strings).collect()).unwrap_or_default(),
        }
    }
}
