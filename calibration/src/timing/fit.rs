//! The fit: by how much frames begin later than they say, from light that a counter saw, too.

use glam::{DMat3, DVec3};
use std::ops::Range;

/// Frames with an edge of the light in them, at least.
pub(super) const LEAST_FRAMES: f64 = 5.0;
/// Standard deviations by which frames must follow the counter's light.
const FOLLOWS_SIGMAS: f64 = 5.0;
/// Another shift is as good as the best if its squares are at most so much larger, as a part, or as χ².
const AS_GOOD: (f64, f64) = (1.2, 16.0);
/// Residuals beyond so many standard deviations count as if they had so many: a cosmic ray is no jitter.
const CLIP_SIGMAS: f64 = 4.0;
/// Shifts of a scan at most.
const MOST_SHIFTS: usize = 20_000;
/// Width at which the search for a shift ends, s.
const SETTLED_S: f64 = 1e-7;
/// A frame has an edge of the light in it where its counts change with the shift by more than this part of the most.
const EDGE: f64 = 0.2;
/// Frames, for a frame's light to be a straight line of the counter's.
const LEAST_USED: usize = 10;

/// A counter's light over time.
#[derive(Debug, Clone, Default)]
pub(super) struct Reference {
    /// Bins: begin and end, s, counts before it, its own. Bins that follow one another have the same number of a piece.
    bins: Vec<Bin>,
}

#[derive(Debug, Clone, Copy)]
struct Bin {
    begin_s: f64,
    end_s: f64,
    before: f64,
    counts: f64,
    piece: u32,
}

/// Bins farther apart than this are not one piece, s.
const APART_S: f64 = 1e-6;

impl Reference {
    /// Adds a bin; bins come in the order of time. What lies before the last one's end is left out.
    pub fn push(&mut self, span_s: Range<f64>, counts: f64) {
        let (mut before, mut piece) = (0.0, 0);
        if let Some(last) = self.bins.last() {
            if span_s.start < last.end_s - APART_S {
                return;
            }
            before = last.before + last.counts;
            piece = last.piece + u32::from(span_s.start > last.end_s + APART_S);
        }
        if span_s.end > span_s.start {
            let (begin_s, end_s) = (span_s.start, span_s.end);
            self.bins.push(Bin { begin_s, end_s, before, counts, piece });
        }
    }

    /// Median length of a bin, s; `None` without bins.
    pub fn bin_s(&self) -> Option<f64> {
        let mut lengths: Vec<f64> = self.bins.iter().map(|bin| bin.end_s - bin.begin_s).collect();
        lengths.sort_by(f64::total_cmp);
        lengths.get(lengths.len() / 2).copied()
    }

    /// Counts up to a time, with the piece that it lies in. Light is even within a bin.
    fn until(&self, time_s: f64) -> Option<(f64, u32)> {
        let after = self.bins.partition_point(|bin| bin.begin_s <= time_s);
        let bin = self.bins.get(after.checked_sub(1)?)?;
        if time_s > bin.end_s + APART_S {
            return None;
        }
        let part = ((time_s - bin.begin_s) / (bin.end_s - bin.begin_s)).min(1.0);
        Some((bin.before + part * bin.counts, bin.piece))
    }

    /// Counts within a span; `None` where bins are missing in it.
    pub fn within(&self, span_s: Range<f64>) -> Option<f64> {
        let (from, first) = self.until(span_s.start)?;
        let (to, last) = self.until(span_s.end)?;
        (first == last).then_some(to - from)
    }
}

/// A frame's light.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FrameLight {
    /// Begin as the frame says it, s.
    pub start_s: f64,
    /// Length of the exposure, s.
    pub exposure_s: f64,
    /// Light of each band of rows, any unit.
    pub bands: Vec<f64>,
}

impl FrameLight {
    fn span_s(&self, later_s: f64) -> Range<f64> {
        let from_s = self.start_s + later_s;
        from_s..from_s + self.exposure_s
    }
}

/// Shift of the frames of a band.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shift {
    /// Time by which exposures begin later than they say, s.
    pub later_s: f64,
    /// Standard uncertainty of it, s.
    pub sigma_s: f64,
    /// Standard deviation of a frame's own shift about it, s.
    pub jitter_s: f64,
    /// Frames that tell it: those that an edge of the light falls into.
    pub telling: f64,
    /// Part that each frame's own noise has in the shift, s: their squares add up to its variance, but for the bins'.
    pub influence_s: Vec<f64>,
}

