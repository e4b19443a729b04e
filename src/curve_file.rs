//! Files of light curves as the command line asks for them.

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use std::path::Path;
use sunglint_formats::photometry::{ColumnNames, Scale, TimeFormat};
use sunglint_radiometry::light_curve::published::{
    CurveFile, MagnitudeKind, MagnitudeOptions, ObjectRows, PublishedError, Unusable,
};

/// Kind of measured magnitudes.
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

/// Which column has the times, and in which scale.
#[derive(Debug, Clone, Default, Args)]
pub struct TimeColumn {
    /// Names of the columns, for a text without a line of names, such as jd_utc,magnitude,sigma_mag
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub columns: Vec<String>,
    /// Of a table: the column of times [default: time_utc, or one called jd…, mjd…, bjd…]
    #[arg(long, value_name = "NAME")]
    pub time_column: Option<String>,
    /// Of times whose column and header name no scale: which it is; scales differ by more than a minute
    #[arg(long, value_enum)]
    pub time_scale: Option<TimeScale>,
    /// Of times as numbers whose column's name does not say it: what they are
    #[arg(long, value_enum)]
    pub time_format: Option<Numbers>,
}

/// Meaning of the numbers in a column of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Numbers {
    /// Julian dates
    Jd,
    /// Modified Julian dates
    Mjd,
    /// Seconds since 1970-01-01 in UTC, leap seconds left out
    Unix,
    /// Seconds from a moment that is not known
    S,
    /// Days from a moment that is not known
    D,
    /// Texts by ISO 8601
    Iso,
}

/// Scale of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TimeScale {
    /// Coordinated universal time
    Utc,
    /// Atomic time
    Tai,
    /// Terrestrial time
    Tt,
    /// Barycentric dynamical time
    Tdb,
    /// The time of GPS
    Gps,
}

impl TimeColumn {
    /// Puts what was asked for into the names of columns.
    pub fn put_into(&self, names: &mut ColumnNames) {
        names.all.clone_from(&self.columns);
        names.time.clone_from(&self.time_column);
        names.scale = self.time_scale.map(|scale| match scale {
            TimeScale::Utc => Scale::Utc,
            TimeScale::Tai => Scale::Tai,
            TimeScale::Tt => Scale::Tt,
            TimeScale::Tdb => Scale::Tdb,
            TimeScale::Gps => Scale::Gps,
        });
        names.format = self.time_format.map(|format| match format {
            Numbers::Jd => TimeFormat::Jd,
            Numbers::Mjd => TimeFormat::Mjd,
            Numbers::Unix => TimeFormat::Unix,
            Numbers::S => TimeFormat::Seconds,
            Numbers::D => TimeFormat::Days,
            Numbers::Iso => TimeFormat::Iso,
        });
    }
}

/// How a table of magnitudes is read.
#[derive(Debug, Clone, Default, Args)]
pub struct Magnitudes {
    /// Which column has the times.
    #[command(flatten)]
    pub time: TimeColumn,
    /// The column of magnitudes, where a table of them is given [default: magnitude, mag, V … or flux]
    #[arg(long = "magnitude-column", alias = "column", value_name = "NAME")]
    pub column: Option<String>,
    /// The column of their standard uncertainties [default: sigma_mag, mag_err …]
    #[arg(long, value_name = "NAME")]
    pub sigma_column: Option<String>,
    /// Kind of these magnitudes
    #[arg(long = "magnitudes-as", alias = "as", value_enum, default_value_t)]
    pub law: ComparedAs,
    /// Their noise, mag [default: a column sigma_mag, else from the differences between neighbours]
    #[arg(long, value_name = "MAG")]
    pub sigma_mag: Option<f64>,
    /// Of a table of several objects: the one whose rows are taken
    #[arg(long, value_name = "NAME")]
    pub object: Option<String>,
}

impl Magnitudes {
    /// The options that were asked for.
    pub fn options(&self) -> MagnitudeOptions {
        let mut columns = ColumnNames::default();
        self.time.put_into(&mut columns);
        columns.sigma.clone_from(&self.sigma_column);
        columns.magnitude.clone_from(&self.column);
        MagnitudeOptions {
            columns,
            kind: self.law.into(),
            sigma_mag: self.sigma_mag,
            rows: self.object.clone().map_or(ObjectRows::One, ObjectRows::Of),
            as_written: false,
        }
    }

    /// Reads a file of rates or magnitudes.
    ///
    /// # Errors
    /// The errors of [`CurveFile::read`], with the option that may help.
    pub fn read(&self, path: &Path, bytes: Vec<u8>) -> anyhow::Result<CurveFile> {
        CurveFile::read(path, bytes, &self.options()).map_err(with_hint)
    }
}

/// The error with the option that may help.
pub fn with_hint(error: PublishedError) -> anyhow::Error {
    match error {
        PublishedError::NoCurve { .. } => anyhow!("{error} (--magnitude-column NAME)"),
        PublishedError::Objects { .. } => anyhow!("{error} (--object NAME)"),
        PublishedError::Ground { .. } => anyhow!("{error} (--magnitudes-as apparent)"),
        PublishedError::NoneUsable {
            why:
                Unusable::Short { .. }
                | Unusable::NoNoise
                | Unusable::Constant { .. }
                | Unusable::Rounded { .. },
            ..
        } => anyhow!("{error} (--sigma-mag MAG says it)"),
        error => error.into(),
    }
}
