//! A night from its first frame to its last: one thread for each device, one that writes, and this one, which watches them.

use super::camera::CameraWork;
use super::clock::{self, STEP_S};
use super::counter::CounterWork;
use super::disk;
use super::films::Films;
use super::live::{Asked, Click, Control, ControlError, LiveState};
use super::mount::{Aim, MountPlan, MountWork, Sights, Steering, Want};
use super::movers::{Before, RotatorWork, Stands, WheelWork};
use super::opener::Opener;
use super::plan::{CameraPlan, CounterPlan, NightClock, Plan, PlanError, RotatorPlan, WheelPlan};
use super::pointing::Pointing;
use super::room::Room;
use super::schedule::{CameraWish, Schedule, SharedSchedule, Slot};
use super::sequence::Exposing;
use super::status::{Snapshot, State, Status};
use super::telescope::Order;
use super::worker::Worker;
use hifitime::Epoch;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{
    Cancel, DeviceClock, adopt_computer_clock, clock_offset_s, computer_utc,
};
use sunglint_formats::FileError;
use sunglint_formats::session::{
    Disk, FORMAT, Manifest, Session, SessionWriter, Storage, Target, TargetKind, What,
};
use sunglint_formats::time::format_utc;
use sunglint_radiometry::station::Station;

/// Time between two looks at the devices.
const POLL: Duration = Duration::from_millis(50);
/// Farthest way that the telescope goes beside by hand at once, arcsec: 2°.
const FARTHEST_JOG_ARCSEC: f64 = 7200.0;
/// Longest exposure that may be wished, s.
const LONGEST_S: f64 = 3600.0;
/// Time between two looks at the clock.
const CLOCK: Duration = Duration::from_secs(1);
/// Time between two questions whether a clock that stepped is synchronised now.
const CONFIRM: Duration = Duration::from_secs(10);
/// Longest wait of an order to focus for its camera, which may be exposing.
const UNTAKEN: Duration = Duration::from_secs(120);
/// A sleep that takes so much longer is a stall of the process.
const STALL: Duration = Duration::from_millis(500);

/// All that a night is made of.
#[derive(Debug)]
pub struct Night {
    /// The session's folder, to be made.
    pub root: PathBuf,
    /// On which disk.
    pub storage: Arc<dyn Storage>,
    /// Contents of `session.toml`.
    pub manifest: Manifest,
    /// The configuration as used.
    pub files: Vec<(String, Vec<u8>)>,
    /// The station.
    pub station: Station,
    /// The cameras.
    pub cameras: Vec<CameraPlan>,
    /// The counters.
    pub counters: Vec<CounterPlan>,
    /// The filter wheels.
    pub wheels: Vec<WheelPlan>,
    /// The rotators.
    pub rotators: Vec<RotatorPlan>,
    /// The mount, where one points the telescope.
    pub mount: Option<MountPlan>,
    /// This program, which is the mount's watchdog, too: `PROGRAM mount-watchdog ADDRESS`. Without it no real mount is moved.
    pub watchdog: Option<PathBuf>,
    /// Where they come from.
    pub opener: Arc<dyn Opener>,
    /// Where the telescope looks.
    pub schedule: Schedule,
    /// When its cameras begin; `None`: at once. Counters begin at once in any case.
    pub from: Option<Epoch>,
    /// When it ends; `None`: when it is stopped.
    pub end: Option<Epoch>,
    /// Whether it ends with its last visit, also where that is over early.
    pub ends_with_visits: bool,
    /// When it ended, for one that is played back.
    pub ended: Option<Epoch>,
    /// Whether the plan names times of day in UTC (passes): it then follows the computer's clock after a step that a synchronised source confirms.
    pub in_utc: bool,
    /// Where it tells how it goes and takes commands; `None`: nobody looks on.
    pub live: Option<Arc<LiveState>>,
    /// Whether it goes on with the session in `root`.
    pub resumes: bool,
}

/// Why a night cannot run, or did not end in good order.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NightError {
    /// A counter that hands over no tags is asked for them.
    #[error(
        "counter {counter}: {device} hands over no time tags, only bins: leave out its `raw_tags`, or take a counter that does \
         (timetagger, sim-timetagger)"
    )]
    NoTags {
        /// The counter's name.
        counter: String,
        /// Address of the counter.
        device: String,
    },
    /// The session's folder is there, or cannot be made.
    #[error(transparent)]
    Session(#[from] FileError),
    /// The system starts no thread for the writer.
    #[error("cannot start a thread")]
    WriterThread(#[source] io::Error),
    /// The system starts no thread for a device.
    #[error("cannot start a thread for {device}")]
    DeviceThread {
        /// The device's name.
        device: String,
        /// Why.
        source: io::Error,
    },
    /// The thread that writes has crashed.
    #[error("the thread that writes has crashed")]
    WriterCrashed,
    /// Threads of devices have crashed.
    #[error("{crashed} device threads have crashed; what they had is written")]
    Crashed {
        /// How many.
        crashed: usize,
    },
}

/// Data of a night that are missing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Incomplete {
    /// Rows, tags or frames that are not on the disk.
    #[error(
        "{not_written} rows, tags or frames could not be written: {reason}; what was written before is whole"
    )]
    NotWritten {
        /// How many.
        not_written: u64,
        /// The disk's last error, or where it is told.
        reason: String,
    },
    /// Devices that can never do what was asked of them.
    #[error("{}; the other devices went on", failed.iter().map(|(device, error)| format!("{device} was given up: {error}")).collect::<Vec<_>>().join("; "))]
    Failed {
        /// The devices' names, each with what it said.
        failed: Vec<(String, String)>,
    },
    /// Steps with a number of frames, or settings that could not be had, in a night that was not stopped early.
    #[error("no frame counts of {}: see events.jsonl of {}", steps.join("; "), session.display())]
    Empty {
        /// The camera, the step and its target, with what was asked for.
        steps: Vec<String>,
        /// The session's folder.
        session: PathBuf,
    },
    /// Devices that gave nothing in a night that was not stopped early.
    #[error("nothing came from {}: see events.jsonl of {}", devices.join(", "), session.display())]
    Silent {
        /// The devices' names.
        devices: Vec<String>,
        /// The session's folder.
        session: PathBuf,
    },
}

