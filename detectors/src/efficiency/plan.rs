//! PLAN.toml of an efficiency run: what is driven, what is read, what is known about the rig.

use serde::Deserialize;
use serde::de::IgnoredAny;
use std::path::PathBuf;
use sunglint_calibration::efficiency::{EfficiencyRunError, check_run};
use sunglint_formats::text::counted;
use sunglint_formats::toml::{Document, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError};

/// Why a file is no plan of a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Values that no run can have, with line and key.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// Sensor, photodiode or filters that the reduction would not take.
    #[error(
        "{file}: the tables [sensor], [photodiode] and what stands before them, as efficiency.toml would have them"
    )]
    Known {
        /// The plan.
        file: String,
        /// Error of the reduction.
        source: Box<EfficiencyRunError>,
    },
    /// Second-order light without a filter.
    #[error(
        "{file}: at {} from {from_nm} to {to_nm} nm light of half the wavelength comes, too (the shortest is scan.shortest_light_nm = {shortest_nm} nm), and no slot of the wheel blocks it: add a [[wheel.filter]] with blocks_below_nm above half the wavelength, scan less far, or say scan.second_order = \"flag\" to have them marked",
        counted(*count, "wavelength")
    )]
    SecondOrder {
        /// The plan.
        file: String,
        /// Wavelengths.
        count: usize,
        /// First of them, nm.
        from_nm: f64,
        /// Last of them, nm.
        to_nm: f64,
        /// Shortest light of the plan, nm.
        shortest_nm: f64,
    },
}

/// The address of a virtual rig's devices.
const VIRTUAL: &str = "virtual";
/// Wavelengths and readings that a run takes.
const MOST_WAVELENGTHS: usize = 100_000;
const MOST_READINGS: u32 = 10_000;
/// Wavelengths that a monochromator may be sent to, nm.
const REACH_NM: std::ops::RangeInclusive<f64> = 1.0..=100_000.0;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    name: Option<String>,
    #[serde(default, rename = "virtual")]
    virtual_rig: Option<PathBuf>,
    scan: Scan,
    dark: Dark,
    #[serde(default)]
    monochromator: MonochromatorPlan,
    #[serde(default)]
    meter: MeterPlan,
    #[serde(default)]
    counter: CounterPlan,
    #[serde(default)]
    wheel: Option<WheelPlan>,
    /// These are the reduction's own.
    #[allow(dead_code, reason = "they are passed on as they are written")]
    sensor: IgnoredAny,
    #[allow(dead_code, reason = "as above")]
    photodiode: IgnoredAny,
    #[serde(default)]
    #[allow(dead_code, reason = "as above")]
    towards_photodiode: IgnoredAny,
    #[serde(default)]
    #[allow(dead_code, reason = "as above")]
    towards_sensor: IgnoredAny,
    #[serde(default)]
    #[allow(dead_code, reason = "as above")]
    wavelength_sigma_nm: Option<NonNegative>,
}

/// Order of the wavelengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// From short to long.
    #[default]
    Up,
    /// From long to short.
    Down,
    /// Every second one on the way up, the others on the way down: a drift is not a slope.
    ThereAndBack,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SecondOrder {
    #[default]
    Refuse,
    Flag,
}

/// Wavelengths and how they are read.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Scan {
    #[serde(default)]
    from_nm: Option<Positive>,
    #[serde(default)]
    to_nm: Option<Positive>,
    #[serde(default)]
    step_nm: Option<Positive>,
    #[serde(default)]
    wavelengths_nm: Option<Vec<Positive>>,
    #[serde(default)]
    order: Order,
    #[serde(default = "one")]
    passes: u32,
    #[serde(default = "three")]
    repeats: u32,
    exposure_s: Positive,
    #[serde(default)]
    reference_nm: Option<Positive>,
    #[serde(default = "ten")]
    reference_every: u32,
    #[serde(default = "ten")]
    dark_every: u32,
    #[serde(default)]
    shortest_light_nm: Option<Positive>,
    #[serde(default)]
    second_order: SecondOrder,
}

