//! A simulated Time Tagger behind a simulated bridge: it speaks the bridge's protocol, and counts what a [`Light`] sends.
//!
//! Requests, answers and frames are those of `bridge/swabian.py`. How the counter behaves (finished bins only, from the
//! moment of the start on; a stream in blocks) is as the maker documents it, not as measured on one. Bins and tags come of
//! the same light by different ways, so that they can be held against each other.

mod light;

pub use light::{Light, LightBin, Poisson};

use crate::clock::Deadline;
use crate::swabian::frame::{
    BIN_ERROR, BIN_OVERFLOW, Bin, Frame, MOST_PAYLOAD, PROTOCOL, checksum, emit,
};
use crate::tags::{RECORD_BYTES, Tag, TagKind};
use crate::transport::{Bytes, TransportError};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// How often the stream hands over tags.
const STREAM_EVERY: Duration = Duration::from_millis(20);

/// Properties of the Time Tagger.
#[derive(Debug, Clone, PartialEq)]
pub struct TaggerSpec {
    /// Serial number of the Time Tagger.
    pub serial: String,
    /// Number of inputs of the Time Tagger, rising edges.
    pub inputs: i32,
    /// A step of its trigger levels, V.
    pub level_step_v: f64,
    /// The shortest and longest dead time, ps.
    pub dead_time_ps: [i64; 2],
    /// How long an answer takes, and a bin from its end to the host.
    pub latency: Duration,
    /// UTC when the clock is at zero, as Unix time, ns.
    pub epoch_ns: i64,
    /// Files that it can convert, by their names.
    pub files: BTreeMap<String, Vec<Tag>>,
}

impl Default for TaggerSpec {
    /// A Time Tagger Ultra with 18 inputs, dead times from 2.1 ns to 2.147 ms, answers after 2 ms, 2026-01-01 at zero.
    fn default() -> Self {
        Self {
            serial: "2138000XYZ".into(),
            inputs: 18,
            level_step_v: 0.001,
            dead_time_ps: [2_100, 2_147_000_000],
            latency: Duration::from_millis(2),
            epoch_ns: 1_767_225_600_000_000_000,
            files: BTreeMap::new(),
        }
    }
}

/// Faults of the Time Tagger.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Trouble {
    /// Requests of this name are refused with this code and text.
    pub refuse: Option<(String, String, String)>,
    /// It speaks this version.
    pub version: Option<u64>,
    /// The bridge dies after so many frames.
    pub dies_after: Option<u32>,
    /// Half of this frame comes, and then nothing.
    pub half_frame: Option<u32>,
    /// This frame announces another length.
    pub wrong_length: Option<u32>,
    /// This bin is sent twice, counted from 0.
    pub twice: Option<u64>,
    /// This bin is not sent.
    pub dropped: Option<u64>,
    /// It answers nothing.
    pub silent: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doing {
    Nothing,
    Counting { width_ps: i64, next_ps: i64, number: u64 },
    Streaming { from_ps: i64, stretches: bool },
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Input {
    level_v: f64,
    delay_ps: i64,
    dead_time_ps: i64,
    test_signal: bool,
}

/// The Time Tagger and its bridge at the other end of a line in memory: a transport for the driver.
pub struct Simulated {
    spec: TaggerSpec,
    /// Faults of the Time Tagger; may be changed while it runs.
    pub trouble: Trouble,
    light: Box<dyn Light>,
    channels: Vec<i32>,
    inputs: BTreeMap<i32, Input>,
    doing: Doing,
    heard: Vec<u8>,
    frames: u32,
    /// An overflow has begun and not ended.
    dropping: bool,
    said: VecDeque<(Duration, Vec<u8>)>,
    dead: bool,
}

impl std::fmt::Debug for Simulated {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Simulated").field("spec", &self.spec).finish_non_exhaustive()
    }
}

fn ps(time: Duration) -> i64 {
    i64::try_from(time.as_nanos().saturating_mul(1000)).unwrap_or(i64::MAX)
}

fn at(time_ps: i64) -> Duration {
    // Rounded up: a bin has ended when it can be read.
    Duration::from_nanos(time_ps.max(0).unsigned_abs().div_ceil(1000))
}

