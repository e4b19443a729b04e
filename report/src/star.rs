//! A star through time: text, JSON, table and figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, channel_line, json_of};
use hifitime::Unit;
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt::Write as _;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, ParseError, Table, Values};
use sunglint_radiometry::star_track::{ChannelRate, StarSight, StarTrack};
use sunglint_radiometry::station::{Channel, Detector};

/// A track, and how it is to be shown.
#[derive(Debug, Clone, Copy)]
pub struct StarReport<'a> {
    /// The star through time.
    pub track: &'a StarTrack,
    /// Warnings that the user should read first.
    pub warnings: &'a [String],
    /// True for a light curve, false for a moment.
    pub is_night: bool,
}

/// Rows of a light curve that the text shows at most.
const SHOWN: usize = 24;

#[derive(Serialize)]
struct ChannelJson<'a> {
    name: &'a str,
    bandwidth_nm: f64,
    above_air_hz: f64,
    band_average_hz_nm: f64,
    typical_kappa: Option<f64>,
}

#[derive(Serialize)]
struct StarDocument<'a> {
    star: StarJson<'a>,
    station: StationJson<'a>,
    air: AirJson,
    spectrum: SpectrumJson,
    exposure_s: f64,
    channels: Vec<ChannelJson<'a>>,
    warnings: &'a [String],
    samples: Vec<MomentJson>,
}

#[derive(Serialize)]
struct StarJson<'a> {
    name: Option<&'a str>,
    bayer: Option<&'a str>,
    hip: Option<i64>,
    hd: Option<i64>,
    v_mag: Option<f64>,
    bv_mag: Option<f64>,
    spectral_type: Option<&'a str>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct StationJson<'a> {
    name: &'a str,
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
}

#[derive(Serialize)]
struct AirJson {
    description: String,
    pressure_hpa: f64,
    ozone_du: f64,
    water_mm: f64,
    aerosol_optical_depth_550_nm: f64,
}

#[derive(Serialize)]
struct SpectrumJson {
    origin: String,
    fallback: bool,
    colour_excess_mag: Option<f64>,
    zero_point: String,
}

#[derive(Serialize)]
struct RateJson {
    rate_hz: Option<f64>,
    sigma_hz: Option<f64>,
    transmitted: Option<f64>,
    arriving_hz: Option<f64>,
    arriving_adu_s: Option<f64>,
    counted_hz: Option<f64>,
    saturated: bool,
    signal_to_noise: Option<f64>,
    uncovered_nm: f64,
}

#[derive(Serialize)]
struct MomentJson {
    time_utc: String,
    altitude_deg: f64,
    azimuth_deg: f64,
    zenith_true_deg: f64,
    zenith_apparent_deg: Option<f64>,
    airmass_rayleigh: Option<f64>,
    hour_angle_deg: f64,
    ra_of_date_deg: f64,
    dec_of_date_deg: f64,
    hidden: bool,
    horizon_deg: f64,
    earth_orientation: String,
    sun: SunJson,
    moon: MoonJson,
    rates: Map<String, Value>,
}

#[derive(Serialize)]
struct SunJson {
    altitude_deg: f64,
    azimuth_deg: f64,
    twilight: String,
}

#[derive(Serialize)]
struct MoonJson {
    altitude_deg: f64,
    azimuth_deg: f64,
    illuminated_fraction: f64,
    separation_deg: f64,
}

