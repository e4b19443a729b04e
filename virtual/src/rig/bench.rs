//! The light on the meter, for what is in the beam, an angle and a time.

use super::options::{Options, Sample, SampleKind};
use crate::options::OptionError;
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI};
use sunglint_drivers::device::InBeam;
use sunglint_numerics::gauss::legendre;

/// A rig without its chance: what light there is.
#[derive(Debug, Clone)]
pub struct Bench {
    options: Options,
    standard: Sample,
    /// Directions from the sample into the stop, with their solid angles, sr; z is along the beam.
    cone: Vec<(DVec3, f64)>,
}

impl Bench {
    /// A rig.
    ///
    /// # Errors
    /// Options of which no rig can be made.
    pub fn new(options: Options) -> Result<Self, OptionError> {
        options.check()?;
        let standard = Sample {
            kind: SampleKind::Lambert,
            reflectance: options.standard.reflectance,
            base_reflectance: 0.0,
            ..options.sample
        };
        Ok(Self { cone: cone(&options), standard, options })
    }

    /// Returns the options that it is made of.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The laser's power at the sample's place, W, at a time, s.
    pub fn laser_w(&self, at_s: f64) -> f64 {
        let laser = &self.options.laser;
        1e-3 * laser.power_mw * (1.0 + laser.drift_per_h * at_s / 3600.0).max(0.0)
    }

    /// The part of the beam that meets a sample of the rig's width at an angle of incidence, rad: a Gaussian beam over the width that it sees.
    pub fn caught(&self, theta_rad: f64) -> f64 {
        let half_width = 0.5 * self.options.sample.width_mm * theta_rad.cos().max(0.0);
        let radius = 0.5 * self.options.beam.diameter_mm;
        libm::erf(std::f64::consts::SQRT_2 * half_width / radius)
    }

    /// The part of the incident power that a sample sends through the stop at an angle of incidence, rad: radiance summed over the stop.
    fn through_stop(&self, sample: &Sample, theta_rad: f64) -> f64 {
        // From the beam's axes into the sample's: a turn about y.
        let (sin, cos) = theta_rad.sin_cos();
        let into = |v: DVec3| DVec3::new(cos * v.x + sin * v.z, v.y, cos * v.z - sin * v.x);
        let i = into(DVec3::Z);
        let caught = self.caught(theta_rad);
        let holder = self.options.mount.holder_reflectance * FRAC_1_PI;
        let each = |(o, sr): &(DVec3, f64)| {
            let o = into(*o);
            sr * (caught * sample.radiance(i, o) + (1.0 - caught) * holder * o.z.max(0.0))
        };
        self.cone.iter().map(each).sum()
    }

    /// The light on the meter, W, with the sample turned by `turned_deg` on its stage, at a time, s; before any noise.
    pub fn light_w(&self, place: InBeam, turned_deg: f64, at_s: f64) -> f64 {
        let optics = &self.options.optics;
        let laser = self.laser_w(at_s);
        let theta = (turned_deg - self.options.mount.offset_deg).to_radians();
        let through = optics.splitter_reflectance * optics.lens_transmission;
        let stray = optics.stray * (1.0 + optics.stray_slope_per_deg * turned_deg).max(0.0);
        match place {
            InBeam::Head => laser,
            InBeam::Nothing | InBeam::Through => laser * stray,
            InBeam::Blocked => 0.0,
            InBeam::Sample => {
                laser * (stray + through * self.through_stop(&self.options.sample, theta))
            }
            InBeam::Standard => {
                laser * (stray + through * self.through_stop(&self.standard, theta))
            }
        }
    }

    /// The solid angle of the stop as the sample sees it, sr.
    pub fn stop_sr(&self) -> f64 {
        self.cone.iter().map(|(_, sr)| sr).sum()
    }
}

/// Points on a line or around a circle that a stop is summed over.
const ALONG: usize = 24;
const AROUND: usize = 48;

/// Directions into the stop: points on its plane, with dA cos/r².
fn cone(options: &Options) -> Vec<(DVec3, f64)> {
    let stop = &options.stop;
    let (sin, cos) = stop.tilt_deg.to_radians().sin_cos();
    let (normal, along) = (DVec3::new(sin, 0.0, cos), DVec3::new(cos, 0.0, -sin));
    let middle = DVec3::new(0.0, 0.0, stop.distance_mm);
    let rule = legendre(ALONG);
    let mut points = Vec::new();
    match stop.diameter_mm {
        None => {
            let (half, high) = (0.5 * stop.width_mm, 0.5 * stop.height_mm);
            for (x, wx) in &rule {
                for (y, wy) in &rule {
                    points.push(((half * x, high * y), wx * wy * half * high));
                }
            }
        }
        Some(diameter) => {
            let radius = 0.5 * diameter;
            for (x, w) in &rule {
                let r = 0.5 * radius * (1.0 + x);
                for k in 0..AROUND {
                    let (s, c) = (2.0 * PI * k as f64 / AROUND as f64).sin_cos();
                    let area = 0.5 * radius * w * r * 2.0 * PI / AROUND as f64;
                    points.push(((r * c, r * s), area));
                }
            }
        }
    }
    let direction = |((x, y), area): ((f64, f64), f64)| {
        let p = middle + x * along + y * DVec3::Y;
        let o = p.normalize();
        (o, area * o.dot(normal) / p.length_squared())
    };
    points.into_iter().map(direction).collect()
}
