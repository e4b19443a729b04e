//! Light curves: the one schema in which measured and simulated light meet.
//!
//! Hz at the detector, after the air, per channel, with uncertainty and flags. Only *calibrated* (κ·ν) and *predicted* (ν̂) curves are
//! compared with one another. In a file (ECSV): `time_utc` (ISO 8601, mid-exposure), `exposure_s`, per channel `<ch>_rate_hz`,
//! `<ch>_sigma_hz`, `<ch>_flags`; optional `range_m`, `phase_deg`, `zenith_deg`; in the metadata `quantity`, `flag_bits`, `provenance`.

use crate::flags::Flags;
use hifitime::Epoch;
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{Column, ParseError, Table, Values, nearest_names};

/// How far the rates of a light curve have come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RateKind {
    /// As counted: dead time and background included.
    Raw,
    /// Linearised, background subtracted.
    Linear,
    /// Times the night's coefficient κ: comparable with a prediction.
    Calibrated,
    /// Simulated: comparable with a calibrated curve.
    Predicted,
}

impl RateKind {
    const ALL: [(RateKind, &'static str); 4] = [
        (RateKind::Raw, "raw"),
        (RateKind::Linear, "linear"),
        (RateKind::Calibrated, "calibrated"),
        (RateKind::Predicted, "predicted"),
    ];
}

impl fmt::Display for RateKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::ALL.iter().find(|(kind, _)| kind == self).map_or("", |(_, name)| name);
        f.write_str(name)
    }
}

impl FromStr for RateKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .iter()
            .find(|(_, name)| *name == text)
            .map(|(kind, _)| *kind)
            .ok_or_else(|| "raw, linear, calibrated or predicted".to_owned())
    }
}

/// The samples of one channel; all of one length, that of the curve.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelCurve {
    /// The channel's name in its station: letters, digits and `_`.
    pub name: String,
    /// Rate at the detector, Hz; `NaN` only where a flag says why.
    pub rate_hz: Vec<f64>,
    /// Standard uncertainty of the rate, Hz; `NaN` only where a flag says why.
    pub sigma_hz: Vec<f64>,
    /// What there is to say of each sample.
    pub flags: Vec<Flags>,
}

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

/// A light curve.
#[derive(Debug, Clone, PartialEq)]
pub struct LightCurve {
    /// How far the rates have come.
    pub kind: RateKind,
    /// Mid-exposure times.
    pub time: Vec<Epoch>,
    /// Exposure times, s, each above 0.
    pub exposure_s: Vec<f64>,
    /// The channels.
    pub channels: Vec<ChannelCurve>,
    /// Distance from station to target, m.
    pub range_m: Option<Vec<f64>>,
    /// Phase angle, Sun–target–station, degrees 0–180.
    pub phase_deg: Option<Vec<f64>>,
    /// True zenith angle of the target, degrees 0–180.
    pub zenith_deg: Option<Vec<f64>>,
    /// Where the curve came from.
    pub provenance: Provenance,
}

impl LightCurve {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&ChannelCurve> {
        self.channels.iter().find(|c| c.name == name)
    }

    /// The curve as a table of the schema, ready to be written as ECSV. Errors as [`LightCurve::from_table`]: what could not be read back is
    /// not written.
    pub fn to_table(&self) -> Result<Table, ParseError> {
        let mut table = Table::default();
        table.meta.insert("quantity".into(), json!(self.kind.to_string()));
        table.meta.insert("flag_bits".into(), Flags::bit_names());
        table.meta.insert("provenance".into(), self.provenance.to_json());
        let times = self.time.iter().map(|t| format_utc(*t, 9)).collect();
        let mut time = Column::text("time_utc", times);
        time.description = Some("mid-exposure, ISO 8601".into());
        table.columns.push(time);
        table.columns.push(Column::f64("exposure_s", Some("s"), self.exposure_s.clone()));
        for channel in &self.channels {
            let name = &channel.name;
            let rate = Column::f64(format!("{name}_rate_hz"), Some("Hz"), channel.rate_hz.clone());
            let sigma =
                Column::f64(format!("{name}_sigma_hz"), Some("Hz"), channel.sigma_hz.clone());
            let bits = channel.flags.iter().map(|f| Some(i64::from(f.bits()))).collect();
            let flags = Column {
                name: format!("{name}_flags"),
                unit: None,
                description: None,
                values: Values::I64(bits),
            };
            table.columns.extend([rate, sigma, flags]);
        }
        for (name, unit, values) in [
            ("range_m", "m", &self.range_m),
            ("phase_deg", "deg", &self.phase_deg),
            ("zenith_deg", "deg", &self.zenith_deg),
        ] {
            if let Some(values) = values {
                table.columns.push(Column::f64(name, Some(unit), values.clone()));
            }
        }
        self.check(Path::new("light curve"))?;
        Ok(table)
    }

