//! The curved parts of a scene as the engine adds them: between the flat facets and [`super::curved`].

use super::curved::{Light, bent, sight::Sight};
use super::evaluate::{Evaluator, GRAZING};
use super::occlude::Toward;
use glam::DVec3;

impl Evaluator<'_> {
    /// Finds the outlines of curved parts.
    pub(super) fn outline(&mut self, sun: DVec3, eye: Toward) {
        if self.scene.report().no_occlusion {
            return;
        }
        for (k, round) in self.scene.rounds.iter().enumerate() {
            let Some(form) = &round.outline else { continue };
            form.outline(&self.now.place[k], Toward::Far(sun), &mut self.outlines[0][k]);
            form.outline(&self.now.place[k], eye, &mut self.outlines[1][k]);
        }
    }

    /// Adds what is curved. Gives the error.
    pub(super) fn rounds(&mut self, light: Light, stride: usize, out: &mut [f64]) -> f64 {
        let scene = self.scene;
        let mut sum = 0.0;
        for (k, round) in scene.rounds.iter().enumerate() {
            let weights = scene.weights_of(round.material as usize);
            let start = round.part as usize * stride;
            let mut values = vec![0.0; weights.len()];
            let mut errors = values.clone();
            self.round(k, light, &mut values, &mut errors);
            let here = start + weights.start..start + weights.end;
            out[here.clone()].iter_mut().zip(&values).for_each(|(o, v)| *o += v);
            self.errors[here].iter_mut().zip(&errors).for_each(|(o, e)| *o += e);
            sum += errors.iter().sum::<f64>();
        }
        sum
    }

    /// Adds one curved part to its material's weights and their errors.
    pub(super) fn round(
        &mut self,
        number: usize,
        light: Light,
        values: &mut [f64],
        errors: &mut [f64],
    ) {
        let sight = Sight { scene: self.scene, now: &self.now, outlines: &self.outlines };
        self.curves.add(&sight, number, light, values, errors, &mut self.work.done);
    }

    /// Whether nothing of another component stands before a curved part.
    pub(super) fn round_is_free(&mut self, number: usize, light: Light) -> bool {
        let sight = Sight { scene: self.scene, now: &self.now, outlines: &self.outlines };
        self.curves.round_is_free(&sight, number, light)
    }

    /// Whether anything is taken away of facet `i`; what is left stands in `work.kept`.
    pub(super) fn visible(&mut self, i: usize, sun: DVec3, eye: Toward) -> bool {
        let sight = Sight { scene: self.scene, now: &self.now, outlines: &self.outlines };
        self.work.visible(&sight, i, sun, eye, self.scene.outlines.get(i))
    }

    /// Adds one bent triangle. Gives the error that it brings, m² sr⁻¹.
    pub(super) fn bent(
        &mut self,
        i: usize,
        patch: usize,
        sun: DVec3,
        eye: Toward,
        stride: usize,
        out: &mut [f64],
    ) -> f64 {
        let scene = self.scene;
        let facet = &scene.facets[i];
        let (origin, normal) = (self.now.origin[i], self.now.normal[i]);
        let (u, v) = (self.now.tangent[i], self.now.bitangent[i]);
        let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), normal.dot(d));
        let (at, range_squared) = match eye {
            Toward::Far(d) => (Toward::Far(local(d)), 1.0),
            Toward::Near(q) => (Toward::Near(local(q - origin)), q.length_squared()),
        };
        let patch = &scene.patches[patch];
        if !(patch.faces(Toward::Far(local(sun))) && patch.faces(at)) {
            return 0.0;
        }
        self.work.done.facets += 1;
        let weights = scene.weights_of(facet.material as usize);
        let start = facet.part as usize * stride;
        let material = &scene.materials[facet.material as usize];
        let tolerance = 0.1 * self.curves.tolerance;
        let task =
            bent::Task { patch, material, sun: local(sun), eye: at, range_squared, tolerance };
        let out = &mut out[start + weights.start..start + weights.end];
        let outline = scene.outlines.get(i);
        let flat = normal.dot(sun).min(normal.dot(eye.from(origin)));
        if flat > GRAZING {
            let sight = Sight { scene, now: &self.now, outlines: &self.outlines };
            if self.work.visible(&sight, i, sun, eye, outline) {
                let rounding = 1e-15 * facet.area + 1e-4 * scene.touching_m * facet.radius;
                let pieces = self.work.kept.iter();
                return pieces.map(|p| task.add(p, out)).sum::<f64>() + rounding;
            }
            return task.add(outline, out);
        }
        // The flat triangle looks away, the bent one not all of it.
        let mut whole = vec![0.0; out.len()];
        let error = task.add(outline, &mut whole);
        let sight = Sight { scene, now: &self.now, outlines: &self.outlines };
        let sure = facet.convex && self.curves.is_free(&sight, i, Light { sun, eye });
        let share = if sure { 1.0 } else { 0.5 };
        out.iter_mut().zip(&whole).for_each(|(o, w)| *o += share * w);
        error + (1.0 - share) * whole.iter().sum::<f64>()
    }
}
