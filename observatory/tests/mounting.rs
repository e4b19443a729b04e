//! A night's mount when things go wrong: virtual, on a clock of its own, with somebody else at work on the same telescope.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use hifitime::{Epoch, Unit};
use std::fmt;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, mpsc};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Identity, Mount, MountAbilities, MountAxes, MountKnown,
    MountMotion, MountPlace, MountReading, MountSite, MountTime, PhotonCounter, Setting,
};
use sunglint_formats::session::{Session, What};
use sunglint_formats::time::parse_utc;
use sunglint_observatory::telescope::watchdog::{Beat, watch};
use sunglint_observatory::telescope::{
    Guard, SunCone, TargetPath, TrackError, TrackOptions, Tracker,
};
use sunglint_observatory::{
    CameraPlan, CounterPlan, Level, MountPlan, Night, Opener, Plan, PreflightOptions, preflight,
};
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer, Site};
use sunglint_radiometry::station::Station;
use sunglint_virtual::telescope::{Telescope, TelescopeOptions, VirtualMount};

/// Something that happens at a time of the night, s.
type Happens = (f64, Box<dyn Fn(&mut VirtualMount) + Send>);

/// A telescope, its time, what happens to it, and what it was told.
struct Stage {
    start: Epoch,
    hand: Arc<VirtualClock>,
    telescope: Telescope,
    happens: Mutex<Vec<Happens>>,
    /// When the line is cut, s.
    cut_s: [f64; 2],
    /// When it refuses rates, s; it goes on at the last ones that it took.
    refuses_s: Mutex<Vec<[f64; 2]>>,
    /// Time that each call takes, s.
    takes_s: Mutex<f64>,
    /// Calls: when, s, and what.
    calls: Mutex<Vec<(f64, &'static str)>>,
    /// What it said: when, where, and its motion.
    said: Mutex<Vec<MountReading>>,
}

impl fmt::Debug for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Stage")
    }
}

impl Stage {
    fn new(start: &str, happens: Vec<Happens>, cut_s: [f64; 2]) -> Arc<Self> {
        let (start, hand) = (parse_utc(start).unwrap(), Arc::new(VirtualClock::new()));
        let clock = DeviceClock { clock: hand.clone(), zero_utc: Some(start) };
        let place = site().geodetic();
        let options = TelescopeOptions::default().with(|o| {
            o.site_deg = [place.latitude_deg, place.longitude_deg];
            o.latency_s = [0.0, 0.0].into();
            o.frame_s = 1e9;
        });
        let telescope = Telescope::new(options, clock, Arc::new(|_| None));
        Arc::new(Self {
            start,
            hand,
            telescope,
            happens: Mutex::new(happens),
            cut_s,
            refuses_s: Mutex::default(),
            takes_s: Mutex::new(0.0),
            calls: Mutex::default(),
            said: Mutex::default(),
        })
    }

    fn now_s(&self) -> f64 {
        self.hand.now().as_secs_f64()
    }

    fn clock(&self) -> DeviceClock {
        DeviceClock { clock: self.hand.clone(), zero_utc: Some(self.start) }
    }

    /// When it was told one of these, s.
    fn told(&self, calls: &[&str]) -> Vec<f64> {
        let all = self.calls.lock().unwrap();
        all.iter().filter(|(_, call)| calls.contains(call)).map(|(at, _)| *at).collect()
    }

    fn motion(&self) -> MountMotion {
        self.hand.sleep(Duration::from_secs(3));
        self.telescope.mount().reading(&soon()).unwrap().motion
    }
}

const MOVES: [&str; 3] = ["goto", "rates", "unpark"];

fn soon() -> Deadline {
    Deadline::within(Duration::from_secs(1))
}

fn site() -> Site {
    Station::built_in("ufo").unwrap().unwrap().site
}

/// The mount, on a line that may be cut.
struct OnLine {
    mount: VirtualMount,
    stage: Arc<Stage>,
}

impl OnLine {
    /// Does what others do by now.
    fn happen(&mut self) {
        let now_s = self.stage.now_s();
        let mut happens = self.stage.happens.lock().unwrap();
        happens.retain(|(at, act)| {
            let due = *at <= now_s;
            if due {
                act(&mut self.mount);
            }
            !due
        });
    }

    /// Whether rates are commanded ten times a second.
    fn is_led(&self) -> bool {
        let calls = self.stage.calls.lock().unwrap();
        let last = calls.iter().rev().take(4).find(|(_, call)| *call == "rates");
        last.is_some_and(|(at, _)| self.stage.now_s() - at < 0.25)
    }

