//! The figures of laser returns.

use crate::plot::{Axis, Figure, Heat, Panel, Series};
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_radiometry::light_curve::tracks;
use sunglint_simulator::pass::Simulation;
use sunglint_simulator::ranging::Returns;

/// Less than this part of the most is not drawn.
const FAINTEST: f64 = 1e-6;
/// Colours of the histogram reach so many decades below the most.
const DECADES: f64 = 3.0;

/// Seconds after the first moment.
fn seconds(simulation: &Simulation<'_>) -> Vec<f64> {
    let times = &simulation.pass.times;
    times.iter().map(|t| (tai_nanoseconds(*t) - tai_nanoseconds(times[0])) as f64 * 1e-9).collect()
}

fn x(simulation: &Simulation<'_>, times_s: &[f64]) -> Axis {
    let axis = Axis::linear(format!("seconds after {}", format_utc(simulation.pass.times[0], 1)));
    let ends =
        times_s.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), t| (a.min(*t), b.max(*t)));
    axis.from_to(ends.0, ends.1)
}

fn points(times_s: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    times_s.iter().copied().zip(values.iter().copied()).collect()
}

/// Whether a logarithmic panel has something to show; values far below the most are left out.
fn shown(times_s: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    let most = values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    let faint = |v: f64| if v > FAINTEST * most { v } else { f64::NAN };
    points(times_s, &values.iter().map(|v| faint(*v)).collect::<Vec<_>>())
}

fn panel(x: &Axis, y: &str, series: Vec<Series>) -> Option<Panel> {
    let any = series.iter().any(|s| s.points.iter().any(|p| p.1 > 0.0));
    any.then(|| Panel::new(x.clone(), Axis::log(y), series))
}

/// Photons per shot, rates beside sunlight's, sunlight over laser light: against time.
pub fn curves(simulation: &Simulation<'_>, all: &[Returns<'_>], title: &str) -> Option<Figure> {
    let times_s = seconds(simulation);
    let x = x(simulation, &times_s);
    let line = |label: String, k, values: &[f64]| Series::line(label, k, shown(&times_s, values));
    let photons = |(k, r): (usize, &Returns<'_>)| line(r.laser.name.clone(), k, &r.photons);
    let mut rates = Vec::new();
    let mut ratios = Vec::new();
    for (k, r) in all.iter().enumerate() {
        let channel = &simulation.channels[r.channel].name;
        rates.push(line(format!("{}, laser", r.laser.name), k, &r.rate_hz));
        let sunlight = line(format!("{channel}, sunlight"), k, &r.passive_hz);
        let colour = sunlight.colour;
        rates.push(sunlight.with_colour_and_dash(colour, 1));
        ratios.push(line(format!("Sun / {}", r.laser.name), k, &r.sun_ratio));
        let earth = line(format!("Earth / {}", r.laser.name), k, &r.earth_ratio);
        let colour = earth.colour;
        ratios.push(earth.with_colour_and_dash(colour, 1));
    }
    let panels: Vec<Panel> = [
        panel(&x, "detected photons per shot", all.iter().enumerate().map(photons).collect()),
        panel(&x, "rate at the detector (Hz)", rates),
        panel(&x, "over laser light, at the target", ratios),
    ]
    .into_iter()
    .flatten()
    .collect();
    (!panels.is_empty()).then(|| Figure { title: title.to_owned(), panels })
}

/// The range histogram against time, and its sum beside the true depth.
pub fn ranging(simulation: &Simulation<'_>, all: &[Returns<'_>], title: &str) -> Option<Figure> {
    let mut panels = Vec::new();
    for r in all {
        panels.extend(histogram(simulation, r));
        panels.extend(summed(r));
    }
    (!panels.is_empty()).then(|| Figure { title: format!("{title} by range"), panels })
}

fn histogram(simulation: &Simulation<'_>, r: &Returns<'_>) -> Option<Panel> {
    // An image needs moments that increase without gaps.
    let [track] = &tracks(&simulation.pass.times)[..] else { return None };
    let times_s = seconds(simulation);
    if times_s.len() < 2 || times_s.windows(2).any(|p| p[1] <= p[0]) {
        return None;
    }
    let mut x_edges = vec![times_s[0]];
    x_edges.extend(times_s.windows(2).map(|p| 0.5 * (p[0] + p[1])));
    x_edges.push(times_s[times_s.len() - 1]);
    let y_edges: Vec<f64> =
        (0..=r.bins.count).map(|k| r.bins.from_m + k as f64 * r.bins.step_m).collect();
    let mut values = Vec::with_capacity(times_s.len() * r.bins.count);
    for profile in &r.profiles {
        for bin in 0..r.bins.count {
            let photons = profile.as_ref().map_or(f64::NAN, |p| p.photons[bin] / r.bins.step_m);
            values.push(if photons > 0.0 { photons } else { f64::NAN });
        }
    }
    let label = vec!["photons per shot".into(), format!("and metre, {}", r.laser.name)];
    let heat = Heat { x_edges, y_edges, values, label, decades: Some(DECADES) };
    let x = Axis::linear(format!("seconds after {}", format_utc(track.from, 1)));
    let y = Axis::linear("range beyond the body's origin (m)");
    heat.has_light().then(|| Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) })
}

/// Shares of each metre, all samples together.
fn summed(r: &Returns<'_>) -> Option<Panel> {
    let [photons, first, area] = r.summed();
    let stairs = |label: &str, k: usize, values: &[f64]| {
        let sum: f64 = values.iter().sum::<f64>() * r.bins.step_m;
        let mut points = Vec::new();
        for (bin, value) in values.iter().enumerate() {
            let from = r.bins.from_m + bin as f64 * r.bins.step_m;
            points.extend([(from, value / sum), (from + r.bins.step_m, value / sum)]);
        }
        Series::line(label, k, points)
    };
    let any = photons.iter().any(|p| *p > 0.0);
    let x = Axis::linear("range beyond the body's origin (m), all samples");
    let y = Axis::linear(format!("share per metre, {}", r.laser.name));
    any.then(|| {
        Panel::new(
            x,
            y,
            vec![
                stairs("photons", 0, &photons),
                stairs("first photon of a shot", 1, &first),
                stairs("area seen (true depth)", 2, &area),
            ],
        )
    })
}
