//! Level and scatter of many values, by counting them into bins: what sorting would give, in a fraction of its time.

use super::background::{Clipping, clipped_median};

/// Bins, and the standard deviations that they span on either side of the middle of a sample.
const BINS: usize = 512;
const REACH_SIGMAS: f32 = 8.0;
/// Values of the sample that says where the bins lie.
const SAMPLE: usize = 64;

/// Clipping for levels of tiles and of the smoothed frame.
const CLIPPING: Clipping =
    Clipping { sigma: 3.0, rounds: 8, gain_and_read_noise: None, step_adu: 0.0 };

/// Level and scatter of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Level {
    /// Median of what is left after clipping at ±3 σ.
    pub level: f32,
    /// Half the distance between its quantiles of ±1 σ.
    pub sigma: f32,
}

/// Buffers for counting.
#[derive(Debug)]
pub(crate) struct Counter {
    bins: [u32; BINS],
    sample: Vec<f32>,
    places: Vec<u32>,
}

impl Default for Counter {
    fn default() -> Self {
        Self { bins: [0; BINS], sample: Vec::new(), places: Vec::new() }
    }
}

impl Counter {
    /// Finds the level and scatter of the numbers in these rows; `None` with fewer than three. Values that come in steps (1 for whole counts, else 0) are counted
    /// step by step, and a quantile is taken within its step, as of grouped data.
    ///
    /// Bins are a thirtieth of a standard deviation wide or one step, and quantiles are taken evenly within a bin. Where the sample misjudged the
    /// values so much that a quantile falls beside the bins, they are sorted.
    pub fn level<'a>(
        &mut self,
        rows: impl Iterator<Item = &'a [f32]> + Clone,
        step: f32,
    ) -> Option<Level> {
        const FINE: f32 = 8.0;
        let [middle, sigma] = self.sampled(rows.clone())?;
        let [low, width] = bins_for(middle, sigma, step);
        let count = self.count(rows.clone(), low, width)?;
        let Some([level, sigma]) = self.clipped(count) else { return self.sorted(rows) };
        let found = Level { level: low + width * level, sigma: width * sigma };
        if sigma > FINE || width <= step {
            return Some(found);
        }
        // The sample made too much of what is clipped.
        let [finer, fine_width] = bins_for(found.level, found.sigma, step);
        if fine_width >= width {
            return Some(found);
        }
        let count = self.count(rows.clone(), finer, fine_width)?;
        match self.clipped(count) {
            Some([level, sigma]) => {
                Some(Level { level: finer + fine_width * level, sigma: fine_width * sigma })
            }
            None => self.sorted(rows),
        }
    }

    /// Counts values into bins from `low` on; `None` of fewer than three.
    fn count<'a>(
        &mut self,
        rows: impl Iterator<Item = &'a [f32]>,
        low: f32,
        width: f32,
    ) -> Option<usize> {
        self.bins = [0; BINS];
        let inverse = width.recip();
        let (mut all, mut missing) = (0, 0);
        for row in rows {
            all += row.len();
            missing += row.iter().map(|v| u32::from(v.is_nan())).sum::<u32>();
            self.places.clear();
            // What is not a number goes to the first bin, and is taken off it below.
            self.places.extend(row.iter().map(|v| place((v - low) * inverse)));
            for &place in &self.places {
                self.bins[place as usize % BINS] += 1;
            }
        }
        self.bins[0] -= missing;
        Some(all - missing as usize).filter(|count| *count >= 3)
    }

    /// Middle and scatter of a few of the values.
    fn sampled<'a>(&mut self, rows: impl Iterator<Item = &'a [f32]> + Clone) -> Option<[f32; 2]> {
        let all: usize = rows.clone().map(<[f32]>::len).sum();
        // Odd strides do not stay in one column.
        let stride = (all / SAMPLE) | 1;
        self.sample.clear();
        let mut next = 0;
        for row in rows {
            while let Some(value) = row.get(next) {
                self.sample.extend(Some(*value).filter(|v| v.is_finite()));
                next += stride;
            }
            next -= row.len();
        }
        self.sample.sort_unstable_by(f32::total_cmp);
        let n = self.sample.len();
        let at = |q: f32| self.sample.get((q * n as f32) as usize).copied();
        Some([at(0.5)?, 0.5 * (at(0.84)? - at(0.16)?)])
    }

    /// Level and scatter in bins from the lower edge of the first; `None` where a quantile falls beside them.
    fn clipped(&self, count: usize) -> Option<[f32; 2]> {
        let mut kept = 0..BINS;
        let mut count = count as f32;
        let mut found = None;
        for _ in 0..=CLIPPING.rounds {
            let ranks = [0.158_655_25, 0.5, 0.841_344_8].map(|q| q * count);
            let [low, median, high] = self.quantiles(kept.clone(), ranks);
            // The first and the last bin hold what lies beyond.
            if low < 1.0 || high > (BINS - 1) as f32 {
                return None;
            }
            let sigma = 0.5 * (high - low);
            found = Some([median, sigma]);
            let reach = CLIPPING.sigma as f32 * sigma + 0.5;
            let from = (median - reach).round().max(1.0) as usize;
            let to = ((median + reach).round() as usize).min(BINS - 1);
            let clipped = from.max(kept.start)..to.min(kept.end);
            let left: u32 = self.bins[clipped.clone()].iter().sum();
            if clipped == kept || left < 3 {
                break;
            }
            (kept, count) = (clipped, left as f32);
        }
        found
    }

    /// Where the sum over the kept bins reaches each of some ranks, in their order.
    fn quantiles<const N: usize>(&self, kept: std::ops::Range<usize>, ranks: [f32; N]) -> [f32; N] {
        let (mut below, mut last) = (0.0, kept.start);
        let mut bins = kept.clone().zip(&self.bins[kept]).peekable();
        ranks.map(|rank| {
            while let Some(&(bin, &here)) = bins.peek() {
                let here = here as f32;
                if here > 0.0 && below + here >= rank {
                    return bin as f32 + (rank - below) / here;
                }
                below += here;
                last = bin;
                bins.next();
            }
            last as f32 + 1.0
        })
    }

    fn sorted<'a>(&mut self, rows: impl Iterator<Item = &'a [f32]>) -> Option<Level> {
        self.sample.clear();
        self.sample.extend(rows.flatten().copied().filter(|v| v.is_finite()));
        let found = clipped_median(&mut self.sample, &CLIPPING)?;
        Some(Level { level: found.level_adu as f32, sigma: found.pixel_sigma_adu as f32 })
    }
}