    fn call(&mut self, what: &'static str) -> Result<&mut VirtualMount, DeviceError> {
        // While it is led, others act after a command: one that comes within the milliseconds between a reading and the next command is undone by that once.
        if !self.is_led() {
            self.happen();
        }
        let takes_s = *self.stage.takes_s.lock().unwrap();
        self.stage.hand.sleep(Duration::from_secs_f64(takes_s));
        let now_s = self.stage.now_s();
        if (self.stage.cut_s[0]..self.stage.cut_s[1]).contains(&now_s) {
            return Err(DeviceError::Lost { device: "mount", what: "the line is cut".into() });
        }
        self.stage.calls.lock().unwrap().push((now_s, what));
        Ok(&mut self.mount)
    }
}

impl Device for OnLine {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.call("identity")?.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.call("settings")?.settings(deadline)
    }
}

impl Mount for OnLine {
    fn abilities(&self) -> &MountAbilities {
        self.mount.abilities()
    }

    fn reading(&mut self, deadline: &Deadline) -> Result<MountReading, DeviceError> {
        let reading = self.call("reading")?.reading(deadline)?;
        self.stage.said.lock().unwrap().push(reading);
        Ok(reading)
    }

    fn begin_goto(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.call("goto")?.begin_goto(place, deadline)
    }

    fn sync(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.call("sync")?.sync(place, deadline)
    }

    fn set_tracking(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.call("rates")?.set_tracking(on, deadline)
    }

    fn know(&mut self, known: &MountKnown) {
        self.mount.know(known);
    }

    fn learn_senses(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<(), DeviceError> {
        for _ in 0..8 {
            self.call("learn")?;
            beat();
        }
        self.call("learn")?.learn_senses(beat, deadline)
    }

    fn set_rates(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        let now_s = self.stage.now_s();
        if self.stage.refuses_s.lock().unwrap().iter().any(|[a, b]| (*a..*b).contains(&now_s)) {
            let (request, message) = ("rates".into(), "Speed rate out of limits".into());
            return Err(DeviceError::Declined { device: "mount", request, message });
        }
        let told = self.call("rates")?.set_rates(deg_s, deadline);
        self.happen();
        told
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.call("stop")?.stop(deadline)
    }

    fn set_parked(&mut self, parked: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.call(if parked { "park" } else { "unpark" })?.set_parked(parked, deadline)
    }

    fn site(&mut self, deadline: &Deadline) -> Result<Option<MountSite>, DeviceError> {
        self.call("site")?.site(deadline)
    }

    fn time(&mut self, deadline: &Deadline) -> Result<Option<MountTime>, DeviceError> {
        self.call("time")?.time(deadline)
    }

    fn set_site(
        &mut self,
        site: MountSite,
        utc: Epoch,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.call("set_site")?.set_site(site, utc, deadline)
    }
}

/// A night whose only device that works is the mount.
#[derive(Debug)]
struct Backstage(Arc<Stage>);

impl Opener for Backstage {
    fn clock(&self, device: &str) -> DeviceClock {
        match device {
            "mount" => self.0.clock(),
            _ => {
                let clock = Arc::new(VirtualClock::new());
                DeviceClock { clock, zero_utc: Some(self.0.start) }
            }
        }
    }

    fn camera(&self, _: &CameraPlan, _: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
        Err(DeviceError::Unavailable { device: "camera", reason: "nobody looks" })
    }

    fn counter(
        &self,
        _: &CounterPlan,
        _: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        Err(DeviceError::Unavailable { device: "counter", reason: "nobody counts" })
    }

