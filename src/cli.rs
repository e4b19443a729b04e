//! The grammar of the command line. Subcommands appear here as they become real, none before.

use crate::output::{Console, OutputArgs};
use crate::{
    air, align, analyse, apply, archive, bench, brdf, calibrate, compare, demo, detect, devices,
    efficiency, elements, explain, fit, focus, goto, import, interrupt, light, observe, page,
    passes, picture, pointing, reduce, session, simulate, solve, star, study, tables, timing,
    track,
};
use anyhow::Context as _;
use clap::{Args, CommandFactory as _, Parser, Subcommand};
use std::path::PathBuf;

/// Light curves of satellites and space debris: observed, calibrated, simulated, compared.
///
/// Times are UTC, ISO 8601 (2026-11-20T18:30:00), or `now`. Angles are degrees. Zenith angles are true unless --apparent.
/// Results go to stdout, messages to stderr. Exit codes: 0 done; 1 failed (a value out of its range, an unknown name, a file that is
/// there, a system that refuses); 2 usage (unknown options, options that exclude one another, an extension of no format).
#[derive(Debug, Parser)]
#[command(name = "sunglint", version, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    /// Options of every command.
    #[command(flatten)]
    pub global: Global,
    /// Command to run.
    #[command(subcommand)]
    pub command: Command,
}

/// Options of every command.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Options of every command")]
pub struct Global {
    /// Seed of everything random; the same seed gives the same result. It counts for `brdf ndf` (readings drawn anew), `calibrate` (the bootstrap of its intervals), `fit` (where its search begins), `focus run` (its virtual telescope), `simulate --active` (single detections) and `demo` (its night)
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// Threads to use at most [default: as many as there are cores]; results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Say on stderr what was used: station, air, grid, threads
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Say nothing on stderr but errors, and nothing on stdout where `-o` has files
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Print one JSON document on stdout instead of text (`bench`: a JSON line for each row)
    #[arg(long, global = true)]
    pub json: bool,
}

