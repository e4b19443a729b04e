//! The sky at an epoch ([`SkyFrame`]) and as seen from a site ([`Observer`]): built once, then cheap for many
//! directions.

use super::angles::Horizontal;
use super::orientation::{EarthOrientation, Orientation};
use super::site::Site;
use super::time::{JulianDate, TimeError, TimeScales};
use crate::constants::{AU_M, LIGHT_M_PER_S};
use glam::{DMat3, DVec3};
use hifitime::Epoch;
use sofars::astro::IauAstrom;
use sofars::consts::{D2PI, DAS2R, DAYSEC};

/// The Earth's rotation rate, rad per UT1 second (SOFA `pvtob`).
pub const EARTH_ROTATION_RAD_S: f64 = 1.002_737_811_911_354_6 * D2PI / DAYSEC;

/// Error in a calculation of directions on the sky.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SkyError {
    /// The epoch is outside UTC.
    #[error(transparent)]
    Time(#[from] TimeError),
    /// The ephemeris of the Earth does not reach the epoch.
    #[error(
        "the ephemeris of the Earth and the Sun covers the years 1972 to 2099, not Julian epoch {julian_year:.1}"
    )]
    OutsideEphemeris {
        /// The epoch as a Julian year of TT.
        julian_year: f64,
    },
    /// The object has no direction.
    #[error("the object is at the observer ({range_m} m away): it has no direction")]
    AtObserver {
        /// Distance of the object, m.
        range_m: f64,
    },
    /// A position or velocity that is not a number.
    #[error("the object's position ({x_m}, {y_m}, {z_m}) m or its velocity is not finite")]
    NotFinite {
        /// x in the GCRS.
        x_m: f64,
        /// y in the GCRS.
        y_m: f64,
        /// z in the GCRS.
        z_m: f64,
    },
}

/// A barycentric or heliocentric state, au and au per day.
#[derive(Debug, Clone, Copy)]
pub(super) struct StateAu {
    pub position: DVec3,
    pub velocity: DVec3,
}

/// Parts of a frame that move slowly and cost much: precession, nutation, and the Earth about the Sun.
#[derive(Debug, Clone)]
pub(super) struct Slow {
    /// GCRS → celestial intermediate system, row by row.
    pub celestial: [[f64; 3]; 3],
    pub equation_of_origins_rad: f64,
    pub earth_from_sun: StateAu,
    pub earth_from_barycentre: StateAu,
}

impl Slow {
    pub fn at(tt: JulianDate) -> Result<Self, SkyError> {
        let (tt1, tt2) = (tt.midnight, tt.fraction);
        let (from_sun, from_barycentre) = sofars::eph::epv00(tt1, tt2).ok_or_else(|| {
            SkyError::OutsideEphemeris { julian_year: 2000.0 + (tt1 - 2_451_545.0 + tt2) / 365.25 }
        })?;
        let bias_precession_nutation = sofars::pnp::pnm06a(tt1, tt2);
        let (x, y) = sofars::pnp::bpn2xy(&bias_precession_nutation);
        let s = sofars::pnp::s06(tt1, tt2, x, y);
        Ok(Self {
            celestial: sofars::pnp::c2ixys(x, y, s),
            equation_of_origins_rad: sofars::pnp::eors(&bias_precession_nutation, s),
            earth_from_sun: state(&from_sun),
            earth_from_barycentre: state(&from_barycentre),
        })
    }
}

/// The frames at one epoch: GCRS ↔ ITRS by the CIO method (IAU 2006/2000A, SOFA `c2t06a`), and where the Earth is.
#[derive(Debug, Clone)]
pub struct SkyFrame {
    epoch: Epoch,
    times: TimeScales,
    orientation: Orientation,
    gcrs_to_cirs: DMat3,
    tirs_to_itrs: DMat3,
    gcrs_to_itrs: DMat3,
    earth_rotation_angle_rad: f64,
    equation_of_origins_rad: f64,
    pub(super) earth_from_sun: StateAu,
    pub(super) earth_from_barycentre: StateAu,
}

