//! The frames of a night: the sensor's faults from its dark frames, the target's place and rates from the others.

use super::held::{HeldFrames, Reads};
use super::library::Library;
use super::recipe::{PointedPlace, RefusedFrames};
use super::seeing;
use super::sensor::{Sensor, Taken, Used, bad_count, filter_of, said_kind};
use super::sky::Body;
use super::times::{TimeDoubt, Times, move_to_row};
use super::widths::{Apertures, Looked, Told, Widths, aperture_px, binned, in_frame};
use super::wings::{self, Wings, WingsBuilder};
use super::{ReduceError, Stay, step};
use crate::counts::SkyLevel;
use crate::photometry::{
    Colour, Desk, Expected, FrameCalibration, FrameMeasurement, FrameReducer, Measured,
    PhotometryError, PhotometryOptions, Scintillation, SigmaParts, Tally,
};
use crate::timing::Timings;
use crate::track::Track;
use glam::DVec2;
use hifitime::{Epoch, Unit};
use ndarray::Array2;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};
use sunglint_formats::Frame;
use sunglint_formats::session::{FrameFile, SHARED, Session, TargetKind};
use sunglint_numerics::measured::Interval;
use sunglint_numerics::order::median;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples,
};
use sunglint_radiometry::station::{Channel, Detector, Plane, Station};

/// Settings of a camera whose calibrations are held at a time.
const SETTINGS: usize = 16;
/// Frames of a target that is followed that are measured side by side: a number of its own, so that results do not depend on the machine. Each expects the target as far off as before the first of them.
const SIDE_BY_SIDE: usize = 8;
/// Frames that do not hang on each other: so many, and so many pixels, since threads wait for the last of them.
const MOST_SIDE_BY_SIDE: usize = 64;
const PIXELS_SIDE_BY_SIDE: usize = 16 << 20;
/// Frames that were read and wait to be measured at most: the next ones to be measured side by side.
const WAITING: usize = SIDE_BY_SIDE;

/// Results from the frames of a camera.
#[derive(Debug)]
pub struct CameraNight {
    /// The camera's name in the session.
    pub camera: String,
    /// Track of the target for each stay.
    pub tracks: Vec<Track>,
    /// Rates of the camera's channels for each stay; `None` without frames.
    pub curves: Vec<Option<LightCurve>>,
    /// Last measurements of each stay, with their frames: for figures.
    pub shown: Vec<Vec<Shown>>,
    /// Light outside of an aperture that was set by hand, of each stay and setting of the camera where it is less than [`APERTURE_FWHM`] widths of a point.
    pub wings: Vec<Vec<Wings>>,
    /// Focus and background of each stay's frames, in the order of time.
    pub looks: Vec<Vec<FrameLook>>,
    /// The sky about targets, and in frames beside them where the targets stood before or after.
    pub sky: Vec<SkyLevel>,
    /// Numbers of what each rule removed.
    pub tally: Tally,
    /// Frames within no stay at a target: sky, dark, on the way.
    pub outside: u64,
    /// Frames whose exposure goes on after the stay: they have no rate.
    pub partly: u64,
    /// Frames in visits to targets that are dark or bias frames by their headers: they have no rate.
    pub without_light: u64,
    /// Frames that may be another program's.
    pub shared: u64,
    /// Width of points assumed for each stay, px: as told, or as its own frames show them.
    pub fwhm_px: Vec<f64>,
    /// Radius of the largest aperture, inner and outer radius of its annulus, px.
    pub aperture_px: [f64; 3],
    /// Radius of the smallest aperture, px: where they are taken from the frames, they are as many widths of a point everywhere.
    pub smallest_aperture_px: f64,
    /// Whether apertures follow the widths of points.
    pub apertures_follow: bool,
    /// Calibration frames that were used.
    pub sensor: Used,
    /// Names of the masters that were taken from the library.
    pub from_library: Vec<String>,
    /// Names of the masters that were added to it.
    pub to_library: Vec<String>,
    /// Doubt of the times of each stay's frames.
    pub times: Vec<TimeDoubt>,
    /// Settings of exposure, gain, binning, window and filter that the frames of targets have.
    pub settings: usize,
    /// Pixels that are left out, of the setting with the most of them.
    pub bad_pixels: usize,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// Frames that could not be read or measured, and why.
    pub failed: Vec<(FrameFile, String)>,
}

/// Focus and background of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameLook {
    /// The middle of the exposure.
    pub time: Epoch,
    /// Full width at half maximum of the target, px, without the pixel's own; `None` where no target was found.
    pub fwhm_px: Option<f64>,
    /// Background of a pixel of the first plane, ADU; NaN where there is none.
    pub background_adu: f64,
}

/// A frame to be drawn, or its part about the target.
#[derive(Debug, Clone)]
pub struct Shown {
    /// The pixels.
    pub pixels: Array2<u16>,
    /// The first of them, column and row of the frame.
    pub origin_px: [usize; 2],
    /// Measurement of the frame.
    pub measured: FrameMeasurement,
    /// Inner and outer radius of the annulus, px.
    pub annulus_px: Interval,
}

/// Sides of what is shown, px.
const SHOWN_PX: usize = 200;

impl Shown {
    /// The part about the target; without one about the frame's middle.
    fn of(frame: &Frame, measured: &FrameMeasurement, annulus_px: Interval) -> Self {
        let (rows, columns) = frame.pixels.dim();
        let size = [columns, rows];
        let origin_px = [0, 1].map(|i| {
            let middle = measured.place_px.map_or(0.5 * size[i] as f64, |place| place[i]);
            let first = (middle - 0.5 * SHOWN_PX as f64).round().max(0.0) as usize;
            first.min(size[i].saturating_sub(SHOWN_PX))
        });
        let [x, y] = origin_px;
        let [to_x, to_y] = [0, 1].map(|i| (origin_px[i] + SHOWN_PX).min(size[i]));
        let pixels = frame.pixels.slice(ndarray::s![y..to_y, x..to_x]).to_owned();
        Self { pixels, origin_px, measured: measured.clone(), annulus_px }
    }
}

/// Files for the sensor's calibration, where the session has no dark frames, or not the right ones.
#[derive(Debug, Clone, Default)]
pub struct SensorFiles {
    /// Dark frames.
    pub darks: Vec<Frame>,
    /// Flats.
    pub flats: Vec<Frame>,
}

/// Radius of an aperture that is taken from the frames, in full widths at half maximum of a point as pixels see it: of a Moffat profile with β = 3 it leaves out 2 %. The same for all
/// nights, so that a calibration stands for the same part of the light.
pub const APERTURE_FWHM: f64 = 2.5;

