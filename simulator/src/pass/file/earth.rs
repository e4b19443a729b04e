//! The table `[earth]` of a `PASS.toml`: what the Earth reflects.

use super::super::keys::EarthKeys;
use super::Reader;
use crate::light::EarthAlbedo;
use crate::light::earth::{csv, fits};
use sunglint_formats::FileError;

impl Reader<'_> {
    pub(super) fn earth(&mut self, keys: &EarthKeys) -> Result<EarthAlbedo, FileError> {
        let wrong = |key: &str, expected: &str| self.error(&format!("earth.{key}"), expected);
        if keys.missing.is_some() && keys.file.is_none() {
            return Err(wrong(
                "missing",
                "file beside it: it is for cells of a table without a value",
            )
            .into());
        }
        let earth = match (keys.albedo, &keys.file) {
            (Some(_), Some(_)) => {
                return Err(wrong("albedo", "either albedo or file, not both").into());
            }
            (None, None) => EarthAlbedo::default(),
            (Some(albedo), None) => {
                let earth = EarthAlbedo::grey(albedo.get());
                earth.map_err(|e| self.error("earth.albedo", e.to_string()))?
            }
            (None, Some(file)) => {
                let missing = keys.missing.map(|m| m.get());
                let (bytes, path) = self.bytes("earth.file", file)?;
                match fits::is_fits(&bytes) {
                    true => fits::parse(&path, bytes, missing)?,
                    false => {
                        let text = sunglint_formats::read::decode(&path, bytes)?;
                        csv::parse(&path, &text, missing)?
                    }
                }
            }
        };
        let Some(uncertainty) = keys.uncertainty else { return Ok(earth) };
        let earth = earth.with_uncertainty(uncertainty.get());
        Ok(earth.map_err(|e| self.error("earth.uncertainty", e.to_string()))?)
    }
}

/// Returns the warning about a table with missing cells.
pub(super) fn warning(earth: &EarthAlbedo, keys: &EarthKeys) -> Option<String> {
    let (grid, missing) = (earth.grid()?, keys.missing?);
    let (rows, columns) = grid.size();
    let (count, of) = (grid.missing(), rows * columns);
    (count > 0).then(|| {
        format!(
            "the Earth: {count} of {of} cells have no value, {} stands for them (earth.missing)",
            missing.get()
        )
    })
}
