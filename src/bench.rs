//! `sunglint bench`: error against time of the light engines, on one thread.

mod cases;
mod report;
mod timing;

use crate::output::{Console, OutputArgs, Usage};
use crate::station::StationArgs;
use anyhow::Context as _;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use report::Report;
use std::path::PathBuf;
use std::time::Duration;
use sunglint_formats::nearest_names;
use sunglint_simulator::scenes;

/// Arguments of `sunglint bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Scenes of one's own (docs/pass.md): the whole way from orbit to counts, and the light engine alone. Without any, the built-in scenes
    #[arg(value_name = "PASS.toml")]
    pub passes: Vec<PathBuf>,
    /// Built-in scenes alone of this name; may be given several times
    #[arg(long, value_name = "NAME")]
    pub scene: Vec<String>,
    /// Time to spend on measuring, s, shared by all rows; making the scenes comes on top
    #[arg(long, value_name = "S", default_value_t = 30.0, allow_negative_numbers = true)]
    pub seconds: f64,
    /// Which station, in place of that of the scene files.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What was measured of one engine on one scene with one grid.
#[derive(Debug, Clone)]
struct Row {
    scene: String,
    engine: &'static str,
    bins: usize,
    facets: usize,
    timing: timing::Timing,
    /// Time to make the scene ready, s; `None` where it is part of the time for an epoch.
    prepare_s: Option<f64>,
    /// Σ|E−Ê|/ΣÊ; `None` without a truth.
    error: Option<f64>,
    error_source: &'static str,
    /// What the engine thinks of its own error; `None` where it thinks nothing.
    estimate: Option<f64>,
}

/// Measures.
pub fn run(args: &BenchArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if !(args.seconds.is_finite() && args.seconds > 0.0) {
        let seconds = args.seconds;
        return Err(Usage(format!("--seconds is {seconds}, expected a time above 0 s")).into());
    }
    let names = scene_names(args)?;
    let passes = args
        .passes
        .iter()
        .map(|path| cases::read_pass(path, &args.station))
        .collect::<anyhow::Result<Vec<_>>>()?;
    if cfg!(debug_assertions) {
        console
            .warn("this program was built without --release: its times are not those of a release");
    }
    let count: usize = names.iter().map(|name| cases::count(name)).sum();
    let count = count + passes.len() * cases::PASS_ROWS;
    let budget = Duration::from_secs_f64((args.seconds / count as f64).min(3600.0));
    let bar = progress(count, console);
    let mut rows: Vec<Row> = Vec::new();
    let mut done = |row: Row| -> anyhow::Result<()> {
        if console.json {
            // Lines as they come: whoever waits sees that something happens.
            bar.suspend(|| console.print(&report::json(&row).to_string()))?;
        }
        bar.inc(1);
        rows.push(row);
        Ok(())
    };
    for name in &names {
        bar.set_message((*name).to_owned());
        cases::built_in(name, budget, &mut done).with_context(|| format!("scene {name}"))?;
    }
    for (path, pass) in args.passes.iter().zip(&passes) {
        bar.set_message(pass.name.clone());
        let measured = cases::pass(pass, budget, &mut done);
        measured.with_context(|| path.display().to_string())?;
    }
    bar.finish_and_clear();
    let report = Report { rows: &rows };
    if console.json {
        let files = args.out.files_of(&report.product())?;
        args.out.write_files(&files, console)?;
        return Ok(());
    }
    args.out.finish(&report.product(), &report.text(), console)
}

/// The built-in scenes that are wanted.
fn scene_names(args: &BenchArgs) -> anyhow::Result<Vec<&'static str>> {
    if args.scene.is_empty() {
        return Ok(if args.passes.is_empty() { scenes::NAMES.to_vec() } else { Vec::new() });
    }
    let find = |wanted: &String| {
        scenes::NAMES.into_iter().find(|name| name == wanted).with_context(|| {
            let near = nearest_names(wanted, scenes::NAMES, 1);
            let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
            let names = scenes::NAMES.join(", ");
            format!("there is no bench scene `{wanted}`; the scenes are {names}{hint}")
        })
    };
    let mut names = args.scene.iter().map(find).collect::<anyhow::Result<Vec<_>>>()?;
    // In the order of the list, each once.
    names.sort_by_key(|name| scenes::NAMES.iter().position(|known| known == name));
    names.dedup();
    Ok(names)
}

/// A bar on stderr; none when that is no terminal, none with `-q`.
fn progress(rows: usize, console: Console) -> ProgressBar {
    if console.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(rows as u64);
    match ProgressStyle::with_template("{msg:>18} {wide_bar} {pos}/{len} {eta}") {
        Ok(style) => bar.with_style(style),
        // A template that does not parse would only leave the plain bar.
        Err(_) => bar,
    }
}
