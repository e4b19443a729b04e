//! A list of stars with magnitudes, as a user gets it from a catalogue's server: CSV, ECSV, VOTable or a FITS table.

use serde::Serialize;
use std::path::{Path, PathBuf};
use sunglint_formats::error::FileError;
use sunglint_formats::image_frame::sexagesimal;
use sunglint_formats::photometry::{Source, open};
use sunglint_formats::wcs::Equatorial;
use sunglint_formats::{Column, ParseError, Table, Values};

/// Names of columns of right ascensions, the usual first.
const RA: [&str; 8] =
    ["ra", "raj2000", "ra_icrs", "_raj2000", "ra_deg", "_ra_icrs", "_ra", "right_ascension"];
/// Names of columns of declinations.
const DEC: [&str; 9] = [
    "dec",
    "dej2000",
    "de_icrs",
    "_dej2000",
    "dec_deg",
    "_de_icrs",
    "decj2000",
    "de",
    "declination",
];
const PM_RA: [&str; 5] = ["pmra", "pm_ra", "pmra_cosdec", "pm_ra_cosdec", "pm_ra_mas_yr"];
const PM_DEC: [&str; 5] = ["pmdec", "pmde", "pm_dec", "pm_de", "pm_dec_mas_yr"];
const EPOCH: [&str; 3] = ["ref_epoch", "epoch", "epra-1900"];
/// Columns that tell which stars are bright, whatever the band, the usual first.
const BRIGHTNESS: [&str; 14] = [
    "phot_g_mean_mag",
    "gmag",
    "vmag",
    "v",
    "v_mag",
    "hpmag",
    "hp",
    "vtmag",
    "vt",
    "rmag",
    "r_mag",
    "phot_rp_mean_mag",
    "mag",
    "magnitude",
];
/// Rows that are read at most.
const MOST_ROWS: usize = 5_000_000;

/// System of magnitudes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum System {
    /// Vega has 0 in all bands (0.03 in V).
    Vega,
    /// The same flux for each frequency has the same magnitude.
    AB,
}

/// A band that is known: the letters that its filters have, its columns, its colour.
struct Band {
    /// The filter in lower case without the maker's words; one of an upper case letter in single letters.
    filters: &'static [&'static str],
    system: System,
    columns: &'static [&'static str],
    /// The colour's name, both columns' names, and the Sun's value.
    colour: (&'static [&'static str], &'static [&'static str], f64),
}

const B: &[&str] = &["Bmag", "B", "B_mag", "mag_B", "Johnson_B", "bj"];
const V: &[&str] = &["Vmag", "V", "V_mag", "mag_V", "Johnson_V", "vj"];
const R: &[&str] = &["Rmag", "R", "R_mag", "mag_R", "Rc", "Cousins_R", "Rcmag"];
const I: &[&str] = &["Imag", "I", "I_mag", "mag_I", "Ic", "Cousins_I", "Icmag"];
const SLOAN_G: &[&str] =
    &["gmag", "g'mag", "g", "g_mag", "gMeanPSFMag", "Sloan_g", "gp1mag", "g_psf"];
const SLOAN_R: &[&str] =
    &["rmag", "r'mag", "r", "r_mag", "rMeanPSFMag", "Sloan_r", "rp1mag", "r_psf"];
const SLOAN_I: &[&str] =
    &["imag", "i'mag", "i", "i_mag", "iMeanPSFMag", "Sloan_i", "ip1mag", "i_psf"];
const SLOAN_Z: &[&str] =
    &["zmag", "z'mag", "z", "z_mag", "zMeanPSFMag", "Sloan_z", "zp1mag", "z_psf"];
const GAIA: &[&str] = &["phot_g_mean_mag", "Gmag"];
const GAIA_BP: &[&str] = &["phot_bp_mean_mag", "BPmag"];
const GAIA_RP: &[&str] = &["phot_rp_mean_mag", "RPmag"];

