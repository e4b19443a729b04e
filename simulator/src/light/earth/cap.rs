//! The lit cap of a globe that a body sees, as a few directions that shine.
//!
//! The cap that lies above the body's horizon is one panel or two: where the Sun is above the horizon all around, and where the terminator crosses. In the angle ε between the
//! ground's vertical and the body (from 0 below it to 90° at the limb) and the azimuth, as a share of what is lit, everything is smooth for a Lambert globe: Gauss's rule takes few points.
//!
//! A table of albedos is not smooth. But what a body makes of light from a direction is, all the same: so each point of the rule stands for a piece of the cap (Gauss's weights
//! divide the panel: the piece between the sums of the weights before a point and with it holds the point), and its share in a layer is the mean of the table over the piece,
//! weighted with the light of an even globe. That mean is taken from bins that are finer than the table's cells where the cap has room for them. No light is lost or made by
//! it, no share leaves the range of the table, and a table of one value is an even globe.

use super::EarthAlbedo;
use crate::light::Globe;
use crate::surface::rule::legendre;
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Bins along each side of a panel for each cell of a table, and the least and the most of them: along ε, and around.
const BINS_A_CELL: f64 = 1.5;
const POLAR_BINS: (f64, f64) = (24.0, 64.0);
const AROUND_BINS: (f64, f64) = (48.0, 128.0);

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

/// Points of a rule over the lit cap.
#[derive(Debug, Clone, Default)]
pub struct Rule {
    /// Directions (unit vectors, the body's axes), and from each the irradiance across it, of the Sun's, for a globe that reflects all.
    pub nodes: Vec<(DVec3, f64)>,
    /// The part of that in each layer, point by point; none where it is 1.
    shares: Vec<f64>,
    layers: usize,
}

impl Rule {
    /// One direction, with its irradiance.
    pub(in crate::light) fn of_one(toward: DVec3, irradiance: f64) -> Self {
        Self { nodes: vec![(toward, irradiance)], ..Self::default() }
    }

    /// The part of the light of a point that each layer has.
    pub fn shares(&self, node: usize) -> &[f64] {
        if self.shares.is_empty() {
            &[1.0]
        } else {
            &self.shares[node * self.layers..][..self.layers]
        }
    }

    /// The points with the light of one layer.
    pub(in crate::light) fn of_layer(&self, layer: usize) -> Vec<(DVec3, f64)> {
        let lit =
            |(i, (toward, light)): (usize, &(DVec3, f64))| (*toward, light * self.shares(i)[layer]);
        self.nodes.iter().enumerate().map(lit).collect()
    }
}

/// The light of small pieces of a panel: of an even globe that reflects all, and in each layer.
#[derive(Debug)]
struct Bins {
    polar: usize,
    around: usize,
    /// `[(polar * around bins + around) * (1 + layers)]`.
    light: Vec<f64>,
}

/// A circle of the cap about the point below the body.
struct Ring {
    /// Of the angle at the middle of the globe.
    sin: f64,
    cos: f64,
    /// Of the angle at the body.
    sin_body: f64,
    cos_body: f64,
    /// Solid angle for each unit of the polar coordinate and radian around.
    solid_angle: f64,
    /// Azimuth from the Sun's up to which it is lit, radians.
    lit: f64,
}

impl<'a> LitCap<'a> {
    /// Of a globe with some albedo.
    pub fn new(globe: &Globe, earth: &'a EarthAlbedo) -> Self {
        let mut cap = Self::even(globe);
        (cap.earth, cap.layers) = (Some(earth), earth.layers());
        if let Some(grid) = earth.grid() {
            cap.bins = (0..cap.panels.len()).map(|p| cap.binned(p, grid.finest())).collect();
        }
        cap
    }

