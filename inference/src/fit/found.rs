//! Result of a fit, put back into scenes: spectra through albedos, light between the parts, the scene as text.

use super::answer::{Bounces, FittedScene, MaterialSpectrum};
use super::parameters::{self, Parameters};
use super::{PassFitError, THINNED};
use crate::measured::{CurveOfScene, V, pass_of, place};
use crate::scene::Scene;
use crate::solver::spectrum::{Band, upsample};
use crate::solver::{Fit, FittedCurve, StudyModel, band_weights};
use hifitime::Epoch;
use ndarray::Array2;
use std::collections::BTreeMap;
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_numerics::order::median;
use sunglint_numerics::progress::Progress;
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::pass::{Correction, Overrides, Pass, Study, TermRates, Thinned};

/// Knots of reflectance spectra: first, last, step, nm.
const KNOTS_NM: (u32, u32, u32) = (300, 1240, 5);

/// A band albedo that its spectrum meets within this part needs no factor of its own.
const MET: f64 = 1e-5;
/// Difference (mag, or relative) up to which a scene gives the fit again.
const SAME: f64 = 1e-3;
/// Steps of the times of a scene that gets new ones, at most.
const MOST_STEPS: f64 = 1e5;

/// Rounds of fitting and computing the light between the parts at most.
const MOST_ROUNDS: usize = 12;
/// A round that moves no parameter by more of its standard uncertainty is the last.
const SETTLED_SIGMAS: f64 = 0.03;
/// The same from this round on: light that is found by paths, or by patches that are made anew, is itself unsure.
const LATER: (usize, f64) = (4, 0.1);

/// Rounds take ten times the scene's tolerance, and no more than a tenth of the light, until one moves no parameter by more of its standard uncertainty than this: reflectances far from the last
/// ones need other wavelengths and patches.
const FAR_SIGMAS: f64 = 6.0;
const FAR_TOLERANCE: (f64, f64) = (10.0, 0.1);

/// Bounced light of a curve that is held, on its way to the fixed point of h = G(h), G being the light computed for the fit with h held: the secant through the last
/// two rounds (Anderson's acceleration of depth 1; Walker and Ni 2011).
#[derive(Default)]
struct Held {
    /// Light held in the last round, and how much the light computed then differed from it.
    last: Option<(Array2<f64>, Array2<f64>)>,
    /// Light held now.
    now: Option<Array2<f64>>,
}

impl Held {
    /// Returns the light to hold next, after `computed` was found for the fit with the light held now: samples × channels. Never below 0. The channels' albedos hang on one another by
    /// smooth spectra alone, so that each channel has a secant of its own.
    fn next(&mut self, computed: Array2<f64>) -> Array2<f64> {
        let now = self.now.take().unwrap_or_else(|| Array2::zeros(computed.raw_dim()));
        let miss = &computed - &now;
        let mut next = computed;
        if let Some((before, missed)) = &self.last {
            let change = &miss - missed;
            let moved = &now - before + &change;
            for (c, mut next) in next.columns_mut().into_iter().enumerate() {
                let change = change.column(c);
                let size = change.dot(&change);
                let part = if size > 0.0 { change.dot(&miss.column(c)) / size } else { 0.0 };
                next.scaled_add(-part.clamp(-1.0, 1.0), &moved.column(c));
            }
        }
        next.mapv_inplace(|v| v.max(0.0));
        self.last = Some((now, miss));
        self.now = Some(next.clone());
        next
    }

    /// Forgets the rounds before, where light is from now on computed in another way: what changes then is no answer to another light that was held.
    fn forget(&mut self) {
        self.last = None;
    }
}

/// Parts of a curve's simulation that are kept from round to round.
struct Kept {
    /// Whether it is for a first look.
    far: bool,
    study: Study,
    thinned: Thinned,
    /// Light of single materials in the first round, samples × channels.
    single: Array2<f64>,
}

/// A fit with the light between the parts that belongs to it.
pub(super) struct Settled {
    pub fit: Fit,
    /// `None` where no light goes between the parts.
    pub bounces: Option<Bounces>,
    /// Studies by which that light was computed: none, or one for each curve that has such light.
    pub studies: Vec<Option<Study>>,
}

/// Inputs for computing the light between the parts.
pub(super) struct Bouncing<'a> {
    pub curves: &'a [CurveOfScene],
    /// True for the curves whose light between the parts is computed.
    pub of: &'a [bool],
    pub parameters: &'a Parameters,
    pub channels: &'a [String],
}

