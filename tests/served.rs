//! `sunglint devices serve`: simulated devices on real ports, under programs that we did not write and under our own drivers.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;
use sunglint_testkit::{peer_python, run_python};

/// A serving program; killed where a test ends early.
pub struct Server {
    program: Child,
    /// The document that it prints at its start.
    pub begun: serde_json::Value,
}

impl Server {
    pub fn start(folder: &Folder, arguments: &[&str]) -> Self {
        let mut program = Command::new(crate::common::program())
            .args(["devices", "serve", "--json"])
            .args(arguments)
            .current_dir(folder.path("."))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // The document is complete when its brackets are.
        let mut printed = BufReader::new(program.stdout.take().unwrap());
        let (mut text, mut line) = (String::new(), String::new());
        let begun = loop {
            line.clear();
            assert_ne!(printed.read_line(&mut line).unwrap(), 0, "it ended: {text}");
            text.push_str(&line);
            if let Ok(begun) = serde_json::from_str(&text) {
                break begun;
            }
        };
        Self { program, begun }
    }

    pub fn word(&self, key: &str) -> &str {
        self.begun[key].as_str().unwrap()
    }

    /// Ends it as Ctrl-C does; how it ended, and what it said.
    pub fn end(mut self) -> (ExitStatus, String) {
        let id = self.program.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        let mut said = String::new();
        self.program.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        (self.program.wait().unwrap(), said)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

/// Truth: what pylablib reads is the light that the device was told; the wavelength that it sets is there for the next host, which is ours.
#[test]
fn pylablib_reads_a_served_meter() {
    let name = "served::pylablib_reads_a_served_meter";
    let Some(python) = peer_python(name, &["pylablib"]) else { return };
    let folder = Folder::new("served-ophir");
    let server =
        Server::start(&folder, &["sim-ophir", "--with", "power_w=0.0025", "--pty", "meter"]);
    assert_eq!(server.word("device"), "sim-ophir");
    assert_eq!(std::fs::read_link(folder.path("meter")).unwrap(), Path::new(server.word("pty")));
    let script = r#"
import sys
from pylablib.devices import Ophir
meter = Ophir.VegaPowerMeter((sys.argv[1], 9600))
print(meter.get_power(), meter.set_wavelength(700e-9))
meter.close()
"#;
    for _ in 0..2 {
        let path = folder.path("meter");
        let printed = run_python(&python, script, &[path.to_str().unwrap()]);
        assert_eq!(printed, "0.0025 7.000000000000001e-07\n");
    }
    let read = ["devices", "read", "ophir:meter", "--with", "update_hz=15", "-n", "2", "--json"];
    let read = folder.json(&read);
    assert_eq!(read["readings"][1]["power_w"], 0.0025);
    let check = folder.json(&["devices", "check", "ophir:meter", "--json"]);
    assert!(check["settings"].to_string().contains("700"), "{check}");
    let (status, _) = server.end();
    assert_eq!(status.code(), Some(0));
    assert!(!folder.path("meter").is_symlink(), "the link is gone with the device");
}

/// Truth: pytrinamic's own host reads back the place that it sent the motor to.
#[test]
fn pytrinamic_moves_a_served_stage() {
    let name = "served::pytrinamic_moves_a_served_stage";
    let Some(python) = peer_python(name, &["pytrinamic"]) else { return };
    let folder = Folder::new("served-tmcl");
    let server = Server::start(&folder, &["sim-tmcl", "--pty"]);
    let script = r#"
import os, sys, time
from pytrinamic.connections.tmcl_interface import TmclInterface
from pytrinamic.modules import TMCM1110
class Line(TmclInterface):
    def __init__(self, path):
        super().__init__(); self.file = os.open(path, os.O_RDWR | os.O_NOCTTY)
    def _send(self, host, module, data): os.write(self.file, data)
    def _recv(self, host, module):
        data = b""
        while len(data) < 9: data += os.read(self.file, 9 - len(data))
        return data
module = TMCM1110(Line(sys.argv[1]))
motor = module.motors[0]
module.move_to(0, -500)
while not motor.get_position_reached(): time.sleep(0.01)
print(motor.actual_position)
"#;
    assert_eq!(run_python(&python, script, &[server.word("pty")]), "-500\n");
    assert_eq!(server.end().0.code(), Some(0));
}

/// Truth: the power that the device was told, read by one host after the other. A second host at a time is sent away, and one that talks
/// nonsense ends nothing.
#[test]
fn a_port_serves_one_host_after_the_other() {
    let folder = Folder::new("served-port");
    let server = Server::start(&folder, &["sim-ophir", "--with", "power_w=2e-6", "--tcp", "0"]);
    let at = server.word("tcp").to_owned();
    for _ in 0..2 {
        let address = format!("ophir:tcp:{at}");
        let read = folder.json(&["devices", "read", &address, "--json"]);
        assert_eq!(read["readings"][0]["power_w"], 2e-6);
    }
    let mut first = TcpStream::connect(&at).unwrap();
    first.write_all(b"nonsense\r\n\xff\xfe\r\n").unwrap();
    first.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut answer = [0; 1];
    first.read_exact(&mut answer).unwrap();
    let mut second = TcpStream::connect(&at).unwrap();
    second.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    assert_eq!(second.read(&mut answer).unwrap_or(0), 0, "closed after a moment");
    drop(first);
    let read = folder.json(&["devices", "read", &format!("ophir:tcp:{at}"), "--json"]);
    assert_eq!(read["readings"][0]["power_w"], 2e-6);
    let (status, said) = server.end();
    assert_eq!(status.code(), Some(0));
    assert!(said.contains("was sent away: one host at a time"), "{said}");
}

#[test]
fn what_cannot_be_served_is_said() {
    let folder = Folder::new("served-refused");
    let said = folder.refused(1, &["devices", "serve", "tmcl:/dev/ttyACM0"]);
    assert!(said.contains("only simulated ones"), "{said}");
    let said = folder.refused(1, &["devices", "serve", "sim-pm100"]);
    assert!(said.contains("sim-ophir") && said.contains("line of bytes"), "{said}");
    let said = folder.refused(2, &["devices", "serve", "sim-tmcl", "--tcp", "nowhere"]);
    assert!(said.contains("[ADDRESS:]PORT"), "{said}");
    folder.refused(2, &["devices", "serve", "sim-tmcl", "--tcp", "0", "--pty", "x"]);
    std::fs::write(folder.path("taken"), "mine").unwrap();
    let said = folder.refused(1, &["devices", "serve", "sim-tmcl", "--pty", "taken"]);
    assert!(said.contains("something of that name"), "{said}");
    assert_eq!(std::fs::read_to_string(folder.path("taken")).unwrap(), "mine");
}
