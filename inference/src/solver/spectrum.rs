//! A reflectance spectrum through band albedos: one of many.
//!
//! h(λ) = S(Σ_i c_i P_i(x)), S(t) = ½ + t/(2√(1+t²)), x the wavelength mapped to [−1, 1] (Jakob and Hanika 2019, with as many coefficients as there are
//! bands; Legendre polynomials P_i span what the powers x^i do, and are better conditioned). The band means ∫ h E T P λ dλ / ∫ E T P λ dλ are matched
//! within their uncertainties, and of all that match, the one of little curvature is taken.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use sunglint_numerics::least_squares::{Descent, Limits, Normal, minimise};

/// The weight of the mean square curvature h''(x): small against what the bands say, enough to hold what they leave open.
const CURVATURE: f64 = 1e-6;
/// Bands are matched to this where they are known better: what a smooth spectrum can be expected to do.
const LEAST_SIGMA: f64 = 1e-4;
/// Wavelengths at which a band has less than this share of its largest weight are not constrained by it.
const CONSTRAINED: f64 = 0.05;
/// Iterations of the fit.
const ITERATIONS: usize = 300;

/// A band: what a channel makes of a reflectance that is linear between the knots ([`super::band_weights`]), and what was found there.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// The channel's name.
    pub name: String,
    /// Weights of the knots, which add up to 1.
    pub weights: Vec<f64>,
    /// The albedo.
    pub albedo: f64,
    /// Standard uncertainty of the albedo.
    pub sigma: f64,
}

/// A spectrum through bands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Upsampled {
    /// The knots, vacuum nm.
    pub wavelength_nm: Vec<f64>,
    /// The reflectance there.
    pub reflectance: Vec<f64>,
    /// Standard uncertainty of the reflectance by those of the bands, for spectra of this form; what the form excludes is not in it.
    pub sigma: Vec<f64>,
    /// Whether a band constrains it there.
    pub constrained: Vec<bool>,
    /// Band by band: name, albedo wanted, albedo of the spectrum.
    pub bands: Vec<(String, f64, f64)>,
    /// The mean wavelength of each band's weights, nm.
    pub band_nm: Vec<f64>,
    /// The largest difference between those, over the band's uncertainty (at least 1e-4).
    pub largest_pull: f64,
}

/// Why there is no spectrum.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumFitError {
    /// No band.
    #[error("no band has an albedo")]
    NoBand,
    /// Weights that do not belong to the knots.
    #[error("{band}: {found} weights, expected {expected}, one for each wavelength")]
    Weights {
        /// The band.
        band: String,
        /// Weights.
        found: usize,
        /// Knots.
        expected: usize,
    },
    /// An albedo that no surface has.
    #[error(
        "{band}: the albedo is {albedo}, expected a number from 0 to 1: a sigmoid reaches no other"
    )]
    Albedo {
        /// The band.
        band: String,
        /// Albedo of the band.
        albedo: f64,
    },
}

fn sigmoid(t: f64) -> f64 {
    0.5 + 0.5 * t / (1.0 + t * t).sqrt()
}

fn slope(t: f64) -> f64 {
    0.5 * (1.0 + t * t).powf(-1.5)
}

/// The argument of the sigmoid at a value, from 0.001 to 0.999.
fn argument(value: f64) -> f64 {
    let s = 2.0 * value.clamp(1e-3, 1.0 - 1e-3) - 1.0;
    s / (1.0 - s * s).sqrt()
}

/// Legendre polynomials up to a degree.
fn legendre(x: f64, count: usize) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for n in 1..count {
        let k = n as f64;
        p.push(((2.0 * k + 1.0) * x * p[n] - k * p[n - 1]) / (k + 1.0));
    }
    p.truncate(count);
    p
}

struct Shape<'a> {
    basis: DMatrix<f64>,
    bands: &'a [Band],
    sigma: Vec<f64>,
    curvature: f64,
}

