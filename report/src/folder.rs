//! A reduced folder of frames: text, table, figure, JSON.

use crate::Product;
use crate::plot::{Axis, Figure, Panel, Series};
use glam::DVec2;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_calibration::reduction::folder::{Folder, Shape, StarsUse, TargetFrame};
use sunglint_calibration::reduction::sight::{Sight, SightedObject};
use sunglint_formats::time::format_utc;
use sunglint_formats::wcs::Equatorial;
use sunglint_formats::{Column, ParseError, Table};

/// Name of the light curve's file in a folder.
pub const CURVE: &str = "light_curve";
/// Name of the file of magnitudes in a folder.
pub const MAGNITUDES: &str = "magnitudes";

/// The light curve as the other commands read it.
///
/// # Errors
/// A curve that cannot be written as a table.
pub fn curve(folder: &Folder, target: &str) -> Result<Product, ParseError> {
    let curve = folder.light_curve(target);
    let first = curve.samples.time.first().copied();
    let panels = curve.channels.iter().filter_map(|channel| {
        let first = first?;
        let points: Vec<(f64, f64)> = curve
            .samples
            .time
            .iter()
            .zip(&channel.rate_hz)
            .filter(|(_, rate)| rate.is_finite())
            .map(|(time, rate)| ((*time - first).to_seconds(), *rate))
            .collect();
        (!points.is_empty()).then(|| {
            Panel::new(
                Axis::linear(format!("seconds after {} UTC", format_utc(first, 1))),
                Axis::linear(format!("{}, ADU/s", channel.name)),
                vec![Series::dots(channel.name.clone(), 0, points)],
            )
        })
    });
    let panels: Vec<Panel> = panels.collect();
    let figure = (!panels.is_empty())
        .then(|| Figure { title: format!("{target}: rates without a zero point"), panels });
    Ok(Product { name: CURVE.into(), table: curve.to_table()?, figure, ..Product::default() })
}

/// The magnitudes as the other commands read them; `None` without any.
pub fn magnitudes(folder: &Folder, target: &str) -> Option<Product> {
    struct Line<'a> {
        time: hifitime::Epoch,
        exposure_s: f64,
        filter: &'a str,
        magnitude: f64,
        sigma_mag: f64,
        own_sigma_mag: f64,
        zero_sigma_mag: f64,
        sky_deg: Option<Equatorial>,
        sight: Option<Sight>,
    }
    let mut lines = Vec::new();
    for frame in &folder.frames {
        let Some(zero) = frame.zero_point else { continue };
        let mut line = |time, exposure_s, [magnitude, sigma]: [Option<f64>; 2], sky_deg, sight| {
            let (Some(magnitude), Some(sigma_mag)) = (magnitude, sigma) else { return };
            let own = (sigma_mag * sigma_mag - zero.sigma_mag * zero.sigma_mag).max(0.0).sqrt();
            lines.push(Line {
                time,
                exposure_s,
                filter: &frame.filter,
                magnitude,
                sigma_mag,
                own_sigma_mag: own,
                zero_sigma_mag: zero.sigma_mag,
                sky_deg,
                sight,
            });
        };
        if frame.along.is_empty() {
            let exposure = frame.dwell_s.unwrap_or(frame.exposure_s);
            let magnitude = [frame.magnitude, frame.sigma_mag];
            line(frame.time, exposure, magnitude, frame.sky_deg, frame.sight);
        }
        for part in &frame.along {
            line(part.time, part.exposure_s, [part.magnitude, part.sigma_mag], None, part.sight);
        }
    }
    let first = lines.first()?.time;
    let number = |name: &str, unit, f: &dyn Fn(&Line<'_>) -> f64| {
        Column::f64(name, Some(unit), lines.iter().map(f).collect())
    };
    let mut table = Table {
        columns: vec![
            Column::text("time_utc", lines.iter().map(|l| format_utc(l.time, 6)).collect()),
            number("exposure_s", "s", &|l| l.exposure_s),
            Column::text("filter", lines.iter().map(|l| l.filter.to_owned()).collect()),
            number("magnitude", "mag", &|l| l.magnitude),
            number("sigma_mag", "mag", &|l| l.sigma_mag),
            number("photon_sigma_mag", "mag", &|l| l.own_sigma_mag),
            number("zero_point_sigma_mag", "mag", &|l| l.zero_sigma_mag),
            number("ra_deg", "deg", &|l| l.sky_deg.map_or(f64::NAN, |s| s.ra_deg)),
            number("dec_deg", "deg", &|l| l.sky_deg.map_or(f64::NAN, |s| s.dec_deg)),
        ],
        ..Table::default()
    };
    table.meta.insert("target".into(), target.into());
    let mut provenance = folder.provenance.clone();
    // That of the rates beside them.
    provenance.notes.clear();
    table.meta.insert("provenance".into(), provenance.to_json());
    if let Some(object) = &folder.object {
        let sight = |name: &str, unit, f: &dyn Fn(&Line<'_>, &Sight) -> f64| {
            let value = |l: &Line<'_>| l.sight.map_or(f64::NAN, |sight| f(l, &sight));
            number(name, unit, &value)
        };
        table.columns.extend([
            sight("range_km", "km", &|_, s| s.range_km),
            sight("phase_angle_deg", "deg", &|_, s| s.phase_angle_deg),
            sight("altitude_deg", "deg", &|_, s| s.altitude_deg),
            sight("azimuth_deg", "deg", &|_, s| s.azimuth_deg),
            sight("magnitude_1000km", "mag", &|l, s| s.standard(l.magnitude)),
        ]);
        table.meta.insert("object".into(), object.object.clone().into());
        table.meta.insert("norad_id".into(), object.norad_id.into());
        table.meta.insert("elements_age_days".into(), object.elements_age_days.into());
    }
    if let Some(stars) = &folder.stars {
        table.meta.insert("zero_point".into(), origin(stars).into());
    }
    let mut filters: Vec<&str> = lines.iter().map(|l| l.filter).collect();
    filters.sort_unstable();
    filters.dedup();
    let panels = filters.iter().map(|filter| {
        let points: Vec<(f64, f64)> = lines
            .iter()
            .filter(|l| l.filter == *filter)
            .map(|l| ((l.time - first).to_seconds(), l.magnitude))
            .collect();
        let mut axis = Axis::linear(format!("{filter}, mag"));
        axis.inverted = true;
        Panel::new(
            Axis::linear(format!("seconds after {} UTC", format_utc(first, 1))),
            axis,
            vec![Series::dots((*filter).to_owned(), 0, points)],
        )
    });
    let figure = Figure { title: format!("{target}: magnitudes"), panels: panels.collect() };
    Some(Product { name: MAGNITUDES.into(), table, figure: Some(figure), ..Product::default() })
}

