//! Sequences of images: 16 bits stay 16 bits, and what is missing or damaged is said.
#![cfg(feature = "opencv")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{all, frame, noise, open, said, within};
use ndarray::Array2;
use std::path::{Path, PathBuf};
use sunglint_drivers_opencv::grabber::Said;
use sunglint_drivers_opencv::picture::Plane;
use sunglint_drivers_opencv::sequence::Pattern;
use sunglint_drivers_opencv::{Grabber, GrabberSettings, RecordError, Recorder, Source, sidecar};
use sunglint_formats::Frame;

fn every_value() -> Array2<u16> {
    Array2::from_shape_fn((256, 256), |(row, column)| (256 * row + column) as u16)
}

fn record(path: &Path, frames: &[Frame]) {
    let mut recorder = Recorder::create(path, 10.0).unwrap();
    for frame in frames {
        recorder.write(frame).unwrap();
    }
    assert_eq!(recorder.finish(&within(20.0)).unwrap().frames, frames.len() as u64);
}

fn by_the_user() -> Said {
    Said { interval_s: Some(0.1), ..said() }
}

fn at(pattern: PathBuf) -> Source {
    Source::SequenceAt(pattern, by_the_user())
}

/// Truth: the frames that were given, all 65,536 values among them, and the PNG as the crate `image` reads it. Exact.
#[test]
fn images_keep_sixteen_bits() {
    let folder = tempfile::tempdir().unwrap();
    for kind in ["png", "tiff"] {
        let pattern = folder.path().join(format!("night_%05d.{kind}"));
        let mut given: Vec<Frame> =
            (0..4).map(|i| frame(i, noise(256, 256, i + 1, 65535))).collect();
        given[2].pixels = every_value();
        record(&pattern, &given);
        let mut grabber = open(Source::Sequence(pattern.clone())).unwrap();
        let expected: Vec<Frame> =
            given.iter().map(|f| Frame { saturation_adu: Some(65535.0), ..f.clone() }).collect();
        assert_eq!(all(&mut grabber), (expected, None));
        if kind == "png" {
            for (i, given) in given.iter().enumerate() {
                let path = folder.path().join(format!("night_{i:05}.png"));
                let image::DynamicImage::ImageLuma16(seen) = image::open(path).unwrap() else {
                    panic!("not 16 bits of grey")
                };
                assert!(seen.pixels().map(|pixel| pixel.0[0]).eq(given.pixels.iter().copied()));
            }
        }
    }
}

/// Truth: PNGs that the crate `image` writes: 8 bits of grey, 16 bits of colour whose planes differ.
#[test]
fn images_of_others_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let grey =
        image::GrayImage::from_fn(256, 2, |x, y| image::Luma([(x as u8).wrapping_add(y as u8)]));
    grey.save(folder.path().join("grey7.png")).unwrap();
    let mut grabber = open(at(folder.path().join("grey%d.png"))).unwrap();
    let (frames, error) = all(&mut grabber);
    assert_eq!((frames.len(), error, frames[0].saturation_adu), (1, None, Some(255.0)));
    assert!(frames[0].pixels.iter().copied().eq(grey.pixels().map(|pixel| u16::from(pixel.0[0]))));

    type Rgb16 = image::ImageBuffer<image::Rgb<u16>, Vec<u16>>;
    let colour =
        Rgb16::from_fn(5, 3, |x, y| image::Rgb([x as u16, 1000 * y as u16, 65535 - x as u16]));
    colour.save(folder.path().join("colour_00.png")).unwrap();
    let pattern = folder.path().join("colour_%02d.png");
    for (channel, plane) in [Plane::Red, Plane::Green, Plane::Blue].into_iter().enumerate() {
        let settings = GrabberSettings { plane, ..GrabberSettings::default() };
        let mut grabber = Grabber::open(at(pattern.clone()), settings, &within(20.0)).unwrap();
        let (frames, _) = all(&mut grabber);
        assert!(frames[0].pixels.iter().copied().eq(colour.pixels().map(|pixel| pixel.0[channel])));
    }
    let (frames, error) = all(&mut open(at(pattern)).unwrap());
    assert!(frames.is_empty());
    let expected = "frame 0: it is in colour (row 0, column 0: blue 65535, green 0, red 0): choose one of the planes";
    assert!(error.as_ref().is_some_and(|e| e.ends_with(expected)), "{error:?}");
}