    fn mount(&self, _: &MountPlan, _: &Deadline) -> Result<Box<dyn Mount>, DeviceError> {
        let mut mount = OnLine { mount: self.0.telescope.mount(), stage: self.0.clone() };
        mount.call("open")?;
        Ok(Box::new(mount))
    }
}

/// Runs a night; gives its errors: when, s, and what.
fn night(
    stage: &Arc<Stage>,
    folder: &std::path::Path,
    mount: &str,
    visits: &str,
) -> Vec<(f64, String)> {
    let from = sunglint_formats::time::format_utc(stage.start, 0);
    let plan = format!(
        "station = \"ufo\"\nfrom = \"{from}\"\nvirtual = \"virtual.toml\"\n[[camera]]\nname = \"cam\"\n\
         device = \"virtual\"\nexposure_s = 0.1\n[mount]\ndevice = \"virtual\"\n{mount}\n{visits}"
    );
    std::fs::write(folder.join("night.toml"), plan).unwrap();
    let plan = Plan::read_with(&folder.join("night.toml"), &mut |_| Ok(())).unwrap();
    let root = folder.join("session");
    let night = Night::planned(plan, Arc::new(Backstage(stage.clone())), Some(&root), "test");
    night.run(&Cancel::new(), &mut |_| {}).unwrap();
    let session = Session::open(&root).unwrap();
    let events = session.events().unwrap().map(Result::unwrap);
    events
        .filter_map(|event| match event.what {
            What::Error { about, error } if about == "mount" => {
                Some(((event.utc - stage.start).to_seconds(), error))
            }
            _ => None,
        })
        .collect()
}

const VISITS: &str =
    "[[visit]]\nstar = \"Vega\"\nfor_s = 120\n[[visit]]\nstar = \"Deneb\"\nfor_s = 60\n";
const EVENING: &str = "2008-09-21T18:40:00Z";

/// Truth: the rule in words: what somebody else stops stays stopped until the next visit.
#[test]
fn what_somebody_else_stops_stays_stopped() {
    let stop: Happens = (60.0, Box::new(|mount| mount.stop(&soon()).unwrap()));
    let stage = Stage::new(EVENING, vec![stop], [-1.0; 2]);
    let folder = tempfile::tempdir().unwrap();
    let errors = night(&stage, folder.path(), "", VISITS);
    let moves = stage.told(&MOVES);
    assert!(moves.iter().any(|at| (50.0..60.0).contains(at)), "{moves:?}");
    // It is noticed within two commands.
    let after: Vec<_> = moves.iter().filter(|at| (60.3..119.9).contains(*at)).collect();
    assert!(after.is_empty(), "{after:?} {errors:?}");
    assert!(moves.iter().any(|at| *at > 120.0), "the next visit is not followed: {errors:?}");
    let hand = |(_, text): &&(f64, String)| text.contains("stopped by somebody else");
    assert_eq!(errors.iter().filter(hand).count(), 1, "{errors:?}");
}

/// Truth: the rule in words: nobody frees a mount that somebody else parked, also not for the next visit; parking is not ended by a stop.
#[test]
fn what_somebody_else_parks_stays_parked() {
    let park: Happens = (60.0, Box::new(|mount| mount.set_parked(true, &soon()).unwrap()));
    let stage = Stage::new(EVENING, vec![park], [-1.0; 2]);
    let folder = tempfile::tempdir().unwrap();
    let errors = night(&stage, folder.path(), "", VISITS);
    let late = |calls: &[&str]| stage.told(calls).into_iter().filter(|at| *at > 60.3).count();
    assert_eq!(late(&MOVES), 0, "{errors:?}");
    assert_eq!(late(&["stop"]), 0, "{errors:?}");
    // Said for each of the two visits.
    let hand = |(_, text): &&(f64, String)| text.contains("parked by somebody else");
    assert_eq!(errors.iter().filter(hand).count(), 2, "{errors:?}");
    assert_eq!(stage.motion(), MountMotion::Parked);
}

/// Truth: the rule in words: after a lost line the first command is a stop, nothing is parked meanwhile, and the visit goes on; at the end it is parked.
#[test]
fn a_line_that_breaks_ends_in_a_stop() {
    let stage = Stage::new(EVENING, vec![], [60.0, 70.0]);
    let folder = tempfile::tempdir().unwrap();
    let errors = night(&stage, folder.path(), "", VISITS);
    let calls = stage.calls.lock().unwrap().clone();
    let command = |call: &str| !["open", "identity", "settings", "reading"].contains(&call);
    let first = calls.iter().find(|(at, call)| *at >= 70.0 && command(call)).unwrap();
    assert_eq!(first.1, "stop", "{calls:?}");
    let parks = stage.told(&["park"]);
    assert!(parks.iter().all(|at| *at > 179.0), "{parks:?}");
    assert!(stage.told(&["rates"]).iter().any(|at| (75.0..120.0).contains(at)), "{errors:?}");
    let failed = |(_, text): &(f64, String)| text.contains("could not be stopped");
    assert!(errors.iter().any(failed), "{errors:?}");
    assert_eq!(stage.motion(), MountMotion::Parked);
}

/// Truth: the rule in words: nothing moves in bad weather, and it is parked; it goes on when the weather is fit. An age that no clock can hold is no error.
#[test]
fn bad_weather_parks_and_good_weather_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let weather = folder.path().join("weather.txt");
    std::fs::write(&weather, "unsafe\n").unwrap();
    let clears: Happens = (60.0, Box::new(move |_| std::fs::write(&weather, "safe\n").unwrap()));
    let stage = Stage::new(EVENING, vec![clears], [-1.0; 2]);
    let mount = "weather = \"weather.txt\"\nweather_age_s = 1e30";
    let errors = night(&stage, folder.path(), mount, VISITS);
    let moves = stage.told(&MOVES);
    assert!(moves.iter().all(|at| *at >= 60.0), "{moves:?}");
    // It is looked at every five seconds; the file changes with a reading, within five seconds after the minute.
    assert!(moves.iter().any(|at| *at < 71.0), "{moves:?} {errors:?}");
    assert!(stage.told(&["park"])[0] < 1.0);
    assert!(errors.iter().any(|(_, text)| text.contains("it says unsafe")), "{errors:?}");
}

/// Sun's altitude, deg, by SOFA.
fn sun_deg(epoch: Epoch) -> f64 {
    Observer::at(epoch, &site(), EarthOrientation::embedded())
        .unwrap()
        .sun()
        .horizontal
        .altitude_deg()
}

