//! The air in words.

use super::{Aerosol, Air};

impl Air {
    /// Describes the air in a line: its profile, columns and aerosol.
    pub fn describe(&self) -> String {
        let (options, c) = (self.options(), self.columns());
        let aerosol = match options.aerosol {
            Aerosol::Angstrom { exponent, .. } => {
                format!("aerosol τ(550 nm) {:.3}, exponent {exponent}", c.aerosol_550)
            }
            Aerosol::Model(model) => format!("aerosol {model}, τ(550 nm) {:.3}", c.aerosol_550),
            _ => "no aerosol".to_owned(),
        };
        format!(
            "{} at {} m: {:.1} hPa, {:.1} K, ozone {:.1} DU, water {:.2} mm, CO2 {:.0} ppm, {aerosol}",
            options.profile.name(),
            options.altitude_m,
            c.pressure_hpa,
            c.temperature_k,
            c.ozone_du,
            c.water_mm,
            c.co2_ppm
        )
    }
}
