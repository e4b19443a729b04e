//! How far the lit and seen surface is.

use ndarray::Array2;
use rayon::prelude::*;
use sunglint_analysis::map::Grid;
use sunglint_simulator::light::{DirectionError, Faceted, View};

/// Mean distances over the directions of a body, seen and lit from the same side: what a laser beside the telescope finds.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeMap {
    /// Cells of the map.
    pub grid: Grid,
    /// Mean over the seen area as it stands across the line of sight, m away from the observer against the body's origin; NaN where nothing is seen.
    pub surface_m: Array2<f64>,
    /// The same weighted by the light that is sent back; NaN where none is.
    pub light_m: Array2<f64>,
}

/// The range map of a target. `reflectance[k]` is what weight k of its scene counts: the reflectance at the laser's wavelength. A polygon's mean distance is that of its centroid, so that
/// flat bodies are exact; what is curved has the depth of the facets that stand for it. Hinges turn to the light, the usual Sun.
///
/// # Errors
/// Directions that are none.
pub fn range_map(
    body: &Faceted,
    grid: Grid,
    reflectance: &[f64],
) -> Result<RangeMap, DirectionError> {
    let (rows, columns) = grid.dim();
    let row = |row: usize| -> Result<Vec<(f64, f64)>, DirectionError> {
        let mut eye = body.eye();
        let mut out = Vec::with_capacity(columns);
        for column in 0..columns {
            let toward = grid.direction((row, column));
            let (mut area, mut far, mut light, mut far_light) = (0.0, 0.0, 0.0, 0.0);
            eye.pieces(toward, toward, View::Distant(toward), &mut |piece, weights| {
                let per_m2: f64 = weights.iter().zip(reflectance).map(|(w, r)| w * r).sum();
                for polygon in piece.polygons() {
                    let (size, middle) = centroid(polygon);
                    let depth = -piece.point(middle).dot(toward);
                    let across = size * piece.to_observer.z;
                    area += across;
                    far += across * depth;
                    light += size * per_m2;
                    far_light += size * per_m2 * depth;
                }
            })?;
            let mean = |sum: f64, whole: f64| if whole > 0.0 { sum / whole } else { f64::NAN };
            out.push((mean(far, area), mean(far_light, light)));
        }
        Ok(out)
    };
    let all: Vec<Result<_, DirectionError>> = (0..rows).into_par_iter().map(row).collect();
    let all: Vec<Vec<(f64, f64)>> = all.into_iter().collect::<Result<_, _>>()?;
    let pick = |of: fn(&(f64, f64)) -> f64| {
        Array2::from_shape_fn((rows, columns), |(r, c)| of(&all[r][c]))
    };
    Ok(RangeMap { grid, surface_m: pick(|v| v.0), light_m: pick(|v| v.1) })
}

/// Area and centroid of a polygon (shoelace about its first corner).
fn centroid(polygon: &[[f64; 2]]) -> (f64, [f64; 2]) {
    let Some((first, rest)) = polygon.split_first() else { return (0.0, [0.0; 2]) };
    let (mut area, mut sum) = (0.0, [0.0; 2]);
    for pair in rest.windows(2) {
        let [a, b] = [pair[0], pair[1]].map(|p| [p[0] - first[0], p[1] - first[1]]);
        let twice = a[0] * b[1] - a[1] * b[0];
        area += 0.5 * twice;
        for axis in 0..2 {
            sum[axis] += twice * (a[axis] + b[axis]) / 6.0;
        }
    }
    if area.abs() <= 0.0 {
        return (0.0, *first);
    }
    (area.abs(), [first[0] + sum[0] / area, first[1] + sum[1] / area])
}
