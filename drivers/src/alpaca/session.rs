//! One device of a server: reading its members, and setting them.

use super::answer::{Fail, MOST_JSON, clean, value_of};
use super::http::{Http, HttpError, Request, Response};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity};
use crate::transport::{Bytes, TransportError};
use serde_json::Value;
use std::time::Duration;

/// Number by which servers tell this program from others.
const CLIENT_ID: u32 = 2108;

/// How to speak to a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SessionSettings {
    /// How long an answer that takes no work may take.
    pub answer_within: Duration,
    /// Time between two questions whether something is done.
    pub poll: Duration,
    /// The largest frame, bytes: memory that a server can claim.
    pub frame_bytes: usize,
}

impl Default for SessionSettings {
    fn default() -> Self {
        Self {
            answer_within: Duration::from_secs(5),
            poll: Duration::from_millis(50),
            frame_bytes: 128 << 20,
        }
    }
}

/// Time after a command in which a device need not move yet, nor say so.
pub(super) const STARTS: Duration = Duration::from_millis(1500);

/// A device of a server.
#[derive(Debug)]
pub(super) struct Session<T> {
    http: Http<T>,
    /// The device in errors.
    pub label: &'static str,
    /// Name of the kind in paths.
    kind: &'static str,
    number: u32,
    transaction: u32,
    pub settings: SessionSettings,
}

/// Types of body that are taken.
const JSON: &str = "application/json";

