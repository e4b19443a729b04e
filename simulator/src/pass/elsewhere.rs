//! Another site than the station, as the target sees it.

use super::simulate::first_error;
use super::{Pass, PassError, Place};
use glam::DVec3;
use rayon::prelude::*;
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::sky::{Observer, Site};

/// A site from which light goes to the target, to be reflected at the time of a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elsewhere {
    /// Unit vector from the target towards it, body axes, in the rest frame of the body.
    pub toward_body: DVec3,
    /// Length of the way, m.
    pub range_m: f64,
    /// True zenith angle of the target there, degrees.
    pub zenith_deg: f64,
    /// Angle between site, target and station, degrees.
    pub apart_deg: f64,
}

impl Pass {
    /// A site from which light leaves so early that the target reflects it to the station at the places' times.
    ///
    /// # Errors
    /// Epochs without an orientation of the Earth; a target at the site.
    pub fn elsewhere(&self, site: &Site, places: &[Place]) -> Result<Vec<Elsewhere>, PassError> {
        let epochs = || places.iter().map(|p| p.geometry.epoch);
        let (Some(first), Some(last)) = (epochs().min(), epochs().max()) else {
            return Ok(Vec::new());
        };
        let frames = self.frames(first, last)?;
        let one = |place: &Place| -> Result<Elsewhere, PassError> {
            let geometry = &place.geometry;
            let there = Observer::new(frames.at(geometry.epoch)?, site);
            let target = geometry.target.position_m;
            // Where the site was before both light times, to 1e-5 m: its acceleration is 0.03 m/s².
            let up_m = (there.position_gcrs_m() - target).length();
            let ago_s = geometry.light_time_s() + up_m / LIGHT_M_PER_S;
            let line = there.position_gcrs_m() - ago_s * there.velocity_gcrs_m_s() - target;
            let range_m = line.length();
            let toward = line / range_m;
            // Aberration turns what arrives towards the velocity, and what leaves against it: 2v/c apart even for one site.
            let seen = toward + geometry.target.velocity_m_s / LIGHT_M_PER_S;
            Ok(Elsewhere {
                toward_body: (place.body_to_gcrs.conjugate() * seen).normalize(),
                range_m,
                zenith_deg: there.horizontal_of(-toward)?.zenith_deg(),
                apart_deg: toward.angle_between(geometry.to_observer).to_degrees(),
            })
        };
        first_error(places.par_iter().map(one).collect())
    }
}
