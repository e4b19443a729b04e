//! Wavelengths between which inter-reflected light is linear.
//!
//! Light scattered n times carries products of n reflectances, and all orders together a rational function of them. It is found at a few
//! wavelengths ("nodes") and is linear between: the terms are hat functions, which are never negative. Nodes are added where products
//! of two, three and four reflectances and sums of all orders are linear least, until all of them are within the tolerance.

use super::BounceError;
use crate::surface::Material;
use sunglint_radiometry::spectrum::{Factor, Spectrum};

/// Wavelengths at which linearity is tested, at most.
const MOST_TESTED: usize = 2000;
/// Nodes at most.
const MOST_NODES: usize = 240;
/// Nodes of other reflectances are kept up to so many times the error of the first, or up to this.
const WORSE: f64 = 2.0;
const LEAST_WORSE: f64 = 1e-4;
/// Where the bounced light is weaker than this, of its most, the error is relative to this: no light comes from there.
const FLOOR: f64 = 0.02;

/// The nodes.
#[derive(Debug, Clone)]
pub struct Nodes {
    /// Their wavelengths, vacuum nm, increasing; one alone where nothing depends on the wavelength.
    pub nm: Vec<f64>,
    /// The largest error of what was tested between them, relative.
    pub error: f64,
    range: (f64, f64),
}

impl Nodes {
    /// For light among materials (numbers into `materials`), to a relative tolerance.
    pub fn new(
        materials: &[Material],
        among: &[usize],
        tolerance: f64,
    ) -> Result<Self, BounceError> {
        let spectra: Vec<_> = among.iter().flat_map(|m| materials[*m].spectra()).collect();
        let range = spectra.iter().fold((0.0_f64, f64::INFINITY), |(a, b), s| {
            let (first, last) = s.range_nm();
            (a.max(first), b.min(last))
        });
        if !(range.0 < range.1 && range.1.is_finite()) {
            let (from_nm, to_nm) = range;
            return Err(BounceError::Disjoint { from_nm, to_nm });
        }
        let grid = grid(&spectra.iter().map(|s| s.wavelength_nm()).collect::<Vec<_>>(), range);
        let rows: Vec<Vec<f64>> =
            spectra.iter().map(|s| grid.iter().map(|nm| s.at(*nm)).collect()).collect();
        let functions = products(&rows);
        let constant = |f: &Vec<f64>| f.iter().all(|v| (v - f[0]).abs() <= 1e-12 * f[0]);
        if functions.iter().all(constant) {
            return Ok(Self { nm: vec![0.5 * (range.0 + range.1)], error: 0.0, range });
        }
        let mut chosen = vec![0, grid.len() - 1];
        loop {
            let (at, error) = worst(&grid, &functions, &chosen);
            if error <= tolerance || chosen.len() >= MOST_NODES {
                let nm = chosen.iter().map(|k| grid[*k]).collect();
                return Ok(Self { nm, error, range });
            }
            let place = chosen.partition_point(|k| *k < at);
            chosen.insert(place, at);
        }
    }

    /// The same wavelengths for the same materials in other reflectances; `None` where the light is not as linear between them.
    pub fn again(&self, materials: &[Material], among: &[usize]) -> Option<Self> {
        let spectra: Vec<_> = among.iter().flat_map(|m| materials[*m].spectra()).collect();
        let (first, last) = self.range;
        if spectra.iter().any(|s| s.range_nm().0 > first || s.range_nm().1 < last) {
            return None;
        }
        let mut tables: Vec<&[f64]> = spectra.iter().map(|s| s.wavelength_nm()).collect();
        tables.push(&self.nm);
        let grid = grid(&tables, self.range);
        let rows: Vec<Vec<f64>> =
            spectra.iter().map(|s| grid.iter().map(|nm| s.at(*nm)).collect()).collect();
        let functions = products(&rows);
        let error = if self.nm.len() == 1 {
            let uneven = |f: &Vec<f64>| {
                let most = f.iter().copied().fold(0.0, f64::max);
                f.iter().map(|v| (v - f[0]).abs()).fold(0.0, f64::max) / most
            };
            functions.iter().map(uneven).fold(0.0, f64::max)
        } else {
            let place = |nm: &f64| grid.partition_point(|g| g < nm);
            worst(&grid, &functions, &self.nm.iter().map(place).collect::<Vec<_>>()).1
        };
        let most = (WORSE * self.error).max(LEAST_WORSE);
        (error <= most).then(|| Self { nm: self.nm.clone(), error, range: self.range })
    }

    /// The function of each node: 1 there, 0 at the others.
    pub fn spectra(&self) -> Result<Vec<Spectrum<Factor>>, BounceError> {
        if self.nm.len() == 1 {
            return Ok(vec![Spectrum::constant(1.0, self.range.0, self.range.1)?]);
        }
        let hat = |k: usize| {
            let value = (0..self.nm.len()).map(|j| f64::from(u8::from(j == k))).collect();
            Ok(Spectrum::new(self.nm.clone(), value)?)
        };
        (0..self.nm.len()).map(hat).collect()
    }
}

