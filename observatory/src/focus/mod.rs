//! Focus: the half-flux radius of stars against the focuser's position, and the position at which it is least.
//!
//! - [`star`]: the half-flux radius of a frame's stars;
//! - [`curve`]: a hyperbola or a parabola through the points, its lowest point with an interval, and when there is none;
//! - [`run`]: the focuser goes from place to place, always from the same side, and to the best at the end;
//! - [`drift`]: how the best position follows the temperature, from several runs.

pub mod curve;
pub mod drift;
pub mod run;
pub mod star;
