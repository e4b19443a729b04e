//! The local background of an image: levels and scatters of its tiles.

use super::levels::Counter;

/// Pixels across a tile of the local background.
pub(crate) const TILE: usize = 32;

/// Levels and scatters of the tiles of an image, each the median of its neighbourhood.
#[derive(Debug)]
pub(crate) struct Tiles {
    count: [usize; 2],
    size: [f64; 2],
    level: Vec<f32>,
    sigma: Vec<f32>,
    /// Tiles beyond the middles of the outer ones into which levels are continued.
    beyond: f64,
}

/// Columns between two tiles' middles with one nearest tile: the tile to the left of them, and the nearest.
struct Stretch {
    columns: std::ops::Range<usize>,
    left: usize,
    nearest: usize,
}

impl Tiles {
    /// Measures the tiles of an image, row by row; `step` is the step of its values, or 0. Values that are not a number do not count.
    pub fn of(
        values: &[f32],
        [width, height]: [usize; 2],
        step: f32,
        counter: &mut Counter,
    ) -> Self {
        let count = [width, height].map(|n| (n / TILE).max(1));
        let size = [width as f64 / count[0] as f64, height as f64 / count[1] as f64];
        let (mut level, mut sigma) = (Vec::new(), Vec::new());
        let edge =
            |axis: usize, i: usize, n: usize| ((i as f64 * size[axis]).round() as usize).min(n);
        for row in 0..count[1] {
            for column in 0..count[0] {
                let across = edge(0, column, width)..edge(0, column + 1, width);
                let rows = (edge(1, row, height)..edge(1, row + 1, height))
                    .map(|y| &values[y * width..][across.clone()]);
                let found = counter.level(rows, step);
                level.push(found.map_or(f32::NAN, |l| l.level));
                sigma.push(found.map_or(f32::NAN, |l| l.sigma));
            }
        }
        // Whole counts scatter by 1/√12 at least.
        let least = 12f32.sqrt().recip();
        Self {
            count,
            size,
            level: around(&level, count, 0.0),
            sigma: around(&sigma, count, least).iter().map(|s| s.max(least)).collect(),
            beyond: 0.0,
        }
    }

    /// The same with levels that go on evenly to the image's edges: those of the outer tiles, which are medians of one side only, from the two tiles within, and beyond
    /// their middles as well.
    #[must_use]
    pub fn continued(mut self) -> Self {
        let [columns, rows] = self.count;
        if columns.min(rows) < 4 {
            return self;
        }
        for row in 0..rows {
            let line = &mut self.level[row * columns..][..columns];
            line[0] = 2.0 * line[1] - line[2];
            line[columns - 1] = 2.0 * line[columns - 2] - line[columns - 3];
        }
        for column in 0..columns {
            let at = |row: usize| row * columns + column;
            self.level[at(0)] = 2.0 * self.level[at(1)] - self.level[at(2)];
            let last = rows - 1;
            self.level[at(last)] = 2.0 * self.level[at(last - 1)] - self.level[at(last - 2)];
        }
        self.beyond = 0.5;
        self
    }

    /// The same with another scatter.
    #[must_use]
    pub fn with_noise_times(mut self, factor: f32) -> Self {
        self.sigma.iter_mut().for_each(|sigma| *sigma *= factor);
        self
    }

    /// Scatter of a pixel in the tile nearest to a place.
    pub fn sigma_at(&self, x: f64, y: f64) -> f32 {
        let tile = |at: f64, axis: usize| {
            (((at + 0.5) / self.size[axis]).max(0.0) as usize).min(self.count[axis] - 1)
        };
        self.sigma[tile(y, 1) * self.count[0] + tile(x, 0)]
    }

    /// Median of the tiles' levels.
    pub fn middle_level(&self) -> f64 {
        sunglint_numerics::order::median(self.level.iter().copied().map(f64::from))
            .unwrap_or(f64::NAN)
    }

