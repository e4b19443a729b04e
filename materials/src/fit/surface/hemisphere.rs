//! The two figures of a measured incidence that a fit must keep: its hemispherical reflectance and its peak.

mod triangles;

use crate::samples::turned;
use glam::DVec3;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use sunglint_numerics::gauss::legendre;
use triangles::Triangles;

/// Directions whose bisector lies this near the plane of incidence (y of a unit vector) are in it.
const IN_PLANE: f64 = 2e-3;
/// Light this near the normal (sine of its angle) has no sides.
const UPRIGHT: f64 = 1e-9;
/// Directions closer than this, in direction cosines, are one.
const SAME: f64 = 1e-6;
/// Rings and spokes about the mirrored direction over which samples out of the plane are summed.
const RINGS: usize = 160;
const SPOKES: usize = 72;
/// A sample stands for nothing farther away than this many times the typical distance of neighbours.
const REACH: f64 = 2.0;
/// Out of the plane, and for nothing farther away than this, in direction cosines, where that is more.
const LEAST_REACH: f64 = 0.15;
/// Values below this part of the largest have no logarithm of their own: they are taken as this part.
const LEAST_PART: f64 = 1e-9;
/// Two rules of interpolation whose sums differ by more than this, as a logarithm, do not resolve the peak.
const MOST_LN_DOUBT: f64 = 0.3;
/// Beyond this nothing is known of the reflectance.
const UNKNOWN_LN: f64 = 1.1;

/// Hemispherical reflectance of one incidence: the weight of each sample, and how well the samples decide it.
///
/// Projected on the surface, the hemisphere is a disc of radius 1 in which cosθ_o dω_o is the area. Between the samples ln f is interpolated in ln(1 + (r/r₀)²), with r the distance from
/// the mirrored direction in that disc and r₀ the distance of the samples there: constant values, powers of r and the rounded top of a lobe are all met, so that samples whose distances grow
/// outwards by factors are enough. Samples in the plane of incidence alone share the disc in rings about the mirrored direction, each on its own side; with light along the normal in whole
/// rings; samples out of that plane by the triangles between neighbours. Interpolation cuts the curve of a lobe off and the value of the nearest sample overshoots it, so the mean of both
/// counts. What is farther from every sample than twice their usual distance is left out.
#[derive(Debug, Clone)]
pub struct Hemisphere {
    /// Σ wₖ fₖ is the hemispherical reflectance of the samples that it was made from. The weights are derivatives, so that the sum of values that differ little from these is their reflectance.
    pub weights: Vec<f64>,
    /// The part of the hemisphere that the samples stand for, 0 to 1.
    pub coverage: f64,
    /// How far the reflectance may be off, as a logarithm, because values between the samples are not known: the difference of two rules of interpolation; the difference of the shapes that a
    /// peak may have which falls steeply to the next sample; the rise that the slope of the nearest samples lets expect at a mirrored direction that none of them meets (infinite where that
    /// rise has no end); and, for samples in the plane of incidence alone, the difference that it makes whether values out of it follow the distance from the mirrored direction or the
    /// tilt of the bisector, as those of microfacets do.
    pub ln_doubt: f64,
    /// The part of it that the distances between the samples make.
    apart_ln: f64,
}

impl Hemisphere {
    /// Weighs samples at the directions `o` with light from `i`.
    pub fn new(i: DVec3, o: &[DVec3], value: &[f64]) -> Self {
        let turned: Vec<DVec3> = o.iter().map(|o| turned(i, *o).1).collect();
        let x = i.x.hypot(i.y);
        let flat = turned.iter().all(|o| o.y.abs() < IN_PLANE);
        // Distances along and across the plane of incidence, from the mirrored direction.
        let places = turned.iter().map(|o| (o.x + x, if flat { 0.0 } else { o.y.abs() }));
        let nodes = Nodes::new(places, value);
        let mut sum = Sum::new(&nodes);
        if x < UPRIGHT {
            upright(&nodes, &mut sum);
        } else if flat {
            rings(x, &nodes, &mut sum);
        } else {
            cells(x, &nodes, &mut sum);
        }
        let (weights, coverage) = (nodes.weights(&sum.by_ln), sum.area / PI);
        let known = sum.between > 0.0;
        let between = if known { (sum.nearest / sum.between).ln().abs() } else { 0.0 };
        let whole = 0.5 * (sum.between + sum.nearest);
        let apart_ln = between + nodes.shape_inside(&sum.by_ln, whole) + nodes.rise_inside(whole);
        let across = if flat && x >= UPRIGHT { across(i.z, x, &nodes) } else { 0.0 };
        Self { weights, coverage, ln_doubt: apart_ln + across, apart_ln }
    }

