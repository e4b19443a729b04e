//! PLAN.toml of a linearity run.

use crate::efficiency::CounterPlan;
use serde::Deserialize;
use std::path::PathBuf;
use sunglint_calibration::detector::fit::{Light, Transmission};
use sunglint_formats::toml::{Document, Fraction, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError};

/// Why a file is no plan of a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Values that no run can have, with line and key.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
}

const VIRTUAL: &str = "virtual";
/// Exposures that a run takes.
const MOST: usize = 1_000_000;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    name: Option<String>,
    #[serde(default, rename = "virtual")]
    virtual_rig: Option<PathBuf>,
    scan: Scan,
    #[serde(default)]
    counter: CounterPlan,
    #[serde(default)]
    wheel: Option<WheelPlan>,
    #[serde(default)]
    source: Vec<SourcePlan>,
    #[serde(default)]
    detector: Option<DetectorPlan>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Scan {
    exposure_s: Positive,
    repeats: u32,
    #[serde(default = "yes")]
    dark: bool,
}

fn yes() -> bool {
    true
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct DetectorPlan {
    pixels: u32,
}

/// The filter wheel in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelPlan {
    /// Address of the device in the catalogue of drivers.
    #[serde(default = "virtual_address")]
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// Wait after a turn, s.
    #[serde(default)]
    pub settle_s: Option<NonNegative>,
    /// How long a turn may take, s.
    #[serde(default)]
    pub timeout_s: Option<Positive>,
    /// Neutral-density filters.
    #[serde(rename = "step")]
    pub steps: Vec<Step>,
}

fn virtual_address() -> String {
    VIRTUAL.into()
}

/// A slot of the wheel and what is known of its filter.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Slot, from 1.
    pub slot: u32,
    /// Optical density, where it is known.
    #[serde(default)]
    pub optical_density: Option<NonNegative>,
    /// Transmission, where that is known.
    #[serde(default)]
    pub transmission: Option<Fraction>,
    /// Relative standard uncertainty of the transmission.
    #[serde(default)]
    pub relative_sigma: Option<NonNegative>,
}

/// A source of light in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourcePlan {
    /// Address of the device in the catalogue of drivers.
    #[serde(default = "virtual_address")]
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// Levels at which it is measured, in its unit; as it stands without.
    #[serde(default)]
    pub levels: Vec<NonNegative>,
    /// Wait after a change, s.
    #[serde(default)]
    pub settle_s: Option<NonNegative>,
    /// How long a change may take, s.
    #[serde(default)]
    pub timeout_s: Option<Positive>,
}

/// A light that is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Slot of the wheel, where there is one.
    pub slot: Option<u32>,
    /// Number of the level of each source that is on; none where it is off.
    pub levels: Vec<Option<usize>>,
    /// Lights, as the fit has them; none in the dark.
    pub lights: Vec<Light>,
}

/// A run as it is planned.
#[derive(Debug, Clone)]
pub struct LinearityPlan {
    /// Name of the detector.
    pub name: String,
    /// The counter.
    pub counter: CounterPlan,
    /// The filter wheel.
    pub wheel: Option<WheelPlan>,
    /// Sources.
    pub sources: Vec<SourcePlan>,
    /// Pixels of the detector, where it has many.
    pub pixels: Option<u32>,
    /// Length of an exposure, s.
    pub exposure_s: f64,
    /// Times that each light is measured.
    pub repeats: u32,
    /// Whether the dark is measured, with all sources off.
    pub dark: bool,
    /// The file's text.
    pub source: String,
    /// The file of a virtual rig that stands in for the devices.
    pub rig: Option<Document>,
}

