//! Path of a target over a site, in the axes of a mount: calculated once, then cheap.

use glam::DVec3;
use hifitime::{Epoch, Unit};
use std::collections::VecDeque;
use sunglint_drivers::device::{MountAxes, MountPlace, MountReading};
use sunglint_ephemeris::geometry::GeometryError;
use sunglint_ephemeris::motion::{AxisMotion, Motion, equatorial_axes, horizontal_axes};
use sunglint_ephemeris::orbit::Orbit;
use sunglint_numerics::axes::Axes;
use sunglint_radiometry::sky::{
    AzimuthAltitude, EarthOrientation, Observer, Site, SkyError, SkyFrames, Star,
};

/// Time between two points of a path, s. Between them a cubic through places and rates errs by (1 s · ω)⁴/384: 5e-5″ at 1 °/s.
const STEP_S: f64 = 0.5;
/// Turn of the Earth against the stars, deg/s.
const SIDEREAL_DEG_S: f64 = 360.985_647_366 / 86_400.0;
/// How far a path is known beyond its ends, points: a minute, as far as the target is searched there. Beyond it goes on straight.
const MARGIN: usize = 120;
/// Farthest that a model of the pointing may move a direction, deg: the distance from the Sun is kept by what the mount shows, with 5° more for its pointing.
const MOST_MAPPED_DEG: f64 = 4.0;
/// Longest path, s.
const MOST_S: f64 = 86_400.0;

/// Why there is no path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// The target has no place.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The sky has none.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// A model of the pointing of another kind of mount.
    #[error(
        "the model of the pointing is of a mount with {expected:?} axes, this one has {found:?} axes: measure it anew"
    )]
    Axes {
        /// Axes of the mount.
        found: MountAxes,
        /// Axes of the model.
        expected: MountAxes,
    },
    /// A model of the pointing of a mount that is far off.
    #[error(
        "by the model of its pointing the mount is {off_deg:.1}° off, expected at most {most_deg}°: sync it, and measure the model anew"
    )]
    Far {
        /// How far, deg.
        off_deg: f64,
        /// Largest that is taken, deg.
        most_deg: f64,
    },
    /// A span that is none.
    #[error("a path of {found_s} s, expected more than 0 and at most {most_s} s")]
    Span {
        /// The span that was asked for, s.
        found_s: f64,
        /// The longest, s.
        most_s: f64,
    },
}

/// Axes of a mount at a site, without its errors: how directions and angles go together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The axes.
    pub axes: MountAxes,
    /// Geodetic latitude of the site, deg.
    pub latitude_deg: f64,
}

impl Frame {
    /// A direction in east, north, up, in the mount's axes.
    pub fn of_enu(self, enu: DVec3) -> DVec3 {
        match self.axes {
            MountAxes::Horizontal => enu,
            MountAxes::Equatorial => equatorial_axes(enu, self.latitude_deg),
        }
    }

    /// A direction in the mount's axes, in east, north, up.
    pub fn to_enu(self, direction: DVec3) -> DVec3 {
        match self.axes {
            MountAxes::Horizontal => direction,
            MountAxes::Equatorial => horizontal_axes(direction, self.latitude_deg),
        }
    }
}

/// The direction at two angles of the axes, deg.
pub fn direction(angle_deg: impl Into<Axes>) -> DVec3 {
    let angle_deg = angle_deg.into();
    let (sin1, cos1) = angle_deg[0].to_radians().sin_cos();
    let (sin2, cos2) = angle_deg[1].to_radians().sin_cos();
    DVec3::new(cos2 * sin1, cos2 * cos1, sin2)
}

/// The two angles of a direction in the axes, deg.
pub fn angles(direction: DVec3) -> Axes {
    AxisMotion::of(direction, DVec3::ZERO).angle_deg
}

