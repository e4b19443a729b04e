//! The dead time of a detector from the intervals between its own counts, and whether it pulses again on its own.
//!
//! Under constant light the chance of a count per unit of time, s after the last one, is n(1 − e^(−(s−τ_d)/τ_r)) after τ_d and none before (Krause and
//! Walenta, arXiv 2507.10361; τ_r = 0 is the plain dead time). It is fitted bin by bin to the counts among those intervals that have lasted so
//! long, whose number is binomial, so that intervals beyond the histogram count as what they are: longer. Afterpulses show as counts beyond that.
//!
//! Light that changes bunches the counts and looks like afterpulses: take a stretch of constant light. A detector whose dead time is prolonged by
//! lost events shows a hazard that rises from n e^(−nτ) to n between τ and some times 1/n; take a stretch with nτ below 0.1.

use nalgebra::DVector;
use sunglint_numerics::least_squares::{
    Bounded, Differences, Limits, Residuals, covariance, minimise_residuals,
};
use sunglint_numerics::measured::Measured;
use sunglint_radiometry::station::DeadTime;

/// How often each interval between successive counts of one channel occurred. It holds as much as it has bins, whatever is added.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalHistogram {
    bin_ps: i64,
    counts: Vec<u64>,
    beyond: u64,
    last_ps: Option<i64>,
}

/// Why there is no estimate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IntervalError {
    /// A histogram without bins or without width.
    #[error(
        "a histogram of {bins} bins of {bin_ps} ps: expected at least 10 bins of at least 1 ps"
    )]
    Bins {
        /// How many.
        bins: usize,
        /// Their width, ps.
        bin_ps: i64,
    },
    /// Too few intervals.
    #[error(
        "{found} intervals within the histogram: expected at least 1000, of one channel in constant light"
    )]
    TooFew {
        /// How many lie within the histogram.
        found: u64,
    },
    /// The histogram ends before the detector has recovered, or its bins are too wide to see the dead time.
    #[error(
        "the dead time of {dead_time_s} s and recovery of {recovery_s} s do not lie between two bins of {bin_s} s and half of the histogram's {range_s} s: take other bins"
    )]
    Range {
        /// The dead time as it was fitted, s.
        dead_time_s: f64,
        /// The recovery, s.
        recovery_s: f64,
        /// Width of a bin, s.
        bin_s: f64,
        /// Length of the histogram, s.
        range_s: f64,
    },
    /// The fit failed.
    #[error("the hazard could not be fitted: {0}")]
    Fit(String),
}

/// Counts that follow another sooner than light explains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Afterpulses {
    /// Counts per count between the end of the recovery and the middle of the histogram beyond what the rate of its second half explains.
    /// Negative where there are fewer.
    pub probability: f64,
    /// Standard uncertainty of the probability.
    pub sigma: f64,
}

impl Afterpulses {
    /// Whether there are any, or the light was not constant: then dead time and recovery are not to be trusted either.
    pub fn are_there(&self) -> bool {
        self.probability > 3.0 * self.sigma
    }
}

/// Dead time and recovery of a detector, estimated from the intervals between tags.
#[derive(Debug, Clone, PartialEq)]
pub struct DeadTimeEstimate {
    /// Dead time τ_d and its standard uncertainty, s.
    pub dead_time_s: Measured,
    /// Time constant of the recovery and its standard uncertainty, s; `None` where it improves the fit by less than 3 σ.
    pub recovery_s: Option<Measured>,
    /// The rate that the detector saw, and its standard uncertainty, Hz.
    pub rate_hz: Measured,
    /// Deviance of the fit, about the degrees of freedom where the model holds.
    pub deviance: f64,
    /// Bins with intervals left less the numbers fitted.
    pub degrees_of_freedom: usize,
    /// Afterpulses.
    pub afterpulses: Afterpulses,
}

impl DeadTimeEstimate {
    /// Returns the dead time in the form that a station has.
    pub fn dead_time(&self) -> DeadTime {
        let dead_time_s = self.dead_time_s.value;
        match self.recovery_s {
            Some(Measured { value: recovery_s, .. }) => {
                DeadTime::ExponentialRecovery { dead_time_s, recovery_s }
            }
            None => DeadTime::NonParalysable { dead_time_s },
        }
    }
}

/// Intervals that a fit needs.
const LEAST: u64 = 1000;

