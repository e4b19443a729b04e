//! `sunglint reduce`: a session's frames and counts, visit by visit, as linear light curves.

pub mod counts;
mod figure;
pub mod frames;
pub mod join;
pub mod night;
mod report;
mod seeing;
pub mod sky;
pub mod tags;

use crate::output::{Console, OutputArgs, Usage};
use crate::station::StationArgs;
use anyhow::Context as _;
use clap::Args;
use hifitime::Epoch;
use indicatif::{ProgressBar, ProgressStyle};
use night::{ReduceOptions, Visited, reduce};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use sunglint_calibration::photometry::{Choice, PhotometryOptions, Scintillation, Trail};
use sunglint_formats::Frame;
use sunglint_formats::session::{Session, Target};
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::station::Station;
use sunglint_report::Product;

/// What takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
/// Without a terminal, progress is a line on stderr so often.
const LINES: Duration = Duration::from_secs(10);
/// Young's coefficient of the scintillation: the middle of the sites of Osborn et al. 2015.
const SCINTILLATION: f64 = 1.5;
const APERTURE_PX: f64 = 8.0;
/// Of the aperture's radius.
const ANNULUS: [f64; 2] = [1.5, 2.5];
/// Where no frame tells.
const FWHM_PX: f64 = 4.0;
const DETECT_SIGMAS: f64 = 6.0;
const OFF_SIGMAS: f64 = 5.0;
/// The name of the summary's files.
const SUMMARY: &str = "summary";

/// A stay of the telescope, as the session's log has it, with an end.
#[derive(Debug, Clone, PartialEq)]
pub struct Stay {
    /// What it looked at.
    pub target: Target,
    /// Which stay at a target of this name it is, from 1.
    pub number: u32,
    /// When it began.
    pub from: Epoch,
    /// When it ended: the log's word, else the end of what was recorded.
    pub to: Epoch,
}

/// Told of progress; may end the work.
pub trait Stop {
    /// So many frames or bins further.
    ///
    /// # Errors
    /// The work is to end.
    fn step(&mut self, count: u64) -> anyhow::Result<()>;
}