/// Command of the program.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The main job on embedded input: a virtual night observed, reduced, calibrated, and two passes compared with their simulation
    Demo(demo::DemoArgs),
    /// List the reference tables with their ranges, sources, licences and checksums, or show one
    Tables(tables::TablesArgs),
    /// Transmission of the air above a station
    Air(Box<air::AirArgs>),
    /// Place, airmass and expected count rates of a star
    Star(Box<star::StarArgs>),
    /// Spectra, magnitudes and count rates of a satellite's pass, from a scene file
    Simulate(Box<simulate::SimulateArgs>),
    /// A measured pass beside the simulated one: curves, residuals, ratios, what both claim of their errors
    Compare(Box<compare::CompareArgs>),
    /// Show what a scene needs: which effects are modelled, what each could add, what error is left
    Explain(Box<explain::ExplainArgs>),
    /// The light of a body for directions that are given: one geometry or a table of them, all effects, stated error
    Light(Box<light::LightArgs>),
    /// A body as it looks at a moment, its reflection map, a sphere against phase angle
    Picture(Box<picture::PictureArgs>),
    /// Visible passes of satellites: when, where, how bright, what each channel counts
    Passes(Box<passes::PassesArgs>),
    /// Files of elements: which objects, how old, how far several sets are apart; and fresh ones
    Elements(Box<elements::ElementsArgs>),
    /// A frame's place on the sky by the pattern of its stars, written into its header
    Solve(Box<solve::SolveArgs>),
    /// Points and streaks of frames (FITS of any program): where, how bright, how significant, and a picture with marks
    Detect(Box<detect::DetectArgs>),
    /// A recorded session as linear light curves, visit by visit
    Reduce(Box<reduce::ReduceArgs>),
    /// The fields of the fibres on the camera image, from a session's stars
    Align(Box<align::AlignArgs>),
    /// When a camera exposes: latency, jitter and rows' times, by a lamp that flashes into it and a counter
    Timing(Box<timing::TimingArgs>),
    /// Error against time of the light engines, on built-in scenes or one's own
    Bench(Box<bench::BenchArgs>),
    /// A sample's reflectance, from a goniometer: its microfacets, where to measure it, laws and materials
    #[command(subcommand)]
    Brdf(Box<brdf::BrdfCommand>),
    /// A detector's efficiency, from a monochromator's light on a photodiode and on the detector
    Efficiency(Box<efficiency::EfficiencyArgs>),
    /// The instruments: what is plugged in, a self-test, readings, settings, moves, recordings
    #[command(subcommand)]
    Devices(Box<devices::DevicesCommand>),
    /// Observe a night: frames and photon counts into a session's folder, from a plan or from a recorded night
    Observe(Box<observe::ObserveArgs>),
    /// The telescope at a star or a place, corrected by where its frames look
    Goto(Box<goto::GotoArgs>),
    /// How a mount shows directions: a model of its pointing, from frames all over the sky
    Pointing(Box<pointing::PointingArgs>),
    /// A mount follows a satellite: from elements to a telescope that tracks, kept off the Sun; or a rehearsal with a virtual one
    Track(Box<track::TrackArgs>),
    /// The telescope's focus: the best position of a focuser by the stars' half-flux radius, and its drift with temperature
    #[command(subcommand)]
    Focus(Box<focus::FocusCommand>),
    /// Stops a mount when the program that moves it falls silent
    #[command(hide = true)]
    MountWatchdog(track::WatchdogArgs),
    /// A recorded session in the browser: its images, counts, sky and events, scrubbed like a film
    Page(page::PageArgs),
    /// Recorded nights: whether all of one is there
    #[command(subcommand)]
    Session(session::SessionCommand),
    /// The coefficient of every channel and night from visits to stars
    Calibrate(Box<calibrate::CalibrateArgs>),
    /// What a light curve of another program says, and the same as ECSV, TDM or ALCDEF
    Import(Box<import::ImportArgs>),
    /// Calibrated rates, magnitudes and irradiances of a light curve
    Apply(Box<apply::ApplyArgs>),
    /// Fit a simulation to what was measured: albedos, roughness, attitude, with intervals
    Fit(Box<fit::FitArgs>),
    /// The nights of a folder: which passes of which objects lie in its files, at which phase angles; several as one curve
    Archive(Box<archive::ArchiveArgs>),
    /// A scene simulated for many values of its keys and the passes of many objects, in shards that a cluster may run
    Study(Box<study::StudyArgs>),
    /// Find what a light curve says about a body: its period, its folded curve, its materials, its map
    #[command(subcommand, visible_alias = "analyze")]
    Analyse(analyse::AnalyseCommand),
    /// Print the completions of a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Write the manual pages into a folder
    Man {
        /// The folder
        #[arg(short, long, value_name = "FOLDER")]
        output: PathBuf,
        /// Overwrite what is there
        #[arg(long)]
        force: bool,
    },
}

/// Runs a parsed command line.
///
/// # Errors
/// Whatever the command says; `main` prints it and exits with 1, or with 2 where it is a [`crate::output::Usage`].
pub fn run(cli: &Cli) -> anyhow::Result<()> {
    interrupt::outlive_long_files()?;
    let console =
        Console { json: cli.global.json, quiet: cli.global.quiet, verbose: cli.global.verbose };
    if let Some(out) = cli.command.output() {
        out.check_with(console)?;
    }
    match cli.global.threads {
        None => cli.command.run(console, &cli.global),
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build();
            pool.with_context(|| format!("cannot start {threads} threads"))?
                .install(|| cli.command.run(console, &cli.global))
        }
    }
}

impl Command {
    /// Where its result goes, for what has one.
    fn output(&self) -> Option<&OutputArgs> {
        match self {
            Command::Tables(args) => Some(&args.out),
            Command::Air(args) => Some(&args.out),
            Command::Star(args) => Some(&args.out),
            Command::Simulate(args) => Some(&args.out),
            Command::Compare(args) => Some(&args.out),
            Command::Explain(args) => Some(&args.out),
            Command::Light(args) => Some(&args.out),
            Command::Picture(args) => Some(&args.out),
            Command::Passes(args) => Some(&args.out),
            Command::Detect(args) => Some(&args.out),
            Command::Elements(args) => Some(&args.out),
            Command::Solve(args) => Some(&args.out),
            Command::Reduce(args) => Some(&args.out),
            Command::Align(args) => Some(&args.out),
            Command::Timing(args) => Some(&args.out),
            Command::Archive(args) => Some(&args.out),
            Command::Bench(args) => Some(&args.out),
            Command::Brdf(command) => command.output(),
            Command::Efficiency(args) => Some(args.output()),
            Command::Devices(command) => command.output(),
            Command::Calibrate(args) => Some(&args.out),
            Command::Apply(args) => Some(&args.out),
            Command::Import(args) => Some(&args.out),
            Command::Fit(args) => Some(&args.out),
            Command::Analyse(command) => Some(command.output()),
            Command::Goto(args) => Some(&args.out),
            Command::Pointing(args) => Some(&args.out),
            Command::Track(args) => Some(&args.out),
            Command::Focus(command) => Some(command.output()),
            Command::Demo(_)
            | Command::Observe(_)
            | Command::Session(_)
            | Command::Study(_)
            | Command::Page(_)
            | Command::MountWatchdog(_)
            | Command::Completions { .. }
            | Command::Man { .. } => None,
        }
    }