impl IntervalHistogram {
    /// An empty histogram of so many bins of a width in ps. Good ones reach over 10 dead times in 20 bins or more a dead time.
    ///
    /// # Errors
    /// Fewer than 10 bins, or none of 1 ps.
    pub fn new(bin_ps: i64, bins: usize) -> Result<Self, IntervalError> {
        if bins < 10 || bin_ps < 1 || (bins as i64).checked_mul(bin_ps).is_none() {
            return Err(IntervalError::Bins { bins, bin_ps });
        }
        Ok(Self { bin_ps, counts: vec![0; bins], beyond: 0, last_ps: None })
    }

    /// Adds the next tag. One before the last begins anew, as after [`IntervalHistogram::interrupt`].
    pub fn add(&mut self, time_ps: i64) {
        if let Some(interval) = self.last_ps.and_then(|last| time_ps.checked_sub(last)) {
            match usize::try_from(interval / self.bin_ps) {
                Ok(bin) if bin < self.counts.len() => self.counts[bin] += 1,
                Ok(_) => self.beyond += 1,
                Err(_) => {}
            }
        }
        self.last_ps = Some(time_ps);
    }

    /// Tags are missing here: the next interval is none.
    pub fn interrupt(&mut self) {
        self.last_ps = None;
    }

    /// Intervals by bin, and those beyond the last.
    pub fn counts(&self) -> (&[u64], u64) {
        (&self.counts, self.beyond)
    }

    /// Dead time, recovery and rate.
    ///
    /// # Errors
    /// Too few intervals; bins in which the dead time cannot be seen; a fit that fails.
    pub fn estimate(&self) -> Result<DeadTimeEstimate, IntervalError> {
        let inside: u64 = self.counts.iter().sum();
        if inside < LEAST {
            return Err(IntervalError::TooFew { found: inside });
        }
        let hazard = Hazard::new(self);
        let start = hazard.start();
        let step = hazard.fit(start, true)?;
        let recovering = hazard.fit([step.at[0], step.at[1], 2.0], false)?;
        let recovers = step.deviance - recovering.deviance > 9.0 && recovering.at[2] > 0.0;
        let best = if recovers { recovering } else { step };
        let bin_s = self.bin_ps as f64 * 1e-12;
        let range_s = bin_s * self.counts.len() as f64;
        let [dead, recovery] = [best.at[1] * bin_s, best.at[2] * bin_s];
        if dead + recovery < 2.0 * bin_s || dead + 3.0 * recovery > 0.5 * range_s {
            let (dead_time_s, recovery_s) = (dead, recovery);
            return Err(IntervalError::Range { dead_time_s, recovery_s, bin_s, range_s });
        }
        let rate = best.at[0].exp() / bin_s;
        Ok(DeadTimeEstimate {
            dead_time_s: Measured::new(dead, best.sigma[1] * bin_s),
            recovery_s: recovers.then_some(Measured::new(recovery, best.sigma[2] * bin_s)),
            rate_hz: Measured::new(rate, rate * best.sigma[0]),
            deviance: best.deviance,
            degrees_of_freedom: hazard.alive.len() - if recovers { 3 } else { 2 },
            afterpulses: hazard.afterpulses(best.at[1] + 5.0 * best.at[2]),
        })
    }
}

/// Counts among the intervals that have lasted so long; times in bins.
struct Hazard {
    /// (counts, intervals that reached the bin).
    alive: Vec<(f64, f64)>,
    all: f64,
}

struct Best {
    /// ln(rate), dead time, recovery; in bins.
    at: [f64; 3],
    sigma: [f64; 3],
    deviance: f64,
}

/// A chance that is left to what the model excludes, so that one electronic glitch does not decide the fit.
const GLITCH: f64 = 1e-7;

impl Hazard {
    fn new(histogram: &IntervalHistogram) -> Self {
        let all = histogram.counts.iter().sum::<u64>() + histogram.beyond;
        let mut left = all;
        let mut alive = Vec::new();
        for &counts in &histogram.counts {
            if left == 0 {
                break;
            }
            alive.push((counts as f64, left as f64));
            left -= counts;
        }
        Self { alive, all: all as f64 }
    }

    /// Rate per bin over bins, from the share of intervals that end in each.
    fn rate(&self, from: usize, to: usize) -> [f64; 2] {
        let bins = &self.alive[from.min(self.alive.len())..to.min(self.alive.len())];
        let counts: f64 = bins.iter().map(|(d, _)| d).sum();
        let exposure: f64 = bins.iter().map(|(d, r)| r - 0.5 * d).sum();
        [counts.max(1.0) / exposure.max(1.0), counts.max(1.0).sqrt() / exposure.max(1.0)]
    }

