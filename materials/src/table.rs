//! The table of a retro-reflection run, as a file holds it.
//!
//! `kind: retro_reflection` in the metadata; columns `angle_deg` (the stage's angle), `f_per_sr`, and where they are known `sigma_f_per_sr`, `azimuth_deg`
//! (of a sample that differs by azimuth) and `flags`. Other columns (uncertainties by component) are left alone.

use bitflags::Flags as _;
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

/// A retro-reflection run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RetroTable {
    /// The readings, in the order in which they were taken.
    pub readings: Vec<Reading>,
    /// Vacuum wavelength, nm.
    pub wavelength_nm: Option<f64>,
    /// Half the angle of the cone of light that reaches the meter, degrees.
    pub cone_half_angle_deg: Option<f64>,
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
        let path = path.as_ref();
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
            scale_sigma: number("scale_sigma")?.unwrap_or(0.0),
            has_azimuths: azimuth.is_some(),
        })
    }
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
