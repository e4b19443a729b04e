//! Light curves: the one schema in which measured and simulated light meet.
//!
//! Hz at the detector, after the air, per channel, with uncertainty and flags. Only *calibrated* (κ·ν) and *predicted* (ν̂) curves are
//! compared with one another. In a file (ECSV): `time_utc` (ISO 8601, mid-exposure), `exposure_s`, per channel `<ch>_rate_hz`,
//! `<ch>_sigma_hz`, `<ch>_flags`, of a prediction perhaps `<ch>_model_error_hz`, of a measurement perhaps `<ch>_common_sigma_hz`; optional `range_m`, `phase_deg`, `zenith_deg`; in the metadata `quantity`, `flag_bits`, `provenance`.

mod flags;
mod provenance;
pub mod published;
mod samples;
mod spectral;
mod tracks;

pub use flags::{Flags, TOLERATED};
pub use provenance::{Input, Provenance};
pub use samples::Samples;
pub use spectral::{SpectralFile, SpectralLightCurve, SpectralQuantity};
pub use tracks::{Track, tracks, usual_step_s};

use samples::{Reader, row};
use serde_json::json;
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use sunglint_formats::flag_bits::{Numbering, bit_names};
use sunglint_formats::text::counted;
use sunglint_formats::{Column, Meta, ParseError, Table};

/// How far the rates of a light curve have come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RateKind {
    /// Counted rates: dead time and background included.
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

/// Kind of light that a file of an archive holds: rates of a [`RateKind`], magnitudes, or a session that is not yet a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// A session that was recorded: frames and counts, not yet a curve.
    Recorded,
    /// Rates as counted.
    Raw,
    /// Linear rates.
    Linear,
    /// Calibrated rates.
    Calibrated,
    /// Simulated rates.
    Predicted,
    /// Magnitudes of any program.
    Magnitudes,
}

impl LightKind {
    /// All kinds.
    pub const ALL: [Self; 6] = [
        Self::Recorded,
        Self::Raw,
        Self::Linear,
        Self::Calibrated,
        Self::Predicted,
        Self::Magnitudes,
    ];

    /// Name in tables and options.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Recorded => "recorded",
            Self::Raw => "raw",
            Self::Linear => "linear",
            Self::Calibrated => "calibrated",
            Self::Predicted => "predicted",
            Self::Magnitudes => "magnitudes",
        }
    }

    /// Explanation in a line, without a full stop.
    pub const fn help(self) -> &'static str {
        match self {
            Self::Recorded => "Sessions: frames and counts that are not yet curves",
            Self::Raw => "Rates as counted",
            Self::Linear => "Linear rates",
            Self::Calibrated => "Calibrated rates",
            Self::Predicted => "Simulated rates",
            Self::Magnitudes => "Magnitudes",
        }
    }

    /// The kind of that name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

