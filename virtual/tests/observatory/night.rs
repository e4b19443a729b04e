//! A night against what its options ask for.

use super::moments;
use hifitime::{Epoch, Unit};
use std::sync::Arc;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::air::{Air, Zenith};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer};
use sunglint_radiometry::star_light::{self, StarColours};
use sunglint_radiometry::station::{self, Station};
use sunglint_virtual::observatory::frame::Exposure;
use sunglint_virtual::observatory::night::{Night, NightError};
use sunglint_virtual::observatory::options::{Options, PlanOptions, VisitKind};
use sunglint_virtual::observatory::plan::{Curve, Target, Visit, plan};
use sunglint_virtual::observatory::wander::Wander;
use sunglint_virtual::observatory::watch::Watch;

const WINDOW: Exposure =
    Exposure { origin_px: [595, 419], size_px: [200, 200], binning: [1, 1], exposure_s: 1.0 };

fn station() -> Station {
    Station::built_in("ufo").unwrap().unwrap()
}

fn start() -> Epoch {
    parse_utc("2020-11-18T18:00:00Z").unwrap()
}

/// A night without chance but photons, that the tests disturb.
fn calm() -> Options {
    let mut options = Options::default();
    options.stars.scatter = 0.0;
    options.stars.dimmed = 0;
    options.scintillation.strength = 0.0;
    options.pointing.jitter_px = 0.0;
    options.pointing.aim_scatter_px = 0.0;
    options.seeing.scatter = 0.0;
    options.passing.streaks_per_h = 0.0;
    options.passing.cosmic_rays_per_mpx_s = 0.0;
    let camera = &mut options.camera;
    (camera.response_scatter, camera.hot_fraction) = (0.0, 0.0);
    (camera.cold_fraction, camera.dead_fraction) = (0.0, 0.0);
    options
}

fn night(options: Options, visits: Vec<Visit>) -> Result<Night, NightError> {
    Night::new(options, &station(), start(), visits, EarthOrientation::embedded())
}

fn watch(options: Options, visits: Vec<Visit>) -> Watch {
    Watch::new(Arc::new(night(options, visits).unwrap()))
}

/// A satellite of steady predicted rates for so long.
fn steady(rate_hz: f64, to_s: f64) -> Vec<Visit> {
    let row = vec![rate_hz; station().channels.len()];
    let curve = Curve {
        name: "steady".into(),
        time_s: vec![0.0, to_s],
        rates_hz: vec![row.clone(), row],
        airmass: vec![1.0, 1.0],
    };
    vec![Visit { from_s: 0.0, to_s, target: Target::Curve(curve) }]
}

fn channel(night: &Night, name: &str) -> usize {
    night.channels.iter().position(|channel| channel.name == name).unwrap()
}

/// Truth: the definition of the process: variance 1, correlation e^(−Δt/T). 40,000 correlation times give a variance to √(1/40,000) = 0.5 %; five
/// sigma. A value is the same in whatever order it is asked for.
#[test]
fn what_wanders_has_its_variance_and_its_time() {
    let time_s = 0.5;
    let mut wander = Wander::new(3, time_s);
    let values: Vec<f64> = (0..200_000).map(|i| wander.at(f64::from(i) * 0.1)).collect();
    let (mean, variance) = moments(&values);
    assert!(mean.abs() < 5.0 * (2.0 * time_s / 20_000.0_f64).sqrt(), "{mean}");
    assert!((variance - 1.0).abs() < 0.035, "{variance}");
    for lag in [1, 5, 20] {
        let pairs = values.windows(lag + 1).map(|pair| pair[0] * pair[lag]);
        let found = pairs.sum::<f64>() / (values.len() - lag) as f64;
        assert!((found - (-0.1 * lag as f64 / time_s).exp()).abs() < 0.035, "{lag} {found}");
    }
    let mut other = Wander::new(3, time_s);
    for i in [150_000, 3, 199_999, 77, 150_001] {
        assert_eq!(other.at(f64::from(i as u32) * 0.1), values[i]);
    }
    let mut before = Wander::new(3, time_s);
    assert!(before.at(-1234.5).is_finite());
}

