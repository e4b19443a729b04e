//! Fresnel's equations for n + ik, with wavelength and angle kept apart.
//!
//! Between angles of incidence the reflectance is interpolated: F(λ, θ) = Σ_j F(λ, θ_j) ℓ_j(u), with ℓ_j the cardinal polynomials of
//! the Chebyshev points in u = (1+b) cosθ/(cosθ+b). A metal's p-polarised reflectance has its poles near cosθ = −1/(n+ik), close to grazing
//! incidence; that mapping moves them away, so that a dozen angles do where cosθ itself would need thirty. b and the number of
//! angles are chosen so that F errs by no more than [`ANGLE_TOLERANCE`]; between the wavelengths of the index
//! points are added until the spectra, linear between theirs, err by no more than [`WAVELENGTH_TOLERANCE`].

use super::MaterialError;
use std::f64::consts::PI;
use sunglint_radiometry::refractive_index::{RefractiveIndex, RefractiveIndexError};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_radiometry::tables::REFRACTIVE_INDICES;

/// The largest error of F between angles.
pub const ANGLE_TOLERANCE: f64 = 1e-6;
/// The largest error of F between wavelengths, with n and k linear between theirs.
pub const WAVELENGTH_TOLERANCE: f64 = 1e-5;

const MOST_ANGLES: usize = 40;
const ANGLES_TRIED: usize = 400;
/// The most parts of an interval of wavelengths: far more than two rows of any table need.
const MOST_PARTS: usize = 4096;

/// The refractive index n + ik of a material by vacuum wavelength, linear between.
#[derive(Debug, Clone, PartialEq)]
pub struct ComplexIndex {
    /// Name of the material.
    pub name: String,
    wavelength_nm: Vec<f64>,
    n: Vec<f64>,
    k: Vec<f64>,
}

impl ComplexIndex {
    /// An index from its table: wavelengths in nm, increasing; n > 0, k ≥ 0.
    ///
    /// # Errors
    /// Columns of different lengths, wavelengths that do not increase, an index that no material has.
    pub fn new(
        name: impl Into<String>,
        wavelength_nm: Vec<f64>,
        n: Vec<f64>,
        k: Vec<f64>,
    ) -> Result<Self, MaterialError> {
        // A spectrum makes the same demands on its wavelengths.
        Spectrum::<Reflectance>::new(wavelength_nm.clone(), n.clone())?;
        Spectrum::<Reflectance>::new(wavelength_nm.clone(), k.clone())?;
        if let Some(row) = n.iter().position(|n| *n <= 0.0) {
            return Err(MaterialError::Index { row: row + 1, n: n[row] });
        }
        Ok(Self { name: name.into(), wavelength_nm, n, k })
    }

    /// A material of radiometry's table (`aluminium`, `gold`, `silicon` …).
    ///
    /// # Errors
    /// No material of that name.
    pub fn named(name: &str) -> Result<Self, RefractiveIndexError> {
        let material = RefractiveIndex::named(name)?.material;
        let table = REFRACTIVE_INDICES.table();
        let mut found = Self { name: material, wavelength_nm: vec![], n: vec![], k: vec![] };
        let columns =
            (table.text("material"), table.f64("wavelength_nm"), table.f64("n"), table.f64("k"));
        if let (Ok(names), Ok(nm), Ok(n), Ok(k)) = columns {
            for row in 0..table.rows() {
                if names[row].as_deref() == Some(&found.name) {
                    found.wavelength_nm.push(nm[row]);
                    found.n.push(n[row]);
                    found.k.push(k[row]);
                }
            }
        }
        Ok(found)
    }

    /// First and last wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.wavelength_nm[0], self.wavelength_nm[self.wavelength_nm.len() - 1])
    }

    /// (n, k) at a wavelength, vacuum nm; held beyond the table's ends.
    fn at(&self, nm: f64) -> [f64; 2] {
        let after = self.wavelength_nm.partition_point(|w| *w <= nm);
        let row = after.clamp(1, self.wavelength_nm.len() - 1) - 1;
        let (from, to) = (self.wavelength_nm[row], self.wavelength_nm[row + 1]);
        let (n, k) = self.within(row, ((nm - from) / (to - from)).clamp(0.0, 1.0));
        [n, k]
    }

    /// (n, k) within interval `row` (from `row` to `row + 1`), `t` from 0 to 1.
    fn within(&self, row: usize, t: f64) -> (f64, f64) {
        let mix = |y: &[f64]| y[row] * (1.0 - t) + y[row + 1] * t;
        (mix(&self.n), mix(&self.k))
    }
}