/// How a night went.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The session's folder.
    pub root: PathBuf,
    /// When it ended.
    pub utc: Epoch,
    /// Frames of each camera, and bins of each counter.
    pub taken: BTreeMap<String, u64>,
    /// How often each device was lost.
    pub losses: BTreeMap<String, u64>,
    /// Frames of each camera that are on the disk, where some are not.
    pub on_disk: BTreeMap<String, u64>,
    /// Steps of which no frame counts: the camera, the step and its target.
    pub empty: Vec<String>,
    /// Frames of each camera that were refused, because they are not what was asked for.
    pub refused: BTreeMap<String, u64>,
    /// Devices that can never do what was asked of them, each with what it said.
    pub failed: Vec<(String, String)>,
    /// Devices that gave nothing.
    pub silent: Vec<String>,
    /// Rows and frames that are not on the disk.
    pub not_written: u64,
    /// Error that the disk reported at the end.
    pub disk_error: Option<String>,
    /// Whether it was stopped before its end.
    pub stopped: bool,
}

impl Summary {
    /// Checks that every device gave data and that all of them are on the disk.
    ///
    /// # Errors
    /// The data that are missing.
    pub fn check(&self) -> Result<(), Incomplete> {
        if self.not_written > 0 {
            let reason = self.disk_error.clone().unwrap_or_else(|| "see its event log".into());
            return Err(Incomplete::NotWritten { not_written: self.not_written, reason });
        }
        if !self.failed.is_empty() {
            return Err(Incomplete::Failed { failed: self.failed.clone() });
        }
        if !self.silent.is_empty() && !self.stopped {
            let (devices, session) = (self.silent.clone(), self.root.clone());
            return Err(Incomplete::Silent { devices, session });
        }
        if !self.empty.is_empty() && !self.stopped {
            let (steps, session) = (self.empty.clone(), self.root.clone());
            return Err(Incomplete::Empty { steps, session });
        }
        Ok(())
    }
}

/// Returns `DATE_NAME` in a folder, or the next name that is free. A night has the date of its evening in UTC.
fn free_name(folder: &Path, name: &str, from: Epoch) -> PathBuf {
    let evening = format_utc(from - hifitime::Duration::from_hours(12.0), 0);
    let date = evening.split_once('T').map_or(evening.as_str(), |(date, _)| date).to_owned();
    let first = folder.join(format!("{date}_{name}"));
    let next = |n: u32| folder.join(format!("{date}_{name}_{n}"));
    std::iter::once(first.clone())
        .chain((2..).map(next))
        .find(|path| !path.exists())
        .unwrap_or(first)
}

impl Night {
    /// Prepares a planned night with the devices of an opener: the [`Catalogue`](crate::Catalogue), or what stands in for them.
    ///
    /// The session goes into `root`, or into a folder of the plan's `output` that is named after date and plan. `program` is the
    /// name and version that the session's manifest gets (`sunglint 0.1.0`). The clock of a virtual night is UTC; any other
    /// night's is asked for its state.
    pub fn planned(
        plan: Plan,
        opener: Arc<dyn Opener>,
        root: Option<&Path>,
        program: &str,
    ) -> Self {
        let root = match root {
            Some(root) => root.to_path_buf(),
            None => free_name(&plan.output, &plan.name, plan.from),
        };
        let manifest = Manifest {
            format: FORMAT.into(),
            program: program.to_owned(),
            station: plan.station.name.clone(),
            start_utc: match plan.clock {
                NightClock::Computer => DeviceClock::live().utc(),
                NightClock::Virtual | NightClock::Recording => plan.from,
            },
            clock: match plan.clock {
                NightClock::Computer => clock::measured(),
                NightClock::Virtual => clock::exact(),
                NightClock::Recording => clock::recorded(),
            },
            devices: plan.devices(),
            files: plan.sums(),
        };
        Self {
            root,
            storage: Arc::new(Disk),
            manifest,
            files: plan.files,
            station: plan.station,
            cameras: plan.cameras,
            counters: plan.counters,
            wheels: plan.wheels,
            rotators: plan.rotators,
            mount: plan.mount,
            watchdog: None,
            opener,
            schedule: plan.schedule,
            from: Some(plan.from),
            end: match plan.clock {
                NightClock::Recording => Some(plan.to.unwrap_or_else(|| Films::end(plan.from))),
                NightClock::Computer | NightClock::Virtual => plan.to,
            },
            ends_with_visits: plan.ends_with_visits,
            ended: None,
            in_utc: plan.in_utc,
            live: None,
            resumes: false,
        }
    }

