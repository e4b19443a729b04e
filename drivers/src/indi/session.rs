//! One device on one connection: found, connected, its definitions there.

use super::client::{Client, Wanted};
use super::property::Vector;
use super::xml::Limits;
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// How to speak to a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SessionSettings {
    /// How long a server may take to define a device that it has, and to answer what takes no time.
    pub answer_within: Duration,
    /// Silence after which all definitions are there: the protocol has no end of them.
    pub quiet: Duration,
    /// How much of what the server may send.
    pub limits: Limits,
}

impl Default for SessionSettings {
    fn default() -> Self {
        Self {
            answer_within: Duration::from_secs(5),
            quiet: Duration::from_millis(300),
            limits: Limits::default(),
        }
    }
}

/// Requirements on a kind of device: what it must be and have.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kind {
    /// The device in errors.
    pub label: &'static str,
    /// Description of the kind, in words.
    pub what: &'static str,
    /// Bit of the kind in `DRIVER_INTERFACE`.
    pub interface: u32,
    /// The vectors without which it is none.
    pub required: &'static [&'static str],
}

/// A device on a connection.
#[derive(Debug)]
pub(super) struct Session<T> {
    pub client: Client<T>,
    pub device: String,
    pub kind: Kind,
    pub settings: SessionSettings,
}

impl<T: Bytes> Session<T> {
    pub fn new(line: T, device: &str, kind: Kind, settings: SessionSettings) -> Self {
        let client = Client::new(line, kind.label, settings.limits);
        Self { client, device: device.to_owned(), kind, settings }
    }

    /// Finds the device, connects it, and waits until it is defined.
    pub fn define(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let device = self.device.clone();
        self.client.get_properties(Some((&device, None)), deadline)?;
        // Where there is little time, half of it is left for asking what there is instead.
        let half = deadline.remaining().map_or(Duration::ZERO, |left| left / 2);
        let soon = deadline.at_most(self.settings.answer_within.min(half));
        match self.client.await_defined(&device, "CONNECTION", &soon) {
            Err(DeviceError::Awaited { .. }) if deadline.remaining().is_ok() => {
                return Err(self.no_such_device());
            }
            other => other?,
        }
        let soon = deadline.at_most(self.settings.quiet);
        match self.client.await_defined(&device, "DRIVER_INFO", &soon) {
            // Not every driver tells.
            Ok(()) | Err(DeviceError::Awaited { .. }) => self.check_interface()?,
            Err(error) => return Err(error),
        }
        let connection = self.client.require(&device, "CONNECTION")?;
        if connection.is_on("CONNECT") != Some(true) {
            let on = Wanted::Switches(&[("CONNECT", true)]);
            let connection = self.client.change(&device, "CONNECTION", on, deadline)?;
            if connection.is_on("CONNECT") != Some(true) {
                let said = self.client.messages().last().unwrap_or("it gave no reason").to_owned();
                let request = "to connect to the device behind it".to_owned();
                let device = self.kind.label;
                return Err(DeviceError::Declined { device, request, message: said });
            }
        }
        for name in self.kind.required {
            self.client.await_defined(&device, name, deadline)?;
        }
        self.client.settle(self.settings.quiet, deadline)
    }

    /// A server says nothing about a device that it has not, and, once asked for one, nothing about the others.
    fn no_such_device(&self) -> DeviceError {
        let known = "the server's devices (it does not know this one, or its driver has not started): list them with `sunglint devices list --indi HOST`";
        let (name, asked) = (DeviceError::INDI_DEVICE, self.device.clone());
        DeviceError::Unknown { name, asked, known: known.to_owned() }
    }

    fn check_interface(&self) -> Result<(), DeviceError> {
        let info = self.client.property(&self.device, "DRIVER_INFO");
        let text = info.and_then(|info| info.text("DRIVER_INTERFACE"));
        match text.and_then(|text| text.parse::<u32>().ok()) {
            Some(bits) if bits & self.kind.interface == 0 => {
                let (name, what) = (self.device.clone(), self.kind.what);
                Err(DeviceError::WrongKind { device: self.kind.label, name, what, bits })
            }
            _ => Ok(()),
        }
    }

    /// Begins anew on the same line, after the device was lost.
    pub fn redefine(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.client.forget(deadline)?;
        self.define(deadline)
    }