/// Standard deviations by which a target stands out of the background, where nothing is said.
pub const DETECT_SIGMAS: f64 = 6.0;

/// How a camera's frames are measured.
#[derive(Debug, Clone)]
pub struct FrameOptions {
    /// How targets are found and measured.
    pub photometry: PhotometryOptions,
    /// Whether how wide points are is taken from each stay's own frames, not from the options.
    pub fwhm_from_frames: bool,
    /// Whether apertures follow the points: [`APERTURE_FWHM`] times as wide as they are on each frame, where low targets are wider than high ones, so that what lies outside is the same
    /// part of the light of all.
    pub aperture_from_frames: bool,
    /// Dark frames and flats in place of the session's.
    pub sensor: SensorFiles,
    /// Masters that nights share: for what the session lacks, and of what it has.
    pub library: Option<Library>,
    /// When the cameras expose: what is measured is taken off their frames' times.
    pub timings: Option<Timings>,
    /// Frames that stay in memory between one reduction and the next; without it each is read from the disk.
    pub held: Option<Arc<HeldFrames>>,
    /// Places at which a person saw targets. In a visit with one the target is followed from frame to frame: on from each place to the next, and back from the
    /// first. Each frame's source nearest to the last place is taken, at most [`FOLLOW_APERTURES`] apertures away where the options allow any distance.
    pub places: Vec<PointedPlace>,
    /// Frames that a person refused: their rows have the flag [`Flags::GAP`] and no rate, and their places gate no counts.
    pub refused: Vec<RefusedFrames>,
}

/// A target that is followed moves from frame to frame by at most so many radii of its aperture: further away is another source.
pub const FOLLOW_APERTURES: f64 = 3.0;

/// Young's coefficient of the scintillation: the middle of the sites of Osborn et al. 2015.
const SCINTILLATION: f64 = 1.5;
const APERTURE_PX: f64 = 8.0;
/// Inner and outer radius of the annulus for the background, in radii of the aperture.
const ANNULUS: [f64; 2] = [1.5, 2.5];
/// Width of a point, px of the frame, where no frame tells.
const FWHM_PX: f64 = 4.0;

impl FrameOptions {
    /// Options for a station's camera that take the aperture and the width of points from the frames; `None` for a station without a camera.
    pub fn for_station(station: &Station) -> Option<Self> {
        let camera = station.camera.as_ref()?;
        let mut photometry = PhotometryOptions::new(camera.size_px, camera.read_noise_e);
        photometry.gain_e_per_adu = Some(camera.gain_e_per_adu);
        photometry.saturation_adu = Some(camera.saturation_adu());
        photometry.fwhm_px = FWHM_PX;
        photometry.detection.threshold_sigma = DETECT_SIGMAS;
        photometry.scintillation = Some(Scintillation {
            diameter_m: station.telescope.primary_diameter_m,
            altitude_m: station.site.geodetic().height_m,
            coefficient: SCINTILLATION,
        });
        Some(Self::new(photometry))
    }

    /// Options that take the usual aperture, and the width of points from the frames.
    pub(super) fn new(photometry: PhotometryOptions) -> Self {
        let mut options = Self {
            photometry,
            fwhm_from_frames: true,
            aperture_from_frames: true,
            sensor: SensorFiles::default(),
            library: None,
            timings: None,
            held: None,
            places: Vec::new(),
            refused: Vec::new(),
        };
        options.set_aperture(APERTURE_PX);
        options
    }

    /// Sets the aperture's radius, px, and in proportion to it the annulus for the background.
    pub fn set_aperture(&mut self, radius_px: f64) {
        set_aperture(&mut self.photometry, radius_px);
    }
}

fn set_aperture(options: &mut PhotometryOptions, radius_px: f64) {
    options.aperture_radius_px = radius_px;
    options.annulus_px = ANNULUS.map(|part| part * radius_px).into();
}

/// Frames per stay that are kept for figures.
const SHOWN: usize = 4;

/// The name by which a library knows a camera: its own, where its frames say one, else the session's.
fn instrument(files: &[FrameFile], reads: Reads<'_>, camera: &str) -> String {
    let first = files.iter().find_map(|file| reads.read(file).ok());
    let own =
        first.and_then(|frame| frame.header.text("INSTRUME").map(|name| name.trim().to_owned()));
    own.filter(|name| !name.is_empty()).unwrap_or_else(|| camera.to_owned())
}

/// The stay that a time lies in.
fn stay_at(stays: &[Stay], time: Epoch) -> Option<usize> {
    stays.iter().position(|stay| stay.from <= time && time < stay.to)
}

