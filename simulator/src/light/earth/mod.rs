//! Albedo of the Earth: one value everywhere, or a table of it over latitude and longitude.
//!
//! Either is a Lambert surface. The albedo is ρ(x, λ) = Σ_l τ_l(λ) a_l(x): *layers*, each a spectrum before a share that depends on the place. An Earth that is
//! the same everywhere has one layer with a share of 1; a table of grey albedos one with a spectrum of 1; a table at several wavelengths one for each of them,
//! with hat functions as spectra, which is linear interpolation between them. So light from the Earth has terms of its own for each layer
//! ([`super::Term`]), and no epoch sees a wavelength.

pub mod cap;
pub mod csv;
pub mod fits;
pub mod grid;

use super::Globe;
use cap::LitCap;
use glam::DVec3;
use grid::AlbedoGrid;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum, SpectrumError};

/// The mean (Bond) albedo of the Earth (Stephens et al. 2015, Reviews of Geophysics 53: 0.29 to 0.30).
pub const EARTH_ALBEDO: f64 = 0.30;
/// How far the Earth below one orbit may differ from its mean or from a table that does not say, relative: clouds.
pub const EARTH_UNCERTAINTY: f64 = 0.5;
/// Where a grey albedo is taken as known, nm: all that sunlight is tabulated for.
pub(super) const GREY_NM: (f64, f64) = (200.0, 4000.0);

/// Albedo of the Earth, and how well it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct EarthAlbedo {
    ground: Ground,
    uncertainty: f64,
}

#[derive(Debug, Clone, PartialEq)]
enum Ground {
    Grey(f64),
    Coloured(Spectrum<Reflectance>),
    Table { name: String, grid: AlbedoGrid },
}

/// An albedo or an uncertainty that is none.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{what} of the Earth is {found}, expected a number from 0 to 1")]
pub struct WrongAlbedo {
    what: &'static str,
    found: f64,
}

/// A grey Earth of the mean albedo.
impl Default for EarthAlbedo {
    fn default() -> Self {
        Self { ground: Ground::Grey(EARTH_ALBEDO), uncertainty: EARTH_UNCERTAINTY }
    }
}

fn fraction(what: &'static str, found: f64) -> Result<f64, WrongAlbedo> {
    if (0.0..=1.0).contains(&found) { Ok(found) } else { Err(WrongAlbedo { what, found }) }
}

impl EarthAlbedo {
    /// The same albedo everywhere and at all wavelengths, from 0 to 1.
    ///
    /// # Errors
    /// An albedo that is none.
    pub fn grey(albedo: f64) -> Result<Self, WrongAlbedo> {
        Ok(Self { ground: Ground::Grey(fraction("the albedo", albedo)?), ..Self::default() })
    }

    /// The same spectrum everywhere.
    pub fn coloured(spectrum: Spectrum<Reflectance>) -> Self {
        Self { ground: Ground::Coloured(spectrum), ..Self::default() }
    }

    /// A table over latitude and longitude; `name` says which.
    pub fn tabulated(name: impl Into<String>, grid: AlbedoGrid) -> Self {
        Self { ground: Ground::Table { name: name.into(), grid }, ..Self::default() }
    }

    /// The same with another uncertainty, relative, from 0 to 1 ([`EARTH_UNCERTAINTY`] unless one is given).
    ///
    /// # Errors
    /// An uncertainty that is none.
    pub fn with_uncertainty(mut self, relative: f64) -> Result<Self, WrongAlbedo> {
        self.uncertainty = fraction("the uncertainty of the albedo", relative)?;
        Ok(self)
    }

    /// How far the true albedo may be off, relative. It is in what earthshine could add at most, in no stated error.
    pub fn uncertainty(&self) -> f64 {
        self.uncertainty
    }

    /// Returns the table of the albedo, where there is one.
    pub fn grid(&self) -> Option<&AlbedoGrid> {
        match &self.ground {
            Ground::Table { grid, .. } => Some(grid),
            _ => None,
        }
    }

    /// How many layers it has.
    pub fn layers(&self) -> usize {
        self.grid().map_or(1, AlbedoGrid::layers)
    }