fn refusal(code: &str, text: impl Into<String>) -> Value {
    json!({"code": code, "text": text.into()})
}

impl Simulated {
    /// A Time Tagger that sees `light`.
    pub fn new(spec: TaggerSpec, light: impl Light + 'static) -> Self {
        Self {
            spec,
            trouble: Trouble::default(),
            light: Box::new(light),
            channels: Vec::new(),
            inputs: BTreeMap::new(),
            doing: Doing::Nothing,
            heard: Vec::new(),
            frames: 0,
            dropping: false,
            said: VecDeque::new(),
            dead: false,
        }
    }

    fn say(&mut self, frame: &Frame, due: Duration) {
        let number = self.frames;
        self.frames += 1;
        let mut bytes = emit(frame, number);
        if self.trouble.half_frame == Some(number) {
            bytes.truncate(bytes.len() / 2);
            self.trouble.silent = true;
        }
        if self.trouble.wrong_length == Some(number) {
            bytes[0] ^= 1;
        }
        self.said.push_back((due, bytes));
    }

    fn hear(&mut self, bytes: &[u8], now: Duration) {
        self.advance(now);
        for byte in bytes {
            if *byte != b'\n' {
                self.heard.push(*byte);
                continue;
            }
            let line = std::mem::take(&mut self.heard);
            if !self.trouble.silent {
                self.handle(&line, now);
            }
        }
    }

    fn handle(&mut self, line: &[u8], now: Duration) {
        let due = now + self.spec.latency;
        let request = understood(line);
        let id = request.as_ref().map_or(Value::Null, |request| request["id"].clone());
        let done = match &request {
            Some(request) => self.carry_out(request, now),
            None => Err(refusal("bad_request", "a request came damaged")),
        };
        let answer = match done {
            Ok(done) => json!({"id": id, "ok": done}),
            Err(error) => json!({"id": id, "error": error}),
        };
        self.say(&Frame::Json(answer), due);
    }

    fn carry_out(&mut self, request: &Value, now: Duration) -> Result<Value, Value> {
        let operation = request["op"].as_str().unwrap_or("");
        if let Some((refused, code, text)) = &self.trouble.refuse
            && refused == operation
        {
            return Err(refusal(code, text.clone()));
        }
        let idle = self.doing == Doing::Nothing;
        match operation {
            "hello" => {
                let version = self.trouble.version.unwrap_or(PROTOCOL);
                Ok(
                    json!({"protocol": version, "module": "simulated", "version": "0.0.0", "statistics": "off"}),
                )
            }
            "open" => self.open(request),
            "set" => self.set(request),
            "settings" => {
                let of = |channel| self.inputs.get(channel).map(about);
                let channels: Vec<Value> = self.channels.iter().filter_map(of).collect();
                Ok(json!({"channels": channels, "overflows": 0}))
            }
            "counter" | "stream" if !idle => {
                Err(refusal("busy", "it counts or streams already: stop first"))
            }
            "counter" => {
                let width = request["binwidth_ps"].as_i64().filter(|width| *width > 0);
                let width_ps = width.ok_or_else(|| refusal("bad_request", "no such bin"))?;
                self.doing = Doing::Counting { width_ps, next_ps: ps(now), number: 0 };
                Ok(json!({"binwidth_ps": width_ps, "channels": self.channels}))
            }
            "stream" => {
                let (from_ps, stretches) = (ps(now), request["stretches"] == true);
                self.doing = Doing::Streaming { from_ps, stretches };
                if stretches {
                    // Where the stream's time stands; it comes before the answer.
                    self.say_stretch(from_ps - 1, from_ps, now);
                }
                Ok(match stretches {
                    true => json!({"channels": self.channels, "stretches": true}),
                    false => json!({"channels": self.channels}),
                })
            }
            "stop" | "close" => {
                self.doing = Doing::Nothing;
                Ok(json!({}))
            }
            "convert" => self.convert(request, now),
            other => Err(refusal("bad_request", format!("no operation {other}"))),
        }
    }

