//! Which of the points that are seen are lit.

use super::cast::Cast;
use super::cover::{Canvas, Spot};
use super::{Large, Question, Room as All};
use std::ops::RangeInclusive;

/// Points sorted into cells across the direction of the Sun.
#[derive(Debug, Default)]
pub(super) struct Room {
    /// Points in the order in which they come.
    found: Vec<Sorted>,
    /// The cell of each.
    cells: Vec<u32>,
    /// Columns and rows.
    size: [usize; 2],
    starts: Vec<u32>,
    next: Vec<u32>,
    sorted: Vec<Sorted>,
}

/// A point in its cell.
#[derive(Debug, Clone, Copy, Default)]
struct Sorted {
    /// Across the direction, in cells.
    x: f64,
    y: f64,
    /// A surface above this height hides it, m.
    above: f64,
    number: u32,
    dark: bool,
}

impl Large {
    /// Closes the points that no light reaches.
    pub(super) fn light(&self, q: &Question, view: &Cast, sun: &mut Cast, room: &mut All) {
        let All { receivers, points, sunny, cover, .. } = room;
        // A point's place in the Sun's axes.
        let (from, into) = (view.frame, sun.frame);
        let turn = |p: [f64; 3]| into.of(from.x * p[0] + from.y * p[1] + from.z * p[2]);
        sunny.found.clear();
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        let mut start = 0;
        for receiver in receivers.iter() {
            let own = start..receiver.end as usize;
            start = own.end;
            let margin = 2.0 * q.scene.touching_m / receiver.cos_i;
            for number in own {
                if !points[number].open {
                    continue;
                }
                let [x, y, z] = turn(points[number].place);
                low = [low[0].min(x), low[1].min(y)];
                high = [high[0].max(x), high[1].max(y)];
                let number = number as u32;
                sunny.found.push(Sorted { x, y, above: z + margin, number, dark: false });
            }
        }
        if sunny.found.is_empty() {
            return;
        }
        (sun.low, sun.per_m) = (low, sunny.sort(low, high));
        self.cover(sun, sunny, cover);
        for point in sunny.sorted.iter().filter(|p| p.dark) {
            points[point.number as usize].open = false;
        }
    }
}

impl Room {
    /// Sorts the points by cells, about two for each point, and turns their places into cells from `low`. Gives the cells for each metre.
    fn sort(&mut self, low: [f64; 2], high: [f64; 2]) -> f64 {
        let (width, height) = (high[0] - low[0], high[1] - low[1]);
        let wanted = 2.0 * self.found.len() as f64;
        // No longer than it has cells to give: points may all lie on a line.
        let per_m = (wanted / (width * height)).sqrt().min(wanted / width.max(height));
        let per_m = if per_m.is_finite() { per_m } else { 1.0 };
        let (columns, rows) = ((width * per_m) as usize + 1, (height * per_m) as usize + 1);
        self.size = [columns, rows];
        self.starts.clear();
        self.starts.resize(columns * rows + 1, 0);
        self.cells.clear();
        for point in &mut self.found {
            point.x = (point.x - low[0]) * per_m;
            point.y = (point.y - low[1]) * per_m;
            let cell =
                (point.y as usize).min(rows - 1) * columns + (point.x as usize).min(columns - 1);
            self.cells.push(cell as u32);
            self.starts[cell + 1] += 1;
        }
        for cell in 0..columns * rows {
            self.starts[cell + 1] += self.starts[cell];
        }
        self.next.clear();
        self.next.extend_from_slice(&self.starts);
        self.sorted.clear();
        self.sorted.resize(self.found.len(), Sorted::default());
        for (point, cell) in self.found.iter().zip(&self.cells) {
            let place = &mut self.next[*cell as usize];
            self.sorted[*place as usize] = *point;
            *place += 1;
        }
        per_m
    }
}

impl Canvas for Room {
    fn size(&self) -> [usize; 2] {
        self.size
    }

    #[inline]
    fn spots(&self, row: usize, columns: RangeInclusive<usize>, high: f64, out: &mut Vec<Spot>) {
        // The cells of a row stand one behind the other.
        let first = row * self.size[0];
        let range = self.starts[first + columns.start()]..self.starts[first + columns.end() + 1];
        let points = &self.sorted[range.start as usize..range.end as usize];
        let below = range.zip(points).filter(|(_, p)| p.above < high && !p.dark);
        out.extend(below.map(|(number, p)| Spot { number, x: p.x, y: p.y }));
    }

    fn next(&mut self, _: usize, _: bool) {}

    #[inline]
    fn cover(&mut self, spot: &Spot, depth: f64) {
        let point = &mut self.sorted[spot.number as usize];
        point.dark |= depth > point.above;
    }
}
