//! A tabulated curve from measured to true rate: a monotone cubic through its points.

use super::DetectorError;
use super::law::At;

/// A cubic Hermite interpolant with the slopes of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 300, 1984; the "PCHIP" of numerical libraries): it
/// increases wherever its points do, so that it has an inverse. A table that begins above zero begins at the origin.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MonotoneCubic {
    x: Vec<f64>,
    y: Vec<f64>,
    slope: Vec<f64>,
}

impl MonotoneCubic {
    pub fn new(measured_hz: &[f64], true_hz: &[f64]) -> Result<Self, DetectorError> {
        let wrong = |field, found, expected| Err(DetectorError::Law { field, found, expected });
        if measured_hz.len() != true_hz.len() || measured_hz.is_empty() {
            let found = true_hz.len() as f64;
            return wrong("true_hz", found, "as many true as measured rates, at least one");
        }
        let (mut x, mut y) = (measured_hz.to_vec(), true_hz.to_vec());
        if x[0] > 0.0 {
            x.insert(0, 0.0);
            y.insert(0, 0.0);
        }
        if x.len() < 2 {
            return wrong("measured_hz", x[0], "a table with a rate above 0 Hz");
        }
        for (field, values) in [("measured_hz", &x), ("true_hz", &y)] {
            let first = values.iter().take(1).find(|v| !(v.is_finite() && **v >= 0.0));
            let later = values.windows(2).find(|w| !(w[1].is_finite() && w[1] > w[0]));
            if let Some(found) = first.copied().or(later.map(|w| w[1])) {
                return wrong(field, found, "rates from 0 Hz that increase");
            }
        }
        let slope = slopes(&x, &y);
        Ok(Self { x, y, slope })
    }

    /// The last measured and true rates, Hz.
    pub fn last(&self) -> (f64, f64) {
        (self.x[self.x.len() - 1], self.y[self.y.len() - 1])
    }

    pub fn slope_at_zero(&self) -> f64 {
        self.slope[0]
    }

    /// The curve at a measured rate; `None` beyond its last point.
    pub fn at(&self, m: f64) -> Option<At> {
        if m > self.last().0 {
            return None;
        }
        let i = self.x.partition_point(|x| *x <= m).clamp(1, self.x.len() - 1) - 1;
        let width = self.x[i + 1] - self.x[i];
        let t = (m - self.x[i]) / width;
        let rise = (self.y[i + 1] - self.y[i]) / width;
        let (d0, d1) = (self.slope[i], self.slope[i + 1]);
        // y = y₀ + w (d₀ t + c₂ t² + c₃ t³).
        let (c2, c3) = (3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise);
        let rate_hz = self.y[i] + width * t * (d0 + t * (c2 + t * c3));
        let kept = m * self.slope[0] / rate_hz;
        Some(At {
            rate_hz,
            slope: d0 + t * (2.0 * c2 + 3.0 * t * c3),
            curvature_s: (2.0 * c2 + 6.0 * t * c3) / width,
            // Exact for any number of equal pixels without prolonged dead time, to first order in the loss for others.
            fano: if kept < 1.0 { kept * kept } else { 1.0 },
            slope_at_zero: self.slope[0],
            trusted: true,
        })
    }
}

/// Slopes at the points: weighted harmonic means of the secants about a point, three-point formulas kept monotone at the ends.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let width: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let secant: Vec<f64> = y.windows(2).zip(&width).map(|(w, h)| (w[1] - w[0]) / h).collect();
    if n == 2 {
        return vec![secant[0]; 2];
    }
    let end = |h0: f64, h1: f64, s0: f64, s1: f64| {
        let slope = ((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1);
        // An end where the curve would stop or turn takes its secant: the table must keep an inverse.
        if slope > 0.0 { slope.min(3.0 * s0) } else { 0.5 * s0 }
    };
    let mut slope = vec![end(width[0], width[1], secant[0], secant[1])];
    for i in 1..n - 1 {
        let (w1, w2) = (2.0 * width[i] + width[i - 1], width[i] + 2.0 * width[i - 1]);
        slope.push((w1 + w2) / (w1 / secant[i - 1] + w2 / secant[i]));
    }
    slope.push(end(width[n - 2], width[n - 3], secant[n - 2], secant[n - 3]));
    slope
}
