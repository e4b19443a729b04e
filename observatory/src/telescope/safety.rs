//! Guard of a mount: what it may point at, and which ways it may take.
//!
//! The Sun's place does not come through the modules that make targets: it is the low-precision formula of the Astronomical Almanac (page C5: 0.01° from 1950 to 2050),
//! from UTC, latitude and longitude alone. What both have in common are clock and site; these are checked on their own ([`Certainty`]).

use super::path::{Frame, angles, direction, wrapped};
use glam::DVec3;
use hifitime::Epoch;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    DeviceError, Mount, MountAbilities, MountAxes, MountClock, MountSite, MountTime,
};
use sunglint_radiometry::sky::Site;
use sunglint_radiometry::station::Horizon;

/// Added to the cone for roundings, deg.
const ROUNDING_DEG: f64 = 1e-6;

/// Reason why a mount must not go, or must stop.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Danger {
    /// The Sun is near the place.
    #[error(
        "the place is {separation_deg:.1}° from the Sun, which stands at {sun_altitude_deg:.1}° altitude: nearer than {limit_deg:.1}°; wait for another pass, or until the Sun is down"
    )]
    Sun {
        /// Distance of the Sun, deg.
        separation_deg: f64,
        /// Least distance, deg.
        limit_deg: f64,
        /// Altitude of the Sun, deg.
        sun_altitude_deg: f64,
    },
    /// The Sun is near a way that the mount may take to the place.
    #[error(
        "on its way the mount could come within {separation_deg:.1}° of the Sun, nearer than {limit_deg:.1}°, and no detour over one other place is free; move it by hand, or wait until the Sun is down{hint}"
    )]
    Way {
        /// Least distance of the Sun from the ways, deg.
        separation_deg: f64,
        /// Least distance allowed, deg.
        limit_deg: f64,
        /// Advice that may help.
        hint: &'static str,
    },
    /// The place is too low.
    #[error(
        "the place is at {altitude_deg:.1}° altitude, lower than the limit of {limit_deg:.1}° there"
    )]
    Low {
        /// Altitude of the place, deg.
        altitude_deg: f64,
        /// Lowest altitude at that azimuth, deg.
        limit_deg: f64,
    },
    /// Not a place.
    #[error("the place is not a number: the mount stays where it is")]
    NotFinite,
    /// Clock in doubt.
    #[error(
        "it is not known how far this computer's clock is from UTC ({why}): the Sun's place would be a guess; set up chrony, or say --trust-clock if you know it to be right"
    )]
    Clock {
        /// Finding.
        why: String,
    },
    /// Sites differ.
    #[error(
        "the mount believes to stand at latitude {mount_deg:?} (latitude, longitude, deg), the station is at {station_deg:?}: set one of them right (--set-site tells the mount)"
    )]
    Site {
        /// Latitude and longitude of the mount, deg.
        mount_deg: [f64; 2],
        /// Latitude and longitude of the station, deg.
        station_deg: [f64; 2],
    },
    /// Clocks differ.
    #[error(
        "the mount's clock is {off_s:+.0} s off: what it takes for a right ascension is elsewhere on the sky; set its clock (--set-site, `set_site` in a plan, tells it site and time)"
    )]
    Time {
        /// Time of the mount less UTC, s.
        off_s: f64,
    },
    /// The clock was set.
    #[error(
        "the computer's clock stepped by {step_ms:.1} ms, more than 10 ms: what the prediction says is not where the target is"
    )]
    ClockStep {
        /// The step, ms.
        step_ms: f64,
    },
}

/// The Sun over a site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunNow {
    /// Direction of its centre in east, north, up, true.
    pub enu: DVec3,
    /// True altitude of its centre, deg.
    pub altitude_deg: f64,
}

