//! The Time Tagger bridge's frames: no panic, bounded memory; the same frames in one piece and in two; a frame that was read
//! is made again byte for byte, but for the spelling of JSON.

use sunglint_drivers::swabian::frame::{Frame, MOST_PAYLOAD, Parser, emit};

fn read(pieces: &[&[u8]]) -> (Vec<Frame>, bool) {
    let mut parser = Parser::new();
    let mut frames = Vec::new();
    for piece in pieces {
        parser.feed(piece);
        loop {
            match parser.frame() {
                Ok(Some(frame)) => frames.push(frame),
                Ok(None) => break,
                Err(_) => return (frames, false),
            }
        }
        assert!(parser.held_bytes() < MOST_PAYLOAD + 13 + piece.len());
    }
    (frames, true)
}

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let at = bytes.first().map_or(0, |&first| usize::from(first) % bytes.len());
    let (head, tail) = bytes.split_at(at);
    let (frames, whole) = read(&[bytes]);
    assert_eq!(read(&[head, tail]), (frames.clone(), whole));
    // The checksum keeps a fuzzer out, so that the bytes are tried as payloads too.
    let mut payload = bytes.to_vec();
    payload.truncate(payload.len() / 16 * 16);
    let records = payload.as_chunks::<16>().0.to_vec();
    let frame = Frame::Tags(records);
    assert_eq!(read(&[&emit(&frame, 0)]), (vec![frame], true));
    for frame in frames {
        if !matches!(frame, Frame::Json(_)) {
            assert_eq!(read(&[&emit(&frame, 0)]), (vec![frame], true));
        }
    }
}
