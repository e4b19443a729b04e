//! When cameras expose: text, JSON, table, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_calibration::timing::FrameClock;
use sunglint_calibration::timing::{MeasuredTiming, Measurement};
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_numerics::measured::Measured;

const MS: f64 = 1e3;

fn in_ms(value: Measured) -> String {
    format!("{:.1} ± {:.1} ms", MS * value.value, MS * value.sigma)
}

/// The times as text.
pub fn text(measurement: &Measurement) -> String {
    let mut text = String::from("when cameras expose, after the begin that their frames say\n\n");
    for found in &measurement.found {
        let MeasuredTiming { timing, channel, bin_s, telling, most_s, .. } = found;
        let _ = writeln!(text, "  {}", timing.name());
        let _ = writeln!(
            text,
            "    latency          {} (looked for up to {most_s:.2} s either way)",
            in_ms(timing.latency_s)
        );
        let _ = writeln!(
            text,
            "    jitter           {:.1} ms from frame to frame (1 σ)",
            MS * timing.jitter_s
        );
        match timing.row_time_s {
            Some(time) => {
                let _ = writeln!(
                    text,
                    "    rolling shutter  {:.3} ± {:.3} µs a row; the latency is that of the first row",
                    1e6 * time.value,
                    1e6 * time.sigma
                );
            }
            None if found.bands.len() > 3 => {
                text.push_str("    shutter          all rows at once, as far as these frames tell\n");
            }
            None => text.push_str(
                "    shutter          too few rows saw the lamp to tell whether they are read one after the other\n",
            ),
        }
        let _ = writeln!(
            text,
            "    by               channel {channel} in bins of {:.1} ms, {} frames, of which {telling:.0} with a flash's begin or end",
            MS * bin_s,
            timing.frames
        );
    }
    text.push_str(
        "\nuncertainties: 1 σ, against the counter's clock. `sunglint reduce --timing FILE` takes the latency off (--timing-out FILE)\n",
    );
    text
}

#[derive(Serialize)]
struct BandJson {
    row_px: f64,
    latency_s: f64,
    latency_sigma_s: f64,
}

#[derive(Serialize)]
struct CameraJson<'a> {
    name: &'a str,
    instrument: Option<&'a str>,
    binning: [u32; 2],
    window_px: Option<[usize; 2]>,
    clock: &'a FrameClock,
    latency_s: f64,
    latency_sigma_s: f64,
    jitter_s: f64,
    row_time_s: Option<f64>,
    row_time_sigma_s: Option<f64>,
    channel: &'a str,
    bin_s: f64,
    frames: usize,
    telling_frames: f64,
    most_s: f64,
    bands: Vec<BandJson>,
}

#[derive(Serialize)]
struct TimingJson<'a> {
    cameras: Vec<CameraJson<'a>>,
    warnings: &'a [String],
}

/// The frames' light and the counter's as a table, a figure, and the times as JSON.
pub fn product(measurement: &Measurement) -> Product {
    let found = &measurement.found;
    let rows: Vec<_> =
        found.iter().flat_map(|f| f.points.iter().map(move |point| (f, point))).collect();
    let columns = vec![
        Column::text("camera", rows.iter().map(|(f, _)| f.timing.camera.clone()).collect()),
        Column::text(
            "said_utc",
            rows.iter().map(|(_, point)| format_utc_shortest(point.said)).collect(),
        ),
        Column::f64("light", Some("adu"), rows.iter().map(|(_, point)| point.light_adu).collect()),
        Column::f64("counts", Some("ct"), rows.iter().map(|(_, point)| point.counts).collect()),
    ];
    let cameras = found.iter().map(|found| {
        let timing = &found.timing;
        let bands = found.bands.iter().map(|(row, later)| BandJson {
            row_px: rounded(*row),
            latency_s: rounded(later.value),
            latency_sigma_s: rounded(later.sigma),
        });
        CameraJson {
            name: &timing.camera,
            instrument: timing.instrument.as_deref(),
            binning: timing.binning,
            window_px: timing.window_px,
            clock: &timing.clock,
            latency_s: rounded(timing.latency_s.value),
            latency_sigma_s: rounded(timing.latency_s.sigma),
            jitter_s: rounded(timing.jitter_s),
            row_time_s: timing.row_time_s.map(|time| rounded(time.value)),
            row_time_sigma_s: timing.row_time_s.map(|time| rounded(time.sigma)),
            channel: &found.channel,
            bin_s: rounded(found.bin_s),
            frames: timing.frames,
            telling_frames: rounded(found.telling),
            most_s: rounded(found.most_s),
            bands: bands.collect(),
        }
    });
    let json = json_of(&TimingJson { cameras: cameras.collect(), warnings: &measurement.warnings });
    Product {
        name: "timing".into(),
        table: Table { columns, ..Table::default() },
        figure: Some(figure(found)),
        json,
        ..Product::default()
    }
}

/// The frames' light against the counts at the latency that was found: a straight line where it is right.
fn figure(found: &[MeasuredTiming]) -> Figure {
    let panels = found.iter().flat_map(|found| {
        let light: Vec<(f64, f64)> =
            found.points.iter().map(|point| (point.counts, point.light_adu)).collect();
        let counts = Axis::linear(format!("counts of {} within the exposure", found.channel));
        let adu = Axis::linear(format!("mean light of {} in ADU", found.timing.camera));
        let line = Panel::new(counts, adu, vec![Series::dots("frames", 0, light)]);
        let bands: Vec<(f64, f64)> =
            found.bands.iter().map(|(row, later)| (*row, MS * later.value)).collect();
        let rows = (bands.len() > 3).then(|| {
            let mut series = Vec::new();
            if let Some(time) = found.timing.row_time_s {
                let at = |row: f64| (row, MS * (found.timing.latency_s.value + time.value * row));
                let last = found.bands.last().map_or(0.0, |(row, _)| *row);
                series.push(Series::line("fit", 1, vec![at(0.0), at(last)]));
            }
            series.push(Series::dots("bands of rows", 0, bands));
            Panel::new(Axis::linear("row"), Axis::linear("latency in ms"), series)
        });
        std::iter::once(line).chain(rows)
    });
    let title = match found {
        [one] => format!(
            "{}: exposures begin {} later than they say",
            one.timing.camera,
            in_ms(one.timing.latency_s)
        ),
        _ => "When cameras expose".to_owned(),
    };
    Figure { title, panels: panels.collect() }
}
