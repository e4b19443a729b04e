//! Light that a scene sends under the Sun's disc: facet by facet, sphere by sphere.

use super::Sun;
use super::average::Averager;
use super::cut::{Cut, Disc, Left};
use super::profile::PROFILES;
use crate::light::View;
use crate::light::curved::Light;
use crate::light::curved::ring::add_near_ball;
use crate::light::effect::Lighting;
use crate::light::evaluate::{COVERING, Direct, DirectionError, Evaluator, GRAZING};
use crate::light::near;
use crate::light::occlude::{Toward, toward, unit};
use crate::surface::Material;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI};

/// A sphere is taken as far away where that changes less of its light than this many times what the quadrature of a facet may be off by: a fiftieth of the tolerance of a pass.
const FAR_ENOUGH: f64 = 20.0;
/// Error of the areas at five places, as a share of the range that they span.
const OPEN: f64 = 0.02;

/// Room to average in.
#[derive(Debug, Default)]
pub struct Room {
    averager: Averager,
    /// Greatest distance of anything from anything, m.
    extent_m: f64,
}

/// Curved surface of a scene.
#[derive(Debug, Clone, Copy)]
enum Bent {
    /// A triangle with normals.
    Triangle(usize),
    /// A curved part.
    Round(usize),
}

/// Sun and observer at one moment.
struct Now<'a> {
    disc: Disc,
    earth: Option<Cut>,
    eye: Toward,
    sun: &'a Sun,
}

