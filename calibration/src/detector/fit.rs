//! The law of a detector's dead time, found from counts under lights of known or unknown ratio.
//!
//! Each exposure is under a sum of lights, each the product of a source's level and an attenuator's transmission: n = d + Σ L T. Neutral-density steps are one level and several
//! transmissions, two sources added are the levels A, B, and both. Levels and the dark rate d are always found; a transmission is found where it is not known, and drawn to its value by its
//! uncertainty where it is. A law is told from no law by how the counts of the products bend, never by an absolute rate.
//!
//! The exposures of a light count as their sum: its mean rate and the time that it was seen, whether in one long exposure or in many of a few counts. χ² is that of these means, with the variance that each law itself gives them; what
//! repeats of one light scatter about their mean is no law's. If they scatter more than counting does, all uncertainties grow by as much.
//!
//! | choice | rule |
//! |---|---|
//! | none alone | where no law's χ² is lower by 3.84, so that the intervals of all dead times reach down to none |
//! | a law beside its limits: a recovery beside a dead time alone; many pixels beside one with prolonged dead time | only where Akaike's criterion is lower by [`TELLS`] |
//! | between other laws, and none | the best, where all others are worse by [`TELLS`]; else all that are left |
//! | a law that does not fit | none where χ² exceeds its degrees of freedom by 5 of its standard deviations |
//!
//! Besides the laws of a station there is one for the comparator of many pixels, whose pulses decay and add up. Below one pulse the sum of equal ones that decay exponentially within τ has the distribution function
//! e^(−γν) s^ν/Γ(1+ν), ν = nτ (the generalized Dickman law). A photon is counted where the sum before it is below the level s: m = n e^(−nw) e^(−γν)/Γ(1+ν), with the time w = τ ln(1/s) that one pulse alone is above it. The
//! loss is nw at first, and (π²/12) ν² more than that of a prolonged dead time w, the law without decay. What pixels lose that are not charged, and crosstalk, which makes pulses longer, are in w as far as they go with n; afterpulses,
//! which go with n, in the level of the light. A station takes it as a table.
//!
//! Intervals are of 95 %: the profile of χ² rises by 3.84.

use super::law::Law;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;
use sunglint_radiometry::station::DeadTime;

/// Difference of Akaike's criterion by which data tell two laws apart: odds of 1 to 100.
pub const TELLS: f64 = 9.2;
/// Rise of χ² at the ends of an interval of 95 %.
const RISE: f64 = 3.841_459;
/// Difference of Akaike's criterion by which a dead time is seen: its interval of 95 % does not reach down to none.
const SEEN: f64 = RISE - 2.0;
/// Shortest and longest time that is tried, over the time between counts at the brightest: the shortest is none.
const LEAST_TIME: f64 = 1e-7;
const MOST_TIME: f64 = 1e7;
/// Euler's constant.
const EULER: f64 = 0.577_215_664_901_532_9;
/// Points of the table of a law that a station does not have, and its least light over its most. A step of it is 2.8 %, by which lines are off a law by 1e-4 of what is lost.
const TABLE: u32 = 500;
const LEAST_LIGHT: f64 = 1e-6;
/// Standard deviations of χ² beyond which a law does not fit.
const MISFIT: f64 = 5.0;

/// A light on the detector: which level, and through which attenuator, both from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Light {
    /// Number of the level.
    pub level: usize,
    /// Number of the attenuator.
    pub step: usize,
}

/// Counts of one exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposure {
    /// Lights that were on; none in the dark.
    pub lights: Vec<Light>,
    /// Counts.
    pub counts: u64,
    /// Length of the exposure, s.
    pub exposure_s: f64,
}

/// Transmission of an attenuator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Transmission {
    /// Known, with a relative standard uncertainty.
    Known {
        /// Transmission, relative to the others.
        value: f64,
        /// Relative standard uncertainty.
        relative_sigma: f64,
    },
    /// To be found.
    Unknown,
}

/// A value that was found, with its interval of 95 %.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Name with its unit, as a station's file has it.
    pub name: &'static str,
    /// Best value.
    pub value: f64,
    /// Lower end of its interval; 0 where no value above 0 is told from none.
    pub low: f64,
    /// Upper end of its interval.
    pub high: f64,
}

