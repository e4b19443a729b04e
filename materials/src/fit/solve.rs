//! The most likely parameters: residuals in ln f follow Student's distribution with four degrees of freedom (or a normal one) of a width that is found with them.
//!
//! Levenberg–Marquardt on the reweighted squares (ln of the parameters as variables), variables held where they push against a bound, the width by its own
//! update between the steps (Lange, Little and Taylor 1989). What a law reflects beyond what came is a penalty among the residuals.

use super::energy;
use super::law::{Law, Rise};
use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use sunglint_numerics::least_squares::{Descent, Limits, Normal, minimise};
use sunglint_numerics::order::{quantile, robust_sigma};

/// Less than this the logarithm is not taken of, sr⁻¹.
const LEAST: f64 = 1e-300;
/// Degrees of freedom of Student's distribution.
pub(super) const NU: f64 = 4.0;
/// Steps of a search to its end.
pub(super) const TO_THE_END: usize = 120;
/// Steps of a search that is to say which start leads where.
pub(super) const A_LOOK: usize = 10;
/// The weight of ln E where E exceeds 1, in units of the width.
const PENALTY: f64 = 300.0;

/// Data that a law is fitted to.
#[derive(Debug, Clone, Default)]
pub(super) struct Data {
    pub i: Vec<DVec3>,
    pub o: Vec<DVec3>,
    pub ln: Vec<f64>,
    /// Relative uncertainties, their median 1; all 1 where none is known.
    pub unit: Vec<f64>,
}

/// How residuals are judged.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judge<'a> {
    pub data: &'a Data,
    pub law: Law,
    pub rise: Option<&'a Rise>,
    pub robust: bool,
    /// Up to which angle of incidence energy is looked at.
    pub energy_to_deg: f64,
}

/// Result of a search from one start.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// ln of the parameters.
    pub x: Vec<f64>,
    pub residual: Vec<f64>,
    /// The width in ln f.
    pub width: f64,
    pub ln_likelihood: f64,
    pub penalty: f64,
    pub converged: bool,
    pub held: Vec<bool>,
}

/// Variables, what is left over there, and what that costs.
struct At {
    x: Vec<f64>,
    r: Vec<f64>,
    e: Vec<f64>,
    width: f64,
    cost: f64,
}

struct Going<'a, 'b> {
    judge: &'a Judge<'b>,
    energy: bool,
    least: Vec<f64>,
    most: Vec<f64>,
    held: Vec<bool>,
}

fn half(e: &[f64]) -> f64 {
    0.5 * e.iter().map(|e| e * e).sum::<f64>()
}

impl Going<'_, '_> {
    fn at(&self, x: Vec<f64>, width: Option<f64>) -> At {
        let r = self.judge.residuals(&x);
        let e = if self.energy { self.judge.penalties(&x) } else { Vec::new() };
        let from = width.or_else(|| robust_sigma(r.iter().copied())).unwrap_or(1.4826);
        let width = self.judge.width(&r, from);
        let cost = self.judge.cost(&r, width) + half(&e);
        At { x, r, e, width, cost }
    }

    /// Whether a variable is at a bound that the way down leads beyond.
    fn beyond(&self, x: &[f64], j: usize, downhill: f64) -> bool {
        let edge = 1e-9;
        (x[j] <= self.least[j] + edge && downhill < 0.0)
            || (x[j] >= self.most[j] - edge && downhill > 0.0)
    }
}

impl Descent for Going<'_, '_> {
    type Place = At;
    type Error = std::convert::Infallible;

    fn cost(&self, place: &At) -> f64 {
        place.cost
    }

