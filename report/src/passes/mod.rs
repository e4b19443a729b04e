//! Passes that can be seen: text, JSON, table, the plot of the sky.

mod figure;
mod table;

use crate::plot::sky::SkyPlot;
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt::Write as _;
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_ephemeris::passes::{Search, Span};
use sunglint_formats::time::format_utc;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::{Mount, Station};
use sunglint_simulator::sightings::{
    KEYHOLE_DEG, Photometer, SeenPass, SightingCounts, SightingEvent, SightingFailure,
    SightingLight,
};

/// A search with what it found.
pub struct PassesReport<'a> {
    /// The search.
    pub search: &'a Search,
    /// The station.
    pub station: &'a Station,
    /// Channels on sunlight.
    pub photometer: &'a Photometer<'a>,
    /// The passes, in the order of time.
    pub passes: &'a [SeenPass],
    /// Number of those there were.
    pub counts: SightingCounts,
    /// Targets that could not be followed.
    pub failures: &'a [SightingFailure],
    /// Warnings that the user should read first.
    pub warnings: &'a [String],
    /// The files that went in.
    pub inputs: Vec<Input>,
    /// How the Earth is turned.
    pub orientation: &'a EarthOrientation,
}

/// Failures that the text names at most.
const NAMED: usize = 5;

#[derive(Serialize)]
#[serde(tag = "law")]
enum LightJson<'a> {
    #[serde(rename = "model")]
    Model { target: &'a str, attitude: &'a str, tolerance: f64 },
    #[serde(rename = "diffuse sphere")]
    Sphere { diameter_m: f64, reflectance: f64 },
    #[serde(rename = "standard magnitude")]
    Standard { v_1000_km_half_lit: f64 },
}

#[derive(Serialize)]
struct PassesJson<'a> {
    from_utc: String,
    to_utc: String,
    station: StationJson<'a>,
    air: AirJson,
    conditions: ConditionsJson,
    brightness: Option<LightJson<'a>>,
    zero_point: String,
    exposure_s: f64,
    dark: Vec<SpanJson>,
    counts: CountsJson,
    passes: Vec<PassJson<'a>>,
    failures: Vec<FailureJson<'a>>,
    warnings: &'a [String],
    inputs: &'a [Input],
}

#[derive(Serialize)]
struct StationJson<'a> {
    name: &'a str,
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
    mount: &'a str,
}

#[derive(Serialize)]
struct AirJson {
    description: String,
}

#[derive(Serialize)]
struct ConditionsJson {
    min_elevation_deg: f64,
    sun_below_deg: f64,
}

#[derive(Serialize)]
struct CountsJson {
    objects: usize,
    never_up: usize,
    always_up: usize,
    passes_above_horizon: usize,
    in_shadow: usize,
    in_daylight: usize,
    lit_by_day: usize,
    filtered: usize,
    visible: usize,
}

#[derive(Serialize)]
struct FailureJson<'a> {
    what: &'a str,
    why: &'a str,
}

#[derive(Serialize)]
struct RateJson {
    rate_hz: f64,
    sigma_hz: Option<f64>,
    saturated: bool,
    signal_to_noise: Option<f64>,
}

#[derive(Serialize)]
struct PassJson<'a> {
    target: &'a str,
    norad_id: u32,
    rise_utc: Option<String>,
    set_utc: Option<String>,
    visible: Vec<SpanJson>,
    visible_s: f64,
    sunlit: Vec<SpanJson>,
    shadow_entry_utc: Vec<String>,
    shadow_exit_utc: Vec<String>,
    start: MomentJson,
    culmination: MomentJson,
    brightest: MomentJson,
    end: MomentJson,
    v_station_mag: Option<f64>,
    meridian: Vec<MeridianJson>,
    meridian_flip: bool,
    zenith_keyhole: bool,
    azimuth_rate_deg_s: f64,
    rates: Map<String, Value>,
}

#[derive(Serialize)]
struct MeridianJson {
    time_utc: String,
    hour_angle_h: u8,
}