/// A part of the counted rates, and how a law fits there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Least and largest mean counted rate of its lights, Hz.
    pub counted_hz: (f64, f64),
    /// Lights.
    pub lights: usize,
    /// χ² of the means of their exposures, over the scatter of the repeats.
    pub chi2: f64,
    /// Measured rate over that of the law, less 1, of the light that fits worst.
    pub worst: f64,
}

/// A law through the counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Name of the law, as a station's file has it; `decaying_pulses` is none of a station.
    pub name: &'static str,
    /// The law with its best values; a table of it where a station does not have it.
    pub law: DeadTime,
    /// Values of the law.
    pub found: Vec<Found>,
    /// χ² of the lights' mean counts, over the scatter of the repeats.
    pub chi2: f64,
    /// Lights and transmissions that are known not exactly, less what was found.
    pub freedom: usize,
    /// Akaike's criterion: χ², with the logarithms of the variances, which laws have each their own, and two for each of a law's times.
    pub criterion: f64,
    /// Whether it fits.
    pub fits: bool,
    /// Decades of the counted rate in which there are lights, the dark left out.
    pub regions: Vec<Region>,
    /// Dark rate, Hz.
    pub dark_hz: f64,
    /// Rate of each level through an attenuator of transmission 1, Hz.
    pub level_hz: Vec<f64>,
    /// Transmissions.
    pub transmission: Vec<f64>,
}

/// Laws that counts allow.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// All laws that were tried, the best first.
    pub fitted: Vec<Fitted>,
    /// Numbers of the laws among which the data cannot tell; one where they can; none where no law fits.
    pub left: Vec<usize>,
    /// Scatter of repeats of one light over that of counting, a ratio of variances; 1 where it is less.
    pub scatter: f64,
    /// Least mean rate of a light and largest of an exposure, Hz, the dark left out.
    pub measured_hz: (f64, f64),
}

impl Choice {
    /// Returns the law that the data tell, if they do.
    pub fn told(&self) -> Option<&Fitted> {
        match self.left[..] {
            [one] => self.fitted.get(one),
            _ => None,
        }
    }
}

/// Why there is no law.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// An exposure that cannot be.
    #[error("exposure {number}: {name}: found {found}, expected {expected}")]
    Exposure {
        /// Which, from 1.
        number: usize,
        /// Name of the value.
        name: &'static str,
        /// It.
        found: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// A transmission that cannot be.
    #[error("transmission {number}: found {found}, expected a number above 0")]
    Transmission {
        /// Which, from 1.
        number: usize,
        /// It.
        found: f64,
    },
    /// Too little data.
    #[error(
        "{lights} different lights and {known} known transmissions cannot tell a law and {unknowns} unknown levels and transmissions: measure more steps, a second level, or two sources alone and together"
    )]
    TooFew {
        /// Different lights, the dark among them.
        lights: usize,
        /// Known transmissions.
        known: usize,
        /// Levels and transmissions that are to be found, and the dark.
        unknowns: usize,
    },
    /// Ratios that the counts leave open.
    #[error(
        "the counts leave open which part of their bend is the detector's and which the attenuators': give a step's optical density, a second level, or two sources alone and together"
    )]
    Open,
    /// A level that is only seen together with others.
    #[error("level {0} was never measured alone")]
    NeverAlone(usize),
}

