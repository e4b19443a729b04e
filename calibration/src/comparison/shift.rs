//! Whether a measured curve lies beside the simulated one in time: a clock that was off, or times of another scale.

use super::Channel;
use super::channel::Given;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Largest shift that is looked for, s: Terrestrial Time is 69.2 s from UTC, and clocks are off by more.
const MOST_S: f64 = 120.0;
/// Samples of a channel that are looked at, spread over all of it.
const MOST_SAMPLES: usize = 1000;
/// Samples below which nothing is said.
const LEAST_SAMPLES: usize = 30;
/// Share of these samples that must have a simulated value when they are moved.
const LEAST_SHARE: f64 = 0.6;
/// The shift must make residuals smaller by this over the whole curve, and by [`HALF_GAIN`] in each half of it.
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
    /// Reach of the shifts that fit as well: three standard deviations if the residuals are independent, s.
    pub doubt_s: f64,
    /// Scatter of ln(measured/simulated) about a parabola in time for each channel, as the times stand: root mean square, in which what is far off counts as three standard deviations.
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

    /// Residuals where measured times are late by so much, each with its time: about a parabola.
    fn residuals(&self, late_s: f64) -> Vec<(f64, f64)> {
        let mut own: Vec<(f64, f64)> = self
            .measured
            .iter()
            .filter_map(|(t, m)| Some((*t, m - self.at(t - late_s)?)))
            .collect();
        without_parabola(&mut own);
        own
    }
}

/// Takes the parabola off that is nearest by least squares. A model that is wrong (a phase function, the air, a size) leaves as much of a smooth curve, and a shift would pass for it.
fn without_parabola(residuals: &mut [(f64, f64)]) {
    let n = residuals.len().max(1) as f64;
    let middle = residuals.iter().map(|r| r.0).sum::<f64>() / n;
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for power in 0..3 {
        let mut own: Vec<f64> = residuals.iter().map(|r| (r.0 - middle).powi(power)).collect();
        for other in &basis {
            take_off(other, own.iter_mut());
        }
        take_off(&own, residuals.iter_mut().map(|r| &mut r.1));
        basis.push(own);
    }
}

/// Takes the part along a direction off some values.
fn take_off<'a>(along: &[f64], values: impl Iterator<Item = &'a mut f64>) {
    let mut values: Vec<&mut f64> = values.collect();
    let length = along.iter().map(|a| a * a).sum::<f64>();
    if length > 0.0 {
        let part = along.iter().zip(&values).map(|(a, v)| a * **v).sum::<f64>() / length;
        values.iter_mut().zip(along).for_each(|(v, a)| **v -= part * a);
    }
}

/// Root mean square, in which what is far off (three standard deviations by the median) counts as that.
fn scatter(residuals: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = 3.0 * SIGMA_PER_MAD * median(residuals.clone().map(f64::abs)).unwrap_or(f64::NAN);
    let (mut sum, mut n) = (0.0, 0.0);
    for residual in residuals {
        sum += residual.powi(2).min(most * most);
        n += 1.0;
    }
    (sum / n).sqrt()
}

/// Looks for a shift of up to two minutes with which the light agrees much better, over the whole curve and in each half of it. `None` where there is none, or too little light to say.
///
/// Each channel has a scale, a slope and a bend of its own, so that only the finer course of the light tells a shift. A few seconds of a smooth curve are not told. `seconds` are those of the samples, in order.
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
    let of = |late_s: f64| {
        residuals(late_s).map_or(f64::INFINITY, |all| scatter(all.iter().map(|r| r.1)))
    };
    let still = of(0.0);
    let step_s = median(seconds.windows(2).map(|pair| pair[1] - pair[0]))?.clamp(0.2, 1.0);
    let count = (MOST_S / step_s).floor() as i32;
    let grid: Vec<(f64, f64)> = (-count..=count)
        .map(|k| f64::from(k) * step_s)
        .map(|late_s| (late_s, of(late_s)))
        .collect();
    let best = lowest(&grid)?.1;
    // The valleys; of a light curve that repeats itself there are several.
    let valleys = grid.chunk_by(|a, b| (a.1 <= GAIN * still) == (b.1 <= GAIN * still));
    let near = valleys
        .filter_map(lowest)
        .filter(|point| point.1 <= GAIN * still && point.1 <= ALIKE * best)
        .min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
    // What still falls at the border is no minimum.
    if near.0 == 0.0 || near.0.abs() >= f64::from(count) * step_s {
        return None;
    }
    let fine: Vec<(f64, f64)> = (-20..=20)
        .map(|k| near.0 + 0.1 * f64::from(k) * step_s)
        .map(|late_s| (late_s, of(late_s)))
        .collect();
    let (late_s, moved_scatter) = lowest(&fine)?;
    let (still_all, moved_all) = (residuals(0.0)?, residuals(late_s)?);
    let middle = median(still_all.iter().map(|r| r.0))?;
    let is_better = |first: bool| {
        let of_half = |all: &[(f64, f64)]| {
            scatter(all.iter().filter(|r| (r.0 < middle) == first).map(|r| r.1))
        };
        of_half(&moved_all) <= HALF_GAIN * of_half(&still_all)
    };
    if !is_better(true) || !is_better(false) {
        return None;
    }
    // Three standard deviations of independent residuals.
    let known = moved_scatter * (1.0 + 9.0 / moved_all.len() as f64).sqrt();
    let alike = grid.iter().chain(&fine).filter(|point| point.1 <= known);
    let doubt_s = alike.map(|point| (point.0 - late_s).abs()).fold(0.1 * step_s, f64::max);
    Some(TimeShift { late_s, doubt_s, scatter: still, moved_scatter })
}

fn lowest(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    points.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))
}
