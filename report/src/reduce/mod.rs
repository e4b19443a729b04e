//! Report of a reduction: per visit and channel how many samples there are and what each rule removed.

pub(crate) mod figure;

use crate::{Product, json_of, rounded};
use hifitime::Epoch;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use sunglint_calibration::counts::SkyTally;
use sunglint_calibration::reduction::frames::CameraNight;
use sunglint_calibration::reduction::tags::TagSummary;
use sunglint_calibration::reduction::{Reduced, Stay, Used, Visited};
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, ParseError, Table};
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::light_curve::{ChannelCurve, Flags};
use sunglint_radiometry::station::Station;

/// Name of the summary's files.
const SUMMARY: &str = "summary";

/// A channel of a visit in numbers.
pub struct ChannelLine {
    /// Name.
    pub name: String,
    /// Exposures of its own.
    pub samples: u64,
    /// Those with a rate.
    pub with_rate: u64,
    /// Those without a flag.
    pub clean: u64,
    /// The median rate, Hz (ADU/s of a camera).
    pub median_hz: Option<f64>,
    /// Number of samples with a rate whose sky goes as in the camera's frames, and of those on a line between two looks at a sky that changed.
    pub sky: [u64; 2],
    /// Number of samples with each flag.
    pub flags: BTreeMap<String, u64>,
}

impl ChannelLine {
    fn of(channel: &ChannelCurve, skies: &BTreeMap<String, SkyTally>) -> Self {
        let mut line = Self {
            name: channel.name.clone(),
            samples: 0,
            with_rate: 0,
            clean: 0,
            median_hz: None,
            sky: skies.get(&channel.name).map_or([0; 2], |sky| [sky.carried, sky.on_line()]),
            flags: BTreeMap::new(),
        };
        let mut rates = Vec::new();
        for (rate, flags) in channel.rate_hz.iter().zip(&channel.flags) {
            if flags.contains(Flags::NOT_SAMPLED) {
                continue;
            }
            line.samples += 1;
            line.clean += u64::from(flags.is_empty());
            if rate.is_finite() {
                line.with_rate += 1;
                rates.push(*rate);
            }
            for (name, _) in flags.iter_names() {
                *line.flags.entry(name.to_lowercase()).or_default() += 1;
            }
        }
        rates.sort_by(f64::total_cmp);
        line.median_hz = rates.get(rates.len() / 2).copied();
        line
    }
}

/// A visit in numbers.
pub struct VisitLine {
    /// The stay.
    pub stay: Stay,
    /// First and last sample.
    pub time: Option<[Epoch; 2]>,
    /// Lowest and highest true zenith angle, deg, where the target's place is known.
    pub zenith_deg: Option<Interval>,
    /// Channels.
    pub channels: Vec<ChannelLine>,
}

impl VisitLine {
    /// Makes the lines of a visit.
    pub fn of(visited: &Visited) -> Self {
        let samples = &visited.linear.samples;
        let zenith_deg = samples.zenith_deg.as_ref().map(|zeniths| {
            let low = zeniths.iter().copied().fold(f64::INFINITY, f64::min);
            Interval::new(low, zeniths.iter().copied().fold(f64::NEG_INFINITY, f64::max))
        });
        Self {
            stay: visited.stay.clone(),
            time: samples.time.first().zip(samples.time.last()).map(|(a, b)| [*a, *b]),
            zenith_deg,
            channels: visited
                .linear
                .channels
                .iter()
                .map(|channel| ChannelLine::of(channel, &visited.skies))
                .collect(),
        }
    }
}

/// Names of the files that visits may become in a folder.
pub fn file_names(stays: &[Stay], raw: bool) -> Vec<String> {
    let on = stays.iter().filter(|stay| stay.target.on);
    let of = |stay: &Stay| {
        let name = stay.file_name();
        ["ecsv", "png", "svg"]
            .iter()
            .flat_map(|extension| {
                [format!("{name}.{extension}"), format!("{name}_frames.{extension}")]
            })
            .chain(raw.then(|| format!("{name}_raw.ecsv")))
            .collect::<Vec<_>>()
    };
    on.flat_map(of).chain([format!("{SUMMARY}.ecsv")]).collect()
}

/// Curves and frames of a visit; with `raw` also the rates as they were counted.
///
/// # Errors
/// A curve that cannot be written as a table.
pub fn products(
    visited: &Visited,
    station: &Station,
    raw: bool,
) -> Result<Vec<Product>, ParseError> {
    let name = visited.stay.file_name();
    let figure = figure::curves(visited, station);
    let mut products = vec![Product {
        name: name.clone(),
        table: visited.linear.to_table()?,
        figure: (!figure.panels.is_empty()).then_some(figure),
        ..Product::default()
    }];
    if let Some(raw) = visited.raw.as_ref().filter(|_| raw) {
        let name = format!("{name}_raw");
        products.push(Product { name, table: raw.to_table()?, ..Product::default() });
    }
    products.extend(figure::rings(visited).map(|gallery| Product {
        name: format!("{name}_frames"),
        gallery: Some(gallery),
        ..Product::default()
    }));
    Ok(products)
}

