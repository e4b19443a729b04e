//! Frames of any program in a folder, reduced: sorted by their headers, dark and flat applied, the target found, one light curve.
//!
//! The target is chosen by its motion, never by its brightness:
//!
//! - a place that the user gives in the first frame, if there is one;
//! - among trailed stars, a point (or a streak of another length) that moves evenly through the frames;
//! - among stars that are points, a streak; without one, a point that moves against the stars.
//!
//! A rate is in ADU/s: light over the time in which the target was in the frame. A streak with both ends inside was there for the whole exposure; one that the edge cuts was there
//! for its length over its rate of motion, where that is known from the other frames.
//!
//! With a list of stars ([`StarsOptions`]) each frame gets coordinates and a zero point of its own, and the target a place and a magnitude ([`crate::field_stars`]).

use super::sight::{Sight, SightedObject, sights};
use super::{ReduceError, step};
use crate::field_stars::blind::{EMBEDDED_DEG, Patterns, narrowest_deg};
use crate::field_stars::{
    self, Approximate, Catalogue, CatalogueOptions, ColourTerm, Coordinates, InFrame,
    StarMeasurement, System, ZeroPoint,
};
use crate::photometry::PhotometryError;
use crate::photometry::field::{
    Along, Field, FieldOptions, Growth, along, constant, cut_flat, find, green_light, plateau,
};
use glam::{DVec2, DVec3};
use hifitime::{Epoch, Unit};
use ndarray::Array2;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::tle::Tle;
use sunglint_formats::image_frame::{FrameHeader, FrameKind, ImageFrame, ReadOptions};
use sunglint_formats::sha256;
use sunglint_formats::wcs::{Equatorial, Wcs};
use sunglint_numerics::measured::{Interval, Measured};
use sunglint_numerics::order::median;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, Input, LightCurve, Provenance, RateKind, Samples,
};
use sunglint_radiometry::sky::{EarthOrientation, Observer, Site, Star};

/// How a folder of frames is reduced.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct FolderOptions {
    /// How the files are read.
    pub reading: ReadOptions,
    /// How sources are found.
    pub field: FieldOptions,
    /// Place of the target in the first frame, column and row, px.
    pub place_px: Option<DVec2>,
    /// Parts of a streak that become samples of their own; 0 and 1 for none.
    pub parts: usize,
    /// Dark frames in place of those in the folder.
    pub darks: Vec<PathBuf>,
    /// Flats in place of those in the folder.
    pub flats: Vec<PathBuf>,
    /// Stars that make rates magnitudes.
    pub stars: Option<StarsOptions>,
    /// Elements of the target and the site that it was seen from, for range and phase angle.
    pub seen_from: Option<(Tle, Site)>,
    /// The command with its options, as the curves' provenance has it; empty for `reduce`.
    pub command: String,
    /// Files of elements and the like that were read for these options, for the provenance.
    pub inputs: Vec<PathBuf>,
}

/// How stars of a list make rates magnitudes.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct StarsOptions {
    /// The list and its columns.
    pub list: CatalogueOptions,
    /// Right ascension and declination near the middle of the frames, deg, where their headers do not say it.
    pub near_deg: Option<Equatorial>,
    /// Width of a pixel, arcsec, where their headers do not say it.
    pub scale_arcsec: Option<f64>,
    /// The target's colour and its standard deviation; `None` takes the Sun's ± 0.2.
    pub target_colour: Option<Measured>,
    /// The filter's colour term; `None` finds it from the stars.
    pub colour_term: Option<f64>,
}

/// Stars of a list as the frames of one filter used them.
#[derive(Debug, Clone, Serialize)]
pub struct BandUse {
    /// The filter.
    pub filter: String,
    /// The list's column of magnitudes.
    pub column: String,
    /// Their system.
    pub system: Option<System>,
    /// The colour's columns.
    pub colour: Option<String>,
    /// The colour term.
    pub term: Option<ColourTerm>,
    /// Frames with a zero point.
    pub frames: usize,
}

/// A list of stars as it was used.
#[derive(Debug, Clone, Serialize)]
pub struct StarsUse {
    /// The file.
    pub list: String,
    /// Stars in it.
    pub stars: usize,
    /// The filters.
    pub bands: Vec<BandUse>,
}

/// Standard deviation of a target's colour that is not known, mag: satellites are sunlight, reddened by some of their materials.
const TARGET_COLOUR_SIGMA: f64 = 0.2;
/// Part by which the scale of a header may be wrong (focal lengths are nominal), and one that the user told.
const SCALE_TOLERANCE: [f64; 2] = [0.1, 0.04];

/// Kind of image that the target has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A point.
    Point,
    /// A streak.
    Streak,
}

/// The target in one frame.
#[derive(Debug, Clone, Serialize)]
pub struct TargetFrame {
    /// The file.
    pub file: String,
    /// Name of the filter, or `none`.
    pub filter: String,
    /// Middle of the time in which its light fell.
    #[serde(skip)]
    pub time: Epoch,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Time in the frame, s; `None` where it is not known.
    pub dwell_s: Option<f64>,
    /// Kind of image; `None` where no target was found.
    pub shape: Option<Shape>,
    /// Middle of the image, column and row.
    pub place_px: Option<DVec2>,
    /// Length of the streak, px; 0 of a point.
    pub length_px: f64,
    /// Light over dwell time, ADU/s.
    pub rate_adu_per_s: Option<f64>,
    /// Standard deviation of the rate.
    pub sigma_adu_per_s: Option<f64>,
    /// Significance with which it was found.
    pub significance: f64,
    /// −2.5 lg of the rate; no zero point is in it.
    pub instrumental_mag: Option<f64>,
    /// Standard deviation of the magnitude.
    pub instrumental_sigma_mag: Option<f64>,
    /// Right ascension and declination of its middle, deg, where the stars of a list give coordinates.
    pub sky_deg: Option<Equatorial>,
    /// The frame's zero point.
    pub zero_point: Option<ZeroPoint>,
    /// Magnitude, where the frame has a zero point.
    pub magnitude: Option<f64>,
    /// Standard deviation of the magnitude: that of the light and that of the zero point.
    pub sigma_mag: Option<f64>,
    /// Where the target stood by its elements.
    pub sight: Option<Sight>,
    /// The magnitude brought to a range of 1,000 km.
    pub magnitude_1000km: Option<f64>,
    /// Remark for the reader.
    pub remark: String,
    /// Flags of the sample.
    #[serde(skip)]
    pub flags: Flags,
    /// Parts of the streak in the order of time.
    pub along: Vec<Part>,
}

/// Part of a streak with its time.
#[derive(Debug, Clone, Serialize)]
pub struct Part {
    /// Middle of the time.
    #[serde(skip)]
    pub time: Epoch,
    /// Length of time, s.
    pub exposure_s: f64,
    /// Rate, ADU/s.
    pub rate_adu_per_s: f64,
    /// Standard deviation of the rate.
    pub sigma_adu_per_s: f64,
    /// Magnitude, where the frame has a zero point.
    pub magnitude: Option<f64>,
    /// Standard deviation of the magnitude.
    pub sigma_mag: Option<f64>,
    /// Where the target stood by its elements.
    pub sight: Option<Sight>,
    /// The magnitude brought to a range of 1,000 km.
    pub magnitude_1000km: Option<f64>,
}

/// Frames of one kind that went into a curve, as its provenance has them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Sources {
    /// Their number.
    pub count: usize,
    /// The first file.
    pub first: String,
    /// The last file.
    pub last: String,
    /// SHA-256 of the files' own SHA-256, a line each (64 hexadecimal digits and a line feed) in the order of the frames' times: `sha256sum FILES | cut -c1-64 | sha256sum` where the names are in that order.
    pub sha256: String,
}

