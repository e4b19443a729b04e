//! `sunglint demo`: the main job from end to end, on embedded input.
//!
//! Two satellites that are made up cross the sky of a virtual night, which is observed live through the virtual devices, reduced, calibrated by its stars,
//! compared with the simulation and fitted by it; each pass gets a page of both. What runs is what a person would run: the commands stand in the folder's README.txt.

use crate::cli;
use crate::compare::{self, CompareArgs};
use crate::fit::{self, FitArgs};
use crate::output::{Console, OutputArgs};
use crate::reduce;
use anyhow::{Context as _, bail};
use clap::{Args, Parser as _};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use sunglint_calibration::reduction::light_curves;
use sunglint_drivers::clock::Cancel;
use sunglint_formats::ecsv;
use sunglint_inference::fit::PassFit;
use sunglint_numerics::progress::Silent;
use sunglint_rehearsal::demo::{self, FILES};
use sunglint_rehearsal::planned;

/// Arguments of `sunglint demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// The folder to make [default: sunglint-demo, or the next that is free]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Make the folder anew if it is there: what the demonstration made in it before is deleted
    #[arg(long)]
    pub force: bool,
    /// Show the first page in the browser (by `xdg-open`)
    #[arg(long)]
    pub open: bool,
}

/// Name and version that stand in the session.
const PROGRAM: &str = concat!("sunglint ", env!("CARGO_PKG_VERSION"));
/// Name of the file that says what is made besides.
const README: &str = "README.txt";
const SIMULATED: &str = "simulated";
const SESSION: &str = "session";
const REDUCED: &str = "reduced";
const KAPPA: &str = "kappa.ecsv";
const COMPARED: &str = "compared";
const FITTED: &str = "fitted";
/// The passes: name of the visit, of the scene's file, of the pass in it.
const PASSES: [[&str; 3]; 2] =
    [["sphere", "sphere.toml", "sphere_pass"], ["box_wing", "pass.toml", "box_wing_pass"]];

/// Makes the demonstration; `seed` is the night's.
pub fn run(args: &DemoArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    let folder = args.output.clone().unwrap_or_else(free_folder);
    clear(&folder, args.force)?;
    let mut work = Work::new(&folder, console);
    work.files(seed)?;
    // Before all else, so that a folder whose making was cut short is known for what it is.
    work.write(README, &format!("{MARK}, not finished\n"))?;
    for [visit, scene, pass] in PASSES {
        work.step(&format!("simulating the light of {visit}"));
        let curve = format!("{SIMULATED}/{pass}.ecsv");
        work.command(&["simulate", scene, "-o", &curve])?;
    }
    work.step("observing the virtual night");
    work.observe()?;
    work.step("reducing frames and counts");
    work.reduce()?;
    work.step("calibrating by stars");
    work.command(&["calibrate", REDUCED, "--station", "ufo", "-o", KAPPA, "-o", "kappa.png"])?;
    let (mut texts, mut pages) = (Vec::new(), Vec::new());
    for [visit, scene, pass] in PASSES {
        work.step(&format!("comparing {visit}"));
        let linear = format!("{REDUCED}/{visit}_1.ecsv");
        let calibrated = format!("{visit}.ecsv");
        work.command(&["apply", KAPPA, &linear, "--station", "ufo", "-o", &calibrated])?;
        texts.push(work.compare(&calibrated, scene)?);
        pages.push(work.path(&format!("{COMPARED}/{pass}_compared.html")));
        work.step(&format!("fitting {visit}"));
        let answer = work.fit(&calibrated, scene)?;
        texts.push(fitted(visit, &answer));
        pages.push(work.path(&format!("{FITTED}/{}_fit.html", answer.name)));
    }
    work.bar.finish_and_clear();
    let seconds = work.start.elapsed().as_secs_f64();
    let text = texts.join("\n");
    work.write(README, &readme(&text, &work.said))?;
    let shown: Vec<String> = pages.iter().map(|p| p.display().to_string()).collect();
    let files = files(&folder)?;
    let document = Made {
        folder: folder.display().to_string(),
        files: &files,
        pages: &shown,
        commands: &work.said,
        seconds: sunglint_report::rounded(seconds),
    };
    if !console.quiet || console.json {
        console.result(
            &format!(
                "{text}\nmade in {seconds:.0} s; the pages of both passes, compared and fitted:\n  {}\nThe demonstration is in {}",
                shown.join("\n  "),
                folder.display()
            ),
            &document,
        )?;
    }
    if args.open {
        open(&pages[2])?;
    }
    Ok(())
}

