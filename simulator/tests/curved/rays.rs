//! An independent truth: points at random on implicit surfaces, from each a ray to the Sun and one to the observer.

use super::*;
use std::f64::consts::{FRAC_1_PI, TAU};

/// A surface in its part's axes.
enum Surface {
    Sphere(f64),
    /// Radii at −h/2 and h/2, h.
    Wall(f64, f64, f64),
    /// Radius, height, up.
    End(f64, f64, bool),
    /// R²/d, R, inside.
    Bowl(f64, f64, bool),
    Triangle(DVec3, DVec3, DVec3),
}

impl Surface {
    fn area(&self) -> f64 {
        match *self {
            Surface::Sphere(r) => 2.0 * TAU * r * r,
            Surface::Wall(a, b, h) => 0.5 * TAU * (a + b) * h.hypot(a - b),
            Surface::End(r, ..) => 0.5 * TAU * r * r,
            // The samples are even over the mouth and weigh the slope.
            Surface::Bowl(_, r, _) => 0.5 * TAU * r * r,
            Surface::Triangle(_, ab, ac) => 0.5 * ab.cross(ac).length(),
        }
    }

    /// A point, the outward normal there, and the weight of the sample.
    fn sample(&self, rng: &mut Rng) -> (DVec3, DVec3, f64) {
        let (turn, u) = (TAU * rng.random::<f64>(), rng.random::<f64>());
        let ring = |r: f64, z: f64| DVec3::new(r * turn.cos(), r * turn.sin(), z);
        match *self {
            Surface::Sphere(r) => {
                let z = 2.0 * u - 1.0;
                let n = ring((1.0 - z * z).sqrt(), z);
                (r * n, n, 1.0)
            }
            Surface::Wall(a, b, h) => {
                let radius = a + (b - a) * u;
                let n = ring(h, a - b).normalize();
                (ring(radius, h * (u - 0.5)), n, 2.0 * radius / (a + b))
            }
            Surface::End(r, z, up) => {
                (ring(r * u.sqrt(), z), if up { DVec3::Z } else { -DVec3::Z }, 1.0)
            }
            Surface::Bowl(c, r, inside) => {
                let p = ring(r * u.sqrt(), r * r * u / c);
                let up = DVec3::new(-2.0 * p.x / c, -2.0 * p.y / c, 1.0);
                let n = up.normalize();
                (p, if inside { n } else { -n }, up.length())
            }
            Surface::Triangle(a, ab, ac) => {
                let (mut u, mut v) = (u, rng.random::<f64>());
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                (a + u * ab + v * ac, ab.cross(ac).normalize(), 1.0)
            }
        }
    }

    /// Whether a ray meets it between `from` and `to`, times its direction.
    fn stops(&self, p: DVec3, d: DVec3, to: f64) -> bool {
        let within = |s: f64| s > 1e-7 && s < to;
        // a s² + 2 b s + c = 0.
        let quadratic = |a: f64, b: f64, c: f64, holds: &dyn Fn(DVec3) -> bool| {
            if a.abs() < 1e-14 {
                let s = -0.5 * c / b;
                return within(s) && holds(p + s * d);
            }
            let root = b * b - a * c;
            root > 0.0
                && [(-b - root.sqrt()) / a, (-b + root.sqrt()) / a]
                    .into_iter()
                    .any(|s| within(s) && holds(p + s * d))
        };
        let (pp, pd, dd) = (p.truncate(), d.truncate(), d.truncate());
        match *self {
            Surface::Sphere(r) => quadratic(1.0, p.dot(d), p.length_squared() - r * r, &|_| true),
            Surface::Wall(a, b, h) => {
                let (m, s) = (0.5 * (a + b), (b - a) / h);
                let (r, rs) = (m + s * p.z, s * d.z);
                quadratic(
                    dd.length_squared() - rs * rs,
                    pp.dot(pd) - r * rs,
                    pp.length_squared() - r * r,
                    &|q| q.z.abs() <= 0.5 * h && m + s * q.z >= 0.0,
                )
            }
            Surface::End(r, z, _) => {
                let s = (z - p.z) / d.z;
                within(s) && (p + s * d).truncate().length() < r
            }
            Surface::Bowl(c, r, _) => quadratic(
                dd.length_squared(),
                pp.dot(pd) - 0.5 * c * d.z,
                pp.length_squared() - c * p.z,
                &|q| q.z <= r * r / c,
            ),
            Surface::Triangle(a, ab, ac) => {
                // Möller and Trumbore (1997).
                let h = d.cross(ac);
                let det = ab.dot(h);
                if det.abs() < 1e-14 {
                    return false;
                }
                let s = p - a;
                let u = s.dot(h) / det;
                let q = s.cross(ab);
                let v = d.dot(q) / det;
                u >= 0.0 && v >= 0.0 && u + v <= 1.0 && within(ac.dot(q) / det)
            }
        }
    }
}

