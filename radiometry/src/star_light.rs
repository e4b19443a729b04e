//! The absolute spectrum of a star from its magnitude, spectral type and colour.
//!
//! The rule, in order, and never silent:
//!
//! 0. **measured**: Vega, whose spectrum is CALSPEC's own ([`vega`]); every other star:
//! 1. **by type**: the library spectrum (Pickles 1998, 106 types) nearest in temperature and luminosity class. Nearest means the smallest
//!    Δ² = (Δ subclass)² + (2 Δ luminosity class)², of two equally near the hotter, then the more luminous; it must lie within 3
//!    subclasses and 1 luminosity class. Where a catalogue gives no luminosity class, a dwarf (V) is assumed down to F9 and a giant
//!    (III) beyond: so are most stars of the naked eye.
//! 2. **by colour** (flagged as a fallback): no type, or none near: the library's dwarf or giant with the nearest B−V, within 0.1 mag.
//! 3. **black body** (flagged as a fallback): T = 9000 K/((B−V)+0.93) ([`colour_temperature_k`]). Beside the library it errs in the red (600 to 1240 nm) by
//!    −15 to +50 % from F to K (in the middle +5 to +9 %), by +5 to +80 % for hotter stars and supergiants, and M stars are far too faint: it must never
//!    decide a calibration.
//!
//! The shape is scaled so that its magnitude in Johnson V is the star's.

use crate::light::{self, planck_w_m2_sr_nm};
use crate::passband::{Passband, PhotometryError, ZeroPoint};
use crate::spectral_type::SpectralType;
use crate::spectrum::{Irradiance, Quantity, Relative, Spectrum};
use crate::tables::STELLAR_LIBRARY;
use std::sync::LazyLock;

/// Hipparcos number of Vega, whose own spectrum is embedded.
pub const VEGA_HIP: i64 = 91262;

/// Properties of a star that its spectrum is made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarColours<'a> {
    /// Johnson V.
    pub v_mag: f64,
    /// B−V; `NaN` or `None` where not known.
    pub b_minus_v_mag: Option<f64>,
    /// MK type as the catalogue writes it.
    pub spectral_type: Option<&'a str>,
    /// Zero point of the catalogue's V.
    pub zero: ZeroPoint,
}

/// Where a star's spectrum came from.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Origin {
    /// The star's own measured spectrum (Vega: CALSPEC).
    Measured,
    /// The library spectrum nearest in type.
    Library {
        /// The library's type.
        library_type: &'static str,
        /// The star's type, its luminosity class filled in where it was not given.
        star_type: SpectralType,
        /// Whether the luminosity class was assumed.
        luminosity_assumed: bool,
    },
    /// Fallback: the library spectrum nearest in B−V.
    LibraryByColour {
        /// The library's type.
        library_type: &'static str,
        /// How much redder the star is, mag.
        redder_mag: f64,
    },
    /// Fallback: a black body of the colour's temperature.
    BlackBody {
        /// Temperature of the black body, K.
        temperature_k: f64,
    },
}

impl Origin {
    /// Whether the spectrum is a guess from the colour: never to decide a calibration.
    pub fn is_fallback(&self) -> bool {
        matches!(self, Origin::LibraryByColour { .. } | Origin::BlackBody { .. })
    }
}

impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Origin::Measured => f.write_str("measured (CALSPEC)"),
            Origin::Library { library_type, star_type, luminosity_assumed } => {
                write!(f, "library {library_type}")?;
                if star_type.to_string() != *library_type {
                    write!(f, " in place of {star_type}")?;
                }
                if *luminosity_assumed { write!(f, " (luminosity class assumed)") } else { Ok(()) }
            }
            Origin::LibraryByColour { library_type, redder_mag } => {
                let word = if *redder_mag < 0.0 { "bluer" } else { "redder" };
                write!(
                    f,
                    "FALLBACK: library {library_type} by colour, the star being {:.3} mag {word}",
                    redder_mag.abs()
                )
            }
            Origin::BlackBody { temperature_k } => {
                write!(
                    f,
                    "FALLBACK: black body of {temperature_k:.0} K (errs by tens of percent in the red)"
                )
            }
        }
    }
}

