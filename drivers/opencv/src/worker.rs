//! The thread on which OpenCV blocks.

use crate::capture::{About, Capture, Open};
use crate::error::{DEVICE, wrong};
use crate::picture::Picture;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::DeviceError;

type Job = Box<dyn FnOnce(&mut dyn Capture) + Send>;
type Next = Result<Option<Picture>, DeviceError>;

/// A source on a thread of its own. Dropping it lets the thread end as soon as OpenCV returns.
pub(crate) struct Worker {
    jobs: Sender<Job>,
    /// A picture that was waited for in vain, and that comes before all others.
    pending: Option<Receiver<Next>>,
}

impl Worker {
    /// Opens a source.
    pub fn start(open: Open, deadline: &Deadline) -> Result<(Self, About), DeviceError> {
        let (jobs, inbox) = mpsc::channel::<Job>();
        let (answer, opened) = mpsc::channel();
        std::thread::spawn(move || {
            let mut capture = match open() {
                Ok(capture) => capture,
                Err(error) => {
                    let _ = answer.send(Err(error));
                    return;
                }
            };
            let _ = answer.send(Ok(capture.about()));
            while let Ok(job) = inbox.recv() {
                job(capture.as_mut());
            }
        });
        let about = wait(&opened, "opening the source", deadline)??;
        Ok((Self { jobs, pending: None }, about))
    }

    /// The next picture. One that comes after the deadline is kept for the next call.
    pub fn next(&mut self, deadline: &Deadline) -> Next {
        let answer = match self.pending.take() {
            Some(pending) => pending,
            None => self.ask(|capture| capture.next())?,
        };
        match wait(&answer, "the next picture", deadline) {
            Ok(next) => next,
            Err(error) => {
                self.pending = Some(answer);
                Err(error)
            }
        }
    }

    /// Anything else.
    pub fn call<R: Send + 'static>(
        &mut self,
        action: &'static str,
        deadline: &Deadline,
        job: impl FnOnce(&mut dyn Capture) -> R + Send + 'static,
    ) -> Result<R, DeviceError> {
        wait(&self.ask(job)?, action, deadline)
    }

    fn ask<R: Send + 'static>(
        &self,
        job: impl FnOnce(&mut dyn Capture) -> R + Send + 'static,
    ) -> Result<Receiver<R>, DeviceError> {
        let (answer, wanted) = mpsc::channel();
        let job: Job = Box::new(move |capture| {
            let _ = answer.send(job(capture));
        });
        self.jobs.send(job).map_err(|_| gone())?;
        Ok(wanted)
    }
}

fn gone() -> DeviceError {
    wrong("the thread of its source has ended: open it again")
}

fn wait<R>(
    answer: &Receiver<R>,
    action: &'static str,
    deadline: &Deadline,
) -> Result<R, DeviceError> {
    loop {
        let slice =
            deadline.slice().map_err(|expired| DeviceError::expired(DEVICE, action, expired));
        // What has come already counts, however late it is asked for.
        let time = slice.as_ref().map_or(std::time::Duration::ZERO, |time| *time);
        match answer.recv_timeout(time) {
            Ok(answer) => return Ok(answer),
            Err(RecvTimeoutError::Disconnected) => return Err(gone()),
            Err(RecvTimeoutError::Timeout) => drop(slice?),
        }
    }
}
