//! How a material's weights change with the two directions and with roughness.
//!
//! Lambert and microfacets: the same formulas as the weights, in dual numbers. All other laws: central differences of the sixth order over
//! steps of a fiftieth of the law's narrowest lobe, with the difference to the fourth order as error. A table has kinks at its nodes, and
//! there the difference of its two sides shows in that error.

use super::real::{Dual, Real as _};
use super::{Lobe, Material, Model};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// The derivatives of one weight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Slope {
    /// The weight, sr⁻¹.
    pub value: f64,
    /// By the direction to the light; only its part across that direction counts.
    pub i: DVec3,
    /// By the direction to the observer, likewise.
    pub o: DVec3,
    /// By the roughnesses along and across the tangent.
    pub(crate) alpha: [f64; 2],
    /// How far any of them may be off.
    pub error: f64,
}

/// The derivatives of all weights of a material, one for each spectrum.
pub(crate) type Slopes = Vec<Slope>;

/// A sphere's weight and its derivative by the phase angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PhaseSlope {
    /// The weight, m² sr⁻¹ of a sphere of 1 m.
    pub value: f64,
    /// How far it may be off.
    pub value_error: f64,
    /// The derivative, m² sr⁻¹ rad⁻¹.
    pub rate: f64,
    /// How far it may be off.
    pub rate_error: f64,
}

/// Coefficients of central differences at 1, 2, 3 steps, of the sixth and of the fourth order.
const SIXTH: [f64; 3] = [0.75, -0.15, 1.0 / 60.0];
const FOURTH: [f64; 3] = [2.0 / 3.0, -1.0 / 12.0, 0.0];

/// f'(0) by central differences of six values, row by row: `put` adds `scale`·f(x) to a row. Gives derivatives and errors.
pub(crate) fn central(
    count: usize,
    step: f64,
    mut put: impl FnMut(f64, f64, &mut [f64]),
) -> Vec<(f64, f64)> {
    let mut rows = vec![0.0; 2 * count];
    let (fine, coarse) = rows.split_at_mut(count);
    let mut row = vec![0.0; count];
    for k in 0..3 {
        row.fill(0.0);
        let x = step * (k + 1) as f64;
        put(x, 1.0, &mut row);
        put(-x, -1.0, &mut row);
        for ((f, c), r) in fine.iter_mut().zip(coarse.iter_mut()).zip(&row) {
            *f += SIXTH[k] / step * r;
            *c += FOURTH[k] / step * r;
        }
    }
    fine.iter().zip(coarse.iter()).map(|(f, c)| (*f, (f - c).abs())).collect()
}

impl Material {
    /// Weights and derivatives for light from `i` to `o`, unit vectors above the horizon in the surface's axes, as in
    /// [`Material::add_weights`].
    pub(crate) fn slopes(&self, i: DVec3, o: DVec3) -> Slopes {
        match &self.model {
            Model::Lambert => vec![Slope { value: FRAC_1_PI, ..Slope::default() }],
            Model::Mirror { fresnel } => vec![Slope::default(); fresnel.spectra().len()],
            Model::Microfacet { lobe, fresnel } => {
                let reflection = lobe.slope(i, o);
                // The cosine of incidence on the microfacets is |i + o|/2.
                let h = i + o;
                let cos = 0.5 * h.length();
                let along = 0.5 * h.normalize_or_zero();
                let each = fresnel.slopes(cos).into_iter();
                each.map(|(value, rate)| reflection.times(value, rate * along)).collect()
            }
            Model::Blend { .. } | Model::Law(_) => self.numerical_slopes(i, o),
        }
    }

    /// Whether [`Material::slopes`] knows derivatives by roughness.
    pub(crate) fn has_roughness(&self) -> bool {
        matches!(self.model, Model::Microfacet { .. })
    }

    /// The roughnesses of microfacets.
    pub(crate) fn roughness(&self) -> Option<(f64, f64)> {
        match &self.model {
            Model::Microfacet { lobe, .. } => Some(lobe.alpha()),
            _ => None,
        }
    }

    /// The same with other roughnesses, for differences; of anything but microfacets the same.
    pub(crate) fn with_roughness(&self, (alpha_x, alpha_y): (f64, f64)) -> Self {
        let mut other = self.clone();
        if let Model::Microfacet { lobe, .. } = &mut other.model {
            (lobe.alpha_x, lobe.alpha_y) = (alpha_x, alpha_y);
        }
        other
    }

