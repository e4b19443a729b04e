//! Interlaced video, bent with a gamma, with frames lost and doubled: back to a star's light and its times.
#![cfg(feature = "opencv")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{all, frame, noise, open, opencv_film, said, within};
use hifitime::{Duration, Epoch};
use ndarray::{Array2, s};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use sunglint_calibration::photometry::{
    Expected, FrameCalibration, FrameReducer, PhotometryOptions,
};
use sunglint_drivers::device::{Camera as _, Window};
use sunglint_drivers_opencv::grabber::Said;
use sunglint_drivers_opencv::{
    Doubled, Field, Gamma, Grabber, GrabberSettings, Losses, Recorder, Source, sidecar,
};
use sunglint_formats::{Frame, time};
use sunglint_radiometry::light_curve::Flags;

const GAMMA: f64 = 0.45;
const INTERVAL_S: f64 = 0.04;
/// A star of 5 px, its standard deviation, px; its peak and the sky's light, parts of full scale; its place, column and row.
const SIGMA_PX: f64 = 5.0 / 2.354_820_045;
const PEAK: f64 = 0.6;
const SKY: f64 = 0.02;
const PLACE: [f64; 2] = [48.3, 60.6];
/// 200 frames, of which 3 % are lost, one pair in a row, and four more repeat the one before.
const FRAMES: u64 = 200;
const LOST: [u64; 6] = [17, 18, 60, 101, 142, 190];
const DOUBLED: [u64; 4] = [30, 77, 120, 165];

fn first() -> Epoch {
    time::parse_utc("2026-03-04T05:06:07Z").unwrap()
}

/// Light of the star, parts of its mean, at a time since the first frame, s: 4 mag/s where it is steepest.
fn curve(at_s: f64) -> f64 {
    1.0 + 0.5 * (2.0 * PI * at_s / 0.8).sin()
}

/// A nearly normal number of standard deviation 1 for each pixel: the sum of four even ones, from SplitMix64 (Steele, Lea & Flood 2014).
fn drawn([number, row, column]: [u64; 3]) -> f64 {
    let mut state = (number << 40) | (row << 20) | column;
    let mut even = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    3_f64.sqrt() * (even() + even() + even() + even())
}

/// A frame of two moments: even rows show the middle of its first half, odd ones that of its second. Numbers of 8 bits, bent.
fn interlaced(number: u64) -> Array2<u16> {
    Array2::from_shape_fn((120, 96), |(row, column)| {
        let at_s = INTERVAL_S * (number as f64 + if row % 2 == 0 { 0.25 } else { 0.75 });
        let [x, y] = [column as f64 - PLACE[0], row as f64 - PLACE[1]];
        let star = PEAK * curve(at_s) * (-0.5 * (x * x + y * y) / SIGMA_PX.powi(2)).exp();
        let light = SKY + star + 0.0008 * drawn([number, row as u64, column as u64]);
        (255.0 * light.clamp(0.0, 1.0).powf(GAMMA)).round() as u16
    })
}

/// The numbers of the frames that are on the film, and whether each repeats the one before.
fn kept() -> impl Iterator<Item = (u64, bool)> {
    (0..FRAMES).filter(|i| !LOST.contains(i)).map(|i| (i, DOUBLED.contains(&i)))
}

fn film(folder: &Path) -> PathBuf {
    let path = folder.join("interlaced.avi");
    let mut recorder = Recorder::create(&path, 1.0 / INTERVAL_S).unwrap();
    let mut pixels = interlaced(0);
    for (number, doubled) in kept() {
        if !doubled {
            pixels = interlaced(number);
        }
        let start = first() + Duration::from_seconds(INTERVAL_S * number as f64);
        let like = frame(0, pixels.clone());
        let (origin, bayer) = ([0, 0], None);
        let frame = Frame { origin, bayer, start, exposure_s: INTERVAL_S, ..like };
        recorder.write(&frame).unwrap();
    }
    recorder.finish(&within(60.0)).unwrap();
    path
}

fn settings(fields: Field) -> GrabberSettings {
    GrabberSettings {
        fields: Some(fields),
        gamma: Some(Gamma::new(GAMMA).unwrap()),
        doubled: Doubled::LeaveOut,
        ..GrabberSettings::default()
    }
}

