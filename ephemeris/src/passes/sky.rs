//! The sky over a window, on a grid of frames between which only the Earth turns.

use glam::DVec3;
use hifitime::{Duration, Epoch};
use rayon::prelude::*;
use sunglint_radiometry::sky::frame::EARTH_ROTATION_RAD_S;
use sunglint_radiometry::sky::{EarthOrientation, Site, SkyError, SkyFrame, SkyFrames};

/// Seconds between frames: within half of it precession and nutation move by 3e-10 rad.
const STEP_S: f64 = 60.0;

/// Frames and the Sun, shared by all targets.
#[derive(Debug, Clone)]
pub(super) struct Sky {
    pub from: Epoch,
    pub seconds: f64,
    pub latitude_deg: f64,
    /// The site's distance from the Earth's centre, m.
    pub site_m: f64,
    /// The site's speed by the Earth's rotation, eastward, m/s.
    pub speed_m_s: f64,
    site: Site,
    nodes: Vec<Node>,
}

#[derive(Debug, Clone)]
struct Node {
    frame: SkyFrame,
    /// Where the Sun is seen from the Earth's centre, m.
    sun_m: DVec3,
}

impl Sky {
    pub fn new(
        site: &Site,
        from: Epoch,
        seconds: f64,
        orientation: &EarthOrientation,
    ) -> Result<Self, SkyError> {
        let count = (seconds / STEP_S).ceil() as i64 + 1;
        let after =
            |i: i64| from + Duration::from_total_nanoseconds(i128::from(i) * 60_000_000_000);
        let frames = SkyFrames::over(from, after(count), orientation)?;
        let node = |i: i64| {
            let frame = frames.at(after(i))?;
            let sun = frame.sun();
            Ok(Node { frame, sun_m: sun.direction_gcrs * sun.distance_m })
        };
        let nodes = (0..count).into_par_iter().map(node).collect::<Vec<Result<Node, SkyError>>>();
        let nodes = nodes.into_iter().collect::<Result<Vec<Node>, SkyError>>()?;
        let itrs = site.itrs_m();
        Ok(Self {
            from,
            seconds,
            latitude_deg: site.geodetic().latitude_deg,
            site_m: itrs.length(),
            speed_m_s: EARTH_ROTATION_RAD_S * itrs.x.hypot(itrs.y),
            site: *site,
            nodes,
        })
    }

    fn node(&self, t: f64) -> (usize, f64) {
        let i = (t / STEP_S).round().clamp(0.0, (self.nodes.len() - 1) as f64);
        (i as usize, t - i * STEP_S)
    }

    /// The frame nearest to a time.
    pub fn frame(&self, t: f64) -> &SkyFrame {
        &self.nodes[self.node(t).0].frame
    }

    /// A vector with GCRS axes in east, north, up of the site.
    pub fn enu(&self, t: f64, gcrs: DVec3) -> DVec3 {
        let (i, after_s) = self.node(t);
        // Polar motion is 1e-6 rad: about which pole the quarter of a degree is turned does not matter (5e-9 rad).
        let itrs = turned(self.nodes[i].frame.gcrs_to_itrs() * gcrs, -after_s);
        self.site.itrs_to_enu() * itrs
    }

    /// The site's position in the GCRS, m.
    pub fn site_gcrs_m(&self, t: f64) -> DVec3 {
        let (i, after_s) = self.node(t);
        self.nodes[i].frame.itrs_to_gcrs() * turned(self.site.itrs_m(), after_s)
    }

    /// Where the Sun is seen from the Earth's centre, m, GCRS axes.
    pub fn sun_m(&self, t: f64) -> DVec3 {
        let at = (t / STEP_S).clamp(0.0, (self.nodes.len() - 1) as f64);
        let i = (at.floor() as usize).min(self.nodes.len() - 2);
        self.nodes[i].sun_m.lerp(self.nodes[i + 1].sun_m, at - i as f64)
    }

    /// True altitude of the Sun's centre at the site, degrees.
    pub fn sun_altitude_deg(&self, t: f64) -> f64 {
        let enu = self.enu(t, self.sun_m(t) - self.site_gcrs_m(t));
        enu.z.atan2(enu.x.hypot(enu.y)).to_degrees()
    }
}

/// Turned with the Earth for so many seconds, ITRS axes.
fn turned(itrs: DVec3, seconds: f64) -> DVec3 {
    let (sin, cos) = (EARTH_ROTATION_RAD_S * seconds).sin_cos();
    DVec3::new(cos * itrs.x - sin * itrs.y, sin * itrs.x + cos * itrs.y, itrs.z)
}
