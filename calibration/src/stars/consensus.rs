//! Which visits agree: every visit's own offsets are a candidate for κ of all channels at once.

use super::gls::{Model, Scatter, Solution, normal, solve};
use super::sample::{Sample, stars};
use super::scatter::{self, Split, split};
use super::{Options, StarsError};
use nalgebra::DVector;

/// Candidates that are polished at most; of more visits those with the smallest loss.
const POLISHED: usize = 64;
/// Rounds of polishing.
const ROUNDS: usize = 30;
/// Slopes per airmass that candidates have where a slope is looked for: clear, hazy, thick. Each is polished to the slopes of its own channels.
const SLOPES: [f64; 5] = [0.0, 0.1, 0.2, 0.35, 0.55];
/// Missing parts of an aerosol's depth that the candidates try where one is fitted; each is polished to its own.
const DEPTHS: [f64; 5] = [0.0, 0.06, 0.15, 0.3, 0.5];
/// Deviation of a normal distribution that one in ten thousand exceeds; for the χ² of what channels do not have in common.
const ONE_IN_TEN_THOUSAND: f64 = 3.7190;
/// Visits by which a group is made larger, and smaller, to see whether another choice is as likely.
const RUNGS: usize = 16;
/// Rounds in which the scatter of a given group settles.
const SETTLING: usize = 3;
/// −2 ln L beyond the best of a choice that is not looked at: one in 500 million.
const HOPELESS: f64 = 40.0;
/// Least probability of a choice that is kept.
const LEAST_PROBABILITY: f64 = 1e-4;

/// A group of visits that agree.
#[derive(Debug, Clone)]
pub(super) struct Group {
    /// True for each sample that agrees.
    pub agrees: Vec<bool>,
    /// Residuals of each sample against the group, split.
    pub splits: Vec<Split>,
    /// Residuals, by sample and channel.
    pub residuals: Vec<Vec<Option<f64>>>,
    pub scatter: Scatter,
    loss: f64,
}

impl Group {
    fn members<'a>(&self, samples: &'a [Sample]) -> Vec<&'a Sample> {
        samples.iter().zip(&self.agrees).filter(|(_, good)| **good).map(|(s, _)| s).collect()
    }

    pub fn stars(&self, samples: &[Sample]) -> usize {
        stars(self.members(samples))
    }

    /// −2 ln L, by which choices of visits are compared, and models: a scatter that has grown until it took in the dimmed stars has its price.
    ///
    /// A visit that does not agree is one whose offset may be anything within a factor e or so. Every share of such visits is as likely beforehand
    /// (beta-binomial). The common offset is integrated over (restricted likelihood). Visits of one star err together, and count as one.
    pub fn deviance(&self, samples: &[Sample]) -> f64 {
        let visits = |star: usize| samples.iter().filter(|s| s.star == star).count();
        let (mut sum, mut weight, mut good, mut bad) = (0.0, 0.0, 0.0, 0.0);
        for ((sample, split), agrees) in samples.iter().zip(&self.splits).zip(&self.agrees) {
            if split.channels == 0 {
                continue;
            }
            let share = 1.0 / visits(sample.star) as f64;
            let limit = chi2_limit(split.channels.saturating_sub(1));
            let (common, chi2) = if *agrees {
                (self.scatter.common + sample.scintillation, split.chi2)
            } else {
                (1.0, split.chi2.min(limit))
            };
            let variance = common + split.own_variance;
            let own = sample.points.iter().zip(&self.scatter.own);
            let ln_own: f64 = own.filter_map(|(p, own)| Some(((*p)?.counts + own).ln())).sum();
            let ln_variance = ln_own + (variance / split.own_variance).ln();
            sum += share * (split.offset.powi(2) / variance + chi2 + ln_variance);
            if *agrees {
                good += share;
                weight += share / variance;
            } else {
                bad += share;
            }
        }
        let ln_prior =
            libm::lgamma(good + 1.0) + libm::lgamma(bad + 1.0) - libm::lgamma(good + bad + 2.0);
        sum + weight.ln() - 2.0 * ln_prior
    }
}

