//! Escapes for texts that a header cannot hold: characters other than printable ASCII, as `\uXXXX`.
//!
//! A header that holds such texts has a card [`KEYWORD`] with the keywords of the texts that are escaped; in those, and
//! only in those, `\uXXXX` stands for a UTF-16 unit. Other programs see the escapes. A text of a foreign file that looks
//! like one stays as it is.

use super::header::{Header, is_structural};
use super::{Card, CardValue};
use crate::error::EncodeError;
use serde_json::Value;
use std::collections::HashSet;

/// The card that names the keywords of escaped texts, with commas between them.
pub(super) const KEYWORD: &str = "UESCAPED";

/// A value as JSON in printable ASCII, all other characters escaped as JSON has it (`\u00f6`, and two for characters
/// beyond U+FFFF): for a text in a FITS header that any reader of JSON reads, without regard to a convention of ours.
pub fn ascii_json(value: &Value) -> String {
    let mut ascii = String::new();
    // Outside its texts JSON is ASCII, so each other character is in one.
    for c in value.to_string().chars() {
        push(c, false, &mut ascii);
    }
    ascii
}

/// Adds a character, or its escape if a header cannot hold it (or if it is to be escaped all the same).
fn push(c: char, escaped: bool, out: &mut String) {
    if matches!(c, ' '..='~') && !escaped {
        out.push(c);
        return;
    }
    for unit in c.encode_utf16(&mut [0; 2]) {
        out.push_str(&format!("\\u{unit:04x}"));
    }
}

/// The UTF-16 unit of the escape with which a text begins.
fn unit(text: &str) -> Option<u16> {
    let digits = text.strip_prefix("\\u")?.get(..4)?;
    // `from_str_radix` would take a sign.
    let plain = digits.bytes().all(|b| b.is_ascii_hexdigit());
    plain.then(|| u16::from_str_radix(digits, 16).ok())?
}

/// The characters of a text as a header holds them, one by one so that nobody cuts an escape. A backslash with which an
/// escape would begin is escaped itself, so that [`unescaped`] gives back any text.
pub(super) fn escaped(text: &str) -> impl Iterator<Item = String> {
    text.char_indices().map(|(at, c)| {
        let mut piece = String::new();
        push(c, unit(&text[at..]).is_some(), &mut piece);
        piece
    })
}

/// The text that was escaped. What is no escape, half a pair of them included, stays as it is.
fn unescaped(text: &str) -> String {
    const LENGTH: usize = 6;
    let mut plain = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("\\u") {
        plain.push_str(&rest[..at]);
        rest = &rest[at..];
        // A second unit only counts if the first cannot do without.
        let first = unit(rest);
        let second = rest.get(LENGTH..).and_then(unit);
        let (c, length) = match (first.map(u32::from).map(char::from_u32), first.zip(second)) {
            (Some(Some(c)), _) => (c, LENGTH),
            (_, Some((high, low))) => match char::decode_utf16([high, low]).next() {
                Some(Ok(c)) => (c, 2 * LENGTH),
                _ => ('\\', 1),
            },
            _ => ('\\', 1),
        };
        plain.push(c);
        rest = &rest[length..];
    }
    plain.push_str(rest);
    plain
}

/// Whether texts of a keyword may be escaped: those for people. Names of columns, units and formats are for programs,
/// which would take the escape for the name.
fn may_be_escaped(keyword: &str) -> bool {
    keyword.starts_with("TCOMM") || !is_structural(keyword) && keyword != "BUNIT"
}

/// The card [`KEYWORD`] for a header, if a text in it must be escaped.
pub(super) fn card_for(header: &Header) -> Result<Option<Card>, EncodeError> {
    let mut keywords: Vec<&str> = Vec::new();
    let mut seen = HashSet::new();
    for card in &header.cards {
        let (CardValue::Text(text) | CardValue::Commentary(text)) = &card.value else { continue };
        let keyword = card.keyword.as_str();
        if text.chars().all(|c| matches!(c, ' '..='~')) || !may_be_escaped(keyword) {
            continue;
        }
        if keyword.contains(',') {
            let expected = "a keyword without a comma, beside a text that is not ASCII";
            return Err(EncodeError::new(keyword, crate::error::excerpt(keyword), expected));
        }
        if seen.insert(keyword) {
            keywords.push(keyword);
        }
    }
    Ok((!keywords.is_empty()).then(|| Card {
        keyword: KEYWORD.to_owned(),
        value: keywords.join(",").into(),
        comment: "\\uXXXX there is a character".to_owned(),
    }))
}

/// The keywords that a card [`KEYWORD`] names.
pub(super) fn keywords(card: Option<&Card>) -> HashSet<&str> {
    let text = card.and_then(|card| card.value.text());
    let all = text.into_iter().flat_map(|keywords| keywords.split(','));
    all.filter(|keyword| may_be_escaped(keyword)).collect()
}

