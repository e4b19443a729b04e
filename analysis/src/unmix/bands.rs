//! Light of a unit reflector in each band, and that of each material.

use super::Endmember;
use ndarray::Array2;
use sunglint_radiometry::air::{Air, AirError, AirTable, Sampling, Zenith};
use sunglint_radiometry::constants::HC_J_NM;
use sunglint_radiometry::quadrature::{Integral, Product};
use sunglint_radiometry::spectrum::{Irradiance, Response, Spectrum, SpectrumError};
use sunglint_radiometry::station::Channel;

/// Why there are no reflection factors.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BandsError {
    /// A band in which there is no sunlight.
    #[error("{band}: no sunlight reaches it, so that nothing can be divided by it")]
    Dark {
        /// Which.
        band: String,
    },
    /// Nothing to divide, or nothing to unmix with.
    #[error("{bands} bands and {endmembers} endmembers: at least one of each is needed")]
    Empty {
        /// Bands.
        bands: usize,
        /// Endmembers.
        endmembers: usize,
    },
    /// The air.
    #[error(transparent)]
    Air(#[from] AirError),
    /// A spectrum or edges that are none.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
}

/// Integrals of sunlight over bands, with and without materials, with and without the air: what all samples share.
#[derive(Debug, Clone)]
pub struct Bands {
    /// The bands' names.
    pub names: Vec<String>,
    /// The endmembers' names.
    pub endmembers: Vec<String>,
    /// For each band that of the unit reflector, then those of the endmembers: `[band * (1 + endmembers) + k]`.
    integrals: Vec<Integral>,
    air: Option<AirTable>,
}

/// Bands at one airmass.
#[derive(Debug, Clone, PartialEq)]
pub struct Factors {
    /// Light of a unit reflector (1 m² sr⁻¹) at a Sun 1 au and an observer 1 m away: Hz m² sr for channels, W m⁻² nm⁻¹ for bins.
    pub unit: Vec<f64>,
    /// Reflection factor of each endmember, bands × endmembers.
    pub matrix: Array2<f64>,
}

enum Band<'a> {
    Channel(&'a Channel, f64),
    Bin(Spectrum<Response>),
}

impl Band<'_> {
    fn of<'b>(&'b self, product: Product<'b>) -> Product<'b> {
        match self {
            Self::Channel(channel, scale) => {
                channel.times_sensitivity(product).times_wavelength().times_number(*scale)
            }
            Self::Bin(mean) => product.times(mean),
        }
    }
}

impl Bands {
    /// Photon channels behind a telescope of `area_m2`. `air` comes with the tolerance of its table over the zenith angle.
    ///
    /// # Errors
    /// No channel, no endmember; a channel without sunlight; an air that has no table.
    pub fn channels(
        sun: &Spectrum<Irradiance>,
        channels: &[&Channel],
        area_m2: f64,
        endmembers: &[Endmember],
        air: Option<(&Air, f64)>,
    ) -> Result<Self, BandsError> {
        let bands = channels.iter().map(|c| Band::Channel(c, area_m2 / HC_J_NM)).collect();
        Self::new(sun, channels.iter().map(|c| c.name.clone()).collect(), bands, endmembers, air)
    }

    /// Bins of wavelength between edges (vacuum nm): spectral means, no photons.
    ///
    /// # Errors
    /// The errors of [`Bands::channels`]; edges that do not increase.
    pub fn bins(
        sun: &Spectrum<Irradiance>,
        edges_nm: &[f64],
        endmembers: &[Endmember],
        air: Option<(&Air, f64)>,
    ) -> Result<Self, BandsError> {
        let bin = |e: &[f64]| Spectrum::constant(1.0 / (e[1] - e[0]), e[0], e[1]).map(Band::Bin);
        let bands = edges_nm.windows(2).map(bin).collect::<Result<_, _>>()?;
        let name = |e: &[f64]| format!("{} to {} nm", e[0], e[1]);
        Self::new(sun, edges_nm.windows(2).map(name).collect(), bands, endmembers, air)
    }

    fn new(
        sun: &Spectrum<Irradiance>,
        names: Vec<String>,
        bands: Vec<Band<'_>>,
        endmembers: &[Endmember],
        air: Option<(&Air, f64)>,
    ) -> Result<Self, BandsError> {
        if bands.is_empty() || endmembers.is_empty() {
            return Err(BandsError::Empty { bands: bands.len(), endmembers: endmembers.len() });
        }
        let mut products = Vec::with_capacity(bands.len() * (1 + endmembers.len()));
        for band in &bands {
            products.push(band.of(Product::of(sun)));
            for endmember in endmembers {
                products.push(band.of(Product::of(sun).times(&endmember.reflectance)));
            }
        }
        let (integrals, table) = match air {
            None => (products.iter().map(Product::integral).collect::<Vec<_>>(), None),
            Some((air, tolerance)) => {
                let (sampling, integrals) = Sampling::weighted(&products)?;
                (integrals, Some(AirTable::new(air, &sampling, tolerance)?))
            }
        };
        let row = 1 + endmembers.len();
        if let Some(dark) = (0..bands.len()).find(|b| integrals[b * row].value <= 0.0) {
            return Err(BandsError::Dark { band: names[dark].clone() });
        }
        let endmembers = endmembers.iter().map(|e| e.name.clone()).collect();
        Ok(Self { names, endmembers, integrals, air: table })
    }

    /// The width of each band for which the light, the air or the endmember is not tabulated, nm: bands × endmembers.
    pub fn uncovered_nm(&self) -> Array2<f64> {
        let row = 1 + self.endmembers.len();
        Array2::from_shape_fn((self.names.len(), self.endmembers.len()), |(b, e)| {
            self.integrals[b * row + 1 + e].uncovered_nm
        })
    }

    /// Returns the relative error that a mean transmission may have by its table over the zenith angle.
    pub fn air_error(&self) -> f64 {
        self.air.as_ref().map_or(0.0, AirTable::interpolation_error)
    }

    /// The bands at a zenith angle; without air it does not count.
    ///
    /// # Errors
    /// A zenith angle below the horizon.
    pub fn at(&self, zenith: Zenith) -> Result<Factors, AirError> {
        let mut transmissions = vec![1.0; self.integrals.len()];
        if let Some(table) = &self.air {
            table.transmissions_into(&[zenith], &mut transmissions)?;
        }
        let row = 1 + self.endmembers.len();
        let value = |i: usize| self.integrals[i].value * transmissions[i];
        let unit: Vec<f64> = (0..self.names.len()).map(|b| value(b * row)).collect();
        let matrix = Array2::from_shape_fn((self.names.len(), self.endmembers.len()), |(b, e)| {
            value(b * row + 1 + e) / unit[b]
        });
        Ok(Factors { unit, matrix })
    }
}
