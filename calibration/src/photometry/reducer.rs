//! Frame after frame: find the target, measure it, count what each rule removed.

use super::PhotometryError;
use super::aperture::{self, Summing};
use super::background::Clipping;
use super::calibrate::FrameCalibration;
use super::centroid::{Centroid, FWHM_PER_SIGMA, balanced, windowed};
use super::detect::{Detection, Detector, Rejection, Sought, first_px};
use super::look::{Look, Setting};
use super::measurement::{FrameMeasurement, PlaneMeasurement, Tally};
use super::options::{Choice, PhotometryOptions, Trail};
use super::overlap::Aperture;
use super::window::{Plane, Reading};
use crate::track::{Place, TrackPoint};
use glam::DVec2;
use hifitime::{Duration, Unit};
use std::sync::Arc;
use sunglint_formats::frame::Frame;
use sunglint_radiometry::light_curve::Flags;

/// Information about a frame's target that is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Expected {
    /// Column and row of the frame where it should be; `None` is the frame's middle.
    pub place_px: Option<DVec2>,
    /// Columns and rows that it moves by in the exposure, where the options know no trail.
    pub trail_px: Option<DVec2>,
    /// Airmass, for the scintillation.
    pub airmass: Option<f64>,
    /// Radius of the aperture, px, where it is another than the options'; the annulus is in proportion.
    pub aperture_radius_px: Option<f64>,
}

impl Expected {
    /// Radius of the aperture, px.
    fn radius_px(&self, options: &PhotometryOptions) -> f64 {
        self.aperture_radius_px.unwrap_or(options.aperture_radius_px)
    }
}

/// Measures frames. Holds the calibration of the sensor, buffers, and the tally of what was removed.
#[derive(Debug)]
pub struct FrameReducer {
    options: PhotometryOptions,
    calibration: Arc<FrameCalibration>,
    desk: Desk,
    tally: Tally,
    /// How far from its expected place the last target was, px.
    last_offset_px: f64,
}

/// Buffers of a measurement: frames that are measured side by side need one each.
#[derive(Debug, Default)]
pub(crate) struct Desk {
    detector: Detector,
    look: Look,
}

/// A measurement of a frame, and what its reducer keeps of it.
#[derive(Debug)]
pub(crate) struct Measured {
    pub measurement: FrameMeasurement,
    tally: Tally,
    /// Distance of the target from its expected place, px; `None` without one.
    offset_px: Option<f64>,
}

impl FrameReducer {
    /// # Errors
    /// [`PhotometryError::Option`] for an option out of its range.
    pub fn new(
        options: PhotometryOptions,
        calibration: FrameCalibration,
    ) -> Result<Self, PhotometryError> {
        options.check()?;
        Ok(Self {
            options,
            calibration: Arc::new(calibration),
            desk: Desk::default(),
            tally: Tally::default(),
            last_offset_px: 0.0,
        })
    }

    /// Expects points of another width from now on, and another target.
    ///
    /// # Errors
    /// [`PhotometryError::Option`] for a width out of its range.
    pub fn set_fwhm_px(&mut self, fwhm_px: f64) -> Result<(), PhotometryError> {
        let options = PhotometryOptions { fwhm_px, ..self.options.clone() };
        options.check()?;
        self.options = options;
        self.last_offset_px = 0.0;
        Ok(())
    }

    /// Takes sources at most this far from where the target is expected from now on, px.
    ///
    /// # Errors
    /// [`PhotometryError::Option`] for a distance below 0.
    pub fn set_max_offset_px(&mut self, max_offset_px: f64) -> Result<(), PhotometryError> {
        let mut options = self.options.clone();
        options.detection.max_offset_px = max_offset_px;
        options.check()?;
        self.options = options;
        Ok(())
    }

    /// The same with buffers and a tally of its own: for frames side by side.
    pub(crate) fn beside(&self) -> Self {
        Self {
            options: self.options.clone(),
            calibration: self.calibration.clone(),
            desk: Desk::default(),
            tally: Tally::default(),
            last_offset_px: self.last_offset_px,
        }
    }

    /// Distance from an expected place within which a search sees every source, px: the first part of the frame that is searched, as far as sources may be off.
    pub(crate) fn surely_px(&self) -> f64 {
        match self.options.detection.choice {
            Choice::Nearest => first_px(self.options.fwhm_px),
            // Sources far off may be brighter.
            Choice::Brightest => 0.0,
        }
        .min(self.options.detection.max_offset_px)
    }

