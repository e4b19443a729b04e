//! Earthshine and moonshine: sunlight that comes to the body by the Earth or the Moon.
//!
//! The Earth is a Lambert sphere lit by the Sun, of one reflectance ρ_E(λ): a point of its surface has the radiance
//! L = (ρ_E/π) E☉ cosθ☉, and the body sees the cap of it that lies above its own horizon (physics of the thesis, D.1, with the Sun's
//! angle at each point of the cap rather than one for all). The integral over the lit part of that cap is a sum over a few directions,
//! each of which is a collimated source for the exact engine, shadows and all. The Moon is one direction.
//!
//! The Earth is no Lambert sphere: clouds, oceans and snow make its reflectance anything from 0.1 to 0.8, so a mean of 0.30 is ± 50 %. That is
//! an error of the model, which the numbers here do not contain ([`EARTH_UNCERTAINTY`]).

use super::{DirectionError, Effect, Evaluator, Globe, Lighting, Source, Term, View};
use crate::surface::rule;
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2};
use sunglint_radiometry::spectrum::{Factor, Quantity, Reflectance, Spectrum, SpectrumError};

/// The mean (Bond) albedo of the Earth (Stephens et al. 2015, Reviews of Geophysics 53: 0.29 to 0.30).
pub const EARTH_ALBEDO: f64 = 0.30;
/// How far the Earth below one orbit may differ from its mean, relative.
pub const EARTH_UNCERTAINTY: f64 = 0.5;
/// The Moon's geometric albedo in V (Allen, Astrophysical Quantities).
pub const MOON_GEOMETRIC_ALBEDO: f64 = 0.12;
/// Points along each side of a panel of the cap, tried one after the other.
const ORDERS: [usize; 6] = [2, 3, 5, 8, 13, 21];
/// How far the Moon's law and its colour may be off between phase angles of 5° and 120°, relative.
pub const MOON_UNCERTAINTY: f64 = 0.2;

/// Directions (unit vectors, body axes) from which a globe's lit cap shines, and from each the irradiance across it, of the Sun's, for a
/// reflectance of 1. `order` points along each side of a panel. Empty where the body sees nothing lit, or is not outside the globe.
pub fn cap(globe: &Globe, order: usize) -> Vec<(DVec3, f64)> {
    let (polar, around) = (rule::legendre(order), rule::legendre(2 * order));
    over_panels(globe, &polar, &around)
}

/// One point of each panel of the lit cap, at two coordinates from −1 to 1, with the irradiance of the whole panel if it were as bright all over, of the
/// Sun's: the mean over even coordinates is the sum of [`cap`].
pub(super) fn cap_at(globe: &Globe, [polar, around]: [f64; 2]) -> Vec<(DVec3, f64)> {
    over_panels(globe, &[(polar, 2.0)], &[(around, 2.0)])
}