/// Files of a demonstration, and the commands that made them.
#[derive(Serialize)]
struct Made<'a> {
    folder: String,
    files: &'a [String],
    pages: &'a [String],
    commands: &'a [String],
    seconds: f64,
}

/// How the text begins that says a folder is a demonstration's.
const MARK: &str = "What `sunglint demo` made";

/// Sees to it that nothing of another is overwritten: a folder that is there is refused, or with `--force` loses what a demonstration made in it. A
/// folder that no demonstration made, which may hold a real session, loses nothing.
fn clear(folder: &Path, force: bool) -> anyhow::Result<()> {
    let own = FILES.map(|(name, _)| name).into_iter().chain([
        README,
        SIMULATED,
        SESSION,
        REDUCED,
        KAPPA,
        "kappa.png",
        COMPARED,
        FITTED,
        "sphere.ecsv",
        "box_wing.ecsv",
    ]);
    let said = std::fs::read_to_string(folder.join(README)).unwrap_or_default();
    let own_folder = said.starts_with(MARK);
    for path in own.map(|name| folder.join(name)) {
        if path.symlink_metadata().is_err() {
            continue;
        }
        if !force {
            bail!("{} is there already: nothing is overwritten without --force", path.display());
        }
        if !own_folder {
            bail!(
                "{} is there already, and {} was not made by a demonstration: give another folder",
                path.display(),
                folder.display()
            );
        }
        let gone = if path.is_dir() {
            std::fs::remove_dir_all(&path)
        } else {
            std::fs::remove_file(&path)
        };
        gone.with_context(|| format!("cannot make {} anew", path.display()))?;
    }
    Ok(())
}

/// The demonstration while it is made.
struct Work<'a> {
    folder: &'a Path,
    start: Instant,
    bar: ProgressBar,
    /// The commands that were run, as a person would.
    said: Vec<String>,
}

impl<'a> Work<'a> {
    fn new(folder: &'a Path, console: Console) -> Self {
        let bar = if console.quiet { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style);
        }
        // Hidden where stderr is no terminal.
        bar.enable_steady_tick(Duration::from_millis(120));
        Self { folder, start: Instant::now(), bar, said: Vec::new() }
    }

    fn step(&self, what: &str) {
        self.bar.set_message(what.to_owned());
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn write(&self, name: &str, text: &str) -> anyhow::Result<()> {
        let out = OutputArgs { output: Vec::new(), force: true };
        out.write_file(&self.path(name), text.as_bytes())
    }

    fn files(&mut self, seed: u64) -> anyhow::Result<()> {
        for name in [SIMULATED, REDUCED, COMPARED, FITTED] {
            let path = self.path(name);
            std::fs::create_dir_all(&path)
                .with_context(|| format!("cannot create the folder {}", path.display()))?;
        }
        for (name, text) in demo::files(seed) {
            self.write(name, &text)?;
        }
        Ok(())
    }

    /// Runs a command of the program on files of the folder, without a word.
    fn command(&mut self, words: &[&str]) -> anyhow::Result<()> {
        self.said.push(format!("sunglint {}", words.join(" ")));
        // What names a file or folder of the demonstration does so from here.
        let own = |word: &str| {
            let is = word.contains('.') || [REDUCED, SESSION].contains(&word);
            if is { self.path(word).into_os_string() } else { word.into() }
        };
        let all =
            ["sunglint", "-q"].map(Into::into).into_iter().chain(words.iter().map(|w| own(w)));
        let parsed = cli::Cli::try_parse_from(all).context("a command of the demonstration")?;
        cli::run(&parsed).with_context(|| format!("sunglint {}", words.join(" ")))
    }

    fn observe(&mut self) -> anyhow::Result<()> {
        self.said.push(format!("sunglint observe night.toml -o {SESSION}"));
        let (night, _) = planned(&self.path("night.toml"), Some(&self.path(SESSION)), PROGRAM)?;
        let summary = night.run(&Cancel::new(), &mut |_| {})?;
        if summary.not_written > 0 || summary.stopped {
            bail!("{} bins or frames of the virtual night were not written", summary.not_written);
        }
        Ok(())
    }

    fn reduce(&mut self) -> anyhow::Result<()> {
        self.said.push(format!("sunglint reduce {SESSION} -o {REDUCED}/"));
        let (curves, _) = light_curves(&self.path(SESSION), &Silent).map_err(reduce::hint)?;
        for (name, curve) in curves {
            self.write(&format!("{REDUCED}/{name}.ecsv"), &ecsv::to_string(&curve.to_table()?)?)?;
        }
        Ok(())
    }

    fn fit(&mut self, measured: &str, scene: &str) -> anyhow::Result<PassFit> {
        self.said.push(format!("sunglint fit {measured} {scene} -o {FITTED}/"));
        let quiet = Console { quiet: true, ..Console::default() };
        let into = self.path(FITTED).join("");
        let args = FitArgs::of(self.path(measured), self.path(scene), into);
        let answer = fit::solve(&args, 0, quiet)?;
        fit::write(&answer, &args, quiet)?;
        Ok(answer)
    }

    fn compare(&mut self, measured: &str, scene: &str) -> anyhow::Result<String> {
        self.said.push(format!("sunglint compare {measured} {scene} -o {COMPARED}/"));
        let quiet = Console { quiet: true, ..Console::default() };
        let args = CompareArgs::of(self.path(measured), self.path(scene));
        let (product, text) = compare::compare(&args, quiet)?;
        let out = OutputArgs { output: vec![self.path(COMPARED).join("")], force: false };
        out.write_files(&out.files_of(&product)?, quiet)?;
        Ok(text)
    }
}