impl Sources {
    /// Reads the files; `None` of no file, or where one is gone.
    fn of(files: &[&Path]) -> Option<Self> {
        let (first, last) = (files.first()?, files.last()?);
        let of = |path: &&Path| {
            Some(sunglint_formats::read::bytes(path).ok().map(|b| sha256(&b))? + "\n")
        };
        let lines: Option<String> = files.par_iter().map(of).collect();
        Some(Self {
            count: files.len(),
            first: first.display().to_string(),
            last: last.display().to_string(),
            sha256: sha256(lines?.as_bytes()),
        })
    }
}

/// Origin of the curves of frames: those of the sky in the order of time, dark frames and flats in that of their names.
fn provenance(
    lights: &[&Path],
    calibration: &Calibration<'_>,
    options: &FolderOptions,
) -> Provenance {
    let mut other = serde_json::Map::new();
    other.extend(Sources::of(lights).map(|own| ("frames".to_owned(), serde_json::json!(own))));
    for kind in [FrameKind::Dark, FrameKind::Bias, FrameKind::Flat] {
        let of_kind = calibration.entries.iter().filter(|e| e.kind == kind);
        let mut files: Vec<&Path> = of_kind.map(|e| e.header.path.as_path()).collect();
        files.retain(|path| calibration.used.contains(path));
        files.sort_unstable();
        let own = Sources::of(&files).map(|own| (format!("{}_frames", kind.name()), own));
        other.extend(own.map(|(name, own)| (name, serde_json::json!(own))));
    }
    let catalogue = options.stars.iter().map(|stars| &stars.list.path);
    let input = |path: &PathBuf| {
        let sha256 = sha256(&sunglint_formats::read::bytes(path).ok()?);
        Some(Input { file: path.display().to_string(), sha256 })
    };
    let named = if options.command.is_empty() { "sunglint reduce" } else { &options.command };
    Provenance {
        program: format!("sunglint {}", env!("CARGO_PKG_VERSION")),
        command: named.to_owned(),
        inputs: catalogue.chain(&options.inputs).filter_map(input).collect(),
        notes: vec![
            "rates are ADU/s; there is no zero point: magnitudes of them are instrumental".into(),
        ],
        other,
        ..Provenance::default()
    }
}

/// Why a file was left out that is damaged or none of frames.
const UNREADABLE: &str = "cannot be read";
/// Why a file was left out that holds no picture.
const EMPTY: &str = "without a picture (all pixels are NaN, or all are the same)";

/// A reduced folder.
#[derive(Debug, Serialize)]
pub struct Folder {
    /// The target, frame by frame, in the order of time.
    pub frames: Vec<TargetFrame>,
    /// Numbers of frames by kind that went in.
    pub used: BTreeMap<&'static str, usize>,
    /// Reasons and numbers of what was left out.
    pub left_out: BTreeMap<String, usize>,
    /// The files that were left out, each with why.
    pub left_out_files: Vec<[String; 2]>,
    #[serde(skip)]
    first_unreadable: Option<String>,
    /// Origin of the curve and the magnitudes: program, command, the other inputs, and `frames` ([`Sources`]).
    #[serde(skip)]
    pub provenance: Provenance,
    /// How the target was told.
    pub chosen_by: String,
    /// Motion of the target through the frames, px/s, where several tell.
    pub motion_px_per_s: Option<DVec2>,
    /// Notes of the headers, each once, with the number of frames.
    pub notes: BTreeMap<String, usize>,
    /// The list of stars, if one was given.
    pub stars: Option<StarsUse>,
    /// The satellite whose elements were given.
    pub object: Option<SightedObject>,
    /// Median distance of the target's places on the sky from those of the elements, deg, where both are known.
    #[serde(skip)]
    pub off_elements_deg: Option<f64>,
}

/// Frames before and after one whose profiles count for it.
const PROFILES: usize = 5;

/// Temperature of a dark differs from its frame's by at most this, °C.
const NEAR_C: f64 = 2.0;

/// A frame by its header.
struct Entry {
    header: FrameHeader,
    kind: FrameKind,
    /// Value at which many pixels of a flat are cut off, ADU.
    cut_adu: Option<f64>,
}

fn near(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * a.abs().max(b.abs())
}

/// Whether frames come from the same settings of the camera.
fn same_camera(a: &FrameHeader, b: &FrameHeader) -> bool {
    let both = |x: Option<f64>, y: Option<f64>| match (x, y) {
        (Some(x), Some(y)) => near(x, y, 1e-6),
        _ => true,
    };
    a.size == b.size
        && a.binning == b.binning
        && a.origin == b.origin
        && both(a.gain_setting, b.gain_setting)
        && both(a.offset_setting, b.offset_setting)
}

/// Settings in which a calibration frame differs from what it would be taken for, in words.
fn differences(frame: &Entry, like: &FrameHeader) -> Vec<&'static str> {
    let own = &frame.header;
    let apart = |a: Option<f64>, b: Option<f64>, share: f64| match (a, b) {
        (Some(a), Some(b)) => !near(a, b, share),
        _ => false,
    };
    let is_dark = frame.kind == FrameKind::Dark;
    let is_flat = frame.kind == FrameKind::Flat;
    let exposure = like.exposure_s.unwrap_or(0.0);
    let all = [
        ("size", own.size != like.size),
        ("binning", own.binning != like.binning),
        ("window", own.origin != like.origin),
        ("gain", apart(own.gain_setting, like.gain_setting, 1e-6)),
        ("offset", apart(own.offset_setting, like.offset_setting, 1e-6)),
        ("exposure", is_dark && !own.exposure_s.is_some_and(|s| near(s, exposure, 0.01))),
        ("temperature", !is_flat && !same_temperature(own, like)),
        ("filter", is_flat && own.filter != like.filter),
    ];
    all.into_iter().filter(|(_, differ)| *differ).map(|(name, _)| name).collect()
}

fn same_temperature(a: &FrameHeader, b: &FrameHeader) -> bool {
    match (a.temperature_c, b.temperature_c) {
        (Some(a), Some(b)) => (a - b).abs() <= NEAR_C,
        _ => true,
    }
}

/// Dark and flat for one group of frames.
#[derive(Default)]
struct Masters {
    dark: Option<Array2<f32>>,
    flat: Option<Array2<f32>>,
    /// Notes on how they were made.
    notes: Vec<&'static str>,
}

/// Calibration frames of a folder.
struct Calibration<'a> {
    entries: &'a [Entry],
    options: &'a ReadOptions,
    /// Those that went into a master.
    used: BTreeSet<&'a Path>,
    /// Settings of the flats that were used: frames may be dark frames of these alone.
    flats: Vec<&'a FrameHeader>,
}

