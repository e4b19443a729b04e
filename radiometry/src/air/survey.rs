//! The air at several zenith angles: transmissions on a grid of wavelengths, by constituent, and through the channels of a station.

use super::{Air, AirError, Components, Path, Sampling, Zenith};
use crate::quadrature::Product;
use crate::station::{Channel, Station};
use rayon::prelude::*;

/// Range of the absorption tables, nm.
pub const TABLES_NM: (f64, f64) = (1e7 / 34_000.0, 1250.0);

/// Wavelengths, and what a value at one is.
#[derive(Debug, Clone, PartialEq)]
pub struct AirGrid {
    /// Vacuum wavelengths, nm.
    pub nm: Vec<f64>,
    /// The width of a mean, nm; `None` for values at the wavelengths.
    pub mean_nm: Option<f64>,
}

/// Request for the transmission of the air.
#[derive(Debug, Clone, PartialEq)]
pub struct AirQuestion {
    /// Zenith angles, degrees.
    pub zenith_deg: Vec<f64>,
    /// Whether these are apparent (refracted), not true.
    pub apparent: bool,
    /// The wavelengths.
    pub grid: AirGrid,
    /// Whether the transmission of each constituent is wanted, too.
    pub components: bool,
}

/// The air at one zenith angle.
#[derive(Debug, Clone)]
pub struct AirRow {
    /// The way of the light.
    pub path: Path,
    /// Transmissions at the wavelengths.
    pub total: Vec<f64>,
    /// Where they were asked for.
    pub components: Option<Components>,
    /// Transmission of the air in each channel of a station.
    pub channels: Vec<ChannelAir>,
}

/// Transmission of the air in a channel for light flat in photons per nm: ∫T P dλ / ∫P dλ.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelAir {
    /// The channel's name.
    pub name: String,
    /// The mean transmission.
    pub transmission: f64,
    /// Width of the channel outside the tables of the air, nm: dark in the transmission.
    pub uncovered_nm: f64,
}

impl ChannelAir {
    fn new(
        transmission: &crate::spectrum::Spectrum<crate::spectrum::Transmission>,
        channel: &Channel,
    ) -> Self {
        let through = channel.times_sensitivity(Product::of(transmission)).integral();
        Self {
            name: channel.name.clone(),
            transmission: through.value / channel.bandwidth_nm(),
            uncovered_nm: through.uncovered_nm,
        }
    }
}

impl Air {
    /// Computes the air at each zenith angle, the angles side by side on the threads; in each the same operations whatever their number.
    ///
    /// # Errors
    /// An angle below the horizon, wavelengths that the tables do not cover: of the first angle that fails.
    pub fn survey(
        &self,
        question: &AirQuestion,
        station: Option<&Station>,
    ) -> Result<Vec<AirRow>, AirError> {
        let sampling = question.grid.sampling()?;
        let row = |&angle: &f64| -> Result<AirRow, AirError> {
            let zenith =
                if question.apparent { Zenith::Apparent(angle) } else { Zenith::True(angle) };
            let path = self.path(zenith)?;
            let components =
                if question.components { Some(self.components(zenith, &sampling)?) } else { None };
            let total = match &components {
                Some(components) => components.total.clone(),
                None => self.transmission(zenith, &sampling)?,
            };
            let channels = match station {
                Some(station) => self.channels(zenith, station)?,
                None => vec![],
            };
            Ok(AirRow { path, total, components, channels })
        };
        let rows: Vec<Result<AirRow, AirError>> = question.zenith_deg.par_iter().map(row).collect();
        // The first angle that fails is the one that is said, on any number of threads.
        rows.into_iter().collect()
    }

    /// Transmission of the air in each channel of a station.
    fn channels(&self, zenith: Zenith, station: &Station) -> Result<Vec<ChannelAir>, AirError> {
        // Drawn in to what the tables cover.
        let transmission = self.spectrum(zenith, (0.0, f64::INFINITY))?;
        Ok(station.channels.iter().map(|c| ChannelAir::new(&transmission, c)).collect())
    }
}

impl AirRow {
    /// The same at some of its wavelengths, by number.
    pub fn at(&self, picked: &[usize]) -> Self {
        let pick = |values: &[f64]| picked.iter().map(|i| values[*i]).collect();
        Self {
            path: self.path,
            total: pick(&self.total),
            components: self.components.as_ref().map(|c| Components {
                total: pick(&c.total),
                rayleigh: pick(&c.rayleigh),
                ozone: pick(&c.ozone),
                water_lines: pick(&c.water_lines),
                water_continuum: pick(&c.water_continuum),
                oxygen: pick(&c.oxygen),
                carbon_dioxide: pick(&c.carbon_dioxide),
                aerosol: pick(&c.aerosol),
            }),
            channels: self.channels.clone(),
        }
    }
}

impl AirGrid {
    /// How the air is sampled on the grid.
    ///
    /// # Errors
    /// Wavelengths that the tables do not cover.
    pub fn sampling(&self) -> Result<Sampling, AirError> {
        let Some(mean_nm) = self.mean_nm else { return Sampling::points(&self.nm) };
        let (lowest, highest) = TABLES_NM;
        let room = |nm: &f64| (nm - lowest).min(highest - nm);
        let half = mean_nm / 2.0;
        let least = self.nm.iter().map(room).fold(half, f64::min);
        // Where a bin ends on the end of the tables, rounding must not carry it beyond.
        let half = if least < half { least * (1.0 - 1e-12) } else { half };
        Sampling::means(&self.nm, half)
    }

    /// Returns the kind of the values, in words.
    pub fn kind(&self) -> String {
        match self.mean_nm {
            None => "value at the wavelength".into(),
            Some(nm) => format!("mean over {nm} nm"),
        }
    }

    /// At most `most` of the wavelengths, by number, spread evenly from the first to the last.
    pub fn some(&self, most: usize) -> Vec<usize> {
        let n = self.nm.len();
        if n <= most {
            return (0..n).collect();
        }
        (0..most).map(|i| (i * (n - 1) + (most - 1) / 2) / (most - 1)).collect()
    }

    /// Whether a wavelength between two is looked at.
    pub fn touches(&self, from: f64, to: f64) -> bool {
        let (Some(first), Some(last)) = (self.nm.first(), self.nm.last()) else { return false };
        let half = self.mean_nm.unwrap_or(0.0) / 2.0;
        first - half <= to && last + half >= from
    }
}
