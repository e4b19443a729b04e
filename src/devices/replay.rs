//! `sunglint devices record` and `replay`.

use super::Talk;
use super::session::HOST;
use crate::output::{Console, OutputArgs, Usage};
use anyhow::{Context as _, bail};
use clap::{Args, Parser};
use serde_json::Value;
use std::path::PathBuf;
use sunglint_drivers::catalogue::{DRIVERS, Driver};
use sunglint_drivers::recording::Recording;
use sunglint_drivers::session::Peer;
use sunglint_report::devices as report;

/// Arguments of `sunglint devices record`.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// The device: `DRIVER[:WHERE]`
    pub address: String,
    /// The recording
    #[arg(short, long, value_name = "FILE.rec")]
    pub output: PathBuf,
    /// Overwrite a recording that is there
    #[arg(long)]
    pub force: bool,
    /// Command to record, such as `-- move 45`: check, read, set or move without the address
    #[arg(last = true, required = true, value_name = "COMMAND")]
    pub command: Vec<String>,
}

/// Arguments of `sunglint devices replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// The recording
    pub file: PathBuf,
    /// The driver that speaks, `DRIVER[:WHERE]`, for a recording that does not name the command it was made by
    #[arg(long, value_name = "DRIVER")]
    pub driver: Option<String>,
    /// Command to run with --driver, without the address [default: check]
    #[arg(last = true, value_name = "COMMAND")]
    pub command: Vec<String>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A conversation's own command line.
#[derive(Debug, Parser)]
#[command(name = "sunglint devices", no_binary_name = true)]
struct Line {
    #[command(subcommand)]
    talk: Talk,
}

const COMMANDS: [&str; 4] = ["check", "read", "set", "move"];

/// The command of these words, with the address in its place.
fn parse(address: &str, command: &[String], more: &[String]) -> anyhow::Result<Talk> {
    let (first, rest) = command.split_first().map_or(("check", &[][..]), |(w, rest)| (w, rest));
    if !COMMANDS.contains(&first) {
        let expected = COMMANDS.join(", ");
        return Err(
            Usage(format!("found the command `{first}`, expected one of {expected}")).into()
        );
    }
    let words = [&[first.to_owned(), address.to_owned()], more, rest].concat();
    let parsed = Line::try_parse_from(words);
    Ok(parsed.map_err(|error| Usage(error.to_string().trim().to_owned()))?.talk)
}

/// Does it and writes down what is said.
pub(super) fn record(args: &RecordArgs, console: Console) -> anyhow::Result<()> {
    let file = args.output.to_str().context("the recording's name is not UTF-8")?;
    let more = ["--record".to_owned(), file.to_owned()];
    let force = args.force.then(|| "--force".to_owned());
    let more: Vec<String> = more.into_iter().chain(force).collect();
    let done = parse(&args.address, &args.command, &more)?.run(console);
    if args.output.exists() {
        console.say(&format!("wrote {}", args.output.display()));
    }
    done
}

/// The words of the command by which this program made the recording.
fn recorded_words(recording: &Recording) -> Option<Vec<String>> {
    // Another version's words are good as long as they can be read.
    let host = recording.header.host.as_deref()?;
    let words =
        host.strip_prefix(HOST).or_else(|| host.split_once(' ')?.1.split_once(' ').map(|w| w.1))?;
    serde_json::from_str(words).ok()
}

/// Returns the command to replay: the recording's own, or what was asked for.
fn command(args: &ReplayArgs, recording: &Recording) -> anyhow::Result<(Talk, Vec<String>)> {
    if let Some(driver) = &args.driver {
        // The line is the recording; an address has to be whole all the same.
        let address = match driver.split_once(':') {
            Some(_) => driver,
            None => match Driver::named(driver)?.place {
                place if place.optional => driver,
                place => place.example,
            },
        };
        let words =
            if args.command.is_empty() { vec!["check".into()] } else { args.command.clone() };
        return Ok((parse(address, &words, &[])?, [vec![driver.clone()], words].concat()));
    }
    if !args.command.is_empty() {
        return Err(Usage("a command for the replay needs --driver too".into()).into());
    }
    match recorded_words(recording) {
        Some(words) if words.len() >= 2 => {
            let rest: Vec<String> = words[2..].to_vec();
            let command = [&words[..1], &rest].concat();
            Ok((parse(&words[1], &command, &[])?, words))
        }
        _ => {
            let names: Vec<&str> = DRIVERS.into_iter().map(|driver| driver.name).collect();
            bail!(
                "{}: it does not say by which command it was made; name the driver with --driver: {}",
                args.file.display(),
                names.join(", ")
            )
        }
    }
}

/// Replays strictly: what the driver says has to be what was said.
pub(super) fn replay(args: &ReplayArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let recording = Recording::read(&args.file)?;
    let (talk, words) = command(args, &recording)?;
    let header = recording.header.clone();
    let peer = Peer::replay(recording);
    let outcome = talk.speak(&peer, console);
    let rest = peer.rest().context("the command did not speak to the device")?;
    let mismatch = rest.finish().err();
    let (text, result, ended) = match outcome {
        Ok(outcome) => (outcome.text, outcome.product.json, outcome.error),
        Err(error) => (String::new(), Value::Null, Some(error)),
    };
    let ended = ended.map(|error| error.to_string());
    let replayed = report::Replayed {
        file: &args.file,
        header: &header,
        command: &words,
        text: &text,
        result: &result,
        mismatch: mismatch.as_ref(),
        ended: ended.as_deref(),
    };
    args.out.finish(&report::replay(&replayed), &report::replay_text(&replayed), console)?;
    mismatch.map_or(Ok(()), |mismatch| Err(mismatch.into()))
}
