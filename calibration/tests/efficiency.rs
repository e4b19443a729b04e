//! Efficiencies: photons one by one, the propagation by hand, hard cases.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use sunglint_calibration::detector::Linearity;
use sunglint_calibration::efficiency::*;
use sunglint_radiometry::station::DeadTime;

fn table(name: &str, points: &[(f64, f64)], relative_sigma: f64) -> Factor {
    let (nm, value) = points.iter().copied().unzip();
    Factor { name: name.into(), value: Lookup::new(name, nm, value).unwrap(), relative_sigma }
}

fn aperture(area_mm2: f64, distance_mm: f64) -> Aperture {
    Aperture { area_mm2, area_relative_sigma: 0.01, distance_mm, distance_sigma_mm: 0.5 }
}

fn set(readings: Vec<Reading>) -> Set {
    Set {
        readings,
        photodiode: Photodiode {
            responsivity: table("responsivity", &[(400.0, 0.1), (1100.0, 0.6)], 0.02),
            extrapolation: None,
            load_ohm: 1e6,
            load_relative_sigma: 0.005,
            aperture: aperture(100.0, 200.0),
        },
        towards_photodiode: vec![table("splitter", &[(300.0, 0.6), (1200.0, 0.8)], 0.01)],
        towards_sensor: vec![
            table("splitter", &[(300.0, 0.35), (1200.0, 0.15)], 0.01),
            Factor::constant("filter", 1e-3, 0.03).unwrap(),
        ],
        wavelength_sigma_nm: 0.0,
    }
}

fn sensor(dead_time_s: f64) -> Sensor {
    let linearity = Linearity::new(&DeadTime::NonParalysable { dead_time_s }).unwrap();
    let counting = Counting::Counter { linearity, dead_time_relative_sigma: 0.02 };
    Sensor { counting, aperture: aperture(0.01, 250.0) }
}

const PLANCK: f64 = 6.626_070_15e-34;
const LIGHT: f64 = 299_792_458.0;

/// Voltage of the photodiode and photons a second on the sensor of a monochromator's line of so many W sr⁻¹.
fn split(nm: f64, intensity_w_sr: f64) -> (f64, f64) {
    let line = |from: (f64, f64), to: (f64, f64)| {
        from.1 + (to.1 - from.1) * (nm - from.0) / (to.0 - from.0)
    };
    let diode_w = intensity_w_sr * 100.0 / 200.0_f64.powi(2) * line((300.0, 0.6), (1200.0, 0.8));
    let volts = diode_w * line((400.0, 0.1), (1100.0, 0.6)) * 1e6;
    let through = line((300.0, 0.35), (1200.0, 0.15)) * 1e-3;
    let sensor_w = intensity_w_sr * 0.01 / 250.0_f64.powi(2) * through;
    (volts, sensor_w / (PLANCK * LIGHT / (nm * 1e-9)))
}

struct Chance(u64);

