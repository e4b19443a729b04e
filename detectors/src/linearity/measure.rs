//! The run itself: sources, wheel, exposures.

use super::line::Line;
use super::plan::{LinearityPlan, Place, places};
use crate::reading::{Pace, RunError};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{FilterWheel, PhotonCounter, Source};
use sunglint_formats::toml::{NonNegative, Positive};
use sunglint_materials::log::{self, Record};

/// The devices of a run, their clock, and what stops them.
pub struct Rig<'a> {
    /// The counter.
    pub counter: &'a mut dyn PhotonCounter,
    /// The filter wheel.
    pub wheel: Option<&'a mut dyn FilterWheel>,
    /// Sources.
    pub sources: Vec<&'a mut dyn Source>,
    /// Clock, and what stops it.
    pub pace: Pace,
}

/// Wait after a change, and how long it may take, s, where the plan does not say.
const SETTLE_S: f64 = 0.5;
const TIMEOUT_S: f64 = 30.0;
/// How long switching the sources off at the end may take.
const STOP: Duration = Duration::from_secs(5);

/// Exposures of each place that are safe.
#[must_use]
pub fn done(lines: &[Line], places: usize) -> Vec<u32> {
    let mut done = vec![0; places];
    for line in lines {
        if let Some(count) = done.get_mut(line.number as usize) {
            *count += 1;
        }
    }
    done
}

/// Measures what is not in `before` yet: each place once, all places in turn, until each has its repeats. The sources are off when it returns.
///
/// # Errors
/// Why it cannot go on; what was read until then is in the record.
pub fn measure(
    rig: &mut Rig,
    plan: &LinearityPlan,
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let result = all(rig, plan, before, zero_s, record);
    for source in &mut rig.sources {
        let grace = Deadline::after(rig.pace.clock.clock.clone(), STOP);
        // Whatever is wrong with it is said by the result already.
        let _ = source.switch(false, &grace);
    }
    log::end(record, result)
}

fn all(
    rig: &mut Rig,
    plan: &LinearityPlan,
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let places = places(plan);
    let mut done = done(before, places.len());
    let mut now: Option<Vec<Option<usize>>> = None;
    let mut slot = None;
    for repeat in 0..plan.repeats {
        for (number, place) in places.iter().enumerate() {
            if done[number] > repeat {
                continue;
            }
            let at = format!("light {number}, repeat {}", repeat + 1);
            prepare(rig, plan, place, (&mut now, &mut slot), &at, record)?;
            let counts = {
                let mut notes = |text: &str| record.event(text);
                let (channel, timeout_s) = (plan.counter.channel, plan.counter.timeout_s.get());
                let pace = &rig.pace;
                pace.count(rig.counter, channel, plan.exposure_s, timeout_s, &at, &mut notes)?
            };
            let time_s = rig.pace.now_s() - zero_s;
            let number_text = number as u32;
            record.line(&Line {
                time_s,
                number: number_text,
                counts,
                exposure_s: plan.exposure_s,
            })?;
            record.sync()?;
            done[number] += 1;
        }
    }
    Ok(())
}

type Stand<'a> = (&'a mut Option<Vec<Option<usize>>>, &'a mut Option<u32>);

fn prepare(
    rig: &mut Rig,
    plan: &LinearityPlan,
    place: &Place,
    (now, slot): Stand,
    at: &str,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let pace = rig.pace.clone();
    let mut notes = |text: &str| record.event(text);
    let mut settle_s = 0.0_f64;
    if let (Some(asked), Some(wheel), Some(of)) = (place.slot, &mut rig.wheel, &plan.wheel)
        && *slot != Some(asked)
    {
        *slot = None;
        let timeout_s = of.timeout_s.map_or(TIMEOUT_S, Positive::get);
        pace.select(&mut **wheel, asked, timeout_s, at, &mut notes)?;
        *slot = Some(asked);
        settle_s = settle_s.max(of.settle_s.map_or(SETTLE_S, NonNegative::get));
    }
    if now.as_ref() != Some(&place.levels) {
        *now = None;
        for ((source, level), of) in rig.sources.iter_mut().zip(&place.levels).zip(&plan.sources) {
            let limits = ("source", of.timeout_s.map_or(TIMEOUT_S, Positive::get));
            if let Some(level) = level.and_then(|number| of.levels.get(number)) {
                let asked = level.get();
                let stands =
                    pace.ask(limits, at, &mut notes, |deadline| source.set_level(asked, deadline))?;
                // The level's own value does not count, only that it comes again.
                let is_set = (stands - asked).abs() <= 0.05 * asked;
                if !is_set {
                    let (at, device) = (at.to_owned(), "source");
                    return Err(RunError::NotThere { at, device, stands, asked });
                }
            }
            let on = level.is_some();
            let is_on = pace.ask(limits, at, &mut notes, |deadline| source.switch(on, deadline))?;
            if is_on != on {
                let (stands, asked) = (f64::from(u8::from(is_on)), f64::from(u8::from(on)));
                let (at, device) = (at.to_owned(), "source");
                return Err(RunError::NotThere { at, device, stands, asked });
            }
            settle_s = settle_s.max(of.settle_s.map_or(SETTLE_S, NonNegative::get));
        }
        *now = Some(place.levels.clone());
    }
    if settle_s > 0.0 { pace.wait(settle_s, at) } else { Ok(()) }
}
