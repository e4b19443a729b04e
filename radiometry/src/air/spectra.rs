//! How strongly each gas absorbs or scatters, at the native wavenumbers: every 5 cm⁻¹ from 8000 to 34000.

use super::LOSCHMIDT_CM3;
use super::aerosol::Aerosol;
use super::model::{Amounts, amount};
use crate::tables;
use std::borrow::Cow;
use std::sync::OnceLock;

pub(crate) const FIRST_CM1: f64 = 8000.0;
pub(crate) const LAST_CM1: f64 = 34000.0;
pub(crate) const STEP_CM1: f64 = 5.0;
pub(crate) const NATIVE: usize = 5201;

/// Species that takes light out of the beam.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Species {
    Rayleigh,
    Ozone,
    WaterLines,
    WaterContinuum,
    Oxygen,
    CarbonDioxide,
    Aerosol,
}

/// One summand of the optical depth: `coefficient`(λ) · amount^`exponent`. The band model's exponent is below 1 (it does
/// not follow Beer–Lambert), everything else has 1.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    pub(crate) species: Species,
    pub(crate) amount: usize,
    pub(crate) exponent: f64,
    /// The native point of the first coefficient; outside, the coefficient is zero.
    pub(crate) first: usize,
    pub(crate) coefficient: Vec<f64>,
}

impl Term {
    /// The term on a choice of native points (ascending).
    pub(crate) fn pick(&self, native: &[usize]) -> Term {
        let end = self.first + self.coefficient.len();
        let from = native.partition_point(|&i| i < self.first);
        let to = native.partition_point(|&i| i < end);
        Term {
            first: from,
            coefficient: native[from..to]
                .iter()
                .map(|&i| self.coefficient[i - self.first])
                .collect(),
            ..*self
        }
    }

    /// Adds the term to optical depths.
    pub(crate) fn add(&self, amounts: &Amounts, depths: &mut [f64]) {
        let amount = amounts[self.amount];
        // Not "≤ 0": ozone times its temperature in °C is negative. Scaled amounts, which take an exponent, are not.
        if amount == 0.0 {
            return;
        }
        let factor = if self.exponent == 1.0 { amount } else { amount.powf(self.exponent) };
        let depths = &mut depths[self.first..self.first + self.coefficient.len()];
        for (depth, coefficient) in depths.iter_mut().zip(&self.coefficient) {
            *depth += coefficient * factor;
        }
    }

    fn new(species: Species, amount: usize, exponent: f64, all: Vec<f64>) -> Self {
        let first = all.iter().position(|c| *c != 0.0).unwrap_or(0);
        let end = all.iter().rposition(|c| *c != 0.0).map_or(first, |i| i + 1);
        Term { species, amount, exponent, first, coefficient: all[first..end].to_vec() }
    }
}

pub(crate) fn wavenumber_cm1(index: usize) -> f64 {
    FIRST_CM1 + STEP_CM1 * index as f64
}

/// A region of the water bands: from and to which wavenumber, the exponent a of the band model, and the exponents n of
/// pressure and m of temperature in the scaled amount (LOWTRAN7; header of the table `molecular_bands`).
pub(crate) struct WaterRegion {
    from_cm1: f64,
    to_cm1: f64,
    a: f64,
    pub(crate) n: f64,
    pub(crate) m: f64,
}

const fn region(from_cm1: f64, to_cm1: f64, a: f64, n: f64, m: f64) -> WaterRegion {
    WaterRegion { from_cm1, to_cm1, a, n, m }
}

/// The regions; the first also serves its edge at 8000 cm⁻¹.
pub(crate) const WATER_REGIONS: [WaterRegion; 6] = [
    region(8000.0, 9615.0, 0.5579, 0.8658, -0.1034),
    region(9620.0, 11540.0, 0.5621, 0.8874, -0.2576),
    region(11545.0, 13070.0, 0.5847, 0.7982, 0.0588),
    region(13075.0, 14860.0, 0.6076, 0.8088, 0.2816),
    region(14865.0, 16045.0, 0.6508, 0.6642, 0.2764),
    region(16340.0, 17860.0, 0.6570, 0.6656, 0.5061),
];
/// (a, n, m) of oxygen.
pub(crate) const OXYGEN: (f64, f64, f64) = (0.5641, 0.9353, 0.1936);
/// (a, n, m) of carbon dioxide.
pub(crate) const CARBON_DIOXIDE: (f64, f64, f64) = (0.7070, 0.6035, 0.6026);

/// The terms that are the same for every station: all but Rayleigh (CO₂) and aerosol.
pub(crate) fn gases() -> &'static [Term] {
    static TERMS: OnceLock<Vec<Term>> = OnceLock::new();
    TERMS.get_or_init(|| {
        let mut terms = ozone();
        terms.extend(bands());
        terms.extend(water_continuum());
        terms
    })
}

