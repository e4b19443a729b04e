//! `sunglint track`: a mount follows a satellite, for the eye at the eyepiece.

use crate::interrupt::{Hangup, listen};
use crate::mount::{self, MountArgs};
use crate::output::{Console, OutputArgs, Usage};
use crate::star::when;
use crate::station::StationArgs;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use hifitime::{Epoch, Unit};
use std::io::{BufRead as _, Write as _};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{DeviceError, Mount};
use sunglint_ephemeris::orbit::{Orbit, ReadError};
use sunglint_observatory::telescope::watchdog::{Beat, Process, Watched, watch};
use sunglint_observatory::telescope::{
    Certainty, Guard, PARK_WITHIN, Parked, PassPlan, PointingModel, TargetPath, TrackError,
    TrackOptions, TrackStep, Tracker, Weather, WeatherFile, park,
};
use sunglint_observatory::{PreflightOptions, check_pass, clock};
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;
use sunglint_rehearsal::track::{self, Limits, Rehearsal, VirtualMount};
use sunglint_report::track::{TrackReport, plan_text, step_text};

/// Lowest altitude, deg, where nothing is said.
const LOWEST_DEG: f64 = 10.0;

/// Arguments of `sunglint track`.
#[derive(Debug, Args)]
pub struct TrackArgs {
    /// File of elements (two lines, or OMM in JSON, CSV, XML or KVN), or of positions (OEM, CPF, ECSV)
    #[arg(value_name = "ELEMENTS")]
    pub elements: PathBuf,
    /// The object: its catalogue number, or part of its name
    #[arg(value_name = "OBJECT")]
    pub object: String,
    /// The mount: `indi-telescope:HOST:PORT/NAME` (see `sunglint devices list`), or a rehearsal with `virtual` (azimuth and altitude), `virtual-equatorial` or `virtual-german`
    #[arg(long, value_name = "ADDRESS")]
    pub mount: String,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// The pass that is on at this time, or the first after it: UTC, ISO 8601, or `now`
    #[arg(long, value_name = "TIME", default_value = "now")]
    pub at: String,
    /// How the mount shows directions: a file of `sunglint pointing`
    #[arg(long, value_name = "FILE")]
    pub pointing: Option<PathBuf>,
    /// Only says what would be done: slew, flip, keyhole, distance from the Sun; nothing moves
    #[arg(long)]
    pub dry_run: bool,
    /// Stops after so many seconds of the pass
    #[arg(long, value_name = "S")]
    pub for_s: Option<f64>,
    /// Time from a command to the mount's doing it, s
    #[arg(long, value_name = "S", default_value_t = 0.25)]
    pub latency_s: f64,
    /// Hour angle past the meridian up to which a German mount follows before it is turned over, degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0)]
    pub past_meridian: f64,
    /// Speed of the mount's slews, degrees a second: how far ahead of the target it is sent when it is turned over; without it that of its rates, 2 at least
    #[arg(long, value_name = "DEG_S")]
    pub slew_deg_s: Option<f64>,
    /// Limits that keep the mount safe.
    #[command(flatten)]
    pub safe: MountArgs,
    /// How much later than predicted the target comes, s
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    pub late_s: f64,
    /// Park the mount at the end, where the Sun is down
    #[arg(long)]
    pub park: bool,
    /// Stop, and park, when this file says that the weather is bad, or is older than --weather-age-s: a Boltwood line, or `safe` and `unsafe`
    #[arg(long, value_name = "FILE")]
    pub weather: Option<PathBuf>,
    /// Age at which the file of the weather counts as bad weather, s
    #[arg(long, value_name = "S", default_value_t = 300.0, requires = "weather")]
    pub weather_age_s: f64,
    /// Seconds between two lines that say how it goes
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    pub every: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Arguments of the watchdog's process.
#[derive(Debug, Args)]
pub struct WatchdogArgs {
    /// The mount
    pub mount: String,
}

impl TrackArgs {
    fn check(&self) -> anyhow::Result<()> {
        self.out.check()?;
        let within = |name: &str, value: f64, least: f64, most: f64| {
            if (least..=most).contains(&value) {
                Ok(())
            } else {
                Err(Usage(format!("--{name} is {value}, expected {least} to {most}")))
            }
        };
        within("latency-s", self.latency_s, 0.0, 5.0)?;
        within("past-meridian", self.past_meridian, 0.0, 85.0)?;
        within("slew-deg-s", self.slew_deg_s.unwrap_or(1.0), 0.1, 100.0)?;
        within("late-s", self.late_s, -60.0, 60.0)?;
        within("weather-age-s", self.weather_age_s, 10.0, 3600.0)?;
        within("every", self.every, 0.05, 3600.0)?;
        within("for-s", self.for_s.unwrap_or(1.0), 0.1, 86_400.0)?;
        self.safe.check(LOWEST_DEG)?;
        Ok(())
    }

