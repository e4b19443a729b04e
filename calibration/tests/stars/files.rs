//! Visits from light curves, and calibrations through files.

use crate::stars::sky::{USUAL, night};
use sunglint_calibration::stars::scintillation::Aperture;
use sunglint_calibration::stars::visit::mean;
use sunglint_calibration::stars::{NightFile, Nights, Options, calibrate};
use sunglint_formats::ecsv;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples,
};

/// Truth: by hand. Four valid samples of 1, 1, 2 and 4 s at 100, 104, 98 and 102 Hz: (100 + 104 + 196 + 408)/8 = 101 Hz, σ = √(1 + 1 + 4 + 16)·2/8 for 2 Hz
/// each. A saturated sample, one of another instrument and one beside the target are left out; a tolerated flag is not.
#[test]
fn the_mean_of_a_visit_is_weighted_by_time() {
    let time = (0..7).map(|i| parse_utc(&format!("2020-11-18T18:00:0{i}")).unwrap()).collect();
    let nan = f64::NAN;
    let channel = ChannelCurve {
        name: "g".into(),
        rate_hz: vec![100.0, 1e6, 104.0, 98.0, nan, 102.0, 7.0],
        sigma_hz: vec![2.0, 2.0, 2.0, 2.0, nan, 2.0, 2.0],
        flags: vec![
            Flags::empty(),
            Flags::SATURATED,
            Flags::TRAILED | Flags::NO_OFF_TARGET,
            Flags::empty(),
            Flags::NOT_SAMPLED,
            Flags::empty(),
            Flags::OFF_TARGET,
        ],
        model_error_hz: None,
        common_sigma_hz: None,
    };
    let curve = LightCurve {
        kind: RateKind::Linear,
        samples: Samples {
            exposure_s: vec![1.0, 1.0, 1.0, 2.0, 1.0, 4.0, 1.0],
            ..Samples::new(time, 1.0)
        },
        channels: vec![channel],
        provenance: Provenance::default(),
        other: Default::default(),
    };
    let aperture = Aperture { diameter_m: 0.43, height_m: 0.0, coefficient: 1.5 };
    // 9 and 80: values of samples that are not valid.
    let airmass = [1.0, 9.0, 1.2, 1.4, 9.0, 1.6, 9.0];
    let zenith_deg = [10.0, 80.0, 20.0, 30.0, 80.0, 40.0, 80.0];
    let found = mean(&curve, &curve.channels[0], &zenith_deg, &airmass, &aperture).unwrap();
    assert!((found.rate_hz - 101.0).abs() < 1e-12);
    assert!((found.sigma_hz - 22.0_f64.sqrt() * 2.0 / 8.0).abs() < 1e-12);
    assert!((found.airmass - (1.0 + 1.2 + 2.8 + 6.4) / 8.0).abs() < 1e-12);
    assert!((found.zenith_deg - (10.0 + 20.0 + 60.0 + 160.0) / 8.0).abs() < 1e-12);
    assert!((found.middle_s - (0.0 + 2.0 + 6.0 + 20.0) / 8.0).abs() < 1e-12);
    assert_eq!((found.used, found.flagged, found.exposed_s), (4, 2, 8.0));
    // A level that is off by 1.2 Hz is so in all of them: each has 1.6 Hz of its own.
    let mut level = curve.clone();
    level.channels[0].common_sigma_hz = Some(vec![1.2; 7]);
    let found = mean(&level, &level.channels[0], &zenith_deg, &airmass, &aperture).unwrap();
    let expected = (22.0_f64.sqrt() * 1.6 / 8.0).hypot(1.2);
    assert!((found.sigma_hz - expected).abs() < 1e-12, "{} {expected}", found.sigma_hz);
    let mut empty = curve.clone();
    empty.channels[0].flags = vec![Flags::GAP; 7];
    assert!(mean(&empty, &empty.channels[0], &zenith_deg, &airmass, &aperture).is_none());
}

/// Truth: what was written is what is read; a file that was changed is refused with its place.
#[test]
fn a_calibration_survives_its_file() {
    let found = calibrate(&night(9, USUAL).visits, &Options::default()).unwrap();
    let names = ["r", "g", "b", "id400", "spcm", "mppc"].map(str::to_owned);
    let nights = Nights {
        nights: vec![NightFile::new("2020-11-18", &names, &found)],
        station: "ufo".into(),
        air: "clear".into(),
        zero_point: "Vega = 0.03".into(),
        confidence: 0.95,
        ..Nights::default()
    };
    let text = ecsv::to_string(&nights.to_table()).unwrap();
    let table = ecsv::read_str("k.ecsv", &text).unwrap();
    let back = Nights::from_table("k.ecsv", &table).unwrap();
    assert_eq!(back, nights);
    assert_eq!(
        back.nights[0].channel("spcm").unwrap().kappa,
        found.channels[4].as_ref().unwrap().kappa
    );
    let refused = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let table = ecsv::read_str("k.ecsv", &text.replacen(from, to, 1)).unwrap();
        Nights::from_table("k.ecsv", &table).unwrap_err().to_string()
    };
    let later = refused("calibration_version: 1", "calibration_version: 2");
    assert!(later.contains("found version 2, expected version 1"), "{later}");
    let other = refused("spcm", "spcn");
    assert!(other.contains("covariance_ln_kappa"), "{other}");
    let none = refused("calibration_version: 1", "colour: 1");
    assert!(none.contains("is this a file that `sunglint calibrate` wrote?"), "{none}");
}
