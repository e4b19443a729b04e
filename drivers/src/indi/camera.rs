//! A camera.

use super::client::{Blobs, Wanted, declined, hear};
use super::image::{Exposed, Taken, Unfit, from_blob};
use super::property::{Blob, Event, State};
use super::session::{Kind, Session, SessionSettings, check_range};
use crate::clock::{Deadline, utc_now};
use crate::device::{
    self, Device, DeviceError, FrameType, Identity, Interrupted, Limits, Origin, Setting, Value,
    Window,
};
use crate::transport::Bytes;
use hifitime::Epoch;
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::time::Duration;
use sunglint_formats::session::SHARED;
use sunglint_formats::{Bayer, Frame};
use sunglint_numerics::measured::Interval;

pub(super) const DEVICE: &str = "INDI camera";
const KIND: Kind = Kind {
    label: DEVICE,
    what: "camera",
    interface: 1 << 1,
    required: &["CCD_EXPOSURE", "CCD_FRAME", "CCD_INFO"],
};

/// How a camera is used.
#[derive(Debug, Clone, Copy)]
pub struct CameraSettings {
    /// How its server is spoken to.
    pub session: SessionSettings,
    /// Whether the server packs frames. `.fits.z` is read; the servers of indi-bin 1.9.9 pack into `.fits.fz`, which is not.
    pub packed: bool,
    /// How long an abort, or the end of a stream, may take after its deadline.
    pub abort_within: Duration,
    /// The host's own UTC, to be held against the server's.
    pub utc: fn() -> Epoch,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self {
            session: SessionSettings::default(),
            packed: false,
            abort_within: Duration::from_secs(1),
            utc: utc_now,
        }
    }
}

/// The switch of a frame's purpose.
fn switch(kind: FrameType) -> &'static str {
    match kind {
        FrameType::Light => "FRAME_LIGHT",
        FrameType::Bias => "FRAME_BIAS",
        FrameType::Dark => "FRAME_DARK",
        FrameType::Flat => "FRAME_FLAT",
    }
}

/// Settings that the user has made, to be set again after a reconnection.
#[derive(Debug, Clone, Copy, Default)]
struct Wishes {
    window: Option<Window>,
    gain: Option<f64>,
    frame_type: Option<FrameType>,
}

/// A camera on an INDI server.
#[derive(Debug)]
pub struct Camera<T> {
    pub(super) session: Session<T>,
    pub(super) settings: CameraSettings,
    sensor_px: [u32; 2],
    pub(super) window: Window,
    wishes: Wishes,
    /// The last exposure or stream could not be stopped.
    running: bool,
    others: Others,
}

/// Evidence of other programs that use the same camera.
#[derive(Debug, Clone, Default)]
struct Others {
    /// Whether any was seen.
    seen: bool,
    /// Whether the last frame alone may be another's.
    doubted: bool,
    /// How much later than they were asked for the last exposures began, by the server's clock, s.
    later_s: VecDeque<f64>,
    /// Whether the driver has given an exposure as it was asked for.
    exact: bool,
    /// An exposure that the driver gave instead, s, and how often in a row.
    instead: (f64, u32),
}

impl Others {
    /// Frames in a row that a driver may take for its own reading of the exposure, before that is believed.
    const TRIES: u32 = 3;
    /// Frames whose begin is usual, fewest and most.
    const USUAL: [usize; 2] = [3, 9];
    /// An exposure that began so much earlier than usual had begun before it was asked for, s.
    const EARLIER_S: f64 = 0.2;

    /// Whether an exposure that began so much later than it was asked for, by the server's clock, had begun before: both clocks may be apart, but not once
    /// more than at other times.
    fn is_early(&mut self, later_s: f64) -> bool {
        let mut usual: Vec<f64> = self.later_s.iter().copied().collect();
        usual.sort_by(f64::total_cmp);
        let early =
            usual.len() >= Self::USUAL[0] && later_s < usual[usual.len() / 2] - Self::EARLIER_S;
        // A clock that was set becomes usual, too.
        self.later_s.push_back(later_s);
        if self.later_s.len() > Self::USUAL[1] {
            self.later_s.pop_front();
        }
        early
    }

