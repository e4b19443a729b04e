//! One device at a time, by the same addresses as `sunglint devices`: read, move, set, record. And what there is.

use crate::product::Outcome;
use crate::watch::{Failure, Watch, run};
use numpy::{PyArray2, ToPyArray};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, Kind, inventory};
use sunglint_drivers::clock::{Cancel, utc_now};
use sunglint_drivers::session::{
    OpenDevice, Peer, ReadOptions, Reading, RecordTo, Session, SessionOptions, Target,
};
use sunglint_formats::Frame;
use sunglint_formats::atomic::Overwrite;
use sunglint_numerics::progress::{Progress as _, Silent};
use sunglint_report::devices as report;

/// Time between two looks for Ctrl-C.
const LISTEN: Duration = Duration::from_millis(20);

/// Work on the device, in its own thread: a device stays where it was opened.
type Job = Box<dyn FnOnce(&mut OpenDevice) + Send>;

/// An open device. Its line closes with it.
#[pyclass(frozen, module = "sunglint._core")]
pub struct Device {
    jobs: Mutex<Option<Sender<Job>>>,
    thread: Mutex<Option<std::thread::JoinHandle<()>>>,
    cancel: Cancel,
    kind: Kind,
    title: String,
}

/// A time that a person gave.
fn seconds(name: &str, s: f64) -> Result<Duration, Failure> {
    crate::sky::within(name, s, 1e-9, 86_400.0)?;
    Ok(Duration::from_secs_f64(s))
}

impl Device {
    /// Does something with the device; Ctrl-C ends it in good order (a motor is stopped).
    fn with<T: Send + 'static>(
        &self,
        watch: &Watch,
        work: impl FnOnce(&mut OpenDevice) -> Result<T, Failure> + Send + 'static,
    ) -> Result<T, Failure> {
        let (send, receive) = channel();
        let job: Job = Box::new(move |device| {
            // Nobody waits any more: nothing is left to tell.
            let _ = send.send(work(device));
        });
        {
            let jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
            let jobs = jobs.as_ref().ok_or("the device is closed")?;
            jobs.send(job).map_err(|_| "the device is closed: Ctrl-C ended it")?;
        }
        loop {
            match receive.recv_timeout(LISTEN) {
                Ok(done) => return done,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err("the device is closed: its driver ended".into());
                }
                Err(RecvTimeoutError::Timeout) if watch.is_cancelled() => self.cancel.cancel(),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }
}

