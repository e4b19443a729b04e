//! Passes of a target over a site: it is above the horizon, in sunlight, and the sky is dark.
//!
//! A [`Search`] holds what all targets share (the sky on a grid of frames, when the night is dark), and finds the [`Pass`]es of one
//! target after the other, or of many side by side. Times are found to a millisecond on the grid's frames, turned on with the
//! Earth; the geometry of a moment that matters is asked from [`Geometry::at`](crate::geometry::Geometry::at) afterwards.

pub mod brightness;
mod crossings;
mod sky;

use crate::orbit::eclipse::{Discs, EarthShape};
use crate::orbit::{Orbit, OrbitError};
use crossings::{Sample, highest, positive};
use glam::DVec3;
use hifitime::{Duration, Epoch};
use sky::Sky;
use std::f64::consts::TAU;
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::sky::{
    EarthOrientation, Horizontal, Site, SkyError, SunPlace, separation_rad,
};
use sunglint_radiometry::station::Horizon;

/// The Earth's gravity, m³/s² (WGS 84).
const GRAVITY_M3_S2: f64 = 3.986_004_418e14;
/// The Earth's rotation rate, rad/s, rounded up.
const EARTH_RATE_RAD_S: f64 = 7.3e-5;
/// By so much more than its elements say an orbit may be fast or high: perturbations, decay.
const MARGIN: f64 = 1.05;
/// The geodetic vertical leaves the geocentric one by less than this, radians.
const VERTICAL_RAD: f64 = 0.004;
/// Steps of a revolution (at its fastest) where a target is near or above the horizon.
const STEPS_A_TURN: f64 = 600.0;

/// Conditions that a pass must meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// The lowest true altitude, degrees; the station's horizon may ask for more.
    pub min_altitude_deg: f64,
    /// The Sun's centre stands lower than this true altitude at the site, degrees.
    pub sun_below_deg: f64,
}

impl Default for Conditions {
    /// 10° high, with the Sun 6° below the horizon (the end of civil twilight).
    fn default() -> Self {
        Self { min_altitude_deg: 10.0, sun_below_deg: -6.0 }
    }
}

/// Why there is no search.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SearchError {
    /// The window ends before it begins, or has no length.
    #[error("the window is {seconds} s long: its end must be after its begin")]
    Window {
        /// Length.
        seconds: f64,
    },
    /// A condition that is no altitude.
    #[error("{what} is {value_deg}°, expected −90° to 90°")]
    Altitude {
        /// Which.
        what: &'static str,
        /// Value.
        value_deg: f64,
    },
    /// The sky has no frame then.
    #[error(transparent)]
    Sky(#[from] SkyError),
}

/// From one time to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Begin.
    pub from: Epoch,
    /// End.
    pub to: Epoch,
}

impl Span {
    /// Length, s.
    pub fn seconds(&self) -> f64 {
        crate::orbit::seconds_between(self.from, self.to)
    }
}

/// A stay above the horizon.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// The stay, cut to the window.
    pub span: Span,
    /// True where it begins with a rise; else the target was up when the window began.
    pub rises: bool,
    /// True where it ends with a set; else it is up when the window ends.
    pub sets: bool,
    /// Epoch of the highest altitude.
    pub culmination: Epoch,
    /// Highest true altitude, degrees.
    pub highest_deg: f64,
    /// Spans in which more than half of the Sun's disc shines on it, during the stay.
    pub sunlit: Vec<Span>,
    /// Spans in which it is sunlit and the sky is dark: it can be seen.
    pub visible: Vec<Span>,
    /// Crossings of the site's meridian, with the lower ones (towards the pole below it) marked.
    pub meridian: Vec<Crossing>,
    /// The fastest that its azimuth changes, degrees per second.
    pub azimuth_rate_deg_s: f64,
}

/// A crossing of the meridian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// When.
    pub epoch: Epoch,
    /// Hour angle 12 h (between pole and horizon) rather than 0 h.
    pub lower: bool,
}