    /// Whether a frame with the exposure `got`, s, may be the one of `asked`, s. A driver that rounds exposures gives the same value each time, and no other
    /// program shows.
    fn takes(&mut self, got: f64, asked: f64) -> bool {
        if is_exposure(got, asked) {
            (self.exact, self.instead) = (true, (0.0, 0));
            return true;
        }
        if self.exact || self.seen {
            return false;
        }
        let (before, times) = self.instead;
        self.instead = if before == got { (got, times + 1) } else { (got, 1) };
        self.instead.1 >= Self::TRIES
    }
}

/// Whether two exposures are the same, s: headers keep some digits only.
fn is_exposure(got: f64, asked: f64) -> bool {
    (got - asked).abs() <= (1e-3 * asked).max(5e-4)
}

/// Drivers may round what is left of an exposure that is longer, s, up to a whole second.
const ROUNDED_S: f64 = 1.0;

/// Whether what is left of an exposure of ours, s, can be of it.
fn is_left_of(left_s: f64, exposure_s: f64) -> bool {
    let most_s = if exposure_s > ROUNDED_S { exposure_s.ceil() } else { exposure_s };
    left_s <= most_s || is_exposure(left_s, exposure_s)
}

/// Whether an exposure of `exposure_s` that had `before` s left, and now has `now`, has begun anew: it only counts down. Whole seconds may come twice, because
/// drivers round to them.
fn begins_anew(before: f64, now: f64, exposure_s: f64) -> bool {
    let whole = exposure_s > ROUNDED_S;
    let rounding_s = if whole { ROUNDED_S } else { 0.0 };
    let again = now == exposure_s && before == exposure_s && (!whole || exposure_s.fract() != 0.0);
    again || now > before + rounding_s + 1e-6
}

/// Time in which what came before an exposure is read.
const BEFORE: Duration = Duration::from_millis(2);
/// The same from a driver that never stops.
const BEFORE_MOST: Duration = Duration::from_millis(200);
/// Bytes of a FITS file beside its pixels, and bytes a pixel, at most.
const HEADER_BYTES: usize = 1 << 20;
const PIXEL_BYTES: usize = 8;
/// The BLOBs of a camera that has not said how large its sensor is.
const UNKNOWN_BYTES: usize = 64 << 20;
/// Card of an exposure that the driver changed.
const ASKED: &str = "EXPASKED";

/// The vector in which frames come: the camera's own, not that of its guide head.
pub(super) const BLOB: &str = "CCD1";

impl<T: Bytes> Camera<T> {
    /// Connects to the camera of that name and reads what it is.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::Unknown`] if the server has none of that name ([`devices`](super::devices) lists them).
    pub fn open(
        line: T,
        device: &str,
        settings: CameraSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let session = Session::new(line, device, KIND, settings.session);
        let window = Window { origin_px: [0, 0], size_px: [0, 0], binning: [1, 1] };
        let wishes = Wishes::default();
        let mut camera = Self {
            session,
            settings,
            sensor_px: [0, 0],
            window,
            wishes,
            running: false,
            others: Others::default(),
        };
        let most = settings.session.limits.blob_bytes.min(UNKNOWN_BYTES);
        camera.session.client.limit_blobs(most);
        camera.session.define(deadline)?;
        camera.prepare(deadline)?;
        Ok(camera)
    }

