//! Errors of a reader when a file is not what it should be.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};

/// Where a file stopped making sense, what stood there, and what should have.
///
/// Every reader of this crate refuses with this one type, so that a person always gets the same five
/// facts: the file, the line, the field, what was found, what was expected; and a hint where there is one.
/// They are fields of [`ParseErrorParts`], to which it dereferences: `error.line`.
// Boxed, so that a `Result` of a reader is no larger than what it reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParseError(Box<ParseErrorParts>);

/// The facts of a [`ParseError`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ParseErrorParts {
    /// The file as the user named it, or what stands for it (`<stdin>`, `embedded:sun`).
    pub path: PathBuf,
    /// The line, counted from 1; `None` for binary files.
    pub line: Option<u64>,
    /// The field, column, keyword or dotted key that is wrong.
    pub field: Option<String>,
    /// Text that stands in the file.
    pub found: String,
    /// Description of what should stand there.
    pub expected: String,
    /// Advice on what to do about it.
    pub hint: Option<String>,
}

impl Deref for ParseError {
    type Target = ParseErrorParts;

    fn deref(&self) -> &ParseErrorParts {
        &self.0
    }
}

impl DerefMut for ParseError {
    fn deref_mut(&mut self) -> &mut ParseErrorParts {
        &mut self.0
    }
}

impl ParseError {
    /// An error that knows only its file; add the rest with the methods below.
    pub fn new(
        path: impl AsRef<Path>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::new_at(path.as_ref(), found.into(), expected.into())
    }

    fn new_at(path: &Path, found: String, expected: String) -> Self {
        Self(Box::new(ParseErrorParts {
            path: path.to_path_buf(),
            line: None,
            field: None,
            found,
            expected,
            hint: None,
        }))
    }

    /// The same error at a line (counted from 1).
    #[must_use]
    pub fn at_line(mut self, line: u64) -> Self {
        self.line = Some(line);
        self
    }

    /// The same error in a field, column, keyword or dotted key.
    #[must_use]
    pub fn in_field(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// The same error with what to do about it.
    #[must_use]
    pub fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(field) = &self.field {
            write!(f, ": {field}")?;
        }
        write!(f, ": found {}, expected {}", self.found, self.expected)?;
        if let Some(hint) = &self.hint {
            write!(f, " ({hint})")?;
        }
        Ok(())
    }
}

impl std::error::Error for ParseError {}

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// `read`, `write`, `create` …
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Error that the operating system reported.
        source: std::io::Error,
    },
    /// The file was read and is not what it should be.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// The data to be written do not fit the format.
    #[error("cannot write {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Error that says what does not fit.
        source: EncodeError,
    },
    /// The file is there already, and the caller did not ask to overwrite it.
    #[error("{} is there already; it is not overwritten unless that is asked for", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
}

impl FileError {
    /// An I/O error with the file that it is about.
    pub fn io(action: &'static str, path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { action, path: path.as_ref().to_path_buf(), source }
    }

    /// An encoding error with the file that it is about.
    pub fn encode(path: impl AsRef<Path>, source: EncodeError) -> Self {
        Self::Encode { path: path.as_ref().to_path_buf(), source }
    }
}

/// Why a value in memory cannot be written in a format (a keyword too long, a text that is not ASCII …).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: found {found}, expected {expected}")]
#[non_exhaustive]
pub struct EncodeError {
    /// The column, keyword or field that does not fit.
    pub field: String,
    /// Value that was found.
    pub found: String,
    /// Values that the format can hold.
    pub expected: String,
}

impl EncodeError {
    /// A value of `field` that the format cannot hold.
    pub fn new(
        field: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self { field: field.into(), found: found.into(), expected: expected.into() }
    }
}

/// A piece of a foreign text for an error message: one line, quoted, control characters escaped, at most 40
/// characters.
pub(crate) fn excerpt(text: &str) -> String {
    const MOST: usize = 40;
    let mut short = String::new();
    for c in text.chars().take(MOST) {
        if c.is_control() {
            short.extend(c.escape_debug());
        } else {
            short.push(c);
        }
    }
    if text.chars().nth(MOST).is_some() {
        short.push('…');
    }
    format!("`{short}`")
}

/// The names nearest to `wanted` (case ignored), best first, for "did you mean": at most `most` of them, and
/// none that is far off.
pub fn nearest_names<'a>(
    wanted: &str,
    names: impl IntoIterator<Item = &'a str>,
    most: usize,
) -> Vec<&'a str> {
    let wanted = wanted.to_lowercase();
    let mut scored: Vec<(f64, &str)> = names
        .into_iter()
        .map(|name| (strsim::jaro_winkler(&wanted, &name.to_lowercase()), name))
        .filter(|(score, _)| *score > 0.7)
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    scored.truncate(most);
    scored.into_iter().map(|(_, name)| name).collect()
}
