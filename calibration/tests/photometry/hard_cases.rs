//! Difficult frames: what they may hold besides a well-behaved star.

use crate::photometry::render::{Exposure, Sky, frame};
use ndarray::Array2;
use proptest::prelude::*;
use sunglint_calibration::photometry::{
    BadPixels, Colour, Expected, FrameCalibration, FrameMeasurement, FrameReducer, PhotometryError,
    PhotometryOptions, PixelFault, Scintillation,
};
use sunglint_formats::frame::{Bayer, Frame};
use sunglint_radiometry::light_curve::Flags;

fn reducer() -> FrameReducer {
    FrameReducer::new(PhotometryOptions::new([100, 100], 5.0), FrameCalibration::default()).unwrap()
}

fn measure(frame: &Frame) -> FrameMeasurement {
    reducer().measure(frame, &Expected::default()).unwrap()
}

/// Truth: nothing is there: no target, no rate, and the reason.
#[test]
fn without_a_star_there_is_no_target() {
    let sky = Sky::new(100);
    let empty = Exposure::of(&sky, 1).read();
    let uniform = frame(Array2::from_elem((50, 70), 1234), Some(1.0), None);
    let full = frame(Array2::from_elem((50, 70), u16::MAX), Some(1.0), None);
    let tiny = frame(Array2::from_elem((1, 1), 9), Some(1.0), None);
    let nothing = frame(Array2::from_elem((0, 0), 9), Some(1.0), None);
    let mosaic = frame(Array2::from_elem((1, 3), 9), Some(1.0), Some(Bayer::Rggb));
    for frame in [empty, uniform, full, tiny, nothing, mosaic] {
        let measured = measure(&frame);
        assert_eq!((measured.place_px, measured.track.place), (None, None));
        for plane in &measured.planes {
            assert!(plane.rate_adu_per_s.is_nan());
            assert_eq!(plane.flags, Flags::UNDETECTED);
        }
        assert_eq!(measured.planes.len(), if frame.bayer.is_some() { 3 } else { 1 });
    }
}

/// Truth: closed form: a uniform frame has rate 0 everywhere; the aperture's edge cases are said.
#[test]
fn apertures_at_the_edge_say_so() {
    let uniform = frame(Array2::from_elem((100, 100), 1234), Some(1.0), None);
    let at = |x: f64, y: f64| {
        reducer().measure_at(&uniform, [x, y], &Expected::default()).unwrap().planes[0]
    };
    let inside = at(50.2, 49.7);
    assert!(inside.rate_adu_per_s.abs() < 1e-6 && inside.flags.is_empty(), "{inside:?}");
    assert_eq!(inside.background_adu, 1234.0);
    let annulus_cut = at(12.0, 50.0);
    assert!(annulus_cut.rate_adu_per_s.abs() < 1e-6);
    assert_eq!(annulus_cut.flags, Flags::EDGE);
    for (x, y) in
        [(7.0, 50.0), (-300.0, 50.0), (50.0, 1e30), (f64::NAN, 50.0), (f64::INFINITY, 0.0)]
    {
        let cut = at(x, y);
        assert!(cut.rate_adu_per_s.is_nan() && cut.flags.contains(Flags::EDGE), "{x} {y}: {cut:?}");
    }
    let tiny = frame(Array2::from_elem((1, 1), 9), Some(1.0), None);
    let plane = reducer().measure_at(&tiny, [0.0, 0.0], &Expected::default()).unwrap().planes[0];
    assert!(plane.rate_adu_per_s.is_nan() && plane.flags.contains(Flags::EDGE));
}

