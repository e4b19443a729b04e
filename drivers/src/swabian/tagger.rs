//! A Time Tagger as a photon counter.

use super::DEVICE;
use super::bridge::{Bridge, protocol, text_of};
use super::frame::{BIN_ERROR, BIN_LOST, BIN_OVERFLOW, Bin, Frame};
use super::streamed::Streamed;
use super::utc::Placement;
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Origin, PhotonCounter, Setting, TagSink, Value,
};
use crate::transport::Bytes;
use serde_json::{Map, Value as Json, json};
use std::collections::VecDeque;
use std::time::Duration;
use sunglint_formats::{CountFlags, CountRecord};

/// Bins that wait while the bridge is asked something; more is a bridge that does not answer.
const MOST_WAITING: usize = 100_000;

/// Where the Time Tagger is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// On this computer's USB: the one with this serial number, or the first that is free.
    Usb {
        /// The serial number.
        serial: Option<String>,
    },
    /// Behind the maker's server (`startServer`) on another computer.
    Network {
        /// Host and port: `lab:41101`.
        address: String,
    },
}

/// An input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Name of the channel in tables (`g`).
    pub name: String,
    /// The maker's number: rising edges from 1 upwards, falling edges negative.
    pub number: i32,
}

/// Settings that the driver needs for a Time Tagger.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaggerSettings {
    /// Where it is.
    pub source: Source,
    /// The inputs that are counted.
    pub channels: Vec<Channel>,
    /// Whether a tag stream beside the counter tells how many events were missed, and of errors. It costs the computer the
    /// handling of every tag.
    pub missed: bool,
    /// How long an answer may take, but for opening.
    pub reply_within: Duration,
}

impl Default for TaggerSettings {
    /// The first on USB, channels 1 to 3 as `c1` to `c3`, with missed events, answers within 5 s.
    fn default() -> Self {
        let channel = |number: i32| Channel { name: format!("c{number}"), number };
        Self {
            source: Source::Usb { serial: None },
            channels: (1..=3).map(channel).collect(),
            missed: true,
            reply_within: Duration::from_secs(5),
        }
    }
}

/// Activity of the Time Tagger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Activity {
    Idle,
    Counting {
        bin_ps: i64,
        /// Where the next bin has to begin; unknown before the first.
        next_ps: Option<i64>,
    },
    Tags,
    /// Streaming tags, of which bins are made.
    TagBins,
}

/// A Time Tagger behind the bridge.
#[derive(Debug)]
pub struct TimeTagger<T> {
    pub(super) bridge: Bridge<T>,
    settings: TaggerSettings,
    names: Vec<String>,
    identity: Identity,
    pub(super) activity: Activity,
    waiting: VecDeque<Bin>,
    placement: Placement,
    streamed: Option<Streamed>,
}

impl<T: Bytes> TimeTagger<T> {
    /// Says hello to the bridge and opens the Time Tagger. Loading its firmware may take some seconds.
    ///
    /// # Errors
    /// No package, no Time Tagger, no server, a channel that it has not ([`DeviceError::Declined`], each with what to do);
    /// channels without sense ([`DeviceError::Unknown`]); or see [`DeviceError`].
    pub fn open(
        line: T,
        settings: TaggerSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let channels = &settings.channels;
        let twice = channels
            .iter()
            .enumerate()
            .find(|(i, c)| channels[..*i].iter().any(|o| o.number == c.number || o.name == c.name));
        if channels.is_empty() || twice.is_some() {
            return Err(DeviceError::Unknown {
                name: "channels",
                asked: twice.map_or("none".into(), |(_, c)| format!("{} ({})", c.name, c.number)),
                known: "one or more, each name and number once".into(),
            });
        }
        let (mut bridge, version) = Bridge::open(line, deadline)?;
        let numbers: Vec<i32> = channels.iter().map(|channel| channel.number).collect();
        let mut request = json!({"channels": numbers});
        match &settings.source {
            Source::Usb { serial } => request["serial"] = json!(serial.as_deref().unwrap_or("")),
            Source::Network { address } => request["address"] = json!(address),
        }
        let about = bridge.ask("open", request, deadline, &mut |_| Ok(()))?;
        let serial = text_of(&about, "serial").filter(|serial| !serial.is_empty());
        if let Source::Usb { serial: Some(asked) } = &settings.source
            && serial != Some(asked)
        {
            return Err(protocol(format!("serial number {serial:?} was opened, not {asked}")));
        }
        let firmware = text_of(&about, "firmware").unwrap_or("unknown");
        let identity = Identity {
            vendor: "Swabian Instruments".into(),
            model: text_of(&about, "model").unwrap_or("Time Tagger").to_owned(),
            serial: serial.map(str::to_owned),
            firmware: Some(format!("{firmware}, library {version}")),
            driver: "swabian",
        };
        Ok(Self {
            bridge,
            names: channels.iter().map(|channel| channel.name.clone()).collect(),
            settings,
            identity,
            activity: Activity::Idle,
            waiting: VecDeque::new(),
            placement: Placement::default(),
            streamed: None,
        })
    }

