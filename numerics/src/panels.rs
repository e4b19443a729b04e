//! Gauss–Legendre quadrature over panels that become smaller towards where an integrand varies fast.

use crate::gauss::legendre;
use std::sync::LazyLock;

/// The numbers of points of a panel that are tried one after the other.
pub const ORDERS: [usize; 7] = [6, 9, 13, 19, 28, 40, 56];

/// Points between −1 and 1 and their weights, of each order.
static RULES: LazyLock<Vec<Vec<(f64, f64)>>> =
    LazyLock::new(|| ORDERS.iter().map(|&n| legendre(n)).collect());

/// Points and weights over all panels between consecutive `edges`, for the order `ORDERS[order]`.
pub fn points(edges: &[f64], order: usize) -> Vec<(f64, f64)> {
    let panel = |pair: &[f64]| {
        let (middle, half) = (0.5 * (pair[0] + pair[1]), 0.5 * (pair[1] - pair[0]));
        RULES[order].iter().map(move |(x, w)| (middle + half * x, half * w))
    };
    edges.windows(2).flat_map(panel).collect()
}

/// Points and weights of one panel.
pub fn panel(from: f64, to: f64, order: usize) -> impl Iterator<Item = (f64, f64)> {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    RULES[order].iter().map(move |(x, w)| (middle + half * x, half * w))
}

/// Edges from `from` to `to`, in panels that shrink by thirds towards `to` down to `scale` (a length above 0).
///
/// ```
/// let edges = sunglint_numerics::panels::towards(0.0, 9.0, 0.5);
/// assert_eq!(edges, [0.0, 6.0, 8.0, 9.0]);
/// ```
pub fn towards(from: f64, to: f64, scale: f64) -> Vec<f64> {
    let mut edges = vec![from];
    let mut left = (to - from) / 3.0;
    while left.abs() > scale {
        edges.push(to - left);
        left /= 3.0;
    }
    edges.push(to);
    edges
}

/// Raises the order until two agree within `tolerance` (relative, of the largest component), and gives the better with the difference.
///
/// ```
/// use sunglint_numerics::panels::{converge, panel};
///
/// let sine = |order| [panel(0.0, std::f64::consts::PI, order).map(|(x, w)| w * x.sin()).sum()];
/// let ([integral], error) = converge(1e-10, sine);
/// assert!((integral - 2.0_f64).abs() < 1e-10 && error <= 1e-10);
/// ```
pub fn converge<const N: usize>(
    tolerance: f64,
    mut integral: impl FnMut(usize) -> [f64; N],
) -> ([f64; N], f64) {
    let (value, error) =
        converge_all(tolerance, 0, N, |order, sum| sum.copy_from_slice(&integral(order)));
    let mut found = [0.0; N];
    found.copy_from_slice(&value);
    (found, error)
}

/// [`converge`] of `count` components, from the order `first` on.
pub fn converge_all(
    tolerance: f64,
    first: usize,
    count: usize,
    mut integral: impl FnMut(usize, &mut [f64]),
) -> (Vec<f64>, f64) {
    let (mut last, mut next) = (vec![0.0; count], vec![0.0; count]);
    integral(first, &mut last);
    let mut error = f64::INFINITY;
    for order in first + 1..ORDERS.len() {
        next.fill(0.0);
        integral(order, &mut next);
        let size = next.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs()));
        error = next.iter().zip(&last).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs())) / size;
        std::mem::swap(&mut last, &mut next);
        if error <= tolerance {
            break;
        }
    }
    (last, error)
}
