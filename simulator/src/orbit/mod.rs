//! Where a target is: a TLE by SGP4, or a table of positions.

use glam::DVec3;

/// Position and velocity in the GCRS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// From the Earth's centre, m.
    pub position_m: DVec3,
    /// In the GCRS, m/s.
    pub velocity_m_s: DVec3,
}
