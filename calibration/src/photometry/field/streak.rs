//! Streaks: proposed by sums along segments, refined, fitted, and held against what else could have made them.

use super::radon::{Seed, seeds};
use super::{FWHM_PER_SIGMA, FieldOptions, Prepared};
use std::f64::consts::{PI, SQRT_2};
use std::sync::LazyLock;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Inputs of a search besides the prepared frame.
pub(crate) struct Search<'a> {
    pub options: &'a FieldOptions,
    /// Values as they were read.
    pub raw: &'a [f32],
    /// Value from which a pixel is saturated.
    pub full: f32,
}

/// A streak as it was fitted, in standard deviations of a pixel.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub(crate) ends: [[f64; 2]; 2],
    /// Light in units of a pixel's standard deviation.
    pub flux: f64,
    /// Standard deviation of the light, from the noise of the sky.
    pub sigma: f64,
    /// Standard deviation of the profile across, px.
    pub sigma_px: f64,
    /// Part of the length that is masked.
    pub masked: f64,
    pub is_saturated: bool,
    pub is_end_hidden: bool,
}

impl Fitted {
    /// Distance of a place from the line between the ends, px.
    pub(crate) fn distance(&self, place: [f64; 2]) -> f64 {
        distance(self.ends, place)
    }
}

