//! Options of a fit: the free parameters, and how they are searched for.

use super::{FreeParameter, PassFitError};
use crate::solver::{Loss, Options};
use serde::Deserialize;
use std::path::Path;
use std::str::FromStr;
use sunglint_calibration::stars::scintillation::USUAL_COEFFICIENT;
use sunglint_formats::toml::{Document, NonNegative, Positive};

/// Curves that are left out of a fit and predicted by it; written `each`, or files with commas between them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LeaveOut {
    /// Each curve in turn.
    Each,
    /// These files, together: the tracks of one satellite, for example.
    Together(Vec<String>),
}

impl FromStr for LeaveOut {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.trim() == "each" {
            return Ok(Self::Each);
        }
        let files: Vec<String> = text.split(',').map(|f| f.trim().to_owned()).collect();
        match files.iter().any(String::is_empty) {
            true => Err(format!("`{text}`: expected `each`, or files with commas between them")),
            false => Ok(Self::Together(files)),
        }
    }
}

/// Options of a fit: the free parameters, and how they are searched for.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FitOptions {
    /// Free parameters; each name once.
    pub free: Vec<FreeParameter>,
    /// Names of free parameters of which each curve has its own.
    pub per_pass: Vec<String>,
    /// Largest albedo that is solved for, and largest reflectance that a scale may lead to: 1, unless the light is not of the body's own size or brightness.
    pub largest_albedo: f64,
    /// Curves that are predicted by fits of the others, one fit an entry.
    pub leave_out: Vec<LeaveOut>,
    /// Only these channels; all where there is none.
    pub channels: Vec<String>,
    /// How residuals count.
    pub loss: Loss,
    /// Young's coefficient of the scintillation, which the channels share; 0 for none.
    pub scintillation: f64,
    /// Places over the box of what is searched for that are looked at first.
    pub places: usize,
    /// From how many of them a search starts, the scene's own values besides.
    pub starts: usize,
    /// The seed of the places.
    pub seed: u64,
    /// Iterations of a descent to the bottom of a minimum, at most; with 0 only places are looked at.
    pub iterations: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        let Options { loss, places, starts, seed, iterations, .. } = Options::default();
        Self {
            free: Vec::new(),
            per_pass: Vec::new(),
            largest_albedo: 1.0,
            leave_out: Vec::new(),
            channels: Vec::new(),
            loss,
            scintillation: USUAL_COEFFICIENT,
            places,
            starts,
            seed,
            iterations,
        }
    }
}

/// `[fit]` of a scene file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct FitKeys {
    free: Vec<String>,
    per_pass: Vec<String>,
    largest_albedo: Option<Positive>,
    channels: Vec<String>,
    loss: Option<Loss>,
    scintillation: Option<NonNegative>,
    places: Option<u32>,
    starts: Option<u32>,
}

/// The `[fit]` of a file in which other tables stand too.
#[derive(Deserialize)]
struct AnyFile {
    #[serde(default)]
    fit: FitKeys,
}

impl FitOptions {
    /// Reads the options in `[fit]` of a scene file, with the defaults for those that are not given.
    ///
    /// # Errors
    /// A file that cannot be read, keys that are none, a parameter that is none.
    pub fn of_scene(path: &Path) -> Result<Self, PassFitError> {
        let keys = Document::read(path)?.parse::<AnyFile>()?.fit;
        let free = keys.free.iter().map(|text| text.parse::<FreeParameter>());
        let free = free.collect::<Result<_, _>>();
        let usual = Self::default();
        Ok(Self {
            free: free.map_err(|why| PassFitError::FreeSyntax { why })?,
            per_pass: keys.per_pass,
            largest_albedo: keys.largest_albedo.map_or(usual.largest_albedo, Positive::get),
            channels: keys.channels,
            loss: keys.loss.unwrap_or_default(),
            scintillation: keys.scintillation.map_or(usual.scintillation, NonNegative::get),
            places: keys.places.map_or(usual.places, |n| n as usize),
            starts: keys.starts.map_or(usual.starts, |n| n as usize),
            ..usual
        })
    }

    /// Checks that each name is free once, that ranges are intervals, and that the largest albedo is above 0.
    pub(super) fn check(&self) -> Result<(), PassFitError> {
        let largest_albedo = self.largest_albedo;
        if !(largest_albedo.is_finite() && largest_albedo > 0.0) {
            return Err(PassFitError::LargestAlbedo { largest_albedo });
        }
        for (k, want) in self.free.iter().enumerate() {
            if let Some((low, high)) = want.range
                && !(low < high && low.is_finite() && high.is_finite())
            {
                return Err(PassFitError::Range { name: want.name.clone(), low, high });
            }
            if self.free[..k].iter().any(|w| w.name == want.name) {
                return Err(PassFitError::FreeTwice { name: want.name.clone() });
            }
        }
        Ok(())
    }

    /// Returns the options that the solver takes.
    pub(super) fn solver(&self) -> Options {
        Options {
            loss: self.loss,
            places: self.places,
            starts: self.starts,
            seed: self.seed,
            iterations: self.iterations,
            ..Options::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A caller's range that is no interval is refused by name, before anything is searched for.
    #[test]
    fn a_range_that_is_none_is_refused() {
        for range in [(2.0, 1.0), (1.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            let name = "material.gloss.alpha".to_owned();
            let free = vec![FreeParameter { name, range: Some(range), prior: None }];
            let refused = FitOptions { free, ..FitOptions::default() }.check();
            assert!(matches!(refused, Err(PassFitError::Range { .. })), "{range:?}: {refused:?}");
        }
    }
}
