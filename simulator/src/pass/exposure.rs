//! Means over exposures: what an instrument records of light that changes while it is exposed.
//!
//! The middle of an exposure stands for its mean as long as the light changes little, to T² f″/24. Here the mean is taken by three points of Gauss's rule,
//! and where these differ from the middle, or the body turns by more than [`TURN_DEG`] in the exposure, by the rule on 2, 4 … [`MOST_PIECES`] pieces, until
//! two refinements agree. It is the direct light (with shadows, and the Sun's disc where that matters) of which mean and middle are compared, which costs
//! microseconds; light by other ways, which turns less sharply with the body, keeps the value of the middle.
//!
//! Where nothing is averaged, the middle is held against the mean ([`Simulation::smear`]) by the same points: from the turn on in which the body's narrowest glint changes by about the tolerance.

use super::counts::Counts;
use super::simulate::{Lit, Place, Progress, Way};
use super::{Pass, PassError, Ready, Simulation};
use crate::light::Source;
use crate::light::engine::{Switch, Switches};
use glam::DVec3;
use hifitime::Unit;
use ndarray::{Array2, s};
use rayon::prelude::*;

/// Outer point of Gauss's rule of three points on [−1, 1], √(3/5).
const NODE: f64 = 0.774_596_669_241_483_4;
/// Weights of its outer points and of its middle.
const WEIGHTS: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
/// An exposure is cut into no more pieces than these.
pub const MOST_PIECES: u32 = 64;
/// In a piece of an exposure the direction half-way between Sun and station turns by no more than this over the body, degrees: a mirror flashes for a turn of the
/// Sun's radius.
pub const TURN_DEG: f64 = 0.25;
/// Where it is only asked how far off the middle is: a piece for this much of turning, degrees, to begin with, and the part of the answer by which two rules may differ.
const PIECE_DEG: f64 = 10.0;
/// The same in widths of the narrowest glint: so that one of the points falls on it.
const PIECE_WIDTHS: f64 = 4.0;
const AGREE: f64 = 0.25;
/// A difference below this part of the tolerance is not asked about again.
const SMALL: f64 = 0.1;
/// Values below this part of a column's largest need not settle relative to themselves.
const FAINT: f64 = 1e-3;

/// Means over the exposures of a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposureMeans {
    /// Samples × columns, in the order of the values that were asked for.
    pub values: Array2<f64>,
    /// The same: by how much the last two refinements differ, where they do not agree; else 0. An estimate of the error of the mean.
    pub unsettled: Array2<f64>,
    /// Pieces of each exposure.
    pub pieces: Vec<u32>,
    /// The largest difference between mean and middle, relative to the mean (of values above a thousandth of the column's largest).
    pub largest_change: f64,
    /// Samples whose mean did not settle, or whose body turns too fast for [`MOST_PIECES`].
    pub coarse: usize,
    /// Samples whose exposures reach beyond a table of positions or attitudes: the middle stands for the mean.
    pub beyond: usize,
    /// Moments that were simulated besides the middles.
    pub moments: usize,
}

/// Inputs that are the same for all samples.
struct Averaging<'a> {
    /// The pass with the direct light alone, and one spectral bin.
    direct: Pass,
    tolerance: f64,
    values: &'a dyn Fn(&Simulation<'_>) -> Array2<f64>,
    progress: &'a (dyn Fn(Progress) + Sync),
    /// By column, the largest value in the middle of an exposure.
    largest: Vec<f64>,
}

