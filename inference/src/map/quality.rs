//! How well samples agree on the frame of a spin: axes all over the sky, for a body of unknown shape.

use super::PlacedCurve;
use ndarray::Array2;
use sunglint_analysis::map::{
    BodyMap, Grid, GridError, Quality, QualityError, Sighting, Spin, longitude_latitude, scan,
};
use sunglint_numerics::progress::Progress;

/// Axes whose measure is within this factor of the smallest are told: under the Sun place alone does not make the light, and the smallest need not be the true one.
pub const ALIKE: f64 = 2.0;
/// End of the warning that the best period is the shortest or the longest of all that were tried.
pub const TRIED: &str = "that was tried";
/// Cells that two turns visit: with fewer the measure says nothing.
const LEAST_CELLS: usize = 10;
/// Periods at most.
const MOST_PERIODS: usize = 4000;

/// Why there is no measure.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpinQualityError {
    /// Cells that are none.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Samples that cannot be compared.
    #[error(transparent)]
    Quality(#[from] QualityError),
    /// Hardly a sample with light.
    #[error("{samples} with light among the samples: at least 3 are needed")]
    Few {
        /// Samples with light.
        samples: usize,
    },
    /// More periods than can be looked at.
    #[error(
        "{periods:.0} periods within {percent} % of {period_s} s over {span_s:.0} s, at most {MOST_PERIODS}"
    )]
    Periods {
        /// Number of periods that would have to be looked at.
        periods: f64,
        /// Largest difference from the period in the middle, percent.
        percent: f64,
        /// The period in their middle, s.
        period_s: f64,
        /// From the first to the last sample, s.
        span_s: f64,
    },
    /// No cell is visited by two turns.
    #[error(
        "no cell of {cell_deg}° is visited by two turns of {period_s} s often enough ({LEAST_CELLS} cells at least): longer data, a shorter period or larger cells are needed"
    )]
    Cells {
        /// The step of the cells, degrees.
        cell_deg: f64,
        /// The period, s.
        period_s: f64,
    },
}

/// Which spins are tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinOptions {
    /// The sidereal period about which the measure looks, s.
    pub period_s: f64,
    /// The part of it by which other periods may differ.
    pub within: f64,
    /// Cells on the body's frame.
    pub cells: Grid,
    /// Axes over the sky.
    pub axes: Grid,
}

/// How well samples agree on a spin's frame, over the sky.
#[derive(Debug, Clone)]
pub struct SpinQuality {
    /// The target's name.
    pub target: String,
    /// Samples with light.
    pub samples: usize,
    /// Step of the cells on the body's frame, degrees.
    pub step_deg: f64,
    /// Periods that were tried about each axis.
    pub periods: usize,
    /// The smallest measure of all periods, by axis; NaN where too few cells are visited twice.
    pub theta: BodyMap,
    /// The period of that, s.
    pub period_s: Array2<f64>,
    /// The spin with the smallest measure.
    pub best: (Spin, Quality),
    /// The part of the sky whose axes fit as well ([`ALIKE`]).
    pub alike: f64,
    /// Their periods from … to, s.
    pub alike_s: (f64, f64),
    /// Warnings about the result, for the user.
    pub warnings: Vec<String>,
}

