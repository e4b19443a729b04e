//! Measured values for one direction of incidence, over outgoing directions: in the plane of incidence, on a grid about the normal or about the mirrored ray, or scattered.

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Directions closer than this are the same, radians.
const SAME_RAD: f64 = 1e-6;
/// Angles about the mirrored ray that differ by less are one, radians: files hold them with few digits.
const SAME_ABOUT_RAD: f64 = 5e-4;
/// A bisector this near the plane of incidence lies in it, radians.
const IN_PLANE_RAD: f64 = 2e-3;
/// Neighbours of a scattered point, and one more that bounds them.
const NEIGHBOURS: usize = 8;
/// Nodes that scattered points are brought onto: radial and around half the circle.
const RADIALS: usize = 97;
const AROUND: usize = 25;

/// Rows of the table with weights that sum to 1.
#[derive(Debug, Clone, Copy)]
pub struct Stencil {
    parts: [(usize, f64); 32],
    len: usize,
}

/// Takes rows with weights: keeps them, or sums what they hold.
pub trait Sink {
    fn push(&mut self, row: usize, weight: f64);
}

impl Sink for Stencil {
    fn push(&mut self, row: usize, weight: f64) {
        if weight > 0.0 && self.len < self.parts.len() {
            self.parts[self.len] = (row, weight);
            self.len += 1;
        }
    }
}

/// Sum of one number a row, times the weights.
#[derive(Debug)]
pub struct Sum<'a> {
    pub of: &'a [f64],
    pub sum: f64,
}

impl Sink for Sum<'_> {
    fn push(&mut self, row: usize, weight: f64) {
        if weight > 0.0 {
            self.sum += weight * self.of[row];
        }
    }
}

impl Stencil {
    pub fn new() -> Self {
        Self { parts: [(0, 0.0); 32], len: 0 }
    }

    pub fn parts(&self) -> &[(usize, f64)] {
        &self.parts[..self.len]
    }

    pub fn len(&self) -> usize {
        self.len
    }
}

/// Increasing numbers, and which of them lies before a place, found without a search.
#[derive(Debug)]
pub struct Nodes {
    at: Vec<f64>,
    /// The node before the begin of each of many equal stretches.
    first: Vec<u32>,
    per_rad: f64,
}

impl Nodes {
    /// Makes a list of two or more.
    pub fn new(at: Vec<f64>) -> Self {
        let last = at.len() - 1;
        let stretches = (4 * at.len()).min(8192);
        let per_rad = stretches as f64 / (at[last] - at[0]).max(f64::MIN_POSITIVE);
        let before = |k: usize| {
            let x = at[0] + k as f64 / per_rad;
            (at.partition_point(|v| *v <= x).clamp(1, last) - 1) as u32
        };
        let first = (0..stretches).map(before).collect();
        Self { at, first, per_rad }
    }

    pub fn at(&self, k: usize) -> f64 {
        self.at[k]
    }

    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// The node before `x`, how far it is to the next, and how far `x` lies beyond the ends, where it is held.
    pub fn between(&self, x: f64) -> (usize, f64, f64) {
        let last = self.at.len() - 1;
        let stretch =
            (((x - self.at[0]) * self.per_rad).max(0.0) as usize).min(self.first.len() - 1);
        let mut j = self.first[stretch] as usize;
        while j > 0 && self.at[j] > x {
            j -= 1;
        }
        while j + 1 < last && self.at[j + 1] <= x {
            j += 1;
        }
        let t = (x - self.at[j]) / (self.at[j + 1] - self.at[j]);
        let beyond = (self.at[0] - x).max(x - self.at[last]).max(0.0);
        (j, t.clamp(0.0, 1.0), beyond)
    }
}

/// The axis that a grid's elevations are counted from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum About {
    Normal,
    /// The mirrored ray; azimuths from the direction towards the normal, alike on both sides.
    Mirrored,
}

