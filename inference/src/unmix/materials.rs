//! The materials that a curve is taken apart into.

use std::path::{Path, PathBuf};
use sunglint_analysis::unmix::{Endmember, column_name};
use sunglint_formats::text_table::read_str;
use sunglint_formats::{FileError, ParseError, Values, nearest_names};
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::spectrum::{Spectrum, SpectrumError};
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::Target;

/// Why there are no such materials.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MaterialsError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is no table.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A name that is neither built in nor that of a file.
    #[error(
        "there is no material or target `{name}` (built in are {}), and a file ends with .toml, .csv or .ecsv{}",
        known.join(", "),
        nearest.as_ref().map_or(String::new(), |n| format!("; did you mean {n}?"))
    )]
    Unknown {
        /// Requested name.
        name: String,
        /// Names of the built-in materials.
        known: Vec<&'static str>,
        /// The most similar of these.
        nearest: Option<&'static str>,
    },
    /// A material whose colour is no spectrum.
    #[error("the spectrum of {material}")]
    Colour {
        /// The material's name.
        material: String,
        /// Cause of the error.
        source: SpectrumError,
    },
    /// A material that is given twice.
    #[error("the material {name} is given twice")]
    Twice {
        /// The material's name.
        name: String,
    },
    /// A table without wavelengths.
    #[error(
        "{}: no column wavelength_nm; expected it and a column of reflectances for each material",
        path.display()
    )]
    NoWavelength {
        /// The file.
        path: PathBuf,
    },
    /// A table without reflectances.
    #[error("{}: no column of reflectances beside wavelength_nm", path.display())]
    NoColumn {
        /// The file.
        path: PathBuf,
    },
    /// A column that is no spectrum.
    #[error("{}: column {column}", path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// The column's name.
        column: String,
        /// Cause of the error.
        source: SpectrumError,
    },
}

/// Materials with their spectra, and the files that they came from.
#[derive(Debug, Clone, Default)]
pub struct Materials {
    /// The spectra.
    pub endmembers: Vec<Endmember>,
    /// The files.
    pub inputs: Vec<Input>,
    /// Warnings about the materials, for the user.
    pub warnings: Vec<String>,
}

impl Materials {
    /// Reads materials by their names: built-in ones (`white`), all of a target (`box_wing`, `target.toml`), or the columns of a file (`.csv`, `.ecsv`, `.txt` with `wavelength_nm`).
    ///
    /// # Errors
    /// A name that is not known; a file that cannot be read or has no spectra; a material that is given twice.
    pub fn read(names: &[String]) -> Result<Self, MaterialsError> {
        let mut all = Self::default();
        for name in names.iter().map(|s| s.trim()) {
            all.add_named(name)?;
        }
        let endmembers = &all.endmembers;
        for (i, endmember) in endmembers.iter().enumerate() {
            let own = column_name(&endmember.name);
            if endmembers[..i].iter().any(|other| column_name(&other.name) == own) {
                return Err(MaterialsError::Twice { name: endmember.name.clone() });
            }
        }
        Ok(all)
    }

    fn add_named(&mut self, name: &str) -> Result<(), MaterialsError> {
        let path = Path::new(name);
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("toml") => {
                let target = Target::read(path)?;
                self.inputs.extend(target.sources.iter().map(|(file, sha256)| Input {
                    file: file.display().to_string(),
                    sha256: sha256.clone(),
                }));
                self.add(&target.materials)
            }
            Some("csv" | "ecsv" | "txt") => {
                let bytes = sunglint_formats::read::bytes(path)?;
                let sha256 = sunglint_formats::sha256(&bytes);
                self.inputs.push(Input { file: name.to_owned(), sha256 });
                let text = sunglint_formats::read::decode(path, bytes)?;
                self.endmembers.extend(columns(path, &text)?);
                Ok(())
            }
            _ => match (Material::built_in(name), Target::built_in(name)) {
                (Some(material), _) => self.add(&[material]),
                (None, Some(target)) => self.add(&target.materials),
                (None, None) => {
                    let mut known = Material::built_in_names().to_vec();
                    known.extend(Target::built_in_names());
                    let nearest = nearest_names(name, known.iter().copied(), 1).first().copied();
                    Err(MaterialsError::Unknown { name: name.to_owned(), known, nearest })
                }
            },
        }
    }

    fn add(&mut self, materials: &[Material]) -> Result<(), MaterialsError> {
        for material in materials {
            let name = material.name.clone();
            let (reflectance, changes) = material
                .normal_colour()
                .map_err(|source| MaterialsError::Colour { material: name.clone(), source })?;
            if changes {
                self.warnings.push(format!(
                    "{name}: its colour changes with the angle; the one at normal incidence is used"
                ));
            }
            self.endmembers.push(Endmember { name, reflectance });
        }
        Ok(())
    }
}

/// A spectrum for each column beside `wavelength_nm`.
fn columns(path: &Path, text: &str) -> Result<Vec<Endmember>, MaterialsError> {
    let table = read_str(path, text)?;
    if table.column("wavelength_nm").is_err() {
        return Err(MaterialsError::NoWavelength { path: path.to_owned() });
    }
    let spectra = table.columns.iter().filter(|c| c.name != "wavelength_nm");
    let spectra = spectra.filter(|c| matches!(c.values, Values::F64(_)));
    let all: Vec<Endmember> = spectra
        .map(|column| {
            let reflectance = Spectrum::from_table(&table, "wavelength_nm", &column.name);
            let reflectance = reflectance.map_err(|source| MaterialsError::Column {
                path: path.to_owned(),
                column: column.name.clone(),
                source,
            })?;
            let name = column.name.trim_end_matches("_reflectance");
            Ok(Endmember { name: name.to_owned(), reflectance })
        })
        .collect::<Result<_, MaterialsError>>()?;
    if all.is_empty() {
        return Err(MaterialsError::NoColumn { path: path.to_owned() });
    }
    Ok(all)
}