    fn open(&mut self, request: &Value) -> Result<Value, Value> {
        let serial = request["serial"].as_str().unwrap_or("");
        if !serial.is_empty() && serial != self.spec.serial {
            let text = "No Time Tagger attached or already in use.";
            return Err(refusal("no_device", text));
        }
        let asked = request["channels"].as_array().cloned().unwrap_or_default();
        let asked: Option<Vec<i64>> = asked.iter().map(Value::as_i64).collect();
        let known =
            |c: &i64| *c != 0 && c.unsigned_abs() <= u64::from(self.spec.inputs.unsigned_abs());
        let channels = asked.filter(|channels| channels.iter().all(known));
        let channels = channels.ok_or_else(|| refusal("no_channel", "it has no such channel"))?;
        self.channels = channels.iter().filter_map(|c| i32::try_from(*c).ok()).collect();
        let dead_time_ps = self.spec.dead_time_ps[0];
        let input = Input { level_v: 0.5, delay_ps: 0, dead_time_ps, test_signal: false };
        self.inputs = self.channels.iter().map(|channel| (*channel, input)).collect();
        Ok(
            json!({"serial": self.spec.serial, "model": "Time Tagger Ultra (simulated)", "firmware": "0"}),
        )
    }

    fn set(&mut self, request: &Value) -> Result<Value, Value> {
        let (step, [least, most]) = (self.spec.level_step_v, self.spec.dead_time_ps);
        let number = request["channel"].as_i64().and_then(|number| i32::try_from(number).ok());
        let (Some(number), value) = (number, &request["value"]) else {
            return Err(refusal("bad_request", "no channel"));
        };
        let Some(input) = self.inputs.get_mut(&number) else {
            return Err(refusal("no_channel", format!("channel {number} was not opened")));
        };
        let name = request["name"].as_str().unwrap_or("");
        match (name, value.as_f64(), value.as_i64(), value.as_bool()) {
            ("trigger_level_v", Some(level), _, _) => {
                input.level_v = ((level / step).round() * step).clamp(-2.5, 2.5);
            }
            ("input_delay_ps", _, Some(delay), _) => input.delay_ps = delay,
            ("dead_time_ps", _, Some(time), _) if time > most => {
                return Err(refusal("vendor", format!("dead time {time} ps exceeds {most} ps")));
            }
            ("dead_time_ps", _, Some(time), _) => input.dead_time_ps = time.max(least),
            ("test_signal", _, _, Some(on)) => input.test_signal = on,
            _ => return Err(refusal("bad_request", format!("no setting {name} of {value}"))),
        }
        Ok(json!({"channel": number, "value": about(input)[name]}))
    }

    fn convert(&mut self, request: &Value, now: Duration) -> Result<Value, Value> {
        let file = request["file"].as_str().unwrap_or("");
        let Some(tags) = self.spec.files.get(file).cloned() else {
            return Err(refusal("bad_file", format!("{file} is no file")));
        };
        let photons = tags.iter().filter(|tag| tag.kind() == Some(TagKind::TimeTag)).count();
        self.say_tags(&tags, now + self.spec.latency);
        Ok(json!({"records": tags.len(), "photons": photons}))
    }

    fn say_tags(&mut self, tags: &[Tag], due: Duration) {
        for block in tags.chunks(MOST_PAYLOAD / RECORD_BYTES) {
            let records = block.iter().map(Tag::to_bytes).collect();
            self.say(&Frame::Tags(records), due);
        }
    }

    /// All tags of the stretch were said.
    fn say_stretch(&mut self, start_ps: i64, end_ps: i64, now: Duration) {
        let due = now + self.spec.latency;
        let read_ns = self.spec.epoch_ns.saturating_add(ps(due) / 1000);
        let (width_ps, counts, missed) = (end_ps - start_ps, vec![], vec![]);
        self.say(&Frame::Bin(Bin { start_ps, width_ps, read_ns, flags: 0, counts, missed }), due);
    }

