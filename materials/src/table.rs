//! The table of a retro-reflection run, as a file holds it.
//!
//! `kind: retro_reflection` in the metadata; columns `angle_deg` (the stage's angle), `f_per_sr`, and where they are known `sigma_f_per_sr`, `azimuth_deg`
//! (of a sample that differs by azimuth) and `flags`. Of a run of our own also `time_s` and `sigma_drift_per_sr`, with the incident readings in the metadata: errors that neighbouring angles
//! share. Other columns (uncertainties by other components) are left alone.

use crate::ndf::ZeroOrigin;
use bitflags::Flags as _;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;
use sunglint_formats::flag_bits::Numbering;
use sunglint_formats::{ParseError, Table, TableError, Values};

bitflags::bitflags! {
    /// Flags for what is known to be wrong with a reading. In files the metadata `flag_bits` names the bits.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub struct RetroFlags: u32 {
        /// The meter was at the end of its range.
        const OVER_RANGE = 1;
        /// Less light than without the sample.
        const NEGATIVE = 1 << 1;
        /// The beam reached beyond the sample's edge.
        const EDGE = 1 << 2;
        /// Not measured: continued from other angles.
        const EXTRAPOLATED = 1 << 3;
        /// Too little light to tell from none.
        const BELOW_DETECTION = 1 << 4;
        /// Some of the readings behind it were left out as outliers.
        const OUTLIERS = 1 << 5;
    }
}

/// Retro-reflection at one angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The stage's angle, degrees: the angle of incidence but for the mount's offset; both signs.
    pub angle_deg: f64,
    /// Azimuth of the plane of incidence on the sample, degrees; 0 of an isotropic one.
    pub azimuth_deg: f64,
    /// f(ω, ω), sr⁻¹; not a number only beside a flag.
    pub f_per_sr: f64,
    /// Standard deviation of f without what all readings have in common, sr⁻¹; 0 where it is not known.
    pub sigma_f_per_sr: f64,
    /// Flags for what is wrong with the value.
    pub flags: RetroFlags,
}

/// Spread of the directions into the meter about that of the light: root mean squares.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ConeSpread {
    /// In the plane of incidence, degrees.
    pub along_deg: f64,
    /// Across it, degrees.
    pub across_deg: f64,
}

/// An incident reading of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct IncidentPower {
    /// When it was read, s.
    pub time_s: f64,
    /// The power (of a standard: net), W.
    pub power_w: f64,
    /// Standard uncertainty of the power, W.
    pub sigma_w: f64,
}

/// Errors that the laser's power, read now and then, leaves to the readings: neighbours share them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LaserTrack {
    /// The incident readings.
    pub incident: Vec<IncidentPower>,
    /// When each angle was read, s.
    pub time_s: Vec<f64>,
    /// The part of each angle's standard deviation that is the laser's, sr⁻¹.
    pub sigma_per_sr: Vec<f64>,
}

/// The stage's angle at normal incidence as a run states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatedZero {
    /// The angle, degrees. The cosine in the values of f is that of the stage's angle less this.
    pub angle_deg: f64,
    /// Standard uncertainty of the angle, degrees.
    pub sigma_deg: f64,
    /// Where the angle came from.
    pub origin: ZeroOrigin,
}

/// A retro-reflection run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RetroTable {
    /// The readings, in the order in which they were taken.
    pub readings: Vec<Reading>,
    /// Vacuum wavelength, nm.
    pub wavelength_nm: Option<f64>,
    /// Half the angle of the cone of light that reaches the meter, degrees.
    pub cone_half_angle_deg: Option<f64>,
    /// Spread of that cone, where it is not a round one.
    pub cone_spread: Option<ConeSpread>,
    /// Relative standard deviation of the cone's solid angle; 0 where none is said.
    pub cone_sigma: f64,
    /// The stage's angle at normal incidence, where the run states it.
    pub zero: Option<StatedZero>,
    /// The laser's power over the run, where the table has it.
    pub laser: Option<LaserTrack>,
    /// Relative standard deviation that all readings have in common (incident power, beam splitter, solid angle); 0 where none is said.
    pub scale_sigma: f64,
    /// Whether the table has azimuths.
    pub has_azimuths: bool,
}