    fn normal(&mut self, place: &mut At) -> Result<Normal, Self::Error> {
        let At { x, r, e, width, .. } = place;
        let n = x.len();
        let (of_r, of_e) = self.judge.slopes(x, r, e);
        let (mut matrix, mut downhill) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let weight = |r: f64| self.judge.weight(r, *width) / (*width * *width);
        for (slopes, left, weighted) in [(&of_r, &*r, true), (&of_e, &*e, false)] {
            for (k, left) in left.iter().enumerate() {
                let w = if weighted { weight(*left) } else { 1.0 };
                for a in 0..n {
                    downhill[a] -= w * slopes[(k, a)] * left;
                    for b in 0..n {
                        matrix[(a, b)] += w * slopes[(k, a)] * slopes[(k, b)];
                    }
                }
            }
        }
        self.held = (0..n).map(|j| self.beyond(x, j, downhill[j])).collect();
        Ok(Normal { matrix, downhill })
    }

    fn step(&mut self, from: &At, step: &mut DVector<f64>) -> Result<At, Self::Error> {
        let mut x = from.x.clone();
        for j in 0..x.len() {
            // A factor of e³ at most: beyond, the logarithm is not straight.
            x[j] = (x[j] + step[j].clamp(-3.0, 3.0)).clamp(self.least[j], self.most[j]);
            step[j] = x[j] - from.x[j];
        }
        Ok(self.at(x, Some(from.width)))
    }

    fn is_held(&self, place: &At, number: usize, downhill: f64) -> bool {
        self.beyond(&place.x, number, downhill)
    }
}

