//! Another site than the station, as the target sees it.

use super::simulate::first_error;
use super::{Pass, PassError, Place};
use glam::DVec3;
use hifitime::Duration;
use rayon::prelude::*;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{in_tai, seconds_between};
use sunglint_formats::time::format_utc_shortest;
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

/// Light that leaves a site, meets the body's origin and returns to the station, through no air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoWay {
    /// When it leaves, s after the first of the pass's times.
    pub sent_s: f64,
    /// How long it is on its way, s.
    pub flight_s: f64,
}

impl Pass {
    /// Ways of light from a site (the station's where none is given) to the target's origin and to the station, which arrive at `count` (2 and more) equal steps of time
    /// from the first to the last of the pass's times. Light times are those of straight lines in the GCRS at the speed of light in vacuum.
    ///
    /// # Errors
    /// Epochs without an orientation of the Earth, or at which the target has no place.
    pub fn two_ways(&self, site: Option<&Site>, count: usize) -> Result<Vec<TwoWay>, PassError> {
        let way = self.way()?;
        let (first, last) = self.ends();
        let step_s = seconds_between(first, last) / count.saturating_sub(1).max(1) as f64;
        let one = |i: usize| -> Result<TwoWay, PassError> {
            let after_ns = (i as f64 * step_s * 1e9).round();
            let epoch = in_tai(first) + Duration::from_total_nanoseconds(after_ns as i128);
            let (frames, orbit, later) = way.parts();
            let station = Observer::new(frames.at(epoch + later)?, &self.station.site);
            let geometry = Geometry::over(orbit, &station, self.shadow.unwrap_or_default());
            let geometry = geometry.map_err(|source| {
                let epoch_utc = format_utc_shortest(epoch);
                PassError::Geometry { epoch_utc, source: Box::new(source) }
            })?;
            let there =
                site.map(|site| Observer::new(station.frame().clone(), site)).unwrap_or(station);
            let (place, velocity) = (there.position_gcrs_m(), there.velocity_gcrs_m_s());
            // The ground turns about the Earth's axis: what is left out is below 1e-6 m within 3 s.
            let turning = there.frame().earth_rotation_gcrs_rad_s().cross(velocity);
            let mut up_m = (place - geometry.target.position_m).length();
            for _ in 0..3 {
                let ago_s = (geometry.range_m + up_m) / LIGHT_M_PER_S;
                let then = place - ago_s * velocity + 0.5 * ago_s * ago_s * turning;
                up_m = (then - geometry.target.position_m).length();
            }
            let flight_s = (geometry.range_m + up_m) / LIGHT_M_PER_S;
            Ok(TwoWay { sent_s: after_ns * 1e-9 - flight_s, flight_s })
        };
        first_error((0..count).into_par_iter().map(one).collect())
    }

    /// A site from which light leaves so early that the target reflects it to the station at the places' times.
    ///
    /// # Errors
    /// Epochs without an orientation of the Earth; a target at the site.
    pub fn elsewhere(&self, site: &Site, places: &[Place]) -> Result<Vec<Elsewhere>, PassError> {
        let frames = self.frames(places.iter().map(|p| p.geometry.epoch), 0.0)?;
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
