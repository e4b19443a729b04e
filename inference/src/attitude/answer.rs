//! Meaning of the minima: how probable each is, how uncertain, and which symmetry made it.

use super::descent::{Descent, Sample, Space};
use super::forward::Measured;
use super::minimum::{Minimum, UNDETERMINED, described, probabilities};
use super::question::{Checkpoint, Options, Question, Watch};
use super::search::{Searched, search};
use super::state::Law;
use super::twins::{self, Symmetry};
use super::{AttitudeError, Scale};
use glam::DVec3;

/// A minimum with less than this part of the probability is excluded.
const EXCLUDED: f64 = 1e-3;
/// The best one alone is the answer from here on.
const ALONE: f64 = 0.95;
/// A minimum this near to a twin of the best is that twin, radians.
const TWIN: f64 = 0.45;
/// Where more than this is left over of the light, or χ² is larger than so many degrees of freedom, the search is made again, finer.
const POOR_EXTRA: f64 = 0.15;
/// See [`POOR_EXTRA`].
const POOR_CHI2: f64 = 1.5;
/// So does a reduced χ² of more than this, with the noise beyond the stated.
const NO_FIT: f64 = 4.0;
/// Blocks of neighbouring epochs that residuals are summed over.
const BLOCKS: usize = 12;
/// Residuals count no further than this in them.
const OUTLIER: f64 = 3.0;
/// Standard deviations by which chance is excluded.
const CHANCE: f64 = 4.0;
/// Noise beyond the stated of more than this says that the model is not that of the light.
const NO_MODEL: f64 = 0.3;

/// Verdict of the search.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// One attitude.
    One,
    /// So many that the data do not choose from.
    Several(usize),
    /// None that means something, with the reason.
    Undetermined(String),
}

impl Verdict {
    /// Returns the verdict's name, as results have it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::One => "one",
            Self::Several(_) => "several",
            Self::Undetermined(_) => "undetermined",
        }
    }
}

/// The answer.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Verdict of the search.
    pub verdict: Verdict,
    /// Minima, the most probable first.
    pub minima: Vec<Minimum>,
    /// Samples that count.
    pub samples: usize,
    /// Epochs that have one.
    pub epochs: usize,
    /// Epochs that χ² is of, where not all were taken.
    pub epochs_taken: usize,
    /// χ² of the best over its degrees of freedom, with the noise beyond the stated.
    pub reduced_chi2: f64,
    /// How many times the variance of sums of neighbouring residuals is that of independent ones; 1 where they may be independent. Uncertainties and differences of χ² are scaled by it.
    pub correlation: f64,
    /// Noise beyond the stated, of the rate: what brings the middle residual to where noise has it.
    pub extra_noise: f64,
    /// Time span of the data, s.
    pub span_s: f64,
    /// Turns of the best in that.
    pub turns: f64,
    /// The axes that were looked at first, and the mean cost of the best place of each: the error surface, coarse.
    pub surface: Vec<(DVec3, f64)>,
    /// The body's symmetries, with how unlike the light is that each makes.
    pub symmetries: Vec<Symmetry>,
    /// Periods (and senses) of the first look.
    pub periods: usize,
    /// Epochs that were simulated in all.
    pub simulated: usize,
    /// Whether the first look was made again, finer.
    pub finer: bool,
    /// The median and the largest share of light by other ways than the direct one, at the best.
    pub other_light: (f64, f64),
    /// All samples of the best.
    pub best: Vec<Sample>,
    /// Curve and sample number, from 0, of each epoch that has a sample: the epochs that [`Sample::moment`] counts.
    pub moments: Vec<(usize, usize)>,
    /// The law, for [`Law::at`].
    pub law: Law,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Finds the attitude.
///
/// The search is the same whatever the number of threads; `from` goes on with one that was cut off.
///
/// # Errors
/// Too few samples; light that does not change; a body that looks the same from all sides; a scene that cannot be simulated; more periods than anyone waits for; a
/// checkpoint of another search.
pub fn find(
    curves: &[Measured],
    question: &Question,
    options: &Options,
    watch: &dyn Watch,
    from: Option<&Checkpoint>,
) -> Result<Answer, AttitudeError> {
    let again = from.is_some_and(|c| c.times > 1);
    let searched = search(curves, question, options, watch, from, again)?;
    let usual = answer(question, searched)?;
    if usual.finer || !usual.is_poor() {
        return Ok(usual);
    }
    // What noise does not explain may be another attitude's light: once more, finer, and with the Earth's light in every trial's.
    let searched = search(curves, question, options, watch, from.filter(|c| c.times > 1), true)?;
    let mut finer = answer(question, searched)?;
    finer.simulated += usual.simulated;
    let better = finer.extra_noise <= usual.extra_noise;
    Ok(if better { finer } else { Answer { finer: true, simulated: finer.simulated, ..usual } })
}