impl Judge<'_> {
    pub fn residuals(&self, x: &[f64]) -> Vec<f64> {
        let p: Vec<f64> = x.iter().map(|x| x.exp()).collect();
        let law = self.law.with(&p, self.rise);
        let data = self.data;
        (0..data.ln.len())
            .map(|k| {
                let value = law.brdf(data.i[k], data.o[k]).max(LEAST);
                (data.ln[k] - value.ln()) / data.unit[k]
            })
            .collect()
    }

    fn penalties(&self, x: &[f64]) -> Vec<f64> {
        let p: Vec<f64> = x.iter().map(|x| x.exp()).collect();
        let albedo = energy::quick(&self.law, &p, self.rise, self.energy_to_deg);
        albedo.iter().map(|(_, e)| PENALTY * e.max(1.0).ln()).collect()
    }

    fn weight(&self, r: f64, width: f64) -> f64 {
        if self.robust { (NU + 1.0) / (NU + (r / width).powi(2)) } else { 1.0 }
    }

    /// The most likely width for these residuals, from one to begin with.
    pub fn width(&self, r: &[f64], from: f64) -> f64 {
        let n = r.len() as f64;
        let mut width = from.max(1e-9);
        for _ in 0..if self.robust { 40 } else { 1 } {
            let next = (r.iter().map(|r| self.weight(*r, width) * r * r).sum::<f64>() / n).sqrt();
            let next = next.max(1e-9);
            // The likelihood is flat there: its error is the square of this.
            let done = (next / width - 1.0).abs() < 1e-6;
            width = next;
            if done {
                break;
            }
        }
        width
    }

    /// −ln likelihood at a width, without the penalty.
    pub fn cost(&self, r: &[f64], width: f64) -> f64 {
        let n = r.len() as f64;
        let units: f64 = self.data.unit.iter().map(|u| u.ln()).sum();
        let spread = n * width.ln() + units;
        let each: f64 = if self.robust {
            let one = |r: &f64| 0.5 * (NU + 1.0) * ((r / width).powi(2) / NU).ln_1p();
            // ln Γ(5/2) − ln Γ(2) − ½ ln 4π = ln(3√π/4) − ½ ln 4π = ln 3/8.
            r.iter().map(one).sum::<f64>() - n * (0.375_f64).ln()
        } else {
            let one = |r: &f64| 0.5 * (r / width).powi(2);
            r.iter().map(one).sum::<f64>() + 0.5 * n * std::f64::consts::TAU.ln()
        };
        each + spread
    }

    /// The derivatives of the law's logarithm (over the units) and of the penalties by the variables.
    fn slopes(&self, x: &[f64], r: &[f64], e: &[f64]) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = x.len();
        let mut of_r = DMatrix::zeros(r.len(), n);
        let mut of_e = DMatrix::zeros(e.len(), n);
        const STEP: f64 = 1e-6;
        for j in 0..n {
            let at = |step: f64| {
                let mut x = x.to_vec();
                x[j] += step;
                x
            };
            let after = self.residuals(&at(STEP));
            for k in 0..r.len() {
                of_r[(k, j)] = (after[k] - r[k]) / STEP;
            }
            if e.iter().any(|e| *e > 0.0) {
                let after = self.penalties(&at(STEP));
                for k in 0..e.len() {
                    of_e[(k, j)] = (after[k] - e[k]) / STEP;
                }
            }
        }
        (of_r, of_e)
    }

    pub fn jacobian(&self, x: &[f64]) -> DMatrix<f64> {
        self.slopes(x, &self.residuals(x), &[]).0
    }

    /// From one start to the nearest minimum. `energy`: whether what is reflected beyond what came counts.
    pub fn solve(&self, start: &[f64], energy: bool, iterations: usize) -> Found {
        let ranges = self.law.ranges();
        let (least, most): (Vec<f64>, Vec<f64>) =
            ranges.iter().map(|r| (r.least.ln(), r.most.ln())).unzip();
        let mut going = Going { judge: self, energy, least, most, held: Vec::new() };
        let x = (0..start.len()).map(|j| start[j].clamp(going.least[j], going.most[j])).collect();
        let first = going.at(x, None);
        let limits = Limits { steps: iterations, gain: 1e-10, step: 1e-9 };
        let Ok(found) = minimise(&mut going, first, &limits);
        let At { x, r, e, width, .. } = found.place;
        let ln_likelihood = -self.cost(&r, width);
        let penalty = half(&e);
        let held = going.held;
        Found { x, residual: r, width, ln_likelihood, penalty, converged: found.converged, held }
    }

    /// Starts with strengths, the most promising first.
    pub fn starts(&self) -> Vec<Vec<f64>> {
        let data = self.data;
        let mut sorted: Vec<f64> = data.ln.clone();
        sorted.sort_by(f64::total_cmp);
        let peak =
            (0..data.ln.len()).max_by(|a, b| data.ln[*a].total_cmp(&data.ln[*b])).unwrap_or(0);
        let mut ranked: Vec<(f64, Vec<f64>)> = Vec::new();
        for start in self.law.starts() {
            let mut strengths = Vec::new();
            let last = start.len() - 1;
            let broad = (quantile(&sorted, 0.1) + std::f64::consts::PI.ln()).exp();
            if let Some((shape, _)) = self.law.shape(&start) {
                let at = |k: usize| data.ln[k] - shape.value(data.i[k], data.o[k]).max(LEAST).ln();
                let mut all: Vec<f64> = (0..data.ln.len()).map(at).collect();
                strengths.push(at(peak));
                all.sort_by(f64::total_cmp);
                strengths.push(quantile(&all, 0.5));
                strengths.push(quantile(&all, 0.1));
            } else {
                strengths.push(quantile(&sorted, 0.5) + std::f64::consts::PI.ln());
            }
            for ln_strength in strengths {
                for share in if self.law.diffuse { &[0.8, 0.05][..] } else { &[1.0][..] } {
                    let mut x: Vec<f64> = start.iter().map(|p| p.ln()).collect();
                    x[0] = ln_strength;
                    if self.law.diffuse && last > 0 {
                        x[last] = (share * broad).ln();
                    }
                    for (x, range) in x.iter_mut().zip(self.law.ranges()) {
                        *x = x.clamp(range.least.ln(), range.most.ln());
                    }
                    let r = self.residuals(&x);
                    let size = r.iter().map(|r| r.abs().min(20.0)).sum::<f64>();
                    ranked.push((size, x));
                }
            }
        }
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.into_iter().map(|(_, x)| x).collect()
    }
}
