//! Linear polarisation of a body's light.
//!
//! Unpolarised sunlight that microfacets or mirrors reflect once is polarised perpendicular to the plane of Sun, body and observer ([`crate::surface::PolarisedPart`]). Its
//! polarised part is simulated as a pass of its own, with all that shades and hides. What is not known, or not modelled, may be polarised in any way: it is in the error.

use super::{Pass, PassError, Progress, Simulation};
use crate::light::engine::Switches;
use crate::surface::{Material, MaterialError, PolarisedPart};
use glam::DVec3;

/// The place of V among the bands.
const V: usize = 2;

/// Linear polarisation of a body's light along a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Polarisation {
    /// Degree of linear polarisation, 0 to 1, after the air, by channel of the station and sample; NaN without light and below the horizon.
    pub channels: Vec<Vec<f64>>,
    /// Bound of the error of the degree, by channel and sample. Light between surfaces and from the Earth, the light of materials whose polarisation is not known, and
    /// what the simulation's stated error leaves open may each be polarised wholly, in either direction. Above 1 nothing is known of the degree; infinite where no light
    /// may be left, NaN where the degree is.
    pub channels_error: Vec<Vec<f64>>,
    /// Degree of linear polarisation in V, 0 to 1, before the air, by sample; NaN without light.
    pub v: Vec<f64>,
    /// Bound of the error of the degree in V, by sample, as [`Polarisation::channels_error`] but with the stated error of V.
    pub v_error: Vec<f64>,
    /// Position angle of the electric field, from north through east (ICRS), 0 to 180 deg, as the IAU counts it, by sample.
    pub angle_deg: Vec<f64>,
    /// Materials whose polarisation is not known: they have no refractive index.
    pub unknown: Vec<String>,
}

fn material(error: &MaterialError) -> PassError {
    PassError::Input { needs: "the polarised part of a material", found: error.to_string() }
}

/// Bound of the error of a degree of polarisation, by the light whose polarisation is not known and by the stated error of all light, both of that light.
///
/// Let Q̂ be the polarised part that was found and d = Q̂/Î its degree. The light of unknown polarisation, U, changes Q by U at most. The light is I = Î + e with |e| ≤ E. What is
/// more or less of it may itself be polarised wholly, in either direction: that changes Q by E at most. So Q/I − Q̂/Î = (Q − Q̂ − d e)/I is within (U + (1 + d) E)/(Î − E).
fn bound(degree: f64, unknown: f64, stated: f64) -> f64 {
    let left = 1.0 - stated;
    if left <= 0.0 { f64::INFINITY } else { (unknown + (1.0 + degree) * stated) / left }
}

/// Position angle of the direction perpendicular to the plane of Sun, body and observer, where the body is seen in a direction, deg.
fn angle_deg(seen: DVec3, sun: DVec3) -> f64 {
    let north = DVec3::Z - seen * seen.z;
    let east = DVec3::Z.cross(seen);
    let towards_sun = sun.dot(east).atan2(sun.dot(north)).to_degrees();
    (towards_sun + 90.0).rem_euclid(180.0)
}

/// Passes by direct sunlight that the polarisation of a pass is found from.
pub(super) struct Parts {
    /// The polarised part of the light.
    pub polarised: Pass,
    /// All light but that of materials whose polarisation is not known.
    pub diffuse_and_known: Pass,
    /// Names of these materials.
    pub unknown: Vec<String>,
}

impl Pass {
    /// The passes that the polarisation is found from.
    pub(super) fn polarised(&self) -> Result<Parts, PassError> {
        let target = &self.target;
        let used = |k: usize| target.parts.iter().any(|part| part.material == k);
        let black = |of: &Material| Material::black(&of.name).map_err(|e| material(&e));
        let mut polarised = self.direct();
        let mut diffuse_and_known = self.direct();
        let mut unknown = Vec::new();
        for (k, of) in target.materials.iter().enumerate() {
            let part = match used(k) {
                true => of.polarised().map_err(|e| material(&e))?,
                false => PolarisedPart::Nothing,
            };
            if matches!(part, PolarisedPart::Unknown) {
                unknown.push(of.name.clone());
                diffuse_and_known.target.materials[k] = black(of)?;
            }
            polarised.target.materials[k] = match part {
                PolarisedPart::Of(material) => *material,
                PolarisedPart::Nothing | PolarisedPart::Unknown => black(of)?,
            };
        }
        Ok(Parts { polarised, diffuse_and_known, unknown })
    }

    /// The same pass by direct sunlight alone.
    fn direct(&self) -> Pass {
        let mut pass = self.clone();
        pass.effects = Switches {
            solar_disc: self.effects.solar_disc,
            finite_distance: self.effects.finite_distance,
            ..Switches::OFF
        };
        pass
    }
}

