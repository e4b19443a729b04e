//! Samples that differ by azimuth: each plane of incidence by itself, then ln f around the normal.
//!
//! Each plane has its own symmetry point, as a tilted mount gives it. D is taken to be the same half a turn further: with both signs of the stage's angle a plane
//! holds both halves.

use super::cone::Cone;
use super::nodes::Anisotropic;
use super::profile::{Stated, Traced};
use super::scan::Scan;
use super::{Ndf, NdfError, NdfFlags, NdfOptions, Note, exp, solve, uncertainty};
use crate::table::{Reading, RetroTable};
use nalgebra::DMatrix;
use std::f64::consts::{FRAC_PI_2, PI};

/// Azimuths closer than this are one plane, degrees.
const SAME_PLANE_DEG: f64 = 0.01;
/// Planes that half the circle needs.
const LEAST_PLANES: usize = 4;

pub(super) fn extract(run: &RetroTable, options: &NdfOptions) -> Result<Ndf, NdfError> {
    let mut notes = Vec::new();
    let planes = planes(&run.readings);
    let elevations = super::Elevations::new(options.elevations.unwrap_or(32));
    let mut scans = Vec::with_capacity(planes.len());
    // Each plane has its own symmetry point, and was run by itself.
    let stated = Stated { cone: Cone::of(run), zero: None };
    for (azimuth_deg, readings) in planes {
        let scan = Scan::clean(&readings, &mut notes)?;
        let traced =
            Traced::new(&scan, azimuth_deg, &elevations.theta_rad, (options, &stated), &mut notes)?;
        scans.push((scan, traced));
    }
    let azimuth: Vec<f64> = scans.iter().map(|(_, t)| t.profile.azimuth_deg.to_radians()).collect();
    let around = Around::new(&azimuth, &mut notes)?;
    let alphas = scans.iter().map(|(_, t)| t.profile.ggx.alpha);
    let (least, most) = alphas.fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
    let needed = (12.0 * most / least / 4.0).ceil() as usize * 4;
    let over = Anisotropic::new(
        elevations.theta_rad.len(),
        options.azimuths.unwrap_or(needed.clamp(64, 512)),
    );
    // As found, then all planes with the worst of their other continuations.
    let on_nodes = |which: &dyn Fn(&Traced) -> &[f64], scans: &[&Traced]| {
        let rows: Vec<&[f64]> = scans.iter().map(|t| which(t)).collect();
        exp(&around.onto(&rows, &over.phi_rad))
    };
    let traced: Vec<&Traced> = scans.iter().map(|(_, t)| t).collect();
    let solution = solve(&over, &on_nodes(&|t| &t.ln_f[0], &traced))?;
    let mut bound = uncertainty::Bound::new(solution.density.len());
    let others = traced.iter().map(|t| t.ln_f.len()).max().unwrap_or(1);
    for other in 1..others {
        let which = |t: &Traced| other.min(t.ln_f.len() - 1);
        let f = on_nodes(&|t| &t.ln_f[which(t)], &traced);
        bound.add(&solution, &solve(&over, &f)?);
    }
    let n = elevations.theta_rad.len();
    let flag = |k: usize| traced.iter().fold(NdfFlags::empty(), |a, t| a | t.flags[k]);
    let row: Vec<NdfFlags> = (0..n).map(flag).collect();
    let mut ndf = Ndf {
        theta_rad: elevations.theta_rad.clone(),
        phi_rad: over.phi_rad.clone(),
        density_sigma: None,
        density_bound: bound.density,
        f0_bound: bound.f0,
        flags: row.repeat(over.phi_rad.len()),
        f0: solution.f0,
        f0_sigma: None,
        convergence: solution.convergence,
        density: solution.density,
        projected_area: solution.sigma,
        profiles: traced.iter().map(|t| t.profile.clone()).collect(),
        smallest_alpha: None,
        resamplings: 0,
        notes,
    };
    let common = uncertainty::Common {
        stated,
        laser: None,
        scale_sigma: run.scale_sigma,
        cone_sigma: run.cone_sigma,
    };
    uncertainty::add(&mut ndf, &over, &scans, (&common, options), |traced| {
        let rows: Vec<&[f64]> = traced.iter().map(|t| &t.ln_f[0][..]).collect();
        exp(&around.onto(&rows, &over.phi_rad))
    });
    Ok(ndf)
}

/// The readings by azimuth within half a turn; what was measured half a turn further has the other sign of the stage's angle.
fn planes(readings: &[Reading]) -> Vec<(f64, Vec<Reading>)> {
    let mut planes: Vec<(f64, Vec<Reading>)> = Vec::new();
    for reading in readings {
        let turned = reading.azimuth_deg.rem_euclid(360.0);
        let is_far = turned >= 180.0 - SAME_PLANE_DEG;
        let azimuth_deg = if is_far { (turned - 180.0).max(0.0) } else { turned };
        let angle_deg = if is_far { -reading.angle_deg } else { reading.angle_deg };
        let reading = Reading { azimuth_deg, angle_deg, ..*reading };
        match planes.iter_mut().find(|(a, _)| (a - azimuth_deg).abs() <= SAME_PLANE_DEG) {
            Some((_, plane)) => plane.push(reading),
            None => planes.push((azimuth_deg, vec![reading])),
        }
    }
    planes.sort_by(|a, b| a.0.total_cmp(&b.0));
    planes
}

