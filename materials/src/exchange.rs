//! Measured values as other programs and laboratories write them: FRED, Zemax, and the columns of *Scatterworks* tables as Fankhauser et al. (2023) published them.
//!
//! Which it is follows from the content, never from the ending: Zemax's `.bsdf` is text, ours and Mitsuba's is a tensor file.

use crate::fit::surface::hemisphere;
use crate::samples::{Sample, Samples, direction, turned};
use glam::DVec3;
use serde::Serialize;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::Path;
use sunglint_formats::fred::{self, FredIncidence, FredRow, FredScatter};
use sunglint_formats::zemax::{self, ZemaxBsdf};
use sunglint_formats::{Meta, ParseError};

/// A format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Exchange {
    /// FRED's tabular scatter data.
    Fred,
    /// Zemax OpticStudio's tabular BSDF.
    Zemax,
    /// Columns `phi_i theta_i phi_o theta_o brdf`, where phi is the angle from the normal.
    Columns,
}

impl Exchange {
    /// The format of a text, if it is one of these.
    pub fn of(text: &str) -> Option<Self> {
        if fred::is_fred(text) {
            Some(Self::Fred)
        } else if zemax::is_zemax(text) {
            Some(Self::Zemax)
        } else if columns_header(text) {
            Some(Self::Columns)
        } else {
            None
        }
    }

    /// Returns the name of the format for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fred => "FRED",
            Self::Zemax => "Zemax",
            Self::Columns => "columns phi_i theta_i phi_o theta_o brdf",
        }
    }
}

/// Reads measured values from a text in one of these formats. `wavelength_nm` is that of a file that does not say it.
///
/// # Errors
/// The errors of the format's reader; light that was transmitted; a wavelength that neither file nor caller gives.
pub fn read_str(
    path: &Path,
    text: &str,
    format: Exchange,
    wavelength_nm: Option<f64>,
) -> Result<Samples, ParseError> {
    let (rows, of_file, missing) = match format {
        Exchange::Fred => (from_fred(&fred::read_str(path, text)?), None, 0),
        Exchange::Zemax => {
            let (rows, missing) = from_zemax(path, &zemax::read_str(path, text)?)?;
            (rows, None, missing)
        }
        Exchange::Columns => (from_columns(path, text)?, said_wavelength(text), 0),
    };
    let Some(nm) = wavelength_nm.or(of_file) else {
        let error = ParseError::new(path, "no wavelength", "the wavelength of its values");
        return Err(error.with_hint("say it: --wavelength-nm 650"));
    };
    if !(nm.is_finite() && nm > 1.0) {
        return Err(ParseError::new(path, format!("{nm} nm"), "a wavelength in nm"));
    }
    if rows.is_empty() {
        return Err(ParseError::new(path, "no value", "measured values"));
    }
    let mut meta = Meta::new();
    meta.insert("read_from".into(), json!(format.name()));
    if missing > 0 {
        meta.insert("without_value".into(), json!(missing));
    }
    Ok(Samples { wavelength_nm: vec![nm], rows, meta })
}

fn sample(theta_i_deg: f64, phi_i_deg: f64, theta_o_deg: f64, phi_o_deg: f64, f: f64) -> Sample {
    Sample {
        theta_i_deg,
        phi_i_deg,
        theta_o_deg,
        phi_o_deg,
        brdf_per_sr: vec![f],
        sigma_per_sr: Vec::new(),
    }
}

/// FRED has the azimuth of scattered light 0 on the mirrored side; ours is the light's + 180° there.
fn from_fred(file: &FredScatter) -> Vec<Sample> {
    let of = |i: &FredIncidence| {
        let (theta, phi) = (i.theta_deg, i.phi_deg + 180.0);
        let row = move |r: &FredRow| sample(theta, phi, r.theta_deg, r.phi_deg, r.bsdf_per_sr);
        i.rows.iter().map(row).collect::<Vec<_>>()
    };
    file.incidences.iter().flat_map(of).collect()
}

/// Values of one wavelength as FRED reads them. Values that are no numbers or negative are left out.
pub fn to_fred(samples: &Samples, column: usize) -> FredScatter {
    let mut file = FredScatter::default();
    for row in &samples.rows {
        let Some(value) =
            row.brdf_per_sr.get(column).copied().filter(|v| v.is_finite() && *v >= 0.0)
        else {
            continue;
        };
        let (theta_deg, phi_deg) = (row.theta_i_deg, row.phi_i_deg - 180.0);
        let same = |i: &&mut FredIncidence| {
            (i.theta_deg - theta_deg).abs() < 1e-9 && (i.phi_deg - phi_deg).abs() < 1e-9
        };
        let scattered =
            FredRow { theta_deg: row.theta_o_deg, phi_deg: row.phi_o_deg, bsdf_per_sr: value };
        match file.incidences.iter_mut().find(same) {
            Some(incidence) => incidence.rows.push(scattered),
            None => {
                file.incidences.push(FredIncidence { theta_deg, phi_deg, rows: vec![scattered] });
            }
        }
    }
    file
}

