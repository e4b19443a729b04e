//! Search for the normals of flat parts: glints that a body lacks are proposed by what a fit without them leaves.
//!
//! A glint is narrow in the direction of the part's normal: places drawn over a box do not meet it. So parts whose normal is free are hidden first. Then, one after the other, the light that
//! the part would have alone is computed for normals all over the sphere, straight from its material's law, and set beside the residuals (a matched filter): whatever the linear parameters can
//! do already is taken out of both, the amplitude lies between 0 and the largest albedo. The best normals are refined, and each is tried by a descent with all light.

use super::PassFitError;
use super::parameters::{Normal, Parameters};
use crate::measured::CurveOfScene;
use crate::solver::{Data, Fit, Model as _, StudyModel, Unit};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;
use sunglint_numerics::basis::{Basis, dot};
use sunglint_numerics::sphere::spread;
use sunglint_simulator::light::Source;
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::{Shape, Target};

/// Samples of a channel between which the mirrored normal turns by less are one, degrees; if they are neighbours.
const ONE_DEG: f64 = 0.3;
/// More moments than this are not told apart: neighbours are joined.
const MOST_MOMENTS: usize = 2_000;
/// Spacing of the normals that are tried, as a part of the lobe's half-width, and its limits, degrees.
const SPACING: f64 = 0.7;
const SPACING_DEG: (f64, f64) = (1.5, 6.0);
/// Roughnesses that are tried where the roughness is free.
const ROUGHNESSES: usize = 4;
/// The least roughness that is tried unless the range begins above it.
const LEAST_ROUGHNESS: f64 = 0.03;
/// Proposals that are looked at closely, those that are given back, and how far apart they are, degrees.
const REFINED: usize = 8;
const PROPOSED: usize = 2;
const APART_DEG: f64 = 5.0;
/// A refined normal is found to this, degrees.
const FINEST_DEG: f64 = 0.1;
/// A proposal that lowers χ² (over its degrees of freedom) by less is none.
const LEAST_GAIN: f64 = 16.0;
/// A proposal that gains less than this part of the best one is not worth a descent.
const WORTH: f64 = 0.6;

/// A normal that the residuals ask for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Proposal {
    /// Azimuth and tilt of the normal in the body's axes, degrees.
    pub azimuth_deg: f64,
    pub tilt_deg: f64,
    /// Roughness; `None` where it is not free.
    pub roughness: Option<f64>,
    /// Gain in χ², over the reduced χ² of the fit.
    pub gain: f64,
}

/// One moment of one channel: directions in the body's axes, and what makes weights of the part's light to whitened rates.
struct Moment {
    sun: DVec3,
    observer: DVec3,
    /// Rate of a weight of 1 m² sr⁻¹ of each spectrum of the material, over the noise.
    unit: Vec<f64>,
    /// Measured less model over the noise.
    left: f64,
}

/// A flat part: its area and whether it has a side to +z and to −z.
struct Plate {
    area_m2: f64,
    sides: [bool; 2],
}

/// The plate of a name and its material.
pub(super) fn plate<'a>(
    target: &'a Target,
    part: &str,
) -> Result<(f64, [bool; 2], &'a str), String> {
    let Some(own) = target.parts.iter().find(|p| p.name == part) else {
        let known: Vec<&str> = target.parts.iter().map(|p| p.name.as_str()).collect();
        return Err(format!("there is no part {part}; there are {}", known.join(", ")));
    };
    if own.hinge.is_some() {
        return Err(format!(
            "{part} is on a hinge, so that its normal turns with the Sun: only the normal of a part that is fixed to the body is searched for"
        ));
    }
    let Shape::Mesh(mesh) = &own.shape else {
        return Err(format!("{part} is round: only a plate has one normal"));
    };
    let (mut areas, mut flat) = ([0.0; 2], true);
    for k in 0..mesh.triangles.len() {
        let vector = mesh.area_vector(k);
        flat &= vector.x.hypot(vector.y) <= 1e-9 * vector.length();
        areas[usize::from(vector.z < 0.0)] += vector.length();
    }
    if !flat || areas == [0.0; 2] {
        return Err(format!("{part} is not flat: only a plate has one normal"));
    }
    let material = target.materials.get(own.material).map_or("", |m| m.name.as_str());
    Ok((areas[0].max(areas[1]), areas.map(|a| a > 0.0), material))
}

