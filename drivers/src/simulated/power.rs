//! Powers that simulated power meters measure.

use std::time::Duration;

/// Light on a head: a power at a time. Any `FnMut(Duration) -> f64` is one.
pub trait PowerSource: Send {
    /// The power at `at` on the clock of the calls, W.
    fn power_w(&mut self, at: Duration) -> f64;
}

impl<F: FnMut(Duration) -> f64 + Send> PowerSource for F {
    fn power_w(&mut self, at: Duration) -> f64 {
        self(at)
    }
}

/// Light that does not change, W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steady(pub f64);

impl PowerSource for Steady {
    fn power_w(&mut self, _: Duration) -> f64 {
        self.0
    }
}

/// The mean over the `window` before `now`, from ten samples; at the clock's start from what there was.
pub(super) fn mean_w(source: &mut dyn PowerSource, now: Duration, window: Duration) -> f64 {
    const SAMPLES: u32 = 10;
    if window.is_zero() {
        return source.power_w(now);
    }
    let times = (0..SAMPLES).rev().map(|i| now.saturating_sub(window * i / SAMPLES));
    times.map(|at| source.power_w(at)).sum::<f64>() / f64::from(SAMPLES)
}
