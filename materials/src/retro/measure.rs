//! The run itself: what is put into the beam, to which angles the stage goes, what the meter says there.
//!
//! Nothing is kept in memory alone: each reading goes to a [`Record`] as it comes, and is safe before the stage moves on.

use super::plan::Measuring;
use super::{AtAngle, Measured};
use std::collections::BTreeMap;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{
    Device, DeviceError, InBeam, Power, PowerMeter, RotationStage, Value,
};

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

/// State of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It has a power.
    Read,
    /// The meter was over its range.
    Over,
    /// The readings since the last such line are all of this angle: they count.
    Kept,
    /// They do not count: the range changed between them.
    Again,
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

/// Why a line is not kept.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A file of the run cannot be written.
    #[error("cannot write {file}")]
    Write {
        /// The file.
        file: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// A file of the run cannot be made safe on the disk.
    #[error("cannot write {file} through")]
    Sync {
        /// The file.
        file: &'static str,
        /// Why.
        source: std::io::Error,
    },
}

/// Why something is not put into the beam.
pub type HandsError = Box<dyn std::error::Error + Send + Sync>;

/// Where lines go.
pub trait Record {
    /// Takes a line.
    ///
    /// # Errors
    /// It cannot be written.
    fn line(&mut self, line: &Line) -> Result<(), RecordError>;

    /// All lines so far are safe when it returns.
    ///
    /// # Errors
    /// The disk refuses.
    fn sync(&mut self) -> Result<(), RecordError>;

    /// Something happened that is worth a line of its own.
    ///
    /// # Errors
    /// It cannot be written.
    fn event(&mut self, text: &str) -> Result<(), RecordError>;
}

/// Lines in memory: for runs on a virtual rig that nobody wants to keep.
#[derive(Debug, Clone, Default)]
pub struct InMemory(pub Vec<Line>);

impl Record for InMemory {
    fn line(&mut self, line: &Line) -> Result<(), RecordError> {
        self.0.push(line.clone());
        Ok(())
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn event(&mut self, _: &str) -> Result<(), RecordError> {
        Ok(())
    }
}

/// Who puts things into the beam.
pub trait Hands {
    /// Puts something into the beam and returns when it is there.
    ///
    /// # Errors
    /// Nobody does.
    fn put(&mut self, place: InBeam) -> Result<(), HandsError>;
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
    #[error("on the way to {asked_deg:.3}°: {error}{}", stands(*at_deg))]
    Stage {
        /// Where it was sent, deg.
        asked_deg: f64,
        /// Where it stands, deg, if it says so.
        at_deg: Option<f64>,
        /// Error that the stage reported.
        error: DeviceError,
    },
    /// The stage says that it arrived, but elsewhere.
    #[error(
        "the stage was sent to {asked_deg:.3}° and stands at {at_deg:.3}°: more than {tolerance_deg}° off (is the axis blocked, does the motor lose steps?)"
    )]
    Elsewhere {
        /// Where it was sent, deg.
        asked_deg: f64,
        /// Where it stands, deg.
        at_deg: f64,
        /// How far off it may be, deg.
        tolerance_deg: f64,
    },
    /// Readings that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Nobody puts things into the beam.
    #[error(transparent)]
    Hands(#[from] HandsError),
}

