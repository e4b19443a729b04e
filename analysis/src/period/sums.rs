//! Sums Σ c_j cos 2πf t_j and Σ c_j sin 2πf t_j on a grid of frequencies, by a non-uniform fast Fourier transform.
//!
//! Stretches of 2048 frequencies (more where there are more than 8192 samples), so that what is transformed stays in the cache: turned to the stretch's middle, spread on a grid of twice as many
//! points by the exponential of a semicircle (Barnett, Magland, af Klinteberg 2019, SIAM J. Sci. Comput. 41, C479), transformed, divided by the
//! kernel's own transform. The width of 14 points leaves 1e-13 of Σ|c|.

use super::FrequencyGrid;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Points of the grid that one sample is spread on.
const WIDTH: usize = 14;
/// The kernel's shape for a grid of twice as many points as frequencies: 2.30 a point of width (the same paper, eq. 8).
const BETA: f64 = 2.30 * WIDTH as f64;
/// The frequencies of a stretch, as a power of two: so many, that the transform stays in the cache.
const LARGEST_POWER: u32 = 11;
/// The same of many samples: a stretch is about as long as a quarter of them, so that spreading them costs no more than the transforms.
const LARGEST_POWER_OF_MANY: u32 = 17;
/// Stretches after which phases are computed anew: until then they are products, whose roundings add up.
const FRESH: usize = 32;
/// How much finer than its span asks the sums of a stretch are computed.
const FINE: f64 = 8.0;
/// Points of a polynomial between these.
const THROUGH: usize = 16;
/// Fewer frequencies between two of these spare nothing.
const WORTH: f64 = 4.0;
/// Nodes of the kernel's transform on half of its width.
const NODES: usize = 48;

/// cos and sin sums of several coefficients at the same times.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sums {
    /// Σ c_j cos 2πf t_j.
    pub cos: Vec<f64>,
    /// Σ c_j sin 2πf t_j.
    pub sin: Vec<f64>,
}

/// The fraction of a product, with the product's rounding error put back: phases of many turns keep their last digits.
pub(crate) fn turns(frequency: f64, time: f64) -> f64 {
    let product = frequency * time;
    let lost = frequency.mul_add(time, -product);
    (product - product.round()) + lost
}

/// The sums of every one of `coefficients` on a grid.
pub(crate) fn sums(time_s: &[f64], coefficients: &[&[f64]], grid: &FrequencyGrid) -> Vec<Sums> {
    let empty = Sums { cos: vec![0.0; grid.n], sin: vec![0.0; grid.n] };
    let mut all = vec![empty; coefficients.len()];
    if grid.n == 0 || time_s.is_empty() {
        return all;
    }
    let of_samples = (time_s.len() / 4).max(1).ilog2();
    let largest = of_samples.clamp(LARGEST_POWER, LARGEST_POWER_OF_MANY);
    let power = (usize::BITS - (grid.n - 1).leading_zeros()).clamp(5, largest);
    let stretch = 1_usize << power;
    let points = 2 * stretch;
    let spread = Spread::new(time_s, grid.step_hz, points);
    let correction = correction(power);
    let fft = FftPlanner::new().plan_fft_forward(points);
    let mut spare = vec![Complex64::ZERO; fft.get_inplace_scratch_len()];
    let mut field = vec![Complex64::ZERO; points + WIDTH];
    // Turning by a whole stretch.
    let step = grid.step_hz * stretch as f64;
    let on: Vec<(f64, f64)> = time_s.iter().map(|t| rotation(step, *t)).collect();
    let mut phase = Vec::new();
    for number in 0..grid.n.div_ceil(stretch) {
        let first = number * stretch;
        if number % FRESH == 0 {
            let middle = grid.frequency_hz(first + stretch / 2);
            phase = time_s.iter().map(|t| rotation(middle, *t)).collect();
        } else {
            for (p, on) in phase.iter_mut().zip(&on) {
                *p = (p.0 * on.0 - p.1 * on.1, p.0 * on.1 + p.1 * on.0);
            }
        }
        let last = grid.n.min(first + stretch);
        for (coefficients, sums) in coefficients.iter().zip(&mut all) {
            field.fill(Complex64::ZERO);
            spread.add(coefficients, &phase, &mut field);
            fft.process_with_scratch(&mut field[..points], &mut spare);
            // Modes below the stretch's middle lie at the end of the field, its middle and those above at the beginning.
            let half = stretch / 2;
            let modes = field[points - half..points].iter().chain(&field[..half]);
            let factors = correction[1..].iter().rev().chain(&correction[..half]);
            let into = sums.cos[first..last].iter_mut().zip(&mut sums.sin[first..last]);
            for (((cos, sin), mode), factor) in into.zip(modes).zip(factors) {
                *cos = mode.re * factor;
                *sin = -mode.im * factor;
            }
        }
    }
    all
}

