//! Kind of a file by its content, never by its name: for the message to somebody who gave another kind of file than a command takes.
//!
//! [`of`] looks at the first bytes, the header or the keys. It knows the files that this program reads and writes, and some that get among them; what it does not know is `None`, and is left to the reader that was asked for.

use crate::error::ParseError;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// Texts that are longer are tables, not settings, bytes.
const LONGEST_SETTINGS: usize = 4 << 20;

/// Kind of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A pass to be simulated (TOML).
    Scene,
    /// A body of parts (TOML).
    Target,
    /// Materials alone (TOML).
    Material,
    /// An observatory (TOML).
    Station,
    /// A night's plan (TOML).
    Plan,
    /// Keys of another kind (TOML).
    Settings,
    /// Rates of this program's schema (ECSV).
    LightCurve,
    /// Another table (ECSV).
    Table,
    /// A FITS file with an image and no table.
    FitsImage,
    /// A FITS file with a table.
    FitsTable,
    /// Orbital elements in two lines.
    Elements,
    /// Orbital elements as messages (OMM) in JSON.
    ElementsJson,
    /// JSON.
    Json,
    /// A page of the web.
    Html,
    /// A picture for people (PNG, JPEG, SVG).
    Picture,
    /// A document (PDF).
    Pdf,
    /// A file packed with gzip.
    Gzip,
    /// A program, a library or a database: bytes that are no text.
    Binary,
}

impl Kind {
    /// The kind in words, with its article.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "a scene (TOML with [target] and an orbit or times)",
            Self::Target => "a target (TOML with [[part]])",
            Self::Material => "materials (TOML with [[material]] alone)",
            Self::Station => "a station (TOML with [site] and [[channel]])",
            Self::Plan => "a night's plan (TOML with [[visit]] or devices)",
            Self::Settings => "a TOML file of settings",
            Self::LightCurve => "a light curve (ECSV with `quantity`)",
            Self::Table => "a table (ECSV)",
            Self::FitsImage => "a frame (FITS image)",
            Self::FitsTable => "a FITS table",
            Self::Elements => "orbital elements (two lines)",
            Self::ElementsJson => "orbital elements (OMM in JSON)",
            Self::Json => "JSON",
            Self::Html => "a web page (HTML)",
            Self::Picture => "a picture (PNG, JPEG or SVG)",
            Self::Pdf => "a PDF",
            Self::Gzip => "a file packed with gzip",
            Self::Binary => "a binary file",
        }
    }

    /// Commands that take such a file, as advice.
    pub fn advice(self) -> &'static str {
        match self {
            Self::Scene => {
                "`simulate`, `picture`, and after a curve `compare` and `fit` take scenes"
            }
            Self::Target => {
                "`light`, `picture --model`, and `file` in [target] of a scene take targets"
            }
            Self::Material => {
                "`brdf show` takes materials; a scene names them in [[target.material]] or through the target's file"
            }
            Self::Station => "--station takes it",
            Self::Plan => "`observe` takes plans",
            Self::Settings => "`sunglint help` says which command takes which file",
            Self::LightCurve => {
                "`analyse`, `apply`, and before a scene `compare` and `fit` take light curves"
            }
            Self::Table => "`import` says what is in a table of magnitudes",
            Self::FitsImage => {
                "`detect` and `solve` take frames, and `reduce` makes light curves of them"
            }
            Self::FitsTable => "`import` says what is in a table of magnitudes",
            Self::Elements | Self::ElementsJson => "`elements`, `passes` and `track` take elements",
            Self::Json => {
                "it is what `--json` writes; commands read the tables that -o FILE.ecsv writes"
            }
            Self::Html => "was an address fetched that needs a login?",
            Self::Picture => "commands read tables and FITS frames, no drawn pictures",
            Self::Pdf => "commands read tables and FITS frames, no documents",
            Self::Gzip => "unpack it first: gunzip FILE",
            Self::Binary => "it is no text, no FITS file and no packed one",
        }
    }

    /// Keys of TOML by which it is known: a reader that knows none of them reads another kind. None for what is no TOML, or any.
    pub(crate) fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Scene => &["target"],
            Self::Target => &["part"],
            Self::Material => &["material"],
            Self::Station => &["site"],
            Self::Plan => &["visit", "counter"],
            _ => &[],
        }
    }

    /// The kind that a reader with these keys reads, where it is one of the known.
    pub(crate) fn with_keys(keys: &[&str]) -> Option<Self> {
        let all = [Self::Scene, Self::Plan, Self::Station, Self::Target];
        all.into_iter().find(|kind| kind.keys().iter().any(|key| keys.contains(key)))
    }

    /// The error of a file of this kind where another is `wanted`, said with its article.
    pub fn in_place_of(self, path: impl AsRef<Path>, wanted: &str) -> ParseError {
        ParseError::new(path, self.name(), wanted).with_hint(self.advice())
    }
}

