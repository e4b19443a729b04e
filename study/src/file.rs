//! `STUDY.toml`: a base scene, parameters, objects, and what is kept.
//!
//! ```toml
//! [study]
//! scene = "pass.toml"
//! design = "sobol"               # grid (default), list, latin, sobol; or table = "points.csv"
//! points = 256
//! keep = ["summary", "samples"]  # default: the summary alone
//!
//! [[parameter]]
//! key = "target.sphere.radius_m"
//! from = 0.1
//! to = 2.0
//! scale = "log"
//!
//! [passes]                       # left out: the orbit and the times of the scene
//! elements = ["catalogue.tle"]
//! from = 2026-03-01T17:00:00Z
//! to = 2026-03-02T05:00:00Z
//! step_s = 1.0
//! ```

use crate::design::{
    self, MOST_POINTS, MOST_SOBOL_PARAMETERS, MOST_SOBOL_POINTS, Range, Scale, Value,
};
use crate::table::Kind;
use crate::{PROGRAM, StudyError, scene};
use hifitime::Epoch;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::tle::{self, Tle};
use sunglint_ephemeris::orbit::{TleOrbit, elements, seconds_between};
use sunglint_ephemeris::passes::Conditions;
use sunglint_formats::sha256;
use sunglint_formats::time::Utc;
use sunglint_formats::toml::{Document, Finite, Positive};
use sunglint_formats::{ParseError, Table, text_table};
use sunglint_radiometry::station::Station;
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::pass::{Overrides, Pass, PassFile};