/// The Sun from UTC, latitude and longitude (deg, east): Astronomical Almanac, low-precision formulas.
pub fn sun(utc: Epoch, latitude_deg: f64, longitude_deg: f64) -> SunNow {
    let days = utc.to_mjd_utc_days() - 51_544.5;
    let mean = (280.460 + 0.985_647_4 * days).to_radians();
    let anomaly = (357.528 + 0.985_600_3 * days).to_radians();
    let longitude = mean + (1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin()).to_radians();
    let obliquity = (23.439 - 4e-7 * days).to_radians();
    let (sin, cos) = longitude.sin_cos();
    let (x, y, z) = (cos, obliquity.cos() * sin, obliquity.sin() * sin);
    let sidereal = (280.460_618 + 360.985_647_37 * days + longitude_deg).to_radians();
    // Towards the meridian, the west, the pole.
    let meridian = x * sidereal.cos() + y * sidereal.sin();
    let west = x * sidereal.sin() - y * sidereal.cos();
    let (sin_lat, cos_lat) = latitude_deg.to_radians().sin_cos();
    let enu = DVec3::new(-west, z * cos_lat - meridian * sin_lat, z * sin_lat + meridian * cos_lat);
    SunNow { enu, altitude_deg: enu.z.clamp(-1.0, 1.0).asin().to_degrees() }
}

/// Rules about the Sun.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SunCone {
    /// Least distance of the telescope's axis from the Sun, deg.
    pub limit_deg: f64,
    /// Error of the mount's pointing, deg, by which the cone is wider.
    pub pointing_deg: f64,
    /// Whether it holds when the Sun is down, too.
    pub at_night: bool,
}

impl Default for SunCone {
    fn default() -> Self {
        Self { limit_deg: 30.0, pointing_deg: 5.0, at_night: false }
    }
}

impl SunCone {
    /// The cone with another limit, deg.
    #[must_use]
    pub fn with_limit_deg(mut self, limit_deg: f64) -> Self {
        self.limit_deg = limit_deg;
        self
    }

    /// The cone for a mount whose pointing is known to so much, deg.
    #[must_use]
    pub fn with_pointing_deg(mut self, pointing_deg: f64) -> Self {
        self.pointing_deg = pointing_deg;
        self
    }

    fn whole_deg(&self) -> f64 {
        self.limit_deg + self.pointing_deg
    }
}

/// Guard of one mount at one site.
#[derive(Debug, Clone)]
pub struct Guard {
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
    cone: SunCone,
    horizon: Horizon,
    least_altitude_deg: f64,
    /// The mount's axes, and whether it turns over at the meridian; more than one kind where nobody says about which axes it turns.
    kinds: Vec<(Frame, bool)>,
}

/// Largest error of a mount's clock, s: it is half a degree off then, of the five by which ways keep further from the Sun. Clocks that are set by hand are off by less.
const CLOCK_S: f64 = 120.0;
/// Turn of the Earth against the stars, deg/s.
const TURN_DEG_S: f64 = 360.985_647 / 86_400.0;
/// Advice where the axes are not known.
const SAY_AXES: &str = "; about which axes the mount turns is not known, and the ways of both kinds count: say it (--axes, `axes` in a plan)";

impl Guard {
    /// A guard of a mount with these abilities.
    pub fn of(site: &Site, abilities: &MountAbilities, cone: SunCone) -> Self {
        let over = abilities.may_turn_over();
        match abilities.turns_about {
            Some(axes) => Self::new(site, axes, over, cone),
            None => {
                let mut guard = Self::new(site, MountAxes::Equatorial, over, cone);
                let latitude_deg = guard.latitude_deg;
                guard.kinds.push((Frame { axes: MountAxes::Horizontal, latitude_deg }, false));
                guard
            }
        }
    }

    /// A guard of a mount with these axes.
    pub fn new(site: &Site, axes: MountAxes, turns_over: bool, cone: SunCone) -> Self {
        let place = site.geodetic();
        Self {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            height_m: place.height_m,
            cone,
            horizon: Horizon::Flat(0.0),
            least_altitude_deg: 0.0,
            kinds: vec![(Frame { axes, latitude_deg: place.latitude_deg }, turns_over)],
        }
    }

