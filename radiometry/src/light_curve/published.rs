//! Files of light curves: rates of this program's schema, or published magnitudes.

use super::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples, given_twice, usual_step_s,
};
use hifitime::Epoch;
use std::path::{Path, PathBuf};
use sunglint_formats::photometry::{self, ColumnNames, Format, Photometry, Source, texts};
pub use sunglint_formats::photometry::{ObjectRows, ObjectsError};
use sunglint_formats::text::{counted, listed};
use sunglint_formats::time::tai_nanoseconds;
use sunglint_formats::{ParseError, Table, TableError, Values};
use sunglint_numerics::order::{median, robust_sigma};

/// A gap of more than this parts one track from the next, s.
const GAP_S: f64 = 60.0;
/// In slow samples without uncertainties gaps of so many usual steps are none: farther apart nothing shows the noise. The light's own change between them counts as noise then.
const GAP_STEPS: f64 = 3.0;
/// Astronomical unit, km (IAU 2012 B2, exact).
const AU_KM: f64 = 149_597_870.7;
/// d ln(flux)/d mag.
const PER_MAG: f64 = 0.921_034_037_197_618_3;

/// Kind of published magnitudes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum MagnitudeKind {
    /// Apparent, above the air: what a catalogue's stars give.
    #[default]
    Apparent,
    /// Apparent at the ground, the air's extinction in it.
    Ground,
    /// Brought to 1000 km, at its own phase angle.
    Range,
    /// Brought to 1000 km and by the illuminated fraction to a phase angle of 90°.
    Standard,
}

impl MagnitudeKind {
    /// Says in words what these magnitudes are.
    pub fn name(self) -> &'static str {
        match self {
            Self::Apparent => "V above the air",
            Self::Ground => "V after the air",
            Self::Range => "V above the air at 1,000 km",
            Self::Standard => "V above the air at 1,000 km, by the illuminated fraction to 90°",
        }
    }
}

/// How a table of magnitudes is read.
#[derive(Debug, Clone, Default)]
pub struct MagnitudeOptions {
    /// Which columns of a table hold what; else those of usual names.
    pub columns: ColumnNames,
    /// Kind of these magnitudes.
    pub kind: MagnitudeKind,
    /// Their noise, mag; else a column `sigma_mag`, else the differences between neighbours give it.
    pub sigma_mag: Option<f64>,
    /// Rows that are taken of a table of several objects.
    pub rows: ObjectRows,
    /// Whether magnitudes stay of their kind and have no uncertainty but a stated one: to be set beside simulated magnitudes of that kind.
    pub as_written: bool,
}

impl MagnitudeOptions {
    /// A noise that is none is an error, not another noise.
    fn check(&self, path: &Path) -> Result<(), PublishedError> {
        match self.sigma_mag {
            Some(value) if !(value.is_finite() && value > 0.0) => {
                Err(PublishedError::Noise { path: path.to_path_buf(), value })
            }
            _ => Ok(()),
        }
    }
}

/// Why a file is no light curve.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PublishedError {
    /// A line or a value that cannot be read.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A column that is not as it should be.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Neither the schema's metadata nor a column of magnitudes.
    #[error(
        "{}: neither a light curve (metadata `quantity`) nor a table of magnitudes with a column `{column}`; it has {found}",
        path.display()
    )]
    NoCurve {
        /// The file.
        path: PathBuf,
        /// The column of magnitudes that was looked for.
        column: String,
        /// The columns that are there.
        found: String,
    },
    /// Magnitudes of another kind than was asked for.
    #[error("{}: it holds apparent and standard magnitudes, not {}", path.display(), kind.name())]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// The kind that was asked for.
        kind: MagnitudeKind,
    },
    /// A column that magnitudes of this kind need.
    #[error("{}: {} need a column `{column}`", path.display(), kind.name())]
    NeedsColumn {
        /// The file.
        path: PathBuf,
        /// The kind of the magnitudes.
        kind: MagnitudeKind,
        /// The missing column.
        column: &'static str,
    },
    /// A noise that is none.
    #[error("{}: a noise of {value} mag, expected a number above 0", path.display())]
    Noise {
        /// The file.
        path: PathBuf,
        /// The noise that was asked for, mag.
        value: f64,
    },
    /// Magnitudes with the air's extinction in them.
    #[error(
        "{}: magnitudes with the air's extinction in them cannot be fitted: correct them to above the air",
        path.display()
    )]
    Ground {
        /// The file.
        path: PathBuf,
    },
    /// Rows of several objects, or of another than the one that is asked for.
    #[error("{}: {why}", path.display())]
    Objects {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: ObjectsError,
    },
    /// No magnitude has a value and a noise.
    #[error("{}: no magnitude that could be used: {why}", path.display())]
    NoneUsable {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: Unusable,
    },
}