/// Numbers may begin anywhere; a gap is an error before anything is read, as OpenCV ends there without a word.
#[test]
fn a_gap_in_the_numbers_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let pattern = folder.path().join("n_%03d.png");
    let given: Vec<Frame> = (0..5).map(|i| frame(i, noise(8, 8, i, 65535))).collect();
    record(&pattern, &given);
    let path = |number: u32| folder.path().join(format!("n_{number:03}.png"));
    for number in (0..5).rev() {
        std::fs::rename(path(number), path(number + 998)).unwrap();
    }
    let (frames, error) = all(&mut open(Source::Sequence(pattern.clone())).unwrap());
    assert_eq!((frames.len(), error), (5, None));
    // What only looks like one of them does not count.
    std::fs::write(folder.path().join("n_7.png"), b"").unwrap();
    std::fs::write(folder.path().join("n_001000.png"), b"").unwrap();
    std::fs::write(folder.path().join("n_+12.png"), b"").unwrap();
    std::fs::remove_file(path(1000)).unwrap();
    let error = open(Source::Sequence(pattern.clone())).unwrap_err();
    assert!(error.contains("n_1000.png is missing: 4 images from 998 to 1002"), "{error}");
    // An end that is missing shows in the table.
    std::fs::remove_file(path(1001)).unwrap();
    std::fs::remove_file(path(1002)).unwrap();
    let (frames, error) = all(&mut open(Source::Sequence(pattern.clone())).unwrap());
    assert_eq!(frames.len(), 2);
    assert!(error.as_ref().is_some_and(|e| e.contains("ends after 2 of 5 frames")), "{error:?}");
    for number in [998, 999] {
        std::fs::remove_file(path(number)).unwrap();
    }
    let error = open(Source::Sequence(pattern.clone())).unwrap_err();
    assert_eq!(error, format!("frame grabber: there is no image {}", pattern.display()));
}

#[test]
fn damaged_and_odd_images_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let pattern = folder.path().join("n_%03d.png");
    let given: Vec<Frame> = (0..4).map(|i| frame(i, noise(32, 32, i, 65535))).collect();
    record(&pattern, &given);
    let path = folder.path().join("n_002.png");
    let whole = std::fs::read(&path).unwrap();
    let fails = |bytes: &[u8], says: &str| {
        std::fs::write(&path, bytes).unwrap();
        for source in [Source::Sequence(pattern.clone()), at(pattern.clone())] {
            let (frames, error) = all(&mut open(source).unwrap());
            assert!(frames.len() == 2, "{} frames: {error:?}", frames.len());
            assert!(error.as_ref().is_some_and(|e| e.contains(says)), "{error:?}");
        }
    };
    fails(&whole[..whole.len() / 2], "n_002.png is no image that OpenCV reads, or damaged");
    fails(b"", "n_002.png is no image");
    let save = |image: image::DynamicImage| {
        let other = folder.path().join("other.png");
        image.save(&other).unwrap();
        std::fs::read(other).unwrap()
    };
    fails(&save(image::DynamicImage::new_luma16(31, 32)), "31 × 32 pixels, expected 32 × 32");
    fails(
        &save(image::DynamicImage::new_luma8(32, 32)),
        "n_002.png has 8 bits, the first image 16",
    );
    fails(
        &save(image::DynamicImage::new_rgba16(32, 32)),
        "expected 8 or 16 bits unsigned in 1 or 3",
    );
    // Another picture of the same kind: only the table knows.
    std::fs::write(&path, save(image::DynamicImage::new_luma16(32, 32))).unwrap();
    let (frames, error) = all(&mut open(Source::Sequence(pattern)).unwrap());
    assert_eq!(frames.len(), 2);
    assert!(
        error.as_ref().is_some_and(|e| e.contains("are not those that were recorded")),
        "{error:?}"
    );
}

