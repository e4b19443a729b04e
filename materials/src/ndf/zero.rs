//! The stage's angle at which the beam falls along the sample's normal, from the readings on both sides of it.

use super::NdfError;
use super::profile::GAP_STEPS;
use super::scan::Scan;
use super::shape::{EVERY_ALPHA, Reading, fit, golden};
use super::spline::Knots;
use serde::{Deserialize, Serialize};
use sunglint_simulator::surface::Distribution;

/// Readings that each side needs.
const LEAST_A_SIDE: usize = 4;
/// A symmetry point is not known where the readings allow another one that is farther from it, degrees.
const MOST_UNSURE_DEG: f64 = 1.5;
/// Standard deviations by which a sum of squares exceeds its mean before a trial is refused, and by which the middle is darker than elsewhere.
const REFUSED: f64 = 4.0;
const DARKER: f64 = 4.0;
/// Readings that are looked at in the middle.
const MIDDLE: usize = 5;
/// The part of the readings that need others at the same angle on the other side.
const LEAST_MIRRORED: f64 = 0.5;

/// Where the symmetry point came from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ZeroOrigin {
    /// From the readings on both sides.
    Fitted,
    /// Symmetry point that the user gave.
    Given,
    /// From a law that meets all readings, those of the flank, too, within their scatter, where both sides do not decide it.
    Law,
    /// The stage's own zero: one side alone was measured, or what is the same everywhere has no symmetry point.
    Assumed,
}

/// The symmetry point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Zero {
    /// The stage's angle at normal incidence, degrees: the mount's offset.
    pub angle_deg: f64,
    /// Standard deviation of the symmetry point, degrees; 0 where it was not fitted.
    pub sigma_deg: f64,
    /// Where it came from.
    pub origin: ZeroOrigin,
}

struct Judge<'a> {
    scan: &'a Scan,
    weights: Vec<f64>,
    step: f64,
}

