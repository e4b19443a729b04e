//! Nights calibrated from stars: text, JSON, tables, figures.

mod figure;

pub use figure::colours;

use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_calibration::stars::{
    CalibratedNight, CalibratedNights, MeasuredVisit, Slope, Variation,
};
use sunglint_formats::text::counted;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table, Values};
use sunglint_numerics::measured::Measured;
use sunglint_radiometry::station::Station;

/// Calibrated nights with what is said about them.
pub struct CalibrationReport<'a> {
    /// The nights.
    pub found: &'a CalibratedNights,
    /// The station.
    pub station: &'a Station,
    /// Warnings of the whole work.
    pub warnings: &'a [String],
}

#[derive(Serialize)]
struct SlopeJson {
    value: f64,
    sigma: f64,
}

fn slope_json(slope: Option<Slope>) -> Option<SlopeJson> {
    slope.map(|s| SlopeJson { value: rounded(s.value), sigma: rounded(s.sigma) })
}

#[derive(Serialize)]
struct VariationJson<'a> {
    channel: &'a str,
    nights: usize,
    mean: f64,
    coefficient_of_variation: f64,
}

#[derive(Serialize)]
struct NightsJson<'a> {
    station: &'a str,
    air: &'a str,
    zero_point: &'a str,
    confidence: f64,
    nights: Vec<NightJson<'a>>,
    variation: Vec<VariationJson<'a>>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    channel: &'a str,
    kappa: f64,
    relative_sigma: f64,
    interval: [f64; 2],
    stars: usize,
    visits: usize,
    rms: f64,
    per_airmass: Option<SlopeJson>,
    per_colour: Option<SlopeJson>,
}

#[derive(Serialize)]
struct RatioJson<'a> {
    channel: &'a str,
    reference: &'a str,
    visits: usize,
    exponent: Option<SlopeJson>,
    by_brightness: Option<SlopeJson>,
}

#[derive(Serialize)]
struct VisitJson<'a> {
    time_utc: String,
    star: &'a str,
    spectrum: String,
    agrees: bool,
    decides: bool,
    airmass: f64,
    offset: f64,
    offset_sigma: f64,
}

/// Probability of a choice of stars below which it is said.
const SURE: f64 = 0.9;

#[derive(Serialize)]
struct NightJson<'a> {
    night: &'a str,
    stars: usize,
    agreeing_stars: usize,
    agreement_probability: f64,
    airmass_range: [f64; 3],
    b_minus_v_range_mag: Option<[f64; 3]>,
    common_scatter: f64,
    judged_about_a_slope: bool,
    interval_by: &'a str,
    aerosol_depth: Option<[f64; 2]>,
    channels: Vec<ChannelJson<'a>>,
    without_kappa: &'a [[String; 2]],
    covariance_ln_kappa: Vec<Vec<f64>>,
    ratios: Vec<RatioJson<'a>>,
    visits: Vec<VisitJson<'a>>,
}

