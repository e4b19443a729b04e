//! Counts of one bin linearised in bins so fine that the light hardly changes within them, from raw time tags.
//!
//! n(m) is convex: of a glint shorter than the bin, n of the mean falls short of the mean of n (7 % at a peak of nτ = 0.1 over a
//! fifth of the bin). Light that does not change loses nothing by it: the variance of the mean over fine bins is that of the whole bin, and
//! the bias of few counts, τ/δ of the rate in fine bins of length δ, is taken off to first order in each.

use super::{Counted, DetectorError, Glints, LEAST_DEAD_TIMES, Limit, Linear, Linearity};

/// How finely tags are binned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FineBins {
    /// Length of a fine bin in dead times (with recovery); at least 20. A paralysable detector takes bins 16 times as long, as near
    /// its maximum the noise of few counts leaves the law; so does a table, which does not tell how long its pixels are dead.
    pub dead_times: f64,
    /// When light is said to have changed within fine bins ([`FineLinear::too_fast`]).
    pub glints: Glints,
}

impl Default for FineBins {
    fn default() -> Self {
        Self { dead_times: 100.0, glints: Glints::default() }
    }
}

/// The rate of a bin from its tags.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FineLinear {
    /// The mean over the bin.
    pub linear: Linear,
    /// Number of fine bins; 1 where the bin holds no more.
    pub bins: u64,
    /// Length of a fine bin, s.
    pub length_s: f64,
    /// Growth of the rate from bins of twice the length to these, Hz. Where light is resolved, a third of it is the error that is left.
    pub refined_hz: f64,
    /// Whether the light still changed within the fine bins by more than can be linearised to the tolerance.
    pub too_fast: bool,
}

/// Threshold for a glint, in σ, of the counts of a fine bin above those beside it: constant light exceeds it in one bin in 30,000.
const STANDS_OUT: f64 = 4.0;

/// Sums over fine bins.
#[derive(Default)]
struct Sum {
    rate_hz: f64,
    variance_hz2: f64,
    bias_hz: f64,
    slope_hz: f64,
    lost_hz: f64,
    whole_hz: f64,
    untrusted: bool,
}

impl Linearity {
    /// The mean rate of a bin from the tags of one channel in it, ps, in the order of time. The dead time before the first tag is
    /// taken as that of the light around it.
    ///
    /// # Errors
    /// [`DetectorError::Saturated`] where the whole bin or any of its fine bins is saturated beyond three times its noise: of the mean of such a bin nothing
    /// can be said. Tags out of order or outside the bin; a bin without a length.
    pub fn linearise_tags(
        &self,
        tags_ps: &[i64],
        start_ps: i64,
        length_ps: i64,
        fine: &FineBins,
    ) -> Result<FineLinear, DetectorError> {
        let end_ps = start_ps.saturating_add(length_ps);
        let mut from_ps = start_ps;
        for (i, &found_ps) in tags_ps.iter().enumerate() {
            if !(from_ps..end_ps).contains(&found_ps) {
                return Err(DetectorError::Tag { number: i + 1, found_ps, from_ps, to_ps: end_ps });
            }
            from_ps = found_ps;
        }
        let exposure_s = length_ps as f64 * 1e-12;
        let whole = self.linearise(tags_ps.len() as u64, exposure_s)?;
        let wanted_s =
            fine.dead_times.max(LEAST_DEAD_TIMES) * self.law.stiffness() * self.memory_s();
        // An even number, so that pairs make bins of twice the length.
        let bins = if wanted_s > 0.0 { 2 * (0.5 * exposure_s / wanted_s) as u64 } else { 0 };
        if bins == 0 || tags_ps.is_empty() {
            let length_s = exposure_s;
            return Ok(FineLinear {
                linear: whole,
                bins: 1,
                length_s,
                refined_hz: 0.0,
                too_fast: false,
            });
        }
        let length_s = exposure_s / bins as f64;
        let (mut sum, mut coarse) = (Sum::default(), Sum::default());
        let filled = fill(tags_ps, start_ps, length_ps, bins);
        for (_, counts) in &filled {
            sum.add(self, *counts, length_s)?;
        }
        for pair in filled.chunk_by(|(a, _), (b, _)| a / 2 == b / 2) {
            let counts = pair.iter().map(|(_, counts)| counts).sum();
            coarse.add(self, counts, 2.0 * length_s)?;
        }
        let part = 1.0 / bins as f64;
        let rate_hz = sum.rate_hz * part;
        let refined_hz = rate_hz - coarse.rate_hz * 2.0 * part;
        let linear = Linear {
            rate_hz,
            sigma_hz: sum.variance_hz2.sqrt() * part,
            bias_hz: sum.bias_hz * part,
            dead_time_slope_hz: sum.slope_hz * part,
            lost_fraction: sum.lost_hz / sum.whole_hz,
            trusted: !sum.untrusted,
            ..whole
        };
        let unresolved_hz = fine.glints.over(self, &filled, length_s, bins) * part;
        let most_hz = fine.glints.tolerance * rate_hz.abs();
        let too_fast = refined_hz.abs() / 3.0 > most_hz || unresolved_hz > most_hz;
        Ok(FineLinear { linear, bins, length_s, refined_hz, too_fast })
    }
}