/// Azimuth (−180 to 180) and tilt (0 to 180) of a direction, degrees. They are the first two of the Euler angles `euler_zyx_deg` of a part whose normal (its +z axis) is this direction; the third is 0.
fn angles_deg(normal: DVec3) -> (f64, f64) {
    (normal.y.atan2(normal.x).to_degrees(), normal.x.hypot(normal.y).atan2(normal.z).to_degrees())
}

/// Rotation from the axes of a part with these Euler angles to the body's axes: about y by the tilt, then about z by the azimuth.
fn rotation(azimuth_deg: f64, tilt_deg: f64) -> DQuat {
    DQuat::from_rotation_z(azimuth_deg.to_radians()) * DQuat::from_rotation_y(tilt_deg.to_radians())
}

/// The residuals of a fit, ready for a part's light to be set beside them.
struct Left {
    moments: Vec<Moment>,
    /// Columns of the linear parameters.
    known: Basis,
    /// χ² over the degrees of freedom.
    scale: f64,
}

/// Light of a normal beside the residuals.
struct Tried<'a> {
    left: &'a Left,
    plate: &'a Plate,
    /// The largest factor of the material's light.
    most: f64,
}

impl Tried<'_> {
    /// Gain in χ² with the part at a normal.
    fn gain(&self, material: &Material, azimuth_deg: f64, tilt_deg: f64) -> f64 {
        let turn = rotation(azimuth_deg, tilt_deg);
        let back = turn.conjugate();
        let normal = turn * DVec3::Z;
        let mut light = vec![0.0; self.left.moments.len()];
        let mut weights = vec![0.0; material.spectra().len()];
        let mut any = false;
        for (light, moment) in light.iter_mut().zip(&self.left.moments) {
            let (i, o) = (moment.sun.dot(normal), moment.observer.dot(normal));
            let side = if i > 0.0 && o > 0.0 && self.plate.sides[0] {
                1.0
            } else if i < 0.0 && o < 0.0 && self.plate.sides[1] {
                -1.0
            } else {
                continue;
            };
            let to = |d: DVec3| DVec3::new(1.0, side, side) * (back * d);
            weights.fill(0.0);
            material.add_weights(to(moment.sun), to(moment.observer), 1.0, &mut weights);
            *light = self.plate.area_m2 * i * o * dot(&weights, &moment.unit);
            any |= *light > 0.0;
        }
        if !any {
            return 0.0;
        }
        self.left.known.project_out(&mut light);
        let size = dot(&light, &light);
        let along: f64 = light.iter().zip(&self.left.moments).map(|(l, m)| l * m.left).sum();
        if !(size > 0.0 && along > 0.0) {
            return 0.0;
        }
        let factor = (along / size).min(self.most);
        factor * (2.0 * along - factor * size) / self.left.scale
    }
}

