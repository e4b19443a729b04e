//! A live device, through OpenCV's Video4Linux. **Not tried with a device yet**, only without one.
//!
//! OpenCV is told to convert nothing, so that the pixels are the sensor's: of `Y16 ` it would otherwise give 8 bits, three times.

use crate::capture::{self, About, Automation, Capture, four_characters, printable};
use crate::error::{DEVICE, said, wrong};
use crate::mat;
use crate::picture::Picture;
use hifitime::Epoch;
use opencv::core::Mat;
use opencv::prelude::*;
use opencv::videoio::{self, VideoCapture};
use std::path::PathBuf;
use sunglint_drivers::clock::utc_now;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::Bayer;

/// Which device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// `/dev/videoN`.
    Number(u32),
    /// A path, such as one of `/dev/v4l/by-id`, which stays when others are plugged in.
    Path(PathBuf),
}

impl Place {
    fn path(&self) -> PathBuf {
        match self {
            Self::Number(number) => PathBuf::from(format!("/dev/video{number}")),
            Self::Path(path) => path.clone(),
        }
    }
}

/// The pixels that are asked for, each a sample of the sensor. JPEG and film codecs are not among them: they are lossy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// `GREY`: 8 bits, monochrome.
    Grey8,
    /// `Y16 `: 16 bits, monochrome.
    Grey16,
    /// `YUYV`: the brightness of it, 8 bits.
    Yuyv,
    /// `UYVY`: the brightness of it, 8 bits.
    Uyvy,
    /// The mosaic itself, 8 bits (`RGGB`, `GRBG`, `GBRG`, `BA81`).
    Bayer8(Bayer),
    /// `BGR3`: blue, green and red, 8 bits each.
    Bgr,
}

impl Format {
    /// The four characters that Video4Linux has for it.
    pub fn code(self) -> &'static str {
        match self {
            Self::Grey8 => "GREY",
            Self::Grey16 => "Y16 ",
            Self::Yuyv => "YUYV",
            Self::Uyvy => "UYVY",
            Self::Bayer8(Bayer::Bggr) => "BA81",
            Self::Bayer8(bayer) => bayer.name(),
            Self::Bgr => "BGR3",
        }
    }

    fn bayer(self) -> Option<Bayer> {
        match self {
            Self::Bayer8(bayer) => Some(bayer),
            _ => None,
        }
    }
}

/// Where the length of an exposure comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExposureControl {
    /// The driver's absolute exposure, in steps of 100 µs, after its automatic one has been turned off.
    Driver,
    /// The device has no such control (analogue video): it always takes this long, s.
    Fixed(f64),
}

/// A live device and how it is set up.
#[derive(Debug, Clone)]
pub struct Live {
    /// Which device.
    pub place: Place,
    /// The pixels.
    pub format: Format,
    /// Columns and rows, px; `None` leaves what the driver has.
    pub size_px: Option<[u32; 2]>,
    /// Pictures a second; `None` leaves what the driver has.
    pub rate_hz: Option<f64>,
    /// Where the length of an exposure comes from.
    pub exposure: ExposureControl,
    /// How many pictures the driver may hold from before a single exposure was asked for; they are thrown away, and one more
    /// that may have begun before. OpenCV's Video4Linux holds four.
    pub held: u32,
    /// The host's UTC.
    pub utc: fn() -> Epoch,
}

impl Live {
    /// A device with the driver's own size, rate and exposure control.
    pub fn new(place: Place, format: Format) -> Self {
        let exposure = ExposureControl::Driver;
        Self { place, format, size_px: None, rate_hz: None, exposure, held: 4, utc: utc_now }
    }
}

/// Step of Video4Linux' absolute exposure, s.
const STEP_S: f64 = 1e-4;
/// Video4Linux' manual exposure.
const MANUAL: f64 = 1.0;

/// An open device.
pub(crate) struct Device {
    live: Live,
    device: VideoCapture,
    about: About,
    next: u64,
}

