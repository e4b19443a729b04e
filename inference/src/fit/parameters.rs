//! Free parameters, by name: numbers of the scene, reflectances of materials, offsets, extinction.

use super::PassFitError;
use super::normals::plate;
use crate::scene::Scene;
use crate::solver::{
    Component, Extinction, Free, Law, Linear, Prior, Search, Shaping, StudyModel, Unit, ZeroPoint,
    band_mean,
};
use std::collections::BTreeSet;
use std::str::FromStr;
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::spectrum::{Spectrum, Transmission};
use sunglint_simulator::pass::Study;

/// The step of differences, as a part of a parameter's range.
const STEP: f64 = 1e-5;
/// The largest range over which a number of the scene is searched where nobody says otherwise, as factors of its start.
const FACTORS: (f64, f64) = (0.5, 2.0);

/// Range of the error of a zero point, mag.
const ZERO_POINT_RANGE: (f64, f64) = (-1.0, 1.0);
/// Standard deviation of the error of a zero point unless somebody says otherwise, mag: what unfiltered photometry against a catalogue leaves.
const ZERO_POINT_SIGMA: f64 = 0.1;

/// A parameter as it is asked for: by its name, perhaps with a range and a prior; written `NAME`, `NAME=LO..HI`, `NAME~MEAN+-SIGMA` or
/// `NAME=LO..HI~MEAN+-SIGMA`.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeParameter {
    /// Name of the parameter.
    pub name: String,
    /// Range of the parameter.
    pub range: Option<(f64, f64)>,
    /// Knowledge of it from elsewhere.
    pub prior: Option<Prior>,
}

impl FromStr for FreeParameter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || {
            format!(
                "`{text}`: expected NAME, NAME=LO..HI with LO below HI, either perhaps with ~MEAN+-SIGMA, SIGMA above 0"
            )
        };
        let (rest, prior) = match text.split_once('~') {
            None => (text, None),
            Some((rest, prior)) => {
                let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite());
                let both = prior.split_once("+-").or_else(|| prior.split_once('±'));
                let both = both.and_then(|(m, s)| Some((number(m)?, number(s)?)));
                let (mean, sigma) = both.filter(|(_, sigma)| *sigma > 0.0).ok_or_else(form)?;
                (rest, Some(Prior { mean, sigma }))
            }
        };
        let Some((name, range)) = rest.split_once('=') else {
            return Ok(Self { name: rest.trim().to_owned(), range: None, prior });
        };
        let ends = range.split_once("..").and_then(|(a, b)| {
            Some((a.trim().parse::<f64>().ok()?, b.trim().parse::<f64>().ok()?))
        });
        match ends {
            Some((low, high)) if low < high && low.is_finite() && high.is_finite() => {
                Ok(Self { name: name.trim().to_owned(), range: Some((low, high)), prior })
            }
            _ => Err(form()),
        }
    }
}

/// One curve with its scene, as parameters see it.
pub(super) struct CurveSide<'a> {
    /// Scene of the curve.
    pub scene: &'a Scene,
    /// Study of the curve.
    pub study: &'a Study,
    /// The station's channel of each channel of the fit.
    pub unit: Unit,
    /// Whether a channel of the fit has a sample here.
    pub has: Vec<bool>,
    /// Camera of each sample of magnitudes, where there are several.
    pub cameras: Option<&'a [String]>,
    /// Which samples are fitted, in any channel.
    pub used: Vec<bool>,
}

/// A parameter that sets something of a curve.
#[derive(Debug, Clone, PartialEq)]
enum Role {
    Key(String),
    TimeOffset,
    Size,
    Gain,
    Extinction(Option<usize>),
    ZeroPoint(Vec<bool>),
}

