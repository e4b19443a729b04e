//! The threads of filter wheels and rotators: each is where the present visit wants it, and between two visits where the next one does.

use super::plan::{CameraPlan, RotatorPlan, WheelPlan};
use super::sequence::Exposing;
use super::worker::{READY, SOON, Worker};
use serde_json::Map;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_drivers::device::{DeviceError, FilterWheel, RotationStage};
use sunglint_formats::session::What;

/// How often a mover looks at the schedule.
const LOOK: Duration = Duration::from_millis(50);
/// How often it asks its device where it stands: somebody else may have turned it.
const ASK: Duration = Duration::from_secs(2);
/// How long a frame waits for a look at the wheel that is later than it.
const WAIT: Duration = Duration::from_secs(1);
/// How long after the night's end a wheel is still looked at for the last frames.
const AFTER: Duration = Duration::from_secs(10);
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

/// A change of where a mover stands: it came after a time at which it was looked at, and was known at another.
#[derive(Debug, Clone, PartialEq)]
struct Change {
    after: Duration,
    known: Duration,
    stand: Stand,
}

/// Course of a mover: the last changes, and how far they are known.
#[derive(Debug, Default)]
struct Course {
    changes: VecDeque<Change>,
    /// Changes so far.
    count: u64,
    /// Begin of the last look that was answered.
    looked: Duration,
    /// Whether a camera waits for a look.
    wanted: bool,
}

/// Changes of a mover that are kept.
const CHANGES: usize = 64;

impl Course {
    fn change(&mut self, after: Duration, known: Duration, stand: Stand) {
        if self.changes.back().is_some_and(|last| last.stand == stand) {
            return;
        }
        self.count += u64::from(!self.changes.is_empty());
        self.changes.push_back(Change { after, known, stand });
        if self.changes.len() > CHANGES {
            self.changes.pop_front();
        }
    }

    /// Where it stood over a time; `None` before it was looked at later.
    fn over(&self, from: Duration, to: Duration) -> Option<Over> {
        let now = self.changes.back()?;
        if now.stand == Stand::Lost {
            return Some(Over::Lost);
        }
        let within = |change: &&Change| change.after < to && change.known > from;
        // That it was found somewhere when it was opened is no change.
        let opened = usize::from(self.count + 1 == self.changes.len() as u64);
        if self.changes.iter().skip(opened).any(|change| within(&change)) {
            return Some(Over::Moved);
        }
        if self.looked < to {
            return None;
        }
        let before = self.changes.iter().rev().find(|change| change.known <= from);
        Some(match before.map(|change| &change.stand) {
            Some(Stand::Moving) => Over::Moved,
            Some(stand) => Over::Stood(stand.clone()),
            None => Over::Lost,
        })
    }
}

/// Stand of a mover over the time of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Over {
    /// It stood.
    Stood(Stand),
    /// It moved, or may have.
    Moved,
    /// It was lost, or is not open.
    Lost,
}

/// Where all wheels and rotators stand, for the threads of the cameras.
#[derive(Debug, Default)]
pub struct Stands {
    courses: Mutex<BTreeMap<String, Course>>,
    /// A look is wanted, or was made.
    news: Condvar,
    /// Held by each camera that is at work.
    at_work: Arc<()>,
}

impl Stands {
    fn courses(&self) -> MutexGuard<'_, BTreeMap<String, Course>> {
        self.courses.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the program does itself, or finds.
    fn set(&self, name: &str, stand: Stand, now: Duration) {
        let mut courses = self.courses();
        courses.entry(name.to_owned()).or_default().change(now, now, stand);
        self.news.notify_all();
    }

    /// What a device has said, in order; by a look that began at `began`, or by itself.
    fn said(&self, name: &str, stands: Vec<Stand>, began: Option<Duration>, now: Duration) {
        let mut courses = self.courses();
        let course = courses.entry(name.to_owned()).or_default();
        let after = course.looked;
        for stand in stands {
            course.change(after, now, stand);
        }
        if let Some(began) = began {
            (course.looked, course.wanted) = (began, false);
            self.news.notify_all();
        }
    }

    /// Where a mover stands, and how often that has changed; `None` before it is open.
    pub fn get(&self, name: &str) -> Option<(Stand, u64)> {
        let courses = self.courses();
        let course = courses.get(name)?;
        Some((course.changes.back()?.stand.clone(), course.count))
    }

    /// Waits until a camera wants a look, or for a while.
    fn wait(&self, name: &str, most: Duration) {
        let idle = |courses: &mut BTreeMap<String, Course>| {
            !courses.get(name).is_some_and(|course| course.wanted)
        };
        // Woken or not: the caller looks.
        drop(self.news.wait_timeout_while(self.courses(), most, idle));
    }

    fn is_wanted(&self, name: &str) -> bool {
        self.courses().get(name).is_some_and(|course| course.wanted)
    }

