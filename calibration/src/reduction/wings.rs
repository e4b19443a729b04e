//! Light outside of an aperture that was set by hand, measured on the visit's own frames: the aperture correction.
//!
//! A small aperture leaves out the wings of a point. On some of the visit's frames the target is measured again in an aperture of [`APERTURE_FWHM`] widths of a point,
//! with an annulus in proportion, and the ratio of both sums is what the small one's rates are multiplied by. So no profile is assumed. Frames on which another
//! source has light in the wide aperture tell nothing, and where too few are left the rates stay as they are, and that is said.

use super::frames::{APERTURE_FWHM, FrameOptions};
use super::widths::aperture_px;
use crate::photometry::{
    Colour, Expected, FrameCalibration, FrameMeasurement, FrameReducer, PhotometryError,
    PhotometryOptions,
};
use sunglint_formats::Frame;
use sunglint_numerics::order::median;
use sunglint_radiometry::light_curve::Flags;

/// Frames of a visit that are measured in both apertures.
pub(super) const FRAMES: usize = 48;
/// Fewer frames tell nothing.
const LEAST: usize = 5;
/// Frames whose rate is less certain than this are left out.
const DIM: f64 = 0.1;
/// A factor that is less certain than this is not applied.
const UNCERTAIN: f64 = 0.02;

/// Factor of a colour's rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WingFactor {
    /// Plane of the frames.
    pub colour: Colour,
    /// Light within the wide aperture over that within the one that was set.
    pub factor: f64,
    /// Standard error of it.
    pub sigma: f64,
}

/// Light outside of an aperture that was set by hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Wings {
    /// Radius of the aperture that was set, px.
    pub aperture_px: f64,
    /// Radius of the wide aperture, px.
    pub wide_px: f64,
    /// Factors by which the rates are multiplied; empty where the frames do not tell them.
    pub factors: Vec<WingFactor>,
    /// Frames that told.
    pub frames: usize,
}

impl Wings {
    /// A sentence about it.
    pub fn note(&self) -> String {
        let Self { aperture_px, wide_px, factors, frames } = self;
        if factors.is_empty() {
            return format!(
                "the aperture of {aperture_px:.1} px leaves out a part of the light that the frames do not tell (it is {:.1} widths of a point, and only {frames} frames show the target alone and bright enough within {wide_px:.1} px): rates are not corrected for it",
                APERTURE_FWHM * aperture_px / wide_px
            );
        }
        let each: Vec<String> = factors
            .iter()
            .map(|f| format!("{} {:.4} ± {:.4}", f.colour.name(), f.factor, f.sigma))
            .collect();
        format!(
            "aperture of {aperture_px:.1} px set by hand: rates are multiplied by {}, for the light out to {wide_px:.1} px, as {frames} frames of the visit show it; the factor's own uncertainty is common to the visit, and in no sigma",
            each.join(", ")
        )
    }

    fn of(&self, colour: Colour) -> Option<f64> {
        self.factors.iter().find(|f| f.colour == colour).map(|f| f.factor)
    }

    /// Multiplies the rates of a measurement.
    pub(super) fn apply(&self, measured: &mut FrameMeasurement) {
        for plane in &mut measured.planes {
            if let Some(factor) = self.of(plane.colour) {
                plane.rate_adu_per_s *= factor;
                plane.sigma = plane.sigma.times(factor);
            }
        }
    }
}

/// Options with an aperture of [`APERTURE_FWHM`] widths of a point; `None` where that is not wider than the one that is set.
pub(super) fn wide(how: &FrameOptions, fwhm_px: f64) -> Option<PhotometryOptions> {
    let radius_px = aperture_px(fwhm_px);
    if how.aperture_from_frames || how.photometry.aperture_radius_px >= radius_px {
        return None;
    }
    let mut wide = how.clone();
    wide.set_aperture(radius_px);
    wide.photometry.fwhm_px = fwhm_px;
    Some(wide.photometry)
}

