//! A sensor: its pixels, its noise, its converter.

use super::spread::Stamp;
use super::{Scene, Source};
use crate::observatory::random::{Purpose, Random, stream};
use glam::DVec2;
use ndarray::Array2;
use rand::RngExt as _;
use rand_distr::{Distribution as _, Exp1, Poisson, StandardNormal};
use sunglint_formats::Bayer;
use sunglint_radiometry::station;

/// Faults of the pixels. Which pixels they are is the sensor's own: the same in every frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PixelFaults {
    /// Relative standard deviation of the response from pixel to pixel.
    pub response_scatter: f64,
    /// The part of the pixels that are hot.
    pub hot_fraction: f64,
    /// Mean dark current of a hot pixel, e/s; exponentially distributed.
    pub hot_e_per_s: f64,
    /// The part of the pixels that answer half.
    pub cold_fraction: f64,
    /// The part of the pixels that answer nothing.
    pub dead_fraction: f64,
}

/// A sensor with its amplifier and converter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// The colours of the first 2 × 2 pixels; `None` for a monochrome sensor.
    pub bayer: Option<Bayer>,
    /// Electrons per count of the converter.
    pub gain_e_per_adu: f64,
    /// Standard deviation of the read noise, e.
    pub read_noise_e: f64,
    /// Electrons that a pixel holds; what is more is lost (nothing runs over into its neighbours).
    pub full_well_e: f64,
    /// Bits of the converter, at most 16.
    pub adc_bits: u8,
    /// Dark current, e/s.
    pub dark_e_per_s: f64,
    /// Bias of the converter (its value without a signal), ADU.
    pub bias_adu: f64,
    /// Faults of the pixels.
    pub faults: PixelFaults,
    /// Which pixels have which fault.
    pub seed: u64,
}

/// The part of a sensor that is read, and for how long it is exposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// First column and row, px.
    pub origin_px: [u32; 2],
    /// Columns and rows before binning, px.
    pub size_px: [u32; 2],
    /// Columns and rows of the sensor in one pixel of the frame.
    pub binning: [u32; 2],
    /// How long, s.
    pub exposure_s: f64,
}

/// The pixels' own faults in the part of the sensor that is read.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    origin_px: [u32; 2],
    size_px: [u32; 2],
    response: Vec<f32>,
    dark_e_per_s: Vec<f32>,
}

impl Pattern {
    /// Whether it is that of an exposure.
    pub fn fits(&self, exposure: &Exposure) -> bool {
        (self.origin_px, self.size_px) == (exposure.origin_px, exposure.size_px)
    }

    /// Response and dark current, e/s, of a pixel of the part that is read, row by row.
    pub fn pixel(&self, index: usize) -> (f32, f32) {
        (self.response[index], self.dark_e_per_s[index])
    }
}

impl Sensor {
    /// The sensor of a station's camera, without faulty pixels, with a bias of 300 ADU.
    pub fn of_station(camera: &station::Camera) -> Self {
        Self {
            size_px: camera.size_px,
            bayer: camera.bayer,
            gain_e_per_adu: camera.gain_e_per_adu,
            read_noise_e: camera.read_noise_e,
            full_well_e: camera.full_well_e,
            adc_bits: camera.adc_bits.min(16),
            dark_e_per_s: camera.dark_e_per_s,
            bias_adu: 300.0,
            faults: PixelFaults::default(),
            seed: 0,
        }
    }

    /// The middle of the sensor: column and row, where a pixel's middle is a whole number.
    pub fn middle_px(&self) -> DVec2 {
        self.size_px.map(|size| 0.5 * (f64::from(size) - 1.0)).into()
    }

    /// The colour of a pixel: 0 red, 1 green, 2 blue; 0 of a monochrome sensor.
    pub fn colour(&self, column: u32, row: u32) -> usize {
        let Some(bayer) = self.bayer else { return 0 };
        match bayer.name().as_bytes()[(row % 2 * 2 + column % 2) as usize] {
            b'R' => 0,
            b'G' => 1,
            _ => 2,
        }
    }

    /// The faults of the pixels in the part of the sensor that an exposure reads: to be kept for many frames.
    pub fn pattern(&self, exposure: &Exposure) -> Pattern {
        let Exposure { origin_px, size_px, .. } = *exposure;
        let all = size_px[0] as usize * size_px[1] as usize;
        let (mut response, mut dark) = (Vec::with_capacity(all), Vec::with_capacity(all));
        for row in origin_px[1]..origin_px[1] + size_px[1] {
            for column in origin_px[0]..origin_px[0] + size_px[0] {
                let (answer, current) = self.pixel(column, row);
                response.push(answer as f32);
                dark.push(current as f32);
            }
        }
        Pattern { origin_px, size_px, response, dark_e_per_s: dark }
    }

    /// Response and dark current, e/s, of one pixel of the sensor.
    pub fn pixel(&self, column: u32, row: u32) -> (f64, f64) {
        let faults = &self.faults;
        let mut random =
            stream(self.seed, Purpose::Pixels, u64::from(row) << 32 | u64::from(column));
        let fate: f64 = random.random();
        let scatter: f64 = StandardNormal.sample(&mut random);
        let hotness: f64 = Exp1.sample(&mut random);
        let usual = (1.0 + faults.response_scatter * scatter).max(0.0);
        let (cold, dead) = (
            faults.hot_fraction + faults.cold_fraction,
            faults.hot_fraction + faults.cold_fraction + faults.dead_fraction,
        );
        match fate {
            fate if fate < faults.hot_fraction => {
                (usual, self.dark_e_per_s + hotness * faults.hot_e_per_s)
            }
            fate if fate < cold => (0.5 * usual, self.dark_e_per_s),
            fate if fate < dead => (0.0, self.dark_e_per_s),
            _ => (usual, self.dark_e_per_s),
        }
    }

