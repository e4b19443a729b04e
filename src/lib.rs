//! The workflows of `sunglint`, one module per thing a person does, and what they share.
//!
//! - [`demo`]: what there is, on embedded input;
//! - [`tables`]: the reference tables;
//! - [`air`]: the transmission of the air;
//! - [`star`]: a star's place, airmass and expected rates;
//! - [`explain`]: what a pass needs, and what error that leaves;
//! - [`reduce`]: from a session to linear light curves;
//! - [`align`]: the fibres' fields on the camera image, from stars;
//! - [`simulate`]: what a pass should look like in every channel;
//! - [`passes`]: when satellites can be seen;
//! - [`picture`]: what a body looks like, and what it sends into all directions;
//! - [`brdf`]: a sample's reflectance, from a goniometer;
//! - [`devices`]: the instruments;
//! - [`observe`]: a night from its plan to its session's folder;
//! - [`session`]: what of a recorded night is there;
//! - [`mod@calibrate`]: the coefficient of every channel and night from stars;
//! - [`apply`]: a light curve times that coefficient, magnitudes, irradiances;
//! - [`mod@bench`]: error against time of the light engines;
//! - [`virtual_observatory`]: a night that is made up, behind the devices;
//! - [`station`]: which station a command is about;
//! - [`cli`]: the grammar of the command line, its completions and manual pages;
//! - [`output`]: where results go, in which format, and that nothing is overwritten;
//! - [`plot`] draws figures.

pub mod air;
pub mod align;
pub mod apply;
pub mod bench;
pub mod brdf;
pub mod calibrate;
pub mod cli;
pub mod demo;
pub mod devices;
pub mod explain;
pub mod observe;
pub mod output;
pub mod passes;
pub mod picture;
pub mod plot;
pub mod reduce;
pub mod session;
pub mod simulate;
pub mod star;
pub mod station;
pub mod tables;
pub mod virtual_observatory;