    /// A frame that is not measured: no place, and planes without a rate, which have these flags.
    pub fn unmeasured(&self, frame: &Frame, flags: Flags) -> FrameMeasurement {
        let planes = Plane::of(frame.bayer).map(|plane| aperture::empty(plane.colour, flags));
        FrameMeasurement { planes: planes.collect(), ..without_target(frame, None) }
    }

    /// Calibration of the sensor.
    pub fn calibration(&self) -> &FrameCalibration {
        &self.calibration
    }

    /// Returns the numbers of what was removed so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Finds the target in a frame and measures it.
    ///
    /// A frame without a target is measured, too: no place, and planes without a rate, flagged [`Flags::UNDETECTED`].
    ///
    /// # Errors
    /// A frame without gain or exposure, or one that the calibration does not cover.
    pub fn measure(
        &mut self,
        frame: &Frame,
        expected: &Expected,
    ) -> Result<FrameMeasurement, PhotometryError> {
        let mut desk = std::mem::take(&mut self.desk);
        let measured = self.measured(frame, expected, &mut desk);
        self.desk = desk;
        Ok(self.keep(measured?))
    }

    /// Measures a frame like [`measure`](Self::measure), and keeps nothing of it: for frames side by side.
    pub(crate) fn measured(
        &self,
        frame: &Frame,
        expected: &Expected,
        desk: &mut Desk,
    ) -> Result<Measured, PhotometryError> {
        let (reading, setting) = prepare(frame, &self.options, &self.calibration, expected)?;
        let sought = sought(frame, &self.options, expected, self.last_offset_px);
        let detection = desk.detector.find(&reading, &sought, &setting);
        let mut tally = count(&detection);
        let Some(target) = detection.target.map(|t| detection.candidates[t]) else {
            tally.undetected = 1;
            let planes = self.unmeasured(frame, Flags::UNDETECTED).planes;
            let twinkling = self.twinkling(frame, expected);
            let measurement = FrameMeasurement { planes, ..without_target(frame, twinkling) };
            return Ok(Measured { measurement, tally, offset_px: None });
        };
        let aperture = Aperture {
            centre_px: target.place_px,
            radius_px: expected.radius_px(&self.options),
            trail_px: self.trail(expected, target.trail_px),
        };
        let fwhm = target.centroid.map_or(self.options.fwhm_px, |c| c.fwhm_px.low);
        let searched = Some((fwhm, &detection.cosmic_ray_px[..]));
        let of = (&reading, &setting);
        let mut measurement = self.at(of, aperture, searched, expected, &mut desk.look, &mut tally);
        measurement.candidates = detection.passed();
        let crowded = measurement.aperture.is_some_and(|aperture| detection.crowded(&aperture));
        flag_crowded(&mut measurement, &mut tally, crowded);
        let offset_px = Some(sought.offset_px(&target));
        Ok(Measured { measurement, tally, offset_px })
    }

    /// Keeps what a measurement says for the next one, and its tally.
    pub(crate) fn keep(&mut self, measured: Measured) -> FrameMeasurement {
        let Measured { measurement, tally, offset_px } = measured;
        self.tally += tally;
        // The next target is looked for there first.
        self.last_offset_px = offset_px.unwrap_or(self.last_offset_px);
        measurement
    }

    /// Measures around a known place, without a search and without a centroid: `place_px` is where the aperture lies. What else may lie in it is not
    /// looked for: [`measure_among`](Self::measure_among) does.
    ///
    /// # Errors
    /// The errors of [`FrameReducer::measure`].
    pub fn measure_at(
        &mut self,
        frame: &Frame,
        place_px: impl Into<DVec2>,
        expected: &Expected,
    ) -> Result<FrameMeasurement, PhotometryError> {
        let (reading, setting) = prepare(frame, &self.options, &self.calibration, expected)?;
        let trail_px = self.trail(expected, DVec2::ZERO);
        let (centre_px, radius_px) = (place_px.into(), expected.radius_px(&self.options));
        let aperture = Aperture { centre_px, radius_px, trail_px };
        let mut look = std::mem::take(&mut self.desk.look);
        let mut tally = Tally { frames: 1, ..Tally::default() };
        let of = (&reading, &setting);
        let measured = self.at(of, aperture, None, expected, &mut look, &mut tally);
        self.desk.look = look;
        self.tally += tally;
        Ok(measured)
    }

