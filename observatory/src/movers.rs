//! The threads of filter wheels and rotators: each is where the present visit wants it, and between two visits where the next one does.

use super::plan::{CameraPlan, RotatorPlan, WheelPlan};
use super::sequence::Exposing;
use super::worker::{READY, SOON, Worker};
use serde_json::{Map, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use sunglint_drivers::device::{DeviceError, FilterWheel, RotationStage};
use sunglint_formats::session::What;

/// How often a mover looks at the schedule.
const LOOK: Duration = Duration::from_millis(50);
/// How often it asks its device where it stands: somebody else may have turned it.
const ASK: Duration = Duration::from_secs(2);
/// How long a turn may take.
const TURN: Duration = Duration::from_secs(120);
/// A rotator that stands so far off its angle is turned, degrees.
const OFF_DEG: f64 = 0.1;

/// Where a wheel or rotator stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Stand {
    /// On its way.
    Moving,
    /// A filter in the beam.
    Filter(String),
    /// An angle, degrees.
    Angle(f64),
    /// Not known: the device was lost.
    Lost,
}

/// Where all wheels and rotators stand, for the threads of the cameras.
#[derive(Debug, Default)]
pub struct Stands(Mutex<BTreeMap<String, (Stand, u64)>>);

impl Stands {
    fn set(&self, name: &str, stand: Stand) {
        let mut stands = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let moves =
            stands.get(name).map_or(0, |(before, moves)| moves + u64::from(*before != stand));
        stands.insert(name.to_owned(), (stand, moves));
    }

    /// Where a mover stands, and how often that has changed; `None` before it is open.
    pub fn get(&self, name: &str) -> Option<(Stand, u64)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned()
    }
}

/// The cameras behind a mover: those that it names, or all.
pub fn behind<'a>(
    names: &'a [String],
    cameras: &'a [CameraPlan],
) -> impl Iterator<Item = &'a CameraPlan> {
    cameras.iter().filter(move |camera| names.is_empty() || names.contains(&camera.name))
}

/// A wheel at work.
#[derive(Debug)]
pub struct WheelWork {
    plan: WheelPlan,
    cameras: Vec<CameraPlan>,
    stands: Arc<Stands>,
}

impl WheelWork {
    /// A wheel as planned, before these cameras of the plan.
    pub fn new(plan: WheelPlan, cameras: &[CameraPlan], stands: Arc<Stands>) -> Self {
        let cameras = behind(&plan.cameras, cameras).cloned().collect();
        Self { plan, cameras, stands }
    }

    /// Opens the wheel and turns it as the schedule says until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let done = self.turn(worker);
        if done.is_err() {
            self.stands.set(&self.plan.name, Stand::Lost);
        }
        done
    }

    fn turn(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut wheel = worker.opener.wheel(&self.plan, &worker.within(READY))?;
        let names = match self.plan.filters.is_empty() {
            true => wheel.names(),
            false => self.plan.filters.clone(),
        };
        worker.opened(wheel.as_mut())?;
        let name_of = |slot: u32| {
            let name = (slot as usize).checked_sub(1).and_then(|k| names.get(k));
            name.cloned().unwrap_or_else(|| format!("slot {slot}"))
        };
        let mut asked_at = worker.clock.clock.now();
        let mut at = name_of(wheel.slot(&worker.within(SOON))?);
        self.stands.set(&self.plan.name, Stand::Filter(at.clone()));
        worker.works();
        while !worker.is_over() {
            let now = worker.clock.clock.now();
            if now.saturating_sub(asked_at) >= ASK {
                asked_at = now;
                at = name_of(wheel.slot(&worker.within(SOON))?);
                self.stands.set(&self.plan.name, Stand::Filter(at.clone()));
            }
            if let Some(wanted) = self.wanted(worker).filter(|wanted| *wanted != at) {
                at = name_of(self.go(wheel.as_mut(), &wanted, &names, worker)?);
                if at != wanted {
                    let got = format!("{at} is in the beam");
                    let (device, name) = ("filter wheel", "filter");
                    return Err(DeviceError::NotTaken { device, name, asked: wanted, got });
                }
                self.stands.set(&self.plan.name, Stand::Filter(at.clone()));
            }
            // Cut short by Ctrl-C alone.
            let _ = worker.within(Duration::MAX).sleep(LOOK);
        }
        Ok(())
    }

    /// The filter that the cameras behind it want now.
    fn wanted(&self, worker: &Worker) -> Option<String> {
        let (schedule, utc) = (worker.schedule.get(), worker.clock.utc());
        self.cameras.iter().find_map(|camera| schedule.exposing(camera, utc).plan.filter)
    }

    fn go(
        &self,
        wheel: &mut dyn FilterWheel,
        wanted: &str,
        names: &[String],
        worker: &mut Worker,
    ) -> Result<u32, DeviceError> {
        let place = names.iter().position(|name| name == wanted);
        let Some(slot) = place.and_then(|k| u32::try_from(k + 1).ok()) else {
            worker.permanent = true;
            let known = match names.is_empty() {
                true => "no names: give the wheel's `filters`".to_owned(),
                false => names.join(", "),
            };
            return Err(DeviceError::Unknown { name: "filter", asked: wanted.to_owned(), known });
        };
        self.stands.set(&self.plan.name, Stand::Moving);
        let stands = wheel.select(slot, &worker.within(TURN)).map_err(|failed| *failed.error)?;
        set(&self.plan.name, "filter", json!(wanted), worker);
        Ok(stands)
    }
}