impl Chance {
    /// SplitMix64, in (0, 1].
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (((z ^ (z >> 31)) >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }

    /// Counts of a detector that is deaf for a time after each: photons one by one, each detected with the probability η, dark pulses besides.
    fn counts(&mut self, rate_hz: f64, exposure_s: f64, dead_time_s: f64) -> f64 {
        let (mut time, mut free, mut counts) = (0.0, 0.0, 0);
        loop {
            time -= self.next().ln() / rate_hz;
            if time > exposure_s {
                return f64::from(counts);
            }
            if time >= free {
                counts += 1;
                free = time + dead_time_s;
            }
        }
    }
}

fn efficiency(nm: f64) -> f64 {
    0.35 * (-((nm - 700.0) / 180.0).powi(2)).exp()
}

/// Truth: photon events from a known η, a light of 1e-3 W sr⁻¹ that makes 5 to 54 kHz in a detector with 2 µs dead time and 800 Hz in the dark. Tolerance: χ² of 41 wavelengths by the
/// stated uncertainty of counting alone below its 99.9 % point (74.7); a loss to dead time left in would be 10 %. Wavelengths come in disorder.
#[test]
fn photon_events_give_their_efficiency() {
    let mut chance = Chance(7);
    let dead_time_s = 2e-6;
    let mut readings = Vec::new();
    for k in 0..41 {
        let nm = 500.0 + 10.0 * f64::from((k * 17) % 41);
        let (photodiode_v, photons_hz) = split(nm, 1e-3);
        let rate = photons_hz * efficiency(nm) + 800.0;
        readings.push(Reading {
            wavelength_nm: nm,
            photodiode_v: photodiode_v + 0.002,
            photodiode_dark_v: 0.002,
            sigma_v: 0.0,
            counts: chance.counts(rate, 2.0, dead_time_s),
            exposure_s: 2.0,
            dark_counts: chance.counts(800.0, 4.0, dead_time_s),
            dark_exposure_s: 4.0,
            ..Reading::default()
        });
    }
    let found = reduce(&[set(readings)], &sensor(dead_time_s)).unwrap();
    assert!(found.rows.windows(2).all(|pair| pair[1].wavelength_nm > pair[0].wavelength_nm));
    let mut chi2 = 0.0;
    let mut most_hz = 0.0_f64;
    for row in &found.rows {
        chi2 += ((row.efficiency - efficiency(row.wavelength_nm)) / row.components.counts).powi(2);
        most_hz = most_hz.max(row.rate_hz);
    }
    assert!(chi2 < 74.7 && chi2 > 15.0, "{chi2}");
    assert!(most_hz > 5e4, "{most_hz}: the dead time is not tried");
    // A station reads the curve.
    let (text, out) = to_curve(&found, "a detector");
    assert!(out.is_empty());
    let curve = sunglint_formats::curve::read_str("e.csv", &text, None).unwrap();
    assert_eq!((curve.x.len(), curve.y_name.as_str()), (41, "efficiency"));
}

/// Truth: eq. 4.8 of the thesis and the propagation of its factors, by hand: relative uncertainties add in squares, a distance counts twice, photons as √N. Tolerance: rounding, and 1e-3
/// where a dead time of 1 ns enters.
#[test]
fn uncertainties_are_those_of_the_factors() {
    let nm = 600.0;
    let (volts, photons_hz) = split(nm, 1e-5);
    let reading = Reading {
        wavelength_nm: nm,
        photodiode_v: volts,
        sigma_v: 0.01 * volts,
        counts: 40_000.0,
        exposure_s: 1.0,
        dark_counts: 900.0,
        dark_exposure_s: 1.0,
        ..Reading::default()
    };
    let one = &reduce(&[set(vec![reading])], &sensor(1e-9)).unwrap().rows[0];
    assert!((one.photons_hz / photons_hz - 1.0).abs() < 1e-12);
    let eta = 39_100.0 / photons_hz;
    assert!((one.efficiency / eta - 1.0).abs() < 1e-4);
    let c = one.components;
    let near = |found: f64, relative: f64| {
        assert!((found / (relative * eta) - 1.0).abs() < 1e-3, "{found} {relative}")
    };
    near(c.counts, 40_900_f64.sqrt() / 39_100.0);
    near(c.photodiode, 0.01);
    near(c.responsivity, 0.02);
    near(c.load, 0.005);
    near(c.transmissions, (0.01_f64.powi(2) * 2.0 + 0.03_f64.powi(2)).sqrt());
    let distances = (1.0_f64 / 200.0).powi(2) + (1.0_f64 / 250.0).powi(2);
    near(c.geometry, (2.0 * 0.01_f64.powi(2) + distances).sqrt());
    let all =
        [c.counts, c.photodiode, c.responsivity, c.load, c.transmissions, c.geometry, c.linearity];
    let all = all.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((c.total() / all - 1.0).abs() < 1e-12);
    // Ten times the same reading: what each has for itself shrinks by √10, the rest stays.
    let ten = &reduce(&[set(vec![reading; 10])], &sensor(1e-9)).unwrap().rows[0];
    assert!((ten.components.own() * 10_f64.sqrt() / c.own() - 1.0).abs() < 1e-9);
    assert_eq!((ten.readings, ten.components.responsivity), (10, c.responsivity));
    // A camera: electrons.
    let counting = Counting::Camera {
        gain_e_per_adu: 0.5,
        gain_relative_sigma: 0.01,
        saturation_adu: 65_535.0,
    };
    let camera = Sensor { counting, ..sensor(0.0) };
    let adu = &reduce(&[set(vec![reading])], &camera).unwrap().rows[0];
    assert!((adu.efficiency / (0.5 * eta) - 1.0).abs() < 1e-12);
    assert!((adu.components.linearity / adu.efficiency - 0.01).abs() < 1e-3);
    // A wavelength that is off by 2 nm, where photons a volt are λ T_s/(T_pd ζ): d ln by hand.
    let mut off = set(vec![reading]);
    off.wavelength_sigma_nm = 2.0;
    let found = &reduce(&[off], &sensor(1e-9)).unwrap().rows[0];
    let per_nm = 1.0 / nm + (-0.2 / 900.0) / (0.35 - 0.2 / 3.0)
        - (0.2 / 900.0) / (0.6 + 0.2 / 3.0)
        - (0.5 / 700.0) / (0.1 + 1.0 / 7.0);
    near(found.components.wavelength, 2.0 * per_nm.abs());
}

/// Truth by hand: of a rig that gives 3 % more since its begin the efficiency is that over 1.03, with all its parts, and the uncertainty of the change is of that. A change to nothing cannot be.
#[test]
fn a_drift_is_undone() {
    let (photodiode_v, _) = split(600.0, 1e-5);
    let calm = Reading {
        wavelength_nm: 600.0,
        photodiode_v,
        counts: 40_000.0,
        exposure_s: 1.0,
        dark_exposure_s: 1.0,
        ..Reading::default()
    };
    let drifted =
        Reading { drift_relative: 0.03, sigma_drift_relative: 0.01, drift_step: true, ..calm };
    let of = |r| reduce(&[set(vec![r])], &sensor(1e-7)).map(|found| found.rows[0].clone());
    let (calm, found) = (of(calm).unwrap(), of(drifted).unwrap());
    let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    near(found.efficiency, calm.efficiency / 1.03);
    near(found.components.drift, 0.01 * calm.efficiency / 1.03);
    near(found.components.counts, calm.components.counts / 1.03);
    near(found.components.linearity, calm.components.linearity / 1.03);
    near(found.photons_hz, calm.photons_hz);
    assert!(found.flags.contains(EfficiencyFlags::DRIFT_STEP) && calm.components.drift == 0.0);
    let error = of(Reading { drift_relative: -1.0, ..drifted }).unwrap_err().to_string();
    assert!(error.contains("drift_relative"), "{error}");
}

/// Hard cases: what has no efficiency says why, what is above 1 stands there; other rows are untouched.
#[test]
fn what_is_no_efficiency_says_why() {
    let good = |nm: f64| {
        let (photodiode_v, photons) = split(nm, 1e-5);
        Reading {
            wavelength_nm: nm,
            photodiode_v,
            sigma_v: 1e-3 * photodiode_v,
            counts: (photons * 0.2).round() + 500.0,
            exposure_s: 1.0,
            dark_counts: 500.0,
            dark_exposure_s: 1.0,
            ..Reading::default()
        }
    };
    let mut readings: Vec<Reading> = (0..10).map(|k| good(500.0 + 20.0 * f64::from(k))).collect();
    readings[1].photodiode_v = 0.0;
    readings[2].photodiode_v = -1e-3;
    readings[3].counts = f64::NAN;
    readings[4].counts *= 8.0;
    readings[5].counts = 0.0;
    readings[6].wavelength_nm = 1500.0;
    readings[7].counts = 9.5e6;
    let found = reduce(&[set(readings.clone())], &sensor(1e-7)).unwrap();
    let at = |nm: f64| found.rows.iter().find(|r| r.wavelength_nm == nm).unwrap();
    use EfficiencyFlags as F;
    for (nm, flag) in [
        (520.0, F::NO_LIGHT),
        (540.0, F::NO_LIGHT),
        (560.0, F::MISSING),
        (580.0, F::ABOVE_ONE),
        (600.0, F::NEGATIVE | F::BELOW_DETECTION),
        (640.0, F::SATURATED),
        (1500.0, F::NOT_COVERED),
        (500.0, F::empty()),
    ] {
        assert_eq!(at(nm).flags, flag, "{nm}");
        let has_number =
            flag.is_empty() || flag.contains(F::ABOVE_ONE) || flag.contains(F::NEGATIVE);
        assert_eq!(at(nm).efficiency.is_finite(), has_number, "{nm}");
    }
    assert!(at(580.0).efficiency > 1.2, "nothing is clipped: {}", at(580.0).efficiency);
    let said: Vec<String> = found.notes.iter().map(ToString::to_string).collect();
    assert!(said.iter().any(|s| s.contains("more counts than photons")), "{said:?}");
    let (text, out) = to_curve(&found, "x");
    assert_eq!(out.len(), 7);
    assert!(text.contains("# Left out") && text.contains("580"));
    // The same wavelength twice, with another η: said, and its uncertainty grows.
    let mut twice = vec![good(600.0), good(600.0)];
    twice[1].counts *= 1.4;
    let found = reduce(&[set(twice)], &sensor(1e-7)).unwrap();
    assert!(found.rows.len() == 1 && found.rows[0].flags.contains(F::DISAGREE));
    assert!(found.rows[0].components.own() > 0.05 * found.rows[0].efficiency);
    // Refused with the number.
    assert_eq!(reduce(&[], &sensor(0.0)), Err(EfficiencyError::NoReadings));
    for (change, name) in [
        ((|r: &mut Reading| r.exposure_s = 0.0) as fn(&mut Reading), "exposure_s"),
        (|r| r.wavelength_nm = f64::NAN, "wavelength_nm"),
        (|r| r.counts = -3.0, "counts"),
    ] {
        let mut bad = good(600.0);
        change(&mut bad);
        let error = reduce(&[set(vec![good(500.0), bad])], &sensor(0.0)).unwrap_err().to_string();
        assert!(error.contains(&format!("reading 2 of set 1: {name}: found")), "{error}");
    }
    let mut no_area = sensor(0.0);
    no_area.aperture.area_mm2 = 0.0;
    let error = reduce(&[set(vec![good(600.0)])], &no_area).unwrap_err().to_string();
    assert!(error.contains("sensor's area, mm²: found 0"), "{error}");
    assert!(Lookup::new("x", vec![1.0, 1.0], vec![0.5, 0.5]).is_err());
}
