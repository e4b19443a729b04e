//! Foreign texts made fit to be shown: names from files, devices and other programs may hold anything. And numbers with their nouns.

use std::borrow::Cow;

/// Bytes of a file's name, without its extension: systems allow 255.
const LONGEST_NAME: usize = 200;

/// Returns true for a character that does more than to be seen: controls (ESC among them), marks that turn the direction of what follows, separators of
/// lines, and what XML 1.0 forbids.
fn is_harmful(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{2028}' | '\u{2029}' | '\u{fffe}' | '\u{ffff}')
}

fn replaced(text: &str, harmful: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.chars().any(&harmful) {
        return Cow::Borrowed(text);
    }
    Cow::Owned(text.chars().map(|c| if harmful(c) { '\u{fffd}' } else { c }).collect())
}

/// A name on one line: what moves a cursor, ends a line, colours a terminal or breaks a file of XML becomes U+FFFD.
///
/// ```
/// assert_eq!(sunglint_formats::text::plain("OBJ\u{1b}[31m A\nB"), "OBJ\u{fffd}[31m A\u{fffd}B");
/// ```
pub fn plain(text: &str) -> Cow<'_, str> {
    replaced(text, is_harmful)
}

/// A number with its noun, in the plural but of one.
///
/// ```
/// use sunglint_formats::text::counted;
/// assert_eq!((counted(1, "row"), counted(0, "row"), counted(12, "row")), ("1 row".into(), "0 rows".into(), "12 rows".into()));
/// ```
#[must_use]
pub fn counted(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

/// Names in a row, of which at most ten are said: `a, b … and 7 more`.
///
/// ```
/// use sunglint_formats::text::listed;
///
/// assert_eq!(listed(["a", "b"]), "a, b");
/// assert_eq!(listed((0..13).map(|i| i.to_string())), "0, 1, 2, 3, 4, 5, 6, 7, 8, 9 … and 3 more");
/// ```
pub fn listed<S: AsRef<str>>(names: impl IntoIterator<Item = S>) -> String {
    const MOST: usize = 10;
    let names: Vec<S> = names.into_iter().collect();
    let shown: Vec<&str> = names.iter().take(MOST).map(AsRef::as_ref).collect();
    match names.len().saturating_sub(MOST) {
        0 => shown.join(", "),
        more => format!("{} … and {more} more", shown.join(", ")),
    }
}

/// A text of several lines: the same, but for line feeds and tabs, which stay.
pub fn printable(text: &str) -> Cow<'_, str> {
    replaced(text, |c| is_harmful(c) && c != '\n' && c != '\t')
}

/// A name of a file within its folder: no path, nothing hidden, no option, at most 200 bytes.
///
/// ```
/// use sunglint_formats::text::file_name;
///
/// assert_eq!(file_name("STARLINK-1130 (DARK/SAT)"), "STARLINK-1130 (DARK_SAT)");
/// assert_eq!(file_name("../../etc/x"), "_._.._etc_x");
/// ```
pub fn file_name(text: &str) -> Cow<'_, str> {
    let bad = |c: char| is_harmful(c) || matches!(c, '/' | '\\' | '\0');
    let starts_badly = text.starts_with(['.', '-', '~', ' ']);
    if !text.is_empty() && text.len() <= LONGEST_NAME && !starts_badly && !text.chars().any(bad) {
        return Cow::Borrowed(text);
    }
    let mut name = String::new();
    for (i, c) in text.chars().enumerate() {
        let c = if bad(c) || (i == 0 && starts_badly) { '_' } else { c };
        if name.len() + c.len_utf8() > LONGEST_NAME {
            break;
        }
        name.push(c);
    }
    if name.is_empty() {
        name.push_str("unnamed");
    }
    Cow::Owned(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the rules themselves, on every character there is.
    #[test]
    fn no_character_does_harm() {
        for c in '\0'..=char::MAX {
            let text = format!("a{c}b");
            let shown = plain(&text);
            assert!(!shown.chars().any(|c| c.is_control()), "{c:?}");
            assert!(!shown.contains(['\u{202e}', '\u{2028}', '\u{ffff}']), "{c:?}");
            let name = file_name(&text);
            assert!(!name.contains(['/', '\\', '\0', '\n', '\u{1b}']), "{c:?}");
            assert_eq!(shown.chars().count(), 3);
        }
        assert_eq!(printable("a\n\tb\u{1b}c\r"), "a\n\tb\u{fffd}c\u{fffd}");
        for bad in ["", ".", "..", "-rf", "~", ".bashrc", "/etc/passwd"] {
            let name = file_name(bad);
            assert!(!name.is_empty() && !name.starts_with(['.', '-', '~', '/']), "{bad}: {name}");
        }
        assert_eq!(file_name(&"ü".repeat(500)).len(), 200);
        assert_eq!(file_name("ISS (ZARYA)"), "ISS (ZARYA)");
    }
}