/// Ratios of a visit's frames.
#[derive(Debug)]
pub(super) struct WingsBuilder {
    aperture_px: f64,
    wide_px: f64,
    reducer: FrameReducer,
    ratios: Vec<(Colour, f64)>,
    frames: usize,
}

impl WingsBuilder {
    /// # Errors
    /// Options out of their range.
    pub fn new(
        aperture_px: f64,
        wide: PhotometryOptions,
        calibration: FrameCalibration,
    ) -> Result<Self, PhotometryError> {
        let wide_px = wide.aperture_radius_px;
        let reducer = FrameReducer::new(wide, calibration)?;
        Ok(Self { aperture_px, wide_px, reducer, ratios: Vec::new(), frames: 0 })
    }

    /// Whether a measurement in the small aperture can tell.
    pub fn takes(measured: &FrameMeasurement) -> bool {
        let tells = |p: &crate::photometry::PlaneMeasurement| {
            p.rate_adu_per_s > 0.0
                && p.sigma.total() < DIM * p.rate_adu_per_s
                && !p.flags.intersects(Flags::CROWDED | Flags::SATURATED | Flags::MASKED_PIXELS)
        };
        measured.aperture.is_some() && measured.planes.iter().any(tells)
    }

    /// Measures a frame in the wide aperture, at the same place: the ratios of its colours that tell.
    pub fn ratios(&self, frame: &Frame, measured: &FrameMeasurement) -> Vec<(Colour, f64)> {
        let Some(aperture) = measured.aperture else { return Vec::new() };
        let expected = Expected { trail_px: Some(aperture.trail_px), ..Expected::default() };
        let mut reducer = self.reducer.beside();
        let Ok(wide) = reducer.measure_among(frame, aperture.centre_px, &expected) else {
            return Vec::new();
        };
        let bad = Flags::CROWDED | Flags::SATURATED | Flags::MASKED_PIXELS;
        let mut ratios = Vec::new();
        for (wide, small) in wide.planes.iter().zip(&measured.planes) {
            let rate = wide.rate_adu_per_s;
            let sure = rate > 0.0 && wide.sigma.total() < DIM * rate;
            if sure && small.rate_adu_per_s > 0.0 && !(wide.flags | small.flags).intersects(bad) {
                ratios.push((small.colour, rate / small.rate_adu_per_s));
            }
        }
        ratios
    }

    /// Adds the ratios of a frame.
    pub fn add(&mut self, ratios: Vec<(Colour, f64)>) {
        self.frames += usize::from(!ratios.is_empty());
        self.ratios.extend(ratios);
    }

    /// The median ratio of each colour, with the standard error that their scatter gives it; a colour that too few frames tell has that of all colours.
    pub fn finish(self, colours: &[Colour]) -> Wings {
        let of = |only: Option<Colour>| {
            let ratios = self.ratios.iter().filter(|(colour, _)| only.is_none_or(|c| c == *colour));
            let ratios: Vec<f64> = ratios.map(|(_, ratio)| *ratio).collect();
            let factor = median(ratios.iter().copied()).filter(|_| ratios.len() >= LEAST)?;
            let apart = median(ratios.iter().map(|ratio| (ratio - factor).abs()))?;
            // Scatter from the median deviation, and the standard error of a median, of normal ratios.
            let sigma = 1.4826 * apart * (std::f64::consts::FRAC_PI_2 / ratios.len() as f64).sqrt();
            (sigma <= UNCERTAIN * factor).then_some((factor, sigma))
        };
        let factor = |colour: &Colour| {
            let (factor, sigma) = of(Some(*colour)).or_else(|| of(None))?;
            Some(WingFactor { colour: *colour, factor, sigma })
        };
        let factors: Option<Vec<WingFactor>> = colours.iter().map(factor).collect();
        Wings {
            aperture_px: self.aperture_px,
            wide_px: self.wide_px,
            factors: factors.unwrap_or_default(),
            frames: self.frames,
        }
    }
}
