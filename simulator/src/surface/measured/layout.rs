//! Where a file's grid of values is fine and where it is coarse.
//!
//! Between its nodes a file is bilinear in warped coordinates, and between two incident elevations it mixes both warps: it is good where the values change little from node to node, and
//! where the warps of neighbouring incidences are alike but for a stretch. Any density serves as a warp. The visible normals' own (Dupuy and Jakob 2018) has few nodes in a lobe's tails, at
//! the horizon, and where the horizon cuts through the azimuths: there files of 64 by 64 values were off by 3 to 50 %. Here:
//!
//! - Along each azimuth the nodes end beyond the horizon of the mirrored directions, at tan 2θ_h = −cosθ_i/(sinθ_i cosφ), and their density is a function of the height z of the
//!   mirrored direction that is flat around the horizon. So the horizon lies on a line of the grid, z falls towards it evenly, and stays so where two incidences (or two rows of the
//!   warp) are mixed: a value that goes as z keeps its relative error down to the horizon. Nothing is cut where a neighbour's horizon lies.
//! - Towards the horizon they are closer, the closer the light is to the horizon: masking bends there over heights like the light's own.
//! - A share follows the lobe, another where a lobe goes over into the diffuse light around it.
//! - Between azimuths: evenly, by how much of the lobe is there, by how fast the horizon moves from one to the next, and towards the light's own, where masking has a cusp.
//!
//! The shares were found with Lambert, Beckmann and GGX materials of 0.02 to 0.5 alone and over diffuse light, values in closed form on the nodes: at a side of 129, 72 elevations and 512
//! by 128 nodes of the warps the largest error of 40000 directions up to 88° is 0.5 to 1.5 % of the value (it was 4 to 13 % of 81, 48 and 128 by 256).

use crate::surface::tensor::warp::Grid;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The share of each azimuth's nodes that follows the lobe.
const LOBE: f64 = 0.15;
/// The share of where a lobe goes over into diffuse light.
const TRANSITION: f64 = 0.25;
/// The transition is from this level of diffuse light to a hundredth of it.
const DEEP: f64 = 100.0;
/// At the horizon there are so many times more nodes than far above it.
const CLOSER: f64 = 20.0;
/// The height over which that falls is the light's, but at most this, and a little more.
const HEIGHT: (f64, f64) = (0.1, 0.03);
/// Around the normal, up to this part of the way to the horizon, there are fewer nodes, down to this part of them: there is little solid angle.
const POLE: (f64, f64) = (0.3, 0.3);
/// The least width of the stretch beyond the horizon in which the nodes end: a part of the way to it, and columns of the warp's own grid.
const FALL: (f64, f64) = (0.05, 1.5);
/// Nodes end so many steps (of the warp's rows, of incident azimuths, of incident elevations) beyond the horizon: where a neighbour's is.
const BEYOND: f64 = 1.2;
/// The share of azimuths between which the horizon moves, where the light is at the horizon.
const MOVING: f64 = 0.6;
/// The share of azimuths around the light's own, where the light is at the horizon, and how far around, radians.
const TOWARDS: (f64, f64) = (0.1, 0.12);
/// Even part of what is left of the azimuths' shares; the rest goes by the lobe.
const EVEN: f64 = 0.43;
/// The cosine of what stands for all directions at or below the horizon.
const LEAST_COSINE: f64 = 2e-3;
/// The largest incident elevation of a file, degrees.
const MOST_DEG: f64 = 89.9;
/// The share of incident elevations that are evenly apart; the others lie closer in proportion to how far they are from this many degrees below the horizon.
const ELEVATIONS: (f64, f64) = (0.6, 5.0);

/// The density of a file's nodes over microfacet normals.
#[derive(Debug, Clone)]
pub struct Layout {
    /// D at any scale.
    density: Grid,
    theta_i: Vec<f64>,
    phi_i: Vec<f64>,
    /// The tilt at which D has fallen to 1/e, radians; at most 0.5.
    width_rad: f64,
    /// By node, along each azimuth: where the lobe goes over into diffuse light, 1 or less in all.
    transition: Vec<f64>,
}

/// Light from one direction.
struct Light {
    sine: f64,
    cosine: f64,
    phi: f64,
}

impl Light {
    /// The tilt of the normals that mirror the light to the horizon, in the azimuth `turn` from the light's, radians.
    fn horizon(&self, turn: f64) -> f64 {
        0.5 * self.cosine.atan2(-self.sine * turn.cos())
    }

    fn at(theta: f64, phi: f64) -> Self {
        let (sine, cosine) = theta.clamp(0.0, FRAC_PI_2).sin_cos();
        Self { sine, cosine, phi }
    }
}

fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// √(2θ/π).
fn place(theta: f64) -> f64 {
    (theta.max(0.0) / FRAC_PI_2).sqrt()
}

