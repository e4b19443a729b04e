//! Averages over the disc of a lobe that is as narrow as the disc or narrower: rays from the lobe's peak, wherever it is.
//!
//! Along a ray the lobe is a fixed bell in units of its own width, so panels of a few units resolve it however narrow it is, and its tail
//! takes panels that double. Rays end where the disc ends or something hides it; the angles at which that changes are edges of panels,
//! and panels are halved until the estimated error is small.

use super::cut::Cut;
use super::rings::step;
use super::sums::{Integrand, Sums};
use glam::{DMat2, DVec2};
use std::f64::consts::{PI, TAU};
use sunglint_numerics::panels;

/// Points of a panel along a ray: the second of [`panels::ORDERS`].
const ALONG: usize = 1;
/// Relative error of the panels along a ray (test `a_lobe_of_every_width_against_brute_force`).
const ALONG_ERROR: f64 = 2e-6;
/// Panels of angles at most.
const MOST_PANELS: usize = 160;

/// A lobe on the disc.
#[derive(Debug, Clone, Copy)]
pub struct Bell {
    /// Peak of the lobe, which may lie beyond the disc.
    pub peak: DVec2,
    /// From its own units, in which it is round and 1 wide, to the disc's.
    pub axes: DMat2,
    /// Whether its tails are long.
    pub tails: bool,
}

struct Task<'a> {
    bell: Bell,
    cuts: &'a [Cut],
    count: usize,
    determinant: f64,
}

/// A panel of angles: of its variable s from 0 to 1 over the angles `from` to `to`.
struct Panel {
    angles: (f64, f64),
    s: (f64, f64),
    sums: Sums,
    error: f64,
}

/// Averages `count` values over what is left of the disc; gives the estimated error (of the sum of all values).
pub fn average(
    bell: Bell,
    cuts: &[Cut],
    count: usize,
    (tolerance, floor): (f64, f64),
    of: &mut Integrand<'_>,
    sums: &mut Sums,
) -> f64 {
    let determinant = bell.axes.determinant().abs();
    let task = Task { bell, cuts, count, determinant };
    let inside = bell.peak.length_squared() < 1.0;
    if inside
        && cuts.is_empty()
        && let Some(error) = task.around((tolerance, floor), of, sums)
    {
        return error + ALONG_ERROR * sums.grey();
    }
    let mut panels: Vec<Panel> = Vec::new();
    for angles in task.angles(inside).windows(2) {
        panels.push(task.panel((angles[0], angles[1]), (0.0, 1.0), of));
    }
    loop {
        sums.clear(count);
        panels.iter().for_each(|p| sums.add_sums(&p.sums, 1.0));
        let error: f64 = panels.iter().map(|p| p.error).sum();
        let limit = tolerance * sums.grey() + floor;
        if error <= limit || panels.len() >= MOST_PANELS {
            return error + ALONG_ERROR * sums.grey();
        }
        let share = 0.5 * limit / panels.len() as f64;
        for panel in std::mem::take(&mut panels) {
            if panel.error <= share {
                panels.push(panel);
                continue;
            }
            let middle = 0.5 * (panel.s.0 + panel.s.1);
            panels.push(task.panel(panel.angles, (panel.s.0, middle), of));
            panels.push(task.panel(panel.angles, (middle, panel.s.1), of));
        }
    }
}

