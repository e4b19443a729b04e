//! Laser ranges as stations deliver them: the Consolidated Laser Ranging Data Format (CRD) of the ILRS, versions 1 and 2.
//!
//! A file is lines of fields by blanks, the first the record's name, in any case. Read here are `H1` to `H4`, `H8`, `H9`, `10` (full rate), `11` (normal point), `20`
//! (weather) and `30` (pointing); all other records are kept as they stand ([`Record::Other`]), and so are fields beyond those of the format ([`Line::rest`]): nothing is
//! lost. `na` stands for what is not known.
//!
//! The order of the fields is that of the ILRS's own sample program (R. Ricklefs, `read_crd`, v2.01b) and of the format's sample files, which were read; the columns of `H2`
//! and `H3` of version 1 are from the program. The specification's text itself was not at hand. Seconds are of the day of UTC, and begin again at midnight.

use crate::error::{EncodeError, FileError, ParseError, excerpt};
use std::fmt::Write as _;
use std::path::Path;

/// A file.
#[derive(Debug, Clone, PartialEq)]
pub struct Crd {
    /// Version that the first header names, 1 or 2.
    pub version: u8,
    /// Lines in their order, without empty ones.
    pub lines: Vec<Line>,
}

/// A line of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Record that it holds.
    pub record: Record,
    /// Fields behind those that the format gives this record; they are written as they stood.
    pub rest: Vec<String>,
}

impl From<Record> for Line {
    fn from(record: Record) -> Self {
        Self { record, rest: Vec::new() }
    }
}

/// A record of a file.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// `H1`: year, month, day and hour of UTC when the file was made.
    Made([u16; 4]),
    /// `H2`: the station.
    Station(Station),
    /// `H3`: the target.
    Target(Target),
    /// `H4`: begin of a session.
    Session(Session),
    /// `10`: a shot.
    Shot(Shot),
    /// `11`: a normal point.
    NormalPoint(NormalPoint),
    /// `20`: the air at the station.
    Weather(Weather),
    /// `30`: where the telescope points.
    Pointing(Pointing),
    /// `H8`: end of a session.
    EndOfSession,
    /// `H9`: end of the file.
    EndOfFile,
    /// Any other record, as it stands.
    Other(String),
}

/// `H2`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Station {
    /// Name, at most 10 characters.
    pub name: String,
    /// Number of the pad, of the system and of the occupancy, then the time scale.
    pub numbers: [i64; 4],
    /// Network; `None` in version 1.
    pub network: Option<String>,
}

/// `H3`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Target {
    /// Name, at most 10 characters.
    pub name: String,
    /// Number of the ILRS, the SIC and NORAD's, `None` where there is none.
    pub numbers: [Option<i64>; 3],
    /// Time scale of a transponder, then class (type in version 1).
    pub kinds: [i64; 2],
    /// Where it is; `None` in version 1, and where it is not known.
    pub place: Option<i64>,
}

/// `H4`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Session {
    /// 0 full rate, 1 normal points, 2 sampled.
    pub data: i64,
    /// Year, month, day, hour, minute, second of its begin.
    pub from: [i64; 6],
    /// The same of its end; -1 or `None` where unknown.
    pub to: [Option<i64>; 6],
    /// Release; then whether refraction, centre of mass, amplitude, the station's and the target's delay are applied; the range's type (2: two ways); quality.
    pub flags: [i64; 8],
}

/// `10`.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Second of the day.
    pub second_s: f64,
    /// Time of flight, s.
    pub flight_s: f64,
    /// Name of the system's configuration.
    pub configuration: String,
    /// Event that the second is of (2: the station's transmission, 1: at the target), filter (0 unknown, 1 noise, 2 data), channel, stop.
    pub flags: [i64; 4],
    /// Amplitude received, and sent (version 2).
    pub amplitudes: [Option<f64>; 2],
}

