//! A minimum in numbers that a person knows: axis, period and phase with their uncertainties, and how probable it is among the others.

use super::AttitudeError;
use super::descent::Found;
use super::question::Question;
use super::state::{Law, State, Turn};
use super::twins::Twin;
use glam::DVec3;
use nalgebra::{DMatrix, Matrix2, SymmetricEigen};
use std::f64::consts::TAU;

/// An angle that is less certain than this is not determined, radians.
pub(super) const UNDETERMINED: f64 = 0.5;

/// Uncertainty of an axis on the sphere: standard uncertainties along the two axes of its ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipse {
    /// The longer one, degrees.
    pub major_deg: f64,
    /// The shorter one, degrees.
    pub minor_deg: f64,
    /// Where the longer one points, from north through east, 0 to 180 degrees.
    pub position_deg: f64,
}

/// A minimum of χ².
#[derive(Debug, Clone)]
pub struct Minimum {
    /// The trial.
    pub state: State,
    /// The spin, as a scene file has it.
    pub turn: Turn,
    /// Right ascension of the spin axis, degrees, 0 to 360.
    pub ra_deg: f64,
    /// Declination of the spin axis, degrees.
    pub dec_deg: f64,
    /// Period of the spin, s: negative is left-handed; infinite where the body does not turn.
    pub period_s: f64,
    /// Phase of the spin at the law's epoch, degrees, 0 to 360.
    pub phase_deg: f64,
    /// χ² with noise that the best one has; large residuals count linearly.
    pub chi2: f64,
    /// χ² above that of the best, over the scale of the errors.
    pub delta_chi2: f64,
    /// How probable it is among the minima, by χ² and by how wide it is.
    pub probability: f64,
    /// How uncertain the axis is; `None` where it is known or not determined.
    pub axis: Option<Ellipse>,
    /// Standard uncertainty of the turn about the axis in the middle of the data, degrees; likewise.
    pub turn_sigma_deg: Option<f64>,
    /// Standard uncertainty of the phase at the law's epoch, degrees; likewise.
    pub phase_sigma_deg: Option<f64>,
    /// Standard uncertainty of the period, s; likewise.
    pub period_sigma_s: Option<f64>,
    /// Standard uncertainty of the attitude in the middle of the data as one angle (root of the sum of squares over the axes), degrees.
    pub attitude_sigma_deg: Option<f64>,
    /// Covariance of small turns of the body about three axes, radians², and of the turn at the end of the data that the period's error makes: what is unknown of them,
    /// in the order of [`Law::moved`].
    pub covariance: Vec<Vec<f64>>,
    /// Factors of the brightness with their standard uncertainties.
    pub scales: Vec<(f64, f64)>,
    /// The symmetry that makes this one of the best, and how far it lies from where that would be, degrees.
    pub twin: Option<(Twin, f64)>,
    /// How far it is from the best: the largest angle between the two attitudes at the ends and in the middle of the data, degrees.
    pub from_best_deg: f64,
}

