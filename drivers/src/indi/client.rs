//! A client: it keeps what the server defines, sets it, and waits for what comes of it.

use super::property::{Event, Place, Properties, State, Vector};
use super::xml::{Element, Limits, Parser, escaped};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::{Bytes, TransportError};
use std::collections::VecDeque;
use std::fmt::Write as _;
use std::time::Duration;

/// Most bytes that are read at once. Everything that came is looked at before anything is answered.
const CHUNK: usize = 256 << 10;
/// The messages to people that are kept.
const MOST_MESSAGES: usize = 64;
/// How long a change that is done, but not as asked, may still become right: drivers answer twice.
const SECOND_THOUGHT: Duration = Duration::from_millis(500);

/// Whether BLOBs come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blobs {
    /// None; as a connection begins.
    Never,
    /// Among the rest.
    Also,
}

/// Values to be set, by the members' names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wanted<'a> {
    /// Numbers.
    Numbers(&'a [(&'a str, f64)]),
    /// Switches.
    Switches(&'a [(&'a str, bool)]),
    /// Texts.
    Texts(&'a [(&'a str, &'a str)]),
}

impl Wanted<'_> {
    fn kind(&self) -> &'static str {
        match self {
            Self::Numbers(_) => "Number",
            Self::Switches(_) => "Switch",
            Self::Texts(_) => "Text",
        }
    }

    fn pairs(&self) -> Vec<(&str, String)> {
        match self {
            Self::Numbers(all) => all.iter().map(|(name, n)| (*name, n.to_string())).collect(),
            Self::Texts(all) => all.iter().map(|(name, t)| (*name, escaped(t))).collect(),
            Self::Switches(all) => {
                let word = |on: &bool| if *on { "On" } else { "Off" };
                all.iter().map(|(name, on)| (*name, word(on).to_owned())).collect()
            }
        }
    }

    fn describe(&self) -> String {
        let pairs: Vec<String> =
            self.pairs().into_iter().map(|(name, value)| format!("{name}={value}")).collect();
        pairs.join(" ")
    }

    /// Whether a vector has these values; numbers to 1e-6 of themselves: drivers keep single precision.
    pub fn is_in(&self, vector: &Vector) -> bool {
        match self {
            Self::Numbers(all) => all.iter().all(|(name, wanted)| {
                let near = |got: f64| (got - wanted).abs() <= 1e-6 * wanted.abs().max(1.0);
                vector.number(name).is_some_and(near)
            }),
            Self::Switches(all) => {
                all.iter().all(|(name, wanted)| vector.is_on(name) == Some(*wanted))
            }
            Self::Texts(all) => {
                all.iter().all(|(name, wanted)| vector.text(name) == Some(wanted.trim()))
            }
        }
    }
}

/// A connection to a server, and what was defined on it.
#[derive(Debug)]
pub struct Client<T> {
    line: T,
    label: &'static str,
    limits: Limits,
    parser: Parser,
    buffer: Vec<u8>,
    arrived: VecDeque<Element>,
    properties: Properties,
    messages: VecDeque<String>,
    lost: Vec<String>,
    broken: Option<String>,
}

impl<T: Bytes> Client<T> {
    /// A client over `line`; nothing is said yet. `label` is the device in errors.
    pub fn new(line: T, label: &'static str, limits: Limits) -> Self {
        Self {
            line,
            label,
            limits,
            parser: Parser::new(limits),
            buffer: vec![0; CHUNK],
            arrived: VecDeque::new(),
            properties: Properties::default(),
            messages: VecDeque::new(),
            lost: Vec::new(),
            broken: None,
        }
    }

    /// Goes on over another line, as if nothing had been said; gives the old one.
    pub fn replace_line(&mut self, line: T) -> T {
        let old = std::mem::replace(&mut self.line, line);
        self.parser = Parser::new(self.limits);
        self.arrived.clear();
        self.properties.clear();
        self.messages.clear();
        self.lost.clear();
        self.broken = None;
        old
    }

