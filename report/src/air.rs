//! Transmission of the atmosphere for a direct beam: text, JSON, table and figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Map;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::survey::{AirGrid, AirQuestion, AirRow, ChannelAir};
use sunglint_radiometry::air::{Aerosol, Air, AirError, Components, Path};
use sunglint_radiometry::station::Station;

/// Question about the air, and its answer.
#[derive(Debug, Clone, Copy)]
pub struct AirReport<'a> {
    /// The air.
    pub air: &'a Air,
    /// Question that was asked.
    pub question: &'a AirQuestion,
    /// Whether the wavelengths are a person's own, not the usual ones.
    pub own_wavelengths: bool,
    /// Answer, a row for each zenith angle.
    pub rows: &'a [AirRow],
    /// The station above which it is.
    pub station: Option<&'a Station>,
}

/// Wavelengths that the text shows where none are asked for.
const USUAL_NM: [f64; 9] = [320.0, 400.0, 500.0, 550.0, 650.0, 762.0, 850.0, 940.0, 1064.0];
/// So many wavelengths stand beside one another.
const MOST_SHOWN: usize = 12;

/// The wavelengths that the text shows, and the air at them, one row an angle.
struct Shown {
    heading: String,
    nm: Vec<f64>,
    rows: Vec<AirRow>,
}

impl Shown {
    /// Some of what was computed where wavelengths were asked for, else the usual ones.
    fn new(report: &AirReport) -> Result<Self, AirError> {
        let grid = &report.question.grid;
        if report.own_wavelengths {
            let picked = grid.some(MOST_SHOWN);
            let of = if picked.len() < grid.nm.len() {
                format!("; {} of the {} wavelengths (-o FILE has all)", picked.len(), grid.nm.len())
            } else {
                String::new()
            };
            let rows = report.rows.iter().map(|row| row.at(&picked)).collect();
            let nm = picked.iter().map(|i| grid.nm[*i]).collect();
            return Ok(Self { heading: grid.kind() + &of, nm, rows });
        }
        let usual = AirGrid { nm: USUAL_NM.to_vec(), mean_nm: grid.mean_nm };
        let heading = format!("{}; some wavelengths (-o FILE has all)", usual.kind());
        let question = AirQuestion { grid: usual, ..report.question.clone() };
        let rows = report.air.survey(&question, None)?;
        Ok(Self { heading, nm: question.grid.nm, rows })
    }
}

#[derive(Serialize)]
struct AirJson<'a> {
    station: Option<&'a String>,
    title: String,
    columns: ColumnsJson,
    aerosol: AerosolJson,
    value: String,
    missing: &'a str,
    wavelength_nm: &'a [f64],
    zenith: Vec<ZenithJson<'a>>,
}

#[derive(Serialize)]
struct ColumnsJson {
    pressure_hpa: f64,
    temperature_k: f64,
    ozone_du: f64,
    water_mm: f64,
    co2_ppm: f64,
    aerosol_optical_depth_550_nm: f64,
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    channel: &'a str,
    transmission: f64,
    extinction_mag: f64,
    uncovered_nm: f64,
}

#[derive(Serialize)]
struct ZenithJson<'a> {
    true_deg: f64,
    apparent_deg: f64,
    refraction_arcsec: f64,
    airmass: AirmassJson,
    transmission: Vec<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    channels_for_flat_photons: Vec<ChannelJson<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    components: Option<Map<String, Value>>,
}

#[derive(Serialize)]
struct AirmassJson {
    rayleigh: f64,
    ozone: f64,
    water: f64,
}