impl Pass {
    /// The moment at which it goes into the Earth's shadow (half the disc hidden) or comes out of it, during the stay.
    pub fn shadow_changes(&self) -> Vec<(Epoch, bool)> {
        let mut changes = Vec::new();
        for lit in &self.sunlit {
            if lit.from != self.span.from {
                changes.push((lit.from, false));
            }
            if lit.to != self.span.to {
                changes.push((lit.to, true));
            }
        }
        changes
    }
}

/// The passes of a target, and why they end early where they do.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// In the order of time.
    pub passes: Vec<Pass>,
    /// From when on the target has no place, and why: it decayed, its table ended.
    pub ended: Option<(Epoch, OrbitError)>,
}

/// View of a target, for figures and for the brightest moment: like [`Geometry`](crate::geometry::Geometry), good to an arcsecond.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetView {
    /// True direction in which it is seen.
    pub horizontal: Horizontal,
    /// Range, m.
    pub range_m: f64,
    /// Angle Sun–target–site, radians.
    pub phase_rad: f64,
    /// Angle between the Sun's centre and the Earth's limb at the target, radians; negative in the shadow.
    pub lit_rad: f64,
    /// The visible part of the Sun's disc.
    pub sunlit: f64,
}

/// Search for passes of any target: built once, used from many threads.
#[derive(Debug, Clone)]
pub struct Search {
    sky: Sky,
    horizon: Horizon,
    pressure: f64,
    conditions: Conditions,
    /// The lowest altitude that is free anywhere, degrees.
    lowest_deg: f64,
    /// Seconds in which the sky is dark.
    dark: Vec<(f64, f64)>,
}

impl Search {
    /// A search from `from` to `to` at a site.
    ///
    /// The horizon is that of what is seen, refracted: its altitudes are taken back by Bennett's refraction (Meeus, Astronomical
    /// Algorithms, 16.3, good to 0.07′) at the mean pressure of the site's height. Costs 5 µs a minute of the window.
    ///
    /// # Errors
    /// A window without length, altitudes that are none, epochs outside the ephemeris.
    pub fn new(
        site: &Site,
        horizon: &Horizon,
        (from, to): (Epoch, Epoch),
        conditions: Conditions,
        orientation: &EarthOrientation,
    ) -> Result<Self, SearchError> {
        let seconds = crate::orbit::seconds_between(from, to);
        if seconds <= 0.0 {
            return Err(SearchError::Window { seconds });
        }
        for (what, value_deg) in [
            ("the lowest altitude", conditions.min_altitude_deg),
            ("the Sun's altitude", conditions.sun_below_deg),
        ] {
            if !(-90.0..=90.0).contains(&value_deg) {
                return Err(SearchError::Altitude { what, value_deg });
            }
        }
        let sky = Sky::new(site, from, seconds, orientation)?;
        let pressure = (-site.geodetic().height_m / 8434.0).exp();
        let lowest = match horizon {
            Horizon::Flat(elevation) => *elevation,
            Horizon::Mask(mask) => mask.iter().map(|m| m.1).fold(f64::INFINITY, f64::min),
        };
        let lowest_deg = true_altitude_deg(lowest, pressure).max(conditions.min_altitude_deg);
        let sun = |t: f64| conditions.sun_below_deg - sky.sun_altitude_deg(t);
        let count = (seconds / 300.0).ceil().max(4.0) as usize;
        let samples: Vec<Sample> = (0..=count)
            .map(|i| seconds * i as f64 / count as f64)
            .map(|t| Sample { t, value: sun(t) })
            .collect();
        let dark = positive(&samples, sun);
        let horizon = horizon.clone();
        Ok(Self { sky, horizon, pressure, conditions, lowest_deg, dark })
    }

    /// The window.
    pub fn window(&self) -> Span {
        self.span((0.0, self.sky.seconds))
    }

    /// The conditions.
    pub fn conditions(&self) -> Conditions {
        self.conditions
    }

    /// Returns the spans in which the sky is dark.
    pub fn dark(&self) -> Vec<Span> {
        self.dark.iter().map(|span| self.span(*span)).collect()
    }

    /// The lowest true altitude at which a target counts as up at an azimuth, degrees.
    pub fn threshold_deg(&self, azimuth_deg: f64) -> f64 {
        let mask = true_altitude_deg(self.horizon.elevation_deg(azimuth_deg), self.pressure);
        mask.max(self.conditions.min_altitude_deg)
    }

