//! ⟨f cosθ_i⟩ of a material over what is left of the Sun's disc, before each profile.

use super::cut::{Cut, Disc, Left};
use super::profile::{PROFILES, profiles, second_moments};
use super::rays;
pub(in crate::light) use super::rays::Bell;
use super::rings;
use super::sums::Sums;
use crate::surface::{Distribution, Lobe, Material, Width};
use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::PI;

/// Below this, sr⁻¹, an average is nothing: 3e-9 of white paint.
pub const FLOOR: f64 = 1e-9;
/// Distance from the middle of the four places that a first look takes, in radii.
pub(super) const LOOK: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Room to average in, and the last result.
#[derive(Debug, Default)]
pub struct Averager {
    /// ⟨w_k cosθ_i⟩ \[sr⁻¹\] before each profile, and where the light comes from.
    pub sums: Sums,
    /// Estimated error of the sum of all values, sr⁻¹.
    pub error: f64,
    /// Way in which the average was found.
    pub way: Way,
    look: Vec<Vec<f64>>,
}

/// How an average was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Way {
    /// Nothing of the disc is left, or nothing reflected.
    #[default]
    Dark,
    /// A closed form.
    Closed,
    /// Five places.
    Look,
    /// Rings about the disc's middle.
    Rings,
    /// Rays from the lobe's peak.
    Rays,
}

impl Averager {
    /// Averages over a disc in the facet's axes (z its normal); `to` points to the observer, above the horizon. `earth` is a cut already
    /// known to leave a part. `tolerance` is relative.
    pub fn facet(
        &mut self,
        material: &Material,
        disc: &Disc,
        to: DVec3,
        earth: Option<Cut>,
        tolerance: f64,
    ) {
        let count = material.spectra().len();
        self.sums.clear(count);
        (self.error, self.way) = (0.0, Way::Dark);
        let horizon = Cut::horizon(disc, DVec3::Z);
        let mut cuts: Vec<Cut> = earth.into_iter().collect();
        match horizon.left() {
            Left::Nothing => return,
            Left::Part => cuts.push(horizon),
            Left::All => {}
        }
        if let Width::Mirror(fresnel) = material.width() {
            let image = mirrored(disc, to);
            if let Some(place) = image.filter(|p| p.length_squared() < 1.0)
                && cuts.iter().all(|c| c.sees(place))
            {
                self.way = Way::Closed;
                let mu = (1.0 - place.length_squared()).max(0.0).sqrt();
                let weights = profiles(mu).map(|p| p / (PI * disc.sine * disc.sine));
                self.sums.add(place, &weights, &mut |_, out| fresnel.add_weights(to.z, 1.0, out));
            }
            return;
        }
        let mut value = |place: DVec2, out: &mut [f64]| {
            let sun = disc.direction(place);
            material.add_weights(sun, to, sun.z / disc.cosine(place), out);
        };
        // Between measured values there are kinks, which no panel resolves.
        let tolerance = tolerance.max(material.grain());
        let limits = (tolerance, FLOOR * tolerance);
        if let Width::Other(width) = material.width() {
            let wide = width > disc.sine && cuts.is_empty();
            if wide && self.look(count, tolerance, &mut value) {
                self.way = Way::Look;
            } else {
                self.way = Way::Rings;
                self.error = rings::average(&cuts, count, limits, &mut value, &mut self.sums);
            }
            return;
        }
        let Width::Lobe { lobe, alone } = material.width() else {
            if cuts.is_empty() {
                // cosθ_i is linear over the disc.
                self.way = Way::Closed;
                let spread = second_moments();
                let mut grey = [0.0; PROFILES];
                grey[0] = 1.0;
                self.sums.add(DVec2::ZERO, &grey, &mut value);
                self.spread(spread[0]);
            } else {
                self.way = Way::Rings;
                self.error = rings::average(&cuts, count, limits, &mut value, &mut self.sums);
            }
            return;
        };
        let bell = Bell::of(lobe, disc, to);
        if let Some(bell) = &bell
            && alone
            && bell.is_far(lobe, disc, to)
        {
            self.way = Way::Dark;
            self.error = FLOOR * tolerance;
            return;
        }
        let scale = bell.as_ref().map_or(f64::INFINITY, Bell::scale);
        if cuts.is_empty() && scale > 1.0 && self.look(count, tolerance, &mut value) {
            self.way = Way::Look;
            return;
        }
        if scale > 0.3 || bell.is_none() {
            self.way = Way::Rings;
            self.error = rings::average(&cuts, count, limits, &mut value, &mut self.sums);
            if self.error <= tolerance * self.sums.grey() + FLOOR {
                return;
            }
        }
        if let Some(bell) = bell {
            self.way = Way::Rays;
            self.error = rays::average(bell, &cuts, count, limits, &mut value, &mut self.sums);
        }
    }

