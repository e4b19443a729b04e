//! The parser of INDI streams: another parser's reading of real bytes, and bytes that nobody should send.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_drivers::indi::base64;
use sunglint_drivers::indi::property::Properties;
use sunglint_drivers::indi::xml::{Element, Limits, Parser, XmlError};
use sunglint_drivers::recording::{Event, Recording};
use sunglint_testkit::{Campaign, fixture, peer_python, run_python};

const SMALL: Limits =
    Limits { blob_bytes: 4096, element_bytes: 4096, tag_bytes: 512, children: 16, depth: 3 };

/// All elements of bytes that come in pieces; how it ended; the most that the parser held.
fn parse(pieces: &[&[u8]], limits: Limits) -> (Vec<Element>, Option<XmlError>, usize) {
    let mut parser = Parser::new(limits);
    let mut elements = Vec::new();
    let mut most = 0;
    for piece in pieces {
        parser.feed(piece);
        loop {
            match parser.element() {
                Ok(Some(element)) => elements.push(element),
                Ok(None) => break,
                Err(error) => {
                    assert_eq!(parser.element(), Err(error.clone()), "it stays so");
                    return (elements, Some(error), most);
                }
            }
        }
        most = most.max(parser.held_bytes());
    }
    (elements, None, most)
}

fn whole(text: &str) -> (Vec<Element>, Option<XmlError>) {
    let (elements, error, _) = parse(&[text.as_bytes()], SMALL);
    (elements, error)
}

/// Truth: XML 1.0 as INDI uses it; each wrong input has its own words.
#[test]
fn what_is_read_and_what_is_refused() {
    let (elements, error) = whole(
        "<?xml version='1.0'?>\n<!-- a > b \" --> <a x = \"1 &lt; 2\" y='\"'><b>\n &#65;&#x42;&amp; </b><c/></a>\n<d/>",
    );
    assert_eq!(error, None);
    assert_eq!(elements.len(), 2);
    assert_eq!(elements[0].attribute("x"), Some("1 < 2"));
    assert_eq!(elements[0].attribute("y"), Some("\""));
    assert_eq!(elements[0].children[0].text, "AB&");
    assert_eq!(elements[0].children[1].tag, "c");
    for (text, words) in [
        ("hello", "text `hello`, expected an element"),
        ("<a></b>", "found `</b>` for `<a>`"),
        ("</a>", "found `</a>`, expected an element"),
        ("<a x=1/>", "found `x=1`, expected name=\"value\""),
        ("<a x=\"1\" x=\"2\"/>", "expected name=\"value\""),
        ("<a x/>", "expected name=\"value\""),
        ("<1/>", "the name of an element"),
        ("<a <b/>", "`<` within a tag"),
        ("<a>&nbsp;</a>", "found `&nbsp;`"),
        ("<a>&#0;</a>", "found `&#0;`"),
        ("<a>&#x110000;</a>", "found `&#x110000;`"),
        ("<a>&</a>", "found `&`"),
        ("<!DOCTYPE a [<!ENTITY b \"c\">]>", "expected an element"),
        ("<a><![CDATA[x]]></a>", "expected an element"),
        ("<a><b><c><d/></c></b></a>", "elements within each other of more than 3"),
        ("<oneBLOB>Zg=</oneBLOB>", "a BLOB is damaged: the last group has 3 characters"),
        ("<oneBLOB>Z!==</oneBLOB>", "a BLOB is damaged: the byte 0x21"),
    ] {
        let error = whole(text).1.unwrap_or_else(|| panic!("{text} was read")).to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
    let too_much = [
        (format!("<a x=\"{}", "x".repeat(600)), "a tag of more than 512"),
        (format!("<a>{}</a>", "<b/>".repeat(17)), "children of an element of more than 16"),
        (format!("<a>{}", "x".repeat(5000)), "an element of more than 4096"),
        (format!("<a>{}", "<!-- -->".repeat(600)), "an element of more than 4096"),
        (format!("<oneBLOB>{}", "AAAA".repeat(1400)), "a BLOB of more than 4096"),
        (
            format!("<a>{}", format!("<oneBLOB>{}</oneBLOB>", "AAAA".repeat(400)).repeat(4)),
            "a BLOB of more than 4096",
        ),
    ];
    for (text, words) in too_much {
        let error = whole(&text).1.unwrap_or_else(|| panic!("{words} was read")).to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    // Latin-1, as some drivers send it in labels.
    let (elements, error, _) = parse(&[b"<a label=\"\xb0C\"/>"], SMALL);
    assert_eq!((error, elements[0].attribute("label")), (None, Some("\u{fffd}C")));
}

/// The bytes that a real server sent in the recordings.
fn recorded() -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(fixture("indi")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "rec") {
            continue;
        }
        let recording = Recording::read(&path).unwrap();
        let mut bytes = Vec::new();
        for (_, event) in &recording.events {
            if let Event::Received(data) = event {
                bytes.extend_from_slice(data);
            }
        }
        all.push((path.file_name().unwrap().to_string_lossy().into_owned(), bytes));
    }
    all.sort();
    assert!(all.len() >= 5, "there are recordings");
    all
}

