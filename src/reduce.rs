//! `sunglint reduce`: a session's frames and counts, visit by visit, as linear light curves.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::station::{StationArgs, of_session, with_hint};
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_calibration::alignment::read_fibres;
use sunglint_calibration::photometry::{Choice, Trail};
use sunglint_calibration::reduction::counts::gate;
use sunglint_calibration::reduction::frames::{DETECT_SIGMAS, FrameOptions, SensorFiles};
use sunglint_calibration::reduction::night::OFF_SIGMAS;
use sunglint_calibration::reduction::{ReduceError, ReduceOptions, reduce, stays};
use sunglint_formats::Frame;
use sunglint_formats::session::Session;
use sunglint_numerics::progress::Progress as _;
use sunglint_radiometry::station::Station;
use sunglint_report::reduce as report;

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

/// The error with the option that may help.
pub(crate) fn hint(error: ReduceError) -> anyhow::Error {
    match error {
        ReduceError::Station(error) => with_hint(error),
        error => error.into(),
    }
}

impl ReduceArgs {
    fn options(&self, station: &Station) -> anyhow::Result<ReduceOptions> {
        let mut options = ReduceOptions::for_station(station);
        options.counts.bins.gate = gate(self.counts.most_q()?, !self.counts.no_coupling);
        options.frames = self.frames.options(station)?;
        if let Some(path) = &self.counts.fibre {
            options.fibres = read_fibres(path)?;
        }
        options.off_sigmas = (self.counts.off_sigma > 0.0).then_some(self.counts.off_sigma);
        options.target.clone_from(&self.target);
        Ok(options)
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
        options.fwhm_from_frames = self.fwhm_px.is_none();
        options.aperture_from_frames = self.aperture_px.is_none() && self.annulus_px.is_none();
        if let Some(radius_px) = self.aperture_px {
            options.set_aperture(radius_px);
        }
        let photometry = &mut options.photometry;
        if let Some([inner, outer, ..]) = self.annulus_px.as_deref() {
            photometry.annulus_px = [*inner, *outer];
        }
        photometry.fwhm_px = self.fwhm_px.unwrap_or(photometry.fwhm_px);
        photometry.trail = if self.trailed { Trail::Estimated } else { Trail::Point };
        photometry.detection.threshold_sigma = self.detect_sigma;
        photometry.detection.max_offset_px = self.max_offset_px.unwrap_or(f64::INFINITY);
        photometry.detection.choice =
            if self.brightest { Choice::Brightest } else { Choice::Nearest };
        Ok(Some(options))
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
    if args.raw && args.out.output.is_empty() {
        return Err(Usage("--raw writes files: give -o FOLDER/".into()).into());
    }
    let session = Session::open(&args.session)?;
    let station = station(&args.station, &session)?;
    let options = args.options(&station)?;
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
    let name = args.session.display().to_string();
    let product = report::product(&night, &visits, &name, &station.name);
    args.out.finish(&product, &report::text(&night, &visits, &name, &station.name), console)
}
