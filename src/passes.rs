//! `sunglint passes`: when satellites can be seen from a station, how bright, and what its channels would count.

use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::star::when;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::{Epoch, Unit};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_ephemeris::orbit::elements;
use sunglint_ephemeris::orbit::tle::{self, ObjectsError, Tle};
use sunglint_ephemeris::orbit::{Orbit, TleOrbit};
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_ephemeris::passes::{Conditions, Search};
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::nearest_names;
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_observatory::planner::{
    NightPlan, PassOffer, PlannerOptions, Surroundings, plan_night,
};
use sunglint_observatory::{Catalogue, Plan, Preflight, PreflightOptions, preflight};
use sunglint_page::{PlanCurve, PlanDesk, PlanPass, PlanPoint, PlanRate, PlanSurroundings};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{EarthOrientation, SkyFrames};
use sunglint_radiometry::station::{Detector, Predicted};
use sunglint_report::passes::PassesReport;
use sunglint_report::preflight::{plan_text, text as preflight_text};
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::sightings::{
    Model, Photometer, SeenPass, SightingFilter, SightingLight, find, read_sets,
};
use sunglint_simulator::target::Target;

/// Arguments of `sunglint passes`.
#[derive(Debug, Args)]
pub struct PassesArgs {
    /// Files of elements, any number of sets in each: two lines, or OMM in JSON, CSV, XML or KVN
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
    /// Conditions on a pass.
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
    /// Known properties of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// A plan for `observe`.
    #[command(flatten)]
    pub night: NightArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Visits of a plan besides the passes.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "A plan for observe (-o NIGHT.toml)")]
pub struct NightArgs {
    /// The instruments: a NIGHT.toml without times and visits, beside which the plan is written; its station is taken
    #[arg(long, value_name = "DEVICES.toml", conflicts_with = "station")]
    pub devices: Option<PathBuf>,
    /// Visits to stars to calibrate by, as near to the passes as can be
    #[arg(long, value_name = "N", default_value_t = 6, requires = "devices", value_parser = clap::value_parser!(u32).range(0..=200))]
    pub stars: u32,
    /// Length of a visit to a star with one filter, s
    #[arg(long, value_name = "S", default_value_t = 60.0, requires = "devices")]
    pub star_s: f64,
    /// Length of the sky beside each star, s
    #[arg(long, value_name = "S", default_value_t = 20.0, requires = "devices")]
    pub sky_s: f64,
    /// Time from one place of the sky to another, s [default: the longest way of the `[mount]`; 30
    /// without one]
    #[arg(long, value_name = "S", requires = "devices")]
    pub slew_s: Option<f64>,
    /// Length of the dark frames at each end, s
    #[arg(long, value_name = "S", default_value_t = 60.0, requires = "devices")]
    pub dark_s: f64,
    /// Johnson V of the stars: brightest and faintest
    #[arg(
        long,
        value_name = "MIN,MAX",
        default_value = "0,6",
        requires = "devices",
        allow_hyphen_values = true
    )]
    pub star_mag: String,
    /// The most air to a star
    #[arg(long, value_name = "AIRMASS", default_value_t = 2.5, requires = "devices")]
    pub max_airmass: f64,
    /// Width of a star's image at half of its height, arcsec: for what saturates
    #[arg(long, value_name = "ARCSEC", default_value_t = 2.5, requires = "devices")]
    pub seeing_arcsec: f64,
    /// Plan by hand in a browser: pick passes and stars on the sky, order them, save -o NIGHT.toml; prints the address [default: 127.0.0.1 and the first free port from 8650 on]
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "", requires = "devices")]
    pub page: Option<String>,
    /// With --page: print the address and open no browser
    #[arg(long, requires = "page")]
    pub no_open: bool,
    /// Flats in the evening's twilight, made to reach this median, ADU
    #[arg(long, value_name = "ADU", requires = "devices")]
    pub flats: Option<f64>,
}

/// Conditions that a pass must meet to be listed.
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
    /// How the model is turned: orbit (z to nadir, x along the velocity), yaw_steering, or a file with `[attitude]` [default: orbit]
    #[arg(long, value_name = "LAW|FILE", requires = "model")]
    pub attitude: Option<String>,
    /// Error allowed in a model's light, for which no more effects are modelled than needed, `1%` or `0.01`
    #[arg(long, value_name = "SHARE", default_value = "1%", requires = "model", allow_negative_numbers = true, value_parser = crate::explain::tolerance)]
    pub tolerance: f64,
}