impl SkyFrame {
    /// The frames at an epoch. Costs some 50 µs, nearly all of it nutation and the Earth's ephemeris:
    /// build it once per epoch, or with [`SkyFrames`](super::SkyFrames) for many epochs of a night.
    ///
    /// # Errors
    /// [`SkyError::Time`] before 1972, [`SkyError::OutsideEphemeris`] after 2099.
    pub fn new(epoch: Epoch, earth: &EarthOrientation) -> Result<Self, SkyError> {
        let orientation = earth.at(epoch)?;
        let times = TimeScales::at(epoch, orientation.ut1_minus_tai_s)?;
        let slow = Slow::at(times.tt)?;
        Ok(Self::of(epoch, orientation, times, &slow))
    }

    /// From what moves slowly, and the Earth's rotation.
    pub(super) fn of(
        epoch: Epoch,
        orientation: Orientation,
        times: TimeScales,
        slow: &Slow,
    ) -> Self {
        let rotation_rad = sofars::erst::era00(times.ut1.midnight, times.ut1.fraction);
        let polar_motion = sofars::pnp::pom00(
            orientation.x_pole_arcsec * DAS2R,
            orientation.y_pole_arcsec * DAS2R,
            sofars::pnp::sp00(times.tt.midnight, times.tt.fraction),
        );
        let whole = sofars::pnp::c2tcio(&slow.celestial, rotation_rad, &polar_motion);
        Self {
            epoch,
            times,
            orientation,
            gcrs_to_cirs: matrix(&slow.celestial),
            tirs_to_itrs: matrix(&polar_motion),
            gcrs_to_itrs: matrix(&whole),
            earth_rotation_angle_rad: rotation_rad,
            equation_of_origins_rad: slow.equation_of_origins_rad,
            earth_from_sun: slow.earth_from_sun,
            earth_from_barycentre: slow.earth_from_barycentre,
        }
    }

    /// The epoch.
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// The epoch on UTC, TAI, TT and UT1.
    pub fn times(&self) -> &TimeScales {
        &self.times
    }

    /// UT1−UTC and the pole that were used, and where they come from (print `origin` where it
    /// [is outside](super::OrientationOrigin::is_outside) the table).
    pub fn orientation(&self) -> &Orientation {
        &self.orientation
    }

    /// The rotation that takes GCRS coordinates to ITRS coordinates.
    pub fn gcrs_to_itrs(&self) -> DMat3 {
        self.gcrs_to_itrs
    }

    /// The rotation that takes ITRS coordinates to GCRS coordinates.
    pub fn itrs_to_gcrs(&self) -> DMat3 {
        self.gcrs_to_itrs.transpose()
    }

    /// The rotation GCRS → celestial intermediate system: frame bias, precession, nutation.
    pub fn gcrs_to_cirs(&self) -> DMat3 {
        self.gcrs_to_cirs
    }

    /// The rotation terrestrial intermediate system → ITRS: polar motion and s′ (SOFA `pom00`). It also takes TEME
    /// that was turned by the Greenwich mean sidereal time of 1982 (SOFA `gmst82` of UT1) to the ITRS (Vallado et
    /// al. 2006, AIAA 2006-6753).
    pub fn tirs_to_itrs(&self) -> DMat3 {
        self.tirs_to_itrs
    }

    /// The Earth rotation angle, radians in [0, 2π).
    pub fn earth_rotation_angle_rad(&self) -> f64 {
        self.earth_rotation_angle_rad
    }

    /// The equation of the origins, radians: right ascension from the CIO minus right ascension from the equinox.
    pub fn equation_of_origins_rad(&self) -> f64 {
        self.equation_of_origins_rad
    }

    /// The Earth's angular velocity in the GCRS, rad/s, along the celestial intermediate pole.
    pub fn earth_rotation_gcrs_rad_s(&self) -> DVec3 {
        self.gcrs_to_cirs.transpose() * DVec3::new(0.0, 0.0, EARTH_ROTATION_RAD_S)
    }

