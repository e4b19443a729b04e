//! Properties of a material, and the differences of two: slices, hemispherical reflectance, reciprocity.

use crate::exchange::Exchange;
use crate::read::ReadError;
use crate::samples::{Sample, direction};
use std::path::Path;
use sunglint_formats::bsdf::TensorFile;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError};
use sunglint_simulator::surface::brdf_table::{self, Row};
use sunglint_simulator::surface::file::{MaterialFile, material};
use sunglint_simulator::surface::{Material, MaterialError, measured};

/// Angles of incidence that are shown, degrees.
const INCIDENCES: [f64; 6] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0];
/// Angles at which the hemispherical reflectance is asked, degrees.
const HEMISPHERE: [f64; 12] =
    [0.0, 15.0, 30.0, 40.0, 50.0, 60.0, 70.0, 75.0, 80.0, 84.0, 87.0, 89.0];

/// Why a material cannot be looked at.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LookError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is no material.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A table that cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// No such material.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// A file of several materials.
    #[error("{file}: found the materials {names}; say which: {file}#NAME")]
    Which {
        /// The file.
        file: String,
        /// Names of the materials in the file.
        names: String,
    },
    /// A mirror reflects into one direction alone.
    #[error("{name}: a perfect mirror has no values to {what}")]
    Mirror {
        /// The material.
        name: String,
        /// Requested use of the values.
        what: &'static str,
    },
    /// Two materials that never reflect in the same direction.
    #[error("the two have no direction in common in which both reflect")]
    Apart,
}

#[derive(Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialsFile {
    material: Vec<MaterialFile>,
}

/// An angle of incidence with f by outgoing angle.
pub type Slice = (f64, Vec<(f64, f64)>);

/// A material from what a person names.
///
/// # Errors
/// A file that cannot be read or is no material.
pub fn read(name: &str, wavelength_nm: f64) -> Result<Material, LookError> {
    let (file, wanted) = match name.rsplit_once('#') {
        Some((file, wanted)) => (file, Some(wanted)),
        None => (name, None),
    };
    let path = Path::new(file);
    let is = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    // Zemax's tables have the same ending and are text.
    if is("bsdf") && matches!(crate::read::exchange_format(path), None | Some(Exchange::Rgl)) {
        let tensors = TensorFile::read(path)?;
        let made = measured::material(file, path, &tensors)?;
        let lacks = crate::assemble::not_measured(&tensors).into_iter();
        return Ok(lacks.fold(made, Material::with_note));
    }
    if is("toml") {
        let document = Document::read(path)?;
        let found: MaterialsFile = document.parse()?;
        let names: Vec<&str> = found.material.iter().map(|m| m.name.as_str()).collect();
        let at = match wanted {
            Some(wanted) => names.iter().position(|n| *n == wanted),
            None => Some(0).filter(|_| names.len() == 1),
        };
        let at =
            at.ok_or_else(|| LookError::Which { file: file.to_owned(), names: names.join(", ") })?;
        let key = format!("material[{at}]");
        return Ok(material(&document, &key, &found.material[at])?.0);
    }
    let (table, _) = crate::read::samples(path, Some(wavelength_nm))?;
    // What a fit leaves out is left out here, too.
    let known = |r: &&Sample| r.brdf_per_sr.iter().all(|v| v.is_finite() && *v >= 0.0);
    let left = table.rows.iter().filter(|r| !known(r)).count();
    let rows: Vec<Row> = table
        .rows
        .iter()
        .filter(known)
        .map(|r| Row {
            theta_i_deg: r.theta_i_deg,
            phi_i_deg: r.phi_i_deg,
            theta_o_deg: r.theta_o_deg,
            phi_o_deg: r.phi_o_deg,
            brdf_per_sr: r.brdf_per_sr.clone(),
        })
        .collect();
    let mut made = brdf_table::material(file, &table.wavelength_nm, &rows, None)?;
    if left > 0 {
        let all = table.rows.len();
        made = made.with_note(format!("{left} of {all} rows are below 0 or no number: left out"));
    }
    let said = crate::exchange::warnings(&table).into_iter();
    for note in said.chain(crate::fit::saturation_note(&table)) {
        made = made.with_note(note);
    }
    Ok(made)
}

