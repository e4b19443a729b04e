//! `sunglint air`: what the atmosphere leaves of a direct beam.

mod grid;

use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::bail;
use clap::Args;
use std::str::FromStr;
use sunglint_radiometry::air::survey::AirQuestion;
use sunglint_radiometry::air::{Aerosol, AerosolModel, Air, AirOptions, Profile};
use sunglint_radiometry::station::Station;
use sunglint_report::air::AirReport;

/// Known properties of the air; what is not given is the station's, or the profile's own.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "The air")]
pub struct AirModelArgs {
    /// Constituent profile: tropical, midlatitude_summer, midlatitude_winter, subarctic_summer, subarctic_winter, us_standard
    #[arg(long, value_name = "NAME")]
    pub profile: Option<String>,
    /// Pressure at the station (not reduced to sea level), hPa
    #[arg(long, value_name = "HPA", allow_negative_numbers = true)]
    pub pressure_hpa: Option<f64>,
    /// Ozone column above the station, Dobson units
    #[arg(long, value_name = "DU", allow_negative_numbers = true)]
    pub ozone_du: Option<f64>,
    /// Precipitable water above the station, mm
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub water_mm: Option<f64>,
    /// CO2, ppm by volume [default: 330, the profiles' own]
    #[arg(long, value_name = "PPM", allow_negative_numbers = true)]
    pub co2_ppm: Option<f64>,
    /// Aerosol: none, rural_23km, rural_5km, maritime_23km, urban_5km, tropospheric_50km, rural_23km_summer, or TAU,ALPHA (Ångström: optical
    /// depth above the station at 550 nm, exponent)
    #[arg(long, value_name = "MODEL", allow_hyphen_values = true)]
    pub aerosol: Option<AerosolArg>,
    /// Straight paths: no refraction
    #[arg(long)]
    pub no_refraction: bool,
}

/// An aerosol as the command line names it.
#[derive(Debug, Clone, Copy, Default)]
pub struct AerosolArg(pub Aerosol);

impl FromStr for AerosolArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self(Aerosol::None));
        }
        if let Some(model) = AerosolModel::from_name(text) {
            return Ok(Self(Aerosol::Model(model)));
        }
        let numbers = text
            .split_once(',')
            .and_then(|(tau, alpha)| Some((tau.trim().parse().ok()?, alpha.trim().parse().ok()?)));
        let (optical_depth, exponent) = numbers.ok_or_else(|| {
            let names: Vec<&str> = AerosolModel::ALL.iter().map(|m| m.name()).collect();
            format!("expected none, {} or TAU,ALPHA", names.join(", "))
        })?;
        Ok(Self(Aerosol::Angstrom {
            optical_depth,
            wavelength_nm: 550.0,
            exponent,
            scale_height_m: 1800.0,
        }))
    }
}

impl AirModelArgs {
    /// The air at an altitude; `station` gives what is not said, and without one the thesis' profile.
    pub fn air(&self, altitude_m: f64, station: Option<&Station>) -> anyhow::Result<Air> {
        let known = match station {
            Some(station) => station.air_options()?,
            None => AirOptions::new(Profile::midlatitude_winter()),
        };
        let profile = match &self.profile {
            Some(name) => Profile::named(name)?,
            None => known.profile,
        };
        let options = AirOptions {
            profile,
            altitude_m,
            pressure_hpa: self.pressure_hpa.or(known.pressure_hpa),
            ozone_du: self.ozone_du.or(known.ozone_du),
            water_mm: self.water_mm.or(known.water_mm),
            co2_ppm: self.co2_ppm.or(known.co2_ppm),
            aerosol: self.aerosol.map_or(known.aerosol, |asked| asked.0),
            refraction: !self.no_refraction,
            ..known
        };
        Ok(Air::new(&options)?)
    }
}

/// Returns the properties of an air that can hardly be meant.
pub fn implausible(air: &Air) -> Vec<String> {
    air.implausible()
}

/// Arguments of `sunglint air`.
#[derive(Debug, Args)]
pub struct AirArgs {
    /// Zenith angles, degrees, separated by commas
    #[arg(
        short,
        long,
        value_name = "DEG,...",
        value_delimiter = ',',
        default_value = "0,30,45,60,70,80",
        allow_negative_numbers = true
    )]
    pub zenith: Vec<f64>,
    /// The zenith angles are apparent (refracted), not true
    #[arg(long)]
    pub apparent: bool,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Altitude above sea level, m, instead of a station's
    #[arg(long, value_name = "M", allow_negative_numbers = true, conflicts_with = "station")]
    pub altitude_m: Option<f64>,
    /// First wavelength, vacuum nm [default: 300, or where a wide first mean has room]
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    pub from_nm: Option<f64>,
    /// Last wavelength, vacuum nm [default: 1240, or where a wide last mean has room]
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    pub to_nm: Option<f64>,
    /// Step of the wavelengths, nm; values are means over a step [default: 1]
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    pub step_nm: Option<f64>,
    /// Values at the wavelengths instead of means over a step
    #[arg(long)]
    pub points: bool,
    /// Also the transmission of each constituent
    #[arg(long)]
    pub components: bool,
    /// Known properties of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Computes and shows transmissions.
pub fn run(args: &AirArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    args.out.check_names(&["air.ecsv", "air.png", "air.svg"])?;
    let grid = args.grid()?;
    args.check_angles()?;
    let station = match args.altitude_m {
        Some(_) => None,
        None => Some(args.station.get_or("or give --altitude-m")?),
    };
    let altitude_m =
        args.altitude_m.or(station.as_ref().map(|s| s.site.geodetic().height_m)).unwrap_or(0.0);
    let air = args.model.air(altitude_m, station.as_ref())?;
    for warning in air.implausible() {
        console.warn(&warning);
    }
    let title = air.describe();
    if let Some(station) = &station {
        console.detail(&format!("station: {} ({})", station.name, station.description.trim()));
        for (field, note) in &station.notes {
            console.detail(&format!("station: {field}: {note}"));
        }
    }
    console.detail(&format!("air: {title}"));
    console.detail(&format!(
        "grid: {} wavelengths, {}, {} zenith angles, {} threads",
        grid.nm.len(),
        grid.kind(),
        args.zenith.len(),
        rayon::current_num_threads()
    ));
    let question = AirQuestion {
        zenith_deg: args.zenith.clone(),
        apparent: args.apparent,
        grid,
        components: args.components,
    };
    let rows = air.survey(&question, station.as_ref())?;
    let report = AirReport {
        air: &air,
        question: &question,
        own_wavelengths: args.asks_for_wavelengths(),
        rows: &rows,
        station: station.as_ref(),
    };
    let product = report.product(args.out.wants_json(console));
    let text = if console.json { String::new() } else { report.text()? };
    args.out.finish(&product, &text, console)
}

impl AirArgs {
    /// Each angle has columns of its own, named with four digits.
    fn check_angles(&self) -> anyhow::Result<()> {
        for (i, angle) in self.zenith.iter().enumerate() {
            if self.zenith[..i].iter().any(|other| round(*other) == round(*angle)) {
                bail!("--zenith names {}° twice: each angle once, 0.0001° apart", round(*angle));
            }
        }
        Ok(())
    }
}

/// An angle as people write it.
fn round(angle: f64) -> f64 {
    (angle * 1e4).round() / 1e4
}