/// Lower edge of the first bin and the bins' width, for values of about this level and scatter.
fn bins_for(middle: f32, sigma: f32, step: f32) -> [f32; 2] {
    let width = 2.0 * REACH_SIGMAS / BINS as f32 * sigma;
    if step > 0.0 {
        // One bin holds whole steps, so that no bin has more of them than the next.
        let width = step * (width / step).round().max(1.0);
        let first = ((middle - 0.5 * width * BINS as f32) / step).round();
        return [(first - 0.5) * step, width];
    }
    // Values that hardly differ are told apart to the rounding of their level.
    let width = width.max(4.0 * f32::EPSILON * middle.abs()).max(f32::MIN_POSITIVE * 1e3);
    [middle - 0.5 * width * BINS as f32, width]
}

/// The bin of a place, without the branches of a saturating cast: adding 2²³ leaves the whole number in the mantissa.
fn place(at: f32) -> u32 {
    let within = (at - 0.5).max(0.0).min((BINS - 1) as f32);
    (within + 8_388_608.0).to_bits() & 0x7f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    fn normal(rng: &mut Xoshiro256PlusPlus) -> f32 {
        let (u, v): (f32, f32) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f32::consts::TAU * v).cos()
    }

    /// Truth: the level and scatter that the values were drawn with, a tenth of them far above.
    /// Tolerance: 5 standard errors of 40,000 values, and what a tenth of outliers leaves within 3 σ is nothing.
    #[test]
    fn of_normal_values_and_outliers() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut counter = Counter::default();
        for (level, sigma, step) in [
            (1000.0, 12.0, 0.0),
            (1000.3, 12.0, 1.0),
            (0.0, 1e-3, 0.0),
            (-5e4, 300.0, 0.0),
            (200.3, 1.0, 1.0),
            (200.3, 0.6, 1.0),
        ] {
            let values: Vec<f32> = (0..40_000)
                .map(|i| match i % 10 {
                    0 => level + 100.0 * sigma,
                    _ => level + sigma * normal(&mut rng),
                })
                .map(|v| if step > 0.0 { v.round() } else { v })
                .collect();
            let found = counter.level(values.chunks(200), step).unwrap();
            // Whole counts scatter by 1/√12 besides; quantiles lean by the outliers of the last round, if any.
            let stated = sigma.hypot(step / 12f32.sqrt());
            // Within a step values are not spread evenly.
            let uneven = if stated < step { 0.05 * step } else { 0.0 };
            let off = (found.level - level).abs();
            assert!(off < 5.0 * 1.25 * stated / 190.0 + uneven, "{level}: {found:?}");
            let allowed = 0.02 + 0.05 * (step / stated).powi(2);
            assert!((found.sigma / stated - 1.0).abs() < allowed, "{stated}: {found:?}");
        }
    }

    /// Truth: by hand. What is no number does not count; two values are too few; all alike have no scatter beyond a step's; half the values far
    /// from the other half are sorted.
    #[test]
    fn of_hard_values() {
        let mut counter = Counter::default();
        let mut of = |values: &[f32], step| counter.level(std::iter::once(values), step);
        assert_eq!(of(&[], 1.0), None);
        assert_eq!(of(&[f32::NAN; 90], 1.0), None);
        assert_eq!(of(&[1.0, 2.0, f32::NAN], 0.0), None);
        let alike = of(&[1234.0; 100], 1.0).unwrap();
        assert_eq!((alike.level, alike.sigma < 0.5), (1234.0, true));
        let alike = of(&[1234.56; 100], 0.0).unwrap();
        assert!((alike.level - 1234.56).abs() < 1e-3 && alike.sigma < 1e-3, "{alike:?}");
        let mut halves = vec![0.0; 1000];
        halves[..501].fill(1e6);
        halves[..3].fill(f32::NAN);
        let found = of(&halves, 0.0).unwrap();
        // To the width of a bin.
        assert!((-2e4..=1.02e6).contains(&found.level) && found.sigma <= 5.2e5, "{found:?}");
        let with_gaps: Vec<f32> =
            (0..3000).map(|i| if i % 3 == 0 { f32::NAN } else { (i % 101) as f32 }).collect();
        let found = of(&with_gaps, 1.0).unwrap();
        assert!((found.level - 50.0).abs() < 1.0 && (found.sigma - 34.5).abs() < 1.0, "{found:?}");
    }
}