impl From<RateKind> for LightKind {
    fn from(kind: RateKind) -> Self {
        match kind {
            RateKind::Raw => Self::Raw,
            RateKind::Linear => Self::Linear,
            RateKind::Calibrated => Self::Calibrated,
            RateKind::Predicted => Self::Predicted,
        }
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
    /// Flags of each sample.
    pub flags: Vec<Flags>,
    /// Possible error of a predicted rate by what the simulation does not model, Hz; `NaN` only where a flag says why. `None` where nothing is
    /// said of it.
    pub model_error_hz: Option<Vec<f64>>,
    /// Part of the standard uncertainty that all samples of the channel have in common, Hz: that of a level that was looked at before and after them and taken off all. It is in `sigma_hz`, too; `NaN` only where a flag says why.
    /// `None` where nothing is said of it.
    pub common_sigma_hz: Option<Vec<f64>>,
}

/// A light curve.
#[derive(Debug, Clone, PartialEq)]
pub struct LightCurve {
    /// How far the rates have come.
    pub kind: RateKind,
    /// When, for how long, and from where.
    pub samples: Samples,
    /// The channels.
    pub channels: Vec<ChannelCurve>,
    /// Where the curve came from.
    pub provenance: Provenance,
    /// Metadata of its file that the schema does not know, kept as they are.
    pub other: Meta,
}

/// Words for samples that say what another one says and were taken out. `what` is that which is the same beside time and light.
pub fn given_twice(n: usize, what: &str) -> String {
    let rows = counted(n, "row");
    format!("{rows} given twice (time, light and {what} are the same): each counts once")
}

impl LightCurve {
    /// Puts the samples in the order of time; those of one moment in the order of their rates, so that the order of a file's rows never matters.
    pub fn sort(&mut self) {
        let n = self.len();
        let good = self
            .channels
            .iter()
            .all(|c| c.rate_hz.len() == n && c.sigma_hz.len() == n && c.flags.len() == n);
        let keys: Vec<i128> =
            self.samples.time.iter().map(|t| sunglint_formats::time::tai_nanoseconds(*t)).collect();
        let by_value = |a: usize, b: usize| {
            let differ = self.channels.iter().flat_map(|c| {
                let flags = c.flags[a].bits().cmp(&c.flags[b].bits());
                [
                    c.rate_hz[a].total_cmp(&c.rate_hz[b]),
                    c.sigma_hz[a].total_cmp(&c.sigma_hz[b]),
                    flags,
                ]
            });
            let own = &self.samples;
            let others = [
                Some(&own.exposure_s),
                own.range_m.as_ref(),
                own.phase_deg.as_ref(),
                own.zenith_deg.as_ref(),
            ];
            let others = others.into_iter().flatten().map(|c| c[a].total_cmp(&c[b]));
            differ.chain(others).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
        };
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| {
            let by_time = keys[*a].cmp(&keys[*b]);
            if good { by_time.then_with(|| by_value(*a, *b)) } else { by_time }
        });
        if order.windows(2).all(|p| p[0] < p[1]) {
            return;
        }
        let pick = |from: &mut Vec<f64>| {
            if from.len() == n {
                *from = order.iter().map(|i| from[*i]).collect();
            }
        };
        let own = &mut self.samples;
        own.time = order.iter().map(|i| own.time[*i]).collect();
        pick(&mut own.exposure_s);
        for column in
            [&mut own.range_m, &mut own.phase_deg, &mut own.zenith_deg].into_iter().flatten()
        {
            pick(column);
        }
        for channel in &mut self.channels {
            pick(&mut channel.rate_hz);
            pick(&mut channel.sigma_hz);
            for column in [&mut channel.model_error_hz, &mut channel.common_sigma_hz] {
                column.iter_mut().for_each(&pick);
            }
            if channel.flags.len() == n {
                channel.flags = order.iter().map(|i| channel.flags[*i]).collect();
            }
        }
    }

    /// Takes out the samples that are the same as one before (time, rates and flags of every channel), of a curve whose samples are in the order of time. Returns their number.
    pub fn drop_doubled(&mut self) -> usize {
        /// Samples of one moment that are looked through for the same one.
        const OF_A_MOMENT: usize = 30;
        let n = self.len();
        if !self.channels.iter().all(|c| c.rate_hz.len() == n && c.flags.len() == n) {
            return 0;
        }
        let time = &self.samples.time;
        let same = |a: usize, b: usize| {
            let of_channel = |c: &ChannelCurve| {
                c.rate_hz[a].to_bits() == c.rate_hz[b].to_bits() && c.flags[a] == c.flags[b]
            };
            self.channels.iter().all(of_channel)
        };
        let mut keep = vec![true; n];
        for i in 1..n {
            let before = (0..i).rev().take_while(|k| time[*k] == time[i]);
            keep[i] = !before.take(OF_A_MOMENT).any(|k| same(k, i));
        }
        let lost = keep.iter().filter(|k| !**k).count();
        if lost > 0 {
            self.retain(&keep);
        }
        lost
    }

    /// Keeps the samples for which `keep` is true; there is one value for each sample, and samples beyond its end are kept.
    pub fn retain(&mut self, keep: &[bool]) {
        fn pick<T>(from: &mut Vec<T>, keep: &[bool]) {
            let mut at = 0;
            from.retain(|_| {
                at += 1;
                keep.get(at - 1).copied().unwrap_or(true)
            });
        }
        let own = &mut self.samples;
        pick(&mut own.time, keep);
        pick(&mut own.exposure_s, keep);
        for column in
            [&mut own.range_m, &mut own.phase_deg, &mut own.zenith_deg].into_iter().flatten()
        {
            pick(column, keep);
        }
        for channel in &mut self.channels {
            pick(&mut channel.rate_hz, keep);
            pick(&mut channel.sigma_hz, keep);
            pick(&mut channel.flags, keep);
            for column in [&mut channel.model_error_hz, &mut channel.common_sigma_hz] {
                column.iter_mut().for_each(|column| pick(column, keep));
            }
        }
    }

