//! Cuts that hide a part of the Sun's disc: a facet's own horizon, the Earth.
//!
//! Places on the disc are x, y in units of its radius, as they are seen on a plane across the line to its middle: of the direction
//! s √(1 − sin²δ r²) + sin δ (x u + y v), with δ the Sun's angular radius. There dω cos ψ = sin²δ dx dy, and μ = √(1 − r²).

use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The Sun's disc, in some axes.
#[derive(Debug, Clone, Copy)]
pub struct Disc {
    /// Unit vector to its middle.
    pub middle: DVec3,
    /// First axis across.
    pub u: DVec3,
    /// Second axis across.
    pub v: DVec3,
    /// Sine of its angular radius.
    pub sine: f64,
}

impl Disc {
    /// About a unit vector, its first axis along `along` as far as that goes.
    pub fn new(middle: DVec3, along: DVec3, sine: f64) -> Self {
        let across = along - along.dot(middle) * middle;
        let u = if across.length_squared() > 1e-20 {
            across.normalize()
        } else {
            middle.any_orthonormal_vector()
        };
        Self { middle, u, v: middle.cross(u), sine }
    }

    /// cos ψ of a place.
    pub fn cosine(&self, place: DVec2) -> f64 {
        (1.0 - self.sine * self.sine * place.length_squared()).max(0.0).sqrt()
    }

    /// The unit vector to a place.
    pub fn direction(&self, place: DVec2) -> DVec3 {
        let across = place * self.sine;
        self.cosine(place) * self.middle + across.x * self.u + across.y * self.v
    }
}

/// Where something begins to hide: places with e·x + c + d r² > 0 are visible.
#[derive(Debug, Clone, Copy)]
pub struct Cut {
    e: DVec2,
    c: f64,
    d: f64,
}

/// Part of the disc that a cut leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Left {
    /// All of it.
    All,
    /// A part.
    Part,
    /// Nothing.
    Nothing,
}

impl Cut {
    /// The plane of a facet with that normal (in the axes of the disc).
    pub fn horizon(disc: &Disc, normal: DVec3) -> Self {
        let height = normal.dot(disc.middle);
        // √(1 − sin²δ r²) to its second term: the next is 1e-10.
        Self {
            e: DVec2::new(normal.dot(disc.u), normal.dot(disc.v)),
            c: height / disc.sine,
            d: -0.5 * height * disc.sine,
        }
    }

    /// A globe of an angular radius (radians) about a unit vector.
    pub fn globe(disc: &Disc, toward: DVec3, radius_rad: f64) -> Self {
        let separation =
            2.0 * (disc.middle - toward).length().atan2((disc.middle + toward).length());
        let edge =
            2.0 * (0.5 * (separation + radius_rad)).sin() * (0.5 * (separation - radius_rad)).sin();
        Self {
            e: -DVec2::new(toward.dot(disc.u), toward.dot(disc.v)),
            c: edge / disc.sine,
            d: 0.5 * separation.cos() * disc.sine,
        }
    }

    /// Returns the part of the disc that the cut leaves.
    pub fn left(&self) -> Left {
        let mut kinks = Vec::new();
        self.kinks(&mut kinks);
        if kinks.into_iter().any(|r| r > 0.0 && r < 1.0) {
            return Left::Part;
        }
        // All rings are alike.
        match self.arc(0.5).1 {
            half if half >= PI => Left::All,
            half if half <= 0.0 => Left::Nothing,
            _ => Left::Part,
        }
    }

    /// Whether a place is visible.
    pub fn sees(&self, place: DVec2) -> bool {
        self.e.dot(place) + self.c + self.d * place.length_squared() > 0.0
    }

    /// The visible arc of the ring of radius r: the angle of its middle and half its width.
    pub fn arc(&self, r: f64) -> (f64, f64) {
        let (level, reach) = (self.c + self.d * r * r, self.e.length() * r);
        let middle = self.e.y.atan2(self.e.x);
        let half = if level >= reach {
            PI
        } else if level <= -reach {
            0.0
        } else {
            (-level / reach).acos()
        };
        (middle, half)
    }

    /// The radii between 0 and 1 at which rings begin or cease to be cut.
    pub fn kinks(&self, to: &mut Vec<f64>) {
        let e = self.e.length();
        for slope in [e, -e] {
            to.extend(roots(self.d, slope, self.c).into_iter().flatten());
        }
    }

    /// Where a ray from `from` along `along` meets its edge: parameters.
    pub fn crossings(&self, from: DVec2, along: DVec2) -> [Option<f64>; 2] {
        let slope = self.e.dot(along) + 2.0 * self.d * from.dot(along);
        let start = self.e.dot(from) + self.c + self.d * from.length_squared();
        roots(self.d * along.length_squared(), slope, start)
    }

    /// Where its edge meets the disc's.
    pub fn corners(&self) -> Option<[DVec2; 2]> {
        let (middle, half) = self.arc(1.0);
        let at = |angle: f64| DVec2::new(angle.cos(), angle.sin());
        (half > 0.0 && half < PI).then(|| [at(middle - half), at(middle + half)])
    }
}

/// The visible arcs of a ring under several cuts: from and to angles, appended.
pub fn arcs(cuts: &[Cut], r: f64, to: &mut Vec<(f64, f64)>) {
    to.clear();
    to.push((0.0, TAU));
    for cut in cuts {
        let (middle, half) = cut.arc(r);
        if half >= PI {
            continue;
        }
        let before = std::mem::take(to);
        for (from, end) in before {
            // The arc and its copies a turn away.
            for turn in -2..=2 {
                let centre = middle + TAU * f64::from(turn);
                let (a, b) = ((centre - half).max(from), (centre + half).min(end));
                if b > a {
                    to.push((a, b));
                }
            }
        }
    }
}

/// Real roots of a x² + b x + c, without cancellation; `None` where there are none.
fn roots(a: f64, b: f64, c: f64) -> [Option<f64>; 2] {
    let root = b * b - 4.0 * a * c;
    if root < 0.0 {
        return [None, None];
    }
    let q = -0.5 * (b + root.sqrt().copysign(b));
    let finite = |x: f64| x.is_finite().then_some(x);
    [finite(q / a), finite(c / q)]
}