/// Reads a camera's frames one after the other.
///
/// # Errors
/// A camera that the station has not; options out of their range. A frame that cannot be read or measured is named in the result.
pub fn camera_night(
    session: &Session,
    camera: &str,
    station: &Station,
    stays: &[Stay],
    how: &FrameOptions,
    progress: &dyn Progress,
) -> Result<CameraNight, ReduceError> {
    let files = session.frames(camera)?.files;
    let starts: Vec<Option<Epoch>> = files.iter().map(FrameFile::start).collect();
    let stay_of: Vec<Option<usize>> =
        starts.iter().map(|start| start.and_then(|start| stay_at(stays, start))).collect();
    let mut failed = Vec::new();
    let mut options = how.photometry.clone();
    let reads = Reads(how.held.as_deref());
    let library = how.library.as_ref().map(|library| (library, instrument(&files, reads, camera)));
    let given = (&how.sensor, reads);
    let mut sensor = Sensor::of(&files, &stay_of, stays, given, library, &mut failed);
    if how.library.is_some() && !stays.iter().any(|stay| stay.target.on) {
        sensor.keep_all()?;
    }
    let zeniths = zeniths(&starts, &stay_of, stays, station)?;
    let by_hand = ByHand::of(how, camera, &files, &stay_of, stays);
    let mut seen_widths = None;
    let mut fwhm_px = vec![options.fwhm_px; stays.len()];
    if how.fwhm_from_frames {
        let airmasses: Vec<Option<f64>> = zeniths.iter().map(|z| z.map(path_length)).collect();
        let of = (&files[..], &stay_of[..], &airmasses[..]);
        let (widths, binning) = widths(of, reads, stays, &options, &by_hand, &mut sensor)?;
        let of_stay = |stay: usize| in_frame(widths.of_stay(stay), binning[stay]);
        fwhm_px = (0..stays.len()).map(of_stay).collect();
        seen_widths = Some(widths);
    }
    if how.aperture_from_frames {
        let radius_px = aperture_px(options.fwhm_px);
        set_aperture(&mut options, radius_px);
    }
    let follow = seen_widths.clone().filter(|_| how.aperture_from_frames);
    let mut apertures = Apertures::new(options.aperture_radius_px, follow);
    let mut reducers = Reducers::new(options.clone(), sensor, camera, station);
    let mut night = CameraNight {
        camera: camera.to_owned(),
        tracks: vec![Track::default(); stays.len()],
        curves: vec![None; stays.len()],
        shown: vec![Vec::new(); stays.len()],
        wings: vec![Vec::new(); stays.len()],
        looks: vec![Vec::new(); stays.len()],
        sky: Vec::new(),
        tally: Tally::default(),
        outside: 0,
        partly: 0,
        without_light: 0,
        shared: 0,
        fwhm_px,
        aperture_px: [0.0; 3],
        smallest_aperture_px: 0.0,
        apertures_follow: apertures.follow(),
        sensor: Used::default(),
        from_library: Vec::new(),
        to_library: Vec::new(),
        times: Vec::new(),
        settings: 0,
        bad_pixels: 0,
        warnings: by_hand.warnings.clone(),
        failed: Vec::new(),
    };
    let mut rows: Vec<Vec<Row>> = vec![Vec::new(); stays.len()];
    let mut of_stay = vec![0_usize; stays.len()];
    for stay in stay_of.iter().flatten() {
        of_stay[*stay] += 1;
    }
    let mut seen = vec![0_usize; stays.len()];
    // Where the target of the present visit was last, on the sensor, and at the first place that was pointed at.
    let mut following = Following::default();
    let on_target = |i: &usize| stay_of[*i].filter(|stay| stays[*stay].target.on);
    let order = by_hand.order(&stay_of);
    let mut times = Times::new(how.timings.as_ref(), camera, stays.len());
    std::thread::scope(|scope| -> Result<(), ReduceError> {
        let (sender, ahead) = sync_channel(WAITING);
        let wanted: Vec<&FrameFile> =
            order.iter().filter(|i| on_target(i).is_some()).map(|i| &files[*i]).collect();
        // One thread reads while another measures. After a failure nobody waits for frames any more.
        scope.spawn(move || wanted.iter().all(|file| sender.send(reads.read(file)).is_ok()));
        let mut order = order.iter().copied().peekable();
        loop {
            let mut batch: Vec<Ahead> = Vec::new();
            while let Some(&i) = order.peek() {
                let Some(stay) = on_target(&i) else {
                    step(progress, 1)?;
                    night.outside += 1;
                    order.next();
                    continue;
                };
                // What is followed goes on from the last place, and to one side.
                let back = by_hand.first.get(&stay).map(|first| i < *first);
                let goes_on = batch.first().is_none_or(|first| {
                    first.stay == stay && first.back == back && !by_hand.places.contains_key(&i)
                });
                let most = match batch.first() {
                    Some(Ahead { back: None, frame: Ok(frame), .. }) => {
                        let fit = PIXELS_SIDE_BY_SIDE / frame.pixels.len().max(1);
                        fit.clamp(SIDE_BY_SIDE, MOST_SIDE_BY_SIDE)
                    }
                    _ => SIDE_BY_SIDE,
                };
                if !goes_on || batch.len() >= most {
                    break;
                }
                step(progress, 1)?;
                order.next();
                let file = &files[i];
                let mut read = ahead.recv().unwrap_or_else(|_| reads.read(file));
                let row_time_s = read.as_mut().map_or(0.0, |frame| times.take(frame, stay));
                let airmass = zeniths[i].and_then(airmass);
                let mut one = Ahead {
                    file: i,
                    stay,
                    back,
                    within_px: None,
                    frame: read.map_err(|error| error.to_string()),
                    expected: Expected { airmass, ..Expected::default() },
                    refused: by_hand.refused.contains(&i),
                    held: 0,
                    row_time_s,
                };
                if let Ok(frame) = &one.frame {
                    let dark = [TargetKind::Dark, TargetKind::Bias].map(Some);
                    if dark.contains(&said_kind(frame)) {
                        one.refused = true;
                        night.without_light += 1;
                    }
                    if !one.refused {
                        let through = zeniths[i].map(path_length);
                        one.expected.aperture_radius_px =
                            Some(apertures.radius_px(stay, through, frame));
                    }
                    one.within_px = back.map(|back| {
                        let placed = Placed { sensor_px: options.sensor_px, frame };
                        let place = following.place(stay, back, by_hand.places.get(&i), placed);
                        one.expected.place_px = place.map(DVec2::from);
                        follows_within(&options, one.expected.aperture_radius_px)
                    });
                    let fwhm_px = match &seen_widths {
                        Some(widths) => in_frame(widths.of_stay(stay), frame.binning),
                        None => options.fwhm_px,
                    };
                    one.held = reducers.ready(frame, stay, fwhm_px, one.refused, one.within_px)?;
                }
                batch.push(one);
            }
            if batch.is_empty() {
                break;
            }
            let measured = reducers.measured(&batch);
            for (mut one, mut measured) in batch.into_iter().zip(measured) {
                if let Ok(frame) = &one.frame
                    && let Some((within_px, last_px)) = one.within_px.zip(following.last_px)
                {
                    let place_px = Placed { sensor_px: options.sensor_px, frame }.in_frame(last_px);
                    if reducers.looks_again(&mut one, measured.as_ref(), place_px.into(), within_px)
                    {
                        measured = reducers.measured(std::slice::from_ref(&one)).pop().flatten();
                    }
                }
                let Ahead { file: i, stay, refused, held, frame, row_time_s, .. } = one;
                seen[stay] += 1;
                let measured =
                    frame.and_then(|frame| match reducers.keep(held, &frame, measured) {
                        Ok(measured) => Ok((frame, measured)),
                        Err(error) => Err(error.to_string()),
                    });
                let (frame, mut measured) = match measured {
                    Ok(measured) => measured,
                    Err(error) => {
                        failed.push((files[i].clone(), error));
                        continue;
                    }
                };
                if row_time_s != 0.0 {
                    move_to_row(&mut measured, &frame, row_time_s);
                }
                if let Some(place) = &measured.track.place {
                    following.last_px = Some(place.offset_px.to_array());
                }
                if frame.header.get(SHARED).is_some() {
                    night.shared += 1;
                    measured.planes.iter_mut().for_each(|plane| plane.flags |= Flags::SHARED);
                }
                let end = frame.start + frame.exposure_s * Unit::Second;
                if end > stays[stay].to {
                    night.partly += 1;
                    off_target(&mut measured);
                } else if !refused {
                    night.tracks[stay].points.push(measured.track);
                }
                // Spread over the stay, so that a figure shows its course.
                let due = night.shown[stay].len() < SHOWN;
                let before = seen[stay] - 1;
                if due && before * SHOWN / of_stay[stay].max(1) >= night.shown[stay].len() {
                    let annulus_px = measured.annulus_px.unwrap_or(options.annulus_px);
                    night.shown[stay].push(Shown::of(&frame, &measured, annulus_px));
                }
                let setting = reducers.setting(&Taken::of(&frame));
                rows[stay].push(Row { filter: filter_of(&frame), measured, file: i, setting });
            }
            reducers.let_go();
        }
        Ok(())
    })?;
    for (stay, mut rows) in rows.into_iter().enumerate() {
        rows.sort_by_key(|row| row.measured.time);
        let fwhm_px = |binning: [u32; 2]| match &seen_widths {
            Some(widths) => in_frame(widths.of_stay(stay), binning),
            None => options.fwhm_px,
        };
        night.wings[stay] = wings_of(&mut rows, &files, how, &fwhm_px, &mut reducers)?;
        for wings in night.wings[stay].iter().filter(|wings| wings.factors.is_empty()) {
            let Stay { target, number, .. } = &stays[stay];
            let note = wings.note();
            night
                .warnings
                .push(format!("camera {camera}: {} (visit {number}): {note}", target.name));
        }
        let look = |row: &Row| FrameLook {
            time: row.measured.time,
            fwhm_px: row.measured.fwhm_px,
            background_adu: row.measured.planes.first().map_or(f64::NAN, |p| p.background_adu),
        };
        night.looks[stay] = rows.iter().map(look).collect();
        night.sky.extend(rows.iter().filter_map(|row| {
            let planes = row.measured.planes.iter();
            let planes = planes.map(|plane| [plane.background_adu, plane.background_sigma_adu]);
            sky_level(row.measured.time, row.measured.exposure_s, row.setting, planes)
        }));
        night.tracks[stay].points.sort_by_key(|point| point.time);
        night.shown[stay].sort_by_key(|shown| shown.measured.time);
        night.curves[stay] = (!rows.is_empty()).then(|| curve(&rows, station));
    }
    beside_targets((&files, reads), &stay_of, stays, &reducers, &mut night);
    reducers.finish(&mut night);
    let aperture_px = options.aperture_radius_px;
    let used = apertures.used_px.unwrap_or(Interval { low: aperture_px, high: aperture_px });
    let annulus = options.annulus_px.to_array().map(|radius| radius * used.high / aperture_px);
    night.aperture_px = [used.high, annulus[0], annulus[1]];
    night.smallest_aperture_px = used.low;
    night.warnings.extend(apertures.warning().map(|w| format!("camera {camera}: {w}")));
    night.warnings.extend(times.warning());
    night.times = times.of_stay;
    for (count, what) in [
        (
            night.without_light,
            "frames in visits to targets are dark or bias frames by their headers: they have no rate",
        ),
        (
            night.shared,
            "frames may be another program's, which used the camera, too: they have the flag SHARED",
        ),
    ] {
        if count > 0 {
            night.warnings.push(format!("camera {camera}: {count} {what}"));
        }
    }
    night.failed = failed;
    Ok(night)
}

