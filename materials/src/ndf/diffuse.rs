//! Diffuse light in retro-reflection: a lobe and a constant, tested against a lobe alone.
//!
//! Diffuse light is no microfacets': taken for them it makes the lobe far too wide. A Lambert sample of reflectance ρ throws ρ/π back at all angles, so that it
//! shows where the lobe has ended. It is taken off only where it is seen: where retro-reflection stays the same over a stretch of angles that the lobe has left.

use super::shape::{EVERY_ALPHA, Reading, fit, golden, ln_shape};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use sunglint_simulator::surface::Distribution;

/// Origin of what is known of diffuse light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
pub enum DiffuseOrigin {
    /// A lobe alone says the readings as well.
    #[default]
    None,
    /// From the angles at which the lobe has ended; it was taken off before D was found.
    Fitted,
    /// The readings allow it and do not decide it: nothing was taken off.
    Unknown,
}

/// Diffuse light beside the lobe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Default)]
pub struct DiffuseLight {
    /// Retro-reflection of the diffuse part, sr⁻¹: ρ/π of Lambert's law; what it may be at most where it is not decided.
    pub f_per_sr: f64,
    /// Largest error of it, sr⁻¹: by the kind of the lobe, and by the readings.
    pub bound_per_sr: f64,
    /// Origin of the number.
    pub origin: DiffuseOrigin,
}

impl DiffuseLight {
    /// Reflectance ρ of a Lambert surface that throws as much back.
    pub fn reflectance(&self) -> f64 {
        PI * self.f_per_sr
    }

    /// Retro-reflection that is taken off, sr⁻¹.
    pub fn taken_per_sr(&self) -> f64 {
        if self.origin == DiffuseOrigin::Fitted { self.f_per_sr } else { 0.0 }
    }
}

/// The misfit of a lobe with diffuse light over that of one alone, at most: to take it off, and to speak of it.
const BETTER: f64 = 0.5;
const SOME: f64 = 0.8;
/// The lobe's peak over the diffuse light, at least.
const LEAST_PEAK: f64 = 0.2;
/// Diffuse light is this many times as bright as the tail of a lobe that has the peak's core, at least; and the core is above this part of the peak.
const LEAST_OVER_TAIL: f64 = 3.0;
const CORE: f64 = 3.0;
/// A misfit of up to this many times the readings' own scatter says all that is in them: no other tail is then called for.
const ADEQUATE: f64 = 1.3;
/// It is seen where it is this part of the whole, over so many readings and degrees.
const SEEN: f64 = 0.8;
const LEAST_READINGS: usize = 6;
const LEAST_STRETCH_DEG: f64 = 10.0;
/// Largest change of ln f over that stretch.
const LEVEL: f64 = 0.25;
/// A floor rises with one over the cosine where at least this part of it does.
const LEAST_RISE: f64 = 0.5;
/// The lobe is followed as long as it is this part of the diffuse light, and so many standard deviations.
const FOLLOWED: f64 = 0.1;
const SIGMAS: f64 = 4.0;

/// A lobe with diffuse light.
#[derive(Debug, Clone, Copy)]
struct Both {
    distribution: Distribution,
    alpha: f64,
    f0: f64,
    diffuse: f64,
    misfit: f64,
}

/// The best strengths of a lobe and of diffuse light of known shapes: ln F₀, ln of diffuse over F₀, mean square of ln f.
fn strengths(shape: &[f64], floor: &[f64], readings: &[Reading]) -> (f64, f64, f64) {
    let judge = |ln_ratio: f64| {
        let ratio = ln_ratio.exp();
        let (mut w, mut r, mut rr) = (0.0, 0.0, 0.0);
        for ((shape, floor), (_, ln_f, weight)) in shape.iter().zip(floor).zip(readings) {
            let left = ln_f - (shape + ratio * floor).ln();
            w += weight;
            r += weight * left;
            rr += weight * left * left;
        }
        let mean = r / w;
        ((rr / w - mean * mean).max(0.0), mean)
    };
    let top = shape.iter().copied().fold(f64::MIN_POSITIVE, f64::max).ln();
    let at = |k: usize| top - 30.0 + 1.5 * k as f64;
    let best = (0..=22).min_by(|a, b| judge(at(*a)).0.total_cmp(&judge(at(*b)).0)).unwrap_or(0);
    let ln_ratio = golden(at(best) - 1.5, at(best) + 1.5, |x| judge(x).0);
    let (square, mean) = judge(ln_ratio);
    (mean, ln_ratio, square)
}