    /// Prepares to go on with a night that was cut off or ended, in the folder of its session, as its plan stands now.
    ///
    /// # Errors
    /// A folder that is no session, or whose plan cannot be followed: a virtual night, one that is over.
    pub fn resumed(
        session: &Path,
        opener: Arc<dyn Opener>,
        program: &str,
    ) -> Result<Self, PlanError> {
        let session = Session::open(session)?;
        let plan = Plan::of_session(&session)?;
        if plan.clock == NightClock::Recording {
            return Err(PlanError::Recorded { session: session.root().to_path_buf() });
        }
        let now = DeviceClock::live().utc();
        if let Some(to) = plan.to.filter(|to| *to <= now) {
            let (root, at) = (session.root().to_path_buf(), format_utc(to, 0));
            return Err(PlanError::Over { session: root, at });
        }
        let mut night = Self::planned(plan, opener, Some(session.root()), program);
        night.manifest = session.manifest().clone();
        night.resumes = true;
        Ok(night)
    }

    /// Runs until the night's end, or until `cancel` is set. `show` is called every twentieth of a second.
    ///
    /// # Errors
    /// A counter that hands over no tags is asked for them; the folder is there or cannot be made; the system starts no thread. All else is in the summary.
    pub fn run(
        self,
        cancel: &Cancel,
        show: &mut dyn FnMut(Snapshot),
    ) -> Result<Summary, NightError> {
        if let Some(plan) =
            self.counters.iter().find(|p| p.raw_tags && !self.opener.streams_tags(p))
        {
            let (counter, device) = (plan.name.clone(), plan.device.clone());
            return Err(NightError::NoTags { counter, device });
        }
        let mut schedule = self.schedule.clone();
        let start = self.manifest.start_utc;
        let live = self.names().all(|name| self.opener.clock(name).is_live());
        let status = Arc::new(Status::new(start, live));
        let storage = self.storage.clone();
        let (writer, before) = match self.resumes {
            false => {
                // The folder in which sessions are made may be new, and those above it.
                let above = self.root.ancestors().skip(1);
                let new: Vec<&Path> = above
                    .take_while(|path| !path.as_os_str().is_empty() && !path.exists())
                    .collect();
                for folder in new.into_iter().rev() {
                    let made = storage.create_folder(folder);
                    made.map_err(|error| FileError::io("create", folder, error))?;
                }
                let made = SessionWriter::create(storage, &self.root, &self.manifest, &self.files);
                (made?, None)
            }
            true => {
                let (program, utc) = (&self.manifest.program, DeviceClock::live().utc());
                let (writer, resumed) = SessionWriter::resume(storage, &self.root, program, utc)?;
                (writer, Some(resumed))
            }
        };
        if let Some((begun, number)) = before.as_ref().and_then(|before| before.step) {
            schedule = schedule.gone_on(begun, number);
        }
        // The end of one that is played back is no time of it.
        let end = self.ended.or(self.end);
        let room = Room::new(self.root.clone(), (start, end), &self.cameras, &self.counters);
        let (disk, writing) = disk::start(writer, status.clone(), live, self.live.clone(), room)
            .map_err(NightError::WriterThread)?;
        if let Some(state) = &self.live {
            state.begin(&self, live);
        }
        let schedule = Arc::new(SharedSchedule::new(schedule));
        let worker = |name: &str| Worker {
            name: name.to_owned(),
            clock: self.opener.clock(name),
            opener: self.opener.clone(),
            cancel: cancel.clone(),
            disk: disk.clone(),
            schedule: schedule.clone(),
            from: self.from,
            end: self.end,
            status: status.clone(),
            lost_at: None,
            again_in: Duration::ZERO,
            permanent: false,
        };
        // All clocks are there before the first of them runs: of some nights they wait for each other.
        let clocks: Vec<DeviceClock> = self.all_names().map(|n| self.opener.clock(n)).collect();
        let mut threads: Vec<JoinHandle<()>> = Vec::new();
        let aim = self
            .mount
            .as_ref()
            .map(|mount| Arc::new(Aim::new(mount.camera.clone(), mount.wait, mount.acquire_s())));
        let view = self.mount.as_ref().and_then(|mount| mount.view(&self.station));
        let sights = view.map(|view| Arc::new(Sights::new(view)));
        let hand = self
            .mount
            .as_ref()
            .map(|mount| Arc::new(Steering::new(mount.camera.clone(), sights.clone())));
        if let (Some(plan), Some(aim), Some(hand)) = (&self.mount, &aim, &hand) {
            let (station, aim, program) =
                (self.station.clone(), aim.clone(), self.watchdog.clone());
            let frame_s = self.frame_s(plan.camera.as_deref());
            let (mount, sights, hand) = (plan.clone(), sights.clone(), hand.clone());
            let mut work = MountWork::new(mount, station, aim, sights, hand, frame_s, program);
            let worker = worker(&plan.name);
            threads.push(thread(&plan.name, move || worker.supervise(|worker| work.run(worker)))?);
        }
        let stands = Arc::new(Stands::default());
        for plan in &self.wheels {
            let mut work = WheelWork::new(plan.clone(), &self.cameras, stands.clone());
            let worker = worker(&plan.name);
            threads.push(thread(&plan.name, move || worker.supervise(|worker| work.run(worker)))?);
        }
        for plan in &self.rotators {
            let mut work = RotatorWork::new(plan.clone(), stands.clone());
            let worker = worker(&plan.name);
            threads.push(thread(&plan.name, move || worker.supervise(|worker| work.run(worker)))?);
        }
        for plan in &self.cameras {
            let is_before = |cameras: &[String]| cameras.is_empty() || cameras.contains(&plan.name);
            let wheel = self.wheels.iter().find(|wheel| is_before(&wheel.cameras));
            let rotators = self.rotators.iter().filter(|rotator| is_before(&rotator.cameras));
            let standing = Before::new(
                wheel.map(|wheel| wheel.name.clone()),
                rotators.map(|rotator| rotator.name.clone()).collect(),
                stands.clone(),
            );
            let pointing = Pointing::new(self.station.clone());
            let mut work = CameraWork::new(plan.clone(), pointing, standing);
            if let (Some(aim), Some(mount)) = (&aim, &self.mount) {
                let own = mount.camera.as_ref() == Some(&plan.name);
                work.behind_mount(aim.clone(), sights.clone().filter(|_| own));
            }
            if let Some(before) = &before {
                let number = before.numbers.get(&plan.name).copied().unwrap_or(0);
                work.go_on(number, self.taken_in(&plan.name, before.step));
            }
            let worker = worker(&plan.name);
            threads.push(thread(&plan.name, move || worker.supervise(|worker| work.run(worker)))?);
        }
        for plan in &self.counters {
            let counted = before.as_ref().is_some_and(|b| b.counted.contains(&plan.name));
            let mut work = CounterWork::new(plan.clone(), counted);
            let worker = worker(&plan.name);
            threads.push(thread(&plan.name, move || worker.supervise(|worker| work.run(worker)))?);
        }
        drop(clocks);
        let numbers = before.as_ref().map(|before| before.numbers.clone()).unwrap_or_default();
        let told = before.and_then(|before| before.target);
        let mut watch = Watch {
            night: &self,
            status: &status,
            disk: &disk,
            told: 0,
            target: None,
            offset_s: clock_offset_s(),
            asked: None,
            cancel,
            schedule: schedule.clone(),
            before_pause: None,
            focus_asked: None,
            waits: false,
            hand,
            sequence: self.schedule.has_sequences(),
        };
        if let Some((_, target)) = told {
            watch.go_on(target);
        }
        let utc = watch.until_all_end(&threads, live, show);
        let crashed = threads.into_iter().filter_map(|thread| thread.join().err()).count();
        // The writer ends once nobody can send to it any more.
        drop(disk);
        let writing = writing.join().map_err(|_| NightError::WriterCrashed)?;
        let stopped = cancel.is_cancelled();
        let ended = writing.finish(utc, if stopped { "stopped" } else { "done" });
        for fault in &ended.troubles {
            status.disk_fault(fault);
        }
        status.set_lost(ended.lost, !ended.troubles.is_empty());
        let last = status.snapshot();
        show(last.clone());
        if let Some(state) = &self.live {
            state.collect(&last, schedule.get().slots(), false);
            state.end(if stopped { "stopped" } else { "done" });
        }
        if crashed > 0 {
            return Err(NightError::Crashed { crashed });
        }
        Ok(self.summary(utc, &last, stopped, &numbers))
    }

