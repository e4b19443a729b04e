//! Which corners are one.

use glam::DVec3;
use std::collections::HashMap;

/// For every point the index of the first of those that are it: equal, or linked by steps of at most `tolerance`. Steps up to 3/4 of it
/// always count; those between only from points that stand for a crowd, so that a million points in one place cost no more than
/// a million elsewhere.
pub(super) fn weld(points: &[DVec3], tolerance: f64) -> Vec<u32> {
    let mut to: Vec<u32> = (0..points.len() as u32).collect();
    let mut exact: HashMap<[u64; 3], u32> = HashMap::with_capacity(points.len());
    for (i, point) in points.iter().enumerate() {
        // Adding 0 makes −0 the same as 0.
        let bits = (*point + DVec3::ZERO).to_array().map(f64::to_bits);
        to[i] = *exact.entry(bits).or_insert(i as u32);
    }
    drop(exact);
    if tolerance <= 0.0 || !tolerance.is_finite() {
        return to;
    }
    // Cells of eight tolerances: most points look into their own cell alone.
    let cell = 8.0 * tolerance;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for i in 0..points.len() {
        if to[i] as usize != i {
            continue;
        }
        let point = points[i];
        let index = |p: DVec3| (p / cell).floor().to_array().map(|x| x as i64);
        let (low, high) = (index(point - tolerance), index(point + tolerance));
        let mut crowded = false;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    for &other in cells.get(&[x, y, z]).map_or(&[][..], Vec::as_slice) {
                        let apart = points[other as usize].distance(point);
                        if apart <= tolerance {
                            join(&mut to, other, i as u32);
                        }
                        crowded |= apart <= 0.25 * tolerance;
                    }
                }
            }
        }
        if !crowded {
            cells.entry(index(point)).or_default().push(i as u32);
        }
    }
    (0..to.len() as u32).map(|i| root(&mut to, i)).collect()
}

/// The first of a set, with the path to it shortened.
pub(super) fn root(to: &mut [u32], mut i: u32) -> u32 {
    while to[i as usize] != i {
        to[i as usize] = to[to[i as usize] as usize];
        i = to[i as usize];
    }
    i
}

/// Makes two sets one; the smaller index is its first.
pub(super) fn join(to: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(to, a), root(to, b));
    to[a.max(b) as usize] = a.min(b);
}
