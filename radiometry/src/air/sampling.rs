//! At which wavelengths the answer is wanted.

use super::AirError;
use super::spectra::{FIRST_CM1, LAST_CM1, NATIVE, STEP_CM1};
use crate::quadrature::{Integral, Product};
use crate::spectrum::{Spectrum, Transmission};
use rayon::prelude::*;

/// Wavelengths at which, or bins over which, transmissions are wanted.
///
/// The band model gives a value every 5 cm⁻¹ ("native" points); between them the transmission is linear in wavelength, as
/// in the reference. A point is a value of that curve, a bin its mean: exact, whatever lies inside.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampling {
    /// The native points that are needed, ascending in wavenumber.
    pub(crate) native: Vec<usize>,
    /// Where each sample's weights start in `weights`, and one past the end.
    start: Vec<usize>,
    /// The position in `native` of each sample's first weight.
    first: Vec<usize>,
    weights: Vec<f64>,
    centre_nm: Vec<f64>,
}

/// Where the transmission is taken of what has no light at all, nm.
const UNLIT_NM: f64 = 550.0;

fn native_nm(index: usize) -> f64 {
    1e7 / (FIRST_CM1 + STEP_CM1 * index as f64)
}

/// Shortest and longest wavelength \[nm\].
pub(crate) fn range_nm() -> (f64, f64) {
    (1e7 / LAST_CM1, 1e7 / FIRST_CM1)
}

fn check(wavelength_nm: f64) -> Result<f64, AirError> {
    let (lowest_nm, highest_nm) = range_nm();
    if wavelength_nm >= lowest_nm && wavelength_nm <= highest_nm {
        Ok(wavelength_nm)
    } else {
        Err(AirError::Wavelength { wavelength_nm, lowest_nm, highest_nm })
    }
}

/// The native interval that holds a wavelength: between `index` (longer) and `index + 1` (shorter).
fn interval(wavelength_nm: f64) -> usize {
    let index = ((1e7 / wavelength_nm - FIRST_CM1) / STEP_CM1).floor();
    (index.max(0.0) as usize).min(NATIVE - 2)
}

impl Sampling {
    /// Values at vacuum wavelengths \[nm\], in any order; the answers come in the same order.
    ///
    /// # Errors
    /// A wavelength outside the tables (or `NaN`); none at all.
    pub fn points(wavelength_nm: &[f64]) -> Result<Self, AirError> {
        let rows = wavelength_nm.iter().map(|&nm| {
            let i = interval(check(nm)?);
            let (long, short) = (native_nm(i), native_nm(i + 1));
            let f = ((long - nm) / (long - short)).clamp(0.0, 1.0);
            Ok((nm, i, vec![1.0 - f, f]))
        });
        Self::from_rows(rows)
    }

    /// The native points from `from_nm` to `to_nm` and both ends, ascending in wavelength; ends beyond the tables are drawn in to
    /// them. On these points the piecewise-linear curve is the model itself, nothing lost.
    ///
    /// # Errors
    /// A range that is empty or wholly outside the tables.
    pub fn native(from_nm: f64, to_nm: f64) -> Result<Self, AirError> {
        let (lowest_nm, highest_nm) = range_nm();
        let (from, to) = (from_nm.max(lowest_nm), to_nm.min(highest_nm));
        if from.is_nan() || to.is_nan() || from >= to {
            return Err(AirError::Wavelength { wavelength_nm: from_nm, lowest_nm, highest_nm });
        }
        let between = (0..NATIVE).rev().map(native_nm).filter(|nm| (from < *nm) && (*nm < to));
        let grid: Vec<f64> = std::iter::once(from).chain(between).chain([to]).collect();
        Self::points(&grid)
    }

    /// Means over `centre_nm` ± `half_width_nm` (vacuum), in any order.
    ///
    /// # Errors
    /// A bin that reaches outside the tables or has no width; none at all.
    pub fn means(centre_nm: &[f64], half_width_nm: f64) -> Result<Self, AirError> {
        Self::from_rows(centre_nm.iter().map(|&nm| mean(nm - half_width_nm, nm + half_width_nm)))
    }

    /// Means over the bins between ascending edges \[nm, vacuum\]: one bin less than edges.
    ///
    /// # Errors
    /// Edges outside the tables or not ascending; fewer than two.
    pub fn bins(edges_nm: &[f64]) -> Result<Self, AirError> {
        Self::from_rows(edges_nm.windows(2).map(|e| mean(e[0], e[1])))
    }

