//! Laws with few parameters through measured values of a BRDF, at one wavelength.
//!
//! Residuals are those of ln f, so that nine decades count alike; they are taken as Student's with four degrees of freedom, whose width is found with the parameters,
//! so that outliers pull little and the likelihood still ranks the laws. Values that are 0 or less have no logarithm: they are left out and counted, and what
//! the law says there is compared with them. A few bright samples of a peak are no outliers: a law that has the table's peak and hemispherical reflectance at each incidence goes before one that has not.
//! A law never reflects more than it got: what the fit would reflect beyond that at any angle of incidence is a penalty,
//! and what is left of it is scaled away. Intervals come from the curvature (sandwich estimate, Huber 1967); neighbours whose residuals are alike, as
//! where a law does not quite fit, count as fewer.

mod energy;
mod law;
mod report;
mod solve;
pub mod surface;
mod table;

pub use law::{Evaluated, Law, LobeKind, Range, Rise};
pub use report::{Fit, FitError, LawFit, LeftOut, Note, Parameter};
pub use table::{residual_table, to_table, to_toml};

use super::instrument::TableInstrument;
use super::samples::{Sample, Samples, turned};
use glam::DVec3;
use nalgebra::DMatrix;
use rayon::prelude::*;
use solve::{Data, Found, Judge, NU};
use sunglint_numerics::order::median;
use sunglint_simulator::surface::{ComplexIndex, MaterialError};
use surface::hemisphere::{self, Hemisphere};
use surface::{Flaw, MOST_OFF};

/// How laws are fitted.
#[derive(Debug, Clone, Default)]
pub struct FitOptions {
    /// The laws; all that the table allows where empty.
    pub laws: Vec<Law>,
    /// The wavelength, vacuum nm; may be left out where the table has one only.
    pub wavelength_nm: Option<f64>,
    /// Values up to this are no measurements, sr⁻¹.
    pub floor_per_sr: Option<f64>,
    /// Normal residuals in place of Student's: outliers then count in full.
    pub gaussian: bool,
    /// The refractive index for Maxwell and Beard's law.
    pub index: Option<ComplexIndex>,
}

