//! Corner cubes as people write them.

use super::{Back, CornerCube, Glass};
use glam::DVec3;
use serde::Deserialize;
use std::f64::consts::TAU;
use sunglint_formats::ParseError;
use sunglint_formats::toml::{Document, Finite, NonNegative, Positive};

/// One `[[retro]]` of a target: a ring of equal cubes, or one.
///
/// ```toml
/// [[retro]]
/// count = 32                    # 1 unless given
/// centre_m = [0, 0, 0.0254]     # of the ring, body axes
/// axis = [0, 0, 1]              # of the ring; default z
/// ring_radius_m = 0.2989        # 0 unless given
/// tilt_deg = 85.14              # of the fronts' normals from the axis, outward; 0 unless given
/// first_deg = 0                 # azimuth of the first cube
/// diameter_mm = 38.1
/// material = "fused_silica"     # or "hollow", or index = 1.46
/// back = "uncoated"             # or "aluminium", "silver", "perfect"
/// dihedral_arcsec = 1.25        # excess over 90°, of all three; 0 unless given
/// clocking_deg = 0              # how the cubes are turned about their normals
/// ```
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the keys of the file, described above")]
pub struct RetroFile {
    pub count: Option<u32>,
    pub centre_m: Option<[Finite; 3]>,
    pub axis: Option<[Finite; 3]>,
    pub ring_radius_m: Option<NonNegative>,
    pub tilt_deg: Option<Finite>,
    pub first_deg: Option<Finite>,
    pub diameter_mm: Positive,
    pub material: Option<GlassName>,
    pub index: Option<Positive>,
    pub back: Option<BackName>,
    pub dihedral_arcsec: Option<Finite>,
    pub clocking_deg: Option<Finite>,
    #[serde(default)]
    pub note: String,
}

/// Names of glasses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the words of the file")]
pub enum GlassName {
    FusedSilica,
    Hollow,
}

/// Names of back faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the words of the file")]
pub enum BackName {
    Uncoated,
    Aluminium,
    Silver,
    Perfect,
}

/// Cubes of a target at most: a thousand times LAGEOS's in a file is a slip.
const MOST_CUBES: u32 = 20_000;

impl RetroFile {
    /// The cubes of the ring.
    ///
    /// # Errors
    /// [`ParseError`] at the key that makes no cube.
    pub fn cubes(&self, document: &Document, at: &str) -> Result<Vec<CornerCube>, ParseError> {
        let key = |name: &str| format!("{at}.{name}");
        let number = |value: &Option<Finite>| value.as_ref().map_or(0.0, |v| v.get());
        let vector = |value: &Option<[Finite; 3]>, none: DVec3| {
            value.as_ref().map_or(none, |v| DVec3::new(v[0].get(), v[1].get(), v[2].get()))
        };
        let count = self.count.unwrap_or(1);
        if !(1..=MOST_CUBES).contains(&count) {
            return Err(document.error_at(&key("count"), format!("1 to {MOST_CUBES} cubes")));
        }
        let Some(axis) = vector(&self.axis, DVec3::Z).try_normalize() else {
            return Err(document.error_at(&key("axis"), "a direction, not [0, 0, 0]"));
        };
        let glass = match (self.material, &self.index) {
            (Some(_), Some(_)) => {
                return Err(document.error_at(&key("index"), "either material or index, not both"));
            }
            (_, Some(n)) if !(1.0..=5.0).contains(&n.get()) => {
                return Err(document.error_at(&key("index"), "a refractive index from 1 to 5"));
            }
            (_, Some(n)) => Glass::Index(n.get()),
            (Some(GlassName::Hollow), None) => Glass::Hollow,
            (Some(GlassName::FusedSilica) | None, None) => Glass::FusedSilica,
        };
        // Metals at 532 nm: Rakić 1998 for aluminium, Johnson and Christy 1972 for silver.
        let back = match self.back {
            Some(BackName::Aluminium) => Back::Metal { n: 0.938, k: 6.42 },
            Some(BackName::Silver) => Back::Metal { n: 0.054, k: 3.43 },
            Some(BackName::Perfect) => Back::Perfect,
            Some(BackName::Uncoated) => Back::Uncoated,
            None if glass == Glass::Hollow => Back::Perfect,
            None => Back::Uncoated,
        };
        if glass == Glass::Hollow && back == Back::Uncoated {
            return Err(document.error_at(&key("back"), "a mirror: a hollow cube needs one"));
        }
        let dihedral_arcsec = number(&self.dihedral_arcsec);
        if dihedral_arcsec.abs() > 600.0 {
            return Err(document.error_at(&key("dihedral_arcsec"), "at most 600″ from 90°"));
        }
        let centre = vector(&self.centre_m, DVec3::ZERO);
        let radius = self.ring_radius_m.as_ref().map_or(0.0, |r| r.get());
        let (tilt, first) =
            (number(&self.tilt_deg).to_radians(), number(&self.first_deg).to_radians());
        let clocking = number(&self.clocking_deg).to_radians();
        // Azimuths count from x, or, about the x axis itself, from y.
        let start = [DVec3::X, DVec3::Y].map(|v| (v - v.dot(axis) * axis).try_normalize());
        let x = start.into_iter().flatten().next().unwrap_or(DVec3::Z);
        let y = axis.cross(x);
        Ok((0..count)
            .map(|k| {
                let (sin, cos) = (first + f64::from(k) * TAU / f64::from(count)).sin_cos();
                let out = cos * x + sin * y;
                let normal = (tilt.sin() * out + tilt.cos() * axis).normalize();
                let up = tilt.sin() * axis - tilt.cos() * out;
                let side = normal.cross(up);
                CornerCube {
                    position_m: centre + radius * out,
                    normal,
                    edge: clocking.cos() * up + clocking.sin() * side,
                    diameter_m: 1e-3 * self.diameter_mm.get(),
                    glass,
                    back,
                    dihedral_rad: (dihedral_arcsec / 3600.0).to_radians(),
                }
            })
            .collect())
    }
}
