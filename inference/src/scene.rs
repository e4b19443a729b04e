//! A scene file with everything in it that can be fitted: the target's own file taken in, built-in materials written out, paths made whole. Numbers
//! are set in it by name, and it is written again with what was found.

use hifitime::Epoch;
use std::path::{Path, PathBuf};
use sunglint_formats::{FileError, nearest_names};
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::pass::{Overrides, Pass, PassFile};
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::Target;
use toml::{Table, Value};

/// Keys whose values are files, where there is one of that name.
const FILES: [&str; 8] = [
    "table",
    "tle",
    "file",
    "folder",
    "reflectance_file",
    "irradiance_file",
    "horizon_mask",
    "refractive_index",
];

/// Why there is no scene that numbers could be set in.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file that cannot be read, or is not what it should be.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is no TOML.
    #[error("{}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Cause of the error.
        source: Box<toml::de::Error>,
    },
    /// A built-in target that is no TOML.
    #[error(transparent)]
    BuiltIn(Box<toml::de::Error>),
    /// Scene that cannot be written as TOML.
    #[error(transparent)]
    Write(#[from] toml::ser::Error),
    /// A built-in target that there is not.
    #[error("no target {name}")]
    NoTarget {
        /// Name of the target.
        name: String,
    },
    /// A sphere of nothing.
    #[error("[target] sphere has neither material nor reflectance")]
    Sphere,
    /// A name of nothing that can be fitted.
    #[error(
        "{}: nothing that can be fitted is called `{name}`{}; there are {}",
        path.display(),
        near.as_ref().map(|n| format!(" (did you mean `{n}`?)")).unwrap_or_default(),
        known.join(", ")
    )]
    Unknown {
        /// The scene.
        path: PathBuf,
        /// The name.
        name: String,
        /// The known one that is nearest.
        near: Option<String>,
        /// All known ones.
        known: Vec<String>,
    },
}

/// A scene that numbers can be set in.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The file it came from.
    pub path: PathBuf,
    table: Table,
}

/// Which lists have names in place of numbers.
const LISTS: [&str; 3] = ["part", "hinge", "material"];