/// A rotator at work.
#[derive(Debug)]
pub struct RotatorWork {
    plan: RotatorPlan,
    stands: Arc<Stands>,
}

impl RotatorWork {
    /// A rotator as planned.
    pub fn new(plan: RotatorPlan, stands: Arc<Stands>) -> Self {
        Self { plan, stands }
    }

    /// Opens the rotator and turns it as the schedule says until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let done = self.turn(worker);
        if done.is_err() {
            self.stands.set(&self.plan.name, Stand::Lost);
        }
        done
    }

    fn turn(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut stage = worker.opener.rotator(&self.plan, &worker.within(READY))?;
        worker.opened(stage.as_mut())?;
        let mut asked_at = worker.clock.clock.now();
        let mut at_deg = stage.angle_deg(&worker.within(SOON))?;
        self.stands.set(&self.plan.name, Stand::Angle(at_deg));
        worker.works();
        while !worker.is_over() {
            let now = worker.clock.clock.now();
            if now.saturating_sub(asked_at) >= ASK {
                asked_at = now;
                at_deg = stage.angle_deg(&worker.within(SOON))?;
                self.stands.set(&self.plan.name, Stand::Angle(at_deg));
            }
            if let Some(wanted) = wanted_deg(worker).filter(|w| apart_deg(*w, at_deg) > OFF_DEG) {
                at_deg = self.go(stage.as_mut(), wanted, worker)?;
                if apart_deg(wanted, at_deg) > OFF_DEG {
                    let (device, name) = ("rotator", "angle");
                    let (asked, got) = (format!("{wanted}°"), format!("it stands at {at_deg}°"));
                    return Err(DeviceError::NotTaken { device, name, asked, got });
                }
                self.stands.set(&self.plan.name, Stand::Angle(at_deg));
            }
            // Cut short by Ctrl-C alone.
            let _ = worker.within(Duration::MAX).sleep(LOOK);
        }
        Ok(())
    }

    fn go(
        &self,
        stage: &mut dyn RotationStage,
        wanted_deg: f64,
        worker: &Worker,
    ) -> Result<f64, DeviceError> {
        self.stands.set(&self.plan.name, Stand::Moving);
        let moved = stage.move_to(wanted_deg, &worker.within(TURN));
        let at_deg = moved.map_err(|failed| *failed.error)?;
        set(&self.plan.name, "angle_deg", json!(at_deg), worker);
        Ok(at_deg)
    }
}

/// The angle that the schedule wants now, degrees.
pub fn wanted_deg(worker: &Worker) -> Option<f64> {
    let schedule = worker.schedule.get();
    schedule.setting(worker.clock.utc())?.step.as_ref()?.rotator_deg
}

/// The angle between two directions of a rotator, degrees, 0 to 180.
pub fn apart_deg(a: f64, b: f64) -> f64 {
    let apart = (a - b).rem_euclid(360.0);
    apart.min(360.0 - apart)
}

fn set(device: &str, name: &str, value: serde_json::Value, worker: &Worker) {
    let settings = Map::from_iter([(name.to_owned(), value)]);
    worker.disk.event(worker.clock.utc(), What::Set { device: device.to_owned(), settings });
}

/// What a camera waits for before it exposes: a wheel with its filter, rotators at their angle.
#[derive(Debug, Clone)]
pub struct Before {
    /// The wheel before the camera.
    pub wheel: Option<String>,
    /// The rotators that turn it.
    pub rotators: Vec<String>,
    /// Where they stand.
    pub stands: Arc<Stands>,
}

impl Before {
    /// Whether all stand as the camera wants them; `None` where one of them is lost or not open.
    pub fn is_ready(&self, exposing: &Exposing, angle_deg: Option<f64>) -> Option<bool> {
        let wheel = self.wheel.as_ref().zip(exposing.plan.filter.as_ref());
        let filter = wheel.map(|(wheel, filter)| match self.stands.get(wheel)?.0 {
            Stand::Filter(at) => Some(at == *filter),
            Stand::Lost => None,
            _ => Some(false),
        });
        let angle = angle_deg.into_iter().flat_map(|wanted| {
            self.rotators.iter().map(move |name| match self.stands.get(name)?.0 {
                Stand::Angle(at) => Some(apart_deg(at, wanted) <= OFF_DEG),
                Stand::Lost => None,
                _ => Some(false),
            })
        });
        let mut all = filter.into_iter().chain(angle);
        all.try_fold(true, |ready, each| Some(ready && each?))
    }

    /// How often any of them has moved.
    pub fn moves(&self) -> u64 {
        let all = self.wheel.iter().chain(&self.rotators);
        all.filter_map(|name| self.stands.get(name)).map(|(_, moves)| moves).sum()
    }

    /// Name of the filter in the beam; `None` without a wheel.
    pub fn filter(&self) -> Option<String> {
        match self.stands.get(self.wheel.as_ref()?) {
            Some((Stand::Filter(name), _)) => Some(name),
            _ => Some("unknown".into()),
        }
    }

    /// The angle of the first rotator, degrees.
    pub fn angle_deg(&self) -> Option<f64> {
        match self.stands.get(self.rotators.first()?)?.0 {
            Stand::Angle(deg) => Some(deg),
            _ => None,
        }
    }
}
