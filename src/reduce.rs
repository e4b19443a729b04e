//! `sunglint reduce`: a session's frames and counts, visit by visit, as linear light curves; or frames of any other program.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::station::{StationArgs, of_session, with_hint};
use anyhow::{Context as _, bail};
use clap::Args;
use glam::DVec2;
use hifitime::Epoch;
use std::path::PathBuf;
use sunglint_calibration::alignment::read_fibres;
use sunglint_calibration::field_stars::System;
use sunglint_calibration::photometry::field::FieldOptions;
use sunglint_calibration::reduction::folder::{
    self as folder_of_frames, FolderOptions, StarsOptions, reduce_frames,
};
use sunglint_calibration::reduction::frames::{DETECT_SIGMAS, FrameOptions, SensorFiles};
use sunglint_calibration::reduction::night::OFF_SIGMAS;
use sunglint_calibration::reduction::{Library, Recipe, ReduceError, ReduceOptions, reduce, stays};
use sunglint_calibration::timing::read_timings;
use sunglint_ephemeris::orbit::elements;
use sunglint_ephemeris::orbit::tle::{self, Tle};
use sunglint_formats::Frame;
use sunglint_formats::image_frame::{ImageFrame, ReadOptions};
use sunglint_formats::session::Session;
use sunglint_formats::wcs::Equatorial;
use sunglint_numerics::measured::{Interval, Measured};
use sunglint_numerics::progress::Progress as _;
use sunglint_radiometry::sky::Site;
use sunglint_radiometry::station::Station;
use sunglint_report::{folder, reduce as report};

/// Arguments of `sunglint reduce`.
#[derive(Debug, Args)]
pub struct ReduceArgs {
    /// The session's folder, as `sunglint observe` made it; or frames (FITS) of any program, or folders of them
    #[arg(required = true, value_name = "SESSION|FRAMES")]
    pub inputs: Vec<PathBuf>,
    /// Only the visits of this target
    #[arg(long, value_name = "NAME")]
    pub target: Option<String>,
    /// A reduction that was saved: the name that the page gave it, or its file; nothing else may be said about frames, gate and target
    #[arg(
        long,
        value_name = "NAME|FILE",
        conflicts_with_all = ["target", "aperture_px", "annulus_px", "fwhm_px", "max_offset_px", "detect_sigma", "brightest", "trailed", "gate", "no_coupling"]
    )]
    pub recipe: Option<PathBuf>,
    /// Also write the rates as they were counted (`NAME_raw.ecsv`)
    #[arg(long)]
    pub raw: bool,
    /// How frames are measured.
    #[command(flatten)]
    pub frames: FrameArgs,
    /// How counts become rates.
    #[command(flatten)]
    pub counts: CountArgs,
    /// Frames of other programs.
    #[command(flatten)]
    pub others: OtherArgs,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// How files of other programs are read.
    #[command(flatten)]
    pub reading: crate::detect::ReadingArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// How frames are measured.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Frames")]
pub struct FrameArgs {
    /// Radius of the aperture, px [default: 8, or 2.5 times the width of the session's widest points at half their maximum]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub aperture_px: Option<f64>,
    /// Inner and outer radius of the annulus for the background, px [default: 1.5 and 2.5 times the aperture's]
    #[arg(long, value_name = "PX", num_args = 2, allow_negative_numbers = true)]
    pub annulus_px: Option<Vec<f64>>,
    /// Width of a point at half its maximum, px [default: as each visit's own frames show it]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub fwhm_px: Option<f64>,
    /// A target is at most so far from the frame's middle, px [default: anywhere]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub max_offset_px: Option<f64>,
    /// A target stands out of the background by so many standard deviations
    #[arg(long, value_name = "K", default_value_t = DETECT_SIGMAS, allow_negative_numbers = true)]
    pub detect_sigma: f64,
    /// Take the brightest of several sources, not the one nearest to the middle
    #[arg(long)]
    pub brightest: bool,
    /// Targets are drawn out by their motion: find the trail, and sum along it
    #[arg(long)]
    pub trailed: bool,
    /// Dark frames (FITS) in place of the session's own
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub dark: Vec<PathBuf>,
    /// Flats (FITS); they need dark frames
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub flat: Vec<PathBuf>,
    /// Library of master darks, bias frames and flats: gives what the session lacks, and keeps what it has
    #[arg(long, value_name = "FOLDER")]
    pub library: Option<PathBuf>,
    /// When the cameras expose, as `sunglint timing` measured it: is taken off the times of a session's frames
    #[arg(long, value_name = "FILE")]
    pub timing: Option<PathBuf>,
}

