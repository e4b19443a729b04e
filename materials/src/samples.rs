//! Measured values of a BRDF by direction and wavelength, as a file holds them.
//!
//! `kind: brdf_samples` in the metadata, or plain columns: `theta_i_deg`, `phi_i_deg`, `theta_o_deg`, `phi_o_deg` (negative elevations are on the other side), and
//! `brdf_450nm_per_sr` and so on with `sigma_450nm_per_sr` where it is known; a single `brdf_per_sr` (`sigma_per_sr`) has its wavelength in the metadata
//! `wavelength_nm`. In a FITS file `brdf_per_sr` and `sigma_per_sr` are vectors over the metadata's wavelengths.

use glam::DVec3;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use sunglint_formats::fits::{Fits, Writer, ascii_json};
use sunglint_formats::{Column, EncodeError, Meta, ParseError, Table, Values};

/// Directions closer than this are the same, radians.
pub const SAME_RAD: f64 = 2e-6;
const ANGLES: [&str; 4] = ["theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg"];

/// A pair of directions with what was measured there.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Angle of the light from the normal, degrees; negative on the other side.
    pub theta_i_deg: f64,
    /// Azimuth of the light, degrees.
    pub phi_i_deg: f64,
    /// Angle of the detector from the normal, degrees; negative on the other side.
    pub theta_o_deg: f64,
    /// Azimuth of the detector, degrees: the light's + 180° is the mirrored one.
    pub phi_o_deg: f64,
    /// f_r by wavelength, sr⁻¹; NaN where there is no value.
    pub brdf_per_sr: Vec<f64>,
    /// Standard deviations, sr⁻¹; empty where they are not known, NaN where one is not.
    pub sigma_per_sr: Vec<f64>,
}

/// Measured values by direction and wavelength.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Samples {
    /// Vacuum wavelengths, nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// In the order of the file.
    pub rows: Vec<Sample>,
    /// Other metadata of the values.
    pub meta: Meta,
}

impl Sample {
    /// Unit vectors to the light and to the detector.
    pub fn directions(&self) -> (DVec3, DVec3) {
        (direction(self.theta_i_deg, self.phi_i_deg), direction(self.theta_o_deg, self.phi_o_deg))
    }
}

/// The unit vector of an angle from the normal and an azimuth, degrees.
pub fn direction(theta_deg: f64, phi_deg: f64) -> DVec3 {
    let (sin, cos) = theta_deg.to_radians().sin_cos();
    let (y, x) = phi_deg.to_radians().sin_cos();
    DVec3::new(sin * x, sin * y, cos)
}

/// Both turned about the normal so that the light has the azimuth 0; of light along the normal the detector has.
///
/// ```
/// use sunglint_materials::samples::{direction, turned};
///
/// // Light from the azimuth 90°, seen in the mirrored direction: in the frame of the light that is the azimuth 180°.
/// let (i, o) = turned(direction(30.0, 90.0), direction(30.0, 270.0));
/// assert!((i - direction(30.0, 0.0)).length() < 1e-12 && (o - direction(30.0, 180.0)).length() < 1e-12);
/// ```
pub fn turned(i: DVec3, o: DVec3) -> (DVec3, DVec3) {
    let across = i.x.hypot(i.y);
    if across < 1e-12 {
        return (DVec3::Z, DVec3::new(o.x.hypot(o.y), 0.0, o.z));
    }
    let (cos, sin) = (i.x / across, i.y / across);
    (DVec3::new(across, 0.0, i.z), DVec3::new(o.x * cos + o.y * sin, o.y * cos - o.x * sin, o.z))
}