    /// Whether the samples are close enough to one another for their peak.
    pub fn is_resolved(&self) -> bool {
        self.apart_ln <= MOST_LN_DOUBT
    }

    /// Whether the sum says anything of the reflectance: to a factor of three.
    pub fn is_known(&self) -> bool {
        self.apart_ln <= UNKNOWN_LN
    }

    /// The sum of these values.
    pub fn of(&self, value: &[f64]) -> f64 {
        self.weights.iter().zip(value).map(|(w, v)| w * v).sum()
    }
}

/// Places that were measured, each once.
struct Nodes {
    at: Vec<(f64, f64)>,
    ln: Vec<f64>,
    /// The node of each sample, the sample's value, and how many samples a node has.
    of: Vec<usize>,
    value: Vec<f64>,
    count: Vec<f64>,
    /// r₀.
    near: f64,
}

impl Nodes {
    fn new(places: impl Iterator<Item = (f64, f64)>, value: &[f64]) -> Self {
        let least = LEAST_PART * value.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let value: Vec<f64> = value.iter().map(|v| v.max(least)).collect();
        let mut made = Self {
            at: Vec::new(),
            ln: Vec::new(),
            of: Vec::new(),
            count: Vec::new(),
            value,
            near: 1.0,
        };
        let mut known = BTreeMap::new();
        for (k, place) in places.enumerate() {
            let key = |v: f64| (v / SAME).round() as i64;
            let node = *known.entry((key(place.0), key(place.1))).or_insert(made.at.len());
            if node == made.at.len() {
                made.at.push(place);
                made.ln.push(0.0);
                made.count.push(0.0);
            }
            made.of.push(node);
            made.ln[node] += made.value[k].ln();
            made.count[node] += 1.0;
        }
        made.ln.iter_mut().zip(&made.count).for_each(|(ln, count)| *ln /= count);
        // The distance of the innermost from its neighbour, or from the mirrored direction.
        let radius = |k: &usize| made.at[*k].0.hypot(made.at[*k].1);
        if let Some(inner) = (0..made.at.len()).min_by(|a, b| radius(a).total_cmp(&radius(b))) {
            let (x, y) = made.at[inner];
            let apart = |k: usize| (made.at[k].0 - x).hypot(made.at[k].1 - y);
            let others = (0..made.at.len()).filter(|k| *k != inner).map(apart);
            let least = others.fold(f64::INFINITY, f64::min);
            let near = if least.is_finite() { least } else { 0.0 };
            made.near = near.max(radius(&inner)).clamp(1e-6, 1.0);
        }
        made
    }

    /// The coordinate in which ln f is interpolated.
    fn warped(&self, r: f64) -> f64 {
        0.5 * (r / self.near).powi(2).ln_1p()
    }

    fn weights(&self, by_ln: &[f64]) -> Vec<f64> {
        let one = |(k, v): (&usize, &f64)| by_ln[*k] / (self.count[*k] * v);
        self.of.iter().zip(&self.value).map(one).collect()
    }

    /// The logarithm by which the reflectance may differ from `whole` by the shape of a peak that falls by a factor D to the next sample, at a distance h: a Gaussian through both holds
    /// πh²f/ln D, the distribution (1 + r²/w²)⁻² of GGX πh²f/(√D − 1).
    fn shape_inside(&self, by_ln: &[f64], whole: f64) -> f64 {
        let Some(top) = (0..self.ln.len()).max_by(|a, b| self.ln[*a].total_cmp(&self.ln[*b]))
        else {
            return 0.0;
        };
        let (x, y) = self.at[top];
        let apart = |k: usize| (self.at[k].0 - x).hypot(self.at[k].1 - y);
        let others = || (0..self.ln.len()).filter(|k| *k != top);
        let near = 1.5 * others().map(apart).fold(f64::INFINITY, f64::min);
        let next = others().filter(|k| apart(*k) <= near).map(|k| self.ln[k]);
        let next = next.fold(f64::NEG_INFINITY, f64::max);
        let fall = self.ln[top] - next;
        if !(fall.is_finite() && fall > 0.0 && whole > 0.0) {
            return 0.0;
        }
        let shapes = ((0.5 * fall).exp_m1() / fall).max(1.0);
        (by_ln[top] / whole * (shapes - 1.0)).max(0.0).ln_1p()
    }

