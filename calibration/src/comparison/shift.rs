//! Whether a measured curve lies beside the simulated one in time: a clock that was off, or times of another scale.

use super::Channel;
use super::channel::Given;
use sunglint_numerics::order::median;

/// Largest shift that is looked for, s: one more than the 69.2 s of Terrestrial Time, with room for a slow clock.
const MOST_S: f64 = 120.0;
/// Samples of a channel that are looked at, spread over all of it.
const MOST_SAMPLES: usize = 1000;
/// Samples below which nothing is said.
const LEAST_SAMPLES: usize = 30;
/// Share of these samples that must have a simulated value when they are moved.
const LEAST_SHARE: f64 = 0.6;
/// The shift must make residuals smaller by this over the whole curve, and by [`HALF_GAIN`] in each half of it: a model that is wrong has a trend that a shift takes from one half and gives to the other.
const GAIN: f64 = 0.5;
const HALF_GAIN: f64 = 0.75;
/// Two shifts whose residuals differ by less than this are as good as each other: a light curve that repeats itself. The smaller one is told.
const ALIKE: f64 = 1.1;
/// Simulated samples further apart than this many usual steps are not interpolated between.
const GAP_STEPS: f64 = 5.0;

/// A shift in time with which measured and simulated light agree much better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeShift {
    /// Measured times less the simulated times of the same light, s.
    pub late_s: f64,
    /// Scatter of ln(measured/simulated) about each channel's median, as the times stand: 1.4826 times the median absolute residual.
    pub scatter: f64,
    /// The same with the times moved by [`Self::late_s`].
    pub moved_scatter: f64,
}

/// A channel's logarithms at seconds of the curve.
struct Curve {
    /// Seconds and logarithms of samples that count.
    measured: Vec<(f64, f64)>,
    /// Seconds and logarithms of all simulated light.
    simulated: Vec<(f64, f64)>,
    gap_s: f64,
}

impl Curve {
    fn new(seconds: &[f64], given: &Given<'_>, channel: &Channel) -> Self {
        let lit = |i: &usize| given.simulated[*i] > 0.0 && given.simulated[*i].is_finite();
        let simulated: Vec<(f64, f64)> =
            (0..seconds.len()).filter(lit).map(|i| (seconds[i], given.simulated[i].ln())).collect();
        let all: Vec<usize> =
            (0..seconds.len()).filter(|i| channel.used[*i] && given.measured[*i] > 0.0).collect();
        let every = all.len().div_ceil(MOST_SAMPLES).max(1);
        let measured =
            all.iter().step_by(every).map(|i| (seconds[*i], given.measured[*i].ln())).collect();
        let steps = simulated.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let gap_s = GAP_STEPS * median(steps).unwrap_or(0.0);
        Self { measured, simulated, gap_s }
    }

    /// Simulated light at a second.
    fn at(&self, second: f64) -> Option<f64> {
        let after = self.simulated.partition_point(|(t, _)| *t < second);
        let (t1, v1) = *self.simulated.get(after)?;
        if t1 == second {
            return Some(v1);
        }
        let (t0, v0) = *self.simulated.get(after.checked_sub(1)?)?;
        (t1 - t0 <= self.gap_s).then(|| v0 + (v1 - v0) * (second - t0) / (t1 - t0))
    }

    /// Residuals where measured times are late by so much, each with its time: about their median.
    fn residuals(&self, late_s: f64) -> Vec<(f64, f64)> {
        let mut own: Vec<(f64, f64)> = self
            .measured
            .iter()
            .filter_map(|(t, m)| Some((*t, m - self.at(t - late_s)?)))
            .collect();
        let middle = median(own.iter().map(|r| r.1)).unwrap_or(0.0);
        own.iter_mut().for_each(|r| r.1 -= middle);
        own
    }
}

fn scatter<'a>(residuals: impl Iterator<Item = &'a (f64, f64)>) -> f64 {
    1.4826 * median(residuals.map(|r| r.1.abs())).unwrap_or(f64::NAN)
}

/// Looks for a shift of up to two minutes with which the light agrees much better, over the whole curve and in each half of it. `None` where there is none, or too little light to say.
///
/// Each channel has a scale of its own. `seconds` are those of the samples, in order.
pub fn time_shift(seconds: &[f64], channels: &[(&Given<'_>, &Channel)]) -> Option<TimeShift> {
    let curves: Vec<Curve> =
        channels.iter().map(|(given, channel)| Curve::new(seconds, given, channel)).collect();
    let asked: usize = curves.iter().map(|curve| curve.measured.len()).sum();
    if asked < LEAST_SAMPLES {
        return None;
    }
    let residuals = |late_s: f64| -> Option<Vec<(f64, f64)>> {
        let all: Vec<(f64, f64)> = curves.iter().flat_map(|c| c.residuals(late_s)).collect();
        (all.len() as f64 >= LEAST_SHARE * asked as f64).then_some(all)
    };
    let of = |late_s: f64| residuals(late_s).map_or(f64::INFINITY, |all| scatter(all.iter()));
    let still = of(0.0);
    let step_s = median(seconds.windows(2).map(|pair| pair[1] - pair[0]))?.clamp(0.2, 1.0);
    let count = (MOST_S / step_s).floor() as i32;
    let grid: Vec<(f64, f64)> = (-count..=count)
        .map(|k| f64::from(k) * step_s)
        .map(|late_s| (late_s, of(late_s)))
        .collect();
    let best = grid.iter().map(|point| point.1).fold(f64::INFINITY, f64::min);
    // What still falls at the border is no minimum.
    let is_minimum = |p: &&[(f64, f64)]| p[1].1 <= p[0].1 && p[1].1 <= p[2].1;
    let (near, _) = (grid.windows(3).filter(is_minimum).map(|p| p[1]))
        .filter(|point| point.1 <= ALIKE * best)
        .min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
    let fine = (-10..=10).map(|k| near + 0.1 * f64::from(k) * step_s);
    let (late_s, moved_scatter) =
        fine.map(|late_s| (late_s, of(late_s))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    if near == 0.0 || moved_scatter.is_nan() || moved_scatter > GAIN * still {
        return None;
    }
    let (still_all, moved_all) = (residuals(0.0)?, residuals(late_s)?);
    let middle = median(still_all.iter().map(|r| r.0))?;
    let halves = [true, false].map(|first| {
        let own = |all: &[(f64, f64)]| scatter(all.iter().filter(|r| (r.0 < middle) == first));
        own(&moved_all) <= HALF_GAIN * own(&still_all)
    });
    halves.iter().all(|better| *better).then_some(TimeShift {
        late_s,
        scatter: still,
        moved_scatter,
    })
}
