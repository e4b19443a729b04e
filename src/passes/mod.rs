//! `sunglint passes`: when satellites can be seen from a station, how bright, and what its channels would count.

mod figure;
mod model;
mod report;
mod seen;
mod table;

pub(crate) use model::target;
pub use seen::{Event, Expected, SeenPass};

use crate::air::{AirModelArgs, implausible};
use crate::output::{Console, OutputArgs, Usage};
use crate::star::when;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::{Epoch, Unit};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use model::Light;
use rayon::prelude::*;
use report::Report;
use seen::Photometer;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::tle::{self, Tle};
use sunglint_ephemeris::orbit::{Orbit, TleOrbit};
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_ephemeris::passes::{Conditions, Search};
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{EarthOrientation, SkyFrames};

/// Arguments of `sunglint passes`.
#[derive(Debug, Args)]
pub struct PassesArgs {
    /// Files of two-line elements, any number of sets in each
    #[arg(long, value_name = "FILE", required = true, num_args = 1..)]
    pub tle: Vec<PathBuf>,
    /// Only the objects with these catalogue numbers
    #[arg(long, value_name = "ID", value_delimiter = ',')]
    pub norad: Vec<String>,
    /// Only the objects whose name contains this, case ignored
    #[arg(long, value_name = "NAME")]
    pub name: Vec<String>,
    /// From when: UTC, ISO 8601, or `now`
    #[arg(long, value_name = "TIME", default_value = "now")]
    pub from: String,
    /// Until when [default: a day after --from]
    #[arg(long, value_name = "TIME")]
    pub to: Option<String>,
    /// What a pass must be.
    #[command(flatten)]
    pub filter: FilterArgs,
    /// How bright.
    #[command(flatten)]
    pub brightness: BrightnessArgs,
    /// Exposure time, s: for the photon noise
    #[arg(long, value_name = "S", default_value_t = 0.1, allow_negative_numbers = true)]
    pub exposure_s: f64,
    /// Magnitude of Vega that V counts from, or `ab`
    #[arg(long, value_name = "ZERO", default_value = "vega=0.03")]
    pub zero_point: ZeroPoint,
    /// Earth orientation to use instead of the embedded table: ECSV with its columns (see `sunglint tables earth_orientation`)
    #[arg(long, value_name = "FILE")]
    pub earth_orientation: Option<PathBuf>,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What a pass must be to be listed.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Which passes")]
pub struct FilterArgs {
    /// The lowest true altitude at which a target counts as up, degrees; the station's horizon may ask for more
    #[arg(long, value_name = "DEG", default_value_t = 10.0, allow_negative_numbers = true)]
    pub min_elevation: f64,
    /// The Sun stands lower than this at the station, degrees
    #[arg(long, value_name = "DEG", default_value_t = -6.0, allow_negative_numbers = true)]
    pub sun_below: f64,
    /// Only passes that reach this altitude while they are visible, degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub min_culmination: f64,
    /// Only passes that are visible for so long, s
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    pub min_duration_s: f64,
    /// Only passes that become at least as bright as this V at the station
    #[arg(long, value_name = "MAG", allow_negative_numbers = true)]
    pub brighter_than: Option<f64>,
    /// List at most so many passes: the brightest, in the order of time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub limit: Option<u32>,
}

/// How bright a target is that nobody has modelled.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "How bright the targets are")]
pub struct BrightnessArgs {
    /// Diameter of a diffuse sphere, m
    #[arg(long, value_name = "M", default_value_t = 1.0, allow_negative_numbers = true)]
    pub diameter_m: f64,
    /// Lambert reflectance of that sphere, 0 to 1
    #[arg(long, value_name = "RHO", default_value_t = 0.2, allow_negative_numbers = true)]
    pub reflectance: f64,
    /// Instead of the sphere: V at 1,000 km, half lit; the brightness goes with the illuminated fraction
    #[arg(
        long,
        value_name = "MAG",
        conflicts_with_all = ["diameter_m", "reflectance"],
        allow_negative_numbers = true
    )]
    pub standard_magnitude: Option<f64>,
    /// Instead of the sphere: a model, a built-in target or a target.toml, whose light is calculated as by `simulate`
    #[arg(
        long,
        value_name = "TARGET",
        conflicts_with_all = ["diameter_m", "reflectance", "standard_magnitude"]
    )]
    pub model: Option<String>,
    /// How the model is turned: orbit (z to nadir, x along the velocity), yaw_steering, sun, inertial, or a file with `[attitude]` [default: orbit]
    #[arg(long, value_name = "LAW|FILE", requires = "model")]
    pub attitude: Option<String>,
    /// What a model's light may err by: of effects that it needs no more is modelled, `1%` or `0.01`
    #[arg(long, value_name = "SHARE", default_value = "1%", requires = "model", allow_negative_numbers = true, value_parser = crate::explain::tolerance)]
    pub tolerance: f64,
}

