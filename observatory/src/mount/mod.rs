//! The mount's thread: it is where the present visit wants it, and between two visits where the next one does.

mod aim;
mod check;
mod job;
mod plan;
mod sights;

pub use aim::{Aim, AimState, Ready, Waiting};
pub(crate) use check::check_mount;
pub use job::{Job, JobError, allowed};
pub use plan::{MountPlan, View};
pub use sights::Sights;

use self::job::next_job;
use self::plan::axes_word;
use self::sights::CameraFinder;
use crate::clock;
use crate::schedule::Schedule;
use crate::status::MountStatus;
use crate::telescope::watchdog::Process;
use crate::telescope::{
    Certainty, Danger, Guard, Parked, PassPlan, SunCone, TrackError, TrackOptions, TrackState,
    TrackStep, Tracker, Weather, WeatherFile, park,
};
use crate::worker::{READY, SOON, Worker};
use hifitime::{Epoch, Unit};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use sunglint_drivers::device::{DeviceError, Finder, Mount, MountAxes, MountSite};
use sunglint_formats::session::{Target, What};
use sunglint_formats::toml::Positive;
use sunglint_radiometry::station::Station;

const DEVICE: &str = "mount";
/// How often a mount that has nothing to do looks at the schedule.
const LOOK: Duration = Duration::from_millis(200);
/// Time between two looks at weather and Sun, s.
const SKY_S: f64 = 5.0;
/// An end that is nearer than this is reached, s.
const LOOK_S: f64 = 1.0;
/// Time between two lines of the log, s.
const LINE_S: f64 = 1.0;

/// A mount at work.
#[derive(Debug)]
pub struct MountWork {
    plan: MountPlan,
    station: Station,
    aim: Arc<Aim>,
    sights: Option<Arc<Sights>>,
    /// Longest time from one frame of its camera to the next, s.
    frame_s: f64,
    /// This program, which is the watchdog, too.
    program: Option<PathBuf>,
    /// Visits that were given up: target and beginning.
    barred: Vec<(Target, Epoch)>,
    weather: Option<WeatherFile>,
    /// When weather and Sun were looked at, and why the telescope is to be parked.
    looked: Option<Epoch>,
    closed: Option<String>,
    parked: bool,
    told: Option<(String, Epoch)>,
}

impl MountWork {
    /// A mount as planned. `frame_s` is the longest time between two frames of its camera.
    pub fn new(
        plan: MountPlan,
        station: Station,
        aim: Arc<Aim>,
        sights: Option<Arc<Sights>>,
        frame_s: f64,
        program: Option<PathBuf>,
    ) -> Self {
        let age = Duration::from_secs_f64(plan.weather_age_s.map_or(300.0, Positive::get));
        let weather = plan.weather.as_ref().map(|path| WeatherFile::new(path, age));
        Self {
            plan,
            station,
            aim,
            sights,
            frame_s,
            program,
            barred: Vec::new(),
            weather,
            looked: None,
            closed: None,
            parked: false,
            told: None,
        }
    }