impl PassesReport<'_> {
    /// Table, and summary where `json` asks for it.
    pub fn product(&self, json: bool) -> Product {
        Product {
            name: "passes".into(),
            table: table::table(self),
            figure: None,
            json: if json { self.json() } else { Value::Null },
            ..Product::default()
        }
    }

    /// The passes on the sky.
    pub fn sky_plot(&self) -> SkyPlot {
        figure::sky_plot(self)
    }

    /// The heading of all.
    pub fn title(&self) -> String {
        let window = self.search.window();
        format!(
            "visible passes from {}, {} to {}",
            self.station.name,
            format_utc(window.from, 0),
            format_utc(window.to, 0)
        )
    }

    /// Returns the brightness of the targets, in words.
    pub fn law(&self) -> String {
        let law = match &self.photometer.light {
            SightingLight::Law(law) => *law,
            SightingLight::Model(_, words) => {
                return format!(
                    "model {}, attitude {}, within {} %",
                    words.target,
                    words.attitude,
                    100.0 * words.tolerance
                );
            }
        };
        match law {
            Brightness::Sphere { diameter_m, reflectance } => {
                format!("diffuse sphere of {diameter_m} m, reflectance {reflectance}")
            }
            Brightness::Standard { magnitude } => format!(
                "V {magnitude} at 1000 km half lit, brightness with the illuminated fraction"
            ),
            _ => "unknown".into(),
        }
    }

    /// The text.
    pub fn text(&self) -> String {
        let conditions = self.search.conditions();
        let site = self.station.site.geodetic();
        let mut text = format!(
            "{}\nstation: {} ({:.4}°, {:.4}°, {} m); up from {}°, Sun below {}°\nair: {}\nbrightness: {}; V counts from {}\n\n",
            self.title(),
            self.station.name,
            site.latitude_deg,
            site.longitude_deg,
            site.height_m,
            conditions.min_altitude_deg,
            conditions.sun_below_deg,
            self.photometer.air.describe(),
            self.law(),
            self.photometer.zero
        );
        if self.passes.is_empty() {
            text.push_str(&self.why_none());
        } else {
            self.list(&mut text);
        }
        self.say_failures(&mut text);
        text
    }

    fn list(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "{:>6} {:<16} {:<5} {:<8} {:<8} {:<8} {:<5} {:>4} {:>6} {:>5} {:>5} {:>6} {:>4} {:>5} notes",
            "number",
            "target",
            "UTC",
            "from",
            "highest",
            "to",
            "az",
            "alt",
            "km",
            "phase",
            "V",
            "S/N",
            "Sun",
            "Moon"
        );
        let mut keyed = [false; 4];
        for pass in self.passes {
            let notes = notes(pass);
            for (key, letter) in keyed.iter_mut().zip(["s", "m", "z", "u"]) {
                *key |= notes.contains(letter);
            }
            let (b, g) = (&pass.brightest, &pass.brightest.geometry);
            let clock = |e: &SightingEvent| format_utc(e.geometry.epoch, 0)[11..19].to_owned();
            let azimuth = |e: &SightingEvent| compass(e.geometry.horizontal.azimuth_deg());
            let best = self.best(pass).map_or("-".into(), |(_, ratio)| short(ratio));
            let name = pass.target.split(" (").next().unwrap_or(&pass.target);
            let name: String = match name.chars().count() > 16 {
                true => name.chars().take(15).chain(['…']).collect(),
                false => name.to_owned(),
            };
            let v = pass.expected.v_station.map_or("-".into(), |v| format!("{v:.1}"));
            let _ = writeln!(
                text,
                "{:>6} {name:<16} {} {} {} {} {:<5} {:>3.0}° {:>6.0} {:>4.0}° {v:>5} {best:>6} {:>3.0}° {:>4.0}°{}{notes}",
                pass.norad_id,
                &format_utc(pass.start.geometry.epoch, 0)[5..10],
                clock(&pass.start),
                clock(&pass.culmination),
                clock(&pass.end),
                format!("{}>{}", azimuth(&pass.start), azimuth(&pass.end)),
                pass.highest_visible_deg(),
                g.range_m / 1e3,
                g.phase_deg(),
                b.sun_altitude_deg,
                b.moon_separation_deg,
                if notes.is_empty() { "" } else { " " },
            );
        }
        let objects: std::collections::HashSet<u32> =
            self.passes.iter().map(|p| p.norad_id).collect();
        let _ = writeln!(
            text,
            "\n{} of {}\nfrom, to: while it can be seen; highest: its culmination, seen or not; alt: the highest while seen;\nkm, phase, V at the station, S/N of the best channel in {} s, Sun's altitude, angle to the Moon:\nwhen it is brightest",
            count(self.passes.len(), "visible pass", "visible passes"),
            count(objects.len(), "object", "objects"),
            self.photometer.exposure_s
        );
        let words = [
            "s: goes into the Earth's shadow or comes out of it",
            "m: crosses the meridian, where an equatorial mount is interrupted",
            &format!("z: higher than {KEYHOLE_DEG}°, where an alt-azimuth mount is blind"),
            "u: already up at the begin or still up at the end of the window",
        ];
        let used: Vec<&str> =
            words.iter().zip(keyed).filter(|(_, used)| *used).map(|(w, _)| *w).collect();
        if !used.is_empty() {
            let _ = writeln!(text, "{}", used.join("\n"));
        }
        if self.counts.filtered > 0 {
            let filtered = count(self.counts.filtered, "visible pass", "visible passes");
            let _ =
                writeln!(text, "{filtered} more left out by --min-…, --brighter-than or --limit");
        }
    }

    /// Why nothing is listed.
    fn why_none(&self) -> String {
        let c = self.counts;
        let window = self.search.window();
        let conditions = self.search.conditions();
        let mut reasons = Vec::new();
        if c.objects == 0 {
            reasons.push("there is no object to follow".to_owned());
        }
        if self.search.dark().is_empty() {
            reasons.push(format!(
                "the Sun never stands below {}° in that time",
                conditions.sun_below_deg
            ));
        }
        if c.stays > 0 {
            let mut parts = Vec::new();
            for (n, words) in [
                (c.in_daylight, "under a bright sky"),
                (c.in_shadow, "in the Earth's shadow"),
                (c.lit_by_day, "sunlit only while the sky was bright"),
                (c.filtered, "left out by --min-…, --brighter-than or --limit"),
            ] {
                if n > 0 {
                    parts.push(format!("{n} {words}"));
                }
            }
            reasons.push(format!(
                "of {} above {}° {}",
                count(c.stays, "pass", "passes"),
                conditions.min_altitude_deg,
                parts.join(", ")
            ));
        }
        if c.never_up > 0 {
            reasons.push(format!(
                "{} never rose above {}°",
                count(c.never_up, "object", "objects"),
                conditions.min_altitude_deg
            ));
        }
        if !self.failures.is_empty() {
            reasons.push(format!("{} failed", count(self.failures.len(), "object", "objects")));
        }
        format!(
            "no visible pass of {} between {} and {}, because {}\n",
            count(c.objects, "object", "objects"),
            format_utc(window.from, 0),
            format_utc(window.to, 0),
            reasons.join("; ")
        )
    }

    fn say_failures(&self, text: &mut String) {
        if self.failures.is_empty() {
            return;
        }
        let n = count(self.failures.len(), "failure", "failures");
        let _ = writeln!(text, "\n{n}:");
        for failure in self.failures.iter().take(NAMED) {
            let named = failure.why.starts_with(&failure.what);
            let what = if named { String::new() } else { format!("{}: ", failure.what) };
            let _ = writeln!(text, "  {what}{}", failure.why);
        }
        if self.failures.len() > NAMED {
            let _ = writeln!(text, "  … and {} more (-v, --json)", self.failures.len() - NAMED);
        }
    }

    /// The channel with the best signal over noise, and that.
    pub fn best(&self, pass: &SeenPass) -> Option<(usize, f64)> {
        let ratio = |(i, c): (usize, &Option<(f64, _)>)| {
            let (hz, predicted): &(f64, sunglint_radiometry::station::Predicted) = c.as_ref()?;
            let ratio = hz / predicted.sigma_hz?;
            ratio.is_finite().then_some((i, ratio))
        };
        let found = pass.expected.channels.iter().enumerate().filter_map(ratio);
        found.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn json(&self) -> Value {
        let (window, site) = (self.search.window(), self.station.site.geodetic());
        let conditions = self.search.conditions();
        let brightness = match &self.photometer.light {
            SightingLight::Model(_, words) => Some(LightJson::Model {
                target: &words.target,
                attitude: &words.attitude,
                tolerance: words.tolerance,
            }),
            SightingLight::Law(Brightness::Sphere { diameter_m, reflectance }) => {
                Some(LightJson::Sphere { diameter_m: *diameter_m, reflectance: *reflectance })
            }
            SightingLight::Law(Brightness::Standard { magnitude }) => {
                Some(LightJson::Standard { v_1000_km_half_lit: *magnitude })
            }
            _ => None,
        };
        let c = self.counts;
        json_of(&PassesJson {
            from_utc: format_utc(window.from, 3),
            to_utc: format_utc(window.to, 3),
            station: StationJson {
                name: &self.station.name,
                latitude_deg: site.latitude_deg,
                longitude_deg: site.longitude_deg,
                height_m: site.height_m,
                mount: if self.station.telescope.mount == Mount::Equatorial {
                    "equatorial"
                } else {
                    "alt-azimuth"
                },
            },
            air: AirJson { description: self.photometer.air.describe() },
            conditions: ConditionsJson {
                min_elevation_deg: conditions.min_altitude_deg,
                sun_below_deg: conditions.sun_below_deg,
            },
            brightness,
            zero_point: self.photometer.zero.to_string(),
            exposure_s: self.photometer.exposure_s,
            dark: spans(&self.search.dark()),
            counts: CountsJson {
                objects: c.objects,
                never_up: c.never_up,
                always_up: c.always_up,
                passes_above_horizon: c.stays,
                in_shadow: c.in_shadow,
                in_daylight: c.in_daylight,
                lit_by_day: c.lit_by_day,
                filtered: c.filtered,
                visible: self.passes.len(),
            },
            passes: self.passes.iter().map(|p| self.pass_json(p)).collect(),
            failures: self
                .failures
                .iter()
                .map(|f| FailureJson { what: &f.what, why: &f.why })
                .collect(),
            warnings: self.warnings,
            inputs: &self.inputs,
        })
    }

    fn pass_json<'a>(&self, pass: &'a SeenPass) -> PassJson<'a> {
        let p = &pass.pass;
        let changes = |entry: bool| -> Vec<String> {
            let wanted = p.shadow_changes().into_iter().filter(|(_, e)| *e == entry);
            wanted.map(|(epoch, _)| format_utc(epoch, 3)).collect()
        };
        let rates = self.station.channels.iter().zip(&pass.expected.channels).map(|(c, found)| {
            let rate = found.as_ref().map(|(hz, predicted)| RateJson {
                rate_hz: rounded(*hz),
                sigma_hz: predicted.sigma_hz.map(rounded),
                saturated: predicted.saturated,
                signal_to_noise: predicted.sigma_hz.map(|s| rounded(hz / s)),
            });
            (c.name.clone(), json_of(&rate))
        });
        PassJson {
            target: &pass.target,
            norad_id: pass.norad_id,
            rise_utc: p.rises.then(|| format_utc(p.span.from, 3)),
            set_utc: p.sets.then(|| format_utc(p.span.to, 3)),
            visible: spans(&p.visible),
            visible_s: rounded(pass.visible_s()),
            sunlit: spans(&p.sunlit),
            shadow_entry_utc: changes(true),
            shadow_exit_utc: changes(false),
            start: event(&pass.start),
            culmination: event(&pass.culmination),
            brightest: event(&pass.brightest),
            end: event(&pass.end),
            v_station_mag: pass.expected.v_station.map(rounded),
            meridian: p
                .meridian
                .iter()
                .map(|c| MeridianJson {
                    time_utc: format_utc(c.epoch, 3),
                    hour_angle_h: if c.lower { 12 } else { 0 },
                })
                .collect(),
            meridian_flip: pass.meridian_flip,
            zenith_keyhole: pass.keyhole,
            azimuth_rate_deg_s: rounded(p.azimuth_rate_deg_s),
            rates: rates.collect(),
        }
    }
}