/// The Sun's colours: B−V, V−R, V−I of Ramírez et al. 2012 (ApJ 752, 5), g−r and r−i of Willmer 2018 (ApJS 236, 47), BP−RP of Casagrande & VandenBerg 2018.
const BANDS: [Band; 9] = [
    Band { filters: &["B"], system: System::Vega, columns: B, colour: (B, V, 0.653) },
    Band { filters: &["V"], system: System::Vega, columns: V, colour: (B, V, 0.653) },
    Band { filters: &["R", "Rc"], system: System::Vega, columns: R, colour: (V, R, 0.352) },
    Band { filters: &["I", "Ic"], system: System::Vega, columns: I, colour: (V, I, 0.702) },
    Band {
        filters: &["g"],
        system: System::AB,
        columns: SLOAN_G,
        colour: (SLOAN_G, SLOAN_R, 0.45),
    },
    Band {
        filters: &["r"],
        system: System::AB,
        columns: SLOAN_R,
        colour: (SLOAN_G, SLOAN_R, 0.45),
    },
    Band {
        filters: &["i"],
        system: System::AB,
        columns: SLOAN_I,
        colour: (SLOAN_R, SLOAN_I, 0.12),
    },
    Band {
        filters: &["z"],
        system: System::AB,
        columns: SLOAN_Z,
        colour: (SLOAN_R, SLOAN_I, 0.12),
    },
    Band {
        filters: &["gaia", "gaiag"],
        system: System::Vega,
        columns: GAIA,
        colour: (GAIA_BP, GAIA_RP, 0.82),
    },
];

/// Columns and system of a list of stars, as a user says them.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct CatalogueOptions {
    /// The file.
    pub path: PathBuf,
    /// The column of magnitudes; `None` takes that of the frame's filter.
    pub magnitude: Option<String>,
    /// The two columns whose difference is the colour; `None` takes the usual ones of the band, where they are there.
    pub colour: Option<[String; 2]>,
    /// The system of the magnitudes, where the column does not tell.
    pub system: Option<System>,
}

/// Places of stars of a list.
#[derive(Debug, Clone)]
pub struct Catalogue {
    path: PathBuf,
    table: Table,
    /// Right ascension and declination, deg, at the list's epoch.
    sky_deg: Vec<[f64; 2]>,
    /// Proper motion in right ascension (times the cosine of the declination) and declination, mas/yr, and epoch, yr.
    motion: Option<(Vec<[f64; 2]>, Vec<f64>)>,
}

/// Magnitudes of a list in a band.
#[derive(Debug, Clone, PartialEq)]
pub struct BandColumns {
    /// Name of the column of magnitudes.
    pub column: String,
    /// System of the magnitudes; `None` where neither the column nor the user tells.
    pub system: Option<System>,
    /// Magnitudes.
    pub magnitude: Vec<f64>,
    /// Standard deviations, mag; 0 where the list has none.
    pub sigma_mag: Vec<f64>,
    /// Name and values of the colour.
    pub colour: Option<(String, Vec<f64>)>,
    /// The Sun's colour, where it is known.
    pub sun_colour: Option<f64>,
}