fn dump(element: &Element, depth: usize, out: &mut String) {
    use std::fmt::Write as _;
    let blob = element.blob.as_ref().map_or(String::new(), |bytes| {
        format!(" blob {} {}", bytes.len(), bytes.iter().map(|&b| u64::from(b)).sum::<u64>())
    });
    let mut attributes = element.attributes.clone();
    attributes.sort();
    let text = &element.text;
    writeln!(out, "{depth} {} {attributes:?} {text:?}{blob}", element.tag).unwrap();
    element.children.iter().for_each(|child| dump(child, depth + 1, out));
}

/// Truth: Python's expat and base64, on what the real server sent.
#[test]
fn expat_reads_the_recordings_the_same() {
    let name = "expat_reads_the_recordings_the_same";
    let Some(python) = peer_python(name, &["xml.etree.ElementTree"]) else { return };
    let script = r#"
import sys, base64, json
import xml.etree.ElementTree as ET
def dump(e, depth):
    q = lambda s: json.dumps(s, ensure_ascii=False)
    attributes = "[" + ", ".join("(%s, %s)" % (q(k), q(v)) for k, v in sorted(e.attrib.items())) + "]"
    text, blob = (e.text or "").strip(), ""
    if e.tag == "oneBLOB":
        raw = base64.b64decode("".join(text.split()), validate=True)
        text, blob = "", " blob %d %d" % (len(raw), sum(raw))
    print(depth, e.tag, attributes, q(text) + blob)
    for c in e: dump(c, depth + 1)
for e in ET.fromstring(b"<indi>" + open(sys.argv[1], "rb").read() + b"</indi>"): dump(e, 0)
"#;
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in recorded() {
        let (elements, error, _) = parse(&[&bytes], Limits::default());
        assert_eq!(error, None, "{name}");
        // A server that was killed left a piece of an element.
        let path = folder.path().join("bytes");
        std::fs::write(&path, &bytes).unwrap();
        let mut ours = String::new();
        elements.iter().for_each(|element| dump(element, 0, &mut ours));
        let theirs = run_python(&python, script, &[path.to_str().unwrap()]);
        assert_eq!(ours, theirs, "{name}");
    }
}