impl Simulation<'_> {
    /// Linear polarisation of the light: one direct simulation of its polarised part, and one for what bounds the error.
    ///
    /// # Errors
    /// [`PassError`], as of a simulation; a refractive index between whose angles no interpolation holds.
    pub fn polarisation(
        &self,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Polarisation, PassError> {
        let parts = self.pass.polarised()?;
        let (polarised, known) =
            (parts.polarised.simulate(progress)?, parts.diffuse_and_known.simulate(progress)?);
        Ok(self.polarised_by(&polarised, &known, parts.unknown.clone()))
    }

    /// The polarisation, by the polarised part of the light and by the light of the materials whose polarisation is known.
    pub(super) fn polarised_by(
        &self,
        polarised: &Simulation<'_>,
        known: &Simulation<'_>,
        unknown: Vec<String>,
    ) -> Polarisation {
        let samples = self.places.len();
        let (mut channels, mut channels_error) = (Vec::new(), Vec::new());
        for (c, all) in self.channels.iter().enumerate() {
            let (part, known) = (&polarised.channels[c], &known.channels[c]);
            let degree = |row: usize| match all.rate_hz[row] > 0.0 {
                true => part.rate_hz[row] / all.rate_hz[row],
                false => f64::NAN,
            };
            let error = |row: usize| match all.rate_hz[row] > 0.0 {
                true => {
                    let all_hz = all.rate_hz[row];
                    let rest = (all_hz - known.rate_hz[row]).abs() / all_hz;
                    bound(degree(row), rest, all.error_hz[row] / all_hz)
                }
                false => f64::NAN,
            };
            channels.push((0..samples).map(degree).collect());
            channels_error.push((0..samples).map(error).collect());
        }
        let share = |of: &Simulation<'_>, row: usize| {
            let own = self.magnitudes[[row, V]];
            match (own.is_finite(), of.magnitudes[[row, V]]) {
                (false, _) => f64::NAN,
                // Without light there is no magnitude.
                (true, m) if m.is_nan() => 0.0,
                (true, m) => 10_f64.powf(-0.4 * (m - own)),
            }
        };
        let v: Vec<f64> = (0..samples).map(|row| share(polarised, row)).collect();
        // The magnitude's error is by how much fainter the light may be: of the light that is 1 − 10^(−0.4 Δm).
        let stated = |row: usize| 1.0 - 10_f64.powf(-0.4 * self.magnitude_errors[[row, V]]);
        let v_error = (0..samples)
            .map(|row| bound(v[row], (1.0 - share(known, row)).abs(), stated(row)))
            .collect();
        let angle = |place: &super::Place| {
            angle_deg(-place.geometry.to_observer, place.geometry.sun.direction_gcrs)
        };
        let angle_deg = self.places.iter().map(angle).collect();
        Polarisation { channels, channels_error, v, v_error, angle_deg, unknown }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn direction(ra_deg: f64, dec_deg: f64) -> DVec3 {
        let ((sin, cos), (sin_dec, cos_dec)) =
            (ra_deg.to_radians().sin_cos(), dec_deg.to_radians().sin_cos());
        DVec3::new(cos_dec * cos, cos_dec * sin, sin_dec)
    }

    /// Truth: tan q = cos δ' sin(α' − α)/(sin δ' cos δ − cos δ' sin δ cos(α' − α)) for the position angle of a place (α', δ') seen from (α, δ) (Meeus 1998, Astronomical
    /// Algorithms, chapter 17), and a right angle more.
    #[test]
    fn the_field_is_perpendicular_to_the_direction_of_the_sun() {
        for (at, sun) in [
            ([10.0, 20.0], [100.0, -5.0]),
            ([200.0, -40.0], [350.0, 60.0]),
            ([0.0, 0.0], [90.0, 0.0]),
        ] {
            let ra = f64::to_radians(sun[0] - at[0]);
            let (sin, cos) = f64::to_radians(at[1]).sin_cos();
            let (sin_sun, cos_sun) = f64::to_radians(sun[1]).sin_cos();
            let q = (cos_sun * ra.sin()).atan2(sin_sun * cos - cos_sun * sin * ra.cos());
            let expected = (q.to_degrees() + 90.0).rem_euclid(180.0);
            let found = angle_deg(direction(at[0], at[1]), direction(sun[0], sun[1]));
            let off = (found - expected + 90.0).rem_euclid(180.0) - 90.0;
            assert!(off.abs() < 1e-9, "{found} {expected}");
        }
    }
}