/// The direction at a radial angle and an azimuth about the mirrored ray of light with the azimuth 180°: 0 towards the normal.
fn about_mirrored(theta_i_deg: f64, azimuth_deg: f64, radial_deg: f64) -> DVec3 {
    let (sin_i, cos_i) = theta_i_deg.to_radians().sin_cos();
    let (sin_r, cos_r) = radial_deg.to_radians().sin_cos();
    let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
    let mirrored = DVec3::new(sin_i, 0.0, cos_i);
    let to_normal = DVec3::new(-cos_i, 0.0, sin_i);
    mirrored * cos_r + (to_normal * cos_a + DVec3::Y * sin_a) * sin_r
}

/// Azimuth and radial angle about the mirrored ray, degrees.
fn of_mirrored(theta_i_deg: f64, o: DVec3) -> (f64, f64) {
    let (sin_i, cos_i) = theta_i_deg.to_radians().sin_cos();
    let mirrored = DVec3::new(sin_i, 0.0, cos_i);
    let to_normal = DVec3::new(-cos_i, 0.0, sin_i);
    let (x, y, z) = (o.dot(to_normal), o.y, o.dot(mirrored));
    (y.atan2(x).to_degrees(), x.hypot(y).atan2(z).to_degrees())
}

/// Angle from the normal and azimuth, degrees.
fn angles(o: DVec3) -> (f64, f64) {
    (o.x.hypot(o.y).atan2(o.z).to_degrees(), o.y.atan2(o.x).to_degrees())
}

/// The values, and how many directions above the horizon have none.
fn from_zemax(path: &Path, file: &ZemaxBsdf) -> Result<(Vec<Sample>, usize), ParseError> {
    if file.transmitted {
        let error = ParseError::new(path, "BTDF", "BRDF").in_field("ScatterType");
        return Err(error.with_hint("transmitted light has no place in a table of reflected light"));
    }
    let (mut rows, mut missing, mut at) = (Vec::new(), 0, 0);
    for theta_i in &file.incidence_deg {
        for (k, azimuth) in file.azimuth_deg.iter().enumerate() {
            for radial in &file.radial_deg {
                let value = file.value_per_sr[at];
                at += 1;
                // On the mirrored ray all azimuths are one direction.
                if *radial == 0.0 && k > 0 {
                    continue;
                }
                let o = about_mirrored(*theta_i, *azimuth, *radial);
                if o.z <= 1e-9 {
                    continue;
                }
                if value == 0.0 {
                    missing += 1;
                    continue;
                }
                let (theta_o, phi_o) = angles(o);
                rows.push(sample(*theta_i, 180.0, theta_o, phi_o, value));
            }
        }
    }
    Ok((rows, missing))
}

/// Why values cannot be written for Zemax.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// Directions that are no grid about the mirrored ray.
    #[error(
        "the directions are no grid about the mirrored ray ({azimuths} azimuths × {radials} angles for {values} values at {theta_i_deg}° of incidence), as Zemax's format needs: write FRED's, which takes any directions"
    )]
    NoGrid {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Azimuths that there are.
        azimuths: usize,
        /// Angles that there are.
        radials: usize,
        /// Values that there are.
        values: usize,
    },
    /// A table with several azimuths of incidence.
    #[error("the table has several azimuths of incidence, and Zemax's format is written for one")]
    Azimuths,
}

