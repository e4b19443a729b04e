//! `sunglint star`: where a star stands, through how much air, and what each channel would count.

use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs, Product};
use crate::plot::{Axis, Figure, Panel, Series};
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use hifitime::Epoch;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{Air, Path, Zenith};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Equatorial, Observer, Star, StarPlace, separation_deg,
};
use sunglint_radiometry::spectrum::{Spectrum, Transmission};
use sunglint_radiometry::star_light::{self, StarColours, StarLight};
use sunglint_radiometry::station::{Detector, Station};

/// Where a star's spectrum comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum SpectrumChoice {
    /// The library by type, else by colour, else a black body
    #[default]
    Auto,
    /// A black body of the colour's temperature
    BlackBody,
}

/// Arguments of `sunglint star`.
#[derive(Debug, Args)]
pub struct StarArgs {
    /// The star: `Vega`, `alp Lyr`, `HIP 91262`, `HD 172167`; or with --ra and --dec any name
    pub name: String,
    /// When: UTC, ISO 8601, or `now`
    #[arg(long, value_name = "TIME", default_value = "now")]
    pub at: String,
    /// Right ascension (ICRS, J2000) of a star that the catalogue lacks, degrees
    #[arg(long, value_name = "DEG", requires = "dec")]
    pub ra: Option<f64>,
    /// Declination (ICRS, J2000), degrees
    #[arg(long, value_name = "DEG", requires = "ra", allow_negative_numbers = true)]
    pub dec: Option<f64>,
    /// Johnson V, instead of the catalogue's
    #[arg(long, value_name = "MAG", allow_negative_numbers = true)]
    pub v: Option<f64>,
    /// B-V, instead of the catalogue's
    #[arg(long, value_name = "MAG", allow_negative_numbers = true)]
    pub bv: Option<f64>,
    /// Spectral type, instead of the catalogue's
    #[arg(long = "type", value_name = "MK")]
    pub spectral_type: Option<String>,
    /// Where the spectrum comes from
    #[arg(long, value_enum, default_value_t)]
    pub spectrum: SpectrumChoice,
    /// Magnitude of Vega that the catalogue's V counts from, or `ab`: `vega=0.03`
    #[arg(long, value_name = "ZERO", default_value = "vega=0.03")]
    pub zero_point: ZeroPoint,
    /// Earth orientation to use instead of the embedded table: ECSV with its columns (see `sunglint tables earth_orientation`)
    #[arg(long, value_name = "FILE")]
    pub earth_orientation: Option<std::path::PathBuf>,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What a channel counts of a star.
#[derive(Debug, Clone)]
pub struct ChannelRate {
    /// The channel's name.
    pub channel: String,
    /// Rate above the air, Hz.
    pub above_air_hz: f64,
    /// Rate at the detector, Hz; `None` below the horizon.
    pub rate_hz: Option<f64>,
    /// Hz/nm above the air.
    pub band_hz_nm: f64,
    /// Width of the channel for which light or air was not tabulated, nm.
    pub uncovered_nm: f64,
    /// What the detector would truly count: the rate over the channel's typical κ, Hz; `None` without one.
    pub expected_hz: Option<f64>,
    /// The counter's saturation, where the expected rate is at or past it, Hz.
    pub past_saturation_hz: Option<f64>,
}

/// Shows a star.
pub fn run(args: &StarArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let station = args.station.get()?;
    let epoch = when(&args.at)?;
    let star = args.star()?;
    let user_orientation = match &args.earth_orientation {
        None => None,
        Some(path) => {
            let table = sunglint_formats::ecsv::read(path)?;
            Some(EarthOrientation::from_table(&table).with_context(|| path.display().to_string())?)
        }
    };
    let orientation = user_orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded());
    let observer = Observer::at(epoch, &station.site, orientation)?;
    if observer.frame().orientation().origin.is_outside() {
        console.warn(&observer.frame().orientation().origin.to_string());
    }
    let air = args.model.air(station.site.geodetic().height_m, Some(&station))?;
    let light = args.light(&star)?;
    if light.origin.is_fallback() {
        console.warn(&format!("the spectrum of {star} is a fallback: {}", light.origin));
    }
    let view = View::new(&star, light, &observer, &station, &air)?;
    let product = args.product(&star, &view, &observer, &station, &air);
    args.out.deliver(&product, console)?;
    if !args.out.is_stdout() && (args.out.output.is_empty() || console.json) {
        console.result(&args.text(&star, &view, &observer, &station, &air), &product.json)?;
    }
    Ok(())
}

