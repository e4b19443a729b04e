//! `sunglint devices list`: what there is, and whether it can be used.

use super::session::seconds;
use crate::output::{Console, OutputArgs};
use clap::Args;
use sunglint_drivers::catalogue::inventory;
use sunglint_drivers::clock::utc_now;
use sunglint_report::devices as report;

/// Arguments of `sunglint devices list`.
#[derive(Debug, Args)]
pub struct ListArgs {
    /// Also what this INDI server has, `HOST[:PORT]`; may be given several times
    #[arg(long, value_name = "HOST")]
    pub indi: Vec<String>,
    /// Also what this Alpaca server has, `HOST[:PORT]`, or `any` for those that answer in the network; may be given several times
    #[arg(long, value_name = "HOST")]
    pub alpaca: Vec<String>,
    /// Also USB and HID devices that no driver recognises
    #[arg(short, long)]
    pub all: bool,
    /// The drivers instead: their addresses, options, and what they were tried with
    #[arg(long)]
    pub drivers: bool,
    /// How long a server may take, s
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub timeout_s: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &ListArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    if args.drivers {
        return args.out.finish(&report::drivers(), &report::drivers_text(), console);
    }
    let timeout = seconds("--timeout-s", args.timeout_s)?;
    let found = inventory(args.all, &args.indi, &args.alpaca, timeout);
    for fault in &found.faults {
        console.warn(fault);
    }
    let product = report::inventory(&found, utc_now());
    args.out.finish(&product, &report::inventory_text(&found), console)?;
    let indi = found.servers.into_iter().map(|server| ("--indi", server));
    let all = indi.chain(found.alpaca.into_iter().map(|server| ("--alpaca", server)));
    let silent =
        all.into_iter().find_map(|(o, server)| Some((o, server.host, server.devices.err()?)));
    match silent {
        Some((option, host, error)) => anyhow::bail!("{option} {host}: {error}"),
        None => Ok(()),
    }
}