/// Who reports observations, for [`score`].
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Observer {
    /// Electronic mail.
    pub email: String,
    /// ORCID, several separated by commas.
    pub orcid: String,
    /// Telescope and detector, in words.
    pub instrument: String,
}

/// Magnitudes with their object as the IAU CPS's Satellite Constellation Observations Repository (SCORE) takes them: CSV with all of its columns
/// (data format of July 2025). Empty cells are what is not known here; `None` without an object or a magnitude.
///
/// A magnitude of a frame is that of its filter; the time is the middle of the exposure.
///
/// # Errors
/// None in practice: text into memory.
pub fn score(folder: &Folder, observer: &Observer) -> Result<Option<Vec<u8>>, csv::Error> {
    let Some(object) = &folder.object else { return Ok(None) };
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record([
        "satellite_name",
        "norad_cat_id",
        "observation_time_utc",
        "observation_time_uncertainty_sec",
        "apparent_magnitude",
        "apparent_magnitude_uncertainty",
        "observer_latitude_deg",
        "observer_longitude_deg",
        "observer_altitude_m",
        "limiting_magnitude",
        "instrument",
        "observing_mode",
        "observing_filter",
        "observer_email",
        "observer_orcid",
        "satellite_right_ascension_deg",
        "satellite_declination_deg",
        "sigma_2_ra",
        "sigma_ra_sigma_dec",
        "sigma_2_dec",
        "range_to_satellite_km",
        "range_to_satellite_uncertainty_km",
        "range_rate_of_satellite_km_per_sec",
        "range_rate_of_satellite_uncertainty_km_per_sec",
        "comments",
        "data_archive_link",
        "mpc_code",
    ])?;
    let mut any = false;
    let [latitude, longitude, height] = object.site;
    let comments = folder.stars.as_ref().map(origin).unwrap_or_default();
    for frame in &folder.frames {
        let (Some(magnitude), Some(sigma), Some(sight)) =
            (frame.magnitude, frame.sigma_mag, frame.sight)
        else {
            continue;
        };
        any = true;
        let place = |k: usize| {
            frame.sky_deg.map_or(String::new(), |sky| format!("{:.6}", sky.to_array()[k]))
        };
        let half = 0.5 * frame.dwell_s.unwrap_or(frame.exposure_s);
        let empty = String::new;
        writer.write_record([
            object.object.clone(),
            object.norad_id.to_string(),
            format_utc(frame.time, 3),
            format!("{half:.3}"),
            format!("{magnitude:.3}"),
            format!("{sigma:.3}"),
            format!("{latitude:.6}"),
            format!("{longitude:.6}"),
            format!("{height:.1}"),
            empty(),
            observer.instrument.clone(),
            "CMOS/CCD".to_owned(),
            frame.filter.clone(),
            observer.email.clone(),
            observer.orcid.clone(),
            place(0),
            place(1),
            empty(),
            empty(),
            empty(),
            format!("{:.3}", sight.range_km),
            empty(),
            format!("{:.5}", sight.range_rate_km_s),
            empty(),
            comments.clone(),
            empty(),
            empty(),
        ])?;
    }
    let bytes = writer.into_inner().map_err(|error| error.into_error().into());
    bytes.map(|bytes| any.then_some(bytes))
}

