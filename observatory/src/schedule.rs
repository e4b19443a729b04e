//! Where the telescope looks, as a function of time: nothing waits for it.

use super::plan::CameraPlan;
use super::sequence::{Exposing, Step};
use hifitime::Epoch;
use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};
use std::sync::atomic::{self, AtomicBool};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use sunglint_formats::FileError;
use sunglint_formats::session::{Session, Target, TargetKind, What};
use sunglint_formats::toml::{Finite, Positive};

/// Time before a night or a visit from which on cameras take frames that rested until then, s.
const READY_S: f64 = 5.0;

/// A stay at a target, or none.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// The target.
    pub target: Target,
    /// When it begins.
    pub from: Epoch,
    /// When it ends; `None`: with the night.
    pub to: Option<Epoch>,
    /// How the instruments are set; `None`: as the plan's devices say.
    pub step: Option<Arc<Step>>,
    /// Whether its beginning, and its end, keep their time where what is before it ends early.
    pub keeps: [bool; 2],
}

impl Slot {
    /// A stay with the instruments as the plan's devices say. A pass keeps its time.
    pub fn new(target: Target, from: Epoch, to: Option<Epoch>) -> Self {
        let keeps = [target.target_kind == TargetKind::Satellite; 2];
        Self { target, from, to, step: None, keeps }
    }

    /// Whether the same visit had a step before this one.
    pub fn continues(&self) -> bool {
        self.step.as_ref().is_some_and(|step| step.continues)
    }
}

/// The targets of a night, in time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Schedule {
    slots: Vec<Slot>,
}

impl Schedule {
    /// The stays in time; between them, and behind the last, there is no target.
    pub fn new(visits: Vec<Slot>) -> Self {
        let mut slots: Vec<Slot> = Vec::new();
        for visit in visits {
            if let Some(gap) = slots.last().and_then(|last| last.to).filter(|to| *to < visit.from) {
                slots.push(nothing(gap, Some(visit.from)));
            }
            slots.push(visit);
        }
        if let Some(end) = slots.last().and_then(|last| last.to) {
            slots.push(nothing(end, None));
        }
        Self { slots }
    }

    /// The schedule of a session: what its log says.
    ///
    /// # Errors
    /// The errors of [`Session::events`].
    pub fn of_session(session: &Session) -> Result<Self, FileError> {
        let mut slots: Vec<Slot> = Vec::new();
        for event in session.events()? {
            let event = event?;
            if let What::Target(target) = event.what {
                if let Some(last) = slots.last_mut() {
                    last.to = Some(event.utc);
                }
                slots.push(Slot::new(target, event.utc, None));
            }
        }
        Ok(Self { slots })
    }

    /// The target at a time; none before the first.
    pub fn at(&self, utc: Epoch) -> Option<&Target> {
        self.slot(utc).map(|slot| &slot.target)
    }

    /// The slot at a time; none before the first.
    pub fn slot(&self, utc: Epoch) -> Option<&Slot> {
        self.slots[..self.begun(utc)].last()
    }

    /// How many slots have begun at a time.
    fn begun(&self, utc: Epoch) -> usize {
        self.slots.partition_point(|slot| slot.from.cmp(&utc) != Ordering::Greater)
    }

    /// The slot by which the instruments are set at a time: between two visits that of the next one.
    pub fn setting(&self, utc: Epoch) -> Option<&Slot> {
        let begun = self.begun(utc);
        let now = self.slots[..begun].last();
        if now.is_some_and(|slot| slot.target.target_kind != TargetKind::None) {
            return now;
        }
        self.slots[begun..].iter().find(|slot| slot.target.target_kind != TargetKind::None)
    }

