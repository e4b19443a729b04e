//! Where a visit's target stood: zenith angle, and of a satellite range and phase angle.

use super::ReduceError;
use super::error::Within as _;
use hifitime::{Epoch, Unit};
use rayon::prelude::*;
use std::path::Path;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, tle};
use sunglint_formats::session::{Target, TargetKind};
use sunglint_radiometry::light_curve::Samples;
use sunglint_radiometry::sky::{EarthOrientation, Equatorial, Observer, Site, Star};

/// A star's direction is computed this often and turned on between: it turns by 7.3e-5 rad/s, so that the chord of 4 s is nowhere further than
/// 1.1e-8 rad from the arc.
const STAR_STEP_S: f64 = 4.0;

/// A target with a known place.
pub enum Body {
    /// A star.
    Star(Box<Star>),
    /// A satellite.
    Satellite(Box<Orbit>),
}

impl Body {
    /// The body of a session's target; `None` where the log gives no place for it.
    ///
    /// # Errors
    /// A place or elements that are none.
    pub fn of(target: &Target) -> Result<Option<Self>, ReduceError> {
        match (target.target_kind, target.ra_deg, target.dec_deg, &target.tle) {
            (TargetKind::Star, Some(ra_deg), Some(dec_deg), _) => {
                let place = Equatorial { ra_deg, dec_deg };
                let star = Star::at(&target.name, place)
                    .within(|| format!("the place of {}", target.name))?;
                Ok(Some(Self::Star(Box::new(star))))
            }
            (TargetKind::Satellite, _, _, Some([one, two])) => {
                let path = format!("elements of {}", target.name);
                let elements = tle::parse(Path::new(&path), &format!("{one}\n{two}\n"))?;
                let Some(elements) = elements.into_iter().next() else { return Ok(None) };
                Ok(Some(Self::Satellite(Box::new(Orbit::Tle(elements.orbit()?)))))
            }
            _ => Ok(None),
        }
    }

    /// Fills in the geometry of samples in the order of time: the true zenith angle, and of a satellite range and phase angle.
    ///
    /// # Errors
    /// An epoch at which the body has no place.
    pub fn locate(&self, samples: &mut Samples, site: &Site) -> Result<(), ReduceError> {
        let earth = EarthOrientation::embedded();
        match self {
            Self::Star(star) => {
                samples.zenith_deg = Some(star_zeniths(star, &samples.time, site, earth)?);
            }
            Self::Satellite(orbit) => {
                let places: Vec<Geometry> = samples
                    .time
                    .par_iter()
                    .map(|epoch| {
                        let observer = Observer::at(*epoch, site, earth)?;
                        Ok(Geometry::at(orbit, &observer)?)
                    })
                    .collect::<Result<_, ReduceError>>()?;
                samples.zenith_deg = Some(places.iter().map(Geometry::zenith_deg).collect());
                samples.range_m = Some(places.iter().map(|place| place.range_m).collect());
                samples.phase_deg = Some(places.iter().map(Geometry::phase_deg).collect());
            }
        }
        Ok(())
    }

    /// The true zenith angle at one epoch, deg.
    ///
    /// # Errors
    /// An epoch at which the body has no place.
    pub fn zenith_deg(&self, epoch: Epoch, site: &Site) -> Result<f64, ReduceError> {
        let mut one = Samples::new(vec![epoch], 1.0);
        self.locate(&mut one, site)?;
        Ok(one.zenith_deg.and_then(|zeniths| zeniths.first().copied()).unwrap_or(f64::NAN))
    }
}

/// True zenith angles of a star at many times, deg.
fn star_zeniths(
    star: &Star,
    times: &[Epoch],
    site: &Site,
    earth: &EarthOrientation,
) -> Result<Vec<f64>, ReduceError> {
    let (Some(first), Some(last)) = (times.iter().min(), times.iter().max()) else {
        return Ok(Vec::new());
    };
    let steps = ((*last - *first).to_seconds() / STAR_STEP_S).floor() as usize + 1;
    let directions = (0..=steps)
        .into_par_iter()
        .map(|i| {
            let epoch = *first + (i as f64 * STAR_STEP_S) * Unit::Second;
            let observer = Observer::at(epoch, site, earth)?;
            Ok(observer.gcrs_to_enu() * observer.star_direction_gcrs(star))
        })
        .collect::<Result<Vec<glam::DVec3>, ReduceError>>()?;
    let zenith_deg = |epoch: &Epoch| {
        let at = (*epoch - *first).to_seconds() / STAR_STEP_S;
        let i = (at.floor() as usize).min(steps - 1);
        let direction = directions[i].lerp(directions[i + 1], at - i as f64);
        direction.x.hypot(direction.y).atan2(direction.z).to_degrees()
    };
    Ok(times.iter().map(zenith_deg).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::time::parse_utc;
    use sunglint_radiometry::station::Station;

    /// Truth: [`Observer::star`], held against astropy elsewhere, at every single time. 1e-6°: the chord's 1.1e-8 rad.
    #[test]
    fn a_star_between_the_knots_stands_where_it_stands() {
        let station = Station::built_in("ufo").unwrap().unwrap();
        let target = Target {
            name: "Vega".into(),
            target_kind: TargetKind::Star,
            on: true,
            ra_deg: Some(279.234_735),
            dec_deg: Some(38.783_689),
            tle: None,
            omm: None,
        };
        let start = parse_utc("2020-11-18T17:00:00").unwrap();
        let times: Vec<Epoch> =
            [0.0, 0.05, 3.9, 4.0, 5.3, 599.95].map(|s| start + s * Unit::Second).to_vec();
        let mut samples = Samples::new(times.clone(), 0.1);
        let body = Body::of(&target).unwrap().unwrap();
        body.locate(&mut samples, &station.site).unwrap();
        let Body::Star(star) = &body else { panic!("a star") };
        for (time, zenith) in times.iter().zip(samples.zenith_deg.unwrap()) {
            let observer =
                Observer::at(*time, &station.site, EarthOrientation::embedded()).unwrap();
            let truth = observer.star(star).horizontal.zenith_deg();
            assert!((zenith - truth).abs() < 1e-6, "{zenith} {truth}");
        }
        assert!(samples.range_m.is_none());
    }

    #[test]
    fn a_target_without_a_place_has_none() {
        assert!(Body::of(&Target::off(TargetKind::Sky)).unwrap().is_none());
    }
}
