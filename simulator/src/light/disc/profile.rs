//! How the Sun's disc darkens towards its limb, with wavelength and place kept apart.
//!
//! I(μ, λ) ∝ μ^a(λ) with μ the cosine of the angle at which a line of sight leaves the Sun (Hestroffer and Magnan 1998, A&A 333, 338):
//! a = −0.023 + 0.292/λ from 416 to 1100 nm and a = −0.507 + 0.441/λ from 303 to 372 nm (λ in µm), linear in λ between. The
//! law is continued to 290 and to 1300 nm and held beyond. Divided by its mean over the disc it is ℓ_a(μ) = (a + 2)/2 μ^a.
//!
//! Whatever the exponent, ℓ_a is a sum over [`PROFILES`] fixed profiles: ℓ(μ, λ) = p_0(μ) + Σ_j L_j(λ) p_j(μ), where p_0 = ℓ_½ (a = ½ is the
//! exponent at 558 nm) has the mean 1 and p_j = ℓ_{a_j} − ℓ_½ have the mean 0: Lagrange's interpolation in √a between five exponents. It errs
//! by 9e-6 of the disc's light on the average over the disc, and by 1.5e-3 of the mean brightness at the very limb.

use sunglint_radiometry::spectrum::{Factor, Spectrum, SpectrumError};

/// How many profiles there are: the grey one and four that tint it.
pub const PROFILES: usize = 5;

/// Their exponents, the grey one's first; multiples of 1/32, so that powers are products of square roots.
pub const EXPONENTS: [f64; PROFILES] = [0.5, 0.218_75, 0.312_5, 0.812_5, 1.0];

/// Where the law is held, nm.
const HELD_NM: (f64, f64) = (290.0, 1300.0);

/// The exponent a(λ) of limb darkening at a wavelength (vacuum nm).
pub fn exponent(wavelength_nm: f64) -> f64 {
    let um = 1e-3 * wavelength_nm.clamp(HELD_NM.0, HELD_NM.1);
    let (violet, visible) = (|um: f64| -0.507 + 0.441 / um, |um: f64| -0.023 + 0.292 / um);
    if um <= 0.372 {
        violet(um)
    } else if um >= 0.416 {
        visible(um)
    } else {
        let t = (um - 0.372) / (0.416 - 0.372);
        violet(0.372) * (1.0 - t) + visible(0.416) * t
    }
}

/// ℓ(μ, λ): the brightness of the Sun's disc in units of its mean (over the projected disc), by the power law itself.
pub fn brightness(mu: f64, wavelength_nm: f64) -> f64 {
    let a = exponent(wavelength_nm);
    (0.5 * a + 1.0) * mu.powf(a)
}

/// The factors 1, L_1 … before the profiles at a wavelength (nm).
pub fn factors(wavelength_nm: f64) -> [f64; PROFILES] {
    let x = exponent(wavelength_nm).sqrt();
    let at = EXPONENTS.map(f64::sqrt);
    let mut factors = std::array::from_fn(|j| {
        (0..PROFILES).filter(|k| *k != j).map(|k| (x - at[k]) / (at[j] - at[k])).product()
    });
    // What all of them sum up to.
    factors[0] = 1.0;
    factors
}

/// The profiles p_0(μ), p_1(μ) ….
pub fn profiles(mu: f64) -> [f64; PROFILES] {
    let half = mu.sqrt();
    let quarter = half.sqrt();
    let eighth = quarter.sqrt();
    let sixteenth = eighth.sqrt();
    let grey = 1.25 * half;
    [
        grey,
        1.109_375 * (eighth * sixteenth * sixteenth.sqrt()) - grey,
        1.156_25 * (quarter * sixteenth) - grey,
        1.406_25 * (half * quarter * sixteenth) - grey,
        1.5 * mu - grey,
    ]
}

/// ⟨x²⟩ over the disc of radius 1 weighted by each profile: 1/(a + 4).
pub fn second_moments() -> [f64; PROFILES] {
    let moment = |a: f64| 1.0 / (a + 4.0);
    let mut moments = EXPONENTS.map(|a| moment(a) - moment(EXPONENTS[0]));
    moments[0] = moment(EXPONENTS[0]);
    moments
}

/// The largest |L_j| over all wavelengths.
pub fn largest_factors() -> [f64; PROFILES] {
    let mut most = [0.0_f64; PROFILES];
    for nm in (290..=1300).step_by(2) {
        let at = factors(f64::from(nm));
        most.iter_mut().zip(at).for_each(|(m, f)| *m = m.max(f.abs()));
    }
    most
}

/// A spectrum times L_j(λ), on a grid on which their product is linear to 1e-5 of the spectrum's largest value: with gaps of 2 nm at
/// most where L_j varies.
///
/// # Errors
/// None for a spectrum that is one.
pub fn times_factor(
    wavelength_nm: &[f64],
    value: &[f64],
    profile: usize,
) -> Result<Spectrum<Factor>, SpectrumError> {
    let table: Spectrum<Factor> = Spectrum::new(wavelength_nm.to_vec(), value.to_vec())?;
    if profile == 0 {
        return Ok(table);
    }
    // The reflectance is held beyond its table; the Sun's colour goes on.
    let (first, last) = (wavelength_nm[0], wavelength_nm[wavelength_nm.len() - 1]);
    let (first, last) = (first.min(HELD_NM.0), last.max(HELD_NM.1));
    let steps = ((HELD_NM.1 - HELD_NM.0) / 2.0) as u32;
    let mut grid: Vec<f64> = (0..=steps).map(|k| HELD_NM.0 + 2.0 * f64::from(k)).collect();
    grid.extend_from_slice(wavelength_nm);
    grid.extend([first, last]);
    grid.sort_by(f64::total_cmp);
    grid.dedup();
    let value = grid.iter().map(|&nm| table.at(nm) * factors(nm)[profile]).collect();
    Spectrum::new(grid, value)
}
