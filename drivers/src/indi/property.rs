//! The property model: vectors of texts, numbers, switches, lights and BLOBs, as a server defines and changes them.

use super::xml::Element;
use std::collections::BTreeMap;
use std::fmt;
use sunglint_numerics::measured::Interval;

/// The state of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Nothing happens.
    Idle,
    /// The last change is done.
    Ok,
    /// The device is at it.
    Busy,
    /// It went wrong; a message says why.
    Alert,
}

impl State {
    fn parse(text: &str) -> Option<Self> {
        [Self::Idle, Self::Ok, Self::Busy, Self::Alert].into_iter().find(|s| s.name() == text)
    }

    /// The word in the protocol.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "Idle",
            Self::Ok => "Ok",
            Self::Busy => "Busy",
            Self::Alert => "Alert",
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Kind of the members of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Texts.
    Text,
    /// Numbers.
    Number,
    /// Switches.
    Switch,
    /// Lights, which only show.
    Light,
    /// BLOBs.
    Blob,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Text, Self::Number, Self::Switch, Self::Light, Self::Blob];

    /// The word in the protocol's tags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "Text",
            Self::Number => "Number",
            Self::Switch => "Switch",
            Self::Light => "Light",
            Self::Blob => "BLOB",
        }
    }

    /// The kind in a tag such as `setNumberVector`.
    fn of(tag: &str, verb: &str) -> Option<Self> {
        let kind = tag.strip_prefix(verb)?.strip_suffix("Vector")?;
        Self::ALL.into_iter().find(|k| k.name() == kind)
    }
}

/// A member's value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A text.
    Text(String),
    /// A number; NaN where a driver does not know it.
    Number(f64),
    /// On or off.
    Switch(bool),
    /// State that a light shows.
    Light(State),
    /// A BLOB's bytes are in its event, not in the store.
    Blob,
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => write!(f, "`{text}`"),
            Self::Number(number) => write!(f, "{number}"),
            Self::Switch(on) => f.write_str(if *on { "On" } else { "Off" }),
            Self::Light(state) => state.fmt(f),
            Self::Blob => f.write_str("a BLOB"),
        }
    }
}

/// One member of a vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// Name of the member.
    pub name: String,
    /// Value of the member.
    pub value: Value,
    /// The least and the most that a number may be; both 0, or not there, if the driver does not say.
    pub range: Option<Interval>,
}

/// A vector: what INDI calls a property.
#[derive(Debug, Clone, PartialEq)]
pub struct Vector {
    /// Kind of the vector's members.
    pub kind: Kind,
    /// State of the vector.
    pub state: State,
    /// Whether a client may set it.
    pub writable: bool,
    /// Members of the vector, in the driver's order.
    pub members: Vec<Member>,
    /// About how many bytes it takes.
    weight: usize,
}

impl Vector {
    /// A vector at rest, for a server.
    pub(crate) fn new(kind: Kind, writable: bool, members: Vec<Member>) -> Self {
        Self { kind, state: State::Idle, writable, members, weight: 0 }
    }

    /// Gives a number another value, for a server.
    pub(crate) fn set_number(&mut self, name: &str, number: f64) {
        if let Some(member) = self.members.iter_mut().find(|member| member.name == name) {
            member.value = Value::Number(number);
        }
    }

    /// A member.
    pub fn member(&self, name: &str) -> Option<&Member> {
        self.members.iter().find(|member| member.name == name)
    }

    /// A finite number.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.member(name)?.value {
            Value::Number(number) if number.is_finite() => Some(number),
            _ => None,
        }
    }

    /// A text.
    pub fn text(&self, name: &str) -> Option<&str> {
        match &self.member(name)?.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Whether a switch is on.
    pub fn is_on(&self, name: &str) -> Option<bool> {
        match self.member(name)?.value {
            Value::Switch(on) => Some(on),
            _ => None,
        }
    }

    /// The range of a number, where the driver says one.
    pub fn range(&self, name: &str) -> Option<Interval> {
        self.member(name)?.range.filter(|range| range.low < range.high)
    }
}

/// Event that a server sent.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A vector is there (again).
    Defined(Place),
    /// A vector has changed.
    Changed(Place, State),
    /// A BLOB has come.
    Blob(Place, Blob),
    /// A BLOB has come that is not what the server said that it is; how.
    Damaged(Place, String),
    /// A vector is no more.
    Deleted(Place),
    /// The whole device is no more: its driver has ended.
    Lost(String),
    /// A message to people.
    Message {
        /// The device, or nothing for the server.
        device: Option<String>,
        /// The text.
        text: String,
    },
    /// The server asks whether we live; its identifier is to be sent back.
    Ping(String),
    /// Something that is of no use here, or that made no sense; what.
    Ignored(String),
}

