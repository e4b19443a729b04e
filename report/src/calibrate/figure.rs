//! The figure of a night: measured against predicted, ratios of channels, what is left against airmass and colour.

use crate::plot::{Axis, COLOURS, Figure, Panel, RGBColor, Series, colour_of_wavelength_nm};
use sunglint_calibration::stars::{CalibratedNight, Judgement, Visit};
use sunglint_formats::text::counted;
use sunglint_radiometry::station::Station;

/// Outliers are drawn paler.
fn pale(colour: RGBColor) -> RGBColor {
    let mix = |c: u8| c / 3 + 170;
    RGBColor(mix(colour.0), mix(colour.1), mix(colour.2))
}

/// The grey of lines that are no data.
const GUIDE: RGBColor = RGBColor(170, 170, 170);
/// Colours nearer to each other, in bytes, are taken for one.
const ALIKE: f64 = 60.0;

/// A colour for each channel: its wavelength's, or where another channel has nearly that already, the first of the palette that none has.
pub fn colours(station: &Station) -> Vec<RGBColor> {
    let mut found: Vec<RGBColor> = Vec::new();
    for (c, channel) in station.channels.iter().enumerate() {
        let free = |colour: &RGBColor| found.iter().all(|other| distance(*colour, *other) > ALIKE);
        let nm = channel.mean_wavelength_nm();
        let own = nm.is_finite().then(|| colour_of_wavelength_nm(nm));
        let picked = own.into_iter().chain(COLOURS).find(free);
        found.push(picked.unwrap_or(COLOURS[c % COLOURS.len()]));
    }
    found
}

fn distance(a: RGBColor, b: RGBColor) -> f64 {
    let square = |a: u8, b: u8| (f64::from(a) - f64::from(b)).powi(2);
    (square(a.0, b.0) + square(a.1, b.1) + square(a.2, b.2)).sqrt()
}

/// A line from the smallest to the largest abscissa of points.
fn line(points: &[(f64, f64)], y: impl Fn(f64) -> f64, colour: RGBColor) -> Series {
    let x = || points.iter().map(|p| p.0);
    let (low, high) = (x().fold(f64::INFINITY, f64::min), x().fold(f64::NEG_INFINITY, f64::max));
    Series::line("", 0, vec![(low, y(low)), (high, y(high))]).with_colour(colour)
}

/// κ of all nights over their mean, against the days since the first.
pub(super) fn nights(nights: &[CalibratedNight], station: &Station) -> Figure {
    let day = |night: &CalibratedNight| {
        let at = sunglint_formats::time::parse_utc(&format!("{}T12:00:00", night.file.night));
        at.map_or(f64::NAN, |t| t.to_mjd_utc_days())
    };
    let first = nights.first().map_or(f64::NAN, day);
    let colours = colours(station);
    let mut series = Vec::new();
    for (c, channel) in station.channels.iter().enumerate() {
        let known: Vec<(f64, f64)> =
            nights.iter().filter_map(|n| Some((day(n) - first, n.kappa(c)?))).collect();
        let mean = known.iter().map(|p| p.1).sum::<f64>() / known.len() as f64;
        let points: Vec<_> = known.into_iter().map(|(day, k)| (day, k / mean)).collect();
        series.push(Series::line("", c, points.clone()).with_colour(colours[c]));
        series.push(Series::dots(channel.name.clone(), c, points).with_colour(colours[c]));
    }
    let since = nights.first().map_or("", |n| &n.file.night);
    let x = Axis::linear(format!("days since the night of {since}"));
    Figure {
        title: format!("Star calibration of {}, {}", station.name, counted(nights.len(), "night")),
        panels: vec![Panel::new(x, Axis::linear("kappa over its mean"), series)],
    }
}