/// Farthest in time from a target's stay that the sky beside it is measured where the target stood, s.
const BESIDE_S: f64 = 1800.0;

/// The sky in the frames beside targets, where the target of the nearest stay stood: there the sensor's response is the same.
fn beside_targets(
    (files, reads): (&[FrameFile], Reads<'_>),
    stay_of: &[Option<usize>],
    stays: &[Stay],
    reducers: &Reducers<'_>,
    night: &mut CameraNight,
) {
    let place = |track: &Track| -> Option<[f64; 2]> {
        let places = || track.points.iter().filter_map(|point| point.place);
        let [x, y] = [0, 1].map(|i| median(places().map(|place| place.offset_px[i])));
        Some([x?, y?])
    };
    let places: Vec<Option<[f64; 2]>> = night.tracks.iter().map(place).collect();
    let apart_s = |a: &Stay, b: &Stay| (a.from - b.to).max(b.from - a.to).to_seconds();
    let near = |beside: &Stay| {
        let known = stays.iter().zip(&places).filter_map(|(stay, place)| Some((stay, (*place)?)));
        let near = known.map(|(stay, place)| (apart_s(stay, beside), place));
        let near = near.filter(|(apart_s, _)| *apart_s < BESIDE_S);
        near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, place)| place)
    };
    let of_stays: Vec<Option<[f64; 2]>> = stays
        .iter()
        .map(|stay| (stay.target.target_kind == TargetKind::Sky).then(|| near(stay)).flatten())
        .collect();
    let wanted: Vec<(&FrameFile, [f64; 2])> = (files.iter().zip(stay_of))
        .filter_map(|(file, stay)| Some((file, of_stays[(*stay)?]?)))
        .collect();
    let level = |(file, offset_px): &(&FrameFile, [f64; 2])| {
        let frame = reads.read(file).ok()?;
        let taken = Taken::of(&frame);
        let held = reducers.held.iter().find(|held| held.taken.is_like(&taken))?;
        let placed = Placed { sensor_px: reducers.options.sensor_px, frame: &frame };
        let place_px = placed.in_frame(*offset_px);
        let planes = held.reducer.sky_about(&frame, place_px).ok()?;
        let time = frame.start + 0.5 * frame.exposure_s * Unit::Second;
        sky_level(time, frame.exposure_s, reducers.setting(&taken), planes.into_iter())
    };
    let found: Vec<SkyLevel> = wanted.par_iter().filter_map(level).collect();
    night.sky.extend(found);
}

/// The sky of a frame, all planes together; `None` where one has no background.
fn sky_level(
    time: Epoch,
    exposure_s: f64,
    setting: usize,
    planes: impl Iterator<Item = [f64; 2]>,
) -> Option<SkyLevel> {
    let (mut level, mut variance) = (0.0, 0.0);
    for [background_adu, sigma_adu] in planes {
        level += background_adu;
        variance += sigma_adu * sigma_adu;
    }
    let [level, sigma] = [level, variance.sqrt()].map(|adu| adu / exposure_s);
    (level.is_finite() && sigma > 0.0 && sigma.is_finite()).then_some(SkyLevel {
        time,
        level,
        sigma,
        setting,
    })
}

