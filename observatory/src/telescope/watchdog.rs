//! Watchdog: stops a mount over a connection of its own when the tracker's heartbeat is missing.
//!
//! It is meant to run in a process of its own, so that it outlives the tracker. What it cannot do: reach a mount whose cable is cut. Then the last rates go on.

use super::tracker::{STOPPED, TrackError};
use std::io::{BufRead as _, BufReader, Write as _};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{DeviceError, Mount};
use sunglint_drivers::transport::TransportError;

/// Age of a heartbeat at which the mount is stopped.
pub const HEARTBEAT_WITHIN: Duration = Duration::from_millis(500);

/// Time between two readings of the mount: a server lets go of a client that does not take in what it is sent.
const READ_EVERY: Duration = Duration::from_secs(1);
/// Time for a reading: it delays the answer to a heartbeat that is missing.
const READ_WITHIN: Duration = Duration::from_millis(300);
/// So many readings in a row may come too late.
const LATE_READINGS: u32 = 5;

/// Message of a tracker to its watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beat {
    /// It lives, and follows.
    Alive,
    /// It has stopped the mount: nothing is to be watched any more.
    Done,
    /// A person says stop: the mount is stopped, whatever the tracker does.
    Stop,
}

/// Exit status of a watchdog's process that stopped the mount because it heard nothing of its tracker.
const SILENT: u8 = 73;

/// How a watch ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watched {
    /// The tracker said that it is done.
    Done,
    /// The heartbeat was missing; the mount was told to stop.
    Silent,
    /// A person said stop; the mount was told to stop, and again until the tracker had ended.
    Stopped,
}

impl Watched {
    /// Exit status of the watchdog's process, by which its tracker knows how it ended.
    pub fn status(self) -> u8 {
        match self {
            Self::Silent => SILENT,
            Self::Done | Self::Stopped => 0,
        }
    }
}

/// Watches until the tracker is done, or stops the mount. The mount is read about once a second, so that a lost connection is noticed while it is not needed.
///
/// # Errors
/// The mount could not be told to stop, three times; or its connection was lost, and it was told to stop as far as that went.
pub fn watch(mount: &mut dyn Mount, beats: &Receiver<Beat>) -> Result<Watched, DeviceError> {
    let mut stopped_by_person = false;
    let (mut read, mut late) = (Instant::now(), 0);
    loop {
        if read.elapsed() >= READ_EVERY {
            let reading = mount.reading(&Deadline::within(READ_WITHIN));
            read = Instant::now();
            late = match &reading {
                Ok(_) => 0,
                Err(error) if is_late(error) && late < LATE_READINGS => late + 1,
                Err(_) => late,
            };
            if let Err(error) = reading
                && (late == LATE_READINGS || !is_late(&error))
            {
                // Nobody is watched over a connection that does not work: the tracker sees that its watchdog has gone.
                stop(mount)?;
                return Err(error);
            }
        }
        match beats.recv_timeout(HEARTBEAT_WITHIN) {
            Ok(Beat::Done) => {
                return Ok(if stopped_by_person { Watched::Stopped } else { Watched::Done });
            }
            Ok(Beat::Alive) if stopped_by_person => stop(mount)?,
            Ok(Beat::Alive) => {}
            Ok(Beat::Stop) => {
                // A latch: what the tracker commands afterwards is stopped again.
                stopped_by_person = true;
                stop(mount)?;
            }
            Err(RecvTimeoutError::Timeout) | Err(RecvTimeoutError::Disconnected) => {
                stop(mount)?;
                return Ok(if stopped_by_person { Watched::Stopped } else { Watched::Silent });
            }
        }
    }
}

/// Whether an answer was late, and nothing else is wrong.
fn is_late(error: &DeviceError) -> bool {
    matches!(
        error,
        DeviceError::Transport { source: TransportError::Timeout { .. }, .. }
            | DeviceError::Awaited { .. }
            | DeviceError::TooSlow { .. }
    )
}

/// Stops it; a call that fails is tried again at once.
fn stop(mount: &mut dyn Mount) -> Result<(), DeviceError> {
    let begun = Instant::now();
    let mut tries = 0;
    loop {
        match mount.stop(&Deadline::within(Duration::from_millis(800))) {
            Ok(()) => return Ok(()),
            Err(error) if tries == 2 || begun.elapsed() > Duration::from_secs(3) => {
                return Err(error);
            }
            Err(_) => tries += 1,
        }
    }
}

/// A tracker that has said nothing for so long hangs.
pub const HANGS: Duration = Duration::from_secs(4);
/// Time between two beats.
const BEAT: Duration = Duration::from_millis(100);
/// Time after a mount was seen standing within which the watchdog has ended, if it stopped the mount: two calls to stop it. One that lives on did not.
const OWNS_UP: Duration = Duration::from_secs(2);
/// Longest time in which a watchdog that was let go ends: three calls of its last stop, and a reading.
const ENDS: Duration = Duration::from_secs(5);