/// All parameters of a fit.
#[derive(Default)]
pub(super) struct Parameters {
    /// Those that are searched for.
    pub free: Vec<Free>,
    /// Those that are solved for.
    pub linear: Vec<Linear>,
    /// Components that the linear parameters scale.
    pub components: Vec<Component>,
    /// Role of each parameter that is searched for, and in which curves it acts (all where `None`).
    roles: Vec<(Role, Option<usize>)>,
    /// Material of each parameter that is solved for, and its channel (`None`: all alike).
    pub scales: Vec<(String, Option<usize>)>,
    /// Normals that are searched for.
    pub normals: Vec<Normal>,
    /// Largest albedo, and largest reflectance of what is scaled.
    largest_albedo: f64,
}

/// A flat part whose normal is searched for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Normal {
    pub part: String,
    /// Material of the part, of which nothing else is made.
    pub material: String,
    /// Numbers of the parameters that are its azimuth and its tilt.
    pub angles: [usize; 2],
    /// Number of the parameter that is the material's roughness, and its name in the scene; `None` where it is not free.
    pub roughness: Option<(usize, String)>,
    /// Numbers of the linear parameters of its light.
    pub linear: Vec<usize>,
    /// Largest factor of its light.
    pub most: f64,
}

/// Keys of a material that are the roughness of its lobe.
const ROUGHNESS: [&str; 2] = ["alpha", "slope_rms"];

/// Names that are no numbers of the scene.
fn special(channels: &[String], sides: &[CurveSide]) -> Vec<String> {
    let mut names: Vec<String> =
        ["albedo", "time_offset_s", "size", "gain", "extinction", "zero_point"]
            .map(str::to_owned)
            .to_vec();
    for material in materials(sides) {
        names.push(format!("albedo.{material}"));
        names.extend(channels.iter().map(|c| format!("albedo.{material}.{c}")));
        names.push(format!("scale.{material}"));
    }
    names.extend(channels.iter().map(|c| format!("extinction.{c}")));
    let target = &sides[0].study.pass().target;
    let flat = target.parts.iter().filter(|p| plate(target, &p.name).is_ok());
    names.extend(flat.map(|p| format!("normal.{}", p.name)));
    names
}

/// The materials that reflect, of all scenes.
fn materials(sides: &[CurveSide]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for side in sides {
        for material in &side.study.pass().target.materials {
            if !names.contains(&material.name) {
                names.push(material.name.clone());
            }
        }
    }
    names
}

impl Parameters {
    /// Finds what is meant by names.
    pub fn new(
        wanted: &[FreeParameter],
        per_pass: &[String],
        largest_albedo: f64,
        channels: &[String],
        sides: &[CurveSide],
    ) -> Result<Self, PassFitError> {
        let mut all = Self { largest_albedo, ..Self::default() };
        if wanted.is_empty() {
            return Err(PassFitError::NothingFree);
        }
        for name in per_pass {
            if !wanted.iter().any(|w| w.name == *name) {
                return Err(PassFitError::NotFree { name: name.clone() });
            }
        }
        for want in wanted {
            let each = per_pass.contains(&want.name);
            // A curve without a sample says nothing of values of its own: the scene's stand.
            let sampled = |k: &usize| sides[*k].has.contains(&true);
            let curves: Vec<Option<usize>> = match each {
                true => (0..sides.len()).filter(sampled).map(Some).collect(),
                false => vec![None],
            };
            for curve in curves {
                all.add(want, curve, channels, sides)?;
            }
        }
        all.hang_together()?;
        Ok(all)
    }

