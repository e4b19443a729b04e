//! Two-line element sets: from files and texts, checked column by column.
//!
//! A file holds any number of sets: two lines each, or three with the name before them (bare, or after `0 `). Blank lines and
//! lines that begin with `#` are passed over, and lines may end in CR LF. Catalogue numbers may be alpha-5: a letter
//! other than I and O for the first two digits (`A0000` is 100000, `Z9999` is 339999).
//!
//! The epoch of a set is UTC, its day counted as 86,400 s whatever the day's length, as the published code does.

use super::OrbitError;
use hifitime::{Duration, Epoch};
use std::collections::BTreeMap;
use std::path::Path;
use sunglint_formats::time::{UtcDay, format_utc};
use sunglint_formats::{FileError, ParseError, nearest_names};

/// Length of a line without its end.
const LENGTH: usize = 69;
/// The longest name: 24 characters, after `0 `. A longer line that begins with `1 ` or `2 ` is one of elements.
const LONGEST_NAME: usize = 26;
/// The last digit of the epoch's day, ns.
const DAY_DIGIT_NS: i128 = 864_000;
/// Names that an error lists at most.
const LISTED: usize = 10;

/// One set of two-line elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Tle {
    /// The name on the line before, without the `0 ` that some sources put there.
    pub name: Option<String>,
    /// The number in the catalogue.
    pub norad_id: u32,
    /// The international designator, such as `1998-067A`.
    pub international_designator: Option<String>,
    /// The epoch of the elements.
    pub epoch: Epoch,
    /// Inclination, degrees.
    pub inclination_deg: f64,
    /// Eccentricity.
    pub eccentricity: f64,
    /// Mean motion (Kozai's), revolutions per day.
    pub mean_motion_rev_day: f64,
    /// Drag term B*, per Earth radius.
    pub bstar: f64,
    /// The first line as it stands in the file; empty for elements from an OMM.
    pub line1: String,
    /// The second line; empty for elements from an OMM.
    pub line2: String,
    /// The message in KVN, of elements from an OMM.
    pub(super) omm: Option<Box<str>>,
    pub(super) elements: sgp4::Elements,
}

impl Tle {
    /// Returns the label of the object: name and number, or the number.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("{name} ({})", self.norad_id),
            None => format!("object {}", self.norad_id),
        }
    }

    /// The two lines, of elements that came in two lines.
    pub fn lines(&self) -> Option<[&str; 2]> {
        self.omm.is_none().then_some([self.line1.as_str(), self.line2.as_str()])
    }

    /// The elements as an OMM in KVN, digits for digits of the same numbers.
    pub fn kvn(&self) -> String {
        match &self.omm {
            Some(kvn) => kvn.to_string(),
            None => super::omm::written(&self.elements, self.epoch),
        }
    }

    /// The period from the mean motion, s.
    pub fn period_s(&self) -> f64 {
        86_400.0 / self.mean_motion_rev_day
    }
}

/// Reads every set of a file; one bad set refuses the file.
///
/// # Errors
/// The errors of [`parse`]; a file that cannot be read.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<Tle>, FileError> {
    let path = path.as_ref();
    Ok(parse(path, &sunglint_formats::read::text(path)?)?)
}

/// Every set of a text; one bad set refuses it. `path` names the text in errors.
///
/// # Errors
/// The first thing that is wrong, with its line and field: a line of the wrong length, a checksum, a column that is not what it
/// should be, two lines of different objects, a line without its partner, an epoch before 1972; a text without elements.
///
/// ```
/// use sunglint_ephemeris::orbit::tle;
///
/// const ISS: &str = "ISS (ZARYA)
/// 1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
/// 2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
/// ";
///
/// let sets = tle::parse("iss.tle", ISS)?;
/// assert_eq!(sets[0].norad_id, 25544);
/// // 15.72 revolutions a day: 91.6 minutes.
/// assert!((sets[0].period_s() / 60.0 - 91.6).abs() < 0.1);
/// // One digit changed: the checksum says so.
/// assert!(tle::parse("iss.tle", &ISS.replace("51.6416", "51.6417")).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Vec<Tle>, ParseError> {
    let path = path.as_ref();
    let all = Scanner::new(path, text).collect::<Result<Vec<Tle>, _>>()?;
    if all.is_empty() { Err(nothing(path)) } else { Ok(all) }
}

