//! All tests of this crate: one program, so that one is linked.

mod astropy;
mod ecsv;
mod fuzz;
mod hostile;
mod photometry;
mod planes;
mod session;
mod toml;
mod wcs;
