//! The lit cap of a globe that a body sees, as a few directions that shine.
//!
//! The cap that lies above the body's horizon is one panel or two: where the Sun is above the horizon all around, and where the terminator crosses. In the angle ε between the
//! ground's vertical and the body (from 0 below it to 90° at the limb) and the azimuth, as a share of what is lit, everything is smooth for a Lambert globe: Gauss's rule takes few points.
//!
//! A table of albedos is not smooth. But what a body makes of light from a direction is, all the same. So what multiplies the body's answer at a point of the rule is not the table there, but
//! the integral of the table's light times the polynomial that is 1 at that point and 0 at all others (product integration: Davis and Rabinowitz, Methods of Numerical Integration, 2.5.6): exact
//! where the answer is a polynomial of the rule's degree, whatever the table. It is taken over the table's deviation from its mean over the panel or a piece of it, in bins, of each of which the table says the mean around
//! (`AlbedoGrid::around`). So a table of one value is an even globe, and no light is lost or made; a point may have light below 0, the cap has not.

use super::EarthAlbedo;
use super::grid::AlbedoGrid;
use crate::light::Globe;
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2};
use std::ops::Range;
use sunglint_numerics::gauss::legendre;

/// Bins of a panel: along ε, and around.
const BINS: [usize; 2] = [40, 80];
/// Smaller pieces along each side of a piece of other coordinates than the cap's, for each point of its rule.
const FINER: usize = 4;
/// A piece in which the light ends falls into so many more along each side.
const DIVIDED: usize = 4;
/// Share of the light of such pieces that a side of them has on the wrong side of the edge: half of it at most, 0.29 in the mean square where all err alike.
const EDGE: f64 = 0.15;
/// A table's mean is taken over no more than a square of this side, radians.
const LARGEST_SIDE_RAD: f64 = 0.5;
/// Over less than this the mean is the place's own: the difference of sums that it is found by would be noise.
const SMALLEST_SIDE_RAD: f64 = 1e-5;

/// The lit cap.
#[derive(Debug)]
pub struct LitCap<'a> {
    globe: Globe,
    earth: Option<&'a EarthAlbedo>,
    layers: usize,
    up: DVec3,
    across: [DVec3; 2],
    sun_zenith: f64,
    /// Panels, by ε at their ends; none where nothing lit is seen.
    panels: Vec<[f64; 2]>,
    /// For each panel what its bins have, where the globe has a table.
    bins: Vec<Bins>,
}

/// A part of a panel, in its coordinates from −1 to 1: along ε, and around.
#[derive(Debug, Clone, Copy)]
pub(in crate::light) struct Piece {
    pub panel: usize,
    pub(crate) middle: [f64; 2],
    pub(crate) half: [f64; 2],
}

impl Piece {
    /// Halved along a coordinate.
    pub fn halves(mut self, axis: usize) -> [Self; 2] {
        self.half[axis] *= 0.5;
        [-1.0, 1.0].map(|sign| {
            let mut half = self;
            half.middle[axis] += sign * self.half[axis];
            half
        })
    }

    /// A rule from −1 to 1, along one coordinate of the piece.
    fn mapped(&self, axis: usize, rule: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let (middle, half) = (self.middle[axis], self.half[axis]);
        rule.iter().map(|(t, weight)| (middle + half * t, half * weight)).collect()
    }

    /// The bins whose middles lie in it.
    fn bins(&self) -> [Range<usize>; 2] {
        [0, 1].map(|axis| {
            let first = |at: f64| (0.5 * (at + 1.0) * BINS[axis] as f64 - 0.5).ceil().max(0.0);
            let (middle, half) = (self.middle[axis], self.half[axis]);
            first(middle - half) as usize..(first(middle + half) as usize).min(BINS[axis])
        })
    }
}

/// Where a piece of the cap stands in the sky of the body.
#[derive(Debug, Clone, Copy)]
pub(in crate::light) struct Span {
    /// Middle of the piece, a unit vector in the body's axes.
    pub toward: DVec3,
    /// How far its corners are from there at most, radians.
    pub radius_rad: f64,
    /// The largest radiance at its corners and its middle, of the Sun's irradiance, sr⁻¹, for a globe that reflects all.
    pub radiance: f64,
}

