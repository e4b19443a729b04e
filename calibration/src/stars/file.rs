//! A calibration as a file: a table with a row for each night and channel, and in its metadata what a table cannot hold.

use super::{Night, Slope};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::Path;
use sunglint_formats::{Column, Meta, ParseError, Table, Values};
use sunglint_numerics::measured::{Measured, pair};
use sunglint_radiometry::light_curve::{Input, Provenance};

/// Version of the format. A reader refuses a later one.
const VERSION: u64 = 1;
/// The key of the version, by which a calibration is known.
const KEY: &str = "calibration_version";

/// The calibrations of one or more nights of a station.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Nights {
    /// The nights, in the order of their labels.
    pub nights: Vec<NightFile>,
    /// The station's name.
    pub station: String,
    /// The files of the station with their SHA-256; none of a built-in one.
    pub station_files: Vec<Input>,
    /// The air that the predictions had, in words.
    pub air: String,
    /// Zero point of the magnitudes.
    pub zero_point: String,
    /// Coverage of the intervals.
    pub confidence: f64,
    /// Where it came from.
    pub provenance: Provenance,
}

/// A night's calibration as the file has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NightFile {
    /// The night: the date at which it began at the station, `2020-11-18`.
    pub night: String,
    /// The channels that have a κ.
    pub channels: Vec<ChannelRow>,
    /// Covariance of ln κ between these channels.
    pub covariance: Vec<Vec<f64>>,
    /// Other facts about the night.
    pub facts: Facts,
}

/// Facts about a night besides its coefficients.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Facts {
    /// Stars that could decide.
    pub stars: usize,
    /// Those that agree.
    pub agreeing_stars: usize,
    /// Probability of this choice of those that agree; the others are in the intervals.
    pub agreement_probability: Option<f64>,
    /// Lowest, mean, highest airmass of those.
    pub airmass: Option<[f64; 3]>,
    /// Lowest, mean, highest B−V of those, mag.
    pub b_minus_v_mag: Option<[f64; 3]>,
    /// Relative scatter common to the channels.
    pub common_scatter: Option<f64>,
    /// Whether the stars were judged about a slope against airmass.
    pub judged_about_a_slope: bool,
    /// How the intervals were found.
    pub interval_by: String,
    /// Optical depth of an aerosol that was fitted with κ, at 550 nm, and its standard uncertainty.
    #[serde(with = "pair")]
    pub aerosol_depth: Option<Measured>,
    /// The exponent of Ångström's law that it was fitted with: magnitudes above the air need both.
    pub aerosol_exponent: Option<f64>,
    /// Channels without a κ, and why.
    pub without_kappa: Vec<[String; 2]>,
}

/// A channel of a night as the file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelRow {
    /// Name of the channel.
    pub channel: String,
    /// κ: predicted = κ · measured.
    pub kappa: f64,
    /// Standard uncertainty of ln κ.
    pub relative_sigma: f64,
    /// The interval's ends.
    pub interval: (f64, f64),
    /// Stars that went in.
    pub stars: usize,
    /// Visits that went in.
    pub visits: usize,
    /// Root mean square of the residuals of ln κ.
    pub rms: f64,
    /// Slope per airmass, where there is one.
    pub per_airmass: Option<Slope>,
    /// Slope per magnitude of B−V, where there is one.
    pub per_colour: Option<Slope>,
}

impl NightFile {
    /// A night's calibration; `channels` are the names in the order of the visits' channels.
    pub fn new(night: &str, channels: &[String], found: &Night) -> Self {
        let known: Vec<usize> =
            (0..channels.len()).filter(|c| found.channels[*c].is_ok()).collect();
        let row = |&c: &usize| {
            let k = found.channels[c].as_ref().ok()?;
            Some(ChannelRow {
                channel: channels[c].clone(),
                kappa: k.kappa,
                relative_sigma: k.relative_sigma,
                interval: k.interval,
                stars: k.stars,
                visits: k.visits,
                rms: k.rms,
                per_airmass: k.per_airmass.as_ref().ok().copied(),
                per_colour: k.per_colour.as_ref().ok().copied(),
            })
        };
        let without = channels
            .iter()
            .zip(&found.channels)
            .filter_map(|(name, channel)| Some([name.clone(), channel.as_ref().err()?.clone()]));
        Self {
            night: night.to_owned(),
            channels: known.iter().filter_map(row).collect(),
            covariance: known
                .iter()
                .map(|i| known.iter().map(|j| found.covariance[*i][*j]).collect())
                .collect(),
            facts: Facts {
                stars: found.stars,
                agreeing_stars: found.agreeing,
                agreement_probability: Some(found.agreement_probability),
                airmass: Some(found.airmass),
                b_minus_v_mag: found.b_minus_v_mag,
                common_scatter: Some(found.common_scatter),
                judged_about_a_slope: found.sloped,
                interval_by: found.method.to_owned(),
                aerosol_depth: found.aerosol.map(|a| Measured::new(a.depth, a.sigma)),
                aerosol_exponent: None,
                without_kappa: without.collect(),
            },
        }
    }

    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&ChannelRow> {
        self.channels.iter().find(|c| c.channel == name)
    }

