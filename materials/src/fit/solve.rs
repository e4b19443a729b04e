//! The most likely parameters: residuals in ln f follow Student's distribution with four degrees of freedom (or a normal one) of a width that is found with them.
//!
//! Levenberg–Marquardt on the reweighted squares (ln of the parameters as variables), variables held where they push against a bound, the width by its own
//! update between the steps (Lange, Little and Taylor 1989). What a law reflects beyond what came is a penalty among the residuals.

use super::energy;
use super::law::{Law, Rise};
use glam::DVec3;
use nalgebra::{DMatrix, DVector};
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

/// What is fitted.
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

/// What came of one start.
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
        let n = start.len();
        let mut x: Vec<f64> = (0..n).map(|j| start[j].clamp(least[j], most[j])).collect();
        let penalties = |x: &[f64]| if energy { self.penalties(x) } else { Vec::new() };
        let half = |e: &[f64]| 0.5 * e.iter().map(|e| e * e).sum::<f64>();
        let (mut r, mut e) = (self.residuals(&x), penalties(&x));
        let mut width = self.width(&r, robust_sigma(r.iter().copied()).unwrap_or(1.4826));
        let mut cost = self.cost(&r, width) + half(&e);
        let mut damping: f64 = 1e-3;
        let mut held = vec![false; n];
        let mut converged = false;
        for _ in 0..iterations {
            let (of_r, of_e) = self.slopes(&x, &r, &e);
            let mut normal: DMatrix<f64> = DMatrix::zeros(n, n);
            let mut gradient: DVector<f64> = DVector::zeros(n);
            for k in 0..r.len() {
                let w = self.weight(r[k], width) / (width * width);
                for a in 0..n {
                    gradient[a] += w * of_r[(k, a)] * r[k];
                    for b in 0..n {
                        normal[(a, b)] += w * of_r[(k, a)] * of_r[(k, b)];
                    }
                }
            }
            for k in 0..e.len() {
                for a in 0..n {
                    gradient[a] += of_e[(k, a)] * e[k];
                    for b in 0..n {
                        normal[(a, b)] += of_e[(k, a)] * of_e[(k, b)];
                    }
                }
            }
            for j in 0..n {
                let edge = 1e-9;
                held[j] = (x[j] <= least[j] + edge && gradient[j] > 0.0)
                    || (x[j] >= most[j] - edge && gradient[j] < 0.0);
            }
            let free: Vec<usize> = (0..n).filter(|j| !held[*j]).collect();
            if free.is_empty() {
                converged = true;
                break;
            }
            let mut better = false;
            for _ in 0..12 {
                let m = free.len();
                let mut a: DMatrix<f64> = DMatrix::zeros(m, m);
                let mut b: DVector<f64> = DVector::zeros(m);
                for (s, j) in free.iter().enumerate() {
                    b[s] = -gradient[*j];
                    for (t, k) in free.iter().enumerate() {
                        a[(s, t)] = normal[(*j, *k)];
                    }
                    a[(s, s)] += damping * normal[(*j, *j)] + 1e-12;
                }
                let Some(step) = a.cholesky().map(|c| c.solve(&b)) else {
                    damping *= 10.0;
                    continue;
                };
                let mut next = x.clone();
                for (s, j) in free.iter().enumerate() {
                    // A factor of e³ at most: beyond, the logarithm is not straight.
                    next[*j] = (x[*j] + step[s].clamp(-3.0, 3.0)).clamp(least[*j], most[*j]);
                }
                let (r2, e2) = (self.residuals(&next), penalties(&next));
                let width2 = self.width(&r2, width);
                let cost2 = self.cost(&r2, width2) + half(&e2);
                if cost2 < cost {
                    let moved = x.iter().zip(&next).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                    converged = moved < 1e-9 || cost - cost2 < 1e-10 * (1.0 + cost.abs());
                    (x, r, e, width, cost) = (next, r2, e2, width2, cost2);
                    damping = (damping * 0.2).max(1e-12);
                    better = true;
                    break;
                }
                damping *= 8.0;
            }
            if !better {
                // No step downhill is left.
                converged = true;
            }
            if converged {
                break;
            }
        }
        let ln_likelihood = -self.cost(&r, width);
        Found { x, residual: r, width, ln_likelihood, penalty: half(&e), converged, held }
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