impl Evaluator<'_> {
    /// Sets `weights` to W_k \[m² sr⁻¹\] before each of [`Scene::terms`](crate::light::Scene::terms), and `errors` to how far each may be
    /// off (absolute). The Sun's disc is averaged over where the scene was made with one and `sun_radius_rad` is not 0; a flat mirror sends
    /// nothing without. Where the lighting has a shadow it is in the weights: of a collimated Sun all or nothing. Hinged parts turn to the
    /// middle of the Sun. E(λ) is the irradiance of the whole Sun on a plane across the direction to its middle.
    ///
    /// # Errors
    /// A direction that is none, rows of another length than [`Scene::term_count`](crate::light::Scene::term_count).
    pub fn light(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        self.check(weights, self.scene.term_count())?;
        self.check(errors, self.scene.term_count())?;
        let middle = unit("the direction of the Sun", lighting.sun_body)?;
        let eye = toward(lighting.view)?;
        weights.fill(0.0);
        errors.fill(0.0);
        self.work.done = Direct::default();
        let sine = lighting.sun_radius_rad.sin();
        let sun = self.scene.sun.as_ref().filter(|_| sine > 0.0);
        // The disc's axes: any, the same for all facets.
        let disc = Disc::new(middle, middle.any_orthonormal_vector(), sine.max(1e-12));
        let cut = lighting.shadow.map(|earth| {
            Cut::globe(&disc, earth.toward, (earth.radius_m / earth.distance_m).asin())
        });
        let earth = match cut.map(|c| (c, c.left())) {
            None | Some((_, Left::All)) => None,
            Some((_, Left::Nothing)) => return Ok(self.work.done),
            Some((cut, Left::Part)) => Some(cut),
        };
        self.turn(middle);
        match sun {
            Some(sun) if self.scene.large.is_some() && self.is_broad(sine) => {
                self.sampled_under(&Now { disc, earth, eye, sun }, lighting.view, weights, errors)?;
            }
            Some(sun) => self.under(&Now { disc, earth, eye, sun }, weights, errors),
            None => self.collimated(middle, eye, lighting.view, weights, errors)?,
        }
        let (total, error): (f64, f64) =
            (weights.iter().map(|w| w.abs()).sum(), errors.iter().sum());
        let mut done = self.work.done;
        done.error = if total > 0.0 { error / total + 1e-15 } else { 0.0 };
        Ok(done)
    }

    /// Computes the weights of [`Evaluator::direct`], with the errors of each weight.
    fn collimated(
        &mut self,
        sun: DVec3,
        eye: Toward,
        view: View,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        if self.scene.large.is_some() {
            let count = self.scene.weight_count();
            self.sum(sun, sun, view, 0, &mut weights[..count])?;
            errors[..count].copy_from_slice(&self.errors);
            return Ok(());
        }
        self.sort(sun, eye);
        let count = self.scene.weight_count();
        for i in 0..self.scene.facets.len() {
            let facet = &self.scene.facets[i];
            let range = self.scene.weights_of(facet.material as usize);
            let error = match facet.patch {
                None => self.facet(i, sun, eye, 0, &mut weights[..count]),
                Some(patch) => self.bent(i, patch as usize, sun, eye, 0, &mut weights[..count]),
            };
            errors[range.start] += error + self.covering(i);
        }
        for k in 0..self.scene.rounds.len() {
            let range = self.scene.weights_of(self.scene.rounds[k].material as usize);
            let (values, errors) = (&mut weights[range.clone()], &mut errors[range]);
            self.round(k, Light { sun, eye }, values, errors);
        }
        Ok(())
    }

    /// Whether all lobes are so wide against the disc that its middle stands for it in a sampled scene.
    fn is_broad(&self, sine: f64) -> bool {
        let Some(large) = &self.scene.large else { return false };
        let open = |m: &Material| middle_alone(m, sine);
        self.scene.materials.iter().all(|m| open(m) <= 0.1 * large.sampling.tolerance)
    }

    /// A sampled scene under the disc: from its middle; of a partly hidden disc the share that is left, from where its light comes on the average.
    fn sampled_under(
        &mut self,
        now: &Now<'_>,
        view: View,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        let scene = self.scene;
        let mut plain = vec![0.0; scene.weight_count()];
        let (spot, _) = self.disc.averager.rest(now.earth);
        self.sum(now.disc.direction(spot), now.disc.middle, view, 0, &mut plain)?;
        let share =
            now.earth.map_or([1.0, 0.0, 0.0, 0.0, 0.0], |cut| super::rings::fractions(&[cut]));
        for (number, material) in scene.materials.iter().enumerate() {
            let range = scene.weights_of(number);
            let open = middle_alone(material, now.disc.sine);
            for k in range.clone() {
                errors[k] += share[0] * (self.errors[k] + open * plain[k].abs());
            }
            let row = &plain[range];
            let rows: Vec<f64> =
                share.iter().flat_map(|s| row.iter().map(move |v| s * v)).collect();
            self.take(now, number, &rows, 1.0, 0.0, 0.0, weights, errors);
        }
        Ok(())
    }

    fn under(&mut self, now: &Now<'_>, weights: &mut [f64], errors: &mut [f64]) {
        let places = self.now.middle.iter().zip(&self.radii);
        let reach = places.map(|(m, r)| m.length() + r).fold(0.0, f64::max);
        self.disc.extent_m = 2.0 * reach;
        let widened = now.disc.sine * self.disc.extent_m;
        self.radii.iter_mut().for_each(|r| *r += widened);
        self.sort(now.disc.middle, now.eye);
        self.radii.iter_mut().for_each(|r| *r -= widened);
        for i in 0..self.scene.facets.len() {
            match self.scene.facets[i].patch {
                None => self.facet_under(now, i, weights, errors),
                Some(_) => self.curved_under(now, Bent::Triangle(i), weights, errors),
            }
        }
        self.work.margin_m = 0.0;
        for number in 0..self.scene.rounds.len() {
            match self.scene.rounds[number].sphere {
                Some(radius) => self.ball_under(now, number, radius, weights, errors),
                None => self.curved_under(now, Bent::Round(number), weights, errors),
            }
        }
    }

    /// Adds a curved surface that is no sphere: by the middle of the disc, or by four places with the disc's second moments where the material needs it. A
    /// curved surface turns its lobe past the disc by itself, so that more is not asked of it; what four places differ from one is the scale of the
    /// error. Of a partly hidden disc the share that is left counts, from where its light comes on the average.
    fn curved_under(&mut self, now: &Now<'_>, what: Bent, weights: &mut [f64], errors: &mut [f64]) {
        let scene = self.scene;
        let number = match what {
            Bent::Triangle(i) => scene.facets[i].material,
            Bent::Round(k) => scene.rounds[k].material,
        } as usize;
        let count = scene.materials[number].spectra().len();
        let share =
            now.earth.map_or([1.0, 0.0, 0.0, 0.0, 0.0], |cut| super::rings::fractions(&[cut]));
        let (mut values, mut open) = (vec![0.0; count], vec![0.0; count]);
        let (spot, spread) = self.disc.averager.rest(now.earth);
        self.curved_towards(now, what, now.disc.direction(spot), &mut values, &mut open);
        // What is left to a phase angle of 180°, about: there light falls off as its third power (`engine::disc`).
        let place = match what {
            Bent::Triangle(i) => self.now.origin[i],
            Bent::Round(k) => self.now.place[k].point(scene.rounds[k].middle),
        };
        let left = (now.disc.middle + now.eye.from(place)).length().max(now.disc.sine);
        let relative = middle_alone(&scene.materials[number], now.disc.sine)
            .max((now.disc.sine / left).powi(2));
        if relative > now.sun.options.tolerance {
            let reach = std::f64::consts::SQRT_2;
            let mut mean = vec![0.0; count];
            for step in [spread[0], -spread[0], spread[1], -spread[1]] {
                let place = spot + reach * step;
                let mut one = vec![0.0; count];
                self.curved_towards(now, what, now.disc.direction(place), &mut one, &mut open);
                let scale = 0.25 / now.disc.cosine(place);
                mean.iter_mut().zip(&one).for_each(|(m, v)| *m += scale * v);
            }
            for ((value, mean), open) in values.iter_mut().zip(&mean).zip(&mut open) {
                *open = 0.2 * *open + (*value - mean).abs() * relative.min(1.0);
                *value = *mean;
            }
        } else {
            open.iter_mut().zip(&values).for_each(|(o, v)| *o += relative * v.abs());
        }
        let from = scene.weights_of(number).start;
        open.iter().enumerate().for_each(|(k, o)| errors[from + k] += share[0] * o);
        let rows: Vec<f64> = share.iter().flat_map(|s| values.iter().map(move |v| s * v)).collect();
        self.take(now, number, &rows, 1.0, 0.0, 0.0, weights, errors);
    }

    fn curved_towards(
        &mut self,
        now: &Now<'_>,
        what: Bent,
        sun: DVec3,
        values: &mut [f64],
        open: &mut [f64],
    ) {
        match what {
            Bent::Round(k) => self.round(k, Light { sun, eye: now.eye }, values, open),
            Bent::Triangle(i) => {
                let facet = &self.scene.facets[i];
                let Some(patch) = facet.patch else { return };
                let range = self.scene.weights_of(facet.material as usize);
                let mut all = vec![0.0; self.scene.weight_count()];
                open[0] += self.bent(i, patch as usize, sun, now.eye, 0, &mut all);
                values.iter_mut().zip(&all[range]).for_each(|(v, a)| *v += a);
            }
        }
    }

    /// Returns the error of a facet by faces of several parts in one plane.
    fn covering(&self, i: usize) -> f64 {
        let open = if self.scene.covers { COVERING * FRAC_1_PI } else { 0.0 };
        open * self.scene.facets[i].area
    }

    fn facet_under(&mut self, now: &Now<'_>, i: usize, weights: &mut [f64], errors: &mut [f64]) {
        let scene = self.scene;
        let facet = &scene.facets[i];
        let (normal, u, v) = (self.now.normal[i], self.now.tangent[i], self.now.bitangent[i]);
        let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), normal.dot(d));
        let origin = self.now.origin[i];
        let to = local(now.eye.from(origin));
        if to.z <= GRAZING || normal.dot(now.disc.middle) <= -now.disc.sine {
            return;
        }
        let number = facet.material as usize;
        let material = &scene.materials[number];
        let disc = Disc {
            middle: local(now.disc.middle),
            u: local(now.disc.u),
            v: local(now.disc.v),
            sine: now.disc.sine,
        };
        let tolerance = now.sun.options.tolerance;
        self.disc.averager.facet(material, &disc, to, now.earth, tolerance);
        let far = matches!(now.eye, Toward::Far(_));
        let (light, open) = (self.disc.averager.sums.grey(), self.disc.averager.error);
        if far && light == 0.0 {
            errors[scene.weights_of(number).start] += facet.area * to.z * open;
            return;
        }
        self.work.done.facets += 1;
        let (spot, spread) = self.disc.averager.spot();
        let (area, area_error) = self.lit_area(now, i, spot, spread);
        let from = scene.weights_of(number).start;
        errors[from] += self.covering(i);
        if let Toward::Near(q) = now.eye {
            let share = area_error / area.max(1e-300);
            let (sums, error) = self.facet_near(now, i, &disc, q);
            self.take(now, number, &sums, 1.0, error, share, weights, errors);
            return;
        }
        let values = std::mem::take(&mut self.disc.averager.sums.values);
        let scale = area * to.z;
        let share = area_error / area.max(1e-300);
        if area > 0.0 {
            self.take(now, number, &values, scale, scale * open, share, weights, errors);
        } else {
            errors[from] += area_error * to.z * light;
        }
        self.disc.averager.sums.values = values;
    }

    /// Adds values before each profile to a material's weights; `error` of their sum in m² sr⁻¹ and `share` of each.
    #[expect(clippy::too_many_arguments, reason = "rows in, rows out")]
    fn take(
        &self,
        now: &Now<'_>,
        number: usize,
        values: &[f64],
        scale: f64,
        error: f64,
        share: f64,
        weights: &mut [f64],
        errors: &mut [f64],
    ) {
        let grey = self.scene.weights_of(number);
        let all: f64 = values.iter().map(|v| v.abs()).sum();
        for profile in 0..PROFILES {
            let row = &values[profile * grey.len()..(profile + 1) * grey.len()];
            let terms = self.scene.terms_of(number, profile);
            for (k, value) in row.iter().enumerate() {
                let value = scale * value;
                let part = if all > 0.0 { (value / (scale * all)).abs() } else { 0.0 };
                match &terms {
                    Some(range) => {
                        weights[range.start + k] += value;
                        errors[range.start + k] += share * value.abs() + error * part;
                    }
                    // Without a term for it the tint is an error.
                    None => errors[grey.start + k] += now.sun.largest[profile] * value.abs(),
                }
            }
        }
    }

    /// The lit and seen area of a facet, averaged over where its light comes from, and its error.
    fn lit_area(&mut self, now: &Now<'_>, i: usize, spot: DVec2, spread: [DVec2; 2]) -> (f64, f64) {
        let facet = &self.scene.facets[i];
        if self.scene.report().no_occlusion {
            return (facet.area, 0.0);
        }
        let normal = self.now.normal[i];
        // Within the disc, and above the facet.
        let mut place = spot.clamp_length_max(1.0);
        let mut towards = now.disc.direction(place);
        if normal.dot(towards) <= GRAZING {
            place = DVec2::new(normal.dot(now.disc.u), normal.dot(now.disc.v)).normalize_or_zero();
            towards = now.disc.direction(place);
        }
        let cos = normal.dot(towards).max(now.disc.sine);
        let widened = now.disc.sine * self.disc.extent_m / (cos * cos);
        self.work.margin_m = widened.min(self.disc.extent_m);
        let size = (facet.area, facet.radius);
        let middle = self.area_towards(i, towards, now.eye);
        let edge = self.scene.touching_m.max(1e-15 * size.1);
        let rounding = 1e-15 * size.0 + 1e-4 * edge * size.1;
        if !self.work.shaded || spread[0].length() < 1e-6 {
            return (middle, if middle < size.0 { rounding } else { 0.0 });
        }
        let (mut sum, mut low, mut high) = (0.5 * middle, middle, middle);
        let done = self.work.done;
        for step in [spread[0], -spread[0], spread[1], -spread[1]] {
            let at = (place + 2.0 * step).clamp_length_max(1.0);
            let towards = now.disc.direction(at);
            let area = if normal.dot(towards) > GRAZING {
                self.area_towards(i, towards, now.eye)
            } else {
                middle
            };
            sum += 0.125 * area;
            (low, high) = (low.min(area), high.max(area));
        }
        self.work.done = done;
        // What is kept is that of the middle again, for whoever wants its pieces.
        if matches!(now.eye, Toward::Near(_)) {
            self.area_towards(i, towards, now.eye);
        }
        (sum, (sum - middle).abs() + OPEN * (high - low) + rounding)
    }

    fn area_towards(&mut self, i: usize, sun: DVec3, eye: Toward) -> f64 {
        let outline = self.scene.outlines.get(i);
        if self.visible(i, sun, eye) {
            self.work.kept.area()
        } else {
            self.work.kept.clear();
            self.work.kept.push(outline);
            self.scene.facets[i].area
        }
    }

    /// A facet seen from a point: the average over the disc at each point of it. Gives values and the error of their sum, m² sr⁻¹.
    fn facet_near(&mut self, now: &Now<'_>, i: usize, disc: &Disc, eye: DVec3) -> (Vec<f64>, f64) {
        let scene = self.scene;
        let facet = &scene.facets[i];
        let material = &scene.materials[facet.material as usize];
        let (normal, u, v) = (self.now.normal[i], self.now.tangent[i], self.now.bitangent[i]);
        let rel = eye - self.now.origin[i];
        let at = DVec3::new(rel.dot(u), rel.dot(v), rel.dot(normal));
        let tolerance = now.sun.options.tolerance;
        let averager = &mut self.disc.averager;
        // What is averaged is as wide as the disc or the lobe, whichever is wider.
        let width = disc.sine.max(near::width(&material.width()));
        let mut open = 0.0_f64;
        let mut weigh = |to: DVec3, scale: f64, out: &mut [f64]| {
            averager.facet(material, disc, to, now.earth, tolerance);
            open = open.max(averager.error / averager.sums.grey().max(1e-300));
            out.iter_mut().zip(&averager.sums.values).for_each(|(o, v)| *o += scale * v);
        };
        let mut task = near::Task {
            weigh: &mut weigh,
            tolerance: tolerance.max(near::TOLERANCE).max(material.grain()),
            longest_m: 0.5 * width * rel.length(),
            smooth_m: near::smooth_m(width, disc.middle, at),
            at,
            range_squared: eye.length_squared(),
            facet_area: facet.area,
        };
        let mut out = vec![0.0; PROFILES * material.spectra().len()];
        let whole = scene.report().no_occlusion;
        let error = if whole {
            self.near.add(&mut task, scene.outlines.get(i), 1.0, &mut out)
        } else {
            self.work.kept.iter().map(|p| self.near.add(&mut task, p, 1.0, &mut out)).sum()
        };
        let all: f64 = out.iter().map(|v| v.abs()).sum();
        (out, error + open.min(1.0) * all)
    }

    fn ball_under(
        &mut self,
        now: &Now<'_>,
        number: usize,
        radius: f64,
        weights: &mut [f64],
        errors: &mut [f64],
    ) {
        let scene = self.scene;
        let round = &scene.rounds[number];
        let material = &scene.materials[round.material as usize];
        let mut plain = vec![0.0; material.spectra().len()];
        let mut own = plain.clone();
        let light = Light { sun: now.disc.middle, eye: now.eye };
        let free = self.round_is_free(number, light);
        let far = matches!(now.eye, Toward::Far(_));
        if free && !far && !material.is_mirror() {
            // The phase angles of the disc are all that is asked for.
            self.work.done.round += 1;
        } else {
            self.round(number, light, &mut plain, &mut own);
        }
        let mut error: f64 = own.iter().sum();
        let middle = self.now.place[number].point(round.middle);
        let to = now.eye.from(middle);
        let (nearness, away) = match now.eye {
            Toward::Far(_) => (1.0, None),
            Toward::Near(q) => {
                let square = (q - middle).length_squared();
                (q.length_squared() / square, Some((square.sqrt() / radius).max(1.0)))
            }
        };
        let scale = radius * radius * nearness;
        let averager = &mut self.disc.averager;
        let tolerance = now.sun.options.tolerance;
        // A mirror's image is taken as that of the middle's distance, of which its errors know.
        let away = away.filter(|_| !material.is_mirror());
        let phase = now.disc.middle.angle_between(to) + now.disc.sine;
        // From far enough away the sphere is as bright as it is at infinity.
        let as_far = away.map_or(0.0, |away| distance_matters(material, phase, away));
        let away = away.filter(|_| as_far > FAR_ENOUGH * self.near.tolerance);
        let as_far = if away.is_none() { as_far } else { 0.0 };
        let last = away.map_or(PI, |away| FRAC_PI_2 + away.recip().acos());
        let mut of = |phase: f64, out: &mut [f64]| match away {
            None => scene.add_sphere(round.material, phase, 1.0, out),
            Some(away) => add_near_ball(material, phase, away, out),
        };
        let room = (plain.len(), last);
        let full = averager.sphere(room, &now.disc, to, now.earth, tolerance, &mut of);
        // The share that is left, found towards the middle of the Sun, holds for all of it.
        let left: f64 = plain.iter().sum();
        let whole = scale * full;
        let share = if whole > 0.0 && !free { (left / whole).min(1.0) } else { 1.0 };
        let averager = &mut self.disc.averager;
        let values = std::mem::take(&mut averager.sums.values);
        let all: f64 = scale * values.iter().map(|v| v.abs()).sum::<f64>();
        let open = scale * averager.error + as_far * all;
        if !free {
            // A strip of a disc as deep as the penumbra is wide; of a shadow's edge across, only its bend counts.
            let depth = (now.disc.sine * self.disc.extent_m / radius).min(1.0);
            let edge = share > 1e-9 && share < 1.0 - 1e-9;
            error += all * if edge { depth * depth } else { depth.powf(1.5) };
        }
        let number = round.material as usize;
        self.take(now, number, &values, scale * share, error + open, 0.0, weights, errors);
        if share == 0.0 {
            errors[scene.weights_of(number).start] += error + open;
        }
        self.disc.averager.sums.values = values;
    }
}

/// The share of a sphere's light that the observer's distance, in radii, may change at a phase angle. Times the distance it is the same at 100 and 10⁴ radii (by integration, of Lambert light and lobes of
/// 0.01 to 0.3): 1 at most up to 90°, and 3.6 over the angle that is left to 180° beyond, since the light of the crescent is its width to the third power.
fn distance_matters(material: &Material, phase: f64, away: f64) -> f64 {
    let narrow = match material.width() {
        crate::surface::Width::Other(width) => width.recip().max(1.0),
        _ => 1.0,
    };
    narrow * (1.0 + 4.0 / (PI - phase).max(1e-9)) / away
}

/// Estimates the relative error of the middle of the disc alone: (δ/α)² of a lobe is several times what its middle differs by
/// (physics of the disc: (δ²/8)∇²f/f), for its wings.
fn middle_alone(material: &Material, sine: f64) -> f64 {
    match material.width() {
        crate::surface::Width::Even => 0.25 * sine * sine,
        crate::surface::Width::Lobe { lobe, .. } => (sine / lobe.narrowest()).powi(2),
        crate::surface::Width::Other(width) => (2.0 * sine / width).powi(2),
        crate::surface::Width::Mirror(_) => 1.0,
    }
}
