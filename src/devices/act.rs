//! `sunglint devices set` and `move`: what changes a device.

use super::Outcome;
use super::session::{TalkArgs, Waiting, advised};
use crate::output::{Console, OutputArgs, Usage};
use clap::Args;
use sunglint_drivers::session::{Peer, Target};
use sunglint_report::devices as report;

/// Arguments of `sunglint devices set`.
#[derive(Debug, Args)]
pub struct SetArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// Settings to make, in this order, such as wavelength_nm=532; without any, what can be set is listed
    #[arg(value_name = "NAME=VALUE")]
    pub settings: Vec<String>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Arguments of `sunglint devices move`.
#[derive(Debug, Args)]
pub struct MoveArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// Where to, one after the other: angles in degrees (or home, stop) for a stage, slots from 1 for a wheel
    #[arg(value_name = "TARGET", required = true, allow_negative_numbers = true)]
    pub targets: Vec<String>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Sets, reads back, and says what the device then has.
pub(super) fn set(args: &SetArgs, peer: &Peer) -> anyhow::Result<Outcome> {
    let mut pairs = Vec::new();
    for text in &args.settings {
        let pair = text.split_once('=').map(|(name, value)| (name.trim(), value.trim()));
        let wrong = || Usage(format!("found `{text}`, expected NAME=VALUE"));
        pairs.push(pair.ok_or_else(wrong)?);
    }
    let mut words = args.talk.words("set");
    words.extend(args.settings.iter().cloned());
    let mut open = args.talk.start(peer, &words, args.out.force)?;
    let mut done = open.set(&pairs).map_err(advised)?;
    let error = done.error.take().map(advised);
    let said = error.as_ref().map(ToString::to_string);
    let text = report::settings_text(&done, !pairs.is_empty());
    Ok(Outcome { product: report::settings(&done, said.as_deref()), text, error })
}

/// Goes there, one target after the other; a failure or Ctrl-C stops the motor, and what was reached is said.
pub(super) fn move_to(args: &MoveArgs, peer: &Peer, console: Console) -> anyhow::Result<Outcome> {
    let mut words = args.talk.words("move");
    words.extend(args.targets.iter().cloned());
    // Nothing is said to a device that cannot go there.
    let kind = args.talk.address()?.driver.kind;
    let targets = args.targets.iter().map(|text| Target::parse(text, kind));
    let targets: Vec<Target> = targets.collect::<Result<_, _>>().map_err(advised)?;
    let mut open = args.talk.start(peer, &words, args.out.force)?;
    let mut moves = open.travel(&targets, &Waiting::new(peer, console));
    let text = report::moves_text(&moves);
    let error = moves.failed.take().map(|failed| {
        let error = advised(failed.error);
        let message = format!("{error}; it stands at {}", moves.at);
        error.context(message)
    });
    let said = error.as_ref().map(ToString::to_string);
    Ok(Outcome { product: report::moves(&moves, said.as_deref()), text, error })
}
