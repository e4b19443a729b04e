//! Events of a session: one JSON object a line.

use crate::error::ParseError;
use crate::time::{format_utc_shortest, parse_utc};
use hifitime::Epoch;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When.
    pub utc: Epoch,
    /// The event itself, with its fields.
    pub what: What,
}

/// Kind of event. In the file the key `kind` names it (`target`, `device_lost` …), beside the keys of its fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum What {
    /// The session began.
    Start {
        /// The program and its version.
        program: String,
        /// SHA-256 of `session.toml`, in hexadecimal digits; sessions of format 1 lack it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        manifest_sha256: Option<String>,
    },
    /// The telescope goes to a target, and stays until the next such event.
    Target(Target),
    /// A device was opened and says who it is.
    Device {
        /// Name of the device in this session.
        device: String,
        /// Who it says it is: `vendor`, `model`, `serial`, `firmware`, `driver`.
        identity: Map<String, Value>,
        /// Settings of the device, read back where it can be asked: names with their units.
        settings: Map<String, Value>,
    },
    /// The session goes on after it ended, or was cut off.
    Resume {
        /// The program and its version.
        program: String,
        /// Time without a session since its last mark, s.
        gap_s: f64,
        /// Bytes of half lines that were cut off.
        cut_bytes: u64,
    },
    /// A step of a visit began.
    Step {
        /// Number of the step in the plan, from 1.
        number: u32,
    },
    /// A device was set anew, for a visit.
    Set {
        /// Name of the device in this session.
        device: String,
        /// Settings of the device, as they were asked for: names with their units.
        settings: Map<String, Value>,
    },
    /// A device failed.
    DeviceLost {
        /// Name of the device in this session.
        device: String,
        /// Error that the device reported.
        error: String,
        /// When it is tried again, s from then.
        again_in_s: f64,
    },
    /// A device works again.
    DeviceBack {
        /// Name of the device in this session.
        device: String,
        /// For how long it was away, s.
        after_s: f64,
    },
    /// How far the computer's clock is from UTC, as far as that is known.
    Clock(ClockState),
    /// The computer's clock stepped against its own monotonic clock.
    ClockStep {
        /// Size of the step, s: above zero where UTC jumped ahead.
        step_s: f64,
        /// Time that the computer's clock shows since then; the event's own time is the night's, which does not step.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        computer_utc: Option<String>,
    },
    /// The night's time follows the computer's clock after a step, because a synchronised source confirms it.
    ClockAdopted {
        /// Step of the night's time, s.
        step_s: f64,
    },
    /// The whole process stood still.
    Stall {
        /// For how long, s.
        stall_s: f64,
    },
    /// A device will not be tried again: what was asked of it cannot be.
    DeviceFailed {
        /// Name of the device in this session.
        device: String,
        /// Error that the device reported.
        error: String,
    },
    /// Frames of a camera were refused: another program uses it, or its wheel or rotator moved meanwhile; `error` says which.
    FramesRefused {
        /// Name of the device in this session.
        device: String,
        /// How many in all, so far.
        frames: u64,
        /// Difference found in the last of these frames.
        error: String,
    },
    /// Marks of how much of each file is safely on the disk from then on.
    Sync {
        /// The files that have more than at the mark before.
        files: Vec<Mark>,
    },
    /// Something could not be done, or not be written.
    Error {
        /// The file or device that it is about.
        about: String,
        /// Description of the error.
        error: String,
    },
    /// Recovery of a file or device that had failed.
    Recovered {
        /// The file or device that it is about.
        about: String,
        /// Rows or frames that were lost meanwhile.
        lost: u64,
    },
    /// Where the mount points: each second, and when its state changes.
    Mount {
        /// Name of the mount in this session.
        device: String,
        /// State: `slewing`, `waiting`, `predicted`, `searching`, `locked`, `coasting`, `stopped`, `parking` or `parked`.
        state: String,
        /// Kind of the axes: `equatorial` (hour angle, declination) or `horizontal` (azimuth, altitude).
        axes: String,
        /// Angles at which the target is believed to be, deg.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        target_deg: Option<[f64; 2]>,
        /// Angles that the mount says, deg.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        read_deg: Option<[f64; 2]>,
        /// Rates that were commanded, deg/s.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        commanded_deg_s: Option<[f64; 2]>,
        /// Distance of the mount from where the target is believed to be, arcsec.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        error_arcsec: Option<f64>,
        /// Distance of the target from where it should stand in the camera's last frame, arcsec.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seen_arcsec: Option<f64>,
        /// Learnt time by which a satellite is ahead of its prediction, s.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        ahead_s: Option<f64>,
        /// Learnt distance of a satellite to the left of its track, arcsec.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        left_arcsec: Option<f64>,
        /// Side of the pier on which a German mount hangs: `east` (it looks west) or `west`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pier: Option<String>,
        /// Whether this is a change of the state, not one of the lines of each second.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        changed: bool,
    },
    /// Somebody steered the night, or left a note in its log.
    Control {
        /// `pause`, `resume`, `skip`, `stop` or `note`.
        action: String,
        /// Text of a note; who or what asked for the rest, where that is known.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        text: String,
    },
    /// The session ended as it should.
    End {
        /// `done` or `stopped`.
        reason: String,
        /// Rows or frames that could not be written.
        lost: u64,
        /// Number of the last frame that each camera took, written or not.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        frames: BTreeMap<String, u64>,
    },
    /// Event of a kind that only a later version of the program knows.
    #[serde(skip)]
    Other {
        /// Kind of the event, as the file names it.
        kind: String,
        /// Fields of the event, as the file has them.
        fields: Map<String, Value>,
    },
}

