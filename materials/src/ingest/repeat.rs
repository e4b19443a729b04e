//! Directions that were measured more than once: the median of each counts, so that one that went wrong does no harm.

use super::Repeat;
use crate::samples::{Sample, Samples};
use std::collections::BTreeMap;
use std::fmt;
use sunglint_numerics::order::median;

/// Angles that differ by less than this are the same, degrees.
const SAME_DEG: f64 = 1e-6;

/// One row for each direction, the median of those that it has; the number (from 1) of the first of them; and what was put together.
pub(super) fn merged(rows: Vec<Sample>) -> (Vec<Sample>, Vec<usize>, Vec<Repeat>) {
    let mut groups: Vec<(Vec<usize>, Vec<Sample>)> = Vec::new();
    let mut known = BTreeMap::new();
    for (k, row) in rows.into_iter().enumerate() {
        let group = *known.entry(key(&row)).or_insert(groups.len());
        if group == groups.len() {
            groups.push((Vec::new(), Vec::new()));
        }
        groups[group].0.push(k + 1);
        groups[group].1.push(row);
    }
    let (mut all, mut first, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
    for (directions, mut members) in groups {
        first.push(directions[0]);
        if members.len() == 1 {
            all.append(&mut members);
            continue;
        }
        let (row, scatter, expected) = middle(&members);
        all.push(row);
        repeats.push(Repeat { directions, scatter, expected });
    }
    (all, first, repeats)
}

/// The directions as whole numbers, alike where they are the same.
fn key(row: &Sample) -> [i64; 4] {
    let number = |deg: f64| (deg / SAME_DEG).round() as i64;
    let turn = |deg: f64| number(deg).rem_euclid(number(360.0));
    let [ti, pi] = [number(row.theta_i_deg), turn(row.phi_i_deg)];
    [ti, pi, number(row.theta_o_deg), turn(row.phi_o_deg)]
}

/// The values with each direction once; and what was found of those that were there several times.
pub fn once(samples: Samples) -> (Samples, Option<String>) {
    let all = samples.rows.len();
    let (rows, _, repeats) = merged(samples.rows);
    let said = (!repeats.is_empty()).then(|| {
        let square: f64 = repeats.iter().map(|r| r.scatter * r.scatter).sum();
        format!(
            "{} directions were measured more than once ({} rows of {all}): the median of each counts; they scatter by {:.1} % (rms)",
            repeats.len(),
            repeats.iter().map(|r| r.directions.len()).sum::<usize>(),
            100.0 * (square / repeats.len() as f64).sqrt()
        )
    });
    (Samples { rows, ..samples }, said)
}

/// Standard deviation of the median of many over that of their mean, √(π/2).
const OF_MEDIAN: f64 = 1.253_314;

/// The median by wavelength of those that have a value there. Its standard deviation is the noise's or the scatter's, the larger. And the relative scatter, with what is
/// expected of it.
fn middle(members: &[Sample]) -> (Sample, f64, f64) {
    let mut row = members[0].clone();
    let (mut scatter, mut expected, mut count) = (0.0, 0.0, 0.0);
    for k in 0..row.brdf_per_sr.len() {
        let sigma =
            |m: &Sample| m.sigma_per_sr.get(k).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
        let known: Vec<(f64, f64)> = members
            .iter()
            .map(|m| (m.brdf_per_sr[k], sigma(m)))
            .filter(|(value, _)| value.is_finite())
            .collect();
        let n = known.len() as f64;
        if known.is_empty() {
            continue;
        }
        let Some(mean) = median(known.iter().map(|(v, _)| *v)) else { continue };
        let noise = known.iter().map(|(_, s)| s * s).sum::<f64>() / n;
        let about = known.iter().map(|(v, _)| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        row.brdf_per_sr[k] = mean;
        if row.sigma_per_sr.is_empty() {
            row.sigma_per_sr = vec![f64::NAN; row.brdf_per_sr.len()];
        }
        let wider = if known.len() > 2 { OF_MEDIAN } else { 1.0 };
        row.sigma_per_sr[k] = wider * (noise.max(about) / n).sqrt();
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
            "directions {} are the same one: their median is taken; they scatter by {:.2} % (rms over the wavelengths; their noise is {:.2} %)",
            numbers.join(", "),
            100.0 * self.scatter,
            100.0 * self.expected
        )
    }
}