    /// The logarithm by which the reflectance may be more than `whole` because values rise towards a mirrored direction that was not met as a power of the distance, as between the innermost
    /// sample and those at twice its distance.
    fn rise_inside(&self, whole: f64) -> f64 {
        let radius = |k: usize| self.at[k].0.hypot(self.at[k].1);
        let by_radius = |a: &usize, b: &usize| radius(*a).total_cmp(&radius(*b));
        let Some(inner) = (0..self.at.len()).min_by(by_radius) else { return 0.0 };
        let r = radius(inner);
        if r < 0.1 * self.near || whole <= 0.0 {
            return 0.0;
        }
        let outer = (0..self.at.len()).filter(|k| radius(*k) >= 2.0 * r).min_by(by_radius);
        let Some(outer) = outer else { return 0.0 };
        let power = (self.ln[inner] - self.ln[outer]) / (radius(outer) / r).ln();
        let flat = PI * r * r * self.ln[inner].exp() / whole;
        if power >= 2.0 {
            // Nothing bounds it; a part of a thousandth, ten times as bright, would not matter.
            return if flat < 1e-3 { 0.0 } else { f64::INFINITY };
        }
        (flat * power.max(0.0) / (2.0 - power)).ln_1p()
    }
}

/// The quantity that is summed over the disc.
struct Sum<'a> {
    ln: &'a [f64],
    /// Derivatives of the reflectance by ln f of the nodes.
    by_ln: Vec<f64>,
    /// The reflectance by interpolation, and by the value of the nearest node.
    between: f64,
    nearest: f64,
    area: f64,
}

impl<'a> Sum<'a> {
    fn new(nodes: &'a Nodes) -> Self {
        let by_ln = vec![0.0; nodes.ln.len()];
        Self { ln: &nodes.ln, by_ln, between: 0.0, nearest: 0.0, area: 0.0 }
    }

    /// Adds a piece of the disc whose ln f is that of nodes with these weights.
    fn add(&mut self, area: f64, parts: &[(usize, f64)]) {
        let f = parts.iter().map(|(k, w)| w * self.ln[*k]).sum::<f64>().exp();
        for (k, w) in parts {
            self.by_ln[*k] += 0.5 * area * f * w;
        }
        if let Some((k, _)) = parts.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
            let f = self.ln[*k].exp();
            self.by_ln[*k] += 0.5 * area * f;
            self.nearest += area * f;
        }
        self.between += area * f;
        self.area += area;
    }
}

/// Adds the area between two places on a line, `element(s) ds`, by the two nodes that are given with their coordinates.
fn stretch(
    sum: &mut Sum<'_>,
    (from, to): (f64, f64),
    nodes: [(usize, f64); 2],
    coordinate: impl Fn(f64) -> f64,
    element: impl Fn(f64) -> f64,
) {
    const PANELS: usize = 6;
    if to <= from {
        return;
    }
    let rule = legendre(4);
    let [(a, at_a), (b, at_b)] = nodes;
    let half = 0.5 * (to - from) / PANELS as f64;
    for panel in 0..PANELS {
        let middle = from + half * (2 * panel + 1) as f64;
        for (t, w) in &rule {
            let s = middle + t * half;
            let part = if at_b > at_a {
                ((coordinate(s) - at_a) / (at_b - at_a)).clamp(0.0, 1.0)
            } else {
                0.0
            };
            sum.add(w * half * element(s), &[(a, 1.0 - part), (b, part)]);
        }
    }
}