/// The sums of one set of coefficients at times that span a part of 1/step of the grid: one night among many. About the middle of these times the sums change slowly with the frequency. They are
/// computed 8 times as finely as the span asks, between that by Lagrange's polynomial through 16 points, which leaves 1e-12 of Σ|c|, and turned to the times' own origin.
pub(crate) fn sums_of_a_stretch(
    time_s: &[f64],
    coefficients: &[f64],
    grid: &FrequencyGrid,
) -> Sums {
    let (from, to) =
        time_s.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(*t), b.max(*t)));
    let (middle, span) = (0.5 * (from + to), (to - from).max(0.0));
    let every = (1.0 / (FINE * span * grid.step_hz)).min(grid.n as f64).floor();
    if every.is_nan() || every < WORTH {
        let all = sums(time_s, &[coefficients], grid).pop();
        return all.unwrap_or(Sums { cos: vec![0.0; grid.n], sin: vec![0.0; grid.n] });
    }
    let own: Vec<f64> = time_s.iter().map(|t| t - middle).collect();
    let step_hz = every * grid.step_hz;
    let every = every as usize;
    let before = THROUGH / 2 - 1;
    let coarse = FrequencyGrid {
        first_hz: grid.first_hz - before as f64 * step_hz,
        step_hz,
        n: grid.n.div_ceil(every) + THROUGH,
    };
    let mut found = Sums { cos: vec![0.0; grid.n], sin: vec![0.0; grid.n] };
    let Some(few) = sums(&own, &[coefficients], &coarse).pop() else { return found };
    let weights: Vec<[f64; THROUGH]> =
        (0..every).map(|i| lagrange(before as f64 + i as f64 / every as f64)).collect();
    let (turn_cos, turn_sin) = rotation(-grid.step_hz, middle);
    let mut turned = (1.0, 0.0);
    for i in 0..grid.n {
        turned = match i % FRESH {
            0 => rotation(-grid.frequency_hz(i), middle),
            _ => (
                turned.0 * turn_cos - turned.1 * turn_sin,
                turned.0 * turn_sin + turned.1 * turn_cos,
            ),
        };
        let (first, row) = (i / every, &weights[i % every]);
        let (mut cos, mut sin) = (0.0, 0.0);
        let points = few.cos[first..first + THROUGH].iter().zip(&few.sin[first..first + THROUGH]);
        for (w, (c, s)) in row.iter().zip(points) {
            cos += w * c;
            sin += w * s;
        }
        found.cos[i] = cos * turned.0 - sin * turned.1;
        found.sin[i] = cos * turned.1 + sin * turned.0;
    }
    found
}

/// Weights of Lagrange's polynomial through 0, 1, … at a place between.
fn lagrange(at: f64) -> [f64; THROUGH] {
    std::array::from_fn(|j| {
        let others = (0..THROUGH).filter(|k| *k != j);
        others.map(|k| (at - k as f64) / (j as f64 - k as f64)).product()
    })
}

/// e^{−2πi f t}.
fn rotation(frequency: f64, time: f64) -> (f64, f64) {
    let (sin, cos) = (-TAU * turns(frequency, time)).sin_cos();
    (cos, sin)
}

/// Places and weights of the samples on the grid: the same in every stretch.
struct Spread {
    first: Vec<usize>,
    weight: Vec<[f64; WIDTH]>,
    points: usize,
}

impl Spread {
    fn new(time_s: &[f64], step_hz: f64, points: usize) -> Self {
        let mut first = Vec::with_capacity(time_s.len());
        let mut weight = Vec::with_capacity(time_s.len());
        for t in time_s {
            let turn = turns(step_hz, *t);
            let place = (turn - turn.floor()) * points as f64;
            // The first of the points within half a width; WIDTH/2 further, so that it is not negative.
            let start = (place - 0.5 * WIDTH as f64).ceil();
            let mut row = [0.0; WIDTH];
            for (k, w) in row.iter_mut().enumerate() {
                *w = kernel((start + k as f64 - place) / (0.5 * WIDTH as f64));
            }
            first.push((start as i64).rem_euclid(points as i64) as usize);
            weight.push(row);
        }
        Self { first, weight, points }
    }

    /// Adds coefficients at their phases. The field is longer than the grid by a width, which is then folded back.
    fn add(&self, coefficients: &[f64], phase: &[(f64, f64)], field: &mut [Complex64]) {
        for (((first, weight), c), (cos, sin)) in
            self.first.iter().zip(&self.weight).zip(coefficients).zip(phase)
        {
            let turned = Complex64::new(c * cos, c * sin);
            for (at, w) in field[*first..*first + WIDTH].iter_mut().zip(weight) {
                *at += turned * w;
            }
        }
        let (grid, beyond) = field.split_at_mut(self.points);
        for (at, more) in grid.iter_mut().zip(beyond) {
            *at += *more;
        }
    }
}

