//! Colour of a fitted surface: a reflectance spectrum at one geometry, or hemispherical, divided among the parts.
//!
//! The fit knows f at one wavelength λ₀ and which part of it is diffuse. A spectrum tells how the sum of the parts changes with wavelength, at one geometry only, and multiplied onto the whole it
//! would colour a neutral gloss. Two divisions are possible and lie at the ends of what there is:
//!
//! - **neutral**: what mirrors is a dielectric, whose F hardly changes with wavelength; the diffuse part takes all colour;
//! - **alike**: what mirrors is a metal, whose F has the colour, and so has its diffuse light.
//!
//! F at normal incidence decides: below 0.12 (n < 2.1) there is no metal, above 0.35 no dielectric. A surface without diffuse light has one division only. Between, both are carried: their geometric mean
//! is taken, and half of what they are apart is the doubt. g of a mirror goes as 1/λ in all of them.

use super::model::{Cone, Tint};
use super::{Surface, SurfaceFit};
use crate::samples::{direction, turned};
use serde::Serialize;
use std::fmt;
use sunglint_simulator::surface::{Material, MaterialError};

/// F at normal incidence of dielectrics and of metals.
const DIELECTRIC: f64 = 0.12;
const METAL: f64 = 0.35;
/// A diffuse part of less than this share of the spectrum's reflectance is not told from the gloss: an error of the gloss is more than three times as large in it.
const TOO_DARK: f64 = 0.25;
/// The most wavelengths that are kept.
const MOST: usize = 400;

/// The geometry of a reflectance spectrum.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum SpectrumGeometry {
    /// Light from one direction to another.
    Directional {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Angle of the detector, degrees.
        theta_o_deg: f64,
        /// Azimuth of the detector from the light's, degrees: 180 on the mirrored side.
        azimuth_deg: f64,
    },
    /// Light from one direction to all, as an integrating sphere measures it with the specular port closed.
    Hemispherical {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
    },
}

/// How the colour was divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Division {
    /// Lobes and mirror are neutral.
    Neutral,
    /// All parts have the spectrum's colour.
    Alike,
    /// Not determined: between both.
    Undetermined,
}

impl fmt::Display for Division {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Neutral => "gloss and mirror are neutral, the diffuse part has the colour",
            Self::Alike => "all parts have the colour of the spectrum",
            Self::Undetermined => {
                "not determined which part has the colour: between neutral gloss and all parts alike"
            }
        })
    }
}

/// Why a spectrum cannot be divided.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ColourError {
    /// It does not reach the wavelength of the fit.
    #[error(
        "the spectrum reaches from {from_nm} to {to_nm} nm and the fit is of {fit_nm} nm: it has to hold that wavelength"
    )]
    Apart {
        /// Begin of the spectrum, nm.
        from_nm: f64,
        /// End of the spectrum, nm.
        to_nm: f64,
        /// Wavelength of the fit, nm.
        fit_nm: f64,
    },
    /// Wavelengths or values that are none.
    #[error("the spectrum: found {found}, expected {expected}")]
    Spectrum {
        /// Found text or number.
        found: String,
        /// Expected text or number.
        expected: &'static str,
    },
    /// A geometry below the horizon.
    #[error("the spectrum's {name} is {deg}°, expected an angle from 0 to below 90°")]
    Horizon {
        /// Which angle.
        name: &'static str,
        /// Value of the angle, degrees.
        deg: f64,
    },
}

/// Colours of the parts of a fitted surface.
#[derive(Debug, Clone, Serialize)]
pub struct Coloured {
    /// Wavelengths, vacuum nm.
    pub wavelength_nm: Vec<f64>,
    /// Reflectance of lobes and mirror over that at the wavelength of the fit (without the mirror's coherence).
    pub specular: Vec<f64>,
    /// The same of the diffuse part.
    pub diffuse: Vec<f64>,
    /// How the colour was divided.
    pub division: Division,
    /// The share of lobes and mirror in f, or in the reflectance, of the spectrum's geometry.
    pub specular_share: f64,
    /// Half of what ln f of a part is apart between the extremes, the largest over parts and wavelengths; 0 where the division is determined.
    pub most_apart_ln: f64,
    /// Faults, in words.
    pub warnings: Vec<String>,
    #[serde(skip)]
    tint: Tint,
    /// Neutral and alike.
    #[serde(skip)]
    extremes: [Tint; 2],
}

