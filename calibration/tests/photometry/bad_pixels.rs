//! Masks, darks, flats.

use crate::photometry::render::{Exposure, Sky, frame};
use ndarray::Array2;
use sunglint_calibration::photometry::{
    BadPixels, Expected, FrameCalibration, FrameReducer, MasterFrame, PhotometryError,
    PhotometryOptions, PixelFault,
};
use sunglint_formats::frame::Bayer;

fn dark_sky() -> Sky {
    Sky { sky_e: 2.0, ..Sky::new(60) }
}

/// Truth: pixels that were made hot, cold and dead; of the others a normal distribution leaves 0.27 % beyond 3σ (3σ of a binomial: 20 of 3600).
#[test]
fn hot_cold_and_dead_pixels_are_found() {
    let mut exposure = Exposure::of(&dark_sky(), 1);
    let mut darks = Vec::new();
    for _ in 0..16 {
        exposure.again();
        exposure.electrons[[7, 9]] += 400.0;
        exposure.electrons[[30, 31]] -= 60.0;
        let mut dark = exposure.read();
        dark.pixels[[50, 2]] = 202;
        darks.push(dark);
    }
    let bad = BadPixels::from_darks(&darks, 3.0).unwrap();
    assert_eq!(bad.faults[[7, 9]], PixelFault::HOT);
    assert_eq!(bad.faults[[30, 31]], PixelFault::COLD);
    assert!(bad.faults[[50, 2]].contains(PixelFault::DEAD));
    assert!(bad.count(PixelFault::all()) <= 23, "{}", bad.count(PixelFault::all()));
    // √((2 + 25)/0.8² + 1/12) ADU over √16, to the 2 % of a MAD of 3600 values, and of whole counts over 16 frames.
    assert!((bad.sigma_adu / (42.27f64.sqrt() / 4.0) - 1.0).abs() < 0.05, "{}", bad.sigma_adu);
    assert!((bad.median_adu - 202.5).abs() < 0.1, "{}", bad.median_adu);
    assert_eq!(
        BadPixels::from_darks(&[], 3.0),
        Err(PhotometryError::TooFew { found: 0, needed: 1 })
    );
}

/// Truth: the same sensor without the hot pixel: the rate of a target over a masked pixel, corrected for the light there, agrees within the stated
/// errors (mean of 40 draws, 3 standard errors, and the stated error of the correction), and does not without the mask.
#[test]
fn a_hot_pixel_under_the_target() {
    let sky = Sky::new(60);
    let mut faults = Array2::from_elem((60, 60), PixelFault::empty());
    faults[[30, 31]] = PixelFault::HOT;
    let bad =
        BadPixels { faults, origin: [0, 0], binning: [1, 1], median_adu: 0.0, sigma_adu: 1.0 };
    let calibration = FrameCalibration { bad: Some(bad), ..FrameCalibration::default() };
    let options = PhotometryOptions::new([60, 60], sky.read_noise_e);
    let mut masked = FrameReducer::new(options.clone(), calibration.clone()).unwrap();
    let mut plain = FrameReducer::new(options.clone(), FrameCalibration::default()).unwrap();
    let mut exposure = Exposure::of(&sky, 2);
    let (mut with, mut without, mut correction, mut places) = (0.0, 0.0, 0.0, [0.0; 2]);
    const DRAWS: usize = 40;
    for _ in 0..DRAWS {
        exposure.again();
        exposure.point(30.3, 29.8, 50_000.0);
        exposure.electrons[[30, 31]] += 8000.0;
        let frame = exposure.read();
        let measured = masked.measure(&frame, &Expected::default()).unwrap();
        let plane = measured.planes[0];
        with += plane.rate_adu_per_s / DRAWS as f64;
        correction = plane.sigma.masked;
        // One of 201 px; 4 to 6 % of the light of a point of 4 px.
        assert!((plane.masked_fraction - 1.0 / 201.06).abs() < 1e-4);
        assert!((0.03..0.06).contains(&plane.masked_light), "{}", plane.masked_light);
        let place = measured.place_px.unwrap();
        places = [places[0] + place[0] / DRAWS as f64, places[1] + place[1] / DRAWS as f64];
        without += plain.measure_at(&frame, [30.3, 29.8], &Expected::default()).unwrap().planes[0]
            .rate_adu_per_s
            / DRAWS as f64;
    }
    let truth = 50_000.0 / sky.gain_e_per_adu;
    assert!((with - truth).abs() < 150.0 + 0.5 * correction, "{with} {truth} {correction}");
    assert!((without - truth - 10_000.0).abs() < 150.0, "{without} {truth}");
    // The masked pixel has its mirror image's light: the centroid stays within 0.01 px (0.002 is its noise).
    assert!((places[0] - 30.3).hypot(places[1] - 29.8) < 0.01, "{places:?}");
    // Beyond what may be made up for there is no rate.
    let strict = PhotometryOptions { max_masked_light: 0.01, ..options };
    let mut strict = FrameReducer::new(strict, calibration).unwrap();
    let plane = strict.measure(&exposure.read(), &Expected::default()).unwrap().planes[0];
    assert!(plane.rate_adu_per_s.is_nan() && strict.tally().masked == 1);
}

