//! Place of a frame on the sky by the pattern of its stars alone, wherever it is.
//!
//! The search is tetra3's (Pettersson's and Rosenthal's algorithm in the crate of that name): ratios of the distances of four bright stars, looked up in a table. What
//! it finds only says which star is which. The coordinates are then fitted anew to all stars of the list ([`super::matching::pair`]) in
//! double precision, and a frame whose stars do not fit is refused.
//!
//! Coordinates are those of the list: a frame's place is where the list has the stars that are seen there. Aberration (20″) moves all stars of a frame alike and is
//! thus in the frame's place, as in the solutions of other programs.

use super::catalogue::Catalogue;
use super::matching::{Pairs, Star, pair, tangent};
use super::{Source, sources};
use crate::photometry::field::Field;
use glam::DVec2;
use serde::Serialize;
use sunglint_formats::wcs::{Equatorial, Wcs};
use sunglint_numerics::measured::Interval;

/// Narrowest and widest field that patterns are made for, deg.
pub const FIELDS_DEG: Interval = Interval::new(0.2, 45.0);
/// Widths of field that the embedded stars are tried for, deg: below 15° most fields hold too few of them.
pub const EMBEDDED_DEG: Interval = Interval::new(12.0, 40.0);
/// Stars that a field of the narrowest width should hold: four make the pattern, the others prove it.
const STARS_IN_A_FIELD: f64 = 14.0;
/// Sources that are taken, the brightest.
const SOURCES: usize = 80;
/// Steps between the widths of field that are tried, and the part by which each may be wrong.
const STEP: f64 = 1.25;
const TOLERANCE: f64 = 0.13;
/// Probability that a wrong place is believed, over all that were tried.
const CHANCE: f64 = 1e-7;
/// Time for one width, ms.
const TIME_MS: u64 = 4000;
/// Stars of the list that must be found at least.
pub(super) const LEAST_FOUND: usize = 7;
/// Scatter of the stars in an axis up to which they fit, px.
pub(super) const MOST_SCATTER_PX: f64 = 2.0;
/// Square degrees of the sky.
const SKY_DEG2: f64 = 41_252.96;

/// Why no patterns can be made of a list.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BlindError {
    /// Too few stars for the fields.
    #[error(
        "the list has {stars} stars with a place and a magnitude: too few for fields of {width_deg:.2}°; a field that wide should hold {needed} of them"
    )]
    TooFew {
        /// Number.
        stars: usize,
        /// Width of the narrowest field, deg.
        width_deg: f64,
        /// Stars that a field should hold.
        needed: usize,
    },
    /// Widths that make no sense.
    #[error("fields of {0:.3}° to {1:.3}°: expected {least}° to {most}°", least = FIELDS_DEG.low, most = FIELDS_DEG.high)]
    Width(f64, f64),
    /// The search refused the list.
    #[error("no patterns of this list: {0}")]
    Patterns(String),
}

/// A list of stars with the table of its patterns.
#[derive(Debug)]
pub struct Patterns {
    database: tetra3::SolverDatabase,
    /// The stars with a magnitude, the brightest first.
    stars: Vec<Star>,
    fields_deg: Interval,
}

/// Coordinates of a frame, found without a hint.
#[derive(Debug, Clone, Serialize)]
pub struct Solved {
    /// Coordinates.
    #[serde(skip)]
    pub wcs: Wcs,
    /// Right ascension and declination of the frame's middle, deg (the list's system and the year that was asked for).
    pub centre_deg: Equatorial,
    /// Width and height of the frame, deg.
    pub size_deg: DVec2,
    /// Width of a pixel, arcsec.
    pub scale_arcsec: f64,
    /// Direction of up, deg from north through east: towards the first row, but for [`drawn`](Self::drawn).
    pub up_deg: f64,
    /// Whether the image is mirrored: east is to the right where north is up, with the first row at the top, but for [`drawn`](Self::drawn).
    pub is_mirrored: bool,
    /// Stars of the list that were found.
    pub stars: usize,
    /// Scatter of their places in an axis, px.
    pub scatter_px: f64,
    /// Error of the middle by that scatter, arcsec (1σ in an axis).
    pub sigma_arcsec: f64,
    /// Probability that chance brought it about, by the search.
    pub chance: f64,
}

