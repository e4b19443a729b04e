//! Text to events. Every error says the line, what stands there, and what should.

use super::{Event, Fault, Header, LONGEST_FILE, LONGEST_PAUSE_US, MOST_DATA, Recording};
use crate::transport::Transfer;
use std::path::Path;
use std::time::Duration;
use sunglint_formats::{ParseError, nearest_names};

/// Fault in a line: field, found, expected.
type Wrong = (&'static str, String, String);

fn wrong(field: &'static str, found: &str, expected: impl Into<String>) -> Wrong {
    const MOST: usize = 40;
    let mut short: String = found.chars().take(MOST).flat_map(char::escape_debug).collect();
    if found.chars().nth(MOST).is_some() {
        short.push('…');
    }
    (field, format!("`{short}`"), expected.into())
}

const KEYS: [&str; 5] = ["device", "source", "host", "recorded", "synthetic"];

pub(super) fn recording(path: &Path, text: &str) -> Result<Recording, ParseError> {
    if text.len() > LONGEST_FILE {
        let found = format!("{} bytes", text.len());
        return Err(ParseError::new(path, found, format!("at most {LONGEST_FILE} bytes")));
    }
    let mut values: [Option<String>; KEYS.len()] = Default::default();
    let mut events: Vec<(u64, Event)> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let fail = |(field, found, expected): Wrong| {
            ParseError::new(path, found, expected).at_line(number).in_field(field)
        };
        let line = line.trim();
        if line.is_empty() || line.starts_with(';') {
            continue;
        }
        if let Some(rest) = line.strip_prefix('#') {
            if !events.is_empty() {
                let expected = "the header before the first event (a remark begins with `;`)";
                return Err(fail(wrong("header", line, expected)));
            }
            header_line(rest, &mut values).map_err(|(wrong, hint)| {
                let error = fail(wrong);
                hint.into_iter().fold(error, ParseError::with_hint)
            })?;
            continue;
        }
        let event = event(line).map_err(fail)?;
        if let Some((_, Event::Fault(Fault::Disconnect))) = events.last() {
            return Err(fail(wrong("event", line, "nothing after `! disconnect`")));
        }
        events.push((number, event));
    }
    let [device, source, host, recorded, synthetic] = values;
    let missing = |key: &str| {
        let expected = format!("a line `# {key}=…`");
        ParseError::new(path, "no such line in the header", expected).in_field(key)
    };
    let header = Header {
        device: device.ok_or_else(|| missing("device"))?,
        source: source.ok_or_else(|| missing("source"))?,
        host,
        recorded,
        synthetic: synthetic.ok_or_else(|| missing("synthetic"))? == "yes",
    };
    Ok(Recording { path: path.to_path_buf(), header, events })
}

fn header_line(
    rest: &str,
    values: &mut [Option<String>; KEYS.len()],
) -> Result<(), (Wrong, Option<String>)> {
    let plain = |wrong| (wrong, None);
    let (key, value) =
        rest.split_once('=').ok_or_else(|| plain(wrong("header", rest, "`# key=value`")))?;
    let (key, value) = (key.trim(), value.trim());
    let index = KEYS.iter().position(|known| *known == key).ok_or_else(|| {
        let near = nearest_names(key, KEYS, 1);
        let hint = near.first().map(|name| format!("did you mean `{name}`?"));
        (wrong("header", key, format!("one of {}", KEYS.join(", "))), hint)
    })?;
    if value.is_empty() || value.chars().any(char::is_control) {
        return Err(plain(wrong(KEYS[index], value, "a text")));
    }
    if key == "synthetic" && value != "yes" && value != "no" {
        return Err(plain(wrong("synthetic", value, "yes or no")));
    }
    if values[index].is_some() {
        return Err(plain(wrong(KEYS[index], value, "this key once")));
    }
    values[index] = Some(value.to_owned());
    Ok(())
}

fn event(line: &str) -> Result<Event, Wrong> {
    // What stands behind a semicolon is for the reader.
    let line = line.split(';').next().unwrap_or_default().trim();
    let mut characters = line.chars();
    let mark = characters.next();
    let rest = characters.as_str().trim();
    match mark {
        Some('>') => match rest.strip_prefix('[') {
            Some(request) => {
                let (request, bytes) =
                    request.split_once(']').ok_or_else(|| wrong("request", rest, "a `]`"))?;
                asked(request, data(bytes)?)
            }
            None => match data(rest)? {
                bytes if bytes.is_empty() => Err(wrong("data", rest, "at least one byte")),
                bytes => Ok(Event::Sent(bytes)),
            },
        },
        Some('<') => Ok(Event::Received(data(rest)?)),
        Some('~') => Ok(Event::Pause(pause(rest)?)),
        Some('!') => [Fault::Timeout, Fault::Disconnect, Fault::Stall]
            .into_iter()
            .find(|fault| fault.name() == rest)
            .map(Event::Fault)
            .ok_or_else(|| wrong("fault", rest, "timeout, disconnect or stall")),
        _ => Err(wrong("event", line, "a line that begins with > < ~ ! ; or #")),
    }
}