/// Arguments of `sunglint reduce`.
#[derive(Debug, Args)]
pub struct ReduceArgs {
    /// The session's folder, as `sunglint observe` made it
    pub session: PathBuf,
    /// Only the visits of this target
    #[arg(long, value_name = "NAME")]
    pub target: Option<String>,
    /// Also write the rates as they were counted (`NAME_raw.ecsv`)
    #[arg(long)]
    pub raw: bool,
    /// How frames are measured.
    #[command(flatten)]
    pub frames: FrameArgs,
    /// How counts become rates.
    #[command(flatten)]
    pub counts: CountArgs,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
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
    /// Of several sources take the brightest, not the one nearest to the middle
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

impl Default for FrameArgs {
    fn default() -> Self {
        Self {
            aperture_px: None,
            annulus_px: None,
            fwhm_px: None,
            max_offset_px: None,
            detect_sigma: DETECT_SIGMAS,
            brightest: false,
            trailed: false,
            dark: Vec::new(),
            flat: Vec::new(),
        }
    }
}

impl Default for CountArgs {
    fn default() -> Self {
        Self { gate: "1".into(), no_coupling: false, fibre: None, off_sigma: OFF_SIGMAS }
    }
}

impl ReduceOptions {
    /// What `sunglint reduce` does when it is told nothing.
    ///
    /// # Errors
    /// None that a station could have.
    pub fn default_for(station: &Station) -> anyhow::Result<Self> {
        options(&FrameArgs::default(), &CountArgs::default(), None, station)
    }
}

/// A recorded session as `sunglint reduce` would write it without options: the linear curve of each visit, and warnings.
///
/// # Errors
/// As [`night::reduce`].
pub fn light_curves(
    folder: &Path,
    stop: &mut dyn Stop,
) -> anyhow::Result<(Vec<LightCurve>, Vec<String>)> {
    let (curves, warnings) = light_curves_by_name(folder, stop)?;
    Ok((curves.into_iter().map(|(_, curve)| curve).collect(), warnings))
}

/// A light curve with the name of its files.
pub type NamedCurve = (String, LightCurve);

/// The same, each with the name of its files.
///
/// # Errors
/// As [`night::reduce`].
pub fn light_curves_by_name(
    folder: &Path,
    stop: &mut dyn Stop,
) -> anyhow::Result<(Vec<NamedCurve>, Vec<String>)> {
    let session = Session::open(folder)?;
    let station = crate::station::of_session(&session)?;
    let options = ReduceOptions::default_for(&station)?;
    let mut night = reduce(&session, &station, &options, stop)?;
    let mut curves = Vec::new();
    while let Some(visited) = night.take(&session, &station)? {
        curves.push((report::file_name(&visited.stay), visited.linear));
    }
    Ok((curves, night.warnings))
}

/// The options that arguments ask for.
///
/// # Errors
/// Numbers out of their range, files that cannot be read.
pub fn options(
    frames: &FrameArgs,
    counts: &CountArgs,
    target: Option<&str>,
    station: &Station,
) -> anyhow::Result<ReduceOptions> {
    let mut of_counts = counts::CountOptions::default();
    of_counts.bins.gate = counts::gate(counts.most_q()?, !counts.no_coupling);
    Ok(ReduceOptions {
        frames: frames.options(station)?,
        counts: of_counts,
        fibres: counts
            .fibre
            .as_deref()
            .map(crate::align::read_fibres)
            .transpose()?
            .unwrap_or_default(),
        off_sigmas: (counts.off_sigma > 0.0).then_some(counts.off_sigma),
        target: target.map(str::to_owned),
    })
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
    pub(crate) fn options(
        &self,
        station: &Station,
    ) -> anyhow::Result<Option<frames::FrameOptions>> {
        let sensor = frames::SensorFiles {
            darks: read_frames(&self.dark)?,
            flats: read_frames(&self.flat)?,
        };
        let fwhm_from_frames = self.fwhm_px.is_none();
        let aperture_from_frames = self.aperture_px.is_none() && self.annulus_px.is_none();
        let options = |photometry| frames::FrameOptions {
            photometry,
            fwhm_from_frames,
            aperture_from_frames,
            sensor,
        };
        Ok(self.photometry(station).map(options))
    }

    fn photometry(&self, station: &Station) -> Option<PhotometryOptions> {
        let camera = station.camera.as_ref()?;
        let mut options = PhotometryOptions::new(camera.size_px, camera.read_noise_e);
        options.gain_e_per_adu = Some(camera.gain_e_per_adu);
        options.saturation_adu = Some(camera.saturation_adu());
        options.aperture_radius_px = self.aperture_px.unwrap_or(APERTURE_PX);
        options.annulus_px = match self.annulus_px.as_deref() {
            Some([inner, outer, ..]) => [*inner, *outer],
            _ => ANNULUS.map(|part| part * options.aperture_radius_px),
        };
        options.fwhm_px = self.fwhm_px.unwrap_or(FWHM_PX);
        options.trail = if self.trailed { Trail::Estimated } else { Trail::Point };
        options.detection.threshold_sigma = self.detect_sigma;
        options.detection.max_offset_px = self.max_offset_px.unwrap_or(f64::INFINITY);
        options.detection.choice = if self.brightest { Choice::Brightest } else { Choice::Nearest };
        options.scintillation = Some(Scintillation {
            diameter_m: station.telescope.primary_diameter_m,
            altitude_m: station.site.geodetic().height_m,
            coefficient: SCINTILLATION,
        });
        Some(options)
    }
}

fn read_frames(paths: &[PathBuf]) -> anyhow::Result<Vec<Frame>> {
    paths.iter().map(|path| Ok(Frame::read(path)?)).collect()
}

/// The station that was asked for, else the one that the session was recorded with.
pub(crate) fn station(args: &StationArgs, session: &Session) -> anyhow::Result<Station> {
    match &args.station {
        Some(_) => args.get(),
        None => crate::station::of_session(session),
    }
}

/// Reduces a session.
///
/// # Errors
/// A session, a station or options that cannot be used; a result that cannot be written.
pub fn run(args: &ReduceArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if args.raw && args.out.output.is_empty() {
        return Err(Usage("--raw writes files: give -o FOLDER/".into()).into());
    }
    let session = Session::open(&args.session)?;
    let station = station(&args.station, &session)?;
    let options = options(&args.frames, &args.counts, args.target.as_deref(), &station)?;
    let mut progress = Progress::new(console);
    let folders = args.out.folders();
    folders.check_names(&args.names(&night::stays(&session)?))?;
    let mut night = reduce(&session, &station, &options, &mut progress)?;
    progress.bar.finish_and_clear();
    let mut visits = Vec::new();
    // One visit after the other, so that a night of any length fits into memory.
    while let Some(visited) = night.take(&session, &station)? {
        for product in args.products(&visited, &station)? {
            folders.write_files(&folders.files_of(&product)?, console)?;
        }
        visits.push(report::VisitLine::of(&visited));
    }
    for warning in station.warnings.iter().chain(&night.warnings) {
        console.warn(warning);
    }
    let name = args.session.display().to_string();
    let product = Product {
        name: SUMMARY.into(),
        table: report::table(&visits),
        json: report::json(&night, &visits, &name, &station.name),
        ..Product::default()
    };
    args.out.finish(&product, &report::text(&night, &visits, &name, &station.name), console)
}

impl ReduceArgs {
    /// The names of the files that visits may become.
    fn names(&self, stays: &[Stay]) -> Vec<String> {
        let on = stays.iter().filter(|stay| stay.target.on);
        let of = |stay: &Stay| {
            let name = report::file_name(stay);
            ["ecsv", "png", "svg"]
                .iter()
                .flat_map(|extension| {
                    [format!("{name}.{extension}"), format!("{name}_frames.{extension}")]
                })
                .chain(self.raw.then(|| format!("{name}_raw.ecsv")))
                .collect::<Vec<_>>()
        };
        on.flat_map(of).chain([format!("{SUMMARY}.ecsv")]).collect()
    }