/// The exponential of a semicircle on −1…1.
fn kernel(z: f64) -> f64 {
    let inside = 1.0 - z * z;
    if inside < 0.0 { 0.0 } else { (BETA * (inside.sqrt() - 1.0)).exp() }
}

/// Factor of each mode of a stretch of 2^`power` frequencies, by the distance from its middle: one over the kernel's transform,
/// (width/2) ∫ φ(z) cos(2π m z (width/2)/points) dz. With z = sin u the end's root is smooth, and the midpoint rule converges geometrically. Computed once.
fn correction(power: u32) -> &'static [f64] {
    static KNOWN: [OnceLock<Vec<f64>>; LARGEST_POWER_OF_MANY as usize + 1] =
        [const { OnceLock::new() }; LARGEST_POWER_OF_MANY as usize + 1];
    KNOWN[power as usize].get_or_init(|| {
        let stretch = 1_usize << power;
        let points = (2 * stretch) as f64;
        let half = 0.5 * WIDTH as f64;
        let nodes: Vec<(f64, f64)> = (0..NODES)
            .map(|k| {
                let u = std::f64::consts::FRAC_PI_2 * (k as f64 + 0.5) / NODES as f64;
                let weight = std::f64::consts::PI / NODES as f64 * u.cos();
                (u.sin(), weight * kernel(u.sin()))
            })
            .collect();
        (0..=stretch / 2)
            .map(|m| {
                let a = TAU * m as f64 * half / points;
                1.0 / (half * nodes.iter().map(|(z, w)| w * (a * z).cos()).sum::<f64>())
            })
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the sums themselves, of nights far from the origin, of one sample, and of times so long that nothing is spared. Tolerance: 2e-12 of Σ|c| and the rounding of phases.
    #[test]
    fn the_sums_of_a_night_are_the_sums() {
        let mut state = 11_u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let grid = FrequencyGrid { first_hz: 2e-4, step_hz: 3.1e-8, n: 40_000 };
        for (n, from, span) in
            [(500, -4e5, 2e4), (80, 3.9e5, 1e5), (1, 2e5, 0.0), (40, -1e4, 3e3), (300, -4e5, 8e5)]
        {
            let time: Vec<f64> = (0..n).map(|_| from + span * random()).collect();
            let c: Vec<f64> = (0..n).map(|_| random() - 0.4).collect();
            let found = sums_of_a_stretch(&time, &c, &grid);
            let scale: f64 = c.iter().map(|c| c.abs()).sum();
            for i in (0..grid.n).step_by(37) {
                let f = grid.frequency_hz(i);
                let (mut a, mut b) = (0.0, 0.0);
                for (t, c) in time.iter().zip(&c) {
                    let (sin, cos) = (TAU * turns(f, *t)).sin_cos();
                    a += c * cos;
                    b += c * sin;
                }
                let error = (a - found.cos[i]).abs().max((b - found.sin[i]).abs());
                let most = (2e-12 + 1.2e-16 * TAU * f * 5e5) * scale;
                assert!(error <= most, "{n} samples over {span} s at {f} Hz: {:e}", error / scale);
            }
        }
    }

    /// Truth: the sums themselves. Tolerance: of Σ|c| 1e-12, ten times what the kernel leaves, and a rounding (2^-53) of the
    /// frequency over the largest time, in radians.
    #[test]
    fn the_sums_are_the_sums() {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        for (n, grid) in [
            (1, FrequencyGrid { first_hz: 0.25, step_hz: 0.125, n: 3 }),
            (50, FrequencyGrid { first_hz: 0.0, step_hz: 1e-3, n: 100 }),
            (300, FrequencyGrid { first_hz: 3.7, step_hz: 4.1e-4, n: 70_000 }),
            // A grid coarser than the span resolves: samples wrap around it.
            (40, FrequencyGrid { first_hz: 1.0, step_hz: 0.37, n: 5000 }),
        ] {
            let time: Vec<f64> = (0..n).map(|_| 1000.0 * (random() - 0.5)).collect();
            let c: Vec<f64> = (0..n).map(|_| random() - 0.4).collect();
            let ones = vec![1.0; n];
            let found = sums(&time, &[&c, &ones], &grid);
            for (c, found) in [(&c, &found[0]), (&ones, &found[1])] {
                let scale: f64 = c.iter().map(|c| c.abs()).sum();
                for i in (0..grid.n).step_by(1 + grid.n / 997) {
                    let f = grid.frequency_hz(i);
                    let (mut a, mut b) = (0.0, 0.0);
                    for (t, c) in time.iter().zip(c) {
                        let (sin, cos) = (TAU * turns(f, *t)).sin_cos();
                        a += c * cos;
                        b += c * sin;
                    }
                    let error = (a - found.cos[i]).abs().max((b - found.sin[i]).abs());
                    assert!(
                        error <= (1e-12 + 1.2e-16 * TAU * f * 500.0) * scale,
                        "{n} samples at {f} Hz: {:e}",
                        error / scale
                    );
                }
            }
        }
    }
}
