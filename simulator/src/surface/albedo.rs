//! The fraction of light that a rough surface reflects in all directions.
//!
//! In slopes of microfacets those that reflect light from the zenith angle θ upwards fill a disc of radius 1/cosθ, tan θ from the
//! origin. With the slopes (x, y) in units of α_x, α_y the distribution is a fixed bell p and the disc an ellipse; with x towards
//! the light E = ∫∫ p F G/cosθ_i (cosθ_i + s x) dx dy, s = α sinθ. Row by row across the ellipse this stays smooth for every roughness and up to grazing
//! incidence: there the near edge runs through the origin, and G falls to 0 on it within the width of the bell.

use super::{Distribution, Fresnel, Lobe, Masking, Material, MaterialError, Model, cos_difference};
use glam::DVec3;
use std::collections::HashMap;
use std::f64::consts::FRAC_1_PI;
use std::sync::{LazyLock, Mutex, PoisonError};
use sunglint_numerics::panels;

/// The change from one order of the quadrature to the next, relative to the largest weight, at which it is taken as converged.
const TOLERANCE: f64 = 1e-5;
/// e^(−6.5²) is 5e-19.
const BECKMANN_END: f64 = 6.5;
/// Albedos that are remembered, at most: some 100 bytes each.
const MOST_KEPT: usize = 1024;

impl Material {
    /// The directional–hemispherical reflectance ∫ f_r cosθ_o dω_o at a wavelength (vacuum nm) for light from `i` (unit vector, surface's own
    /// axes), to 1e-5 (that at grazing incidence; elsewhere far better). 0 for light from below.
    ///
    /// # Errors
    /// [`MaterialError::Albedo`] where the quadrature does not reach that.
    pub fn albedo(&self, wavelength_nm: f64, i: DVec3) -> Result<f64, MaterialError> {
        Ok(self.times_spectra(wavelength_nm, &self.albedo_weights(i)?))
    }

    /// [`Material::albedo`] as weights, one per spectrum.
    ///
    /// # Errors
    /// [`MaterialError::Albedo`].
    pub fn albedo_weights(&self, i: DVec3) -> Result<Vec<f64>, MaterialError> {
        let mut sum = vec![0.0; self.spectra.len()];
        if i.z.is_nan() || i.z <= 0.0 {
            return Ok(sum);
        }
        match &self.model {
            Model::Lambert => sum[0] = 1.0,
            Model::Mirror { fresnel } => fresnel.add_weights(i.z, 1.0, &mut sum),
            Model::Microfacet { lobe, fresnel } => sum = kept_weights(lobe, fresnel, i)?,
            Model::Blend { lobe, fresnel, base } => {
                let coat = kept_weights(lobe, fresnel, i)?;
                sum[..coat.len()].copy_from_slice(&coat);
                base.add_albedo(i.z, &mut sum[coat.len()..]);
            }
            Model::Law(law) => sum = self.albedo_of_law(&**law, i)?,
        }
        Ok(sum)
    }
}

/// Everything that the weights depend on, by its bits: the lobe, what stands for the Fresnel law ([`Fresnel::key`]), the direction of light.
type Key = (Distribution, Masking, [u64; 2], (u8, u64), [u64; 3]);

/// [`weights`], remembered: a fit makes the same body anew in each of its steps, most lobes of which have not changed.
fn kept_weights(lobe: &Lobe, fresnel: &Fresnel, i: DVec3) -> Result<Vec<f64>, MaterialError> {
    static KEPT: LazyLock<Mutex<HashMap<Key, Vec<f64>>>> = LazyLock::new(Mutex::default);
    let Some(law) = fresnel.key() else { return weights(lobe, fresnel, i) };
    let alpha = [lobe.alpha_x.to_bits(), lobe.alpha_y.to_bits()];
    let key = (lobe.distribution, lobe.masking, alpha, law, i.to_array().map(f64::to_bits));
    let kept = || KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = kept().get(&key) {
        return Ok(known.clone());
    }
    let found = weights(lobe, fresnel, i)?;
    let mut kept = kept();
    if kept.len() >= MOST_KEPT {
        kept.clear();
    }
    kept.insert(key, found.clone());
    Ok(found)
}

/// The albedo of a lobe for light from `i`, above the horizon, one weight for each spectrum of the Fresnel term.
pub(super) fn weights(lobe: &Lobe, fresnel: &Fresnel, i: DVec3) -> Result<Vec<f64>, MaterialError> {
    let ellipse = Ellipse::new(lobe, i);
    let count = fresnel.spectra().len();
    let (sum, error) = panels::converge_all(TOLERANCE, 1, count, |order, sum| {
        ellipse.add(fresnel, order, sum);
    });
    if error <= TOLERANCE {
        Ok(sum)
    } else {
        Err(MaterialError::Albedo { theta_deg: i.z.acos().to_degrees(), error })
    }
}