/// Truth: drawn: the plane that is full is excluded, the others keep their rates (4 stated σ), by the colours' shares.
#[test]
fn a_saturated_plane_is_excluded_and_the_others_stay() {
    let sky =
        Sky { bayer: Some(Bayer::Gbrg), through: [0.5, 1.0, 0.25], fwhm_px: 5.0, ..Sky::new(100) };
    let mut exposure = Exposure::of(&sky, 4);
    let electrons = 900_000.0;
    exposure.point(51.3, 48.8, electrons);
    let mut frame = exposure.read();
    frame.saturation_adu = Some(24_000.0);
    let measured = measure(&frame);
    let colours: Vec<Colour> = measured.planes.iter().map(|p| p.colour).collect();
    assert_eq!(colours, [Colour::Red, Colour::Green, Colour::Blue]);
    let [red, green, blue] = [0, 1, 2].map(|i| measured.planes[i]);
    assert!(green.rate_adu_per_s.is_nan() && green.flags.contains(Flags::SATURATED));
    assert!(green.saturated_pixels > 0);
    for (plane, through) in [(red, 0.5), (blue, 0.25)] {
        let off = (plane.rate_adu_per_s - electrons * through / 0.8) / plane.sigma.total();
        assert!(off.abs() < 4.0 && plane.flags.is_empty(), "{off} {plane:?}");
    }
    let place = measured.place_px.unwrap();
    assert!((place[0] - 51.3).hypot(place[1] - 48.8) < 0.05, "{place:?}");
}

/// Truth: drawn: a point of 2 px on a mosaic, at places all over a pixel. Its red rates scatter as the stated sampling error says (30 %), and are
/// flagged; green, with every second pixel of each row, ten times less.
#[test]
fn a_narrow_point_on_a_mosaic_is_flagged_and_its_error_stated() {
    let sky = Sky { bayer: Some(Bayer::Rggb), fwhm_px: 2.0, ..Sky::new(48) };
    let options = PhotometryOptions { fwhm_px: 2.0, ..PhotometryOptions::new([48, 48], 5.0) };
    let mut reducer = FrameReducer::new(options, FrameCalibration::default()).unwrap();
    let mut exposure = Exposure::of(&sky, 5);
    let (mut rates, mut stated) = ([Vec::new(), Vec::new()], [0.0; 2]);
    for i in 0..100 {
        exposure.again();
        let place = [22.0 + 0.2 * (i % 10) as f64, 23.0 + 0.2 * (i / 10) as f64];
        exposure.point(place[0], place[1], 150_000.0);
        let measured = reducer.measure(&exposure.read(), &Expected::default()).unwrap();
        for (plane, rates) in measured.planes.iter().zip(&mut rates) {
            assert!(plane.flags.contains(Flags::UNDERSAMPLED));
            rates.push(plane.rate_adu_per_s * 0.8 / 150_000.0);
        }
        stated = [0, 1].map(|p| {
            let plane = measured.planes[p];
            stated[p] + 0.01 * plane.sigma.sampling / plane.rate_adu_per_s
        });
    }
    let scatter = rates.map(|rates| {
        let mean = rates.iter().sum::<f64>() / 100.0;
        assert!((mean - 1.0).abs() < 0.005, "{mean}");
        (rates.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / 99.0).sqrt()
    });
    assert!((stated[0] / scatter[0] - 1.0).abs() < 0.3, "{scatter:?} {stated:?}");
    assert!(stated[0] > 0.02 && stated[1] < 0.1 * stated[0], "{stated:?}");
}

/// Truth: everything is masked: no rate, no target, no panic.
#[test]
fn a_sensor_that_is_all_masked() {
    let mut exposure = Exposure::of(&Sky::new(100), 6);
    exposure.point(50.0, 50.0, 50_000.0);
    let frame = exposure.read();
    let faults = Array2::from_elem((100, 100), PixelFault::HOT);
    let bad =
        BadPixels { faults, origin: [0, 0], binning: [1, 1], median_adu: 0.0, sigma_adu: 1.0 };
    let calibration = FrameCalibration { bad: Some(bad), ..FrameCalibration::default() };
    let mut reducer =
        FrameReducer::new(PhotometryOptions::new([100, 100], 5.0), calibration).unwrap();
    assert_eq!(reducer.measure(&frame, &Expected::default()).unwrap().place_px, None);
    let plane = reducer.measure_at(&frame, [50.0; 2], &Expected::default()).unwrap().planes[0];
    assert!(plane.rate_adu_per_s.is_nan());
}