    /// Until when a camera has nothing to do at a time: shortly before the night begins, and, if it rests between visits, shortly before the next one. `None` within a visit, and where none
    /// is to come.
    pub(crate) fn idle_to(
        &self,
        utc: Epoch,
        night: Option<Epoch>,
        rests_between_visits: bool,
    ) -> Option<Epoch> {
        let next = self.setting(utc).filter(|_| rests_between_visits).map(|next| next.from);
        let ready = hifitime::Duration::from_seconds(READY_S);
        let idle_to = [night, next].into_iter().flatten().map(|begin| begin - ready);
        idle_to.max().filter(|idle_to| utc < *idle_to)
    }

    /// How a camera takes frames at a time. Between two visits it is set as for the next one, and takes frames of no number.
    pub fn exposing(&self, camera: &CameraPlan, utc: Epoch) -> Exposing {
        let now = self.slot(utc);
        let setting = self.setting(utc);
        let step = setting.and_then(|slot| slot.step.as_deref());
        let mut exposing = Exposing::of(camera, now.map(|slot| slot.target.target_kind), step);
        if now != setting {
            (exposing.frames, exposing.level_adu) = (None, None);
        }
        exposing
    }

    /// The visits: each with its steps as one stay.
    pub fn visits(&self) -> Vec<Slot> {
        let mut visits: Vec<Slot> = Vec::new();
        for slot in self.slots.iter().filter(|s| s.target.target_kind != TargetKind::None) {
            match visits.last_mut() {
                Some(last) if slot.continues() => last.to = slot.to,
                _ => visits.push(Slot { step: None, ..slot.clone() }),
            }
        }
        visits
    }

    /// Whether any visit has several steps or settings of its own.
    pub fn has_sequences(&self) -> bool {
        let own = |step: &Step| {
            let Step { number, standard_magnitude, .. } = *step;
            let plain = Step { number, standard_magnitude, ..Step::default() };
            *step != plain
        };
        self.slots.iter().any(|slot| slot.step.as_deref().is_some_and(own))
    }

    /// Whether the last visit has ended.
    pub(crate) fn is_over(&self, utc: Epoch) -> bool {
        let last = self.slots.last();
        last.is_some_and(|slot| slot.target.target_kind == TargetKind::None && slot.from <= utc)
    }

    /// The slots, in time.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The slots that begin before a time, the last of them cut off there.
    fn until(&self, utc: Epoch) -> Vec<Slot> {
        let count = self.slots.partition_point(|slot| slot.from < utc);
        let mut slots = self.slots[..count].to_vec();
        if let Some(last) = slots.last_mut().filter(|last| last.to.is_none_or(|to| to > utc)) {
            last.to = Some(utc);
        }
        slots
    }

    /// The slots from a time on; one that it lies in begins there.
    fn after(&self, utc: Epoch) -> Vec<Slot> {
        let rest = self.slots.iter().filter(|slot| slot.to.is_none_or(|to| to > utc));
        rest.map(|slot| Slot { from: slot.from.max(utc), ..slot.clone() }).collect()
    }

    /// The schedule with no target from a time on.
    pub(crate) fn paused(&self, utc: Epoch) -> Self {
        let mut slots = self.until(utc);
        slots.push(nothing(utc, None));
        Self { slots }
    }

    /// A paused schedule that goes on, from a time, as the plan stands then.
    pub(crate) fn resumed(&self, plan: &Self, utc: Epoch) -> Self {
        let mut slots = self.until(utc);
        slots.extend(plan.after(utc));
        Self { slots }
    }

    /// The schedule as a night that was cut off had come to it: so many seconds after its plan, the step that was told last had begun.
    pub(crate) fn gone_on(&self, begun: Epoch, number: u32) -> Self {
        let is_it = |slot: &Slot| slot.step.as_ref().is_some_and(|step| step.number == number);
        let Some(place) = self.slots.iter().position(is_it) else { return self.clone() };
        // Only an early end of the step before moves a step: never later than planned.
        if self.slots[place].from <= begun {
            return self.clone();
        }
        let mut slots = self.until(begun);
        slots.extend(forward(self.slots[place..].to_vec(), begun));
        // What was skipped lies before.
        let of_it = slots.iter().position(is_it).unwrap_or(0);
        for before in &mut slots[..of_it] {
            before.to = before.to.map(|to| to.min(begun));
        }
        Self { slots }
    }

