//! Source of a night's devices: the catalogue of drivers, or anything else that stands in for them.

use super::films::Films;
use super::mount::MountPlan;
use super::plan::{CameraPlan, CounterPlan, FocuserPlan, NightClock, Plan, RotatorPlan, WheelPlan};
use std::fmt;
use std::sync::Arc;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Deadline, DeviceClock};
use sunglint_drivers::device::{
    Camera, DeviceError, FilterWheel, Focuser, Mount, PhotonCounter, RotationStage,
};

/// Makes the devices of a night. A device that fails is asked for again, so that each call opens it anew.
///
/// The [`Catalogue`] opens real devices and the simulated ones behind their protocols; [`Playback`](super::Playback) plays a session.
pub trait Opener: Send + Sync + fmt::Debug {
    /// The clock of a device's own thread. No two devices may sleep on one virtual clock: each would add to the other's time.
    fn clock(&self, device: &str) -> DeviceClock;

    /// Opens a camera.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn camera(
        &self,
        plan: &CameraPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn Camera>, DeviceError>;

    /// Opens a counter. Its channels are called as in the plan, or `c1`, `c2` … by their inputs.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn counter(
        &self,
        plan: &CounterPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError>;

    /// Opens a filter wheel.
    ///
    /// # Errors
    /// See [`DeviceError`]; of an opener without wheels always.
    fn wheel(
        &self,
        plan: &WheelPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn FilterWheel>, DeviceError> {
        let _ = deadline;
        Err(another_kind(&plan.device, "device of this night, which has no wheels"))
    }

    /// Opens a rotator.
    ///
    /// # Errors
    /// See [`DeviceError`]; of an opener without rotators always.
    fn rotator(
        &self,
        plan: &RotatorPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn RotationStage>, DeviceError> {
        let _ = deadline;
        Err(another_kind(&plan.device, "device of this night, which has no rotators"))
    }

    /// Opens a focuser.
    ///
    /// # Errors
    /// See [`DeviceError`]; of an opener without focusers always.
    fn focuser(
        &self,
        plan: &FocuserPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn Focuser>, DeviceError> {
        let _ = deadline;
        Err(another_kind(&plan.device, "device of this night, which has no focusers"))
    }

    /// Opens the mount.
    ///
    /// # Errors
    /// See [`DeviceError`]; of an opener without a mount always.
    fn mount(&self, plan: &MountPlan, deadline: &Deadline) -> Result<Box<dyn Mount>, DeviceError> {
        let _ = deadline;
        Err(another_kind(&plan.device, "device of this night, which has no mount"))
    }

    /// Whether its mount moves a telescope that could be harmed. A virtual one needs no watchdog, and no clock that is right.
    fn moves_for_real(&self) -> bool {
        true
    }

    /// Whether a counter can hand over its time tags; asked before the night begins.
    fn streams_tags(&self, plan: &CounterPlan) -> bool {
        let _ = plan;
        false
    }

    /// Whether frames carry the numbers that they had ([`FRAME_NUMBER`](sunglint_formats::session::FRAME_NUMBER)).
    fn keeps_numbers(&self) -> bool {
        false
    }
}

/// The catalogue of drivers.
#[derive(Debug, Clone, Copy, Default)]
pub struct Catalogue;

impl Catalogue {
    /// The opener for a plan's devices: [`Films`] where its cameras are recordings.
    pub fn of(plan: &Plan) -> Arc<dyn Opener> {
        match plan.clock {
            NightClock::Recording => Arc::new(Films::new(plan)),
            NightClock::Computer | NightClock::Virtual => Arc::new(Self),
        }
    }

    fn open(
        address: &str,
        options: &[String],
        deadline: &Deadline,
    ) -> Result<AnyDevice, DeviceError> {
        let mut address = Address::parse(address, options).map_err(|error| {
            DeviceError::Unknown { name: "device", asked: error.found, known: error.expected }
        })?;
        let line = address.connect(deadline)?;
        address.open(line, deadline)
    }
}

fn another_kind(address: &str, wanted: &str) -> DeviceError {
    let (asked, known) = (address.to_owned(), format!("a {wanted}"));
    DeviceError::Unknown { name: "device", asked, known }
}

impl Opener for Catalogue {
    fn clock(&self, _: &str) -> DeviceClock {
        DeviceClock::live()
    }

    fn camera(
        &self,
        plan: &CameraPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn Camera>, DeviceError> {
        match Self::open(&plan.device, &plan.with, deadline)? {
            AnyDevice::Camera(camera) => Ok(camera),
            _ => Err(another_kind(&plan.device, "camera")),
        }
    }

    fn counter(
        &self,
        plan: &CounterPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        let mut options = plan.with.clone();
        let most = plan.channels.values().max();
        if let Some(most) = most.filter(|_| !options.iter().any(|o| o.starts_with("channels="))) {
            options.push(format!("channels={most}"));
        }
        match Self::open(&plan.device, &options, deadline)? {
            AnyDevice::PhotonCounter(counter) => Ok(counter),
            _ => Err(another_kind(&plan.device, "photon counter")),
        }
    }

    fn wheel(
        &self,
        plan: &WheelPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn FilterWheel>, DeviceError> {
        match Self::open(&plan.device, &plan.with, deadline)? {
            AnyDevice::FilterWheel(wheel) => Ok(wheel),
            _ => Err(another_kind(&plan.device, "filter wheel")),
        }
    }

    fn rotator(
        &self,
        plan: &RotatorPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn RotationStage>, DeviceError> {
        match Self::open(&plan.device, &plan.with, deadline)? {
            AnyDevice::RotationStage(stage) => Ok(stage),
            _ => Err(another_kind(&plan.device, "rotator")),
        }
    }

    fn focuser(
        &self,
        plan: &FocuserPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn Focuser>, DeviceError> {
        match Self::open(&plan.device, &plan.with, deadline)? {
            AnyDevice::Focuser(focuser) => Ok(focuser),
            _ => Err(another_kind(&plan.device, "focuser")),
        }
    }

    fn mount(&self, plan: &MountPlan, deadline: &Deadline) -> Result<Box<dyn Mount>, DeviceError> {
        match Self::open(&plan.device, &plan.with, deadline)? {
            AnyDevice::Mount(mount) => Ok(mount),
            _ => Err(another_kind(&plan.device, "mount")),
        }
    }

    fn streams_tags(&self, plan: &CounterPlan) -> bool {
        Address::parse(&plan.device, &plan.with).is_ok_and(|a| a.driver.streams_tags())
    }
}
