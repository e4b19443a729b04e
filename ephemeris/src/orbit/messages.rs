//! Ephemerides of others: orbit ephemeris messages (OEM, CCSDS 502.0-B-3, in KVN and XML) and the predictions of the laser ranging
//! service (CPF versions 1 and 2).
//!
//! Times of an OEM may be in UTC, TAI, TT and GPS, exactly; in TDB, which stays within 2 ms of TT (IERS Conventions 2010, section 10.1) and is taken from it by the largest terms
//! of their difference, to 10 µs; in UT1, by the embedded table, to 1.1 ms (8 m of a low orbit).
//!
//! Rows are turned into the GCRS: from GCRF and ICRF as they are, from EME2000 by the frame bias (IAU 2000, 0.02″), from TEME as SGP4's, from
//! an ITRF by the Earth's rotation with the embedded UT1 and pole.

use super::EphemerisRow;
use super::propagation::teme_to_gcrs;
use super::tle::excerpt;
use glam::{DMat3, DVec3};
use hifitime::{Duration, Epoch};
use roxmltree::{Document, Node, ParsingOptions};
use std::path::Path;
use sunglint_formats::ParseError;
use sunglint_formats::time::{Scale, UtcDay, parse_in};
use sunglint_radiometry::sky::{EarthOrientation, OrientationOrigin, SkyFrame, TimeError};

/// Nodes of an XML document at most.
const MOST_NODES: u32 = 50_000_000;

/// A table of positions with the target's name and the line of each row.
pub(super) struct Positions {
    pub name: Option<String>,
    pub rows: Vec<EphemerisRow>,
    pub lines: Vec<u64>,
}

/// Returns true for an orbit ephemeris message or a laser ranging prediction.
pub(super) fn is_one(text: &str) -> bool {
    is_oem_kvn(text) || is_oem_xml(text) || is_cpf(text)
}

fn is_oem_kvn(text: &str) -> bool {
    text.trim_start().starts_with("CCSDS_OEM_VERS")
}

fn is_oem_xml(text: &str) -> bool {
    let end = text.char_indices().nth(4096).map_or(text.len(), |(at, _)| at);
    let head = text[..end].trim_start();
    head.starts_with('<') && (head.contains("<oem") || head.contains(":oem"))
}

fn is_cpf(text: &str) -> bool {
    let mut words = text.split_whitespace();
    let (first, second) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    first.eq_ignore_ascii_case("H1") && second.eq_ignore_ascii_case("CPF")
}

/// Reads any of them.
pub(super) fn read(path: &Path, text: &str) -> Result<Positions, ParseError> {
    if is_cpf(text) {
        cpf(path, text)
    } else if is_oem_xml(text) {
        oem_xml(path, text)
    } else {
        oem_kvn(path, text)
    }
}

/// Axes in which a file gives places.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Axes {
    Gcrs,
    Eme2000,
    Teme,
    Itrs,
}

impl Axes {
    fn named(name: &str) -> Option<Self> {
        let name = name.to_uppercase().replace(['-', '_', ' '], "");
        Some(match name.as_str() {
            "GCRF" | "GCRS" | "ICRF" | "ICRS" => Self::Gcrs,
            "EME2000" | "J2000" => Self::Eme2000,
            "TEME" | "TEMEOFDATE" => Self::Teme,
            _ if name.starts_with("ITRF") || name == "ITRS" => Self::Itrs,
            _ => return None,
        })
    }

    fn to_gcrs(
        self,
        epoch: Epoch,
        position: DVec3,
        velocity: Option<DVec3>,
    ) -> Result<EphemerisRow, String> {
        let frame = || {
            SkyFrame::new(epoch, EarthOrientation::embedded()).map_err(|error| error.to_string())
        };
        let turned = |by: DMat3| (by * position, velocity.map(|v| by * v));
        let (position_m, velocity_m_s) = match self {
            Self::Gcrs => (position, velocity),
            Self::Eme2000 => turned(bias().transpose()),
            Self::Teme => turned(teme_to_gcrs(&frame()?)),
            Self::Itrs => {
                let frame = frame()?;
                let velocity = velocity.map(|v| frame.gcrs_velocity_m_s(position, v));
                (frame.itrs_to_gcrs() * position, velocity)
            }
        };
        Ok(EphemerisRow { epoch, position_m, velocity_m_s })
    }
}