/// The reduction in all its forms.
pub fn product(night: &Reduced, visits: &[VisitLine], session: &str, station: &str) -> Product {
    Product {
        name: SUMMARY.into(),
        table: table(visits),
        json: json(night, visits, session, station),
        ..Product::default()
    }
}

/// The reduction as text.
pub fn text(night: &Reduced, visits: &[VisitLine], session: &str, station: &str) -> String {
    let mut text = format!("session {session}, reduced with station {station}\n");
    for camera in &night.cameras {
        let _ = write!(text, "\n{}", camera_text(camera));
    }
    for counter in &night.counters {
        let summary = &counter.summary;
        let _ = write!(
            text,
            "\ncounter {}: {} bins, {} of no visit, {} without length, {} overlapping; {} pieces off the targets\n",
            counter.counter,
            summary.bins,
            summary.outside,
            summary.without_length,
            summary.overlapping,
            counter.off.pieces().len()
        );
        if let Some(tags) = &counter.tags {
            let _ = writeln!(text, "  {}", tags_text(tags));
        }
    }
    for visit in visits {
        let time = visit.time.map_or_else(String::new, |[from, to]| {
            format!(", {} to {}", format_utc(from, 1), format_utc(to, 1))
        });
        let zenith = match visit.zenith_deg {
            Some(Interval { low, high }) => format!("zenith angle {low:.1}° to {high:.1}°"),
            None => "no place known: no zenith angle".into(),
        };
        let _ = writeln!(
            text,
            "\n{} (visit {}){time}; {zenith}",
            visit.stay.target.name, visit.stay.number
        );
        let _ = writeln!(text, "  channel     samples  with a rate    clean       median  flags");
        for line in &visit.channels {
            let skies = ["sky carried", "sky on a line"].into_iter().zip(line.sky);
            let skies = skies.filter(|(_, count)| *count > 0).map(|(how, n)| format!("{how} {n}"));
            let flags = line.flags.iter().map(|(flag, count)| format!("{flag} {count}"));
            let flags: Vec<String> = flags.chain(skies).collect();
            let median = line.median_hz.map_or_else(|| "-".into(), |hz| format!("{hz:.4e}"));
            let _ = writeln!(
                text,
                "  {:<10} {:>8} {:>12} {:>8} {:>12}  {}",
                line.name,
                line.samples,
                line.with_rate,
                line.clean,
                median,
                flags.join(", ")
            );
        }
    }
    text.push_str(
        "\nsamples without a rate stay in the curve as nan, each with the flag that says why\n",
    );
    text
}

fn camera_text(camera: &CameraNight) -> String {
    let tally = &camera.tally;
    let Used { darks: [darks, other_darks], bias, flats: [flats, other_flats], refused, .. } =
        camera.sensor;
    let sensor = match (darks, bias) {
        (0, 0) if !camera.from_library.is_empty() => {
            format!("{} bad pixels, no calibration frames of its own", camera.bad_pixels)
        }
        (0, 0) => "no dark frames: no mask, no dark subtracted".to_owned(),
        (0, bias) => format!("no dark frames: no mask; {bias} bias frames subtracted"),
        (darks, _) => format!("{} bad pixels by {darks} dark frames", camera.bad_pixels),
    };
    let sensor = match flats {
        0 => sensor,
        flats => format!("{sensor}; {flats} flats"),
    };
    let sensor = match camera.from_library.as_slice() {
        [] => sensor,
        from => format!("{sensor}; from the library: {}", from.join(", ")),
    };
    let sensor = match camera.to_library.as_slice() {
        [] => sensor,
        to => format!("{sensor}; added to the library: {}", to.join(", ")),
    };
    let sensor = match camera.settings {
        0 | 1 => sensor,
        n => format!("{n} settings of the camera, each calibrated by itself: {sensor}"),
    };
    let sensor = match other_darks {
        0 => sensor,
        n => format!(
            "{sensor}; {n} dark frames left out: other exposure, gain, temperature or window"
        ),
    };
    let sensor = match other_flats {
        0 => sensor,
        n => format!("{sensor}; {n} flats left out: other gain, filter or window"),
    };
    let sensor = match refused {
        0 => sensor,
        n => format!(
            "{sensor}; {n} frames of calibration visits left out: of another kind by their headers, or flats off their level"
        ),
    };
    let rules = [
        ("too small or large", tally.rejected_area),
        ("ragged", tally.rejected_fill),
        ("long", tally.rejected_aspect),
        ("sharp", tally.rejected_sharp),
        ("wide", tally.rejected_wide),
        ("too far off", tally.rejected_offset),
    ];
    let rules: Vec<String> = rules.iter().map(|(rule, count)| format!("{rule} {count}")).collect();
    let [low, high] = fwhm_range(camera);
    let [largest, inner, outer] = camera.aperture_px;
    let smallest = camera.smallest_aperture_px;
    let apertures = if largest - smallest < 0.05 {
        format!("aperture {largest:.1} px, annulus {inner:.1} to {outer:.1} px")
    } else {
        format!(
            "apertures of {smallest:.1} to {largest:.1} px that follow them, annulus {:.1} to {:.1} times as large",
            inner / largest,
            outer / largest
        )
    };
    let widths =
        format!("points of {low:.1} to {high:.1} px at half their maximum, {apertures}\n  ");
    format!(
        "camera {}: {} frames on targets, {} of no target, {} beyond their visit; {sensor}\n  {widths}{} without a target, {} ambiguous, {} with another source in the aperture; sources left out: {}\n  planes without a rate: saturated {}, off the edge {}, masked {}, no background {}\n",
        camera.camera,
        tally.frames,
        camera.outside,
        camera.partly,
        tally.undetected,
        tally.ambiguous,
        tally.crowded,
        rules.join(", "),
        tally.saturated,
        tally.edge,
        tally.masked,
        tally.no_background
    )
}

