//! Which star of a list is which source of a frame: from the frame's own world coordinates, or found from the pattern of its bright sources.
//!
//! Places are displaced by the most frequent difference first, so that coordinates may be off by tens of pixels (a mount's pointing), then by a linear map of the pairs.
//! Without coordinates, pairs of bright sources are laid on pairs of bright stars of a fitting distance, and a map is believed if more sources fall on stars than all the maps that were
//! tried could bring about by chance.

use glam::DVec2;
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use sunglint_formats::wcs::{Equatorial, Wcs};
use sunglint_numerics::order::median;

/// A star of a list: its number in it, right ascension and declination, magnitude; NaN where it has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Star {
    /// Number in the list.
    pub number: usize,
    /// Right ascension and declination, deg.
    pub sky_deg: Equatorial,
    /// Magnitude; the order of brightness counts.
    pub magnitude: f64,
}

/// Sources and stars that are compared at first, the brightest.
const BRIGHT: usize = 120;
/// Displacement that coordinates may have, px.
const REACH_PX: f64 = 80.0;
/// Width of a cell of votes, px.
const CELL_PX: f64 = 3.0;

/// Pairs of a star (its place in the slice) and a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Pairs {
    /// Places in the slices of stars and of sources.
    pub of: Vec<(usize, usize)>,
    /// Coordinates of the frame, put right by the pairs.
    pub wcs: Wcs,
    /// Displacement of the coordinates that came in, px.
    pub shift_px: DVec2,
    /// Scatter of the places about the coordinates in an axis, px.
    pub scatter_px: f64,
}

/// Lays stars on sources by coordinates that are known but for a displacement. Sources are places in px, the brightest first; stars too. `None` where too few agree.
pub fn pair(wcs: &Wcs, stars: &[Star], sources: &[DVec2], size_px: [usize; 2]) -> Option<Pairs> {
    let sources: &[[f64; 2]] = &sources.iter().map(DVec2::to_array).collect::<Vec<_>>();
    let inside = |place: &[f64; 2]| {
        (0..2).all(|k| place[k] > -REACH_PX && place[k] < size_px[k] as f64 + REACH_PX)
    };
    let seen: Vec<(usize, [f64; 2])> = stars
        .iter()
        .enumerate()
        .filter_map(|(i, star)| {
            wcs.pixel(star.sky_deg).map(|p| p.to_array()).filter(inside).map(|place| (i, place))
        })
        .collect();
    let (shift, votes, chance) = displacement(&seen, sources, size_px)?;
    // A small displacement of coordinates that were solved needs less of a proof.
    let small = shift[0].hypot(shift[1]) < 5.0;
    let least = chance + 5.0 * chance.sqrt() + if small { 2.0 } else { 4.0 };
    if (votes as f64) < least {
        return None;
    }
    // From the coordinates' pixels to those of the frame.
    let mut map = [[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]];
    let mut of = Vec::new();
    for reach in [5.0, 3.0, 2.5] {
        let places: Vec<[f64; 2]> = seen.iter().map(|(_, p)| mapped(&map, *p)).collect();
        of = mutual(&places, sources, reach);
        if of.len() < 3 {
            return None;
        }
        let from: Vec<[f64; 2]> = of.iter().map(|(i, _)| seen[*i].1).collect();
        let to: Vec<[f64; 2]> = of.iter().map(|(_, j)| sources[*j]).collect();
        map = if of.len() >= 8 { linear(&from, &to)? } else { shifted(&from, &to)? };
    }
    let places: Vec<[f64; 2]> = seen.iter().map(|(_, p)| mapped(&map, *p)).collect();
    let off = |k: usize| {
        of.iter().map(|(i, j)| (places[*i][k] - sources[*j][k]).abs()).collect::<Vec<f64>>()
    };
    let scatter_px = 1.4826 * median(off(0).into_iter().chain(off(1)))?;
    Some(Pairs {
        of: of.iter().map(|(i, j)| (seen[*i].0, *j)).collect(),
        wcs: moved(wcs, &map, size_px)?,
        shift_px: shift.into(),
        scatter_px,
    })
}

