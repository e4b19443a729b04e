//! Verdicts on light curves whose period is known because they were made with it.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::TAU;
use sunglint_analysis::period::verdict::{Outcome, Reason};
use sunglint_analysis::period::{Options, Verdict, verdict};
use sunglint_analysis::series::Series;
use sunglint_testkit::Campaign;

/// A turning body: lobes of light at phases of a turn, each of its own width, height and colour, over a base.
struct Body {
    period_s: f64,
    /// Phase, concentration κ of exp(κ (cos − 1)), height, slope of the height over the pass.
    lobes: Vec<[f64; 4]>,
}

impl Body {
    fn random(random: &mut Random, period_s: f64) -> Self {
        let n = random.random_range(1..=5);
        let mut lobes: Vec<[f64; 4]> = (0..n)
            .map(|_| {
                let width = 10_f64.powf(random.random_range(0.3..2.3));
                [
                    random.random(),
                    width,
                    10_f64.powf(random.random_range(-1.0..0.0)),
                    random.random_range(-0.5..0.5),
                ]
            })
            .collect();
        // A box has like sides: every third body sends the same lobes from its other side, of nearly the same height.
        if random.random_range(0..3) == 0 {
            let unlike = random.random_range(0.05..0.4);
            let others: Vec<[f64; 4]> =
                lobes.iter().map(|[p, w, h, s]| [p + 0.5, *w, h * (1.0 - unlike), *s]).collect();
            lobes.extend(others);
        }
        Self { period_s, lobes }
    }

    fn light(&self, t: f64, span: f64) -> f64 {
        let lobe = |[phase, width, height, slope]: &[f64; 4]| {
            height
                * (1.0 + slope * (t / span - 0.5))
                * (width * ((TAU * (t / self.period_s - phase)).cos() - 1.0)).exp()
        };
        self.lobes.iter().map(lobe).sum()
    }
}

/// Makes the series of a seed: one to four channels with noise, scintillation that they share, and gaps; and the period.
fn spin_state(seed: u64) -> (Vec<Series>, f64, f64) {
    let mut random = Random::seed_from_u64(seed);
    let random = &mut random;
    let turns = 10_f64.powf(random.random_range(0.0..2.0));
    let period = 10_f64.powf(random.random_range(-0.5..2.0));
    let span = turns * period;
    let body = Body::random(random, period);
    // Enough samples for the narrowest lobe to be seen, as a person would choose them.
    let per_turn = random.random_range(15.0..60.0);
    let n = ((turns * per_turn) as usize).clamp(40, 2000);
    let gap_share =
        if random.random_range(0..2) == 0 { random.random_range(0.1..0.6) } else { 0.0 };
    let gap_from = random.random_range(0.0..1.0 - gap_share);
    let is_regular = random.random_range(0..3) > 0;
    let times: Vec<f64> = (0..n)
        .map(|i| if is_regular { (i as f64 + 0.5) / n as f64 } else { random.random() })
        .filter(|u| !(gap_from..gap_from + gap_share).contains(u))
        .map(|u| u * span)
        .collect();
    let light: Vec<f64> = times.iter().map(|t| body.light(*t, span)).collect();
    let mean = light.iter().sum::<f64>() / light.len() as f64;
    let rms = (light.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / light.len() as f64).sqrt();
    let noise = 10_f64.powf(random.random_range(-2.0..0.5));
    let normal = Normal::new(0.0, 1.0).unwrap();
    let channels = random.random_range(1..=4);
    let shared: Vec<f64> = times.iter().map(|_| normal.sample(random)).collect();
    let series = (0..channels)
        .map(|c| {
            let gain = random.random_range(0.3..1.0);
            let value: Vec<f64> = light
                .iter()
                .zip(&shared)
                .map(|(l, s)| {
                    let own: f64 = normal.sample(random);
                    1e4 * (gain * (1.0 + l) + rms * gain * noise * (0.8 * own + 0.6 * s))
                })
                .collect();
            let sigma = vec![1e4 * rms * gain * noise; times.len()];
            Series::new(format!("c{c}"), &times, &value, Some(&sigma)).unwrap()
        })
        .collect();
    (series, period, noise)
}

fn is_right(found: f64, sigma: f64, truth: f64) -> bool {
    (found - truth).abs() <= (6.0 * sigma).max(2e-3 * truth)
}