/// Truth: Young's law as revised by Osborn et al. (2015), written out: σ² = 1e−5 · 1.5² · 0.43^(−4/3) · e^(−2·399/8000)/t in the zenith, the mean 1. Averages
/// over 1 s, long against 0.03 s; 4000 of them give a variance to 2.2 %, the lattice of 16 steps a correlation time is 0.03 % off.
#[test]
fn stars_twinkle_as_asked() {
    let mut options = calm();
    options.scintillation.strength = 1.5;
    let mut watch = watch(options, steady(1e6, 5000.0));
    let second = |watch: &mut Watch, s: u32| {
        let at = |i: u32| f64::from(s) + (f64::from(i) + 0.5) / 200.0;
        (0..200).map(|i| watch.moment(at(i)).scintillation).sum::<f64>() / 200.0
    };
    let seconds: Vec<f64> = (0..4000).map(|s| second(&mut watch, s)).collect();
    let (mean, variance) = moments(&seconds);
    let truth = 1e-5 * 2.25 * 0.43_f64.powf(-4.0 / 3.0) * (-798.0_f64 / 8000.0).exp();
    assert!((mean - 1.0).abs() < 5.0 * (truth / 4000.0).sqrt(), "{mean}");
    // Of the averages over t ≫ T a variance of 1 − T/t is left of the law: 3 %.
    assert!((variance / truth / 0.97 - 1.0).abs() < 0.11, "{variance} {truth}");
}

/// Truth: the mean of exp(−x²/2s²) over a normal x of standard deviation σ about a is √(s²/(s²+σ²)) exp(−a²/(2(s²+σ²))), in each axis.
/// 8000 correlation times; the coupling scatters by less than 0.2 of itself: five sigma are 1.2 %.
#[test]
fn coupling_is_that_of_a_trembling_telescope() {
    let mut options = calm();
    options.sky.v_mag_per_arcsec2 = 60.0;
    options.pointing.jitter_px = 6.0;
    options.pointing.jitter_time_s = 0.5;
    options.pointing.aim_px = Some([6.0, 1.0]);
    let mut watch = watch(options, steady(1e6, 5000.0));
    let night = watch.night().clone();
    for fibred in station().channels {
        let sunglint_radiometry::station::Detector::Counter(counter) = &fibred.detector else {
            continue;
        };
        let (fibre, i) = (counter.fibre.unwrap(), channel(&night, &fibred.name));
        let mut truth = 1e6 / night.channels[i].kappa;
        for (aim, (at, sigma)) in [6.0, 1.0]
            .into_iter()
            .zip(fibre.offset_px.to_array().into_iter().zip(fibre.sigma_px.to_array()))
        {
            let wide = sigma * sigma + 36.0;
            truth *= (sigma * sigma / wide).sqrt() * (-(aim - at).powi(2) / (2.0 * wide)).exp();
        }
        let all = (0..40_000).map(|k| watch.light_hz(i, f64::from(k) * 0.1).unwrap());
        let mean = all.sum::<f64>() / 40_000.0;
        assert!((mean / truth - 1.0).abs() < 0.012, "{}: {mean} {truth}", fibred.name);
    }
}

