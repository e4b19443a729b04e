//! The station that a session was recorded with.

use super::Station;
use std::path::PathBuf;
use sunglint_formats::FileError;
use sunglint_formats::session::Session;

/// Why the station of a session is not known.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordedError {
    /// Station file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The session has no copy of the station's file, and no built-in station has its name.
    #[error("{} holds no station, and there is no built-in one `{name}`", session.display())]
    Unknown {
        /// The session's folder.
        session: PathBuf,
        /// The station's name by the manifest.
        name: String,
    },
}

impl Station {
    /// Returns the station that a session was recorded with: the copy in the session's folder, else the built-in station of that name.
    ///
    /// # Errors
    /// A copy that cannot be read; neither a copy nor a built-in station.
    pub fn of_session(session: &Session) -> Result<Self, RecordedError> {
        let name = &session.manifest().station;
        let file = session.file("station/station.toml");
        if file.is_file() {
            return Ok(Self::read(file)?);
        }
        let known = Self::built_in_names().into_iter().find(|n| n.eq_ignore_ascii_case(name));
        match known.and_then(Self::built_in) {
            Some(station) => Ok(station?),
            None => Err(RecordedError::Unknown {
                session: session.root().to_path_buf(),
                name: name.clone(),
            }),
        }
    }
}
