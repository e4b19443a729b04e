//! Pictures of points of light.

use super::moments;
use sunglint_formats::Bayer;
use sunglint_virtual::observatory::frame::{
    CosmicRays, Exposure, PixelFaults, PointSpread, Scene, Sensor, Sky, Source, Streak, streak,
};
use sunglint_virtual::observatory::random::{Purpose, stream};

const EXPOSURE: Exposure =
    Exposure { origin_px: [600, 420], size_px: [200, 200], binning: [1, 1], exposure_s: 1.0 };

fn sensor() -> Sensor {
    Sensor {
        size_px: [1391, 1039],
        bayer: None,
        gain_e_per_adu: 0.27,
        read_noise_e: 4.0,
        full_well_e: 18_000.0,
        adc_bits: 16,
        dark_e_per_s: 0.0,
        bias_adu: 300.0,
        faults: PixelFaults::default(),
        seed: 1,
    }
}

fn expected(sensor: &Sensor, scene: &Scene<'_>) -> Vec<f64> {
    sensor.expected_e(&sensor.pattern(&EXPOSURE), &EXPOSURE, scene)
}

/// Truth: the normal distribution. Within ±k whole pixels of a point in a pixel's middle there is erf((k+½)/√2σ)² of the light, and 2e-5 may be
/// left out far away.
#[test]
fn a_gaussian_has_its_energy() {
    let sigma = 1.7;
    let spread = PointSpread::Gaussian { fwhm_px: sigma * 2.354_820_045_030_949_4 };
    let source = [Source::still([1.0; 3], [700.0, 500.0])];
    let picture = expected(&sensor(), &Scene { sources: &source, spread, ..Scene::DARK });
    for k in [0, 1, 3, 6] {
        let mut sum = 0.0;
        for row in 80 - k..=80 + k {
            sum += picture[row * 200 + 100 - k..=row * 200 + 100 + k].iter().sum::<f64>();
        }
        let truth = libm::erf((k as f64 + 0.5) / (sigma * 2_f64.sqrt())).powi(2);
        assert!((sum - truth).abs() < 3e-5, "{k}: {sum} {truth}");
    }
    assert!((picture.iter().sum::<f64>() - 1.0).abs() < 2e-5);
}

/// Truth: a Moffat profile has 1 − (1+R²/α²)^(1−β) of its light within R, FWHM = 2α√(2^(1/β)−1). Single
/// pixels against sums over 400 × 400 parts. The frame is promised to 2e-5.
#[test]
fn a_moffat_has_its_energy() {
    for (fwhm_px, beta) in [(1.2, 3.0), (3.0, 2.5), (4.0, 4.765)] {
        let alpha = fwhm_px / 2.0 / (2_f64.powf(1.0 / beta) - 1.0).sqrt();
        let spread = PointSpread::Moffat { fwhm_px, beta };
        let at = [700.31, 500.77];
        // A pixel beside the peak, by brute force.
        let density = |x: f64, y: f64| {
            (beta - 1.0) / (std::f64::consts::PI * alpha * alpha)
                * (1.0 + (x * x + y * y) / (alpha * alpha)).powf(-beta)
        };
        for (column, row) in [(700.0, 501.0), (702.0, 499.0), (709.0, 500.0)] {
            let mut sum = 0.0;
            for i in 0..400 {
                for j in 0..400 {
                    let within = |i: i32| (f64::from(i) + 0.5) / 400.0 - 0.5;
                    let (x, y) = (column + within(i) - at[0], row + within(j) - at[1]);
                    sum += density(x, y) / 160_000.0;
                }
            }
            let found = spread.on_pixel([700.31, 500.77], column, row);
            assert!((found - sum).abs() < 2e-5, "{fwhm_px} {beta}: {found} {sum}");
        }
        let source = [Source::still([1.0; 3], at)];
        let picture = expected(&sensor(), &Scene { sources: &source, spread, ..Scene::DARK });
        // Pixels whose middle is within R: beyond ten widths the cut pixels' parts cancel to 1e-4 of what they hold.
        let radius = 10.0 * fwhm_px;
        let mut sum = 0.0;
        for (i, light) in picture.iter().enumerate() {
            let (x, y) = ((i % 200) as f64 + 600.0 - at[0], (i / 200) as f64 + 420.0 - at[1]);
            sum += if x.hypot(y) < radius { *light } else { 0.0 };
        }
        let truth = 1.0 - (1.0 + (radius / alpha).powi(2)).powf(1.0 - beta);
        assert!((sum - truth).abs() < 1e-4, "{fwhm_px} {beta}: {sum} {truth}");
    }
}