    /// The schedule without the rest of the present visit: the next begins at once, unless it is a satellite's, which keeps its time. `None` where no visit is
    /// under way.
    pub(crate) fn skipped(&self, utc: Epoch) -> Option<Self> {
        let next = self.slots[self.begun(utc)..].iter().position(|slot| !slot.continues());
        self.without(utc, next.unwrap_or(self.slots.len() - self.begun(utc)))
    }

    /// The schedule with the present visit, or else the last one that was, once more from a time on, whole. Stars, dark frames and flats that follow come later,
    /// one after the other; passes keep their time and cut off what is before them, and what finds no time between them is left out.
    ///
    /// # Errors
    /// In words: there was no visit, or it is a satellite's.
    pub(crate) fn repeated(&self, utc: Epoch) -> Result<Self, &'static str> {
        let begun = &self.slots[..self.begun(utc)];
        let is_visit = |slot: &Slot| slot.target.target_kind != TargetKind::None;
        let last = begun.iter().rposition(is_visit).ok_or("there was no visit yet")?;
        if self.slots[last].target.target_kind == TargetKind::Satellite {
            return Err("a satellite's pass cannot be repeated: it is over when it is over");
        }
        let first =
            self.slots[..=last].iter().rposition(|slot| is_visit(slot) && !slot.continues());
        let first = first.unwrap_or(last);
        // Steps after the present one belong to it, too.
        let rest = &self.slots[last + 1..];
        let own = rest.iter().take_while(|slot| is_visit(slot) && slot.continues()).count();
        let mut queue: Vec<Slot> =
            self.slots[first..=last + own].iter().filter(|slot| is_visit(slot)).cloned().collect();
        queue[0].step =
            queue[0].step.take().map(|step| Arc::new(Step { continues: false, ..(*step).clone() }));
        // Steps count as finished by their number.
        let numbers = self.slots.iter().filter_map(|slot| slot.step.as_ref().map(|s| s.number));
        let mut number = numbers.max().unwrap_or(0);
        for slot in &mut queue {
            slot.step = slot.step.take().map(|step| {
                number += 1;
                Arc::new(Step { number, ..(*step).clone() })
            });
        }
        queue.extend(rest[own..].iter().filter(|slot| is_visit(slot)).cloned());
        let mut visits = self.until(utc);
        visits.retain(is_visit);
        let mut now = utc;
        for at in 0..queue.len() {
            let mut slot = queue[at].clone();
            if slot.target.target_kind != TargetKind::Satellite {
                let pass =
                    queue[at..].iter().find(|s| s.target.target_kind == TargetKind::Satellite);
                let length = slot.to.map(|to| to - slot.from);
                slot.from = if at == 0 { now } else { slot.from.max(now) };
                let to = length.map(|length| slot.from + length);
                slot.to = [to, pass.map(|pass| pass.from)].into_iter().flatten().min();
                if slot.to.is_some_and(|to| to <= slot.from) {
                    continue;
                }
            }
            now = slot.to.unwrap_or(now).max(now);
            visits.push(slot);
        }
        Ok(Self::new(visits))
    }

    /// The schedule without the rest of the present step: the visit goes on with its next one, or is over.
    pub(crate) fn stepped(&self, utc: Epoch) -> Option<Self> {
        self.without(utc, 0)
    }

    /// The schedule without the rest of the present slot and so many after it.
    fn without(&self, utc: Epoch, more: usize) -> Option<Self> {
        let at = self.begun(utc).checked_sub(1)?;
        if self.slots[at].target.target_kind == TargetKind::None {
            return None;
        }
        let mut slots = self.until(utc);
        slots.extend(forward(self.slots[at + 1 + more..].to_vec(), utc));
        Some(Self { slots })
    }
}

