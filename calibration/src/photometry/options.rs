//! Options of the photometry of frames.

use super::{PhotometryError, Scintillation};
use glam::DVec2;
use sunglint_numerics::measured::Interval;

/// How a target is found and measured.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotometryOptions {
    /// Radius of the aperture, px.
    pub aperture_radius_px: f64,
    /// Inner and outer radius of the annulus for the background, px.
    pub annulus_px: Interval,
    /// Pixels of the annulus further from its median than this many standard deviations do not count.
    pub clip_sigma: f64,
    /// Rounds of clipping at most.
    pub clip_rounds: usize,
    /// Expected full width at half maximum of a point, px: of the window of centroids and of the filter of the detection. What is half as wide
    /// counts as a cosmic ray.
    pub fwhm_px: f64,
    /// Pixels across and down of the whole sensor, unbinned: its middle is the origin of tracks.
    pub sensor_px: [u32; 2],
    /// Electrons per ADU; `None` takes the frame's.
    pub gain_e_per_adu: Option<f64>,
    /// Read-out noise, e⁻.
    pub read_noise_e: f64,
    /// Count from which a pixel is saturated, ADU; `None` takes the frame's, and without one 65 535.
    pub saturation_adu: Option<f64>,
    /// Up to this fraction of a target's light in masked pixels is made up for by a normal profile; beyond it there is no rate.
    pub max_masked_light: f64,
    /// Whether and how a target may be drawn out in an exposure.
    pub trail: Trail,
    /// Filters that decide which source is a target.
    pub detection: DetectionOptions,
    /// Parameters of the scintillation (twinkling); `None` leaves it out.
    pub scintillation: Option<Scintillation>,
}

/// Whether a target is drawn out in an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Trail {
    /// It is a point: long sources are rejected.
    Point,
    /// It moves by this many columns and rows of the frame while exposed (its sign does not matter).
    Known(DVec2),
    /// It may be drawn out: length and direction are estimated from its second moments.
    Estimated,
}

/// Which of several sources that could be the target is it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// The one nearest to where it was expected.
    Nearest,
    /// The brightest.
    Brightest,
}

/// The filters of the detection, in the order in which they are applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectionOptions {
    /// Standard deviations above the local background of the frame after smoothing with a point's profile.
    pub threshold_sigma: f64,
    /// Fewest and most pixels of the smoothed frame above half the threshold, or above 30 % of the source's peak where that is higher.
    pub area_px: [usize; 2],
    /// Least fraction of its bounding box that a source fills. A disc fills π/4, a diagonal streak little.
    pub min_fill: f64,
    /// Largest ratio of the bounding box's sides.
    pub max_aspect: f64,
    /// Largest sharpness of sources below 2.5 thresholds: the signal to noise of a source as something a third as wide as a point, over that as a point: above it is a cosmic ray. A point has
    /// 0.55, one hot pixel 3.3.
    pub max_sharpness: f64,
    /// Narrowest axis of a source over that of a point: below it is a cosmic ray or a hot pixel.
    pub min_width: f64,
    /// Widest axis of a source over that of a point: above it is a streak.
    pub max_width: f64,
    /// Furthest from where the target is expected, px.
    pub max_offset_px: f64,
    /// Which of several.
    pub choice: Choice,
}

impl Default for DetectionOptions {
    fn default() -> Self {
        Self {
            threshold_sigma: 6.0,
            area_px: [4, 2000],
            min_fill: 0.4,
            max_aspect: 2.5,
            max_sharpness: 0.85,
            min_width: 0.4,
            max_width: 2.0,
            max_offset_px: f64::INFINITY,
            choice: Choice::Nearest,
        }
    }
}

impl PhotometryOptions {
    /// An aperture of 8 px with an annulus of 12 to 20 px around points of 4 px, for a sensor of that size and read-out noise.
    pub fn new(sensor_px: [u32; 2], read_noise_e: f64) -> Self {
        Self {
            aperture_radius_px: 8.0,
            annulus_px: Interval::new(12.0, 20.0),
            clip_sigma: 3.0,
            clip_rounds: 5,
            fwhm_px: 4.0,
            sensor_px,
            gain_e_per_adu: None,
            read_noise_e,
            saturation_adu: None,
            max_masked_light: 0.1,
            trail: Trail::Point,
            detection: DetectionOptions::default(),
            scintillation: None,
        }
    }

    /// # Errors
    /// [`PhotometryError::Option`] for the first option out of its range.
    pub(crate) fn check(&self) -> Result<(), PhotometryError> {
        let above = |name, value: f64, low: f64, expected| match value > low && value.is_finite() {
            true => Ok(()),
            false => Err(PhotometryError::Option { name, value, expected }),
        };
        let within =
            |name, value: f64, low: f64, high: f64, expected| match (low..=high).contains(&value) {
                true => Ok(()),
                false => Err(PhotometryError::Option { name, value, expected }),
            };
        let positive = "a number above 0";
        let [inner, outer] = self.annulus_px.to_array();
        within("aperture_radius_px", self.aperture_radius_px, 0.1, 1000.0, "0.1 to 1000")?;
        within(
            "annulus_px (inner)",
            inner,
            self.aperture_radius_px,
            1000.0,
            "the aperture's radius to 1000",
        )?;
        within(
            "annulus_px (outer)",
            outer,
            inner + 1.0,
            2000.0,
            "at least 1 above the inner, to 2000",
        )?;
        within("clip_sigma", self.clip_sigma, 1.5, f64::INFINITY, "1.5 or more")?;
        within("fwhm_px", self.fwhm_px, 0.5, 100.0, "0.5 to 100")?;
        within("max_masked_light", self.max_masked_light, 0.0, 0.9, "0 to 0.9")?;
        within("read_noise_e", self.read_noise_e, 0.0, 1e6, "0 to 1e6")?;
        for (name, value) in
            [("gain_e_per_adu", self.gain_e_per_adu), ("saturation_adu", self.saturation_adu)]
        {
            if let Some(value) = value {
                above(name, value, 0.0, positive)?;
            }
        }
        for (i, size) in self.sensor_px.into_iter().enumerate() {
            above(["sensor_px (columns)", "sensor_px (rows)"][i], f64::from(size), 0.0, positive)?;
        }
        if let Trail::Known(trail) = self.trail {
            within("trail (length), px", trail[0].hypot(trail[1]), 0.0, 2000.0, "0 to 2000")?;
        }
        if let Some(scintillation) = &self.scintillation {
            above("diameter_m", scintillation.diameter_m, 0.0, positive)?;
        }
        let detection = &self.detection;
        above("threshold_sigma", detection.threshold_sigma, 0.0, positive)?;
        within("min_fill", detection.min_fill, 0.0, 1.0, "0 to 1")?;
        within("max_aspect", detection.max_aspect, 1.0, f64::INFINITY, "1 or more")?;
        above("max_sharpness", detection.max_sharpness, 0.0, positive)?;
        within("min_width", detection.min_width, 0.0, detection.max_width, "0 to max_width")?;
        within("max_offset_px", detection.max_offset_px, 0.0, f64::INFINITY, "0 or more")
    }
}
