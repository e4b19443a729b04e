//! The elements of an INDI stream, as they arrive: XML without a root, in pieces of any size, in bounded memory.
//!
//! Covers what INDI needs of XML and no more: elements, attributes, text, comments and processing instructions (skipped), the
//! five named entities and characters by number. A document type is refused, so that nothing can expand. Bytes that are not
//! UTF-8 become U+FFFD: some drivers send labels in Latin-1. The text of a `oneBLOB` is decoded while it arrives.

use super::base64::{Base64Error, Decoder};

/// How much of what the parser takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// The BLOBs of one element, bytes when decoded. A frame of 67 Mpx of 16 bits has 128 MiB.
    pub blob_bytes: usize,
    /// One element without its BLOBs, bytes of XML.
    pub element_bytes: usize,
    /// One tag with its attributes, bytes of XML.
    pub tag_bytes: usize,
    /// Elements within an element.
    pub children: usize,
    /// Elements within each other. INDI has two.
    pub depth: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            blob_bytes: 128 << 20,
            element_bytes: 1 << 20,
            tag_bytes: 64 << 10,
            children: 4096,
            depth: 4,
        }
    }
}

/// Why a stream cannot be read on. The connection has to be made anew: without a root there is no way to find into step.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum XmlError {
    /// Not XML, or not as INDI uses it.
    #[error("byte {at} of the stream: found {found}, expected {expected}")]
    Syntax {
        /// Where, bytes since the connection was made.
        at: u64,
        /// Text that was found there.
        found: String,
        /// Description of what should stand there.
        expected: &'static str,
    },
    /// More than the limits allow.
    #[error(
        "byte {at} of the stream: {what} of more than {most}: raise the limit if this is meant"
    )]
    TooMuch {
        /// Where.
        at: u64,
        /// Name of what exceeds the limit.
        what: &'static str,
        /// How much there may be.
        most: usize,
    },
    /// A BLOB that is no base64.
    #[error("byte {at} of the stream: a BLOB is damaged: {source}")]
    Blob {
        /// Where.
        at: u64,
        /// Error in the base64 text.
        source: Base64Error,
    },
}

/// An element, whole.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Element {
    /// Tag of the element.
    pub tag: String,
    /// Attributes of the element in their order.
    pub attributes: Vec<(String, String)>,
    /// The elements in it.
    pub children: Vec<Element>,
    /// Text of the element itself, without space around it.
    pub text: String,
    /// The bytes of a `oneBLOB`.
    pub blob: Option<Vec<u8>>,
}

impl Element {
    /// An attribute's value.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }
}

/// An element that is not closed yet.
#[derive(Debug)]
struct Open {
    element: Element,
    raw: Vec<u8>,
    blob: Option<Decoder>,
}

/// Reads elements out of bytes that are fed piece by piece.
#[derive(Debug)]
pub struct Parser {
    limits: Limits,
    /// Bytes that were fed and not read yet, from `next` on.
    buffer: Vec<u8>,
    next: usize,
    /// How far the tag at `next` was looked through for its end, and the quote that was open there.
    scanned: usize,
    quote: Option<u8>,
    /// Bytes of the stream before `buffer`.
    before: u64,
    open: Vec<Open>,
    element_bytes: usize,
    blob_bytes: usize,
    failed: Option<XmlError>,
}

