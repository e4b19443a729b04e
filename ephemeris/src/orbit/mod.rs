//! Orbits of targets: a TLE by SGP4, or a table of positions; and when the Earth hides the Sun from it.
//!
//! In the order in which data flows through it:
//!
//! - [`elements`]: sets of elements from any file that gives them out: two lines, or OMM in JSON, CSV, XML and KVN;
//! - [`tle`]: two-line elements from files and texts, checked column by column;
//! - [`TleOrbit`]: SGP4 for one set of elements, TEME to GCRS;
//! - [`Ephemeris`]: a table of GCRS positions in place of elements;
//! - [`Snapshot`]: a place at one moment, of a table of single observations;
//! - [`Orbit`]: any of them, asked for its [`State`] at an epoch;
//! - [`eclipse`]: how much of the Sun's disc the Earth leaves visible, and when that changes.

pub mod eclipse;
pub mod elements;
mod ephemeris;
mod ephemeris_file;
mod error;
mod interpolation;
mod messages;
mod omm;
mod propagation;
mod snapshot;
pub mod tle;
pub mod update;

pub use ephemeris::{Ephemeris, EphemerisRow};
pub use error::{DecayCause, OrbitError};
pub use propagation::TleOrbit;
pub use snapshot::Snapshot;
pub use tle::Tle;

use glam::DVec3;
use hifitime::{Duration, Epoch};
use sunglint_formats::FileError;
use sunglint_formats::time::tai_nanoseconds;
use sunglint_radiometry::sky::SkyFrame;

/// Position and velocity in the GCRS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// From the Earth's centre, m.
    pub position_m: DVec3,
    /// In the GCRS, m/s.
    pub velocity_m_s: DVec3,
}

/// Orbit of a target: its state as a function of time.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Orbit {
    /// Two-line elements, propagated by SGP4.
    Tle(TleOrbit),
    /// A table of positions, interpolated.
    Ephemeris(Ephemeris),
    /// A place at one moment.
    Snapshot(Snapshot),
}

impl Orbit {
    /// The state at an epoch of the target's own time.
    ///
    /// The frame turns TEME into the GCRS and may be that of a slightly different epoch, such as that of the light's arrival:
    /// neither frame takes part in the Earth's rotation, and between them there is only precession and nutation, which
    /// move by 1e−11 rad/s: 0.1 mm in 1 s at a geostationary distance. An ephemeris is in the GCRS and does not need it.
    ///
    /// # Errors
    /// The errors of [`TleOrbit::state`], [`Ephemeris::state`] and [`Snapshot::state`].
    pub fn state(&self, epoch: Epoch, frame: &SkyFrame) -> Result<State, OrbitError> {
        match self {
            Self::Tle(orbit) => orbit.state(epoch, frame),
            Self::Ephemeris(ephemeris) => ephemeris.state(epoch),
            Self::Snapshot(snapshot) => snapshot.state(epoch),
        }
    }

    /// The same orbit, faster where many states between two epochs are wanted: [`TleOrbit::near`].
    #[must_use]
    pub fn near(&self, from: Epoch, to: Epoch) -> Self {
        match self {
            Self::Tle(orbit) => Self::Tle(orbit.near(from, to)),
            Self::Ephemeris(_) | Self::Snapshot(_) => self.clone(),
        }
    }

    /// Returns the name of the target.
    pub fn name(&self) -> String {
        match self {
            Self::Tle(orbit) => orbit.tle().label(),
            Self::Ephemeris(ephemeris) => ephemeris.name().to_owned(),
            Self::Snapshot(snapshot) => snapshot.name().to_owned(),
        }
    }

    /// Returns warnings about the states between two epochs: elements that are old, a table that is
    /// too coarse.
    pub fn warnings(&self, from: Epoch, to: Epoch) -> Vec<String> {
        match self {
            Self::Tle(orbit) => orbit.warnings(from, to),
            Self::Ephemeris(ephemeris) => ephemeris.warnings(),
            Self::Snapshot(_) => Vec::new(),
        }
    }
}

impl Orbit {
    /// The orbit of one object of a file: a table of positions ([`Ephemeris::parse`]: OEM, CPF, ECSV, CSV), or elements in any form
    /// ([`elements::parse_lenient`]), of which `which` names the object and the set nearest to `near` is taken.
    ///
    /// # Errors
    /// A file that cannot be read or is none of these; no such object, or several ([`tle::ChoiceError`]); elements from which SGP4 cannot
    /// start.
    pub fn read(
        path: impl AsRef<std::path::Path>,
        which: Option<&str>,
        near: Option<Epoch>,
    ) -> Result<Self, ReadError> {
        let path = path.as_ref();
        let text = sunglint_formats::read::text(path)?;
        if Ephemeris::is_one(&text) {
            return Ok(Ephemeris::parse(path, &text).map_err(FileError::from)?.into());
        }
        let (good, mut bad) = elements::parse_lenient(path, &text);
        if good.is_empty() && !bad.is_empty() {
            return Err(FileError::from(bad.swap_remove(0)).into());
        }
        let chosen = tle::choose(&good, which, near);
        let chosen = chosen
            .map_err(|source| ReadError::Choice { file: path.display().to_string(), source })?;
        Ok(TleOrbit::new(chosen.clone())?.into())
    }
}

/// Why a file gave no orbit.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be read, or is not what it should be.
    #[error(transparent)]
    File(#[from] FileError),
    /// No single object could be chosen.
    #[error("{file}: {source}")]
    Choice {
        /// The file.
        file: String,
        /// Reason.
        source: tle::ChoiceError,
    },
    /// SGP4 cannot start.
    #[error(transparent)]
    Orbit(#[from] OrbitError),
}

impl From<TleOrbit> for Orbit {
    fn from(orbit: TleOrbit) -> Self {
        Self::Tle(orbit)
    }
}

impl From<Snapshot> for Orbit {
    fn from(snapshot: Snapshot) -> Self {
        Self::Snapshot(snapshot)
    }
}

impl From<Ephemeris> for Orbit {
    fn from(ephemeris: Ephemeris) -> Self {
        Self::Ephemeris(ephemeris)
    }
}

/// The same instant counted in TAI, so that adding seconds to it is right through leap seconds too.
pub fn in_tai(epoch: Epoch) -> Epoch {
    Epoch::from_tai_duration(Duration::from_total_nanoseconds(tai_nanoseconds(epoch)))
}

/// Elapsed seconds from `earlier` to `later`, leap seconds included: good to 1 ns over ten days, to 0.1 µs over 30 years.
///
/// ```
/// use sunglint_ephemeris::orbit::seconds_between;
/// use sunglint_formats::time::parse_utc;
///
/// // A leap second ended 2016.
/// let (before, after) = (parse_utc("2016-12-31T23:59:59Z")?, parse_utc("2017-01-01T00:00:00Z")?);
/// assert_eq!(seconds_between(before, after), 2.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn seconds_between(earlier: Epoch, later: Epoch) -> f64 {
    (tai_nanoseconds(later) - tai_nanoseconds(earlier)) as f64 * 1e-9
}
