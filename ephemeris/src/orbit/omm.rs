//! Orbit mean-elements messages (OMM, CCSDS 502.0-B-3) in JSON, CSV, XML and KVN.
//!
//! Each form is read into one list of keys and decimal texts, and these become numbers in one place: the same digits give the same
//! bits whatever the form. JSON is what CelesTrak and Space-Track give out (numbers or strings, one object or a list of them); CSV
//! is theirs too; XML is `omm` alone or in an `ndm`; KVN may hold one message after the other. Unknown keys are passed over, as
//! Space-Track's own, and a message that SGP4 cannot take (another centre, frame, time system or theory) is refused.

use super::tle::{Tle, catalogue_number, excerpt};
use chrono::{NaiveDate, NaiveDateTime, NaiveTime};
use hifitime::Epoch;
use roxmltree::{Document, Node, ParsingOptions};
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;
use std::borrow::Cow;
use std::fmt;
use std::path::Path;
use sunglint_formats::time::{Scale, format_utc_shortest, parse_in};
use sunglint_formats::{ParseError, nearest_names};

/// Nodes of an XML document at most.
const MOST_NODES: u32 = 50_000_000;
/// Longest value that makes sense, bytes.
const LONGEST: usize = 200;
/// Largest number that the catalogue's nine digits hold.
const LARGEST_NUMBER: u32 = 999_999_999;

/// One key of a message with its text and unit, and the byte at which it stands.
struct Entry<'a> {
    key: Cow<'a, str>,
    value: Cow<'a, str>,
    unit: Option<&'a str>,
    byte: usize,
}

/// One message as text.
struct Message<'a> {
    entries: Vec<Entry<'a>>,
    byte: usize,
}

/// The text that messages come from.
#[derive(Clone, Copy)]
struct Source<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Source<'_> {
    fn error(self, byte: usize, found: impl Into<String>, expected: &str) -> ParseError {
        let before = &self.text.as_bytes()[..byte.min(self.text.len())];
        let line = 1 + before.iter().filter(|&&b| b == b'\n').count() as u64;
        ParseError::new(self.path, found, expected).at_line(line)
    }
}

/// Result for one set of elements: the set, or why it is none.
type Sets = Vec<Result<Tle, ParseError>>;

/// Returns the sets of JSON.
pub(super) fn json(path: &Path, text: &str) -> Result<Sets, ParseError> {
    let source = Source { path, text };
    let objects: Objects<'_> = serde_json::from_str(text).map_err(|error| {
        let line = error.line() as u64;
        let mut why = error.to_string();
        // The place stands before the message already.
        why.truncate(why.find(" at line").unwrap_or(why.len()));
        ParseError::new(path, why, "OMM in JSON: an object of keys, or a list of such")
            .at_line(line)
    })?;
    Ok(objects.0.into_iter().map(|pairs| of_pairs(source, pairs)).collect())
}

/// The keys and raw values of one object.
struct Pairs<'a>(Vec<(Cow<'a, str>, &'a RawValue)>);

impl<'de> Deserialize<'de> for Pairs<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OfMap;
        impl<'de> Visitor<'de> for OfMap {
            type Value = Pairs<'de>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of keys such as MEAN_MOTION")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut pairs = Vec::new();
                while let Some((key, value)) = map.next_entry::<Key<'de>, &'de RawValue>()? {
                    pairs.push((key.0, value));
                }
                Ok(Pairs(pairs))
            }
        }
        deserializer.deserialize_map(OfMap)
    }
}

struct Key<'a>(Cow<'a, str>);

impl<'de> Deserialize<'de> for Key<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OfText;
        impl<'de> Visitor<'de> for OfText {
            type Value = Key<'de>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a key")
            }
            fn visit_borrowed_str<E>(self, text: &'de str) -> Result<Self::Value, E> {
                Ok(Key(Cow::Borrowed(text)))
            }
            fn visit_str<E>(self, text: &str) -> Result<Self::Value, E> {
                Ok(Key(Cow::Owned(text.to_owned())))
            }
        }
        deserializer.deserialize_str(OfText)
    }
}

/// One object, or a list of them.
struct Objects<'a>(Vec<Pairs<'a>>);

impl<'de> Deserialize<'de> for Objects<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OfEither;
        impl<'de> Visitor<'de> for OfEither {
            type Value = Objects<'de>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of keys such as MEAN_MOTION, or a list of such objects")
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                let access = serde::de::value::MapAccessDeserializer::new(map);
                Ok(Objects(vec![Pairs::deserialize(access)?]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let mut all = Vec::new();
                while let Some(one) = list.next_element()? {
                    all.push(one);
                }
                Ok(Objects(all))
            }
        }
        deserializer.deserialize_any(OfEither)
    }
}