impl CalibrationReport<'_> {
    /// The nights in all their forms.
    pub fn product(&self) -> Product {
        let mut others = Vec::new();
        for night in &self.found.nights {
            others.push(Product {
                name: format!("stars_{}", night.file.night),
                table: self.visits(night),
                figure: (self.found.nights.len() > 1).then(|| figure::figure(night, self.station)),
                ..Product::default()
            });
        }
        Product {
            name: "calibration".into(),
            table: self.found.file.to_table(),
            figure: Some(match &self.found.nights[..] {
                [night] => figure::figure(night, self.station),
                nights => figure::nights(nights, self.station),
            }),
            json: self.json(),
            others,
            ..Product::default()
        }
    }

    /// A row a visit.
    fn visits(&self, night: &CalibratedNight) -> Table {
        let numbers = |name: &str, value: &dyn Fn(usize) -> f64| {
            Column::f64(name, None, (0..night.visits.len()).map(value).collect())
        };
        let texts = |name: &str, value: &dyn Fn(&MeasuredVisit) -> String| {
            Column::text(name, night.visits.iter().map(value).collect())
        };
        let truth = |name: &str, value: &dyn Fn(usize) -> bool| Column {
            name: name.into(),
            unit: None,
            description: None,
            values: Values::Bool((0..night.visits.len()).map(|i| Some(value(i))).collect()),
        };
        let mut columns = vec![
            texts("time_utc", &|v| format_utc_shortest(v.middle)),
            texts("star", &|v| v.star.clone()),
            texts("spectrum", &|v| v.light.origin.to_string()),
            truth("agrees", &|i| night.found.visits[i].agrees),
            truth("decides", &|i| night.found.visits[i].decides),
            numbers("airmass", &|i| night.visits[i].airmass),
            numbers("b_minus_v_mag", &|i| night.visits[i].b_minus_v_mag.unwrap_or(f64::NAN)),
            numbers("offset", &|i| night.found.visits[i].offset),
            numbers("offset_sigma", &|i| night.found.visits[i].sigma),
        ];
        for (c, channel) in self.station.channels.iter().enumerate() {
            let of = |i: usize| night.input[i].channels[c];
            let name = |suffix: &str| format!("{}_{suffix}", channel.name);
            columns.push(numbers(&name("predicted_hz"), &|i| {
                of(i).map_or(f64::NAN, |m| m.predicted_hz)
            }));
            columns
                .push(numbers(&name("measured"), &|i| of(i).map_or(f64::NAN, |m| m.measured_hz)));
            columns.push(numbers(&name("measured_sigma"), &|i| {
                of(i).map_or(f64::NAN, |m| m.sigma_hz)
            }));
            columns.push(numbers(&name("residual"), &|i| {
                night.found.visits[i].residuals[c].unwrap_or(f64::NAN)
            }));
        }
        Table { columns, ..Table::default() }
    }

    /// The nights as text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let _ = writeln!(
            text,
            "Star calibration of {}: predicted = kappa x measured",
            self.station.name
        );
        let _ = writeln!(text, "air: {}", self.found.file.air);
        for night in &self.found.nights {
            self.night_text(night, &mut text);
        }
        if self.found.nights.len() > 1 {
            let _ = writeln!(text, "\nOver {}:", counted(self.found.nights.len(), "night"));
            for (name, found) in self.variations() {
                let _ = writeln!(
                    text,
                    "  {name:<10} mean {:>10.4}   coefficient of variation {:>6.2} % ({} nights)",
                    found.mean,
                    100.0 * found.coefficient,
                    found.nights
                );
            }
        }
        text
    }

    fn night_text(&self, night: &CalibratedNight, text: &mut String) {
        let facts = &night.file.facts;
        let [low, mean, high] = night.found.airmass;
        let _ = writeln!(
            text,
            "\nNight of {}: {} of {} stars agree, airmass {low:.2} to {high:.2} (mean {mean:.2}){}, common scatter {:.1} %",
            night.file.night,
            facts.agreeing_stars,
            facts.stars,
            facts
                .b_minus_v_mag
                .map_or(String::new(), |[a, _, b]| format!(", B-V {a:.2} to {b:.2}")),
            100.0 * night.found.common_scatter
        );
        let probability = night.found.agreement_probability;
        if probability < SURE {
            let _ = writeln!(
                text,
                "  which stars agree is not sure: this choice has {:.0} % of the probability, and the intervals hold the others",
                100.0 * probability
            );
        }
        let _ = writeln!(
            text,
            "  {:<10} {:>10} {:>7} {:>22} {:>6} {:>6}  {:<16} {:<16}",
            "channel",
            "kappa",
            "±%",
            format!("{:.0} % interval", 100.0 * self.found.file.confidence),
            "stars",
            "rms %",
            "per airmass",
            "per mag of B-V"
        );
        for c in &night.file.channels {
            let or_none = |s: Option<Slope>| s.map_or("-".to_owned(), |s| s.percent());
            let interval = format!("{:.4} to {:.4}", c.interval.0, c.interval.1);
            let _ = writeln!(
                text,
                "  {:<10} {:>10.4} {:>7.2} {interval:>22} {:>6} {:>6.2}  {:<16} {:<16}",
                c.channel,
                c.kappa,
                100.0 * c.relative_sigma,
                c.stars,
                100.0 * c.rms,
                or_none(c.per_airmass),
                or_none(c.per_colour)
            );
        }
        if let Some(Err(why)) = night.found.channels.iter().flatten().map(|c| &c.per_airmass).next()
        {
            let _ = writeln!(text, "  no slope against airmass: {why}");
        }
        if let Some(Measured { value: depth, sigma }) = facts.aerosol_depth {
            let _ = writeln!(text, "  aerosol, fitted: τ(550 nm) = {depth:.3} ± {sigma:.3}");
        }
        for check in &night.found.ratios {
            let name = |c: usize| &self.station.channels[c].name;
            let exponent =
                check.exponent.map_or("exponent not determined (too few stars)".into(), |s| {
                    format!("exponent {:.3} ± {:.3} (1 is right)", s.value, s.sigma)
                });
            let bright = check
                .by_brightness
                .map_or("slope with brightness not determined".to_owned(), |s| {
                    format!("{} per factor e in brightness (0 is linear)", s.percent())
                });
            let _ = writeln!(
                text,
                "  ratio {}/{}: {exponent}, {bright}",
                name(check.channel),
                name(check.reference)
            );
        }
        for (judged, visit) in night.found.visits.iter().zip(&night.visits) {
            if judged.agrees {
                continue;
            }
            let why = match (judged.offset.is_nan(), judged.decides) {
                (true, _) => "nothing measured".to_owned(),
                (_, false) => {
                    format!("may not decide ({}); {}", visit.light.origin, dimmer(judged.offset))
                }
                _ => format!(
                    "{}, {:.0} sigma",
                    dimmer(judged.offset),
                    judged.offset.abs() / judged.sigma
                ),
            };
            let _ = writeln!(text, "  out: {}: {why}", label(visit));
        }
    }

    fn variations(&self) -> impl Iterator<Item = (&str, Variation)> {
        let named =
            |(c, found): (usize, Variation)| (self.station.channels[c].name.as_str(), found);
        self.found.variations().into_iter().map(named)
    }

    fn json(&self) -> Value {
        let nights: Vec<_> = self.found.nights.iter().map(|n| self.night_json(n)).collect();
        let variation = self.variations().map(|(name, v)| VariationJson {
            channel: name,
            nights: v.nights,
            mean: rounded(v.mean),
            coefficient_of_variation: rounded(v.coefficient),
        });
        json_of(&NightsJson {
            station: &self.found.file.station,
            air: &self.found.file.air,
            zero_point: &self.found.file.zero_point,
            confidence: self.found.file.confidence,
            nights,
            variation: variation.collect(),
            warnings: self.warnings,
        })
    }

    fn night_json<'a>(&'a self, night: &'a CalibratedNight) -> NightJson<'a> {
        let channels: Vec<_> = night
            .file
            .channels
            .iter()
            .map(|c| ChannelJson {
                channel: &c.channel,
                kappa: rounded(c.kappa),
                relative_sigma: rounded(c.relative_sigma),
                interval: [rounded(c.interval.0), rounded(c.interval.1)],
                stars: c.stars,
                visits: c.visits,
                rms: rounded(c.rms),
                per_airmass: slope_json(c.per_airmass),
                per_colour: slope_json(c.per_colour),
            })
            .collect();
        let name = |c: usize| &self.station.channels[c].name;
        let ratios: Vec<_> = night
            .found
            .ratios
            .iter()
            .map(|r| RatioJson {
                channel: name(r.channel),
                reference: name(r.reference),
                visits: r.visits,
                exponent: slope_json(r.exponent),
                by_brightness: slope_json(r.by_brightness),
            })
            .collect();
        let visits: Vec<_> = night
            .found
            .visits
            .iter()
            .zip(&night.visits)
            .map(|(judged, v)| VisitJson {
                time_utc: format_utc_shortest(v.middle),
                star: &v.star,
                spectrum: v.light.origin.to_string(),
                agrees: judged.agrees,
                decides: judged.decides,
                airmass: rounded(v.airmass),
                offset: rounded(judged.offset),
                offset_sigma: rounded(judged.sigma),
            })
            .collect();
        let facts = &night.file.facts;
        NightJson {
            night: &night.file.night,
            stars: facts.stars,
            agreeing_stars: facts.agreeing_stars,
            agreement_probability: rounded(night.found.agreement_probability),
            airmass_range: night.found.airmass.map(rounded),
            b_minus_v_range_mag: night.found.b_minus_v_mag.map(|r| r.map(rounded)),
            common_scatter: rounded(night.found.common_scatter),
            judged_about_a_slope: night.found.sloped,
            interval_by: night.found.method,
            aerosol_depth: facts.aerosol_depth.map(Measured::to_array),
            channels,
            without_kappa: &facts.without_kappa,
            covariance_ln_kappa: night
                .file
                .covariance
                .iter()
                .map(|row| row.iter().map(|v| rounded(*v)).collect())
                .collect(),
            ratios,
            visits,
        }
    }
}

/// A visit in words.
fn label(visit: &MeasuredVisit) -> String {
    format!("{} at {}", visit.star, format_utc_shortest(visit.middle))
}

/// An offset in words.
fn dimmer(offset: f64) -> String {
    let share = 1.0 - (-offset).exp();
    if share.abs() < 0.005 {
        "as bright as predicted".to_owned()
    } else if share > 0.0 {
        format!("{:.0} % too faint", 100.0 * share)
    } else {
        format!("{:.0} % too bright", -100.0 * share)
    }
}
