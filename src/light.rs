//! `sunglint light`: the light of a body for directions that are given.

use crate::explain;
use crate::output::{Console, Made, OutputArgs, Target, Usage, clean_up_on_signals};
use crate::picture::direction;
use crate::progress::Bar;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::fs::File;
use std::io::{BufRead as _, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use sunglint_numerics::progress::Progress as _;
use sunglint_report::intensity::{IntensityReport, header, row};
use sunglint_simulator::intensity::rows::Rows;
use sunglint_simulator::intensity::{Aspect, Intensities, IntensityOptions, Span};
use sunglint_simulator::light::engine::Switch;

/// Rows that are evaluated together.
const TOGETHER: usize = 4096;

/// An effect that can be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Effect {
    /// The size of the Sun's disc
    SolarDisc,
    /// Light that is reflected more than once
    InterReflection,
    /// Light from the Earth
    Earthshine,
    /// That the lines of sight to a body's parts are not parallel
    FiniteDistance,
}

/// Variable to differentiate by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum By {
    /// The logarithm of each material's albedo
    Albedo,
}

/// Arguments of `sunglint light`.
#[derive(Debug, Args)]
pub struct LightArgs {
    /// The target: a built-in name or a target.toml
    pub model: String,
    /// Direction to the Sun, body axes
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction, required_unless_present = "table")]
    pub sun: Option<DVec3>,
    /// Direction to the observer, body axes
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction, required_unless_present = "table")]
    pub observer: Option<DVec3>,
    /// Distance of the observer [default: far away]
    #[arg(long, value_name = "KM", allow_negative_numbers = true)]
    pub range_km: Option<f64>,
    /// Distance of the Sun
    #[arg(long, value_name = "AU", default_value_t = 1.0, allow_negative_numbers = true)]
    pub sun_distance_au: f64,
    /// Direction to the middle of the Earth, body axes, for its light [default: no Earth]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction, requires = "height_km")]
    pub earth: Option<DVec3>,
    /// Height above the Earth
    #[arg(long, value_name = "KM", allow_negative_numbers = true, requires = "earth")]
    pub height_km: Option<f64>,
    /// Many geometries in place of one: CSV with sun_x, sun_y, sun_z, observer_x, observer_y, observer_z, and range_km, sun_distance_au, earth_x, earth_y, earth_z, height_km
    /// where wanted. Rows go to stdout or to `-o FILE.csv` as they are found; with --json each is a line
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sun", "observer", "range_km", "earth"])]
    pub table: Option<PathBuf>,
    /// Vacuum wavelengths, separated by commas
    #[arg(
        long,
        value_name = "NM",
        value_delimiter = ',',
        default_value = "550",
        allow_negative_numbers = true
    )]
    pub wavelength_nm: Vec<f64>,
    /// Model what may change the light by more than this: `0.2%` or `0.002` [default: 0.1%]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = explain::tolerance)]
    pub tolerance: Option<f64>,
    /// Work that a geometry's light between surfaces may cost [default: 0.01]
    #[arg(long, value_name = "CPU_S", allow_negative_numbers = true, value_parser = explain::budget)]
    pub budget: Option<f64>,
    /// Effects to leave out, separated by commas; what they could add is in the stated error
    #[arg(long, value_enum, value_delimiter = ',', value_name = "EFFECT")]
    pub without: Vec<Effect>,
    /// Derivatives beside the light, of light that is scattered once
    #[arg(long, value_enum, value_name = "BY")]
    pub derivatives: Option<By>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Evaluates one geometry or a table of them.