/// The good sets of a text, and what is wrong with the others: for catalogues of thousands, in which one bad set should not
/// hide the rest. A text without a single line of elements has one error, which says so.
pub fn parse_lenient(path: impl AsRef<Path>, text: &str) -> (Vec<Tle>, Vec<ParseError>) {
    parse_lenient_at(path.as_ref(), text)
}

fn parse_lenient_at(path: &Path, text: &str) -> (Vec<Tle>, Vec<ParseError>) {
    let (mut good, mut bad) = (Vec::new(), Vec::new());
    for one in Scanner::new(path, text) {
        match one {
            Ok(tle) => good.push(tle),
            Err(error) => bad.push(error),
        }
    }
    if good.is_empty() && bad.is_empty() {
        bad.push(nothing(path));
    }
    (good, bad)
}

fn nothing(path: &Path) -> ParseError {
    ParseError::new(path, "no elements", "two-line elements: a line 1 and a line 2 of 69 columns")
}

/// Why no single set could be chosen.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChoiceError {
    /// There is more than one, and none was named.
    #[error("there are {count} sets of elements: name one by its number or name: {listed}")]
    Several {
        /// Number.
        count: usize,
        /// The first of them.
        listed: String,
    },
    /// More than one fits.
    #[error("`{wanted}` fits {count} sets of elements: {listed}")]
    Ambiguous {
        /// Object that was asked for.
        wanted: String,
        /// Number of sets that fit.
        count: usize,
        /// The first of them.
        listed: String,
    },
    /// None fits.
    #[error("`{wanted}` is not among the {count} sets of elements; {hint}")]
    Unknown {
        /// Object that was asked for.
        wanted: String,
        /// Number of those there are.
        count: usize,
        /// The nearest, or the first of them.
        hint: String,
    },
}

/// The set that a person means: by catalogue number (alpha-5 too), by name (case ignored), or by a part of a name that is no number and fits
/// one object only; without `which`, the only one there is. Of several sets of one object it is the one whose epoch is
/// nearest to `near`.
///
/// # Errors
/// [`ChoiceError`] lists what there is.
pub fn choose<'a>(
    tles: &'a [Tle],
    which: Option<&str>,
    near: Option<Epoch>,
) -> Result<&'a Tle, ChoiceError> {
    let fits: Vec<&Tle> = match which {
        None => tles.iter().collect(),
        Some(wanted) => fitting(tles, wanted.trim()),
    };
    let one_object = fits.windows(2).all(|pair| pair[0].norad_id == pair[1].norad_id);
    let chosen = match (fits.as_slice(), near) {
        (&[only], _) => Some(only),
        (several, Some(near)) if one_object => {
            several.iter().copied().min_by(|a, b| age_s(a, near).total_cmp(&age_s(b, near)))
        }
        _ => None,
    };
    chosen.ok_or_else(|| match which {
        None => ChoiceError::Several { count: tles.len(), listed: list(&fits) },
        Some(wanted) if fits.is_empty() => unknown(tles, wanted),
        Some(wanted) => ChoiceError::Ambiguous {
            wanted: wanted.to_owned(),
            count: fits.len(),
            listed: list(&fits),
        },
    })
}

/// Objects that were asked for and are not there, or not one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ObjectsError {
    /// A catalogue number.
    #[error(transparent)]
    Number(ChoiceError),
    /// A part of a name.
    #[error("{wanted}: {why}")]
    Name {
        /// The part.
        wanted: String,
        /// Why there is none.
        why: String,
    },
}

