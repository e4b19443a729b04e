//! The figure of a night: measured against predicted, ratios of channels, what is left against airmass and colour.

use super::report::NightResult;
use crate::plot::{Axis, COLOURS, Figure, Panel, RGBColor, Series, colour_of_wavelength_nm};
use sunglint_radiometry::station::Station;

/// Outliers are drawn paler.
fn pale(colour: RGBColor) -> RGBColor {
    let mix = |c: u8| c / 3 + 170;
    RGBColor(mix(colour.0), mix(colour.1), mix(colour.2))
}

fn colour(station: &Station, c: usize) -> RGBColor {
    // Bands of one colour are told apart by the order of the palette.
    let nm = station.channels[c].mean_wavelength_nm();
    if nm.is_finite() { colour_of_wavelength_nm(nm) } else { COLOURS[c % COLOURS.len()] }
}

pub(super) fn figure(night: &NightResult, station: &Station) -> Figure {
    let title = format!(
        "Star calibration of {}, night of {} (pale: outliers)",
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
fn rates(night: &NightResult, station: &Station) -> Panel {
    let mut series = Vec::new();
    for (c, channel) in station.channels.iter().enumerate() {
        let width_nm = channel.bandwidth_nm();
        let points = |good: bool| -> Vec<(f64, f64)> {
            let of = |(i, v): (usize, &sunglint_calibration::stars::Visit)| {
                let m = v.channels[c]?;
                let wanted = night.found.visits[i].agrees == good && m.measured_hz > 0.0;
                wanted.then_some((m.measured_hz / width_nm, m.predicted_hz / width_nm))
            };
            night.input.iter().enumerate().filter_map(of).collect()
        };
        let (good, bad) = (points(true), points(false));
        let colour = colour(station, c);
        if let Ok(k) = &night.found.channels[c] {
            let x = good.iter().map(|p| p.0);
            let (low, high) = (x.clone().fold(f64::INFINITY, f64::min), x.fold(0.0, f64::max));
            let line = vec![(low, k.kappa * low), (high, k.kappa * high)];
            series.push(Series::line("", c, line).with_colour(colour));
        }
        series.push(Series::dots(channel.name.clone(), c, good).with_colour(colour));
        series.push(Series::dots("", c, bad).with_colour(pale(colour)));
    }
    let x = Axis::log("measured (1/s/nm)");
    Panel::new(x, Axis::log("predicted (Hz/nm)"), series)
}

/// Ratios of the channels to the reference: on the diagonal where all is linear.
fn ratios(night: &NightResult, station: &Station) -> Panel {
    let mut series = Vec::new();
    for check in &night.found.ratios {
        let (a, b) = (check.channel, check.reference);
        let of = |(i, v): (usize, &sunglint_calibration::stars::Visit)| {
            let (p, q) = (v.channels[a]?, v.channels[b]?);
            let scale = night.kappa(a)? / night.kappa(b)?;
            let point = (scale * p.measured_hz / q.measured_hz, p.predicted_hz / q.predicted_hz);
            night.found.visits[i].agrees.then_some(point)
        };
        let points: Vec<(f64, f64)> = night.input.iter().enumerate().filter_map(of).collect();
        let name = format!("{}/{}", station.channels[a].name, station.channels[b].name);
        let x = points.iter().map(|p| p.0);
        let (low, high) = (x.clone().fold(f64::INFINITY, f64::min), x.fold(0.0, f64::max));
        series.push(
            Series::line("", a, vec![(low, low), (high, high)])
                .with_colour(RGBColor(170, 170, 170)),
        );
        series.push(Series::dots(name, a, points).with_colour(colour(station, a)));
    }
    let x = Axis::log("measured ratio of calibrated rates");
    Panel::new(x, Axis::log("predicted ratio"), series)
}

/// What is left of those that agree.
fn left(
    night: &NightResult,
    station: &Station,
    label: &str,
    x: &dyn Fn(usize) -> Option<f64>,
) -> Panel {
    let mut series = Vec::new();
    for (c, channel) in station.channels.iter().enumerate() {
        let of = |(i, v): (usize, &sunglint_calibration::stars::Judgement)| {
            let r = v.residuals[c].filter(|_| v.agrees)?;
            Some((x(i)?, 100.0 * r))
        };
        let points: Vec<(f64, f64)> =
            night.found.visits.iter().enumerate().filter_map(of).collect();
        series.push(Series::dots(channel.name.clone(), c, points).with_colour(colour(station, c)));
    }
    Panel::new(Axis::linear(label), Axis::linear("ln(predicted/calibrated) (%)"), series)
}
