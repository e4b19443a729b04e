//! Derivatives of a whole sum by differences, where there are no formulas.

use super::Parameter;
use crate::light::View;
use crate::light::evaluate::{Direct, DirectionError, Evaluator};
use crate::light::scene::Scene;
use crate::surface::central;
use glam::{DQuat, DVec3};

impl Evaluator<'_> {
    /// By central differences of the sixth order; steps that the error of the sum asks for, from 1e-3 to 2e-2 rad (of roughness: of α).
    pub(super) fn by_differences(
        &mut self,
        sun: DVec3,
        view: View,
        parameters: &[Parameter],
        values: &mut [f64],
        derivatives: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        let whole = exact(self.scene);
        let scene = whole.as_ref().unwrap_or(self.scene);
        let mut evaluator = Evaluator::new(scene);
        evaluator.set_curved_tolerance(self.curves.tolerance);
        let done = evaluator.direct(sun, view, values)?;
        let step = done.error.cbrt().clamp(1e-3, 2e-2);
        let total: f64 = values.iter().sum();
        let count = values.len();
        self.rates.errors.clear();
        for (parameter, row) in parameters.iter().zip(derivatives.chunks_mut(count.max(1))) {
            let rows = |x: f64, scale: f64, row: &mut [f64]| {
                let (sun, view) = moved(sun, view, parameter, x);
                let mut out = vec![0.0; row.len()];
                let asked = match parameter {
                    Parameter::Roughness { material, of } => {
                        let other = rougher(scene, *material, of.share(), x);
                        let mut eye = Evaluator::new(&other);
                        eye.set_curved_tolerance(evaluator.curves.tolerance);
                        eye.direct(sun, view, &mut out)
                    }
                    _ => evaluator.direct(sun, view, &mut out),
                };
                // The directions were checked; moved by so little they stay directions.
                if asked.is_ok() {
                    row.iter_mut().zip(&out).for_each(|(r, o)| *r += scale * o);
                }
            };
            let size = length(scene, parameter, view);
            let mut error = done.error * total / step;
            for (derivative, (found, off)) in row.iter_mut().zip(central(count, step, rows)) {
                *derivative = found * size;
                error += off;
            }
            self.rates.errors.push(error * size);
        }
        Ok(done)
    }
}

/// The scene without samples; `None` where it has none.
fn exact(scene: &Scene) -> Option<Scene> {
    scene.large.as_ref()?;
    let mut whole = scene.clone();
    whole.large = None;
    Some(whole)
}

/// Returns the size of a parameter's step of 1 against its natural unit: rad, m of range, α.
fn length(scene: &Scene, parameter: &Parameter, view: View) -> f64 {
    match (parameter, view) {
        (Parameter::Observer(v), View::At(q)) => v.length() / q.length(),
        (Parameter::Attitude(v) | Parameter::Sun(v) | Parameter::Observer(v), _) => v.length(),
        (Parameter::Roughness { material, .. }, _) => {
            1.0 / scene.materials[*material].roughness().map_or(1.0, |(x, y)| x.max(y))
        }
    }
}

/// Sun and observer, a step `x` along the parameter.
fn moved(sun: DVec3, view: View, parameter: &Parameter, x: f64) -> (DVec3, View) {
    let map = |view: View, f: &dyn Fn(DVec3) -> DVec3| match view {
        View::Distant(d) => View::Distant(f(d)),
        View::At(q) => View::At(f(q)),
    };
    match *parameter {
        Parameter::Attitude(axis) => {
            let Some(axis) = axis.try_normalize() else { return (sun, view) };
            // The world turns the other way about the body.
            let turn = DQuat::from_axis_angle(axis, -x);
            (turn * sun, map(view, &|d| turn * d))
        }
        Parameter::Sun(v) => (shifted(sun, v, x), view),
        Parameter::Observer(v) => match view {
            View::Distant(d) => (sun, View::Distant(shifted(d, v, x))),
            View::At(q) => (sun, View::At(q + x * q.length() * v.normalize_or_zero())),
        },
        Parameter::Roughness { .. } => (sun, view),
    }
}

/// A direction moved across itself.
fn shifted(d: DVec3, v: DVec3, x: f64) -> DVec3 {
    let d = d.normalize_or_zero();
    d + x * (v - v.dot(d) * d) / v.length().max(f64::MIN_POSITIVE)
}

/// The scene with another roughness, by `x` of its larger.
fn rougher(scene: &Scene, material: usize, share: [f64; 2], x: f64) -> Scene {
    let mut other = scene.clone();
    if let Some((along, across)) = scene.materials[material].roughness() {
        let by = x * along.max(across);
        other.materials[material] = scene.materials[material]
            .with_roughness((along + share[0] * by, across + share[1] * by));
    }
    other
}
