//! A night's calibration.

use super::bootstrap::{Method, intervals};
use super::checks::{AIRMASS_RANGE, Slopes, coverage, ratios, slopes};
use super::consensus::{Choice, Group, consensus};
use super::gls::{Model, Normal, Scatter, Solution, fit};
use super::sample::{Sample, check, samples, stars};
use super::{Options, RatioCheck, Slope, StarsError, Visit, scatter};
use nalgebra::DMatrix;

/// A night's coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct Night {
    /// By channel, in the order of the visits' channels; a text says why there is none.
    pub channels: Vec<Result<ChannelKappa, String>>,
    /// Covariance of ln κ between the channels; `NaN` where a channel has none.
    pub covariance: Vec<Vec<f64>>,
    /// Judgement of each visit.
    pub visits: Vec<Judgement>,
    /// Stars that could decide.
    pub stars: usize,
    /// Those that agree.
    pub agreeing: usize,
    /// Probability of this choice of visits that agree, among those next to it. The others are in σ, covariance and intervals.
    pub agreement_probability: f64,
    /// Relative scatter of stars common to all channels (magnitudes, thin cloud), the floor at least.
    pub common_scatter: f64,
    /// Lowest, mean and highest airmass of those that agree. κ is that of the mean.
    pub airmass: [f64; 3],
    /// Lowest, mean and highest B−V of those that agree.
    pub b_minus_v_mag: Option<[f64; 3]>,
    /// Whether the stars depend on airmass so much that they were judged about a slope: κ is then that of the mean airmass only.
    pub sloped: bool,
    /// How the intervals were found: by `bootstrap` over stars, by `student` where there are too few for it, or `mixed` where there are too few in some channels.
    pub method: &'static str,
    /// An aerosol's depth, where it was asked for.
    pub aerosol: Option<Aerosol>,
    /// The ratios of the channels to the one that is known best.
    pub ratios: Vec<RatioCheck>,
}

/// A channel's coefficient.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelKappa {
    /// κ: predicted = κ · measured.
    pub kappa: f64,
    /// Standard uncertainty of ln κ.
    pub relative_sigma: f64,
    /// The interval of κ at the stated confidence.
    pub interval: (f64, f64),
    /// Visits that went in.
    pub visits: usize,
    /// Stars that went in.
    pub stars: usize,
    /// Root mean square of their ln(predicted/(κ · measured)).
    pub rms: f64,
    /// Relative scatter that is the channel's own, the floor at least.
    pub own_scatter: f64,
    /// Slope of ln(predicted/measured) per airmass, or why there is none: the extinction that the prediction lacks.
    pub per_airmass: Result<Slope, String>,
    /// The same per magnitude of B−V: a sensitivity whose shape is off.
    pub per_colour: Result<Slope, String>,
}

/// An aerosol's optical depth fitted with κ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aerosol {
    /// Optical depth to add to the depth that the prediction had.
    pub depth: f64,
    /// Standard uncertainty of the depth.
    pub sigma: f64,
}

/// Judgement of a visit.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// Whether it agrees and went into κ. A visit that may not decide is judged all the same, and never goes in.
    pub agrees: bool,
    /// Whether it could decide: its spectrum is no guess, and something of it was measured.
    pub decides: bool,
    /// Common offset of ln(predicted/(κ · measured)) of its channels: 0.36 is dimmed by 30 %. `NaN` where nothing was measured.
    pub offset: f64,
    /// Standard deviation that is expected of it.
    pub sigma: f64,
    /// By channel: ln(predicted/(κ · measured)), `None` where it was not measured or is too noisy.
    pub residuals: Vec<Option<f64>>,
}

/// Rounds in which κ tells the expected counts, which tell the weights, which tell κ.
const ROUNDS: usize = 3;
/// χ² of the slopes over what one in a thousand exceeds is taken as a slope; this is for one channel, and grows with their number.
const SLOPE_CHI2: [f64; 6] = [10.83, 13.82, 16.27, 18.47, 20.52, 22.46];
/// Least range of airmasses that an aerosol's fit needs, and the largest uncertainty of its depth.
const AEROSOL_AIRMASS_RANGE: f64 = 0.5;
const AEROSOL_WORST_SIGMA: f64 = 0.1;

