//! A conversation with one device: opened, recorded or replayed, with deadlines that Ctrl-C ends.

use crate::output::Console;
use anyhow::Context as _;
use clap::Args;
use hifitime::Epoch;
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::cell::{Cell, RefCell};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice, Line, Rest};
use sunglint_drivers::clock::{Cancel, Clock, Deadline, SystemClock, VirtualClock};
use sunglint_drivers::device::{DeviceError, Identity};
use sunglint_drivers::recording::{Header, Recording};
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::time::format_utc;

/// How long a line may take to open, an answer to come, and a device to be ready.
const CONNECT: Duration = Duration::from_secs(10);
const READY: Duration = Duration::from_secs(60);

/// Which device, and how to speak to it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "The device")]
pub struct TalkArgs {
    /// The device: `DRIVER[:WHERE]`, such as tmcl:/dev/ttyACM0 or sim-tmcl; `devices list` and `devices list --drivers` name them
    pub address: String,
    /// What the driver has to be told, such as gear=10; `devices list --drivers` names all
    #[arg(long = "with", value_name = "NAME=VALUE")]
    pub options: Vec<String>,
    /// Write down every byte that is said, for `devices replay`
    #[arg(long, value_name = "FILE.rec")]
    pub record: Option<PathBuf>,
    /// How long one step may take, s [default: 10; moves 300; frames 30 more than their exposure]
    #[arg(long, value_name = "S")]
    pub timeout_s: Option<f64>,
}

impl TalkArgs {
    /// The words that say the same again, but for where things are written.
    pub fn words(&self, command: &str) -> Vec<String> {
        let mut words = vec![command.to_owned(), self.address.clone()];
        let options = self.options.iter().flat_map(|option| ["--with".to_owned(), option.clone()]);
        words.extend(options);
        let timeout = self.timeout_s.map(|s| ["--timeout-s".to_owned(), s.to_string()]);
        words.extend(timeout.into_iter().flatten());
        words
    }
}

/// Who is at the other end.
pub enum Desk {
    /// Devices.
    Live {
        /// Set by Ctrl-C.
        cancel: Cancel,
    },
    /// A recording.
    Replay {
        /// Taken by the first conversation.
        recording: Box<Cell<Option<Recording>>>,
        /// What is left of it.
        rest: RefCell<Option<Rest>>,
    },
}

impl Desk {
    /// Devices; Ctrl-C ends what is under way in good order (a motor is stopped), a second one ends the program.
    pub fn live(console: Console) -> anyhow::Result<Self> {
        let cancel = Cancel::new();
        let token = cancel.clone();
        ctrlc::set_handler(move || {
            if token.is_cancelled() {
                std::process::exit(1);
            }
            console.say("stopping (Ctrl-C again ends the program at once)");
            token.cancel();
        })
        .context("cannot listen for Ctrl-C")?;
        Ok(Self::Live { cancel })
    }

    /// A recording.
    pub fn replay(recording: Recording) -> Self {
        let recording = Box::new(Cell::new(Some(recording)));
        Self::Replay { recording, rest: RefCell::new(None) }
    }

    /// What is left of the recording.
    pub fn rest(&self) -> Option<Rest> {
        match self {
            Self::Live { .. } => None,
            Self::Replay { rest, .. } => rest.borrow_mut().take(),
        }
    }
}

/// A line to a device.
pub struct Session {
    /// Where it is.
    pub address: Address,
    line: Option<Line>,
    clock: Arc<dyn Clock>,
    cancel: Cancel,
    timeout: Option<Duration>,
}

impl Session {
    /// Opens the line. `words` are what was asked, for the recording.
    pub fn connect(
        desk: &Desk,
        talk: &TalkArgs,
        words: &[String],
        force: bool,
    ) -> anyhow::Result<Self> {
        let mut address = Address::parse(&talk.address, &talk.options)?;
        let timeout = talk.timeout_s.map(|s| seconds("--timeout-s", s)).transpose()?;
        let (clock, cancel): (Arc<dyn Clock>, Cancel) = match desk {
            Desk::Live { cancel } => (Arc::new(SystemClock), cancel.clone()),
            Desk::Replay { .. } => (Arc::new(VirtualClock::new()), Cancel::new()),
        };
        let deadline = Deadline::after(clock.clone(), timeout.unwrap_or(CONNECT));
        let line = match desk {
            Desk::Live { cancel } => {
                let line = address.connect(&deadline.with_cancel(cancel)).map_err(advised)?;
                match &talk.record {
                    None => line,
                    Some(file) => {
                        let overwrite = if force { Overwrite::Allow } else { Overwrite::Refuse };
                        line.recorded(file, &header(&address, words)?, overwrite)?
                    }
                }
            }
            Desk::Replay { recording, rest } => {
                let recording = recording.take().context("a recording holds one conversation")?;
                let (line, left) = Line::replay(recording, address.driver.wire);
                *rest.borrow_mut() = Some(left);
                line
            }
        };
        Ok(Self { address, line: Some(line), clock, cancel, timeout })
    }

    /// Makes the device on the line: once.
    pub fn open(&mut self) -> anyhow::Result<AnyDevice> {
        let line = self.line.take().context("the line is in use")?;
        self.address.open(line, &self.within(READY)).map_err(advised)
    }