/// Truth: the Sun by SOFA: a morning's visit is followed until the Sun's centre is at −2° (and five seconds: a twentieth of a degree), then the mount is parked.
#[test]
fn dawn_parks() {
    // Vega stands high in the west on a morning of June.
    let stage = Stage::new("2020-06-21T02:30:00Z", vec![], [-1.0; 2]);
    let folder = tempfile::tempdir().unwrap();
    let visit = "[[visit]]\nstar = \"Vega\"\nfor_s = 3600\n";
    assert!(sun_deg(stage.start) < -4.0 && sun_deg(stage.start + 3600.0 * Unit::Second) > -1.5);
    let errors = night(&stage, folder.path(), "", visit);
    let rates = stage.told(&["rates"]);
    let sun = |at_s: f64| sun_deg(stage.start + at_s * Unit::Second);
    let last = sun(*rates.last().unwrap());
    assert!((-2.1..-1.9).contains(&last), "{last} {errors:?}");
    let parked = sun(stage.told(&["park"])[0]);
    assert!((-2.1..-1.9).contains(&parked), "{parked}");
}

/// Truth: the Sun by SOFA: a telescope that stands where the Sun rises is moved away, and is never within 30° of it while its upper limb is up.
#[test]
fn the_sun_does_not_walk_into_a_telescope_that_stands() {
    let stage = Stage::new("2020-06-21T02:40:00Z", vec![], [-1.0; 2]);
    // 25° beside the place where the Sun comes up.
    let place = MountPlace::Horizontal { azimuth_deg: 80.0, altitude_deg: 12.0 };
    stage.telescope.mount().begin_goto(place, &soon()).unwrap();
    stage.hand.sleep(Duration::from_secs(60));
    let folder = tempfile::tempdir().unwrap();
    let visit = "[[visit]]\noff = \"dark\"\nfor_s = 5400\n";
    let errors = night(&stage, folder.path(), "park = false", visit);
    assert!(errors.iter().any(|(_, text)| text.contains("it is moved away")), "{errors:?}");
    let said = stage.said.lock().unwrap().clone();
    let mut up = 0;
    for reading in &said {
        let MountPlace::Horizontal { azimuth_deg, altitude_deg } = reading.place else { panic!() };
        let observer = Observer::at(reading.utc, &site(), EarthOrientation::embedded()).unwrap();
        let sun = observer.sun().horizontal;
        if sun.altitude_deg() > -0.833 {
            up += 1;
            let enu = sunglint_observatory::telescope::direction([azimuth_deg, altitude_deg]);
            let off = enu.angle_between(sun.east_north_up()).to_degrees();
            assert!(off > 30.0, "{off} at {}", reading.utc);
        }
    }
    assert!(up > 100, "{up}");
}

/// Truth: the rule in words, for the tracker alone: a stop of somebody else ends it, and the mount stands.
#[test]
fn a_tracker_leaves_a_stopped_mount_alone() {
    let stage = Stage::new(EVENING, vec![], [-1.0; 2]);
    let earth = EarthOrientation::embedded();
    let axes = stage.telescope.mount().abilities().axes;
    let vega = sunglint_radiometry::sky::Catalogue::embedded().find("Vega").unwrap();
    let path = TargetPath::star(vega, &site(), earth, (stage.start, 120.0), axes, false).unwrap();
    let guard = Guard::new(&site(), axes, false, SunCone::default());
    let mut options = TrackOptions::default();
    options.watch_clock = false;
    let follow = |options: TrackOptions, act: &dyn Fn(&mut VirtualMount)| {
        let (mut mount, mut other) = (stage.telescope.mount(), stage.telescope.mount());
        let mut tracker = Tracker::new(&path, &guard, &mut mount, None, stage.clock(), options);
        let mut steps = 0;
        tracker.run(&Cancel::new(), &mut |step| {
            use sunglint_observatory::telescope::TrackState;
            steps += u32::from(step.state == TrackState::Predicted);
            if steps == 40 {
                act(&mut other);
            }
            match steps < 60 {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            }
        })
    };
    assert!(follow(options, &|_| {}).is_ok());
    let stopped = follow(options, &|mount| mount.stop(&soon()).unwrap());
    assert!(matches!(stopped, Err(TrackError::ByHand { .. })), "{stopped:?}");
    assert_eq!(stage.motion(), MountMotion::Still);
    let parked = follow(options, &|mount| mount.set_parked(true, &soon()).unwrap());
    assert!(matches!(parked, Err(TrackError::ByHand { .. })), "{parked:?}");
    options.unpark = false;
    let again = follow(options, &|_| {});
    assert!(matches!(again, Err(TrackError::ByHand { .. })), "{again:?}");
    assert_eq!(stage.motion(), MountMotion::Parked);
}