    /// Opens the mount and points it as the schedule says until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        self.aim.set(AimState::Away);
        let done = self.point(worker);
        if done.is_err() {
            self.aim.set(AimState::Lost);
        }
        done
    }

    fn point(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut mount = worker.opener.mount(&self.plan, &worker.within(READY))?;
        worker.opened(mount.as_mut())?;
        let abilities = mount.abilities().clone();
        let cone = SunCone::default().with_limit_deg(self.plan.sun_limit_deg());
        let guard = Guard::new(&self.station.site, abilities.axes, abilities.tells_pier_side, cone)
            .with_horizon(self.station.horizon.clone(), self.plan.min_elevation_deg());
        if self.plan.set_site {
            let place = self.station.site.geodetic();
            let site = MountSite {
                latitude_deg: place.latitude_deg,
                longitude_deg: place.longitude_deg,
                height_m: place.height_m,
            };
            mount.set_site(site, worker.clock.utc(), &worker.within(SOON))?;
        }
        let site = mount.site(&worker.within(SOON))?;
        let mut dog = None;
        if worker.clock.is_live() {
            let state = clock::measured();
            let certainty = Certainty { synchronised: state.synchronised, error_s: state.error_s };
            let clock = certainty.check().err().filter(|_| !self.plan.trust_clock);
            if let Some(doubt) = guard.check_site(site).err().or(clock) {
                return Err(self.refuse(&doubt.to_string(), worker));
            }
            let Some(program) = &self.program else {
                return Err(self.refuse("there is no watchdog: nothing is moved", worker));
            };
            match Process::start(program, &self.plan.device) {
                Ok(process) => dog = Some(process),
                Err(error) => {
                    self.tell(&error.to_string(), worker);
                    let reason = "no watchdog can reach it: nothing is moved";
                    return Err(DeviceError::NotReady { device: DEVICE, reason });
                }
            }
        }
        worker.works();
        let done = self.follow_schedule(mount.as_mut(), &guard, &mut dog, worker);
        // The night is over, or the mount was lost: it does not go on turning by itself.
        let stopped = mount.stop(&worker.even_so(SOON));
        if self.plan.park && stopped.is_ok() {
            // Ctrl-C reaches the watchdog, too, which stops every motion from then on. Parking ends by itself.
            drop(dog.take());
            self.park(mount.as_mut(), &guard, None, worker);
        }
        done.and(stopped)
    }

    /// Says a doubt; nothing moves for the rest of the night.
    fn refuse(&self, why: &str, worker: &mut Worker) -> DeviceError {
        self.tell(why, worker);
        worker.permanent = true;
        DeviceError::NotReady {
            device: DEVICE,
            reason: "it is not safe to move it: nothing is moved",
        }
    }

    fn tell(&self, error: &str, worker: &Worker) {
        let (about, error) = (worker.name.clone(), error.to_owned());
        worker.status.say(format!("{about}: {error}"));
        worker.disk.event(worker.clock.utc(), What::Error { about, error });
    }

    fn follow_schedule(
        &mut self,
        mount: &mut dyn Mount,
        guard: &Guard,
        dog: &mut Option<Process>,
        worker: &mut Worker,
    ) -> Result<(), DeviceError> {
        while !worker.is_over() {
            if let Some(dog) = dog.as_mut() {
                dog.tick();
                if !dog.watches() {
                    let reason = "its watchdog has gone";
                    return Err(DeviceError::NotReady { device: DEVICE, reason });
                }
            }
            self.look_up(guard, worker);
            if self.closed.is_some() {
                self.aim.set(AimState::Away);
                if !self.parked {
                    mount.stop(&worker.within(SOON))?;
                    if self.plan.park {
                        self.park(mount, guard, dog.as_ref(), worker);
                    }
                    self.parked = true;
                }
                self.rest(worker);
                continue;
            }
            let schedule = worker.schedule.get();
            let barred = &self.barred;
            let is_barred = |target: &Target, from: Epoch| {
                barred.iter().any(|(known, at)| known == target && *at == from)
            };
            let job = next_job(&schedule, worker.clock.utc(), worker.end, &is_barred);
            let Some(job) = job else {
                self.line("stopped", None, mount.abilities().axes, worker);
                self.aim.set(AimState::Away);
                self.rest(worker);
                continue;
            };
            self.follow(&job, &schedule, mount, guard, dog, worker)?;
        }
        Ok(())
    }

    fn rest(&self, worker: &Worker) {
        // Cut short by Ctrl-C alone.
        let _ = worker.within(Duration::MAX).sleep(LOOK);
    }

    /// Follows the target of one visit until it is over or something else is wanted.
    fn follow(
        &mut self,
        job: &Job,
        schedule: &Arc<Schedule>,
        mount: &mut dyn Mount,
        guard: &Guard,
        dog: &mut Option<Process>,
        worker: &mut Worker,
    ) -> Result<(), DeviceError> {
        let abilities = mount.abilities().clone();
        let now = worker.clock.utc();
        let path = match job.path(&self.plan, &self.station, abilities.axes, guard, now) {
            Ok(path) => path,
            Err(error) => {
                self.bar(job, &error.to_string(), worker);
                return Ok(());
            }
        };
        let stands = path.angles_of(&mount.reading(&worker.within(SOON))?);
        let name = &job.visit.target.name;
        let plan = PassPlan::new(name, &path, guard, &abilities, Some(stands));
        if let Some(why) = &plan.refused {
            self.bar(job, why, worker);
            return Ok(());
        }
        if let Some(keyhole) = &plan.keyhole {
            worker.status.say(format!(
                "{name}: the mount cannot follow through the pole of its axes: {:.0} s are lost",
                keyhole.lost_s()
            ));
        }
        self.parked = false;
        self.aim.set(AimState::Away);
        let mut finder = self.sights.as_ref().filter(|_| job.is_seen()).map(|sights| {
            sights.clear();
            CameraFinder(sights.clone())
        });
        let mut options = TrackOptions::default();
        options.watch_clock = worker.clock.is_live();
        options.estimator.frame_s = self.frame_s;
        options.latency_s = self.plan.latency_s.map_or(options.latency_s, |latency| latency.get());
        options.reach_arcsec = match (self.plan.reach_arcsec, &self.sights) {
            (Some(reach), _) => reach.get(),
            (None, Some(sights)) if sights.half_arcsec() > 0.0 => sights.half_arcsec(),
            _ => options.reach_arcsec,
        };
        let finder = finder.as_mut().map(|finder| finder as &mut dyn Finder);
        let clock = worker.clock.clone();
        let mut tracker = Tracker::new(&path, guard, mount, finder, clock, options);
        let cancel = worker.cancel.clone();
        let axes = abilities.axes;
        let ended = tracker.run(&cancel, &mut |step| {
            let on = self.step(job, step, axes, worker);
            self.aim.set(on);
            self.look_up(guard, worker);
            let watched = dog.as_mut().is_none_or(|dog| {
                dog.tick();
                dog.watches()
            });
            let goes_on = watched
                && self.closed.is_none()
                && !worker.is_over()
                && (Arc::ptr_eq(schedule, &worker.schedule.get()) || job.is_still(worker));
            match goes_on && worker.clock.utc() < job.to {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            }
        });
        drop(tracker);
        self.aim.set(AimState::Away);
        match ended {
            Ok(_) => {
                // Below the horizon, or near the Sun, before the visit ends.
                let ends = path.epoch(path.seconds());
                if ends + 2.0 * Unit::Second < job.to
                    && worker.clock.utc() + LOOK_S * Unit::Second >= ends
                {
                    self.barred.push((job.visit.target.clone(), job.visit.from));
                }
                Ok(())
            }
            // The prediction is not where it was: it is acquired again, from the beginning.
            Err(TrackError::Danger(danger @ Danger::ClockStep { .. })) => {
                self.tell(&danger.to_string(), worker);
                Ok(())
            }
            Err(TrackError::Device(error)) => Err(error),
            Err(error @ TrackError::DoesNotFollow { .. }) => {
                self.tell(&error.to_string(), worker);
                let reason = "it does not do what it is told: it was stopped";
                Err(DeviceError::NotReady { device: DEVICE, reason })
            }
            Err(error) => {
                self.bar(job, &error.to_string(), worker);
                Ok(())
            }
        }
    }

    /// A visit that cannot be: the mount stands, and the night goes on with the next one.
    fn bar(&mut self, job: &Job, why: &str, worker: &Worker) {
        self.barred.push((job.visit.target.clone(), job.visit.from));
        self.tell(&format!("{} is not followed: {why}", job.visit.target.name), worker);
    }

    /// Tells of a step; gives what the cameras are told.
    fn step(&mut self, job: &Job, step: &TrackStep, axes: MountAxes, worker: &Worker) -> AimState {
        let word = match step.state {
            TrackState::Slewing => "slewing",
            TrackState::Waiting => "waiting",
            TrackState::Predicted => "predicted",
            TrackState::Searching => "searching",
            TrackState::Locked => "locked",
            TrackState::Coasting => "coasting",
        };
        self.line(word, Some(step), axes, worker);
        let target = || job.visit.target.clone();
        let near = step.error_arcsec < self.plan.on_target_arcsec();
        match step.state {
            TrackState::Slewing | TrackState::Waiting => AimState::Away,
            TrackState::Predicted | TrackState::Locked if near => AimState::On(target()),
            _ => AimState::Looking(target()),
        }
    }

    /// A line of the log where the state changed or a second has passed, and the live state.
    fn line(&mut self, state: &str, step: Option<&TrackStep>, axes: MountAxes, worker: &Worker) {
        let utc = worker.clock.utc();
        worker.status.mount(
            &worker.name,
            MountStatus {
                state: state.to_owned(),
                error_arcsec: step.map(|step| step.error_arcsec),
                seen_arcsec: step.and_then(|step| step.seen_arcsec),
            },
        );
        let changed = self.told.as_ref().is_none_or(|(before, _)| before != state);
        let due = step.is_some()
            && self.told.as_ref().is_none_or(|(_, at)| (utc - *at).to_seconds() >= LINE_S - 1e-3);
        if !changed && !due {
            return;
        }
        self.told = Some((state.to_owned(), utc));
        let satellite = step.filter(|step| step.ahead_s != 0.0);
        let what = What::Mount {
            device: worker.name.clone(),
            state: state.to_owned(),
            axes: axes_word(axes).to_owned(),
            target_deg: step.map(|step| step.target_deg),
            read_deg: step.map(|step| step.mount_deg),
            commanded_deg_s: step.map(|step| step.commanded_deg_s),
            error_arcsec: step.map(|step| step.error_arcsec),
            seen_arcsec: step.and_then(|step| step.seen_arcsec),
            ahead_s: satellite.map(|step| step.ahead_s),
            left_arcsec: satellite.map(|step| step.left_arcsec),
            changed,
        };
        worker.disk.event(utc, what);
    }

    /// Looks at the weather and the Sun every five seconds: whether the telescope is to be parked, and why.
    fn look_up(&mut self, guard: &Guard, worker: &Worker) {
        let now = worker.clock.utc();
        if self.looked.is_some_and(|looked| (now - looked).to_seconds() < SKY_S) {
            return;
        }
        self.looked = Some(now);
        let bad = self.weather.as_ref().and_then(|file| match file.look(SystemTime::now()) {
            Weather::Unfit(why) => Some(format!("the weather is not fit: {why}")),
            Weather::Fit => None,
        });
        let sun = guard.sun(now).altitude_deg;
        let rises = guard.sun(now + 5.0 * Unit::Minute).altitude_deg > sun;
        let dawn = rises && sun > self.plan.dawn_deg() && self.plan.park;
        let dawn = dawn.then(|| format!("dawn: the Sun is at {sun:.1}°"));
        let closed = bad.or(dawn);
        match (&self.closed, &closed) {
            (None, Some(why)) => self.tell(why, worker),
            (Some(_), None) => worker.status.say(format!("{}: goes on", worker.name)),
            _ => {}
        }
        self.closed = closed;
    }

    fn park(
        &mut self,
        mount: &mut dyn Mount,
        guard: &Guard,
        dog: Option<&Process>,
        worker: &Worker,
    ) {
        if !mount.abilities().parks {
            return;
        }
        let axes = mount.abilities().axes;
        self.line("parking", None, axes, worker);
        let tick = &mut || {
            if let Some(dog) = dog {
                dog.tick();
            }
        };
        match park(mount, guard, &worker.clock, tick) {
            Ok(Parked::Parked) => self.line("parked", None, axes, worker),
            Ok(other) => self.tell(other.text(), worker),
            Err(error) => {
                self.tell(&format!("it is not known whether it is parked: {error}"), worker);
            }
        }
    }
}