/// Fits laws to measured values.
///
/// # Errors
/// A wavelength that is not there or not said, too few values, a law that the table does not allow.
pub fn fit(samples: &Samples, options: &FitOptions) -> Result<Fit, FitError> {
    let column = wavelength(samples, options.wavelength_nm)?;
    let wavelength_nm = samples.wavelength_nm[column];
    let (data, used, left_out, dark) = data(samples, column, options.floor_per_sr);
    let mut notes = Vec::new();
    if left_out != LeftOut::default() {
        notes.push(Note::LeftOut(left_out));
    }
    let share = left_out.not_above_zero as f64 / samples.rows.len() as f64;
    if share > 0.05 {
        notes.push(Note::ManyDark { share });
    }
    let incidences = incidences(samples, &used);
    if let [one] = incidences[..] {
        notes.push(Note::OneIncidence { theta_i_deg: one });
    }
    let (azimuths, several) = (samples.has_azimuths(), incidences.len() > 1);
    let mut laws = options.laws.clone();
    if laws.is_empty() {
        laws = Law::all(azimuths, several, options.index.is_some());
        if !azimuths {
            let reason = "the table has one azimuth of incidence";
            notes.push(Note::NotTried { law: "what is anisotropic", reason });
        }
        if options.index.is_none() {
            let reason = "its Fresnel term needs a refractive index";
            notes.push(Note::NotTried { law: "maxwell_beard", reason });
        }
    }
    for law in &laws {
        let refused = |reason| Err(FitError::Law { law: law.name(), reason });
        if law.anisotropic && !azimuths {
            return refused("the table has one azimuth of incidence: it does not tell x from y");
        }
        if law.lobe == LobeKind::MaxwellBeard && options.index.is_none() {
            return refused("its Fresnel term needs a refractive index");
        }
    }
    let fewest = laws.iter().min_by_key(|law| law.ranges().len());
    let enough = |law: &Law| used.len() >= law.ranges().len() + 3;
    if let Some(law) = fewest.filter(|law| !enough(law)) {
        return Err(FitError::TooFew {
            used: used.len(),
            rows: samples.rows.len(),
            left_out: left_out.to_string(),
            law: law.name(),
            parameters: law.ranges().len(),
            needed: law.ranges().len() + 3,
        });
    }
    laws.retain(enough);
    let rise = options.index.as_ref().map(|index| Rise::new(index, wavelength_nm)).transpose()?;
    let order = neighbours(&data);
    let mut fits = laws
        .par_iter()
        .map(|law| one(*law, &data, &dark, &order, rise.as_ref(), options))
        .collect::<Result<Vec<_>, _>>()?;
    for fit in &mut fits {
        let law = fit.law.with(&fit.values(), rise.as_ref());
        fit.is_faithful = !figures(&data, &law).iter().any(Flaw::needs_consent);
    }
    rank(&mut fits, used.len());
    if let Some(best) = fits.first_mut() {
        verify(best, &data, rise.as_ref(), options)?;
    }
    remarks(&fits, used.len(), &mut notes);
    let mut flaws = fits.first().map_or_else(Vec::new, |best| {
        figures(&data, &best.law.with(&best.values(), rise.as_ref()))
    });
    if let Some(instrument) = TableInstrument::of(samples) {
        fits.iter_mut().for_each(|fit| widen(fit, &instrument, &data));
        let diffuse = fits.first().and_then(|best| {
            let is_diffuse = |p: &&Parameter| DIFFUSE.contains(&p.name);
            best.parameters.iter().find(is_diffuse).map(|p| p.value)
        });
        flaws.extend(surface::of_instrument(&instrument, diffuse));
    }
    let independent = independent(used.len(), fits.first().map_or(0.0, |f| f.correlation));
    Ok(Fit { wavelength_nm, used, left_out, laws: fits, independent, flaws, notes })
}

fn wavelength(samples: &Samples, asked: Option<f64>) -> Result<usize, FitError> {
    let nm = &samples.wavelength_nm;
    let found = match asked {
        None if nm.len() == 1 => Some(0),
        None => None,
        Some(asked) => nm.iter().position(|v| (v - asked).abs() < 1e-6 * asked),
    };
    found.ok_or_else(|| {
        let (first, last) = (nm.first().copied().unwrap_or(0.0), nm.last().copied().unwrap_or(0.0));
        let known = match nm.len() {
            1 => format!("one wavelength, {first} nm"),
            n => format!("{n} wavelengths from {first} to {last} nm"),
        };
        FitError::Wavelength { known, asked }
    })
}

/// A row without light that has an uncertainty: directions and the most that it may have been.
type Dark = (DVec3, DVec3, f64);

fn data(
    samples: &Samples,
    column: usize,
    floor: Option<f64>,
) -> (Data, Vec<usize>, LeftOut, Vec<Dark>) {
    let mut data = Data::default();
    let (mut used, mut left_out, mut dark) = (Vec::new(), LeftOut::default(), Vec::new());
    let anisotropic = samples.has_azimuths();
    let limit = saturated(samples, column);
    for (k, row) in samples.rows.iter().enumerate() {
        let value = row.brdf_per_sr[column];
        let (i, o) = row.directions();
        let at_limit = limit.is_some_and(|limit| limit.holds(value, o));
        let (i, o) = if anisotropic { (i, o) } else { turned(i, o) };
        let sigma = row.sigma_per_sr.get(column).copied().unwrap_or(f64::NAN);
        if value.is_nan() {
            left_out.missing += 1;
        } else if i.z < 1e-6 || o.z < 1e-6 {
            left_out.horizon += 1;
        } else if at_limit {
            left_out.saturated += 1;
        } else if value <= 0.0 {
            left_out.not_above_zero += 1;
            if sigma > 0.0 {
                dark.push((i, o, (value + 3.0 * sigma).max(sigma)));
            }
        } else if floor.is_some_and(|floor| value <= floor) {
            left_out.at_floor += 1;
        } else {
            used.push(k);
            data.i.push(i);
            data.o.push(o);
            data.ln.push(value.ln());
            data.unit.push(sigma / value);
        }
    }
    // Relative uncertainties, where all are known, with their median as unit: what the law misses is added to the small ones.
    let known = data.unit.iter().all(|u| *u > 0.0 && u.is_finite());
    let middle = median(data.unit.iter().copied()).unwrap_or(1.0);
    for unit in &mut data.unit {
        *unit = if known { (*unit / middle).max(1.0) } else { 1.0 };
    }
    (data, used, left_out, dark)
}