#[derive(Debug)]
pub struct Slice {
    /// Unit vector to the light.
    pub i: DVec3,
    /// Angle from the normal, radians.
    theta: f64,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    /// Signed elevations, the mirrored direction's side positive.
    Plane { angle: Nodes, row: Vec<usize> },
    /// Elevations by azimuths, `row` for each pair.
    Grid {
        about: About,
        theta: Nodes,
        phi: Nodes,
        row: Vec<usize>,
        /// Whether a cell was measured.
        known: Vec<bool>,
        mirrored: bool,
    },
}

/// Values at nodes that are no rows: each a mixture of rows.
pub type Mixed = Vec<Stencil>;

impl Slice {
    /// Creates a slice from rows with their outgoing directions (elevation, azimuth in radians). `isotropic`: `i` has the azimuth 0, and azimuths go from 0 to π. Scattered rows
    /// are brought onto a grid, whose nodes get the numbers from `next` on; `mixed` gets what they are mixed of.
    pub fn new(
        i: DVec3,
        rows: &[(usize, f64, f64)],
        isotropic: bool,
        next: usize,
        mixed: &mut Mixed,
    ) -> Self {
        let kind = if isotropic { plane(rows) } else { None };
        let kind = kind
            .or_else(|| grid(rows, isotropic))
            .or_else(|| if isotropic { about_mirrored(i, rows) } else { None })
            .unwrap_or_else(|| scattered(i, rows, isotropic, next, mixed));
        Self { i, theta: elevation(i), kind }
    }

    pub fn is_plane(&self) -> bool {
        matches!(self.kind, Kind::Plane { .. })
    }

    /// Adds the rows around the outgoing direction that has the bisector `h`; gives how far it lies beyond the rows, radians.
    pub fn add(&self, h: DVec3, share: f64, sink: &mut impl Sink) -> f64 {
        match &self.kind {
            Kind::Plane { angle, row } => self.add_in_plane(h, angle, row, share, sink),
            Kind::Grid { about, theta, phi, row, known, mirrored } => {
                let o = 2.0 * self.i.dot(h) * h - self.i;
                let at = match about {
                    About::Normal => (elevation(o), o.y.atan2(o.x)),
                    About::Mirrored => of_mirrored(self.i, o),
                };
                let beyond = add_on_grid((theta, phi), (row, known), *mirrored, at, share, sink);
                beyond + (-o.z).max(0.0)
            }
        }
    }

    /// Out of the plane the two directions in it whose bisectors have the same tilt are mixed, the nearer side more.
    fn add_in_plane(
        &self,
        h: DVec3,
        angle: &Nodes,
        row: &[usize],
        share: f64,
        sink: &mut impl Sink,
    ) -> f64 {
        let across = h.x.hypot(h.y);
        let tilt = across.atan2(h.z);
        let ahead = if across > 1e-12 { 0.5 * (1.0 - h.x / across) } else { 0.5 };
        let incidence = self.theta;
        let mut beyond = if h.y.abs() < IN_PLANE_RAD { 0.0 } else { h.y.abs() };
        for (side, part) in [(1.0, ahead), (-1.0, 1.0 - ahead)] {
            if part > 1e-12 {
                let a = incidence + side * 2.0 * tilt;
                let (j, t, outside) = angle.between(a);
                sink.push(row[j], share * part * (1.0 - t));
                sink.push(row[j + 1], share * part * t);
                beyond += part * outside;
            }
        }
        beyond
    }

    /// [`Self::add`] of a slice in the plane of incidence, at a bisector in it: `tilt` is that of the bisector towards the light, radians.
    pub fn add_at_tilt(&self, tilt: f64, share: f64, sink: &mut impl Sink) -> f64 {
        let Kind::Plane { angle, row } = &self.kind else { return 0.0 };
        let (j, t, outside) = angle.between(self.theta - 2.0 * tilt);
        sink.push(row[j], share * (1.0 - t));
        sink.push(row[j + 1], share * t);
        outside
    }

