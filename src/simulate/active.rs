//! `sunglint simulate --active`: what comes back of laser pulses along a pass, beside the sunlight that the same channel counts.

use super::Shown;
use crate::output::{Console, Usage};
use anyhow::bail;
use sunglint_formats::nearest_names;
use sunglint_radiometry::station::Laser;
use sunglint_report::Product;
use sunglint_report::simulate::active::ActiveReport;
use sunglint_simulator::pass::{Pass, Simulation};
use sunglint_simulator::ranging::Returns;

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

/// Adds the lasers' returns to a simulated pass that is ready to be shown: they come first, the sunlight's tables after them.
pub(super) fn add(
    shown: &mut Shown,
    simulation: &Simulation<'_>,
    lasers: &[&Laser],
    console: Console,
) -> anyhow::Result<()> {
    let all: Vec<Returns<'_>> =
        lasers.iter().map(|l| Returns::new(simulation, l)).collect::<Result<_, _>>()?;
    for warning in all.iter().flat_map(Returns::concerns) {
        console.warn(&warning);
    }
    let report = ActiveReport { simulation, returns: &all };
    shown.text.push_str(&report.text());
    let passive = std::mem::take(&mut shown.product);
    let mut product = report.product(&passive.name)?;
    product.json = passive.json.clone();
    if let serde_json::Value::Object(document) = &mut product.json {
        document.insert("active".into(), report.json());
    }
    let Product { others, .. } = passive.clone();
    product.others.push(Product { others: Vec::new(), ..passive });
    product.others.extend(others);
    shown.product = product;
    // A figure has something to show where light comes back.
    shown.has_light = all.iter().any(|r| r.photons.iter().any(|n| *n > 0.0));
    Ok(())
}