/// Longer windows are a slip of the year.
const MOST_DAYS: f64 = 40.0;

/// Finds passes.
pub fn run(args: &PassesArgs, console: Console) -> anyhow::Result<()> {
    let (out, plans) = args.out.parted(is_plan);
    out.check()?;
    plans.check_targets(plans.output.iter().map(PathBuf::as_path))?;
    let (from, to) = args.window()?;
    args.filter.check()?;
    let brightness = args.brightness()?;
    if !(1e-9..=86_400.0).contains(&args.exposure_s) {
        bail!("--exposure-s is {:e}, expected 1e-9 to 86400 s", args.exposure_s);
    }
    let devices = args.devices()?;
    let station = match &devices {
        Some((plan, _)) => plan.station.clone(),
        None => args.station.get()?,
    };
    let mut inputs: Vec<Input> = station
        .sources
        .iter()
        .map(|(path, sha256)| Input { file: path.display().to_string(), sha256: sha256.clone() })
        .collect();
    let sets = read_sets(&args.tle)?;
    inputs.extend(sets.inputs);
    let mut failures = sets.failures;
    let tles = tle::of_objects(sets.good, &args.norad, &args.name, from).map_err(asked)?;
    let user_orientation = match &args.earth_orientation {
        None => None,
        Some(path) => {
            let table = sunglint_formats::ecsv::read_str(path, &text_of(path, &mut inputs)?)?;
            Some(EarthOrientation::from_table(&table).with_context(|| path.display().to_string())?)
        }
    };
    let orientation = user_orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded());
    let air = args.model.air(station.site.geodetic().height_m, Some(&station))?;
    let mut warnings = air.implausible();
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
    let model = match any {
        None => None,
        Some(orbit) => args.model()?.map(|model| {
            let words = model.words();
            let (when, seen) = ((from, orientation), (args.zero_point, args.exposure_s));
            (model.pass(orbit, &station, &air, when, seen), words)
        }),
    };
    let bar = Bar::new(console);
    let light = match &model {
        None => SightingLight::Law(brightness),
        Some((pass, words)) => {
            bar.begin("the model's light", None);
            let ready = pass.ready()?;
            warnings.extend(pass.warnings.clone());
            warnings.extend(ready.report().warnings.clone());
            inputs.extend(pass.target.sources.iter().map(|(path, sha256)| Input {
                file: path.display().to_string(),
                sha256: sha256.clone(),
            }));
            SightingLight::Model(Box::new(ready), words.clone())
        }
    };
    let frames = SkyFrames::over(from, to, orientation)?;
    let photometer =
        Photometer::new(&station, &air, light, frames, args.zero_point, args.exposure_s)?;
    bar.end();
    console.detail(&format!("{} objects, {} threads", tles.len(), rayon::current_num_threads()));

    let found = find(tles, &search, &photometer, &args.filter.options(), &bar)?;
    bar.end();
    failures.extend(found.failures);
    warnings.extend(found.warnings);
    for warning in &warnings {
        console.warn(warning);
    }
    // The text lists them, but where a file is written nobody may see it.
    for failure in failures.iter().take(MOST_WARNED) {
        // Errors of orbits begin with the object's name.
        let why = failure.why.strip_prefix(&format!("{}: ", failure.what)).unwrap_or(&failure.why);
        console.warn(&format!("left out: {}: {why}", failure.what));
    }
    if let Some(more) = failures.len().checked_sub(MOST_WARNED).filter(|more| *more > 0) {
        console.warn(&format!("… and {more} more objects left out (failures in --json)"));
    }
    if let (Some(address), Some((plan, text))) = (&args.night.page, &devices) {
        let around = Around { plan, search: &search, air: &air, orientation };
        let files = (text.as_str(), &plans);
        let desk = args.desk(&found.passes, around, &photometer, files, warnings, &bar)?;
        bar.end();
        let address = crate::page::address_of(address)?;
        return crate::page::serve(
            address,
            Arc::new(desk),
            "sees and changes the plan",
            !args.night.no_open,
            console,
        );
    }
    let planned = match &devices {
        None => None,
        Some((plan, text)) => {
            let around = Around { plan, search: &search, air: &air, orientation };
            let files = (text.as_str(), &plans);
            let planned = args.plan(&found.passes, around, &photometer, files, console)?;
            Some(planned)
        }
    };
    let report = PassesReport {
        search: &search,
        station: &station,
        photometer: &photometer,
        passes: &found.passes,
        counts: found.counts,
        failures: &failures,
        warnings: &warnings,
        inputs,
        orientation,
    };
    finish(&report, planned.as_ref(), &out, console)
}

