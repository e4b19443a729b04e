//! A plan out of passes: stars to calibrate by before and after them, dark frames, flats in the twilight.
//!
//! The passes that are brightest and do not overlap are taken; the stars between them stand at altitudes as far apart as can be, have different colours, and saturate
//! nothing that the plan's cameras and counters record.

use super::mount::MountPlan;
use super::plan::Plan;
use super::saturation::Judge;
use super::sequence::Exposing;
use hifitime::{Epoch, Unit};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::toml::Positive;
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Observer, SkyError, Star, StarNote, separation_rad,
};
use sunglint_radiometry::star_track::StarTrackError;

/// How long visits take, and which stars are taken.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PlannerOptions {
    /// Visits to stars in all.
    pub stars: usize,
    /// Length of a visit to a star with one filter, s.
    pub star_s: f64,
    /// Length of the sky beside each star, s; 0 for none.
    pub sky_s: f64,
    /// Time from one place of the sky to another, s; `None`: the longest way of the plan's mount, 30 s without a mount and between two passes.
    pub slew_s: Option<f64>,
    /// Length of the dark frames at each end, s; 0 for none.
    pub dark_s: f64,
    /// Johnson V of the stars, brightest and faintest.
    pub star_mag: Interval,
    /// The most air to a star.
    pub airmass: f64,
    /// Width of a star's image at half of its height, arcsec.
    pub seeing_arcsec: f64,
    /// Median that flats in the evening's twilight are made to reach, ADU; `None`: no flats.
    pub flats_adu: Option<f64>,
}

impl Default for PlannerOptions {
    fn default() -> Self {
        Self {
            stars: 6,
            star_s: 60.0,
            sky_s: 20.0,
            slew_s: None,
            dark_s: 60.0,
            star_mag: Interval::new(0.0, 6.0),
            airmass: 2.5,
            seeing_arcsec: 2.5,
            flats_adu: None,
        }
    }
}

/// A pass that may be observed.
#[derive(Debug, Clone, PartialEq)]
pub struct PassOffer {
    /// Name and number of the object.
    pub label: String,
    /// Number by which the elements' file is searched.
    pub norad_id: u32,
    /// When it can be seen.
    pub span: (Epoch, Epoch),
    /// Johnson V at its brightest.
    pub v_mag: f64,
    /// The same as a standard magnitude: V at 1,000 km, half lit; `None` where it is not known.
    pub standard_magnitude: Option<f64>,
    /// Highest altitude, degrees.
    pub highest_deg: f64,
}

/// Choice of a person for a night.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pick {
    /// The offer of this number, from 0.
    Pass(usize),
    /// A star, as the catalogue finds it.
    Star(String),
}

/// A visit of the plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedVisit {
    /// Name of the target, or `dark`, `sky`, `flat`, `bias`.
    pub name: String,
    /// Start, UTC.
    pub from_utc: String,
    /// Length, s.
    pub for_s: f64,
    /// Altitude in its middle, degrees; of a pass the highest.
    pub altitude_deg: Option<f64>,
    /// Johnson V; of a pass at its brightest.
    pub v_mag: Option<f64>,
    /// B−V of a star.
    pub bv_mag: Option<f64>,
    /// The lines of NIGHT.toml.
    #[serde(skip)]
    lines: String,
}

/// A night that is planned.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NightPlan {
    /// Start, UTC.
    pub from_utc: String,
    /// The visits, in time.
    pub visits: Vec<PlannedVisit>,
    /// Passes that are not in it, and why.
    pub left_out: Vec<String>,
    /// Things that it could not do as asked.
    pub warnings: Vec<String>,
}

