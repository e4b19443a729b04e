//! Keys of a file that describe the air above a station.

use super::AirDefaults;
use crate::air::{Aerosol, AerosolModel, AirError, AirOptions, Profile};
use serde::Deserialize;
use sunglint_formats::ParseError;
use sunglint_formats::toml::{Document, Finite, NonNegative, Positive};

/// A table `[air]`; what is not given is as it is known otherwise.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AirFile {
    /// Name of the constituent profile.
    pub profile: Option<String>,
    /// Pressure at the site, hPa.
    pub pressure_hpa: Option<Positive>,
    /// Ozone column, Dobson units.
    pub ozone_du: Option<NonNegative>,
    /// Precipitable water above the site, mm.
    pub water_mm: Option<NonNegative>,
    /// CO₂, ppm by volume.
    pub co2_ppm: Option<NonNegative>,
    /// Name of an aerosol model, or `none`.
    pub aerosol: Option<String>,
    /// Ångström's law: optical depth above the site at 550 nm.
    pub aerosol_optical_depth_550: Option<NonNegative>,
    /// Exponent of Ångström's law (1.3).
    pub aerosol_exponent: Option<Finite>,
    /// A remark.
    pub note: Option<String>,
}

impl AirFile {
    /// The air of this table, which stands at the dotted key `at`, over what is `known` besides.
    ///
    /// # Errors
    /// An aerosol that there is not, or two of them.
    pub fn over(
        &self,
        document: &Document,
        at: &str,
        known: &AirDefaults,
    ) -> Result<AirDefaults, ParseError> {
        let error = |key: &str, expected: &str| document.error_at(&format!("{at}.{key}"), expected);
        let aerosol = match (&self.aerosol, &self.aerosol_optical_depth_550) {
            (Some(_), Some(_)) => {
                let expected = "either aerosol or aerosol_optical_depth_550, not both";
                return Err(error("aerosol", expected));
            }
            (Some(name), None) if name == "none" => Aerosol::None,
            (Some(name), None) => {
                AerosolModel::from_name(name).map(Aerosol::Model).ok_or_else(|| {
                    error("aerosol", &AerosolModel::ALL.map(AerosolModel::name).join(", "))
                })?
            }
            (None, Some(depth)) => Aerosol::Angstrom {
                optical_depth: depth.get(),
                wavelength_nm: 550.0,
                exponent: self.aerosol_exponent.as_ref().map_or(1.3, |e| e.get()),
                scale_height_m: 1800.0,
            },
            (None, None) if self.aerosol_exponent.is_some() => {
                return Err(error("aerosol_exponent", "also aerosol_optical_depth_550"));
            }
            (None, None) => known.aerosol,
        };
        Ok(AirDefaults {
            profile: self.profile.clone().unwrap_or_else(|| known.profile.clone()),
            pressure_hpa: self.pressure_hpa.map(Positive::get).or(known.pressure_hpa),
            ozone_du: self.ozone_du.map(NonNegative::get).or(known.ozone_du),
            water_mm: self.water_mm.map(NonNegative::get).or(known.water_mm),
            co2_ppm: self.co2_ppm.map(NonNegative::get).or(known.co2_ppm),
            aerosol,
        })
    }
}

impl AirDefaults {
    /// The air at an altitude, m.
    ///
    /// # Errors
    /// A profile that there is not.
    pub fn options(&self, altitude_m: f64) -> Result<AirOptions, AirError> {
        Ok(AirOptions {
            altitude_m,
            pressure_hpa: self.pressure_hpa,
            ozone_du: self.ozone_du,
            water_mm: self.water_mm,
            co2_ppm: self.co2_ppm,
            aerosol: self.aerosol,
            ..AirOptions::new(Profile::named(&self.profile)?)
        })
    }
}

/// Why an air could not be computed, at the key of the table `at` that is wrong; `altitude_key` says where the altitude stands.
pub fn air_error(
    document: &Document,
    at: &str,
    altitude_key: &str,
    error: &AirError,
) -> ParseError {
    let key = match error {
        AirError::UnknownProfile { .. } => format!("{at}.profile"),
        AirError::Option { option, .. } | AirError::EmptyColumn { option, .. } => {
            format!("{at}.{option}")
        }
        AirError::Altitude { .. } => altitude_key.to_owned(),
        _ => at.to_owned(),
    };
    document.error_at(&key, "an air that can be computed").with_hint(error.to_string())
}