impl Scene {
    /// Reads a scene file and takes in its target.
    ///
    /// # Errors
    /// A file that cannot be read or is no scene; a target that is none.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        // Its own reader says best what is wrong with it.
        PassFile::read(path)?;
        let text = sunglint_formats::read::text(path)?;
        let mut table: Table = parsed(path, &text)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        whole(&mut table, &folder);
        if let Some(Value::Table(target)) = table.get_mut("target") {
            take_in(target)?;
        }
        axis_as_angles(&mut table);
        table.remove("fit");
        Ok(Self { path: path.to_path_buf(), table })
    }

    /// A scene from a text that [`Scene::text`] wrote, as if it were in the file of `path`.
    ///
    /// # Errors
    /// A text that is no scene.
    pub fn parse(path: &Path, text: &str) -> Result<Self, SceneError> {
        PassFile::parse(path, text)?;
        Ok(Self { path: path.to_path_buf(), table: parsed(path, text)? })
    }

    /// First and last moment of its own times; `None` where its file of times or a station is missing.
    pub fn ends(&self, overrides: Overrides) -> Option<(Epoch, Epoch)> {
        let times = self.pass(overrides).ok()?.times;
        let first = *times.first()?;
        Some(times.iter().fold((first, first), |(a, b), t| (a.min(*t), b.max(*t))))
    }

    /// Gives it times from a first to a last moment (UTC) in steps, and an exposure, s.
    pub fn set_times(&mut self, from: &str, to: &str, step_s: f64, exposure_s: f64) {
        let mut times = Table::new();
        times.insert("from".into(), Value::String(from.into()));
        times.insert("to".into(), Value::String(to.into()));
        times.insert("step_s".into(), Value::Float(step_s));
        times.insert("exposure_s".into(), Value::Float(exposure_s));
        self.table.insert("times".into(), Value::Table(times));
    }

    /// Changes a number of `[correction]`: what is there (`usual` where there is nothing) becomes `change` of it.
    pub fn correct(&mut self, keys: &[&str], usual: f64, change: &dyn Fn(f64) -> f64) {
        let Some((last, tables)) = keys.split_last() else { return };
        let mut table = &mut self.table;
        for key in std::iter::once(&"correction").chain(tables) {
            let entry = table.entry(*key).or_insert_with(|| Value::Table(Table::new()));
            let Value::Table(inner) = entry else { return };
            table = inner;
        }
        let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
        let before = table.get(*last).and_then(number).unwrap_or(usual);
        table.insert((*last).to_owned(), Value::Float(change(before)));
    }

    /// The name of its file, without the extension.
    pub fn name(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// The scene as text.
    ///
    /// # Errors
    /// Any value that TOML cannot hold.
    pub fn text(&self) -> Result<String, SceneError> {
        Ok(toml::to_string(&self.table)?)
    }

    fn file(&self) -> Result<PassFile, String> {
        let text = toml::to_string(&self.table).map_err(|e| e.to_string())?;
        PassFile::parse(&self.path, &text).map_err(|e| e.to_string())
    }

    /// The pass, its times aside.
    ///
    /// # Errors
    /// A scene that is none, or names files that are none.
    pub fn pass(&self, overrides: Overrides) -> Result<Pass, SceneError> {
        let file = PassFile::parse(&self.path, &self.text()?)?;
        Ok(file.resolve(overrides)?)
    }

    /// Whether the scene names a station.
    pub fn names_station(&self) -> bool {
        self.table.contains_key("station")
    }

    /// Returns true where the scene's times are rows of a table of observations, each with its target's place.
    pub fn has_observations(&self) -> bool {
        self.table.get("times").and_then(|t| t.get("table")).is_some()
    }

    /// The exposure that the scene says, s: `[times] exposure_s`.
    pub fn exposure_s(&self) -> Option<f64> {
        let said = self.table.get("times")?.get("exposure_s")?;
        said.as_float().or_else(|| said.as_integer().map(|s| s as f64)).filter(|s| *s > 0.0)
    }

    /// The same with a body that costs nothing to read, for what is not about the body.
    pub fn without_target(&self) -> Self {
        let mut scene = self.clone();
        let mut target = Table::new();
        target.insert("built_in".into(), Value::String("lambert_sphere".into()));
        scene.table.insert("target".into(), Value::Table(target));
        scene
    }

    /// The same over other times: first and last moment, UTC.
    pub fn between(&self, from: &str, to: &str, length_s: f64) -> Self {
        let mut scene = self.clone();
        let mut times = Table::new();
        times.insert("from".into(), Value::String(from.into()));
        if length_s > 0.0 {
            times.insert("to".into(), Value::String(to.into()));
            times.insert("step_s".into(), Value::Float(length_s));
        }
        scene.table.insert("times".into(), Value::Table(times));
        scene
    }

    /// The attitude as it stands.
    ///
    /// # Errors
    /// An attitude that is none, in words.
    pub fn attitude(&self) -> Result<Attitude, String> {
        self.file()?.attitude().map_err(|e| e.to_string())
    }

    /// The target as it stands.
    ///
    /// # Errors
    /// A target that is none, in words.
    pub fn target(&self) -> Result<Target, String> {
        self.file()?.target().map_err(|e| e.to_string())
    }

    /// The numbers that can be fitted, by name.
    pub fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        if let Some(attitude) = self.table.get("attitude") {
            collect("attitude", attitude, &mut names);
        }
        for list in LISTS {
            for entry in self.list(list) {
                let Some(name) = entry.get("name").and_then(Value::as_str) else { continue };
                for (key, value) in entry {
                    collect(&format!("{list}.{name}.{key}"), value, &mut names);
                }
            }
        }
        names.iter().map(|n| alias(n)).collect()
    }

    fn list(&self, list: &str) -> Vec<&Table> {
        let entries = self.table.get("target").and_then(|t| t.get(list)).and_then(Value::as_array);
        entries.into_iter().flatten().filter_map(Value::as_table).collect()
    }

    /// A number by its name; `None` where there is none.
    pub fn get(&self, name: &str) -> Option<f64> {
        let mut copy = self.table.clone();
        let value = place(&mut copy, &full(name))?;
        value.as_float().or_else(|| value.as_integer().map(|i| i as f64))
    }

    /// Sets a number; false where there is none of that name.
    pub fn set(&mut self, name: &str, number: f64) -> bool {
        match place(&mut self.table, &full(name)) {
            Some(value) => {
                *value = Value::Float(number);
                true
            }
            None => false,
        }
    }

    /// The value of a key of `[attitude]`, numbers and texts alike.
    pub fn attitude_key(&self, key: &str) -> Option<&Value> {
        self.table.get("attitude")?.get(key)
    }

    /// Sets how a body spins whose axis in the body the scene says: angles in degrees, the period in s.
    pub fn set_spin(&mut self, ra_deg: f64, dec_deg: f64, phase_deg: f64, period_s: f64) {
        let Some(Value::Table(attitude)) = self.table.get_mut("attitude") else { return };
        for key in ["rate_deg_s", "rate_rpm", "period_s"] {
            attitude.remove(key);
        }
        let axis = [ra_deg, dec_deg].map(Value::Float).to_vec();
        attitude.insert("axis_ra_dec_deg".into(), Value::Array(axis));
        attitude.insert("phase_deg".into(), Value::Float(phase_deg));
        if period_s.is_finite() {
            attitude.insert("period_s".into(), Value::Float(period_s));
        } else {
            attitude.insert("rate_deg_s".into(), Value::Float(0.0));
        }
    }

    /// Gives a material another reflectance, a single number where it is the same at every wavelength; false where it has none that would be its only factor.
    pub fn set_reflectance(&mut self, material: &str, nm: &[f64], reflectance: &[f64]) -> bool {
        let name = format!("material.{material}");
        let Some(Value::Table(table)) = place(&mut self.table, &name) else { return false };
        let known = ["reflectance", "reflectance_file", "reflectance_table"];
        if !known.iter().any(|key| table.contains_key(*key)) {
            return false;
        }
        known.iter().for_each(|key| {
            table.remove(*key);
        });
        let rounded = |v: f64| Value::Float((v * 1e6).round() / 1e6);
        if let Some(first) =
            reflectance.first().filter(|first| reflectance.iter().all(|v| v == *first))
        {
            table.insert("reflectance".into(), rounded(*first));
            return true;
        }
        let list = |values: &[f64]| Value::Array(values.iter().copied().map(rounded).collect());
        let mut own = Table::new();
        own.insert("wavelength_nm".into(), list(nm));
        own.insert("reflectance".into(), list(reflectance));
        table.insert("reflectance_table".into(), Value::Table(own));
        true
    }

    /// Adds to the scene's note.
    pub fn remark(&mut self, text: &str) {
        let before = self.table.get("note").and_then(Value::as_str).unwrap_or_default();
        let both = if before.is_empty() { text.to_owned() } else { format!("{before} {text}") };
        self.table.insert("note".into(), Value::String(both));
    }

    /// Refuses a name that is none, with those that there are.
    pub fn unknown(&self, name: &str, more: &[String]) -> SceneError {
        let mut known = more.to_vec();
        known.extend(self.names());
        let near = nearest_names(name, known.iter().map(String::as_str), 1);
        let near = near.first().map(|n| (*n).to_owned());
        SceneError::Unknown { path: self.path.clone(), name: name.to_owned(), near, known }
    }
}

