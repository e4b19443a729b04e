//! The mount's thread: it is where the present visit wants it, and between two visits where the next one does.

mod aim;
mod check;
mod job;
mod plan;
mod sights;
mod steer;

pub(crate) use aim::needs_mount;
pub use aim::{Aim, AimState, Ready, Waiting};
pub(crate) use check::check_mount;
pub use job::{Job, JobError, allowed};
pub use plan::{MountPlan, PlanAxes, View};
pub use sights::Sights;
pub use steer::{Steering, Want};

use self::check::REFRACTS;
use self::job::next_job;
use self::plan::axes_word;
use self::sights::CameraFinder;
use crate::clock;
use crate::schedule::Schedule;
use crate::status::MountStatus;
use crate::telescope::watchdog::{Process, Pulse};
use crate::telescope::{
    Certainty, Danger, Guard, PARK_WITHIN, Parked, PassPlan, SunCone, TargetPath, TrackError,
    TrackOptions, TrackState, TrackStep, Tracker, Weather, WeatherFile, angles, direction, park,
};
use crate::worker::{READY, SOON, Worker};
use glam::DVec3;
use hifitime::{Epoch, Unit};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    DeviceError, Finder, Mount, MountAbilities, MountAxes, MountMotion, MountSite,
};
use sunglint_formats::session::{Target, What};
use sunglint_radiometry::sky::{AzimuthAltitude, EarthOrientation};
use sunglint_radiometry::station::Station;

const DEVICE: &str = "mount";
/// How often a mount that has nothing to do looks at the schedule.
const LOOK: Duration = Duration::from_millis(200);
/// Time between two looks at weather, Sun, and a clock in doubt.
const SKY: Duration = Duration::from_secs(5);
/// Time between two lines of the log, s.
const LINE: Duration = Duration::from_millis(999);
/// Time between two tries to park, and between two lines about the Sun.
const MINUTE: Duration = Duration::from_secs(60);
/// Time that parking may take, and two looks, min.
const PARKS_MIN: f64 = 3.25;
/// The mount lacks what the plan needs.
const UNTOLD: &str = "`camera_angle_pier` says on which side of the pier `camera_angle_deg` holds, and this mount does not say on which side it hangs: its frames correct nothing (of a fork: `german = false`)";
/// A plan for a German mount lacks this.
const NO_SIDE: &str = "this mount turns over at the meridian, and its camera is upside down after it: on which side of the pier `camera_angle_deg` holds is not said (`camera_angle_pier`, east or west; `pier` in the events of a session): its frames correct nothing";
/// A star showed that the camera hangs otherwise than the plan says.
const MISLED: &str = "its camera does not see the axes as `camera_angle_deg` and `camera_mirrored` say: when the mount moves, a star does not go the way that it should in the frames; they correct nothing any more, the mount follows the prediction (`sunglint goto … --solve` measures both; of a mount that turns over `camera_angle_pier`)";
/// The program's own watchdog stopped the mount.
const TAKEN_UP: &str = "the program stood still for more than 0.5 s, and its own watchdog stopped the mount: it is taken up again with a new watchdog";
/// How far ahead of the Sun a telescope that stands is moved away, min.
const AHEAD_MIN: f64 = 10.0;

