//! A mount sent to a place, and where its frames looked.

use crate::Product;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_observatory::telescope::{Gone, OWN_ARCSEC};

/// Result of a goto.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GotoReport {
    /// Name of the target, or its place.
    pub target: String,
    /// Address of the mount.
    pub mount: String,
    /// Distance of each frame from the target, arcsec (empty where none was taken), and the axes as the camera sees them.
    #[serde(flatten)]
    pub gone: Gone,
    /// Whether the mount was told where it is.
    pub synced: bool,
}

impl GotoReport {
    /// Table and JSON.
    ///
    /// # Errors
    /// None: numbers that JSON cannot hold are `null`.
    pub fn product(&self) -> Result<Product, serde_json::Error> {
        let rounds = (1..=self.gone.off_arcsec.len()).map(|round| round as f64).collect();
        let table = Table {
            columns: vec![
                Column::f64("frame", None, rounds),
                Column::f64("off_arcsec", Some("arcsec"), self.gone.off_arcsec.clone()),
            ],
            ..Table::default()
        };
        let json = serde_json::to_value(self)?;
        Ok(Product { name: "goto".into(), table, json, ..Product::default() })
    }

    /// Warning of a mount that says itself that it is not there, where no frame says better.
    pub fn warning(&self) -> Option<String> {
        let own = self.gone.own_arcsec;
        (self.gone.off_arcsec.is_empty() && own > OWN_ARCSEC).then(|| {
            format!(
                "the mount is not there: it says itself that it is {own:.0}″ beside {}, though it was sent again; `--solve` corrects it by frames",
                self.target
            )
        })
    }

    /// Text for a person.
    pub fn text(&self) -> String {
        let mut text = format!("{} at {}", self.mount, self.target);
        match self.gone.off_arcsec.as_slice() {
            [] => {
                let own = self.gone.own_arcsec;
                let _ = writeln!(text, ": by its own reading it is {own:.0}″ beside");
            }
            [one] => {
                let _ = writeln!(text, ": its frame looks {one:.0}″ beside");
            }
            [first, .., last] => {
                let frames = self.gone.off_arcsec.len();
                let _ = writeln!(
                    text,
                    ": the first frame looked {first:.0}″ beside, the last of {frames} {last:.0}″"
                );
            }
        }
        if let Some(camera) = &self.gone.camera {
            text.push_str("for the plan's [mount], of this camera:\n");
            let angle = camera.camera_angle_deg;
            let _ = writeln!(text, "  camera_angle_deg = {angle:.2}");
            let _ = writeln!(text, "  camera_mirrored = {}", camera.camera_mirrored);
            let _ = writeln!(text, "  pixel_scale_arcsec = {:.4}", camera.pixel_scale_arcsec);
            if let Some(pier) = camera.camera_angle_pier {
                let _ = writeln!(text, "  camera_angle_pier = \"{}\"", pier.word());
            }
        }
        if self.synced {
            text.push_str("the mount was told where it is\n");
        }
        text
    }
}
