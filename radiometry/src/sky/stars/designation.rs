//! How people write the designation of a star, and what SIMBAD's object types mean.

use super::{StarNote, constellations};

const GREEK: [(&str, char, &str); 24] = [
    ("alpha", 'α', "alp"),
    ("beta", 'β', "bet"),
    ("gamma", 'γ', "gam"),
    ("delta", 'δ', "del"),
    ("epsilon", 'ε', "eps"),
    ("zeta", 'ζ', "zet"),
    ("eta", 'η', "eta"),
    ("theta", 'θ', "the"),
    ("iota", 'ι', "iot"),
    ("kappa", 'κ', "kap"),
    ("lambda", 'λ', "lam"),
    ("mu", 'μ', "mu"),
    ("nu", 'ν', "nu"),
    ("xi", 'ξ', "xi"),
    ("omicron", 'ο', "omi"),
    ("pi", 'π', "pi"),
    ("rho", 'ρ', "rho"),
    ("sigma", 'σ', "sig"),
    ("tau", 'τ', "tau"),
    ("upsilon", 'υ', "ups"),
    ("phi", 'φ', "phi"),
    ("chi", 'χ', "chi"),
    ("psi", 'ψ', "psi"),
    ("omega", 'ω', "ome"),
];
/// Spellings of SIMBAD that differ from the table's.
const SIMBAD: [(&str, &str); 3] = [("alf", "alp"), ("tet", "the"), ("ksi", "xi")];
const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];

/// A number in one of the great catalogues.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    Hip(i64),
    Hd(i64),
}

/// `HIP 91262`, `hip91262`, `HIP:91262`, `HD-172167` and the like.
pub(super) fn catalogue_number(text: &str) -> Option<Number> {
    let text = text.trim();
    let lower = text.to_ascii_lowercase();
    let number = |rest: &str| {
        let digits = rest.trim_start_matches([' ', ':', '-', '_', '.']);
        digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok())?
    };
    if let Some(rest) = lower.strip_prefix("hip") {
        return number(rest).map(Number::Hip);
    }
    number(lower.strip_prefix("hd")?).map(Number::Hd)
}

/// A designation as the table spells it: Greek letters, spelled out or as letters, in three characters; raised digits as
/// digits; one blank between words. Upper and lower case stay, since `A Cen` and `a Cen` are two stars.
pub(super) fn as_the_table_spells(text: &str) -> String {
    let plain: String = text
        .chars()
        .map(|c| match RAISED.iter().position(|r| *r == c) {
            Some(digit) => char::from(b'0' + digit as u8),
            None => c,
        })
        .collect();
    let words: Vec<&str> = plain.split_whitespace().collect();
    let Some((first, rest)) = words.split_first() else { return String::new() };
    let rest = rest.join(" ");
    match constellations::abbreviation(&rest) {
        Some(constellation) => format!("{} {constellation}", greek_letter(first)),
        None if rest.is_empty() => greek_letter(first),
        None => format!("{} {rest}", greek_letter(first)),
    }
}

/// `alpha`, `α` and `Alp` to `alp`, a digit behind kept; anything else as it is.
fn greek_letter(word: &str) -> String {
    let letter = word.trim_end_matches(|c: char| c.is_ascii_digit());
    let index = &word[letter.len()..];
    let lower = letter.to_lowercase();
    // The micro sign looks like a mu and is what keyboards have.
    let lower = if lower == "µ" { "μ".to_owned() } else { lower };
    // SIMBAD fills two letters up with a point: `mu.`, `pi.`
    let lower = lower.trim_end_matches('.').to_owned();
    let lower = SIMBAD
        .iter()
        .find(|(theirs, _)| *theirs == lower)
        .map_or(lower, |(_, ours)| (*ours).to_owned());
    let found = GREEK.iter().find(|(name, sign, short)| {
        lower == *name || lower == *short || lower.chars().eq(std::iter::once(*sign))
    });
    match found {
        // A table writes `alp2`, never `alp02`.
        Some((_, _, short)) => format!("{short}{}", index.trim_start_matches('0')),
        None => word.to_owned(),
    }
}

/// Returns the notes for a calibrator by SIMBAD's main object type (SIMBAD's older codes, which the table holds).
pub(super) fn notes_of_type(object_type: Option<&str>) -> Vec<StarNote> {
    use StarNote::{Double, Eclipsing, SpectroscopicBinary, UnknownType, Variable};
    let Some(code) = object_type else { return vec![UnknownType] };
    match code {
        "**" | "*i*" => vec![Double],
        "SB*" => vec![SpectroscopicBinary],
        // Algol, beta Lyrae and W UMa types, and eclipsing ones at large.
        "Al*" | "bL*" | "WU*" | "EB*" => vec![Variable, Eclipsing],
        // Ellipsoidal, RS CVn and symbiotic: variable because they are binaries.
        "El*" | "RS*" | "Sy*" | "CV*" => vec![Variable, Double],
        "V*" | "V*?" | "Be*" | "dS*" | "Pu*" | "a2*" | "bC*" | "sr*" | "BY*" | "Ro*" | "Ce*"
        | "cC*" | "gD*" | "Fl*" | "Er*" | "RR*" | "LP*" | "Mi*" | "RI*" | "WV*" | "Ir*" | "Em*"
        | "pr*" | "Or*" | "TT*" | "C*" | "S*" => vec![Variable],
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn designations_are_read_as_people_write_them() {
        for text in ["alp Lyr", "alpha Lyr", "α Lyr", "Alpha  Lyr", " ALP Lyr "] {
            assert_eq!(as_the_table_spells(text), "alp Lyr", "{text}");
        }
        for text in ["alp2 Cen", "α² Cen", "alpha2 Cen", "alp02 Cen"] {
            assert_eq!(as_the_table_spells(text), "alp2 Cen", "{text}");
        }
        for (text, spelled) in [
            ("alf Lyr", "alp Lyr"),
            ("Alpha Lyrae", "alp Lyr"),
            ("tet Ori", "the Ori"),
            ("ksi Boötis", "xi Boo"),
            ("mu. Cep", "mu Cep"),
            ("alpha2 Canum Venaticorum", "alp2 CVn"),
            ("61 cygni", "61 Cyg"),
        ] {
            assert_eq!(as_the_table_spells(text), spelled, "{text}");
        }
        assert_eq!(as_the_table_spells("µ Cep"), "mu Cep", "the micro sign");
        assert_eq!(as_the_table_spells("A Cen"), "A Cen");
        assert_eq!(as_the_table_spells("15 Mon"), "15 Mon");
        for text in ["HIP 91262", "HIP91262", "hip:91262", "hip-91262"] {
            assert_eq!(catalogue_number(text), Some(Number::Hip(91262)), "{text}");
        }
        assert_eq!(catalogue_number("HD 172167"), Some(Number::Hd(172167)));
        for text in ["91262", "HIP", "HIP x1", "hipparchus", "HD 1a", "Hadar"] {
            assert_eq!(catalogue_number(text), None, "{text}");
        }
    }
}
