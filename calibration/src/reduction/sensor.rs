//! The sensor's calibration for each setting of a camera: dark frames, bias frames and flats of the session that fit it, or files that were given.

use super::error::Within as _;
use super::frames::SensorFiles;
use super::library::{Found, Library, MasterKind};
use super::{ReduceError, Stay};
use crate::photometry::{BadPixels, FrameCalibration, MasterFrame, PixelFault};
use std::collections::{BTreeSet, HashSet};
use std::path::PathBuf;
use sunglint_formats::Frame;
use sunglint_formats::session::{FrameFile, TargetKind};

/// More dark frames, bias frames or flats of one setting add nothing, and are left out.
const MOST: usize = 64;
/// Files of one kind that are looked at.
const MOST_FILES: usize = 1024;
/// Fewer frames make neither mask nor dark nor flat.
const LEAST: usize = 3;
/// A pixel this many standard deviations of the dark frames' distribution off it is bad (thesis 4.1.1).
const BAD_SIGMAS: f64 = 3.0;
/// Least response of a pixel to a flat.
const BLIND: f32 = 0.5;
/// Temperatures of a dark and a frame differ by at most this, °C.
const NEAR_C: f64 = 2.0;

/// How a frame was taken, as far as calibration frames must be like it.
#[derive(Debug, Clone, PartialEq)]
pub struct Taken {
    pub(super) exposure_s: f64,
    pub(super) origin: [u32; 2],
    pub(super) binning: [u32; 2],
    pub(super) dim: (usize, usize),
    pub(super) gain: Option<f64>,
    pub(super) temperature_c: Option<f64>,
    /// Name of the filter before the camera.
    pub filter: Option<String>,
}

impl Taken {
    /// As a frame says it.
    pub fn of(frame: &Frame) -> Self {
        Self {
            exposure_s: frame.exposure_s,
            origin: frame.origin,
            binning: frame.binning,
            dim: frame.pixels.dim(),
            gain: frame.header.real("GAIN"),
            temperature_c: frame.temperature_c,
            filter: filter_of(frame),
        }
    }

    /// Sensor pixels in one of the frame.
    pub fn binning(&self) -> [u32; 2] {
        self.binning
    }

    /// Gain in the camera's own steps.
    pub fn gain(&self) -> Option<f64> {
        self.gain
    }

    fn same_exposure(&self, other: &Self) -> bool {
        (self.exposure_s - other.exposure_s).abs() <= 0.01 * other.exposure_s
    }

    /// Whether both have the same pixels: part of the sensor and binning.
    fn same_pixels(&self, other: &Self) -> bool {
        self.origin == other.origin && self.binning == other.binning && self.dim == other.dim
    }

    fn same_gain(&self, other: &Self) -> bool {
        let far = |(a, b): (f64, f64)| (a - b).abs() >= 1e-6 * a.abs().max(1.0);
        !self.gain.zip(other.gain).is_some_and(far)
    }

    /// Whether a bias frame fits a frame: part of the sensor, binning and gain, as far as both say them.
    pub(super) fn fits_bias(&self, frame: &Self) -> bool {
        self.same_pixels(frame) && self.same_gain(frame)
    }

    /// Whether a dark fits a frame: as a bias frame, and exposure (1 %) and temperature.
    pub fn fits(&self, frame: &Self) -> bool {
        let temperatures = self.temperature_c.zip(frame.temperature_c);
        self.same_exposure(frame)
            && self.fits_bias(frame)
            && temperatures.is_none_or(|(a, b)| (a - b).abs() <= NEAR_C)
    }

    /// Whether a flat fits a frame: the same pixels behind the same filter.
    fn fits_flat(&self, frame: &Self) -> bool {
        self.same_pixels(frame) && self.filter == frame.filter
    }

    /// Whether two frames are calibrated alike.
    pub fn is_like(&self, other: &Self) -> bool {
        self.same_exposure(other) && self.fits_bias(other) && self.filter == other.filter
    }
}

/// The filter that a frame's header names.
pub fn filter_of(frame: &Frame) -> Option<String> {
    let name = frame.header.text("FILTER")?.trim();
    (!name.is_empty()).then(|| name.to_owned())
}

/// Calibration frames of a kind.
#[derive(Debug, Default)]
struct Kind {
    files: Vec<(FrameFile, Taken)>,
    used: HashSet<PathBuf>,
}

impl Kind {
    fn of(
        kind: TargetKind,
        files: &[FrameFile],
        stay_of: &[Option<usize>],
        stays: &[Stay],
        failed: &mut Vec<(FrameFile, String)>,
    ) -> Self {
        let is_it =
            |stay: &Option<usize>| stay.is_some_and(|s| stays[s].target.target_kind == kind);
        let found = files.iter().zip(stay_of).filter(|(_, stay)| is_it(stay));
        let mut all = Self::default();
        for (file, _) in found.take(MOST_FILES) {
            match file.read() {
                Ok(frame) => all.files.push((file.clone(), Taken::of(&frame))),
                Err(error) => failed.push((file.clone(), error.to_string())),
            }
        }
        all
    }

