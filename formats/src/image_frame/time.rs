//! When the light of a frame fell, and for how long, from the cards that programs write.

use super::{FrameTime, Reading};
use crate::error::ParseError;
use crate::fits::CardValue;
use crate::time::{Scale, UtcError, format_utc, moment, parse_in, parse_zoned};
use hifitime::{Epoch, Unit};

/// Moment of an exposure that a card names.
#[derive(Debug, Clone, Copy, PartialEq)]
enum At {
    Begin,
    Middle,
    End,
}

impl At {
    /// Halves of the exposure from the card's moment to the middle, and the words for it.
    fn to_middle(self) -> (f64, &'static str) {
        match self {
            Self::Begin => (1.0, "plus half of the exposure"),
            Self::Middle => (0.0, ""),
            Self::End => (-1.0, "minus half of the exposure"),
        }
    }

    /// The moment that a comment such as `end of exposure (UTC)` names.
    fn of_comment(comment: &str) -> Option<Self> {
        let lower = comment.to_ascii_lowercase();
        let words: Vec<&str> = lower.split(|c: char| !c.is_ascii_alphanumeric()).collect();
        let has = |all: &[&str]| words.iter().any(|w| all.contains(w));
        if lower.contains("frame grabbed") {
            return Some(Self::End);
        }
        // `start and end` says neither.
        if has(&["start", "begin", "begins", "beginning", "started", "starting"]) {
            return Some(Self::Begin);
        }
        if has(&["mid", "middle", "midpoint", "midexposure", "midtime", "center", "centre"]) {
            return Some(Self::Middle);
        }
        has(&["end", "ends", "ended", "ending", "finish", "finished"]).then_some(Self::End)
    }
}

/// Seconds of a unit; `None` of a word that is none.
fn unit_s(word: &str) -> Option<f64> {
    Some(match word.trim().trim_end_matches('.').to_ascii_lowercase().as_str() {
        "s" | "sec" | "secs" | "second" | "seconds" => 1.0,
        "ms" | "msec" | "msecs" | "millisec" | "millisecond" | "milliseconds" => 1e-3,
        "us" | "usec" | "microsec" | "microsecond" | "microseconds" => 1e-6,
        "ns" | "nsec" | "nanosecond" | "nanoseconds" => 1e-9,
        "min" | "mins" | "minute" | "minutes" => 60.0,
        "h" | "hr" | "hrs" | "hour" | "hours" => 3600.0,
        "d" | "day" | "days" => 86_400.0,
        _ => return None,
    })
}

/// Seconds of the unit that a comment names: in brackets as the standard asks for, or as a word that means nothing else.
fn comment_unit_s(comment: &str) -> Option<f64> {
    let bracketed = comment.split(['[', '(']).skip(1);
    let bracketed = bracketed.filter_map(|rest| unit_s(rest.split([']', ')']).next()?));
    let mut words = comment.split(|c: char| !c.is_ascii_alphabetic());
    bracketed.into_iter().next().or_else(|| {
        words.find_map(|w| unit_s(w).filter(|_| w.len() >= 4 || matches!(w, "ms" | "sec" | "us")))
    })
}

/// Words for a civil time in a comment.
const LOCAL: [&str; 3] = ["local", "lt", "civil"];
/// Zones by names that are no other words: EST is also short for estimated, WET and WEST are words.
const ZONES: [&str; 18] = [
    "jst", "kst", "cet", "cest", "eet", "eest", "bst", "msk", "edt", "cst", "cdt", "mst", "mdt",
    "pst", "pdt", "hst", "aest", "aedt",
];