/// Why no magnitude of a file can be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Unusable {
    /// No number.
    #[error(
        "the column {column} has no number in any of {} (all are empty, nan or words for a missing value)", counted(*rows, "row")
    )]
    NoNumber {
        /// Number of rows.
        rows: usize,
        /// The column.
        column: String,
    },
    /// Fluxes alone that are not above 0 and have no uncertainty.
    #[error(
        "none of {} has a flux above 0, and no column says the uncertainties of the others", counted(*.0, "row")
    )]
    Dark(usize),
    /// All are the same.
    #[error("{} of {value}: constant light has no noise of its own", counted(*rows, "row"))]
    Constant {
        /// Number of rows.
        rows: usize,
        /// The magnitude.
        value: f64,
    },
    /// Tracks are too short to show their noise.
    #[error(
        "no uncertainties, and samples more than {gap_s:.0} s apart show no noise of their own: of {} the longest track has {} at times of their own, and 8 are needed", counted(*rows, "row"), counted(*longest, "sample")
    )]
    Short {
        /// Number of rows.
        rows: usize,
        /// Samples of the longest track at different times.
        longest: usize,
        /// Gap that parts tracks, s.
        gap_s: f64,
    },
    /// No more scatter than the rounding of the numbers makes.
    #[error(
        "{} of {value} scatter by {scatter:.1e} mag, no more than the step to which they are rounded, {step} mag: as far as these digits say the light is constant, and shows no noise of its own", counted(*rows, "row")
    )]
    Rounded {
        /// Number of rows.
        rows: usize,
        /// The median magnitude.
        value: f64,
        /// Standard deviation, mag.
        scatter: f64,
        /// Rounding step, mag.
        step: f64,
    },
    /// Neighbours do not differ.
    #[error("more than half of the neighbours are the same number, so that they show no noise")]
    NoNoise,
}

/// Contents of a file: rates or magnitudes.
#[derive(Debug, Clone)]
pub enum CurveFile {
    /// Rates: a table of the schema.
    Rates(Box<Table>),
    /// Magnitudes.
    Magnitudes(Box<Brightness>),
}

impl CurveFile {
    /// Reads a table (ECSV, CSV, FITS, VOTable) with the schema's metadata or a column of magnitudes or fluxes, and the formats of [`photometry`]: MMT-9's text, ALCDEF, TDM, EOSSA.
    ///
    /// # Errors
    /// A file of neither kind; rows that are none; magnitudes of another kind than the options say, or without the range or phase angle that their kind needs.
    pub fn read(
        path: &Path,
        bytes: Vec<u8>,
        options: &MagnitudeOptions,
    ) -> Result<Self, PublishedError> {
        options.check(path)?;
        let objects = |why| PublishedError::Objects { path: path.to_path_buf(), why };
        let table = match photometry::open_named(path, bytes, &options.columns.all)? {
            Source::Samples(format, read) => {
                options.rows.of_target(&read.target).map_err(objects)?;
                let mut brightness = Brightness::of_photometry(path, *read, options)?;
                brightness.is_far = format == Format::Alcdef;
                return Ok(Self::Magnitudes(Box::new(brightness)));
            }
            Source::Table(_, table) => *table,
        };
        if table.meta.contains_key("quantity") {
            return Ok(Self::Rates(Box::new(table)));
        }
        let names = &options.columns;
        let no_curve = || {
            let found: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
            PublishedError::NoCurve {
                path: path.to_path_buf(),
                column: names.magnitude.clone().unwrap_or_else(|| "magnitude".into()),
                found: listed(found),
            }
        };
        let (name, is_flux) = match (names.magnitude_of(&table), names.flux_of(&table)) {
            (Some(name), _) => (name, false),
            (None, Some(name)) => (name, true),
            (None, None) => return Err(no_curve()),
        };
        let Some(read) = photometry::column_times(path, &table, names)? else {
            let error = ParseError::new(path, "no column of times", photometry::TIME_COLUMNS);
            return Err(error.in_field("time_utc").into());
        };
        let (times, mut notes) = (read.time, read.notes);
        let column = |name: &str| table.f64(name).ok().map(|c| c.into_owned());
        let mut magnitudes = table.f64(name)?.into_owned();
        notes.extend(photometry::without_signs_of_fluxes(&table, name, &mut magnitudes));
        let range_km = column("range_km")
            .or_else(|| Some(column("range_m")?.iter().map(|r| r / 1e3).collect()))
            .or_else(|| Some(column("delta_au")?.iter().map(|r| r * AU_KM).collect()));
        let mut exposure_s = None;
        if let Some(found) = photometry::exposures(&table) {
            match found.seconds {
                Ok(seconds) => exposure_s = Some(seconds),
                Err(why) => notes.push(why),
            }
        }
        let mut sigma = match names.sigma_of(&table, is_flux) {
            Some(name) => Some(table.f64(name)?.into_owned()),
            None => None,
        };
        let taken = options.rows.of_table(&table).map_err(objects)?.keep;
        notes.extend(
            sigma
                .as_mut()
                .and_then(|s| photometry::without_false_uncertainties(s, taken.as_deref())),
        );
        let (mut flux, mut sigma_flux) = (None, None);
        if is_flux {
            // Fluxes in any unit: their magnitudes have a zero point of their own, and those of 0 or below have none.
            let of_flux = |f: f64| if f > 0.0 { -2.5 * f.log10() } else { f64::NAN };
            let own = magnitudes.iter().map(|f| of_flux(*f)).collect();
            flux = Some(std::mem::replace(&mut magnitudes, own));
            sigma_flux = sigma.take();
        }
        let rows = Rows {
            times,
            magnitudes,
            range_km,
            phase_deg: column("phase_deg"),
            sigma,
            exposure_s,
            labels: labels(&table),
            flux,
            sigma_flux,
            is_flux,
            ..Rows::default()
        };
        let mut keep = vec![true; table.rows()];
        if let Some(good) = quality(&table) {
            let lost = good.iter().filter(|g| !**g).count();
            if lost > 0 {
                notes.push(format!("{} whose QUALITY is not 0 left out", counted(lost, "row")));
            }
            keep = good;
        }
        if let Some(own) = taken {
            keep.iter_mut().zip(own).for_each(|(k, own)| *k &= own);
        }
        let mut brightness = Brightness::of_rows(path, name, rows.kept(&keep), options)?;
        brightness.is_relative = is_flux;
        brightness.column = name.to_owned();
        notes.append(&mut brightness.notes);
        brightness.notes = notes;
        Ok(Self::Magnitudes(Box::new(brightness)))
    }
}

