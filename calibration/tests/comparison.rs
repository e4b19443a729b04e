//! Measured beside simulated: scales, uncertainties, χ², what is left out, ratios; from counts that are drawn event by event.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_calibration::comparison::{
    Blocks, Channel, ComparisonError, Given, Ratio, Reason, bins, edges, in_order, overlap,
    something_left, time_shift,
};
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::light_curve::Flags;
use sunglint_testkit::Campaign;

/// A curve of one channel, with all that a comparison takes.
#[derive(Clone)]
struct Curve {
    exposure_s: Vec<f64>,
    measured: Vec<f64>,
    sigma: Vec<f64>,
    flags: Vec<Flags>,
    simulated: Vec<f64>,
    model_error: Vec<f64>,
    material: Option<Vec<f64>>,
    simulated_flags: Vec<Flags>,
    within: Vec<bool>,
    twinkling: Option<Vec<f64>>,
}

impl Curve {
    fn new(measured: Vec<f64>, sigma: Vec<f64>, simulated: Vec<f64>) -> Self {
        let n = measured.len();
        Self {
            exposure_s: vec![0.1; n],
            model_error: vec![0.0; n],
            material: None,
            flags: vec![Flags::empty(); n],
            simulated_flags: vec![Flags::empty(); n],
            within: vec![true; n],
            twinkling: None,
            measured,
            sigma,
            simulated,
        }
    }

    fn given(&self) -> Given<'_> {
        Given {
            name: "spcm",
            exposure_s: &self.exposure_s,
            measured: &self.measured,
            sigma: &self.sigma,
            flags: &self.flags,
            simulated: &self.simulated,
            model_error: &self.model_error,
            material: self.material.as_deref(),
            simulated_flags: &self.simulated_flags,
            within: &self.within,
            twinkling: self.twinkling.as_deref(),
            common_sigma: None,
            of_magnitudes: false,
        }
    }

    fn channel(&self) -> Channel {
        Channel::new(&self.given(), &Blocks::new(self.measured.len()))
    }
}

/// Truth: closed forms, and shifts that are put in. Light of a body that turns in 40 s, with a glint, noise of 3 %: found within 0.3 s, a fifth of the glint's width. A satellite
/// that passes at 800 km with 7.5 km/s, as 1/r²: 65 s late it bends otherwise than any parabola. Nothing is said of right times, of a curve that falls twice as fast as its model (a phase function that is wrong), nor of chance.
#[test]
fn a_shift_in_time_is_told_from_a_wrong_model() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    let noise = Normal::new(0.0, 0.03).unwrap();
    let seconds: Vec<f64> = (0..600).map(|i| 0.5 * f64::from(i)).collect();
    let glint = |t: f64| {
        let phase = std::f64::consts::TAU * t / 40.0;
        (-(t - 150.0) / 200.0).exp() * (1.3 + phase.cos() + 0.3 * (2.0 * phase).sin())
            + 5.0 * (-0.5 * ((t - 171.0) / 1.5).powi(2)).exp()
    };
    let passing = |t: f64| (800_f64.powi(2) + (7.5 * (t - 150.0)).powi(2)).recip();
    let falling = |t: f64| (-t / 100.0).exp();
    let steep = |t: f64| (-t / 50.0 - (t / 400.0).powi(2)).exp();
    let even = |_: f64| 1.0;
    type Light<'a> = &'a dyn Fn(f64) -> f64;
    let cases: [(Light<'_>, Light<'_>, f64, Option<f64>); 8] = [
        (&glint, &glint, 0.0, None),
        (&glint, &glint, 7.3, Some(7.3)),
        (&glint, &glint, -18.0, Some(-18.0)),
        (&passing, &passing, 65.184, Some(65.184)),
        (&passing, &passing, 0.0, None),
        (&steep, &falling, 0.0, None),
        (&even, &even, 0.0, None),
        (&even, &glint, 0.0, None),
    ];
    for (number, (light, model, late_s, told)) in cases.into_iter().enumerate() {
        let simulated: Vec<f64> = seconds.iter().map(|t| 1e4 * model(*t)).collect();
        let measured: Vec<f64> = seconds
            .iter()
            .map(|t| 0.7e4 * light(t - late_s) * (1.0 + noise.sample(&mut random)))
            .collect();
        let sigma = measured.iter().map(|m| 0.03 * m).collect();
        let curve = Curve::new(measured, sigma, simulated);
        let (given, channel) = (curve.given(), curve.channel());
        let shift = time_shift(&seconds, &[(&given, &channel)]);
        match (told, shift) {
            (None, None) => {}
            (Some(told), Some(shift)) => {
                let off = (shift.late_s - told).abs();
                assert!(off < 0.3 || told > 60.0 && off < 3.0, "{number}: {shift:?}");
                assert!(off <= shift.doubt_s, "{number}: {shift:?}");
                assert!((shift.moved_scatter / 0.03 - 1.0).abs() < 0.2, "{number}: {shift:?}");
            }
            other => panic!("{number}: {other:?}"),
        }
    }
}

