//! A night from its first frame to its last: one thread a device, one that writes, and this one, which looks.

use super::camera::CameraWork;
use super::clock::{self, StepWatch};
use super::counter::CounterWork;
use super::device::Post;
use super::disk;
use super::opener::{DeviceClock, Opener};
use super::plan::{CameraPlan, CounterPlan};
use super::pointing::Pointing;
use super::schedule::Schedule;
use super::status::{Snapshot, Status};
use anyhow::{Context as _, anyhow, bail};
use hifitime::Epoch;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use sunglint_drivers::clock::Cancel;
use sunglint_formats::session::{Manifest, SessionWriter, Storage, TargetKind, What};
use sunglint_radiometry::station::Station;

/// How often this thread looks at the others.
const LOOK: Duration = Duration::from_millis(50);
/// How often it looks at the clock.
const CLOCK: Duration = Duration::from_secs(1);

/// All that a night is made of.
#[derive(Debug)]
pub struct Night {
    /// The session's folder, to be made.
    pub root: PathBuf,
    /// On which disk.
    pub storage: Arc<dyn Storage>,
    /// What goes into `session.toml`.
    pub manifest: Manifest,
    /// The configuration as used.
    pub files: Vec<(String, Vec<u8>)>,
    /// The station.
    pub station: Station,
    /// The cameras.
    pub cameras: Vec<CameraPlan>,
    /// The counters.
    pub counters: Vec<CounterPlan>,
    /// Where they come from.
    pub opener: Arc<dyn Opener>,
    /// Where the telescope looks.
    pub schedule: Schedule,
    /// When it ends; `None`: when it is stopped.
    pub end: Option<Epoch>,
    /// When it ended, for one that is played back.
    pub ended: Option<Epoch>,
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
    /// Devices that gave nothing.
    pub silent: Vec<String>,
    /// Rows and frames that are not on the disk.
    pub not_written: u64,
    /// What the disk said at the end.
    pub disk_error: Option<String>,
    /// Whether it was stopped before its end.
    pub stopped: bool,
}

impl Night {
    /// Runs until the night's end, or until `cancel` is set. `show` is called every twentieth of a second.
    ///
    /// # Errors
    /// A counter that hands over no tags is asked for them; the folder is there or cannot be made; the system starts no thread. All else is in the summary.
    pub fn run(self, cancel: &Cancel, show: &mut dyn FnMut(Snapshot)) -> anyhow::Result<Summary> {
        if let Some(plan) =
            self.counters.iter().find(|p| p.raw_tags && !self.opener.streams_tags(p))
        {
            bail!(
                "counter {}: {} hands over no time tags, only bins: leave out its `raw_tags`, or take a counter that does \
                 (timetagger, sim-timetagger)",
                plan.name,
                plan.device
            );
        }
        let start = self.manifest.start_utc;
        let live = self.names().all(|name| self.opener.clock(name).is_live());
        let status = Arc::new(Status::new(start, live));
        let writer =
            SessionWriter::create(self.storage.clone(), &self.root, &self.manifest, &self.files)?;
        let (disk, writing) =
            disk::start(writer, status.clone(), live).context("cannot start a thread")?;
        let schedule = Arc::new(self.schedule.clone());
        let post = |name: &str| Post {
            name: name.to_owned(),
            clock: self.opener.clock(name),
            opener: self.opener.clone(),
            cancel: cancel.clone(),
            disk: disk.clone(),
            schedule: schedule.clone(),
            end: self.end,
            status: status.clone(),
            lost_at: None,
            again_in: Duration::ZERO,
        };
        let mut threads: Vec<JoinHandle<()>> = Vec::new();
        for plan in &self.cameras {
            let mut work = CameraWork::new(plan.clone(), Pointing::new(self.station.clone()));
            let post = post(&plan.name);
            threads.push(thread(&plan.name, move || post.supervise(|post| work.run(post)))?);
        }
        for plan in &self.counters {
            let mut work = CounterWork::new(plan.clone());
            let post = post(&plan.name);
            threads.push(thread(&plan.name, move || post.supervise(|post| work.run(post)))?);
        }
        let watch = Watch { night: &self, status: &status, disk: &disk, told: 0 };
        let utc = watch.until_all_end(&threads, live, show);
        let crashed = threads.into_iter().filter_map(|thread| thread.join().err()).count();
        // The writer ends once nobody can send to it any more.
        drop(disk);
        let writing = writing.join().map_err(|_| anyhow!("the thread that writes has crashed"))?;
        let stopped = cancel.is_cancelled();
        let ended = writing.finish(utc, if stopped { "stopped" } else { "done" });
        for trouble in &ended.troubles {
            status.disk_trouble(trouble);
        }
        status.set_lost(ended.lost, !ended.troubles.is_empty());
        let last = status.snapshot();
        show(last.clone());
        if crashed > 0 {
            return Err(anyhow!("{crashed} device threads have crashed; what they had is written"));
        }
        Ok(self.summary(utc, &last, stopped))
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        let cameras = self.cameras.iter().map(|plan| plan.name.as_str());
        cameras.chain(self.counters.iter().map(|plan| plan.name.as_str()))
    }