    /// Those that fit; none where they are too few.
    fn fitting(&mut self, fits: impl Fn(&Taken) -> bool) -> Vec<Frame> {
        let fitting = self.files.iter().filter(|(_, taken)| fits(taken)).take(MOST);
        let read = |(file, _): &(FrameFile, Taken)| Some((file.path.clone(), file.read().ok()?));
        let frames: Vec<_> = fitting.filter_map(read).collect();
        if frames.len() < LEAST {
            return Vec::new();
        }
        let (paths, frames): (Vec<PathBuf>, Vec<Frame>) = frames.into_iter().unzip();
        self.used.extend(paths);
        frames
    }
}

/// All that a session, or files that were given, have for the calibration of a camera.
#[derive(Debug)]
pub struct Sensor<'a> {
    given: &'a SensorFiles,
    darks: Kind,
    bias: Kind,
    flats: Kind,
    /// Shared masters, and the name that they know the camera by.
    library: Option<(&'a Library, String)>,
    /// Masters that were taken from the library, and added to it.
    pub from_library: BTreeSet<String>,
    /// Masters that were added to it.
    pub to_library: BTreeSet<String>,
    /// Warnings about it.
    pub warnings: Vec<String>,
    /// How frames of targets were taken, some of them spread over the night.
    usual: Vec<Taken>,
}

/// What a session's calibration frames were used for.
#[derive(Debug, Clone, Copy, Default)]
pub struct Used {
    /// Dark frames, and those that fit no setting of frames of targets.
    pub darks: [usize; 2],
    /// Bias frames, where no dark frames fit.
    pub bias: usize,
    /// Flats.
    pub flats: usize,
}