/// Distinct angles of incidence, degrees.
fn incidences(samples: &Samples, used: &[usize]) -> Vec<f64> {
    let of = |k: &usize| samples.rows[*k].theta_i_deg.abs();
    let mut all: Vec<f64> = used.iter().map(of).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < 1e-3);
    all
}

/// Faults of a law in the hemispherical reflectance and the peak of each direction of incidence with five values or more.
fn figures(data: &Data, law: &Evaluated<'_>) -> Vec<Flaw> {
    let mut groups: std::collections::BTreeMap<[i64; 2], Vec<usize>> =
        std::collections::BTreeMap::new();
    for (k, i) in data.i.iter().enumerate() {
        let key = [i.x, i.y].map(|v| (v * 1e5).round() as i64);
        groups.entry(key).or_default().push(k);
    }
    let mut flaws = Vec::new();
    for rows in groups.values().filter(|rows| rows.len() >= 5) {
        let i = data.i[rows[0]];
        let theta_i_deg = (i.x.hypot(i.y).atan2(i.z).to_degrees() * 1e4).round() / 1e4;
        let o: Vec<DVec3> = rows.iter().map(|k| data.o[*k]).collect();
        let value: Vec<f64> = rows.iter().map(|k| data.ln[*k].exp()).collect();
        let seen: Vec<f64> = o.iter().map(|o| law.brdf(i, *o)).collect();
        let hemisphere = Hemisphere::new(i, &o, &value);
        let table = hemisphere.of(&value);
        if !hemisphere.is_resolved() {
            let hemispherical = if hemisphere.is_known() { table } else { f64::NAN };
            let ln_doubt = hemisphere.ln_doubt;
            flaws.push(Flaw::PeakNotResolved { theta_i_deg, hemispherical, ln_doubt });
        }
        let ratio = hemisphere.of(&seen) / table;
        if hemisphere.is_known() && (ratio - 1.0).abs() > MOST_OFF[0] {
            flaws.push(Flaw::Hemispherical { theta_i_deg, ratio });
        }
        let peak = hemisphere::peak(i, &o, 1e-3, 0.1);
        let ln: f64 = peak.iter().map(|k| (seen[*k].max(1e-300) / value[*k]).ln()).sum();
        let ratio = (ln / peak.len().max(1) as f64).exp();
        if (ratio - 1.0).abs() > MOST_OFF[1] {
            flaws.push(Flaw::Peak { theta_i_deg, ratio });
        }
    }
    flaws
}

/// Values that differ by less than this part are the same number.
const ALIKE: f64 = 1e-9;
/// A detector at its limit reads the same within this part: noise of its converter, and digits of a file.
const NOISE: f64 = 3e-3;
/// Distances in the plane of the horizon that differ by less are the same.
const SYMMETRIC: f64 = 2e-3;
/// A value below this part of the maximum follows a plateau of a saturated detector; a rounded number would follow closely.
const BELOW: f64 = 0.97;

/// The limit of a detector that stands in a table.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Saturation {
    /// The largest value, 1/sr: of f, or of f cos θ_o.
    per_sr: f64,
    /// Whether it is that of the detector's signal, which goes as f cos θ_o.
    signal: bool,
    /// Values above this are at the limit.
    from: f64,
}

impl Saturation {
    /// Returns true for a value of f at the limit.
    fn holds(&self, value: f64, o: DVec3) -> bool {
        (if self.signal { value * o.z } else { value }) >= self.from
    }
}