    pub fn property(&self, name: &str) -> Option<&Vector> {
        self.client.property(&self.device, name)
    }

    pub fn require(&self, name: &str) -> Result<&Vector, DeviceError> {
        self.client.require(&self.device, name)
    }

    /// A number that must be there.
    pub fn number(&self, name: &str, member: &str) -> Result<f64, DeviceError> {
        self.require(name)?.number(member).ok_or_else(|| {
            self.protocol(format!("{name} has no number {member}, or the driver does not know it"))
        })
    }

    pub fn protocol(&self, reason: String) -> DeviceError {
        DeviceError::Protocol { device: self.kind.label, reason }
    }

    /// Sets a vector and waits until it is done.
    pub fn change(
        &mut self,
        name: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> Result<Vector, DeviceError> {
        self.client.change(&self.device, name, wanted, deadline)
    }

    /// Turns a switch on, if there is one and it is not.
    pub fn turn_on(
        &mut self,
        name: &str,
        members: [&str; 2],
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let [on, off] = members;
        let Some(vector) = self.property(name) else { return Ok(()) };
        if vector.is_on(on) != Some(false) {
            return Ok(());
        }
        let both = [(on, true), (off, false)];
        let wanted =
            Wanted::Switches(if vector.member(off).is_some() { &both } else { &both[..1] });
        let soon = deadline.at_most(self.settings.answer_within);
        let after = self.change(name, wanted, &soon)?;
        if after.is_on(on) == Some(true) {
            return Ok(());
        }
        Err(self.protocol(format!("{name} was set to {on} and is something else all the same")))
    }

    pub fn identity(&self) -> Result<Identity, DeviceError> {
        self.require("CONNECTION")?;
        let info = self.property("DRIVER_INFO");
        let text = |member| {
            info.and_then(|info| info.text(member)).filter(|t| !t.is_empty()).map(str::to_owned)
        };
        Ok(Identity {
            vendor: format!(
                "INDI, {}",
                text("DRIVER_EXEC").unwrap_or_else(|| "unknown driver".into())
            ),
            model: text("DRIVER_NAME").unwrap_or_else(|| self.device.clone()),
            serial: None,
            firmware: text("DRIVER_VERSION").map(|version| format!("driver {version}")),
            driver: "indi",
        })
    }
}

/// A value within what the driver says, if it says something.
pub(super) fn check_range(
    name: &'static str,
    asked: f64,
    range: Option<Interval>,
) -> Result<(), DeviceError> {
    let Interval { low: least, high: most } = range.unwrap_or(Interval::new(f64::MIN, f64::MAX));
    if (least..=most).contains(&asked) {
        return Ok(());
    }
    Err(DeviceError::OutOfRange { name, asked, least, most })
}

/// A device that a server has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// Name of the device, by which it is opened.
    pub name: String,
    /// The program that drives it, where it says so.
    pub driver: Option<String>,
    /// Whether it says that it is a camera, a filter wheel, a rotator, a telescope, a focuser.
    pub is: [bool; 5],
}

/// The devices of the server at the other end of `line`, by name. Nothing is connected or set.
///
/// # Errors
/// See [`DeviceError`].
pub fn devices<T: Bytes>(
    line: T,
    settings: SessionSettings,
    deadline: &Deadline,
) -> Result<Vec<Listed>, DeviceError> {
    let mut client = Client::new(line, "INDI server", settings.limits);
    client.get_properties(None, deadline)?;
    // A call that has little time ends with what came in half of it.
    let half = deadline.remaining().map_or(Duration::ZERO, |left| left / 2);
    client.settle(settings.quiet.max(Duration::from_secs(1)).min(half), deadline)?;
    let mut names: Vec<String> =
        client.properties().places().map(|place| place.device.clone()).collect();
    names.dedup();
    let listed = names.into_iter().map(|name| {
        let info = client.property(&name, "DRIVER_INFO");
        let text = |member| info.and_then(|info| info.text(member));
        let bits = text("DRIVER_INTERFACE").and_then(|bits| bits.parse().ok()).unwrap_or(0_u32);
        let is = [1, 4, 12, 0, 3].map(|bit| bits >> bit & 1 == 1);
        Listed { driver: text("DRIVER_EXEC").map(str::to_owned), is, name }
    });
    Ok(listed.collect())
}
