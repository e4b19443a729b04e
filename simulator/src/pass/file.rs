//! Keys of a `PASS.toml`, the one scene file, and how the file becomes a [`Pass`].
//!
//! ```toml
//! [target]                      # file = "target.toml", built_in = "box_wing", [[target.part]] …, or
//! sphere = { radius_m = 0.5, reflectance = 0.2 }
//!
//! [orbit]                       # or [ephemeris] file = "positions.csv"
//! tle = "catalogue.tle"
//! norad_id = 25544
//!
//! [attitude]                    # left out: inertial, body axes along the GCRS's
//! law = "orbit"
//!
//! [station]                     # left out: --station
//! name = "ufo"
//!
//! [times]
//! from = 2026-03-01T20:00:00Z
//! to = 2026-03-01T20:10:00Z
//! step_s = 0.1                   # or table = "observations.csv", with the target's place in each row, and no [orbit]
//! ```
//!
//! Paths are relative to the file.
//!
//! # A pass, simulated
//!
//! The diffuse sphere's light follows its closed form, W = 2 R²/(3π) (sin γ + (π − γ) cos γ) of the phase angle γ (van de Hulst 1957):
//!
//! ```
//! use sunglint_simulator::pass::{Overrides, PassFile};
//!
//! let scene = r#"
//! [target]
//! name = "sphere"
//! sphere = { radius_m = 1.0, reflectance = 0.3 }
//! [orbit]
//! lines = [
//!   "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
//!   "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
//! ]
//! [effects]
//! earthshine = "off"
//! moonshine = "off"
//! [station]
//! name = "ufo"
//! [times]
//! from = 2008-09-21T18:48:00Z
//! to = 2008-09-21T18:48:30Z
//! step_s = 5.0
//! "#;
//! let pass = PassFile::parse("pass.toml", scene)?.resolve(Overrides::default())?;
//! let simulated = pass.simulate(&|_| ())?;
//! for (place, weights) in simulated.places.iter().zip(simulated.weights.rows()) {
//!     let phase = place.geometry.phase_rad;
//!     let lit = phase.sin() + (std::f64::consts::PI - phase) * phase.cos();
//!     assert!((weights.sum() / (2.0 / (3.0 * std::f64::consts::PI) * lit) - 1.0).abs() < 1e-3);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod earth;
mod observations;
mod times;

use super::keys::{
    AirKeys, EclipseWord, FileKey, IlluminationKeys, PassKeys, SpectrumKeys, StationKeys,
    TargetKeys,
};
use super::{Correction, LightFactor, Pass};
use crate::attitude::{self, Attitude, file::AttitudeFile};
use crate::light::engine::{Options, check_budget, check_tolerance};
use crate::surface::Material;
use crate::target::{self, Part, Placement, Shape, Target, TargetFile};
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use sha2::{Digest as _, Sha256};
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::eclipse::{EARTH_EQUATORIAL_RADIUS_M, EarthShape};
use sunglint_ephemeris::orbit::{Ephemeris, Orbit, OrbitError, TleOrbit, elements, in_tai, tle};
use sunglint_formats::toml::{Document, Finite, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError, Table, curve, nearest_names, text_table};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::station::{AirFile, Station, air_error, lasers};

/// More epochs in one pass are a slip of the step.
pub const MOST_SAMPLES: usize = 1_000_000;
/// More spectral bins are a slip of the step.
pub const MOST_BINS: usize = 100_000;
/// More values (epochs times bins) would not fit into most memories.
pub const MOST_VALUES: usize = 200_000_000;
/// The bins unless the file has others: first edge, last edge, width, nm.
const BINS_NM: (f64, f64, f64) = (300.0, 1240.0, 5.0);
/// A motion under torques is followed so long before and after the exposures, s.
const MARGIN_S: f64 = 30.0;
/// Exposure unless the file says otherwise, s.
const EXPOSURE_S: f64 = 0.1;
/// The tolerance of single observations where none is given: 0.011 mag, less than what single magnitudes of satellites are mostly known to. Each has a geometry of its own, and none is
/// interpolated.
const OBSERVATIONS_TOLERANCE: f64 = 0.01;
/// The air's tables cost next to nothing: they get so much of the tolerance, and no less than [`LEAST_AIR_TOLERANCE`].
const AIR_SHARE: f64 = 1e-4;
/// No finer table of the air is made.
const LEAST_AIR_TOLERANCE: f64 = 1e-10;