/// The sets of some objects, one each: the one whose epoch is nearest to `near`, in the order of their numbers. The objects are those with the catalogue
/// `numbers` and those whose name contains one of `names`, case ignored; all where neither is given.
///
/// # Errors
/// A number or a name that no set has.
pub fn of_objects(
    tles: Vec<Tle>,
    numbers: &[String],
    names: &[String],
    near: Epoch,
) -> Result<Vec<Tle>, ObjectsError> {
    if tles.is_empty() {
        return Ok(tles);
    }
    let mut wanted_ids = Vec::new();
    for wanted in numbers {
        let tle = choose(&tles, Some(wanted), Some(near)).map_err(ObjectsError::Number)?;
        wanted_ids.push(tle.norad_id);
    }
    let lower = |text: &str| text.to_lowercase();
    for wanted in names {
        let has = |t: &Tle| t.name.as_ref().is_some_and(|n| lower(n).contains(&lower(wanted)));
        let before = wanted_ids.len();
        wanted_ids.extend(tles.iter().filter(|t| has(t)).map(|t| t.norad_id));
        if wanted_ids.len() == before {
            let error = choose(&tles, Some(wanted), Some(near)).err();
            let why = error.map_or("no name contains it".into(), |e| e.to_string());
            return Err(ObjectsError::Name { wanted: wanted.clone(), why });
        }
    }
    let all = numbers.is_empty() && names.is_empty();
    let mut nearest: BTreeMap<u32, Tle> = BTreeMap::new();
    let age = |t: &Tle| (t.epoch - near).abs();
    for tle in tles {
        if !all && !wanted_ids.contains(&tle.norad_id) {
            continue;
        }
        match nearest.get(&tle.norad_id) {
            Some(known) if age(known) <= age(&tle) => {}
            _ => {
                nearest.insert(tle.norad_id, tle);
            }
        }
    }
    Ok(nearest.into_values().collect())
}

fn age_s(tle: &Tle, near: Epoch) -> f64 {
    super::seconds_between(tle.epoch, near).abs()
}

fn fitting<'a>(tles: &'a [Tle], wanted: &str) -> Vec<&'a Tle> {
    let by = |fits: &dyn Fn(&Tle) -> bool| tles.iter().filter(|t| fits(t)).collect::<Vec<_>>();
    let number = catalogue_number(wanted).or_else(|| wanted.parse().ok());
    let name_of = |t: &Tle| t.name.as_deref().unwrap_or_default().to_lowercase();
    let lower = wanted.to_lowercase();
    let mut found = by(&|t| number == Some(t.norad_id));
    if found.is_empty() {
        found = by(&|t| t.name.is_some() && name_of(t) == lower);
    }
    // A number is a catalogue number, not the middle of some other object's name.
    if found.is_empty() && !lower.is_empty() && number.is_none() {
        found = by(&|t| name_of(t).contains(&lower));
    }
    found
}

fn list(tles: &[&Tle]) -> String {
    let mut text: Vec<String> = tles
        .iter()
        .take(LISTED)
        .map(|t| format!("{} of {}", t.label(), format_utc(t.epoch, 0)))
        .collect();
    if tles.len() > LISTED {
        text.push(format!("and {} more", tles.len() - LISTED));
    }
    text.join(", ")
}

fn unknown(tles: &[Tle], wanted: &str) -> ChoiceError {
    let names = tles.iter().filter_map(|t| t.name.as_deref());
    let nearest = nearest_names(wanted, names, 1);
    let hint = match (nearest.first(), wanted.parse::<u32>()) {
        (Some(nearest), _) => format!("did you mean `{nearest}`?"),
        (None, Ok(number)) if tles.len() > LISTED => {
            let mut near: Vec<&Tle> = tles.iter().collect();
            near.sort_by_key(|t| (t.norad_id.abs_diff(number), t.norad_id));
            near.dedup_by_key(|t| t.norad_id);
            let labels: Vec<String> = near.iter().take(3).map(|t| t.label()).collect();
            format!("the nearest numbers are those of {}", labels.join(", "))
        }
        _ => format!("they are {}", list(&tles.iter().collect::<Vec<_>>())),
    };
    ChoiceError::Unknown { wanted: wanted.to_owned(), count: tles.len(), hint }
}

/// The number of five columns, alpha-5 included.
pub(super) fn catalogue_number(columns: &str) -> Option<u32> {
    if columns.len() != 5 || !columns.is_ascii() {
        return None;
    }
    let (first, rest) = columns.split_at(1);
    let thousands = match first.as_bytes()[0] {
        letter @ b'A'..=b'H' => u32::from(letter - b'A') + 10,
        letter @ b'J'..=b'N' => u32::from(letter - b'J') + 18,
        letter @ b'P'..=b'Z' => u32::from(letter - b'P') + 23,
        b'0'..=b'9' | b' ' => {
            let digits = columns.trim_start();
            return all_digits(digits).then(|| digits.parse().ok())?;
        }
        _ => return None,
    };
    all_digits(rest).then(|| rest.parse::<u32>().ok())?.map(|rest| thousands * 10_000 + rest)
}

fn all_digits(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

/// Goes through a text, set by set.
struct Scanner<'a> {
    path: &'a Path,
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    held: Option<Line<'a>>,
}

