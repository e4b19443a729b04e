//! The run itself: what is put into the beam, where the axes go, what the meter says there.

use super::bench::{AXES, Bench};
use super::channels::{Band, Reads};
use super::files::{Folder, FolderReadError};
use super::line::{Line, seen_each};
use super::pose::Angles;
use super::spectra::{SpectrumError, SpectrumReader};
use super::tasks::{Part, RESUMED, Task, darks};
use crate::axis::{self, Approach, AxisError};
use crate::log::{self, Record, RecordError};
use crate::reading::{Keep, ReadError, Reader, State, TRIES, TRY_AGAIN, tell_wait};
use crate::retro::measure::{Hands, HandsError};
use crate::settling::Settling;
use std::collections::HashSet;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{
    DeviceError, InBeam, Monochromator, PowerMeter, RotationStage, Spectrometer,
};

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
    /// The spectrometer.
    #[error("at {part} {number}: {error}")]
    Spectrometer {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
        /// Why there is no spectrum, the last time.
        error: SpectrumError,
    },
    /// The monochromator.
    #[error("at {part} {number}, the monochromator on the way to {asked_nm} nm: {error}")]
    Monochromator {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
        /// Where it was sent, nm.
        asked_nm: f64,
        /// Error that it reported, the last time.
        error: DeviceError,
    },
    /// The monochromator says that it arrived, but elsewhere.
    #[error(
        "at {part} {number}: the monochromator was sent to {asked_nm} nm and stands at {at_nm} nm, more than {tolerance_nm} nm off (is the wavelength within its grating's range?)"
    )]
    Elsewhere {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
        /// Where it was sent, nm.
        asked_nm: f64,
        /// Where it stands, nm.
        at_nm: f64,
        /// How far off it may be, nm.
        tolerance_nm: f64,
    },
    /// The files of a folder.
    #[error("at {part} {number}")]
    Files {
        /// The part.
        part: &'static str,
        /// The number within it.
        number: u32,
        /// Why no file was taken.
        source: FolderReadError,
    },
    /// A detector that the bench does not have.
    #[error("the bench's file has other detectors than were opened")]
    NoDetector,
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

