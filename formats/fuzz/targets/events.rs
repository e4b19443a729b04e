//! Lines of a session's log: no panic; what is read is written as the same event. (Of numbers the reader, serde_json, may miss the last bit.)

use sunglint_formats::session::Event;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    for line in String::from_utf8_lossy(bytes).lines() {
        let Ok(event) = Event::from_line("x", line) else { continue };
        let again = Event::from_line("x", &event.to_line()).expect("what we write, we read");
        assert_eq!(std::mem::discriminant(&again.what), std::mem::discriminant(&event.what));
    }
}