fn one() -> u32 {
    1
}

fn three() -> u32 {
    3
}

fn ten() -> u32 {
    10
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Dark {
    #[serde(default)]
    slot: Option<u32>,
    #[serde(default)]
    wavelength_nm: Option<Positive>,
    #[serde(default)]
    hand: Option<bool>,
}

/// How both detectors are put in the dark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DarkBy {
    /// An opaque slot of the filter wheel.
    Slot(u32),
    /// A wavelength at which no light comes, nm.
    Wavelength(f64),
    /// A person, or whatever else closes the shutter.
    Hand,
}

/// Numbers that are written here are good ones.
fn good<T>(number: Option<T>) -> T {
    match number {
        Some(number) => number,
        None => unreachable!("a default is in its range"),
    }
}

/// The monochromator in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MonochromatorPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// How far from the wavelength that was asked for it may stand, nm.
    pub tolerance_nm: Positive,
    /// On the way down it goes so much too far and comes back up, nm: the play of the gears lies on one side.
    pub approach_nm: NonNegative,
    /// Wait after a move, s.
    pub settle_s: NonNegative,
    /// How long a move may take, s.
    pub timeout_s: Positive,
}

impl Default for MonochromatorPlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            tolerance_nm: good(Positive::new(0.5)),
            approach_nm: good(NonNegative::new(0.0)),
            settle_s: good(NonNegative::new(0.5)),
            timeout_s: good(Positive::new(120.0)),
        }
    }
}

/// Unit of the photodiode's meter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Unit {
    /// The voltage over a load, or behind an amplifier.
    #[default]
    V,
    /// The current itself.
    A,
    /// A power meter, with a calibration of its own.
    W,
}

impl Unit {
    /// Name of the unit.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::V => "V",
            Self::A => "A",
            Self::W => "W",
        }
    }
}

/// The photodiode's meter in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeterPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// Unit of its readings.
    pub unit: Unit,
    /// Readings before, between and after the exposures.
    pub readings: u32,
    /// How long a reading may take, s.
    pub timeout_s: Positive,
}

impl Default for MeterPlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            unit: Unit::V,
            readings: 3,
            timeout_s: good(Positive::new(10.0)),
        }
    }
}

/// The sensor's counter in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CounterPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// Channel of the sensor, from 0.
    pub channel: usize,
    /// How much longer than itself an exposure may take, s.
    pub timeout_s: Positive,
}

impl Default for CounterPlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            channel: 0,
            timeout_s: good(Positive::new(10.0)),
        }
    }
}

/// The filter wheel in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelPlan {
    /// Address of the device in the catalogue of drivers.
    #[serde(default = "virtual_address")]
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// Wait after a turn, s.
    #[serde(default = "settle")]
    pub settle_s: NonNegative,
    /// How long a turn may take, s.
    #[serde(default = "turn")]
    pub timeout_s: Positive,
    /// Filters, the first that fits is taken.
    #[serde(rename = "filter")]
    pub filters: Vec<Filter>,
}

fn virtual_address() -> String {
    VIRTUAL.into()
}

fn settle() -> NonNegative {
    good(NonNegative::new(0.2))
}

fn turn() -> Positive {
    good(Positive::new(30.0))
}

/// A slot of the wheel and the wavelengths for which it is.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Filter {
    /// Slot, from 1.
    pub slot: u32,
    /// First wavelength, nm.
    pub from_nm: Positive,
    /// Last wavelength, nm.
    pub to_nm: Positive,
    /// It blocks all light below this, nm.
    #[serde(default)]
    pub blocks_below_nm: Option<Positive>,
}