/// Reduces frames of any program.
///
/// # Errors
/// No usable frame of the sky; options out of their range; a cancelled run. A frame that cannot be read is left out with a count.
pub fn reduce_frames(
    files: &[PathBuf],
    options: &FolderOptions,
    progress: &dyn Progress,
) -> Result<Folder, ReduceError> {
    let mut folder = Folder {
        frames: Vec::new(),
        used: BTreeMap::new(),
        left_out: BTreeMap::new(),
        left_out_files: Vec::new(),
        first_unreadable: None,
        provenance: Provenance::default(),
        chosen_by: String::new(),
        motion_px_per_s: None,
        notes: BTreeMap::new(),
        stars: None,
        object: None,
        off_elements_deg: None,
    };
    let list = options.stars.as_ref().map(|stars| Catalogue::read(&stars.list.path)).transpose()?;
    let mut entries = Vec::new();
    let given = options.darks.iter().map(|p| (p, Some(FrameKind::Dark)));
    let given = given.chain(options.flats.iter().map(|p| (p, Some(FrameKind::Flat))));
    for (path, kind) in files.iter().map(|p| (p, None)).chain(given) {
        step(progress, 0)?;
        match read(path, kind, &options.reading) {
            Err(error) => folder.leave(path, UNREADABLE, &error.to_string()),
            Ok(entry) => entries.push(entry),
        }
    }
    if !options.darks.is_empty() {
        let given = |e: &Entry| options.darks.contains(&e.header.path);
        entries.retain(|e| e.kind != FrameKind::Dark || given(e));
    }
    if !options.flats.is_empty() {
        let given = |e: &Entry| options.flats.contains(&e.header.path);
        entries.retain(|e| e.kind != FrameKind::Flat || given(e));
    }
    let mut lights = folder.lights(&entries);
    if lights.is_empty() {
        return Err(ReduceError::NoFrame { left_out: folder.reasons(&entries) });
    }
    lights.sort_by(|a, b| a.0.cmp(&b.0).then_with(|| a.1.path.cmp(&b.1.path)));
    let mut fields = Vec::new();
    let mut masters: Vec<(&FrameHeader, Masters)> = Vec::new();
    let mut calibration = Calibration::new(&entries, &options.reading);
    let mut without_gain = 0;
    for (time, header) in &lights {
        step(progress, 1)?;
        let alike = |of: &FrameHeader| {
            same_camera(of, header)
                && same_temperature(of, header)
                && of.filter == header.filter
                && of.exposure_s == header.exposure_s
                && of.is_without_dark() == header.is_without_dark()
        };
        if !masters.iter().any(|(of, _)| alike(of)) {
            let made = calibration.masters(header);
            masters.push((header, made));
        }
        let Some(number) = masters.iter().position(|(of, _)| alike(of)) else { continue };
        let made = &masters[number].1;
        let mut frame = match ImageFrame::read_as(&header.path, &options.reading) {
            Ok(frame) => frame,
            Err(error) => {
                folder.leave(&header.path, UNREADABLE, &error.to_string());
                continue;
            }
        };
        let mut how = options.field.clone();
        // Before darks and flats, which spread the value at which pixels are cut off, and bring their own scatter.
        let even = constant(frame.pixels.view());
        let told = frame.header.saturation_adu;
        let cut = plateau(frame.pixels.view()).filter(|p| told.is_none_or(|adu| p.adu < adu));
        let lowered = made.apply(&mut frame.pixels);
        how.saturation_adu = cut.map(|p| p.adu).or(told).map(|adu| adu - lowered);
        how.gain_e_per_adu = frame.header.gain_e_per_adu.or(options.field.gain_e_per_adu);
        without_gain += usize::from(how.gain_e_per_adu.is_none());
        how.fit_growth = true;
        how.bayer = frame.header.bayer;
        let empty = match find(frame.pixels.view(), &how) {
            Err(error @ PhotometryError::NoNumber { .. }) => Err(error.to_string()),
            Err(error) => return Err(error.into()),
            Ok(field) => even.map_or(Ok(field), Err),
        };
        let mut field = match empty {
            Ok(field) => field,
            Err(why) => {
                folder.leave(&header.path, EMPTY, &why);
                continue;
            }
        };
        if let Some(cut) = cut {
            // The value is another one in each frame that is scaled; the fact is one.
            field.remarks.retain(|r| *r != cut.note());
            field.remarks.push("pixels are cut off below the end of their scale: targets with such pixels are saturated and have no rate".into());
        }
        for note in frame.header.notes.iter().chain(&field.remarks) {
            *folder.notes.entry(note.clone()).or_default() += 1;
        }
        for note in &made.notes {
            *folder.notes.entry((*note).to_owned()).or_default() += 1;
        }
        fields.push(Seen { time: *time, header, field, masters: number });
    }
    if fields.is_empty() {
        return Err(ReduceError::NoFrame { left_out: folder.reasons(&entries) });
    }
    *folder.used.entry("light").or_default() += fields.len();
    if without_gain > 0 {
        progress.warn(&format!(
            "{without_gain} of {} frames do not say their gain (EGAIN, e⁻/ADU): the σ of their rates lacks the target's own photon noise; say the gain",
            fields.len()
        ));
    }
    folder.tell(&calibration, &lights);
    let own: Vec<&Path> = fields.iter().map(|f| f.header.path.as_path()).collect();
    folder.provenance = provenance(&own, &calibration, options);
    let growths: Vec<Option<Growth>> = fields.iter().map(|f| f.field.growth.clone()).collect();
    for (i, seen) in fields.iter_mut().enumerate() {
        // Single profiles are noisy, and the air changes slowly: the middle of the frames around, or of all.
        let near = &growths[i.saturating_sub(PROFILES)..(i + PROFILES + 1).min(growths.len())];
        let middle = Growth::middle(near.iter().flatten());
        seen.field.growth = middle.or_else(|| Growth::middle(growths.iter().flatten()));
    }
    let chosen = choose(&fields, options.place_px.map(|place| place.to_array()));
    if let Some(place) = options.place_px.filter(|_| chosen.of.iter().all(Option::is_none)) {
        return Err(ReduceError::NothingThere { column: place.x, row: place.y, most_px: PLACE_PX });
    }
    folder.chosen_by = chosen.by;
    folder.motion_px_per_s = chosen.motion.map(DVec2::from);
    let speed = speed_px_per_s(&fields, &chosen.of);
    for (seen, which) in fields.iter().zip(&chosen.of) {
        let made = &masters[seen.masters].1;
        folder.frames.push(measured(seen, *which, speed, chosen.motion, made, options)?);
    }
    if let (Some(list), Some(stars)) = (list, &options.stars) {
        folder.put_on_stars(&fields, &list, stars, progress)?;
    }
    if let Some((tle, site)) = &options.seen_from {
        folder.put_in_orbit(tle, site)?;
    }
    Ok(folder)
}

impl Masters {
    /// Takes the dark off and divides by the flat; gives the middle of the dark, ADU.
    fn apply(&self, pixels: &mut Array2<f32>) -> f64 {
        let mut lowered = 0.0;
        if let Some(dark) = &self.dark {
            *pixels -= dark;
            lowered = median(dark.iter().step_by(101).map(|v| f64::from(*v))).unwrap_or(0.0);
        }
        if let Some(flat) = &self.flat {
            ndarray::Zip::from(pixels).and(flat).for_each(|value, &response| {
                *value = if response > 0.1 { *value / response } else { f32::NAN };
            });
        }
        lowered
    }
}

/// A frame by its header. The time of a dark frame or a flat does not matter.
fn read(
    path: &Path,
    kind: Option<FrameKind>,
    options: &ReadOptions,
) -> Result<Entry, sunglint_formats::FileError> {
    let entry = |frame: ImageFrame| {
        let kind = kind.or(frame.header.kind).unwrap_or(FrameKind::Light);
        let is_flat = kind == FrameKind::Flat;
        let cut = || cut_flat(frame.pixels.view(), frame.header.saturation_adu);
        Entry { cut_adu: is_flat.then(cut).flatten(), header: frame.header, kind }
    };
    let error = match ImageFrame::read_as(path, options) {
        Ok(frame) => return Ok(entry(frame)),
        Err(error) => error,
    };
    let mut whenever = options.clone();
    whenever.without_time = true;
    match ImageFrame::read_as(path, &whenever).map(entry) {
        Ok(entry) if entry.kind != FrameKind::Light => Ok(entry),
        _ => Err(error),
    }
}

/// Frames that go into a master at most.
const MOST: usize = 64;

/// Mean of frames, pixel by pixel.
fn mean(headers: &[&FrameHeader], options: &ReadOptions) -> Option<Array2<f32>> {
    let mut sum: Option<Array2<f32>> = None;
    let mut n = 0_u16;
    for header in headers {
        let mut options = options.clone();
        options.without_time = true;
        let Ok(frame) = ImageFrame::read_as(&header.path, &options) else { continue };
        match &mut sum {
            None => sum = Some(frame.pixels),
            Some(sum) if sum.dim() == frame.pixels.dim() => *sum += &frame.pixels,
            Some(_) => continue,
        }
        n += 1;
    }
    sum.map(|sum| sum / f32::from(n.max(1)))
}

impl<'a> Calibration<'a> {
    fn new(entries: &'a [Entry], options: &'a ReadOptions) -> Self {
        Self { entries, options, used: BTreeSet::new(), flats: Vec::new() }
    }