impl Task<'_> {
    /// From a peak on the whole disc: as many rays at equal angles as are needed, if 64 are enough.
    fn around(
        &self,
        (tolerance, floor): (f64, f64),
        of: &mut Integrand<'_>,
        sums: &mut Sums,
    ) -> Option<f64> {
        sums.clear(self.count);
        let mut rays = 8;
        for k in 0..rays {
            self.ray(TAU * f64::from(k) / f64::from(rays), TAU / f64::from(rays), of, sums);
        }
        while rays < 64 {
            let last = sums.clone();
            sums.clear(self.count);
            sums.add_sums(&last, 0.5);
            rays *= 2;
            for k in (1..rays).step_by(2) {
                self.ray(TAU * f64::from(k) / f64::from(rays), TAU / f64::from(rays), of, sums);
            }
            let change = sums.distance(&last);
            // Equal angles converge geometrically.
            if change <= 10.0 * (tolerance * sums.grey() + floor) && rays > 16 || change <= floor {
                return Some(0.1 * change);
            }
        }
        None
    }

    /// The angle, in the bell's units, towards a place.
    fn angle(&self, place: DVec2) -> f64 {
        let to = self.bell.axes.inverse() * (place - self.bell.peak);
        to.y.atan2(to.x)
    }

    /// Angles between which nothing begins or ends.
    fn angles(&self, inside: bool) -> Vec<f64> {
        let corners = self.cuts.iter().filter_map(Cut::corners).flatten();
        // Angles are counted from the one to the disc's middle, where its other end is farthest.
        let middle = self.angle(DVec2::ZERO);
        let from_middle = |place| (self.angle(place) - middle + 3.0 * PI).rem_euclid(TAU) - PI;
        let mut angles: Vec<f64> = corners.map(from_middle).collect();
        let ends = if inside {
            angles.extend([-0.5 * PI, 0.0, 0.5 * PI]);
            (-PI, PI)
        } else {
            let peak = self.bell.peak;
            let half = (1.0 / peak.length()).min(1.0).acos();
            let toward = peak.y.atan2(peak.x);
            let touch = |a: f64| from_middle(DVec2::new((toward + a).cos(), (toward + a).sin()));
            let (a, b) = (touch(half), touch(-half));
            (a.min(b), a.max(b))
        };
        angles.retain(|a| *a > ends.0 && *a < ends.1);
        angles.extend([ends.0, ends.1]);
        angles.sort_by(f64::total_cmp);
        angles.iter().map(|a| a + middle).collect()
    }

    fn panel(&self, angles: (f64, f64), s: (f64, f64), of: &mut Integrand<'_>) -> Panel {
        let mut both = [Sums::default(), Sums::default()];
        // Six points and nine share none, but the error of six is a safe one for nine.
        for (order, sums) in both.iter_mut().enumerate() {
            sums.clear(self.count);
            for (s, weight) in panels::panel(s.0, s.1, order) {
                let (up, slope) = step(s);
                let width = angles.1 - angles.0;
                self.ray(angles.0 + width * up, weight * slope * width, of, sums);
            }
        }
        let [coarse, sums] = both;
        let error = sums.distance(&coarse);
        Panel { angles, s, sums, error: 0.3 * error }
    }

    /// Adds one ray, `width` wide in angle.
    fn ray(&self, angle: f64, width: f64, of: &mut Integrand<'_>, sums: &mut Sums) {
        let along = self.bell.axes * DVec2::new(angle.cos(), angle.sin());
        let peak = self.bell.peak;
        // Where |peak + t along| = 1.
        let (a, b) = (along.length_squared(), peak.dot(along));
        let c = (peak.length_squared() - 1.0).min(f64::MAX);
        let root = b * b - a * c;
        if root <= 0.0 {
            return;
        }
        let q = -(b + root.sqrt().copysign(b));
        let (mut t0, mut t1) = (q / a, c / q);
        if t0 > t1 {
            std::mem::swap(&mut t0, &mut t1);
        }
        if t1 <= 0.0 {
            return;
        }
        let disc = (t0, t1, a);
        let mut ends = vec![t0.max(0.0), t1];
        for cut in self.cuts {
            ends.extend(cut.crossings(peak, along).into_iter().flatten());
        }
        ends.retain(|t| *t >= t0.max(0.0) && *t <= t1);
        ends.sort_by(f64::total_cmp);
        for pair in ends.windows(2) {
            let middle = peak + 0.5 * (pair[0] + pair[1]) * along;
            if pair[1] > pair[0] && self.cuts.iter().all(|c| c.sees(middle)) {
                self.stretch((pair[0], pair[1]), disc, along, width, of, sums);
            }
        }
    }

    /// Adds a stretch of a ray that meets the disc's edge at `t0` and `t1`.
    fn stretch(
        &self,
        (from, to): (f64, f64),
        (t0, t1, a): (f64, f64, f64),
        along: DVec2,
        width: f64,
        of: &mut Integrand<'_>,
        sums: &mut Sums,
    ) {
        // e^−40 of what is largest on it is not looked for.
        let last = if self.bell.tails { to } else { to.min((from * from + 40.0).sqrt()) };
        let mut start = from;
        while start < last {
            let length = if self.bell.tails { start.max(1.5) } else { 2.5 / start.max(1.0) };
            let mut end = start + length;
            if end > last || last - end < 0.2 * length {
                end = last;
            }
            let (first_limb, last_limb) = (start == t0, end == t1);
            for (s, weight) in panels::panel(0.0, 1.0, ALONG) {
                let (up, down, slope) = eased(s, first_limb, last_limb);
                let t = start + (end - start) * up;
                // 1 − r², from the distances to both edges.
                let left = (t1 - end) + (end - start) * down;
                let square = a * left * (t - t0).max(0.0);
                let beyond = square / (1.0 + (1.0 - square).max(0.0).sqrt());
                let measure = weight * slope * (end - start) * t * width * self.determinant / PI;
                sums.add_dark(self.bell.peak + t * along, beyond, measure, of);
            }
            start = end;
        }
    }
}

/// From s to a share of a panel, what is left of it, and the derivative: slow at the ends that lie on the disc's limb.
fn eased(s: f64, first: bool, last: bool) -> (f64, f64, f64) {
    let cube = |x: f64| x * x * x;
    match (first, last) {
        (false, false) => (s, 1.0 - s, 1.0),
        (true, false) => (cube(s), 1.0 - cube(s), 3.0 * s * s),
        (false, true) => (1.0 - cube(1.0 - s), cube(1.0 - s), 3.0 * (1.0 - s) * (1.0 - s)),
        (true, true) => (step(s).0, step(1.0 - s).0, step(s).1),
    }
}