/// Normals of a part that the residuals of a fit ask for, the best first; none where none helps.
///
/// # Errors
/// Values for which there is no model.
pub(super) fn propose(
    curves: &[CurveOfScene],
    data: &[Data],
    model: &mut StudyModel,
    parameters: &Parameters,
    channels: &[String],
    fit: &Fit,
    normal: &Normal,
) -> Result<Vec<Proposal>, PassFitError> {
    let scene = &curves[0].scene;
    let target = scene.target().map_err(|why| PassFitError::FittedScene { why })?;
    let (area_m2, sides, _) = plate(&target, &normal.part)
        .map_err(|why| PassFitError::Normal { part: normal.part.clone(), why })?;
    let plate = Plate { area_m2, sides };
    // The material with each roughness that is tried.
    let roughness = normal.roughness.as_ref().map(|(k, _)| &parameters.free[*k]);
    let rough: Vec<Option<f64>> = match roughness {
        None => vec![None],
        Some(free) => roughnesses(free.low, free.high).into_iter().map(Some).collect(),
    };
    let materials: Vec<(Option<f64>, Material)> = rough
        .into_iter()
        .map(|own| {
            let mut scene = scene.clone();
            if let (Some(own), Some((_, key))) = (own, &normal.roughness) {
                scene.set(key, own);
            }
            let target = scene.target().map_err(|why| PassFitError::FittedScene { why })?;
            let found = target.materials.into_iter().find(|m| m.name == normal.material);
            let gone = || PassFitError::FittedScene { why: format!("no {}", normal.material) };
            Ok((own, found.ok_or_else(gone)?))
        })
        .collect::<Result<_, PassFitError>>()?;
    let left = left(curves, data, model, parameters, channels, fit, &normal.material)?;
    let tried = Tried { left: &left, plate: &plate, most: normal.most };

    let mut all: Vec<(f64, DVec3, usize)> = Vec::new();
    for (k, (_, material)) in materials.iter().enumerate() {
        let alpha = material.narrowest_lobe().map_or(1.0, |(_, alpha)| alpha);
        let (least, most) = SPACING_DEG;
        let spacing = (SPACING * alpha.atan().to_degrees()).clamp(least, most).to_radians();
        let directions = spread((4.0 * PI / spacing.powi(2)).ceil() as usize, 0.0);
        let gains: Vec<(f64, DVec3, usize)> = directions
            .into_par_iter()
            .map(|d| {
                let (azimuth, tilt) = angles_deg(d);
                (tried.gain(material, azimuth, tilt), d, k)
            })
            .filter(|(gain, _, _)| *gain > 0.0)
            .collect();
        all.extend(gains);
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<(f64, DVec3, usize)> = Vec::new();
    for one in all {
        if chosen.len() == REFINED {
            break;
        }
        if chosen.iter().all(|c| c.1.angle_between(one.1).to_degrees() > APART_DEG) {
            chosen.push(one);
        }
    }
    let mut found: Vec<Proposal> = chosen
        .into_par_iter()
        .map(|(gain, direction, k)| {
            let mut best = (gain, angles_deg(direction), k);
            let mut step = SPACING_DEG.1 / 2.0;
            while step > FINEST_DEG {
                let (azimuth, tilt) = best.1;
                let own = rotation(azimuth, tilt);
                let mut better = false;
                for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                    let aside = (step * DVec3::new(x, y, 0.0)).to_array().map(f64::to_radians);
                    let d = own * DVec3::new(aside[0], aside[1], 1.0).normalize();
                    let near = k_near(best.2, materials.len());
                    for other in near {
                        let gain =
                            tried.gain(&materials[other].1, angles_deg(d).0, angles_deg(d).1);
                        if gain > best.0 {
                            best = (gain, angles_deg(d), other);
                            better = true;
                        }
                    }
                }
                if !better {
                    step *= 0.5;
                }
            }
            let (gain, (azimuth_deg, tilt_deg), k) = best;
            Proposal { azimuth_deg, tilt_deg, roughness: materials[k].0, gain }
        })
        .collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let most = found.first().map_or(0.0, |p| p.gain);
    let direction = |p: &Proposal| rotation(p.azimuth_deg, p.tilt_deg) * DVec3::Z;
    // Refined ones may have met.
    let mut apart: Vec<Proposal> = Vec::new();
    for one in found.into_iter().filter(|p| p.gain > LEAST_GAIN && p.gain > WORTH * most) {
        let angle = |p: &Proposal| direction(p).angle_between(direction(&one)).to_degrees();
        if apart.len() < PROPOSED && apart.iter().all(|p| angle(p) > APART_DEG) {
            apart.push(one);
        }
    }
    Ok(apart)
}

/// Roughnesses that are tried within a range: a geometric row up to its end, from [`LEAST_ROUGHNESS`] or what of the range is nearest to it. One where that is the end itself.
fn roughnesses(low: f64, high: f64) -> Vec<f64> {
    // Not `clamp`: a range may lie below the least roughness as a whole.
    let first = LEAST_ROUGHNESS.max(low).min(high);
    if first >= high {
        return vec![high];
    }
    let step = (high / first).powf(1.0 / (ROUGHNESSES - 1) as f64);
    (0..ROUGHNESSES).map(|k| first * step.powi(k as i32)).collect()
}

/// A number and its neighbours below `count`.
fn k_near(k: usize, count: usize) -> Vec<usize> {
    (k.saturating_sub(1)..=(k + 1).min(count - 1)).collect()
}

