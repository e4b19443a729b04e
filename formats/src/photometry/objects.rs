//! Objects that the rows of a table are of.

use super::columns::{filter_column, find};
use super::texts;
use crate::Table;
use crate::text::counted;
use std::collections::{BTreeMap, BTreeSet};

/// Columns that say which object a row is of.
const OBJECTS: [&str; 25] = [
    "object",
    "object_name",
    "objname",
    "target",
    "target_name",
    "satellite",
    "sat_id",
    "norad",
    "norad_id",
    "norad_cat_id",
    // Catalogues and surveys: AAVSO, CRTS, Gaia, ASAS-SN, TESS, Kepler.
    "star name",
    "star_name",
    "starname",
    "star",
    "objectid",
    "object_id",
    "obj_id",
    "source_id",
    "masterid",
    "asas_sn_id",
    "tic",
    "ticid",
    "tic_id",
    "kic",
    "kepid",
];
/// Columns that say it only where their values come again: else they number the rows.
const PERHAPS: [&str; 3] = ["name", "id", "oid"];
/// Objects that a refusal names at most.
const MOST_NAMED: usize = 12;

/// Which rows are taken of a table that says of each which object it is of.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum ObjectRows {
    /// All, if they are of one object; several are an error.
    #[default]
    One,
    /// Those of one object.
    Of(String),
    /// All, of however many objects: where each row has a place of its own, and all objects are alike.
    All,
}

/// Why the rows of a file are not those of the object that is wanted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObjectsError {
    /// Rows of several objects, and none is asked for.
    #[error(
        "its rows are of {} objects (column `{column}`): {}: name one of them",
        objects.len(),
        listed(objects)
    )]
    Several {
        /// The column of objects.
        column: String,
        /// The objects and the number of their rows.
        objects: Vec<(String, usize)>,
    },
    /// An object that no row names.
    #[error("no row is of the object {wanted}; it has {found}")]
    Missing {
        /// The object that was asked for.
        wanted: String,
        /// The objects that are there, in words.
        found: String,
    },
}

/// Objects with their numbers of rows, in words.
fn listed(objects: &[(String, usize)]) -> String {
    let named =
        objects.iter().take(MOST_NAMED).map(|(name, n)| format!("{name} ({})", counted(*n, "row")));
    let mut text = named.collect::<Vec<_>>().join(", ");
    if objects.len() > MOST_NAMED {
        text += &format!(" and {} more", objects.len() - MOST_NAMED);
    }
    text
}

/// A column of this name whose values come again, and are not one for each filter: a survey may number a star's light in each.
fn of_objects<'a>(table: &'a Table, name: &str) -> Option<&'a str> {
    let column = find(table, name)?;
    let count = |column: &str| {
        texts(table, column).map(|all| all.into_iter().collect::<BTreeSet<_>>().len())
    };
    let (values, rows) = (count(column)?, table.rows());
    let filters = filter_column(table).and_then(count).unwrap_or(1);
    let is_one = values == 1 && name == "name";
    (2 * values <= rows && (is_one || values > filters)).then_some(column)
}

/// Rows that are taken of a table.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TakenRows {
    /// The column of objects and the one object that all taken rows are of.
    pub object: Option<(String, String)>,
    /// Whether each row is taken; `None` where all are.
    pub keep: Option<Vec<bool>>,
}

impl ObjectRows {
    /// The rows that are taken of a table.
    ///
    /// # Errors
    /// Several objects, of which none is asked for; an object that no row names.
    pub fn of_table(&self, table: &Table) -> Result<TakenRows, ObjectsError> {
        let column = OBJECTS.iter().find_map(|name| find(table, name));
        let column = column.or_else(|| PERHAPS.iter().find_map(|name| of_objects(table, name)));
        let Some((column, all)) = column.and_then(|column| Some((column, texts(table, column)?)))
        else {
            return match self {
                Self::Of(wanted) => Err(ObjectsError::Missing {
                    wanted: wanted.clone(),
                    found: "no column of objects".into(),
                }),
                _ => Ok(TakenRows::default()),
            };
        };
        let mut counts = BTreeMap::<&str, usize>::new();
        for name in &all {
            *counts.entry(name.trim()).or_default() += 1;
        }
        let objects =
            || counts.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect::<Vec<_>>();
        let of = |name: &str| Some((column.to_owned(), name.to_owned()));
        match self {
            Self::Of(wanted) if counts.contains_key(wanted.trim()) => Ok(TakenRows {
                object: of(wanted.trim()),
                keep: Some(all.iter().map(|name| name.trim() == wanted.trim()).collect()),
            }),
            Self::Of(wanted) => {
                Err(ObjectsError::Missing { wanted: wanted.clone(), found: listed(&objects()) })
            }
            Self::One if counts.len() > 1 => {
                Err(ObjectsError::Several { column: column.to_owned(), objects: objects() })
            }
            _ => {
                let only =
                    counts.keys().next().filter(|name| counts.len() == 1 && !name.is_empty());
                Ok(TakenRows { object: only.and_then(|name| of(name)), keep: None })
            }
        }
    }

    /// Checks that a file whose samples are all of one target has what is asked for.
    ///
    /// # Errors
    /// Another target than the object that is asked for.
    pub fn of_target(&self, target: &str) -> Result<(), ObjectsError> {
        match self {
            Self::Of(wanted) if target != wanted => {
                let found = if target.is_empty() {
                    "no names of objects".into()
                } else {
                    target.to_owned()
                };
                Err(ObjectsError::Missing { wanted: wanted.clone(), found })
            }
            _ => Ok(()),
        }
    }
}