/// An angle from −180 to 180 deg.
pub fn wrapped(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

/// Refraction's lift of a true altitude in air of 1010 hPa and 10 °C, deg: Sæmundsson 1986 (Sky and Telescope 72, 70), good to 0.1′ above 5°.
fn lift_deg(altitude_deg: f64) -> f64 {
    let h = altitude_deg.max(-1.0);
    1.02 / 60.0 / (h + 10.3 / (h + 5.11)).to_radians().tan()
}

/// The refracted direction of a true one, for air of a station at this height.
fn refracted(enu: DVec3, height_m: f64) -> DVec3 {
    let flat = enu.x.hypot(enu.y);
    if flat < 1e-12 {
        return enu;
    }
    let altitude = enu.z.atan2(flat).to_degrees();
    let air = (-height_m / 8400.0).exp();
    let lifted = (altitude + lift_deg(altitude) * air).to_radians();
    DVec3::new(enu.x / flat * lifted.cos(), enu.y / flat * lifted.cos(), lifted.sin())
}

/// A target's place at a moment, as a mount should show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Unit vector in the mount's axes.
    pub direction: DVec3,
    /// Rate, 1/s.
    pub per_s: DVec3,
}

impl Place {
    /// Speed on the sky, as the axes see it, rad/s.
    pub fn speed_rad_s(&self) -> f64 {
        self.per_s.length()
    }

    /// Unit vectors along the track and across it (to its left, seen from inside of the sphere with the pole up).
    pub fn track(&self) -> [DVec3; 2] {
        let along = self.per_s.try_normalize().unwrap_or(self.direction.any_orthonormal_vector());
        [along, along.cross(self.direction)]
    }
}

/// Path of a target.
#[derive(Debug, Clone)]
pub struct TargetPath {
    from: Epoch,
    frame: Frame,
    site: Site,
    sidereal_deg: f64,
    /// Places from a margin before the path up to one after it.
    points: Vec<Place>,
    /// Number of the point with which the path begins, and of its last one.
    ends: [usize; 2],
}

/// Direction to what is followed and its rate (1/s), as an observer sees it.
type Seen<'a> = dyn FnMut(&Observer) -> Result<(DVec3, DVec3), PathError> + 'a;

impl TargetPath {
    /// The path of an orbit over a site, `seconds` from an epoch on, in a mount's axes. With `refraction`, the directions are those in which the light arrives.
    ///
    /// # Errors
    /// See [`PathError`].
    pub fn new(
        orbit: &Orbit,
        site: &Site,
        earth: &EarthOrientation,
        span: (Epoch, f64),
        axes: MountAxes,
        refraction: bool,
    ) -> Result<Self, PathError> {
        let margin = MARGIN as f64 * STEP_S * Unit::Second;
        let to = span.0 + span.1.clamp(0.0, MOST_S) * Unit::Second;
        let near = orbit.near(span.0 - margin, to + margin);
        Self::of(site, earth, span, axes, refraction, &mut |observer| {
            let motion = Motion::at(&near, observer)?;
            Ok((motion.enu, motion.enu_per_s))
        })
    }

    /// The path of a star, as [`TargetPath::new`] has it of an orbit.
    ///
    /// # Errors
    /// See [`PathError`].
    pub fn star(
        star: &Star,
        site: &Site,
        earth: &EarthOrientation,
        span: (Epoch, f64),
        axes: MountAxes,
        refraction: bool,
    ) -> Result<Self, PathError> {
        let (sin, cos) = site.geodetic().latitude_deg.to_radians().sin_cos();
        let pole = DVec3::new(0.0, cos, sin);
        Self::of(site, earth, span, axes, refraction, &mut |observer| {
            let enu = observer.star(star).horizontal.east_north_up();
            Ok((enu, enu.cross(pole) * SIDEREAL_DEG_S.to_radians()))
        })
    }

    /// The path of a place that stands over the horizon, as the mount should show it.
    ///
    /// # Errors
    /// See [`PathError`].
    pub fn fixed(
        horizontal: AzimuthAltitude,
        site: &Site,
        earth: &EarthOrientation,
        span: (Epoch, f64),
        axes: MountAxes,
    ) -> Result<Self, PathError> {
        let enu = direction(horizontal.to_array());
        Self::of(site, earth, span, axes, false, &mut |_| Ok((enu, DVec3::ZERO)))
    }

