//! Centroids and widths.

use crate::photometry::render::{Exposure, Sky};
use sunglint_calibration::photometry::{
    Expected, FrameCalibration, FrameReducer, PhotometryOptions,
};
use sunglint_formats::frame::Bayer;

/// Chi-squared of places with their stated covariance: mean offsets, their error, and the share within the 68.3 % ellipse.
fn offsets(sky: &Sky, electrons: f64, draws: usize) -> ([f64; 2], [f64; 2], f64, f64) {
    let n = sky.size[0] as u32;
    let options = PhotometryOptions::new([n, n], sky.read_noise_e);
    let mut reducer = FrameReducer::new(options, FrameCalibration::default()).unwrap();
    let mut exposure = Exposure::of(sky, 11);
    let (mut inside, mut found, mut widths) = (0.0, 0.0, 0.0);
    let (mut sum, mut sum2) = ([0.0; 2], [0.0; 2]);
    for i in 0..draws {
        exposure.again();
        let middle = 0.5 * (sky.size[0] as f64 - 1.0);
        let place = [middle + (i % 10) as f64 * 0.2, middle - (i % 7) as f64 / 7.0];
        exposure.point(place[0], place[1], electrons);
        let frame = exposure.read();
        let measured = reducer.measure(&frame, &Expected::default()).unwrap();
        let Some(on_sensor) = measured.track.place else { continue };
        // The middle of the sensor is the middle of the frame here.
        let error = [0, 1].map(|a| on_sensor.offset_px[a] + middle - place[a]);
        let [xx, yy, xy] = on_sensor.covariance_px2;
        let [dx, dy] = error;
        let chi2 = (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy);
        inside += f64::from(chi2 < 2.2958);
        found += 1.0;
        widths += measured.fwhm_px.unwrap();
        for a in 0..2 {
            sum[a] += error[a];
            sum2[a] += error[a] * error[a];
        }
    }
    assert!(found > 0.99 * draws as f64, "{found} of {draws}");
    let mean = sum.map(|s| s / found);
    let standard = [0, 1].map(|a| ((sum2[a] / found - mean[a] * mean[a]) / found).sqrt());
    (mean, standard, inside / found, widths / found)
}

/// Truth: where the photons were drawn; a two-dimensional normal error has 68.3 % within χ² = 2.296. Tolerance: binomial, 4 standard
/// deviations, and 1.5 % for a covariance that is itself measured. Widths: 3 % (their own error is 0.5 %).
#[test]
fn the_stated_covariance_of_places_covers() {
    for electrons in [2000.0, 20_000.0] {
        let sky = Sky::new(46);
        let (mean, standard, share, width) = offsets(&sky, electrons, 1000);
        for a in 0..2 {
            assert!(mean[a].abs() < 4.0 * standard[a] + 1e-3, "{mean:?} ± {standard:?}");
        }
        assert!((share - 0.683).abs() < 4.0 * (0.2165f64 / 1000.0).sqrt() + 0.015, "{share}");
        assert!((width / sky.fwhm_px - 1.0).abs() < 0.03, "{width}");
    }
}

/// Truth: as above, on a mosaic whose blue lets through a third of what green does: no grid draws the places, and the widths are the light's.
#[test]
fn a_mosaic_does_not_draw_the_place() {
    let sky = Sky { bayer: Some(Bayer::Grbg), through: [0.6, 1.0, 0.3], ..Sky::new(46) };
    let (mean, standard, share, width) = offsets(&sky, 30_000.0, 1000);
    for a in 0..2 {
        assert!(mean[a].abs() < 4.0 * standard[a] + 2e-3, "{mean:?} ± {standard:?}");
    }
    assert!((share - 0.683).abs() < 4.0 * (0.2165f64 / 1000.0).sqrt() + 0.02, "{share}");
    assert!((width / sky.fwhm_px - 1.0).abs() < 0.03, "{width}");
}
