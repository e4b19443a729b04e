//! The virtual goniometer behind the drivers' traits: up to four stages and a power meter.
//!
//! All take the time from the deadlines that they are given, so that on a [`VirtualClock`](sunglint_drivers::clock::VirtualClock) a run of hours takes no time.

use super::light::{Arms, Bench};
use super::options::{Options, SpectrometerOptions};
use crate::observatory::random::{Purpose, stream};
use crate::options::OptionError;
use crate::rig::meter::{Meter, Shown};
use crate::rig::options::Options as RigOptions;
use crate::rig::stage::Stage;
use hifitime::Epoch;
use rand_distr::{Distribution as _, StandardNormal};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    Device, DeviceError, Identity, InBeam, Interrupted, Monochromator, Origin, Power, PowerMeter,
    RotationStage, Setting, Spectrometer, Spectrum, Value,
};
use sunglint_numerics::measured::Interval;

const STAGES: [&str; 4] = [
    "virtual sample stage",
    "virtual detector stage",
    "virtual azimuth stage",
    "virtual turning stage",
];
const METER: &str = "virtual detector";
const SPECTROMETER: &str = "virtual spectrometer";
const MONOCHROMATOR: &str = "virtual monochromator";
/// Time that the monochromator takes for a nm, and for a move in any case, s.
const PER_NM_S: f64 = 0.01;
const MOVE_S: f64 = 0.1;
/// Wavelengths that it reaches, nm.
const REACH_NM: [f64; 2] = [200.0, 2500.0];
/// The range in which the meter chooses by itself.
const AUTO: &str = "AUTO";

/// A goniometer; clones are the same one.
#[derive(Debug, Clone)]
pub struct VirtualGoniometer(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    bench: Bench,
    rig: RigOptions,
    stages: [Stage; 4],
    meter: Meter,
    place: InBeam,
    wavelength_nm: f64,
    /// Readings so far: each has its own chance.
    readings: u64,
    /// The light over the lamp's power, for where all stands now.
    light: Option<f64>,
    /// The same by its parts: grey, the sample's lobe, its Lambert part.
    parts: Option<[f64; 3]>,
    /// Wavelength at which the monochromator stands, nm; none where there is none.
    monochromator_nm: Option<f64>,
}

/// Wavelengths of a spectrometer's pixels, nm.
fn pixels(options: &SpectrometerOptions) -> Vec<f64> {
    let n = options.pixels;
    let step = (options.to_nm - options.from_nm) / (n - 1) as f64;
    (0..n).map(|k| options.from_nm + step * k as f64).collect()
}

impl State {
    /// Where the arms stand.
    fn arms(&self) -> Arms {
        let options = self.bench.options();
        let [sample, detector, azimuth, turn_deg] = self.stages.map(|stage| stage.sample_deg());
        let incidence_deg = sample - options.zero.sample_deg;
        let detector = detector - options.zero.detector_deg;
        let from_normal =
            if options.detector.from_lamp { detector - incidence_deg } else { detector };
        Arms {
            incidence_deg,
            detector_deg: from_normal,
            azimuth_deg: azimuth - options.zero.azimuth_deg,
            turn_deg,
        }
    }

    fn is_unplugged(&self) -> bool {
        let unplugged = self.bench.options().fault.unplugged_at_reading;
        unplugged.is_some_and(|number| self.readings >= number)
    }

    fn part(&mut self) -> f64 {
        let (place, arms) = (self.place, self.arms());
        let bench = &self.bench;
        match self.monochromator_nm {
            None => *self.light.get_or_insert_with(|| bench.part(place, &arms)),
            Some(nm) => {
                let [grey, lobe, base] =
                    *self.parts.get_or_insert_with(|| bench.parts(place, &arms));
                let strength = bench.sample_parts(nm);
                bench.lamp_part(nm) * (grey + strength.lobe * lobe + strength.base * base)
            }
        }
    }

    /// Something moved.
    fn moved(&mut self) {
        (self.light, self.parts) = (None, None);
    }

