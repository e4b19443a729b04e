//! A coat of microfacets over a Lambert surface, as paints have it.
//!
//! Light that passes the coat reaches the base and leaves it again through the coat:
//! f = f_coat + ρ/π (1 − E(i))(1 − E(o))/(1 − E_avg), with E the coat's albedo and E_avg = 2∫E μ dμ (Ashikhmin et al. 2000; Kelemen and
//! Szirmay-Kalos 2001). It is reciprocal, and reflects E(i) + ρ (1 − E(i)), never more than came.
//!
//! E depends on wavelength as the coat's F does. With a reflectance R(λ) in F (constant or Schlick's), 1 − E = p + d(λ) e: p is what passes at the
//! wavelength where R is largest, d = R_max − R, and e the coat's weight of R. The product of the two brackets is a square in d: three terms with
//! the spectra ρ dⁿ/(1 − E_avg), none of them negative. Where R is the same at all wavelengths the base is one term. With n + ik, E is taken with a reflectance
//! that is at every angle the largest over the tabulated wavelengths, or a little above: the base is then darker than it might be.
//!
//! p and e are tabulated, each lower by the error of its table. Between wavelengths the spectra are linear; the base's albedo is then p times the
//! interpolated ρ and e times the interpolated ρ d, which is nowhere more than d. So the sum stays below what came at every wavelength.

use super::curve::Curve;
use super::{Fresnel, Lobe, MaterialError, albedo, fresnel::Law};
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// Where the coat lets less than this through on the average, the base is darker, by at most this.
const LEAST_PASSED: f64 = 1e-6;
/// The largest error of the base's albedo that comes from its spectra being linear between their wavelengths.
const SPECTRUM_TOLERANCE: f64 = 1e-6;
/// The most wavelengths of a base.
const MOST_WAVELENGTHS: usize = 50_000;

/// The Lambert surface below a coat.
#[derive(Debug, Clone)]
pub(super) struct Base {
    /// Transmission of the coat: p(μ) and, where E has a spectrum, e(μ): 1 − E = p + d(λ) e.
    pass: Curve,
    /// ∫ of them over the hemisphere: 2∫ p μ dμ.
    mean: [f64; 2],
    /// Divisor of the spectra, which makes them at most 1.
    scale: f64,
    /// Whether E has a spectrum.
    tinted: bool,
}

impl Base {
    /// The base and its spectra.
    pub(super) fn new(
        reflectance: &Spectrum<Reflectance>,
        lobe: &Lobe,
        fresnel: &Fresnel,
    ) -> Result<(Self, Vec<Spectrum<Reflectance>>), MaterialError> {
        let r = &fresnel.spectra()[0];
        let range = common(r, reflectance)?;
        let brightest = match &fresnel.law {
            Law::Conductor(conductor) => conductor.brightest(fresnel.spectra()),
            _ => fresnel
                .spectra()
                .iter()
                .map(|s| s.value().iter().copied().fold(0.0, f64::max))
                .collect(),
        };
        let grey = r.value().iter().all(|v| *v == r.value()[0]);
        let tinted = !grey && !matches!(fresnel.law, Law::Conductor(_));
        let pass = Curve::new(lobe.alpha_x, |mu| {
            let sine = (1.0 - mu * mu).max(0.0).sqrt();
            let e = albedo::weights(lobe, fresnel, DVec3::new(sine, 0.0, mu))?;
            let reflected: f64 = brightest.iter().zip(&e).map(|(r, e)| r * e).sum();
            Ok([1.0 - reflected, if tinted { e[0] } else { 0.0 }])
        })?;
        let mean = pass.mean();
        if !tinted {
            let scale = 1.0 / mean[0].max(LEAST_PASSED);
            return Ok((Self { pass, mean, scale, tinted }, vec![reflectance.clone()]));
        }
        let most = brightest[0];
        let spectra = |nm: f64| {
            let d = (most - r.at(nm)).max(0.0);
            let factor = reflectance.at(nm) / (mean[0].max(LEAST_PASSED) + d * mean[1]);
            [factor, factor * d, factor * d * d]
        };
        // What each is multiplied by in the base's albedo.
        let weights = [mean[0], mean[0] + mean[1], mean[1]];
        let grid = refined(r, reflectance, range, weights, &spectra)?;
        let values: Vec<[f64; 3]> = grid.iter().map(|&nm| spectra(nm)).collect();
        let scale = values.iter().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
        let spectrum = |power: usize| {
            let value = values.iter().map(|v| v[power] / scale).collect();
            Ok(Spectrum::new(grid.clone(), value)?)
        };
        let spectra = (0..3).map(spectrum).collect::<Result<_, MaterialError>>()?;
        Ok((Self { pass, mean, scale, tinted }, spectra))
    }

