//! Where a target stands: for the headers of frames.

use hifitime::Epoch;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
use sunglint_formats::fits::Header;
use sunglint_formats::session::{Target, TargetKind};
use sunglint_radiometry::sky::{EarthOrientation, Equatorial, Observer, Star};
use sunglint_radiometry::station::Station;

/// Follows the targets of a schedule.
#[derive(Debug)]
pub struct Pointing {
    station: Station,
    /// The last target asked for, and how it moves.
    known: Option<(Target, Option<Body>)>,
}

#[derive(Debug)]
enum Body {
    Star(Box<Star>),
    Orbit(Box<Orbit>),
}

impl Body {
    fn of(target: &Target) -> Option<Self> {
        match (&target.tle, target.ra_deg, target.dec_deg) {
            (Some([line1, line2]), ..) => {
                let sets = tle::parse("the session's elements", &format!("{line1}\n{line2}\n"));
                let orbit = TleOrbit::new(sets.ok()?.into_iter().next()?).ok()?;
                Some(Self::Orbit(Box::new(orbit.into())))
            }
            (None, Some(ra_deg), Some(dec_deg)) => {
                let star = Star::at(&target.name, Equatorial { ra_deg, dec_deg }).ok()?;
                Some(Self::Star(Box::new(star)))
            }
            _ => None,
        }
    }
}

impl Pointing {
    /// From a station.
    pub fn new(station: Station) -> Self {
        Self { station, known: None }
    }

    /// Puts into a frame's header what the plan says of its target: name and kind, and where it stands.
    pub fn describe(&mut self, target: Option<&Target>, utc: Epoch, header: &mut Header) {
        header.set("OBSERVAT", self.station.name.as_str(), "station");
        let dark = target.is_some_and(|target| target.target_kind == TargetKind::Dark);
        header.set("IMAGETYP", if dark { "Dark Frame" } else { "Light Frame" }, "");
        let Some(target) = target else { return };
        header.set("OBJECT", target.name.as_str(), "target, as planned");
        let kind = serde_json::to_value(target.target_kind).ok();
        let kind = kind.as_ref().and_then(|kind| kind.as_str()).unwrap_or("none").to_owned();
        header.set("OBJTYPE", kind, "star, satellite, sky, dark or none");
        let Some([azimuth, altitude, ra, dec]) = self.place(target, utc) else { return };
        for (keyword, value, comment) in [
            ("RA", ra, "deg, ICRS axes: the target's apparent place"),
            ("DEC", dec, "deg, at the middle of the exposure, from the plan"),
            ("CENTAZ", azimuth, "deg, from north by east"),
            ("CENTALT", altitude, "deg, true (unrefracted)"),
        ] {
            header.set(keyword, value, comment);
        }
    }

    /// Azimuth, altitude, right ascension and declination (GCRS axes), deg.
    fn place(&mut self, target: &Target, utc: Epoch) -> Option<[f64; 4]> {
        if self.known.as_ref().is_none_or(|(known, _)| known != target) {
            self.known = Some((target.clone(), Body::of(target)));
        }
        let body = self.known.as_ref()?.1.as_ref()?;
        let earth = EarthOrientation::embedded();
        let observer = Observer::at(utc, &self.station.site, earth).ok()?;
        let (horizontal, direction) = match body {
            Body::Star(star) => {
                let place = observer.star(star);
                (place.horizontal, place.direction_gcrs)
            }
            Body::Orbit(orbit) => {
                let state = orbit.state(utc, observer.frame()).ok()?;
                let seen = observer.apparent(state.position_m, state.velocity_m_s).ok()?;
                (seen.horizontal, seen.direction_gcrs)
            }
        };
        let Equatorial { ra_deg, dec_deg } = Equatorial::of_direction(direction);
        Some([horizontal.azimuth_deg(), horizontal.altitude_deg(), ra_deg, dec_deg])
    }
}
