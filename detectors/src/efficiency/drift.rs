//! Change of a rig between readings of its reference wavelength.
//!
//! Each reading of the reference gives an efficiency q there: sensor over photodiode, so that a change of the lamp alone is not in it. Where q changes by more than its readings scatter by
//! themselves, all wavelengths are brought back to the first reading of the reference: q between two readings is a straight line in ln q, whose uncertainty is that of both, of the first, and of
//! a random walk between them, as large as the readings lie off straight lines. A sudden change between two readings cannot be told in time: the wavelengths between them take the mean of both ends,
//! with half of the change as their uncertainty.
//!
//! Where no change is told, nothing is corrected, and the mean square of what q may have changed beyond noise is an uncertainty of all.

use serde::Serialize;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Standard deviations of χ² from which on something is seen, and of a slope.
pub(super) const SEEN: f64 = 3.0;
/// Standard deviations from the other changes by which a change is sudden.
const SUDDEN: f64 = 5.0;
/// Changes between readings that tell which of them is sudden.
const TELLS_STEPS: usize = 3;

/// A reading of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Middle of the reading, s.
    pub time_s: f64,
    /// Natural logarithm of the efficiency.
    pub ln: f64,
    /// Standard uncertainty of that by what this reading has for itself.
    pub sigma: f64,
}

/// Change of a rig at a moment, since the first reading of its reference.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Change {
    /// Relative change of the efficiency that is undone.
    pub relative: f64,
    /// Relative standard uncertainty.
    pub sigma: f64,
    /// Whether it was sudden, at some time between two readings of the reference.
    pub is_step: bool,
}

/// A sudden change between two readings of the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Step {
    /// Reading before, s.
    pub from_s: f64,
    /// Reading after, s.
    pub to_s: f64,
    /// Relative change.
    pub relative: f64,
}

/// Change of a rig over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// Readings of the reference, by time.
    points: Vec<Point>,
    /// Whether the change after each of them, but the last, is sudden.
    sudden: Vec<bool>,
    seen: bool,
    /// Variance of ln q per second of a random walk between readings.
    walk_per_s: f64,
    /// Root mean square of the changes per second.
    pace_per_s: f64,
    /// Root mean square of the change since the first reading beyond noise.
    excess: f64,
}

impl Drift {
    /// Change over readings of the reference; none of less than two.
    pub(super) fn new(mut points: Vec<Point>) -> Option<Self> {
        points.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        points.dedup_by(|b, a| b.time_s <= a.time_s);
        if points.len() < 2 {
            return None;
        }
        let gaps: Vec<Gap> = points.windows(2).map(|pair| Gap::of(pair[0], pair[1])).collect();
        let sudden = sudden(&gaps);
        let steady =
            || gaps.iter().zip(&sudden).filter(|(_, sudden)| !**sudden).map(|(gap, _)| gap);
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
        let pace: Vec<f64> =
            steady().map(|g| (g.change.powi(2) - g.variance) / (g.s * g.s)).collect();
        let pace_per_s = mean(&pace).max(0.0).sqrt();
        let walk: Vec<f64> = (points.windows(3).zip(sudden.windows(2)))
            .filter(|(_, sudden)| !sudden.contains(&true))
            .map(|(w, _)| walk(w[0], w[1], w[2]))
            .collect();
        // Two readings do not tell a step from a line: as if it was one, at any time between them.
        let walk_per_s = match &gaps[..] {
            [one] => (one.change.powi(2) - one.variance) / one.s,
            _ => mean(&walk),
        };
        let first = points[0];
        let beyond: Vec<f64> = (points[1..].iter())
            .map(|p| (p.ln - first.ln).powi(2) - p.sigma.powi(2) - first.sigma.powi(2))
            .collect();
        let seen = sudden.contains(&true) || changes(&points);
        Some(Self {
            excess: mean(&beyond).max(0.0).sqrt(),
            walk_per_s: walk_per_s.max(0.0),
            points,
            sudden,
            seen,
            pace_per_s,
        })
    }

    /// Readings of the reference, by time.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Number of readings of the reference.
    #[must_use]
    pub fn readings(&self) -> usize {
        self.points.len()
    }

    /// Whether a change is told from the readings' own scatter, and undone.
    #[must_use]
    pub fn is_corrected(&self) -> bool {
        self.seen
    }

    /// Relative root mean square of the change since the first reading beyond its noise: where no change is told it is an uncertainty of all.
    #[must_use]
    pub fn hidden(&self) -> f64 {
        self.excess
    }