/// All tabulated wavelengths within the range and points between them.
fn grid(tables: &[&[f64]], (first, last): (f64, f64)) -> Vec<f64> {
    let mut knots: Vec<f64> = tables.iter().flat_map(|t| t.iter().copied()).collect();
    knots.extend([first, last]);
    knots.retain(|nm| (first..=last).contains(nm));
    knots.sort_by(f64::total_cmp);
    knots.dedup();
    let between = (MOST_TESTED / knots.len()).clamp(1, 16);
    let mut grid = Vec::new();
    for pair in knots.windows(2) {
        grid.extend(
            (0..between).map(|k| pair[0] + (pair[1] - pair[0]) * k as f64 / between as f64),
        );
    }
    grid.push(last);
    grid
}

/// Returns the products of reflectances that light may have been multiplied by.
fn products(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    // Many spectra: each with itself and its neighbours in the list alone.
    let reach = if rows.len() <= 12 { rows.len() } else { 3 };
    let mut out = Vec::new();
    for (i, a) in rows.iter().enumerate() {
        for b in &rows[i..(i + reach).min(rows.len())] {
            let two: Vec<f64> = a.iter().zip(b).map(|(a, b)| a * b).collect();
            for c in [a, b] {
                for power in [1, 2] {
                    out.push(two.iter().zip(c).map(|(t, c)| t * c.powi(power)).collect());
                }
                // A quarter of the hemisphere filled, and two thirds: all orders.
                for filled in [0.25, 0.65] {
                    out.push(two.iter().zip(c).map(|(t, c)| t / (1.0 - filled * c)).collect());
                }
            }
            out.push(two);
        }
    }
    out.retain(|f: &Vec<f64>| f.iter().any(|v| *v > 0.0));
    out
}

/// Where lines between the chosen are worst, and how bad.
fn worst(grid: &[f64], functions: &[Vec<f64>], chosen: &[usize]) -> (usize, f64) {
    let mut found = (0, 0.0_f64);
    for f in functions {
        let floor = FLOOR * f.iter().copied().fold(0.0, f64::max);
        for pair in chosen.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            for k in a + 1..b {
                let t = (grid[k] - grid[a]) / (grid[b] - grid[a]);
                let line = f[a] * (1.0 - t) + f[b] * t;
                let error = (line - f[k]).abs() / (f[k] + floor);
                if error > found.1 {
                    found = (k, error);
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_radiometry::spectrum::Reflectance;

    fn material(nm: &[f64], rho: &[f64]) -> Material {
        let spectrum = Spectrum::<Reflectance>::new(nm.to_vec(), rho.to_vec()).unwrap();
        Material::lambert("m", spectrum).unwrap()
    }

    /// Truth: a product that the nodes were not made for, ρ₁³ρ₂/(1 − 0.5 ρ₁ρ₂), at 1,000 wavelengths. Tolerance: six times the nodes' own: higher orders bend more.
    #[test]
    fn products_between_nodes() {
        let a = material(&[300.0, 400.0, 450.0, 900.0, 1240.0], &[0.1, 0.7, 0.8, 0.6, 0.9]);
        let b = material(&[300.0, 700.0, 750.0, 1240.0], &[0.9, 0.8, 0.1, 0.3]);
        for tolerance in [0.1, 0.03, 0.01] {
            let nodes = Nodes::new(&[a.clone(), b.clone()], &[0, 1], tolerance).unwrap();
            assert!(nodes.error <= tolerance);
            let hats = nodes.spectra().unwrap();
            let truth = |nm: f64| {
                let (p, q) = (a.spectra()[0].at(nm), b.spectra()[0].at(nm));
                p.powi(3) * q / (1.0 - 0.5 * p * q)
            };
            let values: Vec<f64> = nodes.nm.iter().map(|nm| truth(*nm)).collect();
            let most = (300..=1240).map(|nm| truth(f64::from(nm))).fold(0.0, f64::max);
            for nm in 0..1000 {
                let nm = 300.0 + 0.94 * f64::from(nm);
                let found: f64 = hats.iter().zip(&values).map(|(h, v)| h.at(nm) * v).sum();
                let error = (found - truth(nm)).abs() / (truth(nm) + FLOOR * most);
                assert!(error < 6.0 * tolerance, "{nm} nm: {error} with {} nodes", values.len());
            }
        }
        let grey = material(&[300.0, 1240.0], &[0.8, 0.8]);
        let nodes = Nodes::new(&[grey], &[0], 1e-3).unwrap();
        assert_eq!((nodes.nm.len(), nodes.spectra().unwrap()[0].at(500.0)), (1, 1.0));
    }

    #[test]
    fn spectra_without_common_wavelengths_are_refused() {
        let materials =
            [material(&[300.0, 400.0], &[0.5; 2]), material(&[500.0, 600.0], &[0.5; 2])];
        let error = Nodes::new(&materials, &[0, 1], 0.01).unwrap_err().to_string();
        assert!(error.contains("500 nm") && error.contains("400 nm"), "{error}");
    }
}