    /// Warnings about measured samples whose uncertainty is 0, which say nothing of how much they weigh, with the first row of each channel (from 1). Ask before the samples are sorted.
    pub fn without_sigma(&self) -> Vec<String> {
        if self.kind == RateKind::Predicted {
            return Vec::new();
        }
        let none = |c: &ChannelCurve| {
            let is = |i: &usize| c.sigma_hz[*i] == 0.0 && c.rate_hz[*i].is_finite();
            let rows: Vec<usize> = (0..c.sigma_hz.len().min(c.rate_hz.len())).filter(is).collect();
            Some(format!(
                "{}_sigma_hz is 0 in {} of {} rows (the first is row {}); such a sample has no uncertainty",
                c.name,
                rows.len(),
                c.sigma_hz.len(),
                rows.first()? + 1
            ))
        };
        self.channels.iter().filter_map(none).collect()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.samples.time.is_empty()
    }

    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&ChannelCurve> {
        self.channels.iter().find(|c| c.name == name)
    }

    /// The curve as a table of the schema, ready to be written as ECSV. Errors as [`LightCurve::from_table`]: what could not be read back is
    /// not written.
    pub fn to_table(&self) -> Result<Table, ParseError> {
        let mut table = Table { meta: self.other.clone(), ..Table::default() };
        table.meta.insert("quantity".into(), json!(self.kind.to_string()));
        table.meta.insert("flag_bits".into(), bit_names::<Flags>());
        table.meta.insert("provenance".into(), self.provenance.to_json());
        let (first, last) = self.samples.columns();
        table.columns.extend(first);
        for channel in &self.channels {
            let name = &channel.name;
            let rate = Column::f64(format!("{name}_rate_hz"), Some("Hz"), channel.rate_hz.clone());
            let sigma =
                Column::f64(format!("{name}_sigma_hz"), Some("Hz"), channel.sigma_hz.clone());
            let flags = Flags::column(format!("{name}_flags"), &channel.flags);
            table.columns.extend([rate, sigma, flags]);
            for (suffix, values) in [
                ("model_error_hz", &channel.model_error_hz),
                ("common_sigma_hz", &channel.common_sigma_hz),
            ] {
                let column = |v| Column::f64(format!("{name}_{suffix}"), Some("Hz"), v);
                table.columns.extend(values.clone().map(column));
            }
        }
        table.columns.extend(last);
        self.check(Path::new("light curve"))?;
        Ok(table)
    }

    /// A curve from a table of the schema. `path` names the file in errors: a column that the schema does not know, a channel that is not
    /// whole, a sample that is no number and not flagged, an exposure that is not above 0.
    pub fn from_table(path: impl AsRef<Path>, table: &Table) -> Result<Self, ParseError> {
        Self::from_table_at(path.as_ref(), table)
    }

    fn from_table_at(path: &Path, table: &Table) -> Result<Self, ParseError> {
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
        let samples = Samples::read(&reader)?;
        let bits = Numbering::read(path, table.meta.get("flag_bits"))?;
        let mut channels = Vec::new();
        for column in &table.columns {
            if let Some(name) = column.name.strip_suffix("_rate_hz") {
                let flags = reader.flags(&format!("{name}_flags"), &bits)?;
                let said = |suffix: &str| {
                    let name = format!("{name}_{suffix}");
                    let said = table.columns.iter().any(|c| c.name == name);
                    said.then(|| reader.numbers(&name, "Hz")).transpose()
                };
                channels.push(ChannelCurve {
                    name: name.to_owned(),
                    rate_hz: reader.numbers(&column.name, "Hz")?,
                    sigma_hz: reader.numbers(&format!("{name}_sigma_hz"), "Hz")?,
                    flags,
                    model_error_hz: said("model_error_hz")?,
                    common_sigma_hz: said("common_sigma_hz")?,
                });
            }
        }
        let mut known = Samples::COLUMNS.map(str::to_owned).to_vec();
        for channel in &channels {
            known.extend(
                ["rate_hz", "sigma_hz", "flags", "model_error_hz", "common_sigma_hz"]
                    .map(|suffix| format!("{}_{suffix}", channel.name)),
            );
        }
        reader.refuse_unknown(&known)?;
        let provenance = Provenance::from_json(path, table.meta.get("provenance"))?;
        let mut other = table.meta.clone();
        for known in ["quantity", "flag_bits", "provenance"] {
            other.remove(known);
        }
        let curve = Self { kind, samples, channels, provenance, other };
        curve.check(path)?;
        Ok(curve)
    }