/// A line that is neither blank nor a comment, with its number.
#[derive(Debug, Clone, Copy)]
struct Line<'a> {
    text: &'a str,
    number: u64,
}

impl Line<'_> {
    /// The line without what stands behind its checksum and a blank: the file that verifies programs of SGP4 (Vallado et al. 2006) has times there.
    fn without_remark(self) -> Self {
        let is_elements = self.is(b'1') || self.is(b'2');
        match self.text.split_at_checked(LENGTH) {
            Some((elements, rest)) if is_elements && rest.starts_with(' ') => {
                Self { text: elements, ..self }
            }
            _ => self,
        }
    }

    /// Whether it looks like the line 1 or 2 of a set, however damaged.
    fn is(&self, which: u8) -> bool {
        let bytes = self.text.as_bytes();
        bytes.len() > LONGEST_NAME
            && bytes[0] == which
            && (bytes[1] == b' ' || !bytes[1].is_ascii_alphanumeric())
    }
}

impl<'a> Scanner<'a> {
    fn new(path: &'a Path, text: &'a str) -> Self {
        Self { path, lines: text.lines().enumerate(), held: None }
    }

    fn line(&mut self) -> Option<Line<'a>> {
        if let Some(held) = self.held.take() {
            return Some(held);
        }
        self.lines.by_ref().find_map(|(index, text)| {
            let text = text.trim_end();
            let passed_over = text.is_empty() || text.starts_with('#');
            let line = Line { text, number: index as u64 + 1 };
            (!passed_over).then(|| line.without_remark())
        })
    }

    fn error(&self, line: Line<'_>, expected: &str) -> ParseError {
        ParseError::new(self.path, excerpt(line.text), expected).at_line(line.number)
    }
}

impl Iterator for Scanner<'_> {
    type Item = Result<Tle, ParseError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut first = self.line()?;
        let mut name = None;
        if !first.is(b'1') && !first.is(b'2') {
            let text = first.text.strip_prefix("0 ").unwrap_or(first.text).trim();
            name = (!text.is_empty()).then(|| text.to_owned());
            match self.line() {
                Some(line) if line.is(b'1') => first = line,
                other => {
                    self.held = other;
                    return Some(Err(
                        self.error(first, "a line 1 of 69 columns, or a name before one")
                    ));
                }
            }
        }
        if first.is(b'2') {
            return Some(Err(self.error(first, "a line 1 before this line 2")));
        }
        let second = match self.line() {
            Some(line) if line.is(b'2') => line,
            other => {
                self.held = other;
                return Some(Err(self.error(first, "a line 2 after this line 1")));
            }
        };
        Some(set(self.path, name, first, second))
    }
}

/// Kind of a field, which says what may stand in it.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Catalogue,
    /// Digits; blanks before them.
    Integer,
    /// The same, or nothing.
    IntegerOrBlank,
    /// A number with a point.
    Decimal,
    /// Digits behind a point that is not written.
    Fraction,
    /// ±ddddd±d: digits behind a point that is not written, and a power of ten.
    Exponent,
}

struct FieldAt {
    name: &'static str,
    columns: std::ops::Range<usize>,
    kind: Kind,
}

const fn field(name: &'static str, from: usize, to: usize, kind: Kind) -> FieldAt {
    FieldAt { name, columns: from..to, kind }
}

/// Columns from 0 (the format's own count is from 1), after Space-Track's description of the format.
const LINE_1: [FieldAt; 7] = [
    field("catalogue number", 2, 7, Kind::Catalogue),
    field("epoch year", 18, 20, Kind::Integer),
    field("epoch day", 20, 32, Kind::Decimal),
    field("first derivative of mean motion", 33, 43, Kind::Decimal),
    field("second derivative of mean motion", 44, 52, Kind::Exponent),
    field("B*", 53, 61, Kind::Exponent),
    field("element set number", 64, 68, Kind::IntegerOrBlank),
];
const LINE_2: [FieldAt; 8] = [
    field("catalogue number", 2, 7, Kind::Catalogue),
    field("inclination", 8, 16, Kind::Decimal),
    field("right ascension of the node", 17, 25, Kind::Decimal),
    field("eccentricity", 26, 33, Kind::Fraction),
    field("argument of perigee", 34, 42, Kind::Decimal),
    field("mean anomaly", 43, 51, Kind::Decimal),
    field("mean motion", 52, 63, Kind::Decimal),
    field("revolution number", 63, 68, Kind::IntegerOrBlank),
];
const BLANK_1: [usize; 7] = [1, 17, 32, 43, 52, 61, 63];
const BLANK_2: [usize; 7] = [1, 7, 16, 25, 33, 42, 51];

