//! The torque-free motion of a rigid body, in closed form at any moment.
//!
//! ω(t) by Jacobi's elliptic functions (Landau and Lifshitz, Mechanics, §37). With ℓ = Iω/L the direction of the angular momentum in
//! the body and c the principal axis about which it circles, the attitude is a turn by φ about L after the shortest rotation that
//! takes ℓ to c, and φ̇ = L/I_c + (2T/L − L/I_c)/(1 + ℓ_c): regular everywhere, where Euler's angles fail for
//! a spin about a principal axis. φ̇ is an even periodic function of time: its mean and a Fourier series that converges
//! geometrically are found once, so that any moment costs the same and nothing drifts.

use super::elliptic::Modulus;
use super::{AttitudeError, MOST_TURNS_PER_S, seconds_between};
use glam::{DMat3, DQuat, DVec3};
use hifitime::Epoch;
use std::f64::consts::{PI, TAU};

/// The least k'² that is told from the separatrix: there a body of the same inertia to rounding may turn over or not.
const LEAST_COMPLEMENT: f64 = 1e-28;
/// The relative size of what a tensor may lack in symmetry, or in the triangle inequality: the rounding of a written file.
const WRITTEN: f64 = 1e-6;
/// Moments of inertia that differ by less than this part of the largest are the same: rounding of the principal axes.
const SAME_MOMENT: f64 = 1e-14;
/// A spin within this angle of a principal axis, radians, is about it: rounding of the principal axes.
const PRINCIPAL: f64 = 3e-8;

/// A rigid body's inertia: principal moments and axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Principal moments, kg m² (only their ratios matter), smallest first.
    moments: DVec3,
    /// Columns: the principal axes in the body's, right-handed.
    axes: DMat3,
}

impl Inertia {
    /// Creates the inertia from a tensor in the body's axes, kg m². Only the tensor's ratios matter for the motion.
    ///
    /// # Errors
    /// A tensor that is not finite, not symmetric (beyond 1e-6 of its trace), not positive, or whose largest principal moment
    /// exceeds the sum of the others, as no distribution of mass does.
    pub fn of_tensor(tensor: DMat3) -> Result<Self, AttitudeError> {
        let t = tensor;
        let trace = t.x_axis.x + t.y_axis.y + t.z_axis.z;
        if !t.is_finite() {
            return Err(AttitudeError::Inertia { why: "it is not finite".into() });
        }
        for (row, column, a, b) in [
            (1, 2, t.y_axis.x, t.x_axis.y),
            (1, 3, t.z_axis.x, t.x_axis.z),
            (2, 3, t.z_axis.y, t.y_axis.z),
        ] {
            if (a - b).abs() > WRITTEN * trace.abs() {
                return Err(AttitudeError::Inertia {
                    why: format!(
                        "it is not symmetric: row {row}, column {column} is {a} and row {column}, column {row} is {b}"
                    ),
                });
            }
        }
        let (moments, axes) = eigen(0.5 * (t + t.transpose()));
        Self::of_sorted(moments, axes)
    }

    /// Creates the inertia from principal moments, kg m², about the axes of the body turned by `principal_to_body`; in any order.
    ///
    /// # Errors
    /// The errors of [`Inertia::of_tensor`].
    pub fn of_principal(moments: DVec3, principal_to_body: DQuat) -> Result<Self, AttitudeError> {
        let axes = DMat3::from_quat(principal_to_body);
        let (moments, axes) = sorted(moments, axes);
        Self::of_sorted(moments, axes)
    }

    fn of_sorted(moments: DVec3, axes: DMat3) -> Result<Self, AttitudeError> {
        let DVec3 { x, y, z } = moments;
        let numbers = format!("its principal moments are {x}, {y} and {z} kg m²");
        // Written so that NaN is refused too.
        if !(x > 0.0 && z.is_finite()) {
            let why = format!("{numbers}: all must be above 0");
            return Err(AttitudeError::Inertia { why });
        }
        if z > (x + y) * (1.0 + WRITTEN) {
            let why = format!(
                "{numbers}: the largest is more than the sum of the others, {}, which no body has",
                x + y
            );
            return Err(AttitudeError::Inertia { why });
        }
        Ok(Self { moments, axes })
    }

    /// The principal moments, kg m², smallest first.
    pub fn moments(&self) -> DVec3 {
        self.moments
    }

    /// The tensor in the body's axes, kg m².
    pub fn tensor(&self) -> DMat3 {
        self.axes * DMat3::from_diagonal(self.moments) * self.axes.transpose()
    }
}

