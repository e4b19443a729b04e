//! Integrals over the unit square by adaptive Gauss–Legendre cubature.
//!
//! Each cell is integrated with 5 × 5 and with 3 × 3 points; their difference, which is far more than the error of the first where the
//! integrand is smooth, decides which cell is cut in four next.

use super::scatter::Effort;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Points from −1 to 1 and weights (Abramowitz and Stegun, table 25.4).
const FIVE: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];
const THREE: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

/// A rectangle: from, to in each coordinate.
pub(super) type Cell = [(f64, f64); 2];

struct Done {
    cell: Cell,
    value: Vec<f64>,
    error: f64,
}

impl PartialEq for Done {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Done {}

impl PartialOrd for Done {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Done {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error)
    }
}

/// ∫ of `count` components over `cells`, and the estimated error (absolute, of the worst component). `add` adds a scale times the integrand at a point. Stops
/// where the error is below `tolerance` of the largest component, or after `most` evaluations.
pub(super) fn integrate(
    cells: &[Cell],
    count: usize,
    Effort { tolerance, most }: Effort,
    mut add: impl FnMut([f64; 2], f64, &mut [f64]),
) -> (Vec<f64>, f64) {
    let mut coarse = vec![0.0; count];
    let mut on = |cell: Cell| {
        let mut value = vec![0.0; count];
        rule(&FIVE, cell, &mut value, &mut add);
        coarse.fill(0.0);
        rule(&THREE, cell, &mut coarse, &mut add);
        let error = value.iter().zip(&coarse).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs()));
        Done { cell, value, error }
    };
    let mut heap: BinaryHeap<Done> = cells.iter().map(|&cell| on(cell)).collect();
    let mut used = 34 * cells.len();
    loop {
        let error: f64 = heap.iter().map(|done| done.error).sum();
        let mut sum = vec![0.0; count];
        for done in &heap {
            sum.iter_mut().zip(&done.value).for_each(|(s, v)| *s += v);
        }
        let size = sum.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if error <= tolerance * size || used >= most || size == 0.0 && used > 2000 {
            return (sum, error);
        }
        // A quarter of the cells at a time, so that the sums cost little.
        for _ in 0..heap.len().div_ceil(4) {
            let Some(Done { cell: [x, y], .. }) = heap.pop() else { break };
            let middle = (0.5 * (x.0 + x.1), 0.5 * (y.0 + y.1));
            for x in [(x.0, middle.0), (middle.0, x.1)] {
                for y in [(y.0, middle.1), (middle.1, y.1)] {
                    heap.push(on([x, y]));
                    used += 34;
                }
            }
        }
    }
}

fn rule(
    points: &[(f64, f64)],
    [x, y]: Cell,
    sum: &mut [f64],
    add: &mut impl FnMut([f64; 2], f64, &mut [f64]),
) {
    let (half_x, half_y) = (0.5 * (x.1 - x.0), 0.5 * (y.1 - y.0));
    for (s, width) in points {
        for (t, height) in points {
            let at = [x.0 + half_x * (1.0 + s), y.0 + half_y * (1.0 + t)];
            add(at, half_x * half_y * width * height, sum);
        }
    }
}
