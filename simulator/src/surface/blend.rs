//! A coat of microfacets over a Lambert surface, as paints have it.
//!
//! What the coat lets through reaches the base and leaves it again through the coat:
//! f = f_coat + ρ/π (1 − E(i))(1 − E(o))/(1 − E_avg), with E the coat's albedo and E_avg = 2∫E μ dμ (Ashikhmin et al. 2000; Kelemen and
//! Szirmay-Kalos 2001). It is reciprocal, and reflects E(i) + ρ (1 − E(i)), never more than came.
//!
//! E depends on wavelength as the coat's F does. Where F has the same value at all wavelengths, so has E, and the base is one term. With a
//! spectrum R(λ) in F (constant or Schlick's), E = R(λ) e + e₁, and the product of the two brackets is a square in R: three terms with
//! the spectra ρ Rⁿ/(1 − E_avg), exactly. With n + ik, E is taken at its largest over the tabulated wavelengths: the
//! base is then darker than it might be, and the sum of both below what came.

use super::{Fresnel, Lobe, MaterialError, albedo, fresnel::Law};
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// The largest error of E between its nodes. E is raised by it, so that the sum of coat and base is never above 1.
const TOLERANCE: f64 = 1e-7;
/// The largest error of the products of spectra between their wavelengths.
const SPECTRUM_TOLERANCE: f64 = 1e-6;
const FEWEST_NODES: usize = 33;
const MOST_NODES: usize = 2049;

/// The Lambert surface below a coat.
#[derive(Debug, Clone)]
pub(super) struct Base {
    /// What passes the coat: a(μ) and, where E has a spectrum, e(μ): 1 − E = a − R(λ) e.
    pass: Vec<Curve>,
    /// ∫ of them over the hemisphere: 2∫ a μ dμ.
    mean: Vec<f64>,
    /// What the spectra were divided by to be at most 1.
    scale: f64,
}

impl Base {
    /// The base and its spectra.
    pub(super) fn new(
        reflectance: &Spectrum<Reflectance>,
        lobe: &Lobe,
        fresnel: &Fresnel,
    ) -> Result<(Self, Vec<Spectrum<Reflectance>>), MaterialError> {
        let rho = fresnel.spectra();
        let grey = rho[0].value().iter().all(|v| *v == rho[0].value()[0]);
        if grey || matches!(fresnel.law, Law::Conductor(_)) {
            // The largest E over the wavelengths.
            let rows: Vec<Vec<f64>> = if grey && !matches!(fresnel.law, Law::Conductor(_)) {
                vec![rho.iter().map(|s| s.value()[0]).collect()]
            } else {
                (0..rho[0].value().len())
                    .map(|row| rho.iter().map(|s| s.value()[row]).collect())
                    .collect()
            };
            let pass = Curve::new(lobe.alpha_x, |mu| {
                let e = albedo::weights(lobe, fresnel, from_zenith(mu));
                let dot = |row: &Vec<f64>| row.iter().zip(&e).map(|(r, e)| r * e).sum::<f64>();
                1.0 - rows.iter().map(dot).fold(0.0, f64::max)
            })
            .lowered();
            let mean = pass.mean();
            let scale = if mean > TOLERANCE { 1.0 / mean } else { 0.0 };
            let base = Self { pass: vec![pass], mean: vec![mean], scale };
            return Ok((base, vec![reflectance.clone()]));
        }
        let of = |which: usize| {
            Curve::new(lobe.alpha_x, |mu| {
                albedo::weights(lobe, fresnel, from_zenith(mu)).get(which).copied().unwrap_or(0.0)
            })
        };
        let tinted = of(0);
        // What the coat reflects whatever its spectrum: Schlick's rise.
        let mut open = of(1);
        open.values.iter_mut().for_each(|v| *v = 1.0 - *v);
        let open = open.lowered();
        let mean = vec![open.mean(), tinted.mean()];
        let r = &rho[0];
        let factor = |nm: f64| {
            let passed = mean[0] - r.at(nm) * mean[1];
            if passed > TOLERANCE { reflectance.at(nm) / passed } else { 0.0 }
        };
        let grid = refined(reflectance, r, &factor);
        let scale = grid.iter().map(|&nm| factor(nm)).fold(f64::MIN_POSITIVE, f64::max);
        let spectrum = |power: i32| {
            let value = grid.iter().map(|&nm| factor(nm) / scale * r.at(nm).powi(power)).collect();
            Ok(Spectrum::new(grid.clone(), value)?)
        };
        let spectra = (0..3).map(spectrum).collect::<Result<_, MaterialError>>()?;
        Ok((Self { pass: vec![open, tinted], mean, scale }, spectra))
    }

    /// Adds `scale` times the base's weights \[sr⁻¹\].
    pub(super) fn add_weights(&self, cos_i: f64, cos_o: f64, scale: f64, sum: &mut [f64]) {
        let at = |mu: f64, which: usize| self.pass[which].at(mu);
        let scale = scale * self.scale * FRAC_1_PI;
        let (i, o) = (at(cos_i, 0), at(cos_o, 0));
        sum[0] += scale * i * o;
        if self.pass.len() > 1 {
            let (e_i, e_o) = (at(cos_i, 1), at(cos_o, 1));
            sum[1] -= scale * (i * e_o + e_i * o);
            sum[2] += scale * e_i * e_o;
        }
    }

