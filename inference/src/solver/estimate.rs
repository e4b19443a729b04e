//! From the minimum to what it means: covariances, intervals, what is not determined.

use super::common::shared;
use super::normal::{Quadratic, inverse};
use super::problem::{Problem, State, Which};
use super::response::Response;
use super::{Estimate, FitError, IntervalMethod, ParameterKind, Search, Side, Warning};
use nalgebra::{DMatrix, DVector};
use sunglint_numerics::bounded::BoundedError;

/// Two-sided 95 % of a normal distribution.
const Z95: f64 = 1.959_963_984_540_054;
/// Square of `Z95`: Δχ² of a 95 % interval of one parameter.
pub(super) const CHI95: f64 = 3.841_458_820_694_124;
/// Distance to a bound, in standard uncertainties, below which a parameter gets a profile interval.
const NEAR: f64 = 2.0;
/// Part of its prior's standard deviation above which an uncertainty is the prior's.
const PRIOR_ALONE: f64 = 0.95;
/// The end of an interval is found to this part of its distance.
const ON_THE_EDGE: f64 = 0.01;
/// Places that are looked at between two ends of a bracket, at most: halvings every second time narrow it by 2¹².
const CLOSER: usize = 24;
/// Δχ², as a part of that at an interval's end, up to which nothing has changed along a parameter.
const LEVEL: f64 = 1e-3;
/// Part of an interval over which nothing changes where a combination is not determined, though the bounds of others end it: of a χ² that rises with the sixth power it is a third.
const MOSTLY: f64 = 0.5;
/// Correlations above this are named.
const CORRELATED: f64 = 0.98;

/// Estimates at the minimum, with their covariance and the warnings.
pub(super) struct Known {
    pub estimates: Vec<Estimate>,
    /// Parameters × parameters, the calibration's part in it; NaN rows where a bound holds.
    pub covariance: DMatrix<f64>,
    /// `None` of values alone.
    pub response: Option<Response>,
    pub warnings: Vec<Warning>,
}

