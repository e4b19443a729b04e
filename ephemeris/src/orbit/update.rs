//! Fresh elements from a server or a file: kept, and asked for no more than once in two hours.
//!
//! CelesTrak and Space-Track close their doors to those who ask for the same data again and again; elements change a few times a day.
//! The answer is kept in a folder, and the time of every request beside it, also of those that failed.

use super::elements;
use hifitime::{Duration, Epoch};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{FileError, ParseError};

/// Shortest time between two requests for the same address, s.
pub const LEAST_BETWEEN_S: f64 = 7200.0;
/// Largest answer, bytes: a whole catalogue in XML has 60 MB.
const LARGEST: &str = "268435456";
/// Time for one request, s.
const TIME_S: &str = "120";

/// Elements that were fetched, or kept from before.
#[derive(Debug, Clone, PartialEq)]
pub struct Fetched {
    /// The text as it came; where sets of it are bad, the good ones alone.
    pub text: String,
    /// Number of good sets.
    pub sets: usize,
    /// Faults of the others.
    pub bad: Vec<ParseError>,
    /// When the server was asked, if this answer is from before.
    pub kept_since: Option<Epoch>,
}

/// Why there are no fresh elements.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// An address that is none.
    #[error("{0}: expected http://…, https://… or a file that is there")]
    Address(String),
    /// The program that fetches is missing, or did not start.
    #[error(
        "cannot start curl, which fetches from servers: {0}; install it, or fetch the file yourself and give its name"
    )]
    NoCurl(std::io::Error),
    /// The server did not give the data.
    #[error("{address}: {reason}")]
    Refused {
        /// Address that was asked.
        address: String,
        /// Reason, by curl.
        reason: String,
    },
    /// It was asked shortly before, and gave nothing then.
    #[error(
        "{address} was asked at {at_utc} and gave no elements then: it is not asked again before {next_utc}"
    )]
    TooSoon {
        /// Address.
        address: String,
        /// When it was asked.
        at_utc: String,
        /// When it may be asked again.
        next_utc: String,
    },
    /// The answer has no elements.
    #[error("the answer of {address} has no elements: {reason}")]
    NoElements {
        /// Address.
        address: String,
        /// First thing that is wrong.
        reason: Box<ParseError>,
    },
}

/// Elements from an address (`http`, `https`) or a file. `folder` is where answers are kept, `now` the time by which the two hours are counted.
///
/// # Errors
/// [`UpdateError`]. An answer without a single good set is not kept, and counts as a request.
pub fn update(from: &str, folder: &Path, now: Epoch) -> Result<Fetched, UpdateError> {
    let is_address = ["http://", "https://"].iter().any(|scheme| {
        from.get(..scheme.len()).is_some_and(|start| start.eq_ignore_ascii_case(scheme))
    });
    if !is_address {
        let path = Path::new(from);
        if !path.exists() || from.starts_with('-') {
            return Err(UpdateError::Address(from.to_owned()));
        }
        return checked(from, sunglint_formats::read::text(path)?, None);
    }
    let kept = folder.join(sunglint_formats::sha256(from.as_bytes()));
    let (stamp, answer) = (kept.with_extension("asked"), kept.with_extension("elements"));
    if let Some(at) = asked(&stamp) {
        let since_s = super::seconds_between(at, now);
        // A stamp of the future is of a clock that was wrong.
        if (-60.0..LEAST_BETWEEN_S).contains(&since_s) {
            return match sunglint_formats::read::text(&answer) {
                Ok(text) => checked(from, text, Some(at)),
                Err(_) => Err(UpdateError::TooSoon {
                    address: from.to_owned(),
                    at_utc: format_utc(at, 0),
                    next_utc: format_utc(at + Duration::from_seconds(LEAST_BETWEEN_S), 0),
                }),
            };
        }
    }
    std::fs::create_dir_all(folder).map_err(|e| FileError::io("create", folder, e))?;
    // An answer of before stays beside the stamp only if this request succeeds.
    match std::fs::remove_file(&answer) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(FileError::io("remove", &answer, error).into());
        }
        _ => {}
    }
    write_file(&stamp, format!("{}\n{from}\n", format_utc(now, 3)).as_bytes(), Overwrite::Allow)?;
    let text = fetch(from)?;
    let fetched = checked(from, text.clone(), None)?;
    // The answer is kept as it came, so that it is judged anew each time, with the lines of what is bad.
    write_file(&answer, text.as_bytes(), Overwrite::Allow)?;
    Ok(fetched)
}

/// Folder of kept answers: `$XDG_CACHE_HOME/sunglint/elements`, else `~/.cache/sunglint/elements`.
pub fn cache_folder() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let base = set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|home| home.join(".cache")))?;
    Some(base.join("sunglint/elements"))
}

fn asked(stamp: &Path) -> Option<Epoch> {
    parse_utc(sunglint_formats::read::text(stamp).ok()?.lines().next()?).ok()
}

fn checked(from: &str, text: String, kept_since: Option<Epoch>) -> Result<Fetched, UpdateError> {
    let (good, mut bad) = elements::parse_lenient(from, &text);
    if good.is_empty() {
        let nothing = || ParseError::new(from, "nothing", "elements");
        let reason = if bad.is_empty() { nothing() } else { bad.swap_remove(0) };
        return Err(UpdateError::NoElements { address: from.to_owned(), reason: Box::new(reason) });
    }
    // A damaged set that is stored would be taken for good by whoever copies the file on.
    let text = if bad.is_empty() {
        text
    } else {
        elements::good_json(from, &text).unwrap_or_else(|| elements::text(&good))
    };
    Ok(Fetched { text, sets: good.len(), bad, kept_since })
}

/// The text of an address, by curl: it knows proxies, certificates and redirections as the person's system has them.
fn fetch(address: &str) -> Result<String, UpdateError> {
    let output = Command::new("curl")
        .args(["--silent", "--show-error", "--fail", "--location", "--max-redirs", "5"])
        .args(["--proto", "=http,https", "--proto-redir", "=http,https", "--max-time", TIME_S])
        .args(["--max-filesize", LARGEST, "--user-agent", "sunglint", "--"])
        .arg(address)
        .stdin(Stdio::null())
        .output()
        .map_err(UpdateError::NoCurl)?;
    if !output.status.success() {
        let reason = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        return Err(UpdateError::Refused { address: address.to_owned(), reason });
    }
    Ok(sunglint_formats::read::decode(address, output.stdout).map_err(FileError::from)?)
}
