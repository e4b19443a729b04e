//! Patterns of answers: text with named holes.

use super::reply::number_at_start;

/// Hole in a pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hole {
    /// The number that is wanted.
    Value,
    /// The word that is wanted.
    Word,
    /// A number that is passed over.
    Number,
    /// Text that is passed over.
    Text,
    /// All that is left.
    Rest,
    /// Part of an identity.
    Vendor,
    Model,
    Serial,
    Firmware,
}

const HOLES: [(&str, Hole); 9] = [
    ("value", Hole::Value),
    ("word", Hole::Word),
    ("number", Hole::Number),
    ("text", Hole::Text),
    ("rest", Hole::Rest),
    ("vendor", Hole::Vendor),
    ("model", Hole::Model),
    ("serial", Hole::Serial),
    ("firmware", Hole::Firmware),
];

#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    Literal(String),
    Hole(Hole),
}

/// A pattern of an answer, such as `{value}A,{number},{number}`.
///
/// `{value}` is the number that is wanted and `{word}` the word that is wanted; `{number}` and `{text}` are passed over, `{rest}` is all that is left.
/// `{vendor}`, `{model}`, `{serial}` and `{firmware}` are the parts of an identity. Text has no comma in it, and ends where the text behind its hole
/// begins. Everything else has to be there as it is written; blanks before a number do not matter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    pieces: Vec<Piece>,
    source: String,
}