/// Choices of a person for the frames of a camera.
#[derive(Debug, Default)]
struct ByHand {
    /// Places of targets, by the index of their frames.
    places: BTreeMap<usize, [f64; 2]>,
    /// The first frame of each visit that has a place.
    first: BTreeMap<usize, usize>,
    /// Indices of refused frames.
    refused: BTreeSet<usize>,
    warnings: Vec<String>,
}

impl ByHand {
    fn of(
        how: &FrameOptions,
        camera: &str,
        files: &[FrameFile],
        stay_of: &[Option<usize>],
        stays: &[Stay],
    ) -> Self {
        let mut by_hand = Self::default();
        let mut foreign = Vec::new();
        // Each number with the frames that have it, for a camera that began anew has a number twice.
        let mut find = |number: u64| {
            let from = files.partition_point(|file| file.sequence < number);
            let same = files[from..].iter().take_while(|file| file.sequence == number).count();
            let on = |i: &usize| stay_of[*i].is_some_and(|stay| stays[stay].target.on);
            let found: Vec<usize> = (from..from + same).filter(on).collect();
            if found.is_empty() {
                foreign.push(number);
            }
            found
        };
        for place in how.places.iter().filter(|place| place.camera == camera) {
            for i in find(place.frame) {
                by_hand.places.insert(i, place.place_px.to_array());
            }
        }
        for refused in how.refused.iter().filter(|refused| refused.camera == camera) {
            for number in &refused.frames {
                by_hand.refused.extend(find(*number));
            }
        }
        for i in by_hand.places.keys() {
            if let Some(stay) = stay_of[*i] {
                by_hand.first.entry(stay).or_insert(*i);
            }
        }
        if !foreign.is_empty() {
            let some: Vec<String> = foreign.iter().take(5).map(ToString::to_string).collect();
            by_hand.warnings.push(format!(
                "camera {camera}: {} frames that were pointed at or refused are of no visit that is reduced: {}{}",
                foreign.len(),
                some.join(", "),
                if foreign.len() > 5 { ", …" } else { "" }
            ));
        }
        by_hand
    }

    /// Indices of all frames in the order in which they are measured: in a visit with places from the first place on, then back from it.
    fn order(&self, stay_of: &[Option<usize>]) -> Vec<usize> {
        let mut order = Vec::with_capacity(stay_of.len());
        let mut back: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, stay) in stay_of.iter().enumerate() {
            match stay.and_then(|stay| Some((stay, *self.first.get(&stay)?))) {
                Some((stay, first)) if i < first => back.entry(stay).or_default().push(i),
                _ => order.push(i),
            }
        }
        order.extend(back.into_values().flat_map(|frames| frames.into_iter().rev()));
        order
    }
}

/// Distance from its last place within which a target that is followed is looked for, px.
fn follows_within(options: &PhotometryOptions, aperture_px: Option<f64>) -> f64 {
    let most = options.detection.max_offset_px;
    let aperture_px = aperture_px.unwrap_or(options.aperture_radius_px);
    if most.is_finite() { most } else { FOLLOW_APERTURES * aperture_px }
}

/// A frame on the sensor.
#[derive(Clone, Copy)]
struct Placed<'a> {
    sensor_px: [u32; 2],
    frame: &'a Frame,
}

impl Placed<'_> {
    /// Columns and rows from the sensor's middle, unbinned, of a place in the frame.
    fn on_sensor(self, place_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| {
            let binning = f64::from(self.frame.binning[i]);
            f64::from(self.frame.origin[i]) + (place_px[i] + 0.5) * binning
                - 0.5 * f64::from(self.sensor_px[i])
        })
    }

    /// The reverse of [`on_sensor`](Self::on_sensor).
    fn in_frame(self, offset_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| {
            let on_sensor = offset_px[i] + 0.5 * f64::from(self.sensor_px[i]);
            (on_sensor - f64::from(self.frame.origin[i])) / f64::from(self.frame.binning[i]) - 0.5
        })
    }
}

/// Way of a target that is followed, on the sensor.
#[derive(Debug, Default)]
struct Following {
    /// The visit, and whether it is followed back from its first place.
    of: Option<(usize, bool)>,
    first_px: BTreeMap<usize, [f64; 2]>,
    last_px: Option<[f64; 2]>,
}

impl Following {
    /// Where the target of a frame is expected, px of the frame.
    fn place(
        &mut self,
        stay: usize,
        back: bool,
        pointed: Option<&[f64; 2]>,
        placed: Placed<'_>,
    ) -> Option<[f64; 2]> {
        if self.of != Some((stay, back)) {
            self.of = Some((stay, back));
            self.last_px = self.first_px.get(&stay).copied();
        }
        if let Some(place_px) = pointed {
            let offset_px = placed.on_sensor(*place_px);
            self.first_px.entry(stay).or_insert(offset_px);
            self.last_px = Some(offset_px);
        }
        self.last_px.map(|offset_px| placed.in_frame(offset_px))
    }
}

/// A frame that was read and is not measured yet.
#[derive(Debug)]
struct Ahead {
    /// Index among the files.
    file: usize,
    stay: usize,
    /// Whether a target that is followed is followed back; `None` where none is.
    back: Option<bool>,
    /// Distance from its last place within which such a target is looked for, px.
    within_px: Option<f64>,
    frame: Result<Frame, String>,
    expected: Expected,
    /// Whether it is not measured at all.
    refused: bool,
    /// Place of the reducer.
    held: usize,
    /// Time by which each row begins after the one before, s.
    row_time_s: f64,
}

/// A frame that was measured.
#[derive(Debug, Clone)]
struct Row {
    measured: FrameMeasurement,
    /// The filter before the camera, where the header says it.
    filter: Option<String>,
    /// Index of its file.
    file: usize,
    /// Setting of the camera.
    setting: usize,
}