    fn summary(&self, utc: Epoch, last: &Snapshot, stopped: bool) -> Summary {
        let of = |name: &str| last.devices.get(name).cloned().unwrap_or_default();
        let each = |value: &dyn Fn(&str) -> u64| {
            self.names().map(|name| (name.to_owned(), value(name))).collect::<BTreeMap<_, _>>()
        };
        Summary {
            root: self.root.clone(),
            utc,
            taken: each(&|name| of(name).taken),
            losses: each(&|name| of(name).losses),
            silent: self.names().filter(|n| of(n).taken == 0).map(str::to_owned).collect(),
            not_written: last.missing,
            disk_error: last.disk_error.clone(),
            stopped,
        }
    }
}

fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> anyhow::Result<JoinHandle<()>> {
    let builder = std::thread::Builder::new().name(name.to_owned());
    builder.spawn(work).with_context(|| format!("cannot start a thread for {name}"))
}

/// Looks at the devices: notes where the telescope goes, and what the clock does.
struct Watch<'a> {
    night: &'a Night,
    status: &'a Status,
    disk: &'a disk::Disk,
    /// Slots of the schedule that the log has.
    told: usize,
}

impl Watch<'_> {
    /// Waits for the devices' threads; gives the time at which the last of them ended.
    fn until_all_end(
        mut self,
        threads: &[JoinHandle<()>],
        live: bool,
        show: &mut dyn FnMut(Snapshot),
    ) -> Epoch {
        let begun = Instant::now();
        let utc = || DeviceClock::live().utc();
        let (mut watch, mut looked) = (StepWatch::new(utc(), Duration::ZERO), Duration::ZERO);
        while !threads.iter().all(JoinHandle::is_finished) {
            self.tell_targets(self.status.utc());
            let now = begun.elapsed();
            if live && now.saturating_sub(looked) >= CLOCK {
                looked = now;
                if let Some(step_s) = watch.look(utc(), begun.elapsed()) {
                    self.disk.event(utc(), What::ClockStep { step_s });
                    self.status.say(format!("the computer's clock stepped by {step_s:+.3} s"));
                }
            }
            let mut snapshot = self.status.snapshot();
            let target = self.night.schedule.at(snapshot.utc);
            snapshot.target =
                target.filter(|t| t.target_kind != TargetKind::None).map(|t| t.name.clone());
            show(snapshot);
            std::thread::sleep(LOOK);
        }
        let end = self.night.ended.unwrap_or_else(|| self.status.utc());
        self.tell_targets(end);
        if live {
            self.disk.event(utc(), What::Clock(clock::measured()));
        }
        end
    }

    fn tell_targets(&mut self, utc: Epoch) {
        while let Some(slot) = self.night.schedule.slots().get(self.told) {
            if slot.from > utc {
                break;
            }
            // A slot that had ended before the night began is none of it.
            if slot.to.is_none_or(|to| to > self.night.manifest.start_utc) {
                let from = slot.from.max(self.night.manifest.start_utc);
                self.disk.event(from, What::Target(slot.target.clone()));
            }
            self.told += 1;
        }
    }
}
