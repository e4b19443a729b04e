//! Results as people read them: text, figures, tables, JSON and pages. No algorithm, no file is read here.
//!
//! - [`align`]: the fields of the fibres on the camera image;
//! - [`apply`]: a calibrated light curve;
//! - [`calibrate`]: nights calibrated from stars;
//! - [`efficiency`]: a detector's efficiency;
//! - [`explain`]: what a scene needs;
//! - [`mod@reduce`]: a night's reduction;
//! - [`plot`]: figures as PNG or SVG;
//! - [`page`]: pages as HTML;
//! - [`Product`]: a result in all its forms;
//! - [`rounded`]: numbers as summaries hold them.

pub mod align;
pub mod apply;
pub mod calibrate;
pub mod efficiency;
pub mod explain;
mod lines;
mod numbers;
pub mod page;
pub mod plot;
mod product;
pub mod reduce;

pub use lines::channel_line;
pub use numbers::rounded;
pub use product::{Format, Product, ProductError};