    /// The spectrum that stands before each layer; known where the albedo is.
    ///
    /// # Errors
    /// None that a table could have: its wavelengths increase.
    pub fn spectra(&self) -> Result<Vec<Spectrum<Reflectance>>, SpectrumError> {
        match &self.ground {
            Ground::Grey(albedo) => Ok(vec![Spectrum::constant(*albedo, GREY_NM.0, GREY_NM.1)?]),
            Ground::Coloured(spectrum) => Ok(vec![spectrum.clone()]),
            Ground::Table { grid, .. } => grid.spectra(),
        }
    }

    /// The largest value of any layer's spectrum: what a weight of its terms is multiplied by at most.
    pub(super) fn largest_factor(&self) -> f64 {
        match &self.ground {
            Ground::Grey(albedo) => *albedo,
            Ground::Coloured(spectrum) => spectrum.value().iter().copied().fold(0.0, f64::max),
            Ground::Table { .. } => 1.0,
        }
    }

    /// The largest albedo anywhere and at any wavelength, its uncertainty on top.
    pub fn most(&self) -> f64 {
        let most = self.grid().map_or_else(|| self.largest_factor(), |grid| grid.range().1);
        ((1.0 + self.uncertainty) * most).min(1.0)
    }

    /// The wavelengths that it is known at, nm: first and last.
    pub fn known_nm(&self) -> (f64, f64) {
        match &self.ground {
            Ground::Grey(_) => GREY_NM,
            Ground::Coloured(spectrum) => spectrum.range_nm(),
            Ground::Table { grid, .. } => grid.known_nm(),
        }
    }

    /// The spectra of the layers at a wavelength; beyond [`EarthAlbedo::known_nm`] the nearest that is known.
    pub(super) fn factors(&self, nm: f64) -> Vec<f64> {
        match &self.ground {
            Ground::Grey(albedo) => vec![*albedo],
            Ground::Coloured(spectrum) => vec![spectrum.at(nm)],
            Ground::Table { grid, .. } => grid.factors(nm),
        }
    }

    /// Returns the mean albedo over the globe at a wavelength; beyond [`EarthAlbedo::known_nm`] the nearest that is known.
    pub fn mean_at(&self, nm: f64) -> f64 {
        let factors = self.factors(nm);
        match self.grid() {
            None => factors[0],
            Some(grid) => factors.iter().zip(grid.means()).map(|(f, mean)| f * mean).sum(),
        }
    }

    /// Directions (unit vectors, the globe's axes of the body) from which the lit cap of a globe shines at a wavelength, and from each the irradiance across it, of
    /// the Sun's: [`LitCap::rule`] with `order` points along each side of a panel.
    pub fn shines(&self, globe: &Globe, order: usize, nm: f64) -> Vec<(DVec3, f64)> {
        let factors = self.factors(nm);
        let rule = LitCap::new(globe, self).rule(order);
        let light = |i: usize| factors.iter().zip(rule.lights(i)).map(|(f, l)| f * l).sum::<f64>();
        rule.nodes.iter().enumerate().map(|(i, (toward, _))| (*toward, light(i))).collect()
    }

    /// In words, without the uncertainty.
    pub fn describe(&self) -> String {
        let span = |(least, most): (f64, f64)| format!("{least:.2} to {most:.2}");
        match &self.ground {
            Ground::Grey(albedo) => format!("a Lambert globe of albedo {albedo:.2}"),
            Ground::Coloured(spectrum) => {
                let value = spectrum.value().iter();
                let least = value.clone().copied().fold(f64::INFINITY, f64::min);
                let (first, last) = spectrum.range_nm();
                format!(
                    "a Lambert globe of albedo {}, tabulated from {first} to {last} nm",
                    span((least, self.largest_factor()))
                )
            }
            Ground::Table { name, grid } => {
                let (rows, columns) = grid.size();
                let colour = match grid.wavelengths_nm() {
                    [] => "grey".to_owned(),
                    all => {
                        let (first, last) = grid.known_nm();
                        format!("at {} wavelengths from {first} to {last} nm", all.len())
                    }
                };
                let means = grid.means();
                let mean = means.iter().sum::<f64>() / means.len() as f64;
                format!(
                    "a Lambert globe with the albedos of {name}: {rows} × {columns} cells, {}, mean {mean:.3}, {colour}",
                    span(grid.range())
                )
            }
        }
    }
}