impl Solved {
    /// The same with up and mirrored as the frame is drawn: with its first row at the top, or at the bottom, as FITS has it (version 4.0 of the standard, section 5.1).
    #[must_use]
    pub fn drawn(mut self, is_top_down: bool) -> Self {
        if !is_top_down {
            self.up_deg = (self.up_deg + 180.0).rem_euclid(360.0);
            self.is_mirrored = !self.is_mirrored;
        }
        self
    }
}

/// Width of the narrowest field that a list of so many stars can carry, deg.
pub fn narrowest_deg(stars: usize) -> f64 {
    (STARS_IN_A_FIELD * SKY_DEG2 / (stars.max(1) as f64)).sqrt()
}

impl Patterns {
    /// The patterns of a list for fields of these widths (the frame's width, deg), with the stars' places in a year.
    ///
    /// It takes 3 s for the 1,600 stars to V = 5 and a minute for the 40,000 to 8.3.
    ///
    /// # Errors
    /// [`BlindError`].
    pub fn new(
        list: &Catalogue,
        magnitudes: &[f64],
        year: f64,
        fields_deg: Interval,
    ) -> Result<Self, BlindError> {
        let [least, most] = fields_deg.to_array();
        if !(least >= FIELDS_DEG.low && most <= FIELDS_DEG.high && least <= most) {
            return Err(BlindError::Width(least, most));
        }
        let mut stars: Vec<Star> = (0..list.len().min(magnitudes.len()))
            .map(|number| Star {
                number,
                sky_deg: list.sky_deg(number, year),
                magnitude: magnitudes[number],
            })
            .filter(|s| s.magnitude.is_finite() && s.sky_deg.is_finite())
            .collect();
        if narrowest_deg(stars.len()) > 1.6 * most || stars.len() < 50 {
            let needed = STARS_IN_A_FIELD as usize;
            return Err(BlindError::TooFew { stars: stars.len(), width_deg: most, needed });
        }
        stars.sort_by(|a, b| a.magnitude.total_cmp(&b.magnitude));
        let of_crate = stars.iter().map(|star| tetra3::Star {
            id: star.number as i64,
            ra_rad: star.sky_deg.ra_deg.to_radians().rem_euclid(std::f64::consts::TAU) as f32,
            dec_rad: star.sky_deg.dec_deg.to_radians() as f32,
            mag: star.magnitude as f32,
        });
        let config = tetra3::GenerateDatabaseConfig {
            max_fov_deg: most as f32,
            min_fov_deg: Some(least as f32),
            epoch_proper_motion_year: None,
            ..tetra3::GenerateDatabaseConfig::default()
        };
        let database =
            tetra3::SolverDatabase::generate_from_star_list(of_crate.collect(), &config, year)
                .map_err(|error| BlindError::Patterns(error.to_string()))?;
        Ok(Self { database, stars, fields_deg })
    }

    /// Widths of fields that the patterns are for, deg.
    pub fn fields_deg(&self) -> Interval {
        self.fields_deg
    }

    /// Number of stars.
    pub fn stars(&self) -> usize {
        self.stars.len()
    }

    /// Place of a frame by its sources: points, or trails where stars are trailed. `width_deg` is the frame's width, with the part by which it may be wrong,
    /// where it is known. `None` where no pattern is beyond chance.
    pub fn solve(
        &self,
        field: &Field,
        is_trailed: bool,
        width_deg: Option<(f64, f64)>,
    ) -> Option<Solved> {
        let found: Vec<Source> = sources(field, is_trailed);
        let places: Vec<DVec2> = found.iter().map(|s| s.place.into()).collect();
        self.solve_places(&places, field.size_px, width_deg)
    }