    /// Integrates once, at a time: the counts of all pixels; `None` where the cable is out.
    fn counts(&mut self, at_s: f64, integration_s: f64) -> Option<Vec<f64>> {
        if self.is_unplugged() {
            return None;
        }
        let (place, arms) = (self.place, self.arms());
        let bench = &self.bench;
        let [grey, lobe, base] = *self.parts.get_or_insert_with(|| bench.parts(place, &arms));
        let options = bench.options();
        let it = &options.spectrometer;
        let mut random = stream(options.seed, Purpose::Bin, self.readings);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let lamp = bench.lamp_w(at_s) * (1.0 + options.lamp.noise * normal());
        let end = it.saturation_counts;
        let one = |nm: f64| {
            let strength = bench.sample_parts(nm);
            let sensitive = (-0.5 * ((nm - it.peak_nm) / it.sensitive_nm).powi(2)).exp();
            let light =
                lamp * bench.lamp_part(nm) * (grey + strength.lobe * lobe + strength.base * base);
            let per_s = it.counts_per_s_per_w * sensitive * light + it.dark_counts_per_s;
            let electrons = per_s * integration_s * it.electrons_per_count;
            // So many electrons that their number is normally distributed; of few the read noise is more.
            let shot = electrons.sqrt() * normal() / it.electrons_per_count;
            let read = it.read_noise_counts * normal();
            (it.bias_counts + per_s * integration_s + shot + read).round().clamp(0.0, end)
        };
        let mut counts: Vec<f64> = pixels(it).into_iter().map(one).collect();
        if options.fault.short_at_reading == Some(self.readings) {
            counts.truncate(counts.len() / 2);
        }
        self.readings += 1;
        Some(counts)
    }
}

