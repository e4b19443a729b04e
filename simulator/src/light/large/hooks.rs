//! Where scenes and evaluators meet big meshes.

use super::{Large, Question, why_exact};
use crate::light::evaluate::{COVERING, Direct, Evaluator};
use crate::light::scene::{Scene, SceneError, SceneOptions};
use crate::target::Target;
use glam::DVec3;

impl Scene {
    /// Prepares a target for sums that may be off by `tolerance` of ΣW: big meshes that hide parts of themselves are then sampled, for
    /// distant observers ([`sampling`](crate::light::SceneReport::sampling)); all else stays exact ([`why_exact`](crate::light::SceneReport::why_exact)), and with a tolerance of 0 all.
    ///
    /// # Errors
    /// The errors of [`Scene::new`], and a tolerance that is no number from 0 to 1.
    pub fn with_tolerance(target: &Target, tolerance: f64) -> Result<Self, SceneError> {
        Self::with_options(target, SceneOptions { tolerance, ..SceneOptions::default() })
    }

    /// Looks whether the scene is to be sampled, and prepares for it.
    pub(in crate::light) fn sample(&mut self, tolerance: f64) {
        self.report.why_exact = why_exact(self);
        if self.report.why_exact.is_none() {
            self.large = Large::new(self, tolerance).map(Box::new);
            self.report.sampling = self.large.as_ref().map(|large| large.sampling);
            if self.large.is_none() {
                let why = "the tolerance takes more points than the exact sum is worth";
                self.report.why_exact = Some(why.into());
            }
        }
    }
}

impl Evaluator<'_> {
    /// How far each number of the last evaluation may be off, absolute, m² sr⁻¹: sampled ones each for itself, else the error of them all.
    pub fn errors(&self) -> &[f64] {
        &self.errors
    }

    /// A big mesh within its tolerance; `None` where the exact sum is wanted.
    pub(in crate::light) fn sampled(
        &mut self,
        sun: DVec3,
        to: DVec3,
        stride: usize,
        out: &mut [f64],
    ) -> Option<Direct> {
        let scene = self.scene;
        let large = scene.large.as_ref()?;
        let q = Question { scene, angles: &self.angles, sun, to, stride };
        let Some(found) = large.evaluate(&q, &mut self.large, out, &mut self.errors) else {
            out.fill(0.0);
            return None;
        };
        let covering = if scene.covers {
            COVERING
                * scene.facets.iter().map(|f| f.area).sum::<f64>()
                * std::f64::consts::FRAC_1_PI
        } else {
            0.0
        };
        self.errors.iter_mut().for_each(|e| *e += covering);
        let error = found.error + covering;
        Some(Direct {
            facets: found.facets,
            shadowed: found.shadowed,
            samples: found.points,
            error: if found.total > 0.0 { error / found.total + 1e-15 } else { 0.0 },
            ..Direct::default()
        })
    }
}
