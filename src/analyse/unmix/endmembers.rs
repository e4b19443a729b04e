//! The materials that a curve is taken apart into.

use anyhow::{Context as _, bail};
use std::path::Path;
use sunglint_analysis::unmix::Endmember;
use sunglint_formats::text_table::read_str as any;
use sunglint_formats::{Values, nearest_names};
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::Target;

/// Endmembers by name, and the files that they came from.
pub fn endmembers(
    asked: &[String],
    warnings: &mut Vec<String>,
) -> anyhow::Result<(Vec<Endmember>, Vec<Input>)> {
    let (mut all, mut inputs): (Vec<Endmember>, Vec<Input>) = (Vec::new(), Vec::new());
    for item in asked.iter().map(|s| s.trim()) {
        let path = Path::new(item);
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("toml") => {
                let target = Target::read(path)?;
                inputs.extend(target.sources.iter().map(|(file, sha256)| Input {
                    file: file.display().to_string(),
                    sha256: sha256.clone(),
                }));
                add(&mut all, &target.materials, warnings)?;
            }
            Some("csv" | "ecsv" | "txt") => {
                let bytes = sunglint_formats::read::bytes(path)?;
                let sha256 = sunglint_formats::sha256(&bytes);
                inputs.push(Input { file: item.to_owned(), sha256 });
                let text = sunglint_formats::read::decode(path, bytes)?;
                all.extend(columns(path, &text)?);
            }
            _ => match (Material::built_in(item), Target::built_in(item)) {
                (Some(material), _) => add(&mut all, &[material], warnings)?,
                (None, Some(target)) => add(&mut all, &target.materials, warnings)?,
                (None, None) => {
                    let mut known = Material::built_in_names().to_vec();
                    known.extend(Target::built_in_names());
                    let near = nearest_names(item, known.iter().copied(), 1);
                    let hint =
                        near.first().map_or(String::new(), |n| format!("; did you mean {n}?"));
                    bail!(
                        "there is no material or target `{item}` (built in are {}), and a file ends with .toml, .csv or .ecsv{hint}",
                        known.join(", ")
                    );
                }
            },
        }
    }
    for (i, endmember) in all.iter().enumerate() {
        if all[..i].iter().any(|other| column_name(&other.name) == column_name(&endmember.name)) {
            bail!("the material {} is given twice", endmember.name);
        }
    }
    Ok((all, inputs))
}

fn add(
    all: &mut Vec<Endmember>,
    materials: &[Material],
    warnings: &mut Vec<String>,
) -> anyhow::Result<()> {
    for material in materials {
        let (reflectance, changes) = material
            .normal_colour()
            .with_context(|| format!("the spectrum of {}", material.name))?;
        if changes {
            warnings.push(format!(
                "{}: its colour changes with the angle; the one at normal incidence is used",
                material.name
            ));
        }
        all.push(Endmember { name: material.name.clone(), reflectance });
    }
    Ok(())
}

/// A spectrum for each column beside `wavelength_nm`.
fn columns(path: &Path, text: &str) -> anyhow::Result<Vec<Endmember>> {
    let table = any(path, text)?;
    if table.column("wavelength_nm").is_err() {
        bail!(
            "{}: no column wavelength_nm; expected it and a column of reflectances for each material",
            path.display()
        );
    }
    let spectra = table.columns.iter().filter(|c| c.name != "wavelength_nm");
    let spectra = spectra.filter(|c| matches!(c.values, Values::F64(_)));
    let all: Vec<Endmember> = spectra
        .map(|column| {
            let reflectance = Spectrum::from_table(&table, "wavelength_nm", &column.name)
                .with_context(|| format!("{}: column {}", path.display(), column.name))?;
            let name = column.name.trim_end_matches("_reflectance");
            Ok(Endmember { name: name.to_owned(), reflectance })
        })
        .collect::<anyhow::Result<_>>()?;
    if all.is_empty() {
        bail!("{}: no column of reflectances beside wavelength_nm", path.display());
    }
    Ok(all)
}

/// A name as columns have it: letters, digits and `_`.
pub fn column_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
