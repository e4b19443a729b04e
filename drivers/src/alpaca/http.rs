//! HTTP/1.1 as far as Alpaca needs it: one request after the other on one connection, bounded answers, and a new connection after anything went wrong.

use super::answer::clean;
use crate::clock::Deadline;
use crate::transport::{Bytes, TransportError};

/// The most that the head of an answer may have, bytes.
pub const MOST_HEAD: usize = 16 << 10;
/// Interim answers (`100 Continue`) before the real one.
const MOST_INTERIM: u32 = 8;

/// An answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Response {
    /// Status (200).
    pub status: u16,
    /// Type of the body, in lower case, without parameters.
    pub content_type: String,
    /// The body.
    pub body: Vec<u8>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Head,
    /// Bytes of the body that are missing.
    Length(usize),
    ChunkSize,
    /// Bytes of the chunk that are missing, the line end behind it among them.
    Chunk(usize),
    Trailer,
    UntilEnd,
    Done,
}

/// Reader of one answer, in pieces of any size. It holds no more than the head, the body and one piece.
#[derive(Debug)]
pub struct ResponseParser {
    most_body: usize,
    raw: Vec<u8>,
    state: State,
    interim: u32,
    status: u16,
    content_type: String,
    keeps: bool,
    body: Vec<u8>,
    trailer: usize,
}

impl ResponseParser {
    /// A reader of an answer whose body has at most `most_body` bytes.
    pub fn new(most_body: usize) -> Self {
        Self {
            most_body,
            raw: Vec::new(),
            state: State::Head,
            interim: 0,
            status: 0,
            content_type: String::new(),
            keeps: false,
            body: Vec::new(),
            trailer: 0,
        }
    }

    /// Takes a piece. Returns true once the answer is whole.
    ///
    /// # Errors
    /// Description of what is no HTTP, or larger than it may be.
    pub fn feed(&mut self, piece: &[u8]) -> Result<bool, String> {
        self.raw.extend_from_slice(piece);
        while self.step()? {}
        Ok(self.state == State::Done)
    }

    /// Ends the answer where the server has closed the connection. Returns true if it is whole then.
    pub fn end(&mut self) -> bool {
        if self.state == State::UntilEnd {
            self.state = State::Done;
        }
        self.state == State::Done
    }

    /// Bytes held.
    pub fn held_bytes(&self) -> usize {
        self.raw.len() + self.body.len()
    }

    /// Whether the connection can carry another request.
    pub fn keeps(&self) -> bool {
        self.keeps && self.raw.is_empty()
    }

    /// The answer.
    pub fn into_response(self) -> Response {
        Response { status: self.status, content_type: self.content_type, body: self.body }
    }

    fn take(&mut self, most: usize) -> Result<usize, String> {
        let count = most.min(self.raw.len());
        if self.body.len() + count > self.most_body {
            return Err(format!("the answer is longer than the {} bytes allowed", self.most_body));
        }
        self.body.extend(self.raw.drain(..count));
        Ok(count)
    }

    /// A line that is there, without its end.
    fn line(&mut self, most: usize) -> Result<Option<String>, String> {
        match self.raw.iter().take(most + 1).position(|&byte| byte == b'\n') {
            Some(at) => {
                let line: Vec<u8> = self.raw.drain(..=at).collect();
                Ok(Some(String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned()))
            }
            None if self.raw.len() > most => Err(format!("a line of more than {most} bytes")),
            None => Ok(None),
        }
    }