impl Catalogue {
    /// Reads a list of stars.
    ///
    /// # Errors
    /// A file that cannot be read or is no table; no columns of right ascension and declination; a place beyond the sky; no star.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        let bytes = sunglint_formats::read::bytes(path)?;
        Ok(Self::of(path, bytes)?)
    }

    fn of(path: &Path, bytes: Vec<u8>) -> Result<Self, ParseError> {
        let table = match open(path, bytes)? {
            Source::Table(_, table) => *table,
            Source::Samples(format, _) => {
                return Err(ParseError::new(
                    path,
                    format!("a light curve ({})", format.name()),
                    "a table of stars: right ascension, declination, magnitudes",
                ));
            }
        };
        Self::of_table(path, table)
    }

    /// The stars to V = 5.0 that come with the program (Hipparcos; places and motions of the year 2000).
    ///
    /// # Errors
    /// None that a user can cause: those of [`Catalogue::read`].
    pub fn embedded() -> Result<Self, ParseError> {
        let table = sunglint_radiometry::tables::BRIGHT_STARS.table().clone();
        Self::of_table(Path::new("embedded:bright_stars"), table)
    }

    /// A magnitude of every star by which they may be put in order: the column that was named, else the first that is known; NaN where a
    /// star has none.
    ///
    /// # Errors
    /// No such column, or none that is known, with the names that are there.
    pub fn brightness(&self, column: Option<&str>) -> Result<Vec<f64>, ParseError> {
        let found = match column {
            Some(name) => exact(&self.table, name),
            None => find(&self.table, &BRIGHTNESS),
        };
        let values = found.and_then(|column| self.table.f64(&column.name).ok());
        values.map(|v| v.into_owned()).ok_or_else(|| {
            let found = format!("the columns {}", list(&self.table));
            let error = ParseError::new(&self.path, found, "a column of magnitudes");
            error.with_hint(format!("names that are known: {}", BRIGHTNESS.join(", ")))
        })
    }

    fn of_table(path: &Path, table: Table) -> Result<Self, ParseError> {
        if table.rows() == 0 || table.rows() > MOST_ROWS {
            let found = format!("{} rows", table.rows());
            return Err(ParseError::new(path, found, format!("1 to {MOST_ROWS} stars")));
        }
        let column = |names: &[&str], what: &str| {
            find(&table, names).ok_or_else(|| {
                ParseError::new(
                    path,
                    format!("the columns {}", list(&table)),
                    format!("a column of {what}"),
                )
                .with_hint(format!("names that are known: {}", names.join(", ")))
            })
        };
        let ra = angles(path, column(&RA, "right ascensions")?, true)?;
        let dec = angles(path, column(&DEC, "declinations")?, false)?;
        let mut sky_deg = Vec::with_capacity(ra.len());
        for (row, (ra, dec)) in ra.iter().zip(&dec).enumerate() {
            // Rows without a place are left out by the magnitudes' side: NaN matches nothing.
            if ra.is_finite() && !(-360.0..=360.0).contains(ra) || dec.abs() > 90.0 {
                return Err(ParseError::new(
                    path,
                    format!("{ra}, {dec}"),
                    "degrees of right ascension and declination",
                )
                .at_line(row as u64 + 1));
            }
            sky_deg.push([*ra, *dec]);
        }
        let numbers = |names: &[&str]| {
            let column = find(&table, names)?;
            table.f64(&column.name).ok().map(|v| v.into_owned())
        };
        let motion = match (numbers(&PM_RA), numbers(&PM_DEC)) {
            (Some(ra), Some(dec)) => {
                let zero = |v: &f64| if v.is_finite() { *v } else { 0.0 };
                let pairs = ra.iter().zip(&dec).map(|(a, d)| [zero(a), zero(d)]).collect();
                let epoch = numbers(&EPOCH).unwrap_or_else(|| vec![2000.0; sky_deg.len()]);
                Some((pairs, epoch))
            }
            _ => None,
        };
        Ok(Self { path: path.to_path_buf(), table, sky_deg, motion })
    }

    /// Number of stars.
    pub fn len(&self) -> usize {
        self.sky_deg.len()
    }

    /// Whether there is no star.
    pub fn is_empty(&self) -> bool {
        self.sky_deg.is_empty()
    }

    /// Right ascension and declination of a star in a year, deg.
    pub fn sky_deg(&self, star: usize, year: f64) -> Equatorial {
        let [ra, dec] = self.sky_deg[star];
        let Some((motion, epoch)) = &self.motion else { return [ra, dec].into() };
        let years = year - epoch[star];
        if !years.is_finite() {
            return [ra, dec].into();
        }
        let [east, north] = motion[star].map(|mas| mas * years / 3.6e6);
        let cos = dec.to_radians().cos().max(1e-6);
        [ra + east / cos, (dec + north).clamp(-90.0, 90.0)].into()
    }

    /// Magnitudes and colours for frames of a filter.
    ///
    /// # Errors
    /// No column for the filter, with the names of those that are there; a named column that is not there or holds no numbers.
    pub fn band(
        &self,
        filter: &str,
        options: &CatalogueOptions,
    ) -> Result<BandColumns, ParseError> {
        let band = band_of(filter);
        let bad = |found: String, hint: String| {
            ParseError::new(&self.path, found, "a column of magnitudes for the frames' filter")
                .with_hint(hint)
        };
        let column = match (&options.magnitude, band) {
            (Some(name), _) => exact(&self.table, name).ok_or_else(|| {
                bad(format!("no column `{name}`"), format!("the columns are {}", list(&self.table)))
            })?,
            (None, Some(band)) => first(&self.table, band.columns).ok_or_else(|| {
                let known = band.columns.join(", ");
                bad(
                    format!(
                        "no magnitudes for the filter `{filter}` (names that are known: {known})"
                    ),
                    format!(
                        "name the column with --catalogue-mag; the columns are {}",
                        list(&self.table)
                    ),
                )
            })?,
            (None, None) => {
                return Err(bad(
                    format!("the filter `{filter}`, whose band is not known"),
                    format!(
                        "name the column with --catalogue-mag; the columns are {}",
                        list(&self.table)
                    ),
                ));
            }
        };
        // The band of the column counts, not that of the filter.
        let own = BANDS.iter().find(|b| b.columns.contains(&column.name.as_str()));
        let numbers = |column: &Column| -> Result<Vec<f64>, ParseError> {
            let values = self.table.f64(&column.name).map_err(|e| e.in_file(&self.path))?;
            Ok(values.iter().map(|v| if v.abs() < 90.0 { *v } else { f64::NAN }).collect())
        };
        let magnitude = numbers(column)?;
        let colour = match (&options.colour, own) {
            (Some([a, b]), _) => {
                let get = |name: &String| {
                    exact(&self.table, name).ok_or_else(|| {
                        bad(
                            format!("no column `{name}`"),
                            format!("the columns are {}", list(&self.table)),
                        )
                    })
                };
                Some((get(a)?, get(b)?))
            }
            (None, Some(band)) => {
                first(&self.table, band.colour.0).zip(first(&self.table, band.colour.1))
            }
            (None, None) => None,
        };
        let is_usual = options.colour.is_none();
        let colour = match colour {
            Some((a, b)) => {
                let (one, two) = (numbers(a)?, numbers(b)?);
                let values = one.iter().zip(&two).map(|(a, b)| a - b).collect();
                Some((format!("{} - {}", a.name, b.name), values))
            }
            None => None,
        };
        Ok(BandColumns {
            column: column.name.clone(),
            system: options.system.or(own.map(|b| b.system)),
            sigma_mag: self.sigmas(&column.name),
            sun_colour: own.filter(|_| is_usual && colour.is_some()).map(|b| b.colour.2),
            magnitude,
            colour,
        })
    }

    /// Standard deviations of a column of magnitudes under the names that catalogues use; 0 where there are none.
    fn sigmas(&self, column: &str) -> Vec<f64> {
        let names = [
            format!("e_{column}"),
            format!("{column}_error"),
            format!("{column}_err"),
            format!("{column}Err"),
            format!("{column}err"),
            format!("sigma_{column}"),
        ];
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let values = find(&self.table, &names).and_then(|c| self.table.f64(&c.name).ok());
        match values {
            Some(values) => {
                values.iter().map(|v| if (0.0..5.0).contains(v) { *v } else { 0.0 }).collect()
            }
            None => vec![0.0; self.len()],
        }
    }
}