    /// Adds the base's albedo: what the coat lets through, of the spectra of the base.
    pub(super) fn add_albedo(&self, cos_i: f64, sum: &mut [f64]) {
        let i = self.pass[0].at(cos_i);
        sum[0] += self.scale * i * self.mean[0];
        if self.pass.len() > 1 {
            let e_i = self.pass[1].at(cos_i);
            sum[1] -= self.scale * (i * self.mean[1] + e_i * self.mean[0]);
            sum[2] += self.scale * e_i * self.mean[1];
        }
    }
}

fn from_zenith(mu: f64) -> DVec3 {
    DVec3::new((1.0 - mu * mu).max(0.0).sqrt(), 0.0, mu)
}

/// The wavelengths of both spectra, and as many between as the products need to be linear between theirs.
fn refined(
    a: &Spectrum<Reflectance>,
    b: &Spectrum<Reflectance>,
    factor: &impl Fn(f64) -> f64,
) -> Vec<f64> {
    let mut knots: Vec<f64> = a.wavelength_nm().iter().chain(b.wavelength_nm()).copied().collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup();
    let curved = |from: f64, to: f64| {
        (0..3).any(|power| {
            let at = |nm: f64| factor(nm) * b.at(nm).powi(power);
            let (first, last) = (at(from), at(to));
            [0.25, 0.5, 0.75].iter().any(|t| {
                let line = first * (1.0 - t) + last * t;
                (line - at(from + (to - from) * t)).abs() > SPECTRUM_TOLERANCE
            })
        })
    };
    let mut grid = vec![knots[0]];
    for pair in knots.windows(2) {
        let mut parts = 1;
        let at = |j: usize, parts: usize| pair[0] + (pair[1] - pair[0]) * j as f64 / parts as f64;
        while parts < 1024 && (0..parts).any(|j| curved(at(j, parts), at(j + 1, parts))) {
            parts *= 2;
        }
        grid.extend((1..parts).map(|j| at(j, parts)));
        grid.push(pair[1]);
    }
    grid.dedup();
    grid
}

/// A function of μ = cosθ that varies fast below μ ≈ α: cubic between nodes that are equally far apart in s, μ = δ sinh(s asinh(1/δ)).
#[derive(Debug, Clone)]
struct Curve {
    delta: f64,
    /// asinh(1/δ).
    span: f64,
    values: Vec<f64>,
}

impl Curve {
    /// Takes as many nodes as are needed for [`TOLERANCE`].
    fn new(alpha: f64, function: impl Fn(f64) -> f64) -> Self {
        let delta = 0.5 * alpha.min(1.0);
        let span = (1.0 / delta).asinh();
        let at = |j: usize, nodes: usize| {
            // At the horizon itself nothing is defined: its limit.
            let s = (j as f64 / (nodes - 1) as f64).max(1e-9);
            function((delta * (s * span).sinh()).min(1.0))
        };
        let values = (0..FEWEST_NODES).map(|j| at(j, FEWEST_NODES)).collect();
        let mut curve = Self { delta, span, values };
        while curve.values.len() < MOST_NODES {
            let nodes = 2 * curve.values.len() - 1;
            let between: Vec<f64> = (0..nodes / 2).map(|j| at(2 * j + 1, nodes)).collect();
            let found = |j: usize| curve.cubic((2 * j + 1) as f64 / (nodes - 1) as f64);
            let error =
                between.iter().enumerate().fold(0.0_f64, |a, (j, v)| a.max((v - found(j)).abs()));
            let mut values = Vec::with_capacity(nodes);
            for (j, v) in curve.values.iter().enumerate() {
                values.push(*v);
                values.extend(between.get(j));
            }
            curve.values = values;
            // Halved nodes err by a sixteenth.
            if error < 4.0 * TOLERANCE {
                break;
            }
        }
        curve
    }

    /// Lower by what it may err, and not below 0.
    fn lowered(mut self) -> Self {
        self.values.iter_mut().for_each(|v| *v = (*v - TOLERANCE).max(0.0));
        self
    }

    fn at(&self, mu: f64) -> f64 {
        self.cubic((mu / self.delta).asinh() / self.span).max(0.0)
    }

    /// The cubic through the four nodes around s (0 to 1).
    fn cubic(&self, s: f64) -> f64 {
        let last = self.values.len() - 1;
        let x = (s * last as f64).clamp(0.0, last as f64);
        let first = (x as usize).saturating_sub(1).min(last - 3);
        let t = x - first as f64;
        let y = &self.values[first..first + 4];
        let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
        (y[3] * a * b * c - y[0] * b * c * d) / 6.0 + 0.5 * (y[1] * a * c * d - y[2] * a * b * d)
    }

    /// 2∫ f μ dμ, exactly of the cubics.
    fn mean(&self) -> f64 {
        let nodes = self.values.len();
        let edges: Vec<f64> = (0..nodes).map(|j| j as f64 / (nodes - 1) as f64).collect();
        super::rule::points(&edges, 0)
            .iter()
            .map(|&(s, weight)| {
                let (mu, slope) = (
                    self.delta * (s * self.span).sinh(),
                    self.delta * self.span * (s * self.span).cosh(),
                );
                2.0 * weight * self.cubic(s).max(0.0) * mu * slope
            })
            .sum()
    }
}