impl Simulation<'_> {
    /// The means over the exposures of what `values` takes from a simulation (samples × columns, each additive, such as rates), to the pass's tolerance.
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`] at the moments within the exposures.
    pub fn exposure_means(
        &self,
        values: &dyn Fn(&Simulation<'_>) -> Array2<f64>,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<ExposureMeans, PassError> {
        self.exposure_means_to(self.pass.tolerance, values, progress)
    }

    /// The same to a tolerance of its own, relative.
    ///
    /// # Errors
    /// The errors of [`Simulation::exposure_means`].
    pub fn exposure_means_to(
        &self,
        tolerance: f64,
        values: &dyn Fn(&Simulation<'_>) -> Array2<f64>,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<ExposureMeans, PassError> {
        let middle = values(self);
        let n = self.places.len();
        let mut means = ExposureMeans {
            unsettled: Array2::zeros(middle.dim()),
            values: middle.clone(),
            pieces: vec![1; n],
            largest_change: 0.0,
            coarse: 0,
            beyond: 0,
            moments: 0,
        };
        // Below the horizon there is nothing to average.
        let seen: Vec<usize> = (0..n).filter(|i| !self.places[*i].hidden).collect();
        if seen.is_empty() {
            return Ok(means);
        }
        let averaging = Averaging::new(self.pass, tolerance, values, progress, &middle)?;
        let all = seen.len();
        let seen = averaging.known(seen)?;
        means.beyond = all - seen.len();
        if seen.is_empty() {
            return Ok(means);
        }
        let pass = averaging.at(&seen, &[-0.5 * NODE, 0.0, 0.5 * NODE]);
        let outer = pass.simulate_moments(progress)?;
        let around = values(&outer);
        means.moments += pass.times.len();
        // Samples that are still to be refined, each with the pieces that its body's turning asks for, and its direct light in the middle.
        let mut open: Vec<Open> = Vec::new();
        for (k, i) in seen.into_iter().enumerate() {
            let direct = around.row(3 * k + 1).to_vec();
            let rows = [3 * k, 3 * k + 1, 3 * k + 2];
            let mean: Vec<f64> = (0..direct.len())
                .map(|c| rows.iter().zip(WEIGHTS).map(|(r, w)| w * around[[*r, c]]).sum())
                .collect();
            let wanted = pieces(rows.map(|r| &outer.places[r]));
            if wanted > 1.0 || !averaging.agree(&direct, &mean, &middle.row(i).to_vec()) {
                open.push(Open { sample: i, wanted, direct: direct.clone() });
            }
            means.set(i, &middle.row(i).to_vec(), &direct, &mean, 1);
        }
        averaging.refine(open, &middle, &mut means)?;
        means.largest_change = averaging.largest_change(&middle, &means.values);
        Ok(means)
    }
}

/// A sample that is still to be refined.
struct Open {
    sample: usize,
    wanted: f64,
    direct: Vec<f64>,
}

impl<'a> Averaging<'a> {
    fn new(
        pass: &Pass,
        tolerance: f64,
        values: &'a dyn Fn(&Simulation<'_>) -> Array2<f64>,
        progress: &'a (dyn Fn(Progress) + Sync),
        middle: &Array2<f64>,
    ) -> Result<Self, PassError> {
        let direct = pass.direct_light()?;
        let most = |c: usize| {
            let good = middle.column(c).into_iter().filter(|v| v.is_finite());
            good.fold(0.0_f64, |a, v| a.max(v.abs()))
        };
        let largest = (0..middle.ncols()).map(most).collect();
        Ok(Self { direct, tolerance, values, progress, largest })
    }

    /// The pass at offsets (of the exposure) from the middles of some samples: each sample's offsets after one another.
    fn at(&self, samples: &[usize], offsets: &[f64]) -> Pass {
        let pass = &self.direct;
        let (mut times, mut exposure_s) = (Vec::new(), Vec::new());
        for i in samples {
            for offset in offsets {
                times.push(pass.times[*i] + offset * pass.exposure_s[*i] * Unit::Second);
                exposure_s.push(pass.exposure_s[*i]);
            }
        }
        let own = samples.iter().flat_map(|i| offsets.iter().map(|_| *i));
        let observations = pass.observations_of(own);
        Pass { times, exposure_s, observations, ..pass.clone() }
    }

    /// Returns those samples for which it is known where everything is from the beginning of the exposure to its end.
    fn known(&self, samples: Vec<usize>) -> Result<Vec<usize>, PassError> {
        let ends = self.at(&samples, &[-0.5, 0.5]);
        let (first, last) = ends.ends();
        let frames = ends.frames(ends.times.iter().copied(), 0.0)?;
        let orbit = ends.orbit.near(first, last);
        let later = hifitime::Duration::from_seconds(ends.correction.time_offset_s);
        let known = |i: usize| {
            let (orbit, site) = ends.of_sample(i, &orbit);
            ends.place_from(site, ends.times[i] + later, orbit, &frames).is_ok()
        };
        let both = (0..samples.len()).map(|k| known(2 * k) && known(2 * k + 1));
        let both: Vec<bool> = both.collect();
        Ok(samples.into_iter().zip(both).filter(|(_, both)| *both).map(|(i, _)| i).collect())
    }

    /// Whether two estimates agree to the tolerance of the light that there is in all. What is no number agrees: there is nothing to refine.
    fn agree(&self, before: &[f64], after: &[f64], all: &[f64]) -> bool {
        let near = |c: usize| {
            let scale = after[c].abs().max(all[c].abs()).max(FAINT * self.largest[c]);
            let difference = (before[c] - after[c]).abs();
            difference.is_nan() || difference <= self.tolerance * scale
        };
        (0..after.len()).all(near)
    }

    /// Cuts exposures until their means settle.
    fn refine(
        &self,
        mut open: Vec<Open>,
        middle: &Array2<f64>,
        means: &mut ExposureMeans,
    ) -> Result<(), PassError> {
        let mut pieces = 2;
        while pieces <= MOST_PIECES && !open.is_empty() {
            let last = pieces == MOST_PIECES;
            // The last refinement is held against the one before it.
            let begins = |o: &Open| o.wanted <= f64::from(pieces) || 2 * pieces >= MOST_PIECES;
            let (now, later): (Vec<_>, Vec<_>) = open.into_iter().partition(begins);
            let samples: Vec<usize> = now.iter().map(|o| o.sample).collect();
            let refined = self.refined(&samples, pieces)?;
            means.moments += samples.len() * 3 * pieces as usize;
            open = later;
            for (o, mean) in now.into_iter().zip(refined.rows()) {
                let (i, all) = (o.sample, middle.row(o.sample).to_vec());
                let before = means.values.row(i).to_vec();
                let held = f64::from(means.pieces[i]) >= o.wanted.min(f64::from(MOST_PIECES / 2));
                means.set(i, &all, &o.direct, &mean.to_vec(), pieces);
                let after = means.values.row(i).to_vec();
                let agrees = self.agree(&before, &after, &all);
                if last && !agrees {
                    for (c, (a, b)) in after.iter().zip(&before).enumerate() {
                        means.unsettled[[i, c]] = (a - b).abs();
                    }
                }
                if last {
                    let fine = agrees && o.wanted <= f64::from(MOST_PIECES);
                    means.coarse += usize::from(!fine);
                } else if !(agrees && held) {
                    open.push(o);
                }
            }
            pieces *= 2;
        }
        Ok(())
    }

    /// The means of some samples by Gauss's rule on so many pieces.
    fn refined(&self, samples: &[usize], pieces: u32) -> Result<Array2<f64>, PassError> {
        if samples.is_empty() {
            return Ok(Array2::zeros((0, 0)));
        }
        let (offsets, weights): (Vec<f64>, Vec<f64>) = points(pieces).unzip();
        let all = (self.values)(&self.at(samples, &offsets).simulate_moments(self.progress)?);
        let mut means = Array2::zeros((samples.len(), all.ncols()));
        for (k, mut mean) in means.rows_mut().into_iter().enumerate() {
            let own = all.slice(s![k * offsets.len()..(k + 1) * offsets.len(), ..]);
            for (weight, row) in weights.iter().zip(own.rows()) {
                mean.scaled_add(*weight, &row);
            }
        }
        Ok(means)
    }

    fn largest_change(&self, middle: &Array2<f64>, means: &Array2<f64>) -> f64 {
        let mut most = 0.0_f64;
        for (rows, middles) in means.rows().into_iter().zip(middle.rows()) {
            for (c, (mean, middle)) in rows.iter().zip(middles).enumerate() {
                let change = (middle / mean - 1.0).abs();
                if mean.abs() > FAINT * self.largest[c] && change.is_finite() {
                    most = most.max(change);
                }
            }
        }
        most
    }
}

impl ExposureMeans {
    /// A sample's mean: its middle, and what the mean of its direct light differs by from that of the middle.
    fn set(&mut self, i: usize, middle: &[f64], direct: &[f64], mean: &[f64], pieces: u32) {
        for (c, value) in self.values.row_mut(i).iter_mut().enumerate() {
            let difference = mean[c] - direct[c];
            // What is no number on one side of the horizon keeps the middle's value.
            *value = middle[c] + if difference.is_finite() { difference } else { 0.0 };
        }
        self.pieces[i] = pieces;
    }
}

/// The points of Gauss's rule on so many pieces of an exposure: offsets from its middle, of its length, and weights, which add up to 1.
pub(super) fn points(pieces: u32) -> impl Iterator<Item = (f64, f64)> {
    let p = f64::from(pieces);
    (0..pieces).flat_map(move |k| {
        let at = move |x: f64| (f64::from(k) + 0.5 + 0.5 * x) / p - 0.5;
        [-NODE, 0.0, NODE].map(at).into_iter().zip(WEIGHTS.map(|w| w / p))
    })
}

impl Pass {
    /// The same pass with the direct light alone, and one spectral bin.
    ///
    /// # Errors
    /// [`PassError::Input`] without a bin.
    pub(super) fn direct_light(&self) -> Result<Self, PassError> {
        let (Some(first), Some(last)) = (self.edges_nm.first(), self.edges_nm.last()) else {
            let needs = "at least one spectral bin";
            return Err(PassError::Input { needs, found: "none".into() });
        };
        let effects = Switches {
            inter_reflection: Switch::Off,
            earthshine: Switch::Off,
            moonshine: Switch::Off,
            ..self.effects
        };
        Ok(Self { edges_nm: vec![*first, *last], effects, ..self.clone() })
    }
}

impl Ready<'_> {
    /// The turn, degrees, up to which the middle of an exposure is taken for its mean without a look. Where a lobe of roughness α turns by θ its mean differs from its middle by (θ/α)²/24 of (4 t² − 2), with
    /// t where in the lobe the observer stands: √tolerance of α is within about the tolerance to where the lobe has fallen to a thousandth of its peak.
    fn least_turn_deg(&self) -> f64 {
        (self.engine.glint_rad().to_degrees() * self.pass.tolerance.sqrt()).min(TURN_DEG)
    }

    /// Light above the air that is straight from the Sun, of a place with its weights.
    fn straight(&self, place: &Place, weights: &[f64]) -> Vec<f64> {
        let terms = self.engine.terms().iter().zip(weights);
        let own = terms.map(|(t, w)| if t.source == Source::Direct { *w } else { 0.0 });
        self.pass.above_air(place, &own.collect::<Vec<_>>(), &self.functionals)
    }

    /// [`Simulation::smear`] of places that follow one another in the pass, the first of them at an epoch, with their light and counts.
    pub(super) fn smear(
        &self,
        way: &Way<'_>,
        places: &[Place],
        lit: &[Lit],
        counts: &[Counts],
        first: usize,
    ) -> Vec<f64> {
        let least_deg = self.least_turn_deg();
        let piece_deg = (PIECE_WIDTHS * self.engine.glint_rad().to_degrees()).min(PIECE_DEG);
        let all = places.par_iter().zip(lit).zip(counts).enumerate().map_init(
            || self.eye(),
            |eye, (k, ((place, (weights, _)), counts))| {
                if place.hidden {
                    return 0.0;
                }
                let i = first + k;
                let exposure_s = self.pass.exposure_s[i];
                let beside = |offset: f64| way.beside(i, offset * exposure_s).ok();
                // Where it is not known where everything is there is nothing to compare.
                let Some([before, after]) =
                    beside(-0.5 * NODE).and_then(|before| Some([before, beside(0.5 * NODE)?]))
                else {
                    return 0.0;
                };
                let turn_deg = TURN_DEG * pieces([&before, place, &after]);
                if turn_deg <= least_deg {
                    return 0.0;
                }
                let mut direct = |at: &Place| {
                    let (weights, _) = eye.weigh_some(at, &|s| s == Source::Direct).ok()?;
                    Some(self.pass.above_air(at, &weights, &self.functionals))
                };
                let middle = self.straight(place, weights);
                let Some([first, last]) =
                    direct(&before).and_then(|first| Some([first, direct(&after)?]))
                else {
                    return 0.0;
                };
                let whole = above(counts);
                let off = |mean: &[f64]| {
                    let of = |c: usize| {
                        let change = mean[c] - middle[c];
                        change.abs() / whole[c].max(whole[c] + change)
                    };
                    (0..whole.len()).map(of).filter(|x| x.is_finite()).fold(0.0, f64::max)
                };
                let mut by_pieces = |pieces: u32| -> Option<f64> {
                    let mut mean = vec![0.0; whole.len()];
                    for (offset, weight) in points(pieces) {
                        let light = direct(&beside(offset)?)?;
                        mean.iter_mut().zip(light).for_each(|(mean, own)| *mean += weight * own);
                    }
                    Some(off(&mean))
                };
                let [outer, inner, _] = WEIGHTS;
                let mean = |c: usize| outer * (first[c] + last[c]) + inner * middle[c];
                let mut found = off(&(0..whole.len()).map(mean).collect::<Vec<f64>>());
                let (most, mut pieces) = (f64::from(MOST_PIECES), 1);
                if turn_deg > piece_deg {
                    pieces = (turn_deg / piece_deg).ceil().min(most) as u32;
                    found = by_pieces(pieces).unwrap_or(found);
                }
                // Glints and edges of faces lie between the points of a coarse rule.
                while pieces < MOST_PIECES && found > SMALL * self.pass.tolerance {
                    pieces = (2 * pieces).min(MOST_PIECES);
                    let Some(finer) = by_pieces(pieces) else { break };
                    let settled = (finer - found).abs() < AGREE * finer.max(self.pass.tolerance);
                    found = finer;
                    if settled {
                        break;
                    }
                }
                found
            },
        );
        all.collect()
    }
}

/// Light above the air: the rates of all channels, in V where there is none.
fn above(counts: &Counts) -> Vec<f64> {
    if counts.channels.is_empty() {
        let v = 10_f64.powf(-0.4 * counts.magnitudes[2]);
        return vec![if v.is_finite() { v } else { 0.0 }];
    }
    counts.channels.iter().map(|c| c.above_air_hz).collect()
}

/// Pieces that an exposure needs for how far the body turns between its points; not a whole number.
fn pieces(places: [&Place; 3]) -> f64 {
    let half = |place: &Place| (place.sun_body + place.observer_body).normalize_or(DVec3::X);
    let [first, middle, last] = places.map(half);
    let turn = first.angle_between(middle) + middle.angle_between(last);
    turn.to_degrees() / NODE / TURN_DEG
}