/// Measurements of the plan: a run that was begun can only be gone on with if this is the same.
#[derive(Debug, Clone, PartialEq)]
pub struct Measuring {
    /// The monochromator.
    pub monochromator: MonochromatorPlan,
    /// The photodiode's meter.
    pub meter: MeterPlan,
    /// The sensor's counter.
    pub counter: CounterPlan,
    /// The filter wheel.
    pub wheel: Option<WheelPlan>,
    /// How it is made dark.
    pub dark: DarkBy,
    /// Wavelengths in the order in which they are read, nm, with the slot of the wheel, and whether second-order light may be there.
    pub wavelengths: Vec<At>,
    /// The reference wavelength.
    pub reference: Option<At>,
    /// Wavelengths between two readings of the reference.
    pub reference_every: u32,
    /// Wavelengths between two dark readings.
    pub dark_every: u32,
    /// Exposures at a wavelength.
    pub repeats: u32,
    /// Length of an exposure, s.
    pub exposure_s: f64,
}

/// A wavelength with the filter for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct At {
    /// Wavelength, nm.
    pub nm: f64,
    /// Slot of the wheel, where there is one.
    pub slot: Option<u32>,
    /// Whether second-order light may be there.
    pub second_order: bool,
}

/// A run as it is planned.
#[derive(Debug, Clone)]
pub struct RunPlan {
    /// Name of the sensor.
    pub name: String,
    /// Measurements of the plan.
    pub measuring: Measuring,
    /// The run's file for the reduction, its paths as the plan has them; `readings` names the scan's table.
    pub known: toml::Table,
    /// The plan's file.
    pub path: PathBuf,
    /// The file's text.
    pub source: String,
    /// The file of a virtual rig that stands in for the devices.
    pub rig: Option<Document>,
}

impl RunPlan {
    /// A plan from its document; `rig` is the text of the virtual rig where it does not come from the file that is named.
    ///
    /// # Errors
    /// Values that no run can have, with line and key.
    pub fn new(document: &Document, rig: Option<&str>) -> Result<Self, PlanError> {
        let written: Written = document.parse()?;
        let dark = check(document, &written)?;
        let rig = match (&written.virtual_rig, rig) {
            (None, _) => None,
            (Some(path), Some(text)) => Some(Document::new(document.resolve(path), text)?),
            (Some(path), None) => Some(Document::read(document.resolve(path))?),
        };
        let scan = &written.scan;
        let nms = wavelengths(document, scan)?;
        let wheel = written.wheel.as_ref();
        // Oxygen lets nothing pass below.
        let shortest_nm = scan.shortest_light_nm.map_or(190.0, Positive::get);
        let at = |nm: f64| with_filter(document, wheel, nm, shortest_nm);
        let wavelengths = nms.iter().map(|nm| at(*nm)).collect::<Result<Vec<At>, _>>()?;
        let reference = scan.reference_nm.map(|nm| at(nm.get())).transpose()?;
        let second: Vec<f64> = (wavelengths.iter().chain(&reference))
            .filter(|at| at.second_order)
            .map(|at| at.nm)
            .collect();
        if scan.second_order == SecondOrder::Refuse && !second.is_empty() {
            return Err(PlanError::SecondOrder {
                file: document.path().display().to_string(),
                count: second.len(),
                from_nm: second.iter().copied().fold(f64::INFINITY, f64::min),
                to_nm: second.iter().copied().fold(0.0, f64::max),
                shortest_nm,
            });
        }
        let stem = document.path().file_stem().unwrap_or_default().to_string_lossy();
        let name = written.name.unwrap_or_else(|| stem.into_owned());
        let known = known(document, &name, written.meter.unit)?;
        let made = Document::new(document.path().with_file_name(super::RUN), text(&known))?;
        check_run(&made).map_err(|source| PlanError::Known {
            file: document.path().display().to_string(),
            source: Box::new(source),
        })?;
        let wheel = written.wheel;
        Ok(Self {
            name,
            measuring: Measuring {
                monochromator: written.monochromator,
                meter: written.meter,
                counter: written.counter,
                wheel,
                dark,
                wavelengths,
                reference,
                reference_every: scan.reference_every,
                dark_every: scan.dark_every,
                repeats: scan.repeats,
                exposure_s: scan.exposure_s.get(),
            },
            known,
            path: document.path().to_path_buf(),
            source: document.source().to_owned(),
            rig,
        })
    }