/// Returns a warning where a material's spectra do not reach a wavelength.
pub fn beyond(material: &Material, nm: f64) -> Option<String> {
    // The spectrum that says that a geometry was not measured covers no wavelength.
    let ranges = || material.spectra().iter().map(|s| s.range_nm()).filter(|r| r.1 > 1.0);
    let from = ranges().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let to = ranges().map(|r| r.1).fold(f64::INFINITY, f64::min);
    let is_within = nm >= from && nm <= to;
    (!is_within).then(|| {
        format!(
            "{}: it is known from {from} to {to} nm, not at {nm} nm: the nearest value is held",
            material.name
        )
    })
}

/// Outgoing angles of a slice: finer around the mirrored direction.
fn angles(theta_i: f64) -> Vec<f64> {
    let mut all: Vec<f64> = (-88..=88).map(f64::from).collect();
    all.extend(
        (-90..=90).map(|k: i32| theta_i + f64::from(k.signum()) * 0.01 * 1.07_f64.powi(k.abs())),
    );
    all.retain(|a| a.abs() <= 89.0);
    all.sort_by(f64::total_cmp);
    all
}

/// The typical and largest |ln f(i, o)/f(o, i)| over directions of both kinds.
fn reciprocity(material: &Material, nm: f64) -> (f64, f64) {
    let mut found = Vec::new();
    for (k, theta_i) in INCIDENCES.iter().enumerate() {
        for theta_o in INCIDENCES.iter().skip(k + 1) {
            for phi in [0.0, 45.0, 90.0, 135.0, 180.0] {
                let (i, o) = (direction(theta_i + 3.0, 0.0), direction(*theta_o + 3.0, phi));
                let (there, back) = (material.brdf(nm, i, o), material.brdf(nm, o, i));
                if there > 0.0 && back > 0.0 {
                    found.push((there / back).ln().abs());
                }
            }
        }
    }
    found.sort_by(f64::total_cmp);
    match found.len() {
        0 => (f64::NAN, f64::NAN),
        n => (found[n / 2], found[n - 1]),
    }
}

/// Properties of a material at a wavelength.
#[derive(Debug, Clone)]
pub struct Look {
    /// Hemispherical reflectance by angle of incidence, degrees.
    pub albedo: Vec<(f64, f64)>,
    /// The typical and the largest |ln f(i, o)/f(o, i)|.
    pub reciprocity: (f64, f64),
    /// f in the plane of incidence.
    pub slices: Vec<Slice>,
    /// Warnings that the user should read first.
    pub warnings: Vec<String>,
}

impl Look {
    /// Looks at a material from one azimuth of the light; `name` is what it is called where it is refused.
    ///
    /// # Errors
    /// A mirror; an albedo that cannot be integrated.
    pub fn new(
        material: &Material,
        name: &str,
        nm: f64,
        phi_i_deg: f64,
    ) -> Result<Self, LookError> {
        if material.is_mirror() {
            return Err(LookError::Mirror { name: name.to_owned(), what: "show" });
        }
        let mut warnings: Vec<String> = material.notes().to_vec();
        warnings.extend(beyond(material, nm));
        let mut albedo = Vec::new();
        for theta in HEMISPHERE {
            albedo.push((theta, material.albedo(nm, direction(theta, phi_i_deg))?));
        }
        for (theta, e) in albedo.iter().filter(|(_, e)| *e > 1.0 + 1e-3) {
            let is_coarse =
                material.notes().iter().any(|n| n.starts_with(brdf_table::NOT_RESOLVED));
            let why = if is_coarse {
                ": the table's directions are too far apart for its peak, the material may be in order"
            } else {
                ""
            };
            warnings.push(format!("it reflects {e:.4} of the light at {theta}° of incidence{why}"));
        }
        let reciprocity = reciprocity(material, nm);
        let slice = |theta: f64| -> Vec<(f64, f64)> {
            let i = direction(theta, phi_i_deg);
            let of = |a: &f64| (*a, material.brdf(nm, i, direction(*a, phi_i_deg + 180.0)));
            angles(theta).iter().map(of).collect()
        };
        let slices = INCIDENCES.iter().map(|t| (*t, slice(*t))).collect();
        Ok(Self { albedo, reciprocity, slices, warnings })
    }
}

/// Ratios at one angle of incidence.
#[derive(Debug, Clone)]
pub struct Ratios {
    /// Angle of incidence, degrees.
    pub theta_i: f64,
    /// Angle and azimuth of the outgoing direction (from the light's), ratio b/a.
    pub all: Vec<(f64, f64, f64)>,
    /// Hemispherical reflectance b/a.
    pub albedo: f64,
}