    /// Where a mover stood over the time of a frame: asked for, and waited for. `None` where no look came in time.
    fn over(&self, name: &str, [from, to]: [Duration; 2], most: Duration) -> Option<Over> {
        let mut courses = self.courses();
        let Some(course) = courses.get_mut(name) else { return Some(Over::Lost) };
        course.wanted = true;
        self.news.notify_all();
        let unknown = |courses: &mut BTreeMap<String, Course>| {
            courses.get(name).is_some_and(|course| course.over(from, to).is_none())
        };
        let waited = self.news.wait_timeout_while(courses, most, unknown);
        let (courses, _) = waited.unwrap_or_else(PoisonError::into_inner);
        courses.get(name).map_or(Some(Over::Lost), |course| course.over(from, to))
    }

    /// Whether a camera is at work.
    fn is_needed(&self) -> bool {
        Arc::strong_count(&self.at_work) > 1
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
            self.stands.set(&self.plan.name, Stand::Lost, worker.clock.clock.now());
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
        let stand_of =
            |slot: Option<u32>| slot.map_or(Stand::Moving, |s| Stand::Filter(name_of(s)));
        let mut asked_at = worker.clock.clock.now();
        let first = wheel.look(&worker.within(SOON))?;
        self.hear(first.into_iter().map(stand_of).collect(), Some(asked_at), worker);
        worker.works();
        let mut over_at = None;
        loop {
            let now = worker.clock.clock.now();
            // The last frames are still to be told what stood before them.
            if worker.is_over() {
                let since = now.saturating_sub(*over_at.get_or_insert(now));
                if !self.stands.is_needed() || since > AFTER {
                    return Ok(());
                }
            }
            let asks =
                self.stands.is_wanted(&self.plan.name) || now.saturating_sub(asked_at) >= ASK;
            let soon = match over_at {
                None => worker.within(SOON),
                Some(_) => worker.even_so(SOON),
            };
            let stood = match asks {
                true => {
                    asked_at = now;
                    wheel.look(&soon)?
                }
                false => wheel.heard(&soon)?,
            };
            let stood = stood.into_iter().map(stand_of).collect();
            self.hear(stood, asks.then_some(now), worker);
            let at = match self.stands.get(&self.plan.name) {
                Some((Stand::Filter(name), _)) => Some(name),
                _ => None,
            };
            // While somebody else turns it, it is left to that.
            let wanted = self.wanted(worker).filter(|_| over_at.is_none() && at.is_some());
            if let Some(wanted) = wanted.filter(|wanted| at.as_ref() != Some(wanted)) {
                let at = name_of(self.go(wheel.as_mut(), &wanted, &names, worker)?);
                if at != wanted {
                    let got = format!("{at} is in the beam");
                    let (device, name) = ("filter wheel", "filter");
                    return Err(DeviceError::NotTaken { device, name, asked: wanted, got });
                }
                let now = worker.clock.clock.now();
                self.stands.set(&self.plan.name, Stand::Filter(at), now);
            }
            self.stands.wait(&self.plan.name, LOOK);
        }
    }

    /// Takes what the wheel has said.
    fn hear(&self, stood: Vec<Stand>, began: Option<Duration>, worker: &Worker) {
        self.stands.said(&self.plan.name, stood, began, worker.clock.clock.now());
    }

