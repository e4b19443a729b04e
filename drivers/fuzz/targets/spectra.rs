//! Answers of monochromators and spectrometers: no panic; what is read keeps its promises.

use sunglint_drivers::acton::reply::{self, Answer as Words};
use sunglint_drivers::ocean::obp::{HEAD, MOST_DATA, TAIL, parse};
use sunglint_drivers::spectral_products::frame::Answer;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(Some((frame, taken))) = parse(bytes) {
        assert!((HEAD + TAIL..=HEAD + MOST_DATA + TAIL).contains(&taken) && taken <= bytes.len());
        let again = frame.emit();
        let (same, length) = parse(&again).ok().flatten().expect("what is emitted is read");
        assert_eq!((same, length), (frame, again.len()));
    }
    if let Ok(answer) = Answer::parse(bytes) {
        assert!(answer.status.unit().is_some());
        assert_eq!(answer.value.is_some(), bytes.len() == 4);
    }
    for echoes in [true, false] {
        let Ok(Words::Good(body)) = Words::parse("?NM", echoes, bytes) else { continue };
        if let Ok(nm) = reply::wavelength_nm(&body) {
            assert!(nm.is_finite());
            assert!(reply::speed_nm_min(&body).is_err() && reply::model(&body).is_err());
        }
        if let Ok(speed) = reply::speed_nm_min(&body) {
            assert!(speed > 0.0 && speed.is_finite());
        }
        if let Ok(gratings) = reply::gratings(&body) {
            assert!(!gratings.is_empty());
            assert!(gratings.iter().all(|grating| (1..=9).contains(&grating.number)));
        }
        if let Ok(number) = reply::grating(&body) {
            assert!((1..=9).contains(&number));
        }
        let _ = (reply::is_done(&body), reply::model(&body));
    }
}
