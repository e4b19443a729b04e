//! `sunglint air`: what the atmosphere leaves of a direct beam.

mod grid;
mod text;
mod words;

use words::aerosol_json;
pub use words::implausible;

use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::bail;
use clap::Args;
use grid::Grid;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::str::FromStr;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{
    Aerosol, AerosolModel, Air, AirOptions, Components, Path, Profile, Sampling, Zenith,
};
use sunglint_radiometry::quadrature::Product as Integrand;
use sunglint_radiometry::station::Station;
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};

/// What is known of the air; what is not given is the station's, or the profile's own.
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
    /// What is known of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// One zenith angle of the result.
struct Row {
    path: Path,
    total: Vec<f64>,
    /// Where they were asked for.
    components: Option<Components>,
    /// What the air leaves in each channel of a station.
    channels: Vec<ChannelAir>,
}

/// What the air leaves in a channel of light flat in photons per nm: ∫T P dλ / ∫P dλ.
#[derive(Clone)]
struct ChannelAir {
    name: String,
    transmission: f64,
    /// Width of the channel outside the tables of the air, nm: dark in the transmission.
    uncovered_nm: f64,
}

impl Row {
    /// The same at some of its wavelengths.
    fn at(&self, picked: &[usize]) -> Self {
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

/// What was asked, and what came out.
struct Answer<'a> {
    title: &'a str,
    air: &'a Air,
    grid: &'a Grid,
    rows: &'a [Row],
    station: Option<&'a Station>,
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
    for warning in implausible(&air) {
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
    let rows = args.rows(&air, &grid.sampling()?, station.as_ref())?;
    let answer =
        Answer { title: &title, air: &air, grid: &grid, rows: &rows, station: station.as_ref() };
    let mut product = args.product(&answer);
    if args.out.wants_json(console) {
        product.json = args.json(&answer);
    }
    let text = if console.json { String::new() } else { args.text(&answer)? };
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

    /// The air at each zenith angle, the angles side by side on the threads; in each the same operations whatever their number.
    fn rows(
        &self,
        air: &Air,
        sampling: &Sampling,
        station: Option<&Station>,
    ) -> anyhow::Result<Vec<Row>> {
        let row = |&angle: &f64| -> anyhow::Result<Row> {
            let zenith = if self.apparent { Zenith::Apparent(angle) } else { Zenith::True(angle) };
            let path = air.path(zenith)?;
            let components =
                if self.components { Some(air.components(zenith, sampling)?) } else { None };
            let total = match &components {
                Some(components) => components.total.clone(),
                None => air.transmission(zenith, sampling)?,
            };
            let channels = match station {
                Some(station) => channels(air, zenith, station)?,
                None => vec![],
            };
            Ok(Row { path, total, components, channels })
        };
        let rows: Vec<anyhow::Result<Row>> = self.zenith.par_iter().map(row).collect();
        // The first angle that fails is the one that is said, on any number of threads.
        rows.into_iter().collect()
    }

    fn label(&self, path: &Path) -> String {
        let (angle, kind) =
            if self.apparent { (path.apparent_deg, "apparent") } else { (path.true_deg, "true") };
        format!("{}° {kind}", round(angle))
    }

    fn product(&self, answer: &Answer) -> Product {
        let Answer { title, grid, rows, .. } = *answer;
        let mut table = Table::default();
        for (key, value) in [
            ("title", title),
            ("zenith_kind", if self.apparent { "apparent" } else { "true" }),
            ("value", &grid.kind()),
        ] {
            table.meta.insert(key.into(), json!(value));
        }
        table.meta.insert("missing".into(), json!(MISSING));
        table.columns.push(Column::f64("wavelength_nm", Some("nm"), grid.nm.clone()));
        for (row, angle) in rows.iter().zip(&self.zenith) {
            let angle = format!("z{}", round(*angle));
            table.columns.push(Column::f64(
                format!("transmission_{angle}"),
                None,
                row.total.clone(),
            ));
            for (name, values) in row.components.iter().flat_map(constituents) {
                let name = format!("{name}_{angle}");
                table.columns.push(Column::f64(name, None, values.to_vec()));
            }
        }
        let figure = Some(self.figure(title, grid, rows));
        Product { name: "air".into(), table, figure, json: Value::Null, ..Product::default() }
    }

    fn json(&self, answer: &Answer) -> Value {
        let Answer { title, air, grid, rows, station } = *answer;
        let json_rows: Vec<Value> = rows.iter().map(|row| self.json_row(air, row)).collect();
        let c = air.columns();
        json!({
            "station": station.map(|s| &s.name), "title": title,
            "columns": { "pressure_hpa": rounded(c.pressure_hpa), "temperature_k": rounded(c.temperature_k),
                "ozone_du": rounded(c.ozone_du), "water_mm": rounded(c.water_mm), "co2_ppm": rounded(c.co2_ppm),
                "aerosol_optical_depth_550_nm": rounded(c.aerosol_550) },
            "aerosol": aerosol_json(air),
            "value": grid.kind(), "missing": MISSING, "wavelength_nm": grid.nm, "zenith": json_rows,
        })
    }

    fn json_row(&self, air: &Air, row: &Row) -> Value {
        let masses = air.air_masses(&row.path);
        let list = |values: &[f64]| -> Vec<f64> { values.iter().map(|v| rounded(*v)).collect() };
        let mut json = json!({
            "true_deg": rounded(row.path.true_deg), "apparent_deg": rounded(row.path.apparent_deg),
            "refraction_arcsec": rounded(row.path.refraction_arcsec()),
            "airmass": { "rayleigh": rounded(masses.rayleigh), "ozone": rounded(masses.ozone), "water": rounded(masses.water) },
            "transmission": list(&row.total),
        });
        if !row.channels.is_empty() {
            let channel = |c: &ChannelAir| {
                json!({ "channel": c.name, "transmission": rounded(c.transmission),
                    "extinction_mag": rounded(magnitudes(c.transmission)), "uncovered_nm": rounded(c.uncovered_nm) })
            };
            json["channels_for_flat_photons"] = row.channels.iter().map(channel).collect();
        }
        if let Some(components) = &row.components {
            let parts = constituents(components)
                .map(|(name, values)| (name.to_owned(), json!(list(values))));
            json["components"] = Value::Object(parts.collect());
        }
        json
    }

    fn figure(&self, title: &str, grid: &Grid, rows: &[Row]) -> Figure {
        let curve = |values: &[f64]| grid.nm.iter().copied().zip(values.iter().copied()).collect();
        let x = || {
            let axis = Axis::linear("vacuum wavelength (nm)");
            match (grid.nm.first(), grid.nm.last()) {
                (Some(first), Some(last)) => axis.from_to(*first, *last),
                _ => axis,
            }
        };
        let y = |label: &str| Axis::linear(label).from_to(0.0, 1.0);
        let series = rows.iter().enumerate().map(|(i, row)| {
            let name = format!("zenith angle {}", self.label(&row.path));
            Series::line(name, i, curve(&row.total))
        });
        let mut panels = vec![Panel::new(x(), y("transmission"), series.collect())];
        if let Some((last, components)) =
            rows.last().and_then(|row| Some((row, row.components.as_ref()?)))
        {
            let series = constituents(components).enumerate();
            let series = series
                .map(|(i, (name, values))| Series::line(name.replace('_', " "), i, curve(values)));
            let label = format!("constituents, {}", self.label(&last.path));
            panels.push(Panel::new(x(), y(&label), series.collect()));
        }
        Figure { title: format!("Air: {title}"), panels }
    }
}

/// What the air leaves in each channel of a station.
fn channels(air: &Air, zenith: Zenith, station: &Station) -> anyhow::Result<Vec<ChannelAir>> {
    // Drawn in to what the tables cover.
    let transmission = air.spectrum(zenith, (0.0, f64::INFINITY))?;
    let of = |channel: &sunglint_radiometry::station::Channel| {
        let through = channel.times_sensitivity(Integrand::of(&transmission)).integral();
        ChannelAir {
            name: channel.name.clone(),
            transmission: through.value / channel.bandwidth_nm(),
            uncovered_nm: through.uncovered_nm,
        }
    };
    Ok(station.channels.iter().map(of).collect())
}

/// A transmission in magnitudes.
fn magnitudes(transmission: f64) -> f64 {
    // No minus before the 0 of clear air.
    -2.5 * transmission.log10() + 0.0
}

/// The parts of the total.
fn constituents(components: &Components) -> impl Iterator<Item = (&'static str, &[f64])> {
    components.iter().filter(|(name, _)| *name != "total")
}

/// What the model leaves out and a user may miss.
const MISSING: &str = "not in the model: O2-O2 absorption near 577, 630 and 1064 nm (1064 nm too high by 0.015 at the zenith), scattered light, lines narrower than 20 cm-1";

/// An angle as people write it.
fn round(angle: f64) -> f64 {
    (angle * 1e4).round() / 1e4
}
