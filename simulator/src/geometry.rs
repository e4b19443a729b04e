//! Where target, Sun and station stand at one moment.

use crate::orbit::State;
use glam::DVec3;
use hifitime::Epoch;
use sunglint_radiometry::sky::{Horizontal, SunPlace};

/// Target, Sun and station at the moment at which the station records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// When the light arrives at the station.
    pub epoch: Epoch,
    /// When it left the target: light time earlier.
    pub emitted: Epoch,
    /// The target when the light left it.
    pub target: State,
    /// Unit vector from the target to the station, GCRS axes: the straight line that the light took. For reflection.
    pub to_observer: DVec3,
    /// Length of that line, m.
    pub range_m: f64,
    /// Where the station sees the target, true (unrefracted) with aberration: for pointing and for the way through the air.
    pub horizontal: Horizontal,
    /// The Sun as the target sees it: apparent direction, distance.
    pub sun: SunPlace,
    /// The part of the Sun's disc that the Earth leaves visible at the target, 0 (umbra) to 1 (sunlit), weighted by nothing but area.
    pub sunlit: f64,
    /// Angle Sun–target–station, radians, 0 to π.
    pub phase_rad: f64,
}