/// Returns the limit of a detector where values stand at one: at one incidence the largest value is there at several distances from the mirrored direction, and what comes next is clearly less.
///
/// It is looked for in f itself and in f cos θ_o, which is what a detector sees. Two distances are enough for numbers that are the same; where they agree to 0.3 % only, three are asked for.
fn saturated(samples: &Samples, column: usize) -> Option<Saturation> {
    [(false, ALIKE, 2), (false, NOISE, 3), (true, NOISE, 3)].into_iter().find_map(
        |(signal, tolerance, distances)| plateau(samples, column, signal, tolerance, distances),
    )
}

/// A note on the columns of a table in which a detector was at its limit.
pub(crate) fn saturation_note(samples: &Samples) -> Option<String> {
    let columns = 0..samples.wavelength_nm.len();
    let found: Vec<(f64, Saturation)> = columns
        .filter_map(|column| Some((samples.wavelength_nm[column], saturated(samples, column)?)))
        .collect();
    let (nm, Saturation { per_sr, signal, .. }) = found.first().copied()?;
    let more = match found.len() {
        1 => String::new(),
        n => format!(" (and in {} more of its wavelengths)", n - 1),
    };
    let what = if signal { "f cos θ_o" } else { "f" };
    Some(format!(
        "at {nm} nm{more} the largest values are all alike, {what} = {per_sr:.4} sr⁻¹ in several directions: the detector was saturated, and the peak is higher than what stands there"
    ))
}

fn plateau(
    samples: &Samples,
    column: usize,
    signal: bool,
    tolerance: f64,
    distances: usize,
) -> Option<Saturation> {
    let value = |row: &Sample| {
        let (_, o) = row.directions();
        row.brdf_per_sr[column] * if signal { o.z } else { 1.0 }
    };
    let most = samples.rows.iter().map(value).filter(|v| v.is_finite()).fold(0.0_f64, f64::max);
    let from = most * (1.0 - tolerance);
    let mut by_incidence: std::collections::BTreeMap<[i64; 2], (Vec<[f64; 2]>, f64)> =
        std::collections::BTreeMap::new();
    for row in &samples.rows {
        let (i, o) = row.directions();
        let key = [i.x, i.y].map(|v| (v * 1e5).round() as i64);
        let entry = by_incidence.entry(key).or_default();
        if value(row) >= from {
            entry.0.push([(i.x + o.x).hypot(i.y + o.y), o.z]);
        } else if value(row) > entry.1 {
            entry.1 = value(row);
        }
    }
    // Values that are all alike, as of diffuse light, have none that is clearly less.
    let is_plateau = |(places, next): &(Vec<[f64; 2]>, f64)| {
        // The same by symmetry is one distance: about the mirrored direction, or about the normal (f cos θ_o of diffuse light).
        let is_several = |which: usize| {
            let mut all: Vec<f64> = places.iter().map(|p| p[which]).collect();
            all.sort_by(f64::total_cmp);
            all.dedup_by(|a, b| (*a - *b).abs() < SYMMETRIC);
            all.len() >= distances
        };
        is_several(0) && is_several(1) && *next > 0.0 && *next < BELOW * most
    };
    let found = by_incidence.values().any(is_plateau);
    found.then_some(Saturation { per_sr: most, signal, from })
}

/// Pairs of neighbouring rows: the same incidence, and the next in order along the plane of incidence and around it.
fn neighbours(data: &Data) -> Vec<(usize, usize)> {
    let key = |k: usize| {
        let (i, o) = turned(data.i[k], data.o[k]);
        let azimuth = data.i[k].y.atan2(data.i[k].x);
        let round = |v: f64| (v * 1e5).round() as i64;
        // In the plane of incidence one line from horizon to horizon, else circle by circle.
        let across = o.y.abs();
        (round(i.z), round(azimuth), round(across / (1.0 + o.z)), round(-o.x / (1.0 + o.z)), k)
    };
    let mut order: Vec<_> = (0..data.ln.len()).map(key).collect();
    order.sort_unstable();
    let same =
        |a: &(i64, i64, i64, i64, usize), b: &(i64, i64, i64, i64, usize)| a.0 == b.0 && a.1 == b.1;
    order.windows(2).filter(|w| same(&w[0], &w[1])).map(|w| (w[0].4, w[1].4)).collect()
}

