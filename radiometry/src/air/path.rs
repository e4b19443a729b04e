//! The ray through the shells of the air.

use super::AirError;

/// A zenith angle at the station, in degrees, named for what it is.
///
/// `Apparent` is the direction in which a target is seen; `True` that in which a star, at infinity, would stand without air; `Near`
/// that of the straight line to a target at a finite range. The air shifts the ray sideways before it lets it go, by 16 m at
/// 70° and 2 km at the horizon: a satellite 1000 km away stands 3″, one on the horizon at 2000 km 3.5′ nearer to where it is
/// seen than a star behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Zenith {
    /// Without refraction \[deg\].
    True(f64),
    /// Apparent angle, seen from the station \[deg\].
    Apparent(f64),
    /// Without refraction, of a target outside the air at a finite range.
    Near {
        /// Zenith angle of the straight line to it \[deg\].
        true_deg: f64,
        /// Length of that line \[m\].
        range_m: f64,
    },
}

/// Geometry of the ray to a near target besides its bending: where it starts, and where the air ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outside {
    /// Distance of the station from the Earth's centre \[km\].
    station_km: f64,
    /// n − 1 at the station.
    refractivity: f64,
    /// Distance of the highest level from the Earth's centre \[km\].
    top_km: f64,
}

impl Outside {
    /// The distance of a target from the Earth's centre \[km\].
    ///
    /// # Errors
    /// An angle or range that makes no sense; a target inside the air.
    pub(crate) fn radius_km(&self, true_deg: f64, range_m: f64) -> Result<f64, AirError> {
        if !(range_m > 0.0 && range_m.is_finite()) {
            return Err(AirError::Range { range_m });
        }
        if !(0.0..=180.0).contains(&true_deg) {
            return Err(AirError::ZenithAngle { zenith_deg: true_deg });
        }
        let range_km = 1e-3 * range_m;
        let (sin, cos) = true_deg.to_radians().sin_cos();
        let radius_km = (self.station_km + range_km * cos).hypot(range_km * sin);
        if radius_km <= self.top_km {
            return Err(AirError::InsideAir {
                true_deg,
                range_m,
                height_m: 1e3 * (radius_km - self.station_km),
                top_m: 1e3 * (self.top_km - self.station_km),
            });
        }
        Ok(radius_km)
    }

    /// The zenith angle \[deg\] of the straight line from the station to the point at which a ray meets the sphere of a
    /// radius, for the ray's apparent and its final zenith angle.
    ///
    /// Outside the air the ray is a straight line that passes the Earth's centre at n₀ r₀ sin z (Bouguer), and meets the sphere
    /// at the geocentric angle z∞ − asin(n₀ r₀ sin z/r) from the station.
    pub(crate) fn near_deg(&self, apparent_deg: f64, at_infinity_deg: f64, radius_km: f64) -> f64 {
        let sin = apparent_deg.to_radians().sin();
        let impact_km = (1.0 + self.refractivity) * self.station_km * sin;
        let central = at_infinity_deg.to_radians() - (impact_km / radius_km).min(1.0).asin();
        // Up from the station without the cancellation in r cos φ − r₀.
        let half = (0.5 * central).sin();
        let up = (radius_km - self.station_km) - 2.0 * radius_km * half * half;
        (radius_km * central.sin()).atan2(up).to_degrees()
    }
}

/// One ray from the station to space: what it meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    /// Apparent zenith angle at the station \[deg\].
    pub apparent_deg: f64,
    /// True zenith angle of a target at infinity \[deg\].
    pub true_deg: f64,
    pub(crate) amounts: super::model::Amounts,
}

impl Path {
    /// Refraction, true minus apparent zenith angle \[arcseconds\].
    pub fn refraction_arcsec(&self) -> f64 {
        3600.0 * (self.true_deg - self.apparent_deg)
    }
}

/// Spherical shells of air in which the refractivity n − 1 falls exponentially with altitude.
#[derive(Debug, Clone)]
pub(crate) struct Shells {
    /// Distance of the station from the Earth's centre \[km\].
    station_km: f64,
    layers: Vec<Shell>,
}

/// One shell; heights are above the station \[km\].
#[derive(Debug, Clone, Copy)]
struct Shell {
    bottom_km: f64,
    top_km: f64,
    refractivity_bottom: f64,
    refractivity_top: f64,
    /// d ln(n − 1)/dh \[1/km\], zero or negative in ordinary air.
    slope_per_km: f64,
}

