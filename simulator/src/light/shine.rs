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
/// Points along each side of a cell of the cap, of the rule that is believed and of the one it is held against.
const ORDERS: [usize; 2] = [3, 2];
/// Cells err in different ways: of their distances the root of the sum of squares counts, so many times, and never more than their sum.
const CLAIMED: f64 = 2.0;
/// What a cell may hide from both its rules (a glint, a slit of light): this, times the square of its share of the irradiance, of all earthshine. It says which cell
/// is halved and when that ends, and is no part of the claim.
const HIDDEN: f64 = 0.1;
/// Of itself, what earthshine may be off: the Earth is known to half of its light.
const OF_ITSELF: f64 = 0.03;
/// Directions of an epoch at most: what is open then is in the stated error.
const MOST_ASKED: usize = 1500;
/// Wavelengths at which earthshine is weighed beside sunlight.
const WEIGHED: usize = 8;
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
    let mut nodes = Vec::new();
    if let Some(lit) = LitCap::of(globe) {
        (0..lit.panels()).for_each(|panel| lit.nodes(panel, polar, around, &mut nodes));
    }
    nodes
}

/// The part of a globe's lit side that a body sees, in one panel or two: where the terminator does not run, and where it does.
#[derive(Debug)]
struct LitCap {
    sun: DVec3,
    /// From the globe's middle to the body, and the axes across it: the first towards the Sun.
    up: DVec3,
    x: DVec3,
    y: DVec3,
    sun_zenith: f64,
    /// Radius over distance.
    sine: f64,
    /// The panels' ends: angles from the ground's vertical.
    edges: Vec<f64>,
}

impl LitCap {
    /// `None` where nothing lit is seen, or the body is not outside the globe.
    fn of(globe: &Globe) -> Option<Self> {
        let up = -globe.toward;
        let (r, d) = (globe.radius_m, globe.distance_m);
        if !(d > r && r > 0.0) {
            return None;
        }
        // Central angle from the point below the body to the terminator; the angle at which that is seen, from the ground's vertical.
        let sun_zenith = up.angle_between(globe.sun);
        let terminator = (FRAC_PI_2 - sun_zenith).abs();
        let seen = (d * terminator.sin()).atan2(d * terminator.cos() - r);
        let night_below = sun_zenith > FRAC_PI_2;
        if night_below && seen >= FRAC_PI_2 {
            return None;
        }
        let mut edges = vec![if night_below { seen } else { 0.0 }];
        if seen > edges[0] && seen < FRAC_PI_2 {
            edges.push(seen);
        }
        edges.push(FRAC_PI_2);
        let across = globe.sun - up.dot(globe.sun) * up;
        let x = across.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        let y = up.cross(x);
        Some(Self { sun: globe.sun, up, x, y, sun_zenith, sine: r / d, edges })
    }

    fn panels(&self) -> usize {
        self.edges.len() - 1
    }

