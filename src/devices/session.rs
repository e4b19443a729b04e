//! A session with one device as the command line asks for it: its address, its recording, and what its errors advise.

use crate::interrupt::{Hangup, listen};
use crate::output::Console;
use clap::Args;
use indicatif::ProgressBar;
use std::path::PathBuf;
use std::time::Duration;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::DeviceError;
use sunglint_drivers::session::{
    OpenDevice, Peer, RecordTo, Session, SessionError, SessionOptions,
};
use sunglint_formats::atomic::Overwrite;
use sunglint_numerics::progress::Progress;

/// Which device, and how to speak to it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "The device")]
pub struct TalkArgs {
    /// The device: `DRIVER[:WHERE]`, such as tmcl:/dev/ttyACM0 or sim-tmcl; `devices list` and `devices list --drivers` name them
    pub address: String,
    /// Options of the driver, such as gear=10; `devices list --drivers` names all
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

    /// The device's address.
    pub fn address(&self) -> anyhow::Result<Address> {
        Ok(Address::parse(&self.address, &self.options)?)
    }

    /// Opens the line. `words` are what was asked, for the recording.
    pub fn connect(&self, peer: &Peer, words: &[String], force: bool) -> anyhow::Result<Session> {
        self.session(words, force, |address, options| Session::connect(peer, address, options))
    }

    /// Opens the line and the device, and asks who it is.
    pub fn start(&self, peer: &Peer, words: &[String], force: bool) -> anyhow::Result<OpenDevice> {
        self.session(words, force, |address, options| Session::start(peer, address, options))
    }

    fn session<V>(
        &self,
        words: &[String],
        force: bool,
        open: impl FnOnce(Address, &SessionOptions<'_>) -> Result<V, SessionError>,
    ) -> anyhow::Result<V> {
        let address = self.address()?;
        let timeout = self.timeout_s.map(|s| seconds("--timeout-s", s)).transpose()?;
        let overwrite = if force { Overwrite::Allow } else { Overwrite::Refuse };
        let host = |address: &Address| host(address, words);
        let record = self.record.as_deref();
        let record = record.map(|file| RecordTo { file, overwrite, host: &host });
        open(address, &SessionOptions { timeout, record }).map_err(advised)
    }
}

/// Devices; Ctrl-C ends what is under way in good order (a motor is stopped), a second one ends the program.
pub fn live(console: Console) -> anyhow::Result<Peer> {
    let cancel = Cancel::new();
    let token = cancel.clone();
    listen(Hangup::Ends, move || {
        if token.is_cancelled() {
            std::process::exit(1);
        }
        console.say("stopping (Ctrl-C again ends the program at once)");
        token.cancel();
    })?;
    Ok(Peer::live(&cancel))
}

/// The session's error, with what to do where that is not said yet.
pub fn advised(error: SessionError) -> anyhow::Error {
    let error = match error {
        SessionError::Device(error) => error,
        SessionError::Address(error) => return error.into(),
        SessionError::Recording(error) => return error.into(),
        error => return error.into(),
    };
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

/// Beginning of `host` in recordings of this program; a list of words as JSON stands behind it.
pub const HOST: &str = concat!("sunglint ", env!("CARGO_PKG_VERSION"), " ");

/// The program and what it was asked, for a recording of this device.
fn host(address: &Address, words: &[String]) -> String {
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
    format!("{HOST}{}", serde_json::Value::from(words))
}

/// A line on a terminal that says what is waited for, gone at its end.
pub struct Waiting(ProgressBar);

impl Waiting {
    /// Shown after a second, unless the person wants none.
    pub fn new(peer: &Peer, console: Console) -> Self {
        let shown = peer.is_live() && !console.quiet;
        let bar = if shown { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        let style = indicatif::ProgressStyle::with_template("{spinner} {msg} ({elapsed})");
        let bar = if let Ok(style) = style { bar.with_style(style) } else { bar };
        if shown {
            bar.enable_steady_tick(Duration::from_secs(1));
        }
        Self(bar)
    }
}

impl Progress for Waiting {
    fn begin(&self, stage: &str, _: Option<u64>) {
        self.0.set_message(stage.to_owned());
        self.0.reset_elapsed();
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
