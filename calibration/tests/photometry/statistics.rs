//! Bias and stated errors over many draws.

use crate::photometry::render::{Exposure, Sky};
use sunglint_calibration::photometry::{
    Aperture, Expected, FrameCalibration, FrameReducer, PhotometryOptions,
};
use sunglint_testkit::Campaign;

/// Mean of relative errors, its standard error, and how many lie within the stated standard deviation.
struct Outcome {
    bias: f64,
    standard_error: f64,
    covered: u64,
    draws: u64,
}

/// Draws of one source at this signal to noise. What the frame's own noise did inside the aperture, less its mean in the annulus, is known here, electron by
/// electron, and taken off the error (control variates: their means are 0), so that fewer draws show a small bias: what is left is how much more a median
/// scatters than a mean.
fn draw(signal_to_noise: f64, draws: u64, seed: u64) -> Outcome {
    let sky = Sky::new(46);
    let options = PhotometryOptions::new([46, 46], sky.read_noise_e);
    let mut reducer = FrameReducer::new(options, FrameCalibration::default()).unwrap();
    let mut exposure = Exposure::of(&sky, seed);
    let disc = Aperture::disc([22.3, 22.9].into(), 8.0);
    let noise2 = disc.area_px2() * (sky.sky_e + sky.read_noise_e.powi(2)) * 1.4;
    let electrons = 0.5
        * signal_to_noise.powi(2)
        * (1.0 + (1.0 + 4.0 * noise2 / signal_to_noise.powi(2)).sqrt());
    // Of a normal point, exp(−r²/2σ²) lies beyond r: 1e-5 here.
    let within = 1.0 - (-0.5 * (8.0 / sky.sigma_px()).powi(2)).exp();
    let truth = electrons * within / sky.gain_e_per_adu;
    let (mut sum, mut sum2, mut covered) = (0.0, 0.0, 0);
    for _ in 0..draws {
        exposure.again();
        let sky_only = exposure.electrons.clone();
        exposure.point(disc.centre_px[0], disc.centre_px[1], electrons);
        let target = &exposure.electrons - &sky_only;
        let frame = exposure.read();
        let plane =
            reducer.measure_at(&frame, disc.centre_px, &Expected::default()).unwrap().planes[0];
        let error = plane.rate_adu_per_s - truth;
        covered += u64::from(error.abs() <= plane.sigma.total());
        let (mut inside, mut around, mut pixels) = (0.0, 0.0, 0.0);
        for ((row, column), &adu) in frame.pixels.indexed_iter() {
            let (x, y) = (column as f64, row as f64);
            let overlap = disc.overlap(x, y);
            let annulus = (12.0..=20.0).contains(&disc.distance_px(x, y));
            if overlap == 0.0 && !annulus {
                continue;
            }
            let photons = target[[row, column]];
            // Sky, read-out and rounding, but for the target.
            let noise = (f64::from(adu) - sky.bias_adu) * sky.gain_e_per_adu - photons - sky.sky_e;
            inside += overlap * (noise + photons);
            if annulus {
                around += noise;
                pixels += 1.0;
            }
        }
        inside -= electrons * within;
        let control = (inside - disc.area_px2() * around / pixels) / sky.gain_e_per_adu;
        let rest = (error - control) / truth;
        sum += rest;
        sum2 += rest * rest;
    }
    let n = draws as f64;
    let bias = sum / n;
    Outcome { bias, standard_error: ((sum2 / n - bias * bias) / n).sqrt(), covered, draws }
}

/// Truth: sources drawn photon by photon on a Poisson sky, read out with noise and whole counts. The promise: a bias of at most 0.1 % at signal
/// to noise 5 to 500 in an aperture at a known place, and stated errors that cover 68.3 % (binomial, 4 standard deviations). The whole campaign knows the bias
/// to 0.02 % and allows nothing for that; a part of it allows 3 standard errors.
#[test]
fn campaign_aperture_bias() {
    let mut campaign = Campaign::start("aperture_bias", 100);
    let scale = campaign.seeds().end;
    let mut report = Vec::new();
    for (signal_to_noise, draws_a_seed) in [(5.0, 1300), (20.0, 100), (100.0, 20), (500.0, 4)] {
        let out = draw(signal_to_noise, draws_a_seed * scale, signal_to_noise as u64);
        report.push((signal_to_noise, out.bias, out.standard_error));
        let unknown = if scale == 100 { 0.0 } else { 3.0 * out.standard_error };
        assert!(out.bias.abs() <= 1e-3 + unknown, "{report:?}");
        assert!(scale < 100 || out.standard_error <= 2e-4, "{report:?}");
        let share = out.covered as f64 / out.draws as f64;
        let allowed = 4.0 * (0.6827 * 0.3173 / out.draws as f64).sqrt() + 0.01;
        assert!((share - 0.6827).abs() < allowed, "{signal_to_noise}: {share}");
    }
    if scale == 100 {
        for ((_, bias, error), names) in report.iter().zip([
            ["bias_at_5", "known_to_at_5"],
            ["bias_at_20", "known_to_at_20"],
            ["bias_at_100", "known_to_at_100"],
            ["bias_at_500", "known_to_at_500"],
        ]) {
            campaign.largest(names[0], *bias);
            campaign.largest(names[1], *error);
        }
    }
    eprintln!("signal to noise, bias, standard error: {report:?}");
    campaign.finish();
}