/// Longer windows are a slip of the year.
const MOST_DAYS: f64 = 40.0;

/// How many stays above the horizon there were, and why they were not seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Objects that were followed.
    pub objects: usize,
    /// Objects that never came up.
    pub never_up: usize,
    /// Objects that were up all the time.
    pub always_up: usize,
    /// Stays above the horizon.
    pub stays: usize,
    /// Of them, those in the Earth's shadow all the time.
    pub in_shadow: usize,
    /// Those under a bright sky all the time.
    pub in_daylight: usize,
    /// Those that were sunlit only while the sky was bright.
    pub lit_by_day: usize,
    /// Visible ones that the filters left out.
    pub filtered: usize,
}

/// What is not an orbit, or ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    /// The object, or the place in a file.
    pub what: String,
    /// Why.
    pub why: String,
}

/// Finds passes.
pub fn run(args: &PassesArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let (from, to) = args.window()?;
    args.filter.check()?;
    let brightness = args.brightness()?;
    if !(1e-9..=86_400.0).contains(&args.exposure_s) {
        bail!("--exposure-s is {:e}, expected 1e-9 to 86400 s", args.exposure_s);
    }
    let station = args.station.get()?;
    let mut inputs: Vec<Input> = station
        .sources
        .iter()
        .map(|(path, sha256)| Input { file: path.display().to_string(), sha256: sha256.clone() })
        .collect();
    let (mut tles, mut failures) = read_all(&args.tle, &mut inputs)?;
    tles = args.chosen(tles, from)?;
    let user_orientation = match &args.earth_orientation {
        None => None,
        Some(path) => {
            let table = sunglint_formats::ecsv::read_str(path, &text_of(path, &mut inputs)?)?;
            Some(EarthOrientation::from_table(&table).with_context(|| path.display().to_string())?)
        }
    };
    let orientation = user_orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded());
    let air = args.model.air(station.site.geodetic().height_m, Some(&station))?;
    let mut warnings = implausible(&air);
    warnings.extend(station.warnings.clone());
    let origin = orientation.at(from)?.origin;
    if origin.is_outside() {
        warnings.push(format!("{origin} (--earth-orientation FILE)"));
    }
    let conditions = Conditions {
        min_altitude_deg: args.filter.min_elevation,
        sun_below_deg: args.filter.sun_below,
    };
    let search = Search::new(&station.site, &station.horizon, (from, to), conditions, orientation)?;
    let any = tles.iter().find_map(|tle| TleOrbit::new(tle.clone()).ok()).map(Orbit::from);
    let model = args.model(any, &station, &air, (from, orientation))?;
    let light = match &model {
        None => Light::Law(brightness),
        Some((pass, words)) => {
            let ready = pass.ready()?;
            warnings.extend(pass.warnings.clone());
            warnings.extend(ready.report().warnings.clone());
            inputs.extend(pass.target.sources.iter().map(|(path, sha256)| Input {
                file: path.display().to_string(),
                sha256: sha256.clone(),
            }));
            Light::Model(Box::new(ready), words.clone())
        }
    };
    let frames = SkyFrames::over(from, to, orientation)?;
    let photometer =
        Photometer::new(&station, &air, light, frames, args.zero_point, args.exposure_s)?;
    console.detail(&format!("{} objects, {} threads", tles.len(), rayon::current_num_threads()));

    let bar = progress(tles.len(), console);
    let followed: Vec<Followed> = tles
        .into_par_iter()
        .map(|tle| {
            let followed = Followed::new(tle, &search, &photometer);
            bar.inc(1);
            followed
        })
        .collect();
    bar.finish_and_clear();

    let mut counts = Counts { objects: followed.len(), ..Counts::default() };
    let mut passes = Vec::new();
    let mut old = Vec::new();
    for one in followed {
        counts.never_up += usize::from(one.counts.stays == 0 && one.failure.is_none());
        counts.always_up += one.counts.always_up;
        counts.stays += one.counts.stays;
        counts.in_shadow += one.counts.in_shadow;
        counts.in_daylight += one.counts.in_daylight;
        counts.lit_by_day += one.counts.lit_by_day;
        failures.extend(one.failure);
        old.extend(one.warnings);
        passes.extend(one.passes);
    }
    if old.len() > 3 {
        let more = format!("… and {} more objects with old elements", old.len() - 3);
        old.truncate(3);
        old.push(more);
    }
    warnings.extend(old);
    let visible = passes.len();
    let mut passes = args.filter.apply(passes);
    counts.filtered = visible - passes.len();
    passes.sort_by(|a, b| {
        a.start.geometry.epoch.cmp(&b.start.geometry.epoch).then(a.norad_id.cmp(&b.norad_id))
    });
    for warning in &warnings {
        console.warn(warning);
    }
    // The text lists them, but where a file is written nobody may see it.
    for failure in failures.iter().take(MOST_WARNED) {
        console.warn(&format!("left out: {}: {}", failure.what, failure.why));
    }
    if let Some(more) = failures.len().checked_sub(MOST_WARNED).filter(|more| *more > 0) {
        console.warn(&format!("… and {more} more objects left out (failures in --json)"));
    }
    let report = Report {
        search: &search,
        station: &station,
        photometer: &photometer,
        passes: &passes,
        counts,
        failures: &failures,
        warnings: &warnings,
        inputs,
        orientation,
    };
    report.finish(&args.out, console)
}

