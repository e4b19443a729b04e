//! `sunglint elements`: what a file of elements holds, and fresh ones.

use crate::output::{Console, OutputArgs, Usage};
use anyhow::Context as _;
use clap::{Args, Subcommand};
use hifitime::Epoch;
use std::path::PathBuf;
use sunglint_ephemeris::orbit::{elements, tle, update};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_report::elements::Contents;

/// Arguments of `sunglint elements`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct ElementsArgs {
    /// Fresh elements.
    #[command(subcommand)]
    pub command: Option<ElementsCommand>,
    /// Files of elements: two lines (with names or without), or OMM in JSON, CSV, XML or KVN
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Only this object: number or name
    #[arg(long, value_name = "OBJECT")]
    pub object: Option<String>,
    /// Ages and distances at this time, UTC [default: now]
    #[arg(long, value_name = "UTC")]
    pub at: Option<String>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Commands of `sunglint elements`.
#[derive(Debug, Subcommand)]
pub enum ElementsCommand {
    /// Fetch elements from a server or a file, no more than once in two hours
    Update(UpdateArgs),
}

/// Arguments of `sunglint elements update`.
#[derive(Debug, Args)]
pub struct UpdateArgs {
    /// The address (http or https, of CelesTrak, Space-Track or your own server), or a file
    #[arg(long, value_name = "URL|FILE")]
    pub from: String,
    /// The file that gets the elements; one that is there is replaced
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// Shows a file, or fetches one.
///
/// # Errors
/// Files that cannot be read or written, no elements, an unknown object, a server that gives nothing.
pub fn run(args: &ElementsArgs, console: Console) -> anyhow::Result<()> {
    match &args.command {
        Some(ElementsCommand::Update(update)) => fetch(update, console),
        None => show(args, console),
    }
}

fn show(args: &ElementsArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    if args.files.is_empty() {
        return Err(Usage("no file of elements is given".into()).into());
    }
    let at = match &args.at {
        None => now()?,
        Some(text) => parse_utc(text).map_err(|error| Usage(format!("--at: {error}")))?,
    };
    let (mut sets, mut bad) = (Vec::new(), Vec::new());
    for path in &args.files {
        let text = sunglint_formats::read::text(path)?;
        let (good, mut errors) = elements::parse_lenient(path, &text);
        if good.is_empty() && !errors.is_empty() {
            return Err(errors.swap_remove(0).into());
        }
        sets.extend(good);
        bad.append(&mut errors);
    }
    for error in bad.iter().take(5) {
        console.warn(&error.to_string());
    }
    if bad.len() > 5 {
        console.warn(&format!("… and {} more sets that cannot be read", bad.len() - 5));
    }
    if let Some(wanted) = &args.object {
        let chosen = tle::choose(&sets, Some(wanted), Some(at));
        let number = chosen.map_err(|error| Usage(format!("--object: {error}")))?.norad_id;
        sets.retain(|set| set.norad_id == number);
    }
    let contents = Contents::new(&elements::held(&sets, at), at, bad.len());
    args.out.finish(&contents.product()?, &contents.text(), console)
}

fn fetch(args: &UpdateArgs, console: Console) -> anyhow::Result<()> {
    let folder = update::cache_folder().context(
        "neither HOME nor XDG_CACHE_HOME is set: there is no place for what was fetched",
    )?;
    let fetched = update::update(&args.from, &folder, now()?)?;
    write_file(&args.output, fetched.text.as_bytes(), Overwrite::Allow)?;
    for error in fetched.bad.iter().take(5) {
        console.warn(&error.to_string());
    }
    let refused = fetched.bad.len();
    if refused > 5 {
        console.warn(&format!("… and {} more sets that cannot be read", refused - 5));
    }
    let refused = match refused {
        0 => String::new(),
        1 => ", 1 refused and not written".to_owned(),
        n => format!(", {n} refused and not written"),
    };
    let since = match fetched.kept_since {
        None => String::new(),
        Some(at) => format!(
            " (fetched at {}: a server is asked no more than once in two hours)",
            format_utc(at, 0)
        ),
    };
    console.say(&format!("wrote {}: {} sets{refused}{since}", args.output.display(), fetched.sets));
    Ok(())
}

fn now() -> anyhow::Result<Epoch> {
    Epoch::now().context("the computer's clock cannot be read")
}
