//! A calibrated light curve: text, JSON, tables, figure; its irradiances and magnitudes.

use crate::calibrate::colours;
use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_calibration::apply::{Applied, ChannelPhotometry, Photometry, is_valid};
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::text::counted;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, ParseError, Table};
use sunglint_radiometry::light_curve::{ChannelCurve, Flags};
use sunglint_radiometry::station::Station;

/// Why there is no standard magnitude.
const NO_STANDARD: &str = "the curve has no range_m or no phase_deg";

/// A calibrated light curve with what is said about it.
pub struct AppliedReport<'a> {
    /// The curve.
    pub found: &'a Applied,
    /// The station.
    pub station: &'a Station,
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    channel: &'a str,
    samples: usize,
    mean_rate_hz: f64,
    kappa: Option<f64>,
    relative_sigma: Option<f64>,
}

#[derive(Serialize)]
struct AppliedJson<'a> {
    target: &'a str,
    night: &'a str,
    channels: Vec<ChannelJson<'a>>,
    photometry: Option<PhotometryJson<'a>>,
    warnings: &'a [String],
}

impl AppliedReport<'_> {
    /// The curve in all its forms.
    ///
    /// # Errors
    /// A curve that cannot be written as a table.
    pub fn product(&self) -> Result<Product, ParseError> {
        Ok(Product {
            name: "calibrated".into(),
            table: self.found.curve.to_table()?,
            figure: Some(self.figure()),
            json: self.json(),
            others: self.found.photometry.iter().map(photometry_product).collect(),
            ..Product::default()
        })
    }

    fn figure(&self) -> Figure {
        let first = self.found.curve.samples.time[0];
        let seconds: Vec<f64> =
            self.found.curve.samples.time.iter().map(|t| (*t - first).to_seconds()).collect();
        let colours = colours(self.station);
        let mut series = Vec::new();
        for (i, channel) in self.found.curve.channels.iter().enumerate() {
            let all = seconds.iter().copied().zip(channel.rate_hz.iter().copied());
            let valid = all.zip(&channel.flags).filter(|(_, flags)| is_valid(**flags));
            let dots = Series::dots(channel.name.clone(), i, valid.map(|(p, _)| p).collect());
            let place = self.station.channels.iter().position(|c| c.name == channel.name);
            series.push(match place {
                Some(place) => dots.with_colour(colours[place]),
                None => dots,
            });
        }
        let since = sunglint_formats::time::format_utc_shortest(first);
        let x = Axis::linear(format!("s since {since}"));
        let panel = Panel::new(x, Axis::log("calibrated rate (Hz)"), series);
        Figure {
            title: format!("{}, calibrated, night of {}", self.target(), self.found.night.night),
            panels: vec![panel],
        }
    }

    /// The target's name: of the provenance, else of the metadata `target`.
    fn target(&self) -> &str {
        let own = self.found.curve.provenance.target.as_str();
        let named = || self.found.curve.other.get("target")?.get("name")?.as_str();
        if own.is_empty() { named().unwrap_or("a target without a name") } else { own }
    }

    /// Each channel's mean over the valid samples, and their number.
    fn means(&self) -> Vec<(&str, usize, f64)> {
        let mean = |c: &ChannelCurve| {
            let all = c.rate_hz.iter().zip(&c.flags);
            let known: Vec<f64> =
                all.filter(|(v, f)| v.is_finite() && is_valid(**f)).map(|(v, _)| *v).collect();
            (known.len(), known.iter().sum::<f64>() / known.len() as f64)
        };
        let channels = self.found.curve.channels.iter();
        channels.map(|c| (c.name.as_str(), mean(c))).map(|(n, (k, m))| (n, k, m)).collect()
    }

    /// The curve as text.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{}: {}, kappa of the night of {}\n",
            self.target(),
            counted(self.found.curve.len(), "sample"),
            self.found.night.night
        );
        for (name, samples, mean) in self.means() {
            let kappa = match self.found.night.channel(name) {
                Some(r) => format!("{:>10.4} ± {:.2} %", r.kappa, 100.0 * r.relative_sigma),
                None => "not known (the night has no such channel)".into(),
            };
            let mean = match samples {
                0 => "no mean".into(),
                _ => format!("mean {mean:.4e} Hz"),
            };
            let valid = counted(samples, "valid sample");
            let _ = writeln!(text, "  {name:<10} kappa {kappa}   {valid}, {mean}");
        }
        if let Some(photometry) = &self.found.photometry {
            text.push_str(&photometry_text(photometry));
        }
        text
    }

    fn json(&self) -> Value {
        let channel = |(name, samples, mean)| {
            let row = self.found.night.channel(name);
            ChannelJson {
                channel: name,
                samples,
                mean_rate_hz: rounded(mean),
                kappa: row.map(|r| rounded(r.kappa)),
                relative_sigma: row.map(|r| rounded(r.relative_sigma)),
            }
        };
        json_of(&AppliedJson {
            target: self.target(),
            night: &self.found.night.night,
            channels: self.means().into_iter().map(channel).collect(),
            photometry: self.found.photometry.as_ref().map(photometry_json),
            warnings: &self.found.warnings,
        })
    }
}