fn shapes(distribution: Distribution, alpha: f64, readings: &[Reading]) -> Vec<f64> {
    readings.iter().map(|(theta, ..)| ln_shape(distribution, alpha, *theta).exp()).collect()
}

/// Diffuse light that is the same at all angles, mixed with `rise` of what grows as one over the cosine.
fn floors(rise: f64, readings: &[Reading]) -> Vec<f64> {
    readings.iter().map(|(theta, ..)| 1.0 - rise + rise / theta.cos().max(1e-3)).collect()
}

fn both(distribution: Distribution, rise: f64, readings: &[Reading]) -> Both {
    let floor = floors(rise, readings);
    let with = |alpha: f64| strengths(&shapes(distribution, alpha, readings), &floor, readings);
    let judge = |ln_alpha: f64| with(ln_alpha.exp()).2;
    let (from, to) = (EVERY_ALPHA.0.ln(), EVERY_ALPHA.1.ln());
    let at = |k: usize| from + (to - from) * k as f64 / 32.0;
    let best = (0..=32).min_by(|a, b| judge(at(*a)).total_cmp(&judge(at(*b)))).unwrap_or(16);
    let ln_alpha = golden(at(best.saturating_sub(1)), at((best + 1).min(32)), judge);
    let alpha = ln_alpha.exp();
    let (ln_f0, ln_ratio, square) = with(alpha);
    let (f0, diffuse) = (ln_f0.exp(), (ln_f0 + ln_ratio).exp());
    Both { distribution, alpha, f0, diffuse, misfit: square.sqrt() }
}

/// Both kinds of lobe with diffuse light, the better first.
fn kinds(rise: f64, readings: &[Reading]) -> [Both; 2] {
    let mut kinds = [Distribution::Beckmann, Distribution::Ggx].map(|d| both(d, rise, readings));
    kinds.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
    kinds
}

/// Looks for a floor that rises as one over the cosine beyond the lobe, as f of readings with a dark offset does, which is divided by the cosine with the sample's light. Returns its f towards the normal, sr⁻¹, where it is told from light
/// that is the same at all angles, from a lobe alone, and is most of the light over a stretch of angles.
pub(super) fn rising(readings: &[Reading]) -> Option<f64> {
    let alone = |d: Distribution| fit(d, readings, EVERY_ALPHA).misfit;
    let alone = alone(Distribution::Beckmann).min(alone(Distribution::Ggx));
    let enough = ADEQUATE * noise(readings);
    if alone <= enough {
        return None;
    }
    let level_alone = kinds(0.0, readings)[0].misfit.min(alone);
    if level_alone <= enough {
        return None;
    }
    let tried = [0.25, 0.5, 0.75, 1.0].map(|rise| (rise, kinds(rise, readings)[0]));
    let (rise, best) = tried.into_iter().min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit))?;
    let lobe = |theta: f64| best.f0 * ln_shape(best.distribution, best.alpha, theta).exp();
    let seen: Vec<Reading> = (readings.iter().zip(floors(rise, readings)))
        .filter(|(r, floor)| best.diffuse * floor >= SEEN * (best.diffuse * floor + lobe(r.0)))
        .map(|((theta, ln_f, weight), floor)| (*theta, ln_f - floor.ln(), *weight))
        .collect();
    let (level, scatter) = level(&seen.iter().collect::<Vec<_>>());
    let told = rise >= LEAST_RISE
        && best.misfit < BETTER * level_alone
        && level <= LEVEL + 2.0 * scatter / (seen.len().max(1) as f64).sqrt();
    told.then_some(rise * best.diffuse)
}

