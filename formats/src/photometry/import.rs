//! What a file of photometry says, as far as it is understood.

use super::columns::find;
use super::{ColumnNames, ObjectRows, ObjectsError, Photometry, Source, open_named, texts};
use crate::text::counted;
use crate::{ParseError, Table};
use std::path::{Path, PathBuf};

/// A file of photometry as it is understood.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Import {
    /// Format, in words.
    pub format: &'static str,
    /// Meaning of columns and the columns that were taken for it; none for formats whose columns have no choice.
    pub columns: Vec<(&'static str, String)>,
    /// Columns that nothing was taken from.
    pub unused: Vec<String>,
    /// True where the numbers are fluxes in an unknown unit, turned into magnitudes with an unknown zero point.
    pub of_flux: bool,
    /// Samples.
    pub samples: Photometry,
}

/// Why a file of photometry cannot be imported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// A line or a value that cannot be read.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// Rows of several objects, or of another than the one that is asked for.
    #[error("{}: {why}", path.display())]
    Objects {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: ObjectsError,
    },
}

/// Reads a file of photometry and tells what was taken for what. Numbers that stand for a missing magnitude are none.
///
/// # Errors
/// The errors of [`open_named`] and [`super::column_times`]; a table without times, or without magnitudes and fluxes; rows of several objects, unless `rows` says which are taken.
pub fn import(
    path: impl AsRef<Path>,
    bytes: Vec<u8>,
    names: &ColumnNames,
    rows: &ObjectRows,
) -> Result<Import, ImportError> {
    import_at(path.as_ref(), bytes, names, rows)
}

fn import_at(
    path: &Path,
    bytes: Vec<u8>,
    names: &ColumnNames,
    rows: &ObjectRows,
) -> Result<Import, ImportError> {
    let objects = |why| ImportError::Objects { path: path.to_path_buf(), why };
    let mut import = match open_named(path, bytes, &names.all)? {
        Source::Samples(format, samples) => {
            rows.of_target(&samples.target).map_err(objects)?;
            let mut samples = samples;
            if let Some(sigma) = &mut samples.sigma_mag {
                samples.warnings.extend(super::without_false_uncertainties(sigma, None));
            }
            Import {
                format: format.name(),
                columns: Vec::new(),
                unused: Vec::new(),
                of_flux: false,
                samples: *samples,
            }
        }
        Source::Table(format, table) => {
            let taken = rows.of_table(&table).map_err(objects)?;
            let mut import = of_table(path, format, &table, names, taken.keep.as_deref())?;
            if let Some(keep) = taken.keep {
                let n = keep.iter().filter(|k| **k).count();
                import.samples.notes.push(format!(
                    "{n} of {} taken: those of the object",
                    counted(keep.len(), "row")
                ));
                import.samples.retain(&keep);
            }
            if let Some((column, object)) = taken.object {
                import.unused.retain(|name| *name != column);
                import.columns.push(("object", column));
                import.samples.target = object;
            }
            import
        }
    };
    let samples = &mut import.samples;
    if !samples.is_relative {
        let note = super::without_words_for_none(&mut samples.magnitude);
        samples.notes.extend(note);
        if let Some(standard) = &mut samples.standard {
            super::without_words_for_none(standard);
        }
    }
    let repeated = samples.repeated();
    if repeated > 0 {
        samples.notes.push(format!(
            "{} given twice (time, light and channel are the same): kept here; analyse and fit count each once",
            counted(repeated, "row")
        ));
    }
    Ok(import)
}