impl Bouncing<'_> {
    /// Light between the parts costs a thousand times as much as that of the parts themselves, and hangs on what is looked for. It is computed for what
    /// was found, held, and the rest fitted again by `refit`, until nothing moves any more: a fixed point. Brighter parts make more of it, which makes them fainter in the next
    /// round, so that rounds would swing about the answer: what is held next is where the last two lead ([`Held`]).
    pub fn settle(
        &self,
        model: &mut StudyModel,
        fit: Fit,
        progress: &dyn Progress,
        refit: &mut dyn FnMut(&mut StudyModel, &Fit) -> Result<Fit, PassFitError>,
    ) -> Result<Settled, PassFitError> {
        let mut fit = fit;
        let mut found: Option<Bounces> = None;
        let mut held: Vec<Held> = self.curves.iter().map(|_| Held::default()).collect();
        let mut kept: Vec<Option<Kept>> = self.curves.iter().map(|_| None).collect();
        let mut far = true;
        for round in 1..=MOST_ROUNDS {
            let mut share = 0.0_f64;
            for k in (0..self.curves.len()).filter(|k| self.of[*k]) {
                progress.status(&format!("light between the parts, round {round}"));
                let bounced = self.computed(k, model, &fit, (far, &mut kept[k]))?;
                let Some((bounced, most)) = bounced else { continue };
                share = share.max(most);
                model.hold(k, held[k].next(bounced))?;
            }
            if share == 0.0 && far {
                // Nothing that a first look would see.
                far = false;
                held.iter_mut().for_each(Held::forget);
                continue;
            }
            if share == 0.0 {
                return Ok(Settled { fit, bounces: None, studies: Vec::new() });
            }
            let next = refit(model, &fit)?;
            let moves = next.parameters.iter().zip(&fit.parameters).filter_map(|(new, old)| {
                new.sigma.filter(|s| *s > 0.0).map(|s| (new.value - old.value).abs() / s)
            });
            let moved_sigmas = moves.fold(0.0, f64::max);
            fit = next;
            let (later, most) = LATER;
            let settled = !far && moved_sigmas <= if round < later { SETTLED_SIGMAS } else { most };
            if far && moved_sigmas <= FAR_SIGMAS {
                far = false;
                held.iter_mut().for_each(Held::forget);
            }
            found =
                Some(Bounces { share, rounds: round, moved_sigmas, settled, thinned: Vec::new() });
            if settled {
                break;
            }
        }
        if let Some(found) = &mut found {
            found.thinned = kept.iter().flatten().map(|kept| kept.thinned).collect();
        }
        let near = |kept: Kept| (!kept.far).then_some(kept.study);
        let studies = kept.into_iter().map(|kept| kept.and_then(near)).collect();
        Ok(Settled { fit, bounces: found, studies })
    }

    /// The light that came by way of another part at a curve's samples, as the fit has the body (its size, gain and extinction aside), and the largest share of it. The study
    /// that it was computed with is kept.
    fn computed(
        &self,
        k: usize,
        model: &StudyModel,
        fit: &Fit,
        (far, kept): (bool, &mut Option<Kept>),
    ) -> Result<Option<(Array2<f64>, f64)>, PassFitError> {
        let (curve, parameters, channels) = (&self.curves[k], self.parameters, self.channels);
        let values: Vec<f64> = fit.parameters.iter().map(|p| p.value).collect();
        let mut idle = Vec::new();
        let mut scene = curve.scene.clone();
        for (key, value) in parameters.keys(k, &values) {
            scene.set(key, value);
        }
        let Some(study) = model.study(k) else { return Ok(None) };
        let magnitudes = curve.measured.magnitudes;
        let of =
            OfCurve { number: k, parameters, fit, channels, study, magnitudes, as_factors: false };
        for spectrum in spectra_of(&of, &mut idle)?.0 {
            let found = &spectrum.found;
            scene.set_reflectance(&spectrum.material, &found.wavelength_nm, &found.reflectance);
        }
        let n = curve.measured.times.len();
        let curve = CurveOfScene { scene, ..curve.clone() };
        let mut pass = pass_of(&curve, &mut idle)?;
        pass.effects.inter_reflection = Switch::Auto;
        if far {
            let (times, most) = FAR_TOLERANCE;
            pass.tolerance = pass.tolerance.max((times * pass.tolerance).min(most));
        }
        let station = &study.pass().station;
        let places: Vec<Option<usize>> = channels.iter().map(|c| place(station, c)).collect();
        let summed = |rates: &TermRates, several: bool| {
            let mut sums = Array2::<f64>::zeros((n, channels.len()));
            for ((i, c), sum) in sums.indexed_iter_mut() {
                let row = match (magnitudes, places[c]) {
                    (true, _) => rates.fluxes.slice(ndarray::s![i, V, ..]),
                    (false, Some(own)) => rates.rates_hz.slice(ndarray::s![i, own, ..]),
                    (false, None) => continue,
                };
                let of_it = rates.terms.iter().zip(row);
                *sum = of_it.filter(|(t, _)| t.is_of_several() == several).map(|(_, v)| v).sum();
            }
            sums
        };
        let offset_s = parameters.time_offset_s(k, &values);
        // Where light is looked at, and how, is found once: from round to round little changes.
        let rates = match kept {
            Some(kept) if kept.far == far => {
                kept.study.set_attitude(pass.attitude)?;
                kept.study.set_time_offset_s(offset_s)?;
                kept.study.bounced_of(pass.target)?
            }
            _ => {
                let mut study = Study::new(pass)?;
                study.set_time_offset_s(offset_s)?;
                let thinned = study.thin(THINNED * study.pass().tolerance)?;
                let rates = study.term_rates()?;
                *kept = Some(Kept { far, study, thinned, single: summed(&rates, false) });
                rates
            }
        };
        let Some(Kept { single, .. }) = kept else { return Ok(None) };
        let mut held = summed(&rates, true);
        let most = held.iter().zip(single.iter()).filter(|(held, single)| *held + *single > 0.0);
        let most = most.fold(0.0_f64, |most, (held, single)| most.max(held / (held + single)));
        // Below the horizon nothing is compared.
        held.mapv_inplace(|v: f64| if v.is_finite() { v } else { 0.0 });
        Ok(Some((held, most)))
    }
}