/// The visits that agree, and other choices of them that are not much less likely.
#[derive(Debug, Clone)]
pub(super) struct Choice {
    /// The likeliest.
    pub group: Group,
    /// Probability among the choices that were looked at.
    pub probability: f64,
    /// The others, each with its own.
    pub rivals: Vec<(Group, f64)>,
}

/// The χ² that one in ten thousand exceeds (Wilson and Hilferty 1931: within 1 % from one degree of freedom on).
fn chi2_limit(freedom: usize) -> f64 {
    if freedom == 0 {
        // One channel alone has nothing that it does not share: rounding is all that there is.
        return 1e-9;
    }
    let k = 2.0 / (9.0 * freedom as f64);
    freedom as f64 * (1.0 - k + ONE_IN_TEN_THOUSAND * k.sqrt()).powi(3)
}

/// How far a visit is from the others, and whether that is too far. The loss is the χ² of those that agree, and the limit of those that do not.
fn judge(split: &Split, sample: &Sample, scatter: &Scatter, clip: f64) -> (bool, f64) {
    let limit = chi2_limit(split.channels.saturating_sub(1));
    let z2 = split.offset.powi(2) / (scatter.common + sample.scintillation + split.own_variance);
    let agrees = split.channels > 0 && z2 <= clip * clip && split.chi2 <= limit;
    (agrees, if agrees { z2 + split.chi2 } else { clip * clip + limit })
}

/// Judges all samples against offsets of the channels.
fn judge_all(
    samples: &[Sample],
    scatter: &Scatter,
    clip: f64,
    expected: impl Fn(&Sample, usize) -> f64,
) -> Group {
    let mut group = Group {
        agrees: Vec::new(),
        splits: Vec::new(),
        residuals: Vec::new(),
        scatter: scatter.clone(),
        loss: 0.0,
    };
    for sample in samples {
        let residual = |(c, p): (usize, &Option<super::sample::Point>)| {
            p.map(|p| p.y - expected(sample, c)).filter(|r| r.is_finite())
        };
        let residuals: Vec<Option<f64>> = sample.points.iter().enumerate().map(residual).collect();
        let split = split(&residuals, sample, &scatter.own);
        let (agrees, loss) = judge(&split, sample, scatter, clip);
        group.agrees.push(agrees);
        group.loss += loss;
        group.splits.push(split);
        group.residuals.push(residuals);
    }
    group
}

/// Fits visits that agree, each visit for itself: which star it is of does not matter to whether it agrees.
fn refit(group: &Group, samples: &[Sample], model: &Model) -> Option<Solution> {
    let members = group.members(samples);
    let stars: Option<Vec<_>> =
        members.iter().map(|s| normal(&[*s], &group.scatter, model)).collect();
    solve(&stars?)
}

/// Fits and judges in turn until the group does not change; with `adapt` the scatter is estimated anew each time.
fn polish(
    mut group: Group,
    samples: &[Sample],
    model: &Model,
    least: &Scatter,
    options: &Options,
    adapt: bool,
) -> Option<(Group, DVector<f64>)> {
    let mut found = None;
    for _ in 0..ROUNDS {
        if stars(group.members(samples)) < options.fewest_stars {
            break;
        }
        let parameters = refit(&group, samples, model)?.parameters;
        let expected = |s: &Sample, c: usize| model.value(&parameters, s, c);
        let mut next = judge_all(samples, &group.scatter, options.clip_sigma, expected);
        if adapt {
            let scatter = scatter_of(&group.agrees, &next.residuals, samples, model, least);
            next = judge_all(samples, &scatter, options.clip_sigma, expected);
        }
        let settled = next.agrees == group.agrees && close(&next.scatter, &group.scatter);
        group = next;
        found = Some((group.clone(), parameters));
        if settled {
            break;
        }
    }
    found.filter(|(group, _)| group.stars(samples) >= options.fewest_stars)
}