/// Kind of a law, without its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    None,
    NonParalysable,
    Paralysable,
    Recovery,
    MultiPixel(u32),
    Decaying,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::NonParalysable => "non_paralysable",
            Self::Paralysable => "paralysable",
            Self::Recovery => "exponential_recovery",
            Self::MultiPixel(_) => "multi_pixel",
            Self::Decaying => "decaying_pulses",
        }
    }

    fn values(self) -> &'static [&'static str] {
        match self {
            Self::None => &[],
            Self::NonParalysable | Self::Paralysable => &["dead_time_ns"],
            Self::Recovery => &["dead_time_ns", "recovery_ns"],
            Self::MultiPixel(_) => &["recovery_ns", "pulse_ns"],
            Self::Decaying => &["pulse_ns", "decay_ns"],
        }
    }

    /// The law with times in s; the one whose pulses decay without that.
    fn law(self, times_s: &[f64]) -> DeadTime {
        let time = |k: usize| times_s.get(k).copied().unwrap_or(0.0);
        match self {
            Self::None => DeadTime::None,
            Self::NonParalysable => DeadTime::NonParalysable { dead_time_s: time(0) },
            Self::Paralysable | Self::Decaying => DeadTime::Paralysable { dead_time_s: time(0) },
            Self::Recovery => {
                DeadTime::ExponentialRecovery { dead_time_s: time(0), recovery_s: time(1) }
            }
            Self::MultiPixel(pixels) => {
                DeadTime::MultiPixel { pixels, recovery_s: time(0), pulse_s: time(1) }
            }
        }
    }

    /// Rate that is counted of a true one, Hz.
    fn counted_hz(self, times_s: &[f64], true_hz: f64) -> f64 {
        let counted = self.law(times_s).counted_hz(true_hz).unwrap_or(true_hz);
        match (self, times_s) {
            (Self::Decaying, [_, decay_s]) => {
                let nu = true_hz * decay_s;
                counted * (-EULER * nu - libm::lgamma(1.0 + nu)).exp()
            }
            _ => counted,
        }
    }

    /// The law for a station, from the light to twice the brightest.
    fn for_station(self, times_s: &[f64], brightest_hz: f64) -> DeadTime {
        if self != Self::Decaying {
            return self.law(times_s);
        }
        let (mut measured_hz, mut true_hz) = (vec![0.0], vec![0.0]);
        for k in 0..=TABLE {
            let n = 2.0 * brightest_hz * LEAST_LIGHT.powf(1.0 - f64::from(k) / f64::from(TABLE));
            let m = self.counted_hz(times_s, n);
            // Its rising side only.
            if measured_hz.last().is_some_and(|last| m <= *last) {
                break;
            }
            measured_hz.push(m);
            true_hz.push(n);
        }
        DeadTime::Table { measured_hz, true_hz }
    }
}

/// Finds the laws that the counts allow. `pixels` is the number of the detector's pixels, where it has many: only then the law of many pixels is tried.
///
/// # Errors
/// Exposures or transmissions that cannot be; too few of them; ratios that they leave open.
pub fn fit(
    exposures: &[Exposure],
    steps: &[Transmission],
    pixels: Option<u32>,
) -> Result<Choice, FitError> {
    let data = Data::new(exposures, steps)?;
    let mut kinds = vec![Kind::None, Kind::NonParalysable, Kind::Paralysable, Kind::Recovery];
    if let Some(pixels) = pixels.filter(|n| *n > 0) {
        kinds.extend([Kind::MultiPixel(pixels), Kind::Decaying]);
    }
    let mut fitted = Vec::new();
    for kind in kinds {
        fitted.push((kind, data.fitted(kind)?));
    }
    fitted.sort_by(|a, b| a.1.criterion.total_cmp(&b.1.criterion));
    let criterion = |kind: fn(&Kind) -> bool| {
        let found = fitted.iter().find(|(k, f)| kind(k) && f.fits);
        found.map(|(_, f)| f.criterion)
    };
    let none = criterion(|k| *k == Kind::None);
    let plain = criterion(|k| *k == Kind::NonParalysable);
    let one = criterion(|k| *k == Kind::Paralysable);
    let best = fitted.iter().find(|(_, f)| f.fits).map(|(_, f)| f.criterion);
    let stands = |(kind, f): &(Kind, Fitted)| {
        let better = |than: Option<f64>| than.is_none_or(|than| f.criterion < than - TELLS);
        let seen = none.is_none_or(|none| f.criterion < none - SEEN);
        let earns = match kind {
            Kind::None => true,
            Kind::Recovery => seen && better(plain),
            Kind::MultiPixel(_) | Kind::Decaying => seen && better(one),
            _ => seen,
        };
        f.fits && earns
    };
    let standing: Vec<usize> = (0..fitted.len()).filter(|k| stands(&fitted[*k])).collect();
    // No law is the simplest: where no dead time is seen, it is the one.
    let simple = none.zip(best).is_some_and(|(none, best)| none < best + SEEN);
    let least = standing.iter().map(|k| fitted[*k].1.criterion).fold(f64::INFINITY, f64::min);
    let left = standing
        .into_iter()
        .filter(|k| match simple {
            true => fitted[*k].0 == Kind::None,
            false => fitted[*k].1.criterion < least + TELLS,
        })
        .collect();
    let lit = exposures.iter().filter(|e| !e.lights.is_empty());
    let most_hz = lit.map(|e| e.counts as f64 / e.exposure_s).fold(0.0, f64::max);
    let lit = data.seen.iter().filter(|seen| !seen.lights.is_empty());
    let measured_hz = (lit.map(Seen::hz).fold(f64::INFINITY, f64::min), most_hz);
    let fitted = fitted.into_iter().map(|(_, f)| f).collect();
    Ok(Choice { fitted, left, scatter: data.scatter, measured_hz })
}