/// The slopes, in units of α and turned so that x points to the light, of the microfacets that reflect it upwards:
/// a x² + 2 (d y − b) x + c y² < 1.
struct Ellipse<'a> {
    lobe: &'a Lobe,
    i: DVec3,
    /// α sinθ.
    s: f64,
    /// The direction of x in the surface's stretched axes.
    cos: f64,
    sin: f64,
    a: f64,
    b: f64,
    c: f64,
    d: f64,
}

impl<'a> Ellipse<'a> {
    fn new(lobe: &'a Lobe, i: DVec3) -> Self {
        let (alpha_x, alpha_y) = lobe.alpha();
        let (x, y) = (alpha_x * i.x, alpha_y * i.y);
        let s = x.hypot(y);
        let (cos, sin) = if s > 0.0 { (x / s, y / s) } else { (1.0, 0.0) };
        let (x2, y2) = (alpha_x * alpha_x, alpha_y * alpha_y);
        Self {
            lobe,
            i,
            s,
            cos,
            sin,
            a: x2 * cos * cos + y2 * sin * sin,
            // Beyond, the near edge is at the origin and the far one at infinity to all digits.
            b: (s / i.z).min(1e100),
            c: x2 * sin * sin + y2 * cos * cos,
            d: (y2 - x2) * cos * sin,
        }
    }

    /// First and last x of the row y.
    fn row(&self, y: f64) -> (f64, f64) {
        let half = self.b - self.d * y;
        let short = self.c * y * y - 1.0;
        let root = (half * half - self.a * short).max(0.0).sqrt();
        if half > 0.0 {
            (short / (half + root), (half + root) / self.a)
        } else {
            ((half - root) / self.a, short / (half - root))
        }
    }

    /// How far the ellipse goes towards y > 0, or with `side` −1 towards y < 0.
    fn end(&self, side: f64) -> f64 {
        let k = self.a * self.c - self.d * self.d;
        let middle = -side * self.b * self.d;
        let root = (middle * middle + k * (self.b * self.b + self.a)).sqrt();
        if middle > 0.0 {
            (middle + root) / k
        } else {
            (self.b * self.b + self.a) / (root - middle)
        }
    }

    fn add(&self, fresnel: &Fresnel, order: usize, sum: &mut [f64]) {
        let (alpha_x, alpha_y) = self.lobe.alpha();
        // Slopes of 1.
        let steep = 1.0 / alpha_x.min(alpha_y);
        // Of an isotropic lobe both sides are the same.
        let sides: &[f64] = if self.lobe.is_isotropic() { &[1.0] } else { &[1.0, -1.0] };
        let share = FRAC_1_PI * 2.0 / sides.len() as f64;
        for &side in sides {
            let end = self.end(side);
            match self.lobe.distribution {
                Distribution::Beckmann => {
                    // The masking's error function is flat but not analytic towards the normal, on a scale of slopes.
                    let longest = (0.7 * steep).min(3.3);
                    bell(0.0, end, longest, true, order, &mut |y, height| {
                        let scale = share * height * (-y * y).exp();
                        let (from, to) = self.row(side * y);
                        bell(from, to, longest, false, order, &mut |x, width| {
                            let scale = scale * width * (-x * x).exp();
                            self.facet(fresnel, (x, side * y), scale, sum);
                        });
                    });
                }
                Distribution::Ggx => {
                    tails(0.0, end, (1.0, steep), [false, true], order, &mut |y, height| {
                        let core = 1.0 + y * y;
                        let (from, to) = self.row(side * y);
                        let scales = (core.sqrt(), steep.max(core.sqrt()));
                        tails(from, to, scales, [true, true], order, &mut |x, width| {
                            let bell = core + x * x;
                            let scale = share * (height / bell) * (width / bell);
                            self.facet(fresnel, (x, side * y), scale, sum);
                        });
                    });
                }
            }
        }
    }

    /// Adds the reflection by microfacets of one slope.
    fn facet(&self, fresnel: &Fresnel, (x, y): (f64, f64), scale: f64, sum: &mut [f64]) {
        let lobe = self.lobe;
        let slope_x = lobe.alpha_x * (self.cos * x - self.sin * y);
        let slope_y = lobe.alpha_y * (self.sin * x + self.cos * y);
        let h = DVec3::new(slope_x, slope_y, 1.0).normalize();
        let o = h * (2.0 * self.i.dot(h)) - self.i;
        if o.z > 0.0 {
            let height = lobe.alpha_x * o.x;
            let across = lobe.alpha_y * o.y;
            let out = (o.z, (height * height + across * across).sqrt());
            let seen = o.z * lobe.masking_over_heights((self.i.z, self.s), out);
            // Both directions have the same angle to h.
            let cos = cos_difference(self.i, o);
            fresnel.add_weights(cos, scale * seen * (self.i.z + self.s * x), sum);
        }
    }
}