impl Device {
    pub fn open(live: Live) -> Result<Self, DeviceError> {
        let path = live.place.path();
        let shown = path.display().to_string();
        let doing = format!("opening {shown}");
        let failed = |error: opencv::Error| said(&doing, &error);
        if !path.exists() {
            return Err(wrong(format!(
                "there is no camera at {shown}: is it plugged in, and does its driver know it (`ls /dev/v4l/by-id`, `dmesg`)?"
            )));
        }
        let device = match &live.place {
            Place::Number(number) => {
                let number = i32::try_from(*number).map_err(|_| wrong(format!("no {shown}")))?;
                VideoCapture::new(number, videoio::CAP_V4L2)
            }
            Place::Path(path) => VideoCapture::from_file(path, videoio::CAP_V4L2),
        }
        .map_err(failed)?;
        if !device.is_opened().map_err(failed)? {
            return Err(wrong(format!(
                "{shown} is there, but does not open as a camera: does it grab pictures at all, may this user read it (group video), is another program using it?"
            )));
        }
        let backend = device.get_backend_name().map_err(failed)?;
        let codec = Some(live.format.code().to_owned());
        let about =
            About { name: shown, backend, codec, bayer: live.format.bayer(), ..About::default() };
        let mut open = Self { live, device, about, next: 0 };
        open.prepare()?;
        Ok(open)
    }

    fn get(&self, which: i32) -> Result<f64, DeviceError> {
        self.device.get(which).map_err(|error| said(&self.about.name, &error))
    }

    /// Sets a property and gives what it then is; `None` if the driver does not take it.
    fn set(&mut self, which: i32, value: f64) -> Result<Option<f64>, DeviceError> {
        let taken = self.device.set(which, value).map_err(|e| said(&self.about.name, &e))?;
        if taken { self.get(which).map(Some) } else { Ok(None) }
    }

    fn prepare(&mut self) -> Result<(), DeviceError> {
        let code = self.live.format.code();
        let wanted = code.bytes().rev().fold(0_u32, |sum, byte| sum << 8 | u32::from(byte));
        self.set(videoio::CAP_PROP_FOURCC, wanted.into())?;
        let got = four_characters(self.get(videoio::CAP_PROP_FOURCC)?);
        if got != code {
            return Err(not_taken("pixel format", code, printable(&got)));
        }
        if let Some([columns, rows]) = self.live.size_px {
            self.set(videoio::CAP_PROP_FRAME_WIDTH, columns.into())?;
            self.set(videoio::CAP_PROP_FRAME_HEIGHT, rows.into())?;
        }
        if let Some(rate_hz) = self.live.rate_hz {
            let got = self.set(videoio::CAP_PROP_FPS, rate_hz)?;
            if got.is_none_or(|got| (got - rate_hz).abs() > 1e-3 * rate_hz) {
                let got = got.map_or("nothing".into(), |got| got.to_string());
                return Err(not_taken("pictures a second, Hz", rate_hz, got));
            }
        }
        // Last: another format turns the conversion on again.
        self.set(videoio::CAP_PROP_CONVERT_RGB, 0.0)?;
        if self.get(videoio::CAP_PROP_CONVERT_RGB)? != 0.0 {
            return Err(not_taken("conversion to BGR", "off", "on".into()));
        }
        let got = [
            self.get(videoio::CAP_PROP_FRAME_WIDTH)? as u32,
            self.get(videoio::CAP_PROP_FRAME_HEIGHT)? as u32,
        ];
        if let Some(size) = self.live.size_px.filter(|size| *size != got) {
            return Err(not_taken("columns and rows, px", format!("{size:?}"), format!("{got:?}")));
        }
        self.about.size_px = got;
        self.about.interval_s = capture::interval_s(self.get(videoio::CAP_PROP_FPS)?);
        Ok(())
    }
}

fn not_taken(name: &'static str, asked: impl ToString, got: String) -> DeviceError {
    DeviceError::NotTaken { device: DEVICE, name, asked: asked.to_string(), got }
}