impl Coloured {
    /// The material with these colours.
    ///
    /// # Errors
    /// More light than came up to 60° of incidence.
    pub fn material(&self, fit: &SurfaceFit, name: &str) -> Result<Material, MaterialError> {
        fit.surface.tinted(name, &self.tint)
    }

    /// The materials of both extremes: neutral gloss, and all parts alike. Where the division is determined the second one is what scaling the whole would give.
    ///
    /// # Errors
    /// More light than came up to 60° of incidence.
    pub fn extremes(&self, fit: &SurfaceFit, name: &str) -> Result<[Material; 2], MaterialError> {
        let [a, b] = &self.extremes;
        Ok([fit.surface.tinted(name, a)?, fit.surface.tinted(name, b)?])
    }

    /// The material as `[[material]]` of a scene.
    pub fn to_toml(&self, fit: &SurfaceFit, name: &str) -> String {
        fit.toml_of(name, &self.tint, Some(self))
    }
}

fn angle(name: &'static str, deg: f64) -> Result<f64, ColourError> {
    if (0.0..90.0).contains(&deg.abs()) { Ok(deg) } else { Err(ColourError::Horizon { name, deg }) }
}

/// Returns the light of lobes and mirror, and diffuse light, at the spectrum's geometry.
fn parts(
    surface: &Surface,
    geometry: SpectrumGeometry,
    cone: &Cone,
) -> Result<(f64, f64), ColourError> {
    match geometry {
        SpectrumGeometry::Directional { theta_i_deg, theta_o_deg, azimuth_deg } => {
            let i = direction(angle("angle of incidence", theta_i_deg)?, 0.0);
            let o = direction(angle("angle of the detector", theta_o_deg)?, azimuth_deg);
            let (i, o) = turned(i, o);
            Ok(surface.parts_at(i, o, cone))
        }
        SpectrumGeometry::Hemispherical { theta_i_deg } => {
            let cos = angle("angle of incidence", theta_i_deg)?.to_radians().cos();
            Ok(surface.parts_of_albedo(cos))
        }
    }
}