    /// Returns the view of the target at an epoch of the window.
    ///
    /// # Errors
    /// The errors of [`Orbit::state`].
    pub fn look(&self, orbit: &Orbit, epoch: Epoch) -> Result<TargetView, OrbitError> {
        self.look_after(orbit, crate::orbit::seconds_between(self.sky.from, epoch))
    }

    /// The stays of a target above the horizon and the lowest altitude, visible or not.
    ///
    /// No stay is missed that lasts longer than a 600th of a revolution (10 s in low orbit), nor a shorter one over a horizon
    /// without steps: far from the horizon the steps are no longer than the fastest that the target can need to it, near it a
    /// maximum between two steps is looked for.
    pub fn passes(&self, orbit: &Orbit) -> Found {
        let bounds = Bounds::of(orbit, self);
        let (samples, ended) = self.scan(orbit, &bounds);
        let value = |t: f64| self.above_deg(orbit, t).unwrap_or(f64::NAN);
        let stays = positive(&samples, value);
        let until = samples.last().map_or(0.0, |s| s.t);
        let mut passes: Vec<Pass> =
            stays.into_iter().filter_map(|stay| self.pass(orbit, stay, &bounds, until)).collect();
        passes.sort_by_key(|p| sunglint_formats::time::tai_nanoseconds(p.span.from));
        Found { passes, ended: ended.map(|(t, error)| (self.epoch(t), error)) }
    }

    /// The moment of a span at which the target is brightest, by a measure of (phase angle in radians, range in metres) in full
    /// sunlight, times the visible part of the Sun's disc.
    pub fn brightest(
        &self,
        orbit: &Orbit,
        span: Span,
        brightness: impl Fn(f64, f64) -> f64,
    ) -> Epoch {
        let at = |epoch: Epoch| {
            let look = self.look(orbit, epoch);
            look.map_or(f64::NEG_INFINITY, |l| l.sunlit * brightness(l.phase_rad, l.range_m))
        };
        self.highest(span, span.seconds() / 48.0, at)
    }

    /// The moment of a span at which a measure is highest: the best of samples that are no further apart than so many seconds, made
    /// better by golden sections to 5 ms. What is shorter than a step may be missed.
    pub fn highest(&self, span: Span, step_s: f64, measure: impl Fn(Epoch) -> f64) -> Epoch {
        let after = |epoch| crate::orbit::seconds_between(self.sky.from, epoch);
        let (a, b) = (after(span.from), after(span.to));
        // A day by milliseconds is the most that can be meant.
        let count = ((b - a) / step_s).ceil().clamp(2.0, 1e8) as usize;
        let at = |t: f64| measure(self.epoch(t));
        let samples: Vec<Sample> = (0..=count)
            .map(|i| a + (b - a) * i as f64 / count as f64)
            .map(|t| Sample { t, value: at(t) })
            .collect();
        self.epoch(highest(&samples, at).t)
    }

    /// Samples of the altitude above the threshold over the window.
    fn scan(&self, orbit: &Orbit, bounds: &Bounds) -> (Vec<Sample>, Option<(f64, OrbitError)>) {
        let mut samples = Vec::new();
        let mut t = bounds.from_s;
        loop {
            let (enu, position) = match self.enu(orbit, t) {
                Ok(found) => found,
                Err(error) => return (samples, Some((t, error))),
            };
            samples.push(Sample { t, value: self.above_of(enu) });
            if t >= bounds.to_s {
                return (samples, None);
            }
            let away_rad = separation_rad(self.sky.site_gcrs_m(t), position) - bounds.cap_rad;
            let step_s = (away_rad / bounds.rate_rad_s).max(bounds.step_s);
            t = (t + step_s).min(bounds.to_s);
        }
    }