/// A stream that is right, for others to spoil.
fn stream(random: &mut Xoshiro256PlusPlus) -> Vec<u8> {
    let mut text = String::new();
    for _ in 0..random.random_range(1..4) {
        let bytes: Vec<u8> = (0..random.random_range(0..60)).map(|_| random.random()).collect();
        let number = random.random_range(-1e3..1e3);
        text.push_str(&match random.random_range(0..4) {
            0 => format!("<defNumberVector device=\"d\" name=\"n\" state=\"Ok\" perm=\"rw\"><defNumber name=\"x\" min=\"0\" max=\"1\">\n{number}\n</defNumber></defNumberVector>\n"),
            1 => format!("<setNumberVector device='d' name='n' state='Busy'><oneNumber name='x'>{number}</oneNumber></setNumberVector>"),
            2 => format!("<setBLOBVector device=\"d\" name=\"b\"><oneBLOB name=\"b\" size=\"{0}\" format=\".fits\" len=\"{0}\">\n{1}</oneBLOB></setBLOBVector>\n", bytes.len(), base64::encode(&bytes)),
            _ => "<message device=\"d\" message=\"a &lt; b &amp; c\"/><!-- c --><delProperty device=\"d\"/>".to_owned(),
        });
    }
    text.into_bytes()
}

/// Truth: the same bytes in one piece; the limits. A million streams, most of them spoilt, in pieces: no panic, the same
/// reading, memory within the limits.
#[test]
fn campaign_indi_parser() {
    let mut campaign = Campaign::start("indi_parser", 1_000_000);
    let mut most_held = 0;
    for seed in campaign.seeds() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut bytes = stream(&mut random);
        for _ in 0..random.random_range(0..4_u32) {
            let at = random.random_range(0..bytes.len());
            match random.random_range(0..4) {
                0 => bytes[at] ^= 1 << random.random_range(0..8_u32),
                1 => drop(bytes.remove(at)),
                2 => bytes[at] = b"<>&\"'/=;- \n\0"[random.random_range(0..12_usize)],
                _ => {
                    let copy = bytes[at..].to_vec();
                    bytes.extend_from_slice(&copy);
                }
            }
            if bytes.is_empty() {
                bytes.push(b'<');
            }
        }
        let mut pieces = Vec::new();
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(random.random_range(1..=rest.len().min(97)));
            pieces.push(piece);
            rest = after;
        }
        let (elements, error, held) = parse(&pieces, SMALL);
        let (at_once, same, _) = parse(&[&bytes], SMALL);
        // The words of an error quote what was there by then.
        assert_eq!((&elements, error.is_some()), (&at_once, same.is_some()), "seed {seed}");
        most_held = most_held.max(held);
        let mut properties = Properties::default();
        for element in elements {
            let _ = properties.apply(element);
        }
    }
    // Held at most: one tag, one element, its BLOBs, one piece.
    assert!(most_held <= SMALL.tag_bytes + 2 * SMALL.element_bytes + SMALL.blob_bytes + 97);
    campaign.largest("most_held_bytes", most_held as f64);
    campaign.finish();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Bytes of any kind, and text that looks like XML. Truth: the same bytes in one piece.
    #[test]
    fn anything_in_any_pieces(
        bytes in prop_oneof![
            proptest::collection::vec(any::<u8>(), 0..300),
            proptest::collection::vec(proptest::sample::select(&b"<>/ab=\"'& ;#x0!-?\n"[..]), 0..200),
        ],
        piece in 1..50_usize,
    ) {
        let pieces: Vec<&[u8]> = bytes.chunks(piece).collect();
        let (elements, error, held) = parse(&pieces, SMALL);
        let (at_once, same, _) = parse(&[&bytes], SMALL);
        prop_assert_eq!((elements, error.is_some()), (at_once, same.is_some()));
        prop_assert!(held <= 2 * bytes.len() + 64);
    }

    /// Checks that we read what we write. Truth: the text itself.
    #[test]
    fn texts_come_back(text in "\\PC{0,40}") {
        let escaped = sunglint_drivers::indi::xml::escaped(&text);
        let (elements, error) = whole(&format!("<a b=\"{escaped}\">{escaped}</a>"));
        prop_assert_eq!(error, None);
        prop_assert_eq!(elements[0].attribute("b"), Some(text.as_str()));
        prop_assert_eq!(&elements[0].text, text.trim());
    }
}