    /// Opens the line and the device, and asks who it is.
    pub fn start(
        desk: &Desk,
        talk: &TalkArgs,
        words: &[String],
        force: bool,
    ) -> anyhow::Result<(Self, AnyDevice, Identity)> {
        let mut session = Self::connect(desk, talk, words, force)?;
        let mut device = session.open()?;
        let identity = device.device().identity(&session.soon()).map_err(advised)?;
        Ok((session, device, identity))
    }

    /// The deadline of a step that usually takes less than `usual`: what the user said, or that.
    pub fn within(&self, usual: Duration) -> Deadline {
        let time = self.timeout.unwrap_or(usual);
        Deadline::after(self.clock.clone(), time).with_cancel(&self.cancel)
    }

    /// The deadline of an answer.
    pub fn soon(&self) -> Deadline {
        self.within(CONNECT)
    }

    /// A few seconds, whatever was cancelled: for what a person has to know after it.
    pub fn grace(&self) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(3))
    }

    /// Waits until `time` after `start` on the clock.
    pub fn wait_until(&self, start: Duration, time: Duration) -> anyhow::Result<()> {
        let due = start.saturating_add(time).saturating_sub(self.clock.now());
        let whole = Deadline::after(self.clock.clone(), Duration::MAX).with_cancel(&self.cancel);
        Ok(whole.sleep(due)?)
    }

    /// The clock's time.
    pub fn now(&self) -> Duration {
        self.clock.now()
    }

    /// What every document says of the device.
    pub fn document(&self, device: Option<&Identity>) -> serde_json::Map<String, Value> {
        let driver = self.address.driver;
        let device = device.map(|about| {
            json!({
                "vendor": about.vendor,
                "model": about.model,
                "serial": about.serial,
                "firmware": about.firmware,
            })
        });
        [
            ("address", json!(self.address.to_string())),
            ("driver", json!(driver.name)),
            ("kind", json!(driver.kind.to_string())),
            ("simulated", json!(driver.simulated)),
            ("device", json!(device)),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into_iter()
        .collect()
    }

    /// The device in a line.
    pub fn title(&self, about: &Identity) -> String {
        let serial = about.serial.as_ref().map(|serial| format!(", serial number {serial}"));
        let firmware = about.firmware.as_ref().map(|version| format!(", firmware {version}"));
        let simulated = if self.address.driver.simulated { " (simulated)" } else { "" };
        format!(
            "{} {}{}{} at {}{simulated}",
            about.vendor,
            about.model,
            serial.unwrap_or_default(),
            firmware.unwrap_or_default(),
            self.address,
        )
    }
}

/// The device's error, with what to do where that is not said yet.
pub fn advised(error: DeviceError) -> anyhow::Error {
    let text = error.to_string();
    let advice = if text.contains("70-sunglint.rules") {
        "`sunglint devices udev` prints these rules and says how to install them"
    } else if text.contains("no answer within") {
        "check its power, the cable, the port, and the speed or address that the driver was told (--with)"
    } else if matches!(error, DeviceError::Protocol { .. }) {
        "is it another device, or another speed? `--record FILE` writes down what is said"
    } else {
        return error.into();
    };
    anyhow::Error::new(error).context(format!("{text}; {advice}"))
}

/// A time that a person gave.
pub fn seconds(name: &str, s: f64) -> anyhow::Result<Duration> {
    const DAY: f64 = 86_400.0;
    let good = s.is_finite() && s > 0.0 && s <= DAY;
    anyhow::ensure!(good, "{name}: found {s}, expected seconds, more than 0, at most {DAY}");
    Ok(Duration::from_secs_f64(s))
}

/// UTC now, to the millisecond.
pub fn utc_now() -> anyhow::Result<String> {
    Ok(format_utc(Epoch::now().context("the system has no clock")?, 3))
}

/// What `host` begins with in recordings of this program; a list of words as JSON stands behind it.
pub const HOST: &str = concat!("sunglint ", env!("CARGO_PKG_VERSION"), " ");

fn header(address: &Address, words: &[String]) -> anyhow::Result<Header> {
    let driver = address.driver;
    let mut words = words.to_vec();
    // What the driver found by itself, a replay has to be told.
    for option in address.given_options() {
        if !words.contains(&option) {
            words.splice(2..2, ["--with".to_owned(), option]);
        }
    }
    if let Some(place) = words.get_mut(1) {
        *place = address.to_string();
    }
    Ok(Header {
        device: format!("{} ({})", driver.title, address),
        source: if driver.simulated { "sunglint's simulated device" } else { "hardware" }.into(),
        host: Some(format!("{HOST}{}", serde_json::to_string(&words)?)),
        recorded: Some(utc_now()?),
        synthetic: driver.simulated,
    })
}

/// A line on a terminal that says what is waited for, gone at its end.
pub struct Waiting(ProgressBar);

impl Waiting {
    /// Shown after a second, unless the person wants none.
    pub fn for_what(what: String, desk: &Desk, console: Console) -> Self {
        let shown = matches!(desk, Desk::Live { .. }) && !console.quiet;
        let bar = if shown { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        let style = indicatif::ProgressStyle::with_template("{spinner} {msg} ({elapsed})");
        let bar = if let Ok(style) = style { bar.with_style(style) } else { bar };
        if shown {
            bar.enable_steady_tick(Duration::from_secs(1));
        }
        Self(bar.with_message(what))
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