/// More objects left out than this are counted, not named.
const MOST_WARNED: usize = 5;

/// One object after the search.
struct Followed {
    passes: Vec<SeenPass>,
    counts: Counts,
    failure: Option<Failure>,
    warnings: Vec<String>,
}

impl Followed {
    fn new(tle: Tle, search: &Search, photometer: &Photometer<'_>) -> Self {
        let label = tle.label();
        let mut followed = Self {
            passes: Vec::new(),
            counts: Counts::default(),
            failure: None,
            warnings: Vec::new(),
        };
        let failure = |why: String| Some(Failure { what: label.clone(), why });
        let window = search.window();
        let orbit = match TleOrbit::new(tle.clone()) {
            Ok(orbit) => Orbit::from(orbit.near(window.from, window.to)),
            Err(error) => {
                followed.failure = failure(error.to_string());
                return followed;
            }
        };
        followed.warnings = orbit.warnings(window.from, window.to);
        let found = search.passes(&orbit);
        if let Some((_, error)) = found.ended {
            followed.failure = failure(error.to_string());
        }
        let dark = search.dark();
        let counts = &mut followed.counts;
        for pass in found.passes {
            counts.stays += 1;
            counts.always_up += usize::from(!pass.rises && !pass.sets);
            if pass.visible.is_empty() {
                let under_dark =
                    dark.iter().any(|d| d.from < pass.span.to && pass.span.from < d.to);
                match (pass.sunlit.is_empty(), under_dark) {
                    (true, _) => counts.in_shadow += 1,
                    (false, false) => counts.in_daylight += 1,
                    (false, true) => counts.lit_by_day += 1,
                }
                continue;
            }
            match SeenPass::new(&orbit, &tle, pass, search, photometer) {
                Ok(seen) => followed.passes.push(seen),
                Err(error) => followed.failure = failure(error.to_string()),
            }
        }
        followed
    }
}

impl PassesArgs {
    fn window(&self) -> anyhow::Result<(Epoch, Epoch)> {
        let from = when(&self.from).context("--from")?;
        let to = match &self.to {
            Some(to) => when(to).context("--to")?,
            None => from + 1.0 * Unit::Day,
        };
        let days = (to - from).to_unit(Unit::Day);
        if days <= 0.0 {
            bail!(
                "--to must be later than --from: the window from {} is {days} days long",
                self.from
            );
        }
        if days > MOST_DAYS {
            bail!(
                "the window is {days:.1} days long, more than {MOST_DAYS}: elements of today say nothing about then"
            );
        }
        Ok((from, to))
    }

    fn brightness(&self) -> anyhow::Result<Brightness> {
        let BrightnessArgs { diameter_m, reflectance, standard_magnitude, .. } = self.brightness;
        if let Some(magnitude) = standard_magnitude {
            if !(-30.0..=40.0).contains(&magnitude) {
                bail!("--standard-magnitude is {magnitude}, expected -30 to 40");
            }
            return Ok(Brightness::Standard { magnitude });
        }
        if !(diameter_m > 0.0 && diameter_m <= 1e5) {
            bail!("--diameter-m is {diameter_m}, expected more than 0 and at most 100000 m");
        }
        if !(reflectance > 0.0 && reflectance <= 1.0) {
            bail!("--reflectance is {reflectance}, expected more than 0 and at most 1");
        }
        Ok(Brightness::Sphere { diameter_m, reflectance })
    }