    fn pass(&self, orbit: &Orbit, stay: (f64, f64), bounds: &Bounds, until: f64) -> Option<Pass> {
        let (from, to) = stay;
        let count = ((to - from) / bounds.step_s).ceil().clamp(8.0, 1e6) as usize;
        let times: Vec<f64> =
            (0..=count).map(|i| from + (to - from) * i as f64 / count as f64).collect();
        let looks: Vec<TargetView> =
            times.iter().map(|t| self.look_after(orbit, *t).ok()).collect::<Option<_>>()?;
        let samples = |value: &dyn Fn(&TargetView) -> f64| -> Vec<Sample> {
            times.iter().zip(&looks).map(|(t, l)| Sample { t: *t, value: value(l) }).collect()
        };
        let of = |value: fn(&TargetView) -> f64| {
            move |t: f64| self.look_after(orbit, t).map_or(f64::NAN, |l| value(&l))
        };
        let altitude = |l: &TargetView| l.horizontal.altitude_deg();
        let top = highest(&samples(&altitude), of(altitude));
        let lit = |l: &TargetView| l.lit_rad;
        let sunlit = positive(&samples(&lit), of(lit));
        let visible = intersection(&sunlit, &self.dark);
        let east = |l: &TargetView| l.horizontal.east_north_up().x;
        let mut meridian = Vec::new();
        for (a, b) in positive(&samples(&east), of(east)) {
            for t in [a, b] {
                if t > from && t < to {
                    let lower = self.is_lower(self.look_after(orbit, t).ok()?.horizontal);
                    meridian.push(Crossing { epoch: self.epoch(t), lower });
                }
            }
        }
        meridian.sort_by_key(|c| sunglint_formats::time::tai_nanoseconds(c.epoch));
        // The azimuth turns fastest where it stands highest.
        let azimuth = |t: f64| {
            self.look_after(orbit, t.clamp(from, to)).ok().map(|l| l.horizontal.east_north_up())
        };
        let (a, b) = (azimuth(top.t - 0.05)?, azimuth(top.t + 0.05)?);
        let turned = (a.x * b.y - a.y * b.x).atan2(a.x * b.x + a.y * b.y).abs().to_degrees();
        let apart = (top.t + 0.05).min(to) - (top.t - 0.05).max(from);
        Some(Pass {
            span: self.span(stay),
            rises: from > bounds.from_s,
            sets: to < until,
            culmination: self.epoch(top.t),
            highest_deg: top.value,
            sunlit: sunlit.iter().map(|s| self.span(*s)).collect(),
            visible: visible.iter().map(|s| self.span(*s)).collect(),
            meridian,
            azimuth_rate_deg_s: if apart > 0.0 { turned / apart } else { 0.0 },
        })
    }

    /// Whether a direction on the meridian is beyond the pole: hour angle 12 h.
    fn is_lower(&self, horizontal: Horizontal) -> bool {
        horizontal.hour_angle_deg(self.sky.latitude_deg).abs() > 90.0
    }

    /// The line to the target in east, north, up as it is seen, m, and the target's position in the GCRS then.
    fn enu(&self, orbit: &Orbit, t: f64) -> Result<(DVec3, DVec3), OrbitError> {
        let state = orbit.state(self.epoch(t), self.sky.frame(t))?;
        let site_m = self.sky.site_gcrs_m(t);
        let mut line = state.position_m - site_m;
        for _ in 0..2 {
            let late_s = line.length() / LIGHT_M_PER_S;
            line = state.position_m - state.velocity_m_s * late_s - site_m;
        }
        let enu = self.sky.enu(t, line);
        // Aberration by the site's own motion, eastward.
        let seen = enu + DVec3::X * (self.sky.speed_m_s / LIGHT_M_PER_S * enu.length());
        Ok((seen, line + site_m))
    }

    fn above_of(&self, enu: DVec3) -> f64 {
        let altitude_deg = enu.z.atan2(enu.x.hypot(enu.y)).to_degrees();
        if altitude_deg < self.lowest_deg {
            // No azimuth is needed: the threshold is nowhere lower.
            return altitude_deg - self.lowest_deg;
        }
        let azimuth_deg = enu.x.atan2(enu.y).to_degrees();
        altitude_deg - self.threshold_deg(azimuth_deg)
    }

    fn above_deg(&self, orbit: &Orbit, t: f64) -> Result<f64, OrbitError> {
        self.enu(orbit, t).map(|(enu, _)| self.above_of(enu))
    }

