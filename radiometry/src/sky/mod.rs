//! Where things are: time, Earth orientation, sites, frames, the Sun, the Moon and stars.
//!
//! In the order in which data flows through it:
//!
//! - [`time`]: epochs to UTC, TAI, TT and UT1, through leap seconds;
//! - [`orientation`]: UT1 and the pole, from the embedded table, the user's rows, or constant;
//! - [`site`]: places on the Earth, WGS 84 to ITRS;
//! - [`angles`]: directions and the angles between them;
//! - [`frame`]: GCRS ↔ ITRS at an epoch, and an observer at a site, built once for many directions;
//! - [`frames`]: the same at many epochs of a night, cheaply;
//! - [`bodies`]: the Sun and the Moon from the Earth's centre, a site, or a satellite;
//! - [`planets`]: Mercury to Saturn, for maps of the sky;
//! - [`stars`]: the bright stars by name, and a star's place.
//!
//! The models are those of the IAU through `sofars`, a port of SOFA: precession–nutation IAU 2006/2000A, the Earth
//! rotation angle, `epv00` for the Earth and the Sun (0.02″ here), `moon98` for the Moon (3″ rms, 18″ at
//! worst, by its authors). All altitudes are TRUE: refraction belongs to the air.
//!
//! ```
//! use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Geodetic, Observer, Site};
//!
//! let site = Site::new(Geodetic { latitude_deg: 48.782389, longitude_deg: 9.196417, height_m: 399.0 })?;
//! let epoch = sunglint_formats::time::parse_utc("2024-08-12T22:30:00Z")?;
//! let observer = Observer::at(epoch, &site, EarthOrientation::embedded())?;
//! if observer.frame().orientation().origin.is_outside() {
//!     eprintln!("{}", observer.frame().orientation().origin);
//! }
//!
//! let vega = observer.star(Catalogue::embedded().find("Vega")?);
//! assert!((vega.horizontal.zenith_deg() - 23.07).abs() < 0.01);
//! assert!(observer.sun().horizontal.altitude_deg() < -18.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod angles;
pub mod bodies;
pub mod frame;
pub mod frames;
pub mod orientation;
pub mod planets;
pub mod site;
pub mod stars;
pub mod time;

pub use angles::{AzimuthAltitude, Equatorial, Horizontal, separation_deg, separation_rad};
pub use bodies::{LUNAR_RADIUS_M, MoonPlace, MoonSighting, SunPlace, SunSighting, Twilight};
pub use frame::{Observer, Sighting, SkyError, SkyFrame};
pub use frames::SkyFrames;
pub use orientation::{
    EarthOrientation, Orientation, OrientationError, OrientationOrigin, OrientationRow,
};
pub use planets::{Planet, PlanetPlace, PlanetSighting};
pub use site::{Geodetic, Site, SiteError};
pub use stars::{Catalogue, Star, StarError, StarNote, StarPlace};
pub use time::{JulianDate, TimeError, TimeScales};
