//! The mount of a virtual night: where it points decides where the target stands in the frames and how much of its light a fibre gets.
//!
//! The telescope is [`crate::telescope`]'s. Where the targets stand comes from catalogue and elements, late and beside their track as the options say.

use super::options::MountOptions;
use crate::telescope::{Telescope, TelescopeOptions, VirtualMount};
use glam::{DVec2, DVec3};
use hifitime::{Epoch, Unit};
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{
    Device, DeviceError, Identity, Mount, MountAbilities, MountAxes, MountKnown, MountPlace,
    MountReading, MountSite, MountTime, Setting,
};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, elements};
use sunglint_formats::session::Target;
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Equatorial, Observer, Site, SkyError, SkyFrames, Star,
};

/// Time between two places of a target, s; between them it moves along a chord.
const NODE_S: f64 = 0.25;
/// A target that is farther from the axis stands here, px.
const FAR_PX: f64 = 1e5;
const ARCSEC: f64 = 206_264.806_247;

/// A target with a place on the sky.
#[derive(Debug, Clone)]
enum Body {
    Star(Box<Star>),
    Orbit(Box<Orbit>),
}

impl Body {
    fn of(target: &Target) -> Option<Self> {
        if let Some(text) = target.elements() {
            let sets = elements::parse("the visit's elements", &text).ok()?;
            let orbit = TleOrbit::new(sets.into_iter().next()?).ok()?;
            return Some(Self::Orbit(Box::new(orbit.into())));
        }
        if let Ok(star) = Catalogue::embedded().find(&target.name) {
            return Some(Self::Star(Box::new(star.clone())));
        }
        let place = Equatorial { ra_deg: target.ra_deg?, dec_deg: target.dec_deg? };
        Some(Self::Star(Box::new(Star::at(&target.name, place).ok()?)))
    }
}

/// A telescope on a mount, and the sky over it.
#[derive(Clone)]
pub struct Driven {
    telescope: Telescope,
    /// Moved by whoever asks for a later time.
    hand: Arc<VirtualClock>,
    turning: Arc<Mutex<()>>,
    start: Epoch,
    site: Site,
    frames: Arc<SkyFrames<'static>>,
    bodies: Arc<Vec<Option<Body>>>,
    options: MountOptions,
    scale_arcsec: f64,
    /// The last two places that were asked for: visit, number of the node, and directions.
    near: Option<(usize, i64, [DVec3; 2])>,
}

impl fmt::Debug for Driven {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Driven").field("options", &self.options).finish_non_exhaustive()
    }
}

impl Driven {
    /// A telescope for the targets of a night's visits, in their order, until `end`. A pixel of its camera sees `scale_arcsec`.
    ///
    /// # Errors
    /// The night lies outside of the Earth's orientation tables.
    pub fn new(
        options: &MountOptions,
        site: &Site,
        (start, end): (Epoch, Epoch),
        targets: &[Target],
        scale_arcsec: f64,
        seed: u64,
    ) -> Result<Self, SkyError> {
        let hand = Arc::new(VirtualClock::new());
        let place = site.geodetic();
        let made = TelescopeOptions::default().with(|o| {
            o.axes = match options.equatorial {
                true => MountAxes::Equatorial,
                false => MountAxes::Horizontal,
            };
            o.site_deg = [place.latitude_deg, place.longitude_deg];
            o.past_meridian_deg = options.past_meridian_deg;
            o.fastest_deg_s = options.fastest_deg_s;
            o.acceleration_deg_s2 = options.acceleration_deg_s2;
            o.backlash_arcsec = options.backlash_arcsec;
            o.periodic_arcsec = options.periodic_arcsec;
            o.worm_deg = options.worm_deg;
            o.encoder_arcsec = options.encoder_arcsec;
            o.tilt_arcsec = options.tilt_arcsec;
            o.wind_arcsec = options.wind_arcsec;
            o.latency_s = [options.latency_s, options.latency_jitter_s].into();
            o.dropped = options.dropped;
            o.seed = seed;
            // The night's own camera sees; this one has no finder.
            o.frame_s = 1e9;
        });
        let clock = DeviceClock { clock: hand.clone(), zero_utc: Some(start) };
        let telescope = Telescope::new(made, clock, Arc::new(|_| None)).with_history();
        let hour = 1.0 * Unit::Hour;
        let frames = SkyFrames::over(start - hour, end + hour, EarthOrientation::embedded())?;
        Ok(Self {
            telescope,
            hand,
            turning: Arc::default(),
            start,
            site: *site,
            frames: Arc::new(frames),
            bodies: Arc::new(targets.iter().map(Body::of).collect()),
            options: options.clone(),
            scale_arcsec,
            near: None,
        })
    }

    /// The mount. Its time is that of the deadlines of its calls.
    pub fn mount(&self) -> DrivenMount {
        DrivenMount { mount: self.telescope.mount(), driven: self.clone() }
    }

    /// Turns the motors up to a time after the start.
    fn advance(&self, now: Duration) {
        let _turning = self.turning.lock().unwrap_or_else(PoisonError::into_inner);
        self.hand.sleep(now.saturating_sub(self.hand.now()));
        self.telescope.advance();
    }

