//! Averages over the disc of what varies slowly across it: rings about its middle, and of each ring the arcs that are not hidden.

use super::cut::{Cut, arcs};
use super::profile::{PROFILES, profiles};
use super::sums::{Integrand, Sums};
use glam::DVec2;
use std::f64::consts::TAU;
use std::sync::LazyLock;
use sunglint_numerics::{gauss, panels};

/// Numbers of rings of the whole disc that are tried one after the other.
const RINGS: [usize; 6] = [2, 3, 5, 8, 12, 18];
/// The orders of the rule over the panels of a cut disc.
const ORDERS: std::ops::Range<usize> = 0..5;

/// A ring: radius and weights.
type Ring = (f64, [f64; PROFILES]);

/// Rings of the whole disc.
static WHOLE: LazyLock<Vec<Vec<Ring>>> =
    LazyLock::new(|| RINGS.iter().map(|&n| rings(n)).collect());

/// Rings at Gauss's points of r², weighted so that polynomials in r² up to the degree n − 1 are exact for every profile.
fn rings(n: usize) -> Vec<Ring> {
    let at: Vec<f64> = gauss::legendre(n).iter().map(|(x, _)| 0.5 * (1.0 + x)).collect();
    let weights = |i: usize| {
        let mut sum = [0.0; PROFILES];
        // μ = v² leaves powers of fractions above 3: 1e-15 for so many points.
        for (v, width) in panels::panel(0.0, 1.0, 6) {
            let mu = v * v;
            let square = 1.0 - mu * mu;
            let basis: f64 =
                (0..n).filter(|k| *k != i).map(|k| (square - at[k]) / (at[i] - at[k])).product();
            let measure = 4.0 * width * mu * v * basis;
            sum.iter_mut().zip(profiles(mu)).for_each(|(s, p)| *s += measure * p);
        }
        sum
    };
    (0..n).map(|i| (at[i].sqrt(), weights(i))).collect()
}

/// s³(10 − 15 s + 6 s²) and its derivative: goes from 0 to 1, and starts and ends so slowly that roots at the ends are smooth.
pub fn step(s: f64) -> (f64, f64) {
    (s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 - s) * (1.0 - s))
}

/// Sums over the whole disc.
fn whole(order: usize, of: &mut Integrand<'_>, sums: &mut Sums) {
    let around = 2 * RINGS[order] + 1;
    let share = 1.0 / around as f64;
    for (i, (r, weights)) in WHOLE[order].iter().enumerate() {
        // Every other ring is turned by half a step.
        let first = if i % 2 == 0 { 0.0 } else { 0.5 };
        for j in 0..around {
            let (sin, cos) = (TAU * share * (first + j as f64)).sin_cos();
            sums.add(*r * DVec2::new(cos, sin), &weights.map(|w| w * share), of);
        }
    }
}

/// Sums over what cuts leave.
fn cut(cuts: &[Cut], order: usize, of: &mut Integrand<'_>, sums: &mut Sums) {
    let mut left = Vec::new();
    for (r, beyond, weight) in radii(cuts, order) {
        arcs(cuts, r, &mut left);
        for &(from, to) in &left {
            for (angle, width) in panels::panel(from, to, order) {
                let place = r * DVec2::new(angle.cos(), angle.sin());
                sums.add_dark(place, beyond, weight * width / TAU, of);
            }
        }
    }
}

/// Radii, 1 − r and weights 2 r dr, between the radii at which cuts begin and cease.
fn radii(cuts: &[Cut], order: usize) -> Vec<(f64, f64, f64)> {
    let mut edges = vec![0.0, 1.0];
    cuts.iter().for_each(|c| c.kinks(&mut edges));
    edges.retain(|r| (0.0..=1.0).contains(r));
    edges.sort_by(f64::total_cmp);
    edges.dedup();
    let mut radii = Vec::new();
    for pair in edges.windows(2) {
        let width = pair[1] - pair[0];
        for (s, weight) in panels::panel(0.0, 1.0, order) {
            let (up, slope) = step(s);
            let r = pair[0] + width * up;
            let beyond = (1.0 - pair[1]) + width * step(1.0 - s).0;
            radii.push((r, beyond, 2.0 * r * weight * slope * width));
        }
    }
    radii
}

/// Returns the share of the light of each profile that cuts leave: 1, 0, 0 … for the whole disc.
pub fn fractions(cuts: &[Cut]) -> [f64; PROFILES] {
    let mut left = Vec::new();
    let mut sum = [0.0; PROFILES];
    for (r, beyond, weight) in radii(cuts, 4) {
        arcs(cuts, r, &mut left);
        let seen = left.iter().map(|(a, b)| b - a).sum::<f64>() / TAU;
        let mu = (beyond * (2.0 - beyond)).max(0.0).sqrt();
        sum.iter_mut().zip(profiles(mu)).for_each(|(s, p)| *s += weight * seen * p);
    }
    sum
}

/// Averages `count` values over what is left of the disc into `sums`; more and more places, until the change is below `tolerance` of the
/// light plus `floor`. Gives the last change.
pub fn average(
    cuts: &[Cut],
    count: usize,
    (tolerance, floor): (f64, f64),
    of: &mut Integrand<'_>,
    sums: &mut Sums,
) -> f64 {
    let mut last = Sums::default();
    let orders = if cuts.is_empty() { 0..RINGS.len() } else { ORDERS };
    let mut change = f64::INFINITY;
    for order in orders {
        std::mem::swap(&mut last, sums);
        sums.clear(count);
        if cuts.is_empty() {
            whole(order, of, sums);
        } else {
            cut(cuts, order, of, sums);
        }
        if order > 0 {
            change = sums.distance(&last);
            if change <= tolerance * sums.grey() + floor {
                break;
            }
        }
    }
    change
}
