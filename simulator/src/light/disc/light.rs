//! What a scene sends under the Sun's disc: facet by facet, sphere by sphere.

use super::Sun;
use super::average::Averager;
use super::cut::{Cut, Disc, Left};
use super::profile::PROFILES;
use crate::light::effect::Lighting;
use crate::light::evaluate::{COVERING, Direct, DirectionError, Evaluator, GRAZING};
use crate::light::near;
use crate::light::occlude::{Toward, toward, unit};
use glam::{DVec2, DVec3};
use std::f64::consts::FRAC_1_PI;

/// What the areas at five places leave open of the range that they span.
const OPEN: f64 = 0.02;

/// Room to average in.
#[derive(Debug, Default)]
pub struct Room {
    averager: Averager,
    plain: Vec<f64>,
    /// As far as anything is from anything, m.
    extent_m: f64,
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
    /// nothing without. Where the lighting has an Earth its shadow is in the weights: of a collimated Sun all or nothing. Hinged parts turn to the
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
        let cut = lighting.earth.map(|earth| {
            Cut::globe(&disc, earth.toward, (earth.radius_m / earth.distance_m).asin())
        });
        let earth = match cut.map(|c| (c, c.left())) {
            None | Some((_, Left::All)) => None,
            Some((_, Left::Nothing)) => return Ok(self.work.done),
            Some((cut, Left::Part)) => Some(cut),
        };
        self.turn(middle);
        match sun {
            Some(sun) => self.under(&Now { disc, earth, eye, sun }, weights, errors),
            None => self.collimated(middle, eye, weights, errors),
        }
        let (total, error): (f64, f64) =
            (weights.iter().map(|w| w.abs()).sum(), errors.iter().sum());
        let mut done = self.work.done;
        done.error = if total > 0.0 { error / total + 1e-15 } else { 0.0 };
        Ok(done)
    }

    /// As [`Evaluator::direct`], with the errors of each weight.
    fn collimated(&mut self, sun: DVec3, eye: Toward, weights: &mut [f64], errors: &mut [f64]) {
        if self.scene.pairs.is_none() {
            self.index(sun, eye);
        }
        let count = self.scene.weight_count();
        let usual = self.usual();
        for i in 0..usual {
            let error = self.facet(i, sun, eye, 0, &mut weights[..count]);
            let material = self.scene.facets[i].material as usize;
            errors[self.scene.weights_of(material).start] += error + self.covering(i);
        }
        for ball in 0..self.scene.spheres.len() {
            let range = self.scene.weights_of(self.scene.spheres[ball].material as usize);
            let mut plain = std::mem::take(&mut self.disc.plain);
            plain.clear();
            plain.resize(count, 0.0);
            errors[range.start] += self.ball(ball, sun, eye, 0, &mut plain);
            weights[range.clone()].iter_mut().zip(&plain[range]).for_each(|(w, p)| *w += p);
            self.disc.plain = plain;
        }
    }

    fn under(&mut self, now: &Now<'_>, weights: &mut [f64], errors: &mut [f64]) {
        let places = self.now.middle.iter().zip(&self.radii);
        let reach = places.map(|(m, r)| m.length() + r).fold(0.0, f64::max);
        self.disc.extent_m = 2.0 * reach;
        let widened = now.disc.sine * self.disc.extent_m;
        if self.scene.pairs.is_none() {
            self.radii.iter_mut().for_each(|r| *r += widened);
            self.index(now.disc.middle, now.eye);
            self.radii.iter_mut().for_each(|r| *r -= widened);
        }
        for i in 0..self.usual() {
            self.facet_under(now, i, weights, errors);
        }
        self.work.margin_m = 0.0;
        for number in 0..self.scene.spheres.len() {
            self.ball_under(now, number, weights, errors);
        }
    }

    /// How many facets stand for themselves.
    fn usual(&self) -> usize {
        self.scene.spheres.first().map_or(self.scene.facets.len(), |s| s.facets.start)
    }

    /// What faces of several parts in one plane leave open.
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
        if self.work.visible(self.scene, &self.now, i, sun, eye, outline) {
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
        let narrow = !matches!(material.width(), crate::surface::Width::Even);
        let mut open = 0.0_f64;
        let mut weigh = |to: DVec3, scale: f64, out: &mut [f64]| {
            averager.facet(material, disc, to, now.earth, tolerance);
            open = open.max(averager.error / averager.sums.grey().max(1e-300));
            out.iter_mut().zip(&averager.sums.values).for_each(|(o, v)| *o += scale * v);
        };
        let mut task = near::Task {
            weigh: &mut weigh,
            tolerance: tolerance.max(near::TOLERANCE),
            longest_m: if narrow { 0.5 * disc.sine * rel.length() } else { f64::INFINITY },
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
        weights: &mut [f64],
        errors: &mut [f64],
    ) {
        let scene = self.scene;
        let ball = &scene.spheres[number];
        let count = scene.weight_count();
        let mut plain = std::mem::take(&mut self.disc.plain);
        plain.clear();
        plain.resize(count, 0.0);
        let mut error = self.ball(number, now.disc.middle, now.eye, 0, &mut plain);
        let material = &scene.materials[ball.material as usize];
        let middle = self.now.middle[ball.occluder];
        let to = now.eye.from(middle);
        let nearness = match now.eye {
            Toward::Far(_) => 1.0,
            Toward::Near(q) => q.length_squared() / (q - middle).length_squared(),
        };
        let scale = ball.radius * ball.radius * nearness;
        let range = scene.weights_of(ball.material as usize);
        let averager = &mut self.disc.averager;
        let tolerance = now.sun.options.tolerance;
        let full = averager.sphere(material, &now.disc, to, now.earth, tolerance);
        // The share that is left, found towards the middle of the Sun, holds for all of it.
        let left: f64 = plain[range].iter().sum();
        let whole = scale * full;
        let free = self.is_free(number, now.disc.middle, to);
        let share = if whole > 0.0 && !free { (left / whole).min(1.0) } else { 1.0 };
        let averager = &mut self.disc.averager;
        let values = std::mem::take(&mut averager.sums.values);
        let all: f64 = scale * values.iter().map(|v| v.abs()).sum::<f64>();
        let open = scale * averager.error;
        if !free {
            // A strip of a disc as deep as the penumbra is wide; of a shadow's edge across, only its bend counts.
            let depth = (now.disc.sine * self.disc.extent_m / ball.radius).min(1.0);
            let edge = share > 1e-9 && share < 1.0 - 1e-9;
            error += all * if edge { depth * depth } else { depth.powf(1.5) };
        }
        let number = ball.material as usize;
        self.take(now, number, &values, scale * share, error + open, 0.0, weights, errors);
        if share == 0.0 {
            errors[scene.weights_of(number).start] += error + open;
        }
        self.disc.averager.sums.values = values;
        self.disc.plain = plain;
    }
}
