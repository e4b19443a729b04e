//! The Earth's magnetic field, IGRF-14.

use glam::DVec3;
use std::sync::OnceLock;

/// Reference radius of the coefficients, m.
const REFERENCE_M: f64 = 6_371_200.0;
/// Highest degree.
const DEGREE: usize = 13;
/// Coefficients g and h of one degree and order at all epochs, nT.
type Pair = [Vec<f64>; 2];

/// Gauss coefficients at epochs five years apart.
#[derive(Debug)]
struct Table {
    years: Vec<f64>,
    /// At `index(n, m)`.
    pairs: Vec<Pair>,
}

fn index(n: usize, m: usize) -> usize {
    n * (n + 1) / 2 + m
}

fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| {
        let text = include_str!("../../../data/igrf14.csv");
        let mut rows = text.lines().filter(|l| !l.starts_with('#'));
        let numbers =
            |line: &str| -> Vec<f64> { line.split(',').filter_map(|v| v.parse().ok()).collect() };
        let years = rows.next().map(numbers).unwrap_or_default();
        let mut pairs =
            vec![[vec![0.0; years.len()], vec![0.0; years.len()]]; index(DEGREE, DEGREE) + 1];
        for row in rows.map(numbers) {
            let (n, m) = (row[0] as usize, row[1]);
            pairs[index(n, m.abs() as usize)][usize::from(m < 0.0)] = row[2..].to_vec();
        }
        Table { years, pairs }
    })
}

/// The years that the model covers: first, last.
pub fn years() -> (f64, f64) {
    let years = &table().years;
    (years.first().copied().unwrap_or(0.0), years.last().copied().unwrap_or(0.0))
}

/// The main field at one moment: all degrees to 13.
#[derive(Debug, Clone)]
pub struct MainField {
    /// g and h at `index(n, m)`, T.
    coefficients: Vec<[f64; 2]>,
}

impl MainField {
    /// Returns the field of a decimal year, linear between epochs; `None` outside [`years`].
    pub fn at(year: f64) -> Option<Self> {
        let Table { years, pairs } = table();
        let after = years.iter().position(|y| *y >= year)?;
        let first = after.max(1) - 1;
        // Written so that NaN is outside too.
        if year.is_nan() || year < years[first] {
            return None;
        }
        let part = (year - years[first]) / (years[first + 1] - years[first]);
        let mix = |v: &Vec<f64>| 1e-9 * (v[first] + part * (v[first + 1] - v[first]));
        Some(Self { coefficients: pairs.iter().map(|[g, h]| [mix(g), mix(h)]).collect() })
    }

    /// Returns the flux density in T, ITRS axes, at an ITRS position in m: −∇ of the potential
    /// a Σ (a/r)ⁿ⁺¹ (g cos mφ + h sin mφ) Pₙᵐ(cos θ) (Alken et al. 2021, Earth Planets Space 73, 49, eq. 1).
    pub fn tesla(&self, position_itrs_m: DVec3) -> DVec3 {
        let r = position_itrs_m.length();
        let across = position_itrs_m.x.hypot(position_itrs_m.y);
        // A metre beside the pole the azimuth is defined, and the field the same.
        let (cos, sin) = (position_itrs_m.z / r, (across / r).max(1e-7));
        let phi = position_itrs_m.y.atan2(position_itrs_m.x);
        let mut p = vec![0.0; index(DEGREE, DEGREE) + 1];
        let mut slope = p.clone();
        p[0] = 1.0;
        let (mut radial, mut south, mut east) = (0.0, 0.0, 0.0);
        let mut power = (REFERENCE_M / r).powi(2);
        for n in 1..=DEGREE {
            power *= REFERENCE_M / r;
            for m in 0..=n {
                let k = index(n, m);
                if m == n {
                    // Schmidt's quasi-normalisation in the recursion itself.
                    let factor = if n == 1 { 1.0 } else { (1.0 - 0.5 / n as f64).sqrt() };
                    let d = index(n - 1, n - 1);
                    p[k] = factor * sin * p[d];
                    slope[k] = factor * (sin * slope[d] + cos * p[d]);
                } else {
                    let (nf, mf) = (n as f64, m as f64);
                    let root = (nf * nf - mf * mf).sqrt();
                    let one = (2.0 * nf - 1.0) / root;
                    let d = index(n - 1, m);
                    p[k] = one * cos * p[d];
                    slope[k] = one * (cos * slope[d] - sin * p[d]);
                    if m + 2 <= n {
                        let two = ((nf - 1.0).powi(2) - mf * mf).sqrt() / root;
                        let d = index(n - 2, m);
                        p[k] -= two * p[d];
                        slope[k] -= two * slope[d];
                    }
                }
                let [g, h] = self.coefficients[k];
                let (sin_m, cos_m) = (m as f64 * phi).sin_cos();
                let along = g * cos_m + h * sin_m;
                radial += power * (n + 1) as f64 * along * p[k];
                south -= power * along * slope[k];
                east -= power * m as f64 * (h * cos_m - g * sin_m) * p[k] / sin;
            }
        }
        let (sin_phi, cos_phi) = phi.sin_cos();
        let (cos, sin) = (cos, (1.0 - cos * cos).max(0.0).sqrt());
        radial * DVec3::new(sin * cos_phi, sin * sin_phi, cos)
            + south * DVec3::new(cos * cos_phi, cos * sin_phi, -sin)
            + east * DVec3::new(-sin_phi, cos_phi, 0.0)
    }
}