    /// Adds `scale` times the base's weights \[sr⁻¹\].
    pub(super) fn add_weights(&self, cos_i: f64, cos_o: f64, scale: f64, sum: &mut [f64]) {
        let scale = scale * self.scale * FRAC_1_PI;
        let ([p_i, e_i], [p_o, e_o]) = (self.pass.at(cos_i), self.pass.at(cos_o));
        sum[0] += scale * (p_i * p_o);
        if self.tinted {
            sum[1] += scale * (p_i * e_o + e_i * p_o);
            sum[2] += scale * (e_i * e_o);
        }
    }

    /// Adds the base's albedo: what the coat lets through, of the spectra of the base.
    pub(super) fn add_albedo(&self, cos_i: f64, sum: &mut [f64]) {
        let [p, e] = self.pass.at(cos_i);
        sum[0] += self.scale * p * self.mean[0];
        if self.tinted {
            sum[1] += self.scale * (p * self.mean[1] + e * self.mean[0]);
            sum[2] += self.scale * e * self.mean[1];
        }
    }
}

/// The wavelengths that both tables cover.
fn common(
    coat: &Spectrum<Reflectance>,
    base: &Spectrum<Reflectance>,
) -> Result<(f64, f64), MaterialError> {
    let ((coat_from_nm, coat_to_nm), (base_from_nm, base_to_nm)) =
        (coat.range_nm(), base.range_nm());
    let range = (coat_from_nm.max(base_from_nm), coat_to_nm.min(base_to_nm));
    if range.0 < range.1 {
        Ok(range)
    } else {
        Err(MaterialError::Disjoint { coat_from_nm, coat_to_nm, base_from_nm, base_to_nm })
    }
}

/// The wavelengths of both spectra within the range of both, and as many between as the products need to be linear between theirs.
fn refined(
    a: &Spectrum<Reflectance>,
    b: &Spectrum<Reflectance>,
    (first, last): (f64, f64),
    weights: [f64; 3],
    spectra: &impl Fn(f64) -> [f64; 3],
) -> Result<Vec<f64>, MaterialError> {
    let mut knots: Vec<f64> = a.wavelength_nm().iter().chain(b.wavelength_nm()).copied().collect();
    knots.retain(|nm| (first..=last).contains(nm));
    knots.sort_by(f64::total_cmp);
    knots.dedup();
    let linear = |from: f64, to: f64| {
        let ends = (spectra(from), spectra(to));
        [0.25, 0.5, 0.75].iter().all(|t| {
            let truth = spectra(from + (to - from) * t);
            (0..3).all(|k| {
                let line = ends.0[k] * (1.0 - t) + ends.1[k] * t;
                weights[k] * (line - truth[k]).abs() <= SPECTRUM_TOLERANCE
            })
        })
    };
    let mut grid = vec![knots[0]];
    for pair in knots.windows(2) {
        // What is still to be looked at, the shortest wavelengths on top.
        let mut ends = vec![pair[1]];
        let mut from = pair[0];
        while let Some(&to) = ends.last() {
            let middle = 0.5 * (from + to);
            if linear(from, to) {
                grid.push(to);
                from = to;
                ends.pop();
            } else if grid.len() + ends.len() < MOST_WAVELENGTHS && from < middle && middle < to {
                ends.push(middle);
            } else {
                return Err(MaterialError::Wavelengths {
                    from_nm: from,
                    to_nm: to,
                    points: grid.len() + ends.len(),
                });
            }
        }
    }
    Ok(grid)
}