/// A curve, in whose scene something is to be put.
pub(super) struct OfCurve<'a> {
    pub number: usize,
    pub parameters: &'a Parameters,
    pub fit: &'a Fit,
    pub channels: &'a [String],
    pub study: &'a Study,
    pub magnitudes: bool,
    /// True where albedos of channels become factors of the file's light, not a smooth spectrum.
    pub as_factors: bool,
}

/// Factor of a material's light in a channel; in all where there is none.
pub(super) type LightFactors = Vec<(String, Option<String>, f64)>;

/// Reflectance spectra through the albedos, by the air of a curve, and factors of what no spectrum holds.
pub(super) fn spectra_of(
    of: &OfCurve<'_>,
    warnings: &mut Vec<String>,
) -> Result<(Vec<MaterialSpectrum>, LightFactors), PassFitError> {
    let OfCurve { number, parameters, fit, channels, study, magnitudes, as_factors } = *of;
    let (first, last, step) = KNOTS_NM;
    let knots: Vec<f64> = (first..=last).step_by(step as usize).map(f64::from).collect();
    let air = parameters::transmission(study)?;
    let solved = &fit.parameters[parameters.free.len()..];
    let mut materials: Vec<&str> = Vec::new();
    for (material, _) in &parameters.scales {
        if !materials.contains(&material.as_str()) {
            materials.push(material);
        }
    }
    let (mut found, mut factors) = (Vec::new(), Vec::new());
    for material in materials {
        let Some(own) = study.pass().target.materials.iter().find(|m| m.name == material) else {
            continue;
        };
        let mut bands = Vec::new();
        let mut grey = None;
        // By channel, over the light of the scene as it was.
        let mut over: Vec<(String, f64)> = Vec::new();
        for (k, (of, channel)) in parameters.scales.iter().enumerate() {
            let elsewhere = |curves: &Vec<usize>| -> bool { !curves.contains(&number) };
            if of != material || parameters.linear[k].curves.as_ref().is_some_and(elsewhere) {
                continue;
            }
            let (value, unit) = (solved[k].value, parameters.linear[k].unit);
            match channel {
                None => grey = Some(value),
                Some(_) if magnitudes => grey = Some(value / unit),
                Some(c) => {
                    let Some(station) = place(&study.pass().station, &channels[*c]) else {
                        continue;
                    };
                    over.push((channels[*c].clone(), value / unit));
                    bands.push(Band {
                        name: channels[*c].clone(),
                        weights: band_weights(study, station, air.as_ref(), &knots)?,
                        albedo: value,
                        sigma: solved[k].sigma.unwrap_or(0.0),
                    });
                }
            }
        }
        let one = |(channel, factor): (String, f64)| (material.to_owned(), Some(channel), factor);
        let [before] = own.spectra() else {
            factors.extend(grey.map(|factor| (material.to_owned(), None, factor)));
            factors.extend(over.into_iter().map(one));
            continue;
        };
        if let Some(factor) = grey {
            let reflectance: Vec<f64> = knots.iter().map(|nm| factor * before.at(*nm)).collect();
            if reflectance.iter().any(|r| *r > 1.0 + 1e-9) {
                warnings.push(format!(
                    "{material} would reflect more than came ({factor:.3} times the file's reflectance): the scene with what was found has that as a factor of its light"
                ));
                factors.push((material.to_owned(), None, factor));
                continue;
            }
            let reflectance: Vec<f64> = reflectance.iter().map(|r| r.min(1.0)).collect();
            found.push(MaterialSpectrum::scaled(material, &knots, &reflectance));
        } else if !bands.is_empty() && as_factors {
            factors.extend(over.into_iter().map(one));
        } else if !bands.is_empty() {
            match upsample(&knots, &bands) {
                Ok(spectrum) => {
                    // What a smooth spectrum does not meet is left to a factor.
                    for (channel, wanted, has) in &spectrum.bands {
                        if *has > 0.0 && (wanted / has - 1.0).abs() > MET {
                            factors.push(one((channel.clone(), wanted / has)));
                        }
                    }
                    found.push(MaterialSpectrum {
                        material: material.into(),
                        found: spectrum,
                        upsampled: true,
                    });
                }
                Err(error) => {
                    warnings.push(format!(
                        "{material}: no spectrum: {error}; the scene with what was found keeps the file's, with a factor for each channel"
                    ));
                    factors.extend(over.into_iter().map(one));
                }
            }
        }
    }
    Ok((found, factors))
}