impl Judge<'_> {
    /// Readings within `reach` of `zero`.
    fn within(&self, zero: f64, reach: f64) -> Vec<usize> {
        let near = |k: &usize| (self.scan.angle_deg[*k] - zero).abs() <= reach;
        (0..self.scan.angle_deg.len()).filter(near).collect()
    }

    /// How far both sides reach.
    fn reach(&self, zero: f64) -> f64 {
        let angles = &self.scan.angle_deg;
        (zero - angles[0]).min(angles[angles.len() - 1] - zero)
    }

    /// Returns the residual of these readings from an even function, and how many readings more than freedoms there are.
    fn left(&self, zero: f64, part: &[usize]) -> Option<(f64, f64)> {
        let offset = |k: usize| self.scan.angle_deg[k] - zero;
        let reach = part.iter().fold(0.0_f64, |a, k| a.max(offset(*k).abs()));
        // Coarser than the readings: what is the same on both sides does not need to be followed to the last digit.
        let knots = ((reach / (1.5 * self.step)).floor() as usize).max(2);
        let knots = Knots::new((0..=knots).map(|k| reach * k as f64 / knots as f64).collect())?;
        let readings: Vec<(f64, f64, f64)> =
            part.iter().map(|k| (offset(*k), self.scan.f[*k].ln(), self.weights[*k])).collect();
        let spline = knots.through(&readings)?;
        let square = |(x, y, w): &(f64, f64, f64)| w * (y - spline.at(*x)).powi(2);
        let free = part.len() as f64 - (reach / (1.5 * self.step)).floor().max(2.0) - 1.0;
        Some((readings.iter().map(square).sum(), free))
    }

    /// The part of these readings whose angle lies between readings, no gap, on the other side of `zero`, too; and the widest gap (stage angles, degrees).
    fn mirrored(&self, zero: f64, part: &[usize]) -> (f64, (f64, f64)) {
        let angles = &self.scan.angle_deg;
        let most = GAP_STEPS * self.step + 1e-9;
        let covered = |k: &&usize| {
            let mirror = 2.0 * zero - angles[**k];
            let next = angles.partition_point(|a| *a < mirror);
            let of = |k: usize| angles.get(k).copied().unwrap_or(f64::INFINITY);
            let before = if next > 0 { angles[next - 1] } else { f64::NEG_INFINITY };
            of(next) - before <= most
        };
        let count = part.iter().filter(covered).count();
        let widest = angles.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        (count as f64 / part.len().max(1) as f64, widest.map_or((0.0, 0.0), |w| (w[0], w[1])))
    }

    /// Variance of ln f by the scatter about what neighbours say, times the weights; at least 1 where standard deviations are known.
    ///
    /// Two neighbours say a straight line and four a cubic; both take a bend of the lobe for scatter, so that the smaller one is nearer to the noise.
    fn noise(&self) -> f64 {
        let scatter = self.scatter(1).min(self.scatter(2));
        if self.scan.sigma.iter().all(|s| *s > 0.0) { scatter.max(1.0) } else { scatter }
    }

    /// Mean square of the weighted differences of ln f from the polynomial through `aside` neighbours on each side, over the factor by which noise of the
    /// neighbours adds to it; readings beside a gap are left out.
    fn scatter(&self, aside: usize) -> f64 {
        let angles = &self.scan.angle_deg;
        let wide = |k: usize| angles[k + aside] - angles[k - aside];
        let places = aside..angles.len().saturating_sub(aside);
        let mut widths: Vec<f64> = places.clone().map(wide).collect();
        widths.sort_by(f64::total_cmp);
        let usual = widths.get(widths.len() / 2).copied().unwrap_or(0.0);
        let offs: Vec<f64> = places
            .filter(|k| wide(*k) > 0.0 && wide(*k) < 1.5 * usual)
            .filter_map(|k| {
                let near: Vec<usize> = (k - aside..=k + aside).filter(|j| *j != k).collect();
                let (mut off, mut factor) = (self.scan.f[k].ln(), 1.0);
                for j in &near {
                    // Lagrange's weight of this neighbour.
                    let others = near.iter().filter(|m| *m != j);
                    let weight: f64 = others
                        .map(|m| (angles[k] - angles[*m]) / (angles[*j] - angles[*m]))
                        .product();
                    off -= weight * self.scan.f[*j].ln();
                    factor += weight * weight;
                }
                // Two readings at one angle have no polynomial.
                let square = self.weights[k] * off * off / factor;
                square.is_finite().then_some(square)
            })
            .collect();
        // The mean, not the median: standard deviations from few readings each are often far too small.
        if offs.is_empty() { f64::INFINITY } else { offs.iter().sum::<f64>() / offs.len() as f64 }
    }

    /// The trial that leaves least, among those that noise allows the one with the most readings, and what it leaves.
    fn best(&self, tried: &[(f64, f64, f64)], noise: f64) -> Option<(f64, f64)> {
        let least = tried.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let same = |t: &&(f64, f64, f64)| {
            t.1 <= noise.max(least.1) * (1.0 + (2.0 / t.2).sqrt()) && t.2 > 1.5 * least.2
        };
        let more = tried.iter().filter(same).min_by(|a, b| a.1.total_cmp(&b.1));
        let chosen = more.copied().unwrap_or(least);
        Some((chosen.0, chosen.1))
    }

    /// Whether retro-reflection at `zero` is weaker than at `than` by more than noise: a lobe is brightest towards the normal.
    fn is_darker(&self, zero: f64, than: f64, noise: f64) -> bool {
        let middle = |at: f64| {
            let mut near: Vec<(f64, usize)> =
                (0..self.scan.f.len()).map(|k| ((self.scan.angle_deg[k] - at).abs(), k)).collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            near.truncate(MIDDLE);
            let all: f64 = near.iter().map(|(_, k)| self.weights[*k]).sum();
            let sum: f64 = near.iter().map(|(_, k)| self.weights[*k] * self.scan.f[*k].ln()).sum();
            (sum / all, noise / all)
        };
        let (here, there) = (middle(zero), middle(than));
        there.0 - here.0 > DARKER * (here.1 + there.1).sqrt()
    }

    fn both_sides(&self, zero: f64, part: &[usize]) -> bool {
        let right = part.iter().filter(|k| self.scan.angle_deg[**k] >= zero).count();
        right >= LEAST_A_SIDE && part.len() - right >= LEAST_A_SIDE
    }
}

/// Step of the trials of a law's symmetry point, and half of the stretch over which its sum of squares bends, degrees.
const LAW_STEP_DEG: f64 = 0.25;
const LAW_BEND_DEG: f64 = 0.1;
/// Readings of a larger relative uncertainty tell a law's symmetry point nothing that the bias of their logarithms does not spoil.
const MOST_RELATIVE: f64 = 0.15;

