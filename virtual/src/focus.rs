//! A focuser with play in its gears, and a camera behind a telescope with a central obstruction, photon by photon.
//!
//! Each photon goes through a point of the telescope's pupil, a ring, and lands beside its star by the defocus times that point, and by the air (Moffat 1969, β = 3).
//! Nothing here knows of radii or curves.

use crate::observatory::random::{Purpose, Random, stream};
use ndarray::Array2;
use rand::RngExt as _;
use rand_distr::{Distribution as _, Normal, Poisson};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, DeviceClock};
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Focuser, Identity, Interrupted, Origin, Setting, Value, Window,
};
use sunglint_formats::{Frame, fits::Header};
use sunglint_numerics::measured::Interval;

const FOCUSER: &str = "virtual focuser";
const CAMERA: &str = "virtual camera";

/// The virtual telescope's focus.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FocusOptions {
    /// Seed.
    pub seed: u64,
    /// Best place of the moving part at 10 °C, steps. The counter shows more or less by the gears' play.
    pub best: f64,
    /// Steps that the best place moves for 1 K.
    pub steps_per_k: f64,
    /// Temperature, °C.
    pub temperature_c: f64,
    /// Highest position, steps.
    pub most: i64,
    /// Where the counter stands at first, steps.
    pub start: i64,
    /// Play of the gears, steps.
    pub play: f64,
    /// Steps a second.
    pub speed: f64,
    /// Radius of the disc of light for each step out of focus, px.
    pub blur_px: f64,
    /// Radius of the obstruction by that of the pupil.
    pub obstruction: f64,
    /// Seeing, full width at half maximum, px.
    pub seeing_px: f64,
    /// Stars.
    pub stars: usize,
    /// Photons of the faintest and of the brightest star, 1/s.
    pub flux_e_s: Interval,
    /// Sky, photons/s in a pixel.
    pub sky_e_s: f64,
    /// Noise of the reading, e.
    pub read_noise_e: f64,
    /// Pixels that count without light, the same in every frame: 200 to 20,000 electrons/s.
    pub hot_pixels: usize,
    /// Columns and rows of the sensor, px.
    pub size_px: [u32; 2],
}

impl Default for FocusOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            best: 25_300.0,
            steps_per_k: 0.0,
            temperature_c: 10.0,
            most: 50_000,
            start: 25_000,
            play: 120.0,
            speed: 2000.0,
            blur_px: 0.006,
            obstruction: 0.35,
            seeing_px: 3.0,
            stars: 12,
            flux_e_s: Interval::new(4000.0, 40_000.0),
            sky_e_s: 20.0,
            read_noise_e: 3.0,
            hot_pixels: 0,
            size_px: [320, 240],
        }
    }
}

impl FocusOptions {
    /// Changes them.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }
}

#[derive(Debug)]
struct State {
    options: FocusOptions,
    /// Reading of the counter, steps.
    counter: i64,
    /// Where the moving part is, steps.
    place: f64,
    frames: u64,
    /// Places and brightnesses of the stars.
    stars: Vec<(f64, f64, f64)>,
    /// Row, column and electrons/s of the hot pixels.
    hot: Vec<(usize, usize, f64)>,
}

impl State {
    /// The counter goes there; the moving part follows where the play is taken up.
    fn turn(&mut self, counter: i64) {
        self.counter = counter;
        let shown = counter as f64;
        self.place = self.place.clamp(shown - self.options.play, shown);
    }

    fn best(&self) -> f64 {
        self.options.best + self.options.steps_per_k * (self.options.temperature_c - 10.0)
    }
}

/// A virtual telescope's focus, of which [`focuser`](Self::focuser) and [`camera`](Self::camera) are two ends.
#[derive(Debug, Clone)]
pub struct FocusBench {
    state: Arc<Mutex<State>>,
    clock: DeviceClock,
}

