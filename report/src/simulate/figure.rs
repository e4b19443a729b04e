//! The figures of a simulated pass: rates, magnitudes and geometry against time, and the time–wavelength diagram.

use crate::channel_line;
use crate::plot::{Axis, Figure, Heat, Panel, RGBColor, Series, Span};
use hifitime::Epoch;
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_radiometry::light_curve::{Track, tracks, usual_step_s};
use sunglint_simulator::pass::{Place, Simulation, SpectralQuantity};

/// Stretches longer than this are drawn in minutes, s.
const LONG_S: f64 = 1200.0;
/// Rates below this part of the highest are not drawn.
const FAINTEST: f64 = 1e-6;
const SHADOW: RGBColor = RGBColor(214, 219, 232);
const HIDDEN: RGBColor = RGBColor(236, 233, 226);

/// Draws what a simulation has to show.
#[derive(Debug, Clone)]
pub struct Drawing<'a> {
    /// The simulation.
    pub simulation: &'a Simulation<'a>,
    /// The figure's title.
    pub title: String,
}

impl Drawing<'_> {
    /// Rates, magnitudes and geometry against time; `None` where there is nothing to draw.
    pub fn curves(&self) -> Option<Figure> {
        let tracks = tracks(&self.simulation.pass.times);
        let mut panels = Vec::new();
        for track in &tracks {
            panels.extend(self.rates(track));
            panels.extend(self.magnitudes(track));
            panels.push(self.geometry(track));
        }
        (!panels.is_empty()).then(|| Figure { title: self.title.clone(), panels })
    }

    /// Time against wavelength; `None` without light.
    pub fn spectra(&self) -> Option<Figure> {
        let tracks = tracks(&self.simulation.pass.times);
        let panels: Vec<Panel> = tracks.iter().filter_map(|t| self.heat(t)).collect();
        let what = self.simulation.spectral().name();
        (!panels.is_empty()).then(|| Figure { title: format!("{}: {what}", self.title), panels })
    }

    /// Where a moment is drawn: seconds or minutes after the track's first.
    fn at(&self, track: &Track, epoch: Epoch) -> f64 {
        let after_s = seconds(epoch) - seconds(track.from);
        if is_long(track) { after_s / 60.0 } else { after_s }
    }

    fn x(&self, track: &Track) -> Axis {
        let unit = if is_long(track) { "minutes" } else { "seconds" };
        let axis = Axis::linear(format!("{unit} after {}", format_utc(track.from, 1)));
        let times = track.samples.clone().map(|i| self.at(track, self.simulation.pass.times[i]));
        let (first, last) =
            times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        // The same for all panels, so that what is above one another belongs together.
        axis.from_to(first, last)
    }

    fn line(&self, track: &Track, value: &dyn Fn(usize, &Place) -> f64) -> Vec<(f64, f64)> {
        let places = &self.simulation.places;
        let point =
            |i: usize| (self.at(track, self.simulation.pass.times[i]), value(i, &places[i]));
        track.samples.clone().map(point).collect()
    }

    /// A panel with the shadow and the horizon shaded.
    fn panel(&self, track: &Track, y: Axis, series: Vec<Series>) -> Panel {
        let mut panel = Panel::new(self.x(track), y, series);
        let hidden = |p: &Place| p.hidden;
        let eclipsed = |p: &Place| !p.hidden && p.sunlit < 1.0;
        panel.spans = self.spans(track, "below the horizon", HIDDEN, &hidden);
        panel.spans.extend(self.spans(track, "in the Earth's shadow", SHADOW, &eclipsed));
        panel
    }

    fn spans(
        &self,
        track: &Track,
        label: &str,
        colour: RGBColor,
        is: &dyn Fn(&Place) -> bool,
    ) -> Vec<Span> {
        let places = &self.simulation.places;
        let at = |i: usize| self.at(track, self.simulation.pass.times[i]);
        let mut spans: Vec<Span> = Vec::new();
        let mut before = None;
        for i in track.samples.clone().filter(|i| is(&places[*i])) {
            match (before, spans.last_mut()) {
                (Some(last), Some(span)) if last + 1 == i => span.range.1 = at(i),
                _ => spans.push(Span { label: label.into(), range: (at(i), at(i)), colour }),
            }
            before = Some(i);
        }
        spans
    }

    fn rates(&self, track: &Track) -> Option<Panel> {
        let shown = |c: usize, i: usize, p: &Place| {
            if p.hidden { f64::NAN } else { self.simulation.channels[c].rate_hz[i] }
        };
        let most = (0..self.simulation.channels.len())
            .flat_map(|c| track.samples.clone().map(move |i| (c, i)))
            .map(|(c, i)| shown(c, i, &self.simulation.places[i]))
            .filter(|hz| hz.is_finite())
            .fold(0.0, f64::max);
        if most <= 0.0 {
            return None;
        }
        let floor = most * FAINTEST;
        let series =
            self.simulation.pass.station.channels.iter().enumerate().map(|(c, channel)| {
                let rate = |i: usize, p: &Place| {
                    let hz = shown(c, i, p);
                    if hz >= floor { hz } else { f64::NAN }
                };
                channel_line(channel, self.line(track, &rate))
            });
        let y = Axis::log("predicted rate at the detector (Hz)");
        Some(self.panel(track, y, series.collect()))
    }

    fn magnitudes(&self, track: &Track) -> Option<Panel> {
        let mut series = Vec::new();
        for (b, (name, index)) in [("B", 0), ("V", 2), ("R", 1), ("I", 7)].iter().enumerate() {
            let magnitudes = self.simulation.magnitudes.column(b + 1);
            let value = |i: usize, p: &Place| if p.hidden { f64::NAN } else { magnitudes[i] };
            series.push(Series::line(*name, *index, self.line(track, &value)));
        }
        let brightest = series.iter().flat_map(|s| &s.points).map(|p| p.1).fold(f64::NAN, f64::min);
        if brightest.is_nan() {
            return None;
        }
        // As of the rates: a lobe's tail may be hundreds of magnitudes fainter, which nobody measures.
        let floor = brightest - 2.5 * FAINTEST.log10();
        for point in series.iter_mut().flat_map(|s| &mut s.points) {
            if point.1 > floor {
                point.1 = f64::NAN;
            }
        }
        Some(self.panel(track, Axis::linear("magnitude above the air").inverted(), series))
    }

    fn geometry(&self, track: &Track) -> Panel {
        let places = &self.simulation.places[track.samples.clone()];
        let furthest = places.iter().map(|p| p.geometry.range_m).fold(0.0, f64::max);
        let (unit_m, unit) = if furthest > 1.8e7 { (1e6, "1,000 km") } else { (1e5, "100 km") };
        let series = vec![
            Series::line(
                "altitude (°)",
                0,
                self.line(track, &|_, p| p.geometry.horizontal.altitude_deg()),
            ),
            Series::line("phase angle (°)", 1, self.line(track, &|_, p| p.geometry.phase_deg())),
            Series::line("Sun's altitude (°)", 5, self.line(track, &|_, p| p.sun_altitude_deg)),
            Series::line(
                format!("range ({unit})"),
                2,
                self.line(track, &|_, p| p.geometry.range_m / unit_m),
            ),
        ];
        self.panel(track, Axis::linear("degrees; range"), series)
    }

    fn heat(&self, track: &Track) -> Option<Panel> {
        let simulation = self.simulation;
        let times: Vec<f64> = self.line(track, &|_, _| 0.0).iter().map(|p| p.0).collect();
        let rows = simulation.pass.bins();
        let mut values = Vec::with_capacity(times.len() * rows);
        for i in track.samples.clone() {
            let hidden = simulation.places[i].hidden;
            let row = simulation.spectra.row(i);
            values.extend(row.iter().map(|v| if hidden { f64::NAN } else { *v }));
        }
        let unit = match simulation.spectral() {
            SpectralQuantity::Intensity => "W sr⁻¹ nm⁻¹",
            SpectralQuantity::Irradiance => "W m⁻² nm⁻¹",
        };
        let heat = Heat {
            x_edges: edges_between(&times)?,
            y_edges: simulation.pass.edges_nm.clone(),
            values,
            label: vec![unit.into()],
            decades: None,
        };
        heat.has_light().then(|| Panel {
            heat: Some(heat),
            spans: self.spans(track, "below the horizon", HIDDEN, &|p: &Place| p.hidden),
            ..Panel::new(self.x(track), Axis::linear("vacuum wavelength (nm)"), Vec::new())
        })
    }
}

