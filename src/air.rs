//! `sunglint air`: what the atmosphere leaves of a direct beam.

use crate::output::{Console, OutputArgs, Product};
use crate::plot::{Axis, Figure, Panel, Series};
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::str::FromStr;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{
    Aerosol, AerosolModel, Air, AirOptions, Components, Path, Profile, Sampling, Zenith,
};
use sunglint_radiometry::station::Station;

/// What is known of the air; what is not given is the station's, or the profile's own.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "The air")]
pub struct AirModelArgs {
    /// Constituent profile: tropical, midlatitude_summer, midlatitude_winter, subarctic_summer, subarctic_winter, us_standard
    #[arg(long, value_name = "NAME")]
    pub profile: Option<String>,
    /// Pressure at the station (not reduced to sea level), hPa
    #[arg(long, value_name = "HPA")]
    pub pressure_hpa: Option<f64>,
    /// Ozone column above the station, Dobson units
    #[arg(long, value_name = "DU")]
    pub ozone_du: Option<f64>,
    /// Precipitable water above the station, mm
    #[arg(long, value_name = "MM")]
    pub water_mm: Option<f64>,
    /// CO2, ppm by volume [default: 330, the profiles' own]
    #[arg(long, value_name = "PPM")]
    pub co2_ppm: Option<f64>,
    /// Aerosol: none, rural_23km, rural_5km, maritime_23km, urban_5km, tropospheric_50km, rural_23km_summer, or TAU,ALPHA (Ångström: optical
    /// depth above the station at 550 nm, exponent)
    #[arg(long, value_name = "MODEL", default_value = "none")]
    pub aerosol: AerosolArg,
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
    /// The air at an altitude; `station` gives what is not said.
    pub fn air(&self, altitude_m: f64, station: Option<&Station>) -> anyhow::Result<Air> {
        let defaults = station.map(|s| s.air.clone()).unwrap_or_default();
        let options = AirOptions {
            altitude_m,
            pressure_hpa: self.pressure_hpa.or(defaults.pressure_hpa),
            ozone_du: self.ozone_du.or(defaults.ozone_du),
            water_mm: self.water_mm.or(defaults.water_mm),
            co2_ppm: self.co2_ppm,
            aerosol: self.aerosol.0,
            refraction: !self.no_refraction,
            ..AirOptions::new(Profile::named(&self.profile(station))?)
        };
        Ok(Air::new(&options)?)
    }

    /// The profile's name: what was asked for, else the station's, else the thesis' one.
    fn profile(&self, station: Option<&Station>) -> String {
        let asked = self.profile.clone().or_else(|| station.map(|s| s.air.profile.clone()));
        asked.unwrap_or_else(|| "midlatitude_winter".into())
    }

