//! Parts that the tests of stages on [`Turning`] share: the battery that each passes with its simulated device, lives on bad lines, and recorded conversations.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses its part")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock, Deadline, VirtualClock};
use sunglint_drivers::device::{DeviceError, RotationStage};
use sunglint_drivers::recording::{Faults, Header, Injected, Recorded, Recording, Replay};
use sunglint_drivers::simulated::elliptec::Elliptec;
use sunglint_drivers::simulated::esp301::Esp301;
use sunglint_drivers::simulated::smc100::Smc100;
use sunglint_drivers::simulated::standa::Standa;
use sunglint_drivers::simulated::zaber::Zaber;
use sunglint_drivers::simulated::{InMemory, Speaker};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_drivers::turning::{Axis, Turning, TurningSettings};
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

/// A simulated device, as far as all of them are alike.
pub trait Counterpart: Speaker {
    /// Place at the reference, counts.
    const REFERENCE: i64;
    /// Counts of a degree.
    const PER_DEG: f64;
    fn place(&self) -> i64;
    fn is_standing(&self) -> bool;
    fn set_obstacle(&mut self, place: Option<i64>);
    fn power_cycle(&mut self);
    /// It says nothing any more.
    fn die(&mut self);

    /// Where it is, deg from its reference.
    fn deg(&self) -> f64 {
        (self.place() - Self::REFERENCE) as f64 / Self::PER_DEG
    }
}

macro_rules! counterpart {
    ($device:ty, $reference:expr, $per_deg:expr, $($dead:ident).+) => {
        impl Counterpart for $device {
            const REFERENCE: i64 = $reference;
            const PER_DEG: f64 = $per_deg;

            fn place(&self) -> i64 {
                self.place()
            }

            fn is_standing(&self) -> bool {
                self.is_standing()
            }

            fn set_obstacle(&mut self, place: Option<i64>) {
                self.set_obstacle(place);
            }

            fn power_cycle(&mut self) {
                self.power_cycle();
            }

            fn die(&mut self) {
                self.$($dead).+ = true;
            }
        }
    };
}
counterpart!(Zaber, -15_000, 1_000.0, dead);
counterpart!(Elliptec, -35_840, 143_360.0 / 360.0, trouble.dead);
counterpart!(Esp301, -150_000, 10_000.0, dead);
counterpart!(Smc100, -150_000, 10_000.0, dead);
counterpart!(Standa, -384_000, 25_600.0, dead);

/// A stage with its simulated device on a virtual clock.
pub struct Desk<A: Axis, D> {
    pub clock: Arc<VirtualClock>,
    pub stage: Turning<A>,
    reach: fn(&mut Turning<A>) -> &mut D,
}

impl<A: Axis, D: Counterpart> Desk<A, D> {
    /// `open` opens the stage, `reach` gives the device behind it.
    pub fn new(
        open: impl FnOnce(&Deadline) -> Result<Turning<A>, DeviceError>,
        reach: fn(&mut Turning<A>) -> &mut D,
    ) -> Result<Self, DeviceError> {
        let clock = Arc::new(VirtualClock::new());
        let stage = open(&Deadline::after(clock.clone(), Duration::from_secs(10)))?;
        Ok(Self { clock, stage, reach })
    }