/// The device and the name of a vector.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The device.
    pub device: String,
    /// The vector.
    pub name: String,
}

/// A BLOB.
#[derive(Debug, Clone, PartialEq)]
pub struct Blob {
    /// Format of the BLOB (`.fits`).
    pub format: String,
    /// Size of the BLOB when unpacked, bytes, as the server says.
    pub size: Option<u64>,
    /// Bytes of the BLOB; as many as the server said that there are.
    pub bytes: Vec<u8>,
}

/// All vectors that are defined.
#[derive(Debug, Default)]
pub struct Properties {
    vectors: BTreeMap<Place, Vector>,
    weight: usize,
}

/// The most that definitions may take, bytes.
const MOST_WEIGHT: usize = 64 << 20;

impl Properties {
    /// The vector of a device.
    pub fn get(&self, device: &str, name: &str) -> Option<&Vector> {
        self.vectors.get(&Place { device: device.to_owned(), name: name.to_owned() })
    }

    /// The names of all vectors, by device.
    pub fn places(&self) -> impl Iterator<Item = &Place> {
        self.vectors.keys()
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes in what the server sent and says what it was.
    pub fn apply(&mut self, element: Element) -> Event {
        let tag = element.tag.clone();
        if let Some(kind) = Kind::of(&tag, "def") {
            return self.define(kind, &element);
        }
        if let Some(kind) = Kind::of(&tag, "set") {
            return match kind {
                Kind::Blob => self.blob(element),
                kind => self.change(kind, &element),
            };
        }
        let attribute = |name| element.attribute(name).map(str::to_owned);
        match (tag.as_str(), attribute("device")) {
            ("delProperty", Some(device)) => match attribute("name") {
                Some(name) => {
                    let place = Place { device, name };
                    self.remove(&place);
                    Event::Deleted(place)
                }
                None => {
                    let gone = self.vectors.keys().filter(|place| place.device == device);
                    for place in gone.cloned().collect::<Vec<_>>() {
                        self.remove(&place);
                    }
                    Event::Lost(device)
                }
            },
            ("message", device) => {
                Event::Message { device, text: attribute("message").unwrap_or_default() }
            }
            ("pingRequest", _) => Event::Ping(attribute("uid").unwrap_or_default()),
            (tag, _) => Event::Ignored(format!("<{tag}>")),
        }
    }

    fn remove(&mut self, place: &Place) {
        if let Some(vector) = self.vectors.remove(place) {
            self.weight -= vector.weight;
        }
    }

    fn define(&mut self, kind: Kind, element: &Element) -> Event {
        let Some(place) = place(element) else { return nameless(element) };
        self.remove(&place);
        let weight = weight(element);
        if self.weight + weight > MOST_WEIGHT {
            return Event::Ignored(format!(
                "{place}: definitions of more than {MOST_WEIGHT} bytes"
            ));
        }
        let members: Option<Vec<Member>> =
            element.children.iter().map(|child| member(kind, child)).collect();
        let state = element.attribute("state").and_then(State::parse);
        let (Some(members), Some(state)) = (members, state) else {
            return Event::Ignored(format!("{place}: a definition that makes no sense"));
        };
        let writable = kind != Kind::Light && element.attribute("perm") != Some("ro");
        self.weight += weight;
        self.vectors.insert(place.clone(), Vector { kind, state, writable, members, weight });
        Event::Defined(place)
    }

    fn change(&mut self, kind: Kind, element: &Element) -> Event {
        let Some(place) = place(element) else { return nameless(element) };
        let Some(vector) = self.vectors.get_mut(&place).filter(|vector| vector.kind == kind) else {
            return Event::Ignored(format!("{place}: a change of what is not defined"));
        };
        if merge(vector, element).is_some() {
            return Event::Changed(place, vector.state);
        }
        // What it was is not what it is, and what it is makes no sense.
        self.remove(&place);
        Event::Ignored(format!("{place}: a change that makes no sense; it is unknown from now on"))
    }

    fn blob(&mut self, mut element: Element) -> Event {
        let Some(place) = place(&element) else { return nameless(&element) };
        if let (Some(vector), Some(state)) =
            (self.vectors.get_mut(&place), element.attribute("state").and_then(State::parse))
        {
            vector.state = state;
        }
        let mut blobs = element.children.iter_mut().filter_map(|child| {
            let bytes = child.blob.take()?;
            Some((child, bytes))
        });
        let Some((child, bytes)) = blobs.next() else {
            return Event::Damaged(place, "no BLOB in its message".into());
        };
        let number = |name| child.attribute(name).and_then(|text| text.trim().parse::<u64>().ok());
        let (size, length) = (number("size"), number("len"));
        let format = child.attribute("format").unwrap_or_default().trim().to_owned();
        // `len` counts the bytes that are sent, `size` those that they unpack to; old servers only say `size`. What 1.9.9
        // says of a small `.fits.fz` is not true of it.
        let expected = match format.rsplit('.').next() {
            Some("fz") => None,
            Some("z") => length,
            _ => length.or(size),
        };
        match expected {
            Some(expected) if expected != bytes.len() as u64 => {
                let found = bytes.len();
                Event::Damaged(place, format!("a BLOB of {found} bytes, said to be {expected}"))
            }
            _ => Event::Blob(place, Blob { format, size, bytes }),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.device, self.name)
    }
}

fn place(element: &Element) -> Option<Place> {
    let attribute = |name| element.attribute(name).map(str::to_owned);
    Some(Place { device: attribute("device")?, name: attribute("name")? })
}

fn nameless(element: &Element) -> Event {
    Event::Ignored(format!("<{}> without a device or a name", element.tag))
}

fn weight(element: &Element) -> usize {
    let attributes = element.attributes.iter().map(|(name, value)| name.len() + value.len() + 48);
    let children = element.children.iter().map(weight);
    128 + element.text.len() + attributes.sum::<usize>() + children.sum::<usize>()
}

/// A member as it is defined.
fn member(kind: Kind, element: &Element) -> Option<Member> {
    if element.tag.strip_prefix("def") != Some(kind.name()) {
        return None;
    }
    let name = element.attribute("name")?.to_owned();
    let value = value(kind, element)?;
    Some(Member { name, value, range: range(element) })
}

fn value(kind: Kind, element: &Element) -> Option<Value> {
    let text = element.text.as_str();
    Some(match kind {
        Kind::Text => Value::Text(text.to_owned()),
        Kind::Number => Value::Number(number(text)?),
        Kind::Switch => Value::Switch(match text {
            "On" => true,
            "Off" => false,
            _ => return None,
        }),
        Kind::Light => Value::Light(State::parse(text)?),
        Kind::Blob => Value::Blob,
    })
}

fn range(element: &Element) -> Option<Interval> {
    let bound = |name| element.attribute(name).and_then(number).filter(|n| n.is_finite());
    Some(Interval::new(bound("min")?, bound("max")?))
}

/// Takes a change over, all of it or nothing.
fn merge(vector: &mut Vector, element: &Element) -> Option<()> {
    let state = match element.attribute("state") {
        Some(state) => State::parse(state)?,
        None => vector.state,
    };
    let mut members = vector.members.clone();
    for child in &element.children {
        if child.tag.strip_prefix("one") != Some(vector.kind.name()) {
            return None;
        }
        let name = child.attribute("name")?;
        let member = members.iter_mut().find(|member| member.name == name)?;
        member.value = value(vector.kind, child)?;
        member.range = range(child).or(member.range);
    }
    vector.members = members;
    vector.state = state;
    Some(())
}

/// A number: decimal, or sexagesimal (`-10:30:18.5`, with colons, semicolons or blanks).
pub fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    if let Ok(number) = text.parse::<f64>() {
        return Some(number);
    }
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let mut sum = 0.0;
    let mut unit = 1.0;
    let mut parts = 0;
    for part in digits.split([':', ';', ' ']).filter(|part| !part.is_empty()) {
        let plain = part.bytes().all(|b| b.is_ascii_digit() || b == b'.');
        sum += part.parse::<f64>().ok().filter(|_| plain)? / unit;
        unit *= 60.0;
        parts += 1;
    }
    let sum = if negative { -sum } else { sum };
    (2..=3).contains(&parts).then_some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the INDI 1.7 white paper's number formats; arithmetic.
    #[test]
    fn numbers_as_indi_writes_them() {
        for (text, value) in [
            ("5.2000000000000001776", 5.2),
            ("-10:30:18", -10.505),
            ("10:30", 10.5),
            ("-0:30", -0.5),
            ("12 30 36", 12.51),
            ("1e-3", 0.001),
            ("+7", 7.0),
        ] {
            let read = number(text).unwrap();
            assert!((read - value).abs() < 1e-12, "{text}: {read}");
        }
        assert!(number("-nan").or(number("nan")).unwrap().is_nan());
        for text in ["", "1,5", "ten", "1:2:3:4", "1:-2", ":", "0x10", "1:2e1"] {
            assert_eq!(number(text), None, "{text}");
        }
    }
}