impl Shape<'_> {
    fn spectrum(&self, c: &DVector<f64>) -> (DVector<f64>, DVector<f64>) {
        let t = &self.basis * c;
        (t.map(sigmoid), t.map(slope))
    }

    /// Residuals and their derivatives: bands, then curvature.
    fn residuals(&self, c: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let (h, dh) = self.spectrum(c);
        let (n, k) = (h.len(), c.len());
        let rows = self.bands.len() + n.saturating_sub(2);
        let (mut r, mut j) = (DVector::zeros(rows), DMatrix::zeros(rows, k));
        let slope = |a: usize, i: usize| dh[a] * self.basis[(a, i)];
        for (b, band) in self.bands.iter().enumerate() {
            let mean: f64 = band.weights.iter().zip(h.iter()).map(|(w, h)| w * h).sum();
            r[b] = (mean - band.albedo) / self.sigma[b];
            for i in 0..k {
                let all = band.weights.iter().enumerate();
                j[(b, i)] = all.map(|(a, w)| w * slope(a, i)).sum::<f64>() / self.sigma[b];
            }
        }
        for a in 1..n.saturating_sub(1) {
            let row = self.bands.len() + a - 1;
            r[row] = self.curvature * (h[a - 1] - 2.0 * h[a] + h[a + 1]);
            for i in 0..k {
                j[(row, i)] =
                    self.curvature * (slope(a - 1, i) - 2.0 * slope(a, i) + slope(a + 1, i));
            }
        }
        (r, j)
    }

    fn at(&self, c: DVector<f64>) -> At {
        let (residuals, jacobian) = self.residuals(&c);
        At { c, residuals, jacobian }
    }

    fn descend(&self, start: DVector<f64>) -> (f64, DVector<f64>) {
        let limits = Limits { steps: ITERATIONS, gain: 1e-12, step: 1e-10 };
        let Ok(found) = minimise(&mut Descending(self), self.at(start), &limits);
        (found.place.residuals.norm_squared(), found.place.c)
    }
}

/// Coefficients, and what is left over there.
struct At {
    c: DVector<f64>,
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
}

struct Descending<'a, 'b>(&'a Shape<'b>);

impl Descent for Descending<'_, '_> {
    type Place = At;
    type Error = std::convert::Infallible;

    fn cost(&self, place: &At) -> f64 {
        place.residuals.norm_squared()
    }

    fn normal(&mut self, place: &mut At) -> Result<Normal, Self::Error> {
        let matrix = place.jacobian.tr_mul(&place.jacobian);
        // Residuals here are the model less the data.
        Ok(Normal { matrix, downhill: -place.jacobian.tr_mul(&place.residuals) })
    }

    fn step(&mut self, from: &At, step: &mut DVector<f64>) -> Result<At, Self::Error> {
        Ok(self.0.at(&from.c + &*step))
    }
}