pub(super) fn distance([a, b]: [[f64; 2]; 2], place: [f64; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let (x, y) = (place[0] - a[0], place[1] - a[1]);
    let square = dx * dx + dy * dy;
    let t = if square > 0.0 { ((x * dx + y * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
    (x - t * dx).hypot(y - t * dy)
}

/// A straight line with its ends: a place, a unit vector, and both ends along it.
#[derive(Debug, Clone, Copy)]
struct Line {
    origin: [f64; 2],
    along: [f64; 2],
    from: f64,
    to: f64,
}

impl Line {
    fn of([a, b]: [[f64; 2]; 2]) -> Self {
        let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-9);
        let along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
        Self { origin: a, along, from: 0.0, to: length }
    }

    fn at(&self, t: f64) -> [f64; 2] {
        [self.origin[0] + t * self.along[0], self.origin[1] + t * self.along[1]]
    }

    fn ends(&self) -> [[f64; 2]; 2] {
        [self.at(self.from), self.at(self.to)]
    }

    fn length(&self) -> f64 {
        self.to - self.from
    }

    /// The line with its ends moved across by so many pixels.
    fn moved(&self, at_from: f64, at_to: f64) -> Self {
        let across = [-self.along[1], self.along[0]];
        let [a, b] = self.ends();
        let end = |p: [f64; 2], d: f64| [p[0] + d * across[0], p[1] + d * across[1]];
        Self::of([end(a, at_from), end(b, at_to)])
    }
}

/// Proposals that are looked at in one frame at most.
const MOST_PROPOSALS: usize = 4000;
/// Standard deviations from which a sum is a proposal.
const PROPOSAL_SIGMAS: f32 = 5.2;
/// Summed pixels are clipped here, so that no star makes a streak.
const CLIP: f32 = 6.0;

/// Result of a search.
pub(crate) struct Found {
    /// The streaks, the most significant first.
    pub streaks: Vec<Fitted>,
    /// Lines that run along the border of what is exposed: edges of the sensor, as far as one frame can tell.
    pub edges: usize,
}

/// Finds the streaks of a frame; their pixels are masked in it.
pub(crate) fn search(prepared: &mut Prepared, search: &Search<'_>) -> Found {
    let (image, size, bin) = reduced(prepared);
    let shortest = (0.5 * search.options.shortest_px / bin as f64).max(4.0) as usize;
    let shortest = shortest.next_power_of_two();
    let proposals = seeds(&image, size, shortest, PROPOSAL_SIGMAS);
    let mut found: Vec<Fitted> = Vec::new();
    let mut looked: Vec<[[f64; 2]; 2]> = Vec::new();
    let scale = bin as f64;
    let shift = 0.5 * (scale - 1.0);
    for Seed { ends, .. } in proposals.into_iter().take(MOST_PROPOSALS) {
        let ends = ends.map(|end| end.map(|v| v * scale + shift));
        // What lies in a streak that was found is that streak.
        let reach = 3.0 * prepared.sigma_px + 3.0 * scale;
        let inside = |of: &[[f64; 2]; 2]| {
            let [a, b] = ends;
            let parts =
                [0.25, 0.5, 0.75].map(|t| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
            parts.into_iter().all(|p| distance(*of, p) < reach)
        };
        // The same proposal again, but for a few pixels.
        let again = |of: &[[f64; 2]; 2]| {
            (0..2).all(|i| (of[i][0] - ends[i][0]).hypot(of[i][1] - ends[i][1]) < 3.0 * scale)
        };
        if found.iter().any(|f| inside(&f.ends)) || looked.iter().any(again) {
            continue;
        }
        let Some(line) = refine(prepared, Line::of(ends), search.options.streak_sigmas) else {
            continue;
        };
        match verify(prepared, search, line) {
            Some(fitted) => {
                mask(prepared, &fitted);
                found.push(fitted);
            }
            None if looked.len() < 600 => looked.push(ends),
            None => {}
        }
    }
    let all = found.len();
    let width = FWHM_PER_SIGMA * prepared.sigma_px;
    found.retain(|fit| !prepared.exposed.is_border(fit.ends, 2.0 * width + 1.0));
    let edges = all - found.len();
    found.sort_by(|a, b| (b.flux / b.sigma).total_cmp(&(a.flux / a.sigma)));
    Found { streaks: found, edges }
}

/// The smoothed frame without what is masked, clipped; of a large frame the means of squares.
fn reduced(prepared: &Prepared) -> (Vec<f32>, [usize; 2], usize) {
    const LARGE: usize = 1200;
    let [width, height] = prepared.size;
    let value = |i: usize| {
        if prepared.masked[i] { 0.0 } else { prepared.smooth[i].clamp(-CLIP, CLIP) }
    };
    let bin = width.max(height).div_ceil(2 * LARGE).next_power_of_two();
    let bin = if width.max(height) > LARGE { bin.max(2) } else { 1 };
    if bin == 1 {
        return ((0..width * height).map(value).collect(), prepared.size, 1);
    }
    let size = [width / bin, height / bin];
    let mut out = vec![0.0; size[0] * size[1]];
    let scale = ((bin * bin) as f32).recip();
    for (row, line) in out.chunks_exact_mut(size[0]).enumerate() {
        for dy in 0..bin {
            let first = (row * bin + dy) * width;
            for (column, sum) in line.iter_mut().enumerate() {
                for dx in 0..bin {
                    *sum += scale * value(first + column * bin + dx);
                }
            }
        }
    }
    (out, size, bin)
}

/// Heights of the smoothed frame along a line, a pixel apart; `None` where it is masked.
fn heights(prepared: &Prepared, line: &Line) -> impl Iterator<Item = Option<f64>> {
    let steps = line.length().max(1.0).round() as usize;
    let place = move |i: usize| line.at(line.from + line.length() * i as f64 / steps as f64);
    let clear = |(height, is_masked): (f64, bool)| (!is_masked).then_some(height);
    (0..=steps).map(move |i| prepared.smooth_at(place(i)).and_then(clear))
}

/// Sum of the clipped heights along a line over the square root of their number.
fn score(prepared: &Prepared, line: &Line, clip: f64) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for height in heights(prepared, line).flatten() {
        sum += height.clamp(-clip, clip);
        n += 1.0;
    }
    if n > 0.0 { sum / f64::sqrt(n) } else { f64::NEG_INFINITY }
}

/// The line with its ends moved across to where it is brightest.
fn turned(prepared: &Prepared, line: Line, reach: f64, step: f64, clip: f64) -> Line {
    let n = (reach / step).round() as i32;
    let mut best = (score(prepared, &line, clip), line);
    for i in -n..=n {
        for j in -n..=n {
            let moved = line.moved(f64::from(i) * step, f64::from(j) * step);
            let value = score(prepared, &moved, clip);
            if value > best.0 {
                best = (value, moved);
            }
        }
    }
    best.1
}

/// Direction and ends of a proposal; `None` where there is nothing.
fn refine(prepared: &Prepared, line: Line, asked: f64) -> Option<Line> {
    let mut line = turned(prepared, line, 3.0, 1.0, 8.0);
    // Most proposals of a frame with halos or an uneven sky end here, before the costly turns. Half of what is asked in the end: direction and ends are rough.
    if !stands_out(prepared, &line, 0.0, 0.5 * asked) {
        return None;
    }
    for round in 0..3 {
        let mut lit: Vec<f64> = heights(prepared, &line).flatten().collect();
        if lit.len() < 4 {
            return None;
        }
        lit.sort_by(f64::total_cmp);
        let level = lit[lit.len() / 2].max(0.5);
        line = stretched(prepared, line, level);
        if line.length() < 4.0 {
            return None;
        }
        let [reach, step] = [[2.0, 0.5], [1.0, 0.25], [0.4, 0.1]][round];
        line = turned(prepared, line, reach, step, (3.0 * level).max(4.0));
    }
    Some(line)
}

/// The line with the ends that a step of this height makes most likely: the largest sum of height − level/2 to either side of its middle. Gaps of masked pixels count
/// nothing.
fn stretched(prepared: &Prepared, line: Line, level: f64) -> Line {
    let middle = 0.5 * (line.from + line.to);
    let clip = (2.5 * level).max(3.0);
    let end = |sign: f64| {
        let (mut sum, mut best, mut at) = (0.0, 0.0, 0.0);
        let (mut t, mut dark) = (0.0, 0.0);
        loop {
            t += 1.0;
            let place = line.at(middle + sign * t);
            let Some((height, is_masked)) = prepared.smooth_at(place) else { break };
            if !is_masked {
                sum += height.clamp(-clip, clip) - 0.5 * level;
                if sum > best {
                    (best, at) = (sum, t);
                    dark = 0.0;
                } else {
                    dark += 1.0;
                }
            }
            // Far below what was gained there is no way back.
            if best - sum > 12.0 * level.max(1.0) || dark > 60.0 + at {
                break;
            }
        }
        middle + sign * at
    };
    Line { from: end(-1.0), to: end(1.0), ..line }
}

/// Steps of the table of [`phi`] in 1, and its largest argument.
const PHI_STEPS: f64 = 32.0;
const PHI_REACH: f64 = 6.0;
/// Values and slopes (for a step) of the integral of a normal distribution.
static PHI: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let steps = (2.0 * PHI_REACH * PHI_STEPS) as usize;
    (0..=steps)
        .map(|k| {
            let x = k as f64 / PHI_STEPS - PHI_REACH;
            let slope = (-0.5 * x * x).exp() / (2.0 * PI).sqrt() / PHI_STEPS;
            [0.5 * libm::erfc(-x / SQRT_2), slope]
        })
        .collect()
});

/// Integral of a normal distribution up to x, within 2e-9: most of the search's time went into the error function. Between entries of the table a cubic has the values and slopes of both.
fn phi(x: f64) -> f64 {
    let at = (x + PHI_REACH) * PHI_STEPS;
    let table = &*PHI;
    if at.is_nan() || at <= 0.0 {
        return 0.0;
    }
    if at >= (table.len() - 1) as f64 {
        return 1.0;
    }
    let k = at as usize;
    let ([a, p], [b, q]) = (table[k], table[k + 1]);
    let t = at - k as f64;
    let (low, high) = (b - a - p, q - b + a);
    a + t * (p + t * (low + (1.0 - t) * (low - high)))
}

/// Pixels around a line.
struct Corridor {
    /// Along, across, value; of pixels that are not masked.
    pixels: Vec<[f64; 3]>,
}

impl Corridor {
    fn of(prepared: &Prepared, line: &Line, half: f64, margin: f64) -> Self {
        let [width, height] = prepared.size;
        let [a, b] = [line.at(line.from - margin), line.at(line.to + margin)];
        let bounds = |axis: usize, n: usize| {
            let (low, high) = (a[axis].min(b[axis]) - half, a[axis].max(b[axis]) + half);
            (low.floor().max(0.0) as usize)..((high.ceil().max(-1.0) + 1.0) as usize).min(n)
        };
        let columns = bounds(0, width);
        let mut pixels = Vec::new();
        for row in bounds(1, height) {
            // Only the columns near the line in this row.
            let y = row as f64 - line.origin[1];
            let mut range = columns.clone();
            if line.along[1].abs() > 0.05 {
                let x = line.origin[0] + y * line.along[0] / line.along[1];
                let reach = half / line.along[1].abs() + 1.0;
                let from = ((x - reach).floor().max(0.0) as usize).clamp(range.start, range.end);
                let to = ((x + reach).ceil().max(0.0) as usize + 1).clamp(from, range.end);
                range = from..to;
            }
            for column in range {
                let pixel = row * width + column;
                if prepared.masked[pixel] {
                    continue;
                }
                let x = column as f64 - line.origin[0];
                let along = x * line.along[0] + y * line.along[1];
                let across = y * line.along[0] - x * line.along[1];
                if across.abs() <= half && along >= line.from - margin && along <= line.to + margin
                {
                    pixels.push([along, across, f64::from(prepared.above[pixel])]);
                }
            }
        }
        Self { pixels }
    }

    /// Light, its standard deviation and how much χ² it explains, of a line of even light between two ends with this width, beside an even background.
    ///
    /// The line's distance from the corridor's axis goes evenly from the first value of `offsets` at its beginning to the second at its end.
    fn fit(&self, from: f64, to: f64, offsets: [f64; 2], sigma: f64) -> Option<[f64; 3]> {
        let length = to - from;
        if length <= 0.5 {
            return None;
        }
        let norm = 1.0 / ((2.0 * PI).sqrt() * sigma * length);
        let (mut mm, mut m1, mut n, mut md, mut d1) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for [along, across, value] in &self.pixels {
            let part = (along - from) / length;
            let offset = offsets[0] + (offsets[1] - offsets[0]) * part;
            let u = (across - offset) / sigma;
            let (a, b) = ((along - from) / sigma, (along - to) / sigma);
            let model = if a < -5.0 || b > 5.0 || u.abs() > 6.0 {
                0.0
            } else {
                let lit = if a > 5.0 && b < -5.0 { 1.0 } else { phi(a) - phi(b) };
                norm * (-0.5 * u * u).exp() * lit
            };
            mm += model * model;
            m1 += model;
            n += 1.0;
            md += model * value;
            d1 += value;
        }
        let determinant = mm * n - m1 * m1;
        if determinant.is_nan() || determinant <= 1e-12 * mm * n {
            return None;
        }
        let flux = (md * n - m1 * d1) / determinant;
        let variance = n / determinant;
        Some([flux, variance.sqrt(), flux * flux.abs() / variance])
    }
}

/// Ends along the axis, both ends' distances from it, and the width, that explain most; by halving steps.
fn fitted_line(corridor: &Corridor, line: &Line, sigma: f64) -> Option<([f64; 5], [f64; 3])> {
    const WIDTH: usize = 4;
    let fit = |at: [f64; 5]| corridor.fit(at[0], at[1], [at[2], at[3]], at[WIDTH]);
    let mut at = [line.from, line.to, 0.0, 0.0, sigma];
    let mut best = fit(at)?;
    for step in [2.0, 1.0, 0.5, 0.25, 0.12] {
        for _ in 0..3 {
            let before = best[2];
            for parameter in 0..5 {
                // A width is told by a bright streak only.
                if parameter == WIDTH && best[0] / best[1] < 12.0 {
                    continue;
                }
                let across = 0.3 * step;
                let step = [step, step, across, across, 0.15 * step * sigma][parameter];
                for sign in [-1.0, 1.0] {
                    let mut moved = at;
                    moved[parameter] += sign * step;
                    if moved[WIDTH] < 0.6 * sigma || moved[WIDTH] > 1.4 * sigma {
                        continue;
                    }
                    if let Some(fit) = fit(moved)
                        && fit[2] > best[2]
                    {
                        (best, at) = (fit, moved);
                    }
                }
            }
            if best[2] <= before {
                break;
            }
        }
    }
    Some((at, best))
}

/// The fit of a line, if nothing speaks against a streak.
fn verify(prepared: &Prepared, search: &Search<'_>, line: Line) -> Option<Fitted> {
    let sigma = prepared.sigma_px;
    let options = search.options;
    if line.length() < 0.6 * options.shortest_px {
        return None;
    }
    // A quick look before the costly one.
    let lit = heights(prepared, &line).collect::<Vec<_>>();
    let seen: Vec<f64> = lit.iter().flatten().copied().collect();
    let masked = 1.0 - seen.len() as f64 / lit.len() as f64;
    if seen.len() < 6 || masked > 0.6 {
        return None;
    }
    let independent = 2.0 * PI.sqrt() * sigma;
    let middle = median(seen.iter().copied())?;
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    if middle * (seen.len() as f64 / independent).sqrt() < 0.7 * options.streak_sigmas * 0.8
        || middle < 0.45 * mean
    {
        return None;
    }
    let half = super::half_width(sigma);
    let corridor = Corridor::of(prepared, &line, half, 4.0 * sigma);
    let ([from, to, at_from, at_to, width], [flux, flux_sigma, explained]) =
        fitted_line(&corridor, &line, sigma)?;
    let significance = flux / flux_sigma;
    let moved = Line { from, to, ..line }.moved(at_from, at_to);
    let length = moved.length();
    // Faint stars in a row look like a short one; beyond the frame's edge, or where stars hide much of it, less is known of it.
    let [columns, rows] = prepared.size.map(|n| n as f64 - 1.0);
    let is_beyond = moved
        .ends()
        .iter()
        .any(|[x, y]| *x < -1.0 || *y < -1.0 || *x > columns + 1.0 || *y > rows + 1.0);
    let doubtful = length < 22.0 * sigma || is_beyond || masked > 0.2;
    let asked = options.streak_sigmas * if doubtful { 1.35 } else { 1.0 };
    if significance < asked || length < options.shortest_px || width > 1.8 * sigma {
        return None;
    }
    if !is_lit(prepared, &moved, independent)
        || !is_wide(prepared, &moved, sigma)
        || !stands_out(prepared, &moved, significance, asked)
    {
        return None;
    }
    if length < 60.0 * sigma && explained < 1.05 * points(prepared, &moved, sigma) {
        return None;
    }
    // Two stars and what lies masked between them are a short streak to any test.
    if length < 30.0 * sigma && masked > 0.25 {
        return None;
    }
    let is_saturated = is_saturated(search, prepared.size, &moved);
    let hidden = |t: f64, sign: f64| {
        (1..=4).filter(|&i| prepared.is_masked(moved.at(t + sign * f64::from(i)))).count() >= 2
    };
    let is_end_hidden = hidden(moved.from, -1.0) || hidden(moved.to, 1.0);
    Some(Fitted {
        ends: moved.ends(),
        flux,
        sigma: flux_sigma,
        sigma_px: width,
        masked,
        is_saturated,
        is_end_hidden,
    })
}

/// Whether all parts of a line are lit: each of four parts by half of the middle, as far as noise lets it tell.
fn is_lit(prepared: &Prepared, line: &Line, independent: f64) -> bool {
    let lit = heights(prepared, line).collect::<Vec<_>>();
    // The ends are dark for half a width.
    let trim = ((0.5 * independent) as usize).min(lit.len() / 6);
    let lit = &lit[trim..lit.len() - trim];
    let all: Vec<f64> = lit.iter().flatten().copied().collect();
    let Some(level) = median(all.iter().copied()) else { return false };
    let parts = if line.length() > 12.0 * independent { 6 } else { 4 };
    let mut dark = 0;
    let mut known = 0;
    for part in 0..parts {
        let from = part * lit.len() / parts;
        let to = (part + 1) * lit.len() / parts;
        let seen: Vec<f64> = lit[from..to].iter().flatten().copied().collect();
        // Too little is seen to tell.
        if 3 * seen.len() < to - from {
            continue;
        }
        known += 1;
        let Some(here) = median(seen.iter().copied()) else { continue };
        let noise = 1.25 / (seen.len() as f64 / independent).max(1.0).sqrt();
        dark += usize::from(here < 0.5 * level && here < level - 2.5 * noise || here < 0.2 * level);
    }
    known >= 2 && dark == 0
}

/// Whether a line is about as wide as a point: the smoothed frame two widths beside it holds e⁻¹ of its crest, less of a narrow track, more of an edge.
fn is_wide(prepared: &Prepared, line: &Line, sigma: f64) -> bool {
    let mean = |offset: f64| {
        let beside: Vec<f64> = heights(prepared, &line.moved(offset, offset)).flatten().collect();
        median(beside)
    };
    let Some(crest) = mean(0.0) else { return false };
    let sides: Vec<f64> = [-2.0 * sigma, 2.0 * sigma].into_iter().filter_map(mean).collect();
    let Some(least) = sides.iter().copied().reduce(f64::min) else { return false };
    let n = (line.length() / (2.0 * PI.sqrt() * sigma)).max(1.0);
    let noise = 1.5 / (crest * n.sqrt());
    least / crest < 0.62 + noise
}

/// Part of the asked significance by which the middle of the heights has to stand out: it knows a level 1.25 times less well than the mean does, and the scatter of a dozen lines is
/// known to a quarter.
const OF_ASKED: f64 = 0.6;

/// Whether a line is brighter along most of its length than the lines beside it, on which halos of stars, gradients and rows of faint stars leave as much.
///
/// The lines lie 3 to 8 widths beside it on both sides. The middle of the heights along each is not drawn up by a few stars. An even slope across is taken off.
fn stands_out(prepared: &Prepared, line: &Line, significance: f64, asked: f64) -> bool {
    const FEW: usize = 6;
    let sigma = prepared.sigma_px;
    let independent = (line.length() / (2.0 * PI.sqrt() * sigma)).max(1.0);
    let middle = |offset: f64| {
        let lit: Vec<f64> = heights(prepared, &line.moved(offset, offset)).flatten().collect();
        // Of a line that is masked for the most part nothing is known.
        (2.0 * lit.len() as f64 > line.length()).then(|| median(lit)).flatten()
    };
    let crest = even_crest(prepared, line);
    let beside: Vec<[f64; 2]> = (3..=8)
        .flat_map(|k| [-1.0, 1.0].map(|side| side * f64::from(k) * FWHM_PER_SIGMA * sigma))
        .filter_map(|offset| Some([offset, middle(offset)?]))
        .collect();
    let Some(crest) = crest else { return false };
    if beside.len() < FEW {
        return true;
    }
    let pairs = beside
        .iter()
        .enumerate()
        .flat_map(|(i, a)| beside[..i].iter().map(move |b| (b[1] - a[1]) / (b[0] - a[0])));
    let slope = median(pairs).unwrap_or(0.0);
    let mut levels: Vec<f64> = beside.iter().map(|[x, height]| height - slope * x).collect();
    levels.sort_by(f64::total_cmp);
    let sky = median(levels.iter().copied()).unwrap_or(0.0);
    let scatter = SIGMA_PER_MAD * median(levels.iter().map(|v| (v - sky).abs())).unwrap_or(0.0);
    // A halo lights some lines only. One or two may be another trail; the third highest of twelve is 0.8 standard deviations above the middle.
    let high = (levels[levels.len() - 1 - levels.len() / 5] - sky) / 0.8;
    let scatter = scatter.max(high);
    let noise = 1.25 / independent.sqrt();
    // Height of a line of even light with this significance.
    let even = significance / independent.sqrt();
    let above = crest - sky;
    above >= OF_ASKED * asked * scatter.max(0.8 * noise) && above >= 0.5 * even - 2.0 * noise
}

/// Middle of the heights along a line without what stands far above it, with what its point spread lights: galaxies, blends and stars that no mask hides would draw the middle up, as a line is chosen for them. `None` where
/// nothing is known of the line.
fn even_crest(prepared: &Prepared, line: &Line) -> Option<f64> {
    let lit: Vec<Option<f64>> = heights(prepared, line).collect();
    let middle = median(lit.iter().flatten().copied())?;
    let high = (3.0 * middle).max(middle + 5.0);
    let reach = (3.0 * prepared.sigma_px).ceil() as usize;
    let is_far = |at: usize| {
        let near = at.saturating_sub(reach)..(at + reach + 1).min(lit.len());
        lit[near].iter().flatten().all(|height| *height <= high)
    };
    let even: Vec<f64> = (0..lit.len()).filter(|at| is_far(*at)).filter_map(|at| lit[at]).collect();
    // Of light in a few bright places the middle is what there is.
    if 3 * even.len() < lit.len() { Some(middle) } else { median(even) }
}

/// How much χ² points along a line explain, the best after one another: as many as a blend of stars may hold.
fn points(prepared: &Prepared, line: &Line, sigma: f64) -> f64 {
    let lit = heights(prepared, line).collect::<Vec<_>>();
    let step = line.length() / (lit.len() - 1).max(1) as f64;
    let mut left: Vec<f64> = lit.iter().map(|v| v.unwrap_or(0.0)).collect();
    let most = if line.length() < 30.0 * sigma { 3 } else { 4 };
    let mut explained = 0.0;
    for _ in 0..most {
        let Some((at, height)) = left
            .iter()
            .copied()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(_, h)| *h > 0.0)
        else {
            break;
        };
        // The penalty of a height and a place.
        explained += (height * height - 4.0).max(0.0);
        for (i, value) in left.iter_mut().enumerate() {
            let t = (i as f64 - at as f64) * step / sigma;
            *value -= height * (-0.25 * t * t).exp();
        }
    }
    explained
}