/// Points of a rule over the lit cap.
#[derive(Debug, Clone, Default)]
pub struct Rule {
    /// Directions (unit vectors, the body's axes), and from each the irradiance across it, of the Sun's, for a globe that reflects all.
    pub nodes: Vec<(DVec3, f64)>,
    /// The irradiance of each point in each layer, point by point; none where it is that of a globe that reflects all.
    lights: Vec<f64>,
    layers: usize,
}

impl Rule {
    /// One direction, with its irradiance.
    pub(in crate::light) fn of_one(toward: DVec3, irradiance: f64) -> Self {
        Self { nodes: vec![(toward, irradiance)], ..Self::default() }
    }

    /// The irradiance of a point in each layer, of the Sun's. Of a table it may be below 0; the sum over the points is not.
    pub fn lights(&self, node: usize) -> &[f64] {
        match self.lights.is_empty() {
            true => std::slice::from_ref(&self.nodes[node].1),
            false => &self.lights[node * self.layers..][..self.layers],
        }
    }

    /// The points with the light of one layer.
    pub(in crate::light) fn of_layer(&self, layer: usize) -> Vec<(DVec3, f64)> {
        let lit = |i: usize| (self.nodes[i].0, self.lights(i)[layer]);
        (0..self.nodes.len()).map(lit).collect()
    }
}

/// The light of small pieces of a panel.
#[derive(Debug)]
struct Bins {
    /// The light of each bin for a globe that reflects all, `[polar * around bins + around]`.
    light: Vec<f64>,
    /// The table's mean in each: `[(polar * around bins + around) * layers + layer]`.
    albedo: Vec<f64>,
    layers: usize,
}

/// Values of a table for a piece of a panel.
struct OfTable {
    /// Mean of the table over the piece, by light, in each layer.
    mean: Vec<f64>,
    /// Difference of the light at each point of two rules from that of a globe of the mean: `[(polar * around points + around) * layers + layer]`.
    parts: Vec<f64>,
}

/// Lit ground in a direction.
#[derive(Debug, Clone, Copy)]
struct Seen {
    toward: DVec3,
    /// For each unit of both coordinates.
    solid_angle: f64,
    ground: DVec3,
    radiance: f64,
}

/// A circle of the cap about the point below the body.
struct Ring {
    /// Sine and cosine of the angle at the middle of the globe.
    sin: f64,
    cos: f64,
    /// Sine and cosine of the angle at the body.
    sin_body: f64,
    cos_body: f64,
    /// Solid angle for each unit of the polar coordinate and radian around.
    solid_angle: f64,
    /// Azimuth from the Sun's up to which it is lit, radians.
    lit: f64,
}

impl<'a> LitCap<'a> {
    /// Creates the lit cap of a globe with some albedo.
    pub fn new(globe: &Globe, earth: &'a EarthAlbedo) -> Self {
        let mut cap = Self::even(globe);
        (cap.earth, cap.layers) = (Some(earth), earth.layers());
        if let Some(grid) = earth.grid() {
            cap.bins = (0..cap.panels.len()).map(|p| cap.binned(p, grid)).collect();
        }
        cap
    }

    /// Creates the lit cap of a globe that reflects all; no panels where the body sees nothing lit, or is not outside the globe.
    pub(in crate::light) fn even(globe: &Globe) -> Self {
        let up = -globe.toward;
        let across = globe.sun - up.dot(globe.sun) * up;
        let x = across.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        let sun_zenith = up.angle_between(globe.sun);
        Self {
            globe: *globe,
            earth: None,
            layers: 1,
            up,
            across: [x, up.cross(x)],
            sun_zenith,
            panels: panels(globe, sun_zenith),
            bins: Vec::new(),
        }
    }

    /// How many layers its albedo has.
    pub fn layers(&self) -> usize {
        self.layers
    }

    /// Gauss's rule with `order` points along ε on each panel, and twice as many around.
    pub fn rule(&self, order: usize) -> Rule {
        let mut rule = Rule { layers: self.layers, ..Rule::default() };
        for panel in 0..self.panels.len() {
            let whole = Piece { panel, middle: [0.0; 2], half: [1.0; 2] };
            self.add(&whole, [&legendre(order), &legendre(2 * order)], &mut rule);
        }
        rule
    }

    /// How many panels there are.
    pub(in crate::light) fn panels(&self) -> usize {
        self.panels.len()
    }

