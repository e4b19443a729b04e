//! Elements from any file that gives them out, and how far several sets of one object are apart.
//!
//! [`read`], [`parse`] and [`parse_lenient`] know a file by its content: two-line elements ([`tle`], with names or without), or
//! orbit mean-elements messages (OMM) in JSON, CSV, XML or KVN. Every command that takes elements takes all of them.

use super::{DecayCause, Tle, TleOrbit, omm, seconds_between, tle};
use hifitime::Epoch;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::{FileError, ParseError};

/// Form in which elements are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Form {
    /// Two lines, perhaps after a name.
    Lines,
    /// OMM in JSON.
    Json,
    /// OMM in CSV.
    Csv,
    /// OMM in XML.
    Xml,
    /// OMM as keys and values.
    Kvn,
}

impl Form {
    /// Returns the form of a text: that of what it begins with.
    pub fn of(text: &str) -> Self {
        let text = text.trim_start();
        let mut lines =
            text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
        let first = lines.next().unwrap_or_default();
        // A name may begin with anything.
        let is_first_line = |line: &str| line.starts_with("1 ") && (65..75).contains(&line.len());
        if lines.next().is_some_and(is_first_line) {
            Self::Lines
        } else if text.starts_with(['{', '[']) {
            Self::Json
        } else if text.starts_with('<') {
            Self::Xml
        } else if first.starts_with("CCSDS_") || first.starts_with("COMMENT") {
            Self::Kvn
        } else if first.contains("MEAN_MOTION") && first.contains(',') {
            Self::Csv
        } else {
            Self::Lines
        }
    }

    /// Returns the name of the form.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lines => "two-line elements",
            Self::Json => "OMM in JSON",
            Self::Csv => "OMM in CSV",
            Self::Xml => "OMM in XML",
            Self::Kvn => "OMM in KVN",
        }
    }
}

/// Reads every set of a file, in any [`Form`]; one bad set refuses the file.
///
/// # Errors
/// The errors of [`parse`]; a file that cannot be read.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<Tle>, FileError> {
    let path = path.as_ref();
    Ok(parse(path, &sunglint_formats::read::text(path)?)?)
}

/// Every set of a text, in any [`Form`]; one bad set refuses it. `path` names the text in errors.
///
/// # Errors
/// The first thing that is wrong, with its line and key; a text without elements.
///
/// ```
/// use sunglint_ephemeris::orbit::elements;
///
/// // CelesTrak's example, with a catalogue number that two lines cannot hold.
/// let omm = r#"[{"OBJECT_NAME": "ISS (ZARYA)", "OBJECT_ID": "1998-067A", "EPOCH": "2020-07-12T01:19:07.402656", "MEAN_MOTION": 15.49560532,
///   "ECCENTRICITY": 0.0001771, "INCLINATION": 51.6435, "RA_OF_ASC_NODE": 225.4004, "ARG_OF_PERICENTER": 44.9625, "MEAN_ANOMALY": 5.1087,
///   "EPHEMERIS_TYPE": 0, "CLASSIFICATION_TYPE": "U", "NORAD_CAT_ID": 123456789, "ELEMENT_SET_NO": 999, "REV_AT_EPOCH": 23587,
///   "BSTAR": 0.0049645, "MEAN_MOTION_DOT": 0.00289036, "MEAN_MOTION_DDOT": 0}]"#;
/// let sets = elements::parse("iss.json", omm)?;
/// assert_eq!(sets[0].norad_id, 123_456_789);
/// let error = elements::parse("iss.json", &omm.replace("51.6435", "251.6435")).unwrap_err();
/// assert_eq!(error.to_string(), "iss.json:2: INCLINATION: found `251.6435`, expected 0 to 180 degrees");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Vec<Tle>, ParseError> {
    parse_at(path.as_ref(), text)
}

fn parse_at(path: &Path, text: &str) -> Result<Vec<Tle>, ParseError> {
    match sets(path, text) {
        None => tle::parse(path, text),
        Some(sets) => {
            let sets = sets?.into_iter().collect::<Result<Vec<_>, _>>()?;
            if sets.is_empty() { Err(nothing(path)) } else { Ok(sets) }
        }
    }
}

/// The good sets of a text, in any [`Form`], and what is wrong with the others. A text that is not of its form at all, or has no
/// elements, has one error, which says so.
pub fn parse_lenient(path: impl AsRef<Path>, text: &str) -> (Vec<Tle>, Vec<ParseError>) {
    parse_lenient_at(path.as_ref(), text)
}

fn parse_lenient_at(path: &Path, text: &str) -> (Vec<Tle>, Vec<ParseError>) {
    let sets = match sets(path, text) {
        None => return tle::parse_lenient(path, text),
        Some(Err(error)) => return (Vec::new(), vec![error]),
        Some(Ok(sets)) => sets,
    };
    let (mut good, mut bad) = (Vec::new(), Vec::new());
    for one in sets {
        match one {
            Ok(set) => good.push(set),
            Err(error) => bad.push(error),
        }
    }
    if good.is_empty() && bad.is_empty() {
        bad.push(nothing(path));
    }
    (good, bad)
}

/// Sets of a message, or why there are none.
type Read = Result<Vec<Result<Tle, ParseError>>, ParseError>;