    /// The two angles of a part's normal.
    fn normal(
        &mut self,
        part: &str,
        want: &FreeParameter,
        sides: &[CurveSide],
    ) -> Result<(), PassFitError> {
        let wrong = |why: String| PassFitError::Normal { part: part.to_owned(), why };
        if want.range.is_some() || want.prior.is_some() {
            let why =
                "a normal is searched for over the whole sphere: it has no range and no prior";
            return Err(wrong(why.into()));
        }
        let target = &sides[0].study.pass().target;
        let (_, _, material) = plate(target, part).map_err(wrong)?;
        let others = target.parts.iter().filter(|p| p.name != part);
        if let Some(other) =
            others.into_iter().find(|p| target.materials[p.material].name == material)
        {
            return Err(wrong(format!(
                "{} is made of {material} too: its light is found beside that of all others, so it needs a material of its own",
                other.name
            )));
        }
        let key = |k: usize| format!("part.{part}.euler_zyx_deg.{k}");
        let angle = |side: &CurveSide, k: usize| side.scene.get(&key(k));
        for side in sides {
            if angle(side, 0).is_none() || angle(side, 2) != Some(0.0) {
                let path = side.scene.path.display();
                return Err(wrong(format!(
                    "the scene must name the part's turn as two angles, azimuth and tilt: euler_zyx_deg = [0, 0, 0] ({path})"
                )));
            }
        }
        let mut angles = [0; 2];
        for (k, (word, low, high)) in
            [("azimuth_deg", -180.0, 180.0), ("tilt_deg", 0.0, 180.0)].into_iter().enumerate()
        {
            let start = angle(&sides[0], k).unwrap_or_default();
            let name = format!("normal.{part}.{word}");
            let wraps = k == 0;
            let start = if wraps { (start + 180.0).rem_euclid(360.0) - 180.0 } else { start };
            if !(low..=high).contains(&start) {
                return Err(PassFitError::Outside { name, start, low, high });
            }
            angles[k] = self.free.len();
            let (step, prior, search) = (STEP * (high - low), None, Search::Everywhere);
            self.free.push(Free { name, start, low, high, step, wraps, prior, search });
            self.roles.push((Role::Key(key(k)), None));
        }
        let material = material.to_owned();
        let (linear, roughness) = (Vec::new(), None);
        let part = part.to_owned();
        self.normals.push(Normal {
            part,
            material,
            angles,
            roughness,
            linear,
            most: f64::INFINITY,
        });
        Ok(())
    }

    /// Finds which other parameters belong to the normals.
    fn hang_together(&mut self) -> Result<(), PassFitError> {
        for normal in &mut self.normals {
            let own = |k: &usize| self.scales[*k].0 == normal.material;
            normal.linear = (0..self.linear.len()).filter(own).collect();
            if normal.linear.is_empty() {
                return Err(PassFitError::Normal {
                    part: normal.part.clone(),
                    why: format!(
                        "how much it reflects must be free, too: --free albedo.{}",
                        normal.material
                    ),
                });
            }
            let most = |k: &usize| {
                self.linear[*k].most.map_or(f64::INFINITY, |m| m / self.linear[*k].unit)
            };
            normal.most = normal.linear.iter().map(most).fold(f64::INFINITY, f64::min);
            let keys = ROUGHNESS.map(|key| format!("material.{}.{key}", normal.material));
            normal.roughness =
                self.roles.iter().enumerate().find_map(|(k, (role, _))| match role {
                    Role::Key(key) if keys.contains(key) => Some((k, key.clone())),
                    _ => None,
                });
        }
        Ok(())
    }

