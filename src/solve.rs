//! `sunglint solve`: a frame's place on the sky by the pattern of its stars.

use crate::detect::{SearchArgs, files_of};
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::Epoch;
use std::path::{Path, PathBuf};
use sunglint_calibration::field_stars::Catalogue;
use sunglint_calibration::field_stars::blind::{
    EMBEDDED_DEG, FIELDS_DEG, Patterns, Solved, narrowest_deg,
};
use sunglint_calibration::photometry::field::find;
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::fits::Fits;
use sunglint_formats::image_frame::ImageFrame;
use sunglint_numerics::progress::Progress as _;
use sunglint_report::solve::{Frame, product, text};

/// Part by which a width from a header may be wrong, and one that a person gave.
const WIDTH_TOLERANCE: f64 = 0.15;

/// Arguments of `sunglint solve`.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// Frames (FITS), or folders of them
    #[arg(required = true, value_name = "FRAME")]
    pub frames: Vec<PathBuf>,
    /// A list of stars for fields narrower than 15° (CSV, ECSV, VOTable, FITS) [default: the embedded stars to V = 5]
    #[arg(long, value_name = "FILE")]
    pub catalogue: Option<PathBuf>,
    /// The list's column of magnitudes [default: the first that is known]
    #[arg(long, value_name = "COLUMN", requires = "catalogue")]
    pub magnitude: Option<String>,
    /// Width of the frames on the sky, deg, within 15 % [default: the header's scale, else all widths are tried]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub width_deg: Option<f64>,
    /// Write the coordinates into the frames' own headers; what was there of coordinates is replaced, the pixels stay as they are
    #[arg(long)]
    pub write: bool,
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
        && !(FIELDS_DEG[0]..=FIELDS_DEG[1]).contains(&width)
    {
        let [least, most] = FIELDS_DEG;
        return Err(Usage(format!("--width-deg is {width}, expected {least} to {most}")).into());
    }
    let files = files_of(&args.frames)?;
    let list = match &args.catalogue {
        Some(path) => Catalogue::read(path)?,
        None => Catalogue::embedded()?,
    };
    let brightness = list.brightness(args.magnitude.as_deref())?;
    let progress = Bar::new(console);
    let mut patterns: Option<Patterns> = None;
    let mut frames = Vec::new();
    progress.begin("frames", Some(files.len() as u64));
    for path in &files {
        let frame = ImageFrame::read(path)?;
        let size = frame.header.size;
        let by_header = frame.header.scale_arcsec.map(|arcsec| {
            2.0 * (0.5 * size[0] as f64 * (arcsec / 3600.0).to_radians()).atan().to_degrees()
        });
        let width = args.width_deg.or(by_header);
        let widths = widths(width, list.len(), args.catalogue.is_none());
        let fits = |p: &Patterns| {
            p.fields_deg()[0] <= widths[0] * 1.001 && p.fields_deg()[1] >= widths[1] * 0.999
        };
        if !patterns.as_ref().is_some_and(fits) {
            console.detail(&format!("patterns for {:.2}° to {:.2}°", widths[0], widths[1]));
            let year = match &frame.header.time {
                Some(time) => year_of(time.middle),
                None => year_of(Epoch::now().context("the computer's clock cannot be read")?),
            };
            patterns = Some(Patterns::new(&list, &brightness, year, widths)?);
        }
        let Some(patterns) = &patterns else { continue };
        let mut options = args.search.options();
        options.saturation_adu = frame.header.saturation_adu;
        options.gain_e_per_adu = frame.header.gain_e_per_adu;
        options.is_mosaic = frame.header.bayer.is_some();
        let field = find(frame.pixels.view(), &options)?;
        let is_trailed = field.star_trails.is_some();
        let solved = patterns.solve(&field, is_trailed, width.map(|w| (w, WIDTH_TOLERANCE)));
        if let (true, Some(solved)) = (args.write, &solved) {
            written(path, solved)?;
        }
        let sources = if is_trailed { field.streaks.len() } else { field.points.len() };
        frames.push(Frame::new(&frame.header, sources, solved));
        progress.advance(1);
    }
    progress.end();
    args.out.finish(&product(&frames)?, &text(&frames), console)?;
    if frames.iter().all(|frame| frame.solved.is_none()) {
        bail!(
            "no frame was solved: give the width of the frames (--width-deg), a deeper list for a narrow field (--catalogue), and look at `sunglint detect` for what is seen in them"
        );
    }
    Ok(())
}

/// Widths of field that patterns are made for.
fn widths(width: Option<f64>, stars: usize, is_embedded: bool) -> [f64; 2] {
    let [least, most] = FIELDS_DEG;
    match width {
        Some(width) => [
            (width * (1.0 - WIDTH_TOLERANCE)).max(least),
            (width * (1.0 + WIDTH_TOLERANCE)).min(most),
        ],
        None if is_embedded => EMBEDDED_DEG,
        None => {
            let narrowest = narrowest_deg(stars).clamp(least, most);
            [narrowest, (4.0 * narrowest).min(most)]
        }
    }
}

/// Julian year of a moment.
fn year_of(time: Epoch) -> f64 {
    2000.0 + (time.to_jde_tt_days() - 2_451_545.0) / 365.25
}

/// Writes the coordinates into the frame's header.
fn written(path: &Path, solved: &Solved) -> anyhow::Result<()> {
    let fits = Fits::from_bytes(path, sunglint_formats::read::bytes(path)?).with_context(|| {
        "coordinates are written into plain FITS files only, not into packed ones".to_owned()
    })?;
    let cards = solved.wcs.cards().context("these coordinates have no cards")?;
    let bytes = fits
        .with_cards(sunglint_formats::wcs::is_coordinate, &cards)
        .map_err(|error| sunglint_formats::FileError::encode(path, error))?;
    write_file(path, &bytes, Overwrite::Allow)?;
    Ok(())
}