impl RetroTable {
    /// From a table's columns; `path` names it in errors.
    ///
    /// # Errors
    /// Another kind of table, columns that are missing or in other units, angles that are radians, numbers that are none without a flag that says why, unknown flags.
    pub fn from_table(path: impl AsRef<Path>, table: &Table) -> Result<Self, ParseError> {
        Self::from_table_at(path.as_ref(), table)
    }

    fn from_table_at(path: &Path, table: &Table) -> Result<Self, ParseError> {
        let bad = |e: TableError| e.in_file(path);
        if let Some(kind) = table.meta_text("kind").filter(|kind| *kind != "retro_reflection") {
            let error = ParseError::new(path, format!("`{kind}`"), "`retro_reflection`");
            return Err(error.in_field("kind"));
        }
        let angle = table.quantity("angle_deg", "deg").map_err(bad)?;
        let f = per_steradian(table, "f_per_sr").map_err(bad)?;
        let has = |name: &str| table.columns.iter().any(|c| c.name == name);
        let azimuth = has("azimuth_deg").then(|| table.quantity("azimuth_deg", "deg"));
        let azimuth = azimuth.transpose().map_err(bad)?;
        let sigma = has("sigma_f_per_sr").then(|| per_steradian(table, "sigma_f_per_sr"));
        let sigma = sigma.transpose().map_err(bad)?;
        let flags = flags_of(path, table)?;
        let mut readings = Vec::with_capacity(angle.len());
        for row in 0..angle.len() {
            let wrong = |field: &str, found: String, expected: &str| {
                let found = format!("{found} in row {}", row + 1);
                ParseError::new(path, found, expected).in_field(field)
            };
            let flags = flags[row];
            let reading = Reading {
                angle_deg: angle[row],
                azimuth_deg: azimuth.as_ref().map_or(0.0, |a| a[row]),
                f_per_sr: f[row],
                sigma_f_per_sr: sigma.as_ref().map_or(0.0, |s| s[row]),
                flags,
            };
            if reading.angle_deg.is_nan() || reading.angle_deg.abs() >= 90.0 {
                let found = reading.angle_deg.to_string();
                return Err(wrong("angle_deg", found, "an angle between −90 and 90"));
            }
            if !reading.azimuth_deg.is_finite() {
                return Err(wrong("azimuth_deg", "no number".into(), "an azimuth"));
            }
            if !reading.f_per_sr.is_finite() && flags.is_empty() {
                let expected = "a number, or a flag that says why there is none";
                return Err(wrong("f_per_sr", reading.f_per_sr.to_string(), expected));
            }
            let is_known = reading.sigma_f_per_sr.is_finite() && reading.sigma_f_per_sr >= 0.0;
            if !is_known && flags.is_empty() {
                let found = reading.sigma_f_per_sr.to_string();
                return Err(wrong("sigma_f_per_sr", found, "a number of 0 or above"));
            }
            readings.push(reading);
        }
        let angles: Vec<f64> = readings.iter().map(|r| r.angle_deg).collect();
        if let Some((first, last)) = radians(&angles) {
            let found = format!(
                "angles that are radians: {first} to {last} is {:.1}° to {:.1}°, and so are nearly all of them round",
                first.to_degrees(),
                last.to_degrees()
            );
            let error = ParseError::new(path, found, "degrees").in_field("angle_deg");
            return Err(error.with_hint("multiply them by 180/π"));
        }
        let number = |key: &str| -> Result<Option<f64>, ParseError> {
            match table.meta.get(key) {
                None | Some(Value::Null) => Ok(None),
                Some(value) => match value.as_f64().filter(|v| *v >= 0.0) {
                    Some(number) => Ok(Some(number)),
                    None => {
                        let error = ParseError::new(path, value.to_string(), "0 or above");
                        Err(error.in_field(key))
                    }
                },
            }
        };
        Ok(Self {
            readings,
            wavelength_nm: number("wavelength_nm")?,
            cone_half_angle_deg: number("cone_half_angle_deg")?,
            cone_spread: cone_spread(path, table)?,
            cone_sigma: cone_sigma(path, table)?,
            zero: stated_zero(path, table)?,
            laser: laser(path, table)?,
            scale_sigma: number("scale_sigma")?.unwrap_or(0.0),
            has_azimuths: azimuth.is_some(),
        })
    }
}

