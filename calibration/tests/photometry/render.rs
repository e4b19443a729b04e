//! Frames from first principles, photon by photon, for the tests: nothing of the reduction is used here.

use hifitime::Epoch;
use ndarray::Array2;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_formats::fits::Header;
use sunglint_formats::frame::{Bayer, Frame};

/// A sky and a camera.
#[derive(Clone)]
pub struct Sky {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Mean electrons of the sky in a pixel.
    pub sky_e: f64,
    pub read_noise_e: f64,
    pub gain_e_per_adu: f64,
    pub bias_adu: f64,
    pub fwhm_px: f64,
    pub bayer: Option<Bayer>,
    /// Transmission of the colours: red, green, blue.
    pub through: [f64; 3],
}

impl Sky {
    pub fn new(size: usize) -> Self {
        Self {
            size: [size, size],
            sky_e: 100.0,
            read_noise_e: 5.0,
            gain_e_per_adu: 0.8,
            bias_adu: 200.0,
            fwhm_px: 4.0,
            bayer: None,
            through: [1.0; 3],
        }
    }

    pub fn sigma_px(&self) -> f64 {
        self.fwhm_px / (8.0 * 2f64.ln()).sqrt()
    }
}

/// Electrons of a frame as they are gathered.
pub struct Exposure {
    pub sky: Sky,
    pub electrons: Array2<f64>,
    pub rng: Xoshiro256PlusPlus,
    poisson: Vec<f64>,
}

impl Exposure {
    /// The sky alone.
    pub fn of(sky: &Sky, seed: u64) -> Self {
        let mut exposure = Self {
            sky: sky.clone(),
            electrons: Array2::zeros((sky.size[1], sky.size[0])),
            rng: Xoshiro256PlusPlus::seed_from_u64(seed),
            poisson: cumulative(sky.sky_e),
        };
        exposure.again();
        exposure
    }

    /// Another draw of the sky alone.
    pub fn again(&mut self) {
        for at in self.electrons.iter_mut() {
            let u: f64 = self.rng.random();
            *at = self.poisson.partition_point(|&c| c < u) as f64;
        }
    }

    fn normal(&mut self) -> f64 {
        let (u, v): (f64, f64) = (self.rng.random(), self.rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    /// The photons of a point: arrivals in a stretch of time, each at its own place.
    pub fn point(&mut self, x: f64, y: f64, electrons: f64) {
        self.streak([x, y], [x, y], electrons);
    }

    /// The photons of a point that moves from one place to another.
    pub fn streak(&mut self, from: [f64; 2], to: [f64; 2], electrons: f64) {
        let sigma = self.sky.sigma_px();
        let mut time = 0.0;
        loop {
            let u: f64 = self.rng.random();
            time -= (1.0 - u).ln();
            if time > electrons {
                return;
            }
            let t: f64 = if from == to { 0.0 } else { self.rng.random() };
            let radius = {
                let u: f64 = self.rng.random();
                sigma * (-2.0 * (1.0 - u).ln()).sqrt()
            };
            let turn: f64 = self.rng.random();
            let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
            let x = from[0] + t * (to[0] - from[0]) + radius * cos;
            let y = from[1] + t * (to[1] - from[1]) + radius * sin;
            self.electron(x, y);
        }
    }

    /// One photon at a place, if its colour lets it through.
    fn electron(&mut self, x: f64, y: f64) {
        let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
        if column < 0.0 || row < 0.0 {
            return;
        }
        let (column, row) = (column as usize, row as usize);
        if let Some(bayer) = self.sky.bayer {
            let letter = bayer.name().as_bytes()[row % 2 * 2 + column % 2];
            let through = self.sky.through[b"RGB".iter().position(|&l| l == letter).unwrap()];
            if through < 1.0 && self.rng.random::<f64>() >= through {
                return;
            }
        }
        if let Some(pixel) = self.electrons.get_mut([row, column]) {
            *pixel += 1.0;
        }
    }

    /// A cosmic ray: a track of up to six pixels in a random direction.
    pub fn cosmic_ray(&mut self) {
        let size = self.sky.size.map(|n| n as f64);
        let (u, v, w): (f64, f64, f64) = (self.rng.random(), self.rng.random(), self.rng.random());
        let (mut x, mut y) = (u * size[0], v * size[1]);
        let (dy, dx) = (std::f64::consts::TAU * w).sin_cos();
        let length = 6.0 * self.rng.random::<f64>().powi(2);
        let energy = 200.0 * 25f64.powf(self.rng.random());
        let steps = 1 + (length * 4.0) as usize;
        for _ in 0..steps {
            if let (true, Some(pixel)) =
                (x >= 0.0 && y >= 0.0, self.electrons.get_mut([y as usize, x as usize]))
            {
                *pixel += energy / steps as f64;
            }
            (x, y) = (x + 0.25 * dx, y + 0.25 * dy);
        }
    }

    /// Reads out: read-out noise, gain, bias, whole counts up to 65 535. One second.
    pub fn read(&mut self) -> Frame {
        let mut pixels = Array2::zeros(self.electrons.raw_dim());
        for at in 0..pixels.len() {
            let noise = self.sky.read_noise_e * self.normal();
            let electrons = self.electrons.as_slice().unwrap()[at] + noise;
            let adu = (electrons / self.sky.gain_e_per_adu + self.sky.bias_adu).round();
            pixels.as_slice_mut().unwrap()[at] = adu.clamp(0.0, 65_535.0) as u16;
        }
        frame(pixels, Some(self.sky.gain_e_per_adu), self.sky.bayer)
    }
}

/// A frame of one second.
pub fn frame(pixels: Array2<u16>, gain_e_per_adu: Option<f64>, bayer: Option<Bayer>) -> Frame {
    Frame {
        pixels,
        origin: [0, 0],
        binning: [1, 1],
        bayer,
        start: Epoch::from_gregorian_utc_at_midnight(2026, 11, 21),
        exposure_s: 1.0,
        gain_e_per_adu,
        temperature_c: None,
        saturation_adu: Some(65_535.0),
        header: Header::default(),
    }
}

/// The cumulative Poisson distribution of this mean.
fn cumulative(mean: f64) -> Vec<f64> {
    let (mut term, mut sum, mut out) = ((-mean).exp(), 0.0, Vec::new());
    for n in 0..(mean + 12.0 * mean.sqrt() + 20.0) as usize {
        sum += term;
        out.push(sum);
        term *= mean / (n + 1) as f64;
    }
    out
}