/// A body that tumbles without torque.
#[derive(Debug, Clone, PartialEq)]
pub struct Tumble {
    epoch: Epoch,
    /// Body axes → the axes a, b, c of the motion.
    body_to_abc: DQuat,
    /// The frame about L → GCRS.
    from_l: DQuat,
    motion: Motion,
}

#[derive(Debug, Clone, PartialEq)]
enum Motion {
    /// ω stands still in the body (a sphere, or no spin): the rate about ℓ, rad/s, and ℓ.
    Steady {
        rate_rad_s: f64,
        towards_l: DVec3,
    },
    Periodic(Box<Periodic>),
}

#[derive(Debug, Clone, PartialEq)]
struct Periodic {
    modulus: Modulus,
    /// Principal moments about a, b and c, kg m².
    moments: DVec3,
    /// Angular momentum, kg m² rad/s.
    momentum: f64,
    /// Argument of the elliptic functions at the epoch, and its rate, 1/s.
    argument: f64,
    argument_per_s: f64,
    /// Amplitudes of ℓ along a (cn), b (sn) and c (dn).
    amplitude: DVec3,
    /// The mean of φ̇, rad/s.
    mean_rad_s: f64,
    /// Coefficients of the periodic part of φ: Σ sines_n sin(nπu/K), radians, from n = 1.
    sines: Vec<f64>,
    /// The sum at the epoch, radians.
    sum_at_epoch: f64,
}

impl Tumble {
    /// A body of that inertia that stands as `body_to_gcrs` and turns with `omega_body_rad_s` (its angular velocity against the GCRS,
    /// in its own axes, rad/s) at an epoch.
    ///
    /// # Errors
    /// An angular velocity that is not finite.
    pub fn new(
        inertia: &Inertia,
        omega_body_rad_s: DVec3,
        body_to_gcrs: DQuat,
        epoch: Epoch,
    ) -> Result<Self, AttitudeError> {
        if !omega_body_rad_s.is_finite() {
            return Err(AttitudeError::NotFinite { what: "the angular velocity" });
        }
        let turns_per_s = omega_body_rad_s.length() / TAU;
        // Written so that a length that overflows is refused too.
        if turns_per_s > MOST_TURNS_PER_S {
            return Err(AttitudeError::TooFast { what: "the angular velocity", turns_per_s });
        }
        let omega = inertia.axes.transpose() * omega_body_rad_s;
        // Only their ratios matter; so no product of three overflows.
        let moments = inertia.moments / inertia.moments.z;
        let [x, y, z] = moments.to_array();
        let momentum = (moments * omega).length();
        let same = |p: f64, q: f64| (p - q).abs() <= SAME_MOMENT * z;
        if same(x, z) || momentum == 0.0 {
            // All moments are the same: ω stands still in the body and in space.
            let rate_rad_s = omega.length();
            let towards_l = omega.try_normalize().unwrap_or(DVec3::Z);
            return Ok(Self::from_parts(
                epoch,
                inertia.axes,
                body_to_gcrs,
                Motion::Steady { rate_rad_s, towards_l },
            ));
        }
        let direction = (moments * omega) / momentum;
        if direction.abs().max_element() >= 1.0 - 0.5 * PRINCIPAL * PRINCIPAL {
            // A spin about a principal axis, the intermediate one included: it stays, as any other would not.
            let rate_rad_s = omega.length();
            let towards_l = omega / rate_rad_s;
            return Ok(Self::from_parts(
                epoch,
                inertia.axes,
                body_to_gcrs,
                Motion::Steady { rate_rad_s, towards_l },
            ));
        }
        // L² − 2TI₂ decides which axis the angular momentum circles: that of the largest or of the smallest moment.
        let (towards_z, towards_x) =
            (z * (z - y) * omega.z * omega.z, x * (y - x) * omega.x * omega.x);
        let about_largest = same(x, y) || (!same(y, z) && towards_z >= towards_x);
        let (mut abc, mut i_abc, mut omega) = if about_largest {
            (inertia.axes, moments, omega)
        } else {
            // a = −z, b = y, c = x is right-handed.
            let a = inertia.axes;
            (
                DMat3::from_cols(-a.z_axis, a.y_axis, a.x_axis),
                DVec3::new(z, y, x),
                DVec3::new(-omega.z, omega.y, omega.x),
            )
        };
        if same(i_abc.x, i_abc.y) {
            i_abc.x = i_abc.y; // a symmetric top, whatever the rounding
        }
        if omega.z < 0.0 {
            // Half a turn about b, so that ω_c is positive.
            abc = DMat3::from_cols(-abc.x_axis, abc.y_axis, -abc.z_axis);
            omega = DVec3::new(-omega.x, omega.y, -omega.z);
        }
        let periodic = Periodic::new(i_abc, omega);
        Ok(Self::from_parts(epoch, abc, body_to_gcrs, Motion::Periodic(Box::new(periodic))))
    }

