//! A detector's efficiency from a plan: what is read at each wavelength, in which order, and the tables that are made of it.
//!
//! At each wavelength the photodiode is read before, between and after the sensor's exposures, so that a lamp that drifts steadily drifts alike for both. Dark readings come first, last and
//! every so many wavelengths; the photodiode's dark voltage is drawn as a line in time between them. A reference wavelength tells whether the rig itself changed, which is then undone. What is written is what
//! `sunglint efficiency RUN.toml` reads.

mod drift;
mod line;
mod measure;
mod plan;
mod tables;
mod visits;

pub use drift::{Change, Drift, Point, Step};
pub use line::{Begun, FILES, Line, Log, PLAN, Part, VIRTUAL_RIG, What};
pub use measure::{Rig, done, measure};
pub use plan::{CounterPlan, DarkBy, MeterPlan, Order, PlanError, RunPlan, Unit};
pub use tables::{Made, RUN, TableError, make, write};
pub use visits::{Visit, visits};