impl Samples {
    /// Whether there are several azimuths of incidence, so that an anisotropic sample shows.
    pub fn has_azimuths(&self) -> bool {
        let mut known: Option<f64> = None;
        for row in &self.rows {
            if row.theta_i_deg.abs() < 1e-4 {
                continue;
            }
            let half = if row.theta_i_deg < 0.0 { 180.0 } else { 0.0 };
            let phi = (row.phi_i_deg + half).to_radians();
            match known {
                None => known = Some(phi),
                Some(first) => {
                    let apart = (phi - first).rem_euclid(TAU);
                    if apart.min(TAU - apart) > SAME_RAD && (apart - PI).abs() > SAME_RAD {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// The hemispherical reflectance that the file states for an angle of incidence (Zemax's TIS), which is kept in the metadata `tis`: pairs of angle and reflectance.
    pub fn tis(&self, theta_i_deg: f64) -> Option<f64> {
        let value = self.meta.get("tis").or_else(|| self.meta.get("TIS"))?;
        // A FITS header holds it as text.
        let value = match value.as_str() {
            Some(text) => serde_json::from_str(text).ok()?,
            None => value.clone(),
        };
        let pairs = value.as_array()?.iter().filter_map(|pair| {
            let pair = pair.as_array()?;
            Some((pair.first()?.as_f64()?, pair.get(1)?.as_f64()?))
        });
        let mut here = pairs.filter(|(theta, _)| (theta - theta_i_deg.abs()).abs() < 1e-3);
        here.next().map(|(_, tis)| tis).filter(|tis| *tis > 0.0 && tis.is_finite())
    }

    /// From a table. `wavelength_nm` is that of a column `brdf_per_sr` whose metadata do not say it; `path` names the table in errors.
    ///
    /// # Errors
    /// Another kind, columns that are missing or in other units, angles beyond the horizon or no numbers, infinite values, a wavelength that nobody says.
    pub fn from_table(
        path: impl AsRef<Path>,
        table: &Table,
        wavelength_nm: Option<f64>,
    ) -> Result<Self, ParseError> {
        Self::from_table_at(path.as_ref(), table, wavelength_nm)
    }

    fn from_table_at(
        path: &Path,
        table: &Table,
        wavelength_nm: Option<f64>,
    ) -> Result<Self, ParseError> {
        let bad = |field: &str, found: String, expected: &str| {
            ParseError::new(path, found, expected).in_field(field)
        };
        if let Some(kind) = table.meta_text("kind").filter(|kind| *kind != "brdf_samples") {
            return Err(bad("kind", format!("`{kind}`"), "`brdf_samples`"));
        }
        let mut angles = Vec::new();
        for name in ANGLES {
            let column = table.quantity(name, "deg").map_err(|e| e.in_file(path))?;
            if let Some(row) = column.iter().position(|a| !a.is_finite()) {
                return Err(bad(name, format!("no number in row {}", row + 1), "an angle"));
            }
            let beyond = |a: &f64| name.starts_with("theta") && a.abs() > 90.0;
            if let Some(row) = column.iter().position(beyond) {
                let found = format!("{} in row {}", column[row], row + 1);
                return Err(bad(name, found, "an angle from the normal of up to 90 degrees"));
            }
            angles.push(column);
        }
        let (nm, columns) = values(path, table, wavelength_nm)?;
        if let Some(k) = nm.windows(2).position(|w| w[0] >= w[1]) {
            let found = format!("{} after {} nm", nm[k + 1], nm[k]);
            return Err(bad("wavelength_nm", found, "wavelengths, each once"));
        }
        let mut rows = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let brdf_per_sr: Vec<f64> = columns.iter().map(|c| c.value[row]).collect();
            if brdf_per_sr.iter().any(|v| v.is_infinite()) {
                let found = format!("an infinite value in row {}", row + 1);
                return Err(bad("brdf_per_sr", found, "numbers, or nan where there is none"));
            }
            let known = columns.iter().any(|c| c.sigma.is_some());
            let sigma = columns.iter().map(|c| c.sigma.as_ref().map_or(f64::NAN, |s| s[row]));
            let sigma_per_sr: Vec<f64> = if known { sigma.collect() } else { Vec::new() };
            if let Some(s) = sigma_per_sr.iter().find(|s| **s < 0.0 || s.is_infinite()) {
                let found = format!("{s} in row {}", row + 1);
                return Err(bad("sigma_per_sr", found, "a standard deviation of 0 or above"));
            }
            rows.push(Sample {
                theta_i_deg: angles[0][row],
                phi_i_deg: angles[1][row],
                theta_o_deg: angles[2][row],
                phi_o_deg: angles[3][row],
                brdf_per_sr,
                sigma_per_sr,
            });
        }
        if rows.is_empty() {
            return Err(ParseError::new(path, "no row", "measured values"));
        }
        let mut meta = table.meta.clone();
        if let Some(unread) = unread_sigma(table).map(Value::from) {
            let remarks = meta.entry("remarks".to_owned()).or_insert_with(|| Value::Array(vec![]));
            if let Some(remarks) = remarks.as_array_mut().filter(|r| !r.contains(&unread)) {
                remarks.push(unread);
            }
        }
        Ok(Self { wavelength_nm: nm, rows, meta })
    }

    /// Returns the values as a table with a column for each wavelength (ECSV).
    pub fn to_table(&self) -> Table {
        let mut columns = self.angles();
        let sr = Some("1 / sr");
        for (k, nm) in self.wavelength_nm.iter().enumerate() {
            let of = |row: &Sample| row.brdf_per_sr[k];
            let value = self.rows.iter().map(of).collect();
            columns.push(Column::f64(format!("brdf_{nm}nm_per_sr"), sr, value));
            if self.rows.iter().any(|r| !r.sigma_per_sr.is_empty()) {
                let of = |r: &Sample| r.sigma_per_sr.get(k).copied().unwrap_or(f64::NAN);
                let sigma = self.rows.iter().map(of).collect();
                columns.push(Column::f64(format!("sigma_{nm}nm_per_sr"), sr, sigma));
            }
        }
        Table { meta: self.meta_of_kind(), columns }
    }

    /// Encodes the values as FITS: a table `SAMPLES` with a vector over the wavelengths in each row, and a table `WAVELENGTHS`.
    ///
    /// # Errors
    /// Metadata that a header cannot hold.
    pub fn to_fits(&self) -> Result<Vec<u8>, EncodeError> {
        let mut columns = self.angles();
        let width = self.wavelength_nm.len();
        let mut vector = |name: &str, flat: Vec<f64>| {
            columns.push(Column {
                name: name.to_owned(),
                unit: Some("1 / sr".into()),
                description: None,
                values: Values::Vectors { width, flat: Box::new(Values::F64(flat)) },
            });
        };
        vector("brdf_per_sr", self.rows.iter().flat_map(|r| r.brdf_per_sr.clone()).collect());
        if self.rows.iter().all(|r| r.sigma_per_sr.len() == width) {
            vector("sigma_per_sr", self.rows.iter().flat_map(|r| r.sigma_per_sr.clone()).collect());
        }
        let mut meta = Meta::new();
        for (key, value) in self.meta_of_kind() {
            if key == "wavelength_nm" {
                continue;
            }
            let letters = key.chars().filter(char::is_ascii_alphanumeric).take(8);
            let keyword: String = letters.map(|c| c.to_ascii_uppercase()).collect();
            let nested = value.is_object() || value.is_array();
            let value = if nested { Value::String(ascii_json(&value)) } else { value };
            meta.insert(keyword, value);
        }
        let nm = Column::f64("wavelength_nm", Some("nm"), self.wavelength_nm.clone());
        let mut writer = Writer::new();
        writer.table(&Table { meta, columns }, "SAMPLES")?;
        writer.table(&Table { meta: Meta::new(), columns: vec![nm] }, "WAVELENGTHS")?;
        Ok(writer.into_bytes())
    }

    /// From such a file.
    ///
    /// # Errors
    /// Tables that are missing; as [`Samples::from_table`].
    pub fn from_fits(fits: &Fits) -> Result<Self, ParseError> {
        let find = |name: &str| {
            let missing = || ParseError::new(fits.path(), "no such table", "a file of samples");
            fits.table(fits.find(name).ok_or_else(|| missing().in_field(name))?)
        };
        let (mut table, wavelengths) = (find("SAMPLES")?, find("WAVELENGTHS")?);
        let nm = wavelengths.quantity("wavelength_nm", "nm").map_err(|e| e.in_file(fits.path()))?;
        table.meta.insert("wavelength_nm".into(), json!(nm));
        if let Some(kind) = table.meta.get("KIND").cloned() {
            table.meta.insert("kind".into(), kind);
        }
        Self::from_table(fits.path(), &table, None)
    }

    fn angles(&self) -> Vec<Column> {
        let of: [&dyn Fn(&Sample) -> f64; 4] =
            [&|r| r.theta_i_deg, &|r| r.phi_i_deg, &|r| r.theta_o_deg, &|r| r.phi_o_deg];
        let about = [
            "of the light, from the normal",
            "of the light",
            "of the detector, from the normal",
            "of the detector; the light's + 180 deg is opposite",
        ];
        ANGLES
            .into_iter()
            .zip(of)
            .zip(about)
            .map(|((name, of), about)| {
                Column::f64(name, Some("deg"), self.rows.iter().map(of).collect()).described(about)
            })
            .collect()
    }

    fn meta_of_kind(&self) -> Meta {
        let mut meta = Meta::new();
        meta.insert("kind".into(), json!("brdf_samples"));
        meta.insert("wavelength_nm".into(), json!(self.wavelength_nm));
        for (key, value) in &self.meta {
            if key != "kind" && key != "wavelength_nm" {
                meta.insert(key.clone(), value.clone());
            }
        }
        meta
    }
}

struct OfWavelength {
    value: Vec<f64>,
    sigma: Option<Vec<f64>>,
}

/// Says which columns seem to hold uncertainties and are not read.
fn unread_sigma(table: &Table) -> Option<String> {
    let of_value = |name: &str| {
        let is_read = |c: &Column| c.name.strip_prefix("brdf_") == name.strip_prefix("sigma_");
        name.starts_with("sigma_") && table.columns.iter().any(is_read)
    };
    let looks = |name: &str| {
        const WORDS: [&str; 8] =
            ["sigma", "std", "stdev", "unc", "uncertainty", "err", "error", "errors"];
        name.to_lowercase().split(['_', ' ', '-', '.']).any(|word| WORDS.contains(&word))
    };
    let names = table.columns.iter().map(|c| c.name.as_str());
    let unread: Vec<&str> = names.filter(|name| looks(name) && !of_value(name)).collect();
    (!unread.is_empty()).then(|| {
        format!(
            "{} is not read: the standard deviation of brdf_550nm_per_sr is sigma_550nm_per_sr, that of brdf_per_sr is sigma_per_sr, in sr⁻¹",
            unread.join(", ")
        )
    })
}

/// The wavelengths and their values, increasing.
fn values(
    path: &Path,
    table: &Table,
    given_nm: Option<f64>,
) -> Result<(Vec<f64>, Vec<OfWavelength>), ParseError> {
    let bad = |field: &str, found: String, expected: &str| {
        ParseError::new(path, found, expected).in_field(field)
    };
    let of_meta = || -> Option<Vec<f64>> {
        match table.meta.get("wavelength_nm")? {
            Value::Array(list) => list.iter().map(Value::as_f64).collect(),
            one => Some(vec![one.as_f64()?]),
        }
    };
    if let Ok((width, flat)) = table.f64_vectors("brdf_per_sr") {
        let nm = of_meta().filter(|nm| nm.len() == width).ok_or_else(|| {
            bad("wavelength_nm", "no such metadata".into(), "a wavelength for each value")
        })?;
        let sigma = table.f64_vectors("sigma_per_sr").ok().filter(|(w, _)| *w == width);
        let part = |flat: &[f64], k: usize| flat.iter().skip(k).step_by(width).copied().collect();
        let columns = (0..width)
            .map(|k| OfWavelength { value: part(flat, k), sigma: sigma.map(|(_, s)| part(s, k)) });
        return Ok((nm, columns.collect()));
    }
    let per_sr = |name: &str| super::table::per_steradian(table, name).map_err(|e| e.in_file(path));
    let mut found: Vec<(f64, OfWavelength)> = Vec::new();
    for column in &table.columns {
        let Some(middle) = column.name.strip_prefix("brdf_") else { continue };
        let (nm, sigma) = if middle == "per_sr" {
            let one = of_meta().filter(|nm| nm.len() == 1).map(|nm| nm[0]);
            let nm = one.or(given_nm).ok_or_else(|| {
                let error = bad(
                    "wavelength_nm",
                    "a column `brdf_per_sr` without a wavelength".into(),
                    "metadata `wavelength_nm`, or a column like `brdf_532nm_per_sr`",
                );
                error.with_hint("say it: --wavelength-nm 532")
            })?;
            (nm, "sigma_per_sr".to_owned())
        } else {
            let text = middle.strip_suffix("nm_per_sr");
            let nm = text.and_then(|t| t.parse::<f64>().ok()).ok_or_else(|| {
                bad(&column.name, "this name".into(), "a name like `brdf_532nm_per_sr`")
            })?;
            (nm, format!("sigma_{}nm_per_sr", text.unwrap_or_default()))
        };
        if !(nm.is_finite() && nm > 1.0) {
            return Err(bad(&column.name, format!("{nm} nm"), "a wavelength in nm"));
        }
        let has = table.columns.iter().any(|c| c.name == sigma);
        let sigma = has.then(|| per_sr(&sigma).map(|c| c.into_owned())).transpose()?;
        found.push((nm, OfWavelength { value: per_sr(&column.name)?.into_owned(), sigma }));
    }
    if found.is_empty() {
        let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        let expected = "a column `brdf_per_sr`, or `brdf_532nm_per_sr` and so on";
        return Err(ParseError::new(path, names.join(", "), expected));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(found.into_iter().unzip())
}
