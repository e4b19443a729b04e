//! Requests to the bridge and its answers, with what it measures in between.

use super::DEVICE;
use super::advice::declined;
use super::frame::{Frame, PROTOCOL, Parser, checksum};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::Bytes;
use serde_json::{Map, Value, json};

/// Most bytes that are read from the line at once.
const PIECE: usize = 64 << 10;

/// A conversation with the bridge.
#[derive(Debug)]
pub(super) struct Bridge<T> {
    line: T,
    parser: Parser,
    piece: Vec<u8>,
    last_id: u64,
    /// After half a request the bridge would take the next one for its end.
    broken: Option<String>,
}

impl<T: Bytes> Bridge<T> {
    /// Says hello, and gives the version of the maker's package.
    pub(super) fn open(line: T, deadline: &Deadline) -> Result<(Self, String), DeviceError> {
        let mut bridge =
            Self { line, parser: Parser::new(), piece: vec![0; PIECE], last_id: 0, broken: None };
        let nothing = &mut |_| Ok(());
        let hello = bridge.ask("hello", json!({"protocol": PROTOCOL}), deadline, nothing)?;
        let found = hello.get("protocol").and_then(Value::as_u64);
        if found != Some(PROTOCOL) {
            let text = format!("it speaks version {found:?}, not {PROTOCOL}");
            return Err(declined("hello", "wrong_version", &text));
        }
        if text_of(&hello, "statistics") != Some("off") {
            return Err(protocol("it does not say that usage statistics are off".into()));
        }
        let version = text_of(&hello, "version").unwrap_or("unknown").to_owned();
        Ok((bridge, version))
    }

    pub(super) fn line(&self) -> &T {
        &self.line
    }

    pub(super) fn line_mut(&mut self) -> &mut T {
        &mut self.line
    }

    pub(super) fn into_line(self) -> T {
        self.line
    }

    /// Asks and waits for the answer; what is measured meanwhile goes to `beside`.
    pub(super) fn ask(
        &mut self,
        operation: &str,
        arguments: Value,
        deadline: &Deadline,
        beside: &mut dyn FnMut(Frame) -> Result<(), DeviceError>,
    ) -> Result<Map<String, Value>, DeviceError> {
        self.last_id += 1;
        let mut request = json!({"id": self.last_id, "op": operation});
        if let (Value::Object(request), Value::Object(arguments)) = (&mut request, arguments) {
            request.extend(arguments);
        }
        self.send(&request.to_string(), deadline)?;
        loop {
            match self.frame(deadline)? {
                Frame::Json(answer) => {
                    if let Some(done) = self.answer(operation, answer)? {
                        return Ok(done);
                    }
                }
                measured => beside(measured)?,
            }
        }
    }

    /// Returns the content of an answer, if it is the one to the last request: older ones come late, after a deadline had passed.
    fn answer(
        &self,
        operation: &str,
        mut answer: Value,
    ) -> Result<Option<Map<String, Value>>, DeviceError> {
        match answer.get("id") {
            Some(Value::Null) => return Err(unasked(&answer)),
            Some(id) => match id.as_u64() {
                Some(id) if id == self.last_id => {}
                Some(id) if id < self.last_id => return Ok(None),
                _ => return Err(protocol(format!("an answer to request {id} that was not made"))),
            },
            None => return Err(protocol(format!("an answer without id: {}", short(&answer)))),
        }
        if let Some(error) = answer.get("error") {
            return Err(refused(operation, error));
        }
        match answer.get_mut("ok").map(Value::take) {
            Some(Value::Object(done)) => Ok(Some(done)),
            _ => Err(protocol(format!("an answer without result: {}", short(&answer)))),
        }
    }

    fn send(&mut self, request: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        if let Some(reason) = &self.broken {
            return Err(protocol(reason.clone()));
        }
        let line = format!("{request} {:08x}\n", checksum(request.as_bytes()));
        self.line.send(line.as_bytes(), deadline).map_err(|error| {
            self.broken = Some("a request went only in part: start the bridge anew".to_owned());
            DeviceError::transport(DEVICE, error)
        })
    }

    /// The next frame.
    pub(super) fn frame(&mut self, deadline: &Deadline) -> Result<Frame, DeviceError> {
        loop {
            match self.parser.frame() {
                Ok(Some(frame)) => return Ok(frame),
                Ok(None) => {}
                Err(error) => {
                    return Err(protocol(format!("{error}: start the bridge anew")));
                }
            }
            let received = self.line.receive(&mut self.piece, deadline);
            let count = received.map_err(|error| DeviceError::transport(DEVICE, error))?;
            self.parser.feed(&self.piece[..count]);
        }
    }

    /// The next frame with something that was measured; answers that come late are passed over.
    pub(super) fn measured(&mut self, deadline: &Deadline) -> Result<Frame, DeviceError> {
        loop {
            match self.frame(deadline)? {
                Frame::Json(answer) if answer.get("id").is_some_and(Value::is_null) => {
                    return Err(unasked(&answer));
                }
                Frame::Json(_) => {}
                measured => return Ok(measured),
            }
        }
    }
}

fn unasked(answer: &Value) -> DeviceError {
    match answer.get("error") {
        Some(error) => refused("what it was doing", error),
        None => protocol(format!("an answer to nothing: {}", short(answer))),
    }
}

fn refused(operation: &str, error: &Value) -> DeviceError {
    let of = |key: &str| error.get(key).and_then(Value::as_str).unwrap_or("unknown");
    declined(operation, of("code"), of("text"))
}

fn short(value: &Value) -> String {
    value.to_string().chars().take(120).collect()
}

pub(super) fn text_of<'a>(answer: &'a Map<String, Value>, key: &str) -> Option<&'a str> {
    answer.get(key).and_then(Value::as_str)
}

pub(super) fn protocol(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}