fn of_pairs(source: Source<'_>, pairs: Pairs<'_>) -> Result<Tle, ParseError> {
    // A raw value is a piece of the text.
    let start = source.text.as_ptr() as usize;
    let byte_of = |raw: &RawValue| (raw.get().as_ptr() as usize).saturating_sub(start);
    let byte = pairs.0.first().map_or(0, |(_, raw)| byte_of(raw));
    let mut entries = Vec::with_capacity(pairs.0.len());
    for (key, raw) in pairs.0 {
        let (text, byte) = (raw.get(), byte_of(raw));
        let value = match text.as_bytes().first() {
            Some(b'n') => continue,
            Some(b'"') => match serde_json::from_str::<Key<'_>>(text) {
                Ok(text) => text.0,
                Err(error) => {
                    return Err(source.error(byte, error.to_string(), "a text").in_field(key));
                }
            },
            Some(b'{' | b'[' | b't' | b'f') if KEYS.iter().any(|k| *k == key) => {
                let error = source.error(byte, excerpt(text), "a number or a text");
                return Err(error.in_field(key));
            }
            _ => Cow::Borrowed(text),
        };
        entries.push(Entry { key, value, unit: None, byte });
    }
    set(source, &Message { entries, byte })
}

/// Returns the sets of CSV: keys in the first line.
pub(super) fn csv(path: &Path, text: &str) -> Result<Sets, ParseError> {
    let source = Source { path, text };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let of_csv = |error: csv::Error| {
        let byte = error.position().map_or(0, |at| at.byte() as usize);
        source.error(
            byte,
            error.to_string(),
            "OMM in CSV: as many fields as keys in the first line",
        )
    };
    let keys = reader.headers().map_err(of_csv)?.clone();
    for (index, key) in keys.iter().enumerate() {
        if keys.iter().take(index).any(|before| before == key) {
            return Err(source.error(0, "the key twice", "each key once").in_field(key));
        }
    }
    let mut sets = Vec::new();
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                sets.push(Err(of_csv(error)));
                continue;
            }
        };
        let byte = record.position().map_or(0, |at| at.byte() as usize);
        let pairs = keys.iter().zip(record.iter()).filter(|(_, value)| !value.is_empty());
        let entries = pairs
            .map(|(key, value)| Entry { key: key.into(), value: value.into(), unit: None, byte })
            .collect();
        sets.push(set(source, &Message { entries, byte }));
    }
    Ok(sets)
}

/// Returns the sets of XML.
pub(super) fn xml(path: &Path, text: &str) -> Result<Sets, ParseError> {
    let source = Source { path, text };
    let options =
        ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| {
        let line = u64::from(error.pos().row);
        let error =
            ParseError::new(path, error.to_string(), "OMM in well-formed XML").at_line(line);
        let page =
            text.get(..2000.min(text.len())).unwrap_or(text).to_lowercase().contains("<html");
        if page {
            error.with_hint("this is a web page, perhaps an error of the server")
        } else {
            error
        }
    })?;
    let messages = document.descendants().filter(|n| n.tag_name().name() == "omm");
    let sets = messages.map(|message| {
        let byte = message.range().start;
        let mut entries = Vec::new();
        for node in message.descendants().filter(|n| n.is_element() && n != &message) {
            if node.children().any(|child| child.is_element()) {
                continue;
            }
            let value = node.text().unwrap_or_default().trim();
            if !value.is_empty() {
                let key = node.tag_name().name().into();
                let unit = node.attribute("units");
                entries.push(Entry { key, value: value.into(), unit, byte: node.range().start });
            }
        }
        set(source, &Message { entries, byte })
    });
    let sets: Sets = sets.collect();
    if sets.is_empty() {
        let root = Node::tag_name(&document.root_element()).name();
        let error = source.error(0, excerpt(root), "`omm`, or `ndm` with one in it");
        return Err(error.in_field("root element"));
    }
    Ok(sets)
}

