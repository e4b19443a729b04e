//! Scintillation: the twinkling of a star in a telescope's aperture, common to all channels.

/// Scale height of the turbulence's weight, m.
const SCALE_HEIGHT_M: f64 = 8000.0;
/// The empirical coefficient of usual sites: Osborn et al. 2015 (MNRAS 452, 1707) find medians from 1.30 to 1.67.
pub const USUAL_COEFFICIENT: f64 = 1.5;

/// Where a telescope stands and how wide it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Diameter, m.
    pub diameter_m: f64,
    /// Height above the sea, m.
    pub height_m: f64,
    /// Young's coefficient C_Y, m^(2/3) s^(1/2).
    pub coefficient: f64,
}

impl Aperture {
    /// Relative variance of the mean intensity in an exposure: σ²/I² = 1e-5 C_Y² D^(−4/3) t^(−1) X³ e^(−2h/8000 m): Young's law as Osborn et al.
    /// 2015 state it, for exposures longer than some ten milliseconds. `exposure_s` above 0; a prior, good to a factor of two or so in σ.
    pub fn variance(&self, exposure_s: f64, airmass: f64) -> f64 {
        1e-5 * self.coefficient.powi(2)
            * self.diameter_m.powf(-4.0 / 3.0)
            * airmass.powi(3)
            * (-2.0 * self.height_m / SCALE_HEIGHT_M).exp()
            / exposure_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand for 0.43 m, 0.1 s, sea level, C_Y = 1.5: √(1e-5·2.25·3.0813/0.1) = 2.633 % at the zenith, × 2^1.5 = 7.447 % at airmass 2;
    /// a site at 2,360 m (La Palma) has e^(−0.295) = 0.7445 of it. Tolerance: the digits.
    #[test]
    fn scintillation_of_a_small_telescope() {
        let sea = Aperture { diameter_m: 0.43, height_m: 0.0, coefficient: 1.5 };
        assert!((sea.variance(0.1, 1.0).sqrt() - 0.026_33).abs() < 1e-5);
        assert!((sea.variance(0.1, 2.0).sqrt() - 0.074_47).abs() < 2e-5);
        let la_palma = Aperture { height_m: 2360.0, ..sea };
        let ratio = (la_palma.variance(10.0, 1.0) / sea.variance(10.0, 1.0)).sqrt();
        assert!((ratio - 0.7445).abs() < 1e-4, "{ratio}");
    }
}
