//! A mount sent to a place, and where its frames looked.

use crate::Product;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};

/// How a goto went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GotoReport {
    /// Name of the target, or its place.
    pub target: String,
    /// Address of the mount.
    pub mount: String,
    /// How far from the target each frame looked, arcsec; empty where none was taken.
    pub off_arcsec: Vec<f64>,
    /// Whether the mount was told where it is.
    pub synced: bool,
}

impl GotoReport {
    /// Table and JSON.
    ///
    /// # Errors
    /// None: numbers that JSON cannot hold are `null`.
    pub fn product(&self) -> Result<Product, serde_json::Error> {
        let rounds = (1..=self.off_arcsec.len()).map(|round| round as f64).collect();
        let table = Table {
            columns: vec![
                Column::f64("frame", None, rounds),
                Column::f64("off_arcsec", Some("arcsec"), self.off_arcsec.clone()),
            ],
            ..Table::default()
        };
        let json = serde_json::to_value(self)?;
        Ok(Product { name: "goto".into(), table, json, ..Product::default() })
    }

    /// Text for a person.
    pub fn text(&self) -> String {
        let mut text = format!("{} at {}", self.mount, self.target);
        match self.off_arcsec.as_slice() {
            [] => text.push_str(", by its own reckoning\n"),
            [one] => {
                let _ = writeln!(text, ": its frame looks {one:.0}″ beside");
            }
            [first, .., last] => {
                let frames = self.off_arcsec.len();
                let _ = writeln!(
                    text,
                    ": the first frame looked {first:.0}″ beside, the last of {frames} {last:.0}″"
                );
            }
        }
        if self.synced {
            text.push_str("the mount was told where it is\n");
        }
        text
    }
}