/// Slots that come forward to a time, one after the other, each with its own length, up to one that keeps its time.
fn forward(mut later: Vec<Slot>, utc: Epoch) -> Vec<Slot> {
    let mut now = utc;
    for at in 0..later.len() {
        let slot = &mut later[at];
        let [begins, ends] = slot.keeps;
        if begins {
            // It is waited for.
            let gap = nothing(now, Some(slot.from));
            if gap.from < slot.from {
                later.insert(at, gap);
            }
            return later;
        }
        let length = slot.to.map(|to| to - slot.from);
        slot.from = now;
        // Nothing lasts until what comes next.
        match length.filter(|_| !ends && slot.target.target_kind != TargetKind::None) {
            Some(length) => now += length,
            None => return later,
        }
        slot.to = Some(now);
    }
    later.push(nothing(now, None));
    later
}

fn nothing(from: Epoch, to: Option<Epoch>) -> Slot {
    Slot::new(Target::off(TargetKind::None), from, to)
}

/// Exposure and gain that a person wished for the next frames of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraWish {
    /// Exposure, s; `None`: as planned.
    pub exposure_s: Option<Positive>,
    /// Gain in the camera's own steps; `None`: as planned.
    pub gain: Option<Finite>,
}

impl CameraWish {
    /// Changes how a camera takes frames of the sky; dark frames, bias frames and flats stay as they are.
    pub(crate) fn over(self, exposing: &mut Exposing) {
        if exposing.frame_type != "light" {
            return;
        }
        let plan = &mut exposing.plan;
        plan.exposure_s = self.exposure_s.unwrap_or(plan.exposure_s);
        plan.gain = self.gain.or(plan.gain);
        // From start to start is at least the exposure.
        plan.interval_s = plan.interval_s.map(|interval| match interval < plan.exposure_s {
            true => plan.exposure_s,
            false => interval,
        });
    }
}

/// A schedule that is exchanged while the night runs. Who reads it takes the whole of it, and never waits for long: only a pointer changes.
#[derive(Debug)]
pub struct SharedSchedule {
    schedule: RwLock<Arc<Schedule>>,
    /// Cameras that have all frames of a step, each with the step's number.
    finished: Mutex<HashSet<(String, u32)>>,
    /// Exposure and gain of a camera's next frames of the sky, as a person wished.
    wishes: Mutex<HashMap<String, CameraWish>>,
    /// The run through the focus that a person asked for.
    focus: Mutex<Option<FocusOrder>>,
    /// Whether the night is over, because its last visit is.
    over: AtomicBool,
}

/// A run through the focus that a person asked for.
#[derive(Debug)]
struct FocusOrder {
    camera: String,
    /// The plan that it interrupts: the mount goes on to follow it.
    plan: Arc<Schedule>,
    /// Whether the camera is at it.
    begun: bool,
    /// Whether the camera has ended.
    done: bool,
    /// Whether the person wants no more of it.
    cancelled: bool,
}

impl SharedSchedule {
    /// Shares a schedule.
    pub fn new(schedule: Schedule) -> Self {
        let schedule = RwLock::new(Arc::new(schedule));
        Self {
            schedule,
            finished: Mutex::default(),
            wishes: Mutex::default(),
            focus: Mutex::default(),
            over: AtomicBool::new(false),
        }
    }

    /// Ends the night for all who look.
    pub fn end(&self) {
        self.over.store(true, atomic::Ordering::SeqCst);
    }

    /// Whether it was ended.
    pub fn is_over(&self) -> bool {
        self.over.load(atomic::Ordering::SeqCst)
    }

    /// A camera has all frames of a step.
    pub fn finish(&self, camera: &str, step: u32) {
        let mut finished = self.finished.lock().unwrap_or_else(PoisonError::into_inner);
        finished.insert((camera.to_owned(), step));
    }