/// A column of an embedded table.
pub(crate) fn column(table: &'static tables::Embedded, name: &str) -> Cow<'static, [f64]> {
    // A test touches every column named here, so this cannot fail in a program that passed it.
    #[expect(clippy::unwrap_used, reason = "embedded table, read by a test")]
    table.table().f64(name).unwrap()
}

/// A table's value at a wavenumber, linear between its rows, zero outside.
fn linear(x: &[f64], y: &[f64], at: f64) -> f64 {
    let upper = x.partition_point(|x| *x < at);
    if upper == x.len() || (upper == 0 && x[0] > at) {
        return 0.0;
    }
    if x[upper] == at {
        return y[upper];
    }
    let f = (at - x[upper - 1]) / (x[upper] - x[upper - 1]);
    y[upper - 1] + f * (y[upper] - y[upper - 1])
}

fn native(value: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..NATIVE).map(|i| value(wavenumber_cm1(i))).collect()
}

/// Hartley–Huggins σ = c₀(1 + c₁t + c₂t²), t in °C, and Chappuis, all per atm·cm.
fn ozone() -> Vec<Term> {
    let huggins = &tables::OZONE_HARTLEY_HUGGINS;
    let cm1 = column(huggins, "wavenumber_cm1");
    let c0 = column(huggins, "c0_1e20_cm2");
    let c1 = column(huggins, "c1_per_k");
    let c2 = column(huggins, "c2_per_k2");
    let per_atm_cm = 1e-20 * LOSCHMIDT_CM3;
    let chappuis_cm1 = column(&tables::OZONE_CHAPPUIS, "wavenumber_cm1");
    let chappuis = column(&tables::OZONE_CHAPPUIS, "coefficient_per_atm_cm");
    let cold: Vec<f64> = c0.iter().zip(c1.iter()).map(|(a, b)| a * b).collect();
    let colder: Vec<f64> = c0.iter().zip(c2.iter()).map(|(a, b)| a * b).collect();
    let sum = native(|v| per_atm_cm * linear(&cm1, &c0, v) + linear(&chappuis_cm1, &chappuis, v));
    vec![
        Term::new(Species::Ozone, amount::OZONE, 1.0, sum),
        Term::new(
            Species::Ozone,
            amount::OZONE_T,
            1.0,
            native(|v| per_atm_cm * linear(&cm1, &cold, v)),
        ),
        Term::new(
            Species::Ozone,
            amount::OZONE_T2,
            1.0,
            native(|v| per_atm_cm * linear(&cm1, &colder, v)),
        ),
    ]
}

/// Band model: optical depth 10^(a(C′ + log₁₀ W)) = 10^(aC′) W^a; C′ ≤ −20 stands for no absorption.
fn bands() -> Vec<Term> {
    let cm1 = column(&tables::MOLECULAR_BANDS, "wavenumber_cm1");
    let band = |name: &str, a: f64, from: f64, to: f64| {
        let c = column(&tables::MOLECULAR_BANDS, name);
        native(|v| {
            // The table's own rows stand at the native points: no interpolation between logarithms.
            match cm1.binary_search_by(|x| x.total_cmp(&v)) {
                Ok(i) if v >= from && v <= to && c[i] > -20.0 => 10_f64.powf(a * c[i]),
                _ => 0.0,
            }
        })
    };
    let mut terms: Vec<Term> = WATER_REGIONS
        .iter()
        .enumerate()
        .map(|(i, r)| {
            let coefficient = band("c_h2o", r.a, r.from_cm1, r.to_cm1);
            Term::new(Species::WaterLines, amount::WATER_LINES + i, r.a, coefficient)
        })
        .collect();
    for (species, name, amount, a) in [
        (Species::Oxygen, "c_o2", amount::OXYGEN, OXYGEN.0),
        (Species::CarbonDioxide, "c_co2", amount::CARBON_DIOXIDE, CARBON_DIOXIDE.0),
    ] {
        terms.push(Term::new(species, amount, a, band(name, a, FIRST_CM1, LAST_CM1)));
    }
    terms
}

/// Optical depth 1e-20 v [s₂₉₆ W₅ + (s₂₆₀ − s₂₉₆) W₉ + (f₂₉₆ + far wing) W₁₀].
fn water_continuum() -> Vec<Term> {
    let table = &tables::WATER_CONTINUUM;
    let cm1 = column(table, "wavenumber_cm1");
    let (warm, cold) = (column(table, "self_296"), column(table, "self_260"));
    let (foreign, wing) = (column(table, "foreign_296"), column(table, "far_wing"));
    let term = |amount, value: &dyn Fn(f64) -> f64| {
        Term::new(Species::WaterContinuum, amount, 1.0, native(|v| 1e-20 * v * value(v)))
    };
    vec![
        term(amount::WATER_SELF, &|v| linear(&cm1, &warm, v)),
        term(amount::WATER_SELF_COLD, &|v| linear(&cm1, &cold, v) - linear(&cm1, &warm, v)),
        term(amount::WATER_FOREIGN, &|v| linear(&cm1, &foreign, v) + linear(&cm1, &wing, v)),
    ]
}

