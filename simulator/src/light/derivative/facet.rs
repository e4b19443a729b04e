//! A flat facet's weights and how they change.

use super::{Room, Unknown};
use crate::light::evaluate::{Evaluator, is_open};
use crate::light::occlude::Toward;
use glam::DVec3;

/// Rounding error, as a share of the terms of a derivative.
const ROUNDING: f64 = 4e-15;

impl Evaluator<'_> {
    /// Adds a facet to weights and derivatives.
    pub(super) fn facet_slopes(
        &mut self,
        i: usize,
        sun: DVec3,
        eye: DVec3,
        room: &mut Room,
        values: &mut [f64],
        derivatives: &mut [f64],
    ) -> Result<(), Unknown> {
        let axes = [self.now.tangent[i], self.now.bitangent[i], self.now.normal[i]];
        let local = |d: DVec3| DVec3::from_array(axes.map(|a| a.dot(d)));
        let (to_sun, to_eye) = (local(sun), local(eye));
        if !(is_open(to_sun.z) && is_open(to_eye.z)) {
            return Ok(());
        }
        let scene = self.scene;
        let facet = &scene.facets[i];
        self.work.done.facets += 1;
        let cut = self.visible(i, sun, Toward::Far(eye));
        if cut && self.shaded_by_round() {
            return Err(Unknown);
        }
        let area = if cut { self.work.kept().area() } else { facet.area };
        if area == 0.0 {
            return Ok(());
        }
        let mut flux = std::mem::take(&mut room.flux);
        if cut {
            flux.find(self, i, sun, eye);
            room.edges += flux.edges;
        }
        let slopes = scene.materials[facet.material as usize].slopes(to_sun, to_eye);
        let weights = scene.weights_of(facet.material as usize);
        let cosines = to_sun.z * to_eye.z;
        let unsure = if cut { self.cut_rounding_m2(facet) } else { 0.0 };
        for (value, slope) in values[weights.clone()].iter_mut().zip(&slopes) {
            *value += area * cosines * slope.value;
            room.value_error += cosines * slope.value * unsure;
        }
        let hinge = (facet.group as usize).checked_sub(1);
        let count = values.len();
        for (p, rate) in room.rates.iter().enumerate() {
            // In the facet's axes, which turn with its hinge.
            let seen = |d: DVec3, moved: DVec3| {
                let own =
                    hinge.map_or(DVec3::ZERO, |h| rate.hinges[h] * d.cross(scene.hinges[h].axis));
                local(moved + own)
            };
            let (sun_rate, eye_rate) = (seen(sun, rate.sun), seen(eye, rate.eye));
            let mut area_rate = 0.0;
            let mut swept = 0.0;
            if cut {
                for (side, (d, moved)) in
                    [(to_sun, sun_rate), (to_eye, eye_rate)].into_iter().enumerate()
                {
                    let slope = [
                        (moved.x - d.x / d.z * moved.z) / d.z,
                        (moved.y - d.y / d.z * moved.z) / d.z,
                    ];
                    let by = flux.slope[side];
                    area_rate += by[0] * slope[0] + by[1] * slope[1];
                    swept += flux.size * (slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
                }
                let turned = flux.hinges.iter().zip(&rate.hinges).map(|(a, b)| a * b);
                area_rate += turned.sum::<f64>();
            }
            let slant = sun_rate.z * to_eye.z + to_sun.z * eye_rate.z;
            let shape = area_rate * cosines + area * slant;
            let alpha = match rate.roughness {
                Some((material, share)) if material == facet.material as usize => share,
                _ => [0.0; 2],
            };
            let row = &mut derivatives[p * count + weights.start..p * count + weights.end];
            let extent = sun_rate.length() + eye_rate.length();
            for (derivative, slope) in row.iter_mut().zip(&slopes) {
                let by_shape = slope.i.dot(sun_rate)
                    + slope.o.dot(eye_rate)
                    + slope.alpha[0] * alpha[0]
                    + slope.alpha[1] * alpha[1];
                *derivative += shape * slope.value + area * cosines * by_shape;
                room.errors[p] += area * cosines * slope.error * extent
                    + ROUNDING
                        * ((swept * cosines + area * slant.abs()) * slope.value
                            + area * cosines * (by_shape.abs() + slope.i.length() * extent));
            }
        }
        room.flux = flux;
        Ok(())
    }
}