    /// The filter that the cameras behind it want now.
    fn wanted(&self, worker: &Worker) -> Option<String> {
        let (schedule, utc) = (worker.schedule.for_movers(), worker.clock.utc());
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
        self.stands.set(&self.plan.name, Stand::Moving, worker.clock.clock.now());
        let stands = wheel.select(slot, &worker.within(TURN)).map_err(|failed| *failed.error)?;
        set(&self.plan.name, "filter", wanted.into(), worker);
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
            self.stands.set(&self.plan.name, Stand::Lost, worker.clock.clock.now());
        }
        done
    }

    fn turn(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut stage = worker.opener.rotator(&self.plan, &worker.within(READY))?;
        worker.opened(stage.as_mut())?;
        let mut asked_at = worker.clock.clock.now();
        let mut at_deg = stage.angle_deg(&worker.within(SOON))?;
        self.stands.set(&self.plan.name, Stand::Angle(at_deg), worker.clock.clock.now());
        worker.works();
        while !worker.is_over() {
            let now = worker.clock.clock.now();
            if now.saturating_sub(asked_at) >= ASK {
                asked_at = now;
                at_deg = stage.angle_deg(&worker.within(SOON))?;
                self.stands.set(&self.plan.name, Stand::Angle(at_deg), worker.clock.clock.now());
            }
            if let Some(wanted) = wanted_deg(worker).filter(|w| apart_deg(*w, at_deg) > OFF_DEG) {
                at_deg = self.go(stage.as_mut(), wanted, worker)?;
                if apart_deg(wanted, at_deg) > OFF_DEG {
                    let (device, name) = ("rotator", "angle");
                    let (asked, got) = (format!("{wanted}°"), format!("it stands at {at_deg}°"));
                    return Err(DeviceError::NotTaken { device, name, asked, got });
                }
                self.stands.set(&self.plan.name, Stand::Angle(at_deg), worker.clock.clock.now());
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
        self.stands.set(&self.plan.name, Stand::Moving, worker.clock.clock.now());
        let moved = stage.move_to(wanted_deg, &worker.within(TURN));
        let at_deg = moved.map_err(|failed| *failed.error)?;
        set(&self.plan.name, "angle_deg", at_deg.into(), worker);
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
    /// The wheel is looked at for as long as this is held.
    _at_work: Arc<()>,
}

/// Filter of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameFilter {
    /// There is no wheel.
    NoWheel,
    /// It stood in the beam from the frame's begin to its end.
    Stood(String),
    /// The wheel moved, or may have.
    Moved,
    /// The wheel is lost.
    Lost,
    /// Nobody saw the wheel after the frame; where it stood last.
    Doubted(Option<String>),
}

impl Before {
    /// A camera behind these.
    pub fn new(wheel: Option<String>, rotators: Vec<String>, stands: Arc<Stands>) -> Self {
        let at_work = stands.at_work.clone();
        Self { wheel, rotators, stands, _at_work: at_work }
    }

    /// The filter that a frame was taken through, once the wheel was looked at later than it.
    pub fn filter_over(&self, span: [Duration; 2]) -> FrameFilter {
        let Some(wheel) = &self.wheel else { return FrameFilter::NoWheel };
        match self.stands.over(wheel, span, WAIT) {
            Some(Over::Stood(Stand::Filter(name))) => FrameFilter::Stood(name),
            Some(Over::Moved) => FrameFilter::Moved,
            Some(Over::Stood(_) | Over::Lost) => FrameFilter::Lost,
            None => FrameFilter::Doubted(match self.stands.get(wheel) {
                Some((Stand::Filter(name), _)) => Some(name),
                _ => None,
            }),
        }
    }

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

    /// How often any of the rotators has moved.
    pub fn turns(&self) -> u64 {
        let all = self.rotators.iter();
        all.filter_map(|name| self.stands.get(name)).map(|(_, moves)| moves).sum()
    }

    /// The angle of the first rotator, degrees.
    pub fn angle_deg(&self) -> Option<f64> {
        match self.stands.get(self.rotators.first()?)?.0 {
            Stand::Angle(deg) => Some(deg),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    fn filter(name: &str) -> Stand {
        Stand::Filter(name.into())
    }

    /// A wheel that is looked at each two seconds, and that somebody else turns between two looks. Truth: by hand: what was seen at 2 s and otherwise at 4 s may have happened at any time between; a frame
    /// is known only once the wheel was looked at later than it; a turn that the wheel tells itself lies after the last look.
    #[test]
    fn a_frame_has_the_filter_that_was_seen_before_and_after_it() {
        let stands = Stands::default();
        let over = |from: f64, to: f64| stands.over("wheel", [s(from), s(to)], Duration::ZERO);
        assert_eq!(over(0.0, 1.0), Some(Over::Lost));
        let opened = Stands::default();
        opened.said("wheel", vec![filter("B")], Some(s(1.0)), s(1.01));
        assert_eq!(opened.over("wheel", [s(0.5), s(1.0)], Duration::ZERO), Some(Over::Lost));
        stands.said("wheel", vec![filter("B")], Some(s(0.0)), s(0.01));
        stands.said("wheel", vec![filter("B")], Some(s(2.0)), s(2.01));
        assert_eq!(over(0.5, 1.5), Some(Over::Stood(filter("B"))));
        assert_eq!(over(1.5, 2.5), None);
        assert!(stands.is_wanted("wheel"));
        stands.said("wheel", vec![filter("V")], Some(s(4.0)), s(4.01));
        assert_eq!(over(0.5, 1.5), Some(Over::Stood(filter("B"))));
        assert_eq!(over(1.5, 2.5), Some(Over::Moved));
        assert_eq!(over(3.0, 3.9), Some(Over::Moved));
        // It tells that it turned away and back while a frame was taken; the count of changes alone would be enough, the filter would not.
        stands.said("wheel", vec![filter("V")], Some(s(6.0)), s(6.01));
        stands.said(
            "wheel",
            vec![Stand::Moving, filter("B"), Stand::Moving, filter("V")],
            None,
            s(6.5),
        );
        stands.said("wheel", vec![filter("V")], Some(s(7.0)), s(7.01));
        assert_eq!(over(6.2, 6.8), Some(Over::Moved));
        assert_eq!(over(6.6, 6.9), Some(Over::Stood(filter("V"))));
        // Our own turn, later than a frame, takes nothing from it.
        stands.set("wheel", Stand::Moving, s(7.2));
        assert_eq!(over(6.6, 6.9), Some(Over::Stood(filter("V"))));
        assert_eq!(over(7.1, 7.3), Some(Over::Moved));
        stands.set("wheel", Stand::Lost, s(8.0));
        assert_eq!(over(7.1, 7.3), Some(Over::Lost));
    }
}