/// How far a field's magnitude is from the formula's. Half of the star's light falls on the rows of a field; a Gauss function of 2.1 px on
/// rows 2 px apart sums to that within 10⁻⁹ (Poisson's sum: 2 exp(−2π²σ²/4)). The rate is that of the field's own 0.02 s.
fn off_mag(reducer: &mut FrameReducer, field: &Frame) -> f64 {
    let measured = reducer.measure(field, &Expected::default()).unwrap();
    let plane = measured.planes[0];
    // A star half as high as wide is no round point: three of 380 fields have a pixel that looks like a cosmic ray.
    assert!((plane.flags - Flags::CROWDED).is_empty(), "{measured:?}");
    let at_s = (field.start - first()).to_seconds() + 0.5 * field.exposure_s;
    let light = 0.5 * PEAK * 2.0 * PI * SIGMA_PX.powi(2) * curve(at_s);
    -2.5 * (plane.rate_adu_per_s * 0.02 / 65_535.0 / light).log10()
}

/// Truth: the formula of the star's light. Magnitudes within 0.02 in each field (noise of 0.004 mag where the star is faintest; the worst of 380 is 0.016), times within half a field: the
/// light curve's phase, fitted to the rates at the fields' own times, is off by less than 10 ms, and each start is that of the field.
/// The other order of the fields is off by 0.08 mag: the test can fail.
#[test]
fn a_stars_light_comes_back_from_interlaced_video_with_a_gamma() {
    let folder = tempfile::tempdir().unwrap();
    let path = film(folder.path());
    let fields = |first: Field| {
        let source = Source::Recording(path.clone());
        let mut grabber = Grabber::open(source, settings(first), &within(60.0)).unwrap();
        let (fields, error) = all(&mut grabber);
        assert_eq!(error, None);
        let (lost, doubled) = (LOST.len() as u64, DOUBLED.len() as u64);
        assert_eq!(grabber.losses(), Losses { lost, doubled });
        fields
    };
    let given = fields(Field::Top);
    let whole: Vec<u64> =
        kept().filter(|(_, doubled)| !doubled).map(|(number, _)| number).collect();
    assert_eq!(given.len(), 2 * whole.len());
    let options = PhotometryOptions {
        gain_e_per_adu: Some(1.0),
        fwhm_px: 3.5,
        ..PhotometryOptions::new([96, 120], 5.0)
    };
    let mut reducer = FrameReducer::new(options, FrameCalibration::default()).unwrap();
    let mut worst = 0.0_f64;
    // Normal equations of a + b sin + c cos, each field a row.
    let mut sums = [[0.0_f64; 4]; 3];
    for (i, field) in given.iter().enumerate() {
        let since_s = (field.start - first()).to_seconds();
        let expected_s = INTERVAL_S * (whole[i / 2] as f64 + 0.5 * (i % 2) as f64);
        assert!((since_s - expected_s).abs() < 1e-6, "{i}: {since_s}");
        assert_eq!((field.exposure_s, field.binning, field.origin), (0.02, [1, 2], [0, 0]));
        assert_eq!((field.pixels.dim(), field.saturation_adu), ((60, 96), Some(65_535.0)));
        let off = off_mag(&mut reducer, field);
        worst = worst.max(off.abs());
        let rate = reducer.measure(field, &Expected::default()).unwrap().planes[0].rate_adu_per_s;
        let (sin, cos) = (2.0 * PI * (since_s + 0.01) / 0.8).sin_cos();
        let row = [1.0, sin, cos, rate];
        for (j, sum) in sums.iter_mut().enumerate() {
            (0..4).for_each(|k| sum[k] += row[j] * row[k]);
        }
    }
    assert!(worst < 0.02, "{worst} mag");
    for pivot in 0..3 {
        for j in (0..3).filter(|&j| j != pivot) {
            let part = sums[j][pivot] / sums[pivot][pivot];
            (0..4).for_each(|k| sums[j][k] -= part * sums[pivot][k]);
        }
    }
    let [sin, cos] = [1, 2].map(|j| sums[j][3] / sums[j][j]);
    let late_s = cos.atan2(sin) * 0.8 / (2.0 * PI);
    assert!(late_s.abs() < 0.01, "{late_s} s");
    let swapped = fields(Field::Bottom);
    let off = swapped.iter().map(|field| off_mag(&mut reducer, field).abs());
    assert!(off.fold(0.0, f64::max) > 0.07);
    let last = &given[given.len() - 1].header;
    assert_eq!((last.integer("GRABLOST"), last.integer("GRABDUBL")), (Some(6), Some(4)));
    assert_eq!((last.text("FIELD"), last.integer("FIELDNO")), (Some("bottom"), Some(2)));
    assert_eq!((last.integer("ROWPITCH"), last.real("GAMMA")), (Some(2), Some(GAMMA)));
    assert!(last.commentaries("COMMENT").any(|c| c.contains("EGAIN: 0.27 e-/ADU was")));
    assert_eq!(given[0].gain_e_per_adu, None);
}