    fn from_parts(epoch: Epoch, abc: DMat3, body_to_gcrs: DQuat, motion: Motion) -> Self {
        let body_to_abc = DQuat::from_mat3(&abc).normalize().inverse();
        let start = motion.abc_to_l(0.0);
        let from_l = body_to_gcrs * (start * body_to_abc).inverse();
        Self { epoch, body_to_abc, from_l, motion }
    }

    /// The rotation from body axes to the GCRS.
    pub fn body_to_gcrs(&self, epoch: Epoch) -> DQuat {
        let after_s = seconds_between(self.epoch, epoch);
        (self.from_l * self.motion.abc_to_l(after_s) * self.body_to_abc).normalize()
    }

    /// The angular velocity against the GCRS, in the body's axes, rad/s.
    pub fn omega_body_rad_s(&self, epoch: Epoch) -> DVec3 {
        let after_s = seconds_between(self.epoch, epoch);
        self.body_to_abc.inverse() * self.motion.omega_abc(after_s)
    }
}

impl Motion {
    /// The rotation from the axes a, b, c to the frame about L, so many seconds after the epoch.
    fn abc_to_l(&self, after_s: f64) -> DQuat {
        match self {
            Motion::Steady { rate_rad_s, towards_l } => turn(*towards_l, rate_rad_s * after_s),
            Motion::Periodic(periodic) => periodic.abc_to_l(after_s),
        }
    }

    fn omega_abc(&self, after_s: f64) -> DVec3 {
        match self {
            Motion::Steady { rate_rad_s, towards_l } => *towards_l * *rate_rad_s,
            Motion::Periodic(periodic) => {
                let (_, towards_l) = periodic.towards_l(after_s);
                periodic.momentum * towards_l / periodic.moments
            }
        }
    }
}

impl Periodic {
    /// Creates the motion from principal moments about a, b (the middle one) and c, and an angular velocity whose part along c is not negative.
    fn new(moments: DVec3, omega: DVec3) -> Self {
        let [ia, ib, ic] = moments.to_array();
        let [wa2, wb2, wc2] = (omega * omega).to_array();
        let (c_a, c_b, b_a) = (ic - ia, ic - ib, ib - ia);
        // Sums of terms of one sign, so that nothing cancels: 2TI_c − L², L² − 2TI_a; L² − 2TI_b is what it is.
        let e = ia * c_a * wa2 + ib * c_b * wb2;
        let f = ib * b_a * wb2 + ic * c_a * wc2;
        let g = ic * c_b * wc2 - ia * b_a * wa2;
        let momentum = (moments * omega).length();
        let complement = if b_a == 0.0 { 1.0 } else { c_a * g / (c_b * f) };
        let modulus = Modulus::of_complement(complement.clamp(LEAST_COMPLEMENT, 1.0));
        let amplitude =
            DVec3::new((ia * e / c_a).sqrt(), (ib * e / c_b).sqrt(), (ic * f / c_a).sqrt())
                / momentum;
        let argument_per_s = (c_b * f / (ia * ib * ic)).sqrt().copysign(c_b);
        let sn = ib * omega.y / amplitude.y;
        let cn = ia * omega.x / amplitude.x;
        let argument = modulus.argument(sn, cn);

        let spread_rad_s = e / (momentum * ic);
        let quarter = modulus.quarter();
        // The mean from (2T/L + ω_c)/(1 + ℓ_c), which is the same φ̇ without the difference of two large rates.
        let two_t_l = (moments * omega).dot(omega) / momentum;
        let rate = |dn: f64| {
            let l_c = amplitude.z * dn;
            (two_t_l + momentum * l_c / ic) / (1.0 + l_c)
        };
        let (mean_rad_s, cosines) = if complement >= 1.0 {
            // A symmetric top: ℓ_c stands still.
            (rate(1.0), Vec::new())
        } else {
            let dn = |turns: f64| modulus.sn_cn_dn(2.0 * quarter * turns).2;
            let cosines = cosines(|turns| 1.0 / (1.0 + amplitude.z * dn(turns)));
            let samples = 8 * (cosines.len() + 4);
            let sum: f64 = (0..samples).map(|j| rate(dn(j as f64 / samples as f64))).sum();
            (sum / samples as f64, cosines)
        };
        let sines: Vec<f64> = (1..)
            .zip(&cosines)
            .map(|(n, cosine)| {
                spread_rad_s / argument_per_s * cosine * quarter / (f64::from(n) * PI)
            })
            .collect();
        let mut periodic = Self {
            modulus,
            moments,
            momentum,
            argument,
            argument_per_s,
            amplitude,
            mean_rad_s,
            sines,
            sum_at_epoch: 0.0,
        };
        let (turns, _) = periodic.towards_l(0.0);
        periodic.sum_at_epoch = sine_series(&periodic.sines, 2.0 * TAU * turns);
        periodic
    }