/// The narrowest and the widest points of a camera's visits, px.
fn fwhm_range(camera: &CameraNight) -> [f64; 2] {
    let low = camera.fwhm_px.iter().copied().fold(f64::INFINITY, f64::min);
    [low, camera.fwhm_px.iter().copied().fold(0.0, f64::max)]
}

/// The reduction as a table: a row for each visit and channel.
pub fn table(visits: &[VisitLine]) -> Table {
    let names: Vec<&'static str> = Flags::all().iter_names().map(|(name, _)| name).collect();
    let rows: Vec<(&VisitLine, &ChannelLine)> = visits
        .iter()
        .flat_map(|visit| visit.channels.iter().map(move |line| (visit, line)))
        .collect();
    let whole = |value: &dyn Fn(&ChannelLine) -> u64| {
        rows.iter().map(|(_, line)| i64::try_from(value(line)).unwrap_or(i64::MAX)).collect()
    };
    let text =
        |value: &dyn Fn(&VisitLine) -> String| rows.iter().map(|(visit, _)| value(visit)).collect();
    let mut columns = vec![
        Column::text("target", text(&|v| v.stay.target.name.clone())),
        Column::i64("visit", None, rows.iter().map(|(v, _)| i64::from(v.stay.number)).collect()),
        Column::text("from_utc", text(&|v| format_utc_shortest(v.stay.from))),
        Column::text("channel", rows.iter().map(|(_, line)| line.name.clone()).collect()),
        Column::i64("samples", None, whole(&|line| line.samples)),
        Column::i64("with_rate", None, whole(&|line| line.with_rate)),
        Column::i64("clean", None, whole(&|line| line.clean)),
        Column::f64(
            "median_rate_hz",
            Some("Hz"),
            rows.iter().map(|(_, line)| line.median_hz.unwrap_or(f64::NAN)).collect(),
        ),
    ];
    columns.push(Column::i64("sky_carried", None, whole(&|line| line.sky[0])));
    columns.push(Column::i64("sky_on_line", None, whole(&|line| line.sky[1])));
    for name in names {
        let name = name.to_lowercase();
        let count = |line: &ChannelLine| line.flags.get(&name).copied().unwrap_or(0);
        columns.push(Column::i64(name.clone(), None, whole(&count)));
    }
    Table { columns, ..Table::default() }
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    name: &'a str,
    samples: u64,
    with_rate: u64,
    clean: u64,
    median_rate_hz: Option<f64>,
    sky_carried: u64,
    sky_on_line: u64,
    flags: &'a BTreeMap<String, u64>,
}

#[derive(Serialize)]
struct VisitJson<'a> {
    target: &'a str,
    visit: u32,
    file: String,
    from_utc: String,
    to_utc: String,
    channels: Vec<ChannelJson<'a>>,
}

