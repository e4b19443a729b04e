//! Pointing plan of a virtual telescope.

use super::night::NightError;
use super::options::{Options, PlanOptions, VisitKind};
use hifitime::{Epoch, Unit};
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer, Site, Star};
use sunglint_radiometry::station::Station;

/// A stretch of the night with one target. Between visits the telescope is on its way: it sees the sky.
#[derive(Debug, Clone, PartialEq)]
pub struct Visit {
    /// From when on, s from the night's begin.
    pub from_s: f64,
    /// Until before when, s from the night's begin.
    pub to_s: f64,
    /// Target of the visit.
    pub target: Target,
}

/// Target of a visit.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Target {
    /// A star.
    Star(Box<Star>),
    /// A target with a rate curve of its own: a satellite.
    Curve(Curve),
    /// The sky without a target, beside what is named.
    Sky {
        /// Target that it is beside; may be empty.
        beside: String,
    },
    /// Nothing: the shutter is closed.
    Dark,
}

impl Target {
    /// Name.
    pub fn name(&self) -> String {
        match self {
            Self::Star(star) => star.label(),
            Self::Curve(curve) => curve.name.clone(),
            Self::Sky { beside } => beside.clone(),
            Self::Dark => String::new(),
        }
    }

    /// Kind.
    pub fn kind(&self) -> VisitKind {
        match self {
            Self::Star(_) => VisitKind::Star,
            Self::Curve(_) => VisitKind::Satellite,
            Self::Sky { .. } => VisitKind::Sky,
            Self::Dark => VisitKind::Dark,
        }
    }
}

/// A target's predicted rates after the air, before κ, at times between which they change evenly.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve {
    /// The target's name.
    pub name: String,
    /// Times, s from the night's begin, increasing.
    pub time_s: Vec<f64>,
    /// Hz at the detector for each time and each channel of the station (`[time][channel]`). Before and after the
    /// times the target is dark.
    pub rates_hz: Vec<Vec<f64>>,
    /// Airmass at each time: for scintillation and seeing.
    pub airmass: Vec<f64>,
}

impl Curve {
    /// A predicted light curve, its channels found by name; a channel that it lacks is dark, as is a rate that is not a number. Without zenith angles its airmass
    /// is 1, else 1/cos z up to 10.
    pub fn of_light_curve(curve: &LightCurve, start: Epoch, station: &Station) -> Self {
        let time_s: Vec<f64> =
            curve.samples.time.iter().map(|t| (*t - start).to_seconds()).collect();
        let mut order: Vec<usize> = (0..time_s.len()).collect();
        order.sort_by(|a, b| time_s[*a].total_cmp(&time_s[*b]));
        order.dedup_by(|a, b| time_s[*a] == time_s[*b]);
        let rates = |i: usize| {
            let rate = |name: &str| {
                let channel = curve.channels.iter().find(|channel| channel.name == name);
                channel.map_or(0.0, |channel| channel.rate_hz[i])
            };
            let rates = station.channels.iter().map(|channel| rate(&channel.name));
            rates.map(|hz| if hz > 0.0 { hz } else { 0.0 }).collect()
        };
        let airmass = |i: usize| {
            let zenith_deg = curve.samples.zenith_deg.as_ref().map_or(0.0, |zenith| zenith[i]);
            let cos = zenith_deg.to_radians().cos();
            if cos > 0.1 { 1.0 / cos } else { 10.0 }
        };
        Self {
            name: curve.provenance.target.clone(),
            time_s: order.iter().map(|i| time_s[*i]).collect(),
            rates_hz: order.iter().map(|i| rates(*i)).collect(),
            airmass: order.iter().map(|i| airmass(*i)).collect(),
        }
    }
}

