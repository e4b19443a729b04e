//! The background of an aperture: the median of what is left of an annulus after clipping, with its uncertainty.

/// The level between the sources of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background {
    /// Level of a pixel, ADU: the mean that the clipped median stands for.
    pub level_adu: f64,
    /// Standard error of the level, ADU.
    pub level_sigma_adu: f64,
    /// Scatter of a single pixel (sky, read-out, dark current, what the darks did not take off), ADU.
    pub pixel_sigma_adu: f64,
    /// Pixels that remained.
    pub pixels: usize,
    /// Pixels that were clipped.
    pub clipped: usize,
}

/// How the annulus is clipped, and what is known of its pixels' distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Clipping {
    /// Standard deviations from the median beyond which a pixel does not count.
    pub sigma: f64,
    /// Rounds at most.
    pub rounds: usize,
    /// Electrons per ADU and read-out noise, e⁻, for the skew of a Poisson distribution; `None` leaves the median as it is.
    pub gain_and_read_noise: Option<(f64, f64)>,
    /// Step of the values: 1 for counts as they were read, 0 after a division by a flat or the subtraction of a mean.
    pub step_adu: f64,
}

/// The background of these values, which are sorted on the way; `None` of fewer than three.
///
/// Three things that a plain median gets wrong over the 200 pixels of an aperture: counts are whole numbers (the median of a step is taken
/// within the step, as of grouped data), a Poisson distribution leans (its median is up to 1/6 e⁻ below its mean), and clipping it
/// on both sides alike lowers it further. Scatter is half the distance between the quantiles of ±1 σ.
pub(crate) fn clipped_median(values: &mut [f32], clipping: &Clipping) -> Option<Background> {
    values.sort_unstable_by(f32::total_cmp);
    let mut kept = &values[..];
    if kept.len() < 3 {
        return None;
    }
    let step = clipping.step_adu;
    // A width of no pixel can be told below the rounding of whole counts: its standard deviation, step/√12.
    let least = step * 12f64.sqrt().recip();
    let measure = |kept: &[f32]| {
        let sigma =
            0.5 * (quantile(kept, 0.841_344_746, step) - quantile(kept, 0.158_655_254, step));
        (quantile(kept, 0.5, step), sigma.max(least))
    };
    let (mut median, mut sigma) = measure(kept);
    for _ in 0..clipping.rounds {
        let reach = clipping.sigma * sigma + 0.5 * step;
        let from = kept.partition_point(|&v| f64::from(v) < median - reach);
        let to = kept.partition_point(|&v| f64::from(v) <= median + reach);
        if to - from == kept.len() || to - from < 3 {
            break;
        }
        kept = &kept[from..to];
        (median, sigma) = measure(kept);
    }
    let count = kept.len() as f64;
    let lean = clipping.gain_and_read_noise.map_or(0.0, |(gain, read_noise)| {
        lean_adu(sigma * sigma - least * least, gain, read_noise, clipping.sigma)
    });
    Some(Background {
        level_adu: median + lean,
        // Of a median of normal values: √(π/2) σ/√n.
        level_sigma_adu: (std::f64::consts::FRAC_PI_2 / count).sqrt() * sigma,
        pixel_sigma_adu: sigma,
        pixels: kept.len(),
        clipped: values.len() - kept.len(),
    })
}

/// Mean minus clipped median of a pixel with this variance, ADU, to first order in its skewness (Cornish & Fisher 1938): the median of a
/// distribution with third moment μ₃ is δ = μ₃/6σ² below the mean. Clipping at ±zσ about the mean takes more from the longer tail and lowers it by
/// (z²−1)Eδ further, E = exp(−z²/2); and the limits lie about the median s below the mean, not about the mean, which lowers it by E s, round after
/// round: s = δ + (z²−1)Eδ + E s.
fn lean_adu(variance_adu2: f64, gain_e_per_adu: f64, read_noise_e: f64, clip_sigma: f64) -> f64 {
    let variance_e2 = variance_adu2 * gain_e_per_adu * gain_e_per_adu;
    if variance_e2 <= 0.0 {
        return 0.0;
    }
    // The Poisson part of the variance is its third moment, too.
    let poisson = (variance_e2 - read_noise_e * read_noise_e).max(0.0);
    let z2 = clip_sigma * clip_sigma;
    let edge = (-0.5 * z2).exp();
    let clipping = (1.0 + (z2 - 1.0).max(0.0) * edge) / (1.0 - edge);
    poisson / (6.0 * variance_e2) * clipping / gain_e_per_adu
}

/// The quantile of sorted values. With a step, equal values are spread evenly over it (the quantile of grouped data).
fn quantile(sorted: &[f32], q: f64, step: f64) -> f64 {
    let rank = q * sorted.len() as f64;
    if step > 0.0 {
        let value = sorted[(rank as usize).min(sorted.len() - 1)];
        let below = sorted.partition_point(|&v| v < value);
        let upto = sorted.partition_point(|&v| v <= value);
        let within = (rank - below as f64) / (upto - below) as f64;
        return f64::from(value) + step * (within - 0.5);
    }
    let at = (rank - 0.5).clamp(0.0, (sorted.len() - 1) as f64);
    let (low, part) = (at as usize, at.fract());
    let high = (low + 1).min(sorted.len() - 1);
    f64::from(sorted[low]) * (1.0 - part) + f64::from(sorted[high]) * part
}