/// Looks for diffuse light in readings (angle from the normal in radians, ln f, weight); `alone` is the misfit of the best lobe alone over the same readings.
pub(super) fn find(readings: &[Reading], alone: f64) -> DiffuseLight {
    let [best, other] = kinds(0.0, readings);
    if !(best.misfit < SOME * alone && best.diffuse.is_finite() && best.f0.is_finite())
        || alone < 1e-6
    {
        return DiffuseLight::default();
    }
    let lobe = |theta: f64| best.f0 * ln_shape(best.distribution, best.alpha, theta).exp();
    let peak = readings.iter().map(|r| lobe(r.0)).fold(0.0, f64::max);
    // Where the lobe has ended.
    let is_seen = |r: &&Reading| best.diffuse >= SEEN * (best.diffuse + lobe(r.0));
    let seen: Vec<&Reading> = readings.iter().filter(is_seen).collect();
    let (level, scatter) = level(&seen);
    // Where no reading is of the diffuse light alone, nothing bounds it.
    let by_scatter = if scatter.is_finite() && !seen.is_empty() {
        best.diffuse * scatter / (seen.len() as f64).sqrt()
    } else {
        best.diffuse
    };
    let off =
        if other.misfit < 2.0 * best.misfit { (other.diffuse - best.diffuse).abs() } else { 0.0 };
    let bound_per_sr = if off.is_finite() { off.max(2.0 * by_scatter) } else { best.diffuse };
    // A lobe's own tail is as level as diffuse light only beyond 40°: where the readings between core and tail are met within their scatter, it is not that.
    let is_met = best.misfit <= ADEQUATE * noise(readings);
    let is_fitted = best.misfit < BETTER * alone
        && (is_met || best.diffuse > LEAST_OVER_TAIL * tail_of_core(readings, &seen, best.diffuse))
        && peak > LEAST_PEAK * best.diffuse
        && level <= LEVEL + 2.0 * scatter / (seen.len().max(1) as f64).sqrt()
        && off < 0.5 * best.diffuse;
    let origin = if is_fitted { DiffuseOrigin::Fitted } else { DiffuseOrigin::Unknown };
    DiffuseLight { f_per_sr: best.diffuse, bound_per_sr, origin }
}

/// Scatter of ln f, rms, of readings about the straight lines through their neighbours; 0 of fewer than three.
fn noise(readings: &[Reading]) -> f64 {
    let off = readings.windows(3).filter(|w| w[2].0 > w[0].0).map(|w| {
        let t = (w[1].0 - w[0].0) / (w[2].0 - w[0].0);
        let off = w[1].1 - (1.0 - t) * w[0].1 - t * w[2].1;
        off * off / (1.0 + t * t + (1.0 - t) * (1.0 - t))
    });
    let mut off: Vec<f64> = off.collect();
    if off.is_empty() {
        return 0.0;
    }
    // The flanks of a lobe bend: the lower three quarters are the readings' own. 0.3686 of a normal distribution's variance is left without its largest quarter.
    off.sort_by(f64::total_cmp);
    let kept = &off[..(off.len() * 3).div_ceil(4)];
    (kept.iter().sum::<f64>() / kept.len() as f64 / 0.3686).sqrt()
}