fn of_table(
    path: &Path,
    format: &'static str,
    table: &Table,
    names: &ColumnNames,
    taken: Option<&[bool]>,
) -> Result<Import, ParseError> {
    let all: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    let lacks = |expected: &str| {
        Err(ParseError::new(path, format!("the columns {}", crate::text::listed(&all)), expected))
    };
    if table.meta_text("quantity").is_some() {
        let error = ParseError::new(path, "a light curve of this program", "another program's");
        return Err(error.with_hint("every command reads it as it is"));
    }
    let Some((time_column, times)) = super::columns::named_times(path, table, names)? else {
        return lacks(super::TIME_COLUMNS);
    };
    let (column, of_flux) = match (names.magnitude_of(table), names.flux_of(table)) {
        (Some(name), _) => (name, false),
        (None, Some(name)) => (name, true),
        (None, None) => return lacks("a column of magnitudes or fluxes (--magnitude-column NAME)"),
    };
    let mut columns = vec![("time", time_column.to_owned())];
    columns.push((if of_flux { "flux" } else { "magnitude" }, column.to_owned()));
    let numbers = |name: &str| table.f64(name).map(|v| v.into_owned()).map_err(|e| e.in_file(path));
    let mut samples = Photometry { time: times.time, notes: times.notes, ..Photometry::default() };
    samples.magnitude = numbers(column)?;
    let note = super::without_signs_of_fluxes(table, column, &mut samples.magnitude);
    samples.notes.extend(note);
    if let Some(name) = names.sigma_of(table, of_flux) {
        columns.push(("standard uncertainty", name.to_owned()));
        let mut sigma = numbers(name)?;
        samples.warnings.extend(super::without_false_uncertainties(&mut sigma, taken));
        samples.sigma_mag = Some(sigma);
    }
    if of_flux {
        samples.is_relative = true;
        let flux = std::mem::take(&mut samples.magnitude);
        let sigma = samples.sigma_mag.take();
        let magnitude = |f: f64| if f > 0.0 { -2.5 * f.log10() } else { f64::NAN };
        let to_mag = 2.5 / std::f64::consts::LN_10;
        let share = |(s, f): (&f64, &f64)| if *f > 0.0 { to_mag * s / f } else { f64::NAN };
        samples.magnitude = flux.iter().map(|f| magnitude(*f)).collect();
        samples.sigma_mag = sigma.as_ref().map(|s| s.iter().zip(&flux).map(share).collect());
        let is_taken = |row: usize| taken.is_none_or(|t| t[row]);
        let own = || (0..flux.len()).filter(|row| is_taken(*row));
        if let Some(first) = own().find(|row| flux[*row] <= 0.0) {
            let n = own().filter(|row| flux[*row] <= 0.0).count();
            samples.warnings.push(format!(
                "fluxes that are not above 0: {n} of {} (the first: {} in row {}); they are kept as fluxes, have no magnitude, and are left out where magnitudes are written (--tdm, --alcdef)",
                own().count(),
                flux[first],
                first + 1
            ));
        }
        (samples.flux, samples.sigma_flux) = (Some(flux), sigma);
    }
    let mut optional = |meaning: &'static str, usual: &[(&str, f64)]| {
        let (name, factor) = usual.iter().find_map(|(name, f)| Some((find(table, name)?, f)))?;
        let values = table.f64(name).ok()?;
        columns.push((meaning, name.to_owned()));
        Some(values.iter().map(|v| factor * v).collect::<Vec<f64>>())
    };
    samples.range_km =
        optional("range", &[("range_km", 1.0), ("range_m", 1e-3), ("delta_au", 149_597_870.7)]);
    samples.phase_deg = optional("phase angle", &[("phase_deg", 1.0)]);
    if let Some(exposures) = super::exposures(table) {
        match exposures.seconds {
            Ok(seconds) => {
                columns.push(("exposure", exposures.column));
                samples.exposure_s = Some(seconds);
            }
            Err(why) => samples.notes.push(why),
        }
    }
    let mut words = |meaning: &'static str, usual: &[&str]| {
        let name = usual.iter().find_map(|name| find(table, name))?;
        let found = texts(table, name)?;
        columns.push((meaning, name.to_owned()));
        Some(found)
    };
    samples.session = words("session", &["session"]);
    samples.filter = super::filter_column(table).and_then(|name| words("filter", &[name]));
    let used: Vec<&String> = columns.iter().map(|(_, name)| name).collect();
    let unused = all.iter().filter(|n| !used.iter().any(|u| u.as_str() == **n));
    let unused = unused.map(|n| (*n).to_owned()).collect();
    Ok(Import { format, columns, unused, of_flux, samples })
}

impl Import {
    /// What each command would need beyond what the file says: pairs of the command and the words; empty where it takes the file as it is.
    pub fn needs(&self) -> Vec<(&'static str, String)> {
        let mut needs = Vec::new();
        let s = &self.samples;
        if s.is_relative {
            let words = "a zero point: its magnitudes are relative".to_owned();
            needs.push(("compare, fit", words));
        }
        let known = |c: &Option<Vec<f64>>| c.as_ref().is_some_and(|v| v.iter().any(|s| *s > 0.0));
        if !known(&s.sigma_mag) {
            let words = "uncertainties (--sigma-mag), or eight samples or more without a long gap: then neighbours show the noise".to_owned();
            needs.push(("fit, analyse", words));
        }
        if s.range_km.is_none() || s.phase_deg.is_none() {
            let words = "range_km and phase_deg, where magnitudes at 1,000 km or 90° are given (--magnitudes-as)".to_owned();
            needs.push(("analyse period", words));
        }
        needs
    }
}
