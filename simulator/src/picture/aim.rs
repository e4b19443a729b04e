//! Subject of a picture: a target, where the Sun and the observer stand, and what is up.

use super::ViewError;
use crate::pass::{Pass, Place};
use crate::target::Target;
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use sunglint_formats::time::{format_utc, format_utc_shortest, tai_nanoseconds};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::station::Station;

/// Upward direction in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Up {
    /// The celestial pole.
    North,
    /// The station's zenith.
    Zenith,
    /// The body's z axis.
    BodyZ,
}

/// From where a target alone is looked at, and from where it is lit; what is `None` is as in the field's own words.
#[derive(Debug, Clone, Default)]
pub struct ModelView {
    /// Direction to the observer, body axes (default 0.75, −0.5, 0.45).
    pub observer: Option<DVec3>,
    /// Direction to the Sun, body axes (default by the phase angle).
    pub sun: Option<DVec3>,
    /// Phase angle, degrees, the Sun to the observer's right (default 40).
    pub phase_deg: Option<f64>,
    /// Distance of the observer, m (default none).
    pub range_m: Option<f64>,
    /// Who looks (default none).
    pub station: Option<Station>,
}

/// From where a model is looked at unless somebody says: from the front, a little from the side and from above.
const OBSERVER: DVec3 = DVec3::new(0.75, -0.5, 0.45);
/// The phase angle unless somebody says, degrees.
const PHASE_DEG: f64 = 40.0;