/// How far a file is safely on the disk.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// The file within the session's folder, with `/`.
    pub file: String,
    /// Bytes of the file up to the mark.
    pub bytes: u64,
    /// Rows of the file up to the mark, without the header; for a frame its sequence number.
    pub rows: u64,
    /// CRC-32 (as zip has it) of these bytes.
    pub crc32: u32,
}

/// Kind of a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetKind {
    /// A star.
    Star,
    /// A satellite or a piece of debris.
    Satellite,
    /// Empty sky beside the target.
    Sky,
    /// No light: a cap or a shutter is closed.
    Dark,
    /// No light and no time: frames of the shortest exposure.
    Bias,
    /// Even light: the sky in twilight, or a screen.
    Flat,
    /// Nothing that was planned: the telescope may be on its way.
    None,
}

/// A target, as the plan names it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Name of the target.
    pub name: String,
    /// Kind of the target.
    pub target_kind: TargetKind,
    /// Whether there is a target in the beam: not for the sky, the dark and nothing.
    pub on: bool,
    /// Right ascension (ICRS), deg, of a star.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ra_deg: Option<f64>,
    /// Declination (ICRS), deg, of a star.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dec_deg: Option<f64>,
    /// The two lines of a satellite's elements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tle: Option<[String; 2]>,
    /// A satellite's elements as an orbit mean-elements message in KVN, where they did not come in two lines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omm: Option<String>,
}

impl Target {
    /// A target that is neither a star nor a satellite.
    pub fn off(kind: TargetKind) -> Self {
        let name = match kind {
            TargetKind::Sky => "sky",
            TargetKind::Dark => "dark",
            TargetKind::Bias => "bias",
            TargetKind::Flat => "flat",
            _ => "none",
        };
        let (ra_deg, dec_deg, tle, omm) = (None, None, None, None);
        Self { name: name.into(), target_kind: kind, on: false, ra_deg, dec_deg, tle, omm }
    }

    /// The text of a satellite's elements, in the form in which they came.
    pub fn elements(&self) -> Option<String> {
        match (&self.tle, &self.omm) {
            (Some([line1, line2]), _) => Some(format!("{line1}\n{line2}\n")),
            (None, omm) => omm.clone(),
        }
    }
}

/// How far the computer's clock is from UTC, and who says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClockState {
    /// Who says so (`adjtimex`, `none`), in a word.
    pub method: String,
    /// Whether the clock follows UTC, as far as is known.
    pub synchronised: Option<bool>,
    /// The clock minus UTC, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_s: Option<f64>,
    /// The largest error that whoever says so grants, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error_s: Option<f64>,
}

const UTC: &str = "utc";
const KIND: &str = "kind";

impl Event {
    /// The event as one line, its end included.
    pub fn to_line(&self) -> String {
        let mut line = Map::new();
        line.insert(UTC.into(), format_utc_shortest(self.utc).into());
        match &self.what {
            What::Other { kind, fields } => {
                line.insert(KIND.into(), kind.clone().into());
                line.extend(fields.clone());
            }
            // Maps, numbers and texts: nothing that JSON lacks. A number that is not finite becomes null.
            what => {
                if let Ok(Value::Object(fields)) = serde_json::to_value(what) {
                    line.extend(fields);
                }
            }
        }
        let mut line = Value::Object(line).to_string();
        line.push('\n');
        line
    }

    /// The event in a line; `path` names the file in errors. Kinds that are not known become [`What::Other`].
    ///
    /// # Errors
    /// A [`ParseError`] with the field: no JSON object, no time, fields that a known kind has not.
    pub fn from_line(path: impl AsRef<Path>, line: &str) -> Result<Self, ParseError> {
        Self::from_line_at(path.as_ref(), line)
    }

    fn from_line_at(path: &Path, line: &str) -> Result<Self, ParseError> {
        let bad = |found: String, expected: &str| ParseError::new(path, found, expected);
        let parsed: Value = serde_json::from_str(line).map_err(|e| {
            bad(crate::error::excerpt(line), "a JSON object").with_hint(e.to_string())
        })?;
        let Value::Object(mut fields) = parsed else {
            return Err(bad(crate::error::excerpt(line), "a JSON object"));
        };
        let missing = |key: &str| bad("no such text".into(), "a text").in_field(key);
        let utc = fields.shift_remove(UTC).ok_or_else(|| missing(UTC))?;
        let utc = utc.as_str().ok_or_else(|| missing(UTC))?;
        let utc = parse_utc(utc).map_err(|error| error.in_file(path).in_field(UTC))?;
        let kind = fields.get(KIND).and_then(Value::as_str).ok_or_else(|| missing(KIND))?;
        let what = if KINDS.contains(&kind) {
            let kind = kind.to_owned();
            serde_json::from_value(Value::Object(fields))
                .map_err(|e| bad(e.to_string(), "the fields of its kind").in_field(kind))?
        } else {
            let kind = kind.to_owned();
            fields.shift_remove(KIND);
            What::Other { kind, fields }
        };
        Ok(Self { utc, what })
    }
}

const KINDS: [&str; 20] = [
    "start",
    "target",
    "device",
    "set",
    "resume",
    "step",
    "device_lost",
    "device_back",
    "clock",
    "clock_step",
    "clock_adopted",
    "stall",
    "device_failed",
    "frames_refused",
    "sync",
    "error",
    "recovered",
    "mount",
    "control",
    "end",
];