/// Truth: by hand, of three magnitudes of which one has half the uncertainty.
#[test]
fn magnitudes_are_compared_as_logarithms() {
    let mut curve =
        Curve::new(vec![2.0, 1.0, 8.0, 5.0], vec![0.2, 0.1, 0.4, 1.0], vec![1.0, 1.0, 4.0, 0.0]);
    curve.model_error = vec![0.1, 0.1, 0.4, 0.0];
    let given = Given { of_magnitudes: true, ..curve.given() };
    let channel = Channel::new(&given, &Blocks::new(4));
    assert_eq!(channel.used, [true, true, true, false]);
    assert_eq!(channel.left_out.to_string(), "1 left out (1 dark_in_the_simulation)");
    let numbers = channel.numbers.unwrap();
    // Shares 0.1, 0.1 and 0.05: weights 1, 1 and 4 of ln 2, 0 and ln 2.
    let mean = 5.0 / 6.0 * 2_f64.ln();
    assert!((numbers.scale - mean.exp()).abs() < 1e-14);
    assert!((numbers.scale_sigma.unwrap() - mean.exp() / 600_f64.sqrt()).abs() < 1e-14);
    let left = [2_f64.ln() - mean, -mean, 2_f64.ln() - mean];
    let squares = left[0].powi(2) + left[1].powi(2) + 4.0 * left[2].powi(2);
    let chi2 = numbers.chi2.unwrap();
    assert!((chi2.data - squares / 0.01 / 2.0).abs() < 1e-10, "{chi2:?}");
    let past = |left: f64| (left.abs() - 0.1).max(0.0).powi(2);
    let squares = past(left[0]) + past(left[1]) + 4.0 * past(left[2]);
    assert!((chi2.past_stated - squares / 0.01 / 2.0).abs() < 1e-10, "{chi2:?}");
    let rms = left.iter().map(|l| l * l).sum::<f64>() / 3.0;
    assert!((numbers.rms - rms.sqrt()).abs() < 1e-14);
    assert!((numbers.noise.unwrap() - (0.0225_f64 / 3.0).sqrt()).abs() < 1e-14);
}

/// Truth: by hand.
#[test]
fn numbers_of_a_few_samples() {
    let mut curve =
        Curve::new(vec![2.0, 4.0, 9.0, 100.0], vec![1.0, 1.0, 2.0, 1.0], vec![1.0, 2.0, 3.0, 4.0]);
    curve.exposure_s = vec![1.0, 1.0, 2.0, 1.0];
    curve.flags[3] = Flags::SATURATED | Flags::OFF_AXIS;
    curve.model_error = vec![0.1, 0.1, 0.6, 0.0];
    curve.material = Some(vec![0.05, 0.4, 0.3, 9.0]);
    let channel = curve.channel();
    assert_eq!(channel.used, [true, true, true, false]);
    let numbers = channel.numbers.unwrap();
    // (2 + 4 + 18) / (1 + 2 + 6), √(1 + 1 + 16) / 9.
    assert!((numbers.scale - 24.0 / 9.0).abs() < 1e-14);
    assert!((numbers.scale_sigma.unwrap() - 18_f64.sqrt() / 9.0).abs() < 1e-14);
    // Too few for blocks.
    assert!(numbers.scale_sigma_blocks.is_none());
    let a: f64 = 24.0 / 9.0;
    let r = [2.0 - a, 4.0 - 2.0 * a, 9.0 - 3.0 * a];
    let chi2 = numbers.chi2.unwrap();
    let data = (r[0].powi(2) + r[1].powi(2) + (r[2] / 2.0).powi(2)) / 2.0;
    assert!((chi2.data - data).abs() < 1e-13, "{chi2:?}");
    let past = |r: f64, e: f64, s: f64| ((r.abs() - a * e).max(0.0) / s).powi(2);
    let expected = (past(r[0], 0.1, 1.0) + past(r[1], 0.1, 1.0) + past(r[2], 0.6, 2.0)) / 2.0;
    assert!((chi2.past_stated - expected).abs() < 1e-13);
    let expected = (past(r[0], 0.15, 1.0) + past(r[1], 0.5, 1.0) + past(r[2], 0.9, 2.0)) / 2.0;
    assert!((chi2.past_materials.unwrap() - expected).abs() < 1e-13);
    // Relative 0.05, 0.2 and 0.1; of all light (0.05 + 0.4 + 2 · 0.3)/9. The scale's own uncertainty is as without.
    let material = numbers.material.unwrap();
    assert!((material.median - 0.1).abs() < 1e-14 && (material.largest - 0.2).abs() < 1e-14);
    assert!((material.of_scale - 1.05 / 9.0).abs() < 1e-14);
    assert!((chi2.unscaled - (1.0 + 4.0 + 9.0) / 3.0).abs() < 1e-13);
    let rms = (r[0].powi(2) + r[1].powi(2) + 2.0 * r[2].powi(2)) / (a * a * (1.0 + 4.0 + 18.0));
    assert!((numbers.rms - rms.sqrt()).abs() < 1e-14);
    // Of two samples of weights 1 and 3 and ratios 2, and one of weight 6 and ratio 3: the middles of their weights lie at ½, 2 (ratio 2) and 6 (ratio 3) of 9.
    assert!((numbers.median - (2.0 + (4.5 - 2.0) / (6.0 - 2.0))).abs() < 1e-14);
    let mags = numbers.magnitudes.unwrap();
    let d = [2.0_f64, 2.0, 3.0].map(|r| -2.5 * r.log10());
    assert!((mags[0] - d.iter().sum::<f64>() / 3.0).abs() < 1e-14);
    // Relative stated errors 0.1, 0.05 and 0.2.
    assert_eq!(numbers.stated, (0.1, 0.6 / 3.0));
}