/// A time of the command line: ISO 8601 or `now`.
pub fn when(text: &str) -> anyhow::Result<Epoch> {
    if text == "now" {
        return Epoch::now().context("the system has no clock");
    }
    parse_utc(text)
        .with_context(|| format!("`{text}` is no time; write 2026-11-20T18:30:00 (UTC) or now"))
}

/// A star as a station sees it.
#[derive(Debug, Clone)]
pub struct View {
    /// Its place.
    pub place: StarPlace,
    /// Its light above the air.
    pub light: StarLight,
    /// The way of its light through the air; `None` below the horizon.
    pub path: Option<Path>,
    /// The transmission along it.
    pub transmission: Option<Spectrum<Transmission>>,
    /// What each channel counts.
    pub rates: Vec<ChannelRate>,
}

impl View {
    /// A star at a moment from a station through an air.
    pub fn new(
        star: &Star,
        light: StarLight,
        observer: &Observer,
        station: &Station,
        air: &Air,
    ) -> anyhow::Result<Self> {
        let place = observer.star(star);
        let zenith = Zenith::True(place.horizontal.zenith_deg());
        let path =
            if place.horizontal.altitude_deg() > -2.0 { air.path(zenith).ok() } else { None };
        let transmission =
            path.as_ref().map(|_| air.spectrum(zenith, light.irradiance.range_nm())).transpose()?;
        let rates = station
            .channels
            .iter()
            .map(|channel| {
                let above = station.rate_hz(channel, &light.irradiance, None);
                let below = transmission
                    .as_ref()
                    .map(|t| station.rate_hz(channel, &light.irradiance, Some(t)));
                let expected_hz = below.and_then(|b| Some(b.value / channel.typical_kappa?));
                let limit_hz = match &channel.detector {
                    Detector::Counter(counter) => counter.saturation_hz,
                    // What saturates a camera depends on exposure and seeing.
                    Detector::CameraPlane(_) => f64::INFINITY,
                };
                ChannelRate {
                    channel: channel.name.clone(),
                    above_air_hz: above.value,
                    rate_hz: below.map(|b| b.value),
                    band_hz_nm: above.value / channel.bandwidth_nm(),
                    uncovered_nm: below.unwrap_or(above).uncovered_nm,
                    expected_hz,
                    past_saturation_hz: expected_hz.filter(|hz| *hz >= limit_hz).map(|_| limit_hz),
                }
            })
            .collect();
        Ok(Self { place, light, path, transmission, rates })
    }
}

impl StarArgs {
    fn star(&self) -> anyhow::Result<Star> {
        let mut star = match (self.ra, self.dec) {
            (Some(ra_deg), Some(dec_deg)) => Star::at(&self.name, Equatorial { ra_deg, dec_deg })?,
            _ => Catalogue::embedded()
                .find(&self.name)
                .context(
                    "use --ra DEG --dec DEG --v MAG --type MK (or --bv MAG) for a star of your own",
                )?
                .clone(),
        };
        star.v_mag = self.v.or(star.v_mag);
        star.bv_mag = self.bv.or(star.bv_mag);
        star.spectral_type = self.spectral_type.clone().or(star.spectral_type);
        Ok(star)
    }

    fn light(&self, star: &Star) -> anyhow::Result<StarLight> {
        let Some(v_mag) = star.v_mag else {
            bail!("no magnitude of {star} is known: give --v MAG");
        };
        let colours = StarColours {
            v_mag,
            b_minus_v_mag: star.bv_mag,
            spectral_type: star.spectral_type.as_deref(),
            zero: self.zero_point,
        };
        Ok(match self.spectrum {
            SpectrumChoice::Auto => star_light::of(colours)?,
            SpectrumChoice::BlackBody => star_light::black_body(colours)?,
        })
    }