/// In whole rings about the normal, by the distance from it.
fn upright(nodes: &Nodes, sum: &mut Sum<'_>) {
    // The nodes are turned to one side already.
    along(nodes, sum, (0.0, 1.0), |r| nodes.warped(r), |r| TAU * r, &[]);
}

/// By the place along the plane of incidence, from the mirrored direction.
fn rings(x: f64, nodes: &Nodes, sum: &mut Sum<'_>) {
    let rim = 1.0 - x;
    let coordinate = |s: f64| nodes.warped(s.abs()).copysign(s);
    // The arc on the side of s, inside the disc, times its radius. It has a kink where it meets the rim of the disc.
    let element = |s: f64| {
        let r = s.abs();
        if r <= rim {
            return r * PI;
        }
        // Beyond the nearer rim only the far side is left, and all of the arc is its.
        r * 2.0 * ((r * r + x * x - 1.0) / (2.0 * r * x)).clamp(-1.0, 1.0).acos()
    };
    along(nodes, sum, (x - 1.0, x + 1.0), coordinate, element, &[-rim, 0.0, rim]);
}

/// The doubt of ln of the reflectance that samples in the plane of incidence leave: values out of it are taken as those of the same tilt of the bisector in it, and as those of the same distance from
/// the mirrored direction. Both rules are summed over the same directions, as far as the samples reach.
fn across(cos_i: f64, x: f64, nodes: &Nodes) -> f64 {
    let mut order: Vec<usize> = (0..nodes.at.len()).collect();
    order.sort_by(|a, b| nodes.at[*a].0.total_cmp(&nodes.at[*b].0));
    let (Some(first), Some(last)) = (order.first(), order.last()) else { return 0.0 };
    let (least, most) = (nodes.at[*first].0, nodes.at[*last].0);
    let value = |s: f64| {
        let next = order.partition_point(|k| nodes.at[*k].0 < s).clamp(1, order.len() - 1);
        let (a, b) = (order[next - 1], order[next]);
        let [from, at, to] =
            [nodes.at[a].0, s, nodes.at[b].0].map(|s| nodes.warped(s.abs()).copysign(s));
        let part = if to > from { ((at - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        (nodes.ln[a] + part * (nodes.ln[b] - nodes.ln[a])).exp()
    };
    if order.len() < 2 {
        return 0.0;
    }
    let theta_i = x.atan2(cos_i);
    let (mut by_distance, mut by_tilt) = (0.0, 0.0);
    pieces(x, nodes, |Piece { sin, cos, r, area, .. }| {
        let (o_x, o_y) = (r * cos - x, r * sin);
        let o_z = (1.0 - o_x * o_x - o_y * o_y).max(0.0).sqrt();
        let (h_x, h_z) = (o_x + x, o_z + cos_i);
        let tilt = h_x.hypot(o_y).atan2(h_z);
        let towards = (theta_i - 2.0 * tilt).sin();
        let beyond = theta_i + 2.0 * tilt;
        // s < 0 is beyond the mirrored direction, as seen from the normal.
        let s = if h_x < 0.0 && beyond < 0.5 * PI { x - beyond.sin() } else { x - towards };
        if s < least || s > most || r > most {
            return;
        }
        by_tilt += area * value(s);
        by_distance += area * value(if cos < 0.0 && -r >= least { -r } else { r });
    });
    if by_distance > 0.0 && by_tilt > 0.0 { (by_tilt / by_distance).ln().abs() } else { 0.0 }
}

/// Shares a line among its nodes.
fn along(
    nodes: &Nodes,
    sum: &mut Sum<'_>,
    (low, high): (f64, f64),
    coordinate: impl Fn(f64) -> f64,
    element: impl Fn(f64) -> f64,
    kinks: &[f64],
) {
    let s = |k: usize| nodes.at[k].0;
    let mut order: Vec<usize> = (0..nodes.at.len()).collect();
    order.sort_by(|a, b| s(*a).total_cmp(&s(*b)));
    let (Some(first), Some(last)) = (order.first(), order.last()) else { return };
    let gap = usual(order.windows(2).map(|w| s(w[1]) - s(w[0])));
    let mut add = |from: f64, to: f64, nodes: [(usize, f64); 2]| {
        let (from, to) = (from.max(low), to.min(high));
        let mut edges = vec![from];
        edges.extend(kinks.iter().copied().filter(|e| *e > from && *e < to));
        edges.push(to);
        for w in edges.windows(2) {
            stretch(sum, (w[0], w[1]), nodes, &coordinate, &element);
        }
    };
    let reach = REACH * gap;
    // A disc about the normal goes to its middle; elsewhere an end stands for half a gap beyond.
    let begin = if low == 0.0 { s(*first).min(reach) } else { 0.5 * gap };
    add(s(*first) - begin, s(*first), [(*first, 0.0); 2]);
    for w in order.windows(2) {
        let (a, b) = (w[0], w[1]);
        let ends = [(a, coordinate(s(a))), (b, coordinate(s(b)))];
        if s(b) - s(a) > 2.0 * reach {
            add(s(a), s(a) + reach, ends);
            add(s(b) - reach, s(b), ends);
        } else {
            add(s(a), s(b), ends);
        }
    }
    add(s(*last), s(*last) + 0.5 * gap, [(*last, 0.0); 2]);
}

/// By the triangles between samples out of the plane of incidence, on one side of it: the other is the same.
fn cells(x: f64, nodes: &Nodes, sum: &mut Sum<'_>) {
    let apart = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).hypot(a.1 - b.1);
    let nearest = |p: (f64, f64), but: Option<usize>| {
        let others = nodes.at.iter().enumerate().filter(|(k, _)| Some(*k) != but);
        others.fold((f64::INFINITY, 0), |best, (k, q)| {
            let d = apart(*q, p);
            if d < best.0 { (d, k) } else { best }
        })
    };
    let gap = usual((0..nodes.at.len()).map(|k| nearest(nodes.at[k], Some(k)).0));
    let reach = (REACH * gap).max(LEAST_REACH);
    let warped = |(x, y): (f64, f64)| {
        let r = x.hypot(y);
        let times = if r > 0.0 { nodes.warped(r) / r } else { 0.0 };
        (x * times, y * times)
    };
    // Both sides of the plane: so that neighbours across it are neighbours.
    let mut corners: Vec<(usize, (f64, f64))> = Vec::new();
    for (k, at) in nodes.at.iter().enumerate() {
        let (u, v) = warped(*at);
        corners.push((k, (u, v)));
        if at.1 > SAME {
            corners.push((k, (u, -v)));
        }
    }
    let places: Vec<(f64, f64)> = corners.iter().map(|c| c.1).collect();
    let mut triangles = Triangles::new(&places);
    pieces(x, nodes, |Piece { sin, cos, r, u, area }| {
        let (distance, k) = nearest((r * cos, r * sin), None);
        if distance > reach {
            return;
        }
        match triangles.at((u * cos, u * sin)) {
            Some(parts) => sum.add(area, &parts.map(|(corner, w)| (corners[corner].0, w))),
            None => sum.add(area, &[(k, 1.0)]),
        }
    });
}

/// A piece of the disc on one side of the plane of incidence and its mirror image: its middle in polar coordinates about the mirrored direction, with the distance as it is and as ln f is
/// interpolated in it, and the area of both.
struct Piece {
    sin: f64,
    cos: f64,
    r: f64,
    u: f64,
    area: f64,
}

/// Divides the disc into rings and spokes about the mirrored direction, at x before its middle.
fn pieces(x: f64, nodes: &Nodes, mut look: impl FnMut(Piece)) {
    for spoke in 0..SPOKES {
        let (sin, cos) = (PI * (spoke as f64 + 0.5) / SPOKES as f64).sin_cos();
        let rim = x * cos + (1.0 - (x * sin).powi(2)).max(0.0).sqrt();
        let step = nodes.warped(rim) / RINGS as f64;
        let radius = |u: f64| nodes.near * (2.0 * u).exp_m1().max(0.0).sqrt();
        for ring in 0..RINGS {
            let u = step * (ring as f64 + 0.5);
            let (inner, outer) = (radius(step * ring as f64), radius(step * (ring + 1) as f64));
            let area = (outer * outer - inner * inner) * PI / SPOKES as f64;
            look(Piece { sin, cos, r: radius(u), u, area });
        }
    }
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
