//! A detector's efficiency by a run's file: the sensor, the photodiodes, splitter and filters, and the tables of readings.

use super::{
    Aperture, Counting, Efficiency, EfficiencyError, Extrapolation, ExtrapolationLaw, Factor,
    Lookup, Photodiode, Reading, Sensor, Set, reduce, to_curve,
};
use crate::detector::{DetectorError, Linearity};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use sunglint_formats::toml::{Document, Finite, Fraction, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError, Table, TableError, curve, text_table};
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::station::{Counter, CounterQuantity, DeadTime};

/// Why a run gives no efficiency.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EfficiencyRunError {
    /// A file that cannot be read, or says what cannot be.
    #[error(transparent)]
    File(#[from] FileError),
    /// A law that no detector can have.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// A number that cannot be.
    #[error(transparent)]
    Number(#[from] EfficiencyError),
    /// Readings that give no efficiency.
    #[error("{}", path.display())]
    Readings {
        /// The run's file.
        path: PathBuf,
        /// Error in the readings.
        #[source]
        source: EfficiencyError,
    },
}

impl From<ParseError> for EfficiencyRunError {
    fn from(error: ParseError) -> Self {
        Self::File(error.into())
    }
}

/// A detector's efficiency, with what it was made of.
#[derive(Debug, Clone)]
pub struct EfficiencyRun {
    /// The sensor's name: the file's, else that of the file.
    pub name: String,
    /// The efficiency.
    pub efficiency: Efficiency,
    /// Efficiency curve in the form of a station's file.
    pub curve: String,
    /// Wavelengths that are not in that curve, nm.
    pub left_out_nm: Vec<f64>,
    /// The run's file as it was written.
    pub plan: String,
    /// The files that it names.
    pub inputs: Vec<Input>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Reads a run's file and what it names, and finds the efficiency.
///
/// # Errors
/// A file that cannot be read or says what cannot be, with line and key; readings that cannot be, with their numbers.
pub fn reduce_run(plan: &Path) -> Result<EfficiencyRun, EfficiencyRunError> {
    let document = Document::read(plan)?;
    let Parts { name, sensor, sets, inputs } = parts(&document, true)?;
    let efficiency = reduce(&sets, &sensor)
        .map_err(|source| EfficiencyRunError::Readings { path: plan.to_path_buf(), source })?;
    let (curve, left_out_nm) = to_curve(&efficiency, &name);
    let warnings = efficiency.notes.iter().map(ToString::to_string).collect();
    let plan = document.source().to_owned();
    Ok(EfficiencyRun { name, efficiency, curve, left_out_nm, plan, inputs, warnings })
}

/// Contents of a run's file and of the files that it names.
#[derive(Debug, Clone)]
pub struct Parts {
    /// The sensor's name: the file's, else that of the file.
    pub name: String,
    /// The sensor.
    pub sensor: Sensor,
    /// Photodiodes with their readings.
    pub sets: Vec<Set>,
    /// The files that it names.
    pub inputs: Vec<Input>,
}

/// Reads what a run's file says and names.
///
/// # Errors
/// A file that cannot be read or says what cannot be, with line and key.
pub fn read_run(document: &Document) -> Result<Parts, EfficiencyRunError> {
    parts(document, true)
}

/// Looks whether a run's file could be reduced once its readings are there.
///
/// # Errors
/// The errors of [`read_run`], but for the readings.
pub fn check_run(document: &Document) -> Result<(), EfficiencyRunError> {
    parts(document, false).map(|_| ())
}

fn parts(document: &Document, with_readings: bool) -> Result<Parts, EfficiencyRunError> {
    let written: Written = document.parse()?;
    let mut inputs = vec![];
    let sensor = sensor(document, &written.sensor, &mut inputs)?;
    let mut sets = Vec::with_capacity(written.sets.len());
    for (number, file) in written.sets.iter().enumerate() {
        let readings = if with_readings {
            let path = document.resolve(&file.readings);
            let table = text_table::read_str(&path, &input(&path, &mut inputs)?)?;
            let dark_v = file.photodiode.dark_v.map(Finite::get);
            readings(&table, dark_v).map_err(|e| e.in_file(&path))?
        } else {
            vec![]
        };
        sets.push(set(document, number, file, readings, &mut inputs)?);
    }
    let stem = document.path().file_stem().unwrap_or_default().to_string_lossy();
    let name = written.name.unwrap_or_else(|| stem.into_owned());
    Ok(Parts { name, sensor, sets, inputs })
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
    pixels: Option<u32>,
    #[serde(default)]
    recovery_ns: Option<Positive>,
    #[serde(default)]
    pulse_ns: Option<NonNegative>,
    #[serde(default)]
    linearity: Option<PathBuf>,
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
    ExponentialRecovery,
    MultiPixel,
    Table,
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
    #[serde(default)]
    power_meter: bool,
    #[serde(default)]
    responsivity: Option<PathBuf>,
    #[serde(default)]
    responsivity_relative_sigma: Option<NonNegative>,
    #[serde(default)]
    extrapolate: Option<ExtrapolateFile>,
    #[serde(default)]
    load_ohm: Option<Positive>,
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
struct ExtrapolateFile {
    law: ExtrapolationLaw,
    from_nm: Positive,
    to_nm: Positive,
    relative_sigma: NonNegative,
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

fn sensor(
    document: &Document,
    file: &SensorFile,
    inputs: &mut Vec<Input>,
) -> Result<Sensor, EfficiencyRunError> {
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
            let dead_time = dead_time(document, file, inputs)?;
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

/// The law of a counter's dead time.
fn dead_time(
    document: &Document,
    file: &SensorFile,
    inputs: &mut Vec<Input>,
) -> Result<DeadTime, EfficiencyRunError> {
    let need = |key: &str, expected: &str| -> EfficiencyRunError {
        document.error_at(&format!("sensor.{key}"), expected).into()
    };
    let Some(model) = file.dead_time_model else {
        let expected =
            "none, non_paralysable, paralysable, exponential_recovery, multi_pixel or table";
        return Err(need("dead_time_model", expected));
    };
    let wanted: &[&str] = match model {
        DeadTimeModel::None => &[],
        DeadTimeModel::NonParalysable | DeadTimeModel::Paralysable => &["dead_time_ns"],
        DeadTimeModel::ExponentialRecovery => &["dead_time_ns", "recovery_ns"],
        DeadTimeModel::MultiPixel => &["pixels", "recovery_ns", "pulse_ns"],
        DeadTimeModel::Table => &["linearity"],
    };
    let given = [
        ("dead_time_ns", file.dead_time_ns.is_some()),
        ("pixels", file.pixels.is_some()),
        ("recovery_ns", file.recovery_ns.is_some()),
        ("pulse_ns", file.pulse_ns.is_some()),
        ("linearity", file.linearity.is_some()),
    ];
    for (key, is_given) in given {
        match (wanted.contains(&key), is_given) {
            (true, false) => return Err(need(key, "it, for this model")),
            (false, true) => return Err(need(key, "no such key beside this dead_time_model")),
            _ => {}
        }
    }
    let dead_time_s = 1e-9 * file.dead_time_ns.map_or(0.0, Positive::get);
    let recovery_s = 1e-9 * file.recovery_ns.map_or(0.0, Positive::get);
    Ok(match model {
        DeadTimeModel::None => DeadTime::None,
        DeadTimeModel::NonParalysable => DeadTime::NonParalysable { dead_time_s },
        DeadTimeModel::Paralysable => DeadTime::Paralysable { dead_time_s },
        DeadTimeModel::ExponentialRecovery => {
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s }
        }
        DeadTimeModel::MultiPixel => DeadTime::MultiPixel {
            pixels: file.pixels.unwrap_or_default(),
            recovery_s,
            pulse_s: 1e-9 * file.pulse_ns.map_or(0.0, NonNegative::get),
        },
        DeadTimeModel::Table => {
            let path = document.resolve(file.linearity.as_deref().unwrap_or(Path::new("")));
            let table = curve::read_str(&path, &input(&path, inputs)?, None)?;
            if (table.x_name.as_str(), table.y_name.as_str()) != ("measured_hz", "true_hz") {
                return Err(need("linearity", "a curve with the columns measured_hz, true_hz"));
            }
            DeadTime::Table { measured_hz: table.x, true_hz: table.y }
        }
    })
}

/// A file's bytes as text, remembered with its sum.
fn input(path: &Path, inputs: &mut Vec<Input>) -> Result<String, FileError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    inputs.push(Input { file: path.display().to_string(), sha256 });
    Ok(sunglint_formats::read::decode(path, bytes)?)
}

/// Responsivity and load of a photodiode; of a power meter, whose readings are W, both are 1.
fn responsivity(
    document: &Document,
    number: usize,
    diode: &PhotodiodeFile,
    inputs: &mut Vec<Input>,
) -> Result<(Factor, f64), EfficiencyRunError> {
    let need = |key: &str, expected: &str| -> EfficiencyRunError {
        document.error_at(&format!("set[{number}].photodiode.{key}"), expected).into()
    };
    let relative_sigma = or_zero(diode.responsivity_relative_sigma);
    if diode.power_meter {
        for (key, is_given) in [
            ("responsivity", diode.responsivity.is_some()),
            ("load_ohm", diode.load_ohm.is_some()),
            ("extrapolate", diode.extrapolate.is_some()),
        ] {
            if is_given {
                return Err(need(key, "no such key beside power_meter = true: its readings are W"));
            }
        }
        return Ok((Factor::constant("power meter", 1.0, relative_sigma)?, 1.0));
    }
    let Some(file) = &diode.responsivity else {
        return Err(need("responsivity", "it, a curve of wavelength_nm, responsivity_a_per_w"));
    };
    let Some(load_ohm) = diode.load_ohm else {
        return Err(need("load_ohm", "it: the load or the amplifier's gain, V per A"));
    };
    let path = document.resolve(file);
    let text = input(&path, inputs)?;
    let curve = curve::read_str(&path, &text, None)?;
    if (curve.x_name.as_str(), curve.y_name.as_str()) != ("wavelength_nm", "responsivity_a_per_w") {
        let expected = "a curve with the columns wavelength_nm, responsivity_a_per_w";
        return Err(need("responsivity", expected));
    }
    let value = Lookup::new("responsivity, A/W", curve.x, curve.y)?;
    Ok((Factor { name: "responsivity".into(), value, relative_sigma }, load_ohm.get()))
}

fn set(
    document: &Document,
    number: usize,
    file: &SetFile,
    readings: Vec<Reading>,
    inputs: &mut Vec<Input>,
) -> Result<Set, EfficiencyRunError> {
    let diode = &file.photodiode;
    let (responsivity, load_ohm) = responsivity(document, number, diode, inputs)?;
    let factors = |side: &str, files: &[FactorFile], inputs: &mut Vec<Input>| {
        let one = |(k, file): (usize, &FactorFile)| {
            factor(document, &format!("set[{number}].{side}[{k}]"), file, inputs)
        };
        files.iter().enumerate().map(one).collect::<Result<Vec<Factor>, EfficiencyRunError>>()
    };
    let towards_photodiode = factors("towards_photodiode", &file.towards_photodiode, inputs)?;
    let towards_sensor = factors("towards_sensor", &file.towards_sensor, inputs)?;
    Ok(Set {
        readings,
        photodiode: Photodiode {
            responsivity,
            extrapolation: diode.extrapolate.as_ref().map(|beyond| Extrapolation {
                law: beyond.law,
                within_nm: (beyond.from_nm.get(), beyond.to_nm.get()),
                relative_sigma: beyond.relative_sigma.get(),
            }),
            load_ohm,
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
    inputs: &mut Vec<Input>,
) -> Result<Factor, EfficiencyRunError> {
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
/// `dark_exposure_s`, `drift_relative`, `sigma_drift_relative`, `drift_step`, `second_order`.
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
    let number = |name: &'static str| has(name).then(|| table.f64(name)).transpose();
    let drift = number("drift_relative")?;
    let sigma_drift = number("sigma_drift_relative")?;
    let drift_step = number("drift_step")?;
    let second_order = number("second_order")?;
    let one = |row: usize| Reading {
        wavelength_nm: wavelength[row],
        photodiode_v: photodiode[row],
        photodiode_dark_v: photodiode_dark.as_ref().map_or(dark_v.unwrap_or(0.0), |v| v[row]),
        sigma_v: sigma.as_ref().map_or(0.0, |v| v[row]),
        counts: counts[row],
        exposure_s: exposure[row],
        dark_counts: dark_counts.as_ref().map_or(0.0, |v| v[row]),
        dark_exposure_s: dark_exposure.as_ref().map_or(exposure[row], |v| v[row]),
        drift_relative: drift.as_ref().map_or(0.0, |v| v[row]),
        sigma_drift_relative: sigma_drift.as_ref().map_or(0.0, |v| v[row]),
        drift_step: drift_step.as_ref().is_some_and(|v| v[row] != 0.0),
        second_order: second_order.as_ref().is_some_and(|v| v[row] != 0.0),
    };
    Ok((0..table.rows()).map(one).collect())
}