    /// When something happens next by itself.
    fn next_step(&self) -> Option<Duration> {
        match self.doing {
            _ if self.trouble.silent => None,
            Doing::Nothing => None,
            Doing::Counting { width_ps, next_ps, .. } => Some(at(next_ps.saturating_add(width_ps))),
            Doing::Streaming { from_ps, .. } => Some(at(from_ps) + STREAM_EVERY),
        }
    }

    /// Counts and streams up to `now`.
    fn advance(&mut self, now: Duration) {
        while let Some(step) = self.next_step().filter(|step| *step <= now) {
            match self.doing {
                Doing::Nothing => return,
                Doing::Counting { width_ps, next_ps, number } => {
                    let end_ps = next_ps + width_ps;
                    self.doing = Doing::Counting { width_ps, next_ps: end_ps, number: number + 1 };
                    let bin = self.bin(next_ps, end_ps, step + self.spec.latency);
                    let times = match Some(number) {
                        n if n == self.trouble.dropped => 0,
                        n if n == self.trouble.twice => 2,
                        _ => 1,
                    };
                    for _ in 0..times {
                        self.say(&Frame::Bin(bin.clone()), step + self.spec.latency);
                    }
                }
                Doing::Streaming { from_ps, stretches } => {
                    let to_ps = ps(step);
                    self.doing = Doing::Streaming { from_ps: to_ps, stretches };
                    let mut tags = Vec::new();
                    self.light.tags(&self.channels, from_ps, to_ps, &mut tags);
                    self.say_tags(&tags, step + self.spec.latency);
                    if stretches {
                        self.say_stretch(from_ps, to_ps, step);
                    }
                }
            }
        }
    }

    fn bin(&mut self, start_ps: i64, end_ps: i64, read: Duration) -> Bin {
        let light = self.light.bin(&self.channels, start_ps, end_ps);
        let flags = if light.overflow || self.dropping { BIN_OVERFLOW } else { 0 }
            | if light.error { BIN_ERROR } else { 0 };
        self.dropping = light.dropping.unwrap_or(self.dropping);
        let read_ns = self.spec.epoch_ns.saturating_add(ps(read) / 1000);
        let (counts, missed) = (light.counts, light.missed);
        Bin { start_ps, width_ps: end_ps - start_ps, read_ns, flags, counts, missed }
    }

    fn gone(&self) -> TransportError {
        TransportError::disconnected("the simulated bridge")
    }
}

fn about(input: &Input) -> Value {
    json!({
        "trigger_level_v": input.level_v,
        "input_delay_ps": input.delay_ps,
        "dead_time_ps": input.dead_time_ps,
        "test_signal": input.test_signal,
    })
}

/// The request of a line, if its checksum fits.
fn understood(line: &[u8]) -> Option<Value> {
    let text = std::str::from_utf8(line).ok()?;
    let (text, crc) = text.rsplit_once(' ')?;
    (crc == format!("{:08x}", checksum(text.as_bytes()))).then_some(())?;
    serde_json::from_str(text).ok()
}

impl Bytes for Simulated {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        deadline.remaining()?;
        if self.dead {
            return Err(self.gone());
        }
        self.hear(bytes, deadline.now());
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            if self.dead {
                return Err(self.gone());
            }
            let now = deadline.now();
            self.advance(now);
            if let Some((due, bytes)) = self.said.front_mut()
                && *due <= now
            {
                let count = buffer.len().min(bytes.len());
                buffer[..count].copy_from_slice(&bytes[..count]);
                bytes.drain(..count);
                if bytes.is_empty() {
                    self.said.pop_front();
                    let left = self.trouble.dies_after.as_mut();
                    self.dead = left.is_some_and(|left| {
                        *left = left.saturating_sub(1);
                        *left == 0
                    });
                }
                return Ok(count);
            }
            let said = self.said.front().map(|(due, _)| *due);
            let wake = [said, self.next_step()].into_iter().flatten().min();
            deadline.sleep(wake.map_or(Duration::MAX, |wake| wake.saturating_sub(now)))?;
        }
    }

    fn discard(&mut self, _: &Deadline) -> Result<Vec<u8>, TransportError> {
        Ok(self.said.drain(..).flat_map(|(_, bytes)| bytes).collect())
    }
}
