//! Studies: one scene, simulated for many values of its keys and for the passes of many objects.
//!
//! ```text
//! STUDY.toml ─► Study (points × objects = tasks) ─► shards of tasks ─► Parquet files ─► manifest.json
//! ```
//!
//! A shard is made whole or not at all, and depends on nothing but the study: one core, eight threads, a batch system and a second try give the same
//! bytes. So whatever starts shards may kill them, and a run goes on where the last one ended ([`run`]).
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@file`] | `STUDY.toml` and what it names |
//! | [`design`] | how values of parameters are combined |
//! | [`scene`] | a scene with other values at some keys |
//! | [`task`] | one task: simulated, summarised |
//! | [`table`] | columns and their Parquet file |
//! | [`run`] | shards, their files, the manifest |
//! | [`slurm`] | shards as a job array of Slurm |

mod caught;
pub mod design;
mod error;
pub mod file;
pub mod run;
pub mod scene;
pub mod slurm;
pub mod table;
pub mod task;

/// The program, and what stands for the sources of all that a study's numbers come from: two states of them do not share a folder.
pub const PROGRAM: &str =
    concat!("sunglint ", env!("CARGO_PKG_VERSION"), env!("SUNGLINT_STUDY_SOURCES"));

pub use caught::caught;
pub use error::StudyError;
pub use file::{Stations, Study};