/// How one material differs from another at a wavelength, by angle of incidence; `names` are what they are called where they are refused.
///
/// # Errors
/// A mirror; two that never reflect in the same direction.
pub fn compare(
    [a, b]: [&Material; 2],
    names: [&str; 2],
    nm: f64,
    phi_i_deg: f64,
) -> Result<Vec<Ratios>, LookError> {
    for (name, m) in names.into_iter().zip([a, b]) {
        if m.is_mirror() {
            return Err(LookError::Mirror { name: name.to_owned(), what: "compare" });
        }
    }
    let mut rows = Vec::new();
    for theta_i in INCIDENCES {
        let i = direction(theta_i, phi_i_deg);
        let mirrored = direction(theta_i, phi_i_deg + 180.0);
        let peak = a.brdf(nm, i, mirrored) * mirrored.z;
        let mut all = Vec::new();
        for phi in [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 165.0, 175.0, 180.0] {
            for theta_o in angles(theta_i).into_iter().filter(|t| (0.0..=85.0).contains(t)) {
                let o = direction(theta_o, phi_i_deg + phi);
                let (f, g) = (a.brdf(nm, i, o), b.brdf(nm, i, o));
                if f > 0.0 && g > 0.0 && f * o.z > 1e-3 * peak {
                    all.push((theta_o, phi, g / f));
                }
            }
        }
        all.sort_by(|x, y| x.2.ln().abs().total_cmp(&y.2.ln().abs()));
        let albedo = if all.is_empty() { f64::NAN } else { b.albedo(nm, i)? / a.albedo(nm, i)? };
        rows.push(Ratios { theta_i, all, albedo });
    }
    if rows.iter().all(|r| r.all.is_empty()) {
        return Err(LookError::Apart);
    }
    Ok(rows)
}

/// Phase angles at which bodies are shown, degrees.
const PHASES_DEG: std::ops::RangeInclusive<i32> = 1..=34;

/// Radiant intensity over the irradiance, m² sr⁻¹, by phase angle, degrees.
pub type PhaseCurve = Vec<(f64, f64)>;

/// A ball of 1 m radius, every 5° of phase angle; `None` of a material with a tangent, which a ball has not.
///
/// # Errors
/// A sphere's integral that does not converge.
pub fn ball(material: &Material, nm: f64) -> Result<Option<PhaseCurve>, LookError> {
    if !material.is_isotropic() {
        return Ok(None);
    }
    let at = |k: i32| {
        let deg = 5.0 * f64::from(k);
        let mut sum = vec![0.0; material.spectra().len()];
        material.add_sphere_weights(deg.to_radians(), 1.0, &mut sum)?;
        Ok((deg, material.times_spectra(nm, &sum)))
    };
    PHASES_DEG.map(at).collect::<Result<_, LookError>>().map(Some)
}

/// A box of 1 × 1 × 1.3 m that turns about the normal of the plane of Sun and observer, with a wing of 8 m² towards the Sun, all of the material: the mean over a turn, every 5° of phase angle.
/// Steps of the turn are shorter where a side mirrors the Sun, down to 3e-6 rad, so that a narrow lobe is not missed.
/// Convex and without shadows between the parts.
pub fn box_wing(material: &Material, nm: f64) -> PhaseCurve {
    use glam::DVec3;
    let observer = DVec3::X;
    let one = |phase: f64| {
        let sun = DVec3::new(phase.cos(), phase.sin(), 0.0);
        let side = |area: f64, normal: DVec3| {
            // The tangent lies in the plane of Sun and observer.
            let tangent = DVec3::Z.cross(normal);
            let into =
                |v: DVec3| DVec3::new(v.dot(tangent), v.dot(normal.cross(tangent)), v.dot(normal));
            let (i, o) = (into(sun), into(observer));
            if i.z <= 0.0 || o.z <= 0.0 {
                return 0.0;
            }
            area * i.z * o.z * material.brdf(nm, i, o)
        };
        // From the turn at which a side mirrors: u = w sinh s, by equal steps of s.
        let (narrow_rad, steps) = (1e-4, 400);
        let step = (0.5 * std::f64::consts::PI / narrow_rad).asinh() / f64::from(steps);
        let turned = |k: i32| {
            let s = f64::from(k) * step;
            let (sin, cos) = (0.5 * phase + narrow_rad * s.sinh()).sin_cos();
            side(1.3, DVec3::new(cos, sin, 0.0)) * narrow_rad * s.cosh() * step
        };
        let of_one: f64 = (-steps..=steps).map(turned).sum();
        4.0 * of_one / std::f64::consts::TAU + side(8.0, sun)
    };
    PHASES_DEG.map(|k| (5.0 * f64::from(k), one((5.0 * f64::from(k)).to_radians()))).collect()
}
