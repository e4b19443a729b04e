//! `sunglint observe`: a night from its plan to its session's folder. The night itself is [`sunglint_observatory`]'s.

pub use sunglint_drivers::clock::DeviceClock;

use crate::interrupt::{Hangup, listen};
use crate::output::{Console, Usage};
use anyhow::{anyhow, bail};
use clap::Args;
use indicatif::ProgressBar;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{Cancel, utc_now};
use sunglint_formats::text::printable;
use sunglint_observatory::{
    Catalogue, Level, LiveState, Night, NightClock, Opener, Plan, Preflight, PreflightOptions,
    ReplayError, Snapshot, Summary, free_bytes, preflight,
};
use sunglint_page::{LiveNight, Server};
use sunglint_radiometry::station::RecordedError;
use sunglint_rehearsal::{VirtualNight, planned};
use sunglint_report::observe as report;
use sunglint_report::preflight::text as preflight_text;

/// Time between two status lines where nobody says: on a terminal, and elsewhere.
const EVERY: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(10)];
/// The name and version that sessions get.
const PROGRAM: &str = concat!("sunglint ", env!("CARGO_PKG_VERSION"));

/// Arguments of `sunglint observe`.
#[derive(Debug, Args)]
pub struct ObserveArgs {
    /// The plan: station, devices, targets and when (docs/night.md)
    #[arg(value_name = "NIGHT.toml", required_unless_present_any = ["replay", "resume"])]
    pub night: Option<PathBuf>,
    /// Only says whether the night can be what the plan says: each visit against the sky, each device's ranges, the disk
    #[arg(long, conflicts_with_all = ["replay", "output", "every"])]
    pub check: bool,
    /// Begins in spite of errors of the check
    #[arg(long, conflicts_with = "check")]
    pub anyway: bool,
    /// Goes on with a night that was cut off, or ended too early: the same folder, its own plan as it stands now
    #[arg(long, value_name = "SESSION", conflicts_with_all = ["night", "check", "anyway", "replay", "output"])]
    pub resume: Option<PathBuf>,
    /// Plays a session's frames and counts back as devices, into a new session
    #[arg(long, value_name = "SESSION", conflicts_with = "night")]
    pub replay: Option<PathBuf>,
    /// With --replay: as fast as it can instead of at speed
    #[arg(long, requires = "replay")]
    pub fast: bool,
    /// The session's folder, to be made [default: the plan's `output` and `name`, with the date]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Ends the night when the terminal goes away; without it the night goes on, as under nohup
    #[arg(long)]
    pub end_on_hangup: bool,
    /// Shows the night in a browser and takes commands from it: prints the address [default: 127.0.0.1 and the first free port from 8650 on]
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "", conflicts_with = "check")]
    pub page: Option<String>,
    /// With --page: light curves that are drawn beneath the counts, such as what `sunglint simulate` predicts (ECSV)
    #[arg(long, value_name = "CURVE", requires = "page")]
    pub predicted: Vec<PathBuf>,
    /// With --page: magnitudes by the coefficients κ of this file, which `sunglint calibrate` wrote (ECSV)
    #[arg(long, value_name = "KAPPA", requires = "page")]
    pub calibration: Option<PathBuf>,
    /// With --page: shows the plan and records nothing until somebody presses Start on the page
    #[arg(long, requires = "page", conflicts_with_all = ["replay", "resume"])]
    pub wait: bool,
    /// A virtual night goes at the speed of time, so that it can be paused and steered; it begins now
    #[arg(long, conflicts_with_all = ["replay", "resume", "check"])]
    pub real_time: bool,
    /// Seconds between two lines that say how it goes [default: 1 on a terminal, else 10]
    #[arg(long, value_name = "S")]
    pub every: Option<f64>,
}

