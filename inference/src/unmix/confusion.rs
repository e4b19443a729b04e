//! The shares that were found beside those that a scene's own light has.

use ndarray::{Array1, Array2};
use sunglint_analysis::samples::SampledCurve;
use sunglint_analysis::unmix::{Confusion, ConfusionError, Unmixed};
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Pass, PassError};

/// Why the materials cannot be held against those of a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MaterialConfusionError {
    /// An endmember that is no material of the target.
    #[error(
        "the scene's target {target} has no material {material} (it has {}): endmembers have to be the target's own",
        known.join(", ")
    )]
    Other {
        /// The target's name.
        target: String,
        /// The endmember's name.
        material: String,
        /// The target's materials.
        known: Vec<String>,
    },
    /// A scene that cannot be simulated.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// Shares that are none.
    #[error(transparent)]
    Confusion(#[from] ConfusionError),
    /// Nothing to compare.
    #[error("no sample has both shares and light of the scene's materials")]
    NoSample,
}

/// How the materials of a scene's target are taken for one another.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialConfusion {
    /// Shares found against shares of the scene's light.
    pub confusion: Confusion,
    /// The materials.
    pub names: Vec<String>,
    /// The part of the scene's light that is of none of them.
    pub others: f64,
}

impl MaterialConfusion {
    /// Simulates a scene at a curve's times (direct sunlight) and holds its materials' light against the shares that were found. An endmember is a material by its name.
    ///
    /// # Errors
    /// An endmember that is no material of the scene's target; a scene that cannot be simulated; nothing to compare.
    pub fn of(
        pass: &Pass,
        curve: &SampledCurve,
        names: &[String],
        found: &[Unmixed],
    ) -> Result<Self, MaterialConfusionError> {
        let known: Vec<&str> = pass.target.materials.iter().map(|m| m.name.as_str()).collect();
        if let Some(other) = names.iter().find(|n| !known.contains(&n.as_str())) {
            return Err(MaterialConfusionError::Other {
                target: pass.target.name.clone(),
                material: other.clone(),
                known: known.into_iter().map(str::to_owned).collect(),
            });
        }
        let (own, rows) = (curve.samples(), (0..curve.samples().time.len()).collect::<Vec<_>>());
        let mut pass = pass.clone().at_times(own.time.clone(), own.exposure_s.clone(), &rows)?;
        pass.effects = Switches::OFF;
        let simulation = pass.simulate(&|_| ())?;
        let mut truth = Array2::from_elem((found.len(), names.len()), f64::NAN);
        let (mut all, mut theirs) = (0.0, 0.0);
        for (i, weights) in simulation.weights.rows().into_iter().enumerate() {
            let of = |name: &String| -> f64 {
                let terms = weights.iter().zip(&simulation.weight_materials);
                terms.filter(|(_, material)| *material == name).map(|(w, _)| w).sum()
            };
            let light: Vec<f64> = names.iter().map(of).collect();
            let sum: f64 = light.iter().sum();
            all += weights.sum();
            theirs += sum;
            if sum > 0.0 {
                truth.row_mut(i).assign(&Array1::from_iter(light.iter().map(|l| l / sum)));
            }
        }
        let share = |(i, m): (usize, usize)| {
            found[i].mixture.as_ref().map_or(f64::NAN, |mixture| mixture.shares[m])
        };
        let shares = Array2::from_shape_fn(truth.dim(), share);
        let confusion = Confusion::of(truth.view(), shares.view())?;
        if confusion.samples == 0 {
            return Err(MaterialConfusionError::NoSample);
        }
        let others = if all > 0.0 { 1.0 - theirs / all } else { 0.0 };
        Ok(Self { confusion, names: names.to_vec(), others })
    }
}
