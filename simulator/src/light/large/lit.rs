//! Which of the points that are seen are lit.

use super::raster::Flat;
use super::{Frame, Large, Question, Room as All};
use glam::DVec3;

/// Points sorted into cells across the direction of the Sun.
#[derive(Debug, Default)]
pub(super) struct Room {
    /// As they come.
    found: Vec<Sorted>,
    /// The cell of each.
    cells: Vec<u32>,
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
    /// Closes the points that no light reaches; `room.projected` holds the corners across and along the direction of the Sun.
    pub(super) fn light(
        &self,
        q: &Question,
        [view, sun]: [&Frame; 2],
        towards: &[DVec3],
        room: &mut All,
    ) {
        let All { projected, receivers, points, sunny, .. } = room;
        // A point's place in the Sun's axes.
        let turn = |p: [f64; 3]| sun.of(view.x * p[0] + view.y * p[1] + view.z * p[2]);
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
        let cells = sunny.sort(low, high);
        for p in projected.iter_mut() {
            p[0] = (p[0] - low[0]) * cells.per_m;
            p[1] = (p[1] - low[1]) * cells.per_m;
        }
        let mut start = 0;
        for ordered in &self.facets {
            let own = start..ordered.end as usize;
            start = own.end;
            if ordered.looks_away(towards) {
                continue;
            }
            for &[a, b, c] in &self.triangles[own] {
                let at = |k: u32| projected[k as usize];
                let Some((flat, turned)) = Flat::new(at(a), at(b), at(c)) else { continue };
                if !turned || ordered.sheet {
                    sunny.shade(&flat, &cells);
                }
            }
        }
        for point in sunny.sorted.iter().filter(|p| p.dark) {
            points[point.number as usize].open = false;
        }
    }
}

/// The cells of the sorted points.
#[derive(Debug, Clone, Copy)]
struct Cells {
    per_m: f64,
    columns: usize,
    rows: usize,
}

impl Room {
    /// Sorts the points by cells, about two for each point, and turns their places into cells from `low`.
    fn sort(&mut self, low: [f64; 2], high: [f64; 2]) -> Cells {
        let (width, height) = (high[0] - low[0], high[1] - low[1]);
        let wanted = 2.0 * self.found.len() as f64;
        // No longer than it has cells to give: points may all lie on a line.
        let per_m = (wanted / (width * height)).sqrt().min(wanted / width.max(height));
        let per_m = if per_m.is_finite() { per_m } else { 1.0 };
        let (columns, rows) = ((width * per_m) as usize + 1, (height * per_m) as usize + 1);
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
        Cells { per_m, columns, rows }
    }

    /// Marks the points below a triangle.
    #[inline]
    fn shade(&mut self, flat: &Flat, cells: &Cells) {
        let ((x0, x1), (y0, y1)) = (flat.span(0), flat.span(1));
        if x1 < 0.0 || y1 < 0.0 || x0 >= cells.columns as f64 || y0 >= cells.rows as f64 {
            return;
        }
        // A float becomes 0 below 0.
        let (left, right) = (x0 as usize, (x1 as usize).min(cells.columns - 1));
        let (first, last) = (y0 as usize, (y1 as usize).min(cells.rows - 1));
        let wide = (right - left + 1) * (last - first + 1) > 64;
        let high = flat.a[2].max(flat.b[2]).max(flat.c[2]);
        for row in first..=last {
            let (mut from, mut to) = (left, right);
            if wide {
                let (low, high) = flat.strip(row as f64, row as f64 + 1.0);
                // A cell more on either side, for rounding.
                from = from.max((low - 1.0).max(0.0) as usize);
                to = to.min((high + 1.0).max(0.0) as usize);
                if from > to {
                    continue;
                }
            }
            // The cells of a row stand one behind the other.
            let range = self.starts[row * cells.columns + from] as usize
                ..self.starts[row * cells.columns + to + 1] as usize;
            for point in &mut self.sorted[range] {
                if point.above < high
                    && !point.dark
                    && flat.depth(point.x, point.y).is_some_and(|z| z > point.above)
                {
                    point.dark = true;
                }
            }
        }
    }
}
