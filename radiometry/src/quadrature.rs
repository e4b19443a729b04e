//! One quadrature for every integral over wavelength: exact for products of piecewise-linear tables.
//!
//! Between two neighbouring points of the union of all grids every factor is linear in λ, so that a product of k factors
//! is a polynomial of degree k, which ⌊k/2⌋+1 Gauss–Legendre points integrate exactly. The photon rate
//! ∫Φ·T_a·T_m·η·λ dλ has five linear factors: three points an interval. More factors get more points.

use crate::constants::HC_J_NM;
use crate::spectrum::{Outside, Quantity, Spectrum, SpectrumError, lerp};
use std::borrow::Cow;
use std::sync::LazyLock;
use sunglint_numerics::gauss::legendre;

/// An integral, and how much of its range was not in the tables.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Integral {
    /// The value.
    pub value: f64,
    /// The width in nm, within the integral's range and where no response is zero by being beyond its table, for which a
    /// factor had no data: held there ([`Outside::Held`]) or counted as zero ([`Outside::Missing`]).
    pub uncovered_nm: f64,
}

impl Integral {
    /// Whether every factor was tabulated over the whole range.
    pub fn is_covered(&self) -> bool {
        self.uncovered_nm == 0.0
    }

    /// The same integral in another unit.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { value: self.value * factor, ..self }
    }
}

#[derive(Debug, Clone, Copy)]
struct Factor<'a> {
    x: &'a [f64],
    y: &'a [f64],
    outside: Outside,
}

/// Piece that a walk through a product hands out.
enum Piece {
    /// Width for which a factor had no data, nm.
    Uncovered(f64),
    /// A part of the integral, at a node of its rule.
    Part { nm: f64, value: f64 },
}

fn check_edges(edges_nm: &[f64]) -> Result<(), SpectrumError> {
    let rises = |pair: &[f64]| pair[0] < pair[1] && pair[0].is_finite() && pair[1].is_finite();
    match edges_nm.windows(2).position(|pair| !rises(pair)) {
        Some(i) => {
            let (previous_nm, next_nm) = (edges_nm[i], edges_nm[i + 1]);
            Err(SpectrumError::Edges { edge: i + 2, previous_nm, next_nm })
        }
        None => Ok(()),
    }
}

/// A product of spectra, to be integrated over wavelength.
///
/// ```
/// use sunglint_radiometry::{quadrature::Product, spectrum::{Irradiance, Response, Spectrum}};
/// let light = Spectrum::<Irradiance>::constant(2.0, 300.0, 900.0)?;
/// let filter = Spectrum::<Response>::new(vec![400.0, 500.0, 600.0], vec![0.0, 1.0, 0.0])?;
/// assert!((Product::of(&light).times(&filter).integral().value - 200.0).abs() < 1e-12);
/// # Ok::<(), sunglint_radiometry::spectrum::SpectrumError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Product<'a> {
    factors: Vec<Factor<'a>>,
    wavelength_power: u8,
    number: f64,
}

impl Default for Product<'_> {
    fn default() -> Self {
        Self { factors: Vec::new(), wavelength_power: 0, number: 1.0 }
    }
}

impl<'a> Product<'a> {
    /// The product of one spectrum.
    pub fn of<Q: Quantity>(spectrum: &'a Spectrum<Q>) -> Self {
        Self::default().times(spectrum)
    }

    /// The product with one spectrum more.
    #[must_use]
    pub fn times<Q: Quantity>(mut self, spectrum: &'a Spectrum<Q>) -> Self {
        self.factors.push(Factor {
            x: spectrum.wavelength_nm(),
            y: spectrum.value(),
            outside: Q::OUTSIDE,
        });
        self
    }

    /// The product with the wavelength in nm: from energy to photons (but for hc).
    #[must_use]
    pub fn times_wavelength(mut self) -> Self {
        self.wavelength_power += 1;
        self
    }

    /// The product with a number.
    #[must_use]
    pub fn times_number(mut self, number: f64) -> Self {
        self.number *= number;
        self
    }

