//! The materials that parts name: of the file itself, or built in.

use super::file::{key, unknown};
use crate::surface::Material;
use crate::surface::file::{MaterialFile, material};
use std::path::PathBuf;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError};

/// The materials of a file, and those that its parts have asked for.
pub(super) struct Shelf<'d> {
    document: &'d Document,
    own: Vec<Material>,
    sources: Vec<(PathBuf, String)>,
    used: Vec<Material>,
}

impl<'d> Shelf<'d> {
    /// Reads the `[[material]]` tables.
    pub fn new(
        document: &'d Document,
        at: &str,
        files: &[MaterialFile],
    ) -> Result<Self, FileError> {
        let mut this = Self { document, own: Vec::new(), sources: Vec::new(), used: Vec::new() };
        for (i, file) in files.iter().enumerate() {
            let at = key(at, &format!("material[{i}]"));
            if this.own.iter().any(|known| known.name == file.name) {
                let expected = "a name that no other material has";
                return Err(document.error_at(&key(&at, "name"), expected).into());
            }
            let (material, sources) = material(document, &at, file)?;
            this.own.push(material);
            for source in sources {
                if !this.sources.contains(&source) {
                    this.sources.push(source);
                }
            }
        }
        Ok(this)
    }

    /// The index of a material among those in use; a name of the file goes before a built-in one.
    pub fn index(&mut self, key: &str, name: &str) -> Result<usize, ParseError> {
        if let Some(index) = self.used.iter().position(|material| material.name == name) {
            return Ok(index);
        }
        let own = self.own.iter().find(|material| material.name == name).cloned();
        let Some(material) = own.or_else(|| Material::built_in(name)) else {
            let own = self.own.iter().map(|material| material.name.as_str());
            let known: Vec<&str> = own.chain(Material::built_in_names().iter().copied()).collect();
            return Err(unknown(
                self.document,
                key,
                "a [[material]] or built-in one",
                name,
                &known,
            ));
        };
        self.used.push(material);
        Ok(self.used.len() - 1)
    }

    /// The materials in use in the order of their indices, the names of those of the file that are not, and the files that were read.
    pub fn finish(self) -> (Vec<Material>, Vec<String>, Vec<(PathBuf, String)>) {
        let used = |material: &&Material| self.used.iter().any(|u| u.name == material.name);
        let idle = self.own.iter().filter(|m| !used(m)).map(|m| m.name.clone()).collect();
        (self.used, idle, self.sources)
    }
}