/// Shards that a study is cut into, unless its file says how many tasks one holds.
const SHARDS: usize = 200;
/// Tasks of a shard at most, unless the file says otherwise: their samples are in memory together.
const MOST_TASKS_A_SHARD: usize = 500;
/// Tasks of a study at most: more are a slip of a number.
pub const MOST_TASKS: usize = 100_000_000;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    study: StudyKeys,
    #[serde(default)]
    parameter: Vec<ParameterKeys>,
    passes: Option<PassesKeys>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StudyKeys {
    name: Option<String>,
    scene: String,
    design: Option<Design>,
    points: Option<u32>,
    seed: Option<u64>,
    table: Option<String>,
    #[serde(default)]
    keep: Vec<Kept>,
    tasks_a_shard: Option<u32>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Design {
    Grid,
    List,
    Latin,
    Sobol,
}

/// Table that a study keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kept {
    /// A row for each pass, or for each task.
    Summary,
    /// A row for each sample.
    Samples,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterKeys {
    key: String,
    values: Option<Vec<Value>>,
    from: Option<Finite>,
    to: Option<Finite>,
    steps: Option<u32>,
    #[serde(default)]
    scale: Scale,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PassesKeys {
    elements: Vec<String>,
    #[serde(default)]
    norad_id: Vec<u32>,
    from: Utc,
    to: Utc,
    step_s: Positive,
    exposure_s: Option<Positive>,
    min_altitude_deg: Option<Finite>,
    sun_below_deg: Option<Finite>,
}

/// Passes that are looked for and simulated.
#[derive(Debug, Clone)]
pub struct Passes {
    /// Objects, in the order of their numbers: of several sets of one object the one whose epoch is nearest to the window.
    pub objects: Vec<Tle>,
    /// The window.
    pub window: (Epoch, Epoch),
    /// Seconds between samples.
    pub step_s: f64,
    /// Exposure of a sample, s.
    pub exposure_s: f64,
    /// Conditions on a pass.
    pub conditions: Conditions,
}

/// A study: every task that it has, and how they fall into shards.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name: that of the file unless it says another.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// Keys of the scene that change.
    pub parameters: Vec<String>,
    /// Values of the parameters, point by point; one empty point without parameters.
    pub points: Vec<Vec<Value>>,
    /// Passes of objects, in place of the scene's orbit and times.
    pub passes: Option<Passes>,
    /// Whether the samples are kept beside the summary.
    pub keeps_samples: bool,
    /// Tasks of a shard.
    pub tasks_a_shard: usize,
    /// Identity: SHA-256 of the study, the scene, what they name, the station, and the program's version and sources ([`PROGRAM`]).
    pub id: String,
    /// Kinds of the parameters' columns: numbers where all values are, else texts.
    pub kinds: Vec<Kind>,
    /// Channels of the first point's station, whose columns all tasks have.
    pub channels: Vec<String>,
    /// Warnings of the first point's scene.
    pub warnings: Vec<String>,
    /// Sets of elements that were left out: what, and why.
    pub left_out: Vec<String>,
    base: toml::Table,
    scene: PathBuf,
    stations: Stations,
}

/// Stations beside the scene's own.
#[derive(Debug, Clone, Default)]
pub struct Stations {
    /// In place of the scene's.
    pub instead: Option<Station>,
    /// Where the scene names none.
    pub usual: Option<Station>,
}

impl Study {
    /// Reads a study and everything that it names, and makes the scene of its first point.
    ///
    /// # Errors
    /// [`StudyError`]: a file that cannot be read or makes no sense, with its line and key; a first point that makes no scene.
    pub fn read(path: impl AsRef<Path>, stations: Stations) -> Result<Self, StudyError> {
        Self::read_at(path.as_ref(), stations)
    }

    fn read_at(path: &Path, stations: Stations) -> Result<Self, StudyError> {
        let document = Document::read(path)?;
        let keys: Keys = document.parse()?;
        let mut identity = vec![PROGRAM.to_owned(), sha256(document.source().as_bytes())];
        let scene = document.resolve(&keys.study.scene);
        let text = sunglint_formats::read::text(&scene)?;
        let base: toml::Table = text.parse().map_err(|e: toml::de::Error| {
            ParseError::new(&scene, e.message().to_owned(), "a scene in TOML (docs/pass.md)")
        })?;
        identity.push(sha256(text.as_bytes()));
        let (parameters, points) = points(&document, &keys, &mut identity)?;
        let (passes, left_out) = match &keys.passes {
            Some(keys) => {
                let (passes, left_out) = passes(&document, keys, &mut identity)?;
                (Some(passes), left_out)
            }
            None => (None, Vec::new()),
        };
        let name = match &keys.study.name {
            Some(name) => name.clone(),
            None => {
                let stem = document.path().file_stem();
                stem.map_or_else(|| "study".into(), |s| s.to_string_lossy().into_owned())
            }
        };
        let is_number = |p: usize| points.iter().all(|point| point[p].number().is_some());
        let kind = |p| if is_number(p) { Kind::Number } else { Kind::Text };
        let kinds = (0..parameters.len()).map(kind).collect();
        let mut study = Self {
            name,
            path: document.path().to_path_buf(),
            parameters,
            points,
            passes,
            keeps_samples: keys.study.keep.contains(&Kept::Samples),
            tasks_a_shard: 1,
            id: String::new(),
            kinds,
            channels: Vec::new(),
            warnings: Vec::new(),
            left_out,
            base,
            scene,
            stations,
        };
        let tasks = study.tasks();
        if tasks > MOST_TASKS {
            let found =
                format!("{} points for each of {} objects", study.points.len(), study.objects());
            let expected = format!("at most {MOST_TASKS} tasks");
            return Err(ParseError::new(document.path(), found, expected).into());
        }
        study.tasks_a_shard = match keys.study.tasks_a_shard {
            Some(0) => {
                let expected = "the number of tasks of a shard, from 1";
                return Err(document.error_at("study.tasks_a_shard", expected).into());
            }
            Some(tasks) => tasks as usize,
            None => tasks.div_ceil(SHARDS).clamp(1, MOST_TASKS_A_SHARD),
        };
        study.look_at_first(&mut identity)?;
        study.id = sha256(identity.join("\n").as_bytes());
        Ok(study)
    }

    /// Makes the scene of the first point, so that a mistake is known before the work begins.
    fn look_at_first(&mut self, identity: &mut Vec<String>) -> Result<(), StudyError> {
        let first = self.pass(0).map_err(|why| StudyError::Scene {
            path: self.path.clone(),
            point: self.describe(0),
            why,
        })?;
        if self.passes.is_some() && matches!(first.attitude, Attitude::Torques(_)) {
            return Err(StudyError::Scene {
                path: self.path.clone(),
                point: self.describe(0),
                why: "a motion under torques is that of one orbit: it does not go with [passes]"
                    .into(),
            });
        }
        identity.extend(first.inputs.iter().skip(1).map(|input| input.sha256.clone()));
        identity.push(first.station.name.clone());
        self.channels = first.station.channels.iter().map(|c| c.name.clone()).collect();
        self.warnings = first.warnings;
        if let Some(passes) = &self.passes {
            // The first object's are with the scene's: all objects' in one line instead.
            let (from, to) = passes.window;
            let own = first.orbit.warnings(from, from);
            self.warnings.retain(|warning| !own.contains(warning));
            let of = |set: &Tle| TleOrbit::new(set.clone()).ok().map(|o| o.warnings(from, to));
            let all: Vec<String> = passes.objects.iter().filter_map(of).flatten().collect();
            if let Some(one) = all.first() {
                let (count, of) = (all.len(), passes.objects.len());
                self.warnings
                    .push(format!("{count} warnings of {of} objects' elements; one is: {one}"));
            }
        }
        Ok(())
    }

    /// Values of a point in words.
    pub fn describe(&self, point: usize) -> String {
        if self.parameters.is_empty() {
            return "the scene as it is".into();
        }
        let pairs = self.parameters.iter().zip(&self.points[point]);
        pairs.map(|(key, value)| format!("{key} = {value}")).collect::<Vec<_>>().join(", ")
    }

    fn objects(&self) -> usize {
        self.passes.as_ref().map_or(1, |p| p.objects.len())
    }

    /// Number of tasks: points times objects.
    pub fn tasks(&self) -> usize {
        self.points.len().saturating_mul(self.objects())
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        self.tasks().div_ceil(self.tasks_a_shard)
    }

    /// The tasks of a shard.
    pub fn shard(&self, shard: usize) -> std::ops::Range<usize> {
        let from = shard * self.tasks_a_shard;
        from..(from + self.tasks_a_shard).min(self.tasks())
    }

    /// The point and the object of a task: objects change fastest.
    pub fn task(&self, task: usize) -> (usize, usize) {
        (task / self.objects(), task % self.objects())
    }

    /// The scene of a point, made anew. With [`Study::passes`] its orbit is that of the first object, and its time the window's begin.
    ///
    /// # Errors
    /// The scene's fault, in words.
    pub fn pass(&self, point: usize) -> Result<Pass, String> {
        let mut table = self.base.clone();
        if self.passes.is_some() {
            // Times are those of the passes.
            table.insert("times".into(), toml::Table::new().into());
        }
        for (key, value) in self.parameters.iter().zip(&self.points[point]) {
            scene::set(&mut table, key, value).map_err(|e| e.to_string())?;
        }
        let text = toml::to_string(&table).map_err(|e| e.to_string())?;
        let file = PassFile::parse(&self.scene, &text).map_err(|e| e.to_string())?;
        let station = match (&self.stations.instead, file.names_station()) {
            (Some(instead), _) => Some(instead.clone()),
            (None, true) => None,
            (None, false) => Some(self.stations.usual.clone().ok_or(
                "no station: the scene names none in [station], and none was given (--station)",
            )?),
        };
        let mut overrides = Overrides { station, ..Overrides::default() };
        if let Some(passes) = &self.passes {
            let orbit = TleOrbit::new(passes.objects[0].clone()).map_err(|e| e.to_string())?;
            (overrides.orbit, overrides.from) = (Some(orbit.into()), Some(passes.window.0));
        }
        file.resolve(overrides).map_err(|e| e.to_string())
    }
}

fn range(document: &Document, i: usize, keys: &ParameterKeys) -> Result<Range, ParseError> {
    let at = |key: &str| format!("parameter[{i}].{key}");
    let (Some(from), Some(to)) = (keys.from, keys.to) else {
        return Err(document.error_at(&at("key"), "either values, or from and to, beside the key"));
    };
    let (from, to) = (from.get(), to.get());
    if keys.values.is_some() {
        return Err(document.error_at(&at("values"), "either values, or from and to, not both"));
    }
    if keys.scale == Scale::Log && !(from > 0.0 && to > 0.0) {
        return Err(document.error_at(&at("from"), "a range above 0, with scale = \"log\""));
    }
    Ok(Range { from, to, scale: keys.scale })
}

/// Keys and points of a study.
fn points(
    document: &Document,
    keys: &Keys,
    identity: &mut Vec<String>,
) -> Result<(Vec<String>, Vec<Vec<Value>>), StudyError> {
    let study = &keys.study;
    if let Some(file) = &study.table {
        if !keys.parameter.is_empty() || study.design.is_some() {
            let expected = "either a table of points, or [[parameter]] and a design, not both";
            return Err(document.error_at("study.table", expected).into());
        }
        let path = document.resolve(file);
        let text = sunglint_formats::read::text(&path)?;
        identity.push(sha256(text.as_bytes()));
        return table(&path, &text_table::read_str(&path, &text)?);
    }
    let names: Vec<String> = keys.parameter.iter().map(|p| p.key.clone()).collect();
    let mut seen = BTreeSet::new();
    if let Some(i) = names.iter().position(|name| !seen.insert(name)) {
        let expected = "a key that no other [[parameter]] has";
        return Err(document.error_at(&format!("parameter[{i}].key"), expected).into());
    }
    let design = study.design.unwrap_or(Design::Grid);
    let sampled = matches!(design, Design::Latin | Design::Sobol);
    if !sampled && study.points.is_some() {
        let expected = "a design that is sampled (latin or sobol) beside points";
        return Err(document.error_at("study.points", expected).into());
    }
    if names.is_empty() {
        if sampled {
            return Err(document.error_at("study.design", "[[parameter]]s to sample").into());
        }
        return Ok((names, vec![Vec::new()]));
    }
    if sampled {
        let ranges = (keys.parameter.iter().enumerate())
            .map(|(i, p)| range(document, i, p))
            .collect::<Result<Vec<_>, _>>()?;
        let most = if design == Design::Sobol { MOST_SOBOL_POINTS } else { MOST_POINTS };
        let count = study.points.unwrap_or(0) as usize;
        if count == 0 || count > most {
            let expected = format!("the number of points, from 1 to {most}");
            return Err(document.error_at("study.points", expected).into());
        }
        if design == Design::Sobol && ranges.len() > MOST_SOBOL_PARAMETERS {
            let expected = format!("at most {MOST_SOBOL_PARAMETERS} parameters with sobol");
            return Err(document.error_at("study.design", expected).into());
        }
        let seed = study.seed.unwrap_or(0);
        return Ok((
            names,
            match design {
                Design::Sobol => design::sobol(&ranges, count, seed),
                _ => design::latin(&ranges, count, seed),
            },
        ));
    }
    let mut values = Vec::new();
    for (i, parameter) in keys.parameter.iter().enumerate() {
        values.push(match &parameter.values {
            Some(values) if parameter.from.is_none() && parameter.to.is_none() => values.clone(),
            _ => {
                let range = range(document, i, parameter)?;
                let steps = parameter.steps.unwrap_or(0) as usize;
                if steps == 0 || steps > MOST_POINTS {
                    let expected = format!("the number of values, from 1 to {MOST_POINTS}");
                    return Err(document
                        .error_at(&format!("parameter[{i}].steps"), expected)
                        .into());
                }
                range.steps(steps).into_iter().map(Value::Number).collect()
            }
        });
        if values[i].is_empty() {
            let expected = "at least one value";
            return Err(document.error_at(&format!("parameter[{i}].values"), expected).into());
        }
    }
    if design == Design::List {
        let count = values[0].len();
        if let Some(i) = values.iter().position(|v| v.len() != count) {
            let expected =
                format!("as many values as the first parameter's {count}, with design = \"list\"");
            return Err(document.error_at(&format!("parameter[{i}].values"), expected).into());
        }
        let points = (0..count).map(|p| values.iter().map(|v| v[p].clone()).collect()).collect();
        return Ok((names, points));
    }
    let points = design::grid(&values).ok_or_else(|| {
        let expected = format!("a grid of at most {MOST_POINTS} points");
        document.error_at("study.design", expected)
    })?;
    Ok((names, points))
}

/// Points of a table: a column a key, a row a point.
fn table(path: &Path, table: &Table) -> Result<(Vec<String>, Vec<Vec<Value>>), StudyError> {
    let rows = table.rows();
    if rows == 0 || rows > MOST_POINTS {
        let found = format!("{rows} rows");
        let expected = format!("1 to {MOST_POINTS} points");
        return Err(ParseError::new(path, found, expected).into());
    }
    let names: Vec<String> = table.columns.iter().map(|c| c.name.clone()).collect();
    let mut points = vec![Vec::with_capacity(names.len()); rows];
    for name in &names {
        let in_file = |e: sunglint_formats::TableError| e.in_file(path);
        if let Ok(numbers) = table.f64(name) {
            if let Some(row) = numbers.iter().position(|v| !v.is_finite()) {
                let error = ParseError::new(path, numbers[row].to_string(), "a number");
                return Err(error.in_field(format!("{name}, row {}", row + 1)).into());
            }
            points.iter_mut().zip(numbers.iter()).for_each(|(p, v)| p.push(Value::Number(*v)));
        } else {
            let texts = table.text(name).map_err(in_file)?;
            for (row, (point, text)) in points.iter_mut().zip(texts).enumerate() {
                let Some(text) = text else {
                    let error = ParseError::new(path, "no value", "a value");
                    return Err(error.in_field(format!("{name}, row {}", row + 1)).into());
                };
                point.push(Value::Text(text.clone()));
            }
        }
    }
    Ok((names, points))
}

/// Objects and window of a study, and the sets of elements that are none.
fn passes(
    document: &Document,
    keys: &PassesKeys,
    identity: &mut Vec<String>,
) -> Result<(Passes, Vec<String>), StudyError> {
    let (from, to) = (keys.from.0, keys.to.0);
    if seconds_between(from, to) <= 0.0 {
        return Err(document.error_at("passes.to", "a moment after passes.from").into());
    }
    let mut nearest: BTreeMap<u32, Tle> = BTreeMap::new();
    let mut left_out = Vec::new();
    for file in &keys.elements {
        let path = document.resolve(file);
        let text = sunglint_formats::read::text(&path)?;
        identity.push(sha256(text.as_bytes()));
        let (sets, bad) = elements::parse_lenient(&path, &text);
        left_out.extend(bad.iter().map(ToString::to_string));
        for set in sets {
            let age_s = |set: &Tle| seconds_between(set.epoch, from).abs();
            match nearest.get(&set.norad_id) {
                // Of equal epochs the first: the order of the files is part of the study.
                Some(kept) if age_s(kept) <= age_s(&set) => {}
                _ => {
                    nearest.insert(set.norad_id, set);
                }
            }
        }
    }
    if !keys.norad_id.is_empty() {
        let all: Vec<Tle> = nearest.values().cloned().collect();
        for (i, id) in keys.norad_id.iter().enumerate() {
            if !nearest.contains_key(id) {
                let why = tle::choose(&all, Some(&id.to_string()), Some(from)).err();
                let error = document
                    .error_at(&format!("passes.norad_id[{i}]"), "an object of the elements");
                return Err(error
                    .with_hint(why.map_or_else(String::new, |e| e.to_string()))
                    .into());
            }
        }
        nearest.retain(|id, _| keys.norad_id.contains(id));
    }
    let mut objects = Vec::new();
    for (_, set) in nearest {
        match TleOrbit::new(set.clone()) {
            Ok(_) => objects.push(set),
            Err(error) => left_out.push(format!("{}: {error}", set.label())),
        }
    }
    if objects.is_empty() {
        let error =
            document.error_at("passes.elements", "files with elements of at least one object");
        return Err(error.with_hint(left_out.first().cloned().unwrap_or_default()).into());
    }
    let degrees = |key: &str, value: Option<Finite>, usual: f64| {
        let value = value.map_or(usual, Finite::get);
        match (-90.0..=90.0).contains(&value) {
            true => Ok(value),
            false => Err(document.error_at(key, "an altitude, from -90 to 90 degrees")),
        }
    };
    let usual = Conditions::default();
    let conditions = Conditions {
        min_altitude_deg: degrees(
            "passes.min_altitude_deg",
            keys.min_altitude_deg,
            usual.min_altitude_deg,
        )?,
        sun_below_deg: degrees("passes.sun_below_deg", keys.sun_below_deg, usual.sun_below_deg)?,
    };
    let step_s = keys.step_s.get();
    let exposure_s = keys.exposure_s.map_or(step_s.min(0.1), Positive::get);
    Ok((Passes { objects, window: (from, to), step_s, exposure_s, conditions }, left_out))
}