/// Measures the light outside of an aperture that was set by hand, for each setting of a visit's frames, and multiplies their rates.
fn wings_of(
    rows: &mut [Row],
    files: &[FrameFile],
    how: &FrameOptions,
    fwhm_px: &dyn Fn([u32; 2]) -> f64,
    reducers: &mut Reducers<'_>,
) -> Result<Vec<Wings>, ReduceError> {
    let reads = Reads(how.held.as_deref());
    let settings: BTreeSet<usize> = rows.iter().map(|row| row.setting).collect();
    let mut found = Vec::new();
    for setting in settings {
        let Some(taken) = reducers.settings.get(setting) else { continue };
        let Some(wide) = wings::wide(how, fwhm_px(taken.binning())) else { continue };
        let of_it = |row: &&Row| row.setting == setting && WingsBuilder::takes(&row.measured);
        let telling: Vec<&Row> = rows.iter().filter(of_it).collect();
        let calibration = reducers.calibration(setting)?;
        let mut builder =
            WingsBuilder::new(how.photometry.aperture_radius_px, wide.clone(), calibration)?;
        let step = telling.len().div_ceil(wings::FRAMES).max(1);
        let some: Vec<&Row> = telling.into_iter().step_by(step).collect();
        let look = |row: &&Row| {
            // What cannot be read any more was read a moment ago: it tells nothing.
            let frame = reads.read(&files[row.file]).ok()?;
            Some(builder.ratios(&frame, &row.measured))
        };
        let ratios: Vec<_> = some.par_iter().filter_map(look).collect();
        ratios.into_iter().for_each(|ratios| builder.add(ratios));
        let of_it = rows.iter_mut().filter(|row| row.setting == setting);
        let mut of_it = of_it.map(|row| &mut row.measured).peekable();
        let colours = of_it.peek().map(|m| m.planes.iter().map(|p| p.colour).collect());
        let wings = builder.finish(&colours.unwrap_or_else(Vec::new));
        of_it.for_each(|measured| wings.apply(measured));
        found.push(wings);
    }
    Ok(found)
}

/// A reducer for each setting of the camera.
#[derive(Debug)]
struct Reducers<'a> {
    options: PhotometryOptions,
    sensor: Sensor<'a>,
    camera: &'a str,
    held: Vec<Held>,
    /// Frames so far.
    frames: u64,
    /// Buffers that nobody uses at the moment.
    desks: Mutex<Vec<Desk>>,
    /// All settings so far.
    settings: Vec<Taken>,
    tally: Tally,
    bad_pixels: usize,
    /// The filters of the station's channels; empty where they name none.
    filters: Vec<String>,
    /// Frames behind filters that no channel has, by filter.
    unknown: BTreeMap<String, u64>,
    /// Name of the station.
    station: &'a str,
    /// Numbers of the frames that are not those of the station, in words.
    differing: BTreeSet<String>,
}

/// Parts by which a frame's gain and its saturation may differ from the station's without a word: of some cameras the level without light is in the saturation.
const DIFFERS: [f64; 2] = [0.01, 0.1];

#[derive(Debug)]
struct Held {
    taken: Taken,
    reducer: FrameReducer,
    stay: usize,
    /// The number of the last frame that it was for.
    last: u64,
}

impl<'a> Reducers<'a> {
    fn new(
        options: PhotometryOptions,
        sensor: Sensor<'a>,
        camera: &'a str,
        station: &'a Station,
    ) -> Self {
        let all = station.channels.iter();
        let camera_channels = all.filter(|c| matches!(c.detector, Detector::CameraPlane(_)));
        // One channel without a filter takes all frames.
        let filters: Option<Vec<String>> = camera_channels.map(|c| c.filter.clone()).collect();
        Self {
            options,
            sensor,
            camera,
            held: Vec::new(),
            frames: 0,
            desks: Mutex::default(),
            settings: Vec::new(),
            tally: Tally::default(),
            bad_pixels: 0,
            filters: filters.unwrap_or_default(),
            unknown: BTreeMap::new(),
            station: &station.name,
            differing: BTreeSet::new(),
        }
    }

    /// Notes where a frame's own gain or saturation is not the station's.
    fn compare(&mut self, frame: &Frame) {
        let own = [frame.gain_e_per_adu, frame.saturation_adu];
        let usual = [self.options.gain_e_per_adu, self.options.saturation_adu];
        let words = ["e⁻/ADU (EGAIN)", "ADU as their saturation (SATURATE)"];
        let rules =
            ["their own counts", "the lower counts where the gain is the same, else their own"];
        for (i, (own, usual)) in own.into_iter().zip(usual).enumerate() {
            let Some((own, usual)) = own.zip(usual).filter(|(own, _)| *own > 0.0) else { continue };
            if (own / usual - 1.0).abs() > DIFFERS[i] {
                let (word, rule, station) = (words[i], rules[i], self.station);
                self.differing.insert(format!(
                    "frames say {own} {word}, station {station} has {usual}: {rule}"
                ));
            }
        }
    }

    /// Makes a reducer ready for a frame; gives its place, which holds until [`Reducers::let_go`].
    fn ready(
        &mut self,
        frame: &Frame,
        stay: usize,
        fwhm_px: f64,
        refused: bool,
        within_px: Option<f64>,
    ) -> Result<usize, ReduceError> {
        let taken = Taken::of(frame);
        if !self.filters.is_empty()
            && !taken.filter.as_ref().is_some_and(|f| self.filters.contains(f))
        {
            let name = taken.filter.clone().unwrap_or_else(|| "(none)".into());
            *self.unknown.entry(name).or_default() += 1;
        }
        let found = self.held.iter().position(|held| held.taken.is_like(&taken));
        let place = match found {
            Some(place) => place,
            None => {
                if !self.settings.iter().any(|known| known.is_like(&taken)) {
                    self.settings.push(taken.clone());
                    self.compare(frame);
                }
                let calibration = self.sensor.calibration(&taken)?;
                let bad = calibration.bad.as_ref().map_or(0, bad_count);
                self.bad_pixels = self.bad_pixels.max(bad);
                let reducer = FrameReducer::new(self.options.clone(), calibration)?;
                self.held.push(Held { taken, reducer, stay: usize::MAX, last: 0 });
                self.held.len() - 1
            }
        };
        self.frames += 1;
        let held = &mut self.held[place];
        held.last = self.frames;
        // What is followed may move by as much as its aperture, which changes along a pass.
        if let Some(within_px) = within_px.filter(|_| !refused) {
            held.reducer.set_max_offset_px(within_px)?;
        }
        if held.stay != stay {
            held.reducer.set_fwhm_px(fwhm_px)?;
            if !refused {
                let usual = self.options.detection.max_offset_px;
                held.reducer.set_max_offset_px(within_px.unwrap_or(usual))?;
                held.stay = stay;
            }
        }
        Ok(place)
    }