fn answer(question: &Question, searched: Searched) -> Result<Answer, AttitudeError> {
    let unknowns = question.unknowns;
    let law = searched.law;
    let best = searched.minima.first().ok_or(AttitudeError::NoMinimum)?.clone();
    let compared = super::compare::Compared::new(&searched.forward)?;
    let own = &searched.forward;
    let all: Vec<usize> = (0..own.moments.len()).collect();
    let descent = |moments| Descent {
        forward: own,
        compared: &compared,
        law: &law,
        unknowns,
        moments,
        space: Space::Rates { extra: searched.extra },
        scale: question.scale,
        materials: &searched.materials,
        held: best.held.as_ref().map(|h| h.as_slice()),
    };
    let samples = descent(&all).samples(&mut own.eye(), &best.state)?;
    let taken = searched.moments.len();
    let counted: usize = searched
        .moments
        .iter()
        .map(|m| searched.forward.rates(*m).iter().filter(|r| r.is_finite()).count())
        .sum();
    let freedom = counted.saturating_sub(best.normal.nrows()).max(1) as f64;
    let reduced_chi2 = best.cost / freedom;
    let alike = correlation(&samples, searched.extra);
    let scale = reduced_chi2.max(1.0) * alike;
    let mut minima = Vec::new();
    for found in &searched.minima {
        let mut minimum = described(found, &law, question, scale)?;
        minimum.delta_chi2 = (found.cost - best.cost) / scale;
        minimum.from_best_deg = law.apart(&best.state, &found.state).to_degrees();
        minima.push(minimum);
    }
    probabilities(&mut minima, &searched.minima);
    minima.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.chi2.total_cmp(&b.chi2)));
    let twins = twins::twins(&searched.forward, &law, &minima[0].state, &searched.symmetries);
    for minimum in minima.iter_mut().skip(1) {
        let near = twins.iter().map(|(twin, state)| (*twin, law.apart(state, &minimum.state)));
        let near = near.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, far)| *far < TWIN);
        minimum.twin = near.map(|(twin, far)| (twin, far.to_degrees()));
    }
    let span_s = 2.0 * law.half_span_s;
    let turns = minima[0].turn.turns_per_s.abs() * span_s;
    let mut warnings = searched.warnings;
    if searched.extra > 0.1 {
        warnings.push(format!(
            "the model leaves {:.0} % of the light over beyond the stated noise: materials, shape or motion are not quite the body's, and uncertainties hold only if what is missing is random",
            100.0 * searched.extra
        ));
    }
    if unknowns.period && turns < 1.0 {
        warnings.push(format!(
            "the body turns {turns:.2} times within the data: the period rests on the shape of less than a turn"
        ));
    }
    // By how much the body turns while a sample is exposed.
    let blur = searched
        .forward
        .moments
        .iter()
        .map(|m| m.exposure_s * minima[0].turn.turns_per_s.abs() * 360.0)
        .fold(0.0, f64::max);
    if blur > 5.0 {
        warnings.push(format!(
            "the body turns by {blur:.0}° within an exposure; samples are compared with the middle of theirs"
        ));
    }
    if taken < all.len() {
        warnings.push(format!("of {} epochs {taken} were taken, evenly spread", all.len()));
    }
    if reduced_chi2 > POOR_CHI2 {
        warnings.push(format!(
            "reduced chi-square is {reduced_chi2:.2}: residuals have longer tails than noise; another attitude, or what the scene does not know of the body, may be behind that"
        ));
    }
    if alike > 1.0 {
        warnings.push(format!(
            "neighbouring samples and channels are off alike: what is left over counts as {alike:.1} times fewer samples, and uncertainties and probabilities allow for it; the scene lacks something of the body, or this is not its attitude"
        ));
    }
    let verdict = if unknowns.period && turns < 1.0 && alike > 1.0 {
        Verdict::Undetermined(format!(
            "the body turns {turns:.2} times within the data, and the best attitude leaves {:.1} % of the light over in ways that are alike from sample to sample: with so little of a turn another attitude may fit as well what the scene does not know; a longer pass, or several, would decide",
            100.0 * searched.extra
        ))
    } else {
        verdict(&minima, unknowns.count(), searched.extra, reduced_chi2)
    };
    Ok(Answer {
        verdict,
        samples: samples.len(),
        epochs: all.len(),
        epochs_taken: taken,
        minima,
        reduced_chi2,
        correlation: alike,
        extra_noise: searched.extra,
        span_s,
        turns,
        surface: searched.surface,
        symmetries: searched.symmetries,
        periods: searched.rates,
        simulated: searched.simulated,
        finer: searched.finer,
        other_light: searched.other_light,
        best: samples,
        moments: searched.forward.moments.iter().map(|m| (m.curve, m.sample)).collect(),
        law,
        warnings,
    })
}