/// Value in the metadata under a key, unless that is null; as another type.
fn metadata<T: serde::de::DeserializeOwned>(
    (path, table): (&Path, &Table),
    key: &str,
    expected: &str,
) -> Result<Option<T>, ParseError> {
    match table.meta.get(key) {
        None | Some(Value::Null) => Ok(None),
        Some(value) => match serde_json::from_value(value.clone()) {
            Ok(read) => Ok(Some(read)),
            Err(_) => Err(ParseError::new(path, value.to_string(), expected).in_field(key)),
        },
    }
}

fn cone_spread(path: &Path, table: &Table) -> Result<Option<ConeSpread>, ParseError> {
    let (key, expected) = ("cone_spread_deg", "along_deg and across_deg, 0 to 45 degrees");
    let spread: Option<ConeSpread> = metadata((path, table), key, expected)?;
    let good =
        |s: &ConeSpread| [s.along_deg, s.across_deg].iter().all(|s| (0.0..=45.0).contains(s));
    match spread {
        Some(spread) if !good(&spread) => {
            let found = format!("{} and {}", spread.along_deg, spread.across_deg);
            Err(ParseError::new(path, found, expected).in_field(key))
        }
        spread => Ok(spread),
    }
}

/// The solid angle's part of what all readings have in common.
fn cone_sigma(path: &Path, table: &Table) -> Result<f64, ParseError> {
    let (key, expected) = ("scale_sigma_by", "relative uncertainties of 0 or above by their cause");
    let causes: Option<std::collections::BTreeMap<String, f64>> =
        metadata((path, table), key, expected)?;
    let sigma = causes.and_then(|causes| causes.get("solid_angle").copied()).unwrap_or(0.0);
    if sigma.is_finite() && sigma >= 0.0 {
        return Ok(sigma);
    }
    Err(ParseError::new(path, sigma.to_string(), expected).in_field(key))
}

/// The stage's angle at normal incidence; none where the table does not say it with its uncertainty and its origin.
fn stated_zero(path: &Path, table: &Table) -> Result<Option<StatedZero>, ParseError> {
    let degrees = "an angle in degrees";
    let angle: Option<f64> = metadata((path, table), "zero_deg", degrees)?;
    let sigma: Option<f64> = metadata((path, table), "zero_sigma_deg", degrees)?;
    let origins = "`fitted`, `given`, `law` or `assumed`";
    let origin: Option<ZeroOrigin> = metadata((path, table), "zero_origin", origins)?;
    let (Some(angle_deg), Some(sigma_deg), Some(origin)) = (angle, sigma, origin) else {
        return Ok(None);
    };
    let checks = [
        ("zero_deg", angle_deg, angle_deg.abs() < 90.0, "an angle between −90 and 90"),
        ("zero_sigma_deg", sigma_deg, (0.0..90.0).contains(&sigma_deg), "0 to 90 degrees"),
    ];
    match checks.into_iter().find(|check| !check.2) {
        Some((key, found, _, expected)) => {
            Err(ParseError::new(path, found.to_string(), expected).in_field(key))
        }
        None => Ok(Some(StatedZero { angle_deg, sigma_deg, origin })),
    }
}