/// Returns the kind of a file; `None` where its content does not show it.
///
/// ```
/// use sunglint_formats::kind::{Kind, of};
///
/// assert_eq!(of(b"[target]\nbuilt_in = \"box_wing\"\n[times]\nstep_s = 1\n"), Some(Kind::Scene));
/// assert_eq!(of(b"time_utc,mag\n2024-01-01T00:00:00,7\n"), None);
/// ```
pub fn of(bytes: &[u8]) -> Option<Kind> {
    if let Some(kind) = of_bytes(bytes) {
        return Some(kind);
    }
    let text = std::str::from_utf8(bytes).ok()?.trim_start_matches('\u{feff}');
    let start = text.trim_start();
    if start.starts_with("# %ECSV") {
        let mut head = text.lines().take_while(|line| line.starts_with('#'));
        let is_curve = head.any(|line| line.contains("quantity:"));
        return Some(if is_curve { Kind::LightCurve } else { Kind::Table });
    }
    let begins = |tag: &str| start.get(..tag.len()).is_some_and(|s| s.eq_ignore_ascii_case(tag));
    if begins("<!doctype html") || begins("<html") {
        return Some(Kind::Html);
    }
    if begins("<svg") {
        return Some(Kind::Picture);
    }
    if is_elements(text) {
        return Some(Kind::Elements);
    }
    if text.len() > LONGEST_SETTINGS {
        return None;
    }
    if start.starts_with(['{', '[']) && serde_json::from_str::<serde::de::IgnoredAny>(start).is_ok()
    {
        // An OMM.
        let is_elements = start.contains("\"MEAN_MOTION\"");
        return Some(if is_elements { Kind::ElementsJson } else { Kind::Json });
    }
    of_toml(text)
}

/// The kind of what its first bytes show to be no text.
pub(crate) fn of_bytes(bytes: &[u8]) -> Option<Kind> {
    let begins = |tag: &[u8]| bytes.starts_with(tag);
    if begins(b"SIMPLE  =") {
        return Some(of_fits(bytes));
    }
    if begins(&[0x1f, 0x8b]) {
        return Some(Kind::Gzip);
    }
    if begins(b"\x89PNG") || begins(&[0xff, 0xd8, 0xff]) {
        return Some(Kind::Picture);
    }
    if begins(b"%PDF") {
        return Some(Kind::Pdf);
    }
    let binary: [&[u8]; 4] = [b"\x7fELF", b"MZ\x90", b"SQLite format 3", b"\x89HDF"];
    if binary.iter().any(|tag| begins(tag)) {
        return Some(Kind::Binary);
    }
    // UTF-16 has zeros, too, and a mark before them. A text with a zero or two is damaged, and its reader says where.
    let is_utf16 = begins(&[0xff, 0xfe]) || begins(&[0xfe, 0xff]);
    // Zeros at the end are room that was kept for more text.
    let end = bytes.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
    let head = &bytes[..end.min(4096)];
    let zeros = head.iter().filter(|b| **b == 0).count();
    (!is_utf16 && zeros > 0 && 32 * zeros >= head.len()).then_some(Kind::Binary)
}

/// Whether a FITS file holds a table: the word of its extension stands at the begin of a block of 2880 bytes.
fn of_fits(bytes: &[u8]) -> Kind {
    let is_table = |block: &[u8]| {
        block.starts_with(b"XTENSION= 'BINTABLE") || block.starts_with(b"XTENSION= 'TABLE")
    };
    // Packed images lie in tables.
    let is_packed = |block: &[u8]| block.chunks(80).any(|card| card.starts_with(b"ZIMAGE  ="));
    match bytes.chunks(2880).any(|block| is_table(block) && !is_packed(block)) {
        true => Kind::FitsTable,
        false => Kind::FitsImage,
    }
}

