//! Whether the turn is a multiple of a comb's period: by the light at its teeth, turn by turn.
//!
//! The light is summed over the width of a flash at the time that the comb gives, whether a flash was found there or not: nothing is lost below a threshold, and it does not matter where in a sample the flash
//! fell. Ranks of every n-th turn against those of the others (Kruskal and Wallis 1952, J. Am. Stat. Assoc. 47, 583) ask for no shape of the scatter.

use super::super::stats::chi2_survival;
use super::super::verdict::Question;
use super::FlashPhase;
use super::comb::Comb;
use super::events::Light;

/// A chance below this is a yes, above the next a no, between them neither.
const YES: f64 = 1e-6;
const NO: f64 = 0.02;
/// Turns that may differ by more than this share of their flashes are not known to be alike.
const ALIKE: f64 = 0.2;
/// Multiples that are asked about.
const MULTIPLES: [usize; 2] = [2, 3];
/// Turns of each kind that a question needs.
const LEAST_OF_KIND: usize = 4;
/// Turns that a period needs.
const LEAST_TURNS: f64 = 5.0;
/// Standard deviations of the largest difference that is still possible (95 %, one side).
const ONE_SIDED: f64 = 1.645;

/// The comb at the turn, as far as the flashes tell.
pub(super) struct Answer {
    pub comb: Comb,
    /// Multiples of it that are neither there nor ruled out.
    pub open: Vec<usize>,
    pub questions: Vec<Question>,
    pub phases: Vec<FlashPhase>,
}

/// Turn and light of a tooth, where it was seen.
type Lights = Vec<(i64, f64)>;

fn lights(light: &Light, comb: &Comb) -> Vec<Lights> {
    let half = 0.5 * comb.width_s + light.step_s;
    let turns = (0.5 * light.span_s / comb.period_s).ceil() as i64 + 1;
    let of = |time_s: f64| {
        let own = (-turns..=turns).filter_map(|k| {
            let t = time_s + k as f64 * comb.period_s;
            light.around(t, half).map(|v| (k, v))
        });
        own.collect()
    };
    comb.teeth.iter().map(|t| of(t.time_s)).collect()
}

/// H of Kruskal and Wallis with ties, and its degrees of freedom; `None` of too few.
fn ranks(classes: &[Vec<f64>]) -> Option<(f64, f64)> {
    if classes.iter().any(|c| c.len() < LEAST_OF_KIND) {
        return None;
    }
    let mut all: Vec<(f64, usize)> =
        classes.iter().enumerate().flat_map(|(k, c)| c.iter().map(move |v| (*v, k))).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = all.len() as f64;
    let mut sums = vec![0.0; classes.len()];
    let mut ties = 0.0;
    let mut i = 0;
    while i < all.len() {
        let same = all[i..].iter().take_while(|v| v.0 == all[i].0).count();
        let rank = i as f64 + 0.5 * (same as f64 + 1.0);
        all[i..i + same].iter().for_each(|v| sums[v.1] += rank);
        ties += (same as f64).powi(3) - same as f64;
        i += same;
    }
    let squares: f64 = sums.iter().zip(classes).map(|(s, c)| s * s / c.len() as f64).sum();
    let h = 12.0 / (n * (n + 1.0)) * squares - 3.0 * (n + 1.0);
    let correction = 1.0 - ties / (n * n * n - n);
    (correction > 0.0).then(|| (h / correction, classes.len() as f64 - 1.0))
}

/// Whether flashes of every n-th turn differ.
fn question(all: &[Lights], comb: &Comb, n: usize) -> Question {
    let (mut h, mut degrees) = (0.0, 0.0);
    let (mut largest, mut total) = (0.0_f64, 0.0);
    for own in all {
        let mut classes = vec![Vec::new(); n];
        own.iter().for_each(|(k, v)| classes[k.rem_euclid(n as i64) as usize].push(*v));
        let Some((own_h, own_degrees)) = ranks(&classes) else { continue };
        h += own_h;
        degrees += own_degrees;
        let means: Vec<(f64, f64)> = classes
            .iter()
            .map(|c| {
                let m = c.len() as f64;
                let mean = c.iter().sum::<f64>() / m;
                let variance = c.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (m - 1.0) / m;
                (mean, variance)
            })
            .collect();
        total += means.iter().map(|m| m.0).sum::<f64>() / n as f64;
        for (i, a) in means.iter().enumerate() {
            for b in &means[..i] {
                largest = largest.max((a.0 - b.0).abs() + ONE_SIDED * (a.1 + b.1).sqrt());
            }
        }
    }
    let asked = degrees > 0.0;
    Question {
        longer_s: n as f64 * comb.period_s,
        shorter_s: comb.period_s,
        chance: asked.then(|| chi2_survival(h, degrees)),
        unlike: (asked && total > 0.0).then(|| largest / total),
        dispersion_chance: None,
    }
}

/// Makes the period longer while flashes of every n-th turn differ, and names the multiples that stay open.
pub(super) fn multiples(light: &Light, comb: &Comb, longest_s: f64) -> Answer {
    let mut comb = comb.clone();
    let mut questions = Vec::new();
    let mut open = Vec::new();
    for _ in 0..4 {
        let all = lights(light, &comb);
        open.clear();
        let mut yes: Option<(f64, usize)> = None;
        for n in MULTIPLES {
            let longer_s = n as f64 * comb.period_s;
            if longer_s > longest_s {
                // Too few turns to tell, and few enough to be the period.
                if light.span_s / longer_s > 0.5 * LEAST_TURNS {
                    open.push(n);
                }
                continue;
            }
            let q = question(&all, &comb, n);
            match q.chance {
                Some(p) if p < YES => {
                    if yes.is_none_or(|(other, _)| p < other) {
                        yes = Some((p, n));
                    }
                }
                // A single tooth is one mirror, or several that are alike.
                Some(p)
                    if p > NO && comb.teeth.len() > 1 && q.unlike.is_some_and(|u| u < ALIKE) => {}
                _ => open.push(n),
            }
            questions.push(q);
        }
        let Some((_, n)) = yes else { break };
        comb = comb.times(n);
    }
    let all = lights(light, &comb);
    let phases = comb.teeth.iter().zip(&all).map(|(tooth, own)| {
        let turn = tooth.time_s / comb.period_s;
        let strength = sunglint_numerics::order::median(own.iter().map(|o| o.1)).unwrap_or(0.0);
        FlashPhase {
            phase: turn - turn.floor(),
            seen: own.len().max(tooth.flashes.len()),
            flashed: tooth.flashes.len(),
            strength,
        }
    });
    let mut phases: Vec<FlashPhase> = phases.collect();
    phases.sort_by(|a, b| a.phase.total_cmp(&b.phase));
    Answer { comb, open, questions, phases }
}