    fn product(
        &self,
        star: &Star,
        view: &View,
        observer: &Observer,
        station: &Station,
        air: &Air,
    ) -> Product {
        let light = &view.light.irradiance;
        let time = format_utc(observer.frame().epoch(), 3);
        let mut table = Table::default();
        let title = format!("{star} from {} at {time}", station.name);
        for (key, value) in [
            ("title", &title),
            ("spectrum", &view.light.origin.to_string()),
            ("zero_point", &self.zero_point.to_string()),
        ] {
            table.meta.insert(key.into(), json!(value));
        }
        // The union of both grids, so that nothing of either is lost.
        let after = view.transmission.as_ref().and_then(|t| light.through(t).ok());
        let grid = after.as_ref().map_or(light.wavelength_nm(), |a| a.wavelength_nm()).to_vec();
        let above = grid.iter().map(|nm| light.at(*nm)).collect();
        table.columns.push(Column::f64("wavelength_nm", Some("nm"), grid.clone()));
        table.columns.push(Column::f64("irradiance_w_m2_nm", Some("W / (m2 nm)"), above));
        if let (Some(t), Some(after)) = (&view.transmission, &after) {
            table.columns.push(Column::f64(
                "transmission",
                None,
                grid.iter().map(|nm| t.at(*nm)).collect(),
            ));
            table.columns.push(Column::f64(
                "ground_irradiance_w_m2_nm",
                Some("W / (m2 nm)"),
                after.value().to_vec(),
            ));
        }
        let name = star.label().to_lowercase().replace(|c: char| !c.is_ascii_alphanumeric(), "_");
        let json = self.json(star, view, observer, station, air);
        Product { name, table, figure: Some(figure(&title, view, station)), json }
    }

    fn json(
        &self,
        star: &Star,
        view: &View,
        observer: &Observer,
        station: &Station,
        air: &Air,
    ) -> Value {
        let h = view.place.horizontal;
        let rates: Vec<Value> = view
            .rates
            .iter()
            .map(|r| {
                json!({ "channel": r.channel, "rate_hz": r.rate_hz, "above_air_hz": r.above_air_hz, "band_hz_nm": r.band_hz_nm,
                    "uncovered_nm": r.uncovered_nm, "expected_hz": r.expected_hz, "past_saturation_hz": r.past_saturation_hz })
            })
            .collect();
        json!({
            "star": { "name": star.name, "bayer": star.bayer, "hip": star.hip, "hd": star.hd, "v_mag": star.v_mag, "bv_mag": star.bv_mag,
                "spectral_type": star.spectral_type, "notes": star.notes().iter().map(ToString::to_string).collect::<Vec<_>>() },
            "time_utc": format_utc(observer.frame().epoch(), 3), "station": station.name,
            "place": { "altitude_deg": h.altitude_deg(), "azimuth_deg": h.azimuth_deg(), "zenith_true_deg": h.zenith_deg(),
                "zenith_apparent_deg": view.path.as_ref().map(|p| p.apparent_deg), "hour_angle_deg": view.place.hour_angle_deg,
                "ra_of_date_deg": view.place.of_date.ra_deg, "dec_of_date_deg": view.place.of_date.dec_deg,
                "earth_orientation": observer.frame().orientation().origin.to_string() },
            "airmass": view.path.as_ref().map(|p| air.air_masses(p).rayleigh),
            "air": self.model.describe(air, station.site.geodetic().height_m, Some(station)),
            "spectrum": { "origin": view.light.origin.to_string(), "fallback": view.light.origin.is_fallback(),
                "colour_excess_mag": view.light.colour_excess_mag, "zero_point": self.zero_point.to_string() },
            "sun_altitude_deg": observer.sun().horizontal.altitude_deg(), "rates": rates,
        })
    }

