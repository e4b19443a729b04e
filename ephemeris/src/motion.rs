//! Motion of a target on the sky of a site: its direction and the rate of that, and both in the axes of a mount.
//!
//! The rates are derivatives of the place, not differences: with the relative position `r` and velocity `v` in the site's turning axes,
//! `A' = (e' n − e n') / (e² + n²)` and `a' = (u' − |r|' sin a) / (|r| cos a)` for azimuth and altitude, and the same in the axes of the equator
//! for hour angle and declination.

use crate::geometry::{Geometry, GeometryError};
use crate::orbit::Orbit;
use glam::DVec3;
use hifitime::Epoch;
use sunglint_numerics::axes::Axes;
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::sky::Observer;

/// Direction of a target and its rate, in the turning axes east, north, up of a site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Time at which the light arrives.
    pub epoch: Epoch,
    /// Unit vector to the target, true (unrefracted), aberration included: as in [`Geometry::horizontal`].
    pub enu: DVec3,
    /// Rate of that vector, 1/s.
    pub enu_per_s: DVec3,
    /// Distance, m.
    pub range_m: f64,
}

impl Motion {
    /// Returns the motion that an observer sees at its epoch.
    ///
    /// What is left out: the aberration's change by the target's own acceleration, below 1e-9 rad/s.
    ///
    /// # Errors
    /// The errors of [`Geometry::at`].
    pub fn at(orbit: &Orbit, observer: &Observer) -> Result<Self, GeometryError> {
        let geometry = Geometry::at(orbit, observer)?;
        let frame = observer.frame();
        let to_target = -geometry.to_observer;
        let range_m = geometry.range_m;
        let observer_m_s = observer.velocity_gcrs_m_s();
        // The light that arrives a second later left the target by a second less the growth of the light time later.
        let seen_m_s = geometry.target.velocity_m_s - observer_m_s;
        let part = 1.0 - seen_m_s.dot(to_target) / LIGHT_M_PER_S;
        let line_m_s = geometry.target.velocity_m_s * part - observer_m_s;
        // As the turning axes see it; the aberration of the site's own motion (1.5e-6) stands still in them.
        let turning = line_m_s - frame.earth_rotation_gcrs_rad_s().cross(to_target * range_m);
        let across = (turning - to_target * turning.dot(to_target)) / range_m;
        let enu = geometry.horizontal.east_north_up();
        let seen = to_target + observer_m_s / LIGHT_M_PER_S;
        let (direction, length) = (seen.normalize(), seen.length());
        let across = (across - direction * across.dot(direction)) / length;
        let enu_per_s = observer.gcrs_to_enu() * across;
        Ok(Self { epoch: geometry.epoch, enu, enu_per_s, range_m })
    }

    /// Azimuth and altitude with their rates.
    pub fn horizontal(&self) -> AxisMotion {
        AxisMotion::of(self.enu, self.enu_per_s)
    }

    /// Hour angle and declination with their rates, at a geodetic latitude.
    pub fn equatorial(&self, latitude_deg: f64) -> AxisMotion {
        let turned = |enu| equatorial_axes(enu, latitude_deg);
        AxisMotion::of(turned(self.enu), turned(self.enu_per_s))
    }
}

/// A vector in east, north, up, in axes (west, meridian, pole): what hour angle and declination are to these, azimuth and altitude are to east, north, up.
pub fn equatorial_axes(enu: DVec3, latitude_deg: f64) -> DVec3 {
    let (sin, cos) = latitude_deg.to_radians().sin_cos();
    DVec3::new(-enu.x, enu.z * cos - enu.y * sin, enu.z * sin + enu.y * cos)
}

/// The way back from [`equatorial_axes`].
pub fn horizontal_axes(axes: DVec3, latitude_deg: f64) -> DVec3 {
    let (sin, cos) = latitude_deg.to_radians().sin_cos();
    DVec3::new(-axes.x, axes.z * cos - axes.y * sin, axes.z * sin + axes.y * cos)
}

/// Angles of a mount's two axes with their rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisMotion {
    /// First angle (azimuth from north to east, or hour angle to the west), −180 to 180, and second (altitude, declination), deg.
    pub angle_deg: Axes,
    /// Rates, deg/s. The first grows without bound towards the pole of the axes.
    pub deg_s: Axes,
}

impl AxisMotion {
    /// Angles of a direction in axes (x: first angle 90°, y: first angle 0°, z: pole) that changes at a rate.
    pub fn of(axes: DVec3, per_s: DVec3) -> Self {
        let flat2 = axes.x * axes.x + axes.y * axes.y;
        let (flat, length) = (flat2.sqrt(), axes.length());
        let outward = axes.dot(per_s) / length;
        let first = (per_s.x * axes.y - axes.x * per_s.y) / flat2;
        let second = (per_s.z - outward * axes.z / length) / flat;
        Self {
            angle_deg: Axes::new(
                axes.x.atan2(axes.y).to_degrees(),
                axes.z.atan2(flat).to_degrees(),
            ),
            deg_s: Axes::new(first.to_degrees(), second.to_degrees()),
        }
    }
}
