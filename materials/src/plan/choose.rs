//! A plan of few measurements: those of its directions that tell most about all of them.
//!
//! A sample's part beside its NDF is taken for a Gaussian process in angles that do not change when light and detector are swapped: of the bisector, along which a lobe's share of the normals counts (so that
//! the choice is as dense as the lobe is narrow), of the difference, and |cosθ_i − cosθ_o|. Each step takes the direction that lowers the mean variance of all directions of the plan most
//! (Seo et al., IJCNN 2000; Krause, Singh and Guestrin, JMLR 9, 235, 2008).

use super::{Cell, Chosen, Plan, PlanError, Step, order};
use crate::assemble::IMAGES;
use crate::ndf::Ndf;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI};
use sunglint_numerics::progress::{Cancelled, Progress};

/// Neighbours that are interpolated between.
pub const LEAST: usize = 24;
/// Directions in which the variance is looked at, at most.
const LOOKS: usize = 600;
/// Most directions that are weighed against one another, and most that are chosen so: a quarter of a gigabyte, and some minutes. Beyond them directions are taken evenly.
const POOL: usize = 16_000;
const CHOSEN: usize = 3_000;
/// Distances over which that departure changes: the bisector's place (0 to 1), the difference's angle over 90°, half of |cosθ_i − cosθ_o|.
const LENGTHS: [f64; 3] = [0.25, 0.2, 0.15];
/// Departure of a sample from its NDF's law, ln f rms, and the noise of a measurement.
const PRIOR: f64 = 0.3;
const NOISE: f64 = 0.01;

type Place = [f64; 4];

/// Directions of a plan in the order in which they are worth measuring.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Numbers of steps of the plan, the most telling first.
    order: Vec<usize>,
    /// Number of steps from which they were chosen.
    of: usize,
}

impl Choice {
    /// Puts at most `most` of a plan's steps in the order in which they are worth measuring; `reached` says of each step whether it can be measured.
    ///
    /// # Errors
    /// The work was ended.
    pub fn new(
        plan: &Plan,
        ndf: &Ndf,
        reached: &[bool],
        most: usize,
        progress: &dyn Progress,
    ) -> Result<Self, Cancelled> {
        let is_reached = |k: &usize| reached.get(*k).copied().unwrap_or(false);
        let pool: Vec<usize> = (0..plan.steps.len()).filter(is_reached).collect();
        let normals = Normals::new(ndf, plan.options.wide);
        let isotropic = ndf.is_isotropic();
        let places: Vec<Place> = pool
            .iter()
            .map(|k| normals.place(isotropic, plan.directions(&plan.steps[*k])))
            .collect();
        let mut cells = vec![0.0_f32; plan.steps.len()];
        plan.cells.iter().filter_map(|c| c.step).for_each(|step| cells[step] += 1.0);
        let images: &[Place] = match (isotropic, plan.options.quarter) {
            (true, _) => &IMAGES[..1],
            (false, false) => &IMAGES[..4],
            (false, true) => &IMAGES,
        };
        let stride = pool.len().div_ceil(LOOKS).max(1);
        let looks: Vec<(Place, f32)> =
            (0..pool.len()).step_by(stride).map(|k| (places[k], cells[pool[k]])).collect();
        let weighed: Vec<usize> = if pool.len() > POOL {
            evenly(pool.len()).take(POOL).collect()
        } else {
            (0..pool.len()).collect()
        };
        let their: Vec<Place> = weighed.iter().map(|k| places[*k]).collect();
        let chosen = chosen(&their, &looks, images, most.min(CHOSEN), progress)?;
        let mut order: Vec<usize> = chosen.into_iter().map(|k| weighed[k]).collect();
        let mut is_free = vec![true; pool.len()];
        order.iter().for_each(|k| is_free[*k] = false);
        let more = most.saturating_sub(order.len());
        order.extend(evenly(pool.len()).filter(|k| is_free[*k]).take(more));
        let order = order.into_iter().map(|k| pool[k]).collect();
        Ok(Self { order, of: pool.len() })
    }

