//! Light of whole spheres by phase angle, in tables that are made once.
//!
//! A sphere sends what its phase angle says, and that takes an integral over it. Earthshine asks for hundreds of phase angles an epoch, the Sun's disc for a few, a pass for all of
//! them again at the next epoch: a smooth function of one number. So the integrals stand as Chebyshev polynomials between some angles, halved until the last coefficients are nothing. A
//! panel is made when it is first asked for, and is the same whoever asks first. Fresnel factors are no part of it.

use crate::surface::Material;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Panels over all phase angles.
const PANELS: usize = 8;
/// The degree of the polynomials.
const DEGREE: usize = 16;
/// The last coefficients that tell how well a polynomial fits.
const LAST: usize = 3;
/// Relative error at which halving stops, unless the integrals themselves are worse.
const TOLERANCE: f64 = 1e-10;
/// Error that is left of an integral; it does not make a polynomial worse than that.
const OF_OWN: f64 = 0.3;
/// Panels narrower than this are not halved, radians.
const NARROWEST_RAD: f64 = 2e-3;
/// A polynomial that is worse than this at the narrowest is not used: the integral is taken.
const WORST: f64 = 1e-6;

/// The integrals of a material over a sphere of 1 m by phase angle.
#[derive(Debug, Clone, Default)]
pub struct PhaseCurve {
    panels: [OnceLock<Vec<Piece>>; PANELS],
}

/// A polynomial between two phase angles.
#[derive(Debug, Clone)]
struct Piece {
    from: f64,
    to: f64,
    /// Coefficients, `DEGREE + 1` of each integral; empty where none is good enough.
    coefficients: Vec<f64>,
    /// Estimated relative error.
    error: f64,
}

impl PhaseCurve {
    /// Adds the weights of [`Material::add_sphere_weights`] from the table of that material; gives the relative error, infinite where there are none.
    pub fn add(&self, material: &Material, phase: f64, scale: f64, sum: &mut [f64]) -> f64 {
        let exact = |sum: &mut [f64]| {
            material.add_sphere_weights(phase, scale, sum).unwrap_or(f64::INFINITY)
        };
        if material.has_closed_sphere() || !(0.0..PI).contains(&phase) {
            return exact(sum);
        }
        let number = ((phase / PI * PANELS as f64) as usize).min(PANELS - 1);
        let pieces = self.panels[number].get_or_init(|| {
            let at = |n: usize| PI * n as f64 / PANELS as f64;
            let mut pieces = Vec::new();
            divide(material, [at(number), at(number + 1)], &mut pieces);
            pieces
        });
        let found = pieces.partition_point(|piece| piece.to < phase).min(pieces.len() - 1);
        let piece = &pieces[found];
        if piece.coefficients.is_empty() {
            return exact(sum);
        }
        let x = (2.0 * phase - piece.from - piece.to) / (piece.to - piece.from);
        let mut values = [0.0; 8];
        let rows = piece.coefficients.chunks_exact(DEGREE + 1);
        let count = rows.len();
        if count > values.len() {
            let values: Vec<f64> = rows.map(|row| clenshaw(row, x)).collect();
            material.add_sphere_integrals(phase, &values, scale, sum);
            return piece.error;
        }
        values.iter_mut().zip(rows).for_each(|(value, row)| *value = clenshaw(row, x));
        material.add_sphere_integrals(phase, &values[..count], scale, sum);
        piece.error
    }
}

/// Appends polynomials that are good enough from one phase angle to another, from left to right.
fn divide(material: &Material, [from, to]: [f64; 2], pieces: &mut Vec<Piece>) {
    let count = DEGREE + 1;
    let mut own = 0.0_f64;
    let rows: Vec<Vec<f64>> = (0..count)
        .map(|j| {
            let x = (PI * (j as f64 + 0.5) / count as f64).cos();
            let (values, error) = material.sphere_integrals(from + 0.5 * (to - from) * (1.0 + x));
            own = own.max(error);
            values
        })
        .collect();
    let share = 2.0 / count as f64;
    let (mut coefficients, mut error) = (Vec::new(), 0.0_f64);
    let most = rows.iter().flatten().fold(0.0_f64, |most, v| most.max(v.abs()));
    let least = rows.iter().map(|row| row.iter().map(|v| v.abs()).sum::<f64>());
    let least = least.fold(f64::INFINITY, f64::min).max(1e-6 * most);
    (0..rows[0].len()).for_each(|k| {
        let row: Vec<f64> = (0..count)
            .map(|n| {
                let angle = |j: usize| PI * n as f64 * (j as f64 + 0.5) / count as f64;
                let sum: f64 = (0..count).map(|j| rows[j][k] * angle(j).cos()).sum();
                if n == 0 { 0.5 * share * sum } else { share * sum }
            })
            .collect();
        error += row[count - LAST..].iter().map(|c| c.abs()).sum::<f64>();
        coefficients.extend(row);
    });
    let relative = if most > 0.0 { error / least } else { 0.0 };
    // Towards 180° all light ends, and with it every relative error.
    let ends = to >= PI;
    if ends || relative > TOLERANCE.max(OF_OWN * own) {
        if to - from > NARROWEST_RAD {
            let middle = 0.5 * (from + to);
            divide(material, [from, middle], pieces);
            divide(material, [middle, to], pieces);
            return;
        }
        if ends || relative > WORST {
            coefficients.clear();
        }
    }
    pieces.push(Piece { from, to, coefficients, error: own + relative });
}

/// Σ c_n T_n(x).
fn clenshaw(coefficients: &[f64], x: f64) -> f64 {
    let (mut after, mut beyond) = (0.0, 0.0);
    for c in coefficients[1..].iter().rev() {
        (after, beyond) = (2.0 * x * after - beyond + c, after);
    }
    x * after - beyond + coefficients[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Distribution, Fresnel, Lobe, Masking};
    use sunglint_radiometry::spectrum::Spectrum;

    /// Truth: the integrals themselves (held against closed forms and sums over facets in `tests/surface_sphere.rs`), at 400 phase angles that are no nodes, for wide and narrow lobes, up to a hundredth
    /// of a degree before 180°. Tolerance: what is stated, and 3e-9 where there is light at all.
    #[test]
    fn tables_are_the_integrals() {
        let grey = || Spectrum::constant(0.7, 300.0, 1200.0).unwrap();
        for (distribution, alpha) in [
            (Distribution::Beckmann, 0.12),
            (Distribution::Beckmann, 0.6),
            (Distribution::Ggx, 0.02),
            (Distribution::Ggx, 0.3),
        ] {
            let lobe = Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
            let material = Material::microfacet("m", lobe, Fresnel::constant(grey()).unwrap());
            let curve = PhaseCurve::default();
            for k in 0..400 {
                let phase = (PI - 1.7e-4) * (f64::from(k) + 0.37) / 400.0;
                let (mut found, mut truth) = ([0.0], [0.0]);
                let error = curve.add(&material, phase, 2.0, &mut found);
                material.add_sphere_weights(phase, 2.0, &mut truth).unwrap();
                let off = (found[0] / truth[0] - 1.0).abs();
                assert!(off <= error && error < 1e-6, "{distribution:?} {alpha} {phase}: {off}");
                assert!(off < 3e-9, "{distribution:?} {alpha} {phase}: {off} {error}");
            }
        }
    }
}