/// One κ a channel from the visits of a night.
///
/// # Errors
/// Input or options that cannot be; too few stars; none or two groups that agree; an aerosol that cannot be told.
pub fn calibrate(visits: &[Visit], options: &Options) -> Result<Night, StarsError> {
    let channels = check(visits, options)?;
    let mut ln_kappa: Option<Vec<f64>> = None;
    let mut fitted = None;
    for _ in 0..ROUNDS {
        let samples = samples(visits, ln_kappa.as_deref());
        let night = Fitted::new(samples, visits.len(), channels, options)?;
        ln_kappa = Some(night.ln_kappa());
        fitted = Some(night);
    }
    // There is at least one round.
    fitted.map_or(Err(too_few(0, visits.len(), options)), |f| f.night(visits, options))
}

fn too_few(found: usize, left_out: usize, options: &Options) -> StarsError {
    StarsError::TooFewStars { found, needed: options.fewest_stars, left_out }
}

/// The visits that agree, and what was fitted to them.
struct Fitted {
    samples: Vec<Sample>,
    group: Group,
    model: Model,
    scatter: Scatter,
    solution: Solution,
    normals: Vec<Normal>,
    slopes: Slopes,
    sloped: bool,
    probability: f64,
    /// Covariance of the parameters by which visits agree: other choices beside this one.
    by_choice: DMatrix<f64>,
}

impl Fitted {
    fn new(
        samples: Vec<Sample>,
        visits: usize,
        channels: usize,
        options: &Options,
    ) -> Result<Self, StarsError> {
        let found = stars(&samples);
        if found < options.fewest_stars {
            return Err(too_few(found, visits - samples.len(), options));
        }
        let (Choice { group, probability, rivals }, sloped) = group(&samples, channels, options)?;
        let found = slopes(&members(&samples, &group), &group.scatter);
        let agreeing = members(&samples, &group);
        let model = Model { aerosol: options.fit_aerosol, ..Model::plain(channels) };
        if options.fit_aerosol {
            can_fit_aerosol(&agreeing)?;
        }
        let unsolvable =
            || too_few(stars(agreeing.iter().copied()), visits - agreeing.len(), options);
        let (solution, scatter) =
            settle(&agreeing, &model, &group, options).ok_or_else(unsolvable)?;
        let (normals, solution) =
            fit(agreeing.iter().copied(), &scatter, &model).unwrap_or((Vec::new(), solution));
        let by_choice = by_choice(&rivals, &samples, &solution, &model, options);
        Ok(Self {
            model,
            scatter,
            solution,
            normals,
            slopes: found,
            sloped,
            group,
            samples,
            probability,
            by_choice,
        })
    }

    fn ln_kappa(&self) -> Vec<f64> {
        self.solution.parameters.iter().take(self.model.channels).copied().collect()
    }

    /// Covariance of two parameters: by the visits that agree, and by which do.
    fn covariance(&self, i: usize, j: usize) -> f64 {
        self.solution.covariance[(i, j)] + self.by_choice[(i, j)]
    }

    fn night(self, visits: &[Visit], options: &Options) -> Result<Night, StarsError> {
        let agreeing = members(&self.samples, &self.group);
        let aerosol = self.aerosol()?;
        let ln_kappa = self.ln_kappa();
        let (intervals, method) =
            intervals(&self.normals, &self.solution, &self.by_choice, self.model.channels, options);
        let channels: Vec<_> = intervals
            .iter()
            .enumerate()
            .map(|(c, interval)| self.channel(c, *interval, &agreeing, options))
            .collect();
        let covariance = (0..self.model.channels)
            .map(|i| (0..self.model.channels).map(|j| self.covariance(i, j)).collect())
            .collect();
        let best = (0..self.model.channels)
            .filter(|c| channels[*c].is_ok())
            .min_by(|a, b| {
                let sigma = |c: usize| self.covariance(c, c);
                sigma(*a).total_cmp(&sigma(*b))
            })
            .unwrap_or(0);
        let method = match method {
            Method::Bootstrap => "bootstrap",
            Method::Student => "student",
            Method::Mixed => "mixed",
        };
        Ok(Night {
            covariance,
            visits: self.judge(visits, &ln_kappa),
            stars: stars(&self.samples),
            agreeing: stars(agreeing.iter().copied()),
            agreement_probability: self.probability,
            common_scatter: self.group.scatter.common.sqrt(),
            airmass: coverage(agreeing.iter().map(|s| s.airmass)).unwrap_or([f64::NAN; 3]),
            b_minus_v_mag: coverage(agreeing.iter().filter_map(|s| s.colour)),
            sloped: self.sloped,
            method,
            aerosol,
            ratios: ratios(&agreeing, &self.scatter, best),
            channels,
        })
    }

