//! Checks of what the fit leaves: slopes against airmass and colour, ratios of channels, the variation over nights.

use super::gls::{Model, Scatter, fit};
use super::sample::{Sample, stars};

/// A slope, with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// Change of ln(predicted/measured) per unit.
    pub value: f64,
    /// Standard uncertainty of the slope.
    pub sigma: f64,
}

impl Slope {
    /// Value and uncertainty in words, %.
    pub fn percent(&self) -> String {
        format!("{:+.1} ± {:.1} %", 100.0 * self.value, 100.0 * self.sigma)
    }

    /// How many standard deviations it is from 0.
    pub fn significance(&self) -> f64 {
        self.value.abs() / self.sigma
    }
}

/// How a channel counts beside the reference channel: a check of linearity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RatioCheck {
    /// The channel.
    pub channel: usize,
    /// The one that it is compared with: the best known.
    pub reference: usize,
    /// Visits that measured both.
    pub visits: usize,
    /// Exponent of the measured ratio against the predicted one: 1 where colours come out right. `None` where the ratios are all alike.
    pub exponent: Option<Slope>,
    /// Change of ln(measured ratio/predicted ratio) per factor e in brightness: 0 where both are linear. `None` where all are equally bright.
    pub by_brightness: Option<Slope>,
}

/// The variation of a coefficient over nights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variation {
    /// Nights.
    pub nights: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation over the nights (divided by their number, as published tables have it) over the mean.
    pub coefficient: f64,
}

/// Mean and coefficient of variation of a channel's κ over nights; `None` of fewer than two.
pub fn variation(kappas: &[f64]) -> Option<Variation> {
    let nights = kappas.len();
    if nights < 2 {
        return None;
    }
    let mean = kappas.iter().sum::<f64>() / nights as f64;
    let square = kappas.iter().map(|k| (k - mean).powi(2)).sum::<f64>() / nights as f64;
    Some(Variation { nights, mean, coefficient: square.sqrt() / mean })
}

/// Slopes are fitted where the airmasses, the colours reach over this.
pub(super) const AIRMASS_RANGE: f64 = 0.2;
const COLOUR_RANGE_MAG: f64 = 0.3;
const FEWEST_STARS: usize = 5;

/// The slopes of all channels; a text says why there is none.
#[derive(Debug, Clone)]
pub(super) struct Slopes {
    pub airmass: Result<Vec<Option<Slope>>, String>,
    pub colour: Result<Vec<Option<Slope>>, String>,
    /// χ² of all airmass slopes together against none, with the channels' number.
    pub airmass_chi2: f64,
}

/// Lowest, mean, highest.
pub(super) fn coverage(values: impl IntoIterator<Item = f64>) -> Option<[f64; 3]> {
    let values: Vec<f64> = values.into_iter().collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let low = values.iter().copied().reduce(f64::min)?;
    let high = values.iter().copied().reduce(f64::max)?;
    Some([low, mean, high])
}

/// Fits both slopes together where both can be told, and alone where one can.
pub(super) fn slopes(samples: &[&Sample], scatter: &Scatter) -> Slopes {
    let channels = scatter.own.len();
    let airmass = coverage(samples.iter().map(|s| s.airmass));
    let colour = coverage(samples.iter().filter_map(|s| s.colour));
    let wide = |range: Option<[f64; 3]>, least: f64, what: &str| match range {
        _ if stars(samples.iter().copied()) < FEWEST_STARS => {
            Err(format!("fewer than {FEWEST_STARS} stars agree"))
        }
        None => Err(format!("no {what} is known")),
        Some([low, mean, high]) if high - low >= least => Ok(mean),
        Some([low, _, high]) => Err(format!(
            "the {what} reaches from {low:.2} to {high:.2}: less than {least} tells no slope"
        )),
    };
    let airmass = wide(airmass, AIRMASS_RANGE, "airmass");
    let colour = wide(colour, COLOUR_RANGE_MAG, "colour B-V");
    let model = Model {
        airmass: airmass.as_ref().ok().copied(),
        colour: colour.as_ref().ok().copied(),
        ..Model::plain(channels)
    };
    let found = fit(samples.iter().copied(), scatter, &model);
    let unsolved = || "airmass and colour cannot be told apart".to_owned();
    let stride = model.per_channel();
    let pick = |place: usize| {
        let (_, solution) = found.as_ref().ok_or_else(unsolved)?;
        let slope = |c: usize| {
            let i = c * stride + place;
            let (value, sigma) = (solution.parameters[i], solution.covariance[(i, i)].sqrt());
            (value.is_finite() && sigma.is_finite()).then_some(Slope { value, sigma })
        };
        Ok((0..channels).map(slope).collect())
    };
    let mut airmass_chi2 = 0.0;
    if let (Ok(_), Some((_, solution))) = (&airmass, &found) {
        let known: Vec<usize> = (0..channels)
            .map(|c| c * stride + 1)
            .filter(|i| solution.parameters[*i].is_finite())
            .collect();
        let covariance = solution.covariance.select_rows(&known).select_columns(&known);
        let slopes = solution.parameters.select_rows(&known);
        if let Some(inverse) = covariance.cholesky() {
            airmass_chi2 = slopes.dot(&inverse.solve(&slopes));
        }
    }
    Slopes {
        colour: colour.and_then(|_| pick(1 + usize::from(airmass.is_ok()))),
        airmass: airmass.and_then(|_| pick(1)),
        airmass_chi2,
    }
}

/// The ratio of every channel to the reference.
pub(super) fn ratios(samples: &[&Sample], scatter: &Scatter, reference: usize) -> Vec<RatioCheck> {
    let channels = scatter.own.len();
    (0..channels)
        .filter(|c| *c != reference)
        .map(|channel| {
            let pairs: Vec<[f64; 4]> = samples
                .iter()
                .filter_map(|s| {
                    let (a, b) = (s.points[channel]?, s.points[reference]?);
                    let variance =
                        a.counts + b.counts + scatter.own[channel] + scatter.own[reference];
                    let brightness = 0.5 * (a.ln_predicted + b.ln_predicted);
                    // ln of the measured ratio over the predicted one.
                    let excess = b.y - a.y;
                    Some([a.ln_predicted - b.ln_predicted, brightness, excess, variance])
                })
                .collect();
            let slope =
                |column: usize| line(pairs.iter().map(|p| (p[column], p[2], p[3])).collect());
            let exponent = slope(0).map(|s| Slope { value: 1.0 + s.value, ..s });
            RatioCheck {
                channel,
                reference,
                visits: pairs.len(),
                exponent,
                by_brightness: slope(1),
            }
        })
        .collect()
}

/// The slope of a weighted straight line through (x, y, variance of y); `None` of fewer than four, or where x spreads less than a tenth.
fn line(points: Vec<(f64, f64, f64)>) -> Option<Slope> {
    let range = coverage(points.iter().map(|p| p.0))?;
    if points.len() < 4 || range[2] - range[0] < 0.1 {
        return None;
    }
    let weight: f64 = points.iter().map(|p| 1.0 / p.2).sum();
    let x: f64 = points.iter().map(|p| p.0 / p.2).sum::<f64>() / weight;
    let y: f64 = points.iter().map(|p| p.1 / p.2).sum::<f64>() / weight;
    let square: f64 = points.iter().map(|p| (p.0 - x).powi(2) / p.2).sum();
    let cross: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y) / p.2).sum();
    Some(Slope { value: cross / square, sigma: square.recip().sqrt() })
}
