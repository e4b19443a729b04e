//! The virtual rig behind the devices: a stage and a power meter like any other, and a sample that is known.
//!
//! Both take the time from the deadlines that they are given, so that on a [`VirtualClock`](sunglint_drivers::clock::VirtualClock) a run of hours takes no time. They
//! stand beside the simulated devices of the drivers, not behind their protocols, which the drivers' own tests are about.

use super::bench::Bench;
use super::meter::{Meter, Shown};
use super::options::Options;
use super::stage::Stage;
use crate::options::OptionError;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    Device, DeviceError, Identity, InBeam, Interrupted, Origin, Power, PowerMeter, RotationStage,
    Setting, Value,
};
use sunglint_numerics::measured::Interval;

const STAGE: &str = "virtual stage";
const METER: &str = "virtual power meter";
/// The range in which the meter chooses by itself.
const AUTO: &str = "AUTO";

/// A rig; clones are the same one.
#[derive(Debug, Clone)]
pub struct VirtualRig(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    bench: Bench,
    stage: Stage,
    meter: Meter,
    place: InBeam,
    wavelength_nm: f64,
    /// Readings so far: each has its own chance.
    readings: u64,
}

impl VirtualRig {
    /// A rig whose next reading is the `readings`-th, from 0.
    ///
    /// # Errors
    /// Options of which no rig can be made.
    pub fn new(options: Options, readings: u64) -> Result<Self, OptionError> {
        let (meter, wavelength_nm) = (Meter::new(&options), options.laser.wavelength_nm);
        let bench = Bench::new(options)?;
        let (stage, place) = (Stage::new(), InBeam::Nothing);
        Ok(Self(Arc::new(Mutex::new(State {
            bench,
            stage,
            meter,
            place,
            wavelength_nm,
            readings,
        }))))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts something into the beam.
    pub fn place(&self, place: InBeam) {
        self.state().place = place;
    }

    /// Stage.
    pub fn stage(&self) -> VirtualStage {
        let travel_deg = self.state().bench.options().stage.travel_deg;
        VirtualStage { rig: self.clone(), travel_deg }
    }

    /// Meter.
    pub fn meter(&self) -> VirtualMeter {
        VirtualMeter(self.clone())
    }
}

fn identity(model: &str, seed: u64) -> Identity {
    Identity {
        vendor: "sunglint".into(),
        model: model.into(),
        serial: Some(format!("seed {seed}")),
        firmware: Some(env!("CARGO_PKG_VERSION").into()),
        driver: "virtual",
    }
}

fn setting(name: &'static str, value: Value) -> Setting {
    Setting { name, value, origin: Origin::ReadBack }
}

/// The stage of a virtual rig.
#[derive(Debug)]
pub struct VirtualStage {
    rig: VirtualRig,
    travel_deg: [f64; 2],
}

impl Device for VirtualStage {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(STAGE, self.rig.state().bench.options().seed))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let state = self.rig.state();
        let stage = &state.bench.options().stage;
        Ok(vec![
            setting("step_deg", Value::Number(stage.step_deg)),
            setting("speed_deg_per_s", Value::Number(stage.speed_deg_per_s)),
        ])
    }
}

impl RotationStage for VirtualStage {
    fn travel_deg(&self) -> Option<Interval> {
        Some(self.travel_deg.into())
    }

    fn angle_deg(&mut self, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(self.rig.state().stage.motor_deg())
    }

    fn home(&mut self, deadline: &Deadline) -> Result<f64, Interrupted<Option<f64>>> {
        self.move_to(0.0, deadline)
    }

    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        let [least, most] = self.travel_deg;
        let at = self.rig.state().stage.motor_deg();
        if !(least..=most).contains(&angle_deg) {
            let error =
                DeviceError::OutOfRange { name: "angle_deg", asked: angle_deg, least, most };
            return Err(Interrupted::new(Some(at), error));
        }
        let mut state = self.rig.state();
        let options = state.bench.options().clone();
        let (took_s, arrived) = state.stage.turn(&options, angle_deg);
        let at = state.stage.motor_deg();
        drop(state);
        let expired = |e| Interrupted::new(Some(at), DeviceError::expired(STAGE, "turning", e));
        deadline.sleep(Duration::from_secs_f64(took_s)).map_err(expired)?;
        if arrived {
            return Ok(at);
        }
        // It never says that it has arrived.
        match deadline.sleep(Duration::MAX) {
            Err(e) => Err(expired(e)),
            Ok(()) => Ok(at),
        }
    }

    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// The power meter of a virtual rig.
#[derive(Debug)]
pub struct VirtualMeter(VirtualRig);

impl Device for VirtualMeter {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(METER, self.0.state().bench.options().seed))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let state = self.0.state();
        Ok(vec![
            setting("range_auto", Value::Flag(state.meter.is_automatic())),
            setting("range_w", Value::Number(state.meter.range_w(state.bench.options()))),
            setting("wavelength_nm", Value::Number(state.wavelength_nm)),
        ])
    }
}

impl PowerMeter for VirtualMeter {
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        let reading_s = self.0.state().bench.options().meter.reading_s;
        deadline
            .sleep(Duration::from_secs_f64(reading_s))
            .map_err(|expired| DeviceError::expired(METER, "reading", expired))?;
        let mut state = self.0.state();
        let state = &mut *state;
        let options = state.bench.options();
        if options.fault.unplugged_at_reading.is_some_and(|number| state.readings >= number) {
            let what = "it does not answer: its cable is out".to_owned();
            return Err(DeviceError::Lost { device: METER, what });
        }
        let at_s = deadline.now().as_secs_f64();
        let light_w = state.bench.light_w(state.place, state.stage.sample_deg(), at_s);
        let shown = state.meter.read(options, light_w, at_s, state.readings);
        state.readings += 1;
        Ok(match shown {
            Shown::Watts(power_w) => Power::Watts(power_w),
            Shown::Over(range_w) => Power::Over { range_w: Some(range_w) },
        })
    }

    fn set_wavelength_nm(&mut self, nm: f64, _: &Deadline) -> Result<f64, DeviceError> {
        self.0.state().wavelength_nm = nm;
        Ok(nm)
    }

    fn ranges(&mut self, _: &Deadline) -> Result<Vec<String>, DeviceError> {
        let ends = self.0.state().bench.options().meter.ranges_w.clone();
        let names = ends.iter().map(|end| format!("{end:e}W"));
        Ok(std::iter::once(AUTO.to_owned()).chain(names).collect())
    }

    fn set_range(&mut self, range: &str, deadline: &Deadline) -> Result<String, DeviceError> {
        let names = self.ranges(deadline)?;
        let unknown = || DeviceError::Unknown {
            name: "range",
            asked: range.to_owned(),
            known: names.join(", "),
        };
        let place = names.iter().position(|name| name == range).ok_or_else(unknown)?;
        let mut state = self.0.state();
        let options = state.bench.options().clone();
        let at_s = deadline.now().as_secs_f64();
        state.meter.set_range(&options, place.checked_sub(1), at_s);
        Ok(range.to_owned())
    }

    /// Nothing: the virtual head is never covered, and its offset stays what the rig says.
    fn zero(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        let reason = "its head cannot be covered: the offset is part of the rig";
        Err(DeviceError::NotReady { device: METER, reason })
    }
}
