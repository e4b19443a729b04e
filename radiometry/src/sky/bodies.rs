//! The Sun and the Moon: from the Earth's centre, from a site, or from a satellite.

use super::angles::{Horizontal, separation_rad};
use super::frame::{Observer, SkyError, SkyFrame, aberrated, retarded};
use crate::constants::{AU_M, LIGHT_M_PER_S, SUN_RADIUS_M};
use glam::DVec3;
use sofars::consts::DAYSEC;
use std::fmt;

/// The nominal solar radius, m (IAU 2015 resolution B3): 959.23″ or 0.26645° at 1 au. (The older 959.63″ of the
/// The Moon's mean radius, m (IAU working group on cartographic coordinates 2015).
pub const LUNAR_RADIUS_M: f64 = 1.7374e6;

/// The Sun as an observer near the Earth sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunPlace {
    /// The apparent direction, GCRS axes, unit vector: light time and aberration are in it.
    pub direction_gcrs: DVec3,
    /// The distance from the observer to where the Sun was when the light left it, m, in the barycentric frame.
    pub distance_m: f64,
}

impl SunPlace {
    /// The distance in astronomical units; irradiance goes as its inverse square.
    pub fn distance_au(&self) -> f64 {
        self.distance_m / AU_M
    }

    /// The angular radius of the photosphere, radians: asin(R/d).
    pub fn angular_radius_rad(&self) -> f64 {
        (SUN_RADIUS_M / self.distance_m).asin()
    }

    /// The angular radius of the photosphere, degrees (about 0.2665°).
    pub fn angular_radius_deg(&self) -> f64 {
        self.angular_radius_rad().to_degrees()
    }
}

/// The Moon as an observer near the Earth sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MoonPlace {
    /// The apparent direction, GCRS axes, unit vector.
    pub direction_gcrs: DVec3,
    /// The distance from the observer to where the Moon was when the light left it, m, in the GCRS (light time in the
    /// barycentric frame would add the Earth's motion of up to 38 km).
    pub distance_m: f64,
    /// The phase angle Sun–Moon–observer, degrees: 0 at full moon, 180 at new moon.
    pub phase_angle_deg: f64,
}

impl MoonPlace {
    /// The illuminated part of the disc, 0 to 1: (1 + cos phase)/2.
    pub fn illuminated_fraction(&self) -> f64 {
        (1.0 + self.phase_angle_deg.to_radians().cos()) / 2.0
    }

    /// The angular radius, degrees.
    pub fn angular_radius_deg(&self) -> f64 {
        (LUNAR_RADIUS_M / self.distance_m).asin().to_degrees()
    }
}

/// The Sun from a site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunSighting {
    /// The direction of its centre at the site, true (unrefracted).
    pub horizontal: Horizontal,
    /// Direction, distance and size.
    pub place: SunPlace,
}

/// The Moon from a site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MoonSighting {
    /// The direction of its centre at the site, true (unrefracted), parallax included.
    pub horizontal: Horizontal,
    /// Direction, distance and phase.
    pub place: MoonPlace,
}

/// How dark the sky is, by the true altitude of the Sun's centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Twilight {
    /// The Sun's upper limb is up: the centre above −0.833° (34′ of mean refraction and 16′ of radius).
    Day,
    /// Down to −6°.
    Civil,
    /// −6° to −12°.
    Nautical,
    /// −12° to −18°.
    Astronomical,
    /// Below −18°.
    Night,
}

impl Twilight {
    /// For a true altitude of the Sun's centre, degrees.
    pub fn of_sun_altitude_deg(altitude_deg: f64) -> Self {
        match altitude_deg {
            a if a > -0.833 => Self::Day,
            a if a > -6.0 => Self::Civil,
            a if a > -12.0 => Self::Nautical,
            a if a > -18.0 => Self::Astronomical,
            _ => Self::Night,
        }
    }
}

impl fmt::Display for Twilight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Day => "day",
            Self::Civil => "civil twilight",
            Self::Nautical => "nautical twilight",
            Self::Astronomical => "astronomical twilight",
            Self::Night => "night",
        })
    }
}

impl SkyFrame {
    /// The Sun from the Earth's centre, as it is seen from there (light time and annual aberration).
    pub fn sun(&self) -> SunPlace {
        self.sun_seen_from(DVec3::ZERO, DVec3::ZERO)
    }

    /// The Sun from a GCRS position near the Earth, for an observer who moves with that GCRS velocity: light time,
    /// and aberration of the Earth's velocity *and* the observer's (a satellite's own 7.5 km/s shifts the Sun by
    /// 5″). Give the velocity for directions in the body's own rest frame; zero for directions in the scene, whose axes
    /// and rest frame are the GCRS.
    ///
    /// # Errors
    /// [`SkyError::NotFinite`]; [`SkyError::AtObserver`] for a position inside the body.
    pub fn sun_from(
        &self,
        position_gcrs_m: DVec3,
        velocity_gcrs_m_s: DVec3,
    ) -> Result<SunPlace, SkyError> {
        check(position_gcrs_m, velocity_gcrs_m_s)?;
        let place = self.sun_seen_from(position_gcrs_m, velocity_gcrs_m_s);
        outside_of(SUN_RADIUS_M, place.distance_m)?;
        Ok(place)
    }

