//! The virtual observatory behind the devices: a night that is made up as it is asked for, and known.
//!
//! [`VirtualObservatory`] is the night; it hands out a camera ([`VirtualCamera`]) and a counter ([`VirtualCounter`]) that are devices
//! like any other, and writes its truth beside. Both take the time from the clock of the deadlines that they are given, whose zero
//! is the night's begin: each lives on a clock of its own, and neither waits for the other. They stand beside the simulated devices of the drivers, not
//! behind their protocols: a night of ten hours is 18,000 frames and 360,000 bins, which would be packed into Base64 and JSON, sent through
//! memory and unpacked for nothing that a night tests. [`ThroughScene`] and [`ThroughLight`] put the same night behind these protocols
//! where they are what is tested.

mod camera;
mod counter;
mod stays;
mod through;

pub use camera::VirtualCamera;
pub use counter::VirtualCounter;
pub use stays::{Scheduled, Stay};
pub use through::{ThroughLight, ThroughScene};

use super::mount::{Driven, DrivenMount};
use super::night::{Night, NightError};
use super::options::Options;
use super::plan::{Visit, visits};
use super::watch::Watch;
use hifitime::Epoch;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError, ecsv};
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::sky::{EarthOrientation, SkyError, StarError};
use sunglint_radiometry::station::Station;

/// Why a virtual observatory cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ObservatoryError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A key that is not known, or a value that no night can have, with its line.
    #[error(transparent)]
    Options(#[from] ParseError),
    /// A visit that no night can have.
    #[error(transparent)]
    Visit(#[from] NightError),
    /// The visits or the options do not make a night.
    #[error("the virtual night")]
    Night(#[source] NightError),
    /// The same, with the file that it was read from.
    #[error("{}: the virtual night", file.display())]
    NightOf {
        /// The file.
        file: PathBuf,
        /// Why.
        source: NightError,
    },
    /// A star of a schedule that the catalogue does not have.
    #[error("visit of {name}: a virtual night needs a star of the catalogue")]
    NotInCatalogue {
        /// The star.
        name: String,
        /// Why.
        source: StarError,
    },
    /// A satellite of a schedule without a light curve.
    #[error(
        "visit of {name}: its light is not known: {} needs a [[visit]] of kind \"satellite\" with this name and a `curve`",
        file.display()
    )]
    NoLight {
        /// The satellite.
        name: String,
        /// The file that should say it.
        file: PathBuf,
    },
    /// The sky over a night with a mount cannot be calculated.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// A stay of a schedule that has no end.
    #[error("visit of {name}: in a virtual night each visit ends (`to`, `for_s`)")]
    Endless {
        /// The target.
        name: String,
    },
    /// The truth cannot be written.
    #[error(transparent)]
    Truth(#[from] serde_json::Error),
}

/// A night and the instruments in it.
#[derive(Debug, Clone)]
pub struct VirtualObservatory {
    night: Arc<Night>,
    gain_e_per_adu: Option<f64>,
    driven: Option<Driven>,
}

impl VirtualObservatory {
    /// The night of a `virtual.toml` over a station: its visits, or else its plan. Light curves of satellites are found relative to the file.
    ///
    /// # Errors
    /// A file that cannot be read, a key that no night can have (with its line), and what [`Night::new`] refuses.
    pub fn read(
        path: impl AsRef<Path>,
        station: &Station,
        start: Epoch,
        orientation: &EarthOrientation,
    ) -> Result<Self, ObservatoryError> {
        Self::read_at(path.as_ref(), station, start, orientation)
    }

    fn read_at(
        path: &Path,
        station: &Station,
        start: Epoch,
        orientation: &EarthOrientation,
    ) -> Result<Self, ObservatoryError> {
        let document = Document::read(path)?;
        let options = options(&document)?;
        let mut curve = |file: &str| light_curve(&document.resolve(file));
        let visits = visits(&options, station, start, orientation, &mut curve)?;
        Self::new(options, station, start, visits, orientation)
    }

    /// A night with these visits, for instance those of an observer's own schedule.
    ///
    /// # Errors
    /// The errors of [`Night::new`].
    pub fn new(
        options: Options,
        station: &Station,
        start: Epoch,
        visits: Vec<Visit>,
        orientation: &EarthOrientation,
    ) -> Result<Self, ObservatoryError> {
        let night = Night::new(options, station, start, visits, orientation)
            .map_err(ObservatoryError::Night)?;
        let gain_e_per_adu = station.camera.as_ref().map(|camera| camera.gain_e_per_adu);
        Ok(Self { night: Arc::new(night), gain_e_per_adu, driven: None })
    }

    /// The night.
    pub fn night(&self) -> &Arc<Night> {
        &self.night
    }

    /// Camera; `None` if the station has none.
    pub fn camera(&self) -> Option<VirtualCamera> {
        let sensor = self.night.sensor?;
        Some(VirtualCamera::new(self.watch(), sensor, self.gain_e_per_adu))
    }

    /// A counter of these channels, in this order.
    ///
    /// # Errors
    /// [`DeviceError::Unknown`] for a channel that the station does not count.
    pub fn counter(&self, channels: &[String]) -> Result<VirtualCounter, DeviceError> {
        VirtualCounter::new(self.watch(), channels)
    }

    /// The mount; `None` in a night without one.
    pub fn mount(&self) -> Option<DrivenMount> {
        self.driven.as_ref().map(Driven::mount)
    }

    fn watch(&self) -> Watch {
        Watch::new(self.night.clone()).driven_by(self.driven.clone())
    }

    /// The names of all channels that are counted.
    pub fn counter_channels(&self) -> Vec<String> {
        let counters = Watch::new(self.night.clone()).counters();
        counters.into_iter().map(|i| self.night.channels[i].name.clone()).collect()
    }

    /// Returns the truth as JSON.
    ///
    /// # Errors
    /// [`ObservatoryError::Truth`], which no night is known to have.
    pub fn truth(&self) -> Result<String, ObservatoryError> {
        Ok(serde_json::to_string_pretty(&self.night.truth())? + "\n")
    }
}

/// The options of a file, checked.
///
/// # Errors
/// A key that is not known or has a value that no night can have, with its line.
pub fn options(document: &Document) -> Result<Options, ParseError> {
    let options: Options = document.parse()?;
    options.check().map_err(|error| document.error_at(&error.key, error.expected))?;
    Ok(options)
}

/// A predicted light curve of a satellite.
///
/// # Errors
/// A file that cannot be read, or is none.
pub fn light_curve(path: &Path) -> Result<LightCurve, NightError> {
    let refused = |message: String| NightError::Curve { message };
    let table = ecsv::read(path).map_err(|error| refused(error.to_string()))?;
    LightCurve::from_table(path, &table).map_err(|error| refused(error.to_string()))
}
