//! `sunglint analyse map`: samples, or all directions, on the body's frame.

use super::given::worded;
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::simulate::read as read_pass;
use crate::station::StationArgs;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use sunglint_analysis::map::Grid;
use sunglint_inference::map::{
    MapError, MapOptions, PlacedCurve, SpinOptions, SpinQuality, SpinQualityError, TRIED,
    map_directions, map_samples, spin_quality,
};
use sunglint_inference::unmix::Materials;
use sunglint_report::map;
use sunglint_simulator::pass::{Overrides, Pass};

/// Arguments of `sunglint analyse map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    /// The scene: it says how the body is turned, and where Sun and station stand (docs/pass.md)
    pub pass: PathBuf,
    /// The curve whose samples are placed: calibrated or predicted rates (ECSV), or spectra (FITS). Without it the scene's body is mapped over all directions
    #[arg(long, value_name = "FILE")]
    pub curve: Option<PathBuf>,
    /// Maps of materials too: built-in ones, a target, or a file, as in `analyse unmix`
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',')]
    pub endmembers: Vec<String>,
    /// Step of the cells, degrees
    #[arg(long, value_name = "DEG", default_value_t = 5.0, allow_negative_numbers = true)]
    pub step_deg: f64,
    /// Phase angle of a map over all directions, degrees [default: the mean along the visible part of the pass]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, conflicts_with = "curve")]
    pub phase: Option<f64>,
    /// Also the curve that this map gives along the pass, beside the simulated one: the error of maps as a shortcut
    #[arg(long, conflicts_with = "curve")]
    pub along: bool,
    /// Also maps of the range, as a laser of this wavelength (vacuum nm) beside the telescope finds it
    #[arg(long, value_name = "NM", allow_negative_numbers = true, conflicts_with = "curve")]
    pub ranges_nm: Option<f64>,
    /// How well a spin fits.
    #[command(flatten)]
    pub spin: QualityArgs,
    /// Which station, in place of the scene's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Arguments of the measure.
#[derive(Debug, Args)]
#[command(next_help_heading = "A spin of a body of unknown shape")]
pub struct QualityArgs {
    /// How well the samples of --curve agree from turn to turn on the body's frame, for axes all over the sky and periods about --period. The scene says where Sun and station stand; its
    /// target and attitude are not looked at
    #[arg(long, requires = "curve", requires = "period")]
    pub quality: bool,
    /// The sidereal period about which the measure looks, s (`analyse period` finds it)
    #[arg(long, value_name = "S", allow_negative_numbers = true, requires = "quality")]
    pub period: Option<f64>,
    /// Periods up to so much longer and shorter, percent
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0, allow_negative_numbers = true)]
    pub within_percent: f64,
    /// Step of the axes, degrees
    #[arg(long, value_name = "DEG", default_value_t = 10.0, allow_negative_numbers = true)]
    pub axes_deg: f64,
}

impl QualityArgs {
    /// The period and the part of it by which others may differ.
    ///
    /// # Errors
    /// Arguments that are no map.
    pub fn check(&self) -> anyhow::Result<(f64, f64)> {
        let period = self.period.unwrap_or(f64::NAN);
        if !(period.is_finite() && period > 0.0) {
            return Err(Usage(format!("--period is {period}, expected seconds above 0")).into());
        }
        let within = self.within_percent;
        if !(0.0..=50.0).contains(&within) {
            return Err(Usage(format!("--within-percent is {within}, expected 0 to 50")).into());
        }
        Ok((period, 0.01 * within))
    }
}

/// Makes the maps.
pub(super) fn run(args: &MapArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    args.out.check_names(&[if args.spin.quality {
        "spin_quality.fits"
    } else {
        "body_map.fits"
    }])?;
    if let Some(deg) = args.phase
        && !(0.0..180.0).contains(&deg)
    {
        return Err(Usage(format!("--phase is {deg}°, expected 0 to less than 180")).into());
    }
    if args.spin.quality {
        args.spin.check()?;
    }
    if args.spin.quality || args.curve.is_none() && !args.along {
        let tabular = |p: &&PathBuf| {
            p.as_os_str() == "-"
                || p.extension().is_some_and(|e| {
                    e.eq_ignore_ascii_case("ecsv") || e.eq_ignore_ascii_case("csv")
                })
        };
        if let Some(path) = args.out.output.iter().find(tabular) {
            let text = format!(
                "-o {}: a map is no table: .fits has its numbers, .png and .svg show it; with --along there is a table",
                path.display()
            );
            return Err(Usage(text).into());
        }
    }
    let pass = read_pass(&args.pass, &args.station, Overrides::default())?;
    let name = || args.pass.display().to_string();
    if let (true, Some(curve)) = (args.spin.quality, &args.curve) {
        return quality(args, &pass, curve, console);
    }
    if !pass.attitude_given {
        bail!(
            "{}: no [attitude]: without it nobody knows how the body is turned, and nothing can stand on its frame",
            args.pass.display()
        );
    }
    let materials = Materials::read(&args.endmembers)?;
    let grid = Grid::new(args.step_deg).with_context(name)?;
    let maps = match &args.curve {
        Some(curve) => map_samples(&pass, curve, &materials, grid),
        None => {
            let options = MapOptions {
                phase_deg: args.phase,
                along: args.along,
                ranges_nm: args.ranges_nm,
                ..MapOptions::new(grid)
            };
            map_directions(&pass, &materials, &options)
        }
    };
    let maps = maps.map_err(refused).with_context(name)?;
    for warning in &maps.warnings {
        console.warn(warning);
    }
    args.out.finish(&map::product(&maps)?, &map::text(&maps), console)
}

/// Measures how well the samples of a curve agree on the frame of a spin.
fn quality(args: &MapArgs, pass: &Pass, curve: &Path, console: Console) -> anyhow::Result<()> {
    let placed = PlacedCurve::read(pass, curve, &Materials::default());
    let placed = placed.map_err(refused).with_context(|| args.pass.display().to_string())?;
    let mut found = spins(args, &placed, console).with_context(|| curve.display().to_string())?;
    for warning in &mut found.warnings {
        if warning.ends_with(TRIED) {
            warning.push_str(": give a larger --within-percent");
        }
        console.warn(warning);
    }
    args.out.finish(&map::quality::product(&found)?, &map::quality::text(&found), console)
}

fn spins(args: &MapArgs, placed: &PlacedCurve, console: Console) -> anyhow::Result<SpinQuality> {
    let (period_s, within) = args.spin.check()?;
    let (cells, axes) = (Grid::new(args.step_deg)?, Grid::new(args.spin.axes_deg)?);
    let options = SpinOptions { period_s, within, cells, axes };
    let spinner = Bar::new(console);
    let found = spin_quality(placed, &options, &spinner);
    spinner.end();
    found.map_err(|error| match error {
        SpinQualityError::Periods { .. } => {
            anyhow!("{error}: give a smaller --within-percent or larger cells (--step-deg)")
        }
        SpinQualityError::Cells { .. } => {
            anyhow!("{}", error.to_string().replace("larger cells", "larger cells (--step-deg)"))
        }
        error => error.into(),
    })
}

/// The error with the option or the command that may help.
fn refused(error: MapError) -> anyhow::Error {
    match error {
        MapError::Samples(error) => worded(error),
        error => error.into(),
    }
}
