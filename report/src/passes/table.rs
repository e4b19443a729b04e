//! The passes as columns.

use super::PassesReport;
use crate::json_of;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table, Values};
use sunglint_radiometry::light_curve::Provenance;
use sunglint_simulator::sightings::{SeenPass, SightingEvent};

/// Which moment of a pass.
type Moment = fn(&SeenPass) -> &SightingEvent;

/// One row a pass.
pub(super) fn table(report: &PassesReport<'_>) -> Table {
    let passes = report.passes;
    let mut table = Table::default();
    let window = report.search.window();
    let conditions = report.search.conditions();
    let provenance = Provenance {
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
        command: "sunglint passes".into(),
        station: report.station.name.clone(),
        target: String::new(),
        inputs: report.inputs.clone(),
        notes: vec![
            format!("brightness: {}", report.law()),
            format!("V counts from {}", report.photometer.zero),
            format!("air: {}", report.photometer.air.describe()),
            "rates, V at the station, Sun and Moon: at the brightest moment; start and end: of what can be seen".into(),
        ],
        ..Provenance::default()
    };
    for (key, value) in [
        ("title", report.title().into()),
        ("from_utc", format_utc(window.from, 3).into()),
        ("to_utc", format_utc(window.to, 3).into()),
        ("min_elevation_deg", json_of(&conditions.min_altitude_deg)),
        ("sun_below_deg", json_of(&conditions.sun_below_deg)),
        ("exposure_s", json_of(&report.photometer.exposure_s)),
        ("provenance", provenance.to_json()),
    ] {
        table.meta.insert(key.into(), value);
    }
    let text = |name: &str, value: &dyn Fn(&SeenPass) -> Option<String>| Column {
        name: name.into(),
        unit: None,
        description: None,
        values: Values::Text(passes.iter().map(value).collect()),
    };
    let number = |name: &str, unit: Option<&str>, value: &dyn Fn(&SeenPass) -> f64| {
        Column::f64(name, unit, passes.iter().map(value).collect())
    };
    let mut columns = vec![
        text("target", &|p| Some(p.target.clone())),
        Column::i64("norad_id", None, passes.iter().map(|p| i64::from(p.norad_id)).collect()),
        text("rise_utc", &|p| p.pass.rises.then(|| format_utc(p.pass.span.from, 3))),
    ];
    let moments: [(&str, Moment); 4] = [
        ("start", |p| &p.start),
        ("culmination", |p| &p.culmination),
        ("brightest", |p| &p.brightest),
        ("end", |p| &p.end),
    ];
    for (name, moment) in moments {
        let of = |p: &SeenPass| moment(p).geometry;
        let named = |what: &str| format!("{name}_{what}");
        columns.extend([
            text(&named("utc"), &|p| Some(format_utc(of(p).epoch, 3))),
            number(&named("altitude_deg"), Some("deg"), &|p| of(p).horizontal.altitude_deg()),
            number(&named("azimuth_deg"), Some("deg"), &|p| of(p).horizontal.azimuth_deg()),
            number(&named("range_m"), Some("m"), &|p| of(p).range_m),
            number(&named("phase_deg"), Some("deg"), &|p| of(p).phase_deg()),
            number(&named("v_mag"), Some("mag"), &|p| finite(moment(p).v_mag)),
        ]);
    }
    let shadow = |p: &SeenPass, entry: bool| {
        let mut changes = p.pass.shadow_changes().into_iter();
        changes.find(|(_, e)| *e == entry).map(|(epoch, _)| format_utc(epoch, 3))
    };
    columns.extend([
        text("set_utc", &|p| p.pass.sets.then(|| format_utc(p.pass.span.to, 3))),
        text("shadow_entry_utc", &|p| shadow(p, true)),
        text("shadow_exit_utc", &|p| shadow(p, false)),
        text("meridian_utc", &|p| p.pass.meridian.first().map(|c| format_utc(c.epoch, 3))),
        number("visible_s", Some("s"), &SeenPass::visible_s),
        number("v_station_mag", Some("mag"), &|p| p.expected.v_station.unwrap_or(f64::NAN)),
        number("sun_altitude_deg", Some("deg"), &|p| p.brightest.sun_altitude_deg),
        number("moon_altitude_deg", Some("deg"), &|p| p.brightest.moon_altitude_deg),
        number("moon_separation_deg", Some("deg"), &|p| p.brightest.moon_separation_deg),
        number("moon_illuminated", None, &|p| p.brightest.moon_illuminated),
        number("azimuth_rate_deg_s", Some("deg / s"), &|p| p.pass.azimuth_rate_deg_s),
        flag("meridian_flip", passes, |p| p.meridian_flip),
        flag("zenith_keyhole", passes, |p| p.keyhole),
    ]);
    for (i, channel) in report.station.channels.iter().enumerate() {
        let found = |p: &SeenPass| p.expected.channels[i];
        let name = &channel.name;
        columns.extend([
            number(&format!("{name}_rate_hz"), Some("Hz"), &|p| found(p).map_or(f64::NAN, |f| f.0)),
            number(&format!("{name}_sigma_hz"), Some("Hz"), &|p| {
                found(p).and_then(|f| f.1.sigma_hz).unwrap_or(f64::NAN)
            }),
            flag(&format!("{name}_saturated"), passes, |p| found(p).is_some_and(|f| f.1.saturated)),
        ]);
    }
    table.columns = columns;
    table
}

fn flag(name: &str, passes: &[SeenPass], holds: impl Fn(&SeenPass) -> bool) -> Column {
    Column {
        name: name.into(),
        unit: None,
        description: None,
        values: Values::Bool(passes.iter().map(|p| Some(holds(p))).collect()),
    }
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::NAN }
}