    fn add(
        &mut self,
        want: &FreeParameter,
        curve: Option<usize>,
        channels: &[String],
        sides: &[CurveSide],
    ) -> Result<(), PassFitError> {
        let name = want.name.as_str();
        let unknown = || sides[0].scene.unknown(name, &special(channels, sides));
        let channel = |c: &str| channels.iter().position(|own| own == c);
        let known = materials(sides);
        // Of names with dots in them the longest material's.
        let material = |rest: &str| -> Option<(String, Option<String>)> {
            let fits = |m: &&String| rest == m.as_str() || rest.starts_with(&format!("{m}."));
            let found = known.iter().filter(fits).max_by_key(|m| m.len())?;
            let left = rest.strip_prefix(found.as_str())?.strip_prefix('.');
            Some((found.clone(), left.map(str::to_owned)))
        };
        if let Some(part) = name.strip_prefix("normal.") {
            if curve.is_some() {
                let why =
                    "a body has one normal for all curves: it cannot differ from pass to pass";
                return Err(PassFitError::Normal { part: part.to_owned(), why: why.into() });
            }
            return self.normal(part, want, sides);
        }
        if name == "zero_point" {
            return self.zero_points(want, sides);
        }
        if name == "albedo" {
            for m in &known {
                self.albedos(m, None, curve, channels, sides, want)?;
            }
            return Ok(());
        }
        if let Some(rest) = name.strip_prefix("albedo.") {
            let (material, left) = material(rest).ok_or_else(unknown)?;
            let of = left.map(|c| channel(&c).ok_or_else(unknown)).transpose()?;
            return self.albedos(&material, of, curve, channels, sides, want);
        }
        if let Some(rest) = name.strip_prefix("scale.") {
            let (material, None) = material(rest).ok_or_else(unknown)? else {
                return Err(unknown().into());
            };
            if want.range.is_some() {
                return Err(PassFitError::Solved { name: name.to_owned() });
            }
            let component = self.component(&material);
            self.linear.push(Linear {
                name: per_curve(name, curve),
                component,
                channels: (0..channels.len()).collect(),
                curves: curve.map(|c| vec![c]),
                unit: 1.0,
                most: self.largest_scale(&material, curve, sides),
                prior: want.prior,
            });
            self.scales.push((material, None));
            return Ok(());
        }
        let of_channel = |prefix: &str| name.strip_prefix(prefix).and_then(channel);
        let (role, start, range) = match name {
            "time_offset_s" => (Role::TimeOffset, 0.0, (-5.0, 5.0)),
            "size" => (Role::Size, 1.0, FACTORS),
            "gain" => (Role::Gain, 1.0, (0.3, 3.0)),
            "extinction" => (Role::Extinction(None), 0.0, (-0.5, 2.0)),
            _ => match of_channel("extinction.") {
                Some(c) => (Role::Extinction(Some(c)), 0.0, (-0.5, 2.0)),
                None => {
                    let has = |s: &&CurveSide| s.scene.get(name).is_some();
                    let side = sides.iter().find(has).ok_or_else(unknown)?;
                    let start = side.scene.get(name).ok_or_else(unknown)?;
                    let range = match (want.range, usual_range(name, start)) {
                        (Some(range), _) | (None, Some(range)) => range,
                        (None, None) => {
                            return Err(PassFitError::NoRange { name: name.to_owned(), start });
                        }
                    };
                    (Role::Key(name.to_owned()), start, range)
                }
            },
        };
        let (low, high) = want.range.unwrap_or(range);
        if !(low..=high).contains(&start) {
            return Err(PassFitError::Outside { name: name.to_owned(), start, low, high });
        }
        let turn = is_angle(name) && (high - low - 360.0).abs() < 1e-9;
        self.free.push(Free {
            name: per_curve(name, curve),
            start,
            low,
            high,
            step: STEP * (high - low),
            wraps: turn,
            prior: want.prior,
            search: Search::Everywhere,
        });
        self.roles.push((role, curve));
        Ok(())
    }

    /// Errors of zero points: one for each camera of each curve of magnitudes.
    fn zero_points(
        &mut self,
        want: &FreeParameter,
        sides: &[CurveSide],
    ) -> Result<(), PassFitError> {
        let (low, high) = want.range.unwrap_or(ZERO_POINT_RANGE);
        if !(low..=high).contains(&0.0) {
            return Err(PassFitError::Outside { name: want.name.clone(), start: 0.0, low, high });
        }
        let prior = want.prior.unwrap_or(Prior { mean: 0.0, sigma: ZERO_POINT_SIGMA });
        for (k, side) in sides.iter().enumerate() {
            if !matches!(side.unit, Unit::Band(_)) {
                return Err(PassFitError::NoZeroPoint);
            }
            let camera = |i: usize| side.cameras.and_then(|c| c.get(i)).map_or("", String::as_str);
            let n = side.used.len();
            let own: BTreeSet<&str> = (0..n).filter(|i| side.used[*i]).map(camera).collect();
            for one in own {
                let name = match one {
                    "" => "zero_point".to_owned(),
                    one => format!("zero_point.{one}"),
                };
                let step = STEP * (high - low);
                let name = per_curve(&name, Some(k));
                let prior = Some(prior);
                let (start, search) = (0.0, Search::Near);
                self.free.push(Free { name, start, low, high, step, wraps: false, prior, search });
                let samples = (0..n).map(|i| camera(i) == one).collect();
                self.roles.push((Role::ZeroPoint(samples), Some(k)));
            }
        }
        Ok(())
    }

