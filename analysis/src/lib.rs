//! Reading a light curve without a model of the body: periods, folded curves, materials, maps.
//!
//! In the order in which data flows through it:
//!
//! - [`curves`]: curves of several files on one clock;
//! - [`trend`]: air, range and phase trend, removed;
//! - [`series`]: the samples of one channel that count, sorted, relative to one moment;
//! - [`mod@period`]: Lomb-Scargle, phase dispersion minimisation, and a verdict;
//! - [`sessions`]: periods over several nights, each with its own zero point;
//! - [`synodic`]: from the period that is seen to that of the spin;
//! - [`mod@fold`]: samples by their phase in a period;
//! - [`samples`]: values of a curve, which of them count, and the light under which they were taken;
//! - [`unmix`]: materials from spectra and from channels;
//! - [`map`]: samples on the body's frame.
//!
//! # Period of a curve
//!
//! A body that flashes every 12.5 s, seen for 400 s:
//!
//! ```
//! use std::f64::consts::TAU;
//! use sunglint_analysis::fold::{Folding, fold};
//! use sunglint_analysis::period::{Options, verdict};
//! use sunglint_analysis::series::Series;
//!
//! let time: Vec<f64> = (0..800).map(|i| 0.5 * f64::from(i)).collect();
//! // Deterministic noise: products of incommensurable sines.
//! let noise = |t: f64| 0.02 * (91.7 * t * t).sin();
//! let rate: Vec<f64> = time
//!     .iter()
//!     .map(|t| 3.0 + (TAU * t / 12.5).cos() + 0.4 * (2.0 * TAU * t / 12.5).sin() + noise(*t))
//!     .collect();
//! let series = Series::new("green", &time, &rate, None)?;
//!
//! let answer = verdict(std::slice::from_ref(&series), &Options::default())?;
//! let best = answer.best.ok_or("no period")?;
//! assert!((best.period_s - 12.5).abs() < 0.01);
//!
//! let folding = Folding {
//!     period_s: best.period_s,
//!     period_sigma_s: Some(best.sigma_s),
//!     epoch_s: 0.0,
//!     bins: 10,
//! };
//! let folded = fold(&series, &folding)?;
//! assert_eq!(folded.bins.len(), 10);
//! assert!((folded.turns - 32.0).abs() < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod curves;
pub mod fold;
pub mod map;
pub mod period;
mod rounding;
pub mod samples;
pub mod series;
pub mod sessions;
pub mod spin;
pub mod synodic;
pub mod trend;
pub mod unmix;
