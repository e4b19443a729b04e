//! Settings of a device, changed and read back.

use super::{OpenDevice, SessionError};
use crate::catalogue::Address;
use crate::device::{Identity, Value};
use std::time::Duration;

/// How long a setting usually takes at most.
const SET: Duration = Duration::from_secs(60);

/// A setting that was changed.
#[derive(Debug, Clone, PartialEq)]
pub struct SetValue {
    /// The setting's name.
    pub name: String,
    /// The value that was asked for.
    pub asked: String,
    /// The value that the device then has.
    pub value: Value,
}

/// Settings that were changed, all that were asked for or those before a failure.
#[derive(Debug)]
pub struct SettingsDone {
    /// Where the device is.
    pub address: Address,
    /// Who it says it is.
    pub identity: Identity,
    /// The settings that were changed.
    pub done: Vec<SetValue>,
    /// The settings that the device takes: their names, and what they take, in words.
    pub settable: Vec<(&'static str, &'static str)>,
    /// Error that ended the changes early.
    pub error: Option<SessionError>,
}

impl OpenDevice {
    /// Changes settings, in this order, each with its name and value. A failure after the first one is in the result, with
    /// those before it.
    ///
    /// # Errors
    /// The first setting failed.
    pub fn set(&mut self, settings: &[(&str, &str)]) -> Result<SettingsDone, SessionError> {
        let Self { session, device, identity } = self;
        let (mut done, mut error) = (Vec::new(), None);
        for &(name, asked) in settings {
            match device.set(name, asked, &session.within(SET)) {
                Ok(value) => {
                    done.push(SetValue { name: name.to_owned(), asked: asked.to_owned(), value });
                }
                Err(failed) => {
                    error = Some(failed.into());
                    break;
                }
            }
        }
        let settable = device.settable();
        match error {
            Some(error) if done.is_empty() => Err(error),
            error => Ok(SettingsDone {
                address: session.address.clone(),
                identity: identity.clone(),
                done,
                settable,
                error,
            }),
        }
    }
}