    /// The run's file for the reduction as text.
    #[must_use]
    pub fn known_text(&self) -> String {
        text(&self.known)
    }
}

fn text(table: &toml::Table) -> String {
    table.to_string()
}

/// The wavelengths of a plan in the order in which they are read, nm.
fn wavelengths(document: &Document, scan: &Scan) -> Result<Vec<f64>, ParseError> {
    let wrong = |key: &str, expected: &str| Err(document.error_at(key, expected));
    let range = (scan.from_nm, scan.to_nm, scan.step_nm);
    let mut nms: Vec<f64> = match (&scan.wavelengths_nm, range) {
        (Some(list), (None, None, None)) => list.iter().map(|nm| nm.get()).collect(),
        (None, (Some(from), Some(to), Some(step))) => {
            let (from, to, step) = (from.get(), to.get(), step.get());
            if to < from {
                return wrong("scan.to_nm", "a wavelength that is not before from_nm");
            }
            let count = ((to - from) / step + 1e-9).floor();
            if count >= MOST_WAVELENGTHS as f64 {
                return wrong("scan.step_nm", "a step of which at most 100000 lie in the range");
            }
            (0..=count as u64).map(|k| from + step * k as f64).collect()
        }
        _ => return wrong("scan", "either wavelengths_nm, or from_nm, to_nm and step_nm"),
    };
    if nms.is_empty() || nms.iter().any(|nm| !REACH_NM.contains(nm)) {
        return wrong("scan.wavelengths_nm", "wavelengths from 1 to 100000 nm");
    }
    let given = scan.wavelengths_nm.is_some() && scan.order == Order::Up;
    if !given {
        nms.sort_by(f64::total_cmp);
    }
    match scan.order {
        Order::Up => {}
        Order::Down => nms.reverse(),
        Order::ThereAndBack => {
            let up = nms.iter().step_by(2).copied();
            let back = nms.iter().skip(1).step_by(2).rev().copied();
            nms = up.chain(back).collect();
        }
    }
    if nms.len() * scan.passes as usize > MOST_WAVELENGTHS {
        return wrong("scan.passes", "at most 100000 wavelengths in all passes");
    }
    Ok((0..scan.passes).flat_map(|_| nms.iter().copied()).collect())
}

/// A wavelength with the first filter that keeps light of half of it away; if none does, with the first for it.
fn with_filter(
    document: &Document,
    wheel: Option<&WheelPlan>,
    nm: f64,
    shortest_nm: f64,
) -> Result<At, ParseError> {
    let needs = nm >= 2.0 * shortest_nm;
    let Some(wheel) = wheel else {
        return Ok(At { nm, slot: None, second_order: needs });
    };
    let fits = |f: &&Filter| f.from_nm.get() <= nm && nm <= f.to_nm.get();
    let blocks = |f: &&Filter| f.blocks_below_nm.is_some_and(|below| below.get() > 0.5 * nm);
    let found = wheel.filters.iter().filter(fits).find(|f| !needs || blocks(f));
    if let Some(filter) = found {
        return Ok(At { nm, slot: Some(filter.slot), second_order: false });
    }
    match wheel.filters.iter().find(fits) {
        Some(filter) => Ok(At { nm, slot: Some(filter.slot), second_order: true }),
        None => {
            let expected = format!("a filter for {nm} nm (an empty slot counts as one)");
            Err(document.error_at("wheel.filter", expected))
        }
    }
}

