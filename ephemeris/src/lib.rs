//! Positions of satellites, and the times at which they can be seen.
//!
//! - [`orbit`]: TLE and SGP4, or a table of positions; eclipse by the Earth;
//! - [`geometry`]: where target, Sun and station stand at one moment, light time included;
//! - [`motion`]: how fast a target moves, in the axes of a mount;
//! - [`passes`]: when a target can be seen at all.
//!
//! # A satellite over a station
//!
//! ```
//! use hifitime::{Epoch, Unit};
//! use sunglint_ephemeris::geometry::Geometry;
//! use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
//! use sunglint_ephemeris::passes::{Conditions, Search};
//! use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Observer, Site};
//! use sunglint_radiometry::station::Horizon;
//!
//! const ISS: &str = "ISS (ZARYA)
//! 1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
//! 2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
//! ";
//!
//! let elements = tle::parse("iss.tle", ISS)?.remove(0);
//! let from = elements.epoch;
//! let orbit = Orbit::from(TleOrbit::new(elements)?);
//! let site = Site::new(Geodetic { latitude_deg: 48.78, longitude_deg: 9.2, height_m: 399.0 })?;
//! let earth = EarthOrientation::zero();
//!
//! let conditions = Conditions { min_altitude_deg: 10.0, sun_below_deg: 90.0 };
//! let window = (from, from + 1.0 * Unit::Day);
//! let search = Search::new(&site, &Horizon::Flat(0.0), window, conditions, &earth)?;
//! let found = search.passes(&orbit);
//! assert!((3..9).contains(&found.passes.len()));
//!
//! let pass = &found.passes[0];
//! let geometry = Geometry::at(&orbit, &Observer::at(pass.culmination, &site, &earth)?)?;
//! assert!((90.0 - geometry.zenith_deg() - pass.highest_deg).abs() < 0.01);
//! // Above the orbit's height, and no further than the horizon of it.
//! assert!((330e3..2500e3).contains(&geometry.range_m));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod geometry;
pub mod motion;
pub mod orbit;
pub mod passes;