/// Rayleigh scattering per molecule of air \[cm²\]: Bodhaine et al. 1999 (J. Atmos. Oceanic Technol. 16, 1854), eq. 29,
/// which is for 360 ppm of CO₂; other amounts by the refractivity, n − 1 ∝ 1 + 0.54 (C − 0.0003), and the
/// King factor.
pub(crate) fn rayleigh_cm2(wavelength_nm: f64, co2_ppm: f64) -> f64 {
    let l2 = (1e-3 * wavelength_nm).powi(2);
    let base = (1.045_599_6 - 341.290_61 / l2 - 0.902_308_50 * l2)
        / (1.0 + 0.002_705_988_9 / l2 - 85.968_563 * l2);
    let refractivity = |ppm: f64| 1.0 + 0.54 * (1e-6 * ppm - 0.0003);
    let king = |ppm: f64| {
        let nitrogen = 1.034 + 3.17e-4 / l2;
        let oxygen = 1.096 + 1.385e-3 / l2 + 1.448e-4 / (l2 * l2);
        let percent = 1e-4 * ppm;
        (78.084 * nitrogen + 20.946 * oxygen + 0.934 + percent * 1.15)
            / (78.084 + 20.946 + 0.934 + percent)
    };
    1e-28
        * base
        * (refractivity(co2_ppm) / refractivity(360.0)).powi(2)
        * (king(co2_ppm) / king(360.0))
}

pub(crate) fn rayleigh(co2_ppm: f64) -> Term {
    let coefficient = native(|v| rayleigh_cm2(1e7 / v, co2_ppm));
    Term::new(Species::Rayleigh, amount::AIR, 1.0, coefficient)
}

/// The aerosol's terms: none, or what lies low and the background.
pub(crate) fn aerosol(aerosol: &Aerosol, station_km: f64) -> Vec<Term> {
    if *aerosol == Aerosol::None {
        return Vec::new();
    }
    let depths = |v: f64| aerosol.optical_depths(1e7 / v, station_km);
    vec![
        Term::new(Species::Aerosol, amount::AEROSOL, 1.0, native(|v| depths(v).0)),
        Term::new(Species::Aerosol, amount::BACKGROUND, 1.0, native(|v| depths(v).1)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the definition that eq. 29 is a fit to (Bodhaine et al. 1999): σ = 24π³(n²−1)²/(λ⁴N²(n²+2)²)·F with
    /// the refractive index of Peck and Reeder (300 ppm), N = 2.546899e19 cm⁻³.
    #[test]
    fn the_fit_for_rayleigh_follows_its_definition() {
        for nm in [300.0, 400.0, 550.0, 800.0] {
            let (l2, cm) = ((1e-3_f64 * nm).powi(2), 1e-7 * nm);
            let s2 = 1.0 / l2;
            let n300 =
                1e-8 * (8060.51 + 2_480_990.0 / (132.274 - s2) + 17_455.7 / (39.329_57 - s2));
            let n = 1.0 + n300 * (1.0 + 0.54 * 6e-5);
            let king = (78.084 * (1.034 + 3.17e-4 * s2)
                + 20.946 * (1.096 + 1.385e-3 * s2 + 1.448e-4 * s2 * s2)
                + 0.934
                + 0.036 * 1.15)
                / 100.0;
            let number = 2.546_899e19_f64;
            let truth = 24.0 * std::f64::consts::PI.powi(3) * (n * n - 1.0).powi(2)
                / (cm.powi(4) * number.powi(2) * (n * n + 2.0).powi(2))
                * king;
            let sigma = rayleigh_cm2(nm, 360.0);
            assert!((sigma / truth - 1.0).abs() < 3e-4, "{nm} nm: {sigma:e} against {truth:e}");
        }
        // More CO₂ scatters a little more: 1 + 2·0.54·60e-6 and the King factor.
        let ratio = rayleigh_cm2(550.0, 420.0) / rayleigh_cm2(550.0, 360.0);
        assert!(ratio > 1.0 + 6e-5 && ratio < 1.0 + 9e-5, "{ratio}");
    }

    #[test]
    fn every_gas_has_its_terms_and_no_coefficient_is_negative_where_it_must_not_be() {
        let gases = gases();
        assert_eq!(gases.len(), 3 + 6 + 2 + 3);
        for term in gases {
            assert!(!term.coefficient.is_empty());
            assert!(term.first + term.coefficient.len() <= NATIVE);
            if term.exponent != 1.0 {
                assert!(term.coefficient.iter().all(|c| *c >= 0.0));
            }
        }
    }
}