    fn sun_seen_from(&self, position_gcrs_m: DVec3, velocity_gcrs_m_s: DVec3) -> SunPlace {
        let sun_velocity_m_s =
            (self.earth_from_barycentre.velocity - self.earth_from_sun.velocity) * (AU_M / DAYSEC);
        let line = retarded(self.sun_position_gcrs_m(), sun_velocity_m_s, position_gcrs_m);
        let distance_m = line.length();
        let velocity_c = (self.earth_velocity_m_s() + velocity_gcrs_m_s) / LIGHT_M_PER_S;
        let direction = sofars::astro::ab(
            &(line / distance_m).to_array(),
            &velocity_c.to_array(),
            distance_m / AU_M,
            (1.0 - velocity_c.length_squared()).sqrt(),
        );
        SunPlace { direction_gcrs: DVec3::from_array(direction), distance_m }
    }

    /// The Sun's geometric position at this instant, m from the Earth's centre, GCRS axes (SOFA `epv00`; no light
    /// time).
    pub fn sun_position_gcrs_m(&self) -> DVec3 {
        -self.earth_from_sun.position * AU_M
    }

    /// The Moon from the Earth's centre, as it is seen from there.
    pub fn moon(&self) -> MoonPlace {
        self.moon_seen_from(DVec3::ZERO, DVec3::ZERO)
    }

    /// The Moon from a GCRS position near the Earth, for an observer who moves with that GCRS velocity (see
    /// [`SkyFrame::sun_from`]): light time and the aberration of that velocity; the Earth's own motion cancels out
    /// (see [`Observer::apparent`]).
    ///
    /// # Errors
    /// [`SkyError::NotFinite`]; [`SkyError::AtObserver`] for a position inside the body.
    pub fn moon_from(
        &self,
        position_gcrs_m: DVec3,
        velocity_gcrs_m_s: DVec3,
    ) -> Result<MoonPlace, SkyError> {
        check(position_gcrs_m, velocity_gcrs_m_s)?;
        let place = self.moon_seen_from(position_gcrs_m, velocity_gcrs_m_s);
        outside_of(LUNAR_RADIUS_M, place.distance_m)?;
        Ok(place)
    }

    fn moon_seen_from(&self, position_gcrs_m: DVec3, velocity_gcrs_m_s: DVec3) -> MoonPlace {
        let (moon_m, moon_velocity_m_s) = self.moon_state();
        let line = retarded(moon_m, moon_velocity_m_s, position_gcrs_m);
        let distance_m = line.length();
        // The light that is seen left the Moon there, and reached it along the line from the Sun.
        let moon_to_sun = self.sun_position_gcrs_m() - (position_gcrs_m + line);
        MoonPlace {
            direction_gcrs: aberrated(line / distance_m, velocity_gcrs_m_s),
            distance_m,
            phase_angle_deg: separation_rad(moon_to_sun, -line).to_degrees(),
        }
    }

    /// The Moon's geometric position at this instant, m from the Earth's centre, GCRS axes (SOFA `moon98`).
    pub fn moon_position_gcrs_m(&self) -> DVec3 {
        self.moon_state().0
    }

    /// Position in m and velocity in m/s.
    fn moon_state(&self) -> (DVec3, DVec3) {
        let tt = self.times().tt;
        let [position_au, velocity_au_d] = sofars::eph::moon98(tt.midnight, tt.fraction);
        let velocity_m_s = DVec3::from_array(velocity_au_d) * (AU_M / DAYSEC);
        (DVec3::from_array(position_au) * AU_M, velocity_m_s)
    }
}

impl Observer {
    /// The Sun from the site: its parallax (8.8″), light time, annual and diurnal aberration.
    pub fn sun(&self) -> SunSighting {
        let place = self.frame().sun_seen_from(self.position_gcrs_m(), self.velocity_gcrs_m_s());
        SunSighting { horizontal: self.of_unit(place.direction_gcrs), place }
    }

    /// The Moon from the site: its parallax (up to 1°), light time, diurnal aberration.
    pub fn moon(&self) -> MoonSighting {
        let place = self.frame().moon_seen_from(self.position_gcrs_m(), self.velocity_gcrs_m_s());
        MoonSighting { horizontal: self.of_unit(place.direction_gcrs), place }
    }

    /// How dark the sky is.
    pub fn twilight(&self) -> Twilight {
        Twilight::of_sun_altitude_deg(self.sun().horizontal.altitude_deg())
    }

    /// The horizontal direction of what is known to be a unit vector.
    pub(super) fn of_unit(&self, direction_gcrs: DVec3) -> Horizontal {
        Horizontal::of_unit_enu(self.gcrs_to_enu() * direction_gcrs)
    }
}

fn check(position_m: DVec3, velocity_m_s: DVec3) -> Result<(), SkyError> {
    if position_m.is_finite() && velocity_m_s.is_finite() {
        return Ok(());
    }
    let DVec3 { x, y, z } = position_m;
    Err(SkyError::NotFinite { x_m: x, y_m: y, z_m: z })
}

fn outside_of(radius_m: f64, range_m: f64) -> Result<(), SkyError> {
    if range_m > radius_m { Ok(()) } else { Err(SkyError::AtObserver { range_m }) }
}
