//! An air in words, and what in it can hardly be meant.

use serde_json::{Value, json};
use sunglint_radiometry::air::{Aerosol, Air};
use sunglint_report::rounded;

/// What is possible but most likely in another unit or for another altitude, as warnings.
pub fn implausible(air: &Air) -> Vec<String> {
    let options = air.options();
    let mut warnings = Vec::new();
    // The altitude lies within the profile, else there were no such air.
    if let (Some(hpa), Ok(usual)) = (options.pressure_hpa, options.profile.at(options.altitude_m))
        && (hpa / usual.pressure_hpa - 1.0).abs() > 0.1
    {
        warnings.push(format!(
            "the pressure of {hpa} hPa is {:.0} % of {:.0} hPa, which {} has at {} m: wanted is the station's own pressure in hPa, not reduced \
             to sea level, not inches or millimetres of mercury",
            100.0 * hpa / usual.pressure_hpa,
            usual.pressure_hpa,
            options.profile.name(),
            options.altitude_m
        ));
    }
    if let Some(du) = options.ozone_du.filter(|du| *du > 0.0 && *du < 80.0) {
        warnings.push(format!(
            "an ozone column of {du} DU is hardly ever measured (300 is usual): is it in atm-cm? multiply by 1000"
        ));
    }
    if let Aerosol::Angstrom { exponent, .. } = options.aerosol
        && !(-0.5..=3.0).contains(&exponent)
    {
        warnings.push(format!(
            "an Ångström exponent of {exponent} is outside -0.5 to 3, where air's lies: --aerosol wants TAU,ALPHA, the optical depth at 550 nm first"
        ));
    }
    warnings
}

/// The aerosol as summaries hold it.
pub(super) fn aerosol_json(air: &Air) -> Value {
    let depth = rounded(air.columns().aerosol_550);
    match air.options().aerosol {
        Aerosol::Angstrom { exponent, .. } => {
            json!({ "model": "angstrom", "optical_depth_550_nm": depth, "exponent": exponent })
        }
        Aerosol::Model(model) => json!({ "model": model.name(), "optical_depth_550_nm": depth }),
        _ => json!({ "model": "none", "optical_depth_550_nm": depth }),
    }
}
