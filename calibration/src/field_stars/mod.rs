//! Stars of a list in a frame: its coordinates, its zero point, the places and magnitudes of what else is in it.
//!
//! [`blind`] finds a frame anywhere on the sky, [`solver`] one after the other, [`solve_field`] asks another program, [`catalogue`] reads the list, [`matching`] says which source is which star, [`zero_point`] turns them into the frame's zero point. [`in_frame`] does it for one frame.

pub mod blind;
pub mod catalogue;
pub mod matching;
pub mod solve_field;
pub mod solver;
pub mod zero_point;

pub use catalogue::{BandColumns, Catalogue, CatalogueOptions, System};
pub use matching::{Approximate, Pairs, Star};
pub use zero_point::{ColourTerm, StarMeasurement, ZeroPoint, colour_term, zero_point as of_stars};

use crate::photometry::field::Field;
use glam::DVec2;
use sunglint_formats::wcs::Wcs;

/// Coordinates that a frame is begun with.
#[derive(Debug, Clone)]
pub enum Coordinates {
    /// Those of its header, or of the frame before.
    Known(Box<Wcs>),
    /// The middle and scale of the frame.
    Near(Approximate),
}

/// Stars of a list in a frame.
#[derive(Debug, Clone)]
pub struct InFrame {
    /// Coordinates, put right by the stars.
    pub wcs: Wcs,
    /// Stars that a zero point may be taken from.
    pub stars: Vec<StarMeasurement>,
    /// Stars of the list that were found.
    pub found: usize,
    /// Scatter of their places in an axis, px.
    pub scatter_px: f64,
}

/// A source whose light may be a star's.
pub(crate) struct Source {
    pub(crate) place: [f64; 2],
    flux: f64,
    sigma: f64,
    is_good: bool,
}

/// Part of a star's light that a neighbour in the list may have beside it.
const NEIGHBOUR: f64 = 0.02;
/// Instrumental standard deviation up to which a star counts, mag.
const MOST_SIGMA: f64 = 0.1;

/// Finds the stars of a list in a frame and measures them: points, or the trails where stars are trailed (`is_trailed`).
///
/// # Errors
/// In words, why the stars are not found.
pub fn in_frame(
    field: &Field,
    is_trailed: bool,
    exposure_s: f64,
    year: f64,
    coordinates: &Coordinates,
    catalogue: &Catalogue,
    band: &BandColumns,
) -> Result<InFrame, String> {
    let sources = sources(field, is_trailed);
    let places: Vec<DVec2> = sources.iter().map(|s| s.place.into()).collect();
    let mut stars: Vec<Star> = (0..catalogue.len())
        .filter(|&i| band.magnitude[i].is_finite())
        .map(|number| Star {
            number,
            sky_deg: catalogue.sky_deg(number, year),
            magnitude: band.magnitude[number],
        })
        .filter(|star| star.sky_deg.is_finite())
        .collect();
    stars.sort_by(|a, b| a.magnitude.total_cmp(&b.magnitude));
    let solved;
    let wcs = match coordinates {
        Coordinates::Known(wcs) => wcs.as_ref(),
        Coordinates::Near(near) => {
            solved = matching::solve(near, &stars, &places, field.size_px)
                .ok_or("its pattern of stars is not found in the list")?;
            &solved
        }
    };
    let pairs = matching::pair(wcs, &stars, &places, field.size_px)
        .ok_or("too few of its sources are where the list has stars")?;
    // Places of all stars of the list, for neighbours that an aperture cannot tell apart.
    let all: Vec<Option<DVec2>> = stars.iter().map(|s| pairs.wcs.pixel(s.sky_deg)).collect();
    let reach = 4.0 * field.fwhm_px;
    let is_crowded = |star: usize| {
        let Some(at) = all[star] else { return true };
        let brightest = stars[star].magnitude - 2.5 * NEIGHBOUR.log10();
        all.iter().zip(&stars).enumerate().any(|(i, (place, other))| {
            i != star
                && other.magnitude < brightest
                && place.is_some_and(|p| (p[0] - at[0]).hypot(p[1] - at[1]) < reach)
        })
    };
    let mut measured = Vec::new();
    for (star, source) in &pairs.of {
        let source = &sources[*source];
        if !source.is_good || source.flux <= 0.0 || is_crowded(*star) {
            continue;
        }
        let sigma_mag = 2.5 / std::f64::consts::LN_10 * source.sigma / source.flux;
        if sigma_mag > MOST_SIGMA {
            continue;
        }
        let number = stars[*star].number;
        measured.push(StarMeasurement {
            star: number,
            instrumental_mag: -2.5 * (source.flux / exposure_s).log10(),
            sigma_mag,
            catalogue_mag: band.magnitude[number],
            catalogue_sigma_mag: band.sigma_mag[number],
            colour: band.colour.as_ref().map(|(_, colours)| colours[number]),
        });
    }
    Ok(InFrame {
        wcs: pairs.wcs,
        stars: measured,
        found: pairs.of.len(),
        scatter_px: pairs.scatter_px,
    })
}

/// The sources that stars can be, the brightest first.
pub(crate) fn sources(field: &Field, is_trailed: bool) -> Vec<Source> {
    let mut sources: Vec<Source> = if is_trailed {
        let trails = field.streaks.iter().filter(|s| s.is_star_trail && !s.is_cut);
        trails
            .map(|streak| {
                let [a, b] = streak.ends_px;
                let [flux, sigma] = field.whole_streak_adu(streak).to_array();
                Source {
                    place: [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])],
                    flux,
                    sigma,
                    is_good: !streak.is_saturated && !streak.is_end_hidden && streak.masked < 0.15,
                }
            })
            .collect()
    } else {
        let of = |point: &crate::photometry::field::PointSource| {
            let [flux, sigma] = field.whole_point_adu(point).to_array();
            let is_good = !point.is_saturated && !point.is_cut && point.significance > 10.0;
            Source { place: point.place_px.to_array(), flux, sigma, is_good }
        };
        field.points.iter().map(of).collect()
    };
    sources.sort_by(|a, b| b.flux.total_cmp(&a.flux));
    sources
}