impl StarReport<'_> {
    fn first(&self) -> &StarSight {
        &self.track.sights[0]
    }

    fn title(&self) -> String {
        let (star, station) = (&self.track.star, &self.track.station.name);
        let from = format_utc_shortest(self.first().epoch);
        match self.track.sights.last() {
            Some(last) if self.is_night => {
                format!("{star} from {station}, {from} to {}", format_utc_shortest(last.epoch))
            }
            _ => format!("{star} from {station} at {from}"),
        }
    }

    /// The predicted light curve, with the figure that fits: rates through a night, or the spectrum of a moment.
    ///
    /// # Errors
    /// A curve that the schema does not hold.
    pub fn product(&self) -> Result<Product, ParseError> {
        let curve = self.track.light_curve("sunglint star");
        let name = self
            .track
            .star
            .label()
            .to_lowercase()
            .replace(|c: char| !c.is_ascii_alphanumeric(), "_");
        let figure = if self.is_night { self.rates_figure() } else { self.spectrum_figure() };
        Ok(Product {
            name,
            table: curve.to_table()?,
            figure: Some(figure),
            json: self.json(),
            ..Product::default()
        })
    }

    /// The star's spectrum at the first moment.
    pub fn spectrum(&self) -> Product {
        let light = &self.track.light.irradiance;
        let transmission = self.track.transmission(self.first());
        // The union of both grids, so that nothing of either is lost.
        let after = transmission.as_ref().and_then(|t| light.through(t).ok());
        let grid = after.as_ref().map_or(light.wavelength_nm(), |a| a.wavelength_nm()).to_vec();
        let mut table = Table::default();
        for (key, value) in [
            ("title", self.title()),
            ("spectrum", self.track.light.origin.to_string()),
            ("zero_point", self.track.zero.to_string()),
            ("air", self.track.air.describe()),
        ] {
            table.meta.insert(key.into(), json_of(&value));
        }
        let unit = Some("W / (m2 nm)");
        // Below the horizon nothing comes through: the columns stay, without numbers.
        let t =
            grid.iter().map(|nm| transmission.as_ref().map_or(f64::NAN, |t| t.at(*nm))).collect();
        let below = after.map_or(vec![f64::NAN; grid.len()], |a| a.value().to_vec());
        let above = grid.iter().map(|nm| light.at(*nm)).collect();
        table.meta.insert(
            "provenance".into(),
            self.track.light_curve("sunglint star").provenance.to_json(),
        );
        table.columns = vec![
            Column::f64("wavelength_nm", Some("nm"), grid),
            Column::f64("irradiance_w_m2_nm", unit, above),
            Column::f64("transmission", None, t),
            Column::f64("ground_irradiance_w_m2_nm", unit, below),
        ];
        let mut json = Value::Object(table.meta.clone());
        for column in &table.columns {
            if let Values::F64(values) = &column.values {
                json[&column.name] = json_of(&values);
            }
        }
        Product {
            name: "spectrum".into(),
            table,
            figure: Some(self.spectrum_figure()),
            json,
            ..Product::default()
        }
    }

    fn spectrum_figure(&self) -> Figure {
        let light = &self.track.light.irradiance;
        let points = |x: &[f64], y: &[f64]| x.iter().copied().zip(y.iter().copied()).collect();
        let x = || Axis::linear("vacuum wavelength (nm)").from_to(300.0, 1240.0);
        let mut series =
            vec![Series::line("above the air", 0, points(light.wavelength_nm(), light.value()))];
        if let Some(after) =
            self.track.transmission(self.first()).and_then(|t| light.through(&t).ok())
        {
            series.push(Series::line(
                "at the ground",
                1,
                points(after.wavelength_nm(), after.value()),
            ));
        }
        let grid: Vec<f64> = (300..=1240).map(f64::from).collect();
        let channels = self.track.station.channels.iter().map(|channel| {
            let curve = grid.iter().map(|&nm| (nm, channel.sensitivity_at(nm))).collect();
            channel_line(channel, curve)
        });
        Figure {
            title: self.title(),
            panels: vec![
                Panel::new(x(), Axis::linear("irradiance (W m⁻² nm⁻¹)"), series),
                Panel::new(
                    x(),
                    Axis::linear("effective sensitivity of the channels"),
                    channels.collect(),
                ),
            ],
        }
    }

    fn rates_figure(&self) -> Figure {
        let start = self.first().epoch;
        let hours = |s: &StarSight| (s.epoch - start).to_unit(Unit::Hour);
        let x = || Axis::linear(format!("hours after {}", format_utc_shortest(start)));
        let shown = |s: &StarSight, i: usize| {
            if s.hidden { f64::NAN } else { s.rates[i].rate_hz.unwrap_or(f64::NAN) }
        };
        let rates = self.track.station.channels.iter().enumerate().map(|(i, channel)| {
            channel_line(
                channel,
                self.track.sights.iter().map(|s| (hours(s), shown(s, i))).collect(),
            )
        });
        let rates: Vec<Series> = rates.collect();
        let any = rates.iter().flat_map(|r| &r.points).any(|(_, hz)| *hz > 0.0);
        let altitude = self
            .track
            .sights
            .iter()
            .map(|s| (hours(s), s.place.horizontal.altitude_deg()))
            .collect();
        let sun =
            self.track.sights.iter().map(|s| (hours(s), s.sun.horizontal.altitude_deg())).collect();
        let moon = self
            .track
            .sights
            .iter()
            .map(|s| (hours(s), s.moon.horizontal.altitude_deg()))
            .collect();
        let altitudes = Panel::new(
            x(),
            Axis::linear("altitude (°)"),
            vec![
                Series::line(self.track.star.label(), 0, altitude),
                Series::line("Sun", 5, sun),
                Series::line("Moon", 6, moon),
            ],
        );
        let y = Axis::log("predicted rate at the detector (Hz)");
        // A star that never rises has altitudes, but no rates.
        let mut panels = if any { vec![Panel::new(x(), y, rates)] } else { Vec::new() };
        panels.push(altitudes);
        Figure { title: self.title(), panels }
    }

    fn json(&self) -> Value {
        let StarTrack { star, light, station, air, exposure_s, sights, .. } = self.track;
        let (site, columns) = (station.site.geodetic(), air.columns());
        let first = &self.first().rates;
        let channels: Vec<_> = station
            .channels
            .iter()
            .zip(first)
            .map(|(c, r)| ChannelJson {
                name: &c.name,
                bandwidth_nm: c.bandwidth_nm(),
                above_air_hz: r.above_air_hz,
                band_average_hz_nm: r.above_air_hz / c.bandwidth_nm(),
                typical_kappa: c.typical_kappa,
            })
            .collect();
        json_of(&StarDocument {
            star: StarJson {
                name: star.name.as_deref(),
                bayer: star.bayer.as_deref(),
                hip: star.hip,
                hd: star.hd,
                v_mag: star.v_mag,
                bv_mag: star.bv_mag,
                spectral_type: star.spectral_type.as_deref(),
                notes: star.notes().iter().map(ToString::to_string).collect(),
            },
            station: StationJson {
                name: &station.name,
                latitude_deg: site.latitude_deg,
                longitude_deg: site.longitude_deg,
                height_m: site.height_m,
            },
            air: AirJson {
                description: self.track.air.describe(),
                pressure_hpa: columns.pressure_hpa,
                ozone_du: columns.ozone_du,
                water_mm: columns.water_mm,
                aerosol_optical_depth_550_nm: columns.aerosol_550,
            },
            spectrum: SpectrumJson {
                origin: light.origin.to_string(),
                fallback: light.origin.is_fallback(),
                colour_excess_mag: light.colour_excess_mag,
                zero_point: self.track.zero.to_string(),
            },
            exposure_s: *exposure_s,
            channels,
            warnings: self.warnings,
            samples: sights.iter().map(|s| self.sample(s)).collect(),
        })
    }

    fn sample(&self, s: &StarSight) -> MomentJson {
        let h = s.place.horizontal;
        let rates = self.track.station.channels.iter().zip(&s.rates).map(|(channel, r)| {
            let is_counter = matches!(channel.detector, Detector::Counter(_));
            let value = json_of(&RateJson {
                rate_hz: r.rate_hz,
                sigma_hz: r.sigma_hz,
                transmitted: r.transmitted(),
                arriving_hz: r.arriving.filter(|_| is_counter),
                arriving_adu_s: r.arriving.filter(|_| !is_counter),
                counted_hz: r.counted_hz,
                saturated: r.saturated,
                signal_to_noise: r.signal_to_noise(),
                uncovered_nm: r.uncovered_nm,
            });
            (channel.name.clone(), value)
        });
        MomentJson {
            time_utc: format_utc_shortest(s.epoch),
            altitude_deg: h.altitude_deg(),
            azimuth_deg: h.azimuth_deg(),
            zenith_true_deg: h.zenith_deg(),
            zenith_apparent_deg: s.path.as_ref().map(|p| p.apparent_deg),
            airmass_rayleigh: s.airmass,
            hour_angle_deg: s.place.hour_angle_deg,
            ra_of_date_deg: s.place.of_date.ra_deg,
            dec_of_date_deg: s.place.of_date.dec_deg,
            hidden: s.hidden,
            horizon_deg: self.track.station.horizon.elevation_deg(h.azimuth_deg()),
            earth_orientation: s.orientation.to_string(),
            sun: SunJson {
                altitude_deg: s.sun.horizontal.altitude_deg(),
                azimuth_deg: s.sun.horizontal.azimuth_deg(),
                twilight: s.twilight.to_string(),
            },
            moon: MoonJson {
                altitude_deg: s.moon.horizontal.altitude_deg(),
                azimuth_deg: s.moon.horizontal.azimuth_deg(),
                illuminated_fraction: s.moon.place.illuminated_fraction(),
                separation_deg: s.moon_separation_deg,
            },
            rates: rates.collect(),
        }
    }

    /// The text.
    pub fn text(&self) -> String {
        let mut text = self.heading();
        if self.is_night {
            self.say_night(&mut text);
        } else {
            self.say_moment(&mut text);
        }
        text
    }

    fn heading(&self) -> String {
        let star = &self.track.star;
        let or_unknown = |v: Option<f64>| v.map_or("unknown".to_owned(), |v| v.to_string());
        let mut text = format!(
            "{star}{}: V {}, B-V {}, {}\n",
            star.hd.map_or(String::new(), |hd| format!(", HD {hd}")),
            or_unknown(star.v_mag),
            or_unknown(star.bv_mag),
            star.spectral_type.as_deref().unwrap_or("type unknown")
        );
        for note in star.notes() {
            let _ = writeln!(text, "  note: {note}");
        }
        let site = self.track.station.site.geodetic();
        let _ = writeln!(
            text,
            "station: {} ({:.4}°, {:.4}°, {} m)\nair: {}\nspectrum: {}; {}; V counts from {}\n",
            self.track.station.name,
            site.latitude_deg,
            site.longitude_deg,
            site.height_m,
            self.track.air.describe(),
            self.track.light.origin,
            self.track.colour_check(),
            self.track.zero
        );
        text
    }

    fn say_moment(&self, text: &mut String) {
        let s = self.first();
        let (h, of_date) = (s.place.horizontal, s.place.of_date);
        let _ = writeln!(
            text,
            "{}\n  altitude {:.4}°  azimuth {:.4}°  zenith angle {:.4}° (true)  hour angle {:+.4}°\n  right ascension {:.5}°  declination {:+.5}° (of date)",
            format_utc_shortest(s.epoch),
            h.altitude_deg(),
            h.azimuth_deg(),
            h.zenith_deg(),
            s.place.hour_angle_deg,
            of_date.ra_deg,
            of_date.dec_deg
        );
        let _ = writeln!(
            text,
            "  Sun at {:+.1}° ({}); Moon at {:+.1}°, {:.0} % lit, {:.0}° from the star",
            s.sun.horizontal.altitude_deg(),
            s.twilight,
            s.moon.horizontal.altitude_deg(),
            100.0 * s.moon.place.illuminated_fraction(),
            s.moon_separation_deg
        );
        match (&s.path, s.airmass) {
            (Some(path), Some(airmass)) => {
                let _ = writeln!(
                    text,
                    "  apparent zenith angle {:.4}°  airmass {airmass:.4}",
                    path.apparent_deg
                );
                if s.hidden {
                    let mask = self.track.station.horizon.elevation_deg(h.azimuth_deg());
                    let _ = writeln!(
                        text,
                        "  BEHIND the station's horizon, which is at {mask:.1}° there: the rates are as if it were free"
                    );
                }
            }
            _ => text.push_str("  BELOW the horizon: no light comes through\n"),
        }
        let _ = writeln!(
            text,
            "\n  channel   predicted rate  above the air  transmitted  extinction  band average   arriving        counted         S/N in {} s",
            self.track.exposure_s
        );
        for (channel, rate) in self.track.station.channels.iter().zip(&s.rates) {
            say_channel(text, channel, rate);
        }
        text.push_str(FOOTNOTE);
    }

    fn say_night(&self, text: &mut String) {
        let sights = &self.track.sights;
        let _ = write!(text, "  {:<24} altitude  azimuth airmass   Sun   ", "time (UTC)");
        for channel in &self.track.station.channels {
            let _ = write!(text, "{:>11}", channel.name);
        }
        text.push_str("  (predicted Hz)\n");
        let step = sights.len().div_ceil(SHOWN);
        for s in sights.iter().step_by(step) {
            let h = s.place.horizontal;
            let airmass = s.airmass.map_or("-".into(), |m| format!("{m:.3}"));
            let _ = write!(
                text,
                "  {:<24} {:8.2} {:8.2} {airmass:>7} {:6.1} ",
                format_utc_shortest(s.epoch),
                h.altitude_deg(),
                h.azimuth_deg(),
                s.sun.horizontal.altitude_deg()
            );
            for rate in &s.rates {
                match rate.rate_hz {
                    Some(hz) if !s.hidden => {
                        let _ =
                            write!(text, "{hz:>10.3e}{}", if rate.saturated { '*' } else { ' ' });
                    }
                    _ => {
                        let _ = write!(text, "{:>10} ", "hidden");
                    }
                }
            }
            text.push('\n');
        }
        let hidden = sights.iter().filter(|s| s.hidden).count();
        let highest = sights.iter().max_by(|a, b| {
            a.place.horizontal.altitude_deg().total_cmp(&b.place.horizontal.altitude_deg())
        });
        let every = if step > 1 { format!(", every {step} shown") } else { String::new() };
        if let Some(highest) = highest {
            let _ = writeln!(
                text,
                "\n{} samples{every}; {hidden} below the station's horizon; highest at {}: {:.2}°. * past the counter's saturation.",
                sights.len(),
                format_utc_shortest(highest.epoch),
                highest.place.horizontal.altitude_deg()
            );
        }
        text.push_str("`-o FILE` writes the predicted light curve (.ecsv, .csv, .fits, .json) or draws it (.png, .svg).\n");
    }
}

