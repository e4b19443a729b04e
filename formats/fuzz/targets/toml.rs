//! TOML into structs: no panic.

use serde::Deserialize;
use sunglint_formats::time::Utc;
use sunglint_formats::toml::{Document, Fraction, LatitudeDeg, NonNegative};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only read")]
struct Root {
    a: Option<String>,
    b: Option<NonNegative>,
    c: Option<Vec<Part>>,
    d: Option<Mode>,
    e: Option<Utc>,
    f: Option<(u8, i64, f32)>,
    g: Option<std::collections::BTreeMap<String, LatitudeDeg>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only read")]
struct Part {
    dead_time_ns: Fraction,
    x: Option<u64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only read")]
enum Mode {
    A,
    B { x: bool },
    C(i8, u16),
    D(char),
}

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(document) = Document::new("x", text) {
        let _ = document.parse::<Root>().map_err(|error| error.to_string());
        let _ = document.error_at("c[0].x", "something else");
    }
}
