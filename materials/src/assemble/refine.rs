//! Values on a square grid that are asked for only where they are not what their neighbours say.

/// Steps of the grid between nodes that are always asked, twice: of 9 nodes of such a square all are.
const COARSE: usize = 8;
/// A square is even where its corners say what stands between them within this part of the possible error. The nodes between those that were asked are usually off by a quarter of it; all of it is
/// added to their own.
const OF_DOUBT: f64 = 0.5;
/// Possible errors are alike where the largest is at most so many times the least: of those around a node it gets the largest.
const ALIKE: f64 = 1.5;
/// The edge of what was measured is known to half of so many steps: closer it is not looked for.
const EDGE: usize = 4;

/// Values at the nodes, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Filled {
    /// Logarithms, by node and channel.
    pub ln: Vec<f64>,
    /// Their possible error.
    pub doubt: Vec<f64>,
    /// Whether it was measured there.
    pub measured: Vec<bool>,
    /// Number of nodes that were asked.
    pub asked: usize,
}

/// Writes the logarithms of a node, and gives their possible error, and whether they were measured.
pub(super) trait Ask: FnMut(usize, &mut [f64]) -> (f64, bool) {}

impl<F: FnMut(usize, &mut [f64]) -> (f64, bool)> Ask for F {}

/// Fills a grid of `side` nodes by `side`: asked at each eighth at least and in the middles between them, then closer where that is not enough.
pub(super) fn filled(side: usize, channels: usize, ask: impl Ask) -> Filled {
    let nodes = side * side;
    let found = Filled {
        ln: vec![0.0; nodes * channels],
        doubt: vec![0.0; nodes],
        measured: vec![false; nodes],
        asked: 0,
    };
    let mut grid = Refining { side, channels, ask, known: vec![false; nodes], found };
    let last = side.saturating_sub(1);
    grid.square([0, 0], [last, last]);
    grid.found
}

struct Refining<F> {
    side: usize,
    channels: usize,
    ask: F,
    known: Vec<bool>,
    found: Filled,
}

/// Weights of two places for one between them.
fn between(x: usize, from: usize, to: usize) -> [f64; 2] {
    let t = if to > from { (x - from) as f64 / (to - from) as f64 } else { 0.0 };
    [1.0 - t, t]
}

impl<F: Ask> Refining<F> {
    fn node(&self, [x, y]: [usize; 2]) -> usize {
        y * self.side + x
    }

    fn know(&mut self, at: [usize; 2]) {
        let node = self.node(at);
        if std::mem::replace(&mut self.known[node], true) {
            return;
        }
        let Filled { ln, doubt, measured, asked } = &mut self.found;
        let row = &mut ln[node * self.channels..(node + 1) * self.channels];
        (doubt[node], measured[node]) = (self.ask)(node, row);
        *asked += 1;
    }

    /// The nodes from one corner to the opposite one.
    fn square(&mut self, from: [usize; 2], to: [usize; 2]) {
        let size = (to[0] - from[0]).max(to[1] - from[1]);
        let [xs, ys] = [0, 1].map(|k| [from[k], usize::midpoint(from[k], to[k]), to[k]]);
        let mut off = None;
        if size <= COARSE {
            for y in ys {
                xs.iter().for_each(|x| self.know([*x, y]));
            }
            off = self.off(from, to, xs, ys).filter(|_| size <= EDGE || self.is_alike(xs, ys));
        }
        for (y0, y1) in [(ys[0], ys[1]), (ys[1], ys[2])] {
            for (x0, x1) in [(xs[0], xs[1]), (xs[1], xs[2])] {
                // The half of one step is none.
                let nothing = (x0 == x1 && from[0] < to[0]) || (y0 == y1 && from[1] < to[1]);
                match off {
                    _ if nothing || size <= 1 => {}
                    Some(off) => self.fill([x0, y0], [x1, y1], off),
                    None => self.square([x0, y0], [x1, y1]),
                }
            }
        }
    }