fn say_channel(text: &mut String, channel: &Channel, r: &ChannelRate) {
    let or_dash = |v: Option<f64>, write: &dyn Fn(f64) -> String| v.map_or("-".to_owned(), write);
    let unit = match channel.detector {
        Detector::Counter(_) => "Hz",
        Detector::CameraPlane(_) => "ADU/s",
    };
    let hz = |v: f64| format!("{v:.4e} Hz");
    let transmitted = r.transmitted();
    let _ = write!(
        text,
        "  {:<8} {:>15} {:>14} {:>12} {:>11} {:>11} Hz/nm {:>16} {:>14} {:>12}",
        channel.name,
        or_dash(r.rate_hz, &hz),
        hz(r.above_air_hz),
        or_dash(transmitted, &|v| format!("{v:.4}")),
        or_dash(transmitted, &|v| format!("{:.3} mag", -2.5 * v.log10())),
        format!("{:.3e}", r.above_air_hz / channel.bandwidth_nm()),
        or_dash(r.arriving, &|v| format!("{v:.3e} {unit}")),
        or_dash(r.counted_hz, &|v| format!("{v:.3e} Hz")),
        or_dash(r.signal_to_noise(), &|v| format!("{v:.0}")),
    );
    if r.saturated {
        text.push_str("   PAST SATURATION: attenuate");
    }
    if r.uncovered_nm > 0.0 {
        let _ = write!(text, "   (no spectrum or air for {:.0} nm of it)", r.uncovered_nm);
    }
    text.push('\n');
}

const FOOTNOTE: &str = "\npredicted: after the air, by the station's curves; arriving: over the channel's typical kappa (losses that only the star calibration knows);\n\
    counted: that and the dark rate through the dead time. S/N: photons, dark counts and dead time of counters, photons alone of a camera; no\n\
    scintillation. Whether a camera saturates depends on exposure and seeing and is not judged.\n";