/// The stars that a plan visits, each with the sky beside it, and dark at both ends. The stars stand at altitudes that are spread evenly over the range in sin, from
/// one visit to the next as far apart as can be (the golden section); of the stars that are up the nearest to that is taken, none twice while there are others.
///
/// # Errors
/// [`NightError::NoStar`] where no star of the catalogue is in the ranges.
pub fn plan(
    options: &PlanOptions,
    site: &Site,
    start: Epoch,
    orientation: &EarthOrientation,
) -> Result<Vec<Visit>, NightError> {
    let mut visits = Vec::new();
    let mut now_s = 0.0;
    let dark = |visits: &mut Vec<Visit>, now_s: &mut f64| {
        if options.dark_s > 0.0 {
            let to_s = *now_s + options.dark_s;
            visits.push(Visit { from_s: *now_s, to_s, target: Target::Dark });
            *now_s = to_s;
        }
    };
    dark(&mut visits, &mut now_s);
    let [brightest, faintest] = options.v_mag;
    let [low, high] = options.altitude_deg.map(|deg| deg.to_radians().sin());
    let usable = |star: &&Star| {
        star.v_mag.is_some_and(|v| (brightest..=faintest).contains(&v))
            && star.spectral_type.is_some()
    };
    let stars: Vec<&Star> = Catalogue::embedded().stars().iter().filter(usable).collect();
    let mut seen = vec![0_usize; stars.len()];
    for number in 0..options.stars {
        now_s += options.slew_s;
        let wanted = low + (high - low) * (0.5 + 0.618_033_988_749_895 * number as f64).fract();
        let middle = start + (now_s + 0.5 * options.visit_s) * Unit::Second;
        let observer = Observer::at(middle, site, orientation)?;
        let height = |star: &Star| observer.star(star).horizontal.altitude_deg().to_radians().sin();
        let up = stars.iter().enumerate().map(|(i, star)| (i, height(star)));
        let up = up.filter(|(_, sin)| (low..=high).contains(sin));
        let nearest = up.min_by(|(a, of_a), (b, of_b)| {
            let distance = |sin: f64| (sin - wanted).abs();
            seen[*a].cmp(&seen[*b]).then(distance(*of_a).total_cmp(&distance(*of_b)))
        });
        let Some((i, _)) = nearest else {
            return Err(NightError::NoStar {
                v_mag: options.v_mag,
                altitude_deg: options.altitude_deg,
                at: middle,
            });
        };
        seen[i] += 1;
        let to_s = now_s + options.visit_s;
        let target = Target::Star(Box::new(stars[i].clone()));
        visits.push(Visit { from_s: now_s, to_s, target });
        now_s = to_s;
        if options.sky_s > 0.0 {
            let to_s = now_s + options.sky_s;
            let target = Target::Sky { beside: stars[i].label() };
            visits.push(Visit { from_s: now_s, to_s, target });
            now_s = to_s;
        }
    }
    dark(&mut visits, &mut now_s);
    Ok(visits)
}

/// The visits that the options name, or else those of their plan. `curve` finds the light curve of a satellite.
///
/// # Errors
/// A star that the catalogue does not have; a satellite without a curve, and what `curve` says.
pub fn visits(
    options: &Options,
    station: &Station,
    start: Epoch,
    orientation: &EarthOrientation,
    curve: &mut dyn FnMut(&str) -> Result<LightCurve, NightError>,
) -> Result<Vec<Visit>, NightError> {
    if options.visit.is_empty() {
        return plan(&options.plan, &station.site, start, orientation);
    }
    let visit = |(number, visit): (usize, &super::options::VisitOptions)| {
        let target = match visit.kind {
            VisitKind::Star => {
                Target::Star(Box::new(Catalogue::embedded().find(&visit.name)?.clone()))
            }
            VisitKind::Satellite => {
                let Some(file) = &visit.curve else {
                    return Err(NightError::NoCurve { number, name: visit.name.clone() });
                };
                let curve = Curve::of_light_curve(&curve(file)?, start, station);
                let name = if visit.name.is_empty() { curve.name } else { visit.name.clone() };
                Target::Curve(Curve { name, ..curve })
            }
            VisitKind::Sky => Target::Sky { beside: visit.name.clone() },
            VisitKind::Dark => Target::Dark,
        };
        Ok(Visit { from_s: visit.from_s, to_s: visit.to_s, target })
    };
    options.visit.iter().enumerate().map(visit).collect()
}
