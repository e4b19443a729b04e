//! INDI's own server and simulators (Debian package `indi-bin`), as gear that nobody here made.

use std::net::{TcpListener, TcpStream};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

pub const CCD: &str = "indi_simulator_ccd";
pub const TELESCOPE: &str = "indi_simulator_telescope";
pub const WHEEL: &str = "indi_simulator_wheel";

/// An `indiserver` with drivers; ends with this.
pub struct IndiServer {
    child: Child,
    pub port: u16,
    drivers: Vec<String>,
    /// The drivers keep their settings in the user's home: here it is nobody's.
    home: tempfile::TempDir,
    /// More variables of the server's environment.
    environment: Vec<(String, String)>,
}

impl IndiServer {
    pub fn start(drivers: &[&str]) -> Self {
        Self::start_in(drivers, &[])
    }

    /// With more variables of its environment.
    pub fn start_in(drivers: &[&str], environment: &[(&str, String)]) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let home = tempfile::tempdir().unwrap();
        let drivers: Vec<String> = drivers.iter().map(|driver| (*driver).to_owned()).collect();
        let environment: Vec<(String, String)> =
            environment.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
        let child = spawn(port, &drivers, home.path(), &environment);
        let server = Self { child, port, drivers, home, environment };
        server.await_port();
        server
    }

    fn await_port(&self) {
        let limit = Instant::now() + Duration::from_secs(20);
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(Instant::now() < limit, "no server within 20 s");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Kills it: its drivers end with it.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Starts it anew on its port.
    pub fn again(&mut self) {
        self.child = spawn(self.port, &self.drivers, self.home.path(), &self.environment);
        self.await_port();
    }

    /// Halts its drivers, or lets them go on; the server itself goes on.
    pub fn hang(&self, halted: bool) {
        // The drivers are of the server's group; their numbers nobody here knows.
        let id = self.child.id();
        let signal = if halted { "-STOP" } else { "-CONT" };
        for (signal, whom) in [(signal, format!("-{id}")), ("-CONT", id.to_string())] {
            assert!(Command::new("kill").args([signal, "--", &whom]).status().unwrap().success());
        }
    }

    /// Sets properties as another client (`indi_setprop`), each in its form `DEVICE.PROPERTY.ELEMENT=VALUE`, as soon as they are there.
    pub fn set(&self, properties: &[&str]) {
        let port = self.port.to_string();
        let limit = Instant::now() + Duration::from_secs(30);
        let done = || {
            Command::new("indi_setprop")
                .args(["-p", &port])
                .args(properties)
                .status()
                .unwrap()
                .success()
        };
        while !done() {
            assert!(Instant::now() < limit, "{properties:?}");
        }
    }
}

fn spawn(port: u16, drivers: &[String], home: &Path, environment: &[(String, String)]) -> Child {
    let mut server = Command::new("indiserver");
    server.args(["-p", &port.to_string()]).args(drivers).env("HOME", home);
    server.envs(environment.iter().map(|(name, value)| (name, value)));
    server.process_group(0).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

impl Drop for IndiServer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Where Debian puts libfaketime, which lies to a program about the time of day.
pub fn faketime() -> Option<PathBuf> {
    let folders = std::fs::read_dir("/usr/lib").ok()?;
    let library = |folder: std::fs::DirEntry| folder.path().join("faketime/libfaketimeMT.so.1");
    folders.filter_map(Result::ok).map(library).find(|path| path.exists())
}
