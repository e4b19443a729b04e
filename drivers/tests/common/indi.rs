//! The real INDI server, in a network of its own.
//!
//! `indiserver` listens on every interface and cannot be told otherwise. A live test therefore runs itself once more in
//! namespaces of its own (`unshare`): users, so that anybody may; network, so that nobody else can connect; processes, so that
//! nothing outlives it. Where that is not possible the test is recorded as skipped.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses its part")]

use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::transport::tcp::Tcp;

pub const CAMERA: &str = "CCD Simulator";
pub const ROTATOR: &str = "Rotator Simulator";
pub const WHEEL: &str = "Filter Simulator";

/// Runs `body` in namespaces of its own, or records the skip of the test, which has that name.
pub fn live(test: &str, body: impl FnOnce()) {
    let programs = [
        "indiserver",
        "indi_simulator_ccd",
        "indi_simulator_rotator",
        "indi_simulator_wheel",
        "indi_simulator_telescope",
    ];
    sunglint_testkit::live(test, &programs, body);
}

pub fn within(seconds: f64) -> Deadline {
    Deadline::within(Duration::from_secs_f64(seconds))
}

/// An `indiserver` with its simulators; ends with this.
pub struct Server {
    child: Option<Child>,
    pub port: u16,
    drivers: Vec<String>,
    /// The drivers keep their settings in the user's home: here it is nobody's.
    home: tempfile::TempDir,
}

impl Server {
    pub fn start(drivers: &[&str]) -> Self {
        let names: Vec<String> =
            drivers.iter().map(|name| format!("indi_simulator_{name}")).collect();
        Self::start_of(&names.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// The same, with drivers by the names of their programs.
    pub fn start_of(drivers: &[&str]) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let drivers = drivers.iter().map(|name| (*name).to_owned()).collect();
        let home = tempfile::tempdir().unwrap();
        let mut server = Self { child: None, port, drivers, home };
        server.restart();
        server
    }

    /// Starts it on the same port.
    pub fn restart(&mut self) {
        self.kill();
        let child = Command::new("indiserver")
            .args(["-p", &self.port.to_string()])
            .args(&self.drivers)
            .env("HOME", self.home.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        self.child = Some(child);
    }

    /// Kills it at once, as a power cut would.
    pub fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            child.kill().unwrap();
            child.wait().unwrap();
        }
    }

    /// A connection, as soon as it listens.
    pub fn connect(&self) -> Tcp {
        let deadline = within(10.0);
        loop {
            match Tcp::connect(&format!("127.0.0.1:{}", self.port), &deadline) {
                Ok(line) => return line,
                Err(_) => deadline.sleep(Duration::from_millis(50)).unwrap(),
            }
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}
