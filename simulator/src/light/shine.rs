//! Earthshine and moonshine: sunlight that comes to the body by the Earth or the Moon.
//!
//! The Earth is a Lambert sphere lit by the Sun, of one reflectance ρ_E(λ) or of a table of them ([`super::earth`]): a point of its surface has the radiance
//! L = (ρ_E/π) E☉ cosθ☉, and the body sees the cap of it that lies above its own horizon (physics of the thesis, D.1, with the Sun's
//! angle at each point of the cap rather than one for all). The integral over the lit part of that cap is a sum over a few directions,
//! each of which is a collimated source for the exact engine, shadows and all. The Moon is one direction.
//!
//! The Earth is no Lambert sphere: clouds, oceans and snow make its reflectance anything from 0.1 to 0.8, so a mean of 0.30 is ± 50 %. That is
//! an error of the model, which the numbers here do not contain ([`EarthAlbedo::uncertainty`]).

use super::earth::cap::{LitCap, Piece, Rule};
use super::earth::{EarthAlbedo, GREY_NM};
use super::glint::{Face, Glint, Sky};
use super::{DirectionError, Effect, Evaluator, Globe, Lighting, Source, Term, View};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI};
use std::sync::Arc;
use sunglint_numerics::gauss;
use sunglint_radiometry::spectrum::{Factor, Quantity, Reflectance, Spectrum, SpectrumError};

pub use super::earth::{EARTH_ALBEDO, EARTH_UNCERTAINTY};

/// The Moon's geometric albedo in V (Allen, Astrophysical Quantities).
pub const MOON_GEOMETRIC_ALBEDO: f64 = 0.12;
/// Points along each side of a cell of the cap, of the rule that is believed and of the one it is held against.
const ORDERS: [usize; 2] = [3, 2];
/// Cells err in different ways: of their distances the root of the sum of squares counts, so many times, and never more than their sum.
const CLAIMED: f64 = 2.0;
/// Light that a cell may hide from both its rules (a glint, a slit of light): this, times the square of its share of the irradiance, of all earthshine. It says which cell
/// is halved and when that ends, and is no part of the claim.
const HIDDEN: f64 = 0.1;
/// A cell whose radius is more than so many times the width of a glint may have it between its points.
const NOTICED: f64 = 2.0;
/// So many widths from a cell a glint is none of its own.
const BEYOND: f64 = 1.5;
/// Cost of lighting one of the scene's facets alone, relative to its cost among all, and the least, relative to what all cost.
const ALONE: (f64, f64) = (2.0, 0.05);
/// Error allowed in earthshine, as a share of itself, as soon as some of the Sun is hidden by the Earth: there it may be all the light that is left. The Earth is known to half of its light.
const OF_ITSELF: f64 = 0.03;
/// Light that is less than this of what the body's facets would send if all of them were white and squarely lit is not looked for.
const FAINT: f64 = 1e-8;
/// Directions of an epoch at most: what is open then is in the stated error.
const MOST_ASKED: f64 = 1500.0;
/// Wavelengths at which earthshine is weighed beside sunlight.
const WEIGHED: usize = 8;
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
///
/// A body's edges, and what it shades of itself, make kinks in what it sends of each direction's light, so that no rule over the whole cap converges fast, and two
/// rules over all of it agree by chance. So the cap falls into cells, each with two rules; the cell whose rules are farthest apart is halved until what all of them
/// claim together is within the tolerance.
///
/// Reflections by flat glossy faces are too narrow for cells of the cap: they are summed over their microfacets, in cells of the same kind (`super::glint`), and flat mirrors send the radiance of
/// the one place that they mirror. As long as a cell is wide beside the glint of some other narrow lobe, all of that is open.
#[derive(Debug)]
pub struct Earthshine<'a> {
    evaluator: Evaluator<'a>,
    tolerance: f64,
    earth: Arc<EarthAlbedo>,
    /// ρ of each of the scene's weights at some wavelengths.
    own: Vec<[f64; WEIGHED]>,
    /// The Earth's mean albedo there.
    mean: [f64; WEIGHED],
    /// The same times the spectrum of each layer of the Earth: of each weight.
    rho: Vec<[f64; WEIGHED]>,
    rules: [Vec<(f64, f64)>; 2],
    room: Vec<f64>,
    area_m2: f64,
    asked: f64,
}

/// The middles of the first cells of a panel, or of a face's microfacets.
const QUARTERS: [[f64; 2]; 4] = [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]];

/// Returns the claimed error of cells whose rules are so far apart.
fn claimed(apart: impl Iterator<Item = f64>) -> f64 {
    let (sum, squares) = apart.fold((0.0, 0.0), |(s, q), a| (s + a, q + a * a));
    sum.min(CLAIMED * f64::sqrt(squares))
}

