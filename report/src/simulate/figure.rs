//! The figures of a simulated pass: rates, magnitudes and geometry against time, and the time–wavelength diagram.

use crate::channel_line;
use crate::plot::{Axis, Figure, Heat, Panel, RGBColor, Series, Span};
use hifitime::Epoch;
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_radiometry::light_curve::{Track, tracks, usual_step_s};
use sunglint_simulator::pass::{Pass, Simulation, SpectralQuantity};

/// Stretches longer than this are drawn in minutes, s.
const LONG_S: f64 = 1200.0;
/// Rates below this part of the highest are not drawn.
const FAINTEST: f64 = 1e-6;
const SHADOW: RGBColor = RGBColor(214, 219, 232);
const HIDDEN: RGBColor = RGBColor(236, 233, 226);

/// Samples of a track that are drawn one by one; of more, each of [`COLUMNS`] columns of the picture keeps its ends and extremes.
const MOST_SAMPLES: usize = 16_384;
/// As many as the finest picture has pixels across.
const COLUMNS: usize = 4096;
/// Samples of a track whose spectra are drawn one by one, and values of such a field; of more, means are drawn.
const MOST_SPECTRA: usize = 4096;
const MOST_CELLS: usize = 1_000_000;

/// Gathers, piece by piece, what a pass has to show, and draws it.
#[derive(Debug, Clone)]
pub struct Drawing<'a> {
    pass: &'a Pass,
    sketches: Vec<Sketch>,
    /// Samples that are drawn.
    done: usize,
}

/// A track, as far as it is drawn.
#[derive(Debug, Clone)]
struct Sketch {
    track: Track,
    /// First and last moment on the axis.
    ends: (f64, f64),
    /// Whether the moments never decrease.
    ordered: bool,
    /// By channel.
    rates: Vec<Line>,
    /// B, V, R, I.
    magnitudes: [Line; 4],
    /// Altitude, phase angle, the Sun's altitude, range in m.
    geometry: [Line; 4],
    hidden: Stretches,
    eclipsed: Stretches,
    heat: Option<Field>,
}

/// Points of a line: all of them, or for each column of the picture the first, the last, the least, the largest and a gap.
#[derive(Debug, Clone, Default)]
struct Line {
    points: Vec<(f64, f64)>,
    open: Option<Column>,
}

/// A point and its sample.
type Numbered = (usize, (f64, f64));

/// A column of the picture that is being filled.
#[derive(Debug, Clone, Default)]
struct Column {
    number: usize,
    first: Option<Numbered>,
    last: Option<Numbered>,
    least: Option<Numbered>,
    most: Option<Numbered>,
    /// The first point that is no number.
    gap: Option<Numbered>,
}

impl Line {
    /// Adds the point of a sample, in a column of the picture if the line is thinned.
    fn add(&mut self, sample: usize, column: Option<usize>, point: (f64, f64)) {
        let Some(number) = column else {
            self.points.push(point);
            return;
        };
        if self.open.as_ref().is_some_and(|open| open.number != number) {
            self.close();
        }
        let open = self.open.get_or_insert_with(|| Column { number, ..Column::default() });
        let here = Some((sample, point));
        if point.1.is_nan() {
            open.gap = open.gap.or(here);
            return;
        }
        open.first = open.first.or(here);
        open.last = here;
        if open.least.is_none_or(|least| point.1 < least.1.1) {
            open.least = here;
        }
        if open.most.is_none_or(|most| point.1 > most.1.1) {
            open.most = here;
        }
    }

    fn close(&mut self) {
        let Some(open) = self.open.take() else { return };
        let mut kept: Vec<Numbered> = [open.first, open.last, open.least, open.most, open.gap]
            .into_iter()
            .flatten()
            .collect();
        kept.sort_by_key(|(sample, _)| *sample);
        kept.dedup_by_key(|(sample, _)| *sample);
        self.points.extend(kept.into_iter().map(|(_, point)| point));
    }

    fn closed(&self) -> Vec<(f64, f64)> {
        let mut line = self.clone();
        line.close();
        line.points
    }
}

