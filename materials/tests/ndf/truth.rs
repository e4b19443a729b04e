//! Lobes in closed form (Walter et al. 2007; Heitz 2014), and runs made from them.

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{PI, TAU};
use sunglint_materials::table::{Reading, RetroFlags, RetroTable};

#[derive(Debug, Clone, Copy)]
pub enum Shape {
    Beckmann,
    Ggx,
}

/// A lobe with the roughnesses along both axes and F₀.
#[derive(Debug, Clone, Copy)]
pub struct Truth {
    pub shape: Shape,
    pub alpha: [f64; 2],
    pub f0: f64,
}

impl Truth {
    pub fn isotropic(shape: Shape, alpha: f64, f0: f64) -> Self {
        Self { shape, alpha: [alpha; 2], f0 }
    }

    pub fn density(&self, theta: f64, phi: f64) -> f64 {
        let [x, y] = self.alpha;
        let t = theta.tan().powi(2) * ((phi.cos() / x).powi(2) + (phi.sin() / y).powi(2));
        let falls = match self.shape {
            Shape::Beckmann => (-t).exp(),
            Shape::Ggx => (1.0 + t).powi(-2),
        };
        falls / (PI * x * y * theta.cos().powi(4))
    }

    /// G₁ = 1/(1 + Λ).
    pub fn masking(&self, theta: f64, phi: f64) -> f64 {
        let along =
            ((phi.cos() * self.alpha[0]).powi(2) + (phi.sin() * self.alpha[1]).powi(2)).sqrt();
        let a = 1.0 / (along * theta.tan());
        let lambda = match self.shape {
            Shape::Beckmann => 0.5 * (-libm::erfc(a) + (-a * a).exp() / (a * PI.sqrt())),
            Shape::Ggx => 0.5 * ((1.0 + 1.0 / (a * a)).sqrt() - 1.0),
        };
        1.0 / (1.0 + lambda)
    }

    pub fn f(&self, theta: f64, phi: f64) -> f64 {
        let theta = theta.abs().max(1e-12);
        self.f0 * self.density(theta, phi) * self.masking(theta, phi) / (4.0 * theta.cos().powi(2))
    }

    /// Readings from −10° to 65°, the normal at `zero_deg`.
    pub fn run(&self, step_deg: f64, zero_deg: f64) -> RetroTable {
        let angles: Vec<f64> = (0..)
            .map(|k| -10.0 + step_deg * f64::from(k))
            .take_while(|a| *a <= 65.0 + 1e-9)
            .collect();
        run(&angles, |angle| self.f((angle - zero_deg).to_radians(), 0.0))
    }
}

pub fn run(angles: &[f64], f: impl Fn(f64) -> f64) -> RetroTable {
    let reading = |angle: &f64| Reading {
        angle_deg: *angle,
        azimuth_deg: 0.0,
        f_per_sr: f(*angle),
        sigma_f_per_sr: 0.0,
        flags: RetroFlags::empty(),
    };
    RetroTable { readings: angles.iter().map(reading).collect(), ..RetroTable::default() }
}

/// The run with Gaussian noise, its standard deviation known.
pub fn noisy(run: &RetroTable, relative: f64, seed: u64) -> RetroTable {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut run = run.clone();
    for reading in &mut run.readings {
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        let normal = (-2.0 * u.ln()).sqrt() * (TAU * v).cos();
        reading.sigma_f_per_sr = relative * reading.f_per_sr;
        reading.f_per_sr *= 1.0 + relative * normal;
    }
    run
}

/// The largest relative error of D where it exceeds 1e-3 of its peak, over nodes (k, j).
pub fn density_error(truth: &Truth, theta: &[f64], phi: &[f64], density: &[f64]) -> f64 {
    let peak = truth.density(0.0, 0.0);
    let mut worst = 0.0_f64;
    for (phi, row) in phi.iter().zip(density.chunks_exact(theta.len())) {
        for (theta, found) in theta.iter().zip(row) {
            let expected = truth.density(*theta, *phi);
            if expected > 1e-3 * peak {
                worst = worst.max((found / expected - 1.0).abs());
            }
        }
    }
    worst
}
