//! Zones of surfaces of revolution of the second degree: parts of spheres, cylinders, cones and paraboloids about the z axis.
//!
//! All of them are quadrics, x² + y² + a z² + b z + c = 0, and what the zone hides of itself is cut off by planes. With B the quadric's
//! polar form and q the Sun or the observer (a point, or a direction as a point at infinity):
//!
//! - the outside faces q where B(p, q) > 0, the inside where B(p, q) < 0 (the polar plane of q);
//! - within a bowl with a plane mouth h(p) = 0, light reaches p through the mouth where Q(q) h(p) − 2 B(p, q) h(q) < 0: the cone (or
//!   cylinder) from q over the rim meets the quadric in the rim and in one other plane curve.
//!
//! So on each circle of latitude what is lit and seen is found as arcs, without error.

use glam::DVec3;
use std::f64::consts::TAU;

/// How the radius changes along the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Profile {
    /// r = radius + slope·t, z = t: cylinders and cones.
    Line {
        /// At z = 0, m.
        radius: f64,
        /// dr/dz.
        slope: f64,
    },
    /// t is the angle from −z about the middle: spheres and caps.
    Arc {
        /// m.
        radius: f64,
        /// Height of the middle, m.
        middle: f64,
    },
    /// r = t, z = t²/4f.
    Parabola {
        /// Focal length f, m.
        focus: f64,
    },
}

/// A circle of latitude: radius, height and their derivatives by the parameter.
#[derive(Debug, Clone, Copy)]
pub struct Ring {
    /// m.
    pub r: f64,
    /// m.
    pub z: f64,
    /// dr/dt.
    pub dr: f64,
    /// dz/dt.
    pub dz: f64,
}

/// One side of a zone.
#[derive(Debug, Clone, Copy)]
pub struct Zone {
    /// Profile of the zone.
    pub profile: Profile,
    /// Where the profile's parameter begins.
    pub from: f64,
    /// Where it ends: the mouth of a bowl.
    pub to: f64,
    /// Whether it is the side away from the axis; the inside is that of a bowl with a plane mouth at `to`.
    pub outward: bool,
}

/// The half-space p·normal + offset > 0.
#[derive(Debug, Clone, Copy)]
pub struct Half {
    /// Not of unit length.
    pub normal: DVec3,
    /// Constant.
    pub offset: f64,
}

/// Where light comes from or goes to, in the part's axes.
#[derive(Debug, Clone, Copy)]
pub enum Pole {
    /// A unit direction.
    Far(DVec3),
    /// A point, m.
    Near(DVec3),
}

impl Pole {
    /// The unit direction from a point.
    pub fn from(&self, p: DVec3) -> DVec3 {
        match self {
            Pole::Far(d) => *d,
            Pole::Near(q) => (*q - p).normalize_or_zero(),
        }
    }
}

impl Half {
    /// Positive inside.
    pub fn at(&self, p: DVec3) -> f64 {
        self.normal.dot(p) + self.offset
    }
}

impl Profile {
    /// The circle at a parameter.
    pub fn at(&self, t: f64) -> Ring {
        match *self {
            Profile::Line { radius, slope } => {
                Ring { r: radius + slope * t, z: t, dr: slope, dz: 1.0 }
            }
            Profile::Arc { radius, middle } => {
                let (sin, cos) = t.sin_cos();
                Ring {
                    r: radius * sin,
                    z: middle - radius * cos,
                    dr: radius * cos,
                    dz: radius * sin,
                }
            }
            Profile::Parabola { focus } => {
                Ring { r: t, z: t * t / (4.0 * focus), dr: 1.0, dz: t / (2.0 * focus) }
            }
        }
    }

    /// The parameter of the circle next to a point, given its distance from the axis and its height.
    pub fn parameter(&self, r: f64, z: f64) -> f64 {
        match *self {
            Profile::Line { .. } => z,
            Profile::Arc { middle, .. } => r.atan2(middle - z),
            Profile::Parabola { .. } => r,
        }
    }

    /// a, b, c of the quadric.
    fn quadric(&self) -> [f64; 3] {
        match *self {
            Profile::Line { radius, slope } => {
                [-slope * slope, -2.0 * radius * slope, -radius * radius]
            }
            Profile::Arc { radius, middle } => {
                [1.0, -2.0 * middle, (middle - radius) * (middle + radius)]
            }
            Profile::Parabola { focus } => [0.0, -4.0 * focus, 0.0],
        }
    }
}

