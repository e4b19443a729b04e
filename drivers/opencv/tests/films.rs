//! Films through OpenCV's FFmpeg: what comes back is what was given, or an error says that it is not.
#![cfg(feature = "opencv")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{all, ffmpeg, frame, noise, open, opencv_film, said, within};
use ndarray::{Array2, s};
use std::ops::ControlFlow;
use std::path::Path;
use sunglint_drivers::device::Camera as _;
use sunglint_drivers_opencv::picture::Plane;
use sunglint_drivers_opencv::{
    Grabber, GrabberSettings, Lossy, RecordError, Recorded, Recorder, Source, sidecar,
};
use sunglint_formats::Frame;

fn film(path: &Path, frames: &[Frame]) -> Result<Recorded, RecordError> {
    let mut recorder = Recorder::create(path, 10.0)?;
    for frame in frames {
        recorder.write(frame)?;
    }
    recorder.finish(&within(20.0))
}

fn frames(rows: usize, columns: usize, count: u32) -> Vec<Frame> {
    (0..count).map(|i| frame(i, noise(rows, columns, i + 1, 255))).collect()
}

/// Truth: the frames that were given, in every number and card, a leap second among their times; sides even and odd (OpenCV's
/// writer cuts odd ones), and one of the size of a camera's subframe. Exact.
#[test]
fn a_film_gives_back_what_it_was_given() {
    let folder = tempfile::tempdir().unwrap();
    for (i, (rows, columns)) in
        [(200, 200), (199, 201), (64, 33), (2, 2), (1, 1)].into_iter().enumerate()
    {
        for extension in ["avi", "mkv"] {
            let path = folder.path().join(format!("night{i}.{extension}"));
            let given = frames(rows, columns, 5);
            let recorded = film(&path, &given).unwrap();
            assert_eq!((recorded.frames, recorded.path.clone()), (5, path.clone()));
            let mut grabber = open(Source::Recording(path)).unwrap();
            assert_eq!(grabber.sensor_px(), [columns as u32, rows as u32]);
            let expected: Vec<Frame> =
                given.iter().map(|f| Frame { saturation_adu: Some(255.0), ..f.clone() }).collect();
            assert_eq!(all(&mut grabber), (expected, None));
        }
    }
}

/// Truth: FFmpeg's own program, which decodes the file to bytes. Exact, with the row and column of zeros that make sides even.
#[test]
fn ffmpeg_decodes_our_films_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    let mut given = frames(99, 101, 3);
    given[1].pixels =
        Array2::from_shape_fn((99, 101), |(row, column)| ((row * 101 + column) % 256) as u16);
    film(&path, &given).unwrap();
    let arguments = ["-i", path.to_str().unwrap(), "-f", "rawvideo", "-pix_fmt", "gray", "-"];
    let Some(bytes) = ffmpeg("ffmpeg_decodes_our_films_to_the_same_bytes", &arguments) else {
        return;
    };
    let mut expected = Vec::new();
    for frame in &given {
        let mut padded = Array2::<u16>::zeros((100, 102));
        padded.slice_mut(s![..99, ..101]).assign(&frame.pixels);
        expected.extend(padded.iter().map(|&value| value as u8));
    }
    assert!(bytes == expected, "{} bytes, expected {}", bytes.len(), expected.len());
}

