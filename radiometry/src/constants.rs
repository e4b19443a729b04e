//! Constants of nature and of astronomy. CODATA 2018 (exact since the SI of 2019), IAU 2012 and 2015 resolutions.

/// Planck constant, J s (exact).
pub const PLANCK_J_S: f64 = 6.626_070_15e-34;
/// Speed of light in vacuum, m/s (exact).
pub const LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Boltzmann constant, J/K (exact).
pub const BOLTZMANN_J_PER_K: f64 = 1.380_649e-23;
/// Astronomical unit, m (IAU 2012 B2, exact).
pub const AU_M: f64 = 149_597_870_700.0;
/// Nominal solar radius, m (IAU 2015 B3).
pub const SUN_RADIUS_M: f64 = 6.957e8;

/// Energy of a photon times its wavelength, hc, in J nm.
pub const HC_J_NM: f64 = PLANCK_J_S * LIGHT_M_PER_S * 1e9;
/// The AB system's spectral flux density of magnitude 0: 3631 Jy, in W m⁻² Hz⁻¹ (Oke and Gunn 1983).
pub const AB_ZERO_W_M2_HZ: f64 = 3631e-26;
