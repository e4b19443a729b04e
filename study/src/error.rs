//! Errors of a study.

use std::path::PathBuf;
use sunglint_formats::{FileError, ParseError};
use sunglint_numerics::progress::Cancelled;

/// Why a study cannot be read or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// A file that cannot be read or written, or makes no sense.
    #[error(transparent)]
    File(#[from] FileError),
    /// The first point makes no scene: the study is wrong, not one of its tasks.
    #[error("{}: the scene of the first point ({point}): {why}", path.display())]
    Scene {
        /// The study.
        path: PathBuf,
        /// The values of the point.
        point: String,
        /// Fault of the scene.
        why: String,
    },
    /// A shard's table cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// Error of the Parquet writer.
        source: parquet::errors::ParquetError,
    },
    /// A table cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unread {
        /// The file.
        path: PathBuf,
        /// Error of the Parquet reader.
        source: parquet::errors::ParquetError,
    },
    /// The folder holds another study, or another state of this one.
    #[error(
        "{} holds another study ({found}, this one is {id}): its file, its scene, what these name or the program's version has changed; give another folder, or remove that one",
        path.display()
    )]
    OtherStudy {
        /// The folder.
        path: PathBuf,
        /// First digits of the identity in the folder.
        found: String,
        /// First digits of this study's identity.
        id: String,
    },
    /// A shard that there is not.
    #[error("part {part} of {of} was asked for, expected 1 to {of}, and at least one part")]
    NoSuchPart {
        /// Part that was asked for.
        part: usize,
        /// Number of parts.
        of: usize,
    },
    /// Slurm refuses or loses shards again and again.
    #[error("Slurm: {0}")]
    Slurm(String),
    /// The work was stopped. Shards that were done are kept.
    #[error("{0}: shards that were done are kept, and the next run goes on from them")]
    Cancelled(#[from] Cancelled),
}

impl From<ParseError> for StudyError {
    fn from(error: ParseError) -> Self {
        Self::File(error.into())
    }
}
