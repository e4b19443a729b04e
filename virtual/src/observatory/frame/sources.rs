//! Contents of a picture: the sky, points of light, what passes by, cosmic rays.

use super::{Exposure, PointSpread};
use crate::observatory::random::Random;
use glam::DVec2;
use rand::RngExt as _;
use rand_distr::{Distribution as _, Exp1, Poisson, StandardNormal};

/// The sky behind everything.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sky {
    /// Electrons per second in a pixel of each colour, in the middle of the sensor.
    pub e_per_s: [f64; 3],
    /// Relative gradient of brightness a pixel to the right and a pixel down, as fractions.
    pub gradient_per_px: DVec2,
}

/// A point of light, perhaps moving.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Source {
    /// Electrons of the whole source in the exposure, for each colour as if every pixel had it.
    pub electrons: [f64; 3],
    /// Where it is, columns and rows of the sensor: at one place, or at several for equal parts of the exposure.
    pub path_px: Vec<DVec2>,
}

impl Source {
    /// A source that stands still.
    pub fn still(electrons: [f64; 3], at_px: impl Into<DVec2>) -> Self {
        Self { electrons, path_px: vec![at_px.into()] }
    }

    /// A source that moves evenly from one place to another while it is exposed: a trail, in steps of a quarter of the point
    /// spread's width at most.
    pub fn trailed(
        electrons: [f64; 3],
        from_px: impl Into<DVec2>,
        to_px: impl Into<DVec2>,
        spread: &PointSpread,
    ) -> Self {
        let (from_px, to_px) = (from_px.into(), to_px.into());
        let [x, y] = [to_px[0] - from_px[0], to_px[1] - from_px[1]];
        let steps = (4.0 * x.hypot(y) / spread.fwhm_px()).ceil().clamp(1.0, 1e5);
        let place = |step: f64| {
            let part = (step + 0.5) / steps;
            DVec2::new(from_px[0] + part * x, from_px[1] + part * y)
        };
        let path_px = (0..steps as u32).map(|step| place(f64::from(step))).collect();
        Self { electrons, path_px }
    }
}

/// Objects that cross the field: a bright line over the whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Streak {
    /// Number of them that cross the picture in a second.
    pub per_s: f64,
    /// Electrons on a pixel's length of a streak, the median; the scatter is a factor e.
    pub e_per_px: f64,
}

/// Cosmic rays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CosmicRays {
    /// Hits per second on a million pixels. At sea level about 0.02 per second on a square centimetre.
    pub per_mpx_s: f64,
    /// Mean length of a track, px.
    pub length_px: f64,
    /// Electrons on a pixel's length of a track, the median; the scatter is a factor √e.
    pub e_per_px: f64,
}

/// Contents of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene<'a> {
    /// The sky.
    pub sky: Sky,
    /// Electrons that a lamp brings into each pixel of each unbinned row that is read; without any it is off.
    pub lamp_e: &'a [f64],
    /// Points of light.
    pub sources: &'a [Source],
    /// How they are spread.
    pub spread: PointSpread,
    /// Cosmic rays; they come through a closed shutter too.
    pub cosmic_rays: CosmicRays,
}

impl Scene<'_> {
    /// Nothing but what the sensor itself brings.
    pub const DARK: Scene<'static> = Scene {
        sky: Sky { e_per_s: [0.0; 3], gradient_per_px: DVec2::ZERO },
        lamp_e: &[],
        sources: &[],
        spread: PointSpread::Gaussian { fwhm_px: 3.0 },
        cosmic_rays: CosmicRays { per_mpx_s: 0.0, length_px: 0.0, e_per_px: 0.0 },
    };
}

/// A streak across the picture of an exposure, if one comes: through a point of it, in any direction, from beyond one edge to beyond the other.
pub fn streak(
    streaks: &Streak,
    exposure: &Exposure,
    spread: &PointSpread,
    random: &mut Random,
) -> Option<Source> {
    let chance = -(-streaks.per_s * exposure.exposure_s).exp_m1();
    if random.random::<f64>() >= chance {
        return None;
    }
    let size = exposure.size_px.map(f64::from);
    let place: [f64; 2] = std::array::from_fn(|axis| {
        f64::from(exposure.origin_px[axis]) - 0.5 + size[axis] * random.random::<f64>()
    });
    let (sin, cos) = (std::f64::consts::PI * random.random::<f64>()).sin_cos();
    let scatter: f64 = StandardNormal.sample(random);
    let reach = size[0].hypot(size[1]) + 10.0 * spread.fwhm_px();
    let end = |sign: f64| [place[0] + sign * reach * cos, place[1] + sign * reach * sin];
    let electrons = streaks.e_per_px * scatter.exp() * 2.0 * reach;
    Some(Source::trailed([electrons; 3], end(-1.0), end(1.0), spread))
}

impl CosmicRays {
    /// Adds the charge of the rays of an exposure to a picture of `columns` pixels a row.
    pub(super) fn hit(
        &self,
        exposure: &Exposure,
        columns: usize,
        electrons: &mut [f64],
        random: &mut Random,
    ) {
        let expected = self.per_mpx_s * 1e-6 * electrons.len() as f64 * exposure.exposure_s;
        let Ok(hits) = Poisson::new(expected) else { return };
        let rows = electrons.len() / columns.max(1);
        for _ in 0..hits.sample(random) as u64 {
            let mut x = random.random::<f64>() * columns as f64;
            let mut y = random.random::<f64>() * rows as f64;
            let (sin, cos) = (std::f64::consts::TAU * random.random::<f64>()).sin_cos();
            let length: f64 = Exp1.sample(random);
            let scatter: f64 = StandardNormal.sample(random);
            let density = self.e_per_px * (0.5 * scatter).exp();
            // At least a pixel's part of charge, in steps of a fifth of one.
            let steps = (5.0 * length * self.length_px).clamp(1.0, 1e4) as u32 + 1;
            for _ in 0..steps {
                if x >= 0.0 && y >= 0.0 && (x as usize) < columns && (y as usize) < rows {
                    electrons[y as usize * columns + x as usize] += 0.2 * density;
                }
                x += 0.2 * cos;
                y += 0.2 * sin;
            }
        }
    }
}
