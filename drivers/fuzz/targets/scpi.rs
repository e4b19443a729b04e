//! Answers of SCPI instruments and the files that describe these: no panic; what is read keeps its promises.

use sunglint_drivers::scpi::reply::{
    Complaint, Framer, Given, LONGEST_REPLY, number_at_start, text_of,
};
use sunglint_drivers::scpi::{Definition, Pattern, Response};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let mut framer = Framer::new(b'\n');
    for byte in bytes {
        match framer.push(*byte) {
            Ok(true) => {
                let answer = std::mem::replace(&mut framer, Framer::new(b'\n')).into_bytes();
                assert!(answer.len() <= LONGEST_REPLY && answer.ends_with(b"\n"));
                answered(&answer);
            }
            Ok(false) => {}
            Err(_) => break,
        }
    }
    let text = String::from_utf8_lossy(bytes);
    if let Ok(pattern) = Pattern::parse(&text) {
        assert_eq!(pattern.source(), text);
    }
    if let Ok(about) = Definition::parse("device.toml", &text) {
        assert!((1..=40).contains(&about.name().len()) && !about.unit().is_empty());
    }
    if let Ok(response) = Response::parse("response.csv", &text) {
        let [least, most] = response.ends_nm().to_array();
        assert!(
            least < most && response.a_per_w(f64::midpoint(least, most)).is_some_and(|r| r > 0.0)
        );
        assert!(
            response.a_per_w(least * 0.99).is_none() && response.a_per_w(most * 1.01).is_none()
        );
    }
}

fn answered(answer: &[u8]) {
    let Ok(text) = text_of(answer) else { return };
    assert!(text.is_ascii() && !text.contains('\n'));
    let _ = Complaint::parse(&text);
    if let Some((number, rest)) = number_at_start(&text) {
        assert!(number.is_finite() && rest.len() < text.len());
        if let Given::Number(number) = Given::of(number, 9.9e37) {
            assert!(number.abs() < 9.9e37);
        }
    }
    for pattern in [
        "{value}A,{number},{number}",
        "{vendor},{model},{serial},{firmware}",
        "{word}",
        "{text},{rest}",
    ] {
        // The patterns of this list are good ones.
        let Ok(pattern) = Pattern::parse(pattern) else { panic!("{pattern}") };
        if let Some(found) = pattern.of(&text) {
            assert_eq!(pattern.has_value(), found.value.is_some());
            assert_eq!(pattern.has_word(), found.word.is_some());
        }
    }
}
