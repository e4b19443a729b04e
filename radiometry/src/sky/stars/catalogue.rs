//! Stars by name, designation or number.

use super::designation::{Number, as_the_table_spells, catalogue_number};
use super::{Equatorial, Star};
use crate::sky::separation_deg;
use crate::tables;
use std::sync::OnceLock;
use sunglint_formats::{Table, TableError, nearest_names};

/// Error in a request for a star.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StarError {
    /// No star is called that.
    #[error("no star is called `{asked}`{}. {HOW_TO_NAME}", did_you_mean(nearest))]
    Unknown {
        /// Requested star.
        asked: String,
        /// The nearest names, best first.
        nearest: Vec<String>,
    },
    /// A body of the solar system.
    #[error(
        "`{asked}` is no star but a body of the solar system, which moves among the stars, and there are no targets of that kind: give the place \
         where it stands in that hour (right ascension and declination, ICRS, J2000)"
    )]
    OfTheSolarSystem {
        /// Requested body.
        asked: String,
    },
    /// The number is not in the catalogue.
    #[error(
        "{asked} is not among the {stars} stars of the catalogue, which ends at V = {faintest_mag}: give its place by \
         hand (right ascension and declination, ICRS, J2000){}",
        did_you_mean(nearest)
    )]
    NotInCatalogue {
        /// The number, as `HIP 1`.
        asked: String,
        /// How many stars there are.
        stars: usize,
        /// V of the faintest.
        faintest_mag: f64,
        /// The nearest designations, best first.
        nearest: Vec<String>,
    },
    /// A number without its catalogue.
    #[error("`{asked}` is only a number: write `HIP {asked}` or `HD {asked}`")]
    BareNumber {
        /// The number.
        asked: String,
    },
    /// More than one star is called that.
    #[error("`{asked}` may mean {}: write one of these", candidates.join(" or "))]
    Ambiguous {
        /// Requested star.
        asked: String,
        /// Unambiguous names of the candidates, brightest first.
        candidates: Vec<String>,
    },
    /// No star of that name stands at the place that was given with it.
    #[error(
        "the place given for `{asked}`, right ascension {:.4}°, declination {:.4}°, is {off_deg:.2}° from the catalogue's {:.4}°, {:.4}°: mend the name or the \
         place, or give a star of that place another name",
        place.ra_deg, place.dec_deg, catalogue.ra_deg, catalogue.dec_deg
    )]
    Elsewhere {
        /// Requested star.
        asked: String,
        /// Where.
        place: Equatorial,
        /// Where the nearest star of that name stands.
        catalogue: Equatorial,
        /// The angle between them.
        off_deg: f64,
    },
    /// A place that is not on the sky.
    #[error(
        "{name}: right ascension {ra_deg}°, declination {dec_deg}° is no place on the sky (expected −180° to \
         360° and −90° to 90°)"
    )]
    ImpossiblePlace {
        /// The star's name.
        name: String,
        /// The right ascension.
        ra_deg: f64,
        /// The declination.
        dec_deg: f64,
    },
}

/// How far a star's given place may be from the catalogue's: more than precession over a century, proper motion and rounding, less than from any other of its name.
const NEAR_DEG: f64 = 2.0;

const HOW_TO_NAME: &str = "Names are read as `Vega`, `alp Lyr`, `alpha Lyr`, `α Lyr`, `HIP 91262` or `HD 172167`; \
                           a star that is not in the catalogue can be given by its place (ICRS, J2000)";

fn did_you_mean(nearest: &[String]) -> String {
    if nearest.is_empty() { String::new() } else { format!("; nearest: {}", nearest.join(", ")) }
}

/// Bodies that people ask for as if they were stars.
const SOLAR_SYSTEM: [&str; 13] = [
    "Sun", "Mercury", "Venus", "Earth", "Moon", "Mars", "Jupiter", "Saturn", "Uranus", "Neptune",
    "Pluto", "Ceres", "Vesta",
];

/// Names of the IAU's list (Working Group on Star Names, 2016 to 2018) that the table gives to several stars or spells otherwise, in lower case, with the Hipparcos number of the star that the
/// list gives each to.
const IAU: [(&str, i64); 15] = [
    ("alnair", 109_268),
    ("angetenar", 13_288),
    ("atik", 17_448),
    ("beemim", 20_535),
    ("castula", 4422),
    ("fawaris", 97_165),
    ("markab", 113_963),
    ("markeb", 45_941),
    ("menkar", 14_135),
    ("nembus", 7607),
    ("propus", 29_655),
    ("schedar", 3179),
    ("tarazed", 97_278),
    ("terebellum", 98_066),
    ("ukdah", 47_431),
];

/// The Hipparcos number of the star to which the IAU's list gives a name; `None` for names that need no such word.
fn by_the_iau(name: &str) -> Option<i64> {
    let name = name.trim().to_lowercase();
    IAU.iter().find(|(known, _)| *known == name).map(|(_, hip)| *hip)
}

