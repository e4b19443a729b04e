//! Who may ask for what: the name by which the server was called, the page that asks, and the token.

use hyper::header::{AUTHORIZATION, CONTENT_TYPE, HOST, HeaderMap, ORIGIN};
use hyper::{Method, StatusCode, Uri};
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Wrong tokens of one address in [`WINDOW`] after which it is told to wait. The right token always passes: whoever has it must be able to stop the night,
/// whatever others try, and 128 random bits are not guessed.
const WRONG: u32 = 20;
const WINDOW: Duration = Duration::from_secs(60);
/// Addresses whose wrong tokens are counted at most.
const ADDRESSES: usize = 1024;

/// Secret of a server: 128 random bits in hexadecimal digits. Whoever has it may steer.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(…)")
    }
}

impl Token {
    /// Draws a token.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn new() -> std::io::Result<Self> {
        let mut bytes = [0_u8; 16];
        getrandom::fill(&mut bytes).map_err(|error| std::io::Error::other(error.to_string()))?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// The token as text, for the person who starts the server.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Compares in a time that does not depend on where they differ.
    fn is(&self, other: &[u8]) -> bool {
        let own = self.0.as_bytes();
        let differ = own.iter().zip(other).fold(0, |differ, (a, b)| differ | (a ^ b));
        own.len() == other.len() && differ == 0
    }
}

/// Refusal of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub status: StatusCode,
    pub text: &'static str,
}

fn refuse<T>(status: StatusCode, text: &'static str) -> Result<T, Refusal> {
    Err(Refusal { status, text })
}

/// The rules of one server.
#[derive(Debug)]
pub(crate) struct Gate {
    address: SocketAddr,
    token: Token,
    /// Wrong tokens by address: since when, and how many.
    wrong: Mutex<HashMap<IpAddr, (Instant, u32)>>,
}

impl Gate {
    pub fn new(address: SocketAddr, token: Token) -> Self {
        Self { address, token, wrong: Mutex::default() }
    }

    /// Whether a name in a request is ours. On loopback these are its three names; elsewhere an address, never a name: a foreign name may be made to lead here
    /// (DNS rebinding), an address cannot.
    fn is_ours(&self, host: &str) -> bool {
        let port = self.address.port();
        let bare = match host.rsplit_once(':') {
            Some((bare, said)) if said.parse() == Ok(port) => bare,
            _ if port == 80 => host,
            _ => return false,
        };
        if self.address.ip().is_loopback() {
            return ["127.0.0.1", "localhost", "[::1]"].contains(&bare);
        }
        let bracketed = bare.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
        match bracketed {
            Some(six) => matches!(six.parse(), Ok(IpAddr::V6(_))),
            None => matches!(bare.parse(), Ok(IpAddr::V4(_))),
        }
    }

    /// Whether a request of a client may pass.
    pub fn admit(
        &self,
        client: IpAddr,
        method: &Method,
        uri: &Uri,
        headers: &HeaderMap,
    ) -> Result<(), Refusal> {
        if method != Method::GET && method != Method::POST {
            return refuse(StatusCode::METHOD_NOT_ALLOWED, "GET and POST alone");
        }
        let one = |name: &str| {
            let mut all = headers.get_all(name).iter();
            match (all.next(), all.next()) {
                (Some(value), None) => value.to_str().ok(),
                _ => None,
            }
        };
        let wrong_host =
            "this server is not called by that name: open it by the address that its start printed";
        let Some(host) = one(HOST.as_str()).filter(|host| self.is_ours(host)) else {
            return refuse(StatusCode::MISDIRECTED_REQUEST, wrong_host);
        };
        if uri.authority().is_some_and(|authority| authority.as_str() != host) {
            return refuse(StatusCode::MISDIRECTED_REQUEST, wrong_host);
        }
        if headers.contains_key(ORIGIN) && one("origin") != Some(&format!("http://{host}")) {
            return refuse(StatusCode::FORBIDDEN, "another site's page may not ask this server");
        }
        if headers.contains_key("sec-fetch-site") {
            let navigates = method == Method::GET
                && uri.path() == "/"
                && one("sec-fetch-mode") == Some("navigate")
                && one("sec-fetch-dest") == Some("document");
            match one("sec-fetch-site") {
                Some("same-origin" | "none") => {}
                // A link from elsewhere may lead to the page, and to nothing else.
                Some(_) if navigates => {}
                _ => {
                    return refuse(
                        StatusCode::FORBIDDEN,
                        "another site's page may not ask this server",
                    );
                }
            }
        }
        let asks = uri.path().starts_with("/api/");
        let needs_token = method == Method::POST || (asks && !self.address.ip().is_loopback());
        if needs_token || asks {
            self.check_token(client, headers, needs_token)?;
        }
        let json = one(CONTENT_TYPE.as_str()).is_some_and(|kind| kind == "application/json");
        if method == Method::POST && !json {
            return refuse(StatusCode::UNSUPPORTED_MEDIA_TYPE, "a POST is application/json");
        }
        Ok(())
    }