    /// Where the hazard first reaches half of the mean rate behind it.
    fn start(&self) -> [f64; 3] {
        let first = self.alive.iter().position(|(d, _)| *d > 0.0).unwrap_or(0);
        let [rate, _] = self.rate(first + self.alive.len() / 4, self.alive.len());
        let dead = self.alive.iter().position(|(d, r)| d / r > 0.5 * (1.0 - (-rate).exp()));
        [rate.ln(), dead.unwrap_or(first) as f64, 0.0]
    }

    /// ∫ hazard from the last count, over times in bins.
    fn integral([rate, dead, recovery]: [f64; 3], s: f64) -> f64 {
        let s = (s - dead).max(0.0);
        let lost = if recovery > 0.0 { recovery * -(-s / recovery).exp_m1() } else { 0.0 };
        rate * (s - lost)
    }

    fn residuals(&self, at: [f64; 3], residuals: &mut [f64]) {
        let at = [at[0].exp(), at[1], at[2]];
        let mut before = 0.0;
        for (i, ((counts, left), residual)) in self.alive.iter().zip(residuals).enumerate() {
            let after = Self::integral(at, (i + 1) as f64);
            let chance = (-(before - after).exp_m1()).clamp(GLITCH, 1.0 - GLITCH);
            before = after;
            let share = |k: f64, expected: f64| if k > 0.0 { k * (k / expected).ln() } else { 0.0 };
            let deviance =
                share(*counts, left * chance) + share(left - counts, left * (1.0 - chance));
            *residual = (counts - left * chance).signum() * (2.0 * deviance.max(0.0)).sqrt();
        }
    }

    fn fit(&self, start: [f64; 3], step: bool) -> Result<Best, IntervalError> {
        let bins = self.alive.len() as f64;
        let limits = [[-40.0, 5.0], [0.0, bins], [0.0, bins]];
        let number = |(i, [low, high]): (usize, [f64; 2])| Bounded {
            low,
            high,
            step: if i == 0 { 1e-5 } else { 1e-3 },
            fixed: step && i == 2,
        };
        let numbers: Vec<Bounded> = limits.into_iter().enumerate().map(number).collect();
        let limits = Limits { steps: 500, gain: 1e-10, step: 1e-10 };
        let mut model = HazardFit(self);
        let one = Differences::OneSided;
        let Ok(found) = minimise_residuals(&mut model, &numbers, &start, one, &limits);
        let place = found.place;
        let at = [place.at[0], place.at[1], place.at[2]];
        // A number at its bound has no uncertainty: those of the others are for it there.
        let freed = |(n, at): (&Bounded, &f64)| Bounded {
            fixed: n.fixed || *at <= n.low || *at >= n.high,
            ..*n
        };
        let inner: Vec<Bounded> = numbers.iter().zip(&at).map(freed).collect();
        let Ok(covariance) = covariance(&mut model, &inner, &place, one);
        let covariance = covariance.ok_or_else(|| {
            IntervalError::Fit("the intervals do not determine rate and dead time".into())
        })?;
        let sigma = [0, 1, 2].map(|i| covariance[(i, i)].sqrt());
        Ok(Best { at, sigma, deviance: place.chi2() })
    }

    /// Counts beyond those of the second half's rate, between a time (in bins) and the middle.
    fn afterpulses(&self, recovered: f64) -> Afterpulses {
        let (from, middle) = (recovered.ceil() as usize + 1, self.alive.len() / 2);
        let [rate, sigma] = self.rate(middle, self.alive.len());
        let (mut excess, mut variance, mut slope) = (0.0, 0.0, 0.0);
        for (counts, left) in self.alive.iter().take(middle).skip(from) {
            let chance = -(-rate).exp_m1();
            excess += counts - left * chance;
            variance += left * chance * (1.0 - chance);
            slope += left * (1.0 - chance);
        }
        let sigma = (variance + (slope * sigma).powi(2)).sqrt();
        Afterpulses { probability: excess / self.all, sigma: sigma / self.all }
    }
}

struct HazardFit<'a>(&'a Hazard);

impl Residuals for HazardFit<'_> {
    type Error = std::convert::Infallible;

    fn residuals(&mut self, at: &[f64]) -> Result<DVector<f64>, Self::Error> {
        let mut residuals = DVector::zeros(self.0.alive.len());
        self.0.residuals([at[0], at[1], at[2]], residuals.as_mut_slice());
        Ok(residuals)
    }
}