/// The names that stand for parts of a list.
const ALIASES: [(&str, &str); 5] = [
    ("attitude.axis_ra_deg", "attitude.axis_ra_dec_deg.0"),
    ("attitude.axis_dec_deg", "attitude.axis_ra_dec_deg.1"),
    ("attitude.yaw_deg", "attitude.euler_zyx_deg.0"),
    ("attitude.pitch_deg", "attitude.euler_zyx_deg.1"),
    ("attitude.roll_deg", "attitude.euler_zyx_deg.2"),
];

fn alias(name: &str) -> String {
    let known = ALIASES.iter().find(|(_, full)| *full == name);
    known.map_or(name, |(short, _)| short).to_owned()
}

fn full(name: &str) -> String {
    let known = ALIASES.iter().find(|(short, _)| *short == name);
    known.map_or(name, |(_, full)| full).to_owned()
}

/// The value at a dotted name.
fn place<'a>(table: &'a mut Table, name: &str) -> Option<&'a mut Value> {
    let steps: Vec<&str> = name.split('.').collect();
    let (first, rest) = steps.split_first()?;
    let (mut value, rest) = if LISTS.contains(first) {
        let target = table.get_mut("target")?.as_table_mut()?;
        let entries = target.get_mut(*first)?.as_array_mut()?;
        // Names may have dots themselves: the longest that is one.
        let found = (1..=rest.len()).rev().find_map(|n| {
            let own = rest[..n].join(".");
            let of = |e: &Value| e.get("name").and_then(Value::as_str) == Some(own.as_str());
            entries.iter().position(of).map(|i| (i, n))
        });
        let (i, n) = found?;
        (&mut entries[i], &rest[n..])
    } else {
        (table.get_mut(*first)?, rest)
    };
    for step in rest {
        value = match value {
            Value::Table(table) => table.get_mut(*step)?,
            Value::Array(list) => list.get_mut(step.parse::<usize>().ok()?)?,
            _ => return None,
        };
    }
    Some(value)
}