/// `11`.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalPoint {
    /// Second of the day.
    pub second_s: f64,
    /// Time of flight, s.
    pub flight_s: f64,
    /// Name of the system's configuration.
    pub configuration: String,
    /// Event that the second is of.
    pub event: i64,
    /// Length of the bin, s.
    pub bin_s: Option<f64>,
    /// Number of shots in it.
    pub shots: i64,
    /// Root mean square (ps), skewness, kurtosis, peak less mean (ps), rate of returns (%).
    pub statistics: [Option<f64>; 5],
    /// Channel of the detector.
    pub channel: Option<i64>,
    /// Signal to noise; version 2.
    pub signal_to_noise: Option<f64>,
}

/// `20`.
#[derive(Debug, Clone, PartialEq)]
pub struct Weather {
    /// Second of the day.
    pub second_s: f64,
    /// Pressure (hPa), temperature (K), relative humidity (%).
    pub air: [Option<f64>; 3],
    /// 0 measured, 1 interpolated.
    pub origin: i64,
}

/// `30`.
#[derive(Debug, Clone, PartialEq)]
pub struct Pointing {
    /// Second of the day.
    pub second_s: f64,
    /// From north by east, degrees.
    pub azimuth_deg: f64,
    /// Above the horizon, degrees.
    pub elevation_deg: f64,
    /// Direction, origin, refraction corrected.
    pub flags: [i64; 3],
    /// Rates of both, degrees per second; version 2.
    pub rates: [Option<f64>; 2],
}

/// The fields of a line, taken in order.
struct Fields<'a> {
    path: &'a Path,
    line: u64,
    record: &'a str,
    words: Vec<&'a str>,
    at: usize,
}

impl<'a> Fields<'a> {
    fn error(&self, name: &str, found: &str, expected: &str) -> ParseError {
        ParseError::new(self.path, found, expected)
            .at_line(self.line)
            .in_field(format!("{} {name}", self.record))
    }

    fn word(&mut self, name: &str) -> Result<&'a str, ParseError> {
        let word = self.words.get(self.at).copied();
        self.at += 1;
        word.ok_or_else(|| self.error(name, "the end of the line", "one field more"))
    }

    fn integer(&mut self, name: &str) -> Result<i64, ParseError> {
        let word = self.word(name)?;
        word.parse().map_err(|_| self.error(name, &excerpt(word), "a whole number"))
    }

    fn integers<const N: usize>(&mut self, name: &str) -> Result<[i64; N], ParseError> {
        let mut all = [0; N];
        for one in &mut all {
            *one = self.integer(name)?;
        }
        Ok(all)
    }

    /// A whole number or `na`.
    fn maybe_integer(&mut self, name: &str) -> Result<Option<i64>, ParseError> {
        if self.words.get(self.at).is_some_and(|w| is_na(w)) {
            self.at += 1;
            return Ok(None);
        }
        self.integer(name).map(Some)
    }

    fn number(&mut self, name: &str) -> Result<f64, ParseError> {
        let word = self.word(name)?;
        let number = word.parse::<f64>().ok().filter(|n| n.is_finite());
        number.ok_or_else(|| self.error(name, &excerpt(word), "a number"))
    }

    /// A number, `na`, or the line's end where `optional`.
    fn maybe(&mut self, name: &str, optional: bool) -> Result<Option<f64>, ParseError> {
        match self.words.get(self.at) {
            Some(word) if is_na(word) => {
                self.at += 1;
                Ok(None)
            }
            None if optional => Ok(None),
            _ => self.number(name).map(Some),
        }
    }

    fn second(&mut self) -> Result<f64, ParseError> {
        let second_s = self.number("second of day")?;
        if (0.0..86_401.0).contains(&second_s) {
            return Ok(second_s);
        }
        Err(self.error("second of day", &second_s.to_string(), "0 to 86401 s"))
    }

    /// A name: the first field, or columns 4 to 13 in a file of version 1 whose `numbers` stand behind a blank there. That name may hold blanks; but files of version 1
    /// in free format are about, too.
    fn name(&mut self, text: &'a str, version: u8, numbers: usize) -> Result<String, ParseError> {
        let fixed = || {
            let (name, rest) = (text.get(3..13)?.trim(), text.get(13..)?);
            let words: Vec<&str> = rest.split_whitespace().collect();
            let whole = |w: &&str| w.parse::<i64>().is_ok() || is_na(w);
            let good = rest.starts_with(char::is_whitespace)
                && words.len() >= numbers
                && words[..numbers].iter().all(whole);
            (good && !name.is_empty()).then_some((name, words))
        };
        let Some((name, words)) = fixed().filter(|_| version == 1) else {
            return self.word("name").map(str::to_owned);
        };
        (self.words, self.at) = (words, 0);
        Ok(name.split_whitespace().collect::<Vec<_>>().join(" "))
    }
}