    /// Factors by which the zero points' errors change the light of a curve's samples.
    pub fn zero_factors(&self, curve: usize, values: &[f64], samples: usize) -> Vec<f64> {
        let own = |(p, (role, of)): (usize, &(Role, Option<usize>))| match role {
            Role::ZeroPoint(samples) if *of == Some(curve) => {
                Some(ZeroPoint { parameter: p, samples: samples.clone() })
            }
            _ => None,
        };
        let all: Vec<ZeroPoint> = self.roles.iter().enumerate().filter_map(own).collect();
        ZeroPoint::factors(&all, values, samples)
    }

    fn component(&mut self, material: &str) -> usize {
        let own = Component { material: material.to_owned(), spectrum: None };
        match self.components.iter().position(|c| *c == own) {
            Some(k) => k,
            None => {
                self.components.push(own);
                self.components.len() - 1
            }
        }
    }

    /// The scale at which a material's largest reflectance is the largest albedo; `None` for one that reflects nothing.
    fn largest_scale(
        &self,
        material: &str,
        curve: Option<usize>,
        sides: &[CurveSide],
    ) -> Option<f64> {
        let own = sides.iter().enumerate().filter(|(k, _)| curve.is_none_or(|own| own == *k));
        let materials = own.flat_map(|(_, s)| &s.study.pass().target.materials);
        let spectra = materials.filter(|m| m.name == material).flat_map(|m| m.spectra());
        let most = spectra.flat_map(|s| s.value().iter().copied()).fold(0.0, f64::max);
        (most > 0.0).then(|| self.largest_albedo / most)
    }

    /// Albedos of a material: one for each channel that was measured, or for one.
    fn albedos(
        &mut self,
        material: &str,
        only: Option<usize>,
        curve: Option<usize>,
        channels: &[String],
        sides: &[CurveSide],
        want: &FreeParameter,
    ) -> Result<(), PassFitError> {
        if want.range.is_some() {
            return Err(PassFitError::Solved { name: want.name.clone() });
        }
        let component = self.component(material);
        for (c, channel) in channels.iter().enumerate() {
            let measured =
                sides.iter().enumerate().any(|(k, s)| curve.is_none_or(|own| own == k) && s.has[c]);
            if only.is_some_and(|own| own != c) || !measured {
                continue;
            }
            let unit = match curve {
                Some(k) => unit_albedo(&sides[k], material, c)?,
                None => match sides.iter().find(|s| s.has[c]) {
                    Some(side) => unit_albedo(side, material, c)?,
                    None => None,
                },
            };
            let word = if unit.is_some() { "albedo" } else { "scale" };
            let name = format!("{word}.{material}.{channel}");
            self.linear.push(Linear {
                name: per_curve(&name, curve),
                component,
                channels: vec![c],
                curves: curve.map(|c| vec![c]),
                unit: unit.unwrap_or(1.0),
                most: match unit {
                    Some(_) => Some(self.largest_albedo),
                    None => self.largest_scale(material, curve, sides),
                },
                prior: want.prior,
            });
            self.scales.push((material.to_owned(), Some(c)));
        }
        Ok(())
    }

