//! A camera.

use super::answer::{said, value_of};
use super::http::Response;
use super::image::{AlpacaImage, HEADER_BYTES, ImageError, image_bytes, image_json};
use super::session::{Place, Session, SessionSettings};
use crate::clock::{Deadline, utc_now};
use crate::device::{
    self, Device, DeviceError, FrameType, HostTime, Identity, Limits, Origin, Setting, Value,
    Window,
};
use crate::transport::Bytes;
use hifitime::Epoch;
use std::time::Duration;
use sunglint_formats::fits::Header;
use sunglint_formats::time::parse_utc;
use sunglint_formats::{Bayer, Frame};
use sunglint_numerics::measured::Interval;

const DEVICE: &str = "Alpaca camera";
/// Bytes of a pixel in JSON, its comma and its share of a column's brackets among them.
const JSON_PIXEL_BYTES: usize = 9;
/// More pixels along a side than any sensor has.
const MOST_SIDE: i64 = 100_000;

/// A camera of an Alpaca server.
///
/// Frames begin when the server says so (`LastExposureStartTime`), where it says fractions of a second and lies within 5 s of the host; else when the host asked.
#[derive(Debug)]
pub struct Camera<T> {
    session: Session<T>,
    sensor_px: [u32; 2],
    window: Window,
    bayer: Option<Bayer>,
    limits: Limits,
    frame_type: FrameType,
    aborts: bool,
    /// The last exposure could not be stopped.
    running: bool,
}