    /// The light's mean place, and one standard deviation along each of its two axes.
    pub fn spot(&self) -> (DVec2, [DVec2; 2]) {
        let [all, x, y, xx, xy, yy] = self.sums.moments;
        if all <= 0.0 {
            return (DVec2::ZERO, [DVec2::ZERO; 2]);
        }
        let mean = DVec2::new(x, y) / all;
        let (xx, xy, yy) =
            (xx / all - mean.x * mean.x, xy / all - mean.x * mean.y, yy / all - mean.y * mean.y);
        let (half, difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = difference.hypot(xy);
        let angle = 0.5 * xy.atan2(difference);
        let axis = DVec2::new(angle.cos(), angle.sin());
        let wide = (half + root).max(0.0).sqrt();
        let narrow = (half - root).max(0.0).sqrt();
        (mean, [wide * axis, narrow * axis.perp()])
    }

    /// The same of the light of all that a cut leaves of the disc.
    pub fn rest(&mut self, earth: Option<Cut>) -> (DVec2, [DVec2; 2]) {
        match earth {
            None => {
                let wide = second_moments()[0].sqrt();
                (DVec2::ZERO, [wide * DVec2::X, wide * DVec2::Y])
            }
            Some(cut) => {
                let mut even = |_: DVec2, out: &mut [f64]| out[0] += 1.0;
                rings::average(&[cut], 1, (1e-6, 0.0), &mut even, &mut self.sums);
                self.spot()
            }
        }
    }

    /// The second moments of light that comes evenly from the disc.
    fn spread(&mut self, square: f64) {
        let all = self.sums.moments[0];
        self.sums.moments[3] = all * square;
        self.sums.moments[5] = all * square;
    }

    /// A look at the middle and four places: enough where the answer is quadratic over the disc. Whether it is.
    fn look(
        &mut self,
        count: usize,
        tolerance: f64,
        value: &mut impl FnMut(DVec2, &mut [f64]),
    ) -> bool {
        let places = [DVec2::ZERO, DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y].map(|p| LOOK * p);
        self.look.resize(5, Vec::new());
        for (place, out) in places.into_iter().zip(&mut self.look) {
            out.clear();
            out.resize(count, 0.0);
            value(place, out);
        }
        let sum = |at: &Vec<f64>| at.iter().map(|v| v.abs()).sum::<f64>();
        let light: [f64; 5] = std::array::from_fn(|k| sum(&self.look[k]));
        let middle = light[0];
        // Two differences of the same axis are its curvature; its own next term is about the square of it.
        let bend: f64 = [1, 2]
            .map(|k| {
                (light[k] + light[k + 2] - 2.0 * middle).abs()
                    + (light[k] - light[k + 2]).powi(2) / middle.max(1e-300)
            })
            .iter()
            .sum();
        let relative = bend / middle.max(1e-300);
        if !(relative * relative <= 4.0 * tolerance
            || light.iter().sum::<f64>() < FLOOR * tolerance)
        {
            return false;
        }
        let moments = second_moments();
        for k in 0..count {
            let around: f64 = self.look[1..].iter().map(|at| at[k]).sum();
            // ½ f'' ⟨x²⟩ of both axes, f'' from differences over LOOK.
            let bent = (around - 4.0 * self.look[0][k]) / (2.0 * LOOK * LOOK);
            for (profile, moment) in moments.iter().enumerate() {
                let flat = if profile == 0 { self.look[0][k] } else { 0.0 };
                self.sums.values[profile * count + k] = flat + moment * bent;
            }
        }
        let all: f64 = self.sums.values[..count].iter().map(|v| v.abs()).sum();
        let slope = DVec2::new(light[1] - light[3], light[2] - light[4]) / (2.0 * LOOK);
        let first = slope * moments[0];
        self.sums.moments = [all, first.x, first.y, all * moments[0], 0.0, all * moments[0]];
        self.error = 0.1 * relative * relative * all;
        true
    }
}

/// The place of the disc (or of its plane) that a mirror sends to the observer.
pub(in crate::light) fn mirrored(disc: &Disc, to: DVec3) -> Option<DVec2> {
    let from = DVec3::new(-to.x, -to.y, to.z);
    let ahead = from.dot(disc.middle) > 0.0;
    ahead.then(|| DVec2::new(from.dot(disc.u), from.dot(disc.v)) / disc.sine)
}

impl Bell {
    /// A lobe as the observer sees it on the disc; `None` where it has no shape there.
    pub(in crate::light) fn of(lobe: &Lobe, disc: &Disc, to: DVec3) -> Option<Self> {
        let tails = lobe.distribution() == Distribution::Ggx;
        // Near the mirror's image all is linear about that; farther away about the middle.
        let near = mirrored(disc, to).filter(|p| p.length() < 30.0);
        let about = near.unwrap_or(DVec2::ZERO);
        let sun = disc.direction(about);
        let h = sun + to;
        if h.z < 1e-3 * disc.sine {
            return None;
        }
        let (alpha_x, alpha_y) = lobe.alpha();
        let slope = |d: DVec3| {
            let inverse = disc.sine / (h.z * h.z);
            DVec2::new(
                inverse * (d.x * h.z - h.x * d.z) / alpha_x,
                inverse * (d.y * h.z - h.y * d.z) / alpha_y,
            )
        };
        let jacobian = DMat2::from_cols(slope(disc.u), slope(disc.v));
        let axes = jacobian.inverse();
        if !axes.is_finite() {
            return None;
        }
        let here = DVec2::new(h.x / (h.z * alpha_x), h.y / (h.z * alpha_y));
        let peak = if near.is_some() { about } else { -(axes * here) };
        peak.is_finite().then_some(Self { peak, axes, tails })
    }