    fn orbit(&self, at: Epoch) -> anyhow::Result<Orbit> {
        match Orbit::read(&self.elements, Some(&self.object), Some(at)) {
            Err(error @ ReadError::Choice { .. }) => Err(Usage(error.to_string()).into()),
            other => Ok(other?),
        }
    }
}

/// Follows.
///
/// # Errors
/// An unsafe request, a mount that does not do what it is told, elements without a pass.
pub fn run(args: &TrackArgs, console: Console) -> anyhow::Result<()> {
    args.check()?;
    let at = when(&args.at).context("--at")?;
    let station = args.station.get()?;
    let orbit = args.orbit(at)?;
    // A target that comes late is where its elements say that it was before.
    let asked = at - args.late_s * Unit::Second;
    let (from, seconds) =
        track::next_pass(&orbit, &station, asked, args.safe.lowest_deg(LOWEST_DEG), args.for_s)?;
    let times = (from, from + seconds * Unit::Second);
    for warning in orbit.warnings(times.0, times.1) {
        console.warn(&warning);
    }
    let concerns = check_pass(&orbit, times, &station, &PreflightOptions::default());
    for concern in concerns.map_err(anyhow::Error::msg)? {
        console.warn(&format!("{}: {}", concern.about, concern.text));
    }
    if let Some(mount) = VirtualMount::named(&args.mount) {
        if args.pointing.is_some() {
            return Err(
                Usage("--pointing is of a real mount, and this is a rehearsal".into()).into()
            );
        }
        return rehearse(args, console, &station, &orbit, (from, seconds), mount);
    }
    let ahead_s =
        args.late_s + (from - Epoch::now().context("the system has no clock")?).to_seconds();
    if !args.dry_run && ahead_s > 3600.0 {
        bail!(
            "the pass begins in {:.1} h: start this within the hour before, or look at it with --dry-run",
            ahead_s / 3600.0
        );
    }
    let mut mount = args.safe.open(&args.mount)?;
    let abilities = mount.abilities().clone();
    let guard = args.safe.guard(LOWEST_DEG, &station, &abilities);
    let soon = || Deadline::within(Duration::from_secs(5));
    if !args.dry_run {
        args.safe.tell_site(mount.as_mut(), &station)?;
    }
    let doubt = guard.doubt(mount.as_mut(), &soon())?;
    let state = clock::measured();
    let certainty = Certainty { synchronised: state.synchronised, error_s: state.error_s };
    let doubts = [doubt, certainty.check().err().filter(|_| !args.safe.trust_clock)];
    let earth = EarthOrientation::embedded();
    let path = TargetPath::new(
        &orbit,
        &station.site,
        earth,
        (from, seconds),
        abilities.axes,
        args.safe.refracts(mount.as_ref(), console),
    )?
    .later(args.late_s);
    let path = match args.pointing.as_deref().map(PointingModel::read).transpose()? {
        Some(model) => model.path(path)?,
        None => path,
    };
    let stands = path.angles_of(&mount.reading(&soon())?);
    let mut options = options(args);
    let plan = PassPlan::new(&orbit.name(), &path, &guard, &abilities, Some(stands), &options);
    let mut report = TrackReport::planned(plan, args.mount.clone());
    if args.dry_run {
        for doubt in doubts.into_iter().flatten() {
            console.warn(&format!("it would not move: {doubt}"));
        }
        return args.out.finish(&report.product(&[])?, &report.text(), console);
    }
    if let Some(doubt) = doubts.into_iter().flatten().next() {
        return Err(doubt.into());
    }
    if let Some(why) = &report.plan.refused {
        bail!("{why}");
    }
    let mut sky = Sky::new(args);
    if let Some(why) = sky.unfit() {
        bail!("the weather is not fit: {why}");
    }
    console.say(&plan_text(&report.plan, &args.mount));
    let cancel = Cancel::new();
    let (token, stops) = (cancel.clone(), Arc::new(AtomicU32::new(0)));
    let asked = stops.clone();
    listen(Hangup::Ends, move || {
        asked.fetch_add(1, Ordering::SeqCst);
        token.cancel();
    })?;
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut dog = Process::start(&program, &args.mount)?;
    options.watch_clock = true;
    let (clock, pulse) = (DeviceClock::live(), dog.pulse());
    let mut tracker = Tracker::new(&path, &guard, mount.as_mut(), None, clock, options)
        .beating(move || pulse.tick());
    let mut lines = Lines::new(args.every, console);
    let mut watched = true;
    let ended = tracker.run(&cancel, &mut |step| {
        watched = dog.beat().is_continue();
        lines.show(step);
        match watched && sky.unfit().is_none() {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        }
    });
    drop(tracker);
    let weather = sky.unfit();
    let mut ended = ended.map_err(|error| dog.explain(error));
    let stands = !matches!(ended, Err(TrackError::Device(DeviceError::NotStopped { .. })));
    let by_hand = matches!(ended, Err(TrackError::ByHand { .. }));
    if !watched && ended.is_ok() {
        let what = "it has gone, and nobody would stop the mount: it was stopped".into();
        ended = Err(match dog.was_silent() {
            true => TrackError::Silent,
            false => DeviceError::Lost { device: "watchdog", what }.into(),
        });
    }
    let parks = stands && watched && !by_hand && (args.park || weather.is_some());
    let done = match parks {
        true => parked(mount.as_mut(), &guard, &mut dog, &stops, console),
        false => Ok(()),
    };
    if stands && watched && done.is_ok() {
        dog.done();
    } else {
        // It stops the mount over its own connection.
        drop(dog);
    }
    finish(args, console, &mut report, ended, &lines.steps, &[])?;
    done?;
    match weather {
        Some(why) => Err(anyhow!("it was stopped, because the weather is not fit: {why}")),
        None => Ok(()),
    }
}

/// Parks a mount that stands, under the watchdog's eyes, and says how that went. Ctrl-C stops it: another one than that which ended the following.
fn parked(
    mount: &mut dyn Mount,
    guard: &Guard,
    dog: &mut Process,
    stops: &AtomicU32,
    console: Console,
) -> anyhow::Result<()> {
    let before = stops.load(Ordering::SeqCst);
    console.say("the mount is parked; Ctrl-C stops it");
    dog.pulse().busy(PARK_WITHIN);
    let done = park(mount, guard, &DeviceClock::live(), &mut || match stops.load(Ordering::SeqCst)
        == before
    {
        true => dog.beat(),
        false => ControlFlow::Break(()),
    });
    match done.context("it is not known whether the mount is parked")? {
        Parked::Parked => console.say(Parked::Parked.text()),
        Parked::SunIsUp => console.warn(Parked::SunIsUp.text()),
        other => bail!("{}", other.text()),
    }
    Ok(())
}

/// The weather, looked at every five seconds; bad weather stays.
struct Sky {
    file: Option<WeatherFile>,
    looked: Option<Instant>,
    bad: Option<String>,
}

impl Sky {
    fn new(args: &TrackArgs) -> Self {
        let age = Duration::from_secs_f64(args.weather_age_s);
        let file = args.weather.as_ref().map(|path| WeatherFile::new(path, age));
        Self { file, looked: None, bad: None }
    }

