//! `sunglint detect`: points and streaks of single frames.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use anyhow::bail;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use sunglint_calibration::photometry::PhotometryError;
use sunglint_calibration::photometry::field::{FieldOptions, constant, find};
use sunglint_formats::FileError;
use sunglint_formats::frame::Bayer;
use sunglint_formats::image_frame::{Extension, ImageFrame, Mosaic, ReadOptions};
use sunglint_numerics::progress::Progress as _;
use sunglint_report::detect::{self as report, Detected};

/// Arguments of `sunglint detect`.
#[derive(Debug, Args)]
pub struct DetectArgs {
    /// Frames (FITS, packed with gzip or not), or folders of them
    #[arg(required = true, value_name = "FILE")]
    pub frames: Vec<PathBuf>,
    /// How files are read.
    #[command(flatten)]
    pub reading: ReadingArgs,
    /// How sources are found.
    #[command(flatten)]
    pub search: SearchArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// How files of frames are read.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "The files")]
pub struct ReadingArgs {
    /// Image of files that hold several: its EXTNAME, or its place from 0 [default: SCI, else the first that is no mask]
    #[arg(long, value_name = "NAME|N")]
    pub extension: Option<String>,
    /// Colours of the first 2 x 2 pixels [default: as the headers say]
    #[arg(long, value_enum, value_name = "PATTERN", ignore_case = true)]
    pub bayer: Option<BayerArg>,
}

/// Colours of the first 2 × 2 pixels.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[value(rename_all = "UPPER")]
pub enum BayerArg {
    /// Red, green; green, blue
    Rggb,
    /// Green, red; blue, green
    Grbg,
    /// Green, blue; red, green
    Gbrg,
    /// Blue, green; green, red
    Bggr,
    /// A monochrome camera
    #[value(name = "none")]
    None,
}

impl ReadingArgs {
    /// The options for reading.
    pub(crate) fn options(&self) -> ReadOptions {
        let mut options = ReadOptions::default();
        options.extension = self.extension.as_deref().map(Extension::of);
        options.mosaic = self.bayer.map(|pattern| match pattern {
            BayerArg::Rggb => Mosaic::Pattern(Bayer::Rggb),
            BayerArg::Grbg => Mosaic::Pattern(Bayer::Grbg),
            BayerArg::Gbrg => Mosaic::Pattern(Bayer::Gbrg),
            BayerArg::Bggr => Mosaic::Pattern(Bayer::Bggr),
            BayerArg::None => Mosaic::Monochrome,
        });
        options
    }

    /// The options for reading where the time does not matter.
    pub(crate) fn whenever(&self) -> ReadOptions {
        let mut options = self.options();
        options.without_time = true;
        options
    }
}

/// How sources are found.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "The search")]
pub struct SearchArgs {
    /// Width of a point at half its maximum, px [default: as the frame's own points show it]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub fwhm_px: Option<f64>,
    /// Points stand out of the smoothed frame by so many standard deviations
    #[arg(long, value_name = "K", default_value_t = FieldOptions::default().point_sigmas, allow_negative_numbers = true)]
    pub point_sigma: f64,
    /// Streaks have at least so much light, in standard deviations of it
    #[arg(long, value_name = "K", default_value_t = FieldOptions::default().streak_sigmas, allow_negative_numbers = true)]
    pub streak_sigma: f64,
    /// Length of the shortest streak
    #[arg(long, value_name = "PX", default_value_t = FieldOptions::default().shortest_px, allow_negative_numbers = true)]
    pub shortest_px: f64,
    /// Radius of the aperture of points, px [default: 1.5 times their width at half maximum]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub aperture_px: Option<f64>,
}

impl SearchArgs {
    /// The options for frames of this camera.
    pub(crate) fn options(&self) -> FieldOptions {
        let mut options = FieldOptions::default();
        options.fwhm_px = self.fwhm_px;
        options.point_sigmas = self.point_sigma;
        options.streak_sigmas = self.streak_sigma;
        options.shortest_px = self.shortest_px;
        options.aperture_px = self.aperture_px;
        options
    }
}

/// Endings of names of frames.
const ENDINGS: [&str; 8] =
    [".fits", ".fit", ".fts", ".fits.gz", ".fit.gz", ".fts.gz", ".fz", ".fits.fz"];

/// The frames among files and folders, in the order of their names.
pub(crate) fn files_of(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    fn add(folder: &Path, depth: u8, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
        let entries = std::fs::read_dir(folder).map_err(|e| FileError::io("read", folder, e))?;
        let mut inside = Vec::new();
        for entry in entries {
            inside.push(entry.map_err(|e| FileError::io("read", folder, e))?.path());
        }
        inside.sort();
        for path in inside {
            let name = path.to_string_lossy().to_ascii_lowercase();
            if path.is_dir() {
                // Folders of darks and flats lie in folders of nights.
                if depth > 0 {
                    add(&path, depth - 1, files)?;
                }
            } else if ENDINGS.iter().any(|ending| name.ends_with(ending)) {
                files.push(path);
            }
        }
        Ok(())
    }
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            add(path, 3, &mut files)?;
        } else {
            files.push(path.clone());
        }
    }
    if files.is_empty() {
        let names: Vec<String> = paths.iter().map(|p| p.display().to_string()).collect();
        return Err(Usage(format!(
            "{}: no frame there; names of frames end with .fits, .fit or .fts, and with .gz where they are packed",
            names.join(", ")
        ))
        .into());
    }
    Ok(files)
}

/// Finds the sources of frames.
///
/// # Errors
/// A frame that cannot be read, options out of their range, a result that cannot be written.
pub fn run(args: &DetectArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let files = files_of(&args.frames)?;
    let progress = Bar::new(console);
    progress.begin("frames", Some(files.len() as u64));
    let mut frames = Vec::new();
    for (i, path) in files.iter().enumerate() {
        let mut frame = ImageFrame::read_as(path, &args.reading.whenever())?;
        let mut options = args.search.options();
        options.saturation_adu = frame.header.saturation_adu;
        options.gain_e_per_adu = frame.header.gain_e_per_adu;
        options.bayer = frame.header.bayer;
        let field = match find(frame.pixels.view(), &options) {
            Ok(field) => field,
            Err(error @ PhotometryError::NoNumber { .. }) if files.len() > 1 => {
                console.warn(&format!("{}: {error}", path.display()));
                progress.advance(1);
                continue;
            }
            Err(error) => return Err(anyhow::Error::new(error).context(path.display().to_string())),
        };
        if let Some(words) = constant(frame.pixels.view()) {
            console.warn(&format!("{}: {words}", path.display()));
        }
        frame.header.notes.extend(field.remarks.iter().cloned());
        frames.push(Detected::new(&frame.header, field, frame.pixels.view(), report::is_drawn(i)));
        progress.advance(1);
    }
    progress.end();
    if frames.is_empty() {
        bail!("none of {} frames holds a picture", files.len());
    }
    args.out.finish(&report::product(&frames)?, &report::text(&frames), console)
}