fn fits(kind: Kind, text: &str) -> Result<(), &'static str> {
    let rest = text.trim_start();
    let (good, expected) = match kind {
        Kind::Catalogue => (
            catalogue_number(text).is_some(),
            "five digits, or a letter other than I and O and four digits",
        ),
        Kind::Integer => (all_digits(rest), "digits"),
        Kind::IntegerOrBlank => (rest.is_empty() || all_digits(rest), "digits, or blanks"),
        Kind::Decimal => {
            let plain = rest.bytes().all(|b| b.is_ascii_digit() || b"+-.".contains(&b));
            (plain && rest.parse::<f64>().is_ok(), "a number with a point")
        }
        Kind::Fraction => (all_digits(text), "seven digits"),
        Kind::Exponent => {
            let b = text.as_bytes();
            let good = b" +-".contains(&b[0])
                && b[1..6].iter().all(u8::is_ascii_digit)
                && b"+-".contains(&b[6])
                && b[7].is_ascii_digit();
            (good, "a number such as ` 28098-4` or `-11606-4`")
        }
    };
    if good { Ok(()) } else { Err(expected) }
}

/// Checks that a line is what the format says, and its checksum.
fn check(
    path: &Path,
    line: Line<'_>,
    fields: &[FieldAt],
    blanks: &[usize],
) -> Result<(), ParseError> {
    let wrong =
        |found: String, expected: &str| ParseError::new(path, found, expected).at_line(line.number);
    if !line.text.is_ascii() {
        return Err(wrong(excerpt(line.text), "plain ASCII"));
    }
    let length = line.text.len();
    if length != LENGTH {
        let error = wrong(format!("{length} columns"), "69 columns");
        return Err(match length {
            68 => error.with_hint("the last column, the checksum, is missing"),
            l if l > LENGTH => error.with_hint("nothing may follow the checksum in column 69"),
            _ => error,
        });
    }
    let bytes = line.text.as_bytes();
    let sum = checksum(&bytes[..LENGTH - 1]);
    if bytes[LENGTH - 1] != b'0' + sum {
        let found = excerpt(&line.text[LENGTH - 1..]);
        return Err(wrong(found, &format!("{sum}, the checksum of the columns before"))
            .in_field("checksum (column 69)")
            .with_hint("a character was changed or lost: fetch the elements anew"));
    }
    for &column in blanks {
        if bytes[column] != b' ' {
            let found = excerpt(&line.text[column..=column]);
            return Err(wrong(found, "a blank").in_field(format!("column {}", column + 1)));
        }
    }
    for field in fields {
        let text = &line.text[field.columns.clone()];
        fits(field.kind, text).map_err(|expected| {
            let place = format!(
                "{} (columns {}-{})",
                field.name,
                field.columns.start + 1,
                field.columns.end
            );
            wrong(excerpt(text), expected).in_field(place)
        })?;
    }
    Ok(())
}

/// Digits count as themselves, minus signs as 1, the rest as 0; modulo ten.
fn checksum(bytes: &[u8]) -> u8 {
    let sum: u32 = bytes
        .iter()
        .map(|b| match b {
            b'0'..=b'9' => u32::from(b - b'0'),
            b'-' => 1,
            _ => 0,
        })
        .sum();
    (sum % 10) as u8
}

