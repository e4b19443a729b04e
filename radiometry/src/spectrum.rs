//! Spectra: values on a wavelength grid, piecewise linear between.
//!
//! A [`Spectrum`] knows by its type what it holds and in which unit ([`Irradiance`] in W m⁻² nm⁻¹, [`Response`] and
//! [`Transmission`] as fractions …), and so what it is beyond its table: a response is zero there, a reflectance is
//! held, and light or air that nobody tabulated is *missing*: the integrals of [`crate::quadrature`] then say how much of
//! their range was not covered. Wavelengths are vacuum nm throughout.

use std::marker::PhantomData;
use sunglint_formats::{Table, TableError};

/// Value of a tabulated quantity beyond the ends of its table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// Zero, and known to be: a detector's or filter's response.
    Zero,
    /// The value at the table's end, and said so: a reflectance.
    Held,
    /// Not known: counted as zero, and said so: light, air.
    Missing,
}

/// Quantity of a spectrum: its unit, and its value beyond the table.
pub trait Quantity: std::fmt::Debug + Clone + Copy + PartialEq {
    /// The quantity in words.
    const NAME: &'static str;
    /// The unit as astropy spells it; empty for a pure number.
    const UNIT: &'static str;
    /// Value beyond the table.
    const OUTSIDE: Outside;
    /// The smallest and largest value that makes sense.
    const RANGE: (f64, f64) = (0.0, f64::INFINITY);
}

macro_rules! quantities {
    ($($(#[$doc:meta])* $name:ident $words:literal $unit:literal $outside:ident $lo:expr, $hi:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub enum $name {}
        impl Quantity for $name {
            const NAME: &'static str = $words;
            const UNIT: &'static str = $unit;
            const OUTSIDE: Outside = Outside::$outside;
            const RANGE: (f64, f64) = ($lo, $hi);
        }
    )*};
}

quantities! {
    /// Spectral irradiance, W m⁻² nm⁻¹.
    Irradiance "spectral irradiance" "W / (m2 nm)" Missing 0.0, f64::INFINITY;
    /// Spectral radiant intensity, W sr⁻¹ nm⁻¹.
    Intensity "spectral radiant intensity" "W / (sr nm)" Missing 0.0, f64::INFINITY;
    /// Relative spectral flux of a library spectrum, per nm, in no absolute unit.
    Relative "relative spectral flux" "" Missing 0.0, f64::INFINITY;
    /// Response of a filter, an optical train or a detector: a fraction, or counts per photon.
    Response "response" "" Zero 0.0, f64::INFINITY;
    /// Transmission of the air.
    Transmission "transmission" "" Missing 0.0, 1.0;
    /// Reflectance of a surface.
    Reflectance "reflectance" "" Held 0.0, f64::INFINITY;
    /// A factor of any sign: products of reflectances, functions that others are interpolated between.
    Factor "factor" "" Held f64::NEG_INFINITY, f64::INFINITY;
}

/// A quantity on a strictly increasing grid of vacuum wavelengths in nm, linear between.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum<Q> {
    wavelength_nm: Vec<f64>,
    value: Vec<f64>,
    quantity: PhantomData<Q>,
}

/// Why numbers do not make a spectrum.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// Numbers of wavelengths and values that differ, or are below two.
    #[error(
        "a spectrum needs as many values as wavelengths and at least 2, found {wavelengths} wavelengths and {values} values"
    )]
    Lengths {
        /// Number of wavelengths.
        wavelengths: usize,
        /// Number of values.
        values: usize,
    },
    /// Wavelengths must increase.
    #[error("wavelengths must increase: {next_nm} nm follows {previous_nm} nm at row {row}")]
    NotIncreasing {
        /// Row of the second, counted from 1.
        row: usize,
        /// The wavelength before.
        previous_nm: f64,
        /// The wavelength that does not increase.
        next_nm: f64,
    },
    /// A wavelength or value that is no number, or makes no sense.
    #[error("{name} at row {row} is {value}, expected a number from {least} to {most}")]
    Value {
        /// Name of the number: a wavelength or a value.
        name: &'static str,
        /// Row, counted from 1.
        row: usize,
        /// The value.
        value: f64,
        /// The smallest that makes sense.
        least: f64,
        /// The largest that makes sense.
        most: f64,
    },
    /// The table lacks what the spectrum needs.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Edges of bins must increase.
    #[error("edges of bins must increase: {next_nm} nm follows {previous_nm} nm at edge {edge}")]
    Edges {
        /// The second of the two, counted from 1.
        edge: usize,
        /// The edge before.
        previous_nm: f64,
        /// The edge that does not increase.
        next_nm: f64,
    },
    /// The spectra to be joined have no wavelength in common.
    #[error("the spectra have no wavelengths in common")]
    Disjoint,
}

impl<Q: Quantity> Spectrum<Q> {
    /// A spectrum from wavelengths (vacuum nm, increasing) and as many values.
    pub fn new(wavelength_nm: Vec<f64>, value: Vec<f64>) -> Result<Self, SpectrumError> {
        if wavelength_nm.len() != value.len() || value.len() < 2 {
            return Err(SpectrumError::Lengths {
                wavelengths: wavelength_nm.len(),
                values: value.len(),
            });
        }
        for (i, &nm) in wavelength_nm.iter().enumerate() {
            if !(nm.is_finite() && nm > 0.0) {
                return Err(SpectrumError::Value {
                    name: "wavelength (nm)",
                    row: i + 1,
                    value: nm,
                    least: 0.0,
                    most: f64::INFINITY,
                });
            }
            if i > 0 && nm <= wavelength_nm[i - 1] {
                return Err(SpectrumError::NotIncreasing {
                    row: i + 1,
                    previous_nm: wavelength_nm[i - 1],
                    next_nm: nm,
                });
            }
        }
        let (least, most) = Q::RANGE;
        if let Some(i) = value.iter().position(|v| !(v.is_finite() && *v >= least && *v <= most)) {
            return Err(SpectrumError::Value {
                name: Q::NAME,
                row: i + 1,
                value: value[i],
                least,
                most,
            });
        }
        Ok(Self { wavelength_nm, value, quantity: PhantomData })
    }

