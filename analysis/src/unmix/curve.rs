//! Whole curves: sample by sample, each with the bands that it has.

use super::nnls::Constraint;
use super::{Bands, Mixing, MixingError, Mixture, Noise};
use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use sunglint_radiometry::air::{AirError, Zenith};

bitflags::bitflags! {
    /// State of an unmixed sample.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct State: u32 {
        /// No band has a valid value.
        const NO_DATA = 1 << 0;
        /// No band has light above 0: all weights are 0, and there are no shares.
        const NO_LIGHT = 1 << 1;
        /// Other weights fit as well: none are given. The bands that are left are too few.
        const NOT_UNIQUE = 1 << 2;
        /// In the bands that are left an endmember is black, or two are alike: no weights are given.
        const ALIKE = 1 << 3;
        /// A band has no uncertainty above 0: all count alike.
        const UNWEIGHTED = 1 << 4;
        /// Some bands were left out.
        const FEWER_BANDS = 1 << 5;
        /// The bound holds at least one weight at 0.
        const BOUNDED = 1 << 6;
        /// Below the horizon of the air.
        const BELOW_HORIZON = 1 << 7;
    }
}

/// Under what light a sample was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Zenith angle of the target; it does not count without air.
    pub zenith: Zenith,
    /// Distance of the observer, m; 1 where values are intensities, or where it is not known and weights may be relative.
    pub range_m: f64,
    /// The visible part of the Sun over the square of its distance in au.
    pub sunlight: f64,
}

/// A curve's values.
#[derive(Debug, Clone, Copy)]
pub struct Values<'a> {
    /// Samples × bands: Hz, W m⁻² nm⁻¹ or W sr⁻¹ nm⁻¹, as the bands have them.
    pub value: ArrayView2<'a, f64>,
    /// Their standard uncertainties, same shape.
    pub sigma: Option<ArrayView2<'a, f64>>,
    /// True for those that count, same shape.
    pub valid: ArrayView2<'a, bool>,
}

/// An unmixed sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Unmixed {
    /// Reflection factor of each band, m² sr⁻¹ (sr⁻¹ where ranges are 1); NaN where there is no valid value.
    pub factors: Vec<f64>,
    /// Their standard uncertainties; NaN where there is none.
    pub factor_sigma: Vec<f64>,
    /// Number of the bands that were used.
    pub bands: usize,
    /// Mixture of the sample; `None` where `state` says why.
    pub mixture: Option<Mixture>,
    /// Condition number of its matrix.
    pub condition: f64,
    /// State of the sample.
    pub state: State,
}

/// Why a curve cannot be unmixed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UnmixError {
    /// Tables that do not match.
    #[error("{what}: {rows} x {columns}, expected {samples} samples x {bands} bands")]
    Shape {
        /// Which.
        what: &'static str,
        /// Rows.
        rows: usize,
        /// Columns.
        columns: usize,
        /// Samples.
        samples: usize,
        /// Bands.
        bands: usize,
    },
    /// Light that cannot be.
    #[error("sample {}: a range of {range_m} m under {sunlight} Suns, expected numbers above 0", sample + 1)]
    Light {
        /// Which, from 0.
        sample: usize,
        /// Range, m.
        range_m: f64,
        /// Sunlight.
        sunlight: f64,
    },
    /// The air.
    #[error("sample {}: {source}", sample + 1)]
    Air {
        /// Which, from 0.
        sample: usize,
        /// Error of the air model.
        source: AirError,
    },
    /// A sample's fit.
    #[error("sample {}: {source}", sample + 1)]
    Sample {
        /// Which, from 0.
        sample: usize,
        /// Error of the unmixing.
        source: MixingError,
    },
}

