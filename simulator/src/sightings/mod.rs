//! When satellites can be seen from a station, how bright they are then, and what the station's channels would count.
//!
//! - [`Photometer`]: the station's channels on sunlight, through the air at any height;
//! - [`Model`]: a body whose light is calculated by the light engine; without one a law of phase angle and range stands for it;
//! - [`find`]: the passes of some elements: [`Sightings`].

mod model;
mod seen;

pub use model::{Model, ModelWords, SightingLight};
pub use seen::{ExpectedLight, KEYHOLE_DEG, Photometer, SeenPass, SightingEvent};

use crate::pass::PassError;
use rayon::prelude::*;
use std::path::PathBuf;
use sunglint_ephemeris::geometry::GeometryError;
use sunglint_ephemeris::orbit::elements;
use sunglint_ephemeris::orbit::tle::Tle;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit};
use sunglint_ephemeris::passes::Search;
use sunglint_formats::FileError;
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::PhotometryError;
use sunglint_radiometry::sky::SkyError;
use sunglint_radiometry::spectrum::SpectrumError;

/// Why the light of a pass cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SightingError {
    /// A moment that the frames do not hold.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// A place that the orbit does not have.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// A model without light.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// Air without a spectrum.
    #[error(transparent)]
    Air(#[from] AirError),
    /// Light without a magnitude.
    #[error(transparent)]
    Photometry(#[from] PhotometryError),
    /// Sunlight and air that do not meet.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
}

/// How many stays above the horizon there were, and why they were not seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SightingCounts {
    /// Objects that were followed.
    pub objects: usize,
    /// Objects that never came up.
    pub never_up: usize,
    /// Objects that were up all the time.
    pub always_up: usize,
    /// Stays above the horizon.
    pub stays: usize,
    /// Stays among them that are in the Earth's shadow all the time.
    pub in_shadow: usize,
    /// Those under a bright sky all the time.
    pub in_daylight: usize,
    /// Those that were sunlit only while the sky was bright.
    pub lit_by_day: usize,
    /// Visible ones that the filters left out.
    pub filtered: usize,
}

/// Object without a valid orbit, or with an orbit that ends.
#[derive(Debug, Clone, PartialEq)]
pub struct SightingFailure {
    /// The object, or the place in a file.
    pub what: String,
    /// Why.
    pub why: String,
}

/// Sets of elements of some files.
#[derive(Debug, Clone, Default)]
pub struct ReadSets {
    /// The sets, file by file.
    pub good: Vec<Tle>,
    /// Sets that are none, with their places.
    pub failures: Vec<SightingFailure>,
    /// The files.
    pub inputs: Vec<Input>,
}

/// Reads files of elements: two lines, or OMM. Sets that are none become failures.
///
/// # Errors
/// A file that cannot be read, or that has no good set.
pub fn read_sets(paths: &[PathBuf]) -> Result<ReadSets, FileError> {
    let mut sets = ReadSets::default();
    for path in paths {
        let bytes = sunglint_formats::read::bytes(path)?;
        let sha256 = sunglint_formats::sha256(&bytes);
        sets.inputs.push(Input { file: path.display().to_string(), sha256 });
        let text = sunglint_formats::read::decode(path, bytes)?;
        let (good, mut bad) = elements::parse_lenient(path, &text);
        if good.is_empty() && !bad.is_empty() {
            return Err(bad.swap_remove(0).into());
        }
        sets.good.extend(good);
        sets.failures.extend(bad.into_iter().map(|error| SightingFailure {
            what: match error.line {
                Some(line) => format!("{}:{line}", path.display()),
                None => path.display().to_string(),
            },
            why: error.to_string(),
        }));
    }
    Ok(sets)
}

/// Conditions that a visible pass must meet to be listed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SightingFilter {
    /// The altitude that it reaches while it is visible, degrees.
    pub min_culmination_deg: f64,
    /// How long it is visible, s.
    pub min_duration_s: f64,
    /// Faintest V at the station that is listed.
    pub brighter_than: Option<f64>,
    /// So many at most: the brightest.
    pub limit: Option<usize>,
}

impl SightingFilter {
    /// The passes that are listed; with a limit by their brightness, else in their order.
    pub fn apply(&self, mut passes: Vec<SeenPass>) -> Vec<SeenPass> {
        passes.retain(|p| {
            p.highest_visible_deg() >= self.min_culmination_deg
                && p.visible_s() >= self.min_duration_s
                && self
                    .brighter_than
                    .is_none_or(|limit| p.expected.v_station.is_some_and(|v| v <= limit))
        });
        if let Some(limit) = self.limit {
            // Equal magnitudes keep the order of objects and time: the result does not depend on threads.
            passes.sort_by(|a, b| a.brightest.v_mag.total_cmp(&b.brightest.v_mag));
            passes.truncate(limit);
        }
        passes
    }
}

