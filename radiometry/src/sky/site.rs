//! Places on the Earth.

use glam::{DMat3, DVec3};

/// The lowest and highest site, m above the ellipsoid: the shore of the Dead Sea and a balloon.
const HEIGHT_RANGE_M: std::ops::RangeInclusive<f64> = -1_000.0..=100_000.0;

/// Error in a place on the Earth.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SiteError {
    /// A latitude beyond the poles, or not a number.
    #[error("the latitude is {latitude_deg}°, expected −90° to 90° (north is positive)")]
    Latitude {
        /// The latitude.
        latitude_deg: f64,
    },
    /// A longitude that is no angle around the Earth.
    #[error("the longitude is {longitude_deg}°, expected −180° to 360° (east is positive)")]
    Longitude {
        /// The longitude.
        longitude_deg: f64,
    },
    /// A height at which no site is.
    #[error("the height is {height_m} m above the ellipsoid, expected −1000 m to 100000 m")]
    Height {
        /// The height.
        height_m: f64,
    },
    /// Too near the Earth's centre to have a latitude.
    #[error("({x_m}, {y_m}, {z_m}) m is no place near the Earth's surface")]
    NoPlace {
        /// x in the ITRS.
        x_m: f64,
        /// y in the ITRS.
        y_m: f64,
        /// z in the ITRS.
        z_m: f64,
    },
}

/// Geodetic coordinates on the WGS 84 ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Geodetic latitude, degrees, north positive.
    pub latitude_deg: f64,
    /// Longitude, degrees, east positive.
    pub longitude_deg: f64,
    /// Height above the ellipsoid (not above the sea; the geoid differs by up to 107 m), m.
    pub height_m: f64,
}

impl Geodetic {
    /// The position in the ITRS, m (SOFA `gd2gc`).
    ///
    /// # Errors
    /// A latitude, longitude or height that cannot be, as [`Site::new`].
    pub fn to_itrs_m(self) -> Result<DVec3, SiteError> {
        let Self { latitude_deg, longitude_deg, height_m } = self;
        if !(-90.0..=90.0).contains(&latitude_deg) {
            return Err(SiteError::Latitude { latitude_deg });
        }
        if !(-180.0..=360.0).contains(&longitude_deg) {
            return Err(SiteError::Longitude { longitude_deg });
        }
        let (longitude, latitude) = (longitude_deg.to_radians(), latitude_deg.to_radians());
        sofars::coords::gd2gc(sofars::consts::WGS84, longitude, latitude, height_m)
            .map(DVec3::from_array)
            .ok()
            .filter(|itrs| itrs.is_finite())
            .ok_or(SiteError::Height { height_m })
    }

    /// The geodetic coordinates of a position in the ITRS, m, at any height (SOFA `gc2gd`); longitude in
    /// (−180°, 180°], 0 at the poles. Good to 1e-8 m below 100 km, to 2 mm (5e-6″ of latitude) in high orbits.
    ///
    /// # Errors
    /// [`SiteError::NoPlace`] for what is not finite or lies deeper than 100 km above the Earth's centre, where a
    /// latitude means nothing.
    pub fn from_itrs_m(itrs_m: DVec3) -> Result<Self, SiteError> {
        let no_place = SiteError::NoPlace { x_m: itrs_m.x, y_m: itrs_m.y, z_m: itrs_m.z };
        // Written so that NaN is refused too.
        if !(itrs_m.length() >= 100_000.0 && itrs_m.is_finite()) {
            return Err(no_place);
        }
        let (longitude, latitude, height_m) =
            sofars::coords::gc2gd(sofars::consts::WGS84, itrs_m.to_array())
                .map_err(|_| no_place)?;
        Ok(Self {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: longitude.to_degrees(),
            height_m,
        })
    }
}

/// A place on the Earth from which someone looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    geodetic: Geodetic,
    itrs_m: DVec3,
    itrs_to_enu: DMat3,
}

impl Site {
    /// The site at geodetic coordinates.
    ///
    /// # Errors
    /// A latitude outside ±90°, a longitude outside −180° to 360°, a height outside −1 to 100 km, or not a number.
    pub fn new(geodetic: Geodetic) -> Result<Self, SiteError> {
        if !HEIGHT_RANGE_M.contains(&geodetic.height_m) {
            return Err(SiteError::Height { height_m: geodetic.height_m });
        }
        let itrs_m = geodetic.to_itrs_m()?;
        let (sin_lat, cos_lat) = geodetic.latitude_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = geodetic.longitude_deg.to_radians().sin_cos();
        let east = DVec3::new(-sin_lon, cos_lon, 0.0);
        let north = DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
        let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
        // East, north and up are the rows of ITRS → ENU.
        let itrs_to_enu = DMat3::from_cols(east, north, up).transpose();
        Ok(Self { geodetic, itrs_m, itrs_to_enu })
    }

    /// The site at a position in the ITRS, m.
    ///
    /// # Errors
    /// The errors of [`Site::new`] and [`Geodetic::from_itrs_m`].
    pub fn from_itrs_m(itrs_m: DVec3) -> Result<Self, SiteError> {
        Self::new(Geodetic::from_itrs_m(itrs_m)?)
    }

    /// The geodetic coordinates.
    pub fn geodetic(&self) -> Geodetic {
        self.geodetic
    }

    /// The position in the ITRS, m.
    pub fn itrs_m(&self) -> DVec3 {
        self.itrs_m
    }

    /// The rotation from ITRS axes to east, north, up (the normal of the ellipsoid) at the site.
    pub fn itrs_to_enu(&self) -> DMat3 {
        self.itrs_to_enu
    }
}