/// Names of all numbers below a value; tables of spectra are no numbers of their own.
fn collect(name: &str, value: &Value, names: &mut Vec<String>) {
    match value {
        Value::Float(_) | Value::Integer(_) => names.push(name.to_owned()),
        Value::Array(list) if list.len() <= 4 => {
            for (i, value) in list.iter().enumerate() {
                collect(&format!("{name}.{i}"), value, names);
            }
        }
        Value::Table(table) if !name.ends_with("reflectance_table") => {
            for (key, value) in table {
                collect(&format!("{name}.{key}"), value, names);
            }
        }
        _ => {}
    }
}

/// Makes paths whole that are there beside the file.
fn whole(table: &mut Table, folder: &Path) {
    for (key, value) in table.iter_mut() {
        match value {
            Value::String(text) if FILES.contains(&key.as_str()) => {
                let path = folder.join(&*text);
                if let Ok(path) = path.canonicalize() {
                    *text = path.display().to_string();
                }
            }
            Value::Table(table) => whole(table, folder),
            Value::Array(list) => {
                for entry in list.iter_mut().filter_map(Value::as_table_mut) {
                    whole(entry, folder);
                }
            }
            _ => {}
        }
    }
}

fn parsed(path: &Path, text: &str) -> Result<Table, SceneError> {
    let wrong = |e| SceneError::Syntax { path: path.to_path_buf(), source: Box::new(e) };
    text.parse().map_err(wrong)
}

/// Takes a target's own file in, turns a sphere into a part, and writes built-in materials out.
fn take_in(target: &mut Table) -> Result<(), SceneError> {
    let text =
        |key: &str, target: &Table| target.get(key).and_then(Value::as_str).map(str::to_owned);
    if let Some(file) = text("file", target) {
        let path = PathBuf::from(&file);
        let mut own = parsed(&path, &sunglint_formats::read::text(&path)?)?;
        whole(&mut own, path.parent().unwrap_or(Path::new("")));
        target.remove("file");
        adopt(target, own);
    } else if let Some(name) = text("built_in", target) {
        let text = Target::built_in_text(&name)
            .ok_or_else(|| SceneError::NoTarget { name: name.clone() })?;
        let own: Table = text.parse().map_err(|e| SceneError::BuiltIn(Box::new(e)))?;
        target.remove("built_in");
        adopt(target, own);
    } else if let Some(Value::Table(sphere)) = target.remove("sphere") {
        let mut part = Table::new();
        for (key, value) in [("name", "sphere"), ("shape", "sphere")] {
            part.insert(key.into(), Value::String(value.into()));
        }
        if let Some(radius) = sphere.get("radius_m") {
            part.insert("radius_m".into(), radius.clone());
        }
        let material = match (sphere.get("material"), sphere.get("reflectance")) {
            (Some(name), _) => name.clone(),
            (None, Some(reflectance)) => {
                let mut own = Table::new();
                own.insert("name".into(), Value::String("surface".into()));
                own.insert("model".into(), Value::String("lambert".into()));
                own.insert("reflectance".into(), reflectance.clone());
                target.insert("material".into(), Value::Array(vec![Value::Table(own)]));
                Value::String("surface".into())
            }
            (None, None) => return Err(SceneError::Sphere),
        };
        part.insert("material".into(), material);
        target.insert("part".into(), Value::Array(vec![Value::Table(part)]));
    }
    write_out_materials(target);
    Ok(())
}

fn adopt(target: &mut Table, own: Table) {
    for (key, value) in own {
        target.entry(key).or_insert(value);
    }
}

/// Built-in materials that a part is made of, as tables of the file: what is fitted of them has a place then.
fn write_out_materials(target: &mut Table) {
    let named = |list: &str| -> Vec<String> {
        let entries = target.get(list).and_then(Value::as_array);
        let key = if list == "part" { "material" } else { "name" };
        let names = entries.into_iter().flatten().filter_map(|e| e.get(key)?.as_str());
        names.map(str::to_owned).collect()
    };
    let known = named("material");
    let mut missing: Vec<String> =
        named("part").into_iter().filter(|m| !known.contains(m)).collect();
    missing.sort();
    missing.dedup();
    for name in missing {
        let Some(own) = Material::built_in(&name).as_ref().and_then(written_out) else { continue };
        let list = target.entry("material").or_insert_with(|| Value::Array(Vec::new()));
        if let Value::Array(list) = list {
            list.push(Value::Table(own));
        }
    }
}

