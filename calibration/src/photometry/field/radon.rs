//! Sums along all straight segments of dyadic lengths: the fast discrete Radon transform (Götz and Druckmüller 1996, Brady 1998), as used for streaks by Nir, Zackay
//! and Ofek 2018.
//!
//! Level m holds, for blocks of 2^m rows, the sums along segments that move 0 to 2^m − 1 columns to the right. Two blocks of a level make one of the next:
//! out\[s\]\[x\] = upper\[⌊s/2⌋\]\[x\] + lower\[⌊s/2⌋\]\[x + ⌈s/2⌉\]. Mirrored and transposed images give the other directions. N² additions a level.

use sunglint_numerics::order::SIGMA_PER_MAD;

/// A segment whose sum stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seed {
    /// Standard deviations of such sums.
    pub significance: f32,
    /// Ends, columns and rows of the image.
    pub(crate) ends: [[f64; 2]; 2],
}

/// Rows of the longest blocks.
const LONGEST: usize = 256;

/// The segments of at least `shortest` rows or columns whose sums are more than `threshold` standard deviations of the sums of their direction and length, the
/// most significant first. The highest of each neighbourhood is given.
pub(crate) fn seeds(image: &[f32], size: [usize; 2], shortest: usize, threshold: f32) -> Vec<Seed> {
    let upright = || {
        let mirrored = mirror(image, size);
        let (mut a, b) = rayon::join(
            || quadrant(image, size, shortest, threshold),
            || quadrant(&mirrored, size, shortest, threshold),
        );
        let width = size[0] as f64 - 1.0;
        a.extend(b.into_iter().map(|mut seed| {
            for end in &mut seed.ends {
                end[0] = width - end[0];
            }
            seed
        }));
        a
    };
    let lying = || {
        let turned = transpose(image, size);
        let size = [size[1], size[0]];
        let mirrored = mirror(&turned, size);
        let (mut a, b) = rayon::join(
            || quadrant(&turned, size, shortest, threshold),
            || quadrant(&mirrored, size, shortest, threshold),
        );
        let width = size[0] as f64 - 1.0;
        a.extend(b.into_iter().map(|mut seed| {
            for end in &mut seed.ends {
                end[0] = width - end[0];
            }
            seed
        }));
        for seed in &mut a {
            for end in &mut seed.ends {
                end.swap(0, 1);
            }
        }
        a
    };
    let (mut all, more) = rayon::join(upright, lying);
    all.extend(more);
    let key = |seed: &Seed| seed.ends.map(|end| end.map(|v| v.to_bits()));
    all.sort_by(|a, b| b.significance.total_cmp(&a.significance).then_with(|| key(a).cmp(&key(b))));
    all
}

fn mirror(image: &[f32], [width, _]: [usize; 2]) -> Vec<f32> {
    image.chunks_exact(width.max(1)).flat_map(|line| line.iter().rev().copied()).collect()
}

fn transpose(image: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    const BLOCK: usize = 32;
    let mut out = vec![0.0; image.len()];
    for y0 in (0..height).step_by(BLOCK) {
        for x0 in (0..width).step_by(BLOCK) {
            for y in y0..(y0 + BLOCK).min(height) {
                for x in x0..(x0 + BLOCK).min(width) {
                    out[x * height + y] = image[y * width + x];
                }
            }
        }
    }
    out
}

/// Segments that go down and 0 to 45° to the right.
fn quadrant(
    image: &[f32],
    [width, height]: [usize; 2],
    shortest: usize,
    threshold: f32,
) -> Vec<Seed> {
    let levels = LONGEST.min(height).ilog2() as usize;
    let mut found = Vec::new();
    if width == 0 || height == 0 {
        return found;
    }
    // Whole blocks of the longest length; rows beyond the image are 0.
    let padded = height.next_multiple_of(1 << levels);
    let mut sums = image.to_vec();
    sums.resize(padded * width, 0.0);
    let mut next = vec![0.0_f32; sums.len()];
    for level in 1..=levels {
        let half = 1_usize << (level - 1);
        let length = 2 * half;
        for (upper_lower, out) in
            sums.chunks_exact(length * width).zip(next.chunks_exact_mut(length * width))
        {
            let (upper, lower) = upper_lower.split_at(half * width);
            for (slope, line) in out.chunks_exact_mut(width).enumerate() {
                let shift = slope.div_ceil(2);
                let a = &upper[slope / 2 * width..][..width];
                let b = &lower[slope / 2 * width..][..width];
                let inside = width.saturating_sub(shift);
                for ((sum, a), b) in
                    line[..inside].iter_mut().zip(&a[..inside]).zip(&b[shift.min(width)..])
                {
                    *sum = a + b;
                }
                // The segment leaves the image half-way.
                line[inside..].copy_from_slice(&a[inside..]);
            }
        }
        std::mem::swap(&mut sums, &mut next);
        if length >= shortest {
            highest(&sums, [width, height], length, threshold, &mut found);
        }
    }
    found
}

