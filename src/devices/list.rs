//! `sunglint devices list`: what there is, and whether it can be used.

use super::session::{seconds, utc_now};
use crate::output::{Console, OutputArgs};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_drivers::catalogue::{
    Access, Bus, DRIVERS, Driver, Listed, OptionKind, OptionSpec, Plugged, listed, plugged, udev,
};
use sunglint_drivers::clock::Deadline;
use sunglint_formats::{Column, Table};
use sunglint_report::Product;

/// Arguments of `sunglint devices list`.
#[derive(Debug, Args)]
pub struct ListArgs {
    /// Also what this INDI server has, `HOST[:PORT]`; may be given several times
    #[arg(long, value_name = "HOST")]
    pub indi: Vec<String>,
    /// Also USB and HID devices that no driver recognises
    #[arg(short, long)]
    pub all: bool,
    /// The drivers instead: their addresses, options, and what they were tried with
    #[arg(long)]
    pub drivers: bool,
    /// How long an INDI server may take, s
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub timeout_s: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What a server has, or why that is not known.
type Server<'a> = (&'a str, Result<Vec<Listed>, String>);

pub(super) fn run(args: &ListArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    if args.drivers {
        let (product, text) = drivers();
        return args.out.finish(&product, &text, console);
    }
    let timeout = seconds("--timeout-s", args.timeout_s)?;
    let (found, trouble) = plugged();
    for trouble in &trouble {
        console.warn(trouble);
    }
    let is_wanted = |one: &Plugged| args.all || one.bus == Bus::Serial || one.driver().is_some();
    let found: Vec<Plugged> = found.into_iter().filter(is_wanted).collect();
    let ask =
        |host: &str| listed(host, &Deadline::within(timeout)).map_err(|error| error.to_string());
    let servers: Vec<Server<'_>> =
        args.indi.iter().map(|host| (host.as_str(), ask(host))).collect();
    let hint = found.iter().any(|one| one.access == Access::Denied).then(hint);
    let text = text(&found, &servers, hint.as_deref());
    let json = json!({
        "time_utc": utc_now()?,
        "plugged": found.iter().map(plugged_json).collect::<Value>(),
        "indi": servers.iter().map(server_json).collect::<Value>(),
        "trouble": trouble,
        "hint": hint,
    });
    let product =
        Product { name: "devices".into(), table: table(&found), json, ..Product::default() };
    args.out.finish(&product, &text, console)?;
    match servers.into_iter().find_map(|(host, listed)| Some((host, listed.err()?))) {
        Some((host, error)) => anyhow::bail!("--indi {host}: {error}"),
        None => Ok(()),
    }
}

fn hint() -> String {
    format!(
        "to use what is marked `denied`, install the rules as root and plug it in again:\n  \
         sunglint devices udev | sudo tee {}/{}\n  sudo udevadm control --reload\n\
         (serial ports of other makers: join their group, often `dialout`, and log in again)",
        udev::FOLDER,
        udev::FILE
    )
}

fn access(access: Access) -> &'static str {
    match access {
        Access::Granted => "granted",
        Access::Denied => "denied",
        Access::Unknown => "unknown",
    }
}

fn id(found: &Plugged) -> String {
    found.ids.map_or_else(String::new, |[vendor, product]| format!("{vendor:04x}:{product:04x}"))
}

