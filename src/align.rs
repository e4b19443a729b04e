//! `sunglint align`: the fields of the fibres on the camera image, from the stars of one or more sessions.

use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use crate::reduce::{FrameArgs, station};
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use image::{Rgba, RgbaImage};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_calibration::alignment::{FieldFit, FieldMap, FieldPoint, FitOptions, fit_field};
use sunglint_calibration::reduction::counts::{CountOptions, Fibres, gate};
use sunglint_calibration::reduction::{ReduceOptions, Stay, reduce_with};
use sunglint_formats::session::{Session, TargetKind};
use sunglint_formats::{Column, Table};
use sunglint_numerics::progress::Progress as _;
use sunglint_radiometry::station::Station;
use sunglint_report::plot::gallery::{Gallery, Key, Tile};
use sunglint_report::plot::{RGBColor, viridis};
use sunglint_report::{Product, rounded};

/// Arguments of `sunglint align`.
#[derive(Debug, Args)]
pub struct AlignArgs {
    /// Sessions with stars that wandered over the fibres' fields
    #[arg(required = true, value_name = "SESSION")]
    pub sessions: Vec<PathBuf>,
    /// Side of a cell of the measured map, px
    #[arg(long, value_name = "PX", default_value_t = 4.0, allow_negative_numbers = true)]
    pub cell_px: f64,
    /// Let the field be turned against the frame
    #[arg(long)]
    pub rotation: bool,
    /// How frames are measured.
    #[command(flatten)]
    pub frames: FrameArgs,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Write the fields for `reduce --fibre`: a TOML file
    #[arg(long, value_name = "FILE")]
    pub fibre_out: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A channel's field.
struct Field {
    channel: String,
    fit: FieldFit,
    map: FieldMap,
    stars: usize,
    points: usize,
}

/// Fits the fields.
///
/// # Errors
/// Sessions or options that cannot be used; no channel whose field could be fitted; a result that cannot be written.
pub fn run(args: &AlignArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if !(args.cell_px.is_finite() && args.cell_px > 0.0) {
        bail!("--cell-px is {}, expected a length above 0", args.cell_px);
    }
    let first = Session::open(&args.sessions[0])?;
    let station = station(&args.station, &first)?;
    let (points, stars, mut warnings) = args.points(&station, console)?;
    let mut fields = Vec::new();
    let options = FitOptions { rotation: args.rotation, background: true, robust: true };
    for (channel, points) in points {
        match fit_field(&points, &options) {
            Ok(fit) => {
                let map = FieldMap::new(&points, &fit, args.cell_px);
                fields.push(Field {
                    channel,
                    stars: fit.amplitudes_hz.len(),
                    points: points.len(),
                    fit,
                    map,
                });
            }
            Err(error) => warnings.push(format!("channel {channel}: {error}")),
        }
    }
    for warning in &warnings {
        console.warn(warning);
    }
    if fields.is_empty() {
        bail!(
            "no field could be fitted from {} stars: stars must be seen by a camera and a counter at once, at places that differ by the field's width",
            stars.len()
        );
    }
    let mut others = Vec::new();
    if let Some(path) = &args.fibre_out {
        others.push((path.clone(), fibre_file(&fields).into_bytes()));
    }
    let product = product(&fields, &station, &warnings);
    args.out.finish_with(&product, others, &text(&fields, &station), console)
}

type Points = BTreeMap<String, Vec<FieldPoint>>;

impl AlignArgs {
    /// Rates of the stars by channel, the stars' names, and warnings.
    fn points(
        &self,
        station: &Station,
        console: Console,
    ) -> anyhow::Result<(Points, Vec<String>, Vec<String>)> {
        let mut counts = CountOptions::default();
        counts.bins.gate = gate(None, false);
        let options = ReduceOptions {
            frames: self.frames.options(station)?,
            counts,
            fibres: Fibres::new(),
            // A star beside the fibre is what shows the field's rim.
            off_sigmas: None,
            target: None,
        };
        let mut points = Points::new();
        let mut stars: Vec<String> = Vec::new();
        let mut warnings = Vec::new();
        let progress = Bar::new(console);
        progress.begin("frames and bins", None);
        for path in &self.sessions {
            let session = Session::open(path)?;
            let night = session.manifest().start_utc;
            let mut each =
                |channels: &[sunglint_calibration::counts::CountChannel],
                 stay: &Stay,
                 sample: &sunglint_calibration::counts::Sample| {
                    if stay.target.target_kind != TargetKind::Star {
                        return;
                    }
                    // Air and clouds change between visits: each has an amplitude of its own.
                    let name = format!("{} {} {night}", stay.target.name, stay.number);
                    let star = stars.iter().position(|known| *known == name).unwrap_or_else(|| {
                        stars.push(name);
                        stars.len() - 1
                    });
                    for (number, channel) in channels.iter().enumerate() {
                        if channel.fibre.is_some()
                            && let Some(point) = FieldPoint::of(sample, number, star)
                        {
                            points.entry(channel.name.clone()).or_default().push(point);
                        }
                    }
                };
            let reduced = reduce_with(&session, station, &options, &progress, &mut each)
                .with_context(|| format!("session {}", path.display()))?;
            warnings.extend(reduced.warnings);
        }
        progress.end();
        Ok((points, stars, warnings))
    }
}

fn fibre_file(fields: &[Field]) -> String {
    let mut text = String::from(
        "# The fields of the fibres on the camera image, as `sunglint align` fitted them: for `sunglint reduce --fibre`,\n# or for `fibre_offset_px` and `fibre_sigma_px` of the station's counters.\n",
    );
    for field in fields {
        let fibre = field.fit.fibre();
        let [x, y, u, v, _] = field.fit.uncertainties();
        let _ = write!(
            text,
            "\n[fibre.{}]\noffset_px = [{:.4}, {:.4}]\nsigma_px = [{:.4}, {:.4}]\noffset_uncertainty_px = [{x:.4}, {y:.4}]\nsigma_uncertainty_px = [{u:.4}, {v:.4}]\n",
            field.channel,
            fibre.offset_px[0],
            fibre.offset_px[1],
            fibre.sigma_px[0],
            fibre.sigma_px[1]
        );
    }
    text
}

fn text(fields: &[Field], station: &Station) -> String {
    let mut text = format!(
        "fields of the fibres of {} on the camera image, px from the sensor's middle\n\n",
        station.name
    );
    let _ = writeln!(
        text,
        "  channel     stars   points        column           row       sigma column      sigma row    scatter  station has"
    );
    for field in fields {
        let fit = &field.fit;
        let fibre = fit.fibre();
        let [x, y, u, v, _] = fit.uncertainties();
        let with = |value: f64, sigma: f64| format!("{value:.2} ± {sigma:.2}");
        let known = match station.channel(&field.channel).map(|c| &c.detector) {
            Some(sunglint_radiometry::station::Detector::Counter(counter)) => counter.fibre,
            _ => None,
        };
        let known = known.map_or_else(
            || "-".to_owned(),
            |f| {
                format!(
                    "{:.2}, {:.2}; {:.2}, {:.2}",
                    f.offset_px[0], f.offset_px[1], f.sigma_px[0], f.sigma_px[1]
                )
            },
        );
        let _ = writeln!(
            text,
            "  {:<10} {:>6} {:>8} {:>15} {:>15} {:>16} {:>15} {:>9.2}  {known}",
            field.channel,
            field.stars,
            field.points,
            with(fibre.offset_px[0], x),
            with(fibre.offset_px[1], y),
            with(fibre.sigma_px[0], u),
            with(fibre.sigma_px[1], v),
            fit.scatter
        );
    }
    text.push_str("\nscatter: of the rates about the fit over their stated uncertainty; scintillation and what is no normal distribution make it more than 1\n");
    for field in fields.iter().filter(|field| field.fit.correlated_points > 0) {
        let _ = writeln!(
            text,
            "{}: {} rates in a row err together (places between frames, twinkling); the uncertainties allow for it",
            field.channel, field.fit.correlated_points
        );
    }
    for field in fields {
        if let Some(cell) = field.map.strongest_residual() {
            let _ = writeln!(
                text,
                "{}: the field is furthest above the fit at ({:.1}, {:.1}) px: by {:+.3} ± {:.3} of its middle",
                field.channel, cell.offset_px[0], cell.offset_px[1], cell.residual, cell.sigma
            );
        }
    }
    text
}

/// The measured maps as a table, a picture of them, and the fits as JSON.
fn product(fields: &[Field], station: &Station, warnings: &[String]) -> Product {
    let cells: Vec<_> = fields
        .iter()
        .flat_map(|f| f.map.cells.iter().map(move |cell| (&f.channel, cell)))
        .collect();
    let number = |value: &dyn Fn(&sunglint_calibration::alignment::Cell) -> f64| {
        cells.iter().map(|(_, cell)| value(cell)).collect()
    };
    let columns = vec![
        Column::text("channel", cells.iter().map(|(name, _)| (*name).clone()).collect()),
        Column::f64("column_px", Some("pix"), number(&|c| c.offset_px[0])),
        Column::f64("row_px", Some("pix"), number(&|c| c.offset_px[1])),
        Column::f64("value", None, number(&|c| c.value)),
        Column::f64("sigma", None, number(&|c| c.sigma)),
        Column::f64("residual", None, number(&|c| c.residual)),
        Column::i64("points", None, cells.iter().map(|(_, c)| c.points as i64).collect()),
    ];
    let pair = |values: [f64; 2]| values.map(rounded);
    let fits = fields.iter().map(|field| {
        let fibre = field.fit.fibre();
        let [x, y, u, v, angle] = field.fit.uncertainties();
        json!({
            "name": field.channel,
            "stars": field.stars,
            "points": field.points,
            "offset_px": pair(fibre.offset_px),
            "offset_uncertainty_px": pair([x, y]),
            "sigma_px": pair(fibre.sigma_px),
            "sigma_uncertainty_px": pair([u, v]),
            "angle_deg": rounded(field.fit.angle_deg),
            "angle_uncertainty_deg": rounded(angle),
            "scatter": rounded(field.fit.scatter),
            "correlated_points": field.fit.correlated_points,
        })
    });
    Product {
        name: "fibres".into(),
        table: Table { columns, ..Table::default() },
        gallery: Some(Gallery {
            title: format!("Fields of the fibres of {}", station.name),
            subtitle: vec![
                "left: measured, of the fitted middle; right: measured less fitted".into(),
            ],
            tiles: fields
                .iter()
                .flat_map(|field| [tile(field, false), tile(field, true)])
                .collect(),
        }),
        json: json!({"station": station.name, "channels": fits.collect::<Vec<_>>(), "warnings": warnings}),
        ..Product::default()
    }
}

const SIDE: u32 = 400;
const EMPTY: Rgba<u8> = Rgba([236, 236, 236, 255]);
const BLUE: [f64; 3] = [33.0, 102.0, 172.0];
const RED: [f64; 3] = [178.0, 24.0, 43.0];

/// White at 0, blue at −1, red at 1.
fn diverging(value: f64) -> RGBColor {
    let end = if value < 0.0 { BLUE } else { RED };
    let part = value.abs().min(1.0);
    let [r, g, b] = [0, 1, 2].map(|i| (255.0 + part * (end[i] - 255.0)).round() as u8);
    RGBColor(r, g, b)
}

/// The measured field, or what the fit leaves of it.
fn tile(field: &Field, is_residual: bool) -> Tile {
    let cells = &field.map.cells;
    let cell_px = field.map.cell_px;
    let ends = |i: usize| {
        let at = cells.iter().map(|cell| cell.offset_px[i]);
        let low = at.clone().fold(f64::INFINITY, f64::min) - 0.5 * cell_px;
        (low, at.fold(f64::NEG_INFINITY, f64::max) + 0.5 * cell_px)
    };
    let (x, y) = (ends(0), ends(1));
    let side = (x.1 - x.0).max(y.1 - y.0).max(cell_px);
    let scale = f64::from(SIDE) / side;
    let most = cells.iter().map(|cell| cell.residual.abs()).fold(1e-6, f64::max);
    let brightest = cells.iter().map(|cell| cell.value).fold(1e-6, f64::max);
    let mut image = RgbaImage::from_pixel(SIDE, SIDE, EMPTY);
    for cell in cells {
        let RGBColor(r, g, b) = match is_residual {
            true => diverging(cell.residual / most),
            false => viridis(cell.value / brightest),
        };
        let from = [(cell.offset_px[0], x.0), (cell.offset_px[1], y.0)]
            .map(|(at, low)| ((at - 0.5 * cell_px - low) * scale).floor().max(0.0) as u32);
        let to = from.map(|low| (low + (cell_px * scale).ceil() as u32).min(SIDE));
        for row in from[1]..to[1] {
            for column in from[0]..to[0] {
                image.put_pixel(column, row, Rgba([r, g, b, 255]));
            }
        }
    }
    let key = if is_residual {
        Key::Names(vec![
            (diverging(1.0), format!("{most:+.3}")),
            (diverging(0.0), "as fitted".into()),
            (diverging(-1.0), format!("{:+.3}", -most)),
        ])
    } else {
        Key::Bar { label: vec!["of the middle".into()], range: (0.0, brightest), log: false }
    };
    Tile {
        title: format!("{}, {}", field.channel, if is_residual { "residual" } else { "measured" }),
        image,
        is_dark: false,
        key,
        arrows: Vec::new(),
        scale_bar: Some((10.0 / side, "10 px".into())),
    }
}
