//! A detector's dead time from a plan: the light's steps, which are measured in turns, and the law that is found in their counts.
//!
//! Steps are slots of a filter wheel with neutral-density filters of known or unknown transmission, levels those of a source; two sources are measured alone and together. Every step is
//! measured `repeats` times, each time through all steps in turn, so that a source that drifts is seen as scatter and not as a bend.

mod line;
mod measure;
mod plan;
mod result;

pub use line::{Begun, FILES, Line, Log, PLAN, VIRTUAL_RIG};
pub use measure::{Rig, done, measure};
pub use plan::{LinearityPlan, Place, PlanError, SourcePlan, places};
pub use result::{LAW, LINEARITY, exposures, law_toml, table_csv};