    /// Checks the conditions that every curve must meet, read or made.
    fn check(&self, path: &Path) -> Result<(), ParseError> {
        self.samples.check(path)?;
        let n = self.len();
        let wrong = |field: String, found: String, expected: &str| {
            Err(ParseError::new(path, found, expected).in_field(field))
        };
        let lengths = self.channels.iter().flat_map(|c| {
            let lengths = [
                ("rate_hz", c.rate_hz.len()),
                ("sigma_hz", c.sigma_hz.len()),
                ("flags", c.flags.len()),
                ("model_error_hz", c.model_error_hz.as_ref().map_or(n, Vec::len)),
                ("common_sigma_hz", c.common_sigma_hz.as_ref().map_or(n, Vec::len)),
            ];
            lengths.map(|(suffix, length)| (format!("{}_{suffix}", c.name), length))
        });
        if let Some((field, length)) = lengths.into_iter().find(|(_, length)| *length != n) {
            return wrong(field, format!("{length} values"), &format!("{n}, as many as time_utc"));
        }
        for (number, channel) in self.channels.iter().enumerate() {
            let name = &channel.name;
            if self.channels[..number].iter().any(|other| other.name == *name) {
                return wrong(
                    "channel".into(),
                    format!("`{name}` twice"),
                    "channels of different names",
                );
            }
            if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                return wrong(
                    "channel".into(),
                    format!("`{name}`"),
                    "a name of letters, digits and _",
                );
            }
            for (suffix, values) in [("rate_hz", &channel.rate_hz), ("sigma_hz", &channel.sigma_hz)]
            {
                let unflagged = channel.flags.iter().filter(|f| f.is_empty()).count();
                if n > 1 && unflagged > 0 && values.iter().all(|v| v.is_nan()) {
                    let found =
                        format!("nan in all of {n} rows, {unflagged} of them without a flag");
                    let expected = "numbers (nan only where a flag says why)";
                    return wrong(format!("{name}_{suffix}"), found, expected);
                }
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
                let error = channel.model_error_hz.as_ref().map_or(0.0, |e| e[i]);
                if !(error.is_finite() && error >= 0.0 || flagged && error.is_nan()) {
                    let expected = "a number not below 0 (nan only where a flag says why)";
                    let field = row(&format!("{name}_model_error_hz"), i);
                    return wrong(field, error.to_string(), expected);
                }
                // As it was rounded in a file it may be a little more.
                let common = channel.common_sigma_hz.as_ref().map_or(0.0, |c| c[i]);
                let is_part = common >= 0.0 && (common <= sigma * (1.0 + 1e-9) || sigma.is_nan());
                if !(common.is_finite() && is_part || flagged && common.is_nan()) {
                    let expected =
                        "a number from 0 to the whole uncertainty (nan only where a flag says why)";
                    let field = row(&format!("{name}_common_sigma_hz"), i);
                    return wrong(field, common.to_string(), expected);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::Values;
    use sunglint_formats::time::parse_utc;

    fn curve() -> LightCurve {
        let time = ["2016-12-31T23:59:59.5", "2016-12-31T23:59:60.5", "2017-01-01T00:00:00.5"]
            .map(|t| parse_utc(t).unwrap());
        LightCurve {
            kind: RateKind::Calibrated,
            samples: Samples {
                range_m: Some(vec![1e6, 1.1e6, 1.2e6]),
                phase_deg: Some(vec![0.0, 90.0, 180.0]),
                ..Samples::new(time.to_vec(), 0.1)
            },
            channels: vec![ChannelCurve {
                name: "spcm".into(),
                rate_hz: vec![1e5, f64::NAN, 0.0],
                sigma_hz: vec![300.0, f64::NAN, 3.25],
                flags: vec![Flags::empty(), Flags::SATURATED | Flags::OFF_AXIS, Flags::empty()],
                model_error_hz: Some(vec![20.0, f64::NAN, 0.0]),
                common_sigma_hz: Some(vec![100.0, f64::NAN, 3.25]),
            }],
            provenance: Provenance {
                program: "sunglint 0.1.0".into(),
                inputs: vec![Input { file: "night.toml".into(), sha256: "ab".into() }],
                notes: vec!["zero point: Vega = 0.03".into()],
                ..Provenance::default()
            },
            other: Meta::default(),
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
            message(&|c| c.samples.exposure_s[2] = 0.0),
            "light curve: exposure_s, row 3: found 0, expected a time above 0 s"
        );
        assert!(message(&|c| c.channels[0].sigma_hz[2] = -1.0).contains("sigma_hz, row 3"));
        let error = |e: &[f64]| {
            let e = e.to_vec();
            message(&move |c| c.channels[0].model_error_hz = Some(e.clone()))
        };
        assert!(error(&[0.0, 0.0, -1.0]).contains("spcm_model_error_hz, row 3"));
        assert!(error(&[0.0]).contains("spcm_model_error_hz: found 1 values, expected 3"));
        let common = |value: f64| {
            message(&move |c| c.channels[0].common_sigma_hz = Some(vec![value, f64::NAN, 0.0]))
        };
        for wrong in [301.0, -1.0, f64::NAN] {
            assert!(common(wrong).contains("spcm_common_sigma_hz, row 1"), "{wrong}");
        }
        assert!(message(&|c| c.channels.push(c.channels[0].clone())).contains("`spcm` twice"));
        let early = hifitime::Epoch::from_gregorian_tai_at_midnight(1965, 1, 1);
        assert!(message(&|c| c.samples.time[1] = early).contains("time_utc, row 2"));
        assert!(
            message(&|c| c.samples.phase_deg = Some(vec![0.0, 181.0, 0.0]))
                .contains("phase_deg, row 2")
        );
        assert!(
            message(&|c| c.samples.range_m = Some(vec![1.0]))
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

    #[test]
    fn units_other_than_the_schemas_are_refused() {
        for (column, unit, expected) in [
            (1, "ms", "s"),
            (2, "kHz", "Hz"),
            (5, "kHz", "Hz"),
            (6, "kHz", "Hz"),
            (7, "km", "m"),
            (8, "rad", "deg"),
        ] {
            let mut table = curve().to_table().unwrap();
            table.columns[column].unit = Some(unit.into());
            let error = LightCurve::from_table("c.ecsv", &table).unwrap_err().to_string();
            assert!(
                error.contains(&format!("found the unit {unit}, expected {expected}")),
                "{error}"
            );
        }
        // Without a unit the name decides.
        let mut table = curve().to_table().unwrap();
        table.columns[1].unit = None;
        assert!(LightCurve::from_table("c.ecsv", &table).is_ok());
    }

    #[test]
    fn metadata_of_others_are_kept_and_wrong_provenance_is_refused() {
        let mut table = curve().to_table().unwrap();
        table.meta.insert("observer".into(), json!("α Ny"));
        table.meta["provenance"]["seed"] = json!(7);
        let back = LightCurve::from_table("c.ecsv", &table).unwrap();
        assert_eq!(
            (&back.other["observer"], &back.provenance.other["seed"]),
            (&json!("α Ny"), &json!(7))
        );
        assert_eq!(back.to_table().unwrap().meta["observer"], "α Ny");
        for wrong in [
            json!({"program": 3}),
            json!({"notes": "one"}),
            json!({"inputs": [{"file": "x"}]}),
            json!("me"),
        ] {
            table.meta.insert("provenance".into(), wrong);
            let error = LightCurve::from_table("c.ecsv", &table).unwrap_err().to_string();
            assert!(error.starts_with("c.ecsv: provenance: found"), "{error}");
        }
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