#[pymethods]
impl Device {
    #[new]
    #[pyo3(signature = (address, options=Vec::new(), timeout_s=None, record=None))]
    fn new(
        py: Python<'_>,
        address: String,
        options: Vec<String>,
        timeout_s: Option<f64>,
        record: Option<PathBuf>,
    ) -> PyResult<Self> {
        run(py, None, move |watch| {
            let address = Address::parse(&address, &options)?;
            let kind = address.driver.kind;
            let timeout = timeout_s.map(|s| seconds("timeout_s", s)).transpose()?;
            let cancel = Cancel::new();
            let (jobs, received) = channel::<Job>();
            let (told, opened) = channel::<Result<String, Failure>>();
            let token = cancel.clone();
            let thread = std::thread::Builder::new().name("sunglint device".into());
            let thread = thread.spawn(move || {
                let peer = Peer::live(&token);
                let host = |address: &Address| {
                    format!("sunglint {} in Python, {address}", env!("CARGO_PKG_VERSION"))
                };
                let record = record.as_deref().map(|file| RecordTo {
                    file,
                    overwrite: Overwrite::Refuse,
                    host: &host,
                });
                let options = SessionOptions { timeout, record };
                match Session::start(&peer, address, &options) {
                    Ok(mut device) => {
                        let title = report::title(device.address(), device.identity());
                        let _ = told.send(Ok(title));
                        while let Ok(job) = received.recv() {
                            job(&mut device);
                            // A token that has ended one step ends all.
                            if token.is_cancelled() {
                                break;
                            }
                        }
                    }
                    Err(error) => {
                        let _ = told.send(Err(error.into()));
                    }
                }
            })?;
            let title = loop {
                match opened.recv_timeout(LISTEN) {
                    Ok(title) => break title?,
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err("the driver ended without an answer".into());
                    }
                    Err(RecvTimeoutError::Timeout) if watch.is_cancelled() => cancel.cancel(),
                    Err(RecvTimeoutError::Timeout) => {}
                }
            };
            let (jobs, thread) = (Mutex::new(Some(jobs)), Mutex::new(Some(thread)));
            Ok(Self { jobs, thread, cancel, kind, title })
        })
    }

    /// Who the device says it is, and where.
    #[getter]
    fn title(&self) -> &str {
        &self.title
    }

    /// Kind of the device.
    #[getter]
    fn kind(&self) -> String {
        self.kind.to_string()
    }

    /// Readings: the result, and the frames of a camera as arrays.
    #[pyo3(signature = (count=1, every_s=None, exposure_s=0.1))]
    fn read<'py>(
        &self,
        py: Python<'py>,
        count: u32,
        every_s: Option<f64>,
        exposure_s: f64,
    ) -> PyResult<(Outcome, Vec<Bound<'py, PyArray2<u16>>>)> {
        let (outcome, frames) = run(py, None, |watch| {
            if count == 0 {
                return Err("count is 0, expected 1 or more".into());
            }
            let every = every_s.map(|s| seconds("every_s", s)).transpose()?.unwrap_or_default();
            let exposure_s = seconds("exposure_s", exposure_s)?.as_secs_f64();
            let options = ReadOptions { count, every, exposure_s };
            self.with(watch, move |device| {
                let mut done = device.read(&options, &Silent)?;
                let text = report::readings_text(&done);
                let product = report::readings(&done, None)?;
                if let Some(error) = done.error.take() {
                    return Err(error.into());
                }
                let frames: Vec<Frame> = (done.readings.into_iter())
                    .filter_map(|reading| match reading {
                        Reading::Frame(frame) => Some(*frame),
                        _ => None,
                    })
                    .collect();
                Ok((Outcome::new(product, text, Vec::new()), frames))
            })
        })?;
        Ok((outcome, frames.iter().map(|frame| frame.pixels.to_pyarray(py)).collect()))
    }

    /// Goes to targets, one after the other; a failure or Ctrl-C stops the motor.
    #[pyo3(name = "move")]
    fn travel(&self, py: Python<'_>, targets: Vec<String>) -> PyResult<Outcome> {
        run(py, None, |watch| {
            let targets = targets.iter().map(|text| Target::parse(text, self.kind));
            let targets: Vec<Target> = targets.collect::<Result<_, _>>()?;
            self.with(watch, move |device| {
                let mut moves = device.travel(&targets, &Silent);
                let text = report::moves_text(&moves);
                let product = report::moves(&moves, None);
                match moves.failed.take() {
                    Some(failed) => {
                        Err(format!("{}; it stands at {}", failed.error, moves.at).into())
                    }
                    None => Ok(Outcome::new(product, text, Vec::new())),
                }
            })
        })
    }

    /// Makes settings, in this order, and reads them back; without any, what can be set.
    fn set(&self, py: Python<'_>, settings: Vec<(String, String)>) -> PyResult<Outcome> {
        run(py, None, |watch| {
            self.with(watch, move |device| {
                let pairs: Vec<(&str, &str)> =
                    settings.iter().map(|(name, value)| (&**name, &**value)).collect();
                let mut done = device.set(&pairs)?;
                let text = report::settings_text(&done, !pairs.is_empty());
                let product = report::settings(&done, None);
                match done.error.take() {
                    Some(error) => Err(error.into()),
                    None => Ok(Outcome::new(product, text, Vec::new())),
                }
            })
        })
    }

    /// Closes the line; a recording is whole then.
    fn close(&self, py: Python<'_>) {
        let jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner).take();
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        py.detach(|| {
            drop(jobs);
            // The line and the recording are closed when this returns. A thread that panicked has said so.
            if let Some(thread) = thread {
                let _ = thread.join();
            }
        });
    }
}

/// Instruments that are plugged in, and those of servers.
#[pyfunction]
#[pyo3(signature = (all=false, indi=Vec::new(), alpaca=Vec::new(), timeout_s=10.0))]
fn list_devices(
    py: Python<'_>,
    all: bool,
    indi: Vec<String>,
    alpaca: Vec<String>,
    timeout_s: f64,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let found = inventory(all, &indi, &alpaca, seconds("timeout_s", timeout_s)?);
        let product = report::inventory(&found, utc_now());
        Ok(Outcome::new(product, report::inventory_text(&found), found.faults.clone()))
    })
}

/// The drivers: their addresses and options.
#[pyfunction]
fn drivers() -> Outcome {
    Outcome::new(report::drivers(), report::drivers_text(), Vec::new())
}

/// Adds the class and the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Device>()?;
    module.add_function(wrap_pyfunction!(list_devices, module)?)?;
    module.add_function(wrap_pyfunction!(drivers, module)?)
}