/// Observes.
///
/// # Errors
/// A plan that no night can follow, a session that cannot be played back, and data that are missing at the end.
pub fn run(args: &ObserveArgs, console: Console) -> anyhow::Result<()> {
    let every = match args.every {
        None => EVERY[usize::from(!std::io::stdout().is_terminal())],
        Some(s) if (0.05..=86_400.0).contains(&s) => Duration::from_secs_f64(s),
        Some(s) => return Err(Usage(format!("--every is {s}, expected 0.05 to 86400 s")).into()),
    };
    if let Some(plan) = &args.night {
        let found = checked(plan, args.output.as_deref())?;
        if args.check {
            console.result(&preflight_text(&found.0), &serde_json::to_value(&found.0)?)?;
            return refuse(plan, &found.0);
        }
        for finding in &found.0.findings {
            let (about, text) = (&finding.about, &finding.text);
            match finding.level {
                Level::Error => console.say(&format!("error: {about}: {text}")),
                Level::Warning => console.warn(&format!("{about}: {text}")),
                _ => {}
            }
        }
        // A virtual night can be anywhere and at any time.
        if !args.anyway && !found.1 {
            refuse(plan, &found.0)?;
        }
    }
    let page = args.page.as_deref().map(crate::page::address_of).transpose()?;
    let mut night = match (&args.night, &args.replay) {
        (_, Some(session)) => replayed(session, args.fast, args.output.as_deref())?,
        (Some(plan), None) => from_plan(plan, args)?,
        (None, None) if let Some(session) = &args.resume => {
            Night::resumed(session, Arc::new(Catalogue), PROGRAM)?
        }
        (None, None) => return Err(Usage("give a NIGHT.toml, or --replay SESSION".into()).into()),
    };
    night.watchdog = std::env::current_exe().ok();
    // The page's server lives as long as this.
    let _server = match page {
        None => None,
        Some(address) => {
            let state = Arc::new(LiveState::new());
            night.live = Some(state.clone());
            let curves = crate::page::predicted(&args.predicted)?;
            let calibration = crate::page::calibration(args.calibration.as_ref())?;
            let source = LiveNight::new(state, PROGRAM).beside(curves).calibrated(calibration);
            let server = Server::start(address, Arc::new(source))?;
            crate::page::announce(&server, "sees and steers the night", console);
            Some(server)
        }
    };
    let cancel = Cancel::new();
    let token = cancel.clone();
    let hangup = if args.end_on_hangup { Hangup::Ends } else { Hangup::GoesOn };
    listen(hangup, move || {
        if token.is_cancelled() {
            std::process::exit(1);
        }
        console.say("ending the session (Ctrl-C again ends the program at once)");
        token.cancel();
    })?;
    if let (true, Some(plan), Some(state)) = (args.wait, &args.night, night.live.clone()) {
        console.say("waiting for Start on the page; nothing is recorded yet");
        if !state.wait(&night, &cancel) {
            console.say("stopped before the start: nothing was recorded");
            return Ok(());
        }
        // From the plan as it stands now: what begins `now` begins now.
        night = from_plan(plan, args)?;
        night.live = Some(state);
    }
    if args.replay.is_none() {
        console.say(&report::clock_text(&night.manifest.clock));
    }
    let word = if night.resumes { "going on in" } else { "writing into" };
    console.say(&format!("{word} {}", night.root.display()));
    let mut display = Display::new(every, night.root.clone(), console);
    let summary = night.run(&cancel, &mut |snapshot| display.show(&snapshot))?;
    display.end();
    finish(&summary, console)
}

/// The pre-flight of a plan, and whether its night is virtual.
fn checked(path: &Path, output: Option<&Path>) -> anyhow::Result<(Preflight, bool)> {
    let mut made = None;
    let plan = Plan::read_with(path, &mut |request| {
        made = Some(VirtualNight::make(request)?);
        Ok(())
    })?;
    let opener: Arc<dyn Opener> = match made {
        Some(night) => Arc::new(night),
        None => Catalogue::of(&plan),
    };
    let mut options = PreflightOptions::default();
    options.folder = output.map(Path::to_path_buf);
    Ok((preflight(&plan, &opener, &options), plan.clock == NightClock::Virtual))
}

