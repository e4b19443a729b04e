//! The passes on the sky.

use super::PassesReport;
use crate::plot::sky::{Light, Place, SkyPlot, Track, TrackPoint};
use hifitime::{Epoch, Unit};
use plotters::style::RGBColor;
use sunglint_ephemeris::passes::Search;
use sunglint_formats::time::format_utc;
use sunglint_radiometry::sky::Observer;
use sunglint_simulator::sightings::SeenPass;

/// Tracks that are drawn at most: the brightest.
const TRACKS: usize = 22;
/// Points of a track.
const POINTS: u32 = 160;

/// The map of all passes, with Sun and Moon at the middle of the first (of one: at its brightest moment).
pub(super) fn sky_plot(report: &PassesReport<'_>) -> SkyPlot {
    let mut shown: Vec<&SeenPass> = report.passes.iter().collect();
    if shown.len() > TRACKS {
        shown.sort_by(|a, b| a.brightest.v_mag.total_cmp(&b.brightest.v_mag));
        shown.truncate(TRACKS);
        shown.sort_by_key(|p| p.start.geometry.epoch);
    }
    let window = report.search.window();
    let one_night = shown.len() <= 12;
    let tracks = shown.iter().map(|pass| track(report.search, pass, one_night)).collect();
    let at = shown.first().map_or(window.from, |p| p.brightest.geometry.epoch);
    let horizon: Vec<(f64, f64)> = (0..360)
        .map(f64::from)
        .map(|azimuth| (azimuth, report.search.threshold_deg(azimuth)))
        .collect();
    let mut notes =
        vec!["as seen lying on the back:".to_owned(), "north up, east on the left".to_owned()];
    if shown.len() < report.passes.len() {
        notes.push(format!("the {} brightest of {}", shown.len(), report.passes.len()));
    }
    if !shown.is_empty() {
        notes.push(format!("Sun, Moon: {} UTC", &format_utc(at, 0)[11..16]));
    }
    SkyPlot {
        title: report.title(),
        subtitle: format!("{}; times UTC", report.law()),
        horizon,
        tracks,
        places: places(report, at),
        notes,
    }
}

fn places(report: &PassesReport<'_>, at: Epoch) -> Vec<Place> {
    // Without a frame there would have been no search.
    let Ok(observer) = Observer::at(at, &report.station.site, report.orientation) else {
        return Vec::new();
    };
    let place = |name: String, h: sunglint_radiometry::sky::Horizontal, colour| Place {
        name,
        azimuth_deg: h.azimuth_deg(),
        altitude_deg: h.altitude_deg(),
        colour,
    };
    let moon = observer.moon();
    let lit = 100.0 * moon.place.illuminated_fraction();
    vec![
        place("Sun".into(), observer.sun().horizontal, RGBColor(230, 159, 0)),
        place(format!("Moon ({lit:.0} % lit)"), moon.horizontal, RGBColor(120, 120, 130)),
    ]
}

fn track(search: &Search, pass: &SeenPass, with_times: bool) -> Track {
    let span = pass.pass.span;
    let dark = search.dark();
    let look = |epoch: Epoch| search.look(&pass.orbit, epoch).ok();
    let point = |i: u32| {
        let epoch = span.from + span.seconds() * f64::from(i) / f64::from(POINTS) * Unit::Second;
        let seen = look(epoch)?;
        let is_dark = dark.iter().any(|d| d.from <= epoch && epoch <= d.to);
        let light = match (seen.lit_rad > 0.0, is_dark) {
            (false, _) => Light::Shadow,
            (true, true) => Light::Visible,
            (true, false) => Light::Bright,
        };
        let h = seen.horizontal;
        Some(TrackPoint { azimuth_deg: h.azimuth_deg(), altitude_deg: h.altitude_deg(), light })
    };
    let mark = |epoch: Epoch| {
        let h = look(epoch)?.horizontal;
        // Times to the minute where the pass is long, else with seconds.
        let text = format_utc(epoch, 0);
        let text = if span.seconds() > 3600.0 { &text[11..16] } else { &text[11..19] };
        Some((h.azimuth_deg(), h.altitude_deg(), text.to_owned()))
    };
    let mut marks = Vec::new();
    if with_times {
        let ends = pass.pass.visible.iter().flat_map(|v| [v.from, v.to]);
        marks.extend(ends.filter_map(mark));
    }
    let top = pass.culmination.geometry.horizontal;
    let v = pass.expected.v_station.map_or(String::new(), |v| format!("V {v:.1}  "));
    // The number in the catalogue stands in the list of the text; here a name is enough.
    let name = pass.target.split(" (").next().unwrap_or(&pass.target);
    Track {
        name: format!("{}  {v}{name}", &format_utc(pass.start.geometry.epoch, 0)[11..16]),
        points: (0..=POINTS).filter_map(point).collect(),
        marks,
        top: Some((top.azimuth_deg(), top.altitude_deg())),
    }
}