    /// The GCRS velocity, m/s, of what moves with `velocity_itrs_m_s` at `position_itrs_m` in the turning ITRS
    /// (zero for what stands on the ground).
    pub fn gcrs_velocity_m_s(&self, position_itrs_m: DVec3, velocity_itrs_m_s: DVec3) -> DVec3 {
        let to_gcrs = self.itrs_to_gcrs();
        to_gcrs * velocity_itrs_m_s
            + self.earth_rotation_gcrs_rad_s().cross(to_gcrs * position_itrs_m)
    }

    /// The Earth's velocity about the solar system's barycentre, m/s, GCRS axes.
    pub fn earth_velocity_m_s(&self) -> DVec3 {
        self.earth_from_barycentre.velocity * (AU_M / DAYSEC)
    }
}

/// Someone who looks from a site at an epoch.
#[derive(Debug, Clone)]
pub struct Observer {
    frame: SkyFrame,
    site: Site,
    position_gcrs_m: DVec3,
    velocity_gcrs_m_s: DVec3,
    gcrs_to_enu: DMat3,
    pub(super) astrometry: IauAstrom,
}

/// Where an object near the Earth stands for an observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The direction at the site, true (unrefracted).
    pub horizontal: Horizontal,
    /// The unit vector towards the object in the GCRS.
    pub direction_gcrs: DVec3,
    /// The distance, m.
    pub range_m: f64,
}

impl Observer {
    /// An observer at a site, at the epoch of a frame.
    pub fn new(frame: SkyFrame, site: &Site) -> Self {
        let position_gcrs_m = frame.itrs_to_gcrs() * site.itrs_m();
        let velocity_gcrs_m_s = frame.gcrs_velocity_m_s(site.itrs_m(), DVec3::ZERO);
        let mut astrometry = IauAstrom::default();
        let barycentric = &frame.earth_from_barycentre;
        sofars::astro::apcs(
            frame.times.tt.midnight,
            frame.times.tt.fraction,
            &[position_gcrs_m.to_array(), velocity_gcrs_m_s.to_array()],
            &[barycentric.position.to_array(), barycentric.velocity.to_array()],
            &frame.earth_from_sun.position.to_array(),
            &mut astrometry,
        );
        let gcrs_to_enu = site.itrs_to_enu() * frame.gcrs_to_itrs;
        Self { frame, site: *site, position_gcrs_m, velocity_gcrs_m_s, gcrs_to_enu, astrometry }
    }

    /// An observer at an epoch and a site: [`SkyFrame::new`] and [`Observer::new`] in one.
    ///
    /// # Errors
    /// The errors of [`SkyFrame::new`].
    pub fn at(epoch: Epoch, site: &Site, earth: &EarthOrientation) -> Result<Self, SkyError> {
        Ok(Self::new(SkyFrame::new(epoch, earth)?, site))
    }

    /// The frame at the epoch.
    pub fn frame(&self) -> &SkyFrame {
        &self.frame
    }

    /// The site.
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// The site's position in the GCRS, m.
    pub fn position_gcrs_m(&self) -> DVec3 {
        self.position_gcrs_m
    }

    /// The site's velocity in the GCRS, m/s (the Earth's rotation; 465 m/s at the equator).
    pub fn velocity_gcrs_m_s(&self) -> DVec3 {
        self.velocity_gcrs_m_s
    }

    /// The rotation from GCRS axes to east, north, up at the site.
    pub fn gcrs_to_enu(&self) -> DMat3 {
        self.gcrs_to_enu
    }

    /// The horizontal direction of a GCRS direction that is already apparent (light time and aberration are the
    /// caller's).
    ///
    /// # Errors
    /// [`SkyError::AtObserver`] for the zero vector, [`SkyError::NotFinite`].
    pub fn horizontal_of(&self, direction_gcrs: DVec3) -> Result<Horizontal, SkyError> {
        check_finite(direction_gcrs)?;
        Horizontal::of_enu(self.gcrs_to_enu * direction_gcrs)
            .ok_or(SkyError::AtObserver { range_m: direction_gcrs.length() })
    }