    /// The model: the sides' studies with what the parameters make of them.
    pub fn model(&self, sides: Vec<(Scene, Study, Unit)>) -> StudyModel {
        let one = |(k, (scene, study, unit)): (usize, (Scene, Study, Unit))| {
            let own = |p: usize| self.roles[p].1.is_none_or(|c| c == k);
            let mut shaping = Shaping::default();
            let (mut of_attitude, mut of_target) = (Vec::new(), Vec::new());
            for (p, (role, _)) in self.roles.iter().enumerate().filter(|(p, _)| own(*p)) {
                match role {
                    Role::Key(key) if scene.get(key).is_some() => {
                        let list = if key.starts_with("attitude.") {
                            &mut of_attitude
                        } else {
                            &mut of_target
                        };
                        list.push((p, key.clone()));
                    }
                    Role::Key(_) => {}
                    Role::TimeOffset => shaping.time_offset = Some(p),
                    Role::Size => shaping.size = Some(p),
                    Role::Gain => shaping.gain = Some(p),
                    Role::ZeroPoint(samples) => shaping
                        .zero_points
                        .push(ZeroPoint { parameter: p, samples: samples.clone() }),
                    Role::Extinction(c) => shaping
                        .extinction
                        .push(Extinction { parameter: p, channels: c.map(|c| vec![c]) }),
                }
            }
            if !of_attitude.is_empty() {
                shaping.attitude = Some(law(scene.without_target(), of_attitude, Scene::attitude));
            }
            if !of_target.is_empty() {
                shaping.target = Some(law(scene, of_target, Scene::target));
            }
            (study, unit, shaping)
        };
        StudyModel::new(sides.into_iter().enumerate().map(one).collect(), self.components.clone())
    }

    /// The numbers of the scene of a curve that values stand for.
    pub fn keys<'a>(
        &'a self,
        curve: usize,
        values: &'a [f64],
    ) -> impl Iterator<Item = (&'a str, f64)> {
        let roles = self.roles.iter().zip(values);
        roles.filter(move |((_, c), _)| c.is_none_or(|c| c == curve)).filter_map(
            |((role, _), v)| match role {
                Role::Key(key) => Some((key.as_str(), *v)),
                _ => None,
            },
        )
    }

    /// Seconds by which a curve's times are later than the scene's.
    pub fn time_offset_s(&self, curve: usize, values: &[f64]) -> f64 {
        let own = self.roles.iter().zip(values).filter(|((role, c), _)| {
            matches!(role, Role::TimeOffset) && c.is_none_or(|c| c == curve)
        });
        own.map(|(_, v)| *v).sum()
    }

    /// Returns the value of each parameter in the scene: where its search starts, or the value for which its light is as the scene has it.
    pub fn in_the_scene(&self) -> Vec<f64> {
        let searched = self.free.iter().map(|f| f.start);
        searched.chain(self.linear.iter().map(|l| l.unit)).collect()
    }

    /// Puts what is no number of the scene into its `[correction]`. Returns the names of what no key holds.
    pub fn correct(
        &self,
        curve: usize,
        values: &[f64],
        channels: &[String],
        magnitudes: bool,
        scene: &mut Scene,
    ) -> Vec<String> {
        let mut beyond = Vec::new();
        let all = self.roles.iter().zip(&self.free).zip(values);
        for (((role, _), free), value) in
            all.filter(|(((_, c), _), _)| c.is_none_or(|c| c == curve))
        {
            match role {
                Role::Key(_) => {}
                Role::TimeOffset => scene.correct(&["time_offset_s"], 0.0, &|t| t + value),
                Role::Size => scene.correct(&["size"], 1.0, &|f| f * value),
                Role::Gain => scene.correct(&["gain"], 1.0, &|f| f * value),
                Role::ZeroPoint(_) => beyond.push(free.name.clone()),
                Role::Extinction(_) if magnitudes => beyond.push(free.name.clone()),
                Role::Extinction(None) => scene.correct(&["extinction"], 0.0, &|k| k + value),
                Role::Extinction(Some(c)) => {
                    let keys = ["extinction_by_channel", channels[*c].as_str()];
                    scene.correct(&keys, 0.0, &|k| k + value);
                }
            }
        }
        beyond
    }

    /// Whether a curve has values of its own.
    pub fn differ(&self) -> bool {
        let searched = self.roles.iter().any(|(_, curve)| curve.is_some());
        searched || self.linear.iter().any(|l| l.curves.is_some())
    }
}

