//! Times: no panic; an instant comes back from its text, any epoch prints, and the readers of other programs' texts agree.

use sunglint_formats::time::{Scale, format_utc, parse_in, parse_utc, parse_zoned};

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
    if let Ok((epoch, is_zoned)) = parse_zoned(text) {
        let _ = format_utc(epoch, 9);
        if let (Ok(same), false) = (parse_in(text, Scale::Utc), is_zoned) {
            assert_eq!(same, epoch, "{text}");
        }
    }
    if let Ok(tai) = parse_in(text, Scale::Tai) {
        let gps = parse_in(text, Scale::Gps).expect("the same digits");
        assert_eq!((gps - tai).total_nanoseconds(), 19_000_000_000);
        for scale in [Scale::Tt, Scale::Tdb] {
            parse_in(text, scale).expect("the same digits");
        }
    }
}
