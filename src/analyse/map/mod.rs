//! `sunglint analyse map`: samples, or all directions, on the body's frame.

mod full;
mod plane;
mod quality;
mod report;
mod samples;

use crate::output::{Console, OutputArgs, Usage};
use crate::simulate::read as read_pass;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use samples::Taken;
use std::path::PathBuf;
use sunglint_simulator::pass::Overrides;

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
    pub spin: quality::QualityArgs,
    /// Which station, in place of the scene's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Makes the maps.
pub fn run(args: &MapArgs, console: Console) -> anyhow::Result<()> {
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
    let mut warnings = Vec::new();
    if let (true, Some(curve)) = (args.spin.quality, &args.curve) {
        let taken = Taken::read(&pass, curve, &[], &mut warnings).with_context(name)?;
        let answer = quality::answer(&args.spin, &taken, args.step_deg, warnings, console)
            .with_context(|| curve.display().to_string())?;
        for warning in answer.warnings() {
            console.warn(warning);
        }
        return args.out.finish(&answer.product()?, &answer.text(), console);
    }
    if !pass.attitude_given {
        bail!(
            "{}: no [attitude]: without it nobody knows how the body is turned, and nothing can stand on its frame",
            args.pass.display()
        );
    }
    let endmembers = match args.endmembers.is_empty() {
        true => Vec::new(),
        false => super::unmix::endmembers(&args.endmembers, &mut warnings)?.0,
    };
    let answer = match &args.curve {
        Some(curve) => samples::answer(args, &pass, curve, &endmembers, warnings),
        None => full::answer(args, &pass, &endmembers, warnings),
    };
    let answer = answer.with_context(name)?;
    for warning in &answer.warnings {
        console.warn(warning);
    }
    args.out.finish(&answer.product()?, &answer.text(), console)
}