    /// The GCRS unit vector of a horizontal direction.
    pub fn gcrs_direction_of(&self, horizontal: Horizontal) -> DVec3 {
        self.gcrs_to_enu.transpose() * horizontal.east_north_up()
    }

    /// Where an object at a GCRS position stands: the straight line at this instant, without light time or
    /// aberration. It is what orbit programs print; a camera sees [`Observer::apparent`].
    ///
    /// # Errors
    /// [`SkyError::AtObserver`] within a millimetre of the site, [`SkyError::NotFinite`].
    pub fn geometric(&self, position_gcrs_m: DVec3) -> Result<Sighting, SkyError> {
        let line = position_gcrs_m - self.position_gcrs_m;
        let range_m = line.length();
        check_line(position_gcrs_m, range_m)?;
        self.sighting(line / range_m, range_m)
    }

    /// Where an object near the Earth is seen: taken back by its light time along its velocity, and shifted by
    /// the aberration of the site's rotation (0.3″). A satellite at 1000 km lags by up to 5″.
    ///
    /// Annual aberration does not enter: in the GCRS the Earth stands still, and what the Earth's motion adds by
    /// aberration the light time of the Earth's motion takes away, to second order (0.002″). Good for satellites and,
    /// to that order, the Moon.
    ///
    /// # Errors
    /// [`SkyError::AtObserver`] within a millimetre of the site, [`SkyError::NotFinite`].
    pub fn apparent(
        &self,
        position_gcrs_m: DVec3,
        velocity_gcrs_m_s: DVec3,
    ) -> Result<Sighting, SkyError> {
        if !velocity_gcrs_m_s.is_finite() {
            return Err(not_finite(position_gcrs_m));
        }
        let line = retarded(position_gcrs_m, velocity_gcrs_m_s, self.position_gcrs_m);
        let range_m = line.length();
        check_line(position_gcrs_m, range_m)?;
        self.sighting(aberrated(line / range_m, self.velocity_gcrs_m_s), range_m)
    }

    fn sighting(&self, direction_gcrs: DVec3, range_m: f64) -> Result<Sighting, SkyError> {
        let horizontal = self.horizontal_of(direction_gcrs)?;
        Ok(Sighting { horizontal, direction_gcrs, range_m })
    }
}

/// The line from an observer to where a moving object was when the light left it (GCRS, m).
pub(super) fn retarded(position_m: DVec3, velocity_m_s: DVec3, observer_m: DVec3) -> DVec3 {
    let mut line = position_m - observer_m;
    // Two rounds: each gains a factor velocity/c.
    for _ in 0..2 {
        line = position_m - velocity_m_s * (line.length() / LIGHT_M_PER_S) - observer_m;
    }
    line
}

/// First-order aberration, for observers that move slowly in the GCRS (the second order is below 0.001″ to 10 km/s).
pub(super) fn aberrated(direction: DVec3, observer_velocity_m_s: DVec3) -> DVec3 {
    (direction + observer_velocity_m_s / LIGHT_M_PER_S).normalize()
}

fn check_finite(vector_m: DVec3) -> Result<(), SkyError> {
    if vector_m.is_finite() { Ok(()) } else { Err(not_finite(vector_m)) }
}

fn check_line(position_m: DVec3, range_m: f64) -> Result<(), SkyError> {
    check_finite(position_m)?;
    if range_m < 1e-3 { Err(SkyError::AtObserver { range_m }) } else { Ok(()) }
}

fn not_finite(position_m: DVec3) -> SkyError {
    SkyError::NotFinite { x_m: position_m.x, y_m: position_m.y, z_m: position_m.z }
}

/// SOFA writes matrices by rows, glam by columns.
fn matrix(rows: &[[f64; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(rows).transpose()
}

fn state(rows: &[[f64; 3]; 2]) -> StateAu {
    StateAu { position: DVec3::from_array(rows[0]), velocity: DVec3::from_array(rows[1]) }
}
