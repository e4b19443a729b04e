//! INDI streams: no panic, bounded memory; the same elements in one piece and in two; what they say can be applied.

use sunglint_drivers::indi::property::Properties;
use sunglint_drivers::indi::xml::{Element, Limits, Parser};

const LIMITS: Limits =
    Limits { blob_bytes: 4096, element_bytes: 4096, tag_bytes: 512, children: 16, depth: 3 };

fn parse(pieces: &[&[u8]]) -> (Vec<Element>, bool) {
    let mut parser = Parser::new(LIMITS);
    let mut elements = Vec::new();
    for piece in pieces {
        parser.feed(piece);
        loop {
            match parser.element() {
                Ok(Some(element)) => elements.push(element),
                Ok(None) => break,
                Err(_) => return (elements, false),
            }
        }
        assert!(parser.held_bytes() <= 3 * 4096 + 512 + piece.len());
    }
    (elements, true)
}

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let at = bytes.first().map_or(0, |&first| usize::from(first) % bytes.len());
    let (head, tail) = bytes.split_at(at);
    let (elements, whole) = parse(&[bytes]);
    assert_eq!(parse(&[head, tail]), (elements.clone(), whole));
    let mut properties = Properties::default();
    for element in elements {
        let _ = properties.apply(element);
    }
}
