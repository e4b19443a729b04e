//! How what a body returns is spread over depth.

use super::bounces::Bounced;
use super::cubes::{Array, velocity_aberration};
use super::{Beam, BeamShape, Receiver};
use crate::light::{DirectionError, FacetedEye, Piece, View};
use glam::DVec3;
use sunglint_radiometry::constants::LIGHT_M_PER_S;

/// Triangles are divided until the beam's profile is within this of a line over each, relative to its middle.
const BEAM_TOLERANCE: f64 = 1e-4;
/// At a top hat's edge triangles are divided until they are smaller than this share of its radius: each then lies in it or not.
const EDGE: f64 = 4e-3;
/// Divisions at most.
const MOST_DIVISIONS: u32 = 24;

/// Equal bins of distance from the observer, against that of the body's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthBins {
    /// The near edge of the first bin, m: negative in front of the origin.
    pub from_m: f64,
    /// Width of a bin, m.
    pub step_m: f64,
    /// How many there are.
    pub count: usize,
}

impl DepthBins {
    /// The row of a depth: 0 in front of the first bin, then the bins, then all behind.
    pub(super) fn row(&self, depth_m: f64) -> usize {
        let bin = ((depth_m - self.from_m) / self.step_m).floor();
        (bin.clamp(-1.0, self.count as f64) + 1.0) as usize
    }
}

/// Why there is no profile.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DepthError {
    /// Bins that are none.
    #[error(
        "bins of {step_m} m from {from_m} m, {count} of them: expected finite numbers, a width above 0 and 1 to 1,000,000 bins"
    )]
    Bins {
        /// Where they begin, m.
        from_m: f64,
        /// Their width, m.
        step_m: f64,
        /// Their number.
        count: usize,
    },
    /// A range that is none.
    #[error("the range is {range_m} m, expected more than the body's own size")]
    Range {
        /// Given range, m.
        range_m: f64,
    },
    /// Directions that are none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
}

/// Return of one shot from a body, over depth.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// The bins.
    pub bins: DepthBins,
    /// Mean number of detected photons per shot in each bin, without the air.
    pub photons: Vec<f64>,
    /// Lit and seen area in each bin as it stands across the line of sight, m²: the true depth.
    pub area_m2: Vec<f64>,
    /// Mean number of detected photons per shot, in and out of the bins.
    pub total: f64,
    /// Photons of the total that come from beyond the first or the last bin.
    pub outside: f64,
    /// Photons among all these that corner cubes returned ([`Shot::add_cubes`]).
    pub retro: f64,
    /// Photons among all these that were scattered more than once; `None` where they are not asked for ([`Shot::add_bounces`]).
    pub bounced: Option<Bounced>,
}

/// Where a laser or a telescope stands, from the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// Unit vector from the body towards it, body axes.
    pub toward: DVec3,
    /// Distance from the body's origin, m.
    pub range_m: f64,
}

/// A shot at a body. The depth of what comes back is half of its whole way, from the laser to the telescope, against that by the body's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot<'a> {
    /// The beam.
    pub beam: &'a Beam,
    /// Who catches the light.
    pub receiver: &'a Receiver,
    /// Where the laser is.
    pub laser: Stand,
    /// Where the telescope is: beside the laser, or elsewhere.
    pub telescope: Stand,
    /// Where the beam's axis passes the origin, body axes, m.
    pub off_axis_m: DVec3,
    /// Unit vector to the Sun, to which hinged parts turn, body axes.
    pub sun_body: DVec3,
}

