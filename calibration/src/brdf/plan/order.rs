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
    let n = directions.len();
    let mut left: Vec<usize> = (0..n).collect();
    let mut order = Vec::with_capacity(n);
    let mut here = from;
    while !left.is_empty() {
        let far = |k: &usize| (directions[left[*k]] - here).length_squared();
        let Some(next) = (0..left.len()).min_by(|a, b| far(a).total_cmp(&far(b))) else { break };
        let next = left.swap_remove(next);
        here = directions[next];
        order.push(next);
    }
    let between = |a: usize, b: usize| angle(directions[a], directions[b]);
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
