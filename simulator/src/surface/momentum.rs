//! Momentum that reflected light carries away: for the pressure of sunlight.

use super::scatter::Effort;
use super::{Material, Model, cubature};
use glam::DVec3;

/// Effort of the integral: pressure is known to some percent.
const EFFORT: Effort = Effort { tolerance: 1e-4, most: 20_000 };

impl Material {
    /// Returns ∫ w_k ω_o cosθ_o dω_o for each spectrum, in the surface's own axes: times irradiance, cosθ_i, the spectrum and 1/c the
    /// momentum that a unit area's reflected light carries away each second. `i` is the unit vector towards the light, above the horizon. Through
    /// the material's own importance sampling, to 1e-4 of the largest component; a mirror's is exact.
    pub fn momentum(&self, i: DVec3) -> Vec<DVec3> {
        let count = self.spectra.len();
        // Written so that NaN is nothing too.
        if i.z.is_nan() || i.z <= 0.0 {
            return vec![DVec3::ZERO; count];
        }
        if let Model::Mirror { fresnel } = &self.model {
            let mut weights = vec![0.0; count];
            fresnel.add_weights(i.z, 1.0, &mut weights);
            let mirrored = DVec3::new(-i.x, -i.y, i.z);
            return weights.into_iter().map(|w| w * mirrored).collect();
        }
        let edges = self.proposals.edges();
        let cells: Vec<cubature::Cell> = edges
            .windows(2)
            .flat_map(|u| [[(u[0], u[1]), (0.0, 0.5)], [(u[0], u[1]), (0.5, 1.0)]])
            .collect();
        let mut weights = vec![0.0; count];
        let (sum, _) = cubature::integrate(&cells, 3 * count, EFFORT, |u, scale, sum| {
            let Some(o) = self.proposals.sample(i, u.into()) else { return };
            let density = self.proposals.density(i, o);
            // Written so that NaN is left out too.
            if density.is_nan() || density <= 0.0 {
                return;
            }
            weights.fill(0.0);
            self.add_weights(i, o, scale * o.z / density, &mut weights);
            for (k, w) in weights.iter().enumerate() {
                for axis in 0..3 {
                    sum[3 * k + axis] += w * o[axis];
                }
            }
        });
        sum.chunks_exact(3).map(DVec3::from_slice).collect()
    }
}