fn is_na(word: &str) -> bool {
    word.trim_start_matches('-').eq_ignore_ascii_case("na")
}

/// Reads a file from text; `path` names it in errors.
///
/// # Errors
/// A [`ParseError`] with line and field: no `H1` in front, another version, a field that is missing or none, ranges outside a session.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<Crd, ParseError> {
    read_str_at(path.as_ref(), text)
}

fn read_str_at(path: &Path, text: &str) -> Result<Crd, ParseError> {
    let (mut version, mut lines, mut in_session) = (None, Vec::new(), false);
    for (line, text) in (1..).zip(text.lines()) {
        let text = text.trim();
        let mut words = text.split_whitespace();
        let Some(record) = words.next() else { continue };
        let mut f = Fields { path, line, record, words: words.collect(), at: 0 };
        let name = record.to_ascii_uppercase();
        if name == "H1" {
            let literal = f.word("literal")?;
            if !literal.eq_ignore_ascii_case("CRD") {
                return Err(f.error("literal", &excerpt(literal), "`CRD`"));
            }
            let found = f.integer("version")?;
            let known = u8::try_from(found).ok().filter(|v| matches!(v, 1 | 2));
            let known = known.ok_or_else(|| f.error("version", &found.to_string(), "1 or 2"))?;
            if version.is_some_and(|first| first != known) {
                return Err(f.error("version", &found.to_string(), "that of the first header"));
            }
            version = Some(known);
        } else if version.is_none() && name != "00" {
            return Err(f.error("", &excerpt(text), "the header `H1 CRD`"));
        }
        let v = version.unwrap_or(2);
        if matches!(name.as_str(), "10" | "11") && !in_session {
            return Err(f.error("", &excerpt(text), "`H4` before ranges"));
        }
        match name.as_str() {
            "H4" => in_session = true,
            "H8" => in_session = false,
            _ => {}
        }
        let record = record_of(&mut f, &name, text, v)?;
        let rest = match &record {
            Record::Other(_) => Vec::new(),
            _ => f.words.iter().skip(f.at).map(|w| (*w).to_owned()).collect(),
        };
        lines.push(Line { record, rest });
    }
    let version =
        version.ok_or_else(|| ParseError::new(path, "no header", "the header `H1 CRD`"))?;
    Ok(Crd { version, lines })
}

/// Reads a file of at most 512 MiB.
///
/// # Errors
/// A file that cannot be read; the errors of [`read_str`].
pub fn read(path: impl AsRef<Path>) -> Result<Crd, FileError> {
    let path = path.as_ref();
    Ok(read_str(path, &crate::read::text(path)?)?)
}

