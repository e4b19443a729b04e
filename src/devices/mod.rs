//! `sunglint devices`: the instruments on the desk, one at a time.

mod act;
mod check;
mod list;
mod read;
mod replay;
mod serve;
mod session;
mod template;

pub use act::{MoveArgs, SetArgs};
pub use check::CheckArgs;
pub use list::ListArgs;
pub use read::ReadArgs;
pub use replay::{RecordArgs, ReplayArgs};
pub use serve::ServeArgs;
pub use template::TemplateArgs;

use crate::output::{Console, OutputArgs};
use clap::Subcommand;
use serde::Serialize;
use sunglint_drivers::catalogue::udev;
use sunglint_drivers::session::Peer;
use sunglint_report::Product;

/// Command for instruments.
#[derive(Debug, Subcommand)]
pub enum DevicesCommand {
    /// List what is plugged in, which driver recognises it, and whether you may use it
    List(ListArgs),
    /// Command to one device.
    #[command(flatten)]
    Talk(Talk),
    /// Do one of check, read, set, move and write down every byte that is said
    Record(RecordArgs),
    /// Let a driver speak to a recording instead of a device, and show the first difference
    Replay(ReplayArgs),
    /// Serve a simulated device on a serial port or a TCP port, for other programs
    Serve(ServeArgs),
    /// Print a file that describes an SCPI instrument, to begin with; without a name, list them
    Template(TemplateArgs),
    /// Print the udev rules that let users reach the instruments
    Udev,
}

/// Command to one device.
#[derive(Debug, Subcommand)]
pub enum Talk {
    /// A self-test that moves and changes nothing: identity, settings, one reading
    Check(CheckArgs),
    /// Read what the device measures: power, counts, an angle, a slot, a frame
    Read(ReadArgs),
    /// Change settings and read them back
    Set(SetArgs),
    /// Turn a stage to angles or a wheel to slots
    Move(MoveArgs),
}

/// Product of a command, and why it is not whole, if it is not.
struct Outcome {
    product: Product,
    text: String,
    error: Option<anyhow::Error>,
}

impl DevicesCommand {
    /// Where its result goes, for what has one.
    pub fn output(&self) -> Option<&OutputArgs> {
        match self {
            Self::List(args) => Some(&args.out),
            Self::Talk(talk) => Some(talk.out()),
            Self::Replay(args) => Some(&args.out),
            Self::Record(_) | Self::Serve(_) | Self::Template(_) | Self::Udev => None,
        }
    }
}

impl Talk {
    fn out(&self) -> &OutputArgs {
        match self {
            Self::Check(args) => &args.out,
            Self::Read(args) => &args.out,
            Self::Set(args) => &args.out,
            Self::Move(args) => &args.out,
        }
    }

    /// Speaks to the device. An error is one before there was any result.
    fn speak(&self, peer: &Peer, console: Console) -> anyhow::Result<Outcome> {
        match self {
            Self::Check(args) => check::speak(args, peer),
            Self::Read(args) => read::speak(args, peer, console),
            Self::Set(args) => act::set(args, peer),
            Self::Move(args) => act::move_to(args, peer, console),
        }
    }

    /// On a real desk: what was done is shown and written, all of it or not.
    fn run(&self, console: Console) -> anyhow::Result<()> {
        self.out().check()?;
        let outcome = self.speak(&session::live(console)?, console)?;
        self.out().finish(&outcome.product, &outcome.text, console)?;
        outcome.error.map_or(Ok(()), Err)
    }
}

#[derive(Serialize)]
struct Rules {
    file: &'static str,
    folder: &'static str,
    rules: String,
}

/// Does what is asked.
///
/// # Errors
/// Errors of the device; what it had done until then was shown.
pub fn run(command: &DevicesCommand, console: Console) -> anyhow::Result<()> {
    match command {
        DevicesCommand::List(args) => list::run(args, console),
        DevicesCommand::Talk(talk) => talk.run(console),
        DevicesCommand::Record(args) => replay::record(args, console),
        DevicesCommand::Replay(args) => replay::replay(args, console),
        DevicesCommand::Serve(args) => serve::run(args, console),
        DevicesCommand::Template(args) => template::run(args, console),
        DevicesCommand::Udev => console.result(
            &udev::rules(),
            &Rules { file: udev::FILE, folder: udev::FOLDER, rules: udev::rules() },
        ),
    }
}