    /// Whether a camera has all frames of a step.
    pub fn has_finished(&self, camera: &str, step: u32) -> bool {
        let finished = self.finished.lock().unwrap_or_else(PoisonError::into_inner);
        finished.contains(&(camera.to_owned(), step))
    }

    /// Takes a wish for a camera's next frames of the sky; an empty one: as planned.
    pub fn wish(&self, camera: &str, wish: CameraWish) {
        let mut wishes = self.wishes.lock().unwrap_or_else(PoisonError::into_inner);
        wishes.insert(camera.to_owned(), wish);
    }

    /// The wish for a camera.
    pub fn wished(&self, camera: &str) -> CameraWish {
        let wishes = self.wishes.lock().unwrap_or_else(PoisonError::into_inner);
        wishes.get(camera).copied().unwrap_or_default()
    }

    fn focus(&self) -> MutexGuard<'_, Option<FocusOrder>> {
        self.focus.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks a camera to go through its focus, while the mount follows this plan; false where one is at it.
    pub fn ask_focus(&self, camera: &str, plan: Arc<Schedule>) -> bool {
        let mut focus = self.focus();
        if focus.is_some() {
            return false;
        }
        let (begun, done, cancelled) = (false, false, false);
        *focus = Some(FocusOrder { camera: camera.into(), plan, begun, done, cancelled });
        true
    }

    /// Takes the order for a camera, once: the plan that it interrupts.
    pub fn takes_focus(&self, camera: &str) -> Option<Arc<Schedule>> {
        let mut focus = self.focus();
        let order = focus.as_mut().filter(|order| order.camera == camera && !order.begun)?;
        order.begun = true;
        Some(order.plan.clone())
    }

    /// The camera has ended its run. The order stands until the night goes on, so that the mount never sees the pause.
    pub fn focus_done(&self) {
        if let Some(order) = &mut *self.focus() {
            order.done = true;
        }
    }

    /// State of the order: the camera, whether it has begun, whether it has ended.
    pub fn focus_state(&self) -> Option<(String, bool, bool)> {
        self.focus().as_ref().map(|order| (order.camera.clone(), order.begun, order.done))
    }

    /// The person wants no more of it: one that has not begun is forgotten.
    pub fn cancel_focus(&self) {
        let mut focus = self.focus();
        match &mut *focus {
            Some(order) if order.begun => order.cancelled = true,
            _ => *focus = None,
        }
    }

    /// Whether a run that has begun should go on.
    pub fn focus_goes_on(&self) -> bool {
        self.focus().as_ref().is_some_and(|order| !order.cancelled)
    }

    /// The run is over.
    pub fn end_focus(&self) {
        *self.focus() = None;
    }

    /// Whether a run was asked for that is not over.
    pub fn is_focusing(&self) -> bool {
        self.focus().is_some()
    }

    /// The schedule for mount, wheels and rotators: during a run through the focus, for which the night is paused, the plan as it stood before.
    pub fn for_movers(&self) -> Arc<Schedule> {
        let before = self.focus().as_ref().map(|order| order.plan.clone());
        before.unwrap_or_else(|| self.get())
    }

