//! The run itself: what is put into the beam, where the axes go, what the meter says there.

use super::bench::{AXES, Bench};
use super::line::{Line, seen};
use super::pose::Angles;
use super::tasks::{Part, RESUMED, Task};
use crate::axis::{self, Approach, AxisError};
use crate::log::{self, Record, RecordError};
use crate::reading::{Keep, ReadError, Reader, State, tell_wait};
use crate::retro::measure::{Hands, HandsError};
use crate::settling::Settling;
use std::collections::HashSet;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{DeviceError, InBeam, PowerMeter, RotationStage};

/// Why a run cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// Somebody stopped it.
    #[error("stopped at {part} {number}")]
    Stopped {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
    },
    /// The meter.
    #[error("at {part} {number}: {error}")]
    Meter {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
        /// Error that the meter reported, the last time.
        error: DeviceError,
    },
    /// An axis.
    #[error("at {part} {number}, the axis `{axis}`: {error}")]
    Axis {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
        /// Name of the axis.
        axis: &'static str,
        /// Error of the axis.
        error: Box<AxisError>,
    },
    /// An axis of the bench that was not opened.
    #[error("the axis `{axis}` was not opened")]
    NoAxis {
        /// Name of the axis.
        axis: &'static str,
    },
    /// Readings that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Nobody puts things into the beam.
    #[error(transparent)]
    Hands(#[from] HandsError),
}

/// The devices of a run, their clock, and what stops them.
pub struct Rig<'a> {
    /// Stages of the axes: sample, detector, azimuth, turn.
    pub stages: [Option<&'a mut dyn RotationStage>; 4],
    /// The meter.
    pub meter: &'a mut dyn PowerMeter,
    /// Who puts things into the beam.
    pub hands: &'a mut dyn Hands,
    /// The clock of all.
    pub clock: DeviceClock,
    /// Stops it.
    pub cancel: Cancel,
}

/// How long stopping the motors may take.
const STOP: Duration = Duration::from_secs(5);

/// The measurements that are safe: part and number.
#[must_use]
pub fn done(lines: &[Line]) -> HashSet<(Part, u32)> {
    let kept = lines.iter().filter(|line| line.state == State::Kept);
    kept.map(|line| (line.part, line.number)).collect()
}

/// Measures those of the tasks that are not in `before` yet, in their order. If directions were begun, the reference direction is read first. `zero_s` is when the
/// run's first line was, on the rig's clock (below 0 where that was before it began). The motors are stopped whatever happens.
///
/// # Errors
/// Why it cannot go on; what was read until then is in the record.
pub fn measure(
    rig: &mut Rig,
    bench: &Bench,
    tasks: &[Task],
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let result = all(rig, bench, tasks, before, zero_s, record);
    // Whatever is wrong with it is said by the result already.
    for stage in rig.stages.iter_mut().flatten() {
        let grace = Deadline::after(rig.clock.clock.clone(), STOP);
        let _ = stage.stop(&grace);
    }
    log::end(record, result)
}

fn all(
    rig: &mut Rig,
    bench: &Bench,
    tasks: &[Task],
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let done = done(before);
    let left: Vec<Task> =
        tasks.iter().filter(|task| !done.contains(&(task.part, task.number))).copied().collect();
    // Readings that were broken off do not mix with those that follow.
    if let Some(last) = before.last().filter(|line| line.state.is_reading()) {
        let time_s = rig.clock.clock.now().as_secs_f64() - zero_s;
        let torn = Line { time_s, power_w: f64::NAN, state: State::Again, ..last.clone() };
        record.line(&torn)?;
    }
    let reference = tasks.iter().find(|task| task.part == Part::Reference);
    let begun = done.iter().any(|(part, _)| *part == Part::Direction);
    let goes_on = left.first().is_some_and(|task| task.part == Part::Direction);
    let settle_s = bench.meter.settle_s.get();
    // A run that goes on looks at the reference first, long after the place before.
    let same_light = |a: &(Part, u32), b: &(Part, u32)| {
        a.0.place() == b.0.place() && !(b.0 == Part::Reference && b.1 >= RESUMED)
    };
    let mut run = Run {
        rig,
        bench,
        zero_s,
        record,
        asked: [None; 4],
        at: [None; 4],
        place: None,
        settling: Settling::of_run(seen(before), settle_s, same_light),
    };
    tell_wait(&run.settling, settle_s, |text| run.record.event(text))?;
    if let Some(reference) = reference.filter(|_| begun && goes_on) {
        let of = |(part, number): &(Part, u32)| {
            (*part == Part::Reference && *number >= RESUMED).then_some(*number)
        };
        let number = done.iter().filter_map(of).max().map_or(RESUMED, |last| last + 1);
        run.one(&Task { number, ..*reference })?;
    }
    for task in &left {
        run.one(task)?;
    }
    Ok(())
}

