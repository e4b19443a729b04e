//! Settings that a visit asks of cameras, wheels and rotators in place of what the plan says of the devices.

use super::plan::CameraPlan;
use serde::Deserialize;
use std::collections::BTreeMap;
use sunglint_formats::session::TargetKind;
use sunglint_formats::toml::{Finite, Positive};

/// Settings of a camera during a visit; what is not given is as the `[[camera]]` has it.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct CameraSetup {
    /// Exposure, s; of a flat with a level the first one.
    #[serde(default)]
    pub exposure_s: Option<Positive>,
    /// Time from the start of one exposure to that of the next, s.
    #[serde(default)]
    pub interval_s: Option<Positive>,
    /// First column and row, columns and rows of the sensor, unbinned px.
    #[serde(default)]
    pub window_px: Option<[u32; 4]>,
    /// Sensor pixels in one of the frame, along each side.
    #[serde(default)]
    pub binning: Option<u32>,
    /// Gain in the camera's own steps.
    #[serde(default)]
    pub gain: Option<Finite>,
    /// The filter before it.
    #[serde(default)]
    pub filter: Option<String>,
    /// Frames after which the camera has done its part.
    #[serde(default)]
    pub frames: Option<u32>,
    /// Median that the exposures of flats are made to reach, ADU.
    #[serde(default)]
    pub level_adu: Option<Positive>,
}

impl CameraSetup {
    /// These settings over others.
    fn over(&self, base: &Self) -> Self {
        Self {
            exposure_s: self.exposure_s.or(base.exposure_s),
            interval_s: self.interval_s.or(base.interval_s),
            window_px: self.window_px.or(base.window_px),
            binning: self.binning.or(base.binning),
            gain: self.gain.or(base.gain),
            filter: self.filter.clone().or_else(|| base.filter.clone()),
            frames: self.frames.or(base.frames),
            level_adu: self.level_adu.or(base.level_adu),
        }
    }
}

/// A step of a visit: one setting of all instruments. A visit with three filters has three.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Step {
    /// Number of the step in the plan, from 1 on.
    pub number: u32,
    /// Whether the visit had a step before this one.
    pub continues: bool,
    /// Settings for all cameras.
    pub all: CameraSetup,
    /// Settings for one camera, by its name.
    pub cameras: BTreeMap<String, CameraSetup>,
    /// Angle of the rotators, degrees.
    pub rotator_deg: Option<f64>,
    /// Brightness that is expected of a satellite: V at 1,000 km, half lit. Nothing is observed by it.
    pub standard_magnitude: Option<f64>,
}

/// How a camera takes frames at a time of the night.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposing {
    /// The camera, with the settings of the moment.
    pub plan: CameraPlan,
    /// `light`, `dark`, `bias` or `flat`, as drivers call it.
    pub frame_type: &'static str,
    /// Frames after which it has done its part.
    pub frames: Option<u32>,
    /// Median that the exposures are made to reach, ADU.
    pub level_adu: Option<f64>,
}

impl Exposing {
    /// The camera at a target, in a step of the plan.
    pub fn of(plan: &CameraPlan, kind: Option<TargetKind>, step: Option<&Step>) -> Self {
        let frame_type = match kind {
            Some(TargetKind::Dark) => "dark",
            Some(TargetKind::Bias) => "bias",
            Some(TargetKind::Flat) => "flat",
            _ => "light",
        };
        let mut now = Self { plan: plan.clone(), frame_type, frames: None, level_adu: None };
        let Some(step) = step else { return now };
        let setup = match step.cameras.get(&plan.name) {
            Some(own) => own.over(&step.all),
            None => step.all.clone(),
        };
        let plan = &mut now.plan;
        plan.exposure_s = setup.exposure_s.unwrap_or(plan.exposure_s);
        // The camera's own interval may be shorter than the visit's exposure.
        plan.interval_s = setup
            .interval_s
            .or(plan.interval_s)
            .filter(|interval| interval.get() >= plan.exposure_s.get());
        plan.window_px = setup.window_px.or(plan.window_px);
        plan.binning = setup.binning.or(plan.binning);
        plan.gain = setup.gain.or(plan.gain);
        plan.filter = setup.filter.or_else(|| plan.filter.clone());
        now.frames = setup.frames;
        now.level_adu = setup.level_adu.map(Positive::get);
        now
    }
}
