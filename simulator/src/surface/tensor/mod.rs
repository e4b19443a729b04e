//! Evaluating the tensors of Dupuy and Jakob's adaptive parameterisation (ACM TOG 37, 274, 2018), in double precision.
//!
//! f_r cosθ_o = spectra(s | φ_i, θ_i, λ) · ndf(u_m)/(4 sigma(u_i)), s = vndf⁻¹(u_m | φ_i, θ_i), with m the bisector, u(θ) = √(2θ/π),
//! u(φ) = (φ+π)/2π, φ_m counted from φ_i of an isotropic material. The map from u_m to s is taken once a geometry; all wavelengths share s. The
//! values lie in memory by wavelength last, so that a geometry costs sixteen short sums over them.

pub mod warp;

use super::scatter::{Effort, Scatter};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;
use warp::{Blend, Grid, Place, Warp};

/// Where the elevations of a file end this close to the horizon, they reach it.
const TO_HORIZON_RAD: f64 = 3e-3;

/// A measured material's tensors.
#[derive(Debug)]
pub struct Tensor {
    pub theta_i: Vec<f64>,
    pub phi_i: Vec<f64>,
    /// 1, 2 or 4 parts of the circle that are alike; 0 where it is isotropic.
    pub folds: usize,
    pub wavelengths: usize,
    pub ndf: Grid,
    pub sigma: Grid,
    pub vndf: Warp,
    pub luminance: Warp,
    /// Side of the grid in s.
    pub side: usize,
    /// Slice, row, column, wavelength.
    pub spectra: Vec<f32>,
    pub jacobian: bool,
    pub width_rad: f64,
}

impl Tensor {
    fn is_isotropic(&self) -> bool {
        self.folds == 0
    }

    /// Slices around an incident direction.
    fn blend(&self, theta: f64, phi: f64) -> Blend {
        let (j, t) = interval(&self.theta_i, theta);
        let (k, p) = interval(&self.phi_i, phi);
        let nt = self.theta_i.len();
        // An axis of a single node has no neighbour.
        let (j1, k1) = ((j + 1).min(nt - 1), (k + 1).min(self.phi_i.len() - 1));
        [
            (k * nt + j, (1.0 - p) * (1.0 - t)),
            (k * nt + j1, (1.0 - p) * t),
            (k1 * nt + j, p * (1.0 - t)),
            (k1 * nt + j1, p * t),
        ]
    }

    /// Incident and outgoing direction within the part of the circle that is in the file.
    fn folded(&self, i: DVec3, v: DVec3) -> DVec3 {
        let sign = |x: f64| if x.is_sign_negative() { 1.0 } else { -1.0 };
        let (x, y) = match self.folds {
            2 => (sign(i.y), sign(i.y)),
            4 => (sign(i.x), sign(i.y)),
            _ => (1.0, 1.0),
        };
        DVec3::new(v.x * x, v.y * y, v.z)
    }

    fn bisector(&self, phi_i: f64, m: DVec3) -> DVec2 {
        let phi = if self.is_isotropic() { azimuth(m) - phi_i } else { azimuth(m) };
        let turn = (phi + PI) / TAU;
        DVec2::new((elevation(m) * 2.0 / PI).sqrt(), turn - turn.floor())
    }

    /// Returns the factor on the values in s: ndf/(4 sigma).
    pub(crate) fn jacobian(&self, u_m: DVec2, u_i: impl Into<DVec2>) -> f64 {
        if self.jacobian { self.ndf.at(u_m) / (4.0 * self.sigma.at(u_i)) } else { 1.0 }
    }

    pub(crate) fn sample(&self, i: DVec3, s: DVec2) -> Option<DVec3> {
        let local = self.folded(i, i);
        let (theta, phi) = (elevation(local), azimuth(local));
        let blend = self.blend(theta, phi);
        let (s, _) = self.luminance.sample(s, &blend);
        let (u, _) = self.vndf.sample(s, &blend);
        let m = self.direction(phi, u);
        // Folding is its own inverse.
        super::sampling::reflected(local, m).map(|o| self.folded(i, o))
    }

