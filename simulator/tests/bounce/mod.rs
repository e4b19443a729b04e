//! Inter-reflected light: against another renderer, rays of the test's own, closed forms, and the laws that it must keep.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod forms;
mod laws;
mod lobes;
mod rays;
mod scenes;
mod shapes;
mod stored;