/// The laser over the run; none where the table lacks the incident readings, the times, or the laser's part of the uncertainties.
fn laser(path: &Path, table: &Table) -> Result<Option<LaserTrack>, ParseError> {
    let (key, expected) = ("incident", "time_s, power_w above 0, sigma_w of 0 or above");
    let incident: Option<Vec<IncidentPower>> = metadata((path, table), key, expected)?;
    let has = |name: &str| table.columns.iter().any(|c| c.name == name);
    let Some(incident) = incident.filter(|_| has("time_s") && has("sigma_drift_per_sr")) else {
        return Ok(None);
    };
    let good = |i: &IncidentPower| {
        let is_power = i.power_w.is_finite() && i.power_w > 0.0;
        i.time_s.is_finite() && is_power && i.sigma_w.is_finite() && i.sigma_w >= 0.0
    };
    if let Some(wrong) = incident.iter().find(|i| !good(i)) {
        let IncidentPower { time_s, power_w, sigma_w } = wrong;
        let found = format!("{time_s} s, {power_w} W, {sigma_w} W");
        return Err(ParseError::new(path, found, expected).in_field(key));
    }
    let time_s = table.quantity("time_s", "s").map_err(|e| e.in_file(path))?.into_owned();
    let sigma = per_steradian(table, "sigma_drift_per_sr").map_err(|e| e.in_file(path))?;
    Ok(Some(LaserTrack { incident, time_s, sigma_per_sr: sigma.into_owned() }))
}

/// The smallest and the largest angle, where they are radians: none beyond π/2, and nearly all a round number of degrees (by a tenth, 0.004° off at most, which four decimals
/// are) if they are taken so, which angles in degrees are by chance in one of twelve.
fn radians(angles: &[f64]) -> Option<(f64, f64)> {
    let round = |a: &&f64| {
        let tenths = 10.0 * a.to_degrees();
        (tenths - tenths.round()).abs() < 0.04
    };
    let other: Vec<f64> = angles.iter().copied().filter(|a| *a != 0.0).collect();
    let is_small = other.iter().all(|a| a.abs() <= std::f64::consts::FRAC_PI_2);
    if other.len() < 8 || !is_small || other.iter().filter(round).count() * 10 < other.len() * 9 {
        return None;
    }
    let first = other.iter().copied().fold(f64::INFINITY, f64::min);
    Some((first, other.iter().copied().fold(f64::NEG_INFINITY, f64::max)))
}

/// The flags of all rows: numbers whose bits the metadata name, or the names themselves (in a file without metadata).
fn flags_of(path: &Path, table: &Table) -> Result<Vec<RetroFlags>, ParseError> {
    let wrong = |row: usize, found: String, expected: &str| {
        ParseError::new(path, format!("{found} in row {}", row + 1), expected).in_field("flags")
    };
    let Ok(column) = table.column("flags") else {
        return Ok(vec![RetroFlags::empty(); table.rows()]);
    };
    let numbering = Numbering::<RetroFlags>::read(path, table.meta.get("flag_bits"))?;
    let number = |row: usize, value: i64| {
        numbering.flags(value).ok_or_else(|| {
            wrong(row, value.to_string(), "flags that the metadata `flag_bits` name")
        })
    };
    let name = |row: usize, text: &str| {
        let known = RetroFlags::FLAGS.iter().find(|f| f.name().eq_ignore_ascii_case(text));
        known.map(|f| *f.value()).ok_or_else(|| {
            let names: Vec<String> =
                RetroFlags::FLAGS.iter().map(|f| f.name().to_lowercase()).collect();
            wrong(row, format!("`{text}`"), &format!("names of flags: {}", names.join(", ")))
        })
    };
    match &column.values {
        Values::Text(texts) => {
            let row = |(row, text): (usize, &Option<String>)| {
                let words = text.as_deref().unwrap_or("").split([' ', ';', '|']);
                words
                    .filter(|w| !w.is_empty())
                    .try_fold(RetroFlags::empty(), |all, word| Ok(all | name(row, word)?))
            };
            texts.iter().enumerate().map(row).collect()
        }
        Values::I64(values) => {
            values.iter().enumerate().map(|(row, v)| number(row, v.unwrap_or(0))).collect()
        }
        _ => {
            let values = table.f64("flags").map_err(|e| e.in_file(path))?;
            let whole = |v: &f64| if v.is_nan() { 0 } else { *v as i64 };
            values.iter().enumerate().map(|(row, v)| number(row, whole(v))).collect()
        }
    }
}

/// A column in sr⁻¹, in either spelling of the unit.
pub(super) fn per_steradian<'a>(
    table: &'a Table,
    name: &str,
) -> Result<std::borrow::Cow<'a, [f64]>, TableError> {
    table.quantity(name, "1 / sr").or_else(|_| table.quantity(name, "sr-1"))
}