fn text(found: &[Plugged], servers: &[Server<'_>], hint: Option<&str>) -> String {
    let mut text = String::new();
    if found.is_empty() {
        text.push_str("no serial port and no instrument that a driver recognises is plugged in\n");
    }
    for one in found {
        let address = one.address().unwrap_or_else(|| match one.bus {
            Bus::Serial => format!("(DRIVER:{})", one.path),
            _ => "(no driver)".into(),
        });
        let name = one.name.as_deref().unwrap_or("");
        let _ = writeln!(
            text,
            "{:<6} {:<9} {:<28} {address:<32} access {:<8} {name}",
            one.bus.to_string(),
            id(one),
            one.path,
            access(one.access)
        );
    }
    for (host, listed) in servers {
        match listed {
            Ok(devices) if devices.is_empty() => {
                let _ = writeln!(text, "indi   {host} has no device");
            }
            Ok(devices) => {
                for device in devices {
                    let addresses = device.addresses.join("  ");
                    let none = "(no camera, rotator or wheel)";
                    let addresses = if addresses.is_empty() { none } else { &addresses };
                    let _ = writeln!(text, "indi   {:<28} {addresses}", device.name);
                }
            }
            Err(error) => {
                let _ = writeln!(text, "indi   {host}: {error}");
            }
        }
    }
    if let Some(hint) = hint {
        let _ = writeln!(text, "\n{hint}");
    }
    text.push_str("\nsimulated devices need nothing: ");
    let simulated = DRIVERS.into_iter().filter(|driver| driver.simulated).map(|driver| driver.name);
    text.push_str(&simulated.collect::<Vec<_>>().join(", "));
    text.push('\n');
    text
}

fn plugged_json(one: &Plugged) -> Value {
    json!({
        "bus": one.bus.to_string(),
        "path": one.path,
        "usb_id": one.ids.map(|_| id(one)),
        "name": one.name,
        "serial": one.serial,
        "driver": one.driver().map(|driver| driver.name),
        "address": one.address(),
        "access": access(one.access),
    })
}

fn server_json((host, listed): &Server<'_>) -> Value {
    let devices = listed.iter().flatten().map(|device| {
        json!({ "name": device.name, "driver": device.driver, "addresses": device.addresses })
    });
    json!({ "server": host, "devices": devices.collect::<Value>(), "error": listed.as_ref().err() })
}

fn table(found: &[Plugged]) -> Table {
    let column =
        |name, of: fn(&Plugged) -> String| Column::text(name, found.iter().map(of).collect());
    let columns = vec![
        column("bus", |one| one.bus.to_string()),
        column("usb_id", id),
        column("path", |one| one.path.clone()),
        column("name", |one| one.name.clone().unwrap_or_default()),
        column("serial", |one| one.serial.clone().unwrap_or_default()),
        column("address", |one| one.address().unwrap_or_default()),
        column("access", |one| access(one.access).to_owned()),
    ];
    Table { columns, ..Table::default() }
}

/// What values an option takes, in words.
fn takes(spec: &OptionSpec) -> String {
    match spec.kind {
        OptionKind::Number(least, most) => format!("{least} to {most}"),
        OptionKind::Integer(least, most) => format!("whole, {least} to {most}"),
        OptionKind::Flag => "yes or no".into(),
        OptionKind::Pair => "FROM,TO".into(),
        OptionKind::Word(words) => words
            .iter()
            .map(|w| if w.ends_with(':') { format!("{w}NUMBER") } else { (*w).into() })
            .collect::<Vec<_>>()
            .join(", "),
    }
}

fn drivers() -> (Product, String) {
    let mut text = String::new();
    for driver in DRIVERS {
        let _ = writeln!(text, "{}  ({})\n    {}", driver.form(), driver.kind, driver.title);
        let _ = writeln!(text, "    such as {}; tried with {}", driver.place.example, driver.tried);
        for spec in driver.options {
            let default = if spec.default.is_empty() { "none" } else { spec.default };
            let given = format!("--with {}={default}", spec.name);
            let _ = writeln!(text, "    {given:<36} {} ({})", spec.about, takes(spec));
        }
    }
    let column =
        |name, of: fn(&Driver) -> String| Column::text(name, DRIVERS.into_iter().map(of).collect());
    let columns = vec![
        column("driver", |driver| driver.name.to_owned()),
        column("kind", |driver| driver.kind.to_string()),
        column("form", Driver::form),
        column("title", |driver| driver.title.to_owned()),
        column("tried", |driver| driver.tried.to_owned()),
    ];
    let json = DRIVERS.into_iter().map(|driver| {
        let options = driver.options.iter().map(|spec| {
            json!({ "name": spec.name, "takes": takes(spec), "default": spec.default, "about": spec.about })
        });
        json!({
            "driver": driver.name,
            "kind": driver.kind.to_string(),
            "vendor": driver.vendor,
            "title": driver.title,
            "form": driver.form(),
            "example": driver.place.example,
            "simulated": driver.simulated,
            "tried": driver.tried,
            "options": options.collect::<Value>(),
        })
    });
    let json = json!({ "drivers": json.collect::<Value>() });
    let table = Table { columns, ..Table::default() };
    (Product { name: "drivers".into(), table, json, ..Product::default() }, text)
}