/// Truth: by hand: stopped 2.5° before its goal, a mount that brakes in time stands somewhere before it, here more than the 0.6° of pointing errors and less than 2.5° from it: that is no arrival.
#[test]
fn a_slew_that_is_broken_off_near_its_goal_has_not_arrived() {
    let stage = Stage::new(EVENING, vec![], [-1.0; 2]);
    let earth = EarthOrientation::embedded();
    let axes = stage.telescope.mount().abilities().axes;
    let vega = sunglint_radiometry::sky::Catalogue::embedded().find("Vega").unwrap();
    let path = TargetPath::star(vega, &site(), earth, (stage.start, 120.0), axes, false).unwrap();
    let guard = Guard::new(&site(), axes, false, SunCone::default());
    let mut options = TrackOptions::default();
    options.watch_clock = false;
    let (mut mount, mut other) = (stage.telescope.mount(), stage.telescope.mount());
    let mut tracker = Tracker::new(&path, &guard, &mut mount, None, stage.clock(), options);
    let mut last_deg = 180.0;
    let mut told = false;
    let ended = tracker.run(&Cancel::new(), &mut |step| {
        last_deg = step.error_arcsec / 3600.0;
        if last_deg < 2.5 && !told {
            other.stop(&soon()).unwrap();
            told = true;
        }
        ControlFlow::Continue(())
    });
    assert!(matches!(ended, Err(TrackError::ByHand { .. })), "{ended:?}");
    assert!((0.6..2.5).contains(&last_deg), "{last_deg}");
}

/// A tracker's run on the stage's mount after Vega for two minutes, with a sign of life of its own.
fn follow_vega(
    stage: &Arc<Stage>,
    beat: &dyn Fn(f64),
) -> Result<sunglint_observatory::telescope::TrackSummary, TrackError> {
    let earth = EarthOrientation::embedded();
    let axes = stage.telescope.mount().abilities().axes;
    let vega = sunglint_radiometry::sky::Catalogue::embedded().find("Vega").unwrap();
    let path = TargetPath::star(vega, &site(), earth, (stage.start, 120.0), axes, false).unwrap();
    let guard = Guard::new(&site(), axes, false, SunCone::default());
    let mut options = TrackOptions::default();
    options.watch_clock = false;
    let mut mount = OnLine { mount: stage.telescope.mount(), stage: stage.clone() };
    let tracker = Tracker::new(&path, &guard, &mut mount, None, stage.clock(), options);
    tracker.beating(|| beat(stage.now_s())).run(&Cancel::new(), &mut |_| {
        beat(stage.now_s());
        ControlFlow::Continue(())
    })
}

/// Truth: the rule in words: a mount that takes 1.5 s for each answer is slow, and its tracker does not hang: there is a sign of life between two calls, also while it begins a slew and tries the axes.
#[test]
fn a_tracker_of_a_slow_mount_gives_signs_of_life() {
    let stage = Stage::new(EVENING, vec![], [-1.0; 2]);
    *stage.takes_s.lock().unwrap() = 1.5;
    let beats = std::cell::RefCell::new(vec![0.0]);
    follow_vega(&stage, &|at_s| {
        beats.borrow_mut().push(at_s);
        // Three seconds from a reading to a command are too slow to follow.
        if stage.told(&["learn"]).len() >= 9 {
            *stage.takes_s.lock().unwrap() = 0.0;
        }
    })
    .unwrap();
    let calls = stage.told(&["learn"]);
    assert!(calls.len() >= 9 && calls[8] - calls[0] > 10.0, "{calls:?}");
    let beats = beats.into_inner();
    let longest = beats.windows(2).map(|two| two[1] - two[0]).fold(0.0, f64::max);
    let hangs_s = sunglint_observatory::telescope::watchdog::HANGS.as_secs_f64();
    assert!(longest < hangs_s, "{longest} s without a sign of life, {hangs_s} s are allowed");
}

/// Truth: the rule in words: rates that are refused for half a second are nothing, rates that are refused for three seconds end the following, and the mount stands.
#[test]
fn rates_that_are_refused_now_and_then_do_not_end_it() {
    let stage = Stage::new(EVENING, vec![], [-1.0; 2]);
    *stage.refuses_s.lock().unwrap() = vec![[60.0, 60.5], [70.0, 70.5]];
    let summary = follow_vega(&stage, &|_| ()).unwrap();
    assert!(!summary.cancelled && stage.now_s() > 119.0);
    let stage = Stage::new(EVENING, vec![], [-1.0; 2]);
    *stage.refuses_s.lock().unwrap() = vec![[60.0, 63.0]];
    let ended = follow_vega(&stage, &|_| ()).unwrap_err();
    assert!(matches!(ended, TrackError::Device(DeviceError::Declined { .. })), "{ended:?}");
    assert!((61.0..62.0).contains(&stage.now_s()), "{}", stage.now_s());
    assert_eq!(stage.motion(), MountMotion::Still);
    // What somebody else did is told as such, wherever the mount says it.
    let what = "the mount was parked by somebody else";
    let taken = TrackError::from(DeviceError::Taken { device: "mount", what });
    assert!(matches!(taken, TrackError::ByHand { .. }));
}

