//! Where a stage stands that was sent somewhere: the motor on its steps, the sample behind it by the play.

use super::options::Options;

/// A stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stage {
    motor_deg: f64,
    sample_deg: f64,
}

impl Stage {
    /// A stage at 0, reached from below.
    pub fn new() -> Self {
        Self { motor_deg: 0.0, sample_deg: 0.0 }
    }

    /// Returns the angle on the motor's counter, degrees.
    pub fn motor_deg(&self) -> f64 {
        self.motor_deg
    }

    /// Where the sample stands, degrees: with the motor on the way up, above it by the play on the way down.
    pub fn sample_deg(&self) -> f64 {
        self.sample_deg
    }

    /// Turns towards an angle and gives the time that takes, s, and whether it got there.
    pub fn turn(&mut self, options: &Options, to_deg: f64) -> (f64, bool) {
        let stage = &options.stage;
        let step = (to_deg / stage.step_deg).round() * stage.step_deg;
        let reached = options.fault.stuck_beyond_deg.map_or(step, |stuck| step.min(stuck));
        let took_s = (reached - self.motor_deg).abs() / stage.speed_deg_per_s;
        self.stand(options, reached);
        (took_s, reached == step)
    }

    /// The motor stands there, or comes by on its way: the sample follows by the play.
    pub fn stand(&mut self, options: &Options, motor_deg: f64) {
        self.motor_deg = motor_deg;
        let behind = motor_deg + options.stage.backlash_deg;
        self.sample_deg = self.sample_deg.clamp(motor_deg, behind);
    }
}

impl Default for Stage {
    fn default() -> Self {
        Self::new()
    }
}