/// Coordinates after a linear map of the pixels: a tangential projection about the frame's middle, fitted to a grid.
fn moved(wcs: &Wcs, map: &[[f64; 3]; 2], size_px: [usize; 2]) -> Option<Wcs> {
    let [[a, b, e], [c, d, f]] = *map;
    let determinant = a * d - b * c;
    let back = |p: [f64; 2]| {
        let q = [p[0] - e, p[1] - f];
        [(d * q[0] - b * q[1]) / determinant, (a * q[1] - c * q[0]) / determinant]
    };
    let middle = size_px.map(|n| 0.5 * (n as f64 - 1.0));
    // Distorted coordinates keep their form where nothing but a displacement was found.
    let reference = wcs.sky(back(middle).into())?;
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for i in -2..=2 {
        for j in -2..=2 {
            let place =
                [middle[0] * (1.0 + 0.45 * f64::from(i)), middle[1] * (1.0 + 0.45 * f64::from(j))];
            from.push(place);
            to.push(tangent(reference, wcs.sky(back(place).into())?)?);
        }
    }
    let [[a, b, e], [c, d, f]] = linear(&from, &to)?;
    let determinant = a * d - b * c;
    let origin = [(b * f - d * e) / determinant, (c * e - a * f) / determinant];
    Wcs::tangential(reference, origin.into(), [[a, b], [c, d]])
}

/// The most frequent displacement of stars' places to sources, the votes for it, and how many chance would give it.
fn displacement(
    stars: &[(usize, [f64; 2])],
    sources: &[[f64; 2]],
    size_px: [usize; 2],
) -> Option<([f64; 2], usize, f64)> {
    let stars: Vec<[f64; 2]> = stars.iter().take(BRIGHT).map(|(_, p)| *p).collect();
    let sources = &sources[..sources.len().min(BRIGHT)];
    let mut votes: BTreeMap<[i32; 2], Vec<[f64; 2]>> = BTreeMap::new();
    for p in &stars {
        for q in sources {
            let d = [q[0] - p[0], q[1] - p[1]];
            if d[0].hypot(d[1]) > REACH_PX {
                continue;
            }
            let [x, y] = d.map(|v| (v / CELL_PX).round() as i32);
            for dx in -1..=1 {
                for dy in -1..=1 {
                    votes.entry([x + dx, y + dy]).or_default().push(d);
                }
            }
        }
    }
    let (_, all) = votes
        .iter()
        .max_by_key(|(cell, all)| (all.len(), -(cell[0] * cell[0] + cell[1] * cell[1])))?;
    let area = (size_px[0] as f64 + 2.0 * REACH_PX) * (size_px[1] as f64 + 2.0 * REACH_PX);
    let chance = stars.len() as f64 * sources.len() as f64 * 9.0 * CELL_PX * CELL_PX / area;
    let shift = [0, 1].map(|k| median(all.iter().map(|d| d[k])).unwrap_or(0.0));
    Some((shift, all.len(), chance))
}

/// Pairs of places that are nearest to one another, within a distance.
fn mutual(a: &[[f64; 2]], b: &[[f64; 2]], reach: f64) -> Vec<(usize, usize)> {
    let grid = Grid::of(b, reach);
    let back = Grid::of(a, reach);
    a.iter()
        .enumerate()
        .filter_map(|(i, p)| {
            let j = grid.nearest(b, *p, reach)?;
            (back.nearest(a, b[j], reach) == Some(i)).then_some((i, j))
        })
        .collect()
}

/// Places by cells, so that a nearest one is found at once.
struct Grid {
    cell: f64,
    of: BTreeMap<[i64; 2], Vec<usize>>,
}

impl Grid {
    fn of(places: &[[f64; 2]], cell: f64) -> Self {
        let mut of: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        for (i, p) in places.iter().enumerate() {
            of.entry(p.map(|v| (v / cell).floor() as i64)).or_default().push(i);
        }
        Self { cell, of }
    }

    fn nearest(&self, places: &[[f64; 2]], p: [f64; 2], reach: f64) -> Option<usize> {
        let [x, y] = p.map(|v| (v / self.cell).floor() as i64);
        let mut best = None;
        for dx in -1..=1 {
            for dy in -1..=1 {
                for &i in self.of.get(&[x + dx, y + dy]).into_iter().flatten() {
                    let d = (places[i][0] - p[0]).hypot(places[i][1] - p[1]);
                    if d <= reach && best.is_none_or(|(_, least)| d < least) {
                        best = Some((i, d));
                    }
                }
            }
        }
        best.map(|(i, _)| i)
    }
}

