//! Directions that were measured more than once.

use super::Repeat;
use crate::samples::Sample;
use std::fmt;

/// Angles that differ by less than this are the same, degrees.
const SAME_DEG: f64 = 1e-6;

/// One row for each direction, the mean of those that it has; the number (from 1) of the first of them; and what was put together.
pub(super) fn merged(rows: Vec<Sample>) -> (Vec<Sample>, Vec<usize>, Vec<Repeat>) {
    let mut groups: Vec<(Vec<usize>, Vec<Sample>)> = Vec::new();
    for (k, row) in rows.into_iter().enumerate() {
        match groups.iter_mut().find(|(_, members)| same(&members[0], &row)) {
            Some((numbers, members)) => {
                numbers.push(k + 1);
                members.push(row);
            }
            None => groups.push((vec![k + 1], vec![row])),
        }
    }
    let (mut all, mut first, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
    for (directions, mut members) in groups {
        first.push(directions[0]);
        if members.len() == 1 {
            all.append(&mut members);
            continue;
        }
        let (row, scatter, expected) = mean(&members);
        all.push(row);
        repeats.push(Repeat { directions, scatter, expected });
    }
    (all, first, repeats)
}

fn same(a: &Sample, b: &Sample) -> bool {
    let turn = |a: f64, b: f64| {
        let apart = (a - b).rem_euclid(360.0);
        apart.min(360.0 - apart) < SAME_DEG
    };
    let tilt = |a: f64, b: f64| (a - b).abs() < SAME_DEG;
    tilt(a.theta_i_deg, b.theta_i_deg)
        && turn(a.phi_i_deg, b.phi_i_deg)
        && tilt(a.theta_o_deg, b.theta_o_deg)
        && turn(a.phi_o_deg, b.phi_o_deg)
}

/// The mean by wavelength of those that have a value there. Its standard deviation is the noise's or the scatter's, the larger. And the relative scatter, with what is
/// expected of it.
fn mean(members: &[Sample]) -> (Sample, f64, f64) {
    let mut row = members[0].clone();
    let (mut scatter, mut expected, mut count) = (0.0, 0.0, 0.0);
    for k in 0..row.brdf_per_sr.len() {
        let sigma = |m: &Sample| m.sigma_per_sr.get(k).copied().unwrap_or(0.0);
        let known: Vec<(f64, f64)> = members
            .iter()
            .map(|m| (m.brdf_per_sr[k], sigma(m)))
            .filter(|(value, _)| value.is_finite())
            .collect();
        let n = known.len() as f64;
        if known.is_empty() {
            continue;
        }
        let mean = known.iter().map(|(v, _)| v).sum::<f64>() / n;
        let noise = known.iter().map(|(_, s)| s * s).sum::<f64>() / n;
        let about = known.iter().map(|(v, _)| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        row.brdf_per_sr[k] = mean;
        if let Some(sigma) = row.sigma_per_sr.get_mut(k) {
            *sigma = (noise.max(about) / n).sqrt();
        }
        if known.len() > 1 && mean != 0.0 {
            scatter += about / (mean * mean);
            expected += noise / (mean * mean);
            count += 1.0;
        }
    }
    let count = f64::max(count, 1.0);
    (row, (scatter / count).sqrt(), (expected / count).sqrt())
}

impl fmt::Display for Repeat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.directions.iter().map(ToString::to_string).collect();
        write!(
            f,
            "directions {} are the same one: their mean is taken; they scatter by {:.2} % (rms over the wavelengths; their noise is {:.2} %)",
            numbers.join(", "),
            100.0 * self.scatter,
            100.0 * self.expected
        )
    }
}