/// Session and filter of a sample: magnitudes of both the same share a zero point.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Label {
    /// The session's name; empty where the file names none.
    pub session: String,
    /// The filter's.
    pub filter: String,
}

/// Published magnitudes as brightnesses, in the order of time.
#[derive(Debug, Clone, Default)]
pub struct Brightness {
    /// Times of the samples.
    pub times: Vec<Epoch>,
    /// Exposures, s; where the file has none, the usual step of the times.
    pub exposure_s: Vec<f64>,
    /// Whether the file says the exposures.
    pub is_exposure_known: bool,
    /// Step to which all magnitudes of the file are rounded, mag; `None` where they have more than six decimals, as magnitudes of fluxes do.
    pub step_mag: Option<f64>,
    /// Name of the column of magnitudes or fluxes; `magnitude` in files that have no such names.
    pub column: String,
    /// Name of the target, as the file has it; may be empty.
    pub target: String,
    /// Rows of the file that said what another said, and were left out.
    pub doubled: usize,
    /// Flux over that of magnitude 0, above the air and as seen from the station; NaN where there is no number.
    pub flux: Vec<f64>,
    /// Standard uncertainty of the flux: the file's own of fluxes, else [`Brightness::share`] of the track's brightness about each sample.
    pub sigma: Vec<f64>,
    /// Standard uncertainty as a share of the flux: 0.921 for each magnitude that the file, the options or the track's white noise says; NaN where nothing does.
    pub share: Vec<f64>,
    /// Distance, m.
    pub range_m: Option<Vec<f64>>,
    /// Phase angle, degrees.
    pub phase_deg: Option<Vec<f64>>,
    /// White noise of each track: first moment, noise (mag), samples.
    pub tracks: Vec<(Epoch, f64, usize)>,
    /// Session and filter of each sample, where the file says them.
    pub labels: Option<Vec<Label>>,
    /// Camera of each sample, of an instrument that has several.
    pub cameras: Option<Vec<String>>,
    /// Whether the target was in the Earth's shadow or penumbra, where the file says it.
    pub eclipsed: Option<Vec<bool>>,
    /// Whether the zero point is unknown: differences alone mean something.
    pub is_relative: bool,
    /// Whether the file's format is one of bodies far beyond the Moon.
    pub is_far: bool,
    /// Samples that were left out, and why, in words.
    pub notes: Vec<String>,
    /// Place of each sample in its file, from 0: samples are in the order of time.
    pub file_rows: Vec<usize>,
}

impl Brightness {
    /// The labels of the samples that count: those of [`Brightness::light_curve`].
    pub fn used_labels(&self) -> Option<Vec<Label>> {
        let labels = self.labels.as_ref()?;
        Some(
            (0..self.times.len()).filter(|i| self.is_used(*i)).map(|i| labels[i].clone()).collect(),
        )
    }

    /// Samples that another program wrote, with the noise that their tracks show.
    fn of_photometry(
        path: &Path,
        read: Photometry,
        options: &MagnitudeOptions,
    ) -> Result<Self, PublishedError> {
        let labels = (read.session.is_some() || read.filter.is_some()).then(|| {
            let at = |c: &Option<Vec<String>>, i: usize| {
                c.as_ref().map_or_else(String::new, |c| c[i].clone())
            };
            let label = |i| Label { session: at(&read.session, i), filter: at(&read.filter, i) };
            (0..read.time.len()).map(label).collect()
        });
        let kind = options.kind;
        let standard = kind == MagnitudeKind::Standard;
        let magnitudes = match (read.standard, standard) {
            (Some(standard), true) => standard,
            (Some(_), false) if kind != MagnitudeKind::Apparent => {
                return Err(PublishedError::OtherKind { path: path.to_path_buf(), kind });
            }
            _ => read.magnitude,
        };
        let mut sigma = read.sigma_mag;
        let false_sigma =
            sigma.as_mut().and_then(|s| photometry::without_false_uncertainties(s, None));
        let rows = Rows {
            times: read.time,
            magnitudes,
            range_km: read.range_km,
            phase_deg: read.phase_deg,
            sigma,
            exposure_s: read.exposure_s,
            labels,
            cameras: read.camera,
            eclipsed: read.eclipsed,
            is_flux: read.is_relative,
            ..Rows::default()
        };
        let mut curve = Self::of_rows(path, "magnitude", rows, options)?;
        curve.is_relative = read.is_relative;
        curve.column = "magnitude".into();
        curve.target = read.target;
        let own = std::mem::replace(&mut curve.notes, read.notes);
        curve.notes.extend(false_sigma);
        curve.notes.extend(own);
        Ok(curve)
    }

