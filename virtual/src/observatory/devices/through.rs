//! The night behind the simulated devices of the drivers, which speak the real ones' protocols.

use super::VirtualObservatory;
use crate::observatory::frame::Exposure;
use crate::observatory::watch::Watch;
use ndarray::Array2;
use sunglint_drivers::simulated::indi::{Scene, Shot};
use sunglint_drivers::simulated::swabian::Light;
use sunglint_drivers::tags::Tag;

/// The steps in which light is steady between tags, ps: a millisecond.
const STEP_PS: i64 = 1_000_000_000;

/// View of a night through the simulated camera of an INDI server.
#[derive(Debug, Clone)]
pub struct ThroughScene(Watch);

impl ThroughScene {
    /// Makes the view of a night; shots are placed in it by their UTC.
    pub fn new(observatory: &VirtualObservatory) -> Self {
        Self(Watch::new(observatory.night().clone()))
    }
}

impl Scene for ThroughScene {
    fn frame(&mut self, shot: &Shot) -> Array2<u16> {
        let window = shot.window;
        let exposure = Exposure {
            origin_px: window.origin_px,
            size_px: window.size_px,
            binning: window.binning,
            exposure_s: shot.exposure_s,
        };
        let start_s = self.0.night().seconds(shot.start);
        let frame = self.0.frame(&exposure, start_s);
        let [columns, rows] = shot.size();
        frame.map_or_else(|| Array2::zeros((rows as usize, columns as usize)), |(frame, _)| frame)
    }
}

/// Light of a night for the simulated Time Tagger: its input 1 has the first counter of the station, 2 the second. Its bins are
/// its tags, counted photon by photon.
#[derive(Debug, Clone)]
pub struct ThroughLight {
    watch: Watch,
    counters: Vec<usize>,
    zero_ps: i64,
}

impl ThroughLight {
    /// Makes the light of a night, on a clock that shows zero so long after the night's begin, ps.
    pub fn new(observatory: &VirtualObservatory, zero_ps: i64) -> Self {
        let watch = Watch::new(observatory.night().clone());
        let counters = watch.counters();
        Self { watch, counters, zero_ps }
    }

    fn counter(&self, input: i32) -> Option<usize> {
        let place = usize::try_from(input).ok()?.checked_sub(1)?;
        self.counters.get(place).copied()
    }
}

impl Light for ThroughLight {
    fn tags(&mut self, channels: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
        let begun = into.len();
        let span = from_ps + self.zero_ps..to_ps + self.zero_ps;
        for input in channels {
            let Some(counter) = self.counter(*input) else { continue };
            let times = self.watch.tags(counter, span.clone(), STEP_PS);
            into.extend(times.into_iter().map(|time| Tag::photon(*input, time - self.zero_ps)));
        }
        into[begun..].sort_by_key(|tag| tag.time_ps);
    }
}