/// A light, and all of its exposures together.
struct Seen<'a> {
    lights: &'a [Light],
    counts: f64,
    time_s: f64,
}

impl Seen<'_> {
    /// Mean rate, Hz.
    fn hz(&self) -> f64 {
        self.counts / self.time_s
    }
}

/// The lights that were seen, and how the unknowns lie in the vector that is fitted: logarithms of times, of levels, of transmissions; the dark rate.
struct Data<'a> {
    seen: Vec<Seen<'a>>,
    levels: usize,
    steps: &'a [Transmission],
    /// Place of each step's transmission among those that are found; none of the one that all others are relative to.
    free_step: Vec<Option<usize>>,
    free_steps: usize,
    has_dark: bool,
    known: usize,
    scatter: f64,
    /// Scale of the dark rate in the vector, Hz.
    dark_scale_hz: f64,
    /// The largest rate, Hz.
    most_hz: f64,
}

impl<'a> Data<'a> {
    fn new(exposures: &'a [Exposure], steps: &'a [Transmission]) -> Result<Self, FitError> {
        for (k, e) in exposures.iter().enumerate() {
            let bad =
                |name, found, expected| FitError::Exposure { number: k + 1, name, found, expected };
            if !(e.exposure_s.is_finite() && e.exposure_s > 0.0) {
                return Err(bad("exposure_s", e.exposure_s, "a number above 0"));
            }
            if let Some(light) = e.lights.iter().find(|l| l.step >= steps.len()) {
                return Err(bad("step", light.step as f64, "a step of the plan"));
            }
        }
        for (k, step) in steps.iter().enumerate() {
            if let Transmission::Known { value, relative_sigma } = step {
                for found in [*value, relative_sigma + 1.0] {
                    if !(found.is_finite() && found > 0.0) {
                        return Err(FitError::Transmission { number: k + 1, found });
                    }
                }
            }
        }
        let mut sums: BTreeMap<&[Light], (f64, f64)> = BTreeMap::new();
        for e in exposures {
            let (counts, time_s) = sums.entry(&e.lights[..]).or_default();
            *counts += e.counts as f64;
            *time_s += e.exposure_s;
        }
        let scatter = scatter(exposures, &sums);
        let groups: Vec<&[Light]> = sums.keys().copied().collect();
        let one = |(lights, (counts, time_s))| Seen { lights, counts, time_s };
        let seen: Vec<Seen> = sums.into_iter().map(one).collect();
        let levels = exposures.iter().flat_map(|e| &e.lights).map(|l| l.level + 1).max();
        let levels = levels.unwrap_or(0);
        for level in 0..levels {
            let alone = groups.iter().any(|g| matches!(g, [one] if one.level == level));
            if !alone {
                return Err(FitError::NeverAlone(level + 1));
            }
        }
        // One transmission is the unit, unless one is known: then they are what they are known to be.
        let exact = |t: &Transmission| matches!(t, Transmission::Known { relative_sigma, .. } if *relative_sigma == 0.0);
        let is_known = |t: &Transmission| matches!(t, Transmission::Known { .. });
        let unit =
            (steps.iter().position(exact)).or_else(|| steps.iter().position(is_known)).unwrap_or(0);
        let mut free_steps = 0;
        let used = |k: usize| groups.iter().any(|g| g.iter().any(|l| l.step == k));
        let free_step: Vec<Option<usize>> = (0..steps.len())
            .map(|k| {
                let free = k != unit && used(k) && !exact(&steps[k]);
                free.then(|| {
                    free_steps += 1;
                    free_steps - 1
                })
            })
            .collect();
        let known =
            (0..steps.len()).filter(|k| *k != unit && used(*k) && is_known(&steps[*k])).count();
        let has_dark = groups.iter().any(|g| g.is_empty());
        let unknowns = levels + free_steps + usize::from(has_dark);
        let exact_known = known
            - (0..steps.len()).filter(|k| free_step[*k].is_some() && is_known(&steps[*k])).count();
        // A law takes one more at least; exactly known steps are no unknowns already.
        let priors = known - exact_known;
        if groups.len() + priors <= unknowns {
            return Err(FitError::TooFew { lights: groups.len(), known, unknowns });
        }
        let most_hz = seen.iter().map(Seen::hz).fold(0.0, f64::max).max(1e-3);
        let dark = seen.iter().find(|seen| seen.lights.is_empty());
        let dark_scale_hz = dark.map_or(1.0, |dark| dark.counts.max(1.0) / dark.time_s);
        Ok(Self {
            seen,
            levels,
            steps,
            free_step,
            free_steps,
            has_dark,
            known: priors,
            scatter,
            dark_scale_hz,
            most_hz,
        })
    }