/// Truth: the Sun by SOFA. As above, with slews of 0.1 °/s, which may take an hour: the telescope is moved away long before the Sun rises, while a way is free.
#[test]
fn a_slow_telescope_is_moved_away_in_time() {
    let stage = Stage::new("2020-06-21T00:40:00Z", vec![], [-1.0; 2]);
    let place = MountPlace::Horizontal { azimuth_deg: 80.0, altitude_deg: 12.0 };
    stage.telescope.mount().begin_goto(place, &soon()).unwrap();
    stage.hand.sleep(Duration::from_secs(60));
    let folder = tempfile::tempdir().unwrap();
    let visit = "[[visit]]\noff = \"dark\"\nfor_s = 12000\n";
    let errors = night(&stage, folder.path(), "park = false\nslew_deg_s = 0.1", visit);
    let moved = errors.iter().find(|(_, text)| text.contains("it is moved away"));
    assert!(
        moved.is_some_and(|(at_s, _)| sun_deg(stage.start + *at_s * Unit::Second) < -5.0),
        "{errors:?}"
    );
    let said = stage.said.lock().unwrap().clone();
    let mut up = 0;
    for reading in &said {
        let MountPlace::Horizontal { azimuth_deg, altitude_deg } = reading.place else { panic!() };
        let observer = Observer::at(reading.utc, &site(), EarthOrientation::embedded()).unwrap();
        let sun = observer.sun().horizontal;
        if sun.altitude_deg() > -0.833 {
            up += 1;
            let enu = sunglint_observatory::telescope::direction([azimuth_deg, altitude_deg]);
            let off = enu.angle_between(sun.east_north_up()).to_degrees();
            assert!(off > 30.0, "{off} at {}", reading.utc);
        }
    }
    assert!(up > 100, "{up}");
}

/// Truth: in words: what a person knows counts, for the ways that are kept off the Sun and for the rates.
#[test]
fn what_a_person_knows_of_a_mount_counts() {
    let stage = Stage::new(EVENING, vec![], [-1.0; 2]);
    let mut abilities = stage.telescope.mount().abilities().clone();
    (abilities.axes, abilities.turns_about) = (MountAxes::Equatorial, None);
    (abilities.is_fork, abilities.tells_pier_side) = (false, true);
    assert!(abilities.may_turn_over());
    let of = |known: MountKnown| {
        let mut told = abilities.clone();
        told.know(&known);
        told
    };
    let fork = of(MountKnown { german: Some(false), ..MountKnown::default() });
    assert!(!fork.may_turn_over() && !fork.tells_pier_side && fork.turns_about.is_none());
    let altaz = of(MountKnown { axes: Some(MountAxes::Horizontal), ..MountKnown::default() });
    assert!(!altaz.may_turn_over() && altaz.axes == MountAxes::Equatorial);
    let slow = MountKnown {
        most_deg_s: Some(3.3),
        least_deg_s: Some(0.76 / 3600.0),
        ..MountKnown::default()
    };
    let slow = of(slow);
    assert_eq!(slow.continuous_deg_s(), Some([3.3, 3.3].into()));
    let sent = [0.0, 0.37, -0.39, 0.75, 0.77, -20.0]
        .map(|arcsec_s| (slow.taken_deg_s(1, arcsec_s / 3600.0) * 3.6e6).round() / 1e3);
    assert_eq!(sent, [0.0, 0.0, -0.76, 0.76, 0.77, -20.0]);
    // No more than the driver publishes.
    let fast = of(MountKnown { most_deg_s: Some(50.0), ..MountKnown::default() });
    assert_eq!(fast.continuous_deg_s(), Some([10.0, 10.0].into()));
}

/// Truth: the rule in words: a tracker whose watchdog has gone is told so with its next sign of life; one that says that it is busy is not silent meanwhile.
#[cfg(unix)]
#[test]
fn a_tracker_hears_that_its_watchdog_has_gone() {
    use std::os::unix::fs::PermissionsExt as _;
    use sunglint_observatory::telescope::watchdog::Process;
    let folder = tempfile::tempdir().unwrap();
    let dog = |script: &str| {
        let program = folder.path().join("dog");
        std::fs::write(&program, script).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        Process::start(&program, "mount").unwrap()
    };
    let mut watching = dog("#!/bin/sh\necho ready\ncat > /dev/null\n");
    assert!(watching.beat().is_continue());
    watching.pulse().busy(Duration::from_secs(3600));
    assert_eq!(watching.pulse().age(), Duration::ZERO);
    watching.done();
    let mut gone = dog("#!/bin/sh\necho ready\n");
    let until = Deadline::within(Duration::from_secs(60));
    while gone.beat().is_continue() {
        until.sleep(Duration::from_millis(20)).unwrap();
    }
}

