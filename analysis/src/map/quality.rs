//! Agreement of samples on the body's frame: a measure of a spin state for a body of unknown shape.

use super::{Grid, longitude_latitude, phase_vector};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A sample of a body whose turn is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Seconds since any epoch that all samples share.
    pub time_s: f64,
    /// Unit vector to the Sun, axes at rest (GCRS).
    pub to_sun: DVec3,
    /// Unit vector to the observer, same axes.
    pub to_observer: DVec3,
    /// Measured value, corrected for range and air: a reflection factor, or its logarithm, which does not leave everything to the glints.
    pub value: f64,
}

/// A steady turn about an axis at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    /// The axis, GCRS, any length above 0; turns are right-handed about it.
    pub axis: DVec3,
    /// Sidereal period, s.
    pub period_s: f64,
}

/// Agreement of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Variance of visits within cells over that of all visits compared, each with its own degrees of freedom: near 1 where the cells mean nothing, small where visits of one cell agree. NaN
    /// where no cell is visited twice.
    pub theta: f64,
    /// Cells that were visited in two turns or more, whose scatter counts.
    pub cells: usize,
    /// Visits to them.
    pub visits: usize,
}

/// Why there is no such measure.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum QualityError {
    /// A spin that is none.
    #[error("an axis of length {length} and a period of {period_s} s: expected both above 0")]
    Spin {
        /// The axis' length.
        length: f64,
        /// The period.
        period_s: f64,
    },
    /// Too little to compare.
    #[error("{samples} samples with a value and a phase vector: at least 3 are needed")]
    Few {
        /// Samples.
        samples: usize,
    },
    /// All alike.
    #[error("all {samples} samples have the value {value}: every spin fits them")]
    Constant {
        /// Samples.
        samples: usize,
        /// Their value.
        value: f64,
    },
}

/// A sample on a frame that turns with the spin: its z axis is the spin's, its meridian any.
struct Placed {
    place: (f64, f64),
    /// Turn that it belongs to, so that a cell's visits are told apart.
    turn: i64,
    value: f64,
}

fn places(sightings: &[Sighting], spin: Spin) -> Result<Vec<Placed>, QualityError> {
    let Spin { axis, period_s } = spin;
    let length = axis.length();
    if !(length > 0.0 && length.is_finite() && period_s > 0.0 && period_s.is_finite()) {
        return Err(QualityError::Spin { length, period_s });
    }
    let upright = DQuat::from_rotation_arc(axis / length, DVec3::Z);
    let place = |s: &Sighting| {
        let vector = upright * phase_vector(s.to_sun, s.to_observer)?;
        let (longitude, latitude) = longitude_latitude(vector);
        let turns = longitude / 360.0 - s.time_s / period_s;
        // A float of any size becomes the nearest whole number that there is.
        let turn = turns.floor() as i64;
        let longitude = 360.0 * (turns - turns.floor());
        (s.value.is_finite() && turns.is_finite()).then_some(Placed {
            place: (longitude, latitude),
            turn,
            value: s.value,
        })
    };
    Ok(sightings.iter().filter_map(place).collect())
}

/// How well samples agree on the frame of a spin: phase dispersion minimisation on two coordinates in place of one. What is compared are the means of *visits*, the samples that a cell gets in
/// one turn: neighbours in time are alike on every frame, and would make a frame look good on which no cell is visited twice. The period is sidereal, since the Sun's and the observer's
/// directions are those of each sample.
///
/// # Errors
/// A spin that is none; fewer than three samples; samples all alike.
pub fn quality(sightings: &[Sighting], spin: Spin, grid: Grid) -> Result<Quality, QualityError> {
    let placed = places(sightings, spin)?;
    let samples = placed.len();
    if samples < 3 {
        return Err(QualityError::Few { samples });
    }
    let mean = placed.iter().map(|p| p.value).sum::<f64>() / samples as f64;
    let total: f64 = placed.iter().map(|p| (p.value - mean).powi(2)).sum();
    if total <= (1e-12 * mean).powi(2) * samples as f64 {
        return Err(QualityError::Constant { samples, value: mean });
    }
    let columns = grid.dim().1;
    let mut all: Vec<(usize, i64, f64)> = Vec::with_capacity(samples);
    for p in &placed {
        // A place of finite numbers always has a cell.
        let cell = grid.cell(p.place).map(|(row, column)| row * columns + column);
        all.extend(cell.map(|cell| (cell, p.turn, p.value)));
    }
    // Stable: values of a visit keep their order, so that sums do not depend on anything else.
    all.sort_by_key(|(cell, turn, _)| (*cell, *turn));
    let average = |values: &mut dyn Iterator<Item = f64>| {
        let (mut sum, mut count) = (0.0, 0.0);
        for value in values {
            sum += value;
            count += 1.0;
        }
        sum / count
    };
    let (mut within, mut freedom, mut cells) = (0.0, 0_usize, 0_usize);
    let mut compared: Vec<f64> = Vec::new();
    for cell in all.chunk_by(|a, b| a.0 == b.0) {
        let visits: Vec<f64> = cell
            .chunk_by(|a, b| a.1 == b.1)
            .map(|visit| average(&mut visit.iter().map(|v| v.2)))
            .collect();
        if visits.len() < 2 {
            continue;
        }
        let middle = average(&mut visits.iter().copied());
        within += visits.iter().map(|v| (v - middle).powi(2)).sum::<f64>();
        freedom += visits.len() - 1;
        cells += 1;
        compared.extend(visits);
    }
    let middle = average(&mut compared.iter().copied());
    let spread: f64 = compared.iter().map(|v| (v - middle).powi(2)).sum();
    let theta = if freedom == 0 || spread <= 0.0 {
        f64::NAN
    } else {
        (within / freedom as f64) / (spread / (compared.len() - 1) as f64)
    };
    Ok(Quality { theta, cells, visits: compared.len() })
}

/// The same for many spins side by side; the order is theirs.
///
/// # Errors
/// The errors of [`quality`], the first by the order of the spins.
pub fn scan(
    sightings: &[Sighting],
    spins: &[Spin],
    grid: Grid,
) -> Result<Vec<Quality>, QualityError> {
    let all: Vec<_> = spins.par_iter().map(|spin| quality(sightings, *spin, grid)).collect();
    all.into_iter().collect()
}

impl Spin {
    /// From right ascension and declination of the axis, degrees, and the period, s.
    pub fn of(right_ascension_deg: f64, declination_deg: f64, period_s: f64) -> Self {
        let (sin_a, cos_a) = (TAU * right_ascension_deg / 360.0).sin_cos();
        let (sin_d, cos_d) = (TAU * declination_deg / 360.0).sin_cos();
        Self { axis: DVec3::new(cos_d * cos_a, cos_d * sin_a, sin_d), period_s }
    }
}