    /// The integral over all wavelengths at which the product can be other than zero: the common range of the factors
    /// that are zero beyond their tables; where there is none of them, the range that any factor is tabulated in, so that what the
    /// others lack is said.
    pub fn integral(&self) -> Integral {
        match self.support() {
            Some((first, last)) => self.between(&[first, last])[0],
            None => Integral::default(),
        }
    }

    /// The integral from `from_nm` to `to_nm`; fails where that is not up.
    pub fn over(&self, from_nm: f64, to_nm: f64) -> Result<Integral, SpectrumError> {
        Ok(self.bins(&[from_nm, to_nm])?[0])
    }

    /// The integral over each bin between consecutive edges (nm); fails where these do not increase.
    pub fn bins(&self, edges_nm: &[f64]) -> Result<Vec<Integral>, SpectrumError> {
        check_edges(edges_nm)?;
        Ok(self.between(edges_nm))
    }

    /// Integrates like [`Product::bins`], for edges that are known to increase.
    fn between(&self, edges_nm: &[f64]) -> Vec<Integral> {
        let mut bins = vec![Integral::default(); edges_nm.len().saturating_sub(1)];
        let degree = self.factors.len() + usize::from(self.wavelength_power);
        self.walk(edges_nm, degree, |bin, piece| match piece {
            Piece::Uncovered(nm) => bins[bin].uncovered_nm += nm,
            Piece::Part { value, .. } => bins[bin].value += value,
        });
        bins
    }

    /// The moments B_a = ∫ product(λ) h_a(λ) dλ of the hat functions on increasing knots (nm): h_a is 1 at knot a, 0 at every other
    /// knot, linear between and 0 beyond the ends. For any further factor T that is linear between these knots and 0 beyond
    /// them, ∫ product T dλ = Σ_a T_a B_a: exact, and a dot product. Fails where the knots do not increase.
    pub fn hat_moments(&self, knots_nm: &[f64]) -> Result<Vec<f64>, SpectrumError> {
        check_edges(knots_nm)?;
        let mut moments = vec![0.0; knots_nm.len()];
        let (from, some) = self.moments(knots_nm);
        moments[from..from + some.len()].copy_from_slice(&some);
        Ok(moments)
    }

    /// The moments of [`Product::hat_moments`] between the knots outside of which all of them are 0, and the number of the first. The knots must increase.
    pub(crate) fn moments(&self, knots_nm: &[f64]) -> (usize, Vec<f64>) {
        let every = self.factors.iter().map(Factor::lit_or_held);
        let lit =
            every.fold((f64::NEG_INFINITY, f64::INFINITY), |(a, b), (c, d)| (a.max(c), b.min(d)));
        let from = knots_nm.partition_point(|nm| *nm <= lit.0).max(1) - 1;
        let to = (knots_nm.partition_point(|nm| *nm < lit.1) + 1).min(knots_nm.len());
        let knots_nm = &knots_nm[from..to.max(from)];
        let mut moments = vec![0.0; knots_nm.len()];
        let degree = self.factors.len() + usize::from(self.wavelength_power) + 1;
        self.walk(knots_nm, degree, |bin, piece| {
            if let Piece::Part { nm, value } = piece {
                let upper = (nm - knots_nm[bin]) / (knots_nm[bin + 1] - knots_nm[bin]);
                moments[bin] += (1.0 - upper) * value;
                moments[bin + 1] += upper * value;
            }
        });
        (from, moments)
    }