/// Truth: arithmetic: a predicted rate over κ arrives, of a counter in counts beside sky and dark counts, of a plane in ADU per second that stands for all pixels: a
/// quarter of the pixels are red. Photon noise, five sigma; of the dead time of 22 ns 1 % is left at 5e5 Hz, n/(1+nτ).
#[test]
fn a_predicted_rate_arrives_over_kappa() {
    let mut options = calm();
    options.seeing.moffat_beta = None;
    options.kappa =
        [("spcm".to_owned(), 20.0), ("r".to_owned(), 0.5), ("g".to_owned(), 0.4)].into();
    options.pointing.aim_px = Some([-1.633, 7.933]);
    let mut watch = watch(options, steady(1e7, 600.0));
    let night = watch.night().clone();
    let spcm = channel(&night, "spcm");
    let light = watch.light_hz(spcm, 300.0).unwrap();
    let truth = night.truth();
    assert!((light - 5e5 - truth.sky_hz["spcm"]).abs() < 1e-6 * light);
    let ps = 1_000_000_000_000;
    let counts = watch.counts(&[spcm], 10 * ps..20 * ps)[0] as f64;
    let arriving = light + 825.0;
    let expected = 10.0 * arriving / (1.0 + arriving * 22e-9);
    assert!((counts - expected).abs() < 5.0 * expected.sqrt(), "{counts} {expected}");

    let mut options = calm();
    options.seeing.moffat_beta = None;
    options.kappa = [("r".to_owned(), 0.5), ("g".to_owned(), 0.4), ("b".to_owned(), 1.0)].into();
    options.sky.v_mag_per_arcsec2 = 60.0;
    let mut watch = self::watch(options, steady(2e5, 600.0));
    let (frame, truth) = watch.frame(&WINDOW, 100.0).unwrap();
    let mut sums = [0.0; 3];
    for ((row, column), adu) in frame.indexed_iter() {
        // RGGB from the sensor's first pixel: the window begins in an odd column and an odd row.
        let colour = (row + 419) % 2 + (column + 595) % 2;
        sums[colour] += f64::from(*adu) - 300.0;
    }
    for (i, (kappa, part)) in [(0.5, 0.25), (0.4, 0.5), (1.0, 0.25)].into_iter().enumerate() {
        let adu = 2e5 / kappa * part;
        // Electrons, read noise of the pixels of that colour, aliasing of 1 % of a point of 5 px.
        let noise = ((adu * 0.27 + 40_000.0 * part * 16.0) / 0.27_f64.powi(2)).sqrt();
        assert!((sums[i] - adu).abs() < 5.0 * noise + 0.002 * adu, "{i}: {} {adu}", sums[i]);
        assert!((truth.electrons[i] / (2e5 / kappa * 0.27) - 1.0).abs() < 1e-9);
    }
}

/// Truth: the radiometry of the same star at the same moment without a night, by hand. The lines between places a minute apart are within 1e-4 of it.
#[test]
fn a_star_has_its_light() {
    let vega = Catalogue::embedded().find("Vega").unwrap().clone();
    let visits =
        vec![Visit { from_s: 60.0, to_s: 1000.0, target: Target::Star(Box::new(vega.clone())) }];
    let night = night(calm(), visits).unwrap();
    let station = station();
    let colours = StarColours {
        v_mag: vega.v_mag.unwrap(),
        b_minus_v_mag: vega.bv_mag,
        spectral_type: None,
        zero: ZeroPoint::default(),
    };
    let light = star_light::vega(colours).unwrap().irradiance;
    let air = Air::new(&station.air_options().unwrap()).unwrap();
    for time_s in [60.0, 333.3, 999.0] {
        let at = start() + time_s * Unit::Second;
        let observer = Observer::at(at, &station.site, EarthOrientation::embedded()).unwrap();
        let zenith = Zenith::True(observer.star(&vega).horizontal.zenith_deg());
        let through = air.spectrum(zenith, light.range_nm()).unwrap();
        for (i, channel) in station.channels.iter().enumerate() {
            let predicted = station.rate_hz(channel, &light, Some(&through)).value;
            let found = night.visits[0].arriving_hz(i, time_s) * night.channels[i].kappa;
            assert!((found / predicted - 1.0).abs() < 1e-4, "{time_s} {}", channel.name);
        }
    }
    assert_eq!(night.visits[0].arriving_hz(0, 59.0), 0.0);
}