    /// Measures like [`measure_at`](Self::measure_at), and searches around the place: where a source whose middle is more than a point's width away from it, or a cosmic
    /// ray, has light in the aperture, the planes are flagged [`Flags::CROWDED`].
    ///
    /// # Errors
    /// The errors of [`FrameReducer::measure`].
    pub fn measure_among(
        &mut self,
        frame: &Frame,
        place_px: impl Into<DVec2>,
        expected: &Expected,
    ) -> Result<FrameMeasurement, PhotometryError> {
        let place_px = place_px.into();
        let mut measured = self.measure_at(frame, place_px, expected)?;
        let Some(aperture) = measured.aperture.filter(|_| place_px.is_finite()) else {
            return Ok(measured);
        };
        let (reading, setting) = prepare(frame, &self.options, &self.calibration, expected)?;
        let around = Expected { place_px: Some(place_px), ..*expected };
        let sought = sought(frame, &self.options, &around, self.last_offset_px);
        let within_px = aperture.radius_px + aperture.trail_length_px() + self.options.fwhm_px;
        let detection = self.desk.detector.search(&reading, &sought, &setting, within_px);
        let own =
            detection.nearest(place_px, self.options.fwhm_px + 0.5 * aperture.trail_length_px());
        let crowded = detection.others_in(&aperture, own);
        flag_crowded(&mut measured, &mut self.tally, crowded);
        Ok(measured)
    }

    /// The sources of a frame around where the target is expected, without a measurement; the tally stays as it is.
    ///
    /// # Errors
    /// The errors of [`FrameReducer::measure`].
    pub fn detect(
        &mut self,
        frame: &Frame,
        expected: &Expected,
    ) -> Result<Detection, PhotometryError> {
        let (reading, setting) = prepare(frame, &self.options, &self.calibration, expected)?;
        let sought = sought(frame, &self.options, expected, self.last_offset_px);
        let detection = self.desk.detector.find(&reading, &sought, &setting);
        if let Some(target) = detection.target.and_then(|t| detection.candidates.get(t)) {
            self.last_offset_px = sought.offset_px(target);
        }
        Ok(detection)
    }

    /// Background of a pixel and its standard error, ADU, of each plane in an annulus about a place; NaN where there is none. The tally stays as it is.
    ///
    /// # Errors
    /// The errors of [`FrameReducer::measure`].
    pub(crate) fn sky_about(
        &self,
        frame: &Frame,
        place_px: [f64; 2],
    ) -> Result<Vec<[f64; 2]>, PhotometryError> {
        let expected = Expected::default();
        let (reading, setting) = prepare(frame, &self.options, &self.calibration, &expected)?;
        let aperture = Aperture {
            centre_px: place_px.into(),
            radius_px: self.options.aperture_radius_px,
            trail_px: DVec2::ZERO,
        };
        let size = [frame.pixels.ncols(), frame.pixels.nrows()];
        let setting = setting.within(&aperture, size);
        let mut look = Look::default();
        look.at(&reading, &aperture, &setting);
        let of = |(_, background): &(Plane, Option<super::Background>)| {
            background.map_or([f64::NAN; 2], |b| [b.level_adu, b.level_sigma_adu])
        };
        Ok(look.planes.iter().map(of).collect())
    }

    /// The trail of the aperture: none where it is shorter than half a point's width.
    fn trail(&self, expected: &Expected, seen: DVec2) -> DVec2 {
        let trail = match expected.trail_px.map_or(self.options.trail, Trail::Known) {
            Trail::Point => DVec2::ZERO,
            Trail::Known(trail) => trail,
            Trail::Estimated => seen,
        };
        let long = trail[0].hypot(trail[1]) > 0.5 * self.options.fwhm_px;
        if long { trail } else { DVec2::ZERO }
    }