    fn of_rows(
        path: &Path,
        column: &str,
        rows: Rows,
        options: &MagnitudeOptions,
    ) -> Result<Self, PublishedError> {
        let mut rows = rows.sorted();
        let doubled = rows.doubled();
        let mut notes = Vec::new();
        let n_doubled = doubled.iter().filter(|d| **d).count();
        if n_doubled > 0 {
            notes.push(given_twice(n_doubled, "channel"));
            rows = rows.kept(&doubled.iter().map(|d| !d).collect::<Vec<_>>());
        }
        notes.append(&mut rows.without_words_for_none());
        let n = rows.times.len();
        let missing = |column: &'static str| PublishedError::NeedsColumn {
            path: path.to_path_buf(),
            kind: options.kind,
            column,
        };
        // What makes the file's magnitudes apparent ones, mag.
        let shift: Vec<f64> = match options.kind {
            _ if options.as_written => vec![0.0; n],
            MagnitudeKind::Apparent => vec![0.0; n],
            MagnitudeKind::Ground => {
                return Err(PublishedError::Ground { path: path.to_path_buf() });
            }
            MagnitudeKind::Range | MagnitudeKind::Standard => {
                let range = rows.range_km.as_ref().ok_or_else(|| missing("range_km"))?;
                let mut all: Vec<f64> = range.iter().map(|r| 5.0 * (r / 1000.0).log10()).collect();
                if options.kind == MagnitudeKind::Standard {
                    let phase = rows.phase_deg.as_ref().ok_or_else(|| missing("phase_deg"))?;
                    for (m, g) in all.iter_mut().zip(phase) {
                        *m -= 2.5 * (1.0 + g.to_radians().cos()).log10();
                    }
                }
                all
            }
        };
        let apparent: Vec<f64> = rows.magnitudes.iter().zip(&shift).map(|(m, s)| m + s).collect();
        let to_apparent = |values: &Vec<f64>| -> Vec<f64> {
            values.iter().zip(&shift).map(|(v, s)| v * 10_f64.powf(-0.4 * s)).collect()
        };
        let sigma_flux = rows.sigma_flux.as_ref().map(to_apparent);
        let has_sigma = rows.sigma.is_some() || sigma_flux.is_some();
        let usual_s = usual_step_s(&rows.times.iter().map(|t| seconds(*t)).collect::<Vec<_>>());
        let has_noise = has_sigma || options.sigma_mag.is_some() || options.as_written;
        let gap_s = if has_noise { GAP_S } else { GAP_S.max(GAP_STEPS * usual_s) };
        if gap_s > GAP_S {
            notes.push(format!(
                "the noise is that of neighbours up to {gap_s:.0} s apart: the light's own change between them counts as noise (--sigma-mag says it)"
            ));
        }
        let tracks = tracks(&rows.times, rows.labels.as_deref(), gap_s);
        let mut sigma_mag = vec![f64::NAN; n];
        let mut noise = Vec::new();
        let mut unstated = 0;
        // Samples of one moment are often one sample twice: they show no noise.
        let values = |track: &[usize]| -> Vec<f64> {
            let doubled = |k: usize| k > 0 && rows.times[track[k]] == rows.times[track[k - 1]];
            (0..track.len()).filter(|k| !doubled(*k)).map(|k| apparent[track[k]]).collect()
        };
        // A session of fewer than eight samples has the noise of the others.
        let of_all = rows.labels.as_ref().and_then(|_| {
            let steps = tracks.iter().flat_map(|t| steps(&values(t)));
            noise_of_steps(steps.collect())
        });
        for track in &tracks {
            let white = white_noise(&values(track)).or(of_all).filter(|_| !options.as_written);
            let own = options.sigma_mag.or(white);
            for i in track {
                let stated = rows
                    .sigma
                    .as_ref()
                    .or(sigma_flux.as_ref())
                    .map(|s| s[*i])
                    .filter(|s| s.is_finite());
                unstated += usize::from(stated.is_none());
                // That of a flux is no magnitude, and is set below.
                sigma_mag[*i] = stated.filter(|_| sigma_flux.is_none()).or(own).unwrap_or(f64::NAN);
            }
            noise.push((rows.times[track[0]], own.unwrap_or(f64::NAN), track.len()));
        }
        if has_sigma && unstated > 0 {
            let instead = match (options.sigma_mag, options.as_written) {
                (Some(noise), _) => format!(": {noise} mag counts for them"),
                (None, true) => String::new(),
                (None, false) => ": the noise of their track counts for them".into(),
            };
            notes.push(format!("{unstated} of {n} samples have no uncertainty above 0{instead}"));
        }
        let flux: Vec<f64> = match &rows.flux {
            Some(flux) => to_apparent(flux),
            None => apparent.iter().map(|m| 10_f64.powf(-0.4 * m)).collect(),
        };
        // A sample that chance made faint has no smaller noise for it: the track's own brightness about it counts.
        let smooth = running_median(&tracks, &flux, n);
        let mut share: Vec<f64> = sigma_mag.iter().map(|s| PER_MAG * s).collect();
        let mut sigma: Vec<f64> = (0..n).map(|i| share[i] * smooth[i]).collect();
        for i in 0..n {
            if let Some(stated) = sigma_flux.as_ref().map(|s| s[i]).filter(|s| s.is_finite()) {
                let of_light = if smooth[i] > 0.0 { stated / smooth[i] } else { f64::NAN };
                (sigma[i], share[i]) = (stated, of_light);
            }
        }
        if sigma_flux.is_none()
            && let Some(of_rows) = &rows.flux
            && of_rows.iter().any(|f| *f <= 0.0)
        {
            // About 0 a share of the light is no noise: what steps of the fluxes themselves scatter by is.
            for track in &tracks {
                let own: Vec<f64> = track.iter().map(|i| flux[*i]).collect();
                let Some(white) = white_noise(&own) else { continue };
                for i in track {
                    let of_light = if smooth[*i] > 0.0 { white / smooth[*i] } else { f64::NAN };
                    (sigma[*i], share[*i]) = (white, of_light);
                }
            }
        }
        let is_exposure_known = rows.exposure_s.is_some();
        let exposure_s = rows.exposure_s.unwrap_or_else(|| vec![usual_s.clamp(1e-3, 10.0); n]);
        let curve = Self {
            step_mag: rounding_step(&rows.magnitudes),
            times: rows.times,
            exposure_s,
            flux,
            sigma,
            share,
            range_m: rows.range_km.map(|r| r.iter().map(|r| 1e3 * r).collect()),
            phase_deg: rows.phase_deg,
            tracks: noise,
            labels: rows.labels,
            cameras: rows.cameras,
            eclipsed: rows.eclipsed,
            is_relative: false,
            is_far: false,
            is_exposure_known,
            column: String::new(),
            target: String::new(),
            doubled: n_doubled,
            notes,
            file_rows: rows.file_rows,
        };
        let counts = |i: usize| match options.as_written {
            true => curve.flux[i].is_finite(),
            false => curve.is_used(i),
        };
        if !(0..n).any(counts) {
            let numbers: Vec<f64> = apparent.iter().copied().filter(|m| m.is_finite()).collect();
            let own = |t: &Vec<usize>| {
                1 + t.windows(2).filter(|p| curve.times[p[0]] != curve.times[p[1]]).count()
            };
            let longest = tracks.iter().map(own).max().unwrap_or(0);
            let why = match numbers.first() {
                None if curve.flux.iter().any(|f| f.is_finite()) => Unusable::Dark(n),
                None => Unusable::NoNumber { rows: n, column: column.to_owned() },
                Some(value) if n > 1 && numbers.iter().all(|m| m == value) => {
                    Unusable::Constant { rows: n, value: *value }
                }
                _ if longest < 8 => Unusable::Short { rows: n, longest, gap_s },
                _ => {
                    let scatter = deviation(&numbers);
                    match (curve.step_mag, median(numbers.iter().copied())) {
                        (Some(step), Some(value)) if scatter <= step => {
                            Unusable::Rounded { rows: n, value, scatter, step }
                        }
                        _ => Unusable::NoNoise,
                    }
                }
            };
            return Err(PublishedError::NoneUsable { path: path.to_path_buf(), why });
        }
        Ok(curve)
    }

    /// Whether a sample has a brightness and an uncertainty.
    pub fn is_used(&self, i: usize) -> bool {
        self.flux[i].is_finite() && self.sigma[i].is_finite() && self.sigma[i] > 0.0
    }

    /// Returns a light curve of the one channel `V`, of the samples that count; rates are fluxes over that of magnitude 0.
    pub fn light_curve(&self, name: &str) -> LightCurve {
        let kept: Vec<usize> = (0..self.times.len()).filter(|i| self.is_used(*i)).collect();
        let pick = |values: &[f64]| kept.iter().map(|i| values[*i]).collect::<Vec<f64>>();
        let flag = |i: &usize| match &self.eclipsed {
            Some(eclipsed) if eclipsed[*i] => Flags::ECLIPSED,
            _ => Flags::empty(),
        };
        LightCurve {
            kind: RateKind::Calibrated,
            samples: Samples {
                time: kept.iter().map(|i| self.times[*i]).collect(),
                exposure_s: pick(&self.exposure_s),
                range_m: self.range_m.as_deref().map(pick),
                phase_deg: self.phase_deg.as_deref().map(pick),
                zenith_deg: None,
            },
            channels: vec![ChannelCurve {
                name: "V".into(),
                rate_hz: pick(&self.flux),
                sigma_hz: pick(&self.sigma),
                flags: kept.iter().map(flag).collect(),
                model_error_hz: None,
                common_sigma_hz: None,
            }],
            provenance: Provenance { target: name.to_owned(), ..Provenance::default() },
            other: sunglint_formats::Meta::default(),
        }
    }
}