/// A minimum in numbers that a person knows.
pub(super) fn described(
    found: &Found,
    law: &Law,
    question: &Question,
    scale: f64,
) -> Result<Minimum, AttitudeError> {
    let unknowns = question.unknowns;
    let turn = law.turn(&found.state)?;
    let axis = turn.axis_gcrs;
    let ra_deg = axis.y.atan2(axis.x).to_degrees().rem_euclid(360.0);
    let dec_deg = axis.z.clamp(-1.0, 1.0).asin().to_degrees();
    let steps = unknowns.count();
    let covariance = covariance(&found.normal, scale);
    let own = covariance.as_ref().map(|c| c.view((0, 0), (steps, steps)).into_owned());
    let sigma = |k: usize| -> Option<f64> {
        let s = own.as_ref()?[(k, k)].sqrt();
        (s < UNDETERMINED).then_some(s)
    };
    let across = axis.any_orthonormal_vector();
    let frame = [across, axis.cross(across)];
    let ellipse = own.as_ref().filter(|_| unknowns.axis).and_then(|c| {
        // A turn of the body about `across` tilts the axis along axis × (−across) …: rotation vector × axis.
        let tilt = frame.map(|turn| turn.cross(axis));
        let east = DVec3::Z.cross(axis).try_normalize().unwrap_or(DVec3::Y);
        let north = axis.cross(east);
        let to = Matrix2::new(
            tilt[0].dot(north),
            tilt[1].dot(north),
            tilt[0].dot(east),
            tilt[1].dot(east),
        );
        let own = Matrix2::new(c[(0, 0)], c[(0, 1)], c[(1, 0)], c[(1, 1)]);
        let eigen = SymmetricEigen::new(to * own * to.transpose());
        let (major, minor) =
            if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
        let v = eigen.eigenvectors.column(major);
        let of = |k: usize| eigen.eigenvalues[k].max(0.0).sqrt();
        (of(major) < UNDETERMINED).then(|| Ellipse {
            major_deg: of(major).to_degrees(),
            minor_deg: of(minor).to_degrees(),
            position_deg: v[1].atan2(v[0]).to_degrees().rem_euclid(180.0),
        })
    });
    let rest = 2 * usize::from(unknowns.axis);
    let turn_sigma = if unknowns.phase { sigma(rest) } else { None };
    let rate_sigma = if unknowns.period { sigma(steps - 1) } else { None };
    let per_s = rate_sigma.map(|s| s / (TAU * law.half_span_s));
    let period_s = if turn.turns_per_s == 0.0 { f64::INFINITY } else { 1.0 / turn.turns_per_s };
    let phase_sigma = match own.as_ref().filter(|_| unknowns.phase) {
        Some(c) => phase_sigma(found, law, question, c)?,
        None => None,
    };
    let attitude = own.as_ref().filter(|_| rest > 0 || unknowns.phase).map(|c| {
        let free = rest + usize::from(unknowns.phase);
        (0..free).map(|k| c[(k, k)]).sum::<f64>().sqrt()
    });
    let rows = |c: &DMatrix<f64>| c.row_iter().map(|r| r.iter().copied().collect()).collect();
    let scales = found.scales.iter().enumerate().map(|(k, s)| {
        let own = covariance.as_ref().map_or(f64::NAN, |c| c[(steps + k, steps + k)].sqrt());
        (*s, own)
    });
    Ok(Minimum {
        state: found.state,
        turn,
        ra_deg,
        dec_deg,
        period_s,
        phase_deg: turn.phase_rad.to_degrees(),
        chi2: found.cost,
        delta_chi2: 0.0,
        probability: 0.0,
        axis: ellipse,
        turn_sigma_deg: turn_sigma.map(f64::to_degrees),
        phase_sigma_deg: phase_sigma.map(f64::to_degrees),
        period_sigma_s: per_s.map(|s| s * period_s * period_s).filter(|s| s.is_finite()),
        attitude_sigma_deg: attitude.filter(|a| *a < UNDETERMINED).map(f64::to_degrees),
        covariance: own.as_ref().map_or_else(Vec::new, rows),
        scales: scales.collect(),
        twin: None,
        from_best_deg: 0.0,
    })
}

/// The uncertainty of the phase at the law's epoch, radians: it grows with that of the period and of the axis.
fn phase_sigma(
    found: &Found,
    law: &Law,
    question: &Question,
    covariance: &DMatrix<f64>,
) -> Result<Option<f64>, AttitudeError> {
    const STEP: f64 = 1e-6;
    let steps = question.unknowns.count();
    let mut slopes = Vec::new();
    for k in 0..steps {
        let mut ends = [0.0; 2];
        for (end, sign) in ends.iter_mut().zip([-1.0, 1.0]) {
            let mut step = vec![0.0; steps];
            step[k] = sign * STEP;
            *end = law.turn(&law.moved(&found.state, question.unknowns, &step)?)?.phase_rad;
        }
        let turn = (ends[1] - ends[0] + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
        slopes.push(turn / (2.0 * STEP));
    }
    let mut variance = 0.0;
    for (i, a) in slopes.iter().enumerate() {
        for (j, b) in slopes.iter().enumerate() {
            variance += a * b * covariance[(i, j)];
        }
    }
    let sigma = variance.max(0.0).sqrt();
    Ok((sigma < std::f64::consts::PI / 2.0).then_some(sigma))
}

/// The inverse of a normal matrix, scaled; `None` where it is singular.
fn covariance(normal: &DMatrix<f64>, scale: f64) -> Option<DMatrix<f64>> {
    let n = normal.nrows();
    let root: Vec<f64> = (0..n).map(|i| normal[(i, i)].sqrt()).collect();
    if root.iter().any(|r| !(*r > 0.0 && r.is_finite())) {
        return None;
    }
    let scaled = DMatrix::from_fn(n, n, |i, j| normal[(i, j)] / (root[i] * root[j]));
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| scale * inverse[(i, j)] / (root[i] * root[j])))
}

/// Probabilities by χ² and by the width of each minimum (Laplace's approximation), all attitudes alike beforehand.
pub(super) fn probabilities(minima: &mut [Minimum], found: &[Found]) {
    let width = |f: &Found| {
        let determinant = f.normal.clone().cholesky().map(|c| c.determinant());
        // A minimum without curvature is no narrower than the sphere.
        -0.5 * determinant.filter(|d| *d > 0.0).map_or(0.0, f64::ln)
    };
    let logs: Vec<f64> =
        minima.iter().zip(found).map(|(m, f)| width(f) - 0.5 * m.delta_chi2).collect();
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logs.iter().map(|l| (l - most).exp()).sum();
    for (minimum, log) in minima.iter_mut().zip(&logs) {
        minimum.probability = (log - most).exp() / sum;
    }
}