/// Adds the highest sums of a level's neighbourhoods.
fn highest(
    sums: &[f32],
    [width, height]: [usize; 2],
    length: usize,
    threshold: f32,
    found: &mut Vec<Seed>,
) {
    let slopes_a_cell = (length / 8).max(2);
    let columns_a_cell = (length / 4).max(4);
    let cells = width.div_ceil(columns_a_cell);
    let scales = scales(sums, width, length, slopes_a_cell);
    for (block, of_block) in sums.chunks_exact(length * width).enumerate() {
        let top = block * length;
        if top >= height {
            break;
        }
        for (group, of_group) in of_block.chunks(slopes_a_cell * width).enumerate() {
            let least = threshold * scales[group];
            let mut best = vec![(least, usize::MAX, 0_usize); cells];
            let mut any = false;
            for (i, line) in of_group.chunks_exact(width).enumerate() {
                for (cell, part) in line.chunks(columns_a_cell).enumerate() {
                    // Nearly all are below: first whether there is one at all.
                    let most =
                        part.iter().fold(f32::NEG_INFINITY, |m, &v| if v > m { v } else { m });
                    if most > best[cell].0
                        && let Some(x) = part.iter().position(|&v| v == most)
                    {
                        best[cell] = (most, cell * columns_a_cell + x, group * slopes_a_cell + i);
                        any = true;
                    }
                }
            }
            if !any {
                continue;
            }
            for (sum, x, slope) in best.into_iter().filter(|(_, x, _)| *x != usize::MAX) {
                let last = (length - 1) as f64;
                found.push(Seed {
                    significance: sum / scales[group],
                    ends: [[x as f64, top as f64], [(x + slope) as f64, top as f64 + last]],
                });
            }
        }
    }
}

/// Scatter of the sums of each group of slopes, from some of them: smoothing correlates pixels, and what is masked counts nothing, so it is measured.
fn scales(sums: &[f32], width: usize, length: usize, slopes_a_cell: usize) -> Vec<f32> {
    const SAMPLE: usize = 4000;
    let groups = length.div_ceil(slopes_a_cell);
    let blocks = sums.len() / (length * width).max(1);
    (0..groups)
        .map(|group| {
            let slopes = slopes_a_cell.min(length - group * slopes_a_cell);
            let all = blocks * slopes * width;
            let stride = (all / SAMPLE).max(1) | 1;
            let mut values: Vec<f32> = (0..all)
                .step_by(stride)
                .map(|i| {
                    let (block, rest) = (i / (slopes * width), i % (slopes * width));
                    sums[block * length * width + group * slopes_a_cell * width + rest].abs()
                })
                .collect();
            let middle = values.len() / 2;
            let mad = match values.is_empty() {
                true => 0.0,
                false => *values.select_nth_unstable_by(middle, f32::total_cmp).1,
            };
            // Never below what independent pixels would leave.
            (mad * SIGMA_PER_MAD as f32).max((length as f32).sqrt())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: a drawn line. Its sum over 32 rows of value 1 is found with the ends of its block, in every direction.
    #[test]
    fn a_line_is_found_in_each_direction() {
        let size = [96, 80];
        for degrees in [0.0, 20.0, 45.0, 70.0, 90.0, 110.0, 135.0, 160.0_f64] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let mut image = vec![0.0; size[0] * size[1]];
            for step in -60..=60 {
                let [x, y] =
                    [48.0 + cos * f64::from(step) / 2.0, 40.0 + sin * f64::from(step) / 2.0];
                image[y.round() as usize * size[0] + x.round() as usize] = 10.0;
            }
            let seeds = seeds(&image, size, 8, 6.0);
            let [a, b] = seeds[0].ends;
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let off = (dx * sin - dy * cos).abs() / dx.hypot(dy);
            assert!(off < 0.15, "{degrees}: {:?}", seeds[0]);
            let middle = [0.5 * (a[0] + b[0]) - 48.0, 0.5 * (a[1] + b[1]) - 40.0];
            assert!((middle[0] * sin - middle[1] * cos).abs() < 2.0, "{degrees}: {:?}", seeds[0]);
        }
        assert!(seeds(&[0.0; 400], [20, 20], 8, 6.0).is_empty());
    }
}