/// Mean retro-reflection over `seen` of a GGX lobe that is as the peak is: its tail, (α/sin²θ)² F₀/(4π cos²θ), is as level between 40 and 65° as diffuse light.
fn tail_of_core(readings: &[Reading], seen: &[&Reading], diffuse: f64) -> f64 {
    let top = readings.iter().map(|r| r.1.exp() - diffuse).fold(0.0, f64::max);
    let rest = |r: &Reading| (r.0, r.1.exp() - diffuse, r.2);
    let core: Vec<Reading> = readings
        .iter()
        .map(rest)
        .filter(|r| r.1 > top / CORE)
        .map(|(theta, f, _)| (theta, f.ln(), 1.0))
        .collect();
    if core.len() < 4 || seen.is_empty() {
        return 0.0;
    }
    let fit = fit(Distribution::Ggx, &core, EVERY_ALPHA);
    let tail = |r: &&Reading| fit.f0 * ln_shape(Distribution::Ggx, fit.alpha, r.0).exp();
    seen.iter().map(tail).sum::<f64>() / seen.len() as f64
}

/// Change of ln f over readings by a straight line in the angle, and their scatter about it; infinite where they are too few or too near one another.
fn level(seen: &[&Reading]) -> (f64, f64) {
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for r in seen {
        least = least.min(r.0.abs());
        most = most.max(r.0.abs());
    }
    let stretch = most - least;
    if seen.len() < LEAST_READINGS || stretch.to_degrees() < LEAST_STRETCH_DEG {
        return (f64::INFINITY, f64::INFINITY);
    }
    let n = seen.len() as f64;
    let (mx, my) = (
        seen.iter().map(|r| r.0.abs()).sum::<f64>() / n,
        seen.iter().map(|r| r.1).sum::<f64>() / n,
    );
    let (mut xx, mut xy) = (0.0, 0.0);
    for r in seen {
        xx += (r.0.abs() - mx).powi(2);
        xy += (r.0.abs() - mx) * (r.1 - my);
    }
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    let left = seen.iter().map(|r| (r.1 - my - slope * (r.0.abs() - mx)).powi(2)).sum::<f64>();
    ((slope * stretch).abs(), (left / n).sqrt())
}

/// The diffuse light of other readings at the same angles, with lobes of the shapes that were found.
pub(super) fn again(
    found: &DiffuseLight,
    readings: &[Reading],
    shape: (Distribution, f64),
) -> DiffuseLight {
    if found.origin != DiffuseOrigin::Fitted {
        return *found;
    }
    let floor = floors(0.0, readings);
    let (ln_f0, ln_ratio, _) = strengths(&shapes(shape.0, shape.1, readings), &floor, readings);
    let f_per_sr = (ln_f0 + ln_ratio).exp();
    if f_per_sr.is_finite() { DiffuseLight { f_per_sr, ..*found } } else { *found }
}

/// The readings of the lobe: without the diffuse light, as far from the normal as the lobe can be followed. `known` says whether weights are 1/σ² of ln f.
pub(super) fn taken_off(readings: &[Reading], diffuse: &DiffuseLight, known: bool) -> Vec<Reading> {
    let off = diffuse.taken_per_sr();
    if off <= 0.0 {
        return readings.to_vec();
    }
    let lobe = |r: &Reading| {
        let f = r.1.exp();
        let sigma = if known { f / r.2.sqrt() } else { 0.0 };
        let rest = f - off;
        let least = (FOLLOWED * off).max(SIGMAS * sigma).max(2.0 * diffuse.bound_per_sr);
        // Weights in ln f of the rest.
        (rest > least).then(|| (r.0, rest.ln(), r.2 * (rest / f).powi(2)))
    };
    let middle = readings.partition_point(|r| r.0 < 0.0);
    // A single reading that noise has lowered ends nothing.
    let run = |order: &mut dyn Iterator<Item = usize>| {
        let (mut found, mut gone) = (Vec::new(), 0);
        for k in order {
            match lobe(&readings[k]) {
                Some(r) => {
                    gone = 0;
                    found.push(r);
                }
                None => gone += 1,
            }
            if gone == 2 {
                break;
            }
        }
        found
    };
    let mut all = run(&mut (0..middle).rev());
    all.reverse();
    all.extend(run(&mut (middle..readings.len())));
    all
}