/// Truth: what was put in. A sample with two flags counts under each; NOT_SAMPLED is another instrument's row; a flag that changes no rate leaves nothing out.
#[test]
fn what_is_left_out_is_counted() {
    let mut curve = Curve::new(vec![1.0; 8], vec![0.1; 8], vec![1.0; 8]);
    curve.flags[0] = Flags::SATURATED | Flags::CROWDED;
    curve.flags[1] = Flags::NOT_SAMPLED;
    curve.flags[2] = Flags::CLOCK_FREE;
    curve.simulated_flags[3] = Flags::HIDDEN;
    curve.within[4] = false;
    curve.simulated[4] = f64::NAN;
    curve.simulated[5] = f64::NAN;
    curve.measured[6] = f64::NAN;
    let channel = curve.channel();
    assert_eq!(channel.used, [false, false, true, false, false, false, false, true]);
    assert_eq!((channel.samples, channel.left_out.samples), (7, 5));
    let reasons = [
        (Reason::Flag(Flags::SATURATED), 1),
        (Reason::Flag(Flags::CROWDED), 1),
        (Reason::Outside, 1),
        (Reason::NotSimulated, 1),
        (Reason::NoNumber, 1),
        (Reason::Hidden, 1),
    ];
    assert_eq!(channel.left_out.reasons, reasons);
    let text = channel.left_out.to_string();
    assert!(text.starts_with("5 left out (1 saturated, 1 crowded, "), "{text}");
    something_left(std::slice::from_ref(&channel)).unwrap();
    curve.flags.fill(Flags::OVERFLOW);
    let error = something_left(&[curve.channel()]).unwrap_err().to_string();
    assert!(error.contains("spcm: 8 left out") && error.contains("8 overflow"), "{error}");
}

#[test]
fn times_and_spans() {
    let at = |s: &str| parse_utc(&format!("2020-11-18T{s}")).unwrap();
    let times = [at("18:00:00"), at("18:00:00"), at("18:00:10")];
    in_order(&times).unwrap();
    let error = in_order(&[times[2], times[0]]).unwrap_err().to_string();
    assert!(error.contains("row 2") && error.contains("18:00:10"), "{error}");
    assert!(matches!(in_order(&[]), Err(ComparisonError::Empty)));
    let within = overlap(&times, (at("18:00:05"), at("18:10:00")), 4.0).unwrap();
    assert_eq!(within, [false, false, true]);
    let error = overlap(&times, (at("19:00:00"), at("19:10:00")), 5.0).unwrap_err().to_string();
    for part in ["18:00:00", "18:00:10", "19:00:00", "19:10:00"] {
        assert!(error.contains(part), "{part}: {error}");
    }
}