fn record_of<'a>(
    f: &mut Fields<'a>,
    name: &str,
    text: &'a str,
    v: u8,
) -> Result<Record, ParseError> {
    let v1 = v == 1;
    Ok(match name {
        "H1" => {
            let mut made = [0; 4];
            for part in &mut made {
                let n = f.integer("date")?;
                *part = u16::try_from(n)
                    .map_err(|_| f.error("date", &n.to_string(), "year, month, day and hour"))?;
            }
            Record::Made(made)
        }
        "H2" => Record::Station(Station {
            name: f.name(text, v, 4)?,
            numbers: f.integers("numbers")?,
            network: if v1 { None } else { Some(f.word("network")?.to_owned()) },
        }),
        "H3" => Record::Target(Target {
            name: f.name(text, v, 5)?,
            numbers: [f.maybe_integer("ILRS")?, f.maybe_integer("SIC")?, f.maybe_integer("NORAD")?],
            kinds: f.integers("time scale and class")?,
            place: if v1 { None } else { f.maybe_integer("place")? },
        }),
        "H4" => {
            let (data, from) = (f.integer("data")?, f.integers("begin")?);
            let mut to = [None; 6];
            for part in &mut to {
                *part = f.maybe_integer("end")?;
            }
            Record::Session(Session { data, from, to, flags: f.integers("flags")? })
        }
        "10" => Record::Shot(Shot {
            second_s: f.second()?,
            flight_s: f.number("time of flight")?,
            configuration: f.word("configuration")?.to_owned(),
            flags: f.integers("flags")?,
            amplitudes: [f.maybe("amplitude", false)?, f.maybe("amplitude sent", true)?],
        }),
        "11" => Record::NormalPoint(NormalPoint {
            second_s: f.second()?,
            flight_s: f.number("time of flight")?,
            configuration: f.word("configuration")?.to_owned(),
            event: f.integer("event")?,
            bin_s: f.maybe("bin", false)?,
            shots: f.integer("shots")?,
            statistics: [
                f.maybe("rms", false)?,
                f.maybe("skewness", false)?,
                f.maybe("kurtosis", false)?,
                f.maybe("peak", false)?,
                f.maybe("rate of returns", false)?,
            ],
            channel: f.maybe_integer("channel")?,
            signal_to_noise: f.maybe("signal to noise", v1)?,
        }),
        "20" => Record::Weather(Weather {
            second_s: f.second()?,
            air: [
                f.maybe("pressure", false)?,
                f.maybe("temperature", false)?,
                f.maybe("humidity", false)?,
            ],
            origin: f.integer("origin")?,
        }),
        "30" => Record::Pointing(Pointing {
            second_s: f.second()?,
            azimuth_deg: f.number("azimuth")?,
            elevation_deg: f.number("elevation")?,
            flags: f.integers("flags")?,
            rates: [f.maybe("azimuth rate", true)?, f.maybe("elevation rate", true)?],
        }),
        "H8" => Record::EndOfSession,
        "H9" => Record::EndOfFile,
        _ => Record::Other(text.to_owned()),
    })
}