/// `scale` multiplies the covariance of the samples' noise. Without `profiles` no interval of what is searched for is gone through. The whitener must be one without weights. `left` is what the loss leaves of the residuals ([`Response::left`]).
pub(super) fn estimate(
    problem: &mut Problem,
    values: &[f64],
    state: &State,
    scale: f64,
    profiles: bool,
    left: &DVector<f64>,
) -> Result<Known, FitError> {
    let (n_free, n_linear) = (problem.free.len(), problem.linear.len());
    let n = n_free + n_linear;
    let jacobian = jacobian(problem, values, state)?;
    let normal = jacobian.tr_mul(&jacobian);

    // Values, bounds and the size of one unit, in the fit's own numbers.
    let (mut at, mut low, mut high) = (vec![0.0; n], vec![0.0; n], vec![f64::INFINITY; n]);
    for (i, f) in problem.free.iter().enumerate() {
        at[i] = values[i];
        (low[i], high[i]) =
            if f.wraps { (f64::NEG_INFINITY, f64::INFINITY) } else { (f.low, f.high) };
    }
    at[n_free..].copy_from_slice(state.x.as_slice());
    for p in 0..n_linear {
        high[n_free + p] = problem.highest(p);
    }
    let kept = |i: usize| i >= n_free && problem.kept[i - n_free];
    let unit = |i: usize| if i < n_free { 1.0 } else { problem.linear[i - n_free].unit };
    let name = |i: usize| match i < n_free {
        true => problem.free[i].name.clone(),
        false => problem.linear[i - n_free].name.clone(),
    };
    let held: Vec<Option<Side>> = (0..n)
        .map(|i| {
            let room = if high[i].is_finite() { 1e-6 * (high[i] - low[i]) } else { 0.0 };
            if kept(i) {
                None
            } else if at[i] <= low[i] + room {
                Some(Side::Low)
            } else if at[i] >= high[i] - room {
                Some(Side::High)
            } else {
                None
            }
        })
        .collect();

    let mut warnings = Vec::new();
    let mut free: Vec<usize> = (0..n).filter(|i| held[*i].is_none() && !kept(*i)).collect();
    let root = |i: usize| normal[(i, i)].sqrt();
    let mut undetermined: Vec<bool> = (0..n).map(kept).collect();
    if undetermined.contains(&true) {
        let names = (0..n).filter(|i| undetermined[*i]).map(name).collect();
        warnings.push(Warning::Unconstrained { names });
    }
    // What stands at a bound may leave it elsewhere: then no interval follows from the covariance alone.
    let bounded = (n_free..n).any(|i| held[i].is_some() || kept(i));
    // What is searched for and has, here, no effect of its own (whatever stands at a bound goes with it) is held as it stands, and gone through below; with whom it goes is kept.
    let mut loose: Vec<(usize, Vec<usize>)> = Vec::new();
    let mut effective: Vec<usize> = (0..n).filter(|i| !kept(*i)).collect();
    effective.retain(|i| held[*i].is_none() || root(*i) > 0.0);
    loop {
        let searched = open_parts(&normal, &effective).1.into_iter().find_map(|all| {
            let own = all.iter().copied().filter(|i| *i < n_free);
            own.min_by(|a, b| root(*a).total_cmp(&root(*b))).map(|k| (k, all))
        });
        let Some((k, all)) = searched else { break };
        effective.retain(|i| *i != k);
        free.retain(|i| *i != k);
        loose.push((k, all));
    }
    let (inverse, parts) = open_parts(&normal, &free);
    for all in parts {
        all.iter().for_each(|i| undetermined[*i] = true);
        let names = all.iter().map(|i| name(*i)).collect();
        warnings.push(Warning::Undetermined { names });
    }
    // Without profiles nothing tells how far they may go.
    if !profiles {
        for (_, all) in &loose {
            all.iter().for_each(|i| undetermined[*i] = true);
            let names = all.iter().map(|i| name(*i)).collect();
            warnings.push(Warning::Undetermined { names });
        }
    }
    let is_loose = |k: usize| loose.iter().any(|(l, _)| *l == k);
    let goes = |i: usize| loose.iter().any(|(_, all)| all.contains(&i));
    let mut covariance = DMatrix::from_element(n, n, f64::NAN);
    for (a, i) in free.iter().enumerate() {
        for (b, j) in free.iter().enumerate() {
            let open = undetermined[*i] || undetermined[*j];
            covariance[(*i, *j)] =
                if open { f64::NAN } else { scale * inverse[(a, b)] / (root(*i) * root(*j)) };
        }
    }
    let [of_calibration, of_levels] =
        of_shared(problem, state, &jacobian, &free, &covariance, scale);
    let of_both = &of_calibration + of_levels;
    let response = Response {
        whitener: problem.whitener.clone(),
        common: problem.common.clone(),
        pull: pull(&jacobian, &free, &covariance, scale, &unit),
        bounds: (0..n).map(|i| (low[i] * unit(i), high[i] * unit(i))).collect(),
        held: (0..n)
            .filter(|i| held[*i].is_some() && root(*i) > 0.0)
            .filter_map(|i| Some((i, alone(&jacobian, &normal, &free, i)? * unit(i))))
            .collect(),
        left: left.clone(),
    };
    // At the minimum nothing pulls on what is free; what a loss other than the square leaves there is no pull.
    let mut gradient = jacobian.tr_mul(&state.residual);
    free.iter().for_each(|i| gradient[*i] = 0.0);
    // Where χ² is no parabola over the interval of a parameter that is searched for, it is gone through; what is solved for follows.
    let mut gone: Vec<Option<[f64; 2]>> = vec![None; n];
    let (mut reach_low, mut reach_high) =
        (vec![f64::INFINITY; n_linear], vec![f64::NEG_INFINITY; n_linear]);
    for k in 0..n_free {
        // The logarithm of the light is linear in a small correction with its prior: the covariance is enough.
        if !profiles || problem.free[k].search == Search::Near && problem.free[k].prior.is_some() {
            continue;
        }
        // At a bound, and where nothing changes at first, there is no covariance: steps of a part of the range do.
        let variance = covariance[(k, k)];
        let span = problem.free[k].high - problem.free[k].low;
        let sigma = if variance > 0.0 { variance.sqrt() } else { 0.02 * span };
        let course: Vec<f64> = (0..n_free)
            .map(|j| match covariance[(j, k)] / variance {
                slope if slope.is_finite() => slope,
                _ => f64::from(u8::from(j == k)),
            })
            .collect();
        let most = scale * CHI95;
        let Some((ends, path)) = walk(problem, values, state.chi2, k, sigma, &course, most)? else {
            continue;
        };
        // Open to both sides, or but for the bounds of those that go with it: whatever it is, the data look the same.
        if let Some((_, all)) = loose.iter().find(|(l, _)| *l == k) {
            let level = path.iter().filter(|p| p.rise < LEVEL * most).map(|p| p.along);
            let reach = level.fold((0.0_f64, 0.0_f64), |(a, b), t| (a.min(t), b.max(t)));
            undetermined[k] = ends[1] - ends[0] > (1.0 - 1e-9) * span;
            if undetermined[k] || reach.1 - reach.0 > MOSTLY * (ends[1] - ends[0]) {
                let names = all.iter().map(|i| name(*i)).collect();
                warnings.push(Warning::Undetermined { names });
            }
        }
        gone[k] = Some(ends);
        // The place that ends it counts too: at a wall it lies beyond.
        let within = |p: &&Step| p.rise < most || (ends[0]..=ends[1]).contains(&(at[k] + p.along));
        for Step { rise, state, .. } in path.iter().filter(within) {
            let part = state.design.tr_mul(&state.design);
            let (inverse, _) = inverse_of(&part);
            for p in 0..n_linear {
                let half = ((most - rise).max(0.0) * inverse[(p, p)]).max(0.0).sqrt();
                reach_low[p] = reach_low[p].min(state.x[p] - half);
                reach_high[p] = reach_high[p].max(state.x[p] + half);
            }
        }
    }
    // Beside priors they are in χ², and so in the covariance.
    let within = problem.common.is_some();
    if within {
        covariance -= &of_both;
    }
    let total = &covariance + &of_both;
    let mut estimates = Vec::with_capacity(n);
    for i in 0..n {
        let size = unit(i);
        // f64::max would turn what is unknown into 0.
        let own = match covariance[(i, i)] {
            v if v.is_nan() => f64::NAN,
            v => v.max(0.0).sqrt(),
        };
        let [calibrated, shared] = [&of_calibration, &of_both].map(|c| c[(i, i)].max(0.0).sqrt());
        let mut sigma = own.hypot(shared);
        // Of χ² that holds these errors, half-widths have them.
        let beside = if within { 0.0 } else { Z95 * shared };
        let ends_of = |ends: [f64; 2]| -> [f64; 2] {
            let (below, above) = (at[i] - ends[0], ends[1] - at[i]);
            [(at[i] - below.hypot(beside)).max(low[i]), (at[i] + above.hypot(beside)).min(high[i])]
        };
        let near = bounded
            || held[i].is_some()
            || at[i] - low[i] < NEAR * sigma
            || high[i] - at[i] < NEAR * sigma;
        let walked = match i.checked_sub(n_free) {
            None => gone[i],
            Some(p) if reach_low[p] < reach_high[p] && (held[i].is_none() || goes(i)) => {
                // f64::min leaves out what is no number: where it stands at a bound.
                Some([
                    reach_low[p].min(at[i]).min(at[i] - Z95 * own),
                    reach_high[p].max(at[i]).max(at[i] + Z95 * own),
                ])
            }
            Some(_) => None,
        };
        // Given what is held, a standard uncertainty is too small; of what is gone through the interval has it.
        if let (Some([a, b]), None) = (walked, held[i])
            && !loose.is_empty()
            && !undetermined[i]
            && (i >= n_free || is_loose(i))
        {
            let half = 0.5 * (b - a) / Z95;
            sigma = match sigma.is_finite() {
                true => sigma.max(half),
                false if within => half,
                false => half.hypot(calibrated),
            };
        }
        let (interval, method) = if undetermined[i] {
            ([low[i] * size, high[i] * size], IntervalMethod::None)
        } else if let Some(ends) = walked {
            let ends = ends_of(ends);
            (ends.map(|v| v * size), IntervalMethod::Profile)
        } else if near {
            let ends = profile(&normal, &gradient, &at, &low, &high, i, scale * CHI95)?;
            let ends = ends_of(ends);
            (ends.map(|v| v * size), IntervalMethod::Profile)
        } else {
            let ends = [at[i] - Z95 * sigma, at[i] + Z95 * sigma];
            (ends.map(|v| v * size), IntervalMethod::Covariance)
        };
        match (held[i], i.checked_sub(n_free).and_then(|p| problem.linear[p].most)) {
            (Some(Side::High), Some(most)) => {
                warnings.push(Warning::TooLarge { name: name(i), most });
            }
            (Some(side), _) => {
                warnings.push(Warning::AtBound { name: name(i), value: at[i] * size, side });
            }
            (None, _) => {}
        }
        estimates.push(Estimate {
            name: name(i),
            kind: if i < n_free { ParameterKind::Nonlinear } else { ParameterKind::Linear },
            value: at[i] * size,
            sigma: finite(sigma * size),
            sigma_calibration: finite(calibrated * size),
            sigma_material: None,
            interval_95: interval.map(finite),
            interval_method: method,
            at_bound: held[i],
            prior: match i.checked_sub(n_free) {
                None => problem.free[i].prior,
                Some(p) => problem.linear[p].prior,
            },
        });
    }
    for i in 0..n {
        for j in 0..i {
            let r = total[(i, j)] / (total[(i, i)] * total[(j, j)]).sqrt();
            if r.abs() > CORRELATED {
                let names = [name(j), name(i)];
                warnings.push(Warning::Correlated { names, correlation: r });
            }
        }
    }
    let by_prior: Vec<String> = (problem.priors().iter())
        .map(|known| match known.which {
            Which::Free(k) => (k, known.prior.sigma),
            Which::Linear(p) => (n_free + p, known.prior.sigma),
        })
        .filter(|(i, sigma)| estimates[*i].sigma.is_some_and(|own| own >= PRIOR_ALONE * sigma))
        .map(|(i, _)| name(i))
        .collect();
    if !by_prior.is_empty() {
        warnings.push(Warning::ByPrior { names: by_prior });
    }
    let covariance = DMatrix::from_fn(n, n, |i, j| total[(i, j)] * unit(i) * unit(j));
    Ok(Known { estimates, covariance, response: Some(response), warnings })
}