fn correlation(residual: &[f64], width: f64, pairs: &[(usize, usize)]) -> f64 {
    // Outliers count as they do in the fit.
    let of = |k: usize| {
        let z = residual[k] / width.max(1e-12);
        z / (1.0 + z * z / NU).sqrt()
    };
    let products: f64 = pairs.iter().map(|(a, b)| of(*a) * of(*b)).sum();
    let squares: f64 = pairs.iter().map(|(a, b)| 0.5 * (of(*a).powi(2) + of(*b).powi(2))).sum();
    let found = if squares > 0.0 { products / squares } else { 0.0 };
    // What chance gives is none.
    if found < 2.5 / (pairs.len().max(1) as f64).sqrt() { 0.0 } else { found.min(0.999) }
}

/// Returns how many independent values `n` count for whose neighbours are correlated (first-order autoregressive).
fn independent(n: usize, correlation: f64) -> f64 {
    n as f64 * (1.0 - correlation) / (1.0 + correlation)
}

fn one(
    law: Law,
    data: &Data,
    dark: &[Dark],
    pairs: &[(usize, usize)],
    rise: Option<&Rise>,
    options: &FitOptions,
) -> Result<LawFit, FitError> {
    // Maxwell and Beard's first surface grows as 1/cosθ_i without end.
    let energy_to_deg = if law.lobe == LobeKind::MaxwellBeard { 75.0 } else { 89.9 };
    let judge = Judge { data, law, rise, robust: !options.gaussian, energy_to_deg };
    let starts: Vec<Vec<f64>> =
        distinct(judge.starts(), if law.lobe == LobeKind::Lambert { 1 } else { 5 });
    let exceeds = |x: &[f64]| {
        let p: Vec<f64> = x.iter().map(|x| x.exp()).collect();
        let all = energy::quick(&law, &p, rise, energy_to_deg);
        all.iter().fold(0.0_f64, |m, (_, e)| m.max(*e)) > 1.0
    };
    let mut best = search(&judge, &starts, false);
    let mut energy_held = false;
    if exceeds(&best.x) {
        energy_held = true;
        let mut from = starts.clone();
        from.push(best.x.clone());
        best = search(&judge, &from, true);
    }
    let mut p: Vec<f64> = best.x.iter().map(|x| x.exp()).collect();
    let mut albedo = energy::quick(&law, &p, rise, 89.9);
    // What the penalty has left.
    for _ in 0..24 {
        let most = most_up_to(&albedo, energy_to_deg);
        if most <= 1.0 {
            break;
        }
        weaken(&law, &mut p, 1.0 / (most + 1e-6));
        albedo = energy::quick(&law, &p, rise, 89.9);
    }
    best.x = p.iter().map(|p| p.ln()).collect();
    best.residual = judge.residuals(&best.x);
    best.ln_likelihood = -judge.cost(&best.residual, best.width);
    let n = data.ln.len();
    let correlation = correlation(&best.residual, best.width, pairs);
    let sigma = sigmas(&judge, &best, independent(n, correlation));
    let quantile = student_quantile(n.saturating_sub(p.len()).max(1) as f64);
    let parameters = law
        .ranges()
        .iter()
        .enumerate()
        .map(|(j, range)| Parameter {
            name: range.name,
            value: p[j],
            sigma_ln: sigma[j],
            interval: sigma[j].map(|s| (p[j] * (-quantile * s).exp(), p[j] * (quantile * s).exp())),
            at_bound: best.held[j],
        })
        .collect();
    let with = law.with(&p, rise);
    let above = dark.iter().map(|(i, o, most)| with.brdf(*i, *o) / most);
    let above_zeros = above.fold(None, |m: Option<f64>, r| Some(m.map_or(r, |m| m.max(r))));
    let residual: Vec<f64> = best.residual.iter().zip(&data.unit).map(|(r, u)| r * u).collect();
    Ok(LawFit {
        law,
        parameters,
        width: best.width,
        rms: (residual.iter().map(|r| r * r).sum::<f64>() / n as f64).sqrt(),
        correlation,
        ln_likelihood: best.ln_likelihood,
        aicc: f64::NAN,
        bic: f64::NAN,
        weight: f64::NAN,
        albedo,
        energy_to_deg,
        energy_held,
        above_zeros: above_zeros.filter(|r| *r > 1.0),
        is_faithful: false,
        converged: best.converged,
        residual,
    })
}