#[derive(Default)]
struct Rows {
    times: Vec<Epoch>,
    magnitudes: Vec<f64>,
    range_km: Option<Vec<f64>>,
    phase_deg: Option<Vec<f64>>,
    sigma: Option<Vec<f64>>,
    /// Fluxes and their uncertainties, where the file has them in place of magnitudes; those of 0 or below have no magnitude.
    flux: Option<Vec<f64>>,
    sigma_flux: Option<Vec<f64>>,
    exposure_s: Option<Vec<f64>>,
    labels: Option<Vec<Label>>,
    cameras: Option<Vec<String>>,
    eclipsed: Option<Vec<bool>>,
    /// Whether the magnitudes are those of fluxes, or differences: any number may be one.
    is_flux: bool,
    /// Places in the file, once sorted.
    file_rows: Vec<usize>,
}

impl Rows {
    /// The same in the order of time, and of their values where times are the same: the order of a file never matters.
    fn sorted(self) -> Self {
        let n = self.times.len();
        let keys: Vec<i128> = self.times.iter().map(|t| tai_nanoseconds(*t)).collect();
        let numbers = [
            &self.flux,
            &self.range_km,
            &self.phase_deg,
            &self.sigma,
            &self.sigma_flux,
            &self.exposure_s,
        ];
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| {
            let by_label =
                || self.labels.as_ref().map_or(std::cmp::Ordering::Equal, |l| l[*a].cmp(&l[*b]));
            let by_number = || {
                let differ =
                    numbers.iter().filter_map(|c| c.as_ref()).map(|c| c[*a].total_cmp(&c[*b]));
                differ.into_iter().find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
            };
            let by_value = self.magnitudes[*a].total_cmp(&self.magnitudes[*b]);
            let by_camera =
                || self.cameras.as_ref().map_or(std::cmp::Ordering::Equal, |c| c[*a].cmp(&c[*b]));
            let of_samples = keys[*a].cmp(&keys[*b]).then(by_value).then_with(by_number);
            of_samples.then_with(by_label).then_with(by_camera)
        });
        let pick = |v: Option<Vec<f64>>| v.map(|v| order.iter().map(|i| v[*i]).collect());
        Self {
            times: order.iter().map(|i| self.times[*i]).collect(),
            magnitudes: order.iter().map(|i| self.magnitudes[*i]).collect(),
            range_km: pick(self.range_km),
            phase_deg: pick(self.phase_deg),
            sigma: pick(self.sigma),
            flux: pick(self.flux),
            sigma_flux: pick(self.sigma_flux),
            exposure_s: pick(self.exposure_s),
            labels: self.labels.map(|l| order.iter().map(|i| l[*i].clone()).collect()),
            cameras: self.cameras.map(|c| order.iter().map(|i| c[*i].clone()).collect()),
            eclipsed: self.eclipsed.map(|e| order.iter().map(|i| e[*i]).collect()),
            is_flux: self.is_flux,
            file_rows: match self.file_rows.is_empty() {
                true => order,
                false => order.iter().map(|i| self.file_rows[*i]).collect(),
            },
        }
    }

    /// True for rows that are the same as the one before: time, magnitude, range, phase angle, session, filter and camera. Rows are sorted.
    fn doubled(&self) -> Vec<bool> {
        let same_number = |c: &Option<Vec<f64>>, i: usize| {
            c.as_ref().is_none_or(|c| c[i].to_bits() == c[i - 1].to_bits())
        };
        let is_same = |i: usize| {
            self.times[i] == self.times[i - 1]
                && self.magnitudes[i].to_bits() == self.magnitudes[i - 1].to_bits()
                && same_number(&self.flux, i)
                && same_number(&self.range_km, i)
                && same_number(&self.phase_deg, i)
                && self.labels.as_ref().is_none_or(|l| l[i] == l[i - 1])
                && self.cameras.as_ref().is_none_or(|c| c[i] == c[i - 1])
        };
        (0..self.times.len()).map(|i| i > 0 && is_same(i)).collect()
    }

    /// The rows for which `keep` is true.
    fn kept(self, keep: &[bool]) -> Self {
        if keep.iter().all(|k| *k) {
            return self;
        }
        let order: Vec<usize> = (0..self.times.len()).filter(|i| keep[*i]).collect();
        fn pick<T: Clone>(order: &[usize], from: Option<Vec<T>>) -> Option<Vec<T>> {
            from.map(|v| order.iter().map(|i| v[*i].clone()).collect())
        }
        Self {
            times: order.iter().map(|i| self.times[*i]).collect(),
            magnitudes: order.iter().map(|i| self.magnitudes[*i]).collect(),
            range_km: pick(&order, self.range_km),
            phase_deg: pick(&order, self.phase_deg),
            sigma: pick(&order, self.sigma),
            flux: pick(&order, self.flux),
            sigma_flux: pick(&order, self.sigma_flux),
            exposure_s: pick(&order, self.exposure_s),
            labels: pick(&order, self.labels),
            cameras: pick(&order, self.cameras),
            eclipsed: pick(&order, self.eclipsed),
            is_flux: self.is_flux,
            file_rows: match self.file_rows.is_empty() {
                true => order,
                false => order.iter().map(|i| self.file_rows[*i]).collect(),
            },
        }
    }

    /// Makes no number of what stands for a missing magnitude, and of magnitudes whose range is none; says what was found.
    fn without_words_for_none(&mut self) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.is_flux {
            notes.extend(photometry::without_words_for_none(&mut self.magnitudes));
        }
        if let Some(range) = &self.range_km {
            let none = range.iter().filter(|r| **r <= 0.0).count();
            if none == range.len() && none > 0 {
                notes.push("all ranges are 0: they are not used".into());
                self.range_km = None;
            } else if none > 0 {
                notes.push(format!("{none} samples have a range of 0 or less: left out"));
                for values in [Some(&mut self.magnitudes), self.flux.as_mut()].into_iter().flatten()
                {
                    let lost = values.iter_mut().zip(range).filter(|(_, r)| **r <= 0.0);
                    lost.for_each(|(v, _)| *v = f64::NAN);
                }
            }
        }
        if let Some(eclipsed) = &self.eclipsed {
            let n = eclipsed.iter().filter(|e| **e).count();
            if n > 0 {
                notes.push(format!(
                    "{n} samples are in the Earth's shadow or penumbra: flagged as eclipsed"
                ));
            }
        }
        notes
    }
}