/// The watchdog as a process of its own, and the thread that tells it that the tracker lives. Dropped without [`done`](Self::done), it stops the mount: so it does after an error or a panic.
#[derive(Debug)]
pub struct Process {
    child: Child,
    pulse: Pulse,
    ends: Arc<AtomicBool>,
    stands: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Signs of life of a tracker. Clones are the same one.
#[derive(Debug, Clone)]
pub struct Pulse {
    begun: Instant,
    /// Time up to which it is known to live, ms from the begin on.
    until_ms: Arc<AtomicU64>,
}

impl Pulse {
    fn new() -> Self {
        Self { begun: Instant::now(), until_ms: Arc::default() }
    }

    /// The tracker lives.
    pub fn tick(&self) {
        self.busy(Duration::ZERO);
    }

    /// The tracker is in a call that may take this long: it says nothing meanwhile.
    pub fn busy(&self, time: Duration) {
        let until = u64::try_from((self.begun.elapsed() + time).as_millis()).unwrap_or(u64::MAX);
        self.until_ms.store(until, Ordering::SeqCst);
    }

    /// Time since the last sign of life.
    pub fn age(&self) -> Duration {
        let until = Duration::from_millis(self.until_ms.load(Ordering::SeqCst));
        self.begun.elapsed().saturating_sub(until)
    }
}

/// Why there is no watchdog.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessError {
    /// The system starts no process.
    #[error("cannot start the watchdog")]
    Start(#[from] std::io::Error),
    /// It does not reach the mount.
    #[error("the watchdog cannot reach the mount over a connection of its own: nothing is moved")]
    Unreached,
}

impl Process {
    /// Starts `PROGRAM mount-watchdog MOUNT` and waits until it holds its own connection.
    ///
    /// # Errors
    /// It cannot be started, or cannot reach the mount.
    pub fn start(program: &Path, mount: &str) -> Result<Self, ProcessError> {
        let mut command = Command::new(program);
        command.args(["mount-watchdog", mount]).stdin(Stdio::piped()).stdout(Stdio::piped());
        // The terminal's signals would reach it with the tracker, and nobody would watch a tracker that is stopped by one.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let (Some(stdout), Some(mut stdin)) = (child.stdout.take(), child.stdin.take()) else {
            return Err(ProcessError::Unreached);
        };
        let mut line = String::new();
        let read = BufReader::new(stdout).read_line(&mut line);
        if read.is_err() || line.trim() != "ready" {
            let _ = child.wait();
            return Err(ProcessError::Unreached);
        }
        let pulse = Pulse::new();
        let [ends, stands] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let (life, end, still) = (pulse.clone(), ends.clone(), stands.clone());
        let thread = std::thread::spawn(move || {
            while !end.load(Ordering::SeqCst) {
                // A tracker that hangs is as good as dead.
                if life.age() < HANGS
                    && stdin.write_all(b"a\n").and_then(|()| stdin.flush()).is_err()
                {
                    return;
                }
                std::thread::sleep(BEAT);
            }
            // Otherwise the pipe is closed, which is silence.
            if still.load(Ordering::SeqCst) {
                let _ = stdin.write_all(b"d\n").and_then(|()| stdin.flush());
            }
        });
        Ok(Self { child, pulse, ends, stands, thread: Some(thread) })
    }

    /// The signs of life that it waits for.
    pub fn pulse(&self) -> Pulse {
        self.pulse.clone()
    }

    /// The tracker lives; breaks where nobody watches it any more. Who moves a mount has to stop then.
    pub fn beat(&mut self) -> ControlFlow<()> {
        self.pulse.tick();
        match self.watches() {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        }
    }

    /// Whether it still watches; false once it has ended, because it stopped the mount or was killed.
    pub fn watches(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Whether it has ended because it heard nothing of the tracker, and stopped the mount: the program stood still for a moment.
    pub fn was_silent(&mut self) -> bool {
        let ended = self.child.try_wait().ok().flatten();
        ended.is_some_and(|status| status.code() == Some(i32::from(SILENT)))
    }

    /// The error of a tracking, with the one who stopped the mount: where that was this watchdog, it was nobody else.
    pub fn explain(&mut self, error: TrackError) -> TrackError {
        let stands = matches!(
            error,
            TrackError::ByHand { what: STOPPED }
                | TrackError::MeridianLimit { .. }
                | TrackError::DoesNotFollow { .. }
        );
        if !stands {
            return error;
        }
        // The mount may say that it stands before the watchdog has its answer.
        let seen = Instant::now();
        while self.watches() && seen.elapsed() < OWNS_UP {
            self.pulse.tick();
            std::thread::sleep(Duration::from_millis(10));
        }
        match self.was_silent() {
            true => TrackError::Silent,
            false => error,
        }
    }

    /// The mount was told to stop and said yes: nothing is to be watched any more.
    pub fn done(self) {
        self.stands.store(true, Ordering::SeqCst);
    }
}

impl Drop for Process {
    /// Lets go of the watchdog, which stops the mount unless it was told that all is done.
    fn drop(&mut self) {
        self.ends.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let dropped = Instant::now();
        while matches!(self.child.try_wait(), Ok(None)) && dropped.elapsed() < ENDS {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