fn data(text: &str) -> Result<Vec<u8>, Wrong> {
    // Two digits and a space: a line cannot hold more than this.
    let mut bytes = Vec::with_capacity(text.len() / 3 + 1);
    for token in text.split_ascii_whitespace() {
        let digits = token.len() == 2 && token.bytes().all(|byte| byte.is_ascii_hexdigit());
        match u8::from_str_radix(token, 16) {
            Ok(byte) if digits => bytes.push(byte),
            _ => return Err(wrong("data", token, "two hexadecimal digits for each byte")),
        }
    }
    if bytes.len() > MOST_DATA {
        let found = format!("{} bytes", bytes.len());
        return Err(("data", found, format!("at most {MOST_DATA} bytes in a line")));
    }
    Ok(bytes)
}

fn pause(text: &str) -> Result<Duration, Wrong> {
    let fail = || wrong("pause", text, "milliseconds, with at most three decimals, at most a day");
    let (whole, part) = text.split_once('.').unwrap_or((text, "0"));
    let is_number = |digits: &str, most| {
        (1..=most).contains(&digits.len()) && digits.bytes().all(|byte| byte.is_ascii_digit())
    };
    if !is_number(whole, 8) || !is_number(part, 3) {
        return Err(fail());
    }
    let number = |digits: &str| digits.parse::<u64>().map_err(|_| fail());
    let us = number(whole)? * 1000 + number(&format!("{part:0<3}"))?;
    if us > LONGEST_PAUSE_US { Err(fail()) } else { Ok(Duration::from_micros(us)) }
}

/// The `key=value` pairs of a request, taken in their order.
struct Fields<'a>(std::str::SplitAsciiWhitespace<'a>);

impl<'a> Fields<'a> {
    fn take(&mut self, key: &'static str) -> Result<&'a str, Wrong> {
        let field = self.0.next().unwrap_or_default();
        match field.split_once('=') {
            Some((found, value)) if found == key => Ok(value),
            _ => Err(wrong("request", field, format!("{key}=…"))),
        }
    }

    fn hex(&mut self, key: &'static str, digits: usize) -> Result<u16, Wrong> {
        let value = self.take(key)?;
        let good = value.len() == digits && value.bytes().all(|byte| byte.is_ascii_hexdigit());
        match u16::from_str_radix(value, 16) {
            Ok(number) if good => Ok(number),
            _ => Err(wrong(key, value, format!("{digits} hexadecimal digits"))),
        }
    }

    fn byte(&mut self, key: &'static str) -> Result<u8, Wrong> {
        // Two digits fit.
        Ok(self.hex(key, 2)? as u8)
    }

    fn length(&mut self, most: usize) -> Result<usize, Wrong> {
        let value = self.take("length")?;
        match value.parse::<usize>() {
            Ok(number) if number <= most && !value.starts_with('+') => Ok(number),
            _ => Err(wrong("length", value, format!("a number of at most {most}"))),
        }
    }
}

fn asked(request: &str, data: Vec<u8>) -> Result<Event, Wrong> {
    let mut words = request.split_ascii_whitespace();
    let kind = words.next().unwrap_or_default();
    let mut fields = Fields(words);
    let carried = data.len();
    let transfer = match kind {
        "control-in" => Transfer::ControlIn {
            request_type: fields.byte("type")?,
            request: fields.byte("request")?,
            value: fields.hex("value", 4)?,
            index: fields.hex("index", 4)?,
            // At most 65,535 by the line above it in the same expression.
            length: fields.length(usize::from(u16::MAX))? as u16,
        },
        "control-out" => Transfer::ControlOut {
            request_type: fields.byte("type")?,
            request: fields.byte("request")?,
            value: fields.hex("value", 4)?,
            index: fields.hex("index", 4)?,
            data,
        },
        "bulk-in" => Transfer::BulkIn {
            endpoint: fields.byte("endpoint")?,
            length: fields.length(MOST_DATA)?,
        },
        "bulk-out" => Transfer::BulkOut { endpoint: fields.byte("endpoint")?, data },
        "clear-halt" => Transfer::ClearHalt { endpoint: fields.byte("endpoint")? },
        "report-in" => Transfer::ReportIn { length: fields.length(MOST_DATA)? },
        "report-out" => Transfer::ReportOut { data },
        "feature-get" => Transfer::FeatureGet {
            report: fields.byte("report")?,
            length: fields.length(MOST_DATA)?,
        },
        "feature-set" => Transfer::FeatureSet { data },
        other => {
            let expected = "control-in, control-out, bulk-in, bulk-out, clear-halt, report-in, report-out, feature-get or feature-set";
            return Err(wrong("request", other, expected));
        }
    };
    if let Some(more) = fields.0.next() {
        return Err(wrong("request", more, "no more fields"));
    }
    if transfer.data().is_none() && carried > 0 {
        return Err(wrong("data", &format!("{carried} bytes"), "none: this request carries none"));
    }
    Ok(Event::Asked(transfer))
}