    fn aerosol(&self) -> Result<Option<Aerosol>, StarsError> {
        if !self.model.aerosol {
            return Ok(None);
        }
        let i = self.model.parameters() - 1;
        let (depth, sigma) = (self.solution.parameters[i], self.covariance(i, i).sqrt());
        if sigma.is_nan() || sigma > AEROSOL_WORST_SIGMA {
            let why = format!(
                "it would be {depth:.2} ± {sigma:.2}, and must be known to {AEROSOL_WORST_SIGMA}: more stars, or a wider range of airmass"
            );
            return Err(StarsError::Aerosol { why });
        }
        Ok(Some(Aerosol { depth, sigma }))
    }

    fn channel(
        &self,
        c: usize,
        (below, above): (f64, f64),
        agreeing: &[&Sample],
        options: &Options,
    ) -> Result<ChannelKappa, String> {
        let used: Vec<&Sample> =
            agreeing.iter().copied().filter(|s| s.points[c].is_some()).collect();
        let count = stars(used.iter().copied());
        if count < options.fewest_stars {
            let needed = options.fewest_stars;
            return Err(format!("{count} star(s) that agree were measured, {needed} are needed"));
        }
        let ln_kappa = self.solution.parameters[c];
        let square: f64 = used
            .iter()
            .filter_map(|s| {
                Some((s.points[c]?.y - self.model.value(&self.solution.parameters, s, c)).powi(2))
            })
            .sum();
        let slope = |slopes: &Result<Vec<Option<Slope>>, String>| match slopes {
            Ok(slopes) => slopes[c].ok_or_else(|| "not measured".to_owned()),
            Err(why) => Err(why.clone()),
        };
        Ok(ChannelKappa {
            kappa: ln_kappa.exp(),
            relative_sigma: self.covariance(c, c).sqrt(),
            interval: ((ln_kappa - below).exp(), (ln_kappa + above).exp()),
            visits: used.len(),
            stars: count,
            rms: (square / used.len() as f64).sqrt(),
            own_scatter: self.scatter.own[c].sqrt(),
            per_airmass: slope(&self.slopes.airmass),
            per_colour: slope(&self.slopes.colour),
        })
    }

    /// All visits against κ, those that may not decide too.
    fn judge(&self, visits: &[Visit], ln_kappa: &[f64]) -> Vec<Judgement> {
        let as_if: Vec<Visit> =
            visits.iter().map(|v| Visit { decides: true, ..v.clone() }).collect();
        let all = samples(&as_if, Some(ln_kappa));
        let judgement = |(number, visit): (usize, &Visit)| {
            let Some(sample) = all.iter().find(|s| s.visit == number) else {
                let residuals = vec![None; visit.channels.len()];
                let (offset, sigma) = (f64::NAN, f64::NAN);
                return Judgement { agrees: false, decides: false, offset, sigma, residuals };
            };
            let place = self.samples.iter().position(|s| s.visit == number);
            let residual = |(c, p): (usize, &Option<super::sample::Point>)| {
                let model = self.model.value(&self.solution.parameters, sample, c);
                p.map(|p| p.y - model).filter(|r| r.is_finite())
            };
            let residuals: Vec<_> = sample.points.iter().enumerate().map(residual).collect();
            let split = scatter::split(&residuals, sample, &self.group.scatter.own);
            let variance = self.group.scatter.common + sample.scintillation + split.own_variance;
            Judgement {
                agrees: place.is_some_and(|i| self.group.agrees[i]),
                decides: visit.decides && place.is_some(),
                offset: split.offset,
                sigma: variance.sqrt(),
                residuals,
            }
        };
        visits.iter().enumerate().map(judgement).collect()
    }
}

