//! Where a target stands: for the headers of frames.

use hifitime::Epoch;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, elements};
use sunglint_formats::Frame;
use sunglint_formats::session::{Target, TargetKind};
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::sky::{AzimuthAltitude, EarthOrientation, Equatorial, Observer, Star};
use sunglint_radiometry::station::Station;

/// Follows the targets of a schedule.
#[derive(Debug)]
pub struct Pointing {
    station: Station,
    /// The last target asked for, and how it moves.
    known: Option<(Target, Option<Body>)>,
}

/// A target with a place.
#[derive(Debug)]
pub(crate) enum Body {
    /// A star.
    Star(Box<Star>),
    /// A satellite.
    Orbit(Box<Orbit>),
}

impl Body {
    /// The body of a target; `None` where its place or elements are none.
    pub(crate) fn of(target: &Target) -> Option<Self> {
        match (target.elements(), target.ra_deg, target.dec_deg) {
            (Some(text), ..) => {
                let sets = elements::parse("the session's elements", &text);
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

    /// Electrons for one ADU, as the station's file has it.
    pub fn gain_e_per_adu(&self) -> Option<f64> {
        self.station.camera.as_ref().map(|camera| camera.gain_e_per_adu)
    }

    /// Puts into a frame's header where and when it was taken, and what the plan says of its target. `utc` is the middle of the exposure, `told` the
    /// frame type that the camera was told.
    pub fn describe(
        &mut self,
        target: Option<&Target>,
        utc: Epoch,
        told: Option<&str>,
        frame: &mut Frame,
    ) {
        let start = frame.start;
        let header = &mut frame.header;
        header.set("OBSERVAT", self.station.name.as_str(), "station");
        let place = self.station.site.geodetic();
        header.set("SITELAT", place.latitude_deg, "deg, geodetic (WGS 84)");
        header.set("SITELONG", place.longitude_deg, "deg, east");
        header.set("SITEELEV", place.height_m, "m above the ellipsoid");
        let middle = format_utc_shortest(utc);
        header.set("DATE-AVG", middle.trim_end_matches('Z'), "middle of the exposure, UTC");
        let end = start + (utc - start) * 2;
        let text = format_utc_shortest(end);
        header.set("DATE-END", text.trim_end_matches('Z'), "end of the exposure, UTC");
        header.set("MJD-OBS", start.to_mjd_utc_days(), "d, start of the exposure, UTC");
        header.set("MJD-AVG", utc.to_mjd_utc_days(), "d, middle of the exposure, UTC");
        // Astropy warns of a date without it.
        header.set("MJD-END", end.to_mjd_utc_days(), "d, end of the exposure, UTC");
        let said = header.text("FRAME").or(told).map(|word| word.trim().to_ascii_lowercase());
        let kind = match said.as_deref() {
            Some("dark") => "Dark Frame",
            Some("bias") => "Bias Frame",
            Some("flat" | "flat field") => "Flat Field",
            Some("light") => "Light Frame",
            // A camera that knows no types takes what the plan asks for all the same.
            _ => match target.map(|target| target.target_kind) {
                Some(TargetKind::Dark) => "Dark Frame",
                Some(TargetKind::Bias) => "Bias Frame",
                Some(TargetKind::Flat) => "Flat Field",
                _ => "Light Frame",
            },
        };
        header.set("IMAGETYP", kind, "");
        let Some(target) = target else { return };
        header.set("OBJECT", target.name.as_str(), "target, as planned");
        let kind = serde_json::to_value(target.target_kind).ok();
        let kind = kind.as_ref().and_then(|kind| kind.as_str()).unwrap_or("none").to_owned();
        header.set("OBJTYPE", kind, "star, satellite, sky, dark, bias, flat or none");
        let Some([azimuth, altitude, ra, dec]) = self.place(target, utc) else { return };
        let header = &mut frame.header;
        header.set("RADESYS", "ICRS", "axes of RA and DEC");
        for (keyword, value, comment) in [
            ("RA", ra, "deg, ICRS: the target's astrometric place"),
            ("DEC", dec, "deg, at the middle of the exposure, from the plan"),
            ("CENTAZ", azimuth, "deg, from north by east"),
            ("CENTALT", altitude, "deg, true (unrefracted)"),
        ] {
            header.set(keyword, value, comment);
        }
        if let Some(airmass) = airmass(altitude) {
            header.set("AIRMASS", airmass, "Kasten and Young 1989");
        }
    }

    /// Azimuth and true altitude of a target at a time; `None` for one without a place.
    pub fn horizontal_deg(&mut self, target: &Target, utc: Epoch) -> Option<AzimuthAltitude> {
        self.place(target, utc).map(|[azimuth, altitude, ..]| [azimuth, altitude].into())
    }

    /// Where a satellite, the Sun and the station stand; `None` for a target that is no satellite, or without a place then.
    pub fn geometry(&mut self, target: &Target, utc: Epoch) -> Option<Geometry> {
        let observer = Observer::at(utc, &self.station.site, EarthOrientation::embedded()).ok()?;
        let Body::Orbit(orbit) = self.body(target)? else { return None };
        Geometry::at(orbit, &observer).ok()
    }

    /// Whether the Sun shines on a satellite at a time: on more than half of its disc. `None` for a target that is no satellite.
    pub fn is_lit(&mut self, target: &Target, utc: Epoch) -> Option<bool> {
        Some(self.geometry(target, utc)?.sunlit >= 0.5)
    }

    fn body(&mut self, target: &Target) -> Option<&Body> {
        if self.known.as_ref().is_none_or(|(known, _)| known != target) {
            self.known = Some((target.clone(), Body::of(target)));
        }
        self.known.as_ref()?.1.as_ref()
    }

    /// Azimuth, altitude, right ascension and declination (ICRS, without aberration), deg.
    fn place(&mut self, target: &Target, utc: Epoch) -> Option<[f64; 4]> {
        let earth = EarthOrientation::embedded();
        let observer = Observer::at(utc, &self.station.site, earth).ok()?;
        let body = self.body(target)?;
        let (horizontal, equatorial) = match body {
            Body::Star(star) => {
                let horizontal = observer.star(star).horizontal;
                let (ra_deg, dec_deg) = (target.ra_deg?, target.dec_deg?);
                (horizontal, Equatorial { ra_deg, dec_deg })
            }
            Body::Orbit(orbit) => {
                let state = orbit.state(utc, observer.frame()).ok()?;
                let seen = observer.apparent(state.position_m, state.velocity_m_s).ok()?;
                // Back by the light time, without the site's aberration.
                let back = seen.range_m / LIGHT_M_PER_S;
                let then = state.position_m - state.velocity_m_s * back;
                let line = (then - observer.position_gcrs_m()).normalize();
                (seen.horizontal, Equatorial::of_direction(line))
            }
        };
        let Equatorial { ra_deg, dec_deg } = equatorial;
        Some([horizontal.azimuth_deg(), horizontal.altitude_deg(), ra_deg, dec_deg])
    }
}

/// Airmass by the formula of Kasten and Young (1989, Applied Optics 28, 4735) for a true altitude, deg; refraction is left out, which errs by 0.3 % at 5°.
/// `None` below the horizon.
pub(crate) fn airmass(altitude_deg: f64) -> Option<f64> {
    let sine = altitude_deg.to_radians().sin();
    (altitude_deg > 0.0).then(|| 1.0 / (sine + 0.505_72 * (altitude_deg + 6.079_95).powf(-1.636_4)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera that knows no types, and one that says its own. Truth: the plan's kinds, and the names that FITS files have for them (SBFITSEXT); a driver's word comes first.
    #[test]
    fn a_frames_type_is_the_drivers_or_the_plans() {
        let station = Station::built_in("ufo").unwrap().unwrap();
        let mut pointing = Pointing::new(station);
        let utc = sunglint_formats::time::parse_utc("2026-11-21T18:00:00Z").unwrap();
        let mut of = |kind, told: Option<&str>, said: Option<&str>| {
            let mut frame = Frame {
                pixels: ndarray::Array2::zeros((2, 2)),
                origin: [0, 0],
                binning: [1, 1],
                bayer: None,
                start: utc,
                exposure_s: 1.0,
                gain_e_per_adu: None,
                temperature_c: None,
                saturation_adu: None,
                header: sunglint_formats::fits::Header::default(),
            };
            if let Some(said) = said {
                frame.header.set("FRAME", said, "");
            }
            pointing.describe(Some(&Target::off(kind)), utc, told, &mut frame);
            frame.header.text("IMAGETYP").unwrap().to_owned()
        };
        for (kind, expected) in [
            (TargetKind::Sky, "Light Frame"),
            (TargetKind::Dark, "Dark Frame"),
            (TargetKind::Bias, "Bias Frame"),
            (TargetKind::Flat, "Flat Field"),
        ] {
            assert_eq!(of(kind, None, None), expected);
        }
        assert_eq!(of(TargetKind::Bias, Some("bias"), Some("Light")), "Light Frame");
        assert_eq!(of(TargetKind::Sky, Some("dark"), None), "Dark Frame");
    }

    /// Truth: the published formula, worked out by hand with logarithms to five figures.
    #[test]
    fn airmass_is_that_of_the_formula() {
        for (altitude_deg, expected) in
            [(90.0, 0.9997), (30.0, 1.9943), (10.0, 5.5860), (5.0, 10.3058)]
        {
            let found = airmass(altitude_deg).unwrap();
            assert!((found / expected - 1.0).abs() < 1e-4, "{altitude_deg}: {found}");
        }
        assert_eq!(airmass(-0.1), None);
    }
}
