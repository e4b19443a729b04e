//! The run itself: what is put into the beam, to which angles the stage goes, what the meter says there.
//!
//! Nothing is kept in memory alone: each reading goes to a [`Record`] as it comes, and is safe before the stage moves on.

use super::Measured;
use super::plan::Measuring;
use crate::axis::{self, Approach, AxisError};
use crate::log;
use crate::reading::{Keep, ReadError, Reader, Seen, kept, tell_wait};
use crate::settling::Settling;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{DeviceError, InBeam, PowerMeter, RotationStage};

pub use crate::log::{InMemory, Record, RecordError};
pub use crate::reading::State;

/// A part of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// The incident power or the standard, for so many times already.
    Incident(u32),
    /// The scan without a sample.
    Signature,
    /// The scan of the sample.
    Sample,
}

/// A line of what was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Seconds since the run's first line.
    pub time_s: f64,
    /// The part of the run.
    pub phase: Phase,
    /// The angle that was asked for, deg.
    pub asked_deg: f64,
    /// Where the stage stood, deg.
    pub angle_deg: f64,
    /// The power, W; not a number where there is none.
    pub power_w: f64,
    /// State of the reading.
    pub state: State,
    /// The meter's range, as it names it.
    pub range: String,
}

/// Why something is not put into the beam.
pub type HandsError = Box<dyn std::error::Error + Send + Sync>;

/// Who puts things into the beam.
pub trait Hands {
    /// Puts something into the beam and returns when it is there.
    ///
    /// # Errors
    /// Nobody does.
    fn put(&mut self, place: InBeam) -> Result<(), HandsError>;

    /// Turns the axis of that name to an angle, degrees, and returns when it stands there.
    ///
    /// # Errors
    /// Nobody does.
    fn turn(&mut self, axis: &str, deg: f64) -> Result<(), HandsError> {
        Err(format!("nobody turns the axis `{axis}` to {deg:.2}° here").into())
    }

    /// A spectrum has to be recorded: `text` says which, and where its file goes.
    fn record(&mut self, text: &str) {
        let _ = text;
    }
}

/// Why a run cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// Somebody stopped it.
    #[error("stopped at {angle_deg:.3}°")]
    Stopped {
        /// Where the stage should have been, deg.
        angle_deg: f64,
    },
    /// The meter.
    #[error("at {angle_deg:.3}°: {error}")]
    Meter {
        /// Where the stage stood, deg.
        angle_deg: f64,
        /// Error that the meter reported, the last time.
        error: DeviceError,
    },
    /// The stage.
    #[error(transparent)]
    Axis(AxisError),
    /// Readings that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Nobody puts things into the beam.
    #[error(transparent)]
    Hands(#[from] HandsError),
}

/// The devices of a run, their clock, and what stops them.
pub struct Rig<'a> {
    /// The stage.
    pub stage: &'a mut dyn RotationStage,
    /// The meter.
    pub meter: &'a mut dyn PowerMeter,
    /// Who puts things into the beam.
    pub hands: &'a mut dyn Hands,
    /// The clock of all.
    pub clock: DeviceClock,
    /// Stops it.
    pub cancel: Cancel,
}

/// How long stopping the motor may take.
const STOP: Duration = Duration::from_secs(5);

/// Measures what is not in `before` yet, in the order of the run; `again` reads the incident power anew before it goes on. `zero_s` is when the run's first line was, on the rig's clock
/// (below 0 where that was before it began). The motor is stopped whatever happens.
///
/// # Errors
/// Why it cannot go on; what was read until then is in the record.
pub fn measure(
    rig: &mut Rig,
    plan: &Measuring,
    before: &[Line],
    again: bool,
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let result = all_phases(rig, plan, before, again, zero_s, record);
    // Whatever is wrong with it is said by the result already.
    let grace = Deadline::after(rig.clock.clock.clone(), STOP);
    let _ = rig.stage.stop(&grace);
    log::end(record, result)
}

/// The times that the incident power was read, and whether the last one followed the sample's last angle.
fn incidents(before: &[Line]) -> (u32, bool) {
    let kept = before.iter().filter(|line| line.state == State::Kept);
    let (mut count, mut after) = (0, false);
    for line in kept {
        match line.phase {
            Phase::Incident(number) => {
                count = count.max(number + 1);
                after = true;
            }
            Phase::Signature => {}
            Phase::Sample => after = false,
        }
    }
    (count, after)
}

fn all_phases(
    rig: &mut Rig,
    plan: &Measuring,
    before: &[Line],
    again: bool,
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let angles = plan.scan.angles();
    let left = |phase: Phase| -> Vec<f64> {
        let done = |angle: &f64| {
            before.iter().any(|line| {
                line.state == State::Kept && line.phase == phase && line.asked_deg == *angle
            })
        };
        angles.iter().copied().filter(|angle| !done(angle)).collect()
    };
    let (mut count, after) = incidents(before);
    let (signature, sample) = match plan.scan.signature {
        true => (left(Phase::Signature), left(Phase::Sample)),
        false => (vec![], left(Phase::Sample)),
    };
    let nothing_left = signature.is_empty() && sample.is_empty();
    let settle_s = plan.meter.settle_s.get();
    let settling = Settling::of_run(seen(before), settle_s, |a, b| a.0 == b.0);
    let mut run = Run { rig, plan, zero_s, record, at_deg: None, settling };
    tell_wait(&run.settling, settle_s, |text| run.record.event(text))?;
    // Readings that were broken off do not mix with those that follow.
    if let Some(last) = before.last().filter(|l| l.state.is_reading()) {
        let (asked, angle) = (last.asked_deg, last.angle_deg);
        run.line(last.phase, asked, angle, f64::NAN, State::Again, &last.range)?;
    }
    if count == 0 || (again && !nothing_left) {
        run.incident(count)?;
        count += 1;
    }
    if !signature.is_empty() {
        run.put(InBeam::Nothing)?;
        run.scan(Phase::Signature, &signature)?;
    }
    if !sample.is_empty() {
        run.put(InBeam::Sample)?;
        run.scan(Phase::Sample, &sample)?;
    }
    if !(nothing_left && after && count > 1) {
        run.incident(count)?;
    }
    Ok(())
}