/// Words of a comment that say a time other than UTC: `local time`, `JST`, `UTC+1`.
fn civil_time(comment: &str) -> Option<String> {
    let lower = comment.to_ascii_lowercase();
    let words = || lower.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty());
    // `UTC+1`, `GMT -7`: a sign and a digit after the name, which is no part of another word.
    for name in ["utc", "gmt", "ut"] {
        for (at, _) in lower.match_indices(name) {
            let begins = !lower[..at].ends_with(|c: char| c.is_ascii_alphanumeric());
            let rest = lower[at + name.len()..].trim_start();
            let mut signs = rest.chars();
            if begins
                && matches!(signs.next(), Some('+' | '-'))
                && signs.as_str().trim_start().starts_with(|c: char| c.is_ascii_digit())
            {
                let digits = |c: char| !(c.is_ascii_digit() || "+-: .".contains(c));
                let end = rest.find(digits).unwrap_or(rest.len());
                return Some(format!("{}{}", name.to_ascii_uppercase(), rest[..end].trim_end()));
            }
        }
    }
    if words().any(|w| matches!(w, "utc" | "ut" | "gmt" | "universal")) {
        return None;
    }
    let zone = words().find(|w| ZONES.contains(w)).map(str::to_ascii_uppercase);
    zone.or_else(|| words().any(|w| LOCAL.contains(&w)).then(|| "local time".to_owned()))
}

/// A date of the form `31/12/99`, which the standard used for the years 1972 to 1999, in today's.
fn modern(date: &str) -> Option<String> {
    let mut parts = date.split('/');
    let [day, month, year] = [parts.next()?, parts.next()?, parts.next()?];
    let year: u32 = year.parse().ok().filter(|y| (72..100).contains(y))?;
    Some(format!("19{year}-{month:0>2}-{day:0>2}"))
}

/// Cards of the exposure in seconds beside EXPTIME and EXPOSURE: XPOSURE and TELAPSE are the standard's own (FITS 4.0, table 35).
const OTHER_EXPOSURES: [&str; 7] =
    ["EXP", "EXP_TIME", "ITIME", "INTTIME", "XPOSURE", "LIVETIME", "TELAPSE"];