/// Truth: the photon transfer curve (Janesick 2001): of flat frames the variance in ADU is (R² + e)/g² with the mean e/g above the bias, a straight line whose
/// slope is 1/g and whose intercept R²/g² (and 1/12 of the rounding). 40,000 pixels: variances to 0.7 %, five sigma.
#[test]
fn the_photon_transfer_curve_gives_gain_and_read_noise() {
    let sensor = sensor();
    let frame = |e_per_s: f64, number: u64| {
        let sky = Sky { e_per_s: [e_per_s; 3], gradient_per_px: [0.0; 2].into() };
        let frame = sensor.render(&EXPOSURE, &Scene { sky, ..Scene::DARK }, 7, number);
        moments(&frame.iter().map(|adu| f64::from(*adu) - 300.0).collect::<Vec<_>>())
    };
    let (dark_mean, dark_variance) = frame(0.0, 0);
    let noise = (4.0_f64 / 0.27).powi(2) + 1.0 / 12.0;
    assert!(dark_mean.abs() < 5.0 * (noise / 40_000.0).sqrt());
    assert!((dark_variance / noise - 1.0).abs() < 0.036, "{dark_variance} {noise}");
    for (number, e) in [(1, 5.0), (2, 50.0), (3, 2000.0), (4, 12_000.0)] {
        let (mean, variance) = frame(e, number);
        assert!((mean * 0.27 - e).abs() < 5.0 * ((e + 16.0) / 40_000.0).sqrt(), "{mean} {e}");
        let gain = mean / (variance - noise);
        let error = 5.0 * (2.0 / 40_000.0_f64).sqrt() * (1.0 + 16.0 / e);
        assert!((gain / 0.27 - 1.0).abs() < 1.5 * error, "{gain}");
    }
}

/// Truth: arithmetic. A full pixel stands at 300 + 18000/0.27 ADU = 66967, which 16 bits end at 65535; with 0.5 e/ADU at 36300 and no more;
/// 12 bits end at 4095.
#[test]
fn full_wells_and_converters_end() {
    let sky = Sky { e_per_s: [1e6; 3], gradient_per_px: [0.0; 2].into() };
    let scene = Scene { sky, ..Scene::DARK };
    let quiet = Sensor { read_noise_e: 0.0, ..sensor() };
    let all = |sensor: Sensor, adu: u16| {
        assert!(sensor.render(&EXPOSURE, &scene, 1, 1).iter().all(|pixel| *pixel == adu));
    };
    all(quiet, 65_535);
    all(Sensor { gain_e_per_adu: 0.5, ..quiet }, 36_300);
    all(Sensor { adc_bits: 12, ..quiet }, 4_095);
}

/// Truth: a mosaic has one red, two green and one blue pixel of four. With a point spread of many pixels the planes' sums are a quarter, a half and a quarter
/// of the source: to the 1e-3 that aliasing leaves at 6 px.
#[test]
fn planes_are_parts_of_the_light() {
    for bayer in [Bayer::Rggb, Bayer::Gbrg, Bayer::Bggr, Bayer::Grbg] {
        let sensor = Sensor { bayer: Some(bayer), ..sensor() };
        let source = [Source::still([100.0, 200.0, 400.0], [699.4, 520.2])];
        let spread = PointSpread::Gaussian { fwhm_px: 6.0 };
        let picture = expected(&sensor, &Scene { sources: &source, spread, ..Scene::DARK });
        let mut sums = [0.0; 3];
        for (i, light) in picture.iter().enumerate() {
            let name = bayer.name().as_bytes()[i / 200 % 2 * 2 + i % 2];
            sums["RGB".bytes().position(|c| c == name).unwrap()] += light;
        }
        for (sum, truth) in sums.iter().zip([25.0, 100.0, 100.0]) {
            assert!((sum / truth - 1.0).abs() < 1e-3, "{bayer:?} {sums:?}");
        }
    }
}

/// Truth: geometry. A trail has the light of its source, evenly along its length: its middle third holds a third, its middle line is where it was asked for.
#[test]
fn a_trail_is_even() {
    let spread = PointSpread::Gaussian { fwhm_px: 3.0 };
    let source = [Source::trailed([3000.0; 3], [640.0, 500.0], [760.0, 530.0], &spread)];
    let picture = expected(&sensor(), &Scene { sources: &source, spread, ..Scene::DARK });
    let third: f64 =
        (0..200).map(|row| picture[row * 200 + 80..row * 200 + 120].iter().sum::<f64>()).sum();
    assert!((picture.iter().sum::<f64>() / 3000.0 - 1.0).abs() < 1e-3);
    assert!((third / 1000.0 - 1.0).abs() < 5e-3, "{third}");
    let (mut sum, mut moment) = (0.0, 0.0);
    for row in 0..200 {
        sum += picture[row * 200 + 100];
        moment += picture[row * 200 + 100] * (row as f64 + 420.0);
    }
    assert!((moment / sum - 515.0).abs() < 0.02);
}