/// The error with the option that it is about.
fn asked(error: ObjectsError) -> Usage {
    match error {
        ObjectsError::Number(error) => Usage(format!("--norad: {error}")),
        error @ ObjectsError::Name { .. } => Usage(format!("--name {error}")),
    }
}

/// Writes and prints it. The sky plot is no figure of panels: its files are written beside the product's, all or none.
fn finish(
    report: &PassesReport<'_>,
    planned: Option<&Planned>,
    out: &OutputArgs,
    console: Console,
) -> anyhow::Result<()> {
    let is_picture = |p: &PathBuf| {
        p.extension().is_some_and(|e| {
            let e = e.to_string_lossy().to_ascii_lowercase();
            e == "png" || e == "svg"
        })
    };
    let is_folder = |p: &PathBuf| p.is_dir() || p.as_os_str().to_string_lossy().ends_with('/');
    let mut pictures: Vec<PathBuf> =
        out.output.iter().filter(|p| is_picture(p) && !is_folder(p)).cloned().collect();
    let rest = OutputArgs {
        output: out.output.iter().filter(|p| !is_picture(p) || is_folder(p)).cloned().collect(),
        force: out.force,
    };
    if !report.passes.is_empty() {
        for folder in out.output.iter().filter(|p| is_folder(p)) {
            pictures.extend(["png", "svg"].map(|e| folder.join(format!("passes.{e}"))));
        }
    }
    let mut others = Vec::new();
    if !pictures.is_empty() {
        if report.passes.is_empty() {
            console.warn("no visible pass: the sky plot shows the empty sky");
        }
        let plot = report.sky_plot();
        for path in pictures {
            let svg = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg"));
            let bytes = if svg { plot.svg()?.into_bytes() } else { plot.png()? };
            others.push((path, bytes));
        }
    }
    let mut product = report.product(out.wants_json(console) || planned.is_some());
    let mut text = report.text();
    if let Some(planned) = planned {
        if let Some(result) = product.json.as_object_mut() {
            result.insert("plan".into(), planned.json()?);
        }
        text = format!("{}\n\n{}", text.trim_end(), planned.text());
    }
    rest.finish_with(&product, others, &text, console)
}

fn is_plan(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

/// A plan that was written: its files, and whether such a night can be.
struct Planned {
    files: Vec<PathBuf>,
    night: NightPlan,
    check: Preflight,
}

impl Planned {
    fn json(&self) -> anyhow::Result<serde_json::Value> {
        let mut json = serde_json::to_value(&self.night)?;
        if let Some(plan) = json.as_object_mut() {
            let files = self.files.iter().map(|path| path.display().to_string());
            plan.insert("files".into(), files.collect());
            plan.insert("check".into(), serde_json::to_value(&self.check)?);
        }
        Ok(json)
    }

    fn text(&self) -> String {
        let files: Vec<String> = self.files.iter().map(|path| path.display().to_string()).collect();
        let (plan, check) = (plan_text(&self.night), preflight_text(&self.check));
        format!(
            "plan: {}\n\n{plan}\ncheck of the plan, without its devices:\n{check}",
            files.join(", ")
        )
    }
}

/// Where and how a plan is made.
struct Around<'a> {
    plan: &'a Plan,
    search: &'a Search,
    air: &'a Air,
    orientation: &'a EarthOrientation,
}

/// More objects left out than this are counted, not named.
const MOST_WARNED: usize = 5;