/// Why no shift is found.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NoShift {
    /// Too few frames while the counter counted.
    Few(usize),
    /// The frames' light is not the counter's, or the same in all.
    Unlike,
    /// Too few frames into which an edge falls.
    NoEdges(f64),
    /// Other shifts fit as well, s.
    Ambiguous(Vec<f64>),
    /// The best shift lies at an end of what was searched, s.
    AtEnd(f64),
}

/// Line through light against counts: squares about it, and its slope.
struct Line {
    squares: f64,
    slope: f64,
}

fn line(light: &[f64], counts: &[f64]) -> Option<Line> {
    let n = light.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let (y, c) = (mean(light), mean(counts));
    let (mut cc, mut cy, mut yy) = (0.0, 0.0, 0.0);
    for (light, count) in light.iter().zip(counts) {
        let (dy, dc) = (light - y, count - c);
        cc += dc * dc;
        cy += dc * dy;
        yy += dy * dy;
    }
    if cc <= 0.0 || n < 3.0 {
        return None;
    }
    let slope = cy / cc;
    let squares = (yy - slope * cy).max(0.0);
    Some(Line { squares, slope })
}

/// Frames whose exposures the counter covers whatever the shift, up to `most_s` either way.
pub(super) fn covered<'a>(
    frames: &'a [FrameLight],
    reference: &Reference,
    most_s: f64,
) -> Vec<&'a FrameLight> {
    let is_covered = |frame: &&FrameLight| {
        let wide = frame.span_s(-most_s).start..frame.span_s(most_s).end;
        reference.within(wide).is_some()
    };
    frames.iter().filter(is_covered).collect()
}

/// Counts in the exposures at a shift.
fn counts_at(frames: &[&FrameLight], reference: &Reference, later_s: f64) -> Vec<f64> {
    frames.iter().map(|f| reference.within(f.span_s(later_s)).unwrap_or(0.0)).collect()
}

/// Finds the shift of the light `of` frames, from −`most_s` to `most_s`.
pub(super) fn search(
    frames: &[&FrameLight],
    of: &dyn Fn(&FrameLight) -> f64,
    reference: &Reference,
    most_s: f64,
) -> Result<Shift, NoShift> {
    if frames.len() < LEAST_USED {
        return Err(NoShift::Few(frames.len()));
    }
    let light: Vec<f64> = frames.iter().map(|frame| of(frame)).collect();
    let shortest_s = frames.iter().map(|f| f.exposure_s).fold(f64::INFINITY, f64::min);
    let bin_s = reference.bin_s().unwrap_or(most_s);
    // Half of the shortest thing that light may change within.
    let step_s = (0.5 * bin_s.min(shortest_s)).max(2.0 * most_s / MOST_SHIFTS as f64);
    let half = (most_s / step_s).floor() as i64;
    let scan: Vec<(f64, f64)> = (-half..=half)
        .filter_map(|i| {
            let later_s = i as f64 * step_s;
            let line = line(&light, &counts_at(frames, reference, later_s))?;
            // Light that falls as the counter's rises is another's.
            (line.slope > 0.0).then_some((later_s, line.squares))
        })
        .collect();
    let best = scan.iter().min_by(|a, b| a.1.total_cmp(&b.1)).copied();
    let (later_s, squares) = best.ok_or(NoShift::Unlike)?;
    if later_s.abs() > most_s - 2.0 * step_s {
        return Err(NoShift::AtEnd(later_s));
    }
    let shift = refine(frames, &light, reference, later_s, step_s)?;
    // An exposure apart it is another minimum, not the same one's flank.
    let flank_s = shortest_s.max(4.0 * bin_s).max(4.0 * shift.jitter_s);
    let limit = squares
        + (squares * (AS_GOOD.0 - 1.0)).max(AS_GOOD.1 * squares / (frames.len() as f64 - 3.0));
    let others = scan.windows(3).filter_map(|three| {
        let [before, this, after] = [three[0], three[1], three[2]];
        let least = this.1 <= before.1 && this.1 <= after.1 && this.1 <= limit;
        (least && (this.0 - later_s).abs() > flank_s).then_some(this.0)
    });
    let others: Vec<f64> = others.collect();
    if !others.is_empty() {
        return Err(NoShift::Ambiguous(std::iter::once(shift.later_s).chain(others).collect()));
    }
    Ok(shift)
}

