//! The telescope follows: from the path of a target to a mount that tracks, within limits that keep it off the Sun.
//!
//! - [`TargetPath`]: where a target stands, in the axes of a mount;
//! - [`PassPlan`]: slew, flip, keyhole, distance from the Sun, before anything moves;
//! - [`Guard`]: what a mount may point at, and which ways it may take;
//! - [`Tracker`]: feed-forward of place and rate, an estimator of the target's error along and across its track, search and coasting;
//! - [`Goto`]: a place on the sky, corrected by where the frames look;
//! - [`PointingModel`]: how a mount that is not set up perfectly shows directions;
//! - [`Orders`]: what a person asks of it meanwhile;
//! - [`WeatherFile`]: whether the sky is fit for an open telescope, by a file;
//! - [`watchdog`]: stops the mount when the tracker dies.

mod estimate;
mod goto;
mod hold;
mod model;
mod park;
mod path;
mod pier;
mod plan;
mod safety;
mod search;
mod sense;
mod steer;
mod tracker;
pub mod watchdog;
mod weather;

pub use estimate::EstimatorOptions;
pub use goto::{
    CameraAxes, Gone, Goto, GotoError, GotoOptions, GotoTarget, Look, Looks, OWN_ARCSEC,
};
pub use model::{
    ModelError, PointingFit, PointingModel, PointingPlace, PointingTerm, fit_pointing, places_of,
    places_table,
};
pub use park::{PARK_WITHIN, Parked, park};
pub use path::{Frame, PathError, Place, TargetPath, angles, direction};
pub(crate) use plan::ripple_arcsec;
pub use plan::{Keyhole, PassPlan};
pub use safety::{Certainty, Danger, Guard, SunCone, SunNow, sun};
pub use search::{Glance, Light, Lights, SearchOptions};
pub use steer::{Order, Orders};
pub use tracker::{TrackError, TrackOptions, TrackState, TrackStep, TrackSummary, Tracker};
pub use weather::{Weather, WeatherFile};