/// Irradiances and magnitudes in all their forms.
pub fn photometry_product(found: &Photometry) -> Product {
    let time = found.time.iter().map(|t| format_utc_shortest(*t)).collect();
    let mut table = Table { columns: vec![Column::text("time_utc", time)], ..Table::default() };
    let facts = [
        ("band", found.band.clone()),
        ("spectrum", found.spectrum.clone()),
        ("zero_point", found.zero.to_string()),
        (
            "standard_magnitude",
            if found.channels.iter().any(|c| c.standard.is_some()) {
                format!("at 1000 km and a phase angle of 90 deg, phase law: {}", found.law.name())
            } else {
                format!("none: {NO_STANDARD}")
            },
        ),
        (
            "note",
            "above the air; sigma without that of kappa, which is common to all samples".into(),
        ),
    ];
    facts.into_iter().for_each(|(key, value)| drop(table.meta.insert(key.into(), json_of(&value))));
    table.meta.insert("flag_bits".into(), bit_names::<Flags>());
    for c in &found.channels {
        let mut push = |suffix: &str, unit: &str, values: &[f64]| {
            table.columns.push(Column::f64(
                format!("{}_{suffix}", c.name),
                Some(unit),
                values.to_vec(),
            ));
        };
        push("irradiance_w_m2_nm", "W / (m2 nm)", &c.irradiance);
        push("mag", "mag", &c.magnitude);
        push("sigma_mag", "mag", &c.sigma_mag);
        if let Some(standard) = &c.standard {
            push("standard_mag", "mag", standard);
        }
        let bits = c.flags.iter().map(|f| i64::from(f.bits())).collect();
        table.columns.push(Column::i64(format!("{}_flags", c.name), None, bits));
    }
    Product {
        name: "photometry".into(),
        table,
        json: json_of(&photometry_json(found)),
        ..Product::default()
    }
}

fn photometry_text(found: &Photometry) -> String {
    let mut text = format!(
        "{} above the air, {}, by the spectrum {}\n",
        found.band, found.zero, found.spectrum,
    );
    let known = found.channels.iter().any(|c| c.standard.is_some());
    text.push_str(&if known {
        format!("standard magnitudes at 1,000 km and 90°, phase law: {}\n", found.law.name())
    } else {
        format!("no standard magnitudes: {NO_STANDARD}\n")
    });
    for c in &found.channels {
        let range = |values: &Vec<f64>| c.range(values);
        let (Some((least, most)), Some((dim, bright))) =
            (range(&c.magnitude), range(&c.irradiance))
        else {
            let _ = writeln!(text, "  {:<10} no valid sample with light", c.name);
            continue;
        };
        let standard = c.standard.as_ref().and_then(range);
        let standard =
            standard.map_or(String::new(), |(a, b)| format!("; standard {a:.3} to {b:.3} mag"));
        let _ = writeln!(
            text,
            "  {:<10} {least:.3} to {most:.3} mag; {dim:.4e} to {bright:.4e} W/m2/nm{standard}",
            c.name
        );
    }
    text
}

#[derive(Serialize)]
struct RangesJson<'a> {
    channel: &'a str,
    magnitude_range: Option<[f64; 2]>,
    irradiance_range_w_m2_nm: Option<[f64; 2]>,
    standard_magnitude_range: Option<[f64; 2]>,
}

#[derive(Serialize)]
struct PhotometryJson<'a> {
    band: &'a str,
    zero_point: String,
    spectrum: &'a str,
    phase_law: &'a str,
    channels: Vec<RangesJson<'a>>,
}

fn photometry_json(found: &Photometry) -> PhotometryJson<'_> {
    fn channel(c: &ChannelPhotometry) -> RangesJson<'_> {
        let range = |values: &[f64]| c.range(values).map(|(a, b)| [rounded(a), rounded(b)]);
        RangesJson {
            channel: &c.name,
            magnitude_range: range(&c.magnitude),
            irradiance_range_w_m2_nm: range(&c.irradiance),
            standard_magnitude_range: c.standard.as_deref().and_then(range),
        }
    }
    PhotometryJson {
        band: &found.band,
        zero_point: found.zero.to_string(),
        spectrum: &found.spectrum,
        phase_law: found.law.name(),
        channels: found.channels.iter().map(channel).collect(),
    }
}
