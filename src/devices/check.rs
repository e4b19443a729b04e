//! `sunglint devices check`: a self-test that moves and changes nothing.

use super::Outcome;
use super::session::{TalkArgs, advised, seconds};
use crate::output::OutputArgs;
use clap::Args;
use sunglint_drivers::session::{Peer, check};
use sunglint_report::devices as report;

/// Arguments of `sunglint devices check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// Exposure of a camera's frame, s
    #[arg(long, value_name = "S", default_value_t = 0.1)]
    pub exposure_s: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn speak(args: &CheckArgs, peer: &Peer) -> anyhow::Result<Outcome> {
    let exposure = seconds("--exposure-s", args.exposure_s)?;
    let mut words = args.talk.words("check");
    words.extend(["--exposure-s".to_owned(), args.exposure_s.to_string()]);
    let mut session = args.talk.connect(peer, &words, args.out.force)?;
    let mut found = check(&mut session, exposure.as_secs_f64());
    let error = found.error.take().map(advised);
    let said = error.as_ref().map(ToString::to_string);
    let product = report::check(&found, said.as_deref());
    Ok(Outcome { product, text: report::check_text(&found, said.as_deref()), error })
}