    /// A curve from a table of the schema. `path` names the file in errors: a column that the schema does not know, a channel that is not
    /// whole, a sample that is no number and not flagged, an exposure that is not above 0.
    pub fn from_table(path: impl AsRef<Path>, table: &Table) -> Result<Self, ParseError> {
        let path = path.as_ref();
        let kind = match table.meta_text("quantity") {
            Some(text) => text.parse().map_err(|expected: String| {
                ParseError::new(path, format!("`{text}`"), expected).in_field("quantity")
            })?,
            None => {
                return Err(ParseError::new(
                    path,
                    "no metadata `quantity`",
                    "raw, linear, calibrated or predicted",
                )
                .in_field("quantity")
                .with_hint("is this a light curve of the sunglint schema?"));
            }
        };
        let reader = Reader { path, table };
        let time = reader.times("time_utc")?;
        let exposure_s = reader.numbers("exposure_s")?;
        let bits = Flags::numbering(path, table.meta.get("flag_bits"))?;
        let mut channels = Vec::new();
        for column in &table.columns {
            if let Some(name) = column.name.strip_suffix("_rate_hz") {
                let flags = reader.flags(&format!("{name}_flags"), &bits)?;
                channels.push(ChannelCurve {
                    name: name.to_owned(),
                    rate_hz: reader.numbers(&column.name)?,
                    sigma_hz: reader.numbers(&format!("{name}_sigma_hz"))?,
                    flags,
                });
            }
        }
        reader.refuse_unknown(&channels)?;
        let curve = Self {
            kind,
            time,
            exposure_s,
            channels,
            range_m: reader.optional("range_m")?,
            phase_deg: reader.optional("phase_deg")?,
            zenith_deg: reader.optional("zenith_deg")?,
            provenance: Provenance::from_json(table.meta.get("provenance")),
        };
        curve.check(path)?;
        Ok(curve)
    }

    /// What every curve must hold, read or made.
    fn check(&self, path: &Path) -> Result<(), ParseError> {
        let n = self.len();
        let wrong = |field: String, found: String, expected: &str| {
            Err(ParseError::new(path, found, expected).in_field(field))
        };
        let optional = [
            ("range_m", &self.range_m),
            ("phase_deg", &self.phase_deg),
            ("zenith_deg", &self.zenith_deg),
        ];
        let mut lengths = vec![("exposure_s".to_owned(), self.exposure_s.len())];
        lengths.extend(
            optional
                .iter()
                .filter_map(|(name, v)| v.as_ref().map(|v| ((*name).to_owned(), v.len()))),
        );
        for channel in &self.channels {
            lengths.push((format!("{}_rate_hz", channel.name), channel.rate_hz.len()));
            lengths.push((format!("{}_sigma_hz", channel.name), channel.sigma_hz.len()));
            lengths.push((format!("{}_flags", channel.name), channel.flags.len()));
        }
        if let Some((field, length)) = lengths.into_iter().find(|(_, length)| *length != n) {
            return wrong(field, format!("{length} values"), &format!("{n}, as many as time_utc"));
        }
        let bad =
            |values: &[f64], good: &dyn Fn(f64) -> bool| values.iter().position(|v| !good(*v));
        if let Some(i) = bad(&self.exposure_s, &|s| s.is_finite() && s > 0.0) {
            return wrong(row("exposure_s", i), self.exposure_s[i].to_string(), "a time above 0 s");
        }
        for (name, values) in optional {
            let Some(values) = values else { continue };
            let (most, expected) = match name {
                "range_m" => (f64::INFINITY, "a distance above 0 m"),
                _ => (180.0, "an angle from 0 to 180 degrees"),
            };
            let good =
                |v: f64| v.is_finite() && v <= most && (v > 0.0 || v == 0.0 && name != "range_m");
            if let Some(i) = bad(values, &good) {
                return wrong(row(name, i), values[i].to_string(), expected);
            }
        }
        for channel in &self.channels {
            let name = &channel.name;
            if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                return wrong(
                    "channel".into(),
                    format!("`{name}`"),
                    "a name of letters, digits and _",
                );
            }
            for i in 0..n {
                let (rate, sigma) = (channel.rate_hz[i], channel.sigma_hz[i]);
                let flagged = !channel.flags[i].is_empty();
                if !(rate.is_finite() || flagged && rate.is_nan()) {
                    let expected = "a number (nan only where a flag says why)";
                    return wrong(row(&format!("{name}_rate_hz"), i), rate.to_string(), expected);
                }
                if !(sigma.is_finite() && sigma >= 0.0 || flagged && sigma.is_nan()) {
                    let expected = "a number not below 0 (nan only where a flag says why)";
                    return wrong(row(&format!("{name}_sigma_hz"), i), sigma.to_string(), expected);
                }
            }
        }
        Ok(())
    }
}