/// Values that replace those of the file.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// The station.
    pub station: Option<Station>,
    /// Where the target is, in place of `[orbit]` and `[ephemeris]`.
    pub orbit: Option<Orbit>,
    /// The first moment.
    pub from: Option<Epoch>,
    /// The last moment.
    pub to: Option<Epoch>,
    /// Seconds between moments.
    pub step_s: Option<f64>,
    /// The tolerance, from 1e-9 to 0.1.
    pub tolerance: Option<f64>,
    /// The budget of an epoch's light between surfaces, from 1e-4 to 100 s.
    pub budget_s: Option<f64>,
}

/// A `PASS.toml` that was read, before its files are.
#[derive(Debug)]
pub struct PassFile {
    document: Document,
    keys: PassKeys,
    sources: Vec<Input>,
}

impl PassFile {
    /// Reads a `PASS.toml`.
    ///
    /// # Errors
    /// A file that cannot be read; an unknown or missing key, a value of a wrong kind: with line and key.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_at(path.as_ref())
    }

    fn read_at(path: &Path) -> Result<Self, FileError> {
        let bytes = sunglint_formats::read::bytes(path)?;
        let source = input(path, &bytes);
        let document = Document::new(path, sunglint_formats::read::decode(path, bytes)?)?;
        let keys = document.parse()?;
        Ok(Self { document, keys, sources: vec![source] })
    }

    /// The same from a text; `path` names it in errors, and other files are found beside it.
    ///
    /// # Errors
    /// The errors of [`PassFile::read`], but for the reading.
    pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Self, FileError> {
        Self::parse_at(path.as_ref(), text)
    }

    fn parse_at(path: &Path, text: &str) -> Result<Self, FileError> {
        let document = Document::new(path, text)?;
        let keys = document.parse()?;
        Ok(Self { document, keys, sources: vec![input(path, text.as_bytes())] })
    }

    /// Whether the file names a station.
    pub fn names_station(&self) -> bool {
        self.keys.station.is_some()
    }

    /// The target alone.
    ///
    /// # Errors
    /// The errors of [`PassFile::resolve`].
    pub fn target(&self) -> Result<Target, FileError> {
        Reader { document: &self.document, sources: Vec::new() }.target(&self.keys.target)
    }

    /// The attitude alone.
    ///
    /// # Errors
    /// The errors of [`PassFile::resolve`].
    pub fn attitude(&self) -> Result<Attitude, FileError> {
        let mut reader = Reader { document: &self.document, sources: Vec::new() };
        reader.attitude(self.keys.attitude.as_ref())
    }

    /// Reads everything that the file names and makes the pass.
    ///
    /// # Errors
    /// An input that cannot be read or makes no sense, with the file, the line and the key that is at fault.
    pub fn resolve(&self, overrides: Overrides) -> Result<Pass, FileError> {
        let mut reader = Reader { document: &self.document, sources: self.sources.clone() };
        let keys = &self.keys;
        let target = reader.target(&keys.target)?;
        let table = match &keys.times.table {
            Some(file) => Some(reader.rows(&keys.times, file)?),
            None => None,
        };
        let (mut times, mut exposure_s) = match &table {
            Some(rows) => (rows.times.clone(), rows.exposure_s.clone()),
            None => reader.times(&keys.times, &overrides)?,
        };
        let under_torques = keys.attitude.as_ref().filter(|a| a.is_under_torques());
        let attitude = match under_torques {
            None => Some(reader.attitude(keys.attitude.as_ref())?),
            Some(_) => None,
        };
        let mut station = reader.station(keys.station.as_ref(), overrides.station.clone())?;
        let known = |name: &str| station.channel(name).is_some();
        let own = lasers(&self.document, &keys.laser, &station.lasers, &known)?;
        station.lasers.extend(own);
        let air = reader.air(&keys.air, &station)?;
        let edges_nm = reader.edges(&keys.spectrum, times.len())?;
        let orientation = match &keys.earth_orientation {
            None => None,
            Some(FileKey { file }) => {
                let (table, path) = reader.table("earth_orientation.file", file)?;
                let read = EarthOrientation::from_table(&table);
                Some(read.map_err(|e| ParseError::new(path, e.to_string(), "Earth orientation"))?)
            }
        };
        let (mut observations, table_warnings) = match &table {
            Some(rows) => {
                let of_earth = orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded());
                reader.observations(rows, keys, &station.site, of_earth)?
            }
            None => Default::default(),
        };
        if table.is_some() {
            let kept = reader.kept(&times, &overrides)?;
            times = kept.iter().map(|i| times[*i]).collect();
            exposure_s = kept.iter().map(|i| exposure_s[*i]).collect();
            observations = kept.iter().map(|i| observations[*i].clone()).collect();
        }
        let orbit = match (observations.first(), &overrides.orbit) {
            (Some(first), _) => first.orbit.clone(),
            (None, Some(orbit)) => orbit.clone(),
            (None, None) => reader.orbit(keys, times[0])?,
        };
        let (sun, sun_name) = reader.sun(&keys.illumination)?;
        let shadow = reader.shadow(&keys.illumination)?;
        let earth = reader.earth(&keys.earth)?;
        let correction = self.correction(&target, &station)?;
        let attitude = match (attitude, under_torques) {
            (Some(attitude), _) => attitude,
            (None, None) => Attitude::Inertial(DQuat::IDENTITY),
            (None, Some(_)) if table.is_some() => {
                let expected = "times without a table: a motion under torques needs one [orbit]";
                return Err(self.document.error_at("times.table", expected).into());
            }
            (None, Some(file)) => {
                let offset_s = correction.time_offset_s;
                let scene = attitude::file::Circumstances {
                    target: &target,
                    orbit: &orbit,
                    earth: orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded()),
                    shadow,
                    window: window(&times, &exposure_s, offset_s),
                };
                attitude::file::under_torques(&self.document, "attitude", file, &scene)?
            }
        };
        let zero = match &keys.magnitudes.zero_point {
            None => ZeroPoint::default(),
            Some(text) => text.parse().map_err(|expected: String| {
                self.document.error_at("magnitudes.zero_point", expected)
            })?,
        };
        let tolerance = match (overrides.tolerance, keys.tolerance) {
            (Some(tolerance), _) => tolerance,
            (None, Some(tolerance)) => tolerance.get(),
            (None, None) if table.is_some() => OBSERVATIONS_TOLERANCE,
            (None, None) => Options::TOLERANCE,
        };
        let tolerance = check_tolerance(tolerance).map_err(|_| {
            let expected = "a relative error, from 1e-9 to 0.1 (0.002 is 0.2 %)";
            self.document.error_at("tolerance", expected)
        })?;
        let budget_s = match (overrides.budget_s, keys.budget_s) {
            (Some(budget_s), _) => budget_s,
            (None, budget_s) => budget_s.map_or(Options::BUDGET_S, Positive::get),
        };
        let budget_s = check_budget(budget_s).map_err(|_| {
            let expected = "CPU seconds of an epoch, from 0.0001 to 100";
            self.document.error_at("budget_s", expected)
        })?;
        let mut warnings = target.warnings.clone();
        if observations.is_empty() {
            warnings.extend(orbit.warnings(times[0], times[times.len() - 1]));
        }
        warnings.extend(table_warnings);
        warnings.extend(attitude.warnings());
        warnings.extend(station.warnings.clone());
        warnings.extend(earth::warning(&earth, &keys.earth));
        let of_others = target.sources.iter().chain(&station.sources);
        let mut inputs = reader.sources;
        inputs.extend(of_others.map(|(path, sha256)| Input {
            file: path.display().to_string(),
            sha256: sha256.clone(),
        }));
        let stem = self.document.path().file_stem().map(|s| s.to_string_lossy().into_owned());
        Ok(Pass {
            name: keys.name.clone().or(stem).unwrap_or_else(|| "pass".into()),
            attitude_given: keys.attitude.is_some(),
            target,
            orbit,
            attitude,
            station,
            air,
            times,
            exposure_s,
            observations,
            edges_nm,
            spectral: keys.spectrum.quantity,
            sun,
            sun_name,
            shadow,
            earth: earth.into(),
            orientation,
            zero,
            tolerance,
            budget_s,
            air_tolerance: (AIR_SHARE * tolerance).max(LEAST_AIR_TOLERANCE),
            effects: keys.effects.into(),
            correction,
            inputs,
            notes: keys.note.iter().cloned().collect(),
            warnings,
        })
    }
}

