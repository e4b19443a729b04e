//! A run in the lab on the page, beside what is shown on the terminal.

use crate::output::Console;
use std::net::SocketAddr;
use std::sync::Arc;
use sunglint_drivers::clock::Cancel;
use sunglint_materials::log::Watch;
use sunglint_materials::reading::State;
use sunglint_page::{LabReading, LabRun, LabState, Server};

/// The page of a run and its server, which ends with it.
#[derive(Debug)]
pub struct LabPage {
    run: Arc<LabRun>,
    _server: Server,
}

/// State of a line as the page has it.
pub fn state(state: State) -> LabState {
    match state {
        State::Read => LabState::Read,
        State::Over => LabState::Over,
        State::Kept => LabState::Kept,
        State::Again => LabState::Again,
    }
}

impl LabPage {
    /// Serves the page of a run, where one was asked for by `--page`: of so many places in all, some of them measured before; `angle` names the curve's axis.
    ///
    /// # Errors
    /// An address that is none, or cannot be listened at.
    pub fn start(
        address: Option<&str>,
        folder: &std::path::Path,
        angle: &str,
        [places, before]: [u64; 2],
        console: Console,
    ) -> anyhow::Result<Option<Self>> {
        let Some(address) = address else { return Ok(None) };
        let address: Option<SocketAddr> = crate::page::address_of(address)?;
        let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy();
        let program = concat!("sunglint ", env!("CARGO_PKG_VERSION"));
        let run = Arc::new(LabRun::new(&name, program, angle, places, before));
        let server = Server::start(address, run.clone())?;
        crate::page::announce(&server, "sees, pauses and stops the run", console);
        Ok(Some(Self { run, _server: server }))
    }

    /// Tells the page how the run ended.
    pub fn end(&self, how: &str) {
        self.run.end(how);
    }

    /// A watch of the run's lines that tells the page of each, too, and waits while the page has paused the run.
    pub fn watch<L: std::fmt::Debug + 'static>(
        page: Option<&Self>,
        own: Box<dyn Watch<L>>,
        of: fn(&L) -> LabReading,
        cancel: &Cancel,
    ) -> Box<dyn Watch<L>> {
        match page {
            None => own,
            Some(page) => {
                let token = cancel.clone();
                page.run.on_stop(move || token.cancel());
                Box::new(Both { own, run: page.run.clone(), of, cancel: cancel.clone() })
            }
        }
    }
}

#[derive(Debug)]
struct Both<L> {
    own: Box<dyn Watch<L>>,
    run: Arc<LabRun>,
    of: fn(&L) -> LabReading,
    cancel: Cancel,
}

impl<L: std::fmt::Debug> Watch<L> for Both<L> {
    fn line(&mut self, line: &L) {
        self.own.line(line);
        let reading = (self.of)(line);
        // A pause holds between places: the readings of one are averaged, and belong together.
        let is_end = matches!(reading.state, LabState::Kept | LabState::Again);
        self.run.line(reading);
        if is_end && self.run.wait(|| self.cancel.is_cancelled()) {
            self.cancel.cancel();
        }
    }

    fn say(&self, text: &str) {
        self.own.say(text);
        self.run.say(text);
    }
}