/// A set from its two lines.
fn set(
    path: &Path,
    name: Option<String>,
    first: Line<'_>,
    second: Line<'_>,
) -> Result<Tle, ParseError> {
    check(path, first, &LINE_1, &BLANK_1)?;
    check(path, second, &LINE_2, &BLANK_2)?;
    let wrong = |line: Line<'_>, field: &str, found: &str, expected: &str| {
        ParseError::new(path, excerpt(found), expected).at_line(line.number).in_field(field)
    };
    let (of_first, of_second) = (&first.text[2..7], &second.text[2..7]);
    let norad_id = catalogue_number(of_first)
        .filter(|number| catalogue_number(of_second) == Some(*number))
        .ok_or_else(|| {
            let expected = format!("`{of_first}` as in line {}", first.number);
            wrong(second, "catalogue number (columns 3-7)", of_second, &expected)
        })?;
    let epoch = epoch(&first.text[18..20], &first.text[20..32]).ok_or_else(|| {
        let expected =
            "a year (57 to 99 are 1957 to 1999) and a day in it, since 1972, where UTC begins";
        wrong(first, "epoch (columns 19-32)", &first.text[18..32], expected)
    })?;
    if first.text.as_bytes()[62] == b'4' {
        let error = wrong(first, "ephemeris type (column 63)", "4", "0: elements for SGP4");
        return Err(error.with_hint("elements of SGP4-XP are not for SGP4: fetch the others"));
    }
    // What SGP4 does not use is replaced where the crate's reader would refuse it: blanks count as zeros in the checksum too.
    let mut line1 = first.text.as_bytes().to_vec();
    line1[7] = b'U';
    let designator_year = &first.text[9..11];
    if !all_digits(designator_year) {
        line1[9..17].fill(b' ');
    }
    if !line1[62].is_ascii_digit() {
        line1[62] = b'0';
    }
    fill_blank(&mut line1[64..68]);
    line1[LENGTH - 1] = b'0' + checksum(&line1[..LENGTH - 1]);
    let mut line2 = second.text.as_bytes().to_vec();
    fill_blank(&mut line2[63..68]);
    let elements = sgp4::Elements::from_tle(name.clone(), &line1, &line2).map_err(|error| {
        ParseError::new(path, error.to_string(), "a two-line element set").at_line(first.number)
    })?;
    if !(0.0..=180.0).contains(&elements.inclination) {
        let text = &second.text[8..16];
        return Err(wrong(second, "inclination (columns 9-16)", text, "0 to 180 degrees"));
    }
    // The field holds digits, so that this is a number.
    if elements.mean_motion <= 0.0 {
        let text = &second.text[52..63];
        return Err(wrong(
            second,
            "mean motion (columns 53-63)",
            text,
            "more than 0 revolutions a day",
        ));
    }
    Ok(Tle {
        name,
        norad_id,
        international_designator: elements.international_designator.clone(),
        epoch,
        inclination_deg: elements.inclination,
        eccentricity: elements.eccentricity,
        mean_motion_rev_day: elements.mean_motion,
        bstar: elements.drag_term,
        line1: first.text.to_owned(),
        line2: second.text.to_owned(),
        omm: None,
        elements,
    })
}

fn fill_blank(columns: &mut [u8]) {
    if columns.iter().all(|b| *b == b' ') {
        columns.fill(b'0');
    }
}

/// The epoch from two digits of the year and the day with its fraction, in whole nanoseconds.
fn epoch(year: &str, day: &str) -> Option<Epoch> {
    let year = year.trim().parse::<i64>().ok()?;
    let year = if year < 57 { 2000 + year } else { 1900 + year };
    let (whole, fraction) = day.trim_start().split_once('.')?;
    let in_year = whole.parse::<i64>().ok()?;
    let days_in_year = if year % 4 == 0 { 366 } else { 365 };
    if !(1..=days_in_year).contains(&in_year) || fraction.len() > 8 || !all_digits(fraction) {
        return None;
    }
    let units = fraction.parse::<i128>().ok()? * 10_i128.pow(8 - fraction.len() as u32);
    // 1 January of 1957 to 2056, among which every fourth year is a leap year; MJD 36204 is 1958-01-01.
    let mjd = 36_203 + (year - 1958) * 365 + (year - 1957).div_euclid(4) + in_year;
    let start = UtcDay::of_mjd(mjd)?.start_tai_ns;
    Some(Epoch::from_tai_duration(Duration::from_total_nanoseconds(start + units * DAY_DIGIT_NS)))
}

/// A piece of a line for a message.
pub(super) fn excerpt(text: &str) -> String {
    const MOST: usize = 40;
    let mut short: String = text.chars().take(MOST).flat_map(char::escape_debug).collect();
    if text.chars().nth(MOST).is_some() {
        short.push('…');
    }
    format!("`{short}`")
}

impl Tle {
    /// The orbit of these elements: [`TleOrbit::new`](super::TleOrbit::new).
    ///
    /// # Errors
    /// The errors of that function.
    pub fn orbit(&self) -> Result<super::TleOrbit, OrbitError> {
        super::TleOrbit::new(self.clone())
    }
}