    /// Measures frames, side by side; `None` for what is not measured.
    fn measured(&self, batch: &[Ahead]) -> Vec<Option<Result<Measured, PhotometryError>>> {
        let of = |one: &Ahead| {
            let frame = one.frame.as_ref().ok().filter(|_| !one.refused)?;
            let spare = || self.desks.lock().unwrap_or_else(PoisonError::into_inner);
            let mut desk = spare().pop().unwrap_or_default();
            let found = self.held[one.held].reducer.measured(frame, &one.expected, &mut desk);
            spare().push(desk);
            Some(found)
        };
        match batch {
            // Handed to no other thread.
            [one] => vec![of(one)],
            batch => batch.par_iter().map(of).collect(),
        }
    }

    /// Expects a target that is followed where it was last. Frames that are measured side by side expect it where it was before the first of them: returns whether that may
    /// have led to another target, or to none, so that the frame is to be measured again.
    fn looks_again(
        &self,
        one: &mut Ahead,
        measured: Option<&Result<Measured, PhotometryError>>,
        place_px: DVec2,
        within_px: f64,
    ) -> bool {
        let looked_px = one.expected.place_px.replace(place_px);
        let (Some(Ok(found)), Some(looked_px)) = (measured, looked_px) else { return false };
        let moved_px = looked_px.distance(place_px);
        if moved_px == 0.0 {
            return false;
        }
        let Some(found_px) = found.measurement.place_px else { return true };
        // A source that is nearer to the place than this one would have been seen, too.
        let off_px = found_px.distance(place_px);
        let alone = found.measurement.candidates == 1;
        let surely_px = self.held[one.held].reducer.surely_px();
        !(alone && off_px <= within_px && off_px + moved_px <= surely_px)
    }

    /// Keeps a measurement in its reducer's tally; without one the frame has no rate.
    fn keep(
        &mut self,
        held: usize,
        frame: &Frame,
        measured: Option<Result<Measured, PhotometryError>>,
    ) -> Result<FrameMeasurement, PhotometryError> {
        let reducer = &mut self.held[held].reducer;
        match measured {
            None => Ok(reducer.unmeasured(frame, Flags::GAP)),
            Some(measured) => Ok(reducer.keep(measured?)),
        }
    }

    /// Lets go of reducers that were not used for long, where there are many.
    fn let_go(&mut self) {
        while self.held.len() > SETTINGS {
            let oldest = (0..self.held.len()).min_by_key(|place| self.held[*place].last);
            let Some(oldest) = oldest else { break };
            self.tally += self.held.remove(oldest).reducer.tally();
        }
    }

    /// Number of a setting among those that were measured.
    fn setting(&self, taken: &Taken) -> usize {
        self.settings.iter().position(|known| known.is_like(taken)).unwrap_or(self.settings.len())
    }

    /// Calibration of the frames of a setting.
    fn calibration(&mut self, setting: usize) -> Result<FrameCalibration, ReduceError> {
        let Some(taken) = self.settings.get(setting) else {
            return Ok(FrameCalibration::default());
        };
        match self.held.iter().find(|held| held.taken.is_like(taken)) {
            Some(held) => Ok(held.reducer.calibration().clone()),
            None => self.sensor.calibration(taken),
        }
    }

    fn finish(mut self, night: &mut CameraNight) {
        for held in &self.held {
            self.tally += held.reducer.tally();
        }
        night.tally = self.tally;
        night.sensor = self.sensor.used();
        night.from_library = std::mem::take(&mut self.sensor.from_library).into_iter().collect();
        night.to_library = std::mem::take(&mut self.sensor.to_library).into_iter().collect();
        let camera = self.camera;
        let sensor = std::mem::take(&mut self.sensor.warnings).into_iter();
        let all = sensor.chain(std::mem::take(&mut self.differing));
        night.warnings.extend(all.map(|warning| format!("camera {camera}: {warning}")));
        night.settings = self.settings.len();
        night.bad_pixels = self.bad_pixels;
        let mut gains: Vec<f64> = self.settings.iter().filter_map(Taken::gain).collect();
        gains.sort_by(f64::total_cmp);
        gains.dedup();
        if gains.len() > 1 {
            let gains: Vec<String> = gains.iter().map(ToString::to_string).collect();
            night.warnings.push(format!(
                "camera {camera}: frames of targets were taken with gains of {}: their rates, in ADU/s, are of different sizes; take one gain for a night, or calibrate each by itself",
                gains.join(", ")
            ));
        }
        if !night.apertures_follow
            && self.settings.iter().any(|taken| taken.binning() != self.settings[0].binning())
        {
            night.warnings.push(format!(
                "camera {camera}: frames of targets have different binnings: the aperture has as many of a frame's pixels in all of them, and covers different parts of the sky"
            ));
        }
        for (filter, frames) in self.unknown {
            night.warnings.push(format!(
                "camera {camera}: {frames} frames behind filter {filter} are of no channel: the station's channels have {}",
                self.filters.join(", ")
            ));
        }
    }
}

/// Widths of points at each stay and airmass, and the binning of each stay; a stay that does not tell has the median of those that do, or what the options say.
fn widths(
    (files, stay_of, airmasses): (&[FrameFile], &[Option<usize>], &[Option<f64>]),
    reads: Reads<'_>,
    stays: &[Stay],
    options: &PhotometryOptions,
    by_hand: &ByHand,
    sensor: &mut Sensor<'_>,
) -> Result<(Widths, Vec<[u32; 2]>), ReduceError> {
    let mut told = vec![Told::default(); stays.len()];
    let mut of_binning = vec![[1, 1]; stays.len()];
    let mut known = None;
    for number in (0..stays.len()).filter(|stay| stays[*stay].target.on) {
        let is_of_it = |i: &usize| stay_of[*i] == Some(number) && !by_hand.refused.contains(i);
        let of_it: Vec<usize> = (0..files.len()).filter(is_of_it).collect();
        // The first place will do: other sources are points as wide as the target.
        let place_px = by_hand.first.get(&number).and_then(|first| by_hand.places.get(first));
        let expected =
            Expected { place_px: place_px.copied().map(DVec2::from), ..Expected::default() };
        // As the first of its frames was taken.
        let first = of_it.iter().find_map(|i| reads.read(&files[*i]).ok());
        let Some(first) = first else { continue };
        let taken = Taken::of(&first);
        let binned = binned(first.binning);
        of_binning[number] = first.binning;
        if known.as_ref().is_none_or(|(of, _): &(Taken, _)| !of.is_like(&taken)) {
            known = Some((taken.clone(), sensor.calibration(&taken)?));
        }
        let of_one =
            |i: &usize| reads.read(&files[*i]).is_ok_and(|frame| Taken::of(&frame).is_like(&taken));
        let mixed = of_it.last().is_some_and(|last| !of_one(last));
        let of_it = if mixed { of_it.into_iter().filter(of_one).collect() } else { of_it };
        let Some((_, calibration)) = &known else { continue };
        let seen: Vec<&FrameFile> = of_it.iter().map(|i| &files[*i]).collect();
        let Some(width) = seeing::fwhm_px((&seen, reads), options, calibration, &expected)? else {
            continue;
        };
        let told = &mut told[number];
        (told.fwhm_px, told.saturated) = (Some(width.fwhm_px * binned), width.saturated);
        if width.saturated {
            continue;
        }
        for (path, fwhm_px) in width.of_files {
            let airmass =
                of_it.iter().find(|i| files[**i].path == path).and_then(|i| airmasses[*i]);
            let fwhm_px = fwhm_px * binned;
            told.looked.extend(airmass.map(|airmass| Looked { fwhm_px, airmass }));
        }
    }
    // The usual width is one of the frames' pixels.
    let on = (0..stays.len()).filter(|stay| stays[*stay].target.on);
    let usual = median(on.map(|stay| binned(of_binning[stay]))).unwrap_or(1.0) * options.fwhm_px;
    let airmass_of = |stay: usize| {
        let own = stay_of.iter().zip(airmasses).filter(|(of, _)| **of == Some(stay));
        median(own.filter_map(|(_, airmass)| *airmass))
    };
    let of_stays: Vec<Option<f64>> = (0..stays.len()).map(airmass_of).collect();
    Ok((Widths::of(&told, &of_stays, usual), of_binning))
}

