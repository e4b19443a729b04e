//! Geometry of target, Sun and station at one moment.

use crate::orbit::eclipse::{EarthShape, visible_fraction};
use crate::orbit::{Orbit, OrbitError, State, in_tai};
use glam::DVec3;
use hifitime::{Duration, Epoch};
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::sky::{
    Geodetic, Horizontal, Observer, SiteError, SkyError, SkyFrame, SunPlace, separation_deg,
    separation_rad,
};

/// Rounds of the light time: each gains a factor velocity/c, 1e-4 even for an escaping target, so that after three only the
/// nanosecond of the epoch is left.
const LIGHT_TIME_ROUNDS: usize = 3;

/// Why there is no geometry.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// The target has no place then.
    #[error(transparent)]
    Orbit(OrbitError),
    /// The sky has no place for it.
    #[error(transparent)]
    Sky(#[from] SkyError),
}

/// Target, Sun and station at the moment at which the station records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Epoch at which the light arrives at the station.
    pub epoch: Epoch,
    /// Epoch at which it left the target: light time earlier.
    pub emitted: Epoch,
    /// The target when the light left it.
    pub target: State,
    /// Unit vector from the target to the station, GCRS axes: the straight line that the light took. For reflection.
    pub to_observer: DVec3,
    /// Length of that line, m.
    pub range_m: f64,
    /// Direction in which the station sees the target, true (unrefracted) with aberration: for pointing and for the way through the air.
    pub horizontal: Horizontal,
    /// The Sun as the target sees it: apparent direction, distance.
    pub sun: SunPlace,
    /// The part of the Sun's disc that the Earth leaves visible at the target, 0 (umbra) to 1 (sunlit), weighted by nothing
    /// but area.
    pub sunlit: f64,
    /// Angle Sun–target–station, radians, 0 to π: between `sun` and `to_observer`, which differ in their frame of rest by up to 5″
    /// ([`Geometry::rest_frame_directions`]).
    pub phase_rad: f64,
}

impl Geometry {
    /// The geometry of what an observer records at its epoch, over a spherical Earth.
    ///
    /// The light left the target earlier, at an epoch that is found by iteration, and the target's state is the orbit's own at
    /// that epoch. In the GCRS the station stands where it is at arrival. Refraction is the air's.
    ///
    /// # Errors
    /// The orbit has no state at the emission's epoch; the target is at the station.
    pub fn at(orbit: &Orbit, observer: &Observer) -> Result<Self, GeometryError> {
        Self::over(orbit, observer, EarthShape::default())
    }

    /// The same with another Earth to cast the shadow.
    ///
    /// # Errors
    /// The errors of [`Geometry::at`].
    pub fn over(
        orbit: &Orbit,
        observer: &Observer,
        earth: EarthShape,
    ) -> Result<Self, GeometryError> {
        let frame = observer.frame();
        let epoch = in_tai(frame.epoch());
        let mut emitted = epoch;
        let mut target = orbit.state(emitted, frame)?;
        for _ in 0..LIGHT_TIME_ROUNDS {
            let range_m = (target.position_m - observer.position_gcrs_m()).length();
            let light_time_ns = (range_m / LIGHT_M_PER_S * 1e9).round();
            let before = emitted;
            emitted = epoch - Duration::from_total_nanoseconds(light_time_ns as i128);
            if emitted == before {
                break;
            }
            target = orbit.state(emitted, frame)?;
        }
        let line = observer.position_gcrs_m() - target.position_m;
        let range_m = line.length();
        // A millimetre, as for a sighting.
        if range_m < 1e-3 {
            return Err(SkyError::AtObserver { range_m }.into());
        }
        let to_observer = line / range_m;
        let seen = -to_observer + observer.velocity_gcrs_m_s() / LIGHT_M_PER_S;
        let horizontal = observer.horizontal_of(seen)?;
        // The frame is that of the arrival; within the light time the Sun moves by 3 nrad/s.
        let sun = frame.sun_from(target.position_m, target.velocity_m_s)?;
        let sun_at_rest = frame.sun_from(target.position_m, DVec3::ZERO)?;
        Ok(Self {
            epoch,
            emitted,
            target,
            to_observer,
            range_m,
            horizontal,
            sun,
            sunlit: visible_fraction(target.position_m, &sun_at_rest, earth),
            phase_rad: separation_rad(sun.direction_gcrs, to_observer),
        })
    }

