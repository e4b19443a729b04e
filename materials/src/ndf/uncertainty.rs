//! Uncertainty of D by that of the readings: the same calculation again with readings drawn anew.

use super::nodes::Hemisphere;
use super::power::{Solution, solve};
use super::profile::Traced;
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

/// Adds standard deviations to `ndf`, where those of the readings are known; `on_nodes` brings the planes onto the nodes.
pub(super) fn add(
    ndf: &mut Ndf,
    over: &impl Hemisphere,
    planes: &[(Scan, Traced)],
    scale_sigma: f64,
    options: &NdfOptions,
    on_nodes: impl Fn(&[Traced]) -> Vec<f64> + Sync,
) {
    let known = planes.iter().all(|(scan, _)| scan.sigma.iter().all(|s| *s > 0.0));
    if options.resamplings < 2 || !known {
        return;
    }
    let draw = |k: usize| -> Option<Drawn> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(options.seed ^ ((k as u64) << 32));
        let again = |(scan, traced): &(Scan, Traced)| {
            traced.again(&drawn(scan, &mut random), &ndf.theta_rad, options)
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
    ndf.f0_sigma = Some(by_readings.hypot(scale_sigma * ndf.f0));
    let node = |k: usize| spread(ndf.density[k], &|d| d.density[k]);
    ndf.density_sigma = Some((0..ndf.density.len()).map(node).collect());
    for (p, profile) in ndf.profiles.iter_mut().enumerate() {
        let with = |fit: &mut ShapeFit, which: usize| {
            fit.sigma = Some(spread(fit.alpha, &|d| d.alphas[p][which]));
        };
        with(&mut profile.beckmann, 0);
        with(&mut profile.ggx, 1);
        profile.zero.sigma_deg = spread(profile.zero.angle_deg, &|d| d.zeros[p]);
    }
}

/// The scan with readings drawn from their distributions: in ln f, so that they stay above 0.
fn drawn(scan: &Scan, random: &mut Xoshiro256PlusPlus) -> Scan {
    let mut normal = || {
        // Box and Muller 1958; 1 − u is never 0.
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
    };
    let f = scan.f.iter().zip(&scan.sigma).map(|(f, s)| f * (normal() * s / f).exp()).collect();
    Scan { f, ..scan.clone() }
}
