//! The virtual rig behind the devices: monochromator, photodiode, counter, filter wheel and two sources, like any other.

use super::detector::Detector;
use super::options::Options;
use crate::observatory::random::{Purpose, Random, seed_of, stream};
use crate::options::OptionError;
use hifitime::Epoch;
use rand::RngExt as _;
use rand_distr::StandardNormal;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    Device, DeviceError, FilterWheel, Identity, InBeam, Interrupted, Level, Meter, Monochromator,
    Origin, PhotonCounter, Setting, Source, Value,
};
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_numerics::measured::Interval;

/// Time that the wheel takes for a slot, s.
const SLOT_S: f64 = 0.5;

/// A rig; clones are the same one.
#[derive(Debug, Clone)]
pub struct VirtualCounting(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    options: Options,
    shown_nm: f64,
    slot: u32,
    is_blocked: bool,
    sources: [(f64, bool); 2],
    /// Readings and exposures so far: each has its own chance.
    readings: u64,
}

impl State {
    /// The chance of the next reading, unless the cables are out.
    fn next(&mut self, device: &'static str) -> Result<Random, DeviceError> {
        let number = self.readings;
        if self.options.fault.unplugged_at_reading.is_some_and(|first| number >= first) {
            let what = "it does not answer: its cable is out".to_owned();
            return Err(DeviceError::Lost { device, what });
        }
        self.readings += 1;
        Ok(stream(self.options.seed, Purpose::Part, number))
    }

    /// Factor of the light by the lamp's flicker; 0 where the beam is blocked.
    fn flicker(&self, random: &mut Random) -> f64 {
        let flicker: f64 = random.sample(StandardNormal);
        if self.is_blocked { 0.0 } else { 1.0 + self.options.lamp.flicker * flicker }
    }

    /// Mean over a span, s, of a drift that is straight but for the lamp that comes back.
    fn mean(&self, begin_s: f64, length_s: f64, drift: impl Fn(f64) -> f64) -> f64 {
        let again_s = self.options.lamp.reignites_at_s.unwrap_or(f64::INFINITY);
        let before_s = (again_s - begin_s).clamp(0.0, length_s);
        let after_s = length_s - before_s;
        let part = |from_s: f64, s: f64| if s > 0.0 { s * drift(from_s + 0.5 * s) } else { 0.0 };
        (part(begin_s, before_s) + part(begin_s + before_s, after_s)) / length_s
    }

    fn light(&self) -> super::light::Light {
        self.options.light(self.shown_nm + self.options.monochromator.offset_nm, self.slot)
    }
}

impl VirtualCounting {
    /// A rig whose next reading is the `readings`-th, from 0.
    ///
    /// # Errors
    /// Options of which no rig can be made.
    pub fn new(options: Options, readings: u64) -> Result<Self, OptionError> {
        options.check()?;
        let shown_nm = options.monochromator.range_nm[0].max(500.0);
        let sources = [(1.0, false); 2];
        let (slot, is_blocked) = (1, false);
        Ok(Self(Arc::new(Mutex::new(State {
            options,
            shown_nm,
            slot,
            is_blocked,
            sources,
            readings,
        }))))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts something into the beam: it is blocked, or open.
    pub fn place(&self, place: InBeam) {
        self.state().is_blocked = place == InBeam::Blocked;
    }

    /// Monochromator.
    #[must_use]
    pub fn monochromator(&self) -> VirtualMonochromator {
        VirtualMonochromator(self.clone())
    }

    /// Photodiode.
    #[must_use]
    pub fn photodiode(&self) -> VirtualPhotodiode {
        VirtualPhotodiode(self.clone())
    }

    /// Counter of the detector's pulses.
    #[must_use]
    pub fn counter(&self) -> VirtualCounter {
        VirtualCounter { rig: self.clone(), names: vec!["c1".to_owned()], bin_ps: None }
    }

    /// Filter wheel.
    #[must_use]
    pub fn wheel(&self) -> VirtualWheel {
        VirtualWheel(self.clone())
    }

    /// Source A (0) or B (1).
    #[must_use]
    pub fn source(&self, number: usize) -> VirtualSource {
        VirtualSource { rig: self.clone(), number: number.min(1) }
    }
}

fn identity(model: &str, rig: &VirtualCounting) -> Identity {
    Identity {
        vendor: "sunglint".into(),
        model: model.into(),
        serial: Some(format!("seed {}", rig.state().options.seed)),
        firmware: Some(env!("CARGO_PKG_VERSION").into()),
        driver: "virtual",
    }
}

fn setting(name: &'static str, value: f64) -> Setting {
    Setting { name, value: Value::Number(value), origin: Origin::ReadBack }
}

fn wait(deadline: &Deadline, s: f64, device: &'static str) -> Result<(), DeviceError> {
    let waited = deadline.sleep(Duration::from_secs_f64(s));
    waited.map_err(|expired| DeviceError::expired(device, "working", expired))
}

/// The monochromator of a virtual rig.
#[derive(Debug)]
pub struct VirtualMonochromator(VirtualCounting);

const MONOCHROMATOR: &str = "virtual monochromator";

impl Device for VirtualMonochromator {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(MONOCHROMATOR, &self.0))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let state = self.0.state();
        Ok(vec![setting("wavelength_nm", state.shown_nm)])
    }
}