/// The letter of the band that a filter's name says (`V` of `Johnson V` and `bessel_v`, `g` of `SDSS-g`); `None` where it says none.
///
/// ```
/// use sunglint_calibration::field_stars::catalogue::band_letter;
/// assert_eq!(band_letter("V Bessell"), Some("V"));
/// assert_eq!(band_letter("Clear"), None);
/// ```
pub fn band_letter(filter: &str) -> Option<&'static str> {
    band_of(filter)?.filters.first().copied()
}

/// The band of a filter's name: a letter, before or behind the words for whose system it is (`Johnson V`, `V Bessell`, `SDSS-i`).
fn band_of(filter: &str) -> Option<&'static Band> {
    const OF_JOHNSON: [&str; 4] = ["johnson", "cousins", "bessell", "bessel"];
    const OF_SLOAN: [&str; 4] = ["sloan", "sdss", "ps1", "panstarrs"];
    let lower = filter.to_ascii_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    let (is_sloan, is_johnson) = (has(&OF_SLOAN) || lower.contains('\''), has(&OF_JOHNSON));
    // What is left of a word without the system's: of `JohnsonV` the letter, of `Johnson` nothing.
    let without = |part: &str| {
        let of_part = part.to_ascii_lowercase();
        let system = OF_JOHNSON.iter().chain(&OF_SLOAN).find(|word| of_part.starts_with(*word));
        part[system.map_or(0, |word| word.len())..].to_owned()
    };
    let mut letters = filter.split(|c: char| !c.is_ascii_alphanumeric()).map(without);
    let letters = letters.rfind(|part| !part.is_empty()).unwrap_or_default();
    if matches!(letters.to_ascii_lowercase().as_str(), "gaia" | "gaiag") {
        return BANDS.last();
    }
    // Sloan's letters may be written large, Johnson's small: g' as G', V as bessel_v.
    let name = match (is_sloan, is_johnson) {
        (true, _) => letters.to_ascii_lowercase(),
        (false, true) => letters.to_ascii_uppercase(),
        (false, false) => letters,
    };
    // `rp` is r', `VJ` Johnson's V, `Rc` and `RC` Cousins' R.
    let mut of_two = name.chars();
    let name = match (of_two.next(), of_two.next(), of_two.next()) {
        (Some(_), Some('p'), None)
        | (Some('B' | 'V'), Some('J' | 'j'), None)
        | (Some('R' | 'I'), Some('C' | 'c'), None) => &name[..1],
        _ => name.as_str(),
    };
    BANDS.iter().find(|band| band.filters.contains(&name))
}

