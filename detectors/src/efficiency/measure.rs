//! The run itself: where the monochromator goes, what photodiode and sensor say there.

use super::line::{Line, Part, What};
use super::plan::{DarkBy, Measuring};
use super::visits::{RESUMED, Visit, dark, reference};
use crate::reading::{Pace, Photodiode, RunError};
use std::collections::HashSet;
use sunglint_drivers::device::{FilterWheel, InBeam, Monochromator, PhotonCounter};
use sunglint_materials::log::{self, Record};
use sunglint_materials::reading::State;
use sunglint_materials::retro::measure::Hands;

/// The devices of a run, their clock, and what stops them.
pub struct Rig<'a> {
    /// The monochromator.
    pub monochromator: &'a mut dyn Monochromator,
    /// The photodiode's meter.
    pub photodiode: Photodiode<'a>,
    /// The sensor's counter.
    pub counter: &'a mut dyn PhotonCounter,
    /// The filter wheel.
    pub wheel: Option<&'a mut dyn FilterWheel>,
    /// Who opens and closes the shutter.
    pub hands: &'a mut dyn Hands,
    /// Clock, and what stops it.
    pub pace: Pace,
}

/// The places that are safe: part and number.
#[must_use]
pub fn done(lines: &[Line]) -> HashSet<(Part, u32)> {
    let kept = lines.iter().filter(|line| line.state == State::Kept);
    kept.map(|line| (line.part, line.number)).collect()
}

/// Measures those of the places that are not in `before` yet, in their order; a run that goes on after wavelengths were begun reads the dark and the reference first.
/// `zero_s` is when the run's first line was, on the rig's clock (below 0 where that was before it began).
///
/// # Errors
/// Why it cannot go on; what was read until then is in the record.
pub fn measure(
    rig: &mut Rig,
    plan: &Measuring,
    visits: &[Visit],
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let result = all(rig, plan, visits, before, zero_s, record);
    log::end(record, result)
}

fn all(
    rig: &mut Rig,
    plan: &Measuring,
    visits: &[Visit],
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let done = done(before);
    let left: Vec<Visit> =
        visits.iter().filter(|v| !done.contains(&(v.part, v.number))).copied().collect();
    // Readings that were broken off do not mix with those that follow.
    if let Some(last) = before.last().filter(|line| line.state.is_reading()) {
        let time_s = rig.pace.now_s() - zero_s;
        let (what, value, state) = (What::Word, f64::NAN, State::Again);
        record.line(&Line { time_s, what, value, state, exposure_s: f64::NAN, ..last.clone() })?;
    }
    let mut run =
        Run { rig, plan, zero_s, record, nm: None, stands_nm: None, slot: None, is_closed: None };
    let begun = done.iter().any(|(part, _)| *part == Part::Step);
    if begun && !left.is_empty() {
        let next = |of: Part| {
            let numbers = done.iter().filter(|(part, n)| *part == of && *n >= RESUMED);
            numbers.map(|(_, n)| *n).max().map_or(RESUMED, |last| last + 1)
        };
        let (darks, references) = (next(Part::Dark), next(Part::Reference));
        run.visit(&dark(plan, darks))?;
        if let Some(at) = plan.reference {
            run.visit(&reference(at, references))?;
        }
    }
    for visit in &left {
        run.visit(visit)?;
    }
    Ok(())
}

struct Run<'a, 'b> {
    rig: &'a mut Rig<'b>,
    plan: &'a Measuring,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    /// Where the monochromator was sent, and where it stands.
    nm: Option<f64>,
    stands_nm: Option<f64>,
    slot: Option<u32>,
    is_closed: Option<bool>,
}

impl Run<'_, '_> {
    fn visit(&mut self, visit: &Visit) -> Result<(), RunError> {
        let at = match (visit.part, visit.nm) {
            (Part::Dark, _) | (_, None) => format!("{} {}", visit.part.name(), visit.number),
            (_, Some(nm)) => format!("{} {} ({nm} nm)", visit.part.name(), visit.number),
        };
        self.prepare(visit, &at)?;
        let (repeats, exposure_s) = (self.plan.repeats, self.plan.exposure_s);
        self.photodiode(visit, 0, &at)?;
        for repeat in 0..repeats {
            let begin_s = self.rig.pace.now_s();
            let counts = {
                let Rig { counter, pace, .. } = &mut *self.rig;
                let record = &mut *self.record;
                let (channel, timeout_s) =
                    (self.plan.counter.channel, self.plan.counter.timeout_s.get());
                let counter = &mut **counter;
                let mut notes = |text: &str| record.event(text);
                pace.count(counter, channel, exposure_s, timeout_s, &at, &mut notes)?
            };
            // The last exposure, where others before it lost counts.
            let middle_s = (self.rig.pace.now_s() - 0.5 * exposure_s).max(begin_s);
            let line = Line {
                time_s: middle_s - self.zero_s,
                what: What::Counts,
                place: 2 * repeat + 1,
                value: counts as f64,
                exposure_s,
                state: State::Read,
                ..self.word(visit)
            };
            self.record.line(&line)?;
            self.photodiode(visit, 2 * repeat + 2, &at)?;
        }
        let kept = Line { state: State::Kept, ..self.word(visit) };
        self.record.line(&kept)?;
        Ok(self.record.sync()?)
    }

