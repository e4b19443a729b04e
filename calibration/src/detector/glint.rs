//! Light that changed within a bin, seen from the bins beside it.
//!
//! For light that stays between l and h with the mean m, all as counted, the true mean lies between n(m) and the chord of n over l…h at m: nothing else is
//! sure, as n is convex. Neighbours tell l and h of light that passes through the bin. What stands above both of them may have lasted
//! any part of the bin; [`Glints::shortest`] is the part that is thought of.

use super::Linearity;

/// When bins are flagged for light that may have changed within them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Glints {
    /// The relative error of the linear rate that is let pass.
    pub tolerance: f64,
    /// The shortest glint that is thought of, as part of a bin.
    pub shortest: f64,
    /// Changes below so many σ are noise.
    pub sigmas: f64,
}

impl Default for Glints {
    fn default() -> Self {
        Self { tolerance: 0.01, shortest: 0.1, sigmas: 3.0 }
    }
}

/// A counted rate and its exposure.
pub(crate) type Counted = (f64, f64);

impl Glints {
    /// How far the rate behind a bin's counts may be off for light that changed within it, Hz, seen from the bins beside it. Nothing is seen
    /// without one; infinite where the light may have been beyond the law.
    pub(crate) fn unresolved_hz(
        &self,
        law: &Linearity,
        (m, exposure_s): Counted,
        beside: &[Option<Counted>; 2],
    ) -> f64 {
        let noise2 = |(m, exposure_s): Counted| m.max(1.0 / exposure_s) / exposure_s;
        let own2 = noise2((m, exposure_s));
        let (mut low, mut high) = (m, m);
        let (mut sum, mut sum2, mut n) = (0.0, 0.0, 0.0);
        for other in beside.iter().flatten() {
            let noise = self.sigmas * (own2 + noise2(*other)).sqrt();
            low = low.min(other.0 + noise);
            high = high.max(other.0 - noise);
            sum += other.0;
            sum2 += noise2(*other);
            n += 1.0;
        }
        if n == 0.0 {
            return 0.0;
        }
        let base = sum / n;
        let excess = m - base - self.sigmas * (own2 + sum2 / (n * n)).sqrt();
        if excess > 0.0 {
            low = low.min(base);
            high = high.max(base + (m - base) / self.shortest);
        }
        law.unresolved_hz(m, low, high)
    }
}
