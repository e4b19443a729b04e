//! Options of the engine, and known facts about the target's trajectory.

use crate::light::{Analyser, EarthAlbedo};
use glam::DVec3;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

/// Whether an effect is modelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    /// Where its bound exceeds the tolerance.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never: its bound enters the stated error.
    Off,
}

/// The switches of the effects that have one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Switches {
    /// The size of the Sun's disc.
    pub solar_disc: Switch,
    /// Light that is reflected more than once.
    pub inter_reflection: Switch,
    /// Light from the Earth.
    pub earthshine: Switch,
    /// Light from the Moon.
    pub moonshine: Switch,
    /// That the lines of sight to a body's parts are not parallel.
    pub finite_distance: Switch,
    /// Polariser before the observer of light between surfaces, for whoever wants its polarisation; none otherwise. With one, what is left out is in no error.
    pub analyser: Option<Analyser>,
}

impl Switches {
    /// Direct sunlight alone: parallel light of a point, scattered once, seen from afar.
    pub const OFF: Self = Self {
        solar_disc: Switch::Off,
        inter_reflection: Switch::Off,
        earthshine: Switch::Off,
        moonshine: Switch::Off,
        finite_distance: Switch::Off,
        analyser: None,
    };
}

/// Options of the engine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// An effect that may change the light by more than this, relative, is modelled.
    pub tolerance: f64,
    /// Effects that are switched on or off.
    pub switches: Switches,
    /// The work that an epoch's light between surfaces may cost, CPU seconds of a usual core ([`check_budget`]). It is spent as patches and light paths
    /// that are counted, not timed, so that results do not depend on the machine.
    pub budget_s: f64,
}

impl Default for Options {
    fn default() -> Self {
        let (tolerance, budget_s) = (Options::TOLERANCE, Options::BUDGET_S);
        Self { tolerance, switches: Switches::default(), budget_s }
    }
}

impl Options {
    /// The tolerance unless another is asked for: 0.1 %.
    pub const TOLERANCE: f64 = 1e-3;
    /// The budget of an epoch unless another is asked for, s.
    pub const BUDGET_S: f64 = 0.01;
    /// Light paths that a budget of a second holds.
    const PATHS_PER_S: f64 = 409_600.0;

    /// Whether an effect with this bound is to be modelled.
    pub fn needs(&self, switch: Switch, bound: f64) -> bool {
        match switch {
            Switch::Auto => bound > self.tolerance,
            Switch::On => true,
            Switch::Off => false,
        }
    }

    /// Light paths of an epoch at most.
    pub fn paths(&self) -> u32 {
        // A float becomes the nearest number that there is.
        (Self::PATHS_PER_S * self.budget_s).round() as u32
    }

    /// Returns what decided about the effect, in words.
    pub fn reason(switch: Switch) -> &'static str {
        match switch {
            Switch::Auto => "",
            Switch::On => " (switched on)",
            Switch::Off => " (switched off)",
        }
    }
}

/// A tolerance that is none.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the tolerance is {0}, expected a relative error from 1e-9 to 0.1 (10 %), such as 0.002 or 0.2 %"
)]
pub struct WrongTolerance(pub f64);

/// A tolerance, if it is one.
///
/// # Errors
/// A value that is not a number from 1e-9 to 0.1.
pub fn check_tolerance(tolerance: f64) -> Result<f64, WrongTolerance> {
    if (1e-9..=0.1).contains(&tolerance) { Ok(tolerance) } else { Err(WrongTolerance(tolerance)) }
}

/// A budget that is none.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the budget of an epoch is {0} s, expected 0.0001 to 100 s of CPU time, such as 0.01 or 1")]
pub struct WrongBudget(pub f64);

/// A budget of an epoch's light between surfaces, s, if it is one.
///
/// # Errors
/// A value that is not a number from 1e-4 to 100.
pub fn check_budget(budget_s: f64) -> Result<f64, WrongBudget> {
    if (1e-4..=100.0).contains(&budget_s) { Ok(budget_s) } else { Err(WrongBudget(budget_s)) }
}

/// Known facts about the trajectory of a target. [`Course::default`] knows nothing, and takes the worst that an orbit has.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// Epochs; 0 where they are not known.
    pub epochs: usize,
    /// Geometries that differ.
    pub geometries: usize,
    /// The least distance of the observer, m.
    pub range_m: f64,
    /// The least and the largest distance from the middle of the Earth, m.
    pub radius_m: (f64, f64),
    /// The largest angular radius of the Sun, radians.
    pub sun_radius_rad: f64,
    /// The largest phase angle, Sun–target–observer, radians.
    pub phase_rad: f64,
    /// The largest irradiance by the Earth on a surface of the target, of that of the Sun; see [`super::Seen::earth`].
    pub earthshine: f64,
    /// Whether there is a Moon, which may stand anywhere where [`Lighting::moon`](crate::light::Lighting::moon) says nothing.
    pub moon: bool,
    /// Epochs in penumbra.
    pub penumbra: usize,
    /// Epochs in umbra.
    pub umbra: usize,
    /// Whether the Earth's shadow counts at all.
    pub shadow: bool,
    /// Directions that occur; none where they are not known.
    pub aspects: Aspects,
}

/// Directions to the Sun and to the observer, body axes: of all that occur, each once, no more than a thousand, whichever the order in which they came.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Aspects {
    /// By a number that is drawn from the directions: the least of these are kept.
    kept: BTreeMap<u64, [DVec3; 2]>,
}

impl Aspects {
    /// No more are kept.
    const MOST: usize = 1000;

    /// Adds a pair of unit vectors.
    pub fn add(&mut self, sun: DVec3, observer: DVec3) {
        // With the same keys in every run, so that the same are kept.
        let mut hasher = DefaultHasher::new();
        for x in [sun, observer].into_iter().flat_map(|d| d.to_array()) {
            x.to_bits().hash(&mut hasher);
        }
        self.keep(hasher.finish(), [sun, observer]);
    }

    /// Adds all of others.
    pub fn join(&mut self, others: &Self) {
        others.kept.iter().for_each(|(number, pair)| self.keep(*number, *pair));
    }

    fn keep(&mut self, number: u64, pair: [DVec3; 2]) {
        let full = self.kept.len() >= Self::MOST;
        if full && self.kept.last_key_value().is_some_and(|(last, _)| *last <= number) {
            return;
        }
        self.kept.insert(number, pair);
        if self.kept.len() > Self::MOST {
            self.kept.pop_last();
        }
    }

    /// The pairs: Sun, observer.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [DVec3; 2]> {
        self.kept.values().copied()
    }
}

impl Default for Course {
    fn default() -> Self {
        Self {
            epochs: 0,
            geometries: 0,
            range_m: 1.5e5,
            radius_m: (6.378_137e6 + 1.5e5, f64::INFINITY),
            // At perihelion: asin(R☉/0.9833 au).
            sun_radius_rad: 4.731e-3,
            // Beyond it a target is seen before the Sun's own glare.
            phase_rad: 170.0_f64.to_radians(),
            earthshine: EarthAlbedo::default().most(),
            moon: true,
            penumbra: 0,
            umbra: 0,
            shadow: true,
            aspects: Aspects::default(),
        }
    }
}
