//! Errors of an archive.

use std::path::PathBuf;
use sunglint_formats::photometry::ImportError;
use sunglint_formats::{FileError, ParseError, TableError};
use sunglint_numerics::progress::Cancelled;
use sunglint_study::StudyError;

/// Why an archive cannot be indexed, asked or joined. A single damaged file is none of these: it is named in the answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArchiveError {
    /// The folder or the index cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A table of the index cannot be written.
    #[error(transparent)]
    Table(#[from] StudyError),
    /// A file of magnitudes that cannot be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// A column that is not there.
    #[error(transparent)]
    Column(#[from] TableError),
    /// There is no such folder.
    #[error("{}: there is no such folder", path.display())]
    NoFolder {
        /// The folder.
        path: PathBuf,
    },
    /// Passes that cannot be put into one curve.
    #[error("the passes cannot be one curve: {why}")]
    Apart {
        /// The difference, and what to do.
        why: String,
    },
    /// A file has changed since it was indexed.
    #[error("{}: pass {pass} is no longer in it: index the archive again", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// Number of the pass.
        pass: u32,
    },
    /// A condition that no phase angle meets.
    #[error("{field} is {deg}, expected 0 to 180 degrees")]
    Phase {
        /// The condition, as [`crate::Query`] names it.
        field: &'static str,
        /// The angle that was asked for, degrees.
        deg: f64,
    },
    /// The work was stopped.
    #[error("{0}: what was read until then is in the index, and the next run goes on from there")]
    Cancelled(#[from] Cancelled),
}

impl From<ParseError> for ArchiveError {
    fn from(error: ParseError) -> Self {
        Self::File(error.into())
    }
}