/// Subject of a picture.
#[derive(Debug, Clone)]
pub struct Aim {
    /// The body.
    pub target: Target,
    /// Unit vector to the Sun, body axes.
    pub sun_body: DVec3,
    /// Unit vector to the observer, body axes.
    pub observer_body: DVec3,
    /// Upward direction, body axes.
    pub up: DVec3,
    /// The same in words.
    pub up_name: &'static str,
    /// Directions to draw, body axes.
    pub compass: Vec<(&'static str, DVec3)>,
    /// Sunlight at the body.
    pub sun: Spectrum<Irradiance>,
    /// Visible part of the Sun's disc, over the square of its distance in au: the factor of that spectrum.
    pub sunlight: f64,
    /// When, of a pass.
    pub time: Option<Epoch>,
    /// The distance of the observer, m, where there is one.
    pub range_m: Option<f64>,
    /// Who looks, of a pass.
    pub station: Option<Station>,
    /// Title of the picture, in a line.
    pub title: String,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl Aim {
    /// Sun, Earth and station at a moment of a pass: without one, that at which the target stands highest.
    ///
    /// # Errors
    /// A moment outside of the pass; places that cannot be computed.
    pub fn of_pass(mut pass: Pass, at: Option<Epoch>, up: Option<Up>) -> Result<Self, ViewError> {
        pass.times = vec![moment(&pass, at)?];
        pass.exposure_s.truncate(1);
        let place = *pass.moments()?.first().ok_or_else(no_moment)?;
        let mut warnings = pass.warnings.clone();
        warnings.extend(concerns(&pass, &place));
        let geometry = &place.geometry;
        let to_body = place.body_to_gcrs.conjugate();
        let north = to_body * DVec3::Z;
        // The station's vertical at the target, to 0.2° (geocentric).
        let station_m = geometry.target.position_m + geometry.range_m * geometry.to_observer;
        let zenith = to_body * station_m.normalize_or_zero();
        let along = place.observer_body;
        // On the sky: the observer looks against `along`.
        let east = north.cross(-along).normalize_or_zero();
        let (up, up_name) = match up.unwrap_or(Up::North) {
            Up::North => (north, "celestial north up"),
            Up::Zenith => (zenith, "zenith up"),
            Up::BodyZ => (DVec3::Z, "body z up"),
        };
        let au = geometry.sun.distance_au();
        let title = format!(
            "{} as {} from {}, {}: range {:.1} km, altitude {:.1}°, phase angle {:.1}°",
            pass.object(),
            pass.target.name,
            pass.station.name,
            format_utc(geometry.epoch, 1),
            geometry.range_m * 1e-3,
            geometry.horizontal.altitude_deg(),
            geometry.phase_deg(),
        );
        Ok(Self {
            sun_body: place.sun_body,
            observer_body: place.observer_body,
            up,
            up_name,
            compass: vec![("N", north), ("E", east), ("Sun", place.sun_body)],
            sunlight: place.sunlit / (au * au),
            time: Some(geometry.epoch),
            range_m: Some(geometry.range_m),
            sun: pass.sun,
            station: Some(pass.station),
            target: pass.target,
            title,
            warnings,
        })
    }

    /// A target alone, at 1 au.
    ///
    /// # Errors
    /// Both a direction to the Sun and a phase angle; a distance that is not above 0.
    pub fn of_model(target: Target, view: ModelView) -> Result<Self, ViewError> {
        let observer = view.observer.unwrap_or(OBSERVER).normalize();
        let mut up = DVec3::Z;
        let mut up_name = "body z up";
        if up.cross(observer).length() < 1e-6 {
            (up, up_name) = (DVec3::X, "body x up");
        }
        let sun = match (view.sun, view.phase_deg) {
            (Some(_), Some(_)) => {
                return Err(ViewError::Setting("give either --sun or --phase, not both".into()));
            }
            (Some(sun), None) => sun.normalize(),
            // To the right of the observer.
            (None, phase) => {
                let aside = (up - up.dot(observer) * observer).normalize();
                let angle = phase.unwrap_or(PHASE_DEG).to_radians();
                DQuat::from_axis_angle(aside, angle) * observer
            }
        };
        let phase_deg = sun.angle_between(observer).to_degrees();
        let range_m = view.range_m;
        if range_m.is_some_and(|m| !(m.is_finite() && m > 0.0)) {
            return Err(ViewError::Setting("--range-km: expected a distance above 0".into()));
        }
        let title = format!("{}: phase angle {phase_deg:.1}°, Sun at 1 au", target.name);
        let warnings = target.warnings.clone();
        Ok(Self {
            compass: vec![("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z), ("Sun", sun)],
            sun_body: sun,
            observer_body: observer,
            up,
            up_name,
            sun: sun_at_1_au().clone(),
            sunlight: 1.0,
            time: None,
            range_m,
            station: view.station,
            title,
            target,
            warnings,
        })
    }

    /// Angle Sun–target–observer, degrees.
    pub fn phase_deg(&self) -> f64 {
        self.sun_body.angle_between(self.observer_body).to_degrees()
    }

    /// Right and up in the picture, body axes.
    ///
    /// # Errors
    /// An upward direction along the line of sight.
    pub fn axes(&self) -> Result<(DVec3, DVec3), ViewError> {
        let along = self.observer_body;
        let up = (self.up - self.up.dot(along) * along).try_normalize();
        let up = up.filter(|_| self.up.cross(along).length() > 1e-9).ok_or_else(|| {
            ViewError::Impossible(format!(
                "{} lies along the line of sight: take another --up (north, zenith, body-z)",
                self.up_name.trim_end_matches(" up")
            ))
        })?;
        Ok((up.cross(along), up))
    }
}

fn no_moment() -> ViewError {
    ViewError::Impossible("no moment".into())
}

/// The moment that was asked for, which lies within the pass; else the one at which the target stands highest.
fn moment(pass: &Pass, at: Option<Epoch>) -> Result<Epoch, ViewError> {
    let key = |t: &Epoch| tai_nanoseconds(*t);
    let first = pass.times.iter().copied().min_by_key(key).ok_or_else(no_moment)?;
    let last = pass.times.iter().copied().max_by_key(key).ok_or_else(no_moment)?;
    let Some(at) = at else {
        let places = pass.moments()?;
        let height = |p: &&Place| p.geometry.horizontal.altitude_deg();
        let best = places.iter().max_by(|a, b| height(a).total_cmp(&height(b)));
        return Ok(best.ok_or_else(no_moment)?.geometry.epoch);
    };
    if key(&at) < key(&first) || key(&at) > key(&last) {
        return Err(ViewError::Impossible(format!(
            "--at {} is outside the pass, which runs from {} to {} ([times])",
            format_utc_shortest(at),
            format_utc_shortest(first),
            format_utc_shortest(last)
        )));
    }
    Ok(at)
}

fn concerns(pass: &Pass, place: &Place) -> Vec<String> {
    let mut concerns = Vec::new();
    let altitude_deg = place.geometry.horizontal.altitude_deg();
    if altitude_deg < 0.0 {
        concerns.push(format!(
            "{} stands {altitude_deg:.1}° high then: the Earth hides it from {}",
            pass.object(),
            pass.station.name
        ));
    }
    if place.sunlit == 0.0 {
        concerns.push(format!(
            "{} is in the Earth's shadow then: no sunlight falls on it (--per-irradiance shows it all the same)",
            pass.object()
        ));
    } else if place.sunlit < 1.0 {
        concerns.push(format!("only {:.3} of the Sun's disc is visible then", place.sunlit));
    }
    concerns
}