impl PassFile {
    /// The corrections, whose names must be those of the target and the station.
    fn correction(&self, target: &Target, station: &Station) -> Result<Correction, ParseError> {
        let keys = &self.keys.correction;
        let channel = |key: &str, name: &str| match station.channel(name) {
            Some(_) => Ok(()),
            None => {
                let names: Vec<&str> = station.channels.iter().map(|c| c.name.as_str()).collect();
                let expected = format!("a channel of the station ({})", names.join(", "));
                Err(self.document.error_at(key, expected))
            }
        };
        let mut correction = Correction {
            time_offset_s: keys.time_offset_s.map_or(0.0, Finite::get),
            gain: keys.gain.map_or(1.0, Positive::get),
            size: keys.size.map_or(1.0, Positive::get),
            extinction: keys.extinction.map_or(0.0, Finite::get),
            ..Correction::default()
        };
        for (name, k) in &keys.extinction_by_channel {
            channel(&format!("correction.extinction_by_channel.{name}"), name)?;
            correction.extinction_by_channel.insert(name.clone(), k.get());
        }
        for (material, factors) in &keys.light {
            let key = format!("correction.light.{material}");
            if !target.materials.iter().any(|m| m.name == *material) {
                let names: Vec<&str> = target.materials.iter().map(|m| m.name.as_str()).collect();
                let expected = format!("a material of the target ({})", names.join(", "));
                return Err(self.document.error_at(&key, expected));
            }
            let all = factors.all.map_or(1.0, NonNegative::get);
            let mut light = LightFactor { all, ..LightFactor::default() };
            for (name, factor) in &factors.channel {
                channel(&format!("{key}.channel.{name}"), name)?;
                light.channel.insert(name.clone(), factor.get());
            }
            correction.light.insert(material.clone(), light);
        }
        Ok(correction)
    }
}

