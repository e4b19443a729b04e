//! The sensor's calibration for each setting of a camera: dark frames, bias frames and flats of the session that fit it, or files that were given.

use super::error::Within as _;
use super::frames::SensorFiles;
use super::held::Reads;
use super::library::{Found, Library, MasterKind};
use super::{ReduceError, Stay};
use crate::photometry::field::cut_flat;
use crate::photometry::{BadPixels, FrameCalibration, MasterFrame, PixelFault};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::PathBuf;
use sunglint_formats::session::{FILTER_DOUBTED, FLAT_LEVEL, FrameFile, TargetKind, is_near_level};
use sunglint_formats::{FileError, Frame};

/// More dark frames, bias frames or flats of one setting add nothing, and are left out.
const MOST: usize = 64;
/// Files of one kind that are looked at.
const MOST_FILES: usize = 1024;
/// Files whose setting is looked at side by side.
const SIDE_BY_SIDE: usize = 8;
/// Fewer frames make neither mask nor dark nor flat.
const LEAST: usize = 3;
/// A pixel this many standard deviations of the dark frames' distribution off it is bad (thesis 4.1.1).
const BAD_SIGMAS: f64 = 3.0;
/// Least response of a pixel to a flat.
const BLIND: f32 = 0.5;
/// Largest part of the sensor that a mask may leave out: beyond it the calibration frames are none.
pub(super) const MOST_BAD: f64 = 0.2;
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
    /// The same as a frame says it.
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

    /// Whether a flat fits a frame: the same pixels at the same gain behind the same filter.
    fn fits_flat(&self, frame: &Self) -> bool {
        self.fits_bias(frame) && self.filter == frame.filter
    }

    /// Whether two frames are calibrated alike.
    pub fn is_like(&self, other: &Self) -> bool {
        self.same_exposure(other) && self.fits_bias(other) && self.filter == other.filter
    }
}

/// The filter that a frame's header names; `unknown` where nobody saw it.
pub fn filter_of(frame: &Frame) -> Option<String> {
    if frame.header.get(FILTER_DOUBTED).is_some() {
        return Some("unknown".into());
    }
    let name = frame.header.text("FILTER")?.trim();
    (!name.is_empty()).then(|| name.to_owned())
}

/// Kind of a frame by its own header: the driver's word, else what the program wrote. `None` where it tells none.
pub(crate) fn said_kind(frame: &Frame) -> Option<TargetKind> {
    let of = |keyword: &str| frame.header.text(keyword).map(|word| word.trim().to_lowercase());
    let word = of("FRAME").or_else(|| of("IMAGETYP"))?;
    let kinds = [
        ("dark", TargetKind::Dark),
        ("bias", TargetKind::Bias),
        ("flat", TargetKind::Flat),
        ("light", TargetKind::None),
    ];
    let (_, kind) = kinds.into_iter().find(|(begin, _)| word.starts_with(begin))?;
    // Programs before wrote `Light Frame` where a camera took no type, and the planned kind beside it.
    let planned = of("OBJTYPE").filter(|_| kind == TargetKind::None && of("FRAME").is_none());
    let planned = planned.and_then(|planned| kinds[..3].iter().find(|(word, _)| *word == planned));
    Some(planned.map_or(kind, |(_, kind)| *kind))
}

/// Why a frame of a calibration visit is none of its kind.
fn unfit(kind: TargetKind, frame: &Frame) -> Option<String> {
    if let Some(said) = said_kind(frame).filter(|said| *said != kind) {
        let word = match said {
            TargetKind::Dark => "dark frames",
            TargetKind::Bias => "bias frames",
            TargetKind::Flat => "flats",
            _ => "light frames",
        };
        return Some(format!("by their headers they are {word}"));
    }
    if kind != TargetKind::Flat {
        return None;
    }
    if let Some(end) = cut_flat(frame.pixels.view(), frame.saturation_adu) {
        return Some(format!("they are saturated ({end} ADU)"));
    }
    let level = frame.header.real(FLAT_LEVEL).filter(|level| *level > 0.0)?;
    let median = frame.median_adu()?;
    (!is_near_level(median, level)).then(|| format!("they are not near their level of {level} ADU"))
}