impl Shell {
    fn refractivity(&self, height_km: f64) -> f64 {
        self.refractivity_bottom * (self.slope_per_km * (height_km - self.bottom_km)).exp()
    }
}

/// Gauss–Legendre, six points on −1…1: (node, weight) of the upper half.
const GAUSS: [(f64, f64); 3] = [
    (0.238_619_186_083_196_9, 0.467_913_934_572_691),
    (0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (0.932_469_514_203_152, 0.171_324_492_379_170_4),
];

impl Shells {
    /// Shells between `heights_km` above the station (the first is 0), with the refractivity n − 1 at each.
    ///
    /// # Errors
    /// A duct: somewhere n·r does not increase with r, and a ray at 90° would not leave the air.
    pub(crate) fn new(
        station_km: f64,
        heights_km: &[f64],
        refractivity: &[f64],
    ) -> Result<Self, AirError> {
        let layers: Vec<Shell> = heights_km
            .windows(2)
            .zip(refractivity.windows(2))
            .map(|(h, n)| Shell {
                bottom_km: h[0],
                top_km: h[1],
                refractivity_bottom: n[0],
                refractivity_top: n[1],
                slope_per_km: if n[0] > 0.0 && n[1] > 0.0 {
                    (n[1] / n[0]).ln() / (h[1] - h[0])
                } else {
                    0.0
                },
            })
            .collect();
        for layer in &layers {
            for (h, n) in [
                (layer.bottom_km, layer.refractivity_bottom),
                (layer.top_km, layer.refractivity_top),
            ] {
                // d(nr)/dr = n + r n′
                if 1.0 + n + (station_km + h) * n * layer.slope_per_km <= 0.0 {
                    return Err(AirError::Duct {
                        bottom_m: 1e3 * layer.bottom_km,
                        top_m: 1e3 * layer.top_km,
                    });
                }
            }
        }
        Ok(Self { station_km, layers })
    }

    /// Follows the ray that leaves the station at an apparent zenith angle of 0° to 90°, and calls
    /// `visit(layer, fraction, ds_km)` at the points of a quadrature over the path: `fraction` of the layer's
    /// thickness from its bottom, `ds_km` of path. Returns the total bending \[rad\].
    ///
    /// Bouguer's law, n r sin z = C. The variable is x = r cos z, with x² = r² − C²/n² and
    /// ds = dx/(1 + sin² z · r n′/n): unlike ds = dr/cos z it stays regular where the ray is horizontal, so that 90° needs
    /// no special case. (LOWTRAN7 uses the same variable; Gallery et al. 1983, AFGL-TR-83-0065.)
    pub(crate) fn trace(&self, apparent_deg: f64, mut visit: impl FnMut(usize, f64, f64)) -> f64 {
        let elevation = (90.0 - apparent_deg).to_radians();
        let r0 = self.station_km;
        let n0 = self.layers.first().map_or(0.0, |l| l.refractivity_bottom);
        // sin z from the angle that is small, so that neither the zenith nor the horizon is missed by a rounding.
        let sin =
            if apparent_deg < 45.0 { apparent_deg.to_radians().sin() } else { elevation.cos() };
        let invariant = (1.0 + n0) * r0 * sin;
        // n r − C without cancellation: (h) + (N r − N₀ r₀) + n₀ r₀ (1 − sin z).
        let start = (1.0 + n0) * r0 * 2.0 * (0.5 * elevation).sin().powi(2) - n0 * r0;
        let x_squared = |height_km: f64, refractivity: f64| {
            let r = r0 + height_km;
            let n = 1.0 + refractivity;
            let gap = (height_km + refractivity * r + start).max(0.0);
            gap * (n * r + invariant) / (n * n)
        };
        let mut bending = 0.0;
        for (index, layer) in self.layers.iter().enumerate() {
            let thickness = layer.top_km - layer.bottom_km;
            // At the station x is known without the rounding that is left in n r − C: at the horizon 2 mm of path.
            let low = match index {
                0 => (r0 * elevation.sin()).powi(2),
                _ => x_squared(layer.bottom_km, layer.refractivity_bottom),
            };
            let high = x_squared(layer.top_km, layer.refractivity_top);
            let (middle, half) =
                (0.5 * (high.sqrt() + low.sqrt()), 0.5 * (high.sqrt() - low.sqrt()));
            for (node, weight) in GAUSS.iter().flat_map(|&(t, w)| [(-t, w), (t, w)]) {
                let x = middle + node * half;
                let target = x * x;
                // x² is nearly linear in the height: Newton from the chord, done in two or three steps.
                let mut height = layer.bottom_km + thickness * (target - low) / (high - low);
                let (mut refractivity, mut bend) = (0.0, 0.0);
                for _ in 0..8 {
                    refractivity = layer.refractivity(height);
                    let (r, n) = (r0 + height, 1.0 + refractivity);
                    let sin = invariant / (n * r);
                    bend = layer.slope_per_km * refractivity / n * sin;
                    let step = (target - x_squared(height, refractivity))
                        / (2.0 * r * (1.0 + sin * bend * r));
                    height += step;
                    if step.abs() < 1e-9 * thickness {
                        break;
                    }
                }
                let (r, n) = (r0 + height, 1.0 + refractivity);
                let ds = weight * half / (1.0 + invariant / (n * r) * bend * r);
                bending -= bend * ds;
                visit(index, (height - layer.bottom_km) / thickness, ds);
            }
        }
        bending
    }

    /// True zenith angle \[deg\] of a target at infinity that is seen at an apparent one of 0° to 90°.
    pub(crate) fn true_deg(&self, apparent_deg: f64) -> f64 {
        apparent_deg + self.trace(apparent_deg, |_, _, _| ()).to_degrees()
    }

    /// Returns the geometry that near targets need.
    pub(crate) fn outside(&self) -> Outside {
        let top_km = self.layers.last().map_or(0.0, |layer| layer.top_km);
        Outside {
            station_km: self.station_km,
            refractivity: self.layers.first().map_or(0.0, |layer| layer.refractivity_bottom),
            top_km: self.station_km + top_km,
        }
    }

    /// Apparent zenith angle \[deg\] at which a target is seen.
    ///
    /// # Errors
    /// The angle is negative or not a number, or the target is below the refracted horizon, or inside the air.
    pub(crate) fn apparent_deg(&self, zenith: Zenith) -> Result<f64, AirError> {
        match zenith {
            Zenith::Apparent(z) => checked(z, "apparent", 90.0),
            Zenith::True(z) if (0.0..=90.0).contains(&z) => {
                Ok(invert(z, z.min(90.0), |a| self.true_deg(a)))
            }
            Zenith::True(z) => {
                let z = checked(z, "true", self.true_deg(90.0))?;
                Ok(invert(z, 90.0, |a| self.true_deg(a)))
            }
            Zenith::Near { true_deg, range_m } => {
                let outside = self.outside();
                let radius_km = outside.radius_km(true_deg, range_m)?;
                let near_of = |a| outside.near_deg(a, self.true_deg(a), radius_km);
                if true_deg > 90.0 {
                    checked(true_deg, "true", near_of(90.0))?;
                }
                Ok(invert(true_deg, true_deg.min(90.0), near_of))
            }
        }
    }
}

/// The angle, if it is a direction between the zenith and the horizon.
pub(crate) fn checked(
    zenith_deg: f64,
    kind: &'static str,
    horizon_deg: f64,
) -> Result<f64, AirError> {
    if !(zenith_deg >= 0.0 && zenith_deg.is_finite()) {
        return Err(AirError::ZenithAngle { zenith_deg });
    }
    if zenith_deg > horizon_deg {
        return Err(AirError::BelowHorizon { kind, zenith_deg, horizon_deg });
    }
    Ok(zenith_deg)
}

/// Solves `true_of(a)` = `true_deg` for a in 0…`highest`, by secants that never leave the bracket.
///
/// The refraction changes by less than 0.3 of the angle's own change, so that the secants converge in three or four
/// steps; the bracket guards user profiles in which it does not.
pub(crate) fn invert(true_deg: f64, highest: f64, true_of: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, highest);
    let mut a = highest;
    let mut miss = true_of(a) - true_deg;
    if miss <= 0.0 || true_deg == 0.0 {
        return if true_deg == 0.0 { 0.0 } else { a };
    }
    let mut slope = 1.0;
    for _ in 0..60 {
        if miss > 0.0 {
            high = a;
        } else {
            low = a;
        }
        let newton = a - miss / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let step = next - a;
        if step.abs() < 1e-13 * (1.0 + true_deg) {
            return next;
        }
        let next_miss = true_of(next) - true_deg;
        let secant = (next_miss - miss) / step;
        slope = if secant.is_finite() && secant > 0.1 { secant } else { 1.0 };
        (a, miss) = (next, next_miss);
        if miss == 0.0 {
            return a;
        }
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slant column of exp(−h/H), in units of H.
    fn slant(scale_km: f64, zenith_deg: f64) -> f64 {
        let heights: Vec<f64> = (0..=100).map(|i| f64::from(i) * 2.0).collect();
        let shells = Shells::new(6371.0, &heights, &[0.0; 101]).unwrap();
        let mut sum = 0.0;
        shells.trace(zenith_deg, |layer, fraction, ds| {
            let h = heights[layer] + fraction * (heights[layer + 1] - heights[layer]);
            sum += ds * (-h / scale_km).exp();
        });
        sum / scale_km
    }

    /// Truth: a straight line through one shell leaves it after √((R+d)² − R² sin² z) − R cos z.
    #[test]
    fn a_homogeneous_shell_has_its_closed_form() {
        let (radius, depth) = (6371.0_f64, 9.0_f64);
        let shells = Shells::new(radius, &[0.0, 1.0, 4.0, 9.0], &[0.0; 4]).unwrap();
        for z in [0.0_f64, 30.0, 60.0, 85.0, 89.9, 90.0] {
            let (sin, cos) = (z.to_radians().sin(), (90.0 - z).to_radians().sin());
            let truth = ((radius + depth).powi(2) - (radius * sin).powi(2)).sqrt() - radius * cos;
            let mut length = 0.0;
            let bending = shells.trace(z, |_, _, ds| length += ds);
            assert!((length / truth - 1.0).abs() < 1e-10, "{z}°: {length} against {truth} km");
            assert_eq!(bending, 0.0);
        }
    }

    /// Truth: Chapman's function, here by its definition as an integral over angles (Chapman 1931),
    /// Ch(X, z) = X sin z ∫₀^z exp(X − X sin z/sin λ) csc² λ dλ, by Simpson's rule; at the horizon
    /// Ch = X e^X K₁(X) ≈ √(πX/2)(1 + 3/(8X) − 15/(128X²)).
    #[test]
    fn an_isothermal_atmosphere_has_chapmans_air_mass() {
        let scale = 8.0;
        let x = 6371.0_f64 / scale;
        for z in [30.0_f64, 60.0, 75.0, 85.0, 89.0] {
            let zr = z.to_radians();
            let f = |l: f64| (x - x * zr.sin() / l.sin()).exp() / (l.sin() * l.sin());
            let n = 200_000;
            let step = zr / f64::from(n);
            let sum: f64 = (1..n)
                .map(|i| f(step * f64::from(i)) * if i % 2 == 1 { 4.0 } else { 2.0 })
                .sum::<f64>()
                + f(zr);
            let truth = x * zr.sin() * sum * step / 3.0;
            let ours = slant(scale, z);
            assert!((ours / truth - 1.0).abs() < 1e-8, "{z}°: {ours} against {truth}");
        }
        let horizon = (std::f64::consts::FRAC_PI_2 * x).sqrt()
            * (1.0 + 3.0 / (8.0 * x) - 15.0 / (128.0 * x * x));
        let ours = slant(scale, 90.0);
        assert!((ours / horizon - 1.0).abs() < 1e-8, "horizon: {ours} against {horizon}");
    }

    /// Truth: sec z, from which a thin layer on a large sphere departs by (h/R) tan² z.
    #[test]
    fn a_thin_layer_is_plane_parallel() {
        let shells = Shells::new(6371.0, &[0.0, 1e-3], &[0.0, 0.0]).unwrap();
        for z in [0.0_f64, 20.0, 45.0, 60.0] {
            let mut length = 0.0;
            shells.trace(z, |_, _, ds| length += ds);
            assert!((length * 1e3 * z.to_radians().cos() - 1.0).abs() < 1e-6);
        }
    }

    /// Truth: Laplace's expansion, R = N(1 − H/r) tan z − N(H/r − N/2) tan³ z, which Oriani's theorem makes
    /// nearly independent of the structure (Green, Spherical Astronomy, 1985); the next term is about
    /// 3N(H/r)² tan⁵ z.
    #[test]
    fn an_exponential_atmosphere_refracts_as_laplace_says() {
        let (radius, scale, n) = (6371.0_f64, 8.0_f64, 2.8e-4_f64);
        let heights: Vec<f64> = (0..=200).map(f64::from).collect();
        let refractivity: Vec<f64> = heights.iter().map(|h| n * (-h / scale).exp()).collect();
        let shells = Shells::new(radius, &heights, &refractivity).unwrap();
        for z in [1.0_f64, 20.0, 45.0, 60.0] {
            let (tan, h) = (z.to_radians().tan(), scale / radius);
            let truth = n * (1.0 - h) * tan - n * (h - 0.5 * n) * tan.powi(3);
            let ours = shells.trace(z, |_, _, _| ());
            let next = 4.0 * n * h * h * (1.0 + tan).powi(5);
            assert!((ours - truth).abs() < next, "{z}°: {ours} against {truth} rad");
        }
    }

    /// Truth: the forward trace.
    #[test]
    fn the_apparent_angle_is_the_inverse_of_the_true_one() {
        let heights: Vec<f64> = (0..=120).map(f64::from).collect();
        let refractivity: Vec<f64> = heights.iter().map(|h| 2.8e-4 * (-h / 8.0).exp()).collect();
        let shells = Shells::new(6371.0, &heights, &refractivity).unwrap();
        for apparent in [0.0, 1e-3, 30.0, 75.0, 89.0, 89.99, 90.0] {
            let back = shells.apparent_deg(Zenith::True(shells.true_deg(apparent))).unwrap();
            assert!((back - apparent).abs() < 1e-10, "{apparent}: {back}");
        }
    }

    /// Truth: the ray equation d(n d)/ds = ∇n in the plane, by Runge–Kutta steps of 50 m through the same n(h) and on along a
    /// straight line: no Bouguer, no shells, no impact parameter. Its own error is below 1e-9°, measured by halving the step.
    #[test]
    fn a_near_target_is_seen_through_the_ray_that_meets_it() {
        let (radius, scale, n0) = (6371.0_f64, 8.0_f64, 2.8e-4_f64);
        let heights: Vec<f64> = (0..=160).map(f64::from).collect();
        let refractivity: Vec<f64> = heights.iter().map(|h| n0 * (-h / scale).exp()).collect();
        let shells = Shells::new(radius, &heights, &refractivity).unwrap();
        // (x along the ground, y up from the Earth's centre, direction times n).
        let derivative = |[x, y, u, v]: [f64; 4]| {
            let r = x.hypot(y);
            let excess = n0 * (-(r - radius) / scale).exp();
            let (n, slope) = (1.0 + excess, -excess / scale);
            [u / n, v / n, slope * x / r, slope * y / r]
        };
        let plus = |a: [f64; 4], b: [f64; 4], h: f64| std::array::from_fn(|i| a[i] + h * b[i]);
        for apparent_deg in [0.0_f64, 20.0, 60.0, 70.0, 85.0, 89.0, 89.999] {
            let z = apparent_deg.to_radians();
            let mut at = [0.0, radius, (1.0 + n0) * z.sin(), (1.0 + n0) * z.cos()];
            while at[0].hypot(at[1]) < radius + 160.0 {
                let h = 0.05;
                let k1 = derivative(at);
                let k2 = derivative(plus(at, k1, 0.5 * h));
                let k3 = derivative(plus(at, k2, 0.5 * h));
                let k4 = derivative(plus(at, k3, h));
                at = std::array::from_fn(|i| {
                    at[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
                });
            }
            for further_km in [1.0, 200.0, 1000.0, 36_000.0, 1e6] {
                let (x, y) = (at[0] + further_km * at[2], at[1] + further_km * at[3]);
                let near = Zenith::Near {
                    true_deg: x.atan2(y - radius).to_degrees(),
                    range_m: 1e3 * x.hypot(y - radius),
                };
                let ours = shells.apparent_deg(near).unwrap();
                let error = ours - apparent_deg;
                assert!(error.abs() < 3e-9, "{apparent_deg}°, {further_km} km: {error:e}°");
            }
        }
    }
}