impl PassesArgs {
    /// The plan of the instruments, and its text; with a place for what is made of it.
    fn devices(&self) -> anyhow::Result<Option<(Plan, String)>> {
        let plans = self.out.parted(is_plan).1.output;
        let Some(devices) = &self.night.devices else {
            return match plans.first() {
                None => Ok(None),
                Some(path) => {
                    let path = path.display();
                    Err(Usage(format!(
                        "-o {path}: a plan needs its instruments: give --devices DEVICES.toml"
                    ))
                    .into())
                }
            };
        };
        let [output] = &plans[..] else {
            return Err(
                Usage("--devices goes with one -o NIGHT.toml, which is written".into()).into()
            );
        };
        let folder = |path: &Path| {
            let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
            std::fs::canonicalize(parent.unwrap_or(Path::new("."))).ok()
        };
        if folder(output) != folder(devices) {
            bail!(
                "{}: the plan is written beside {}, whose paths it keeps",
                output.display(),
                devices.display()
            );
        }
        let text = sunglint_formats::read::text(devices)?;
        if let Ok(table) = text.parse::<toml::Table>() {
            let own = ["from", "to", "for_s", "visit", "virtual"];
            if let Some(key) = own.into_iter().find(|key| table.contains_key(*key)) {
                bail!("{}: expected no `{key}`: it comes with the plan", devices.display());
            }
        }
        Ok(Some((Plan::read(devices)?, text)))
    }

    /// A desk at which a person plans with these passes.
    fn desk(
        &self,
        passes: &[SeenPass],
        around: Around<'_>,
        photometer: &Photometer<'_>,
        (devices, plans): (&str, &OutputArgs),
        warnings: Vec<String>,
        progress: &dyn Progress,
    ) -> anyhow::Result<PlanDesk> {
        let path = plans.output.first().cloned().unwrap_or_default();
        let dark = around.search.dark().iter().map(|span| (span.from, span.to)).collect();
        // A model takes its time for each point: all cores, and a bar.
        progress.begin("the passes' light", Some(passes.len() as u64));
        let one = |pass: &SeenPass| {
            if progress.is_cancelled() {
                return Err(Cancelled);
            }
            let found = shown(pass, &around, photometer);
            progress.advance(1);
            Ok(found)
        };
        let shown = passes.par_iter().map(one).collect::<Result<Vec<_>, Cancelled>>()?;
        let shown = shown.into_iter().flatten().collect();
        let sets = flown(passes);
        let beside = elements_file(&path, &sets);
        // Said now, not when the night is planned.
        plans.check_targets([beside.as_path()])?;
        let surroundings = PlanSurroundings {
            devices: around.plan.clone(),
            text: devices.to_owned(),
            air: around.air.clone(),
            orientation: around.orientation.clone(),
            zero: self.zero_point,
            dark,
            options: self.night.options()?,
            elements: (beside, elements::text(sets)),
            path,
            overwrite: if plans.force { Overwrite::Allow } else { Overwrite::Refuse },
            program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).to_owned(),
            warnings,
        };
        PlanDesk::new(shown, surroundings)
            .context("no dark hour between --from and --to: there is no night to plan")
    }

    /// A plan for these passes, and the file of their elements.
    fn plan(
        &self,
        passes: &[SeenPass],
        around: Around<'_>,
        photometer: &Photometer<'_>,
        (devices, plans): (&str, &OutputArgs),
        console: Console,
    ) -> anyhow::Result<Planned> {
        let path = plans.output.first().cloned().unwrap_or_default();
        let sets = flown(passes);
        let file = elements_file(&path, &sets);
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let offers = passes.iter().filter_map(|pass| offer(pass, photometer));
        let offers: Vec<PassOffer> = offers.collect();
        let dark: Vec<(Epoch, Epoch)> =
            around.search.dark().iter().map(|span| (span.from, span.to)).collect();
        let surroundings = Surroundings {
            devices: around.plan,
            air: around.air,
            orientation: around.orientation,
            zero: self.zero_point,
            dark: &dark,
            elements: &name,
        };
        let night = plan_night(&offers, surroundings, &self.night.options()?)?;
        for warning in &night.warnings {
            console.warn(warning);
        }
        let files = [
            (file, elements::text(sets).into_bytes()),
            (path.clone(), night.toml(devices).into_bytes()),
        ];
        // As `observe` will, but without its devices, which may be elsewhere. Nothing is handed over that it could not read.
        let text = String::from_utf8_lossy(&files[1].1).into_owned();
        let plan = Plan::of_text(&path, &text, &files[..1])
            .context("the plan that was made cannot be read, and is not written")?;
        let files = plans.write_files(&files, console)?;
        let mut options = PreflightOptions::default();
        options.open_devices = false;
        options.now = options.now.min(plan.from);
        let check = preflight(&plan, &Catalogue::of(&plan), &options);
        Ok(Planned { files, night, check })
    }

    /// The body whose light is calculated, where one was asked for.
    fn model(&self) -> anyhow::Result<Option<Model>> {
        let Some(model) = &self.brightness.model else { return Ok(None) };
        let law = self.brightness.attitude.as_deref().unwrap_or("orbit");
        Ok(Some(Model {
            target: target(model)?,
            attitude: attitude(law)?,
            attitude_name: law.to_owned(),
            tolerance: self.brightness.tolerance,
        }))
    }

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
}

