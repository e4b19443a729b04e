//! Offset of the computer's clock from UTC, as far as the computer knows it, and its steps.

use hifitime::Epoch;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use sunglint_formats::session::ClockState;

/// A step of the clock that is worth a note, s: a clock that is steered drifts by 5e-4 of the time between two looks at most.
const STEP_S: f64 = 0.02;

/// Returns the state of the computer's clock as chrony tells it, else systemd-timesyncd; the method is `none` where neither runs.
pub fn measured() -> ClockState {
    chrony().or_else(timesyncd).unwrap_or_else(|| ClockState {
        method: "none".into(),
        synchronised: None,
        offset_s: None,
        error_s: None,
    })
}

/// Clock of a virtual night: exactly UTC.
pub fn exact() -> ClockState {
    ClockState {
        method: "virtual".into(),
        synchronised: Some(true),
        offset_s: Some(0.0),
        error_s: Some(0.0),
    }
}

/// `chronyc -c tracking`: a line of comma-separated values, the fifth the system clock's error, then root delay and dispersion.
fn chrony() -> Option<ClockState> {
    let output = Command::new("chronyc")
        .args(["-c", "tracking"])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    tracking(std::str::from_utf8(&output.stdout).ok()?.trim())
}

/// Fields as chrony 4's documentation has them: reference, name, stratum, reference time, system time (s, above zero where
/// the clock is ahead), last offset, RMS offset, frequency, residual frequency, skew, root delay (s), root dispersion (s),
/// update interval, leap status.
fn tracking(line: &str) -> Option<ClockState> {
    let fields: Vec<&str> = line.split(',').collect();
    let [.., leap] = fields.as_slice() else { return None };
    let number = |i: usize| fields.get(i)?.parse::<f64>().ok().filter(|n| n.is_finite());
    let (offset, delay, dispersion) = (number(4)?, number(10)?, number(11)?);
    let synchronised = *leap != "Not synchronised";
    Some(ClockState {
        method: "chrony".into(),
        synchronised: Some(synchronised),
        offset_s: synchronised.then_some(offset),
        // The bound that chrony's documentation gives for the clock's accuracy.
        error_s: synchronised.then_some(offset.abs() + dispersion + 0.5 * delay),
    })
}

/// systemd's note that it has set the clock; it tells no offset to others.
fn timesyncd() -> Option<ClockState> {
    let running = Path::new("/run/systemd/timesync");
    let state = |synchronised| ClockState {
        method: "systemd-timesyncd".into(),
        synchronised: Some(synchronised),
        offset_s: None,
        error_s: None,
    };
    running.is_dir().then(|| state(running.join("synchronized").exists()))
}

/// Watch for steps of UTC against a monotonic clock.
#[derive(Debug, Clone, Copy)]
pub struct StepWatch {
    last: (Epoch, Duration),
}

impl StepWatch {
    /// From now on.
    pub fn new(utc: Epoch, monotonic: Duration) -> Self {
        Self { last: (utc, monotonic) }
    }

    /// Returns the step of UTC since the last call, s; nothing where there is none.
    pub fn step_s(&mut self, utc: Epoch, monotonic: Duration) -> Option<f64> {
        let (then, before) = std::mem::replace(&mut self.last, (utc, monotonic));
        let step_s = (utc - then).to_seconds() - monotonic.saturating_sub(before).as_secs_f64();
        (step_s.abs() > STEP_S).then_some(step_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::time::parse_utc;

    /// Truth: chrony 4.3's answer in its documentation's order of fields, with the accuracy that it defines: |system time| + root
    /// dispersion + root delay / 2.
    #[test]
    fn chrony_is_read() {
        let line = "A29FC87B,162.159.200.123,4,1731952345.123456789,-0.000012345,0.000010000,\
                    0.000020000,1.234,-0.001,0.050,0.010000000,0.002000000,64.2,Normal";
        let state = tracking(line).unwrap();
        assert_eq!((state.synchronised, state.offset_s), (Some(true), Some(-1.2345e-5)));
        assert!((state.error_s.unwrap() - 0.007_012_345).abs() < 1e-12);
        let lost = tracking(&line.replace("Normal", "Not synchronised")).unwrap();
        assert_eq!((lost.synchronised, lost.offset_s), (Some(false), None));
        assert_eq!(tracking("506 Cannot talk to daemon"), None);
    }

    /// Truth: steps that the test makes; a drift of 500 ppm, the kernel's largest slew, is none.
    #[test]
    fn a_step_is_told_from_a_drift() {
        let start = parse_utc("2020-11-18T17:00:00Z").unwrap();
        let at = |s: f64| start + hifitime::Duration::from_seconds(s);
        let mut watch = StepWatch::new(at(0.0), Duration::ZERO);
        assert_eq!(watch.step_s(at(10.005), Duration::from_secs(10)), None);
        let step = watch.step_s(at(14.505), Duration::from_secs(11)).unwrap();
        assert!((step - 3.5).abs() < 1e-6, "{step}");
        let step = watch.step_s(at(12.505), Duration::from_secs(12)).unwrap();
        assert!((step + 3.0).abs() < 1e-6, "{step}");
        assert_eq!(watch.step_s(at(13.505), Duration::from_secs(13)), None);
    }
}