    fn to_json(&self) -> Value {
        let mut value = serde_json::to_value(&self.facts).unwrap_or_default();
        let names: Vec<&str> = self.channels.iter().map(|c| c.channel.as_str()).collect();
        value["night"] = json!(self.night);
        value["covariance_ln_kappa"] = json!({"channels": names, "values": self.covariance});
        value
    }
}

impl Nights {
    /// Converts the calibrations to a table, ready to be written as ECSV.
    pub fn to_table(&self) -> Table {
        let mut meta = Meta::new();
        meta.insert(KEY.into(), json!(VERSION));
        meta.insert("law".into(), json!("predicted_hz = kappa * measured"));
        meta.insert("station".into(), json!(self.station));
        meta.insert("station_files".into(), json!(self.station_files));
        meta.insert("air".into(), json!(self.air));
        meta.insert("zero_point".into(), json!(self.zero_point));
        meta.insert("confidence".into(), json!(self.confidence));
        meta.insert("nights".into(), self.nights.iter().map(NightFile::to_json).collect());
        meta.insert("provenance".into(), self.provenance.to_json());
        let rows: Vec<(&NightFile, &ChannelRow)> =
            self.nights.iter().flat_map(|n| n.channels.iter().map(move |c| (n, c))).collect();
        let number = |name: &str, what: &str, value: &dyn Fn(&ChannelRow) -> f64| {
            Column::f64(name, None, rows.iter().map(|(_, c)| value(c)).collect()).described(what)
        };
        let count = |name: &str, value: &dyn Fn(&ChannelRow) -> usize| {
            // Counts of stars and visits are small.
            Column::i64(name, None, rows.iter().map(|(_, c)| value(c) as i64).collect())
        };
        let slope =
            |slope: Option<Slope>| slope.map_or((f64::NAN, f64::NAN), |s| (s.value, s.sigma));
        let text = |name: &str, value: &dyn Fn(&(&NightFile, &ChannelRow)) -> String| {
            Column::text(name, rows.iter().map(value).collect())
        };
        let columns = vec![
            text("night", &|(n, _)| n.night.clone()),
            text("channel", &|(_, c)| c.channel.clone()),
            number("kappa", "predicted rate over measured rate", &|c| c.kappa),
            number("relative_sigma", "standard uncertainty of ln kappa", &|c| c.relative_sigma),
            number("kappa_low", "lower end of the interval", &|c| c.interval.0),
            number("kappa_high", "upper end of the interval", &|c| c.interval.1),
            count("stars", &|c| c.stars),
            count("visits", &|c| c.visits),
            number("rms", "of ln(predicted/(kappa measured))", &|c| c.rms),
            number("per_airmass", "slope of ln(predicted/measured)", &|c| slope(c.per_airmass).0),
            number("per_airmass_sigma", "its uncertainty", &|c| slope(c.per_airmass).1),
            number("per_colour", "slope per mag of B-V", &|c| slope(c.per_colour).0),
            number("per_colour_sigma", "its uncertainty", &|c| slope(c.per_colour).1),
        ];
        Table { meta, columns }
    }

    /// From a table. `path` names the file in errors: no calibration, a later version, a column that is missing, a κ that is none, a covariance of another
    /// size.
    pub fn from_table(path: impl AsRef<Path>, table: &Table) -> Result<Self, ParseError> {
        Self::from_table_at(path.as_ref(), table)
    }

    fn from_table_at(path: &Path, table: &Table) -> Result<Self, ParseError> {
        let read = Reading { path, table };
        read.version()?;
        let listed = table.meta.get("nights").and_then(Value::as_array);
        let listed = listed.ok_or_else(|| read.wrong("nights", "no list", "a list of nights"))?;
        let rows = read.rows()?;
        let nights =
            listed.iter().map(|value| read.night(value, &rows)).collect::<Result<_, _>>()?;
        let files = table.meta.get("station_files").cloned().unwrap_or(json!([]));
        let text = |key: &str| table.meta_text(key).unwrap_or_default().to_owned();
        let provenance = table.meta.get("provenance").cloned().unwrap_or(json!({}));
        Ok(Self {
            nights,
            station: text("station"),
            station_files: serde_json::from_value(files)
                .map_err(|e| read.wrong("station_files", &e.to_string(), "[{file, sha256}]"))?,
            air: text("air"),
            zero_point: text("zero_point"),
            confidence: table.meta.get("confidence").and_then(Value::as_f64).unwrap_or(f64::NAN),
            provenance: serde_json::from_value(provenance).map_err(|e| {
                read.wrong("provenance", &e.to_string(), "program, command, inputs")
            })?,
        })
    }
}

