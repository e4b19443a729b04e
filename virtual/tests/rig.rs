//! The virtual rig: its light against closed forms and integrals, its stage and meter against arithmetic.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::f64::consts::PI;
use sunglint_drivers::device::InBeam;
use sunglint_virtual::rig::bench::Bench;
use sunglint_virtual::rig::meter::{Meter, Shown};
use sunglint_virtual::rig::options::{Options, SampleKind};
use sunglint_virtual::rig::stage::Stage;

/// Truth: ∫ D cosθ dω = 1, and Smith's G₁ = cosθ/σ(ω) with σ(ω) = ∫ D max(0, ω·m) dω_m (Walter et al. 2007; Heitz 2014), both by the midpoint rule. Tolerance 2e-4: its error at the horizon of the
/// normals that face away.
#[test]
fn microfacets_have_their_area() {
    for (kind, alpha) in
        [(SampleKind::Beckmann, 0.3), (SampleKind::Ggx, 0.3), (SampleKind::Ggx, 0.8)]
    {
        let mut options = Options::default();
        let sample = &mut options.sample;
        (sample.kind, sample.alpha, sample.reflectance) = (kind, alpha, 1.0);
        let (nt, np) = (2000, 720);
        for theta in [0.0_f64, 0.6, 1.1] {
            let (mut area, mut seen) = (0.0, 0.0);
            for i in 0..nt {
                let t = (f64::from(i) + 0.5) / f64::from(nt) * PI / 2.0;
                let ring = sample.density(t.cos()) * t.sin() * PI / 2.0 / f64::from(nt);
                area += 2.0 * PI * ring * t.cos();
                let around = (0..np).map(|j| {
                    let phi = (f64::from(j) + 0.5) / f64::from(np) * 2.0 * PI;
                    (theta.sin() * t.sin() * phi.cos() + theta.cos() * t.cos()).max(0.0)
                });
                seen += ring * around.sum::<f64>() * 2.0 * PI / f64::from(np);
            }
            assert!((area - 1.0).abs() < 2e-4, "{kind:?} {alpha}: {area}");
            // f(ω, ω) = F₀ D G₁/(4 cos²θ).
            let masking = theta.cos() / seen;
            let f = sample.density(theta.cos()) * masking / (4.0 * theta.cos().powi(2));
            let found = sample.retro(theta).unwrap();
            assert!((found / f - 1.0).abs() < 2e-4, "{kind:?} {alpha} {theta}: {found} {f}");
        }
    }
}

/// Truth: of a Lambert sample ρ/π ∫ cosθ_o dω over a small stop, to the second order in its size; of a mirror at normal incidence all that the stop takes of a Gaussian of 1 mrad (erf in each axis),
/// and nothing 5° beside it; beside a narrow sample the holder. Tolerance 1e-4: the second order.
#[test]
fn the_light_on_the_meter_is_that_of_closed_forms() {
    let mut options = Options::default();
    options.optics.stray = 0.0;
    (options.sample.kind, options.sample.reflectance) = (SampleKind::Lambert, 0.7);
    let through = 2e-3 * 0.5 * 0.95;
    let bench = Bench::new(options.clone()).unwrap();
    // The plate's area, foreshortened, over the square of the distance.
    let sr = 70.0 * (PI / 4.0).cos() / 700.0_f64.powi(2);
    assert!((bench.stop_sr() / sr - 1.0).abs() < 1e-4);
    for angle in [0.0_f64, 30.0, 60.0] {
        let light = bench.light_w(InBeam::Sample, angle, 0.0);
        let truth = through * 0.7 / PI * angle.to_radians().cos() * sr;
        assert!((light / truth - 1.0).abs() < 2e-4, "{angle}: {light} {truth}");
    }
    assert!((bench.light_w(InBeam::Head, 0.0, 3600.0) - 2e-3).abs() < 1e-15);
    options.sample.kind = SampleKind::Mirror;
    options.stop.tilt_deg = 0.0;
    (options.stop.width_mm, options.stop.height_mm) = (2.8, 1.4);
    let mirror = Bench::new(options.clone()).unwrap();
    // ± 2 and ± 1 standard deviations.
    let truth = through * 0.7 * 0.954_499_736_104 * 0.682_689_492_137;
    let light = mirror.light_w(InBeam::Sample, 0.0, 0.0);
    assert!((light / truth - 1.0).abs() < 1e-4, "{light} {truth}");
    assert!(mirror.light_w(InBeam::Sample, 5.0, 0.0) < 1e-30);
    // Half a millimetre of sample under a beam of 1 mm: erf(√2/2) of it is caught.
    options.sample.width_mm = 0.5;
    let narrow = Bench::new(options).unwrap();
    assert!((narrow.caught(0.0) - 0.682_689_492_137).abs() < 1e-9);
}

