//! The fit's sum of squares: what is linear is solved in closed form wherever the rest stands (variable projection: Golub and Pereyra 1973).

use super::common::Common;
use super::whiten::{PerSample, Whitener};
use super::{Data, FitError};
use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, Array3};
use sunglint_numerics::basis::Basis;
use sunglint_numerics::bounded::{BoundedSystem, Region};

/// A column of which less than this stands upright on the others is their combination.
const PARALLEL: f64 = 1e-10;

/// Prediction of a model for one curve: rate = `fixed` + Σ_k coefficient_k `columns`_k. A component without a linear parameter has the coefficient 1.
#[derive(Debug, Clone)]
pub struct Columns {
    /// Rates that nothing linear changes, epochs × channels, in the unit of the data.
    pub fixed: Array2<f64>,
    /// Rates of each component, epochs × channels × components.
    pub columns: Array3<f64>,
}

/// Why a model has no rates, in words.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct ModelError(pub String);

/// A model that is fitted: it gives curves for values of the parameters that are not linear.
pub trait Model {
    /// One [`Columns`] for each measured curve, at its epochs.
    ///
    /// # Errors
    /// Values for which there is no model.
    fn columns(&mut self, values: &[f64]) -> Result<Vec<Columns>, ModelError>;

    /// Returns the derivative of the logarithm of all rates of each curve, epochs × channels, by a parameter that does nothing but multiply them; `None` for any other.
    fn log_derivative(&self, _values: &[f64], _parameter: usize) -> Option<Vec<Array2<f64>>> {
        None
    }
}

/// A parameter that is not linear.
#[derive(Debug, Clone, PartialEq)]
pub struct Free {
    /// Name of the parameter, with its unit.
    pub name: String,
    /// Where the search starts.
    pub start: f64,
    /// Least value of the parameter.
    pub low: f64,
    /// Largest value of the parameter.
    pub high: f64,
    /// The step of differences.
    pub step: f64,
    /// Whether `low` and `high` are the same state, as of an angle over a full turn.
    pub wraps: bool,
    /// Knowledge of the parameter from elsewhere, beside its bounds.
    pub prior: Option<Prior>,
    /// Where it is searched for.
    pub search: Search,
}

/// Where a parameter that is not linear is searched for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Search {
    /// Over the whole box.
    #[default]
    Everywhere,
    /// Near its start: a small correction, which is found wherever the rest stands.
    Near,
    /// Nowhere: it keeps its start. For a fit from which another begins ([`super::Purpose::Start`]).
    Nowhere,
}

/// Normal distribution of a parameter that is known from elsewhere: it counts as one more sample.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Prior {
    /// Mean, in the parameter's unit.
    pub mean: f64,
    /// Standard deviation, above 0.
    pub sigma: f64,
}

impl Prior {
    fn check(self, name: &str) -> Result<(), FitError> {
        if self.mean.is_finite() && self.sigma.is_finite() && self.sigma > 0.0 {
            return Ok(());
        }
        let found = format!("{} ± {}, expected finite numbers, σ above 0", self.mean, self.sigma);
        Err(FitError::Input { what: format!("the prior of {name}"), found })
    }
}

impl Free {
    /// A parameter between bounds, with steps of a 10,000th of their distance.
    pub fn new(name: impl Into<String>, start: f64, low: f64, high: f64) -> Self {
        let step = 1e-4 * (high - low);
        Self {
            name: name.into(),
            start,
            low,
            high,
            step,
            wraps: false,
            prior: None,
            search: Search::Everywhere,
        }
    }
}

/// A parameter that rates are proportional to: the coefficient of a component, not below 0. Where the data do not say how large it is, it keeps the value for which the coefficient is 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Linear {
    /// Name of the parameter.
    pub name: String,
    /// Which component.
    pub component: usize,
    /// In which channels.
    pub channels: Vec<usize>,
    /// In which curves; all where `None`.
    pub curves: Option<Vec<usize>>,
    /// The parameter's value for a coefficient of 1: the band albedo that the model was computed with.
    pub unit: f64,
    /// Largest value; none where `None`.
    pub most: Option<f64>,
    /// Knowledge of the parameter from elsewhere, beside its bounds.
    pub prior: Option<Prior>,
}

