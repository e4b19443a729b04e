//! How much of a pixel lies in an aperture: exact areas of a disc, and of a disc drawn along a straight trail, over unit squares.

use glam::DVec2;

/// An aperture on a frame: all places within `radius_px` of a straight trail through its centre. Without a trail it is a disc.
///
/// Places are columns and rows; the middle of the first pixel is (0, 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Middle of the aperture, px.
    pub centre_px: DVec2,
    /// Radius of the aperture, px.
    pub radius_px: f64,
    /// From one end of the trail to the other, px; `[0.0, 0.0]` for a disc. (A pill, as in TRIPPy, Fraser et al. 2016.)
    pub trail_px: DVec2,
}

impl Aperture {
    /// A disc.
    pub fn disc(centre_px: DVec2, radius_px: f64) -> Self {
        Self { centre_px, radius_px, trail_px: DVec2::ZERO }
    }

    /// Length of the trail, px.
    pub fn trail_length_px(&self) -> f64 {
        self.trail_px[0].hypot(self.trail_px[1])
    }

    /// The whole area, px²: π r² + 2 r L.
    pub fn area_px2(&self) -> f64 {
        std::f64::consts::PI * self.radius_px.powi(2)
            + 2.0 * self.radius_px * self.trail_length_px()
    }

    /// Half the width and half the height of the smallest upright box around a place's neighbourhood of `reach_px`.
    pub(crate) fn half_box_px(&self, reach_px: f64) -> [f64; 2] {
        self.trail_px.to_array().map(|t| t.abs() / 2.0 + reach_px)
    }

    /// Distance of a place from the trail (the centre, for a disc), px.
    pub fn distance_px(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (x - self.centre_px[0], y - self.centre_px[1]);
        let length2 = self.trail_px[0].powi(2) + self.trail_px[1].powi(2);
        if length2 == 0.0 {
            return dx.hypot(dy);
        }
        let along = (dx * self.trail_px[0] + dy * self.trail_px[1]) / length2;
        let along = along.clamp(-0.5, 0.5);
        (dx - along * self.trail_px[0]).hypot(dy - along * self.trail_px[1])
    }

    /// Area of the pixel at (`column`, `row`) that lies in the aperture: 0 to 1, exact but for rounding.
    pub fn overlap(&self, column: f64, row: f64) -> f64 {
        // Half a pixel's diagonal, a little more.
        const REACH: f64 = 0.7072;
        let distance = self.distance_px(column, row);
        if distance <= self.radius_px - REACH {
            return 1.0;
        }
        if distance >= self.radius_px + REACH {
            return 0.0;
        }
        let (x, y) = (column - self.centre_px[0], row - self.centre_px[1]);
        if self.trail_px == DVec2::ZERO {
            disc_square(x, y, self.radius_px)
        } else {
            self.pill_square(x, y).clamp(0.0, 1.0)
        }
    }

    /// The pill in three: the rectangle between its ends, and the half disc beyond each.
    fn pill_square(&self, x: f64, y: f64) -> f64 {
        let length = self.trail_length_px();
        let along = self.trail_px.to_array().map(|t| t / length);
        let across = [-along[1], along[0]];
        let half = length / 2.0;
        let back = along.map(|a| -a);
        let square = Polygon::square(x, y);
        let middle = square
            .keep(along, half)
            .keep(back, half)
            .keep(across, self.radius_px)
            .keep(across.map(|a| -a), self.radius_px);
        let ends: f64 = [along, back]
            .into_iter()
            .map(|out| {
                // The part of the square beyond this end, seen from the end.
                let beyond = square.keep(out.map(|o| -o), -half);
                beyond.moved([-half * out[0], -half * out[1]]).in_disc(self.radius_px)
            })
            .sum();
        middle.area() + ends
    }
}

/// Area of the unit square around (x, y) within the disc of this radius around the origin.
fn disc_square(x: f64, y: f64, radius: f64) -> f64 {
    // Parts on either side of an axis are mirrored into the first quadrant.
    let parts = |middle: f64| {
        let (low, high) = (middle.abs() - 0.5, middle.abs() + 0.5);
        if low >= 0.0 { [(low, high), (0.0, 0.0)] } else { [(0.0, high), (0.0, -low)] }
    };
    let mut area = 0.0;
    for (x0, x1) in parts(x) {
        for (y0, y1) in parts(y) {
            if x1 > x0 && y1 > y0 {
                area += disc_rectangle(x0, x1, y0, y1, radius);
            }
        }
    }
    area
}

/// Area of the rectangle x0…x1 by y0…y1, in the first quadrant, within the disc: ∫ clamp(√(r²−x²), y0, y1) − y0 dx.
fn disc_rectangle(x0: f64, x1: f64, y0: f64, y1: f64, radius: f64) -> f64 {
    let chord = |y: f64| (radius * radius - y * y).max(0.0).sqrt();
    if y0 >= radius {
        return 0.0;
    }
    // Left of `full` the whole height is inside, right of `none` nothing is.
    let full = if y1 < radius { chord(y1).clamp(x0, x1) } else { x0 };
    let none = chord(y0).clamp(x0, x1);
    let mut area = (full - x0) * (y1 - y0);
    if none > full {
        let under = |x: f64| 0.5 * (x * chord(x) + radius * radius * (x / radius).min(1.0).asin());
        area += under(none) - under(full) - y0 * (none - full);
    }
    area
}