    /// The frames that a camera has of a step, by the files of the session.
    fn taken_in(&self, camera: &str, step: Option<(Epoch, u32)>) -> Option<(u32, u32)> {
        let (from, number) = step?;
        let slots = self.schedule.slots().iter();
        let mut numbered = slots.filter(|s| s.step.as_ref().is_some_and(|s| s.number == number));
        let slot = numbered.next()?;
        let plan = self.cameras.iter().find(|plan| plan.name == camera)?;
        let exposing = Exposing::of(plan, Some(slot.target.target_kind), slot.step.as_deref());
        exposing.frames?;
        let session = Session::open(&self.root).ok()?;
        let frames = session.frames(camera).ok()?.files.into_iter();
        let of_it = frames.filter(|frame| frame.start().is_some_and(|start| start >= from));
        Some((number, u32::try_from(of_it.count()).unwrap_or(u32::MAX)))
    }

    /// Longest time from one frame of a camera to the next, s, as planned.
    fn frame_s(&self, camera: Option<&str>) -> f64 {
        let of_it = |plan: &&CameraPlan| Some(plan.name.as_str()) == camera;
        let Some(plan) = self.cameras.iter().find(of_it) else { return 1.0 };
        let steps = self.schedule.slots().iter().map(|slot| slot.step.as_deref());
        let every_s = |step| {
            let set = Exposing::of(plan, None, step).plan;
            set.interval_s.map_or(set.exposure_s.get() + 0.5, |interval| interval.get())
        };
        steps.map(every_s).fold(every_s(None), f64::max)
    }

