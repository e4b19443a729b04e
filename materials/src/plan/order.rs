//! In which order directions are visited: the next nearest, then crossings taken out (2-opt) until none is left that shortens the way.

use glam::DVec3;

/// Rounds of 2-opt; the way is then as short as rounds can make it in practice.
const ROUNDS: usize = 40;

fn angle(a: DVec3, b: DVec3) -> f64 {
    // Accurate for directions that are close together, where arccos is not.
    2.0 * (0.5 * (a - b).length()).min(1.0).asin()
}

/// The length of a way, degrees.
pub(super) fn travel_deg(way: &[DVec3]) -> f64 {
    way.windows(2).map(|pair| angle(pair[0], pair[1])).sum::<f64>().to_degrees()
}

/// An order of directions that begins near `from`.
pub(super) fn shortest(directions: &[DVec3], from: DVec3) -> Vec<usize> {
    let between = |a: usize, b: usize| angle(directions[a], directions[b]);
    shortest_by(directions.len(), &|k| angle(directions[k], from), &between)
}

/// An order of `n` places that begins near the start, by what the way to a place costs from the start, and between two.
pub(crate) fn shortest_by(
    n: usize,
    start: &dyn Fn(usize) -> f64,
    between: &dyn Fn(usize, usize) -> f64,
) -> Vec<usize> {
    let mut left: Vec<usize> = (0..n).collect();
    let mut order: Vec<usize> = Vec::with_capacity(n);
    while !left.is_empty() {
        let far = |k: &usize| match order.last() {
            None => start(left[*k]),
            Some(here) => between(left[*k], *here),
        };
        let Some(next) = (0..left.len()).min_by(|a, b| far(a).total_cmp(&far(b))) else { break };
        order.push(left.swap_remove(next));
    }
    for _ in 0..ROUNDS {
        let mut shorter = false;
        for i in 0..n.saturating_sub(1) {
            for j in i + 1..n {
                // The stretch i+1…j the other way round.
                let now = between(order[i], order[i + 1])
                    + if j + 1 < n { between(order[j], order[j + 1]) } else { 0.0 };
                let then = between(order[i], order[j])
                    + if j + 1 < n { between(order[i + 1], order[j + 1]) } else { 0.0 };
                if then < now - 1e-9 {
                    order[i + 1..=j].reverse();
                    shorter = true;
                }
            }
        }
        if !shorter {
            break;
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn permutations(k: usize, order: &mut Vec<usize>, all: &mut Vec<Vec<usize>>) {
        if k == order.len() {
            return all.push(order.clone());
        }
        for j in k..order.len() {
            order.swap(k, j);
            permutations(k + 1, order, all);
            order.swap(k, j);
        }
    }

    /// Truth: the shortest of all 5040 orders of seven directions. Tolerance 10 %: 2-opt takes crossings out, no more.
    #[test]
    fn nearly_the_shortest_way() {
        for seed in 0..20 {
            let at = |k: usize| {
                let (a, b) = ((seed * 7 + k) as f64 * 1.618, (seed * 3 + k * k) as f64 * 0.754);
                DVec3::new(a.sin(), b.sin(), 1.0).normalize()
            };
            let directions: Vec<DVec3> = (0..7).map(at).collect();
            let way = |order: &[usize]| {
                travel_deg(&order.iter().map(|k| directions[*k]).collect::<Vec<_>>())
            };
            let found = shortest(&directions, directions[0]);
            let mut sorted = found.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3, 4, 5, 6]);
            let mut all = Vec::new();
            permutations(1, &mut (0..7).collect(), &mut all);
            let best = all.iter().map(|o| way(o)).fold(f64::INFINITY, f64::min);
            assert!(way(&found) <= 1.1 * best, "{seed}: {} {best}", way(&found));
        }
    }
}