    /// The mean electrons of each unbinned pixel before any noise, row by row, without cosmic rays and before the well is full.
    pub fn expected_e(
        &self,
        pattern: &Pattern,
        exposure: &Exposure,
        scene: &Scene<'_>,
    ) -> Vec<f64> {
        let columns = exposure.size_px[0] as usize;
        let mut light = self.sky(exposure, scene);
        for source in scene.sources {
            self.add(source, exposure, scene, columns, &mut light);
        }
        let own = pattern.response.iter().zip(&pattern.dark_e_per_s);
        for (light, (response, dark)) in light.iter_mut().zip(own) {
            *light = *light * f64::from(*response) + f64::from(*dark) * exposure.exposure_s;
        }
        light
    }

    /// The colours of two neighbouring columns in a row.
    fn colours(&self, exposure: &Exposure, row: usize) -> [usize; 2] {
        let [column, first] = exposure.origin_px;
        [0, 1].map(|next| self.colour(column + next, first + row as u32))
    }

    fn sky(&self, exposure: &Exposure, scene: &Scene<'_>) -> Vec<f64> {
        let [columns, rows] = exposure.size_px.map(|size| size as usize);
        let [middle_x, middle_y] = self.middle_px().to_array();
        let [right, down] = scene.sky.gradient_per_px.to_array();
        let mut light = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            let e = self.colours(exposure, row).map(|c| scene.sky.e_per_s[c] * exposure.exposure_s);
            let of_row = down * (f64::from(exposure.origin_px[1]) + row as f64 - middle_y);
            let lamp_e = scene.lamp_e.get(row).copied().unwrap_or(0.0);
            for column in 0..columns {
                let x = f64::from(exposure.origin_px[0]) + column as f64 - middle_x;
                light.push((e[column % 2] * (1.0 + of_row + right * x)).max(0.0) + lamp_e);
            }
        }
        light
    }

    fn add(
        &self,
        source: &Source,
        exposure: &Exposure,
        scene: &Scene<'_>,
        columns: usize,
        light: &mut [f64],
    ) {
        // Far from a long trail more may be left out: nothing there is measured.
        let outside = if source.path_px.len() > 16 { 1e-3 } else { 2e-5 };
        let parts = source.path_px.len() as f64;
        let (origin, size) =
            (exposure.origin_px.map(f64::from), exposure.size_px.map(|size| size as usize));
        let mut stamp = Stamp::default();
        for at_px in &source.path_px {
            scene.spread.stamp(at_px.to_array(), origin, size, outside, &mut stamp);
            let [left, top] = stamp.origin;
            for (row, weights) in (top..).zip(stamp.weights.chunks_exact(stamp.columns.max(1))) {
                let e = self.colours(exposure, row).map(|c| source.electrons[c] / parts);
                let pixels = &mut light[row * columns + left..][..stamp.columns];
                for ((column, pixel), weight) in (left..).zip(pixels).zip(weights) {
                    *pixel += e[column % 2] * weight;
                }
            }
        }
    }

    /// The frame of an exposure, ADU, `[row, column]`; `number` names it among the frames of a seed.
    pub fn render(
        &self,
        exposure: &Exposure,
        scene: &Scene<'_>,
        seed: u64,
        number: u64,
    ) -> Array2<u16> {
        self.render_with(&self.pattern(exposure), exposure, scene, seed, number)
    }

    /// The same with the pixels' faults at hand.
    pub fn render_with(
        &self,
        pattern: &Pattern,
        exposure: &Exposure,
        scene: &Scene<'_>,
        seed: u64,
        number: u64,
    ) -> Array2<u16> {
        let mut random = stream(seed, Purpose::Frame, number);
        let mut electrons = self.expected_e(pattern, exposure, scene);
        for pixel in &mut electrons {
            *pixel = photons(*pixel, &mut random);
        }
        let columns = exposure.size_px[0] as usize;
        let mut passing = stream(seed, Purpose::Passing, number);
        scene.cosmic_rays.hit(exposure, columns, &mut electrons, &mut passing);
        for pixel in &mut electrons {
            *pixel = pixel.min(self.full_well_e);
        }
        let [across, down] = exposure.binning.map(|bins| bins.max(1) as usize);
        let size = [exposure.size_px[0] as usize / across, exposure.size_px[1] as usize / down];
        let highest = 2_f64.powi(i32::from(self.adc_bits.min(16))) - 1.0;
        Array2::from_shape_fn((size[1], size[0]), |(row, column)| {
            let charge: f64 = (0..down)
                .flat_map(|y| {
                    let begin = (row * down + y) * columns + column * across;
                    &electrons[begin..begin + across]
                })
                .sum();
            let noise: f64 = StandardNormal.sample(&mut random);
            let adu = self.bias_adu + (charge + self.read_noise_e * noise) / self.gain_e_per_adu;
            adu.round().clamp(0.0, highest) as u16
        })
    }
}

/// A Poisson draw.
fn photons(expected: f64, random: &mut Random) -> f64 {
    // Refused is only what is not above 0.
    Poisson::new(expected).map_or(0.0, |poisson| poisson.sample(random))
}
