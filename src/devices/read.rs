//! `sunglint devices read`: what a device measures.

use super::Outcome;
use super::session::{TalkArgs, Waiting, advised, seconds};
use crate::output::{Console, OutputArgs, Usage};
use clap::Args;
use sunglint_drivers::catalogue::AnyDevice;
use sunglint_drivers::session::{Peer, ReadOptions};
use sunglint_report::devices as report;

/// Arguments of `sunglint devices read`.
#[derive(Debug, Args)]
pub struct ReadArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// How many readings
    #[arg(short = 'n', long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub count: u32,
    /// Time from the beginning of one reading to that of the next, s [default: none]
    #[arg(long, value_name = "S")]
    pub every: Option<f64>,
    /// Exposure of a camera's frames, or length of a photon counter's bins, s
    #[arg(long, value_name = "S", default_value_t = 0.1)]
    pub exposure_s: f64,
    /// Where the result goes; frames go into a .fits file, several of them into a folder.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn speak(args: &ReadArgs, peer: &Peer, console: Console) -> anyhow::Result<Outcome> {
    let every = args.every.map(|s| seconds("--every", s)).transpose()?.unwrap_or_default();
    let exposure_s = seconds("--exposure-s", args.exposure_s)?.as_secs_f64();
    let mut words = args.talk.words("read");
    words.extend(["--count".to_owned(), args.count.to_string()]);
    words.extend(["--exposure-s".to_owned(), args.exposure_s.to_string()]);
    words.extend(args.every.map(|s| ["--every".to_owned(), s.to_string()]).into_iter().flatten());
    let mut open = args.talk.start(peer, &words, args.out.force)?;
    check_files(args, open.device())?;
    let options = ReadOptions { count: args.count, every, exposure_s };
    let mut done = open.read(&options, &Waiting::new(peer, console)).map_err(advised)?;
    let text = report::readings_text(&done);
    let error = done.error.take().map(advised);
    let said = error.as_ref().map(ToString::to_string);
    Ok(Outcome { product: report::readings(&done, said.as_deref())?, text, error })
}

/// Frames go into FITS files: what cannot be written is refused before the light is lost.
fn check_files(args: &ReadArgs, device: &AnyDevice) -> anyhow::Result<()> {
    let is_fits = |path: &std::path::PathBuf| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("fits") || e.eq_ignore_ascii_case("fit"))
    };
    let frames = matches!(device, AnyDevice::Camera(_)) && args.count > 1;
    match args.out.output.iter().find(|path| is_fits(path)) {
        Some(path) if frames => {
            let what = format!("{} frames do not fit into {}", args.count, path.display());
            Err(Usage(format!("{what}: give `-o` a folder (its name ends with `/`)")).into())
        }
        _ => Ok(()),
    }
}
