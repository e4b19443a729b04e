//! The nodes over the hemisphere, and the projected area of microfacets on them.
//!
//! σ(ω) = ∫ D(m) max(0, ω·m) dω_m. Elevations are Gauss–Legendre nodes in u over 0…1, θ = (π/2) u²: many near the normal, where narrow lobes
//! are, none at the normal nor at the horizon.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_numerics::gauss::legendre;

/// Gauss–Legendre elevations.
#[derive(Debug, Clone, PartialEq)]
pub struct Elevations {
    /// Angles from the normal, radians, increasing.
    pub theta_rad: Vec<f64>,
    /// Weights of ∫ g(θ) sinθ dθ over 0…π/2: the Jacobian sinθ π u is in them.
    pub weight: Vec<f64>,
}

impl Elevations {
    /// `n` elevations.
    pub fn new(n: usize) -> Self {
        let (mut theta_rad, mut weight) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (x, w) in legendre(n) {
            let u = 0.5 * (1.0 + x);
            let theta = FRAC_PI_2 * u * u;
            theta_rad.push(theta);
            weight.push(0.5 * w * theta.sin() * PI * u);
        }
        Self { theta_rad, weight }
    }
}

/// Nodes over the hemisphere with the map from a density to its projected area.
pub trait Hemisphere: Sync {
    /// Cosines of the nodes' elevations.
    fn cosines(&self) -> &[f64];
    /// Weights of ∫ g dω over the hemisphere.
    fn weights(&self) -> &[f64];
    /// σ of a density D, both on the nodes.
    fn area(&self, density: &[f64], sigma: &mut [f64]);

    /// ∫ D cosθ dω, which is 1 for a density of microfacets.
    fn projected(&self, density: &[f64]) -> f64 {
        let nodes = density.iter().zip(self.weights()).zip(self.cosines());
        nodes.map(|((d, w), c)| d * w * c).sum()
    }
}

/// ∫ max(0, a + b cosφ) dφ over the circle, a and b not negative: closed.
fn around(a: f64, b: f64) -> f64 {
    if a >= b {
        return TAU * a;
    }
    let edge = (-a / b).acos();
    2.0 * (a * edge + b * edge.sin())
}

/// A sample that is the same in every azimuth.
#[derive(Debug, Clone)]
pub struct Isotropic {
    /// The elevations.
    pub elevations: Elevations,
    cosines: Vec<f64>,
    weights: Vec<f64>,
    /// Row by row: the azimuth's integral of the cosine between two nodes, times the weight of the second.
    kernel: Vec<f64>,
}

impl Isotropic {
    /// `n` elevations; 128 leave 4e-6 for Beckmann and GGX.
    pub fn new(n: usize) -> Self {
        let elevations = Elevations::new(n);
        let angles: Vec<(f64, f64)> = elevations.theta_rad.iter().map(|t| t.sin_cos()).collect();
        let mut kernel = vec![0.0; n * n];
        for (j, (sin_j, cos_j)) in angles.iter().enumerate() {
            for (k, (sin_k, cos_k)) in angles.iter().enumerate().take(j + 1) {
                let integral = around(cos_j * cos_k, sin_j * sin_k);
                kernel[j * n + k] = integral * elevations.weight[k];
                kernel[k * n + j] = integral * elevations.weight[j];
            }
        }
        let cosines = angles.iter().map(|(_, cos)| *cos).collect();
        let weights = elevations.weight.iter().map(|w| TAU * w).collect();
        Self { elevations, cosines, weights, kernel }
    }
}

impl Hemisphere for Isotropic {
    fn cosines(&self) -> &[f64] {
        &self.cosines
    }

    fn weights(&self) -> &[f64] {
        &self.weights
    }

    fn area(&self, density: &[f64], sigma: &mut [f64]) {
        for (row, sigma) in self.kernel.chunks_exact(density.len()).zip(sigma) {
            *sigma = dot(row, density);
        }
    }
}

/// A sample that differs by azimuth, the same on both sides of its normal: D(θ, φ) = D(θ, φ + 180°).
#[derive(Debug, Clone)]
pub struct Anisotropic {
    /// The elevations.
    pub elevations: Elevations,
    /// The azimuths over half the circle, radians: 0, π/n, …
    pub phi_rad: Vec<f64>,
    cosines: Vec<f64>,
    weights: Vec<f64>,
    /// By difference of azimuths, elevation, elevation: the cosine to a node and to the one opposite, times the weight of the second.
    kernel: Vec<f64>,
}

impl Anisotropic {
    /// `n_theta` elevations by `n_phi` azimuths over the whole circle (an even number): n_phi ≥ 12 α_max/α_min.
    ///
    /// The nodes lie azimuth by azimuth: node (k, j) is `k * n_theta + j`, of the `n_phi / 2` azimuths of half the circle.
    pub fn new(n_theta: usize, n_phi: usize) -> Self {
        let half = (n_phi / 2).max(1);
        let elevations = Elevations::new(n_theta);
        let step = PI / half as f64;
        let angles: Vec<(f64, f64)> = elevations.theta_rad.iter().map(|t| t.sin_cos()).collect();
        let mut kernel = Vec::with_capacity(half * n_theta * n_theta);
        for difference in 0..half {
            let turned = (difference as f64 * step).cos();
            for (sin_j, cos_j) in &angles {
                for ((sin_k, cos_k), weight) in angles.iter().zip(&elevations.weight) {
                    let (a, b) = (cos_j * cos_k, sin_j * sin_k * turned);
                    kernel.push(((a + b).max(0.0) + (a - b).max(0.0)) * weight * step);
                }
            }
        }
        let repeated = |values: Vec<f64>| values.repeat(half);
        let cosines = repeated(angles.iter().map(|(_, cos)| *cos).collect());
        let weights = repeated(elevations.weight.iter().map(|w| 2.0 * step * w).collect());
        let phi_rad = (0..half).map(|k| k as f64 * step).collect();
        Self { elevations, phi_rad, cosines, weights, kernel }
    }
}

impl Hemisphere for Anisotropic {
    fn cosines(&self) -> &[f64] {
        &self.cosines
    }

    fn weights(&self) -> &[f64] {
        &self.weights
    }

    fn area(&self, density: &[f64], sigma: &mut [f64]) {
        let (n, half) = (self.elevations.theta_rad.len(), self.phi_rad.len());
        for (to, sigma) in sigma.chunks_exact_mut(n).enumerate() {
            sigma.fill(0.0);
            for (from, density) in density.chunks_exact(n).enumerate() {
                let kernel = &self.kernel[(to + half - from) % half * n * n..][..n * n];
                for (row, sigma) in kernel.chunks_exact(n).zip(sigma.iter_mut()) {
                    *sigma += dot(row, density);
                }
            }
        }
    }
}

/// The sum of products, in four running sums: the compiler may then use wide registers.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (mut sums, wide) = ([0.0; 4], a.len().min(b.len()) / 4 * 4);
    for (a, b) in a[..wide].chunks_exact(4).zip(b[..wide].chunks_exact(4)) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f64 = a[wide..].iter().zip(&b[wide..]).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
