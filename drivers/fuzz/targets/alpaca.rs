//! Answers of Alpaca servers: no panic, bounded memory; the same answer in one piece and in two; frames of no more pixels than bytes.

use sunglint_drivers::alpaca::answer::Envelope;
use sunglint_drivers::alpaca::http::{MOST_HEAD, Response, ResponseParser};
use sunglint_drivers::alpaca::image::{image_bytes, image_json};

const MOST: usize = 4096;

fn parse(pieces: &[&[u8]]) -> Option<Response> {
    let mut parser = ResponseParser::new(MOST);
    let mut whole = false;
    for piece in pieces {
        whole = parser.feed(piece).ok()?;
        assert!(parser.held_bytes() <= MOST + MOST_HEAD + piece.len());
    }
    (whole || parser.end()).then(|| parser.into_response())
}

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let at = bytes.first().map_or(0, |&first| usize::from(first) % bytes.len());
    let (head, tail) = bytes.split_at(at);
    let whole = parse(&[bytes]);
    if whole.is_some() {
        assert_eq!(parse(&[head, tail]), whole);
    }
    let body = whole.map_or(bytes.to_vec(), |response| response.body);
    let _ = Envelope::<serde_json::Value>::parse(&body);
    for size in [[4, 3], [1, 1], [0, 7]] {
        for image in [image_bytes(&body, size), image_json(&body, size)].into_iter().flatten() {
            assert_eq!(image.pixels.dim(), (size[1] as usize, size[0] as usize));
        }
    }
}