impl<T: Bytes> Session<T> {
    /// Opens the device and connects the server to what is behind it.
    pub fn open(
        line: T,
        place: &Place,
        [label, kind]: [&'static str; 2],
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Self::new(line, place, [label, kind], settings);
        let connected = match session.get("connected", &[], deadline) {
            Ok(value) => value == Value::Bool(true),
            Err(fail) if fail.is_absent() => {
                let asked = format!("{kind} {}", place.number);
                let known = format!(
                    "the devices of {} (list them: devices list --alpaca {})",
                    place.server, place.server
                );
                return Err(DeviceError::Unknown {
                    name: DeviceError::ALPACA_DEVICE,
                    asked,
                    known,
                });
            }
            Err(fail) => return Err(fail.error(label, "connected")),
        };
        if !connected {
            // What is behind the server may take its time.
            let put = session.put_within("connected", &[("Connected", "true".into())], deadline);
            put.map_err(|fail| fail.error(label, "to connect to the device behind it"))?;
        }
        Ok(session)
    }

    pub fn new(
        line: T,
        place: &Place,
        [label, kind]: [&'static str; 2],
        settings: SessionSettings,
    ) -> Self {
        let http = Http::new(line, &place.server);
        Self { http, label, kind, number: place.number, transaction: 0, settings }
    }

    pub fn line(&self) -> &T {
        self.http.line()
    }

    fn soon(&self, deadline: &Deadline) -> Deadline {
        deadline.at_most(self.settings.answer_within)
    }

    fn path(&self, member: &str) -> String {
        format!("/api/v1/{}/{}/{member}", self.kind, self.number)
    }

    /// The parameters of a request, with its number.
    fn form(&mut self, parameters: &[(&str, String)]) -> String {
        self.transaction = self.transaction.wrapping_add(1).max(1);
        let mut form = format!("ClientID={CLIENT_ID}&ClientTransactionID={}", self.transaction);
        for (name, value) in parameters {
            form.push('&');
            form.push_str(name);
            form.push('=');
            for byte in value.bytes() {
                if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
                    form.push(char::from(byte));
                } else {
                    form.push_str(&format!("%{byte:02X}"));
                }
            }
        }
        form
    }

    fn exchange(&mut self, request: &Request<'_>, deadline: &Deadline) -> Result<Response, Fail> {
        let device = self.label;
        self.http.exchange(request, deadline).map_err(|error| {
            Fail::Device(match error {
                HttpError::Transport(error) => DeviceError::transport(device, error),
                HttpError::Malformed(reason) => DeviceError::Protocol { device, reason },
            })
        })
    }

    /// The value of an answer. After one that is not of this request, or no answer of Alpaca, the connection is not trusted: what comes next on it may be late, too.
    fn value_of(&mut self, response: &Response) -> Result<Value, Fail> {
        let value = value_of(self.label, response, self.transaction);
        if matches!(value, Err(Fail::Device(_))) {
            self.forget();
        }
        value
    }

    /// Gives the connection up: the next request makes a new one.
    pub fn forget(&mut self) {
        self.http.forget();
    }

    /// Reads a member.
    pub fn get(
        &mut self,
        member: &str,
        parameters: &[(&str, String)],
        deadline: &Deadline,
    ) -> Result<Value, Fail> {
        let form = self.form(parameters);
        let path = format!("{}?{form}", self.path(member));
        let request = Request {
            method: "GET",
            path: &path,
            form: "",
            accept: JSON,
            most_body: MOST_JSON,
            repeats: true,
        };
        let response = self.exchange(&request, &self.soon(deadline))?;
        self.value_of(&response)
    }

    /// Reads the frame, in the form that the server prefers.
    pub fn image(&mut self, most: usize, deadline: &Deadline) -> Result<(Response, u32), Fail> {
        let form = self.form(&[]);
        let path = format!("{}?{form}", self.path("imagearray"));
        let request = Request {
            method: "GET",
            path: &path,
            form: "",
            accept: "application/imagebytes, application/json",
            most_body: most,
            repeats: true,
        };
        let response = self.exchange(&request, deadline)?;
        Ok((response, self.transaction))
    }

    fn put_as(
        &mut self,
        member: &str,
        parameters: &[(&str, String)],
        repeats: bool,
        deadline: &Deadline,
    ) -> Result<(), Fail> {
        let form = self.form(parameters);
        let path = self.path(member);
        let request = Request {
            method: "PUT",
            path: &path,
            form: &form,
            accept: JSON,
            most_body: MOST_JSON,
            repeats,
        };
        let response = self.exchange(&request, deadline)?;
        self.value_of(&response).map(drop)
    }

    /// Sets a member, or begins something that is the same if it is begun twice.
    pub fn put(
        &mut self,
        member: &str,
        parameters: &[(&str, String)],
        deadline: &Deadline,
    ) -> Result<(), Fail> {
        let soon = self.soon(deadline);
        self.put_as(member, parameters, true, &soon)
    }

    /// The same for what may take as long as the deadline.
    pub fn put_within(
        &mut self,
        member: &str,
        parameters: &[(&str, String)],
        deadline: &Deadline,
    ) -> Result<(), Fail> {
        self.put_as(member, parameters, true, deadline)
    }

    /// Begins something that must not be begun twice.
    pub fn put_once(
        &mut self,
        member: &str,
        parameters: &[(&str, String)],
        deadline: &Deadline,
    ) -> Result<(), Fail> {
        let soon = self.soon(deadline);
        self.put_as(member, parameters, false, &soon)
    }

    /// Sets a member; an error names it.
    pub fn set(
        &mut self,
        member: &str,
        name: &str,
        value: String,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let request = format!("{name} = {value}");
        let label = self.label;
        self.put(member, &[(name, value)], deadline).map_err(|fail| fail.error(label, &request))
    }

    fn wrong(&self, member: &str, expected: &str, found: &Value) -> DeviceError {
        let found: String = found.to_string().chars().take(80).collect();
        self.protocol(format!("{member} is {found}, expected {expected}"))
    }

    pub fn protocol(&self, reason: String) -> DeviceError {
        DeviceError::Protocol { device: self.label, reason }
    }

    fn value(&mut self, member: &str, deadline: &Deadline) -> Result<Value, DeviceError> {
        let label = self.label;
        self.get(member, &[], deadline).map_err(|fail| fail.error(label, member))
    }

    /// A member that not every device has.
    pub fn optional(
        &mut self,
        member: &str,
        deadline: &Deadline,
    ) -> Result<Option<Value>, DeviceError> {
        let label = self.label;
        match self.get(member, &[], deadline) {
            Ok(value) => Ok(Some(value)),
            // What it has not measured or set yet is nothing, too.
            Err(fail) if fail.is_absent() || fail.is_not_yet() => Ok(None),
            Err(fail) => Err(fail.error(label, member)),
        }
    }

    /// A number between two ends.
    pub fn number(
        &mut self,
        member: &str,
        [least, most]: [f64; 2],
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        let value = self.value(member, deadline)?;
        let number = value.as_f64().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| self.wrong(member, &format!("a number, {least} to {most}"), &value))
    }

    /// A number, where the device has it and knows it.
    pub fn optional_number(
        &mut self,
        member: &str,
        deadline: &Deadline,
    ) -> Result<Option<f64>, DeviceError> {
        Ok(self.optional(member, deadline)?.and_then(|v| v.as_f64()).filter(|n| n.is_finite()))
    }