    /// The line to the bridge.
    pub fn line(&self) -> &T {
        self.bridge.line()
    }

    /// The line to the bridge; what is said on it behind its back is not understood.
    pub fn line_mut(&mut self) -> &mut T {
        self.bridge.line_mut()
    }

    /// The line to the bridge.
    pub fn into_line(self) -> T {
        self.bridge.into_line()
    }

    /// Frees the Time Tagger and ends the bridge.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn close(mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.ask("close", json!({}), deadline).map(|_| ())
    }

    /// Connects a channel with the Time Tagger's own test signal (about 0.8 MHz on a Time Tagger Ultra), or gives it back
    /// to its input; gives what the device then says.
    ///
    /// # Errors
    /// No such channel, or see [`DeviceError`].
    pub fn set_test_signal(
        &mut self,
        channel: usize,
        on: bool,
        deadline: &Deadline,
    ) -> Result<bool, DeviceError> {
        let value = self.set(channel, "test_signal", json!(on), deadline)?;
        value.as_bool().ok_or_else(|| protocol(format!("the test signal is {value}")))
    }

    /// Asks within the time for an answer; bins that come meanwhile are kept.
    pub(super) fn ask(
        &mut self,
        operation: &str,
        arguments: Json,
        deadline: &Deadline,
    ) -> Result<Map<String, Json>, DeviceError> {
        let step = deadline.at_most(self.settings.reply_within);
        let (counting, waiting) =
            (matches!(self.activity, Activity::Counting { .. }), &mut self.waiting);
        let streamed = &mut self.streamed;
        self.bridge.ask(operation, arguments, &step, &mut |frame| {
            if let Some(streamed) = streamed {
                return streamed.take(frame);
            }
            match frame {
                Frame::Bin(bin) if counting && waiting.len() < MOST_WAITING => {
                    waiting.push_back(bin);
                }
                Frame::Bin(_) if counting => {
                    return Err(protocol(format!("{MOST_WAITING} bins came before an answer")));
                }
                _ => {}
            }
            Ok(())
        })
    }

    fn set(
        &mut self,
        channel: usize,
        name: &'static str,
        value: Json,
        deadline: &Deadline,
    ) -> Result<Json, DeviceError> {
        let Some(known) = self.settings.channels.get(channel) else {
            let (asked, known) = (channel.to_string(), format!("0 to {}", self.names.len() - 1));
            return Err(DeviceError::Unknown { name: "channel", asked, known });
        };
        let number = known.number;
        let request = json!({"name": name, "channel": number, "value": value});
        let mut answer = self.ask("set", request, deadline)?;
        if answer.get("channel").and_then(Json::as_i64) != Some(number.into()) {
            return Err(protocol(format!("an answer for channel {:?}", answer.get("channel"))));
        }
        Ok(answer.remove("value").unwrap_or(Json::Null))
    }

    fn set_ps(
        &mut self,
        channel: usize,
        name: &'static str,
        value_ps: i64,
        deadline: &Deadline,
    ) -> Result<i64, DeviceError> {
        let value = self.set(channel, name, json!(value_ps), deadline)?;
        value.as_i64().ok_or_else(|| protocol(format!("{name} is {value}, expected whole ps")))
    }

    /// Starts `operation`, once nothing else is measured.
    pub(super) fn begin(
        &mut self,
        operation: &str,
        arguments: Json,
        activity: Activity,
        deadline: &Deadline,
    ) -> Result<Map<String, Json>, DeviceError> {
        if self.activity != Activity::Idle {
            let reason = "it counts or streams tags already: stop first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        self.waiting.clear();
        self.placement.forget();
        let answer = self.ask(operation, arguments, deadline)?;
        let numbers: Vec<i32> = self.settings.channels.iter().map(|c| c.number).collect();
        if answer.get("channels") != Some(&json!(numbers)) {
            let found = answer.get("channels");
            return Err(protocol(format!("{found:?} are counted, expected channels {numbers:?}")));
        }
        self.activity = activity;
        Ok(answer)
    }

    /// The next finished bin of a stream.
    fn streamed_bin(&mut self, deadline: &Deadline) -> Result<CountRecord, DeviceError> {
        loop {
            let Some(streamed) = &mut self.streamed else {
                let reason = "it does not count: start it first";
                return Err(DeviceError::NotReady { device: DEVICE, reason });
            };
            if let Some(bin) = streamed.next() {
                return Ok(bin);
            }
            let frame = self.bridge.measured(deadline)?;
            streamed.take(frame)?;
        }
    }

    /// The next finished bin.
    fn bin(&mut self, deadline: &Deadline) -> Result<CountRecord, DeviceError> {
        if self.activity == Activity::TagBins {
            return self.streamed_bin(deadline);
        }
        let Activity::Counting { bin_ps, next_ps } = self.activity else {
            let reason = "it does not count: start it first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        let bin = match self.waiting.pop_front() {
            Some(bin) => bin,
            None => match self.bridge.measured(deadline)? {
                Frame::Bin(bin) => bin,
                _ => return Err(protocol("tags came, expected a bin".into())),
            },
        };
        let n = self.names.len();
        if (bin.width_ps, bin.counts.len()) != (bin_ps, n) {
            return Err(protocol(format!(
                "a bin of {} ps and {} channels, expected {bin_ps} ps and {n} channels",
                bin.width_ps,
                bin.counts.len()
            )));
        }
        let mut flags = CountFlags::CLOCK_FREE;
        if let Some(next_ps) = next_ps {
            if bin.start_ps < next_ps {
                return Err(protocol(format!(
                    "a bin at {} ps after one that ended at {next_ps} ps: it came twice, or the clock went back",
                    bin.start_ps
                )));
            }
            flags.set(CountFlags::GAP, bin.start_ps > next_ps);
        }
        flags.set(CountFlags::OVERFLOW, bin.flags & (BIN_OVERFLOW | BIN_LOST) != 0);
        flags.set(CountFlags::ERROR, bin.flags & BIN_ERROR != 0);
        flags.set(CountFlags::MISSED, bin.missed.iter().any(|missed| *missed > 0));
        if bin.flags & BIN_ERROR != 0 {
            self.placement.forget();
        }
        // The parser has looked that this is no overflow.
        let end_ps = bin.start_ps.saturating_add(bin.width_ps);
        self.activity = Activity::Counting { bin_ps, next_ps: Some(end_ps) };
        Ok(CountRecord {
            start: self.placement.start(&bin),
            start_ps: bin.start_ps,
            length_ps: bin.width_ps,
            counts: bin.counts,
            missed: bin.missed,
            flags,
        })
    }

    /// A setting of all channels in one line: `g=0.5 r=0.48`.
    fn joined(&self, channels: &[Json], key: &str) -> Result<Value, DeviceError> {
        let mut text = String::new();
        for (name, channel) in self.names.iter().zip(channels) {
            let value = channel.get(key).filter(|value| value.is_number() || value.is_boolean());
            let value = value.ok_or_else(|| protocol(format!("channel {name} has no {key}")))?;
            text += &format!("{}{name}={value}", if text.is_empty() { "" } else { " " });
        }
        Ok(Value::Text(text))
    }
}