    /// Direction in which a target's light arrives, in east, north, up.
    fn arrives(&self, body: &Body, time_s: f64) -> Option<DVec3> {
        let seen = |time_s: f64| {
            let epoch = self.start + time_s * Unit::Second;
            let observer = Observer::new(self.frames.at(epoch).ok()?, &self.site);
            let horizontal = match body {
                Body::Star(star) => observer.star(star).horizontal,
                Body::Orbit(orbit) => Geometry::at(orbit, &observer).ok()?.horizontal,
            };
            Some(horizontal.east_north_up())
        };
        let mut enu = match body {
            Body::Star(_) => seen(time_s)?,
            Body::Orbit(_) => {
                let late_s = time_s - self.options.late_s;
                let (here, soon) = (seen(late_s)?, seen(late_s + 0.1)?);
                let across = here.cross(soon).try_normalize()?;
                (here + across * (self.options.across_arcsec / ARCSEC)).normalize()
            }
        };
        // Refraction by the textbook's two terms (58.3″ tan z − 0.067″ tan³ z), air of 1010 hPa and 10 °C at sea level.
        let flat = enu.x.hypot(enu.y);
        if flat > 1e-9 && enu.z > 0.05 {
            let tan = flat / enu.z;
            let thin = (-self.site.geodetic().height_m / 8400.0).exp();
            let lift = (58.3 * tan - 0.067 * tan.powi(3)) * thin / ARCSEC;
            enu = (enu + lift * DVec3::new(-enu.x / tan, -enu.y / tan, flat)).normalize();
        }
        Some(enu)
    }

    /// Where the target of a visit stands at a time, px from the middle of the sensor: columns and rows. `None` of a target without a place.
    pub fn offset_px(&mut self, visit: usize, time_s: f64) -> Option<DVec2> {
        let bodies = self.bodies.clone();
        let body = bodies.get(visit)?.as_ref()?;
        let node = (time_s / NODE_S).floor();
        let number = node as i64;
        let ends = match &self.near {
            Some((of, at, ends)) if (*of, *at) == (visit, number) => *ends,
            _ => {
                let a = self.arrives(body, node * NODE_S)?;
                let b = self.arrives(body, (node + 1.0) * NODE_S)?;
                self.near = Some((visit, number, [a, b]));
                [a, b]
            }
        };
        let part = time_s / NODE_S - node;
        let light = (ends[0] + part * (ends[1] - ends[0])).normalize();
        self.advance(Duration::from_secs_f64(time_s.max(0.0)));
        let axes = self.telescope.axes_at(time_s)?;
        let depth = light.dot(axes.z_axis);
        if depth < 0.1 {
            return Some(DVec2::splat(FAR_PX));
        }
        let [first, second] =
            [axes.x_axis, axes.y_axis].map(|axis| ARCSEC * light.dot(axis) / depth);
        let turn = self.options.camera_angle_deg.to_radians();
        let right = (first * turn.cos() + second * turn.sin()) / self.scale_arcsec;
        let down = (first * turn.sin() - second * turn.cos()) / self.scale_arcsec;
        let column = if self.options.camera_mirrored { -right } else { right };
        Some([column, down].map(|px| px.clamp(-FAR_PX, FAR_PX)).into())
    }
}

/// The mount of a virtual night.
pub struct DrivenMount {
    mount: VirtualMount,
    driven: Driven,
}

impl DrivenMount {
    fn at(&mut self, deadline: &Deadline) -> &mut VirtualMount {
        self.driven.advance(deadline.now());
        &mut self.mount
    }
}

impl Device for DrivenMount {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.at(deadline).identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.at(deadline).settings(deadline)
    }
}

impl Mount for DrivenMount {
    fn abilities(&self) -> &MountAbilities {
        self.mount.abilities()
    }

    fn know(&mut self, known: &MountKnown) {
        self.mount.know(known);
    }

    fn reading(&mut self, deadline: &Deadline) -> Result<MountReading, DeviceError> {
        self.at(deadline).reading(deadline)
    }

    fn begin_goto(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).begin_goto(place, deadline)
    }

    fn sync(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).sync(place, deadline)
    }

    fn set_tracking(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).set_tracking(on, deadline)
    }

    fn learn_senses(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).learn_senses(beat, deadline)
    }

    fn set_rates(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).set_rates(deg_s, deadline)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).stop(deadline)
    }

    fn set_parked(&mut self, parked: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.at(deadline).set_parked(parked, deadline)
    }

    fn site(&mut self, deadline: &Deadline) -> Result<Option<MountSite>, DeviceError> {
        self.at(deadline).site(deadline)
    }

    fn time(&mut self, deadline: &Deadline) -> Result<Option<MountTime>, DeviceError> {
        self.at(deadline).time(deadline)
    }

    fn set_site(
        &mut self,
        site: MountSite,
        utc: Epoch,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.at(deadline).set_site(site, utc, deadline)
    }
}