    /// Means weighted with products of spectra: sample j is ∫ T p_j dλ / ∫ p_j dλ over the tables of the air, exact for
    /// piecewise-linear factors, and the second answer is that ∫ p_j dλ, so that their product is ∫ T p_j dλ: the rate of a channel,
    /// by a few multiplications for any zenith angle ([`super::AirTable`]). `uncovered_nm` counts what the products lack within
    /// their own range ([`Product::integral`]), wavelengths beyond the air's tables included. A product that is zero
    /// everywhere has the transmission at 550 nm, times 0.
    ///
    /// # Errors
    /// No product at all.
    pub fn weighted(products: &[Product]) -> Result<(Self, Vec<Integral>), AirError> {
        let air = Spectrum::<Transmission>::constant(1.0, range_nm().0, range_nm().1)?;
        let knots: Vec<f64> = (0..NATIVE).rev().map(native_nm).collect();
        let one = |product: &Product| {
            let uncovered_nm = product.clone().times(&air).uncovered_nm();
            // Ascending in wavenumber, as the native points are.
            let (before, mut moments) = product.moments(&knots);
            moments.reverse();
            let after = NATIVE - before - moments.len();
            let value: f64 = moments.iter().sum();
            (Integral { value, uncovered_nm }, Ok(row_of_moments(after, &moments, value)))
        };
        let each: Vec<_> = products.par_iter().map(one).collect();
        let (integrals, rows): (Vec<Integral>, Vec<_>) = each.into_iter().unzip();
        Ok((Self::from_rows(rows.into_iter())?, integrals))
    }

    /// The wavelengths, or the bins' centres \[nm\], in the order in which they were given.
    pub fn wavelength_nm(&self) -> &[f64] {
        &self.centre_nm
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.centre_nm.len()
    }

    /// Whether there is no sample (there always is one).
    pub fn is_empty(&self) -> bool {
        self.centre_nm.is_empty()
    }

    fn from_rows(
        rows: impl Iterator<Item = Result<(f64, usize, Vec<f64>), AirError>>,
    ) -> Result<Self, AirError> {
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        if rows.is_empty() {
            return Err(AirError::NoWavelength);
        }
        let mut needed = vec![false; NATIVE];
        for (_, first, weights) in &rows {
            needed[*first..first + weights.len()].fill(true);
        }
        let native: Vec<usize> = (0..NATIVE).filter(|&i| needed[i]).collect();
        let mut sampling = Self {
            start: vec![0],
            first: Vec::with_capacity(rows.len()),
            weights: Vec::new(),
            centre_nm: Vec::with_capacity(rows.len()),
            native,
        };
        for (centre, first, weights) in rows {
            // A sample's points are neighbours on the native grid, so they are neighbours here too.
            sampling.first.push(sampling.native.partition_point(|&i| i < first));
            sampling.weights.extend(weights);
            sampling.start.push(sampling.weights.len());
            sampling.centre_nm.push(centre);
        }
        Ok(sampling)
    }

    /// The samples of a curve that is given at the native points `self.native`.
    pub(crate) fn apply(&self, native_values: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            let weights = &self.weights[self.start[j]..self.start[j + 1]];
            let values = &native_values[self.first[j]..self.first[j] + weights.len()];
            *out = weights.iter().zip(values).map(|(w, v)| w * v).sum();
        }
    }

    /// −ln of sample `j` of the curve e^−l, also where e^−l would underflow.
    pub(crate) fn depth(&self, j: usize, native_depths: &[f64]) -> f64 {
        let weights = &self.weights[self.start[j]..self.start[j + 1]];
        let depths = &native_depths[self.first[j]..self.first[j] + weights.len()];
        let least = weights
            .iter()
            .zip(depths)
            .filter(|(w, _)| **w > 0.0)
            .fold(f64::INFINITY, |least, (_, l)| least.min(*l));
        let sum: f64 = weights.iter().zip(depths).map(|(w, l)| w * (least - l).exp()).sum();
        least - sum.ln()
    }
}

/// Centre, first native point and weights of a mean from the moments of native points, of which so many come before these, and their sum.
fn row_of_moments(before: usize, moments: &[f64], sum: f64) -> (f64, usize, Vec<f64>) {
    let lit = |m: &f64| *m > 0.0;
    let (Some(first), Some(last), true) =
        (moments.iter().position(lit), moments.iter().rposition(lit), sum > 0.0)
    else {
        // Whatever it is, it is taken times 0: one point costs nothing, where all of them would cost the most.
        let any = interval(UNLIT_NM);
        return (native_nm(any), any, vec![1.0]);
    };
    let weights: Vec<f64> = moments[first..=last].iter().map(|m| m / sum).collect();
    let first = before + first;
    let centre = weights.iter().enumerate().map(|(i, w)| w * native_nm(first + i)).sum();
    (centre, first, weights)
}

