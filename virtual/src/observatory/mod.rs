//! The virtual observatory: a night whose truth is known, from photons and pixels.
//!
//! - [`random`]: streams of random numbers by number;
//! - [`events`]: photons one by one through a detector: time tags;
//! - [`counts`]: the counts of bins by the detector's law;
//! - [`frame`]: pictures of point sources, pixel by pixel;
//! - [`lamp`]: a lamp that flashes into camera and counters;
//! - [`wander`]: what wanders in time: twinkling, pointing, seeing, clouds;
//! - [`options`]: what a night is like, the keys of a `virtual.toml`;
//! - [`plan`]: where the telescope points when;
//! - [`night`]: what every channel would get of it before any chance;
//! - [`watch`]: what the instruments get: counts, tags, frames;
//! - [`truth`]: the truth for whoever compares;
//! - [`devices`]: the instruments behind the traits of the drivers.
//!
//! It stands on `radiometry` for what light is (spectra, air, sensitivities) and on nothing of what a reduction does: no dead time is
//! inverted here, no aperture is summed, no coefficient is fitted. A test of a reduction that has its data from here has
//! an independent truth.
//!
//! # Light with known truth
//!
//! A night of one star over a built-in station, watched for 20 s:
//!
//! ```
//! use std::sync::Arc;
//! use sunglint_formats::time::parse_utc;
//! use sunglint_radiometry::sky::EarthOrientation;
//! use sunglint_radiometry::station::Station;
//! use sunglint_virtual::observatory::night::Night;
//! use sunglint_virtual::observatory::options::{Options, PlanOptions};
//! use sunglint_virtual::observatory::plan::plan;
//! use sunglint_virtual::observatory::watch::Watch;
//!
//! let station = Station::built_in("ufo").ok_or("no such station")??;
//! let start = parse_utc("2020-11-18T17:00:00Z")?;
//! let earth = EarthOrientation::embedded();
//! let stars = PlanOptions { stars: 1, v_mag: [0.0, 3.0], ..PlanOptions::default() };
//! let visits = plan(&stars, &station.site, start, earth)?;
//! let night = Arc::new(Night::new(Options::default(), &station, start, visits, earth)?);
//!
//! let mut watch = Watch::new(Arc::clone(&night));
//! let counters = watch.counters();
//! // The first visit is dark, the second is the star.
//! let from_s = night.visits[1].time_s[0];
//! let ps = |s: f64| (s * 1e12) as i64;
//! let counted = watch.counts(&counters, ps(from_s)..ps(from_s + 20.0));
//! // The same question has the same answer.
//! assert_eq!(counted, watch.counts(&counters, ps(from_s)..ps(from_s + 20.0)));
//! let truth_hz = night.visits[1].arriving_hz(counters[0], from_s + 10.0);
//! assert!(truth_hz > 0.0 && counted[0] > 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod counts;
pub mod devices;
pub mod events;
pub mod frame;
pub mod lamp;
pub mod mount;
pub mod night;
pub mod options;
pub mod plan;
pub mod random;
pub mod truth;
pub mod wander;
pub mod watch;