fn list<T: ToString>(all: &[T]) -> String {
    all.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

fn na<T: ToString>(all: &[Option<T>]) -> String {
    let one = |v: &Option<T>| v.as_ref().map_or_else(|| "na".to_owned(), T::to_string);
    all.iter().map(one).collect::<Vec<_>>().join(" ")
}

/// Writes a file of version 2, whatever version it was read from. Seconds and times of flight keep every digit.
///
/// # Errors
/// A name that is empty or holds blanks, which version 2 cannot tell apart.
pub fn to_string(crd: &Crd) -> Result<String, EncodeError> {
    let word = |field: &str, text: &str| {
        let good = !text.is_empty() && !text.contains(char::is_whitespace);
        let bad = || EncodeError::new(field, excerpt(text), "a name without blanks");
        if good { Ok(text.to_owned()) } else { Err(bad()) }
    };
    let mut out = String::new();
    let old = crd.version == 1;
    for Line { record, rest } in &crd.lines {
        let mut line = match record {
            Record::Made(date) => format!("H1 CRD 2 {}", list(date)),
            Record::Station(s) => {
                let network = word("H2 network", s.network.as_deref().unwrap_or("na"))?;
                format!("H2 {} {} {network}", word("H2 name", &s.name)?, list(&s.numbers))
            }
            Record::Target(t) => {
                // The old type 2 was a reflector on the Moon (place 3); place 1 is about the Earth.
                let [scale, class] = t.kinds;
                let (class, place) = match t.place {
                    Some(place) => (class, Some(place)),
                    None if old && class == 2 => (1, Some(3)),
                    None if old => (class, Some(1)),
                    None => (class, None),
                };
                let (name, place) = (word("H3 name", &t.name)?, na(&[place]));
                format!("H3 {name} {} {scale} {class} {place}", na(&t.numbers))
            }
            Record::Session(s) => {
                format!("H4 {} {} {} {}", s.data, list(&s.from), na(&s.to), list(&s.flags))
            }
            Record::Shot(s) => {
                let name = word("10 configuration", &s.configuration)?;
                let (flags, amplitudes) = (list(&s.flags), na(&s.amplitudes));
                format!("10 {} {} {name} {flags} {amplitudes}", s.second_s, s.flight_s)
            }
            Record::NormalPoint(p) => format!(
                "11 {} {} {} {} {} {} {} {} {}",
                p.second_s,
                p.flight_s,
                word("11 configuration", &p.configuration)?,
                p.event,
                na(&[p.bin_s]),
                p.shots,
                na(&p.statistics),
                na(&[p.channel]),
                na(&[p.signal_to_noise])
            ),
            Record::Weather(w) => format!("20 {} {} {}", w.second_s, na(&w.air), w.origin),
            Record::Pointing(p) => format!(
                "30 {} {} {} {} {}",
                p.second_s,
                p.azimuth_deg,
                p.elevation_deg,
                list(&p.flags),
                na(&p.rates)
            ),
            Record::EndOfSession => "H8".to_owned(),
            Record::EndOfFile => "H9".to_owned(),
            Record::Other(line) if line.contains('\n') => {
                return Err(EncodeError::new("other record", excerpt(line), "one line"));
            }
            Record::Other(line) => line.clone(),
        };
        for field in rest {
            line.push(' ');
            line.push_str(&word("rest", field)?);
        }
        let _ = writeln!(out, "{line}");
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Synthetic, in the form of the format's samples.
    const V2: &str = "h1 CRD 2 2026 3 4 5\nH2 GRAZ 7839 34 2 4 ILRS\nh3 lageos1 7603901 1155 8820 0 1 1\n\
        h4 1 2026 3 4 1 2 3 2026 3 4 na na na 0 0 0 0 1 0 2 0\nc0 0 532.000 std\n\
        20 3723.5 960.10 275.25 50. 0\n30 3723.5 120.25 45.5 0 1 1 na na\n\
        10 3723.500000012 0.045123456789 std 2 2 0 0 na na\n\
        11 3723.5 0.045123456789 std 2 120 18 94.0 na -na -3.5 12.5 0 7.5\n91 user's own\nH8\nH9\n";

    fn refused(text: &str) -> String {
        read_str("a.crd", text).unwrap_err().to_string()
    }

    /// Truth: the text above, by hand.
    #[test]
    fn fields_are_where_the_format_has_them() {
        let crd = read_str("a.crd", V2).unwrap();
        assert_eq!((crd.version, crd.lines.len()), (2, 12));
        let Record::Shot(shot) = &crd.lines[7].record else { panic!("{:?}", crd.lines[7]) };
        assert_eq!((shot.second_s, shot.flight_s), (3723.500000012, 0.045123456789));
        assert_eq!((shot.flags, shot.amplitudes), ([2, 2, 0, 0], [None, None]));
        let Record::NormalPoint(point) = &crd.lines[8].record else { panic!("{:?}", crd.lines[8]) };
        assert_eq!((point.bin_s, point.shots, point.channel), (Some(120.0), 18, Some(0)));
        assert_eq!(point.statistics, [Some(94.0), None, None, Some(-3.5), Some(12.5)]);
        assert_eq!(point.signal_to_noise, Some(7.5));
        let Record::Weather(air) = &crd.lines[5].record else { panic!("{:?}", crd.lines[5]) };
        assert_eq!(air.air, [Some(960.1), Some(275.25), Some(50.0)]);
        assert_eq!(crd.lines[9].record, Record::Other("91 user's own".into()));
        assert_eq!(read_str("a.crd", &to_string(&crd).unwrap()).unwrap(), crd);
    }

    /// Truth: the columns of version 1, where a name may hold a blank; the old type 2 is class 1 on the Moon.
    #[test]
    fn version_1_has_names_in_columns() {
        let text = "H1 CRD  1 2009  5 10  7\nH2 TWO NAMES  7840 35  1  4\nH3 apollo15     103  103    0 0 2\n";
        let mut crd = read_str("a.crd", text).unwrap();
        let Record::Station(station) = &mut crd.lines[1].record else { panic!() };
        assert_eq!((station.name.as_str(), station.numbers), ("TWO NAMES", [7840, 35, 1, 4]));
        station.name = "ONE".into();
        assert!(to_string(&crd).unwrap().ends_with("H3 apollo15 103 103 0 0 1 3\n"));
        let error = to_string(&read_str("a.crd", text).unwrap()).unwrap_err().to_string();
        assert_eq!(error, "H2 name: found `TWO NAMES`, expected a name without blanks");
    }

    /// Truth: by hand. Fields behind those of the format stay where they are; a name of version 1 in free format ends at its blank, as in sample 6.7 of the specification 2.01
    /// (`H2 HERL 7840 35 01 04 EUROLAS` under `H1 CRD 01`).
    #[test]
    fn nothing_is_dropped() {
        let text = V2.replace(" 0 0 na na\n11", " 0 0 na 7 more 1e5\n11").replace("H8\n", "H8 x\n");
        let crd = read_str("a.crd", &text).unwrap();
        assert_eq!(crd.lines[7].rest, ["more", "1e5"]);
        assert_eq!(crd.lines[10].rest, ["x"]);
        let written = to_string(&crd).unwrap();
        assert!(written.contains("std 2 2 0 0 na 7 more 1e5\n"), "{written}");
        assert_eq!(read_str("a.crd", &written).unwrap(), crd);

        let text = "H1 CRD 01 2009 5 10 7\nH2 HERL 7840 35 01 04 EUROLAS\nH3 Ajisai 8606101 1500 16908 0 1 1\n";
        let crd = read_str("a.crd", text).unwrap();
        let Record::Station(station) = &crd.lines[1].record else { panic!() };
        assert_eq!((station.name.as_str(), station.numbers), ("HERL", [7840, 35, 1, 4]));
        assert_eq!(crd.lines[1].rest, ["EUROLAS"]);
        let Record::Target(target) = &crd.lines[2].record else { panic!() };
        assert_eq!(target.numbers, [Some(8_606_101), Some(1500), Some(16_908)]);
        assert_eq!((target.name.as_str(), target.kinds), ("Ajisai", [0, 1]));
        // A place that is not known.
        let unknown = V2.replace("8820 0 1 1", "8820 0 1 na");
        let crd = read_str("a.crd", &unknown).unwrap();
        assert_eq!(read_str("a.crd", &to_string(&crd).unwrap()).unwrap(), crd);
    }

    /// Truth: samples 6.1, 6.2 and 6.5 of the specification 2.01, as the test files of Orekit have them (`crd201_all_samples`): their numbers by hand.
    #[test]
    fn lines_of_the_specification() {
        let text = "H1 CRD 2 2007 3 20 14\nH2 MLRS 7080 24 19 4 NASA\nH3 LAGEOS2 9207002 5986 22195 0 1 1\n\
            H4 0 2006 11 13 15 23 52 2006 11 13 15 45 35 1 1 1 1 0 0 2 0\nC0 0 532.000 std1\n\
            10 55432.0414338 0.047960587856 std1 2 0 0 0 na na\n12 55432.0414338 std1 20735.0 1601.0000 0.00 0.0000 0.0000\n\
            20 55432.0414338 801.80 28.21 39 0\n30 55432.0414338 297.2990 38.6340 0 2 1 na na\n\
            11 3104.347543373788 0.010760099652 std 2 15 2 108.7 0.354 -2.750 -73.5 1.33 0 21.3\n\
            21 3152.000 2 80 fog 20  na 3 10 298.43\nH8\n";
        let crd = read_str("a.crd", text).unwrap();
        assert!(crd.lines.iter().all(|l| l.rest.is_empty()));
        let records: Vec<&Record> = crd.lines.iter().map(|l| &l.record).collect();
        let station = Station {
            name: "MLRS".into(),
            numbers: [7080, 24, 19, 4],
            network: Some("NASA".into()),
        };
        assert_eq!(records[1], &Record::Station(station));
        let session = Session {
            data: 0,
            from: [2006, 11, 13, 15, 23, 52],
            to: [2006, 11, 13, 15, 45, 35].map(Some),
            flags: [1, 1, 1, 1, 0, 0, 2, 0],
        };
        assert_eq!(records[3], &Record::Session(session));
        let shot = Shot {
            second_s: 55_432.041_433_8,
            flight_s: 0.047_960_587_856,
            configuration: "std1".into(),
            flags: [2, 0, 0, 0],
            amplitudes: [None, None],
        };
        assert_eq!(records[5], &Record::Shot(shot));
        let pointing = Pointing {
            second_s: 55_432.041_433_8,
            azimuth_deg: 297.299,
            elevation_deg: 38.634,
            flags: [0, 2, 1],
            rates: [None, None],
        };
        assert_eq!(records[8], &Record::Pointing(pointing));
        let point = NormalPoint {
            second_s: 3_104.347_543_373_788,
            flight_s: 0.010_760_099_652,
            configuration: "std".into(),
            event: 2,
            bin_s: Some(15.0),
            shots: 2,
            statistics: [108.7, 0.354, -2.75, -73.5, 1.33].map(Some),
            channel: Some(0),
            signal_to_noise: Some(21.3),
        };
        assert_eq!(records[9], &Record::NormalPoint(point));
        assert_eq!(records[10], &Record::Other("21 3152.000 2 80 fog 20  na 3 10 298.43".into()));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line_and_field() {
        assert!(refused("").contains("the header `H1 CRD`"));
        assert!(
            refused("H1 CRD 2 2026 1 1 1\nH1 CRD 1 2026 1 1 1").starts_with("a.crd:2: H1 version")
        );
        assert!(refused("H1 CRD 2 2026 1 1 1\nH4 0 2026 1").starts_with("a.crd:2: H4 begin"));
        assert!(refused("H1 CRD 2 2026 1 1 99999999999999999999").contains("H1 date"));
        assert!(refused(&V2.replace("11 3723.5", "11 1e999")).contains("11 second of day"));
        assert!(refused(&V2.replace("std 2 120 18", "std 2 120 1.5")).contains("11 shots"));
        assert!(
            refused("H1 CRD 1 2026 1 1 1\nH2 \u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}")
                .starts_with("a.crd:2: H2")
        );
        assert!(refused("H1 CRD 2 2026 1 1 70000").contains("year, month, day and hour"));
        assert!(
            refused(&V2.replace("0.045123456789 std 2 2", "NaN std 2 2")).contains("found `NaN`")
        );
        assert!(refused("10 1 2 std").starts_with("a.crd:1: 10 "));
        assert!(refused("H1 CRD 3 2026 1 1 1").contains("H1 version: found 3, expected 1 or 2"));
        let error = refused(&V2.replace("0.045123456789 std 2 2", "x std 2 2"));
        assert_eq!(error, "a.crd:8: 10 time of flight: found `x`, expected a number");
        let error = refused(&V2.replace("20 3723.5", "20 90000"));
        assert_eq!(error, "a.crd:6: 20 second of day: found 90000, expected 0 to 86401 s");
        assert!(refused(&V2.replace(" 0 7.5", " 0")).contains("a.crd:9: 11 signal to noise"));
        assert!(refused(&V2.replace("h4 1 ", "c9 1 ")).contains("`H4` before ranges"));
    }
}
