//! Directions on the sky and the angles between them.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use sunglint_formats::wcs::circle_deg;

pub use sunglint_formats::wcs::Equatorial;

/// The angle between two directions, radians in [0, π]; their lengths do not matter. Stable at 0 and 180°
/// (atan2 of the cross and dot product, not arc cosine). A zero vector gives 0.
pub fn separation_rad(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// The angle between two directions, degrees in [0, 180]; see [`separation_rad`].
pub fn separation_deg(a: DVec3, b: DVec3) -> f64 {
    separation_rad(a, b).to_degrees()
}

/// Azimuth and altitude as numbers: what is shown, or given, of a direction. Written as a pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "[f64; 2]", from = "[f64; 2]")]
pub struct AzimuthAltitude {
    /// Azimuth, degrees: north 0°, east 90°.
    pub azimuth_deg: f64,
    /// Altitude, degrees.
    pub altitude_deg: f64,
}

impl AzimuthAltitude {
    /// Azimuth and altitude, degrees.
    pub const fn to_array(self) -> [f64; 2] {
        [self.azimuth_deg, self.altitude_deg]
    }
}

impl From<[f64; 2]> for AzimuthAltitude {
    /// Takes the azimuth first.
    fn from([azimuth_deg, altitude_deg]: [f64; 2]) -> Self {
        Self { azimuth_deg, altitude_deg }
    }
}

impl From<AzimuthAltitude> for [f64; 2] {
    fn from(at: AzimuthAltitude) -> Self {
        at.to_array()
    }
}

/// A direction above (or below) a site's horizon, TRUE: no refraction is applied anywhere in this module.
///
/// It is kept as a unit vector in east, north, up, so that nothing is lost near the zenith.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Horizontal {
    enu: DVec3,
}

impl Horizontal {
    /// At an azimuth (north 0°, east 90°) and altitude, degrees.
    pub fn new(azimuth_deg: f64, altitude_deg: f64) -> Self {
        let (sin_az, cos_az) = azimuth_deg.to_radians().sin_cos();
        let (sin_alt, cos_alt) = altitude_deg.to_radians().sin_cos();
        Self { enu: DVec3::new(cos_alt * sin_az, cos_alt * cos_az, sin_alt) }
    }

    /// Converts a vector in east, north, up, of any length; `None` for one that has no direction.
    pub fn of_enu(east_north_up: DVec3) -> Option<Self> {
        east_north_up.try_normalize().map(|enu| Self { enu })
    }

    /// Converts a vector in east, north, up that is known to be of unit length.
    pub(super) fn of_unit_enu(enu: DVec3) -> Self {
        Self { enu }
    }

    /// The unit vector in east, north, up.
    pub fn east_north_up(self) -> DVec3 {
        self.enu
    }

    /// Azimuth, degrees in [0, 360): north 0°, east 90°; 0 at the zenith itself.
    pub fn azimuth_deg(self) -> f64 {
        circle_deg(self.enu.x.atan2(self.enu.y))
    }

    /// True altitude, degrees.
    pub fn altitude_deg(self) -> f64 {
        self.enu.z.atan2(self.enu.x.hypot(self.enu.y)).to_degrees()
    }

    /// True zenith angle, degrees.
    pub fn zenith_deg(self) -> f64 {
        self.enu.x.hypot(self.enu.y).atan2(self.enu.z).to_degrees()
    }

    /// The angle to another direction at the same site, degrees.
    pub fn separation_deg(self, other: Self) -> f64 {
        separation_deg(self.enu, other.enu)
    }

    /// The hour angle, degrees in (−180, 180], positive in the west, for a site at that geodetic latitude: of the
    /// pole of the ITRS, as SOFA's `atioq` gives it.
    pub fn hour_angle_deg(self, latitude_deg: f64) -> f64 {
        let (sin_lat, cos_lat) = latitude_deg.to_radians().sin_cos();
        let towards_meridian = self.enu.z * cos_lat - self.enu.y * sin_lat;
        (-self.enu.x).atan2(towards_meridian).to_degrees()
    }
}