impl AirReport<'_> {
    /// The text.
    ///
    /// # Errors
    /// The air at the wavelengths that are shown, where none were asked for.
    pub fn text(&self) -> Result<String, AirError> {
        let Self { air, rows, station, .. } = *self;
        let grid = &self.question.grid;
        let shown = Shown::new(self)?;
        let mut text = format!("{}\n", air.describe());
        if matches!(air.options().aerosol, Aerosol::None) {
            text.push_str("clean air (no aerosol): real extinction is larger (--aerosol)\n");
        }
        text.push_str(
            "\n  zenith angle       refraction  air mass\n  true      apparent     arcsec  Rayleigh     ozone     water\n",
        );
        for row in rows {
            let masses = air.air_masses(&row.path);
            let _ = writeln!(
                text,
                "{:8.4}{:12.4}{:11.1}{:10.4}{:10.4}{:10.4}",
                row.path.true_deg,
                row.path.apparent_deg,
                row.path.refraction_arcsec(),
                masses.rayleigh,
                masses.ozone,
                masses.water
            );
        }
        let _ = writeln!(text, "\ntransmission ({}), vacuum wavelength in nm", shown.heading);
        let nm: Vec<String> =
            shown.nm.iter().map(|nm| format!("{}", (nm * 1e4).round() / 1e4)).collect();
        heading(&mut text, &nm);
        for row in &shown.rows {
            line(&mut text, &self.label(&row.path), &row.total, 4);
            for (name, values) in row.components.iter().flat_map(constituents) {
                line(&mut text, &format!("  {}", name.replace('_', " ")), values, 4);
            }
        }
        text.push_str("\nextinction of the total, magnitudes\n");
        heading(&mut text, &nm);
        for row in &shown.rows {
            let magnitudes: Vec<f64> = row.total.iter().map(|t| magnitudes(*t)).collect();
            line(&mut text, &self.label(&row.path), &magnitudes, 3);
        }
        if let (Some(station), true) = (station, rows.iter().any(|row| !row.channels.is_empty())) {
            self.channels_text(&mut text, station, rows);
        }
        let oxygen = if grid.touches(560.0, 640.0) || grid.touches(1040.0, 1090.0) {
            "O2-O2 absorption near 577, 630 and 1064 nm (1064 nm too high by 0.015 at the zenith), "
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "\nnot in the model: {oxygen}scattered light, lines narrower than 20 cm-1.\n`-o FILE` writes the spectra (.ecsv, .csv, .fits, .json) or draws them (.png, .svg)."
        );
        Ok(text)
    }

    fn label(&self, path: &Path) -> String {
        let (angle, kind) = if self.question.apparent {
            (path.apparent_deg, "apparent")
        } else {
            (path.true_deg, "true")
        };
        format!("{}° {kind}", round(angle))
    }

    /// Table and figure, with the summary where `json` asks for it.
    pub fn product(&self, json: bool) -> Product {
        let (rows, grid, title) = (self.rows, &self.question.grid, self.air.describe());
        let mut table = Table::default();
        for (key, value) in [
            ("title", title.as_str()),
            ("zenith_kind", if self.question.apparent { "apparent" } else { "true" }),
            ("value", &grid.kind()),
        ] {
            table.meta.insert(key.into(), json_of(&value));
        }
        table.meta.insert("missing".into(), json_of(&MISSING));
        table.columns.push(Column::f64("wavelength_nm", Some("nm"), grid.nm.clone()));
        for (row, angle) in rows.iter().zip(&self.question.zenith_deg) {
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
        let figure = Some(self.figure());
        Product {
            name: "air".into(),
            table,
            figure,
            json: if json { self.json() } else { Value::Null },
            ..Product::default()
        }
    }

    /// Summary with its documented keys.
    pub fn json(&self) -> Value {
        let Self { air, rows, station, .. } = *self;
        let (grid, title) = (&self.question.grid, air.describe());
        let c = air.columns();
        json_of(&AirJson {
            station: station.map(|s| &s.name),
            title,
            columns: ColumnsJson {
                pressure_hpa: rounded(c.pressure_hpa),
                temperature_k: rounded(c.temperature_k),
                ozone_du: rounded(c.ozone_du),
                water_mm: rounded(c.water_mm),
                co2_ppm: rounded(c.co2_ppm),
                aerosol_optical_depth_550_nm: rounded(c.aerosol_550),
            },
            aerosol: aerosol(air),
            value: grid.kind(),
            missing: MISSING,
            wavelength_nm: &grid.nm,
            zenith: rows.iter().map(|row| self.json_row(air, row)).collect(),
        })
    }

    fn json_row<'a>(&self, air: &Air, row: &'a AirRow) -> ZenithJson<'a> {
        let masses = air.air_masses(&row.path);
        let list = |values: &[f64]| -> Vec<f64> { values.iter().map(|v| rounded(*v)).collect() };
        let channel = |c: &'a ChannelAir| ChannelJson {
            channel: &c.name,
            transmission: rounded(c.transmission),
            extinction_mag: rounded(magnitudes(c.transmission)),
            uncovered_nm: rounded(c.uncovered_nm),
        };
        let parts = row.components.as_ref().map(|components| {
            constituents(components)
                .map(|(name, values)| (name.to_owned(), json_of(&list(values))))
                .collect()
        });
        ZenithJson {
            true_deg: rounded(row.path.true_deg),
            apparent_deg: rounded(row.path.apparent_deg),
            refraction_arcsec: rounded(row.path.refraction_arcsec()),
            airmass: AirmassJson {
                rayleigh: rounded(masses.rayleigh),
                ozone: rounded(masses.ozone),
                water: rounded(masses.water),
            },
            transmission: list(&row.total),
            channels_for_flat_photons: row.channels.iter().map(channel).collect(),
            components: parts,
        }
    }

    fn figure(&self) -> Figure {
        let (rows, grid, title) = (self.rows, &self.question.grid, self.air.describe());
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

    fn channels_text(&self, text: &mut String, station: &Station, rows: &[AirRow]) {
        let names: Vec<String> = station.channels.iter().map(|c| c.name.clone()).collect();
        let _ = writeln!(
            text,
            "\nthrough the channels of {}, for light flat in photons per nm: transmission",
            station.name
        );
        heading(text, &names);
        let values = |row: &AirRow, get: fn(&ChannelAir) -> f64| -> Vec<f64> {
            row.channels.iter().map(get).collect()
        };
        for row in rows {
            line(text, &self.label(&row.path), &values(row, |c| c.transmission), 4);
        }
        text.push_str("and extinction, magnitudes\n");
        heading(text, &names);
        for row in rows {
            line(text, &self.label(&row.path), &values(row, |c| magnitudes(c.transmission)), 3);
        }
        let uncovered = rows.first().into_iter().flat_map(|row| &row.channels);
        for channel in uncovered.filter(|c| c.uncovered_nm > 0.0) {
            let _ = writeln!(
                text,
                "  {}: {:.0} nm of it are outside the tables of the air and count as dark",
                channel.name, channel.uncovered_nm
            );
        }
    }
}

