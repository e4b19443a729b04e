//! Endmembers of a curve: text, JSON, table and figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::unmix::column_name;
use sunglint_formats::text::counted;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_inference::endmembers::FoundEndmembers;
use sunglint_radiometry::light_curve::Input;

/// The time of an endmember's sample, as text.
fn time(found: &FoundEndmembers, k: usize) -> String {
    found.time_of(k).map_or(String::new(), format_utc_shortest)
}

fn title(found: &FoundEndmembers) -> String {
    format!("Endmembers in the light of {}", found.target)
}

/// All forms of the result.
pub fn product(found: &FoundEndmembers) -> Product {
    Product {
        name: "endmembers".into(),
        table: table(found),
        figure: figure(found),
        json: json(found),
        ..Product::default()
    }
}

#[derive(Serialize)]
struct Provenance<'a> {
    program: &'a str,
    command: &'a str,
    target: &'a str,
    inputs: [&'a Input; 1],
}

/// Table with a row for each band.
pub fn table(found: &FoundEndmembers) -> Table {
    let order = found.order();
    let mut table = Table::default();
    table.meta.insert("title".into(), title(found).into());
    table.meta.insert(
        "bands".into(),
        json_of(&order.iter().map(|b| &found.bands[*b]).collect::<Vec<_>>()),
    );
    table.meta.insert(
        "provenance".into(),
        json_of(&Provenance {
            program: concat!("sunglint ", env!("CARGO_PKG_VERSION")),
            command: "sunglint analyse endmembers",
            target: &found.target,
            inputs: [&found.input],
        }),
    );
    let middles = order.iter().map(|b| found.middles_nm[*b]).collect();
    table.columns.push(Column::f64("wavelength_nm", Some("nm"), middles));
    for k in 0..found.count() {
        let spectrum = found.spectrum(k);
        let near = found.nearest(k).map_or(String::new(), |(name, angle)| {
            format!("; {:.2}° from {name}", angle.to_degrees())
        });
        let said =
            format!("reflection factor, largest 1, of the sample of {}{near}", time(found, k));
        let values = order.iter().map(|b| spectrum[*b].max(0.0)).collect();
        table.columns.push(
            Column::f64(format!("found_{}_reflectance", k + 1), None, values).described(&said),
        );
    }
    table
}

/// Figure of each endmember, with the known one that is nearest beside it.
pub fn figure(found: &FoundEndmembers) -> Option<Figure> {
    let order = found.order();
    let points = |values: &[f64]| -> Vec<(f64, f64)> {
        order.iter().map(|b| (found.middles_nm[*b], values[*b])).collect()
    };
    let x = || Axis::linear("wavelength (nm)");
    let panels = (0..found.count()).map(|k| {
        let own = found.spectrum(k);
        let mut series = vec![Series::dots(format!("found {}", k + 1), k, points(&own))];
        if let Some((name, angle)) = found.nearest(k) {
            let m = found.known.iter().position(|n| n == name).unwrap_or(0);
            let label = format!("{name}, {:.2}° away", angle.to_degrees());
            series.push(Series::line(label, k, points(&found.scaled(m, k))));
        }
        Panel::new(x(), Axis::linear("of its largest").from_to(0.0, 1.1), series)
    });
    let panels: Vec<Panel> = panels.collect();
    (!panels.is_empty()).then(|| Figure { title: title(found), panels })
}

/// Text of the list.
pub fn text(found: &FoundEndmembers) -> String {
    let mut text = format!(
        "{}: {} found in {} of {} ({})\n",
        title(found),
        found.count(),
        counted(found.time.len(), "sample"),
        counted(found.bands.len(), "band"),
        found.targets.stopped
    );
    let _ = writeln!(text, "  number  new in it  sample                    nearest known");
    for (k, target) in found.targets.targets.iter().enumerate() {
        let near = found
            .nearest(k)
            .map_or("-".into(), |(name, angle)| format!("{name}, {:.2}° away", angle.to_degrees()));
        let _ =
            writeln!(text, "  {:>6}  {:>9.2e}  {:<24}  {near}", k + 1, target.rest, time(found, k));
    }
    let _ = writeln!(
        text,
        "  they leave {:.1e} of a sample at most; {:.1e} is taken for noise",
        found.targets.left, found.noise
    );
    text += "  Each is a sample: a pure material only if that sample shows one alone.\n";
    text
}

#[derive(Serialize)]
struct NearestJson {
    name: String,
    angle_deg: f64,
}

#[derive(Serialize)]
struct EndmemberJson {
    time_utc: String,
    rest: f64,
    eta: f64,
    spectrum: Vec<f64>,
    nearest: Option<NearestJson>,
}

#[derive(Serialize)]
struct EndmembersJson<'a> {
    target: &'a str,
    samples: usize,
    bands: usize,
    wavelengths_nm: Vec<f64>,
    endmembers: Vec<EndmemberJson>,
    stopped: &'a str,
    left: f64,
    noise: f64,
    warnings: &'a [String],
}

/// Summary with its documented keys.
pub fn json(found: &FoundEndmembers) -> Value {
    let endmembers = (0..found.count()).map(|k| {
        let target = &found.targets.targets[k];
        let nearest = found.nearest(k).map(|(name, angle)| NearestJson {
            name: column_name(name),
            angle_deg: rounded(angle.to_degrees()),
        });
        EndmemberJson {
            time_utc: time(found, k),
            rest: rounded(target.rest),
            eta: rounded(target.eta),
            spectrum: found.spectrum(k).iter().map(|v| rounded(*v)).collect(),
            nearest,
        }
    });
    json_of(&EndmembersJson {
        target: &found.target,
        samples: found.time.len(),
        bands: found.bands.len(),
        wavelengths_nm: found.middles_nm.iter().map(|v| rounded(*v)).collect(),
        endmembers: endmembers.collect(),
        stopped: found.targets.stopped,
        left: rounded(found.targets.left),
        noise: rounded(found.noise),
        warnings: &found.warnings,
    })
}