/// Truth: arithmetic. A stage of 0.4° steps goes to the nearest; on the way down the sample stays behind by the play.
#[test]
fn a_stage_has_steps_and_play() {
    let mut options = Options::default();
    (options.stage.step_deg, options.stage.backlash_deg) = (0.4, 0.1);
    let mut stage = Stage::new();
    let (took_s, arrived) = stage.turn(&options, 10.1);
    assert!(arrived && (took_s - 10.0 / 20.0).abs() < 1e-12);
    assert!((stage.motor_deg() - 10.0).abs() < 1e-12 && stage.sample_deg() == stage.motor_deg());
    stage.turn(&options, 8.0);
    assert!((stage.sample_deg() - 8.1).abs() < 1e-12);
    stage.turn(&options, 8.4);
    assert!((stage.sample_deg() - 8.4).abs() < 1e-12);
    options.fault.stuck_beyond_deg = Some(9.0);
    assert!(!stage.turn(&options, 12.0).1 && stage.motor_deg() == 9.0);
}

/// Truth: the normal distribution (mean within 4 σ/√n, standard deviation within 10 %: n = 2000), digits, the exponential of settling, ranges by their ends.
#[test]
fn a_meter_has_noise_digits_ranges_and_an_end() {
    let mut options = Options::default();
    options.laser.noise = 0.01;
    options.meter.offset_w = 1e-8;
    options.meter.settling_s = 0.0;
    let mut meter = Meter::new(&options);
    let mut read = |options: &Options, light_w: f64, at_s: f64, number: u64| match meter
        .read(options, light_w, at_s, number)
    {
        Shown::Watts(power_w) => (power_w, meter.range_w(options)),
        Shown::Over(end_w) => (f64::INFINITY, end_w),
    };
    let n = 2000;
    let shown: Vec<f64> = (0..n).map(|k| read(&options, 1e-6, 0.0, k).0).collect();
    let mean = shown.iter().sum::<f64>() / n as f64;
    let sigma = (shown.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
    assert!((mean - 1.01e-6).abs() < 4.0 * 1e-8 / (n as f64).sqrt(), "{mean:e}");
    assert!((sigma / 1e-8 - 1.0).abs() < 0.1, "{sigma:e}");
    let digit = 3e-6 / 1e5;
    assert!(shown.iter().all(|p| (p / digit - (p / digit).round()).abs() < 1e-6));
    options.laser.noise = 0.0;
    (options.meter.settling_s, options.meter.settling_error) = (0.5, 0.2);
    let (first, range) = read(&options, 1e-4, 100.0, 0);
    assert!((range - 3e-4).abs() < 1e-18 && (first / 1.0001e-4 - 1.2).abs() < 1e-4, "{first:e}");
    let later = read(&options, 1e-4, 101.0, 1).0;
    assert!((later / 1.0001e-4 - 1.0 - 0.2 * (-2.0_f64).exp()).abs() < 1e-4, "{later:e}");
    assert!(read(&options, 0.1, 200.0, 2).0.is_infinite());
    assert_eq!(meter.range_w(&options), 3e-2);
    assert!(
        meter.set_range(&options, Some(0), 300.0) && !meter.set_range(&options, Some(99), 300.0)
    );
    assert_eq!(meter.read(&options, 1e-6, 400.0, 3), Shown::Over(3e-8));
    // The same reading, the same chance.
    let again = |number| Meter::new(&options).read(&options, 1e-6, 0.0, number);
    assert_eq!(again(7), again(7));
}

#[test]
fn rigs_that_cannot_be_are_refused_with_the_key() {
    let refused = |change: fn(&mut Options)| {
        let mut options = Options::default();
        change(&mut options);
        Bench::new(options).unwrap_err().to_string()
    };
    assert_eq!(
        refused(|o| o.sample.alpha = 0.0),
        "sample.alpha = 0, expected a roughness from 1e-4 to 2"
    );
    assert!(
        refused(|o| o.stop.distance_mm = f64::NAN).starts_with("stop.distance_mm = NaN, expected")
    );
    assert!(refused(|o| o.meter.ranges_w = vec![]).contains("meter.ranges_w"));
    assert!(refused(|o| o.meter.ranges_w = vec![1.0, 1.0]).contains("= 1, expected"));
}