/// A cell by both rules.
#[derive(Debug)]
struct Cell {
    piece: Piece,
    /// Along which of its coordinates it is halved.
    axis: usize,
    weights: Vec<f64>,
    /// How far the two rules are apart, of each weight.
    apart: Vec<f64>,
    rounding: Vec<f64>,
    /// The glints that both may have missed, each with the cell's radiance.
    missed: Vec<(usize, f64)>,
    /// That of the cap, of which a cell of microfacets is no part.
    irradiance: f64,
    /// The light and what may be wrong with it at the wavelengths.
    light: [f64; WEIGHED],
    off: [f64; WEIGHED],
}

/// A glint, and what it brings for each unit of radiance.
#[derive(Debug)]
struct Bright {
    glint: Glint,
    weights: Vec<f64>,
    light: [f64; WEIGHED],
}

/// Inputs that cells are made from.
#[derive(Debug)]
struct Ground<'a> {
    cap: LitCap<'a>,
    faces: Vec<Face>,
    glints: Vec<Bright>,
    /// The Sun, and the observer.
    from: (DVec3, View),
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
/// The errors of [`terms`].
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

/// Largest difference allowed between a product of two tables and the line between its own rows.
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
    /// Earthshine on a scene, found within `tolerance` of all light that an epoch has in full sunlight, that which is scattered once among it, of an Earth that is the same
    /// everywhere ([`EARTH_ALBEDO`]); and, in the Earth's shadow and at its edge, within 3 % of itself.
    pub fn new(evaluator: Evaluator<'a>, tolerance: f64) -> Self {
        let rules = ORDERS.map(gauss::legendre);
        let (own, mean, rho, room) = Default::default();
        let earth = Arc::default();
        let area_m2 = evaluator.scene.facets.iter().map(|f| f.area).sum();
        let asked = 0.0;
        Self { evaluator, tolerance, earth, own, mean, rho, rules, room, area_m2, asked }
            .of(Arc::default())
    }

    /// The same of another Earth. Weights are those of all materials in the light of its first layer, then in that of the next, and so on: [`terms_of`].
    #[must_use]
    pub fn of(mut self, earth: Arc<EarthAlbedo>) -> Self {
        let spectra: Vec<_> = self.evaluator.scene.spectra().collect();
        let ends = spectra.iter().map(|s| s.range_nm());
        let (first, last) = ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or_default();
        let nm: [f64; WEIGHED] =
            std::array::from_fn(|k| first + (last - first) * (k as f64 + 0.5) / WEIGHED as f64);
        self.own = spectra.iter().map(|s| nm.map(|nm| s.at(nm))).collect();
        self.mean = nm.map(|nm| earth.mean_at(nm));
        let layers = nm.map(|nm| earth.factors(nm));
        let of_layer = |layer: usize| {
            let times = |rho: &[f64; WEIGHED]| std::array::from_fn(|k| layers[k][layer] * rho[k]);
            self.own.iter().map(times).collect::<Vec<_>>()
        };
        self.rho = (0..earth.layers()).flat_map(of_layer).collect();
        self.earth = earth;
        self
    }

    /// From how many directions the scene was lit so far: what it costs. Where faces were lit alone they count as their share.
    pub fn asked(&self) -> f64 {
        self.asked
    }

    /// A piece of the cap by both rules, or of a face's microfacets: these have the numbers after the cap's panels.
    fn cell(
        &mut self,
        ground: &Ground<'_>,
        piece: Piece,
        axis: usize,
    ) -> Result<Cell, DirectionError> {
        let n = self.rho.len();
        let [mut weights, mut apart, mut rounding, mut idle] = [(); 4].map(|()| vec![0.0; n]);
        let Ground { cap, from, .. } = ground;
        let face = piece.panel.checked_sub(cap.panels()).map(|number| &ground.faces[number]);
        let (mut irradiance, mut vague) = (0.0, 0.0);
        for (k, points) in self.rules.iter().enumerate() {
            let out = if k == 0 { (&mut weights, &mut rounding) } else { (&mut apart, &mut idle) };
            let (rule, cost) = match face {
                None => (cap.piece(&piece, points), 1.0),
                Some(face) => {
                    let (rule, wrong) = cap.seen(&piece, points, &|at| face.direction(at));
                    if k == 0 {
                        vague = wrong;
                    }
                    let all = self.evaluator.scene.report().facets.max(1) as f64;
                    let cost = (ALONE.0 * face.facets.len() as f64 / all).max(ALONE.1);
                    (rule, cost.min(1.0))
                }
            };
            self.asked += cost * rule.nodes.len() as f64;
            if face.is_none() {
                irradiance += rule.nodes.iter().map(|n| 0.5 * n.1).sum::<f64>();
            }
            let out = (&mut out.0[..], &mut out.1[..]);
            add_all(&mut self.evaluator, &rule, face, *from, &mut self.room, out)?;
        }
        apart.iter_mut().zip(&weights).for_each(|(a, w)| *a = (*a - w).abs() + vague * w.abs());
        let light = at_wavelengths(&weights, &self.rho);
        let mut off = at_wavelengths(&apart, &self.rho);
        let mut missed = Vec::new();
        if face.is_none() && !ground.glints.is_empty() {
            let span = cap.span(&piece);
            for (number, Bright { glint, light, .. }) in ground.glints.iter().enumerate() {
                // How many widths it is away, and what it has there at most.
                let away = (span.toward.angle_between(glint.toward) - span.radius_rad).max(0.0)
                    / glint.reach_rad;
                if span.radius_rad > NOTICED * glint.width_rad && away < BEYOND {
                    let radiance = span.radiance / (1.0 + away * away).powi(2);
                    missed.push((number, radiance));
                    let each = off.iter_mut().zip(light.iter().zip(&self.mean));
                    each.for_each(|(off, (light, mean))| *off += radiance * light * mean);
                }
            }
        }
        Ok(Cell { piece, axis, weights, apart, rounding, missed, irradiance, light, off })
    }

    /// Glints, as bright as they are.
    fn bright(
        &mut self,
        glints: Vec<Glint>,
        (sun, view): (DVec3, View),
    ) -> Result<Vec<Bright>, DirectionError> {
        let mut all = Vec::with_capacity(glints.len());
        for glint in glints {
            let mut weights = vec![0.0; self.own.len()];
            self.asked += 1.0;
            self.evaluator.direct_from(glint.toward, sun, view, &mut weights)?;
            weights.iter_mut().for_each(|w| *w *= glint.solid_angle);
            let light = at_wavelengths(&weights, &self.own);
            all.push(Bright { glint, weights, light });
        }
        Ok(all)
    }

    /// The cells of an epoch, halved until what they may be off together is little beside `sunlight`, and at most the share `of_itself` of themselves.
    fn cells(
        &mut self,
        ground: &Ground<'_>,
        sunlight: &[f64; WEIGHED],
        of_itself: f64,
    ) -> Result<Vec<Cell>, DirectionError> {
        let most = self.asked + MOST_ASKED;
        let mut cells = Vec::new();
        for panel in 0..ground.cap.panels() + ground.faces.len() {
            let face = panel.checked_sub(ground.cap.panels()).map(|number| &ground.faces[number]);
            for middle in QUARTERS {
                let quarter = Piece { panel, middle, half: [0.5, 0.5] };
                if face.is_some_and(|face| !face.is_within) {
                    // An edge of the light crosses the lobe: two rules that are as coarse as quarters agree by chance.
                    for half in quarter.halves(0) {
                        for piece in half.halves(1) {
                            cells.push(self.cell(ground, piece, 0)?);
                        }
                    }
                } else {
                    cells.push(self.cell(ground, quarter, 0)?);
                }
            }
        }
        loop {
            let of_cap = |f: &dyn Fn(&Cell) -> f64| {
                cells.iter().filter(|c| c.irradiance > 0.0).map(f).sum::<f64>()
            };
            let irradiance = of_cap(&|c| c.irradiance);
            let of_rest: [f64; WEIGHED] = std::array::from_fn(|k| of_cap(&|c| c.light[k]));
            let doubt = |c: &Cell| -> [f64; WEIGHED] {
                let share = if c.irradiance > 0.0 { c.irradiance / irradiance } else { 0.0 };
                let hidden = HIDDEN * share * share;
                std::array::from_fn(|k| c.off[k] + hidden * of_rest[k])
            };
            let doubts: Vec<_> = cells.iter().map(doubt).collect();
            let left = std::array::from_fn(|k| claimed(doubts.iter().map(|d| d[k])));
            // As long as all of it may have been missed it is as bright as the worst cell's doubt.
            let earthlight: [f64; WEIGHED] = std::array::from_fn(|k| {
                let found: f64 = cells.iter().map(|c| c.light[k]).sum();
                doubts.iter().map(|d| d[k]).fold(found, f64::max)
            });
            // How far off, of what it may be, at the wavelength where that is most.
            let share = |off: &[f64; WEIGHED]| {
                let faint = FAINT * FRAC_1_PI * self.area_m2 * irradiance;
                let may =
                    |(s, e): (&f64, &f64)| (self.tolerance * (s + e)).min(of_itself * e).max(faint);
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
            let Cell { piece, axis, .. } = cells.swap_remove(worst);
            for half in piece.halves(axis) {
                cells.push(self.cell(ground, half, 1 - axis)?);
            }
        }
        Ok(cells)
    }
}