/// Samples that follow one another.
#[derive(Debug, Clone, Default)]
struct Stretches {
    ends: Vec<(f64, f64)>,
    before: Option<usize>,
}

impl Stretches {
    fn add(&mut self, sample: usize, at: f64) {
        match (self.before, self.ends.last_mut()) {
            (Some(before), Some(ends)) if before + 1 == sample => ends.1 = at,
            _ => self.ends.push((at, at)),
        }
        self.before = Some(sample);
    }

    fn spans(&self, label: &str, colour: RGBColor) -> impl Iterator<Item = Span> {
        self.ends.iter().map(move |range| Span { label: label.into(), range: *range, colour })
    }
}

/// Spectra against time: each, or means of so many.
#[derive(Debug, Clone)]
struct Field {
    together: usize,
    x_edges: Vec<f64>,
    values: Vec<f64>,
    /// Samples in the means that are being taken, their sums and numbers by bin.
    taken: usize,
    sums: Vec<(f64, f64)>,
}

impl Field {
    fn new(times: &[f64], bins: usize) -> Option<Self> {
        let most = (MOST_CELLS / bins.max(1)).clamp(256, MOST_SPECTRA);
        let together = if times.len() > most { times.len().div_ceil(most / 2) } else { 1 };
        let edges = edges_between(times)?;
        let last = edges.last().copied();
        let firsts = edges[..times.len()].iter().step_by(together).copied();
        Some(Self {
            together,
            x_edges: firsts.chain(last).collect(),
            values: Vec::new(),
            taken: 0,
            sums: vec![(0.0, 0.0); bins],
        })
    }

    fn add(&mut self, spectrum: impl Iterator<Item = f64>) {
        if self.together == 1 {
            self.values.extend(spectrum);
            return;
        }
        for (sum, value) in self.sums.iter_mut().zip(spectrum).filter(|(_, v)| v.is_finite()) {
            *sum = (sum.0 + value, sum.1 + 1.0);
        }
        self.taken += 1;
        if self.taken == self.together {
            self.close();
        }
    }

    fn close(&mut self) {
        if self.taken > 0 {
            self.values.extend(self.sums.iter().map(|(sum, count)| sum / count));
            self.sums.fill((0.0, 0.0));
            self.taken = 0;
        }
    }

    fn closed(&self) -> Self {
        let mut field = self.clone();
        field.close();
        field
    }
}