    /// Logarithms of the shortest and the longest time that is tried, s.
    fn reach(&self) -> (f64, f64) {
        ((LEAST_TIME / self.most_hz).ln(), (MOST_TIME / self.most_hz).ln())
    }

    fn unknowns(&self) -> usize {
        self.levels + self.free_steps + usize::from(self.has_dark)
    }

    fn transmission(&self, step: usize, x: &[f64]) -> f64 {
        match (self.free_step[step], self.steps[step]) {
            (Some(free), _) => x[self.levels + free].exp(),
            (None, Transmission::Known { value, .. }) => value,
            (None, Transmission::Unknown) => 1.0,
        }
    }

    /// Rates of the lights; `x` are the unknowns without the law's.
    fn rates_hz(&self, x: &[f64]) -> Vec<f64> {
        let dark_hz = match self.has_dark {
            true => x[self.levels + self.free_steps].max(0.0) * self.dark_scale_hz,
            false => 0.0,
        };
        let of = |seen: &Seen| {
            let lit = seen.lights.iter().map(|l| x[l.level].exp() * self.transmission(l.step, x));
            dark_hz + lit.sum::<f64>()
        };
        self.seen.iter().map(of).collect()
    }

    /// Residuals of lights and of known transmissions, in standard deviations. `sigma` are those of the lights' mean rates, Hz.
    fn residuals(&self, kind: Kind, x: &[f64], sigma_hz: &[f64]) -> DVector<f64> {
        let times = kind.values().len();
        let times_s: Vec<f64> = x[..times].iter().map(|ln| ln.exp()).collect();
        let rates = self.rates_hz(&x[times..]);
        let mut all: Vec<f64> = (self.seen.iter().zip(rates).zip(sigma_hz))
            .map(|((seen, n), sigma)| (seen.hz() - kind.counted_hz(&times_s, n)) / sigma)
            .collect();
        for (k, step) in self.steps.iter().enumerate() {
            if let (Some(free), Transmission::Known { value, relative_sigma }) =
                (self.free_step[k], step)
            {
                all.push((x[times + self.levels + free] - value.ln()) / relative_sigma);
            }
        }
        DVector::from_vec(all)
    }

    /// Standard deviation of each light's mean rate by a law, Hz, without the scatter of the repeats. A light without counts has that of one.
    fn sigma_hz(&self, kind: Kind, x: &[f64]) -> Vec<f64> {
        let times = kind.values().len();
        let times_s: Vec<f64> = x[..times].iter().map(|ln| ln.exp()).collect();
        let dead_time = kind.law(&times_s);
        let law = Law::new(&dead_time).ok();
        let sigma = |seen: &Seen| {
            let at = law.as_ref().and_then(|law| law.invert(seen.hz()).ok());
            // Past a law's end its variance is not known: that of a Poisson process is more.
            let fano = at.map_or(1.0, |at| at.fano).clamp(1e-3, 10.0);
            (seen.counts.max(1.0) * fano).sqrt() / seen.time_s
        };
        self.seen.iter().map(sigma).collect()
    }

