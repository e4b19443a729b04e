//! How a conversation ended, in words: errors without the times that a real clock would change.
#![allow(dead_code, reason = "each test uses its part")]

use sunglint_drivers::device::{DeviceError, Power};
use sunglint_drivers::transport::TransportError;

pub fn words(error: &DeviceError) -> String {
    match error {
        DeviceError::Transport { source: TransportError::Timeout { got_so_far, .. }, .. } => {
            format!("no answer but {} bytes", got_so_far.len())
        }
        DeviceError::Transport {
            source: TransportError::Disconnected { got_so_far, .. }, ..
        } => {
            format!("gone after {} bytes", got_so_far.len())
        }
        DeviceError::TooSlow { action, .. } => format!("{action} took too long"),
        other => other.to_string(),
    }
}

pub fn power(power: &Power) -> String {
    match power {
        Power::Watts(watts) => format!("{watts:e} W"),
        Power::Over { range_w } => format!("more than {range_w:?} W"),
        other => format!("{other:?}"),
    }
}