    /// The stretches of a row of this width.
    fn stretches(&self, width: usize) -> Vec<Stretch> {
        let tile = |x: usize| {
            let place = (x as f64 + 0.5) / self.size[0];
            let nearest = (place as usize).min(self.count[0] - 1);
            let left = ((place - 0.5).max(0.0) as usize).min(self.count[0].saturating_sub(2));
            (left, nearest)
        };
        let mut stretches: Vec<Stretch> = Vec::new();
        for x in 0..width {
            let (left, nearest) = tile(x);
            match stretches.last_mut().filter(|s| s.left == left && s.nearest == nearest) {
                Some(stretch) => stretch.columns.end = x + 1,
                None => stretches.push(Stretch { columns: x..x + 1, left, nearest }),
            }
        }
        stretches
    }

    /// Puts the image above its background, in standard deviations of a pixel: the level between the tiles' middles, the scatter of the tile. What is
    /// no number becomes 0.
    pub fn take_off(&self, values: &mut [f32], width: usize) {
        let [columns, rows] = self.count;
        let stretches = self.stretches(width);
        let mut levels = vec![0.0; columns];
        let inverse_size = (1.0 / self.size[0]) as f32;
        let (low, high) = (-self.beyond as f32, 1.0 + self.beyond as f32);
        for (y, line) in values.chunks_exact_mut(width.max(1)).enumerate() {
            let place = (y as f64 + 0.5) / self.size[1];
            let nearest = (place as usize).min(rows - 1);
            let between = (place - 0.5).clamp(-self.beyond, (rows - 1) as f64 + self.beyond);
            let upper = (between as usize).min(if self.beyond > 0.0 { rows - 2 } else { rows - 1 });
            let v = (between - upper as f64) as f32;
            let lower = (upper + 1).min(rows - 1);
            for (column, level) in levels.iter_mut().enumerate() {
                *level = self.level[upper * columns + column] * (1.0 - v)
                    + self.level[lower * columns + column] * v;
            }
            for Stretch { columns: range, left, nearest: tile } in &stretches {
                let level = levels[*left];
                let rise = levels[(left + 1).min(columns - 1)] - level;
                let scale = self.sigma[nearest * columns + tile].recip();
                let start = (range.start as f64 + 0.5) / self.size[0] - 0.5 - *left as f64;
                let start = start as f32;
                for (i, value) in line[range.clone()].iter_mut().enumerate() {
                    let u = (start + i as u32 as f32 * inverse_size).clamp(low, high);
                    let above = (*value - (level + u * rise)) * scale;
                    *value = if above.is_nan() { 0.0 } else { above };
                }
            }
        }
    }
}

/// The median of each tile and its neighbours; `otherwise` where there is none.
fn around(values: &[f32], [columns, rows]: [usize; 2], otherwise: f32) -> Vec<f32> {
    let mut out = Vec::with_capacity(values.len());
    for row in 0..rows {
        for column in 0..columns {
            let mut near = [0.0; 9];
            let mut n = 0;
            for r in row.saturating_sub(1)..(row + 2).min(rows) {
                for value in
                    &values[r * columns..][column.saturating_sub(1)..(column + 2).min(columns)]
                {
                    if value.is_finite() {
                        near[n] = *value;
                        n += 1;
                    }
                }
            }
            near[..n].sort_unstable_by(f32::total_cmp);
            out.push(if n == 0 { otherwise } else { 0.5 * (near[(n - 1) / 2] + near[n / 2]) });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: a plane: between the middles of the outer tiles its medians and what is drawn between them are the plane itself, but in the tiles at the
    /// edge, where the median of a neighbourhood is not its middle's. Scatter is that of a tile's own slope.
    #[test]
    fn a_plane_is_its_own_background() {
        let size = [200, 130];
        let plane = |x: usize, y: usize| 1000.0 + 0.5 * x as f32 - 0.25 * y as f32;
        let mut values: Vec<f32> =
            (0..size[0] * size[1]).map(|i| plane(i % size[0], i / size[0])).collect();
        values[60 * 200 + 70] = f32::NAN;
        let tiles = Tiles::of(&values, size, 0.0, &mut Counter::default());
        tiles.take_off(&mut values, size[0]);
        for y in 50..80 {
            for x in 52..148 {
                let value = values[y * 200 + x];
                // In standard deviations of some 6, of which a bin is a thirtieth.
                assert!(value.abs() < 0.04, "{x} {y}: {value}");
            }
        }
        assert_eq!(values[60 * 200 + 70], 0.0);
    }
}