/// Whether the quality of each row is 0, where a table of a space mission (Kepler, TESS: it has BJDREFI) has a column of it.
fn quality(table: &Table) -> Option<Vec<bool>> {
    table.meta.get("BJDREFI")?;
    let column = table
        .columns
        .iter()
        .find(|c| ["QUALITY", "SAP_QUALITY"].iter().any(|n| c.name.eq_ignore_ascii_case(n)))?;
    match &column.values {
        Values::I64(all) => Some(all.iter().map(|q| q.is_none_or(|q| q == 0)).collect()),
        Values::F64(all) => Some(all.iter().map(|q| q.is_nan() || *q == 0.0).collect()),
        _ => None,
    }
}

/// Session and filter of each row, where a table has a column of either.
fn labels(table: &Table) -> Option<Vec<Label>> {
    let any = |names: &[&str]| {
        let all = || table.columns.iter().map(|c| c.name.as_str());
        let found = names.iter().find_map(|w| all().find(|n| n.eq_ignore_ascii_case(w)));
        texts(table, found?)
    };
    let filter = photometry::filter_column(table).and_then(|name| texts(table, name));
    let session = any(&["session"]);
    if session.is_none() && filter.is_none() {
        return None;
    }
    let at = |column: &Option<Vec<String>>, i: usize| {
        column.as_ref().map_or_else(String::new, |c| c[i].clone())
    };
    Some(
        (0..table.rows())
            .map(|i| Label { session: at(&session, i), filter: at(&filter, i) })
            .collect(),
    )
}

