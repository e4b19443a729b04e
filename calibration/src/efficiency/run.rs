//! `sunglint efficiency`: a detector's efficiency from a monochromator's light on a photodiode and on the detector.

use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::Args;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use sunglint_calibration::detector::Linearity;
use sunglint_calibration::efficiency::{
    Aperture, Counting, Efficiency, EfficiencyFlags, Factor, Lookup, Photodiode, Reading, Row,
    Sensor, Set, reduce, to_curve, to_table,
};
use sunglint_formats::text_table::read_str as any;
use sunglint_formats::toml::{Document, Finite, Fraction, NonNegative, Positive};
use sunglint_formats::{Table, TableError, curve};
use sunglint_radiometry::station::{Counter, CounterQuantity, DeadTime};
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};

/// Arguments of `sunglint efficiency`.
#[derive(Debug, Args)]
pub struct EfficiencyArgs {
    /// The sensor, the photodiodes, splitter and filters, and the tables of readings (docs/lab.md)
    #[arg(value_name = "RUN.toml")]
    pub plan: PathBuf,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    name: Option<String>,
    sensor: SensorFile,
    #[serde(rename = "set")]
    sets: Vec<SetFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorFile {
    kind: Kind,
    #[serde(default)]
    dead_time_model: Option<DeadTimeModel>,
    #[serde(default)]
    dead_time_ns: Option<Positive>,
    #[serde(default)]
    dead_time_relative_sigma: Option<NonNegative>,
    #[serde(default)]
    saturation_hz: Option<Positive>,
    #[serde(default)]
    gain_e_per_adu: Option<Positive>,
    #[serde(default)]
    gain_relative_sigma: Option<NonNegative>,
    #[serde(default)]
    saturation_adu: Option<Positive>,
    area_mm2: Positive,
    #[serde(default)]
    area_relative_sigma: Option<NonNegative>,
    distance_mm: Positive,
    #[serde(default)]
    distance_sigma_mm: Option<NonNegative>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Counter,
    Camera,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum DeadTimeModel {
    None,
    NonParalysable,
    Paralysable,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SetFile {
    readings: PathBuf,
    #[serde(default)]
    wavelength_sigma_nm: Option<NonNegative>,
    photodiode: PhotodiodeFile,
    #[serde(default)]
    towards_photodiode: Vec<FactorFile>,
    #[serde(default)]
    towards_sensor: Vec<FactorFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PhotodiodeFile {
    responsivity: PathBuf,
    #[serde(default)]
    responsivity_relative_sigma: Option<NonNegative>,
    load_ohm: Positive,
    #[serde(default)]
    load_relative_sigma: Option<NonNegative>,
    #[serde(default)]
    dark_v: Option<Finite>,
    area_mm2: Positive,
    #[serde(default)]
    area_relative_sigma: Option<NonNegative>,
    distance_mm: Positive,
    #[serde(default)]
    distance_sigma_mm: Option<NonNegative>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FactorFile {
    name: String,
    #[serde(default)]
    curve: Option<PathBuf>,
    #[serde(default)]
    value: Option<Fraction>,
    #[serde(default)]
    optical_density: Option<NonNegative>,
    #[serde(default)]
    relative_sigma: Option<NonNegative>,
}

fn or_zero(number: Option<NonNegative>) -> f64 {
    number.map_or(0.0, NonNegative::get)
}

/// Does what is asked.
///
/// # Errors
/// A file that cannot be read or says what cannot be, with line and key; readings that cannot be, with their numbers.
pub fn run(args: &EfficiencyArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let document = Document::read(&args.plan)?;
    let written: Written = document.parse()?;
    let sensor = sensor(&document, &written.sensor)?;
    let mut inputs = vec![];
    let mut sets = Vec::with_capacity(written.sets.len());
    for (number, file) in written.sets.iter().enumerate() {
        sets.push(set(&document, number, file, &mut inputs)?);
    }
    let found = reduce(&sets, &sensor).with_context(|| args.plan.display().to_string())?;
    let stem = args.plan.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = written.name.clone().unwrap_or(stem);
    let warnings: Vec<String> = found.notes.iter().map(ToString::to_string).collect();
    for warning in &warnings {
        console.warn(warning);
    }
    let (text_of_curve, left_out) = to_curve(&found, &name);
    if !left_out.is_empty() {
        console.warn(&format!(
            "{} of {} wavelengths are not in the curve for a station (no efficiency from 0 to 1)",
            left_out.len(),
            found.rows.len()
        ));
    }
    let curves: Vec<(PathBuf, Vec<u8>)> = (args.out.folders().output.iter())
        .map(|folder| (folder.join("efficiency.csv"), text_of_curve.clone().into_bytes()))
        .collect();
    let mut table = to_table(&found);
    table.meta.insert("sensor".into(), json!(name));
    table.meta.insert("plan".into(), json!(document.source()));
    table.meta.insert("inputs".into(), json!(inputs));
    let product = Product {
        name: "efficiency".into(),
        figure: figure(&found, &name),
        json: summary(&found, &name, &left_out, &warnings, &inputs),
        table,
        ..Product::default()
    };
    args.out.finish_with(&product, curves, &text(&found), console)
}

fn sensor(document: &Document, file: &SensorFile) -> anyhow::Result<Sensor> {
    let need = |key: &str, expected: &str| document.error_at(&format!("sensor.{key}"), expected);
    let counting = match file.kind {
        Kind::Camera => {
            let Some(gain) = file.gain_e_per_adu else {
                return Err(need("gain_e_per_adu", "it, for a camera's ADU").into());
            };
            let Some(saturation) = file.saturation_adu else {
                return Err(need("saturation_adu", "it, for a camera").into());
            };
            if file.dead_time_model.is_some() || file.dead_time_ns.is_some() {
                return Err(need("dead_time_model", "none: a camera has no dead time").into());
            }
            Counting::Camera {
                gain_e_per_adu: gain.get(),
                gain_relative_sigma: or_zero(file.gain_relative_sigma),
                saturation_adu: saturation.get(),
            }
        }
        Kind::Counter => {
            if file.gain_e_per_adu.is_some() || file.saturation_adu.is_some() {
                return Err(need("gain_e_per_adu", "none: a counter has no ADU").into());
            }
            let Some(model) = file.dead_time_model else {
                let expected = "none, non_paralysable or paralysable";
                return Err(need("dead_time_model", expected).into());
            };
            let dead_time_s = file.dead_time_ns.map(|ns| 1e-9 * ns.get());
            let dead_time = match (model, dead_time_s) {
                (DeadTimeModel::None, None) => DeadTime::None,
                (DeadTimeModel::NonParalysable, Some(dead_time_s)) => {
                    DeadTime::NonParalysable { dead_time_s }
                }
                (DeadTimeModel::Paralysable, Some(dead_time_s)) => {
                    DeadTime::Paralysable { dead_time_s }
                }
                (DeadTimeModel::None, Some(_)) => {
                    return Err(need("dead_time_ns", "no such key beside the model `none`").into());
                }
                (_, None) => return Err(need("dead_time_ns", "it, for this model").into()),
            };
            let counter = Counter {
                quantity: CounterQuantity::Counts,
                dead_time,
                saturation_hz: file.saturation_hz.map_or(f64::INFINITY, Positive::get),
                dark_rate_hz: 0.0,
                area_mm2: None,
                fibre: None,
            };
            Counting::Counter {
                linearity: Linearity::of(&counter)?,
                dead_time_relative_sigma: or_zero(file.dead_time_relative_sigma),
            }
        }
    };
    let aperture = Aperture {
        area_mm2: file.area_mm2.get(),
        area_relative_sigma: or_zero(file.area_relative_sigma),
        distance_mm: file.distance_mm.get(),
        distance_sigma_mm: or_zero(file.distance_sigma_mm),
    };
    Ok(Sensor { counting, aperture })
}

/// A file's bytes as text, remembered with its sum.
fn input(path: &Path, inputs: &mut Vec<Value>) -> anyhow::Result<String> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    inputs.push(json!({ "file": path.display().to_string(), "sha256": sha256 }));
    Ok(sunglint_formats::read::decode(path, bytes)?)
}

fn set(
    document: &Document,
    number: usize,
    file: &SetFile,
    inputs: &mut Vec<Value>,
) -> anyhow::Result<Set> {
    let diode = &file.photodiode;
    let path = document.resolve(&diode.responsivity);
    let text = input(&path, inputs)?;
    let responsivity = curve::read_str(&path, &text, None)?;
    if (responsivity.x_name.as_str(), responsivity.y_name.as_str())
        != ("wavelength_nm", "responsivity_a_per_w")
    {
        let key = format!("set[{number}].photodiode.responsivity");
        let expected = "a curve with the columns wavelength_nm, responsivity_a_per_w";
        return Err(document.error_at(&key, expected).into());
    }
    let responsivity = Factor {
        name: "responsivity".into(),
        value: Lookup::new("responsivity, A/W", responsivity.x, responsivity.y)?,
        relative_sigma: or_zero(diode.responsivity_relative_sigma),
    };
    let factors = |side: &str, files: &[FactorFile], inputs: &mut Vec<Value>| {
        let one = |(k, file): (usize, &FactorFile)| {
            factor(document, &format!("set[{number}].{side}[{k}]"), file, inputs)
        };
        files.iter().enumerate().map(one).collect::<anyhow::Result<Vec<Factor>>>()
    };
    let towards_photodiode = factors("towards_photodiode", &file.towards_photodiode, inputs)?;
    let towards_sensor = factors("towards_sensor", &file.towards_sensor, inputs)?;
    let path = document.resolve(&file.readings);
    let table = any(&path, &input(&path, inputs)?)?;
    let dark_v = diode.dark_v.map(Finite::get);
    Ok(Set {
        readings: readings(&table, dark_v).map_err(|e| e.in_file(&path))?,
        photodiode: Photodiode {
            responsivity,
            load_ohm: diode.load_ohm.get(),
            load_relative_sigma: or_zero(diode.load_relative_sigma),
            aperture: Aperture {
                area_mm2: diode.area_mm2.get(),
                area_relative_sigma: or_zero(diode.area_relative_sigma),
                distance_mm: diode.distance_mm.get(),
                distance_sigma_mm: or_zero(diode.distance_sigma_mm),
            },
        },
        towards_photodiode,
        towards_sensor,
        wavelength_sigma_nm: or_zero(file.wavelength_sigma_nm),
    })
}

fn factor(
    document: &Document,
    key: &str,
    file: &FactorFile,
    inputs: &mut Vec<Value>,
) -> anyhow::Result<Factor> {
    let relative_sigma = or_zero(file.relative_sigma);
    match (&file.curve, file.value, file.optical_density) {
        (Some(path), None, None) => {
            let path = document.resolve(path);
            let curve = curve::read_str(&path, &input(&path, inputs)?, None)?;
            let known = ["transmission", "reflectance", "throughput"];
            if curve.x_name != "wavelength_nm" || !known.contains(&curve.y_name.as_str()) {
                let expected = "a curve with the columns wavelength_nm and transmission, reflectance or throughput";
                return Err(document.error_at(&format!("{key}.curve"), expected).into());
            }
            let value = Lookup::new(&file.name, curve.x, curve.y)?;
            Ok(Factor { name: file.name.clone(), value, relative_sigma })
        }
        (None, Some(value), None) => Ok(Factor::constant(&file.name, value.get(), relative_sigma)?),
        (None, None, Some(density)) => {
            Ok(Factor::constant(&file.name, 10_f64.powf(-density.get()), relative_sigma)?)
        }
        _ => {
            let expected = "one of curve, value, optical_density";
            Err(document.error_at(key, expected).into())
        }
    }
}

/// The readings of a table: `wavelength_nm`, `photodiode_v`, `counts`, `exposure_s`, and where they are there `photodiode_dark_v`, `sigma_photodiode_v`, `dark_counts`,
/// `dark_exposure_s`.
fn readings(table: &Table, dark_v: Option<f64>) -> Result<Vec<Reading>, TableError> {
    let has = |name: &str| table.columns.iter().any(|column| column.name == name);
    let optional =
        |name: &'static str, unit: &str| has(name).then(|| table.quantity(name, unit)).transpose();
    let wavelength = table.quantity("wavelength_nm", "nm")?;
    let photodiode = table.quantity("photodiode_v", "V")?;
    let counts = table.f64("counts")?;
    let exposure = table.quantity("exposure_s", "s")?;
    let photodiode_dark = optional("photodiode_dark_v", "V")?;
    let sigma = optional("sigma_photodiode_v", "V")?;
    let dark_counts = if has("dark_counts") { Some(table.f64("dark_counts")?) } else { None };
    let dark_exposure = optional("dark_exposure_s", "s")?;
    let one = |row: usize| Reading {
        wavelength_nm: wavelength[row],
        photodiode_v: photodiode[row],
        photodiode_dark_v: photodiode_dark.as_ref().map_or(dark_v.unwrap_or(0.0), |v| v[row]),
        sigma_v: sigma.as_ref().map_or(0.0, |v| v[row]),
        counts: counts[row],
        exposure_s: exposure[row],
        dark_counts: dark_counts.as_ref().map_or(0.0, |v| v[row]),
        dark_exposure_s: dark_exposure.as_ref().map_or(exposure[row], |v| v[row]),
    };
    Ok((0..table.rows()).map(one).collect())
}

fn peak(found: &Efficiency) -> Option<&Row> {
    let finite = found.rows.iter().filter(|row| row.efficiency.is_finite());
    finite.max_by(|a, b| a.efficiency.total_cmp(&b.efficiency))
}

fn text(found: &Efficiency) -> String {
    let mut text = String::new();
    let finite = found.rows.iter().filter(|row| row.efficiency.is_finite()).count();
    let _ = writeln!(text, "{finite} of {} wavelengths have an efficiency", found.rows.len());
    if let Some(row) = peak(found) {
        let _ = writeln!(
            text,
            "largest   {:.5} ± {:.5} at {} nm",
            row.efficiency,
            row.components.total(),
            row.wavelength_nm
        );
        let c = &row.components;
        let _ = writeln!(
            text,
            "of that   counts {:.5}, photodiode {:.5}, wavelength {:.5}, linearity {:.5}, responsivity {:.5}, load {:.5}, geometry {:.5}, transmissions {:.5}",
            c.counts,
            c.photodiode,
            c.wavelength,
            c.linearity,
            c.responsivity,
            c.load,
            c.geometry,
            c.transmissions
        );
    }
    text
}

fn summary(
    found: &Efficiency,
    name: &str,
    left_out: &[f64],
    warnings: &[String],
    inputs: &[Value],
) -> Value {
    let mut flagged: BTreeMap<String, usize> = BTreeMap::new();
    for row in &found.rows {
        for (name, _) in row.flags.iter_names() {
            *flagged.entry(name.to_lowercase()).or_default() += 1;
        }
    }
    let largest = peak(found).map(|row| {
        json!({
            "wavelength_nm": rounded(row.wavelength_nm),
            "efficiency": rounded(row.efficiency),
            "sigma_efficiency": rounded(row.components.total()),
            "sigma_by": row.components,
        })
    });
    json!({
        "sensor": name,
        "wavelengths": found.rows.len(),
        "with_efficiency": found.rows.iter().filter(|row| row.efficiency.is_finite()).count(),
        "largest": largest,
        "left_out_nm": left_out,
        "flagged": flagged,
        "warnings": warnings,
        "inputs": inputs,
    })
}

fn figure(found: &Efficiency, name: &str) -> Option<Figure> {
    let along = |value: &dyn Fn(&Row) -> f64| -> Vec<(f64, f64)> {
        found.rows.iter().map(|row| (row.wavelength_nm, value(row))).collect()
    };
    let at = |k: f64| along(&|row| row.efficiency + k * row.components.total());
    let serious = |row: &Row| !(row.flags - EfficiencyFlags::BELOW_DETECTION).is_empty();
    let mut curves = vec![
        Series::line("η", 0, along(&|row| row.efficiency)),
        Series::line("η plus its σ", 5, at(1.0)),
        Series::line("η minus its σ", 5, at(-1.0)),
    ];
    if found.rows.iter().any(|row| serious(row) && row.efficiency.is_finite()) {
        let flagged = along(&|row| if serious(row) { row.efficiency } else { f64::NAN });
        curves.push(Series::dots("flagged", 1, flagged));
    }
    let part = |value: fn(&Row) -> f64| along(&|row| value(row) / row.efficiency.abs());
    let parts = vec![
        Series::line("counts", 0, part(|r| r.components.counts)),
        Series::line("photodiode", 1, part(|r| r.components.photodiode)),
        Series::line("wavelength", 2, part(|r| r.components.wavelength)),
        Series::line("linearity", 3, part(|r| r.components.linearity)),
        Series::line("responsivity", 4, part(|r| r.components.responsivity)),
        Series::line("load", 5, part(|r| r.components.load)),
        Series::line("geometry", 6, part(|r| r.components.geometry)),
        Series::line("transmissions", 7, part(|r| r.components.transmissions)),
    ];
    let nm = || Axis::linear("vacuum wavelength (nm)");
    let drawn = |series: &[Series], least: f64| {
        series.iter().any(|s| s.points.iter().any(|p| p.1.is_finite() && p.1 > least))
    };
    // Nothing to draw where no wavelength has an efficiency.
    let mut panels = vec![];
    if drawn(&curves, f64::NEG_INFINITY) {
        panels.push(Panel::new(nm(), Axis::linear("efficiency η"), curves));
    }
    if drawn(&parts, 0.0) {
        panels.push(Panel::new(nm(), Axis::log("relative uncertainty"), parts));
    }
    let title = format!("{name}: counts per photon");
    (!panels.is_empty()).then_some(Figure { title, panels })
}
