//! `sunglint solve`: a frame's place on the sky by the pattern of its stars.

use crate::detect::{ReadingArgs, SearchArgs, files_of};
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::{Bar, Watched};
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::Epoch;
use std::path::{Path, PathBuf};
use sunglint_calibration::field_stars::blind::{FIELDS_DEG, Solved};
use sunglint_calibration::field_stars::solve_field::SolveField;
use sunglint_calibration::field_stars::solver::{Hint, Looked, Solver};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::fits::Fits;
use sunglint_formats::image_frame::ImageFrame;
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_report::solve::{Frame, product, text};

/// Arguments of `sunglint solve`.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// Frames (FITS), or folders of them
    #[arg(required = true, value_name = "FRAME")]
    pub frames: Vec<PathBuf>,
    /// A list of stars for fields narrower than 20° (CSV, ECSV, VOTable, FITS) [default: the embedded stars to V = 5]
    #[arg(long, value_name = "FILE")]
    pub catalogue: Option<PathBuf>,
    /// The list's column of magnitudes [default: the first that is known]
    #[arg(long, value_name = "COLUMN", requires = "catalogue")]
    pub magnitude: Option<String>,
    /// Ask astrometry.net's program in place of a list: for fields of 2° to 20° with the index files of Tycho-2 (Debian: astrometry.net, astrometry-data-tycho2)
    #[arg(long, value_name = "PROGRAM", num_args = 0..=1, require_equals = true, default_missing_value = "solve-field", conflicts_with = "catalogue")]
    pub solve_field: Option<PathBuf>,
    /// Width of the frames on the sky, deg, within 15 % [default: the header's scale, else all widths are tried]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub width_deg: Option<f64>,
    /// Write the coordinates into the frames' own headers; what was there of coordinates is replaced, the pixels stay as they are
    #[arg(long)]
    pub write: bool,
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

/// Solves frames.
///
/// # Errors
/// Frames or a list that cannot be read, a width or list for which there are no patterns, no frame that is solved.
pub fn run(args: &SolveArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    if let Some(width) = args.width_deg
        && !FIELDS_DEG.contains(width)
    {
        let [least, most] = FIELDS_DEG.to_array();
        return Err(Usage(format!("--width-deg is {width}, expected {least} to {most}")).into());
    }
    let files = files_of(&args.frames)?;
    let (list, column) = (args.catalogue.as_deref(), args.magnitude.as_deref());
    let mut solver = match &args.solve_field {
        Some(program) => Solver::by_program(SolveField::new(program), args.width_deg),
        None => Solver::new(list, column, args.width_deg)?,
    };
    // Another program has to be ended; this one ends by itself.
    let watched = args.solve_field.as_ref().map(|_| Watched::new(console)).transpose()?;
    let bar = Bar::new(console);
    let (bar, progress): (&Bar, &dyn Progress) = match &watched {
        Some(watched) => (&watched.bar, watched),
        None => (&bar, &bar),
    };
    let mut frames = Vec::new();
    progress.begin("frames", Some(files.len() as u64));
    for path in &files {
        if progress.is_cancelled() {
            return Err(Cancelled.into());
        }
        let frame = ImageFrame::read_as(path, &args.reading.whenever())?;
        let mut options = args.search.options();
        options.saturation_adu = frame.header.saturation_adu;
        options.gain_e_per_adu = frame.header.gain_e_per_adu;
        options.bayer = frame.header.bayer;
        let middle = match &frame.header.time {
            Some(time) => time.middle,
            None => Epoch::now().context("the computer's clock cannot be read")?,
        };
        let hint = Hint { middle, scale_arcsec: frame.header.scale_arcsec };
        let Looked { sources, solved } =
            solver.solve_watched(frame.pixels.view(), &hint, &options, progress)?;
        if let (true, Some(solved)) = (args.write, &solved) {
            written(path, solved)?;
        }
        frames.push(Frame::new(&frame.header, sources, solved));
        progress.advance(1);
    }
    bar.end();
    args.out.finish(&product(&frames)?, &text(&frames), console)?;
    if frames.iter().all(|frame| frame.solved.is_none()) {
        bail!(
            "no frame was solved: give the width of the frames (--width-deg), a deeper list for a narrow field (--catalogue) or another program (--solve-field), and look at `sunglint detect` for what is seen in them"
        );
    }
    Ok(())
}

/// Writes the coordinates into the frame's header.
fn written(path: &Path, solved: &Solved) -> anyhow::Result<()> {
    let fits = Fits::from_bytes(path, sunglint_formats::read::bytes(path)?).with_context(|| {
        "coordinates are written into plain FITS files only, not into packed ones".to_owned()
    })?;
    let cards = solved.wcs.cards().context("these coordinates have no cards")?;
    let bytes = fits
        .with_cards(|key| key == "CHECKSUM" || sunglint_formats::wcs::is_coordinate(key), &cards)
        .map_err(|error| sunglint_formats::FileError::encode(path, error))?;
    write_file(path, &bytes, Overwrite::Allow)?;
    Ok(())
}