/// The pseudo-inverse of the part of a normal matrix that some parameters have, scaled to a unit diagonal; and of each combination of them that changes nothing those that take part.
fn open_parts(normal: &DMatrix<f64>, of: &[usize]) -> (DMatrix<f64>, Vec<Vec<usize>>) {
    let root = |i: usize| normal[(i, i)].sqrt();
    let scaled = DMatrix::from_fn(of.len(), of.len(), |a, b| {
        let (i, j) = (of[a], of[b]);
        let size = root(i) * root(j);
        if size > 0.0 { normal[(i, j)] / size } else { 0.0 }
    });
    let (inverse, open) = inverse(&scaled);
    let part = |v: &DVector<f64>| -> Vec<usize> {
        (0..of.len()).filter(|a| v[*a].abs() > 0.1).map(|a| of[a]).collect()
    };
    let parts = open.iter().map(part).collect();
    (inverse, parts)
}

/// The pseudo-inverse, of a matrix whose columns may differ in scale.
fn inverse_of(matrix: &DMatrix<f64>) -> (DMatrix<f64>, Vec<DVector<f64>>) {
    let n = matrix.nrows();
    let root = DVector::from_fn(n, |i, _| match matrix[(i, i)] {
        d if d > 0.0 => d.sqrt().recip(),
        _ => 0.0,
    });
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * root[i] * root[j]);
    let (found, open) = inverse(&scaled);
    (DMatrix::from_fn(n, n, |i, j| found[(i, j)] * root[i] * root[j]), open)
}