impl Parser {
    /// A parser at the start of a stream.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            buffer: Vec::new(),
            next: 0,
            scanned: 0,
            quote: None,
            before: 0,
            open: Vec::new(),
            element_bytes: 0,
            blob_bytes: 0,
            failed: None,
        }
    }

    /// Takes no BLOBs of more than `bytes`, from now on.
    pub fn limit_blobs(&mut self, bytes: usize) {
        self.limits.blob_bytes = bytes;
    }

    /// Adds bytes of the stream. Call [`element`](Self::element) until it gives `None` before the next piece.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.next);
        self.before += self.next as u64;
        self.scanned = self.scanned.saturating_sub(self.next);
        self.next = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// Bytes that the parser holds: of tags that are not whole, of text and BLOBs of elements that are not.
    pub fn held_bytes(&self) -> usize {
        let open = self.open.iter().map(|open| {
            open.raw.len() + open.blob.as_ref().map_or(0, Decoder::len) + open.element.tag.len()
        });
        self.buffer.len() + self.element_bytes + open.sum::<usize>()
    }

    /// Whether the stream stands between two elements.
    pub fn is_between_elements(&self) -> bool {
        self.open.is_empty() && self.rest().iter().all(u8::is_ascii_whitespace)
    }

    /// The next whole element; `None` if more bytes are needed.
    ///
    /// # Errors
    /// The first thing that cannot be read; the same from then on.
    pub fn element(&mut self) -> Result<Option<Element>, XmlError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        let result = self.advance();
        if let Err(error) = &result {
            self.failed = Some(error.clone());
            self.open.clear();
            self.buffer = Vec::new();
            (self.next, self.scanned) = (0, 0);
        }
        result
    }

    fn advance(&mut self) -> Result<Option<Element>, XmlError> {
        loop {
            self.text()?;
            if self.rest().is_empty() {
                return Ok(None);
            }
            let Some(length) = self.tag_length()? else { return Ok(None) };
            let tag = self.next..self.next + length;
            self.count(length)?;
            let done = self.tag(tag.clone())?;
            self.next = tag.end;
            self.scanned = tag.end;
            self.quote = None;
            if self.open.is_empty() {
                self.element_bytes = 0;
                self.blob_bytes = 0;
            }
            if done.is_some() {
                return Ok(done);
            }
        }
    }

    fn rest(&self) -> &[u8] {
        self.buffer.get(self.next..).unwrap_or(&[])
    }

    fn at(&self) -> u64 {
        self.before + self.next as u64
    }

    fn syntax(&self, found: impl Into<String>, expected: &'static str) -> XmlError {
        XmlError::Syntax { at: self.at(), found: found.into(), expected }
    }

    fn too_much(&self, what: &'static str, most: usize) -> XmlError {
        XmlError::TooMuch { at: self.at(), what, most }
    }

    fn count(&mut self, bytes: usize) -> Result<(), XmlError> {
        self.element_bytes += bytes;
        if self.element_bytes > self.limits.element_bytes {
            return Err(self.too_much("an element", self.limits.element_bytes));
        }
        Ok(())
    }

    /// Takes text up to the next tag.
    fn text(&mut self) -> Result<(), XmlError> {
        let length = self.rest().iter().position(|&b| b == b'<').unwrap_or(self.rest().len());
        if length == 0 {
            return Ok(());
        }
        let range = self.next..self.next + length;
        let at = self.at();
        match self.open.last_mut() {
            None => {
                let text = &self.buffer[range.clone()];
                if let Some(i) = text.iter().position(|b| !b.is_ascii_whitespace()) {
                    let found = format!("text `{}`", excerpt(&text[i..]));
                    return Err(self.syntax(found, "an element"));
                }
            }
            Some(Open { blob: Some(decoder), .. }) => {
                let before = decoder.len();
                let fed = decoder.feed(&self.buffer[range.clone()]);
                fed.map_err(|source| XmlError::Blob { at, source })?;
                self.blob_bytes += decoder.len() - before;
                if self.blob_bytes > self.limits.blob_bytes {
                    return Err(self.too_much("a BLOB", self.limits.blob_bytes));
                }
            }
            Some(open) => {
                open.raw.extend_from_slice(&self.buffer[range.clone()]);
                self.count(length)?;
            }
        }
        self.next = range.end;
        self.scanned = range.end;
        Ok(())
    }

    /// The length of the tag (comment, instruction) that begins here, if it is whole.
    fn tag_length(&mut self) -> Result<Option<usize>, XmlError> {
        let comment = self.rest().starts_with(b"<!--");
        if matches!(self.rest(), [b'<', b'!', other, ..] if *other != b'-') {
            let found = format!("`{}`", excerpt(self.rest()));
            return Err(self.syntax(found, "an element"));
        }
        let mut i = self.scanned.max(self.next);
        while let Some(&byte) = self.buffer.get(i) {
            i += 1;
            if comment {
                if byte == b'>' && i - self.next >= 7 && self.buffer[..i].ends_with(b"-->") {
                    return Ok(Some(i - self.next));
                }
                continue;
            }
            match self.quote {
                Some(quote) if byte == quote => self.quote = None,
                Some(_) => {}
                None if byte == b'>' => return Ok(Some(i - self.next)),
                // `<!-` may still become a comment, in which quotes mean nothing.
                None if byte == b'"' || byte == b'\'' => self.quote = Some(byte),
                None if byte == b'<' && i - 1 > self.next => {
                    return Err(self.syntax("`<` within a tag", "`>`"));
                }
                None => {}
            }
        }
        self.scanned = i;
        if i - self.next > self.limits.tag_bytes {
            return Err(self.too_much("a tag", self.limits.tag_bytes));
        }
        Ok(None)
    }

    /// Reads a tag; the element, if it closes the outermost one.
    fn tag(&mut self, range: std::ops::Range<usize>) -> Result<Option<Element>, XmlError> {
        if range.len() > self.limits.tag_bytes {
            return Err(self.too_much("a tag", self.limits.tag_bytes));
        }
        let bytes = &self.buffer[range];
        if bytes.starts_with(b"<?") || bytes.starts_with(b"<!--") {
            return Ok(None);
        }
        if bytes.starts_with(b"<!") {
            return Err(self.syntax(format!("`{}`", excerpt(bytes)), "an element"));
        }
        let inner = String::from_utf8_lossy(&bytes[1..bytes.len() - 1]).into_owned();
        if let Some(name) = inner.strip_prefix('/') {
            return self.close(name.trim_end());
        }
        let (inner, empty) = match inner.strip_suffix('/') {
            Some(inner) => (inner, true),
            None => (inner.as_str(), false),
        };
        let element = self.start(inner)?;
        if self.open.len() >= self.limits.depth {
            return Err(self.too_much("elements within each other", self.limits.depth));
        }
        let blob = (element.tag == "oneBLOB").then(Decoder::default);
        let name = element.tag.clone();
        self.open.push(Open { element, raw: Vec::new(), blob });
        if empty { self.close(&name) } else { Ok(None) }
    }

    fn close(&mut self, name: &str) -> Result<Option<Element>, XmlError> {
        let Some(open) = self.open.pop() else {
            return Err(self.syntax(format!("`</{}>`", excerpt(name.as_bytes())), "an element"));
        };
        let Open { mut element, raw, blob } = open;
        if element.tag != name {
            let found = format!(
                "`</{}>` for `<{}>`",
                excerpt(name.as_bytes()),
                excerpt(element.tag.as_bytes())
            );
            return Err(self.syntax(found, "the end of the element that was opened last"));
        }
        match blob {
            Some(decoder) => {
                let bytes = decoder.finish();
                let at = self.at();
                element.blob = Some(bytes.map_err(|source| XmlError::Blob { at, source })?);
            }
            None => element.text = self.unescaped(&String::from_utf8_lossy(&raw))?.trim().into(),
        }
        match self.open.last_mut() {
            None => Ok(Some(element)),
            Some(parent) if parent.element.children.len() >= self.limits.children => {
                Err(self.too_much("children of an element", self.limits.children))
            }
            Some(parent) => {
                parent.element.children.push(element);
                Ok(None)
            }
        }
    }

    /// Tag and attributes out of what stands between `<` and `>`.
    fn start(&self, inner: &str) -> Result<Element, XmlError> {
        let end = inner.find(|c: char| c.is_ascii_whitespace()).unwrap_or(inner.len());
        let (tag, mut rest) = inner.split_at(end);
        if !is_name(tag) {
            let found = format!("`<{}`", excerpt(tag.as_bytes()));
            return Err(self.syntax(found, "the name of an element"));
        }
        let mut element = Element { tag: tag.to_owned(), ..Element::default() };
        loop {
            rest = rest.trim_start();
            if rest.is_empty() {
                return Ok(element);
            }
            let bad = || self.syntax(format!("`{}`", excerpt(rest.as_bytes())), "name=\"value\"");
            let (name, after) = rest.split_once('=').ok_or_else(bad)?;
            let name = name.trim_end();
            let after = after.trim_start();
            let quote = after.chars().next().filter(|c| matches!(c, '"' | '\'')).ok_or_else(bad)?;
            let (value, after) = after[1..].split_once(quote).ok_or_else(bad)?;
            if !is_name(name) || value.contains('<') || element.attribute(name).is_some() {
                return Err(bad());
            }
            element.attributes.push((name.to_owned(), self.unescaped(value)?));
            rest = after;
        }
    }

    /// The text with its entities resolved.
    fn unescaped(&self, text: &str) -> Result<String, XmlError> {
        let mut plain = String::with_capacity(text.len());
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('&') {
            plain.push_str(before);
            let entity = after.split_once(';').and_then(|(name, after)| {
                let character = match name {
                    "lt" => '<',
                    "gt" => '>',
                    "amp" => '&',
                    "quot" => '"',
                    "apos" => '\'',
                    _ => numbered(name)?,
                };
                Some((character, after))
            });
            let Some((character, after)) = entity else {
                let found = format!("`&{}`", excerpt(after.as_bytes()));
                return Err(self.syntax(found, "&amp;, &lt;, &gt;, &quot;, &apos; or &#NUMBER;"));
            };
            plain.push(character);
            rest = after;
        }
        plain.push_str(rest);
        Ok(plain)
    }
}

/// `#65` or `#x41`.
fn numbered(name: &str) -> Option<char> {
    let digits = name.strip_prefix('#')?;
    let (digits, radix) = match digits.strip_prefix(['x', 'X']) {
        Some(digits) => (digits, 16),
        None => (digits, 10),
    };
    // `from_str_radix` takes a sign, XML does not.
    if !digits.bytes().all(|b| b.is_ascii_alphanumeric()) {
        return None;
    }
    char::from_u32(u32::from_str_radix(digits, radix).ok()?).filter(|&c| c != '\0')
}

fn is_name(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || "_-.:".contains(c))
}

/// The first characters, for a message.
fn excerpt(bytes: &[u8]) -> String {
    const MOST: usize = 40;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MOST)]);
    let mut text: String = text.chars().flat_map(char::escape_debug).collect();
    if bytes.len() > MOST {
        text.push('…');
    }
    text
}

/// The text with what XML needs escaped, for text and attributes.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&apos;"),
            character => out.push(character),
        }
    }
    out
}
