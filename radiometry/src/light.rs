//! Lights: the Sun and Vega, which are tabulated, and black bodies.

use crate::spectrum::{Irradiance, Spectrum};
use crate::tables;
use std::sync::LazyLock;

/// Spectral irradiance of the Sun at 1 au above the air, W m⁻² nm⁻¹ (ASTM G173-03), 280–2500 nm. Scale by 1/d² (d in au).
/// Solar references differ by about 2 % per band.
pub fn sun_at_1_au() -> &'static Spectrum<Irradiance> {
    static SUN: LazyLock<Spectrum<Irradiance>> = LazyLock::new(|| embedded(&tables::SUN));
    &SUN
}

/// Spectral irradiance of Vega above the air, W m⁻² nm⁻¹ (CALSPEC alpha_lyr_stis_011), 290–1260 nm.
pub fn vega() -> &'static Spectrum<Irradiance> {
    static VEGA: LazyLock<Spectrum<Irradiance>> = LazyLock::new(|| embedded(&tables::VEGA));
    &VEGA
}

fn embedded(table: &tables::Embedded) -> Spectrum<Irradiance> {
    let spectrum = Spectrum::from_table(table.table(), "wavelength_nm", "irradiance_w_m2_nm");
    spectrum.expect("embedded, and read by a test")
}

/// Spectral radiance of a black body, B_λ(T) in W m⁻² sr⁻¹ nm⁻¹ (Planck), at a vacuum wavelength in nm. Stable at
/// both ends: `expm1` where hc/λkT is small, an honest 0 where it is beyond the exponent's range.
pub fn planck_w_m2_sr_nm(temperature_k: f64, wavelength_nm: f64) -> f64 {
    use crate::constants::{BOLTZMANN_J_PER_K, HC_J_NM, LIGHT_M_PER_S};
    let metres = wavelength_nm * 1e-9;
    let x = HC_J_NM / (wavelength_nm * BOLTZMANN_J_PER_K * temperature_k);
    // 2hc²/λ⁵ per metre of wavelength, then per nm.
    2.0 * (HC_J_NM * 1e-9) * LIGHT_M_PER_S / metres.powi(5) / x.exp_m1() * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: 3.473e-9 erg/s/cm²/Å = 3.473e-11 W/m²/nm, the mean of 554.6–556.6 nm of the original file (9192 points), of which ours are 0.5 nm
    /// means: it checks units and the table, not CALSPEC. Tolerance: the digits given.
    #[test]
    fn vega_at_555_6_nm() {
        let mean = vega().bin_means(&[554.6, 556.6]).unwrap()[0];
        assert!((mean / 3.473e-11 - 1.0).abs() < 5e-4, "{mean}");
    }

    /// Truth: Stefan–Boltzmann, ∫B dλ = σT⁴/π, and Wien, λ_max T = 2.897771955e-3 m K (CODATA 2018).
    #[test]
    fn planck_integrates_to_stefan_boltzmann() {
        let t = 5772.0;
        let steps = 200_000;
        // In ln λ from 50 nm to 1 mm.
        let (a, b) = (50_f64.ln(), 1e6_f64.ln());
        let h = (b - a) / f64::from(steps);
        let sum: f64 = (0..steps)
            .map(|i| {
                let nm = (a + (f64::from(i) + 0.5) * h).exp();
                planck_w_m2_sr_nm(t, nm) * nm * h
            })
            .sum();
        let expected = 5.670_374_419e-8 * t.powi(4) / std::f64::consts::PI;
        assert!((sum / expected - 1.0).abs() < 1e-6, "{sum} {expected}");
        let peak = 2.897_771_955e6 / t;
        let b = |nm| planck_w_m2_sr_nm(t, nm);
        assert!(b(peak) > b(peak * 1.001) && b(peak) > b(peak * 0.999));
        assert_eq!(planck_w_m2_sr_nm(3.0, 300.0), 0.0);
    }
}