impl Sketch {
    fn new(track: Track, pass: &Pass) -> Self {
        let times: Vec<f64> = track.samples.clone().map(|i| at(&track, pass.times[i])).collect();
        let ends = times
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(*t), b.max(*t)));
        Self {
            ends,
            ordered: times.windows(2).all(|p| p[0] <= p[1]),
            rates: vec![Line::default(); pass.station.channels.len()],
            magnitudes: Default::default(),
            geometry: Default::default(),
            hidden: Stretches::default(),
            eclipsed: Stretches::default(),
            heat: Field::new(&times, pass.bins()),
            track,
        }
    }

    /// The column of the picture that a sample is in; none where all samples are drawn.
    fn column(&self, sample: usize, x: f64) -> Option<usize> {
        let samples = &self.track.samples;
        if samples.len() <= MOST_SAMPLES {
            return None;
        }
        let (first, last) = self.ends;
        // Moments that jump to and fro are thinned in their order.
        let along = match self.ordered && last > first {
            true => (x - first) / (last - first),
            false => (sample - samples.start) as f64 / samples.len() as f64,
        };
        // Between 0 and 1.
        Some((along * COLUMNS as f64) as usize)
    }

    /// Adds a sample of a simulation, which is the `i`-th there.
    fn add(&mut self, sample: usize, simulation: &Simulation<'_>, i: usize) {
        let place = &simulation.places[i];
        let x = at(&self.track, simulation.pass.times[i]);
        let column = self.column(sample, x);
        let seen = |value: f64| if place.hidden { f64::NAN } else { value };
        for (line, channel) in self.rates.iter_mut().zip(&simulation.channels) {
            line.add(sample, column, (x, seen(channel.rate_hz[i])));
        }
        for (b, line) in self.magnitudes.iter_mut().enumerate() {
            line.add(sample, column, (x, seen(simulation.magnitudes[[i, b + 1]])));
        }
        let geometry = &place.geometry;
        let values = [
            geometry.horizontal.altitude_deg(),
            geometry.phase_deg(),
            place.sun_altitude_deg,
            geometry.range_m,
        ];
        for (line, value) in self.geometry.iter_mut().zip(values) {
            line.add(sample, column, (x, value));
        }
        if place.hidden {
            self.hidden.add(sample, x);
        } else if place.sunlit < 1.0 {
            self.eclipsed.add(sample, x);
        }
        if let Some(heat) = &mut self.heat {
            heat.add(simulation.spectra.row(i).iter().map(|v| seen(*v)));
        }
    }

    fn x(&self) -> Axis {
        let unit = if is_long(&self.track) { "minutes" } else { "seconds" };
        let axis = Axis::linear(format!("{unit} after {}", format_utc(self.track.from, 1)));
        // The same for all panels, so that what is above one another belongs together.
        axis.from_to(self.ends.0, self.ends.1)
    }

    /// A panel with the shadow and the horizon shaded.
    fn panel(&self, y: Axis, series: Vec<Series>) -> Panel {
        let mut panel = Panel::new(self.x(), y, series);
        panel.spans = self.hidden.spans("below the horizon", HIDDEN).collect();
        panel.spans.extend(self.eclipsed.spans("in the Earth's shadow", SHADOW));
        panel
    }

    fn rates(&self, pass: &Pass) -> Option<Panel> {
        let lines: Vec<_> = self.rates.iter().map(Line::closed).collect();
        let rates = lines.iter().flatten().map(|p| p.1);
        let most = rates.filter(|hz| hz.is_finite()).fold(0.0, f64::max);
        if most <= 0.0 {
            return None;
        }
        let floor = most * FAINTEST;
        let shown = |(x, hz): (f64, f64)| (x, if hz >= floor { hz } else { f64::NAN });
        let lines = lines.into_iter().map(|line| line.into_iter().map(shown).collect());
        let series = pass.station.channels.iter().zip(lines).map(|(c, line)| channel_line(c, line));
        let y = Axis::log("predicted rate at the detector (Hz)");
        Some(self.panel(y, series.collect()))
    }

    fn magnitudes(&self) -> Option<Panel> {
        let names = [("B", 0), ("V", 2), ("R", 1), ("I", 7)].iter().zip(&self.magnitudes);
        let mut series: Vec<Series> =
            names.map(|((name, index), line)| Series::line(*name, *index, line.closed())).collect();
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
        Some(self.panel(Axis::linear("magnitude above the air").inverted(), series))
    }

    fn geometry(&self) -> Panel {
        let [altitude, phase, sun, range] = self.geometry.each_ref().map(Line::closed);
        let furthest = range.iter().map(|p| p.1).fold(0.0, f64::max);
        let (unit_m, unit) = if furthest > 1.8e7 { (1e6, "1,000 km") } else { (1e5, "100 km") };
        let range = range.into_iter().map(|(x, m)| (x, m / unit_m)).collect();
        let series = vec![
            Series::line("altitude (°)", 0, altitude),
            Series::line("phase angle (°)", 1, phase),
            Series::line("Sun's altitude (°)", 5, sun),
            Series::line(format!("range ({unit})"), 2, range),
        ];
        self.panel(Axis::linear("degrees; range"), series)
    }

    fn heat(&self, pass: &Pass) -> Option<Panel> {
        let field = self.heat.as_ref()?.closed();
        let unit = match pass.spectral {
            SpectralQuantity::Intensity => "W sr⁻¹ nm⁻¹",
            SpectralQuantity::Irradiance => "W m⁻² nm⁻¹",
        };
        let heat = Heat {
            x_edges: field.x_edges,
            y_edges: pass.edges_nm.clone(),
            values: field.values,
            label: vec![unit.into()],
            decades: None,
        };
        heat.has_light().then(|| Panel {
            heat: Some(heat),
            spans: self.hidden.spans("below the horizon", HIDDEN).collect(),
            ..Panel::new(self.x(), Axis::linear("vacuum wavelength (nm)"), Vec::new())
        })
    }
}

