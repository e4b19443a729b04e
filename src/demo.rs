//! `sunglint demo`: what there is, on embedded input.
//!
//! Until the comparison of a measured with a simulated pass makes it the whole main job, it predicts what the six channels of the built-in station
//! count of Vega as it sinks towards the horizon, and draws the air that makes the difference.

use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs, Product};
use crate::plot::{Axis, Figure, Panel, Series};
use crate::star::View;
use anyhow::Context as _;
use clap::Args;
use hifitime::{Epoch, Unit};
use serde_json::json;
use std::path::{Path, PathBuf};
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{Air, Sampling, Zenith};
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples,
};
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer, Star};
use sunglint_radiometry::star_light::{self, StarColours, StarLight};
use sunglint_radiometry::station::Station;

/// Arguments of `sunglint demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// The folder to make [default: sunglint-demo, or the next that is free]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Overwrite what is in the folder
    #[arg(long)]
    pub force: bool,
}

/// The night of the thesis of which most stars were calibrated, from dusk until Vega is low.
const FROM: &str = "2020-11-18T17:00:00";
const MINUTES: u32 = 420;
const STAR: &str = "Vega";
const EXPOSURE_S: f64 = 0.1;

/// Makes the demonstration.
pub fn run(args: &DemoArgs, console: Console) -> anyhow::Result<()> {
    let folder = args.output.clone().unwrap_or_else(free_folder);
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot create the folder {}", folder.display()))?;
    let station = Station::built_in("ufo").context("the built-in station `ufo` is not there")??;
    let air = AirModelArgs::default().air(station.site.geodetic().height_m, Some(&station))?;
    let star = Catalogue::embedded().find(STAR)?.clone();
    let light = star_light::of(StarColours {
        v_mag: star.v_mag.context("the star has no magnitude")?,
        b_minus_v_mag: star.bv_mag,
        spectral_type: star.spectral_type.as_deref(),
        zero: Default::default(),
    })?;
    let curve = night(&star, &light, &station, &air)?;
    let out = OutputArgs { output: vec![folder_path(&folder)], force: args.force };
    let quiet = Console { quiet: true, ..console };
    let mut written = out.deliver(&star_product(&star, &curve)?, quiet)?;
    written.extend(out.deliver(&air_product(&air)?, quiet)?);
    let readme = folder.join("README.txt");
    out.write_file(&readme, explain(&star, &light, &curve, &written).as_bytes())?;
    written.push(readme);
    let files: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
    let json = json!({ "folder": folder.display().to_string(), "files": files });
    console.result(
        &format!("{}\n\nThe demonstration is in {}", summary(&star, &curve), folder.display()),
        &json,
    )
}

/// What the station counts of the star, minute by minute: a predicted light curve of the schema.
fn night(
    star: &Star,
    light: &StarLight,
    station: &Station,
    air: &Air,
) -> anyhow::Result<LightCurve> {
    let start = parse_utc(FROM).context("the demonstration's time")?;
    let mut time: Vec<Epoch> = Vec::new();
    let mut zenith_deg = Vec::new();
    let mut channels: Vec<ChannelCurve> = station
        .channels
        .iter()
        .map(|c| ChannelCurve {
            name: c.name.clone(),
            rate_hz: vec![],
            sigma_hz: vec![],
            flags: vec![],
        })
        .collect();
    for minute in 0..MINUTES {
        let epoch = start + f64::from(minute) * Unit::Minute;
        let observer = Observer::at(epoch, &station.site, EarthOrientation::embedded())?;
        let view = View::new(star, light.clone(), &observer, station, air)?;
        let place = view.place.horizontal;
        if view.path.is_none()
            || place.altitude_deg() < station.horizon.elevation_deg(place.azimuth_deg())
        {
            continue;
        }
        time.push(epoch);
        zenith_deg.push(place.zenith_deg());
        for (curve, rate) in channels.iter_mut().zip(&view.rates) {
            let hz = rate.rate_hz.unwrap_or(f64::NAN);
            let mut flags = Flags::empty();
            flags.set(Flags::EXTRAPOLATED, rate.uncovered_nm > 0.0);
            flags.set(Flags::FALLBACK, light.origin.is_fallback());
            flags.set(Flags::GAP, rate.rate_hz.is_none());
            curve.rate_hz.push(hz);
            // Photon noise of the exposure alone.
            curve.sigma_hz.push((hz / EXPOSURE_S).sqrt());
            curve.flags.push(flags);
        }
    }
    let provenance = Provenance {
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
        command: "sunglint demo".into(),
        station: station.name.clone(),
        target: star.to_string(),
        notes: vec![
            format!("spectrum: {}", light.origin),
            "sigma: photon noise of one exposure, no scintillation".into(),
            "the station's curves are approximate shapes, not measurements".into(),
        ],
        ..Provenance::default()
    };
    let samples = Samples { zenith_deg: Some(zenith_deg), ..Samples::new(time, EXPOSURE_S) };
    let other = Default::default();
    Ok(LightCurve { kind: RateKind::Predicted, samples, channels, provenance, other })
}