struct Run<'a, 'b> {
    rig: &'a mut Rig<'b>,
    bench: &'a Bench,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    asked: Angles,
    at: Angles,
    place: Option<InBeam>,
    settling: Settling,
}

impl Run<'_, '_> {
    fn one(&mut self, task: &Task) -> Result<(), RunError> {
        let place = task.part.place();
        // Nothing is in the detector's way while it travels through the beam's ends.
        self.turn(task)?;
        if self.place != Some(place) {
            self.rig.hands.put(place)?;
            self.settling.other_light();
            self.place = Some(place);
        }
        self.read(task)
    }

    fn turn(&mut self, task: &Task) -> Result<(), RunError> {
        let (part, number) = (task.part.name(), task.number);
        let axes = self.bench.all_axes();
        for (k, plan) in axes.iter().enumerate() {
            let (Some(asked), Some(plan)) = (task.stages[k], plan) else { continue };
            if self.asked[k] == Some(asked) {
                continue;
            }
            let approach = Approach {
                approach_deg: plan.approach_deg.get(),
                tolerance_deg: plan.tolerance_deg.get(),
            };
            let axis = AXES[k];
            let Some(stage) = self.rig.stages[k].as_deref_mut() else {
                return Err(RunError::NoAxis { axis });
            };
            let (clock, cancel) = (self.rig.clock.clone(), self.rig.cancel.clone());
            let time = Duration::from_secs_f64(plan.timeout_s.get());
            let deadline = || Deadline::after(clock.clock.clone(), time).with_cancel(&cancel);
            let turned = axis::turn(stage, self.at[k], asked, &approach, &deadline);
            let at = turned.map_err(|error| match error {
                AxisError::Stopped { .. } => RunError::Stopped { part, number },
                error => RunError::Axis { part, number, axis, error: error.into() },
            })?;
            (self.asked[k], self.at[k]) = (Some(asked), Some(at));
        }
        Ok(())
    }

    fn read(&mut self, task: &Task) -> Result<(), RunError> {
        let (part, number) = (task.part.name(), task.number);
        let Rig { meter, clock, cancel, .. } = &mut *self.rig;
        let plan = &self.bench.meter;
        let mut reader = Reader {
            meter: &mut **meter,
            clock,
            cancel,
            settle_s: plan.settle_s.get(),
            timeout_s: plan.timeout_s.get(),
            readings: self.bench.scan.readings,
            interval_s: self.bench.scan.interval_s.get(),
            settling: &mut self.settling,
        };
        let clock = reader.clock.clone();
        let mut at =
            At { clock, zero_s: self.zero_s, record: &mut *self.record, task, stages: self.at };
        reader.take(&format!("at {part} {number}"), &mut at).map_err(|error| match error {
            ReadError::Stopped => RunError::Stopped { part, number },
            ReadError::Meter(error) => RunError::Meter { part, number, error },
            ReadError::Record(error) => RunError::Record(error),
        })
    }
}

/// The keeper of the readings of a task.
struct At<'a> {
    clock: DeviceClock,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    task: &'a Task,
    stages: Angles,
}

impl Keep for At<'_> {
    fn reading(&mut self, power_w: f64, state: State, range: &str) -> Result<(), RecordError> {
        let time_s = self.clock.clock.now().as_secs_f64() - self.zero_s;
        let (part, number, stages) = (self.task.part, self.task.number, self.stages);
        let range = range.to_owned();
        self.record.line(&Line { time_s, part, number, stages, power_w, state, range })
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        self.record.sync()
    }

    fn event(&mut self, text: &str) -> Result<(), RecordError> {
        self.record.event(text)
    }
}