impl Capture for Device {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn next(&mut self) -> Result<Option<Picture>, DeviceError> {
        let doing = format!("a picture of {}", self.about.name);
        let failed = |error: opencv::Error| said(&doing, &error);
        let lost = |what: &str| {
            let what = format!("{} {what}", self.about.name);
            DeviceError::Lost { device: DEVICE, what }
        };
        if !self.device.grab().map_err(failed)? {
            return Err(lost("gave no picture (10 s without one, or unplugged)"));
        }
        // Before the pixels are copied, which takes time.
        let arrived = Some((self.live.utc)());
        let mut mat = Mat::default();
        if !self.device.retrieve_def(&mut mat).map_err(failed)? {
            return Err(lost("gave a picture without pixels"));
        }
        let (planes, bits) = match self.live.format {
            Format::Yuyv => mat::brightness(&mat, 0),
            Format::Uyvy => mat::brightness(&mat, 1),
            _ => mat::planes(&mat),
        }
        .map_err(|found| wrong(format!("{doing}: {found}")))?;
        let expected = if self.live.format == Format::Grey16 { 16 } else { 8 };
        if bits != expected {
            return Err(wrong(format!("{doing} has {bits} bits, expected {expected}")));
        }
        let position = self.get(videoio::CAP_PROP_POS_MSEC)?;
        let position_ms = Some(position).filter(|ms| ms.is_finite() && *ms > 0.0);
        let index = self.next;
        self.next += 1;
        let readings = self.exposure_and_gain();
        Ok(Some(Picture { planes, bits, index, position_ms, arrived, readings }))
    }

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<f64, DeviceError> {
        const NAME: &str = "exposure, s";
        match self.live.exposure {
            ExposureControl::Fixed(fixed_s) if (fixed_s - exposure_s).abs() > 1e-6 * fixed_s => {
                return Err(not_taken(NAME, exposure_s, format!("{fixed_s}, which is fixed")));
            }
            ExposureControl::Fixed(fixed_s) => return Ok(fixed_s),
            ExposureControl::Driver => {}
        }
        let steps = (exposure_s / STEP_S).round();
        if !(1.0..=1e9).contains(&steps) {
            let (asked, least, most) = (exposure_s, STEP_S, 1e9 * STEP_S);
            return Err(DeviceError::OutOfRange { name: NAME, asked, least, most });
        }
        // A driver without an automatic exposure has nothing to turn off.
        self.set(videoio::CAP_PROP_AUTO_EXPOSURE, MANUAL)?;
        match self.set(videoio::CAP_PROP_EXPOSURE, steps)? {
            Some(got) if got == steps => Ok(got * STEP_S),
            Some(got) => Err(not_taken(NAME, exposure_s, (got * STEP_S).to_string())),
            None => {
                let reason = "its driver takes no exposure: give the length that it has (ExposureControl::Fixed)";
                Err(DeviceError::NotReady { device: DEVICE, reason })
            }
        }
    }

    fn set_gain(&mut self, gain: f64) -> Result<f64, DeviceError> {
        match self.set(videoio::CAP_PROP_GAIN, gain)? {
            Some(got) => Ok(got),
            None => {
                let reason = "its driver takes no gain, or not this one";
                Err(DeviceError::NotReady { device: DEVICE, reason })
            }
        }
    }

    fn exposure_and_gain(&self) -> [Option<f64>; 2] {
        // OpenCV says -1 or 0 where there is no such control.
        let known = |which| self.device.get(which).ok().filter(|value| *value > 0.0);
        let exposure_s = match self.live.exposure {
            ExposureControl::Fixed(fixed_s) => Some(fixed_s),
            ExposureControl::Driver => {
                known(videoio::CAP_PROP_EXPOSURE).map(|steps| steps * STEP_S)
            }
        };
        [exposure_s, known(videoio::CAP_PROP_GAIN)]
    }

    /// Video4Linux has 0 for an automatic exposure, 1 for a manual one, 2 and 3 for those that leave the shutter or the iris. OpenCV hands no
    /// automatic gain on: that the gain changes is seen in each picture's readings.
    fn automation(&self) -> Automation {
        let said = self.device.get(videoio::CAP_PROP_AUTO_EXPOSURE).ok();
        // OpenCV says -1 where there is no such control.
        let exposure = said.filter(|value| *value >= 0.0).map(|value| value != MANUAL);
        Automation { exposure, gain: None }
    }
}
