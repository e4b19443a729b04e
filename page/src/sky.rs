//! The sky above a station at a moment: stars, planets, Sun, Moon, horizon, and where the telescope pointed.

use hifitime::{Duration, Epoch};
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use sunglint_formats::session::Target;
use sunglint_observatory::Pointing;
use sunglint_observatory::planner::{MOON_DEG, star_name};
use sunglint_radiometry::sky::{
    AzimuthAltitude, Catalogue, EarthOrientation, Horizontal, Observer, Planet,
};
use sunglint_radiometry::station::Station;

/// Faintest star that is drawn, V mag.
const FAINTEST: f64 = 4.0;
/// Points of a track at most.
const POINTS: usize = 120;

/// A star above the horizon.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SkyStar {
    /// Proper name, or empty.
    pub name: String,
    /// Name by which a plan finds it.
    pub plan_name: String,
    /// Azimuth and altitude, deg, true.
    pub at_deg: AzimuthAltitude,
    /// V magnitude.
    pub v_mag: f64,
}

/// A planet above the horizon.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SkyPlanet {
    /// Name.
    pub name: &'static str,
    /// Azimuth and altitude, deg, true.
    pub at_deg: AzimuthAltitude,
    /// V magnitude; `None` where nobody measured it at such a phase angle.
    pub v_mag: Option<f64>,
}

/// The sky at a moment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sky {
    /// Seconds after the session's start.
    pub at_s: f64,
    /// Stars to magnitude 4.
    pub stars: Vec<SkyStar>,
    /// Mercury to Saturn, where they are up.
    pub planets: Vec<SkyPlanet>,
    /// Azimuth and altitude of the Sun, deg.
    pub sun_deg: AzimuthAltitude,
    /// The same of the Moon.
    pub moon_deg: AzimuthAltitude,
    /// Sunlit part of the Moon.
    pub moon_lit: f64,
    /// Distance from the Moon within which the planner takes no star, deg.
    pub moon_limit_deg: f64,
    /// Name of the target and where it stands, deg.
    pub target: Option<(String, AzimuthAltitude)>,
    /// Elevation of the horizon at each tenth degree of azimuth from north, deg.
    pub horizon_deg: Vec<f64>,
}

/// Course of a target over a visit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SkyTrack {
    /// Name of the target.
    pub name: String,
    /// Seconds after the session's start.
    pub at_s: Vec<f64>,
    /// Azimuth and altitude, deg.
    pub at_deg: Vec<AzimuthAltitude>,
    /// Whether the Sun shines on a satellite; empty for other targets.
    pub lit: Vec<bool>,
    /// V magnitude at the station, `None` where no light comes; empty where nothing is expected.
    pub v_mag: Vec<Option<f64>>,
}

fn degrees(horizontal: Horizontal) -> AzimuthAltitude {
    [horizontal.azimuth_deg(), horizontal.altitude_deg()].into()
}

/// Time for which stars, planets, Sun and Moon stay where they are drawn, s: they move by 0.04° meanwhile, less than a point of the screen.
const STAYS_S: f64 = 10.0;

/// The sky of the last ten seconds, which all pages share: to find the places of all stars takes as long as a hundred other answers.
#[derive(Debug, Default)]
pub(crate) struct Skies(Mutex<Option<Sky>>);

impl Skies {
    /// The sky at a time; of the target as it stands then.
    pub fn at(
        &self,
        station: &Station,
        start: Epoch,
        utc: Epoch,
        target: Option<&Target>,
    ) -> Option<Sky> {
        let at_s = (utc - start).to_seconds();
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if known.as_ref().is_none_or(|sky| (sky.at_s - at_s).abs() > STAYS_S) {
            *known = Some(Sky::at(station, start, utc, None)?);
        }
        let sky = known.clone()?;
        drop(known);
        Some(Sky { at_s, target: placed(station, utc, target), ..sky })
    }
}

fn placed(
    station: &Station,
    utc: Epoch,
    target: Option<&Target>,
) -> Option<(String, AzimuthAltitude)> {
    let target = target?;
    let place = Pointing::new(station.clone()).horizontal_deg(target, utc)?;
    Some((target.name.clone(), place))
}

impl Sky {
    /// The sky at a time; `None` outside the range of the Earth's orientation.
    pub fn at(
        station: &Station,
        start: Epoch,
        utc: Epoch,
        target: Option<&Target>,
    ) -> Option<Self> {
        let observer = Observer::at(utc, &station.site, EarthOrientation::embedded()).ok()?;
        let stars = Catalogue::embedded().stars().iter().filter_map(|star| {
            let v_mag = star.v_mag.filter(|v_mag| *v_mag <= FAINTEST)?;
            let at_deg = degrees(observer.star(star).horizontal);
            let name = star.name.clone().unwrap_or_default();
            let plan_name = star_name(star);
            (at_deg.altitude_deg > 0.0).then_some(SkyStar { name, plan_name, at_deg, v_mag })
        });
        let planets = Planet::ALL.into_iter().map(|planet| {
            let seen = observer.planet(planet);
            let at_deg = degrees(seen.horizontal);
            SkyPlanet { name: planet.name(), at_deg, v_mag: seen.place.v_mag }
        });
        let moon = observer.moon();
        Some(Self {
            at_s: (utc - start).to_seconds(),
            stars: stars.collect(),
            planets: planets.filter(|planet| planet.at_deg.altitude_deg > 0.0).collect(),
            sun_deg: degrees(observer.sun().horizontal),
            moon_deg: degrees(moon.horizontal),
            moon_lit: moon.place.illuminated_fraction(),
            moon_limit_deg: MOON_DEG,
            target: placed(station, utc, target),
            horizon_deg: (0..36)
                .map(|i| station.horizon.elevation_deg(10.0 * f64::from(i)))
                .collect(),
        })
    }
}

impl SkyTrack {
    /// The course of a target; `None` for one without a place.
    pub fn over(
        station: &Station,
        start: Epoch,
        target: &Target,
        from: Epoch,
        to: Epoch,
    ) -> Option<Self> {
        let length_s = (to - from).to_seconds().max(0.0);
        let steps = ((length_s / 5.0).ceil() as usize).clamp(1, POINTS);
        let mut pointing = Pointing::new(station.clone());
        let (at_s, at_deg, lit, v_mag) = (vec![], vec![], vec![], vec![]);
        let mut track = Self { name: target.name.clone(), at_s, at_deg, lit, v_mag };
        for i in 0..=steps {
            let utc = from + Duration::from_seconds(length_s * i as f64 / steps as f64);
            track.at_deg.push(pointing.horizontal_deg(target, utc)?);
            track.at_s.push((utc - start).to_seconds());
            track.lit.extend(pointing.is_lit(target, utc));
        }
        Some(track)
    }
}
