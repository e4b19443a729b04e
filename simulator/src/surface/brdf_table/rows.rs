//! Rows of a table made ready: directions that have several values, and azimuths of incidence that symmetry tells of.

use super::{Placed, SAME_DEG, WIDE};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Standard deviations in half a 95 % interval.
const HALF_95: f64 = 1.96;

/// Scatter below this, a rounding of the file, is not said.
const SAID: f64 = 1e-3;

/// Rows with their values.
pub(super) struct Rows {
    pub placed: Vec<Placed>,
    /// By row, then wavelength.
    pub value: Vec<f64>,
    /// By row the half-width of the 95 % interval of ln f that repeated measurements give; 0 of one.
    pub ln_scatter: Vec<f64>,
}

fn same_rad() -> f64 {
    SAME_DEG.to_radians()
}

/// The number of an angle, alike for those that are the same; azimuths go around.
fn number(angle: f64, around: bool) -> i64 {
    let count = (angle / same_rad()).round() as i64;
    if around { count.rem_euclid((TAU / same_rad()).round() as i64) } else { count }
}

/// Makes one row of each direction: the median by wavelength; and a note where they differ.
pub(super) fn once(
    placed: Vec<Placed>,
    value: &[f64],
    wavelengths: usize,
    isotropic: bool,
) -> (Rows, Option<String>) {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut known = BTreeMap::new();
    for (k, p) in placed.iter().enumerate() {
        let (phi_i, phi_o) = p.azimuths(isotropic);
        let around = |phi: f64, theta: f64| if theta < same_rad() { 0 } else { number(phi, true) };
        let key = (
            number(p.theta_i, false),
            if isotropic { 0 } else { around(phi_i, p.theta_i) },
            number(p.theta_o, false),
            around(phi_o, p.theta_o),
        );
        let group = *known.entry(key).or_insert(groups.len());
        if group == groups.len() {
            groups.push(Vec::new());
        }
        groups[group].push(k);
    }
    let mut kept: Vec<Option<Placed>> = placed.into_iter().map(Some).collect();
    let mut rows = Rows { placed: Vec::new(), value: Vec::new(), ln_scatter: Vec::new() };
    let (mut several, mut of_them, mut square, mut count) = (0, 0, 0.0, 0.0);
    for group in &groups {
        rows.placed.extend(kept[group[0]].take());
        let mut scatter = 0.0_f64;
        for k in 0..wavelengths {
            let of = |row: &usize| value[row * wavelengths + k];
            let mut all: Vec<f64> = group.iter().map(of).collect();
            all.sort_by(f64::total_cmp);
            let half = all.len() / 2;
            let middle =
                if all.len() % 2 == 1 { all[half] } else { 0.5 * (all[half - 1] + all[half]) };
            rows.value.push(middle);
            if all.len() > 1 && all[0] > 0.0 {
                let off = |v: &f64| (v / middle).ln().powi(2);
                let sum: f64 = all.iter().map(off).sum();
                let n = all.len() as f64;
                square += sum;
                count += n - 1.0;
                scatter = scatter.max(HALF_95 * (sum / (n - 1.0) / n).sqrt());
            }
        }
        if group.len() > 1 {
            several += 1;
            of_them += group.len();
        }
        rows.ln_scatter.push(scatter);
    }
    let typical = if count > 0.0 { (square / count).sqrt() } else { 0.0 };
    let note = (typical > SAID).then(|| {
        format!(
            "{several} directions have several values ({of_them} rows; repeated, or on both sides of the plane of incidence): the median of each counts, and they scatter by {:.1} % (rms)",
            100.0 * typical.exp_m1()
        )
    });
    (rows, note)
}

/// The azimuth after the widest gap between azimuths of incidence, that gap, and a usual one.
fn gaps(phi: &[f64]) -> (f64, f64, f64) {
    let after = |k: usize| phi[(k + 1) % phi.len()];
    let gap = |k: usize| (after(k) - phi[k]).rem_euclid(TAU);
    let mut all: Vec<(f64, usize)> = (0..phi.len()).map(|k| (gap(k), k)).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (widest, at) = all[all.len() - 1];
    (after(at), widest, all[(all.len() - 1) / 2].0)
}

/// The usual distance of the azimuths of incidence, radians.
pub(super) fn step(phi: &[f64]) -> f64 {
    if phi.len() > 1 { gaps(phi).2 } else { TAU }
}

/// Adds what symmetry tells where light came from a half or a quarter of the azimuths only; and a note of what was assumed.
pub(super) fn complete(rows: &mut Rows, phi: &[f64], wavelengths: usize) -> Option<String> {
    if phi.len() < 2 {
        return None;
    }
    let (first, widest, step) = gaps(phi);
    let span = TAU - widest;
    if widest <= WIDE * step {
        return None;
    }
    let is_quarter = (span - FRAC_PI_2).abs() < same_rad();
    let is_half = span + WIDE * step >= PI;
    if !is_half && !is_quarter {
        return None;
    }
    let (from, to) = (first.to_degrees(), (first + span).to_degrees());
    let mut assumed = format!(
        "light came from azimuths from {from:.0} to {to:.0}° only: the sample is assumed to be the same turned by 180°"
    );
    if !is_half {
        assumed.push_str(&format!(", and mirrored at {from:.0} and {to:.0}°"));
        copy(rows, wavelengths, |phi| 2.0 * first - phi);
    }
    copy(rows, wavelengths, |phi| phi + PI);
    Some(assumed)
}

/// Adds rows at other azimuths, where light did not come from these.
fn copy(rows: &mut Rows, wavelengths: usize, turned: impl Fn(f64) -> f64) {
    let is_upright = |p: &Placed| p.theta_i < same_rad();
    let key = |p: &Placed| (number(p.theta_i, false), number(p.phi_i, true));
    let there: std::collections::BTreeSet<(i64, i64)> = rows.placed.iter().map(key).collect();
    for k in 0..rows.placed.len() {
        let p = &rows.placed[k];
        let [phi_i, phi_o] = [p.phi_i, p.phi_o].map(|phi| turned(phi).rem_euclid(TAU));
        let made = Placed { theta_i: p.theta_i, phi_i, theta_o: p.theta_o, phi_o };
        if is_upright(p) || there.contains(&key(&made)) {
            continue;
        }
        rows.placed.push(made);
        rows.value.extend_from_within(k * wavelengths..(k + 1) * wavelengths);
        rows.ln_scatter.push(rows.ln_scatter[k]);
    }
}
