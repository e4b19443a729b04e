//! Earthshine and moonshine: sunlight that comes to the body by the Earth or the Moon.
//!
//! The Earth is a Lambert sphere lit by the Sun, of one reflectance ρ_E(λ) or of a table of them ([`super::earth`]): a point of its surface has the radiance
//! L = (ρ_E/π) E☉ cosθ☉, and the body sees the cap of it that lies above its own horizon (physics of the thesis, D.1, with the Sun's
//! angle at each point of the cap rather than one for all). The integral over the lit part of that cap is a sum over a few directions,
//! each of which is a collimated source for the exact engine, shadows and all. The Moon is one direction.
//!
//! The Earth is no Lambert sphere: clouds, oceans and snow make its reflectance anything from 0.1 to 0.8, so a mean of 0.30 is ± 50 %. That is
//! an error of the model, which the numbers here do not contain ([`EarthAlbedo::uncertainty`]).

use super::earth::cap::{LitCap, Rule};
use super::earth::{EarthAlbedo, GREY_NM};
use super::{DirectionError, Effect, Evaluator, Globe, Lighting, Source, Term, View};
use glam::DVec3;
use std::sync::Arc;
use sunglint_radiometry::spectrum::{Factor, Quantity, Reflectance, Spectrum, SpectrumError};

pub use super::earth::{EARTH_ALBEDO, EARTH_UNCERTAINTY};

/// The Moon's geometric albedo in V (Allen, Astrophysical Quantities).
pub const MOON_GEOMETRIC_ALBEDO: f64 = 0.12;
/// Points along each side of a panel of the cap, tried one after the other.
const ORDERS: [usize; 6] = [2, 3, 5, 8, 13, 21];
/// How far the Moon's law and its colour may be off between phase angles of 5° and 120°, relative.
pub const MOON_UNCERTAINTY: f64 = 0.2;

/// Directions (unit vectors, body axes) from which a globe's lit cap shines, and from each the irradiance across it, of the Sun's, for a
/// reflectance of 1 ([`LitCap::rule`]). Empty where the body sees nothing lit, or is not outside the globe.
pub fn cap(globe: &Globe, order: usize) -> Vec<(DVec3, f64)> {
    LitCap::even(globe).rule(order).nodes
}

/// Irradiance across the Moon's direction, of the Sun's: geometric albedo times the square of its angular radius times the law of its
/// phases, Δm = 0.026 g + 4·10⁻⁹ g⁴ with g in degrees (Allen 1976; Krisciunas and Schaefer 1991, eq. 9), grey.
pub fn moonlight(moon: &Globe) -> f64 {
    let phase_deg = moon.sun.angle_between(-moon.toward).to_degrees();
    let magnitudes = 0.026 * phase_deg + 4e-9 * phase_deg.powi(4);
    MOON_GEOMETRIC_ALBEDO
        * (moon.radius_m / moon.distance_m).powi(2)
        * 10_f64.powf(-0.4 * magnitudes)
}

/// Light from the Earth. Made for one scene, by its evaluator.
#[derive(Debug)]
pub struct Earthshine<'a> {
    evaluator: Evaluator<'a>,
    tolerance: f64,
    earth: Arc<EarthAlbedo>,
    /// Rules that agree one after the other before one is believed. Two of a table may do so by chance.
    agree: usize,
    rooms: [Vec<f64>; 3],
}

/// Light from the Moon.
#[derive(Debug)]
pub struct Moonshine<'a> {
    evaluator: Evaluator<'a>,
    room: Vec<f64>,
}

/// The terms of a body's materials in light that was reflected by `first` before: products of spectra, linear between their common wavelengths
/// and, where the product needs them, some between.
///
/// # Errors
/// A material's spectra that make no term.
pub fn terms(
    source: Source,
    materials: &[crate::surface::Material],
    first: &Spectrum<Reflectance>,
) -> Result<Vec<Term>, crate::surface::MaterialError> {
    let mut all = Vec::new();
    for (number, material) in materials.iter().enumerate() {
        for rho in material.spectra() {
            let spectrum = product(first, rho)?;
            all.push(Term { source, material: Some(number), spectrum });
        }
    }
    Ok(all)
}

/// The terms of a body's materials in light from the Earth: for each layer of it those of all materials ([`terms`]).
///
/// # Errors
/// As [`terms`].
pub fn terms_of(
    earth: &EarthAlbedo,
    materials: &[crate::surface::Material],
) -> Result<Vec<Term>, crate::surface::MaterialError> {
    let mut all = Vec::new();
    for layer in earth.spectra()? {
        all.extend(terms(Source::Earthshine, materials, &layer)?);
    }
    Ok(all)
}

/// What a product of two tables may differ from the line between its own rows.
const PRODUCT_TOLERANCE: f64 = 1e-6;