struct Reader<'a> {
    document: &'a Document,
    sources: Vec<Input>,
}

impl Reader<'_> {
    fn error(&self, key: &str, expected: impl Into<String>) -> ParseError {
        self.document.error_at(key, expected)
    }

    /// The text of a file that stands at a key; one that is not there is an error at the key.
    fn text(&mut self, key: &str, name: &str) -> Result<(String, PathBuf), FileError> {
        let (bytes, path) = self.bytes(key, name)?;
        Ok((sunglint_formats::read::decode(&path, bytes)?, path))
    }

    /// Reads the bytes of such a file, likewise.
    fn bytes(&mut self, key: &str, name: &str) -> Result<(Vec<u8>, PathBuf), FileError> {
        let path = self.document.resolve(name);
        let bytes = sunglint_formats::read::bytes(&path).map_err(|e| self.not_there(key, e))?;
        self.sources.push(input(&path, &bytes));
        Ok((bytes, path))
    }

    fn not_there(&self, key: &str, error: FileError) -> FileError {
        match error {
            FileError::Io { path, source, .. } => {
                let hint = format!("{}: {source}", path.display());
                self.error(key, "a file that can be read").with_hint(hint).into()
            }
            error => error,
        }
    }

    fn table(&mut self, key: &str, name: &str) -> Result<(Table, PathBuf), FileError> {
        let (text, path) = self.text(key, name)?;
        Ok((text_table::read_str(&path, &text)?, path))
    }

    fn target(&self, keys: &TargetKeys) -> Result<Target, FileError> {
        let Some(sphere) = &keys.sphere else {
            let file = TargetFile {
                name: keys.name.clone(),
                description: keys.description.clone(),
                file: keys.file.clone(),
                built_in: keys.built_in.clone(),
                part: keys.part.clone(),
                hinge: keys.hinge.clone(),
                retro: keys.retro.clone(),
                material: keys.material.clone(),
            };
            return target::file::target(self.document, "target", &file);
        };
        let others = [
            ("file", keys.file.is_some()),
            ("built_in", keys.built_in.is_some()),
            ("part", !keys.part.is_empty()),
            ("hinge", !keys.hinge.is_empty()),
            ("material", !keys.material.is_empty()),
        ];
        if let Some((other, _)) = others.iter().find(|(_, given)| *given) {
            let expected = format!("no {other} where [target] is a sphere");
            return Err(self.error(&format!("target.{other}"), expected).into());
        }
        let material = match (&sphere.material, sphere.reflectance) {
            (Some(name), None) => Material::built_in(name).ok_or_else(|| {
                let known = Material::built_in_names();
                let error = self.error(
                    "target.sphere.material",
                    format!("a built-in material: {}", known.join(", ")),
                );
                match nearest_names(name, known.iter().copied(), 1).first() {
                    Some(near) => error.with_hint(format!("did you mean \"{near}\"?")),
                    None => error,
                }
            })?,
            (None, Some(reflectance)) => {
                let (first, last, _) = BINS_NM;
                // Nothing is said of other wavelengths, but grey is grey.
                let grey = Spectrum::constant(reflectance.get(), 0.5 * first, 2.0 * last);
                let grey =
                    grey.map_err(|e| self.error("target.sphere.reflectance", e.to_string()))?;
                Material::lambert(format!("grey {}", reflectance.get()), grey)
                    .map_err(|e| self.error("target.sphere.reflectance", e.to_string()))?
            }
            _ => {
                let expected = "either material (a built-in one) or reflectance (diffuse and grey)";
                return Err(self.error("target.sphere", expected).into());
            }
        };
        let radius_m = sphere.radius_m.get();
        let name = keys.name.clone();
        let part = Part {
            name: "sphere".into(),
            shape: Shape::Sphere { radius_m },
            material: 0,
            placement: Placement::default(),
            hinge: None,
            tangent: DVec3::X,
        };
        let warnings = part.size_warning().into_iter().collect();
        Ok(Target {
            name: name.unwrap_or_else(|| format!("sphere of {radius_m} m")),
            parts: vec![part],
            materials: vec![material],
            warnings,
            ..Target::default()
        })
    }

    fn orbit(&mut self, keys: &PassKeys, near: Epoch) -> Result<Orbit, FileError> {
        let orbit = match (&keys.orbit, &keys.ephemeris) {
            (Some(orbit), None) => orbit,
            (None, Some(FileKey { file })) => {
                let (text, path) = self.text("ephemeris.file", file)?;
                return Ok(Ephemeris::parse(path, &text)?.into());
            }
            (Some(_), Some(_)) => {
                let expected = "either [orbit] or [ephemeris], not both";
                return Err(self.error("ephemeris", expected).into());
            }
            (None, None) => {
                let expected = "[orbit] with tle = \"FILE\", or [ephemeris] with file = \"FILE\"";
                return Err(self.error("orbit", expected).into());
            }
        };
        let (text, path) = match (&orbit.tle, &orbit.lines) {
            (Some(file), None) => self.text("orbit.tle", file)?,
            (None, Some(lines)) if (2..=3).contains(&lines.len()) => {
                let path = format!("{}, orbit.lines", self.document.path().display());
                (lines.join("\n"), path.into())
            }
            (None, Some(lines)) => {
                let expected = "two lines of elements, perhaps after a name";
                let hint = format!("there are {}", lines.len());
                return Err(self.error("orbit.lines", expected).with_hint(hint).into());
            }
            _ => return Err(self.error("orbit", "either tle or lines").into()),
        };
        let which = match (orbit.norad_id, &orbit.name) {
            (Some(_), Some(_)) => {
                return Err(self.error("orbit.name", "either norad_id or name, not both").into());
            }
            (Some(id), None) => Some((id.to_string(), "orbit.norad_id")),
            (None, Some(name)) => Some((name.clone(), "orbit.name")),
            (None, None) => None,
        };
        // The sets beside the wanted one are nobody's concern here, unless the wanted one is not found.
        let (good, mut bad) = elements::parse_lenient(&path, &text);
        if good.is_empty() || which.is_none() && !bad.is_empty() {
            return Err(bad.swap_remove(0).into());
        }
        let chosen = tle::choose(&good, which.as_ref().map(|(w, _)| w.as_str()), Some(near));
        let chosen = chosen.map_err(|error| {
            let key = which.as_ref().map_or("orbit", |(_, key)| key);
            self.error(key, "one set of elements").with_hint(error.to_string())
        })?;
        TleOrbit::new(chosen.clone()).map(Orbit::from).map_err(|error: OrbitError| {
            self.error("orbit", "elements of an orbit").with_hint(error.to_string()).into()
        })
    }

    fn attitude(&mut self, keys: Option<&AttitudeFile>) -> Result<Attitude, FileError> {
        let Some(keys) = keys else { return Ok(Attitude::Inertial(DQuat::IDENTITY)) };
        let document = self.document;
        attitude::file::attitude(document, "attitude", keys, &mut |name| {
            self.table("attitude.file", name)
        })
    }

    fn station(
        &self,
        keys: Option<&StationKeys>,
        instead: Option<Station>,
    ) -> Result<Station, FileError> {
        if let Some(station) = instead {
            return Ok(station);
        }
        let given = keys.map(|k| (k.name.as_deref(), k.file.as_deref(), k.folder.as_deref()));
        let (key, path) = match given {
            Some((Some(name), None, None)) => {
                return Station::built_in(name).unwrap_or_else(|| {
                    let names = Station::built_in_names().join(", ");
                    let expected = format!("a built-in station ({names}), or file, or folder");
                    Err(self.error("station.name", expected).into())
                });
            }
            Some((None, Some(file), None)) => ("station.file", file),
            Some((None, None, Some(folder))) => ("station.folder", folder),
            Some(_) => {
                return Err(self.error("station", "one of name, file and folder").into());
            }
            None => {
                let expected = "[station] with name, file or folder, or --station";
                return Err(self.error("station", expected).into());
            }
        };
        Station::read(self.document.resolve(path)).map_err(|e| self.not_there(key, e))
    }

    fn air(&self, keys: &AirKeys, station: &Station) -> Result<Option<Air>, FileError> {
        let table = AirFile {
            profile: keys.profile.clone(),
            pressure_hpa: keys.pressure_hpa,
            ozone_du: keys.ozone_du,
            water_mm: keys.water_mm,
            co2_ppm: keys.co2_ppm,
            aerosol: keys.aerosol.clone(),
            aerosol_optical_depth_550: keys.aerosol_optical_depth_550,
            aerosol_exponent: keys.aerosol_exponent,
            note: keys.note.clone(),
        };
        if keys.none == Some(true) {
            let idle = [
                ("profile", keys.profile.is_some()),
                ("pressure_hpa", keys.pressure_hpa.is_some()),
                ("ozone_du", keys.ozone_du.is_some()),
                ("water_mm", keys.water_mm.is_some()),
                ("co2_ppm", keys.co2_ppm.is_some()),
                ("aerosol", keys.aerosol.is_some()),
                ("aerosol_optical_depth_550", keys.aerosol_optical_depth_550.is_some()),
                ("refraction", keys.refraction.is_some()),
            ];
            return match idle.iter().find(|(_, given)| *given) {
                Some((key, _)) => {
                    Err(self.error(&format!("air.{key}"), "no other key beside none = true").into())
                }
                None => Ok(None),
            };
        }
        let made = table.over(self.document, "air", &station.air)?;
        let options = made.options(station.site.geodetic().height_m).map(|mut options| {
            options.refraction = keys.refraction.unwrap_or(true);
            options
        });
        let air = options.and_then(|options| Air::new(&options));
        Ok(Some(air.map_err(|e| air_error(self.document, "air", "air", &e))?))
    }

    fn edges(&self, keys: &SpectrumKeys, epochs: usize) -> Result<Vec<f64>, ParseError> {
        let stepped = [keys.from_nm, keys.to_nm, keys.step_nm].iter().any(Option::is_some);
        let edges: Vec<f64> = match &keys.edges_nm {
            Some(_) if stepped => {
                let expected = "either edges_nm, or from_nm, to_nm and step_nm";
                return Err(self.error("spectrum.edges_nm", expected));
            }
            Some(edges) => edges.iter().map(|e| e.get()).collect(),
            None => {
                let get = |key: Option<Positive>, usual: f64| key.map_or(usual, Positive::get);
                let (from, to) = (get(keys.from_nm, BINS_NM.0), get(keys.to_nm, BINS_NM.1));
                let step = get(keys.step_nm, BINS_NM.2);
                let bins = (to - from) / step;
                if bins.is_nan() || bins <= 0.0 {
                    return Err(self.error("spectrum.to_nm", "more than from_nm").with_hint(
                        format!("from {from} to {to} nm; the usual ends are 300 and 1240 nm"),
                    ));
                }
                if (bins - bins.round()).abs() > 1e-6 || bins < 0.5 {
                    let expected = format!("a step that divides {} nm", to - from);
                    return Err(self.error("spectrum.step_nm", expected));
                }
                if bins > MOST_BINS as f64 {
                    let expected = format!("a step that makes at most {MOST_BINS} bins");
                    return Err(self.error("spectrum.step_nm", expected));
                }
                // Bounded above.
                let bins = bins.round() as u32;
                let edge = |i: u32| from + (to - from) * f64::from(i) / f64::from(bins);
                (0..=bins).map(edge).collect()
            }
        };
        if edges.len() < 2 || edges.windows(2).any(|e| e[0] >= e[1]) {
            let expected = "at least two edges, increasing, nm";
            return Err(self.error("spectrum.edges_nm", expected));
        }
        if (edges.len() - 1).saturating_mul(epochs) > MOST_VALUES {
            let expected = format!("fewer bins: with {epochs} epochs at most {MOST_VALUES} values");
            return Err(self.error("spectrum", expected));
        }
        Ok(edges)
    }

    fn sun(
        &mut self,
        keys: &IlluminationKeys,
    ) -> Result<(Spectrum<Irradiance>, String), FileError> {
        let Some(file) = &keys.irradiance_file else {
            return Ok((light::sun_at_1_au().clone(), "ASTM G173-03".into()));
        };
        let (text, path) = self.text("illumination.irradiance_file", file)?;
        let curve = curve::read_str(&path, &text, Some("irradiance_w_m2_nm"))?;
        let spectrum = Spectrum::new(curve.x, curve.y).map_err(|e| {
            ParseError::new(&path, e.to_string(), "spectral irradiance at 1 au, W m-2 nm-1")
        })?;
        Ok((spectrum, path.display().to_string()))
    }

    fn shadow(&self, keys: &IlluminationKeys) -> Result<Option<EarthShape>, ParseError> {
        if keys.earth_radius_m.is_some() && keys.eclipse != EclipseWord::Sphere {
            let expected = "eclipse = \"sphere\" where the Earth has a radius";
            return Err(self.error("illumination.earth_radius_m", expected));
        }
        let radius_m = keys.earth_radius_m.map_or(EARTH_EQUATORIAL_RADIUS_M, Positive::get);
        if !(6.2e6..=6.6e6).contains(&radius_m) {
            let expected = "the Earth's radius in metres, about 6.378e6";
            return Err(self.error("illumination.earth_radius_m", expected));
        }
        Ok(match keys.eclipse {
            EclipseWord::Sphere => Some(EarthShape::Sphere { radius_m }),
            EclipseWord::Ellipsoid => Some(EarthShape::Ellipsoid),
            EclipseWord::None => None,
        })
    }
}

/// The moments between which an attitude may be asked for: the exposures, earlier by the light's time (10 s from beyond the Moon), and some seconds
/// for a fit that shifts the clock.
fn window(times: &[Epoch], exposure_s: &[f64], offset_s: f64) -> (Epoch, Epoch) {
    let later = |t: Epoch, s: f64| in_tai(t) + hifitime::Duration::from_seconds(s);
    let half_s = 0.5 * exposure_s.iter().copied().fold(0.0, f64::max) + MARGIN_S;
    let first = times.iter().copied().fold(times[0], |a, b| a.min(b));
    let last = times.iter().copied().fold(times[0], |a, b| a.max(b));
    (later(first, offset_s - half_s), later(last, offset_s + half_s))
}

fn input(path: &Path, bytes: &[u8]) -> Input {
    let hash = Sha256::digest(bytes);
    let sha256 = hash.iter().map(|byte| format!("{byte:02x}")).collect();
    Input { file: path.display().to_string(), sha256 }
}