/// Frames of other programs.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Frames of other programs")]
pub struct OtherArgs {
    /// Place of the target in the first frame: column and row, px [default: chosen by its motion]
    #[arg(long, value_name = "PX", num_args = 2, allow_negative_numbers = true)]
    pub place_px: Option<Vec<f64>>,
    /// Samples along each streak, where its direction of motion is known
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub along: usize,
    /// Write the SCORE file though the object is elsewhere by its elements
    #[arg(long, requires = "score")]
    pub anyway: bool,
    /// Gain of frames whose headers do not say it (`EGAIN`), e⁻/ADU: without one, σ lacks the target's own photon noise
    #[arg(long, value_name = "E_ADU", allow_negative_numbers = true)]
    pub gain_e_per_adu: Option<f64>,
    /// Streaks have at least so much light, in standard deviations of it
    #[arg(long, value_name = "K", default_value_t = FieldOptions::default().streak_sigmas, allow_negative_numbers = true)]
    pub streak_sigma: f64,
    /// Stars for the zero point: a list with right ascension, declination and magnitudes (CSV, ECSV, VOTable or FITS table)
    #[arg(long, value_name = "FILE")]
    pub catalogue: Option<PathBuf>,
    /// The list's column of magnitudes [default: that of the frames' filter]
    #[arg(long, value_name = "COLUMN", requires = "catalogue")]
    pub catalogue_mag: Option<String>,
    /// The two columns of the list whose difference is the colour [default: the usual of the band, where they are there]
    #[arg(long, value_name = "COLUMN", num_args = 2, requires = "catalogue")]
    pub catalogue_colour: Option<Vec<String>>,
    /// System of the list's magnitudes, where the column's name does not tell
    #[arg(long, value_enum, value_name = "SYSTEM", requires = "catalogue")]
    pub catalogue_system: Option<MagnitudeSystem>,
    /// Right ascension and declination near the frames' middle, deg [default: as their headers say]
    #[arg(
        long,
        value_name = "DEG",
        num_args = 2,
        allow_negative_numbers = true,
        requires = "catalogue"
    )]
    pub near: Option<Vec<f64>>,
    /// Width of a pixel, arcsec [default: as their headers say]
    #[arg(long, value_name = "ARCSEC", requires = "catalogue")]
    pub scale_arcsec: Option<f64>,
    /// Colour of the target and its standard deviation, mag [default: the Sun's ± 0.2]
    #[arg(
        long,
        value_name = "MAG",
        num_args = 2,
        allow_negative_numbers = true,
        requires = "catalogue"
    )]
    pub target_colour: Option<Vec<f64>>,
    /// Elements of the target (two lines), for its range, phase angle and magnitude at 1,000 km; they need --station
    #[arg(long, value_name = "FILE")]
    pub elements: Option<PathBuf>,
    /// Which object of the elements: number or name [default: the only one]
    #[arg(long, value_name = "OBJECT", requires = "elements")]
    pub object: Option<String>,
    /// Also write the magnitudes as the IAU CPS's SCORE takes them (CSV)
    #[arg(long, value_name = "FILE", requires = "elements", requires = "catalogue")]
    pub score: Option<PathBuf>,
    /// E-mail, ORCID and instrument of the observer for --score
    #[arg(long, value_name = "TEXT", num_args = 3, requires = "score")]
    pub observer: Option<Vec<String>>,
    /// Colour term of the filter: magnitudes for a magnitude of colour [default: from the stars]
    #[arg(long, value_name = "K", allow_negative_numbers = true, requires = "catalogue")]
    pub colour_term: Option<f64>,
}