    /// Names of all devices.
    fn all_names(&self) -> impl Iterator<Item = &str> {
        let wheels = self.wheels.iter().map(|plan| plan.name.as_str());
        let rotators = self.rotators.iter().map(|plan| plan.name.as_str());
        let mount = self.mount.iter().map(|plan| plan.name.as_str());
        self.names().chain(wheels).chain(rotators).chain(mount)
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        let cameras = self.cameras.iter().map(|plan| plan.name.as_str());
        cameras.chain(self.counters.iter().map(|plan| plan.name.as_str()))
    }

    /// Frames of each camera that have a file, of those behind the numbers that it had before.
    fn on_disk(&self, before: &BTreeMap<String, u64>) -> BTreeMap<String, u64> {
        let Ok(session) = Session::open(&self.root) else { return BTreeMap::new() };
        let of = |plan: &CameraPlan| {
            let first = before.get(&plan.name).copied().unwrap_or(0);
            let files = session.frames(&plan.name).ok()?.files;
            let count = files.iter().filter(|file| file.sequence > first).count();
            Some((plan.name.clone(), count as u64))
        };
        self.cameras.iter().filter_map(of).collect()
    }

    fn summary(
        &self,
        utc: Epoch,
        last: &Snapshot,
        stopped: bool,
        numbers: &BTreeMap<String, u64>,
    ) -> Summary {
        let of = |name: &str| last.devices.get(name).cloned().unwrap_or_default();
        let each = |value: &dyn Fn(&str) -> u64| {
            self.names().map(|name| (name.to_owned(), value(name))).collect::<BTreeMap<_, _>>()
        };
        Summary {
            root: self.root.clone(),
            utc,
            taken: each(&|name| of(name).taken),
            losses: each(&|name| of(name).losses),
            on_disk: match last.missing {
                0 => BTreeMap::new(),
                _ => self.on_disk(numbers),
            },
            empty: last.empty.clone(),
            refused: each(&|name| of(name).refused),
            failed: {
                let wheels = self.wheels.iter().map(|wheel| wheel.name.as_str());
                let movers = wheels.chain(self.rotators.iter().map(|r| r.name.as_str()));
                let movers = movers.chain(self.mount.iter().map(|mount| mount.name.as_str()));
                let all = self.names().chain(movers);
                all.filter_map(|name| failure(name, of(name).state)).collect()
            },
            silent: self.names().filter(|n| of(n).taken == 0).map(str::to_owned).collect(),
            not_written: last.missing,
            disk_error: last.disk_error.clone(),
            stopped,
        }
    }
}

/// Answer to a repeated visit: what follows it, and what finds no time any more.
fn after_repeat(before: &Schedule, again: &Schedule, utc: Epoch, end: Option<Epoch>) -> String {
    let kept = again.visits();
    let ends = |slot: &Slot| end.is_some_and(|end| slot.from >= end);
    let planned = before.visits().into_iter().filter(|visit| visit.from > utc);
    let lost = planned.filter(|visit| {
        let mut later = kept.iter().filter(|slot| slot.from > utc && !ends(slot));
        !later.any(|slot| slot.target == visit.target)
    });
    let lost: Vec<String> = lost.map(|visit| visit.target.name).collect();
    let text = "once more from now on; the stars that follow come later";
    match lost.is_empty() {
        true => text.to_owned(),
        false => format!("{text}; no time is left for {}", lost.join(", ")),
    }
}

fn failure(name: &str, state: State) -> Option<(String, String)> {
    match state {
        State::Failed { error } => Some((name.to_owned(), error)),
        _ => None,
    }
}

fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, NightError> {
    let builder = std::thread::Builder::new().name(name.to_owned());
    let failed = |source| NightError::DeviceThread { device: name.to_owned(), source };
    builder.spawn(work).map_err(failed)
}

/// Watch over the devices: notes where the telescope points, and what the clock does.
struct Watch<'a> {
    night: &'a Night,
    status: &'a Status,
    disk: &'a disk::Disk,
    /// Slots of the schedule that the log has.
    told: usize,
    /// The target that was told last.
    target: Option<Target>,
    /// How far the computer's clock was from the night's time at the last look, s.
    offset_s: f64,
    /// When it was asked last whether the computer's clock is synchronised.
    asked: Option<Instant>,
    /// Ends the night.
    cancel: &'a Cancel,
    /// Where the telescope looks, as it stands now.
    schedule: Arc<SharedSchedule>,
    /// The schedule that a pause interrupts.
    before_pause: Option<Arc<Schedule>>,
    /// When a run through the focus was asked for.
    focus_asked: Option<Instant>,
    /// Whether a person skipped the last visit: the night waits until its planned end.
    waits: bool,
    /// A person's hand on the mount.
    hand: Option<Arc<Steering>>,
    /// Whether visits have settings of their own: then steps are told.
    sequence: bool,
}