    /// Forgets all definitions on the same line, to ask for them again.
    pub fn forget(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.catch_up(deadline)?;
        self.properties.clear();
        self.lost.clear();
        Ok(())
    }

    /// Takes no BLOBs of more than `bytes`, from the next one on.
    pub fn limit_blobs(&mut self, bytes: usize) {
        self.limits.blob_bytes = bytes;
        self.parser.limit_blobs(bytes);
    }

    /// Most bytes of a BLOB that are taken.
    pub fn blob_limit(&self) -> usize {
        self.limits.blob_bytes
    }

    /// The line.
    pub fn line(&self) -> &T {
        &self.line
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.line
    }

    /// A vector as it was last said to be.
    pub fn property(&self, device: &str, name: &str) -> Option<&Vector> {
        self.properties.get(device, name)
    }

    /// All vectors that are defined.
    pub fn properties(&self) -> &Properties {
        &self.properties
    }

    /// The server's last messages to people, the oldest first.
    pub fn messages(&self) -> impl Iterator<Item = &str> {
        self.messages.iter().map(String::as_str)
    }

    /// A vector that must be there.
    ///
    /// # Errors
    /// [`DeviceError::Lost`] if its driver has ended; otherwise what is missing.
    pub fn require(&self, device: &str, name: &str) -> Result<&Vector, DeviceError> {
        self.properties.get(device, name).ok_or_else(|| self.missing(device, name))
    }

    fn missing(&self, device: &str, name: &str) -> DeviceError {
        if self.lost.iter().any(|lost| lost == device) {
            return self.lost_error(device);
        }
        let what = format!("`{device}` has no property {name} (any more)");
        DeviceError::Lost { device: self.label, what }
    }

    fn lost_error(&self, device: &str) -> DeviceError {
        let what = format!("the driver of `{device}` has ended (delProperty)");
        DeviceError::Lost { device: self.label, what }
    }

    /// The next thing that the server says.
    ///
    /// # Errors
    /// The transport, its deadline among it; a stream that is not INDI, from then on.
    pub fn event(&mut self, deadline: &Deadline) -> Result<Event, DeviceError> {
        loop {
            if let Some(element) = self.arrived.pop_front() {
                return self.apply(element, deadline);
            }
            self.check_stream()?;
            let received = self.line.receive(&mut self.buffer, deadline);
            let count = received.map_err(|source| self.transport(source))?;
            self.parser.feed(&self.buffer[..count]);
            loop {
                match self.parser.element() {
                    Ok(Some(element)) => self.arrived.push_back(element),
                    Ok(None) => break,
                    Err(error) => {
                        self.broken = Some(error.to_string());
                        break;
                    }
                }
            }
        }
    }

    fn check_stream(&self) -> Result<(), DeviceError> {
        match &self.broken {
            None => Ok(()),
            Some(reason) => {
                let reason = format!("what came is not INDI: {reason}; connect again");
                Err(DeviceError::Protocol { device: self.label, reason })
            }
        }
    }

    fn transport(&self, source: TransportError) -> DeviceError {
        DeviceError::transport(self.label, source)
    }

    fn apply(&mut self, element: Element, deadline: &Deadline) -> Result<Event, DeviceError> {
        let event = self.properties.apply(element);
        match &event {
            Event::Message { text, .. } => self.keep(text.clone()),
            Event::Ignored(what) => self.keep(format!("(ignored) {what}")),
            // Of a server that makes devices up, the first few.
            Event::Lost(device) if self.lost.len() < MOST_MESSAGES => {
                self.lost.push(device.clone());
            }
            Event::Defined(place) => self.lost.retain(|device| *device != place.device),
            Event::Ping(uid) => {
                let uid = escaped(uid);
                self.send(&format!("<pingReply uid=\"{uid}\"/>\n"), deadline)?;
            }
            _ => {}
        }
        Ok(event)
    }