/// The reflectance of unpolarised light on n + ik from vacuum at an angle of incidence θ, by Fresnel's equations
/// (Born and Wolf, Principles of Optics, §14.4; in the form of complex amplitudes).
pub fn fresnel(n: f64, k: f64, cos: f64) -> f64 {
    let [s, p] = polarised(n, k, cos);
    0.5 * (s + p)
}

/// Half of what s-polarised light is reflected more than p-polarised light: (R_s − R_p)/2, never below 0. Of unpolarised light that was reflected once it is the
/// part that is polarised perpendicular to the plane of incidence (Born and Wolf, §1.5.3; the element M₁₀ of the Mueller matrix).
pub fn difference(n: f64, k: f64, cos: f64) -> f64 {
    let [s, p] = polarised(n, k, cos);
    (0.5 * (s - p)).max(0.0)
}

/// The reflectances R_s and R_p.
fn polarised(n: f64, k: f64, cos: f64) -> [f64; 2] {
    if cos <= 0.0 {
        return [1.0; 2];
    }
    let (a, b) = root(n, k, cos);
    let square = |x: f64| x * x;
    let s = (square(cos - a) + square(b)) / (square(cos + a) + square(b));
    // r_p = (m² cosθ − q)/(m² cosθ + q).
    let (x, y) = ((n * n - k * k) * cos, 2.0 * n * k * cos);
    let p = (square(x - a) + square(y - b)) / (square(x + a) + square(y + b));
    [s, p]
}

/// R_s, R_p, and the real and imaginary part of r_s r_p*, of the complex amplitudes r_s and r_p (fields e^(−iωt), n + ik) where each of the directions p is the cross product of its direction of
/// propagation and of s: then r_p = −r_s at normal incidence (Born and Wolf, §1.5.2 and §14.2).
pub(crate) fn amplitudes(n: f64, k: f64, cos: f64) -> [f64; 4] {
    let cos = cos.clamp(0.0, 1.0);
    let (a, b) = root(n, k, cos);
    let (x, y) = ((n * n - k * k) * cos, 2.0 * n * k * cos);
    // (u − q)/(u + q) of a complex u.
    let ratio = |x: f64, y: f64| {
        let (re, im) = ((x - a) * (x + a) + (y - b) * (y + b), 2.0 * (y * a - x * b));
        let size = (x + a) * (x + a) + (y + b) * (y + b);
        if size > 0.0 { (re / size, im / size) } else { (-1.0, 0.0) }
    };
    let (s, p) = (ratio(cos, 0.0), ratio(x, y));
    let [rs, rp] = [s, p].map(|(re, im)| re * re + im * im);
    [rs, rp, s.0 * p.0 + s.1 * p.1, s.1 * p.0 - s.0 * p.1]
}

/// q = √(m² − sin²θ) = a + ib with m = n + ik.
fn root(n: f64, k: f64, cos: f64) -> (f64, f64) {
    let (re, im) = (n * n - k * k - 1.0 + cos * cos, 2.0 * n * k);
    let modulus = re.hypot(im);
    // Of (|z| ± re)/2 the one without cancellation; the other from ab = im/2.
    if re >= 0.0 {
        let a = (0.5 * (modulus + re)).sqrt();
        (a, if a > 0.0 { 0.5 * im / a } else { 0.0 })
    } else {
        let b = (0.5 * (modulus - re)).sqrt();
        (0.5 * im / b, b)
    }
}

/// A quantity of n, k and cosθ.
type Quantity = fn(f64, f64, f64) -> f64;

/// Interpolation between the reflectances at some angles of incidence.
#[derive(Debug, Clone)]
pub struct Conductor {
    name: String,
    b: f64,
    /// The Chebyshev points in u, from grazing (0) to normal (1).
    u: Vec<f64>,
    error: f64,
    /// The index that its spectra are made of.
    index: std::sync::Arc<ComplexIndex>,
    quantity: Quantity,
}

impl Conductor {
    /// The interpolation with the fewest angles, and the reflectances at these.
    pub(super) fn new(
        index: &ComplexIndex,
    ) -> Result<(Self, Vec<Spectrum<Reflectance>>), MaterialError> {
        Self::of(index, fresnel)
    }

    /// The same for (R_s − R_p)/2.
    pub(super) fn difference(&self) -> Result<(Self, Vec<Spectrum<Reflectance>>), MaterialError> {
        Self::of(&self.index, difference)
    }

