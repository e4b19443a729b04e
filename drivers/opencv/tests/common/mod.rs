//! Helpers that the tests of this crate share.
#![allow(dead_code, reason = "each test uses its part")]

use ndarray::Array2;
use opencv::core::{Mat, Size, Vec3b};
use opencv::prelude::*;
use opencv::videoio::VideoWriter;
use std::path::Path;
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers_opencv::grabber::Said;
use sunglint_drivers_opencv::{Grabber, GrabberSettings, Source};
use sunglint_formats::fits::Header;
use sunglint_formats::{Bayer, Frame, time};

pub fn within(seconds: f64) -> Deadline {
    Deadline::within(Duration::from_secs_f64(seconds))
}

/// Values without a pattern that a codec could know, up to `most`.
pub fn noise(rows: usize, columns: usize, seed: u32, most: u16) -> Array2<u16> {
    let mut state = seed.wrapping_mul(2_654_435_761) | 1;
    Array2::from_shape_simple_fn((rows, columns), || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state % (u32::from(most) + 1)) as u16
    })
}

/// Frame `index` of a night: each with its own time, exposure, temperature and cards.
pub fn frame(index: u32, pixels: Array2<u16>) -> Frame {
    let mut header = Header::default();
    header.set("INSTRUME", "CCD ö \"quoted\", with comma", "a comment");
    header.set("FRAMENO", i64::from(index / 2), "");
    header.set("AIRTEMP", 1.5 + f64::from(index), "deg C");
    header.history("made here");
    let first = time::parse_utc("2016-12-31T23:59:59.123456789").unwrap();
    Frame {
        pixels,
        origin: [501, 402],
        binning: [1, 1],
        bayer: Some(Bayer::Grbg),
        start: first + hifitime::Duration::from_seconds(0.25 * f64::from(index)),
        exposure_s: 0.1 + 0.01 * f64::from(index % 3),
        gain_e_per_adu: Some(0.27),
        temperature_c: (index != 1).then(|| -10.0 + 0.1 * f64::from(index)),
        saturation_adu: None,
        header,
    }
}

pub fn said() -> Said {
    let first_start = time::parse_utc("2026-03-04T05:06:07Z").unwrap();
    Said { first_start, interval_s: None, exposure_s: 0.05 }
}

pub fn open(source: Source) -> Result<Grabber, String> {
    Grabber::open(source, GrabberSettings::default(), &within(20.0)).map_err(|e| e.to_string())
}

/// All frames, and the error at which they ended.
pub fn all(grabber: &mut Grabber) -> (Vec<Frame>, Option<String>) {
    let mut frames = Vec::new();
    loop {
        match grabber.next_frame(&within(20.0)) {
            Ok(Some(frame)) => frames.push(frame),
            Ok(None) => return (frames, None),
            Err(error) => return (frames, Some(error.to_string())),
        }
    }
}

/// Writes blue, green and red with OpenCV alone.
pub fn opencv_film(path: &Path, codec: &str, colour: bool, frames: &[[Array2<u16>; 3]]) {
    let c: Vec<char> = codec.chars().collect();
    let codec = VideoWriter::fourcc(c[0], c[1], c[2], c[3]).unwrap();
    let (rows, columns) = frames[0][0].dim();
    let size = Size::new(columns as i32, rows as i32);
    let mut film = VideoWriter::new(path, codec, 10.0, size, colour).unwrap();
    assert!(film.is_opened().unwrap());
    for [blue, green, red] in frames {
        let (rows, columns) = (rows as i32, columns as i32);
        if colour {
            let pixels: Vec<Vec3b> = (blue.iter().zip(green).zip(red))
                .map(|((b, g), r)| Vec3b::from([*b as u8, *g as u8, *r as u8]))
                .collect();
            film.write(&Mat::new_rows_cols_with_data(rows, columns, &pixels).unwrap()).unwrap();
        } else {
            let pixels: Vec<u8> = green.iter().map(|&value| value as u8).collect();
            film.write(&Mat::new_rows_cols_with_data(rows, columns, &pixels).unwrap()).unwrap();
        }
    }
    film.release().unwrap();
}

/// Runs FFmpeg's own program, or records that `test` could not run.
pub fn ffmpeg(test: &str, arguments: &[&str]) -> Option<Vec<u8>> {
    let run = std::process::Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error"])
        .args(arguments)
        .output();
    match run {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            Some(output.stdout)
        }
        Err(_) => {
            sunglint_testkit::skip(test, "no ffmpeg (./test --opencv installs it)");
            None
        }
    }
}