/// System of magnitudes.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum MagnitudeSystem {
    /// Vega has 0 in all bands
    Vega,
    /// AB: the same flux for each frequency has the same magnitude
    #[value(name = "AB", alias = "ab")]
    Ab,
}

impl OtherArgs {
    fn stars(&self) -> anyhow::Result<Option<StarsOptions>> {
        let Some(path) = &self.catalogue else { return Ok(None) };
        let pair =
            |of: &Option<Vec<f64>>| of.as_deref().and_then(|v| Some([*v.first()?, *v.get(1)?]));
        let mut stars = StarsOptions::default();
        stars.list.path.clone_from(path);
        stars.list.magnitude.clone_from(&self.catalogue_mag);
        stars.list.colour = self
            .catalogue_colour
            .as_deref()
            .and_then(|v| Some([v.first()?.clone(), v.get(1)?.clone()]));
        stars.list.system = self.catalogue_system.map(|system| match system {
            MagnitudeSystem::Vega => System::Vega,
            MagnitudeSystem::Ab => System::AB,
        });
        stars.near_deg = pair(&self.near).map(Equatorial::from);
        if let Some(Equatorial { ra_deg: ra, dec_deg: dec }) = stars.near_deg
            && !((-360.0..=360.0).contains(&ra) && (-90.0..=90.0).contains(&dec))
        {
            return Err(Usage(format!(
                "--near is {ra} {dec}, expected a right ascension and a declination in degrees"
            ))
            .into());
        }
        stars.scale_arcsec = self.scale_arcsec;
        if let Some(scale) = self.scale_arcsec.filter(|s| !(1e-3..=1e4).contains(s)) {
            return Err(Usage(format!("--scale-arcsec is {scale}, expected 0.001 to 10000")).into());
        }
        stars.target_colour = pair(&self.target_colour).map(Measured::from);
        if let Some(Measured { value: colour, sigma }) = stars.target_colour
            && !(colour.abs() < 20.0 && (0.0..5.0).contains(&sigma))
        {
            return Err(Usage(format!("--target-colour is {colour} {sigma}, expected a colour and a standard deviation of 0 or above, mag")).into());
        }
        stars.colour_term = self.colour_term.filter(|k| k.is_finite());
        Ok(Some(stars))
    }
}

impl OtherArgs {
    /// Elements and site of the target.
    fn seen_from(
        &self,
        station: &StationArgs,
        first: Option<Epoch>,
    ) -> anyhow::Result<Option<(Tle, Site)>> {
        let Some(path) = &self.elements else { return Ok(None) };
        let sets = elements::read(path)?;
        let chosen = tle::choose(&sets, self.object.as_deref(), first)
            .map_err(|error| Usage(format!("{}: {error} (--object)", path.display())))?;
        let station =
            station.get_or("(--elements needs the place that the target was seen from)")?;
        Ok(Some((chosen.clone(), station.site)))
    }
}

/// How counts become rates.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Counts")]
pub struct CountArgs {
    /// Keep samples with the target within this ellipse of the fibre's field: q = (x/sigma_x)^2 + (y/sigma_y)^2, or `none`
    #[arg(long, value_name = "Q", default_value = "1", allow_hyphen_values = true)]
    pub gate: String,
    /// Do not divide by the fibre's coupling where the target stood
    #[arg(long)]
    pub no_coupling: bool,
    /// The fibres' fields as `sunglint align` found them, in place of the station's
    #[arg(long, value_name = "FILE")]
    pub fibre: Option<PathBuf>,
    /// A target seen this many standard deviations of the fibre's field beside it counts as sky; 0: by the log alone
    #[arg(long, value_name = "K", default_value_t = OFF_SIGMAS, allow_negative_numbers = true)]
    pub off_sigma: f64,
}