    /// The frames of a kind that fit.
    fn fitting(&self, kind: FrameKind, like: &FrameHeader) -> Vec<&'a FrameHeader> {
        let fits =
            |e: &&Entry| e.kind == kind && e.cut_adu.is_none() && differences(e, like).is_empty();
        self.entries.iter().filter(fits).map(|e| &e.header).take(MOST).collect()
    }

    /// The mean of frames, which count as used.
    fn mean(&mut self, headers: &[&'a FrameHeader]) -> Option<Array2<f32>> {
        let mean = mean(headers, self.options)?;
        self.used.extend(headers.iter().map(|header| header.path.as_path()));
        Some(mean)
    }

    /// The dark of frames of this exposure, else the bias; and whether it is the bias.
    fn dark(&mut self, like: &FrameHeader) -> Option<(Array2<f32>, bool)> {
        let darks = self.fitting(FrameKind::Dark, like);
        if let Some(dark) = self.mean(&darks) {
            return Some((dark, false));
        }
        let biases = self.fitting(FrameKind::Bias, like);
        Some((self.mean(&biases)?, true))
    }

    /// Dark and flat for frames like this one.
    fn masters(&mut self, light: &FrameHeader) -> Masters {
        let mut masters = Masters::default();
        if !light.is_without_dark() {
            match self.dark(light) {
                Some((dark, is_bias)) => {
                    masters.dark = Some(dark);
                    if is_bias {
                        masters
                            .notes
                            .push("no dark frame fits: bias frames were subtracted in place of it");
                    }
                }
                None => masters.notes.push("no dark frame fits: none was subtracted"),
            }
        }
        if light.reduced.contains('F') {
            return masters;
        }
        let flats = self.fitting(FrameKind::Flat, light);
        if let Some(first) = flats.first()
            && let Some(mut flat) = self.mean(&flats)
        {
            self.flats.push(first);
            match self.dark(first).filter(|(dark, _)| dark.dim() == flat.dim()) {
                Some((dark, _)) => flat -= &dark,
                None => {
                    masters.notes.push("no dark or bias for the flats: their own level is in them")
                }
            }
            let middle = median(flat.iter().map(|v| f64::from(*v)).filter(|v| v.is_finite()));
            if let Some(middle) = middle.filter(|m| *m > 0.0) {
                flat /= middle as f32;
                masters.flat = Some(flat);
            }
        }
        if masters.flat.is_none() && self.entries.iter().any(|e| e.kind == FrameKind::Flat) {
            masters.notes.push("no flat fits: the frame was divided by none");
        }
        masters
    }

    /// Why a frame went into no master: the fewest settings in which it differs from frames that it could have been for.
    fn reason(&self, entry: &Entry, lights: &[(Epoch, &FrameHeader)]) -> String {
        let kind = match entry.kind {
            FrameKind::Flat => "flats",
            FrameKind::Bias => "bias frames",
            _ => "dark frames",
        };
        let of_flats = self.flats.iter().copied().filter(|_| entry.kind != FrameKind::Flat);
        let likes = lights.iter().map(|(_, header)| *header).chain(of_flats);
        let fewest = likes.map(|like| differences(entry, like)).min_by_key(Vec::len);
        let is_used = |kind: FrameKind| {
            let of_kind = |e: &&Entry| e.kind == kind;
            self.entries.iter().filter(of_kind).any(|e| self.used.contains(e.header.path.as_path()))
        };
        match fewest.as_deref() {
            Some([_, ..]) => {
                format!("{kind} of another {}", fewest.unwrap_or_default().join(" and "))
            }
            _ if is_used(entry.kind) => format!("{kind} beyond the {MOST} that are used"),
            _ if entry.kind == FrameKind::Bias && is_used(FrameKind::Dark) => {
                format!("{kind}, as dark frames fit")
            }
            _ => format!("{kind} that no frame needs"),
        }
    }
}

impl Folder {
    /// Counts the calibration frames that were used and those that were not, each kind by itself.
    fn tell(&mut self, calibration: &Calibration<'_>, lights: &[(Epoch, &FrameHeader)]) {
        for entry in calibration.entries.iter().filter(|e| e.kind != FrameKind::Light) {
            let path = entry.header.path.as_path();
            if calibration.used.contains(path) {
                *self.used.entry(entry.kind.name()).or_default() += 1;
            } else if let Some(end) = entry.cut_adu {
                let why = format!("more than 1 % of its pixels are cut off at {end} ADU");
                self.leave(path, "flats whose pixels are cut off", &why);
            } else {
                *self.left_out.entry(calibration.reason(entry, lights)).or_default() += 1;
            }
        }
    }

    /// Adds where the target stood at each moment.
    fn put_in_orbit(&mut self, tle: &Tle, site: &Site) -> Result<(), ReduceError> {
        let times: Vec<Epoch> = self
            .frames
            .iter()
            .flat_map(|f| std::iter::once(f.time).chain(f.along.iter().map(|part| part.time)))
            .collect();
        let (object, found) = sights(tle, site, &times)?;
        let mut found = found.into_iter();
        let mut next = |magnitude: Option<f64>| {
            let sight = found.next();
            (sight, sight.zip(magnitude).map(|(sight, magnitude)| sight.standard(magnitude)))
        };
        for frame in &mut self.frames {
            (frame.sight, frame.magnitude_1000km) = next(frame.magnitude);
            for part in &mut frame.along {
                (part.sight, part.magnitude_1000km) = next(part.magnitude);
            }
        }
        self.object = Some(object);
        let off = self.frames.iter().filter_map(|frame| {
            let (sky, sight) = (frame.sky_deg?, frame.sight?);
            let star = Star::at("the target", sky).ok()?;
            let observer = Observer::at(frame.time, site, EarthOrientation::embedded()).ok()?;
            let seen = observer.star(&star).horizontal.east_north_up();
            let (sin_az, cos_az) = sight.azimuth_deg.to_radians().sin_cos();
            let (sin_alt, cos_alt) = sight.altitude_deg.to_radians().sin_cos();
            let there = DVec3::new(cos_alt * sin_az, cos_alt * cos_az, sin_alt);
            Some(seen.angle_between(there).to_degrees())
        });
        self.off_elements_deg = median(off);
        Ok(())
    }

    fn leave(&mut self, path: &Path, why: &str, detail: &str) {
        *self.left_out.entry(why.to_owned()).or_default() += 1;
        let detail = if detail.is_empty() { why } else { detail };
        if why == UNREADABLE && self.first_unreadable.is_none() {
            let file = path.display().to_string();
            let named = if detail.contains(&file) { String::new() } else { format!("{file}: ") };
            self.first_unreadable = Some(format!("{named}{detail}"));
        }
        self.left_out_files.push([path.display().to_string(), detail.to_owned()]);
    }

    /// Words for the files that cannot be read; `None` where all could be.
    pub fn unreadable(&self) -> Option<String> {
        let n = self.left_out.get(UNREADABLE)?;
        let first = self.first_unreadable.as_ref()?;
        let files = if *n == 1 { "file" } else { "files" };
        Some(format!("{n} {files} {UNREADABLE}; the first: {first}"))
    }

    /// Words for what was left out.
    pub fn summary(&self) -> String {
        let parts: Vec<String> =
            self.left_out.iter().map(|(why, n)| format!("{n} {why}")).collect();
        if parts.is_empty() { "nothing".into() } else { parts.join(", ") }
    }

    /// Words for why nothing is left: the first file with its reason, and the frames that are not of the sky.
    fn reasons(&self, entries: &[Entry]) -> String {
        let mut words = self.summary();
        if let Some([file, why]) = self.left_out_files.first() {
            let named =
                if why.contains(file.as_str()) { String::new() } else { format!("{file}: ") };
            words += &format!("; the first: {named}{why}");
        }
        let of_kind = |kind: FrameKind| {
            let n = entries.iter().filter(|e| e.kind == kind).count();
            (n > 0).then(|| format!("{n} {}", kind.name()))
        };
        let kinds = [FrameKind::Dark, FrameKind::Bias, FrameKind::Flat];
        let kinds: Vec<String> = kinds.into_iter().filter_map(of_kind).collect();
        if !kinds.is_empty() {
            words += &format!(
                "; by their headers (IMAGETYP, FRAME, OBSTYPE) or names there are {}",
                kinds.join(", ")
            );
        }
        words
    }

