//! Answers of monochromators and spectrometers: no panic; what is read keeps its promises.

use sunglint_drivers::acton::reply::{self, Answer as Words};
use sunglint_drivers::ocean::obp::{HEAD, MOST_DATA, TAIL, parse};
use sunglint_drivers::ocean::ooi;
use sunglint_drivers::spectral_products::frame::Answer;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(Some((frame, taken))) = parse(bytes) {
        assert!((HEAD + TAIL..=HEAD + MOST_DATA + TAIL).contains(&taken) && taken <= bytes.len());
        let again = frame.emit();
        let (same, length) = parse(&again).ok().flatten().expect("what is emitted is read");
        assert_eq!((same, length), (frame, again.len()));
    }
    older(bytes);
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

/// Answers of the older protocol of Ocean Optics. A spectrum is a frame whose length and end are made right.
fn older(bytes: &[u8]) {
    for slot in [0, 2, 14, 17] {
        if let Ok(text) = ooi::slot_text(slot, bytes) {
            assert!(!text.is_empty() && text.len() <= 15 && bytes.len() == ooi::SLOT_LENGTH);
        }
        if let Ok(number) = ooi::slot_number(slot, bytes) {
            assert!(number.is_finite());
        }
        if let Ok(order) = ooi::slot_order(slot, bytes) {
            assert!(order <= 7);
        }
    }
    if ooi::status(bytes).is_ok() {
        assert_eq!(bytes.len(), ooi::STATUS_LENGTH);
    }
    let _ = ooi::firmware(bytes);
    for model in ooi::Model::ALL {
        if let Ok(Some(end)) = ooi::saturation(&model, bytes) {
            assert!(end > 0);
        }
        assert!(ooi::spectrum(&model, bytes).is_err() || bytes.len() == model.frame_length());
    }
    let place = usize::from(bytes.first().copied().unwrap_or(0)) % ooi::Model::ALL.len();
    let model = ooi::Model::ALL[place];
    let mut frame = bytes.to_vec();
    frame.resize(model.frame_length(), 0);
    if model.ends_with_mark
        && let Some(last) = frame.last_mut()
    {
        *last = ooi::MARK;
    }
    if let Ok(counts) = ooi::spectrum(&model, &frame) {
        assert_eq!(counts.len(), model.pixels);
        assert!(counts.iter().all(|count| u32::from(*count) < 1 << model.bits));
    }
}