/// Truth: the sensor has its faults, not the frame: another window shows the same pixels' faults. Fractions binomial, five sigma of 40,000 pixels.
#[test]
fn faults_belong_to_pixels() {
    let faults = PixelFaults {
        response_scatter: 0.01,
        hot_fraction: 0.01,
        hot_e_per_s: 500.0,
        cold_fraction: 0.005,
        dead_fraction: 0.002,
    };
    let sensor = Sensor { faults, ..sensor() };
    let pattern = sensor.pattern(&EXPOSURE);
    let hot = (0..40_000).filter(|i| pattern.pixel(*i).1 > 0.0).count() as f64;
    let dead = (0..40_000).filter(|i| pattern.pixel(*i).0 == 0.0).count() as f64;
    assert!((hot - 400.0).abs() < 5.0 * 20.0 && (dead - 80.0).abs() < 5.0 * 9.0, "{hot} {dead}");
    let shifted = Exposure { origin_px: [610, 425], ..EXPOSURE };
    let other = sensor.pattern(&shifted);
    assert!(pattern.fits(&EXPOSURE) && !pattern.fits(&shifted));
    for (row, column) in (0..190).flat_map(|row| (0..190).map(move |column| (row, column))) {
        assert_eq!(other.pixel(row * 200 + column), pattern.pixel((row + 5) * 200 + column + 10));
    }
}

/// Truth: the number of rays is Poisson of what was asked for, their charge above the sky; a streak that always comes crosses the picture.
#[test]
fn rays_and_streaks_come_as_often_as_asked() {
    let cosmic_rays = CosmicRays { per_mpx_s: 50.0, length_px: 3.0, e_per_px: 2000.0 };
    let scene = Scene { cosmic_rays, ..Scene::DARK };
    let quiet = Sensor { read_noise_e: 0.0, ..sensor() };
    let hit = (0..200)
        .filter(|number| quiet.render(&EXPOSURE, &scene, 3, *number).iter().any(|adu| *adu > 300));
    // Each frame expects two rays: e^(−2) of the frames have none.
    let (without, expected) = (200.0 - hit.count() as f64, 200.0 * (-2.0_f64).exp());
    assert!((without - expected).abs() < 5.0 * expected.sqrt(), "{without} {expected}");
    let spread = PointSpread::Gaussian { fwhm_px: 3.0 };
    let often = Streak { per_s: 1e3, e_per_px: 500.0 };
    for number in 0..20 {
        let mut random = stream(1, Purpose::Passing, number);
        let source = [streak(&often, &EXPOSURE, &spread, &mut random).unwrap()];
        let picture = expected_of(&source, spread);
        let edge = |i: &usize| matches!(i % 200, 0 | 199) || matches!(i / 200, 0 | 199);
        let bright = (0..40_000).filter(edge).filter(|i| picture[*i] > 1.0).count();
        assert!(bright >= 2, "{number}");
    }
    let never = Streak { per_s: 0.0, e_per_px: 500.0 };
    assert_eq!(streak(&never, &EXPOSURE, &spread, &mut stream(1, Purpose::Passing, 0)), None);
}

fn expected_of(sources: &[Source], spread: PointSpread) -> Vec<f64> {
    expected(&sensor(), &Scene { sources, spread, ..Scene::DARK })
}

/// Truth: sums by hand. A binned frame's pixels hold four pixels' charge, with one read noise; equal numbers give equal frames, others do not.
#[test]
fn binning_sums_charge_and_numbers_name_frames() {
    let binned = Exposure { binning: [2, 2], ..EXPOSURE };
    let sky = Sky { e_per_s: [100.0; 3], gradient_per_px: [0.0; 2].into() };
    let scene = Scene { sky, ..Scene::DARK };
    let frame = sensor().render(&binned, &scene, 1, 1);
    assert_eq!(frame.dim(), (100, 100));
    let adu: Vec<f64> = frame.iter().map(|adu| (f64::from(*adu) - 300.0) * 0.27).collect();
    let (mean, variance) = moments(&adu);
    assert!((mean - 400.0).abs() < 5.0 * 0.204 && (variance / 416.0 - 1.0).abs() < 0.071);
    assert_eq!(frame, sensor().render(&binned, &scene, 1, 1));
    assert_ne!(frame, sensor().render(&binned, &scene, 1, 2));
    assert_ne!(frame, sensor().render(&binned, &scene, 2, 1));
}
