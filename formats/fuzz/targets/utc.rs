//! UTC: no panic; an instant comes back from its text, and any epoch prints.

use sunglint_formats::time::{format_utc, parse_utc};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(epoch) = parse_utc(text) {
        assert_eq!(parse_utc(&format_utc(epoch, 9)), Ok(epoch));
        for digits in 0..9 {
            // Rounding may end in the year 2101, which is not read.
            let _ = parse_utc(&format_utc(epoch, digits));
        }
    }
}