    /// The same rule, from −1 to 1, along both coordinates of a piece.
    pub(in crate::light) fn piece(&self, piece: &Piece, points: &[(f64, f64)]) -> Rule {
        let mut rule = Rule { layers: self.layers, ..Rule::default() };
        self.add(piece, [points, points], &mut rule);
        rule
    }

    /// One point of each panel, at two coordinates from −1 to 1, with the irradiance of the whole panel if it were as bright all over: the mean over even coordinates is
    /// the sum of the cap. Its albedo is that of the place itself.
    pub(in crate::light) fn at(&self, [polar, around]: [f64; 2]) -> Rule {
        let mut rule = Rule { layers: self.layers, ..Rule::default() };
        for panel in 0..self.panels.len() {
            let ring = self.ring(panel, polar);
            let (aside, light) = self.light(&ring, around);
            if light > 0.0 {
                rule.nodes.push((ring.toward(self.up, aside), 4.0 * light));
                if let Some(grid) = self.earth.and_then(EarthAlbedo::grid) {
                    let own = grid.at(self.globe.to_ground * ring.ground(self.up, aside));
                    rule.lights.extend(own.iter().map(|albedo| 4.0 * light * f64::from(*albedo)));
                }
            }
        }
        rule
    }

    /// Where a piece stands.
    pub(in crate::light) fn span(&self, piece: &Piece) -> Span {
        let at = |[a, b]: [f64; 2]| {
            let place = |axis: usize, t: f64| piece.middle[axis] + piece.half[axis] * t;
            let ring = self.ring(piece.panel, place(0, a));
            let (aside, _) = self.light(&ring, place(1, b));
            let cos_sun = ring.ground(self.up, aside).dot(self.globe.sun);
            (ring.toward(self.up, aside), FRAC_1_PI * cos_sun.max(0.0))
        };
        let (toward, radiance) = at([0.0; 2]);
        let mut span = Span { toward, radius_rad: 0.0, radiance };
        for corner in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
            let (corner, radiance) = at(corner);
            span.radius_rad = span.radius_rad.max(toward.angle_between(corner));
            span.radiance = span.radiance.max(radiance);
        }
        span
    }

    /// Points of a piece of other coordinates than the cap's: `direction` gives what lies at a place of them, from −1 to 1, and the solid angle for each unit of both. Besides, the share of the
    /// piece's light that may be on the wrong side of an edge.
    ///
    /// The body's answer is smooth there, and the cap is what ends sharply: so here, too, what stands before the answer at a point of the rule is the cap's light times the polynomial of that point,
    /// summed over smaller pieces, of which the two rules that are held against each other have other ones. Where the light ends between neighbours these are divided once more.
    pub(in crate::light) fn seen(
        &self,
        piece: &Piece,
        points: &[(f64, f64)],
        direction: &dyn Fn([f64; 2]) -> Option<(DVec3, f64)>,
    ) -> (Rule, f64) {
        let (n, many) = (points.len(), FINER * points.len());
        let place = |axis: usize, t: f64| piece.middle[axis] + piece.half[axis] * t;
        let measure = 4.0 * piece.half[0] * piece.half[1] / (many * many) as f64;
        let polynomials = basis(points, (&(0..many), many));
        let grid = self.earth.and_then(EarthAlbedo::grid);
        let mut rule = Rule { layers: self.layers, ..Rule::default() };
        let width = grid.map_or(1, |_| self.layers);
        let look = |at: [f64; 2]| -> Option<Seen> {
            let (toward, solid_angle) = direction(at)?;
            let (ground, radiance) = self.ground(toward)?;
            Some(Seen { toward, solid_angle, ground, radiance })
        };
        // With the neighbours around.
        let stride = many + 2;
        let middle_of = |k: usize| (2 * k) as f64 / many as f64 - 1.0 - 1.0 / many as f64;
        let all: Vec<Option<Seen>> = (0..stride * stride)
            .map(|k| look([place(0, middle_of(k / stride)), place(1, middle_of(k % stride))]))
            .collect();
        // Of each ring of small pieces what the polynomials around make of it, then of those what the polynomials along do.
        let (mut own, mut row) = (Vec::new(), vec![0.0; n * width]);
        let mut parts = vec![0.0; n * n * width];
        let (mut light, mut edges) = (0.0, 0.0);
        for i in 0..many {
            row.fill(0.0);
            for j in 0..many {
                let k = (i + 1) * stride + j + 1;
                let lit = all[k].is_some();
                let around = [k - stride, k + stride, k - 1, k + 1];
                let (seen, radiance) = if around.into_iter().any(|k| all[k].is_some() != lit) {
                    let step = |axis: usize, s: usize, m: usize| {
                        let off = (2 * s + 1) as f64 / DIVIDED as f64 - 1.0;
                        place(axis, middle(m, many) + off / many as f64)
                    };
                    let finer = (0..DIVIDED * DIVIDED)
                        .map(|s| look([step(0, s / DIVIDED, i), step(1, s % DIVIDED, j)]));
                    let (mut last, mut sum) = (all[k], 0.0);
                    for seen in finer.flatten() {
                        sum += seen.radiance / (DIVIDED * DIVIDED) as f64;
                        last = last.or(Some(seen));
                    }
                    edges += sum;
                    (last, sum)
                } else {
                    (all[k], all[k].map_or(0.0, |seen| seen.radiance))
                };
                let Some(seen) = seen else { continue };
                light += radiance;
                own.clear();
                match grid {
                    None => own.push(1.0),
                    Some(grid) => {
                        let side = self.side(seen.toward, seen.ground, seen.solid_angle * measure);
                        let ground = self.globe.to_ground * seen.ground;
                        if side > SMALLEST_SIDE_RAD {
                            grid.around(ground, side, &mut own);
                        } else {
                            own.extend(grid.at(ground).iter().map(|albedo| f64::from(*albedo)));
                        }
                    }
                }
                for (k, sums) in row.chunks_exact_mut(width).enumerate() {
                    let light = radiance * measure * polynomials[k * many + j];
                    sums.iter_mut().zip(&own).for_each(|(sum, own)| *sum += light * *own);
                }
            }
            for (k, parts) in parts.chunks_exact_mut(n * width).enumerate() {
                let along = polynomials[k * many + i];
                parts.iter_mut().zip(&row).for_each(|(sum, row)| *sum += along * row);
            }
        }
        for (number, part) in parts.chunks_exact(width).enumerate() {
            let at = [place(0, points[number / n].0), place(1, points[number % n].0)];
            let Some((toward, solid_angle)) = direction(at) else { continue };
            if part.iter().any(|part| *part != 0.0) {
                rule.nodes.push((toward, solid_angle * part[0]));
                if grid.is_some() {
                    rule.lights.extend(part.iter().map(|part| solid_angle * part));
                }
            }
        }
        let vague = if light > 0.0 { EDGE / DIVIDED as f64 * edges / light } else { 0.0 };
        (rule, vague)
    }

    /// The side of a square on the ground that is as large as a solid angle about a direction to it, radians.
    fn side(&self, toward: DVec3, ground: DVec3, solid_angle: f64) -> f64 {
        let globe = &self.globe;
        let away = ground * globe.radius_m + globe.toward * globe.distance_m;
        let area = solid_angle * away.length_squared() / (-ground.dot(toward)).max(1e-3);
        (area.sqrt() / globe.radius_m).min(LARGEST_SIDE_RAD)
    }

    /// The radiance in a direction, of the Sun's irradiance, in each layer \[sr⁻¹\]; none where the globe is not or is dark.
    pub(in crate::light) fn radiance(&self, toward: DVec3) -> Vec<f64> {
        let Some((ground, radiance)) = self.ground(toward) else { return Vec::new() };
        match self.earth.and_then(EarthAlbedo::grid) {
            None => vec![radiance],
            Some(grid) => {
                let own = grid.at(self.globe.to_ground * ground);
                own.iter().map(|albedo| radiance * f64::from(*albedo)).collect()
            }
        }
    }

    /// The lit ground in a direction: its vertical, and its radiance, of the Sun's irradiance, for a globe that reflects all \[sr⁻¹\].
    fn ground(&self, toward: DVec3) -> Option<(DVec3, f64)> {
        let globe = &self.globe;
        let middle = globe.toward * globe.distance_m;
        let along = toward.dot(middle);
        let under = globe.radius_m.powi(2) - (middle - along * toward).length_squared();
        if along <= 0.0 || under <= 0.0 {
            return None;
        }
        let ground = (toward * (along - under.sqrt()) - middle) / globe.radius_m;
        let radiance = FRAC_1_PI * ground.dot(globe.sun);
        (radiance > 0.0).then_some((ground, radiance))
    }

    /// Adds the points of a piece.
    fn add(&self, piece: &Piece, rules: [&[(f64, f64)]; 2], rule: &mut Rule) {
        let [polar, around] = [0, 1].map(|axis| piece.mapped(axis, rules[axis]));
        let table = self.bins.get(piece.panel).map(|bins| bins.of(piece, [&polar, &around]));
        let grid = self.earth.and_then(EarthAlbedo::grid);
        for (i, (t, weight)) in polar.iter().enumerate() {
            let ring = self.ring(piece.panel, *t);
            for (j, (s, share)) in around.iter().enumerate() {
                let (aside, light) = self.light(&ring, *s);
                let light = light * weight * share;
                if light <= 0.0 {
                    continue;
                }
                rule.nodes.push((ring.toward(self.up, aside), light));
                match (&table, grid) {
                    (Some(Some(table)), _) => {
                        let own = table.parts[(i * around.len() + j) * self.layers..].iter();
                        rule.lights.extend(table.mean.iter().zip(own).map(|(m, p)| m * light + p));
                    }
                    // Smaller than a bin: as bright as the place.
                    (Some(None), Some(grid)) => {
                        let own = grid.at(self.globe.to_ground * ring.ground(self.up, aside));
                        rule.lights.extend(own.iter().map(|albedo| light * f64::from(*albedo)));
                    }
                    _ => {}
                }
            }
        }
    }

    /// The ring of a panel at a coordinate from −1 to 1.
    fn ring(&self, panel: usize, t: f64) -> Ring {
        let [from, to] = self.panels[panel];
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let ratio = self.globe.radius_m / self.globe.distance_m;
        // In the angle ε at the ground everything is smooth, at the limb too: sin η = (r/d) sin ε at the body, ψ = ε − η between.
        let (sin_ground, cos_ground) = (middle + half * t).sin_cos();
        let sin_body = ratio * sin_ground;
        let cos_body = ((1.0 - sin_body) * (1.0 + sin_body)).sqrt();
        let sin = sin_ground * cos_body - cos_ground * sin_body;
        let cos = cos_ground * cos_body + sin_ground * sin_body;
        // Lit where cos ψ cos z + sin ψ sin z cos φ > 0.
        let edge =
            -(cos * self.sun_zenith.cos()) / (sin * self.sun_zenith.sin()).max(f64::MIN_POSITIVE);
        let lit = edge.clamp(-1.0, 1.0).acos();
        let solid_angle = half * sin_body * ratio * cos_ground / cos_body;
        Ring { sin, cos, sin_body, cos_body, solid_angle, lit }
    }

    /// The azimuth of a point of a ring at a coordinate from −1 to 1, as a unit vector, and its irradiance for each unit of both coordinates.
    fn light(&self, ring: &Ring, s: f64) -> (DVec3, f64) {
        let (y_part, x_part) = (ring.lit * s).sin_cos();
        let aside = x_part * self.across[0] + y_part * self.across[1];
        let cos_sun = (ring.cos * self.up + ring.sin * aside).dot(self.globe.sun);
        (aside, FRAC_1_PI * cos_sun * ring.solid_angle * ring.lit)
    }

    /// The bins of a panel.
    fn binned(&self, panel: usize, grid: &AlbedoGrid) -> Bins {
        let [rows, columns] = BINS;
        let measure = 4.0 / (rows * columns) as f64;
        let mut bins = Bins {
            light: Vec::with_capacity(rows * columns),
            albedo: Vec::with_capacity(rows * columns * self.layers),
            layers: self.layers,
        };
        for i in 0..rows {
            let ring = self.ring(panel, middle(i, rows));
            let ends =
                [i as f64, (i + 1) as f64].map(|e| self.ring(panel, 2.0 * e / rows as f64 - 1.0));
            let tall = ends[1].sin.atan2(ends[1].cos) - ends[0].sin.atan2(ends[0].cos);
            // The side of a square as large as the bin.
            let side = (tall * ring.sin * 2.0 * ring.lit / columns as f64).max(0.0).sqrt();
            for j in 0..columns {
                let (aside, light) = self.light(&ring, middle(j, columns));
                bins.light.push(measure * light.max(0.0));
                let ground = self.globe.to_ground * ring.ground(self.up, aside);
                grid.around(ground, side, &mut bins.albedo);
            }
        }
        bins
    }
}

