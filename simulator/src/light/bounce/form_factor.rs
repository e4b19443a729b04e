//! Exchange of diffuse light between two polygons that see all of each other, in closed form.
//!
//! A F = 1/(2π) ∮∮ ln r dx·dy, along both outlines (Stokes' theorem twice; Sparrow 1963). Of two edges side by side both integrals are closed
//! forms; of others the inner one is, and the outer one is a Gauss rule whose points are drawn to the ends, where edges touch. Either
//! edge may be the outer one: that of whose two rules agree better.

use glam::DVec3;
use std::f64::consts::TAU;
use std::sync::LazyLock;
use sunglint_numerics::gauss;

/// Points of the outer integral, of the rule that is believed and of the one that it is held against.
const POINTS: [usize; 2] = [10, 6];
/// Edges whose directions differ by less than this are side by side.
const ALONG: f64 = 1e-9;

/// Places (0 to 1) and weights of both rules.
static RULES: LazyLock<[Vec<(f64, f64)>; 2]> = LazyLock::new(|| {
    POINTS.map(|n| {
        // t²(3 − 2t) takes the sting of u ln u at both ends.
        let drawn = |(x, w): (f64, f64)| {
            let t = 0.5 * (x + 1.0);
            (t * t * (3.0 - 2.0 * t), 0.5 * w * 6.0 * t * (1.0 - t))
        };
        gauss::legendre(n).into_iter().map(drawn).collect()
    })
});

/// Area times form factor of two polygons, each counter-clockwise about its front, each wholly before the other's plane and nothing between them; and how far two rules are apart, m².
pub fn exchange(a: &[DVec3], b: &[DVec3]) -> (f64, f64) {
    let edges = |ring: &[DVec3]| -> Vec<Edge> {
        let n = ring.len();
        (0..n).filter_map(|k| Edge::new(ring[k], ring[(k + 1) % n])).collect()
    };
    let (ours, others) = (edges(a), edges(b));
    let (mut sum, mut apart) = (0.0, 0.0);
    for ours in &ours {
        for other in &others {
            let cos = ours.along.dot(other.along);
            if cos.abs() <= ALONG {
                continue;
            }
            if ours.along.cross(other.along).length() <= ALONG {
                sum += cos * ours.beside(other, cos.signum());
                continue;
            }
            // Where one edge begins on the other only one of both orders is smooth.
            let both = [(ours, other), (other, ours)].map(|(outer, inner)| {
                let [fine, coarse] = [0, 1].map(|rule| outer.across(inner, &RULES[rule]));
                (fine, fine - coarse)
            });
            let (fine, off) = if both[0].1.abs() <= both[1].1.abs() { both[0] } else { both[1] };
            sum += cos * fine;
            apart += cos * off;
        }
    }
    ((sum / TAU).max(0.0), (apart / TAU).abs())
}

struct Edge {
    from: DVec3,
    along: DVec3,
    length: f64,
}

impl Edge {
    fn new(from: DVec3, to: DVec3) -> Option<Self> {
        let length = from.distance(to);
        (length > 0.0).then(|| Self { from, along: (to - from) / length, length })
    }

    /// ∫∫ ln r over both of two edges side by side; `sense` is −1 where they run against each other.
    fn beside(&self, other: &Self, sense: f64) -> f64 {
        let away = other.from - self.from;
        let at = away.dot(self.along);
        let h = (away - at * self.along).length();
        let (c, d) = (at, at + sense * other.length);
        let (low, high) = (c.min(d), c.max(d));
        // K″ = ln √(z² + h²).
        let k = |z: f64| {
            let square = z * z + h * h;
            if square <= 0.0 {
                return 0.0;
            }
            let turn = if h > 0.0 { h * z * (z / h).atan() } else { 0.0 };
            0.25 * (z * z - h * h) * square.ln() - 0.75 * z * z + turn
        };
        k(self.length - low) - k(-low) - k(self.length - high) + k(-high)
    }