impl VirtualGoniometer {
    /// A goniometer whose next reading is the `readings`-th, from 0.
    ///
    /// # Errors
    /// Options of which none can be made.
    pub fn new(options: Options, readings: u64) -> Result<Self, OptionError> {
        let rig = options.rig();
        let (meter, wavelength_nm) = (Meter::new(&rig), options.lamp.wavelength_nm);
        let bench = Bench::new(options)?;
        Ok(Self(Arc::new(Mutex::new(State {
            bench,
            rig,
            stages: [Stage::new(); 4],
            meter,
            place: InBeam::Nothing,
            wavelength_nm,
            readings,
            light: None,
            parts: None,
            monochromator_nm: None,
        }))))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts something into the beam.
    pub fn place(&self, place: InBeam) {
        let mut state = self.state();
        state.place = place;
        state.moved();
    }

    /// Returns what is in the beam.
    pub fn placed(&self) -> InBeam {
        self.state().place
    }

    /// The motor of a stage stands at an angle, degrees, whoever turned it.
    pub(super) fn stand(&self, axis: usize, motor_deg: f64) {
        let mut state = self.state();
        let state = &mut *state;
        if state.stages[axis].motor_deg() != motor_deg {
            state.stages[axis].stand(&state.rig, motor_deg);
            state.moved();
        }
    }

    /// Whether the meter's cable is out.
    pub(super) fn is_unplugged(&self) -> bool {
        self.state().is_unplugged()
    }

    /// Measures once, at a time: `None` where the meter's cable is out.
    pub(super) fn shown(&self, at: Duration) -> Option<Shown> {
        let mut state = self.state();
        let state = &mut *state;
        if state.is_unplugged() {
            return None;
        }
        let at_s = at.as_secs_f64();
        let light_w = state.part() * state.bench.lamp_w(at_s);
        let shown = state.meter.read(&state.rig, light_w, at_s, state.readings);
        state.readings += 1;
        Some(shown)
    }

    /// A stage: sample, detector, azimuth, turn.
    ///
    /// # Panics
    /// There is no such stage.
    #[must_use]
    pub fn stage(&self, axis: usize) -> VirtualStage {
        assert!(axis < STAGES.len(), "four stages");
        let travel_deg = self.state().rig.stage.travel_deg;
        VirtualStage { bench: self.clone(), axis, travel_deg }
    }

    /// A spectrometer in the meter's place.
    #[must_use]
    pub fn spectrometer(&self) -> VirtualSpectrometer {
        let wavelength_nm = pixels(&self.state().bench.options().spectrometer);
        VirtualSpectrometer { bench: self.clone(), wavelength_nm }
    }

    /// A monochromator in the beam. It stands at the lamp's wavelength, and from now on the meter sees the light that it lets through.
    #[must_use]
    pub fn monochromator(&self) -> VirtualMonochromator {
        let mut state = self.state();
        let nm = state.bench.options().lamp.wavelength_nm;
        state.monochromator_nm = Some(nm);
        drop(state);
        VirtualMonochromator(self.clone())
    }

    /// The meter behind the detector's stop.
    #[must_use]
    pub fn meter(&self) -> VirtualDetector {
        VirtualDetector(self.clone())
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

/// A stage of a virtual goniometer.
#[derive(Debug)]
pub struct VirtualStage {
    bench: VirtualGoniometer,
    axis: usize,
    travel_deg: [f64; 2],
}

impl Device for VirtualStage {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(STAGES[self.axis], self.bench.state().bench.options().seed))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let state = self.bench.state();
        let stage = &state.rig.stage;
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
        Ok(self.bench.state().stages[self.axis].motor_deg())
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
        let mut state = self.bench.state();
        let at = state.stages[self.axis].motor_deg();
        if !(least..=most).contains(&angle_deg) {
            let error =
                DeviceError::OutOfRange { name: "angle_deg", asked: angle_deg, least, most };
            return Err(Interrupted::new(Some(at), error));
        }
        let state_ref = &mut *state;
        let (took_s, arrived) = state_ref.stages[self.axis].turn(&state_ref.rig, angle_deg);
        state_ref.moved();
        let at = state_ref.stages[self.axis].motor_deg();
        drop(state);
        let name = STAGES[self.axis];
        let expired = |e| Interrupted::new(Some(at), DeviceError::expired(name, "turning", e));
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

/// The power meter of a virtual goniometer.
#[derive(Debug)]
pub struct VirtualDetector(VirtualGoniometer);

impl Device for VirtualDetector {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(METER, self.0.state().bench.options().seed))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let state = self.0.state();
        Ok(vec![
            setting("range_auto", Value::Flag(state.meter.is_automatic())),
            setting("range_w", Value::Number(state.meter.range_w(&state.rig))),
            setting("wavelength_nm", Value::Number(state.wavelength_nm)),
        ])
    }
}

impl PowerMeter for VirtualDetector {
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        let reading_s = self.0.state().rig.meter.reading_s;
        deadline
            .sleep(Duration::from_secs_f64(reading_s))
            .map_err(|expired| DeviceError::expired(METER, "reading", expired))?;
        match self.0.shown(deadline.now()) {
            Some(Shown::Watts(power_w)) => Ok(Power::Watts(power_w)),
            Some(Shown::Over(range_w)) => Ok(Power::Over { range_w: Some(range_w) }),
            None => {
                let what = "it does not answer: its cable is out".to_owned();
                Err(DeviceError::Lost { device: METER, what })
            }
        }
    }

    fn set_wavelength_nm(&mut self, nm: f64, _: &Deadline) -> Result<f64, DeviceError> {
        self.0.state().wavelength_nm = nm;
        Ok(nm)
    }

    fn ranges(&mut self, _: &Deadline) -> Result<Vec<String>, DeviceError> {
        let state = self.0.state();
        let names = state.rig.meter.ranges_w.iter().map(|end| format!("{end:e}W"));
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
        let state = &mut *state;
        let at_s = deadline.now().as_secs_f64();
        state.meter.set_range(&state.rig, place.checked_sub(1), at_s);
        Ok(range.to_owned())
    }