impl Linear {
    /// Whether its coefficient counts in a channel of a curve, both by number.
    pub fn holds(&self, curve: usize, channel: usize) -> bool {
        self.channels.contains(&channel)
            && self.curves.as_ref().is_none_or(|all| all.contains(&curve))
    }
}

/// Parameter by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    Free(usize),
    Linear(usize),
}

/// Parameter with a prior.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub which: Which,
    pub prior: Prior,
}

/// Everything that a sum of squares needs.
pub(super) struct Problem<'a> {
    pub data: &'a [Data],
    pub free: &'a [Free],
    pub linear: &'a [Linear],
    model: &'a mut dyn Model,
    pub whitener: Whitener,
    /// Errors of the calibration, where they are in the sum of squares: beside priors.
    pub common: Option<Common>,
    /// Factors of the rates that go with the weights of a loss; 1 where there are none.
    pub centres: Option<PerSample>,
    /// The linear parameter of each curve's channel and component.
    owner: Vec<Array2<Option<usize>>>,
    pub evaluations: usize,
    /// Relative gain of χ² below which a descent ends; `None` for what the kind of differences allows.
    pub gain: Option<f64>,
    /// Linear parameters that are kept at the model's own values, since the data do not constrain them.
    pub kept: Vec<bool>,
}

/// The sum of squares at one place.
#[derive(Clone)]
pub(super) struct State {
    /// Coefficients of the linear parameters.
    pub x: DVector<f64>,
    pub residual: DVector<f64>,
    pub chi2: f64,
    /// Whitened columns.
    pub design: DMatrix<f64>,
    /// The model's rates.
    pub rates: PerSample,
}

impl<'a> Problem<'a> {
    pub fn new(
        data: &'a [Data],
        model: &'a mut dyn Model,
        free: &'a [Free],
        linear: &'a [Linear],
    ) -> Result<Self, FitError> {
        let wrong = |what: String, found: String| Err(FitError::Input { what, found });
        let Some(first) = data.first() else {
            return wrong("the measured curves".into(), "none".into());
        };
        for curve in data {
            curve.check()?;
            if curve.channels() != first.channels() {
                let found = format!("{}, expected {}", curve.channels(), first.channels());
                return wrong(format!("channels of {}", curve.name), found);
            }
        }
        for f in free {
            let ordered = f.low < f.high && (f.low..=f.high).contains(&f.start);
            if !(ordered && f.high - f.low < f64::INFINITY && f.step > 0.0) {
                let found = format!("{} within {} to {}, step {}", f.start, f.low, f.high, f.step);
                return wrong(f.name.clone(), found);
            }
            f.prior.map_or(Ok(()), |prior| prior.check(&f.name))?;
        }
        for l in linear {
            l.prior.map_or(Ok(()), |prior| prior.check(&l.name))?;
        }
        let counted: usize = data.iter().map(Data::count).sum();
        if counted == 0 {
            let names: Vec<&str> = data.iter().map(|d| d.name.as_str()).collect();
            return Err(FitError::NothingLeft { curves: names.join(", ") });
        }
        let parameters = free.len() + linear.len();
        if counted <= parameters {
            return Err(FitError::TooFew { samples: counted, parameters });
        }
        let components = linear.iter().map(|l| l.component + 1).max().unwrap_or(0);
        let mut owner = vec![Array2::from_elem((first.channels(), components), None); data.len()];
        for (p, l) in linear.iter().enumerate() {
            for (curve, owned) in owner.iter_mut().enumerate() {
                for c in l.channels.iter().filter(|c| l.holds(curve, **c)) {
                    let place = owned.get_mut((*c, l.component));
                    let Some(place) = place else {
                        return wrong(l.name.clone(), format!("channel {c}"));
                    };
                    if let Some(other) = place.replace(p) {
                        let other = &linear[other].name;
                        return wrong(l.name.clone(), format!("{other} scales the same light"));
                    }
                }
            }
        }
        let whitener = Whitener::new(data, None, None);
        Ok(Self {
            data,
            free,
            linear,
            model,
            whitener,
            common: None,
            centres: None,
            owner,
            evaluations: 0,
            gain: None,
            kept: vec![false; linear.len()],
        })
    }