fn seconds(epoch: Epoch) -> f64 {
    tai_nanoseconds(epoch) as f64 * 1e-9
}

/// Samples by track: of one session and filter where the file says them, else of one filter without a gap above `gap_s`. Times are in order.
fn tracks(times: &[Epoch], labels: Option<&[Label]>, gap_s: f64) -> Vec<Vec<usize>> {
    if let Some(labels) = labels.filter(|l| l.iter().any(|l| !l.session.is_empty())) {
        let mut by_label: std::collections::BTreeMap<&Label, Vec<usize>> = Default::default();
        for (i, label) in labels.iter().enumerate() {
            by_label.entry(label).or_default().push(i);
        }
        return by_label.into_values().collect();
    }
    let mut tracks: Vec<Vec<usize>> = Vec::new();
    // The steps from filter to filter are no noise: each has a track of its own.
    let mut open = std::collections::BTreeMap::<&str, usize>::new();
    for i in 0..times.len() {
        let filter = labels.map_or("", |l| l[i].filter.as_str());
        match open.get(filter).and_then(|k| tracks.get_mut(*k)) {
            Some(track) if seconds(times[i]) - seconds(times[track[track.len() - 1]]) <= gap_s => {
                track.push(i);
            }
            _ => {
                open.insert(filter, tracks.len());
                tracks.push(vec![i]);
            }
        }
    }
    tracks
}

