//! `sunglint simulate --active`: what comes back of laser pulses along a pass, beside the sunlight that the same channel counts.

use super::Shown;
use crate::output::{Console, Usage};
use anyhow::bail;
use std::path::{Path, PathBuf};
use sunglint_formats::nearest_names;
use sunglint_radiometry::station::Laser;
use sunglint_report::Product;
use sunglint_report::simulate::active::{ActiveReport, Content, RangeData, range_file};
use sunglint_report::simulate::names;
use sunglint_simulator::pass::{Pass, Simulation};
use sunglint_simulator::ranging::{Returns, Shots};

/// Memory of an epoch, of a laser's returns of an epoch, and what is much of it.
const EPOCH_BYTES: f64 = 8e3;
const LASER_BYTES: f64 = 8e3;
const MUCH_BYTES: f64 = 1e9;

/// Which lasers: those that were named, else all that the station and the scene have.
pub(super) fn lasers<'a>(pass: &'a Pass, names: &[String]) -> anyhow::Result<Vec<&'a Laser>> {
    let all = &pass.station.lasers;
    if all.is_empty() {
        bail!(
            "the station {} has no laser: give [[laser]] with name, wavelength_nm, linewidth_nm, pulse_energy_mj, pulse_length_ns, repetition_rate_hz, divergence_arcsec and beam_radius_m in its station.toml, or in PASS.toml (docs/active.md)",
            pass.station.name
        );
    }
    if names.is_empty() {
        return Ok(all.iter().collect());
    }
    let mut chosen: Vec<&Laser> = Vec::new();
    for name in names {
        let known = || all.iter().map(|l| l.name.as_str());
        let Some(laser) = all.iter().find(|l| l.name == *name) else {
            let near = nearest_names(name, known(), 1);
            let hint = near.first().map_or(String::new(), |n| format!("; did you mean {n}?"));
            bail!(
                "--laser: there is no laser `{name}`; there are {}{hint}",
                known().collect::<Vec<_>>().join(", ")
            );
        };
        if chosen.iter().any(|l| l.name == laser.name) {
            return Err(Usage(format!("--laser: {name} is named twice")).into());
        }
        chosen.push(laser);
    }
    Ok(chosen)
}

/// Content of a file of range data, by its extension.
fn content(path: &Path) -> Option<Content> {
    let extension = path.extension()?.to_string_lossy().to_ascii_lowercase();
    Content::of_extension(&extension)
}

/// Whether a path is one of range data.
pub(super) fn is_range_data(path: &Path) -> bool {
    content(path).is_some()
}

/// Refuses range data of lasers of which nobody said what they need.
pub(super) fn check_ranging(lasers: &[&Laser], console: Console) -> anyhow::Result<()> {
    let keys = "[laser.ranging] after its [[laser]], with station (its name), pad, system and occupancy (its numbers of the ILRS) and normal_point_s (docs/active.md)";
    let without: Vec<&str> =
        lasers.iter().filter(|l| l.ranging.is_none()).map(|l| l.name.as_str()).collect();
    if without.len() == lasers.len() {
        bail!(
            "range data need to know the station: give laser {} a table {keys}",
            without.join(", ")
        );
    }
    for name in without {
        console.warn(&format!("laser {name} is in no range data: it has no {keys}"));
    }
    Ok(())
}

/// Returns of lasers, in all forms.
pub(super) struct Returned {
    ranges: Vec<(PathBuf, Vec<u8>)>,
    warnings: Vec<String>,
    text: String,
    json: serde_json::Value,
    product: Product,
    has_light: bool,
}

/// Warns where a pass is so long that its returns need much memory: they are told of all epochs together.
pub(super) fn warn_of_memory(pass: &Pass, lasers: &[&Laser], console: Console) {
    let epochs = pass.times.len() as f64;
    let bytes =
        epochs * (EPOCH_BYTES + LASER_BYTES * lasers.len() as f64 + 24.0 * pass.bins() as f64);
    if bytes > MUCH_BYTES {
        console.warn(&format!(
            "--active holds the whole pass in memory: about {:.1} GB for {epochs} samples; with fewer of them (--from, --to, --step-s) it needs less",
            1e-9 * bytes
        ));
    }
}

/// The lasers' returns along a simulated pass, and range data in files, drawn from a seed.
pub(super) fn of(
    simulation: &Simulation<'_>,
    lasers: &[&Laser],
    (files, seed): (&[PathBuf], u64),
) -> anyhow::Result<Returned> {
    let all: Vec<Returns<'_>> =
        lasers.iter().map(|l| Returns::new(simulation, l)).collect::<Result<_, _>>()?;
    let report = ActiveReport { simulation, returns: &all };
    let [name, ..] = names(simulation.pass);
    let (mut text, mut json) = (report.text(), report.json());
    let mut ranges = Vec::new();
    if !files.is_empty() {
        let mut data = Vec::new();
        for returns in &all {
            let Some(ranging) = &returns.laser.ranging else { continue };
            let shots = Shots::draw(simulation, returns, ranging, seed)?;
            data.push(RangeData::new(simulation.pass, returns, ranging, shots)?);
        }
        text.extend(data.iter().map(RangeData::text));
        json["range_data"] = data.iter().map(RangeData::json).collect();
        for path in files {
            let file = range_file(&data, content(path).unwrap_or(Content::Both))?;
            ranges.push((path.clone(), file.into_bytes()));
        }
    }
    Ok(Returned {
        ranges,
        warnings: all.iter().flat_map(Returns::concerns).collect(),
        text,
        json,
        product: report.product(&name)?,
        // A figure has something to show where light comes back.
        has_light: all.iter().any(|r| r.photons.iter().any(|n| *n > 0.0)),
    })
}

/// Adds the lasers' returns to a simulated pass that is ready to be shown: they come first, the sunlight's tables after them.
pub(super) fn add(shown: &mut Shown, returned: Returned, console: Console) {
    for warning in &returned.warnings {
        console.warn(warning);
    }
    shown.text.push_str(&returned.text);
    let mut passive = std::mem::take(&mut shown.product);
    let mut product = returned.product;
    product.json = passive.json.clone();
    if let serde_json::Value::Object(document) = &mut product.json {
        document.insert("active".into(), returned.json);
    }
    let others = std::mem::take(&mut passive.others);
    product.others.push(passive);
    product.others.extend(others);
    shown.product = product;
    shown.ranges = returned.ranges;
    shown.has_light = returned.has_light;
}