    /// The model's columns, seen to fit the data.
    pub fn columns(&mut self, values: &[f64]) -> Result<Vec<Columns>, FitError> {
        self.evaluations += 1;
        let columns = self
            .model
            .columns(values)
            .map_err(|source| FitError::Model { at: self.describe(values), source })?;
        let wrong = |what: String, found: String| Err(FitError::Input { what, found });
        if columns.len() != self.data.len() {
            let found = format!("{}, expected {}", columns.len(), self.data.len());
            return wrong("curves of the model".into(), found);
        }
        for ((curve, model), owner) in self.data.iter().zip(&columns).zip(&self.owner) {
            let (n, channels, components) = model.columns.dim();
            let shape = (n, channels);
            if shape != curve.rate.dim() || model.fixed.dim() != shape || components < owner.ncols()
            {
                let found = format!("{:?}, expected {:?}", model.columns.dim(), curve.rate.dim());
                return wrong(format!("the model of {}", curve.name), found);
            }
        }
        Ok(columns)
    }

    /// Factor of a sample's rate that goes with its loss.
    pub fn centre(&self, pass: usize, at: (usize, usize)) -> f64 {
        self.centres.as_ref().map_or(1.0, |all| all[pass][at])
    }

    /// The values by name, for messages.
    pub fn describe(&self, values: &[f64]) -> String {
        let all = self.free.iter().zip(values).map(|(f, v)| format!("{} = {v}", f.name));
        all.collect::<Vec<_>>().join(", ")
    }

    /// The sum of squares at values of what is not linear.
    pub fn evaluate(&mut self, values: &[f64]) -> Result<State, FitError> {
        let columns = self.columns(values)?;
        let count = self.linear.len();
        let mut design = DMatrix::zeros(self.rows(), count);
        let mut right = DVector::zeros(self.rows());
        let mut buffer = Vec::new();
        for epoch in &self.whitener.epochs {
            let (model, owner) = (&columns[epoch.pass], &self.owner[epoch.pass]);
            let components = model.columns.dim().2;
            let m = epoch.channels.len();
            buffer.clear();
            buffer.resize((count + 1) * m, 0.0);
            for (j, c) in epoch.channels.iter().enumerate() {
                let mut fixed = model.fixed[[epoch.epoch, *c]];
                for k in 0..components {
                    let value = model.columns[[epoch.epoch, *c, k]];
                    match owner.get((*c, k)).copied().flatten() {
                        Some(p) => buffer[p * m + j] += value,
                        None => fixed += value,
                    }
                }
                let at = (epoch.epoch, *c);
                let left = self.centre(epoch.pass, at) * self.data[epoch.pass].rate[at] - fixed;
                buffer[count * m + j] = left;
            }
            if let Some(bad) = buffer.iter().find(|v| !v.is_finite()) {
                return Err(FitError::Input {
                    what: format!(
                        "the model of {} at sample {}",
                        self.data[epoch.pass].name,
                        epoch.epoch + 1
                    ),
                    found: format!("{bad}, expected finite rates where a sample counts"),
                });
            }
            for p in 0..=count {
                let part = &mut buffer[p * m..(p + 1) * m];
                if part.iter().all(|v| *v == 0.0) {
                    continue;
                }
                epoch.apply(part);
                for (j, v) in part.iter().enumerate() {
                    if p < count {
                        design[(epoch.row + j, p)] = *v;
                    } else {
                        right[epoch.row + j] = *v;
                    }
                }
            }
        }
        if let Some(common) = &self.common {
            common.apply(&mut right);
            for p in 0..count {
                let mut column = design.column(p).into_owned();
                common.apply(&mut column);
                design.set_column(p, &column);
            }
        }
        for (row, known) in (self.whitener.rows..).zip(self.priors()) {
            let sigma = known.prior.sigma;
            match known.which {
                Which::Free(k) => {
                    right[row] =
                        (known.prior.mean - self.nearest(k, values[k], known.prior.mean)) / sigma
                }
                Which::Linear(p) => {
                    right[row] = known.prior.mean / sigma;
                    design[(row, p)] = self.linear[p].unit / sigma;
                }
            }
        }
        let x = if count == 0 {
            DVector::zeros(0)
        } else {
            let columns = design.column_iter().map(|c| c.iter().copied().collect()).collect();
            let high: Vec<f64> = (0..count).map(|p| self.highest(p)).collect();
            let rest: Vec<f64> = high.iter().map(|h| h.min(1.0)).collect();
            let pick = |kept: &[f64], free: &[f64]| -> Vec<f64> {
                let both = kept.iter().zip(free).zip(&self.kept);
                both.map(|((kept, free), keep)| if *keep { *kept } else { *free }).collect()
            };
            let (low, high) = (pick(&rest, &vec![0.0; count]), pick(&rest, &high));
            let region = Region::Between { low: &low, high: &high, rest: &rest };
            let found = BoundedSystem::new(columns, false)
                .and_then(|system| system.solve(right.as_slice(), &region))
                .map_err(|e| FitError::Search { why: e.to_string() })?;
            DVector::from_vec(found.weights)
        };
        let residual = right - &design * &x;
        let chi2 = residual.norm_squared();
        let rates = self.rates(&columns, x.as_slice());
        Ok(State { x, residual, chi2, design, rates })
    }