/// Kept, doubled frames say so, in both of their fields; the numbers on a film without a table come evenly, whatever was lost.
#[test]
fn doubled_frames_that_are_kept_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = film(folder.path());
    let keep = GrabberSettings { doubled: Doubled::Flag, ..settings(Field::Top) };
    let mut grabber = Grabber::open(Source::Recording(path.clone()), keep, &within(60.0)).unwrap();
    let (fields, error) = all(&mut grabber);
    assert_eq!(error, None);
    let says = |field: &Frame| field.header.logical("DOUBLED") == Some(true);
    let expected: Vec<bool> = kept().flat_map(|(_, doubled)| [doubled; 2]).collect();
    assert_eq!(fields.iter().map(says).collect::<Vec<_>>(), expected);
    std::fs::remove_file(sidecar::path_of(&path)).unwrap();
    let said = Said { interval_s: Some(INTERVAL_S), exposure_s: 0.005, ..said() };
    let source = Source::RecordingAt(path, said);
    let mut grabber = Grabber::open(source, keep, &within(60.0)).unwrap();
    let (fields, _) = all(&mut grabber);
    assert_eq!(grabber.losses(), Losses { lost: 0, doubled: 4 });
    // A shutter that is faster than a field keeps its exposure.
    assert_eq!(fields[1].exposure_s, 0.005);
    assert!(((fields[1].start - fields[0].start).to_seconds() - 0.02).abs() < 1e-9);
}

/// Truth: by hand, 65 535 (n/255)^(1/0.45), rounded.
#[test]
fn a_gamma_is_undone_by_its_formula() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ramp.avi");
    let ramp = Array2::from_shape_fn((16, 16), |(row, column)| (16 * row + column) as u16);
    opencv_film(&path, "FFV1", false, &[[ramp.clone(), ramp.clone(), ramp]]);
    let gamma = Some(Gamma::new(GAMMA).unwrap());
    let settings = GrabberSettings { gamma, ..GrabberSettings::default() };
    let source = Source::RecordingAt(path, said());
    let frame =
        Grabber::open(source, settings, &within(20.0)).unwrap().next_frame(&within(20.0)).unwrap();
    let frame = frame.unwrap();
    let light = |n: usize| frame.pixels[[n / 16, n % 16]];
    let by_hand = [0, 0, 1, 3036, 14168, 64965, 65535];
    assert_eq!([0, 1, 2, 64, 128, 254, 255].map(light), by_hand);
    // From 2 on each number has a light of its own.
    assert!((2..255).all(|n| light(n) < light(n + 1)));
    assert_eq!(frame.saturation_adu, Some(65_535.0));
    for wrong in [0.0, -0.45, f64::NAN, f64::INFINITY, 0.05, 2.2] {
        let error = Gamma::new(wrong).unwrap_err().to_string();
        assert!(error.contains(&format!("gamma: found {wrong}, expected 0.1 to 1")), "{error}");
    }
    let error = Gamma::new(2.2).unwrap_err().to_string();
    assert!(error.ends_with("the reciprocal: 0.4545 here"), "{error}");
}