impl Layout {
    /// `density` is D on nodes (u = √(2θ/π) along the columns, (φ+π)/2π along the rows, both ends in it), at any scale; `floor` is what the file's D has
    /// beside it for diffuse light, on the same scale. `theta_i` and `phi_i` are the file's incident elevations and azimuths, radians, increasing; a single azimuth is that of an isotropic
    /// material, whose normals are counted from the light's azimuth.
    #[must_use]
    pub fn new(density: Grid, floor: f64, theta_i: &[f64], phi_i: &[f64]) -> Self {
        let (rows, columns) = (density.rows, density.columns);
        let tilt = |c: usize| (c as f64 / (columns - 1) as f64).powi(2) * FRAC_PI_2;
        let falls = |row: usize| {
            let values = &density.values[row * columns..(row + 1) * columns];
            let most = f64::from(values.iter().copied().fold(0.0_f32, f32::max));
            let low = |v: &f32| f64::from(*v) < most / std::f64::consts::E;
            values.iter().position(low).map_or(0.5, |c| tilt(c).min(0.5))
        };
        let width_rad = (0..rows).map(falls).fold(0.5, f64::min);
        let transition = transition(&density, floor);
        let (theta_i, phi_i) = (theta_i.to_vec(), phi_i.to_vec());
        Self { density, theta_i, phi_i, width_rad, transition }
    }

    /// Incident elevations from 0 to 89.9°, radians, four times as dense at the horizon as at the normal, as a file holds them.
    #[must_use]
    pub fn elevations(count: usize) -> Vec<f64> {
        let (even, near) = ELEVATIONS;
        let closer = |t: f64| ((90.0 + near) / (90.0 - t + near)).ln();
        let part = |t: f64| even * t / MOST_DEG + (1.0 - even) * closer(t) / closer(MOST_DEG);
        let theta = |j: usize| {
            let wanted = j as f64 / (count - 1) as f64;
            let (mut from, mut to) = (0.0, MOST_DEG);
            for _ in 0..50 {
                let middle = 0.5 * (from + to);
                if part(middle) < wanted { from = middle } else { to = middle }
            }
            if j == 0 { 0.0 } else { f64::from(to.to_radians() as f32) }
        };
        (0..count).map(theta).collect()
    }

    /// A unit direction, or the one nearest to it above the horizon: nodes below take its value, so that what lies above is not pulled down.
    #[must_use]
    pub fn above_horizon(o: DVec3) -> DVec3 {
        if o.z >= LEAST_COSINE {
            return o;
        }
        let across = DVec3::new(o.x, o.y, 0.0).normalize_or(DVec3::X);
        across * (1.0 - LEAST_COSINE * LEAST_COSINE).sqrt() + DVec3::Z * LEAST_COSINE
    }

    fn is_isotropic(&self) -> bool {
        self.phi_i.len() == 1
    }