/// Why the forms of a reduced folder cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FolderFilesError {
    /// A light curve that the schema does not hold.
    #[error(transparent)]
    Curve(#[from] ParseError),
    /// The document cannot be written.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// All forms of a reduced folder. A single file is the light curve: magnitudes where there is a zero point, else rates; a folder has all tables.
///
/// # Errors
/// The errors of [`product`] and [`curve`].
pub fn whole(folder: &Folder, target: &str) -> Result<Product, FolderFilesError> {
    let mut product = product(folder, target)?;
    let curve = curve(folder, target)?;
    let frames = Product {
        name: product.name.clone(),
        table: std::mem::take(&mut product.table),
        ..Product::default()
    };
    let (first, others) = match magnitudes(folder, target) {
        Some(magnitudes) => (magnitudes, vec![curve, frames]),
        None => (curve, vec![frames]),
    };
    (product.name, product.table, product.figure) = (first.name, first.table, first.figure);
    product.others.extend(others);
    Ok(product)
}

/// Where the zero points come from, in words.
fn origin(stars: &StarsUse) -> String {
    let bands = stars.bands.iter().map(|band| {
        let system = match band.system {
            Some(system) => format!("{system:?}"),
            None => "of an unknown system".into(),
        };
        let term = band.term.map_or_else(String::new, |term| {
            let colour = band.colour.as_deref().unwrap_or("colour");
            format!(
                ", colour term {:.3} ± {:.3} in {colour}, the target's colour taken as {:.2} ± {:.2}",
                term.value, term.sigma, term.target_colour, term.target_sigma
            )
        });
        format!("{}: {} ({system}{term})", band.filter, band.column)
    });
    format!("stars of {}: {}", stars.list, bands.collect::<Vec<_>>().join("; "))
}

#[derive(Serialize)]
struct Row<'a> {
    time_utc: String,
    along_utc: Vec<String>,
    #[serde(flatten)]
    frame: &'a TargetFrame,
}

/// A number of frames of some kind.
#[derive(Serialize)]
struct Count<'a> {
    what: &'a str,
    count: usize,
}

fn counts<K: AsRef<str>>(map: &std::collections::BTreeMap<K, usize>) -> Vec<Count<'_>> {
    map.iter().map(|(what, count)| Count { what: what.as_ref(), count: *count }).collect()
}

#[derive(Serialize)]
struct Document<'a> {
    target: &'a str,
    chosen_by: &'a str,
    motion_px_per_s: Option<DVec2>,
    is_instrumental: bool,
    used: Vec<Count<'a>>,
    left_out: Vec<Count<'a>>,
    left_out_files: &'a [[String; 2]],
    notes: Vec<Count<'a>>,
    stars: Option<&'a StarsUse>,
    object: Option<&'a SightedObject>,
    frames: Vec<Row<'a>>,
}

/// The frames in all their forms: the table has instrumental magnitudes.
///
/// # Errors
/// None in practice: a document of numbers and texts.
pub fn product(folder: &Folder, target: &str) -> Result<Product, serde_json::Error> {
    let row = |frame| {
        let frame: &TargetFrame = frame;
        Row {
            time_utc: format_utc(frame.time, 4),
            along_utc: frame.along.iter().map(|part| format_utc(part.time, 4)).collect(),
            frame,
        }
    };
    let document = Document {
        target,
        chosen_by: &folder.chosen_by,
        motion_px_per_s: folder.motion_px_per_s,
        is_instrumental: !folder.has_magnitudes(),
        used: counts(&folder.used),
        left_out: counts(&folder.left_out),
        left_out_files: &folder.left_out_files,
        stars: folder.stars.as_ref(),
        object: folder.object.as_ref(),
        notes: counts(&folder.notes),
        frames: folder.frames.iter().map(row).collect(),
    };
    let json = serde_json::to_value(document)?;
    Ok(Product { name: "frames".into(), table: table(folder), json, ..Product::default() })
}