    /// The bisector of a point u.
    pub(crate) fn direction(&self, phi_i: f64, u: DVec2) -> DVec3 {
        let theta = u[0] * u[0] * FRAC_PI_2;
        let phi = TAU * u[1] - PI + if self.is_isotropic() { phi_i } else { 0.0 };
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    /// Light, outgoing direction and values \[sr⁻¹\] at the nodes of the grid in s, slice by slice; those whose bisector mirrors the light below the horizon are left out.
    pub fn nodes(&self) -> impl Iterator<Item = (DVec3, DVec3, Vec<f64>)> + '_ {
        let (nt, n) = (self.theta_i.len(), self.side);
        let slices = nt * self.phi_i.len();
        (0..slices * n * n).filter_map(move |at| {
            let (slice, node) = (at / (n * n), at % (n * n));
            let (phi, theta) = (self.phi_i[slice / nt], self.theta_i[slice % nt]);
            let i = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let last = (n - 1) as f64;
            let s = [(node % n) as f64 / last, (node / n) as f64 / last];
            let (u, _) = self.vndf.sample(s, &[(slice, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]);
            let m = self.direction(phi, u);
            let o = (2.0 * i.dot(m) * m - i).normalize();
            if o.z <= 0.0 || i.dot(m) <= 0.0 {
                return None;
            }
            let u_i = [(theta * 2.0 / PI).sqrt(), (phi + PI) / TAU];
            let scale = self.jacobian(u, u_i) / o.z;
            let from = at * self.wavelengths;
            let values = &self.spectra[from..from + self.wavelengths];
            Some((i, o, values.iter().map(|v| scale * f64::from(*v)).collect()))
        })
    }

    pub fn sampling_density(&self, i: DVec3, o: DVec3) -> f64 {
        let (i, o) = (self.folded(i, i), self.folded(i, o));
        let (theta, phi) = (elevation(i), azimuth(i));
        let m = (i + o).normalize();
        let blend = self.blend(theta, phi);
        let u = self.bisector(phi, m);
        let (s, seen) = self.vndf.invert(u, &blend);
        let (_, bright) = self.luminance.invert(s, &blend);
        // dω_m = sinθ dθ dφ = 2π² u_θ sinθ du, dω_o = 4 i·m dω_m.
        let area = 2.0 * PI * PI * u[0] * (m.x * m.x + m.y * m.y).sqrt();
        let area = if area > 0.0 { area } else { f64::MIN_POSITIVE };
        seen * bright / area / (4.0 * i.dot(m)).max(f64::MIN_POSITIVE)
    }
}

impl Scatter for Arc<Tensor> {
    fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        let (i, o) = (self.folded(i, i), self.folded(i, o));
        let m = (i + o).normalize();
        let (theta, phi) = (elevation(i), azimuth(i));
        let blend = self.blend(theta, phi);
        let u_m = self.bisector(phi, m);
        let u_i = [(theta * 2.0 / PI).sqrt(), (phi + PI) / TAU];
        let (s, _) = self.vndf.invert(u_m, &blend);
        let scale = scale * self.jacobian(u_m, u_i) / o.z;
        let n = self.side;
        let along = |s: f64| {
            let x = s * (n - 1) as f64;
            let node = (x as usize).min(n - 2);
            (node, x - node as f64)
        };
        let ((column, x), (row, y)) = (along(s[0]), along(s[1]));
        let place = Place { row, column, x, y };
        let sum = &mut sum[..self.wavelengths];
        for (slice, weight) in blend {
            for (r, c, share) in place.corners() {
                let factor = scale * weight * share;
                if factor != 0.0 {
                    let from = ((slice * n + r) * n + c) * self.wavelengths;
                    let values = &self.spectra[from..from + self.wavelengths];
                    sum.iter_mut().zip(values).for_each(|(s, v)| *s += factor * f64::from(*v));
                }
            }
        }
    }

    fn is_isotropic(&self) -> bool {
        self.folds == 0
    }

    fn describe(&self) -> String {
        let kind = match self.folds {
            0 => "isotropic".to_owned(),
            1 => "anisotropic".to_owned(),
            folds => format!("anisotropic, {folds} parts of the circle alike"),
        };
        let last = self.theta_i[self.theta_i.len() - 1].to_degrees();
        format!(
            "measured ({kind}), {} wavelengths, {} elevations to {last:.1}°",
            self.wavelengths,
            self.theta_i.len()
        )
    }

    fn lobe_width_rad(&self) -> f64 {
        self.width_rad
    }

    fn effort(&self) -> Effort {
        // Pieces that are linear or bilinear have kinks everywhere.
        Effort { tolerance: 1e-3, most: 12_000 }
    }

    fn has_gaps(&self) -> bool {
        let last = self.theta_i[self.theta_i.len() - 1];
        self.theta_i[0] > TO_HORIZON_RAD || last < FRAC_PI_2 - TO_HORIZON_RAD
    }

    fn covers(&self, i: DVec3, _o: DVec3) -> bool {
        let theta = elevation(i);
        let last = self.theta_i[self.theta_i.len() - 1];
        let below = self.theta_i[0] <= TO_HORIZON_RAD || theta >= self.theta_i[0];
        below && (last >= FRAC_PI_2 - TO_HORIZON_RAD || theta <= last)
    }
}

impl Place {
    fn corners(&self) -> [(usize, usize, f64); 4] {
        let Self { row, column, x, y } = *self;
        [
            (row, column, (1.0 - y) * (1.0 - x)),
            (row, column + 1, (1.0 - y) * x),
            (row + 1, column, y * (1.0 - x)),
            (row + 1, column + 1, y * x),
        ]
    }
}

/// The angle from the normal, accurate near it too.
pub fn elevation(d: DVec3) -> f64 {
    2.0 * (0.5 * (d - DVec3::Z).length()).min(1.0).asin()
}

fn azimuth(d: DVec3) -> f64 {
    d.y.atan2(d.x)
}

/// The node before `x` and how far it is on the way to the next; at the ends held.
fn interval(nodes: &[f64], x: f64) -> (usize, f64) {
    if nodes.len() < 2 {
        return (0, 0.0);
    }
    let j = nodes.partition_point(|v| *v <= x).clamp(1, nodes.len() - 1) - 1;
    (j, ((x - nodes[j]) / (nodes[j + 1] - nodes[j])).clamp(0.0, 1.0))
}
