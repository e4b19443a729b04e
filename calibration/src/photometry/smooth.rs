//! Smoothing with a point's profile, and how far the result scatters.

use super::levels::{Counter, Level};

/// Half of a normal profile, of sum of squares 1: its middle first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Profile(Vec<f32>);

impl Profile {
    pub fn new(sigma_px: f64) -> Self {
        let reach = (4.0 * sigma_px).ceil() as usize;
        let profile: Vec<f64> =
            (0..=reach).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp()).collect();
        let norm = (2.0 * profile.iter().skip(1).map(|p| p * p).sum::<f64>() + 1.0).sqrt();
        Self(profile.iter().map(|p| (p / norm) as f32).collect())
    }

    /// How many pixels it reaches to either side.
    pub fn reach(&self) -> usize {
        self.0.len() - 1
    }
}

/// Pixels that are summed at once.
const LANES: usize = 16;

/// Buffers of a smoothing.
#[derive(Debug, Default)]
pub(crate) struct Smoother {
    line: Vec<f32>,
    rows: Vec<f32>,
    counter: Counter,
    band: Vec<f32>,
}

impl Smoother {
    /// Convolves some rows of an image (row by row) with a profile in both directions, into `out`; what is beyond the edge counts nothing.
    pub fn smooth(
        &mut self,
        image: &[f32],
        [width, height]: [usize; 2],
        range: std::ops::Range<usize>,
        profile: &Profile,
        out: &mut Vec<f32>,
    ) {
        let reach = profile.reach();
        // Rows of whole lanes, so that sums need no rest.
        let padded = width.next_multiple_of(LANES);
        let first = range.start.saturating_sub(reach);
        let last = (range.end + reach).min(height);
        // As many rows of nothing before and behind as the profile reaches.
        self.rows.clear();
        self.rows.resize((last - first + 2 * reach) * padded, 0.0);
        self.line.clear();
        self.line.resize(padded + 2 * reach, 0.0);
        for (from, to) in image[first * width..last * width]
            .chunks_exact(width)
            .zip(self.rows[reach * padded..].chunks_exact_mut(padded))
        {
            self.line[reach..reach + width].copy_from_slice(from);
            let line = &self.line;
            sums(to, &profile.0, |i| (&line[reach - i..], &line[reach + i..]));
        }
        out.clear();
        out.reserve(range.len() * width);
        self.line.clear();
        self.line.resize(padded, 0.0);
        for y in range {
            let rows = &self.rows;
            let row = |at: usize| &rows[at * padded..];
            let at = y - first + reach;
            sums(&mut self.line, &profile.0, |i| (row(at - i), row(at + i)));
            out.extend_from_slice(&self.line[..width]);
        }
    }

    /// Level and scatter of an image after smoothing, from bands of its rows.
    pub fn level(&mut self, image: &[f32], size: [usize; 2], profile: &Profile) -> Option<Level> {
        const BANDS: usize = 8;
        const VALUES: usize = 40_000;
        let [width, height] = size;
        let rows = VALUES.div_ceil(BANDS * width.max(1)).max(2);
        let mut values = Vec::new();
        let mut band = std::mem::take(&mut self.band);
        if rows * BANDS >= height {
            self.smooth(image, size, 0..height, profile, &mut values);
        } else {
            for i in 0..BANDS {
                let from = (2 * i + 1) * (height - rows) / (2 * BANDS);
                self.smooth(image, size, from..from + rows, profile, &mut band);
                values.extend_from_slice(&band);
            }
        }
        self.band = band;
        self.counter.level(values.chunks(width.max(1)), 0.0)
    }

    /// Level and scatter of a smoothed image, from some of its rows.
    pub fn level_of(&mut self, smoothed: &[f32], width: usize) -> Option<Level> {
        const VALUES: usize = 200_000;
        let every = smoothed.len().div_ceil(VALUES).max(1);
        self.counter.level(smoothed.chunks(width.max(1)).step_by(every), 0.0)
    }
}

/// Into `out`, of whole lanes: the sum over a half profile of what lies that far to one side and to the other.
fn sums<'a>(out: &mut [f32], profile: &[f32], sides: impl Fn(usize) -> (&'a [f32], &'a [f32])) {
    for (at, out) in out.chunks_exact_mut(LANES).enumerate() {
        let from = at * LANES;
        let lanes = |side: &'a [f32]| side[from..from + LANES].iter();
        let (middle, _) = sides(0);
        let mut sum = [0.0; LANES];
        for (sum, v) in sum.iter_mut().zip(lanes(middle)) {
            *sum = profile[0] * v;
        }
        for (i, p) in profile.iter().enumerate().skip(1) {
            let (a, b) = sides(i);
            for (sum, (a, b)) in sum.iter_mut().zip(lanes(a).zip(lanes(b))) {
                *sum += p * (a + b);
            }
        }
        out.copy_from_slice(&sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: closed form: one bright pixel becomes the profile, exp(−r²/2σ²) over its sum of squares in a row, Σ exp(−i²/σ²); at an edge the part
    /// inside. Tolerance: single precision of 100.
    #[test]
    fn a_pixel_becomes_the_profile() {
        for (size, at, sigma) in [
            ([41, 33], [20, 16], 1.7),
            ([70, 40], [0, 39], 1.7),
            ([5, 4], [4, 0], 3.0),
            ([1, 1], [0, 0], 0.5),
        ] {
            let mut image = vec![0.0; size[0] * size[1]];
            image[at[1] * size[0] + at[0]] = 100.0;
            let mut out = Vec::new();
            let profile = Profile::new(sigma);
            Smoother::default().smooth(&image, size, 0..size[1], &profile, &mut out);
            for (i, value) in out.iter().enumerate() {
                let (dx, dy) = ((i % size[0]).abs_diff(at[0]), (i / size[0]).abs_diff(at[1]));
                let inside = dx <= profile.reach() && dy <= profile.reach();
                let r2 = (dx * dx + dy * dy) as f64;
                let norm: f64 =
                    (-20..=20).map(|i| (-f64::from(i * i) / (sigma * sigma)).exp()).sum();
                let truth =
                    if inside { 100.0 * (-0.5 * r2 / (sigma * sigma)).exp() / norm } else { 0.0 };
                assert!((f64::from(*value) - truth).abs() < 1e-4, "{size:?} {i}: {value} {truth}");
            }
            let mut part = Vec::new();
            let range = size[1] / 3..size[1].div_ceil(2);
            Smoother::default().smooth(&image, size, range.clone(), &profile, &mut part);
            assert_eq!(part, out[range.start * size[0]..range.end * size[0]]);
        }
    }
}