/// The shift of light that is near a known one: within an exposure, or some bins.
pub(super) fn near(
    frames: &[&FrameLight],
    light: &[f64],
    reference: &Reference,
    known_s: f64,
) -> Result<Shift, NoShift> {
    let bin_s = reference.bin_s().unwrap_or(1e-3);
    let exposure_s = frames.iter().map(|f| f.exposure_s).fold(f64::INFINITY, f64::min);
    let reach_s = exposure_s.max(8.0 * bin_s);
    let step_s = 0.5 * bin_s.min(exposure_s);
    let half = (reach_s / step_s).ceil().min(1000.0) as i64;
    let squares = (-half..=half).filter_map(|i| {
        let later_s = known_s + i as f64 * step_s;
        let line = line(light, &counts_at(frames, reference, later_s))?;
        (line.slope > 0.0).then_some((later_s, line.squares))
    });
    let best = squares.min_by(|a, b| a.1.total_cmp(&b.1)).ok_or(NoShift::Unlike)?;
    refine(frames, light, reference, best.0, step_s)
}

/// Brings a shift that lies within `near_s` of the best one to it, and says how sure it is.
pub(super) fn refine(
    frames: &[&FrameLight],
    light: &[f64],
    reference: &Reference,
    near: f64,
    near_s: f64,
) -> Result<Shift, NoShift> {
    let bin_s = reference.bin_s().unwrap_or(1e-3);
    let squares = |later_s: f64| {
        line(light, &counts_at(frames, reference, later_s))
            .filter(|line| line.slope > 0.0)
            .map_or(f64::INFINITY, |line| line.squares)
    };
    let later_s = least(&squares, near - near_s, near + near_s);
    let first = sureness(frames, light, reference, later_s, 0.5 * bin_s)?;
    // The change of the counts over the jitter, where that is more than a bin.
    let half_s = (0.5 * bin_s).max(first.jitter_s);
    sureness(frames, light, reference, later_s, half_s)
}

