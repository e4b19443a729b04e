//! A session played back: its frames and bins come as if from devices.

use super::opener::Opener;
use super::plan::{CameraPlan, CounterPlan};
use hifitime::Epoch;
use serde_json::{Map, Value as Json};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{Clock, Deadline, DeviceClock, Expired};
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Identity, Interrupted, Origin, PhotonCounter, Setting, TagSink,
    Value, Window,
};
use sunglint_drivers::tags::{Tag, TagFile};
use sunglint_formats::session::{Counts, Frames, Session, What};
use sunglint_formats::{CountRecord, FileError, Frame};

/// In messages.
const DEVICE: &str = "playback";
/// The longest sleep between two looks at whether somebody wants to stop.
const SLICE: Duration = Duration::from_millis(20);
/// Behind the end of every recording.
const END: Duration = Duration::from_secs(100 * 365 * 86_400);

/// Devices that play a session back. Each goes on where it was when it is opened again.
#[derive(Debug)]
pub struct Playback {
    start: Epoch,
    reels: HashMap<String, Reel>,
}

#[derive(Debug)]
struct Reel {
    clock: Arc<ReelClock>,
    identity: Map<String, Json>,
    settings: Map<String, Json>,
    film: Arc<Mutex<Film>>,
}

#[derive(Debug)]
enum Film {
    Frames(Frames, usize),
    Counts(Box<Counts>, Option<TagReel>),
}

/// Raw tags, played up to the end of each bin.
#[derive(Debug)]
struct TagReel {
    file: TagFile,
    next: u64,
}

impl TagReel {
    /// Hands over the records up to the first that is at `until_ps` or later.
    fn play(&mut self, until_ps: i64, sink: &mut TagSink) -> Result<(), FileError> {
        /// Records that are read at once.
        const PIECE: u64 = 1 << 12;
        while self.next < self.file.len() {
            let range = self.next..self.file.len().min(self.next + PIECE);
            let mut records = Vec::new();
            let mut more = true;
            self.file.for_each(range.clone(), |tags| {
                let due = |record: &&[u8; 16]| Tag::from_bytes(record).time_ps < until_ps;
                records.extend(tags.records().iter().take_while(due));
                Ok::<_, FileError>(())
            })?;
            if (records.len() as u64) < range.end - range.start {
                more = false;
            }
            self.next += records.len() as u64;
            sink.take(records);
            if !more {
                break;
            }
        }
        Ok(())
    }
}

/// At speed, or as fast as it can; at the end of a recording it jumps behind the end of every night.
#[derive(Debug)]
struct ReelClock {
    begun: Option<Instant>,
    skipped_ns: AtomicU64,
}

impl ReelClock {
    fn skip(&self, time: Duration) {
        let step = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let add = |now: u64| Some(now.saturating_add(step));
        let _ = self.skipped_ns.fetch_update(Ordering::SeqCst, Ordering::SeqCst, add);
    }
}

impl Clock for ReelClock {
    fn now(&self) -> Duration {
        let skipped = Duration::from_nanos(self.skipped_ns.load(Ordering::SeqCst));
        skipped.saturating_add(self.begun.map_or(Duration::ZERO, |begun| begun.elapsed()))
    }

    fn sleep(&self, time: Duration) {
        match self.begun {
            Some(_) => std::thread::sleep(time),
            None => self.skip(time),
        }
    }
}

impl Playback {
    /// Makes the playback of all devices of a session: at the session's speed, or `fast`.
    ///
    /// # Errors
    /// The errors of [`Session::events`], [`Session::frames`] and [`Session::counts`].
    pub fn new(session: &Session, fast: bool) -> Result<Self, FileError> {
        let mut known = HashMap::new();
        for event in session.events()? {
            if let What::Device { device, identity, settings } = event?.what {
                known.insert(device, (identity, settings));
            }
        }
        let mut films: Vec<(String, Film)> = Vec::new();
        for name in session.cameras() {
            films.push((name.to_owned(), Film::Frames(session.frames(name)?, 0)));
        }
        for name in session.counters() {
            let tags = session.tags(name)?.map(TagFile::recover).transpose()?;
            let tags = tags.map(|(file, _)| TagReel { file, next: 0 });
            films.push((name.to_owned(), Film::Counts(Box::new(session.counts(name)?), tags)));
        }
        let mut reels = HashMap::new();
        for (name, film) in films {
            let begun = (!fast).then(Instant::now);
            let clock = Arc::new(ReelClock { begun, skipped_ns: AtomicU64::new(0) });
            let (identity, settings) = known.remove(&name).unwrap_or_default();
            let film = Arc::new(Mutex::new(film));
            reels.insert(name, Reel { clock, identity, settings, film });
        }
        Ok(Self { start: session.manifest().start_utc, reels })
    }