    fn of(
        index: &ComplexIndex,
        quantity: Quantity,
    ) -> Result<(Self, Vec<Spectrum<Reflectance>>), MaterialError> {
        let wavelengths = Self::samples(index);
        // Angles closer together near grazing.
        let cos: Vec<f64> =
            (0..=ANGLES_TRIED).map(|j| (j as f64 / ANGLES_TRIED as f64).powi(2)).collect();
        let truth: Vec<Vec<f64>> = wavelengths
            .iter()
            .map(|&(n, k)| cos.iter().map(|&cos| quantity(n, k, cos)).collect())
            .collect();
        let owned = std::sync::Arc::new(index.clone());
        let mut found = None;
        'angles: for angles in 3..=MOST_ANGLES {
            for b in [0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0] {
                let mut trial = Self {
                    name: index.name.clone(),
                    b,
                    u: points(angles),
                    error: 0.0,
                    index: owned.clone(),
                    quantity,
                };
                if trial.measure(&wavelengths, &cos, &truth) {
                    found = Some(trial);
                    break 'angles;
                }
            }
        }
        let found = found.ok_or_else(|| MaterialError::NotSmooth {
            name: index.name.clone(),
            angles: MOST_ANGLES,
        })?;
        let spectra = found.tabulate(index)?;
        Ok((found, spectra))
    }

    /// The index (n, k) at a wavelength, vacuum nm.
    pub(super) fn index_at(&self, nm: f64) -> [f64; 2] {
        self.index.at(nm)
    }

    /// The largest error of F over angles.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Returns the name of the material.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The cosines of the angles of incidence, from grazing to normal.
    pub fn cosines(&self) -> Vec<f64> {
        self.u.iter().map(|&u| u * self.b / (1.0 + self.b - u)).collect()
    }

    /// One number for each angle, so that the interpolation between them is at no angle below that of `spectra` at any wavelength.
    pub(super) fn brightest(&self, spectra: &[Spectrum<Reflectance>]) -> Vec<f64> {
        let mut most: Vec<f64> =
            spectra.iter().map(|s| s.value().iter().copied().fold(0.0, f64::max)).collect();
        let rows = spectra[0].value().len();
        let mut weights = vec![0.0; most.len()];
        let mut lacking = 0.0_f64;
        for j in 0..=ANGLES_TRIED {
            weights.fill(0.0);
            self.add_weights((j as f64 / ANGLES_TRIED as f64).powi(2), 1.0, &mut weights);
            for row in 0..rows {
                let short: f64 = spectra
                    .iter()
                    .zip(&weights)
                    .zip(&most)
                    .map(|((s, w), most)| (s.value()[row] - most) * w)
                    .sum();
                lacking = lacking.max(short);
            }
        }
        // The weights add up to 1. Between the angles tried the polynomial may lack a little more.
        most.iter_mut().for_each(|v| *v += lacking * 1.01 + 1e-7);
        most
    }

    pub(super) fn add_weights(&self, cos: f64, scale: f64, sum: &mut [f64]) {
        let cos = cos.clamp(0.0, 1.0);
        let u = (1.0 + self.b) * cos / (cos + self.b);
        if let Some(node) = self.u.iter().position(|&node| node == u) {
            sum[node] += scale;
            return;
        }
        // The barycentric form; of Chebyshev points (of the second kind) the weights are ±1, half at the ends
        // (Berrut and Trefethen 2004, SIAM Review 46, 501).
        let last = self.u.len() - 1;
        let term = |j: usize| {
            let sign = if j.is_multiple_of(2) { 1.0 } else { -1.0 };
            let half = if j == 0 || j == last { 0.5 } else { 1.0 };
            sign * half / (u - self.u[j])
        };
        let mut terms = [0.0; MOST_ANGLES];
        let mut all = 0.0;
        for (j, slot) in terms.iter_mut().enumerate().take(last + 1) {
            *slot = term(j);
            all += *slot;
        }
        let scale = scale / all;
        for (sum, term) in sum.iter_mut().zip(&terms[..=last]) {
            *sum += scale * term;
        }
    }

    /// Weights and their derivatives by the cosine: the products of the interpolating polynomial, which have no quotient that vanishes.
    pub(super) fn slopes(&self, cos: f64) -> Vec<(f64, f64)> {
        let cos = cos.clamp(0.0, 1.0);
        let u = (1.0 + self.b) * cos / (cos + self.b);
        let rate = (1.0 + self.b) * self.b / (cos + self.b).powi(2);
        let last = self.u.len() - 1;
        let product = |j: usize| {
            let sign = if j.is_multiple_of(2) { 1.0 } else { -1.0 };
            let half = if j == 0 || j == last { 0.5 } else { 1.0 };
            let others = self.u.iter().enumerate().filter(|(m, _)| *m != j);
            others.fold((sign * half, 0.0), |(value, slope), (_, node)| {
                (value * (u - node), slope * (u - node) + value)
            })
        };
        let mut all: Vec<(f64, f64)> = (0..=last).map(product).collect();
        let total: f64 = all.iter().map(|p| p.0).sum();
        all.iter_mut().for_each(|p| *p = (p.0 / total, p.1 * rate / total));
        all
    }

    /// Measures the error; says whether it is small enough.
    fn measure(&mut self, wavelengths: &[(f64, f64)], cos: &[f64], truth: &[Vec<f64>]) -> bool {
        let nodes = self.cosines();
        let at_nodes: Vec<Vec<f64>> = wavelengths
            .iter()
            .map(|&(n, k)| nodes.iter().map(|&cos| (self.quantity)(n, k, cos)).collect())
            .collect();
        let mut weights = vec![0.0; nodes.len()];
        for (j, &cos) in cos.iter().enumerate() {
            weights.fill(0.0);
            self.add_weights(cos, 1.0, &mut weights);
            for (values, truth) in at_nodes.iter().zip(truth) {
                let value: f64 = values.iter().zip(&weights).map(|(v, w)| v * w).sum();
                self.error = self.error.max((value - truth[j]).abs());
                if self.error > ANGLE_TOLERANCE {
                    return false;
                }
            }
        }
        true
    }

    /// (n, k) at the wavelengths of the table and half way between.
    fn samples(index: &ComplexIndex) -> Vec<(f64, f64)> {
        let rows = index.wavelength_nm.len();
        let mut samples: Vec<(f64, f64)> = (0..rows - 1)
            .flat_map(|row| [index.within(row, 0.0), index.within(row, 0.5)])
            .collect();
        samples.push((index.n[rows - 1], index.k[rows - 1]));
        samples
    }

    /// The reflectances at the angles, on the table's wavelengths and as many between as are needed.
    fn tabulate(&self, index: &ComplexIndex) -> Result<Vec<Spectrum<Reflectance>>, MaterialError> {
        let cos = self.cosines();
        let at = |row: usize, t: f64| -> Vec<f64> {
            let (n, k) = index.within(row, t);
            cos.iter().map(|&cos| (self.quantity)(n, k, cos)).collect()
        };
        let (mut nm, mut values) = (Vec::new(), Vec::new());
        for row in 0..index.wavelength_nm.len() - 1 {
            let parts = parts(&at, row).ok_or(MaterialError::Wavelengths {
                from_nm: index.wavelength_nm[row],
                to_nm: index.wavelength_nm[row + 1],
                points: MOST_PARTS,
            })?;
            let (from, to) = (index.wavelength_nm[row], index.wavelength_nm[row + 1]);
            for part in 0..parts {
                let t = part as f64 / parts as f64;
                nm.push(from + (to - from) * t);
                values.push(at(row, t));
            }
        }
        let last = index.wavelength_nm.len() - 1;
        nm.push(index.wavelength_nm[last]);
        values.push(at(last - 1, 1.0));
        let spectrum = |j: usize| {
            let value = values.iter().map(|v: &Vec<f64>| v[j].clamp(0.0, 1.0)).collect();
            Ok(Spectrum::new(nm.clone(), value)?)
        };
        (0..cos.len()).map(spectrum).collect()
    }
}

/// Into how many parts an interval of wavelengths is divided so that all reflectances are linear in each.
fn parts(at: &impl Fn(usize, f64) -> Vec<f64>, row: usize) -> Option<usize> {
    let good = |parts: usize| {
        (0..parts).all(|part| {
            let (from, to) = (part as f64 / parts as f64, (part + 1) as f64 / parts as f64);
            let (first, last) = (at(row, from), at(row, to));
            [0.25, 0.5, 0.75].iter().all(|t| {
                let truth = at(row, from + (to - from) * t);
                let line = first.iter().zip(&last).map(|(a, b)| a * (1.0 - t) + b * t);
                line.zip(&truth)
                    .all(|(line, truth)| (line - truth).abs() <= 0.9 * WAVELENGTH_TOLERANCE)
            })
        })
    };
    (0..)
        .map(|power| 1 << power)
        .take_while(|parts| *parts <= MOST_PARTS)
        .find(|parts| good(*parts))
}

/// The Chebyshev points of the second kind between 0 and 1.
fn points(count: usize) -> Vec<f64> {
    (0..count).map(|j| (0.5 * PI * j as f64 / (count - 1) as f64).sin().powi(2)).collect()
}