    /// The schedule as it stands.
    pub fn get(&self) -> Arc<Schedule> {
        self.schedule.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Exchanges it.
    pub fn set(&self, schedule: Schedule) {
        *self.schedule.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(schedule);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::time::parse_utc;

    fn at(s: f64) -> Epoch {
        parse_utc("2026-11-21T18:00:00Z").unwrap() + hifitime::Duration::from_seconds(s)
    }

    fn visit(name: &str, kind: TargetKind, from: f64, to: f64) -> Slot {
        let target = Target { name: name.into(), on: true, ..Target::off(kind) };
        Slot::new(target, at(from), Some(at(to)))
    }

    fn told(schedule: &Schedule) -> Vec<(String, f64)> {
        let one = |slot: &Slot| (slot.target.name.clone(), (slot.from - at(0.0)).to_seconds());
        schedule.slots().iter().map(one).collect()
    }

    /// Truth: by hand: what follows comes forward with its own length, 5 s, until a visit that the plan gives a time (300 s); those after it stay, too. A visit whose end has a time begins early and ends then. Steps of a
    /// pass follow each other, and its end stays. A resumed night stands as the one before it.
    #[test]
    fn visits_come_forward_with_their_own_length() {
        let keeps = |keeps: [bool; 2], slot: Slot| Slot { keeps, ..slot };
        let star = |name: &str, from: f64, to: f64| visit(name, TargetKind::Star, from, to);
        let numbered = |number: u32, continues: bool, slot: Slot| {
            let step = Some(Arc::new(Step { number, continues, ..Step::default() }));
            Slot { step, ..slot }
        };
        let times = |schedule: &Schedule| {
            let s = |epoch: Epoch| (epoch - at(0.0)).to_seconds();
            let one = |slot: &Slot| (s(slot.from), slot.to.map(s));
            schedule.slots().iter().map(one).collect::<Vec<_>>()
        };
        let plan = Schedule::new(vec![
            numbered(1, false, star("Vega", 0.0, 100.0)),
            numbered(2, false, star("Deneb", 100.0, 105.0)),
            numbered(3, false, star("Altair", 105.0, 110.0)),
            keeps([true, false], star("Mizar", 300.0, 350.0)),
            star("Alcor", 350.0, 400.0),
        ]);
        let after = [(25.0, Some(30.0)), (30.0, Some(300.0)), (300.0, Some(350.0))];
        let tail = [(350.0, Some(400.0)), (400.0, None)];
        let begin = [(0.0, Some(20.0)), (20.0, Some(25.0))];
        let early = plan.stepped(at(20.0)).unwrap();
        assert_eq!(times(&early), [&begin[..], &after, &tail].concat());
        assert_eq!(times(&plan.gone_on(at(20.0), 2)), [&begin[..], &after, &tail].concat());
        let until = Schedule::new(vec![
            star("Vega", 0.0, 100.0),
            keeps([false, true], star("Deneb", 100.0, 150.0)),
            star("Altair", 150.0, 160.0),
        ]);
        let early = times(&until.stepped(at(20.0)).unwrap());
        let expected =
            [(0.0, Some(20.0)), (20.0, Some(150.0)), (150.0, Some(160.0)), (160.0, None)];
        assert_eq!(early, expected);
        let step = |from: f64, to: f64| visit("ISS", TargetKind::Satellite, from, to);
        let pass = Schedule::new(vec![
            numbered(1, false, step(0.0, 50.0)),
            keeps([false, true], numbered(2, true, step(50.0, 100.0))),
        ]);
        let early = times(&pass.stepped(at(20.0)).unwrap());
        assert_eq!(early, [(0.0, Some(20.0)), (20.0, Some(100.0)), (100.0, None)]);
    }

    /// Truth: by hand: the times of each target after a pause, its end, and skips before a star and before a satellite.
    #[test]
    fn a_night_is_steered() {
        let plan = Schedule::new(vec![
            visit("Vega", TargetKind::Star, 0.0, 100.0),
            visit("Deneb", TargetKind::Star, 100.0, 200.0),
            visit("ISS", TargetKind::Satellite, 250.0, 300.0),
        ]);
        let expect = |schedule: &Schedule, expected: &[(&str, f64)]| {
            let expected: Vec<_> = expected.iter().map(|(n, s)| ((*n).to_owned(), *s)).collect();
            assert_eq!(told(schedule), expected);
        };
        let paused = plan.paused(at(50.0));
        expect(&paused, &[("Vega", 0.0), ("none", 50.0)]);
        assert_eq!(paused.at(at(1e6)).unwrap().target_kind, TargetKind::None);
        let went_on = paused.resumed(&plan, at(130.0));
        let after = [("Deneb", 130.0), ("none", 200.0), ("ISS", 250.0), ("none", 300.0)];
        expect(&went_on, &[&[("Vega", 0.0), ("none", 50.0)][..], &after].concat());
        // Deneb is as long as it was.
        let skipped = plan.skipped(at(40.0)).unwrap();
        let after = [("Deneb", 40.0), ("none", 140.0), ("ISS", 250.0), ("none", 300.0)];
        expect(&skipped, &[&[("Vega", 0.0)][..], &after].concat());
        let skipped = skipped.skipped(at(60.0)).unwrap();
        expect(
            &skipped,
            &[("Vega", 0.0), ("Deneb", 40.0), ("none", 60.0), ("ISS", 250.0), ("none", 300.0)],
        );
        assert_eq!(skipped.skipped(at(70.0)), None);
        // Once more: Vega is as long as it was, Deneb comes later and is cut off by the pass, which keeps its time.
        let again = plan.repeated(at(90.0)).unwrap();
        let rest = [("Vega", 90.0), ("Deneb", 190.0), ("ISS", 250.0), ("none", 300.0)];
        expect(&again, &[&[("Vega", 0.0)][..], &rest].concat());
        assert_eq!(again.slots()[2].to, Some(at(250.0)));
        // In the gap after a visit it is that one; Deneb finds its whole time no more.
        let late = plan.repeated(at(210.0)).unwrap();
        let rest = [("Deneb", 210.0), ("ISS", 250.0), ("none", 300.0)];
        expect(&late, &[&[("Vega", 0.0), ("Deneb", 100.0), ("none", 200.0)][..], &rest].concat());
        assert!(plan.repeated(at(260.0)).is_err() && plan.repeated(at(-1.0)).is_err());
        // A pass that follows directly keeps its time.
        let close = Schedule::new(vec![
            visit("Vega", TargetKind::Star, 0.0, 100.0),
            visit("ISS", TargetKind::Satellite, 100.0, 300.0),
        ]);
        expect(
            &close.skipped(at(10.0)).unwrap(),
            &[("Vega", 0.0), ("none", 10.0), ("ISS", 100.0), ("none", 300.0)],
        );
    }
    /// Truth: by hand: while a camera focuses the night is paused, and the mount has the plan of before; one order at a time, taken once, by its camera; one that was not taken is forgotten when it is cancelled.
    #[test]
    fn a_mount_follows_the_plan_while_a_camera_focuses() {
        let from = hifitime::Epoch::from_mjd_utc(60_000.0);
        let target = Target { name: "Vega".into(), on: true, ..Target::off(TargetKind::Star) };
        let plan = Schedule::new(vec![Slot::new(target, from, None)]);
        let shared = SharedSchedule::new(plan);
        let before = shared.get();
        shared.set(before.paused(from + hifitime::Duration::from_seconds(5.0)));
        assert!(Arc::ptr_eq(&shared.for_movers(), &shared.get()));
        assert!(
            shared.ask_focus("cam", before.clone()) && !shared.ask_focus("cam", before.clone())
        );
        assert!(Arc::ptr_eq(&shared.for_movers(), &before) && !Arc::ptr_eq(&shared.get(), &before));
        assert!(
            shared.takes_focus("other").is_none()
                && shared.takes_focus("cam").is_some()
                && shared.takes_focus("cam").is_none()
        );
        assert!(shared.focus_goes_on());
        shared.cancel_focus();
        assert!(shared.is_focusing() && !shared.focus_goes_on());
        shared.end_focus();
        assert!(Arc::ptr_eq(&shared.for_movers(), &shared.get()));
        assert!(shared.ask_focus("cam", before));
        shared.cancel_focus();
        assert!(!shared.is_focusing());
    }
}