/// Divides a spectrum (vacuum nm, increasing; reflectance or BRDF in any unit) among the parts of a fitted surface.
///
/// # Errors
/// A spectrum that is none or does not reach the wavelength of the fit; a geometry below the horizon.
pub fn divide(
    fit: &SurfaceFit,
    geometry: SpectrumGeometry,
    wavelength_nm: &[f64],
    value: &[f64],
) -> Result<Coloured, ColourError> {
    let wrong = |found: String, expected| Err(ColourError::Spectrum { found, expected });
    if wavelength_nm.len() != value.len() || value.len() < 2 {
        let found = format!("{} wavelengths and {} values", wavelength_nm.len(), value.len());
        return wrong(found, "as many values as wavelengths, two or more");
    }
    if let Some(w) = wavelength_nm.windows(2).find(|w| !(w[0] > 0.0 && w[1] > w[0])) {
        return wrong(format!("{} after {} nm", w[1], w[0]), "increasing wavelengths above 0");
    }
    if let Some(v) = value.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
        return wrong(v.to_string(), "numbers of 0 or above");
    }
    let (from_nm, to_nm) = (wavelength_nm[0], wavelength_nm[wavelength_nm.len() - 1]);
    let at_nm = fit.wavelength_nm;
    if !(from_nm..=to_nm).contains(&at_nm) {
        return Err(ColourError::Apart { from_nm, to_nm, fit_nm: at_nm });
    }
    let here = interpolated(wavelength_nm, value, at_nm);
    if here <= 0.0 {
        return wrong(format!("{here} at {at_nm} nm"), "light at the wavelength of the fit");
    }
    let (nm, ratio) = thinned(wavelength_nm, value, here);
    let surface = &fit.surface;
    let (specular, diffuse) = parts(surface, geometry, &fit.cone)?;
    let whole = specular + diffuse;
    let (mut neutral, mut alike) = (Vec::new(), Vec::new());
    let mut missing = 0.0_f64;
    for (nm, ratio) in nm.iter().zip(&ratio) {
        // The mirror changes with wavelength whatever its F does.
        let (specular, diffuse) = parts(&surface.with_coherence(at_nm / nm), geometry, &fit.cone)?;
        let rest = ratio * whole - specular;
        missing = missing.max(-rest / (ratio * whole).max(1e-300));
        neutral.push(if diffuse > 0.0 { (rest / diffuse).max(0.0) } else { 1.0 });
        alike.push(ratio * whole / (specular + diffuse));
    }
    let tint = |specular: Vec<f64>, diffuse: Vec<f64>| Tint {
        wavelength_nm: nm.clone(),
        specular,
        diffuse,
        at_nm: Some(at_nm),
    };
    let extremes = [tint(vec![1.0; nm.len()], neutral), tint(alike.clone(), alike)];
    let normal = surface.at_normal();
    let no_metal = normal < DIELECTRIC || surface.index().is_some_and(|n| n < 2.1);
    let mut warnings = Vec::new();
    let division = if whole <= 0.0 || diffuse < TOO_DARK * whole {
        // A spectrum that sees hardly any diffuse light tells its colour no more than a diffuse part that is not there.
        if diffuse > 0.0 && no_metal { Division::Undetermined } else { Division::Alike }
    } else if no_metal && missing > 0.05 {
        warnings.push(format!(
            "neutral gloss would leave less than nothing to the diffuse part ({:.0} % of the spectrum is missing): the gloss has some of the colour, or its share is too large",
            100.0 * missing
        ));
        Division::Undetermined
    } else if no_metal {
        Division::Neutral
    } else if normal > METAL {
        Division::Alike
    } else {
        Division::Undetermined
    };
    let (chosen, most_apart_ln) = match division {
        Division::Neutral => (extremes[0].clone(), 0.0),
        Division::Alike => (extremes[1].clone(), 0.0),
        Division::Undetermined => {
            let mut most = 0.0_f64;
            let mut mean = |a: &[f64], b: &[f64]| -> Vec<f64> {
                let least = 1e-3;
                let pairs = a.iter().zip(b).map(|(a, b)| (a.max(least), b.max(least)));
                pairs
                    .map(|(a, b)| {
                        most = most.max(0.5 * (a / b).ln().abs());
                        (a * b).sqrt()
                    })
                    .collect()
            };
            let specular = mean(&extremes[0].specular, &extremes[1].specular);
            let diffuse = mean(&extremes[0].diffuse, &extremes[1].diffuse);
            (tint(specular, diffuse), most)
        }
    };
    Ok(Coloured {
        wavelength_nm: nm,
        specular: chosen.specular.clone(),
        diffuse: chosen.diffuse.clone(),
        division,
        specular_share: specular / whole.max(1e-300),
        most_apart_ln,
        warnings,
        tint: chosen,
        extremes,
    })
}

fn interpolated(x: &[f64], y: &[f64], at: f64) -> f64 {
    let k = x.partition_point(|x| *x <= at).clamp(1, x.len() - 1);
    let t = ((at - x[k - 1]) / (x[k] - x[k - 1])).clamp(0.0, 1.0);
    y[k - 1] + t * (y[k] - y[k - 1])
}

/// The spectrum over its value at the fit's wavelength, at most so many points: means between them would not change its integrals much, but every point is kept where there are few.
fn thinned(x: &[f64], y: &[f64], over: f64) -> (Vec<f64>, Vec<f64>) {
    if x.len() <= MOST {
        return (x.to_vec(), y.iter().map(|y| y / over).collect());
    }
    let last = (MOST - 1) as f64;
    let at = |k: usize| x[0] + (x[x.len() - 1] - x[0]) * k as f64 / last;
    let nm: Vec<f64> = (0..MOST).map(at).collect();
    let value = nm.iter().map(|nm| interpolated(x, y, *nm) / over).collect();
    (nm, value)
}