/// A table that is being read.
struct Reading<'a> {
    path: &'a Path,
    table: &'a Table,
}

impl Reading<'_> {
    fn wrong(&self, field: &str, found: &str, expected: &str) -> ParseError {
        ParseError::new(self.path, found, expected).in_field(field)
    }

    fn version(&self) -> Result<(), ParseError> {
        match self.table.meta.get(KEY).map(Value::as_u64) {
            Some(Some(VERSION)) => Ok(()),
            Some(other) => {
                let found = other.map_or("no whole number".to_owned(), |v| format!("version {v}"));
                Err(self.wrong(KEY, &found, &format!("version {VERSION}")))
            }
            None => Err(self
                .wrong(KEY, "no such metadata", "a calibration")
                .with_hint("is this a file that `sunglint calibrate` wrote?")),
        }
    }

    fn numbers(&self, name: &str) -> Result<Vec<f64>, ParseError> {
        let numbers = self.table.f64(name).map_err(|error| error.in_file(self.path))?;
        Ok(numbers.into_owned())
    }

    fn texts(&self, name: &str) -> Result<Vec<String>, ParseError> {
        let column = self.table.column(name).map_err(|error| error.in_file(self.path))?;
        // A channel's or night's name of digits alone comes back as a number.
        Ok(match &column.values {
            Values::I64(v) => {
                v.iter().map(|v| v.map_or(String::new(), |v| v.to_string())).collect()
            }
            _ => {
                let text = self.table.text(name).map_err(|error| error.in_file(self.path))?;
                text.iter().map(|t| t.clone().unwrap_or_default()).collect()
            }
        })
    }

    /// All rows with the night that each is of.
    fn rows(&self) -> Result<Vec<(String, ChannelRow)>, ParseError> {
        let (night, channel) = (self.texts("night")?, self.texts("channel")?);
        let names = [
            "kappa",
            "relative_sigma",
            "kappa_low",
            "kappa_high",
            "stars",
            "visits",
            "rms",
            "per_airmass",
            "per_airmass_sigma",
            "per_colour",
            "per_colour_sigma",
        ];
        let columns = names.iter().map(|n| self.numbers(n)).collect::<Result<Vec<_>, _>>()?;
        let row = |i: usize| {
            let at = |c: usize| columns[c][i];
            let field = |name: &str| format!("{name}, row {}", i + 1);
            for (c, name) in names.iter().enumerate().take(4) {
                if !(at(c).is_finite() && at(c) > 0.0) {
                    return Err(self.wrong(&field(name), &at(c).to_string(), "a number above 0"));
                }
            }
            let slope = |c: usize| {
                let slope = Slope { value: at(c), sigma: at(c + 1) };
                (slope.value.is_finite() && slope.sigma.is_finite()).then_some(slope)
            };
            let row = ChannelRow {
                channel: channel[i].clone(),
                kappa: at(0),
                relative_sigma: at(1),
                interval: (at(2), at(3)),
                stars: at(4) as usize,
                visits: at(5) as usize,
                rms: at(6),
                per_airmass: slope(7),
                per_colour: slope(9),
            };
            Ok((night[i].clone(), row))
        };
        (0..night.len()).map(row).collect()
    }

    fn night(&self, value: &Value, rows: &[(String, ChannelRow)]) -> Result<NightFile, ParseError> {
        let night = value["night"]
            .as_str()
            .ok_or_else(|| self.wrong("nights", "a night without a name", "a date"))?;
        let channels: Vec<ChannelRow> =
            rows.iter().filter(|(of, _)| of == night).map(|(_, row)| row.clone()).collect();
        let covariance = &value["covariance_ln_kappa"];
        let names: Vec<&str> = covariance["channels"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        let square = |value: &Value| {
            let row = |row: &Value| {
                row.as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>()
            };
            value.as_array()?.iter().map(row).collect::<Option<Vec<_>>>()
        };
        let values = square(&covariance["values"]).unwrap_or_default();
        let fits = names.iter().copied().eq(channels.iter().map(|c| c.channel.as_str()))
            && values.len() == names.len()
            && values.iter().all(|row| row.len() == names.len());
        if !fits {
            let expected =
                "the channels of the table in their order, and as many rows and columns of numbers";
            return Err(self.wrong(
                "covariance_ln_kappa",
                &format!("another one for {night}"),
                expected,
            ));
        }
        let facts = serde_json::from_value(value.clone()).map_err(|e| {
            self.wrong("nights", &e.to_string(), "what a calibration says of a night")
        })?;
        Ok(NightFile { night: night.to_owned(), channels, covariance: values, facts })
    }
}
