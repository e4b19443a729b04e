//! Samples that are means over their exposures. Where the light of the middle is not that of the mean, a sample gets moments of its own within its exposure,
//! the points of Gauss's rule that [`crate::pass::exposure`] found enough; its light is their weighted mean. The moments stay, whatever turns or shines,
//! so that a small change of the pass makes a small change of its light.

use super::{PassError, Study};
use crate::pass::exposure::points;
use crate::pass::{ExposureMeans, Simulation};
use hifitime::Unit;
use ndarray::Array2;

/// Share of a column's largest mean that counts as light where there is less.
const FAINT: f64 = 1e-3;

/// At how many moments means over exposures are taken, and what they err by.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Averaged {
    /// All samples.
    pub samples: usize,
    /// Those whose light is a mean over several moments; the others have the light of their middle.
    pub averaged: usize,
    /// Moments besides the middles.
    pub moments: usize,
    /// Samples whose exposures reach beyond a table of positions or attitudes: the middle stands for them.
    pub beyond: usize,
    /// Error of direct light in any channel or band, of the mean or of a thousandth of the brightest: by the largest difference between middle and mean of a
    /// sample that has the light of its middle; by what was tolerated, or by the last two refinements' difference where that is more, of the others.
    pub error: f64,
}

/// The moments of the samples.
#[derive(Debug, Clone, Default)]
pub(super) struct Exposures {
    /// Pieces of each sample's exposure; 0 where the middle stands for it. Empty before the first look.
    pieces: Vec<u32>,
    /// For each sample its moments with weights that add up to 1. Empty before the first look.
    moments: Vec<Vec<(usize, f64)>>,
}

impl Exposures {
    /// The rows of the samples, from those of all moments. A sample with a moment below the horizon keeps the row of its middle.
    pub fn means(&self, rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if self.moments.is_empty() {
            return rows;
        }
        let mean = |(i, own): (usize, &Vec<(usize, f64)>)| {
            let mut mean = vec![0.0; rows[i].len()];
            for (moment, weight) in own {
                mean.iter_mut().zip(&rows[*moment]).for_each(|(m, r)| *m += weight * r);
            }
            if mean.iter().all(|v| v.is_finite()) { mean } else { rows[i].clone() }
        };
        self.moments.iter().enumerate().map(mean).collect()
    }
}

impl Study {
    /// Has a sample's light averaged over its exposure wherever that of the middle differs from the mean by more than `tolerance` (of the mean; direct
    /// light) as the pass stands now. Moments that there were before stay.
    ///
    /// # Errors
    /// The errors of [`crate::pass::Pass::simulate`] at the moments within the exposures.
    pub fn average(&mut self, tolerance: f64) -> Result<Averaged, PassError> {
        let (middles, found) = self.exposure_means(tolerance)?;
        let means = &found.values;
        let largest: Vec<f64> = means
            .columns()
            .into_iter()
            .map(|c| c.iter().fold(0.0, |m, v| f64::max(m, v.abs())))
            .collect();
        let mut pieces = self.exposures.pieces.clone();
        pieces.resize(self.samples, 0);
        let mut error = 0.0_f64;
        for (i, pieces) in pieces.iter_mut().enumerate() {
            let relative = |difference: &dyn Fn(usize) -> f64| {
                let each = (0..means.ncols()).map(|c| {
                    let scale = means[[i, c]].abs().max(FAINT * largest[c]);
                    if scale > 0.0 { difference(c) / scale } else { 0.0 }
                });
                // Below the horizon there is no number.
                each.filter(|d| d.is_finite()).fold(0.0, f64::max)
            };
            let off = relative(&|c| (middles[[i, c]] - means[[i, c]]).abs());
            if off > tolerance {
                *pieces = (*pieces).max(found.pieces[i]);
            }
            // What settled did so to the tolerance.
            let unsettled = || relative(&|c| found.unsettled[[i, c]]).max(tolerance);
            error = error.max(if *pieces == 0 { off } else { unsettled() });
        }
        if pieces != self.exposures.pieces {
            self.set_pieces(pieces)?;
        }
        Ok(Averaged {
            samples: self.samples,
            averaged: self.exposures.pieces.iter().filter(|p| **p > 0).count(),
            moments: self.places.len() - self.samples,
            beyond: found.beyond,
            error,
        })
    }

    /// Has the light of samples averaged over their exposures at as many moments as that of another study of the same samples.
    ///
    /// # Errors
    /// The errors of [`crate::pass::Pass::simulate`] at the moments within the exposures.
    pub fn average_as(&mut self, other: &Self) -> Result<(), PassError> {
        let pieces = &other.exposures.pieces;
        if pieces.len() == self.samples && *pieces != self.exposures.pieces {
            self.set_pieces(pieces.clone())?;
        }
        Ok(())
    }

    /// Direct light of the samples as the pass stands now, in the middles and as means over the exposures: samples × (channels, then bands).
    fn exposure_means(&self, tolerance: f64) -> Result<(Array2<f64>, ExposureMeans), PassError> {
        let n = self.samples;
        let mut pass = self.pass.direct_light()?;
        pass.times.truncate(n);
        pass.exposure_s.truncate(n);
        pass.observations.truncate(n);
        let silent = |_| ();
        let simulation = pass.simulate_moments(&silent)?;
        let found = simulation.exposure_means_to(tolerance, &light, &silent)?;
        Ok((light(&simulation), found))
    }

    /// Gives the samples their moments.
    fn set_pieces(&mut self, pieces: Vec<u32>) -> Result<(), PassError> {
        self.times.truncate(self.samples);
        self.pass.exposure_s.truncate(self.samples);
        self.pass.observations.truncate(self.samples);
        let mut moments = Vec::with_capacity(self.samples);
        for (i, pieces) in pieces.iter().enumerate() {
            let (middle, length_s) = (self.times[i], self.pass.exposure_s[i]);
            let mut own = Vec::new();
            for (offset, weight) in points(*pieces) {
                own.push((self.times.len(), weight));
                self.times.push(middle + offset * length_s * Unit::Second);
                self.pass.exposure_s.push(length_s);
                let own = self.pass.observations.get(i).cloned();
                self.pass.observations.extend(own);
            }
            moments.push(if own.is_empty() { vec![(i, 1.0)] } else { own });
        }
        self.exposures = Exposures { pieces, moments };
        // Nodes are epochs by number.
        self.nodes = [None, None];
        self.set_times()
    }
}

/// Rates of all channels, then fluxes in all bands, of each epoch.
fn light(simulation: &Simulation<'_>) -> Array2<f64> {
    let channels = simulation.channels.len();
    let shape = (simulation.places.len(), channels + simulation.magnitudes.ncols());
    Array2::from_shape_fn(shape, |(i, q)| match simulation.channels.get(q) {
        Some(channel) => channel.rate_hz[i],
        None => {
            let magnitude = simulation.magnitudes[[i, q - channels]];
            // Without light there is no magnitude.
            if magnitude.is_nan() { 0.0 } else { 10_f64.powf(-0.4 * magnitude) }
        }
    })
}
