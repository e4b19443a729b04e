//! Points that lie in one place are one point.

use glam::DVec3;
use std::collections::HashMap;

/// For every point the number of its place, and the places: the first point that came to each.
pub fn weld(points: &[DVec3], tolerance_m: f64) -> (Vec<u32>, Vec<DVec3>) {
    let cell = 8.0 * tolerance_m;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::with_capacity(points.len());
    let mut places: Vec<DVec3> = Vec::new();
    let mut numbers = Vec::with_capacity(points.len());
    let key = |p: DVec3| (p / cell).floor().to_array().map(|x| x as i64);
    for &point in points {
        // The cells that a ball of the tolerance reaches: one, mostly.
        let (low, high) = (key(point - tolerance_m), key(point + tolerance_m));
        let mut found = None;
        'search: for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let Some(there) = cells.get(&[x, y, z]) else { continue };
                    found = there
                        .iter()
                        .copied()
                        .find(|&k| places[k as usize].distance(point) <= tolerance_m);
                    if found.is_some() {
                        break 'search;
                    }
                }
            }
        }
        numbers.push(found.unwrap_or_else(|| {
            let number = places.len() as u32;
            places.push(point);
            cells.entry(key(point)).or_default().push(number);
            number
        }));
    }
    (numbers, places)
}