    /// Adds the directions of a panel and their irradiances by two rules from −1 to 1.
    fn nodes(
        &self,
        panel: usize,
        polar: &[(f64, f64)],
        around: &[(f64, f64)],
        nodes: &mut Vec<(DVec3, f64)>,
    ) {
        let (first, last) = (self.edges[panel], self.edges[panel + 1]);
        let (middle, half) = (0.5 * (first + last), 0.5 * (last - first));
        let (sin_zenith, cos_zenith) = self.sun_zenith.sin_cos();
        for &(t, weight) in polar {
            // In the angle ε at the ground everything is smooth, at the limb too: sin η = (r/d) sin ε at the body, ψ = ε − η between.
            let (sin_ground, cos_ground) = (middle + half * t).sin_cos();
            let sin_body = self.sine * sin_ground;
            let cos_body = ((1.0 - sin_body) * (1.0 + sin_body)).sqrt();
            let sin = sin_ground * cos_body - cos_ground * sin_body;
            let cos = cos_ground * cos_body + sin_ground * sin_body;
            let solid_angle = half * weight * sin_body * self.sine * cos_ground / cos_body;
            // Lit where cos ψ cos z + sin ψ sin z cos φ > 0.
            let edge = -(cos * cos_zenith) / (sin * sin_zenith).max(f64::MIN_POSITIVE);
            let lit = edge.clamp(-1.0, 1.0).acos();
            for &(s, share) in around {
                let (y_part, x_part) = (lit * s).sin_cos();
                let aside = x_part * self.x + y_part * self.y;
                let cos_sun = (cos * self.up + sin * aside).dot(self.sun);
                let irradiance = FRAC_1_PI * cos_sun * solid_angle * lit * share;
                if irradiance > 0.0 {
                    nodes.push((sin_body * aside - cos_body * self.up, irradiance));
                }
            }
        }
    }
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
///
/// A body's edges, and what it shades of itself, make kinks in what it sends of each direction's light, so that no rule over the whole cap converges fast, and two
/// rules over all of it agree by chance. So the cap falls into cells, each with two rules; the cell whose rules are farthest apart is halved until what all of them
/// claim together is within the tolerance.
#[derive(Debug)]
pub struct Earthshine<'a> {
    evaluator: Evaluator<'a>,
    tolerance: f64,
    /// ρ of each weight at some wavelengths.
    rho: Vec<[f64; WEIGHED]>,
    rules: [Vec<(f64, f64)>; 2],
    room: Vec<f64>,
    asked: usize,
}

/// The middles of the first cells of a panel.
const QUARTERS: [[f64; 2]; 4] = [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]];

/// What is claimed of cells whose rules are so far apart.
fn claimed(apart: impl Iterator<Item = f64>) -> f64 {
    let (sum, squares) = apart.fold((0.0, 0.0), |(s, q), a| (s + a, q + a * a));
    sum.min(CLAIMED * f64::sqrt(squares))
}

/// A cell of a panel of the lit cap, in the panel's coordinates from −1 to 1.
#[derive(Debug)]
struct Cell {
    panel: usize,
    middle: [f64; 2],
    half: [f64; 2],
    /// Along which of them it is halved.
    axis: usize,
    weights: Vec<f64>,
    /// How far the two rules are apart, of each weight.
    apart: Vec<f64>,
    rounding: Vec<f64>,
    irradiance: f64,
    /// The light and what the rules are apart at the wavelengths.
    light: [f64; WEIGHED],
    off: [f64; WEIGHED],
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
    /// Earthshine on a scene, found within `tolerance` of all light that an epoch has in full sunlight, that which is scattered once among it, for an Earth of
    /// [`EARTH_ALBEDO`]; and within 3 % of itself, which is what counts in the Earth's shadow.
    pub fn new(evaluator: Evaluator<'a>, tolerance: f64) -> Self {
        let spectra: Vec<_> = evaluator.scene.spectra().collect();
        let ends = spectra.iter().map(|s| s.range_nm());
        let (first, last) = ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or_default();
        let nm = |k: usize| first + (last - first) * (k as f64 + 0.5) / WEIGHED as f64;
        let rho = spectra.iter().map(|s| std::array::from_fn(|k| s.at(nm(k)))).collect();
        let rules = ORDERS.map(rule::legendre);
        Self { evaluator, tolerance, rho, rules, room: Vec::new(), asked: 0 }
    }

    /// From how many directions the scene was lit so far: what it costs.
    pub fn asked(&self) -> usize {
        self.asked
    }

    /// Σ ρ|W| at each of the wavelengths.
    fn at_wavelengths(&self, weights: &[f64]) -> [f64; WEIGHED] {
        let mut sums = [0.0; WEIGHED];
        for (w, rho) in weights.iter().zip(&self.rho) {
            sums.iter_mut().zip(rho).for_each(|(sum, rho)| *sum += rho * w.abs());
        }
        sums
    }

