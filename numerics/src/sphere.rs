//! Directions over the whole sphere.

use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Directions spread evenly over the sphere (a Fibonacci lattice: from pole to pole, each the golden angle on from the one before), turned about z by a shift of 0 to 1.
///
/// ```
/// let directions = sunglint_numerics::sphere::spread(1000, 0.0);
/// assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-12));
/// // Half of them lie north of the equator.
/// assert_eq!(directions.iter().filter(|d| d.z > 0.0).count(), 500);
/// ```
pub fn spread(count: usize, shift: f64) -> Vec<DVec3> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let angle = golden * i as f64 + TAU * shift;
            let r = (1.0 - z * z).max(0.0).sqrt();
            DVec3::new(r * angle.cos(), r * angle.sin(), z)
        })
        .collect()
}
