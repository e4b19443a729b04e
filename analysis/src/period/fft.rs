//! The fast Fourier transform of a power of two, as the non-uniform one needs it: real and imaginary parts apart, out of place, no allocation a call.
//!
//! Stockham's arrangement by radix 4 (a last pass by radix 2 where the power is odd): no reordering of bits, inner loops over neighbours.

use std::f64::consts::TAU;

/// The transform X_m = Σ_l x_l e^{−2πi l m / N} of one length.
#[derive(Debug, Clone)]
pub(super) struct Fft {
    n: usize,
    /// e^{−2πi k/N}.
    cos: Vec<f64>,
    sin: Vec<f64>,
    spare: (Vec<f64>, Vec<f64>),
}

impl Fft {
    /// For 2^`power` values.
    pub fn new(power: u32) -> Self {
        let n = 1_usize << power;
        let angle = |k: usize| -TAU * k as f64 / n as f64;
        Self {
            n,
            cos: (0..n).map(|k| angle(k).cos()).collect(),
            sin: (0..n).map(|k| angle(k).sin()).collect(),
            spare: (vec![0.0; n], vec![0.0; n]),
        }
    }

    /// Transforms in place.
    pub fn run(&mut self, re: &mut Vec<f64>, im: &mut Vec<f64>) {
        let (mut length, mut stride) = (self.n, 1);
        while length > 1 {
            let by = if length % 4 == 0 { 4 } else { 2 };
            self.pass(by, length, stride, re, im);
            std::mem::swap(re, &mut self.spare.0);
            std::mem::swap(im, &mut self.spare.1);
            length /= by;
            stride *= by;
        }
    }

    /// One pass from `re`, `im` into the spare arrays.
    fn pass(&mut self, by: usize, length: usize, stride: usize, re: &[f64], im: &[f64]) {
        let (out_re, out_im) = (&mut self.spare.0, &mut self.spare.1);
        let quarter = length / by;
        let block = stride * quarter;
        for p in 0..quarter {
            let from = stride * p;
            let to = by * from;
            let angle = p * stride;
            if by == 2 {
                let (a_re, b_re) = (&re[from..from + stride], &re[from + block..][..stride]);
                let (a_im, b_im) = (&im[from..from + stride], &im[from + block..][..stride]);
                let (w_re, w_im) = (self.cos[angle], self.sin[angle]);
                let (y0, y1) = out_re[to..to + 2 * stride].split_at_mut(stride);
                let (z0, z1) = out_im[to..to + 2 * stride].split_at_mut(stride);
                for q in 0..stride {
                    let (dr, di) = (a_re[q] - b_re[q], a_im[q] - b_im[q]);
                    y0[q] = a_re[q] + b_re[q];
                    z0[q] = a_im[q] + b_im[q];
                    y1[q] = dr * w_re - di * w_im;
                    z1[q] = dr * w_im + di * w_re;
                }
                continue;
            }
            let twiddle = |k: usize| (self.cos[k * angle], self.sin[k * angle]);
            let ((w1r, w1i), (w2r, w2i), (w3r, w3i)) = (twiddle(1), twiddle(2), twiddle(3));
            let part = |k: usize| from + k * block..from + k * block + stride;
            let (ar, br, cr, dr) = (&re[part(0)], &re[part(1)], &re[part(2)], &re[part(3)]);
            let (ai, bi, ci, di) = (&im[part(0)], &im[part(1)], &im[part(2)], &im[part(3)]);
            let (y01, y23) = out_re[to..to + 4 * stride].split_at_mut(2 * stride);
            let ((y0, y1), (y2, y3)) = (y01.split_at_mut(stride), y23.split_at_mut(stride));
            let (z01, z23) = out_im[to..to + 4 * stride].split_at_mut(2 * stride);
            let ((z0, z1), (z2, z3)) = (z01.split_at_mut(stride), z23.split_at_mut(stride));
            for q in 0..stride {
                let (sr, si) = (ar[q] + cr[q], ai[q] + ci[q]);
                let (tr, ti) = (ar[q] - cr[q], ai[q] - ci[q]);
                let (ur, ui) = (br[q] + dr[q], bi[q] + di[q]);
                // −i (b − d)
                let (vr, vi) = (bi[q] - di[q], dr[q] - br[q]);
                y0[q] = sr + ur;
                z0[q] = si + ui;
                let (xr, xi) = (tr + vr, ti + vi);
                y1[q] = xr * w1r - xi * w1i;
                z1[q] = xr * w1i + xi * w1r;
                let (xr, xi) = (sr - ur, si - ui);
                y2[q] = xr * w2r - xi * w2i;
                z2[q] = xr * w2i + xi * w2r;
                let (xr, xi) = (tr - vr, ti - vi);
                y3[q] = xr * w3r - xi * w3i;
                z3[q] = xr * w3i + xi * w3r;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the sum that defines the transform. Tolerance: 1e-13 of the largest value, some ten roundings a pass.
    #[test]
    fn the_transform_is_the_sum() {
        for power in [1, 2, 3, 4, 5, 7, 8] {
            let n = 1_usize << power;
            let value = |l: usize, a: f64| (a * l as f64 + 0.3).sin() + 0.1 * l as f64 / n as f64;
            let mut re: Vec<f64> = (0..n).map(|l| value(l, 1.7)).collect();
            let mut im: Vec<f64> = (0..n).map(|l| value(l, 2.9)).collect();
            let (x, y) = (re.clone(), im.clone());
            Fft::new(power).run(&mut re, &mut im);
            for m in 0..n {
                let (mut a, mut b) = (0.0, 0.0);
                for l in 0..n {
                    let (s, c) = (-TAU * ((l * m) % n) as f64 / n as f64).sin_cos();
                    a += x[l] * c - y[l] * s;
                    b += x[l] * s + y[l] * c;
                }
                let error = (a - re[m]).abs().max((b - im[m]).abs());
                assert!(error <= 1e-13 * n as f64, "2^{power}, {m}: {error:e}");
            }
        }
    }
}
