//! Bodies that point: orbit-following ones and those that face the Sun.

use super::{AttitudeError, Moment};
use glam::{DMat3, DQuat, DVec3};

/// Directions nearer to parallel than this angle (radians) define no attitude.
const PARALLEL: f64 = 1e-9;

/// The orbit's axes at a moment, as a rotation to the GCRS: z to the Earth's centre, y against the orbit's normal (r × v), x completing
/// them: along the velocity, but horizontal. Position and velocity are the GCRS's.
///
/// # Errors
/// A position or velocity without a plane: zero, or parallel.
pub fn orbit_to_gcrs(moment: &Moment) -> Result<DQuat, AttitudeError> {
    let nadir = -moment.target.position_m;
    frame(nadir, moment.target.velocity_m_s, "the target's position and velocity").map(
        |(nadir, ahead, right)| {
            // `right` is nadir × ahead: y.
            DQuat::from_mat3(&DMat3::from_cols(ahead, right, nadir)).normalize()
        },
    )
}

/// Direction that a body's axis can point in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// The Sun.
    Sun,
    /// The Earth's centre.
    Nadir,
    /// The velocity in the GCRS.
    Velocity,
    /// The normal of the orbit, r × v.
    OrbitNormal,
    /// The celestial pole: +z of the GCRS.
    North,
}

impl Direction {
    /// A vector (of any length) in that direction, GCRS axes.
    fn of(self, moment: &Moment) -> DVec3 {
        let (r, v) = (moment.target.position_m, moment.target.velocity_m_s);
        match self {
            Direction::Sun => moment.to_sun,
            Direction::Nadir => -r,
            Direction::Velocity => v,
            Direction::OrbitNormal => r.cross(v),
            Direction::North => DVec3::Z,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Direction::Sun => "the Sun",
            Direction::Nadir => "nadir",
            Direction::Velocity => "the velocity",
            Direction::OrbitNormal => "the orbit's normal",
            Direction::North => "the celestial pole",
        }
    }
}

/// One axis of the body points exactly at something, a second as nearly as it can at something else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pointing {
    first: Direction,
    second: Direction,
    /// Body axes → the frame of the two axes: x along the first, z across both.
    body_to_frame: DQuat,
}

impl Pointing {
    /// The body's axis `first_axis` points exactly at `first`, and its `second_axis` as nearly as that allows at `second`.
    ///
    /// # Errors
    /// Axes that are zero, not finite or parallel, or the same direction twice.
    pub fn new(
        first_axis: DVec3,
        first: Direction,
        second_axis: DVec3,
        second: Direction,
    ) -> Result<Self, AttitudeError> {
        if first == second {
            return Err(AttitudeError::SameDirection { what: first.name() });
        }
        let (x, y, z) = frame(first_axis, second_axis, "the two axes of the body")?;
        let frame_to_body = DQuat::from_mat3(&DMat3::from_cols(x, y, z)).normalize();
        Ok(Self { first, second, body_to_frame: frame_to_body.inverse() })
    }

    /// The same for a body that is turned by a constant bias against the attitude that it should have: `bias` takes its axes to those of the body that points exactly.
    #[must_use]
    pub fn with_bias(self, bias: DQuat) -> Self {
        Self { body_to_frame: (self.body_to_frame * bias).normalize(), ..self }
    }

    /// The rotation from body axes to the GCRS.
    ///
    /// # Errors
    /// The two directions are (anti)parallel at this moment, so that the second says nothing.
    pub fn body_to_gcrs(&self, moment: &Moment) -> Result<DQuat, AttitudeError> {
        let (first, second) = (self.first.of(moment), self.second.of(moment));
        let what = match (self.first, self.second) {
            (Direction::Sun, Direction::Nadir) | (Direction::Nadir, Direction::Sun) => {
                "the Sun and nadir (the Sun stands at the target's zenith or nadir)"
            }
            _ => "the two directions that the body points at",
        };
        let (x, y, z) = frame(first, second, what)?;
        let frame_to_gcrs = DQuat::from_mat3(&DMat3::from_cols(x, y, z)).normalize();
        Ok((frame_to_gcrs * self.body_to_frame).normalize())
    }
}

/// Right-handed unit vectors: the first direction, the second made perpendicular to it, and their cross product.
fn frame(
    first: DVec3,
    second: DVec3,
    what: &'static str,
) -> Result<(DVec3, DVec3, DVec3), AttitudeError> {
    let parallel = || AttitudeError::Undefined { what };
    let (first, second) =
        (first.try_normalize().ok_or_else(parallel)?, second.try_normalize().ok_or_else(parallel)?);
    let across = first.cross(second);
    if across.length() < PARALLEL {
        return Err(parallel());
    }
    let across = across.normalize();
    Ok((first, across.cross(first).normalize(), across))
}