/// The file beside a plan that holds its elements: two lines where they can be written so, else OMM.
fn elements_file(plan: &Path, sets: &[&Tle]) -> PathBuf {
    let two_lines = sets.iter().all(|set| set.lines().is_some());
    plan.with_extension(if two_lines { "tle" } else { "omm" })
}

/// The elements of the objects that pass, each once.
fn flown(passes: &[SeenPass]) -> Vec<&Tle> {
    let mut told = BTreeSet::new();
    let mut sets = Vec::new();
    for pass in passes {
        if let Orbit::Tle(orbit) = &pass.orbit
            && told.insert(orbit.tle().norad_id)
        {
            sets.push(orbit.tle());
        }
    }
    sets
}

/// Steps of a pass's course on the page.
const STEPS: u32 = 60;
/// Time over which the speed on the sky is taken, s.
const SPEED_S: f64 = 1.0;

/// A pass as the page shows it, with its light along its course; none of an object without elements.
fn shown(pass: &SeenPass, around: &Around<'_>, photometer: &Photometer<'_>) -> Option<PlanPass> {
    let (search, span) = (around.search, pass.pass.span);
    let speed = |at: Epoch| {
        let [before, after] = [-0.5, 0.5].map(|half| {
            search.look(&pass.orbit, at + half * SPEED_S * Unit::Second).map(|seen| seen.horizontal)
        });
        Some(before.ok()?.separation_deg(after.ok()?) / SPEED_S)
    };
    let mut curves: Vec<PlanCurve> = Vec::new();
    for channel in &around.plan.station.channels {
        let camera = matches!(channel.detector, Detector::CameraPlane(_));
        curves.push(PlanCurve {
            channel: channel.name.clone(),
            unit: if camera { "ADU/s" } else { "Hz" },
            arriving: Vec::new(),
            counted_hz: Vec::new(),
            saturated: Vec::new(),
        });
    }
    let mut track = Vec::new();
    for i in 0..=STEPS {
        let at = span.from + span.seconds() * f64::from(i) / f64::from(STEPS) * Unit::Second;
        let Ok(seen) = search.look(&pass.orbit, at) else { continue };
        let h = seen.horizontal;
        let comes = seen.lit_rad > 0.0 && h.altitude_deg() > 0.0;
        let light = comes.then(|| photometer.at(&pass.orbit, at).ok()).flatten();
        track.push(PlanPoint {
            at,
            at_deg: [h.azimuth_deg(), h.altitude_deg()].into(),
            lit: seen.lit_rad > 0.0,
            dark: search.dark().iter().any(|d| d.from <= at && at <= d.to),
            speed_deg_per_s: speed(at),
            v_mag: light.as_ref().and_then(|light| light.v_station),
        });
        for (k, curve) in curves.iter_mut().enumerate() {
            let expected = light.as_ref().and_then(|light| light.channels.get(k)?.as_ref());
            let predicted = expected.map(|(_, predicted)| predicted);
            curve.arriving.push(predicted.and_then(|p| p.arriving));
            curve.counted_hz.push(predicted.and_then(|p| p.counted_hz));
            curve.saturated.push(predicted.is_some_and(|p| p.saturated));
        }
    }
    let rate = |(curve, expected): (&PlanCurve, &Option<(f64, Predicted)>)| {
        let (_, predicted) = expected.as_ref()?;
        Some(PlanRate {
            channel: curve.channel.clone(),
            unit: curve.unit,
            arriving: predicted.arriving,
            counted_hz: predicted.counted_hz,
            saturated: predicted.saturated,
        })
    };
    let rates = curves.iter().zip(&pass.expected.channels).filter_map(rate).collect();
    Some(PlanPass { offer: offer(pass, photometer)?, track, rates, curves })
}