impl<T: Bytes> Camera<T> {
    /// Opens the camera and reads what it is.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn open(
        line: T,
        place: &Place,
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Session::open(line, place, [DEVICE, "camera"], settings, deadline)?;
        let mut sensor_px = [0; 2];
        for (side, member) in sensor_px.iter_mut().zip(["cameraxsize", "cameraysize"]) {
            // Within the range, which fits.
            *side = session.integer(member, [1, MOST_SIDE], deadline)? as u32;
        }
        let bayer = bayer(&mut session, deadline)?;
        let range = |session: &mut Session<T>, [least, most]: [&str; 2]| {
            let (least, most) = (
                session.optional_number(least, deadline)?,
                session.optional_number(most, deadline)?,
            );
            Ok::<_, DeviceError>(least.zip(most).filter(|(least, most)| least <= most))
        };
        let exposure = range(&mut session, ["exposuremin", "exposuremax"])?;
        let gain = range(&mut session, ["gainmin", "gainmax"])?;
        let binning = session.optional_number("maxbinx", deadline)?;
        let cools = session.can("cansetccdtemperature", deadline)?;
        let limits = Limits {
            exposure_s: exposure.map(|(least, most)| Interval::new(least, most)),
            gain: gain.map(|(least, most)| Interval::new(least, most)),
            // ASCOM has no range of it.
            temperature_c: cools.then_some(Interval::new(-100.0, 50.0)),
            binning: binning.filter(|n| (1.0..=64.0).contains(n)).map(|n| n as u32),
            ..Limits::default()
        };
        let aborts = session.can("canabortexposure", deadline)?;
        let window = Window { origin_px: [0, 0], size_px: sensor_px, binning: [1, 1] };
        let mut camera = Self {
            session,
            sensor_px,
            window,
            bayer,
            limits,
            frame_type: FrameType::default(),
            aborts,
            running: false,
        };
        camera.window = camera.read_window(deadline)?;
        Ok(camera)
    }

    /// The part of the sensor that is read.
    pub fn window(&self) -> Window {
        self.window
    }

    fn read_window(&mut self, deadline: &Deadline) -> Result<Window, DeviceError> {
        let mut numbers = [0_u32; 6];
        let members = ["startx", "starty", "numx", "numy", "binx", "biny"];
        for (i, (slot, member)) in numbers.iter_mut().zip(members).enumerate() {
            let least = i64::from(i >= 2);
            *slot = self.session.integer(member, [least, MOST_SIDE], deadline)? as u32;
        }
        let [x, y, columns, rows, bin_x, bin_y] = numbers;
        // ASCOM counts the window in binned pixels.
        let unbinned = |n: u32, bin: u32| n.saturating_mul(bin);
        Ok(Window {
            origin_px: [unbinned(x, bin_x), unbinned(y, bin_y)],
            size_px: [unbinned(columns, bin_x), unbinned(rows, bin_y)],
            binning: [bin_x, bin_y],
        })
    }

    /// Columns and rows of a frame.
    fn size(&self) -> [u32; 2] {
        let Window { size_px, binning, .. } = self.window;
        [size_px[0] / binning[0].max(1), size_px[1] / binning[1].max(1)]
    }

    fn check_window(&self, window: &Window) -> Result<(), DeviceError> {
        const NAMES: [[&str; 3]; 2] = [
            ["binning in columns", "first column, px", "columns, px"],
            ["binning in rows", "first row, px", "rows, px"],
        ];
        for (axis, [bin_name, origin_name, size_name]) in NAMES.into_iter().enumerate() {
            let (origin, size, bin) =
                (window.origin_px[axis], window.size_px[axis], window.binning[axis]);
            let sensor = self.sensor_px[axis];
            let check = |name, asked: u32, least: u32, most: u32| {
                if (least..=most).contains(&asked) {
                    return Ok(());
                }
                let (asked, least, most) = (asked.into(), least.into(), most.into());
                Err(DeviceError::OutOfRange { name, asked, least, most })
            };
            check(bin_name, bin, 1, self.limits.binning.unwrap_or(sensor))?;
            check(origin_name, origin, 0, sensor - 1)?;
            check(size_name, size, bin, sensor - origin)?;
            if origin % bin != 0 {
                let asked = origin.to_string();
                let known = format!("the multiples of the binning, {bin}");
                return Err(DeviceError::Unknown { name: origin_name, asked, known });
            }
        }
        Ok(())
    }

    /// Stops what runs, within a time of its own. `error` is what it is stopped for.
    fn stop_after(&mut self, error: DeviceError, deadline: &Deadline) -> DeviceError {
        self.running = true;
        let grace = deadline.grace(Duration::from_secs(2));
        if self.aborts && self.session.put("abortexposure", &[], &grace).is_ok() {
            self.running = false;
        }
        error
    }

    /// Waits until the frame is there.
    fn await_frame(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<(), DeviceError> {
        let asked = format!("an exposure of {exposure_s} s");
        let expose = Duration::from_secs_f64(exposure_s);
        let expired = |e| DeviceError::expired(DEVICE, "an exposure", e);
        deadline.sleep(expose).map_err(expired)?;
        self.session.wait("an exposure", deadline, |session, deadline| {
            if session.flag("imageready", deadline)? {
                return Ok(true);
            }
            // ASCOM: 5 is a state of error.
            if session.integer("camerastate", [0, 5], deadline)? == 5 {
                let message = "the camera is in a state of error".to_owned();
                let request = asked.clone();
                return Err(DeviceError::Declined { device: DEVICE, request, message });
            }
            Ok(false)
        })
    }

    fn read_image(&mut self, deadline: &Deadline) -> Result<AlpacaImage, DeviceError> {
        let size = self.size();
        let pixels = (size[0] as usize).saturating_mul(size[1] as usize);
        let most =
            pixels.saturating_mul(JSON_PIXEL_BYTES).saturating_add(HEADER_BYTES + (64 << 10));
        let most = most.min(self.session.settings.frame_bytes);
        let request = "the frame";
        let (response, transaction) =
            self.session.image(most, deadline).map_err(|fail| fail.error(DEVICE, request))?;
        let Response { status, content_type, body } = &response;
        if *status != 200 {
            let fail = value_of(DEVICE, &response, transaction).err();
            self.session.forget();
            return Err(match fail {
                Some(fail) => fail.error(DEVICE, request),
                None => self.session.protocol("no frame came".into()),
            });
        }
        let image = match content_type.as_str() {
            "application/imagebytes" => image_bytes(body, size),
            "application/json" | "text/json" => image_json(body, size),
            other => Err(ImageError::Unfit(format!("the frame came as `{other}`"))),
        };
        let image = image.map_err(|error| match error {
            ImageError::Said(code, words) => said(code, Some(&words)).error(DEVICE, request),
            ImageError::Unfit(reason) => {
                self.session.forget();
                self.session.protocol(reason)
            }
        })?;
        let got = image.client_transaction;
        if got != 0 && got != transaction {
            self.session.forget();
            let reason = format!("the frame answers request {got}, expected {transaction}");
            return Err(self.session.protocol(reason));
        }
        Ok(image)
    }

    /// Begin of the last exposure, as the server says it, with fractions of a second.
    fn began(&mut self, deadline: &Deadline) -> Result<Option<Epoch>, DeviceError> {
        let Some(text) = self.session.text("lastexposurestarttime", deadline)? else {
            return Ok(None);
        };
        let text = text.trim_end_matches("+00:00");
        let fine = text.contains('.');
        Ok(parse_utc(text).ok().filter(|_| fine))
    }
}

