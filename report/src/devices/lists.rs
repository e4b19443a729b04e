//! Lists of devices that are plugged in, and of drivers.

use crate::{Product, json_of};
use hifitime::Epoch;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_drivers::catalogue::{
    Access, Bus, DRIVERS, Driver, Inventory, OptionKind, OptionSpec, Plugged, ServerAsked, udev,
};
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table};

/// Returns what to do where a device may not be used, if there is one.
fn hint_of(found: &[Plugged]) -> Option<String> {
    found.iter().any(|one| one.access == Access::Denied).then(hint)
}

/// Returns what is there as text.
pub fn inventory_text(inventory: &Inventory) -> String {
    let hint = hint_of(&inventory.plugged);
    text(inventory, hint.as_deref())
}

#[derive(Serialize)]
struct InventoryJson<'a> {
    time_utc: String,
    plugged: Vec<PluggedJson<'a>>,
    indi: Vec<ServerJson<'a>>,
    alpaca: Vec<ServerJson<'a>>,
    trouble: &'a [String],
    hint: Option<String>,
}

/// Returns what is there as a table of what is plugged in, and as JSON; `time` is when it was asked.
pub fn inventory(inventory: &Inventory, time: Epoch) -> Product {
    let found = &inventory.plugged;
    let json = json_of(&InventoryJson {
        time_utc: format_utc(time, 3),
        plugged: found.iter().map(plugged_json).collect(),
        indi: inventory.servers.iter().map(server_json).collect(),
        alpaca: inventory.alpaca.iter().map(server_json).collect(),
        trouble: &inventory.faults,
        hint: hint_of(found),
    });
    Product { name: "devices".into(), table: table(found), json, ..Product::default() }
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

fn text(inventory: &Inventory, hint: Option<&str>) -> String {
    let found = &inventory.plugged;
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
    let servers = inventory.servers.iter().map(|server| ("indi  ", server));
    for (kind, ServerAsked { host, devices }) in
        servers.chain(inventory.alpaca.iter().map(|server| ("alpaca", server)))
    {
        match devices {
            Ok(devices) if devices.is_empty() => {
                let _ = writeln!(text, "{kind} {host} has no device");
            }
            Ok(devices) => {
                for device in devices {
                    let addresses = device.addresses.join("  ");
                    let none = "(no camera, rotator, wheel, focuser or mount)";
                    let addresses = if addresses.is_empty() { none } else { &addresses };
                    let _ = writeln!(text, "{kind} {:<28} {addresses}", device.name);
                }
            }
            Err(error) => {
                let _ = writeln!(text, "{kind} {host}: {error}");
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

#[derive(Serialize)]
struct PluggedJson<'a> {
    bus: String,
    path: &'a str,
    usb_id: Option<String>,
    name: Option<&'a str>,
    serial: Option<&'a str>,
    driver: Option<&'a str>,
    address: Option<String>,
    access: &'a str,
}

fn plugged_json(one: &Plugged) -> PluggedJson<'_> {
    PluggedJson {
        bus: one.bus.to_string(),
        path: &one.path,
        usb_id: one.ids.map(|_| id(one)),
        name: one.name.as_deref(),
        serial: one.serial.as_deref(),
        driver: one.driver().map(|driver| driver.name),
        address: one.address(),
        access: access(one.access),
    }
}

#[derive(Serialize)]
struct ListedJson<'a> {
    name: &'a str,
    driver: Option<&'a str>,
    addresses: &'a [String],
}

#[derive(Serialize)]
struct ServerJson<'a> {
    server: &'a str,
    devices: Vec<ListedJson<'a>>,
    error: Option<String>,
}

fn server_json(ServerAsked { host, devices: listed }: &ServerAsked) -> ServerJson<'_> {
    let devices = listed.iter().flatten().map(|device| ListedJson {
        name: &device.name,
        driver: device.driver.as_deref(),
        addresses: &device.addresses,
    });
    ServerJson {
        server: host,
        devices: devices.collect(),
        error: listed.as_ref().err().map(ToString::to_string),
    }
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

/// Returns the values that an option takes, in words.
fn takes(spec: &OptionSpec) -> String {
    match spec.kind {
        OptionKind::Number(least, most) => format!("{least} to {most}"),
        OptionKind::Integer(least, most) => format!("whole, {least} to {most}"),
        OptionKind::Flag => "yes or no".into(),
        OptionKind::Pair => "FROM,TO".into(),
        OptionKind::Utc => "a time in UTC".into(),
        OptionKind::Text => "a name".into(),
        OptionKind::Word(words) => words
            .iter()
            .map(|w| if w.ends_with(':') { format!("{w}NUMBER") } else { (*w).into() })
            .collect::<Vec<_>>()
            .join(", "),
    }
}

/// Returns every driver with its address and options, as text.
pub fn drivers_text() -> String {
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
    text
}

#[derive(Serialize)]
struct OptionJson<'a> {
    name: &'a str,
    takes: String,
    default: &'a str,
    about: &'a str,
}

#[derive(Serialize)]
struct DriverJson<'a> {
    driver: &'a str,
    kind: String,
    vendor: &'a str,
    title: &'a str,
    form: String,
    example: &'a str,
    simulated: bool,
    tried: &'a str,
    options: Vec<OptionJson<'a>>,
}

#[derive(Serialize)]
struct DriversJson<'a> {
    drivers: Vec<DriverJson<'a>>,
}

/// Returns every driver as a table and as JSON.
pub fn drivers() -> Product {
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
        let options = driver.options.iter().map(|spec| OptionJson {
            name: spec.name,
            takes: takes(spec),
            default: spec.default,
            about: spec.about,
        });
        DriverJson {
            driver: driver.name,
            kind: driver.kind.to_string(),
            vendor: driver.vendor,
            title: driver.title,
            form: driver.form(),
            example: driver.place.example,
            simulated: driver.simulated,
            tried: driver.tried,
            options: options.collect(),
        }
    });
    let json = json_of(&DriversJson { drivers: json.collect() });
    let table = Table { columns, ..Table::default() };
    Product { name: "drivers".into(), table, json, ..Product::default() }
}