fn check(document: &Document, written: &Written) -> Result<DarkBy, ParseError> {
    let wrong = |key: &str, expected: &str| Err(document.error_at(key, expected));
    let scan = &written.scan;
    for (key, value, most) in [
        ("scan.repeats", scan.repeats, MOST_READINGS),
        ("scan.passes", scan.passes, MOST_READINGS),
        ("scan.reference_every", scan.reference_every, u32::MAX),
        ("scan.dark_every", scan.dark_every, u32::MAX),
    ] {
        if !(1..=most).contains(&value) {
            return wrong(key, "a whole number from 1 to 10000");
        }
    }
    if !(2..=MOST_READINGS).contains(&written.meter.readings) {
        return wrong("meter.readings", "2 to 10000: one reading alone tells no scatter");
    }
    if !(1e-5..=3600.0).contains(&scan.exposure_s.get()) {
        return wrong("scan.exposure_s", "a time from 1e-5 to 3600 s");
    }
    let wheel = written.wheel.as_ref();
    for (key, device) in [
        ("monochromator.device", Some(&written.monochromator.device)),
        ("meter.device", Some(&written.meter.device)),
        ("counter.device", Some(&written.counter.device)),
        ("wheel.device", wheel.map(|wheel| &wheel.device)),
    ] {
        let Some(device) = device else { continue };
        if (device == VIRTUAL) != written.virtual_rig.is_some() {
            let expected = match written.virtual_rig {
                Some(_) => "`virtual`, as the file names a virtual rig",
                None => {
                    "an address (sunglint devices list --drivers), or virtual = \"rig.toml\" for the whole rig"
                }
            };
            return wrong(key, expected);
        }
    }
    if let Some(wheel) = wheel {
        let bad = |f: &Filter| f.slot == 0 || f.to_nm.get() < f.from_nm.get();
        if wheel.filters.iter().any(bad) {
            return wrong("wheel.filter", "slots from 1, and to_nm not before from_nm");
        }
    }
    let dark = &written.dark;
    match (dark.slot, dark.wavelength_nm, dark.hand) {
        (Some(slot), None, None) if slot > 0 && wheel.is_some() => Ok(DarkBy::Slot(slot)),
        (Some(_), None, None) => wrong("dark.slot", "a slot from 1 of the [wheel]"),
        (None, Some(nm), None) => Ok(DarkBy::Wavelength(nm.get())),
        (None, None, Some(true)) => Ok(DarkBy::Hand),
        _ => wrong(
            "dark",
            "one of slot (opaque, of the wheel), wavelength_nm (without light) and hand = true",
        ),
    }
}

/// The run's file for the reduction: what the plan knows, in the reduction's own grammar.
fn known(document: &Document, name: &str, unit: Unit) -> Result<toml::Table, ParseError> {
    // It has been parsed before.
    let mut written: toml::Table = toml::from_str(document.source())
        .map_err(|e| ParseError::new(document.path(), e.message(), "TOML"))?;
    let mut take = |key: &str| written.remove(key);
    let mut photodiode = match take("photodiode") {
        Some(toml::Value::Table(photodiode)) => photodiode,
        _ => return Err(document.error_at("photodiode", "a table")),
    };
    let refused =
        |key: &str, expected: &str| Err(document.error_at(&format!("photodiode.{key}"), expected));
    match unit {
        Unit::V => {}
        Unit::A if photodiode.contains_key("load_ohm") => {
            return refused("load_ohm", "no such key: the meter reads the current (meter.unit)");
        }
        // A current through 1 Ω.
        Unit::A => {
            photodiode.insert("load_ohm".into(), toml::Value::Float(1.0));
        }
        Unit::W => {
            photodiode.insert("power_meter".into(), toml::Value::Boolean(true));
        }
    }
    let mut set = toml::Table::new();
    set.insert("readings".into(), super::tables::STEPS.into());
    for key in ["wavelength_sigma_nm", "towards_photodiode", "towards_sensor"] {
        if let Some(value) = take(key) {
            set.insert(key.into(), value);
        }
    }
    set.insert("photodiode".into(), toml::Value::Table(photodiode));
    let mut run = toml::Table::new();
    run.insert("name".into(), name.into());
    if let Some(sensor) = take("sensor") {
        run.insert("sensor".into(), sensor);
    }
    run.insert("set".into(), toml::Value::Array(vec![toml::Value::Table(set)]));
    Ok(run)
}
