//! Dark frames, bias frames and flats of a folder: which fit which frames, and what is made of them.

use crate::photometry::field::cut_flat;
use hifitime::Epoch;
use ndarray::Array2;
use std::collections::BTreeSet;
use std::path::Path;
use sunglint_formats::image_frame::{FrameHeader, FrameKind, ImageFrame, ReadOptions};
use sunglint_numerics::order::median;

/// Temperature of a dark differs from its frame's by at most this, °C.
const NEAR_C: f64 = 2.0;

/// A frame by its header.
pub(super) struct Entry {
    pub(super) header: FrameHeader,
    pub(super) kind: FrameKind,
    /// Value at which many pixels of a flat are cut off, ADU.
    pub(super) cut_adu: Option<f64>,
}

pub(super) fn near(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * a.abs().max(b.abs())
}

/// Whether frames come from the same settings of the camera.
pub(super) fn same_camera(a: &FrameHeader, b: &FrameHeader) -> bool {
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
pub(super) fn differences(frame: &Entry, like: &FrameHeader) -> Vec<&'static str> {
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

pub(super) fn same_temperature(a: &FrameHeader, b: &FrameHeader) -> bool {
    match (a.temperature_c, b.temperature_c) {
        (Some(a), Some(b)) => (a - b).abs() <= NEAR_C,
        _ => true,
    }
}

/// Dark and flat for one group of frames.
#[derive(Default)]
pub(super) struct Masters {
    pub(super) dark: Option<Array2<f32>>,
    pub(super) flat: Option<Array2<f32>>,
    /// Notes on how they were made.
    pub(super) notes: Vec<&'static str>,
}

impl Masters {
    /// Takes the dark off and divides by the flat; gives the middle of the dark, ADU.
    pub(super) fn apply(&self, pixels: &mut Array2<f32>) -> f64 {
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
pub(super) fn read(
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
pub(super) fn mean(headers: &[&FrameHeader], options: &ReadOptions) -> Option<Array2<f32>> {
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

/// Calibration frames of a folder.
pub(super) struct Calibration<'a> {
    pub(super) entries: &'a [Entry],
    pub(super) options: &'a ReadOptions,
    /// Those that went into a master.
    pub(super) used: BTreeSet<&'a Path>,
    /// Settings of the flats that were used: frames may be dark frames of these alone.
    pub(super) flats: Vec<&'a FrameHeader>,
}

impl<'a> Calibration<'a> {
    pub(super) fn new(entries: &'a [Entry], options: &'a ReadOptions) -> Self {
        Self { entries, options, used: BTreeSet::new(), flats: Vec::new() }
    }

    /// The frames of a kind that fit.
    pub(super) fn fitting(&self, kind: FrameKind, like: &FrameHeader) -> Vec<&'a FrameHeader> {
        let fits =
            |e: &&Entry| e.kind == kind && e.cut_adu.is_none() && differences(e, like).is_empty();
        self.entries.iter().filter(fits).map(|e| &e.header).take(MOST).collect()
    }

    /// The mean of frames, which count as used.
    pub(super) fn mean(&mut self, headers: &[&'a FrameHeader]) -> Option<Array2<f32>> {
        let mean = mean(headers, self.options)?;
        self.used.extend(headers.iter().map(|header| header.path.as_path()));
        Some(mean)
    }

    /// The dark of frames of this exposure, else the bias; and whether it is the bias.
    pub(super) fn dark(&mut self, like: &FrameHeader) -> Option<(Array2<f32>, bool)> {
        let darks = self.fitting(FrameKind::Dark, like);
        if let Some(dark) = self.mean(&darks) {
            return Some((dark, false));
        }
        let biases = self.fitting(FrameKind::Bias, like);
        Some((self.mean(&biases)?, true))
    }

    /// Dark and flat for frames like this one.
    pub(super) fn masters(&mut self, light: &FrameHeader) -> Masters {
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
    pub(super) fn reason(&self, entry: &Entry, lights: &[(Epoch, &FrameHeader)]) -> String {
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
