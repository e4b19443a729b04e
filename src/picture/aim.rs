//! What a picture is of: a target, where the Sun and the observer stand, and what is up.

use super::{PictureArgs, Up};
use crate::output::{Console, Usage};
use crate::simulate::read;
use crate::star::when;
use anyhow::{Context as _, bail};
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use sunglint_formats::time::{format_utc, format_utc_shortest, tai_nanoseconds};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{Overrides, Pass, Place};
use sunglint_simulator::target::Target;

/// From where a model is looked at unless somebody says: from the front, a little from the side and from above.
const OBSERVER: DVec3 = DVec3::new(0.75, -0.5, 0.45);
/// The phase angle unless somebody says, degrees.
const PHASE_DEG: f64 = 40.0;

/// What a picture is of.
pub struct Aim {
    /// The body.
    pub target: Target,
    /// Unit vector to the Sun, body axes.
    pub sun_body: DVec3,
    /// Unit vector to the observer, body axes.
    pub observer_body: DVec3,
    /// What is up, body axes.
    pub up: DVec3,
    /// The same in words.
    pub up_name: &'static str,
    /// Directions to draw, body axes.
    pub compass: Vec<(&'static str, DVec3)>,
    /// Sunlight at the body.
    pub sun: Spectrum<Irradiance>,
    /// What part of the Sun's disc is visible, over the square of its distance in au: the factor of that spectrum.
    pub sunlight: f64,
    /// When, of a pass.
    pub time: Option<Epoch>,
    /// The distance of the observer, m, where there is one.
    pub range_m: Option<f64>,
    /// Who looks, of a pass.
    pub station: Option<Station>,
    /// What it is, in a line.
    pub title: String,
    /// What a person should hear of.
    pub warnings: Vec<String>,
}

impl Aim {
    /// What was asked for.
    pub fn new(args: &PictureArgs, console: Console) -> anyhow::Result<Self> {
        match (&args.pass, &args.model) {
            (Some(_), Some(_)) => {
                Err(Usage("give either PASS.toml or --model, not both".into()).into())
            }
            (None, None) => Err(Usage(
                "a picture of what? Give PASS.toml, --model NAME (a built-in target or a target.toml), or --sphere".into(),
            )
            .into()),
            (Some(_), None) => Self::of_pass(args, console),
            (None, Some(model)) => Self::of_model(args, model),
        }
    }

    /// Sun, Earth and station at a moment of a pass.
    fn of_pass(args: &PictureArgs, console: Console) -> anyhow::Result<Self> {
        let path = args.pass.clone().unwrap_or_default();
        let alone = [
            ("--phase", args.phase.is_some() && !args.map),
            ("--sun", args.sun.is_some()),
            ("--observer", args.observer.is_some()),
            ("--range-km", args.range_km.is_some()),
        ];
        if let Some((option, _)) = alone.iter().find(|(_, given)| *given) {
            let text = format!("{option} goes with --model: a pass says itself where all stand");
            return Err(Usage(text).into());
        }
        let mut pass = read(&path, &args.station, Overrides::default())?;
        let name = || path.display().to_string();
        let at = args.at.as_deref().map(when).transpose().context("--at")?;
        pass.times = vec![moment(&pass, at).with_context(name)?];
        pass.exposure_s.truncate(1);
        let place = *pass.moments().with_context(name)?.first().context("no moment")?;
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
        let (up, up_name) = match args.up.unwrap_or(Up::North) {
            Up::North => (north, "celestial north up"),
            Up::Zenith => (zenith, "zenith up"),
            Up::BodyZ => (DVec3::Z, "body z up"),
        };
        let au = geometry.sun.distance_au();
        console.detail(&format!(
            "{}: Sun ({:.4}), station ({:.4}), body axes",
            format_utc_shortest(geometry.epoch),
            place.sun_body,
            place.observer_body
        ));
        let title = format!(
            "{} as {} from {}, {}: range {:.1} km, altitude {:.1}°, phase angle {:.1}°",
            pass.orbit.name(),
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
    fn of_model(args: &PictureArgs, model: &str) -> anyhow::Result<Self> {
        if args.at.is_some() {
            return Err(Usage("--at goes with PASS.toml: a model alone has no time".into()).into());
        }
        if matches!(args.up, Some(Up::North | Up::Zenith)) {
            let text = "a model alone has no north and no zenith: --up body-z";
            return Err(Usage(text.into()).into());
        }
        let target = crate::passes::target(model)?;
        let observer = args.observer.unwrap_or(OBSERVER).normalize();
        let mut up = DVec3::Z;
        let mut up_name = "body z up";
        if up.cross(observer).length() < 1e-6 {
            (up, up_name) = (DVec3::X, "body x up");
        }
        let sun = match (args.sun, args.phase) {
            (Some(_), Some(_)) => {
                return Err(Usage("give either --sun or --phase, not both".into()).into());
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
        let range_m = args.range_km.map(|km| km * 1e3);
        if range_m.is_some_and(|m| !(m.is_finite() && m > 0.0)) {
            return Err(Usage("--range-km: expected a distance above 0".into()).into());
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
            station: args.station.find()?,
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
    pub fn axes(&self) -> anyhow::Result<(DVec3, DVec3)> {
        let along = self.observer_body;
        let up = (self.up - self.up.dot(along) * along).try_normalize();
        let up = up.filter(|_| self.up.cross(along).length() > 1e-9).with_context(|| {
            format!(
                "{} lies along the line of sight: take another --up (north, zenith, body-z)",
                self.up_name.trim_end_matches(" up")
            )
        })?;
        Ok((up.cross(along), up))
    }
}

/// The moment that was asked for, which lies within the pass; else the one at which the target stands highest.
fn moment(pass: &Pass, at: Option<Epoch>) -> anyhow::Result<Epoch> {
    let key = |t: &Epoch| tai_nanoseconds(*t);
    let first = pass.times.iter().copied().min_by_key(key).context("no moment")?;
    let last = pass.times.iter().copied().max_by_key(key).context("no moment")?;
    let Some(at) = at else {
        let places = pass.moments()?;
        let height = |p: &&Place| p.geometry.horizontal.altitude_deg();
        let best = places.iter().max_by(|a, b| height(a).total_cmp(&height(b)));
        return Ok(best.context("no moment")?.geometry.epoch);
    };
    if key(&at) < key(&first) || key(&at) > key(&last) {
        bail!(
            "--at {} is outside the pass, which runs from {} to {} ([times])",
            format_utc_shortest(at),
            format_utc_shortest(first),
            format_utc_shortest(last)
        );
    }
    Ok(at)
}

fn concerns(pass: &Pass, place: &Place) -> Vec<String> {
    let mut concerns = Vec::new();
    let altitude_deg = place.geometry.horizontal.altitude_deg();
    if altitude_deg < 0.0 {
        concerns.push(format!(
            "{} stands {altitude_deg:.1}° high then: the Earth hides it from {}",
            pass.orbit.name(),
            pass.station.name
        ));
    }
    if place.sunlit == 0.0 {
        concerns.push(format!(
            "{} is in the Earth's shadow then: no sunlight falls on it (--per-irradiance shows it all the same)",
            pass.orbit.name()
        ));
    } else if place.sunlit < 1.0 {
        concerns.push(format!("only {:.3} of the Sun's disc is visible then", place.sunlit));
    }
    concerns
}