/// Truth: the options. Of 25 stars 5 are dimmed to 0.2 to 0.7, the others scatter by 3 %: the standard deviation of 20 is known to 16 %; three sigma.
#[test]
fn a_plan_has_its_stars() {
    let mut options = calm();
    (options.stars.scatter, options.stars.dimmed) = (0.03, 5);
    let orientation = EarthOrientation::embedded();
    let visits = plan(&PlanOptions::default(), &station().site, start(), orientation).unwrap();
    assert!(visits.windows(2).all(|pair| pair[0].to_s <= pair[1].from_s));
    let night = night(options.clone(), visits.clone()).unwrap();
    let truth = night.truth();
    let stars: Vec<_> = truth.visits.iter().filter(|v| v.kind == VisitKind::Star).collect();
    let names: std::collections::HashSet<&str> = stars.iter().map(|v| v.name.as_str()).collect();
    assert_eq!((stars.len(), names.len()), (25, 25));
    let (dimmed, clean): (Vec<f64>, Vec<f64>) =
        stars.iter().map(|v| v.factor["spcm"]).partition(|factor| *factor < 0.8);
    assert_eq!(dimmed.len(), 5);
    assert!(dimmed.iter().all(|factor| (0.18..0.77).contains(factor)));
    let logs: Vec<f64> = clean.iter().map(|factor| factor.ln()).collect();
    let scatter = moments(&logs).1.sqrt();
    assert!((scatter / 0.03 - 1.0).abs() < 0.48, "{scatter}");
    let airmass: Vec<f64> = stars.iter().map(|v| v.airmass.unwrap()).collect();
    assert!(airmass.iter().any(|x| *x < 1.1) && airmass.iter().any(|x| *x > 2.0), "{airmass:?}");
    // Haze that nobody was told of takes e^(−0.2 X) at 550 nm: the slope over the airmass.
    options.air.aerosol_depth = 0.2;
    let hazy = self::night(options, visits).unwrap().truth();
    let lost = |i: usize| {
        let seen = stars[i].arriving_hz["g"];
        let hazy =
            hazy.visits.iter().find(|v| v.name == stars[i].name && v.kind == VisitKind::Star);
        (seen / hazy.unwrap().arriving_hz["g"]).ln() / stars[i].airmass.unwrap()
    };
    assert!((0..25).all(|i| (lost(i) / 0.2 - 1.0).abs() < 0.1), "{:?}", lost(0));
}

/// Truth: what is asked in another order is the same. A closed shutter leaves the bias (300 ADU, noise 4/0.27) and the dark rate.
#[test]
fn a_night_is_what_it_is() {
    let mut visits = steady(1e6, 100.0);
    visits.push(Visit { from_s: 100.0, to_s: 200.0, target: Target::Dark });
    visits.push(Visit { from_s: 200.0, to_s: 300.0, target: Target::Sky { beside: "it".into() } });
    let night = Arc::new(night(Options::default(), visits).unwrap());
    let second = 1_000_000_000_000;
    let bins = [3, 50, 12, 250, 150, 99];
    let counts = |order: &[i64]| -> Vec<Vec<u64>> {
        let mut watch = Watch::new(night.clone());
        order
            .iter()
            .map(|s| watch.counts(&watch.counters(), s * second..(s + 1) * second))
            .collect()
    };
    let forward = counts(&bins);
    let mut backward = counts(&bins.iter().rev().copied().collect::<Vec<_>>());
    backward.reverse();
    assert_eq!(forward, backward);
    let frame = |start_s: f64, watch: &mut Watch| watch.frame(&WINDOW, start_s).unwrap();
    let mut watch = Watch::new(night.clone());
    let first = frame(20.0, &mut watch);
    let dark = frame(150.0, &mut watch);
    let (truth, night) = (night.truth(), night.clone());
    let elsewhere = std::thread::spawn(move || Watch::new(night).frame(&WINDOW, 20.0).unwrap());
    assert!(elsewhere.join().unwrap() == first && frame(20.0, &mut watch) == first);
    assert_ne!(frame(22.0, &mut watch).0, first.0);
    assert!(dark.1.dark && dark.1.offset_px.is_none() && first.1.offset_px.is_some());
    let mut pixels: Vec<u16> = dark.0.iter().copied().collect();
    pixels.sort_unstable();
    assert!((299..=301).contains(&pixels[20_000]));
    // The dark rates of tables B.1 and B.2 of the station's file, for a second.
    for (counts, rate_hz) in forward[4].iter().zip([756.0_f64, 825.0, 24_737.0]) {
        assert!((*counts as f64 - rate_hz).abs() < 5.0 * rate_hz.sqrt() + 0.008 * rate_hz);
    }
    let sky = truth.sky_hz;
    for (counts, (name, dark_hz)) in
        forward[3].iter().zip([("id400", 756.0), ("spcm", 825.0), ("mppc", 24_737.0)])
    {
        let rate_hz: f64 = dark_hz + sky[name];
        assert!((*counts as f64 - rate_hz).abs() < 5.0 * rate_hz.sqrt() + 0.01 * rate_hz, "{name}");
    }
}

