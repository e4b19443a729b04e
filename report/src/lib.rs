//! Results as people read them: text, figures, tables, JSON and pages. No algorithm, no file is read here.
//!
//! - [`attitude`]: how a body of known shape spins;
//! - [`compare`]: a measured pass beside the simulated one;
//! - [`explain`]: what a scene needs;
//! - [`fit`]: measured passes fitted by simulated ones;
//! - [`plot`]: figures as PNG or SVG;
//! - [`page`]: pages as HTML;
//! - [`Product`]: a result in all its forms;
//! - [`rounded`]: numbers as summaries hold them.

pub mod attitude;
pub mod compare;
pub mod explain;
pub mod fit;
mod lines;
mod numbers;
pub mod page;
pub mod plot;
mod product;

pub use lines::channel_line;
pub use numbers::rounded;
pub use product::{Format, Product, ProductError};