    /// A cell by both rules.
    fn cell(
        &mut self,
        cap: &LitCap,
        (panel, middle, half, axis): (usize, [f64; 2], [f64; 2], usize),
        from: (DVec3, View),
    ) -> Result<Cell, DirectionError> {
        let n = self.rho.len();
        let [mut weights, mut apart, mut rounding, mut idle] = [(); 4].map(|()| vec![0.0; n]);
        let (mut nodes, mut irradiance) = (Vec::new(), 0.0);
        for (k, rule) in self.rules.iter().enumerate() {
            let along = |axis: usize| -> Vec<(f64, f64)> {
                let one = |(x, w): &(f64, f64)| (middle[axis] + half[axis] * x, half[axis] * w);
                rule.iter().map(one).collect()
            };
            nodes.clear();
            cap.nodes(panel, &along(0), &along(1), &mut nodes);
            self.asked += nodes.len();
            irradiance += nodes.iter().map(|n| 0.5 * n.1).sum::<f64>();
            let out = if k == 0 { (&mut weights, &mut rounding) } else { (&mut apart, &mut idle) };
            add_all(&mut self.evaluator, &nodes, from, &mut self.room, (out.0, out.1))?;
        }
        apart.iter_mut().zip(&weights).for_each(|(a, w)| *a = (*a - w).abs());
        let (light, off) = (self.at_wavelengths(&weights), self.at_wavelengths(&apart));
        Ok(Cell { panel, middle, half, axis, weights, apart, rounding, irradiance, light, off })
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
        let Some(cap) = lighting.earth.as_ref().and_then(LitCap::of) else { return Ok(()) };
        let from = (lighting.sun_body, lighting.view);
        // Weights are those of an Earth that reflects all.
        let beside = EARTH_ALBEDO.recip();
        let mut sunlight = vec![0.0; weights.len()];
        self.evaluator.direct(lighting.sun_body, lighting.view, &mut sunlight)?;
        let sunlight = self.at_wavelengths(&sunlight).map(|s| beside * s);
        let most = self.asked + MOST_ASKED;
        let mut cells = Vec::new();
        for panel in 0..cap.panels() {
            for middle in QUARTERS {
                cells.push(self.cell(&cap, (panel, middle, [0.5, 0.5], 0), from)?);
            }
        }
        loop {
            let sum = |f: &dyn Fn(&Cell) -> f64| cells.iter().map(f).sum::<f64>();
            let irradiance = sum(&|c| c.irradiance);
            let earthlight: [f64; WEIGHED] = std::array::from_fn(|k| sum(&|c| c.light[k]));
            let doubt = |c: &Cell| -> [f64; WEIGHED] {
                let hidden = HIDDEN * (c.irradiance / irradiance).powi(2);
                std::array::from_fn(|k| c.off[k] + hidden * earthlight[k])
            };
            let doubts: Vec<_> = cells.iter().map(doubt).collect();
            let left = std::array::from_fn(|k| claimed(doubts.iter().map(|d| d[k])));
            // How far off, of what it may be, at the wavelength where that is most.
            let share = |off: &[f64; WEIGHED]| {
                let may = |(s, e): (&f64, &f64)| (self.tolerance * (s + e)).min(OF_ITSELF * e);
                let may = sunlight.iter().zip(&earthlight).map(may);
                let shares = off.iter().zip(may).filter(|(_, may)| *may > 0.0);
                shares.map(|(off, may)| off / may).fold(0.0, f64::max)
            };
            if share(&left) <= 1.0 || self.asked >= most {
                break;
            }
            let worst =
                (0..cells.len()).max_by(|a, b| share(&doubts[*a]).total_cmp(&share(&doubts[*b])));
            let Some(worst) = worst else { break };
            let Cell { panel, middle, mut half, axis, .. } = cells.swap_remove(worst);
            half[axis] *= 0.5;
            for sign in [-1.0, 1.0] {
                let mut middle = middle;
                middle[axis] += sign * half[axis];
                cells.push(self.cell(&cap, (panel, middle, half, 1 - axis), from)?);
            }
        }
        for (k, (weight, error)) in weights.iter_mut().zip(errors).enumerate() {
            *weight += cells.iter().map(|c| c.weights[k]).sum::<f64>();
            *error += claimed(cells.iter().map(|c| c.apart[k]));
            *error += cells.iter().map(|c| c.rounding[k]).sum::<f64>();
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