#[test]
fn what_is_no_sequence_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    image::GrayImage::new(8, 8).save(folder.path().join("a_0.png")).unwrap();
    std::fs::copy(folder.path().join("a_0.png"), folder.path().join("b_0.jpg")).unwrap();
    let refused = |name: &str| open(at(folder.path().join(name))).unwrap_err();
    for name in
        ["a_0.png", "a_%s.png", "a_%d_%d.png", "a_%123d.png", "a_%-5d.png", "%", "a_%05x.png"]
    {
        let error = refused(name);
        assert!(error.contains("found no single %05d"), "{name}: {error}");
    }
    let error = refused("b_%d.jpg");
    assert!(error.contains("`jpg` is not known to keep each pixel"), "{error}");
    let error = refused("no/such_%d.png");
    assert!(error.contains("cannot list"), "{error}");
    let untimed = Source::SequenceAt(folder.path().join("a_%d.png"), said());
    let (_, error) = all(&mut open(untimed).unwrap());
    assert!(
        error.as_ref().is_some_and(|e| e.ends_with("give the interval between them")),
        "{error:?}"
    );
    let error = open(Source::Sequence(folder.path().join("a_%d.png"))).unwrap_err();
    assert!(error.contains("a_%d.png.ecsv is not there"), "{error}");
}

/// Checks that what is read back at the end is what is on the disk, not what was meant to be there.
#[test]
fn a_recording_that_was_not_kept_is_found_at_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let pattern = folder.path().join("n_%03d.png");
    let mut recorder = Recorder::create(&pattern, 10.0).unwrap();
    for i in 0..4 {
        recorder.write(&frame(i, noise(8, 8, i, 65535))).unwrap();
    }
    std::fs::copy(folder.path().join("n_001.png"), folder.path().join("n_002.png")).unwrap();
    let error = recorder.finish(&within(20.0)).unwrap_err();
    assert!(matches!(error, RecordError::NotKept { good: 2, given: 4, .. }), "{error}");
    let error = Recorder::create(&pattern, 10.0).unwrap_err();
    assert!(
        matches!(&error, RecordError::Exists { path } if path.ends_with("n_000.png")),
        "{error}"
    );
}

/// A recording that nobody ended (a crash) has a table with each of its frames.
#[test]
fn a_recording_that_was_not_ended_is_read_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let pattern = folder.path().join("n_%03d.png");
    let mut recorder = Recorder::create(&pattern, 10.0).unwrap();
    let given: Vec<Frame> = (0..3).map(|i| frame(i, noise(8, 8, i, 65535))).collect();
    for frame in &given {
        recorder.write(frame).unwrap();
    }
    std::mem::forget(recorder);
    let (frames, error) = all(&mut open(Source::Sequence(pattern.clone())).unwrap());
    assert_eq!((frames.len(), error), (3, None));
    assert!(frames.iter().zip(&given).all(|(a, b)| a.pixels == b.pixels && a.start == b.start));
    // The table is what any reader of ECSV takes it for.
    let table = sunglint_formats::ecsv::read(sidecar::path_of(&pattern)).unwrap();
    let again = sidecar::Sidecar::from_table(&table).unwrap().table();
    // As text, where a missing number equals a missing number.
    let text = |table| sunglint_formats::ecsv::to_string(table).unwrap();
    assert_eq!(text(&again), text(&table));
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { failure_persistence: None, ..Default::default() })]

    /// Names of files are never a panic, and a pattern finds the names that it makes.
    #[test]
    fn any_name_is_a_pattern_or_an_error(name in "[a-z%0-9d_.]{0,12}|n%0?[0-9]?d[.]png", number in 0..2_000_000_u64) {
        if let Ok(pattern) = Pattern::new(Path::new(&name)) {
            let folder = tempfile::tempdir().unwrap();
            let pattern_there = Pattern::new(&folder.path().join(&name)).unwrap();
            let path = pattern_there.path(number);
            std::fs::write(&path, b"").unwrap();
            proptest::prop_assert_eq!(pattern_there.numbers().unwrap(), vec![number]);
            let same = pattern.path(number).file_name() == path.file_name();
            proptest::prop_assert!(same);
        }
    }
}