    fn keep(&mut self, mut message: String) {
        shorten(&mut message);
        if self.messages.len() == MOST_MESSAGES {
            self.messages.pop_front();
        }
        self.messages.push_back(message);
    }

    /// Takes in what has arrived already, so that it is not taken for an answer to what is sent next.
    fn catch_up(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        while let Some(element) = self.arrived.pop_front() {
            self.apply(element, deadline)?;
        }
        self.check_stream()
    }

    fn send(&mut self, text: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        let sent = self.line.send(text.as_bytes(), deadline);
        sent.map_err(|source| self.transport(source))
    }

    /// Asks for the definitions of everything, of a device, or of one of its vectors.
    ///
    /// # Errors
    /// The transport.
    pub fn get_properties(
        &mut self,
        of: Option<(&str, Option<&str>)>,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.catch_up(deadline)?;
        let mut text = String::from("<getProperties version=\"1.7\"");
        if let Some((device, name)) = of {
            let _ = write!(text, " device=\"{}\"", escaped(device));
            if let Some(name) = name {
                let _ = write!(text, " name=\"{}\"", escaped(name));
            }
        }
        text.push_str("/>\n");
        self.send(&text, deadline)
    }

    /// Says whether the BLOBs of a vector are to come.
    ///
    /// # Errors
    /// The transport.
    pub fn enable_blobs(
        &mut self,
        device: &str,
        name: &str,
        blobs: Blobs,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let (device, name) = (escaped(device), escaped(name));
        let word = match blobs {
            Blobs::Never => "Never",
            Blobs::Also => "Also",
        };
        let text = format!("<enableBLOB device=\"{device}\" name=\"{name}\">{word}</enableBLOB>\n");
        self.send(&text, deadline)
    }

    /// Sends new values of a vector that must be there; what comes of it, comes later.
    ///
    /// # Errors
    /// The vector or a member is not there or cannot be set; the transport.
    pub fn set(
        &mut self,
        device: &str,
        name: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.catch_up(deadline)?;
        let vector = self.require(device, name)?;
        if let Some((member, _)) =
            wanted.pairs().into_iter().find(|(member, _)| vector.member(member).is_none())
        {
            let known: Vec<&str> = vector.members.iter().map(|m| m.name.as_str()).collect();
            return Err(DeviceError::Unknown {
                name: "member of an INDI property",
                asked: format!("{name}.{member}"),
                known: known.join(", "),
            });
        }
        if !vector.writable || vector.kind.name() != wanted.kind() {
            let reason = format!("{name} cannot be set to {}s", wanted.kind().to_lowercase());
            return Err(DeviceError::Protocol { device: self.label, reason });
        }
        let kind = wanted.kind();
        let (device, name) = (escaped(device), escaped(name));
        let mut text = format!("<new{kind}Vector device=\"{device}\" name=\"{name}\">");
        for (member, value) in wanted.pairs() {
            let member = escaped(member);
            let _ = write!(text, "<one{kind} name=\"{member}\">{value}</one{kind}>");
        }
        let _ = writeln!(text, "</new{kind}Vector>");
        self.send(&text, deadline)
    }

    /// Waits until `look` has found what it looks for in what the server says. `awaited` names it in errors.
    ///
    /// # Errors
    /// [`DeviceError::Awaited`] with what came instead; [`DeviceError::Lost`] if the device's driver ends; the
    /// transport.
    pub fn wait<R>(
        &mut self,
        device: &str,
        awaited: &str,
        deadline: &Deadline,
        look: impl FnMut(&Self, Event) -> Option<Result<R, DeviceError>>,
    ) -> Result<R, DeviceError> {
        self.wait_on(device, awaited, deadline, &mut Seen::default(), look)
    }

