//! TCP streams.

use super::stream::{self, Blocking};
use super::{Bytes, TransportError};
use crate::clock::Deadline;
use std::io::{self, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::Duration;

/// A TCP connection.
#[derive(Debug)]
pub struct Tcp {
    name: String,
    stream: TcpStream,
}

impl Tcp {
    /// Connects to `host:port`. The system looks the name up, which no deadline can shorten; an address in numbers needs
    /// no look-up.
    ///
    /// # Errors
    /// [`TransportError::NotFound`] if the name is unknown, [`TransportError::Refused`] if nobody listens there, the
    /// deadline, or [`TransportError::Io`].
    pub fn connect(address: &str, deadline: &Deadline) -> Result<Self, TransportError> {
        let candidates = address.to_socket_addrs().map_err(|error| TransportError::NotFound {
            what: address.to_owned(),
            hint: format!("{error}; give HOST:PORT"),
        })?;
        let mut last = None;
        for candidate in candidates {
            // One attempt takes what is left; a token is looked at between attempts.
            match TcpStream::connect_timeout(&candidate, deadline.remaining()?) {
                Ok(stream) => return Self::from_stream(stream),
                Err(error) => last = Some(error),
            }
        }
        deadline.remaining()?;
        Err(match last {
            Some(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                TransportError::Refused {
                    what: address.to_owned(),
                    reason: error.to_string(),
                    hint: "start the server, or check the port".to_owned(),
                }
            }
            Some(error) => TransportError::from_io("connect to", address, error),
            None => TransportError::NotFound {
                what: address.to_owned(),
                hint: "the name has no address".to_owned(),
            },
        })
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
        Ok(Self { name, stream })
    }

    /// The other end's address.
    pub fn name(&self) -> &str {
        &self.name
    }
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
        stream::discard(self, deadline)
    }
}
