//! All tests of this crate: one program, so that one is linked.

mod few_rates;
mod focus;
mod goto;
mod mounting;
mod planner;
mod safety;
mod sequence;
mod shadow;
mod tracking;