/// Returns the factor by which the variance of sums over blocks of neighbouring epochs, all channels together, exceeds that of independent residuals (batch means), or of the noise where residuals are
/// smaller than that; 1 where chance would do.
///
/// Model errors are alike in all channels and from one epoch to the next; counted as noise of independent samples, they would make a wrong attitude certain.
fn correlation(samples: &[Sample], extra: f64) -> f64 {
    let mut epochs: Vec<(usize, f64)> = Vec::new();
    let mut all = 0.0;
    for s in samples {
        let residual =
            ((s.rate - s.model) / s.sigma.hypot(extra * s.model)).clamp(-OUTLIER, OUTLIER);
        all += residual * residual;
        match epochs.last_mut() {
            Some((moment, sum)) if *moment == s.moment => *sum += residual,
            _ => epochs.push((s.moment, residual)),
        }
    }
    let block = (epochs.len() / BLOCKS).max(1);
    let blocks = epochs.chunks_exact(block);
    let count = blocks.len() as f64;
    if epochs.len() < BLOCKS || all <= 0.0 {
        return 1.0;
    }
    // Of all residuals those of the last, short block are left out above the line only.
    let squares: f64 = blocks.map(|b| b.iter().map(|e| e.1).sum::<f64>().powi(2)).sum();
    let ratio = squares / all.max(samples.len() as f64);
    let chance = 1.0 + CHANCE * (2.0 / count).sqrt();
    if ratio > chance { ratio } else { 1.0 }
}

fn verdict(minima: &[Minimum], unknowns: usize, extra: f64, reduced_chi2: f64) -> Verdict {
    let best = &minima[0];
    if extra > NO_MODEL {
        return Verdict::Undetermined(format!(
            "no attitude that was tried has the light that was measured: {:.0} % of it are left over",
            100.0 * extra
        ));
    }
    if reduced_chi2 > NO_FIT {
        return Verdict::Undetermined(format!(
            "no attitude that was tried has the light that was measured: beside the middle residuals there are so many large ones that the reduced chi-square is {reduced_chi2:.1}; a longer pass, or what the scene does not know of the body, would decide"
        ));
    }
    let known = best.covariance.iter().enumerate().filter(|(i, r)| r[*i].sqrt() < UNDETERMINED);
    let loose = known.count() < unknowns;
    if loose {
        return Verdict::Undetermined(
            "the light hardly changes with some turn of the body: too little was seen of it".into(),
        );
    }
    if best.probability >= ALONE {
        return Verdict::One;
    }
    Verdict::Several(minima.iter().filter(|m| m.probability > EXCLUDED).count())
}

impl Answer {
    /// Whether more is left over than noise: too much of the light, more outliers than noise has, or what is alike in neighbouring samples.
    fn is_poor(&self) -> bool {
        self.extra_noise > POOR_EXTRA || self.reduced_chi2 > POOR_CHI2 || self.correlation > 1.0
    }

    /// Factors of the brightness by name: channels or materials in their order.
    pub fn scale_names(scale: Scale, channels: &[String], materials: &[String]) -> Vec<String> {
        match scale {
            Scale::None => Vec::new(),
            Scale::Grey => vec!["all".into()],
            Scale::Channels => channels.to_vec(),
            Scale::Materials => materials.to_vec(),
        }
    }
}
