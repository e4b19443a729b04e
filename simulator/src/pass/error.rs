//! Why a pass could not be simulated.

use crate::attitude::AttitudeError;
use crate::light::{DirectionError, SceneError};
use sunglint_ephemeris::geometry::GeometryError;
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::passband::PhotometryError;
use sunglint_radiometry::sky::SkyError;
use sunglint_radiometry::spectrum::SpectrumError;

/// Why a pass could not be simulated. The messages of what is inside hold the numbers, and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PassError {
    /// The target, the Sun or the station has no place at an epoch.
    #[error("{epoch_utc}: {source}")]
    Geometry {
        /// The epoch, UTC.
        epoch_utc: String,
        /// Why.
        source: Box<GeometryError>,
    },
    /// The sky has no frame at an epoch.
    #[error(transparent)]
    Sky(Box<SkyError>),
    /// The body has no attitude at an epoch.
    #[error("{epoch_utc}: {source}")]
    Attitude {
        /// The epoch, UTC.
        epoch_utc: String,
        /// Why.
        source: Box<AttitudeError>,
    },
    /// The target is none that light can be computed of.
    #[error("the target {target}: {source}")]
    Target {
        /// Name of the target.
        target: String,
        /// Why.
        source: Box<SceneError>,
    },
    /// The engine refused a direction.
    #[error("{epoch_utc}: {source}")]
    Light {
        /// The epoch, UTC.
        epoch_utc: String,
        /// Why.
        source: Box<DirectionError>,
    },
    /// The air has no answer.
    #[error(transparent)]
    Air(Box<AirError>),
    /// A spectrum is none.
    #[error(transparent)]
    Spectrum(Box<SpectrumError>),
    /// A passband is none.
    #[error(transparent)]
    Photometry(Box<PhotometryError>),
    /// A list of times and one of exposures that do not belong together, or bins that are none.
    #[error("a pass needs {needs}, found {found}")]
    Input {
        /// Requirement of the pass.
        needs: &'static str,
        /// Input that was found.
        found: String,
    },
}

// Boxed, so that a result is no larger than what it holds when all is well.
macro_rules! boxed {
    ($($variant:ident: $error:ty),*) => {$(
        impl From<$error> for PassError {
            fn from(error: $error) -> Self {
                Self::$variant(Box::new(error))
            }
        }
    )*};
}

boxed!(Sky: SkyError, Air: AirError, Photometry: PhotometryError, Spectrum: SpectrumError);
