//! How a stage's counter and its angle belong together.

use super::{DeviceError, Origin, Setting, Value};
use sunglint_numerics::measured::Interval;

/// Counts and angles of a rotation stage. An angle is rounded once, to the counter, and never added up.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    /// Counts of a degree, above 0.
    pub counts_per_deg: f64,
    /// Whether angles grow while the counter falls.
    pub inverted: bool,
    /// The angle at which the counter is 0, deg.
    pub zero_deg: f64,
    /// Angles between which it may stand, deg; `None` if it turns freely.
    pub travel_deg: Option<Interval>,
}

impl Scale {
    fn signed(&self) -> f64 {
        if self.inverted { -self.counts_per_deg } else { self.counts_per_deg }
    }

    /// The counter's value for an angle; [`DeviceError::OutOfRange`] beyond the travel or the counter's 32 bits.
    pub fn counter(&self, angle_deg: f64) -> Result<i32, DeviceError> {
        let reach = f64::from(i32::MAX) / self.counts_per_deg;
        let free = Interval::new(self.zero_deg - reach, self.zero_deg + reach);
        let [least, most] = self.travel_deg.unwrap_or(free).to_array();
        let counts = ((angle_deg - self.zero_deg) * self.signed()).round();
        let fits = (f64::from(-i32::MAX)..=f64::from(i32::MAX)).contains(&counts);
        if fits && angle_deg >= least && angle_deg <= most {
            // A whole number within 32 bits.
            Ok(counts as i32)
        } else {
            Err(DeviceError::OutOfRange { name: "angle_deg", asked: angle_deg, least, most })
        }
    }

    /// The angle of a counter's value, deg.
    pub fn angle(&self, counter: i32) -> f64 {
        // `+ 0.0`: no negative zero.
        f64::from(counter) / self.signed() + self.zero_deg + 0.0
    }

    /// Returns the configured settings of the scale, except the counts of a degree: devices have them from elsewhere.
    pub fn settings(&self) -> Vec<Setting> {
        let configured = |name, value| Setting { name, value, origin: Origin::Configured };
        let mut settings = vec![
            configured("inverted", Value::Flag(self.inverted)),
            configured("zero_deg", Value::Number(self.zero_deg)),
        ];
        if let Some(Interval { low: least, high: most }) = self.travel_deg {
            settings.push(configured("travel_from_deg", Value::Number(least)));
            settings.push(configured("travel_to_deg", Value::Number(most)));
        }
        settings
    }
}
