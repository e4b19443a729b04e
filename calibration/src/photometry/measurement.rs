//! Measurement of a frame.

use super::Aperture;
use crate::track::TrackPoint;
use glam::DVec2;
use hifitime::Epoch;
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::light_curve::Flags;

/// A plane of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Colour {
    /// All pixels of a monochrome frame.
    Mono,
    /// The red pixels of a mosaic, a quarter of all.
    Red,
    /// The green ones, half of all.
    Green,
    /// The blue ones, a quarter.
    Blue,
}

impl Colour {
    /// Name of it in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono => "all",
            Self::Red => "red",
            Self::Green => "green",
            Self::Blue => "blue",
        }
    }
}

/// The target in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMeasurement {
    /// The middle of the exposure.
    pub time: Epoch,
    /// Length of the exposure, s.
    pub exposure_s: f64,
    /// Where the target was found on the sensor, for the gating of counts.
    pub track: TrackPoint,
    /// Where it was found on the frame (column, row; the first pixel's middle is 0, 0).
    pub place_px: Option<DVec2>,
    /// The aperture that was summed over, for figures; `None` where no target was found.
    pub aperture: Option<Aperture>,
    /// Inner and outer radius of the annulus that the background is from, px.
    pub annulus_px: Option<Interval>,
    /// Full width at half maximum of the target, pixels of the frame, without the pixel's own width; across the trail where there is one.
    pub fwhm_px: Option<f64>,
    /// Sources that passed all filters in the part of the frame that was searched; more than one is ambiguous.
    pub candidates: usize,
    /// Relative standard deviation of the twinkling, common to all planes and to other instruments at the same time; in no `sigma`.
    pub scintillation: Option<f64>,
    /// The planes: one, or red, green, blue.
    pub planes: Vec<PlaneMeasurement>,
}

/// One plane's rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneMeasurement {
    /// Which plane.
    pub colour: Colour,
    /// Rate within the aperture above the background, ADU/s, standing for all pixels of the aperture (×4 for red and blue, ×2 for green).
    /// NaN beside [`Flags::SATURATED`], [`Flags::UNDETECTED`], [`Flags::EDGE`] or [`Flags::MASKED_PIXELS`] where there is none.
    pub rate_adu_per_s: f64,
    /// Standard deviation of the rate, in parts.
    pub sigma: SigmaParts,
    /// Flags of the measurement.
    pub flags: Flags,
    /// Background of a pixel, ADU.
    pub background_adu: f64,
    /// Standard error of the background, ADU.
    pub background_sigma_adu: f64,
    /// Area of this plane's pixels in the aperture that were summed, px²: without masked ones.
    pub area_px2: f64,
    /// Fraction of this plane's area in the aperture that is masked.
    pub masked_fraction: f64,
    /// Fraction of the target's light on the masked pixels, by a normal profile; the rate is corrected by it.
    pub masked_light: f64,
    /// Pixels of this plane in the aperture that are saturated.
    pub saturated_pixels: usize,
}

/// Standard deviations of a rate, ADU/s, independent of each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SigmaParts {
    /// The target's own photons.
    pub target: f64,
    /// The sky, the dark current and the read-out under the aperture, from the annulus' scatter.
    pub pixels: f64,
    /// The background's level.
    pub background: f64,
    /// Light that fell on masked pixels.
    pub masked: f64,
    /// Where the target fell between the pixels of its colour.
    pub sampling: f64,
}

impl SigmaParts {
    /// Not known.
    pub const UNKNOWN: Self = Self {
        target: f64::NAN,
        pixels: f64::NAN,
        background: f64::NAN,
        masked: f64::NAN,
        sampling: f64::NAN,
    };

    /// Those of a rate that is so many times as large.
    pub fn times(self, factor: f64) -> Self {
        Self {
            target: factor * self.target,
            pixels: factor * self.pixels,
            background: factor * self.background,
            masked: factor * self.masked,
            sampling: factor * self.sampling,
        }
    }

    /// All of them together, ADU/s; without scintillation, which is common to the channels.
    pub fn total(&self) -> f64 {
        let parts = [self.target, self.pixels, self.background, self.masked, self.sampling];
        parts.iter().map(|part| part * part).sum::<f64>().sqrt()
    }
}

/// How many frames, sources and planes each rule removed or flagged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Frames that were measured.
    pub frames: u64,
    /// Frames without a target.
    pub undetected: u64,
    /// Frames with more than one source that could be the target, in the part that was searched: all about as near as the nearest, or, where the
    /// brightest is wanted, all.
    pub ambiguous: u64,
    /// Sources with too few or too many pixels.
    pub rejected_area: u64,
    /// Sources that do not fill their bounding box.
    pub rejected_fill: u64,
    /// Sources with a long bounding box.
    pub rejected_aspect: u64,
    /// Sources narrower than a point: cosmic rays, hot pixels.
    pub rejected_sharp: u64,
    /// Sources wider than a point: streaks, clouds.
    pub rejected_wide: u64,
    /// Sources at the frame's edge.
    pub rejected_edge: u64,
    /// Knots of faint streaks.
    pub rejected_streak: u64,
    /// Pixels of cosmic rays and hot pixels that were left out of the search.
    pub cosmic_ray_pixels: u64,
    /// Sources too far from where the target was expected.
    pub rejected_offset: u64,
    /// Planes without a rate, for a saturated pixel.
    pub saturated: u64,
    /// Planes without a rate, for the aperture leaves the frame.
    pub edge: u64,
    /// Planes without a rate, for too much of the light is on masked pixels.
    pub masked: u64,
    /// Planes without a rate, for the annulus has too few pixels.
    pub no_background: u64,
    /// Planes with masked pixels in the aperture, with a rate.
    pub with_masked_pixels: u64,
    /// Frames with another source in the aperture, with rates.
    pub crowded: u64,
    /// Frames with a point narrower than three pixels.
    pub undersampled: u64,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.undetected += other.undetected;
        self.ambiguous += other.ambiguous;
        self.rejected_area += other.rejected_area;
        self.rejected_fill += other.rejected_fill;
        self.rejected_aspect += other.rejected_aspect;
        self.rejected_sharp += other.rejected_sharp;
        self.rejected_wide += other.rejected_wide;
        self.rejected_edge += other.rejected_edge;
        self.rejected_streak += other.rejected_streak;
        self.cosmic_ray_pixels += other.cosmic_ray_pixels;
        self.rejected_offset += other.rejected_offset;
        self.saturated += other.saturated;
        self.edge += other.edge;
        self.masked += other.masked;
        self.no_background += other.no_background;
        self.with_masked_pixels += other.with_masked_pixels;
        self.crowded += other.crowded;
        self.undersampled += other.undersampled;
    }
}