fn per_curve(name: &str, curve: Option<usize>) -> String {
    curve.map_or_else(|| name.to_owned(), |k| format!("{name}@{}", k + 1))
}

fn law<T: 'static>(
    scene: Scene,
    keys: Vec<(usize, String)>,
    make: fn(&Scene) -> Result<T, String>,
) -> Law<T> {
    Law {
        uses: keys.iter().map(|(p, _)| *p).collect(),
        make: Box::new(move |values: &[f64]| {
            let mut scene = scene.clone();
            for (p, key) in &keys {
                scene.set(key, values[*p]);
            }
            make(&scene)
        }),
    }
}

fn is_angle(name: &str) -> bool {
    let last = name.rsplit('.').find(|s| s.parse::<usize>().is_err()).unwrap_or(name);
    last.ends_with("_deg") || last.ends_with("axis_ra_dec_deg")
}

/// Where a number of the scene is searched for unless somebody says otherwise.
fn usual_range(name: &str, start: f64) -> Option<(f64, f64)> {
    let last = name.rsplit('.').find(|s| s.parse::<usize>().is_err()).unwrap_or(name);
    let factors = |a: f64, b: f64| {
        (start != 0.0).then(|| ((start * a).min(start * b), (start * a).max(start * b)))
    };
    match last {
        "alpha" | "alpha_x" | "alpha_y" | "slope_rms" | "slope_rms_x" | "slope_rms_y" => {
            Some((0.01_f64.min(start), 1.0_f64.max(start)))
        }
        "reflectance" | "share" => Some((0.0, 1.0)),
        "phase_deg" | "axis_ra_deg" | "omega_deg" => Some((start - 180.0, start + 180.0)),
        "axis_dec_deg" => Some((-90.0, 90.0)),
        "pitch_deg" => Some((start - 90.0, start + 90.0)),
        "yaw_deg" | "roll_deg" | "euler_zyx_deg" | "offset_deg" | "parked_deg" => {
            Some((start - 180.0, start + 180.0))
        }
        "period_s" | "rate_rpm" | "rate_deg_s" => factors(0.9, 1.1),
        "offset_m" => Some((start - 1.0, start + 1.0)),
        _ if start > 0.0 => factors(FACTORS.0, FACTORS.1),
        _ => None,
    }
}

/// The band albedo of a material that has one spectrum, through the air at the pass's middle zenith angle; `None` for one with several.
fn unit_albedo(
    side: &CurveSide,
    material: &str,
    channel: usize,
) -> Result<Option<f64>, PassFitError> {
    let pass = side.study.pass();
    let Some(own) = pass.target.materials.iter().find(|m| m.name == material) else {
        return Ok(None);
    };
    let [spectrum] = own.spectra() else { return Ok(None) };
    let Unit::Channels(of) = &side.unit else {
        // Magnitudes in V: of what is grey the albedo is its reflectance, of others the scale is all that is known.
        let (least, most) = (spectrum.value().iter().copied())
            .fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        return Ok((least == most).then_some(least));
    };
    let Some(station) = of[channel] else { return Ok(None) };
    let air = transmission(side.study)?;
    let spectrum = spectrum.relabelled()?;
    Ok(Some(band_mean(side.study, station, air.as_ref(), &spectrum)?).filter(|a| *a > 0.0))
}

/// The air at the middle of a pass's zenith angles.
pub(super) fn transmission(study: &Study) -> Result<Option<Spectrum<Transmission>>, PassFitError> {
    let mut zeniths: Vec<f64> =
        study.places().iter().filter_map(|p| p.apparent_zenith_deg).collect();
    zeniths.sort_by(f64::total_cmp);
    let (Some(air), Some(middle)) = (&study.pass().air, zeniths.get(zeniths.len() / 2)) else {
        return Ok(None);
    };
    Ok(Some(air.spectrum(Zenith::Apparent(*middle), (300.0, 1240.0))?))
}