impl Shot<'_> {
    /// Computes the return of the shot, scattered once, without the air. `reflectance[k]` is the spectrum of weight k at the laser's wavelength.
    ///
    /// # Errors
    /// Bins, a range or directions that are none.
    pub fn profile(
        &self,
        eye: &mut FacetedEye<'_>,
        reflectance: &[f64],
        bins: DepthBins,
    ) -> Result<Profile, DepthError> {
        let DepthBins { from_m, step_m, count } = bins;
        let wide = step_m.is_finite() && step_m > 0.0;
        if !(from_m.is_finite() && wide && (1..=1_000_000).contains(&count)) {
            return Err(DepthError::Bins { from_m, step_m, count });
        }
        let shot = self.checked()?;
        let (laser, telescope, sun) = (shot.laser.toward, shot.telescope.toward, self.sun_body);
        let mut sums = Sums {
            shot,
            counts: shot.counts(),
            radius_m: self.beam.spot_radius_m(shot.laser.range_m),
            photons: vec![0.0; count + 2],
            area: vec![0.0; count + 2],
            bins,
        };
        let scene = eye.body().scene();
        let view = View::Distant(telescope);
        eye.pieces(laser, sun, view, &mut |piece, weights| {
            let range = scene.weights_of(piece.material);
            let pairs = weights[range.clone()].iter().zip(&reflectance[range]);
            sums.add(piece, pairs.map(|(w, r)| w * r).sum());
        })?;
        for glint in eye.glints(laser, sun, telescope)? {
            let range = scene.weights_of(glint.material);
            let sum: f64 = glint.weights.iter().zip(&reflectance[range]).map(|(w, r)| w * r).sum();
            sums.point(glint.point_m, sum);
        }
        let total: f64 = sums.photons.iter().sum();
        let outside = sums.photons[0] + sums.photons[count + 1];
        Ok(Profile {
            bins,
            photons: sums.photons[1..=count].to_vec(),
            area_m2: sums.area[1..=count].to_vec(),
            total,
            outside,
            retro: 0.0,
            bounced: None,
        })
    }

    /// Adds the returns of corner cubes to a profile, each at its own depth, and gives their cross-section, m². `velocity_m_s` is the body's against the telescope, body axes. Cubes do not hide one another, and the body hides none.
    ///
    /// # Errors
    /// A range or directions that are none.
    pub fn add_cubes(
        &self,
        array: &Array,
        velocity_m_s: DVec3,
        profile: &mut Profile,
    ) -> Result<f64, DepthError> {
        let shot = self.checked()?;
        let (laser, telescope) = (shot.laser.toward, shot.telescope.toward);
        let offset = velocity_aberration(velocity_m_s, laser) + (telescope - laser);
        let nm = shot.beam.wavelength_nm;
        let counts = shot.counts() / (4.0 * std::f64::consts::PI);
        let mut sum_m2 = 0.0;
        for cube in &array.cubes {
            let sigma = cube.cross_section_m2(nm, laser, offset);
            if sigma <= 0.0 {
                continue;
            }
            sum_m2 += sigma;
            let photons = counts * shot.fluence(cube.position_m) * sigma;
            let row = profile.bins.row(cube.depth_m(nm, laser));
            match profile.photons.get_mut(row.wrapping_sub(1)) {
                Some(bin) => *bin += photons,
                None => profile.outside += photons,
            }
            profile.total += photons;
            profile.retro += photons;
        }
        Ok(sum_m2)
    }

    /// The same with unit vectors.
    pub(super) fn checked(&self) -> Result<Self, DepthError> {
        let stand = |what, Stand { toward, range_m }: Stand| {
            if !(range_m.is_finite() && range_m > 0.0) {
                return Err(DepthError::Range { range_m });
            }
            let none = DirectionError::NoDirection { what, value: toward };
            Ok(Stand { toward: toward.try_normalize().ok_or(none)?, range_m })
        };
        let laser = stand("the direction of the laser", self.laser)?;
        let telescope = stand("the direction of the telescope", self.telescope)?;
        Ok(Self { laser, telescope, ..*self })
    }

    /// Detected photons of a fluence of 1 J m⁻² on what sends 1 m² sr⁻¹.
    pub(super) fn counts(&self) -> f64 {
        let range_m = self.telescope.range_m;
        self.receiver.counts(1.0, self.beam.wavelength_nm) / (range_m * range_m)
    }

    /// The distance of a point from the beam's axis, m.
    fn off_axis(&self, point_m: DVec3) -> f64 {
        let (across, axis) = (point_m - self.off_axis_m, self.laser.toward);
        (across - across.dot(axis) * axis).length()
    }

    /// The fluence at a point, J m⁻².
    pub(super) fn fluence(&self, point_m: DVec3) -> f64 {
        self.beam.fluence_j_m2(self.laser.range_m, self.off_axis(point_m))
    }

    /// The depth of light that meets the body at one point and leaves it at another, without the way between them, m.
    pub(super) fn depth_m(&self, first_m: DVec3, last_m: DVec3) -> f64 {
        -0.5 * (first_m.dot(self.laser.toward) + last_m.dot(self.telescope.toward))
    }
}

impl Profile {
    /// The same through air, on the way up and down, of one transmission each.
    #[must_use]
    pub fn through(mut self, up: f64, down: f64) -> Self {
        self.photons.iter_mut().for_each(|p| *p *= up * down);
        self.total *= up * down;
        self.outside *= up * down;
        self.retro *= up * down;
        self.bounced = self.bounced.map(|b| b.times(up * down));
        self
    }

    /// The probability that the first detected photon of a shot falls into each bin: whoever stops at the first sees the near side too often. Photons from
    /// in front of the first bin are not expected.
    pub fn first_photon(&self) -> Vec<f64> {
        let mut before = 0.0_f64;
        let take = |n: &f64| {
            let p = (-before).exp() * -(-n).exp_m1();
            before += n;
            p
        };
        self.photons.iter().map(take).collect()
    }

