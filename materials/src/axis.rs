//! An axis that is sent to angles: from below, so that the play of its gears lies on one side, and looked at after it arrived.

use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{DeviceError, RotationStage};

/// Why an axis does not stand where it was sent.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AxisError {
    /// Somebody stopped it.
    #[error("stopped on the way to {asked_deg:.3}°")]
    Stopped {
        /// Where it was sent, deg.
        asked_deg: f64,
    },
    /// The stage's error.
    #[error("on the way to {asked_deg:.3}°: {error}{}", stands(*at_deg))]
    Stage {
        /// Where it was sent, deg.
        asked_deg: f64,
        /// Where it stands, deg, if it says so.
        at_deg: Option<f64>,
        /// Error that the stage reported.
        error: DeviceError,
    },
    /// The stage says that it arrived, but elsewhere.
    #[error(
        "the stage was sent to {asked_deg:.3}° and stands at {at_deg:.3}°: more than {tolerance_deg}° off (is the axis blocked, does the motor lose steps?)"
    )]
    Elsewhere {
        /// Where it was sent, deg.
        asked_deg: f64,
        /// Where it stands, deg.
        at_deg: f64,
        /// How far off it may be, deg.
        tolerance_deg: f64,
    },
}

fn stands(at_deg: Option<f64>) -> String {
    at_deg.map_or(String::new(), |at| format!("; it stands at {at:.3}°"))
}

/// How an axis is moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// On the way down it goes so much too far and comes back up, deg.
    pub approach_deg: f64,
    /// How far from the angle that was asked for it may stand, deg.
    pub tolerance_deg: f64,
}

/// Turns a stage that stands at `at_deg` (none where that is not known) to an angle, and gives where it stands then, deg. `deadline` is asked for one for each move.
///
/// # Errors
/// See [`AxisError`].
pub fn turn(
    stage: &mut dyn RotationStage,
    at_deg: Option<f64>,
    asked_deg: f64,
    approach: &Approach,
    deadline: &dyn Fn() -> Deadline,
) -> Result<f64, AxisError> {
    let travel = stage.travel_deg();
    let reaches = |deg: f64| travel.is_none_or(|travel| deg >= travel.low);
    let mut move_to = |asked_deg: f64| {
        stage.move_to(asked_deg, &deadline()).map_err(|failed| match *failed.error {
            DeviceError::Cancelled { .. } => AxisError::Stopped { asked_deg },
            error => AxisError::Stage { asked_deg, at_deg: failed.done, error },
        })
    };
    let below = asked_deg - approach.approach_deg;
    let is_down = at_deg.is_none_or(|at| at > asked_deg);
    if is_down && below < asked_deg && reaches(below) {
        move_to(below)?;
    }
    let at_deg = move_to(asked_deg)?;
    let tolerance_deg = approach.tolerance_deg;
    if (at_deg - asked_deg).abs() > tolerance_deg {
        return Err(AxisError::Elsewhere { asked_deg, at_deg, tolerance_deg });
    }
    Ok(at_deg)
}
