//! The twinkling of a target: noise that all channels share.

/// Parameters of the scintillation at a station.
///
/// Young's approximation (Young 1967) as Osborn et al. 2015 (MNRAS 452, 1707, eq. 7) write it, with their coefficient for the site:
/// σ² = 10⁻⁵ C_Y² D^(−4/3) t⁻¹ X³ exp(−2 h / 8000 m). It holds for exposures longer than the wind takes to cross the mirror (some 20 ms for
/// half a metre), for the median night of a site; for a target that crosses the sky it is no more than a prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scintillation {
    /// Diameter of the telescope, m.
    pub diameter_m: f64,
    /// Altitude of the station above sea level, m.
    pub altitude_m: f64,
    /// C_Y, m^(2/3) s^(1/2): 1.5 is the middle of the sites of Osborn et al. 2015.
    pub coefficient: f64,
}

impl Scintillation {
    /// Scale height of the turbulence that scintillates, m.
    const SCALE_HEIGHT_M: f64 = 8000.0;

    /// The relative standard deviation of an exposure's rate, the same in all channels.
    pub fn relative_sigma(&self, exposure_s: f64, airmass: f64) -> f64 {
        let height = (-2.0 * self.altitude_m / Self::SCALE_HEIGHT_M).exp();
        let variance = 1e-5 * self.coefficient.powi(2) * self.diameter_m.powf(-4.0 / 3.0)
            / exposure_s
            * airmass.powi(3)
            * height;
        variance.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_metre_at_a_tenth_of_a_second() {
        // Truth: the formula by hand for 0.43 m, 0.1 s, 400 m: √(1e-5 · 2.25 · 3.0811 / 0.1 · 0.90484) = 2.505 %; X = 2 gives 2^1.5 of it.
        let here = Scintillation { diameter_m: 0.43, altitude_m: 400.0, coefficient: 1.5 };
        assert!((here.relative_sigma(0.1, 1.0) - 0.02505).abs() < 1e-5);
        let ratio = here.relative_sigma(0.1, 2.0) / here.relative_sigma(0.1, 1.0);
        assert!((ratio - 8f64.sqrt()).abs() < 1e-12);
    }
}