fn row(column: &str, i: usize) -> String {
    format!("{column}, row {}", i + 1)
}

/// Reads columns of a table, with the file's name in the errors.
pub(crate) struct Reader<'a> {
    pub path: &'a Path,
    pub table: &'a Table,
}

impl Reader<'_> {
    fn column(&self, name: &str) -> Result<&Values, ParseError> {
        self.table.column(name).map(|c| &c.values).map_err(|_| {
            let found: Vec<&str> = self.table.columns.iter().map(|c| c.name.as_str()).collect();
            let error = ParseError::new(self.path, "no such column", format!("a column `{name}`"))
                .in_field(name);
            match nearest_names(name, found.iter().copied(), 1).first() {
                Some(near) => error.with_hint(format!("the nearest is `{near}`")),
                None => error,
            }
        })
    }

    pub fn numbers(&self, name: &str) -> Result<Vec<f64>, ParseError> {
        match self.column(name)? {
            Values::F64(values) => Ok(values.clone()),
            Values::I64(values) => {
                Ok(values.iter().map(|v| v.map_or(f64::NAN, |v| v as f64)).collect())
            }
            other => Err(ParseError::new(self.path, other.kind(), "numbers").in_field(name)),
        }
    }

    pub fn optional(&self, name: &str) -> Result<Option<Vec<f64>>, ParseError> {
        match self.table.column(name) {
            Ok(_) => self.numbers(name).map(Some),
            Err(_) => Ok(None),
        }
    }

    pub fn times(&self, name: &str) -> Result<Vec<Epoch>, ParseError> {
        let Values::Text(values) = self.column(name)? else {
            return Err(
                ParseError::new(self.path, "numbers", "times as text, ISO 8601").in_field(name)
            );
        };
        let time = |(i, text): (usize, &Option<String>)| {
            let text = text.as_deref().unwrap_or("");
            parse_utc(text).map_err(|error| {
                ParseError::new(
                    self.path,
                    format!("`{text}`"),
                    "a time such as 2026-11-20T18:30:00.5",
                )
                .in_field(row(name, i))
                .with_hint(error.to_string())
            })
        };
        values.iter().enumerate().map(time).collect()
    }

    pub fn flags(&self, name: &str, bits: &[Flags]) -> Result<Vec<Flags>, ParseError> {
        let Values::I64(values) = self.column(name)? else {
            return Err(ParseError::new(self.path, "no whole numbers", "flag bits").in_field(name));
        };
        let read = |(i, value): (usize, &Option<i64>)| {
            value.and_then(|v| Flags::renumbered(v, bits)).ok_or_else(|| {
                let found = value.map_or_else(|| "nothing".to_owned(), |v| v.to_string());
                ParseError::new(self.path, found, "bits that flag_bits in the metadata names")
                    .in_field(row(name, i))
            })
        };
        values.iter().enumerate().map(read).collect()
    }

    fn refuse_unknown(&self, channels: &[ChannelCurve]) -> Result<(), ParseError> {
        let mut known: Vec<String> =
            ["time_utc", "exposure_s", "range_m", "phase_deg", "zenith_deg"]
                .map(str::to_owned)
                .to_vec();
        for channel in channels {
            known.extend(
                ["rate_hz", "sigma_hz", "flags"].map(|suffix| format!("{}_{suffix}", channel.name)),
            );
        }
        match self.table.columns.iter().find(|c| !known.contains(&c.name)) {
            None => Ok(()),
            Some(column) => {
                let error =
                    ParseError::new(self.path, "an unknown column", "the columns of a light curve")
                        .in_field(column.name.clone());
                Err(
                    match nearest_names(&column.name, known.iter().map(String::as_str), 1).first() {
                        Some(near) => error.with_hint(format!("did you mean `{near}`?")),
                        None => error,
                    },
                )
            }
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn curve() -> LightCurve {
        let time = ["2016-12-31T23:59:59.5", "2016-12-31T23:59:60.5", "2017-01-01T00:00:00.5"]
            .map(|t| parse_utc(t).unwrap());
        LightCurve {
            kind: RateKind::Calibrated,
            time: time.to_vec(),
            exposure_s: vec![0.1; 3],
            channels: vec![ChannelCurve {
                name: "spcm".into(),
                rate_hz: vec![1e5, f64::NAN, 0.0],
                sigma_hz: vec![300.0, f64::NAN, 3.25],
                flags: vec![Flags::empty(), Flags::SATURATED | Flags::OFF_AXIS, Flags::empty()],
            }],
            range_m: Some(vec![1e6, 1.1e6, 1.2e6]),
            phase_deg: Some(vec![0.0, 90.0, 180.0]),
            zenith_deg: None,
            provenance: Provenance {
                program: "sunglint 0.1.0".into(),
                inputs: vec![("night.toml".into(), "ab".into())],
                notes: vec!["zero point: Vega = 0.03".into()],
                ..Provenance::default()
            },
        }
    }

    #[test]
    fn a_curve_survives_its_file_leap_second_and_flags_included() {
        let table = curve().to_table().unwrap();
        let text = sunglint_formats::ecsv::to_string(&table).unwrap();
        assert!(text.contains("2016-12-31T23:59:60.5"), "{text}");
        let back = sunglint_formats::ecsv::read_str("curve.ecsv", &text).unwrap();
        let back = LightCurve::from_table("curve.ecsv", &back).unwrap();
        // NaN is not equal to itself: compare what is printed.
        assert_eq!(format!("{back:?}"), format!("{:?}", curve()));
    }

    #[test]
    fn what_cannot_be_right_is_refused() {
        let message = |change: &dyn Fn(&mut LightCurve)| {
            let mut curve = curve();
            change(&mut curve);
            curve.to_table().unwrap_err().to_string()
        };
        assert_eq!(
            message(&|c| c.channels[0].rate_hz[0] = f64::NAN),
            "light curve: spcm_rate_hz, row 1: found NaN, expected a number (nan only where a flag says why)"
        );
        assert_eq!(
            message(&|c| c.channels[0].rate_hz[1] = f64::INFINITY),
            "light curve: spcm_rate_hz, row 2: found inf, expected a number (nan only where a flag says why)"
        );
        assert_eq!(
            message(&|c| c.exposure_s[2] = 0.0),
            "light curve: exposure_s, row 3: found 0, expected a time above 0 s"
        );
        assert!(message(&|c| c.channels[0].sigma_hz[2] = -1.0).contains("sigma_hz, row 3"));
        assert!(
            message(&|c| c.phase_deg = Some(vec![0.0, 181.0, 0.0])).contains("phase_deg, row 2")
        );
        assert!(
            message(&|c| c.range_m = Some(vec![1.0]))
                .contains("range_m: found 1 values, expected 3")
        );
    }

    #[test]
    fn a_file_that_is_no_curve_is_refused() {
        let refuse = |change: &dyn Fn(&mut Table)| {
            let mut table = curve().to_table().unwrap();
            change(&mut table);
            LightCurve::from_table("c.ecsv", &table).unwrap_err().to_string()
        };
        assert_eq!(
            refuse(&|t| t.columns[2].name = "spcm_rate_khz".into()),
            "c.ecsv: spcm_rate_khz: found an unknown column, expected the columns of a light curve"
        );
        assert_eq!(
            refuse(&|t| t.columns[3].name = "spcm_sigma".into()),
            "c.ecsv: spcm_sigma_hz: found no such column, expected a column `spcm_sigma_hz` (the nearest is `spcm_sigma`)"
        );
        assert!(
            refuse(&|t| {
                t.meta.remove("quantity");
            })
            .contains("no metadata `quantity`")
        );
        assert!(
            refuse(&|t| {
                t.meta.insert("quantity".into(), json!("fitted"));
            })
            .contains("found `fitted`, expected raw")
        );
        assert!(
            refuse(&|t| t.columns[0] = Column::text("time_utc", vec!["yesterday".into(); 3]))
                .contains("time_utc, row 1")
        );
        assert!(
            refuse(&|t| t.columns[4].values = Values::I64(vec![Some(0), Some(1 << 40), None]))
                .contains("spcm_flags, row 2")
        );
    }

    /// A file may number its flags otherwise, as a later version would: names decide, not numbers.
    #[test]
    fn flags_go_by_name() {
        let mut table = curve().to_table().unwrap();
        table.meta.insert("flag_bits".into(), json!({"off_axis": 0, "saturated": 7}));
        table.columns[4].values = Values::I64(vec![Some(0), Some(128), Some(1)]);
        let back = LightCurve::from_table("c.ecsv", &table).unwrap();
        assert_eq!(back.channels[0].flags, [Flags::empty(), Flags::SATURATED, Flags::OFF_AXIS]);
        table.meta.insert("flag_bits".into(), json!({"of_axis": 0}));
        let error = LightCurve::from_table("c.ecsv", &table).unwrap_err().to_string();
        assert!(error.contains("did you mean `off_axis`?"), "{error}");
    }
}
