//! `session.toml`: what a session is, written once at its start.

use super::event::ClockState;
use crate::error::{FileError, ParseError, nearest_names};
use crate::time::{format_utc_shortest, parse_utc};
use crate::toml::Document;
use hifitime::Epoch;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::path::Path;

/// The version of the folder's format that this program writes.
pub const FORMAT: &str = "sunglint session 2";
/// The version before, which it reads: without a sum of the manifest and a mark of the log's end.
const FORMER: &str = "sunglint session 1";

/// Manifest of a session: format, program, station, start, clock, devices and configuration files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// The program and its version.
    pub program: String,
    /// The station's name.
    pub station: String,
    /// When the session began.
    #[serde(with = "utc")]
    pub start_utc: Epoch,
    /// How far the computer's clock was from UTC at the start.
    pub clock: ClockState,
    /// The devices, as the plan names them. Who they say they are, and how they were set, is in the event log (`device`).
    #[serde(rename = "device", default)]
    pub devices: Vec<Device>,
    /// The files of the configuration as used.
    #[serde(rename = "file", default)]
    pub files: Vec<FileSum>,
}

/// Kind of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceKind {
    /// Takes frames.
    Camera,
    /// Counts photons.
    Counter,
    /// Turns filters into the beam; where it stood is in the headers of the frames.
    Wheel,
    /// Turns the camera.
    Rotator,
    /// Points the telescope; where it pointed is in the event log.
    Mount,
}

/// A device, as the plan names it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Device {
    /// Name of the device in this session: of its folder or file.
    pub name: String,
    /// Kind of the device.
    pub kind: DeviceKind,
    /// Where it is: `DRIVER[:WHERE]`.
    pub address: String,
    /// Options that its driver was given, `NAME=VALUE` each.
    #[serde(default)]
    pub options: Vec<String>,
    /// The channels of a counter.
    #[serde(default)]
    pub channels: Vec<String>,
    /// The hardware input that each channel is on, as its raw tags name it: one for each, or none where that is not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<i32>,
    /// Whether a counter's raw tags are recorded.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub raw_tags: bool,
    /// Exposure of a camera's frames, or length of a counter's bins, s; 0 of what takes neither.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub exposure_s: f64,
    /// Time from the start of one frame to that of the next, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval_s: Option<f64>,
    /// The filter before a camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<String>,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A file of the configuration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileSum {
    /// The file within the session's folder, with `/`.
    pub path: String,
    /// SHA-256 of its bytes, in hexadecimal digits.
    pub sha256: String,
}

impl FileSum {
    /// The sum of a file's bytes.
    pub fn of(path: impl Into<String>, bytes: &[u8]) -> Self {
        Self { path: path.into(), sha256: hex(&Sha256::digest(bytes)) }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Manifest {
    /// Reads `session.toml`.
    ///
    /// # Errors
    /// The system's, or a [`ParseError`]: another version of the format, a key that is missing or unknown.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_at(path.as_ref())
    }

    fn read_at(path: &Path) -> Result<Self, FileError> {
        let document = Document::read(path)?;
        /// The format's key alone, which manifests of any version have.
        #[derive(Deserialize)]
        struct Version {
            format: String,
        }
        let version: Version = document.parse()?;
        if ![FORMAT, FORMER].contains(&version.format.as_str()) {
            let hint = "a later version of the program wrote it: read it with that";
            let error = document.error_at("format", format!("`{FORMAT}`")).with_hint(hint);
            return Err(error.into());
        }
        let manifest: Self = document.parse()?;
        for (i, device) in manifest.devices.iter().enumerate() {
            if !is_name(&device.name) || manifest.devices[..i].iter().any(|o| o.name == device.name)
            {
                let key = format!("device[{i}].name");
                return Err(document.error_at(&key, NAMES).into());
            }
            if !device.inputs.is_empty() && device.inputs.len() != device.channels.len() {
                let expected = format!("one for each of the {} channels", device.channels.len());
                return Err(document.error_at(&format!("device[{i}].inputs"), expected).into());
            }
        }
        Ok(manifest)
    }

    /// Returns true where the session's files say enough to find a change in any of them: those of format 2 do.
    pub fn is_sealed(&self) -> bool {
        self.format != FORMER
    }

    /// The text of `session.toml`.
    pub fn to_text(&self) -> Result<String, crate::EncodeError> {
        toml::to_string(self)
            .map_err(|e| crate::EncodeError::new("session.toml", e.to_string(), "TOML"))
    }

    /// The devices of a kind.
    pub fn devices_of(&self, kind: DeviceKind) -> impl Iterator<Item = &Device> {
        self.devices.iter().filter(move |device| device.kind == kind)
    }

    /// The device of that name and kind.
    ///
    /// # Errors
    /// No such device, with the nearest name. `path` names the session.
    pub fn device(&self, path: &Path, kind: DeviceKind, name: &str) -> Result<&Device, ParseError> {
        self.devices_of(kind).find(|device| device.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.devices_of(kind).map(|d| d.name.as_str()).collect();
            let expected = match names.as_slice() {
                [] => "no name: this session has no such device".to_owned(),
                names => format!("one of {}", names.join(", ")),
            };
            let what = if kind == DeviceKind::Camera { "camera" } else { "counter" };
            let error = ParseError::new(path, format!("`{name}`"), expected).in_field(what);
            match nearest_names(name, names, 1).first() {
                Some(near) => error.with_hint(format!("did you mean `{near}`?")),
                None => error,
            }
        })
    }
}

const NAMES: &str = "a name of its own out of letters, digits, - and _ (it names a file)";

/// Whether a device may have that name: it becomes the name of a file.
pub fn is_name(name: &str) -> bool {
    let good = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    !name.is_empty() && name.len() <= 64 && !name.starts_with('-') && name.chars().all(good)
}

/// UTC as text.
mod utc {
    use super::{Epoch, format_utc_shortest, parse_utc};
    use serde::{Deserialize as _, Deserializer, Serializer, de::Error as _};

    pub fn serialize<S: Serializer>(epoch: &Epoch, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&format_utc_shortest(*epoch))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Epoch, D::Error> {
        let text = String::deserialize(from)?;
        parse_utc(&text).map_err(|error| D::Error::custom(error.to_string()))
    }
}