/// The residuals and what the linear parameters do, by moments; of each channel for itself.
fn left(
    curves: &[CurveOfScene],
    data: &[Data],
    model: &mut StudyModel,
    parameters: &Parameters,
    channels: &[String],
    fit: &Fit,
    material: &str,
) -> Result<Left, PassFitError> {
    let searched: Vec<f64> =
        fit.parameters[..parameters.free.len()].iter().map(|p| p.value).collect();
    let solved = &fit.parameters[parameters.free.len()..];
    let columns = model.columns(&searched)?;
    let mut moments = Vec::new();
    let mut design: Vec<Vec<f64>> = vec![Vec::new(); parameters.linear.len()];
    let samples: usize = data.iter().map(Data::count).sum();
    let least = samples.div_ceil(MOST_MOMENTS).max(1);
    for (k, (curve, own)) in data.iter().zip(&columns).enumerate() {
        let Some(study) = model.study(k) else { continue };
        let unit = study.unit_rates();
        let Some(factors) = model.factors(k, &searched) else { continue };
        let n = study.places().len();
        let of_material: Vec<usize> = (unit.terms.iter().enumerate())
            .filter(|(_, t)| t.source == Source::Direct)
            .filter(|(_, t)| {
                t.material.is_some_and(|m| study.pass().target.materials[m].name == material)
            })
            .map(|(t, _)| t)
            .collect();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by_key(|i| study.places()[*i].geometry.epoch);
        let mirrored = |i: usize| {
            let place = &study.places()[i];
            (place.sun_body + place.observer_body).normalize_or_zero()
        };
        let places: Vec<(bool, Option<usize>)> = match super::unit(&curves[k], study, channels) {
            Unit::Band(band) => vec![(true, Some(band))],
            Unit::Channels(of) => of.into_iter().map(|c| (false, c)).collect(),
        };
        for (c, (above, place)) in places.into_iter().enumerate() {
            let Some(place) = place else { continue };
            let used: Vec<usize> = order.iter().copied().filter(|i| curve.used[[*i, c]]).collect();
            let mut from = 0;
            while from < used.len() {
                let first = mirrored(used[from]);
                let mut to = from + 1;
                while to < used.len()
                    && (to - from < least
                        || first.angle_between(mirrored(used[to])).to_degrees() < ONE_DEG)
                {
                    to += 1;
                }
                let group = &used[from..to];
                from = to;
                let weight: f64 = group.iter().map(|i| curve.sigma[[*i, c]].powi(-2)).sum();
                // A mean over the group by the weights of its samples, over the noise of that mean.
                let mean = |value: &dyn Fn(usize) -> f64| -> f64 {
                    let sum: f64 =
                        group.iter().map(|i| value(*i) * curve.sigma[[*i, c]].powi(-2)).sum();
                    sum / weight.sqrt()
                };
                let middle = group[group.len() / 2];
                let seen = &study.places()[middle];
                let rate = |i: usize, term: usize| match above {
                    true => unit.fluxes[[i, place, term]],
                    false => unit.rates_hz[[i, place, term]],
                } * factors[[i, c]] * study.places()[i].sunlit;
                moments.push(Moment {
                    sun: seen.sun_body,
                    observer: seen.observer_body,
                    unit: of_material.iter().map(|t| mean(&|i| rate(i, *t))).collect(),
                    left: mean(&|i| curve.rate[[i, c]] - fit.curves[k].model[[i, c]]),
                });
                for (p, linear) in parameters.linear.iter().enumerate() {
                    let value = match linear.holds(k, c) {
                        true => mean(&|i| own.columns[[i, c, linear.component]]),
                        false => 0.0,
                    };
                    design[p].push(value);
                }
            }
        }
    }
    // What stands at a bound does not follow.
    let mut known = Basis::default();
    for (column, (p, linear)) in design.iter().zip(solved.iter().zip(&parameters.linear)) {
        let most = linear.most.unwrap_or(f64::INFINITY);
        if p.value > 1e-6 * most.min(1.0) && p.value < (1.0 - 1e-6) * most {
            known.push(column, 1e-9);
        }
    }
    Ok(Left { moments, known, scale: fit.reduced_chi2.max(1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: the row goes from 0.03, or from the range's begin above it, to the range's end in equal factors; of a range that ends at 0.03 or below its end is all there is.
    #[test]
    fn roughnesses_lie_in_their_range() {
        for (low, high, expected) in [
            (0.0, 0.24, &[0.03, 0.06, 0.12, 0.24][..]),
            (0.1, 0.8, &[0.1, 0.2, 0.4, 0.8]),
            (0.01, 0.03, &[0.03]),
            (1e-4, 5e-4, &[5e-4]),
        ] {
            let found = roughnesses(low, high);
            assert_eq!(found.len(), expected.len(), "{found:?}");
            for (a, b) in found.iter().zip(expected) {
                assert!((a / b - 1.0).abs() < 1e-12, "{found:?}, expected {expected:?}");
            }
        }
    }
}
