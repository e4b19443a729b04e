//! `sunglint devices serve`.

use crate::interrupt::{Hangup, listen};
use crate::output::{Console, Usage};
use anyhow::{Context as _, bail};
use clap::Args;
use serde::Serialize;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::simulated::served::{Port, Pty, ServeError, Served, Visit};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::toml::Document;
use sunglint_virtual::goniometer::options::Options;
use sunglint_virtual::goniometer::wires::{bench_toml, wires};

/// Arguments of `sunglint devices serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// The simulated device: sim-tmcl, sim-apt, sim-ophir, sim-scpi, sim-camera, sim-rotator, sim-wheel; or a virtual goniometer, of which all devices are served (docs/lab-run.md)
    #[arg(value_name = "ADDRESS|GONIOMETER.toml")]
    pub address: String,
    /// Options of the device, such as latency_s=0.02; `devices list --drivers` names all
    #[arg(long = "with", value_name = "NAME=VALUE")]
    pub options: Vec<String>,
    /// Serve on a serial port (a pty), under this name; without a name it says which it is. What is served when nothing is asked. A goniometer's devices are ports in the folder PATH
    #[arg(long, value_name = "PATH", num_args = 0..=1, conflicts_with = "tcp")]
    pub pty: Option<Option<PathBuf>>,
    /// Serve on a TCP port of this computer, or of another of its addresses; port 0 takes a free one. A goniometer's devices are at PORT, PORT + 1 and so on
    #[arg(long, value_name = "[ADDRESS:]PORT")]
    pub tcp: Option<String>,
    /// Write the bench of a goniometer for `brdf run --bench`, with the devices at their ports
    #[arg(short, long, value_name = "BENCH.toml")]
    pub output: Option<PathBuf>,
    /// Overwrite a bench that is there
    #[arg(long, requires = "output")]
    pub force: bool,
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

/// A device of a bench.
#[derive(Serialize)]
struct OnBench {
    name: &'static str,
    /// Address of its driver, or of the hands' port.
    address: String,
    with: Vec<String>,
}

#[derive(Serialize)]
struct Bench<'a> {
    goniometer: &'a str,
    devices: Vec<OnBench>,
}

/// Address and port of `--tcp`.
fn place(tcp: &str) -> anyhow::Result<(String, u16)> {
    let place = if tcp.contains(':') { tcp.to_owned() } else { format!("127.0.0.1:{tcp}") };
    let parts = place.rsplit_once(':').and_then(|(host, port)| Some((host, port.parse().ok()?)));
    let Some((host, port)) = parts else {
        let text = format!("--tcp: found {place}, expected [ADDRESS:]PORT, such as 5025");
        return Err(Usage(text).into());
    };
    Ok((host.to_owned(), port))
}

/// Warns of ports that others reach.
fn warn(ports: &[SocketAddr], console: Console) {
    let open: Vec<String> =
        ports.iter().filter(|at| !at.ip().is_loopback()).map(ToString::to_string).collect();
    if !open.is_empty() {
        let what = if open.len() == 1 { "the device" } else { "the devices" };
        console.warn(&format!(
            "{} can be reached from other computers, and anybody there may use {what}",
            open.join(", ")
        ));
    }
}

/// Says who comes and goes.
fn visits(name: &str, console: Console) -> impl FnMut(Visit) {
    move |visit| match visit {
        Visit::Came(host) => console.say(&format!("{name}: {host} is there")),
        Visit::Left(host) => console.say(&format!("{name}: {host} has gone")),
        Visit::SentAway(host) => {
            console.say(&format!("{name}: {host} was sent away: one host at a time"));
        }
        _ => {}
    }
}

/// Token that Ctrl-C sets.
fn until_stopped() -> anyhow::Result<Cancel> {
    let cancel = Cancel::new();
    let token = cancel.clone();
    listen(Hangup::Ends, move || token.cancel())?;
    Ok(cancel)
}