    /// When the night of a playback ends: never, but a device's clock jumps there once its recording is over.
    pub fn end(&self) -> Epoch {
        self.start + hifitime::Duration::from_seconds(0.5 * END.as_secs_f64())
    }

    fn player(&self, name: &str) -> Result<Player, DeviceError> {
        let reel = self.reels.get(name).ok_or_else(|| DeviceError::Unknown {
            name: "device",
            asked: name.to_owned(),
            known: self.reels.keys().cloned().collect::<Vec<_>>().join(", "),
        })?;
        let text = |key: &str| reel.identity.get(key).and_then(Json::as_str).map(str::to_owned);
        Ok(Player {
            start: self.start,
            clock: reel.clock.clone(),
            film: reel.film.clone(),
            identity: Identity {
                vendor: text("vendor").unwrap_or_default(),
                model: text("model").unwrap_or_default(),
                serial: text("serial"),
                firmware: text("firmware"),
                driver: DEVICE,
            },
            settings: reel.settings.clone(),
            sink: None,
            channels: match &*lock(&reel.film) {
                Film::Counts(counts, _) => counts.channels().to_vec(),
                Film::Frames(..) => vec![],
            },
        })
    }
}

impl Opener for Playback {
    fn clock(&self, device: &str) -> DeviceClock {
        match self.reels.get(device) {
            Some(reel) => DeviceClock { clock: reel.clock.clone(), zero_utc: Some(self.start) },
            None => DeviceClock::live(),
        }
    }

    fn camera(&self, plan: &CameraPlan, _: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
        Ok(Box::new(self.player(&plan.name)?))
    }

    fn counter(
        &self,
        plan: &CounterPlan,
        _: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        Ok(Box::new(self.player(&plan.name)?))
    }

    fn streams_tags(&self, plan: &CounterPlan) -> bool {
        let film = self.reels.get(&plan.name).map(|reel| lock(&reel.film));
        film.is_some_and(|film| matches!(*film, Film::Counts(_, Some(_))))
    }

    fn keeps_numbers(&self) -> bool {
        true
    }
}

fn lock(film: &Mutex<Film>) -> MutexGuard<'_, Film> {
    film.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A device that plays.
#[derive(Debug)]
struct Player {
    start: Epoch,
    clock: Arc<ReelClock>,
    film: Arc<Mutex<Film>>,
    identity: Identity,
    settings: Map<String, Json>,
    channels: Vec<String>,
    sink: Option<TagSink>,
}

fn unreadable(error: FileError) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason: error.to_string() }
}

fn cannot(reason: &'static str) -> DeviceError {
    DeviceError::NotReady { device: DEVICE, reason }
}

impl Player {
    /// Waits until then: as long as it takes, for a recording may have gaps. Ctrl-C ends it.
    fn wait_until(&self, then: Epoch, deadline: &Deadline) -> Result<(), DeviceError> {
        let clock = DeviceClock { clock: self.clock.clone(), zero_utc: Some(self.start) };
        loop {
            if let Err(expired @ Expired::Cancelled { .. }) = deadline.remaining() {
                return Err(DeviceError::expired(DEVICE, "waiting", expired));
            }
            let left = clock.until(then);
            if left.is_zero() {
                return Ok(());
            }
            let live = self.clock.begun.is_some();
            self.clock.sleep(if live { left.min(SLICE) } else { left });
        }
    }

    /// The recording is over: so is the device's night.
    fn over(&self) -> DeviceError {
        self.clock.skip(END);
        cannot("the recording is over")
    }

    fn next_frame(&self) -> Result<Option<Frame>, DeviceError> {
        let Film::Frames(frames, next) = &mut *lock(&self.film) else { return Ok(None) };
        let Some(file) = frames.files.get(*next) else { return Ok(None) };
        // One that cannot be read is told once.
        *next += 1;
        file.read().map(Some).map_err(unreadable)
    }