/// Truth: a rate on a sensor with a pattern of responses (0.8 to 1.2) and of dark levels, calibrated, is that of a sensor without; the calibration is
/// of a larger region than the frame. Tolerance: 4 stated σ.
#[test]
fn darks_and_a_flat_make_the_sensor_even() {
    let sky = Sky { sky_e: 400.0, ..Sky::new(64) };
    let response = |r: usize, c: usize| 0.8 + 0.1 * ((r * 7 + c * 3) % 5) as f64;
    let level = |r: usize, c: usize| ((r * 5 + c * 11) % 40) as u16;
    let dark_pixels = Array2::from_shape_fn((64, 64), |(r, c)| 200 + level(r, c));
    let mut darks = vec![frame(dark_pixels, Some(0.8), None)];
    let flat_pixels = Array2::from_shape_fn((64, 64), |(r, c)| {
        (20_000.0 * response(r, c)) as u16 + 200 + level(r, c)
    });
    let flats = vec![frame(flat_pixels, Some(0.8), None)];
    let dark = MasterFrame::mean(&darks).unwrap();
    let flat = MasterFrame::flat(&flats, &dark).unwrap();
    let calibration =
        FrameCalibration { dark: Some(dark), flat: Some(flat), ..FrameCalibration::default() };
    let mut exposure = Exposure::of(&sky, 3);
    exposure.point(33.0, 34.5, 30_000.0);
    let even = exposure.read();
    // A sub-frame from (3, 5), its light above the bias scaled, with the pattern of levels.
    let part = Array2::from_shape_fn((58, 60), |(r, c)| {
        let (r, c) = (r + 5, c + 3);
        ((f64::from(even.pixels[[r, c]]) - 200.0) * response(r, c)).round() as u16
            + 200
            + level(r, c)
    });
    let mut part = frame(part, Some(0.8), None);
    part.origin = [3, 5];
    let options = PhotometryOptions::new([64, 64], sky.read_noise_e);
    let mut reducer = FrameReducer::new(options.clone(), calibration.clone()).unwrap();
    let measured = reducer.measure(&part, &Expected::default()).unwrap();
    let plane = measured.planes[0];
    let off = (plane.rate_adu_per_s - 30_000.0 / 0.8) / plane.sigma.total();
    assert!(off.abs() < 4.0, "{off}");
    // Places are on the sensor, whatever the region.
    let offset = measured.track.place.unwrap().offset_px;
    assert!((offset[0] - 1.5).abs() < 0.1 && (offset[1] - 3.0).abs() < 0.1, "{offset:?}");
    // Of another exposure, or beyond the region, it is refused.
    part.exposure_s = 2.0;
    let refused = reducer.measure(&part, &Expected::default()).unwrap_err().to_string();
    assert!(refused.starts_with("the dark was exposed 1 s, the frame 2 s"), "{refused}");
    darks[0].origin = [100, 0];
    part.exposure_s = 1.0;
    let elsewhere =
        FrameCalibration { dark: Some(MasterFrame::mean(&darks).unwrap()), ..calibration };
    let mut reducer = FrameReducer::new(options, elsewhere).unwrap();
    let refused = reducer.measure(&part, &Expected::default()).unwrap_err().to_string();
    assert!(
        refused.contains("columns [100, 164]") && refused.contains("needs columns [3, 63]"),
        "{refused}"
    );
}

/// Truth: a flat of a mosaic under coloured light is 1 in the middle of each colour.
#[test]
fn a_flat_of_a_mosaic_is_even_colour_by_colour() {
    let pixels =
        Array2::from_shape_fn((8, 8), |(r, c)| [4000u16, 9000, 9000, 2000][r % 2 * 2 + c % 2]);
    let mosaic = frame(pixels, None, Some(Bayer::Rggb));
    let dark = MasterFrame::mean(&[frame(Array2::zeros((8, 8)), None, Some(Bayer::Rggb))]).unwrap();
    let flat = MasterFrame::flat(&[mosaic], &dark).unwrap();
    assert!(flat.pixels.iter().all(|v| (v - 1.0).abs() < 1e-6));
}