impl Monochromator for VirtualMonochromator {
    fn range_nm(&self) -> Option<Interval> {
        Some(self.0.state().options.monochromator.range_nm.into())
    }

    fn wavelength_nm(&mut self, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(self.0.state().shown_nm)
    }

    fn move_to(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        let (at, grating) = {
            let state = self.0.state();
            (state.shown_nm, state.options.monochromator.clone())
        };
        let [least, most] = grating.range_nm;
        if !(least..=most).contains(&wavelength_nm) {
            let name = "wavelength_nm";
            let error = DeviceError::OutOfRange { name, asked: wavelength_nm, least, most };
            return Err(Interrupted::new(Some(at), error));
        }
        wait(deadline, (wavelength_nm - at).abs() / grating.speed_nm_per_s, MONOCHROMATOR)
            .map_err(|error| Interrupted::new(Some(at), error))?;
        let shown_nm = (wavelength_nm / grating.step_nm).round() * grating.step_nm;
        self.0.state().shown_nm = shown_nm;
        Ok(shown_nm)
    }
}

/// The photodiode of a virtual rig, V.
#[derive(Debug)]
pub struct VirtualPhotodiode(VirtualCounting);

const PHOTODIODE: &str = "virtual photodiode";

impl Device for VirtualPhotodiode {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(PHOTODIODE, &self.0))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        Ok(vec![setting("range_v", self.0.state().options.photodiode.most_v)])
    }
}

impl Meter for VirtualPhotodiode {
    fn unit(&self) -> &str {
        "V"
    }

    fn read(&mut self, deadline: &Deadline) -> Result<Level, DeviceError> {
        let reading_s = self.0.state().options.photodiode.reading_s;
        wait(deadline, reading_s, PHOTODIODE)?;
        let mut state = self.0.state();
        let mut random = state.next(PHOTODIODE)?;
        let begin_s = deadline.now().as_secs_f64() - reading_s;
        let at_s = begin_s + 0.5 * reading_s;
        let options = &state.options;
        let drift = |at_s: f64| options.lamp_drift(at_s) * options.photodiode_drift(at_s);
        let lamp = state.flicker(&mut random) * state.mean(begin_s, reading_s, drift);
        let current_a = state.light().photodiode_a * lamp;
        let diode = &state.options.photodiode;
        let zero_v = diode.zero_v + diode.zero_drift_v_per_h * at_s / 3600.0;
        let noise: f64 = random.sample(StandardNormal);
        let volts = current_a * diode.load_ohm + zero_v + diode.noise_v * noise;
        Ok(if volts > diode.most_v { Level::Over } else { Level::Value(volts) })
    }
}

/// The counter of a virtual rig.
#[derive(Debug)]
pub struct VirtualCounter {
    rig: VirtualCounting,
    names: Vec<String>,
    bin_ps: Option<i64>,
}

const COUNTER: &str = "virtual counter";

impl Device for VirtualCounter {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(COUNTER, &self.rig))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        Ok(vec![])
    }
}

impl VirtualCounter {
    fn bin(&mut self, bin_ps: i64, deadline: &Deadline) -> Result<CountRecord, DeviceError> {
        let bin_s = 1e-12 * bin_ps as f64;
        let begin_s = deadline.now().as_secs_f64();
        wait(deadline, bin_s, COUNTER)?;
        let mut state = self.rig.state();
        let mut random = state.next(COUNTER)?;
        let options = &state.options;
        let drift = |at_s: f64| options.lamp_drift(at_s) * options.sensor_drift(at_s);
        let lamp = state.flicker(&mut random) * state.mean(begin_s, bin_s, drift);
        let slot = (state.slot as usize).saturating_sub(1);
        let filter = state.options.wheel.get(slot).map_or(1.0, |slot| slot.transmission);
        let Options { sources, sensor, seed, .. } = &state.options;
        let of = |k: usize, hz: f64| if state.sources[k].1 { state.sources[k].0 * hz } else { 0.0 };
        let alone_hz = filter * (of(0, sources.a_hz) + of(1, sources.b_hz));
        let rate_hz = sensor.dark_hz + state.light().detected_hz * lamp + alone_hz;
        let chance = seed_of(*seed, Purpose::Bin, state.readings);
        let counts = Detector::new(sensor, chance).counts(rate_hz, bin_s);
        Ok(CountRecord {
            start: Epoch::from_gregorian_utc_at_midnight(2026, 1, 1)
                + hifitime::Duration::from_seconds(begin_s),
            start_ps: (begin_s * 1e12) as i64,
            length_ps: bin_ps,
            counts: vec![counts],
            missed: vec![0],
            flags: CountFlags::empty(),
        })
    }
}