/// Between two wavelengths the product of two lines is a parabola: n chords stay within Δa Δb/(4n²) of it. It is known where both are.
pub(super) fn product<A: Quantity, B: Quantity>(
    a: &Spectrum<A>,
    b: &Spectrum<B>,
) -> Result<Spectrum<Factor>, SpectrumError> {
    let mut knots: Vec<f64> = a.wavelength_nm().iter().chain(b.wavelength_nm()).copied().collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup();
    let ((a0, a1), (b0, b1)) = (a.range_nm(), b.range_nm());
    let (first, last) = (a0.max(b0), a1.min(b1));
    if first < last {
        knots.retain(|nm| (first..=last).contains(nm));
    }
    let mut grid = vec![knots[0]];
    for pair in knots.windows(2) {
        let rise = |at: &dyn Fn(f64) -> f64| at(pair[1]) - at(pair[0]);
        let bend = (rise(&|nm| a.at(nm)) * rise(&|nm| b.at(nm))).abs() / (4.0 * PRODUCT_TOLERANCE);
        let chords = bend.sqrt().ceil().clamp(1.0, 500.0) as u32;
        let at = |k: u32| pair[0] + (pair[1] - pair[0]) * f64::from(k) / f64::from(chords);
        grid.extend((1..chords).map(at));
        grid.push(pair[1]);
    }
    let value = grid.iter().map(|nm| a.at(*nm) * b.at(*nm)).collect();
    Spectrum::new(grid, value)
}

impl<'a> Earthshine<'a> {
    /// Earthshine on a scene, found within `tolerance` of itself, of an Earth that is the same everywhere.
    pub fn new(evaluator: Evaluator<'a>, tolerance: f64) -> Self {
        Self { evaluator, tolerance, earth: Arc::default(), agree: 1, rooms: Default::default() }
    }

    /// The same of another Earth. Weights are those of all materials in the light of its first layer, then in that of the next, and so on: [`terms_of`].
    #[must_use]
    pub fn of(mut self, earth: Arc<EarthAlbedo>) -> Self {
        self.agree = if earth.grid().is_some() { 2 } else { 1 };
        self.earth = earth;
        self
    }
}

impl<'a> Moonshine<'a> {
    /// Moonshine on a scene.
    pub fn new(evaluator: Evaluator<'a>) -> Self {
        Self { evaluator, room: Vec::new() }
    }
}

/// Adds to `weights` and `errors` what comes from some directions, layer by layer.
fn add_all(
    evaluator: &mut Evaluator<'_>,
    rule: &Rule,
    (sun, view): (DVec3, View),
    room: &mut Vec<f64>,
    (weights, errors): (&mut [f64], &mut [f64]),
) -> Result<(), DirectionError> {
    let layers = rule.nodes.first().map_or(1, |_| rule.lights(0).len());
    let each = weights.len() / layers;
    room.clear();
    room.resize(each, 0.0);
    let each = each.max(1);
    for (i, &(toward, _)) in rule.nodes.iter().enumerate() {
        let done = evaluator.direct_from(toward, sun, view, room)?;
        let rows = weights.chunks_exact_mut(each).zip(errors.chunks_exact_mut(each));
        for ((weights, errors), light) in rows.zip(rule.lights(i)) {
            for ((weight, error), w) in weights.iter_mut().zip(errors).zip(&*room) {
                *weight += light * w;
                *error += (light * w).abs() * done.error;
            }
        }
    }
    Ok(())
}

impl Effect for Earthshine<'_> {
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        let Some(globe) = &lighting.earth else { return Ok(()) };
        let earth = self.earth.clone();
        let cap = LitCap::new(globe, &earth);
        let from = (lighting.sun_body, lighting.view);
        let [coarse, fine, room] = &mut self.rooms;
        let mut rounding = vec![0.0; weights.len()];
        // How far each weight of the last rule is from that of the rule before, and of that from the one before it.
        let mut apart = [vec![0.0; weights.len()], vec![0.0; weights.len()]];
        let mut agreed = 0;
        coarse.clear();
        coarse.resize(weights.len(), 0.0);
        for (step, &order) in ORDERS.iter().enumerate() {
            fine.clear();
            fine.resize(weights.len(), 0.0);
            rounding.fill(0.0);
            add_all(&mut self.evaluator, &cap.rule(order), from, room, (fine, &mut rounding))?;
            apart.swap(0, 1);
            let pairs = fine.iter().zip(&*coarse);
            apart[0].iter_mut().zip(pairs).for_each(|(a, (f, c))| *a = (f - c).abs());
            let size: f64 = fine.iter().sum();
            std::mem::swap(coarse, fine);
            let close = step > 0 && apart[0].iter().sum::<f64>() <= self.tolerance * size;
            agreed = if close { agreed + 1 } else { 0 };
            if agreed == self.agree {
                break;
            }
        }
        // Of a globe that is even the better rule's own error is smaller than its distance from the one before.
        for (k, weight) in coarse.iter().enumerate() {
            // Of a table the points may have light below 0, and where a body is turned away from all that is bright what is left of them, too; there is none of it.
            weights[k] += weight.max(0.0);
            let before = if self.agree > 1 { apart[1][k] } else { 0.0 };
            errors[k] += apart[0][k].max(before) + rounding[k];
        }
        Ok(())
    }
}

impl Effect for Moonshine<'_> {
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        let Some(moon) = &lighting.moon else { return Ok(()) };
        let moon = Rule::of_one(moon.toward, moonlight(moon));
        let from = (lighting.sun_body, lighting.view);
        add_all(&mut self.evaluator, &moon, from, &mut self.room, (weights, errors))
    }
}

/// A spectrum of 1 at all wavelengths.
pub(super) fn grey() -> Result<Spectrum<Reflectance>, SpectrumError> {
    Spectrum::constant(1.0, GREY_NM.0, GREY_NM.1)
}