/// Takes the card [`KEYWORD`] out of a header that was read, and the escapes out of the texts that it names.
pub(super) fn undo(header: &mut Header) {
    let Some(at) = header.cards.iter().position(|card| card.keyword == KEYWORD) else { return };
    let marker = header.cards.remove(at);
    let keywords = keywords(Some(&marker));
    for card in &mut header.cards {
        if keywords.contains(card.keyword.as_str())
            && let CardValue::Text(text) | CardValue::Commentary(text) = &mut card.value
        {
            *text = unescaped(text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fits::{Fits, Image, Pixels, Writer};
    use proptest::prelude::*;
    use serde_json::json;

    fn escape(text: &str) -> String {
        escaped(text).collect()
    }

    #[test]
    fn escapes_are_those_of_json() {
        let value = json!({"Jörg": ["α", "🛰", "\u{7f}\n\"\\", "\\u00f6", 1.5, null]});
        let text = ascii_json(&value);
        assert_eq!(
            text,
            r#"{"J\u00f6rg":["\u03b1","\ud83d\udef0","\u007f\n\"\\","\\u00f6",1.5,null]}"#
        );
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
    }

    #[test]
    fn any_text_comes_back_from_its_escapes() {
        for (text, expected) in [
            ("plain \\ text \\u 12", "plain \\ text \\u 12"),
            ("ö\n🛰", "\\u00f6\\u000a\\ud83d\\udef0"),
            // What looks like an escape loses its backslash to one.
            ("\\u00f6", "\\u005cu00f6"),
            ("\\u00ö", "\\u00\\u00f6"),
            ("\\\\u00f6", "\\\\u005cu00f6"),
            ("\\ö", "\\\\u00f6"),
            ("\\u+0f6", "\\u+0f6"),
            ("\\ud83d\\udef0", "\\u005cud83d\\u005cudef0"),
        ] {
            assert_eq!(escape(text), expected);
            assert_eq!(unescaped(expected), text);
        }
        // Units that are no character stay.
        for text in ["\\ud83d", "\\ud83dx", "\\udef0\\ud83d", "\\u00", "\\u", "\\ud83d\\u00"] {
            assert_eq!(unescaped(text), text);
        }
        assert_eq!(unescaped("\\ud83d\\u00f6"), "\\ud83dö");
        assert_eq!(unescaped("\\u00F6\\u00f6"), "öö");
    }

    fn back(header: &Header) -> Header {
        let pixels = Pixels::U8(ndarray::array![[1_u8]].into_dyn());
        let mut writer = Writer::new();
        writer.image(&Image { header: header.clone(), pixels }).unwrap();
        let bytes = writer.into_bytes();
        assert!(bytes[..2880].iter().all(|b| (0x20..0x7f).contains(b)));
        Fits::from_bytes("f.fits", bytes).unwrap().image(0).unwrap().header
    }

    #[test]
    fn only_the_texts_that_need_it_are_escaped() {
        let mut header = Header::default();
        header.set("OBSERVER", "Jörg 🛰", "");
        header.set("LOOKS", "\\u00f6", "an escape, but of nobody");
        header.set("ESO OBS NAME", "α Cen", "");
        header.set("JSON", ascii_json(&json!(["ö"])).as_str(), "");
        assert_eq!(back(&header), header);
        let keywords = |header: &Header| card_for(header).unwrap().map(|card| card.value);
        assert_eq!(keywords(&header), Some("OBSERVER,ESO OBS NAME".into()));
        header.cards.retain(|card| matches!(card.keyword.as_str(), "LOOKS" | "JSON"));
        assert_eq!((keywords(&header), back(&header)), (None, header));
    }

    #[test]
    fn lines_are_not_cut_within_an_escape() {
        let mut header = Header::default();
        for length in 55..75 {
            header.history(&format!("{}🛰ö", "x".repeat(length)));
        }
        header.comment("plain");
        let read = back(&header);
        let texts = |header: &Header| header.commentaries("HISTORY").collect::<String>();
        assert_eq!(texts(&read), texts(&header));
        assert!(read.commentaries("HISTORY").any(|line| line == "🛰ö"));
        assert_eq!(read.commentaries("COMMENT").collect::<Vec<_>>(), ["plain"]);
    }

    #[test]
    fn what_programs_read_is_refused_not_escaped() {
        let mut header = Header::default();
        header.set("BUNIT", "µm", "");
        let error = header.encode().unwrap_err();
        assert_eq!(
            error.to_string(),
            "BUNIT: found the character \\u{b5}, expected printable ASCII (a FITS header holds nothing else)"
        );
        let mut header = Header::default();
        header.set("A, B", "ö", "");
        let expected = "a keyword without a comma, beside a text that is not ASCII";
        assert_eq!(
            header.encode().unwrap_err().to_string(),
            format!("A, B: found `A, B`, expected {expected}")
        );
    }

    proptest! {
        #[test]
        fn any_text_in_any_place(text in "[ -~]{0,9}(\\PC|\\\\|u00f6|\\pC|é|[a-f0-9]|'|&| |\n){0,80}") {
            prop_assert_eq!(unescaped(&escape(&text)), text.clone());
            let mut header = Header::default();
            header.set("OBJECT", text.as_str(), "a comment");
            header.set("NEXT", "\\u00f6", "");
            let read = back(&header);
            prop_assert_eq!(read.text("OBJECT"), Some(text.trim_end_matches(' ')));
            prop_assert_eq!(read.text("NEXT"), Some("\\u00f6"));
        }
    }
}
