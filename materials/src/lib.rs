//! A sample's bidirectional reflectance, from a goniometer: after Dupuy and Jakob (ACM TOG 37, 274, 2018).
//!
//! In the order of the work in the lab, each step a table that the next one reads:
//!
//! - [`retro`]: from a power meter's readings to retro-reflection against angle;
//! - [`settling`]: how long its readings take to settle;
//! - [`table`]: that, as a file holds it;
//! - [`ndf`]: the density of microfacet normals (NDF), by power iteration, with its uncertainties;
//! - [`plan`]: the directions in which the sample is then measured;
//! - [`ingest`]: from a spectrometer's spectra, direction by direction, to values;
//! - [`read`]: tables of the lab, read from files;
//! - [`exchange`]: values as FRED, Zemax and other laboratories write them;
//! - [`samples`]: those values;
//! - [`instrument`]: what they say of the instrument;
//! - [`assemble`]: values and densities as a measured material;
//! - [`look`]: what a material does, and how two differ;
//! - [`fit`]: laws with few parameters through measured values.

pub mod assemble;
pub mod axis;
pub mod exchange;
pub mod fit;
pub mod goniometer;
pub mod ingest;
pub mod instrument;
pub mod log;
pub mod look;
pub mod ndf;
pub mod plan;
pub mod read;
pub mod reading;
pub mod retro;
pub mod samples;
pub mod settling;
pub mod table;