/// Truth: the options' ranges and the frame's cards, by their names.
#[test]
fn what_cannot_be_measured_is_refused() {
    let uniform = frame(Array2::from_elem((50, 50), 100), None, None);
    let error = |frame: &Frame| reducer().measure(frame, &Expected::default()).unwrap_err();
    assert_eq!(error(&uniform), PhotometryError::NoGain);
    let dark = Frame { exposure_s: 0.0, ..uniform.clone() };
    assert_eq!(error(&dark), PhotometryError::Exposure { exposure_s: 0.0 });
    let options =
        PhotometryOptions { annulus_px: [5.0, 20.0].into(), ..PhotometryOptions::new([9, 9], 5.0) };
    assert_eq!(
        FrameReducer::new(options, FrameCalibration::default()).unwrap_err().to_string(),
        "photometry: annulus_px (inner) is 5, expected the aperture's radius to 1000"
    );
    // The middle of the exposure and the twinkling of the airmass are the frame's.
    let mut options = PhotometryOptions::new([50, 50], 5.0);
    options.gain_e_per_adu = Some(1.0);
    options.scintillation =
        Some(Scintillation { diameter_m: 0.43, altitude_m: 400.0, coefficient: 1.5 });
    let mut reducer = FrameReducer::new(options, FrameCalibration::default()).unwrap();
    let expected = Expected { airmass: Some(1.0), ..Expected::default() };
    let measured = reducer.measure_at(&uniform, [25.0, 25.0], &expected).unwrap();
    assert_eq!((measured.time - uniform.start).to_seconds(), 0.5);
    // 2.505 % at 0.1 s is that over √10 at 1 s.
    assert!((measured.scintillation.unwrap() - 0.02505 / 10f64.sqrt()).abs() < 1e-5);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    /// Truth: whatever the pixels, sizes and options, there is a measurement; a rate that is a number has a finite error, one that is not a flag.
    #[test]
    fn any_frame_is_measured(
        (rows, columns) in (0usize..40, 0usize..40),
        values in prop::collection::vec(prop_oneof![Just(0u16), Just(u16::MAX), any::<u16>(), 90u16..110], 1600),
        bayer in prop_oneof![Just(None), Just(Some(Bayer::Rggb)), Just(Some(Bayer::Gbrg))],
        x in -5.0..45.0, y in -5.0..45.0,
        radius in 0.2..9.0, trail in prop_oneof![Just(None), (-20.0..20.0f64, -20.0..20.0f64).prop_map(|(a, b)| Some([a, b].into()))],
        threshold in 0.5..10.0,
    ) {
        let pixels = Array2::from_shape_fn((rows, columns), |(r, c)| values[r * 40 + c]);
        let frame = frame(pixels, Some(1.0), bayer);
        let mut options = PhotometryOptions::new([40, 40], 2.0);
        options.aperture_radius_px = radius;
        options.annulus_px = [radius + 1.0, radius + 4.0].into();
        options.detection.threshold_sigma = threshold;
        let mut reducer = FrameReducer::new(options, FrameCalibration::default()).unwrap();
        let expected = Expected { place_px: Some([x, y].into()), trail_px: trail, ..Expected::default() };
        for measured in [reducer.measure(&frame, &expected), reducer.measure_at(&frame, [x, y], &expected)] {
            for plane in measured.unwrap().planes {
                prop_assert_eq!(plane.rate_adu_per_s.is_nan(), plane.sigma.total().is_nan());
                prop_assert!(!plane.rate_adu_per_s.is_nan() || !plane.flags.is_empty());
            }
        }
    }
}
