//! Doubt of a body's light by the doubt of its materials.

use super::{Pass, PassError, Progress, Simulation, StatedError};
use crate::light::engine::Switches;
use crate::surface::Material;
use sunglint_numerics::order::median;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// Half-widths of the 95 % intervals that a body's light has by the doubt of its materials.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialDoubt {
    /// Names of the materials that say how well they are known; there is at least one.
    pub materials: Vec<String>,
    /// By channel of the station and sample, Hz; NaN where the rate is.
    pub channels_hz: Vec<Vec<f64>>,
    /// By sample: the same in the worst channel, relative to the rate; in V where the station has no channel. NaN without light or below the horizon.
    pub relative: Vec<f64>,
}

impl MaterialDoubt {
    /// Median and largest of the relative half-widths over the samples with light.
    pub fn over_the_pass(&self) -> Option<StatedError> {
        let all = || self.relative.iter().copied().filter(|r| r.is_finite());
        Some(StatedError { median: median(all())?, largest: all().reduce(f64::max)? })
    }
}

/// The place of V among the bands.
const V: usize = 2;

/// Makes a material that reflects nothing at any wavelength.
fn black(name: &str) -> Result<Material, PassError> {
    let wrong = |found: String| PassError::Input { needs: "a black material", found };
    let nothing = Spectrum::<Reflectance>::constant(0.0, 10.0, 1e6);
    let nothing = nothing.map_err(|e| wrong(e.to_string()))?;
    Material::lambert(name, nothing).map_err(|e| wrong(e.to_string()))
}

impl Simulation<'_> {
    /// How far the light may be off by the doubt of the body's materials ([`Material::ln_doubt`]), from direct sunlight; `None` where no material says how well it is
    /// known. All directions of one material are taken to be off alike, so that it is wide rather than narrow; different materials add in quadrature.
    ///
    /// # Errors
    /// [`PassError`], as of a simulation.
    pub fn material_doubt(
        &self,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Option<MaterialDoubt>, PassError> {
        let target = &self.pass.target;
        let known: Vec<(usize, Material)> = target
            .materials
            .iter()
            .enumerate()
            .filter_map(|(k, m)| Some((k, m.doubted()?)))
            .filter(|(k, _)| target.parts.iter().any(|p| p.material == *k))
            .collect();
        if known.is_empty() {
            return Ok(None);
        }
        let samples = self.places.len();
        let mut squares = vec![vec![0.0; samples]; self.channels.len()];
        let mut square_of_v = vec![0.0; samples];
        let mut materials = Vec::new();
        for (k, doubted) in known {
            let mut alone: Pass = self.pass.clone();
            for (other, material) in alone.target.materials.iter_mut().enumerate() {
                *material = if other == k { doubted.clone() } else { black(&material.name)? };
            }
            alone.effects = Switches { solar_disc: self.pass.effects.solar_disc, ..Switches::OFF };
            // An error of an error.
            alone.tolerance = alone.tolerance.max(1e-2);
            let made = alone.simulate(progress)?;
            for (sum, channel) in squares.iter_mut().zip(&made.channels) {
                for (sum, hz) in sum.iter_mut().zip(&channel.rate_hz) {
                    *sum += hz * hz;
                }
            }
            for (row, sum) in square_of_v.iter_mut().enumerate() {
                let fainter = made.magnitudes[[row, V]] - self.magnitudes[[row, V]];
                let share = 10_f64.powf(-0.4 * fainter);
                // Without light of this material there is no magnitude.
                *sum += if share.is_nan() { 0.0 } else { share * share };
            }
            materials.push(doubted.name);
        }
        let channels_hz: Vec<Vec<f64>> =
            squares.iter().map(|all| all.iter().map(|s| s.sqrt()).collect()).collect();
        let relative = (0..samples).map(|row| {
            if self.places[row].hidden {
                return f64::NAN;
            }
            if self.channels.is_empty() {
                let lit = self.magnitudes[[row, V]].is_finite();
                return if lit { square_of_v[row].sqrt() } else { f64::NAN };
            }
            let of = |(c, hz): (&super::ChannelSamples, &Vec<f64>)| {
                (c.rate_hz[row] > 0.0).then(|| hz[row] / c.rate_hz[row])
            };
            self.channels.iter().zip(&channels_hz).filter_map(of).fold(f64::NAN, f64::max)
        });
        let relative = relative.collect();
        Ok(Some(MaterialDoubt { materials, channels_hz, relative }))
    }
}
