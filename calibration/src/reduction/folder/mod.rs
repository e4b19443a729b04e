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

mod masters;
mod measure;
mod stars;
mod target;

use self::masters::{Calibration, Entry, Masters, read, same_camera, same_temperature};
use self::measure::measured;
use self::target::{PLACE_PX, Seen, choose, speed_px_per_s};
use super::sight::{Sight, SightedObject, sights};
use super::{ReduceError, step};
use crate::field_stars::{Catalogue, CatalogueOptions, ColourTerm, System, ZeroPoint};
use crate::photometry::PhotometryError;
use crate::photometry::field::{FieldOptions, Growth, constant, find, plateau};
use glam::{DVec2, DVec3};
use hifitime::Epoch;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::tle::Tle;
use sunglint_formats::image_frame::{FrameHeader, FrameKind, ImageFrame, ReadOptions};
use sunglint_formats::sha256;
use sunglint_formats::wcs::Equatorial;
use sunglint_numerics::measured::Measured;
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
                common_sigma_hz: None,
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

/// Name of a filter's channel: letters, digits and `_`.
fn channel_name(filter: &str) -> String {
    let name: String = filter
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' })
        .collect();
    if name.is_empty() { "none".into() } else { name }
}