/// Passes that can be seen, and what came of all others.
#[derive(Debug, Clone, Default)]
pub struct Sightings {
    /// The passes, in the order of time.
    pub passes: Vec<SeenPass>,
    /// How many there were.
    pub counts: SightingCounts,
    /// Objects that could not be followed, or not to the end.
    pub failures: Vec<SightingFailure>,
    /// Old elements and their like: three, and how many more.
    pub warnings: Vec<String>,
}

/// Finds the visible passes of some elements, the objects side by side on the threads; the result does not depend on how many these are.
///
/// # Errors
/// A stop.
pub fn find(
    tles: Vec<Tle>,
    search: &Search,
    photometer: &Photometer<'_>,
    filter: &SightingFilter,
    progress: &dyn Progress,
) -> Result<Sightings, Cancelled> {
    progress.begin("objects", Some(tles.len() as u64));
    let followed: Vec<Followed> = tles
        .into_par_iter()
        .map(|tle| {
            if progress.is_cancelled() {
                return Err(Cancelled);
            }
            let followed = Followed::new(tle, search, photometer);
            progress.advance(1);
            Ok(followed)
        })
        .collect::<Result<_, _>>()?;
    let mut found = Sightings::default();
    let counts = &mut found.counts;
    counts.objects = followed.len();
    let mut passes = Vec::new();
    let mut old = Vec::new();
    for one in followed {
        counts.never_up += usize::from(one.counts.stays == 0 && one.failure.is_none());
        counts.always_up += one.counts.always_up;
        counts.stays += one.counts.stays;
        counts.in_shadow += one.counts.in_shadow;
        counts.in_daylight += one.counts.in_daylight;
        counts.lit_by_day += one.counts.lit_by_day;
        found.failures.extend(one.failure);
        old.extend(one.warnings);
        passes.extend(one.passes);
    }
    if old.len() > 3 {
        let more = format!("… and {} more objects with old elements", old.len() - 3);
        old.truncate(3);
        old.push(more);
    }
    found.warnings = old;
    let visible = passes.len();
    found.passes = filter.apply(passes);
    counts.filtered = visible - found.passes.len();
    found.passes.sort_by(|a, b| {
        a.start.geometry.epoch.cmp(&b.start.geometry.epoch).then(a.norad_id.cmp(&b.norad_id))
    });
    Ok(found)
}

/// One object after the search.
struct Followed {
    passes: Vec<SeenPass>,
    counts: SightingCounts,
    failure: Option<SightingFailure>,
    warnings: Vec<String>,
}

impl Followed {
    fn new(tle: Tle, search: &Search, photometer: &Photometer<'_>) -> Self {
        let label = tle.label();
        let mut followed = Self {
            passes: Vec::new(),
            counts: SightingCounts::default(),
            failure: None,
            warnings: Vec::new(),
        };
        let failure = |why: String| Some(SightingFailure { what: label.clone(), why });
        let window = search.window();
        let orbit = match TleOrbit::new(tle.clone()) {
            Ok(orbit) => Orbit::from(orbit.near(window.from, window.to)),
            Err(error) => {
                followed.failure = failure(error.to_string());
                return followed;
            }
        };
        followed.warnings = orbit.warnings(window.from, window.to);
        let found = search.passes(&orbit);
        if let Some((_, error)) = found.ended {
            followed.failure = failure(error.to_string());
        }
        let dark = search.dark();
        let counts = &mut followed.counts;
        for pass in found.passes {
            counts.stays += 1;
            counts.always_up += usize::from(!pass.rises && !pass.sets);
            if pass.visible.is_empty() {
                let under_dark =
                    dark.iter().any(|d| d.from < pass.span.to && pass.span.from < d.to);
                match (pass.sunlit.is_empty(), under_dark) {
                    (true, _) => counts.in_shadow += 1,
                    (false, false) => counts.in_daylight += 1,
                    (false, true) => counts.lit_by_day += 1,
                }
                continue;
            }
            match SeenPass::new(&orbit, &tle, pass, search, photometer) {
                Ok(seen) => followed.passes.push(seen),
                Err(error) => followed.failure = failure(error.to_string()),
            }
        }
        followed
    }
}