fn surfaces(shape: &Shape) -> Vec<Surface> {
    match shape {
        Shape::Sphere { radius_m } => vec![Surface::Sphere(*radius_m)],
        Shape::Curved(Curved::Frustum { bottom_radius_m: a, top_radius_m: b, height_m: h }) => {
            vec![
                Surface::Wall(*a, *b, *h),
                Surface::End(*a, -0.5 * h, false),
                Surface::End(*b, 0.5 * h, true),
            ]
        }
        Shape::Curved(Curved::Dish { radius_m: r, depth_m: d, inside, outside, .. }) => {
            let sides = [(*inside, true), (*outside, false)];
            sides.iter().filter(|s| s.0).map(|s| Surface::Bowl(r * r / d, *r, s.1)).collect()
        }
        Shape::Mesh(mesh) => {
            mesh.faces().map(|[a, b, c]| Surface::Triangle(a, b - a, c - a)).collect()
        }
        other => panic!("{other:?}"),
    }
}

/// W of each white Lambert part with its standard error. Shares nothing with the engine.
pub fn rays(target: &Target, sun: DVec3, view: View, count: u64, seed: u64) -> Vec<(f64, f64)> {
    let mut all = Vec::new();
    for (k, part) in target.parts.iter().enumerate() {
        all.extend(surfaces(&part.shape).into_iter().map(|s| (k, part.placement, s)));
    }
    let area: f64 = all.iter().map(|(_, _, s)| s.area()).sum();
    let blocked = |p: DVec3, d: DVec3, to: f64| {
        all.iter().any(|(_, place, surface)| {
            let back = place.rotation.inverse();
            surface.stops(back * (p - place.offset_m), back * d, to)
        })
    };
    let mut rng = rng(seed);
    let mut sums = vec![(0.0, 0.0); target.parts.len()];
    for _ in 0..count {
        let mut at = area * rng.random::<f64>();
        let chosen = all.iter().find(|(_, _, s)| {
            at -= s.area();
            at <= 0.0
        });
        let Some((k, place, surface)) = chosen else { continue };
        let (p, n, weight) = surface.sample(&mut rng);
        let (p, n) = (place.point(p), place.rotation * n);
        let (to, range, nearness) = match view {
            View::Distant(d) => (d, f64::INFINITY, 1.0),
            View::At(q) => {
                let away = q - p;
                (away.normalize(), away.length(), q.length_squared() / away.length_squared())
            }
        };
        let (i, o) = (n.dot(sun), n.dot(to));
        if i <= 0.0 || o <= 0.0 || blocked(p, sun, f64::INFINITY) || blocked(p, to, range) {
            continue;
        }
        let value = area * weight * i * o * nearness * FRAC_1_PI;
        sums[*k].0 += value;
        sums[*k].1 += value * value;
    }
    let n = count as f64;
    sums.into_iter()
        .map(|(s, s2)| (s / n, ((s2 / n - (s / n).powi(2)).max(0.0) / n).sqrt()))
        .collect()
}

/// Asserts that each part agrees with rays within 4.5 of their standard errors and what the evaluation claims to err by.
pub fn agree(what: &str, target: &Target, sun: DVec3, view: View, count: u64, seed: u64) {
    let (out, done) = evaluate(target, sun, view, 1e-4);
    let claim = done.error * out.iter().sum::<f64>();
    for (part, (w, s)) in rays(target, sun, view, count, seed).into_iter().enumerate() {
        let off = (out[part] - w).abs();
        let limit = 4.5 * s + claim + 1e-5;
        assert!(off < limit, "{what}, part {part}: {} {w} ± {s}, claimed {claim:.1e}", out[part]);
    }
}