/// Colours of the sensor's first 2 × 2 pixels.
fn bayer<T: Bytes>(
    session: &mut Session<T>,
    deadline: &Deadline,
) -> Result<Option<Bayer>, DeviceError> {
    // ASCOM: 0 monochrome, 1 colour planes, 2 RGGB, beyond it patterns of other colours.
    match session.optional("sensortype", deadline)?.and_then(|v| v.as_i64()) {
        Some(2) => {
            let offset = |session: &mut Session<T>, member: &str| {
                let number = session.optional_number(member, deadline)?;
                Ok::<_, DeviceError>(
                    number.filter(|n| (0.0..=3.0).contains(n)).unwrap_or(0.0) as u32
                )
            };
            let (x, y) = (offset(session, "bayeroffsetx")?, offset(session, "bayeroffsety")?);
            Ok(Some(Bayer::Rggb.shifted(x, y)))
        }
        _ => Ok(None),
    }
}

impl<T: Bytes> Device for Camera<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.window = self.read_window(deadline)?;
        let gain = match self.limits.gain {
            Some(_) => self.session.optional_number("gain", deadline)?,
            None => None,
        };
        let temperature = self.session.optional_number("ccdtemperature", deadline)?;
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
        if let Some(gain) = gain {
            add("gain", Value::Number(gain));
        }
        if let Some(bayer) = self.bayer {
            add("bayer", Value::Text(bayer.name().into()));
        }
        settings.push(Setting {
            name: FrameType::SETTING.0,
            value: Value::Text(self.frame_type.word().into()),
            origin: Origin::Configured,
        });
        let mut add = |name, value| {
            settings.push(Setting { name, value, origin: Origin::ReadBack });
        };
        if let Some(temperature) = temperature {
            add("temperature_c", Value::Number(temperature));
        }
        Ok(settings)
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[FrameType::SETTING]
    }

    /// The server is told with each exposure whether there is light in it.
    fn set_own(&mut self, name: &str, value: &str, _: &Deadline) -> Result<Value, DeviceError> {
        self.frame_type = FrameType::of_setting(name, value)?;
        Ok(Value::Text(value.to_owned()))
    }
}

impl<T: Bytes> device::Camera for Camera<T> {
    fn limits(&self) -> Option<Limits> {
        Some(self.limits.clone())
    }

    fn sensor_px(&self) -> [u32; 2] {
        self.sensor_px
    }

