//! Places that move with hinges: those of facets and of occluders.

use glam::{DQuat, DVec3};

/// Places of facets and occluders in the body's axes, at some angles of the hinges.
#[derive(Debug, Clone, Default)]
pub struct Geometry {
    /// Unit normal of each facet.
    pub normal: Vec<DVec3>,
    /// A point of each facet, the origin of its plane's coordinates, m.
    pub origin: Vec<DVec3>,
    /// First axis in each facet's plane: the tangent.
    pub tangent: Vec<DVec3>,
    /// Second axis.
    pub bitangent: Vec<DVec3>,
    /// Corners of the occluders, m.
    pub corners: Vec<DVec3>,
    /// Normal of each occluder that is a facet.
    pub facing: Vec<DVec3>,
    /// Middle of each occluder's ball, m.
    pub middle: Vec<DVec3>,
    /// Where each curved part's own axes are.
    pub place: Vec<Motion>,
}

/// A rotation followed by a translation.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// The rotation.
    pub rotation: DQuat,
    /// The translation, m.
    pub offset_m: DVec3,
}

impl Motion {
    /// About an axis through a point.
    pub fn about(point_m: DVec3, axis: DVec3, angle_rad: f64) -> Self {
        let rotation = DQuat::from_axis_angle(axis, angle_rad);
        Self { rotation, offset_m: point_m - rotation * point_m }
    }

    /// A point moved.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.rotation * p + self.offset_m
    }

    /// A direction turned.
    pub fn vector(&self, v: DVec3) -> DVec3 {
        self.rotation * v
    }
}
