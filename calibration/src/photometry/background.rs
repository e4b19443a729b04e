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
    sort(values);
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

/// Sorts values as [`f32::total_cmp`] orders them: byte by byte from the lowest, since an annulus has so many pixels that comparing them would be a good part of a frame's time.
fn sort(values: &mut [f32]) {
    const FEW: usize = 128;
    if values.len() < FEW {
        values.sort_unstable_by(f32::total_cmp);
        return;
    }
    let sign = 1_u32 << 31;
    // Whole numbers in the order of the values: of negative ones all bits turn, of others the sign.
    let mut keys: Vec<u32> = values
        .iter()
        .map(|value| match value.to_bits() {
            bits if bits & sign == 0 => bits | sign,
            bits => !bits,
        })
        .collect();
    let mut counts = [[0_u32; 256]; 4];
    for key in &keys {
        for (count, byte) in counts.iter_mut().zip(key.to_le_bytes()) {
            count[usize::from(byte)] += 1;
        }
    }
    let mut sorted = vec![0; keys.len()];
    for (byte, count) in counts.iter_mut().enumerate() {
        if count.iter().any(|n| *n as usize == keys.len()) {
            continue;
        }
        let mut before = 0;
        for n in count.iter_mut() {
            before += std::mem::replace(n, before);
        }
        for key in &keys {
            let next = &mut count[usize::from(key.to_le_bytes()[byte])];
            sorted[*next as usize] = *key;
            *next += 1;
        }
        std::mem::swap(&mut keys, &mut sorted);
    }
    for (value, key) in values.iter_mut().zip(keys) {
        *value = f32::from_bits(if key & sign == 0 { !key } else { key & !sign });
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the standard library's sort, bit by bit: numbers of a congruence, about one level as an annulus has them, of all sizes and signs, whole, all alike; zeros of both signs, infinite
    /// values and values that are no number among them.
    #[test]
    fn values_are_sorted_as_by_comparing() {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 32) as u32
        };
        for n in [0, 1, 2, 127, 128, 129, 1000, 5000] {
            let about = |bits: u32| 140.3 + (bits >> 24) as f32 / 7.0;
            let kinds: [&dyn Fn(u32) -> f32; 4] =
                [&about, &f32::from_bits, &|bits| (bits % 9) as f32 - 4.0, &|_| -3.5];
            for kind in kinds {
                let mut values: Vec<f32> = (0..n).map(|_| kind(next())).collect();
                let odd = [0.0, -0.0, f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
                values.iter_mut().step_by(31).zip(odd).for_each(|(value, odd)| *value = odd);
                let mut expected = values.clone();
                expected.sort_by(f32::total_cmp);
                sort(&mut values);
                let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&values), bits(&expected), "{n}");
            }
        }
    }
}