    /// Largest less least efficiency at the reference, over the least.
    #[must_use]
    pub fn range(&self) -> f64 {
        let least = self.points.iter().map(|p| p.ln).fold(f64::INFINITY, f64::min);
        let most = self.points.iter().map(|p| p.ln).fold(f64::NEG_INFINITY, f64::max);
        (most - least).exp_m1()
    }

    /// Sudden changes.
    #[must_use]
    pub fn steps(&self) -> Vec<Step> {
        let pairs = self.points.windows(2).zip(&self.sudden).filter(|(_, sudden)| **sudden);
        let of = |(pair, _): (&[Point], &bool)| Step {
            from_s: pair[0].time_s,
            to_s: pair[1].time_s,
            relative: (pair[1].ln - pair[0].ln).exp_m1(),
        };
        pairs.map(of).collect()
    }

    /// Time of the last reading of the reference, s: beyond it a change is not known.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.points.last().map_or(f64::NAN, |p| p.time_s)
    }

    /// Change of the rig at a time, s.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Change {
        if !self.seen {
            return Change { relative: 0.0, sigma: self.excess, is_step: false };
        }
        let last = self.points.len() - 1;
        let after = self.points.partition_point(|p| p.time_s <= time_s);
        // Shares of the readings in the change; the first one's is taken off.
        let mut shares = [(0, -1.0), (0, 0.0), (0, 0.0)];
        let mut variance = 0.0;
        let mut is_step = false;
        if after == 0 || after > last {
            let end = after.min(last);
            let beyond_s = (time_s - self.points[end].time_s).abs();
            shares[1] = (end, 1.0);
            variance = (self.pace_per_s * beyond_s).powi(2) + self.walk_per_s * beyond_s;
        } else {
            let (a, b) = (self.points[after - 1], self.points[after]);
            is_step = self.sudden[after - 1];
            let whole_s = b.time_s - a.time_s;
            let part = if is_step { 0.5 } else { (time_s - a.time_s) / whole_s };
            (shares[1], shares[2]) = ((after - 1, 1.0 - part), (after, part));
            variance += match is_step {
                true => (0.5 * (b.ln - a.ln)).powi(2),
                false => self.walk_per_s * whole_s * part * (1.0 - part),
            };
        }
        let ln: f64 = shares.iter().map(|(k, share)| share * self.points[*k].ln).sum();
        for (k, point) in self.points.iter().enumerate() {
            let share: f64 = shares.iter().filter(|(place, _)| *place == k).map(|(_, s)| s).sum();
            variance += (share * point.sigma).powi(2);
        }
        Change { relative: ln.exp_m1(), sigma: variance.sqrt(), is_step }
    }
}

/// Change from one reading to the next.
struct Gap {
    change: f64,
    /// Variance of the change by both readings.
    variance: f64,
    /// Time between them, s.
    s: f64,
}

impl Gap {
    fn of(a: Point, b: Point) -> Self {
        let variance = a.sigma * a.sigma + b.sigma * b.sigma;
        Self { change: b.ln - a.ln, variance, s: b.time_s - a.time_s }
    }
}

/// Variance per second of a random walk by which the middle reading lies as far off the line through the others, less what is noise.
fn walk(a: Point, b: Point, c: Point) -> f64 {
    let (before_s, after_s) = (b.time_s - a.time_s, c.time_s - b.time_s);
    let part = before_s / (before_s + after_s);
    let off = b.ln - (1.0 - part) * a.ln - part * c.ln;
    let noise = b.sigma.powi(2) + ((1.0 - part) * a.sigma).powi(2) + (part * c.sigma).powi(2);
    (off * off - noise) * (before_s + after_s) / (before_s * after_s)
}

/// Whether the readings change by more than they scatter by themselves: about their mean, or along a slope.
fn changes(points: &[Point]) -> bool {
    let weight = |p: &Point| p.sigma.max(1e-12).powi(-2);
    let all: f64 = points.iter().map(weight).sum();
    let mean = |value: &dyn Fn(&Point) -> f64| {
        points.iter().map(|p| weight(p) * value(p)).sum::<f64>() / all
    };
    let (time_s, ln) = (mean(&|p| p.time_s), mean(&|p| p.ln));
    let chi2 = all * mean(&|p| (p.ln - ln).powi(2));
    let freedom = points.len() as f64 - 1.0;
    let spread = all * mean(&|p| (p.time_s - time_s).powi(2));
    let slope = all * mean(&|p| (p.time_s - time_s) * (p.ln - ln)) / spread;
    chi2 > freedom + SEEN * (2.0 * freedom).sqrt() || slope.abs() * spread.sqrt() > SEEN
}

