//! Results as people read them: text, figures, tables, JSON and pages. No algorithm, no file is read here.
//!
//! - [`devices`]: instruments, and what they gave;
//! - [`explain`]: what a scene needs;
//! - [`observe`]: a night as it runs;
//! - [`plot`]: figures as PNG or SVG;
//! - [`page`]: pages as HTML;
//! - [`Product`]: a result in all its forms;
//! - [`rounded`]: numbers as summaries hold them.

pub mod devices;
pub mod explain;
mod lines;
mod numbers;
pub mod observe;
pub mod page;
pub mod plot;
mod product;

pub use lines::channel_line;
pub use numbers::rounded;
pub use product::{Format, Product, ProductError};