    /// The air in a line.
    pub fn describe(&self, air: &Air, altitude_m: f64, station: Option<&Station>) -> String {
        let c = air.columns();
        let aerosol = match self.aerosol.0 {
            Aerosol::None => "no aerosol".to_owned(),
            Aerosol::Model(model) => format!("aerosol {model}"),
            _ => format!("aerosol {:.3} at 550 nm", c.aerosol_550),
        };
        format!(
            "{} at {altitude_m} m: {:.1} hPa, {:.1} K, ozone {:.1} DU, water {:.2} mm, CO2 {:.0} ppm, {aerosol}",
            self.profile(station),
            c.pressure_hpa,
            c.temperature_k,
            c.ozone_du,
            c.water_mm,
            c.co2_ppm
        )
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
    /// First wavelength, vacuum nm
    #[arg(long, value_name = "NM", default_value_t = 300.0)]
    pub from_nm: f64,
    /// Last wavelength, vacuum nm
    #[arg(long, value_name = "NM", default_value_t = 1240.0)]
    pub to_nm: f64,
    /// Step of the wavelengths, nm; values are means over a step
    #[arg(long, value_name = "NM", default_value_t = 1.0)]
    pub step_nm: f64,
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
    components: Components,
}

/// Computes and shows transmissions.
pub fn run(args: &AirArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let station = match args.altitude_m {
        Some(_) => None,
        None => Some(args.station.get().context("which station's air? (or give --altitude-m)")?),
    };
    let altitude_m =
        args.altitude_m.or(station.as_ref().map(|s| s.site.geodetic().height_m)).unwrap_or(0.0);
    let air = args.model.air(altitude_m, station.as_ref())?;
    let wavelength_nm = args.wavelengths()?;
    let sampling = if args.points {
        Sampling::points(&wavelength_nm)?
    } else {
        Sampling::means(&wavelength_nm, args.step_nm / 2.0)?
    };
    let mut rows = Vec::new();
    for &zenith in &args.zenith {
        let zenith = if args.apparent { Zenith::Apparent(zenith) } else { Zenith::True(zenith) };
        rows.push(Row { path: air.path(zenith)?, components: air.components(zenith, &sampling)? });
    }
    let title = args.model.describe(&air, altitude_m, station.as_ref());
    let product = args.product(&title, &air, &wavelength_nm, &rows, station.as_ref());
    args.out.deliver(&product, console)?;
    if !args.out.is_stdout() && (args.out.output.is_empty() || console.json) {
        console.result(&args.text(&title, &air, &rows)?, &product.json)?;
    }
    Ok(())
}

impl AirArgs {
    fn wavelengths(&self) -> anyhow::Result<Vec<f64>> {
        let (from, to, step) = (self.from_nm, self.to_nm, self.step_nm);
        if !(from.is_finite() && to.is_finite() && step > 0.0 && from <= to) {
            bail!(
                "the wavelengths from {from} to {to} nm by {step} nm are none: --from-nm must not be above --to-nm, and --step-nm above 0"
            );
        }
        let n = ((to - from) / step + 1e-9).floor();
        if n > 1e6 {
            bail!(
                "the wavelengths from {from} to {to} nm by {step} nm are {n} many; more than 1e6 make no sense, the model resolves 20 cm-1: take a larger --step-nm"
            );
        }
        // The count is bounded above.
        Ok((0..=n as u32).map(|i| from + f64::from(i) * step).collect())
    }

    fn label(&self, path: &Path) -> String {
        let (angle, kind) =
            if self.apparent { (path.apparent_deg, "apparent") } else { (path.true_deg, "true") };
        format!("{}° {kind}", round(angle))
    }

    fn product(
        &self,
        title: &str,
        air: &Air,
        wavelength_nm: &[f64],
        rows: &[Row],
        station: Option<&Station>,
    ) -> Product {
        let mut table = Table::default();
        let kind = if self.points {
            "value at the wavelength".to_owned()
        } else {
            format!("mean over {} nm", self.step_nm)
        };
        for (key, value) in [
            ("title", title),
            ("zenith_kind", if self.apparent { "apparent" } else { "true" }),
            ("value", &kind),
        ] {
            table.meta.insert(key.into(), json!(value));
        }
        table.meta.insert("missing".into(), json!(MISSING));
        table.columns.push(Column::f64("wavelength_nm", Some("nm"), wavelength_nm.to_vec()));
        for (row, angle) in rows.iter().zip(&self.zenith) {
            let angle = format!("z{}", round(*angle));
            table.columns.push(Column::f64(
                format!("transmission_{angle}"),
                None,
                row.components.total.clone(),
            ));
            if self.components {
                for (name, values) in constituents(&row.components) {
                    table.columns.push(Column::f64(
                        format!("{name}_{angle}"),
                        None,
                        values.to_vec(),
                    ));
                }
            }
        }
        let json_rows: Vec<Value> = rows.iter().map(|row| self.json_row(air, row)).collect();
        let c = air.columns();
        let json = json!({
            "station": station.map(|s| &s.name), "title": title,
            "columns": { "pressure_hpa": c.pressure_hpa, "temperature_k": c.temperature_k, "ozone_du": c.ozone_du,
                "water_mm": c.water_mm, "co2_ppm": c.co2_ppm, "aerosol_optical_depth_550_nm": c.aerosol_550 },
            "value": kind, "missing": MISSING, "wavelength_nm": wavelength_nm, "zenith": json_rows,
        });
        Product {
            name: "air".into(),
            table,
            figure: Some(self.figure(title, wavelength_nm, rows)),
            json,
        }
    }