    /// The same for places of sources in px (the middle of the first pixel is 0, 0), the brightest first.
    pub fn solve_places(
        &self,
        places: &[DVec2],
        size_px: [usize; 2],
        width_deg: Option<(f64, f64)>,
    ) -> Option<Solved> {
        let middle = size_px.map(|n| 0.5 * (n as f64 - 1.0));
        let n = places.len().min(SOURCES);
        let centroids: Vec<tetra3::Centroid> = (places[..n].iter().enumerate())
            .map(|(i, place)| tetra3::Centroid {
                x: (place[0] - middle[0]) as f32,
                y: (place[1] - middle[1]) as f32,
                mass: Some((n - i) as f32),
                cov: None,
            })
            .collect();
        let widths = match width_deg {
            Some(width) => vec![width],
            None => {
                let [least, most] = self.fields_deg.to_array();
                let steps = ((most / least).ln() / STEP.ln()).ceil().max(1.0);
                let ratio = (most / least).powf(steps.recip());
                // The widest first: fewest stars, soonest done.
                (0..=steps as u32)
                    .rev()
                    .map(|i| (least * ratio.powf(f64::from(i)), TOLERANCE))
                    .collect()
            }
        };
        let size = [size_px[0] as u32, size_px[1] as u32];
        for (width, tolerance) in widths.iter().copied() {
            let mut config = tetra3::SolveConfig::new(width.to_radians() as f32, size[0], size[1]);
            config.fov_max_error_rad = Some((width * tolerance).to_radians() as f32);
            config.match_threshold = CHANCE / widths.len() as f64;
            config.solve_timeout_ms = Some(TIME_MS);
            let Ok(solution) = self.database.solve_from_centroids(&centroids, &config) else {
                continue;
            };
            let solved = self.fitted(&solution, places, size_px);
            // The width that was told is kept to.
            let fits = |s: &Solved| (s.size_deg[0] / width - 1.0).abs() < 1.5 * tolerance + 0.01;
            if let Some(solved) = solved.filter(fits) {
                return Some(solved);
            }
        }
        None
    }

    /// Coordinates fitted to all stars, from those of the search.
    fn fitted(
        &self,
        solution: &tetra3::Solution,
        places: &[DVec2],
        size_px: [usize; 2],
    ) -> Option<Solved> {
        let middle = size_px.map(|n| 0.5 * (n as f64 - 1.0));
        let sky = |x: f64, y: f64| {
            let (ra, dec) = solution.pixel_to_world(x, y);
            Equatorial { ra_deg: ra, dec_deg: dec }
        };
        let reference = sky(0.0, 0.0);
        let arm = 0.2 * size_px[0].min(size_px[1]) as f64;
        let slope = |right: Equatorial, left: Equatorial| {
            let (a, b) = (tangent(reference, right)?, tangent(reference, left)?);
            Some([0, 1].map(|k| (a[k] - b[k]) / (2.0 * arm)))
        };
        let column = slope(sky(arm, 0.0), sky(-arm, 0.0))?;
        let row = slope(sky(0.0, arm), sky(0.0, -arm))?;
        let first =
            Wcs::tangential(reference, middle.into(), [[column[0], row[0]], [column[1], row[1]]])?;
        let once = pair(&first, &self.stars, places, size_px)?;
        // Once more from the better place: stars at the corners come within reach.
        let pairs = pair(&once.wcs, &self.stars, places, size_px)?;
        if pairs.of.len() < LEAST_FOUND || pairs.scatter_px > MOST_SCATTER_PX {
            return None;
        }
        Solved::of(pairs, size_px, solution.prob)
    }
}

impl Solved {
    /// Place of a frame by the pairs of its stars; `chance` is the probability that chance brought them about.
    pub(super) fn of(pairs: Pairs, size_px: [usize; 2], chance: f64) -> Option<Self> {
        let middle = size_px.map(|n| 0.5 * (n as f64 - 1.0));
        let wcs = pairs.wcs;
        let centre = wcs.sky(middle.into())?;
        let at = |dx: f64, dy: f64| {
            wcs.sky(DVec2::new(middle[0] + dx, middle[1] + dy)).and_then(|sky| tangent(centre, sky))
        };
        let (right, up) = (at(1.0, 0.0)?, at(0.0, -1.0)?);
        let scale_deg = (right[0] * up[1] - right[1] * up[0]).abs().sqrt();
        Some(Self {
            centre_deg: centre,
            size_deg: size_px
                .map(|n| 2.0 * (0.5 * n as f64 * scale_deg.to_radians()).atan().to_degrees())
                .into(),
            scale_arcsec: scale_deg * 3600.0,
            up_deg: up[0].atan2(up[1]).to_degrees().rem_euclid(360.0),
            is_mirrored: right[0] * up[1] - right[1] * up[0] > 0.0,
            stars: pairs.of.len(),
            scatter_px: pairs.scatter_px,
            sigma_arcsec: pairs.scatter_px * scale_deg * 3600.0 / (pairs.of.len() as f64).sqrt(),
            chance,
            wcs,
        })
    }
}