    /// The same as a part of a longer wait.
    fn wait_on<R>(
        &mut self,
        device: &str,
        awaited: &str,
        deadline: &Deadline,
        seen: &mut Seen,
        mut look: impl FnMut(&Self, Event) -> Option<Result<R, DeviceError>>,
    ) -> Result<R, DeviceError> {
        loop {
            let event = match self.event(deadline) {
                Ok(event) => event,
                Err(error) => return Err(self.waited(error, awaited, seen)),
            };
            seen.note(&event, device);
            if matches!(&event, Event::Lost(lost) if lost == device) {
                return Err(self.lost_error(device));
            }
            if let Some(result) = look(self, event) {
                return result;
            }
        }
    }

    /// A silence is told with what was waited for and what came instead.
    fn waited(&self, error: DeviceError, awaited: &str, seen: &Seen) -> DeviceError {
        match error {
            DeviceError::Transport { source: TransportError::Timeout { after, .. }, .. } => {
                DeviceError::Awaited {
                    device: self.label,
                    awaited: awaited.to_owned(),
                    after,
                    seen: seen.to_string(),
                }
            }
            other => other,
        }
    }

    /// Waits for the definition of a vector, unless it is there.
    ///
    /// # Errors
    /// The errors of [`wait`](Self::wait).
    pub fn await_defined(
        &mut self,
        device: &str,
        name: &str,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        if self.properties.get(device, name).is_some() {
            return Ok(());
        }
        let wanted = Place { device: device.to_owned(), name: name.to_owned() };
        let awaited = format!("the definition of {wanted}");
        self.wait(device, &awaited, deadline, |_, event| match event {
            Event::Defined(place) if place == wanted => Some(Ok(())),
            _ => None,
        })
    }

    /// Asks for a vector anew and gives it as it is now.
    ///
    /// # Errors
    /// The errors of [`wait`](Self::wait).
    pub fn refresh(
        &mut self,
        device: &str,
        name: &str,
        deadline: &Deadline,
    ) -> Result<Vector, DeviceError> {
        let wanted = Place { device: device.to_owned(), name: name.to_owned() };
        self.get_properties(Some((device, Some(name))), deadline)?;
        let awaited = format!("the definition of {wanted}");
        self.wait(device, &awaited, deadline, |client, event| match event {
            Event::Defined(place) if place == wanted => Some(client.require(device, name).cloned()),
            _ => None,
        })
    }

