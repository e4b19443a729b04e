//! The bright stars by name, and where a star stands.

mod catalogue;
mod constellations;
mod designation;

pub use catalogue::{Catalogue, StarError};

use super::angles::{Equatorial, Horizontal};
use super::frame::Observer;
use glam::DVec3;
use sofars::consts::DMAS2R;
use std::fmt;

/// A star: place, motion, brightness and type, as far as they are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Star {
    /// Proper name (`Vega`), or what the caller calls it.
    pub name: Option<String>,
    /// Bayer, Flamsteed or other designation, as the table spells it (`alp Lyr`, `15 Mon`, `GJ442A`).
    pub bayer: Option<String>,
    /// Number in the Hipparcos catalogue.
    pub hip: Option<i64>,
    /// Number in the Henry Draper catalogue.
    pub hd: Option<i64>,
    /// ICRS place at `epoch_year`.
    pub icrs: Equatorial,
    /// The epoch of the place, Julian year (2000.0 in the catalogue).
    pub epoch_year: f64,
    /// Proper motion in right ascension times cos(declination), mas per year.
    pub pm_ra_mas_yr: Option<f64>,
    /// Proper motion in declination, mas per year.
    pub pm_dec_mas_yr: Option<f64>,
    /// Parallax, mas.
    pub parallax_mas: Option<f64>,
    /// Johnson V, mag.
    pub v_mag: Option<f64>,
    /// B−V, mag.
    pub bv_mag: Option<f64>,
    /// U−B, mag.
    pub ub_mag: Option<f64>,
    /// Spectral type (`A0V`).
    pub spectral_type: Option<String>,
    /// SIMBAD's main object type (`dS*`).
    pub object_type: Option<String>,
}

/// Note on a star that a calibrator should know before trusting it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum StarNote {
    /// Light that varies; the table does not say by how much (Vega's millimagnitudes count too).
    Variable,
    /// It is eclipsed by a companion.
    Eclipsing,
    /// A double or multiple star: the companion may be in the beam, and the magnitude may be of both.
    Double,
    /// Two spectra in one.
    SpectroscopicBinary,
    /// The catalogue gives no object type: it may be any of these.
    UnknownType,
    /// No proper motion: the place is that of its epoch, rounded to 1e-4° (0.3″), and where it went since is unknown. In the
    /// embedded table these are stars beyond 300 pc, where 30 km/s is 0.02″ a year.
    NoProperMotion,
    /// No parallax: it is taken as infinitely far, which errs by its parallax (mostly below 0.004″ in the embedded table).
    NoParallax,
}

impl fmt::Display for StarNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Variable => "variable",
            Self::Eclipsing => "eclipsing binary",
            Self::Double => "double star",
            Self::SpectroscopicBinary => "spectroscopic binary",
            Self::UnknownType => "object type unknown",
            Self::NoProperMotion => {
                "no proper motion known: not moved since the epoch of its place"
            }
            Self::NoParallax => "no parallax known",
        })
    }
}

/// Where a star stands for an observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarPlace {
    /// The direction at the site, true (unrefracted).
    pub horizontal: Horizontal,
    /// Hour angle, degrees in (−180, 180], positive in the west.
    pub hour_angle_deg: f64,
    /// Apparent right ascension and declination, true equator and equinox of date, from the site.
    pub of_date: Equatorial,
    /// The apparent direction from the site, GCRS axes, unit vector.
    pub direction_gcrs: DVec3,
}

impl Star {
    /// A star that no table holds, at an ICRS place of epoch J2000.0. Proper motion, parallax and the rest can be set on
    /// the fields; without them it stands still at infinity.
    ///
    /// # Errors
    /// [`StarError::ImpossiblePlace`] for a right ascension outside −180° to 360° or a declination outside ±90°.
    pub fn at(name: impl Into<String>, icrs: Equatorial) -> Result<Self, StarError> {
        let name = name.into();
        let Equatorial { ra_deg, dec_deg } = icrs;
        if !(-180.0..=360.0).contains(&ra_deg) || !(-90.0..=90.0).contains(&dec_deg) {
            return Err(StarError::ImpossiblePlace { name, ra_deg, dec_deg });
        }
        Ok(Self {
            name: Some(name),
            bayer: None,
            hip: None,
            hd: None,
            icrs,
            epoch_year: 2000.0,
            pm_ra_mas_yr: None,
            pm_dec_mas_yr: None,
            parallax_mas: None,
            v_mag: None,
            bv_mag: None,
            ub_mag: None,
            spectral_type: None,
            object_type: None,
        })
    }