    /// The curves and frames of a visit.
    fn products(&self, visited: &Visited, station: &Station) -> anyhow::Result<Vec<Product>> {
        let name = report::file_name(&visited.stay);
        let figure = figure::curves(visited, station);
        let mut products = vec![Product {
            name: name.clone(),
            table: visited.linear.to_table()?,
            figure: (!figure.panels.is_empty()).then_some(figure),
            ..Product::default()
        }];
        if let Some(raw) = visited.raw.as_ref().filter(|_| self.raw) {
            let name = format!("{name}_raw");
            products.push(Product { name, table: raw.to_table()?, ..Product::default() });
        }
        products.extend(figure::rings(visited).map(|gallery| Product {
            name: format!("{name}_frames"),
            gallery: Some(gallery),
            ..Product::default()
        }));
        Ok(products)
    }
}

/// A bar for what takes longer than a second; without a terminal, lines.
pub(crate) struct Progress {
    start: Instant,
    /// When the last line was written, after the start.
    said: Duration,
    pub(crate) bar: ProgressBar,
    quiet: bool,
    shown: bool,
    done: u64,
}

impl Progress {
    pub(crate) fn new(console: Console) -> Self {
        Self {
            start: Instant::now(),
            said: Duration::ZERO,
            bar: ProgressBar::hidden(),
            quiet: console.quiet,
            shown: false,
            done: 0,
        }
    }
}

impl Stop for Progress {
    fn step(&mut self, count: u64) -> anyhow::Result<()> {
        self.done += count;
        if self.quiet {
            return Ok(());
        }
        let elapsed = self.start.elapsed();
        if !self.shown && elapsed > PATIENCE {
            // Hidden where stderr is no terminal.
            self.bar = ProgressBar::new_spinner();
            if let Ok(style) =
                ProgressStyle::with_template("{spinner} {pos} frames and bins ({elapsed})")
            {
                self.bar.set_style(style);
            }
            self.shown = true;
        }
        if self.bar.is_hidden() && elapsed >= self.said + LINES {
            self.said = elapsed;
            eprintln!("{} frames and bins in {:.0} s", self.done, elapsed.as_secs_f64());
        }
        if self.shown && self.done.is_multiple_of(256) {
            self.bar.set_position(self.done);
        }
        Ok(())
    }
}