impl Watch<'_> {
    /// Goes on where the log had told `target` last: the visit is the same one where it still goes on.
    fn go_on(&mut self, target: Target) {
        let (schedule, utc) = (self.schedule.get(), self.status.utc());
        let begun = schedule.slots().iter().filter(|slot| slot.from <= utc).count();
        let now = begun.checked_sub(1).and_then(|at| schedule.slots().get(at));
        let same = now.is_some_and(|slot| slot.target == target);
        self.told = if same { begun } else { begun.saturating_sub(1) };
        self.target = Some(target);
    }

    /// Waits for the devices' threads; gives the time at which the last of them ended.
    fn until_all_end(
        mut self,
        threads: &[JoinHandle<()>],
        live: bool,
        show: &mut dyn FnMut(Snapshot),
    ) -> Epoch {
        let begun = Instant::now();
        let utc = || DeviceClock::live().utc();
        let mut looked = Duration::ZERO;
        let mut room_at: Option<Duration> = None;
        if self.night.live.as_ref().is_some_and(|state| state.was_started()) {
            let (action, text) = (Control::Start.word().to_owned(), String::new());
            self.disk.event(self.status.utc(), What::Control { action, text });
        }
        while !threads.iter().all(JoinHandle::is_finished) {
            let night_utc = self.status.utc();
            self.tell_targets(night_utc);
            self.obey(night_utc, live);
            self.attend_focus(night_utc);
            if live {
                self.step_on(night_utc);
            }
            let now = begun.elapsed();
            if live && now.saturating_sub(looked) >= CLOCK {
                looked = now;
                self.look_at_clock();
            }
            let mut snapshot = self.status.snapshot();
            let schedule = self.schedule.get();
            let target = schedule.at(snapshot.utc);
            snapshot.target =
                target.filter(|t| t.target_kind != TargetKind::None).map(|t| t.name.clone());
            if let Some(state) = &self.night.live {
                state.collect(&snapshot, schedule.slots(), self.before_pause.is_some());
                if room_at.is_none_or(|at| now.saturating_sub(at) >= CLOCK) {
                    room_at = Some(now);
                    state.room(now.as_secs_f64());
                }
            }
            show(snapshot);
            let slept = Instant::now();
            std::thread::sleep(POLL);
            let stall = slept.elapsed().saturating_sub(POLL);
            if live && stall >= STALL {
                let stall_s = stall.as_secs_f64();
                self.disk.event(utc(), What::Stall { stall_s });
                self.status.say(format!("the program stood still for {stall_s:.1} s"));
            }
        }
        let end = self.night.ended.unwrap_or_else(|| self.status.utc());
        self.tell_targets(end);
        if live {
            self.disk.event(utc(), What::Clock(clock::measured()));
        }
        end
    }

    /// Tells of a step of the computer's clock. The night's time goes on as it was, until a synchronised source confirms the step and the plan is in UTC.
    fn look_at_clock(&mut self) {
        let now = DeviceClock::live().utc();
        let offset_s = clock_offset_s();
        let step_s = offset_s - self.offset_s;
        self.offset_s = offset_s;
        if step_s.abs() > STEP_S {
            let computer_utc = Some(format_utc(computer_utc(), 3));
            self.disk.event(now, What::ClockStep { step_s, computer_utc });
            self.status.say(format!(
                "the computer's clock stepped by {step_s:+.3} s; the night's own time goes on as it was"
            ));
            self.asked = None;
        }
        let due = self.asked.is_none_or(|asked| asked.elapsed() >= CONFIRM);
        if offset_s.abs() <= STEP_S || !self.night.in_utc || !due {
            return;
        }
        self.asked = Some(Instant::now());
        let state = clock::measured();
        if state.synchronised != Some(true) {
            return;
        }
        let step_s = adopt_computer_clock();
        self.offset_s = clock_offset_s();
        let utc = DeviceClock::live().utc();
        self.disk.event(utc, What::ClockAdopted { step_s });
        self.disk.event(utc, What::Clock(state));
        self.status.say(format!(
            "{} confirms the computer's clock: the night's time is corrected by {step_s:+.3} s",
            self.night.manifest.clock.method
        ));
        self.time_again(now, utc);
    }

    /// After a correction of the night's time from `before` to `now`: names the visits that are past without having been, and tells the present one.
    fn time_again(&mut self, before: Epoch, now: Epoch) {
        let schedule = self.schedule.get();
        let slots = schedule.slots();
        let missed = slots.iter().filter(|slot| {
            let planned = slot.target.target_kind != TargetKind::None;
            planned && slot.from > before && slot.to.is_some_and(|to| to <= now)
        });
        for slot in missed {
            let about = slot.target.name.clone();
            let error = "its visit was missed: by the corrected clock it is past".to_owned();
            self.status.say(format!("{about}: {error}"));
            self.disk.event(now, What::Error { about, error });
        }
        let begun = slots.iter().filter(|slot| slot.from <= now).count();
        self.told = begun;
        if let Some(slot) = begun.checked_sub(1).and_then(|last| slots.get(last)) {
            self.disk.event(now, What::Target(slot.target.clone()));
            self.target = Some(slot.target.clone());
        }
    }

    /// Does what was asked since the last look; each command is an event of the log.
    fn obey(&mut self, utc: Epoch, live: bool) {
        let Some(state) = &self.night.live else { return };
        while let Some(asked) = state.next_command() {
            let done = self.steer(&asked, utc, live);
            if done.is_ok() {
                let action = asked.control.word().to_owned();
                let text = asked.control.text();
                self.status.say(match text.is_empty() {
                    true => format!("{action}, by the page"),
                    false => format!("{action}: {text}"),
                });
                self.disk.event(utc, What::Control { action, text });
            }
            self.tell_targets(utc);
            asked.answer(done);
        }
    }

    fn steer(&mut self, asked: &Asked, utc: Epoch, live: bool) -> Result<String, ControlError> {
        let refused = |text: &str| Err(ControlError::Refused(text.to_owned()));
        if !live && !matches!(asked.control, Control::Stop | Control::Note(_)) {
            return refused("this night is virtual or played back: its visits are fixed");
        }
        let schedule = self.schedule.get();
        match &asked.control {
            Control::Start => refused("it has begun already"),
            Control::Note(_) => Ok("noted".into()),
            Control::Stop => {
                self.cancel.cancel();
                Ok("the night ends in good order".into())
            }
            Control::Expose { camera, exposure_s, gain } => {
                let Some(plan) = self.night.cameras.iter().find(|plan| plan.name == *camera) else {
                    return refused("there is no camera of this name");
                };
                if exposure_s.is_some_and(|exposure| exposure.get() > LONGEST_S) {
                    return refused("an exposure has at most 3600 s");
                }
                if gain.is_some() && plan.gain.is_none() {
                    let text = "the plan gives this camera no gain, to which it could return";
                    return refused(text);
                }
                self.schedule.wish(camera, CameraWish { exposure_s: *exposure_s, gain: *gain });
                Ok("from the next frame of the sky on".into())
            }
            Control::Pause | Control::Skip | Control::Repeat if self.schedule.is_focusing() => {
                refused("a camera goes through its focus: wait, or resume first")
            }
            Control::Pause if self.before_pause.is_some() => refused("it is paused already"),
            Control::Pause => {
                self.pause(utc);
                Ok("paused: what is recorded now belongs to no visit".into())
            }
            Control::Focus { camera } => self.ask_focus(camera, utc),
            Control::Resume if self.schedule.is_focusing() => {
                self.schedule.cancel_focus();
                Ok("after this position the focuser goes back to where it stood, then the plan goes on"
                    .into())
            }
            Control::Resume => match self.before_pause.take() {
                None => refused("it is not paused"),
                Some(plan) => {
                    self.exchange(schedule.resumed(&plan, utc), utc);
                    Ok("the plan goes on as it stands now".into())
                }
            },
            Control::Skip if self.before_pause.is_some() => refused("it is paused: resume first"),
            Control::Skip => match schedule.skipped(utc) {
                None => refused("no visit is under way"),
                Some(after) => {
                    // Whoever skips the last visit may want another one.
                    self.waits = after.is_over(utc);
                    self.exchange(after, utc);
                    Ok("the visit is over".into())
                }
            },
            Control::Repeat if self.before_pause.is_some() => refused("it is paused: resume first"),
            Control::Repeat => match schedule.repeated(utc) {
                Err(why) => refused(why),
                Ok(again) => {
                    let text = after_repeat(&schedule, &again, utc, self.night.end);
                    self.waits = false;
                    self.exchange(again, utc);
                    Ok(text)
                }
            },
            Control::Lock(_)
            | Control::Keep(_)
            | Control::Jog(_)
            | Control::Halt
            | Control::Park
            | Control::Follow => self.steer_mount(&asked.control).map_err(ControlError::Refused),
        }
    }

    fn pause(&mut self, utc: Epoch) {
        let schedule = self.schedule.get();
        self.before_pause = Some(schedule.clone());
        self.exchange(schedule.paused(utc), utc);
    }

    /// Asks a camera to go through its focus.
    fn ask_focus(&mut self, camera: &str, utc: Epoch) -> Result<String, ControlError> {
        let refused = |text: &str| Err(ControlError::Refused(text.to_owned()));
        let found = self.night.cameras.iter().find(|plan| plan.name == camera);
        if found.is_none_or(|found| found.focuser.is_none()) {
            return refused("the plan has no `focuser` for this camera");
        }
        if self.before_pause.is_some() && !self.schedule.is_focusing() {
            return refused("it is paused: resume first");
        }
        let schedule = self.schedule.get();
        let kind = schedule.at(utc).map_or(TargetKind::None, |target| target.target_kind);
        if !matches!(kind, TargetKind::Star | TargetKind::Sky | TargetKind::None) {
            return refused(
                "stars are needed: focus while the telescope is on a star, or on the sky",
            );
        }
        if !self.is_running(camera) {
            return refused("this camera is not at work at the moment");
        }
        if !self.schedule.ask_focus(camera, schedule) {
            return refused("a camera goes through its focus already");
        }
        self.focus_asked = Some(Instant::now());
        Ok("it goes through its focus after the present frame: what is recorded then belongs to no visit; Resume ends it".into())
    }

    fn is_running(&self, camera: &str) -> bool {
        let devices = self.status.snapshot().devices;
        devices.get(camera).is_some_and(|device| device.state == State::Running)
    }

    /// The night is paused once a camera goes through its focus, and goes on after it; an order that no camera takes is forgotten.
    fn attend_focus(&mut self, utc: Epoch) {
        let Some((camera, begun, done)) = self.schedule.focus_state() else { return };
        if begun && !done && self.before_pause.is_none() {
            self.pause(utc);
            self.tell_targets(utc);
        }
        let late = self.focus_asked.is_some_and(|asked| asked.elapsed() > UNTAKEN);
        if !done && (begun || !late) && self.is_running(&camera) {
            return;
        }
        if !done {
            let error = "the run through its focus did not come to its end".to_owned();
            self.status.say(format!("{camera}: {error}"));
            self.disk.event(utc, What::Error { about: camera, error });
        }
        if let Some(plan) = self.before_pause.take() {
            let schedule = self.schedule.get();
            self.exchange(schedule.resumed(&plan, utc), utc);
        }
        self.schedule.end_focus();
        self.tell_targets(utc);
    }

    /// Commands to the mount.
    fn steer_mount(&self, control: &Control) -> Result<String, String> {
        let Some(hand) = &self.hand else {
            return Err("this night moves no mount: its plan has no [mount]".into());
        };
        let place = |click: &Click| hand.place(&click.camera, click.start, click.place_px);
        match control {
            Control::Lock(click) => {
                let (middle, offset_arcsec) = place(click)?;
                hand.order(Order::Lock { middle, offset_arcsec })?;
                Ok("the mount takes this light for its target".into())
            }
            Control::Keep(click) => {
                let (_, offset_arcsec) = place(click)?;
                hand.order(Order::Keep { offset_arcsec })?;
                Ok("targets are kept there from now on".into())
            }
            Control::Jog(arcsec) => {
                let far = arcsec[0].hypot(arcsec[1]);
                if !(far.is_finite() && far <= FARTHEST_JOG_ARCSEC) {
                    return Err(format!(
                        "a jog of {far:.0}″, expected at most {FARTHEST_JOG_ARCSEC}″"
                    ));
                }
                hand.order(Order::Jog { arcsec: hand.along_axes(*arcsec) })?;
                Ok("the telescope goes beside".into())
            }
            Control::Halt => {
                hand.set_want(Want::Stand);
                Ok("the mount stands until it is told to follow".into())
            }
            Control::Park => {
                hand.set_want(Want::Park);
                Ok("the mount is parked until it is told to follow".into())
            }
            _ => {
                hand.follow();
                Ok("the mount follows the plan".into())
            }
        }
    }

    /// Another schedule from `utc` on: what began before was told.
    fn exchange(&mut self, schedule: Schedule, utc: Epoch) {
        self.told = schedule.slots().iter().filter(|slot| slot.from < utc).count();
        self.schedule.set(schedule);
    }

    fn tell_targets(&mut self, utc: Epoch) {
        let schedule = self.schedule.get();
        while let Some(slot) = schedule.slots().get(self.told) {
            if slot.from > utc {
                break;
            }
            // A slot that had ended before the night began is none of it.
            if slot.to.is_none_or(|to| to > self.night.manifest.start_utc) {
                let from = slot.from.max(self.night.manifest.start_utc);
                // The steps of a visit are one stay.
                if !slot.continues() || self.target.as_ref() != Some(&slot.target) {
                    self.disk.event(from, What::Target(slot.target.clone()));
                    self.target = Some(slot.target.clone());
                }
                if let Some(step) = slot.step.as_ref().filter(|_| self.sequence) {
                    self.disk.event(from, What::Step { number: step.number });
                }
            }
            self.told += 1;
        }
    }

    /// Goes on to the next step once each camera with a number of frames has them all, and ends the night after its last visit, where that comes early.
    fn step_on(&mut self, utc: Epoch) {
        self.end_with_visits(utc);
        let schedule = self.schedule.get();
        let Some((slot, step)) = schedule.slot(utc).and_then(|s| Some((s, s.step.as_ref()?)))
        else {
            return;
        };
        let kind = Some(slot.target.target_kind);
        let mut counted = self
            .night
            .cameras
            .iter()
            .filter(|camera| Exposing::of(camera, kind, Some(step)).frames.is_some());
        let done = |camera: &CameraPlan| self.schedule.has_finished(&camera.name, step.number);
        let any = counted.clone().next().is_some();
        if any
            && counted.all(done)
            && let Some(after) = schedule.stepped(utc)
        {
            self.exchange(after, utc);
            self.end_with_visits(utc);
        }
    }

    /// Ends the night once its last visit has ended, where nothing else ends it and nobody waits.
    fn end_with_visits(&self, utc: Epoch) {
        let stays = self.before_pause.is_some() || self.waits;
        if self.night.ends_with_visits && !stays && self.schedule.get().is_over(utc) {
            self.schedule.end();
        }
    }
}
