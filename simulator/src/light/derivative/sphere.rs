//! A sphere's weights and how they change: by the phase angle alone.

use super::{Room, Unknown};
use crate::light::curved::Light;
use crate::light::evaluate::Evaluator;
use crate::light::occlude::Toward;
use crate::surface::{Material, central};

impl Evaluator<'_> {
    /// Adds a sphere that nothing shades or hides.
    pub(super) fn sphere_slopes(
        &mut self,
        number: usize,
        light: Light,
        room: &mut Room,
        values: &mut [f64],
        derivatives: &mut [f64],
    ) -> Result<(), Unknown> {
        let scene = self.scene;
        let round = &scene.rounds[number];
        let (Some(radius), Toward::Far(eye)) = (round.sphere, light.eye) else {
            return Err(Unknown);
        };
        if !self.round_is_free(number, light) {
            return Err(Unknown);
        }
        self.work.done.spheres += 1;
        let sun = light.sun;
        // Right at all angles (Kahan).
        let phase = 2.0 * (sun - eye).length().atan2((sun + eye).length());
        let material = &scene.materials[round.material as usize];
        let slopes = material.sphere_slopes(phase.min(std::f64::consts::PI));
        let weights = scene.weights_of(round.material as usize);
        let area = radius * radius;
        for (value, slope) in values[weights.clone()].iter_mut().zip(&slopes) {
            *value += area * slope.value;
            room.value_error += area * slope.value_error;
        }
        let sine = sun.cross(eye).length();
        let count = values.len();
        for (p, rate) in room.rates.iter().enumerate() {
            let row = &mut derivatives[p * count + weights.start..p * count + weights.end];
            // cos γ = s·e. At γ = 0 and π the phase angle has a kink, its derivative no direction.
            let turn =
                if sine > 1e-12 { -(rate.sun.dot(eye) + sun.dot(rate.eye)) / sine } else { 0.0 };
            for (derivative, slope) in row.iter_mut().zip(&slopes) {
                *derivative += area * slope.rate * turn;
                room.errors[p] += area * (slope.rate_error * turn.abs() + 4e-16 * slope.rate.abs());
            }
            if let Some((of, _)) = rate.roughness
                && of == round.material as usize
            {
                for (derivative, (by_alpha, error)) in
                    row.iter_mut().zip(by_roughness(material, phase))
                {
                    *derivative += area * by_alpha;
                    room.errors[p] += area * error;
                }
            }
        }
        Ok(())
    }
}

/// The derivatives of a sphere's weights by roughness, and their errors.
fn by_roughness(material: &Material, phase: f64) -> Vec<(f64, f64)> {
    let Some((alpha, _)) = material.roughness() else { return Vec::new() };
    let step = 0.02 * alpha;
    central(material.spectra().len(), step, |x, scale, row| {
        let other = material.with_roughness((alpha + x, alpha + x));
        // A sphere has no tangent, the angle is one: the scene was checked.
        let _ = other.add_sphere_weights(phase, scale, row);
    })
}