    /// A spectrum from two columns of a table. A column that names a unit must name the quantity's (nm for wavelengths).
    pub fn from_table(table: &Table, wavelength: &str, value: &str) -> Result<Self, SpectrumError> {
        let (nm, value) = (table.quantity(wavelength, "nm")?, table.quantity(value, Q::UNIT)?);
        Self::new(nm.into_owned(), value.into_owned())
    }

    /// The same value from `from_nm` to `to_nm`.
    pub fn constant(value: f64, from_nm: f64, to_nm: f64) -> Result<Self, SpectrumError> {
        Self::new(vec![from_nm, to_nm], vec![value, value])
    }

    /// The wavelengths, nm.
    pub fn wavelength_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    /// The values, in the unit of the quantity.
    pub fn value(&self) -> &[f64] {
        &self.value
    }

    /// First and last wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.wavelength_nm[0], self.wavelength_nm[self.wavelength_nm.len() - 1])
    }

    /// The value at a wavelength; beyond the table what [`Quantity::OUTSIDE`] says.
    pub fn at(&self, nm: f64) -> f64 {
        let x = &self.wavelength_nm;
        let (first, last) = self.range_nm();
        if nm < first || nm > last {
            return match Q::OUTSIDE {
                Outside::Zero | Outside::Missing => 0.0,
                Outside::Held if nm < first => self.value[0],
                Outside::Held => self.value[x.len() - 1],
            };
        }
        let i = x.partition_point(|&v| v <= nm).clamp(1, x.len() - 1);
        lerp(x[i - 1], self.value[i - 1], x[i], self.value[i], nm)
    }

    /// The same spectrum times a number; fails where a value leaves what makes sense (not negative, finite).
    pub fn scaled(&self, factor: f64) -> Result<Self, SpectrumError> {
        Self::new(self.wavelength_nm.clone(), self.value.iter().map(|v| v * factor).collect())
    }

    /// The same numbers as another quantity: the caller knows what the scale means.
    pub fn relabelled<R: Quantity>(&self) -> Result<Spectrum<R>, SpectrumError> {
        Spectrum::new(self.wavelength_nm.clone(), self.value.clone())
    }

    /// Returns the part of the spectrum that an air leaves, on the union of both grids within the range where both are tabulated: for tables and plots. Linear between
    /// its points, the product is not: integrals are taken of the factors ([`crate::quadrature::Product`]), never of this.
    pub fn through(&self, air: &Spectrum<Transmission>) -> Result<Self, SpectrumError> {
        let (a, b) = (self.range_nm(), air.range_nm());
        let (first, last) = (a.0.max(b.0), a.1.min(b.1));
        let mut grid: Vec<f64> = self
            .wavelength_nm
            .iter()
            .chain(&air.wavelength_nm)
            .copied()
            .filter(|nm| (first..=last).contains(nm))
            .collect();
        grid.sort_by(f64::total_cmp);
        grid.dedup();
        if grid.len() < 2 {
            return Err(SpectrumError::Disjoint);
        }
        let value = grid.iter().map(|&nm| self.at(nm) * air.at(nm)).collect();
        Self::new(grid, value)
    }
}

/// The line through two points, at `x`. Exact at both ends.
pub(crate) fn lerp(x0: f64, y0: f64, x1: f64, y1: f64, x: f64) -> f64 {
    let t = (x - x0) / (x1 - x0);
    y0 * (1.0 - t) + y1 * t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beyond_the_table_each_quantity_keeps_its_own_rule() {
        let response = Spectrum::<Response>::new(vec![400.0, 500.0], vec![0.5, 1.0]).unwrap();
        let paint = Spectrum::<Reflectance>::new(vec![400.0, 500.0], vec![0.5, 1.0]).unwrap();
        assert_eq!((response.at(399.9), response.at(450.0), response.at(501.0)), (0.0, 0.75, 0.0));
        assert_eq!((paint.at(399.9), paint.at(450.0), paint.at(501.0)), (0.5, 0.75, 1.0));
        assert_eq!((response.at(400.0), response.at(500.0)), (0.5, 1.0));
    }

    #[test]
    fn numbers_that_make_no_spectrum_are_refused_with_the_row() {
        let new = Spectrum::<Transmission>::new;
        assert_eq!(
            new(vec![1.0, 3.0, 2.0], vec![0.0; 3]).unwrap_err().to_string(),
            "wavelengths must increase: 2 nm follows 3 nm at row 3"
        );
        assert_eq!(
            new(vec![1.0, 2.0], vec![0.5, f64::NAN]).unwrap_err().to_string(),
            "transmission at row 2 is NaN, expected a number from 0 to 1"
        );
        assert!(matches!(new(vec![1.0, 2.0], vec![0.5, 1.5]), Err(SpectrumError::Value { .. })));
        assert!(matches!(new(vec![1.0], vec![0.5]), Err(SpectrumError::Lengths { .. })));
        assert!(matches!(new(vec![0.0, 1.0], vec![0.5, 0.5]), Err(SpectrumError::Value { .. })));
    }
}