fn star_product(star: &Star, curve: &LightCurve) -> anyhow::Result<Product> {
    let zenith = curve.samples.zenith_deg.clone().unwrap_or_default();
    let start = curve.samples.time.first().copied().context("the star is not up that night")?;
    let hours: Vec<f64> =
        curve.samples.time.iter().map(|t| (*t - start).to_unit(Unit::Hour)).collect();
    let line =
        |values: &[f64]| hours.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
    let rates = curve
        .channels
        .iter()
        .enumerate()
        .map(|(i, c)| Series::line(&c.name, i, line(&c.rate_hz)))
        .collect();
    let fading = curve.channels.iter().enumerate().map(|(i, c)| {
        let first = c.rate_hz[0];
        Series::line(
            &c.name,
            i,
            line(&c.rate_hz.iter().map(|r| -2.5 * (r / first).log10()).collect::<Vec<_>>()),
        )
    });
    let x = || Axis::linear(format!("hours after {}", format_utc(start, 0)));
    let figure = Figure {
        title: format!(
            "{star}: predicted rates in six channels while its zenith angle goes from {:.0}° to {:.0}°",
            zenith[0],
            zenith[zenith.len() - 1]
        ),
        panels: vec![
            Panel { x: x(), y: Axis::log("rate at the detector (Hz)"), series: rates },
            Panel { x: x(), y: Axis::linear("fading by the air (mag)"), series: fading.collect() },
        ],
    };
    Ok(Product {
        name: "vega_night".into(),
        table: curve.to_table()?,
        figure: Some(figure),
        json: json!({}),
    })
}

fn air_product(air: &Air) -> anyhow::Result<Product> {
    let nm: Vec<f64> = (300..=1240).map(f64::from).collect();
    let sampling = Sampling::means(&nm, 0.5)?;
    let mut table = Table {
        columns: vec![Column::f64("wavelength_nm", Some("nm"), nm.clone())],
        ..Table::default()
    };
    let mut series = Vec::new();
    for (i, zenith) in [0.0, 60.0, 80.0].into_iter().enumerate() {
        let t = air.transmission(Zenith::True(zenith), &sampling)?;
        let points = nm.iter().copied().zip(t.iter().copied()).collect();
        series.push(Series::line(format!("zenith angle {zenith}°"), i, points));
        table.columns.push(Column::f64(format!("transmission_z{zenith}"), None, t));
    }
    let x = Axis::linear("vacuum wavelength (nm)").from_to(300.0, 1240.0);
    let y = Axis::linear("transmission of the air").from_to(0.0, 1.0);
    let figure = Figure {
        title: "Air above Stuttgart, midlatitude winter".into(),
        panels: vec![Panel { x, y, series }],
    };
    Ok(Product { name: "air".into(), table, figure: Some(figure), json: json!({}) })
}

fn summary(star: &Star, curve: &LightCurve) -> String {
    let zenith = curve.samples.zenith_deg.as_deref().unwrap_or_default();
    let (Some(first), Some(last)) = (zenith.first(), zenith.last()) else { return String::new() };
    let mut text = format!(
        "{star} from {}, zenith angle {first:.1}° to {last:.1}°, {} samples\n\n",
        curve.provenance.station,
        curve.len()
    );
    text.push_str("  channel   highest rate       lowest rate    fades by\n");
    for c in &curve.channels {
        let (high, low) = (c.rate_hz[0], c.rate_hz[c.rate_hz.len() - 1]);
        text.push_str(&format!(
            "  {:<8} {high:>12.4e} Hz {low:>14.4e} Hz {:>7.3} mag",
            c.name,
            2.5 * (high / low).log10()
        ));
        text.push('\n');
    }
    text
}

fn explain(star: &Star, light: &StarLight, curve: &LightCurve, written: &[PathBuf]) -> String {
    let files: Vec<String> = written
        .iter()
        .map(|p| {
            format!(
                "  {}\n",
                p.file_name()
                    .map_or_else(|| p.display().to_string(), |n| n.to_string_lossy().into_owned())
            )
        })
        .collect();
    format!(
        "What `sunglint demo` made\n\n{}\nspectrum of {star}: {}\n\nFiles:\n{}\nThe .ecsv files open in any editor and with astropy.table.Table.read; vega_night.ecsv is a light curve of the\nprogram's schema (quantity `predicted`): rates and uncertainties in Hz per channel, with flags.\n",
        summary(star, curve),
        light.origin,
        files.concat()
    )
}

/// `sunglint-demo`, `sunglint-demo-2` … : the first that is not there.
fn free_folder() -> PathBuf {
    let name =
        |n: u32| if n == 1 { "sunglint-demo".to_owned() } else { format!("sunglint-demo-{n}") };
    (1..).map(|n| PathBuf::from(name(n))).find(|p| !p.exists()).unwrap_or_default()
}

/// The folder in the spelling that says so whether it is there or not.
fn folder_path(folder: &Path) -> PathBuf {
    folder.join("")
}