/// Parts of an answer that a pattern found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Captured {
    /// The number, of `{value}`.
    pub value: Option<f64>,
    /// The word, of `{word}`.
    pub word: Option<String>,
    /// The maker.
    pub vendor: Option<String>,
    /// The model.
    pub model: Option<String>,
    /// The serial number.
    pub serial: Option<String>,
    /// The firmware's version.
    pub firmware: Option<String>,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// Words that say what a pattern should be: an unknown hole, one that stands there twice, holes of text side by side, something behind `{rest}`.
    pub fn parse(source: &str) -> Result<Self, String> {
        let known = || {
            let names: Vec<String> = HOLES.iter().map(|(name, _)| format!("{{{name}}}")).collect();
            names.join(", ")
        };
        let mut pieces: Vec<Piece> = Vec::new();
        let mut rest = source;
        while !rest.is_empty() {
            let Some(inner) = rest.strip_prefix('{') else {
                let end = rest.find('{').unwrap_or(rest.len());
                let (literal, behind) = rest.split_at(end);
                if literal.contains('}') {
                    return Err("text in which `{` and `}` stand around a hole's name".to_owned());
                }
                pieces.push(Piece::Literal(literal.to_owned()));
                rest = behind;
                continue;
            };
            let (name, behind) = inner.split_once('}').ok_or("a `}` behind each `{`")?;
            let hole = HOLES.iter().find(|(known, _)| *known == name).map(|(_, hole)| *hole);
            let hole = hole.ok_or_else(|| format!("holes of the names {}", known()))?;
            let twice = !matches!(hole, Hole::Number | Hole::Text);
            if twice && pieces.contains(&Piece::Hole(hole)) {
                return Err(format!("{{{name}}} once"));
            }
            // Where the first of two ends, nobody could tell.
            if matches!(pieces.last(), Some(Piece::Hole(_))) {
                return Err("some text, such as a comma, between two holes".to_owned());
            }
            if hole == Hole::Rest && !behind.is_empty() {
                return Err("{rest} as the last".to_owned());
            }
            pieces.push(Piece::Hole(hole));
            rest = behind;
        }
        if pieces.is_empty() {
            return Err("a pattern such as `{value}`".to_owned());
        }
        Ok(Self { pieces, source: source.to_owned() })
    }

    /// The pattern as it was written.
    pub fn source(&self) -> &str {
        &self.source
    }

    fn has(&self, hole: Hole) -> bool {
        self.pieces.contains(&Piece::Hole(hole))
    }

    /// Whether it has a number that is wanted.
    pub fn has_value(&self) -> bool {
        self.has(Hole::Value)
    }

    /// Whether it has a word that is wanted.
    pub fn has_word(&self) -> bool {
        self.has(Hole::Word)
    }

    /// Holds the whole of an answer against the pattern; `None` where it is another.
    pub fn of(&self, answer: &str) -> Option<Captured> {
        let mut found = Captured::default();
        let mut rest = answer.trim();
        for (i, piece) in self.pieces.iter().enumerate() {
            let hole = match piece {
                Piece::Literal(literal) => {
                    rest = rest.strip_prefix(literal.as_str())?;
                    continue;
                }
                Piece::Hole(hole) => *hole,
            };
            if let Hole::Value | Hole::Number = hole {
                let (number, behind) = number_at_start(rest.trim_start_matches(' '))?;
                if hole == Hole::Value {
                    found.value = Some(number);
                }
                rest = behind;
                continue;
            }
            let (text, behind) = match self.pieces.get(i + 1) {
                _ if hole == Hole::Rest => (rest, ""),
                Some(Piece::Literal(literal)) => rest.split_at(rest.find(literal.as_str())?),
                _ => (rest, ""),
            };
            if hole != Hole::Rest && text.contains(',') {
                return None;
            }
            rest = behind;
            let text = text.trim();
            let kept = || (!text.is_empty()).then(|| text.to_owned());
            match hole {
                // A word that is not there is none.
                Hole::Word => found.word = Some(kept()?),
                Hole::Vendor => found.vendor = kept(),
                Hole::Model => found.model = kept(),
                Hole::Serial => found.serial = kept(),
                Hole::Firmware => found.firmware = kept(),
                Hole::Value | Hole::Number | Hole::Text | Hole::Rest => {}
            }
        }
        rest.is_empty().then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(pattern: &str, answer: &str) -> Option<f64> {
        Pattern::parse(pattern).unwrap().of(answer)?.value
    }

    /// Truth: answers as the manuals print them, read by hand.
    #[test]
    fn patterns_find_the_number_and_refuse_other_answers() {
        let picoammeter = "{value}A,{number},{number}";
        assert_eq!(value(picoammeter, "1.2E-9A,12.3,0"), Some(1.2e-9));
        assert_eq!(
            value(picoammeter, "+1.040564E-06A, +2.365000E+02, +0.000000E+00"),
            Some(1.040564e-6)
        );
        for other in
            ["1.2E-9V,12.3,0", "1.2E-9A,12.3", "1.2E-9A,12.3,0,1", "1.2E-9A,,0", "A,1,2", ""]
        {
            assert_eq!(value(picoammeter, other), None, "{other}");
        }
        assert_eq!(value("{value}", " -3.5 "), Some(-3.5));
        assert_eq!(value("CH1:{value},{rest}", "CH1:5,a,b"), Some(5.0));
        let who = Pattern::parse("{vendor},MODEL {model},{serial},{firmware}").unwrap();
        let found = who.of("KEITHLEY INSTRUMENTS INC.,MODEL 6485,1234567,B03").unwrap();
        assert_eq!(found.model.as_deref(), Some("6485"));
        assert_eq!(found.firmware.as_deref(), Some("B03"));
        assert_eq!(who.of("KEITHLEY INSTRUMENTS INC.,MODEL 6485,1234567,B03,x"), None);
        let word = Pattern::parse("{word}").unwrap();
        assert_eq!(word.of(" ON ").unwrap().word.as_deref(), Some("ON"));
        assert_eq!(word.of(""), None);
    }

    #[test]
    fn patterns_that_could_be_read_two_ways_are_refused() {
        for (bad, why) in [
            ("", "such as"),
            ("{valeu}", "holes of the names {value}, {word}"),
            ("{value", "a `}` behind"),
            ("value}", "stand around"),
            ("{value},{value}", "{value} once"),
            ("{text}{value}", "between two holes"),
            ("{rest},{value}", "{rest} as the last"),
        ] {
            let said = Pattern::parse(bad).unwrap_err();
            assert!(said.contains(why), "{bad}: {said}");
        }
    }
}