impl<'a> Drawing<'a> {
    /// A drawing of nothing yet.
    pub fn new(pass: &'a Pass) -> Self {
        let sketches = tracks(&pass.times).into_iter().map(|track| Sketch::new(track, pass));
        Self { pass, sketches: sketches.collect(), done: 0 }
    }

    /// Takes the next piece in.
    pub fn add(&mut self, piece: &Simulation<'_>) {
        for i in 0..piece.places.len() {
            let sample = self.done + i;
            let own = self.sketches.iter_mut().find(|s| s.track.samples.contains(&sample));
            if let Some(sketch) = own {
                sketch.add(sample, piece, i);
            }
        }
        self.done += piece.places.len();
    }

    /// Rates, magnitudes and geometry against time; `None` where there is nothing to draw.
    pub fn curves(&self, title: &str) -> Option<Figure> {
        let mut panels = Vec::new();
        for sketch in &self.sketches {
            panels.extend(sketch.rates(self.pass));
            panels.extend(sketch.magnitudes());
            panels.push(sketch.geometry());
        }
        (!panels.is_empty()).then(|| Figure { title: title.to_owned(), panels })
    }

    /// Time against wavelength; `None` without light.
    pub fn spectra(&self, title: &str) -> Option<Figure> {
        let panels: Vec<Panel> = self.sketches.iter().filter_map(|s| s.heat(self.pass)).collect();
        let what = self.pass.spectral.name();
        (!panels.is_empty()).then(|| Figure { title: format!("{title}: {what}"), panels })
    }
}

/// Where a moment is drawn: seconds or minutes after the track's first.
fn at(track: &Track, epoch: Epoch) -> f64 {
    let after_s = seconds(epoch) - seconds(track.from);
    if is_long(track) { after_s / 60.0 } else { after_s }
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

    /// Truth: the line itself. Thinned, it has the ends and extremes of every column, in order, and its gaps.
    #[test]
    fn a_thinned_line_keeps_its_extremes() {
        let value = |i: usize| match i {
            700 => 50.0,
            701 => -50.0,
            850..=950 => f64::NAN,
            i => (0.01 * i as f64).sin(),
        };
        let mut line = Line::default();
        for i in 0..1000 {
            line.add(i, Some(i / 100), (i as f64, value(i)));
        }
        let points = line.closed();
        assert!(points.len() <= 50 && points.windows(2).all(|p| p[0].0 < p[1].0), "{points:?}");
        for kept in [0, 99, 100, 700, 701, 999] {
            assert!(points.contains(&(kept as f64, value(kept))), "{kept}: {points:?}");
        }
        for column in 0..10 {
            let all = || (100 * column..100 * (column + 1)).map(value);
            let own = || points.iter().filter(|p| p.0 as usize / 100 == column).map(|p| p.1);
            assert_eq!(own().fold(f64::NAN, f64::max), all().fold(f64::NAN, f64::max));
            assert_eq!(own().fold(f64::NAN, f64::min), all().fold(f64::NAN, f64::min));
            assert_eq!(own().any(f64::is_nan), all().any(f64::is_nan), "{column}");
        }
    }

    /// Truth: by hand. Means of three columns, one of which is hidden, and the edges around them.
    #[test]
    fn a_thinned_field_has_means() {
        let times: Vec<f64> = (0..MOST_SPECTRA + 1).map(|i| i as f64).collect();
        let mut field = Field::new(&times, 2).unwrap();
        assert_eq!(field.together, 3);
        for i in 0..times.len() {
            let value = if i == 4 { f64::NAN } else { i as f64 };
            field.add([value, 7.0].into_iter());
        }
        let field = field.closed();
        assert_eq!(field.values[..6], [1.0, 7.0, 4.0, 7.0, 7.0, 7.0]);
        assert_eq!(field.x_edges[..3], [-0.5, 2.5, 5.5]);
        assert_eq!(field.x_edges.last(), Some(&(MOST_SPECTRA as f64 + 0.5)));
        assert_eq!(field.values.len(), 2 * (field.x_edges.len() - 1));
    }

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