/// A mount at work.
#[derive(Debug)]
pub struct MountWork {
    plan: MountPlan,
    station: Station,
    aim: Arc<Aim>,
    sights: Option<Arc<Sights>>,
    /// A person's hand.
    hand: Arc<Steering>,
    /// Longest time from one frame of its camera to the next, s.
    frame_s: f64,
    /// This program, which is the watchdog, too.
    program: Option<PathBuf>,
    /// Visits that were given up: target and beginning.
    barred: Vec<(Target, Epoch)>,
    weather: Option<WeatherFile>,
    /// When weather and Sun were looked at, by the device's clock, and why the telescope is to be parked.
    looked: Option<Duration>,
    closed: Option<String>,
    bad_weather: bool,
    /// Whether it was stopped, and parked, since it is closed; and when parking is tried again.
    stands: bool,
    parked: bool,
    park_at: Option<Duration>,
    park_said: Option<&'static str>,
    told: Option<(String, Duration)>,
    /// The person's wish at the last look.
    wanted: Want,
    /// Azimuth and altitude where it stands, and the Sun's distance from there, deg.
    at_deg: Option<(AzimuthAltitude, f64)>,
    /// The visit in which somebody else stopped the mount.
    by_hand: Option<(Target, Epoch)>,
    /// Whether its camera was seen to be turned or mirrored otherwise than the plan says.
    misled: bool,
    /// Whether a parked mount may be freed: before the night's first motion, and after we parked it.
    may_unpark: bool,
    /// When a mount that stands was held against the Sun, and when it was said that the Sun is near.
    sun_looked: Option<Duration>,
    sun_told: Option<Duration>,
    /// Whether the clock is known to be right; when that was asked, and what was wrong.
    certain: bool,
    doubted: Option<Duration>,
    doubt: Option<String>,
}