/// Readings of f cosθ, held against a law about a symmetry point.
struct LawJudge {
    /// The stage's angle, degrees; ln(f cosθ); 1/σ² of that.
    readings: Vec<Reading>,
}

impl LawJudge {
    /// The sum of squares that the best roughness leaves.
    fn square(&self, law: Distribution, zero_deg: f64) -> f64 {
        let off = |(angle, ln_f_cos, weight): &Reading| {
            let theta = (angle - zero_deg).to_radians();
            (theta, ln_f_cos - theta.cos().ln(), *weight)
        };
        let readings: Vec<Reading> = self.readings.iter().map(off).collect();
        let all: f64 = readings.iter().map(|r| r.2).sum();
        all * fit(law, &readings, EVERY_ALPHA).misfit.powi(2)
    }

    /// Where a law has its symmetry point, the standard deviation by the scatter, and the sum of squares; none where that is at an end of the search or where the law is level.
    fn best(&self, law: Distribution, most_deg: f64) -> Option<(f64, f64, f64)> {
        let square = |zero: f64| self.square(law, zero);
        let count = (most_deg / LAW_STEP_DEG).floor() as i64;
        let tried: Vec<f64> = (-count..=count).map(|k| square(LAW_STEP_DEG * k as f64)).collect();
        let best = (0..tried.len()).min_by(|a, b| tried[*a].total_cmp(&tried[*b]))?;
        if best == 0 || best + 1 == tried.len() {
            return None;
        }
        let near = LAW_STEP_DEG * (best as i64 - count) as f64;
        let zero = golden(near - LAW_STEP_DEG, near + LAW_STEP_DEG, square);
        let lowest = square(zero);
        let sides = square(zero - LAW_BEND_DEG) + square(zero + LAW_BEND_DEG);
        let bend = (sides - 2.0 * lowest) / (LAW_BEND_DEG * LAW_BEND_DEG);
        let variance = (lowest / self.free()).max(1.0);
        let sigma = (2.0 * variance / bend).sqrt();
        (sigma.is_finite() && lowest.is_finite()).then_some((zero, sigma, lowest))
    }

    /// Readings beyond the three numbers that are fitted.
    fn free(&self) -> f64 {
        (self.readings.len() as f64 - 3.0).max(1.0)
    }
}

/// The symmetry point by the law, Beckmann's or GGX's, that meets the readings of f cosθ within their scatter; `shared` is what neighbouring readings may be off by together, relative. None
/// where no law meets them, or where standard deviations are not known.
pub(super) fn by_law(scan: &Scan, shared: &[f64], most_deg: f64) -> Option<Zero> {
    if !scan.knows_sigma() {
        return None;
    }
    let judge = |off: f64| {
        let each = |k: usize| {
            let relative = scan.sigma[k] / scan.f[k];
            let together = scan.place.get(k).and_then(|place| shared.get(*place));
            let ln = scan.f[k].ln() + off * together.copied().unwrap_or(0.0);
            (relative < MOST_RELATIVE).then(|| (scan.angle_deg[k], ln, relative.powi(-2)))
        };
        LawJudge { readings: (0..scan.f.len()).filter_map(each).collect() }
    };
    let plain = judge(0.0);
    let most = plain.free() + REFUSED * (2.0 * plain.free()).sqrt();
    let met = |law: Distribution| {
        plain.best(law, most_deg).filter(|found| found.2 <= most).map(|found| (law, found))
    };
    let mut laws: Vec<_> =
        [Distribution::Beckmann, Distribution::Ggx].into_iter().filter_map(met).collect();
    laws.sort_by(|a, b| a.1.2.total_cmp(&b.1.2));
    let (law, (angle_deg, by_scatter, _)) = *laws.first()?;
    let by_law = laws.get(1).map_or(0.0, |other| other.1.0 - angle_deg);
    let by_shared = judge(1.0).best(law, most_deg)?.0 - angle_deg;
    let sigma_deg = by_scatter.hypot(by_law).hypot(by_shared);
    Some(Zero { angle_deg, sigma_deg, origin: ZeroOrigin::Law })
}