impl Ring {
    fn toward(&self, up: DVec3, aside: DVec3) -> DVec3 {
        self.sin_body * aside - self.cos_body * up
    }

    /// The ground's vertical.
    fn ground(&self, up: DVec3, aside: DVec3) -> DVec3 {
        self.cos * up + self.sin * aside
    }
}

impl Bins {
    /// Returns the table's values for a piece at the points of two rules; `None` where no bin lies in it, or none that is lit.
    fn of(&self, piece: &Piece, [polar, around]: [&[(f64, f64)]; 2]) -> Option<OfTable> {
        let (layers, [rows, columns]) = (self.layers, piece.bins());
        let at = |i: usize, j: usize| i * BINS[1] + j;
        let albedo = |i: usize, j: usize| &self.albedo[at(i, j) * layers..][..layers];
        let (mut mean, mut all) = (vec![0.0; layers], 0.0);
        for (i, j) in rows.clone().flat_map(|i| columns.clone().map(move |j| (i, j))) {
            let light = self.light[at(i, j)];
            mean.iter_mut().zip(albedo(i, j)).for_each(|(m, a)| *m += light * a);
            all += light;
        }
        if all <= 0.0 {
            return None;
        }
        mean.iter_mut().for_each(|m| *m /= all);
        let [along, about] = [basis(polar, (&rows, BINS[0])), basis(around, (&columns, BINS[1]))];
        let (n, m) = (polar.len(), around.len());
        let mut parts = vec![0.0; n * m * layers];
        let mut row = vec![0.0; columns.len() * layers];
        for i in 0..n {
            row.fill(0.0);
            for (b, bin) in rows.clone().enumerate() {
                let part = along[i * rows.len() + b];
                for (sums, j) in row.chunks_exact_mut(layers).zip(columns.clone()) {
                    let light = part * self.light[at(bin, j)];
                    let off = albedo(bin, j).iter().zip(&mean);
                    sums.iter_mut()
                        .zip(off)
                        .for_each(|(sum, (a, mean))| *sum += light * (a - mean));
                }
            }
            for (j, part) in parts[i * m * layers..].chunks_exact_mut(layers).take(m).enumerate() {
                for (b, off) in row.chunks_exact(layers).enumerate() {
                    let own = about[j * columns.len() + b];
                    part.iter_mut().zip(off).for_each(|(sum, off)| *sum += own * off);
                }
            }
        }
        Some(OfTable { mean, parts })
    }
}