    /// The usable frames of the sky with the middle of their exposure; others are left out with a count.
    fn lights<'a>(&mut self, entries: &'a [Entry]) -> Vec<(Epoch, &'a FrameHeader)> {
        let mut lights = Vec::new();
        let mut sizes: BTreeMap<([usize; 2], [u32; 2]), usize> = BTreeMap::new();
        for entry in entries.iter().filter(|e| e.kind == FrameKind::Light) {
            *sizes.entry((entry.header.size, entry.header.binning)).or_default() += 1;
        }
        let usual = sizes.iter().max_by_key(|(_, n)| **n).map(|(size, _)| *size);
        for entry in entries.iter().filter(|e| e.kind == FrameKind::Light) {
            let header = &entry.header;
            if Some((header.size, header.binning)) != usual {
                self.leave(&header.path, "of another size or binning", "");
            } else if header.stacked > 1 {
                self.leave(&header.path, "stacks of several exposures", "");
            } else if header.exposure_s.is_none_or(|s| s <= 0.0) {
                self.leave(
                    &header.path,
                    "without an exposure (EXPTIME, or DATE-END beside the begin)",
                    "",
                );
            } else if let Some(time) = &header.time {
                lights.push((time.middle, header));
            } else {
                self.leave(&header.path, "without a time (DATE-OBS)", "");
            }
        }
        lights
    }

    /// Coordinates and zero points of the frames, places and magnitudes of the target.
    fn put_on_stars(
        &mut self,
        fields: &[Seen<'_>],
        list: &Catalogue,
        options: &StarsOptions,
        progress: &dyn Progress,
    ) -> Result<(), ReduceError> {
        let mut filters: Vec<String> = self.frames.iter().map(|f| f.filter.clone()).collect();
        filters.sort_unstable();
        filters.dedup();
        let mut bands = Vec::new();
        let mut before: Option<Wcs> = None;
        let anywhere = Anywhere::default();
        for filter in filters {
            let band = list
                .band(&filter, &options.list)
                .map_err(sunglint_formats::error::FileError::from)?;
            let of_it: Vec<usize> =
                (0..fields.len()).filter(|&i| self.frames[i].filter == filter).collect();
            let mut found: Vec<Result<InFrame, String>> = Vec::new();
            for &i in &of_it {
                step(progress, 0)?;
                let seen = &fields[i];
                let in_it = seen.stars(list, &band, options, before.as_ref(), &anywhere);
                if let Ok(in_it) = &in_it {
                    before = Some(in_it.wcs.clone());
                }
                found.push(in_it);
            }
            let term = band.colour.as_ref().map(|_| {
                let target = options
                    .target_colour
                    .or(band.sun_colour.map(|sun| Measured::new(sun, TARGET_COLOUR_SIGMA)))
                    .unwrap_or_else(|| Measured::new(middle_colour(&found), 0.3));
                match options.colour_term {
                    Some(value) => ColourTerm {
                        value,
                        sigma: 0.0,
                        target_colour: target.value,
                        target_sigma: target.sigma,
                    },
                    None => {
                        let frames: Vec<Vec<StarMeasurement>> =
                            found.iter().flatten().map(|f| f.stars.clone()).collect();
                        field_stars::colour_term(&frames, target)
                    }
                }
            });
            let mut with_zero = 0;
            for (&i, in_it) in of_it.iter().zip(&found) {
                let frame = &mut self.frames[i];
                match in_it {
                    Ok(in_it) => {
                        frame.sky_deg = frame.place_px.and_then(|place| in_it.wcs.sky(place));
                        match field_stars::of_stars(&in_it.stars, term.as_ref()) {
                            Some(mut zero) => {
                                with_zero += 1;
                                // A streak among points, or a point among trails, loses another part of its light.
                                let is_trailed = fields[i].field.star_trails.is_some();
                                if frame.shape.is_some_and(|s| (s == Shape::Streak) != is_trailed) {
                                    let profile = fields[i].field.profile_sigma_mag();
                                    zero.sigma_mag = zero.sigma_mag.hypot(profile);
                                }
                                frame.calibrate(zero);
                            }
                            None => frame.note(&format!(
                                "no zero point: {} of {} stars can be measured",
                                in_it.stars.len(),
                                in_it.found
                            )),
                        }
                    }
                    Err(why) => frame.note(&format!("no zero point: {why}")),
                }
            }
            bands.push(BandUse {
                filter,
                column: band.column.clone(),
                system: band.system,
                colour: band.colour.as_ref().map(|(name, _)| name.clone()),
                term,
                frames: with_zero,
            });
        }
        self.stars = Some(StarsUse {
            list: options.list.path.display().to_string(),
            stars: list.len(),
            bands,
        });
        Ok(())
    }

    /// Whether any frame has a magnitude.
    pub fn has_magnitudes(&self) -> bool {
        self.frames
            .iter()
            .any(|f| f.magnitude.is_some() || f.along.iter().any(|p| p.magnitude.is_some()))
    }

    /// The light curve: a channel for each filter.
    pub fn light_curve(&self, target: &str) -> LightCurve {
        let mut rows: Vec<(Epoch, f64, &str, f64, f64, Flags)> = Vec::new();
        for frame in &self.frames {
            if frame.along.is_empty() {
                rows.push((
                    frame.time,
                    frame.dwell_s.unwrap_or(frame.exposure_s),
                    &frame.filter,
                    frame.rate_adu_per_s.unwrap_or(f64::NAN),
                    frame.sigma_adu_per_s.unwrap_or(f64::NAN),
                    frame.flags,
                ));
            }
            for part in &frame.along {
                rows.push((
                    part.time,
                    part.exposure_s,
                    &frame.filter,
                    part.rate_adu_per_s,
                    part.sigma_adu_per_s,
                    frame.flags,
                ));
            }
        }
        let mut filters: Vec<&str> = rows.iter().map(|row| row.2).collect();
        filters.sort_unstable();
        filters.dedup();
        let channels = filters.iter().map(|filter| {
            let mut curve = ChannelCurve {
                name: channel_name(filter),
                rate_hz: Vec::new(),
                sigma_hz: Vec::new(),
                flags: Vec::new(),
                model_error_hz: None,
            };
            for (_, _, of, rate, sigma, flags) in &rows {
                let here = of == filter;
                let whole = here && rate.is_finite() && sigma.is_finite();
                curve.rate_hz.push(if whole { *rate } else { f64::NAN });
                curve.sigma_hz.push(if whole { *sigma } else { f64::NAN });
                curve.flags.push(match (here, whole) {
                    (false, _) => Flags::NOT_SAMPLED,
                    (true, true) => *flags,
                    (true, false) if flags.is_empty() => Flags::UNDETECTED,
                    (true, false) => *flags,
                });
            }
            curve
        });
        let mut curve = LightCurve {
            kind: RateKind::Linear,
            samples: Samples {
                time: rows.iter().map(|row| row.0).collect(),
                exposure_s: rows.iter().map(|row| row.1).collect(),
                ..Samples::default()
            },
            channels: channels.collect(),
            provenance: Provenance { target: target.to_owned(), ..self.provenance.clone() },
            other: sunglint_formats::Meta::default(),
        };
        curve.sort();
        curve
    }
}

/// Middle of the stars' colours; 0 where none has one.
fn middle_colour(found: &[Result<InFrame, String>]) -> f64 {
    let stars = found.iter().flatten().flat_map(|f| &f.stars);
    median(stars.filter_map(|s| s.colour).filter(|c| c.is_finite())).unwrap_or(0.0)
}

/// Magnitude and its standard deviation of a rate.
fn magnitude_of(rate: f64, sigma: f64, zero: &ZeroPoint) -> Option<(f64, f64)> {
    (rate > 0.0 && sigma.is_finite()).then(|| {
        let own = 2.5 / std::f64::consts::LN_10 * sigma / rate;
        (zero.mag - 2.5 * rate.log10(), own.hypot(zero.sigma_mag))
    })
}

