//! The reference tables that the program carries with it: each an ECSV file in `radiometry/data`, with its
//! source and licence in its header, embedded whole.

use std::sync::OnceLock;
use sunglint_formats::{Table, ecsv, nearest_names};

/// One embedded table.
#[derive(Debug)]
pub struct Embedded {
    /// The name, as `sunglint tables` lists it.
    pub name: &'static str,
    /// The ECSV text as embedded.
    pub text: &'static str,
    parsed: OnceLock<Table>,
}

impl Embedded {
    const fn new(name: &'static str, text: &'static str) -> Self {
        Self { name, text, parsed: OnceLock::new() }
    }

    /// The table, parsed at the first use.
    pub fn table(&self) -> &Table {
        self.parsed.get_or_init(|| {
            // A test reads every embedded table, so this cannot fail in a program that passed it.
            #[expect(clippy::unwrap_used, reason = "embedded text, read by a test")]
            ecsv::read_str(format!("embedded:{}", self.name), self.text).unwrap()
        })
    }
}

macro_rules! embedded {
    ($($constant:ident $name:literal),* $(,)?) => {
        $(
            #[doc = concat!("The table `", $name, "`.")]
            pub static $constant: Embedded =
                Embedded::new($name, include_str!(concat!("../data/", $name, ".ecsv")));
        )*

        /// Every embedded table.
        pub fn all() -> &'static [&'static Embedded] {
            static ALL: &[&Embedded] = &[$(&$constant),*];
            ALL
        }
    };
}

embedded! {
    SUN "sun",
    VEGA "vega",
    JOHNSON_UBV "johnson_ubv",
    BESSELL_UBVRI "bessell_ubvri",
    STELLAR_LIBRARY "stellar_library",
    BRIGHT_STARS "bright_stars",
    REFRACTIVE_INDICES "refractive_indices",
    AIR_TROPICAL "air_tropical",
    AIR_MIDLATITUDE_SUMMER "air_midlatitude_summer",
    AIR_MIDLATITUDE_WINTER "air_midlatitude_winter",
    AIR_SUBARCTIC_SUMMER "air_subarctic_summer",
    AIR_SUBARCTIC_WINTER "air_subarctic_winter",
    AIR_US_STANDARD "air_us_standard",
    OZONE_HARTLEY_HUGGINS "ozone_hartley_huggins",
    OZONE_CHAPPUIS "ozone_chappuis",
    MOLECULAR_BANDS "molecular_bands",
    WATER_CONTINUUM "water_continuum",
    AEROSOLS "aerosols",
    EARTH_ORIENTATION "earth_orientation",
}

/// The embedded table of that name.
pub fn get(name: &str) -> Option<&'static Embedded> {
    all().iter().copied().find(|t| t.name == name)
}

/// Names of embedded tables that are similar to one that does not exist: first those that contain it, then those that are spelt alike.
pub fn similar_names(wanted: &str) -> Vec<&'static str> {
    let names = || all().iter().map(|t| t.name);
    let lower = wanted.to_lowercase();
    let mut found: Vec<&str> = names().filter(|n| lower.len() > 2 && n.contains(&lower)).collect();
    found.truncate(6);
    for near in nearest_names(wanted, names(), 3) {
        if found.len() < 3 && !found.contains(&near) {
            found.push(near);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_reads_and_names_its_source_and_licence() {
        for embedded in all() {
            let table = embedded.table();
            assert!(table.rows() > 1, "{} has no rows", embedded.name);
            for key in ["title", "source", "licence"] {
                assert!(table.meta_text(key).is_some(), "{} names no {key}", embedded.name);
            }
        }
    }
}
