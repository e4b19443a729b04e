//! Facets inside convex bodies: no light reaches them and nobody sees them, whatever the direction.

use super::facets::Polygon;
use glam::DVec3;

/// Bodies that are looked into, the largest first: what is buried is mostly buried in them.
const MOST_BODIES: usize = 64;

/// A convex body by its planes, in a ball.
struct Body {
    component: usize,
    middle: DVec3,
    radius: f64,
    planes: Vec<(DVec3, f64)>,
}

/// Takes the facets away that lie in one of the convex components of their group (each given by its facets), on whose surface they may end.
pub fn remove(polygons: &mut Vec<Polygon>, convex: &[bool], touching_m: f64) {
    let mut bodies = bodies(polygons, convex);
    bodies.sort_by(|a, b| b.radius.total_cmp(&a.radius).then(a.component.cmp(&b.component)));
    bodies.truncate(MOST_BODIES);
    polygons.retain(|polygon| !bodies.iter().any(|body| body.holds(polygon, touching_m)));
}

fn bodies(polygons: &[Polygon], convex: &[bool]) -> Vec<Body> {
    let mut of: Vec<Vec<&Polygon>> = vec![Vec::new(); convex.len()];
    polygons.iter().filter(|p| convex[p.component]).for_each(|p| of[p.component].push(p));
    let few = of.iter().enumerate().filter(|(_, own)| (4..=MOST_PLANES).contains(&own.len()));
    few.map(|(component, own)| {
        let corners = || own.iter().flat_map(|p| p.corners.iter());
        let middle = corners().sum::<DVec3>() / corners().count() as f64;
        let radius = corners().map(|c| c.distance(middle)).fold(0.0, f64::max);
        let planes = own.iter().map(|p| (p.normal, p.corners[0].dot(p.normal))).collect();
        Body { component, middle, radius, planes }
    })
    .collect()
}

/// Bodies of more facets are not looked into.
const MOST_PLANES: usize = 200;

impl Body {
    fn holds(&self, polygon: &Polygon, touching_m: f64) -> bool {
        if polygon.component == self.component
            || polygon.corners[0].distance_squared(self.middle) > self.radius * self.radius
        {
            return false;
        }
        // Corners may lie in its surface, the middle lies within: no ray from the facet gets out without leaving the body.
        let middle = polygon.middle();
        self.planes.iter().all(|(normal, at)| {
            middle.dot(*normal) < at - 4.0 * touching_m
                && polygon.corners.iter().all(|c| c.dot(*normal) <= at + touching_m)
        })
    }
}