/// Measures how well the samples of a curve agree from turn to turn, for axes all over the sky.
///
/// # Errors
/// Too few samples with light, too many periods, no cell that two turns visit.
pub fn spin_quality(
    placed: &PlacedCurve,
    options: &SpinOptions,
    progress: &dyn Progress,
) -> Result<SpinQuality, SpinQualityError> {
    let SpinOptions { period_s, within, cells, axes: sky } = *options;
    let mut warnings = placed.warnings.clone();
    let sightings = sightings(placed);
    let times = || sightings.iter().map(|s| s.time_s);
    let span_s = times().fold(f64::NEG_INFINITY, f64::max) - times().fold(f64::INFINITY, f64::min);
    if sightings.len() < 3 {
        return Err(SpinQualityError::Few { samples: sightings.len() });
    }
    // Between neighbours the frame turns by half of a cell from the first sample to the last.
    let part = 0.5 * cells.step_deg() / 360.0 * period_s / span_s.max(period_s);
    let side = (within / part).ceil();
    if 2.0 * side > MOST_PERIODS as f64 {
        return Err(SpinQualityError::Periods {
            periods: 2.0 * side + 1.0,
            percent: 100.0 * within,
            period_s,
            span_s,
        });
    }
    let side = side as i32;
    let periods: Vec<f64> =
        (-side..=side).map(|k| period_s / (1.0 - f64::from(k) * part.min(within))).collect();
    let mut theta = Array2::from_elem(sky.dim(), f64::NAN);
    let mut best_period = theta.clone();
    let mut best: Option<(Spin, Quality)> = None;
    let axes: Vec<_> = theta.indexed_iter().map(|(cell, _)| cell).collect();
    progress.begin("looking at axes", Some(axes.len() as u64));
    for cell in axes {
        progress.advance(1);
        let axis = sky.direction(cell);
        let spins: Vec<Spin> = periods.iter().map(|p| Spin { axis, period_s: *p }).collect();
        let found = scan(&sightings, &spins, cells)?;
        let good = spins.into_iter().zip(found);
        let good = good.filter(|(_, q)| q.theta.is_finite() && q.cells >= LEAST_CELLS);
        let Some(here) = good.min_by(|a, b| a.1.theta.total_cmp(&b.1.theta)) else { continue };
        theta[cell] = here.1.theta;
        best_period[cell] = here.0.period_s;
        if best.is_none_or(|(_, q)| here.1.theta < q.theta) {
            best = Some(here);
        }
    }
    let Some(best) = best else {
        return Err(SpinQualityError::Cells { cell_deg: cells.step_deg(), period_s });
    };
    let theta = BodyMap::full(sky, theta)?;
    let (mut alike, mut alike_s) = (0.0, (f64::INFINITY, 0.0_f64));
    for (cell, value) in theta.mean.indexed_iter() {
        if *value <= ALIKE * best.1.theta {
            alike += sky.share(cell.0);
            let p = best_period[cell];
            alike_s = (alike_s.0.min(p), alike_s.1.max(p));
        }
    }
    let ends = [periods[0], periods[periods.len() - 1]];
    if within > 0.0 && ends.contains(&best.0.period_s) {
        warnings.push(format!(
            "the best period, {:.5} s, is the {} {TRIED}",
            best.0.period_s,
            if best.0.period_s < period_s { "shortest" } else { "longest" }
        ));
    }
    Ok(SpinQuality {
        target: placed.lit.curve().target().to_owned(),
        samples: sightings.len(),
        step_deg: cells.step_deg(),
        periods: periods.len(),
        theta,
        period_s: best_period,
        best,
        alike,
        alike_s,
        warnings,
    })
}

/// The samples with light: the mean over the bands of the root of the reflection factor, each over its own mean. A root, so that glints do not decide alone.
fn sightings(placed: &PlacedCurve) -> Vec<Sighting> {
    let bands = placed.bands.names.len();
    let root = |i: usize, b: usize| {
        let value = placed.found[i].factors[b];
        value.abs().sqrt().copysign(value)
    };
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (mut sum, mut n) = (0.0, 0.0);
        for value in values.filter(|v| v.is_finite()) {
            sum += value;
            n += 1.0;
        }
        sum / n
    };
    let n = placed.found.len();
    let means: Vec<f64> = (0..bands).map(|b| mean(&mut (0..n).map(|i| root(i, b)))).collect();
    let first = placed.places().first().map(|p| p.geometry.emitted);
    let sighting = |i: usize| {
        let place = &placed.places()[i];
        // A band that has no light on the whole says nothing.
        let of = |b: &usize| means[*b] > 0.0;
        let value = mean(&mut (0..bands).filter(of).map(|b| root(i, b) / means[b]));
        value.is_finite().then(|| Sighting {
            time_s: first.map_or(0.0, |f| (place.geometry.emitted - f).to_seconds()),
            to_sun: place.geometry.sun.direction_gcrs,
            to_observer: place.geometry.to_observer,
            value,
        })
    };
    (0..n).filter_map(sighting).collect()
}

impl SpinQuality {
    /// Right ascension (0 to 360°) and declination of the best axis, degrees.
    pub fn axis_deg(&self) -> (f64, f64) {
        let (longitude, latitude) = longitude_latitude(self.best.0.axis);
        (longitude.rem_euclid(360.0), latitude)
    }
}
