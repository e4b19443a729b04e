//! The workflows of `sunglint`, one module per thing a person does, and what they share.
//!
//! - [`demo`]: what there is, on embedded input;
//! - [`tables`]: the reference tables;
//! - [`air`]: the transmission of the air;
//! - [`star`]: a star's place, airmass and expected rates;
//! - [`cli`]: the grammar of the command line, its completions and manual pages;
//! - [`output`]: where results go, in which format, and that nothing is overwritten;
//! - [`plot`]: figures.

pub mod plot;
