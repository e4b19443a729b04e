//! `sunglint devices serve`.

use crate::interrupt::{Hangup, listen};
use crate::output::{Console, Usage};
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::simulated::served::{Port, Pty, Served, Visit};

/// Arguments of `sunglint devices serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// The simulated device: sim-tmcl, sim-apt, sim-ophir, sim-scpi, sim-camera, sim-rotator, sim-wheel
    pub address: String,
    /// Options of the device, such as latency_s=0.02; `devices list --drivers` names all
    #[arg(long = "with", value_name = "NAME=VALUE")]
    pub options: Vec<String>,
    /// Serve on a serial port (a pty), under this name; without a name it says which it is. What is served when nothing is asked
    #[arg(long, value_name = "PATH", num_args = 0..=1, conflicts_with = "tcp")]
    pub pty: Option<Option<PathBuf>>,
    /// Serve on a TCP port of this computer, or of another of its addresses; port 0 takes a free one
    #[arg(long, value_name = "[ADDRESS:]PORT")]
    pub tcp: Option<String>,
}

#[derive(Serialize)]
struct AtPort<'a> {
    device: &'a str,
    tcp: String,
}

#[derive(Serialize)]
struct OnPty<'a> {
    device: &'a str,
    pty: &'a str,
    path: &'a str,
}

/// Serves until Ctrl-C, which is its good end.
pub(super) fn run(args: &ServeArgs, console: Console) -> anyhow::Result<()> {
    let mut served = Served::new(Address::parse(&args.address, &args.options)?)?;
    let cancel = Cancel::new();
    let token = cancel.clone();
    listen(Hangup::Ends, move || token.cancel())?;
    let name = served.name();
    if let Some(place) = &args.tcp {
        let place = if place.contains(':') { place.clone() } else { format!("127.0.0.1:{place}") };
        if place.rsplit(':').next().is_none_or(|port| port.parse::<u16>().is_err()) {
            return Err(Usage(format!(
                "--tcp: found {place}, expected [ADDRESS:]PORT, such as 5025"
            ))
            .into());
        }
        let port = Port::listen(&place)?;
        let at = port.at();
        if !at.ip().is_loopback() {
            console.warn(&format!(
                "{at} can be reached from other computers, and anybody there may use the device"
            ));
        }
        let text = format!("{name} at tcp:{at}; Ctrl-C ends");
        console.result(&text, &AtPort { device: name, tcp: at.to_string() })?;
        return Ok(served.at_port(&port, &cancel, |visit| match visit {
            Visit::Came(host) => console.say(&format!("{host} is there")),
            Visit::Left(host) => console.say(&format!("{host} has gone")),
            Visit::SentAway(host) => {
                console.say(&format!("{host} was sent away: one host at a time"))
            }
            _ => {}
        })?);
    }
    let link = args.pty.clone().flatten();
    let mut pty = Pty::open(link.as_deref())?;
    let shown = link.map_or_else(|| pty.port().to_owned(), |link| link.display().to_string());
    let text = format!("{name} at {shown}; Ctrl-C ends");
    console.result(&text, &OnPty { device: name, pty: pty.port(), path: &shown })?;
    Ok(served.on_pty(&mut pty, &cancel)?)
}