/// Searches from all starts a little, from the two that lead farthest to the end.
fn search(judge: &Judge<'_>, starts: &[Vec<f64>], energy: bool) -> Found {
    let value = |f: &Found| f.penalty - f.ln_likelihood;
    let mut looks: Vec<Found> =
        starts.iter().map(|x| judge.solve(x, energy, solve::A_LOOK)).collect();
    looks.sort_by(|a, b| value(a).total_cmp(&value(b)));
    let first = judge.solve(&looks[0].x, energy, solve::TO_THE_END);
    let apart = |f: &&Found| f.x.iter().zip(&looks[0].x).any(|(a, b)| (a - b).abs() > 0.05);
    match looks.iter().skip(1).find(apart) {
        Some(other) => {
            let second = judge.solve(&other.x, energy, solve::TO_THE_END);
            if value(&second) < value(&first) { second } else { first }
        }
        None => first,
    }
}

/// The first few starts that are not next to one another.
fn distinct(ranked: Vec<Vec<f64>>, most: usize) -> Vec<Vec<f64>> {
    let mut kept: Vec<Vec<f64>> = Vec::new();
    for x in ranked {
        let near = |k: &Vec<f64>| k.iter().zip(&x).all(|(a, b)| (a - b).abs() < 0.7);
        if !kept.iter().any(near) {
            kept.push(x);
        }
        if kept.len() == most {
            break;
        }
    }
    kept
}

/// Asks the material's own quadrature, which is independent of the fit's, and gives way to it.
fn verify(
    best: &mut LawFit,
    data: &Data,
    rise: Option<&Rise>,
    options: &FitOptions,
) -> Result<(), FitError> {
    let mut p = best.values();
    best.albedo = settle(&best.law, &mut p, options.index.as_ref(), best.energy_to_deg)?;
    if p != best.values() {
        let factor: Vec<f64> = p.iter().zip(&best.parameters).map(|(p, q)| p / q.value).collect();
        for (q, factor) in best.parameters.iter_mut().zip(factor) {
            q.value *= factor;
            q.interval = q.interval.map(|(a, b)| (a * factor, b * factor));
        }
        let law = best.law.with(&p, rise);
        let ln = |k: usize| data.ln[k] - law.brdf(data.i[k], data.o[k]).max(1e-300).ln();
        best.residual = (0..data.ln.len()).map(ln).collect();
        best.energy_held = true;
    }
    Ok(())
}