    pub fn within(&self, s: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(s))
    }

    pub fn device(&mut self) -> &mut D {
        (self.reach)(&mut self.stage)
    }

    /// Turns to an angle, which has to end with an error: it, in words, and where the stage says that it stands.
    pub fn fails(&mut self, deg: f64) -> (String, Option<f64>) {
        let error = self.stage.move_to(deg, &self.within(60)).unwrap_err();
        (error.to_string(), error.done)
    }

    /// Without a reference it has no angle. It finds it, says `home_deg` there, and turns to each angle, to the nearest count. Without power for a moment it has lost it, in these words.
    pub fn homes_and_turns(&mut self, home_deg: f64, angles: &[f64], lost: &str) {
        let d = self.within(600);
        assert!(self.stage.angle_deg(&d).unwrap_err().to_string().contains("home it"));
        assert_eq!(self.stage.home(&d).unwrap(), home_deg);
        assert_eq!(self.device().place(), D::REFERENCE);
        for angle in angles {
            let at = self.stage.move_to(*angle, &d).unwrap();
            let place = self.device().place() - D::REFERENCE;
            assert_eq!(place, ((angle - home_deg) * D::PER_DEG).round() as i64, "{angle}");
            // It says where it is, not where it was sent.
            assert!((at - home_deg - self.device().deg()).abs() < 1e-9, "{at} for {angle}");
        }
        self.device().power_cycle();
        let error = self.stage.angle_deg(&self.within(60)).unwrap_err().to_string();
        assert!(error.contains(lost), "{error}");
    }

    /// The battery of what goes wrong with every stage: a move that takes longer than it may is stopped and told where; one that is cancelled does not begin; one that meets an obstacle says so and where, and the next one
    /// is right when that is gone; then `own` faults of this stage; and one whose controller says nothing any more is not said to stand.
    pub fn battery(&mut self, trial: Trial, own: impl FnOnce(&mut Self)) {
        self.stage.home(&self.within(60)).unwrap();
        let begun = self.clock.now();
        let error = self.stage.move_to(trial.far_deg, &self.within(trial.too_short_s)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
        let took = self.clock.now() - begun;
        assert!(took < Duration::from_secs(trial.too_short_s + 2), "it took {took:?}");
        assert!(self.device().is_standing());
        let place = self.device().deg();
        let near = 0.5 / D::PER_DEG + 1e-9;
        assert!((error.done.unwrap() - place).abs() < near, "{error:?}, it is at {place}");
        assert!(place > trial.beyond_deg, "{place}: it did not move");
        let cancel = Cancel::new();
        cancel.cancel();
        let error = self.stage.move_to(2.0, &self.within(60).with_cancel(&cancel)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
        let place = self.device().deg();
        let (obstacle, words) = trial.obstacle;
        self.device().set_obstacle(Some(D::REFERENCE + obstacle));
        let at = obstacle as f64 / D::PER_DEG;
        let beyond = if at > place { 90.0 } else { 2.0 };
        let (error, stands) = self.fails(beyond);
        assert!(error.contains(words), "{error}");
        assert!((stands.unwrap() - at).abs() < 1e-9, "{stands:?}, it is at {at}");
        self.device().set_obstacle(None);
        let again = self.stage.move_to(beyond, &self.within(60)).unwrap();
        assert!((again - beyond).abs() <= near, "the old fault is over: {again}");
        own(self);
        self.device().die();
        let error = self.stage.home(&self.within(60)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::NotStopped { .. }), "{error}");
    }
}

/// The battery's numbers for a stage.
pub struct Trial {
    /// An angle that it cannot reach within so many s, and one that it passes by then.
    pub far_deg: f64,
    pub too_short_s: u64,
    pub beyond_deg: f64,
    /// Counts from the reference to an obstacle on its way, and words of the error there.
    pub obstacle: (i64, &'static str),
}

pub fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Declined { .. } => "declined",
        DeviceError::Refused { .. } => "refused",
        DeviceError::Rejected { .. } => "rejected",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotReady { .. } => "not ready",
        DeviceError::LimitHit { .. } => "limit hit",
        DeviceError::Stalled { .. } => "stalled",
        DeviceError::NotStopped { .. } => "not stopped",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// A stage on a line with faults.
pub trait Rig {
    type Axis: Axis;
    /// How far from the angle that it was sent to it may come to rest, deg.
    const WITHIN_DEG: f64;
    fn open(
        faults: Faults,
        seed: u64,
        deadline: &Deadline,
    ) -> Result<Turning<Self::Axis>, DeviceError>;
    /// Where the motor stands, deg from its reference, and whether it stands.
    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool);
    fn injected(stage: Turning<Self::Axis>) -> Injected;
}