/// Interpolation around half a turn: by trigonometric polynomials where the azimuths are evenly apart, else by a periodic cubic spline.
struct Around {
    /// Azimuths, increasing over half a turn, and which plane each is of.
    knots: Vec<(f64, usize)>,
    /// Second derivatives of the spline per value; none where the azimuths are even.
    bend: Option<DMatrix<f64>>,
}

impl Around {
    fn new(azimuth: &[f64], notes: &mut Vec<Note>) -> Result<Self, NdfError> {
        let mut knots: Vec<(f64, usize)> = azimuth.iter().copied().zip(0..).collect();
        let last = azimuth.iter().fold(0.0_f64, |a, b| a.max(*b));
        let tiny = SAME_PLANE_DEG.to_radians();
        if last <= FRAC_PI_2 + tiny {
            notes.push(Note::Mirrored);
            let beyond = azimuth.iter().copied().zip(0..).map(|(a, k)| (PI - a, k));
            knots.extend(beyond.filter(|(a, _)| *a > FRAC_PI_2 + tiny && *a < PI - tiny));
            knots.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        let n = knots.len();
        let next = |k: usize| if k + 1 < n { knots[k + 1].0 } else { knots[0].0 + PI };
        let h: Vec<f64> = (0..n).map(|k| next(k) - knots[k].0).collect();
        let widest = h.iter().fold(0.0_f64, |a, b| a.max(*b));
        if n < LEAST_PLANES || widest > PI / 3.0 {
            return Err(NdfError::Azimuths(format!(
                "{} planes of incidence, the widest step between them {:.1}°: an anisotropic sample needs {LEAST_PLANES} or more over half the circle \
                 (or 3 over a quarter of it, where it is symmetric), no further apart than 60°",
                azimuth.len(),
                widest.to_degrees()
            )));
        }
        let is_even = h.iter().all(|h| (h - PI / n as f64).abs() < 2.0 * tiny);
        let bend = if is_even { None } else { Some(bend(&h)?) };
        Ok(Self { knots, bend })
    }

    /// Rows of values by plane onto azimuths: azimuth by azimuth.
    fn onto(&self, rows: &[&[f64]], phi: &[f64]) -> Vec<f64> {
        let columns = rows[0].len();
        let mut out = vec![0.0; phi.len() * columns];
        for (phi, out) in phi.iter().zip(out.chunks_exact_mut(columns)) {
            for ((_, plane), weight) in self.knots.iter().zip(self.weights(*phi)) {
                out.iter_mut().zip(rows[*plane]).for_each(|(out, value)| *out += weight * value);
            }
        }
        out
    }

    /// Returns the weight that the value at each azimuth has at `phi`.
    fn weights(&self, phi: f64) -> Vec<f64> {
        let n = self.knots.len();
        let Some(bend) = &self.bend else {
            return self.knots.iter().map(|(a, _)| cardinal(phi - a, n)).collect();
        };
        let phi = self.knots[0].0 + (phi - self.knots[0].0).rem_euclid(PI);
        let k = self.knots.partition_point(|(a, _)| *a <= phi).clamp(1, n) - 1;
        let next = (k + 1) % n;
        let end = if next == 0 { self.knots[0].0 + PI } else { self.knots[next].0 };
        let h = end - self.knots[k].0;
        let b = (phi - self.knots[k].0) / h;
        let a = 1.0 - b;
        let cubic = |x: f64| (x * x * x - x) * h * h / 6.0;
        let mut weights: Vec<f64> =
            (0..n).map(|j| cubic(a) * bend[(k, j)] + cubic(b) * bend[(next, j)]).collect();
        weights[k] += a;
        weights[next] += b;
        weights
    }
}

/// The trigonometric polynomial of period π that is 1 at one of `n` even places and 0 at the others.
fn cardinal(x: f64, n: usize) -> f64 {
    let (sin, cos) = x.sin_cos();
    if sin.abs() < 1e-9 {
        return 1.0;
    }
    let wave = (n as f64 * x).sin() / (n as f64 * sin);
    if n.is_multiple_of(2) { wave * cos } else { wave }
}

/// Second derivatives of a periodic cubic spline per value, for intervals `h`.
fn bend(h: &[f64]) -> Result<DMatrix<f64>, NdfError> {
    let n = h.len();
    let (mut left, mut right) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    for k in 0..n {
        let (before, after) = ((k + n - 1) % n, (k + 1) % n);
        left[(k, before)] += h[before] / 6.0;
        left[(k, k)] += (h[before] + h[k]) / 3.0;
        left[(k, after)] += h[k] / 6.0;
        right[(k, before)] += 1.0 / h[before];
        right[(k, k)] -= 1.0 / h[before] + 1.0 / h[k];
        right[(k, after)] += 1.0 / h[k];
    }
    left.lu().solve(&right).ok_or_else(|| {
        NdfError::Azimuths("the azimuths cannot be interpolated: two of them are alike".into())
    })
}