/// Scales a law down until the material's own quadrature finds no more light than came at any angle up to `to_deg`, and gives what it reflects.
fn settle(
    law: &Law,
    p: &mut [f64],
    index: Option<&ComplexIndex>,
    to_deg: f64,
) -> Result<Vec<(f64, f64)>, FitError> {
    let mut albedo = Vec::new();
    for _ in 0..24 {
        let material = match law.material("fit", p, index) {
            Ok(material) => material,
            Err(MaterialError::Gain { albedo, .. }) => {
                weaken(law, p, 1.0 / albedo.max(1.0005));
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        albedo = energy::ANGLES_DEG
            .iter()
            .map(|deg| {
                let (sin, cos) = deg.to_radians().sin_cos();
                let mut most = material.albedo(550.0, DVec3::new(sin, 0.0, cos))?;
                if law.anisotropic {
                    most = most.max(material.albedo(550.0, DVec3::new(0.0, sin, cos))?);
                }
                Ok((*deg, most))
            })
            .collect::<Result<Vec<_>, MaterialError>>()?;
        let most = most_up_to(&albedo, to_deg);
        if most <= 1.0 + 1e-5 {
            break;
        }
        weaken(law, p, 1.0 / (most + 1e-6));
    }
    Ok(albedo)
}

fn most_up_to(albedo: &[(f64, f64)], to_deg: f64) -> f64 {
    let counted = albedo.iter().filter(|(deg, _)| *deg <= to_deg + 1e-9);
    counted.fold(0.0_f64, |m, (_, e)| m.max(*e))
}

/// Less of everything that is proportional.
fn weaken(law: &Law, p: &mut [f64], factor: f64) {
    p[0] *= factor;
    if law.lobe == LobeKind::MaxwellBeard {
        p[4] *= factor;
    }
    if law.diffuse && p.len() > 1 {
        // Schlick's term rises to 1 whatever it begins with: there the Lambert term has to give way.
        let factor = if law.schlick { factor.powi(4) } else { factor };
        p[law.ranges().len() - 1] *= factor;
    }
}

/// Standard deviations of the variables by the sandwich estimate, for as many independent values.
fn sigmas(judge: &Judge<'_>, found: &Found, independent: f64) -> Vec<Option<f64>> {
    let (n, p) = (found.residual.len(), found.x.len());
    let free: Vec<usize> = (0..p).filter(|j| !found.held[*j]).collect();
    let jacobian = judge.jacobian(&found.x);
    let mut normal: DMatrix<f64> = DMatrix::zeros(free.len(), free.len());
    for (a, j) in free.iter().enumerate() {
        for (b, k) in free.iter().enumerate() {
            normal[(a, b)] = jacobian.column(*j).dot(&jacobian.column(*k));
        }
    }
    let (mut square, mut slope) = (0.0, 0.0);
    for r in &found.residual {
        let z = r / found.width;
        if judge.robust {
            let d = NU + z * z;
            square += ((NU + 1.0) * z / d).powi(2);
            slope += (NU + 1.0) * (NU - z * z) / (d * d);
        } else {
            square += z * z;
            slope += 1.0;
        }
    }
    let dof = n.saturating_sub(free.len()).max(1) as f64;
    let n = n as f64;
    let slope = slope / n;
    let variance =
        found.width.powi(2) * (square / dof) / (slope * slope) * (n / independent.max(1.0));
    let mut sigma = vec![None; p];
    // Against scales of their own: an eigenvalue of nothing is a direction that nothing decides.
    let scale: Vec<f64> = (0..free.len()).map(|a| normal[(a, a)].sqrt()).collect();
    if scale.iter().any(|s| s.is_nan() || *s <= 0.0) || slope <= 0.0 {
        return sigma;
    }
    let mut unit = normal.clone();
    for a in 0..free.len() {
        for b in 0..free.len() {
            unit[(a, b)] /= scale[a] * scale[b];
        }
    }
    if let Some(inverse) = unit.cholesky().map(|c| c.inverse()) {
        for (a, j) in free.iter().enumerate() {
            let s = (variance * inverse[(a, a)]).sqrt() / scale[a];
            // Beyond a factor of e⁵ either way nothing is known.
            sigma[*j] = Some(s).filter(|s| s.is_finite() && *s < 5.0);
        }
    }
    sigma
}

/// Criteria, weights, order.
fn rank(fits: &mut [LawFit], n: usize) {
    let best = |fits: &[LawFit]| {
        fits.iter()
            .max_by(|a, b| a.ln_likelihood.total_cmp(&b.ln_likelihood))
            .map(|f| f.correlation)
    };
    let correlation = best(fits).unwrap_or(0.0);
    let count = independent(n, correlation);
    for fit in fits.iter_mut() {
        // The width is one more; a parameter at its bound decides nothing.
        let k = 1.0 + fit.parameters.iter().filter(|p| !p.at_bound).count() as f64;
        let deviance = -2.0 * fit.ln_likelihood * count / n as f64;
        let small =
            if count > k + 1.5 { 2.0 * k * (k + 1.0) / (count - k - 1.0) } else { f64::INFINITY };
        fit.aicc = deviance + 2.0 * k + small;
        fit.bic = deviance + k * count.ln();
    }
    let chosen = |f: &LawFit| f.conserves_energy();
    fits.sort_by(|a, b| {
        (!chosen(a), !a.is_faithful, a.aicc, a.bic)
            .partial_cmp(&(!chosen(b), !b.is_faithful, b.aicc, b.bic))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    let least = fits.iter().map(|f| f.aicc).fold(f64::INFINITY, f64::min);
    let share = |f: &LawFit| if f.aicc.is_finite() { (-0.5 * (f.aicc - least)).exp() } else { 0.0 };
    let all: f64 = fits.iter().map(share).sum();
    for fit in fits.iter_mut() {
        fit.weight = if all > 0.0 { share(fit) / all } else { f64::NAN };
    }
}

/// Numbers that all light of a law, or of its diffuse part, is in proportion to.
const STRENGTHS: [&str; 5] = ["reflectance", "a_per_sr", "bias_per_sr", "volume", "diffuse"];
/// Reflectances of diffuse light, which stray light looks like.
const DIFFUSE: [&str; 2] = ["volume", "diffuse"];

/// Widens the intervals of strengths for the scale that all values share, and those of diffuse light for the stray light in them, those of lobes for the polarisation they were measured in: no number of values makes their error smaller.
fn widen(fit: &mut LawFit, instrument: &TableInstrument, data: &Data) {
    let dof = data.ln.len().saturating_sub(fit.parameters.len()).max(1) as f64;
    let quantile = student_quantile(dof);
    let polarised =
        instrument.strength_sigma_ln(data.i.iter().copied().zip(data.o.iter().copied()));
    for p in fit.parameters.iter_mut().filter(|p| STRENGTHS.contains(&p.name)) {
        let is_diffuse = DIFFUSE.contains(&p.name);
        let part = if is_diffuse { instrument.diffuse_sigma_ln(p.value) } else { polarised };
        p.sigma_ln = p.sigma_ln.map(|own| own.hypot(instrument.scale_sigma).hypot(part));
        if let (Some(sigma), Some(_)) = (p.sigma_ln, p.interval) {
            let half = (quantile * sigma).exp();
            p.interval = Some((p.value / half, p.value * half));
        }
    }
}

/// Adds remarks on the fits to the notes.
fn remarks(fits: &[LawFit], n: usize, notes: &mut Vec<Note>) {
    for fit in fits.iter().filter(|f| !f.conserves_energy()) {
        let most = fit.albedo.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((theta_deg, albedo)) = most {
            notes.push(Note::Gains { law: fit.law.name(), theta_deg, albedo });
        }
    }
    if let Some(first) = fits.first() {
        if first.correlation > 0.0 {
            let independent = independent(n, first.correlation);
            notes.push(Note::Correlated { correlation: first.correlation, independent, values: n });
        }
        if first.correlation > 0.5 && first.rms > 0.3 {
            notes.push(Note::NoLawFits { factor: first.rms.exp() });
        }
    }
}

/// The 97.5 % point of Student's distribution (Cornish and Fisher's expansion; 2 % at 4 degrees of freedom, 1e-4 from 20 on).
fn student_quantile(dof: f64) -> f64 {
    let z = 1.959_963_985;
    let z2 = z * z;
    z * (1.0
        + (z2 + 1.0) / (4.0 * dof)
        + ((5.0 * z2 + 16.0) * z2 + 3.0) / (96.0 * dof * dof)
        + (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / (384.0 * dof.powi(3)))
}

/// Returns the value that a law predicts for a sample, sr⁻¹.
pub fn predicted(law: &LawFit, rise: Option<&Rise>, sample: &Sample, anisotropic: bool) -> f64 {
    let (i, o) = sample.directions();
    let (i, o) = if anisotropic { (i, o) } else { turned(i, o) };
    law.law.with(&law.values(), rise).brdf(i, o)
}
