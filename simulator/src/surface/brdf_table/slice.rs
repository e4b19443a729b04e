//! Measured values for one direction of incidence, over outgoing directions, in the plane of incidence, on a grid or scattered.

use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Directions closer than this are the same, radians.
const SAME_RAD: f64 = 1e-6;
/// A bisector this near the plane of incidence lies in it, radians.
const IN_PLANE_RAD: f64 = 2e-3;
/// Neighbours of a scattered point, and one more that bounds them.
const NEIGHBOURS: usize = 8;

/// Rows of the table with weights that sum to 1.
#[derive(Debug, Clone, Copy)]
pub struct Stencil {
    parts: [(usize, f64); 36],
    len: usize,
}

impl Stencil {
    pub fn new() -> Self {
        Self { parts: [(0, 0.0); 36], len: 0 }
    }

    pub fn push(&mut self, row: usize, weight: f64) {
        if weight > 0.0 && self.len < self.parts.len() {
            self.parts[self.len] = (row, weight);
            self.len += 1;
        }
    }

    pub fn parts(&self) -> &[(usize, f64)] {
        &self.parts[..self.len]
    }
}

#[derive(Debug)]
pub struct Slice {
    /// Unit vector to the light.
    pub i: DVec3,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    /// Signed elevations, the mirrored direction's side positive.
    Plane {
        angle: Vec<f64>,
        row: Vec<usize>,
    },
    /// Elevations by azimuths, `row` for each pair.
    Grid {
        theta: Vec<f64>,
        phi: Vec<f64>,
        row: Vec<usize>,
        mirrored: bool,
    },
    Scattered {
        o: Vec<DVec3>,
        row: Vec<usize>,
        spacing: f64,
    },
}

impl Slice {
    /// Creates a slice from rows with their outgoing directions (elevation, azimuth in radians). `isotropic`: `i` has the azimuth 0, and azimuths go from 0 to π.
    pub fn new(i: DVec3, rows: &[(usize, f64, f64)], isotropic: bool) -> Self {
        let kind = if isotropic { plane(rows) } else { None };
        let kind = kind.or_else(|| grid(rows, isotropic)).unwrap_or_else(|| scattered(rows));
        Self { i, kind }
    }

    /// Adds the rows around the outgoing direction that has the bisector `h`; gives whether it lies between rows.
    pub fn add(&self, h: DVec3, share: f64, stencil: &mut Stencil) -> bool {
        let o = (2.0 * self.i.dot(h) * h - self.i).normalize();
        match &self.kind {
            Kind::Plane { angle, row } => self.add_in_plane(h, angle, row, share, stencil),
            Kind::Grid { theta, phi, row, mirrored } => {
                let at = (elevation(o), o.y.atan2(o.x));
                add_on_grid(theta, phi, row, *mirrored, at, share, stencil) && o.z > 0.0
            }
            Kind::Scattered { o: known, row, spacing } => {
                let nearest = add_scattered(known, row, o, share, stencil);
                nearest <= 1.5 * spacing && o.z > 0.0
            }
        }
    }

    /// Out of the plane the two directions in it whose bisectors have the same tilt are mixed, the nearer side more.
    fn add_in_plane(
        &self,
        h: DVec3,
        angle: &[f64],
        row: &[usize],
        share: f64,
        stencil: &mut Stencil,
    ) -> bool {
        let across = h.x.hypot(h.y);
        let tilt = across.atan2(h.z);
        let ahead = if across > 1e-12 { 0.5 * (1.0 - h.x / across) } else { 0.5 };
        let incidence = elevation(self.i);
        let mut within = true;
        for (side, part) in [(1.0, ahead), (-1.0, 1.0 - ahead)] {
            if part > 1e-12 {
                let a = incidence + side * 2.0 * tilt;
                let (j, t, inside) = between(angle, a);
                stencil.push(row[j], share * part * (1.0 - t));
                stencil.push(row[j + 1], share * part * t);
                within &= inside;
            }
        }
        within && h.y.abs() < IN_PLANE_RAD
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
        angle: all.iter().map(|a| a.0).collect(),
        row: all.iter().map(|a| a.1).collect(),
    })
}