    /// How far the nearest place of the disc is from the peak, in the bell's units, about.
    fn nearest(&self) -> f64 {
        let beyond = (self.peak.length() - 1.0).max(0.0);
        beyond / self.peak.length().max(1e-300) * (self.axes.inverse() * self.peak).length()
    }

    /// The shortest length over which it changes, in radii of the disc.
    pub(in crate::light) fn scale(&self) -> f64 {
        let [a, b] = [self.axes.x_axis, self.axes.y_axis];
        // The smaller singular value.
        let (sum, determinant) = (a.length_squared() + b.length_squared(), self.axes.determinant());
        let narrow = (0.5 * (sum - (sum * sum - 4.0 * determinant * determinant).max(0.0).sqrt()))
            .max(0.0)
            .sqrt();
        let near = self.nearest();
        if self.tails { narrow * near.max(1.0) } else { narrow / near.max(1.0) }
    }

    /// Whether all of a Gaussian lobe's light on the disc is below the floor.
    fn is_far(&self, lobe: &Lobe, disc: &Disc, to: DVec3) -> bool {
        let near = 0.9 * self.nearest();
        let (x, y) = lobe.alpha();
        // D G/(4 cosθ_o) with tan θ_h below 30 (sec⁴) and G/cosθ_o below 2 of its α.
        let cos = to.z.max(0.1 * x.min(y));
        let most = (1.0 / (PI * x * y * cos)).max(1.0) * 1e6;
        let height = disc.middle.z + disc.sine;
        !self.tails && height > 0.0 && near > 5.0 && most * (-near * near).exp() < FLOOR * 1e-6
    }
}