/// A pass for the plan: its first stretch in the light; none of an object without elements. A model's brightest moment is often a glint, by which no standard magnitude is told.
fn offer(pass: &SeenPass, photometer: &Photometer<'_>) -> Option<PassOffer> {
    let span = pass.pass.visible.first()?;
    Some(PassOffer {
        label: pass.target.clone(),
        norad_id: pass.norad_id,
        span: (span.from, span.to),
        v_mag: pass.expected.v_station.unwrap_or(pass.brightest.v_mag),
        standard_magnitude: (!photometer.is_model())
            .then(|| pass.brightest.standard_magnitude())
            .flatten(),
        highest_deg: pass.highest_visible_deg(),
    })
}

impl NightArgs {
    fn options(&self) -> anyhow::Result<PlannerOptions> {
        for (option, value, [least, most]) in [
            ("--star-s", self.star_s, [1.0, 7200.0]),
            ("--sky-s", self.sky_s, [0.0, 7200.0]),
            ("--slew-s", self.slew_s.unwrap_or(0.0), [0.0, 3600.0]),
            ("--dark-s", self.dark_s, [0.0, 7200.0]),
            ("--max-airmass", self.max_airmass, [1.05, 10.0]),
            ("--seeing-arcsec", self.seeing_arcsec, [0.1, 60.0]),
            ("--flats", self.flats.unwrap_or(1.0), [1.0, 1e6]),
        ] {
            if !(least..=most).contains(&value) {
                bail!("{option} is {value}, expected {least} to {most}");
            }
        }
        let numbers: Option<Vec<f64>> =
            self.star_mag.split(',').map(|part| part.trim().parse().ok()).collect();
        let star_mag = match numbers.as_deref() {
            Some([least, most]) if least < most => [*least, *most],
            _ => bail!("--star-mag is {}, expected BRIGHTEST,FAINTEST such as 0,6", self.star_mag),
        };
        let mut options = PlannerOptions::default();
        options.stars = self.stars as usize;
        options.star_s = self.star_s;
        options.sky_s = self.sky_s;
        options.slew_s = self.slew_s;
        options.dark_s = self.dark_s;
        options.star_mag = star_mag.into();
        options.airmass = self.max_airmass;
        options.seeing_arcsec = self.seeing_arcsec;
        options.flats_adu = self.flats;
        Ok(options)
    }
}

impl FilterArgs {
    fn options(&self) -> SightingFilter {
        SightingFilter {
            min_culmination_deg: self.min_culmination,
            min_duration_s: self.min_duration_s,
            brighter_than: self.brighter_than,
            limit: self.limit.map(|n| n as usize),
        }
    }

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
}

fn text_of(path: &Path, inputs: &mut Vec<Input>) -> anyhow::Result<String> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    inputs.push(Input { file: path.display().to_string(), sha256 });
    Ok(sunglint_formats::read::decode(path, bytes)?)
}

/// A built-in target, or one of a file.
pub(crate) fn target(model: &str) -> anyhow::Result<Target> {
    if let Some(target) = Target::built_in(model) {
        return Ok(target);
    }
    let path = Path::new(model);
    if path.exists() {
        return Ok(Target::read(path)?);
    }
    let names = Target::built_in_names();
    let near = nearest_names(model, names.iter().copied(), 1);
    let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
    bail!(
        "--model: there is no target `{model}`: it is neither a built-in name ({}) nor a file{hint}",
        names.join(", ")
    )
}

/// A law by its name, or one of a file.
fn attitude(law: &str) -> anyhow::Result<Attitude> {
    const ALONE: [&str; 2] = ["orbit", "yaw_steering"];
    let path = Path::new(law);
    if path.exists() {
        return Attitude::read(path).context("--attitude");
    }
    if !ALONE.contains(&law) {
        let near = nearest_names(law, ALONE, 1);
        let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
        bail!(
            "--attitude: there is no law and no file `{law}`: laws that need nothing else are {}; a file with [attitude] has all others (docs/pass.md){hint}",
            ALONE.join(", ")
        );
    }
    Attitude::named(law).context("--attitude: give it in a file with [attitude]")
}
