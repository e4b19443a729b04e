//! A material from the files of a measurement: values, density, and the plan of them.

use super::{AssembleError, AssembleOptions, Assembled, ROWS, assemble};
use crate::exchange::implausible;
use crate::ingest::once;
use crate::plan::{Planned, missing, planned};
use crate::read::{self, ReadError};
use crate::samples::Samples;
use std::path::PathBuf;
use sunglint_formats::ParseError;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::Input;

/// Sides of grids of values, finest first.
const SIDES: [usize; 4] = [129, 97, 65, 33];
/// Largest size of a file where nobody says the side of its grids, bytes.
const MOST_BYTES: usize = 256_000_000;

/// Counts that decide a file's size.
#[derive(Debug, Clone, Copy)]
struct Counts {
    incidences: usize,
    wavelengths: usize,
    /// Nodes of the warp of each incidence.
    warp: usize,
}

impl Counts {
    /// Returns the size of the file with grids of this side, bytes: in each cell the values, their mean and possible error, and whether it is extrapolated.
    fn bytes(&self, side: usize) -> usize {
        let cell = self.wavelengths.saturating_add(2).saturating_mul(size_of::<f32>()) + 1;
        let grid = cell.saturating_mul(side * side);
        let warp = self.warp.saturating_mul(size_of::<f32>());
        self.incidences.saturating_mul(grid.saturating_add(warp))
    }

    /// The finest side with which the file stays within [`MOST_BYTES`]; the coarsest where none does.
    fn usual_side(&self) -> usize {
        let fits = |side: &usize| self.bytes(*side) <= MOST_BYTES;
        SIDES.into_iter().find(fits).unwrap_or(SIDES[SIDES.len() - 1])
    }
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
    /// Side of the file's grid of values (default the finest of 129, 97, 65 and 33 with which the file takes at most 256 MB).
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

/// Makes a material of files; `progress` hears at once of what a person should know, before the long part of the work begins.
///
/// # Errors
/// A file that cannot be read, values that are no material.
pub fn assemble_files(
    files: &AssemblyFiles,
    progress: &dyn Progress,
) -> Result<Assembly, AssemblyError> {
    let (measured, mut inputs) = read::samples(&files.samples, files.wavelength_nm)?;
    for warning in once(measured.clone()).1.into_iter().chain(implausible(&measured)) {
        progress.warn(&warning);
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
            Some(check(&steps, &measured, density.is_isotropic(), progress))
        }
        None => None,
    };
    let (azimuths, rows) = if density.is_isotropic() { (1, ROWS) } else { (files.phi_i, 1) };
    let counts = Counts {
        incidences: files.theta_i.saturating_mul(azimuths),
        wavelengths: measured.wavelength_nm.len(),
        warp: rows.saturating_mul(files.normals.saturating_mul(files.normals)),
    };
    let side = files.side.unwrap_or_else(|| counts.usual_side());
    if files.side.is_none() && side < SIDES[0] {
        progress.warn(&format!(
            "the file's values at {} directions of incidence are grids of {side} by {side} instead of {} by {}, so that it takes {} MB; --side says otherwise",
            counts.incidences,
            SIDES[0],
            SIDES[0],
            counts.bytes(side) / 1_000_000
        ));
    }
    let options = AssembleOptions {
        theta_i: files.theta_i,
        phi_i: files.phi_i,
        side,
        normals: files.normals,
        mirrored,
    };
    let made = assemble(&measured, &density, &options, progress).map_err(|source| {
        let file = files.samples.display().to_string();
        AssemblyError::Assemble { file, source }
    })?;
    Ok(Assembly { made, samples: measured, plan, inputs })
}

fn check(
    steps: &[Planned],
    samples: &Samples,
    isotropic: bool,
    progress: &dyn Progress,
) -> CheckedPlan {
    let (missing, unplanned) = missing(steps, samples, isotropic, NEAR_DEG);
    if let Some(first) = missing.first() {
        progress.warn(&format!(
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
        progress.warn(&format!(
            "{unplanned} directions were measured that were not planned: they are used"
        ));
    }
    CheckedPlan { planned: steps.len(), missing, unplanned }
}

#[cfg(test)]
mod tests {
    use super::Counts;

    /// Truth: by hand. 72 incidences, one wavelength: 72 (129² · 13 + 262144) bytes are 34 MB; of 190 wavelengths 940 MB, with 97² 540 MB, with 65² 253 MB, of 195 259 MB. 17 · 72 incidences of an
    /// anisotropic sample: 345 MB, with 97² 230 MB.
    #[test]
    fn large_files_have_coarser_grids() {
        let of = |incidences, wavelengths, warp| Counts { incidences, wavelengths, warp };
        assert_eq!(of(72, 1, 4 * 128 * 128).usual_side(), 129);
        assert_eq!(of(72, 190, 4 * 128 * 128).usual_side(), 65);
        assert_eq!(of(72, 195, 4 * 128 * 128).usual_side(), 33);
        assert_eq!(of(72 * 17, 1, 128 * 128).usual_side(), 97);
        assert_eq!(of(72 * 17, 1, 128 * 128).bytes(97), 1224 * (9409 * 13 + 65536));
        assert_eq!(of(usize::MAX, 1, 1).usual_side(), 33);
    }
}