/// Values as Zemax reads them, from directions on a grid about the mirrored ray, such as a file of Zemax's gives.
///
/// # Errors
/// Directions that are no such grid, several azimuths of incidence.
pub fn to_zemax(samples: &Samples, column: usize) -> Result<ZemaxBsdf, WriteError> {
    if samples.has_azimuths() {
        return Err(WriteError::Azimuths);
    }
    let rounded = |deg: f64| (deg * 1e6).round() as i64;
    let (mut incidences, mut azimuths, mut radials) =
        (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    let mut found = std::collections::BTreeMap::new();
    for row in &samples.rows {
        let Some(value) =
            row.brdf_per_sr.get(column).copied().filter(|v| v.is_finite() && *v > 0.0)
        else {
            continue;
        };
        let (i, o) = row.directions();
        let o = turned(i, o).1;
        // Light at the azimuth 180°.
        let (azimuth, radial) =
            of_mirrored(row.theta_i_deg.abs(), DVec3::new(-o.x, o.y.abs(), o.z));
        let (theta, mut azimuth, radial) =
            (rounded(row.theta_i_deg.abs()), rounded(azimuth), rounded(radial));
        if radial == 0 {
            azimuth = -1;
        } else {
            azimuths.insert(azimuth);
        }
        incidences.insert(theta);
        radials.insert(radial);
        found.insert((theta, azimuth, radial), value);
    }
    if azimuths.is_empty() {
        azimuths.insert(0);
    }
    let deg = |all: &BTreeSet<i64>| all.iter().map(|v| *v as f64 / 1e6).collect::<Vec<f64>>();
    let (mut tis, mut value_per_sr) = (Vec::new(), Vec::new());
    for theta in &incidences {
        let of_this: Vec<_> = found.iter().filter(|((t, ..), _)| t == theta).collect();
        let cells = azimuths.len() * radials.len();
        // A quarter of a grid's places may lie below the horizon or have no value; what fills less is none.
        if of_this.len() * 4 < cells {
            return Err(WriteError::NoGrid {
                theta_i_deg: *theta as f64 / 1e6,
                azimuths: azimuths.len(),
                radials: radials.len(),
                values: of_this.len(),
            });
        }
        let theta_deg = *theta as f64 / 1e6;
        let i = direction(theta_deg, 180.0);
        let o: Vec<DVec3> = of_this
            .iter()
            .map(|((_, a, r), _)| about_mirrored(theta_deg, *a as f64 / 1e6, *r as f64 / 1e6))
            .collect();
        let weights = hemisphere::weights(i, &o);
        tis.push(weights.iter().zip(&of_this).map(|(w, (_, v))| w * **v).sum());
        for azimuth in &azimuths {
            for radial in &radials {
                let azimuth = if *radial == 0 { -1 } else { *azimuth };
                value_per_sr.push(found.get(&(*theta, azimuth, *radial)).copied().unwrap_or(0.0));
            }
        }
    }
    Ok(ZemaxBsdf {
        comments: vec![format!("{} nm, written by sunglint", samples.wavelength_nm[column])],
        source: "Measured".into(),
        plane_symmetrical: true,
        transmitted: false,
        incidence_deg: deg(&incidences),
        azimuth_deg: deg(&azimuths),
        radial_deg: deg(&radials),
        tis,
        value_per_sr,
    })
}

/// Whether the last comment line before the values names the columns.
fn columns_header(text: &str) -> bool {
    let mut last = "";
    for line in text.lines().map(str::trim).filter(|l| !l.is_empty()) {
        match line.strip_prefix('#') {
            Some(comment) if !comment.trim().is_empty() => last = comment,
            Some(_) => {}
            None => break,
        }
    }
    let names: Vec<String> = last.split_whitespace().map(str::to_lowercase).collect();
    let is = |k: usize, all: [&str; 2]| names.get(k).is_some_and(|n| all.contains(&n.as_str()));
    names.len() == 5
        && is(0, ["phi_i", "phi_in"])
        && is(1, ["theta_i", "theta_in"])
        && is(2, ["phi_o", "phi_out"])
        && is(3, ["theta_o", "theta_out"])
        && is(4, ["brdf", "bsdf"])
}

/// A wavelength that a comment says: `lambda = 532 nm`.
fn said_wavelength(text: &str) -> Option<f64> {
    let comments = text.lines().map(str::trim).take_while(|l| l.is_empty() || l.starts_with('#'));
    for comment in comments.filter(|c| c.contains("wavelength") || c.contains("lambda")) {
        let Some((_, value)) = comment.split_once('=') else { continue };
        let mut words = value.split_whitespace();
        let number = words.next().and_then(|w| w.parse::<f64>().ok());
        if words.next() == Some("nm") {
            return number;
        }
    }
    None
}

/// In these tables phi is the angle from the normal and theta the azimuth.
fn from_columns(path: &Path, text: &str) -> Result<Vec<Sample>, ParseError> {
    let mut rows = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let bad = |expected: &str| {
            let shown: String = line.chars().take(60).collect();
            ParseError::new(path, shown, expected).at_line(k as u64 + 1)
        };
        let numbers: Option<Vec<f64>> = line
            .split_whitespace()
            .map(|w| w.parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect();
        match numbers.as_deref() {
            Some([theta_i, phi_i, theta_o, phi_o, f]) => {
                if theta_i.abs() > 90.0 || theta_o.abs() > 90.0 {
                    return Err(bad("angles from the normal of up to 90°"));
                }
                rows.push(sample(*theta_i, *phi_i, *theta_o, *phi_o, *f));
            }
            _ => return Err(bad("five numbers: phi_i, theta_i, phi_o, theta_o, brdf")),
        }
    }
    Ok(rows)
}
