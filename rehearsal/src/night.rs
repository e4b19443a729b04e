//! A virtual observatory in place of a night's devices: as fast as it can, its truth in the session.

use hifitime::Epoch;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, DeviceClock, VirtualClock, utc_now};
use sunglint_drivers::device::{Camera, DeviceError, Mount, PhotonCounter};
use sunglint_observatory::{
    CameraPlan, Catalogue, CounterPlan, MountPlan, Night, Opener, Plan, PlanError, Slot,
    VirtualRequest,
};
use sunglint_virtual::observatory::devices::{
    ObservatoryError, Scheduled, Stay, VirtualObservatory,
};
use sunglint_virtual::together::{JoinedClock, Together};

/// The computer's clock, counted from a moment.
#[derive(Debug)]
struct Since(Epoch);

impl Clock for Since {
    fn now(&self) -> Duration {
        let passed = (utc_now() - self.0).total_nanoseconds();
        Duration::from_nanos(u64::try_from(passed.max(0)).unwrap_or(u64::MAX))
    }

    fn sleep(&self, time: Duration) {
        std::thread::sleep(time);
    }
}

/// Clocks of a group, by the device that has each.
type Members = HashMap<String, Weak<JoinedClock>>;

/// The devices of a virtual night, each on a clock of its own.
#[derive(Debug, Clone)]
pub struct VirtualNight {
    observatory: VirtualObservatory,
    real_time: bool,
    clocks: Arc<Mutex<HashMap<String, Arc<VirtualClock>>>>,
    /// Clocks that wait for each other, in a night with a mount.
    together: Option<(Together, Arc<Mutex<Members>>)>,
}

impl VirtualNight {
    /// The night of a `virtual.toml` with the visits of a plan, or, where that has none, with its own, which the plan then gets.
    /// The files that it was made of, and its truth, come with the configuration's files.
    pub fn make(request: VirtualRequest<'_>) -> Result<Self, ObservatoryError> {
        let VirtualRequest { file, station, from, slots, mounted, files } = request;
        let planned = std::mem::take(slots);
        let stay = |slot: &Slot| Stay { target: slot.target.clone(), from: slot.from, to: slot.to };
        let stays = planned.iter().map(stay).collect();
        let made = VirtualObservatory::scheduled(file, station, from, stays, mounted)?;
        let Scheduled { observatory, stays, files: own } = made;
        // The plan's own visits come back in their order, with the settings of their steps.
        let steps = planned.into_iter().map(|slot| slot.step).chain(std::iter::repeat(None));
        let slot = |(Stay { target, from, to }, step)| Slot { step, ..Slot::new(target, from, to) };
        slots.extend(stays.into_iter().zip(steps).map(slot));
        files.extend(own);
        let together = mounted.then(|| (Together::new(), Arc::default()));
        Ok(Self { observatory, real_time: false, clocks: Arc::default(), together })
    }

    /// The same night on the computer's clock: it must begin about now.
    pub fn in_real_time(self) -> Self {
        Self { real_time: true, ..self }
    }

    /// The night behind the devices.
    pub fn observatory(&self) -> &VirtualObservatory {
        &self.observatory
    }
}

impl Opener for VirtualNight {
    fn clock(&self, device: &str) -> DeviceClock {
        if self.real_time {
            return DeviceClock {
                clock: Arc::new(Since(self.observatory.night().start)),
                zero_utc: None,
            };
        }
        let zero_utc = Some(self.observatory.night().start);
        if let Some((group, members)) = &self.together {
            let mut members = members.lock().unwrap_or_else(PoisonError::into_inner);
            let known = members.get(device).and_then(Weak::upgrade);
            let clock = known.unwrap_or_else(|| {
                let clock = Arc::new(group.join());
                members.insert(device.to_owned(), Arc::downgrade(&clock));
                clock
            });
            return DeviceClock { clock, zero_utc };
        }
        let mut clocks = self.clocks.lock().unwrap_or_else(PoisonError::into_inner);
        let clock = clocks.entry(device.to_owned()).or_default().clone();
        DeviceClock { clock, zero_utc }
    }

    fn mount(&self, _: &MountPlan, _: &Deadline) -> Result<Box<dyn Mount>, DeviceError> {
        match self.observatory.mount() {
            Some(mount) => Ok(Box::new(mount)),
            None => Err(DeviceError::NotReady {
                device: "virtual mount",
                reason: "the plan of this night has no mount",
            }),
        }
    }

    fn moves_for_real(&self) -> bool {
        false
    }

    fn camera(&self, _: &CameraPlan, _: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
        match self.observatory.camera() {
            Some(camera) => Ok(Box::new(camera)),
            None => Err(DeviceError::NotReady {
                device: "virtual camera",
                reason: "the station of this night has no camera",
            }),
        }
    }

    fn counter(
        &self,
        plan: &CounterPlan,
        _: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        Ok(Box::new(self.observatory.counter(&plan.channel_names())?))
    }
}

/// A night with the devices of the catalogue, or of a virtual observatory, which comes with it. `program` is the name and version that stand in the session.
///
/// # Errors
/// A plan that cannot be read or that no night can follow.
pub fn planned(
    plan: &Path,
    output: Option<&Path>,
    program: &str,
) -> Result<(Night, Option<VirtualNight>), PlanError> {
    let mut made = None;
    let plan = Plan::read_with(plan, &mut |request| {
        made = Some(VirtualNight::make(request)?);
        Ok(())
    })?;
    let opener: Arc<dyn Opener> = match &made {
        Some(night) => Arc::new(night.clone()),
        None => Catalogue::of(&plan),
    };
    Ok((Night::planned(plan, opener, output, program), made))
}
