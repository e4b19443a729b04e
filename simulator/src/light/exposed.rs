//! Facets that are open to one direction, with the places of their open parts: for pressure of light and air.

use super::clip;
use super::occlude::{Toward, unit};
use super::{DirectionError, Evaluator};
use glam::DVec3;

/// Open part of a facet towards a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposed {
    /// Number of the facet.
    pub facet: usize,
    /// Number of its material, in the target's order.
    pub material: usize,
    /// Unit normal, body axes.
    pub normal: DVec3,
    /// Cosine of the angle between normal and direction, above 0.
    pub cos: f64,
    /// Area of the open part, m² (not projected).
    pub area_m2: f64,
    /// Centroid of the open part, m, body axes.
    pub centroid_m: DVec3,
}

impl Evaluator<'_> {
    /// Visits the open part of every facet that faces a direction, with hinged parts turned to the Sun; what other facets hide is taken
    /// away exactly. Curved and bent surfaces are not visited: give them as flat facets.
    ///
    /// # Errors
    /// [`DirectionError::NoDirection`].
    pub fn exposed(
        &mut self,
        direction_body: DVec3,
        sun_body: DVec3,
        visit: &mut dyn FnMut(&Exposed),
    ) -> Result<(), DirectionError> {
        let direction = unit("the direction", direction_body)?;
        self.turn(unit("the direction of the Sun", sun_body)?);
        let toward = Toward::Far(direction);
        self.prepare(toward);
        let scene = self.scene;
        for i in 0..scene.facets.len() {
            let normal = self.now.normal[i];
            let cos = normal.dot(direction);
            if !super::evaluate::is_open(cos) {
                continue;
            }
            let mut area_m2 = 0.0;
            let mut moment = [0.0; 2];
            let mut add = |polygon: &[clip::P2]| {
                let (area, first) = area_and_moment(polygon);
                area_m2 += area;
                moment[0] += first[0];
                moment[1] += first[1];
            };
            match self.open(i, toward) {
                Some(kept) => kept.iter().for_each(&mut add),
                None => add(scene.outlines.get(i)),
            }
            // Written so that NaN is left out too.
            if area_m2.is_nan() || area_m2 <= 0.0 {
                continue;
            }
            let (x, y) = (moment[0] / area_m2, moment[1] / area_m2);
            let centroid_m =
                self.now.origin[i] + x * self.now.tangent[i] + y * self.now.bitangent[i];
            let material = scene.facets[i].material as usize;
            visit(&Exposed { facet: i, material, normal, cos, area_m2, centroid_m });
        }
        Ok(())
    }
}

/// Area of a polygon and its first moments, by triangles about the first corner.
fn area_and_moment(polygon: &[clip::P2]) -> (f64, [f64; 2]) {
    let Some((first, rest)) = polygon.split_first() else { return (0.0, [0.0; 2]) };
    let (mut area, mut moment) = (0.0, [0.0; 2]);
    for pair in rest.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let (u, v) = ([a[0] - first[0], a[1] - first[1]], [b[0] - first[0], b[1] - first[1]]);
        let part = 0.5 * (u[0] * v[1] - u[1] * v[0]);
        area += part;
        for k in 0..2 {
            moment[k] += part * (first[k] + a[k] + b[k]) / 3.0;
        }
    }
    (area, moment)
}
