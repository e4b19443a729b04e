//! `sunglint reduce`: a session's frames and counts, visit by visit, as linear light curves.

pub mod counts;
mod figure;
pub mod frames;
pub mod join;
pub mod night;
mod report;
pub mod sky;

use crate::output::{Console, OutputArgs, Product, Usage};
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::Epoch;
use indicatif::{ProgressBar, ProgressStyle};
use night::{ReduceOptions, Reduced, reduce};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use sunglint_calibration::photometry::{Choice, PhotometryOptions, Scintillation, Trail};
use sunglint_formats::Frame;
use sunglint_formats::session::{Session, Target};
use sunglint_radiometry::station::Station;

/// What takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
/// Young's coefficient of the scintillation: the middle of the sites of Osborn et al. 2015.
const SCINTILLATION: f64 = 1.5;

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
    /// Radius of the aperture, px
    #[arg(long, value_name = "PX", default_value_t = 8.0, allow_negative_numbers = true)]
    pub aperture_px: f64,
    /// Inner and outer radius of the annulus for the background, px
    #[arg(long, value_name = "PX", num_args = 2, default_values_t = [12.0, 20.0], allow_negative_numbers = true)]
    pub annulus_px: Vec<f64>,
    /// Width of a point at half its maximum, px
    #[arg(long, value_name = "PX", default_value_t = 4.0, allow_negative_numbers = true)]
    pub fwhm_px: f64,
    /// A target is at most so far from the frame's middle, px [default: anywhere]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub max_offset_px: Option<f64>,
    /// A target stands out of the background by so many standard deviations
    #[arg(long, value_name = "K", default_value_t = 6.0, allow_negative_numbers = true)]
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
    #[arg(long, value_name = "K", default_value_t = 5.0, allow_negative_numbers = true)]
    pub off_sigma: f64,
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
    pub(crate) fn options(&self, station: &Station) -> anyhow::Result<PhotometryOptions> {
        let Some(camera) = &station.camera else {
            bail!(
                "station {} has no [camera]: its size and noise are needed to measure frames",
                station.name
            );
        };
        let mut options = PhotometryOptions::new(camera.size_px, camera.read_noise_e);
        options.gain_e_per_adu = Some(camera.gain_e_per_adu);
        options.saturation_adu = Some(camera.saturation_adu());
        options.aperture_radius_px = self.aperture_px;
        options.annulus_px = [self.annulus_px[0], self.annulus_px[1]];
        options.fwhm_px = self.fwhm_px;
        options.trail = if self.trailed { Trail::Estimated } else { Trail::Point };
        options.detection.threshold_sigma = self.detect_sigma;
        options.detection.max_offset_px = self.max_offset_px.unwrap_or(f64::INFINITY);
        options.detection.choice = if self.brightest { Choice::Brightest } else { Choice::Nearest };
        options.scintillation = Some(Scintillation {
            diameter_m: station.telescope.primary_diameter_m,
            altitude_m: station.site.geodetic().height_m,
            coefficient: SCINTILLATION,
        });
        Ok(options)
    }
}

pub(crate) fn read_frames(paths: &[PathBuf]) -> anyhow::Result<Vec<Frame>> {
    paths.iter().map(|path| Ok(Frame::read(path)?)).collect()
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
    let station = args.station.get_or(&session.manifest().station)?;
    let options = args.options(&station)?;
    let mut progress = Progress::new(console);
    let night = reduce(&session, &station, &options, &mut progress)?;
    progress.bar.finish_and_clear();
    for warning in station.warnings.iter().chain(&night.warnings) {
        console.warn(warning);
    }
    let name = args.session.display().to_string();
    let product = args.product(&night, &station, &name)?;
    args.out.finish(&product, &report::text(&night, &name, &station.name), console)
}

impl ReduceArgs {
    fn options(&self, station: &Station) -> anyhow::Result<ReduceOptions> {
        let off_sigmas = (self.counts.off_sigma > 0.0).then_some(self.counts.off_sigma);
        let mut counts = counts::CountOptions::default();
        counts.bins.gate = counts::gate(self.counts.most_q()?, !self.counts.no_coupling);
        Ok(ReduceOptions {
            photometry: self.frames.options(station)?,
            counts,
            fibres: self
                .counts
                .fibre
                .as_deref()
                .map(crate::align::read_fibres)
                .transpose()?
                .unwrap_or_default(),
            sensor: frames::SensorFiles {
                darks: read_frames(&self.frames.dark)?,
                flats: read_frames(&self.frames.flat)?,
            },
            off_sigmas,
            target: self.target.clone(),
        })
    }

    /// The summary, and beside it the curves and frames of each visit.
    fn product(
        &self,
        night: &Reduced,
        station: &Station,
        session: &str,
    ) -> anyhow::Result<Product> {
        let annulus_px = [self.frames.annulus_px[0], self.frames.annulus_px[1]];
        let mut others = Vec::new();
        for visited in &night.visits {
            let name = report::file_name(visited);
            let figure = figure::curves(visited, station);
            others.push(Product {
                name: name.clone(),
                table: visited.linear.to_table()?,
                figure: (!figure.panels.is_empty()).then_some(figure),
                ..Product::default()
            });
            if let Some(raw) = visited.raw.as_ref().filter(|_| self.raw) {
                let name = format!("{name}_raw");
                others.push(Product { name, table: raw.to_table()?, ..Product::default() });
            }
            others.extend(figure::rings(visited, annulus_px).map(|gallery| Product {
                name: format!("{name}_frames"),
                gallery: Some(gallery),
                ..Product::default()
            }));
        }
        Ok(Product {
            name: "summary".into(),
            table: report::table(night),
            json: report::json(night, session, &station.name),
            others,
            ..Product::default()
        })
    }
}

/// A bar for what takes longer than a second.
pub(crate) struct Progress {
    start: Instant,
    pub(crate) bar: ProgressBar,
    quiet: bool,
    shown: bool,
    done: u64,
}

impl Progress {
    pub(crate) fn new(console: Console) -> Self {
        Self {
            start: Instant::now(),
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
        if !self.shown && !self.quiet && self.start.elapsed() > PATIENCE {
            // Hidden where stderr is no terminal.
            self.bar = ProgressBar::new_spinner();
            if let Ok(style) =
                ProgressStyle::with_template("{spinner} {pos} frames and bins ({elapsed})")
            {
                self.bar.set_style(style);
            }
            self.shown = true;
        }
        if self.shown && self.done.is_multiple_of(256) {
            self.bar.set_position(self.done);
        }
        Ok(())
    }
}