impl<T: Bytes> Device for TimeTagger<T> {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(self.identity.clone())
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let answer = self.ask("settings", json!({}), deadline)?;
        let channels = answer.get("channels").and_then(Json::as_array);
        let channels = channels.filter(|channels| channels.len() == self.names.len());
        let channels = channels.ok_or_else(|| protocol("settings of other channels".into()))?;
        let read = |name, value| Setting { name, value, origin: Origin::ReadBack };
        let numbers: Vec<Json> =
            self.settings.channels.iter().map(|c| json!({"number": c.number})).collect();
        let mut settings = vec![Setting {
            name: "channel_number",
            value: self.joined(&numbers, "number")?,
            origin: Origin::Configured,
        }];
        for name in ["trigger_level_v", "input_delay_ps", "dead_time_ps", "test_signal"] {
            settings.push(read(name, self.joined(channels, name)?));
        }
        if let Some(overflows) = answer.get("overflows").and_then(Json::as_i64) {
            settings.push(read("overflows_since_start", Value::Integer(overflows)));
        }
        Ok(settings)
    }
}

impl<T: Bytes> PhotonCounter for TimeTagger<T> {
    fn channels(&self) -> &[String] {
        &self.names
    }

    fn set_trigger_level_v(
        &mut self,
        channel: usize,
        level_v: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        // No Time Tagger takes more than ±5 V; JSON knows no infinity.
        if !(-5.0..=5.0).contains(&level_v) {
            let (least, most) = (-5.0, 5.0);
            let name = "trigger_level_v";
            return Err(DeviceError::OutOfRange { name, asked: level_v, least, most });
        }
        let value = self.set(channel, "trigger_level_v", json!(level_v), deadline)?;
        value.as_f64().ok_or_else(|| protocol(format!("the trigger level is {value}")))
    }