    /// Returns the derivative of the whitened rates by a parameter that multiplies them, without evaluations; `None` for any other. Rows of priors are 0.
    pub fn slope(
        &self,
        values: &[f64],
        parameter: usize,
        rates: &PerSample,
    ) -> Option<DVector<f64>> {
        let logarithmic = self.model.log_derivative(values, parameter)?;
        let slopes: PerSample = rates.iter().zip(&logarithmic).map(|(r, l)| r * l).collect();
        Some(self.whitened(&slopes))
    }

    /// Whether a parameter does nothing but multiply rates.
    pub fn multiplies(&self, values: &[f64], parameter: usize) -> bool {
        self.model.log_derivative(values, parameter).is_some()
    }

    /// Returns a basis of the columns of the linear parameters that are free between their bounds at a place.
    pub fn in_use(&self, state: &State) -> Basis {
        let mut basis = Basis::default();
        for (p, column) in state.design.column_iter().enumerate() {
            if !self.kept[p] && state.x[p] > 0.0 && state.x[p] < self.highest(p) {
                let column: Vec<f64> = column.iter().copied().collect();
                basis.push(&column, PARALLEL);
            }
        }
        basis
    }

    /// The largest coefficient of a linear parameter.
    pub fn highest(&self, parameter: usize) -> f64 {
        let l = &self.linear[parameter];
        l.most.map_or(f64::INFINITY, |most| most / l.unit)
    }

    /// Marks linear parameters that may be anything between their bounds without χ² rising by `most`, all of them together at the model's own values
    /// included. What is not linear is taken as it stands. Returns whether there are new ones.
    pub fn keep_unconstrained(&mut self, state: &State, most: f64) -> Result<bool, FitError> {
        let n = self.linear.len();
        let high: Vec<f64> = (0..n).map(|p| self.highest(p)).collect();
        let own: Vec<f64> = high.iter().map(|h| h.min(1.0)).collect();
        let columns: Vec<Vec<f64>> =
            state.design.column_iter().map(|c| c.iter().copied().collect()).collect();
        let system = BoundedSystem::new(columns, false);
        let system = system.map_err(|e| FitError::Search { why: e.to_string() })?;
        let mut kept = self.kept.clone();
        // χ² above the best where some are at given coefficients, the others following.
        let rise = |at: &[Option<f64>]| -> Result<f64, FitError> {
            let end = |free: &dyn Fn(usize) -> f64| -> Vec<f64> {
                (0..n).map(|p| at[p].unwrap_or_else(|| free(p)) - state.x[p]).collect()
            };
            let (low, high) = (end(&|_| 0.0), end(&|p| high[p]));
            let region = Region::Between { low: &low, high: &high, rest: &vec![0.0; n] };
            let found = system.solve(state.residual.as_slice(), &region);
            let found = found.map_err(|e| FitError::Search { why: e.to_string() })?;
            Ok(found.residual.iter().map(|r| r * r).sum::<f64>() - state.chi2)
        };
        loop {
            let at: Vec<Option<f64>> = (0..n).map(|p| kept[p].then_some(own[p])).collect();
            let mut best: Option<(f64, usize)> = None;
            for p in (0..n).filter(|p| !kept[*p] && high[*p].is_finite()) {
                let mut worst = 0.0_f64;
                for value in [0.0, high[p], own[p]] {
                    let mut at = at.clone();
                    at[p] = Some(value);
                    worst = worst.max(rise(&at)?);
                    if worst >= most {
                        break;
                    }
                }
                if worst < most && best.is_none_or(|(least, _)| worst < least) {
                    best = Some((worst, p));
                }
            }
            let Some((_, p)) = best else { break };
            kept[p] = true;
        }
        let new = kept != self.kept;
        self.kept = kept;
        Ok(new)
    }