    /// Angle Sun–target–station, degrees.
    pub fn phase_deg(&self) -> f64 {
        self.phase_rad.to_degrees()
    }

    /// True zenith angle of the target at the station, degrees.
    pub fn zenith_deg(&self) -> f64 {
        self.horizontal.zenith_deg()
    }

    /// The same with the range, for the way through the air
    /// ([`Air::transmission`](sunglint_radiometry::air::Air::transmission) and its table).
    pub fn air_zenith(&self) -> Zenith {
        Zenith::Near { true_deg: self.zenith_deg(), range_m: self.range_m }
    }

    /// Light time, s.
    pub fn light_time_s(&self) -> f64 {
        crate::orbit::seconds_between(self.emitted, self.epoch)
    }

    /// Whether the straight line from the station meets the ground: the target's true altitude is below that of the
    /// ellipsoid's limb, −√(2h/R) for a station at height h. Refraction lifts a target by up to half a degree over the horizon:
    /// the air's path says whether it is seen.
    pub fn behind_earth(&self, observer: &Observer) -> bool {
        let height_m = observer.site().geodetic().height_m.max(0.0);
        let radius_m = observer.site().itrs_m().length() - height_m;
        let dip_rad = (radius_m / (radius_m + height_m)).min(1.0).acos();
        self.horizontal.altitude_deg() < -dip_rad.to_degrees()
    }

    /// The pair of directions for reflection in the rest frame of the moving body, (to the Sun, to the observer), GCRS axes.
    ///
    /// `sun` is already as the moving target sees it. Light that leaves along `to_observer` in the GCRS leaves the body itself
    /// along a direction that is shifted against its velocity, by up to 5″ in low orbit (2.5e−5 rad): it matters
    /// for mirrors alone, and there by a hundredth of the Sun's radius.
    pub fn rest_frame_directions(&self) -> (DVec3, DVec3) {
        let shifted = self.to_observer - self.target.velocity_m_s / LIGHT_M_PER_S;
        (self.sun.direction_gcrs, shifted.normalize())
    }

    /// True altitude of the Sun's centre at the station, degrees.
    pub fn sun_altitude_deg(&self, observer: &Observer) -> f64 {
        observer.sun().horizontal.altitude_deg()
    }

    /// Angle between the target and the Moon's centre as the station sees them, degrees.
    pub fn moon_separation_deg(&self, observer: &Observer) -> f64 {
        observer.moon().horizontal.separation_deg(self.horizontal)
    }

    /// Angle between the target and the Sun's centre as the station sees them, degrees.
    pub fn sun_separation_deg(&self, observer: &Observer) -> f64 {
        observer.sun().horizontal.separation_deg(self.horizontal)
    }

    /// The geodetic coordinates of the target: the point of the ellipsoid below it, and its height above that.
    ///
    /// # Errors
    /// [`SiteError::NoPlace`] near the Earth's centre.
    pub fn sub_point(&self, frame: &SkyFrame) -> Result<Geodetic, SiteError> {
        // The Earth has turned since the light left: by the light time.
        let turned =
            DVec3::Z * sunglint_radiometry::sky::frame::EARTH_ROTATION_RAD_S * self.light_time_s();
        let itrs = frame.gcrs_to_itrs() * self.target.position_m;
        Geodetic::from_itrs_m(itrs + turned.cross(itrs))
    }

    /// Height of the target above the ellipsoid, m.
    ///
    /// # Errors
    /// The errors of [`Geometry::sub_point`].
    pub fn height_m(&self, frame: &SkyFrame) -> Result<f64, SiteError> {
        Ok(self.sub_point(frame)?.height_m)
    }

    /// Angle at the station between this and another moment's direction, degrees: for angular rates.
    pub fn separation_deg(&self, other: &Self) -> f64 {
        separation_deg(self.horizontal.east_north_up(), other.horizontal.east_north_up())
    }
}