fn heading(text: &mut String, names: &[String]) {
    let _ = write!(text, "  {:<20}", "zenith angle");
    for name in names {
        let _ = write!(text, "{name:>10}");
    }
    text.push('\n');
}

fn line(text: &mut String, label: &str, values: &[f64], digits: usize) {
    let _ = write!(text, "  {label:<20}");
    for value in values {
        let _ = write!(text, "{value:>10.digits$}");
    }
    text.push('\n');
}

#[derive(Serialize)]
struct AerosolJson {
    model: &'static str,
    optical_depth_550_nm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    exponent: Option<f64>,
}

/// The aerosol as summaries hold it.
fn aerosol(air: &Air) -> AerosolJson {
    let depth = rounded(air.columns().aerosol_550);
    match air.options().aerosol {
        Aerosol::Angstrom { exponent, .. } => {
            AerosolJson { model: "angstrom", optical_depth_550_nm: depth, exponent: Some(exponent) }
        }
        Aerosol::Model(model) => {
            AerosolJson { model: model.name(), optical_depth_550_nm: depth, exponent: None }
        }
        _ => AerosolJson { model: "none", optical_depth_550_nm: depth, exponent: None },
    }
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

/// Effects that the model leaves out and a user may miss.
const MISSING: &str = "not in the model: O2-O2 absorption near 577, 630 and 1064 nm (1064 nm too high by 0.015 at the zenith), scattered light, lines narrower than 20 cm-1";

/// An angle as people write it.
fn round(angle: f64) -> f64 {
    (angle * 1e4).round() / 1e4
}