impl<'a> Sensor<'a> {
    /// Looks at the calibration frames of a session, if none are given, and at some of its frames of targets.
    pub fn of(
        files: &[FrameFile],
        stay_of: &[Option<usize>],
        stays: &[Stay],
        given: &'a SensorFiles,
        library: Option<(&'a Library, String)>,
        failed: &mut Vec<(FrameFile, String)>,
    ) -> Self {
        let mut kind = |kind| Kind::of(kind, files, stay_of, stays, failed);
        let none = given.darks.is_empty();
        let darks = if none { kind(TargetKind::Dark) } else { Kind::default() };
        let bias = if none { kind(TargetKind::Bias) } else { Kind::default() };
        let flats = if given.flats.is_empty() { kind(TargetKind::Flat) } else { Kind::default() };
        let on: Vec<&FrameFile> = files
            .iter()
            .zip(stay_of)
            .filter(|(_, stay)| stay.is_some_and(|stay| stays[stay].target.on))
            .map(|(file, _)| file)
            .collect();
        let step = on.len().div_ceil(MOST).max(1);
        let usual = on.iter().step_by(step);
        let usual = usual.filter_map(|file| Some(Taken::of(&file.read().ok()?))).collect();
        let warnings = library.as_ref().map(|(library, _)| library.warnings.clone());
        Self {
            given,
            darks,
            bias,
            flats,
            library,
            from_library: BTreeSet::new(),
            to_library: BTreeSet::new(),
            warnings: warnings.unwrap_or_default(),
            usual,
        }
    }

    /// A master of the library that fits.
    fn master_for(&mut self, kind: MasterKind, fits: impl Fn(&Taken) -> bool) -> Option<Found> {
        let (library, camera) = self.library.as_ref()?;
        match library.find(kind, camera, fits)? {
            Ok(found) => {
                self.from_library.insert(found.name.clone());
                Some(found)
            }
            Err(error) => {
                self.warn(format!("left out of the library: {error}"));
                None
            }
        }
    }

    /// Adds a master of the session's own frames to the library.
    fn keep_master(
        &mut self,
        kind: MasterKind,
        frames: &[Frame],
        mean: &MasterFrame,
        bad: Option<&BadPixels>,
    ) {
        let Some((library, camera)) = self.library.as_ref() else { return };
        match library.keep(kind, camera, frames, mean, bad) {
            Ok(name) => self.to_library.extend(name),
            Err(error) => self.warn(format!("not added to the library: {error}")),
        }
    }

    fn warn(&mut self, warning: String) {
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// The mean of the session's bias frames that fit, else the library's.
    fn bias_for(&mut self, taken: &Taken) -> Result<Option<MasterFrame>, ReduceError> {
        let bias = self.bias.fitting(|bias| bias.fits_bias(taken));
        if bias.is_empty() {
            let found = self.master_for(MasterKind::Bias, |bias| bias.fits_bias(taken));
            return Ok(found.map(|found| found.frame));
        }
        let mean = MasterFrame::mean(&bias).within(|| "the bias frames".into())?;
        self.keep_master(MasterKind::Bias, &bias, &mean, None);
        Ok(Some(mean))
    }

    /// Mask, dark and flat for frames that were taken like this one.
    ///
    /// # Errors
    /// Files that were given and do not fit each other.
    pub fn calibration(&mut self, taken: &Taken) -> Result<FrameCalibration, ReduceError> {
        let mut calibration = FrameCalibration::default();
        let darks = match self.given.darks.is_empty() {
            true => self.darks_for(taken),
            false => self.given.darks.clone(),
        };
        if darks.len() < LEAST {
            // A dark of the library has the mask, too: better than the night's own bias frames.
            if let Some(found) = self.master_for(MasterKind::Dark, |dark| dark.fits(taken)) {
                calibration.bad = found.bad;
                calibration.dark =
                    Some(MasterFrame { exposure_s: taken.exposure_s, ..found.frame });
            } else if let Some(bias) = self.bias_for(taken)? {
                calibration.dark = Some(MasterFrame { exposure_s: taken.exposure_s, ..bias });
            }
        } else {
            let bad = BadPixels::from_darks(&darks, BAD_SIGMAS);
            let bad = bad.within(|| "the dark frames".into())?;
            let dark = MasterFrame::mean(&darks).within(|| "the dark frames".into())?;
            if self.given.darks.is_empty() {
                self.keep_master(MasterKind::Dark, &darks, &dark, Some(&bad));
            }
            (calibration.bad, calibration.dark) = (Some(bad), Some(dark));
        }
        let Some(dark) = calibration.dark.clone() else { return Ok(calibration) };
        let flats = match self.given.flats.is_empty() {
            true => self.flats.fitting(|flat| flat.fits_flat(taken)),
            false => self.given.flats.clone(),
        };
        let mut flat = None;
        if !flats.is_empty() {
            // The level without light: bias frames where there are some, because flats have other exposures than the frames.
            let bias = self.bias_for(taken)?;
            let own = self.given.flats.is_empty().then(|| flats.clone());
            // A flat may have any exposure.
            let alike = |mut flat: Frame| {
                flat.exposure_s = taken.exposure_s;
                flat
            };
            let flats: Vec<Frame> = flats.into_iter().map(alike).collect();
            let made = MasterFrame::flat(&flats, bias.as_ref().unwrap_or(&dark));
            let made = made.within(|| "the flats".into())?;
            if let Some(own) = own {
                self.keep_master(MasterKind::Flat, &own, &made, None);
            }
            flat = Some(made);
        } else if let Some(found) = self.master_for(MasterKind::Flat, |flat| flat.fits_flat(taken))
        {
            flat = Some(MasterFrame { exposure_s: taken.exposure_s, ..found.frame });
        }
        if let Some(flat) = flat {
            if let Some(bad) = &mut calibration.bad {
                bad.add_blind(&flat, BLIND).within(|| "the flats".into())?;
            }
            calibration.flat = Some(flat);
        }
        Ok(calibration)
    }

    /// The dark frames that fit most of the frames that were taken like this one; all of them where no frame of a target can be read.
    fn darks_for(&mut self, taken: &Taken) -> Vec<Frame> {
        if self.usual.is_empty() {
            return self.darks.fitting(|_| true);
        }
        let alike: Vec<&Taken> = self.usual.iter().filter(|usual| usual.is_like(taken)).collect();
        let darks = |frame: &Taken| self.darks.files.iter().filter(|(_, d)| d.fits(frame)).count();
        // The frames that the most others are alike; of equal ones those with the most darks.
        let usual = alike
            .iter()
            .max_by_key(|a| (alike.iter().filter(|b| a.fits(b)).count(), darks(a)))
            .map_or_else(|| taken.clone(), |usual| (*usual).clone());
        self.darks.fitting(|dark| dark.fits(&usual))
    }

    /// What was used so far.
    pub fn used(&self) -> Used {
        let darks = match self.given.darks.is_empty() {
            true => [self.darks.used.len(), self.darks.files.len() - self.darks.used.len()],
            false => [self.given.darks.len(), 0],
        };
        let flats = match self.given.flats.is_empty() {
            true => self.flats.used.len(),
            false => self.given.flats.len(),
        };
        Used { darks, bias: self.bias.used.len(), flats }
    }
}

/// Pixels of a mask that are left out.
pub fn bad_count(bad: &BadPixels) -> usize {
    bad.faults.iter().filter(|fault: &&PixelFault| !fault.is_empty()).count()
}
