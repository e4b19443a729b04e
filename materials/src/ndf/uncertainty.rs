//! Uncertainty of D by that of the readings: the same calculation again with readings drawn anew.

use super::laser::Laser;
use super::nodes::Hemisphere;
use super::power::{Solution, solve};
use super::profile::{Stated, Traced};
use super::scan::Scan;
use super::{Ndf, NdfOptions, ShapeFit};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// The largest differences from a solution.
pub(super) struct Bound {
    pub density: Vec<f64>,
    pub f0: f64,
}

impl Bound {
    pub fn new(nodes: usize) -> Self {
        Self { density: vec![0.0; nodes], f0: 0.0 }
    }

    pub fn add(&mut self, found: &Solution, other: &Solution) {
        self.f0 = self.f0.max((found.f0 - other.f0).abs());
        let both = found.density.iter().zip(&other.density);
        for (bound, (a, b)) in self.density.iter_mut().zip(both) {
            *bound = bound.max((a - b).abs());
        }
    }
}

/// One resampling.
struct Drawn {
    f0: f64,
    density: Vec<f64>,
    /// Beckmann's and GGX's roughness by plane.
    alphas: Vec<[f64; 2]>,
    zeros: Vec<f64>,
}

/// Facts that the readings of a run have in common.
pub(super) struct Common {
    pub stated: Stated,
    /// The laser over the run, of which neighbouring angles share the errors.
    pub laser: Option<Laser>,
    /// Relative standard deviation of all values.
    pub scale_sigma: f64,
    /// Relative standard deviation of the cone's solid angle.
    pub cone_sigma: f64,
}

/// Adds standard deviations to `ndf`, where those of the readings are known; `on_nodes` brings the planes onto the nodes.
pub(super) fn add(
    ndf: &mut Ndf,
    over: &impl Hemisphere,
    planes: &[(Scan, Traced)],
    (common, options): (&Common, &NdfOptions),
    on_nodes: impl Fn(&[Traced]) -> Vec<f64> + Sync,
) {
    let known = planes.iter().all(|(scan, _)| scan.sigma.iter().all(|s| *s > 0.0));
    if options.resamplings < 2 || !known {
        return;
    }
    let draw = |k: usize| -> Option<Drawn> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(options.seed ^ ((k as u64) << 32));
        let again = |(scan, traced): &(Scan, Traced)| {
            let (drawn, turned) = drawn(scan, common.laser.as_ref(), &mut random);
            traced.again(&drawn, &ndf.theta_rad, (options, &common.stated), turned)
        };
        let traced: Vec<Traced> = planes.iter().map(again).collect::<Option<_>>()?;
        let found = solve(over, &on_nodes(&traced)).ok()?;
        let alphas = |t: &Traced| [t.profile.beckmann.alpha, t.profile.ggx.alpha];
        Some(Drawn {
            f0: found.f0,
            density: found.density,
            alphas: traced.iter().map(alphas).collect(),
            zeros: traced.iter().map(|t| t.profile.zero.angle_deg).collect(),
        })
    };
    let all: Vec<Drawn> = (0..options.resamplings).into_par_iter().filter_map(draw).collect();
    if all.len() < 2 {
        return;
    }
    ndf.resamplings = all.len();
    // About what was found, not about the mean: a bias of the method is part of its uncertainty.
    let spread = |found: f64, of: &dyn Fn(&Drawn) -> f64| {
        let squares: f64 = all.iter().map(|d| (of(d) - found).powi(2)).sum();
        (squares / all.len() as f64).sqrt()
    };
    let by_readings = spread(ndf.f0, &|d| d.f0);
    ndf.f0_sigma = Some(by_readings.hypot(common.scale_sigma * ndf.f0));
    let node = |k: usize| spread(ndf.density[k], &|d| d.density[k]);
    ndf.density_sigma = Some((0..ndf.density.len()).map(node).collect());
    for (p, profile) in ndf.profiles.iter_mut().enumerate() {
        let with = |fit: &mut ShapeFit, which: usize| {
            let by_readings = spread(fit.alpha, &|d| d.alphas[p][which]);
            // What the cone adds to α goes with its solid angle.
            let by_cone = fit.seen_alpha.map_or(0.0, |seen| common.cone_sigma * (seen - fit.alpha));
            fit.sigma = Some(by_readings.hypot(by_cone));
        };
        with(&mut profile.beckmann, 0);
        with(&mut profile.ggx, 1);
        profile.zero.sigma_deg = spread(profile.zero.angle_deg, &|d| d.zeros[p]);
    }
}

/// The scan with readings drawn from their distributions: in ln f, so that they stay above 0; what the laser leaves to them is drawn for all together. And a normal number besides.
fn drawn(scan: &Scan, laser: Option<&Laser>, random: &mut Xoshiro256PlusPlus) -> (Scan, f64) {
    let mut normal = || {
        // Box and Muller 1958; 1 − u is never 0.
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
    };
    let own = |(place, sigma): (&usize, &f64)| {
        let shared = laser.map_or(0.0, |laser| laser.sigma_per_sr(*place));
        (sigma * sigma - shared * shared).max(0.0).sqrt()
    };
    let own: Vec<f64> = scan.place.iter().zip(&scan.sigma).map(own).collect();
    let mut f: Vec<f64> =
        scan.f.iter().zip(&own).map(|(f, s)| f * (normal() * s / f).exp()).collect();
    if let Some(laser) = laser {
        let shared = laser.drawn(&scan.place, &mut normal);
        f.iter_mut().zip(shared).for_each(|(f, error)| *f *= error.exp());
    }
    let other = normal();
    (Scan { f, ..scan.clone() }, other)
}