pub fn run(args: &LightArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let is_json = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if args.derivatives.is_some() {
        let tables = args.table.is_some() && !console.json;
        if tables || args.out.output.iter().any(|path| !is_json(path)) {
            let text =
                "--derivatives: tables have no columns for them; write .json, or print with --json";
            return Err(Usage(text.into()).into());
        }
    }
    let target = crate::passes::target(&args.model)?;
    for warning in &target.warnings {
        console.warn(warning);
    }
    if let Some(table) = &args.table {
        let mut span = Span::default();
        let mut rows = open(table)?;
        while let Some(aspect) = rows.next() {
            let line = rows.line();
            span.add(&aspect?).with_context(|| format!("{}, line {line}", table.display()))?;
        }
        if span.is_empty() {
            anyhow::bail!("{}: there is no row after the names of the columns", table.display());
        }
        let all = Intensities::new(&target, args.options(), &span)?;
        all.warnings().iter().for_each(|w| console.warn(w));
        return args.rows(table, &all, console);
    }
    let (Some(sun), Some(observer)) = (args.sun, args.observer) else {
        return Err(Usage("give --sun and --observer, or --table FILE".into()).into());
    };
    let aspect = Aspect {
        range_m: args.range_km.map(|km| km * 1e3),
        sun_distance_au: args.sun_distance_au,
        earth: args.earth.zip(args.height_km.map(|km| km * 1e3)),
        ..Aspect::new(sun, observer)
    };
    let mut span = Span::default();
    span.add(&aspect)?;
    let all = Intensities::new(&target, args.options(), &span)?;
    all.warnings().iter().for_each(|w| console.warn(w));
    let light = all.worker().light(&aspect)?;
    let report = IntensityReport { target: &target.name, all: &all, light: &light };
    args.out.finish(&report.product()?, &report.text(), console)
}

/// Rows of a table but for its head; `None` where it cannot be read twice.
fn count(path: &Path) -> Option<u64> {
    if !path.is_file() {
        return None;
    }
    let lines = BufReader::new(File::open(path).ok()?).split(b'\n');
    let lines = lines.map_while(Result::ok).filter(|line| !line.is_empty() && line[0] != b'#');
    (lines.count() as u64).checked_sub(1)
}

fn open(path: &Path) -> anyhow::Result<Rows<BufReader<File>>> {
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(Rows::new(path, BufReader::new(file))?)
}

impl LightArgs {
    fn options(&self) -> IntensityOptions {
        let mut options = IntensityOptions::default();
        options.tolerance = self.tolerance.unwrap_or(options.tolerance);
        options.budget_s = self.budget.unwrap_or(options.budget_s);
        options.wavelength_nm.clone_from(&self.wavelength_nm);
        options.derivatives = self.derivatives.is_some();
        let switches = &mut options.switches;
        for effect in &self.without {
            match effect {
                Effect::SolarDisc => switches.solar_disc = Switch::Off,
                Effect::InterReflection => switches.inter_reflection = Switch::Off,
                Effect::Earthshine => switches.earthshine = Switch::Off,
                Effect::FiniteDistance => switches.finite_distance = Switch::Off,
            }
        }
        options
    }

    /// Writes the rows of a table as they are found.
    fn rows(&self, table: &Path, all: &Intensities, console: Console) -> anyhow::Result<()> {
        let [path] = &self.out.output[..] else {
            if self.out.output.is_empty() {
                return self.stream(table, all, console, std::io::stdout().lock());
            }
            return Err(Usage("--table: one -o at most".into()).into());
        };
        if path.as_os_str() == "-" {
            return self.stream(table, all, console, std::io::stdout().lock());
        }
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
            let text = format!("-o {}: rows of --table are written as .csv", path.display());
            return Err(Usage(text).into());
        }
        // Under another name until all is there.
        clean_up_on_signals()?;
        let mut made = Made::default();
        let mut file = self.out.begin(&Target::File(path.clone()), &mut made)?;
        self.stream(table, all, console, &mut file)?;
        file.finish()
    }

    fn stream(
        &self,
        table: &Path,
        all: &Intensities,
        console: Console,
        out: impl Write,
    ) -> anyhow::Result<()> {
        let mut out = BufWriter::new(out);
        if !console.json {
            out.write_all(header(all).as_bytes())?;
        }
        let mut rows = open(table)?;
        let (mut done, mut met) = (0_usize, 0_usize);
        let bar = Bar::new(console);
        bar.begin("geometries", count(table));
        loop {
            let chunk = rows.by_ref().take(TOGETHER).collect::<Result<Vec<Aspect>, _>>()?;
            if chunk.is_empty() {
                break;
            }
            let mut text = String::new();
            for light in all.many(&chunk)? {
                done += 1;
                met += usize::from(light.met);
                if console.json {
                    text.push_str(&serde_json::to_string(&light)?);
                    text.push('\n');
                } else {
                    row(&light, &mut text);
                }
            }
            out.write_all(text.as_bytes())?;
            bar.advance(chunk.len() as u64);
        }
        bar.end();
        out.flush()?;
        if met < done {
            console.warn(&format!(
                "{met} of {done} rows are within the tolerance; the others say what limits them (limited_by)"
            ));
        }
        Ok(())
    }
}