    fn text(
        &self,
        star: &Star,
        view: &View,
        observer: &Observer,
        station: &Station,
        air: &Air,
    ) -> String {
        let mut text = String::new();
        let or_none = |v: Option<f64>| v.map_or("unknown".to_owned(), |v| v.to_string());
        let _ = writeln!(
            text,
            "{star}{}: V {}, B-V {}, {}",
            star.hd.map_or(String::new(), |hd| format!(", HD {hd}")),
            or_none(star.v_mag),
            or_none(star.bv_mag),
            star.spectral_type.as_deref().unwrap_or("type unknown")
        );
        for note in star.notes() {
            let _ = writeln!(text, "  note: {note}");
        }
        let site = station.site.geodetic();
        let _ = writeln!(
            text,
            "{} from {} ({:.4}°, {:.4}°, {} m)",
            format_utc(observer.frame().epoch(), 0),
            station.name,
            site.latitude_deg,
            site.longitude_deg,
            site.height_m
        );
        let (h, place) = (view.place.horizontal, &view.place);
        let _ = writeln!(
            text,
            "  altitude {:.4}°  azimuth {:.4}°  zenith angle {:.4}° (true)  hour angle {:+.4}°",
            h.altitude_deg(),
            h.azimuth_deg(),
            h.zenith_deg(),
            place.hour_angle_deg
        );
        let _ = writeln!(
            text,
            "  right ascension {:.5}°  declination {:+.5}° (of date)",
            place.of_date.ra_deg, place.of_date.dec_deg
        );
        let (sun, moon) = (observer.sun(), observer.moon());
        let _ = writeln!(
            text,
            "  Sun at {:+.1}° ({}); Moon at {:+.1}°, {:.0} % lit, {:.0}° from the star",
            sun.horizontal.altitude_deg(),
            observer.twilight(),
            moon.horizontal.altitude_deg(),
            100.0 * moon.place.illuminated_fraction(),
            separation_deg(moon.horizontal.east_north_up(), h.east_north_up())
        );
        match &view.path {
            Some(path) => {
                let _ = writeln!(
                    text,
                    "  apparent zenith angle {:.4}°  airmass {:.4}",
                    path.apparent_deg,
                    air.air_masses(path).rayleigh
                );
                let mask = station.horizon.elevation_deg(h.azimuth_deg());
                if 90.0 - path.apparent_deg < mask {
                    let _ =
                        writeln!(text, "  BEHIND the station's horizon, which is at {mask}° there");
                }
            }
            None => text.push_str("  BELOW the horizon: no light comes through\n"),
        }
        let _ = writeln!(text, "air: {}", self.model.describe(air, site.height_m, Some(station)));
        let excess = view.light.colour_excess_mag;
        let _ = writeln!(
            text,
            "spectrum: {}; B-V {} of the catalogue's; V counts from {}",
            view.light.origin,
            excess.map_or("without a check".to_owned(), |e| format!("within {e:+.3} mag")),
            self.zero_point
        );
        text.push_str("\n  channel    predicted rate   above the air   transmitted   band average above the air   expected count rate\n");
        for r in &view.rates {
            let or_dash =
                |v: Option<f64>, write: &dyn Fn(f64) -> String| v.map_or("-".to_owned(), write);
            let hz = |v: f64| format!("{v:.4e} Hz");
            let _ = write!(
                text,
                "  {:<9} {:>15} {:>15} {:>13} {:>23} Hz/nm {:>21}",
                r.channel,
                or_dash(r.rate_hz, &hz),
                hz(r.above_air_hz),
                or_dash(r.rate_hz, &|v| format!("{:.4}", v / r.above_air_hz)),
                format!("{:.4e}", r.band_hz_nm),
                or_dash(r.expected_hz, &hz),
            );
            if let Some(limit) = r.past_saturation_hz {
                let _ = write!(text, "   PAST SATURATION ({limit:.1e} Hz): attenuate");
            }
            if r.uncovered_nm > 0.0 {
                let _ = write!(text, "   (no spectrum or air for {:.0} nm of it)", r.uncovered_nm);
            }
            text.push('\n');
        }
        text.push_str("Predicted rates are after the air, before dead time, without dark counts. Expected count rates are divided by the channel's typical kappa (losses that\nonly the star calibration knows).\n");
        text
    }
}

fn figure(title: &str, view: &View, station: &Station) -> Figure {
    let points = |s: &Spectrum<_>| {
        s.wavelength_nm().iter().copied().zip(s.value().iter().copied()).collect()
    };
    let light = &view.light.irradiance;
    let x = || Axis::linear("vacuum wavelength (nm)").from_to(300.0, 1240.0);
    let mut series = vec![Series::line("above the air", 0, points(light))];
    if let Some(after) = view.transmission.as_ref().and_then(|t| light.through(t).ok()) {
        series.push(Series::line("at the ground", 1, points(&after)));
    }
    let grid: Vec<f64> = (300..=1240).map(f64::from).collect();
    let channels = station.channels.iter().enumerate().map(|(i, channel)| {
        let curve = grid.iter().map(|&nm| (nm, channel.sensitivity_at(nm))).collect();
        Series::line(&channel.name, i, curve)
    });
    Figure {
        title: title.to_owned(),
        panels: vec![
            Panel { x: x(), y: Axis::linear("irradiance (W m⁻² nm⁻¹)"), series },
            Panel {
                x: x(),
                y: Axis::linear("effective sensitivity of the channels"),
                series: channels.collect(),
            },
        ],
    }
}