#[derive(Serialize)]
struct MomentJson {
    time_utc: String,
    altitude_deg: f64,
    azimuth_deg: f64,
    range_m: f64,
    phase_deg: f64,
    sunlit: f64,
    v_mag: Option<f64>,
    sun_altitude_deg: f64,
    twilight: String,
    moon: MoonJson,
}

#[derive(Serialize)]
struct MoonJson {
    altitude_deg: f64,
    separation_deg: f64,
    illuminated_fraction: f64,
}

fn event(e: &SightingEvent) -> MomentJson {
    let g = &e.geometry;
    MomentJson {
        time_utc: format_utc(g.epoch, 3),
        altitude_deg: rounded(g.horizontal.altitude_deg()),
        azimuth_deg: rounded(g.horizontal.azimuth_deg()),
        range_m: rounded(g.range_m),
        phase_deg: rounded(g.phase_deg()),
        sunlit: rounded(g.sunlit),
        v_mag: e.v_mag.is_finite().then(|| rounded(e.v_mag)),
        sun_altitude_deg: rounded(e.sun_altitude_deg),
        twilight: e.twilight.to_string(),
        moon: MoonJson {
            altitude_deg: rounded(e.moon_altitude_deg),
            separation_deg: rounded(e.moon_separation_deg),
            illuminated_fraction: rounded(e.moon_illuminated),
        },
    }
}

#[derive(Serialize)]
struct SpanJson {
    from_utc: String,
    to_utc: String,
}

fn spans(spans: &[Span]) -> Vec<SpanJson> {
    let span = |s: &Span| SpanJson { from_utc: format_utc(s.from, 3), to_utc: format_utc(s.to, 3) };
    spans.iter().map(span).collect()
}

/// The letters of a pass.
fn notes(pass: &SeenPass) -> String {
    let mut letters = Vec::new();
    for (letter, holds) in [
        ("s", !pass.pass.shadow_changes().is_empty()),
        ("m", pass.meridian_flip),
        ("z", pass.keyhole),
        ("u", !(pass.pass.rises && pass.pass.sets)),
    ] {
        if holds {
            letters.push(letter);
        }
    }
    letters.join(",")
}

/// The nearest of eight points of the compass.
fn compass(azimuth_deg: f64) -> &'static str {
    const NAMES: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
    NAMES[(azimuth_deg / 45.0).round() as usize % 8]
}

fn short(ratio: f64) -> String {
    if ratio >= 1e4 { format!("{ratio:.1e}") } else { format!("{ratio:.1}") }
}

fn count(n: usize, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
}