    fn numerical_slopes(&self, i: DVec3, o: DVec3) -> Slopes {
        let count = self.spectra.len();
        let mut values = vec![0.0; count];
        self.add_weights(i, o, 1.0, &mut values);
        let mut slopes: Slopes =
            values.iter().map(|v| Slope { value: *v, ..Slope::default() }).collect();
        let width = match &self.model {
            Model::Law(law) => law.lobe_width_rad(),
            Model::Blend { lobe, .. } => lobe.width_rad(),
            _ => PI,
        };
        // What a base's weights may be off by from node to node of their table (module `blend`).
        let table = if matches!(self.model, Model::Blend { .. }) { 1e-7 } else { 0.0 };
        // Three steps stay above the horizon.
        let step = (0.02 * width).min(2e-3).min(0.2 * i.z.min(o.z));
        let turned = |d: DVec3, axis: DVec3, x: f64| (x.cos() * d + x.sin() * axis).normalize();
        for (of_light, d) in [(true, i), (false, o)] {
            let (a, b) = d.any_orthonormal_pair();
            for axis in [a, b] {
                let found = central(count, step, |x, scale, row| {
                    let moved = turned(d, axis, x);
                    let (i, o) = if of_light { (moved, o) } else { (i, moved) };
                    self.add_weights(i, o, scale, row);
                });
                for (slope, (rate, error)) in slopes.iter_mut().zip(found) {
                    let to = if of_light { &mut slope.i } else { &mut slope.o };
                    *to += rate * axis;
                    slope.error += error + table * slope.value / step;
                }
            }
        }
        slopes
    }

    /// The weights \[m² sr⁻¹\] of a sphere of 1 m radius and their derivatives by the phase angle (radians): Lambert
    /// −2/(3π) (π − γ) sin γ, all others by differences.
    pub(crate) fn sphere_slopes(&self, phase_rad: f64) -> Vec<PhaseSlope> {
        let count = self.spectra.len();
        let mut values = vec![0.0; count];
        // Neither an angle out of range nor a tangent: as in the sum, the scene was checked.
        let put = |phase: f64, scale: f64, row: &mut [f64]| {
            self.add_sphere_weights(phase.clamp(0.0, PI), scale, row).unwrap_or(0.0)
        };
        let relative = put(phase_rad, 1.0, &mut values);
        if self.is_lambert() {
            let rate = -2.0 / 3.0 * FRAC_1_PI * (PI - phase_rad) * phase_rad.sin();
            let value = values[0];
            return vec![PhaseSlope { value, value_error: 0.0, rate, rate_error: 0.0 }];
        }
        let room = phase_rad.min(PI - phase_rad);
        let step = (0.3 * room).clamp(1e-7, 5e-3);
        let found = central(count, step, |x, scale, row| {
            put(phase_rad + x, scale, row);
        });
        let with = values.iter().zip(found);
        with.map(|(&value, (rate, error))| {
            let value_error = relative * value;
            PhaseSlope { value, value_error, rate, rate_error: error + value_error / step }
        })
        .collect()
    }
}

impl Lobe {
    /// The reflection of microfacets that are perfect mirrors, and its derivatives.
    fn slope(&self, i: DVec3, o: DVec3) -> Slope {
        let variable = |value: f64, k: usize| Dual::<8>::variable(value, k);
        let alpha = [variable(self.alpha_x, 6), variable(self.alpha_y, 7)];
        let vector =
            |d: DVec3, k: usize| [variable(d.x, k), variable(d.y, k + 1), variable(d.z, k + 2)];
        let all = self.reflection_of(alpha, vector(i, 0), vector(o, 3));
        let finite = |k: usize| if all.slope[k].is_finite() { all.slope[k] } else { 0.0 };
        Slope {
            value: all.value(),
            i: DVec3::new(finite(0), finite(1), finite(2)),
            o: DVec3::new(finite(3), finite(4), finite(5)),
            alpha: [finite(6), finite(7)],
            error: 0.0,
        }
    }
}

impl Slope {
    /// Multiplied by a number that changes with both directions alike.
    fn times(&self, factor: f64, rate: DVec3) -> Self {
        Self {
            value: factor * self.value,
            i: factor * self.i + self.value * rate,
            o: factor * self.o + self.value * rate,
            alpha: self.alpha.map(|a| factor * a),
            error: factor.abs() * self.error,
        }
    }
}