impl MountWork {
    /// A mount as planned. `frame_s` is the longest time between two frames of its camera.
    pub fn new(
        plan: MountPlan,
        station: Station,
        aim: Arc<Aim>,
        sights: Option<Arc<Sights>>,
        hand: Arc<Steering>,
        frame_s: f64,
        program: Option<PathBuf>,
    ) -> Self {
        let age = plan.weather_age();
        let weather = plan.weather.as_ref().map(|path| WeatherFile::new(path, age));
        Self {
            plan,
            station,
            aim,
            sights,
            hand,
            frame_s,
            program,
            barred: Vec::new(),
            weather,
            looked: None,
            closed: None,
            bad_weather: false,
            stands: false,
            parked: false,
            park_at: None,
            park_said: None,
            told: None,
            wanted: Want::Follow,
            at_deg: None,
            by_hand: None,
            misled: false,
            may_unpark: true,
            sun_looked: None,
            sun_told: None,
            certain: false,
            doubted: None,
            doubt: None,
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
        // A mount whose line broke may still go on at its last rate.
        halt(mount.as_mut(), &worker.within(SOON))?;
        mount.know(&self.plan.known());
        let abilities = mount.abilities().clone();
        if abilities.refracts == Some(true) && self.plan.refraction {
            self.plan.refraction = false;
            worker.status.say(format!("{}: {REFRACTS}", worker.name));
        }
        let cone = SunCone::default().with_limit_deg(self.plan.sun_limit_deg());
        let guard = Guard::of(&self.station.site, &abilities, cone)
            .with_horizon(self.station.horizon.clone(), self.plan.min_elevation_deg());
        let mut dog = None;
        self.trust_clock_or_ask(worker);
        if is_real(worker) {
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
        if self.sights.is_some() && !self.knows_side(&abilities) {
            self.tell(if abilities.tells_pier_side { NO_SIDE } else { UNTOLD }, worker);
        }
        worker.works();
        let done = self.follow_schedule(mount.as_mut(), &guard, &mut dog, worker);
        // The night is over, or the mount was lost: it does not go on turning by itself.
        let stopped = halt(mount.as_mut(), &worker.even_so(SOON));
        if let Err(error) = &stopped {
            self.tell(&format!("it could not be stopped over this connection: {error}"), worker);
            // It stops the mount over its own connection.
            drop(dog.take());
        }
        // After an error the mount is opened again at once; one that does not do what it is told is not moved.
        let orderly = match &done {
            Ok(()) => true,
            Err(DeviceError::NotReady { .. }) => false,
            Err(_) => worker.is_over(),
        };
        // What a person stopped is not moved by the night's end.
        if self.plan.park
            && stopped.is_ok()
            && orderly
            && self.hand.want() != Want::Stand
            && !self.park(mount.as_mut(), &guard, &mut dog, worker)
        {
            // It may be on its way still: the watchdog stops it, and ends.
            drop(dog.take());
        }
        if let Some(dog) = dog {
            dog.done();
        }
        done.and(stopped)
    }

    /// Asks the clock anew before the next motion, where it counts.
    fn trust_clock_or_ask(&mut self, worker: &Worker) {
        self.certain = !is_real(worker) || self.plan.trust_clock;
        self.doubted = None;
    }

    /// Whether the clock is known to be right. One that is not is asked again every five seconds.
    fn is_certain(&mut self, worker: &Worker) -> bool {
        if self.certain || !is_due(&mut self.doubted, SKY, worker) {
            return self.certain;
        }
        let state = clock::measured();
        let certainty = Certainty { synchronised: state.synchronised, error_s: state.error_s };
        match certainty.check() {
            Ok(()) => {
                self.certain = true;
                if self.doubt.take().is_some() {
                    worker.status.say(format!("{}: the clock is right: goes on", worker.name));
                }
            }
            Err(danger) => {
                let why = danger.to_string();
                if self.doubt.as_ref() != Some(&why) {
                    self.tell(&why, worker);
                    self.doubt = Some(why);
                }
            }
        }
        self.certain
    }

    /// Tells the mount its site and the time, where the plan wants it, and asks for the site.
    fn check_site(
        &self,
        mount: &mut dyn Mount,
        guard: &Guard,
        worker: &mut Worker,
    ) -> Result<(), DeviceError> {
        if self.plan.set_site {
            let place = self.station.site.geodetic();
            let site = MountSite {
                latitude_deg: place.latitude_deg,
                longitude_deg: place.longitude_deg,
                height_m: place.height_m,
            };
            mount.set_site(site, worker.clock.utc(), &worker.within(SOON))?;
        }
        let doubt = guard.doubt(mount, &worker.within(SOON))?;
        match doubt.filter(|_| is_real(worker)) {
            Some(doubt) => Err(self.refuse(&doubt.to_string(), worker)),
            None => Ok(()),
        }
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
        let mut placed = false;
        while !worker.is_over() {
            if let Some(dog) = dog.as_mut()
                && dog.beat().is_break()
            {
                let reason = match dog.was_silent() {
                    true => TAKEN_UP,
                    false => "its watchdog has gone",
                };
                return Err(DeviceError::NotReady { device: DEVICE, reason });
            }
            self.look_up(guard, worker);
            if !self.is_certain(worker) {
                self.aim.set(AimState::Standing);
                self.keep_from_sun(mount, guard, dog, worker)?;
                self.rest(worker);
                continue;
            }
            if !placed {
                self.check_site(mount, guard, worker)?;
                placed = true;
            }
            let want = self.hand.want();
            if want != self.wanted {
                // A parking that failed may still be on its way.
                self.stands &= want != Want::Stand;
                self.park_at = None;
                self.wanted = want;
            }
            if self.closed.is_some() || want != Want::Follow {
                self.aim.set(AimState::Standing);
                if want != Want::Follow {
                    let word = if self.parked { "parked" } else { "stopped" };
                    self.line(word, None, mount.abilities().axes, worker);
                }
                if !self.stands {
                    halt(mount, &worker.within(SOON))?;
                    self.stands = true;
                }
                let parks = match want {
                    Want::Follow => self.plan.park,
                    Want::Stand => false,
                    Want::Park => true,
                };
                if parks && !self.parked && is_due(&mut self.park_at, MINUTE, worker) {
                    self.parked = self.park(mount, guard, dog, worker);
                }
                self.keep_from_sun(mount, guard, dog, worker)?;
                self.rest(worker);
                continue;
            }
            let schedule = worker.schedule.for_movers();
            let barred = &self.barred;
            let is_barred = |target: &Target, from: Epoch| {
                barred.iter().any(|(known, at)| known == target && *at == from)
            };
            let job = next_job(&schedule, worker.clock.utc(), worker.end, &is_barred);
            let is_it = |job: &Job| {
                let known = self.by_hand.as_ref();
                known.is_some_and(|(target, at)| {
                    *target == job.visit.target && *at == job.visit.from
                })
            };
            let stays = job.as_ref().is_some_and(is_it) && !self.hand.takes_again();
            if !stays {
                self.by_hand = None;
            }
            let Some(job) = job.filter(|_| !stays) else {
                self.line("stopped", None, mount.abilities().axes, worker);
                self.aim.set(AimState::Standing);
                self.keep_from_sun(mount, guard, dog, worker)?;
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
        let pulse = dog.as_ref().map(Process::pulse);
        let beat = || pulse.as_ref().map_or((), Pulse::tick);
        let now = worker.clock.utc();
        let path = match job.path(&self.plan, &self.station, abilities.axes, guard, now) {
            Ok(path) => path,
            Err(error) => {
                self.bar(job, &error.to_string(), worker);
                return Ok(());
            }
        };
        beat();
        let stands = path.angles_of(&mount.reading(&worker.within(SOON))?);
        beat();
        let name = &job.visit.target.name;
        let mut options = self.track_options(worker);
        let plan = PassPlan::new(name, &path, guard, &abilities, Some(stands), &options);
        if let Some(why) = &plan.refused {
            self.bar(job, why, worker);
            return Ok(());
        }
        for turn_s in &plan.turns_s {
            worker.status.say(format!("{name}: the mount turns over after {turn_s:.0} s"));
        }
        if let Some(keyhole) = &plan.keyhole {
            worker.status.say(format!(
                "{name}: the mount cannot follow through the pole of its axes: {:.0} s are lost",
                keyhole.lost_s()
            ));
        }
        (self.parked, self.stands, self.park_at, self.park_said) = (false, false, None, None);
        self.aim.set(AimState::Away);
        let sees = job.is_seen() && self.knows_side(&abilities) && !self.misled;
        let mut finder = self.sights.as_ref().filter(|_| sees).map(|sights| {
            sights.clear();
            CameraFinder(sights.clone())
        });
        options.unpark = std::mem::take(&mut self.may_unpark);
        options.estimator.frame_s = self.frame_s;
        options.latency_s = self.plan.latency_s.map_or(options.latency_s, |latency| latency.get());
        options.reach_arcsec = match (self.plan.reach_arcsec, &self.sights) {
            (Some(reach), _) => reach.get(),
            (None, Some(sights)) if sights.half_arcsec() > 0.0 => sights.half_arcsec(),
            _ => options.reach_arcsec,
        };
        let finder = finder.as_mut().map(|finder| finder as &mut dyn Finder);
        let clock = worker.clock.clone();
        self.hand.orders.clear();
        let hand = self.hand.clone();
        let mut tracker = Tracker::new(&path, guard, mount, finder, clock, options)
            .steered_by(&hand.orders)
            .beating(beat);
        let cancel = worker.cancel.clone();
        let axes = abilities.axes;
        let ended = tracker.run(&cancel, &mut |step| {
            let on = self.step(job, step, axes, worker);
            self.aim.set(on);
            if step.misled && !self.misled {
                self.misled = true;
                self.tell(MISLED, worker);
            }
            for why in hand.orders.refusals() {
                self.tell(&why, worker);
            }
            self.look_up(guard, worker);
            let watched = dog.as_mut().is_none_or(|dog| dog.beat().is_continue());
            let goes_on = watched
                && self.closed.is_none()
                && hand.want() == Want::Follow
                && !worker.is_over()
                && (Arc::ptr_eq(schedule, &worker.schedule.for_movers()) || job.is_still(worker));
            match goes_on && worker.clock.utc() < job.to {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            }
        });
        drop(tracker);
        self.hand.set_following(false);
        self.aim.set(AimState::Away);
        let ended = ended.map_err(|error| match dog.as_mut() {
            Some(dog) => dog.explain(error),
            None => error,
        });
        match ended {
            // The mount is opened again, with a watchdog of its own, and the visit goes on.
            Ok(_) | Err(TrackError::Silent) => Ok(()),
            // The prediction is not where it was: it is acquired again, from the beginning.
            Err(TrackError::Danger(danger @ Danger::ClockStep { .. })) => {
                self.tell(&danger.to_string(), worker);
                self.trust_clock_or_ask(worker);
                Ok(())
            }
            // Whoever stopped it: it stands until the next visit.
            Err(error @ (TrackError::ByHand { .. } | TrackError::MeridianLimit { .. })) => {
                self.hand.takes_again();
                self.tell(&error.to_string(), worker);
                self.by_hand = Some((job.visit.target.clone(), job.visit.from));
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

    /// Whether it is known how the camera sees the axes of this mount.
    fn knows_side(&self, abilities: &MountAbilities) -> bool {
        let side = self.sights.as_ref().and_then(|sights| sights.view().side);
        // Of other axes than equatorial ones no side counts.
        side.is_some() == abilities.tells_pier_side || abilities.axes == MountAxes::Horizontal
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
        self.hand.set_following(!matches!(step.state, TrackState::Slewing | TrackState::Waiting));
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
        let (utc, now) = (worker.clock.utc(), worker.clock.clock.now());
        if let Some(step) = step {
            self.at_deg = Some(([step.azimuth_deg, step.altitude_deg].into(), step.sun_deg));
        }
        worker.status.mount(
            &worker.name,
            MountStatus {
                state: state.to_owned(),
                error_arcsec: step.map(|step| step.error_arcsec),
                seen_arcsec: step.and_then(|step| step.seen_arcsec),
                at_deg: self.at_deg.map(|(at, _)| at),
                sun_deg: self.at_deg.map(|(_, sun)| sun),
            },
        );
        let changed = self.told.as_ref().is_none_or(|(before, _)| before != state);
        let due = step.is_some()
            && self.told.as_ref().is_none_or(|(_, at)| now.saturating_sub(*at) >= LINE);
        if !changed && !due {
            return;
        }
        self.told = Some((state.to_owned(), now));
        let satellite = step.filter(|step| step.ahead_s != 0.0);
        let what = What::Mount {
            device: worker.name.clone(),
            state: state.to_owned(),
            axes: axes_word(axes).to_owned(),
            target_deg: step.map(|step| step.target_deg.to_array()),
            read_deg: step.map(|step| step.mount_deg.to_array()),
            commanded_deg_s: step.map(|step| step.commanded_deg_s.to_array()),
            error_arcsec: step.map(|step| step.error_arcsec),
            seen_arcsec: step.and_then(|step| step.seen_arcsec),
            ahead_s: satellite.map(|step| step.ahead_s),
            left_arcsec: satellite.map(|step| step.left_arcsec),
            pier: step.and_then(|step| step.pier).map(|pier| pier.word().to_owned()),
            changed,
        };
        worker.disk.event(utc, what);
    }

    /// Looks at the weather and the Sun every five seconds: whether the telescope is to be parked, and why.
    fn look_up(&mut self, guard: &Guard, worker: &Worker) {
        if !is_due(&mut self.looked, SKY, worker) {
            return;
        }
        let now = worker.clock.utc();
        let bad = self.weather.as_ref().and_then(|file| match file.look(SystemTime::now()) {
            Weather::Unfit(why) => Some(format!("the weather is not fit: {why}")),
            Weather::Fit => None,
        });
        let sun = guard.sun(now).altitude_deg;
        let rises = guard.sun(now + 5.0 * Unit::Minute).altitude_deg > sun;
        // Before the cone of the Sun forbids the way to the park: on a high mountain near the equator that is earlier.
        let soon = guard.sun(now + PARKS_MIN * Unit::Minute);
        let late = sun > self.plan.dawn_deg() || guard.cone_holds(&soon);
        let dawn = rises && late && self.plan.park;
        let dawn = dawn.then(|| format!("dawn: the Sun is at {sun:.1}°"));
        self.bad_weather = bad.is_some();
        let closed = bad.or(dawn);
        match (&self.closed, &closed) {
            (None, Some(why)) => self.tell(why, worker),
            (Some(_), None) => worker.status.say(format!("{}: goes on", worker.name)),
            _ => {}
        }
        self.closed = closed;
    }

    /// How the mount is moved, whatever the target is.
    fn track_options(&self, worker: &Worker) -> TrackOptions {
        let mut options = self.plan.track_options();
        options.watch_clock = worker.clock.is_live();
        options
    }

    /// Holds a mount that stands against the Sun of now and of ten minutes later (or of twice the time that a slew may take), every five seconds: it is moved to a place far from it, or that is said each minute.
    fn keep_from_sun(
        &mut self,
        mount: &mut dyn Mount,
        guard: &Guard,
        dog: &mut Option<Process>,
        worker: &Worker,
    ) -> Result<(), DeviceError> {
        if !is_due(&mut self.sun_looked, SKY, worker) {
            return Ok(());
        }
        // Read in any case: a server lets go of a client that does not take in what it is sent.
        let reading = mount.reading(&worker.within(SOON))?;
        if reading.motion == MountMotion::Parked || !self.certain {
            return Ok(());
        }
        let utc = worker.clock.utc();
        let axes = mount.abilities().axes;
        let fixed = |place: [f64; 2]| {
            let earth = EarthOrientation::embedded();
            TargetPath::fixed(place.into(), &self.station.site, earth, (utc, 300.0), axes)
        };
        let Ok(zenith) = fixed([180.0, 80.0]) else { return Ok(()) };
        let here = zenith.frame().to_enu(direction(zenith.angles_of(&reading)));
        let [azimuth, altitude] = angles(here).to_array();
        let sun = guard.sun_distance_deg(here, utc);
        self.at_deg = Some(([azimuth.rem_euclid(360.0), altitude].into(), sun));
        // The way has to be free of the Sun for as long as a slew may take, and the telescope has to be gone before.
        let later = utc + (AHEAD_MIN * 60.0).max(2.0 * self.plan.slew_within_s()) * Unit::Second;
        let Some(danger) = [utc, later].iter().find_map(|at| guard.check_sun(here, *at).err())
        else {
            self.sun_told = None;
            return Ok(());
        };
        if !is_due(&mut self.sun_told, MINUTE, worker) {
            return Ok(());
        }
        let near = format!("the telescope stands, and the Sun comes near: {danger}");
        // A roof may be closing, or somebody be at work.
        let left = if self.hand.want() != Want::Follow {
            Some("it was told to stand")
        } else if self.bad_weather {
            Some("the weather is not fit")
        } else if self.by_hand.is_some() {
            Some("somebody else stopped it")
        } else {
            None
        };
        let free = match left {
            None => far_from_sun(guard, here, [utc, later], self.plan.slew_within_s()),
            Some(_) => None,
        };
        let Some(path) = free.and_then(|place| fixed(place).ok()) else {
            let why = left.unwrap_or("no way to a place far from it is free");
            self.tell(&format!("{near}; it is not moved ({why}): cover it or move it"), worker);
            return Ok(());
        };
        self.tell(&format!("{near}; it is moved away"), worker);
        let (options, clock) = (self.track_options(worker), worker.clock.clone());
        let pulse = dog.as_ref().map(Process::pulse);
        let mut tracker = Tracker::new(&path, guard, mount, None, clock, options)
            .beating(move || pulse.as_ref().map_or((), Pulse::tick));
        let ended = tracker.run(&worker.cancel.clone(), &mut |step| {
            self.line("slewing", Some(step), axes, worker);
            let watched = dog.as_mut().is_none_or(|dog| dog.beat().is_continue());
            let wanted = self.hand.want() == Want::Follow;
            match watched && wanted && step.state == TrackState::Slewing && !worker.is_over() {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            }
        });
        let ended = ended.map_err(|error| match dog.as_mut() {
            Some(dog) => dog.explain(error),
            None => error,
        });
        match ended {
            Ok(_) | Err(TrackError::Silent) => Ok(()),
            Err(TrackError::Device(error)) => Err(error),
            Err(error) => {
                self.tell(&format!("it is not moved away: {error}"), worker);
                Ok(())
            }
        }
    }

    /// Parks it; true where it is parked. What went wrong is told once.
    fn park(
        &mut self,
        mount: &mut dyn Mount,
        guard: &Guard,
        dog: &mut Option<Process>,
        worker: &Worker,
    ) -> bool {
        if !mount.abilities().parks {
            if self.hand.want() == Want::Park {
                self.say_of_park("this mount has no park: it stands", worker);
            }
            return false;
        }
        let reading = mount.reading(&worker.even_so(SOON));
        if reading.is_ok_and(|reading| reading.motion == MountMotion::Parked) {
            return true;
        }
        if self.by_hand.is_some() && self.hand.want() != Want::Park {
            self.say_of_park("it is not parked: somebody else stopped it", worker);
            return false;
        }
        let axes = mount.abilities().axes;
        self.line("parking", None, axes, worker);
        let hand = self.hand.clone();
        if let Some(dog) = dog {
            dog.pulse().busy(PARK_WITHIN);
        }
        let tick = &mut || match hand.want() {
            Want::Stand => ControlFlow::Break(()),
            _ => dog.as_mut().map_or(ControlFlow::Continue(()), Process::beat),
        };
        match park(mount, guard, &worker.clock, tick) {
            Ok(Parked::Parked) => {
                self.line("parked", None, axes, worker);
                self.may_unpark = true;
                return true;
            }
            Ok(other) => self.say_of_park(other.text(), worker),
            Err(error) => {
                self.tell(&format!("it is not known whether it is parked: {error}"), worker);
            }
        }
        false
    }

    fn say_of_park(&mut self, text: &'static str, worker: &Worker) {
        if self.park_said != Some(text) {
            self.park_said = Some(text);
            self.tell(text, worker);
        }
    }
}

/// Whether a real telescope is moved, now.
fn is_real(worker: &Worker) -> bool {
    worker.clock.is_live() && worker.opener.moves_for_real()
}

/// Whether something is to be done again after so long a time of the device's clock, which does not step; it is then taken as done.
fn is_due(last: &mut Option<Duration>, every: Duration, worker: &Worker) -> bool {
    let now = worker.clock.clock.now();
    let due = last.is_none_or(|last| now.saturating_sub(last) >= every);
    if due {
        *last = Some(now);
    }
    due
}

/// Stops a mount that may move. One that is parked stands.
fn halt(mount: &mut dyn Mount, deadline: &Deadline) -> Result<(), DeviceError> {
    match mount.reading(deadline) {
        Ok(reading) if reading.motion == MountMotion::Parked => Ok(()),
        _ => mount.stop(deadline),
    }
}

/// Azimuth and altitude, deg, of a place about 90° from the Sun that is free at these times, and to which a way is free.
fn far_from_sun(
    guard: &Guard,
    here: DVec3,
    [now, later]: [Epoch; 2],
    slew_s: f64,
) -> Option<[f64; 2]> {
    let mut places: Vec<(f64, [f64; 2])> = (0..24)
        .map(|i| [f64::from(i / 2) * 30.0, if i % 2 == 0 { 40.0 } else { 65.0 }])
        .map(|place| ((guard.sun_distance_deg(direction(place), now) - 90.0).abs(), place))
        .collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    places.into_iter().map(|(_, place)| place).find(|place| {
        let there = direction(*place);
        guard.check_place(there, later).is_ok() && guard.way(here, there, now, slew_s).is_ok()
    })
}