fn table(folder: &Folder) -> Table {
    let frames = &folder.frames;
    let number = |name: &str, unit, f: &dyn Fn(&TargetFrame) -> Option<f64>| {
        Column::f64(name, unit, frames.iter().map(|x| f(x).unwrap_or(f64::NAN)).collect())
    };
    let text = |name: &str, f: &dyn Fn(&TargetFrame) -> String| {
        Column::text(name, frames.iter().map(f).collect())
    };
    Table {
        columns: vec![
            text("time_utc", &|f| format_utc(f.time, 4)),
            number("exposure_s", Some("s"), &|f| Some(f.exposure_s)),
            number("dwell_s", Some("s"), &|f| f.dwell_s),
            text("filter", &|f| f.filter.clone()),
            text("shape", &|f| {
                match f.shape {
                    Some(Shape::Point) => "point",
                    Some(Shape::Streak) => "streak",
                    None => "none",
                }
                .into()
            }),
            number("column_px", Some("pix"), &|f| f.place_px.map(|p| p[0])),
            number("row_px", Some("pix"), &|f| f.place_px.map(|p| p[1])),
            number("length_px", Some("pix"), &|f| Some(f.length_px)),
            number("significance", None, &|f| Some(f.significance)),
            number("rate_adu_per_s", Some("adu / s"), &|f| f.rate_adu_per_s),
            number("sigma_adu_per_s", Some("adu / s"), &|f| f.sigma_adu_per_s),
            number("ra_deg", Some("deg"), &|f| f.sky_deg.map(|s| s.ra_deg)),
            number("dec_deg", Some("deg"), &|f| f.sky_deg.map(|s| s.dec_deg)),
            number("zero_point_mag", Some("mag"), &|f| f.zero_point.map(|z| z.mag)),
            number("zero_point_sigma_mag", Some("mag"), &|f| f.zero_point.map(|z| z.sigma_mag)),
            number("zero_point_stars", None, &|f| f.zero_point.map(|z| z.stars as f64)),
            number("instrumental_mag", Some("mag"), &|f| f.instrumental_mag),
            number("instrumental_sigma_mag", Some("mag"), &|f| f.instrumental_sigma_mag),
            text("remark", &|f| f.remark.clone()),
            text("file", &|f| f.file.clone()),
        ],
        ..Table::default()
    }
}

/// The frames as text.
pub fn text(folder: &Folder, name: &str) -> String {
    let mut text = format!("{name}\n");
    let used: Vec<String> = folder.used.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
    let _ = writeln!(text, "frames used: {}; left out: {}", used.join(", "), folder.summary());
    for [file, why] in folder.left_out_files.iter().take(10) {
        let _ = writeln!(text, "  {file}: {why}");
    }
    for (note, n) in &folder.notes {
        let _ = writeln!(text, "  note ({n} of the frames): {note}");
    }
    let _ = writeln!(text, "target chosen by {}", folder.chosen_by);
    if let Some(DVec2 { x, y }) = folder.motion_px_per_s {
        let _ = writeln!(text, "motion {x:.4} columns and {y:.4} rows a second");
    }
    let has = folder.has_magnitudes();
    let head = if has { "mag       zero point (stars)" } else { "instrumental mag" };
    let _ = writeln!(
        text,
        "  time (middle), UTC        filter   shape   length       ADU/s        ±  {head}"
    );
    for frame in &folder.frames {
        let shape = match frame.shape {
            Some(Shape::Point) => "point",
            Some(Shape::Streak) => "streak",
            None => "-",
        };
        let rate = frame.rate_adu_per_s.map_or_else(|| "-".into(), |r| format!("{r:.4e}"));
        let sigma = frame.sigma_adu_per_s.map_or_else(|| "-".into(), |r| format!("{r:.1e}"));
        let pair = |m: Option<f64>, s: Option<f64>| match (m, s) {
            (Some(m), Some(s)) => format!("{m:.3} ± {s:.3}"),
            _ => "-".into(),
        };
        let magnitude = if has {
            let zero = frame.zero_point.map_or_else(
                || "-".into(),
                |z| format!("{:.3} ± {:.3} ({})", z.mag, z.sigma_mag, z.stars),
            );
            format!("{:<15}  {zero}", pair(frame.magnitude, frame.sigma_mag))
        } else {
            pair(frame.instrumental_mag, frame.instrumental_sigma_mag)
        };
        let _ = writeln!(
            text,
            "  {:<25} {:<8} {shape:<7} {:6.1} {rate:>11} {sigma:>8}  {magnitude}  {}",
            format_utc(frame.time, 3),
            frame.filter,
            frame.length_px,
            frame.remark
        );
    }
    if let Some(stars) = &folder.stars {
        let _ = writeln!(text, "zero points: {}", origin(stars));
    }
    if !has {
        text.push_str("rates and magnitudes are instrumental: no zero point is known\n");
    }
    text
}