/// Scenes with what was found, and how well each gives the fitted curves again. Curves of one scene share one unless they have values of their own.
pub(super) fn fitted_scenes(
    curves: &[CurveOfScene],
    parameters: &Parameters,
    fit: &Fit,
    channels: &[String],
    (model, bounced): (&StudyModel, &mut [Option<Study>]),
    warnings: &mut Vec<String>,
) -> Result<Vec<FittedScene>, PassFitError> {
    let values: Vec<f64> = fit.parameters.iter().map(|p| p.value).collect();
    let mut all: Vec<FittedScene> = Vec::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for k in 0..curves.len() {
        let same = |g: &&mut Vec<usize>| curves[g[0]].scene.path == curves[k].scene.path;
        match groups.iter_mut().find(same).filter(|_| !parameters.differ()) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    let mut said = Vec::new();
    let mut of_zero_points = 0;
    for group in groups {
        let (number, curve) = (group[0], &curves[group[0]]);
        let Some(study) = model.study(number) else { continue };
        let magnitudes = curve.measured.magnitudes;
        let mut written = |as_factors: bool, said: &mut Vec<String>| {
            let mut scene = curve.scene.clone();
            for (key, value) in parameters.keys(number, &values) {
                scene.set(key, value);
            }
            let of = OfCurve { number, parameters, fit, channels, study, magnitudes, as_factors };
            let (spectra, factors) = spectra_of(&of, said)?;
            for spectrum in spectra {
                let (name, found) = (&spectrum.material, &spectrum.found);
                if !scene.set_reflectance(name, &found.wavelength_nm, &found.reflectance) {
                    said.push(format!(
                        "the scene with what was found keeps the reflectance of {name}: its model has none that could be set"
                    ));
                }
            }
            for (material, channel, factor) in factors {
                let keys = match &channel {
                    Some(channel) => vec!["light", material.as_str(), "channel", channel.as_str()],
                    None => vec!["light", material.as_str(), "all"],
                };
                scene.correct(&keys, 1.0, &|f| f * factor);
            }
            let beyond = parameters.correct(number, &values, channels, magnitudes, &mut scene);
            cover(&mut scene, &group, curves);
            scene.remark("Fitted by sunglint fit.");
            let text = scene.text()?;
            let again = Scene::parse(&curve.scene.path, &text)?;
            // It must be one that can be read.
            again.target().map_err(|why| PassFitError::FittedScene { why })?;
            let mut difference = 0.0_f64;
            for k in &group {
                let zero = parameters.zero_factors(*k, &values, curves[*k].measured.times.len());
                let of = &fit.curves[*k];
                let by = (model.study(*k), bounced.get_mut(*k).and_then(Option::as_mut));
                let off = apart(&curves[*k], again.clone(), (of, &zero), by, channels)?;
                difference = difference.max(off);
            }
            Ok::<_, PassFitError>((text, difference, beyond))
        };
        let (mut text, mut difference, beyond) = written(false, &mut said)?;
        if difference > SAME {
            // A smooth spectrum has the albedo of a channel, but not how the air colours it from airmass to airmass: that is the file's spectrum's.
            let mut words = Vec::new();
            let other = written(true, &mut words)?;
            if other.1 < difference {
                said.push(format!(
                    "smooth spectra through the albedos would miss the fit by {difference:.1e}: the scene with what was found keeps the file's spectra, with a factor for each channel"
                ));
                (text, difference) = (other.0, other.1);
            }
        }
        if !beyond.is_empty() {
            let (zero, rest): (Vec<&str>, Vec<&str>) =
                beyond.iter().map(String::as_str).partition(|name| name.starts_with("zero_point"));
            of_zero_points += zero.len();
            let beyond = rest;
            said.extend((!beyond.is_empty()).then(|| format!(
                "the scene with what was found does not hold {}: no key of a scene says that of magnitudes above the air",
                beyond.join(", ")
            )));
        }
        let stem = curve.scene.name();
        let name = match all.iter().any(|s| s.name == stem) {
            true => format!("{stem}_{}", number + 1),
            false => stem,
        };
        let same = difference <= SAME;
        let measured = group.iter().map(|k| curves[*k].measured.name()).collect();
        all.push(FittedScene {
            name,
            curves: measured,
            difference,
            same,
            incomplete: beyond,
            text,
        });
    }
    if of_zero_points > 0 {
        said.push(format!(
            "no scene holds the {of_zero_points} errors of zero points: `compare` of a scene with what was found leaves them in the residuals"
        ));
    }
    for word in said {
        if !warnings.contains(&word) {
            warnings.push(word);
        }
    }
    Ok(all)
}

/// Gives a scene times that hold those of its curves, where its own do not.
fn cover(scene: &mut Scene, group: &[usize], curves: &[CurveOfScene]) {
    // A table of observations is what was fitted.
    if scene.has_observations() {
        return;
    }
    let ends: Vec<(Epoch, Epoch)> = group.iter().map(|k| curves[*k].measured.ends()).collect();
    let Some(first) = ends.iter().map(|e| e.0).min() else { return };
    let Some(last) = ends.iter().map(|e| e.1).max() else { return };
    let station = curves[group[0]].station.clone();
    let own = scene.ends(Overrides { station, ..Overrides::default() });
    if own.is_some_and(|(a, b)| a <= first && last <= b) {
        return;
    }
    let measured = &curves[group[0]].measured;
    let seconds: Vec<f64> =
        measured.times.iter().map(|t| tai_nanoseconds(*t) as f64 * 1e-9).collect();
    let length = (tai_nanoseconds(last) - tai_nanoseconds(first)) as f64 * 1e-9;
    let usual = sunglint_radiometry::light_curve::usual_step_s(&seconds);
    let usual = if usual > 0.0 { usual } else { 1.0 };
    let steps = (length / usual).ceil().clamp(1.0, MOST_STEPS);
    let exposure = median(measured.exposure_s.clone()).filter(|e| *e > 0.0).unwrap_or(0.1);
    // Up to a nanosecond each way, so that rounding loses no sample.
    let step = ((length / steps) * 1e6).ceil().max(1.0) * 1e-6;
    let to = first + hifitime::Duration::from_seconds(steps * step);
    scene.set_times(&format_utc(first, 9), &format_utc(to, 9), step, exposure);
}

/// Root of the mean square difference of a curve that a scene gives from the fitted one: mag for magnitudes, else over the root of the mean square rate. It is the scene's text that is looked at: its light is
/// averaged over the moments of the fit's, and light between its parts found by the patches of the fit's last round, where the scene leaves their rest as it was.
fn apart(
    curve: &CurveOfScene,
    scene: Scene,
    (fitted, zero): (&FittedCurve, &[f64]),
    (direct, bounced): (Option<&Study>, Option<&mut Study>),
    channels: &[String],
) -> Result<f64, PassFitError> {
    let mut idle = Vec::new();
    let mut pass = pass_of(&CurveOfScene { scene, ..curve.clone() }, &mut idle)?;
    let tolerance = THINNED * pass.tolerance;
    // Factors of single materials' light are none of light between several.
    let others = |pass: &Pass| Correction { light: BTreeMap::new(), ..pass.correction.clone() };
    let between = match bounced.filter(|study| others(study.pass()) == others(&pass)) {
        Some(study) => {
            study.set_attitude(pass.attitude.clone())?;
            pass.effects.inter_reflection = Switch::Off;
            Some(study.bounced_of(pass.target.clone())?)
        }
        None => None,
    };
    let mut study = Study::new(pass)?;
    match direct {
        Some(other) => study.average_as(other)?,
        None => study.average(tolerance).map(|_| ())?,
    }
    study.thin(tolerance)?;
    let rates = study.term_rates()?;
    let station = &study.pass().station;
    let places: Vec<Option<usize>> = channels.iter().map(|c| place(station, c)).collect();
    let light = |rates: &TermRates, i: usize, c: usize| -> Option<f64> {
        Some(match (curve.measured.magnitudes, places[c]) {
            (true, _) => rates.fluxes.slice(ndarray::s![i, V, ..]).sum(),
            (false, Some(own)) => rates.rates_hz.slice(ndarray::s![i, own, ..]).sum(),
            (false, None) => return None,
        })
    };
    let (mut square, mut size, mut count) = (0.0, 0.0, 0.0);
    for ((i, c), model) in fitted.model.indexed_iter() {
        let Some(own) = light(&rates, i, c) else { continue };
        let all = own + between.as_ref().and_then(|rates| light(rates, i, c)).unwrap_or(0.0);
        if fitted.pull[[i, c]].is_nan() || !all.is_finite() {
            continue;
        }
        count += 1.0;
        if curve.measured.magnitudes {
            // No key of a scene holds an error of a zero point.
            let apart = 2.5 * (all * zero[i] / model).log10();
            if apart.is_finite() {
                square += apart * apart;
                size += 1.0;
            }
        } else {
            square += (all - model).powi(2);
            size += model * model;
        }
    }
    if curve.measured.magnitudes {
        size = count;
    }
    Ok(if size > 0.0 { (square / size).sqrt() } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Truth: by hand: G(h) = 8 − 0.6 (h − 8) has the fixed point 8; rounds without the secant swing about it (12.8, 5.12, 9.73 …). One
    /// round for a first value, and the second, which knows the slope, is there. Tolerance: rounding.
    #[test]
    fn the_secant_meets_a_fixed_point_that_rounds_swing_about() {
        let g = |h: f64| 8.0 - 0.6 * (h - 8.0);
        let mut held = Held::default();
        let mut h = 0.0;
        let mut all = Vec::new();
        for _ in 0..2 {
            h = held.next(array![[g(h)]])[[0, 0]];
            all.push(h);
        }
        assert!((all[0] - 12.8).abs() < 1e-12 && (all[1] - 8.0).abs() < 1e-9, "{all:?}");
    }

    /// Truth: by hand: two channels with other slopes, −0.6 to the fixed point 8 and 0.2 to 1. Each secant meets its own in the second round; one secant for both would meet neither. Tolerance: rounding.
    #[test]
    fn each_channel_has_its_own_secant() {
        let mut held = Held::default();
        let mut h = Array2::<f64>::zeros((1, 2));
        for _ in 0..2 {
            h = held.next(array![[8.0 - 0.6 * (h[[0, 0]] - 8.0), 1.0 + 0.2 * (h[[0, 1]] - 1.0)]]);
        }
        assert!((h[[0, 0]] - 8.0).abs() < 1e-9 && (h[[0, 1]] - 1.0).abs() < 1e-9, "{h}");
    }

    /// Truth: by hand: light of 5 that a rough look left out, and that hangs on nothing. The first round of a closer look must hold it: a secant through both looks would hold 0, and the fit would not move.
    #[test]
    fn another_look_begins_anew() {
        let mut held = Held::default();
        assert_eq!(held.next(array![[0.0]]), array![[0.0]]);
        held.forget();
        assert_eq!(held.next(array![[5.0]]), array![[5.0]]);
        assert_eq!(held.next(array![[5.0]]), array![[5.0]]);
    }
}