/// One life of a stage on a bad line. Panics on a wrong number or a missed deadline.
pub fn run<R: Rig>(faults: Faults, seed: u64) -> (Result<(), &'static str>, Injected, Duration) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let grace = TurningSettings::default().stop_within + Duration::from_millis(50);
    let bounded = |start: Duration, s: u64| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: it took {took:?}");
    };
    let mut stage = match R::open(faults, seed, &within(10)) {
        Ok(stage) => stage,
        Err(error) => {
            bounded(Duration::ZERO, 10);
            return (Err(name(&error)), Injected::default(), clock.now());
        }
    };
    let mut end = Ok(());
    let mut step = |stage: &mut Turning<R::Axis>, target: Option<f64>| {
        let start = clock.now();
        let done = match target {
            None => stage.home(&within(60)),
            Some(target) => stage.move_to(target, &within(60)),
        };
        bounded(start, 60);
        let (place, stands) = R::truth(stage);
        match done {
            Ok(angle) => {
                let wanted = target.unwrap_or(0.0);
                assert!(stands, "seed {seed}");
                assert!((angle - place).abs() < 1e-6, "seed {seed}: {angle}, it is at {place}");
                assert!(
                    (angle - wanted).abs() <= R::WITHIN_DEG,
                    "seed {seed}: {angle} of {wanted}"
                );
                true
            }
            Err(interrupted) => {
                if let Some(at) = interrupted.done {
                    assert!((at - place).abs() < 1e-6, "seed {seed}: {at}, it is at {place}");
                    assert!(stands, "seed {seed}: said to be stopped");
                }
                end = Err(name(&interrupted.error));
                false
            }
        }
    };
    let targets = [None, Some(3.5), Some(30.0), Some(-12.5), Some(100.0), Some(12.5)];
    let _ = targets.into_iter().all(|target| step(&mut stage, target));
    (end, R::injected(stage), clock.now())
}

/// A thousand seeds on three kinds of bad lines: each ends right or with a named error, in time.
pub fn thousand<R: Rig>(least_right: u32) {
    let mild = Faults {
        // Of each byte.
        delay: 0.000_5,
        longest_delay: Duration::from_millis(200),
        drop: 0.000_1,
        flip: 0.000_1,
        short_read: 0.2,
        silence: 0.000_2,
        disconnect: 0.0,
    };
    let bad = Faults {
        delay: 0.002,
        longest_delay: Duration::from_millis(700),
        drop: 0.000_5,
        flip: 0.000_5,
        short_read: 0.5,
        silence: 0.001,
        disconnect: 0.0,
    };
    let breaking = Faults { disconnect: 0.000_5, ..mild };
    let mut ends: BTreeMap<(&str, String), u32> = BTreeMap::new();
    let mut sum = Injected::default();
    for seed in 0..1002 {
        let (kind, faults) =
            [("mild", mild), ("bad", bad), ("breaking", breaking)][seed as usize % 3];
        let (end, injected, _) = run::<R>(faults, seed);
        *ends.entry((kind, format!("{end:?}"))).or_default() += 1;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.silences += injected.silences;
    }
    eprintln!("{ends:#?}\n{sum:?}");
    let right = |kind| ends.get(&(kind, "Ok(())".into())).copied().unwrap_or(0);
    assert!(sum.drops > 100 && sum.flips > 100 && sum.silences > 50, "{sum:?}");
    // Repetition helps: most mild runs are right; the others are not all errors.
    assert!(right("mild") >= least_right, "{ends:?}");
    assert!(right("breaking") < 330, "{ends:?}");
    assert_eq!(run::<R>(bad, 4), run::<R>(bad, 4), "the same seed, the same run");
    assert_eq!(run::<R>(Faults::NONE, 1).0, Ok(()));
}

#[derive(Clone, Copy, PartialEq)]
pub enum Cable {
    Good,
    /// Pulled out after so many pieces of the host.
    Cut(u32),
    /// A byte of the answer to this piece of the host is spoilt.
    Flip(u32),
}

/// Events at the device before a piece of the host.
pub type Before<D> = Option<(u32, fn(&mut D))>;

/// One conversation: the device, what happens to the cable and, before a piece of the host, to the device, and how it ends.
pub struct Case<D> {
    pub name: &'static str,
    pub device: D,
    pub cable: Cable,
    pub before: Before<D>,
    pub end: &'static str,
}

impl<D> Case<D> {
    pub fn new(name: &'static str, device: D, end: &'static str) -> Self {
        Self { name, device, cable: Cable::Good, before: None, end }
    }

    /// The same with a change of the device.
    pub fn with(mut self, change: fn(&mut D)) -> Self {
        change(&mut self.device);
        self
    }

    /// The same with another cable.
    pub fn on(self, cable: Cable) -> Self {
        Self { cable, ..self }
    }

    /// The same with something that happens to the device before a piece of the host.
    pub fn before(self, piece: u32, act: fn(&mut D)) -> Self {
        Self { before: Some((piece, act)), ..self }
    }
}