/// Calibration frames of a kind.
#[derive(Debug, Default)]
struct Kind {
    files: Vec<(FrameFile, Taken)>,
    used: HashSet<PathBuf>,
    /// Frames that are none of the kind, by why.
    refused: BTreeMap<String, usize>,
}

impl Kind {
    fn of(
        kind: TargetKind,
        (files, reads): (&[FrameFile], Reads<'_>),
        stay_of: &[Option<usize>],
        stays: &[Stay],
        failed: &mut Vec<(FrameFile, String)>,
    ) -> Self {
        let is_it =
            |stay: &Option<usize>| stay.is_some_and(|s| stays[s].target.target_kind == kind);
        let found = files.iter().zip(stay_of).filter(|(_, stay)| is_it(stay));
        let found: Vec<&FrameFile> = found.map(|(file, _)| file).take(MOST_FILES).collect();
        let look = |file: &&FrameFile| {
            let frame = reads.read(file)?;
            Ok(unfit(kind, &frame).map_or_else(|| Ok(Taken::of(&frame)), Err))
        };
        // A few side by side: frames may be large, and nothing but their setting is kept.
        let looked: Vec<Result<Result<Taken, String>, FileError>> = found
            .chunks(SIDE_BY_SIDE)
            .flat_map(|some| some.par_iter().map(look).collect::<Vec<_>>())
            .collect();
        let mut all = Self::default();
        for (file, looked) in found.into_iter().zip(looked) {
            match looked {
                Ok(Ok(taken)) => all.files.push((file.clone(), taken)),
                Ok(Err(why)) => *all.refused.entry(why).or_default() += 1,
                Err(error) => failed.push((file.clone(), error.to_string())),
            }
        }
        all
    }

    /// Warnings about those that are left out.
    fn warnings<'a>(&'a self, name: &'a str) -> impl Iterator<Item = String> + 'a {
        self.refused.iter().map(move |(why, count)| format!("{count} {name} left out: {why}"))
    }

    /// One frame's setting of each group of frames that fit each other.
    fn settings(&self, fits: impl Fn(&Taken, &Taken) -> bool) -> Vec<Taken> {
        let mut settings: Vec<Taken> = Vec::new();
        for (_, taken) in &self.files {
            if !settings.iter().any(|known| fits(taken, known)) {
                settings.push(taken.clone());
            }
        }
        settings
    }

    /// How many are left out.
    fn refused(&self) -> usize {
        self.refused.values().sum()
    }

    /// Those that fit; none where they are too few.
    fn fitting(&mut self, reads: Reads<'_>, fits: impl Fn(&Taken) -> bool) -> Vec<Frame> {
        let fitting = self.files.iter().filter(|(_, taken)| fits(taken)).take(MOST);
        let fitting: Vec<&FrameFile> = fitting.map(|(file, _)| file).collect();
        let read = |file: &&FrameFile| Some((file.path.clone(), reads.read(file).ok()?));
        let frames: Vec<_> = fitting.par_iter().filter_map(read).collect();
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
    reads: Reads<'a>,
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
    /// The calibration that was made last, and for which frames.
    made: Option<(Taken, FrameCalibration)>,
}

/// Uses of a session's calibration frames.
#[derive(Debug, Clone, Copy, Default)]
pub struct Used {
    /// Dark frames, and those that fit no setting of frames of targets.
    pub darks: [usize; 2],
    /// Bias frames, where no dark frames fit.
    pub bias: usize,
    /// Flats, and those that fit no setting of frames of targets.
    pub flats: [usize; 2],
    /// Frames of calibration visits that are none by their headers, and flats off their level or saturated.
    pub refused: usize,
}

impl<'a> Sensor<'a> {
    /// Looks at the calibration frames of a session, if none are given, and at some of its frames of targets.
    pub fn of(
        files: &[FrameFile],
        stay_of: &[Option<usize>],
        stays: &[Stay],
        (given, reads): (&'a SensorFiles, Reads<'a>),
        library: Option<(&'a Library, String)>,
        failed: &mut Vec<(FrameFile, String)>,
    ) -> Self {
        let mut kind = |kind| Kind::of(kind, (files, reads), stay_of, stays, failed);
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
        let some: Vec<&FrameFile> = on.iter().step_by(step).copied().collect();
        let usual = some.par_iter().filter_map(|file| Some(Taken::of(&reads.read(file).ok()?)));
        let usual = usual.collect();
        let mut warnings: Vec<String> =
            library.as_ref().map(|(library, _)| library.warnings.clone()).unwrap_or_default();
        for (kind, name) in [(&darks, "dark frames"), (&bias, "bias frames"), (&flats, "flats")] {
            warnings.extend(kind.warnings(name));
        }
        Self {
            given,
            reads,
            darks,
            bias,
            flats,
            library,
            from_library: BTreeSet::new(),
            to_library: BTreeSet::new(),
            warnings,
            usual,
            made: None,
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
        let bias = self.bias.fitting(self.reads, |bias| bias.fits_bias(taken));
        if bias.is_empty() {
            let found = self.master_for(MasterKind::Bias, |bias| bias.fits_bias(taken));
            return Ok(found.map(|found| found.frame));
        }
        let mean = MasterFrame::quiet(&bias).within(|| "the bias frames".into())?;
        self.keep_master(MasterKind::Bias, &bias, &mean, None);
        Ok(Some(mean))
    }

    /// Mask, dark and flat for frames that were taken like this one.
    ///
    /// # Errors
    /// Files that were given and do not fit each other.
    pub fn calibration(&mut self, taken: &Taken) -> Result<FrameCalibration, ReduceError> {
        if let Some((_, made)) = self.made.as_ref().filter(|(of, _)| of == taken) {
            return Ok(made.clone());
        }
        let made = self.make(taken)?;
        self.made = Some((taken.clone(), made.clone()));
        Ok(made)
    }

    fn make(&mut self, taken: &Taken) -> Result<FrameCalibration, ReduceError> {
        let mut calibration = FrameCalibration::default();
        let darks = match self.given.darks.is_empty() {
            true => self.darks_for(taken),
            false => self.given.darks.clone(),
        };
        if darks.len() < LEAST {
            // A dark of the library has the mask, too: better than the night's own bias frames.
            if let Some(found) = self.master_for(MasterKind::Dark, |dark| dark.fits(taken)) {
                if let Some(bad) = &found.bad {
                    check_mask(bad, || format!("the library's {}", found.name), DELETE)?;
                }
                calibration.bad = found.bad;
                calibration.dark =
                    Some(MasterFrame { exposure_s: taken.exposure_s, ..found.frame });
            } else if let Some(bias) = self.bias_for(taken)? {
                calibration.dark = Some(MasterFrame { exposure_s: taken.exposure_s, ..bias });
            }
        } else {
            let bad = BadPixels::from_darks(&darks, BAD_SIGMAS);
            let bad = bad.within(|| "the dark frames".into())?;
            check_mask(&bad, || format!("{} dark frames", darks.len()), OTHER_DARKS)?;
            let dark = MasterFrame::quiet(&darks).within(|| "the dark frames".into())?;
            if self.given.darks.is_empty() {
                self.keep_master(MasterKind::Dark, &darks, &dark, Some(&bad));
            }
            (calibration.bad, calibration.dark) = (Some(bad), Some(dark));
        }
        let Some(dark) = calibration.dark.clone() else { return Ok(calibration) };
        let flats = match self.given.flats.is_empty() {
            true => self.flats.fitting(self.reads, |flat| flat.fits_flat(taken)),
            false => self.given.flats.clone(),
        };
        let mut flat = None;
        let by = match flats.len() {
            0 => "the library's flat".to_owned(),
            count => format!("{count} flats"),
        };
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
                check_mask(bad, || by, OTHER_FLATS)?;
            }
            calibration.flat = Some(flat);
        }
        Ok(calibration)
    }

    /// Adds masters of all settings to the library, for a session without frames of targets.
    ///
    /// # Errors
    /// Calibration frames that do not fit each other, or are none.
    pub fn keep_all(&mut self) -> Result<(), ReduceError> {
        for like in self.darks.settings(Taken::fits) {
            let darks = self.darks.fitting(self.reads, |dark| dark.fits(&like));
            if darks.is_empty() {
                continue;
            }
            let bad = BadPixels::from_darks(&darks, BAD_SIGMAS);
            let bad = bad.within(|| "the dark frames".into())?;
            check_mask(&bad, || format!("{} dark frames", darks.len()), OTHER_DARKS)?;
            let mean = MasterFrame::quiet(&darks).within(|| "the dark frames".into())?;
            self.keep_master(MasterKind::Dark, &darks, &mean, Some(&bad));
        }
        for like in self.bias.settings(Taken::fits_bias) {
            self.bias_for(&like)?;
        }
        for like in self.flats.settings(Taken::fits_flat) {
            let flats = self.flats.fitting(self.reads, |flat| flat.fits_flat(&like));
            if flats.is_empty() {
                continue;
            }
            let Some(bias) = self.bias_for(&like)? else {
                self.warn(format!(
                    "{} flats make no master: there are no bias frames of their window and gain",
                    flats.len()
                ));
                continue;
            };
            let alike = |mut flat: Frame| {
                flat.exposure_s = like.exposure_s;
                flat
            };
            let flats: Vec<Frame> = flats.into_iter().map(alike).collect();
            let made = MasterFrame::flat(&flats, &bias).within(|| "the flats".into())?;
            self.keep_master(MasterKind::Flat, &flats, &made, None);
        }
        Ok(())
    }

    /// The dark frames that fit most of the frames that were taken like this one; all of them where no frame of a target can be read.
    fn darks_for(&mut self, taken: &Taken) -> Vec<Frame> {
        if self.usual.is_empty() {
            return self.darks.fitting(self.reads, |_| true);
        }
        let alike: Vec<&Taken> = self.usual.iter().filter(|usual| usual.is_like(taken)).collect();
        let darks = |frame: &Taken| self.darks.files.iter().filter(|(_, d)| d.fits(frame)).count();
        // The frames that the most others are alike; of equal ones those with the most darks.
        let usual = alike
            .iter()
            .max_by_key(|a| (alike.iter().filter(|b| a.fits(b)).count(), darks(a)))
            .map_or_else(|| taken.clone(), |usual| (*usual).clone());
        self.darks.fitting(self.reads, |dark| dark.fits(&usual))
    }

    /// Frames that were used so far.
    pub fn used(&self) -> Used {
        let darks = match self.given.darks.is_empty() {
            true => [self.darks.used.len(), self.darks.files.len() - self.darks.used.len()],
            false => [self.given.darks.len(), 0],
        };
        let flats = match self.given.flats.is_empty() {
            true => [self.flats.used.len(), self.flats.files.len() - self.flats.used.len()],
            false => [self.given.flats.len(), 0],
        };
        let refused = [&self.darks, &self.bias, &self.flats].into_iter().map(Kind::refused).sum();
        Used { darks, bias: self.bias.used.len(), flats, refused }
    }
}

const OTHER_DARKS: &str =
    "they are no dark frames: give others (--dark), or take them out of the session";
const OTHER_FLATS: &str =
    "they have no even light: give others (--flat), or take them out of the session";
const DELETE: &str = "delete it from the library";

/// Refuses a mask of a good part of the sensor: what it is made of is not what it should be.
fn check_mask(
    bad: &BadPixels,
    by: impl FnOnce() -> String,
    hint: &'static str,
) -> Result<(), ReduceError> {
    let (count, all) = (bad_count(bad), bad.faults.len());
    if count as f64 <= MOST_BAD * all as f64 {
        return Ok(());
    }
    Err(ReduceError::Mask { bad: count, all, by: by(), hint })
}

/// Pixels of a mask that are left out.
pub fn bad_count(bad: &BadPixels) -> usize {
    bad.faults.iter().filter(|fault: &&PixelFault| !fault.is_empty()).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use sunglint_formats::atomic::Overwrite;
    use sunglint_formats::fits::Header;
    use sunglint_formats::session::Target;
    use sunglint_formats::time::parse_utc;

    /// A frame of 20 × 20 pixels about a level, with noise of some ADU (synthetic), and cards.
    fn frame(number: u64, level: u16, cards: &[(&str, &str)]) -> Frame {
        let noise = |(row, column): (usize, usize)| {
            let hash =
                (number << 32 ^ (row << 16 | column) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            level + (hash >> 61) as u16
        };
        let mut header = Header::default();
        for (keyword, value) in cards {
            match value.parse::<f64>() {
                Ok(value) => header.set(keyword, value, ""),
                Err(_) => header.set(keyword, *value, ""),
            }
        }
        Frame {
            pixels: Array2::from_shape_fn((20, 20), noise),
            origin: [0, 0],
            binning: [1, 1],
            bayer: None,
            start: parse_utc("2026-11-21T18:00:00Z").unwrap()
                + hifitime::Duration::from_seconds(number as f64),
            exposure_s: 1.0,
            gain_e_per_adu: None,
            temperature_c: None,
            saturation_adu: Some(4000.0),
            header,
        }
    }

    struct Night {
        folder: tempfile::TempDir,
        files: Vec<FrameFile>,
        stay_of: Vec<Option<usize>>,
        stays: Vec<Stay>,
    }

    impl Night {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            Self { folder, files: vec![], stay_of: vec![], stays: vec![] }
        }

        /// So many frames of a visit of that kind.
        fn add(&mut self, kind: TargetKind, count: u64, level: u16, cards: &[(&str, &str)]) {
            let from = parse_utc("2026-11-21T18:00:00Z").unwrap();
            let target = Target::off(kind);
            self.stays.push(Stay { target, number: 1, from, to: from });
            for _ in 0..count {
                let sequence = self.files.len() as u64 + 1;
                let path = self.folder.path().join(format!("{sequence}.fits"));
                frame(sequence, level, cards).write_file(&path, Overwrite::Refuse).unwrap();
                self.files.push(FrameFile { sequence, path });
                self.stay_of.push(Some(self.stays.len() - 1));
            }
        }

        fn sensor<'a>(&self, given: &'a SensorFiles, library: Option<&'a Library>) -> Sensor<'a> {
            let library = library.map(|library| (library, "cam".to_owned()));
            let (files, stay_of, stays) = (&self.files, &self.stay_of, &self.stays);
            let given = (given, Reads::default());
            Sensor::of(files, stay_of, stays, given, library, &mut Vec::new())
        }
    }

    /// Truth: by hand: five of nine frames in the dark's visit say that they are light frames, of which two only because an older program knew no better.
    #[test]
    fn light_frames_are_no_darks_whenever_they_were_taken() {
        let mut night = Night::new();
        night.add(TargetKind::Dark, 3, 100, &[("FRAME", "Light"), ("IMAGETYP", "Light Frame")]);
        night.add(TargetKind::Dark, 2, 100, &[("IMAGETYP", "Light Frame"), ("OBJTYPE", "dark")]);
        night.add(TargetKind::Dark, 2, 100, &[("FRAME", "Dark"), ("IMAGETYP", "Dark Frame")]);
        night.add(TargetKind::Dark, 2, 100, &[]);
        let given = SensorFiles::default();
        let mut sensor = night.sensor(&given, None);
        let taken = Taken::of(&frame(0, 0, &[]));
        let made = sensor.calibration(&taken).unwrap();
        let dark = made.dark.unwrap();
        assert!(dark.pixels.iter().all(|adu| (100.0..108.0).contains(adu)));
        let used = sensor.used();
        assert_eq!((used.darks, used.refused), ([6, 0], 3));
        let warning = "3 dark frames left out: by their headers they are light frames";
        assert!(sensor.warnings.contains(&warning.to_owned()), "{:?}", sensor.warnings);
    }

    /// Truth: by hand: of seventeen flats the five at 1,000 ADU, the level of the plan, count; four see nothing, four are full, and four are of another gain.
    #[test]
    fn flats_off_their_level_or_gain_are_left_out() {
        let mut night = Night::new();
        night.add(TargetKind::Dark, 3, 100, &[]);
        night.add(TargetKind::Flat, 5, 1000, &[("FLATLEV", "1000"), ("GAIN", "10")]);
        night.add(TargetKind::Flat, 4, 100, &[("FLATLEV", "1000"), ("GAIN", "10")]);
        night.add(TargetKind::Flat, 4, 4000, &[("GAIN", "10")]);
        night.add(TargetKind::Flat, 4, 1000, &[("FLATLEV", "1000"), ("GAIN", "50")]);
        let given = SensorFiles::default();
        let mut sensor = night.sensor(&given, None);
        let taken = Taken::of(&frame(0, 0, &[("GAIN", "10")]));
        let made = sensor.calibration(&taken).unwrap();
        let flat = made.flat.unwrap();
        assert!(flat.pixels.iter().all(|response| (response - 1.0).abs() < 0.01));
        let used = sensor.used();
        assert_eq!((used.flats, used.refused), ([5, 4], 8));
        assert_eq!(sensor.warnings.len(), 2, "{:?}", sensor.warnings);
    }

    /// Flats of nothing, without a level to hold them against. Truth: by hand: half of their pixels are below half of their median: the reduction ends, and names them.
    #[test]
    fn a_mask_of_a_good_part_of_the_sensor_is_refused() {
        let mut night = Night::new();
        night.add(TargetKind::Dark, 4, 100, &[]);
        night.add(TargetKind::Flat, 3, 100, &[]);
        let given = SensorFiles::default();
        let mut sensor = night.sensor(&given, None);
        let error = sensor.calibration(&Taken::of(&frame(0, 0, &[]))).unwrap_err().to_string();
        assert!(error.contains("of 400 pixels are bad by 3 flats, more than 20 %"), "{error}");
    }

    /// A session of calibration frames alone. Truth: by hand: a master for each setting: darks of two gains, bias frames of one, flats of one.
    #[test]
    fn a_session_without_targets_fills_a_library() {
        let mut night = Night::new();
        night.add(TargetKind::Dark, 4, 100, &[("GAIN", "10")]);
        night.add(TargetKind::Dark, 4, 100, &[("GAIN", "50")]);
        night.add(TargetKind::Bias, 4, 90, &[("GAIN", "10")]);
        night.add(TargetKind::Flat, 4, 1000, &[("GAIN", "10"), ("FILTER", "V")]);
        night.add(TargetKind::Flat, 4, 1000, &[("GAIN", "50"), ("FILTER", "V")]);
        let given = SensorFiles::default();
        let folder = night.folder.path().join("library");
        let library = Library::open(&folder).unwrap();
        let mut sensor = night.sensor(&given, Some(&library));
        sensor.keep_all().unwrap();
        let kinds = |word: &str| sensor.to_library.iter().filter(|n| n.starts_with(word)).count();
        assert_eq!(["dark", "bias", "flat"].map(kinds), [2, 1, 1], "{:?}", sensor.to_library);
        assert!(sensor.warnings[0].contains("no bias frames"), "{:?}", sensor.warnings);
        assert_eq!(Library::open(&folder).unwrap().warnings.len(), 0);
        assert_eq!(sensor.used().darks, [8, 0]);
    }
}