/// Writes what a fit found, beside what the night was made with: the scene's own values.
fn fitted(visit: &str, answer: &PassFit) -> String {
    let (mut covered, mut all, mut furthest) = (0, 0, 0.0_f64);
    let mut values = Vec::new();
    for (p, truth) in answer.fit.parameters.iter().zip(&answer.in_the_scene) {
        let Some(sigma) = p.sigma.filter(|s| *s > 0.0) else { continue };
        all += 1;
        covered += usize::from(p.covers(*truth));
        furthest = furthest.max((p.value - truth).abs() / sigma);
        values.push((
            sigma / p.value,
            format!("{} {:.3} ± {:.3} (made with {truth:.3})", p.name, p.value, sigma),
        ));
    }
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let best: Vec<String> = values.into_iter().take(3).map(|(_, v)| v).collect();
    format!(
        "{visit} fitted: {}; {covered} of {all} values that the night was made with lie in their 95 % intervals, the furthest {furthest:.1} standard uncertainties off; best known: {}\n",
        if answer.fit.converged { "converged" } else { "NOT CONVERGED" },
        best.join("; ")
    )
}

fn readme(text: &str, commands: &[String]) -> String {
    let mut lines = String::new();
    for command in commands {
        let _ = writeln!(lines, "  {command}");
    }
    format!(
        "{MARK}\n\n{text}\nIt is a virtual night: made of photons and pixels whose truth is known (session/virtual/truth.json), observed through virtual devices, then \
         treated as a real one. The satellites,\ntheir orbits and materials are made up, and the station's curves are approximate shapes, not measurements.\n\n\
         What was run, in this folder (without the figures of `reduce`):\n\n{lines}\n\
         compared/*.html and fitted/*.html are the pages: open them in a browser, mail them. Tables (.ecsv) open in any editor and with astropy.table.Table.read.\n\
         Change pass.toml, sphere.toml or virtual.toml and run a command again.\n"
    )
}

/// All files of a folder, by their names from here.
fn files(folder: &Path) -> anyhow::Result<Vec<String>> {
    let mut found = Vec::new();
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("cannot read the folder {}", folder.display()))?;
    for entry in entries {
        found.push(entry?.path().display().to_string());
    }
    found.sort();
    Ok(found)
}

fn open(page: &Path) -> anyhow::Result<()> {
    let status = std::process::Command::new("xdg-open").arg(page).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => {
            bail!("xdg-open {} ended with {status}: open it in a browser", page.display())
        }
        Err(error) => {
            bail!("cannot start xdg-open ({error}): open {} in a browser", page.display())
        }
    }
}

/// `sunglint-demo`, `sunglint-demo-2` … : the first that is not there.
fn free_folder() -> PathBuf {
    let name =
        |n: u32| if n == 1 { "sunglint-demo".to_owned() } else { format!("sunglint-demo-{n}") };
    (1..).map(|n| PathBuf::from(name(n))).find(|p| !p.exists()).unwrap_or_default()
}