/// Which changes stand out from the others, beyond their noise.
fn sudden(gaps: &[Gap]) -> Vec<bool> {
    if gaps.len() < TELLS_STEPS {
        return vec![false; gaps.len()];
    }
    let pace_per_s = median(gaps.iter().map(|g| g.change / g.s)).unwrap_or(0.0);
    let off: Vec<f64> = gaps.iter().map(|g| (g.change - pace_per_s * g.s).abs()).collect();
    let stands_out = |(k, gap): (usize, &Gap)| {
        let others = off.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, off)| *off);
        let usual = SIGMA_PER_MAD * median(others).unwrap_or(0.0);
        off[k] > SUDDEN * gap.variance.sqrt().hypot(usual)
    };
    gaps.iter().enumerate().map(stands_out).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(ln: &[f64], sigma: f64) -> Vec<Point> {
        let point = |(k, ln): (usize, &f64)| Point { time_s: 600.0 * k as f64, ln: *ln, sigma };
        ln.iter().enumerate().map(point).collect()
    }

    /// Truth by hand: a straight line in ln q, of 1 % from reading to reading with 0.1 % each. A quarter of the way from the second to the third it has changed by 1.25 %; σ² = 0.1² (0.75² + 0.25² + 1²)
    /// (in %), within the first pair 0.1² (0.25² + 0.25²): there the first reading is in both. Beyond the last, by 1 % per 600 s more.
    #[test]
    fn a_line_is_a_line() {
        let drift = Drift::new(points(&[0.0, 0.01, 0.02, 0.03, 0.04], 1e-3)).unwrap();
        assert!(drift.is_corrected() && drift.steps().is_empty());
        let near = |found: Change, ln: f64, sigma: f64| {
            assert!((found.relative.ln_1p() - ln).abs() < 1e-12, "{found:?}");
            assert!((found.sigma / sigma - 1.0).abs() < 1e-9, "{found:?} {sigma}");
            assert!(!found.is_step);
        };
        near(drift.at(750.0), 0.0125, 1e-3 * (0.75_f64.powi(2) + 0.25_f64.powi(2) + 1.0).sqrt());
        near(drift.at(150.0), 0.0025, 1e-3 * (2.0 * 0.25_f64.powi(2)).sqrt());
        let pace2 = 0.01_f64.powi(2) - 2e-6;
        near(drift.at(3000.0), 0.04, (pace2 + 2e-6).sqrt());
        assert!((drift.range() - 0.04_f64.exp_m1()).abs() < 1e-12);
    }

    /// Truth by hand: a jump of 3 % among noise of 0.1 %. Between its readings the mean of both ends, with half of the jump; after it, its whole. Two readings, and three, do not tell a jump from a slope: in the
    /// middle of two a jump of d at any time is off the line by d/2.
    #[test]
    fn a_jump_is_no_line() {
        let drift = Drift::new(points(&[0.0, 0.001, 0.0, 0.03, 0.031, 0.03], 1e-3)).unwrap();
        let steps = drift.steps();
        assert_eq!(steps.len(), 1);
        assert_eq!((steps[0].from_s, steps[0].to_s), (1200.0, 1800.0));
        assert!((steps[0].relative - 0.03_f64.exp_m1()).abs() < 1e-12);
        for time_s in [1210.0, 1500.0, 1790.0] {
            let at = drift.at(time_s);
            assert!(at.is_step && (at.relative.ln_1p() - 0.015).abs() < 1e-12, "{at:?}");
            assert!((at.sigma.powi(2) - 0.015_f64.powi(2) - 1.5e-6).abs() < 1e-12, "{at:?}");
        }
        let at = drift.at(1800.0);
        assert!(!at.is_step && (at.relative.ln_1p() - 0.03).abs() < 1e-12, "{at:?}");
        let two = Drift::new(points(&[0.0, 0.04], 1e-4)).unwrap();
        assert!(two.steps().is_empty() && (two.at(300.0).sigma - 0.02).abs() < 1e-4);
        assert!(Drift::new(points(&[0.0], 1e-4)).is_none());
    }

    /// Truth: noise alone, of which nothing is told; what it may hide is the mean square beyond its own.
    #[test]
    fn noise_is_no_drift() {
        let ln = [0.0, 1.5e-3, -1e-3, 2e-3];
        let drift = Drift::new(points(&ln, 1e-3)).unwrap();
        assert!(!drift.is_corrected());
        let excess: f64 = (ln[1..].iter().map(|l| l * l - 2e-6).sum::<f64>() / 3.0).max(0.0).sqrt();
        let at = drift.at(900.0);
        assert!(excess > 0.0 && (at.sigma - excess).abs() < 1e-15 && at.relative == 0.0, "{at:?}");
    }
}