    /// The path of a direction in east, north, up and its rate (1/s), by what an observer sees.
    fn of(
        site: &Site,
        earth: &EarthOrientation,
        span: (Epoch, f64),
        axes: MountAxes,
        refraction: bool,
        seen: &mut Seen<'_>,
    ) -> Result<Self, PathError> {
        let (from, seconds) = span;
        if !(seconds > 0.0 && seconds <= MOST_S) {
            return Err(PathError::Span { found_s: seconds, most_s: MOST_S });
        }
        let place = site.geodetic();
        let frame = Frame { axes, latitude_deg: place.latitude_deg };
        let count = (seconds / STEP_S).ceil() as usize + 1;
        let (count, margin) = (count as i64, MARGIN as i64);
        let at = |i: i64| from + (i as f64 * STEP_S) * Unit::Second;
        let frames = SkyFrames::over(at(-margin), at(count + margin), earth)
            .or_else(|_| SkyFrames::over(from, at(count), earth))?;
        let mut place_at = |i: i64| -> Result<Place, PathError> {
            let observer = Observer::new(frames.at(at(i))?, site);
            let (enu, per_s) = seen(&observer)?;
            let (enu, per_s) = if refraction {
                let height_m = place.height_m;
                let part_s = 0.01;
                let [before, after] =
                    [-part_s, part_s].map(|s| refracted((enu + per_s * s).normalize(), height_m));
                (refracted(enu, height_m), (after - before) / (2.0 * part_s))
            } else {
                (enu, per_s)
            };
            Ok(Place { direction: frame.of_enu(enu), per_s: frame.of_enu(per_s) })
        };
        // A table of positions may end with the path, or not be known far beyond it.
        let mut points: VecDeque<Place> =
            (0..count).map(&mut place_at).collect::<Result<_, _>>()?;
        let before = (-margin..0).rev().map_while(|i| place_at(i).ok());
        before.for_each(|place| points.push_front(place));
        let begin = points.len() - count as usize;
        points.extend((count..count + margin).map_while(|i| place_at(i).ok()));
        let ends = [begin, begin + count as usize - 1];
        let first = frames.at(from)?;
        let sidereal = first.earth_rotation_angle_rad() - first.equation_of_origins_rad();
        let sidereal_deg = sidereal.to_degrees() + place.longitude_deg;
        Ok(Self { from, frame, site: *site, sidereal_deg, points: points.into(), ends })
    }

    /// The path of a target that comes so much later, s.
    #[must_use]
    pub fn later(mut self, late_s: f64) -> Self {
        self.from += late_s * Unit::Second;
        self.sidereal_deg += SIDEREAL_DEG_S * late_s;
        self
    }

    /// The path with other directions in the place of its own, as a mount shows them.
    ///
    /// # Errors
    /// [`PathError::Far`].
    pub(super) fn mapped(mut self, shown: &dyn Fn(DVec3) -> DVec3) -> Result<Self, PathError> {
        const PART_S: f64 = 0.01;
        let off = |place: &Place| shown(place.direction).angle_between(place.direction);
        let off_deg = self.points.iter().map(off).fold(0.0, f64::max).to_degrees();
        if off_deg > MOST_MAPPED_DEG {
            return Err(PathError::Far { off_deg, most_deg: MOST_MAPPED_DEG });
        }
        for place in &mut self.points {
            let [before, after] =
                [-PART_S, PART_S].map(|s| shown((place.direction + place.per_s * s).normalize()));
            *place = Place {
                direction: shown(place.direction),
                per_s: (after - before) / (2.0 * PART_S),
            };
        }
        Ok(self)
    }

    /// First moment.
    pub fn from(&self) -> Epoch {
        self.from
    }

    /// Length of the path, s.
    pub fn seconds(&self) -> f64 {
        (self.ends[1] - self.ends[0]) as f64 * STEP_S
    }

    /// The mount's axes at the site.
    pub fn frame(&self) -> Frame {
        self.frame
    }

