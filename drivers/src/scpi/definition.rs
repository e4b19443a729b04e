//! The file that describes a device: its keys, and what they are checked for.

use super::names::kept;
use super::pattern::Pattern;
use super::reply::number_at_start;
use super::response::Response;
use glam::DVec2;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;
use sunglint_formats::toml::{Document, Finite, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError};

/// Most settings, names of values, and lines of a list in one file.
const MOST: usize = 64;
/// Longest line to a device, bytes; the input buffers of old instruments hold little more.
const LONGEST_LINE: usize = 200;
/// Magnitude from which on SCPI's numbers mean too much.
const OVERFLOW: f64 = 9.9e37;

/// How long an answer may take where the file does not say, ms.
const TIMEOUT_MS: f64 = 3000.0;

/// Kind of the device that a file describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceKind {
    /// A [`Meter`](crate::device::Meter).
    Meter,
    /// A [`Source`](crate::device::Source).
    Source,
    /// A [`PowerMeter`](crate::device::PowerMeter).
    PowerMeter,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    kind: DeviceKind,
    name: String,
    unit: Option<String>,
    #[serde(default)]
    line: LineKeys,
    #[serde(default)]
    identify: IdentifyKeys,
    #[serde(default)]
    errors: ErrorKeys,
    #[serde(default)]
    open: ListKeys,
    read: Option<ReadKeys>,
    #[serde(default)]
    settings: BTreeMap<String, SettingKeys>,
    gain: Option<GainKeys>,
    response: Option<ResponseKeys>,
    zero: Option<ListKeys>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum End {
    #[default]
    Lf,
    CrLf,
    Cr,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ReplyEnd {
    #[default]
    Lf,
    Cr,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct LineKeys {
    end: End,
    reply_end: ReplyEnd,
    timeout_ms: Option<Positive>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct IdentifyKeys {
    send: String,
    expect: String,
}

impl Default for IdentifyKeys {
    fn default() -> Self {
        let expect = "{vendor},{model},{serial},{firmware}".to_owned();
        Self { send: "*IDN?".to_owned(), expect }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ErrorKeys {
    send: String,
}

impl Default for ErrorKeys {
    fn default() -> Self {
        Self { send: "SYST:ERR?".to_owned() }
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ListKeys {
    send: Vec<String>,
    settle_ms: Option<NonNegative>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum FreshWord {
    Trigger,
    Poll,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReadKeys {
    #[serde(default)]
    first: Vec<String>,
    send: String,
    #[serde(default = "value_alone")]
    expect: String,
    again: Option<String>,
    agree: Option<Positive>,
    agree_abs: Option<Positive>,
    unit: Option<String>,
    scale: Option<Finite>,
    overflow: Option<Positive>,
    overflow_word: Option<String>,
    settle_ms: Option<NonNegative>,
    fresh: FreshWord,
    period_ms: Option<Positive>,
    measure_ms: Option<Positive>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SettingKeys {
    send: String,
    ask: Option<String>,
    #[serde(default = "value_alone")]
    expect: String,
    unit: Option<String>,
    scale: Option<Finite>,
    least: Option<Finite>,
    most: Option<Finite>,
    resolution: Option<Positive>,
    names: Option<BTreeMap<String, String>>,
    auto: Option<AutoKeys>,
    settle_ms: Option<NonNegative>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AutoKeys {
    send: String,
    ask: String,
    on: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GainKeys {
    v_per_a: BTreeMap<String, Positive>,
    is: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ResponseKeys {
    file: Option<String>,
    a_per_w: Option<Vec<DVec2>>,
    wavelength_nm: Option<Positive>,
}

fn value_alone() -> String {
    "{value}".to_owned()
}

fn ms(time: Option<NonNegative>) -> Duration {
    let ms = time.map_or(0.0, NonNegative::get);
    Duration::try_from_secs_f64(ms / 1000.0).unwrap_or(Duration::MAX)
}

/// How a reading is known to be a new one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fresh {
    /// The question starts a measurement.
    Trigger,
    /// The device measures by itself and tells its last value: so long is waited from the question on.
    Poll { wait: Duration },
}

/// How a device is read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Read {
    pub first: Vec<String>,
    pub send: String,
    pub expect: Pattern,
    pub again: Option<String>,
    /// Relative and absolute difference within which two readings agree.
    pub agree: Option<(f64, f64)>,
    pub scale: f64,
    pub overflow: f64,
    pub overflow_word: Option<String>,
    pub settle: Duration,
    pub fresh: Fresh,
}

/// A named value of a setting and what stands for it in the command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Named {
    pub name: String,
    pub sent: String,
}

/// How a setting is left to the device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Auto {
    pub send: String,
    pub ask: String,
    pub on: String,
}

/// A setting.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SettingPlan {
    pub name: &'static str,
    pub takes: &'static str,
    pub send: String,
    pub ask: Option<String>,
    pub expect: Pattern,
    pub unit: Option<String>,
    pub scale: f64,
    pub least: f64,
    pub most: f64,
    /// Half of the step by which the device may round, in the setting's unit.
    pub resolution: Option<f64>,
    pub names: Vec<Named>,
    pub auto: Option<Auto>,
    pub settle: Duration,
}

impl SettingPlan {
    /// The words that a setting with names takes.
    pub fn known(&self) -> Vec<String> {
        let auto = self.auto.iter().map(|_| AUTO.to_owned());
        auto.chain(self.names.iter().map(|named| named.name.clone())).collect()
    }
}

/// Name of the value that leaves a setting to the device.
pub(super) const AUTO: &str = "auto";

/// The amplifier before the meter.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Gain {
    /// Names, and V/A, from the smallest.
    pub v_per_a: Vec<(String, f64)>,
    pub is: Option<String>,
}

/// A device as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    pub(super) kind: DeviceKind,
    pub(super) name: &'static str,
    pub(super) unit: String,
    pub(super) line_end: &'static str,
    pub(super) reply_end: u8,
    pub(super) timeout: Duration,
    pub(super) identify: String,
    pub(super) identity: Pattern,
    pub(super) errors: Option<String>,
    pub(super) open: (Vec<String>, Duration),
    pub(super) read: Option<Read>,
    pub(super) settings: Vec<SettingPlan>,
    pub(super) gain: Option<Gain>,
    pub(super) response: Option<Response>,
    pub(super) wavelength_nm: Option<f64>,
    pub(super) zero: Option<(Vec<String>, Duration)>,
}

impl Definition {
    /// Reads a file, and the file of a responsivity that it names.
    ///
    /// # Errors
    /// A file that cannot be read, or a [`ParseError`] with the line and the key.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::of(&Document::read(path)?)
    }

    /// Reads a file's text; `path` names it in errors, and other files are found relative to it.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read).
    pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Self, FileError> {
        Self::of(&Document::new(path, text)?)
    }

    /// Kind of the device.
    pub fn kind(&self) -> DeviceKind {
        self.kind
    }

    /// Name of the device.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Unit of what it measures or gives.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    fn of(document: &Document) -> Result<Self, FileError> {
        let file: File = document.parse()?;
        let checks = Checks { document };
        checks.name("name", &file.name)?;
        if file.settings.len() > MOST {
            return Err(checks.error("settings", format!("at most {MOST} settings")).into());
        }
        let unit = checks.unit(&file)?;
        let identity = checks.pattern("identify.expect", &file.identify.expect)?;
        checks.line("identify.send", &file.identify.send)?;
        let errors = match file.errors.send.as_str() {
            "" => None,
            send => Some(checks.line("errors.send", send)?),
        };
        let read = file.read.as_ref().map(|keys| checks.read(keys)).transpose()?;
        let mut settings = Vec::new();
        for (name, keys) in &file.settings {
            settings.push(checks.setting(file.kind, &unit, name, keys)?);
        }
        match file.kind {
            DeviceKind::Source => {
                for needed in ["level", "output"] {
                    if !settings.iter().any(|setting| setting.name == needed) {
                        let expected = format!("a table [settings.{needed}]: a source has one");
                        return Err(checks.error(&format!("settings.{needed}"), expected).into());
                    }
                }
            }
            DeviceKind::Meter | DeviceKind::PowerMeter if read.is_none() => {
                return Err(checks.error("read", "a table [read]: a meter is read").into());
            }
            _ => {}
        }
        if file.kind != DeviceKind::PowerMeter {
            for (key, there) in
                [("response", file.response.is_some()), ("zero", file.zero.is_some())]
            {
                if there {
                    let expected = "it with kind = \"power_meter\" only";
                    return Err(checks.error(key, expected).into());
                }
            }
        }
        let gain = file.gain.as_ref().map(|keys| checks.gain(keys)).transpose()?;
        let response = match &file.response {
            None => None,
            Some(keys) => Some(checks.response(keys)?),
        };
        let wavelength_nm =
            file.response.as_ref().and_then(|keys| keys.wavelength_nm).map(Positive::get);
        if let (Some(response), Some(nm)) = (&response, wavelength_nm)
            && response.a_per_w(nm).is_none()
        {
            let [least, most] = response.ends_nm().to_array();
            let expected = format!("a wavelength of the table, {least} to {most} nm");
            return Err(checks.error("response.wavelength_nm", expected).into());
        }
        let own = ["gain", "wavelength_nm"];
        let taken = |name: &str| match name {
            "gain" => gain.is_some(),
            _ => name == own[1] && response.is_some(),
        };
        if let Some(setting) = settings.iter().find(|setting| taken(setting.name)) {
            let expected = "another name: the file has a table of that name";
            return Err(checks.error(&format!("settings.{}", setting.name), expected).into());
        }
        let line_end = match file.line.end {
            End::Lf => "\n",
            End::CrLf => "\r\n",
            End::Cr => "\r",
        };
        let reply_end = match file.line.reply_end {
            ReplyEnd::Lf => b'\n',
            ReplyEnd::Cr => b'\r',
        };
        let timeout_ms = file.line.timeout_ms.map_or(TIMEOUT_MS, Positive::get);
        let zero = match &file.zero {
            None => None,
            Some(keys) if keys.send.is_empty() => {
                return Err(checks.error("zero.send", "at least one line").into());
            }
            Some(keys) => Some((checks.lines("zero.send", &keys.send)?, ms(keys.settle_ms))),
        };
        let open = (checks.lines("open.send", &file.open.send)?, ms(file.open.settle_ms));
        Ok(Self {
            kind: file.kind,
            name: kept(&file.name),
            unit,
            line_end,
            reply_end,
            timeout: ms(NonNegative::new(timeout_ms)),
            identify: file.identify.send,
            identity,
            errors,
            open,
            read,
            settings,
            gain,
            response,
            wavelength_nm,
            zero,
        })
    }
}

/// Checks across keys, each with an error that knows the key's line.
struct Checks<'d> {
    document: &'d Document,
}

impl Checks<'_> {
    fn error(&self, key: &str, expected: impl Into<String>) -> ParseError {
        self.document.error_at(key, expected)
    }

    /// A name that people read: short and printable.
    fn name(&self, key: &str, name: &str) -> Result<(), ParseError> {
        let good = (1..=40).contains(&name.len())
            && name.bytes().all(|byte| (b' '..=b'~').contains(&byte));
        if good {
            Ok(())
        } else {
            Err(self.error(key, "a name of 1 to 40 printable ASCII characters"))
        }
    }

    fn line(&self, key: &str, line: &str) -> Result<String, ParseError> {
        let good = (1..=LONGEST_LINE).contains(&line.len())
            && line.bytes().all(|byte| (b' '..=b'~').contains(&byte));
        if good {
            return Ok(line.to_owned());
        }
        let expected = format!("a line of 1 to {LONGEST_LINE} printable ASCII characters");
        Err(self.error(key, expected))
    }

    /// A line that is no question: nobody would read its answer.
    fn command(&self, key: &str, line: &str) -> Result<String, ParseError> {
        let line = self.line(key, line)?;
        let header = line.split([' ', '"', '\'']).next().unwrap_or_default();
        if header.ends_with('?') {
            return Err(self.error(key, "a command; the answer to a question would not be read"));
        }
        Ok(line)
    }

    fn lines(&self, key: &str, lines: &[String]) -> Result<Vec<String>, ParseError> {
        if lines.len() > MOST {
            return Err(self.error(key, format!("at most {MOST} lines")));
        }
        let checked = lines.iter().enumerate();
        checked.map(|(i, line)| self.command(&format!("{key}[{i}]"), line)).collect()
    }

    fn pattern(&self, key: &str, text: &str) -> Result<Pattern, ParseError> {
        Pattern::parse(text).map_err(|expected| self.error(key, expected))
    }

    /// Unit of the result, which has to follow from that of the reading.
    fn unit(&self, file: &File) -> Result<String, ParseError> {
        if let Some(unit) = &file.unit {
            self.name("unit", unit)?;
        }
        let read = file.read.as_ref().and_then(|read| read.unit.as_deref());
        if file.kind == DeviceKind::PowerMeter {
            if file.unit.as_deref().is_some_and(|unit| unit != "W") {
                return Err(self.error("unit", "\"W\", or none: a power meter measures watts"));
            }
            let expected = match (&file.gain, &file.response) {
                (Some(_), None) => {
                    return Err(self.error("response", "a table [response]: a current is no power"));
                }
                (Some(_), Some(_)) => "V",
                (None, Some(_)) => "A",
                (None, None) => "W",
            };
            if read != Some(expected) {
                let why = "as [gain] and [response] make watts of it";
                return Err(self.error("read.unit", format!("\"{expected}\", {why}")));
            }
            return Ok("W".to_owned());
        }
        let unit =
            file.unit.as_deref().ok_or_else(|| self.error("unit", "a unit, such as \"A\""))?;
        if file.gain.is_some() {
            if read != Some("V") {
                return Err(self.error("read.unit", "\"V\": an amplifier of [gain] gives volts"));
            }
            if unit != "A" {
                return Err(self.error("unit", "\"A\": volts through [gain] are amperes"));
            }
        } else if let Some(read) = read
            && read != unit
            && file.kind == DeviceKind::Meter
        {
            let expected = format!("\"{unit}\", the unit of the file; read.scale converts");
            return Err(self.error("read.unit", expected));
        }
        Ok(unit.to_owned())
    }

    fn read(&self, keys: &ReadKeys) -> Result<Read, ParseError> {
        let expect = self.pattern("read.expect", &keys.expect)?;
        if !expect.has_value() {
            return Err(self.error("read.expect", "a pattern with {value}"));
        }
        let scale = keys.scale.map_or(1.0, Finite::get);
        if scale == 0.0 {
            return Err(self.error("read.scale", "a number other than 0"));
        }
        let fresh = match (&keys.fresh, keys.period_ms) {
            (FreshWord::Trigger, None) => Fresh::Trigger,
            (FreshWord::Trigger, Some(_)) => {
                return Err(self.error("read.period_ms", "it with fresh = \"poll\" only"));
            }
            (FreshWord::Poll, None) => {
                let expected = "the time from one new value to the next: fresh = \"poll\" needs it";
                return Err(self.error("read.period_ms", expected));
            }
            (FreshWord::Poll, Some(period)) => {
                let measure = keys.measure_ms.unwrap_or(period).get();
                Fresh::Poll { wait: ms(NonNegative::new(1.2 * period.get() + measure)) }
            }
        };
        if keys.measure_ms.is_some() && fresh == Fresh::Trigger {
            return Err(self.error("read.measure_ms", "it with fresh = \"poll\" only"));
        }
        let again = keys.again.as_deref();
        let agree = match (keys.agree, keys.agree_abs) {
            (None, None) => None,
            (relative, absolute) => {
                Some((relative.map_or(0.0, Positive::get), absolute.map_or(0.0, Positive::get)))
            }
        };
        if let Some(word) = &keys.overflow_word {
            self.name("read.overflow_word", word)?;
        }
        Ok(Read {
            first: self.lines("read.first", &keys.first)?,
            send: self.line("read.send", &keys.send)?,
            expect,
            again: again.map(|line| self.line("read.again", line)).transpose()?,
            agree,
            scale,
            overflow: keys.overflow.map_or(OVERFLOW, Positive::get).min(OVERFLOW),
            overflow_word: keys.overflow_word.clone(),
            settle: ms(keys.settle_ms),
            fresh,
        })
    }

    fn setting(
        &self,
        kind: DeviceKind,
        unit: &str,
        name: &str,
        keys: &SettingKeys,
    ) -> Result<SettingPlan, ParseError> {
        let key = |part: &str| format!("settings.{name}.{part}");
        let letters = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_';
        if name.is_empty() || name.len() > 40 || !name.bytes().all(letters) {
            let expected = "a name of 1 to 40 of a-z, 0-9 and _";
            return Err(self.error(&format!("settings.{name}"), expected));
        }
        // Settings that the kind has by itself; `zero` is asked for by [zero].
        if kind == DeviceKind::PowerMeter && name == "zero" {
            return Err(self.error("settings.zero", "a table [zero] instead"));
        }
        let send = self.command(&key("send"), &keys.send)?;
        if send.matches("{value}").count() != 1 {
            return Err(self.error(&key("send"), "a line with {value} in it, once"));
        }
        let ask = keys.ask.as_deref().map(|line| self.line(&key("ask"), line)).transpose()?;
        let expect = self.pattern(&key("expect"), &keys.expect)?;
        if expect.has_value() == expect.has_word() {
            return Err(self.error(&key("expect"), "a pattern with {value} or {word}"));
        }
        let mut names = Vec::new();
        for (name, sent) in keys.names.iter().flatten() {
            self.name(&key("names"), name)?;
            self.line(&format!("{}.{name}", key("names")), sent)?;
            if name == AUTO && keys.auto.is_some() {
                return Err(self.error(&key("names"), "another name than `auto`, which [auto] has"));
            }
            names.push(Named { name: name.clone(), sent: sent.clone() });
        }
        if names.len() > MOST {
            return Err(self.error(&key("names"), format!("at most {MOST} names")));
        }
        if keys.names.is_some() && names.is_empty() {
            return Err(self.error(&key("names"), "at least one name"));
        }
        // Ranges by size, whatever their names: a table of TOML has no order.
        let size = |named: &Named| number_at_start(&named.sent).map_or(f64::INFINITY, |(n, _)| n);
        names.sort_by(|a, b| size(a).total_cmp(&size(b)));
        if expect.has_word() && names.is_empty() {
            return Err(self.error(&key("names"), "a table of names: the answer is a word"));
        }
        let numbers = [("least", keys.least), ("most", keys.most)];
        for (part, number) in numbers {
            if number.is_some() && !names.is_empty() {
                return Err(self.error(&key(part), "it for numbers only; this setting has names"));
            }
        }
        let [least, most] = [
            keys.least.map_or(f64::NEG_INFINITY, Finite::get),
            keys.most.map_or(f64::INFINITY, Finite::get),
        ];
        if least > most {
            return Err(self.error(&key("most"), format!("at least {least}, which is `least`")));
        }
        let scale = keys.scale.map_or(1.0, Finite::get);
        if scale == 0.0 {
            return Err(self.error(&key("scale"), "a number other than 0"));
        }
        let auto = match &keys.auto {
            None => None,
            Some(_) if names.is_empty() => {
                return Err(self.error(&key("auto"), "it with `names` only"));
            }
            Some(_) if ask.is_none() => {
                return Err(
                    self.error(&key("ask"), "a question: a setting with `auto` is read back")
                );
            }
            Some(auto) => Some(Auto {
                send: self.command(&key("auto.send"), &auto.send)?,
                ask: self.line(&key("auto.ask"), &auto.ask)?,
                on: auto.on.clone(),
            }),
        };
        if let Some(unit) = &keys.unit {
            self.name(&key("unit"), unit)?;
        }
        if kind == DeviceKind::Source {
            let known: Vec<&str> = names.iter().map(|named| named.name.as_str()).collect();
            match name {
                "level" if ask.is_none() || !names.is_empty() || !expect.has_value() => {
                    let expected = "a number that is read back: `ask`, {value} and no `names`";
                    return Err(self.error("settings.level", expected));
                }
                "level" if keys.unit.as_deref().is_some_and(|own| own != unit) => {
                    let expected = format!("\"{unit}\", the unit of the file; scale converts");
                    return Err(self.error("settings.level.unit", expected));
                }
                "output"
                    if ask.is_none()
                        || known.len() != 2
                        || !["on", "off"].iter().all(|word| known.contains(word)) =>
                {
                    let expected = "`ask`, and the names `on` and `off`";
                    return Err(self.error("settings.output", expected));
                }
                _ => {}
            }
        }
        if kind == DeviceKind::PowerMeter {
            if name == "range" && names.is_empty() {
                return Err(self.error("settings.range", "`names`: a range is chosen by name"));
            }
            if name == "wavelength_nm" && (!names.is_empty() || ask.is_none()) {
                let expected = "a number that is read back: `ask`, and no `names`";
                return Err(self.error("settings.wavelength_nm", expected));
            }
        }
        let mut plan = SettingPlan {
            name: kept(name),
            takes: "",
            send,
            ask,
            expect,
            unit: keys.unit.clone(),
            scale,
            least,
            most,
            resolution: keys.resolution.map(|step| step.get() / 2.0),
            names,
            auto,
            settle: ms(keys.settle_ms),
        };
        plan.takes = kept(&takes(&plan));
        Ok(plan)
    }

    fn gain(&self, keys: &GainKeys) -> Result<Gain, ParseError> {
        if keys.v_per_a.is_empty() || keys.v_per_a.len() > MOST {
            return Err(self.error("gain.v_per_a", format!("1 to {MOST} gains with their names")));
        }
        for name in keys.v_per_a.keys() {
            self.name("gain.v_per_a", name)?;
        }
        let mut v_per_a: Vec<(String, f64)> =
            keys.v_per_a.iter().map(|(name, gain)| (name.clone(), gain.get())).collect();
        v_per_a.sort_by(|a, b| a.1.total_cmp(&b.1));
        if let Some(is) = &keys.is
            && !keys.v_per_a.contains_key(is)
        {
            let known: Vec<&str> = v_per_a.iter().map(|(name, _)| name.as_str()).collect();
            return Err(self.error("gain.is", format!("one of {}", known.join(", "))));
        }
        Ok(Gain { v_per_a, is: keys.is.clone() })
    }

    fn response(&self, keys: &ResponseKeys) -> Result<Response, FileError> {
        match (&keys.file, &keys.a_per_w) {
            (Some(file), None) => Response::read(self.document.resolve(file)),
            (None, Some(points)) => Response::new(points)
                .map_err(|expected| self.error("response.a_per_w", expected).into()),
            _ => Err(self.error("response", "either `file` or `a_per_w`").into()),
        }
    }
}

/// Values that a setting takes, in words.
fn takes(plan: &SettingPlan) -> String {
    if !plan.names.is_empty() {
        return plan.known().join(", ");
    }
    let unit = plan.unit.as_ref().map_or_else(String::new, |unit| format!(", {unit}"));
    match (plan.least.is_finite(), plan.most.is_finite()) {
        (true, true) => format!("{} to {}{unit}", plan.least, plan.most),
        (true, false) => format!("at least {}{unit}", plan.least),
        (false, true) => format!("at most {}{unit}", plan.most),
        (false, false) => format!("a number{unit}"),
    }
}