#[derive(Debug, PartialEq, Clone, Copy)]
enum Judged {
    Right,
    Family,
    FamilyWithout,
    Refused,
    Wrong,
}

fn judged(answer: &Verdict, truth: f64) -> Judged {
    match &answer.outcome {
        Outcome::One(found) if is_right(found.period_s, found.sigma_s, truth) => Judged::Right,
        Outcome::One(_) => Judged::Wrong,
        Outcome::Family(members) => {
            let has = |m: &sunglint_analysis::period::verdict::Member| {
                is_right(m.estimate.period_s, m.estimate.sigma_s, truth)
            };
            if members.iter().any(has) { Judged::Family } else { Judged::FamilyWithout }
        }
        _ => Judged::Refused,
    }
}

/// Truth: the period that the curves were made with. 1,000 bodies of one to ten lobes (every third of two nearly like sides), 1 to 100 turns, noise of 1 % to 300 % of
/// the curve's own variation of which a part is shared by the channels, half of them with a gap of 10 to 60 %, every third sampled at random. A verdict is wrong where
/// it is one other period, or a family without the true one.
/// Tolerance: 2 % of wrong ones, and of curves with more than eight turns and noise below the light's variation nine of ten are answered.
#[test]
fn campaign_spin_states() {
    let mut campaign = Campaign::with_part("spin_states", 1000, 8);
    let mut table = std::collections::BTreeMap::<(&str, &str), [usize; 5]>::new();
    let mut peaks = 0;
    for seed in campaign.seeds() {
        let (series, truth, noise) = spin_state(seed);
        let turns = series[0].span_s() / truth;
        let answer = verdict(&series, &Options::default()).unwrap();
        let found = judged(&answer, truth);
        let noise_name = match noise {
            n if n < 0.1 => "1 below 10 %",
            n if n < 1.0 => "2 10 to 100 %",
            _ => "3 above 100 %",
        };
        let turns_name = match turns {
            n if n < 3.0 => "1 below 3 turns",
            n if n < 8.0 => "2 3 to 8 turns",
            _ => "3 above 8 turns",
        };
        table.entry((turns_name, noise_name)).or_default()[found as usize] += 1;
        let single = answer.peaks.iter().find(|p| p.0 == 1);
        peaks += usize::from(single.is_some_and(|p| is_right(p.1, 0.0, truth)));
        if matches!(found, Judged::Wrong | Judged::FamilyWithout) {
            eprintln!(
                "seed {seed}: {found:?}, truth {truth:.4} s, {turns:.1} turns, noise {noise:.2}, {} samples x {}: {:?}",
                series[0].len(),
                series.len(),
                answer.outcome
            );
        }
    }
    let mut all = [0; 5];
    for ((turns, noise), row) in &table {
        eprintln!(
            "{turns:<16} {noise:<14} right {:>4} family {:>4} family without {:>4} refused {:>4} wrong {:>4}",
            row[0], row[1], row[2], row[3], row[4]
        );
        all.iter_mut().zip(row).for_each(|(a, b)| *a += b);
    }
    let n: usize = all.iter().sum();
    eprintln!("{all:?} of {n}; the highest peak of one harmonic is right {peaks} times");
    let wrong = all[Judged::Wrong as usize] + all[Judged::FamilyWithout as usize];
    assert!(wrong as f64 <= 0.02 * n as f64, "{wrong} of {n} wrong");
    let good = ["1 below 10 %", "2 10 to 100 %"]
        .iter()
        .filter_map(|noise| table.get(&("3 above 8 turns", *noise)))
        .fold([0; 5], |sum, row| std::array::from_fn(|k| sum[k] + row[k]));
    let answered = good[0] + good[1];
    assert!(10 * answered >= 9 * good.iter().sum::<usize>(), "{good:?}");
    campaign.largest("right", all[0] as f64);
    campaign.largest("family_with_the_truth", all[1] as f64);
    campaign.largest("family_without_it", all[2] as f64);
    campaign.largest("refused", all[3] as f64);
    campaign.largest("wrong", all[4] as f64);
    campaign.largest("right_by_the_highest_peak", peaks as f64);
    campaign.finish();
}