    /// The corners of a square with their weights for a node in it.
    fn corners(&self, from: [usize; 2], to: [usize; 2], at: [usize; 2]) -> [(usize, f64); 4] {
        let [across, along] = [0, 1].map(|k| between(at[k], from[k], to[k]));
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| {
            let corner = [[from[0], to[0]][a], [from[1], to[1]][b]];
            (self.node(corner), across[a] * along[b])
        })
    }

    fn said(&self, corners: &[(usize, f64); 4], channel: usize) -> f64 {
        corners.iter().map(|(node, w)| w * self.found.ln[node * self.channels + channel]).sum()
    }

    /// Returns the largest distance of what the corners say from what stands at the other nodes of nine; `None` where that is too much, or no number.
    fn off(&self, from: [usize; 2], to: [usize; 2], xs: [usize; 3], ys: [usize; 3]) -> Option<f64> {
        let mut most = 0.0_f64;
        for at in ys.iter().flat_map(|y| xs.map(|x| [x, *y])) {
            let node = self.node(at);
            let corners = self.corners(from, to, at);
            let off = |k: usize| self.said(&corners, k) - self.found.ln[node * self.channels + k];
            for off in (0..self.channels).map(|k| off(k).abs()) {
                // Also false where anything is not a number.
                let even = off <= OF_DOUBT * self.found.doubt[node];
                if !even {
                    return None;
                }
                most = most.max(off);
            }
        }
        Some(most)
    }

    /// Whether nine nodes were all measured or none, and their possible errors are nearly the same.
    fn is_alike(&self, xs: [usize; 3], ys: [usize; 3]) -> bool {
        let nodes = || ys.iter().flat_map(|y| xs.map(|x| self.node([x, *y])));
        let first = self.found.measured[self.node([xs[0], ys[0]])];
        let doubts = nodes().map(|node| self.found.doubt[node]);
        let (least, most) = doubts.fold((f64::INFINITY, 0.0_f64), |(a, b), d| (a.min(d), b.max(d)));
        nodes().all(|node| self.found.measured[node] == first) && most <= ALIKE * least
    }

    /// The nodes of a square that are not known, by its corners, which may be off by so much. One corner that was not measured is enough: then they were not.
    fn fill(&mut self, from: [usize; 2], to: [usize; 2], off: f64) {
        let corners = self.corners(from, to, from).map(|(node, _)| node);
        let doubt = corners.iter().map(|node| self.found.doubt[*node]).fold(0.0, f64::max);
        let measured = corners.iter().all(|node| self.found.measured[*node]);
        for y in from[1]..=to[1] {
            for x in from[0]..=to[0] {
                let node = self.node([x, y]);
                if self.known[node] {
                    continue;
                }
                let corners = self.corners(from, to, [x, y]);
                for k in 0..self.channels {
                    self.found.ln[node * self.channels + k] = self.said(&corners, k);
                }
                self.found.doubt[node] = doubt.hypot(off);
                self.found.measured[node] = measured;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the function itself, at all nodes. It has a step along a line, a bump three nodes wide, and is smooth elsewhere; the edge of what was measured is another line.
    #[test]
    fn a_grid_is_what_was_asked_within_its_doubt() {
        for side in [1, 2, 4, 9, 66, 129] {
            let at = |node: usize| {
                let [x, y] = [node % side, node / side].map(|k| k as f64 / side as f64);
                let smooth = (3.0 * x).sin() + y * y + f64::from(u8::from(x > 0.77));
                let bump = (-(((x - 0.31) / 0.03).powi(2) + ((y - 0.52) / 0.03).powi(2))).exp();
                (smooth + bump, 0.02 + 0.05 * x, x + 2.0 * y > 1.3)
            };
            let ask = |node: usize, into: &mut [f64]| {
                let (ln, doubt, measured) = at(node);
                (into[0], into[1]) = (ln, -ln);
                (doubt, measured)
            };
            let found = filled(side, 2, ask);
            let mut lost = 0;
            for node in 0..side * side {
                let (ln, doubt, measured) = at(node);
                assert!((found.ln[2 * node] - ln).abs() <= OF_DOUBT * doubt, "{side} {node}");
                assert_eq!(found.ln[2 * node + 1], -found.ln[2 * node]);
                // Never less, but for a step of x where it grows.
                let larger = found.doubt[node] / doubt;
                assert!((0.95..=ALIKE * 1.2).contains(&larger), "{side} {node}: {larger}");
                assert!(measured || !found.measured[node], "{side} {node}");
                lost += usize::from(measured != found.measured[node]);
            }
            assert!(lost <= 2 * side, "{side}: {lost}");
            assert!(found.asked <= side * side);
            assert!(side < 129 || found.asked < side * side / 3, "{}", found.asked);
        }
    }

    /// Where something is not a number all nodes are asked.
    #[test]
    fn numbers_that_are_none_are_asked_for() {
        let function = |_: usize, into: &mut [f64]| {
            into[0] = f64::NAN;
            (0.1, true)
        };
        let found = filled(17, 1, function);
        assert_eq!(found.asked, 17 * 17);
    }
}