    /// The shortest sure name: `Vega`, else `eps Ind`, else `HIP 108870`.
    pub fn label(&self) -> String {
        let number = |catalogue: &str, n: Option<i64>| n.map(|n| format!("{catalogue} {n}"));
        self.name
            .clone()
            .or_else(|| self.bayer.clone())
            .or_else(|| number("HIP", self.hip))
            .or_else(|| number("HD", self.hd))
            .unwrap_or_else(|| format!("{:.4}° {:+.4}°", self.icrs.ra_deg, self.icrs.dec_deg))
    }

    /// Returns the notes that a calibrator should know, from SIMBAD's object type and from what is missing.
    pub fn notes(&self) -> Vec<StarNote> {
        let mut notes = designation::notes_of_type(self.object_type.as_deref());
        if self.pm_ra_mas_yr.is_none() || self.pm_dec_mas_yr.is_none() {
            notes.push(StarNote::NoProperMotion);
        }
        if self.parallax_mas.is_none() {
            notes.push(StarNote::NoParallax);
        }
        notes
    }
}

impl fmt::Display for Star {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.label())?;
        if let Some(hip) = self.hip
            && (self.name.is_some() || self.bayer.is_some())
        {
            write!(f, " (HIP {hip})")?;
        }
        Ok(())
    }
}

impl Observer {
    /// Where a star stands: space motion since its epoch, parallax, light deflection by the Sun, annual and diurnal
    /// aberration (SOFA `pmpx`, `ldsun`, `ab`, as `atciq` chains them), then precession, nutation, Earth rotation and polar
    /// motion as one matrix. Radial velocity is taken as 0: for α Centauri that is 0.04″ by 2026, for all others of the
    /// table less.
    pub fn star(&self, star: &Star) -> StarPlace {
        let direction_gcrs = self.star_direction_gcrs(star);
        let horizontal = self.of_unit(direction_gcrs);
        let of_cio = Equatorial::of_direction(self.frame().gcrs_to_cirs() * direction_gcrs);
        let origins_deg = self.frame().equation_of_origins_rad().to_degrees();
        StarPlace {
            horizontal,
            hour_angle_deg: horizontal.hour_angle_deg(self.site().geodetic().latitude_deg),
            of_date: Equatorial {
                ra_deg: (of_cio.ra_deg - origins_deg).rem_euclid(360.0),
                dec_deg: of_cio.dec_deg,
            },
            direction_gcrs,
        }
    }

    /// The apparent direction of a star from the site, GCRS axes, unit vector: the part of [`Observer::star`] before
    /// the horizon.
    pub fn star_direction_gcrs(&self, star: &Star) -> DVec3 {
        let (ra, dec) = (star.icrs.ra_deg.to_radians(), star.icrs.dec_deg.to_radians());
        let context = &self.astrometry;
        let coordinate = sofars::astro::pmpx(
            ra,
            dec,
            // SOFA wants the rate of the coordinate itself.
            star.pm_ra_mas_yr.unwrap_or(0.0) * DMAS2R / dec.cos(),
            star.pm_dec_mas_yr.unwrap_or(0.0) * DMAS2R,
            star.parallax_mas.unwrap_or(0.0) / 1000.0,
            0.0,
            context.pmt - (star.epoch_year - 2000.0),
            context.eb,
        );
        let natural = sofars::astro::ldsun(coordinate, context.eh, context.em);
        let proper = sofars::astro::ab(&natural, &context.v, context.em, context.bm1);
        DVec3::from_array(proper)
    }
}