    /// The model's rates with coefficients of the linear parameters.
    pub fn rates(&self, columns: &[Columns], x: &[f64]) -> PerSample {
        let of = |(model, owner): (&Columns, &Array2<Option<usize>>)| {
            let (n, channels, components) = model.columns.dim();
            Array2::from_shape_fn((n, channels), |(i, c)| {
                let all = (0..components).map(|k| {
                    let own = owner.get((c, k)).copied().flatten();
                    own.map_or(1.0, |p| x[p]) * model.columns[[i, c, k]]
                });
                model.fixed[[i, c]] + all.sum::<f64>()
            })
        };
        columns.iter().zip(&self.owner).map(of).collect()
    }

    /// Parameters with a prior, each of which has a row after those of the samples.
    pub fn priors(&self) -> Vec<Known> {
        let free =
            self.free.iter().enumerate().filter_map(|(k, f)| Some((Which::Free(k), f.prior?)));
        let linear = self.linear.iter().enumerate();
        let linear = linear.filter_map(|(p, l)| Some((Which::Linear(p), l.prior?)));
        free.chain(linear).map(|(which, prior)| Known { which, prior }).collect()
    }

    /// Rows of samples and priors.
    pub fn rows(&self) -> usize {
        self.whitener.rows + self.priors().len()
    }

    /// The value of a parameter, of one that wraps in the turn that is nearest to a mean.
    pub fn nearest(&self, free: usize, value: f64, mean: f64) -> f64 {
        let f = &self.free[free];
        let turn = f.high - f.low;
        if f.wraps { value - turn * ((value - mean) / turn).round() } else { value }
    }

    /// Puts the priors' part into whitened residuals of the samples.
    pub fn add_priors(&self, values: &[f64], x: &[f64], residual: &mut DVector<f64>) {
        for (row, known) in (self.whitener.rows..).zip(self.priors()) {
            let value = match known.which {
                Which::Free(k) => self.nearest(k, values[k], known.prior.mean),
                Which::Linear(p) => self.linear[p].unit * x[p],
            };
            residual[row] = (known.prior.mean - value) / known.prior.sigma;
        }
    }

    /// Numbers of all samples that count, whitened; 0 in the rows of priors.
    pub fn whitened(&self, values: &PerSample) -> DVector<f64> {
        let mut white = self.whitened_alone(values);
        if let Some(common) = &self.common {
            common.apply(&mut white);
        }
        white
    }

    /// The same by the samples' own noise alone.
    pub fn whitened_alone(&self, values: &PerSample) -> DVector<f64> {
        let mut white = DVector::zeros(self.rows());
        let mut buffer = Vec::new();
        for epoch in &self.whitener.epochs {
            buffer.clear();
            buffer.extend(epoch.channels.iter().map(|c| values[epoch.pass][[epoch.epoch, *c]]));
            epoch.apply(&mut buffer);
            buffer.iter().enumerate().for_each(|(j, v)| white[epoch.row + j] = *v);
        }
        white
    }

    /// Puts the errors of the calibration, by the model's rates, into the sum of squares where a parameter has a prior. All variances will be multiplied by `scale`; these are not meant.
    pub fn with_calibration(&mut self, rates: &PerSample, scale: f64) {
        self.common = match self.priors().is_empty() {
            true => None,
            false => Common::new(self.data, rates, scale, |change| self.whitened_alone(change)),
        };
    }

    /// Measured rates less others, those that go with their loss.
    pub fn left(&self, rates: &PerSample) -> PerSample {
        let left = self.data.iter().enumerate().map(|(p, curve)| {
            Array2::from_shape_fn(curve.rate.raw_dim(), |at| {
                self.centre(p, at) * curve.rate[at] - rates[p][at]
            })
        });
        left.collect()
    }

    /// Sum of squares of the samples about the model's rates with the errors of the calibration that the fit finds.
    pub fn scatter(&self, rates: &PerSample) -> f64 {
        self.whitened_alone(&self.left(&self.calibrated(rates))).norm_squared()
    }

    /// The model's rates with the errors of the calibration that the fit finds: what single samples scatter about.
    pub fn calibrated(&self, rates: &PerSample) -> PerSample {
        match &self.common {
            None => rates.clone(),
            Some(common) => common.found(&self.whitened_alone(&self.left(rates)), rates),
        }
    }
}