    /// Looks at the token of a request. A wrong one is refused also where none is needed, so that a page learns of it before it has to steer.
    fn check_token(
        &self,
        client: IpAddr,
        headers: &HeaderMap,
        is_needed: bool,
    ) -> Result<(), Refusal> {
        let said = headers.get(AUTHORIZATION).and_then(|v| v.as_bytes().strip_prefix(b"Bearer "));
        match said {
            Some(said) if self.token.is(said) => Ok(()),
            Some(_) if self.is_over(client) => refuse(
                StatusCode::TOO_MANY_REQUESTS,
                "too many wrong tokens from this address: wait a minute",
            ),
            Some(_) => refuse(
                StatusCode::UNAUTHORIZED,
                "the token is not this server's: open the whole address that its start printed",
            ),
            None if !is_needed => Ok(()),
            None => refuse(
                StatusCode::UNAUTHORIZED,
                "this needs the token: open the whole address that the start of the server printed",
            ),
        }
    }

    /// Counts a wrong token, and tells whether its address had too many before.
    fn is_over(&self, client: IpAddr) -> bool {
        // A household has 2^64 addresses of version 6.
        let client = match client.to_canonical() {
            IpAddr::V6(six) => IpAddr::V6(Ipv6Addr::from_bits(six.to_bits() & (u128::MAX << 64))),
            four @ IpAddr::V4(_) => four,
        };
        let mut wrong = self.wrong.lock().unwrap_or_else(PoisonError::into_inner);
        wrong.retain(|_, (since, _)| since.elapsed() <= WINDOW);
        if wrong.len() >= ADDRESSES
            && !wrong.contains_key(&client)
            && let Some(oldest) = wrong.iter().min_by_key(|(_, (since, _))| *since)
        {
            let oldest = *oldest.0;
            wrong.remove(&oldest);
        }
        let of = wrong.entry(client).or_insert((Instant::now(), 0));
        of.1 = of.1.saturating_add(1);
        of.1 > WRONG
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(gate: &Gate, method: &str, path: &str, headers: &[(&'static str, &str)]) -> u16 {
        status_of(gate, "192.0.2.1", method, path, headers)
    }

    fn status_of(
        gate: &Gate,
        client: &str,
        method: &str,
        path: &str,
        headers: &[(&'static str, &str)],
    ) -> u16 {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, value.parse().unwrap());
        }
        let method = Method::from_bytes(method.as_bytes()).unwrap();
        match gate.admit(client.parse().unwrap(), &method, &path.parse().unwrap(), &map) {
            Ok(()) => 200,
            Err(refusal) => refusal.status.as_u16(),
        }
    }

    /// Truth: by hand, from the Fetch standard's headers and RFC 9110's status codes.
    #[test]
    fn the_rules_hold() {
        let token = Token::new().unwrap();
        let bearer = format!("Bearer {}", token.text());
        let near = Gate::new("127.0.0.1:8650".parse().unwrap(), token.clone());
        let host = ("host", "127.0.0.1:8650");
        let json = ("content-type", "application/json");
        for (expected, method, path, headers) in [
            (200, "GET", "/", vec![host]),
            (200, "GET", "/", vec![("host", "localhost:8650")]),
            (421, "GET", "/", vec![]),
            (421, "GET", "/", vec![host, host]),
            (421, "GET", "/", vec![("host", "evil.example")]),
            (421, "GET", "/", vec![("host", "evil.example:8650")]),
            (421, "GET", "/", vec![("host", "127.0.0.1")]),
            (421, "GET", "/", vec![("host", "192.168.1.2:8650")]),
            (421, "GET", "http://evil.example/", vec![host]),
            (200, "GET", "/api/about", vec![host, ("origin", "http://127.0.0.1:8650")]),
            // A token that is told is looked at; one of another kind is none.
            (200, "GET", "/api/about", vec![host, ("authorization", &bearer)]),
            (401, "GET", "/api/about", vec![host, ("authorization", "Bearer 0123")]),
            (200, "GET", "/api/about", vec![host, ("authorization", "Basic 0123")]),
            (200, "GET", "/", vec![host, ("authorization", "Bearer 0123")]),
            (403, "GET", "/api/about", vec![host, ("origin", "http://localhost:8650")]),
            (403, "GET", "/api/about", vec![host, ("origin", "null")]),
            (403, "GET", "/api/about", vec![host, ("sec-fetch-site", "cross-site")]),
            (
                403,
                "GET",
                "/",
                vec![host, ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "no-cors")],
            ),
            (
                200,
                "GET",
                "/",
                vec![
                    host,
                    ("sec-fetch-site", "cross-site"),
                    ("sec-fetch-mode", "navigate"),
                    ("sec-fetch-dest", "document"),
                ],
            ),
            (
                403,
                "GET",
                "/",
                vec![
                    host,
                    ("sec-fetch-site", "cross-site"),
                    ("sec-fetch-mode", "navigate"),
                    ("sec-fetch-dest", "iframe"),
                ],
            ),
            (405, "PUT", "/", vec![host]),
            (401, "POST", "/api/control", vec![host, json]),
            (401, "POST", "/api/control", vec![host, json, ("authorization", "Bearer 0123")]),
            (200, "POST", "/api/control", vec![host, json, ("authorization", &bearer)]),
            (
                415,
                "POST",
                "/api/control",
                vec![host, ("content-type", "text/plain"), ("authorization", &bearer)],
            ),
        ] {
            assert_eq!(
                status(&near, method, path, &headers),
                expected,
                "{method} {path} {headers:?}"
            );
        }
        // Beyond this computer nothing is told without the token, and no name leads here.
        let far = Gate::new("0.0.0.0:8650".parse().unwrap(), token);
        let host = ("host", "192.168.1.2:8650");
        assert_eq!(status(&far, "GET", "/", &[host]), 200);
        assert_eq!(status(&far, "GET", "/api/about", &[host]), 401);
        assert_eq!(status(&far, "GET", "/api/about", &[host, ("authorization", &bearer)]), 200);
        assert_eq!(status(&far, "GET", "/", &[("host", "observatory.example:8650")]), 421);
        // Wrong tokens hold up their own address alone, and the right one passes in any case.
        let ask = |client: &str, token: &str| {
            status_of(&far, client, "GET", "/api/x", &[host, ("authorization", token)])
        };
        for _ in 0..WRONG {
            assert_eq!(ask("2001:db8::1", "Bearer no"), 401);
        }
        assert_eq!(ask("2001:db8::1", "Bearer no"), 429);
        assert_eq!(ask("2001:db8::2", "Bearer no"), 429, "the same household");
        assert_eq!(ask("2001:db8::1", &bearer), 200);
        assert_eq!(ask("2001:db8:0:1::1", "Bearer no"), 401);
        assert_eq!(ask("192.0.2.7", "Bearer no"), 401);
        // More addresses than are counted: the oldest one is forgotten, and memory is bounded.
        for i in 0..2 * ADDRESSES {
            assert_eq!(ask(&format!("10.0.{}.{}", i / 256, i % 256), "Bearer no"), 401);
        }
        assert!(far.wrong.lock().unwrap().len() <= ADDRESSES);
    }
}
