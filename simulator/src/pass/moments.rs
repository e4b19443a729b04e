//! Where everything stands, for whoever needs no light.

use super::{Pass, PassError, Place};

impl Pass {
    /// Where everything stands at the pass's times, before any air: nothing is said of the apparent zenith angle, and everything is `hidden`.
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`], for places.
    pub fn moments(&self) -> Result<Vec<Place>, PassError> {
        self.check()?;
        self.places(&|| ())
    }
}
