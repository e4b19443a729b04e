//! Focusers.

use super::{Device, DeviceError, Interrupted};
use crate::clock::Deadline;

/// A focuser with absolute positions, in steps of its motor.
pub trait Focuser: Device {
    /// Lowest and highest position, steps.
    fn range(&self) -> [i64; 2];

    /// Where it stands, steps.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn position(&mut self, deadline: &Deadline) -> Result<i64, DeviceError>;

    /// Moves to `position`, steps, and gives the position at which it then stands.
    ///
    /// # Errors
    /// Where it stands (steps, if it can still be asked), with the error. The motor was stopped if it could be reached.
    fn move_to(
        &mut self,
        position: i64,
        deadline: &Deadline,
    ) -> Result<i64, Interrupted<Option<i64>>>;

    /// Temperature at the focuser, °C; `None` where it measures none.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn temperature_c(&mut self, deadline: &Deadline) -> Result<Option<f64>, DeviceError>;

    /// Stops the motor at once.
    ///
    /// # Errors
    /// See [`DeviceError`]; the motor may still be turning.
    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;
}

/// A position within the range of a focuser.
pub(crate) fn check_steps(position: i64, [least, most]: [i64; 2]) -> Result<(), DeviceError> {
    if (least..=most).contains(&position) {
        return Ok(());
    }
    // Steps are far below 2^53.
    let [asked, least, most] = [position, least, most].map(|n| n as f64);
    Err(DeviceError::OutOfRange { name: "position, steps", asked, least, most })
}