    /// Goes on over a new line to the server, after the old one broke; everything is defined from scratch, and window, gain
    /// and frame type are set again. Gives the old line.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn reconnect(&mut self, line: T, deadline: &Deadline) -> Result<T, DeviceError> {
        let old = self.session.client.replace_line(line);
        self.session.define(deadline)?;
        self.prepare(deadline)?;
        Ok(old)
    }

    /// The same on the same line, after the camera's driver ended and the server has started it again.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn reopen(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.session.redefine(deadline)?;
        self.prepare(deadline)
    }

    /// The line.
    pub fn line(&self) -> &T {
        self.session.client.line()
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.session.client.into_line()
    }

    /// The server's last messages to people, the oldest first.
    pub fn messages(&self) -> impl Iterator<Item = &str> {
        self.session.client.messages()
    }

    /// The part of the sensor that is read.
    pub fn window(&self) -> Window {
        self.window
    }

    /// The colours of the sensor's first 2 × 2 pixels, where the driver says them (`CCD_CFA`).
    pub fn bayer(&self) -> Option<Bayer> {
        let cfa = self.session.property("CCD_CFA")?;
        let pattern = Bayer::from_name(cfa.text("CFA_TYPE")?.trim())?;
        let offset = |name| -> Option<u32> { cfa.text(name)?.trim().parse().ok() };
        let (x, y) = (offset("CFA_OFFSET_X").unwrap_or(0), offset("CFA_OFFSET_Y").unwrap_or(0));
        Some(pattern.shifted(x, y))
    }

    /// Sets any property of the driver (its own settings, such as `SIMULATOR_SETTINGS`) and reads the sensor anew.
    ///
    /// # Errors
    /// No such property; [`DeviceError::Declined`]; [`DeviceError::NotTaken`] if it is something else afterwards.
    pub fn configure(
        &mut self,
        property: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let soon = deadline.at_most(self.settings.session.answer_within);
        let after = self.session.change(property, wanted, &soon)?;
        self.read_sensor()?;
        self.window = self.read_window()?;
        if wanted.is_in(&after) {
            return Ok(());
        }
        let got: Vec<String> =
            after.members.iter().map(|m| format!("{}={}", m.name, m.value)).collect();
        let asked = format!("{property} {wanted:?}");
        let name = "a property of the driver";
        Err(DeviceError::NotTaken { device: DEVICE, name, asked, got: got.join(" ") })
    }

    /// Says what the next frames are taken for.
    ///
    /// # Errors
    /// A camera that does not distinguish them; as [`configure`](Self::configure).
    pub fn set_frame_type(
        &mut self,
        frame_type: FrameType,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let all = FrameType::ALL.map(|each| (switch(each), each == frame_type));
        self.configure("CCD_FRAME_TYPE", Wanted::Switches(&all), deadline)?;
        self.wishes.frame_type = Some(frame_type);
        Ok(())
    }

    /// After the definitions: frames as FITS, to this client, and what the user had set.
    fn prepare(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.running = false;
        let session = &mut self.session;
        session.client.await_defined(&session.device, BLOB, deadline)?;
        session.client.enable_blobs(&session.device, BLOB, Blobs::Also, deadline)?;
        // The native format of 1.9.9's simulator sends the whole sensor for any window, and later crashes it.
        session.turn_on("CCD_TRANSFER_FORMAT", ["FORMAT_FITS", "FORMAT_NATIVE"], deadline)?;
        session.turn_on("UPLOAD_MODE", ["UPLOAD_CLIENT", "UPLOAD_LOCAL"], deadline)?;
        // Servers before 1.9.8 have other names for the same switches.
        for [on, off] in [["INDI_ENABLED", "INDI_DISABLED"], ["CCD_COMPRESS", "CCD_RAW"]] {
            let members = if self.settings.packed { [on, off] } else { [off, on] };
            session.turn_on("CCD_COMPRESSION", members, deadline)?;
        }
        self.read_sensor()?;
        self.window = self.read_window()?;
        let Wishes { window, gain, frame_type } = self.wishes;
        if let Some(window) = window {
            device::Camera::set_window(self, window, deadline)?;
        }
        if let Some(gain) = gain {
            device::Camera::set_gain(self, gain, deadline)?;
        }
        frame_type.map_or(Ok(()), |frame_type| self.set_frame_type(frame_type, deadline))
    }

    fn read_sensor(&mut self) -> Result<(), DeviceError> {
        let mut sensor = [0; 2];
        for (side, member) in sensor.iter_mut().zip(["CCD_MAX_X", "CCD_MAX_Y"]) {
            *side = self.pixels("CCD_INFO", member)?;
        }
        if sensor.contains(&0) {
            let reason = format!("its sensor has {} × {} pixels", sensor[0], sensor[1]);
            return Err(self.session.protocol(reason));
        }
        self.sensor_px = sensor;
        let pixels = sensor[0] as usize * sensor[1] as usize;
        let most = pixels.saturating_mul(PIXEL_BYTES).saturating_add(HEADER_BYTES);
        self.session.client.limit_blobs(most.min(self.settings.session.limits.blob_bytes));
        Ok(())
    }

    /// A whole number of pixels.
    fn pixels(&self, name: &str, member: &str) -> Result<u32, DeviceError> {
        const MOST: f64 = 1e6;
        let number = self.session.number(name, member)?;
        if number.fract() != 0.0 || !(0.0..=MOST).contains(&number) {
            let reason = format!("{name}.{member} is {number}, expected whole pixels");
            return Err(self.session.protocol(reason));
        }
        Ok(number as u32)
    }

    fn read_window(&self) -> Result<Window, DeviceError> {
        let binning = match self.session.property("CCD_BINNING") {
            None => [1, 1],
            Some(_) => {
                [self.pixels("CCD_BINNING", "HOR_BIN")?, self.pixels("CCD_BINNING", "VER_BIN")?]
            }
        };
        let read = |member| self.pixels("CCD_FRAME", member);
        let window = Window {
            origin_px: [read("X")?, read("Y")?],
            size_px: [read("WIDTH")?, read("HEIGHT")?],
            binning,
        };
        if binning.contains(&0) {
            return Err(self.session.protocol("its binning is 0".into()));
        }
        Ok(window)
    }

    fn check_window(&self, window: &Window) -> Result<(), DeviceError> {
        const NAMES: [[&str; 3]; 2] = [
            ["binning in columns", "first column, px", "columns, px"],
            ["binning in rows", "first row, px", "rows, px"],
        ];
        for axis in 0..2 {
            let [bin_name, origin_name, size_name] = NAMES[axis];
            let (origin, size) = (window.origin_px[axis], window.size_px[axis]);
            let binning = window.binning[axis];
            let range = match self.session.property("CCD_BINNING") {
                None => Some(Interval::new(1.0, 1.0)),
                Some(vector) => vector.range(["HOR_BIN", "VER_BIN"][axis]),
            };
            let range = range.or(Some(Interval::new(1.0, f64::from(self.sensor_px[axis]))));
            check_range(bin_name, binning.into(), range)?;
            let sensor = f64::from(self.sensor_px[axis]);
            check_range(origin_name, origin.into(), Some(Interval::new(0.0, sensor - 1.0)))?;
            let most = sensor - f64::from(origin);
            check_range(size_name, size.into(), Some(Interval::new(binning.into(), most)))?;
            if binning == 0 || origin % binning != 0 {
                let asked = origin.to_string();
                let known = format!("the multiples of the binning, {binning}");
                return Err(DeviceError::Unknown { name: origin_name, asked, known });
            }
        }
        Ok(())
    }

    /// Sets a vector that answers at once.
    fn set_now(
        &mut self,
        name: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let soon = deadline.at_most(self.settings.session.answer_within);
        self.session.change(name, wanted, &soon).map(drop)
    }

    pub(super) fn set_frame(
        &mut self,
        name: &str,
        window: &Window,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let Window { origin_px: [x, y], size_px: [width, height], .. } = *window;
        let numbers = [
            ("X", f64::from(x)),
            ("Y", f64::from(y)),
            ("WIDTH", f64::from(width)),
            ("HEIGHT", f64::from(height)),
        ];
        self.set_now(name, Wanted::Numbers(&numbers), deadline)
    }

    /// Where the gain is kept: drivers have one of two.
    fn gain_place(&self) -> Result<(&'static str, &'static str), DeviceError> {
        [("CCD_GAIN", "GAIN"), ("CCD_CONTROLS", "Gain")]
            .into_iter()
            .find(|(name, member)| {
                self.session.property(name).is_some_and(|vector| vector.member(member).is_some())
            })
            .ok_or(DeviceError::NotReady { device: DEVICE, reason: "it has no gain to set" })
    }

    /// The sensor's temperature as it was last said to be, °C.
    pub(super) fn temperature_c(&self) -> Option<f64> {
        self.session.property("CCD_TEMPERATURE")?.number("CCD_TEMPERATURE_VALUE")
    }

    pub(super) fn taken(&self) -> Taken {
        Taken { window: self.window, pattern: self.bayer(), asked: (self.settings.utc)() }
    }

    pub(super) fn require_idle(&self) -> Result<(), DeviceError> {
        if self.running {
            let reason = "an exposure or a stream could not be stopped: reopen or reconnect it";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        Ok(())
    }

    /// Stops what runs, within a time of its own. `error` is what it is stopped for.
    pub(super) fn stop_after(
        &mut self,
        error: DeviceError,
        name: &str,
        wanted: Wanted<'_>,
        deadline: &Deadline,
    ) -> DeviceError {
        // A server that has gone cannot be asked, and a driver that has ended exposes no more.
        if matches!(error, DeviceError::Lost { .. } | DeviceError::Declined { .. }) {
            return error;
        }
        self.running = true;
        let grace = deadline.grace(self.settings.abort_within);
        let device = self.session.device.clone();
        if self.session.client.pulse(&device, name, wanted, &grace).is_ok() {
            self.running = false;
        }
        error
    }

    /// Waits for the frame of the exposure that was just asked for.
    ///
    /// Gives it with the host's time at which the server had taken the request.
    fn await_frame(
        &mut self,
        exposure_s: f64,
        deadline: &Deadline,
    ) -> Result<(Blob, Epoch), DeviceError> {
        let device = self.session.device.clone();
        let utc = self.settings.utc;
        let awaited = format!("the frame of an exposure of {exposure_s} s");
        let mut said = Vec::new();
        // A frame that comes before the server took the request is that of another exposure.
        let mut begun = None;
        // What was left of it last.
        let mut before: Option<f64> = None;
        let (mut others, mut doubted) = (false, false);
        let found =
            self.session.client.wait(&device, &awaited, deadline, |client, event| match event {
                Event::Message { text, .. } => {
                    hear(&mut said, text);
                    None
                }
                Event::Changed(place, state)
                    if place.device == device && place.name == "CCD_EXPOSURE" =>
                {
                    // It counts down from what was asked: what is more is another's.
                    let left = client.property(&device, "CCD_EXPOSURE");
                    let left = left.and_then(|vector| vector.number("CCD_EXPOSURE_VALUE"));
                    let own = left.is_none_or(|left| is_left_of(left, exposure_s));
                    if state == State::Busy {
                        others |= !own;
                        if own {
                            begun.get_or_insert_with(utc);
                            let again = |(before, now)| begins_anew(before, now, exposure_s);
                            doubted |= before.zip(left).is_some_and(again);
                            before = left.or(before);
                        }
                    }
                    let request = format!("an exposure of {exposure_s} s");
                    (state == State::Alert).then(|| Err(declined(DEVICE, request, &said)))
                }
                Event::Blob(place, blob) if place.device == device && place.name == BLOB => {
                    others |= begun.is_none();
                    begun.map(|begun| Ok((blob, begun)))
                }
                Event::Damaged(place, what) if place.device == device && place.name == BLOB => {
                    Some(Err(DeviceError::Protocol { device: DEVICE, reason: what }))
                }
                Event::Deleted(place) if place.device == device && place.name == BLOB => {
                    let what = format!("`{device}` has taken back {BLOB}: was it disconnected?");
                    Some(Err(DeviceError::Lost { device: DEVICE, what }))
                }
                _ => None,
            });
        self.others.seen |= others;
        self.others.doubted = doubted;
        found
    }

    /// Reads what came since the last frame: an exposure or a frame that nobody here asked for is another program's.
    fn look_for_others(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let device = self.session.device.clone();
        let all = deadline.at_most(BEFORE_MOST);
        let mut exposing = false;
        loop {
            match self.session.client.event(&all.at_most(BEFORE)) {
                Ok(Event::Blob(place, _)) if place.device == device && place.name == BLOB => {
                    self.others.seen = true;
                }
                Ok(Event::Changed(place, State::Busy))
                    if place.device == device && place.name == "CCD_EXPOSURE" =>
                {
                    // After an abort the driver may leave it Busy: only what counts down is an exposure.
                    self.others.seen |= std::mem::replace(&mut exposing, true);
                }
                Ok(_) => {}
                Err(DeviceError::Transport {
                    source: crate::transport::TransportError::Timeout { .. },
                    ..
                }) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }

    /// Holds a frame against what was asked for.
    fn check_frame(
        &mut self,
        Exposed { frame, later_s }: &mut Exposed,
        exposure_s: f64,
    ) -> Result<(), String> {
        let got = frame.exposure_s;
        if !self.others.takes(got, exposure_s) {
            return Err(format!("its exposure is {got} s, asked was {exposure_s} s"));
        }
        if !is_exposure(got, exposure_s) {
            frame.header.set(ASKED, exposure_s, "s, asked for; the driver takes another");
        }
        if let (Some(asked), Some(said)) = (self.wishes.frame_type, frame.header.text("FRAME")) {
            let said = said.trim();
            let known = FrameType::ALL.iter().any(|kind| said.eq_ignore_ascii_case(kind.word()));
            if known && !said.eq_ignore_ascii_case(asked.word()) {
                return Err(format!("it is a {said} frame, asked was {}", asked.word()));
            }
        }
        if let Some(asked) = self.wishes.gain {
            let (name, member) = self.gain_place().map_err(|error| error.to_string())?;
            let now = self.session.number(name, member).map_err(|error| error.to_string())?;
            if (now - asked).abs() > 1e-6 * asked.abs().max(1.0) {
                return Err(format!("another program has set the gain to {now}, ours is {asked}"));
            }
        }
        self.others.doubted |= self.others.is_early(*later_s);
        if self.others.seen || self.others.doubted {
            frame.header.set(SHARED, true, "another program uses this camera: it may be its frame");
        }
        Ok(())
    }
}

impl<T: Bytes> Device for Camera<T> {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity()
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.window = self.read_window()?;
        let soon = deadline.at_most(self.settings.session.answer_within);
        let mut settings = Vec::new();
        let mut add = |name, value| {
            settings.push(Setting { name, value, origin: Origin::ReadBack });
        };
        let Window { origin_px, size_px, binning } = self.window;
        add("origin_x_px", Value::Integer(origin_px[0].into()));
        add("origin_y_px", Value::Integer(origin_px[1].into()));
        add("columns_px", Value::Integer(size_px[0].into()));
        add("rows_px", Value::Integer(size_px[1].into()));
        add("binning_x", Value::Integer(binning[0].into()));
        add("binning_y", Value::Integer(binning[1].into()));
        if let Ok((name, member)) = self.gain_place() {
            add("gain", Value::Number(self.session.number(name, member)?));
        }
        if let Some(bayer) = self.bayer() {
            add("bayer", Value::Text(bayer.name().into()));
        }
        if let Some(types) = self.session.property("CCD_FRAME_TYPE")
            && let Some(on) = types.members.iter().find(|m| types.is_on(&m.name) == Some(true))
        {
            add("frame_type", Value::Text(on.name.trim_start_matches("FRAME_").to_lowercase()));
        }
        if self.temperature_c().is_some() {
            let session = &mut self.session;
            session.client.refresh(&session.device, "CCD_TEMPERATURE", &soon)?;
            let now = session.number("CCD_TEMPERATURE", "CCD_TEMPERATURE_VALUE")?;
            add("temperature_c", Value::Number(now));
        }
        Ok(settings)
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        match self.session.property("CCD_FRAME_TYPE") {
            Some(_) => &[FrameType::SETTING],
            None => &[],
        }
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        let kind = FrameType::of_setting(name, value)?;
        self.set_frame_type(kind, d).map(|()| Value::Text(value.to_owned()))
    }
}

impl<T: Bytes> device::Camera for Camera<T> {
    fn limits(&self) -> Option<Limits> {
        let range = |name: &str, member: &str| self.session.property(name)?.range(member);
        let cooler = self.session.property("CCD_TEMPERATURE").filter(|vector| vector.writable);
        // A driver that says no range takes all numbers.
        let any = Interval::new(f64::MIN, f64::MAX);
        let binning = match self.session.property("CCD_BINNING") {
            None => Some(1),
            Some(vector) => vector.range("HOR_BIN").map(|range| range.high as u32),
        };
        Some(Limits {
            exposure_s: range("CCD_EXPOSURE", "CCD_EXPOSURE_VALUE"),
            gain: self.gain_place().ok().map(|(name, member)| range(name, member).unwrap_or(any)),
            temperature_c: cooler.map(|v| v.range("CCD_TEMPERATURE_VALUE").unwrap_or(any)),
            binning,
            ..Limits::default()
        })
    }

    fn sensor_px(&self) -> [u32; 2] {
        self.sensor_px
    }

    /// Frames are cut to whole binned pixels; the origin must be a multiple of the binning.
    fn set_window(&mut self, window: Window, deadline: &Deadline) -> Result<Window, DeviceError> {
        self.check_window(&window)?;
        if self.session.property("CCD_BINNING").is_some() {
            let [x, y] = window.binning.map(f64::from);
            let numbers = [("HOR_BIN", x), ("VER_BIN", y)];
            self.set_now("CCD_BINNING", Wanted::Numbers(&numbers), deadline)?;
        }
        // After the binning, which resets the window of some cameras.
        self.set_frame("CCD_FRAME", &window, deadline)?;
        self.window = self.read_window()?;
        self.wishes.window = Some(window);
        Ok(self.window)
    }

    fn set_gain(&mut self, gain: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let (name, member) = self.gain_place()?;
        check_range("gain", gain, self.session.require(name)?.range(member))?;
        self.set_now(name, Wanted::Numbers(&[(member, gain)]), deadline)?;
        self.wishes.gain = Some(gain);
        self.session.number(name, member)
    }

    fn set_temperature_c(
        &mut self,
        temperature_c: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        const NAME: &str = "CCD_TEMPERATURE";
        const MEMBER: &str = "CCD_TEMPERATURE_VALUE";
        let device = self.session.device.clone();
        let Some(vector) = self.session.property(NAME).filter(|vector| vector.writable) else {
            let reason = "it has no cooling that can be set";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        check_range("sensor temperature, °C", temperature_c, vector.range(MEMBER))?;
        let soon = deadline.at_most(self.settings.session.answer_within);
        let wanted = Wanted::Numbers(&[(MEMBER, temperature_c)]);
        let client = &mut self.session.client;
        client.set(&device, NAME, wanted, &soon)?;
        // It is Busy until it is cold, which takes minutes: to be taken is enough.
        let mut said = Vec::new();
        let request = format!("a sensor temperature of {temperature_c} °C");
        client.wait(&device, "the answer to the temperature", &soon, |_, event| match event {
            Event::Message { text, .. } => {
                hear(&mut said, text);
                None
            }
            Event::Changed(place, state) if place.device == device && place.name == NAME => {
                Some(match state {
                    State::Alert => Err(declined(DEVICE, request.clone(), &said)),
                    _ => Ok(()),
                })
            }
            _ => None,
        })?;
        self.session.number(NAME, MEMBER)
    }

    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        const NAME: &str = "CCD_EXPOSURE";
        const MEMBER: &str = "CCD_EXPOSURE_VALUE";
        self.require_idle()?;
        check_range("exposure, s", exposure_s, self.session.require(NAME)?.range(MEMBER))?;
        self.session.require(BLOB)?;
        self.look_for_others(deadline)?;
        let taken = self.taken();
        let device = self.session.device.clone();
        let wanted = Wanted::Numbers(&[(MEMBER, exposure_s)]);
        let client = &mut self.session.client;
        let (blob, answered) = client
            .set(&device, NAME, wanted, deadline)
            .and_then(|()| self.await_frame(exposure_s, deadline))
            .map_err(|error| {
                // CCD_EXPOSURE may stay Busy for ever after an abort: the abort's own answer counts.
                let abort = Wanted::Switches(&[("ABORT", true)]);
                self.stop_after(error, "CCD_ABORT_EXPOSURE", abort, deadline)
            })?;
        // A frame does not say its origin: it must not be given that of a window that is no more.
        let window = self.read_window()?;
        if window != self.window {
            let what = format!(
                "another program has changed its window to {window:?}: set it again before the next frame"
            );
            self.window = window;
            self.others.seen = true;
            return Err(DeviceError::NotOurs { device: DEVICE, what });
        }
        let not_ours = |what| DeviceError::NotOurs { device: DEVICE, what };
        let most = self.session.client.blob_limit();
        let mut exposed = match from_blob(blob, most, &taken, answered) {
            Ok(exposed) => exposed,
            Err(Unfit::Unreadable(reason)) => return Err(self.session.protocol(reason)),
            Err(Unfit::NotOurs(what)) => return Err(not_ours(what)),
        };
        self.check_frame(&mut exposed, exposure_s).map_err(not_ours)?;
        Ok(exposed.frame)
    }

    fn stream(
        &mut self,
        exposure_s: f64,
        take: &mut dyn FnMut(Frame) -> ControlFlow<()>,
        deadline: &Deadline,
    ) -> Result<u64, Interrupted<u64>> {
        self.stream_frames(exposure_s, take, deadline)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: what is left only falls, by a driver that rounds it to whole seconds, too (10.6 s: 10.6, 11, 10, …); a second request of the same length begins anew.
    #[test]
    fn an_exposure_that_begins_anew_is_told_from_one_that_counts_down() {
        for (before, now, exposure_s, anew) in [
            (0.5, 0.5, 0.5, true),
            (0.5, 0.4999, 0.5, false),
            (0.2, 0.5, 0.5, true),
            (10.0, 10.0, 10.0, false),
            (10.6, 11.0, 10.6, false),
            (10.6, 10.6, 10.6, true),
            (4.0, 10.0, 10.0, true),
            (4.0, 4.0, 10.0, false),
        ] {
            assert_eq!(begins_anew(before, now, exposure_s), anew, "{before} {now} {exposure_s}");
        }
        assert!(is_left_of(11.0, 10.6) && !is_left_of(11.1, 10.6));
        assert!(is_left_of(0.3, 0.3) && !is_left_of(0.5, 0.3));
    }

    /// Truth: by hand: clocks that are 2 s apart are no sign, one exposure that began half a second earlier than the others is; a clock that was set is usual after some frames.
    #[test]
    fn an_exposure_that_had_begun_before_is_early() {
        let mut others = Others::default();
        for later_s in [-2.0, -1.99, -2.01, -1.9, -2.05] {
            assert!(!others.is_early(later_s), "{later_s}");
        }
        assert!(others.is_early(-2.5));
        assert!(!others.is_early(-2.0));
        let early = (0..9).filter(|_| others.is_early(-7.0)).count();
        assert!((1..9).contains(&early), "{early}");
        assert!(others.later_s.len() <= 9);
    }
}
