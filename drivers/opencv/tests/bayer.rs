//! Mosaics: OpenCV's names of the patterns are those of FITS shifted by a pixel.
#![cfg(feature = "opencv")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{frame, within};
use ndarray::{Array2, s};
use sunglint_drivers::device::{Camera as _, Window};
use sunglint_drivers_opencv::bayer::demosaic;
use sunglint_drivers_opencv::{Grabber, GrabberSettings, Recorder, Source};
use sunglint_formats::{Bayer, Frame};

const ALL: [Bayer; 4] = [Bayer::Rggb, Bayer::Grbg, Bayer::Gbrg, Bayer::Bggr];

/// A mosaic of a scene of one colour: red 1000, green 2000, blue 50,000 ADU, where the pattern's letters stand.
fn mosaic(bayer: Bayer, rows: usize, columns: usize) -> Array2<u16> {
    Array2::from_shape_fn((rows, columns), |(row, column)| {
        match bayer.name().as_bytes()[row % 2 * 2 + column % 2] {
            b'R' => 1000,
            b'G' => 2000,
            _ => 50_000,
        }
    })
}

fn is_of_one_colour(colours: &[Array2<u16>; 3]) -> bool {
    colours.iter().zip([1000, 2000, 50_000]).all(|(plane, level)| plane.iter().all(|v| *v == level))
}

/// Truth: the scene's colour, in every pixel, exactly: means of equal numbers are those numbers. With the names of OpenCV taken
/// for those of FITS, red and blue change places, or green comes where they should be.
#[test]
fn a_scene_of_one_colour_has_that_colour() {
    for bayer in ALL {
        for (rows, columns) in [(8, 8), (7, 10), (4, 4), (33, 5)] {
            let frame = Frame { bayer: Some(bayer), ..frame(0, mosaic(bayer, rows, columns)) };
            assert!(is_of_one_colour(&demosaic(&frame).unwrap()), "{bayer:?} {rows} {columns}");
            for wrong in ALL.into_iter().filter(|other| *other != bayer) {
                let frame = Frame { bayer: Some(wrong), ..frame.clone() };
                assert!(!is_of_one_colour(&demosaic(&frame).unwrap()), "{bayer:?} as {wrong:?}");
            }
        }
    }
}

/// Truth: the same scene, cut at even and odd origins out of a recorded mosaic.
#[test]
fn a_window_at_an_odd_origin_keeps_the_colours() {
    let folder = tempfile::tempdir().unwrap();
    for (i, bayer) in ALL.into_iter().enumerate() {
        let pattern = folder.path().join(format!("m{i}_%d.png"));
        let pixels = mosaic(bayer, 20, 24);
        let given = Frame { bayer: Some(bayer), ..frame(0, pixels.clone()) };
        let mut recorder = Recorder::create(&pattern, 1.0).unwrap();
        recorder.write(&given).unwrap();
        recorder.finish(&within(20.0)).unwrap();
        for origin in [[0, 0], [1, 0], [0, 1], [3, 5]] {
            let source = Source::Sequence(pattern.clone());
            let mut grabber =
                Grabber::open(source, GrabberSettings::default(), &within(20.0)).unwrap();
            let window = Window { origin_px: origin, size_px: [8, 6], binning: [1, 1] };
            assert_eq!(grabber.set_window(window, &within(1.0)).unwrap(), window);
            let cut = grabber.next_frame(&within(20.0)).unwrap().unwrap();
            let [x, y] = origin.map(|side| side as usize);
            assert_eq!(cut.pixels, pixels.slice(s![y..y + 6, x..x + 8]));
            assert_eq!(cut.origin, [501 + origin[0], 402 + origin[1]]);
            assert!(is_of_one_colour(&demosaic(&cut).unwrap()), "{bayer:?} {origin:?}");
        }
        let mut grabber =
            Grabber::open(Source::Sequence(pattern), GrabberSettings::default(), &within(20.0))
                .unwrap();
        for (origin_px, size_px, binning, says) in [
            ([24, 0], [1, 1], [1, 1], "first column, px: found 24, expected 0 to 23"),
            ([20, 0], [5, 1], [1, 1], "columns, px: found 5, expected 1 to 4"),
            ([0, 0], [1, 0], [1, 1], "rows, px: found 0, expected 1 to 20"),
            ([0, u32::MAX], [1, 1], [1, 1], "first row, px: found 4294967295, expected 0 to 19"),
            ([0, 0], [8, 8], [2, 2], "binning: found [2, 2], expected one of [1, 1]"),
        ] {
            let window = Window { origin_px, size_px, binning };
            let error = grabber.set_window(window, &within(1.0)).unwrap_err().to_string();
            assert_eq!(error, says);
        }
    }
}

#[test]
fn a_frame_without_a_pattern_has_no_colours() {
    let grey = Frame { bayer: None, ..frame(0, mosaic(Bayer::Rggb, 8, 8)) };
    assert!(demosaic(&grey).unwrap_err().to_string().contains("no Bayer pattern"));
    let small = frame(0, mosaic(Bayer::Grbg, 2, 8));
    assert!(demosaic(&small).unwrap_err().to_string().contains("expected 4 × 4 or more"));
}
