//! `sunglint bench`: error against time of the light engines, on one thread.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::simulate;
use crate::station::StationArgs;
use clap::Args;
use std::ops::ControlFlow;
use std::path::PathBuf;
use sunglint_report::bench::{product, row_json, text};
use sunglint_simulator::bench::{BenchError, BenchOptions, BenchRow, bench, find_scenes};
use sunglint_simulator::pass::Overrides;
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

/// Measures.
pub fn run(args: &BenchArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if !(args.seconds.is_finite() && args.seconds > 0.0) {
        let seconds = args.seconds;
        return Err(Usage(format!("--seconds is {seconds}, expected a time above 0 s")).into());
    }
    let scenes = match args.scene.is_empty() && args.passes.is_empty() {
        true => scenes::NAMES.to_vec(),
        false => find_scenes(&args.scene)?,
    };
    let read = |path: &PathBuf| simulate::read(path, &args.station, Overrides::default());
    let passes = args.passes.iter().map(read).collect::<anyhow::Result<Vec<_>>>()?;
    if cfg!(debug_assertions) {
        console
            .warn("this program was built without --release: its times are not those of a release");
    }
    let options = BenchOptions { scenes, passes, seconds: args.seconds };
    let bar = Bar::new(console);
    let mut printed = Ok(());
    // Lines as they come: whoever waits sees that something happens.
    let mut each = |row: &BenchRow| {
        if console.json {
            printed = bar.suspend(|| console.print(&row_json(row).to_string()));
        }
        if printed.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let found = bench(&options, &bar, &mut each);
    printed?;
    let found = found.map_err(|error| match error {
        BenchError::Pass { index, source, .. } => {
            anyhow::Error::from(source).context(args.passes[index].display().to_string())
        }
        error => error.into(),
    })?;
    bar.end();
    if console.json {
        let files = args.out.files_of(&product(&found))?;
        args.out.write_files(&files, console)?;
        return Ok(());
    }
    args.out.finish(&product(&found), &text(&found), console)
}