    /// Rows with the rows beside them, along each axis: the number of a row, of the one before and the one after, and the part of the way.
    pub fn beside(&self, mut give: impl FnMut(usize, usize, usize, f64)) {
        match &self.kind {
            Kind::Plane { angle, row } => {
                for k in 1..row.len() - 1 {
                    let way = angle.at(k + 1) - angle.at(k - 1);
                    give(row[k], row[k - 1], row[k + 1], (angle.at(k) - angle.at(k - 1)) / way);
                }
            }
            Kind::Grid { theta, phi, row, known, .. } => {
                let of = |j: usize, k: usize| j * phi.len() + k;
                let mut one = |a: usize, b: usize, c: usize, part: f64| {
                    if known[a] && known[b] && known[c] && row[a] != row[b] && row[a] != row[c] {
                        give(row[a], row[b], row[c], part);
                    }
                };
                for j in 0..theta.len() {
                    for k in 0..phi.len() {
                        if j > 0 && j + 1 < theta.len() {
                            let way = theta.at(j + 1) - theta.at(j - 1);
                            let part = (theta.at(j) - theta.at(j - 1)) / way;
                            one(of(j, k), of(j - 1, k), of(j + 1, k), part);
                        }
                        if k > 0 && k + 1 < phi.len() {
                            let way = phi.at(k + 1) - phi.at(k - 1);
                            let part = (phi.at(k) - phi.at(k - 1)) / way;
                            one(of(j, k), of(j, k - 1), of(j, k + 1), part);
                        }
                    }
                }
            }
        }
    }
}

fn plane(rows: &[(usize, f64, f64)]) -> Option<Kind> {
    let flat = |phi: f64| !(SAME_RAD..=PI - SAME_RAD).contains(&phi);
    if rows.len() < 2 || !rows.iter().all(|(_, theta, phi)| flat(*phi) || *theta < SAME_RAD) {
        return None;
    }
    let signed = |theta: f64, phi: f64| if phi > 0.5 * PI { theta } else { -theta };
    let mut all: Vec<(f64, usize)> = rows.iter().map(|(r, t, p)| (signed(*t, *p), *r)).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.dedup_by(|a, b| (a.0 - b.0).abs() < SAME_RAD);
    (all.len() >= 2).then(|| Kind::Plane {
        angle: Nodes::new(all.iter().map(|a| a.0).collect()),
        row: all.iter().map(|a| a.1).collect(),
    })
}

fn distinct(mut values: Vec<f64>, same: f64) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values.dedup_by(|a, b| (*a - *b).abs() < same);
    values
}

fn grid(rows: &[(usize, f64, f64)], isotropic: bool) -> Option<Kind> {
    let theta = distinct(rows.iter().map(|r| r.1).collect(), SAME_RAD);
    let tilted = || rows.iter().filter(|r| r.1 >= SAME_RAD);
    let phi = distinct(tilted().map(|r| r.2).collect(), SAME_RAD);
    if theta.len() < 2 || phi.len() < 3 || theta.len() * phi.len() > 4 * rows.len() + 400 {
        return None;
    }
    let near = |values: &[f64], x: f64| values.partition_point(|v| *v < x - SAME_RAD);
    let mut row = vec![usize::MAX; theta.len() * phi.len()];
    for (r, t, p) in rows {
        let j = near(&theta, *t);
        if *t < SAME_RAD {
            row[j * phi.len()..(j + 1) * phi.len()].fill(*r);
        } else {
            row[j * phi.len() + near(&phi, *p)] = *r;
        }
    }
    row.iter().all(|r| *r != usize::MAX).then(|| Kind::Grid {
        about: About::Normal,
        known: vec![true; row.len()],
        theta: Nodes::new(theta),
        phi: Nodes::new(phi),
        row,
        mirrored: isotropic,
    })
}

/// The angle from the mirrored ray and the azimuth about it, 0 towards the normal, of light with the azimuth 0 or along the normal.
fn of_mirrored(i: DVec3, o: DVec3) -> (f64, f64) {
    let (sin, cos) = (i.x, i.z);
    let mirrored = DVec3::new(-sin, 0.0, cos);
    let to_normal = DVec3::new(cos, 0.0, sin);
    let radial = 2.0 * (0.5 * (o - mirrored).length()).min(1.0).asin();
    (radial, o.y.abs().atan2(o.dot(to_normal)))
}

