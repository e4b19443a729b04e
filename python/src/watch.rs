//! Long work beside a listening interpreter, and errors as exceptions.

use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use sunglint_drivers::clock::Cancel;
use sunglint_formats::ParseError;
use sunglint_formats::error::FileError;
use sunglint_numerics::progress::Progress;

pyo3::create_exception!(
    sunglint,
    Error,
    PyException,
    "What went wrong: in which file, at which line and field where that is known (attributes `file`, `line`, `field`, `hint`; else None)."
);

/// Time between two looks for signals.
const LISTEN: Duration = Duration::from_millis(25);

/// The end of work that has no other way out of its loops.
struct Stopped;

/// Watches work on behalf of Python.
#[derive(Clone)]
pub struct Watch {
    cancel: Cancel,
    steps: Arc<Mutex<Steps>>,
}

/// Steps that a callback has not yet been told.
#[derive(Default)]
struct Steps {
    stage: String,
    done: u64,
    of: Option<u64>,
    warnings: Vec<String>,
    is_new: bool,
}

impl Watch {
    fn steps(&self) -> std::sync::MutexGuard<'_, Steps> {
        self.steps.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// Says where work stands that counts by itself; ends its thread where the caller wants it to end.
    pub fn at(&self, stage: &str, done: usize, of: usize) {
        if self.cancel.is_cancelled() {
            // Quietly: no message of a panic.
            std::panic::resume_unwind(Box::new(Stopped));
        }
        let mut steps = self.steps();
        stage.clone_into(&mut steps.stage);
        (steps.done, steps.of, steps.is_new) = (done as u64, Some(of as u64), true);
    }

    /// Token that is set where the caller wants the work to end: for waits of devices and rehearsals.
    pub fn cancel(&self) -> &Cancel {
        &self.cancel
    }

    /// Warnings so far.
    pub fn warnings(&self) -> Vec<String> {
        self.steps().warnings.clone()
    }
}

impl Progress for Watch {
    fn begin(&self, stage: &str, steps: Option<u64>) {
        let mut now = self.steps();
        stage.clone_into(&mut now.stage);
        (now.done, now.of, now.is_new) = (0, steps, true);
    }

    fn advance(&self, steps: u64) {
        let mut now = self.steps();
        now.done += steps;
        now.is_new = true;
    }

    fn warn(&self, warning: &str) {
        self.steps().warnings.push(warning.to_owned());
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.is_cancelled()
    }
}

/// Process that used threads first; 0 before.
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Refuses a process that was forked after threads had been used: they stay behind in its parent, and work that is given to them is never done.
///
/// # Errors
/// An exception that says what to do.
pub fn refuse_fork() -> PyResult<()> {
    let own = std::process::id();
    match OWNER.compare_exchange(0, own, Ordering::Relaxed, Ordering::Relaxed) {
        Err(first) if first != own => Err(Error::new_err(
            "this process was forked after sunglint had used its threads: use the start method spawn or forkserver (multiprocessing.set_start_method)",
        )),
        _ => Ok(()),
    }
}

/// An error of the libraries that is not yet an exception.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Does work in a thread of its own, without the interpreter's lock, and waits for its end. `callback(stage, done, of)` hears where it stands, some forty times a
/// second at most.
pub fn run<T: Send>(
    py: Python<'_>,
    callback: Option<Py<PyAny>>,
    work: impl FnOnce(&Watch) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    refuse_fork()?;
    let watch = Watch { cancel: Cancel::new(), steps: Arc::default() };
    std::thread::scope(|scope| {
        let (send, receive) = channel();
        let own = watch.clone();
        let builder = std::thread::Builder::new().name("sunglint".into()).stack_size(64 << 20);
        let thread = builder.spawn_scoped(scope, move || {
            // The receiver is gone where the caller did not wait: nothing is left to tell.
            let _ = send.send(work(&own));
        })?;
        let receive = Mutex::new(receive);
        let mut interrupted = None;
        let outcome = loop {
            let waited = py
                .detach(|| receive.lock().unwrap_or_else(|e| e.into_inner()).recv_timeout(LISTEN));
            match waited {
                Ok(outcome) => break Some(outcome),
                Err(RecvTimeoutError::Disconnected) => break None,
                Err(RecvTimeoutError::Timeout) => {}
            }
            if interrupted.is_none() {
                let told = tell(py, &watch, callback.as_ref()).and_then(|()| py.check_signals());
                if let Err(error) = told {
                    watch.cancel.cancel();
                    interrupted = Some(error);
                }
            }
        };
        // Joined in every case: a thread that ended by a panic would end the scope by one.
        let ended = py.detach(|| thread.join());
        if let Some(error) = interrupted {
            return Err(error);
        }
        match (outcome, ended) {
            (Some(Ok(value)), _) => {
                tell(py, &watch, callback.as_ref())?;
                py.check_signals()?;
                Ok(value)
            }
            (Some(Err(error)), _) => Err(exception(py, error.as_ref())),
            (None, Err(reason)) if reason.is::<Stopped>() => Err(PyKeyboardInterrupt::new_err(())),
            (None, _) => {
                Err(Error::new_err("the work ended without a result; this is a fault of sunglint"))
            }
        }
    })
}

fn tell(py: Python<'_>, watch: &Watch, callback: Option<&Py<PyAny>>) -> PyResult<()> {
    let Some(callback) = callback else { return Ok(()) };
    let (stage, done, of) = {
        let mut steps = watch.steps();
        if !std::mem::take(&mut steps.is_new) {
            return Ok(());
        }
        (steps.stage.clone(), steps.done, steps.of)
    };
    callback.call1(py, (stage, done, of)).map(drop)
}

/// A message without the folders in which the package keeps what is in memory: the names of their files say what is meant.
fn without_folders(text: &str) -> String {
    let own = std::env::temp_dir().join("sunglint-");
    let own = own.to_string_lossy();
    let mut parts = text.split(own.as_ref());
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        // The folders of Python's `tempfile` end in eight random characters.
        let is_random = |name: &str| {
            name.len() == 8
                && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
        };
        match part.split_once('/').filter(|(name, _)| is_random(name)) {
            Some((_, file)) => out += file,
            None => out = out + &own + part,
        }
    }
    out
}

/// The exception of an error, with what is known of its place.
pub fn exception(py: Python<'_>, error: &(dyn std::error::Error + 'static)) -> PyErr {
    let mut text = error.to_string();
    let (mut file, mut line, mut field, mut hint) = (None, None, None, None);
    let mut next = Some(error);
    while let Some(at) = next {
        let parse = at.downcast_ref::<ParseError>().or(match at.downcast_ref::<FileError>() {
            Some(FileError::Parse(parse)) => Some(parse),
            _ => None,
        });
        if let Some(parse) = parse {
            file = Some(parse.path.display().to_string());
            (line, field, hint) = (parse.line, parse.field.clone(), parse.hint.clone());
        } else if let Some(FileError::Io { path, .. }) = at.downcast_ref::<FileError>() {
            file = Some(path.display().to_string());
        }
        next = at.source();
        // Messages of sources that the error itself does not repeat.
        if let Some(source) = next {
            let said = source.to_string();
            if !text.contains(&said) {
                text = format!("{text}: {said}");
            }
        }
    }
    let error = Error::new_err(without_folders(&text));
    let value = error.value(py);
    // Attributes of an instance of a Python class can be set.
    let _ = value.setattr("file", file);
    let _ = value.setattr("line", line);
    let _ = value.setattr("field", field);
    let _ = value.setattr("hint", hint);
    error
}
