//! The two figures of a measured incidence that a fit must keep: its hemispherical reflectance and its peak.

use crate::samples::turned;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};
use sunglint_numerics::gauss::legendre;

/// Directions whose bisector lies this near the plane of incidence (y of a unit vector) are in it.
const IN_PLANE: f64 = 2e-3;
/// Rings and spokes of the grid on which samples out of the plane share the hemisphere.
const RINGS: usize = 60;
const SPOKES: usize = 120;
/// A sample stands for nothing farther away than this many times the typical distance of neighbours.
const REACH: f64 = 2.0;

/// The weight of each sample in the hemispherical reflectance of one incidence: Σ wₖ fₖ stands for ∫ f cosθ_o dω_o.
///
/// Projected on the surface, the hemisphere is a disc of radius 1 in which cosθ_o dω_o is the area. Samples in the plane of incidence alone share it in rings about the mirrored
/// direction: each stands for the part of a ring, on its own side and inside the disc, from half-way to the neighbour before to half-way to the one after. Where
/// there are samples out of that plane each stands for what is nearer to it than to any other, on both sides of the plane. What is farther from every sample
/// than twice their usual distance is left out, so the sum of all weights over π says how much of the hemisphere was measured.
pub fn weights(i: DVec3, o: &[DVec3]) -> Vec<f64> {
    let turned: Vec<DVec3> = o.iter().map(|o| turned(i, *o).1).collect();
    let x = i.x.hypot(i.y);
    if turned.iter().all(|o| o.y.abs() < IN_PLANE) {
        let s: Vec<f64> = turned.iter().map(|o| o.x + x).collect();
        let mut weights = rings(x, &s);
        if x < 1e-9 {
            // Light along the normal has no sides: all samples were turned to one of them.
            weights.iter_mut().for_each(|w| *w *= 2.0);
        }
        weights
    } else {
        cells(&turned)
    }
}

/// How much of the hemisphere weights stand for, 0 to 1.
pub fn coverage(weights: &[f64]) -> f64 {
    weights.iter().sum::<f64>() / std::f64::consts::PI
}

/// By the place along the plane of incidence, from the mirrored direction.
fn rings(x: f64, s: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..s.len()).collect();
    order.sort_by(|a, b| s[*a].total_cmp(&s[*b]));
    let gap = usual(order.windows(2).map(|w| s[w[1]] - s[w[0]]));
    let (low, high) = (x - 1.0, x + 1.0);
    let mut weights = vec![0.0; s.len()];
    for (n, k) in order.iter().enumerate() {
        let half = |other: Option<&usize>| match other {
            Some(other) => (0.5 * (s[*other] - s[*k]).abs()).min(REACH * gap),
            None => 0.5 * gap,
        };
        let before = n.checked_sub(1).and_then(|n| order.get(n));
        let from = (s[*k] - half(before)).max(low);
        let to = (s[*k] + half(order.get(n + 1))).min(high);
        // The ring has a kink where it meets the rim of the disc, and its radius one at 0.
        let rim = 1.0 - x;
        let mut edges = vec![from];
        edges.extend([-rim, 0.0, rim].into_iter().filter(|e| *e > from && *e < to));
        edges.push(to);
        weights[*k] = edges.windows(2).map(|w| arc(x, w[0], w[1])).sum();
    }
    weights
}

/// ∫ of the arc on the side of s, inside the disc, over |s|.
fn arc(x: f64, from: f64, to: f64) -> f64 {
    if to <= from {
        return 0.0;
    }
    let angle = |s: f64| {
        let r = s.abs();
        if r <= 1.0 - x {
            return FRAC_PI_2 * 2.0;
        }
        // Beyond the nearer rim only the far side is left, and all of the arc is its.
        2.0 * ((r * r + x * x - 1.0) / (2.0 * r * x)).clamp(-1.0, 1.0).acos()
    };
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    legendre(8)
        .iter()
        .map(|(t, w)| w * half * (middle + t * half).abs() * angle(middle + t * half))
        .sum()
}

/// Each place of the disc to the sample that is nearest.
fn cells(o: &[DVec3]) -> Vec<f64> {
    let places: Vec<(f64, f64)> = o.iter().map(|o| (o.x, o.y.abs())).collect();
    let nearest = |p: (f64, f64), but: Option<usize>| {
        let mut best = (f64::INFINITY, 0);
        for (k, q) in places.iter().enumerate().filter(|(k, _)| Some(*k) != but) {
            let d = (q.0 - p.0).powi(2) + (q.1 - p.1).powi(2);
            // Several measurements of one place share it: the first stands for all, below.
            if d < best.0 {
                best = (d, k);
            }
        }
        (best.0.sqrt(), best.1)
    };
    let gap = usual((0..places.len()).map(|k| nearest(places[k], Some(k)).0));
    let mut weights = vec![0.0; o.len()];
    for ring in 0..RINGS {
        // Rings of equal area.
        let r = ((ring as f64 + 0.5) / RINGS as f64).sqrt();
        for spoke in 0..SPOKES {
            let phi = 0.5 * TAU * (spoke as f64 + 0.5) / SPOKES as f64;
            let (d, k) = nearest((r * phi.cos(), r * phi.sin()), None);
            if d <= (REACH * gap).max(0.15) {
                weights[k] += std::f64::consts::PI / (RINGS * SPOKES) as f64;
            }
        }
    }
    weights
}

/// A high quantile of distances above 0.
fn usual(all: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = all.filter(|d| *d > 1e-9).collect();
    all.sort_by(f64::total_cmp);
    sunglint_numerics::order::quantile(&all, 0.9).max(1e-6)
}

/// The samples at the peak of an incidence: that nearest to the mirrored direction, and those that are farther from it by less than `cone_rad`. None where
/// no sample lies within `most_rad` of that direction: the table then holds no peak.
///
/// The law is compared with them at their own directions and through the instrument's cone, never at the law's maximum: a table with a step of 1° holds samples of
/// the peak, not the peak. Of several the geometric mean counts, so that a small error of alignment, which raises one and lowers the other, leaves it.
pub fn peak(i: DVec3, o: &[DVec3], cone_rad: f64, most_rad: f64) -> Vec<usize> {
    let mirrored = DVec3::new(-i.x, -i.y, i.z);
    let away: Vec<f64> = o.iter().map(|o| o.angle_between(mirrored)).collect();
    let least = away.iter().copied().fold(f64::INFINITY, f64::min);
    if least > most_rad {
        return Vec::new();
    }
    (0..o.len()).filter(|k| away[*k] <= least + cone_rad + 1e-9).collect()
}
