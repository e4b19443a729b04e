//! From spectra to values.

use std::f64::consts::PI;
use sunglint_formats::fits::Fits;
use sunglint_materials::ingest::{
    AxisError, Channel, Direction, IngestError, IngestOptions, RawSpectrum, Reference,
    ReferenceKind, ingest,
};
use sunglint_materials::samples::Samples;

const SOLID_ANGLE: f64 = 2e-3;

/// Returns the reflection of the sample: reciprocal, with a band.
fn truth(nm: f64, theta_i: f64, theta_o: f64) -> f64 {
    let band = 1.0 - 0.6 * (-((nm - 850.0) / 40.0).powi(2)).exp();
    band * (0.2 / PI + 0.5 * (-((theta_i - theta_o) / 20.0).powi(2)).exp())
}

fn lamp(nm: f64) -> f64 {
    1e3 * (nm / 600.0).powi(2) * (-nm / 500.0).exp()
}

fn mirror(nm: f64) -> f64 {
    0.9 + 1e-4 * (nm - 600.0) / 6.0
}

/// A detector's response and its dark signal.
fn response(infrared: bool, nm: f64) -> (f64, f64) {
    if infrared {
        (0.4 + nm / 4000.0, 3.0)
    } else {
        ((-((nm - 600.0) / 250.0).powi(2)).exp(), 7.0 + nm / 500.0)
    }
}

/// A spectrum on the detector's own axis: nm by 1.3, or cm⁻¹ falling.
fn record(infrared: bool, light: impl Fn(f64) -> f64, gain: f64) -> RawSpectrum {
    let axis: Vec<f64> = if infrared {
        (0..1200).map(|k| 13_400.0 - 5.0 * f64::from(k)).collect()
    } else {
        (0..480).map(|k| 400.0 + 1.3 * f64::from(k)).collect()
    };
    let nm = |x: &f64| if infrared { 1e7 / x } else { *x };
    let y: Vec<f64> = axis
        .iter()
        .map(|x| {
            let (seen, dark) = response(infrared, nm(x));
            gain * seen * light(nm(x)) + dark
        })
        .collect();
    RawSpectrum::new(&axis, &y, infrared).unwrap()
}

fn channels() -> Vec<Channel> {
    [("vis", false, (405.0, 950.0)), ("ir", true, (780.0, 1300.0))]
        .map(|(name, infrared, range_nm)| Channel {
            name: name.into(),
            range_nm,
            reference: record(infrared, |nm| lamp(nm) * mirror(nm), 1.0),
            reference_dark: Some(record(infrared, |_| 0.0, 1.0)),
        })
        .to_vec()
}

fn reference() -> Reference {
    let nm: Vec<f64> = (0..100).map(|k| 350.0 + 10.0 * f64::from(k)).collect();
    let r: Vec<f64> = nm.iter().map(|nm| mirror(*nm)).collect();
    let reflectance = RawSpectrum::new(&nm, &r, false).unwrap();
    Reference { kind: ReferenceKind::Mirror, reflectance, theta_o_deg: 0.0 }
}

fn direction(theta_i: f64, theta_o: f64, drift: f64) -> Direction {
    let cos = theta_o.to_radians().cos();
    let light = move |nm: f64| lamp(nm) * truth(nm, theta_i, theta_o) * SOLID_ANGLE * cos;
    let signal = [false, true]
        .map(|infrared| {
            let gain = if infrared { drift } else { 1.0 };
            Some((record(infrared, light, gain), Some(record(infrared, |_| 0.0, 1.0))))
        })
        .to_vec();
    Direction { angles_deg: [theta_i, 0.0, theta_o, 180.0], scale: 1.0, signal }
}

fn options() -> IngestOptions {
    IngestOptions {
        wavelength_nm: (0..169).map(|k| 410.0 + 5.0 * f64::from(k)).collect(),
        solid_angle_sr: SOLID_ANGLE,
        scale_sigma: 0.02,
        stitch: true,
        warn_scale: 0.05,
        warn_reciprocity: 0.05,
    }
}