/// Truth: by hand, a table of three rows: 0.9 of 10 kHz and 0.7 of 100 kHz are counted, a line between them, from darkness to the first row and none beyond the last. 300 bins
/// of a second know a mean to its Poisson error, five of them are allowed; their variance is that of photons to 5 × √(2/300). Tags are counted alike.
#[test]
fn a_counter_of_a_table_counts_what_it_says() {
    let mut station = station();
    let number = station.channels.iter().position(|c| c.name == "mppc").unwrap();
    let station::Detector::Counter(counter) = &mut station.channels[number].detector else {
        panic!("a counter")
    };
    counter.fibre = None;
    counter.dark_rate_hz = 500.0;
    counter.dead_time =
        station::DeadTime::Table { measured_hz: vec![9e3, 7e4, 8e4], true_hz: vec![1e4, 1e5, 2e5] };
    for (light_hz, counted) in
        [(4_500.0, 4_500.0), (54_500.0, 9e3 + 45.0 / 90.0 * 6.1e4), (1e6, 8e4)]
    {
        let mut options = calm();
        options.sky.v_mag_per_arcsec2 = 40.0;
        options.kappa.insert("mppc".into(), 1.0);
        let visits = steady(light_hz, 300.0);
        let night =
            Night::new(options, &station, start(), visits, EarthOrientation::embedded()).unwrap();
        let mut watch = Watch::new(Arc::new(night));
        let second = 1_000_000_000_000;
        let bins: Vec<f64> = (0..300)
            .map(|s| watch.counts(&[number], s * second..(s + 1) * second)[0] as f64)
            .collect();
        let (mean, variance) = moments(&bins);
        assert!((mean - counted).abs() < 5.0 * (counted / 300.0).sqrt(), "{light_hz}: {mean}");
        assert!((variance / counted - 1.0).abs() < 5.0 * (2.0_f64 / 300.0).sqrt(), "{variance}");
        let tags = watch.tags(number, 0..10 * second, 10_000_000_000).len() as f64;
        assert!((tags - 10.0 * counted).abs() < 5.0 * (10.0 * counted).sqrt(), "{tags}");
    }
}

/// Truth: each refusal names what is wrong.
#[test]
fn impossible_nights_are_refused() {
    let said =
        |options: Options, visits: Vec<Visit>| night(options, visits).unwrap_err().to_string();
    let mut options = calm();
    options.scintillation.time_s = 0.0;
    assert_eq!(
        said(options, vec![]),
        "scintillation.time_s = 0, expected a number above 0, up to 1e9"
    );
    let mut options = calm();
    options.kappa.insert("x".into(), 1.0);
    assert!(
        said(options, vec![]).starts_with("kappa: the station ufo has no channel x; it has r, g")
    );
    let mut twice = steady(1.0, 100.0);
    twice.extend(steady(1.0, 50.0));
    assert!(said(calm(), twice).contains("before the end of the one before it at 100 s"));
    let south = Catalogue::embedded().find("Canopus").unwrap().clone();
    let visit = Visit { from_s: 0.0, to_s: 10.0, target: Target::Star(Box::new(south)) };
    assert!(said(calm(), vec![visit]).contains("below the horizon"));
    let mut short = steady(1.0, 10.0);
    let Target::Curve(curve) = &mut short[0].target else { panic!("a curve") };
    curve.rates_hz[1].pop();
    assert!(said(calm(), short).contains("2 times and 2 rows"));
}