/// A curve of two unlike lobes a turn with noise of 5 % of the light's variation.
fn plain(n: usize, span: f64, period: f64, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut random = Random::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let body = Body { period_s: period, lobes: vec![[0.1, 8.0, 1.0, 0.0], [0.6, 15.0, 0.5, 0.2]] };
    let time: Vec<f64> = (0..n).map(|i| span * (i as f64 + 0.5) / n as f64).collect();
    let value = time
        .iter()
        .map(|t| 1.0 + body.light(*t, span) + 0.015 * normal.sample(&mut random))
        .collect();
    (time, value)
}

fn ask(time: &[f64], value: &[f64]) -> Verdict {
    verdict(&[Series::new("c", time, value, None).unwrap()], &Options::default()).unwrap()
}

fn reason(answer: &Verdict) -> String {
    match &answer.outcome {
        Outcome::NotEnough(reason) => reason.to_string(),
        other => panic!("{other:?}"),
    }
}

/// Truth: the period that was put in, of curves without any noise: a square wave whose turn is a whole number of samples, and one whose is not. Its own period comes first, and no multiple is taken for better
/// founded by roundings. Tolerance: 0.1 %.
#[test]
fn curves_without_noise_have_their_own_period() {
    for (period, n) in [(20.0, 600), (20.0, 1800), (17.3, 900)] {
        let time: Vec<f64> = (0..n).map(f64::from).collect();
        let value: Vec<f64> =
            time.iter().map(|t| if (t / period).fract() < 0.5 { 10.0 } else { 11.0 }).collect();
        let answer = ask(&time, &value);
        let first = match &answer.outcome {
            Outcome::One(one) => one.period_s,
            Outcome::Family(members) => members[0].estimate.period_s,
            other => panic!("{other:?}"),
        };
        assert!((first / period - 1.0).abs() < 1e-3, "{period} {n}: {:?}", answer.outcome);
    }
}

/// Truth: the period that was put in, or that there is none.
#[test]
fn hard_cases_are_right_or_refused_with_the_reason() {
    let (time, value) = plain(600, 300.0, 20.0, 1);
    let good = ask(&time, &value);
    let Outcome::One(estimate) = good.outcome else { panic!("{good:?}") };
    assert!((estimate.period_s - 20.0).abs() < 4.0 * estimate.sigma_s && estimate.sigma_s < 0.02);
    // Three samples, none, constant light.
    assert!(reason(&ask(&time[..3], &value[..3])).starts_with("the longest channel has 3 samples"));
    assert!(reason(&ask(&[], &[])).starts_with("the longest channel has 0 samples"));
    assert_eq!(reason(&ask(&time, &[2.5; 600])), "the light is constant in every channel");
    // All at one moment.
    assert!(matches!(
        ask(&[1.0; 50], &value[..50]).outcome,
        Outcome::NotEnough(Reason::Range { .. })
    ));
    // Unsorted, with numbers that are none and samples at the same time: the same verdict.
    let mut order: Vec<usize> = (0..600).collect();
    order.sort_by_key(|i| (i * 7919) % 600);
    let mut mixed: Vec<(f64, f64)> = order.iter().map(|i| (time[*i], value[*i])).collect();
    mixed.insert(5, (f64::NAN, 1.0));
    mixed.insert(50, (17.0, f64::INFINITY));
    mixed.push(mixed[3]);
    let (t, v): (Vec<f64>, Vec<f64>) = mixed.into_iter().unzip();
    let Outcome::One(again) = ask(&t, &v).outcome else { panic!() };
    assert!((again.period_s / estimate.period_s - 1.0).abs() < 1e-4, "{again:?}");
    // A period longer than the data; data of two turns.
    for span in [15.0, 40.0] {
        let (t, v) = plain(600, span, 20.0, 2);
        let answer = ask(&t, &v);
        assert!(matches!(answer.outcome, Outcome::NotEnough(_)), "{span}: {answer:?}");
    }
    // A gap of 90 %: the truth is in what is said, or nothing is said.
    let (t, v) = plain(6000, 600.0, 20.0, 3);
    let (t, v): (Vec<f64>, Vec<f64>) =
        t.into_iter().zip(v).filter(|(t, _)| !(30.0..570.0).contains(t)).unzip();
    let answer = ask(&t, &v);
    assert!(!matches!(judged(&answer, 20.0), Judged::Wrong | Judged::FamilyWithout), "{answer:?}");
    // Noise alone, and noise that wanders: no period.
    for seed in 0..10 {
        let mut random = Random::seed_from_u64(seed);
        let normal = Normal::new(0.0, 1.0).unwrap();
        let white: Vec<f64> = time.iter().map(|_| normal.sample(&mut random)).collect();
        assert!(reason(&ask(&time, &white)).starts_with("no period stands out"));
        let mut sum = 0.0;
        let walk: Vec<f64> = white
            .iter()
            .map(|w| {
                sum += w;
                sum
            })
            .collect();
        let answer = ask(&time, &walk);
        assert!(matches!(answer.outcome, Outcome::NotEnough(_)), "seed {seed}: {answer:?}");
    }
}