/// Truth: f is put in, and a lamp, a mirror, two detectors with responses and dark signals of their own, one in cm⁻¹ falling and 12 % too bright: it
/// comes out at every wavelength. Tolerance: 2.5e-3, a mean over 5 nm across a band of 40 nm (8e-4) and its two slopes; the scale 1e-3.
#[test]
fn what_was_put_in_comes_out() {
    let directions =
        [direction(30.0, 10.0, 1.12), direction(10.0, 30.0, 1.0), direction(45.0, 45.0, 1.0)];
    let done = ingest(&channels(), &reference(), &directions, &options()).unwrap();
    for (row, d) in done.samples.rows.iter().zip(&directions) {
        for (nm, f) in done.samples.wavelength_nm.iter().zip(&row.brdf_per_sr) {
            let expected = truth(*nm, d.angles_deg[0], d.angles_deg[2]);
            assert!((f / expected - 1.0).abs() < 2.5e-3, "{nm}: {f} for {expected}");
        }
    }
    assert_eq!(done.seams.len(), 3);
    assert!((done.seams[0].scale * 1.12 - 1.0).abs() < 1e-3, "{:?}", done.seams[0]);
    assert!(
        done.warnings.iter().any(|w| w.contains("ir was scaled by 0.89")),
        "{:?}",
        done.warnings
    );
    // Swapped: the truth is reciprocal.
    assert_eq!(done.pairs.len(), 1);
    assert!((done.pairs[0].ratio - 1.0).abs() < 1e-3);
    // Through files of both kinds.
    let there = Samples::from_table("s.ecsv", &done.samples.to_table(), None).unwrap();
    assert_eq!(there.rows, done.samples.rows);
    let fits = Fits::from_bytes("s.fits", done.samples.to_fits().unwrap()).unwrap();
    let there = Samples::from_fits(&fits).unwrap();
    assert_eq!((there.rows, there.wavelength_nm), (done.samples.rows, done.samples.wavelength_nm));
}

