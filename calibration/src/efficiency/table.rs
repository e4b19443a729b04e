//! Efficiencies as a table, and as the curve that a station's file takes.

use super::{Components, Efficiency, EfficiencyFlags, Row};
use serde_json::json;
use std::fmt::Write as _;
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::{Column, Table};

/// `wavelength_nm`, `efficiency`, `sigma_efficiency` and its components, what they were made of, `flags`.
pub fn to_table(efficiency: &Efficiency) -> Table {
    let rows = &efficiency.rows;
    let all = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let part = |name: &str, about: &str, value: fn(&Components) -> f64| {
        Column::f64(name, None, all(&|r| value(&r.components))).described(about)
    };
    let whole = |r: &Row| i64::try_from(r.readings).unwrap_or(i64::MAX);
    let columns = vec![
        Column::f64("wavelength_nm", Some("nm"), all(&|r| r.wavelength_nm)),
        Column::f64("efficiency", None, all(&|r| r.efficiency)).described("counts per photon"),
        Column::f64("sigma_efficiency", None, all(&|r| r.components.total()))
            .described("standard uncertainty, all components"),
        part("sigma_counts", "by photons counted", |c| c.counts),
        part("sigma_photodiode", "by the photodiode's voltage", |c| c.photodiode),
        part("sigma_wavelength", "by the monochromator's wavelength", |c| c.wavelength),
        part("sigma_linearity", "by dead time or gain", |c| c.linearity),
        part("sigma_responsivity", "by the photodiode's responsivity", |c| c.responsivity),
        part("sigma_load", "by the photodiode's load", |c| c.load),
        part("sigma_geometry", "by areas and distances", |c| c.geometry),
        part("sigma_transmissions", "by splitter and filters", |c| c.transmissions),
        part("sigma_drift", "by change of the rig between its reference readings", |c| c.drift),
        Column::f64("photons_hz", Some("Hz"), all(&|r| r.photons_hz))
            .described("photons on the sensor"),
        Column::f64("rate_hz", Some("Hz"), all(&|r| r.rate_hz))
            .described("the sensor's rate, linear, without the dark"),
        Column::i64("readings", None, rows.iter().map(whole).collect()),
        Column::i64("flags", None, rows.iter().map(|r| i64::from(r.flags.bits())).collect()),
    ];
    let notes: Vec<String> = efficiency.notes.iter().map(ToString::to_string).collect();
    let meta = [
        ("kind", json!("efficiency")),
        ("notes", json!(notes)),
        ("flag_bits", bit_names::<EfficiencyFlags>()),
    ];
    Table { meta: meta.into_iter().map(|(key, value)| (key.to_owned(), value)).collect(), columns }
}

/// `wavelength_nm,efficiency` as a station's file takes it, and the wavelengths that are left out of it: those without an efficiency, and those outside 0 to 1, which no
/// station takes. `name` stands in its notes.
pub fn to_curve(efficiency: &Efficiency, name: &str) -> (String, Vec<f64>) {
    let good = |row: &&Row| (0.0..=1.0).contains(&row.efficiency);
    let out: Vec<f64> =
        efficiency.rows.iter().filter(|row| !good(row)).map(|row| row.wavelength_nm).collect();
    let mut text = format!("# Efficiency of {name}, counts per photon, measured.\n");
    if !out.is_empty() {
        let list: Vec<String> = out.iter().map(|nm| format!("{nm}")).collect();
        let _ = writeln!(
            text,
            "# Left out, as they have no efficiency from 0 to 1 (see the table beside): {} nm.",
            list.join(", ")
        );
    }
    text.push_str("wavelength_nm,efficiency\n");
    for row in efficiency.rows.iter().filter(good) {
        let _ = writeln!(text, "{},{}", row.wavelength_nm, row.efficiency);
    }
    (text, out)
}