    /// Goes through the intervals between all points of all grids within the edges, by a rule that is exact for a polynomial of that
    /// degree, and hands out the parts of the integral of each bin.
    fn walk(&self, edges_nm: &[f64], degree: usize, mut visit: impl FnMut(usize, Piece)) {
        let (Some(&first), Some(&last)) = (edges_nm.first(), edges_nm.last()) else { return };
        // Where a factor is 0 there is nothing to hand out: a narrow one among many knots is a few intervals.
        let Some((from, to)) = self.lit() else { return };
        let (mut first, mut last) = (first.max(from), last.min(to));
        // Where all tables reach over all of it, so does any that is 0 there.
        if first < last && self.factors.iter().all(|f| f.reaches(first, last)) {
            for factor in &self.factors {
                let Some((from, to)) = factor.lit() else { return };
                (first, last) = (first.max(from), last.min(to));
            }
        }
        if first >= last {
            return;
        }
        let breaks = self.breakpoints(edges_nm, first, last);
        let rule = gauss_legendre(degree / 2 + 1);
        let before = |x: &[f64]| x[1..x.len() - 1].partition_point(|x| *x <= first);
        let mut cursors: Vec<usize> = self.factors.iter().map(|f| before(f.x)).collect();
        let mut bin = before(edges_nm);
        for interval in breaks.windows(2) {
            let (a, b) = (interval[0], interval[1]);
            while bin + 2 < edges_nm.len() && a >= edges_nm[bin + 1] {
                bin += 1;
            }
            let middle = 0.5 * (a + b);
            let mut uncovered = false;
            let mut dark = false;
            for (factor, cursor) in self.factors.iter().zip(&mut cursors) {
                while *cursor + 2 < factor.x.len() && factor.x[*cursor + 1] <= middle {
                    *cursor += 1;
                }
                let inside = middle >= factor.x[0] && middle <= factor.x[factor.x.len() - 1];
                match factor.outside {
                    // Zero beyond its table, or padded with zeros within it.
                    Outside::Zero => {
                        dark |= !inside || factor.y[*cursor] == 0.0 && factor.y[*cursor + 1] == 0.0
                    }
                    Outside::Held | Outside::Missing => uncovered |= !inside,
                }
            }
            if dark {
                continue;
            }
            if uncovered {
                visit(bin, Piece::Uncovered(b - a));
            }
            let scale = self.number * 0.5 * (b - a);
            for &(node, weight) in rule.iter() {
                let nm = middle + 0.5 * (b - a) * node;
                let mut value = weight * nm.powi(i32::from(self.wavelength_power));
                for (factor, &i) in self.factors.iter().zip(&cursors) {
                    value *= factor.at(i, nm);
                }
                visit(bin, Piece::Part { nm, value: scale * value });
            }
        }
    }

    /// Photons per second of light (the product as W/nm or W/(m² nm)) counted: (1/hc) ∫ … λ dλ (physics: ν of the
    /// thesis' eq. 4.16 without its area), in Hz or Hz/m².
    pub fn photon_rate(&self) -> Integral {
        self.clone().times_wavelength().integral().times(1.0 / HC_J_NM)
    }

    /// Width, nm, for which a factor has no data, as [`Product::integral`] says it.
    pub fn uncovered_nm(&self) -> f64 {
        let common = self.support().zip(self.lit());
        let range = common.map(|((a, b), (c, d))| (a.max(c), b.min(d)));
        match range {
            Some((first, last)) if !self.factors.iter().all(|f| f.reaches(first, last)) => {
                self.integral().uncovered_nm
            }
            _ => 0.0,
        }
    }

    /// The range over which the product can be other than zero.
    fn support(&self) -> Option<(f64, f64)> {
        let ends = |f: &Factor| (f.x[0], f.x[f.x.len() - 1]);
        let zero = self.factors.iter().filter(|f| f.outside == Outside::Zero).map(ends);
        let common = zero.reduce(|(a, b), (c, d)| (a.max(c), b.min(d)));
        let widest = || self.factors.iter().map(ends).reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
        common.or_else(widest).filter(|(a, b)| a < b)
    }

    /// The range outside of which some factor is zero: beyond its table, or padded with zeros within it. `None` where there is none.
    fn lit(&self) -> Option<(f64, f64)> {
        let zero = self.factors.iter().filter(|f| f.outside == Outside::Zero);
        zero.map(Factor::lit).try_fold((f64::NEG_INFINITY, f64::INFINITY), |(a, b), range| {
            range.map(|(c, d)| (a.max(c), b.min(d)))
        })
    }

    /// `first`, `last`, and all edges and points of the factors between them, increasing.
    fn breakpoints(&self, edges_nm: &[f64], first: f64, last: f64) -> Vec<f64> {
        let between =
            |x: &[f64]| (x.partition_point(|x| *x <= first), x.partition_point(|x| *x < last));
        let (from, to) = between(edges_nm);
        let mut breaks = vec![first];
        breaks.extend_from_slice(&edges_nm[from.min(to)..to]);
        breaks.push(last);
        for factor in &self.factors {
            let (from, to) = between(factor.x);
            breaks.extend_from_slice(&factor.x[from.min(to)..to]);
        }
        // Stable: the factors' grids are sorted runs, which the merge sort of the standard library joins in linear time.
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }
}

