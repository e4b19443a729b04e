//! Which occluders may stand in the way of a ball, looking along one direction: a grid over their shadows.

use glam::DVec3;

/// Balls in a plane across a direction, by cells.
#[derive(Debug, Default)]
pub struct Grid {
    x: DVec3,
    y: DVec3,
    low: [f64; 2],
    per_cell: f64,
    size: [usize; 2],
    starts: Vec<u32>,
    members: Vec<u32>,
    /// Too wide for cells.
    wide: Vec<u32>,
    boxes: Vec<[f64; 4]>,
    seen: Vec<u32>,
    stamp: u32,
}

impl Grid {
    /// Sorts balls into cells across `direction`; those for which `wanted` is false are left out.
    pub fn fill(
        &mut self,
        direction: DVec3,
        middle: &[DVec3],
        radius: &[f64],
        wanted: impl Fn(usize) -> bool,
    ) {
        (self.x, self.y) = direction.any_orthonormal_pair();
        self.boxes.clear();
        self.wide.clear();
        let (mut low, mut high, mut count) = ([f64::MAX; 2], [f64::MIN; 2], 0_usize);
        for (k, (m, r)) in middle.iter().zip(radius).enumerate() {
            if !wanted(k) {
                self.boxes.push([f64::NAN; 4]);
                continue;
            }
            let (x, y) = (m.dot(self.x), m.dot(self.y));
            self.boxes.push([x - r, y - r, x + r, y + r]);
            low = [low[0].min(x - r), low[1].min(y - r)];
            high = [high[0].max(x + r), high[1].max(y + r)];
            count += 1;
        }
        self.seen.clear();
        self.seen.resize(middle.len(), 0);
        self.stamp = 0;
        let span = (high[0] - low[0]).max(high[1] - low[1]).max(f64::MIN_POSITIVE);
        let cells = ((count as f64).sqrt().ceil() as usize).clamp(1, 512);
        self.low = low;
        self.per_cell = cells as f64 / span;
        self.size = [cells, cells];
        self.starts.clear();
        self.starts.resize(cells * cells + 1, 0);
        if count == 0 {
            self.members.clear();
            return;
        }
        // Counted first, then put in place.
        for k in 0..middle.len() {
            let Some([a, b, c, d]) = self.cells(&self.boxes[k]) else { continue };
            if (c - a + 1) * (d - b + 1) > 64 {
                self.wide.push(k as u32);
                continue;
            }
            for row in b..=d {
                (a..=c).for_each(|column| self.starts[row * cells + column + 1] += 1);
            }
        }
        for cell in 0..cells * cells {
            self.starts[cell + 1] += self.starts[cell];
        }
        self.members.clear();
        self.members.resize(self.starts[cells * cells] as usize, 0);
        let mut next = self.starts.clone();
        for k in 0..middle.len() {
            let Some([a, b, c, d]) = self.cells(&self.boxes[k]) else { continue };
            if (c - a + 1) * (d - b + 1) > 64 {
                continue;
            }
            for row in b..=d {
                for column in a..=c {
                    let place = &mut next[row * cells + column];
                    self.members[*place as usize] = k as u32;
                    *place += 1;
                }
            }
        }
    }

    /// Columns and rows that a box touches.
    fn cells(&self, b: &[f64; 4]) -> Option<[usize; 4]> {
        if b[0].is_nan() {
            return None;
        }
        // A float becomes 0 below 0.
        let cell =
            |x: f64, k: usize| (((x - self.low[k]) * self.per_cell) as usize).min(self.size[k] - 1);
        Some([cell(b[0], 0), cell(b[1], 1), cell(b[2], 0), cell(b[3], 1)])
    }

    /// Appends those whose shadow may touch that of a ball, each once.
    pub fn near(&mut self, middle: DVec3, radius: f64, out: &mut Vec<u32>) {
        let (x, y) = (middle.dot(self.x), middle.dot(self.y));
        let here = [x - radius, y - radius, x + radius, y + radius];
        let touches = |b: &[f64; 4]| super::clip::overlap(&here, b);
        out.extend(self.wide.iter().copied().filter(|&k| touches(&self.boxes[k as usize])));
        let Some([a, b, c, d]) = self.cells(&here) else { return };
        self.stamp += 1;
        for row in b..=d {
            for column in a..=c {
                let cell = row * self.size[0] + column;
                let members = self.starts[cell] as usize..self.starts[cell + 1] as usize;
                for &k in &self.members[members] {
                    if self.seen[k as usize] != self.stamp && touches(&self.boxes[k as usize]) {
                        self.seen[k as usize] = self.stamp;
                        out.push(k);
                    }
                }
            }
        }
    }
}
