//! `sunglint demo`: what there is, on embedded input.
//!
//! Until the comparison of a measured with a simulated pass makes it the whole main job, it simulates what the six channels of the built-in station
//! count of a satellite that crosses the evening sky, predicts the same of Vega as it sinks towards the horizon, and draws the air that makes the difference.

use crate::output::{Console, OutputArgs, Product};
use crate::plot::{Axis, Figure, Panel, Series};
use crate::simulate;
use crate::star::{Track, View, channel_line};
use anyhow::Context as _;
use clap::Args;
use hifitime::{Epoch, Unit};
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{Air, Sampling, Zenith};
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation};
use sunglint_radiometry::star_light::{self, StarColours};
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{Overrides, PassFile};

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

/// One of the thesis' nights, from dusk until Vega is low.
const FROM: &str = "2020-11-18T17:00:00";
const MINUTES: u32 = 330;
const EXPOSURE_S: f64 = 0.1;
/// The scene of the pass; it goes into the folder too, to be changed and simulated again.
const PASS: &str = include_str!("demo/pass.toml");
const PASS_FILE: &str = "pass.toml";
/// Made-up satellites along the line between day and night, to look for passes of.
const SATELLITES: &str = include_str!("demo/satellites.tle");
const SATELLITES_FILE: &str = "satellites.tle";

/// Makes the demonstration.
pub fn run(args: &DemoArgs, console: Console) -> anyhow::Result<()> {
    let folder = args.output.clone().unwrap_or_else(free_folder);
    let station = Station::built_in("ufo").context("the built-in station `ufo` is not there")??;
    let air = Air::new(&station.air_options()?)?;
    let star = Catalogue::embedded().find("Vega")?.clone();
    let light = star_light::vega(StarColours {
        v_mag: star.v_mag.context("the star has no magnitude")?,
        b_minus_v_mag: star.bv_mag,
        spectral_type: star.spectral_type.as_deref(),
        zero: ZeroPoint::default(),
    })?;
    let start = parse_utc(FROM).context("the demonstration's time")?;
    let times: Vec<Epoch> =
        (0..MINUTES).map(|minute| start + f64::from(minute) * Unit::Minute).collect();
    let view =
        View { star, light, station, air, zero: ZeroPoint::default(), exposure_s: EXPOSURE_S };
    let track = Track::new(view, EarthOrientation::embedded(), times)?;
    let curve = track.light_curve("sunglint demo");

    let pass = PassFile::parse(PASS_FILE, PASS)?.resolve(Overrides::default())?;
    let pass = simulate::show(&pass, PASS_FILE, None, console)?;

    let readme = folder.join("README.txt");
    // The folder in the spelling that says so whether it is there or not.
    let out = OutputArgs { output: vec![folder.join("")], force: args.force };
    let mut contents = out.files_of(&pass.product)?;
    contents.push((folder.join(PASS_FILE), PASS.into()));
    contents.push((folder.join(SATELLITES_FILE), SATELLITES.into()));
    contents.extend(out.files_of(&vega(&track, &curve)?)?);
    contents.extend(out.files_of(&transmissions(&track.air)?)?);
    let files: Vec<String> =
        contents.iter().map(|(p, _)| p).chain([&readme]).map(|p| p.display().to_string()).collect();
    contents.push((readme, explain(&pass.text, &track, &files).into_bytes()));
    out.write_files(&contents, Console { quiet: true, ..console })?;
    let json = json!({ "folder": folder.display().to_string(), "files": files });
    if console.quiet && !console.json {
        return Ok(());
    }
    console.result(
        &format!(
            "{}\n{}\nThe demonstration is in {}",
            pass.text,
            summary(&track),
            folder.display()
        ),
        &json,
    )
}