    fn json_row(&self, air: &Air, row: &Row) -> Value {
        let masses = air.air_masses(&row.path);
        let mut json = json!({
            "true_deg": row.path.true_deg, "apparent_deg": row.path.apparent_deg,
            "refraction_arcsec": row.path.refraction_arcsec(),
            "airmass": { "rayleigh": masses.rayleigh, "ozone": masses.ozone, "water": masses.water },
            "transmission": row.components.total,
        });
        if self.components {
            let parts = constituents(&row.components)
                .map(|(name, values)| (name.to_owned(), json!(values)));
            json["components"] = Value::Object(parts.collect());
        }
        json
    }

    fn figure(&self, title: &str, wavelength_nm: &[f64], rows: &[Row]) -> Figure {
        let curve =
            |values: &[f64]| wavelength_nm.iter().copied().zip(values.iter().copied()).collect();
        let x = || {
            Axis::linear("vacuum wavelength (nm)")
                .from_to(self.from_nm, self.to_nm.max(self.from_nm + self.step_nm))
        };
        let y = |label: &str| Axis::linear(label).from_to(0.0, 1.0);
        let series = rows.iter().enumerate().map(|(i, row)| {
            Series::line(
                format!("zenith angle {}", self.label(&row.path)),
                i,
                curve(&row.components.total),
            )
        });
        let mut panels = vec![Panel { x: x(), y: y("transmission"), series: series.collect() }];
        if let (true, Some(last)) = (self.components, rows.last()) {
            let series = constituents(&last.components).enumerate();
            let series = series
                .map(|(i, (name, values))| Series::line(name.replace('_', " "), i, curve(values)));
            let label = format!("constituents, {}", self.label(&last.path));
            panels.push(Panel { x: x(), y: y(&label), series: series.collect() });
        }
        Figure { title: format!("Air: {title}"), panels }
    }

    fn text(&self, title: &str, air: &Air, rows: &[Row]) -> anyhow::Result<String> {
        const SHOWN_NM: [f64; 9] = [320.0, 400.0, 500.0, 550.0, 650.0, 762.0, 850.0, 940.0, 1064.0];
        let mut text = format!(
            "{title}\n\n  zenith angle      refraction  air mass            transmission (mean over 1 nm) at nm\n"
        );
        let _ = write!(text, "  true    apparent      arcsec  Rayleigh   water ");
        for nm in SHOWN_NM {
            let _ = write!(text, "{nm:>8}");
        }
        text.push('\n');
        let sampling = Sampling::means(&SHOWN_NM, 0.5)?;
        for row in rows {
            let masses = air.air_masses(&row.path);
            let _ = write!(
                text,
                "{:8.4}{:10.4}{:12.1}{:10.4}{:9.4} ",
                row.path.true_deg,
                row.path.apparent_deg,
                row.path.refraction_arcsec(),
                masses.rayleigh,
                masses.water
            );
            for t in air.transmission(Zenith::Apparent(row.path.apparent_deg), &sampling)? {
                let _ = write!(text, "{t:8.4}");
            }
            text.push('\n');
        }
        let _ = writeln!(
            text,
            "\n{MISSING}.\n`-o FILE` writes the spectra (.ecsv, .csv, .fits, .json) or draws them (.png, .svg)."
        );
        Ok(text)
    }
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