/// Rotation from the GCRS to the mean equator and equinox of J2000 (IERS Conventions 2010, eq. 5.21 and table 5.2b: δα₀ −14.6 mas, ξ₀
/// −16.617 mas, η₀ −6.8192 mas).
fn bias() -> DMat3 {
    const MAS: f64 = std::f64::consts::PI / 180.0 / 3600.0 / 1e3;
    let (da, xi, eta) = (-14.6 * MAS, -16.617 * MAS, -6.8192 * MAS);
    // To first order; the second is 1e-14.
    DMat3::from_cols(DVec3::new(1.0, -da, xi), DVec3::new(da, 1.0, eta), DVec3::new(-xi, -eta, 1.0))
}

/// Time system of a message.
#[derive(Debug, Clone, Copy, PartialEq)]
enum System {
    /// A scale that runs with atomic clocks.
    Clocks(Scale),
    /// The Earth's rotation: by the embedded table, to 1.1 ms.
    Ut1,
}

impl System {
    const NAMES: &str = "UTC, UT1, TAI, TT, TDB or GPS";

    fn named(name: &str) -> Option<Self> {
        match name.eq_ignore_ascii_case("UT1") {
            true => Some(Self::Ut1),
            false => Scale::named(name).map(Self::Clocks),
        }
    }

    /// The instant of a text in the system; else what was found and what was expected.
    fn instant(self, text: &str) -> Result<Epoch, (String, String)> {
        let scale = match self {
            Self::Clocks(scale) => scale,
            // The same digits in a scale without leap seconds, as UT1 has none.
            Self::Ut1 => Scale::Tai,
        };
        let epoch = parse_in(text, scale).map_err(|error| {
            let hint = error.hint.map_or(String::new(), |hint| format!(" ({hint})"));
            (error.found, format!("{}{hint}", error.expected))
        })?;
        if self != Self::Ut1 {
            return Ok(epoch);
        }
        let earth = EarthOrientation::embedded();
        let outside = |error: TimeError| (excerpt(text), error.to_string());
        // UT1 − TAI changes by some 1 ms a day: once more at the instant so found is exact.
        let mut tai = epoch;
        for _ in 0..2 {
            let at = earth.at(tai).map_err(outside)?;
            if matches!(at.origin, OrientationOrigin::Outside { .. }) {
                let expected = "a time in UTC: UT1 is not known then";
                return Err((excerpt(text), expected.to_owned()));
            }
            tai = epoch - Duration::from_seconds(at.ut1_minus_tai_s);
        }
        Ok(tai)
    }
}

/// Metadata of an OEM's one segment.
#[derive(Default)]
struct Meta {
    name: Option<String>,
    axes: Option<Axes>,
    system: Option<System>,
}

impl Meta {
    /// Takes a key; `Err` says what was expected.
    fn take(&mut self, key: &str, value: &str) -> Result<(), String> {
        match key {
            "OBJECT_NAME" => self.name = Some(value.to_owned()),
            "CENTER_NAME" if !value.eq_ignore_ascii_case("EARTH") => return Err("EARTH".into()),
            "REF_FRAME" => {
                let axes = Axes::named(value);
                let expected = "GCRF, ICRF, EME2000, TEME or an ITRF";
                self.axes = Some(axes.ok_or_else(|| expected.to_owned())?);
            }
            "TIME_SYSTEM" => {
                let system = System::named(value);
                self.system = Some(system.ok_or_else(|| System::NAMES.to_owned())?);
            }
            _ => {}
        }
        Ok(())
    }

    fn row(
        &self,
        when: &str,
        numbers: &[f64],
    ) -> Result<EphemerisRow, (&'static str, String, String)> {
        let missing = |key| (key, "no such key".to_owned(), "a value in the metadata".to_owned());
        let axes = self.axes.ok_or_else(|| missing("REF_FRAME"))?;
        let system = self.system.ok_or_else(|| missing("TIME_SYSTEM"))?;
        let epoch = system.instant(when).map_err(|(found, expected)| ("EPOCH", found, expected))?;
        let vector = |from: usize| match numbers.get(from..from + 3) {
            Some(&[x, y, z]) => Some(DVec3::new(x, y, z) * 1e3),
            _ => None,
        };
        let position = vector(0)
            .ok_or_else(|| ("X", "no place".to_owned(), "three numbers, km".to_owned()))?;
        axes.to_gcrs(epoch, position, vector(3))
            .map_err(|error| ("EPOCH", error, "an epoch with a known orientation".into()))
    }
}