    /// Levels and transmissions as if nothing was lost but by a first guess.
    fn begin(&self, kind: Kind, times_s: &[f64]) -> Option<Vec<f64>> {
        let law = Law::new(&kind.law(times_s)).ok()?;
        let undone = |m: f64| law.invert(m).map_or(f64::NAN, |at| at.rate_hz);
        let dark = self.seen.iter().find(|seen| seen.lights.is_empty()).map_or(0.0, Seen::hz);
        let unknowns = self.levels + self.free_steps;
        let (mut rows, mut right) = (Vec::new(), Vec::new());
        for seen in &self.seen {
            let [light] = seen.lights else { continue };
            let mean = seen.hz();
            let rate = (undone(mean) - undone(dark)).max(0.5 * (mean - dark)).max(1e-3);
            if !rate.is_finite() {
                return None;
            }
            let mut row = vec![0.0; unknowns];
            row[light.level] = 1.0;
            let mut value = rate.ln();
            match self.free_step[light.step] {
                Some(free) => row[self.levels + free] = 1.0,
                None => value -= self.transmission(light.step, &[]).ln(),
            }
            rows.push(row);
            right.push(value);
        }
        for (k, step) in self.steps.iter().enumerate() {
            if let (Some(free), Transmission::Known { value, .. }) = (self.free_step[k], step) {
                let mut row = vec![0.0; unknowns];
                row[self.levels + free] = 10.0;
                rows.push(row);
                right.push(10.0 * value.ln());
            }
        }
        let matrix = DMatrix::from_fn(rows.len(), unknowns, |i, j| rows[i][j]);
        let solved = matrix.svd(true, true).solve(&DVector::from_vec(right), 1e-10).ok()?;
        let mut x: Vec<f64> = times_s.iter().map(|s| s.ln()).collect();
        x.extend(solved.iter());
        if self.has_dark {
            x.push(dark / self.dark_scale_hz);
        }
        Some(x)
    }