/// The error with the option that may help.
pub(crate) fn hint(error: ReduceError) -> anyhow::Error {
    match error {
        ReduceError::Station(error) => with_hint(error),
        error => error.into(),
    }
}

impl ReduceArgs {
    fn options(&self, station: &Station, session: &Session) -> anyhow::Result<ReduceOptions> {
        let mut options = ReduceOptions::for_station(station);
        options.frames = self.frames.options(station)?;
        if let Some(path) = &self.counts.fibre {
            options.fibres = read_fibres(path)?;
        }
        options.off_sigmas = (self.counts.off_sigma > 0.0).then_some(self.counts.off_sigma);
        self.recipe(session)?.apply(&mut options);
        Ok(options)
    }

    /// The recipe that was saved, or what the options say.
    fn recipe(&self, session: &Session) -> anyhow::Result<Recipe> {
        if let Some(wanted) = &self.recipe {
            let named = wanted.to_str().and_then(|name| Recipe::path(session, name));
            let path = named.filter(|path| path.exists()).unwrap_or_else(|| wanted.clone());
            if !path.exists() {
                let names = Recipe::names(session);
                let known = match names.is_empty() {
                    true => "it has none".into(),
                    false => format!("it has {}", names.join(", ")),
                };
                return Err(Usage(format!(
                    "--recipe: there is no file {0}, and session {1} has no reduction {0}: {known}",
                    wanted.display(),
                    session.root().display()
                ))
                .into());
            }
            return Ok(Recipe::read(&path)?);
        }
        let most_q = self.counts.most_q()?;
        Ok(Recipe {
            target: self.target.clone(),
            gate: most_q,
            no_gate: most_q.is_none(),
            no_coupling: self.counts.no_coupling,
            ..self.frames.recipe()
        })
    }
}

impl CountArgs {
    fn most_q(&self) -> anyhow::Result<Option<f64>> {
        if self.gate.eq_ignore_ascii_case("none") {
            return Ok(None);
        }
        let q = self.gate.parse().ok().filter(|q: &f64| q.is_finite() && *q > 0.0);
        q.map(Some).with_context(|| {
            format!("--gate is `{}`, expected a number above 0, or none", self.gate)
        })
    }
}

impl FrameArgs {
    /// `None` for a station without a camera.
    pub(crate) fn options(&self, station: &Station) -> anyhow::Result<Option<FrameOptions>> {
        let sensor =
            SensorFiles { darks: read_frames(&self.dark)?, flats: read_frames(&self.flat)? };
        let Some(mut options) = FrameOptions::for_station(station) else { return Ok(None) };
        options.sensor = sensor;
        options.library = self.library.as_ref().map(Library::open).transpose()?;
        options.timings = self.timing.as_deref().map(read_timings).transpose()?;
        self.recipe().apply_to_frames(&mut options);
        Ok(Some(options))
    }

    /// Returns what was said about frames, as a recipe.
    fn recipe(&self) -> Recipe {
        let pair = |values: &[f64]| Some([*values.first()?, *values.get(1)?]);
        Recipe {
            aperture_px: self.aperture_px,
            annulus_px: self.annulus_px.as_deref().and_then(pair).map(Interval::from),
            fwhm_px: self.fwhm_px,
            detect_sigma: Some(self.detect_sigma),
            max_offset_px: self.max_offset_px,
            brightest: self.brightest,
            trailed: self.trailed,
            ..Recipe::default()
        }
    }
}

fn read_frames(paths: &[PathBuf]) -> anyhow::Result<Vec<Frame>> {
    paths.iter().map(|path| Ok(Frame::read(path)?)).collect()
}

/// The station that was asked for, else the one that the session was recorded with.
pub(crate) fn station(args: &StationArgs, session: &Session) -> anyhow::Result<Station> {
    match &args.station {
        Some(_) => args.get(),
        None => of_session(session),
    }
}