    /// The same of two edges at an angle.
    fn across(&self, other: &Self, rule: &[(f64, f64)]) -> f64 {
        let inner = |(place, weight): &(f64, f64)| {
            let away = self.from + place * self.length * self.along - other.from;
            let u = away.dot(other.along);
            let h = (away - u * other.along).length();
            let f = |z: f64| {
                let square = z * z + h * h;
                if square <= 0.0 {
                    return 0.0;
                }
                let turn = if h > 0.0 { h * (z / h).atan() } else { 0.0 };
                0.5 * z * square.ln() - z + turn
            };
            weight * (f(other.length - u) - f(-u))
        };
        self.length * rule.iter().map(inner).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn square(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Vec<DVec3> {
        let (o, u, v) = (DVec3::from(origin), DVec3::from(u), DVec3::from(v));
        vec![o, o + u, o + u + v, o + v]
    }

    /// Truth: two unit squares opposite at distance 1, F = 0.199 825 (Howell's catalogue C-11, closed form below), two with a common edge at a right angle F = 0.200 044 (C-14), all edges side by
    /// side: 1e-12 of the closed forms. The same two turned about the common edge by 60° and 120°: F by a double sum over points, taken to parts of no size (2e-3 of it: by
    /// its last step).
    #[test]
    fn squares_as_in_the_catalogue() {
        let below = square([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let above = square([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]);
        // X = Y = 1.
        let opposite = 2.0 / PI
            * ((4.0_f64 / 3.0).sqrt().ln() + 2.0 * 2.0_f64.sqrt() * (1.0 / 2.0_f64.sqrt()).atan()
                - 2.0 * 1.0_f64.atan());
        let (found, apart) = exchange(&below, &above);
        assert!((found - opposite).abs() < 1e-12 && apart == 0.0, "{found} {opposite}");
        // H = W = 1.
        let beside = (2.0 * 1.0_f64.atan() - 2.0_f64.sqrt() * (1.0 / 2.0_f64.sqrt()).atan()
            + 0.25 * (4.0_f64 / 3.0 * (3.0_f64 / 4.0).powi(2)).ln())
            / PI;
        let wall = square([0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let (found, _) = exchange(&below, &wall);
        assert!((found - beside).abs() < 1e-12, "{found} {beside}");
        for degrees in [60.0_f64, 120.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let leaf = square([0.0; 3], [0.0, 1.0, 0.0], [cos, 0.0, sin]);
            let (found, apart) = exchange(&below, &leaf);
            let [near, far] = [48, 96].map(|n| summed(&below, &leaf, n));
            // Beside a common edge the sum errs as the size of its parts.
            let truth = 2.0 * far - near;
            assert!((found / truth - 1.0).abs() < 2e-3, "{found} {truth}");
            assert!(apart < 1e-3 * found);
        }
    }

    /// Truth: a double sum over points. Two quadrangles of no symmetry, apart by their own size and by a tenth of it; 1e-4 of the sum's own convergence.
    #[test]
    fn quadrangles_by_points() {
        for gap in [1.0, 0.1] {
            let a = [[0.0, 0.0, 0.0], [1.1, 0.1, 0.0], [0.9, 1.0, 0.0], [-0.1, 0.8, 0.0]];
            let b = [
                [0.1, 0.2, gap],
                [0.0, 1.1, gap + 0.2],
                [1.0, 0.9, gap + 0.3],
                [0.8, 0.0, gap + 0.05],
            ];
            let a: Vec<DVec3> = a.into_iter().map(DVec3::from).collect();
            // Four points in one plane.
            let mut b: Vec<DVec3> = b.into_iter().map(DVec3::from).collect();
            b[3] = b[0] + 0.95 * (b[2] - b[1]);
            let (found, apart) = exchange(&a, &b);
            let [near, far] = [summed(&a, &b, 48), summed(&a, &b, 96)];
            let truth = far + (far - near) / 3.0;
            let allowed = 2.0 * (far - near).abs() + 1e-4 * truth + 2.0 * apart;
            assert!((found - truth).abs() < allowed, "{gap}: {found} {truth} {apart:e}");
            assert!(apart < 2e-3 * found, "{apart:e}");
        }
    }

    /// A F of two quadrangles by the middles of n by n parts of each.
    fn summed(a: &[DVec3], b: &[DVec3], n: usize) -> f64 {
        let cells = |ring: &[DVec3]| -> Vec<(DVec3, DVec3)> {
            let at = |s: f64, t: f64| {
                let (low, high) = (ring[0].lerp(ring[1], s), ring[3].lerp(ring[2], s));
                low.lerp(high, t)
            };
            let part = |k: usize| k as f64 / n as f64;
            let mut all = Vec::new();
            for i in 0..n {
                for j in 0..n {
                    let (s, t, d) = (part(i), part(j), 1.0 / n as f64);
                    let [p, q, r, o] = [at(s, t), at(s + d, t), at(s + d, t + d), at(s, t + d)];
                    all.push((0.25 * (p + q + r + o), 0.5 * (r - p).cross(o - q)));
                }
            }
            all
        };
        let (a, b) = (cells(a), cells(b));
        let one = |(p, m): &(DVec3, DVec3), (q, n): &(DVec3, DVec3)| {
            let away = *q - *p;
            let square = away.length_squared();
            (m.dot(away).max(0.0) * (-n.dot(away)).max(0.0)) / (PI * square * square)
        };
        a.iter().map(|a| b.iter().map(|b| one(a, b)).sum::<f64>()).sum()
    }
}