/// A place on the way along a parameter: how far, Δχ², and the fit there.
struct Step {
    along: f64,
    rise: f64,
    state: State,
}

/// The ends of the interval of a parameter that is searched for, and the way.
type Walk = ([f64; 2], Vec<Step>);

/// Goes along a parameter, the others following (first as the covariance has it, `course` per unit, then to their own minimum), to where Δχ² is `most`.
/// `None` where χ² is a parabola within a quarter, so that the covariance says the same.
fn walk(
    problem: &mut Problem,
    values: &[f64],
    base: f64,
    k: usize,
    sigma: f64,
    course: &[f64],
    most: f64,
) -> Result<Option<Walk>, FitError> {
    let bounds: Vec<(f64, f64, bool)> =
        problem.free.iter().map(|f| (f.low, f.high, f.wraps)).collect();
    let there = |t: f64| -> Vec<f64> {
        let moved = values.iter().zip(course).map(|(v, c)| v + c * t);
        let within = moved.zip(&bounds).map(
            |(v, (low, high, wraps))| {
                if *wraps { v } else { v.clamp(*low, *high) }
            },
        );
        within.collect()
    };
    let inside = |t: f64| {
        let (low, high, wraps) = bounds[k];
        wraps || (low..=high).contains(&(values[k] + t))
    };
    let reach = Z95 * sigma;
    let expected = most;
    let mut parabola = true;
    for t in [-reach, reach] {
        let rise = problem.evaluate(&there(t))?.chi2 - base;
        parabola &= inside(t) && (0.75 * expected..1.3 * expected).contains(&rise);
    }
    if parabola {
        return Ok(None);
    }
    let mut path = Vec::new();
    let mut rise = |problem: &mut Problem, t: f64| -> Result<f64, FitError> {
        let mut at = there(t);
        if at.len() > 1 {
            let unit: Vec<f64> = at
                .iter()
                .zip(&bounds)
                .map(|(v, (low, high, _))| (v - low) / (high - low))
                .collect();
            let found =
                super::search::polish(problem, &unit, 12, false, super::search::Held::One(k))?;
            at = super::search::values(problem, &found.at);
        }
        let state = problem.evaluate(&at)?;
        let rise = state.chi2 - base;
        path.push(Step { along: t, rise, state });
        Ok(rise)
    };
    let mut ends = [values[k]; 2];
    for (end, sign) in ends.iter_mut().zip([-1.0, 1.0]) {
        let bound = if sign < 0.0 { bounds[k].0 } else { bounds[k].1 };
        let furthest =
            if bounds[k].2 { 0.5 * (bounds[k].1 - bounds[k].0) } else { (bound - values[k]).abs() };
        // The root of the rise over that of `most`, less 1: it is nearly linear in the distance.
        let over = |rise: f64| (rise.max(0.0) / most).sqrt() - 1.0;
        let (mut near, mut far) = ((0.0, -1.0), (reach.min(furthest), 0.0));
        let mut open = false;
        loop {
            far.1 = over(rise(problem, sign * far.0)?);
            if far.1 >= 0.0 {
                break;
            }
            if far.0 >= furthest {
                open = true;
                break;
            }
            (near, far.0) = (far, (1.6 * far.0).min(furthest));
        }
        if open {
            *end = values[k] + sign * furthest;
            continue;
        }
        // Regula falsi; an end that stays twice counts half (Dowell and Jarratt 1971: the Illinois method). At a hard edge, where χ² is no parabola at all, that creeps: what did not
        // narrow the bracket by half is followed by its middle.
        let (mut stayed, mut halve) = (0_i32, false);
        for _ in 0..CLOSER {
            let width = far.0 - near.0;
            if far.1.min(-near.1) < ON_THE_EDGE || width < ON_THE_EDGE * far.0 {
                break;
            }
            let middle = match halve {
                true => near.0 + 0.5 * width,
                false => near.0 + width * near.1 / (near.1 - far.1),
            };
            let at = over(rise(problem, sign * middle)?);
            if at < 0.0 {
                near = (middle, at);
                if stayed < 0 {
                    far.1 *= 0.5;
                }
                stayed = -1;
            } else {
                far = (middle, at);
                if stayed > 0 {
                    near.1 *= 0.5;
                }
                stayed = 1;
            }
            halve = far.0 - near.0 > 0.5 * width;
        }
        // What is not found any closer is the outer end.
        let edge = if -near.1 < ON_THE_EDGE { near.0 } else { far.0 };
        *end = values[k] + sign * edge;
    }
    Ok(Some((ends, path)))
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// How whitened rates change with all parameters: central differences with the linear ones held, then their columns.
fn jacobian(
    problem: &mut Problem,
    values: &[f64],
    state: &State,
) -> Result<DMatrix<f64>, FitError> {
    let (n_free, n_linear) = (problem.free.len(), problem.linear.len());
    let mut jacobian = DMatrix::zeros(problem.rows(), n_free + n_linear);
    let priors = problem.priors();
    for k in 0..n_free {
        let mut slope = match problem.slope(values, k, &state.rates) {
            Some(slope) => slope,
            None => differences(problem, values, state, k)?,
        };
        for (row, known) in (problem.whitener.rows..).zip(&priors) {
            if known.which == Which::Free(k) {
                slope[row] = known.prior.sigma.recip();
            }
        }
        jacobian.set_column(k, &slope);
    }
    for p in 0..n_linear {
        jacobian.set_column(n_free + p, &state.design.column(p));
    }
    Ok(jacobian)
}

/// How far each parameter moves for a whitened row that is larger by 1.
fn pull(
    jacobian: &DMatrix<f64>,
    free: &[usize],
    covariance: &DMatrix<f64>,
    scale: f64,
    unit: &dyn Fn(usize) -> f64,
) -> DMatrix<f64> {
    let mut pull = DMatrix::from_element(jacobian.ncols(), jacobian.nrows(), f64::NAN);
    for i in free {
        if covariance[(*i, *i)].is_nan() {
            continue;
        }
        pull.row_mut(*i).fill(0.0);
        for j in free.iter().filter(|j| covariance[(*i, **j)].is_finite()) {
            let part = unit(*i) * covariance[(*i, *j)] / scale;
            for (row, slope) in jacobian.column(*j).iter().enumerate() {
                pull[(*i, row)] += part * slope;
            }
        }
    }
    pull
}

/// How far a parameter that stands at a bound moves for a whitened row that is larger by 1, if it alone could leave it; `None` where that changes nothing.
fn alone(
    jacobian: &DMatrix<f64>,
    normal: &DMatrix<f64>,
    free: &[usize],
    parameter: usize,
) -> Option<DVector<f64>> {
    let with: Vec<usize> = free.iter().copied().chain([parameter]).collect();
    let (inverse, open) = open_parts(normal, &with);
    if open.iter().any(|all| all.contains(&parameter)) {
        return None;
    }
    let root = |i: usize| normal[(i, i)].sqrt();
    let mut row = DVector::zeros(jacobian.nrows());
    for (a, j) in with.iter().enumerate() {
        let part = inverse[(free.len(), a)] / (root(parameter) * root(*j));
        if part.is_finite() {
            row += jacobian.column(*j) * part;
        }
    }
    Some(row)
}

/// Derivative of the whitened rates by a parameter, by differences to both sides.
fn differences(
    problem: &mut Problem,
    values: &[f64],
    state: &State,
    k: usize,
) -> Result<DVector<f64>, FitError> {
    let (low, high, wraps, step) = {
        let f = &problem.free[k];
        (f.low, f.high, f.wraps, f.step)
    };
    let end = |v: f64| if wraps { v } else { v.clamp(low, high) };
    let ends = [end(values[k] - step), end(values[k] + step)];
    let mut sides = Vec::with_capacity(2);
    for end in ends {
        let mut there = values.to_vec();
        there[k] = end;
        let columns = problem.columns(&there)?;
        let rates = problem.rates(&columns, state.x.as_slice());
        sides.push(problem.whitened(&rates));
    }
    Ok((&sides[1] - &sides[0]) / (ends[1] - ends[0]))
}

/// Returns the covariances of the parameters by the errors that samples have in common, those of the calibration and those of levels: an error ε of ln κ changes the data by ε times the rate, one of a level by the same Hz, and the parameters by the
/// same least squares as any other change of the data.
fn of_shared(
    problem: &Problem,
    state: &State,
    jacobian: &DMatrix<f64>,
    free: &[usize],
    covariance: &DMatrix<f64>,
    scale: f64,
) -> [DMatrix<f64>; 2] {
    let n = jacobian.ncols();
    let mut sums = [(); 2].map(|()| DMatrix::<f64>::zeros(n, n));
    for error in shared(problem.data, &state.rates) {
        let pull = jacobian.tr_mul(&problem.whitened(&error.of_all(&state.rates)));
        let mut shift = DVector::<f64>::zeros(n);
        for i in free {
            let terms = free.iter().map(|j| covariance[(*i, *j)] / scale * pull[*j]);
            shift[*i] = terms.filter(|v| v.is_finite()).sum::<f64>();
        }
        sums[usize::from(!error.of_calibration)] += &shift * shift.transpose();
    }
    sums
}

/// The ends of the interval in which Δχ² stays below `most`, all others following within their bounds; the model taken as linear there.
fn profile(
    normal: &DMatrix<f64>,
    gradient: &DVector<f64>,
    at: &[f64],
    low: &[f64],
    high: &[f64],
    which: usize,
    most: f64,
) -> Result<[f64; 2], FitError> {
    let n = at.len();
    let others: Vec<usize> = (0..n).filter(|i| *i != which).collect();
    let part = DMatrix::from_fn(others.len(), others.len(), |a, b| normal[(others[a], others[b])]);
    let room = |ends: &[f64]| -> Vec<f64> { others.iter().map(|i| ends[*i] - at[*i]).collect() };
    let (least, largest) = (room(low), room(high));
    let search = |e: BoundedError| FitError::Search { why: e.to_string() };
    let form = match others.is_empty() {
        true => None,
        false => Some(Quadratic::new(&part).map_err(search)?),
    };
    let rise = |t: f64| -> Result<f64, FitError> {
        // A parameter that is alone has its parabola.
        let Some(form) = &form else {
            return Ok(normal[(which, which)] * t * t - 2.0 * gradient[which] * t);
        };
        let right = DVector::from_fn(others.len(), |a, _| {
            gradient[others[a]] - normal[(others[a], which)] * t
        });
        let y = form.least(&right, &least, &largest).map_err(search)?;
        let across = DVector::from_fn(others.len(), |a, _| normal[(others[a], which)]).dot(&y);
        let own = normal[(which, which)] * t * t - 2.0 * gradient[which] * t;
        let rest = (&part * &y).dot(&y) + 2.0 * t * across;
        let pulled: f64 = others.iter().zip(y.iter()).map(|(i, y)| 2.0 * gradient[*i] * y).sum();
        Ok(own + rest - pulled)
    };
    let base = rise(0.0)?;
    let unit = 1.0 / normal[(which, which)].sqrt();
    let end = |sign: f64, bound: f64| -> Result<f64, FitError> {
        if !unit.is_finite() {
            return Ok(bound);
        }
        let (mut inside, mut outside) = (0.0, sign * unit * most.sqrt());
        while rise(outside)? - base < most {
            if (at[which] + outside - bound) * sign >= 0.0 || outside.abs() > 1e12 * unit {
                return Ok(bound);
            }
            (inside, outside) = (outside, 2.0 * outside);
        }
        for _ in 0..60 {
            let middle = 0.5 * (inside + outside);
            if rise(middle)? - base < most { inside = middle } else { outside = middle }
        }
        let found = at[which] + 0.5 * (inside + outside);
        Ok(if (found - bound) * sign > 0.0 { bound } else { found })
    };
    Ok([end(-1.0, low[which])?, end(1.0, high[which])?])
}
