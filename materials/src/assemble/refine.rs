//! Values on a square grid that are asked for only where they are not what their neighbours say.

/// Steps of the grid between nodes that are always asked, twice: of 9 nodes of such a square all are.
const COARSE: usize = 8;
/// A square is even where its corners say what stands between them within this part of the possible error: little is added to that in quadrature, and the nodes between those that were asked
/// are off by a quarter of it.
const OF_DOUBT: f64 = 0.2;
/// The same of the possible error's own logarithm.
const OF_LN_DOUBT: f64 = 0.3;

/// What is known at the nodes, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Filled {
    /// Logarithms, by node and channel.
    pub ln: Vec<f64>,
    /// Their possible error.
    pub doubt: Vec<f64>,
    /// Whether it was measured there.
    pub measured: Vec<bool>,
    /// How many nodes were asked.
    pub asked: usize,
}

/// Asks for the logarithms of a node, which it writes; gives their possible error, and whether they were measured.
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
    for y in (0..last.max(1)).step_by(COARSE) {
        for x in (0..last.max(1)).step_by(COARSE) {
            grid.square([x, y], [(x + COARSE).min(last), (y + COARSE).min(last)]);
        }
    }
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
        let [xs, ys] = [0, 1].map(|k| [from[k], usize::midpoint(from[k], to[k]), to[k]]);
        for y in ys {
            xs.iter().for_each(|x| self.know([*x, y]));
        }
        if to[0] - from[0] <= 1 && to[1] - from[1] <= 1 {
            return;
        }
        let even = self.is_even(from, to, xs, ys);
        for (y0, y1) in [(ys[0], ys[1]), (ys[1], ys[2])] {
            for (x0, x1) in [(xs[0], xs[1]), (xs[1], xs[2])] {
                // The half of one step is none.
                let nothing = (x0 == x1 && from[0] < to[0]) || (y0 == y1 && from[1] < to[1]);
                match (nothing, even) {
                    (true, _) => {}
                    (false, true) => self.fill([x0, y0], [x1, y1]),
                    (false, false) => self.square([x0, y0], [x1, y1]),
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

    fn doubted(&self, corners: &[(usize, f64); 4]) -> f64 {
        corners.iter().map(|(node, w)| w * self.found.doubt[*node]).sum()
    }

    /// Whether the corners say what stands at the other nodes of nine.
    fn is_even(&self, from: [usize; 2], to: [usize; 2], xs: [usize; 3], ys: [usize; 3]) -> bool {
        let first = self.found.measured[self.node(from)];
        ys.iter().flat_map(|y| xs.map(|x| [x, *y])).all(|at| {
            let node = self.node(at);
            let (corners, doubt) = (self.corners(from, to, at), self.found.doubt[node]);
            let off = |k: usize| self.said(&corners, k) - self.found.ln[node * self.channels + k];
            // Also false where anything is not a number.
            self.found.measured[node] == first
                && (self.doubted(&corners) / doubt).ln().abs() <= OF_LN_DOUBT
                && (0..self.channels).all(|k| off(k).abs() <= OF_DOUBT * doubt)
        })
    }

    /// The nodes of a square that are not known, by its corners.
    fn fill(&mut self, from: [usize; 2], to: [usize; 2]) {
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
                self.found.doubt[node] = self.doubted(&corners);
                self.found.measured[node] = self.found.measured[corners[0].0];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the function itself, at all nodes. It has a step along a line, a bump three nodes wide, and is smooth elsewhere.
    #[test]
    fn a_grid_is_what_was_asked_within_its_doubt() {
        for side in [4, 9, 66, 129] {
            let at = |node: usize| {
                let [x, y] = [node % side, node / side].map(|k| k as f64 / (side - 1) as f64);
                let smooth = (3.0 * x).sin() + y * y;
                let bump = (-(((x - 0.31) / 0.03).powi(2) + ((y - 0.52) / 0.03).powi(2))).exp();
                (smooth + bump, 0.02 + 0.05 * x, x + 2.0 * y > 1.3)
            };
            let ask = |node: usize, into: &mut [f64]| {
                let (ln, doubt, measured) = at(node);
                (into[0], into[1]) = (ln, -ln);
                (doubt, measured)
            };
            let found = filled(side, 2, ask);
            for node in 0..side * side {
                let (ln, doubt, measured) = at(node);
                assert!((found.ln[2 * node] - ln).abs() <= OF_DOUBT * doubt, "{side} {node}");
                assert_eq!(found.ln[2 * node + 1], -found.ln[2 * node]);
                assert!((found.doubt[node] / doubt).ln().abs() <= OF_LN_DOUBT);
                assert_eq!(found.measured[node], measured, "{side} {node}");
            }
            assert!(found.asked <= side * side);
            assert!(side < 129 || found.asked < side * side / 3, "{}", found.asked);
        }
    }

    /// What is not a number makes nothing even: all nodes are asked.
    #[test]
    fn numbers_that_are_none_are_asked_for() {
        let found = filled(17, 1, |_: usize, into: &mut [f64]| {
            into[0] = f64::NAN;
            (0.1, true)
        });
        assert_eq!(found.asked, 17 * 17);
    }
}