/// A star's light above the air.
#[derive(Debug, Clone, PartialEq)]
pub struct StarLight {
    /// Spectral irradiance, W m⁻² nm⁻¹, 300–1300 nm (Vega's own: 290–1260 nm).
    pub irradiance: Spectrum<Irradiance>,
    /// Where it came from.
    pub origin: Origin,
    /// The catalogue's B−V less the spectrum's, mag: reddening, or a wrong type. `None` without a catalogue's B−V.
    pub colour_excess_mag: Option<f64>,
}

/// Why a star has no spectrum.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StarLightError {
    /// Nothing to go by.
    #[error("no spectrum: the spectral type is {} and B-V is not known; give one of them", spectral_type.as_deref().unwrap_or("not known"))]
    NothingToGoBy {
        /// The type, if there is one that the library does not have.
        spectral_type: Option<String>,
    },
    /// A colour that no star has.
    #[error("B-V = {b_minus_v_mag} mag is no star's colour, expected {BLUEST} to {REDDEST} mag")]
    Colour {
        /// The colour.
        b_minus_v_mag: f64,
    },
    /// The photometry failed.
    #[error(transparent)]
    Photometry(#[from] PhotometryError),
}

/// The colours that stars have: the hottest, −0.33; carbon stars, reddened, up to 5.
const BLUEST: f64 = -0.6;
const REDDEST: f64 = 6.0;

/// Largest distance to the library in subclasses, in luminosity classes, and in B−V.
const NEAR: (f64, f64, f64) = (3.0, 1.0, 0.1);

struct Entry {
    name: &'static str,
    kind: SpectralType,
    shape: Spectrum<Relative>,
    b_minus_v_mag: f64,
}

static LIBRARY: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let read = || -> Result<Vec<Entry>, PhotometryError> {
        let table = STELLAR_LIBRARY.table();
        let mut entries = Vec::new();
        for column in table.columns.iter().skip(1) {
            let shape = Spectrum::<Relative>::from_table(table, "wavelength_nm", &column.name)?;
            let b_minus_v_mag = colour(&shape)?;
            if let Some(kind) = library_type(&column.name) {
                entries.push(Entry { name: &column.name, kind, shape, b_minus_v_mag });
            }
        }
        Ok(entries)
    };
    read().expect("embedded, and read by a test")
});

/// A passband, and the mean of Vega over it.
type Band = (Passband, f64);

/// Johnson B and V: every star needs them.
static BANDS: LazyLock<[Band; 2]> = LazyLock::new(|| {
    ["B", "V"].map(|name| {
        let band = Passband::named(name);
        let vega = band.as_ref().map_or(Ok(0.0), |band| band.mean(light::vega()));
        (band.expect("embedded, and read by a test"), vega.expect("embedded, and read by a test"))
    })
});

/// B−V with Vega 0 in both: the system of the catalogues but for a few thousandths.
fn colour<Q: Quantity>(shape: &Spectrum<Q>) -> Result<f64, PhotometryError> {
    let [(b, vega_b), (v, vega_v)] = &*BANDS;
    Ok(-2.5 * ((b.mean(shape)? / vega_b) / (v.mean(shape)? / vega_v)).log10())
}

/// The library's own names: two digits are a range of subclasses (`B57V` = B5–7, `F02IV` = F0–2).
fn library_type(name: &str) -> Option<SpectralType> {
    let digits: Vec<f64> = name.chars().filter_map(|c| c.to_digit(10)).map(f64::from).collect();
    let class = name.trim_start_matches(|c: char| !"IV".contains(c));
    let kind = SpectralType::parse(&format!("{}{}{class}", &name[..1], digits.first()?))?;
    let first = kind.temperature - digits[0];
    let mean = digits.iter().sum::<f64>() / digits.len() as f64;
    Some(SpectralType { temperature: first + mean, ..kind })
}

/// The light of a star, by the rule of this module. Errors: no type and no colour, a colour without a temperature.
pub fn of(star: StarColours) -> Result<StarLight, StarLightError> {
    let colour = sane_colour(star)?;
    let kind = star.spectral_type.and_then(SpectralType::parse);
    if let Some((entry, origin)) = kind.and_then(nearest_type) {
        return scaled(star, &entry.shape, origin);
    }
    let Some(bv) = colour else {
        let spectral_type = star.spectral_type.map(str::to_owned);
        return Err(StarLightError::NothingToGoBy { spectral_type });
    };
    match nearest_colour(bv) {
        Some((entry, origin)) => scaled(star, &entry.shape, origin),
        None => black_body(star),
    }
}