/// Stars that can be found by name.
#[derive(Debug, Clone, PartialEq)]
pub struct Catalogue {
    stars: Vec<Star>,
}

impl Catalogue {
    /// The stars that the program carries: 1627 to V = 5.0 (the table `bright_stars`).
    pub fn embedded() -> &'static Self {
        static EMBEDDED: OnceLock<Catalogue> = OnceLock::new();
        EMBEDDED.get_or_init(|| {
            // A test builds it, so this cannot fail in a program that passed it.
            #[expect(clippy::unwrap_used, reason = "embedded table, built by a test")]
            Self::from_table(tables::BRIGHT_STARS.table()).unwrap()
        })
    }

    /// From a table with the columns of `bright_stars` (see the embedded one), places ICRS at epoch J2000.0.
    ///
    /// # Errors
    /// A column that is not there or holds something else.
    pub fn from_table(table: &Table) -> Result<Self, TableError> {
        let number = |column: &str| {
            let values = table.f64(column)?;
            Ok::<_, TableError>(move |row: usize| Some(values[row]).filter(|v| v.is_finite()))
        };
        let text = |column: &str| {
            let values = table.text(column)?;
            let known = |t: &&String| !t.is_empty() && *t != "--";
            Ok::<_, TableError>(move |row: usize| values[row].as_ref().filter(known).cloned())
        };
        let (hip, hd) = (table.i64("hip")?, table.i64("hd")?);
        let (ra_deg, dec_deg) = (table.f64("ra_deg")?, table.f64("dec_deg")?);
        let (pm_ra, pm_dec) = (number("pm_ra_mas_yr")?, number("pm_dec_mas_yr")?);
        let parallax = number("parallax_mas")?;
        let (v, bv, ub) = (number("v")?, number("bv")?, number("ub")?);
        let (name, bayer) = (text("name")?, text("bayer")?);
        let (spectral_type, object_type) = (text("spectral_type")?, text("object_type")?);
        let stars = (0..table.rows())
            .map(|row| Star {
                name: name(row),
                bayer: bayer(row),
                hip: hip[row],
                hd: hd[row],
                icrs: Equatorial { ra_deg: ra_deg[row], dec_deg: dec_deg[row] },
                epoch_year: 2000.0,
                pm_ra_mas_yr: pm_ra(row),
                pm_dec_mas_yr: pm_dec(row),
                parallax_mas: parallax(row),
                v_mag: v(row),
                bv_mag: bv(row),
                ub_mag: ub(row),
                spectral_type: spectral_type(row),
                object_type: object_type(row),
            })
            .collect();
        Ok(Self { stars })
    }

    /// All stars, in the order of the table (brightest first in the embedded one).
    pub fn stars(&self) -> &[Star] {
        &self.stars
    }

    /// The star of that name. Read in this order, blanks at the ends ignored:
    ///
    /// 1. `HIP 91262`, `HIP91262`, `hip:91262` and `HD 172167`: by number;
    /// 2. a proper name, case ignored: `Vega`, `rigil kentaurus`; where the table gives it to several stars, the one to which the IAU's list gives it (`Menkar` is α Cet);
    /// 3. a designation as the table spells it: `alp Lyr`, also `alpha Lyr` and `α Lyr`, with an index `alp1 Cen`,
    ///    `α² Cen`. Case decides only where it must: `A Cen` and `a Cen` are two stars, `nu Pav` and `NU Pav` too;
    /// 4. a Greek letter without its index (`gamma Vel`), where only one star carries the letter in that constellation.
    ///
    /// # Errors
    /// [`StarError::Unknown`] with the nearest names, [`StarError::NotInCatalogue`] for a number that the catalogue
    /// does not hold, [`StarError::Ambiguous`] for a name that several stars carry and the IAU's list does not decide (`Grafias`),
    /// [`StarError::BareNumber`] for a number alone.
    pub fn find(&self, asked: &str) -> Result<&Star, StarError> {
        match self.called(asked)?[..] {
            [star] => Ok(star),
            ref several => {
                let number = by_the_iau(asked);
                let meant = several.iter().find(|star| number.is_some() && star.hip == number);
                meant.copied().ok_or_else(|| ambiguous(asked.trim(), several))
            }
        }
    }

    /// The star of that name that stands where it should: where several carry the name, the place decides, to 2 degrees. What is
    /// recorded of a star with its place is found again, whatever it was called.
    ///
    /// # Errors
    /// The errors of [`Self::find`]; [`StarError::Elsewhere`] where no star of that name stands there.
    pub fn find_at(&self, asked: &str, place: Equatorial) -> Result<&Star, StarError> {
        let called = self.called(asked)?;
        let off_deg = |star: &Star| separation_deg(star.icrs.direction(), place.direction());
        let asked = asked.trim().to_owned();
        match called.into_iter().min_by(|a, b| off_deg(a).total_cmp(&off_deg(b))) {
            Some(star) if off_deg(star) <= NEAR_DEG => Ok(star),
            Some(star) => {
                let (catalogue, off_deg) = (star.icrs, off_deg(star));
                Err(StarError::Elsewhere { asked, place, catalogue, off_deg })
            }
            None => Err(StarError::Unknown { asked, nearest: Vec::new() }),
        }
    }

    /// All stars that a name may mean, at least one.
    fn called(&self, asked: &str) -> Result<Vec<&Star>, StarError> {
        let asked = asked.trim();
        if !asked.is_empty() && asked.bytes().all(|b| b.is_ascii_digit()) {
            return Err(StarError::BareNumber { asked: asked.to_owned() });
        }
        if let Some(number) = catalogue_number(asked) {
            return self.by_number(number).map(|star| vec![star]);
        }
        let plain = asked.split_whitespace().collect::<Vec<_>>().join(" ");
        let lower = plain.to_lowercase();
        let spelled = as_the_table_spells(&plain);
        let spelled_lower = spelled.to_lowercase();
        let rounds: [&dyn Fn(&Star) -> bool; 5] = [
            &|s| s.name.as_ref().is_some_and(|n| n.to_lowercase() == lower),
            // `NU Pav` is a variable star, not a nu: what is spelled as in the table stays what it is.
            &|s| s.bayer.as_ref() == Some(&plain),
            &|s| s.bayer.as_ref() == Some(&spelled),
            &|s| s.bayer.as_ref().is_some_and(|b| b.to_lowercase() == spelled_lower),
            &|s| s.bayer.as_deref().and_then(without_index).as_ref() == Some(&spelled_lower),
        ];
        for matches in rounds {
            let found: Vec<&Star> = self.stars.iter().filter(|s| matches(s)).collect();
            if !found.is_empty() {
                return Ok(found);
            }
        }
        // A name that the table spells otherwise (`Schedar`).
        let listed = by_the_iau(&plain);
        if let Some(star) = self.stars.iter().find(|s| listed.is_some() && s.hip == listed) {
            return Ok(vec![star]);
        }
        if SOLAR_SYSTEM.iter().any(|body| body.eq_ignore_ascii_case(asked.trim())) {
            return Err(StarError::OfTheSolarSystem { asked: asked.trim().to_owned() });
        }
        Err(StarError::Unknown { asked: asked.to_owned(), nearest: self.nearest(asked, &spelled) })
    }

    fn by_number(&self, number: Number) -> Result<&Star, StarError> {
        let (asked, found) = match number {
            Number::Hip(n) => (format!("HIP {n}"), self.stars.iter().find(|s| s.hip == Some(n))),
            Number::Hd(n) => (format!("HD {n}"), self.stars.iter().find(|s| s.hd == Some(n))),
        };
        found.ok_or_else(|| {
            let designations: Vec<String> = match number {
                Number::Hip(_) => {
                    self.stars.iter().filter_map(|s| s.hip).map(|n| format!("HIP {n}")).collect()
                }
                Number::Hd(_) => {
                    self.stars.iter().filter_map(|s| s.hd).map(|n| format!("HD {n}")).collect()
                }
            };
            let nearest = nearest_names(&asked, designations.iter().map(String::as_str), 3);
            StarError::NotInCatalogue {
                nearest: nearest.into_iter().map(str::to_owned).collect(),
                asked,
                stars: self.stars.len(),
                faintest_mag: self.stars.iter().filter_map(|s| s.v_mag).fold(f64::MIN, f64::max),
            }
        })
    }

    fn nearest(&self, asked: &str, spelled: &str) -> Vec<String> {
        let names = self.stars.iter().filter_map(|s| s.name.as_deref());
        let mut nearest = nearest_names(asked, names, 3);
        // Designations only for what looks like one: in single names they are noise.
        if spelled.contains(' ') {
            let designations = self.stars.iter().filter_map(|s| s.bayer.as_deref());
            nearest.splice(0..0, nearest_names(spelled, designations, 3));
            nearest.truncate(4);
        }
        nearest.dedup();
        nearest.into_iter().map(str::to_owned).collect()
    }
}

/// `gam2 Vel` without its index, in lower case; `None` for what has none or begins with a number.
fn without_index(bayer: &str) -> Option<String> {
    let (letter, constellation) = bayer.split_once(' ')?;
    let bare = letter.trim_end_matches(|c: char| c.is_ascii_digit());
    (bare.len() < letter.len() && !bare.is_empty())
        .then(|| format!("{bare} {constellation}").to_lowercase())
}

fn ambiguous(asked: &str, found: &[&Star]) -> StarError {
    let sure = |star: &&Star| {
        let number = star.hip.map(|n| format!("HIP {n}"));
        let v = star.v_mag.map(|v| format!(", V {v}")).unwrap_or_default();
        match (&star.bayer, number) {
            (Some(bayer), Some(number)) => format!("`{bayer}` ({number}{v})"),
            (Some(bayer), None) => format!("`{bayer}`{v}"),
            (None, Some(number)) => format!("`{number}`{v}"),
            (None, None) => format!("`{}`{v}", star.label()),
        }
    };
    StarError::Ambiguous { asked: asked.to_owned(), candidates: found.iter().map(sure).collect() }
}