    fn run(&self, console: Console, global: &Global) -> anyhow::Result<()> {
        let seed = global.seed;
        match self {
            Command::Demo(args) => demo::run(args, seed, console),
            Command::Tables(args) => tables::run(args, console),
            Command::Air(args) => air::run(args, console),
            Command::Star(args) => star::run(args, console),
            Command::Goto(args) => goto::run(args, console),
            Command::Pointing(args) => pointing::run(args, console),
            Command::Track(args) => track::run(args, console),
            Command::Focus(command) => focus::run(command, console, seed),
            Command::MountWatchdog(args) => track::watchdog(args),
            Command::Simulate(args) => simulate::run(args, seed, console),
            Command::Compare(args) => compare::run(args, console),
            Command::Explain(args) => explain::run(args, console),
            Command::Light(args) => light::run(args, console),
            Command::Picture(args) => picture::run(args, console),
            Command::Passes(args) => passes::run(args, console),
            Command::Detect(args) => detect::run(args, console),
            Command::Elements(args) => elements::run(args, console),
            Command::Solve(args) => solve::run(args, console),
            Command::Reduce(args) => reduce::run(args, console),
            Command::Align(args) => align::run(args, console),
            Command::Timing(args) => timing::run(args, console),
            Command::Bench(args) => bench::run(args, console),
            Command::Brdf(command) => brdf::run(command, console, seed),
            Command::Efficiency(args) => efficiency::run(args, console),
            Command::Devices(command) => devices::run(command, console),
            Command::Observe(args) => observe::run(args, console),
            Command::Session(command) => session::run(command, console),
            Command::Page(args) => page::run(args, console),
            Command::Calibrate(args) => calibrate::run(args, seed, console),
            Command::Apply(args) => apply::run(args, console),
            Command::Import(args) => import::run(args, console),
            Command::Fit(args) => fit::run(args, seed, console),
            Command::Study(args) => study::run(args, global.threads, console),
            Command::Archive(args) => archive::run(args, console),
            Command::Analyse(command) => analyse::run(command, seed, console),
            Command::Completions { shell } => {
                let mut script = Vec::new();
                clap_complete::generate(*shell, &mut Cli::command(), "sunglint", &mut script);
                console.print(&String::from_utf8(script)?)
            }
            Command::Man { output, force } => write_manual(output, *force, console),
        }
    }
}

/// One page for the program and one for each command, from the same definition as the parser.
fn write_manual(folder: &std::path::Path, force: bool, console: Console) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .map_err(|e| sunglint_formats::FileError::io("create", folder, e))?;
    let out = OutputArgs { output: vec![], force };
    let mut command = Cli::command();
    command.build();
    let mut pages = vec![command.clone()];
    pages.extend(command.get_subcommands().filter(|c| c.get_name() != "help").cloned());
    for page in pages {
        let name = page.get_display_name().unwrap_or_else(|| page.get_name()).to_owned();
        let page = page.name(leak(&name)).disable_help_subcommand(true);
        let mut text = Vec::new();
        clap_mangen::Man::new(page).render(&mut text)?;
        let path = folder.join(format!("{name}.1"));
        out.write_file(&path, &text)?;
        console.say(&format!("wrote {}", path.display()));
    }
    Ok(())
}

/// clap wants names that live as long as the program; a handful of pages do.
fn leak(name: &str) -> &'static str {
    Box::leak(name.to_owned().into_boxed_str())
}