    fn unfit(&mut self) -> Option<String> {
        const EVERY: Duration = Duration::from_secs(5);
        if let Some(file) = &self.file
            && self.bad.is_none()
            && self.looked.is_none_or(|looked| looked.elapsed() >= EVERY)
        {
            self.looked = Some(Instant::now());
            if let Weather::Unfit(why) = file.look(std::time::SystemTime::now()) {
                self.bad = Some(why);
            }
        }
        self.bad.clone()
    }
}

fn options(args: &TrackArgs) -> TrackOptions {
    let mut options = TrackOptions::default();
    options.latency_s = args.latency_s;
    options.past_meridian_deg = args.past_meridian;
    options.slew_deg_s = args.slew_deg_s;
    if let Some(speed) = args.slew_deg_s {
        options.slew_within_s = options.slew_within_s.max(360.0 / speed + 60.0);
    }
    options.german = !args.safe.fork;
    options
}

fn finish(
    args: &TrackArgs,
    console: Console,
    report: &mut TrackReport,
    ended: Result<sunglint_observatory::telescope::TrackSummary, TrackError>,
    steps: &[TrackStep],
    truth: &[[f64; 2]],
) -> anyhow::Result<()> {
    let failed = match ended {
        Ok(summary) => {
            report.ended = summary.cancelled.then(|| "stopped by hand".to_owned());
            report.went(summary, steps);
            report.knows(steps, truth);
            None
        }
        Err(error) => {
            report.ended = Some(error.to_string());
            Some(error)
        }
    };
    args.out.finish(&report.product(steps)?, &report.text(), console)?;
    match failed {
        None => Ok(()),
        Some(error) => Err(error.into()),
    }
}

/// A rehearsal with a virtual telescope.
fn rehearse(
    args: &TrackArgs,
    console: Console,
    station: &Station,
    orbit: &Orbit,
    span: (Epoch, f64),
    mount: VirtualMount,
) -> anyhow::Result<()> {
    let wanted = Rehearsal {
        limits: Limits {
            min_altitude_deg: args.safe.lowest_deg(LOWEST_DEG),
            sun_limit_deg: args.safe.sun_limit,
        },
        late_s: args.late_s,
        known: args.safe.known()?,
        options: options(args),
        only_plan: args.dry_run,
    };
    let done = track::rehearse(orbit, station, span, mount, &wanted, &Cancel::new())?;
    let mut report = TrackReport::planned(done.plan, args.mount.clone());
    if args.dry_run {
        return args.out.finish(&report.product(&[])?, &report.text(), console);
    }
    let Some(ended) = done.ended else {
        bail!("{}", report.plan.refused.as_deref().unwrap_or("the plan is refused"));
    };
    let every = (args.every / 0.1).round().max(1.0) as usize;
    if console.verbose > 0 {
        done.steps.iter().step_by(every).for_each(|step| console.detail(&step_text(step)));
    }
    finish(args, console, &mut report, ended, &done.steps, &done.truth)
}

/// Lines on stderr while it goes.
struct Lines {
    every: Duration,
    shown: Option<Instant>,
    console: Console,
    steps: Vec<TrackStep>,
}

impl Lines {
    fn new(every_s: f64, console: Console) -> Self {
        Self { every: Duration::from_secs_f64(every_s), shown: None, console, steps: Vec::new() }
    }