fn refuse(plan: &Path, found: &Preflight) -> anyhow::Result<()> {
    let errors = found.of(Level::Error).count();
    if errors > 0 {
        let plan = plan.display();
        bail!("{plan}: {errors} of its parts cannot be: correct them, or observe with --anyway");
    }
    Ok(())
}

/// The night of a plan, as the arguments want it.
fn from_plan(plan: &Path, args: &ObserveArgs) -> anyhow::Result<Night> {
    if args.real_time {
        return planned_in_real_time(plan, args.output.as_deref());
    }
    Ok(planned(plan, args.output.as_deref(), PROGRAM)?.0)
}

/// Time by which a virtual night's begin may lie before now, s: its light was computed meanwhile.
const BEHIND_S: f64 = 120.0;

/// A virtual night whose devices' clock is the computer's: it begins now, and takes its time.
fn planned_in_real_time(path: &Path, output: Option<&Path>) -> anyhow::Result<Night> {
    let mut made = None;
    let plan = Plan::read_with(path, &mut |request| {
        made = Some(VirtualNight::make(request)?.in_real_time());
        Ok(())
    })?;
    let path = path.display();
    let Some(made) = made else {
        return Err(Usage(format!(
            "--real-time: {path} is no virtual night, and takes its time anyway"
        ))
        .into());
    };
    let behind_s = (utc_now() - plan.from).to_seconds();
    if !(0.0..BEHIND_S).contains(&behind_s) {
        return Err(Usage(format!(
            "--real-time: {path} begins at another time: leave out its `from`, or write \"now\""
        ))
        .into());
    }
    Ok(Night::planned(plan, Arc::new(made), output, PROGRAM))
}

/// A night that is played back: the same devices by the same names, the same configuration, targets and times.
///
/// # Errors
/// A folder that is no session, or cannot be read.
pub fn replayed(session: &Path, fast: bool, output: Option<&Path>) -> anyhow::Result<Night> {
    Night::replayed(session, fast, output, PROGRAM).map_err(|error| match error {
        ReplayError::Station(RecordedError::Unknown { .. }) => anyhow!("{error}: give --station"),
        error => error.into(),
    })
}

/// Says how it goes: a line that changes on a terminal, else a line now and then, or JSON.
struct Display {
    every: Duration,
    shown: Option<Instant>,
    root: PathBuf,
    console: Console,
    bar: Option<ProgressBar>,
}

impl Display {
    fn new(every: Duration, root: PathBuf, console: Console) -> Self {
        let terminal = std::io::stderr().is_terminal() && !console.json && !console.quiet;
        let bar = terminal.then(|| {
            let bar = ProgressBar::new_spinner();
            match indicatif::ProgressStyle::with_template("{msg}") {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            }
        });
        Self { every, shown: None, root, console, bar }
    }

    fn show(&mut self, snapshot: &Snapshot) {
        for message in &snapshot.messages {
            match &self.bar {
                Some(bar) => bar.println(printable(message)),
                None if !self.console.json => self.console.say(message),
                None => {}
            }
        }
        let due = self.shown.is_none_or(|shown| shown.elapsed() >= self.every);
        if !due && (snapshot.messages.is_empty() || !self.console.json) {
            return;
        }
        self.shown = Some(Instant::now());
        let snapshot = Snapshot { free_bytes: free_bytes(&self.root), ..snapshot.clone() };
        match &self.bar {
            Some(bar) => bar.set_message(report::status_text(&snapshot)),
            None if self.console.json => {
                // Whoever reads the pipe may have read enough; the night goes on.
                let _ = self.console.print(&report::status_json(&snapshot).to_string());
            }
            None => self.console.say(&report::status_text(&snapshot)),
        }
    }

    fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Says how it went, and fails where something is missing.
fn finish(summary: &Summary, console: Console) -> anyhow::Result<()> {
    // The night is on the disk, whether or not somebody still reads this.
    let _ = if console.json {
        console.print(&report::summary_json(summary).to_string())
    } else if console.quiet {
        Ok(())
    } else {
        console.print(&printable(&report::summary_text(summary)))
    };
    Ok(summary.check()?)
}