    /// Takes in what comes until nothing was defined for `quiet`. Other things may come all the time: some devices never fall silent.
    ///
    /// # Errors
    /// The transport; the deadline, if the server never ends to define.
    pub fn settle(&mut self, quiet: Duration, deadline: &Deadline) -> Result<(), DeviceError> {
        let mut step = deadline.at_most(quiet);
        loop {
            match self.event(&step) {
                Ok(Event::Defined(_)) => step = deadline.at_most(quiet),
                Ok(_) => {}
                Err(DeviceError::Transport { source: TransportError::Timeout { .. }, .. }) => {
                    return match deadline.remaining() {
                        Ok(_) => Ok(()),
                        Err(expired) => Err(self.transport(expired.into())),
                    };
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Sets a vector and waits until the server has done it; gives the vector as it is then, which may differ from what
    /// was asked.
    ///
    /// # Errors
    /// [`DeviceError::Declined`] with the server's words; as [`set`](Self::set) and [`wait`](Self::wait).
    pub fn change(
        &mut self,
        device: &str,
        name: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> Result<Vector, DeviceError> {
        self.set(device, name, wanted, deadline)?;
        self.await_change(device, name, wanted, |vector| wanted.is_in(vector), deadline)
    }

    /// Sets switches that spring back by themselves (an abort), and waits until the server has done it.
    ///
    /// # Errors
    /// The errors of [`change`](Self::change).
    pub fn pulse(
        &mut self,
        device: &str,
        name: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> Result<Vector, DeviceError> {
        self.set(device, name, wanted, deadline)?;
        self.await_change(device, name, wanted, |_| true, deadline)
    }

    fn await_change(
        &mut self,
        device: &str,
        name: &str,
        wanted: Wanted<'_>,
        is_as_wanted: impl Fn(&Vector) -> bool,
        deadline: &Deadline,
    ) -> Result<Vector, DeviceError> {
        let request = format!("{name} {}", wanted.describe());
        let awaited = format!("the answer to {request}");
        let mut said = Vec::new();
        let mut seen = Seen::default();
        let mut other = None;
        let mut step = deadline.clone();
        loop {
            let look = |client: &Self, event| match event {
                Event::Message { text, .. } => {
                    hear(&mut said, text);
                    None
                }
                Event::Changed(place, state) if place.device == device && place.name == name => {
                    Some(client.require(device, name).cloned().map(|vector| (vector, state)))
                }
                Event::Deleted(place) if place.device == device && place.name == name => {
                    Some(Err(client.missing(device, name)))
                }
                _ => None,
            };
            let found = self.wait_on(device, &awaited, &step, &mut seen, look);
            let (vector, state) = match (found, other.take()) {
                (Ok(found), _) => found,
                // No second thought came: the first was meant.
                (Err(DeviceError::Awaited { .. }), Some(vector)) => return Ok(vector),
                (Err(error), _) => return Err(error),
            };
            match state {
                State::Alert => return Err(declined(self.label, request, &said)),
                State::Busy => step = deadline.clone(),
                State::Ok if is_as_wanted(&vector) => return Ok(vector),
                State::Ok | State::Idle => {
                    other = Some(vector);
                    step = deadline.at_most(SECOND_THOUGHT);
                }
            }
        }
    }
}

/// Bytes of a message to people that are kept.
const MOST_TEXT: usize = 1024;

/// Cuts a text that a server sent.
fn shorten(text: &mut String) {
    if text.len() > MOST_TEXT {
        let mut end = MOST_TEXT;
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        text.truncate(end);
        text.push('…');
    }
}

/// Keeps the last of what is said to people: a driver may never stop talking.
pub(super) fn hear(said: &mut Vec<String>, mut text: String) {
    const MOST: usize = 2;
    shorten(&mut text);
    if said.len() == MOST {
        said.remove(0);
    }
    said.push(text);
}

/// A refusal with the last of what was said to people.
pub(super) fn declined(device: &'static str, request: String, said: &[String]) -> DeviceError {
    let message = match said {
        [] => "it gave no reason (Alert)".to_owned(),
        said => said[said.len().saturating_sub(2)..].join(" "),
    };
    DeviceError::Declined { device, request, message }
}

/// Events that came during a wait: the last few, for an error.
#[derive(Debug, Default)]
struct Seen {
    last: VecDeque<String>,
    events: u64,
}

impl Seen {
    fn note(&mut self, event: &Event, device: &str) {
        const MOST: usize = 4;
        self.events += 1;
        let mut text = match event {
            Event::Defined(_) => return,
            Event::Changed(place, _) | Event::Blob(place, _) | Event::Damaged(place, _)
                if place.device != device =>
            {
                return;
            }
            Event::Damaged(place, what) => format!("{} {what}", place.name),
            Event::Changed(place, state) => format!("{} {state}", place.name),
            Event::Blob(place, blob) => {
                format!("{} {} of {} bytes", place.name, blob.format, blob.bytes.len())
            }
            Event::Deleted(place) => format!("{} deleted", place.name),
            Event::Lost(lost) => format!("{lost} deleted"),
            Event::Message { text, .. } => format!("message `{text}`"),
            Event::Ping(_) => return,
            Event::Ignored(what) => what.clone(),
        };
        shorten(&mut text);
        if self.last.len() == MOST {
            self.last.pop_front();
        }
        self.last.push_back(text);
    }
}

impl std::fmt::Display for Seen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.events, self.last.is_empty()) {
            (0, _) => f.write_str("nothing"),
            (events, true) => write!(f, "{events} things of other kinds"),
            (events, false) => {
                let last: Vec<&str> = self.last.iter().map(String::as_str).collect();
                write!(f, "{events} things, at last {}", last.join(", "))
            }
        }
    }
}