/// The conversations that each stage has: all well, ending with `good`; silence; a byte of the answer to a piece that is spoilt; the cable out after a piece.
pub fn usual<D: Counterpart>(
    device: fn() -> D,
    good: &'static str,
    spoilt: u32,
    cut: u32,
) -> Vec<Case<D>> {
    vec![
        Case::new("good", device(), good),
        Case::new("silence", device(), "open: no answer but 0 bytes").with(D::die),
        Case::new("spoilt", device(), good).on(Cable::Flip(spoilt)),
        Case::new("disconnect", device(), "home: gone after 0 bytes; not stopped")
            .on(Cable::Cut(cut)),
    ]
}

struct Line<D> {
    inner: InMemory<D>,
    cable: Cable,
    before: Before<D>,
    sent: u32,
    heard: u32,
}

impl<D: Speaker> Bytes for Line<D> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.sent += 1;
        self.heard = 0;
        if let Some((at, act)) = self.before
            && at == self.sent
        {
            act(&mut self.inner.device);
        }
        self.inner.send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if matches!(self.cable, Cable::Cut(n) if self.sent >= n) {
            return Err(TransportError::disconnected("the simulated stage"));
        }
        let count = self.inner.receive(buffer, deadline)?;
        if self.cable == Cable::Flip(self.sent) && self.heard == 0 {
            buffer[0] ^= 0x40;
        }
        self.heard += 1;
        Ok(count)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.inner.discard(deadline)
    }
}

/// Opens a stage on any line.
pub type Open = fn(Box<dyn Bytes>, &Deadline) -> Result<Box<dyn RotationStage>, DeviceError>;

/// Opens the stage, homes it, turns it to 10°, and tells how that ended.
fn session(line: Box<dyn Bytes>, open: Open, clock: &Arc<dyn Clock>) -> String {
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let mut stage = match open(line, &within(10)) {
        Ok(stage) => stage,
        Err(error) => return format!("open: {}", words(&error)),
    };
    if let Err(interrupted) = stage.home(&within(30)) {
        return format!("home: {}", words(&interrupted.error));
    }
    match stage.move_to(10.0, &within(30)) {
        Ok(angle) => format!("{angle:.4} deg"),
        Err(interrupted) => {
            let at = interrupted.done.map(|at| format!("{at:.4}"));
            format!("move, at {at:?}: {}", words(&interrupted.error))
        }
    }
}

fn words(error: &DeviceError) -> String {
    match error {
        DeviceError::NotStopped { source, .. } => format!("{}; not stopped", words(source)),
        other => super::words::words(other),
    }
}

/// Replays every case's recording strictly; with `SUNGLINT_UPDATE=1` records it anew first.
pub fn fixtures<D: Speaker + 'static>(folder: &str, model: &str, open: Open, cases: Vec<Case<D>>) {
    for Case { name, device, cable, before, end } in cases {
        let path = fixture(&format!("{folder}/{name}.rec"));
        let clock = || -> Arc<dyn Clock> { Arc::new(VirtualClock::new()) };
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let header = Header {
                device: model.to_owned(),
                source: "sunglint's simulated device".into(),
                host: Some("sunglint's driver".into()),
                recorded: None,
                synthetic: true,
            };
            let inner = InMemory::new(device);
            let line = Line { inner, cable, before, sent: 0, heard: 0 };
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            let line = Recorded::create(line, &path, &header, Overwrite::Allow).unwrap();
            assert_eq!(session(Box::new(line), open, &clock()), end, "recording {name}");
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{name} was made up, and says so");
        let replay = std::sync::Arc::new(std::sync::Mutex::new(Replay::new(recording)));
        assert_eq!(session(Box::new(Shared(replay.clone())), open, &clock()), end, "{name}");
        let nothing = Replay::new(Recording::new(
            Header {
                device: String::new(),
                source: String::new(),
                host: None,
                recorded: None,
                synthetic: true,
            },
            [],
        ));
        let replay = std::mem::replace(&mut *replay.lock().unwrap(), nothing);
        replay.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

struct Shared(Arc<std::sync::Mutex<Replay>>);

impl Bytes for Shared {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.0.lock().unwrap().send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        self.0.lock().unwrap().receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.0.lock().unwrap().discard(deadline)
    }
}