/// Removes the rates of a frame whose light is not the target's alone.
fn off_target(measured: &mut FrameMeasurement) {
    for plane in &mut measured.planes {
        plane.rate_adu_per_s = f64::NAN;
        plane.sigma = SigmaParts::UNKNOWN;
        plane.flags |= Flags::OFF_TARGET;
    }
}

/// Airmass for the widths of points: near the horizon it grows no more.
fn path_length(zenith_deg: f64) -> f64 {
    1.0 / zenith_deg.min(84.9).to_radians().cos()
}

/// Airmass of a plane-parallel air, as the law of scintillation is written for; `None` where that has no meaning.
fn airmass(zenith_deg: f64) -> Option<f64> {
    (zenith_deg < 85.0).then(|| 1.0 / zenith_deg.to_radians().cos())
}

/// The true zenith angle of each frame's target, deg, where it has a place.
fn zeniths(
    starts: &[Option<Epoch>],
    stay_of: &[Option<usize>],
    stays: &[Stay],
    station: &Station,
) -> Result<Vec<Option<f64>>, ReduceError> {
    let mut zeniths = vec![None; starts.len()];
    for (number, stay) in stays.iter().enumerate().filter(|(_, stay)| stay.target.on) {
        let Some(body) = Body::of(&stay.target)? else { continue };
        let (places, times): (Vec<usize>, Vec<Epoch>) = (0..starts.len())
            .filter(|i| stay_of[*i] == Some(number))
            .filter_map(|i| Some((i, starts[i]?)))
            .unzip();
        let mut samples = Samples::new(times, 1.0);
        body.locate(&mut samples, &station.site)?;
        for (i, zenith) in places.into_iter().zip(samples.zenith_deg.unwrap_or_default()) {
            zeniths[i] = Some(zenith);
        }
    }
    Ok(zeniths)
}

/// The plane of a frame that a channel counts.
fn is_of(channel: &Channel, colour: Colour) -> bool {
    let Detector::CameraPlane(plane) = channel.detector else { return false };
    matches!(
        (plane, colour),
        (Plane::R, Colour::Red)
            | (Plane::G, Colour::Green)
            | (Plane::B, Colour::Blue)
            | (Plane::L, Colour::Mono)
    )
}

/// The rates of a stay as a light curve of the station's channels.
fn curve(rows: &[Row], station: &Station) -> LightCurve {
    let channels = station.channels.iter().filter_map(|channel| {
        let mut curve = ChannelCurve {
            name: channel.name.clone(),
            rate_hz: Vec::with_capacity(rows.len()),
            sigma_hz: Vec::with_capacity(rows.len()),
            flags: Vec::with_capacity(rows.len()),
            model_error_hz: None,
            common_sigma_hz: None,
        };
        let mut found = false;
        for row in rows {
            let through = channel.filter.is_none() || channel.filter == row.filter;
            let mut planes = row.measured.planes.iter();
            let plane = planes.find(|plane| through && is_of(channel, plane.colour));
            found |= plane.is_some();
            let (rate, sigma, flags) = match plane {
                Some(plane) => (plane.rate_adu_per_s, plane.sigma.total(), plane.flags),
                None => (f64::NAN, f64::NAN, Flags::NOT_SAMPLED),
            };
            // A rate without an uncertainty is none: both or neither.
            let whole = rate.is_finite() && sigma.is_finite();
            curve.rate_hz.push(if whole { rate } else { f64::NAN });
            curve.sigma_hz.push(if whole { sigma } else { f64::NAN });
            curve.flags.push(if whole || !flags.is_empty() { flags } else { Flags::GAP });
        }
        found.then_some(curve)
    });
    LightCurve {
        kind: RateKind::Linear,
        samples: Samples {
            time: rows.iter().map(|row| row.measured.time).collect(),
            exposure_s: rows.iter().map(|row| row.measured.exposure_s).collect(),
            ..Samples::default()
        },
        channels: channels.collect(),
        provenance: Provenance::default(),
        other: sunglint_formats::Meta::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hifitime::Unit;
    use sunglint_formats::time::parse_utc;

    /// Truth: the name that sessions document.
    #[test]
    fn a_frames_name_has_its_start() {
        let named = |name: &str| {
            FrameFile { sequence: 42, path: format!("frames/c/17/{name}").into() }.start()
        };
        assert_eq!(
            named("20201118T170503.123456Z_00000042.fits"),
            parse_utc("2020-11-18T17:05:03.123456Z").ok()
        );
        assert_eq!(
            named("20161231T235960.500000Z_00000001.fits"),
            parse_utc("2016-12-31T23:59:60.5Z").ok()
        );
        for other in ["x.fits", "2020_1.fits", "20201318T170503Z_1.fits", "é0201118T170503Z_1.fits"]
        {
            assert_eq!(named(other), None, "{other}");
        }
        let half = parse_utc("2020-11-18T17:05:03Z").unwrap() + 0.5 * Unit::Second;
        assert_eq!(named("20201118T170503.500000Z_00000002.fits"), Some(half));
    }
}