/// Truth: the rule in words, and the exit status of stand-ins for the watchdog's process: a mount that stands after the watchdog heard nothing was stopped by it; after any other end, or while it watches still, somebody else
/// stopped it, and who parked it was never the watchdog. That status is the one of a watchdog that heard nothing.
#[cfg(unix)]
#[test]
fn a_watchdogs_own_stop_is_nobody_elses() {
    use std::os::unix::fs::PermissionsExt as _;
    use sunglint_observatory::telescope::watchdog::{Process, Watched};
    let folder = tempfile::tempdir().unwrap();
    let dog = |name: &str, end: &str, ends: bool| {
        let program = folder.path().join(name);
        std::fs::write(&program, format!("#!/bin/sh\necho ready\n{end}\n")).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        let mut process = Process::start(&program, "mount").unwrap();
        while ends && process.watches() {
            std::thread::sleep(Duration::from_millis(20));
        }
        process
    };
    let by_hand = |what| TrackError::ByHand { what };
    let stopped = || by_hand("the mount was stopped by somebody else");
    let silent = format!("exit {}", Watched::Silent.status());
    assert_eq!((Watched::Done.status(), Watched::Stopped.status()), (0, 0));
    let mut own = dog("silent", &silent, true);
    assert!(matches!(own.explain(stopped()), TrackError::Silent));
    assert!(own.was_silent());
    assert!(matches!(own.explain(TrackError::MeridianLimit { past_deg: 1.0 }), TrackError::Silent));
    let parked = own.explain(by_hand("the mount was parked by somebody else"));
    assert!(matches!(parked, TrackError::ByHand { .. }), "{parked}");
    for (name, end) in [("killed", "kill -9 $$"), ("failed", "exit 1"), ("done", "exit 0")] {
        let mut gone = dog(name, end, true);
        assert!(matches!(gone.explain(stopped()), TrackError::ByHand { .. }), "{name}");
        assert!(!gone.was_silent(), "{name}");
    }
    let mut watching = dog("watching", "cat > /dev/null", false);
    assert!(matches!(watching.explain(stopped()), TrackError::ByHand { .. }));
    watching.done();
}