impl<Q: Quantity> Spectrum<Q> {
    /// The mean over each bin between consecutive edges (nm), exact for the piecewise-linear spectrum; what lies beyond the table
    /// counts as [`Quantity::OUTSIDE`] says. Fails where the edges do not increase.
    pub fn bin_means(&self, edges_nm: &[f64]) -> Result<Vec<f64>, SpectrumError> {
        let bins = Product::of(self).bins(edges_nm)?;
        Ok(bins.iter().zip(edges_nm.windows(2)).map(|(bin, e)| bin.value / (e[1] - e[0])).collect())
    }
}

impl Factor<'_> {
    /// From the last 0 before the first number that is another to the first 0 after the last; `None` where all are 0.
    fn lit(&self) -> Option<(f64, f64)> {
        let first = self.y.iter().position(|y| *y != 0.0)?;
        let last = self.y.iter().rposition(|y| *y != 0.0)?;
        Some((self.x[first.saturating_sub(1)], self.x[(last + 1).min(self.x.len() - 1)]))
    }

    /// The range outside of which the factor is 0, however it is beyond its table.
    fn lit_or_held(&self) -> (f64, f64) {
        let Some((mut first, mut last)) = self.lit() else {
            return (f64::INFINITY, f64::NEG_INFINITY);
        };
        if self.outside == Outside::Held {
            first = if self.y[0] == 0.0 { first } else { f64::NEG_INFINITY };
            last = if self.y[self.y.len() - 1] == 0.0 { last } else { f64::INFINITY };
        }
        (first, last)
    }

    /// Whether the table holds all of a range.
    fn reaches(&self, first: f64, last: f64) -> bool {
        self.x[0] <= first && last <= self.x[self.x.len() - 1]
    }

    /// The value at `nm` in the interval that starts at grid point `i`, or beyond the table.
    fn at(&self, i: usize, nm: f64) -> f64 {
        let last = self.x.len() - 1;
        if nm < self.x[0] || nm > self.x[last] {
            return match self.outside {
                Outside::Zero | Outside::Missing => 0.0,
                Outside::Held if nm < self.x[0] => self.y[0],
                Outside::Held => self.y[last],
            };
        }
        lerp(self.x[i], self.y[i], self.x[i + 1], self.y[i + 1], nm)
    }
}