fn stands(at_deg: Option<f64>) -> String {
    at_deg.map_or(String::new(), |at| format!("; it stands at {at:.3}°"))
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

/// Reads of the meter that may fail one after the other, and the wait between them.
const TRIES: u32 = 3;
const TRY_AGAIN: Duration = Duration::from_secs(1);
/// Times that an angle is read anew because the range changed.
const RANGES: u32 = 5;
/// How long stopping the motor may take.
const STOP: Duration = Duration::from_secs(5);

impl Rig<'_> {
    fn within(&self, s: f64) -> Deadline {
        Deadline::after(self.clock.clock.clone(), Duration::from_secs_f64(s))
            .with_cancel(&self.cancel)
    }

    fn wait(&self, s: f64, angle_deg: f64) -> Result<(), RunError> {
        let wait = self.within(s + 1.0).sleep(Duration::from_secs_f64(s));
        wait.map_err(|_| RunError::Stopped { angle_deg })
    }
}

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
    record: &mut dyn Record,
) -> Result<(), RunError> {
    let result = all_phases(rig, plan, before, again, zero_s, record);
    // Whatever is wrong with it is said by the result already.
    let grace = Deadline::after(rig.clock.clock.clone(), STOP);
    let _ = rig.stage.stop(&grace);
    let synced = record.sync();
    if let Err(error) = &result {
        // The first error is the one that counts.
        let _ = record.event(&error.to_string());
    }
    result.and(synced.map_err(RunError::Record))
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
    record: &mut dyn Record,
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
    let mut run = Run { rig, plan, zero_s, record, at_deg: None };
    // Readings that were broken off do not mix with those that follow.
    if let Some(last) = before.last().filter(|l| matches!(l.state, State::Read | State::Over)) {
        let (asked, angle) = (last.asked_deg, last.angle_deg);
        run.line(last.phase, asked, angle, f64::NAN, State::Again, &last.range)?;
    }
    if count == 0 || (again && !nothing_left) {
        run.incident(count)?;
        count += 1;
    }
    if !signature.is_empty() {
        run.rig.hands.put(InBeam::Nothing)?;
        run.scan(Phase::Signature, &signature)?;
    }
    if !sample.is_empty() {
        run.rig.hands.put(InBeam::Sample)?;
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
    record: &'a mut dyn Record,
    at_deg: Option<f64>,
}

impl Run<'_, '_> {
    fn time_s(&self) -> f64 {
        self.rig.clock.clock.now().as_secs_f64() - self.zero_s
    }

    fn incident(&mut self, number: u32) -> Result<(), RunError> {
        let phase = Phase::Incident(number);
        match self.plan.standard_deg {
            None => {
                self.rig.hands.put(InBeam::Head)?;
                let at = self.at_deg.unwrap_or(0.0);
                self.readings(phase, at, at)
            }
            Some(angle) => {
                self.rig.hands.put(InBeam::Standard)?;
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
        let stage = &self.plan.stage;
        let below = asked_deg - stage.approach_deg.get();
        let is_down = self.at_deg.is_none_or(|at| at > asked_deg);
        let reaches = self.rig.stage.travel_deg().is_none_or(|[least, _]| below >= least);
        if is_down && below < asked_deg && reaches {
            self.move_to(below)?;
        }
        let at_deg = self.move_to(asked_deg)?;
        self.at_deg = Some(at_deg);
        if (at_deg - asked_deg).abs() > stage.tolerance_deg.get() {
            let tolerance_deg = stage.tolerance_deg.get();
            return Err(RunError::Elsewhere { asked_deg, at_deg, tolerance_deg });
        }
        Ok(at_deg)
    }

    fn move_to(&mut self, asked_deg: f64) -> Result<f64, RunError> {
        let deadline = self.rig.within(self.plan.stage.timeout_s.get());
        self.rig.stage.move_to(asked_deg, &deadline).map_err(|failed| match *failed.error {
            DeviceError::Cancelled { .. } => RunError::Stopped { angle_deg: asked_deg },
            error => RunError::Stage { asked_deg, at_deg: failed.done, error },
        })
    }

    /// All readings at an angle; anew after a change of range, until it stays.
    fn readings(&mut self, phase: Phase, asked_deg: f64, angle_deg: f64) -> Result<(), RunError> {
        let settle_s = self.plan.meter.settle_s.get();
        self.rig.wait(settle_s, angle_deg)?;
        let mut range = self.range(angle_deg)?;
        for take in 1..=RANGES {
            for number in 0..self.plan.scan.readings {
                if number > 0 {
                    self.rig.wait(self.plan.scan.interval_s.get(), angle_deg)?;
                }
                let (power_w, state) = match self.read(angle_deg)? {
                    Power::Watts(power_w) => (power_w, State::Read),
                    _ => (f64::NAN, State::Over),
                };
                self.line(phase, asked_deg, angle_deg, power_w, state, &range)?;
            }
            let now = self.range(angle_deg)?;
            let stays = now == range || take == RANGES;
            if stays && now != range {
                let text = format!(
                    "at {angle_deg:.3}° the meter's range does not settle after {RANGES} times: choose a fixed one"
                );
                self.record.event(&text)?;
            }
            let state = if stays { State::Kept } else { State::Again };
            self.line(phase, asked_deg, angle_deg, f64::NAN, state, &range)?;
            self.record.sync()?;
            if stays {
                return Ok(());
            }
            range = now;
            self.rig.wait(settle_s, angle_deg)?;
        }
        Ok(())
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

    /// One reading; a meter that fails is asked again a little later.
    fn read(&mut self, angle_deg: f64) -> Result<Power, RunError> {
        self.ask(angle_deg, |meter, deadline| meter.power(deadline))
    }

    /// The range, as the meter names it; empty where it does not.
    fn range(&mut self, angle_deg: f64) -> Result<String, RunError> {
        let settings = self.ask(angle_deg, |meter, deadline| Device::settings(meter, deadline))?;
        let range = settings.iter().find(|s| matches!(s.name, "range_w" | "range"));
        Ok(range.map_or(String::new(), |s| match &s.value {
            Value::Number(end_w) => format!("{end_w:e}W"),
            value => value.to_string(),
        }))
    }

    fn ask<T>(
        &mut self,
        angle_deg: f64,
        mut what: impl FnMut(&mut dyn PowerMeter, &Deadline) -> Result<T, DeviceError>,
    ) -> Result<T, RunError> {
        for attempt in 1.. {
            let deadline = self.rig.within(self.plan.meter.timeout_s.get());
            match what(&mut *self.rig.meter, &deadline) {
                Ok(found) => return Ok(found),
                Err(DeviceError::Cancelled { .. }) => return Err(RunError::Stopped { angle_deg }),
                Err(error) if attempt >= TRIES => return Err(RunError::Meter { angle_deg, error }),
                Err(error) => {
                    let text = format!("at {angle_deg:.3}°, try {attempt} of {TRIES}: {error}");
                    self.record.event(&text)?;
                    self.rig.wait(TRY_AGAIN.as_secs_f64(), angle_deg)?;
                }
            }
        }
        Err(RunError::Stopped { angle_deg })
    }
}

/// The readings that count: of each part and angle those before the last line that keeps them.
pub fn measured(lines: &[Line]) -> Measured {
    let mut angles: BTreeMap<(Phase, u64), (usize, AtAngle)> = BTreeMap::new();
    let mut now: Vec<&Line> = Vec::new();
    for (place, line) in lines.iter().enumerate() {
        let belongs =
            |first: &&&Line| first.phase == line.phase && first.asked_deg == line.asked_deg;
        // An angle whose reading was broken off, and then another one.
        if now.first().filter(belongs).is_none() {
            now.clear();
        }
        match line.state {
            State::Read | State::Over => now.push(line),
            State::Again => now.clear(),
            State::Kept => {
                let n = now.len().max(1) as f64;
                let at = AtAngle {
                    angle_deg: line.angle_deg,
                    time_s: now.iter().map(|l| l.time_s).sum::<f64>() / n,
                    power_w: (now.iter().filter(|l| l.state == State::Read))
                        .map(|l| l.power_w)
                        .collect(),
                    over: now.iter().filter(|l| l.state == State::Over).count(),
                    range: line.range.clone(),
                };
                angles.insert((line.phase, line.asked_deg.to_bits()), (place, at));
                now.clear();
            }
        }
    }
    let mut found: Vec<((Phase, u64), (usize, AtAngle))> = angles.into_iter().collect();
    found.sort_by_key(|(_, (place, _))| *place);
    let mut measured = Measured::default();
    for ((phase, _), (_, at)) in found {
        match phase {
            Phase::Incident(_) => measured.incident.push(at),
            Phase::Signature => measured.signature.push(at),
            Phase::Sample => measured.sample.push(at),
        }
    }
    measured
}
