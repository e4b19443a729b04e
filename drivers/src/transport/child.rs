//! A child process whose standard input and output are the stream; its error output is kept for the error message.

use super::stream::{self, Blocking};
use super::{Bytes, TransportError};
use crate::clock::Deadline;
use std::io::{self, Read, Write as _};
use std::process::{Child as Process, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// Pieces that wait between the pipe and the reader: 64 of 16 KiB, after which the child has to wait.
const PIECES: usize = 64;
/// How much of the error output is kept, bytes: its end.
const LOG: usize = 8 << 10;

/// A running child process. Dropping it kills it.
#[derive(Debug)]
pub struct Child {
    name: String,
    process: Process,
    to_child: SyncSender<Vec<u8>>,
    from_child: Receiver<Vec<u8>>,
    /// Bytes that came and were not asked for yet.
    left_over: Vec<u8>,
    log: Arc<Mutex<Vec<u8>>>,
    /// Reads the error output until it is closed.
    listener: thread::JoinHandle<()>,
}

impl Child {
    /// Starts the program.
    ///
    /// # Errors
    /// [`TransportError::NotFound`] or [`TransportError::Io`].
    pub fn spawn(command: &mut Command) -> Result<Self, TransportError> {
        let name = command.get_program().to_string_lossy().into_owned();
        let fail = |source: io::Error| match source.kind() {
            io::ErrorKind::NotFound => TransportError::NotFound {
                what: name.clone(),
                hint: "install it, or give its path".to_owned(),
            },
            _ => TransportError::Io { action: "start", what: name.clone(), source },
        };
        let mut process = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(fail)?;
        let pipes = (process.stdin.take(), process.stdout.take(), process.stderr.take());
        let (Some(stdin), Some(stdout), Some(stderr)) = pipes else {
            let _ = process.kill();
            let _ = process.wait();
            return Err(fail(io::Error::other("no pipe to the process")));
        };
        let log = Arc::new(Mutex::new(Vec::new()));
        let (to_child, outgoing) = sync_channel(1);
        let (incoming, from_child) = sync_channel(PIECES);
        let kept = Arc::clone(&log);
        thread::spawn(move || pump_in(stdin, &outgoing));
        thread::spawn(move || {
            pump_out(stdout, |piece| incoming.send(piece.to_vec()).is_ok());
        });
        let listener = thread::spawn(move || pump_out(stderr, |piece| keep_end(&kept, piece)));
        Ok(Self { name, process, to_child, from_child, left_over: Vec::new(), log, listener })
    }

    /// The end of what the process wrote to its error output.
    pub fn log(&self) -> String {
        match self.log.lock() {
            Ok(log) => String::from_utf8_lossy(&log).into_owned(),
            // A panic in the thread that keeps it; what it kept is still there.
            Err(poisoned) => String::from_utf8_lossy(&poisoned.into_inner()).into_owned(),
        }
    }

    /// The process has ended: how, and its last words.
    fn ended(&mut self, error: TransportError) -> TransportError {
        let TransportError::Disconnected { got_so_far, .. } = error else { return error };
        // Its pipes close a moment before it can be waited for.
        let patience = Instant::now() + Duration::from_millis(200);
        let mut status = "ended".to_owned();
        while Instant::now() < patience {
            if let Ok(Some(code)) = self.process.try_wait() {
                status = code.to_string();
                break;
            }
            thread::sleep(Duration::from_millis(5));
        }
        // Its last words may still be on their way; a child of its own may hold the pipe for good.
        while !self.listener.is_finished() && Instant::now() < patience {
            thread::sleep(Duration::from_millis(1));
        }
        let log = self.log();
        let last = log.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("");
        let words = if last.is_empty() { String::new() } else { format!(": {}", last.trim()) };
        TransportError::Disconnected {
            what: format!("{} ({status}{words})", self.name),
            got_so_far,
        }
    }
}

/// Writes until the pipe or the transport is closed.
fn pump_in(mut stdin: ChildStdin, outgoing: &Receiver<Vec<u8>>) {
    while let Ok(bytes) = outgoing.recv() {
        if stdin.write_all(&bytes).and_then(|()| stdin.flush()).is_err() {
            return;
        }
    }
}

/// Hands on what the pipe gives until it is closed or nobody wants more.
fn pump_out(mut pipe: impl Read, mut take: impl FnMut(&[u8]) -> bool) {
    let mut buffer = vec![0; 16 << 10];
    loop {
        match pipe.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) if !take(&buffer[..count]) => return,
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(_) => return,
        }
    }
}

fn keep_end(log: &Mutex<Vec<u8>>, piece: &[u8]) -> bool {
    let Ok(mut log) = log.lock() else { return false };
    log.extend_from_slice(piece);
    let surplus = log.len().saturating_sub(LOG);
    log.drain(..surplus);
    true
}

impl Blocking for Child {
    fn name(&self) -> &str {
        &self.name
    }

    fn read_within(&mut self, buffer: &mut [u8], time: Duration) -> io::Result<usize> {
        if self.left_over.is_empty() {
            match self.from_child.recv_timeout(time) {
                Ok(piece) => self.left_over = piece,
                Err(RecvTimeoutError::Timeout) => return Err(io::ErrorKind::TimedOut.into()),
                Err(RecvTimeoutError::Disconnected) => return Ok(0),
            }
        }
        let count = buffer.len().min(self.left_over.len());
        buffer[..count].copy_from_slice(&self.left_over[..count]);
        self.left_over.drain(..count);
        Ok(count)
    }

    fn write_within(&mut self, bytes: &[u8], time: Duration) -> io::Result<usize> {
        match self.to_child.try_send(bytes.to_vec()) {
            Ok(()) => Ok(bytes.len()),
            // The child does not read what it was sent before.
            Err(TrySendError::Full(_)) => {
                thread::sleep(time.min(Duration::from_millis(2)));
                Err(io::ErrorKind::TimedOut.into())
            }
            Err(TrySendError::Disconnected(_)) => Ok(0),
        }
    }
}

impl Bytes for Child {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        stream::send(self, bytes, deadline).map_err(|error| self.ended(error))
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        stream::receive(self, buffer, deadline).map_err(|error| self.ended(error))
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        stream::discard(self, deadline).map_err(|error| self.ended(error))
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