/// The scatter of those that agreed, about what they agreed on.
fn scatter_of(
    agrees: &[bool],
    residuals: &[Vec<Option<f64>>],
    samples: &[Sample],
    model: &Model,
    least: &Scatter,
) -> Scatter {
    let of = |i: &usize| agrees[*i];
    let members: Vec<usize> = (0..samples.len()).filter(of).collect();
    let picked: Vec<&Sample> = members.iter().map(|i| &samples[*i]).collect();
    let residuals: Vec<_> = members.iter().map(|i| residuals[*i].clone()).collect();
    scatter::estimate(&picked, &residuals, least, model.per_channel())
}

fn close(a: &Scatter, b: &Scatter) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-3 * a.max(b);
    near(a.common, b.common) && a.own.iter().zip(&b.own).all(|(a, b)| near(*a, *b))
}

/// The group that agrees, where there is one and only one; `model` says what about.
pub(super) fn consensus(
    samples: &[Sample],
    model: &Model,
    options: &Options,
) -> Result<Choice, StarsError> {
    let all = stars(samples);
    let least = scatter::floor(options.floor, model.channels);
    let groups = candidates(samples, model, &least, options);
    // Half of the stars may be bad; a group of a few among many is chance.
    let needed = options.fewest_stars.max(all.div_ceil(3));
    let none = |agreeing| StarsError::NoConsensus { agreeing, stars: all, needed };
    let best = groups.first().ok_or(none(0))?;
    let (group, _) = polish(best.clone(), samples, model, &least, options, true)
        .ok_or(none(best.stars(samples)))?;
    let found = group.stars(samples);
    if found < needed {
        return Err(none(found));
    }
    let scatter = group.scatter.common.sqrt();
    if scatter > options.most_scatter {
        let most_percent = 100.0 * options.most_scatter;
        return Err(StarsError::TooMuchScatter { percent: 100.0 * scatter, most_percent });
    }
    let choice = choose(group, needed, samples, model, &least, options);
    unique(&choice.group, samples, &least, options)?;
    Ok(choice)
}

/// The likeliest of the groups that a given one becomes when it takes in the visits next to it, or loses those that are farthest.
///
/// A few stars that lie close together by chance make the scatter small, and all others seem too far. Where the scatter is that of more stars, none is.
fn choose(
    group: Group,
    needed: usize,
    samples: &[Sample],
    model: &Model,
    least: &Scatter,
    options: &Options,
) -> Choice {
    let far = |group: &Group, i: usize| {
        let (split, sample) = (&group.splits[i], &samples[i]);
        let variance = group.scatter.common + sample.scintillation + split.own_variance;
        split.offset.powi(2) / variance + split.chi2
    };
    let mut choices = vec![(group.deviance(samples), group)];
    let mut best = choices[0].0;
    for larger in [true, false] {
        for _ in 0..RUNGS {
            let Some((_, from)) = (if larger { choices.last() } else { choices.first() }) else {
                break;
            };
            // One whose channels do not go together, even with twice their scatter, stays out: a fibre that missed its star makes no channel a noisy one.
            let fits =
                |split: &Split| split.chi2 <= 4.0 * chi2_limit(split.channels.saturating_sub(1));
            let open = (0..samples.len()).filter(|i| {
                let split = &from.splits[*i];
                from.agrees[*i] != larger && split.channels > 0 && (!larger || fits(split))
            });
            let order = |a: &usize, b: &usize| far(from, *a).total_cmp(&far(from, *b));
            let Some(next) = (if larger { open.min_by(order) } else { open.max_by(order) }) else {
                break;
            };
            let mut agrees = from.agrees.clone();
            agrees[next] = larger;
            let Some(group) = about(agrees, from, samples, model, least, options) else { break };
            if group.stars(samples) < needed || group.scatter.common.sqrt() > options.most_scatter {
                break;
            }
            let deviance = group.deviance(samples);
            best = best.min(deviance);
            let place = if larger { choices.len() } else { 0 };
            choices.insert(place, (deviance, group));
            if deviance > best + HOPELESS {
                break;
            }
        }
    }
    let likelihood = |deviance: f64| (0.5 * (best - deviance)).exp();
    let sum: f64 = choices.iter().map(|(d, _)| likelihood(*d)).sum();
    choices.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut choices: Vec<(Group, f64)> =
        choices.into_iter().map(|(d, group)| (group, likelihood(d) / sum)).collect();
    // The group that was given is among them, at least.
    let (group, probability) = choices.remove(0);
    choices.retain(|(_, probability)| *probability > LEAST_PROBABILITY);
    Choice { group, probability, rivals: choices }
}

