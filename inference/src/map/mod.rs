//! Samples of a curve, or all directions, on the frame of a body.

mod full;
mod quality;
mod result;
mod samples;

pub use full::{MapOptions, map_directions};
pub use quality::{ALIKE, SpinOptions, SpinQuality, SpinQualityError, TRIED, spin_quality};
pub use result::{BodyMaps, MapLayer, MapQuantity, Shortcut, Track, TrackColumn};
pub use samples::{PlacedCurve, map_samples};

use sunglint_analysis::map::GridError;
use sunglint_analysis::samples::SamplesError;
use sunglint_analysis::unmix::{BandsError, UnmixError};
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::spectrum::SpectrumError;
use sunglint_simulator::light::{DirectionError, SceneError, UncoveredError};
use sunglint_simulator::pass::PassError;
use sunglint_simulator::picture;

/// Why there is no map.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// Samples that cannot be used.
    #[error(transparent)]
    Samples(#[from] SamplesError),
    /// A scene whose places are not known, or that cannot be simulated.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// Cells that are none.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Bands that no sunlight reaches.
    #[error(transparent)]
    Bands(#[from] BandsError),
    /// An air without an answer.
    #[error(transparent)]
    Air(#[from] AirError),
    /// A sample that has no reflection factors.
    #[error(transparent)]
    Unmix(#[from] UnmixError),
    /// A constant spectrum that is none.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// A phase angle or a step that is none.
    #[error(transparent)]
    Directions(#[from] picture::MapError),
    /// A target that the light engine refuses.
    #[error("the target {target}")]
    Target {
        /// The target's name.
        target: String,
        /// Why.
        source: SceneError,
    },
    /// A target that cannot be cut into facets.
    #[error(transparent)]
    Facets(SceneError),
    /// A wavelength outside the spectra of the target.
    #[error(transparent)]
    Uncovered(#[from] UncoveredError),
    /// A direction that is none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
    /// A pass without a moment.
    #[error("the pass has no time")]
    NoTime,
    /// A body that is dark.
    #[error("{target} sends nothing back in any direction at {phase_deg:.1}°")]
    Dark {
        /// The target's name.
        target: String,
        /// The phase angle, degrees.
        phase_deg: f64,
    },
    /// No sample that counts.
    #[error("{file}: no valid sample to place")]
    NoSample {
        /// The file.
        file: String,
    },
}