/// The spectrum on knots (vacuum nm, evenly spaced).
///
/// # Errors
/// No band; weights of another length than the knots; an albedo outside 0 to 1.
pub fn upsample(knots_nm: &[f64], bands: &[Band]) -> Result<Upsampled, SpectrumFitError> {
    if bands.is_empty() || knots_nm.len() < 2 {
        return Err(SpectrumFitError::NoBand);
    }
    for band in bands {
        let (found, expected) = (band.weights.len(), knots_nm.len());
        if found != expected {
            return Err(SpectrumFitError::Weights { band: band.name.clone(), found, expected });
        }
        if !(0.0..=1.0).contains(&band.albedo) {
            let (band, albedo) = (band.name.clone(), band.albedo);
            return Err(SpectrumFitError::Albedo { band, albedo });
        }
    }
    let constrained: Vec<bool> = (0..knots_nm.len())
        .map(|a| {
            bands.iter().any(|b| {
                let most = b.weights.iter().copied().fold(0.0, f64::max);
                b.weights[a] > CONSTRAINED * most
            })
        })
        .collect();
    // Mapped to [−1, 1] where bands constrain; beyond, the value at the edge is held.
    let first = constrained.iter().position(|c| *c).unwrap_or(0);
    let last = constrained.iter().rposition(|c| *c).unwrap_or(knots_nm.len() - 1);
    let (low, high) = (knots_nm[first], knots_nm[last].max(knots_nm[first] + 1.0));
    let count = bands.len();
    let basis = DMatrix::from_fn(knots_nm.len(), count, |a, i| {
        let x = (2.0 * (knots_nm[a] - low) / (high - low) - 1.0).clamp(-1.0, 1.0);
        legendre(x, count)[i]
    });
    // Σ (Δ²h)² stands for ∫ h''² dx with a step of 2/n: Δ²h = h'' (2/n)².
    let n = (last - first).max(2) as f64;
    let curvature = (CURVATURE * 2.0 / n).sqrt() * (0.5 * n).powi(2);
    let sigma: Vec<f64> = bands.iter().map(|b| b.sigma.max(LEAST_SIGMA)).collect();
    let shape = Shape { basis, bands, sigma, curvature };
    let mean = bands.iter().map(|b| b.albedo).sum::<f64>() / count as f64;
    let mut best: Option<(f64, DVector<f64>)> = None;
    for tilt in [0.0, 0.5, -0.5] {
        let start = DVector::from_fn(count, |i, _| match i {
            0 => argument(mean),
            1 => tilt,
            _ => 0.0,
        });
        let found = shape.descend(start);
        if best.as_ref().is_none_or(|(cost, _)| found.0 < *cost) {
            best = Some(found);
        }
    }
    let Some((_, c)) = best else { return Err(SpectrumFitError::NoBand) };
    let (h, dh) = shape.spectrum(&c);
    let (r, j) = shape.residuals(&c);
    let (covariance, _) = super::normal::inverse(&j.tr_mul(&j));
    let sigma = (0..knots_nm.len()).map(|a| {
        let row = DVector::from_fn(count, |i, _| dh[a] * shape.basis[(a, i)]);
        (&covariance * &row).dot(&row).max(0.0).sqrt()
    });
    let of_band = |b: &Band| {
        let mean: f64 = b.weights.iter().zip(h.iter()).map(|(w, h)| w * h).sum();
        (b.name.clone(), b.albedo, mean)
    };
    Ok(Upsampled {
        wavelength_nm: knots_nm.to_vec(),
        reflectance: h.iter().copied().collect(),
        sigma: sigma.collect(),
        constrained,
        bands: bands.iter().map(of_band).collect(),
        band_nm: bands
            .iter()
            .map(|b| b.weights.iter().zip(knots_nm).map(|(w, nm)| w * nm).sum())
            .collect(),
        largest_pull: r.rows(0, bands.len()).amax(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gauss(knots: &[f64], centre: f64, width: f64) -> Vec<f64> {
        let w: Vec<f64> =
            knots.iter().map(|k| (-0.5 * ((k - centre) / width).powi(2)).exp()).collect();
        let sum: f64 = w.iter().sum();
        w.iter().map(|v| v / sum).collect()
    }

    fn knots() -> Vec<f64> {
        (0..=188).map(|i| 300.0 + 5.0 * f64::from(i)).collect()
    }

    /// Truth: band means of spectra of the sigmoid's own family, and of a grey one; the spectrum comes back where bands constrain it. Tolerance:
    /// bands to their 1e-4, the grey spectrum to that everywhere between; a smooth slope to 0.02 (its form is not of the family).
    #[test]
    fn bands_are_matched_and_grey_stays_grey() {
        let knots = knots();
        let centres = [450.0, 530.0, 610.0, 700.0, 800.0, 950.0];
        for (truth, tolerance) in [
            (Box::new(|_: f64| 0.36) as Box<dyn Fn(f64) -> f64>, 2e-3),
            (Box::new(|nm: f64| 0.2 + 0.5 * (nm - 300.0) / 940.0), 0.02),
        ] {
            let bands: Vec<Band> = centres
                .iter()
                .map(|c| {
                    let weights = gauss(&knots, *c, 35.0);
                    let albedo = weights.iter().zip(&knots).map(|(w, k)| w * truth(*k)).sum();
                    Band { name: format!("{c}"), weights, albedo, sigma: 0.0 }
                })
                .collect();
            let found = upsample(&knots, &bands).unwrap();
            assert!(found.largest_pull < 1.0, "{}", found.largest_pull);
            for (a, nm) in knots.iter().enumerate() {
                if found.constrained[a] {
                    let off = (found.reflectance[a] - truth(*nm)).abs();
                    assert!(off < tolerance, "{nm}: {} {}", found.reflectance[a], truth(*nm));
                }
            }
            assert!(!found.constrained[0] && found.constrained[40]);
        }
    }

    #[test]
    fn what_no_surface_has_is_refused() {
        let knots = knots();
        let band = |albedo| Band {
            name: "g".into(),
            weights: gauss(&knots, 550.0, 40.0),
            albedo,
            sigma: 0.01,
        };
        assert!(matches!(upsample(&knots, &[band(1.2)]), Err(SpectrumFitError::Albedo { .. })));
        assert_eq!(upsample(&knots, &[]), Err(SpectrumFitError::NoBand));
        // One band: a grey spectrum.
        let one = upsample(&knots, &[band(0.25)]).unwrap();
        assert!(one.reflectance.iter().all(|h| (h - 0.25).abs() < 1e-3));
    }
}