fn vega(track: &Track, curve: &LightCurve) -> anyhow::Result<Product> {
    let start = curve.samples.time.first().copied().context("there is no sample")?;
    let hours: Vec<f64> =
        curve.samples.time.iter().map(|t| (*t - start).to_unit(Unit::Hour)).collect();
    let line = |values: Vec<f64>| hours.iter().copied().zip(values).collect::<Vec<_>>();
    let channels = || track.station.channels.iter().zip(&curve.channels);
    let rates = channels().map(|(channel, c)| channel_line(channel, line(c.rate_hz.clone())));
    let fading = channels().enumerate().map(|(i, (channel, c))| {
        let above = track.sights[0].rates[i].above_air_hz;
        channel_line(channel, line(c.rate_hz.iter().map(|r| -2.5 * (r / above).log10()).collect()))
    });
    let x = || Axis::linear(format!("hours after {}", format_utc(start, 0)));
    let zenith =
        |sight: Option<&crate::star::Sight>| sight.map_or(0.0, |s| s.place.horizontal.zenith_deg());
    let title = format!(
        "{}: predicted rates in six channels while its zenith angle goes from {:.0}° to {:.0}°",
        track.star,
        zenith(track.sights.first()),
        zenith(track.sights.last())
    );
    let panels = vec![
        Panel::new(x(), Axis::log("predicted rate at the detector (Hz)"), rates.collect()),
        Panel::new(x(), Axis::linear("extinction by clean air (mag)"), fading.collect()),
    ];
    let figure = Some(Figure { title, panels });
    Ok(Product {
        name: "vega_night".into(),
        table: curve.to_table()?,
        figure,
        json: json!({}),
        ..Product::default()
    })
}

fn transmissions(air: &Air) -> anyhow::Result<Product> {
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
    let title = "Air above Stuttgart, midlatitude winter, no aerosol".into();
    let figure = Some(Figure { title, panels: vec![Panel::new(x, y, series)] });
    Ok(Product { name: "air".into(), table, figure, json: json!({}), ..Product::default() })
}

fn summary(track: &Track) -> String {
    let (Some(first), Some(last)) = (track.sights.first(), track.sights.last()) else {
        return String::new();
    };
    let zenith = |sight: &crate::star::Sight| sight.place.horizontal.zenith_deg();
    let mut text = format!(
        "{} from {}, zenith angle {:.1}° to {:.1}°, {} samples\n\n  channel   highest rate       lowest rate    fades by\n",
        track.star,
        track.station.name,
        zenith(first),
        zenith(last),
        track.sights.len()
    );
    for (i, channel) in track.station.channels.iter().enumerate() {
        let (Some(high), Some(low)) = (first.rates[i].rate_hz, last.rates[i].rate_hz) else {
            continue;
        };
        let fades = 2.5 * (high / low).log10();
        let _ =
            write!(text, "  {:<8} {high:>12.4e} Hz {low:>14.4e} Hz {fades:>7.3} mag", channel.name);
        let saturated = track.sights.iter().filter(|s| s.rates[i].saturated).count();
        if saturated > 0 {
            let _ = write!(text, "   {saturated} samples past the counter's saturation: attenuate");
        }
        text.push('\n');
    }
    text
}

fn explain(pass: &str, track: &Track, files: &[String]) -> String {
    let names: String = files.iter().fold(String::new(), |mut text, file| {
        let name = std::path::Path::new(file)
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let _ = writeln!(text, "  {name}");
        text
    });
    format!(
        "What `sunglint demo` made\n\n{pass}\n{}\nspectrum: {}\nThe station's curves are approximate shapes, not measurements, and the satellite, its orbit and its materials are made up.\n\nFiles:\n{names}\n\
         box_wing_pass.ecsv and vega_night.ecsv are light curves of the program's schema (quantity `predicted`): rates and uncertainties in Hz\nper channel, with flags. They open in any editor and with astropy.table.Table.read. box_wing_pass_spectra.fits holds times x bins.\n\
         Change {PASS_FILE} and run `sunglint simulate {PASS_FILE}`.\n",
        summary(track),
        track.light.origin
    )
}

/// `sunglint-demo`, `sunglint-demo-2` … : the first that is not there.
fn free_folder() -> PathBuf {
    let name =
        |n: u32| if n == 1 { "sunglint-demo".to_owned() } else { format!("sunglint-demo-{n}") };
    (1..).map(|n| PathBuf::from(name(n))).find(|p| !p.exists()).unwrap_or_default()
}