/// Reduces a session.
///
/// # Errors
/// A session, a station or options that cannot be used; a result that cannot be written.
pub fn run(args: &ReduceArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let [folder] = args.inputs.as_slice() else { return run_frames(args, console) };
    if !folder.join("session.toml").exists() && (!folder.is_dir() || has_frames(folder)) {
        return run_frames(args, console);
    }
    if args.reading.extension.is_some() || args.reading.bayer.is_some() {
        return Err(
            Usage("--extension and --bayer are about frames of other programs".into()).into()
        );
    }
    if args.raw && args.out.output.is_empty() {
        return Err(Usage("--raw writes files: give -o FOLDER/".into()).into());
    }
    let session = Session::open(folder)?;
    let station = station(&args.station, &session)?;
    let options = args.options(&station, &session)?;
    let progress = Bar::new(console);
    progress.begin("frames and bins", None);
    let folders = args.out.folders();
    folders.check_names(&report::file_names(&stays(&session)?, args.raw))?;
    let mut night = reduce(&session, &station, &options, &progress)?;
    progress.end();
    let mut visits = Vec::new();
    // One visit after the other, so that a night of any length fits into memory.
    while let Some(visited) = night.take(&session, &station)? {
        for product in report::products(&visited, &station, args.raw)? {
            folders.write_files(&folders.files_of(&product)?, console)?;
        }
        visits.push(report::VisitLine::of(&visited));
    }
    for warning in station.warnings.iter().chain(&night.warnings) {
        console.warn(warning);
    }
    let name = folder.display().to_string();
    let product = report::product(&night, &visits, &name, &station.name);
    args.out.finish(&product, &report::text(&night, &visits, &name, &station.name), console)
}

/// Whether a folder that is no session has frames of another program.
fn has_frames(folder: &std::path::Path) -> bool {
    crate::detect::files_of(&[folder.to_path_buf()]).is_ok()
}