impl FocusBench {
    /// Makes it.
    pub fn new(options: FocusOptions, clock: DeviceClock) -> Self {
        let mut random = stream(options.seed, Purpose::Stars, 0);
        let [columns, rows] = options.size_px.map(f64::from);
        let [faint, bright] = options.flux_e_s.to_array();
        let star = |_| {
            let (x, y): (f64, f64) = (random.random(), random.random());
            let part: f64 = random.random();
            (x * columns, y * rows, faint * (bright / faint).powf(part))
        };
        let stars = (0..options.stars).map(star).collect();
        let mut random = stream(options.seed, Purpose::Stars, 1);
        let hot = |_| {
            let (r, c): (f64, f64) = (random.random(), random.random());
            let part: f64 = random.random();
            ((r * rows) as usize, (c * columns) as usize, 200.0 * 100_f64.powf(part))
        };
        let hot = (0..options.hot_pixels).map(hot).collect();
        let counter = options.start;
        let place = counter as f64 - 0.5 * options.play;
        let state = State { options, counter, place, frames: 0, stars, hot };
        Self { state: Arc::new(Mutex::new(state)), clock }
    }

    /// The focuser.
    pub fn focuser(&self) -> VirtualFocuser {
        VirtualFocuser(self.clone())
    }

    /// The camera.
    pub fn camera(&self) -> FocusCamera {
        FocusCamera(self.clone())
    }

    fn with<V>(&self, act: impl FnOnce(&mut State) -> V) -> V {
        act(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// True best reading of the counter, steps, where positions are approached from below (or from above).
    pub fn best(&self, from_below: bool) -> f64 {
        self.with(|state| state.best() + if from_below { state.options.play } else { 0.0 })
    }

    /// Sets the temperature, °C.
    pub fn set_temperature_c(&self, temperature_c: f64) {
        self.with(|state| state.options.temperature_c = temperature_c);
    }

    /// Puts a cloud before the telescope, or takes it away: no star's light comes.
    pub fn set_cloud(&self, cloud: bool) {
        self.with(|state| {
            let sign = if cloud { -1.0 } else { 1.0 };
            for star in &mut state.stars {
                star.2 = sign * star.2.abs();
            }
        });
    }
}

/// The focuser.
#[derive(Debug)]
pub struct VirtualFocuser(FocusBench);

impl Device for VirtualFocuser {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        let (vendor, model) = ("sunglint".into(), FOCUSER.into());
        Ok(Identity { vendor, model, serial: None, firmware: None, driver: "virtual" })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let value = Value::Integer(self.position(deadline)?);
        Ok(vec![Setting { name: "position_steps", value, origin: Origin::ReadBack }])
    }
}

impl Focuser for VirtualFocuser {
    fn range(&self) -> [i64; 2] {
        [0, self.0.with(|state| state.options.most)]
    }

    fn position(&mut self, _: &Deadline) -> Result<i64, DeviceError> {
        Ok(self.0.with(|state| state.counter))
    }

    fn move_to(
        &mut self,
        position: i64,
        deadline: &Deadline,
    ) -> Result<i64, Interrupted<Option<i64>>> {
        let [least, most] = self.range();
        if !(least..=most).contains(&position) {
            let [asked, least, most] = [position, least, most].map(|n| n as f64);
            let error = DeviceError::OutOfRange { name: "position, steps", asked, least, most };
            return Err(Interrupted::new(None, error));
        }
        let (from, speed) = self.0.with(|state| (state.counter, state.options.speed));
        let time = Duration::from_secs_f64((position - from).abs() as f64 / speed);
        if let Err(expired) = deadline.sleep(time) {
            // Halfway, as far as anybody knows.
            let at = from + (position - from) / 2;
            self.0.with(|state| state.turn(at));
            let error = DeviceError::expired(FOCUSER, "moving", expired);
            return Err(Interrupted::new(Some(at), error));
        }
        self.0.with(|state| state.turn(position));
        Ok(position)
    }

