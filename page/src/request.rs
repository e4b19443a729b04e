//! Requests as the parts of the page see them, and their answers.

use serde::Serialize;
use std::collections::BTreeMap;

/// Pairs of a query that are read.
const QUERY: usize = 64;

/// What answers the requests below `/api/`, on threads of its own.
pub trait Source: Send + Sync {
    /// Answers one.
    fn answer(&self, request: &Request) -> Answer;
}

/// A request that passed the gate.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Whether it asks for a change: it then has the token.
    pub post: bool,
    /// Path below `/api/`, decoded. It names things that the source holds, never files.
    pub path: Vec<String>,
    query: BTreeMap<String, String>,
    /// Body of a POST.
    pub body: Vec<u8>,
}

impl Request {
    /// Takes a request apart; `None` where it is not encoded as UTF-8.
    pub fn new(post: bool, path: &str, query: &str, body: Vec<u8>) -> Option<Self> {
        let path = path.split('/').map(decoded).collect::<Option<_>>()?;
        let pairs = query.split('&').filter(|pair| !pair.is_empty()).take(QUERY);
        let pair = |pair: &str| {
            let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
            Some((decoded(key)?, decoded(value)?))
        };
        Some(Self { post, path, query: pairs.map(pair).collect::<Option<_>>()?, body })
    }

    /// Whether it is a command, such as Stop, that waits for no other answer.
    pub fn is_command(&self) -> bool {
        self.post && matches!(self.parts().as_slice(), ["control"] | ["reduction", "cancel"])
    }

    /// The parts of the path.
    pub fn parts(&self) -> Vec<&str> {
        self.path.iter().map(String::as_str).collect()
    }

    /// Value of a key of the query.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.query.get(key).map(String::as_str)
    }

    /// The same as a finite number.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.text(key)?.parse().ok().filter(|number: &f64| number.is_finite())
    }

    /// The same as a whole number.
    pub fn whole(&self, key: &str) -> Option<u64> {
        self.text(key)?.parse().ok()
    }

    /// All keys that begin with a prefix, without it.
    pub fn prefixed<'a>(&'a self, prefix: &'a str) -> impl Iterator<Item = (&'a str, &'a str)> {
        let of = move |(key, value): (&'a String, &'a String)| {
            Some((key.strip_prefix(prefix)?, value.as_str()))
        };
        self.query.iter().filter_map(of)
    }
}

/// Text with `%41` for `A` as it was meant.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        rest = after;
        match first {
            b'%' => {
                let digits = std::str::from_utf8(rest.get(..2)?).ok()?;
                if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
                    return None;
                }
                bytes.push(u8::from_str_radix(digits, 16).ok()?);
                rest = &rest[2..];
            }
            b'+' => bytes.push(b' '),
            byte => bytes.push(byte),
        }
    }
    String::from_utf8(bytes).ok()
}

/// An answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    /// Content type.
    pub kind: &'static str,
    /// Content.
    pub body: Vec<u8>,
}

#[derive(Serialize)]
struct Fault<'a> {
    error: &'a str,
}

impl Answer {
    /// A JSON document.
    pub fn json(value: &impl Serialize) -> Self {
        match serde_json::to_vec(value) {
            Ok(body) => Self { status: 200, kind: "application/json", body },
            Err(_) => Self::error(500, "the answer cannot be written as JSON"),
        }
    }

    /// Bytes.
    pub fn bytes(body: Vec<u8>) -> Self {
        Self { status: 200, kind: "application/octet-stream", body }
    }

    /// An error, `{"error": …}`.
    pub fn error(status: u16, text: &str) -> Self {
        let body = serde_json::to_vec(&Fault { error: text }).unwrap_or_default();
        Self { status, kind: "application/json", body }
    }

    /// A resource that is not there.
    pub fn missing() -> Self {
        Self::error(404, "there is no such thing in this session")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: RFC 3986, by hand. Parts of a path stay parts, whatever they decode to.
    #[test]
    fn requests_are_taken_apart() {
        let request =
            Request::new(false, "frame/c%2F..%2f/7", "x=1.5&name=a%26b+c&bare&n=NaN", vec![])
                .unwrap();
        assert_eq!(request.parts(), ["frame", "c/../", "7"]);
        assert_eq!((request.number("x"), request.number("n")), (Some(1.5), None));
        assert_eq!((request.text("name"), request.text("bare")), (Some("a&b c"), Some("")));
        for bad in ["%", "%4", "%zz", "%+1", "%ff", "%é"] {
            assert_eq!(Request::new(false, bad, "", vec![]), None, "{bad}");
        }
    }
}