/// The points x and weights dx for a Gaussian bell times a smooth function. With `closing` that function ends like a root at `to`.
fn bell(
    from: f64,
    to: f64,
    longest: f64,
    closing: bool,
    order: usize,
    add: &mut impl FnMut(f64, f64),
) {
    let closing = closing && to < BECKMANN_END;
    let (from, to) = (from.max(-BECKMANN_END), to.min(BECKMANN_END));
    panels(from, to, longest, [false, closing], order, add);
}

/// The points x and weights dx for a bell of width `core` with long tails times a function that varies at `far` or on the bell's width: x = core sinh τ, and
/// beyond `far` x = 1/v.
fn tails(
    from: f64,
    to: f64,
    (core, far): (f64, f64),
    closing: [bool; 2],
    order: usize,
    add: &mut impl FnMut(f64, f64),
) {
    let split = to > 2.0 * far && from < far;
    let near = if split { far } else { to };
    let (first, last) = ((from / core).asinh(), (near / core).asinh());
    panels(first, last, 2.5, [closing[0], closing[1] && !split], order, &mut |t: f64, width| {
        add(core * t.sinh(), core * t.cosh() * width);
    });
    if split {
        panels(
            1.0 / far,
            1.0 / to,
            f64::INFINITY,
            [false, closing[1]],
            order,
            &mut |v, width: f64| {
                add(1.0 / v, width.abs() / (v * v));
            },
        );
    }
}

/// Points and weights over panels no longer than `longest`; the first or last has its points closer together towards `from` or `to` that is `closing`.
fn panels(
    from: f64,
    to: f64,
    longest: f64,
    closing: [bool; 2],
    order: usize,
    add: &mut impl FnMut(f64, f64),
) {
    let mut count = ((to - from).abs() / longest).ceil().max(1.0);
    if closing == [true, true] {
        count = count.max(2.0);
    }
    let edge = |j: f64| from + (to - from) * j / count;
    let mut j = 0.0;
    while j < count {
        let (first, last) = (edge(j), edge(j + 1.0));
        // The end from which a root or a steep fall is seen, and the other.
        let ends = match closing {
            [true, _] if j == 0.0 => Some((first, last)),
            [_, true] if j + 1.0 >= count => Some((last, first)),
            _ => None,
        };
        if let Some((near, other)) = ends {
            for (t, width) in panels::panel(0.0, 1.0, order) {
                add(near + (other - near) * t * t, 2.0 * (last - first) * t * width);
            }
        } else {
            panels::panel(first, last, order).for_each(|(x, width)| add(x, width));
        }
        j += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_radiometry::spectrum::Spectrum;

    /// Truth: the quadrature itself, bit for bit: for lobes and laws that differ in one number each, asked for twice, and again after more than are remembered.
    #[test]
    fn what_is_remembered_is_what_was_computed() {
        let grey = || Spectrum::constant(0.5, 300.0, 1200.0).unwrap();
        let laws = [
            Fresnel::constant(grey()).unwrap(),
            Fresnel::schlick(grey()).unwrap(),
            Fresnel::dielectric(1.5, 300.0, 1200.0).unwrap(),
            Fresnel::dielectric(1.6, 300.0, 1200.0).unwrap(),
            Fresnel::dielectric(1.5, 300.0, 1200.0).unwrap().coherent(1.0),
        ];
        let mut lobes = Vec::new();
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for masking in [Masking::Separable, Masking::HeightCorrelated] {
                for (x, y) in [(0.3, 0.3), (0.3, 0.4), (0.4, 0.3)] {
                    lobes.push(Lobe::anisotropic(distribution, x, y, masking).unwrap());
                }
            }
        }
        let directions = [DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.0, 0.6, 0.8), DVec3::Z];
        let same = || {
            for (lobe, law) in lobes.iter().flat_map(|l| laws.iter().map(move |f| (l, f))) {
                for i in directions {
                    let bits = |w: Vec<f64>| w.into_iter().map(f64::to_bits).collect::<Vec<_>>();
                    let fresh = bits(weights(lobe, law, i).unwrap());
                    assert_eq!(bits(kept_weights(lobe, law, i).unwrap()), fresh, "{lobe:?}");
                }
            }
        };
        same();
        same();
        for k in 0..MOST_KEPT {
            let alpha = 1.0 + 1e-3 * k as f64;
            let lobe = Lobe::isotropic(Distribution::Ggx, alpha.min(2.0), Masking::Separable);
            kept_weights(&lobe.unwrap(), &laws[0], DVec3::new(0.0, 1e-3 * k as f64, 1.0)).unwrap();
        }
        same();
    }
}