impl TargetFrame {
    fn note(&mut self, words: &str) {
        if !self.remark.is_empty() {
            self.remark.push_str("; ");
        }
        self.remark.push_str(words);
    }

    fn calibrate(&mut self, zero: ZeroPoint) {
        self.zero_point = Some(zero);
        if let (Some(rate), Some(sigma)) = (self.rate_adu_per_s, self.sigma_adu_per_s)
            && let Some((magnitude, sigma)) = magnitude_of(rate, sigma, &zero)
        {
            (self.magnitude, self.sigma_mag) = (Some(magnitude), Some(sigma));
        }
        for part in &mut self.along {
            if let Some((magnitude, sigma)) =
                magnitude_of(part.rate_adu_per_s, part.sigma_adu_per_s, &zero)
            {
                (part.magnitude, part.sigma_mag) = (Some(magnitude), Some(sigma));
            }
        }
    }
}

/// Name of a filter's channel: letters, digits and `_`.
fn channel_name(filter: &str) -> String {
    let name: String = filter
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' })
        .collect();
    if name.is_empty() { "none".into() } else { name }
}

/// A frame with its sources.
struct Seen<'a> {
    time: Epoch,
    header: &'a FrameHeader,
    field: Field,
    /// Number of its dark and flat.
    masters: usize,
}

/// A source that may be the target.
#[derive(Debug, Clone, Copy)]
enum Which {
    Streak(usize),
    Point(usize),
}

/// Patterns of the whole sky's stars for frames whose place nobody knows, made when the first of them comes.
#[derive(Default)]
struct Anywhere {
    patterns: std::cell::OnceCell<Option<Patterns>>,
}

/// Part by which the width of a frame may be wrong where a header tells its scale.
const WIDTH_TOLERANCE: f64 = 0.15;

impl Anywhere {
    /// Coordinates of a frame; of a scale that is known with the part by which it may be wrong.
    fn solve(
        &self,
        seen: &Seen<'_>,
        list: &Catalogue,
        options: &StarsOptions,
        scale: Option<(f64, f64)>,
    ) -> Option<Wcs> {
        let columns = seen.field.size_px[0] as f64;
        let width = scale.map(|(arcsec, tolerance)| {
            let half = 0.5 * columns * (arcsec / 3600.0).to_radians();
            (2.0 * half.atan().to_degrees(), tolerance.max(WIDTH_TOLERANCE))
        });
        let make = || {
            let widths = width.map_or(EMBEDDED_DEG, |(width, tolerance)| {
                Interval::new(width * (1.0 - tolerance), width * (1.0 + tolerance))
            });
            let embedded = Catalogue::embedded().ok()?;
            // A list of a part of the sky has too few stars for it.
            let whole = narrowest_deg(list.len()) <= widths.low && width.is_some();
            let (stars, column) = match whole {
                true => (list, options.list.magnitude.as_deref()),
                false => (&embedded, None),
            };
            let brightness = stars.brightness(column).ok()?;
            Patterns::new(stars, &brightness, year_of(seen.time), widths).ok()
        };
        let patterns = self.patterns.get_or_init(make).as_ref()?;
        let is_trailed = seen.field.star_trails.is_some();
        Some(patterns.solve(&seen.field, is_trailed, width)?.wcs)
    }
}

/// The target in each frame, and why.
struct Chosen {
    of: Vec<Option<Which>>,
    by: String,
    motion: Option<[f64; 2]>,
}

impl Seen<'_> {
    fn place(&self, which: Which) -> [f64; 2] {
        match which {
            Which::Point(i) => self.field.points[i].place_px.to_array(),
            Which::Streak(i) => {
                let [a, b] = self.field.streaks[i].ends_px;
                [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
            }
        }
    }

    /// Stars of a list in the frame: by its header's coordinates, by those of the frame before, or by the pattern of its stars.
    fn stars(
        &self,
        list: &Catalogue,
        band: &field_stars::BandColumns,
        options: &StarsOptions,
        before: Option<&Wcs>,
        anywhere: &Anywhere,
    ) -> Result<InFrame, String> {
        let mut ways = Vec::new();
        let mut why = match Wcs::from_header(&self.header.cards) {
            Ok(Some(wcs)) => {
                ways.push(Coordinates::Known(Box::new(wcs)));
                String::new()
            }
            Ok(None) => String::new(),
            Err(why) => format!("coordinates of the header are not used: {why}; "),
        };
        ways.extend(before.map(|wcs| Coordinates::Known(Box::new(wcs.clone()))));
        let centre = options.near_deg.or(self.header.pointing_deg);
        let scale = match (options.scale_arcsec, self.header.scale_arcsec) {
            (Some(scale), _) => Some((scale, SCALE_TOLERANCE[1])),
            (None, scale) => scale.map(|scale| (scale, SCALE_TOLERANCE[0])),
        };
        if let (Some(centre_deg), Some((scale_arcsec, scale_tolerance))) = (centre, scale) {
            let near = Approximate { centre_deg, scale_arcsec, scale_tolerance };
            ways.push(Coordinates::Near(near));
        } else if ways.is_empty()
            && let Some(wcs) = anywhere.solve(self, list, options, scale)
        {
            ways.push(Coordinates::Known(Box::new(wcs)));
        } else if ways.is_empty() {
            let missing = match (centre, scale) {
                (None, None) => "neither place on the sky nor scale (--near, --scale-arcsec)",
                (None, _) => "no place on the sky (--near)",
                _ => "no scale (--scale-arcsec)",
            };
            return Err(format!(
                "{why}its header has no coordinates, and {missing}; nor is its pattern of stars found on the whole sky, which fields from 15° (of a list of the whole sky, from less) allow"
            ));
        }
        let exposure = self.header.exposure_s.unwrap_or(0.0);
        let is_trailed = self.field.star_trails.is_some();
        let year = year_of(self.time);
        for way in &ways {
            match field_stars::in_frame(&self.field, is_trailed, exposure, year, way, list, band) {
                Ok(in_it) => return Ok(in_it),
                Err(reason) if why.ends_with(&reason) => {}
                Err(reason) => why = reason,
            }
        }
        Err(why)
    }

    fn streaks(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.field.streaks.len()).filter(|&i| !self.field.streaks[i].is_star_trail)
    }
}

/// Frames are this near to a straight even motion, px.
const REACH_PX: f64 = 4.0;
/// The same of a target that the telescope follows: it is moved by what the following misses.
const FOLLOWED_REACH_PX: f64 = 15.0;
/// Julian year of a moment.
fn year_of(time: Epoch) -> f64 {
    2000.0 + (time.to_jde_tt_days() - 2_451_545.0) / 365.25
}

/// A target is this near to the place that was given for it, px.
const PLACE_PX: f64 = 25.0;
/// Sources of a frame that are tried as the target at most.
const MOST_CANDIDATES: usize = 400;