/// A convex polygon of a clipped square: at most eight corners here.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [[f64; 2]; 10],
    len: usize,
}

impl Polygon {
    fn square(x: f64, y: f64) -> Self {
        let mut corners = [[0.0; 2]; 10];
        for (corner, (sx, sy)) in
            corners.iter_mut().zip([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
        {
            *corner = [x + sx, y + sy];
        }
        Self { corners, len: 4 }
    }

    fn edges(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
        (0..self.len).map(|i| (self.corners[i], self.corners[(i + 1) % self.len]))
    }

    /// Returns the part of the polygon where `normal`·p ≤ `bound`.
    fn keep(&self, normal: [f64; 2], bound: f64) -> Self {
        let mut kept = Self { corners: [[0.0; 2]; 10], len: 0 };
        let height = |p: [f64; 2]| normal[0] * p[0] + normal[1] * p[1] - bound;
        for (from, to) in self.edges() {
            let (h0, h1) = (height(from), height(to));
            if h0 <= 0.0 {
                kept.push(from);
            }
            if (h0 < 0.0 && h1 > 0.0) || (h0 > 0.0 && h1 < 0.0) {
                let t = h0 / (h0 - h1);
                kept.push([from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])]);
            }
        }
        kept
    }

    fn push(&mut self, corner: [f64; 2]) {
        self.corners[self.len] = corner;
        self.len += 1;
    }

    fn moved(mut self, by: [f64; 2]) -> Self {
        for corner in &mut self.corners[..self.len] {
            *corner = [corner[0] + by[0], corner[1] + by[1]];
        }
        self
    }

    fn area(&self) -> f64 {
        0.5 * self.edges().map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    /// Area within the disc of this radius around the origin: for each edge a triangle where it is inside, a sector where it is not.
    fn in_disc(&self, radius: f64) -> f64 {
        self.edges().map(|(a, b)| edge_in_disc(a, b, radius)).sum()
    }
}

/// Signed area of the triangle (origin, a, b) within the disc.
fn edge_in_disc(a: [f64; 2], b: [f64; 2], radius: f64) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length2 = dx * dx + dy * dy;
    if length2 == 0.0 {
        return 0.0;
    }
    let at = |t: f64| [a[0] + t * dx, a[1] + t * dy];
    let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let sector = |p: [f64; 2], q: [f64; 2]| {
        0.5 * radius * radius * cross(p, q).atan2(p[0] * q[0] + p[1] * q[1])
    };
    let middle = -(a[0] * dx + a[1] * dy) / length2;
    let reach2 = middle * middle - (a[0] * a[0] + a[1] * a[1] - radius * radius) / length2;
    if reach2 <= 0.0 {
        return sector(a, b);
    }
    let reach = reach2.sqrt();
    let (t0, t1) = ((middle - reach).clamp(0.0, 1.0), (middle + reach).clamp(0.0, 1.0));
    if t0 >= t1 {
        return sector(a, b);
    }
    let (p, q) = (at(t0), at(t1));
    let before = if t0 > 0.0 { sector(a, p) } else { 0.0 };
    let after = if t1 < 1.0 { sector(q, b) } else { 0.0 };
    before + 0.5 * cross(p, q) + after
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sum(aperture: &Aperture) -> f64 {
        (-40..80)
            .flat_map(|y| (-40..80).map(move |x| (x, y)))
            .map(|(x, y)| aperture.overlap(f64::from(x), f64::from(y)))
            .sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        /// Truth: the areas of all pixels add up to πr² and πr² + 2rL, whatever the place. Tolerance: rounding over 14 400 pixels.
        #[test]
        fn areas_add_up(x in -3.0..30.0, y in -3.0..30.0, r in 0.05..18.0, u in -16.0..16.0, v in -16.0..16.0) {
            let disc = Aperture::disc([x, y].into(), r);
            prop_assert!((sum(&disc) - disc.area_px2()).abs() < 1e-9 * (1.0 + disc.area_px2()));
            let pill = Aperture { trail_px: [u, v].into(), ..disc };
            prop_assert!((sum(&pill) - pill.area_px2()).abs() < 1e-8 * (1.0 + pill.area_px2()));
        }

        /// Truth: the disc's area by its other closed form (edges and sectors of a polygon, with no quadrants). Tolerance: rounding.
        #[test]
        fn a_pixel_is_cut_the_same_in_two_ways(x in -9.0..9.0, y in -9.0..9.0, r in 0.05..9.0) {
            let other = Polygon::square(x, y).in_disc(r);
            prop_assert!((disc_square(x, y, r) - other).abs() < 1e-10);
        }
    }

    #[test]
    fn a_trail_along_the_rows_is_a_rectangle_with_round_ends() {
        // Truth: pixels counted by hand: radius 1.5, so three whole rows between the ends.
        let pill = Aperture {
            centre_px: DVec2::splat(10.0),
            radius_px: 1.5,
            trail_px: DVec2::new(8.0, 0.0),
        };
        for (x, y, area) in
            [(10.0, 11.0, 1.0), (10.0, 12.0, 0.0), (7.0, 9.0, 1.0), (16.0, 10.0, 0.0)]
        {
            assert!((pill.overlap(x, y) - area).abs() < 1e-12, "{x} {y}");
        }
        // A pixel that the flat side halves.
        let half = Aperture { radius_px: 2.0, ..pill };
        assert!((half.overlap(10.0, 12.0) - 0.5).abs() < 1e-12);
    }
}