/// A built-in material as a file has it; `None` for what is more than a reflectance and a lobe.
fn written_out(material: &Material) -> Option<Table> {
    let [spectrum] = material.spectra() else { return None };
    let mut own = Table::new();
    let mut text = |key: &str, value: &str| own.insert(key.into(), Value::String(value.into()));
    text("name", &material.name);
    if material.is_lambert() {
        text("model", "lambert");
    } else {
        let (_, alpha) = material.narrowest_lobe().filter(|(_, alpha)| *alpha > 0.0)?;
        text("model", "microfacet");
        text("distribution", "beckmann");
        own.insert("alpha".into(), Value::Float(alpha));
    }
    let list = |values: &[f64]| Value::Array(values.iter().map(|v| Value::Float(*v)).collect());
    let mut table = Table::new();
    table.insert("wavelength_nm".into(), list(spectrum.wavelength_nm()));
    table.insert("reflectance".into(), list(spectrum.value()));
    own.insert("reflectance_table".into(), Value::Table(table));
    Some(own)
}

/// A spin's axis as two angles, which are two numbers rather than three that hang together.
fn axis_as_angles(table: &mut Table) {
    let Some(Value::Table(attitude)) = table.get_mut("attitude") else { return };
    if !attitude.contains_key("axis_body") {
        return;
    }
    let Some(Value::Array(axis)) = attitude.get("axis_gcrs") else {
        if attitude.contains_key("axis_ra_dec_deg") {
            attitude.entry("phase_deg").or_insert(Value::Float(0.0));
        }
        return;
    };
    let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
    let Some(xyz) = axis.iter().map(number).collect::<Option<Vec<f64>>>() else { return };
    let [x, y, z] = xyz[..] else { return };
    let (ra, dec) = (y.atan2(x).to_degrees(), z.atan2(x.hypot(y)).to_degrees());
    attitude.remove("axis_gcrs");
    let angles = [ra, dec].map(Value::Float).to_vec();
    attitude.insert("axis_ra_dec_deg".into(), Value::Array(angles));
    attitude.entry("phase_deg").or_insert(Value::Float(0.0));
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn scene(text: &str) -> Scene {
        let mut table: Table = text.parse().unwrap();
        if let Some(Value::Table(target)) = table.get_mut("target") {
            take_in(target).unwrap();
        }
        axis_as_angles(&mut table);
        Scene { path: "pass.toml".into(), table }
    }

    const REST: &str = "orbit.lines = [\"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\", \
        \"2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\"]\nstation.name = \"ufo\"\n\
        times.from = 2008-09-21T18:48:00Z\n";

    /// Truth: the built-in target itself: the same parts, and materials that reflect the same in drawn directions. Tolerance: rounding.
    #[test]
    fn a_target_that_was_written_out_is_the_same() {
        for name in ["box_wing", "lambert_sphere", "hexagon"] {
            let scene = scene(&format!("target.built_in = \"{name}\"\n{REST}"));
            let (found, truth) = (scene.target().unwrap(), Target::built_in(name).unwrap());
            assert_eq!(found.parts.len(), truth.parts.len());
            for material in &truth.materials {
                let own = found.materials.iter().find(|m| m.name == material.name).unwrap();
                for k in 0..20 {
                    let a = f64::from(k) * 0.13;
                    let i = DVec3::new(0.4 * a.cos(), 0.4 * a.sin(), 0.8).normalize();
                    let o = DVec3::new(-0.5 * a.sin(), 0.3, 0.7).normalize();
                    let (f, g) = (own.brdf(633.0, i, o), material.brdf(633.0, i, o));
                    assert!((f - g).abs() <= 1e-12 * g, "{name}, {}: {f} {g}", material.name);
                }
            }
        }
    }

    #[test]
    fn numbers_have_names() {
        let mut scene = scene(&format!(
            "target.built_in = \"box_wing\"\n{REST}[attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\naxis_gcrs = [0, 0.5, 0.5]\nperiod_s = 120\nepoch_utc = 2020-11-18T16:20:00Z\n"
        ));
        let names = scene.names();
        for name in [
            "attitude.period_s",
            "attitude.axis_dec_deg",
            "material.solar_cell.alpha",
            "part.body_z.size_m.2",
        ] {
            assert!(names.iter().any(|n| n == name), "{name} is not in {names:?}");
        }
        assert_eq!(scene.get("material.solar_cell.alpha"), Some(0.15));
        assert!((scene.get("attitude.axis_dec_deg").unwrap() - 45.0).abs() < 1e-12);
        assert!(scene.set("attitude.period_s", 7.5) && !scene.set("attitude.nothing", 1.0));
        assert_eq!(scene.get("attitude.period_s"), Some(7.5));
        assert!(scene.attitude().is_ok(), "{:?}", scene.attitude());
        let message = scene.unknown("material.solar_cel.alpha", &[]).to_string();
        assert!(message.contains("did you mean `material.solar_cell.alpha`?"), "{message}");
    }
}