/// Detector of a run.
pub enum Detector<'a> {
    /// A power meter.
    Meter(&'a mut dyn PowerMeter),
    /// A power meter behind a monochromator.
    Monochromator(&'a mut dyn Monochromator, &'a mut dyn PowerMeter),
    /// A spectrometer.
    Spectrometer(&'a mut dyn Spectrometer),
    /// The folder into which somebody else writes files.
    Files(&'a mut Folder),
}

/// The devices of a run with any detector, their clock, and what stops them.
pub struct Devices<'a> {
    /// Stages of the axes: sample, detector, azimuth, turn; none of an axis that a person turns.
    pub stages: [Option<&'a mut dyn RotationStage>; 4],
    /// Detector of the run.
    pub detector: Detector<'a>,
    /// Who puts things into the beam, and turns axes without a motor.
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

/// The measurements that are safe in all of the bench's channels: part and number.
#[must_use]
pub fn done_of(lines: &[Line], bench: &Bench) -> HashSet<(Part, u32)> {
    let all = done(lines);
    if !matches!(bench.reads, Reads::Monochromator(_)) {
        return all;
    }
    let each = done_each(lines);
    let has = |(part, number): &(Part, u32)| {
        bench.bands.iter().all(|band| each.contains(&(*part, *number, band.nm.to_bits())))
    };
    all.into_iter().filter(has).collect()
}

/// The measurements that are safe: part, number, and wavelength of the monochromator as bits.
fn done_each(lines: &[Line]) -> HashSet<(Part, u32, u64)> {
    let kept = seen_each(lines).filter(|seen| seen.state == State::Kept);
    kept.map(|seen| seen.key).collect()
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
    let Rig { stages, meter, hands, clock, cancel } = rig;
    let stages = stages
        .each_mut()
        .map(|stage| stage.as_mut().map(|stage| &mut **stage as &mut dyn RotationStage));
    let mut devices = Devices {
        stages,
        detector: Detector::Meter(&mut **meter),
        hands: &mut **hands,
        clock: clock.clone(),
        cancel: cancel.clone(),
    };
    measure_with(&mut devices, bench, tasks, before, zero_s, record)
}

/// [`measure`] with any detector.
///
/// # Errors
/// Why it cannot go on; what was read until then is in the record.
pub fn measure_with(
    rig: &mut Devices<'_>,
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
    rig: &mut Devices<'_>,
    bench: &Bench,
    tasks: &[Task],
    before: &[Line],
    zero_s: f64,
    record: &mut dyn Record<Line>,
) -> Result<(), RunError> {
    let done = done_of(before, bench);
    let left: Vec<Task> =
        tasks.iter().filter(|task| !done.contains(&(task.part, task.number))).copied().collect();
    // Readings that were broken off do not mix with those that follow.
    if let Some(last) = before.last().filter(|line| line.state.is_reading()) {
        let time_s = rig.clock.clock.now().as_secs_f64() - zero_s;
        let (channels, noise) = Line::blank(last.channels.len(), !last.noise.is_empty());
        let torn = Line {
            time_s,
            power_w: f64::NAN,
            state: State::Again,
            channels,
            noise,
            file: None,
            ..last.clone()
        };
        record.line(&torn)?;
    }
    let reference = tasks.iter().find(|task| task.part == Part::Reference);
    let begun = done.iter().any(|(part, _)| *part == Part::Direction);
    let goes_on = left.first().is_some_and(|task| task.part == Part::Direction);
    let settle_s = bench.meter.settle_s.get();
    // A look at the reference that was broken off between two wavelengths is read anew as a whole: its wavelengths tell the lamp at one time.
    let mut done_each = done_each(before);
    done_each
        .retain(|(part, number, _)| *part != Part::Reference || done.contains(&(*part, *number)));
    // A run that goes on looks at the reference first, long after the place before.
    let same_light = |a: &(Part, u32, u64), b: &(Part, u32, u64)| {
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
        settling: Settling::of_run(seen_each(before), settle_s, same_light),
        done: done_each,
        integration: 0,
        integration_s: longest_s(bench),
        dark_counts: dark_counts(before, bench),
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

/// Counts of a spectrometer's brightest channel in the dark, by integration; not a number where it was not measured.
fn dark_counts(lines: &[Line], bench: &Bench) -> Vec<f64> {
    let Reads::Spectrometer(plan) = &bench.reads else { return Vec::new() };
    let all = plan.integrations_s();
    let mut counts = vec![f64::NAN; all.len()];
    for line in lines.iter().filter(|l| l.part == Part::Dark && l.state == State::Read) {
        let k = line.number as usize % all.len();
        counts[k] = brightest_counts(&line.channels, all[k]);
    }
    counts
}

/// Counts of the brightest of channels whose values are counts per second.
fn brightest_counts(per_s: &[f64], integration_s: f64) -> f64 {
    integration_s * per_s.iter().copied().filter(|v| v.is_finite()).fold(f64::NAN, f64::max)
}

/// A spectrometer's longest integration, s: what it may still be at work with when a run begins.
fn longest_s(bench: &Bench) -> f64 {
    let Reads::Spectrometer(plan) = &bench.reads else { return 0.0 };
    plan.integrations_s().into_iter().fold(0.0, f64::max)
}

/// Words about channels that are over range in the beam: they will have no values, and now that can still be changed.
fn over_in_beam(place: &str, bands: &[Band], over: &[bool]) -> Option<String> {
    const NAMED: usize = 4;
    let all: Vec<String> =
        bands.iter().zip(over).filter(|(_, is)| **is).map(|(b, _)| b.nm.to_string()).collect();
    let more = if all.len() > NAMED { ", …" } else { "" };
    (!all.is_empty()).then(|| {
        format!(
            "{place}: {} of {} channels are over the detector's range in the beam ({}{more} nm) and will have no values: take a shorter integration, or put a filter into the beam and name it in [beam] filter_transmission",
            all.len(),
            bands.len(),
            all[..all.len().min(NAMED)].join(", ")
        )
    })
}

struct Run<'a, 'b> {
    rig: &'a mut Devices<'b>,
    bench: &'a Bench,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    asked: Angles,
    at: Angles,
    place: Option<InBeam>,
    settling: Settling,
    done: HashSet<(Part, u32, u64)>,
    /// The integration of the place before, by its place among all.
    integration: usize,
    /// The integration of the last spectrum, s.
    integration_s: f64,
    /// Counts of the brightest channel in the dark, by integration.
    dark_counts: Vec<f64>,
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
            if plan.is_by_hand() {
                // What is asked for is what it then stands at.
                let deg = (100.0 * asked).round() / 100.0;
                if self.at[k] != Some(deg) {
                    self.rig.hands.turn(axis, deg)?;
                }
                (self.asked[k], self.at[k]) = (Some(asked), Some(deg));
                continue;
            }
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
        match &self.bench.reads {
            Reads::Meter => self.read_meter(task, None),
            Reads::Monochromator(_) => self.read_wavelengths(task),
            Reads::Spectrometer(_) => self.read_spectra(task),
            Reads::Files(_) => self.read_files(task),
        }
    }

    /// Reads the meter, at a wavelength of the monochromator where there is one.
    fn read_meter(&mut self, task: &Task, wavelength_nm: Option<f64>) -> Result<(), RunError> {
        let (part, number) = (task.part.name(), task.number);
        let Devices { detector, clock, cancel, .. } = &mut *self.rig;
        let (Detector::Meter(meter) | Detector::Monochromator(_, meter)) = detector else {
            return Err(RunError::NoDetector);
        };
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
        let mut at = At {
            clock,
            zero_s: self.zero_s,
            record: &mut *self.record,
            task,
            stages: self.at,
            wavelength_nm,
        };
        let place = match wavelength_nm {
            None => format!("at {part} {number}"),
            Some(nm) => format!("at {part} {number}, {nm} nm"),
        };
        reader.take(&place, &mut at).map_err(|error| match error {
            ReadError::Stopped => RunError::Stopped { part, number },
            ReadError::Meter(error) => RunError::Meter { part, number, error },
            ReadError::Record(error) => RunError::Record(error),
        })
    }

    /// All wavelengths in turn, but those that are safe already.
    fn read_wavelengths(&mut self, task: &Task) -> Result<(), RunError> {
        let bench = self.bench;
        for band in &bench.bands {
            if self.done.contains(&(task.part, task.number, band.nm.to_bits())) {
                continue;
            }
            self.go_to(task, band.nm)?;
            self.read_meter(task, Some(band.nm))?;
        }
        Ok(())
    }

    /// Sends the monochromator to a wavelength; one that fails is sent again a little later.
    fn go_to(&mut self, task: &Task, asked_nm: f64) -> Result<(), RunError> {
        let (part, number) = (task.part.name(), task.number);
        let Reads::Monochromator(plan) = &self.bench.reads else {
            return Err(RunError::NoDetector);
        };
        let (clock, cancel) = (self.rig.clock.clone(), self.rig.cancel.clone());
        let within = |time| Deadline::after(clock.clock.clone(), time).with_cancel(&cancel);
        let time = Duration::from_secs_f64(plan.timeout_s.get());
        for attempt in 1.. {
            let Detector::Monochromator(device, _) = &mut self.rig.detector else {
                return Err(RunError::NoDetector);
            };
            let error = match device.move_to(asked_nm, &within(time)) {
                Ok(at_nm) => {
                    let tolerance_nm = plan.tolerance_nm.get();
                    // What is no number is not near.
                    if (at_nm - asked_nm).abs() <= tolerance_nm {
                        return Ok(());
                    }
                    return Err(RunError::Elsewhere {
                        part,
                        number,
                        asked_nm,
                        at_nm,
                        tolerance_nm,
                    });
                }
                Err(failed) => *failed.error,
            };
            match error {
                DeviceError::Cancelled { .. } => break,
                error if attempt >= TRIES => {
                    return Err(RunError::Monochromator { part, number, asked_nm, error });
                }
                error => {
                    let text = format!(
                        "at {part} {number}, the monochromator to {asked_nm} nm, try {attempt} of {TRIES}: {error}"
                    );
                    self.record.event(&text)?;
                    if within(2 * TRY_AGAIN).sleep(TRY_AGAIN).is_err() {
                        break;
                    }
                }
            }
        }
        Err(RunError::Stopped { part, number })
    }

    fn read_spectra(&mut self, task: &Task) -> Result<(), RunError> {
        let (part, number) = (task.part.name(), task.number);
        let Devices { detector, clock, cancel, .. } = &mut *self.rig;
        let (Detector::Spectrometer(device), Reads::Spectrometer(plan)) =
            (detector, &self.bench.reads)
        else {
            return Err(RunError::NoDetector);
        };
        let mut reader = SpectrumReader {
            device: &mut **device,
            clock,
            cancel,
            plan,
            bands: &self.bench.bands,
            readings: self.bench.scan.readings,
            interval_s: self.bench.scan.interval_s.get(),
            dark_counts: &self.dark_counts,
            before_s: self.integration_s,
        };
        let fixed = (task.part == Part::Dark).then(|| (number % darks(self.bench)) as usize);
        let clock = reader.clock.clone();
        let (record, zero_s, stages) = (&mut *self.record, self.zero_s, self.at);
        let mut brightest = f64::NAN;
        let mut over = vec![false; self.bench.bands.len()];
        let mut keep = |channels: Vec<f64>, state: State, integration_s: f64| {
            if state == State::Again {
                over.fill(false);
            }
            if state.is_reading() {
                for (over, value) in over.iter_mut().zip(&channels) {
                    *over |= value.is_infinite();
                }
                brightest = brightest_counts(&channels, integration_s);
            }
            let time_s = clock.clock.now().as_secs_f64() - zero_s;
            let line = Line {
                time_s,
                part: task.part,
                number,
                stages,
                power_w: f64::NAN,
                state,
                range: format!("{integration_s}s"),
                wavelength_nm: None,
                channels,
                noise: Vec::new(),
                file: None,
            };
            record.line(&line)?;
            if state.is_reading() { Ok(()) } else { record.sync() }
        };
        let mut events = Vec::new();
        let place = format!("at {part} {number}");
        let taken = reader.take(&place, fixed.ok_or(self.integration), &mut keep, &mut events);
        self.integration_s = reader.before_s;
        if task.part == Part::Beam && taken.is_ok() {
            events.extend(over_in_beam(&place, &self.bench.bands, &over));
        }
        for text in events {
            self.record.event(&text)?;
        }
        let integration = taken.map_err(|error| match error {
            SpectrumError::Stopped => RunError::Stopped { part, number },
            SpectrumError::Record(error) => RunError::Record(error),
            error => RunError::Spectrometer { part, number, error },
        })?;
        match fixed {
            None => self.integration = integration,
            Some(_) => self.dark_counts[integration] = brightest,
        }
        Ok(())
    }

    fn read_files(&mut self, task: &Task) -> Result<(), RunError> {
        let (part, number) = (task.part.name(), task.number);
        let Devices { detector, hands, clock, cancel, .. } = &mut *self.rig;
        let (Detector::Files(folder), Reads::Files(plan)) = (detector, &self.bench.reads) else {
            return Err(RunError::NoDetector);
        };
        let failed = |source| match source {
            FolderReadError::Stopped => RunError::Stopped { part, number },
            source => RunError::Files { part, number, source },
        };
        let place = format!("{part} {number}");
        for text in folder.placed().map_err(failed)? {
            self.record.event(&text)?;
        }
        let mut over = vec![false; self.bench.bands.len()];
        for reading in 0..=plan.readings {
            let at_end = reading == plan.readings;
            let (mut channels, mut noise) = Line::blank(self.bench.bands.len(), true);
            let (mut state, mut file) = (State::Kept, None);
            if !at_end {
                hands.record(&folder.wanted(&place, reading, plan.readings));
                let mut say = |text: &str| self.record.event(text);
                let found = folder.next(clock, cancel, &mut say).map_err(failed)?;
                let text = format!("{place}: took {}", found.file.name);
                self.record.event(&text)?;
                for (over, value) in over.iter_mut().zip(&found.values) {
                    *over |= value.is_infinite();
                }
                let is_over = found.values.iter().all(|value| value.is_infinite());
                state = if is_over { State::Over } else { State::Read };
                (channels, noise, file) = (found.values, found.noise, Some(found.file));
            }
            let time_s = clock.clock.now().as_secs_f64() - self.zero_s;
            let line = Line {
                time_s,
                part: task.part,
                number,
                stages: self.at,
                power_w: f64::NAN,
                state,
                range: String::new(),
                wavelength_nm: None,
                channels,
                noise,
                file,
            };
            self.record.line(&line)?;
            // A file is taken when its line is safe.
            self.record.sync()?;
        }
        if task.part == Part::Beam
            && let Some(text) = over_in_beam(&format!("at {place}"), &self.bench.bands, &over)
        {
            self.record.event(&text)?;
        }
        Ok(())
    }
}

/// The keeper of the readings of a task.
struct At<'a> {
    clock: DeviceClock,
    zero_s: f64,
    record: &'a mut dyn Record<Line>,
    task: &'a Task,
    stages: Angles,
    wavelength_nm: Option<f64>,
}

impl Keep for At<'_> {
    fn reading(&mut self, power_w: f64, state: State, range: &str) -> Result<(), RecordError> {
        let time_s = self.clock.clock.now().as_secs_f64() - self.zero_s;
        let (part, number, stages) = (self.task.part, self.task.number, self.stages);
        let range = range.to_owned();
        self.record.line(&Line {
            time_s,
            part,
            number,
            stages,
            power_w,
            state,
            range,
            wavelength_nm: self.wavelength_nm,
            channels: Vec::new(),
            noise: Vec::new(),
            file: None,
        })
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        self.record.sync()
    }

    fn event(&mut self, text: &str) -> Result<(), RecordError> {
        self.record.event(text)
    }
}