/// The sets of messages; `None` for two-line elements.
fn sets(path: &Path, text: &str) -> Option<Read> {
    Some(match Form::of(text) {
        Form::Lines => return None,
        Form::Json => omm::json(path, text),
        Form::Csv => omm::csv(path, text),
        Form::Xml => omm::xml(path, text),
        Form::Kvn => omm::kvn(path, text),
    })
}

fn nothing(path: &Path) -> ParseError {
    ParseError::new(path, "no elements", "at least one set")
}

/// The sets of a list in JSON that [`parse`] reads, as they stand there; `None` of other texts.
pub(super) fn good_json(path: impl AsRef<Path>, text: &str) -> Option<String> {
    good_json_at(path.as_ref(), text)
}

fn good_json_at(path: &Path, text: &str) -> Option<String> {
    if Form::of(text) != Form::Json {
        return None;
    }
    let all: Vec<&serde_json::value::RawValue> =
        serde_json::from_str(text.trim_start_matches('\u{feff}')).ok()?;
    let is_good = |raw: &&&serde_json::value::RawValue| parse(path, raw.get()).is_ok();
    let good: Vec<&str> = all.iter().filter(is_good).map(|raw| raw.get()).collect();
    Some(format!("[\n{}\n]\n", good.join(",\n")))
}

/// A text with these sets, which [`parse`] reads back: two lines each where all came from such, else OMM in KVN.
pub fn text<'a>(sets: impl IntoIterator<Item = &'a Tle> + Clone) -> String {
    let mut text = String::new();
    let lines = sets.clone().into_iter().all(|set| set.omm.is_none());
    for set in sets {
        if lines {
            if let Some(name) = &set.name {
                let _ = writeln!(text, "{name}");
            }
            let _ = writeln!(text, "{}\n{}", set.line1, set.line2);
        } else {
            let _ = writeln!(text, "{}", set.kvn());
        }
    }
    text
}

/// Distance of one set's prediction from another's, at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apart {
    /// Distance along the velocity, m; above 0 where the first set's place is ahead.
    pub along_m: f64,
    /// Time for which the second takes that distance, s.
    pub along_s: f64,
    /// Distance across the velocity, m.
    pub across_m: f64,
}

/// Distance of `set`'s prediction from that of `from`, along the velocity of the latter and across it.
///
/// # Errors
/// Why SGP4 has no place for one of them then; [`DecayCause::NotFinite`] also where it cannot start.
pub fn apart(set: &Tle, from: &Tle, at: Epoch) -> Result<Apart, DecayCause> {
    let state = |tle: &Tle| {
        let orbit = TleOrbit::new(tle.clone()).map_err(|_| DecayCause::NotFinite)?;
        orbit.teme_after(seconds_between(tle.epoch, at) / 60.0)
    };
    let (one, other) = (state(set)?, state(from)?);
    let away = one.position_m - other.position_m;
    let speed_m_s = other.velocity_m_s.length();
    let along_m = away.dot(other.velocity_m_s) / speed_m_s;
    let across_m = (away.length_squared() - along_m * along_m).max(0.0).sqrt();
    Ok(Apart { along_m, along_s: along_m / speed_m_s, across_m })
}

/// The sets of one object, beside each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Held<'a> {
    /// The set whose epoch is nearest to the time.
    pub nearest: &'a Tle,
    /// Number of sets with epochs of their own.
    pub sets: usize,
    /// First and last epoch.
    pub epochs: (Epoch, Epoch),
    /// Age of the nearest set at the time, days; below 0 where its epoch is later.
    pub age_days: f64,
    /// Distance of the set next in age from the nearest one, at the time; `None` for a single set, or where SGP4 has no place.
    pub next: Option<Apart>,
    /// The largest distance of any set from the nearest one, at the time.
    pub furthest: Option<Apart>,
}

/// Contents of a file, object by object in the order of their numbers.
pub fn held(sets: &[Tle], at: Epoch) -> Vec<Held<'_>> {
    let mut by_number = std::collections::BTreeMap::<u32, Vec<&Tle>>::new();
    for set in sets {
        by_number.entry(set.norad_id).or_default().push(set);
    }
    by_number.into_values().filter_map(|own| of_one(own, at)).collect()
}

fn of_one(mut own: Vec<&Tle>, at: Epoch) -> Option<Held<'_>> {
    let age_s = |set: &Tle| seconds_between(set.epoch, at).abs();
    own.sort_by(|a, b| age_s(a).total_cmp(&age_s(b)));
    own.dedup_by(|a, b| seconds_between(a.epoch, b.epoch) == 0.0);
    let (nearest, others) = own.split_first()?;
    let away: Vec<Apart> =
        others.iter().filter_map(|other| apart(other, nearest, at).ok()).collect();
    let first = own.iter().map(|s| s.epoch).min()?;
    let last = own.iter().map(|s| s.epoch).max()?;
    let size = |a: &Apart| a.along_m.hypot(a.across_m);
    Some(Held {
        nearest,
        sets: own.len(),
        epochs: (first, last),
        age_days: seconds_between(nearest.epoch, at) / 86_400.0,
        next: others.first().and_then(|other| apart(other, nearest, at).ok()),
        furthest: away.into_iter().max_by(|a, b| size(a).total_cmp(&size(b))),
    })
}