/// Why no night can be planned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlannerError {
    /// No pass to plan for.
    #[error("there is no pass to plan for: widen --from and --to, or what a pass must be")]
    NoPass,
    /// Passes that are too short for a visit.
    #[error("{label} lasts {length_s:.1} s, and a visit has {LEAST_PASS_S} s at least")]
    Short {
        /// The pass.
        label: String,
        /// The length, s.
        length_s: f64,
    },
    /// A choice that is none of the offers, or no star.
    #[error("{0}")]
    Unknown(String),
    /// Passes that overlap, or leave no time to slew between them, or are not in their order.
    #[error(
        "{first} and {second} cannot follow each other: between them are {gap_s:.0} s, and a slew takes {slew_s:.0} s"
    )]
    Overlap {
        /// The pass that comes first in the list.
        first: String,
        /// The next one.
        second: String,
        /// Time from the end of the first to the begin of the second, s; below 0 where they overlap, or are in the wrong order.
        gap_s: f64,
        /// Time of a slew, s.
        slew_s: f64,
    },
    /// More stars than fit.
    #[error(
        "{stars} stars need {needed_s:.0} s {place}, and there are {room_s:.0} s: move or leave out some"
    )]
    NoRoom {
        /// Number of stars.
        stars: usize,
        /// Where: `before …`, `after …`.
        place: String,
        /// Time that they need, s.
        needed_s: f64,
        /// Time that there is, s.
        room_s: f64,
    },
    /// A moment outside of the tables.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// Light or air of a star that cannot be had.
    #[error(transparent)]
    Star(#[from] StarTrackError),
}

/// Surroundings of a plan.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// The plan's devices and station; it has no visits.
    pub devices: &'a Plan,
    /// The air.
    pub air: &'a Air,
    /// The Earth's orientation.
    pub orientation: &'a EarthOrientation,
    /// Zero of the magnitudes.
    pub zero: ZeroPoint,
    /// The dark hours, each from its beginning to its end.
    pub dark: &'a [(Epoch, Epoch)],
    /// Name of the file of the elements, beside the plan.
    pub elements: &'a str,
}

fn seconds(from: Epoch, to: Epoch) -> f64 {
    (to - from).to_seconds()
}

fn later(epoch: Epoch, s: f64) -> Epoch {
    epoch + s * Unit::Second
}

/// A whole second of UTC beside an epoch.
fn whole(epoch: Epoch, to: impl Fn(f64) -> f64) -> Epoch {
    let near = parse_utc(&format_utc(epoch, 0)).unwrap_or(epoch);
    later(near, to(seconds(near, epoch)))
}

/// Plans the night that has the brightest pass.
///
/// # Errors
/// No pass within the dark hours; places or light that cannot be computed.
pub fn plan_night(
    offers: &[PassOffer],
    around: Surroundings<'_>,
    options: &PlannerOptions,
) -> Result<NightPlan, PlannerError> {
    let mut planner = Planner { around, options, seen: BTreeMap::new(), warnings: Vec::new() };
    planner.plan(offers)
}

/// Plans the night that a person picked: passes at their times, and between them the stars in the order of the list: before the first pass as late as can be, after
/// each pass as soon as can be.
///
/// # Errors
/// Picks that are none; passes that cannot follow each other; stars that do not fit; places or light that cannot be computed. What a star may lack (height, light) is a
/// warning.
pub fn plan_picks(
    picks: &[Pick],
    offers: &[PassOffer],
    around: Surroundings<'_>,
    options: &PlannerOptions,
) -> Result<NightPlan, PlannerError> {
    let mut planner = Planner { around, options, seen: BTreeMap::new(), warnings: Vec::new() };
    planner.picks(picks, offers)
}

/// Name of a star that the catalogue finds again: its label, else its number of Hipparcos.
pub fn star_name(star: &Star) -> String {
    match (Catalogue::embedded().find(&star.label()), star.hip) {
        (Ok(same), _) if same == star => star.label(),
        (_, Some(hip)) => format!("HIP {hip}"),
        _ => star.label(),
    }
}

struct Planner<'a> {
    around: Surroundings<'a>,
    options: &'a PlannerOptions,
    /// Visits so far of stars, by their place in the catalogue.
    seen: BTreeMap<usize, usize>,
    warnings: Vec<String>,
}

