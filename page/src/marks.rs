//! Marks on a frame: where the reduction would find its target, and what it would measure there.

use crate::request::Answer;
use hifitime::Epoch;
use serde::Serialize;
use sunglint_calibration::photometry::{
    Candidate, Choice, Expected, FrameCalibration, FrameReducer, PhotometryError, Rejection,
};
use sunglint_calibration::reduction::frames::FrameOptions;
use sunglint_formats::Frame;
use sunglint_formats::fits::Header;
use sunglint_observatory::focus::star::sharpness;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::Station;

/// Sources of a frame that are shown at most.
const SOURCES: usize = 500;
/// Rows and columns of a frame in which its half-flux radius is looked for, at most.
const SHARP_PX: usize = 1024;

/// Target of a frame, as the reduction would measure it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct MarksView {
    /// Start of the frame, s after the session's start: marks of another frame are not drawn.
    start_s: f64,
    /// Column and row of the target; `None`: none found.
    place_px: Option<[f64; 2]>,
    aperture_px: f64,
    annulus_px: [f64; 2],
    fwhm_px: Option<f64>,
    /// Half-flux radius of the frame's stars, px, where it was asked for and can be measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    hfr_px: Option<f64>,
    /// Whether the half-flux radius was asked for.
    #[serde(skip)]
    sharp: bool,
    /// Column and row where the reduction expects a target that nobody pointed at: the frame's middle.
    expected_px: [f64; 2],
    candidates: usize,
    planes: Vec<PlaneView>,
    /// All sources of the frame, where they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    sources: Option<Vec<SourceView>>,
    /// Sources that are not among them: of a crowded field only the first ones are drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    sources_left_out: Option<usize>,
}

/// Source of a frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct SourceView {
    kind: SourceKind,
    place_px: [f64; 2],
    /// Length and direction of a streak, columns and rows.
    trail_px: [f64; 2],
}

/// Kind of a source, as the reduction's filters tell it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum SourceKind {
    /// A star or a target.
    Point,
    /// A satellite's or an aeroplane's trail.
    Streak,
    /// Cosmic ray or hot pixel.
    Sharp,
    /// Neither: too wide, at the edge, too few or too many pixels.
    Other,
}

/// Besides the target's marks.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct More {
    /// Half-flux radius.
    pub sharpness: bool,
    /// All sources.
    pub sources: bool,
}

/// Regions longer than this many times their width are streaks.
const DRAWN_OUT: f64 = 2.5;

impl SourceView {
    fn of(candidate: &Candidate) -> Self {
        let kind = match candidate.rejection {
            None | Some(Rejection::Offset) => SourceKind::Point,
            Some(Rejection::Sharp) => SourceKind::Sharp,
            Some(Rejection::Streak) => SourceKind::Streak,
            Some(_) if candidate.is_long(DRAWN_OUT) => SourceKind::Streak,
            Some(_) => SourceKind::Other,
        };
        let (place_px, trail_px) = (candidate.place_px.to_array(), candidate.trail_px.to_array());
        Self { kind, place_px, trail_px }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct PlaneView {
    colour: String,
    rate_adu_per_s: Option<f64>,
    sigma_adu_per_s: Option<f64>,
    background_adu: Option<f64>,
    flags: Vec<String>,
}

/// Finds and measures the target of a frame as the reduction does with the station's usual options, but without dark frames and with an aperture of 8 px.
pub(crate) fn marks(
    frame: &Frame,
    station: &Station,
    start: Epoch,
    more: More,
) -> Result<MarksView, Answer> {
    let wrong = |text: &str| Answer::error(422, text);
    let options = FrameOptions::for_station(station)
        .ok_or_else(|| wrong("the station of this session has no camera"))?;
    let (aperture_px, annulus_px) =
        (options.photometry.aperture_radius_px, options.photometry.annulus_px.to_array());
    let said = |error: PhotometryError| wrong(&error.to_string());
    let mut wide = options.photometry.clone();
    let mut reducer =
        FrameReducer::new(options.photometry, FrameCalibration::default()).map_err(said)?;
    let measured = reducer.measure(frame, &Expected::default()).map_err(said)?;
    let finite = |value: f64| value.is_finite().then_some(value);
    let planes = measured.planes.iter().map(|plane| PlaneView {
        colour: format!("{:?}", plane.colour).to_lowercase(),
        rate_adu_per_s: finite(plane.rate_adu_per_s),
        sigma_adu_per_s: finite(plane.sigma.total()),
        background_adu: finite(plane.background_adu),
        flags: names(plane.flags),
    });
    let (sources, sources_left_out) = match more.sources {
        false => (None, None),
        true => {
            // The brightest of all can only be told when all are looked at.
            wide.detection.choice = Choice::Brightest;
            let mut reducer = FrameReducer::new(wide, FrameCalibration::default()).map_err(said)?;
            let found = reducer.detect(frame, &Expected::default()).map_err(said)?;
            let rays = found.cosmic_ray_px.iter().map(|place| SourceView {
                kind: SourceKind::Sharp,
                place_px: place.to_array(),
                trail_px: [0.0; 2],
            });
            let left_out = (found.candidates.len() + rays.len()).saturating_sub(SOURCES);
            let all = found.candidates.iter().map(SourceView::of).chain(rays);
            (Some(all.take(SOURCES).collect()), (left_out > 0).then_some(left_out))
        }
    };
    let (rows, columns) = frame.pixels.dim();
    Ok(MarksView {
        sharp: more.sharpness,
        hfr_px: more
            .sharpness
            .then(|| sharpness(&middle(frame)))
            .flatten()
            .map(|found| found.hfr_px),
        expected_px: [columns, rows].map(|n| 0.5 * (n as f64 - 1.0)),
        sources,
        sources_left_out,
        start_s: (frame.start - start).to_seconds(),
        place_px: measured.place_px.map(|place| place.to_array()),
        aperture_px,
        annulus_px,
        fwhm_px: measured.fwhm_px,
        candidates: measured.candidates,
        planes: planes.collect(),
    })
}

impl MarksView {
    /// Focus and background of the frame.
    pub fn look(&self) -> Look {
        let background_adu = self.planes.iter().find_map(|plane| plane.background_adu);
        let Self { start_s, fwhm_px, hfr_px, .. } = *self;
        Look { start_s, fwhm_px, hfr_px, sharp: self.sharp, background_adu }
    }
}

/// Focus and background of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    /// Start of the frame, s after the session's start.
    pub start_s: f64,
    /// Width of the target at half of its height, px.
    pub fwhm_px: Option<f64>,
    /// Half-flux radius of the frame's stars, px.
    pub hfr_px: Option<f64>,
    /// Whether it was looked for: not in each frame.
    pub sharp: bool,
    /// Background of a pixel, ADU, of the first colour.
    pub background_adu: Option<f64>,
}

/// The middle of a frame, as much of it as the half-flux radius is looked for in: a large frame would take seconds and hundreds of megabytes.
fn middle(frame: &Frame) -> Frame {
    let (rows, columns) = frame.pixels.dim();
    // An even first pixel keeps the mosaic.
    let cut = |n: usize| {
        let first = (n.saturating_sub(SHARP_PX) / 2) & !1;
        first..n.min(first + SHARP_PX)
    };
    Frame {
        pixels: frame.pixels.slice(ndarray::s![cut(rows), cut(columns)]).to_owned(),
        header: Header::default(),
        ..*frame
    }
}

/// Names of flags.
fn names(flags: Flags) -> Vec<String> {
    flags.iter_names().map(|(name, _)| name.to_lowercase()).collect()
}