    /// The normal of a point of the square, for light from the azimuth `phi_i`, radians.
    #[must_use]
    pub fn normal(&self, phi_i: f64, u: impl Into<DVec2>) -> DVec3 {
        let u = u.into();
        let phi = TAU * u[1] - PI + if self.is_isotropic() { phi_i } else { 0.0 };
        let theta = u[0] * u[0] * FRAC_PI_2;
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    /// The density over the square for the incident elevation and azimuth of these numbers, not normalised: rows by columns as the layout was made from.
    #[must_use]
    pub fn visible(&self, elevation: usize, azimuth: usize) -> Vec<f32> {
        let (rows, columns) = (self.density.rows, self.density.columns);
        let light = Light::at(self.theta_i[elevation], self.phi_i[azimuth]);
        let mut values = vec![0.0; rows * columns];
        let mut lobes = vec![0.0; rows];
        for (row, into) in values.chunks_mut(columns).enumerate() {
            lobes[row] = self.along(row, elevation, &light, into);
        }
        let shares = self.shares(&light, &lobes);
        for (row, share) in values.chunks_mut(columns).zip(&shares) {
            row.iter_mut().for_each(|v| *v *= share);
        }
        values.into_iter().map(|v| v as f32).collect()
    }

    /// The azimuth of a row from the light's, −π to π.
    fn turn(&self, row: usize, light: &Light) -> f64 {
        let phi = TAU * row as f64 / (self.density.rows - 1) as f64 - PI;
        let turn = phi - if self.is_isotropic() { 0.0 } else { light.phi };
        turn - TAU * (turn / TAU).round()
    }

    /// Where the nodes of a row end, as a place: the horizon, or a neighbour's that is further out.
    fn end(&self, elevation: usize, turn: f64) -> f64 {
        let beside = |a: usize, b: usize, all: &[f64]| {
            if b < all.len() { all[b] - all[a] } else { 0.0 }
        };
        let next = beside(elevation, elevation + 1, &self.theta_i);
        let before = elevation.checked_sub(1).map_or(0.0, |k| beside(k, elevation, &self.theta_i));
        let up = BEYOND * next.max(before);
        let rows = TAU / (self.density.rows - 1) as f64;
        let aside = BEYOND * rows.max(beside(0, 1, &self.phi_i));
        let theta = self.theta_i[elevation];
        // It falls with the angle from the light's azimuth; with the light's elevation it rises or falls.
        let nearer = (turn.abs() - aside).max(0.0);
        let of = |theta: f64, turn: f64| Light::at(theta, 0.0).horizon(turn);
        place(of(theta - up, nearer).max(of(theta + up, nearer)).max(of(theta, turn)))
    }

    /// The density along a row, its sum about 1; given is what the lobe has there.
    fn along(&self, row: usize, elevation: usize, light: &Light, into: &mut [f64]) -> f64 {
        let columns = into.len();
        let turn = self.turn(row, light);
        let (tilt_h, end) = (light.horizon(turn), self.end(elevation, turn));
        let u_h = place(tilt_h);
        let fall = (FALL.0 * u_h).max(FALL.1 / (columns - 1) as f64);
        let most_z = (light.sine * turn.cos()).hypot(light.cosine);
        let height = light.cosine.min(HEIGHT.0) + HEIGHT.1;
        let (mut lobe, mut sums) = (vec![0.0; columns], [0.0; 2]);
        for (c, value) in into.iter_mut().enumerate() {
            let u = c as f64 / (columns - 1) as f64;
            let tilt = u * u * FRAC_PI_2;
            let keep = 1.0 - smooth((u - end) / fall);
            let z = most_z * (2.0 * (tilt_h - tilt)).sin();
            let closer = 1.0 + CLOSER * height / (height + (z - height).max(0.0));
            let around = POLE.1 + (1.0 - POLE.1) * smooth(u / (POLE.0 * u_h).max(1e-9));
            *value = keep * closer * around;
            let facing = light.sine * tilt.sin() * turn.cos() + light.cosine * tilt.cos();
            let density = f64::from(self.density.values[row * columns + c]);
            // Not the visible normals' solid angle, which is 0 at the normal: what lies around the mirrored direction would be in one cell.
            lobe[c] = keep * density * (tilt.sin() + self.width_rad) * u * facing.max(0.0);
            sums[0] += *value;
            sums[1] += lobe[c];
        }
        let transition = &self.transition[row * columns..(row + 1) * columns];
        let has_lobe = if sums[1] > 0.0 { LOBE } else { 0.0 };
        for ((c, value), lobe) in into.iter_mut().enumerate().zip(&lobe) {
            let u = c as f64 / (columns - 1) as f64;
            let keep = 1.0 - smooth((u - end) / fall);
            *value *= (1.0 - has_lobe) / sums[0].max(f64::MIN_POSITIVE);
            *value += has_lobe * lobe / sums[1].max(f64::MIN_POSITIVE);
            *value += TRANSITION * keep * transition[c];
        }
        sums[1]
    }

    /// Returns the share of the nodes that each row gets, 1 on the average; the last row is the first.
    fn shares(&self, light: &Light, lobes: &[f64]) -> Vec<f64> {
        let n = lobes.len() - 1;
        let low = light.cosine.acos() / FRAC_PI_2;
        let (moving, towards) = (MOVING * low, TOWARDS.0 * low);
        let turns: Vec<f64> = (0..=n).map(|row| self.turn(row, light)).collect();
        let moves = |turn: &f64| {
            let square = light.cosine.powi(2) + (light.sine * turn.cos()).powi(2);
            light.cosine * light.sine * turn.sin().abs() / square.max(1e-12)
        };
        let near = |turn: &f64| 1.0 / (TOWARDS.1.powi(2) + turn * turn);
        let sum = |of: &dyn Fn(&f64) -> f64| turns[..n].iter().map(of).sum::<f64>().max(1e-300);
        let (all_moves, all_near) = (sum(&moves), sum(&near));
        let lobe = lobes[..n].iter().sum::<f64>();
        let of = |row: usize| {
            let turn = &turns[row];
            let of_lobe = if lobe > 0.0 { lobes[row] / lobe } else { 1.0 / n as f64 };
            let rest = EVEN / n as f64 + (1.0 - EVEN) * of_lobe;
            let moved = moving * moves(turn) / all_moves;
            n as f64 * ((1.0 - moving - towards) * rest + moved + towards * near(turn) / all_near)
        };
        (0..=n).map(of).collect()
    }
}

/// By node, along each azimuth: where the lobe goes over into diffuse light of this strength.
fn transition(density: &Grid, floor: f64) -> Vec<f64> {
    let (rows, columns) = (density.rows, density.columns);
    let peak = f64::from(density.values.iter().copied().fold(0.0_f32, f32::max));
    let mut found = vec![0.0; rows * columns];
    if floor <= 1e-6 * peak {
        return found;
    }
    for (row, into) in found.chunks_mut(columns).enumerate() {
        let level = |c: usize| {
            let d = f64::from(density.values[row * columns + c]);
            ((d + floor) / (d + floor / DEEP)).ln()
        };
        for (c, part) in into.iter_mut().enumerate() {
            let (before, after) = (c.saturating_sub(1), (c + 1).min(columns - 1));
            *part = ((level(after) - level(before)) / (after - before) as f64).abs();
        }
        // A lobe that does not fall so far has no transition worth the nodes.
        let all = into.iter().sum::<f64>().max(3.0);
        into.iter_mut().for_each(|part| *part /= all);
    }
    found
}