/// The weights of the mean over one bin: the exact integral of the piecewise-linear curve.
fn mean(from_nm: f64, to_nm: f64) -> Result<(f64, usize, Vec<f64>), AirError> {
    check(from_nm)?;
    check(to_nm)?;
    if from_nm >= to_nm {
        return Err(AirError::Bin { from_nm, to_nm });
    }
    let (first, last) = (interval(to_nm), interval(from_nm));
    let mut weights = vec![0.0; last - first + 2];
    for i in first..=last {
        let (long, short) = (native_nm(i), native_nm(i + 1));
        let (a, b) = (from_nm.max(short), to_nm.min(long));
        if b > a {
            // The mean of the line over a…b is its value in the middle.
            let f = (long - 0.5 * (a + b)) / (long - short);
            let share = (b - a) / (to_nm - from_nm);
            weights[i - first] += share * (1.0 - f);
            weights[i - first + 1] += share * f;
        }
    }
    Ok((0.5 * (from_nm + to_nm), first, weights))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the mean of a straight line over a bin is its value at the centre; of a constant, the constant.
    #[test]
    fn a_line_has_its_centre_value_as_mean_and_as_point() {
        let centres = [294.7, 300.0, 687.3, 1239.9, 550.0];
        for sampling in
            [Sampling::means(&centres, 0.5).unwrap(), Sampling::points(&centres).unwrap()]
        {
            let line: Vec<f64> =
                sampling.native.iter().map(|&i| 3.0 * native_nm(i) - 7.0).collect();
            let mut out = vec![0.0; centres.len()];
            sampling.apply(&line, &mut out);
            for (nm, value) in centres.iter().zip(&out) {
                assert!((value - (3.0 * nm - 7.0)).abs() < 1e-9, "{nm} nm: {value}");
            }
        }
    }

    /// Truth: the direct integral of the product with the air's own spectrum, over what it is without; a channel that reaches
    /// beyond the tables says how far. Tolerance: rounding.
    #[test]
    fn weighted_means_are_the_integrals_with_the_air() {
        use crate::air::{Air, AirOptions, Profile, Zenith};
        use crate::spectrum::{Irradiance, Response};
        let light = Spectrum::<Irradiance>::new(vec![250.0, 500.0, 2000.0], vec![1.0, 3.0, 0.5]);
        let narrow = Spectrum::<Response>::new(vec![680.0, 687.0, 700.0], vec![0.0, 1.0, 0.2]);
        let wide = Spectrum::<Response>::new(vec![280.0, 600.0, 1300.0], vec![0.5, 1.0, 0.5]);
        let dark = Spectrum::<Response>::new(vec![400.0, 500.0], vec![0.0, 0.0]);
        let (light, narrow, wide, dark) =
            (light.unwrap(), narrow.unwrap(), wide.unwrap(), dark.unwrap());
        let products = [&narrow, &wide, &dark]
            .map(|r| Product::of(&light).times(r).times_wavelength().times_number(1e-3));
        let (sampling, integrals) = Sampling::weighted(&products).unwrap();
        let air = Air::new(&AirOptions::new(Profile::named("us_standard").unwrap())).unwrap();
        for z in [0.0, 70.0, 89.0] {
            let t = air.transmission(Zenith::Apparent(z), &sampling).unwrap();
            let curve = air.spectrum(Zenith::Apparent(z), (200.0, 2000.0)).unwrap();
            for (j, product) in products.iter().enumerate() {
                let truth = product.clone().times(&curve).integral();
                let found = t[j] * integrals[j].value;
                assert!(
                    (found - truth.value).abs() <= 1e-12 * truth.value,
                    "{z}: {found} {truth:?}"
                );
                assert!((integrals[j].uncovered_nm - truth.uncovered_nm).abs() < 1e-9);
            }
        }
        assert_eq!((integrals[0].uncovered_nm, integrals[2].value), (0.0, 0.0));
        assert!((integrals[1].uncovered_nm - (14.117_647 + 50.0)).abs() < 1e-4);
    }

    #[test]
    fn the_ends_of_the_range_are_inside() {
        let (low, high) = range_nm();
        assert_eq!(Sampling::points(&[high, low]).unwrap().len(), 2);
        assert!(Sampling::bins(&[low, 700.0, high]).is_ok());
        for bad in [294.0, 1250.1, f64::NAN] {
            assert!(matches!(Sampling::points(&[bad]), Err(AirError::Wavelength { .. })));
        }
        assert!(matches!(Sampling::bins(&[500.0, 400.0]), Err(AirError::Bin { .. })));
        assert!(matches!(Sampling::points(&[]), Err(AirError::NoWavelength)));
        assert!(matches!(Sampling::bins(&[500.0]), Err(AirError::NoWavelength)));
    }
}