    /// The sets of the objects that were asked for, one each: the one whose epoch is nearest to the window's begin.
    fn chosen(&self, tles: Vec<Tle>, from: Epoch) -> anyhow::Result<Vec<Tle>> {
        if tles.is_empty() {
            return Ok(tles);
        }
        let mut numbers = Vec::new();
        for wanted in &self.norad {
            match tle::choose(&tles, Some(wanted), Some(from)) {
                Ok(tle) => numbers.push(tle.norad_id),
                Err(error) => return Err(Usage(format!("--norad: {error}")).into()),
            }
        }
        let lower = |text: &str| text.to_lowercase();
        for wanted in &self.name {
            let has = |t: &Tle| t.name.as_ref().is_some_and(|n| lower(n).contains(&lower(wanted)));
            let before = numbers.len();
            numbers.extend(tles.iter().filter(|t| has(t)).map(|t| t.norad_id));
            if numbers.len() == before {
                let error = tle::choose(&tles, Some(wanted), Some(from)).err();
                let error = error.map_or("no name contains it".into(), |e| e.to_string());
                return Err(Usage(format!("--name {wanted}: {error}")).into());
            }
        }
        let all = self.norad.is_empty() && self.name.is_empty();
        let mut nearest: BTreeMap<u32, Tle> = BTreeMap::new();
        let age = |t: &Tle| (t.epoch - from).abs();
        for tle in tles {
            if !all && !numbers.contains(&tle.norad_id) {
                continue;
            }
            match nearest.get(&tle.norad_id) {
                Some(known) if age(known) <= age(&tle) => {}
                _ => {
                    nearest.insert(tle.norad_id, tle);
                }
            }
        }
        Ok(nearest.into_values().collect())
    }
}

impl FilterArgs {
    /// Numbers; the altitudes of the search are its own concern.
    fn check(&self) -> anyhow::Result<()> {
        for (option, value) in [
            ("--min-culmination", self.min_culmination),
            ("--min-duration-s", self.min_duration_s),
            ("--brighter-than", self.brighter_than.unwrap_or(0.0)),
        ] {
            if !value.is_finite() {
                bail!("{option} is {value}, expected a number");
            }
        }
        Ok(())
    }

    fn apply(&self, mut passes: Vec<SeenPass>) -> Vec<SeenPass> {
        passes.retain(|p| {
            p.highest_visible_deg() >= self.min_culmination
                && p.visible_s() >= self.min_duration_s
                && self
                    .brighter_than
                    .is_none_or(|limit| p.expected.v_station.is_some_and(|v| v <= limit))
        });
        if let Some(limit) = self.limit {
            // Equal magnitudes keep the order of objects and time: the result does not depend on threads.
            passes.sort_by(|a, b| a.brightest.v_mag.total_cmp(&b.brightest.v_mag));
            passes.truncate(limit as usize);
        }
        passes
    }
}

fn text_of(path: &Path, inputs: &mut Vec<Input>) -> anyhow::Result<String> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    inputs.push(Input { file: path.display().to_string(), sha256 });
    Ok(sunglint_formats::read::decode(path, bytes)?)
}

/// The sets of all files; sets that are none become failures, and files without a single good set are refused.
fn read_all(
    paths: &[PathBuf],
    inputs: &mut Vec<Input>,
) -> anyhow::Result<(Vec<Tle>, Vec<Failure>)> {
    let (mut tles, mut failures) = (Vec::new(), Vec::new());
    for path in paths {
        let (good, mut bad) = tle::parse_lenient(path, &text_of(path, inputs)?);
        if good.is_empty() && !bad.is_empty() {
            return Err(bad.swap_remove(0).into());
        }
        tles.extend(good);
        failures.extend(bad.into_iter().map(|error| Failure {
            what: match error.line {
                Some(line) => format!("{}:{line}", path.display()),
                None => path.display().to_string(),
            },
            why: error.to_string(),
        }));
    }
    Ok((tles, failures))
}

/// A bar on stderr for what takes long; none when that is no terminal, none with `-q`.
fn progress(objects: usize, console: Console) -> ProgressBar {
    let hidden = console.quiet || objects < 50;
    // Standard error's own target is hidden where it is no terminal.
    let target = if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(objects as u64), target);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} objects, {eta} left");
    // A template that does not parse would only leave the plain bar.
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}