    /// A whole number between two ends.
    pub fn integer(
        &mut self,
        member: &str,
        [least, most]: [i64; 2],
        deadline: &Deadline,
    ) -> Result<i64, DeviceError> {
        let value = self.value(member, deadline)?;
        let number = value.as_i64().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| {
            self.wrong(member, &format!("a whole number, {least} to {most}"), &value)
        })
    }

    pub fn flag(&mut self, member: &str, deadline: &Deadline) -> Result<bool, DeviceError> {
        let value = self.value(member, deadline)?;
        value.as_bool().ok_or_else(|| self.wrong(member, "true or false", &value))
    }

    /// Whether the device can do something; no, where it does not know the question.
    pub fn can(&mut self, member: &str, deadline: &Deadline) -> Result<bool, DeviceError> {
        Ok(self.optional(member, deadline)?.and_then(|v| v.as_bool()).unwrap_or(false))
    }

    /// Texts, at most 100.
    pub fn texts(&mut self, member: &str, deadline: &Deadline) -> Result<Vec<String>, DeviceError> {
        let value = self.value(member, deadline)?;
        let texts = value.as_array().filter(|all| all.len() <= 100).and_then(|all| {
            all.iter().map(|one| Some(clean(one.as_str()?.trim(), 100))).collect::<Option<Vec<_>>>()
        });
        texts.ok_or_else(|| self.wrong(member, "a list of at most 100 names", &value))
    }

    pub fn text(
        &mut self,
        member: &str,
        deadline: &Deadline,
    ) -> Result<Option<String>, DeviceError> {
        let value = self.optional(member, deadline)?;
        let text = value.as_ref().and_then(Value::as_str).map(str::trim);
        Ok(text.filter(|text| !text.is_empty()).map(|text| clean(text, 100)))
    }

    pub fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let name = self.text("name", deadline)?;
        let description = self.text("description", deadline)?;
        let version = self.text("driverversion", deadline)?;
        let model =
            name.or(description).unwrap_or_else(|| format!("{} {}", self.kind, self.number));
        let firmware = version.map(|version| format!("driver {version}"));
        Ok(Identity {
            vendor: "ASCOM Alpaca".into(),
            model,
            serial: None,
            firmware,
            driver: "alpaca",
        })
    }

    /// Waits until a question is answered with yes.
    pub fn wait(
        &mut self,
        action: &'static str,
        deadline: &Deadline,
        mut done: impl FnMut(&mut Self, &Deadline) -> Result<bool, DeviceError>,
    ) -> Result<(), DeviceError> {
        let (label, poll) = (self.label, self.settings.poll);
        let expired = |expired| DeviceError::expired(label, action, expired);
        loop {
            deadline.remaining().map_err(expired)?;
            match done(self, deadline) {
                Ok(true) => return Ok(()),
                Ok(false) => {}
                // The time that was left for the last question was the end of the whole.
                Err(DeviceError::Transport { source: TransportError::Timeout { .. }, .. })
                    if deadline.remaining().is_err() => {}
                Err(error) => return Err(error),
            }
            deadline.sleep(poll).map_err(expired)?;
        }
    }
}

impl<T: Bytes> Session<T> {
    /// Waits until a device is `there` or has come to a stop elsewhere, and gives where it stands. `look` reads that; `None` while the device says that it moves.
    /// A device may be late to begin, and say until then that it does not move: it has stopped if it stands the `same` twice, and not right after the command.
    pub fn settle<V: Copy>(
        &mut self,
        action: &'static str,
        deadline: &Deadline,
        mut look: impl FnMut(&mut Self, &Deadline) -> Result<Option<V>, DeviceError>,
        there: impl Fn(V) -> bool,
        same: impl Fn(V, V) -> bool,
    ) -> Result<V, DeviceError> {
        let begun = deadline.now();
        let mut last = None;
        self.wait(action, deadline, |session, deadline| {
            let Some(now) = look(session, deadline)? else {
                last = None;
                return Ok(false);
            };
            let young = deadline.now().saturating_sub(begun) < STARTS;
            let stands = last.is_some_and(|last| same(last, now));
            last = Some(now);
            Ok(there(now) || (stands && !young))
        })?;
        last.ok_or_else(|| self.protocol("it does not say where it stands".into()))
    }
}

/// Where a device is: its server and its number there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// `HOST:PORT`.
    pub server: String,
    /// Number of the device among those of its kind, from 0.
    pub number: u32,
}