/// Truth: the rule in words: a watchdog whose own connection is lost ends, though the tracker lives: the tracker then sees that nobody watches.
#[test]
fn a_watchdog_whose_line_breaks_ends() {
    let stage = Stage::new(EVENING, vec![], [0.0, 1e9]);
    let mut mount = OnLine { mount: stage.telescope.mount(), stage: stage.clone() };
    let (beats, received) = mpsc::channel();
    let tracker = std::thread::spawn(move || {
        while beats.send(Beat::Alive).is_ok() {
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    let begun = Instant::now();
    let ended = watch(&mut mount, &received);
    drop(received);
    tracker.join().unwrap();
    assert!(matches!(ended, Err(DeviceError::Lost { .. })), "{ended:?}");
    assert!(begun.elapsed() < Duration::from_secs(10));
}

/// Truth: what a stand-in for the watchdog's process writes down: it is told that all is done only where that was said; otherwise its pipe is closed.
#[cfg(unix)]
#[test]
fn a_watchdog_that_is_dropped_is_not_disarmed() {
    use std::os::unix::fs::PermissionsExt as _;
    use sunglint_observatory::telescope::watchdog::Process;
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("dog");
    std::fs::write(&program, "#!/bin/sh\necho ready\ncat > \"$2\"\necho end >> \"$2\"\n").unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let told = |name: &str, done: bool| {
        let file = folder.path().join(name);
        let dog = Process::start(&program, file.to_str().unwrap()).unwrap();
        if done {
            dog.done();
        } else {
            drop(dog);
        }
        let text = std::fs::read_to_string(file).unwrap();
        text.lines().filter(|line| *line != "a").map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(told("after a stop", true), ["d", "end"]);
    assert_eq!(told("after an error", false), ["end"]);
}

/// A plan with a real mount, at the stage's time.
fn plan_of(stage: &Stage, mount: &str, visits: &str) -> Plan {
    let from = sunglint_formats::time::format_utc(stage.start, 0);
    let text = format!(
        "station = \"ufo\"\nfrom = \"{from}\"\n[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\n\
         exposure_s = 0.5\n[mount]\ndevice = \"indi-telescope:localhost:1/T\"\ntrust_clock = true\n{mount}\n{visits}"
    );
    Plan::of_text(std::path::Path::new("night.toml"), &text, &[]).unwrap()
}

/// Truth: by hand. Three frames of 0.5 s with 2 s of readout, and 10 s for a wheel, are 17.5 s; half a turn at 1 °/s, and 10 s, are 190 s: they come before the first step of a visit to a target where
/// the mount is not yet, and before none that needs no mount.
#[test]
fn a_plan_counts_the_way_to_its_targets() {
    let stage = Stage::new(EVENING, vec![], [0.0; 2]);
    let visits = "[[visit]]\nstar = \"Vega\"\nframes = 3\nrepeat = 2\n[[visit]]\nstar = \"Vega\"\nframes = 3\n\
                  [[visit]]\noff = \"dark\"\nframes = 3\n[[visit]]\nstar = \"Deneb\"\nframes = 3\n\
                  [[visit]]\nstar = \"Vega\"\nfor_s = 60\n";
    let plan = plan_of(&stage, "slew_deg_s = 1.0", visits);
    let slots = plan.schedule.slots().iter().filter_map(|slot| Some((slot.from, slot.to?)));
    let lengths: Vec<f64> =
        slots.map(|(from, to)| ((to - from).to_seconds() * 10.0).round() / 10.0).collect();
    assert_eq!(lengths, [207.5, 17.5, 17.5, 17.5, 207.5, 60.0]);
}

/// Truth: the star's place by the sky's formulas, against the place where the virtual telescope stands at first (north, 45° high): the longer of the two ways at 0.5 °/s, and 10 s, of which none are free. A mount that does not answer may
/// have to go half a turn. A site that it is told is not the station's already.
#[test]
fn the_check_counts_the_first_way() {
    let visits = "[[visit]]\nstar = \"Vega\"\nfor_s = 900\n";
    let found = |cut_s: [f64; 2], mount: &str| {
        let stage = Stage::new(EVENING, vec![], cut_s);
        let plan = plan_of(&stage, &format!("slew_deg_s = 0.5\n{mount}"), visits);
        if mount.contains("set_site") {
            let far = MountSite { latitude_deg: 10.0, longitude_deg: 20.0, height_m: 0.0 };
            stage.telescope.mount().set_site(far, stage.start, &soon()).unwrap();
        }
        let mut options = PreflightOptions::default();
        (options.now, options.open_within) = (stage.start, Duration::from_secs(20));
        let opener: Arc<dyn Opener> = Arc::new(Backstage(stage));
        let found = preflight(&plan, &opener, &options);
        let text = |about: &str, level: Level| {
            let own = found.findings.iter().filter(|f| f.about == about && f.level == level);
            own.map(|finding| finding.text.clone()).collect::<Vec<_>>().join("; ")
        };
        (text("visit 1 (Vega)", Level::Warning), text("mount", Level::Fine))
    };
    let observer =
        Observer::at(parse_utc(EVENING).unwrap(), &site(), EarthOrientation::embedded()).unwrap();
    let place = observer.star(Catalogue::embedded().find("Vega").unwrap()).horizontal;
    let enu = place.east_north_up();
    let azimuth = enu.x.atan2(enu.y).to_degrees();
    let altitude = enu.z.asin().to_degrees();
    let way_s = azimuth.abs().max((altitude - 45.0).abs()) / 0.5 + 10.0;
    let (way, site) = found([0.0; 2], "");
    let expected = format!("the way there takes about {way_s:.0} s, and there are 0 s");
    assert!(way.contains(&expected), "{expected}: {way}");
    assert!(site.contains("its site is the station's"), "{site}");
    let (_, site) = found([0.0; 2], "set_site = true");
    assert!(site.contains("it is told the station's site"), "{site}");
    assert!(!site.contains("its site is the station's"), "{site}");
    let (way, _) = found([0.0, 1e9], "");
    assert!(way.contains("the way there may take 370 s"), "{way}");
}

/// Truth: the rule in words: folders above the session's are made with the night; the check says so, and why it cannot be where a file is in the way.
#[test]
fn the_folder_of_the_nights_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("new/deep/session");
    let stage = Stage::new(EVENING, vec![], [0.0; 2]);
    let plan = plan_of(&stage, "", "[[visit]]\noff = \"dark\"\nfor_s = 60\n");
    let opener: Arc<dyn Opener> = Arc::new(Backstage(stage));
    let check = |root: &std::path::Path| {
        let mut options = PreflightOptions::default();
        (options.folder, options.open_devices) = (Some(root.to_owned()), false);
        let found = preflight(&plan, &opener, &options).findings;
        let own = found.into_iter().find(|finding| finding.about == "output");
        own.map(|finding| (finding.level, finding.text))
    };
    let (level, text) = check(&root).unwrap();
    assert!(level == Level::Fine && text.contains("it will be made"), "{text}");
    std::fs::write(folder.path().join("file"), "").unwrap();
    let (level, text) = check(&folder.path().join("file/session")).unwrap();
    assert!(level == Level::Error && text.contains("is a file"), "{text}");
    assert_eq!(check(&folder.path().join("session")), None);
    let stopped = Cancel::new();
    stopped.cancel();
    let night = Night::planned(plan.clone(), opener.clone(), Some(&root), "test");
    night.run(&stopped, &mut |_| {}).unwrap();
    assert!(root.join("session.toml").is_file());
}