/// Chooses the target in all frames.
fn choose(fields: &[Seen<'_>], place: Option<[f64; 2]>) -> Chosen {
    let trailed = fields.iter().filter(|f| f.field.star_trails.is_some()).count();
    let streaks = fields.iter().filter(|f| f.streaks().next().is_some()).count();
    let n = fields.len();
    let (kind, candidates): (&str, Vec<Vec<Which>>) = if 2 * trailed > n {
        let of = |f: &Seen<'_>| {
            let points = (0..f.field.points.len()).filter(|&i| !f.field.points[i].is_cut);
            f.streaks()
                .map(Which::Streak)
                .chain(points.map(Which::Point))
                .take(MOST_CANDIDATES)
                .collect()
        };
        ("among trailed stars", fields.iter().map(of).collect())
    } else if 2 * streaks > n || streaks > 0 && n < 3 {
        (
            "a streak among point-like stars",
            fields.iter().map(|f| f.streaks().map(Which::Streak).collect()).collect(),
        )
    } else {
        ("a point that moves against the stars", moving(fields))
    };
    let is_trailed = 2 * trailed > n;
    let reach_px = if is_trailed { FOLLOWED_REACH_PX } else { REACH_PX };
    // Trails that merge have another length and stay with the stars: a point that is there counts more.
    if is_trailed && n >= 3 {
        let points: Vec<Vec<Which>> = candidates
            .iter()
            .map(|all| all.iter().copied().filter(|w| matches!(w, Which::Point(_))).collect())
            .collect();
        if let Some((of, motion)) = linked(fields, &points, place, reach_px) {
            let count = of.iter().flatten().count();
            let by = format!("even motion in {count} of {n} frames: a point {kind}");
            return Chosen { of, by, motion: Some(motion) };
        }
    }
    if n >= 3
        && place.is_none()
        && let Some((of, motion)) = linked(fields, &candidates, None, reach_px)
    {
        let count = of.iter().flatten().count();
        let by = format!("even motion in {count} of {n} frames: {kind}");
        return Chosen { of, by, motion: Some(motion) };
    }
    if let Some(place) = place {
        if n >= 3
            && let Some((of, motion)) = linked(fields, &candidates, Some(place), reach_px)
        {
            let by = format!("the place that was given and even motion: {kind}");
            return Chosen { of, by, motion: Some(motion) };
        }
        let near = |f: &Seen<'_>, sources: &[Which], most_px: f64| {
            let away = |w: &Which| {
                let at = f.place(*w);
                (at[0] - place[0]).hypot(at[1] - place[1])
            };
            let nearest = sources.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
            nearest.filter(|w| away(w) <= most_px)
        };
        let everything = |f: &Seen<'_>| -> Vec<Which> {
            let points = (0..f.field.points.len()).map(Which::Point);
            f.streaks().map(Which::Streak).chain(points).collect()
        };
        let moves = fields.first().zip(candidates.first());
        let moves = moves.is_some_and(|(f, c)| near(f, c, PLACE_PX).is_some());
        let standing: Vec<Option<Which>> =
            fields.iter().map(|f| near(f, &everything(f), PLACE_PX)).collect();
        let stands = 2 * standing.iter().flatten().count() >= n;
        return if stands && (n >= 3 || !moves) {
            let by = "the place that was given: a source that stays there".to_owned();
            Chosen { of: standing, by, motion: None }
        } else if moves {
            let each = |(f, c): (&Seen<'_>, &Vec<Which>)| near(f, c, f64::INFINITY);
            let of = fields.iter().zip(&candidates).map(each).collect();
            Chosen { of, by: format!("nearest to the place that was given: {kind}"), motion: None }
        } else {
            let by = "the place that was given".to_owned();
            Chosen { of: vec![None; n], by, motion: None }
        };
    }
    // One or two frames: the longest streak, or the point nearest to the middle where the stars are trailed.
    let single = |(f, c): (&Seen<'_>, &Vec<Which>)| {
        let middle = f.field.size_px.map(|n| 0.5 * n as f64);
        let rank = |w: &Which| match w {
            Which::Streak(i) => -1e6 - f.field.streaks[*i].length_px,
            Which::Point(_) => {
                let at = f.place(*w);
                (at[0] - middle[0]).hypot(at[1] - middle[1])
            }
        };
        c.iter().copied().min_by(|a, b| rank(a).total_cmp(&rank(b)))
    };
    let of: Vec<Option<Which>> = match kind {
        "a point that moves against the stars" => vec![None; n],
        _ => fields.iter().zip(&candidates).map(single).collect(),
    };
    let by = match of.iter().flatten().count() {
        0 => format!("no target found ({kind} was looked for)"),
        _ => format!(
            "the longest streak, or the point nearest to the middle, frame by frame ({kind}; no even motion links the frames)"
        ),
    };
    Chosen { of, by, motion: None }
}

/// Points that do not stay with the stars, frame by frame.
fn moving(fields: &[Seen<'_>]) -> Vec<Vec<Which>> {
    let mut shift = [0.0; 2];
    let mut shifts = Vec::new();
    for (i, seen) in fields.iter().enumerate() {
        if i > 0 {
            let step = shift_between(&fields[i - 1].field, &seen.field);
            shift = [shift[0] + step[0], shift[1] + step[1]];
        }
        shifts.push(shift);
    }
    // A grid of places on the sky, with the number of frames that have a point there.
    const CELL: f64 = 3.0;
    let cell = |p: [f64; 2], s: [f64; 2]| [0, 1].map(|k| ((p[k] - s[k]) / CELL).floor() as i64);
    let mut seen_at: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
    for (i, (seen, shift)) in fields.iter().zip(&shifts).enumerate() {
        for point in &seen.field.points {
            let at = seen_at.entry(cell(point.place_px.to_array(), *shift)).or_default();
            if at.last() != Some(&i) {
                at.push(i);
            }
        }
    }
    let stays = |p: [f64; 2], s: [f64; 2]| {
        let [x, y] = cell(p, s);
        let mut frames: Vec<usize> = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                frames.extend(seen_at.get(&[x + dx, y + dy]).into_iter().flatten());
            }
        }
        frames.sort_unstable();
        frames.dedup();
        2 * frames.len() >= fields.len().max(3)
    };
    let of = |(seen, shift): (&Seen<'_>, &[f64; 2])| {
        let points = seen.field.points.iter().enumerate();
        let free = points.filter(|(_, p)| !p.is_cut && !stays(p.place_px.to_array(), *shift));
        let streaks = seen.streaks().map(Which::Streak);
        streaks.chain(free.map(|(i, _)| Which::Point(i))).take(MOST_CANDIDATES).collect()
    };
    fields.iter().zip(&shifts).map(of).collect()
}

/// Displacement of the stars from one frame to the next, px: the most frequent difference of places of the brightest points.
fn shift_between(a: &Field, b: &Field) -> [f64; 2] {
    const BRIGHT: usize = 60;
    const CELL: f64 = 4.0;
    let mut votes: BTreeMap<[i64; 2], Vec<[f64; 2]>> = BTreeMap::new();
    for p in a.points.iter().take(BRIGHT) {
        for q in b.points.iter().take(BRIGHT) {
            let d = [0, 1].map(|k| q.place_px[k] - p.place_px[k]);
            let [x, y] = d.map(|v| (v / CELL).round() as i64);
            for dx in -1..=1 {
                for dy in -1..=1 {
                    votes.entry([x + dx, y + dy]).or_default().push(d);
                }
            }
        }
    }
    // Of equal numbers the smallest displacement.
    let best = votes
        .iter()
        .max_by_key(|(cell, all)| (all.len(), -(cell[0] * cell[0] + cell[1] * cell[1])));
    match best {
        Some((_, all)) if all.len() >= 3 => {
            [0, 1].map(|k| median(all.iter().map(|d| d[k])).unwrap_or(0.0))
        }
        _ => [0.0; 2],
    }
}