    /// One step; false where more bytes are needed, or none.
    fn step(&mut self) -> Result<bool, String> {
        match self.state {
            State::Head => self.head(),
            State::Length(left) => {
                let count = self.take(left)?;
                self.state = if count == left { State::Done } else { State::Length(left - count) };
                Ok(false)
            }
            State::UntilEnd => {
                self.take(usize::MAX)?;
                Ok(false)
            }
            State::ChunkSize => {
                let Some(line) = self.line(256)? else { return Ok(false) };
                let size = line.split(';').next().unwrap_or_default().trim();
                let digits = !size.is_empty() && size.bytes().all(|b| b.is_ascii_hexdigit());
                let size = usize::from_str_radix(size, 16).ok().filter(|_| digits);
                let size =
                    size.ok_or_else(|| format!("a chunk of `{}` bytes", clean(&line, 40)))?;
                if size > self.most_body.saturating_sub(self.body.len()) {
                    return Err(format!(
                        "the answer is longer than the {} bytes allowed",
                        self.most_body
                    ));
                }
                self.state = if size == 0 { State::Trailer } else { State::Chunk(size) };
                Ok(true)
            }
            State::Chunk(0) => {
                let Some(line) = self.line(2)? else { return Ok(false) };
                if !line.is_empty() {
                    return Err("a chunk without its end".into());
                }
                self.state = State::ChunkSize;
                Ok(true)
            }
            State::Chunk(left) => {
                let count = self.take(left)?;
                self.state = State::Chunk(left - count);
                Ok(count == left)
            }
            State::Trailer => {
                let Some(line) = self.line(MOST_HEAD)? else { return Ok(false) };
                self.trailer += line.len() + 2;
                if self.trailer > MOST_HEAD {
                    return Err(format!("a trailer of more than {MOST_HEAD} bytes"));
                }
                if line.is_empty() {
                    self.state = State::Done;
                }
                Ok(!line.is_empty())
            }
            State::Done => Ok(false),
        }
    }

    fn head(&mut self) -> Result<bool, String> {
        let ends = |end: &[u8]| {
            let found = self.raw.windows(end.len()).position(|window| window == end);
            found.map(|at| at + end.len())
        };
        let end = match (ends(b"\r\n\r\n"), ends(b"\n\n")) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        let Some(end) = end.filter(|end| *end <= MOST_HEAD) else {
            return if self.raw.len() > MOST_HEAD {
                Err(format!("a head of more than {MOST_HEAD} bytes"))
            } else {
                Ok(false)
            };
        };
        let head: Vec<u8> = self.raw.drain(..end).collect();
        let head = String::from_utf8_lossy(&head).into_owned();
        let mut lines = head.lines();
        let first = lines.next().unwrap_or_default();
        let wrong = || {
            let seen = clean(first, 40);
            format!("`{seen}` is no answer of HTTP: is this the port of an Alpaca server?")
        };
        let mut words = first.split_ascii_whitespace();
        let version = words.next().filter(|v| v.starts_with("HTTP/1.")).ok_or_else(wrong)?;
        let status: u16 = words
            .next()
            .and_then(|code| code.parse().ok())
            .filter(|code| (100..600).contains(code))
            .ok_or_else(wrong)?;
        let mut keeps = version != "HTTP/1.0";
        let (mut length, mut chunked, mut content_type) = (None, false, String::new());
        for line in lines.filter(|line| !line.is_empty()) {
            let Some((name, value)) = line.split_once(':') else {
                return Err("a line of the head without a colon".into());
            };
            let value = value.trim();
            match name.trim().to_ascii_lowercase().as_str() {
                "content-length" => {
                    let number: usize = value
                        .parse()
                        .map_err(|_| format!("a Content-Length of `{}`", clean(value, 40)))?;
                    if length.is_some_and(|known| known != number) {
                        return Err("two different Content-Lengths".into());
                    }
                    length = Some(number);
                }
                "transfer-encoding" if value.eq_ignore_ascii_case("chunked") => chunked = true,
                "transfer-encoding" => {
                    return Err(format!("a Transfer-Encoding of `{}`", clean(value, 40)));
                }
                "content-encoding" if !value.eq_ignore_ascii_case("identity") => {
                    let value = clean(value, 40);
                    return Err(format!("a Content-Encoding of `{value}`, which nobody asked for"));
                }
                "content-type" => {
                    let kind = value.split(';').next().unwrap_or_default();
                    content_type = kind.trim().to_ascii_lowercase();
                }
                "connection" => {
                    let has = |word: &str| {
                        value.split(',').any(|part| part.trim().eq_ignore_ascii_case(word))
                    };
                    keeps = (keeps || has("keep-alive")) && !has("close");
                }
                _ => {}
            }
        }
        if status < 200 {
            self.interim += 1;
            if self.interim > MOST_INTERIM {
                return Err("interim answers without end".into());
            }
            return Ok(true);
        }
        (self.status, self.content_type, self.keeps) = (status, content_type, keeps);
        self.state = match (chunked, length) {
            _ if status == 204 || status == 304 => State::Done,
            (true, _) => State::ChunkSize,
            (false, Some(0)) => State::Done,
            (false, Some(length)) if length > self.most_body => {
                return Err(format!(
                    "an answer of {length} bytes is announced, {} are allowed",
                    self.most_body
                ));
            }
            (false, Some(length)) => {
                // Once, and no more than is announced: a buffer that grows is twice as large.
                self.body
                    .try_reserve_exact(length)
                    .map_err(|_| format!("no memory for the {length} bytes announced"))?;
                State::Length(length)
            }
            (false, None) => {
                self.keeps = false;
                State::UntilEnd
            }
        };
        Ok(self.state != State::Done)
    }
}

