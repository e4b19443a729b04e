//! Sums beside photutils.

use crate::photometry::render::frame;
use ndarray::{Array2, Ix2};
use serde_json::Value;
use sunglint_calibration::photometry::{
    BadPixels, Expected, FrameCalibration, FrameReducer, PhotometryOptions, PixelFault,
};
use sunglint_formats::fits::{Fits, Pixels};
use sunglint_formats::frame::Frame;

fn frames() -> Vec<Frame> {
    let fits = Fits::read(sunglint_testkit::fixture("photometry/frames.fits")).unwrap();
    (1..5)
        .map(|i| match fits.image(i).unwrap().pixels {
            Pixels::U16(pixels) => {
                frame(pixels.into_dimensionality::<Ix2>().unwrap(), Some(1.0), None)
            }
            _ => panic!("16 bits"),
        })
        .collect()
}

fn check(cases: &Value) {
    let frames = frames();
    for case in cases["cases"].as_array().unwrap() {
        let number = |name: &str| case[name].as_f64().unwrap();
        let frame = &frames[case["frame"].as_u64().unwrap() as usize];
        let mut faults = Array2::from_elem(frame.pixels.raw_dim(), PixelFault::empty());
        for bad in case["bad"].as_array().unwrap() {
            faults[[bad[1].as_u64().unwrap() as usize, bad[0].as_u64().unwrap() as usize]] =
                PixelFault::HOT;
        }
        let bad =
            BadPixels { faults, origin: [0, 0], binning: [1, 1], median_adu: 0.0, sigma_adu: 1.0 };
        let calibration = FrameCalibration { bad: Some(bad), ..FrameCalibration::default() };
        let options = PhotometryOptions {
            aperture_radius_px: number("radius"),
            ..PhotometryOptions::new([64, 64], number("read"))
        };
        let mut reducer = FrameReducer::new(options, calibration).unwrap();
        let place = [number("x"), number("y")];
        let plane = reducer.measure_at(frame, place, &Expected::default()).unwrap().planes[0];
        // The same pixels with the same areas: to rounding (values pass through 32 bits unchanged).
        let kept = plane.rate_adu_per_s * (1.0 - plane.masked_light);
        let sum = kept + plane.background_adu * plane.area_px2;
        assert!((sum / number("sum") - 1.0).abs() < 1e-12, "{sum} {case}");
        assert!((plane.area_px2 / number("area") - 1.0).abs() < 1e-12, "{case}");
        // The medians: theirs is a whole or half count and not corrected for the lean of a Poisson distribution, at most 1/6 ADU here (1 e-/ADU);
        // clipping by another measure of scatter moves either by a fraction of its own error.
        let apart = (plane.background_adu - number("median")).abs();
        assert!(apart < 0.5 + 0.2 + 0.25 * plane.background_sigma_adu, "{apart} {case}");
        // The promise: 1e-3, for sources of which that is more than the median's half count over the area.
        let theirs = number("sum") - number("median") * number("area");
        if theirs > 1e5 {
            assert!((kept / theirs - 1.0).abs() < 1e-3, "{kept} {theirs} {case}");
        }
    }
}

/// Truth: photutils 3.0.0 on the same frames (stored, with its version): sums to rounding, net of the background to 1e-3.
#[test]
fn aperture_sums_are_those_of_photutils() {
    let stored =
        std::fs::read_to_string(sunglint_testkit::fixture("photometry/apertures.json")).unwrap();
    check(&serde_json::from_str(&stored).unwrap());
}

/// Truth: photutils as it is installed, run anew on the same frames.
#[test]
fn aperture_sums_are_those_of_photutils_today() {
    let name = "aperture_sums_are_those_of_photutils_today";
    let Some(python) = sunglint_testkit::peer_python(name, &["photutils"]) else { return };
    let script =
        std::fs::read_to_string(sunglint_testkit::repository().join("tests/peers/apertures.py"))
            .unwrap();
    let folder = sunglint_testkit::fixture("photometry");
    let out =
        sunglint_testkit::run_python(&python, &script, &["measure", folder.to_str().unwrap()]);
    check(&serde_json::from_str(&out).unwrap());
}