/// The group of given visits, with the scatter that they have about what they agree on.
fn about(
    agrees: Vec<bool>,
    from: &Group,
    samples: &[Sample],
    model: &Model,
    least: &Scatter,
    options: &Options,
) -> Option<Group> {
    let mut group = Group { agrees: agrees.clone(), ..from.clone() };
    for _ in 0..SETTLING {
        let parameters = refit(&group, samples, model)?.parameters;
        let expected = |s: &Sample, c: usize| model.value(&parameters, s, c);
        let residuals = judge_all(samples, &group.scatter, options.clip_sigma, expected).residuals;
        let scatter = scatter_of(&agrees, &residuals, samples, model, least);
        group = judge_all(samples, &scatter, options.clip_sigma, expected);
        group.agrees.clone_from(&agrees);
    }
    Some(group)
}

/// Groups about each visit's own offsets, polished, best first.
fn candidates(samples: &[Sample], model: &Model, least: &Scatter, options: &Options) -> Vec<Group> {
    // The candidate has noise too.
    let wide =
        Scatter { common: 2.0 * least.common, own: least.own.iter().map(|v| 2.0 * v).collect() };
    let about = |candidate: &Sample, slope: f64| {
        let way = |s: &Sample, c: usize| {
            if model.aerosol {
                s.points[c].and_then(|p| p.per_depth).unwrap_or(0.0)
            } else {
                s.airmass
            }
        };
        let offset = |s: &Sample, c: usize| {
            let own = candidate.points[c].map_or(f64::NAN, |p| p.y);
            own + slope * (way(s, c) - way(candidate, c))
        };
        judge_all(samples, &wide, options.clip_sigma, offset)
    };
    let slopes = match (model.aerosol, model.airmass) {
        (true, _) => &DEPTHS[..],
        (false, Some(_)) => &SLOPES[..],
        (false, None) => &SLOPES[..1],
    };
    let mut groups: Vec<Group> =
        samples.iter().flat_map(|s| slopes.iter().map(move |slope| about(s, *slope))).collect();
    groups.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    // Good candidates agree on who agrees.
    groups.dedup_by(|a, b| a.agrees == b.agrees);
    groups.truncate(POLISHED);
    let polished = |group: Group| {
        let group = Group { scatter: least.clone(), ..group };
        Some(polish(group, samples, model, least, options, false)?.0)
    };
    let mut groups: Vec<Group> = groups.into_iter().filter_map(polished).collect();
    groups.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    groups
}

/// Refuses a night whose other visits agree among themselves nearly as well.
fn unique(
    group: &Group,
    samples: &[Sample],
    least: &Scatter,
    options: &Options,
) -> Result<(), StarsError> {
    let others: Vec<Sample> = samples
        .iter()
        .zip(&group.agrees)
        .filter(|(_, good)| !**good)
        .map(|(s, _)| s.clone())
        .collect();
    let first = group.stars(samples);
    let Some(second) =
        candidates(&others, &Model::plain(least.own.len()), least, options).into_iter().next()
    else {
        return Ok(());
    };
    let second_stars = second.stars(&others);
    // Chance brings a few of 80 % of scatter together, rarely two thirds of as many as agree.
    if second_stars < options.fewest_stars.max((2 * first).div_ceil(3)) {
        return Ok(());
    }
    let offsets: Vec<f64> = samples
        .iter()
        .zip(&group.splits)
        .filter(|(s, _)| {
            others.iter().zip(&second.agrees).any(|(o, good)| *good && o.visit == s.visit)
        })
        .map(|(_, split)| split.offset)
        .collect();
    let mean = offsets.iter().sum::<f64>() / offsets.len().max(1) as f64;
    Err(StarsError::Ambiguous { first, second: second_stars, dimmer: (-mean).exp() })
}