/// Truth: the planes that OpenCV's writer was given, every value of 8 bits among them. Exact for each codec and pixel format that
/// counts as lossless; the others are refused by name.
#[test]
fn what_counts_as_lossless_is_and_the_rest_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let given: Vec<[Array2<u16>; 3]> =
        (0..3).map(|i| [1, 2, 3].map(|plane| noise(64, 64, 10 * i + plane, 255))).collect();
    for (codec, colour) in [
        ("FFV1", false),
        ("FFV1", true),
        ("MPNG", false),
        ("MPNG", true),
        ("Y800", false),
        ("GREY", false),
    ] {
        let path = folder.path().join(format!("{codec}{colour}.avi"));
        opencv_film(&path, codec, colour, &given);
        for (i, plane) in [Plane::Blue, Plane::Green, Plane::Red].into_iter().enumerate() {
            let settings = GrabberSettings { plane, ..GrabberSettings::default() };
            let source = Source::RecordingAt(path.clone(), said());
            let mut grabber = Grabber::open(source, settings, &within(20.0)).unwrap();
            let (frames, error) = all(&mut grabber);
            assert_eq!((frames.len(), error), (3, None), "{codec}");
            for (frame, given) in frames.iter().zip(&given) {
                assert_eq!(
                    frame.pixels,
                    given[if colour { i } else { 1 }],
                    "{codec} {colour} {plane:?}"
                );
            }
        }
    }
    for (codec, colour, format) in
        [("MJPG", true, "I420"), ("HFYU", false, "Y42B"), ("I420", true, "I420")]
    {
        let path = folder.path().join(format!("{codec}.avi"));
        opencv_film(&path, codec, colour, &given);
        let error = open(Source::RecordingAt(path.clone(), said())).unwrap_err();
        let expected = format!(
            "frame grabber: {}: {codec} in {format} does not come back through OpenCV as it was taken",
            path.display()
        );
        assert!(error.starts_with(&expected), "{error}");
    }
}

/// Truth: a grey of 25 that JPEG makes 24 or 26 of in some of its pixels beside an edge (OpenCV's own writer). Flagged, each frame says so.
#[test]
fn a_lossy_film_that_is_taken_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.avi");
    let grey =
        Array2::from_shape_fn(
            (64, 64),
            |(row, column)| if (row / 5 + column / 7) % 2 == 0 { 25 } else { 180 },
        );
    opencv_film(&path, "MJPG", true, &[[grey.clone(), grey.clone(), grey.clone()]]);
    let settings =
        GrabberSettings { plane: Plane::Green, lossy: Lossy::Flag, ..GrabberSettings::default() };
    let mut grabber =
        Grabber::open(Source::RecordingAt(path, said()), settings, &within(20.0)).unwrap();
    let frame = grabber.next_frame(&within(20.0)).unwrap().unwrap();
    assert_ne!(frame.pixels, grey);
    assert_eq!(frame.header.logical("LOSSY"), Some(true));
    assert!(frame.header.commentaries("COMMENT").any(|c| c.contains("MJPG")));
}

/// Truth: FFmpeg's own program makes FFV1 with 16 bits and in YUV, without loss in the file; OpenCV makes 8 bits of both.
#[test]
fn films_that_opencv_would_convert_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for format in ["gray16le", "yuv420p", "gray10le"] {
        let path = folder.path().join(format!("{format}.avi"));
        let arguments = [
            "-f",
            "lavfi",
            "-i",
            "testsrc=s=64x48:d=0.2:r=10",
            "-c:v",
            "ffv1",
            "-pix_fmt",
            format,
            path.to_str().unwrap(),
        ];
        if ffmpeg("films_that_opencv_would_convert_are_refused", &arguments).is_none() {
            return;
        }
        let error = open(Source::RecordingAt(path, said())).unwrap_err();
        assert!(
            error.contains("FFV1 in ") && error.contains("does not come back through OpenCV"),
            "{error}"
        );
    }
}

/// Truth: half of the file holds half of the frames, of equal size as they are noise: 10 of 20, less the one that is cut.
#[test]
fn a_film_that_is_cut_off_gives_its_frames_and_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    let given = frames(64, 64, 20);
    film(&path, &given).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    // With the table no frame comes that is not the one that was given.
    let (frames, error) = all(&mut open(Source::Recording(path.clone())).unwrap());
    assert!((8..=10).contains(&frames.len()), "{} frames", frames.len());
    assert!(frames.iter().zip(&given).all(|(a, b)| a.pixels == b.pixels));
    assert!(error.is_some_and(|e| e.contains("damaged")));
    // Without it, FFmpeg fills the one that is cut with something, and only the number that is missing tells.
    let (frames, error) = all(&mut open(Source::RecordingAt(path.clone(), said())).unwrap());
    let whole = frames.iter().zip(&given).filter(|(a, b)| a.pixels == b.pixels).count();
    assert!((8..=10).contains(&whole) && frames.len() <= whole + 1, "{whole} of {}", frames.len());
    let expected = format!("ends after {} of 20 frames: it is cut off or damaged", frames.len());
    assert!(error.as_ref().is_some_and(|e| e.ends_with(&expected)), "{error:?}");
    // The trait's call says how many had come.
    let mut grabber = open(Source::RecordingAt(path.clone(), said())).unwrap();
    let mut taken = 0;
    let stopped = grabber
        .stream(
            0.05,
            &mut |_| {
                taken += 1;
                ControlFlow::Continue(())
            },
            &within(20.0),
        )
        .unwrap_err();
    assert_eq!(stopped.done, taken);
    for (length, says) in [
        (0, "(0 bytes) is no recording"),
        (100, "(100 bytes) is no recording"),
        (3000, "is no recording"),
    ] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = open(Source::Recording(path.clone())).unwrap_err();
        assert!(error.contains(says), "{error}");
    }
}

