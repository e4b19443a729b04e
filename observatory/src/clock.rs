//! Offset of the computer's clock from UTC, as far as the computer knows it, and its steps.

use std::path::Path;
use std::process::{Command, Stdio};
use sunglint_formats::session::ClockState;

/// A step of the clock that is worth a note, s: a clock that is steered drifts by 5e-4 of the time between two looks at most.
pub(crate) const STEP_S: f64 = 0.02;

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

/// Clock of a recording: nobody knows.
pub(crate) fn recorded() -> ClockState {
    ClockState { method: "recording".into(), synchronised: None, offset_s: None, error_s: None }
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