const ONE_SEGMENT: &str = "one segment";
const SEGMENTS: &str = "between segments lies a manoeuvre, or another object: put the one that covers your time into a file of its own";

fn oem_kvn(path: &Path, text: &str) -> Result<Positions, ParseError> {
    let mut meta = Meta::default();
    let (mut rows, mut lines) = (Vec::new(), Vec::new());
    let (mut in_meta, mut in_covariance) = (false, false);
    for (index, line) in text.lines().enumerate() {
        let (number, line) = (index as u64 + 1, line.trim());
        let wrong =
            |found: String, expected: &str| ParseError::new(path, found, expected).at_line(number);
        if line.is_empty() || line.starts_with("COMMENT") || line.starts_with('#') {
            continue;
        }
        match line {
            "META_START" if !rows.is_empty() => {
                return Err(wrong("a second segment".into(), ONE_SEGMENT).with_hint(SEGMENTS));
            }
            "META_START" => in_meta = true,
            "META_STOP" => in_meta = false,
            "COVARIANCE_START" => in_covariance = true,
            "COVARIANCE_STOP" => in_covariance = false,
            _ if in_covariance => {}
            _ => {
                if let Some((key, value)) = line.split_once('=') {
                    let (key, value) = (key.trim(), value.trim());
                    if in_meta {
                        meta.take(key, value)
                            .map_err(|expected| wrong(excerpt(value), &expected).in_field(key))?;
                    }
                    continue;
                }
                let mut words = line.split_whitespace();
                let when = words.next().unwrap_or_default();
                let mut numbers = Vec::new();
                for word in words {
                    let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
                    numbers.push(value.ok_or_else(|| wrong(excerpt(word), "a finite number"))?);
                }
                if ![3, 6, 9].contains(&numbers.len()) {
                    let expected = "a time and 3, 6 or 9 numbers (km, km/s, km/s²)";
                    return Err(wrong(format!("{} numbers", numbers.len()), expected));
                }
                let row = meta
                    .row(when, &numbers)
                    .map_err(|(key, found, expected)| wrong(found, &expected).in_field(key))?;
                rows.push(row);
                lines.push(number);
            }
        }
    }
    Ok(Positions { name: meta.name, rows, lines })
}

fn oem_xml(path: &Path, text: &str) -> Result<Positions, ParseError> {
    let options =
        ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| {
        let line = u64::from(error.pos().row);
        ParseError::new(path, error.to_string(), "OEM in well-formed XML").at_line(line)
    })?;
    let line_of = |node: Node<'_, '_>| {
        1 + text.as_bytes()[..node.range().start].iter().filter(|&&b| b == b'\n').count() as u64
    };
    let wrong = |node: Node<'_, '_>, found: String, expected: &str| {
        let error = ParseError::new(path, found, expected).at_line(line_of(node));
        error.in_field(node.tag_name().name())
    };
    let mut segments = document.descendants().filter(|n| n.has_tag_name("segment"));
    let Some(segment) = segments.next() else {
        return Err(ParseError::new(path, "no segment", ONE_SEGMENT));
    };
    if let Some(second) = segments.next() {
        return Err(wrong(second, "a second segment".into(), ONE_SEGMENT).with_hint(SEGMENTS));
    }
    let text_of = |node: Node<'_, '_>| node.text().unwrap_or_default().trim().to_owned();
    let mut meta = Meta::default();
    for block in segment.children().filter(|n| n.has_tag_name("metadata")) {
        for node in block.children().filter(Node::is_element) {
            let value = text_of(node);
            meta.take(node.tag_name().name(), &value)
                .map_err(|expected| wrong(node, excerpt(&value), &expected))?;
        }
    }
    let (mut rows, mut starts) = (Vec::new(), Vec::new());
    for vector in segment.descendants().filter(|n| n.has_tag_name("stateVector")) {
        let (mut when, mut numbers) = (String::new(), Vec::new());
        for key in ["EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT"] {
            let Some(node) = vector.children().find(|n| n.has_tag_name(key)) else {
                if numbers.len() == 3 {
                    break;
                }
                return Err(wrong(vector, format!("no {key}"), "EPOCH, X, Y, Z, and velocities"));
            };
            let value = text_of(node);
            if key == "EPOCH" {
                when = value;
                continue;
            }
            let number = value.parse::<f64>().ok().filter(|v| v.is_finite());
            numbers.push(number.ok_or_else(|| wrong(node, excerpt(&value), "a finite number"))?);
        }
        let row = meta
            .row(&when, &numbers)
            .map_err(|(key, found, expected)| wrong(vector, found, &expected).in_field(key))?;
        rows.push(row);
        starts.push(vector.range().start);
    }
    // Lines in one go: the vectors stand in the order of the text.
    let (mut lines, mut line, mut from) = (Vec::with_capacity(starts.len()), 1, 0);
    for start in starts {
        line += text.as_bytes()[from..start].iter().filter(|&&b| b == b'\n').count() as u64;
        from = start;
        lines.push(line);
    }
    Ok(Positions { name: meta.name, rows, lines })
}