/// Why there is no answer.
#[derive(Debug)]
pub(super) enum HttpError {
    Transport(TransportError),
    /// Something came that is no answer.
    Malformed(String),
}

impl From<TransportError> for HttpError {
    fn from(error: TransportError) -> Self {
        Self::Transport(error)
    }
}

/// A request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Request<'a> {
    /// `GET` or `PUT`.
    pub method: &'static str,
    /// Path, with the parameters of a `GET`.
    pub path: &'a str,
    /// Form of a `PUT`.
    pub form: &'a str,
    /// Types that are taken.
    pub accept: &'static str,
    /// The most that the body may have, bytes.
    pub most_body: usize,
    /// Whether doing it twice is the same as doing it once.
    pub repeats: bool,
}

/// A connection.
#[derive(Debug)]
pub(super) struct Http<T> {
    line: T,
    host: String,
    /// Whether the line's content is unknown: it has to be connected again.
    broken: bool,
    used: bool,
}

impl<T: Bytes> Http<T> {
    pub fn new(line: T, host: &str) -> Self {
        Self { line, host: host.to_owned(), broken: false, used: false }
    }

    pub fn line(&self) -> &T {
        &self.line
    }

    /// Gives the connection up: the next request makes a new one.
    pub fn forget(&mut self) {
        self.broken = true;
    }

    /// Asks, and waits for the answer. Where a kept connection turns out to be closed, the request is repeated once on a new one, if that is harmless.
    pub fn exchange(
        &mut self,
        request: &Request<'_>,
        deadline: &Deadline,
    ) -> Result<Response, HttpError> {
        let fresh = !self.used || self.broken;
        // What has come unasked, such as a second answer, would be taken for that of this request, and each answer for that of the next from then on. A connection
        // that was closed meanwhile is seen here, too.
        if !fresh && !matches!(self.line.discard(deadline), Ok(dropped) if dropped.is_empty()) {
            self.broken = true;
        }
        let had = !self.broken;
        match self.once(request, deadline) {
            Err((HttpError::Transport(TransportError::Disconnected { .. }), false))
                if had && !fresh && request.repeats =>
            {
                self.once(request, deadline).map_err(|(error, _)| error)
            }
            other => other.map_err(|(error, _)| error),
        }
    }

    /// One attempt; with an error comes whether any of the answer had come.
    fn once(
        &mut self,
        request: &Request<'_>,
        deadline: &Deadline,
    ) -> Result<Response, (HttpError, bool)> {
        if self.broken {
            self.line.reconnect(deadline).map_err(|error| (error.into(), false))?;
            self.broken = false;
        }
        let Request { method, path, form, accept, most_body, .. } = *request;
        let host = &self.host;
        let mut text = format!(
            "{method} {path} HTTP/1.1\r\nHost: {host}\r\nUser-Agent: sunglint\r\nAccept: {accept}\r\nConnection: keep-alive\r\n"
        );
        if method == "PUT" {
            let length = form.len();
            text.push_str(&format!(
                "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {length}\r\n"
            ));
        }
        text.push_str("\r\n");
        text.push_str(form);
        // Whatever happens from here on but a whole answer leaves the line unknown.
        (self.broken, self.used) = (true, true);
        self.line.send(text.as_bytes(), deadline).map_err(|error| (error.into(), false))?;
        let mut parser = ResponseParser::new(most_body);
        let mut buffer = vec![0; 16 << 10];
        let mut any = false;
        loop {
            match self.line.receive(&mut buffer, deadline) {
                Ok(count) => {
                    any = true;
                    if parser.feed(&buffer[..count]).map_err(|e| (HttpError::Malformed(e), any))? {
                        break;
                    }
                }
                Err(TransportError::Disconnected { .. }) if parser.end() => break,
                Err(error) => return Err((error.into(), any)),
            }
        }
        self.broken = !parser.keeps();
        Ok(parser.into_response())
    }
}