    fn word(&self, visit: &Visit) -> Line {
        Line {
            time_s: self.rig.pace.now_s() - self.zero_s,
            part: visit.part,
            number: visit.number,
            wavelength_nm: self.stands_nm.unwrap_or(0.0),
            slot: self.slot,
            what: What::Word,
            place: 0,
            value: f64::NAN,
            exposure_s: f64::NAN,
            state: State::Kept,
        }
    }

    fn photodiode(&mut self, visit: &Visit, place: u32, at: &str) -> Result<(), RunError> {
        for _ in 0..self.plan.meter.readings {
            let value = {
                let Rig { photodiode, pace, .. } = &mut *self.rig;
                let record = &mut *self.record;
                let limits = ("photodiode's meter", self.plan.meter.timeout_s.get());
                let mut notes = |text: &str| record.event(text);
                pace.ask(limits, at, &mut notes, |deadline| photodiode.read(deadline))?
            };
            let line = Line {
                what: What::Photodiode,
                place,
                value: value.unwrap_or(f64::NAN),
                state: if value.is_some() { State::Read } else { State::Over },
                ..self.word(visit)
            };
            self.record.line(&line)?;
        }
        Ok(())
    }

    /// Brings the rig to a place.
    fn prepare(&mut self, visit: &Visit, at: &str) -> Result<(), RunError> {
        let Rig { monochromator, photodiode, wheel, hands, pace, .. } = &mut *self.rig;
        let record = &mut *self.record;
        let mut notes = |text: &str| record.event(text);
        if self.plan.dark == DarkBy::Hand {
            let closed = visit.part == Part::Dark;
            if self.is_closed != Some(closed) {
                hands.put(if closed { InBeam::Blocked } else { InBeam::Through })?;
                self.is_closed = Some(closed);
            }
        }
        if let (Some(slot), Some(wheel), Some(plan)) = (visit.slot, wheel, &self.plan.wheel)
            && self.slot != Some(slot)
        {
            self.slot = None;
            pace.select(&mut **wheel, slot, plan.timeout_s.get(), at, &mut notes)?;
            self.slot = Some(slot);
            pace.wait(plan.settle_s.get(), at)?;
        }
        let plan = &self.plan.monochromator;
        let limits = (plan.tolerance_nm.get(), plan.timeout_s.get());
        match visit.nm {
            Some(nm) if self.nm != Some(nm) => {
                let approach_nm = plan.approach_nm.get();
                let falls = self.stands_nm.is_none_or(|stands| nm < stands);
                self.nm = None;
                if approach_nm > 0.0 && falls {
                    let below = nm - approach_nm;
                    pace.go_to(&mut **monochromator, below, limits, at, &mut notes)?;
                }
                let stands = pace.go_to(&mut **monochromator, nm, limits, at, &mut notes)?;
                (self.nm, self.stands_nm) = (Some(nm), Some(stands));
                if let (Photodiode::Power(meter), false) = (photodiode, visit.part == Part::Dark) {
                    let device = "photodiode's meter";
                    let wait = (device, self.plan.meter.timeout_s.get());
                    let set = pace.ask(wait, at, &mut notes, |deadline| {
                        meter.set_wavelength_nm(nm, deadline)
                    })?;
                    // It takes whole nanometres at the coarsest.
                    let is_set = (set - nm).abs() <= 1.0;
                    if !is_set {
                        let at = at.to_owned();
                        return Err(RunError::NotThere { at, device, stands: set, asked: nm });
                    }
                }
                pace.wait(plan.settle_s.get(), at)
            }
            None if self.stands_nm.is_none() => {
                let wait = ("monochromator", plan.timeout_s.get());
                let stands = pace
                    .ask(wait, at, &mut notes, |deadline| monochromator.wavelength_nm(deadline))?;
                self.stands_nm = Some(stands);
                Ok(())
            }
            _ => Ok(()),
        }
    }
}