/// Candidates that move evenly, if at least three frames and half of all have one: the motion that links most.
fn linked(
    fields: &[Seen<'_>],
    candidates: &[Vec<Which>],
    place: Option<[f64; 2]>,
    reach_px: f64,
) -> Option<(Vec<Option<Which>>, [f64; 2])> {
    let n = fields.len();
    let first = fields.first()?.time;
    let time = |i: usize| (fields[i].time - first).to_seconds();
    let mut best: Option<(usize, f64, [f64; 2], [f64; 2])> = None;
    let mut tried = 0_u64;
    // Pairs of frames that are not far apart in number, so that one is in both.
    for i in 0..n {
        for j in [i + 1, i + 2, i + n / 2] {
            if j >= n || j == i || time(j) <= time(i) {
                continue;
            }
            for a in &candidates[i] {
                for b in &candidates[j] {
                    tried += 1;
                    if tried > 400_000 {
                        break;
                    }
                    let (p, q) = (fields[i].place(*a), fields[j].place(*b));
                    let motion = [0, 1].map(|k| (q[k] - p[k]) / (time(j) - time(i)));
                    let start = [0, 1].map(|k| p[k] - motion[k] * time(i));
                    if let Some(place) = place
                        && (start[0] - place[0]).hypot(start[1] - place[1]) > PLACE_PX
                    {
                        continue;
                    }
                    let (mut count, mut miss) = (0, 0.0);
                    for (k, seen) in fields.iter().enumerate() {
                        if let Some(d) =
                            nearest(seen, &candidates[k], start, motion, time(k)).map(|(_, d)| d)
                            && d < reach_px
                        {
                            count += 1;
                            miss += d;
                        }
                    }
                    let better =
                        best.is_none_or(|(c, m, _, _)| count > c || count == c && miss < m);
                    if better {
                        best = Some((count, miss, start, motion));
                    }
                }
            }
        }
    }
    let (count, _, start, motion) = best?;
    // Frames in which it should be seen at all.
    let inside = (0..n)
        .filter(|&k| {
            let [x, y] = [0, 1].map(|i| start[i] + motion[i] * time(k));
            let [w, h] = fields[k].field.size_px;
            x > 0.0 && y > 0.0 && x < w as f64 && y < h as f64
        })
        .count();
    if count < 3 || 2 * count < inside {
        return None;
    }
    let of = (0..n).map(|k| {
        let (which, d) = nearest(&fields[k], &candidates[k], start, motion, time(k))?;
        (d < reach_px).then_some(which)
    });
    Some((of.collect(), motion))
}

fn nearest(
    seen: &Seen<'_>,
    candidates: &[Which],
    start: [f64; 2],
    motion: [f64; 2],
    time: f64,
) -> Option<(Which, f64)> {
    let at = [0, 1].map(|k| start[k] + motion[k] * time);
    let away = |w: &Which| {
        let p = seen.place(*w);
        (p[0] - at[0]).hypot(p[1] - at[1])
    };
    candidates.iter().map(|w| (*w, away(w))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Speed of the streaks whose both ends are inside, px/s: the middle of length over exposure.
fn speed_px_per_s(fields: &[Seen<'_>], of: &[Option<Which>]) -> Option<f64> {
    median(fields.iter().zip(of).filter_map(|(seen, which)| {
        let Some(Which::Streak(i)) = which else { return None };
        let streak = &seen.field.streaks[*i];
        let exposure = seen.header.exposure_s.filter(|s| *s > 0.0)?;
        (!streak.is_cut && !streak.is_end_hidden).then(|| streak.length_px / exposure)
    }))
}

/// The target of one frame, measured.
fn measured(
    seen: &Seen<'_>,
    which: Option<Which>,
    speed: Option<f64>,
    motion: Option<[f64; 2]>,
    masters: &Masters,
    options: &FolderOptions,
) -> Result<TargetFrame, ReduceError> {
    let exposure_s = seen.header.exposure_s.unwrap_or(0.0);
    let mut out = TargetFrame {
        file: seen.header.path.display().to_string(),
        filter: seen.header.filter.clone().unwrap_or_else(|| "none".into()),
        time: seen.time,
        exposure_s,
        dwell_s: None,
        shape: None,
        place_px: which.map(|w| seen.place(w).into()),
        length_px: 0.0,
        rate_adu_per_s: None,
        sigma_adu_per_s: None,
        significance: 0.0,
        instrumental_mag: None,
        instrumental_sigma_mag: None,
        sky_deg: None,
        zero_point: None,
        magnitude: None,
        sigma_mag: None,
        sight: None,
        magnitude_1000km: None,
        remark: String::new(),
        flags: Flags::empty(),
        along: Vec::new(),
    };
    let mut remarks: Vec<&str> = Vec::new();
    let (flux, sigma, is_saturated) = match which {
        None => {
            out.flags |= Flags::UNDETECTED;
            out.remark = "no target found".into();
            return Ok(out);
        }
        Some(Which::Point(i)) => {
            let point = &seen.field.points[i];
            (out.shape, out.dwell_s, out.significance) =
                (Some(Shape::Point), Some(exposure_s), point.significance);
            let [flux, sigma] = seen.field.whole_point_adu(point).to_array();
            (flux, sigma, point.is_saturated)
        }
        Some(Which::Streak(i)) => {
            let streak = &seen.field.streaks[i];
            (out.shape, out.length_px, out.significance) =
                (Some(Shape::Streak), streak.length_px, streak.significance);
            out.flags |= Flags::TRAILED;
            if streak.is_cut {
                remarks.push("cut by the edge: length over the rate of motion counts as its time");
                // When it was in the frame is not known from one frame: the middle of the exposure stands.
                out.dwell_s = speed.map(|speed| (streak.length_px / speed).min(exposure_s));
                out.flags |= Flags::EDGE;
            } else {
                out.dwell_s = Some(exposure_s);
            }
            if streak.is_end_hidden {
                remarks.push("an end is hidden: the light may be more");
                out.flags |= Flags::CROWDED;
            }
            if options.parts > 1 && !streak.is_cut && !streak.is_saturated {
                out.along = parts(seen, i, motion, masters, options)?;
                if out.along.is_empty() {
                    remarks.push(
                        "the direction of motion is not known: no light curve along the streak",
                    );
                }
            }
            let [flux, sigma] = seen.field.whole_streak_adu(streak).to_array();
            (flux, sigma, streak.is_saturated)
        }
    };
    if is_saturated {
        remarks.push("saturated");
        out.flags |= Flags::SATURATED;
    } else if let Some(dwell) = out.dwell_s.filter(|s| *s > 0.0) {
        let (rate, sigma) = (flux / dwell, sigma / dwell);
        out.rate_adu_per_s = Some(rate);
        out.sigma_adu_per_s = Some(sigma);
        if rate > 0.0 {
            out.instrumental_mag = Some(-2.5 * rate.log10());
            out.instrumental_sigma_mag = Some(2.5 / std::f64::consts::LN_10 * sigma / rate);
        }
    } else {
        remarks.push("its time in the frame is not known: no rate");
    }
    out.remark = remarks.join("; ");
    Ok(out)
}

/// Standard deviation of sums of green light over what the median of its pixels' distances says: √2 of a green pixel's own, and half of the pixels are means of four, so that
/// the median says 0.685 of it.
const GREEN_NOISE: f64 = std::f64::consts::SQRT_2 / 0.685;

/// The light along a streak in the order of time; empty where the direction of motion is not known.
fn parts(
    seen: &Seen<'_>,
    streak: usize,
    motion: Option<[f64; 2]>,
    masters: &Masters,
    options: &FolderOptions,
) -> Result<Vec<Part>, ReduceError> {
    let streak = &seen.field.streaks[streak];
    let Some(motion) = motion else { return Ok(Vec::new()) };
    let mut frame = ImageFrame::read_as(&seen.header.path, &options.reading)?;
    masters.apply(&mut frame.pixels);
    let mut gain = frame.header.gain_e_per_adu.or(options.field.gain_e_per_adu);
    let mut noise = 1.0;
    if let Some(pattern) = frame.header.bayer {
        frame.pixels = green_light(frame.pixels.view(), pattern);
        gain = gain.map(|gain| 0.5 * gain);
        // The scatter of pixels that are means of others is below that of their sums.
        noise = GREEN_NOISE;
    }
    let mut parts: Vec<Along> = along(frame.pixels.view(), streak, options.parts, gain)?;
    parts.iter_mut().for_each(|part| part.sigma_adu *= noise);
    let [a, b] = streak.ends_px;
    let is_forward = (b[0] - a[0]) * motion[0] + (b[1] - a[1]) * motion[1] >= 0.0;
    let exposure = seen.header.exposure_s.unwrap_or(0.0);
    let mut out: Vec<Part> = parts
        .iter()
        .map(|part| {
            let at = if is_forward { part.at } else { 1.0 - part.at };
            let length = part.width * exposure;
            Part {
                time: seen.time + (at - 0.5) * exposure * Unit::Second,
                exposure_s: length,
                rate_adu_per_s: part.flux_adu / length,
                sigma_adu_per_s: part.sigma_adu / length,
                magnitude: None,
                sigma_mag: None,
                sight: None,
                magnitude_1000km: None,
            }
        })
        .collect();
    out.sort_by_key(|part| part.time);
    Ok(out)
}