    /// Of a globe that reflects all; no panels where the body sees nothing lit, or is not outside the globe.
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
        self.over(&legendre(order), &legendre(2 * order))
    }

    /// One point of each panel, at two coordinates from −1 to 1, with the irradiance of the whole panel if it were as bright all over: the mean over even coordinates is
    /// the sum of the cap. Its shares are those of the place itself.
    pub(in crate::light) fn at(&self, [polar, around]: [f64; 2]) -> Rule {
        let mut rule = Rule { layers: self.layers, ..Rule::default() };
        for panel in 0..self.panels.len() {
            let ring = self.ring(panel, polar);
            let (aside, light) = self.light(&ring, around);
            if light > 0.0 {
                rule.nodes.push((ring.toward(self.up, aside), 4.0 * light));
                self.push_place(&mut rule.shares, ring.ground(self.up, aside));
            }
        }
        rule
    }

    fn over(&self, polar: &[(f64, f64)], around: &[(f64, f64)]) -> Rule {
        let mut rule = Rule { layers: self.layers, ..Rule::default() };
        for panel in 0..self.panels.len() {
            let means = self.bins.get(panel).map(|bins| bins.means(polar, around, self.layers));
            for (i, (t, weight)) in polar.iter().enumerate() {
                let ring = self.ring(panel, *t);
                for (j, (s, share)) in around.iter().enumerate() {
                    let (aside, light) = self.light(&ring, *s);
                    if light <= 0.0 {
                        continue;
                    }
                    rule.nodes.push((ring.toward(self.up, aside), light * weight * share));
                    let Some(means) = &means else { continue };
                    let own = &means[(i * around.len() + j) * self.layers..][..self.layers];
                    // A piece of no light says nothing; its point does.
                    match own.iter().any(|m| m.is_nan()) {
                        true => self.push_place(&mut rule.shares, ring.ground(self.up, aside)),
                        false => rule.shares.extend(own),
                    }
                }
            }
        }
        rule
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

    /// Adds the shares of a place on the ground.
    fn push_place(&self, shares: &mut Vec<f64>, ground: DVec3) {
        if let Some(grid) = self.earth.and_then(EarthAlbedo::grid) {
            let own = grid.at(self.globe.to_ground * ground);
            shares.extend(own.iter().map(|v| f64::from(*v)));
        }
    }

    /// The bins of a panel, for cells of some size (radians).
    fn binned(&self, panel: usize, cell: f64) -> Bins {
        let [first, last] = [-1.0, 1.0].map(|t| self.ring(panel, t));
        let wide = last.sin.atan2(last.cos) - first.sin.atan2(first.cos);
        let number = |span: f64, (least, most): (f64, f64)| {
            (BINS_A_CELL * span / cell).ceil().clamp(least, most) as usize
        };
        let polar = number(wide, POLAR_BINS);
        let around = number(TAU * last.sin.abs(), AROUND_BINS);
        let middle = |k: usize, of: usize| (2 * k + 1) as f64 / of as f64 - 1.0;
        let (mut light, mut shares) =
            (Vec::with_capacity(polar * around * (1 + self.layers)), Vec::new());
        for i in 0..polar {
            let ring = self.ring(panel, middle(i, polar));
            for j in 0..around {
                let (aside, lit) = self.light(&ring, middle(j, around));
                let lit = lit.max(0.0);
                shares.clear();
                self.push_place(&mut shares, ring.ground(self.up, aside));
                light.push(lit);
                light.extend(shares.iter().map(|share| lit * share));
            }
        }
        Bins { polar, around, light }
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
    /// Mean shares over the pieces of the points of two rules: `[(polar * around points + around) * layers + layer]`; NaN where a piece has no light.
    fn means(&self, polar: &[(f64, f64)], around: &[(f64, f64)], layers: usize) -> Vec<f64> {
        let (rows, columns) = (owners(polar, self.polar), owners(around, self.around));
        let mut sums = vec![0.0; polar.len() * around.len() * (1 + layers)];
        for (row, bins) in rows.iter().zip(self.light.chunks_exact(self.around * (1 + layers))) {
            for (column, bin) in columns.iter().zip(bins.chunks_exact(1 + layers)) {
                let piece = (row * around.len() + column) * (1 + layers);
                sums[piece..].iter_mut().zip(bin).for_each(|(sum, light)| *sum += light);
            }
        }
        let mean =
            |piece: &[f64]| piece[1..].iter().map(|light| light / piece[0]).collect::<Vec<_>>();
        sums.chunks_exact(1 + layers).flat_map(mean).collect()
    }
}

/// For each of some even bins from −1 to 1 the point of a rule that it belongs to.
fn owners(rule: &[(f64, f64)], bins: usize) -> Vec<usize> {
    let mut end = -1.0 + rule[0].1;
    let mut point = 0;
    let middles = (0..bins).map(|k| (2 * k + 1) as f64 / bins as f64 - 1.0);
    middles
        .map(|middle| {
            while middle > end && point + 1 < rule.len() {
                point += 1;
                end += rule[point].1;
            }
            point
        })
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