fn grid(rows: &[(usize, f64, f64)], isotropic: bool) -> Option<Kind> {
    let distinct = |values: Vec<f64>| {
        let mut values = values;
        values.sort_by(f64::total_cmp);
        values.dedup_by(|a, b| (*a - *b).abs() < SAME_RAD);
        values
    };
    let theta = distinct(rows.iter().map(|r| r.1).collect());
    let tilted = || rows.iter().filter(|r| r.1 >= SAME_RAD);
    let phi = distinct(tilted().map(|r| r.2).collect());
    if theta.len() < 2 || phi.len() < 3 {
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
    row.iter().all(|r| *r != usize::MAX).then_some(Kind::Grid {
        theta,
        phi,
        row,
        mirrored: isotropic,
    })
}

fn scattered(rows: &[(usize, f64, f64)]) -> Kind {
    let vector = |theta: f64, phi: f64| {
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let o: Vec<DVec3> = rows.iter().map(|(_, t, p)| vector(*t, *p)).collect();
    let nearest = |k: usize| {
        let others = o.iter().enumerate().filter(|(j, _)| *j != k);
        others.fold(f64::INFINITY, |least, (_, p)| least.min((*p - o[k]).length()))
    };
    let step = (o.len() / 200).max(1);
    let mut gaps: Vec<f64> = (0..o.len()).step_by(step).map(nearest).collect();
    gaps.sort_by(f64::total_cmp);
    let spacing = gaps.get(gaps.len() * 9 / 10).copied().unwrap_or(0.0);
    Kind::Scattered { o, row: rows.iter().map(|r| r.0).collect(), spacing }
}

/// The node before `x`, how far it is to the next, and whether it lies within the nodes; held beyond.
pub fn between(nodes: &[f64], x: f64) -> (usize, f64, bool) {
    let last = nodes.len() - 1;
    let j = nodes.partition_point(|v| *v <= x).clamp(1, last) - 1;
    let t = (x - nodes[j]) / (nodes[j + 1] - nodes[j]);
    (j, t.clamp(0.0, 1.0), (-1e-9..=1.0 + 1e-9).contains(&t))
}

fn add_on_grid(
    theta: &[f64],
    phi: &[f64],
    row: &[usize],
    mirrored: bool,
    (t, p): (f64, f64),
    share: f64,
    stencil: &mut Stencil,
) -> bool {
    let (j, s, within) = between(theta, t);
    let last = phi.len() - 1;
    let p = if mirrored { p.abs() } else { (p - phi[0]).rem_euclid(TAU) + phi[0] };
    // Around the circle from the last azimuth to the first.
    let gap = TAU - (phi[last] - phi[0]);
    let wide = 1.5 * (phi[last] - phi[0]) / last as f64;
    let (k, next, f, around) = if !mirrored && p > phi[last] {
        (last, 0, (p - phi[last]) / gap, gap <= wide)
    } else {
        let (k, f, inside) = between(phi, p);
        (k, k + 1, f, inside)
    };
    for (j, weight) in [(j, 1.0 - s), (j + 1, s)] {
        stencil.push(row[j * phi.len() + k], share * weight * (1.0 - f));
        stencil.push(row[j * phi.len() + next], share * weight * f);
    }
    within && (around || t < theta[0].max(SAME_RAD))
}

/// Inverse distances that end at the ninth neighbour (Franke and Little's modification of Shepard's), so that the value is continuous and exact at the
/// points. Gives the distance of the nearest.
fn add_scattered(
    known: &[DVec3],
    row: &[usize],
    o: DVec3,
    share: f64,
    stencil: &mut Stencil,
) -> f64 {
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
        stencil.push(row[near[0].1], share);
        return near[0].0.sqrt();
    }
    let weight = |d: f64| ((end - d).max(0.0) / (end * d)).powi(2);
    let used = &near[..found.min(NEIGHBOURS)];
    let all: f64 = used.iter().map(|(d, _)| weight(d.sqrt())).sum();
    if all > 0.0 {
        used.iter().for_each(|(d, k)| stencil.push(row[*k], share * weight(d.sqrt()) / all));
    } else {
        stencil.push(row[near[0].1], share);
    }
    near[0].0.sqrt()
}

fn elevation(d: DVec3) -> f64 {
    crate::surface::tensor::elevation(d)
}