    /// The photons as an instrument records them whose answer to a single photon is a normal distribution of `sigma_m` (one way): pulse,
    /// detector and clock.
    pub fn blurred(&self, sigma_m: f64) -> Vec<f64> {
        if sigma_m.is_nan() || sigma_m <= 0.0 {
            return self.photons.clone();
        }
        let edge = |d: f64| 0.5 * libm::erf(d / (sigma_m * std::f64::consts::SQRT_2));
        let step = self.bins.step_m;
        let share = |apart: usize| {
            let d = apart as f64 * step;
            edge(d + 0.5 * step) - edge(d - 0.5 * step)
        };
        let shares: Vec<f64> = (0..self.photons.len()).map(share).collect();
        (0..self.photons.len())
            .map(|to| {
                self.photons.iter().enumerate().map(|(from, n)| n * shares[to.abs_diff(from)]).sum()
            })
            .collect()
    }

    /// The middle of each bin as time after the light from the origin, s: there and back.
    pub fn delays_s(&self) -> Vec<f64> {
        let middle = |k: usize| self.bins.from_m + (k as f64 + 0.5) * self.bins.step_m;
        (0..self.bins.count).map(|k| 2.0 * middle(k) / LIGHT_M_PER_S).collect()
    }

    /// Mean distance from the observer of the photons' origin, against the body's, m; NaN without photons.
    pub fn mean_depth_m(&self) -> f64 {
        let middle = |k: usize| self.bins.from_m + (k as f64 + 0.5) * self.bins.step_m;
        let sum: f64 = self.photons.iter().enumerate().map(|(k, n)| n * middle(k)).sum();
        sum / self.photons.iter().sum::<f64>()
    }
}

struct Sums<'a> {
    shot: Shot<'a>,
    counts: f64,
    radius_m: f64,
    bins: DepthBins,
    /// In front, in each bin, behind.
    photons: Vec<f64>,
    area: Vec<f64>,
}

impl Sums<'_> {
    /// Adds a piece that sends `per_area` \[sr⁻¹\] a square metre of its own.
    fn add(&mut self, piece: &Piece<'_>, per_area: f64) {
        for polygon in piece.polygons() {
            for pair in polygon[1..].windows(2) {
                let corners = [polygon[0], pair[0], pair[1]].map(|p| piece.point(p));
                self.triangle(corners, per_area, piece.to_observer.z, 0);
            }
        }
    }

    /// Adds a point that sends `intensity` \[m² sr⁻¹\].
    fn point(&mut self, point_m: DVec3, intensity: f64) {
        let fluence = self.shot.fluence(point_m);
        let depth = self.shot.depth_m(point_m, point_m);
        self.spread([depth; 3], fluence * intensity * self.counts, 0.0);
    }

    fn triangle(&mut self, [a, b, c]: [DVec3; 3], per_area: f64, cos: f64, depth: u32) {
        let size = (b - a).length().max((c - b).length()).max((a - c).length());
        // The second derivative of a normal profile is at most 4/w² of its middle.
        let bend = 0.5 * (size / self.radius_m).powi(2);
        let middle = (a + b + c) / 3.0;
        let edge = size > EDGE * self.radius_m
            && (self.shot.off_axis(middle) - self.radius_m).abs() < size;
        let uneven = match self.shot.beam.shape {
            BeamShape::Gaussian => bend > BEAM_TOLERANCE,
            BeamShape::TopHat => edge,
        };
        if uneven && depth < MOST_DIVISIONS {
            let (ab, bc, ca) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a));
            for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
                self.triangle(part, per_area, cos, depth + 1);
            }
            return;
        }
        let area = 0.5 * (b - a).cross(c - a).length();
        let fluence = self.shot.fluence(middle);
        let photons = fluence * per_area * area * self.counts;
        let depths = [a, b, c].map(|p| self.shot.depth_m(p, p));
        self.spread(depths, photons, area * cos);
    }

    /// Spreads amounts over the bins as the area of a triangle with these depths lies.
    fn spread(&mut self, mut depths: [f64; 3], photons: f64, area: f64) {
        depths.sort_by(f64::total_cmp);
        let DepthBins { from_m, step_m, .. } = self.bins;
        let (first, last) = (self.bins.row(depths[0]), self.bins.row(depths[2]));
        let mut below = 0.0;
        for row in first..=last {
            let end = from_m + row as f64 * step_m;
            let up_to = if row == last { 1.0 } else { share_below(depths, end) };
            let share = (up_to - below).max(0.0);
            self.photons[row] += photons * share;
            self.area[row] += area * share;
            below = up_to;
        }
    }
}

/// The share of a triangle's area where a linear function with these values at its corners, in order, is below x.
fn share_below([low, middle, high]: [f64; 3], x: f64) -> f64 {
    if x <= low {
        0.0
    } else if x >= high {
        1.0
    } else if x < middle {
        (x - low) * (x - low) / ((middle - low) * (high - low))
    } else {
        1.0 - (high - x) * (high - x) / ((high - low) * (high - middle))
    }
}