    fn look_after(&self, orbit: &Orbit, t: f64) -> Result<TargetView, OrbitError> {
        let (enu, position_m) = self.enu(orbit, t)?;
        let to_sun = self.sky.sun_m(t) - position_m;
        let distance_m = to_sun.length();
        let sun = SunPlace { direction_gcrs: to_sun / distance_m, distance_m };
        let discs = Discs::at(position_m, &sun, EarthShape::default());
        let line = position_m - self.sky.site_gcrs_m(t);
        Ok(TargetView {
            // The line has a length: a target at the site has no orbit.
            horizontal: Horizontal::of_enu(enu).unwrap_or(Horizontal::new(0.0, 90.0)),
            range_m: line.length(),
            phase_rad: separation_rad(to_sun, -line),
            lit_rad: discs.separation_rad - discs.earth_rad,
            sunlit: discs.visible_fraction(),
        })
    }

    fn epoch(&self, t: f64) -> Epoch {
        self.sky.from + Duration::from_total_nanoseconds((t * 1e9).round() as i128)
    }

    fn span(&self, (from, to): (f64, f64)) -> Span {
        Span { from: self.epoch(from), to: self.epoch(to) }
    }
}

/// Bounds on the speed of a target's rise, and on where it can be seen at all.
struct Bounds {
    from_s: f64,
    to_s: f64,
    /// The fastest that its direction from the Earth's centre moves over the ground, rad/s.
    rate_rad_s: f64,
    /// The largest angle at the Earth's centre between site and target at which it can be up.
    cap_rad: f64,
    step_s: f64,
}

impl Bounds {
    fn of(orbit: &Orbit, search: &Search) -> Self {
        let seconds = search.sky.seconds;
        match orbit {
            Orbit::Tle(tle) => {
                let elements = tle.tle();
                let n = TAU / elements.period_s();
                let e = elements.eccentricity;
                let axis_m = (GRAVITY_M3_S2 / (n * n)).cbrt();
                // Angular rate at the perigee, and the apogee's distance.
                let rate = MARGIN * n * (1.0 + e).sqrt() / (1.0 - e).powf(1.5);
                let apogee_m = MARGIN * axis_m * (1.0 + e);
                let site_m = search.sky.site_m;
                let low = search.lowest_deg.to_radians() - VERTICAL_RAD;
                // Far below the horizon the Earth is no bound: then every moment is looked at.
                let cap_rad = if low < -0.1 {
                    TAU
                } else {
                    (site_m / apogee_m * low.cos()).min(1.0).acos() - low
                };
                let step_s = (TAU / rate / STEPS_A_TURN).clamp(1.0, 120.0);
                let rate_rad_s = rate + EARTH_RATE_RAD_S;
                Self { from_s: 0.0, to_s: seconds, rate_rad_s, cap_rad, step_s }
            }
            Orbit::Ephemeris(table) => {
                let after = |epoch| crate::orbit::seconds_between(search.sky.from, epoch);
                let (first, last) = table.range();
                let (from_s, to_s) = (after(first).max(0.0), after(last).min(seconds));
                // A table has no elements to bound it: it is followed closely.
                let step_s = ((to_s - from_s) / 4000.0).clamp(1.0, 10.0);
                Self { from_s, to_s, rate_rad_s: 1.0, cap_rad: TAU, step_s }
            }
            // One moment is no pass: nothing is looked for.
            Orbit::Snapshot(_) => {
                Self { from_s: 0.0, to_s: 0.0, rate_rad_s: 1.0, cap_rad: TAU, step_s: 1.0 }
            }
        }
    }
}

/// The true altitude of what is seen at an apparent one, degrees (Bennett 1982; pressure in units of 1010 hPa).
fn true_altitude_deg(apparent_deg: f64, pressure: f64) -> f64 {
    let h = apparent_deg.max(-1.0);
    let arcmin = 1.0 / (h + 7.31 / (h + 4.4)).to_radians().tan();
    apparent_deg - pressure * arcmin.max(0.0) / 60.0
}

fn intersection(a: &[(f64, f64)], b: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let both = a.iter().flat_map(|x| b.iter().map(move |y| (x.0.max(y.0), x.1.min(y.1))));
    both.filter(|(from, to)| to > from).collect()
}