    fn show(&mut self, step: &TrackStep) {
        // Four hours of ten a second.
        const MOST: usize = 200_000;
        if self.steps.len() < MOST {
            self.steps.push(*step);
        }
        if self.shown.is_none_or(|shown| shown.elapsed() >= self.every) {
            self.shown = Some(Instant::now());
            self.console.say(&step_text(step));
        }
    }
}

/// The watchdog's process.
///
/// # Errors
/// The mount cannot be reached, or not be stopped.
pub fn watchdog(args: &WatchdogArgs) -> anyhow::Result<()> {
    let mut mount = mount::open(&args.mount)?;
    let (beats, received) = mpsc::channel();
    let by_hand = beats.clone();
    listen(Hangup::Ends, move || {
        let _ = by_hand.send(Beat::Stop);
    })?;
    let tell = beats;
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            let beat = match line.as_deref() {
                Ok("a") => Beat::Alive,
                Ok("d") => Beat::Done,
                _ => break,
            };
            if tell.send(beat).is_err() {
                break;
            }
        }
        // The other end has gone: no beat comes any more.
    });
    println!("ready");
    std::io::stdout().flush()?;
    let watched = watch(mount.as_mut(), &received)?;
    drop(mount);
    match watched {
        Watched::Silent => {
            eprintln!(
                "sunglint: the watchdog stopped the mount: its tracker has ended or was silent for 0.5 s"
            );
        }
        Watched::Stopped => eprintln!("sunglint: the watchdog stopped the mount by hand"),
        Watched::Done => {}
    }
    match watched.status() {
        0 => Ok(()),
        // The tracker knows by it who stopped the mount.
        status => std::process::exit(i32::from(status)),
    }
}
