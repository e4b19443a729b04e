//! The virtual goniometer's options, and its light by wavelength.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{InBeam, Spectrometer as _};
use sunglint_formats::toml::Document;
use sunglint_virtual::goniometer::devices::VirtualGoniometer;
use sunglint_virtual::goniometer::light::{Arms, Bench};
use sunglint_virtual::goniometer::options::Options;
use sunglint_virtual::goniometer::wires::wires;

fn read(text: &str) -> Result<Options, String> {
    Options::read(&Document::new("goniometer.toml", text).unwrap()).map_err(|e| e.to_string())
}

/// Truth: the page's words. A reading takes 0.001 to 100 s; devices on lines have the steps of their models.
#[test]
fn what_a_goniometer_cannot_have_is_refused() {
    for bad in ["0", "0.0001", "101", "nan"] {
        let said = read(&format!("[meter]\nreading_s = {bad}\n")).unwrap_err();
        assert!(said.contains("meter.reading_s") && said.contains("0.001 to 100 s"), "{said}");
    }
    assert!(read("[meter]\nreading_s = 0.001\n").is_ok());
    let said = wires(&read("[stage]\nstep_deg = 0.01\n").unwrap()).unwrap_err().to_string();
    assert!(said.contains("stage.step_deg") && said.contains("its own model"), "{said}");
    assert!(wires(&read("[stage]\nspeed_deg_per_s = 3000\n").unwrap()).is_ok());
    for (key, value) in [("band_depth", "1.5"), ("lamp_k", "0"), ("band_width_nm", "0")] {
        let said = read(&format!("[spectrum]\n{key} = {value}\n")).unwrap_err();
        assert!(said.contains(&format!("spectrum.{key}")), "{said}");
    }
    assert!(read("[spectrometer]\nto_nm = 300\n").unwrap_err().contains("spectrometer.to_nm"));
}

/// Truth: by hand. Planck's law at 3000 K: λ⁻⁵/(exp(14387769 nm K/(λ T)) − 1), so 450 nm has 450⁻⁵ · 600⁵ · (e^7.99320 − 1)/(e^10.65761 − 1) of 600 nm. Counts are bias, dark and light, their scatter that of electrons and read
/// noise; the converter's end cuts them.
#[test]
fn counts_of_a_spectrometer() {
    let mut options = read("[lamp]\nwavelength_nm = 600\n").unwrap();
    let exact =
        (600.0_f64 / 450.0).powi(5) * (7.993_205_f64.exp() - 1.0) / (10.657_607_f64.exp() - 1.0);
    let light = Bench::new(options.clone()).unwrap();
    assert!((light.lamp_part(450.0) / exact - 1.0).abs() < 1e-5, "{exact}");
    let it = &mut options.spectrometer;
    (it.pixels, it.peak_nm, it.electrons_per_count) = (501, 600.0, 4.0);
    (it.counts_per_s_per_w, it.bias_counts, it.dark_counts_per_s) = (1e9, 1000.0, 100.0);
    it.read_noise_counts = 10.0;
    options.beam.spread_in_deg = 0.0;
    let bench = VirtualGoniometer::new(options, 0).unwrap();
    let mut device = bench.spectrometer();
    let clock = Arc::new(VirtualClock::new());
    let within = || Deadline::after(clock.clone(), Duration::from_secs(100));
    let pixel = |nm: f64| ((nm - 400.0) / 1.0).round() as usize;
    assert!((device.wavelength_nm()[pixel(600.0)] - 600.0).abs() < 1e-9);
    let mut mean_of = |place: InBeam, integration_s: f64| {
        bench.place(place);
        let all: Vec<f64> = (0..400)
            .map(|_| device.expose(integration_s, &within()).unwrap().counts[pixel(600.0)])
            .collect();
        let mean = all.iter().sum::<f64>() / 400.0;
        let variance = all.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / 399.0;
        (mean, variance)
    };
    let (mean, variance) = mean_of(InBeam::Blocked, 1.0);
    assert!((mean - 1100.0).abs() < 4.0 * (variance / 400.0).sqrt(), "{mean} {variance}");
    // 100 counts are 400 electrons: a variance of 25 counts², beside 100 of the read noise and 1/12 of whole counts.
    assert!((variance / 125.1 - 1.0).abs() < 0.3, "{variance}");
    // The beam whole in the detector: 2 mW are 2e6 counts per second.
    let (mean, variance) = mean_of(InBeam::Head, 0.01);
    let exact = 1000.0 + 1.0 + 2e4;
    assert!((mean - exact).abs() < 4.0 * (variance / 400.0).sqrt() + 0.5, "{mean} {variance}");
    assert!((variance / (20_001.0 / 4.0 + 100.1) - 1.0).abs() < 0.3, "{variance}");
    let (mean, _) = mean_of(InBeam::Head, 1.0);
    assert_eq!(mean, 65_535.0);
    // Parts of the light are the whole of it.
    let arms = Arms { incidence_deg: 30.0, detector_deg: 25.0, azimuth_deg: 3.0, turn_deg: 0.0 };
    let mut glossy = Options::default();
    glossy.sample.base_reflectance = 0.4;
    let light = Bench::new(glossy).unwrap();
    let sum: f64 = light.parts(InBeam::Sample, &arms).iter().sum();
    assert!((sum / light.part(InBeam::Sample, &arms) - 1.0).abs() < 1e-12);
}