/// Serves until Ctrl-C, which is its good end.
pub(super) fn run(args: &ServeArgs, console: Console) -> anyhow::Result<()> {
    if Path::new(&args.address).extension().is_some_and(|ending| ending == "toml") {
        return goniometer(args, console);
    }
    if args.output.is_some() {
        let text = "-o: only a goniometer's file (GONIOMETER.toml) makes a bench";
        return Err(Usage(text.into()).into());
    }
    let mut served = Served::new(Address::parse(&args.address, &args.options)?)?;
    let cancel = until_stopped()?;
    let name = served.name();
    if let Some(tcp) = &args.tcp {
        let (host, port) = place(tcp)?;
        let port = Port::listen(&format!("{host}:{port}"))?;
        let at = port.at();
        warn(&[at], console);
        let text = format!("{name} at tcp:{at}; Ctrl-C ends");
        console.result(&text, &AtPort { device: name, tcp: at.to_string() })?;
        return Ok(served.at_port(&port, &cancel, visits(name, console))?);
    }
    let link = args.pty.clone().flatten();
    let mut pty = Pty::open(link.as_deref())?;
    let shown = link.map_or_else(|| pty.port().to_owned(), |link| link.display().to_string());
    let text = format!("{name} at {shown}; Ctrl-C ends");
    console.result(&text, &OnPty { device: name, pty: pty.port(), path: &shown })?;
    Ok(served.on_pty(&mut pty, &cancel)?)
}

/// Stops all devices when one of them ends.
struct Ends<'a>(&'a Cancel);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

/// A port of either kind.
enum End {
    Pty(Pty),
    Tcp(Port),
}

/// Serves all devices of a virtual goniometer, each at a port of its own.
fn goniometer(args: &ServeArgs, console: Console) -> anyhow::Result<()> {
    if !args.options.is_empty() {
        let text = "--with: a goniometer has its options in its file (docs/lab-run.md)";
        return Err(Usage(text.into()).into());
    }
    let options = Options::read(&Document::read(Path::new(&args.address))?)?;
    let tcp = args.tcp.as_deref().map(place).transpose()?;
    let folder = args.pty.clone().flatten();
    if let Some(folder) = &folder {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot make the folder", folder.display()))?;
    }
    // Absolute: a run may begin elsewhere.
    let folder = folder.map(std::path::absolute).transpose().context("--pty")?;
    let cancel = until_stopped()?;
    let (mut devices, mut ends) = (Vec::new(), Vec::new());
    for (k, wire) in wires(&options)?.into_iter().enumerate() {
        let (end, at) = match &tcp {
            Some((host, first)) => {
                // The number of a port that does not exist is refused by the system.
                let number = if *first == 0 { 0 } else { u64::from(*first) + k as u64 };
                let port = Port::listen(&format!("{host}:{number}"))?;
                let at = format!("tcp:{}", port.at());
                (End::Tcp(port), at)
            }
            None => {
                let link = folder.as_ref().map(|folder| folder.join(wire.name));
                let pty = Pty::open(link.as_deref())?;
                let at = link.map_or_else(|| pty.port().to_owned(), |l| l.display().to_string());
                (End::Pty(pty), at)
            }
        };
        let address = wire.driver.map_or(at.clone(), |driver| format!("{driver}:{at}"));
        devices.push(OnBench { name: wire.name, address, with: wire.with });
        ends.push((Served::on_line(wire.name, wire.line), end));
    }
    let ports: Vec<SocketAddr> = (ends.iter())
        .filter_map(|(_, end)| match end {
            End::Tcp(port) => Some(port.at()),
            End::Pty(_) => None,
        })
        .collect();
    warn(&ports, console);
    if let Some(path) = &args.output {
        let driven = devices.iter().filter(|device| device.name != "hands");
        let driven: Vec<_> =
            driven.map(|device| (device.name, device.address.clone(), &device.with[..])).collect();
        let overwrite = if args.force { Overwrite::Allow } else { Overwrite::Refuse };
        write_file(path, bench_toml(&options, &driven).as_bytes(), overwrite)?;
    }
    let lines = devices.iter().map(|device| format!("{}: {}\n", device.name, device.address));
    let text = format!("{}Ctrl-C ends", lines.collect::<String>());
    console.result(&text, &Bench { goniometer: &args.address, devices })?;
    // The first failure ends all.
    std::thread::scope(|scope| {
        let threads = ends.into_iter().map(|(mut served, mut end)| {
            let (cancel, name) = (&cancel, served.name());
            let thread = scope.spawn(move || -> Result<(), ServeError> {
                // A device that breaks off, in whatever way, ends all.
                let _ends = Ends(cancel);
                match &mut end {
                    End::Pty(pty) => served.on_pty(pty, cancel),
                    End::Tcp(port) => served.at_port(port, cancel, visits(name, console)),
                }
            });
            (name, thread)
        });
        let threads: Vec<_> = threads.collect();
        for (name, thread) in threads {
            match thread.join() {
                Ok(ended) => ended?,
                Err(_) => bail!("{name}: the simulated device broke down (a fault of sunglint)"),
            }
        }
        Ok(())
    })
}
