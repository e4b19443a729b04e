//! The stop that limits the light to the meter: its solid angle as the sample sees it.

use super::RetroError;
use crate::table::ConeSpread;
use serde::Serialize;
use std::f64::consts::PI;

/// A stop whose middle is on the beam. Its plate may be tilted: the plate of a beam splitter at 45° is seen foreshortened.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stop {
    /// Shape of the stop.
    pub shape: Shape,
    /// Angle between its normal and the beam, degrees.
    pub tilt_deg: f64,
    /// Distance of its middle from the sample, mm.
    pub distance_mm: f64,
}

/// The shape of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A disc.
    Disc {
        /// Diameter of the disc, mm.
        diameter_mm: f64,
    },
    /// A rectangle.
    Rectangle {
        /// Along the direction in which it is tilted, mm.
        width_mm: f64,
        /// Across that, mm.
        height_mm: f64,
    },
}

/// Directions around the beam in which the edge is looked for: a disc's solid angle converges faster than any power of this.
const AROUND: usize = 256;

impl Stop {
    /// Looks whether there can be such a stop.
    ///
    /// # Errors
    /// Sizes and a distance that are not above 0; a tilt of 85° or more; a near edge in the sample's plane.
    pub fn check(&self) -> Result<(), RetroError> {
        let (first, second) = match self.shape {
            Shape::Disc { diameter_mm } => (diameter_mm, diameter_mm),
            Shape::Rectangle { width_mm, height_mm } => (width_mm, height_mm),
        };
        for (name, found) in [
            ("stop's size, mm", first),
            ("stop's size, mm", second),
            ("stop's distance, mm", self.distance_mm),
        ] {
            if !(found.is_finite() && found > 0.0) {
                return Err(RetroError::Number { name, found, expected: "a number above 0" });
            }
        }
        let found = self.tilt_deg;
        if found.is_nan() || found.abs() >= 85.0 {
            let (name, expected) = ("stop's tilt, deg", "less than 85");
            return Err(RetroError::Number { name, found, expected });
        }
        let nearest = self.distance_mm - 0.5 * first * self.tilt_deg.to_radians().sin().abs();
        if nearest <= 0.0 {
            let (name, expected) = ("stop's distance, mm", "more than how far its edge leans");
            return Err(RetroError::Number { name, found: self.distance_mm, expected });
        }
        Ok(())
    }

    /// Returns the solid angle of the stop from the sample, sr: exact, not the plate's area over the square of the distance.
    pub fn solid_angle_sr(&self) -> f64 {
        match self.shape {
            Shape::Rectangle { width_mm, height_mm } => self.rectangle_sr(width_mm, height_mm),
            Shape::Disc { diameter_mm } => {
                let step = 2.0 * PI / AROUND as f64;
                let cap = |k: usize| {
                    let s = self.disc_edge(0.5 * diameter_mm, step * k as f64);
                    // 1 − cos of the edge's angle, without the loss of digits of small ones.
                    let cos = 1.0 / s.hypot(1.0);
                    s * s * cos * cos / (1.0 + cos)
                };
                step * (0..AROUND).map(cap).sum::<f64>()
            }
        }
    }

    /// The tangent of the angle between the beam and a disc's edge, at an azimuth around the beam from the direction in which it is tilted.
    ///
    /// A ray at tangent s meets the plate at z = d/(1 + s cosφ tanψ), at (s cosφ, s sinφ, 1) z; its distance from the middle is the radius.
    fn disc_edge(&self, radius_mm: f64, azimuth: f64) -> f64 {
        let lean = azimuth.cos() * self.tilt_deg.to_radians().tan();
        radius_mm / (self.distance_mm * lean.hypot(1.0) - radius_mm * lean)
    }

    /// Two triangles, each by Van Oosterom and Strackee (IEEE Trans. Biomed. Eng. 30, 125, 1983).
    fn rectangle_sr(&self, width_mm: f64, height_mm: f64) -> f64 {
        let (sin, cos) = self.tilt_deg.to_radians().sin_cos();
        let corner = |x: f64, y: f64| {
            let (x, y) = (0.5 * x * width_mm, 0.5 * y * height_mm);
            glam::DVec3::new(x * cos, y, self.distance_mm - x * sin).normalize()
        };
        let [a, b, c, d] =
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        let triangle = |a: glam::DVec3, b: glam::DVec3, c: glam::DVec3| {
            // The volume from the edges: of small triangles that keeps its digits.
            let volume = a.dot((b - a).cross(c - a));
            2.0 * volume.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
        };
        triangle(a, b, c) + triangle(a, c, d)
    }

    /// Root mean square angles of the directions into the stop about the beam, seen from the sample; the stop is tilted in the plane of incidence.
    ///
    /// A rectangle has a twelfth of the square of its sides, a disc a sixteenth of its diameter's, as the beam sees them. The rest is a part (size/distance)² of that.
    pub fn spread(&self) -> ConeSpread {
        let (width, height) = match self.shape {
            Shape::Rectangle { width_mm, height_mm } => {
                let root = 12_f64.sqrt();
                (width_mm / root, height_mm / root)
            }
            Shape::Disc { diameter_mm } => (0.25 * diameter_mm, 0.25 * diameter_mm),
        };
        let angle_deg = |mm: f64| (mm / self.distance_mm).atan().to_degrees();
        let along = width * self.tilt_deg.to_radians().cos();
        ConeSpread { along_deg: angle_deg(along), across_deg: angle_deg(height) }
    }

    /// Half the angle of a round cone of the same solid angle, degrees.
    pub fn cone_half_angle_deg(&self) -> f64 {
        // Ω = 4π sin²(half/2).
        2.0 * (self.solid_angle_sr() / (4.0 * PI)).sqrt().min(1.0).asin().to_degrees()
    }
}