    /// The site.
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// Seconds of the path at an epoch.
    pub fn time_s(&self, epoch: Epoch) -> f64 {
        (epoch - self.from).to_seconds()
    }

    /// Epoch at seconds of the path.
    pub fn epoch(&self, time_s: f64) -> Epoch {
        self.from + time_s * Unit::Second
    }

    /// The target's place; a minute beyond the ends, or where a table of positions ends, it goes on straight.
    pub fn at(&self, time_s: f64) -> Place {
        let last = self.points.len() - 1;
        let time_s = time_s + self.ends[0] as f64 * STEP_S;
        let i = ((time_s / STEP_S).floor().max(0.0) as usize).min(last.saturating_sub(1));
        let u = time_s / STEP_S - i as f64;
        let (a, b) = (&self.points[i], &self.points[(i + 1).min(last)]);
        let whole = last as f64 * STEP_S;
        if time_s < 0.0 || time_s > whole {
            let end = if time_s < 0.0 { &self.points[0] } else { &self.points[last] };
            let beyond = if time_s < 0.0 { time_s } else { time_s - whole };
            let turned = end.direction + end.per_s * beyond;
            return Place { direction: turned.normalize(), per_s: end.per_s };
        }
        let (va, vb) = (a.per_s * STEP_S, b.per_s * STEP_S);
        let d = b.direction - a.direction;
        let (c2, c3) = (3.0 * d - 2.0 * va - vb, va + vb - 2.0 * d);
        let direction = a.direction + u * (va + u * (c2 + u * c3));
        let per_s = (va + u * (2.0 * c2 + u * 3.0 * c3)) / STEP_S;
        Place { direction: direction.normalize(), per_s }
    }

    /// Altitude of the path's place, deg.
    pub fn altitude_deg(&self, time_s: f64) -> f64 {
        let enu = self.frame.to_enu(self.at(time_s).direction);
        enu.z.clamp(-1.0, 1.0).asin().to_degrees()
    }

    /// Local sidereal time, deg.
    pub fn sidereal_deg(&self, time_s: f64) -> f64 {
        self.sidereal_deg + SIDEREAL_DEG_S * time_s
    }

    /// The angles of the axes at which a mount says that it stands, deg.
    pub fn angles_of(&self, reading: &MountReading) -> Axes {
        let time_s = self.time_s(reading.utc);
        self.angles_at(reading.place, time_s)
    }

    /// The angles of the axes at a place, deg.
    pub fn angles_at(&self, place: MountPlace, time_s: f64) -> Axes {
        match (place, self.frame.axes) {
            (MountPlace::Equatorial { ra_deg, dec_deg }, axes) => {
                let equatorial = Axes::new(wrapped(self.sidereal_deg(time_s) - ra_deg), dec_deg);
                match axes {
                    MountAxes::Equatorial => equatorial,
                    MountAxes::Horizontal => {
                        angles(horizontal_axes(direction(equatorial), self.frame.latitude_deg))
                    }
                }
            }
            (MountPlace::Horizontal { azimuth_deg, altitude_deg }, axes) => {
                let horizontal = Axes::new(wrapped(azimuth_deg), altitude_deg);
                match axes {
                    MountAxes::Horizontal => horizontal,
                    MountAxes::Equatorial => {
                        angles(equatorial_axes(direction(horizontal), self.frame.latitude_deg))
                    }
                }
            }
        }
    }

    /// The place of two angles of the axes, as mounts with these axes take it.
    pub fn place_of(&self, angle_deg: impl Into<Axes>, time_s: f64) -> MountPlace {
        let angle_deg = angle_deg.into();
        match self.frame.axes {
            MountAxes::Horizontal => MountPlace::Horizontal {
                azimuth_deg: angle_deg[0].rem_euclid(360.0),
                altitude_deg: angle_deg[1],
            },
            MountAxes::Equatorial => MountPlace::Equatorial {
                ra_deg: (self.sidereal_deg(time_s) - angle_deg[0]).rem_euclid(360.0),
                dec_deg: angle_deg[1],
            },
        }
    }
}