    /// The guard with a horizon, and a lowest altitude, deg.
    #[must_use]
    pub fn with_horizon(mut self, horizon: Horizon, least_altitude_deg: f64) -> Self {
        (self.horizon, self.least_altitude_deg) = (horizon, least_altitude_deg);
        self
    }

    /// The cone.
    pub fn cone(&self) -> SunCone {
        self.cone
    }

    /// The Sun now.
    pub fn sun(&self, utc: Epoch) -> SunNow {
        sun(utc, self.latitude_deg, self.longitude_deg)
    }

    /// Whether the cone holds: some of the Sun's disc can be seen from the site (16′ of radius, 34′ of refraction, the dip of the horizon), and down to −1° in any case.
    pub fn cone_holds(&self, sun: &SunNow) -> bool {
        let dip_deg = 1.76 / 60.0 * self.height_m.max(0.0).sqrt();
        // A hundredth of a degree for the formula.
        let on = self.cone.whole_deg() > 0.0;
        on && (self.cone.at_night || sun.altitude_deg > (-0.844 - dip_deg).min(-1.0) - 0.01)
    }

    /// Distance of a direction (east, north, up) from the Sun, deg.
    pub fn sun_distance_deg(&self, enu: DVec3, utc: Epoch) -> f64 {
        let sun = self.sun(utc).enu;
        sun.cross(enu).length().atan2(sun.dot(enu)).to_degrees()
    }

    /// Whether the telescope may point there: Sun, horizon, lowest altitude.
    ///
    /// # Errors
    /// The reason why not.
    pub fn check_place(&self, enu: DVec3, utc: Epoch) -> Result<(), Danger> {
        self.check_sun(enu, utc)?;
        self.check_low(enu, 0.0)
    }

    /// Whether a place is above the horizon and the lowest altitude, or lower by no more than so much, deg.
    ///
    /// # Errors
    /// It is lower.
    pub fn check_low(&self, enu: DVec3, margin_deg: f64) -> Result<(), Danger> {
        let azimuth = enu.x.atan2(enu.y).to_degrees();
        let altitude_deg = enu.z.clamp(-1.0, 1.0).asin().to_degrees();
        let limit_deg = self.horizon.elevation_deg(azimuth).max(self.least_altitude_deg);
        if altitude_deg < limit_deg - margin_deg {
            return Err(Danger::Low { altitude_deg, limit_deg });
        }
        Ok(())
    }

    /// Whether the telescope may point there for the Sun.
    ///
    /// # Errors
    /// The reason why not.
    pub fn check_sun(&self, enu: DVec3, utc: Epoch) -> Result<(), Danger> {
        if !enu.is_finite() || (enu.length() - 1.0).abs() > 1e-3 {
            return Err(Danger::NotFinite);
        }
        let sun = self.sun(utc);
        let separation_deg = self.sun_distance_deg(enu, utc);
        let limit_deg = self.cone.whole_deg();
        if self.cone_holds(&sun) && separation_deg < limit_deg {
            let sun_altitude_deg = sun.altitude_deg;
            return Err(Danger::Sun { separation_deg, limit_deg, sun_altitude_deg });
        }
        Ok(())
    }

