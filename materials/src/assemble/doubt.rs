//! Possible error of an assembled material, by direction.

use super::base::Field;
use super::{Coverage, spherical};
use serde::Serialize;

/// A pair of directions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Doubt {
    /// Polar angle of the light, degrees from the normal.
    pub theta_i_deg: f64,
    /// Azimuth of the light, degrees.
    pub phi_i_deg: f64,
    /// Polar angle of the observer, degrees from the normal.
    pub theta_o_deg: f64,
    /// Azimuth of the observer, degrees; the light's + 180° is the mirrored side.
    pub phi_o_deg: f64,
    /// Whether it is extrapolated.
    pub extrapolated: bool,
    /// Possible error of ln f: 0.1 is 10 %, 0.7 a factor of 2. Between samples it comes from leaving samples out, beyond them from the extrapolation.
    pub ln_doubt: f64,
}

/// Elevations of incidence in the table, about.
const INCIDENCES: usize = 8;

/// Every tenth degree of the observer's elevation to 80°, every 30° around, at some of the file's incidences.
pub(super) fn by_direction(
    field: &Field<'_>,
    coverage: &[Coverage],
    isotropic: bool,
) -> Vec<Doubt> {
    let azimuths = if isotropic { 0..7 } else { 0..12 };
    let nt = coverage.iter().take_while(|c| c.phi_i_deg == coverage[0].phi_i_deg).count();
    let step = nt.div_ceil(INCIDENCES).max(1);
    let mut table = Vec::new();
    for (k, c) in coverage.iter().enumerate() {
        if (k % nt) % step != 0 || c.theta_i_deg > 85.0 {
            continue;
        }
        let i = spherical(c.theta_i_deg.to_radians(), c.phi_i_deg.to_radians());
        for ring in 0..9 {
            // The normal once.
            for turn in azimuths.clone().take(if ring == 0 { 1 } else { 12 }) {
                let (theta_o_deg, turn) = (10.0 * f64::from(ring), 30.0 * f64::from(turn));
                let phi_o_deg = (c.phi_i_deg + turn + 180.0).rem_euclid(360.0) - 180.0;
                let phi_o_deg = if phi_o_deg == -180.0 { 180.0 } else { phi_o_deg };
                let o = spherical(theta_o_deg.to_radians(), phi_o_deg.to_radians());
                let stencil = field.stencil(i, o);
                let lowered = if stencil.measured { 0.0 } else { -c.lowered.max(1e-3).ln() };
                table.push(Doubt {
                    theta_i_deg: c.theta_i_deg,
                    phi_i_deg: c.phi_i_deg,
                    theta_o_deg,
                    phi_o_deg,
                    extrapolated: !stencil.measured,
                    ln_doubt: field.doubt(&stencil, i, o) + lowered,
                });
            }
        }
    }
    table
}