    /// Centroid (where the target was searched for: with its width and the cosmic rays) and planes of an aperture.
    fn at(
        &self,
        (reading, setting): (&Reading<'_>, &Setting),
        mut aperture: Aperture,
        searched: Option<(f64, &[DVec2])>,
        expected: &Expected,
        look: &mut Look,
        tally: &mut Tally,
    ) -> FrameMeasurement {
        let frame = reading.frame;
        let size = [frame.pixels.ncols(), frame.pixels.nrows()];
        let whole = setting;
        let mut setting = whole.within(&aperture, size);
        look.at(reading, &aperture, &setting);
        let mut centroid = None;
        if let Some((fwhm_px, without)) = searched {
            let window_fwhm_px = self.options.fwhm_px;
            let widths_px = [window_fwhm_px, fwhm_px];
            centroid = centroid_of(look, reading, &setting, &aperture, widths_px, without);
            if let Some(found) = centroid {
                let moved = (found.place_px[0] - aperture.centre_px[0])
                    .hypot(found.place_px[1] - aperture.centre_px[1]);
                aperture.centre_px = found.place_px;
                let moved_setting = whole.within(&aperture, size);
                if moved > 0.5 || moved_setting.annulus_px != setting.annulus_px {
                    setting = moved_setting;
                    look.at(reading, &aperture, &setting);
                }
            }
        }
        let planes = self.planes(frame, &setting, aperture, centroid, look, tally);
        let fwhm_px = centroid.map(|c| c.point_fwhm_px()).filter(|f| f.is_finite());
        let mut measured = FrameMeasurement {
            place_px: Some(aperture.centre_px),
            aperture: Some(aperture),
            annulus_px: Some(setting.annulus_px.into()),
            fwhm_px,
            candidates: 1,
            planes,
            ..without_target(frame, self.twinkling(frame, expected))
        };
        measured.track.place = centroid.map(|c| self.on_sensor(frame, &c));
        measured
    }

    /// The planes' rates, with their flags, counted.
    fn planes(
        &self,
        frame: &Frame,
        setting: &Setting,
        aperture: Aperture,
        centroid: Option<Centroid>,
        look: &Look,
        tally: &mut Tally,
    ) -> Vec<PlaneMeasurement> {
        const FULLY_SAMPLED_FWHM_PX: f64 = 3.0;
        let size = [frame.pixels.ncols(), frame.pixels.nrows()];
        let summing = Summing {
            aperture,
            fwhm_px: centroid.map_or(self.options.fwhm_px, |c| c.point_fwhm_px().min(1e3)),
            exposure_s: frame.exposure_s,
            gain_e_per_adu: setting.gain_e_per_adu,
            max_masked_light: self.options.max_masked_light,
            cut: leaves(&aperture, aperture.radius_px, size),
        };
        let mut flags = Flags::empty();
        flags.set(Flags::TRAILED, aperture.trail_px != DVec2::ZERO);
        flags.set(Flags::EDGE, leaves(&aperture, setting.annulus_px[1], size));
        flags.set(Flags::UNDERSAMPLED, summing.fwhm_px < FULLY_SAMPLED_FWHM_PX);
        tally.undersampled += u64::from(flags.contains(Flags::UNDERSAMPLED));
        let mut planes = Vec::with_capacity(look.planes.len());
        for (plane, background) in &look.planes {
            let mut measured =
                aperture::measure(&look.window, *plane, background.as_ref(), &summing);
            measured.flags |= flags;
            count_plane(tally, &measured, background.is_some(), summing.cut);
            planes.push(measured);
        }
        planes
    }

    /// A centroid as a place on the sensor.
    fn on_sensor(&self, frame: &Frame, centroid: &Centroid) -> Place {
        let binning = frame.binning.map(f64::from);
        let offset_px = [0, 1].map(|axis| {
            // Pixels' middles are half a pixel from their edges.
            let place =
                f64::from(frame.origin[axis]) + (centroid.place_px[axis] + 0.5) * binning[axis];
            place - 0.5 * f64::from(self.options.sensor_px[axis])
        });
        let [xx, yy, xy] = centroid.covariance_px2;
        let covariance_px2 =
            [xx * binning[0].powi(2), yy * binning[1].powi(2), xy * binning[0] * binning[1]];
        Place { offset_px: offset_px.into(), covariance_px2 }
    }

    fn twinkling(&self, frame: &Frame, expected: &Expected) -> Option<f64> {
        let scintillation = self.options.scintillation.as_ref()?;
        Some(scintillation.relative_sigma(frame.exposure_s, expected.airmass?))
    }
}

/// The tally of a frame's sources.
fn count(detection: &Detection) -> Tally {
    let mut tally = Tally {
        frames: 1,
        cosmic_ray_pixels: detection.cosmic_ray_px.len() as u64,
        ambiguous: u64::from(detection.passed() > 1),
        ..Tally::default()
    };
    for candidate in &detection.candidates {
        let counter = match candidate.rejection {
            None => continue,
            Some(Rejection::Area) => &mut tally.rejected_area,
            Some(Rejection::Fill) => &mut tally.rejected_fill,
            Some(Rejection::Aspect) => &mut tally.rejected_aspect,
            Some(Rejection::Sharp) => &mut tally.rejected_sharp,
            Some(Rejection::Wide) => &mut tally.rejected_wide,
            Some(Rejection::Streak) => &mut tally.rejected_streak,
            Some(Rejection::Edge) => &mut tally.rejected_edge,
            Some(Rejection::Offset) => &mut tally.rejected_offset,
        };
        *counter += 1;
    }
    tally
}

fn flag_crowded(measured: &mut FrameMeasurement, tally: &mut Tally, crowded: bool) {
    tally.crowded += u64::from(crowded);
    for plane in &mut measured.planes {
        plane.flags.set(Flags::CROWDED, crowded);
    }
}

/// The centroid of what lies in an aperture that was looked at: under a window of the first width, or of a trail of the second.
fn centroid_of(
    look: &mut Look,
    reading: &Reading<'_>,
    setting: &Setting,
    aperture: &Aperture,
    [window_fwhm_px, fwhm_px]: [f64; 2],
    without: &[DVec2],
) -> Option<Centroid> {
    let light = look.light(reading, setting, without)?;
    if aperture.trail_px == DVec2::ZERO {
        return windowed(&light, aperture.centre_px.to_array(), window_fwhm_px / FWHM_PER_SIGMA);
    }
    balanced(&light, aperture, fwhm_px)
}

/// Gains are the same within this part.
const SAME_GAIN: f64 = 0.01;

/// Electrons for an ADU and saturation, ADU, of a frame: its own, else those of the options. A saturation of the options holds at their gain: there the lower of
/// both counts, because a camera may name the end of its converter, and its pixels be full before; at another gain it is brought to the frame's.
fn known(frame: &Frame, options: &PhotometryOptions) -> [Option<f64>; 2] {
    let own = frame.gain_e_per_adu.filter(|&gain| gain > 0.0);
    let other = own.zip(options.gain_e_per_adu).map(|(own, usual)| usual / own);
    let other = other.filter(|ratio| (ratio - 1.0).abs() > SAME_GAIN);
    let saturation = match (frame.saturation_adu, options.saturation_adu, other) {
        (Some(own), Some(usual), None) => Some(own.min(usual)),
        (None, Some(usual), Some(ratio)) => Some((usual * ratio).min(f64::from(u16::MAX))),
        (own, usual, _) => own.or(usual),
    };
    [own.or(options.gain_e_per_adu).filter(|&gain| gain > 0.0), saturation]
}

/// The frame over its calibration, and what a look at it needs.
fn prepare<'a>(
    frame: &'a Frame,
    options: &PhotometryOptions,
    calibration: &'a FrameCalibration,
    expected: &Expected,
) -> Result<(Reading<'a>, Setting), PhotometryError> {
    let exposure_s = frame.exposure_s;
    if exposure_s.is_nan() || exposure_s <= 0.0 {
        return Err(PhotometryError::Exposure { exposure_s });
    }
    let [gain, saturation] = known(frame, options);
    let gain_e_per_adu = gain.ok_or(PhotometryError::NoGain)?;
    let saturation_adu = saturation.unwrap_or_else(|| f64::from(u16::MAX));
    let clipping = Clipping {
        sigma: options.clip_sigma,
        rounds: options.clip_rounds,
        // The noise of a dark that is taken off is no photons' either.
        gain_and_read_noise: Some((
            gain_e_per_adu,
            options.read_noise_e.hypot(gain_e_per_adu * calibration.noise_adu()),
        )),
        step_adu: if calibration.keeps_counts() { 1.0 } else { 0.0 },
    };
    let reading = Reading { frame, laid: calibration.over(frame)?, saturation_adu };
    let larger = expected.radius_px(options) / options.aperture_radius_px;
    let annulus_px = options.annulus_px.to_array().map(|radius| larger * radius);
    Ok((reading, Setting { annulus_px, clipping, gain_e_per_adu }))
}