/// Truth: round numbers that hold all values.
#[test]
fn edges_are_round_and_hold_all() {
    assert_eq!(
        edges(&[41.3, 95.0, f64::NAN], 12),
        [40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0, 90.0, 95.0]
    );
    let of = edges(&[1.13, 3.46], 12);
    assert!((of[0] - 1.0).abs() < 1e-12 && (of[of.len() - 1] - 3.5).abs() < 1e-12, "{of:?}");
    assert!(edges(&[5.0, 5.0], 12).is_empty() && edges(&[], 12).is_empty());
    let curve = Curve::new(vec![2.0, 2.0, 4.0], vec![0.2; 3], vec![1.0; 3]);
    let channel = curve.channel();
    let found = bins(&curve.given(), &channel, &[10.0, 15.0, 20.0], &[10.0, 15.0, 20.0]);
    // The scale is 8/3; the last edge belongs to the last bin.
    assert_eq!(found.iter().map(|b| b.samples).collect::<Vec<_>>(), [1, 2]);
    assert!((found[0].ratio - 0.75).abs() < 1e-14 && (found[1].ratio - 1.125).abs() < 1e-14);
    assert!((found[1].sigma.unwrap() - 0.08_f64.sqrt() / (2.0 * 8.0 / 3.0)).abs() < 1e-14);
}

/// A night's counts, event by event as far as their number goes: Poisson counts of a course over two factors of ten, behind twinkling that is correlated from
/// sample to sample. Gives counts over exposure, their σ, and what the model says at a scale of 1.
fn counted(seed: u64, scale: f64, twinkling: f64, counts: f64, n: usize) -> Curve {
    let mut chance = Xoshiro256PlusPlus::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut logarithm: f64 = normal.sample(&mut chance);
    let memory: f64 = 0.8;
    let (mut measured, mut sigma, mut simulated) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..n {
        let phase = i as f64 / n as f64;
        let expected = counts * (0.05 + (std::f64::consts::PI * phase).sin().powi(2));
        let fresh: f64 = normal.sample(&mut chance);
        logarithm = memory * logarithm + (1.0 - memory * memory).sqrt() * fresh;
        let factor = (twinkling * logarithm - 0.5 * twinkling * twinkling).exp();
        let count: f64 = Poisson::new(scale * expected * factor).unwrap().sample(&mut chance);
        measured.push(count / 0.1);
        sigma.push(count.max(1.0).sqrt() / 0.1);
        simulated.push(expected / 0.1);
    }
    Curve::new(measured, sigma, simulated)
}

/// Truth: the scale put in, 0.9. Tolerance: four standard errors of the mean over 400 curves. Weights by the samples' own σ, which are not used, would be off by
/// ten times that: σ² = N makes faint samples count more.
#[test]
fn the_scale_is_not_drawn_to_faint_samples() {
    let (mut sum, mut square, mut weighted) = (0.0, 0.0, 0.0);
    let n = 400;
    for seed in 0..n {
        let curve = counted(seed, 0.9, 0.0, 30.0, 300);
        let scale = curve.channel().numbers.unwrap().scale;
        sum += scale;
        square += scale * scale;
        let by_sigma = |f: &dyn Fn(usize) -> f64| -> f64 {
            (0..300).map(|i| f(i) / curve.sigma[i].powi(2)).sum()
        };
        weighted += by_sigma(&|i| curve.measured[i] * curve.simulated[i])
            / by_sigma(&|i| curve.simulated[i].powi(2));
    }
    let n = n as f64;
    let (mean, weighted) = (sum / n, weighted / n);
    let error = ((square / n - mean * mean) / n).sqrt();
    assert!((mean - 0.9).abs() < 4.0 * error, "{mean} ± {error}");
    assert!((weighted - 0.9).abs() > 20.0 * error, "{weighted}");
}

/// Truth: χ² of noise that is as it is stated is 1, to √(2/2,000) = 3 % of one standard deviation; with twinkling of 10 % in it the data's σ do not explain it, with its
/// variance added they do (to 15 %: neighbours twinkle together).
#[test]
fn chi2_knows_noise_and_twinkling() {
    let still = counted(1, 1.0, 0.0, 1e4, 2000).channel().numbers.unwrap();
    let chi2 = still.chi2.unwrap().data;
    assert!((chi2 - 1.0).abs() < 0.13, "{chi2}");
    assert!((still.rms / still.noise.unwrap() - 1.0).abs() < 0.1);
    let mut curve = counted(2, 1.0, 0.1, 1e4, 2000);
    curve.twinkling = Some(vec![0.01; 2000]);
    let found = curve.channel().numbers.unwrap();
    let chi2 = found.chi2.unwrap();
    assert!(chi2.data > 10.0, "{chi2:?}");
    assert!((chi2.with_twinkling.unwrap() - 1.0).abs() < 0.2, "{chi2:?}");
    // A normal distribution's half of the central 68 % is its standard deviation.
    assert!((found.scatter - 0.1).abs() < 0.015, "{}", found.scatter);
    assert!(found.scale_sigma_blocks.unwrap() > 3.0 * found.scale_sigma.unwrap());
}