    /// Nothing: the virtual head is never covered.
    fn zero(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        let reason = "its head cannot be covered: the run blocks the beam instead";
        Err(DeviceError::NotReady { device: METER, reason })
    }
}

/// The spectrometer of a virtual goniometer.
#[derive(Debug)]
pub struct VirtualSpectrometer {
    bench: VirtualGoniometer,
    wavelength_nm: Vec<f64>,
}

impl Device for VirtualSpectrometer {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(SPECTROMETER, self.bench.state().bench.options().seed))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let state = self.bench.state();
        let it = &state.bench.options().spectrometer;
        Ok(vec![
            setting("pixels", Value::Integer(i64::try_from(it.pixels).unwrap_or(i64::MAX))),
            setting("from_nm", Value::Number(it.from_nm)),
            setting("to_nm", Value::Number(it.to_nm)),
            setting("saturation_counts", Value::Number(it.saturation_counts)),
        ])
    }
}

impl Spectrometer for VirtualSpectrometer {
    fn wavelength_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    fn integration_s(&self) -> Option<Interval> {
        Some(self.bench.state().bench.options().spectrometer.integration_s.into())
    }

    fn expose(&mut self, integration_s: f64, deadline: &Deadline) -> Result<Spectrum, DeviceError> {
        let range = self.integration_s();
        if let Some(Interval { low: least, high: most }) = range
            && !(least..=most).contains(&integration_s)
        {
            let name = "integration_s";
            return Err(DeviceError::OutOfRange { name, asked: integration_s, least, most });
        }
        let began_s = deadline.now().as_secs_f64();
        deadline
            .sleep(Duration::from_secs_f64(integration_s))
            .map_err(|expired| DeviceError::expired(SPECTROMETER, "integrating", expired))?;
        let mut state = self.bench.state();
        let middle_s = began_s + 0.5 * integration_s;
        let Some(counts) = state.counts(middle_s, integration_s) else {
            let what = "it does not answer: its cable is out".to_owned();
            return Err(DeviceError::Lost { device: SPECTROMETER, what });
        };
        let saturation_counts = Some(state.bench.options().spectrometer.saturation_counts);
        let start = Epoch::from_gregorian_utc_at_midnight(2026, 1, 1)
            + hifitime::Duration::from_seconds(began_s);
        let mut wavelength_nm = self.wavelength_nm.clone();
        wavelength_nm.truncate(counts.len());
        Ok(Spectrum { start, integration_s, wavelength_nm, counts, saturation_counts })
    }
}

/// The monochromator of a virtual goniometer.
#[derive(Debug)]
pub struct VirtualMonochromator(VirtualGoniometer);

impl Device for VirtualMonochromator {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(identity(MONOCHROMATOR, self.0.state().bench.options().seed))
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let nm = self.0.state().monochromator_nm;
        Ok(vec![setting("wavelength_nm", Value::Number(nm.unwrap_or(f64::NAN)))])
    }
}

impl Monochromator for VirtualMonochromator {
    fn range_nm(&self) -> Option<Interval> {
        Some(REACH_NM.into())
    }

    fn wavelength_nm(&mut self, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(self.0.state().monochromator_nm.unwrap_or(f64::NAN))
    }

    fn move_to(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        let at = self.0.state().monochromator_nm;
        let [least, most] = REACH_NM;
        if !(least..=most).contains(&wavelength_nm) {
            let name = "wavelength_nm";
            let error = DeviceError::OutOfRange { name, asked: wavelength_nm, least, most };
            return Err(Interrupted::new(at, error));
        }
        let took_s = MOVE_S + PER_NM_S * at.map_or(0.0, |at| (at - wavelength_nm).abs());
        let expired = |e| Interrupted::new(at, DeviceError::expired(MONOCHROMATOR, "turning", e));
        deadline.sleep(Duration::from_secs_f64(took_s)).map_err(expired)?;
        self.0.state().monochromator_nm = Some(wavelength_nm);
        Ok(wavelength_nm)
    }
}