/// The star's B−V; `NaN` is a missing one.
fn sane_colour(star: StarColours) -> Result<Option<f64>, StarLightError> {
    match star.b_minus_v_mag.filter(|bv| !bv.is_nan()) {
        Some(bv) if !(BLUEST..=REDDEST).contains(&bv) => {
            Err(StarLightError::Colour { b_minus_v_mag: bv })
        }
        colour => Ok(colour),
    }
}

/// The light of Vega: its own measured spectrum, scaled to its magnitude.
pub fn vega(star: StarColours) -> Result<StarLight, StarLightError> {
    scaled(star, light::vega(), Origin::Measured)
}

/// Colour temperature of a star, K: 9000/((B−V)+0.93). Equation 4.19 of the thesis prints 7300/((B−V)+0.73), but the temperatures of its figure 4.11 (9677.42, 7826.09 and
/// 3797.47 K for B−V of 0, 0.22 and 1.44) are those of this law.
pub fn colour_temperature_k(b_minus_v_mag: f64) -> f64 {
    9000.0 / (b_minus_v_mag + 0.93)
}

/// The light of a star as a black body, where it is asked for.
pub fn black_body(star: StarColours) -> Result<StarLight, StarLightError> {
    let Some(bv) = sane_colour(star)? else {
        let spectral_type = star.spectral_type.map(str::to_owned);
        return Err(StarLightError::NothingToGoBy { spectral_type });
    };
    let temperature_k = colour_temperature_k(bv);
    let grid: Vec<f64> = (300..=1300).map(f64::from).collect();
    let value = grid.iter().map(|&nm| planck_w_m2_sr_nm(temperature_k, nm)).collect();
    let shape = Spectrum::<Relative>::new(grid, value).map_err(PhotometryError::from)?;
    scaled(star, &shape, Origin::BlackBody { temperature_k })
}

fn scaled<Q: Quantity>(
    star: StarColours,
    shape: &Spectrum<Q>,
    origin: Origin,
) -> Result<StarLight, StarLightError> {
    let [_, (v, _)] = &*BANDS;
    let irradiance = v.scaled_to(shape, star.v_mag, star.zero)?;
    let own = colour(shape)?;
    let colour_excess_mag = star.b_minus_v_mag.filter(|bv| bv.is_finite()).map(|bv| bv - own);
    Ok(StarLight { irradiance, origin, colour_excess_mag })
}

fn nearest_type(kind: SpectralType) -> Option<(&'static Entry, Origin)> {
    let assumed = kind.luminosity.is_none();
    let luminosity = kind.luminosity.unwrap_or(if kind.temperature < 40.0 { 5.0 } else { 3.0 });
    let difference = |entry: &Entry| {
        let class = entry.kind.luminosity.unwrap_or(5.0);
        (kind.temperature - entry.kind.temperature, luminosity - class)
    };
    LIBRARY
        .iter()
        .filter(|entry| {
            let (subclasses, classes) = difference(entry);
            subclasses.abs() <= NEAR.0 && classes.abs() <= NEAR.1
        })
        .min_by(|a, b| {
            let rank = |entry: &Entry| {
                let (subclasses, classes) = difference(entry);
                let square = subclasses * subclasses + 4.0 * classes * classes;
                // Differences of decimals that people write: equal is equal to a millionth.
                [
                    (square * 1e6).round(),
                    entry.kind.temperature,
                    entry.kind.luminosity.unwrap_or(5.0),
                ]
            };
            let (a, b) = (rank(a), rank(b));
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]))
        })
        .map(|entry| {
            let star_type = SpectralType { luminosity: Some(luminosity), ..kind };
            let origin = Origin::Library {
                library_type: entry.name,
                star_type,
                luminosity_assumed: assumed,
            };
            (entry, origin)
        })
}