    /// Levenberg and Marquardt's steps from a point, the unknowns in `fixed` left as they are. Gives the point and its χ².
    fn descend(
        &self,
        kind: Kind,
        from: &[f64],
        sigma_hz: &[f64],
        fixed: &[usize],
    ) -> (Vec<f64>, f64) {
        let free: Vec<usize> = (0..from.len()).filter(|k| !fixed.contains(k)).collect();
        let (times, (least, most)) = (kind.values().len(), self.reach());
        let mut x = from.to_vec();
        let mut at = self.residuals(kind, &x, sigma_hz);
        let mut chi2 = at.norm_squared();
        let mut damping = 1e-3;
        for _ in 0..200 {
            let jacobian = self.jacobian(kind, &x, sigma_hz, &free);
            let square = jacobian.transpose() * &jacobian;
            let gradient = jacobian.transpose() * &at;
            let mut better = false;
            for _ in 0..12 {
                let mut damped = square.clone();
                for k in 0..free.len() {
                    damped[(k, k)] += damping * square[(k, k)].max(1e-12);
                }
                let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                    damping *= 10.0;
                    continue;
                };
                let mut next = x.clone();
                for (k, place) in free.iter().enumerate() {
                    next[*place] -= step[k].clamp(-2.0, 2.0);
                    // The logarithm of a time that is not there has no end.
                    if *place < times {
                        next[*place] = next[*place].clamp(least, most);
                    }
                }
                let there = self.residuals(kind, &next, sigma_hz);
                let new = there.norm_squared();
                if new.is_finite() && new <= chi2 {
                    let gain = chi2 - new;
                    (x, at, chi2) = (next, there, new);
                    damping = (damping * 0.2).max(1e-12);
                    better = gain > 1e-9 * (1.0 + chi2);
                    break;
                }
                damping *= 5.0;
            }
            if !better {
                break;
            }
        }
        (x, chi2)
    }

    fn jacobian(&self, kind: Kind, x: &[f64], sigma_hz: &[f64], free: &[usize]) -> DMatrix<f64> {
        const STEP: f64 = 1e-5;
        let mut columns = Vec::with_capacity(free.len());
        for place in free {
            let mut moved = x.to_vec();
            moved[*place] = x[*place] + STEP;
            let up = self.residuals(kind, &moved, sigma_hz);
            moved[*place] = x[*place] - STEP;
            columns.push((up - self.residuals(kind, &moved, sigma_hz)) / (2.0 * STEP));
        }
        if columns.is_empty() {
            return DMatrix::zeros(self.seen.len() + self.known, 0);
        }
        DMatrix::from_columns(&columns)
    }

    /// The best of a law from several beginnings.
    fn fitted(&self, kind: Kind) -> Result<Fitted, FitError> {
        let most_hz = self.most_hz;
        let times = kind.values().len();
        let beginnings: Vec<Vec<f64>> = match kind {
            Kind::None => vec![vec![]],
            Kind::NonParalysable | Kind::Paralysable => {
                [1e-4, 1e-2, 0.1, 0.3].iter().map(|part| vec![part / most_hz]).collect()
            }
            Kind::Recovery => {
                let part = |dead: f64, recovery: f64| vec![dead / most_hz, recovery / most_hz];
                vec![part(0.1, 0.01), part(0.01, 0.1), part(0.1, 0.1), part(1e-3, 0.3)]
            }
            Kind::Decaying => {
                let part = |pulse: f64, decay: f64| vec![pulse / most_hz, decay / most_hz];
                vec![part(0.1, 0.03), part(0.03, 0.1), part(0.2, 0.2), part(0.1, 1e-3)]
            }
            Kind::MultiPixel(pixels) => {
                let part = |recovery: f64, pulse: f64| {
                    vec![recovery * f64::from(pixels) / most_hz, pulse / most_hz]
                };
                vec![part(0.01, 0.01), part(0.2, 0.02), part(0.02, 0.2), part(1e-3, 1e-3)]
            }
        };
        let mut best: Option<(Vec<f64>, f64, Vec<f64>)> = None;
        for begin in beginnings {
            let Some(mut x) = self.begin(kind, &begin) else { continue };
            let mut sigma = self.sigma_hz(kind, &x);
            let chi2;
            // The variance is that of the law, which moves while it is found.
            for _ in 0..3 {
                (x, _) = self.descend(kind, &x, &sigma, &[]);
                sigma = self.sigma_hz(kind, &x);
            }
            (x, chi2) = self.descend(kind, &x, &sigma, &[]);
            if best.as_ref().is_none_or(|(_, least, _)| chi2 < *least) {
                best = Some((x, chi2, sigma));
            }
        }
        let Some((x, chi2, sigma)) = best else { return Err(FitError::Open) };
        self.check_told(kind, &x, &sigma)?;
        let freedom = (self.seen.len() + self.known).saturating_sub(times + self.unknowns());
        let chi2_scattered = chi2 / self.scatter;
        let fits = chi2_scattered <= freedom as f64 + MISFIT * (2.0 * freedom as f64).sqrt()
            || freedom == 0;
        let variances: f64 = sigma.iter().map(|sigma| 2.0 * sigma.ln()).sum();
        let found = (0..times)
            .map(|k| {
                let (low, high) = self.interval(kind, &x, chi2, &sigma, k);
                let ns = |ln: f64| 1e9 * ln.exp();
                Found { name: kind.values()[k], value: ns(x[k]), low: ns(low), high: ns(high) }
            })
            .collect();
        let times_s: Vec<f64> = x[..times].iter().map(|ln| ln.exp()).collect();
        let light = &x[times..];
        let regions = self.regions(&|n| kind.counted_hz(&times_s, n), light, &sigma);
        let brightest_hz = self.rates_hz(light).into_iter().fold(0.0, f64::max);
        let dark_hz = if self.has_dark {
            light[self.levels + self.free_steps].max(0.0) * self.dark_scale_hz
        } else {
            0.0
        };
        Ok(Fitted {
            name: kind.name(),
            law: kind.for_station(&times_s, brightest_hz),
            found,
            chi2: chi2_scattered,
            freedom,
            criterion: chi2_scattered + variances + 2.0 * times as f64,
            fits,
            regions,
            dark_hz,
            level_hz: light[..self.levels].iter().map(|ln| ln.exp()).collect(),
            transmission: (0..self.steps.len()).map(|k| self.transmission(k, light)).collect(),
        })
    }

    /// Misfit of a law in each decade of the counted rate; `light` are the unknowns without the law's.
    fn regions(&self, law: &dyn Fn(f64) -> f64, light: &[f64], sigma_hz: &[f64]) -> Vec<Region> {
        let mut decades: BTreeMap<i32, Region> = BTreeMap::new();
        let rates = self.rates_hz(light);
        for ((seen, true_hz), sigma_hz) in self.seen.iter().zip(rates).zip(sigma_hz) {
            if seen.lights.is_empty() {
                continue;
            }
            let (counted, law_hz) = (seen.hz(), law(true_hz));
            let decade = counted.max(1e-3).log10().floor() as i32;
            let region = decades.entry(decade).or_insert(Region {
                counted_hz: (counted, counted),
                lights: 0,
                chi2: 0.0,
                worst: 0.0,
            });
            let (least, most) = region.counted_hz;
            region.counted_hz = (least.min(counted), most.max(counted));
            region.lights += 1;
            region.chi2 += ((counted - law_hz) / sigma_hz).powi(2) / self.scatter;
            let off = counted / law_hz - 1.0;
            if off.abs() > region.worst.abs() {
                region.worst = off;
            }
        }
        decades.into_values().collect()
    }

    /// Levels and transmissions that the counts do not tell at all. The law's own times may be untold: their interval says so.
    fn check_told(&self, kind: Kind, x: &[f64], sigma_hz: &[f64]) -> Result<(), FitError> {
        let times = kind.values().len();
        // A dark rate that would best be below 0 stands at 0: it is told well enough.
        let dark = times + self.levels + self.free_steps;
        let free: Vec<usize> = (times..x.len()).filter(|k| *k != dark || x[*k] > 0.0).collect();
        let jacobian = self.jacobian(kind, x, sigma_hz, &free);
        let scaled = DMatrix::from_fn(jacobian.nrows(), jacobian.ncols(), |i, j| {
            jacobian[(i, j)] / jacobian.column(j).norm().max(f64::MIN_POSITIVE)
        });
        let values = scaled.svd(false, false).singular_values;
        let (least, most) = (values.min(), values.max());
        if values.is_empty() || least > 1e-7 * most { Ok(()) } else { Err(FitError::Open) }
    }

    /// Ends of a time's interval, as logarithms: where the profile of χ² has risen.
    fn interval(
        &self,
        kind: Kind,
        x: &[f64],
        chi2: f64,
        sigma_hz: &[f64],
        place: usize,
    ) -> (f64, f64) {
        let (rise, (least, most)) = (RISE * self.scatter, self.reach());
        let profile = |from: &[f64], value: f64| {
            let mut x = from.to_vec();
            x[place] = value;
            let (x, there) = self.descend(kind, &x, sigma_hz, &[place]);
            (x, there - chi2 - rise)
        };
        let end = |sign: f64| {
            let (mut inside, mut step) = (x.to_vec(), 1e-3);
            // Out to where it has risen, and back by halves.
            let outside = loop {
                let value = inside[place] + sign * step;
                if value <= least || value >= most {
                    return sign * f64::INFINITY;
                }
                let (there, above) = profile(&inside, value);
                if above > 0.0 {
                    break value;
                }
                inside = there;
                step *= 2.0;
            };
            let (mut low, mut high) = (inside[place], outside);
            while (high - low).abs() > 1e-4 {
                let middle = 0.5 * (low + high);
                let (there, above) = profile(&inside, middle);
                if above > 0.0 {
                    high = middle;
                } else {
                    (inside, low) = (there, middle);
                }
            }
            low
        };
        (end(-1.0), end(1.0))
    }
}

/// Variance of the repeats about their means over that of photons; 1 within its own scatter, which grows where exposures hold few counts. A dead time only makes them scatter less.
fn scatter(exposures: &[Exposure], sums: &BTreeMap<&[Light], (f64, f64)>) -> f64 {
    let (mut chi2, mut variance, mut freedom) = (0.0, 0.0, -(sums.len() as f64));
    for e in exposures {
        let (counts, time_s) = sums[&e.lights[..]];
        // A light without a count says nothing.
        let expected = counts.max(1.0) * e.exposure_s / time_s;
        chi2 += (e.counts as f64 - counts * e.exposure_s / time_s).powi(2) / expected;
        variance += 2.0 + 1.0 / expected;
        freedom += 1.0;
    }
    let freedom = freedom.max(1.0);
    if chi2 > freedom + 3.0 * variance.sqrt() { chi2 / freedom } else { 1.0 }
}
