//! Doubt of a body's light by the doubt of its materials.

use super::{Pass, PassError, Progress, Simulation, StatedError};
use crate::light::engine::Switches;
use crate::surface::{Material, MaterialError};
use crate::target::Target;
use sunglint_numerics::order::RunningMedian;

/// Half-widths of the 95 % intervals that a body's light has by the doubt of one material, all directions off alike.
#[derive(Debug, Clone, PartialEq)]
pub struct OneMaterial {
    /// Name of the material.
    pub material: String,
    /// By channel of the station and sample, Hz; NaN where the rate is.
    pub channels_hz: Vec<Vec<f64>>,
    /// By sample, relative to the body's light in V; 0 where this material sends none, NaN where the body sends none.
    pub v_relative: Vec<f64>,
}

/// Half-widths of the 95 % intervals that a body's light has by the doubt of its materials.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialDoubt {
    /// Material by material, those that say how well they are known; there is at least one.
    pub each: Vec<OneMaterial>,
    /// By channel of the station and sample, Hz; NaN where the rate is.
    pub channels_hz: Vec<Vec<f64>>,
    /// By sample, relative to the light in V; NaN where there is none.
    pub v_relative: Vec<f64>,
    /// By sample: the same in the worst channel, relative to the rate; in V where the station has no channel. NaN without light or below the horizon.
    pub relative: Vec<f64>,
}

impl MaterialDoubt {
    /// Returns the names of the materials, with commas.
    pub fn names(&self) -> String {
        self.each.iter().map(|one| one.material.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// Median and largest of the relative half-widths over the samples with light.
    pub fn over_the_pass(&self) -> Option<StatedError> {
        let mut known = RunningMedian::default();
        self.relative.iter().filter(|r| r.is_finite()).for_each(|r| known.add(*r));
        StatedError::of(&known)
    }
}

/// The place of V among the bands.
const V: usize = 2;
/// Tolerance of the light by a doubted material: an error of an error.
pub(crate) const DOUBT_TOLERANCE: f64 = 1e-2;

/// The body for each of its materials that says how well it is known ([`Material::ln_doubt`]): with that doubt in place of its light, the others black. Light of these bodies is the half-width of the 95 % interval.
pub(crate) fn doubted(target: &Target) -> Result<Vec<(String, Target)>, MaterialError> {
    let mut found = Vec::new();
    for (k, material) in target.materials.iter().enumerate() {
        let Some(doubted) = material.doubted() else { continue };
        if !target.parts.iter().any(|p| p.material == k) {
            continue;
        }
        let mut alone = target.clone();
        for (other, material) in alone.materials.iter_mut().enumerate() {
            *material = if other == k { doubted.clone() } else { Material::black(&material.name)? };
        }
        found.push((doubted.name, alone));
    }
    Ok(found)
}

/// Light of a body by one doubted material, the others black.
pub(super) struct Light {
    material: String,
    channels_hz: Vec<Vec<f64>>,
    v: Vec<f64>,
}

impl Light {
    pub fn of(material: &str, made: Simulation<'_>) -> Self {
        Self {
            material: material.to_owned(),
            v: made.magnitudes.column(V).to_vec(),
            channels_hz: made.channels.into_iter().map(|c| c.rate_hz).collect(),
        }
    }
}

impl Pass {
    /// The pass by direct sunlight for each material that says how well it is known, with its doubt in place of its light and the others black.
    pub(super) fn doubted(&self) -> Result<Vec<(String, Pass)>, PassError> {
        let wrong = |error: MaterialError| PassError::Input {
            needs: "a black material",
            found: error.to_string(),
        };
        let mut passes = Vec::new();
        for (name, target) in doubted(&self.target).map_err(wrong)? {
            let mut alone: Pass = self.clone();
            alone.target = target;
            alone.effects = Switches { solar_disc: self.effects.solar_disc, ..Switches::OFF };
            alone.tolerance = alone.tolerance.max(DOUBT_TOLERANCE);
            passes.push((name, alone));
        }
        Ok(passes)
    }
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
        let passes = self.pass.doubted()?;
        let light = |(name, alone): &(String, Pass)| {
            alone.simulate(progress).map(|made| Light::of(name, made))
        };
        let made: Vec<Light> = passes.iter().map(light).collect::<Result<_, _>>()?;
        Ok((!made.is_empty()).then(|| self.doubt_by(made)))
    }

    /// The doubt, by the light that the body has by each doubted material alone.
    pub(super) fn doubt_by(&self, alone: Vec<Light>) -> MaterialDoubt {
        let samples = self.places.len();
        let mut each = Vec::new();
        for made in alone {
            let share = |row: usize| {
                if !self.magnitudes[[row, V]].is_finite() {
                    return f64::NAN;
                }
                let fainter = made.v[row] - self.magnitudes[[row, V]];
                let share = 10_f64.powf(-0.4 * fainter);
                // Without light of this material there is no magnitude.
                if share.is_nan() { 0.0 } else { share }
            };
            each.push(OneMaterial {
                material: made.material,
                v_relative: (0..samples).map(share).collect(),
                channels_hz: made.channels_hz,
            });
        }
        let root = |of: &dyn Fn(&OneMaterial) -> f64| {
            each.iter().map(|one| of(one).powi(2)).sum::<f64>().sqrt()
        };
        let channels_hz: Vec<Vec<f64>> = (0..self.channels.len())
            .map(|c| (0..samples).map(|row| root(&|one| one.channels_hz[c][row])).collect())
            .collect();
        let v_relative: Vec<f64> =
            (0..samples).map(|row| root(&|one| one.v_relative[row])).collect();
        let relative = (0..samples).map(|row| {
            if self.places[row].hidden {
                return f64::NAN;
            }
            if self.channels.is_empty() {
                return v_relative[row];
            }
            let of = |(c, hz): (&super::ChannelSamples, &Vec<f64>)| {
                (c.rate_hz[row] > 0.0).then(|| hz[row] / c.rate_hz[row])
            };
            self.channels.iter().zip(&channels_hz).filter_map(of).fold(f64::NAN, f64::max)
        });
        let relative = relative.collect();
        MaterialDoubt { each, channels_hz, v_relative, relative }
    }
}
