//! Times of frames: measured latencies are taken off, and what is left of doubt is told.

use crate::photometry::FrameMeasurement;
use crate::timing::{CameraTiming, JITTER, SYSTEMATIC, Timings};
use sunglint_formats::Frame;

/// Doubts below this are not told, s.
const LEAST_S: f64 = 1e-6;

/// Doubt of frames' times.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TimeDoubt {
    /// Largest standard uncertainty of a frame's times, s; `None` where no frame says one.
    pub sigma_s: Option<f64>,
    /// Frames from whose times a measured latency was taken off.
    pub corrected: usize,
    /// Frames without a measured latency.
    pub uncorrected: usize,
}

impl TimeDoubt {
    /// A sentence for the provenance; `None` where nothing is known.
    pub fn note(&self, camera: &str) -> Option<String> {
        // A camera of virtual time has none.
        let sigma_s = self.sigma_s.filter(|sigma_s| *sigma_s > LEAST_S)?;
        let sure = format!("times are sure to {sigma_s:.1e} s (1 σ)");
        Some(match (self.corrected, self.uncorrected) {
            (0, _) => {
                format!("camera {camera}: {sure}: its latency is not measured (sunglint timing)")
            }
            (_, 0) => format!("camera {camera}: its measured latency is taken off; {sure}"),
            (corrected, left) => format!(
                "camera {camera}: the measured latency is taken off {corrected} frames, not off {left} of another binning or clock; {sure}"
            ),
        })
    }
}

/// Takes measured latencies off frames' times.
#[derive(Debug)]
pub(super) struct Times<'a> {
    timings: Option<&'a Timings>,
    camera: &'a str,
    pub of_stay: Vec<TimeDoubt>,
}

impl<'a> Times<'a> {
    pub fn new(timings: Option<&'a Timings>, camera: &'a str, stays: usize) -> Self {
        Self { timings, camera, of_stay: vec![TimeDoubt::default(); stays] }
    }

    /// Takes the camera's latency off a frame's begin, where it was measured. Gives the time of a row, s.
    pub fn take(&mut self, frame: &mut Frame, stay: usize) -> f64 {
        let timing = self.timings.and_then(|timings| timings.correct(self.camera, frame));
        let doubt = &mut self.of_stay[stay];
        match timing {
            Some(_) => doubt.corrected += 1,
            None => doubt.uncorrected += 1,
        }
        let said = [SYSTEMATIC, JITTER].map(|keyword| frame.header.real(keyword));
        if said.iter().any(Option::is_some) {
            let [systematic, jitter] = said.map(|sigma_s| sigma_s.unwrap_or(0.0));
            let sigma_s = systematic.hypot(jitter);
            doubt.sigma_s = Some(doubt.sigma_s.map_or(sigma_s, |most| most.max(sigma_s)));
        }
        timing.and_then(|timing| timing.row_time_s).map_or(0.0, |time| time.value)
    }

    /// Says that measured times were given and fit no frame of some.
    pub fn warning(&self) -> Option<String> {
        let timings = self.timings?;
        let left: usize = self.of_stay.iter().map(|doubt| doubt.uncorrected).sum();
        (left > 0).then(|| {
            let known: Vec<String> = timings.cameras.iter().map(CameraTiming::name).collect();
            format!(
                "camera {}: {left} frames keep their own times: {} has {}",
                self.camera,
                timings.path.display(),
                known.join(", ")
            )
        })
    }
}

/// Moves a measurement to the time of its target's row; without a target to that of the middle one.
pub(super) fn move_to_row(measured: &mut FrameMeasurement, frame: &Frame, row_time_s: f64) {
    let row_px = measured.place_px.map_or(0.5 * frame.pixels.nrows() as f64, |place| place.y);
    let later = hifitime::Duration::from_seconds(row_time_s * row_px);
    measured.time += later;
    measured.track.time += later;
}
