//! Torques on a rigid body, each a formula.

use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// The Earth's gravitational constant, m³ s⁻² (IERS Conventions 2010, table 1.1).
pub const EARTH_GM: f64 = 3.986_004_418e14;
/// The magnetic constant, N A⁻².
const MU_0: f64 = 1.256_637_062_12e-6;

/// Torque of the gravity gradient, N m: 3(µ/r³) r̂ × I r̂, with the target's place and its inertia in one frame (Wertz 1978, eq. 17-31).
pub fn gravity_gradient(inertia_kg_m2: DMat3, position_m: DVec3) -> DVec3 {
    let r = position_m.length();
    let up = position_m / r;
    3.0 * EARTH_GM / (r * r * r) * up.cross(inertia_kg_m2 * up)
}

/// Torque on a magnetic moment, N m: m × B.
pub fn dipole(moment_a_m2: DVec3, field_t: DVec3) -> DVec3 {
    moment_a_m2.cross(field_t)
}

/// A body in which a changing field drives currents.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Conductor {
    /// A coefficient tensor, S m⁴, body axes: currents that follow the field at once.
    Tensor(DMat3),
    /// A solid sphere: k = (2π/15) σ R⁵, with the skin effect.
    Sphere {
        /// Radius R, m.
        radius_m: f64,
        /// Conductivity σ, S/m.
        conductivity_s_m: f64,
    },
    /// A thin shell: k = (2π/3) σ R⁴ t, with its own field.
    Shell {
        /// Radius R, m.
        radius_m: f64,
        /// Thickness t, m.
        thickness_m: f64,
        /// Conductivity σ, S/m.
        conductivity_s_m: f64,
    },
}

impl Conductor {
    /// Returns the coefficient k of a slow turn, S m⁴: T = k (ω × B) × B. A tensor's is a third of its trace.
    pub fn slow_s_m4(&self) -> f64 {
        match self {
            Self::Tensor(k) => (k.x_axis.x + k.y_axis.y + k.z_axis.z) / 3.0,
            Self::Sphere { radius_m, conductivity_s_m } => {
                2.0 * PI / 15.0 * conductivity_s_m * radius_m.powi(5)
            }
            Self::Shell { radius_m, thickness_m, conductivity_s_m } => {
                2.0 * PI / 3.0 * conductivity_s_m * radius_m.powi(4) * thickness_m
            }
        }
    }

    /// Returns the share of the slow torque at a rate, 1 for a slow turn: for a sphere |Im α|/((R/δ)²/5) with
    /// α = −(3/2)(1 − 3/x² + (3/x) cot x), x = (1 + i)R/δ, δ = √(2/(µ₀σω)) (Landau and Lifshitz, Electrodynamics, §59); for a thin
    /// shell 1/(1 + (ωτ)²) with τ = µ₀σRt/3.
    pub fn share(&self, rate_rad_s: f64) -> f64 {
        let rate = rate_rad_s.abs();
        match self {
            Self::Tensor(_) => 1.0,
            Self::Sphere { radius_m, conductivity_s_m } => {
                let u = radius_m * (0.5 * MU_0 * conductivity_s_m * rate).sqrt();
                sphere_share(u)
            }
            Self::Shell { radius_m, thickness_m, conductivity_s_m } => {
                let tau = MU_0 * conductivity_s_m * radius_m * thickness_m / 3.0;
                1.0 / (1.0 + (rate * tau).powi(2))
            }
        }
    }

    /// Torque of the currents, N m, body axes: (K (−Ḃ)) × B, with Ḃ the field's change as the body sees it, Ḃ_body = Ḃ_space − ω × B. In a
    /// steady field that is k (ω × B) × B = −k (B²ω − (B·ω) B).
    pub fn torque(&self, omega_rad_s: DVec3, field_t: DVec3, field_rate_t_s: DVec3) -> DVec3 {
        let change = field_rate_t_s - omega_rad_s.cross(field_t);
        let driven = match self {
            Self::Tensor(k) => *k * change,
            _ => self.slow_s_m4() * self.share(omega_rad_s.length()) * change,
        };
        field_t.cross(driven)
    }
}

/// The share of a sphere whose radius is `u` skin depths.
fn sphere_share(u: f64) -> f64 {
    if u < 0.1 {
        // x² = 2iu² in the series of the cotangent: Im α = u²/5 − 4u⁶/525 + …
        return 1.0 - 4.0 / 105.0 * u.powi(4);
    }
    // cot(u + iu) = (sin 2u − i sinh 2u)/(cosh 2u − cos 2u); far within, −i.
    let (re, im) = if u > 20.0 {
        (0.0, -1.0)
    } else {
        let below = (2.0 * u).cosh() - (2.0 * u).cos();
        ((2.0 * u).sin() / below, -(2.0 * u).sinh() / below)
    };
    // 1/x = (1 − i)/(2u), 1/x² = −i/(2u²).
    let imaginary = 1.5 / (u * u) + 1.5 / u * (im - re);
    (1.5 * imaginary).abs() / (0.2 * u * u)
}

/// E-folding time of the spin of a homogeneous conducting sphere or thin shell in a steady field, s: 4ρ/(σ B⊥²), whatever its size, as long as
/// the skin depth is larger. ρ is the density in kg m⁻³, σ the conductivity in S/m, B⊥ the field across the spin in T.
pub fn slow_decay_s(density_kg_m3: f64, conductivity_s_m: f64, across_t: f64) -> f64 {
    4.0 * density_kg_m3 / (conductivity_s_m * across_t * across_t)
}