impl LinearityPlan {
    /// A plan from its document; `rig` is the text of the virtual rig where it does not come from the file that is named.
    ///
    /// # Errors
    /// Values that no run can have, with line and key.
    pub fn new(document: &Document, rig: Option<&str>) -> Result<Self, PlanError> {
        let written: Written = document.parse()?;
        let wrong =
            |key: &str, expected: &str| -> PlanError { document.error_at(key, expected).into() };
        if !(2..=10_000).contains(&written.scan.repeats) {
            return Err(wrong("scan.repeats", "2 to 10000: once alone tells no scatter"));
        }
        if !(1e-5..=3600.0).contains(&written.scan.exposure_s.get()) {
            return Err(wrong("scan.exposure_s", "a time from 1e-5 to 3600 s"));
        }
        let wheel = written.wheel.as_ref();
        if !(1..=2).contains(&written.source.len()) {
            return Err(wrong(
                "source",
                "one [[source]], or two that are measured alone and together",
            ));
        }
        let steps = wheel.map_or(&[][..], |wheel| &wheel.steps[..]);
        if wheel.is_some() && steps.is_empty() {
            return Err(wrong("wheel.step", "a [[wheel.step]] for each slot that is used"));
        }
        for step in steps {
            if step.slot == 0 {
                return Err(wrong("wheel.step", "slots from 1"));
            }
            if step.optical_density.is_some() && step.transmission.is_some() {
                return Err(wrong("wheel.step", "one of optical_density and transmission"));
            }
            if step.transmission.is_some_and(|t| t.get() <= 0.0) {
                return Err(wrong("wheel.step", "a transmission above 0"));
            }
        }
        for source in &written.source {
            if source.levels.iter().any(|level| level.get() == 0.0) {
                return Err(wrong(
                    "source.levels",
                    "levels above 0: the dark is measured by scan.dark",
                ));
            }
        }
        let devices = [("counter.device", Some(&written.counter.device))]
            .into_iter()
            .chain([("wheel.device", wheel.map(|w| &w.device))])
            .chain(written.source.iter().map(|s| ("source.device", Some(&s.device))));
        for (key, device) in devices {
            let Some(device) = device else { continue };
            if (device == VIRTUAL) != written.virtual_rig.is_some() {
                let expected = match written.virtual_rig {
                    Some(_) => "`virtual`, as the file names a virtual rig",
                    None => {
                        "an address (sunglint devices list --drivers), or virtual = \"rig.toml\" for the whole rig"
                    }
                };
                return Err(wrong(key, expected));
            }
        }
        let rig = match (&written.virtual_rig, rig) {
            (None, _) => None,
            (Some(path), Some(text)) => Some(Document::new(document.resolve(path), text)?),
            (Some(path), None) => Some(Document::read(document.resolve(path))?),
        };
        let stem = document.path().file_stem().unwrap_or_default().to_string_lossy();
        let plan = Self {
            name: written.name.unwrap_or_else(|| stem.into_owned()),
            counter: written.counter,
            wheel: written.wheel,
            sources: written.source,
            pixels: written.detector.map(|detector| detector.pixels),
            exposure_s: written.scan.exposure_s.get(),
            repeats: written.scan.repeats,
            dark: written.scan.dark,
            source: document.source().to_owned(),
            rig,
        };
        if plan.pixels == Some(0) {
            return Err(wrong("detector.pixels", "at least 1"));
        }
        if places(&plan).len().saturating_mul(plan.repeats as usize) > MOST {
            return Err(wrong("scan.repeats", "at most 1000000 exposures in all"));
        }
        Ok(plan)
    }

    /// Transmissions of the steps, as the fit has them.
    #[must_use]
    pub fn transmissions(&self) -> Vec<Transmission> {
        let Some(wheel) = &self.wheel else {
            return vec![Transmission::Known { value: 1.0, relative_sigma: 0.0 }];
        };
        let of = |step: &Step| {
            let density = step.optical_density.map(|d| 10_f64.powf(-d.get()));
            match density.or(step.transmission.map(Fraction::get)) {
                Some(value) => Transmission::Known {
                    value,
                    relative_sigma: step.relative_sigma.map_or(0.0, NonNegative::get),
                },
                None => Transmission::Unknown,
            }
        };
        wheel.steps.iter().map(of).collect()
    }

    /// Whether this measures the same as another plan.
    #[must_use]
    pub fn same(&self, other: &Self) -> bool {
        let key = |p: &Self| (p.exposure_s, p.repeats, p.counter.clone(), p.sources.clone());
        let slots = |p: &Self| {
            let wheel = p.wheel.clone();
            wheel.map(|w| (w.device, w.with, w.steps.iter().map(|s| s.slot).collect::<Vec<_>>()))
        };
        key(self) == key(other) && slots(self) == slots(other) && self.dark == other.dark
    }
}

/// All lights of a plan, the dark first. Each is measured once in each repeat.
#[must_use]
pub fn places(plan: &LinearityPlan) -> Vec<Place> {
    let off = vec![None; plan.sources.len()];
    let slots: Vec<Option<u32>> = match &plan.wheel {
        Some(wheel) => wheel.steps.iter().map(|step| Some(step.slot)).collect(),
        None => vec![None],
    };
    let mut all = Vec::new();
    if plan.dark {
        all.push(Place { slot: None, levels: off.clone(), lights: vec![] });
    }
    let counts: Vec<usize> = plan.sources.iter().map(|s| s.levels.len().max(1)).collect();
    let first = counts.first().copied().unwrap_or(1);
    let place = |slot, step: usize, on: &[(usize, usize)]| {
        let mut levels = off.clone();
        let mut lights = Vec::new();
        for (source, level) in on {
            levels[*source] = Some(*level);
            // The second source's levels follow those of the first.
            lights.push(Light { level: if *source == 0 { *level } else { first + level }, step });
        }
        Place { slot, levels, lights }
    };
    for (step, slot) in slots.iter().enumerate() {
        for level in 0..counts.iter().copied().max().unwrap_or(1) {
            let has = |source: usize| counts.get(source).is_some_and(|n| level < *n);
            if has(0) {
                all.push(place(*slot, step, &[(0, level)]));
            }
            if has(1) {
                all.push(place(*slot, step, &[(1, level)]));
            }
            if has(0) && has(1) {
                all.push(place(*slot, step, &[(0, level), (1, level)]));
            }
        }
    }
    all
}