    /// The number of directions from which they were chosen.
    #[must_use]
    pub fn of(&self) -> usize {
        self.of
    }

    /// The number of directions that are in order.
    #[must_use]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// True where no direction is.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// The plan of the `count` that tell most; `plan` is that which the choice was made from. Cells that are not measured are left out.
    ///
    /// # Errors
    /// Fewer than [`LEAST`], or more than there are.
    pub fn plan(&self, plan: &Plan, count: usize) -> Result<Plan, PlanError> {
        if count < LEAST {
            return Err(PlanError::TooFew { asked: count });
        }
        if count > self.order.len() {
            return Err(PlanError::TooMany { asked: count, directions: self.of });
        }
        let mut is_in = vec![false; plan.steps.len()];
        self.order[..count].iter().for_each(|k| is_in[*k] = true);
        let mut place = vec![None; plan.steps.len()];
        let mut steps: Vec<Step> = Vec::with_capacity(count);
        let (mut travel_deg, mut unordered_travel_deg) = (0.0, 0.0);
        let mut stands = DVec3::Z;
        let all: Vec<usize> = (0..plan.steps.len()).filter(|k| is_in[*k]).collect();
        for group in all.chunk_by(|a, b| plan.steps[*a].incident == plan.steps[*b].incident) {
            let found: Vec<Step> = group.iter().map(|k| plan.steps[*k]).collect();
            let directions: Vec<DVec3> = found.iter().map(|s| s.outgoing).collect();
            unordered_travel_deg += order::travel_deg(&directions);
            let order = match &plan.options.rig {
                Some(rig) => rig.order(&found, stands),
                None => order::shortest(&directions, stands),
            };
            for k in &order {
                place[group[*k]] = Some(steps.len());
                steps.push(found[*k]);
            }
            let ordered: Vec<DVec3> = order.iter().map(|k| directions[*k]).collect();
            travel_deg += order::travel_deg(&ordered);
            stands = ordered.last().copied().unwrap_or(stands);
        }
        let kept = |cell: &Cell| {
            let step = place[cell.step?]?;
            Some(Cell { step: Some(step), ..cell.clone() })
        };
        Ok(Plan {
            theta_i_rad: plan.theta_i_rad.clone(),
            phi_i_rad: plan.phi_i_rad.clone(),
            options: plan.options.clone(),
            cells: plan.cells.iter().filter_map(kept).collect(),
            steps,
            chosen: Some(Chosen { of: self.of, times: None }),
            travel_deg,
            unordered_travel_deg,
        })
    }
}