/// Truth: twinkling that two channels share leaves their ratio alone: its uncertainty by blocks is that of counting, which is known (1/√N of each); that of each
/// scale is not.
#[test]
fn what_channels_share_is_not_in_their_ratio() {
    let n = 1000;
    let mut chance = Xoshiro256PlusPlus::seed_from_u64(5);
    let normal = Normal::new(0.0, 0.2).unwrap();
    let slow: Vec<f64> = (0..n / 50).map(|_| normal.sample(&mut chance)).collect();
    let mut channel = |rate: f64| {
        let draw = |i: usize| {
            let factor = f64::exp(slow[i / 50]);
            Poisson::new(rate * factor).unwrap()
        };
        let measured: Vec<f64> = (0..n).map(|i| draw(i).sample(&mut chance)).collect();
        let sigma = measured.iter().map(|m| m.sqrt()).collect();
        Curve::new(measured, sigma, vec![500.0; n])
    };
    let (a, b) = (channel(1000.0), channel(500.0));
    let blocks = Blocks::new(n);
    let (x, y) = (a.channel(), b.channel());
    let ratio = Ratio::new((&a.given(), &x), (&b.given(), &y), &blocks, &[0..500, 500..n], None);
    let ratio = ratio.unwrap();
    let counting = 2.0 * (1.0 / (1000.0 * n as f64) + 1.0 / (500.0 * n as f64)).sqrt();
    assert!((ratio.scale - 2.0).abs() < 4.0 * counting, "{}", ratio.scale);
    let found = ratio.sigma_blocks.unwrap() / counting;
    assert!((0.5..2.0).contains(&found), "{found}");
    assert!((ratio.sigma.unwrap() / counting - 1.0).abs() < 0.1);
    let of_scale = x.numbers.unwrap().scale_sigma_blocks.unwrap() / 2.0;
    assert!(of_scale > 10.0 * counting, "{of_scale} against {counting}");
    assert_eq!(ratio.moments.len(), 2);
    assert!(ratio.moments.iter().all(|m| (m.simulated - 1.0).abs() < 1e-12));
}

/// Truth: the scale that was put in lies in the 95 % interval in 95 % of the curves, with counting noise and twinkling that neighbours share. Tolerance: a binomial's
/// 4 standard deviations (0.028 of 1,000 curves), and 0.005: blocks of 30 samples still share some of it, which makes intervals a little short. The samples' σ alone
/// would cover an eighth. docs/uncertainty.md counts the curves.
#[test]
fn campaign_scale_intervals() {
    let columns = &["below", "above", "pull", "half", "error"];
    let mut campaign = Campaign::in_shards("scale_intervals", 1000, 50, columns);
    let (mut own, mut all) = (0_u32, 0_u32);
    for seed in campaign.seeds() {
        let numbers = counted(1_000_000 + seed, 0.9, 0.15, 2000.0, 600).channel().numbers.unwrap();
        let (low, high) = numbers.scale_interval().unwrap();
        let (off, half) = (numbers.scale - 0.9, 0.5 * (high - low));
        let [below, above] = [low > 0.9, high < 0.9].map(f64::from);
        campaign.keep(seed, &[below, above, off / (half / 1.96), half, off]);
        own += u32::from(off.abs() < 1.96 * numbers.scale_sigma.unwrap());
        all += 1;
    }
    let missed: f64 =
        ["below", "above"].iter().map(|c| campaign.column(c).iter().sum::<f64>()).sum();
    let n = campaign.column("below").len() as f64;
    let (held, own) = (1.0 - missed / n, f64::from(own) / f64::from(all));
    println!("{held} of the intervals hold the scale, {own} by the samples' own σ");
    let room = 4.0 * (0.05 * 0.95 / n).sqrt() + 0.005;
    assert!((held - 0.95).abs() < room, "{held}");
    assert!(own < 0.5, "{own}");
    campaign.largest("intervals_that_miss", missed);
    campaign.finish();
}
