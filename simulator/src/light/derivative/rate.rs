//! How fast what a sum is made of changes with a parameter.

use super::{DerivativeError, Parameter};
use crate::light::scene::Scene;
use crate::target::Hinge;
use glam::DVec3;

/// Rates of change in the body's axes.
#[derive(Debug, Clone)]
pub(super) struct Rate {
    /// Rate of the direction to the Sun, and so of the light.
    pub sun: DVec3,
    /// Rate of the direction to the observer.
    pub eye: DVec3,
    /// Rate of each hinge's angle.
    pub hinges: Vec<f64>,
    /// Rates of a material's two roughnesses.
    pub(crate) roughness: Option<(usize, [f64; 2])>,
}

impl Rate {
    /// Returns the rates for a parameter, for a distant observer.
    pub fn of(scene: &Scene, parameter: &Parameter, sun: DVec3, eye: DVec3) -> Self {
        let across = |d: DVec3, v: DVec3| v - v.dot(d) * d;
        let mut rate =
            Self { sun: DVec3::ZERO, eye: DVec3::ZERO, hinges: Vec::new(), roughness: None };
        match *parameter {
            // The world turns the other way about the body.
            Parameter::Attitude(axis) => (rate.sun, rate.eye) = (sun.cross(axis), eye.cross(axis)),
            Parameter::Sun(v) => rate.sun = across(sun, v),
            Parameter::Observer(v) => rate.eye = across(eye, v),
            Parameter::Roughness { material, of } => rate.roughness = Some((material, of.share())),
        }
        rate.hinges = scene.hinges.iter().map(|h| hinge_rate(h, sun, rate.sun)).collect();
        rate
    }
}

/// Returns the rate of a hinge's angle for a rate of the direction to the Sun; 0 at a stop, and where the Sun stands on the axis.
fn hinge_rate(hinge: &Hinge, sun: DVec3, rate: DVec3) -> f64 {
    let across = hinge.axis.cross(hinge.face);
    let (x, y) = (sun.dot(hinge.face), sun.dot(across));
    let square = x * x + y * y;
    if square < 1e-24 {
        return 0.0;
    }
    if hinge.range_rad.is_some() {
        // At a stop the face does not look as near to the Sun as it could.
        let (sin, cos) = hinge.angle_rad(sun).sin_cos();
        if (x * sin - y * cos).abs() > 1e-9 * square.sqrt() || x * cos + y * sin < 0.0 {
            return 0.0;
        }
    }
    (x * rate.dot(across) - y * rate.dot(hinge.face)) / square
}

/// Whether a parameter is one.
pub(super) fn check(scene: &Scene, p: usize, parameter: &Parameter) -> Result<(), DerivativeError> {
    match *parameter {
        Parameter::Attitude(value) | Parameter::Sun(value) | Parameter::Observer(value) => {
            if !value.is_finite() {
                return Err(DerivativeError::NotFinite { parameter: p, value });
            }
        }
        Parameter::Roughness { material, .. } => match scene.materials.get(material) {
            None => {
                let count = scene.materials.len();
                return Err(DerivativeError::Missing { parameter: p, material, count });
            }
            Some(found) if !found.has_roughness() => {
                return Err(DerivativeError::NoRoughness { parameter: p, material });
            }
            Some(_) => {}
        },
    }
    Ok(())
}