/// Gauss–Legendre nodes and weights on [−1, 1] of n points, exact to degree 2n−1.
fn gauss_legendre(n: usize) -> Cow<'static, [(f64, f64)]> {
    static FIRST: LazyLock<Vec<Vec<(f64, f64)>>> =
        LazyLock::new(|| (0..=8).map(legendre).collect());
    match FIRST.get(n) {
        Some(rule) => Cow::Borrowed(rule),
        None => Cow::Owned(legendre(n)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::{Irradiance, Reflectance, Response, Transmission};

    fn near(found: f64, expected: f64, relative: f64) {
        assert!((found - expected).abs() <= relative * expected.abs(), "{found} is not {expected}");
    }

    /// Truth: the closed-form integral of λ·(λ/1000)⁴ over 400–600 nm, each factor a straight line through the origin. Tolerance:
    /// rounding alone, the rule being exact for degree 5.
    #[test]
    fn five_linear_factors_are_integrated_exactly() {
        let line = |a: f64, b: f64| {
            Spectrum::<Transmission>::new(vec![a, b], vec![a / 1e3, b / 1e3]).unwrap()
        };
        let (p, q, r, s) =
            (line(400.0, 600.0), line(300.0, 601.0), line(399.0, 700.0), line(1.0, 999.0));
        let found = Product::of(&p)
            .times(&q)
            .times(&r)
            .times(&s)
            .times_wavelength()
            .over(400.0, 600.0)
            .unwrap();
        near(found.value, (600_f64.powi(6) - 400_f64.powi(6)) / 6e12, 1e-14);
        assert!(found.is_covered());
    }

    /// Truth: a triangle times a ramp on another grid, integrated by hand.
    #[test]
    fn tables_on_different_grids_meet_on_their_union() {
        let triangle = Spectrum::<Response>::new(vec![1.0, 2.0, 3.0], vec![0.0, 1.0, 0.0]).unwrap();
        let ramp = Spectrum::<Response>::new(vec![1.5, 2.5], vec![0.0, 1.0]).unwrap();
        // With u = x - 1.5: (u + 1/2) u from 0 to 1/2, then (3/2 - u) u from 1/2 to 1.
        let expected = (0.125 / 3.0 + 0.0625) + (0.75 * 0.75 - 0.875 / 3.0);
        near(Product::of(&triangle).times(&ramp).integral().value, expected, 1e-14);
    }

    #[test]
    fn what_was_not_tabulated_is_said() {
        let filter = Spectrum::<Response>::constant(1.0, 400.0, 600.0).unwrap();
        let light = Spectrum::<Irradiance>::constant(3.0, 450.0, 900.0).unwrap();
        let paint = Spectrum::<Reflectance>::constant(0.5, 300.0, 580.0).unwrap();
        let found = Product::of(&light).times(&filter).integral();
        near(found.value, 450.0, 1e-14);
        assert_eq!(found.uncovered_nm, 50.0);
        let found = Product::of(&light).times(&filter).times(&paint).integral();
        near(found.value, 225.0, 1e-14);
        assert_eq!(found.uncovered_nm, 70.0);
        assert!(!found.is_covered());
        // Beyond the filter nothing is missing.
        let found = Product::of(&light).times(&filter).over(300.0, 1500.0).unwrap();
        near(found.value, 450.0, 1e-14);
        assert_eq!(found.uncovered_nm, 50.0);
        // No common wavelength at all.
        let far = Spectrum::<Response>::constant(1.0, 700.0, 800.0).unwrap();
        assert_eq!(Product::of(&far).times(&filter).integral(), Integral::default());
    }

    #[test]
    fn bins_add_up_to_the_whole() {
        let sun: Spectrum<Irradiance> = crate::light::sun_at_1_au().clone();
        let edges: Vec<f64> = (0..=188).map(|i| 300.0 + 5.0 * f64::from(i)).collect();
        let product = Product::of(&sun);
        let sum: f64 = product.bins(&edges).unwrap().iter().map(|b| b.value).sum();
        near(sum, product.over(300.0, 1240.0).unwrap().value, 1e-13);
        // Truth: the integral that the table's makers give, 1075.74 W/m² (trapezoids on the same points).
        near(sum, 1075.74, 1e-5);
        assert_eq!(sun.bin_means(&edges).unwrap().len(), 188);
    }

    /// Truth: 1 W/(m² nm) over the nanometre around 500.5 nm, at 1239.841984 eV nm a photon (CODATA 2018). Tolerance: the
    /// digits of that number.
    #[test]
    fn photons_per_second() {
        let light = Spectrum::<Irradiance>::constant(1.0, 300.0, 900.0).unwrap();
        let filter = Spectrum::<Response>::constant(1.0, 500.0, 501.0).unwrap();
        let photon_j = 1_239.841_984 / 500.5 * 1.602_176_634e-19;
        near(Product::of(&light).times(&filter).photon_rate().value, 1.0 / photon_j, 1e-9);
    }

    /// Truth: k factors λ/1000 over 1–1000 nm integrate to 1000/(k+1) but for 1e-3^(k+1). Tolerance: rounding.
    #[test]
    fn any_number_of_factors_is_integrated_exactly() {
        let line = Spectrum::<Transmission>::new(vec![1.0, 1000.0], vec![1e-3, 1.0]).unwrap();
        for k in 1..=24 {
            let product = (0..k).fold(Product::default(), |product, _| product.times(&line));
            near(
                product.integral().value,
                1000.0 / (f64::from(k) + 1.0) * (1.0 - 1e-3_f64.powi(k + 1)),
                1e-13,
            );
        }
    }

    /// Truth: hat functions on some knots add up to 1 between the ends, so integrals and moments with each of them add up to those without, and every hat lacks the data that the light
    /// lacks: the light ends within the filter in the second case. Tolerance: rounding; of moments that of places among knots 0.37 nm
    /// apart, 2.2e-16 × 600 nm/0.37 nm.
    #[test]
    fn hats_add_up_to_the_whole() {
        let knots: Vec<f64> = (0..40).map(|k| 380.0 + 6.0 * f64::from(k)).collect();
        let hat = |k: usize| {
            let value = (0..40).map(|j| f64::from(u8::from(j == k))).collect();
            Spectrum::<crate::spectrum::Factor>::new(knots.clone(), value).unwrap()
        };
        let hats: Vec<_> = (0..40).map(hat).collect();
        let filter =
            Spectrum::<Response>::new(vec![400.0, 455.0, 600.0], vec![0.0, 0.8, 0.1]).unwrap();
        let native: Vec<f64> = (0..900).map(|k| 350.0 + 0.37 * f64::from(k)).collect();
        for last in [700.0, 550.0] {
            let light = Spectrum::<Irradiance>::new(
                vec![350.0, 420.0, 500.0, last],
                vec![1.0, 3.0, 2.0, 2.5],
            )
            .unwrap();
            let all = Product::of(&light).times(&filter).times_wavelength();
            let each: Vec<Product> = hats.iter().map(|hat| all.clone().times(hat)).collect();
            near(each.iter().map(|p| p.integral().value).sum(), all.integral().value, 1e-13);
            for product in &each {
                assert_eq!(product.integral().uncovered_nm, all.integral().uncovered_nm);
                assert_eq!(product.uncovered_nm(), product.integral().uncovered_nm);
            }
            assert_eq!(all.integral().uncovered_nm > 0.0, last < 600.0);
            let whole = all.hat_moments(&native).unwrap();
            let mut sums = vec![0.0; native.len()];
            for product in &each {
                let moments = product.hat_moments(&native).unwrap();
                sums.iter_mut().zip(moments).for_each(|(sum, moment)| *sum += moment);
                assert!(product.moments(&native).1.len() < 40);
            }
            let most = whole.iter().copied().fold(0.0, f64::max);
            for (sum, whole) in sums.iter().zip(&whole) {
                assert!((sum - whole).abs() < 1e-12 * most, "{sum} {whole}");
            }
        }
    }

    #[test]
    fn light_and_air_that_do_not_meet_are_not_covered() {
        let light = Spectrum::<Irradiance>::constant(1.0, 300.0, 400.0).unwrap();
        let air = Spectrum::<Transmission>::constant(1.0, 500.0, 600.0).unwrap();
        let found = Product::of(&light).times(&air).integral();
        assert_eq!((found.value, found.uncovered_nm), (0.0, 300.0));
    }

    /// A response that is padded with zeros asks for no light there.
    #[test]
    fn zeros_within_a_response_need_no_light() {
        let filter = Spectrum::<Response>::new(
            vec![300.0, 400.0, 401.0, 499.0, 500.0, 900.0],
            vec![0.0, 0.0, 1.0, 1.0, 0.0, 0.0],
        )
        .unwrap();
        let light = Spectrum::<Irradiance>::constant(2.0, 390.0, 510.0).unwrap();
        let found = Product::of(&light).times(&filter).integral();
        assert!(found.is_covered() && (found.value - 198.0).abs() < 1e-12, "{found:?}");
    }

    /// Truth: the direct integral of the product with one factor more, on grids that share no point, with a factor that is zero beyond its
    /// table and one that is held; and by hand, the moments of 1 on the knots 0, 1, 3 from 1e-9 on: half the width on each side. Tolerance:
    /// rounding, both rules being exact.
    #[test]
    fn hat_moments_are_exact_for_any_factor_that_is_linear_between_the_knots() {
        let light =
            Spectrum::<Irradiance>::new(vec![350.0, 452.3, 610.7, 900.0], vec![1.0, 3.0, 2.0, 0.5]);
        let paint = Spectrum::<Reflectance>::new(vec![401.0, 555.0, 803.0], vec![0.2, 0.9, 0.4]);
        let filter =
            Spectrum::<Response>::new(vec![390.0, 480.0, 700.5, 820.0], vec![0.0, 0.8, 0.6, 0.0]);
        let (light, paint, filter) = (light.unwrap(), paint.unwrap(), filter.unwrap());
        let product =
            Product::of(&light).times(&paint).times(&filter).times_wavelength().times_number(3.0);
        let knots: Vec<f64> = (0..120).map(|i| 310.0 + 5.7 * f64::from(i)).collect();
        let moments = product.hat_moments(&knots).unwrap();
        for seed in 1..20_u32 {
            let scatter = |i: u32| (i + 1).wrapping_mul(2_654_435_761).wrapping_mul(seed) >> 16;
            let air: Vec<f64> = (0..120).map(|i| f64::from(scatter(i)) / 65_536.0).collect();
            let dot: f64 = air.iter().zip(&moments).map(|(t, b)| t * b).sum();
            let air = Spectrum::<Transmission>::new(knots.clone(), air).unwrap();
            near(dot, product.clone().times(&air).integral().value, 1e-12);
        }
        let one = Spectrum::<Irradiance>::constant(1.0, 0.5, 4.0).unwrap();
        let moments = Product::of(&one).hat_moments(&[1.0, 2.0, 4.0]).unwrap();
        for (found, expected) in moments.iter().zip([0.5, 1.5, 1.0]) {
            near(*found, expected, 1e-14);
        }
        assert!(product.hat_moments(&[500.0, 400.0]).is_err());
    }

    /// Truth: the same hat on a table of its own three points, by hand beside it ∫ h dλ = 100 under 2 W m⁻² nm⁻¹, moments and bins alike: zeros about it
    /// change nothing, whatever the knots. Tolerance: rounding. A product that is 0 everywhere has no moments.
    #[test]
    fn zeros_about_a_narrow_factor_change_nothing() {
        let light = Spectrum::<Irradiance>::constant(2.0, 300.0, 900.0).unwrap();
        let hat = |nm: &[f64], value: &[f64]| {
            Spectrum::<crate::spectrum::Factor>::new(nm.to_vec(), value.to_vec()).unwrap()
        };
        let alone = hat(&[480.0, 500.0, 580.0], &[0.0, 1.0, 0.0]);
        let among: Vec<f64> = vec![310.0, 400.0, 480.0, 500.0, 580.0, 700.0, 880.0];
        let padded = hat(&among, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let knots: Vec<f64> = (0..300).map(|i| 290.0 + 2.3 * f64::from(i)).collect();
        let [a, b] = [&alone, &padded].map(|h| Product::of(&light).times(h));
        near(b.integral().value, 100.0, 1e-13);
        let bins = b.bins(&[300.0, 480.0, 500.0, 600.0, 900.0]).unwrap();
        let expected = [0.0, 20.0, 80.0, 0.0];
        bins.iter().zip(expected).for_each(|(bin, e)| assert!((bin.value - e).abs() < 1e-12));
        let moments = [&a, &b].map(|p| p.hat_moments(&knots).unwrap());
        for (k, (x, y)) in moments[0].iter().zip(&moments[1]).enumerate() {
            assert!((x - y).abs() < 1e-12, "{k}: {x} {y}");
        }
        near(moments[1].iter().sum(), 100.0, 1e-12);
        let dark = hat(&among, &[0.0; 7]);
        let moments = Product::of(&light).times(&dark).hat_moments(&knots).unwrap();
        assert!(moments.iter().all(|m| *m == 0.0));
    }

    #[test]
    fn edges_that_do_not_increase_are_refused() {
        let light = Spectrum::<Irradiance>::constant(2.0, 390.0, 510.0).unwrap();
        for edges in [[600.0, 400.0], [400.0, 400.0], [400.0, f64::NAN], [f64::NEG_INFINITY, 0.0]] {
            assert!(
                matches!(
                    Product::of(&light).bins(&edges),
                    Err(SpectrumError::Edges { edge: 2, .. })
                ),
                "{edges:?}"
            );
        }
        assert_eq!(
            light.bin_means(&[400.0, 410.0, 420.0, 410.0]).unwrap_err().to_string(),
            "edges of bins must increase: 410 nm follows 420 nm at edge 4"
        );
        assert!(Product::of(&light).bins(&[]).unwrap().is_empty());
    }
}