/// Exposures as long as the period leave sinc(1) = 0 of every harmonic: noise is left, and is called that. Where they leave no period to look for, that is said.
#[test]
fn exposures_as_long_as_the_period_are_refused() {
    let mut random = Random::seed_from_u64(5);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let time: Vec<f64> = (0..200).map(|i| 2.0 * f64::from(i)).collect();
    let value: Vec<f64> = time.iter().map(|_| 5.0 + 0.1 * normal.sample(&mut random)).collect();
    let mut series = Series::new("c", &time, &value, None).unwrap();
    series.exposure_s = 2.0;
    let answer = verdict(&[series.clone()], &Options::default()).unwrap();
    assert!(reason(&answer).starts_with("no period stands out"), "{answer:?}");
    assert_eq!(answer.searched_s.unwrap().0, 4.0);
    series.exposure_s = 150.0;
    let answer = verdict(&[series.clone()], &Options::default()).unwrap();
    assert!(reason(&answer).contains("exposures up to 150.0000 s"), "{}", reason(&answer));
    let wrong = Options { shortest_s: Some(50.0), longest_s: Some(40.0) };
    series.exposure_s = 2.0;
    let error = verdict(&[series], &wrong).unwrap_err().to_string();
    assert_eq!(error, "periods from 50 s to 40 s, expected the first above 0 and below the second");
}

/// Truth: 60 draws of the noise: the scatter of the periods that are found is the uncertainty that is stated. Tolerance: 30 %, three times that of a scatter of 60.
#[test]
fn the_stated_uncertainty_is_the_scatter_of_new_draws() {
    let mut found = Vec::new();
    let mut stated = 0.0;
    for seed in 0..60 {
        let (time, value) = plain(300, 200.0, 20.0, 100 + seed);
        let best = ask(&time, &value).best.unwrap();
        found.push(best.period_s);
        stated += best.sigma_s / 60.0;
    }
    let mean = found.iter().sum::<f64>() / 60.0;
    let scatter = (found.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / 59.0).sqrt();
    eprintln!("scatter {scatter:.2e} s, stated {stated:.2e} s, mean {mean:.5} s");
    assert!((scatter / stated - 1.0).abs() < 0.3, "{scatter} {stated}");
    assert!((mean - 20.0).abs() < 4.0 * stated / 60.0_f64.sqrt(), "{mean}");
}

/// Truth: the period that was put in, 7.1 s, 35.5 steps of 0.2 s: flashes of 25 ms fall between two samples in every second turn, for many turns on end. Twice the period is what the samples show, and no
/// sampling of this kind can tell it from the truth: the family has both, or the truth alone is told. Noise of a hundredth.
#[test]
fn flashes_shorter_than_a_step_do_not_double_the_period() {
    let mut random = Random::seed_from_u64(11);
    let normal = Normal::new(0.0, 1.0).unwrap();
    for (period, flashes) in [(7.1, 2), (7.1, 1), (6.107, 2)] {
        let mut lobes = vec![[0.3, 2.0, 0.3, 0.0], [0.11, 2000.0, 3.0, 0.0]];
        lobes.extend((1..flashes).map(|_| [0.63, 2500.0, 2.0, 0.0]));
        let body = Body { period_s: period, lobes };
        let time: Vec<f64> = (0..2300).map(|i| 0.2 * f64::from(i)).collect();
        let light = |t: &f64| 1.0 + body.light(*t, 460.0) + 0.01 * normal.sample(&mut random);
        let value: Vec<f64> = time.iter().map(light).collect();
        let answer = ask(&time, &value);
        let found = judged(&answer, period);
        assert!(matches!(found, Judged::Right | Judged::Family), "{period}: {:?}", answer.outcome);
    }
}