/// The visits that agree: on one κ, or where that explains more than chance could, on one κ and a slope against airmass; and which of the two.
fn group(
    samples: &[Sample],
    channels: usize,
    options: &Options,
) -> Result<(Choice, bool), StarsError> {
    if options.fit_aerosol {
        // Haze parts high stars from low ones: who asks for its depth wants them judged with it.
        can_fit_aerosol(&samples.iter().collect::<Vec<_>>())?;
        let model = Model { aerosol: true, ..Model::plain(channels) };
        return Ok((consensus(samples, &model, options)?, false));
    }
    let plain = consensus(samples, &Model::plain(channels), options);
    let Some([low, mean, high]) = coverage(samples.iter().map(|s| s.airmass)) else {
        return Ok((plain?, false));
    };
    if high - low < AIRMASS_RANGE {
        return Ok((plain?, false));
    }
    // About a slope the scatter is that of the stars, not that of their airmasses: only there a slope can be told from none.
    let model = Model { airmass: Some(mean), ..Model::plain(channels) };
    let Ok(other) = consensus(samples, &model, options) else { return Ok((plain?, false)) };
    let limit = SLOPE_CHI2[channels.clamp(1, SLOPE_CHI2.len()) - 1];
    let about = slopes(&members(samples, &other.group), &other.group.scatter);
    let price = channels as f64 * (samples.len() as f64).ln();
    let better = match &plain {
        Ok(plain) => other.group.deviance(samples) + price < plain.group.deviance(samples),
        // Two groups are not made one by a slope: clouds come and go with the airmass too.
        Err(error) => !matches!(error, StarsError::Ambiguous { .. }),
    };
    if about.airmass_chi2 > limit && better { Ok((other, true)) } else { Ok((plain?, false)) }
}

fn members<'a>(samples: &'a [Sample], group: &Group) -> Vec<&'a Sample> {
    samples.iter().zip(&group.agrees).filter(|(_, good)| **good).map(|(s, _)| s).collect()
}

/// Covariance by which visits agree: distances of the other choices' parameters from these, by their probabilities.
fn by_choice(
    rivals: &[(Group, f64)],
    samples: &[Sample],
    solution: &Solution,
    model: &Model,
    options: &Options,
) -> DMatrix<f64> {
    let n = model.parameters();
    let mut covariance = DMatrix::zeros(n, n);
    for (group, probability) in rivals {
        let Some((other, _)) = settle(&members(samples, group), model, group, options) else {
            continue;
        };
        // A channel that only one of both has tells nothing of their difference.
        let away =
            (other.parameters - &solution.parameters).map(|d| if d.is_finite() { d } else { 0.0 });
        covariance.ger(*probability, &away, &away, 1.0);
    }
    covariance
}

/// Fits, with the scatter that is left about the fit.
fn settle(
    agreeing: &[&Sample],
    model: &Model,
    group: &Group,
    options: &Options,
) -> Option<(Solution, Scatter)> {
    let least = scatter::floor(options.floor, model.channels);
    let mut scatter = group.scatter.clone();
    let mut solution = None;
    for _ in 0..4 {
        let (_, found) = fit(agreeing.iter().copied(), &scatter, model)?;
        let residual = |s: &&Sample| {
            let of = |(c, p): (usize, &Option<super::sample::Point>)| {
                p.map(|p| p.y - model.value(&found.parameters, s, c)).filter(|r| r.is_finite())
            };
            s.points.iter().enumerate().map(of).collect::<Vec<_>>()
        };
        let residuals: Vec<_> = agreeing.iter().map(residual).collect();
        scatter = scatter::estimate(agreeing, &residuals, &least, model.per_channel());
        solution = Some(found);
    }
    Some((solution?, scatter))
}

fn can_fit_aerosol(agreeing: &[&Sample]) -> Result<(), StarsError> {
    let refuse = |why: String| Err(StarsError::Aerosol { why });
    if agreeing.iter().any(|s| s.points.iter().flatten().any(|p| p.per_depth.is_none())) {
        return refuse("the predictions do not say how they depend on it".into());
    }
    match coverage(agreeing.iter().map(|s| s.airmass)) {
        Some([low, _, high]) if high - low >= AEROSOL_AIRMASS_RANGE => Ok(()),
        Some([low, _, high]) => refuse(format!(
            "the stars that agree stand at airmasses from {low:.2} to {high:.2}, a range of {AEROSOL_AIRMASS_RANGE} is needed to tell it from kappa"
        )),
        None => refuse("no star agrees".into()),
    }
}
