//! Complex refractive indices n + ik of the reference table: spacecraft metals, semiconductors, Kapton.

use crate::spectrum::lerp;
use crate::tables::REFRACTIVE_INDICES;
use sunglint_formats::nearest_names;

/// The refractive index of a material on its own grid, linear between.
#[derive(Debug, Clone, PartialEq)]
pub struct RefractiveIndex {
    /// The material's name in the table.
    pub material: String,
    wavelength_nm: Vec<f64>,
    n: Vec<f64>,
    k: Vec<f64>,
}

/// Why there is no refractive index.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RefractiveIndexError {
    /// No material of that name.
    #[error("there is no refractive index of `{name}`; the materials are {}{}", known.join(", "), near.as_ref().map_or(String::new(), |n| format!("; did you mean {n}?")))]
    UnknownMaterial {
        /// Requested value.
        name: String,
        /// The materials of the table.
        known: Vec<String>,
        /// The nearest of them.
        near: Option<String>,
    },
    /// Outside the material's table.
    #[error(
        "the refractive index of {material} is tabulated from {from_nm} to {to_nm} nm, not at {wavelength_nm} nm"
    )]
    OutsideTable {
        /// The material.
        material: String,
        /// Requested value.
        wavelength_nm: f64,
        /// First wavelength.
        from_nm: f64,
        /// Last wavelength.
        to_nm: f64,
    },
}

impl RefractiveIndex {
    /// The names of the materials.
    pub fn materials() -> Vec<&'static str> {
        let column = REFRACTIVE_INDICES.table().text("material");
        let mut names: Vec<&str> =
            column.map(|m| m.iter().flatten().map(String::as_str).collect()).unwrap_or_default();
        names.dedup();
        names
    }

    /// A material of the reference table (`aluminium`, `silicon`, `kapton` …).
    pub fn named(name: &str) -> Result<Self, RefractiveIndexError> {
        let table = REFRACTIVE_INDICES.table();
        let wanted = name.trim().to_ascii_lowercase();
        let columns =
            (table.text("material"), table.f64("wavelength_nm"), table.f64("n"), table.f64("k"));
        let mut found = Self { material: wanted, wavelength_nm: vec![], n: vec![], k: vec![] };
        if let (Ok(material), Ok(nm), Ok(n), Ok(k)) = columns {
            for row in 0..table.rows() {
                if material[row].as_deref() == Some(&found.material) {
                    found.wavelength_nm.push(nm[row]);
                    found.n.push(n[row]);
                    found.k.push(k[row]);
                }
            }
        }
        if found.wavelength_nm.len() < 2 {
            let known = Self::materials();
            let near =
                nearest_names(name, known.iter().copied(), 1).first().map(|n| (*n).to_owned());
            let known = known.into_iter().map(str::to_owned).collect();
            return Err(RefractiveIndexError::UnknownMaterial {
                name: name.to_owned(),
                known,
                near,
            });
        }
        Ok(found)
    }

    /// First and last tabulated wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.wavelength_nm[0], self.wavelength_nm[self.wavelength_nm.len() - 1])
    }

    /// (n, k) at a vacuum wavelength in nm. Error: outside the table.
    pub fn at(&self, wavelength_nm: f64) -> Result<(f64, f64), RefractiveIndexError> {
        let (from_nm, to_nm) = self.range_nm();
        if !(from_nm..=to_nm).contains(&wavelength_nm) {
            let material = self.material.clone();
            return Err(RefractiveIndexError::OutsideTable {
                material,
                wavelength_nm,
                from_nm,
                to_nm,
            });
        }
        let x = &self.wavelength_nm;
        let i = x.partition_point(|&v| v <= wavelength_nm).clamp(1, x.len() - 1);
        let between = |y: &[f64]| lerp(x[i - 1], y[i - 1], x[i], y[i], wavelength_nm);
        Ok((between(&self.n), between(&self.k)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: reflectances at normal incidence, ((n−1)²+k²)/((n+1)²+k²), worked out apart from this code on the source's own tables (refractiveindex.info):
    /// aluminium shows its interband dip near 800 nm, gold its edge. Tolerance: the digits given.
    #[test]
    fn normal_reflectances() {
        for (material, expected) in [
            ("aluminium", [0.908, 0.868, 0.950]),
            ("silver", [0.988, 0.995, 0.997]),
            ("gold", [0.944, 0.976, 0.979]),
            ("copper", [0.918, 0.962, 0.973]),
            ("silicon", [0.347, 0.327, 0.315]),
            ("germanium", [0.484, 0.422, 0.396]),
            ("gallium_arsenide", [0.343, 0.325, 0.303]),
            ("kapton", [0.083, 0.079, 0.077]),
        ] {
            let index = RefractiveIndex::named(material).unwrap();
            for (nm, expected) in [632.8, 800.0, 1064.0].into_iter().zip(expected) {
                let (n, k) = index.at(nm).unwrap();
                let found = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
                assert!(
                    (found - expected).abs() < 0.0006,
                    "{material} at {nm} nm: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn what_is_not_there_is_said() {
        let error = RefractiveIndex::named("aluminum").unwrap_err().to_string();
        assert!(error.ends_with("did you mean aluminium?"), "{error}");
        let error = RefractiveIndex::named("gold").unwrap().at(20_000.0).unwrap_err().to_string();
        assert!(error.contains("not at 20000 nm"), "{error}");
        assert!(RefractiveIndex::named("gold").unwrap().at(f64::NAN).is_err());
    }
}