/// Truth: drawn: lights spread evenly over some of the recorded numbers around a level, bent and rounded as a recorder does; what comes back is off by the stated
/// noise, within 5 % (the slope changes over the numbers that are drawn).
#[test]
fn quantisation_noise_is_that_which_is_stated() {
    let gamma = Gamma::new(GAMMA).unwrap();
    for level in [60.5_f64, 128.5, 250.5] {
        let light = |recorded: f64| 65_535.0 * (recorded / 255.0).powf(1.0 / GAMMA);
        let (low, high) = (light(level - 3.0), light(level + 3.0));
        let (mut sum, count) = (0.0, 6000);
        for i in 0..count {
            let drawn = low + (high - low) * (f64::from(i) + 0.5) / f64::from(count);
            let recorded = (255.0 * (drawn / 65_535.0).powf(GAMMA)).round();
            sum += (light(recorded) - drawn).powi(2);
        }
        let found = (sum / f64::from(count)).sqrt();
        let stated = gamma.quantisation_adu(light(level), 8);
        assert!((found / stated - 1.0).abs() < 0.05, "{level}: {found}, {stated}");
    }
    // 16 bits: the steps of the numbers are 256 times smaller.
    let ratio = gamma.quantisation_adu(2e4, 8) / gamma.quantisation_adu(2e4, 16);
    assert!((ratio / 257.0 - 1.0).abs() < 0.01, "{ratio}");
}

/// Rows of a field are every second row of the frame, cut to the window, which counts in the field's own rows.
#[test]
fn a_field_is_every_second_row() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.avi");
    let given = Frame { bayer: None, ..frame(0, noise(12, 10, 1, 255)) };
    let mut recorder = Recorder::create(&path, 10.0).unwrap();
    recorder.write(&given).unwrap();
    recorder.finish(&within(20.0)).unwrap();
    let settings = GrabberSettings { fields: Some(Field::Bottom), ..GrabberSettings::default() };
    let mut grabber = Grabber::open(Source::Recording(path), settings, &within(20.0)).unwrap();
    assert_eq!(grabber.sensor_px(), [10, 6]);
    // One row in the table has no interval: the film's nominal rate counts.
    assert_eq!(grabber.next_exposure_s(), Some(0.05));
    let window = Window { origin_px: [3, 2], size_px: [4, 3], binning: [1, 1] };
    grabber.set_window(window, &within(20.0)).unwrap();
    let (fields, error) = all(&mut grabber);
    assert_eq!((fields.len(), error), (2, None));
    for (field, begins) in fields.iter().zip([1, 0]) {
        let rows = given.pixels.slice(s![begins..;2, ..]);
        assert_eq!(field.pixels, rows.slice(s![2..5, 3..7]));
        assert_eq!((field.origin, field.binning), ([504, 406], [1, 2]));
    }
}

#[test]
fn what_cannot_be_split_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let settings = GrabberSettings { fields: Some(Field::Top), ..GrabberSettings::default() };
    let mut tried = 0;
    let mut error = |given: Frame| {
        tried += 1;
        let path = folder.path().join(format!("{tried}.avi"));
        let mut recorder = Recorder::create(&path, 10.0).unwrap();
        recorder.write(&given).unwrap();
        recorder.finish(&within(20.0)).unwrap();
        let opened = Grabber::open(Source::Recording(path), settings, &within(20.0));
        opened.and_then(|mut grabber| grabber.next_frame(&within(20.0))).unwrap_err().to_string()
    };
    let mosaic = error(frame(0, noise(12, 10, 1, 255)));
    assert!(mosaic.contains("a mosaic's field has half of its colours"), "{mosaic}");
    let odd = error(Frame { bayer: None, ..frame(0, noise(11, 10, 1, 255)) });
    assert!(odd.contains("has 11 rows, expected an even number"), "{odd}");
    let origin = error(Frame { bayer: None, origin: [0, 3], ..frame(0, noise(12, 10, 1, 255)) });
    assert!(origin.contains("begins at the sensor's row 3, expected a multiple of 2"), "{origin}");
    // Images have no rate of their own.
    let images = folder.path().join("f_%03d.png");
    let mut recorder = Recorder::create(&images, 10.0).unwrap();
    recorder.write(&Frame { bayer: None, ..frame(0, noise(12, 10, 1, 255)) }).unwrap();
    recorder.finish(&within(20.0)).unwrap();
    assert!(open(Source::Sequence(images.clone())).is_ok());
    let rate = Grabber::open(Source::Sequence(images), settings, &within(20.0)).unwrap_err();
    assert!(rate.to_string().contains("nobody knows the interval"), "{rate}");
}
