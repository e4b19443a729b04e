//! Results as people read them: text, figures, tables, JSON and pages. No algorithm, no file is read here.
//!
//! - [`air`]: what the atmosphere leaves of a direct beam;
//! - [`mod@bench`]: error against time of the light engines;
//! - [`brdf`]: a sample on a goniometer;
//! - [`endmembers`]: the spectra that a curve is made of;
//! - [`explain`]: what a scene needs;
//! - [`fold`]: folded curves;
//! - [`mod@map`]: maps on the frame of a body;
//! - [`mod@period`]: the period of curves;
//! - [`passes`]: passes that can be seen;
//! - [`picture`]: pictures, reflection maps, spheres;
//! - [`session`]: what of a recorded night is there;
//! - [`simulate`]: simulated passes, laser returns;
//! - [`star`]: a star through time;
//! - [`tables`]: the embedded tables;
//! - [`mod@unmix`]: materials in the light of a curve;
//! - [`attitude`]: how a body of known shape spins;
//! - [`compare`]: a measured pass beside the simulated one;
//! - [`fit`]: measured passes fitted by simulated ones;
//! - [`plot`]: figures as PNG or SVG;
//! - [`page`]: pages as HTML;
//! - [`Product`]: a result in all its forms;
//! - [`rounded`]: numbers as summaries hold them.

pub mod air;
pub mod bench;
pub mod brdf;
pub mod endmembers;
pub mod explain;
pub mod fold;
mod inputs;
pub mod attitude;
pub mod compare;
pub mod fit;
mod lines;
pub mod map;
mod numbers;
pub mod page;
pub mod passes;
pub mod period;
pub mod picture;
pub mod plot;
mod product;
pub mod session;
pub mod simulate;
pub mod star;
pub mod tables;
pub mod unmix;

pub use lines::channel_line;
pub use numbers::rounded;
pub use product::{Format, Product, ProductError};