/// Truth: the frames that were given: each comes back exactly or is named. FFV1 decodes a flipped byte to other pixels without a word,
/// in that frame and those after it, up to the next that stands alone (every twelfth, by FFmpeg's default).
#[test]
fn a_damaged_frame_is_found_by_its_check_sum() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    let given = frames(64, 64, 20);
    film(&path, &given).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    std::fs::write(&path, &bytes).unwrap();
    let mut grabber = open(Source::Recording(path)).unwrap();
    let mut damaged = 0;
    for given in &given {
        match grabber.next_frame(&within(20.0)) {
            Ok(frame) => assert_eq!(frame.unwrap().pixels, given.pixels),
            Err(error) => {
                damaged += 1;
                assert!(
                    error.to_string().contains("its pixels are not those that were recorded"),
                    "{error}"
                );
            }
        }
    }
    assert!((1..=12).contains(&damaged), "{damaged}");
}

#[test]
fn no_frame_makes_no_file_and_a_film_without_frames_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    let error = film(&path, &[]).unwrap_err();
    assert!(matches!(error, RecordError::Empty { .. }), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    // OpenCV's own writer makes such a file.
    opencv_film_without_frames(&path);
    let error = open(Source::RecordingAt(path.clone(), said())).unwrap_err();
    assert_eq!(error, format!("frame grabber: {} has no picture in it", path.display()));
    let absent = folder.path().join("absent.avi");
    let error = open(Source::Recording(absent.clone())).unwrap_err();
    assert!(error.contains(&format!("cannot open {}: No such file", absent.display())), "{error}");
}

fn opencv_film_without_frames(path: &Path) {
    use opencv::prelude::*;
    let codec = opencv::videoio::VideoWriter::fourcc('F', 'F', 'V', '1').unwrap();
    let size = opencv::core::Size::new(64, 64);
    let mut film = opencv::videoio::VideoWriter::new(path, codec, 10.0, size, false).unwrap();
    film.release().unwrap();
}

/// Truth: 10 frames a second by the file's positions, or 0.25 s as the user says.
#[test]
fn without_a_table_times_are_those_that_the_user_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    film(&path, &frames(8, 8, 4)).unwrap();
    std::fs::remove_file(sidecar::path_of(&path)).unwrap();
    let error = open(Source::Recording(path.clone())).unwrap_err();
    assert!(error.contains("night.avi.ecsv is not there: without it nobody knows when"), "{error}");
    for (interval_s, expected_s) in [(None, 0.1), (Some(0.25), 0.25)] {
        let said = sunglint_drivers_opencv::grabber::Said { interval_s, ..said() };
        let mut grabber = open(Source::RecordingAt(path.clone(), said)).unwrap();
        let (frames, error) = all(&mut grabber);
        assert_eq!(error, None);
        for (i, frame) in frames.iter().enumerate() {
            let since_s = (frame.start - said.first_start).to_seconds();
            assert!((since_s - i as f64 * expected_s).abs() < 1e-9, "{i}: {since_s}");
            assert_eq!(frame.exposure_s, 0.05);
        }
    }
}