    /// Stations on the way from one direction to another (east, north, up), the end among them: one, or two with a detour. Each leg keeps off the Sun whichever way
    /// the mount takes it: the axes at any speeds (all of the rectangle between the ends), the great circle, over the meridian's flip and round either way.
    /// The Sun moves by less than `slew_s` seconds meanwhile.
    ///
    /// # Errors
    /// The end is no place to point at, or every way to it leads by the Sun.
    pub fn way(
        &self,
        from: DVec3,
        to: DVec3,
        utc: Epoch,
        slew_s: f64,
    ) -> Result<Vec<DVec3>, Danger> {
        self.check_place(to, utc)?;
        let sun = self.sun(utc);
        if !from.is_finite() {
            return Err(Danger::NotFinite);
        }
        let later = utc + hifitime::Duration::from_seconds(slew_s.max(0.0));
        let holds = self.cone_holds(&sun) || self.cone_holds(&self.sun(later));
        if !holds {
            return Ok(vec![to]);
        }
        // The Sun goes on by 15″ a second.
        let limit_deg = self.cone.whole_deg() + 0.0042 * slew_s.max(0.0);
        let direct = self.least_distance_deg(from, to, sun.enu);
        if direct >= limit_deg {
            return Ok(vec![to]);
        }
        let mut best: Option<(f64, DVec3)> = None;
        for altitude in [25.0, 50.0, 75.0] {
            for i in 0..12 {
                let by = direction([f64::from(i) * 30.0, altitude]);
                if self.check_place(by, utc).is_err() {
                    continue;
                }
                let length = from.angle_between(by) + by.angle_between(to);
                if best.is_some_and(|(least, _)| length >= least) {
                    continue;
                }
                let least = |a, b| self.least_distance_deg(a, b, sun.enu);
                if least(from, by) >= limit_deg && least(by, to) >= limit_deg {
                    best = Some((length, by));
                }
            }
        }
        match best {
            Some((_, by)) => Ok(vec![by, to]),
            None => {
                let hint = if self.kinds.len() > 1 { SAY_AXES } else { "" };
                Err(Danger::Way { separation_deg: direct, limit_deg, hint })
            }
        }
    }

    /// The least distance of the Sun from all ways of the mount between two directions, deg; never more than it is.
    fn least_distance_deg(&self, from: DVec3, to: DVec3, sun: DVec3) -> f64 {
        let mut least = great_circle_deg(from, to, sun);
        for (frame, turns_over) in &self.kinds {
            let [a, b] = [from, to].map(|enu| angles(frame.of_enu(enu)));
            let first = wrapped(b[0] - a[0]);
            let mut ends = vec![[a[0] + first, b[1]]];
            let round = match frame.axes {
                // Where the cable's middle lies is not known.
                MountAxes::Horizontal => true,
                MountAxes::Equatorial => first.abs() > 150.0,
            };
            if round {
                ends.push([a[0] + first - 360.0 * first.signum(), b[1]]);
            }
            if *turns_over {
                // The same direction on the other side of the pier: over the elevated pole, towards which the first axis points.
                let over = 180_f64.copysign(self.latitude_deg) - b[1];
                ends.push([a[0] + first - 180.0, over]);
                ends.push([a[0] + first + 180.0, over]);
            }
            for end in ends {
                least = least.min(rectangle_deg(a.to_array(), end, frame.of_enu(sun)));
            }
        }
        least
    }

    /// Whether a mount believes to stand where the station is, within 0.1°.
    ///
    /// # Errors
    /// It does not.
    pub fn check_site(&self, mount: Option<MountSite>) -> Result<(), Danger> {
        let Some(site) = mount else { return Ok(()) };
        let off = wrapped(site.longitude_deg - self.longitude_deg);
        let near = (site.latitude_deg - self.latitude_deg).abs() <= 0.1
            && off.abs() * self.latitude_deg.to_radians().cos() <= 0.1;
        if near {
            return Ok(());
        }
        Err(Danger::Site {
            mount_deg: [site.latitude_deg, site.longitude_deg],
            station_deg: [self.latitude_deg, self.longitude_deg],
        })
    }