fn seconds(epoch: Epoch) -> f64 {
    tai_nanoseconds(epoch) as f64 * 1e-9
}

fn is_long(track: &Track) -> bool {
    seconds(track.to) - seconds(track.from) > LONG_S
}

/// Edges half-way between increasing moments; `None` where they do not increase.
fn edges_between(times: &[f64]) -> Option<Vec<f64>> {
    let (first, last) = (*times.first()?, *times.last()?);
    if times.windows(2).any(|p| p[1] <= p[0]) {
        return None;
    }
    let half = if times.len() > 1 { 0.5 * usual_step_s(times) } else { 0.5 };
    let middles = times.windows(2).map(|p| 0.5 * (p[0] + p[1]));
    Some([first - half].into_iter().chain(middles).chain([last + half]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hifitime::Unit;
    use sunglint_formats::time::parse_utc;

    /// Truth: by hand.
    #[test]
    fn tracks_are_parted_by_gaps() {
        let start = parse_utc("2026-03-01T20:00:00").unwrap();
        let at = |s: f64| start + s * Unit::Second;
        let times: Vec<Epoch> = [0.0, 0.1, 0.2, 100.0, 100.1].map(at).to_vec();
        let found: Vec<_> = tracks(&times).iter().map(|t| t.samples.clone()).collect();
        assert_eq!(found, [0..3, 3..5]);
        let backwards: Vec<Epoch> = [100.0, 0.0].map(at).to_vec();
        assert_eq!(tracks(&backwards).len(), 1);
        let edges = edges_between(&[0.0, 1.0, 3.0]).unwrap();
        for (found, expected) in edges.iter().zip([-0.5, 0.5, 2.0, 3.5]) {
            assert!((found - expected).abs() < 0.6, "{edges:?}");
        }
        assert!(edges_between(&[1.0, 1.0]).is_none());
    }
}
