//! The figures of a comparison: curves, residuals, ratios and geometry against time; residuals against phase angle and airmass.

use crate::plot::{Axis, COLOURS, Figure, Panel, RGBColor, Series};
use std::ops::Range;
use sunglint_calibration::comparison;
use sunglint_formats::time::{format_utc_shortest, tai_nanoseconds};
use sunglint_inference::compare::{ComparedChannel, Comparison, Quantity, magnitude};

/// The part of the residuals at either end that does not widen their axis.
const TAIL: f64 = 0.01;
/// Channels in the order of their wavelengths take these of the colours,
const BY_WAVELENGTH: [usize; 8] = [0, 4, 2, 5, 1, 3, 6, 7];
/// or, where they are few, these, which are far from one another.
const FEW: [&[usize]; 5] = [&[0], &[0, 1], &[0, 2, 1], &[0, 2, 5, 1], &[0, 4, 2, 5, 1]];
/// Simulated lines over dots of many colours.
const INK: RGBColor = RGBColor(35, 35, 35);

/// Which of [`COLOURS`] each channel is drawn in: blue to red as its light is.
pub(super) fn palette(compared: &Comparison<'_>) -> Vec<usize> {
    let station = &compared.simulation.pass.station;
    let nm = |pair: &ComparedChannel| {
        let channel = station.channels.iter().find(|c| c.name == pair.measured.name);
        channel.map_or(550.0, |c| c.mean_wavelength_nm())
    };
    let mut order: Vec<usize> = (0..compared.pairs.len()).collect();
    order.sort_by(|a, b| nm(&compared.pairs[*a]).total_cmp(&nm(&compared.pairs[*b])));
    let mut colours = vec![0; order.len()];
    let n = order.len();
    let few: &[usize] = FEW.get(n.wrapping_sub(1)).copied().unwrap_or(&BY_WAVELENGTH);
    for (place, channel) in order.into_iter().enumerate() {
        colours[channel] = few[place % few.len()];
    }
    colours
}

/// Seconds after a row's time.
pub(super) fn seconds(compared: &Comparison<'_>, since: usize, row: usize) -> f64 {
    let ns = |i: usize| tai_nanoseconds(compared.measured.times[i]);
    (ns(row) - ns(since)) as f64 * 1e-9
}

/// Rows at which a channel has a simulated value.
pub(super) fn drawn<'b>(
    pair: &'b ComparedChannel,
    track: &Range<usize>,
) -> impl Iterator<Item = usize> + 'b {
    let not_sampled = sunglint_radiometry::light_curve::Flags::NOT_SAMPLED;
    let own = move |i: &usize| !pair.measured.flags[*i].contains(not_sampled);
    track.clone().filter(own)
}

/// A residual as it is drawn: measured over simulated, or measured less simulated magnitudes.
pub(super) fn residual(compared: &Comparison<'_>, pair: &ComparedChannel, i: usize) -> f64 {
    let ratio = pair.measured.value[i] / pair.simulated[i];
    match compared.measured.quantity {
        Quantity::Rate => ratio,
        Quantity::Flux(_) => magnitude(ratio),
    }
}

/// The axis of residuals: what is far out does not widen it.
pub(super) fn residual_range(
    compared: &Comparison<'_>,
    tracks: &Range<usize>,
) -> Option<(f64, f64)> {
    let mut all: Vec<f64> = Vec::new();
    for pair in &compared.pairs {
        let used = tracks.clone().filter(|i| pair.channel.used[*i]);
        all.extend(used.map(|i| residual(compared, pair, i)).filter(|r| r.is_finite()));
    }
    all.sort_by(f64::total_cmp);
    let tail = (TAIL * all.len() as f64) as usize;
    let (low, high) = (*all.get(tail)?, *all.get(all.len().checked_sub(1 + tail)?)?);
    let margin = 0.15 * (high - low).max(1e-3 * high.abs()).max(1e-6);
    Some((low - margin, high + margin))
}

pub(super) fn curves(compared: &Comparison<'_>) -> Figure {
    let panels = compared.tracks().iter().flat_map(|track| of_track(compared, track)).collect();
    Figure { title: compared.title(), panels }
}