/// Returns the sets of KVN: lines `KEY = value`, each message from its `CCSDS_OMM_VERS` on.
pub(super) fn kvn(path: &Path, text: &str) -> Result<Sets, ParseError> {
    let source = Source { path, text };
    let (mut sets, mut message): (Sets, Option<Message<'_>>) = (Vec::new(), None);
    let mut byte = 0;
    for line in text.split_inclusive('\n') {
        let (start, line) = (byte, line.trim());
        byte += text[byte..].find('\n').map_or(text.len() - byte, |n| n + 1);
        let comment =
            line.strip_prefix("COMMENT").is_some_and(|rest| !rest.starts_with(['_', '=']));
        if line.is_empty() || comment || line.starts_with('#') {
            continue;
        }
        let Some((key, value)) = line.split_once('=') else {
            return Err(source.error(start, excerpt(line), "KEY = value"));
        };
        let (key, value) = (key.trim(), value.trim());
        if key == "CCSDS_OMM_VERS"
            && let Some(whole) = message.replace(Message { entries: Vec::new(), byte: start })
        {
            sets.push(set(source, &whole));
        }
        let Some(message) = &mut message else {
            let error = source.error(start, excerpt(key), "CCSDS_OMM_VERS, the first key");
            return Err(error);
        };
        let (value, unit) = match value.strip_suffix(']').and_then(|v| v.rsplit_once('[')) {
            Some((value, unit)) if !key.starts_with("OBJECT") => (value.trim(), Some(unit.trim())),
            _ => (value, None),
        };
        if !value.is_empty() {
            let entry = Entry { key: key.into(), value: value.into(), unit, byte: start };
            message.entries.push(entry);
        }
    }
    sets.extend(message.map(|whole| set(source, &whole)));
    Ok(sets)
}

/// Keys that are read.
const KEYS: [&str; 22] = [
    "CCSDS_OMM_VERS",
    "OBJECT_NAME",
    "OBJECT_ID",
    "CENTER_NAME",
    "REF_FRAME",
    "TIME_SYSTEM",
    "MEAN_ELEMENT_THEORY",
    "EPOCH",
    "MEAN_MOTION",
    "ECCENTRICITY",
    "INCLINATION",
    "RA_OF_ASC_NODE",
    "ARG_OF_PERICENTER",
    "MEAN_ANOMALY",
    "EPHEMERIS_TYPE",
    "CLASSIFICATION_TYPE",
    "NORAD_CAT_ID",
    "ELEMENT_SET_NO",
    "REV_AT_EPOCH",
    "BSTAR",
    "MEAN_MOTION_DOT",
    "MEAN_MOTION_DDOT",
];

/// Units that a key may have, in lower case.
fn units(key: &str) -> &'static [&'static str] {
    match key {
        "MEAN_MOTION" => &["rev/day", "rev/d"],
        "INCLINATION" | "RA_OF_ASC_NODE" | "ARG_OF_PERICENTER" | "MEAN_ANOMALY" => &["deg"],
        "BSTAR" => &["1/er", "1/[earth radii]", "er**-1"],
        "MEAN_MOTION_DOT" => &["rev/day**2", "rev/day^2", "rev/d**2"],
        "MEAN_MOTION_DDOT" => &["rev/day**3", "rev/day^3", "rev/d**3"],
        _ => &[],
    }
}