impl Reading<'_> {
    fn comment(&self, keyword: &str) -> &str {
        let card = self.cards.cards.iter().find(|card| card.keyword == keyword);
        card.map_or("", |card| card.comment.as_str())
    }

    /// A length of time, s; the unit stands in the value (`2.0 s`) or in the comment (`[ms]`).
    fn duration_s(&self, keyword: &str) -> Result<Option<f64>, ParseError> {
        let text = match self.cards.get(keyword) {
            Some(CardValue::Text(text)) => text.trim().to_owned(),
            _ => String::new(),
        };
        let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c)));
        let (digits, unit) = match end {
            // The `e` of an exponent stands between digits.
            Some(_) if text.parse::<f64>().is_ok() => (text.as_str(), ""),
            Some(at) => (&text[..at], text[at..].trim()),
            None => (text.as_str(), ""),
        };
        let expected = "seconds, or a number with its unit such as `2.0 s` or `2000 ms`";
        if !unit.is_empty() {
            let (Ok(number), Some(unit)) = (digits.trim().parse::<f64>(), unit_s(unit)) else {
                return Err(self.bad(keyword, text, expected));
            };
            if !number.is_finite() || number < 0.0 {
                return Err(self.bad(keyword, text, expected));
            }
            return Ok(Some(number * unit));
        }
        let Some(number) = self.number(keyword, 0.0)? else { return Ok(None) };
        Ok(Some(number * comment_unit_s(self.comment(keyword)).unwrap_or(1.0)))
    }

    pub(super) fn exposure(&mut self) -> Result<Option<f64>, ParseError> {
        for keyword in ["EXPTIME", "EXPOSURE"].iter().chain(&OTHER_EXPOSURES) {
            if let Some(unit) = comment_unit_s(self.comment(keyword)).filter(|u| *u != 1.0)
                && self.cards.get(keyword).is_some()
            {
                self.notes
                    .push(format!("{keyword}: its comment says units of {unit} s, which counts"));
            }
        }
        let first = self.duration_s("EXPTIME")?;
        let second = self.duration_s("EXPOSURE")?;
        if let (Some(a), Some(b)) = (first, second)
            && (a - b).abs() > 1e-3 * a.max(b)
        {
            self.notes.push(format!("EXPTIME is {a} s and EXPOSURE {b} s; EXPTIME is taken"));
        }
        if first.or(second).is_some() {
            return Ok(first.or(second));
        }
        for keyword in OTHER_EXPOSURES {
            if let Some(seconds) = self.duration_s(keyword)? {
                return Ok(Some(seconds));
            }
        }
        for (keyword, unit_s) in [("EXPOINUS", 1e-6), ("EXPMSEC", 1e-3)] {
            if let Some(number) = self.number(keyword, 0.0)? {
                return Ok(Some(number * unit_s));
            }
        }
        Ok(self.dated_exposure())
    }

    /// The exposure by the dates of its begin and end, where both are known.
    fn dated_exposure(&mut self) -> Option<f64> {
        let notes = self.notes.len();
        let scale = self.scale().ok()?;
        let start = if self.cards.get("DATE-BEG").is_some() { "DATE-BEG" } else { "DATE-OBS" };
        let begin = self.date(start, scale).ok().flatten();
        let end = self.date("DATE-END", scale).ok().flatten();
        // Where they are read for the time of the frame the same is said again.
        self.notes.truncate(notes);
        let ((begin, _, at), (end, ..)) = (begin?, end?);
        let seconds = (end - begin).to_seconds();
        // A begin that is none by its comment tells no length.
        if at.is_some_and(|at| at != At::Begin) || seconds <= 0.0 || seconds > 86_400.0 {
            return None;
        }
        self.notes.push(format!("no EXPTIME: the exposure is DATE-END less {start}, {seconds} s"));
        Some(seconds)
    }

    fn scale(&mut self) -> Result<Scale, ParseError> {
        let Some(name) = self.words("TIMESYS") else { return Ok(Scale::Utc) };
        // The standard lets a realisation follow in brackets: `TT(TAI)`.
        let upper = name.to_ascii_uppercase();
        let word = upper.split(['(', ' ', ',']).next().unwrap_or_default();
        if upper.contains("APPROX") {
            self.notes.push(format!("TIMESYS is `{name}`: the file does not vouch for its times"));
        }
        Ok(match word {
            "UTC" | "UT" | "GMT" | "Z" => Scale::Utc,
            "UT1" => {
                self.notes
                    .push("TIMESYS is UT1: taken as UTC, from which it is up to 0.9 s".into());
                Scale::Utc
            }
            "TAI" | "IAT" => Scale::Tai,
            "TT" | "TDT" | "ET" => Scale::Tt,
            "TDB" => Scale::Tdb,
            "GPS" => Scale::Gps,
            _ => return Err(self.bad("TIMESYS", name, "UTC, UT, UT1, TAI, TT, TDB or GPS")),
        })
    }

    /// Refuses a card whose comment says another time than UTC.
    fn not_local(&self, keyword: &str) -> Result<(), ParseError> {
        let Some(words) = civil_time(self.comment(keyword)) else { return Ok(()) };
        let error = self.bad(keyword, format!("{words}, by its comment"), "UTC");
        Err(error.with_hint("write UTC into the card, with a comment that says so"))
    }

    /// The time of day that stands beside a date, and its keyword.
    fn beside(&mut self, keyword: &str) -> Result<Option<(String, String)>, ParseError> {
        let of_end = ["TIME-END", "UTC-END", "UT-END", "UTEND"];
        let of_start = [
            "TIME-OBS", "UTC-OBS", "UT-OBS", "TIME-BEG", "UTC-BEG", "UTSTART", "UT-START", "UTC",
            "UT", "TIME",
        ];
        let all: &[&str] = if keyword == "DATE-END" { &of_end } else { &of_start };
        for name in all {
            if let Some(text) = self.words(name).filter(|t| t.contains(':')) {
                self.not_local(name)?;
                return Ok(Some((
                    text.trim_end_matches(['Z', 'z']).to_owned(),
                    (*name).to_owned(),
                )));
            }
            let number = match self.cards.get(name) {
                Some(CardValue::Text(text)) => text.trim().parse().ok(),
                Some(value) => value.real(),
                None => None,
            };
            let Some(number) = number.filter(|n: &f64| n.is_finite() && *n >= 0.0) else {
                continue;
            };
            let unit = comment_unit_s(self.comment(name));
            let seconds = match unit {
                Some(unit) => number * unit,
                None if number < 24.0 => {
                    self.notes.push(format!("{name} is {number}: taken for hours of UTC"));
                    number * 3600.0
                }
                None => f64::INFINITY,
            };
            if seconds >= 86_400.0 {
                return Err(self.bad(
                    name,
                    number.to_string(),
                    "hours below 24, or a comment that names the unit such as `[s]`",
                ));
            }
            let whole = seconds as u32;
            let text = format!(
                "{:02}:{:02}:{:09.6}",
                whole / 3600,
                whole / 60 % 60,
                (seconds - f64::from(whole / 60 * 60)).min(59.999_999)
            );
            return Ok(Some((text, (*name).to_owned())));
        }
        Ok(None)
    }

    /// A date with its time of day from a card, the step of the card, s, and the moment that comments name; a date alone looks for the time beside it.
    fn date(
        &mut self,
        keyword: &str,
        scale: Scale,
    ) -> Result<Option<(Epoch, f64, Option<At>)>, ParseError> {
        let Some(mut text) = self.words(keyword) else { return Ok(None) };
        self.not_local(keyword)?;
        let mut at = At::of_comment(self.comment(keyword));
        if !text.contains(['T', 't', ' ', ':']) {
            let Some((time, name)) = self.beside(keyword)? else {
                let found = format!("{text}, a date without a time of day");
                return Err(self
                    .bad(keyword, found, "UTC as 2026-03-04T05:06:07.89")
                    .with_hint("no TIME-OBS, UTC-OBS, TIME-BEG or UT stands beside it"));
            };
            at = at.or_else(|| At::of_comment(self.comment(&name)));
            text = format!("{}T{time}", modern(&text).unwrap_or(text));
        }
        let clock = text.split_once(':').map_or("", |(_, clock)| clock);
        let digits = clock.split_once('.').map_or("", |(_, digits)| digits);
        let decimals = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        let in_card = |error: UtcError| error.in_file(self.path).in_field(keyword);
        let (mut epoch, is_zoned) = parse_zoned(&text).map_err(in_card)?;
        if scale != Scale::Utc {
            if is_zoned {
                let expected = "a time without an offset, as TIMESYS is not UTC";
                return Err(self.bad(keyword, text, expected));
            }
            epoch = parse_in(&text, scale).map_err(in_card)?;
        }
        let step = 10f64.powi(-(decimals.min(9) as i32));
        Ok(Some((epoch, step, at)))
    }

    /// A Julian date from a card.
    fn julian(&self, keyword: &str, zero: f64, scale: Scale) -> Result<Option<Epoch>, ParseError> {
        let Some(value) = self.number(keyword, 0.0)? else { return Ok(None) };
        let mjd = value - zero;
        let epoch = moment(mjd.floor() as i64, mjd - mjd.floor(), scale);
        epoch.map(Some).ok_or_else(|| {
            self.bad(keyword, value.to_string(), "a Julian date of the years 1972 to 2100")
        })
    }

    pub(super) fn time(
        &mut self,
        exposure_s: Option<f64>,
    ) -> Result<Option<FrameTime>, ParseError> {
        const JD_ZERO: f64 = 2_400_000.5;
        const JULIAN_STEP_S: f64 = 1e-3;
        /// Julian dates, the day 0 they count from, and the moment of the exposure.
        const JULIAN: [(&str, f64, At); 10] = [
            ("MJD-AVG", 0.0, At::Middle),
            ("MJD-MID", 0.0, At::Middle),
            ("JD-AVG", JD_ZERO, At::Middle),
            ("JD-MID", JD_ZERO, At::Middle),
            ("MJD-OBS", 0.0, At::Begin),
            ("MJD-BEG", 0.0, At::Begin),
            ("JD", JD_ZERO, At::Begin),
            ("JD-OBS", JD_ZERO, At::Begin),
            ("JD-BEG", JD_ZERO, At::Begin),
            ("MJD-END", 0.0, At::End),
        ];
        let scale = self.scale()?;
        let half = exposure_s.map(|s| 0.5 * s);
        let start = if self.cards.get("DATE-BEG").is_some() { "DATE-BEG" } else { "DATE-OBS" };
        let mut found: Vec<(Epoch, String, f64)> = Vec::new();
        for keyword in ["DATE-AVG", "DATE-MID"] {
            if let Some((middle, step, _)) = self.date(keyword, scale)? {
                found.push((middle, keyword.into(), step));
            }
        }
        for (keyword, zero, at) in JULIAN {
            if at == At::Middle
                && let Some(middle) = self.julian(keyword, zero, scale)?
            {
                found.push((middle, keyword.into(), JULIAN_STEP_S));
            }
        }
        let has_julian = JULIAN.iter().any(|(keyword, ..)| self.cards.get(keyword).is_some());
        let begin = match self.date(start, scale) {
            // A card that is no date is no reason to refuse where another tells.
            Err(error) if found.is_empty() && !has_julian => return Err(error),
            Err(error) => {
                self.notes.push(format!("{start} is not read: found {}", error.found));
                None
            }
            Ok(begin) => begin,
        };
        let said = begin.and_then(|(_, _, at)| at);
        if let Some((time, step, at)) = begin {
            let at = at.unwrap_or(At::Begin);
            let (sign, words) = at.to_middle();
            if at != At::Begin {
                let moment = if at == At::End { "end" } else { "middle" };
                self.notes.push(format!(
                    "{start} says \"{}\": it is taken as the {moment} of the exposure",
                    self.comment(start)
                ));
            }
            match half {
                Some(half) => found.push((
                    time + sign * half * Unit::Second,
                    format!("{start} {words}").trim_end().to_owned(),
                    step,
                )),
                None => found.push((time, format!("{start}; no exposure, so the start"), step)),
            }
        }
        if let (Some((end, step, _)), Some(half)) = (self.date("DATE-END", scale)?, half) {
            found.push((
                end - half * Unit::Second,
                "DATE-END minus half of the exposure".into(),
                step,
            ));
        }
        for (keyword, zero, at) in JULIAN.into_iter().filter(|(_, _, at)| *at != At::Middle) {
            if let (Some(time), Some(half)) = (self.julian(keyword, zero, scale)?, half) {
                let own = At::of_comment(self.comment(keyword));
                let at = own.or(said.filter(|_| at == At::Begin)).unwrap_or(at);
                let source = match at {
                    At::Middle => keyword.to_owned(),
                    _ => format!("{keyword} and half of the exposure"),
                };
                found.push((time + at.to_middle().0 * half * Unit::Second, source, JULIAN_STEP_S));
            }
        }
        let Some((middle, source, step_s)) = found.first().cloned() else { return Ok(None) };
        for (other, name, step) in &found[1..] {
            let apart = (*other - middle).to_seconds();
            if apart.abs() > (1e-3_f64).max(1.01 * step.max(step_s)) {
                self.notes.push(format!(
                    "{source} gives {}, {name} {apart:+.4} s from it; the first is taken",
                    format_utc(middle, 3)
                ));
            }
        }
        if step_s >= 1.0 {
            self.notes
                .push(format!("{source}: whole seconds only, the time may be up to 1 s late"));
        }
        Ok(Some(FrameTime { middle, source, step_s }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the words themselves.
    #[test]
    fn comments_say_units_and_moments() {
        for (comment, unit) in [
            ("[ms] exposure", Some(1e-3)),
            ("exposure (sec), readout in ms", Some(1.0)),
            ("[ISO 8601] UTC date/time of exposure start", None),
            ("Exposure time in milliseconds", Some(1e-3)),
            ("Exposure time in seconds", Some(1.0)),
            ("[us] shutter", Some(1e-6)),
            ("minimum of the exposures", None),
            ("[d] exposure", Some(86_400.0)),
            ("", None),
        ] {
            assert_eq!(comment_unit_s(comment), unit, "{comment}");
        }
        for (comment, civil) in [
            ("exposure start, LT", Some("local time")),
            ("local time (UTC+1)", Some("UTC+1")),
            ("UTC +05:30 start", Some("UTC+05:30")),
            ("GMT-7", Some("GMT-7")),
            ("start (JST)", Some("JST")),
            ("UTC, from local time", None),
            ("UT1-UTC is not applied", None),
            ("UTC-OBS of start", None),
            ("est. start of exposure", None),
            ("[ISO 8601] UTC date/time of exposure start", None),
        ] {
            assert_eq!(civil_time(comment).as_deref(), civil, "{comment}");
        }
        for (comment, at) in [
            ("end of exposure (UTC)", Some(At::End)),
            ("UTC start of exposure", Some(At::Begin)),
            ("mid-exposure", Some(At::Middle)),
            ("System Clock-Frame Grabbed", Some(At::End)),
            ("Observation date", None),
            ("weekend", None),
        ] {
            assert_eq!(At::of_comment(comment), at, "{comment}");
        }
    }
}