/// Σ ρ|W| at each of the wavelengths.
fn at_wavelengths(weights: &[f64], rho: &[[f64; WEIGHED]]) -> [f64; WEIGHED] {
    let mut sums = [0.0; WEIGHED];
    for (w, rho) in weights.iter().zip(rho) {
        sums.iter_mut().zip(rho).for_each(|(sum, rho)| *sum += rho * w.abs());
    }
    sums
}

impl<'a> Moonshine<'a> {
    /// Moonshine on a scene.
    pub fn new(evaluator: Evaluator<'a>) -> Self {
        Self { evaluator, room: Vec::new() }
    }
}

/// Adds to `weights` and `errors` what comes from some directions, layer by layer: of all the scene, or of a face's lobe alone.
fn add_all(
    evaluator: &mut Evaluator<'_>,
    rule: &Rule,
    face: Option<&Face>,
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
        let relative = match face {
            None => evaluator.direct_from(toward, sun, view, room)?.error,
            Some(face) => evaluator.face_from(face, toward, (sun, view), room)?,
        };
        let rows = weights.chunks_exact_mut(each).zip(errors.chunks_exact_mut(each));
        for ((weights, errors), light) in rows.zip(rule.lights(i)) {
            for ((weight, error), w) in weights.iter_mut().zip(errors).zip(&*room) {
                *weight += light * w;
                *error += (light * w).abs() * relative;
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
        if cap.panels() == 0 {
            return Ok(());
        }
        let from = (lighting.sun_body, lighting.view);
        let mut sunlight = vec![0.0; self.own.len()];
        self.evaluator.direct(lighting.sun_body, lighting.view, &mut sunlight)?;
        let sunlight = at_wavelengths(&sunlight, &self.own);
        let of_itself = if lighting.sunlit < 1.0 { OF_ITSELF } else { f64::INFINITY };
        let shines = |toward| !cap.radiance(toward).is_empty();
        let radius_rad = (globe.radius_m / globe.distance_m).min(1.0).asin();
        let sky = Sky { shines: &shines, radius_rad };
        let mirroring = self.evaluator.mirroring(from.0, from.1, &sky)?;
        let mut ground = Ground { cap, faces: mirroring.faces, glints: Vec::new(), from };
        self.evaluator.leave_out(&ground.faces);
        self.evaluator.watch(true);
        let cells = self.bright(mirroring.glints, from).and_then(|glints| {
            ground.glints = glints;
            self.cells(&ground, &sunlight, of_itself)
        });
        self.evaluator.watch(false);
        self.evaluator.leave_out(&[]);
        let cells = cells?;
        let brightest = earth.grid().map_or(1.0, |grid| grid.range().1);
        for (k, (weight, error)) in weights.iter_mut().zip(&mut *errors).enumerate() {
            // Of a table the points may have light below 0, and where a body is turned away from all that is bright what is left of them, too; there is none of it.
            *weight += cells.iter().map(|c| c.weights[k]).sum::<f64>().max(0.0);
            *error += claimed(cells.iter().map(|c| c.apart[k]));
            *error += cells.iter().map(|c| c.rounding[k]).sum::<f64>();
            for (number, glint) in ground.glints.iter().enumerate() {
                // It lies in one cell, though several are near.
                let missed = cells.iter().flat_map(|c| &c.missed).filter(|m| m.0 == number);
                let radiance = missed.map(|m| m.1).fold(0.0, f64::max);
                *error += brightest * radiance * glint.weights[k % self.own.len()];
            }
        }
        let radiance = |toward| ground.cap.radiance(toward);
        let out = (weights, errors);
        self.asked += ALONE.1 * self.evaluator.add_mirrors(from, &radiance, out)? as f64;
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
        let irradiance = moonlight(moon);
        let rule = Rule::of_one(moon.toward, irradiance);
        let from = (lighting.sun_body, lighting.view);
        let out = (&mut *weights, &mut *errors);
        add_all(&mut self.evaluator, &rule, None, from, &mut self.room, out)?;
        // To a flat mirror its disc is as bright all over.
        let sine = (moon.radius_m / moon.distance_m).min(1.0);
        let radiance = |toward: DVec3| {
            let is_on_disc = toward.angle_between(moon.toward) < sine.asin();
            if is_on_disc { vec![irradiance / (PI * sine * sine)] } else { Vec::new() }
        };
        self.evaluator.add_mirrors(from, &radiance, (weights, errors))?;
        Ok(())
    }
}

/// A spectrum of 1 at all wavelengths.
pub(super) fn grey() -> Result<Spectrum<Reflectance>, SpectrumError> {
    Spectrum::constant(1.0, GREY_NM.0, GREY_NM.1)
}