/// The numbers below `count` in an order of which each beginning lies evenly among them: by the golden ratio.
fn evenly(count: usize) -> impl Iterator<Item = usize> {
    let mut all: Vec<usize> = (0..count).collect();
    all.sort_by_cached_key(|k| (*k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    all.into_iter()
}

/// Shares of the normals by tilt, for each azimuth of an NDF.
struct Normals<'a> {
    ndf: &'a Ndf,
    /// ∫ D cosθ sinθ dθ up to each node over the whole, by azimuth and elevation.
    share: Vec<f64>,
    wide: f64,
}

impl<'a> Normals<'a> {
    fn new(ndf: &'a Ndf, wide: f64) -> Self {
        let n = ndf.theta_rad.len();
        let mut share = Vec::with_capacity(ndf.density.len());
        for row in ndf.density.chunks(n) {
            let at = |k: usize| row[k] * ndf.theta_rad[k].sin() * ndf.theta_rad[k].cos();
            // Up to the first node D is what it is there.
            let mut sum = 0.5 * ndf.theta_rad[0].sin().powi(2) * row[0];
            let mut sums = vec![sum];
            for k in 1..n {
                sum += 0.5 * (at(k - 1) + at(k)) * (ndf.theta_rad[k] - ndf.theta_rad[k - 1]);
                sums.push(sum);
            }
            share.extend(sums.iter().map(|s| s / sum.max(f64::MIN_POSITIVE)));
        }
        Self { ndf, share, wide }
    }

    /// Place of a normal along its tilt, 0 to 1: for a lobe of GGX atan(tanθ/α) over 90°, where all are the lobe's.
    fn along(&self, tilt: f64, phi: f64) -> f64 {
        let (n, np) = (self.ndf.theta_rad.len(), self.ndf.phi_rad.len().max(1));
        let row = ((phi.rem_euclid(PI) / PI * np as f64).round() as usize) % np;
        let j = self.ndf.theta_rad.partition_point(|t| *t <= tilt).clamp(1, n - 1) - 1;
        let (from, to) = (self.ndf.theta_rad[j], self.ndf.theta_rad[j + 1]);
        let t = ((tilt - from) / (to - from)).clamp(0.0, 1.0);
        let share = (1.0 - t) * self.share[row * n + j] + t * self.share[row * n + j + 1];
        let share = (1.0 - self.wide) * share + self.wide * tilt.sin().powi(2);
        FRAC_2_PI * share.clamp(0.0, 1.0).sqrt().asin()
    }

    /// Coordinates in which distances are those of the process: 1 is its length.
    fn place(&self, isotropic: bool, (i, o): (DVec3, DVec3)) -> Place {
        let h = (i + o).normalize();
        let tilt = 2.0 * (0.5 * (h - DVec3::Z).length()).min(1.0).asin();
        let along = self.along(tilt, h.y.atan2(h.x)) / LENGTHS[0];
        let d = 0.5 * (i - o);
        let half = d.length().min(1.0).asin() / FRAC_PI_2 / LENGTHS[1];
        if isotropic {
            return [along, half, 0.5 * (i.z - o.z).abs() / LENGTHS[2], 0.0];
        }
        let across = h.x.hypot(h.y).max(1e-12);
        let scale = half / d.length().max(1e-12);
        [along * h.x / across, along * h.y / across, scale * d.x, scale * d.y]
    }
}

/// Covariance of two places: the mean over the images of one.
fn covariance(a: &Place, b: &Place, images: &[Place]) -> f64 {
    let one = |signs: &Place| {
        let squares: f64 = (0..4).map(|k| (a[k] - signs[k] * b[k]).powi(2)).sum();
        (-0.5 * squares).exp()
    };
    PRIOR * PRIOR * images.iter().map(one).sum::<f64>() / images.len() as f64
}

/// Places in the order in which each lowers the mean variance at the weighted `looks` most.
fn chosen(
    places: &[Place],
    looks: &[(Place, f32)],
    images: &[Place],
    most: usize,
    progress: &dyn Progress,
) -> Result<Vec<usize>, Cancelled> {
    struct Candidate {
        /// Covariance with the looks, given what was chosen.
        with: Vec<f32>,
        variance: f64,
        /// Parts of the chosen ones, as a Cholesky factor has them.
        parts: Vec<f32>,
        gain: f64,
        is_free: bool,
    }
    let gain = |with: &[f32], variance: f64| {
        let sum: f32 = with.iter().zip(looks).map(|(c, look)| look.1 * c * c).sum();
        f64::from(sum) / (variance.max(0.0) + NOISE * NOISE)
    };
    let most = most.min(places.len());
    let mut all: Vec<Candidate> = places
        .par_iter()
        .map(|place| {
            let with: Vec<f32> =
                looks.iter().map(|look| covariance(place, &look.0, images) as f32).collect();
            let variance = covariance(place, place, images);
            let gain = gain(&with, variance);
            Candidate { with, variance, parts: Vec::with_capacity(most), gain, is_free: true }
        })
        .collect();
    progress.begin("directions", Some(most as u64));
    let mut order = Vec::with_capacity(most);
    while order.len() < most {
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
        let free = all.iter().enumerate().filter(|(_, c)| c.is_free);
        let Some((best, _)) = free.max_by(|a, b| a.1.gain.total_cmp(&b.1.gain)) else { break };
        all[best].is_free = false;
        let one = &all[best];
        let scale = (one.variance.max(0.0) + NOISE * NOISE).sqrt();
        let (with, parts) = (one.with.clone(), one.parts.clone());
        let at = places[best];
        all.par_iter_mut().zip(places).filter(|(c, _)| c.is_free).for_each(|(c, place)| {
            let known: f32 = c.parts.iter().zip(&parts).map(|(a, b)| a * b).sum();
            let part = (covariance(place, &at, images) - f64::from(known)) / scale;
            let step = (part / scale) as f32;
            c.with.iter_mut().zip(&with).for_each(|(c, w)| *c -= step * w);
            c.variance -= part * part;
            c.parts.push(part as f32);
            c.gain = gain(&c.with, c.variance);
        });
        order.push(best);
        progress.advance(1);
    }
    Ok(order)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use sunglint_numerics::progress::Silent;

    /// Truth: the three-gap theorem (Steinhaus; Sós 1958): of the first m numbers of an order by a multiple of an irrational number the largest gap is below 3 n/m for the golden ratio.
    #[test]
    fn each_beginning_lies_evenly() {
        for count in [7, 1_000, 20_011] {
            let all: Vec<usize> = evenly(count).collect();
            for taken in [count / 7, count / 3, count].map(|m| m.max(1)) {
                let mut some = all[..taken].to_vec();
                some.sort_unstable();
                some.dedup();
                assert_eq!(some.len(), taken);
                let largest = some.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0);
                assert!(largest as f64 <= 3.0 * count as f64 / taken as f64, "{count} {taken}");
            }
        }
    }

    /// Truth: the mean variance after each possible next choice by the whole matrix (Rasmussen and Williams 2006, eq. 2.26), of 40 places, with the symmetries of an isotropic and of an anisotropic sample. The one that
    /// is chosen leaves no more than the best of all by 1e-3 of it: single precision.
    #[test]
    fn each_choice_is_the_best_of_all() {
        let place = |k: usize| -> Place {
            let at = |p: f64| 3.0 * ((k as f64 + 0.5) * p).fract();
            [at(0.755), at(0.570), at(0.431), 0.0]
        };
        let places: Vec<Place> = (0..40).map(place).collect();
        let looks: Vec<(Place, f32)> = (0..40).map(|k| (places[k], 1.0 + (k % 3) as f32)).collect();
        for images in [&IMAGES[..1], &IMAGES[..4]] {
            let order = chosen(&places, &looks, images, 8, &Silent).expect("nobody ends it");
            let left = |taken: &[usize]| -> f64 {
                let k = |a: usize, b: usize| covariance(&places[a], &places[b], images);
                let n = taken.len();
                let noise = |a: usize, b: usize| if a == b { NOISE * NOISE } else { 0.0 };
                let matrix = DMatrix::from_fn(n, n, |a, b| k(taken[a], taken[b]) + noise(a, b));
                let inverse = matrix.try_inverse().expect("it has noise");
                let one = |at: usize| {
                    let with = DMatrix::from_fn(n, 1, |a, _| k(taken[a], at));
                    k(at, at) - (with.transpose() * &inverse * &with)[(0, 0)]
                };
                (0..40).map(|at| f64::from(looks[at].1) * one(at)).sum()
            };
            for n in 1..=order.len() {
                let before = &order[..n - 1];
                let others = (0..40).filter(|k| !before.contains(k));
                let best =
                    others.map(|k| left(&[before, &[k]].concat())).fold(f64::INFINITY, f64::min);
                let found = left(&order[..n]);
                assert!(found <= best * (1.0 + 1e-3), "{n}: {found} {best}");
            }
        }
    }
}