/// Truth: the same f; 1 % of white noise on each value, of which the stated standard deviations hold 68 % (tolerance: 60 to 78 % of 169 wavelengths of 3 directions).
#[test]
fn noise_is_stated() {
    use rand::{RngExt as _, SeedableRng as _};
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(3);
    let mut noisy = |raw: &RawSpectrum, sigma: f64| {
        let mut one = || {
            (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt()
                * (2.0 * PI * rng.random::<f64>()).cos()
        };
        let y: Vec<f64> = raw.y.iter().map(|y| y + sigma * one()).collect();
        RawSpectrum::new(&raw.nm, &y, false).unwrap()
    };
    let mut directions =
        [direction(30.0, 10.0, 1.0), direction(10.0, 30.0, 1.0), direction(45.0, 45.0, 1.0)];
    for d in &mut directions {
        for (light, _) in d.signal.iter_mut().flatten() {
            *light = noisy(light, 1e-3);
        }
    }
    let one = IngestOptions { stitch: false, ..options() };
    let done = ingest(&channels(), &reference(), &directions, &one).unwrap();
    let clean =
        [direction(30.0, 10.0, 1.0), direction(10.0, 30.0, 1.0), direction(45.0, 45.0, 1.0)];
    let clean = ingest(&channels(), &reference(), &clean, &one).unwrap();
    let (mut inside, mut all) = (0.0, 0.0);
    for (row, truth) in done.samples.rows.iter().zip(&clean.samples.rows) {
        for k in 0..row.brdf_per_sr.len() {
            all += 1.0;
            let off = (row.brdf_per_sr[k] - truth.brdf_per_sr[k]).abs();
            inside += f64::from(u8::from(off < row.sigma_per_sr[k]));
        }
    }
    let share = inside / all;
    assert!((0.6..0.78).contains(&share), "{share}");
}

/// Truth: the definition: a Lambert standard seen as it is itself is ρ/π.
#[test]
fn a_lambert_standard() {
    let standard = Reference {
        kind: ReferenceKind::Lambert,
        reflectance: RawSpectrum::constant(0.98),
        theta_o_deg: 30.0,
    };
    let nm: Vec<f64> = (0..300).map(|k| 400.0 + 2.0 * f64::from(k)).collect();
    let light = |cos: f64| {
        RawSpectrum::new(&nm, &nm.iter().map(|nm| cos * lamp(*nm)).collect::<Vec<_>>(), false)
            .unwrap()
    };
    let channel = Channel {
        name: "a".into(),
        range_nm: (400.0, 900.0),
        reference: light(30_f64.to_radians().cos()),
        reference_dark: None,
    };
    let seen = Direction {
        angles_deg: [0.0, 0.0, 60.0, 0.0],
        scale: 1.0,
        signal: vec![Some((light(0.5), None))],
    };
    let done = ingest(&[channel], &standard, &[seen], &options());
    let done = done.unwrap();
    for (nm, f) in done.samples.wavelength_nm.iter().zip(&done.samples.rows[0].brdf_per_sr) {
        assert!(*nm > 990.0 || (f * PI / 0.98 - 1.0).abs() < 1e-9 || f.is_nan(), "{nm}: {f}");
    }
    assert!(done.warnings.iter().any(|w| w.contains("have no data")));
}

#[test]
fn what_is_wrong_is_said() {
    let nm: Vec<f64> = (0..50).map(|k| 400.0 + f64::from(k)).collect();
    let y = vec![1.0; 50];
    let mut turned = nm.clone();
    turned[20] = 410.0;
    assert!(matches!(RawSpectrum::new(&turned, &y, false), Err(AxisError::Order { row: 20, .. })));
    let mut gap = nm.clone();
    gap.iter_mut().skip(30).for_each(|x| *x += 10.0);
    assert!(matches!(RawSpectrum::new(&gap, &y, false), Err(AxisError::Gap { row: 30, .. })));
    let mut none = y.clone();
    none[7] = f64::NAN;
    assert!(matches!(RawSpectrum::new(&nm, &none, false), Err(AxisError::Number { row: 7, .. })));
    // A reference that is darker than the dark, detectors that do not meet, a contradiction between swapped directions.
    let good = [direction(30.0, 10.0, 1.0)];
    let mut dark = channels();
    dark[0].reference_dark = Some(record(false, lamp, 2.0));
    let refused =
        |c: &[Channel], d: &[Direction]| ingest(c, &reference(), d, &options()).unwrap_err();
    assert!(matches!(refused(&dark, &good), IngestError::Dark { .. }));
    let mut apart = channels();
    apart[0].range_nm = (405.0, 700.0);
    assert!(matches!(refused(&apart, &good), IngestError::NoOverlap { .. }));
    let mut twice = [direction(30.0, 10.0, 1.0), direction(10.0, 30.0, 1.0)];
    twice[1].scale = 1.4;
    let done = ingest(&channels(), &reference(), &twice, &options()).unwrap();
    assert!(
        done.warnings.iter().any(|w| w.contains("swapped and differ by a factor of 0.714")),
        "{:?}",
        done.warnings
    );
}

/// Truth: by hand. A signal of 1.5 times the beam is 1.5 times the mirror's reflectance, which is 0.95, of the light; a beam cut at a level is flat there, and a smooth one is not, also where it is rounded.
#[test]
fn more_light_than_the_beam_and_flat_tops_are_noticed() {
    let nm: Vec<f64> = (0..200).map(|k| 400.0 + 2.0 * f64::from(k)).collect();
    let spectrum = |of: &dyn Fn(f64) -> f64| {
        let y: Vec<f64> = nm.iter().map(|nm| of(*nm)).collect();
        let raw = RawSpectrum::new(&nm, &y, false).unwrap();
        RawSpectrum { file: Some("made.csv".into()), ..raw }
    };
    let beam = |nm: f64| 1000.0 * (-((nm - 600.0) / 150.0).powi(2)).exp();
    let done = |signal: RawSpectrum| {
        let channels = [Channel {
            name: "si".into(),
            range_nm: (420.0, 780.0),
            reference: spectrum(&beam),
            reference_dark: None,
        }];
        let reference = Reference {
            kind: ReferenceKind::Mirror,
            reflectance: RawSpectrum::constant(0.95),
            theta_o_deg: 0.0,
        };
        let signal = vec![Some((signal, None))];
        let angles_deg = [30.0, 0.0, 60.0, 180.0];
        let directions = [Direction { angles_deg, scale: 1.0, signal }];
        let options = IngestOptions {
            wavelength_nm: vec![500.0, 600.0, 700.0],
            scale_sigma: 0.0,
            ..options()
        };
        ingest(&channels, &reference, &directions, &options).unwrap().warnings
    };
    assert_eq!(done(spectrum(&|nm| 0.9 * beam(nm))), Vec::<String>::new());
    assert_eq!(done(spectrum(&|nm| (0.03 * beam(nm)).round())), Vec::<String>::new());
    let said = done(spectrum(&|nm| 1.5 * beam(nm)));
    assert!(said[0].contains("made.csv") && said[0].contains("1.4250 times"), "{said:?}");
    let said = done(spectrum(&|nm| (0.9 * beam(nm)).min(600.0)));
    assert!(said.len() == 1 && said[0].contains("made.csv") && said[0].contains("600"), "{said:?}");
    let said = done(spectrum(&|_| 65_535.0));
    assert!(said.iter().any(|w| w.contains("all its values are 65535")), "{said:?}");
}

/// Truth: by hand. Three records of one direction at 0.9, 1 and 1.1 of it are their median, with a scatter of 10 % and σ = 10 % √(π/2)/√3 of it; another direction keeps its number. A whole turn more
/// is the same azimuth.
#[test]
fn a_direction_that_was_measured_thrice_is_its_median() {
    let mut all = vec![direction(30.0, 10.0, 1.0), direction(20.0, 5.0, 1.0)];
    let once = ingest(&channels(), &reference(), &all, &options()).unwrap();
    assert!(once.repeats.is_empty());
    all.extend([direction(30.0, 10.0, 1.0), direction(30.0, 10.0, 1.0)]);
    (all[0].scale, all[2].scale) = (0.9, 1.1);
    all[3].angles_deg[3] += 360.0;
    all.push(direction(10.0, 30.0, 1.0));
    let done = ingest(&channels(), &reference(), &all, &options()).unwrap();
    let [repeat] = &done.repeats[..] else { panic!("{:?}", done.repeats) };
    assert_eq!(repeat.directions, [1, 3, 4]);
    assert!((repeat.scatter - 0.1).abs() < 1e-3, "{}", repeat.scatter);
    assert_eq!(done.samples.rows.len(), 3);
    let (f, truth) = (done.samples.rows[0].brdf_per_sr[0], once.samples.rows[0].brdf_per_sr[0]);
    assert!((f / truth - 1.0).abs() < 1e-9, "{f} {truth}");
    let sigma = done.samples.rows[0].sigma_per_sr[0] / f;
    assert!((sigma * (6.0 / std::f64::consts::PI).sqrt() - 0.1).abs() < 1e-3, "{sigma}");
    assert_eq!(done.pairs[0].directions, [1, 5]);
    let said = done.warnings.iter().find(|w| w.contains("are the same one")).unwrap();
    assert!(said.contains("directions 1, 3, 4") && said.contains("scatter by 10.0"), "{said}");
}
