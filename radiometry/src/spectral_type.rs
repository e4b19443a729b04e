//! MK spectral types, as far as a star's colours need them: temperature class and luminosity class.

use std::fmt;

/// A spectral type: what remains of `kA5hF0mF2III` or `K1IIIFe-1.2CN-0.5` when peculiarities are left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralType {
    /// Temperature class counted in subclasses from O0: B0 is 10, G2 is 42, M5.5 is 65.5. The mean of a range (`K0/K1`).
    pub temperature: f64,
    /// Luminosity class from 1 (I: supergiant) to 5 (V: dwarf), the mean of a range (`III-IV`); `None` where it is not given.
    pub luminosity: Option<f64>,
}

const LETTERS: &str = "OBAFGKM";

impl SpectralType {
    /// Reads a type as catalogues write it. The first component of a composite (`G8III+G0III`) counts; of a metallic-line star
    /// (`kA5hF0mF2III`) the hydrogen type, which follows the temperature. `None` for carbon stars, white dwarfs and types without a subclass (`Ap`).
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        // Metallic-line notation: k (calcium), h (hydrogen), m (metals), in that order, the luminosity class last.
        let (main, class) = match text.strip_prefix('k') {
            None => (text, None),
            Some(rest) => {
                let main = rest.split_once('h').map_or(rest, |(_, after)| after);
                let tail = main.split_once('m').map(|(_, metals)| metals);
                (main, tail.and_then(|t| temperature(t)).map(|(_, after)| after))
            }
        };
        let (temperature, after) = temperature(main)?;
        Some(Self { temperature, luminosity: luminosity(class.unwrap_or(after)) })
    }
}

/// The temperature class at the start of `text`, and what follows it.
fn temperature(text: &str) -> Option<(f64, &str)> {
    let letter = text.chars().next().and_then(|c| LETTERS.find(c))?;
    let (subclass, mut rest) = number(&text[1..])?;
    let first = 10.0 * letter as f64 + subclass;
    rest = rest.trim_start_matches(':');
    // A range: `M3/M4`, `K1-2`, `F7/F8`.
    if let Some(after) = rest.strip_prefix(['/', '-']) {
        let (letter, digits) = match after.chars().next().and_then(|c| LETTERS.find(c)) {
            Some(second) => (second, &after[1..]),
            None => (letter, after),
        };
        if let Some((subclass, after)) = number(digits) {
            return Some((0.5 * (first + 10.0 * letter as f64 + subclass), after));
        }
    }
    Some((first, rest))
}

fn number(text: &str) -> Option<(f64, &str)> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let value: f64 = text[..end].parse().ok()?;
    (value < 10.0).then_some((value, &text[end..]))
}

/// The luminosity class at the start of `text`, which may be set off by blanks or by the sign of a subtype (`K0-III`).
fn luminosity(text: &str) -> Option<f64> {
    let (first, rest) = roman(text.trim_start_matches([' ', ':', '+', '-', '(']))?;
    let rest = rest.trim_start_matches([':', 'a', 'b']);
    match rest.strip_prefix(['-', '/']).and_then(roman) {
        Some((second, _)) => Some(0.5 * (first + second)),
        None => Some(first),
    }
}

fn roman(text: &str) -> Option<(f64, &str)> {
    // Longest first.
    [("III", 3.0), ("II", 2.0), ("IV", 4.0), ("I", 1.0), ("V", 5.0)]
        .iter()
        .find_map(|&(numeral, class)| text.strip_prefix(numeral).map(|rest| (class, rest)))
}

impl fmt::Display for SpectralType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letter = (self.temperature / 10.0).floor().clamp(0.0, 6.0);
        let name = &LETTERS[letter as usize..=letter as usize];
        // A tenth of a subclass is as fine as types go; the rest is rounding.
        write!(f, "{name}{}", (10.0 * (self.temperature - 10.0 * letter)).round() / 10.0)?;
        match self.luminosity {
            None => Ok(()),
            Some(class) => {
                let numerals = ["I", "II", "III", "IV", "V"];
                let numeral = |c: f64| numerals[(c as usize).clamp(1, 5) - 1];
                write!(f, "{}", numeral(class.floor()))?;
                if class.fract() > 0.0 { write!(f, "-{}", numeral(class.ceil())) } else { Ok(()) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: read by eye from the catalogue's own notation.
    #[test]
    fn types_as_catalogues_write_them() {
        for (text, temperature, luminosity) in [
            ("A0V", 20.0, Some(5.0)),
            ("K2IIIBa1", 52.0, Some(3.0)),
            ("B0.5IVpe", 10.5, Some(4.0)),
            ("G8III+G0III", 48.0, Some(3.0)),
            ("K1IIIFe-1.2CN-0.5", 51.0, Some(3.0)),
            ("kA5hF0mF2III", 30.0, Some(3.0)),
            ("kA2hA5mA4IV-V", 25.0, Some(4.5)),
            ("M3/M4III", 63.5, Some(3.0)),
            ("K1-2III+A1-2V", 51.5, Some(3.0)),
            ("K0/K1III", 50.5, Some(3.0)),
            ("K4Ib-II", 54.0, Some(1.5)),
            ("B8Ia/Iab", 18.0, Some(1.0)),
            ("M1.5Iab-b", 61.5, Some(1.0)),
            ("F5Iab:", 35.0, Some(1.0)),
            ("K3:IIIv+", 53.0, Some(3.0)),
            ("G2Ib/II", 42.0, Some(1.5)),
            ("A0IV(n)kB9", 20.0, Some(4.0)),
            ("A0sp", 20.0, None),
            ("B5", 15.0, None),
            ("G2 V", 42.0, Some(5.0)),
            ("F5 IV-V", 35.0, Some(4.5)),
            ("K0-III", 50.0, Some(3.0)),
            ("K5+III", 55.0, Some(3.0)),
            ("M0-IIIa", 60.0, Some(3.0)),
            ("G8+K0V", 48.0, None),
            ("M3SIII", 63.0, None),
        ] {
            let parsed = SpectralType::parse(text).unwrap();
            assert_eq!(
                (parsed.temperature, parsed.luminosity),
                (temperature, luminosity),
                "{text}"
            );
        }
        for text in ["", "C", "Ap", "Fm", "BIV+", "DA1.5+F9", "S", "WC8", "é", "A", "k", "khm"] {
            assert_eq!(SpectralType::parse(text), None, "{text}");
        }
        assert_eq!(SpectralType::parse("K2III-IV").unwrap().to_string(), "K2III-IV");
        assert_eq!(SpectralType::parse("B9.5V").unwrap().to_string(), "B9.5V");
        assert_eq!(SpectralType::parse("B0.2V").unwrap().to_string(), "B0.2V");
    }
}