/// Consolidated laser ranging prediction format, versions 1.01 (2006) and 2.00 (2018): header records H1 and H2, positions in records 10
/// (m), velocities in records 20 (m/s).
fn cpf(path: &Path, text: &str) -> Result<Positions, ParseError> {
    let (mut name, mut axes) = (None, None);
    let (mut rows, mut lines) = (Vec::<(Epoch, DVec3, Option<DVec3>)>::new(), Vec::new());
    for (index, line) in text.lines().enumerate() {
        let number = index as u64 + 1;
        let wrong = |field: &str, found: String, expected: &str| {
            ParseError::new(path, found, expected).at_line(number).in_field(field)
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some(kind) = words.first() else { continue };
        let float = |at: usize, field: &str| {
            let word = words.get(at).copied().unwrap_or_default();
            let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
            value.ok_or_else(|| wrong(field, excerpt(word), "a finite number"))
        };
        match kind.to_uppercase().as_str() {
            "H1" => {
                let version = float(2, "version")?;
                if !(1.0..3.0).contains(&version) {
                    return Err(wrong("version", format!("{version}"), "1 or 2"));
                }
                let place = if version < 2.0 { 9 } else { 10 };
                name = words.get(place).map(|name| (*name).to_owned());
            }
            "H2" => {
                axes = Some(match words.get(19).copied() {
                    Some("0") => Axes::Itrs,
                    Some("2") => Axes::Eme2000,
                    other => {
                        let expected = "0 (body-fixed) or 2 (mean of J2000)";
                        let found = excerpt(other.unwrap_or_default());
                        return Err(wrong("reference frame (H2)", found, expected));
                    }
                });
            }
            "10" => {
                if words.get(1).copied() != Some("0") {
                    let found = excerpt(words.get(1).copied().unwrap_or_default());
                    return Err(wrong("direction flag", found, "0: places at one epoch"));
                }
                let (day, seconds) = (float(2, "MJD")?, float(3, "seconds of day")?);
                let start = (day.fract() == 0.0).then(|| UtcDay::of_mjd(day as i64)).flatten();
                let Some(start) = start.filter(|_| (0.0..86_401.0).contains(&seconds)) else {
                    let found = format!("{day} {seconds}");
                    let expected = "a whole day from 41317 (1972) to 2100, and 0 to 86400 s";
                    return Err(wrong("MJD and seconds of day", found, expected));
                };
                let since = (seconds * 1e9).round() as i128;
                let epoch = Epoch::from_tai_duration(Duration::from_total_nanoseconds(
                    start.start_tai_ns + since,
                ));
                let position = DVec3::new(float(5, "x")?, float(6, "y")?, float(7, "z")?);
                rows.push((epoch, position, None));
                lines.push(number);
            }
            "20" => {
                let velocity = DVec3::new(float(2, "vx")?, float(3, "vy")?, float(4, "vz")?);
                match rows.last_mut() {
                    Some((.., own)) if own.is_none() => *own = Some(velocity),
                    _ => {
                        let expected = "a velocity after the position that it belongs to";
                        return Err(wrong("record 20", "a velocity alone".into(), expected));
                    }
                }
            }
            _ => {}
        }
    }
    let Some(axes) = axes else {
        let expected = "a header H2, which names the reference frame";
        return Err(ParseError::new(path, "no H2", expected));
    };
    let turned = rows.into_iter().zip(&lines).map(|((epoch, position, velocity), line)| {
        axes.to_gcrs(epoch, position, velocity).map_err(|error| {
            ParseError::new(path, error, "an epoch with a known orientation").at_line(*line)
        })
    });
    Ok(Positions { name, rows: turned.collect::<Result<_, _>>()?, lines })
}