fn list(table: &Table) -> String {
    let names: Vec<&str> = table.columns.iter().take(40).map(|c| c.name.as_str()).collect();
    names.join(", ")
}

/// A column by one of several names, letter case aside.
fn find<'a>(table: &'a Table, names: &[&str]) -> Option<&'a Column> {
    names.iter().find_map(|name| table.columns.iter().find(|c| c.name.eq_ignore_ascii_case(name)))
}

/// A column by one of several names; letter case counts: G is not g.
fn first<'a>(table: &'a Table, names: &[&str]) -> Option<&'a Column> {
    names.iter().find_map(|name| table.columns.iter().find(|c| c.name == *name))
}

fn exact<'a>(table: &'a Table, name: &str) -> Option<&'a Column> {
    first(table, &[name]).or_else(|| find(table, &[name]))
}

/// Degrees of a column; texts are sexagesimal, and those of right ascensions hours.
fn angles(path: &Path, column: &Column, is_ra: bool) -> Result<Vec<f64>, ParseError> {
    let hours = is_ra
        && column.unit.as_deref().is_some_and(|unit| {
            ["h", "hr", "hour", "hourangle", "h:m:s"].contains(&unit.trim().trim_matches('"'))
        });
    if let Values::Text(texts) = &column.values {
        return texts
            .iter()
            .enumerate()
            .map(|(row, text)| {
                let Some(text) = text else { return Ok(f64::NAN) };
                // A text of one number is in degrees.
                let is_one = text.trim().parse::<f64>().is_ok();
                let angle = sexagesimal(text).ok_or_else(|| {
                    ParseError::new(path, format!("`{text}`"), "an angle")
                        .at_line(row as u64 + 1)
                        .in_field(&column.name)
                })?;
                Ok(if is_ra && (hours || !is_one) { 15.0 * angle } else { angle })
            })
            .collect();
    }
    let table = Table { columns: vec![column.clone()], ..Table::default() };
    let values = table.f64(&column.name).map_err(|e| e.in_file(path))?;
    let factor = if hours { 15.0 } else { 1.0 };
    Ok(values.iter().map(|v| factor * v).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_told_by_their_names() {
        for (filter, column) in [
            ("V", "Vmag"),
            ("Johnson V", "Vmag"),
            ("Bessell_R", "Rmag"),
            ("g'", "gmag"),
            ("SLOAN R", "rmag"),
            ("SDSS-i", "imag"),
            ("rp", "rmag"),
            ("V Bessell", "Vmag"),
            ("bessel_v", "Vmag"),
            ("JohnsonB", "Bmag"),
            ("VJ", "Vmag"),
            ("Rc", "Rmag"),
            ("I_Cousins", "Imag"),
            ("g SDSS", "gmag"),
            ("Gaia G", "gone"),
        ] {
            let band = band_of(filter).map(|b| b.columns[0]);
            if column == "gone" {
                // The last word is `G`, which no band has: it might be green.
                assert_eq!(band, None, "{filter}");
            } else {
                assert_eq!(band, Some(column), "{filter}");
            }
        }
        for filter in ["Lum", "Clear", "none", "Ha", "G", "v", "Johnson", ""] {
            assert!(band_of(filter).is_none(), "{filter}");
        }
    }

    #[test]
    fn a_list_of_a_server_is_read() {
        let text = "RA_ICRS,DE_ICRS,Vmag,e_Vmag,Bmag,pmRA,pmDE,ref_epoch\n\
                    10.5,-20.25,9.5,0.02,10.1,1000,-1000,2016\n11,-20,,,,,,\n";
        let stars = Catalogue::of(Path::new("list.csv"), text.into()).unwrap();
        assert_eq!(stars.len(), 2);
        let band = stars.band("V", &CatalogueOptions::default()).unwrap();
        assert_eq!((band.column.as_str(), band.system), ("Vmag", Some(System::Vega)));
        assert!(band.magnitude[0] == 9.5 && band.magnitude[1].is_nan());
        assert_eq!(band.sigma_mag, [0.02, 0.0]);
        let (name, colour) = band.colour.unwrap();
        assert!(name == "Bmag - Vmag" && (colour[0] - 0.6).abs() < 1e-12);
        // Ten years of 1″ a year: 10″/cos(20.25°) east, 10″ south.
        let [ra, dec] = stars.sky_deg(0, 2026.0).to_array();
        assert!((ra - 10.5 - 10.0 / 3600.0 / 20.25_f64.to_radians().cos()).abs() < 1e-9, "{ra}");
        assert!((dec + 20.25 + 10.0 / 3600.0).abs() < 1e-12);
        let error = stars.band("Clear", &CatalogueOptions::default()).unwrap_err().to_string();
        assert!(error.contains("Clear"), "{error}");
        let sexagesimal = "RAJ2000,DEJ2000,V\n05:30:00,-00:30:00,4\n";
        let stars = Catalogue::of(Path::new("list.csv"), sexagesimal.into()).unwrap();
        assert_eq!(stars.sky_deg(0, 2000.0).to_array(), [82.5, -0.5]);
        let error = Catalogue::of(Path::new("x.csv"), "x,y\n1,2\n".into()).unwrap_err().to_string();
        assert!(error.contains("right ascensions"), "{error}");
    }
}
