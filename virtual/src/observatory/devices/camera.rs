//! A camera that takes the pictures of a virtual night.

use crate::observatory::frame::{Exposure, Sensor};
use crate::observatory::options::CameraOptions;
use crate::observatory::random::{Purpose, seed_of, stream};
use crate::observatory::watch::{FrameTruth, Watch};
use hifitime::Epoch;
use rand_distr::{Distribution as _, StandardNormal};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Identity, Origin, Setting, Value, Window,
};
use sunglint_formats::{Bayer, Frame, fits::Header};

const DEVICE: &str = "virtual camera";

/// The camera of a virtual night. Its frames say that they began at the moment at which they were asked for, on the clock of the deadline; they begin the options'
/// `latency_s` later.
#[derive(Debug)]
pub struct VirtualCamera {
    watch: Watch,
    sensor: Sensor,
    gain_e_per_adu: Option<f64>,
    window: Window,
    gain: f64,
    truth: Option<FrameTruth>,
}

impl VirtualCamera {
    pub(super) fn new(watch: Watch, sensor: Sensor, gain_e_per_adu: Option<f64>) -> Self {
        let window = Window { origin_px: [0, 0], size_px: sensor.size_px, binning: [1, 1] };
        Self { watch, sensor, gain_e_per_adu, window, gain: 0.0, truth: None }
    }

    /// The truth of the last frame.
    pub fn last_truth(&self) -> Option<&FrameTruth> {
        self.truth.as_ref()
    }

    /// The frame of an exposure that was asked for so long after the night's begin.
    fn frame(
        &mut self,
        exposure_s: f64,
        start: Duration,
        latency_s: f64,
    ) -> Result<Frame, DeviceError> {
        let Window { origin_px, size_px, binning } = self.window;
        let exposure = Exposure { origin_px, size_px, binning, exposure_s };
        let frame = self.watch.frame(&exposure, start.as_secs_f64() + latency_s);
        let (pixels, truth) = frame.ok_or(DeviceError::NotReady {
            device: DEVICE,
            reason: "the station of this night has no camera",
        })?;
        self.truth = Some(truth);
        let night = self.watch.night();
        let sensor = &self.sensor;
        let highest = 2_f64.powi(i32::from(sensor.adc_bits)) - 1.0;
        let full = sensor.bias_adu + sensor.full_well_e / sensor.gain_e_per_adu;
        Ok(Frame {
            pixels,
            origin: origin_px,
            binning,
            bayer: sensor.bayer.and_then(|bayer: Bayer| bayer.of_frame(origin_px, binning)),
            start: at(night.start, start),
            exposure_s,
            gain_e_per_adu: self.gain_e_per_adu,
            temperature_c: Some(night.options.camera.temperature_c),
            saturation_adu: Some(full.min(highest)),
            header: Header::default(),
        })
    }
}

/// Time from a request at a moment of the night to the exposure's begin, s.
fn latency_s(camera: &CameraOptions, seed: u64, asked: Duration) -> f64 {
    let mut random =
        stream(seed_of(seed, Purpose::Part, 5000), Purpose::Frame, asked.as_micros() as u64);
    let jitter: f64 = StandardNormal.sample(&mut random);
    (camera.latency_s + camera.latency_jitter_s * jitter).max(0.0)
}

/// So long after a moment.
pub(super) fn at(start: Epoch, passed: Duration) -> Epoch {
    let nanoseconds = i128::try_from(passed.as_nanos()).unwrap_or(i128::MAX);
    start + hifitime::Duration::from_total_nanoseconds(nanoseconds)
}

impl Device for VirtualCamera {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(Identity {
            vendor: "sunglint".into(),
            model: "virtual camera".into(),
            serial: Some(format!("seed {}", self.watch.night().options.seed)),
            firmware: Some(env!("CARGO_PKG_VERSION").into()),
            driver: "virtual",
        })
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let Window { origin_px: [x, y], size_px: [columns, rows], binning: [across, down] } =
            self.window;
        let window = Value::Text(format!("{x} {y} {columns} {rows} / {across} {down}"));
        let number =
            |name, value| Setting { name, value: Value::Number(value), origin: Origin::ReadBack };
        Ok(vec![
            Setting { name: "window_px", value: window, origin: Origin::ReadBack },
            number("gain", self.gain),
            number("gain_e_per_adu", self.sensor.gain_e_per_adu),
            number("temperature_c", self.watch.night().options.camera.temperature_c),
        ])
    }
}

impl Camera for VirtualCamera {
    fn sensor_px(&self) -> [u32; 2] {
        self.sensor.size_px
    }

    fn set_window(&mut self, window: Window, _: &Deadline) -> Result<Window, DeviceError> {
        for axis in 0..2 {
            let sensor = self.sensor.size_px[axis];
            let bins = window.binning[axis];
            let range = |name, asked: u32, least: u32, most: u32| {
                let (asked, least, most) = (f64::from(asked), f64::from(least), f64::from(most));
                DeviceError::OutOfRange { name, asked, least, most }
            };
            if bins == 0 || bins > sensor {
                return Err(range("binning", bins, 1, sensor));
            }
            let size = window.size_px[axis];
            if size < bins || size > sensor {
                return Err(range("size_px", size, bins, sensor));
            }
            if window.origin_px[axis] > sensor - size {
                return Err(range("origin_px", window.origin_px[axis], 0, sensor - size));
            }
        }
        // Whole pixels of the frame, from an origin that is a multiple of the binning, as FITS counts it.
        let whole =
            |values: [u32; 2]| [0, 1].map(|i| values[i] / window.binning[i] * window.binning[i]);
        let (origin_px, size_px) = (whole(window.origin_px), whole(window.size_px));
        self.window = Window { origin_px, size_px, binning: window.binning };
        Ok(self.window)
    }

    /// The night has one gain, the station's: the camera's own steps begin and end at 0.
    fn set_gain(&mut self, gain: f64, _: &Deadline) -> Result<f64, DeviceError> {
        if gain != 0.0 {
            return Err(DeviceError::OutOfRange {
                name: "gain",
                asked: gain,
                least: 0.0,
                most: 0.0,
            });
        }
        Ok(self.gain)
    }

    /// The sensor has the temperature of the night's options, whatever is asked for.
    fn set_temperature_c(&mut self, _: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(self.watch.night().options.camera.temperature_c)
    }

    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        if !(0.0..=3600.0).contains(&exposure_s) {
            let (least, most) = (0.0, 3600.0);
            return Err(DeviceError::OutOfRange {
                name: "exposure_s",
                asked: exposure_s,
                least,
                most,
            });
        }
        let start = deadline.now();
        let camera = &self.watch.night().options.camera;
        let latency_s = latency_s(camera, self.watch.night().options.seed, start);
        let rows = self.window.size_px[1] / self.window.binning[1].max(1);
        let after_s = camera.readout_s + camera.row_time_s * f64::from(rows);
        deadline
            .sleep(Duration::from_secs_f64(latency_s + exposure_s + after_s))
            .map_err(|expired| DeviceError::expired(DEVICE, "exposing", expired))?;
        self.frame(exposure_s, start, latency_s)
    }
}