    /// The argument in periods 4K, within half of one, and the direction of L along a, b, c.
    fn towards_l(&self, after_s: f64) -> (f64, DVec3) {
        let period = 4.0 * self.modulus.quarter();
        let turns = self.argument / period + self.argument_per_s / period * after_s;
        let turns = turns - turns.round();
        let (sn, cn, dn) = self.modulus.sn_cn_dn(period * turns);
        (turns, (self.amplitude * DVec3::new(cn, sn, dn)).normalize())
    }

    fn abc_to_l(&self, after_s: f64) -> DQuat {
        let (turns, l) = self.towards_l(after_s);
        let sum = sine_series(&self.sines, 2.0 * TAU * turns);
        let about_l = turn(DVec3::Z, self.mean_rad_s * after_s + (sum - self.sum_at_epoch));
        // The shortest rotation that takes ℓ to c; ℓ_c is never negative, so it is regular.
        about_l * DQuat::from_xyzw(l.y, -l.x, 0.0, 1.0 + l.z).normalize()
    }
}

fn turn(axis: DVec3, angle_rad: f64) -> DQuat {
    DQuat::from_axis_angle(axis, angle_rad)
}

/// Cosine coefficients (from n = 1) of an even function of period 1, to rounding: by the trapezoidal rule, which converges as
/// the coefficients do.
fn cosines(function: impl Fn(f64) -> f64) -> Vec<f64> {
    const MOST_SAMPLES: usize = 4096;
    let mut samples = 32;
    loop {
        let values: Vec<f64> = (0..samples).map(|j| function(j as f64 / samples as f64)).collect();
        let cosines: Vec<f64> =
            (0..samples).map(|j| (TAU * j as f64 / samples as f64).cos()).collect();
        let coefficient = |n: usize| {
            let sum: f64 =
                values.iter().enumerate().map(|(j, v)| v * cosines[n * j % samples]).sum();
            2.0 / samples as f64 * sum
        };
        let mut coefficients: Vec<f64> = (1..samples / 2).map(coefficient).collect();
        let small = |c: &f64| c.abs() < 2e-16;
        // What lies beyond half of the coefficients is aliased into the rest.
        if coefficients[samples / 4..].iter().all(small) || samples >= MOST_SAMPLES {
            while coefficients.last().is_some_and(small) {
                coefficients.pop();
            }
            return coefficients;
        }
        samples *= 2;
    }
}

/// Σ s_n sin(nx), n from 1, by Clenshaw's recurrence.
fn sine_series(sines: &[f64], x: f64) -> f64 {
    let (sin, cos) = x.sin_cos();
    let (mut later, mut latest) = (0.0, 0.0);
    for s in sines.iter().rev() {
        (latest, later) = (s + 2.0 * cos * latest - later, latest);
    }
    latest * sin
}

/// Principal moments, smallest first, with their axes as right-handed columns.
fn sorted(moments: DVec3, axes: DMat3) -> (DVec3, DMat3) {
    let mut order = [0, 1, 2];
    order.sort_by(|i, j| moments[*i].total_cmp(&moments[*j]));
    let [i, j, k] = order;
    let (x, y) = (axes.col(i), axes.col(j));
    // An odd order would turn the axes left-handed; the third is then reversed.
    (DVec3::new(moments[i], moments[j], moments[k]), DMat3::from_cols(x, y, x.cross(y)))
}

/// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's rotations, smallest eigenvalue first.
fn eigen(tensor: DMat3) -> (DVec3, DMat3) {
    let (mut a, mut axes) = (tensor, DMat3::IDENTITY);
    for _ in 0..32 {
        let mut done = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(q)[p];
            if off.abs() <= 1e-17 * (a.col(p)[p].abs() + a.col(q)[q].abs()) {
                continue;
            }
            done = false;
            let angle = 0.5 * (2.0 * off).atan2(a.col(q)[q] - a.col(p)[p]);
            let (sin, cos) = angle.sin_cos();
            let mut rotation = DMat3::IDENTITY;
            rotation.col_mut(p)[p] = cos;
            rotation.col_mut(q)[q] = cos;
            rotation.col_mut(q)[p] = sin;
            rotation.col_mut(p)[q] = -sin;
            a = rotation.transpose() * a * rotation;
            axes *= rotation;
        }
        if done {
            break;
        }
    }
    sorted(DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z), axes)
}