impl PhotonCounter for VirtualCounter {
    fn channels(&self) -> &[String] {
        &self.names
    }

    /// Without effect: its pulses are all alike.
    fn set_trigger_level_v(&mut self, _: usize, v: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(v)
    }

    /// Has none: gives 0.
    fn set_input_delay_ps(&mut self, _: usize, _: i64, _: &Deadline) -> Result<i64, DeviceError> {
        Ok(0)
    }

    /// Has none of its own, the detector has: gives 0.
    fn set_dead_time_ps(&mut self, _: usize, _: i64, _: &Deadline) -> Result<i64, DeviceError> {
        Ok(0)
    }

    fn start(&mut self, bin_ps: i64, _: &Deadline) -> Result<(), DeviceError> {
        let (least, most) = (1_000_000, 3_600_000_000_000_000);
        if !(least..=most).contains(&bin_ps) {
            let (asked, least, most) = (bin_ps as f64, least as f64, most as f64);
            return Err(DeviceError::OutOfRange { name: "bin_ps", asked, least, most });
        }
        self.bin_ps = Some(bin_ps);
        Ok(())
    }

    fn read(
        &mut self,
        bins: usize,
        deadline: &Deadline,
    ) -> Result<Vec<CountRecord>, Interrupted<Vec<CountRecord>>> {
        let mut records = Vec::new();
        let Some(bin_ps) = self.bin_ps else {
            let reason = "it does not count: start it first";
            return Err(Interrupted::new(
                records,
                DeviceError::NotReady { device: COUNTER, reason },
            ));
        };
        for _ in 0..bins {
            match self.bin(bin_ps, deadline) {
                Ok(record) => records.push(record),
                Err(error) => return Err(Interrupted::new(records, error)),
            }
        }
        Ok(records)
    }

    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        self.bin_ps = None;
        Ok(())
    }
}

/// The filter wheel of a virtual rig.
#[derive(Debug)]
pub struct VirtualWheel(VirtualCounting);

const WHEEL: &str = "virtual filter wheel";

impl Device for VirtualWheel {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(WHEEL, &self.0))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        Ok(vec![])
    }
}

impl FilterWheel for VirtualWheel {
    fn slots(&self) -> u32 {
        u32::try_from(self.0.state().options.wheel.len()).unwrap_or(u32::MAX)
    }

    fn slot(&mut self, _: &Deadline) -> Result<u32, DeviceError> {
        Ok(self.0.state().slot)
    }

    fn select(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, Interrupted<Option<u32>>> {
        let at = self.0.state().slot;
        let slots = self.slots();
        if !(1..=slots).contains(&slot) {
            let (asked, most) = (f64::from(slot), f64::from(slots));
            let error = DeviceError::OutOfRange { name: "slot", asked, least: 1.0, most };
            return Err(Interrupted::new(Some(at), error));
        }
        if slot != at {
            wait(deadline, SLOT_S, WHEEL).map_err(|error| Interrupted::new(Some(at), error))?;
        }
        self.0.state().slot = slot;
        Ok(slot)
    }
}

/// A source of a virtual rig: its level is a factor.
#[derive(Debug)]
pub struct VirtualSource {
    rig: VirtualCounting,
    number: usize,
}

const SOURCE: &str = "virtual source";

impl Device for VirtualSource {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(SOURCE, &self.rig))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        Ok(vec![setting("level", self.rig.state().sources[self.number].0)])
    }
}

impl Source for VirtualSource {
    fn unit(&self) -> &str {
        "1"
    }

    fn range(&self) -> Option<Interval> {
        Some([0.0, 1e3].into())
    }

    fn level(&mut self, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(self.rig.state().sources[self.number].0)
    }

    fn set_level(&mut self, level: f64, _: &Deadline) -> Result<f64, DeviceError> {
        if !(0.0..=1e3).contains(&level) {
            let (name, least, most) = ("level", 0.0, 1e3);
            return Err(DeviceError::OutOfRange { name, asked: level, least, most });
        }
        self.rig.state().sources[self.number].0 = level;
        Ok(level)
    }

    fn is_on(&mut self, _: &Deadline) -> Result<bool, DeviceError> {
        Ok(self.rig.state().sources[self.number].1)
    }

    fn switch(&mut self, on: bool, _: &Deadline) -> Result<bool, DeviceError> {
        self.rig.state().sources[self.number].1 = on;
        Ok(on)
    }
}
