//! The rows: delimiter-separated fields that know whether they were quoted, which missing text depends on.

use std::borrow::Cow;

/// One field of a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Field<'a> {
    pub text: Cow<'a, str>,
    pub quoted: bool,
}

/// Walks over the rows of a text, keeping count of the lines.
pub(super) struct Rows<'a> {
    rest: &'a str,
    delimiter: u8,
    /// The line at which `rest` begins, from 1.
    line: u64,
}

/// Fault in a row, and where it is.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct BadRow {
    pub line: u64,
    pub found: &'static str,
}

impl<'a> Rows<'a> {
    pub fn new(rest: &'a str, delimiter: u8, line: u64) -> Self {
        Self { rest, delimiter, line }
    }

    /// Fills `fields` with the next row and gives the line on which it begins; `None` at the end.
    pub fn next_row(&mut self, fields: &mut Vec<Field<'a>>) -> Result<Option<u64>, BadRow> {
        fields.clear();
        self.skip_blank_and_comments();
        if self.rest.is_empty() {
            return Ok(None);
        }
        let line = self.line;
        loop {
            let more = if self.rest.starts_with('"') {
                self.quoted_field(fields)?
            } else {
                self.plain_field(fields)
            };
            if !more {
                return Ok(Some(line));
            }
        }
    }

    fn skip_blank_and_comments(&mut self) {
        while !self.rest.is_empty() {
            let end = self.rest.find('\n').map_or(self.rest.len(), |i| i + 1);
            let content = self.rest[..end].trim_matches([' ', '\t', '\r', '\n']);
            if !content.is_empty() && !content.starts_with('#') {
                break;
            }
            self.rest = &self.rest[end..];
            self.line += 1;
        }
        self.rest = self.rest.trim_start_matches([' ', '\t']);
    }

    /// Takes an unquoted field; whether another field follows.
    fn plain_field(&mut self, fields: &mut Vec<Field<'a>>) -> bool {
        let bytes = self.rest.as_bytes();
        let end =
            bytes.iter().position(|&b| b == self.delimiter || b == b'\n').unwrap_or(bytes.len());
        let text = self.rest[..end].trim_matches([' ', '\t', '\r']);
        self.rest = &self.rest[end..];
        let blanks_at_the_end = text.is_empty() && self.delimiter == b' ';
        if !blanks_at_the_end {
            fields.push(Field { text: Cow::Borrowed(text), quoted: false });
        }
        self.after_field()
    }

    /// Takes a quoted field, in which a doubled quote is a quote; whether another field follows.
    fn quoted_field(&mut self, fields: &mut Vec<Field<'a>>) -> Result<bool, BadRow> {
        let line = self.line;
        let open = BadRow { line, found: "a quote that is not closed" };
        let mut text = Cow::Borrowed("");
        self.rest = &self.rest[1..];
        loop {
            let Some(end) = self.rest.find('"') else { return Err(open) };
            let piece = &self.rest[..end];
            self.line += piece.bytes().filter(|&b| b == b'\n').count() as u64;
            self.rest = &self.rest[end + 1..];
            if text.is_empty() {
                text = Cow::Borrowed(piece);
            } else {
                text.to_mut().push_str(piece);
            }
            if !self.rest.starts_with('"') {
                break;
            }
            text.to_mut().push('"');
            self.rest = &self.rest[1..];
        }
        fields.push(Field { text, quoted: true });
        // Blanks may follow the quote, nothing else.
        if self.delimiter != b' ' {
            self.rest = self.rest.trim_start_matches([' ', '\t']);
        }
        self.rest = self.rest.strip_prefix('\r').unwrap_or(self.rest);
        match self.rest.as_bytes().first() {
            Some(&b) if b != self.delimiter && b != b'\n' => {
                Err(BadRow { line: self.line, found: "text after a closing quote" })
            }
            _ => Ok(self.after_field()),
        }
    }

    /// Takes the delimiter or the end of the line; whether another field follows.
    fn after_field(&mut self) -> bool {
        match self.rest.as_bytes().first() {
            Some(b'\n') => {
                self.line += 1;
                self.rest = &self.rest[1..];
                false
            }
            Some(_) => {
                self.rest = &self.rest[1..];
                if self.delimiter != b' ' {
                    // A quote may follow blanks, as in `1, "two"`.
                    let trimmed = self.rest.trim_start_matches([' ', '\t']);
                    if trimmed.starts_with('"') {
                        self.rest = trimmed;
                    }
                    return true;
                }
                self.rest = self.rest.trim_start_matches(' ');
                let over = self.rest.trim_start_matches('\r');
                if over.is_empty() || over.starts_with('\n') {
                    // Blanks at the end of a line separate nothing.
                    self.rest = over;
                    return !over.is_empty() && self.after_field();
                }
                true
            }
            None => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str, delimiter: u8) -> Vec<(u64, Vec<(String, bool)>)> {
        let mut rows = Rows::new(text, delimiter, 1);
        let mut fields = Vec::new();
        let mut out = Vec::new();
        while let Some(line) = rows.next_row(&mut fields).unwrap() {
            out.push((line, fields.iter().map(|f| (f.text.to_string(), f.quoted)).collect()));
        }
        out
    }

    fn plain(text: &str) -> (String, bool) {
        (text.to_owned(), false)
    }

    fn quoted(text: &str) -> (String, bool) {
        (text.to_owned(), true)
    }

    #[test]
    fn commas_quotes_and_lines() {
        let text = " \"a\", \"b\"\"c\" ,\r\n# note\n\n\"x\ny\",\"\",3\n1,,";
        assert_eq!(
            all(text, b','),
            vec![
                (1, vec![quoted("a"), quoted("b\"c"), plain("")]),
                (4, vec![quoted("x\ny"), quoted(""), plain("3")]),
                (6, vec![plain("1"), plain(""), plain("")]),
            ]
        );
    }

    #[test]
    fn blanks() {
        let text = "  a  b \"\" \r\n\"c d\" e  \n f";
        assert_eq!(
            all(text, b' '),
            vec![
                (1, vec![plain("a"), plain("b"), quoted("")]),
                (2, vec![quoted("c d"), plain("e")]),
                (3, vec![plain("f")]),
            ]
        );
    }

    #[test]
    fn bad_quotes_are_named() {
        let bad = |text| Rows::new(text, b',', 7).next_row(&mut Vec::new()).unwrap_err();
        assert_eq!(bad("a,\"b\nc"), BadRow { line: 7, found: "a quote that is not closed" });
        assert_eq!(bad("\"b\nc\"d"), BadRow { line: 8, found: "text after a closing quote" });
    }
}
