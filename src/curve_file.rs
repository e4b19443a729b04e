//! Files of light curves as the command line asks for them.

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use std::path::Path;
use sunglint_radiometry::light_curve::published::{
    CurveFile, MagnitudeKind, MagnitudeOptions, PublishedError, Unusable,
};

/// What measured magnitudes are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum ComparedAs {
    /// Apparent, above the air: what a catalogue's stars give
    #[default]
    Apparent,
    /// Apparent at the ground, the air's extinction in it
    Ground,
    /// Brought to 1000 km, at its own phase angle
    #[value(name = "1000km")]
    Range,
    /// Brought to 1000 km and by the illuminated fraction to a phase angle of 90°
    Standard,
}

impl From<ComparedAs> for MagnitudeKind {
    fn from(asked: ComparedAs) -> Self {
        match asked {
            ComparedAs::Apparent => Self::Apparent,
            ComparedAs::Ground => Self::Ground,
            ComparedAs::Range => Self::Range,
            ComparedAs::Standard => Self::Standard,
        }
    }
}

/// How a table of magnitudes is read.
#[derive(Debug, Clone, Default, Args)]
pub struct Magnitudes {
    /// The column of magnitudes, where a table of them is given [default: magnitude]
    #[arg(long = "magnitude-column", value_name = "NAME")]
    pub column: Option<String>,
    /// What these magnitudes are
    #[arg(long = "magnitudes-as", value_enum, default_value_t)]
    pub law: ComparedAs,
    /// Their noise, mag [default: a column sigma_mag, else from the differences between neighbours]
    #[arg(long, value_name = "MAG")]
    pub sigma_mag: Option<f64>,
}

impl Magnitudes {
    /// The options that were asked for.
    pub fn options(&self) -> MagnitudeOptions {
        MagnitudeOptions {
            column: self.column.clone(),
            kind: self.law.into(),
            sigma_mag: self.sigma_mag,
        }
    }

    /// Reads a file of rates or magnitudes.
    ///
    /// # Errors
    /// The errors of [`CurveFile::read`], with the option that may help.
    pub fn read(&self, path: &Path, text: &str) -> anyhow::Result<CurveFile> {
        CurveFile::read(path, text, &self.options()).map_err(with_hint)
    }
}

/// The error with the option that may help.
pub fn with_hint(error: PublishedError) -> anyhow::Error {
    match error {
        PublishedError::NoCurve { .. } => anyhow!("{error} (--magnitude-column NAME)"),
        PublishedError::Ground { .. } => anyhow!("{error} (--magnitudes-as apparent)"),
        PublishedError::NoneUsable { why: Unusable::Short { .. } | Unusable::NoNoise, .. } => {
            anyhow!("{error} (--sigma-mag MAG says it)")
        }
        error => error.into(),
    }
}