impl<'a> Message<'a> {
    fn find(&self, source: Source<'_>, key: &str) -> Result<Option<&Entry<'a>>, ParseError> {
        let mut found = self.entries.iter().filter(|e| e.key == key);
        let first = found.next();
        if let Some(second) = found.next() {
            return Err(source.error(second.byte, "the key twice", "each key once").in_field(key));
        }
        let Some(entry) = first else { return Ok(None) };
        if entry.value.len() > LONGEST {
            let error = source.error(entry.byte, excerpt(&entry.value), "a shorter value");
            return Err(error.in_field(key));
        }
        if let Some(unit) = entry.unit
            && let known = units(key)
            && !known.is_empty()
            && !known.contains(&unit.to_lowercase().as_str())
        {
            let error = source.error(entry.byte, format!("the unit {}", excerpt(unit)), known[0]);
            return Err(error.in_field(key));
        }
        Ok(Some(entry))
    }

    fn required(&self, source: Source<'_>, key: &str) -> Result<&Entry<'a>, ParseError> {
        self.find(source, key)?.ok_or_else(|| {
            let error = source.error(self.byte, "no such key", "a value").in_field(key);
            let unknown = self.entries.iter().map(|e| e.key.as_ref());
            let unknown = unknown.filter(|k| !KEYS.contains(k));
            match nearest_names(key, unknown, 1).first() {
                Some(near) => error.with_hint(format!("is it `{near}`?")),
                None => error,
            }
        })
    }

    /// A key that, where it stands, must have one of some values.
    fn must_be(&self, source: Source<'_>, key: &str, good: &[&str]) -> Result<(), ParseError> {
        match self.find(source, key)? {
            Some(entry) if !good.iter().any(|g| g.eq_ignore_ascii_case(&entry.value)) => {
                let error = source.error(entry.byte, excerpt(&entry.value), good[0]);
                Err(error.in_field(key).with_hint("SGP4 takes no other elements"))
            }
            _ => Ok(()),
        }
    }

    fn integer(&self, source: Source<'_>, key: &str) -> Result<u64, ParseError> {
        let Some(entry) = self.find(source, key)? else { return Ok(0) };
        let digits = entry.value.trim_start_matches('+');
        digits.parse().map_err(|_| {
            source.error(entry.byte, excerpt(&entry.value), "a whole number").in_field(key)
        })
    }
}

/// A number with what it must be.
fn number(
    source: Source<'_>,
    entry: &Entry<'_>,
    expected: &str,
    good: impl Fn(f64) -> bool,
) -> Result<f64, ParseError> {
    let text = entry.value.as_ref();
    let plain = text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
    let value = text.parse::<f64>().ok().filter(|v| plain && v.is_finite() && good(*v));
    value.ok_or_else(|| {
        source.error(entry.byte, excerpt(text), expected).in_field(entry.key.as_ref())
    })
}

/// A set of elements from a message: the one place where texts become numbers.
fn set(source: Source<'_>, message: &Message<'_>) -> Result<Tle, ParseError> {
    message.must_be(source, "CENTER_NAME", &["EARTH"])?;
    message.must_be(source, "REF_FRAME", &["TEME", "TEMEOFDATE"])?;
    message.must_be(source, "TIME_SYSTEM", &["UTC"])?;
    message.must_be(source, "MEAN_ELEMENT_THEORY", &["SGP4", "SGP/SGP4", "SGP4/SDP4", "TLE"])?;
    message.must_be(source, "EPHEMERIS_TYPE", &["0", "2", "3", "SGP4"])?;
    let of = |key, expected, good: &dyn Fn(f64) -> bool| {
        number(source, message.required(source, key)?, expected, good)
    };
    let optional = |key| match message.find(source, key)? {
        Some(entry) => number(source, entry, "a finite number", |_| true),
        None => Ok(0.0),
    };
    let angle = |key| of(key, "an angle from -360 to 360 degrees", &|v: f64| v.abs() <= 360.0);
    let (epoch, datetime) = epoch(source, message.required(source, "EPOCH")?)?;
    let mean_motion = of("MEAN_MOTION", "more than 0 and at most 20 revolutions a day", &|v| {
        v > 0.0 && v <= 20.0
    })?;
    let eccentricity = of("ECCENTRICITY", "0 to less than 1", &|v| (0.0..1.0).contains(&v))?;
    let inclination = of("INCLINATION", "0 to 180 degrees", &|v| (0.0..=180.0).contains(&v))?;
    let right_ascension = angle("RA_OF_ASC_NODE")?;
    let argument_of_perigee = angle("ARG_OF_PERICENTER")?;
    let mean_anomaly = angle("MEAN_ANOMALY")?;
    let drag_term = of("BSTAR", "a finite number", &|_| true)?;
    let mean_motion_dot = optional("MEAN_MOTION_DOT")?;
    let mean_motion_ddot = optional("MEAN_MOTION_DDOT")?;
    let numbered = message.required(source, "NORAD_CAT_ID")?;
    let norad_id = catalogue_id(&numbered.value).ok_or_else(|| {
        let expected = "a catalogue number of one to nine digits, or alpha-5";
        source.error(numbered.byte, excerpt(&numbered.value), expected).in_field("NORAD_CAT_ID")
    })?;
    let text = |key| -> Result<Option<String>, ParseError> {
        let found = message.find(source, key)?.map(|e| e.value.trim().to_owned());
        Ok(found.filter(|t| !t.is_empty() && !t.eq_ignore_ascii_case("UNKNOWN")))
    };
    let (name, designator) = (text("OBJECT_NAME")?, text("OBJECT_ID")?);
    let elements = sgp4::Elements {
        object_name: name.clone(),
        international_designator: designator.clone(),
        norad_id: u64::from(norad_id),
        classification: sgp4::Classification::Unclassified,
        datetime,
        mean_motion_dot,
        mean_motion_ddot,
        drag_term,
        element_set_number: message.integer(source, "ELEMENT_SET_NO")?,
        inclination,
        right_ascension,
        eccentricity,
        argument_of_perigee,
        mean_anomaly,
        mean_motion,
        revolution_number: message.integer(source, "REV_AT_EPOCH")?,
        ephemeris_type: 0,
    };
    let kvn = written(&elements, epoch);
    Ok(Tle {
        name,
        norad_id,
        international_designator: designator,
        epoch,
        inclination_deg: inclination,
        eccentricity,
        mean_motion_rev_day: mean_motion,
        bstar: drag_term,
        line1: String::new(),
        line2: String::new(),
        omm: Some(kvn.into()),
        elements,
    })
}

/// Number of one to nine digits, alpha-5 included.
fn catalogue_id(text: &str) -> Option<u32> {
    if !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit()) {
        return text.parse().ok().filter(|n| *n <= LARGEST_NUMBER);
    }
    catalogue_number(text)
}

/// The epoch twice: in TAI, and on the calendar as SGP4 takes it for the sidereal time.
fn epoch(source: Source<'_>, entry: &Entry<'_>) -> Result<(Epoch, NaiveDateTime), ParseError> {
    let wrong = |error: ParseError| error.in_field("EPOCH");
    let epoch = parse_in(&entry.value, Scale::Utc).map_err(|error| {
        let at = source.error(entry.byte, error.found, error.expected);
        wrong(match error.hint {
            Some(hint) => at.with_hint(hint),
            None => at,
        })
    })?;
    let shown = format_utc_shortest(epoch);
    let datetime = || {
        let (date, time) = shown.strip_suffix('Z')?.split_once('T')?;
        let date: NaiveDate = date.parse().ok()?;
        let (clock, fraction) = time.split_once('.').unwrap_or((time, ""));
        let mut parts = clock.split(':').map(|p| p.parse::<u32>().ok());
        let (hour, minute, second) = (parts.next()??, parts.next()??, parts.next()??);
        let nanos = format!("{fraction:0<9}").parse::<u32>().ok()?;
        // SGP4's own date has no second 60: the last nanosecond before it, 15e-3 arcsec of sidereal time at most.
        let (second, nanos) = if second > 59 { (59, 999_999_999) } else { (second, nanos) };
        Some(date.and_time(NaiveTime::from_hms_nano_opt(hour, minute, second, nanos)?))
    };
    let datetime = datetime()
        .ok_or_else(|| wrong(source.error(entry.byte, excerpt(&entry.value), "a UTC time")))?;
    Ok((epoch, datetime))
}

/// A message in KVN: the shortest digits that give the same numbers.
pub(super) fn written(elements: &sgp4::Elements, epoch: Epoch) -> String {
    let one_line = |text: &Option<String>| {
        let text = text.as_deref().unwrap_or("UNKNOWN");
        text.chars().filter(|c| !c.is_control()).collect::<String>()
    };
    let time = format_utc_shortest(epoch);
    let e = elements;
    format!(
        "CCSDS_OMM_VERS = 3.0\nCREATION_DATE = {time}\nORIGINATOR = SUNGLINT\nOBJECT_NAME = {}\nOBJECT_ID = {}\nCENTER_NAME = EARTH\n\
         REF_FRAME = TEME\nTIME_SYSTEM = UTC\nMEAN_ELEMENT_THEORY = SGP4\nEPOCH = {}\nMEAN_MOTION = {}\nECCENTRICITY = {}\n\
         INCLINATION = {}\nRA_OF_ASC_NODE = {}\nARG_OF_PERICENTER = {}\nMEAN_ANOMALY = {}\nEPHEMERIS_TYPE = 0\nCLASSIFICATION_TYPE = U\n\
         NORAD_CAT_ID = {}\nELEMENT_SET_NO = {}\nREV_AT_EPOCH = {}\nBSTAR = {}\nMEAN_MOTION_DOT = {}\nMEAN_MOTION_DDOT = {}\n",
        one_line(&e.object_name),
        one_line(&e.international_designator),
        time.trim_end_matches('Z'),
        e.mean_motion,
        e.eccentricity,
        e.inclination,
        e.right_ascension,
        e.argument_of_perigee,
        e.mean_anomaly,
        e.norad_id,
        e.element_set_number,
        e.revolution_number,
        e.drag_term,
        e.mean_motion_dot,
        e.mean_motion_ddot,
    )
}
