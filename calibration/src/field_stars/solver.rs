//! Places of frames by their stars, one after the other, by a list or by another program. The patterns of a list are made when the first frame needs them, and again when one of another width comes.

use super::Catalogue;
use super::blind::{BlindError, EMBEDDED_DEG, FIELDS_DEG, Patterns, Solved, narrowest_deg};
use super::solve_field::{SolveField, SolveFieldError};
use crate::photometry::PhotometryError;
use crate::photometry::field::{FieldOptions, find};
use hifitime::Epoch;
use ndarray::ArrayView2;
use std::path::Path;
use sunglint_formats::FileError;
use sunglint_formats::ParseError;
use sunglint_numerics::measured::Interval;
use sunglint_numerics::progress::{Progress, Silent};

/// Part by which a width from a header may be wrong, and one that a person gave.
const WIDTH_TOLERANCE: f64 = 0.15;

/// Why there can be no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SolverError {
    /// The list of stars.
    #[error(transparent)]
    List(#[from] FileError),
    /// The list's magnitudes.
    #[error(transparent)]
    Magnitudes(#[from] ParseError),
    /// No patterns for these fields.
    #[error(transparent)]
    Patterns(#[from] BlindError),
    /// The other program.
    #[error(transparent)]
    Program(#[from] SolveFieldError),
    /// Sources cannot be looked for.
    #[error(transparent)]
    Sources(#[from] PhotometryError),
}

/// Facts about a frame that are known before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hint {
    /// When it was taken.
    pub middle: Epoch,
    /// Width of a pixel, arcsec, where it is known.
    pub scale_arcsec: Option<f64>,
}

/// Answer for a frame.
#[derive(Debug, Clone)]
pub struct Looked {
    /// Points that were found, or trails where stars are trailed.
    pub sources: usize,
    /// Place of the frame; `None` where no pattern is beyond chance.
    pub solved: Option<Solved>,
}

/// Solver of frames by one list of stars, or by another program.
#[derive(Debug)]
pub struct Solver {
    by: By,
    width_deg: Option<f64>,
}

/// Means of a solver.
#[derive(Debug)]
enum By {
    List(Box<List>),
    Program(SolveField),
}

/// A list of stars, and its patterns for fields of the last width.
#[derive(Debug)]
struct List {
    stars: Catalogue,
    is_embedded: bool,
    magnitudes: Vec<f64>,
    patterns: Option<Patterns>,
}

impl Solver {
    /// A solver by the list in a file, with its column of magnitudes, or by the embedded stars to V = 5. `width_deg` is the frames' width, where it is known better than
    /// by their scale.
    ///
    /// # Errors
    /// A list that cannot be read, or has no such column.
    pub fn new(
        list: Option<&Path>,
        magnitude: Option<&str>,
        width_deg: Option<f64>,
    ) -> Result<Self, SolverError> {
        let is_embedded = list.is_none();
        let list = match list {
            Some(path) => Catalogue::read(path)?,
            None => Catalogue::embedded()?,
        };
        let magnitudes = list.brightness(magnitude)?;
        let list = List { stars: list, is_embedded, magnitudes, patterns: None };
        Ok(Self { by: By::List(Box::new(list)), width_deg })
    }

    /// A solver by the program `solve-field`. `width_deg` is as in [`Solver::new`].
    pub fn by_program(program: SolveField, width_deg: Option<f64>) -> Self {
        Self { by: By::Program(program), width_deg }
    }

    /// Finds a frame (values in ADU, `[row, column]`; NaN is masked).
    ///
    /// # Errors
    /// Fields for which there are no patterns; a frame in which sources cannot be looked for.
    pub fn solve(
        &mut self,
        pixels: ArrayView2<'_, f32>,
        hint: &Hint,
        options: &FieldOptions,
    ) -> Result<Looked, SolverError> {
        self.solve_watched(pixels, hint, options, &Silent)
    }

    /// Finds a frame as [`Solver::solve`] does; another program is ended where `progress` is cancelled.
    ///
    /// # Errors
    /// Those of [`Solver::solve`]; a stop.
    pub fn solve_watched(
        &mut self,
        pixels: ArrayView2<'_, f32>,
        hint: &Hint,
        options: &FieldOptions,
        progress: &dyn Progress,
    ) -> Result<Looked, SolverError> {
        let by_scale = hint.scale_arcsec.map(|arcsec| {
            let half = 0.5 * pixels.ncols() as f64 * (arcsec / 3600.0).to_radians();
            2.0 * half.atan().to_degrees()
        });
        let width = self.width_deg.or(by_scale);
        let told = width.map(|w| (w, WIDTH_TOLERANCE));
        let field = find(pixels, options)?;
        let is_trailed = field.star_trails.is_some();
        let solved = match &mut self.by {
            By::List(list) => {
                list.patterns(width, year_of(hint.middle))?.solve(&field, is_trailed, told)
            }
            By::Program(program) => program.solve(&field, is_trailed, told, progress)?,
        };
        let sources = if is_trailed { field.streaks.len() } else { field.points.len() };
        Ok(Looked { sources, solved })
    }
}

impl List {
    /// Patterns for frames of this width, deg, in a year.
    fn patterns(&mut self, width: Option<f64>, year: f64) -> Result<&Patterns, BlindError> {
        let [least, most] = self.widths(width);
        let fits = |p: &Patterns| {
            p.fields_deg().low <= least * 1.001 && p.fields_deg().high >= most * 0.999
        };
        let patterns = match self.patterns.take().filter(fits) {
            Some(patterns) => patterns,
            None => {
                let fields = Interval::new(least, most);
                Patterns::new(&self.stars, &self.magnitudes, year, fields)?
            }
        };
        Ok(self.patterns.insert(patterns))
    }

    /// Widths of field that patterns are made for.
    fn widths(&self, width: Option<f64>) -> [f64; 2] {
        let [least, most] = FIELDS_DEG.to_array();
        match width {
            Some(width) => [
                (width * (1.0 - WIDTH_TOLERANCE)).max(least),
                (width * (1.0 + WIDTH_TOLERANCE)).min(most),
            ],
            None if self.is_embedded => EMBEDDED_DEG.to_array(),
            None => {
                let narrowest = narrowest_deg(self.stars.len()).clamp(least, most);
                [narrowest, (4.0 * narrowest).min(most)]
            }
        }
    }
}

/// Julian year of a moment.
fn year_of(time: Epoch) -> f64 {
    2000.0 + (time.to_jde_tt_days() - 2_451_545.0) / 365.25
}
