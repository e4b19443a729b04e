//! A curve and the light under which it was taken.

use super::super::numbers::{Curve, Numbers, Source, Surroundings, places};
use crate::air::AirModelArgs;
use crate::simulate::read as read_pass;
use crate::station::StationArgs;
use clap::Args;
use std::path::{Path, PathBuf};
use sunglint_analysis::unmix::{Bands, Endmember, Light};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{Overrides, Pass, Place};

/// What is known of the light: a scene, or a station and its air.
#[derive(Debug, Args)]
pub struct GivenArgs {
    /// The scene of the curve: where target and Sun stood, its air and station
    #[arg(long, value_name = "PASS.toml")]
    pub pass: Option<PathBuf>,
    /// The rates are those above the air
    #[arg(long, conflicts_with_all = ["profile", "pressure_hpa", "ozone_du", "water_mm", "co2_ppm", "aerosol", "no_refraction"])]
    pub no_air: bool,
    /// Which station, in place of the scene's.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air, where no scene says.
    #[command(flatten)]
    pub model: AirModelArgs,
}

/// A curve with all that reflection factors need.
pub struct Given {
    pub curve: Curve,
    pub pass: Option<Pass>,
    no_air: bool,
    station: Option<Station>,
    air: Option<Air>,
    /// Where all stood, by the scene.
    pub places: Option<Vec<Place>>,
}

impl Given {
    /// Reads the curve, and the scene or the station.
    pub fn read(path: &Path, args: &GivenArgs) -> anyhow::Result<Self> {
        let curve = Curve::read(path)?;
        let pass = match &args.pass {
            Some(path) => Some(read_pass(path, &args.station, Overrides::default())?),
            None => None,
        };
        let rates = matches!(curve.source, Source::Rates(_));
        let station = match &pass {
            None if rates || !curve.is_intensity() && !args.no_air => Some(args.station.get()?),
            _ => None,
        };
        let air = match &station {
            Some(station) if !args.no_air => {
                Some(args.model.air(station.site.geodetic().height_m, Some(station))?)
            }
            _ => None,
        };
        let places = pass.as_ref().map(|p| places(p, curve.samples())).transpose()?;
        Ok(Self { curve, pass, no_air: args.no_air, station, air, places })
    }

    fn around(&self) -> Surroundings<'_> {
        let air = match &self.pass {
            Some(pass) => pass.air.as_ref(),
            None => self.air.as_ref(),
        };
        Surroundings {
            pass: self.pass.as_ref(),
            station: self.pass.as_ref().map(|p| &p.station).or(self.station.as_ref()),
            air: air.filter(|_| !self.no_air),
        }
    }

    /// The bands of the curve with some endmembers.
    pub fn bands(&self, endmembers: &[Endmember]) -> anyhow::Result<Bands> {
        self.curve.bands(&self.around(), endmembers)
    }

    /// The middle of each band, vacuum nm.
    pub fn middles_nm(&self) -> anyhow::Result<Vec<f64>> {
        self.curve.middles_nm(&self.around())
    }

    /// Under what light each sample was taken, and its numbers, of which those without sunlight do not count.
    pub fn samples(&self, warnings: &mut Vec<String>) -> anyhow::Result<(Vec<Light>, Numbers)> {
        let lights = self.curve.lights(&self.around(), self.places.as_deref(), warnings)?;
        let mut numbers = self.curve.numbers();
        // In the umbra nothing is reflected that could be divided.
        for (i, light) in lights.iter().enumerate() {
            if light.sunlight <= 0.0 {
                numbers.valid.row_mut(i).fill(false);
            }
        }
        Ok((lights, numbers))
    }

    /// Whether weights are in m² sr⁻¹, the ranges being known.
    pub fn is_absolute(&self) -> bool {
        self.curve.is_intensity() || self.places.is_some() || self.curve.samples().range_m.is_some()
    }
}