pub(super) fn figure(night: &CalibratedNight, station: &Station) -> Figure {
    let title = format!(
        "Star calibration of {}, night of {} (pale: not used)",
        station.name, night.file.night
    );
    let panels = [
        rates(night, station),
        ratios(night, station),
        left(night, station, "airmass", &|i| Some(night.input[i].airmass)),
        left(night, station, "B-V (mag)", &|i| night.input[i].b_minus_v_mag),
    ];
    let drawable = |p: &Panel| p.series.iter().any(|s| !s.points.is_empty());
    Figure { title, panels: panels.into_iter().filter(drawable).collect() }
}

/// Band averages, as measured times κ's line through them.
fn rates(night: &CalibratedNight, station: &Station) -> Panel {
    let mut series = Vec::new();
    let colours = colours(station);
    for (c, channel) in station.channels.iter().enumerate() {
        let width_nm = channel.bandwidth_nm();
        let points = |good: bool| -> Vec<(f64, f64)> {
            let of = |(i, v): (usize, &Visit)| {
                let m = v.channels[c]?;
                let wanted = night.found.visits[i].agrees == good && m.measured_hz > 0.0;
                wanted.then_some((m.measured_hz / width_nm, m.predicted_hz / width_nm))
            };
            night.input.iter().enumerate().filter_map(of).collect()
        };
        let (good, bad) = (points(true), points(false));
        let colour = colours[c];
        if let Ok(k) = &night.found.channels[c] {
            series.push(line(&good, |x| k.kappa * x, colour));
        }
        series.push(Series::dots(channel.name.clone(), c, good).with_colour(colour));
        series.push(Series::dots("", c, bad).with_colour(pale(colour)));
    }
    let x = Axis::log("measured rate / bandwidth (1/s/nm)");
    Panel::new(x, Axis::log("predicted rate / bandwidth (1/s/nm)"), series)
}

/// Ratios of the channels to the reference: on the diagonal where all is linear.
fn ratios(night: &CalibratedNight, station: &Station) -> Panel {
    let (mut series, mut all) = (Vec::new(), Vec::new());
    let colours = colours(station);
    for check in &night.found.ratios {
        let (a, b) = (check.channel, check.reference);
        let of = |(i, v): (usize, &Visit)| {
            let (p, q) = (v.channels[a]?, v.channels[b]?);
            let scale = night.kappa(a)? / night.kappa(b)?;
            let point = (scale * p.measured_hz / q.measured_hz, p.predicted_hz / q.predicted_hz);
            night.found.visits[i].agrees.then_some(point)
        };
        let points: Vec<(f64, f64)> = night.input.iter().enumerate().filter_map(of).collect();
        let name = format!("{}/{}", station.channels[a].name, station.channels[b].name);
        all.extend_from_slice(&points);
        series.push(Series::dots(name, a, points).with_colour(colours[a]));
    }
    if !all.is_empty() {
        series.insert(0, line(&all, |x| x, GUIDE));
    }
    let x = Axis::log("measured ratio of calibrated rates");
    Panel::new(x, Axis::log("predicted ratio"), series)
}

/// Residuals of the stars that agree.
fn left(
    night: &CalibratedNight,
    station: &Station,
    label: &str,
    x: &dyn Fn(usize) -> Option<f64>,
) -> Panel {
    let (mut series, mut all) = (Vec::new(), Vec::new());
    let colours = colours(station);
    for (c, channel) in station.channels.iter().enumerate() {
        let of = |(i, v): (usize, &Judgement)| {
            let r = v.residuals[c].filter(|_| v.agrees)?;
            Some((x(i)?, 100.0 * r))
        };
        let points: Vec<(f64, f64)> =
            night.found.visits.iter().enumerate().filter_map(of).collect();
        all.extend_from_slice(&points);
        series.push(Series::dots(channel.name.clone(), c, points).with_colour(colours[c]));
    }
    if !all.is_empty() {
        series.insert(0, line(&all, |_| 0.0, GUIDE));
    }
    Panel::new(Axis::linear(label), Axis::linear("ln(predicted/calibrated) (%)"), series)
}