    /// Whether a mount reckons with the right time, within two minutes. Its sidereal time is that of the site at which it believes to stand.
    ///
    /// # Errors
    /// It does not.
    pub fn check_time(
        &self,
        mount: Option<MountTime>,
        site: Option<MountSite>,
    ) -> Result<(), Danger> {
        let Some(MountTime { utc, clock }) = mount else { return Ok(()) };
        let off_s = match clock {
            MountClock::SiderealDeg(said_deg) => {
                let days = utc.to_mjd_utc_days() - 51_544.5;
                let longitude_deg = site.map_or(self.longitude_deg, |site| site.longitude_deg);
                let true_deg = 280.460_618 + 360.985_647_37 * days + longitude_deg;
                wrapped(said_deg - true_deg) / TURN_DEG_S
            }
            // One that was told long ago is no fault.
            MountClock::SetTo(said) => (said - utc).to_seconds().max(0.0),
        };
        match off_s.abs() <= CLOCK_S {
            true => Ok(()),
            false => Err(Danger::Time { off_s }),
        }
    }

    /// Returns what is in doubt about a mount that was asked for its site and its time; silence is no doubt.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn doubt(
        &self,
        mount: &mut dyn Mount,
        deadline: &Deadline,
    ) -> Result<Option<Danger>, DeviceError> {
        let site = mount.site(deadline)?;
        // Azimuth and altitude need no clock of the mount's.
        let time = match mount.abilities().axes {
            MountAxes::Horizontal => None,
            _ => mount.time(deadline)?,
        };
        Ok(self.check_site(site).and_then(|()| self.check_time(time, site)).err())
    }
}

/// Certainty of the time.
#[derive(Debug, Clone, PartialEq)]
pub struct Certainty {
    /// Whether the clock follows UTC, as far as is known.
    pub synchronised: Option<bool>,
    /// Largest error of the clock, s, where it is known.
    pub error_s: Option<f64>,
}

impl Certainty {
    /// Whether the clock is known to be right within a second: in that time the fastest target of a low orbit moves by a degree, the Sun by 15″.
    ///
    /// # Errors
    /// It is not known.
    pub fn check(&self) -> Result<(), Danger> {
        let why = match (self.synchronised, self.error_s) {
            (Some(true), Some(error_s)) if error_s > 1.0 => format!("up to {error_s:.1} s wrong"),
            (Some(true), _) => return Ok(()),
            (Some(false), _) => "not synchronised".to_owned(),
            (None, _) => "no chrony or timesyncd answers".to_owned(),
        };
        Err(Danger::Clock { why })
    }
}

/// The least angle of the Sun from the great circle's part between two directions, deg.
fn great_circle_deg(a: DVec3, b: DVec3, sun: DVec3) -> f64 {
    let angle = |x: DVec3| x.cross(sun).length().atan2(x.dot(sun)).to_degrees();
    let ends = angle(a).min(angle(b));
    let Some(normal) = a.cross(b).try_normalize() else { return ends };
    let foot = sun - normal * sun.dot(normal);
    let between = a.cross(foot).dot(normal) >= 0.0 && foot.cross(b).dot(normal) >= 0.0;
    if between { normal.dot(sun).abs().min(1.0).asin().to_degrees() } else { ends }
}

/// The least angle of the Sun from all directions whose angles lie between those of two ends, deg: nothing where the Sun is among them. An axis that is turned beyond its pole
/// points to the other side.
fn rectangle_deg(a: [f64; 2], b: [f64; 2], sun: DVec3) -> f64 {
    let low = [a[0].min(b[0]), a[1].min(b[1])];
    let high = [a[0].max(b[0]), a[1].max(b[1])];
    let s = angles(sun).to_array();
    for s in [s, [s[0] + 180.0, 180.0 - s[1]], [s[0] + 180.0, -180.0 - s[1]]] {
        let within = (low[1]..=high[1]).contains(&s[1]);
        let turns = [-2.0, -1.0, 0.0, 1.0, 2.0]
            .iter()
            .any(|turn| (low[0]..=high[0]).contains(&(s[0] + 360.0 * turn)));
        if within && turns {
            return 0.0;
        }
    }
    // Along each edge the cosine of the Sun's distance is a cosine of the angle that changes, and a constant.
    let (across, up) = (sun.x.hypot(sun.y), sun.z);
    let mut most = -1.0_f64;
    for second in [low[1], high[1]] {
        let (sin, cos) = second.to_radians().sin_cos();
        most = most.max(highest(cos * across, s[0], [low[0], high[0]]) + sin * up);
    }
    for first in [low[0], high[0]] {
        let along = across * (first - s[0]).to_radians().cos();
        let at = up.atan2(along).to_degrees();
        most = most.max(highest(along.hypot(up), at, [low[1], high[1]]));
    }
    most.min(1.0).acos().to_degrees() - ROUNDING_DEG
}