/// Time from one place of the sky to another where no mount tells it, s.
const SLEW_S: f64 = 30.0;
/// The golden section: multiples of it, without their whole parts, are spread as evenly as can be.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// A shorter pass is left out, s: times of a plan are whole seconds, and a camera has to be set.
pub const LEAST_PASS_S: f64 = 10.0;
/// A star nearer to the Moon is not taken, degrees.
pub const MOON_DEG: f64 = 15.0;
/// A star in the brightest pixel or counter comes so near to saturation at most: seeing and focus change.
const MARGIN: f64 = 0.7;
/// Altitudes of the Sun between which flats of the sky are taken, degrees.
const FLATS_DEG: [f64; 2] = [-2.0, -7.0];
/// Frames of flats behind each filter, and of bias.
const FLAT_FRAMES: u32 = 9;
const BIAS_FRAMES: u32 = 20;
/// Least time for them, s: with 2 s of readout each.
const LEAST_BIAS_S: f64 = 60.0;
/// Exposure of bias frames, s: one that nearly every camera can take.
const BIAS_S: f64 = 0.01;

impl Planner<'_> {
    fn plan(&mut self, offers: &[PassOffer]) -> Result<NightPlan, PlannerError> {
        let (mut by_light, short): (Vec<&PassOffer>, Vec<&PassOffer>) =
            offers.iter().partition(|offer| whole_length_s(offer) >= LEAST_PASS_S);
        by_light.sort_by(|a, b| a.v_mag.total_cmp(&b.v_mag));
        let brightest = match (by_light.first(), short.first()) {
            (Some(brightest), _) => brightest,
            (None, None) => return Err(PlannerError::NoPass),
            (None, Some(short)) => return Err(too_short(short)),
        };
        let holds = |night: &&(Epoch, Epoch), offer: &PassOffer| {
            offer.span.0 >= night.0 && offer.span.1 <= night.1
        };
        let night = self.around.dark.iter().find(|night| holds(night, brightest));
        let night = *night.ok_or(PlannerError::NoPass)?;
        let too_short = |offer: &&PassOffer| {
            let (label, at, s) =
                (&offer.label, format_utc(offer.span.0, 0), seconds(offer.span.0, offer.span.1));
            format!("{label} at {at}: it lasts {s:.1} s, less than {LEAST_PASS_S} s")
        };
        let mut left_out: Vec<String> = short.iter().map(too_short).collect();
        let mut passes: Vec<&PassOffer> = Vec::new();
        for offer in by_light {
            let out =
                |why: String| format!("{} at {}: {why}", offer.label, format_utc(offer.span.0, 0));
            let free = |other: &&PassOffer| {
                seconds(offer.span.1, other.span.0) >= self.gap_s()
                    || seconds(other.span.1, offer.span.0) >= self.gap_s()
            };
            if !holds(&&night, offer) {
                left_out.push(out("another night".into()));
            } else if let Some(other) = passes.iter().find(|other| !free(other)) {
                left_out.push(out(format!("{} is brighter then", other.label)));
            } else {
                passes.push(offer);
            }
        }
        self.warn_of_gains();
        self.warn_of_filters();
        passes.sort_by(|a, b| seconds(b.span.0, a.span.0).total_cmp(&0.0));
        let mut visits: Vec<(Epoch, PlannedVisit)> =
            passes.iter().map(|pass| (pass.span.0, self.pass(pass))).collect();
        let [block_s, ends_s] = [self.star_block_s(), self.options.dark_s];
        // Stars, shared among the stretches before, between and after the passes: as near to a pass as they can be.
        let stretches = passes.len() + 1;
        let mut place = 0;
        let (mut first, mut last) = (passes[0].span.0, passes[passes.len() - 1].span.1);
        for i in 0..stretches {
            let wanted = (self.options.stars + stretches - 1 - i) / stretches;
            let from = if i == 0 { later(night.0, ends_s) } else { passes[i - 1].span.1 };
            let to = passes.get(i).map_or(later(night.1, -ends_s), |pass| pass.span.0);
            let room_s = seconds(from, to) - self.slew_s();
            let count = wanted.min((room_s / block_s).floor().max(0.0) as usize);
            if count < wanted {
                self.warnings.push(match from < to {
                    true => format!(
                        "{count} of {wanted} stars fit between {} and {}",
                        format_utc(from, 0),
                        format_utc(to, 0)
                    ),
                    false => format!("there is no time for a star before {}", format_utc(to, 0)),
                });
            }
            let after = if i == 0 { 0 } else { count.div_ceil(2) };
            let after = if i + 1 == stretches { count } else { after };
            for j in 0..count {
                let begin = match j < after {
                    true => later(from, j as f64 * block_s),
                    false => later(to, -self.slew_s() - (count - j) as f64 * block_s),
                };
                visits.extend(self.star(later(begin, self.slew_s()), place)?);
                place += 1;
                let end = later(begin, block_s);
                first = if begin < first { begin } else { first };
                last = if end > last { end } else { last };
            }
        }
        self.whole(visits, [first, last], night.0, left_out)
    }

    /// Says where nothing is planned through filters that the station's channels have.
    fn warn_of_filters(&mut self) {
        let devices = self.around.devices;
        let named: BTreeSet<&str> =
            devices.station.channels.iter().filter_map(|c| c.filter.as_deref()).collect();
        if named.is_empty() || !self.filters().is_empty() {
            return;
        }
        let named = named.into_iter().collect::<Vec<_>>().join(", ");
        for wheel in devices.wheels.iter().filter(|wheel| wheel.filters.is_empty()) {
            self.warnings.push(format!(
                "wheel {} names no filters, so nothing is planned through {named}, which the station's channels have: write its filters = [\"…\"], slot 1 first (sunglint devices check \"{}\")",
                wheel.name, wheel.device
            ));
        }
    }

    fn warn_of_gains(&mut self) {
        for camera in self.around.devices.cameras.iter().filter(|camera| camera.gain.is_some()) {
            let name = &camera.name;
            let text = format!(
                "{name} has a gain in steps of its own: whether stars saturate it is not known"
            );
            self.warnings.push(text);
        }
    }

    /// A night of these visits, with dark frames before the first and after the last moment, and flats before the night.
    fn whole(
        &mut self,
        mut visits: Vec<(Epoch, PlannedVisit)>,
        [first, last]: [Epoch; 2],
        night: Epoch,
        left_out: Vec<String>,
    ) -> Result<NightPlan, PlannerError> {
        if self.options.dark_s > 0.0 {
            let begin = later(first, -self.options.dark_s);
            visits.push((begin, self.off("dark", begin, self.options.dark_s, "")));
            visits.push((last, self.off("dark", last, self.options.dark_s, "")));
        }
        self.flats(night, &mut visits)?;
        visits.sort_by(|a, b| seconds(b.0, a.0).total_cmp(&0.0));
        let from_utc = visits.first().map_or_else(String::new, |(begin, _)| format_utc(*begin, 0));
        let visits = visits.into_iter().map(|(_, visit)| visit).collect();
        Ok(NightPlan { from_utc, visits, left_out, warnings: std::mem::take(&mut self.warnings) })
    }

    fn picks(&mut self, picks: &[Pick], offers: &[PassOffer]) -> Result<NightPlan, PlannerError> {
        // Passes in the order of the list, and the stars before the first and after each.
        let mut passes: Vec<&PassOffer> = Vec::new();
        let mut stars: Vec<Vec<&Star>> = vec![Vec::new()];
        for pick in picks {
            match pick {
                Pick::Pass(number) => {
                    let none = || PlannerError::Unknown(format!("there is no pass {number}"));
                    passes.push(offers.get(*number).ok_or_else(none)?);
                    stars.push(Vec::new());
                }
                Pick::Star(name) => {
                    let star = Catalogue::embedded().find(name);
                    let star = star.map_err(|error| PlannerError::Unknown(error.to_string()))?;
                    if let Some(group) = stars.last_mut() {
                        group.push(star);
                    }
                }
            }
        }
        if let Some(short) = passes.iter().find(|pass| whole_length_s(pass) < LEAST_PASS_S) {
            return Err(too_short(short));
        }
        for pair in passes.windows(2) {
            let (gap_s, slew_s) = (seconds(pair[0].span.1, pair[1].span.0), self.gap_s());
            if gap_s < slew_s {
                let (first, second) = (pair[0].label.clone(), pair[1].label.clone());
                return Err(PlannerError::Overlap { first, second, gap_s, slew_s });
            }
        }
        let slew_s = self.slew_s();
        let holds = |night: &&(Epoch, Epoch)| {
            passes.first().is_none_or(|pass| night.0 <= pass.span.0 && pass.span.1 <= night.1)
        };
        let night = *self.around.dark.iter().find(holds).ok_or(PlannerError::NoPass)?;
        self.warn_of_gains();
        self.warn_of_filters();
        let (block_s, dark_s) = (self.star_block_s(), self.options.dark_s);
        let mut visits: Vec<(Epoch, PlannedVisit)> =
            passes.iter().map(|pass| (pass.span.0, self.pass(pass))).collect();
        let begins = later(night.0, dark_s);
        let (mut first, mut last) = match (passes.first(), passes.last()) {
            (Some(one), Some(other)) => (one.span.0, other.span.1),
            _ => (begins, begins),
        };
        for (i, group) in stars.iter().enumerate().filter(|(_, group)| !group.is_empty()) {
            // Visits begin at whole seconds.
            let needed_s = group.len() as f64 * block_s;
            let before = i.checked_sub(1).map(|i| passes[i]);
            let after = passes.get(i);
            let from = before.map_or(begins, |pass| pass.span.1);
            let to = after.map_or(later(night.1, -dark_s), |pass| later(pass.span.0, -slew_s));
            let room_s = seconds(from, to);
            if needed_s + 1.0 > room_s {
                let place = match (before, after) {
                    (_, Some(pass)) => format!("before {}", pass.label),
                    (Some(pass), None) => format!("after {}", pass.label),
                    (None, None) => "in the night".into(),
                };
                let stars = group.len();
                return Err(PlannerError::NoRoom { stars, place, needed_s, room_s });
            }
            let start = match (before, after) {
                (None, Some(_)) => whole(later(to, -needed_s), |s| (s + 1e-6).floor()),
                _ => whole(from, |s| (s - 1e-6).ceil()),
            };
            for (j, star) in group.iter().enumerate() {
                let begin = later(start, j as f64 * block_s);
                visits.extend(self.picked(star, later(begin, slew_s))?);
            }
            first = if start < first { start } else { first };
            let end = later(start, needed_s);
            last = if end > last { end } else { last };
        }
        self.whole(visits, [first, last], night.0, Vec::new())
    }

    /// The visits to a star that somebody picked, with a warning where it is too low or too bright.
    fn picked(
        &mut self,
        star: &Star,
        begin: Epoch,
    ) -> Result<Vec<(Epoch, PlannedVisit)>, PlannerError> {
        let station = &self.around.devices.station;
        let middle = later(begin, 0.5 * self.star_s());
        let view = Observer::at(middle, &station.site, self.around.orientation)?.star(star);
        let altitude_deg = view.horizontal.altitude_deg();
        let horizon = station.horizon.elevation_deg(view.horizontal.azimuth_deg());
        let (name, at) = (star_name(star), format_utc(middle, 0));
        if altitude_deg < horizon.max(0.0) {
            self.warnings.push(format!(
                "{name} is below the horizon at {at}: altitude {altitude_deg:.1}°, the horizon there {horizon:.1}°"
            ));
        } else if altitude_deg.to_radians().sin() < self.options.airmass.recip() {
            self.warnings.push(format!("{name} is low at {at}: altitude {altitude_deg:.1}°"));
        }
        if let Some(what) = self.saturates(star, middle)? {
            self.warnings.push(format!("{name} saturates {what}, or nearly, at {at}"));
        }
        Ok(self.star_visits(star, altitude_deg, begin))
    }

    /// Filters that stars are seen through, one after the other: those of the wheel that a channel of the station names.
    fn filters(&self) -> Vec<String> {
        let station = &self.around.devices.station;
        let named = |name: &&String| {
            station.channels.iter().any(|channel| channel.filter.as_ref() == Some(*name))
        };
        let wheels = self.around.devices.wheels.iter();
        wheels.flat_map(|wheel| wheel.filters.iter()).filter(named).cloned().collect()
    }

    fn star_s(&self) -> f64 {
        self.options.star_s * self.filters().len().max(1) as f64
    }

    /// Least time between two passes, s. A mount whose longest way takes more may lose a part of the second; the check of the plan says how much.
    fn gap_s(&self) -> f64 {
        self.options.slew_s.unwrap_or(SLEW_S)
    }

    /// Time from one place of the sky to a star or a pass, s.
    fn slew_s(&self) -> f64 {
        let mount = self.around.devices.mount.as_ref();
        let farthest_s = || mount.map_or(SLEW_S, MountPlan::farthest_s);
        self.options.slew_s.unwrap_or_else(farthest_s)
    }

    /// Time from a star to the sky beside it, s: without a mount whoever points the telescope does it at once.
    fn beside_s(&self) -> f64 {
        self.around.devices.mount.as_ref().map_or(0.0, MountPlan::beside_s)
    }

    /// A star, the sky beside it, and the ways there.
    fn star_block_s(&self) -> f64 {
        let sky_s = self.options.sky_s;
        let sky_s = if sky_s > 0.0 { self.beside_s() + sky_s } else { 0.0 };
        self.slew_s() + self.star_s() + sky_s
    }

    fn pass(&self, pass: &PassOffer) -> PlannedVisit {
        let (begin, end) = whole_span(pass);
        let (from, to) = (format_utc(begin, 0), format_utc(end, 0));
        let mut lines = format!(
            "tle = \"{}\"\nobject = \"{}\"\nfrom = \"{from}\"\nto = \"{to}\"\n",
            self.around.elements, pass.norad_id
        );
        if let Some(magnitude) = pass.standard_magnitude {
            let _ = writeln!(lines, "standard_magnitude = {magnitude:.2}");
        }
        // The wheel does not turn during a pass.
        if let Some(filter) = self.filters().first() {
            let _ = writeln!(lines, "filter = \"{filter}\"");
        }
        PlannedVisit {
            name: pass.label.clone(),
            from_utc: from,
            for_s: seconds(begin, end).round(),
            altitude_deg: Some(pass.highest_deg),
            v_mag: Some(pass.v_mag),
            bv_mag: None,
            lines,
        }
    }

    fn off(&self, kind: &str, begin: Epoch, for_s: f64, more: &str) -> PlannedVisit {
        let from = format_utc(begin, 0);
        PlannedVisit {
            name: kind.to_owned(),
            lines: format!("off = \"{kind}\"\nfrom = \"{from}\"\nfor_s = {for_s}\n{more}"),
            from_utc: from,
            for_s,
            altitude_deg: None,
            v_mag: None,
            bv_mag: None,
        }
    }

    /// The visit to the star number `place` of the night, which begins then, and the sky beside it; none where no star will do.
    fn star(
        &mut self,
        begin: Epoch,
        place: usize,
    ) -> Result<Vec<(Epoch, PlannedVisit)>, PlannerError> {
        let station = &self.around.devices.station;
        let middle = later(begin, 0.5 * self.star_s());
        let observer = Observer::at(middle, &station.site, self.around.orientation)?;
        let moon = observer.moon();
        let moon_up = moon.horizontal.altitude_deg() > 0.0;
        let low = self.options.airmass.recip();
        let wanted = low + (1.0 - low) * (0.5 + GOLDEN * place as f64).fract();
        let [brightest, faintest] = self.options.star_mag.to_array();
        let mut offers: Vec<(usize, &Star, f64, f64)> = Vec::new();
        for (i, star) in Catalogue::embedded().stars().iter().enumerate() {
            let bright = star.v_mag.is_some_and(|v| (brightest..=faintest).contains(&v));
            if !bright || star.spectral_type.is_none() || star.notes().iter().any(spoils) {
                continue;
            }
            let view = observer.star(star);
            let altitude_deg = view.horizontal.altitude_deg();
            let sine = altitude_deg.to_radians().sin();
            let horizon = station.horizon.elevation_deg(view.horizontal.azimuth_deg());
            let apart = separation_rad(view.direction_gcrs, moon.place.direction_gcrs).to_degrees();
            if sine < low || altitude_deg < horizon || (moon_up && apart < MOON_DEG) {
                continue;
            }
            // Repeats last; then the altitude, the colour in its turn, the light.
            let repeats = self.seen.get(&i).copied().unwrap_or(0) as f64;
            let colour = colour_class(star).abs_diff(place % 3) as f64;
            let faint = star.v_mag.unwrap_or(faintest) - brightest;
            let cost = 100.0 * repeats + (sine - wanted).abs() + 0.3 * colour + 0.1 * faint;
            offers.push((i, star, altitude_deg, cost));
        }
        offers.sort_by(|a, b| a.3.total_cmp(&b.3));
        let mut too_bright = None;
        for (i, star, altitude_deg, _) in offers {
            if let Some(what) = self.saturates(star, middle)? {
                too_bright.get_or_insert(what);
                continue;
            }
            *self.seen.entry(i).or_default() += 1;
            return Ok(self.star_visits(star, altitude_deg, begin));
        }
        let at = format_utc(middle, 0);
        self.warnings.push(match too_bright {
            Some(what) => {
                format!("no star at {at}: each would saturate {what}; shorten its exposure")
            }
            None => {
                format!("no star at {at}: none of V {brightest} to {faintest} stands high enough")
            }
        });
        Ok(Vec::new())
    }

    fn star_visits(
        &self,
        star: &Star,
        altitude_deg: f64,
        begin: Epoch,
    ) -> Vec<(Epoch, PlannedVisit)> {
        let (from, for_s) = (format_utc(begin, 0), self.star_s());
        let name = star_name(star);
        let mut lines = format!("star = \"{name}\"\nfrom = \"{from}\"\nfor_s = {for_s}\n");
        let filters = self.filters();
        if !filters.is_empty() {
            let _ = writeln!(lines, "filters = {filters:?}");
        }
        let visit = PlannedVisit {
            name,
            from_utc: from,
            for_s,
            altitude_deg: Some(altitude_deg),
            v_mag: star.v_mag,
            bv_mag: star.bv_mag,
            lines,
        };
        let mut visits = vec![(begin, visit)];
        if self.options.sky_s > 0.0 {
            let begin = later(begin, for_s + self.beside_s());
            visits.push((begin, self.off("sky", begin, self.options.sky_s, "")));
        }
        visits
    }

    /// The channel of the plan's instruments that a star would saturate, or nearly.
    fn saturates(&self, star: &Star, epoch: Epoch) -> Result<Option<String>, PlannerError> {
        let plan = self.around.devices;
        let judge = Judge {
            station: &plan.station,
            air: self.around.air,
            orientation: self.around.orientation,
            zero: self.around.zero,
            seeing_arcsec: self.options.seeing_arcsec,
        };
        let filters = self.filters();
        let exposings: Vec<Exposing> = plan
            .cameras
            .iter()
            .flat_map(|camera| {
                let bare = Exposing::of(camera, None, None);
                let mut all = vec![bare.clone()];
                all.extend(filters.iter().map(|filter| {
                    let mut behind = bare.clone();
                    behind.plan.filter = Some(filter.clone());
                    behind
                }));
                all
            })
            .collect();
        let near = judge.star(star, epoch, &exposings, &plan.counters)?;
        Ok(near.into_iter().next().filter(|near| near.part > MARGIN).map(|near| near.what))
    }

    /// Flats while the Sun goes down, and bias frames for them.
    fn flats(
        &mut self,
        night: Epoch,
        visits: &mut Vec<(Epoch, PlannedVisit)>,
    ) -> Result<(), PlannerError> {
        let Some(level) = self.options.flats_adu else { return Ok(()) };
        let site = &self.around.devices.station.site;
        let mut twilight: Option<(Epoch, Epoch)> = None;
        // From two hours before the dark, minute by minute.
        for minute in 0..180 {
            let epoch = later(night, 60.0 * f64::from(minute) - 7200.0);
            let sun = Observer::at(epoch, site, self.around.orientation)?.sun();
            let altitude = sun.horizontal.altitude_deg();
            if (FLATS_DEG[1]..=FLATS_DEG[0]).contains(&altitude) {
                twilight = Some((twilight.map_or(epoch, |(from, _)| from), epoch));
            }
        }
        let first = visits.iter().map(|(begin, _)| *begin).min();
        let (Some((from, to)), Some(first)) = (twilight, first) else {
            self.warnings.push("no flats: there is no evening twilight before the night".into());
            return Ok(());
        };
        // As many frames as are asked for, by the slowest camera.
        let intervals = self.around.devices.cameras.iter().filter_map(|camera| camera.interval_s);
        let slowest_s = intervals.map(Positive::get).fold(0.0, f64::max);
        let bias_s = (f64::from(BIAS_FRAMES) * slowest_s + BIAS_S).ceil().max(LEAST_BIAS_S);
        let to = if seconds(to, first) < bias_s { later(first, -bias_s) } else { to };
        let for_s = seconds(from, to).floor();
        if for_s < 60.0 {
            self.warnings.push("no flats: other visits fill the twilight".into());
            return Ok(());
        }
        let filters = self.filters();
        let mut more = format!("level_adu = {level}\nexposure_s = 0.1\nframes = {FLAT_FRAMES}\n");
        if !filters.is_empty() {
            let _ = writeln!(more, "filters = {filters:?}");
        }
        visits.push((from, self.off("flat", from, for_s, &more)));
        let more = format!("exposure_s = {BIAS_S}\nframes = {BIAS_FRAMES}\n");
        visits.push((to, self.off("bias", to, bias_s, &more)));
        Ok(())
    }
}