/// Returns the inputs of a search for the target.
fn sought<'a>(
    frame: &Frame,
    options: &'a PhotometryOptions,
    expected: &Expected,
    last_offset_px: f64,
) -> Sought<'a> {
    let middle = || [frame.pixels.ncols(), frame.pixels.nrows()].map(|n| 0.5 * (n as f64 - 1.0));
    Sought {
        options: &options.detection,
        fwhm_px: options.fwhm_px,
        trail: expected.trail_px.map_or(options.trail, Trail::Known),
        place_px: expected.place_px.map_or_else(middle, |place| place.to_array()),
        aperture_radius_px: expected.radius_px(options),
        probably_px: last_offset_px + 4.0 * options.fwhm_px,
    }
}

fn without_target(frame: &Frame, scintillation: Option<f64>) -> FrameMeasurement {
    let exposure: Duration = frame.exposure_s * Unit::Second;
    let time = frame.start + exposure * 0.5;
    FrameMeasurement {
        time,
        exposure_s: frame.exposure_s,
        track: TrackPoint { time, exposure_s: frame.exposure_s, place: None },
        place_px: None,
        aperture: None,
        annulus_px: None,
        fwhm_px: None,
        candidates: 0,
        scintillation,
        planes: Vec::new(),
    }
}

const ROUNDING_PX: f64 = 1e-9;

