//! The materials that the program knows by name.
//!
//! `aluminium`, `solar_cell`, `mli` and `white` have the roughnesses of the usual satellite models and **illustrative** reflectances, the same at all
//! angles: they are for comparing programs, not measurements. The metals with the ending `_nk` follow from measured refractive
//! indices (the table `refractive_indices`) and are as smooth as polished sheet.

use super::{ComplexIndex, Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_formats::ecsv;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

const NAMES: [&str; 11] = [
    "aluminium",
    "solar_cell",
    "mli",
    "white",
    "grey80",
    "unit",
    "mirror",
    "aluminium_nk",
    "silver_nk",
    "gold_nk",
    "copper_nk",
];

/// The wavelengths of the spectra that are constant, nm.
const RANGE_NM: (f64, f64) = (300.0, 1240.0);
/// The roughness of the metals that follow from n + ik.
const POLISHED_ALPHA: f64 = 0.1;

impl Material {
    /// The names of the built-in materials.
    pub fn built_in_names() -> &'static [&'static str] {
        &NAMES
    }

    /// A built-in material; `None` where there is none of that name.
    pub fn built_in(name: &str) -> Option<Self> {
        NAMES.contains(&name).then(|| {
            // A test makes every one, so this cannot fail in a program that passed it.
            #[expect(clippy::expect_used, reason = "embedded tables, made by a test")]
            make(name).expect("a built-in material")
        })
    }
}

fn make(name: &str) -> Result<Material, Box<dyn std::error::Error>> {
    let flat = |value: f64| Spectrum::<Reflectance>::constant(value, RANGE_NM.0, RANGE_NM.1);
    let beckmann = |alpha: f64| Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable);
    let rough = |alpha: f64, text: &str| -> Result<_, Box<dyn std::error::Error>> {
        Ok(Material::microfacet(name, beckmann(alpha)?, Fresnel::constant(embedded(name, text)?)?))
    };
    Ok(match name {
        "aluminium" => rough(0.4, include_str!("../../materials/aluminium.ecsv"))?,
        "solar_cell" => rough(0.15, include_str!("../../materials/solar_cell.ecsv"))?,
        "mli" => rough(0.3, include_str!("../../materials/mli.ecsv"))?,
        "white" => {
            Material::lambert(name, embedded(name, include_str!("../../materials/white.ecsv"))?)?
        }
        "grey80" => Material::lambert(name, flat(0.8)?)?,
        "unit" => Material::lambert(name, flat(1.0)?)?,
        "mirror" => Material::mirror(name, Fresnel::constant(flat(1.0)?)?),
        metal => {
            let index = ComplexIndex::named(metal.trim_end_matches("_nk"))?;
            Material::microfacet(name, beckmann(POLISHED_ALPHA)?, Fresnel::conductor(&index)?)
        }
    })
}

fn embedded(name: &str, text: &str) -> Result<Spectrum<Reflectance>, Box<dyn std::error::Error>> {
    let table = ecsv::read_str(format!("embedded:{name}"), text)?;
    Ok(Spectrum::from_table(&table, "wavelength_nm", "reflectance")?)
}
