//! Channels over one another: what neither size nor distance of the target changes.

use super::Channel;
use super::blocks::{Blocks, jackknife};
use super::channel::Given;
use std::ops::Range;

/// A channel over the reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Ratio {
    /// The channel.
    pub channel: String,
    /// The one that it is divided by.
    pub reference: String,
    /// The measured ratio over the simulated one: the quotient of the scales.
    pub scale: f64,
    /// Standard uncertainty of the ratio from the samples' σ; `None` where a sample has none.
    pub sigma: Option<f64>,
    /// Standard uncertainty from the scatter of blocks of time: what both channels share (twinkling, clouds) is not in it.
    pub sigma_blocks: Option<f64>,
    /// Relative uncertainty of the ratio from κ; `None` where that is not known.
    pub common_sigma: Option<f64>,
    /// Course of the ratio in time.
    pub moments: Vec<Moment>,
}

/// A ratio in a stretch of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Rows of the stretch.
    pub rows: Range<usize>,
    /// Measured light of one over that of the other, means over the samples of each.
    pub measured: f64,
    /// Standard uncertainty of the measured ratio from the samples' σ.
    pub sigma: Option<f64>,
    /// The same of the simulated light, over the same samples.
    pub simulated: f64,
}

impl Ratio {
    /// Finds the ratio of a channel to the reference, over stretches of rows. `None` where one has no numbers. `common_sigma` is the relative uncertainty of κ's quotient.
    pub fn new(
        (given, channel): (&Given<'_>, &Channel),
        (other, reference): (&Given<'_>, &Channel),
        blocks: &Blocks,
        stretches: &[Range<usize>],
        common_sigma: Option<f64>,
    ) -> Option<Self> {
        let (a, b) = (channel.numbers.as_ref()?, reference.numbers.as_ref()?);
        let scale = a.scale / b.scale;
        let relative = |sigma: Option<f64>, scale: f64| sigma.map(|s| s / scale);
        let sigma = relative(a.scale_sigma, a.scale)
            .zip(relative(b.scale_sigma, b.scale))
            .map(|(x, y)| scale * x.hypot(y));
        // Rows of both, so that a block is left out of both together.
        let both: Vec<usize> =
            (0..channel.used.len()).filter(|i| channel.used[*i] || reference.used[*i]).collect();
        let quotient = |rows: &mut dyn Iterator<Item = usize>| {
            let rows: Vec<usize> = rows.collect();
            let of = |g: &Given<'_>, c: &Channel| {
                g.quotient(rows.iter().copied().filter(|i| c.used[*i]))
            };
            of(given, channel) / of(other, reference)
        };
        let sigma_blocks = jackknife(blocks, &both, &quotient);
        let moments = stretches.iter().filter_map(|rows| {
            let mean = |g: &Given<'_>, c: &Channel| {
                let own = || rows.clone().filter(|i| c.used[*i]);
                let exposed: f64 = own().map(|i| g.exposure_s[i]).sum();
                let (light, model) = g.sums(own());
                let sigma = g.sigma_of_sum(own()).map(|s| s / light);
                (exposed > 0.0 && model > 0.0).then_some((light / exposed, model / exposed, sigma))
            };
            let (x, y) = (mean(given, channel)?, mean(other, reference)?);
            let measured = x.0 / y.0;
            measured.is_finite().then(|| Moment {
                rows: rows.clone(),
                measured,
                sigma: x.2.zip(y.2).map(|(p, q)| measured.abs() * p.hypot(q)),
                simulated: x.1 / y.1,
            })
        });
        let moments = moments.collect();
        Some(Self {
            channel: channel.name.clone(),
            reference: reference.name.clone(),
            scale,
            sigma,
            sigma_blocks,
            common_sigma,
            moments,
        })
    }
}