/// The panels of a globe's lit cap by two rules from −1 to 1: along the angle from the ground's vertical, and around.
fn over_panels(globe: &Globe, polar: &[(f64, f64)], around: &[(f64, f64)]) -> Vec<(DVec3, f64)> {
    let up = -globe.toward;
    let (r, d) = (globe.radius_m, globe.distance_m);
    if !(d > r && r > 0.0) {
        return Vec::new();
    }
    // Central angle from the point below the body to the terminator; the angle at which that is seen, from the ground's vertical.
    let sun_zenith = up.angle_between(globe.sun);
    let terminator = (FRAC_PI_2 - sun_zenith).abs();
    let seen = (d * terminator.sin()).atan2(d * terminator.cos() - r);
    let night_below = sun_zenith > FRAC_PI_2;
    if night_below && seen >= FRAC_PI_2 {
        return Vec::new();
    }
    let mut edges = vec![if night_below { seen } else { 0.0 }];
    if seen > edges[0] && seen < FRAC_PI_2 {
        edges.push(seen);
    }
    edges.push(FRAC_PI_2);
    let across = globe.sun - up.dot(globe.sun) * up;
    let x = across.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let y = up.cross(x);
    let mut nodes = Vec::with_capacity(polar.len() * around.len() * (edges.len() - 1));
    for panel in edges.windows(2) {
        let (middle, half) = (0.5 * (panel[0] + panel[1]), 0.5 * (panel[1] - panel[0]));
        for &(t, weight) in polar {
            // In the angle ε at the ground everything is smooth, at the limb too: sin η = (r/d) sin ε at the body, ψ = ε − η between.
            let (sin_ground, cos_ground) = (middle + half * t).sin_cos();
            let sin_body = r / d * sin_ground;
            let cos_body = ((1.0 - sin_body) * (1.0 + sin_body)).sqrt();
            let sin = sin_ground * cos_body - cos_ground * sin_body;
            let cos = cos_ground * cos_body + sin_ground * sin_body;
            let solid_angle = half * weight * sin_body * (r / d) * cos_ground / cos_body;
            // Lit where cos ψ cos z + sin ψ sin z cos φ > 0.
            let edge = -(cos * sun_zenith.cos()) / (sin * sun_zenith.sin()).max(f64::MIN_POSITIVE);
            let lit = edge.clamp(-1.0, 1.0).acos();
            for &(s, share) in around {
                let (y_part, x_part) = (lit * s).sin_cos();
                let aside = x_part * x + y_part * y;
                let cos_sun = (cos * up + sin * aside).dot(globe.sun);
                let irradiance = FRAC_1_PI * cos_sun * solid_angle * lit * share;
                if irradiance > 0.0 {
                    nodes.push((sin_body * aside - cos_body * up, irradiance));
                }
            }
        }
    }
    nodes
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

/// The most that the Earth can shine onto any facet, of the Sun's irradiance, for a Lambert reflectance: its whole cap lit from the zenith.
pub fn most_earthshine(distance_m: f64, radius_m: f64, reflectance: f64) -> f64 {
    // A facet that faces it: the cap's projected solid angle is π (R/d)².
    reflectance * (radius_m / distance_m).powi(2).min(1.0)
}

/// Light from the Earth. Made for one scene, by its evaluator.
#[derive(Debug)]
pub struct Earthshine<'a> {
    evaluator: Evaluator<'a>,
    tolerance: f64,
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

/// What a product of two tables may differ from the line between its own rows.
const PRODUCT_TOLERANCE: f64 = 1e-6;

/// Between two wavelengths the product of two lines is a parabola: n chords stay within Δa Δb/(4n²) of it.
pub(super) fn product<A: Quantity, B: Quantity>(
    a: &Spectrum<A>,
    b: &Spectrum<B>,
) -> Result<Spectrum<Factor>, SpectrumError> {
    let mut knots: Vec<f64> = a.wavelength_nm().iter().chain(b.wavelength_nm()).copied().collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup();
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
    /// Earthshine on a scene, found within `tolerance` of itself.
    pub fn new(evaluator: Evaluator<'a>, tolerance: f64) -> Self {
        Self { evaluator, tolerance, rooms: Default::default() }
    }
}

impl<'a> Moonshine<'a> {
    /// Moonshine on a scene.
    pub fn new(evaluator: Evaluator<'a>) -> Self {
        Self { evaluator, room: Vec::new() }
    }
}

/// Adds to `weights` and `errors` what comes from some directions.
fn add_all(
    evaluator: &mut Evaluator<'_>,
    nodes: &[(DVec3, f64)],
    (sun, view): (DVec3, View),
    room: &mut Vec<f64>,
    (weights, errors): (&mut [f64], &mut [f64]),
) -> Result<(), DirectionError> {
    room.clear();
    room.resize(weights.len(), 0.0);
    for &(toward, irradiance) in nodes {
        let done = evaluator.direct_from(toward, sun, view, room)?;
        for ((weight, error), w) in weights.iter_mut().zip(errors.iter_mut()).zip(&*room) {
            *weight += irradiance * w;
            *error += irradiance * w.abs() * done.error;
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
        let Some(earth) = &lighting.earth else { return Ok(()) };
        let from = (lighting.sun_body, lighting.view);
        let [coarse, fine, room] = &mut self.rooms;
        let mut rounding = vec![0.0; weights.len()];
        coarse.clear();
        coarse.resize(weights.len(), 0.0);
        for (step, &order) in ORDERS.iter().enumerate() {
            fine.clear();
            fine.resize(weights.len(), 0.0);
            rounding.fill(0.0);
            let nodes = cap(earth, order);
            add_all(&mut self.evaluator, &nodes, from, room, (fine, &mut rounding))?;
            let apart: f64 = fine.iter().zip(&*coarse).map(|(f, c)| (f - c).abs()).sum();
            let size: f64 = fine.iter().sum();
            std::mem::swap(coarse, fine);
            if step > 0 && apart <= self.tolerance * size {
                break;
            }
        }
        // The better rule's own error is smaller than its distance from the one before.
        for (k, (weight, before)) in coarse.iter().zip(&*fine).enumerate() {
            weights[k] += weight;
            errors[k] += (weight - before).abs() + rounding[k];
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
        let nodes = [(moon.toward, moonlight(moon))];
        let from = (lighting.sun_body, lighting.view);
        add_all(&mut self.evaluator, &nodes, from, &mut self.room, (weights, errors))
    }
}

/// The Earth's mean reflectance at all wavelengths, where no table is given.
///
/// # Errors
/// None, as long as [`EARTH_ALBEDO`] is a reflectance.
pub fn mean_earth() -> Result<Spectrum<Reflectance>, SpectrumError> {
    Spectrum::constant(EARTH_ALBEDO, 300.0, 1240.0)
}