    /// Frames are cut to whole binned pixels; the origin must be a multiple of the binning.
    fn set_window(&mut self, window: Window, deadline: &Deadline) -> Result<Window, DeviceError> {
        self.check_window(&window)?;
        let binned = |n: u32, axis: usize| (n / window.binning[axis].max(1)).to_string();
        let Window { origin_px: [x, y], size_px: [columns, rows], binning } = window;
        let values = [
            ("binx", "BinX", binning[0].to_string()),
            ("biny", "BinY", binning[1].to_string()),
            // The whole first: some servers hold each number against the others as they stand.
            ("startx", "StartX", "0".to_owned()),
            ("starty", "StartY", "0".to_owned()),
            ("numx", "NumX", binned(columns, 0)),
            ("numy", "NumY", binned(rows, 1)),
            ("startx", "StartX", binned(x, 0)),
            ("starty", "StartY", binned(y, 1)),
        ];
        for (member, name, value) in values {
            self.session.set(member, name, value, deadline)?;
        }
        self.window = self.read_window(deadline)?;
        Ok(self.window)
    }

    fn set_gain(&mut self, gain: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let Some(Interval { low: least, high: most }) = self.limits.gain else {
            let reason = "it has no gain in numbers (GainMin, GainMax)";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        if !(least..=most).contains(&gain) || gain.fract() != 0.0 {
            return Err(DeviceError::OutOfRange { name: "gain, whole", asked: gain, least, most });
        }
        self.session.set("gain", "Gain", gain.to_string(), deadline)?;
        self.session.number("gain", [least, most], deadline)
    }

    fn set_temperature_c(
        &mut self,
        temperature_c: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        let Some(Interval { low: least, high: most }) = self.limits.temperature_c else {
            let reason = "it has no cooling that can be set";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        if !(least..=most).contains(&temperature_c) {
            let name = "sensor temperature, °C";
            return Err(DeviceError::OutOfRange { name, asked: temperature_c, least, most });
        }
        let text = temperature_c.to_string();
        self.session.set("setccdtemperature", "SetCCDTemperature", text, deadline)?;
        self.session.set("cooleron", "CoolerOn", "true".into(), deadline)?;
        self.session.number("ccdtemperature", [-273.15, 200.0], deadline)
    }

    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        if self.running {
            let reason = "an exposure could not be stopped: open it again";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let [least, most] = self.limits.exposure_s.map_or([0.0, 86_400.0], Interval::to_array);
        if !(least..=most.min(86_400.0)).contains(&exposure_s) {
            let name = "exposure, s";
            return Err(DeviceError::OutOfRange { name, asked: exposure_s, least, most });
        }
        let asked = utc_now();
        // ASCOM's `Light` opens the shutter, if there is one.
        let light = !matches!(self.frame_type, FrameType::Dark | FrameType::Bias);
        let parameters = [("Duration", exposure_s.to_string()), ("Light", light.to_string())];
        let put = self.session.put_once("startexposure", &parameters, deadline);
        put.map_err(|fail| fail.error(DEVICE, &format!("an exposure of {exposure_s} s")))?;
        let host = HostTime { asked, answered: utc_now() };
        if let Err(error) = self.await_frame(exposure_s, deadline) {
            return Err(self.stop_after(error, deadline));
        }
        let image = self.read_image(deadline)?;
        let began = self.began(deadline)?;
        let took = self.session.optional_number("lastexposureduration", deadline)?;
        let took = took.filter(|s| *s >= 0.0 && (*s - exposure_s).abs() <= 0.5 * exposure_s + 0.1);
        let temperature_c = self.session.optional_number("ccdtemperature", deadline)?;
        let gain = self.session.optional_number("electronsperadu", deadline)?;
        let full = self.session.optional_number("maxadu", deadline)?;
        let Window { origin_px, binning, .. } = self.window;
        let mut frame = Frame {
            pixels: image.pixels,
            origin: origin_px,
            binning,
            bayer: self.bayer.and_then(|pattern| pattern.of_frame(origin_px, binning)),
            start: asked,
            exposure_s: took.unwrap_or(exposure_s),
            gain_e_per_adu: gain.filter(|gain| *gain > 0.0),
            temperature_c,
            saturation_adu: full.filter(|full| (1.0..=65_535.0).contains(full)),
            header: Header::default(),
        };
        host.date(&mut frame, began);
        Ok(frame)
    }
}