#[derive(Serialize)]
struct CameraJson<'a> {
    name: &'a str,
    frames: u64,
    outside: u64,
    partly: u64,
    fwhm_px: [f64; 2],
    aperture_px: [f64; 3],
    smallest_aperture_px: f64,
    undetected: u64,
    ambiguous: u64,
    crowded: u64,
    failed: usize,
    settings: usize,
    dark_frames: usize,
    other_dark_frames: usize,
    bias_frames: usize,
    flats: usize,
    other_flats: usize,
    refused_calibration_frames: usize,
    without_light: u64,
    shared: u64,
    bad_pixels: usize,
}

#[derive(Serialize)]
struct CounterJson<'a> {
    name: &'a str,
    bins: u64,
    outside: u64,
    overlapping: u64,
    off_target_pieces: usize,
    torn_bytes: u64,
    tags: Option<TagsJson<'a>>,
}

#[derive(Serialize)]
struct ReducedJson<'a> {
    session: &'a str,
    station: &'a str,
    visits: Vec<VisitJson<'a>>,
    cameras: Vec<CameraJson<'a>>,
    counters: Vec<CounterJson<'a>>,
    warnings: &'a [String],
}

/// The reduction as a JSON document.
pub fn json(night: &Reduced, visits: &[VisitLine], session: &str, station: &str) -> Value {
    let visits = visits.iter().map(|visit| {
        let channels = visit.channels.iter().map(|line| ChannelJson {
            name: &line.name,
            samples: line.samples,
            with_rate: line.with_rate,
            clean: line.clean,
            median_rate_hz: line.median_hz.map(rounded),
            sky_carried: line.sky[0],
            sky_on_line: line.sky[1],
            flags: &line.flags,
        });
        VisitJson {
            target: &visit.stay.target.name,
            visit: visit.stay.number,
            file: format!("{}.ecsv", visit.stay.file_name()),
            from_utc: format_utc_shortest(visit.stay.from),
            to_utc: format_utc_shortest(visit.stay.to),
            channels: channels.collect(),
        }
    });
    let cameras = night.cameras.iter().map(|camera| {
        let tally = &camera.tally;
        CameraJson {
            name: &camera.camera,
            frames: tally.frames,
            outside: camera.outside,
            partly: camera.partly,
            fwhm_px: fwhm_range(camera).map(rounded),
            aperture_px: camera.aperture_px.map(rounded),
            smallest_aperture_px: rounded(camera.smallest_aperture_px),
            undetected: tally.undetected,
            ambiguous: tally.ambiguous,
            crowded: tally.crowded,
            failed: camera.failed.len(),
            settings: camera.settings,
            dark_frames: camera.sensor.darks[0],
            other_dark_frames: camera.sensor.darks[1],
            bias_frames: camera.sensor.bias,
            flats: camera.sensor.flats[0],
            other_flats: camera.sensor.flats[1],
            refused_calibration_frames: camera.sensor.refused,
            without_light: camera.without_light,
            shared: camera.shared,
            bad_pixels: camera.bad_pixels,
        }
    });
    let counters = night.counters.iter().map(|counter| CounterJson {
        name: &counter.counter,
        bins: counter.summary.bins,
        outside: counter.summary.outside,
        overlapping: counter.summary.overlapping,
        off_target_pieces: counter.off.pieces().len(),
        torn_bytes: counter.torn_bytes,
        tags: counter.tags.as_ref().map(tags_json),
    });
    json_of(&ReducedJson {
        session,
        station,
        visits: visits.collect(),
        cameras: cameras.collect(),
        counters: counters.collect(),
        warnings: &night.warnings,
    })
}

fn tags_text(tags: &TagSummary) -> String {
    format!(
        "raw tags: {} records, {} of {} stretches not used; bins linearised by them {}, that differ {}, beyond them {}, not all timed {}, in unused stretches {}",
        tags.records,
        tags.stretches[1],
        tags.stretches[0],
        tags.used,
        tags.differ,
        tags.beyond,
        tags.incomplete,
        tags.distrusted
    )
}

#[derive(Serialize)]
struct TagsJson<'a> {
    records: u64,
    torn_bytes: u64,
    zero_records: u64,
    stretches: usize,
    unused_stretches: usize,
    bins_used: u64,
    bins_differ: u64,
    bins_beyond: u64,
    bins_incomplete: u64,
    bins_distrusted: u64,
    channels_without: &'a [String],
}

fn tags_json(tags: &TagSummary) -> TagsJson<'_> {
    TagsJson {
        records: tags.records,
        torn_bytes: tags.cut[0],
        zero_records: tags.cut[1],
        stretches: tags.stretches[0],
        unused_stretches: tags.stretches[1],
        bins_used: tags.used,
        bins_differ: tags.differ,
        bins_beyond: tags.beyond,
        bins_incomplete: tags.incomplete,
        bins_distrusted: tags.distrusted,
        channels_without: &tags.without,
    }
}