struct Run<'a, 'b> {
    rig: &'a mut Rig<'b>,
    plan: &'a Measuring,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    at_deg: Option<f64>,
    settling: Settling,
}

impl Run<'_, '_> {
    fn time_s(&self) -> f64 {
        self.rig.clock.clock.now().as_secs_f64() - self.zero_s
    }

    fn put(&mut self, place: InBeam) -> Result<(), RunError> {
        self.settling.other_light();
        Ok(self.rig.hands.put(place)?)
    }

    fn incident(&mut self, number: u32) -> Result<(), RunError> {
        let phase = Phase::Incident(number);
        match self.plan.standard_deg {
            None => {
                self.put(InBeam::Head)?;
                let at = self.at_deg.unwrap_or(0.0);
                self.readings(phase, at, at)
            }
            Some(angle) => {
                self.put(InBeam::Standard)?;
                self.scan(phase, &[angle])
            }
        }
    }

    fn scan(&mut self, phase: Phase, angles: &[f64]) -> Result<(), RunError> {
        for asked in angles {
            let at = self.turn(*asked)?;
            self.readings(phase, *asked, at)?;
        }
        Ok(())
    }

    /// Turns to an angle, from below.
    fn turn(&mut self, asked_deg: f64) -> Result<f64, RunError> {
        let plan = &self.plan.stage;
        let approach = Approach {
            approach_deg: plan.approach_deg.get(),
            tolerance_deg: plan.tolerance_deg.get(),
        };
        let (clock, cancel) = (self.rig.clock.clone(), self.rig.cancel.clone());
        let time = Duration::from_secs_f64(plan.timeout_s.get());
        let deadline = || Deadline::after(clock.clock.clone(), time).with_cancel(&cancel);
        let turned = axis::turn(&mut *self.rig.stage, self.at_deg, asked_deg, &approach, &deadline);
        let at_deg = turned.map_err(|error| match error {
            AxisError::Stopped { asked_deg } => RunError::Stopped { angle_deg: asked_deg },
            error => RunError::Axis(error),
        })?;
        self.at_deg = Some(at_deg);
        Ok(at_deg)
    }

    /// All readings at an angle; anew after a change of range, until it stays.
    fn readings(&mut self, phase: Phase, asked_deg: f64, angle_deg: f64) -> Result<(), RunError> {
        let Rig { meter, clock, cancel, .. } = &mut *self.rig;
        let mut reader = Reader {
            meter: &mut **meter,
            clock,
            cancel,
            settle_s: self.plan.meter.settle_s.get(),
            timeout_s: self.plan.meter.timeout_s.get(),
            readings: self.plan.scan.readings,
            interval_s: self.plan.scan.interval_s.get(),
            settling: &mut self.settling,
        };
        let clock = reader.clock.clone();
        let mut at = At {
            clock,
            zero_s: self.zero_s,
            record: &mut *self.record,
            phase,
            asked_deg,
            angle_deg,
        };
        reader.take(&format!("at {angle_deg:.3}°"), &mut at).map_err(|error| match error {
            ReadError::Stopped => RunError::Stopped { angle_deg },
            ReadError::Meter(error) => RunError::Meter { angle_deg, error },
            ReadError::Record(error) => RunError::Record(error),
        })
    }

    fn line(
        &mut self,
        phase: Phase,
        asked_deg: f64,
        angle_deg: f64,
        power_w: f64,
        state: State,
        range: &str,
    ) -> Result<(), RunError> {
        let (time_s, range) = (self.time_s(), range.to_owned());
        let line = Line { time_s, phase, asked_deg, angle_deg, power_w, state, range };
        Ok(self.record.line(&line)?)
    }
}

/// The keeper of the readings at an angle.
struct At<'a> {
    clock: DeviceClock,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    phase: Phase,
    asked_deg: f64,
    angle_deg: f64,
}

impl Keep for At<'_> {
    fn reading(&mut self, power_w: f64, state: State, range: &str) -> Result<(), RecordError> {
        let time_s = self.clock.clock.now().as_secs_f64() - self.zero_s;
        let (phase, asked_deg, angle_deg) = (self.phase, self.asked_deg, self.angle_deg);
        let range = range.to_owned();
        self.record.line(&Line { time_s, phase, asked_deg, angle_deg, power_w, state, range })
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        self.record.sync()
    }

    fn event(&mut self, text: &str) -> Result<(), RecordError> {
        self.record.event(text)
    }
}

/// Lines by part and angle.
fn seen(lines: &[Line]) -> impl Iterator<Item = Seen<'_, (Phase, u64)>> {
    lines.iter().map(|line| Seen {
        key: (line.phase, line.asked_deg.to_bits()),
        angle_deg: line.angle_deg,
        time_s: line.time_s,
        power_w: line.power_w,
        state: line.state,
        range: &line.range,
    })
}

/// The readings that count: of each part and angle those before the last line that keeps them.
pub fn measured(lines: &[Line]) -> Measured {
    let mut measured = Measured::default();
    for ((phase, _), at) in kept(seen(lines)) {
        match phase {
            Phase::Incident(_) => measured.incident.push(at),
            Phase::Signature => measured.signature.push(at),
            Phase::Sample => measured.sample.push(at),
        }
    }
    measured
}
