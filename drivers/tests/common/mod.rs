//! Helpers that the tests of transports share: both ends of a real line.
#![allow(dead_code, reason = "each test uses its part")]

pub mod alpaca;
pub mod efw;
pub mod indi;
pub mod ophir;
pub mod pm100;
pub mod scpi;
pub mod swabian;
pub mod turning;
pub mod umockdev;
pub mod words;

use serialport::SerialPort as _;
use std::net::{TcpListener, TcpStream};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::transport::serial::Serial;
use sunglint_drivers::transport::tcp::Tcp;

/// A deadline on the computer's clock.
pub fn within(seconds: f64) -> Deadline {
    Deadline::within(Duration::from_secs_f64(seconds))
}

/// The two ends of a pty: the host's opened by its path, as a user's port is.
pub struct Pty {
    pub host: Serial,
    pub device: Serial,
    pub path: String,
}

pub fn pty() -> Pty {
    let (device, host) = serialport::TTYPort::pair().expect("a pty");
    let path = host.name().expect("a path");
    // It holds the lock on the path. The device's end sees a hang-up until the path is open again, so nobody may read there
    // in between.
    drop(host);
    let host = Serial::open(&path, 9600).expect("the host's end");
    Pty { host, device: Serial::from_port(Box::new(device)), path }
}

/// The host's and the device's end of a TCP connection.
pub fn tcp() -> (Tcp, Tcp) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let host = Tcp::connect(&address, &within(5.0)).expect("connected");
    let (stream, _): (TcpStream, _) = listener.accept().expect("accepted");
    (host, Tcp::from_stream(stream).expect("a stream"))
}