    /// Hands over the tags before `until_ps`; all that are left with the end of time.
    fn play_tags(&mut self, until_ps: i64) -> Result<(), DeviceError> {
        match (&mut *lock(&self.film), &mut self.sink) {
            (Film::Counts(_, Some(tags)), Some(sink)) => {
                tags.play(until_ps, sink).map_err(unreadable)
            }
            _ => Ok(()),
        }
    }

    fn next_bin(&self) -> Result<Option<CountRecord>, DeviceError> {
        match &mut *lock(&self.film) {
            Film::Counts(counts, _) => counts.next().transpose().map_err(unreadable),
            Film::Frames(..) => Ok(None),
        }
    }
}

/// The end of an exposure or of a bin.
fn after(start: Epoch, s: f64) -> Epoch {
    start + hifitime::Duration::from_seconds(s)
}

impl Device for Player {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(self.identity.clone())
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let setting = |(name, value): (&String, &Json)| Setting {
            // Settings have names that live as long as the program; those of a few devices do.
            name: Box::leak(name.clone().into_boxed_str()),
            value: match value {
                Json::Bool(flag) => Value::Flag(*flag),
                Json::String(text) => Value::Text(text.clone()),
                number => number.as_i64().map_or_else(
                    || Value::Number(number.as_f64().unwrap_or(f64::NAN)),
                    Value::Integer,
                ),
            },
            origin: Origin::Configured,
        };
        Ok(self.settings.iter().map(setting).collect())
    }
}

/// A recording takes no settings.
const FIXED: &str = "a recording cannot be set";

impl Camera for Player {
    fn sensor_px(&self) -> [u32; 2] {
        [0, 0]
    }

    fn set_window(&mut self, _: Window, _: &Deadline) -> Result<Window, DeviceError> {
        Err(cannot(FIXED))
    }

    fn set_gain(&mut self, _: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Err(cannot(FIXED))
    }

    fn set_temperature_c(&mut self, _: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Err(cannot(FIXED))
    }

    fn expose(&mut self, _: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        let Some(frame) = self.next_frame()? else { return Err(self.over()) };
        self.wait_until(after(frame.start, frame.exposure_s), deadline)?;
        Ok(frame)
    }
}

impl PhotonCounter for Player {
    fn channels(&self) -> &[String] {
        &self.channels
    }

    fn set_trigger_level_v(&mut self, _: usize, _: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Err(cannot(FIXED))
    }

    fn set_input_delay_ps(&mut self, _: usize, _: i64, _: &Deadline) -> Result<i64, DeviceError> {
        Err(cannot(FIXED))
    }

    fn set_dead_time_ps(&mut self, _: usize, _: i64, _: &Deadline) -> Result<i64, DeviceError> {
        Err(cannot(FIXED))
    }

    fn start(&mut self, _: i64, _: &Deadline) -> Result<(), DeviceError> {
        Ok(())
    }

    fn streams_tags(&self) -> bool {
        matches!(*lock(&self.film), Film::Counts(_, Some(_)))
    }

    fn start_with_tags(&mut self, _: i64, sink: TagSink, _: &Deadline) -> Result<(), DeviceError> {
        self.sink = Some(sink);
        Ok(())
    }

    fn read(
        &mut self,
        bins: usize,
        deadline: &Deadline,
    ) -> Result<Vec<CountRecord>, Interrupted<Vec<CountRecord>>> {
        let mut done = Vec::new();
        while done.len() < bins {
            let next = match self.next_bin() {
                // Behind the last bin there may be tags of one that was not over.
                Ok(None) => self.play_tags(i64::MAX).and_then(|()| Err(self.over())),
                Ok(Some(bin)) => {
                    let end = after(bin.start, bin.length_ps as f64 * 1e-12);
                    self.wait_until(end, deadline)
                        .and_then(|()| self.play_tags(bin.start_ps.saturating_add(bin.length_ps)))
                        .map(|()| bin)
                }
                Err(error) => Err(error),
            };
            match next {
                Ok(bin) => done.push(bin),
                Err(error) => return Err(Interrupted::new(done, error)),
            }
        }
        Ok(done)
    }

    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        Ok(())
    }
}