/// Reduces frames of other programs.
fn run_frames(args: &ReduceArgs, console: Console) -> anyhow::Result<()> {
    let mut inputs = Vec::new();
    for path in &args.inputs {
        if !path.exists() {
            // The error of a session's folder that is not there.
            Session::open(path)?;
        }
        if path.join("session.toml").exists() {
            let path = path.display();
            return Err(Usage(format!(
                "{path} is a session: reduce it by itself, without other files or folders"
            ))
            .into());
        }
        inputs.push(path.clone());
    }
    let of_sessions =
        args.target.is_some() || args.recipe.is_some() || args.frames.library.is_some();
    if args.raw || of_sessions || args.frames.timing.is_some() {
        return Err(Usage(
            "--raw, --target, --recipe, --library and --timing are about sessions, not frames of other programs".into(),
        )
        .into());
    }
    let files = crate::detect::files_of(&inputs)?;
    let mut options = FolderOptions::default();
    options.reading = args.reading.options();
    options.field.fwhm_px = args.frames.fwhm_px;
    options.field.aperture_px = args.frames.aperture_px;
    options.field.point_sigmas = args.frames.detect_sigma;
    options.field.streak_sigmas = args.others.streak_sigma;
    if let Some(gain) = args.others.gain_e_per_adu {
        if !(gain.is_finite() && gain > 0.0) {
            return Err(
                Usage(format!("--gain-e-per-adu is {gain}, expected electrons above 0")).into()
            );
        }
        options.field.gain_e_per_adu = Some(gain);
    }
    options.place_px =
        args.others.place_px.as_deref().and_then(|p| Some(DVec2::new(*p.first()?, *p.get(1)?)));
    options.parts = args.others.along;
    options.stars = args.others.stars()?;
    let first = first_time(&files, &options.reading);
    options.seen_from = args.others.seen_from(&args.station, first)?;
    options.inputs.extend(args.others.elements.clone());
    options.command = crate::program::command_line();
    options.darks.clone_from(&args.frames.dark);
    options.flats.clone_from(&args.frames.flat);
    let progress = Bar::new(console);
    progress.begin("frames", Some(files.len() as u64));
    let reduced = reduce_frames(&files, &options, &progress)?;
    progress.end();
    let names: Vec<String> = args.inputs.iter().map(|p| p.display().to_string()).collect();
    let name = names.join(", ");
    if let Some(object) = reduced.object.as_ref().filter(|o| o.elements_age_days.abs() > OLD_DAYS) {
        console.warn(&format!(
            "the elements of {} are {:.1} days from the frames: ranges of low orbits may be off by kilometres",
            object.object, object.elements_age_days
        ));
    }
    let below = reduced.frames.iter().filter_map(|f| f.sight).any(|s| s.altitude_deg < 0.0);
    let off_deg = reduced.off_elements_deg.filter(|off| *off > MOST_OFF_DEG);
    let elsewhere = match (off_deg, below) {
        (Some(off), _) => {
            Some(format!("the frames look {off:.0}° beside where its elements have it"))
        }
        (None, true) => Some("by its elements it is below the horizon".to_owned()),
        (None, false) => None,
    };
    if let (Some(object), Some(why)) = (&reduced.object, &elsewhere) {
        console.warn(&format!(
            "{} is not what was measured: {why}; ranges, phases and magnitudes at 1,000 km are wrong",
            object.object
        ));
        if args.others.score.is_some() && !args.others.anyway {
            bail!("no SCORE file is written of another object (--anyway writes it)");
        }
    }
    let product = folder::whole(&reduced, &name)?;
    if let Some(path) = &args.others.score {
        score(&reduced, path, args, console)?;
    }
    let text = folder::text(&reduced, &name);
    let frames = &reduced.frames;
    if args.others.catalogue.is_some() && frames.iter().all(|f| f.zero_point.is_none()) {
        console.warn("no frame has a zero point by the list: rates stay in ADU/s (each frame's remark says why; a list needs right ascension in degrees and a magnitude)");
    }
    args.out.finish(&product, &text, console)?;
    if frames.iter().all(|f| f.rate_adu_per_s.is_none_or(f64::is_nan)) {
        bail!(
            "none of {} frames gave a rate: no target was found that moves or stands at the place asked for (left out: {})",
            frames.len(),
            reduced.summary()
        );
    }
    Ok(())
}

/// A target farther from where its elements have it is another object, deg: elements of a week ago are off by minutes of time, some degrees of a low orbit.
const MOST_OFF_DEG: f64 = 5.0;
/// Elements farther from the frames than this are warned of.
const OLD_DAYS: f64 = 7.0;

/// Time of the first file that has one: of several sets of an object the nearest is taken.
fn first_time(files: &[PathBuf], options: &ReadOptions) -> Option<Epoch> {
    let read = |file: &PathBuf| ImageFrame::read_as(file, options).ok();
    files.iter().find_map(|file| read(file)?.header.time.map(|time| time.middle))
}

/// Writes the magnitudes as SCORE takes them.
fn score(
    reduced: &folder_of_frames::Folder,
    path: &std::path::Path,
    args: &ReduceArgs,
    console: Console,
) -> anyhow::Result<()> {
    let mut observer = folder::Observer::default();
    if let Some([email, orcid, instrument]) = args.others.observer.as_deref() {
        (observer.email, observer.orcid, observer.instrument) =
            (email.clone(), orcid.clone(), instrument.clone());
    } else {
        console
            .warn("SCORE asks for e-mail, ORCID and instrument: --observer EMAIL ORCID INSTRUMENT");
    }
    match folder::score(reduced, &observer)? {
        Some(bytes) => args.out.write_files(&[(path.to_path_buf(), bytes)], console).map(|_| ()),
        None => {
            console.warn(&format!("no frame has a magnitude: {} was not written", path.display()));
            Ok(())
        }
    }
}