fn of_track(compared: &Comparison<'_>, track: &Range<usize>) -> Vec<Panel> {
    let first = track.start;
    let since = format_utc_shortest(compared.measured.times[first]);
    let last = seconds(compared, first, track.end - 1);
    let x = || Axis::linear(format!("seconds after {since}")).from_to(0.0, last.max(1e-3));
    let at = |i: usize| seconds(compared, first, i);
    let palette = palette(compared);
    let colour = |c: usize| COLOURS[palette[c]];
    let shown = |v: f64| match compared.measured.quantity {
        Quantity::Rate => v,
        Quantity::Flux(_) => magnitude(v),
    };
    let (mut values, mut residuals) = (Vec::new(), Vec::new());
    let single = compared.pairs.len() == 1;
    for (c, pair) in compared.pairs.iter().enumerate() {
        let dots = |f: &dyn Fn(usize) -> f64| {
            let used = drawn(pair, track).filter(|i| pair.channel.used[*i]);
            used.map(|i| (at(i), f(i))).collect::<Vec<_>>()
        };
        let name = if single { "measured".to_owned() } else { pair.measured.name.clone() };
        let measured = Series::dots(name.clone(), c, dots(&|i| shown(pair.measured.value[i])));
        let own = if single { COLOURS[6] } else { colour(c) };
        values.push(measured.with_colour(own));
        residuals
            .push(Series::dots(name, c, dots(&|i| residual(compared, pair, i))).with_colour(own));
    }
    for (c, pair) in compared.pairs.iter().enumerate() {
        let line = drawn(pair, track).map(|i| (at(i), shown(pair.simulated[i])));
        let label = match (single, c) {
            (true, _) => "simulated",
            (false, 0) => "lines: simulated",
            _ => "",
        };
        let own = if single { COLOURS[1] } else { INK };
        values.push(Series::line(label, c, line.collect()).with_colour(own));
    }
    let (y, of_residuals) = match compared.measured.quantity {
        Quantity::Rate => (Axis::log("rate at the detector (Hz)"), "measured / simulated"),
        Quantity::Flux(kind) => (
            Axis::linear(format!("magnitude: {}", kind.name())).inverted(),
            "measured − simulated (mag)",
        ),
    };
    let mut panels = vec![Panel::new(x(), y, values)];
    if let Some((low, high)) = residual_range(compared, track) {
        let y = Axis::linear(of_residuals).from_to(low, high);
        let y = if compared.is_rate() { y } else { y.inverted() };
        panels.push(Panel::new(x(), y, residuals));
    }
    panels.extend(ratios(compared, track, &x));
    let course = &compared.course;
    let line = |name: &str, index: usize, values: &[f64], per: f64| {
        let points = track.clone().map(|i| (at(i), values[i] / per)).collect();
        Series::line(name, index, points)
    };
    let furthest = course.range_m[track.clone()].iter().copied().fold(0.0, f64::max);
    let (unit_m, unit) = if furthest > 1.8e7 { (1e6, "1,000 km") } else { (1e5, "100 km") };
    let geometry = vec![
        line("phase angle (°)", 1, &course.phase_deg, 1.0),
        line("zenith angle (°)", 0, &course.zenith_deg, 1.0),
        line(&format!("range ({unit})"), 2, &course.range_m, unit_m),
    ];
    panels.push(Panel::new(x(), Axis::linear("degrees; range"), geometry));
    panels
}

fn ratios(compared: &Comparison<'_>, track: &Range<usize>, x: &dyn Fn() -> Axis) -> Option<Panel> {
    let palette = palette(compared);
    let mut series = Vec::new();
    for ratio in &compared.ratios {
        let place = compared.pairs.iter().position(|p| p.measured.name == ratio.channel);
        let colour = COLOURS[palette[place.unwrap_or(0)]];
        let own = || ratio.moments.iter().filter(|m| track.contains(&m.rows.start));
        let at = |m: &comparison::Moment| {
            let ends = [m.rows.start, m.rows.end - 1].map(|i| seconds(compared, track.start, i));
            0.5 * (ends[0] + ends[1])
        };
        let label = format!("{}/{}", ratio.channel, ratio.reference);
        let measured = own().map(|m| (at(m), m.measured)).collect();
        series.push(Series::dots(label, 0, measured).with_colour(colour));
        let simulated = own().map(|m| (at(m), m.simulated)).collect();
        series.push(Series::line("", 0, simulated).with_colour(INK));
    }
    let any = series.iter().flat_map(|s| &s.points).any(|p| p.1 > 0.0);
    any.then(|| Panel::new(x(), Axis::log("ratio of channels"), series))
}

/// Residuals against phase angle and airmass; `None` without any bin.
pub(super) fn residuals(compared: &Comparison<'_>) -> Option<Figure> {
    let palette = palette(compared);
    let panel = |axis: comparison::Axis| {
        let mut series = Vec::new();
        for (c, pair) in compared.pairs.iter().enumerate() {
            let own = pair.bins.iter().find(|(a, _)| *a == axis)?;
            let points = own.1.iter().map(|b| (0.5 * (b.from + b.to), b.ratio)).collect();
            let line = Series::line(pair.measured.name.clone(), c, points);
            series.push(line.with_colour(COLOURS[palette[c]]));
        }
        let label = match axis {
            comparison::Axis::Phase => "phase angle (°)",
            comparison::Axis::Airmass => "airmass",
        };
        let y = Axis::linear("measured / (scale × simulated)");
        let any = series.iter().any(|s| !s.points.is_empty());
        any.then(|| Panel::new(Axis::linear(label), y, series))
    };
    let panels: Vec<Panel> = [comparison::Axis::Phase, comparison::Axis::Airmass]
        .into_iter()
        .filter_map(panel)
        .collect();
    let title = format!("{}: residuals", compared.title());
    (!panels.is_empty()).then_some(Figure { title, panels })
}