fn is_saturated(search: &Search<'_>, [width, height]: [usize; 2], line: &Line) -> bool {
    let steps = line.length().ceil() as usize;
    (0..=steps).any(|i| {
        let [x, y] = line.at(line.from + i as f64);
        let (x, y) = (x.round(), y.round());
        x >= 0.0
            && y >= 0.0
            && x < width as f64
            && y < height as f64
            && search.raw[y as usize * width + x as usize] >= search.full
    })
}

/// Masks the pixels of a streak.
fn mask(prepared: &mut Prepared, fitted: &Fitted) {
    let [width, height] = prepared.size;
    let reach = 3.0 * fitted.sigma_px + 1.0;
    let line = Line::of(fitted.ends);
    let steps = line.length().ceil() as usize;
    for i in 0..=steps {
        let [x, y] = line.at((i as f64).min(line.to));
        let columns =
            (x - reach).max(0.0) as usize..((x + reach + 1.0).max(0.0) as usize).min(width);
        for row in (y - reach).max(0.0) as usize..((y + reach + 1.0).max(0.0) as usize).min(height)
        {
            for column in columns.clone() {
                if (column as f64 - x).hypot(row as f64 - y) <= reach {
                    prepared.masked[row * width + column] = true;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the error function of another library, between the table's entries and beyond its ends.
    #[test]
    fn the_table_is_the_error_function() {
        for k in -9000..=9000 {
            let x = f64::from(k) / 1234.5;
            let truth = 0.5 * libm::erfc(-x / SQRT_2);
            assert!((phi(x) - truth).abs() < 2e-9, "{x}: {} {truth}", phi(x));
        }
        assert_eq!([phi(f64::NEG_INFINITY), phi(f64::INFINITY)], [0.0, 1.0]);
    }
}
