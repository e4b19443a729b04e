//! Residuals against an angle, an airmass, a time.

use super::Channel;
use super::channel::Given;

/// Quantity by which residuals are put into bins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Phase angle, degrees.
    Phase,
    /// Airmass.
    Airmass,
}

/// The samples of a channel in a stretch of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Where the stretch begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// Samples in it.
    pub samples: usize,
    /// Measured over simulated light in it, over the channel's scale: 1 where the model has the course right.
    pub ratio: f64,
    /// Standard uncertainty of the ratio from the samples' σ; `None` where a sample has none.
    pub sigma: Option<f64>,
}

/// Edges of bins over some values: round numbers (1, 2, 5 · 10ᵏ apart), at most `most` bins. Empty of values that are all the same.
pub fn edges(values: &[f64], most: usize) -> Vec<f64> {
    let good = || values.iter().copied().filter(|v| v.is_finite());
    let (low, high) =
        (good().fold(f64::INFINITY, f64::min), good().fold(f64::NEG_INFINITY, f64::max));
    if high.is_nan() || high <= low || most == 0 {
        return Vec::new();
    }
    let raw = (high - low) / most as f64;
    let power = 10_f64.powf(raw.log10().floor());
    let count = |step: f64| ((high / step).ceil() - (low / step).floor()) as usize;
    let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0].map(|m| m * power);
    let step = steps.into_iter().find(|s| count(*s) <= most).unwrap_or(100.0 * power);
    let first = (low / step).floor();
    (0..=count(step)).map(|k| (first + k as f64) * step).collect()
}

/// A channel's residuals in bins; those without a sample are left out. `values` has one entry a sample.
pub fn bins(given: &Given<'_>, channel: &Channel, values: &[f64], edges: &[f64]) -> Vec<Bin> {
    let Some(numbers) = &channel.numbers else { return Vec::new() };
    let bin = |(k, ends): (usize, &[f64])| {
        let last = k + 2 == edges.len();
        let within = |v: f64| v >= ends[0] && (v < ends[1] || last && v <= ends[1]);
        let own: Vec<usize> =
            (0..values.len()).filter(|i| channel.used[*i] && within(values[*i])).collect();
        let (_, model) = given.sums(own.iter().copied());
        (!own.is_empty() && numbers.scale * model > 0.0).then(|| Bin {
            from: ends[0],
            to: ends[1],
            samples: own.len(),
            ratio: given.quotient(own.iter().copied()) / numbers.scale,
            sigma: given.sigma_of_quotient(&own).map(|s| s / numbers.scale),
        })
    };
    edges.windows(2).enumerate().filter_map(bin).collect()
}