/// Whether a text begins with a set of two lines, with or without a name above.
fn is_elements(text: &str) -> bool {
    let lines: Vec<&str> =
        text.lines().map(str::trim_end).filter(|l| !l.is_empty()).take(3).collect();
    let is = |line: &str, number: &str| line.len() == 69 && line.starts_with(number);
    // Both name the same object.
    let number = |line: &str| line.as_bytes().get(2..7).map(<[u8]>::to_owned);
    let same = |pair: &[&str]| number(pair[0]) == number(pair[1]);
    lines.windows(2).any(|pair| is(pair[0], "1 ") && is(pair[1], "2 ") && same(pair))
}

fn of_toml(text: &str) -> Option<Kind> {
    let tree = DeTable::parse(text).ok()?.into_inner();
    if tree.is_empty() {
        return None;
    }
    let has = |key: &str| tree.contains_key(key);
    let is_table =
        |key: &str| tree.get(key).is_some_and(|v| matches!(v.get_ref(), DeValue::Table(_)));
    let any = |keys: &[&str]| keys.iter().any(|key| has(key));
    Some(if is_table("target") && any(&["orbit", "ephemeris", "times", "attitude"]) {
        Kind::Scene
    } else if any(&["visit", "counter"]) || has("camera") && !is_table("camera") {
        Kind::Plan
    } else if is_table("site") && any(&["channel", "telescope"]) {
        Kind::Station
    } else if has("part") {
        Kind::Target
    } else if has("material")
        && tree.keys().all(|key| ["material", "name", "note"].contains(&key.get_ref().as_ref()))
    {
        Kind::Material
    } else {
        Kind::Settings
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the smallest files of each kind, written here by the words of their formats.
    #[test]
    fn kinds_are_known_by_content() {
        let image = format!(
            "{:<80}{:<80}{:<80}{:<2640}",
            "SIMPLE  =                    T",
            "BITPIX  =                    8",
            "NAXIS   =                    0",
            "END"
        );
        let table = format!("{image}{:<80}{:<2800}", "XTENSION= 'BINTABLE'", "END");
        let packed = format!(
            "{image}{:<80}{:<80}{:<2720}",
            "XTENSION= 'BINTABLE'", "ZIMAGE  =                    T", "END"
        );
        let tle = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
        for (bytes, kind) in [
            (image.as_bytes(), Some(Kind::FitsImage)),
            (table.as_bytes(), Some(Kind::FitsTable)),
            (packed.as_bytes(), Some(Kind::FitsImage)),
            (tle.as_bytes(), Some(Kind::Elements)),
            (&format!("ISS\n{tle}").into_bytes(), Some(Kind::Elements)),
            (
                b"# %ECSV 1.0\n# ---\n# meta: {quantity: linear}\ntime_utc a\n",
                Some(Kind::LightCurve),
            ),
            (b"# %ECSV 1.0\n# ---\na b\n", Some(Kind::Table)),
            (b"{\"a\": 1}", Some(Kind::Json)),
            (b"[{\"a\": 1}]", Some(Kind::Json)),
            (b"[{\"OBJECT_NAME\": \"A\", \"MEAN_MOTION\": 15.5}]", Some(Kind::ElementsJson)),
            (b"time,mag\n1,2\n\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", None),
            (b"<!DOCTYPE html><html></html>", Some(Kind::Html)),
            (b"\x1f\x8b\x08\x00", Some(Kind::Gzip)),
            (b"\x89PNG\r\n", Some(Kind::Picture)),
            (b"abc\0def", Some(Kind::Binary)),
            (b"[[material]]\nname = \"x\"\n", Some(Kind::Material)),
            (
                b"name = \"x\"\n[[part]]\nshape = \"plate\"\n[[material]]\nname = \"y\"\n",
                Some(Kind::Target),
            ),
            (b"name = \"s\"\n[site]\nheight_m = 1\n[telescope]\n", Some(Kind::Station)),
            (b"station = \"ufo\"\n[[visit]]\nstar = \"Vega\"\n", Some(Kind::Plan)),
            (b"x = 1\n", Some(Kind::Settings)),
            // Tables and texts of others are left to their readers.
            (b"time,mag\n1,2\n", None),
            (b"# a comment\n", None),
            (b"", None),
            (b"\xff\xfet\0i\0", None),
        ] {
            assert_eq!(of(bytes), kind, "{}", String::from_utf8_lossy(bytes));
        }
    }
}