    fn set_input_delay_ps(
        &mut self,
        channel: usize,
        delay_ps: i64,
        deadline: &Deadline,
    ) -> Result<i64, DeviceError> {
        self.set_ps(channel, "input_delay_ps", delay_ps, deadline)
    }

    fn set_dead_time_ps(
        &mut self,
        channel: usize,
        dead_time_ps: i64,
        deadline: &Deadline,
    ) -> Result<i64, DeviceError> {
        self.set_ps(channel, "dead_time_ps", dead_time_ps, deadline)
    }

    fn start(&mut self, bin_ps: i64, deadline: &Deadline) -> Result<(), DeviceError> {
        check_bin(bin_ps)?;
        let request = json!({"binwidth_ps": bin_ps, "missed": self.settings.missed});
        let activity = Activity::Counting { bin_ps, next_ps: None };
        let answer = self.begin("counter", request, activity, deadline)?;
        match answer.get("binwidth_ps").and_then(Json::as_i64) {
            Some(found) if found == bin_ps => Ok(()),
            found => Err(protocol(format!("bins of {found:?} ps, expected {bin_ps} ps"))),
        }
    }

    fn streams_tags(&self) -> bool {
        true
    }

    fn start_with_tags(
        &mut self,
        bin_ps: i64,
        sink: TagSink,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        check_bin(bin_ps)?;
        let channels = self.settings.channels.iter().map(|channel| channel.number).collect();
        if self.activity == Activity::Idle {
            // Before the request: the stream may begin before its answer.
            self.streamed = Some(Streamed::new(channels, bin_ps, sink));
        }
        let request = json!({"stretches": true});
        let answer = match self.begin("stream", request, Activity::TagBins, deadline) {
            Ok(answer) => answer,
            Err(error) => {
                if self.activity == Activity::Idle {
                    self.streamed = None;
                }
                return Err(error);
            }
        };
        match answer.get("stretches").and_then(Json::as_bool) {
            Some(true) => Ok(()),
            found => Err(protocol(format!("stretches are {found:?}, expected true"))),
        }
    }

    fn read(
        &mut self,
        bins: usize,
        deadline: &Deadline,
    ) -> Result<Vec<CountRecord>, Interrupted<Vec<CountRecord>>> {
        let mut done = Vec::new();
        while done.len() < bins {
            match self.bin(deadline) {
                Ok(record) => done.push(record),
                Err(error) => return Err(Interrupted::new(done, error)),
            }
        }
        Ok(done)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        // The last tags come before the answer.
        self.ask("stop", json!({}), deadline)?;
        self.activity = Activity::Idle;
        self.streamed = None;
        self.waiting.clear();
        Ok(())
    }
}

/// Whether bins may be that long.
fn check_bin(bin_ps: i64) -> Result<(), DeviceError> {
    /// Shorter bins than a millisecond are made of tags, afterwards.
    const SHORTEST_PS: i64 = 1_000_000_000;
    const LONGEST_PS: i64 = 86_400_000_000_000_000;
    if (SHORTEST_PS..=LONGEST_PS).contains(&bin_ps) {
        return Ok(());
    }
    let (name, asked) = ("bin_ps", bin_ps as f64);
    let (least, most) = (SHORTEST_PS as f64, LONGEST_PS as f64);
    Err(DeviceError::OutOfRange { name, asked, least, most })
}
