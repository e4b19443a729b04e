//! Alpaca servers of tests: alpaca-simulators, and one that does what it should not.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses its part")]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use sunglint_drivers::alpaca::Place;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::transport::tcp::Tcp;
use sunglint_testkit::{peer_python, repository};

pub fn within(seconds: f64) -> Deadline {
    Deadline::within(Duration::from_secs_f64(seconds))
}

pub fn place(port: u16) -> Place {
    Place { server: format!("127.0.0.1:{port}"), number: 0 }
}

pub fn connect(port: u16) -> Tcp {
    Tcp::connect(&format!("127.0.0.1:{port}"), &within(10.0)).unwrap()
}

/// alpaca-simulators in a process of its own; ends with this.
pub struct Simulators {
    child: Child,
    pub port: u16,
}

impl Simulators {
    /// Starts them, or records the skip of the test. Idle connections are closed after `keep_s`.
    pub fn start(test: &str, keep_s: u32) -> Option<Self> {
        Self::aligned(test, keep_s, &[])
    }

    /// The same, with ASCOM's number of the mount's alignment.
    pub fn aligned(test: &str, keep_s: u32, alignment: &[&str]) -> Option<Self> {
        let python = peer_python(test, &["alpaca_simulators"])?;
        let mut child = Command::new(python)
            .arg(repository().join("drivers/tests/alpaca_server.py"))
            .arg(keep_s.to_string())
            .args(alignment)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let port = line.trim().parse().unwrap();
        let simulators = Self { child, port };
        // The port is there before the server is.
        let deadline = within(60.0);
        while std::panic::catch_unwind(|| connect(port)).is_err() {
            deadline.sleep(Duration::from_millis(100)).unwrap();
        }
        // And its first answer may take seconds on a busy machine, more than a driver waits.
        let mut link = TcpStream::connect(("127.0.0.1", port)).unwrap();
        link.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        link.write_all(
            b"GET /management/apiversions HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n",
        )
        .unwrap();
        link.read_exact(&mut [0; 12]).unwrap();
        Some(simulators)
    }

    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Simulators {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A request as a scripted server sees it: `GET telescope/0/name`, and the form.
pub type Answer = dyn Fn(&str, &str, &mut TcpStream) -> bool + Send + Sync;

/// A server whose answers a test writes; a closure that gives false ends the connection.
pub struct Scripted {
    pub port: u16,
    pub seen: Arc<Mutex<Vec<String>>>,
    ends: Arc<AtomicBool>,
}

impl Scripted {
    pub fn start(answer: Arc<Answer>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let (ends, seen) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
        let (over, heard) = (ends.clone(), seen.clone());
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                if over.load(Ordering::SeqCst) {
                    break;
                }
                let (answer, heard) = (answer.clone(), heard.clone());
                let Ok(stream) = stream else { break };
                std::thread::spawn(move || Self::serve(stream, answer.as_ref(), &heard));
            }
        });
        Self { port, seen, ends }
    }

    fn serve(mut stream: TcpStream, answer: &Answer, heard: &Mutex<Vec<String>>) {
        let mut reader = BufReader::new(stream.try_clone().unwrap());
        loop {
            let (mut first, mut length) = (String::new(), 0);
            if reader.read_line(&mut first).unwrap_or(0) == 0 {
                return;
            }
            loop {
                let mut line = String::new();
                if reader.read_line(&mut line).unwrap_or(0) == 0 {
                    return;
                }
                if let Some(n) = line.to_lowercase().strip_prefix("content-length:") {
                    length = n.trim().parse().unwrap();
                }
                if line.trim().is_empty() {
                    break;
                }
            }
            let mut body = vec![0; length];
            reader.read_exact(&mut body).unwrap();
            let body = String::from_utf8(body).unwrap();
            let mut words = first.split(' ');
            let (method, path) = (words.next().unwrap(), words.next().unwrap());
            let (path, query) = path.split_once('?').unwrap_or((path, ""));
            let path = path.trim_start_matches("/api/v1/");
            let form = if method == "GET" { query } else { &body };
            heard.lock().unwrap().push(format!("{method} {path} {form}"));
            if !answer(&format!("{method} {path}"), form, &mut stream) {
                return;
            }
        }
    }

    pub fn requests(&self) -> Vec<String> {
        self.seen.lock().unwrap().clone()
    }
}

impl Drop for Scripted {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::SeqCst);
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

/// Sends JSON with this value (as JSON).
pub fn value(stream: &mut TcpStream, value: &str) -> bool {
    body(
        stream,
        &format!(
            r#"{{"Value":{value},"ErrorNumber":0,"ErrorMessage":"","ClientTransactionID":0,"ServerTransactionID":1}}"#
        ),
    )
}

/// Sends an error of ASCOM.
pub fn error(stream: &mut TcpStream, code: i64, words: &str) -> bool {
    body(
        stream,
        &format!(
            r#"{{"ErrorNumber":{code},"ErrorMessage":"{words}","ClientTransactionID":0,"ServerTransactionID":1}}"#
        ),
    )
}

/// Sends a body as it is.
pub fn body(stream: &mut TcpStream, text: &str) -> bool {
    let length = text.len();
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all(format!("{head}{text}").as_bytes()).is_ok()
}
