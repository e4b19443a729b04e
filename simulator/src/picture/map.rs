//! Intensity over the directions of the phase vector.

use crate::light::{DirectionError, Scene, View};
use glam::{DQuat, DVec3};
use ndarray::Array2;
use rayon::prelude::*;
use std::f64::consts::PI;

/// The most directions of a map.
const MOST: usize = 10_000_000;

/// Map of the light that a body sends back over the directions of the phase vector: the bisector of Sun and observer, in the body's axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Phase angle, radians.
    pub phase_rad: f64,
    /// Middles of the columns, degrees east of the body's x axis, −180 to 180.
    pub longitude_deg: Vec<f64>,
    /// Middles of the rows, degrees above the body's xy-plane, from 90 down.
    pub latitude_deg: Vec<f64>,
    /// Rows × columns, in the unit of the factors that were given, times m² sr⁻¹.
    pub intensity: Array2<f64>,
    /// The largest error that the engine estimates of itself, relative.
    pub error: f64,
}

/// Why there is no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// A phase angle that is none.
    #[error("the phase angle is {phase_rad} rad, expected one from 0 to less than π")]
    Phase {
        /// Given angle.
        phase_rad: f64,
    },
    /// Too many directions, or none.
    #[error("steps of {step_deg}°: expected from 0.1° to 90°")]
    Step {
        /// Given angle.
        step_deg: f64,
    },
    /// Directions that are none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
}

impl Map {
    /// A map in steps of `step_deg` or a little less. `factors[k]` is what weight k counts. The phase vector alone does not fix Sun and observer: they
    /// stand in the plane through it and the body's z axis, the Sun on the side of +z (thesis section 7.3: maps of passive light are not
    /// unique; at phase angle 0 they are).
    ///
    /// # Errors
    /// A phase angle or a step out of range.
    pub fn of(
        scene: &Scene,
        phase_rad: f64,
        step_deg: f64,
        factors: &[f64],
    ) -> Result<Self, MapError> {
        if !(0.0..PI).contains(&phase_rad) {
            return Err(MapError::Phase { phase_rad });
        }
        if !(0.1..=90.0).contains(&step_deg) {
            return Err(MapError::Step { step_deg });
        }
        let rows = (180.0 / step_deg).ceil() as usize;
        let columns = 2 * rows;
        debug_assert!(rows * columns <= MOST);
        let middle = |k: usize| 180.0 * (k as f64 + 0.5) / rows as f64;
        let latitude_deg: Vec<f64> = (0..rows).map(|k| 90.0 - middle(k)).collect();
        let longitude_deg: Vec<f64> = (0..columns).map(|k| middle(k) - 180.0).collect();
        let row = |latitude: &f64| -> Result<(Vec<f64>, f64), DirectionError> {
            let mut evaluator = scene.evaluator();
            let mut weights = vec![0.0; scene.weight_count()];
            let mut most = 0.0_f64;
            let mut out = Vec::with_capacity(columns);
            for longitude in &longitude_deg {
                let (sun, observer) = directions(*longitude, *latitude, phase_rad);
                let done = evaluator.direct(sun, View::Distant(observer), &mut weights)?;
                most = most.max(done.error);
                out.push(weights.iter().zip(factors).map(|(w, f)| w * f).sum());
            }
            Ok((out, most))
        };
        let found: Vec<(Vec<f64>, f64)> = latitude_deg
            .par_iter()
            .map(row)
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<_, _>>()?;
        let error = found.iter().fold(0.0, |most: f64, row| most.max(row.1));
        let intensity = Array2::from_shape_fn((rows, columns), |(r, c)| found[r].0[c]);
        Ok(Self { phase_rad, longitude_deg, latitude_deg, intensity, error })
    }
}

/// Sun and observer about a phase vector, in its meridian.
pub(super) fn directions(longitude_deg: f64, latitude_deg: f64, phase_rad: f64) -> (DVec3, DVec3) {
    let (sin_l, cos_l) = longitude_deg.to_radians().sin_cos();
    let (sin_b, cos_b) = latitude_deg.to_radians().sin_cos();
    let bisector = DVec3::new(cos_b * cos_l, cos_b * sin_l, sin_b);
    let east = DVec3::new(-sin_l, cos_l, 0.0);
    // Right-handed about east the north pole is turned away from: the Sun by half the phase angle towards it.
    let turn = |angle: f64| DQuat::from_axis_angle(east, angle) * bisector;
    (turn(-0.5 * phase_rad), turn(0.5 * phase_rad))
}

#[cfg(test)]
mod tests {
    use super::directions;
    use glam::DVec3;

    /// Truth: spherical trigonometry: on the equator at longitude 0 with a phase angle of 60° Sun and observer stand 30° above and below it.
    #[test]
    fn sun_and_observer_stand_in_the_meridian() {
        let (sun, observer) = directions(0.0, 0.0, 60.0_f64.to_radians());
        let (c, s) = (30.0_f64.to_radians().cos(), 0.5);
        assert!(sun.distance(DVec3::new(c, 0.0, s)) < 1e-15);
        assert!(observer.distance(DVec3::new(c, 0.0, -s)) < 1e-15);
    }
}