/// The whole seconds of UTC within a pass.
fn whole_span(pass: &PassOffer) -> (Epoch, Epoch) {
    let (from, to) = pass.span;
    (whole(from, |s| (s - 1e-6).ceil()), whole(to, |s| (s + 1e-6).floor()))
}

fn whole_length_s(pass: &PassOffer) -> f64 {
    let (from, to) = whole_span(pass);
    seconds(from, to)
}

fn too_short(pass: &PassOffer) -> PlannerError {
    let length_s = seconds(pass.span.0, pass.span.1);
    PlannerError::Short { label: pass.label.clone(), length_s }
}

/// Whether a star with this note is no calibrator.
fn spoils(note: &StarNote) -> bool {
    matches!(
        note,
        StarNote::Variable
            | StarNote::Eclipsing
            | StarNote::Double
            | StarNote::SpectroscopicBinary
            | StarNote::UnknownType
    )
}

/// Blue, white to yellow, red.
fn colour_class(star: &Star) -> usize {
    match star.bv_mag {
        Some(bv) if bv < 0.2 => 0,
        Some(bv) if bv > 0.9 => 2,
        _ => 1,
    }
}

impl NightPlan {
    /// The text of NIGHT.toml: that of the devices as it stands, with the visits.
    pub fn toml(&self, devices: &str) -> String {
        let mut text = format!("from = \"{}\"\n{}\n", self.from_utc, devices.trim_end());
        for visit in &self.visits {
            let mut about = Vec::new();
            if let Some(v) = visit.v_mag {
                about.push(format!("V {v:.1}"));
            }
            if let Some(bv) = visit.bv_mag {
                about.push(format!("B−V {bv:+.2}"));
            }
            if let Some(altitude) = visit.altitude_deg {
                about.push(format!("altitude {altitude:.0}°"));
            }
            let about = match about.is_empty() {
                true => String::new(),
                false => format!("   # {}", about.join(", ")),
            };
            let _ = write!(text, "\n[[visit]]{about}\n{}", visit.lines);
        }
        text
    }
}