/// Unmixes a curve: each sample under its own light and air, from its valid bands, weighted by their uncertainties. A sum is one of weights.
///
/// # Errors
/// Tables that do not match; a light that cannot be; a fit that does not come to rest. Samples that cannot be unmixed are no errors: their [`State`] says why.
pub fn unmix(
    bands: &Bands,
    lights: &[Light],
    values: Values<'_>,
    constraint: Constraint,
) -> Result<Vec<Unmixed>, UnmixError> {
    let (samples, count) = (lights.len(), bands.names.len());
    let shapes = [
        ("values", Some(values.value.dim())),
        ("uncertainties", values.sigma.map(|s| s.dim())),
        ("validity", Some(values.valid.dim())),
    ];
    for (what, shape) in shapes {
        if let Some((rows, columns)) = shape.filter(|s| *s != (samples, count)) {
            return Err(UnmixError::Shape { what, rows, columns, samples, bands: count });
        }
    }
    let all: Vec<Result<Unmixed, UnmixError>> = (0..samples)
        .into_par_iter()
        .map(|sample| one(bands, lights[sample], values, constraint, sample))
        .collect();
    // The first error by its sample, whatever the threads.
    all.into_iter().collect()
}

fn one(
    bands: &Bands,
    light: Light,
    values: Values<'_>,
    constraint: Constraint,
    sample: usize,
) -> Result<Unmixed, UnmixError> {
    let count = bands.names.len();
    let Light { zenith, range_m, sunlight } = light;
    let mut out = Unmixed {
        factors: vec![f64::NAN; count],
        factor_sigma: vec![f64::NAN; count],
        bands: 0,
        mixture: None,
        condition: f64::NAN,
        state: State::empty(),
    };
    let valid = |b: usize| values.valid[(sample, b)] && values.value[(sample, b)].is_finite();
    let used: Vec<usize> = (0..count).filter(|b| valid(*b)).collect();
    out.bands = used.len();
    out.state.set(State::FEWER_BANDS, used.len() < count);
    if used.is_empty() {
        out.state |= State::NO_DATA;
        return Ok(out);
    }
    if !(range_m > 0.0 && range_m.is_finite() && sunlight > 0.0 && sunlight.is_finite()) {
        return Err(UnmixError::Light { sample, range_m, sunlight });
    }
    let factors = match bands.at(zenith) {
        Ok(factors) => factors,
        Err(AirError::BelowHorizon { .. }) => {
            out.state |= State::BELOW_HORIZON;
            return Ok(out);
        }
        Err(source) => return Err(UnmixError::Air { sample, source }),
    };
    for b in &used {
        let per = range_m * range_m / (sunlight * factors.unit[*b]);
        out.factors[*b] = values.value[(sample, *b)] * per;
        if let Some(sigma) = values.sigma {
            out.factor_sigma[*b] = sigma[(sample, *b)] * per;
        }
    }
    let x: Vec<f64> = used.iter().map(|b| out.factors[*b]).collect();
    let sigma: Vec<f64> = used.iter().map(|b| out.factor_sigma[*b]).collect();
    let matrix = Array2::from_shape_fn((used.len(), bands.endmembers.len()), |(i, j)| {
        factors.matrix[(used[i], j)]
    });
    let weighted = sigma.iter().all(|s| s.is_finite() && *s > 0.0);
    out.state.set(State::UNWEIGHTED, !weighted);
    out.state.set(State::NO_LIGHT, x.iter().all(|x| *x <= 0.0));
    let mixing = match Mixing::new(matrix, &bands.endmembers) {
        Ok(mixing) => mixing,
        Err(MixingError::Same { .. } | MixingError::Black { .. }) => {
            out.state |= State::ALIKE;
            return Ok(out);
        }
        Err(source) => return Err(UnmixError::Sample { sample, source }),
    };
    out.condition = mixing.condition;
    let noise = if weighted { Noise::Independent(&sigma) } else { Noise::Unknown };
    let mixture = mixing
        .solve(&x, noise, constraint)
        .map_err(|source| UnmixError::Sample { sample, source })?;
    if !mixture.unique && !out.state.contains(State::NO_LIGHT) {
        out.state |= State::NOT_UNIQUE;
        return Ok(out);
    }
    out.state.set(State::BOUNDED, mixture.bounded.contains(&true));
    out.mixture = Some(mixture);
    Ok(out)
}