/// Whether an aperture with this radius goes beyond the frame's edge.
fn leaves(aperture: &Aperture, radius_px: f64, size: [usize; 2]) -> bool {
    let half = aperture.half_box_px(radius_px);
    (0..2).any(|axis| {
        let (low, high) =
            (aperture.centre_px[axis] - half[axis], aperture.centre_px[axis] + half[axis]);
        // A place that is not a number leaves every frame; an annulus that was made to end at the edge does not.
        !(low >= -0.5 - ROUNDING_PX && high <= size[axis] as f64 - 0.5 + ROUNDING_PX)
    })
}

fn count_plane(tally: &mut Tally, plane: &PlaneMeasurement, background: bool, cut: bool) {
    let measured = !plane.rate_adu_per_s.is_nan();
    tally.saturated += u64::from(plane.saturated_pixels > 0);
    tally.edge += u64::from(cut);
    tally.no_background += u64::from(!background);
    tally.with_masked_pixels += u64::from(measured && plane.masked_fraction > 0.0);
    let masked = !measured && background && !cut && plane.saturated_pixels == 0;
    tally.masked += u64::from(masked);
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::fits::Header;

    /// Truth: by hand: a station of 0.3 electrons an ADU that saturates at 50,000 ADU. A frame's own numbers count; at the station's gain its pixels are full at 50,000 whatever the converter
    /// takes; at 0.6 electrons an ADU the same electrons are half the ADU.
    #[test]
    fn a_frames_own_numbers_come_first() {
        let mut options = PhotometryOptions::new([4, 4], 3.0);
        (options.gain_e_per_adu, options.saturation_adu) = (Some(0.3), Some(50_000.0));
        for (own, expected) in [
            ((None, None), (0.3, 50_000.0)),
            ((Some(0.6), None), (0.6, 25_000.0)),
            ((Some(0.6), Some(4095.0)), (0.6, 4095.0)),
            ((Some(0.3), Some(65_535.0)), (0.3, 50_000.0)),
            ((None, Some(4095.0)), (0.3, 4095.0)),
            ((Some(0.6), Some(65_535.0)), (0.6, 65_535.0)),
            ((Some(0.1), None), (0.1, 65_535.0)),
            ((Some(0.0), None), (0.3, 50_000.0)),
        ] {
            let frame = Frame {
                pixels: ndarray::Array2::zeros((4, 4)),
                origin: [0, 0],
                binning: [1, 1],
                bayer: None,
                start: hifitime::Epoch::from_unix_seconds(1.6e9),
                exposure_s: 1.0,
                gain_e_per_adu: own.0,
                temperature_c: None,
                saturation_adu: own.1,
                header: Header::default(),
            };
            let calibration = FrameCalibration::default();
            let expected_there = Expected::default();
            let (reading, setting) =
                prepare(&frame, &options, &calibration, &expected_there).unwrap();
            let [gain, noise] = [setting.gain_e_per_adu, reading.saturation_adu];
            assert!((gain - expected.0).abs() < 1e-9, "{own:?}: {gain}");
            assert!((noise - expected.1).abs() < 1e-6, "{own:?}: {noise}");
            assert_eq!(setting.clipping.gain_and_read_noise, Some((expected.0, 3.0)));
        }
    }
}