/// The bins that hold tags, by number, and how many each holds. Bin b begins at the first whole ps from b/bins of the length on.
fn fill(tags_ps: &[i64], start_ps: i64, length_ps: i64, bins: u64) -> Vec<(u64, usize)> {
    let (length, bins) = (i128::from(length_ps), i128::from(bins));
    let end_of =
        |bin: i128| i128::from(start_ps) + ((bin + 1) * length + bins - 1).div_euclid(bins);
    let mut filled: Vec<(u64, usize)> = Vec::new();
    let mut end_ps = i128::from(i64::MIN);
    for &tag_ps in tags_ps {
        match filled.last_mut() {
            Some((_, counts)) if i128::from(tag_ps) < end_ps => *counts += 1,
            _ => {
                let bin = (i128::from(tag_ps) - i128::from(start_ps)) * bins / length;
                end_ps = end_of(bin);
                filled.push((u64::try_from(bin).unwrap_or(0), 1));
            }
        }
    }
    filled
}

impl Glints {
    /// The sum over fine bins of what light that stands out of the bins beside may hide, Hz. `filled` are the bins with counts, by number; those that only
    /// follow a rise or a fall are resolved as [`FineLinear::refined_hz`] tells.
    fn over(&self, law: &Linearity, filled: &[(u64, usize)], length_s: f64, bins: u64) -> f64 {
        let counted = |counts: usize| -> Counted { (counts as f64 / length_s, length_s) };
        let mut sum_hz = 0.0;
        for (i, (bin, counts)) in filled.iter().enumerate() {
            // A bin that is not among the filled ones has none; beyond the ends there is no bin.
            let of = |other: Option<&(u64, usize)>, wanted: Option<u64>| {
                let wanted = wanted.filter(|number| *number < bins)?;
                Some(other.filter(|(number, _)| *number == wanted).map_or(0, |(_, counts)| *counts))
            };
            let before = of(i.checked_sub(1).and_then(|i| filled.get(i)), bin.checked_sub(1));
            let beside = [before, of(filled.get(i + 1), bin.checked_add(1))];
            let near = || beside.iter().flatten();
            let mean = near().sum::<usize>() as f64 / near().count().max(1) as f64;
            // Square roots of counts scatter alike: many fine bins ask for more than the 3 σ of whole ones.
            let root = |counts: f64| 2.0 * (counts + 0.375).sqrt();
            let noise = (1.0 + 1.0 / near().count().max(1) as f64).sqrt();
            let rise = root(*counts as f64) - root(mean);
            if near().all(|other| other < counts) && rise > STANDS_OUT * noise {
                let here = Glints { sigmas: 0.0, ..*self };
                let beside = beside.map(|other| other.map(counted));
                sum_hz += here.unresolved_hz(law, counted(*counts), &beside);
            }
        }
        sum_hz
    }
}

impl Sum {
    fn add(&mut self, law: &Linearity, counts: usize, length_s: f64) -> Result<(), DetectorError> {
        let measured_hz = counts as f64 / length_s;
        let at = law.law.invert(measured_hz);
        // Noise alone may carry a fine bin past a stated limit: three times its own do not.
        let fano = at.map_or(0.1, |at| at.fano);
        let surely_hz = measured_hz - 3.0 * (fano * measured_hz / length_s).sqrt();
        let saturated =
            |limit_hz, limit| Err(DetectorError::Saturated { measured_hz, limit_hz, limit });
        if surely_hz >= law.saturation_hz {
            return saturated(law.saturation_hz, Limit::Stated);
        }
        let linear = match at {
            Ok(at) if at.amplified(measured_hz) => return saturated(measured_hz, Limit::Law),
            Ok(_) => law.follow(measured_hz, length_s)?,
            Err((limit_hz, limit)) => return saturated(limit_hz, limit),
        };
        self.rate_hz += linear.rate_hz;
        self.variance_hz2 += linear.sigma_hz * linear.sigma_hz;
        self.bias_hz += linear.bias_hz;
        self.slope_hz += linear.dead_time_slope_hz;
        self.lost_hz += linear.lost_fraction * (linear.rate_hz + linear.bias_hz);
        self.whole_hz += linear.rate_hz + linear.bias_hz;
        self.untrusted |= !linear.trusted;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::fill;

    /// Truth: floor((t − start)·bins/length) for every time of a span that the bins do not divide.
    #[test]
    fn every_time_has_its_bin() {
        for (length, bins) in [(10, 3), (97, 10), (100, 10), (7, 6)] {
            let times: Vec<i64> = (-5..length - 5).collect();
            let mut expected = vec![0; bins as usize];
            times.iter().for_each(|t| expected[((t + 5) * bins / length) as usize] += 1);
            let found = fill(&times, -5, length, bins as u64);
            let found: Vec<usize> = found.into_iter().map(|(_, counts)| counts).collect();
            assert_eq!(found, expected, "{length} {bins}");
        }
    }
}