/// A grid about the mirrored ray, as scatterometers and Zemax have it: cells below the horizon, and some that were not measured, are held by the nearest row.
fn about_mirrored(i: DVec3, rows: &[(usize, f64, f64)]) -> Option<Kind> {
    let vector = |theta: f64, phi: f64| {
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let places: Vec<(usize, f64, f64)> = rows
        .iter()
        .map(|(r, t, p)| {
            let (radial, azimuth) = of_mirrored(i, vector(*t, *p));
            (*r, radial, azimuth)
        })
        .collect();
    let theta = distinct(places.iter().map(|r| r.1).collect(), SAME_ABOUT_RAD);
    let aside = places.iter().filter(|r| r.1 > 10.0 * SAME_ABOUT_RAD);
    let phi = distinct(aside.map(|r| r.2).collect(), SAME_ABOUT_RAD);
    let cells = theta.len() * phi.len();
    if theta.len() < 3 || phi.len() < 3 || cells > 3 * rows.len() {
        return None;
    }
    let near = |values: &[f64], x: f64| {
        let k = values.partition_point(|v| *v < x).min(values.len() - 1);
        if k > 0 && (x - values[k - 1]).abs() < (values[k] - x).abs() { k - 1 } else { k }
    };
    let mut row = vec![usize::MAX; cells];
    for (r, t, p) in &places {
        let j = near(&theta, *t);
        if *t <= 10.0 * SAME_ABOUT_RAD {
            row[j * phi.len()..(j + 1) * phi.len()].fill(*r);
        } else {
            row[j * phi.len() + near(&phi, *p)] = *r;
        }
    }
    let known: Vec<bool> = row.iter().map(|r| *r != usize::MAX).collect();
    // Rows that share a cell with others would be lost.
    if known.iter().filter(|k| **k).count() + phi.len() < rows.len() {
        return None;
    }
    for cell in 0..cells {
        if !known[cell] {
            let (t, p) = (theta[cell / phi.len()], phi[cell % phi.len()]);
            let at = vector(t, p);
            let apart = |r: &&(usize, f64, f64)| (vector(r.1, r.2) - at).length_squared();
            let nearest = places.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
            row[cell] = nearest.0;
        }
    }
    let (theta, phi) = (Nodes::new(theta), Nodes::new(phi));
    Some(Kind::Grid { about: About::Mirrored, theta, phi, row, known, mirrored: true })
}

/// Scattered rows on a grid about the normal (of one with a tangent) or the mirrored ray, finer towards the mirrored one.
fn scattered(
    i: DVec3,
    rows: &[(usize, f64, f64)],
    isotropic: bool,
    next: usize,
    mixed: &mut Mixed,
) -> Kind {
    let vector = |theta: f64, phi: f64| {
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let o: Vec<DVec3> = rows.iter().map(|(_, t, p)| vector(*t, *p)).collect();
    let both: Vec<DVec3> = if isotropic {
        o.iter().flat_map(|o| [*o, DVec3::new(o.x, -o.y, o.z)]).collect()
    } else {
        o
    };
    let copies = if isotropic { 2 } else { 1 };
    let row: Vec<usize> = (0..both.len()).map(|k| rows[k / copies].0).collect();
    let nearest = |k: usize| {
        let others = both.iter().enumerate().filter(|(j, p)| *j != k && **p != both[k]);
        others.fold(f64::INFINITY, |least, (_, p)| least.min((*p - both[k]).length()))
    };
    let step = (both.len() / 200).max(1);
    let mut gaps: Vec<f64> = (0..both.len()).step_by(step).map(nearest).collect();
    gaps.sort_by(f64::total_cmp);
    let spacing = gaps.get(gaps.len() * 9 / 10).copied().unwrap_or(0.0);
    let around = if isotropic { AROUND } else { 2 * AROUND - 2 };
    let (most, about) = if isotropic { (PI, About::Mirrored) } else { (FRAC_PI_2, About::Normal) };
    let radial = |j: usize| (j as f64 / (RADIALS - 1) as f64).powi(2) * most;
    let azimuth = |k: usize| {
        if isotropic {
            PI * k as f64 / (AROUND - 1) as f64
        } else {
            TAU * k as f64 / around as f64 - PI
        }
    };
    let (mut numbers, mut known) = (Vec::new(), Vec::new());
    for j in 0..RADIALS {
        for k in 0..around {
            let (r, a) = (radial(j), azimuth(k));
            let at = if isotropic {
                let mirrored = DVec3::new(-i.x, 0.0, i.z);
                let to_normal = DVec3::new(i.z, 0.0, i.x);
                mirrored * r.cos() + (to_normal * a.cos() + DVec3::Y * a.sin()) * r.sin()
            } else {
                vector(r, a)
            };
            let mut stencil = Stencil::new();
            let distance = add_scattered(&both, &row, at, &mut stencil);
            numbers.push(next + mixed.len());
            mixed.push(stencil);
            known.push(distance <= 1.5 * spacing && at.z > -1e-6);
        }
    }
    let theta = Nodes::new((0..RADIALS).map(radial).collect());
    let phi = Nodes::new((0..around).map(azimuth).collect());
    Kind::Grid { about, theta, phi, row: numbers, known, mirrored: isotropic }
}

fn add_on_grid(
    (theta, phi): (&Nodes, &Nodes),
    (row, known): (&[usize], &[bool]),
    mirrored: bool,
    (t, p): (f64, f64),
    share: f64,
    sink: &mut impl Sink,
) -> f64 {
    let (j, s, mut beyond) = theta.between(t);
    let last = phi.len() - 1;
    let (from, to) = (phi.at(0), phi.at(last));
    let p = if mirrored { p.abs() } else { (p - from).rem_euclid(TAU) + from };
    // Around the circle from the last azimuth to the first.
    let gap = TAU - (to - from);
    let wide = 1.5 * (to - from) / last as f64;
    let (k, next, f) = if !mirrored && p > to {
        if gap > wide {
            beyond += (p - to).min(gap - (p - to)) * t.sin();
        }
        (last, 0, (p - to) / gap)
    } else {
        let (k, f, outside) = phi.between(p);
        if t >= theta.at(0).max(SAME_RAD) {
            beyond += outside * t.sin();
        }
        (k, k + 1, f)
    };
    let mut unknown = 0.0;
    for (j, weight) in [(j, 1.0 - s), (j + 1, s)] {
        for (k, part) in [(k, 1.0 - f), (next, f)] {
            let cell = j * phi.len() + k;
            sink.push(row[cell], share * weight * part);
            if !known[cell] {
                unknown += weight * part;
            }
        }
    }
    // Beside the edge of what was measured the nearest row stands for a cell.
    if unknown > 0.5 { beyond + (theta.at(j + 1) - theta.at(j)) * (unknown - 0.5) } else { beyond }
}

/// Inverse distances that end at the ninth neighbour (Franke and Little's modification of Shepard's), so that the value is continuous and exact at the
/// points. Gives the distance of the nearest.
fn add_scattered(known: &[DVec3], row: &[usize], o: DVec3, stencil: &mut Stencil) -> f64 {
    let mut near = [(f64::INFINITY, usize::MAX); NEIGHBOURS + 1];
    for (k, p) in known.iter().enumerate() {
        let distance = (*p - o).length_squared();
        if distance < near[NEIGHBOURS].0 {
            let at = near.partition_point(|(d, _)| *d <= distance);
            near[at..].rotate_right(1);
            near[at] = (distance, k);
        }
    }
    let found = near.iter().filter(|(_, k)| *k != usize::MAX).count();
    let end = near[found - 1].0.sqrt() * if found <= NEIGHBOURS { 1.5 } else { 1.0 };
    if near[0].0.sqrt() < 1e-9 || end <= 0.0 {
        stencil.push(row[near[0].1], 1.0);
        return near[0].0.sqrt();
    }
    let weight = |d: f64| ((end - d).max(0.0) / (end * d)).powi(2);
    let used = &near[..found.min(NEIGHBOURS)];
    let all: f64 = used.iter().map(|(d, _)| weight(d.sqrt())).sum();
    if all > 0.0 {
        used.iter().for_each(|(d, k)| stencil.push(row[*k], weight(d.sqrt()) / all));
    } else {
        stencil.push(row[near[0].1], 1.0);
    }
    near[0].0.sqrt()
}

fn elevation(d: DVec3) -> f64 {
    crate::surface::tensor::elevation(d)
}