fn nearest_colour(bv: f64) -> Option<(&'static Entry, Origin)> {
    LIBRARY
        .iter()
        .filter(|entry| matches!(entry.kind.luminosity, Some(3.0 | 5.0)))
        .min_by(|a, b| (a.b_minus_v_mag - bv).abs().total_cmp(&(b.b_minus_v_mag - bv).abs()))
        .filter(|entry| (entry.b_minus_v_mag - bv).abs() <= NEAR.2)
        .map(|entry| {
            let redder_mag = bv - entry.b_minus_v_mag;
            (entry, Origin::LibraryByColour { library_type: entry.name, redder_mag })
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::Product;

    fn star(v_mag: f64, bv: Option<f64>, kind: Option<&str>) -> StarLight {
        of(StarColours {
            v_mag,
            b_minus_v_mag: bv,
            spectral_type: kind,
            zero: ZeroPoint::default(),
        })
        .unwrap()
    }

    /// Truth: intrinsic Johnson colours of the types, A0V −0.02, G2V 0.65, K2III 1.16 (Fitzgerald 1970; Pecaut and Mamajek 2013 for dwarfs). Tolerance 0.05: the
    /// library's own scatter.
    #[test]
    fn colours_of_the_library() {
        for (kind, expected) in [("A0V", -0.02), ("G2V", 0.65), ("K2III", 1.16)] {
            let found = colour(&star(5.0, None, Some(kind)).irradiance).unwrap();
            assert!((found - expected).abs() < 0.05, "{kind}: {found}");
        }
    }

    #[test]
    fn the_whole_library_is_named_and_found_by_its_own_types() {
        assert_eq!(LIBRARY.len(), 106);
        for entry in LIBRARY.iter() {
            let (found, origin) = nearest_type(entry.kind).unwrap();
            assert_eq!(found.name, entry.name);
            assert!(!origin.is_fallback());
        }
    }

    /// Truth: Vega's own spectrum (CALSPEC) against the A0V of the library at V = 0.03: 4 % from 420 to 700 nm (the library's A0V is
    /// 0.03 mag redder in B−V than Vega; its
    /// Balmer lines and jump are those of its own rotation and gravity).
    #[test]
    fn an_a0v_star_of_vegas_magnitude_is_vega() {
        let found = star(0.03, Some(0.0), Some("A0Va"));
        for nm in [420.0, 450.0, 500.0, 550.0, 600.0, 640.0, 700.0] {
            let edges = [nm - 10.0, nm + 10.0];
            let ratio = found.irradiance.bin_means(&edges).unwrap()[0]
                / light::vega().bin_means(&edges).unwrap()[0];
            assert!((ratio - 1.0).abs() < 0.04, "{nm}: {ratio}");
        }
        assert!(found.colour_excess_mag.unwrap().abs() < 0.05);
    }

    /// Truth: figure 4.11 of the thesis, its digits.
    #[test]
    fn colour_temperatures_are_those_of_the_published_figure() {
        for (bv, published_k) in [(0.0, 9677.42), (0.22, 7826.09), (1.44, 3797.47)] {
            let found = colour_temperature_k(bv);
            assert!((found - published_k).abs() < 0.005, "{bv}: {found}");
        }
    }

    /// Truth: the table of photon ratios black body / library, worked out apart from this code with the same tables by numpy (trapezia of 0.05 nm, colours by Johnson's bands with Vega 0; red bands
    /// only: they are the point).
    #[test]
    fn how_wrong_the_black_body_is() {
        let rows = [
            ("B3V", 1.153, 1.203, 1.251, 1.395),
            ("A0V", 1.153, 1.204, 1.176, 1.223),
            ("G2V", 1.044, 1.049, 1.028, 0.998),
            ("K2III", 1.022, 1.062, 1.114, 1.004),
            ("G5I", 1.124, 1.300, 1.579, 1.635),
        ];
        for (kind, a, b, c, d) in rows {
            let library = star(5.0, None, Some(kind)).irradiance;
            let bv = colour(&library).unwrap();
            let colours = StarColours {
                v_mag: 5.0,
                b_minus_v_mag: Some(bv),
                spectral_type: None,
                zero: ZeroPoint::default(),
            };
            let body = black_body(colours).unwrap().irradiance;
            for (edges, expected) in [
                ((600.0, 700.0), a),
                ((700.0, 800.0), b),
                ((900.0, 1000.0), c),
                ((1100.0, 1240.0), d),
            ] {
                let photons = |s: &Spectrum<Irradiance>| {
                    Product::of(s).times_wavelength().over(edges.0, edges.1).unwrap().value
                };
                let ratio = photons(&body) / photons(&library);
                // The table's three decimals.
                assert!(
                    (ratio / expected - 1.0).abs() < 1e-3,
                    "{kind} {edges:?}: {ratio} {expected}"
                );
            }
        }
    }

    /// Truth: the embedded spectrum is Vega's at V = 0.03 by the default zero point, so nothing is scaled.
    #[test]
    fn vega_is_its_own_spectrum() {
        let colours = StarColours {
            v_mag: 0.03,
            b_minus_v_mag: Some(-0.001),
            spectral_type: Some("A0V"),
            zero: ZeroPoint::default(),
        };
        let found = vega(colours).unwrap();
        assert!((found.irradiance.at(555.5) / light::vega().at(555.5) - 1.0).abs() < 1e-12);
        assert!(found.colour_excess_mag.unwrap().abs() < 0.002 && !found.origin.is_fallback());
    }

    /// The documented rule where two are equally near: the hotter, then the more luminous.
    #[test]
    fn of_two_equally_near_types_the_hotter_then_the_more_luminous() {
        for (kind, expected) in [
            ("F9V", "F8V"),
            ("A1V", "A0V"),
            ("M2.5V", "M2V"),
            ("G2Ib-II", "G2I"),
            ("K0IV-V", "K0IV"),
            ("B2IV-V", "B2IV"),
        ] {
            let Origin::Library { library_type, .. } = star(5.0, None, Some(kind)).origin else {
                panic!()
            };
            assert_eq!(library_type, expected, "{kind}");
        }
        assert_eq!(
            star(5.0, None, Some("B0.2V")).origin.to_string(),
            "library B0V in place of B0.2V"
        );
    }

    #[test]
    fn fallbacks_are_flagged() {
        let deneb = star(1.25, Some(0.092), None);
        assert!(matches!(deneb.origin, Origin::LibraryByColour { .. }), "{}", deneb.origin);
        assert!(deneb.origin.is_fallback());
        let carbon = star(4.8, Some(2.9), Some("C"));
        assert!(matches!(carbon.origin, Origin::BlackBody { .. }));
        assert!(carbon.origin.to_string().starts_with("FALLBACK"));
        assert!(
            deneb.origin.to_string().contains("by colour, the star being 0.0"),
            "{}",
            deneb.origin
        );
        let assumed = star(4.0, Some(1.0), Some("K0"));
        assert!(matches!(
            assumed.origin,
            Origin::Library { library_type: "K0III", luminosity_assumed: true, .. }
        ));
        let near = star(4.0, None, Some("G9IIIb"));
        assert_eq!(near.origin.to_string(), "library G8III in place of G9III");
    }

    #[test]
    fn without_type_and_colour_there_is_no_light() {
        let colours = StarColours {
            v_mag: 4.0,
            b_minus_v_mag: None,
            spectral_type: Some("C"),
            zero: ZeroPoint::default(),
        };
        assert!(
            of(colours)
                .unwrap_err()
                .to_string()
                .contains("spectral type is C and B-V is not known")
        );
        let hot = StarColours {
            v_mag: 4.0,
            b_minus_v_mag: Some(-0.8),
            spectral_type: None,
            zero: ZeroPoint::default(),
        };
        assert!(matches!(of(hot), Err(StarLightError::Colour { .. })));
        let endless = StarColours { b_minus_v_mag: Some(f64::INFINITY), ..hot };
        assert!(matches!(of(endless), Err(StarLightError::Colour { .. })));
        let nan = StarColours {
            v_mag: f64::NAN,
            b_minus_v_mag: Some(f64::NAN),
            spectral_type: Some("A0V"),
            zero: ZeroPoint::default(),
        };
        assert!(matches!(
            of(nan),
            Err(StarLightError::Photometry(PhotometryError::Magnitude { .. }))
        ));
        let absurd = StarColours { v_mag: -800.0, ..nan };
        assert_eq!(
            of(absurd).unwrap_err().to_string(),
            "a magnitude of -800 makes no sense, expected -100 to 100"
        );
    }
}
