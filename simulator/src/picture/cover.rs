//! Convex polygons laid over pixels by their exact area.

/// Sums of value times covered share of each pixel.
///
/// The part of a row of pixels that a polygon covers is what lies right of its left edges less what lies right of its right ones. Each edge
/// is entered as a difference along its row, so that a running sum along the rows gives all polygons at once.
#[derive(Debug, Clone)]
pub struct Cover {
    width: usize,
    height: usize,
    differences: Vec<f64>,
}

impl Cover {
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, differences: vec![0.0; (width + 1) * height] }
    }

    /// Adds a polygon in pixel coordinates, x along rows from the left edge of the first pixel, y across them; counter-clockwise if y
    /// were upwards.
    pub(crate) fn add(&mut self, polygon: &[[f64; 2]], value: f64) {
        for (k, from) in polygon.iter().enumerate() {
            self.edge(*from, polygon[(k + 1) % polygon.len()], value);
        }
    }

    fn edge(&mut self, from: [f64; 2], to: [f64; 2], value: f64) {
        // Its left edges then run towards smaller y.
        let (top, bottom, sign) =
            if from[1] > to[1] { (to, from, value) } else { (from, to, -value) };
        let rise = bottom[1] - top[1];
        let height = self.height as f64;
        if rise <= 0.0 || bottom[1] <= 0.0 || top[1] >= height {
            return;
        }
        let slope = (bottom[0] - top[0]) / rise;
        let x = |y: f64| top[0] + slope * (y - top[1]);
        let (first, last) = (top[1].max(0.0), bottom[1].min(height));
        for row in first as usize..(last.ceil() as usize).min(self.height) {
            let (y0, y1) = (first.max(row as f64), last.min((row + 1) as f64));
            if y1 > y0 {
                self.row(row, (x(y0), x(y1)), sign * (y1 - y0));
            }
        }
    }

    /// Enters an edge that runs from one x to another within a row, `amount` high.
    fn row(&mut self, row: usize, (a, b): (f64, f64), amount: f64) {
        let width = self.width as f64;
        let line = &mut self.differences[row * (self.width + 1)..(row + 1) * (self.width + 1)];
        let (low, high) = (a.min(b), a.max(b));
        let span = high - low;
        let mut enter = |x0: f64, x1: f64, amount: f64| {
            if x1 <= 0.0 {
                line[0] += amount;
            } else if x0 < width {
                let cell = (0.5 * (x0 + x1)).floor().clamp(0.0, width - 1.0);
                // How far into its pixel the edge stands on the average: that much of the pixel is left of it.
                let within = (0.5 * (x0 + x1) - cell).clamp(0.0, 1.0);
                line[cell as usize] += amount * (1.0 - within);
                line[cell as usize + 1] += amount * within;
            }
        };
        if span <= 0.0 {
            enter(low, high, amount);
            return;
        }
        let mut x = low;
        while x < high {
            // Outside the picture one step is enough.
            let next = if x < 0.0 {
                0.0
            } else if x >= width {
                high
            } else {
                x.floor() + 1.0
            };
            let next = next.min(high);
            enter(x, next, amount * (next - x) / span);
            x = next;
        }
    }

    /// The sums, row by row.
    pub fn finish(&self) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.width * self.height);
        for line in self.differences.chunks_exact(self.width + 1) {
            let mut sum = 0.0;
            out.extend(line[..self.width].iter().map(|d| {
                sum += d;
                sum
            }));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Truth: areas worked out by hand: a square over four pixels, a triangle over half of one, what lies beyond the edges.
    #[test]
    fn areas_of_simple_figures() {
        let mut cover = Cover::new(3, 2);
        cover.add(&[[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]], 4.0);
        cover.add(&[[2.0, 0.0], [3.0, 0.0], [3.0, 1.0]], 2.0);
        let found = cover.finish();
        for (found, expected) in found.iter().zip([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
        let mut cover = Cover::new(2, 2);
        cover.add(&[[-5.0, -5.0], [7.0, -5.0], [7.0, 7.0], [-5.0, 7.0]], 1.0);
        cover.add(&[[-9.0, 0.0], [-1.0, 0.0], [-1.0, 1.0]], 1.0);
        cover.add(&[[3.0, 0.0], [4.0, 0.0], [4.0, 1.0]], 1.0);
        assert!(cover.finish().iter().all(|v| (v - 1.0).abs() < 1e-12));
    }

    proptest! {
        /// Truth: the shoelace formula: whatever the triangle within the picture, its pixels hold its area; and none less than nothing or more than all.
        #[test]
        fn a_triangle_keeps_its_area(p in prop::array::uniform6(0.0..7.0_f64)) {
            let mut t = [[p[0], p[1]], [p[2], p[3]], [p[4], p[5]]];
            let twice = (p[2] - p[0]) * (p[5] - p[1]) - (p[4] - p[0]) * (p[3] - p[1]);
            if twice < 0.0 {
                t.swap(1, 2);
            }
            let mut cover = Cover::new(7, 7);
            cover.add(&t, 1.0);
            let pixels = cover.finish();
            prop_assert!((pixels.iter().sum::<f64>() - 0.5 * twice.abs()).abs() < 1e-11);
            prop_assert!(pixels.iter().all(|v| (-1e-11..=1.0 + 1e-11).contains(v)));
        }
    }
}