/// The middle of one of some even bins from −1 to 1.
fn middle(bin: usize, of: usize) -> f64 {
    (2 * bin + 1) as f64 / of as f64 - 1.0
}

/// The polynomials that are 1 at one point of a rule and 0 at the others, at the middles of some of even bins: `[point * bins + bin]`.
fn basis(rule: &[(f64, f64)], (bins, of): (&Range<usize>, usize)) -> Vec<f64> {
    let value = |i: usize, x: f64| {
        let others = rule.iter().enumerate().filter(|(k, _)| *k != i);
        others.map(|(_, (t, _))| (x - t) / (rule[i].0 - t)).product::<f64>()
    };
    (0..rule.len())
        .flat_map(|i| bins.clone().map(move |b| (i, middle(b, of))))
        .map(|(i, x)| value(i, x))
        .collect()
}

/// The panels of the lit cap: ε from the point below the body, or where the night ends, to the limb.
fn panels(globe: &Globe, sun_zenith: f64) -> Vec<[f64; 2]> {
    let (r, d) = (globe.radius_m, globe.distance_m);
    if !(d > r && r > 0.0) {
        return Vec::new();
    }
    // Central angle from the point below the body to the terminator; the angle at which that is seen, from the ground's vertical.
    let terminator = (FRAC_PI_2 - sun_zenith).abs();
    let seen = (d * terminator.sin()).atan2(d * terminator.cos() - r);
    let night_below = sun_zenith > FRAC_PI_2;
    if night_below && seen >= FRAC_PI_2 {
        return Vec::new();
    }
    let mut edges = vec![if night_below { seen } else { 0.0 }];
    if seen > edges[0] && seen < FRAC_PI_2 {
        edges.push(seen);
    }
    edges.push(FRAC_PI_2);
    edges.windows(2).map(|e| [e[0], e[1]]).collect()
}