/// Where a function with one valley between two places is least, to [`SETTLED_S`] (golden section).
fn least(of: &dyn Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let inner = |low: f64, high: f64| [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let [mut a, mut b] = inner(low, high);
    let (mut at_a, mut at_b) = (of(a), of(b));
    while high - low > SETTLED_S {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = inner(low, high)[0];
            at_a = of(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = inner(low, high)[1];
            at_b = of(b);
        }
    }
    0.5 * (low + high)
}

/// Uncertainty and jitter of a shift, from what the line through the frames' light leaves. The counts' change with the shift is taken over `half_s` either way.
fn sureness(
    frames: &[&FrameLight],
    light: &[f64],
    reference: &Reference,
    later_s: f64,
    half_s: f64,
) -> Result<Shift, NoShift> {
    let n = light.len() as f64;
    let counts = counts_at(frames, reference, later_s);
    let low = counts_at(frames, reference, later_s - half_s);
    let high = counts_at(frames, reference, later_s + half_s);
    let edges: Vec<f64> = low.iter().zip(&high).map(|(l, h)| (h - l) / (2.0 * half_s)).collect();
    let most = |values: &[f64]| values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let (scale, steep) = (most(&counts), most(&edges));
    if scale <= 0.0 || steep <= 0.0 {
        return Err(NoShift::NoEdges(0.0));
    }
    let row = |i: usize| DVec3::new(1.0, counts[i] / scale, edges[i] / steep);
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (i, light) in light.iter().enumerate() {
        normal += outer(row(i));
        right += row(i) * *light;
    }
    if normal.determinant().abs() < 1e-9 * n * n {
        return Err(NoShift::Unlike);
    }
    let inverse = normal.inverse();
    let found = inverse * right;
    let residuals: Vec<f64> = (0..light.len()).map(|i| light[i] - row(i).dot(found)).collect();
    // The sandwich of the fit holds whatever the noise of each frame is.
    let mut meat = DMat3::ZERO;
    for (i, residual) in residuals.iter().enumerate() {
        meat += outer(row(i) * *residual);
    }
    let covariance = inverse * meat * inverse * (n / (n - 3.0));
    if found.y <= FOLLOWS_SIGMAS * covariance.y_axis.y.max(0.0).sqrt() {
        return Err(NoShift::Unlike);
    }
    let telling = telling(&edges);
    if telling < LEAST_FRAMES {
        return Err(NoShift::NoEdges(telling));
    }
    let per_s = steep * found.y / scale;
    let less = (n / (n - 3.0)).sqrt() / per_s;
    let influence_s: Vec<f64> = residuals
        .iter()
        .enumerate()
        .map(|(i, residual)| inverse.mul_vec3(row(i)).z * residual * less)
        .collect();
    let sigma_s = influence_s.iter().map(|s| s * s).sum::<f64>().sqrt();
    // Each edge of the light stands in its bin as it likes.
    let bin_s = reference.bin_s().unwrap_or(0.0) / 12_f64.sqrt() / telling.sqrt();
    let jitter_s = jitter(&residuals, &counts, &edges, steep) / per_s;
    Ok(Shift { later_s, sigma_s: sigma_s.hypot(bin_s), jitter_s, telling, influence_s })
}

/// Standard deviation of the light by the shift alone, for an edge of the steepest kind: what frames with an edge scatter more than those without one do.
fn jitter(residuals: &[f64], counts: &[f64], edges: &[f64], steep: f64) -> f64 {
    let squares: Vec<f64> = residuals.iter().map(|r| r * r).collect();
    let is_edge = |i: &usize| edges[*i].abs() > EDGE * steep;
    let (edge, plain): (Vec<usize>, Vec<usize>) = (0..squares.len()).partition(is_edge);
    // Noise without an edge: even, and as the light.
    let at = |picked: &[usize], of: &[f64]| picked.iter().map(|i| of[*i]).collect::<Vec<f64>>();
    let (squares_plain, counts_plain) = (clipped(at(&plain, &squares)), at(&plain, counts));
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let even = mean(&squares_plain);
    let slope = line(&squares_plain, &counts_plain).map_or(0.0, |line| line.slope.max(0.0));
    let noise = |count: f64| (even + slope * (count - mean(&counts_plain))).max(0.0);
    let more: f64 = clipped(at(&edge, &squares))
        .iter()
        .zip(&edge)
        .map(|(square, i)| square - noise(counts[*i]))
        .sum();
    let steepness: f64 = edge.iter().map(|i| (edges[*i] / steep).powi(2)).sum();
    if steepness > 0.0 { (more / steepness).max(0.0).sqrt() } else { 0.0 }
}

/// Squares that are far above the others count as [`CLIP_SIGMAS`] standard deviations: a cosmic ray is no jitter.
fn clipped(mut squares: Vec<f64>) -> Vec<f64> {
    let mut sorted = squares.clone();
    sorted.sort_by(f64::total_cmp);
    // The median of squares of normal numbers is 0.455 of their mean.
    let most = CLIP_SIGMAS.powi(2) * sorted.get(sorted.len() / 2).map_or(0.0, |m| m / 0.455);
    squares.iter_mut().for_each(|square| *square = square.min(most));
    squares
}

/// Number of frames that tell the shift: (Σe²)² / Σe⁴.
fn telling(edges: &[f64]) -> f64 {
    let sum = |power: i32| edges.iter().map(|e| e.powi(power)).sum::<f64>();
    let fourth = sum(4);
    if fourth > 0.0 { sum(2).powi(2) / fourth } else { 0.0 }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::{Distribution as _, Normal, Poisson};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Flashes of 60 ms whose gaps are those of a list, in turn: the time for which they are on until a time, by adding them up one by one.
    fn on_s(gaps_s: &[f64], until_s: f64) -> f64 {
        let (mut begin, mut sum, mut i) = (0.0, 0.0, 0);
        while begin < until_s {
            sum += (until_s - begin).min(0.06);
            begin += gaps_s[i % gaps_s.len()];
            i += 1;
        }
        sum
    }

    struct Truth {
        latency_s: f64,
        jitter_s: f64,
        gaps_s: Vec<f64>,
        cadence_s: f64,
        noise: f64,
    }

    const UNEQUAL: [f64; 4] = [0.7, 1.1, 0.53, 1.31];

    /// 400 frames of 80 ms, counts of 20 kHz in bins of 10 ms on a background of 500 Hz.
    fn drawn(truth: &Truth, seed: u64) -> (Vec<FrameLight>, Reference) {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut draw = |mean: f64| Poisson::new(mean).map_or(0.0, |p| p.sample(&mut random));
        let end_s = 400.0 * truth.cadence_s + 6.0;
        let mut reference = Reference::default();
        for bin in 0..(end_s * 100.0) as u32 {
            let from_s = f64::from(bin) * 0.01;
            let lit_s = on_s(&truth.gaps_s, from_s + 0.01) - on_s(&truth.gaps_s, from_s);
            reference.push(from_s..from_s + 0.01, draw(5.0 + 20_000.0 * lit_s));
        }
        let jitter = Normal::new(truth.latency_s, truth.jitter_s).unwrap();
        let noise = Normal::new(0.0, truth.noise).unwrap();
        let frames = (0..400).map(|i| {
            let start_s = 2.5 + f64::from(i) * truth.cadence_s;
            let from_s = start_s + jitter.sample(&mut random);
            let lit_s = on_s(&truth.gaps_s, from_s + 0.08) - on_s(&truth.gaps_s, from_s);
            let light = 300.0 + 20_000.0 * lit_s + noise.sample(&mut random);
            FrameLight { start_s, exposure_s: 0.08, bands: vec![light] }
        });
        (frames.collect(), reference)
    }

    fn found(truth: &Truth, seed: u64, most_s: f64) -> Result<Shift, NoShift> {
        let (frames, reference) = drawn(truth, seed);
        let frames = covered(&frames, &reference, most_s);
        search(&frames, &|frame| frame.bands[0], &reference, most_s)
    }

    fn truth(latency_s: f64, jitter_s: f64) -> Truth {
        Truth { latency_s, jitter_s, gaps_s: UNEQUAL.to_vec(), cadence_s: 0.137, noise: 8.0 }
    }

    /// Truth: flashes, jitter and noise drawn here. Of 100 latencies from −0.1 to 0.9 s with jitters of 2 to 30 ms at least 90 lie within two of their uncertainties (95 expected; 89 or fewer
    /// have a chance of 1 % ), and the jitter is right within 20 % in the median, which 60 frames with an edge allow.
    #[test]
    fn latency_and_jitter_are_found_with_their_uncertainty() {
        let mut within = 0;
        let mut ratios = Vec::new();
        for seed in 0..100 {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(1000 + seed);
            let (latency_s, jitter_s) =
                (random.random_range(-0.1..0.9), random.random_range(0.002..0.03));
            let shift = found(&truth(latency_s, jitter_s), seed, 1.5).unwrap();
            let off_s = shift.later_s - latency_s;
            assert!(off_s.abs() < 5.0 * shift.sigma_s, "{seed}: {latency_s} {jitter_s} {shift:?}");
            within += u32::from(off_s.abs() < 2.0 * shift.sigma_s);
            ratios.push(shift.jitter_s / jitter_s);
        }
        ratios.sort_by(f64::total_cmp);
        eprintln!("{within} of 100 within two σ; jitter {:?}", [ratios[5], ratios[50], ratios[94]]);
        assert!(within >= 90, "{within}");
        assert!((ratios[50] - 1.0).abs() < 0.2, "{ratios:?}");
    }

    /// Truth: of even flashes each 1 s every shift by whole seconds fits as well; within half a second either way one is left.
    #[test]
    fn even_flashes_fit_at_several_latencies() {
        let even = Truth { gaps_s: vec![1.0], ..truth(0.23, 0.01) };
        let Err(NoShift::Ambiguous(shifts)) = found(&even, 1, 2.1) else { panic!("one latency") };
        assert!(shifts.len() >= 3 && shifts.iter().any(|s| (s - 1.23).abs() < 0.02), "{shifts:?}");
        let shift = found(&even, 1, 0.45).unwrap();
        assert!((shift.later_s - 0.23).abs() < 4.0 * shift.sigma_s, "{shift:?}");
    }

    /// Truth: by hand: frames each second of flashes each second have no edge in them, noise alone follows nothing, a latency beyond the range is no latency.
    #[test]
    fn what_cannot_tell_a_latency_is_refused() {
        let step = Truth { gaps_s: vec![1.0], cadence_s: 1.0, ..truth(0.3, 0.0) };
        let none = found(&step, 2, 0.45);
        assert!(none.is_err(), "{none:?}");
        let dark = Truth { gaps_s: vec![1e9], ..truth(0.3, 0.01) };
        assert!(matches!(found(&dark, 3, 1.0), Err(NoShift::Unlike)), "{:?}", found(&dark, 3, 1.0));
        let far = found(&truth(0.9, 0.005), 4, 0.4);
        assert!(far.is_err(), "{far:?}");
        let (frames, _) = drawn(&truth(0.3, 0.01), 5);
        let covered = covered(&frames, &Reference::default(), 1.0);
        assert_eq!(
            search(&covered, &|f| f.bands[0], &Reference::default(), 1.0),
            Err(NoShift::Few(0))
        );
    }

    /// Truth: by hand: 2 bins of 10 and 30 counts, a gap, one of 5; doubled and shuffled-back bins count once.
    #[test]
    fn counts_within_a_span() {
        let mut reference = Reference::default();
        for (from_s, counts) in [(0.0, 10.0), (1.0, 30.0), (1.0, 30.0), (0.5, 9.0), (3.0, 5.0)] {
            reference.push(from_s..from_s + 1.0, counts);
        }
        for (span_s, counts) in [
            (0.0..2.0, Some(40.0)),
            (0.5..1.5, Some(20.0)),
            (1.5..2.5, None),
            (1.9..3.5, None),
            (-0.1..0.5, None),
            (3.0..3.5, Some(2.5)),
        ] {
            assert_eq!(reference.within(span_s.clone()), counts, "{span_s:?}");
        }
    }
}