fn mapped(map: &[[f64; 3]; 2], p: [f64; 2]) -> [f64; 2] {
    map.map(|[a, b, c]| a * p[0] + b * p[1] + c)
}

/// Linear map by least squares; `None` where the places lie on a line.
fn linear(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<[[f64; 3]; 2]> {
    let n = from.len() as f64;
    let mean = |of: &[[f64; 2]]| [0, 1].map(|k| of.iter().map(|p| p[k]).sum::<f64>() / n);
    let (centre, target) = (mean(from), mean(to));
    let mut normal = Matrix3::zeros();
    let mut sides = [Vector3::zeros(), Vector3::zeros()];
    for (p, q) in from.iter().zip(to) {
        let row = Vector3::new(p[0] - centre[0], p[1] - centre[1], 1.0);
        normal += row * row.transpose();
        for (k, side) in sides.iter_mut().enumerate() {
            *side += row * (q[k] - target[k]);
        }
    }
    let inverse = normal.try_inverse().filter(|m| m.iter().all(|v| v.is_finite()))?;
    Some([0, 1].map(|k| {
        let x = inverse * sides[k];
        [x[0], x[1], x[2] + target[k] - x[0] * centre[0] - x[1] * centre[1]]
    }))
}

fn shifted(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<[[f64; 3]; 2]> {
    let d = |k: usize| median(from.iter().zip(to).map(|(p, q)| q[k] - p[k]));
    Some([[1.0, 0.0, d(0)?], [0.0, 1.0, d(1)?]])
}

/// Tangential coordinates (east, north) of a place about a reference, deg; `None` on the other half of the sky.
pub(super) fn tangent(reference: Equatorial, sky: Equatorial) -> Option<[f64; 2]> {
    let (sin_a, cos_a) = (sky.ra_deg - reference.ra_deg).to_radians().sin_cos();
    let (sin_d, cos_d) = reference.dec_deg.to_radians().sin_cos();
    let (sin_b, cos_b) = sky.dec_deg.to_radians().sin_cos();
    let cos = sin_b * sin_d + cos_b * cos_d * cos_a;
    (cos > 0.01).then(|| {
        [cos_b * sin_a / cos, (sin_b * cos_d - cos_b * sin_d * cos_a) / cos].map(f64::to_degrees)
    })
}

/// A frame's place on the sky as far as it is known without coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approximate {
    /// Right ascension and declination near the frame's middle, deg.
    pub centre_deg: Equatorial,
    /// Width of a pixel, arcsec.
    pub scale_arcsec: f64,
    /// Part by which the width may be wrong.
    pub scale_tolerance: f64,
}

/// Bright sources of a frame whose pairs are tried.
const PATTERN: usize = 24;
/// Stars of the list whose pairs are tried.
const PATTERN_STARS: usize = 160;
/// Maps by chance that are believed, over all that were tried.
const CHANCE: f64 = 1e-4;

/// Finds the coordinates of a frame from the pattern of its bright sources: whatever its rotation and parity, its middle within about one frame's diagonal of the place told. `None`
/// where no pattern is beyond chance. Sources and stars are sorted, the brightest first.
pub fn solve(
    near: &Approximate,
    stars: &[Star],
    sources: &[DVec2],
    size_px: [usize; 2],
) -> Option<Wcs> {
    let diagonal = (size_px[0] as f64).hypot(size_px[1] as f64);
    let scale = near.scale_arcsec / 3600.0;
    let radius = 1.1 * diagonal * scale;
    let mut chosen: Vec<[f64; 2]> = Vec::new();
    for star in stars {
        if let Some(at) = tangent(near.centre_deg, star.sky_deg)
            && at[0].hypot(at[1]) < radius
        {
            chosen.push(at);
            if chosen.len() == PATTERN_STARS {
                break;
            }
        }
    }
    let sources: Vec<[f64; 2]> = sources.iter().take(PATTERN).map(DVec2::to_array).collect();
    if sources.len() < 5 || chosen.len() < 5 {
        return None;
    }
    // Distances of stars, sorted; units of px.
    let unit: Vec<[f64; 2]> = chosen.iter().map(|p| p.map(|v| v / scale)).collect();
    let mut lengths: Vec<(f64, usize, usize)> = Vec::new();
    for i in 0..unit.len() {
        for j in 0..i {
            let length = (unit[i][0] - unit[j][0]).hypot(unit[i][1] - unit[j][1]);
            if length < 1.2 * diagonal {
                lengths.push((length, i, j));
            }
        }
    }
    lengths.sort_by(|a, b| a.0.total_cmp(&b.0));
    const NEAR_PX: f64 = 4.0;
    let grid = Grid::of(&unit, NEAR_PX);
    let area = std::f64::consts::PI * (radius / scale).powi(2);
    let chance = unit.len() as f64 * std::f64::consts::PI * NEAR_PX * NEAR_PX / area;
    let mut tried = 0_u64;
    let mut best: Option<(usize, [[f64; 3]; 2])> = None;
    for a in 0..sources.len() {
        for b in 0..a {
            let d = [sources[a][0] - sources[b][0], sources[a][1] - sources[b][1]];
            let length = d[0].hypot(d[1]);
            if length < 0.15 * diagonal {
                continue;
            }
            let low = length * (1.0 - near.scale_tolerance);
            let high = length * (1.0 + near.scale_tolerance);
            let first = lengths.partition_point(|l| l.0 < low);
            for (_, i, j) in lengths[first..].iter().take_while(|l| l.0 <= high) {
                for (i, j) in [(*i, *j), (*j, *i)] {
                    for parity in [1.0, -1.0] {
                        tried += 1;
                        let map = similar(d, sources[b], unit[i], unit[j], parity);
                        let hits = sources
                            .iter()
                            .filter(|s| grid.nearest(&unit, mapped(&map, **s), NEAR_PX).is_some())
                            .count();
                        if best.is_none_or(|(most, _)| hits > most) {
                            best = Some((hits, map));
                        }
                    }
                }
            }
        }
        // Beyond doubt already.
        if let Some((hits, _)) = best
            && hits >= 8
            && 10 * hits >= 6 * sources.len()
        {
            break;
        }
    }
    let (hits, mut map) = best?;
    let expected = chance * sources.len() as f64;
    if tried as f64 * tail(expected, hits.saturating_sub(2)) > CHANCE || hits < 5 {
        return None;
    }
    for reach in [4.0, 3.0, 2.0] {
        let places: Vec<[f64; 2]> = sources.iter().map(|s| mapped(&map, *s)).collect();
        let pairs = mutual(&places, &unit, reach);
        let from: Vec<[f64; 2]> = pairs.iter().map(|(i, _)| sources[*i]).collect();
        let to: Vec<[f64; 2]> = pairs.iter().map(|(_, j)| unit[*j]).collect();
        if pairs.len() < 4 {
            break;
        }
        map = linear(&from, &to)?;
    }
    let [[a, b, e], [c, d, f]] = map.map(|row| row.map(|v| v * scale));
    let determinant = a * d - b * c;
    let origin = [(b * f - d * e) / determinant, (c * e - a * f) / determinant];
    Wcs::tangential(near.centre_deg, origin.into(), [[a, b], [c, d]])
}

/// The map that lays one pair of places on another, turned, scaled, and mirrored for a parity of −1.
fn similar(d: [f64; 2], from: [f64; 2], i: [f64; 2], j: [f64; 2], parity: f64) -> [[f64; 3]; 2] {
    let d = [d[0], parity * d[1]];
    let e = [i[0] - j[0], i[1] - j[1]];
    let square = d[0] * d[0] + d[1] * d[1];
    let cos = (e[0] * d[0] + e[1] * d[1]) / square;
    let sin = (e[1] * d[0] - e[0] * d[1]) / square;
    let (a, b, c, f) = (cos, -parity * sin, sin, parity * cos);
    [[a, b, j[0] - a * from[0] - b * from[1]], [c, f, j[1] - c * from[0] - f * from[1]]]
}

/// Probability that a Poisson variate of this mean is at least n.
fn tail(mean: f64, n: usize) -> f64 {
    let mut term = (-mean).exp();
    let mut below = 0.0;
    for k in 0..n {
        below += term;
        term *= mean / (k + 1) as f64;
    }
    // Small tails by their first terms: the difference from 1 would be lost.
    let (mut sum, mut k) = (0.0, n);
    while k < n + 40 {
        sum += term;
        k += 1;
        term *= mean / k as f64;
    }
    sum.max(1.0 - below - 1e-12).clamp(0.0, 1.0)
}