impl Zone {
    /// The sign of the side: 1 outside, −1 inside.
    pub fn sign(&self) -> f64 {
        if self.outward { 1.0 } else { -1.0 }
    }

    /// A point of it.
    pub fn point(&self, t: f64, azimuth: f64) -> DVec3 {
        let ring = self.profile.at(t);
        let (sin, cos) = azimuth.sin_cos();
        DVec3::new(ring.r * cos, ring.r * sin, ring.z)
    }

    /// The half-spaces that hold what faces a pole and is not hidden from it by the zone itself; `None` where nothing is left.
    pub fn halves(&self, pole: Pole) -> Option<[Option<Half>; 2]> {
        let [a, b, c] = self.profile.quadric();
        let (q, w) = match pole {
            Pole::Far(d) => (d, 0.0),
            Pole::Near(q) => (q, 1.0),
        };
        // B(p, q) as a function of p.
        let polar = Half {
            normal: DVec3::new(q.x, q.y, a * q.z + 0.5 * b * w),
            offset: 0.5 * b * q.z + c * w,
        };
        if self.outward {
            return Some([Some(polar), None]);
        }
        let mouth = self.profile.at(self.to).z;
        let beyond = mouth * w - q.z;
        if beyond >= 0.0 {
            return None;
        }
        let square = q.x * q.x + q.y * q.y + a * q.z * q.z + b * q.z * w + c * w * w;
        let facing = Half { normal: -polar.normal, offset: -polar.offset };
        let through = Half {
            normal: 2.0 * beyond * polar.normal + DVec3::new(0.0, 0.0, square),
            offset: 2.0 * beyond * polar.offset - square * mouth,
        };
        Some([Some(facing), Some(through)])
    }

    /// The parameters at which the edges of two half-spaces meet on it: their line meets a quadric twice at most.
    pub fn meets(&self, one: &Half, other: &Half) -> Vec<f64> {
        let along = one.normal.cross(other.normal);
        let square = along.length_squared();
        if square <= 1e-24 * one.normal.length_squared() * other.normal.length_squared() {
            return Vec::new();
        }
        // The line's point next to the origin.
        let p = (other.offset * one.normal - one.offset * other.normal).cross(along) / square;
        let [a, b, c] = self.profile.quadric();
        let u = along / square.sqrt();
        let second = u.x * u.x + u.y * u.y + a * u.z * u.z;
        let first = p.x * u.x + p.y * u.y + a * p.z * u.z + 0.5 * b * u.z;
        let value = p.x * p.x + p.y * p.y + a * p.z * p.z + b * p.z + c;
        let at = |s: f64| {
            let q = p + s * u;
            self.profile.parameter(q.x.hypot(q.y), q.z)
        };
        let root = first * first - second * value;
        if second == 0.0 {
            return if first == 0.0 { Vec::new() } else { vec![at(-0.5 * value / first)] };
        }
        if root < 0.0 {
            return Vec::new();
        }
        [root.sqrt(), -root.sqrt()].map(|r| at((r - first) / second)).to_vec()
    }

    /// Returns the area of the zone, m², between two parameters and two azimuths `turn` apart: by Simpson's rule, for sizes and shares only.
    pub fn area(&self, from: f64, to: f64, turn: f64) -> f64 {
        let density = |t: f64| {
            let ring = self.profile.at(t);
            ring.r.abs() * ring.dr.hypot(ring.dz)
        };
        let middle = density(0.5 * (from + to));
        (to - from) / 6.0 * (density(from) + 4.0 * middle + density(to)) * turn
    }
}

/// Appends where the half-space's edge crosses a circle of latitude, as azimuths from `start` to `start` + 2π.
pub fn crossings(half: &Half, ring: &Ring, start: f64, out: &mut Vec<f64>) {
    let amplitude = ring.r * half.normal.x.hypot(half.normal.y);
    let level = half.normal.z * ring.z + half.offset;
    if level.abs() >= amplitude {
        return;
    }
    let middle = half.normal.y.atan2(half.normal.x);
    let width = (-level / amplitude).acos();
    for azimuth in [middle - width, middle + width] {
        out.push(start + (azimuth - start).rem_euclid(TAU));
    }
}
