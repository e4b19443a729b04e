//! A TOML file with its source, for errors that come later.

use super::deserializer::{Value, describe};
use crate::error::{FileError, ParseError, excerpt};
use crate::kind;
use crate::read::line_of;
use crate::text::listed;
use serde::de::{DeserializeOwned, Visitor};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use toml::de::{DeTable, DeValue};

/// A TOML file: parsed once for its syntax, then into structs, and asked again for the place of a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Document {
    path: PathBuf,
    source: String,
}

impl Document {
    /// Reads a file and checks its syntax.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        let source = crate::read::text(path)?;
        Ok(Self::new(path, source)?)
    }

    /// A document from its text; `path` names it in errors, and other files are found relative to it.
    ///
    /// # Errors
    /// A [`ParseError`] with the line if the text is not TOML.
    pub fn new(path: impl AsRef<Path>, source: impl Into<String>) -> Result<Self, ParseError> {
        Self::new_at(path.as_ref(), source.into())
    }

    fn new_at(path: &Path, source: String) -> Result<Self, ParseError> {
        let document = Self { path: path.to_path_buf(), source };
        match document.tree() {
            Ok(_) => Ok(document),
            // A file of another kind is named as that, and not by its first line.
            Err(error) => Err(match kind::of(document.source.as_bytes()) {
                Some(kind) => kind.in_place_of(&document.path, "TOML"),
                None => error,
            }),
        }
    }

    /// The file as the user named it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The text of the file.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The value of a type that derives `Deserialize`.
    ///
    /// # Errors
    /// A [`ParseError`] with the line and the dotted key: an unknown or missing key, a value of a wrong kind or out of
    /// range.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ParseError> {
        let root = Value { value: DeValue::Table(self.tree()?), start: 0 };
        T::deserialize(root).map_err(|error| match self.another_kind::<T>() {
            Some(another) => another,
            None => error.finish(&self.path, &self.source),
        })
    }

    /// The error of a file that is of another kind than the one whose keys `T` has; `None` where it is of that kind, or of one that is not known.
    fn another_kind<T: DeserializeOwned>(&self) -> Option<ParseError> {
        let found = kind::of(self.source.as_bytes())?;
        let keys = keys_of::<T>()?;
        let own = found.keys();
        if own.is_empty() || own.iter().any(|key| keys.contains(key)) {
            return None;
        }
        let tree = self.tree().ok()?;
        let wanted = match kind::Kind::with_keys(keys) {
            Some(wanted) if wanted == found => return None,
            Some(wanted) => wanted.name().to_owned(),
            // Part of a file is read, and is there: the error lies in it.
            None if keys.iter().any(|key| tree.contains_key(*key)) => return None,
            None => format!("a TOML file with the keys {}", listed(keys)),
        };
        Some(found.in_place_of(&self.path, &wanted))
    }

    /// An error at a dotted key (`channel[2].dead_time_ns`), for what only a look at several keys shows. A key that is
    /// not there gets the line of the nearest table above it.
    pub fn error_at(&self, key: &str, expected: impl Into<String>) -> ParseError {
        let (line, found) = match self.find(key) {
            Some((byte, found)) => (line_of(&self.source, byte), found),
            None => (1, None),
        };
        let found = found.unwrap_or_else(|| "no such key".to_owned());
        ParseError::new(&self.path, found, expected).at_line(line).in_field(key)
    }

    /// The line of a dotted key, from 1; `None` if it is not there.
    pub fn line_of(&self, key: &str) -> Option<u64> {
        let (byte, found) = self.find(key)?;
        found.map(|_| line_of(&self.source, byte))
    }

    /// A path that stands in the document: relative to the folder of the document, unless it is absolute.
    pub fn resolve(&self, path: impl AsRef<Path>) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(path)
    }

    fn tree(&self) -> Result<DeTable<'_>, ParseError> {
        DeTable::parse(&self.source).map(toml::Spanned::into_inner).map_err(|error| {
            let byte = error.span().map_or(0, |span| span.start);
            let line = line_of(&self.source, byte);
            let found = self.source.lines().nth(line as usize - 1).unwrap_or("").trim();
            ParseError::new(&self.path, excerpt(found), "TOML")
                .at_line(line)
                .with_hint(error.message())
        })
    }

    /// Where the value of a key begins and what it is; where only a part of the way exists, the place at which that
    /// ends and `None`.
    fn find(&self, key: &str) -> Option<(usize, Option<String>)> {
        let mut value = DeValue::Table(self.tree().ok()?);
        let mut start = 0;
        for step in key.split(['.', '[']).map(|step| step.trim_end_matches(']')) {
            let next = match value {
                DeValue::Table(mut table) => table.remove(step),
                DeValue::Array(array) => {
                    step.parse().ok().and_then(|i: usize| array.into_iter().nth(i))
                }
                _ => None,
            };
            let Some(next) = next else { return Some((start, None)) };
            start = next.span().start;
            value = next.into_inner();
        }
        let found = describe(&value);
        Some((start, Some(found)))
    }
}

/// The keys of a struct that derives `Deserialize`; `None` for other types.
fn keys_of<T: DeserializeOwned>() -> Option<&'static [&'static str]> {
    /// Asked for a struct, it notes the fields and gives nothing.
    struct Fields<'a>(&'a Cell<Option<&'static [&'static str]>>);
    impl<'de> serde::Deserializer<'de> for Fields<'_> {
        type Error = serde::de::value::Error;

        fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Self::Error> {
            Err(serde::de::Error::custom("nothing is read"))
        }

        fn deserialize_struct<V: Visitor<'de>>(
            self,
            _: &'static str,
            fields: &'static [&'static str],
            visitor: V,
        ) -> Result<V::Value, Self::Error> {
            self.0.set(Some(fields));
            self.deserialize_any(visitor)
        }

        serde::forward_to_deserialize_any! {
            bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct seq tuple tuple_struct map enum identifier
            ignored_any
        }
    }
    let fields = Cell::new(None);
    let _ = T::deserialize(Fields(&fields));
    fields.get()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    /// Truth: the words of the two kinds, and that a slip within the right kind is told as before, with its line.
    #[test]
    fn a_file_of_another_kind_is_named() {
        #[derive(Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        #[expect(dead_code, reason = "only its keys count")]
        struct Scene {
            target: toml::Table,
            times: toml::Table,
        }
        let error = |text: &str| {
            Document::new("x.toml", text).unwrap().parse::<Scene>().unwrap_err().to_string()
        };
        let material = error("[[material]]\nname = \"panel\"\n");
        assert!(
            material.contains("found materials") && material.contains("expected a scene"),
            "{material}"
        );
        let slip = error("[target]\n[times]\n[orbitt]\n");
        assert!(slip.contains("x.toml:3: orbitt: found an unknown key"), "{slip}");
        let missing = error("[target]\n[orbit]\n");
        assert!(missing.contains("times") && !missing.contains("expected a scene"), "{missing}");
        let curve = Document::new("c.ecsv", "# %ECSV 1.0\n# meta: {quantity: linear}\na b\n");
        let curve = curve.unwrap_err().to_string();
        assert!(
            curve.contains("found a light curve") && curve.contains("expected TOML"),
            "{curve}"
        );
    }
}
