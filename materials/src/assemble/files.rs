//! A material from the files of a measurement: values, density, and the plan of them.

use super::{AssembleError, AssembleOptions, Assembled, assemble};
use crate::exchange::implausible;
use crate::ingest::once;
use crate::plan::{Planned, missing, planned};
use crate::read::{self, ReadError};
use crate::samples::Samples;
use std::path::PathBuf;
use sunglint_formats::ParseError;
use sunglint_radiometry::light_curve::Input;

/// Sides of grids of values, finest first.
const SIDES: [usize; 4] = [129, 97, 65, 33];
/// Largest size of all values of a file where nobody says the side of their grids, bytes.
const MOST_BYTES: usize = 256_000_000;

/// Returns the size of so many grids of values, bytes.
fn bytes(grids: usize, side: usize) -> usize {
    grids.saturating_mul(side * side * size_of::<f32>())
}

/// The finest side with which so many grids of values stay within [`MOST_BYTES`]; the coarsest where none does.
fn usual_side(grids: usize) -> usize {
    let fits = |side: &usize| bytes(grids, *side) <= MOST_BYTES;
    SIDES.into_iter().find(fits).unwrap_or(SIDES[SIDES.len() - 1])
}

/// How far a direction may lie from the one that was planned, degrees.
pub const NEAR_DEG: f64 = 0.5;

/// Input files of a material.
#[derive(Debug, Clone, Default)]
pub struct AssemblyFiles {
    /// Measured values.
    pub samples: PathBuf,
    /// The sample's density of microfacet normals.
    pub ndf: PathBuf,
    /// The plan of the measurements.
    pub plan: Option<PathBuf>,
    /// The wavelength of a table that does not say it, nm.
    pub wavelength_nm: Option<f64>,
    /// Incident elevations of the file.
    pub theta_i: usize,
    /// Incident azimuths of the file, of an anisotropic sample.
    pub phi_i: usize,
    /// Side of the file's grid of values (default the finest of 129, 97, 65 and 33 with which all take at most 256 MB).
    pub side: Option<usize>,
    /// Nodes of the file's warps in elevation.
    pub normals: usize,
}

/// Comparison of a plan with the measured directions.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedPlan {
    /// Directions that were planned.
    pub planned: usize,
    /// Those that were not measured.
    pub missing: Vec<Planned>,
    /// Directions that were measured and not planned.
    pub unplanned: usize,
}

/// A material, and what it was made of.
#[derive(Debug, Clone)]
pub struct Assembly {
    /// The material.
    pub made: Assembled,
    /// The measured values.
    pub samples: Samples,
    /// Comparison of the plan with the measured directions.
    pub plan: Option<CheckedPlan>,
    /// The files that went in.
    pub inputs: Vec<Input>,
}

/// Why there is no material.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssemblyError {
    /// A file that cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A table that is no plan.
    #[error(transparent)]
    Plan(#[from] ParseError),
    /// Values that are no material.
    #[error("{file}")]
    Assemble {
        /// The file of values.
        file: String,
        /// Why.
        source: AssembleError,
    },
}

/// Makes a material of files; `warn` hears at once of what a person should know, before the long part of the work begins.
///
/// # Errors
/// A file that cannot be read, values that are no material.
pub fn assemble_files(
    files: &AssemblyFiles,
    warn: &dyn Fn(&str),
    begin: &dyn Fn(),
) -> Result<Assembly, AssemblyError> {
    let (measured, mut inputs) = read::samples(&files.samples, files.wavelength_nm)?;
    for warning in once(measured.clone()).1.into_iter().chain(implausible(&measured)) {
        warn(&warning);
    }
    let (density, others) = read::density(&files.ndf)?;
    inputs.extend(others);
    let mut mirrored = false;
    let plan = match &files.plan {
        Some(path) => {
            let (table, input) = read::table(path)?;
            let (steps, quarter) = planned(path, &table)?;
            inputs.extend(input);
            mirrored = quarter;
            Some(check(&steps, &measured, density.is_isotropic(), warn))
        }
        None => None,
    };
    let azimuths = if density.is_isotropic() { 1 } else { files.phi_i };
    let grids = measured.wavelength_nm.len() * files.theta_i * azimuths;
    let side = files.side.unwrap_or_else(|| usual_side(grids));
    if files.side.is_none() && side < SIDES[0] {
        warn(&format!(
            "the file has {grids} grids of values: each is of {side} by {side} instead of {} by {}, so that they take {} MB; --side says otherwise",
            SIDES[0],
            SIDES[0],
            bytes(grids, side) / 1_000_000
        ));
    }
    let options = AssembleOptions {
        theta_i: files.theta_i,
        phi_i: files.phi_i,
        side,
        normals: files.normals,
        mirrored,
    };
    begin();
    let made = assemble(&measured, &density, &options).map_err(|source| {
        let file = files.samples.display().to_string();
        AssemblyError::Assemble { file, source }
    })?;
    Ok(Assembly { made, samples: measured, plan, inputs })
}

fn check(
    steps: &[Planned],
    samples: &Samples,
    isotropic: bool,
    warn: &dyn Fn(&str),
) -> CheckedPlan {
    let (missing, unplanned) = missing(steps, samples, isotropic, NEAR_DEG);
    if let Some(first) = missing.first() {
        warn(&format!(
            "{} of {} planned directions have no value above 0 within {NEAR_DEG}°; the first is step {}: light at {:.2}°, azimuth {:.2}°, detector at {:.2}°, azimuth {:.2}°",
            missing.len(),
            steps.len(),
            first.step,
            first.theta_i_deg,
            first.phi_i_deg,
            first.theta_o_deg,
            first.phi_o_deg
        ));
    }
    if unplanned > 0 {
        warn(&format!("{unplanned} directions were measured that were not planned: they are used"));
    }
    CheckedPlan { planned: steps.len(), missing, unplanned }
}

#[cfg(test)]
mod tests {
    use super::usual_side;

    /// Truth: by hand: 72 grids of 129² values of four bytes are 4.8 MB; 195 wavelengths of them 934 MB, with 97² 528 MB, with 65² 237 MB.
    #[test]
    fn many_wavelengths_have_coarser_grids() {
        assert_eq!(usual_side(72), 129);
        assert_eq!(usual_side(72 * 195), 65);
        assert_eq!(usual_side(72 * 17 * 3), 129);
        assert_eq!(usual_side(usize::MAX), 33);
    }
}
