//! Lit and seen part of a body, piece by piece: for whoever needs more of it than its weights.

use super::View;
use super::clip::{P2, Polygons};
use super::evaluate::{DirectionError, Evaluator};
use glam::{DVec2, DVec3};

/// The lit and seen part of one facet: convex polygons in the facet's plane.
#[derive(Debug)]
pub struct Piece<'a> {
    /// The part that it belongs to.
    pub part: usize,
    /// Index of the material.
    pub material: usize,
    /// The origin of the plane's coordinates, body axes, m.
    pub origin: DVec3,
    /// Axes of the plane: tangent, bitangent, normal; body axes.
    pub axes: [DVec3; 3],
    /// Unit vector towards the light, in those axes.
    pub to_light: DVec3,
    /// Unit vector to the observer from the origin, in those axes.
    pub to_observer: DVec3,
    polygons: Outlines<'a>,
}

#[derive(Debug)]
enum Outlines<'a> {
    Whole(&'a [P2]),
    Cut(&'a Polygons),
}

impl Piece<'_> {
    /// The corners of each polygon, counter-clockwise, m in the plane's coordinates.
    pub fn polygons(&self) -> impl Iterator<Item = &[[f64; 2]]> {
        let (whole, cut) = match &self.polygons {
            Outlines::Whole(outline) => (Some(*outline), None),
            Outlines::Cut(kept) => (None, Some(kept.iter())),
        };
        whole.into_iter().chain(cut.into_iter().flatten())
    }

    /// A point of the plane in the body's axes, m.
    pub fn point(&self, place: impl Into<DVec2>) -> DVec3 {
        let DVec2 { x, y } = place.into();
        self.origin + x * self.axes[0] + y * self.axes[1]
    }
}

impl Evaluator<'_> {
    /// Gives what is lit by collimated light from `light_body` and seen from `view`, flat facet by flat facet: nothing of what is curved
    /// ([`Faceted`](super::Faceted) has all). Hinged parts turn to `sun_body`.
    ///
    /// # Errors
    /// A direction that is none.
    pub fn pieces(
        &mut self,
        light_body: DVec3,
        sun_body: DVec3,
        view: View,
        take: &mut dyn FnMut(&Piece<'_>),
    ) -> Result<(), DirectionError> {
        let (light, eye) = self.stand(light_body, sun_body, view)?;
        for i in 0..self.scene.facets.len() {
            let normal = self.now.normal[i];
            let origin = self.now.origin[i];
            let toward = eye.from(origin);
            if !(super::evaluate::is_open(normal.dot(light))
                && super::evaluate::is_open(normal.dot(toward)))
            {
                continue;
            }
            let facet = &self.scene.facets[i];
            let outline = self.scene.outlines.get(i);
            let cut = self.visible(i, light, eye);
            let kept = self.work.kept();
            if cut && kept.is_empty() {
                continue;
            }
            let (u, v) = (self.now.tangent[i], self.now.bitangent[i]);
            let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), normal.dot(d));
            take(&Piece {
                part: facet.part as usize,
                material: facet.material as usize,
                origin,
                axes: [u, v, normal],
                to_light: local(light),
                to_observer: local(toward),
                polygons: if cut { Outlines::Cut(kept) } else { Outlines::Whole(outline) },
            });
        }
        Ok(())
    }
}