/// The highest value of `size` times the cosine of the distance from an angle, deg, between two others.
fn highest(size: f64, at_deg: f64, [from, to]: [f64; 2]) -> f64 {
    let top = if size < 0.0 { at_deg + 180.0 } else { at_deg };
    let next = from + (top - from).rem_euclid(360.0);
    if next <= to {
        return size.abs();
    }
    let of = |x: f64| size * (x - at_deg).to_radians().cos();
    of(from).max(of(to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telescope::path::direction;

    /// Truth: directions of the rectangle one by one: its edges each 0.02° (the least distance lies between two of them, at most half a step nearer), its inside each 1.5°, where nothing may be nearer than the closed form
    /// says. Random rectangles: beyond the poles, ways of up to 540° about the first axis, the Sun at a pole and on the seam at 0°, and a way that is a point.
    #[test]
    fn the_least_distance_of_a_way_is_that_of_its_directions() {
        let mut state = 1_u64;
        let mut next = |low: f64, high: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            low + (high - low) * (state >> 33) as f64 / (1_u64 << 31) as f64
        };
        let at = |first: f64, second: f64| direction([first, second]);
        let (mut inside, mut outside) = (0, 0);
        for k in 0..120 {
            let a = [next(-360.0, 360.0), next(-130.0, 130.0)];
            let way = [next(-540.0, 540.0), next(-60.0, 60.0)];
            let b = match k % 6 {
                0 => a,
                1 => [a[0] + way[0], a[1]],
                _ => [a[0] + way[0] / 4.0, a[1] + way[1]],
            };
            let part = [next(0.0, 1.0), next(0.0, 1.0)];
            let sun = match k % 5 {
                4 => at(a[0] + part[0] * (b[0] - a[0]), a[1] + part[1] * (b[1] - a[1])),
                0 => at(0.0, 90.0),
                1 => at(0.0, next(-89.0, 89.0)),
                _ => at(next(-180.0, 180.0), next(-89.0, 89.0)),
            };
            let found = rectangle_deg(a, b, sun);
            let apart = |first: f64, second: f64| {
                let seen = at(first, second);
                seen.cross(sun).length().atan2(seen.dot(sun)).to_degrees()
            };
            let steps = |from: f64, to: f64, step: f64| {
                let n = ((to - from).abs() / step).ceil().max(1.0) as usize;
                (0..=n).map(move |i| from + (to - from) * i as f64 / n as f64)
            };
            let mut edges = 180.0_f64;
            for first in steps(a[0], b[0], 0.02) {
                edges = edges.min(apart(first, a[1])).min(apart(first, b[1]));
            }
            for second in steps(a[1], b[1], 0.02) {
                edges = edges.min(apart(a[0], second)).min(apart(b[0], second));
            }
            let mut within = edges;
            for first in steps(a[0], b[0], 1.5) {
                for second in steps(a[1], b[1], 1.5) {
                    within = within.min(apart(first, second));
                }
            }
            if found <= 0.0 {
                inside += 1;
                assert!(within < 1.1, "{k}: {a:?} {b:?}: {within} though the Sun is within");
            } else {
                outside += 1;
                assert!(
                    found <= within + 1e-9 && found > edges - 0.011,
                    "{k}: {a:?} {b:?}: {found} for {edges}, {within}"
                );
            }
        }
        assert!(inside > 10 && outside > 40, "{inside} {outside}");
    }
}