    fn temperature_c(&mut self, _: &Deadline) -> Result<Option<f64>, DeviceError> {
        Ok(Some(self.0.with(|state| state.options.temperature_c)))
    }

    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// The camera.
#[derive(Debug)]
pub struct FocusCamera(FocusBench);

/// A point in a ring with this inner radius and the outer radius 1, all its area alike.
fn in_ring(random: &mut Random, inner: f64) -> [f64; 2] {
    let u: f64 = random.random();
    let radius = (inner * inner + u * (1.0 - inner * inner)).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * random.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

impl FocusCamera {
    fn pixels(&self, exposure_s: f64) -> Result<Array2<u16>, DeviceError> {
        self.0.with(|state| {
            state.frames += 1;
            let options = &state.options;
            let mut random = stream(options.seed, Purpose::Frame, state.frames);
            let [columns, rows] = options.size_px.map(|n| n as usize);
            let mut electrons = Array2::<f64>::zeros((rows, columns));
            let blur = (state.place - state.best()) * options.blur_px;
            // Moffat with β = 3: full width 2 α √(2^(1/3) − 1).
            let alpha = options.seeing_px / (2.0 * (2_f64.powf(1.0 / 3.0) - 1.0).sqrt());
            let drawn = |mean: f64, random: &mut Random| -> Result<f64, DeviceError> {
                if mean <= 0.0 {
                    return Ok(0.0);
                }
                let poisson = Poisson::new(mean).map_err(|_| DeviceError::OutOfRange {
                    name: "mean of photons",
                    asked: mean,
                    least: 0.0,
                    most: f64::MAX,
                })?;
                Ok(poisson.sample(random))
            };
            for &(x, y, flux) in &state.stars {
                let photons = drawn(flux * exposure_s, &mut random)?;
                for _ in 0..photons as u64 {
                    let [px, py] = in_ring(&mut random, options.obstruction);
                    let u: f64 = random.random();
                    let radius = alpha * ((1.0 - u).powf(-0.5) - 1.0).sqrt();
                    let (sin, cos) = (std::f64::consts::TAU * random.random::<f64>()).sin_cos();
                    let c = (x + blur * px + radius * cos).round();
                    let r = (y + blur * py + radius * sin).round();
                    if c >= 0.0 && r >= 0.0 && (c as usize) < columns && (r as usize) < rows {
                        electrons[(r as usize, c as usize)] += 1.0;
                    }
                }
            }
            for &(r, c, rate_e_s) in &state.hot {
                electrons[(r, c)] += drawn(rate_e_s * exposure_s, &mut random)?;
            }
            let noise = Normal::new(0.0, options.read_noise_e.max(0.0)).ok();
            let sky = options.sky_e_s * exposure_s;
            let mut pixels = Array2::zeros((rows, columns));
            for (pixel, electrons) in pixels.iter_mut().zip(&electrons) {
                let read = noise.map_or(0.0, |noise| noise.sample(&mut random));
                let adu = 300.0 + electrons + drawn(sky, &mut random)? + read;
                *pixel = adu.round().clamp(0.0, 65_535.0) as u16;
            }
            Ok(pixels)
        })
    }
}

impl Device for FocusCamera {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        let (vendor, model) = ("sunglint".into(), CAMERA.into());
        Ok(Identity { vendor, model, serial: None, firmware: None, driver: "virtual" })
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let seeing = Value::Number(self.0.with(|state| state.options.seeing_px));
        Ok(vec![Setting { name: "seeing_px", value: seeing, origin: Origin::Configured }])
    }
}

impl Camera for FocusCamera {
    fn sensor_px(&self) -> [u32; 2] {
        self.0.with(|state| state.options.size_px)
    }

    fn set_window(&mut self, _: Window, _: &Deadline) -> Result<Window, DeviceError> {
        Ok(Window { origin_px: [0, 0], size_px: self.sensor_px(), binning: [1, 1] })
    }

    fn set_gain(&mut self, gain: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Err(DeviceError::OutOfRange { name: "gain", asked: gain, least: 0.0, most: 0.0 })
    }

    fn set_temperature_c(&mut self, _: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Err(DeviceError::NotReady { device: CAMERA, reason: "it has no cooling" })
    }

    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        if !(0.0..=600.0).contains(&exposure_s) {
            let name = "exposure, s";
            return Err(DeviceError::OutOfRange {
                name,
                asked: exposure_s,
                least: 0.0,
                most: 600.0,
            });
        }
        let start = self.0.clock.utc();
        deadline
            .sleep(Duration::from_secs_f64(exposure_s))
            .map_err(|expired| DeviceError::expired(CAMERA, "exposing", expired))?;
        Ok(Frame {
            pixels: self.pixels(exposure_s)?,
            origin: [0, 0],
            binning: [1, 1],
            bayer: None,
            start,
            exposure_s,
            gain_e_per_adu: Some(1.0),
            temperature_c: None,
            saturation_adu: Some(65_535.0),
            header: Header::default(),
        })
    }
}
