//! Warnings about an air that can hardly be meant.

use super::{Aerosol, Air};

impl Air {
    /// Returns what is possible but most likely in another unit or for another altitude, as warnings.
    pub fn implausible(&self) -> Vec<String> {
        let options = self.options();
        let mut warnings = Vec::new();
        // The altitude lies within the profile, else there were no such air.
        if let (Some(hpa), Ok(usual)) =
            (options.pressure_hpa, options.profile.at(options.altitude_m))
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
}