/// The decimal step, 1 down to 1e-6, of which all numbers are multiples: that to which they are rounded. `None` where there is none, or no number.
///
/// ```
/// use sunglint_radiometry::light_curve::published::rounding_step;
///
/// assert_eq!(rounding_step(&[8.1, 8.25, f64::NAN]), Some(0.01));
/// assert_eq!(rounding_step(&[2.0_f64.sqrt()]), None);
/// ```
pub fn rounding_step(values: &[f64]) -> Option<f64> {
    values.iter().find(|v| v.is_finite())?;
    (0..=6).map(|places| 10_f64.powi(places)).find_map(|per_unit| {
        // A decimal read from a text is off by its last bit, and so is the product.
        let is_multiple = |v: &f64| {
            let scaled = v * per_unit;
            (scaled - scaled.round()).abs() <= 4.0 * f64::EPSILON * scaled.abs()
        };
        values.iter().filter(|v| v.is_finite()).all(is_multiple).then(|| 1.0 / per_unit)
    })
}

/// Standard deviation; 0 of nothing.
fn deviation(values: &[f64]) -> f64 {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// The noise of single samples from the differences between neighbours, robustly: 1.4826 MAD/√2. `None` of fewer than eight.
pub fn white_noise(values: &[f64]) -> Option<f64> {
    noise_of_steps(steps(values))
}

/// Differences between neighbours that are numbers.
fn steps(values: &[f64]) -> Vec<f64> {
    values.windows(2).map(|p| p[1] - p[0]).filter(|d| d.is_finite()).collect()
}

fn noise_of_steps(steps: Vec<f64>) -> Option<f64> {
    if steps.len() < 7 {
        return None;
    }
    Some(robust_sigma(steps)? / 2_f64.sqrt())
}

/// The median of each sample and its ten neighbours on both sides, within its track.
fn running_median(tracks: &[Vec<usize>], values: &[f64], n: usize) -> Vec<f64> {
    let mut smooth = vec![f64::NAN; n];
    for track in tracks {
        for (k, i) in track.iter().enumerate() {
            let near = &track[k.saturating_sub(10)..(k + 11).min(track.len())];
            let near = near.iter().map(|j| values[*j]).filter(|v| v.is_finite());
            smooth[*i] = median(near).unwrap_or(f64::NAN);
        }
    }
    smooth
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the definition: magnitudes of a line of the catalogue, whose standard and apparent ones stand side by side (8.256, 8.504 at 1456.921 km
    /// and 46.151°): 8.256 + 5 lg 1.4569 − 2.5 lg(1 + cos 46.151°) = 8.5017. Tolerance: the catalogue's own rounding of its range, 0.01 mag.
    #[test]
    fn standard_magnitudes_are_those_of_the_illuminated_fraction() {
        let mut text =
            String::from("# Date Time StdMag Mag Filter Penumbra Distance Phase Channel Track\n");
        for i in 0..20 {
            text += &format!(
                "2024-02-28 16:56:5{}.{}97000 8.256 8.50398 Clear 0 1456.921 46.151 7 27839496\n",
                i / 10,
                i % 10
            );
        }
        let read = |law| {
            let options =
                MagnitudeOptions { kind: law, sigma_mag: Some(0.1), ..Default::default() };
            match CurveFile::read(Path::new("m.txt"), text.clone().into_bytes(), &options).unwrap()
            {
                CurveFile::Magnitudes(brightness) => *brightness,
                CurveFile::Rates(_) => panic!("these are magnitudes"),
            }
        };
        let (a, b) = (read(MagnitudeKind::Apparent), read(MagnitudeKind::Standard));
        let ratio = -2.5 * (a.flux[0] / b.flux[0]).log10();
        assert!(ratio.abs() < 0.01, "{ratio}");
        assert!((a.sigma[0] / a.flux[0] - 0.0921).abs() < 1e-4);
        assert_eq!((a.tracks.len(), a.tracks[0].2), (1, 20));
    }

    /// Truth: the file's own column, whose name is that of FITS headers; a value of 0 makes it unknown, with a note.
    #[test]
    fn exposures_have_other_names() {
        let read = |exposure: &str| {
            let row = |i: usize| {
                format!(
                    "2024-02-28T16:56:{:02}Z,{},{exposure}\n",
                    5 * i,
                    8.0 + 0.1 * (i % 3) as f64
                )
            };
            let text = format!("time_utc,mag,exptime\n{}", (0..10).map(row).collect::<String>());
            let options = MagnitudeOptions { sigma_mag: Some(0.1), ..Default::default() };
            match CurveFile::read(Path::new("m.csv"), text.into_bytes(), &options).unwrap() {
                CurveFile::Magnitudes(brightness) => *brightness,
                CurveFile::Rates(_) => panic!("these are magnitudes"),
            }
        };
        let known = read("0.5");
        assert!(known.is_exposure_known && known.exposure_s == [0.5; 10], "{:?}", known.exposure_s);
        let unknown = read("0");
        assert!(!unknown.is_exposure_known);
        assert!(unknown.notes.iter().any(|n| n.contains("exptime")), "{:?}", unknown.notes);
    }

    /// Truth: alternating values ± 1 have differences of 2 throughout: 1.4826·2/√2.
    #[test]
    fn noise_comes_from_neighbours() {
        let values: Vec<f64> = (0..40).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!((white_noise(&values).unwrap() - 2.0967).abs() < 1e-3);
        assert_eq!(white_noise(&values[..5]), None);
    }
}
