//! TCP streams.

use super::stream::{self, Blocking};
use super::{Bytes, TransportError};
use crate::clock::Deadline;
use std::io::{self, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// A TCP connection.
#[derive(Debug)]
pub struct Tcp {
    name: String,
    /// Address that it was connected to; `None` for a connection that came from elsewhere.
    address: Option<String>,
    stream: TcpStream,
}

impl Tcp {
    /// Connects to `host:port`. Neither a name that is looked up slowly nor a host that does not answer outlives the deadline or its token:
    /// the system is asked on a thread of its own, which is left to its end.
    ///
    /// # Errors
    /// [`TransportError::NotFound`] if the name is unknown, [`TransportError::Refused`] if nobody listens there, the
    /// deadline, or [`TransportError::Io`].
    pub fn connect(address: &str, deadline: &Deadline) -> Result<Self, TransportError> {
        let (sender, answer) = mpsc::sync_channel(1);
        let (asked, left) = (address.to_owned(), deadline.remaining()?);
        let thread = std::thread::Builder::new().name("connect".into());
        thread
            .spawn(move || {
                // Nobody waits for the answer any more where the deadline has passed.
                let _ = sender.send(connect_within(&asked, left));
            })
            .map_err(|error| TransportError::from_io("connect to", address, error))?;
        loop {
            match answer.recv_timeout(deadline.slice()?) {
                Ok(stream) => {
                    let tcp = Self::from_stream(stream?)?;
                    return Ok(Self { address: Some(address.to_owned()), ..tcp });
                }
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    return Err(TransportError::disconnected(address));
                }
            }
        }
    }

    /// A connection that is there already, such as one that a listener accepted.
    ///
    /// # Errors
    /// [`TransportError::Io`].
    pub fn from_stream(stream: TcpStream) -> Result<Self, TransportError> {
        let name = match stream.peer_addr() {
            Ok(peer) => peer.to_string(),
            Err(error) => return Err(TransportError::from_io("connect to", "TCP peer", error)),
        };
        // Requests are small and answered one by one: waiting to fill a packet only costs time.
        stream
            .set_nodelay(true)
            .map_err(|error| TransportError::from_io("set up", &name, error))?;
        Ok(Self { name, address: None, stream })
    }

    /// The other end's address.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Looks a name up and tries its addresses, each within what is left of `time`.
fn connect_within(address: &str, time: Duration) -> Result<TcpStream, TransportError> {
    let begun = Instant::now();
    let candidates = address.to_socket_addrs().map_err(|error| TransportError::NotFound {
        what: address.to_owned(),
        hint: format!("{error}; give HOST:PORT"),
    })?;
    let mut last = None;
    for candidate in candidates {
        // Not zero, which the system refuses.
        let left = time.saturating_sub(begun.elapsed()).max(Duration::from_millis(1));
        match TcpStream::connect_timeout(&candidate, left) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = Some(error),
        }
    }
    Err(match last {
        Some(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            TransportError::Refused {
                what: address.to_owned(),
                reason: error.to_string(),
                hint: "start the server, or check the port".to_owned(),
            }
        }
        Some(error) if error.kind() == io::ErrorKind::TimedOut => {
            TransportError::Timeout { after: begun.elapsed(), got_so_far: Vec::new() }
        }
        Some(error) => TransportError::from_io("connect to", address, error),
        None => TransportError::NotFound {
            what: address.to_owned(),
            hint: "the name has no address".to_owned(),
        },
    })
}

impl Blocking for Tcp {
    fn name(&self) -> &str {
        &self.name
    }

    fn read_within(&mut self, buffer: &mut [u8], time: Duration) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(time))?;
        self.stream.read(buffer)
    }

    fn write_within(&mut self, bytes: &[u8], time: Duration) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(time))?;
        self.stream.write(bytes)
    }
}

impl Bytes for Tcp {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        stream::send(self, bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        stream::receive(self, buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        // Without waiting: the system's shortest wait is some milliseconds, which requests that ask a mount where it stands would be late by.
        let switch = |tcp: &Self, on| {
            let done = tcp.stream.set_nonblocking(on);
            done.map_err(|error| TransportError::from_io("read from", &tcp.name, error))
        };
        switch(self, true)?;
        let dropped = stream::discard(self, deadline);
        switch(self, false)?;
        dropped
    }

    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let Some(address) = self.address.clone() else {
            return Err(TransportError::disconnected(&self.name));
        };
        // The old one is closed first: some servers hold one client only.
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
        *self = Self::connect(&address, deadline)?;
        Ok(())
    }
}