#[test]
fn a_table_that_does_not_fit_its_film_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    film(&path, &frames(8, 8, 4)).unwrap();
    let table = sidecar::path_of(&path);
    let text = std::fs::read_to_string(&table).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let write = |lines: &[&str]| std::fs::write(&table, lines.join("\n") + "\n").unwrap();
    write(&lines[..lines.len() - 1]);
    let (frames, error) = all(&mut open(Source::Recording(path.clone())).unwrap());
    assert_eq!(frames.len(), 3);
    assert!(
        error
            .as_ref()
            .is_some_and(|e| e.ends_with("frame 3: it has no row in the table, which has 3")),
        "{error:?}"
    );
    write(&[&lines[..], &lines[lines.len() - 1..]].concat());
    let (frames, error) = all(&mut open(Source::Recording(path.clone())).unwrap());
    assert_eq!(frames.len(), 4);
    assert!(error.as_ref().is_some_and(|e| e.contains("ends after 4 of 5 frames")), "{error:?}");
    let wrong = text.replace("columns_px: 8", "columns_px: 9");
    assert_ne!(wrong, text);
    std::fs::write(&table, wrong).unwrap();
    let error = open(Source::Recording(path.clone())).unwrap_err();
    assert!(error.contains("has pictures of [8, 8] px, expected [9, 8]"), "{error}");
    std::fs::write(
        &table,
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: a, datatype: int64}\na\n1\n",
    )
    .unwrap();
    let error = open(Source::Recording(path)).unwrap_err();
    assert!(error.contains("found no `quantity: frames`"), "{error}");
}

#[test]
fn frames_that_do_not_belong_are_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    let given = frames(8, 8, 2);
    let mut recorder = Recorder::create(&path, 10.0).unwrap();
    recorder.write(&given[0]).unwrap();
    let mut bright = given[1].clone();
    bright.pixels[[2, 5]] = 256;
    let error = recorder.write(&bright).unwrap_err();
    assert_eq!(
        error.to_string(),
        "frame 1: row 2, column 5 has 256 ADU, more than 8 bits: record it as a sequence of images"
    );
    let error = recorder.write(&frame(1, noise(8, 9, 1, 255))).unwrap_err();
    assert_eq!(
        error.to_string(),
        "frame 1: columns and rows: found [9, 8], expected [8, 8] as in the first"
    );
    let error = recorder.write(&Frame { bayer: None, ..given[1].clone() }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "frame 1: pattern: found None, expected Some(Grbg) as in the first"
    );
    recorder.write(&given[1]).unwrap();
    assert_eq!(recorder.finish(&within(20.0)).unwrap().frames, 2);
    let error = Recorder::create(&path, 10.0).unwrap_err();
    assert!(matches!(error, RecordError::Exists { .. }), "{error}");
    let error = Recorder::create(folder.path().join("night.mp4"), 10.0).unwrap_err();
    assert!(error.to_string().contains("found `.mp4`, expected .avi or .mkv"), "{error}");
    let error = film(&folder.path().join("no/such.avi"), &given).unwrap_err();
    assert!(matches!(error, RecordError::Write { .. }), "{error}");
}

/// Exposures are those of the recording: asking for another is an error, at the first frame or later.
#[test]
fn an_exposure_that_was_not_recorded_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    film(&path, &frames(8, 8, 3)).unwrap();
    let mut grabber = open(Source::Recording(path)).unwrap();
    assert_eq!(grabber.next_exposure_s(), Some(0.1));
    let error = grabber.expose(0.2, &within(20.0)).unwrap_err().to_string();
    assert_eq!(
        error,
        "frame grabber: exposure, s was set to 0.2, the device says 0.1 (as recorded)"
    );
    assert_eq!(grabber.expose(0.1, &within(20.0)).unwrap().exposure_s, 0.1);
    let stopped =
        grabber.stream(0.11, &mut |_| ControlFlow::Continue(()), &within(20.0)).unwrap_err();
    assert_eq!(stopped.done, 1);
    let error = grabber.expose(0.12, &within(20.0)).unwrap_err().to_string();
    assert!(error.contains("at its end"), "{error}");
    for wrong in [0.0, -1.0, f64::NAN] {
        assert!(grabber.expose(wrong, &within(20.0)).is_err());
    }
}