/// The symmetry point of other readings at the same angles, near one that was found; `None` where they do not decide it.
pub(super) fn refined(scan: &Scan, near_deg: f64) -> Option<f64> {
    let step = scan.step_deg();
    let judge = Judge { scan, weights: scan.weights(), step };
    let part = judge.within(near_deg, judge.reach(near_deg) - 0.5 * step);
    let square = |zero: f64| judge.left(zero, &part).map_or(f64::INFINITY, |(square, _)| square);
    let found = golden(near_deg - 2.0 * step, near_deg + 2.0 * step, square);
    found.is_finite().then_some(found)
}

/// The symmetry point within ± `most_deg` of the stage's zero; not fitted where the readings do not decide it.
///
/// # Errors
/// A gap beside the peak, so that hardly any angle was measured on both sides: what is found then is off by more than its uncertainty says.
pub(super) fn find(scan: &Scan, most_deg: f64) -> Result<Zero, NdfError> {
    let assumed = Zero { angle_deg: 0.0, sigma_deg: 0.0, origin: ZeroOrigin::Assumed };
    let step = scan.step_deg();
    let judge = Judge { scan, weights: scan.weights(), step };
    let count = (most_deg / (0.5 * step)).floor() as i64;
    let trial = |k: i64| 0.5 * step * k as f64;
    let mean = |zero: f64| {
        let part = judge.within(zero, judge.reach(zero) + 1e-9);
        let (square, free) = judge.both_sides(zero, &part).then(|| judge.left(zero, &part))??;
        (free >= 3.0).then(|| (square / free, free))
    };
    let tried: Vec<(f64, f64, f64)> = (-count..=count)
        .filter_map(|k| mean(trial(k)).map(|(mean, free)| (trial(k), mean, free)))
        .collect();
    let noise = judge.noise();
    // Few readings are even about any angle by chance: of those that noise allows the one with the most of them.
    let allowed =
        |mean: f64, free: f64, least: f64| mean <= least * (1.0 + REFUSED * (2.0 / free).sqrt());
    let Some((best, least)) = judge.best(&tried, noise) else {
        return Ok(assumed);
    };
    // From here on the same readings for all zeros.
    let part = judge.within(best, judge.reach(best) - 0.5 * step);
    if !judge.both_sides(best, &part) {
        return Ok(assumed);
    }
    let square = |zero: f64| judge.left(zero, &part).map_or(f64::INFINITY, |(square, _)| square);
    let angle_deg = golden(best - 0.75 * step, best + 0.75 * step, square);
    let Some((lowest, free)) = judge.left(angle_deg, &part) else { return Ok(assumed) };
    let variance = lowest / free.max(1.0);
    // The bend of the sum of squares over as wide a stretch as the readings are apart.
    let bend = (square(angle_deg - step) + square(angle_deg + step) - 2.0 * lowest) / (step * step);
    let sigma_deg = if bend > 0.0 { (2.0 * variance / bend).sqrt() } else { f64::INFINITY };
    let worst = tried.iter().fold(0.0_f64, |a, (_, m, _)| a.max(*m));
    let weight = judge.weights.iter().sum::<f64>() / judge.weights.len() as f64;
    // A sample that is the same at all angles has no symmetry point; neither has one that noise hides: about which angles else may the readings be even?
    let is_flat = (worst / weight).sqrt() < 1e-9 || worst < 2.0 * least;
    let floor = noise.max(variance);
    let others = tried.iter().filter(|(zero, mean, free)| {
        allowed(*mean, *free, floor) && !judge.is_darker(*zero, angle_deg, floor)
    });
    let unsure_deg = others.fold(0.0_f64, |a, (zero, ..)| a.max((zero - angle_deg).abs()));
    let sigma_deg = sigma_deg.max((unsure_deg - step).max(0.0) / REFUSED);
    let is_unsure = unsure_deg > MOST_UNSURE_DEG.max(2.0 * step);
    if is_flat || is_unsure || sigma_deg.is_nan() || sigma_deg >= 0.25 * judge.reach(angle_deg) {
        return Ok(assumed);
    }
    let (mirrored, (from_deg, to_deg)) = judge.mirrored(angle_deg, &part);
    if mirrored < LEAST_MIRRORED {
        return Err(NdfError::GapBesideNormal { from_deg, to_deg });
    }
    Ok(Zero { angle_deg, sigma_deg, origin: ZeroOrigin::Fitted })
}
