//! `sunglint brdf fit`: laws through measured values.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_materials::fit::surface::colour::{Coloured, SpectrumGeometry, divide};
use sunglint_materials::fit::surface::{Cone, SurfaceFit, SurfaceOptions, fit_surface};
use sunglint_materials::fit::{FitError, FitOptions, Law, LobeKind, Rise, fit, to_toml};
use sunglint_materials::ingest::once;
use sunglint_materials::samples::{Sample, Samples};
use sunglint_materials::{exchange, read};
use sunglint_radiometry::light_curve::Input;
use sunglint_report::brdf::fit::{product, text};
use sunglint_report::brdf::surface::{
    colour as product_of_colour, product as product_of_surface, text as text_of_surface,
};
use sunglint_simulator::surface::ComplexIndex;

/// Arguments of `sunglint brdf fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// Measured values, ECSV, CSV or FITS: theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg, brdf_per_sr or brdf_532nm_per_sr and so on
    #[arg(value_name = "TABLE")]
    pub table: PathBuf,
    /// The wavelength: of a table that does not say it, or which of several
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: Option<f64>,
    /// Values up to this are no measurements (a detector's floor)
    #[arg(long, value_name = "PER_SR")]
    pub floor_per_sr: Option<f64>,
    /// Only this law, one lobe with and without a Lambert term; may be given several times [default: one to three lobes, a mirror and diffuse light together, of a table with one
    /// azimuth of incidence]
    #[arg(long, value_name = "LAW")]
    pub law: Vec<LawName>,
    /// Half-angle of what the detector takes in: the law is seen through it [default: that of the table's instrument, or 0.24]
    #[arg(long, value_name = "DEG")]
    pub cone_deg: Option<f64>,
    /// Half-angle of the source as the sample sees it [default: that of the instrument's signature in the table, or 0]
    #[arg(long, value_name = "DEG")]
    pub source_deg: Option<f64>,
    /// Directions of light or detector farther from the normal are left out
    #[arg(long, value_name = "DEG", default_value_t = 85.0)]
    pub theta_most_deg: f64,
    /// An error of every value that does not grow with it: values around 0 and below then count as what they are [default: that of the table's instrument, or 0]
    #[arg(long, value_name = "PER_SR")]
    pub additive_per_sr: Option<f64>,
    /// The most lobes that are tried, 1 to 3
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=3))]
    pub most_lobes: u8,
    /// Write material.toml also where peak or hemispherical reflectance are off: it carries the doubt
    #[arg(long)]
    pub accept: bool,
    /// A material of the table of refractive indices, for Maxwell and Beard's law
    #[arg(long, value_name = "NAME")]
    pub refractive_index: Option<String>,
    /// Outliers count in full: squares in place of Student's distribution
    #[arg(long)]
    pub gaussian: bool,
    /// A reflectance spectrum of the sample (CSV: wavelength_nm, reflectance or any other value): its colour is divided among the parts, and material.toml gets it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["law", "gaussian", "refractive_index"])]
    pub spectrum: Option<PathBuf>,
    /// The spectrum's geometry: angle of incidence, angle of the detector and its azimuth from the light's (180 is the mirrored side), degrees
    #[arg(
        long,
        value_name = "DEG,DEG,DEG",
        value_delimiter = ',',
        allow_negative_numbers = true,
        requires = "spectrum",
        conflicts_with = "spectrum_hemispherical"
    )]
    pub spectrum_at: Vec<f64>,
    /// The spectrum is hemispherical, at this angle of incidence
    #[arg(long, value_name = "DEG", requires = "spectrum")]
    pub spectrum_hemispherical: Option<f64>,
    /// The name of the material that is written
    #[arg(long, value_name = "NAME", default_value = "fitted")]
    pub name: String,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LawName {
    /// The same in all directions
    Lambert,
    /// Phong's, modified
    Phong,
    /// A/(B + x^g)
    Abg,
    /// Ward's, with bounded albedo
    Ward,
    /// Cook–Torrance with Beckmann's slopes
    Beckmann,
    /// Cook–Torrance with GGX slopes
    Ggx,
    /// Maxwell–Beard
    MaxwellBeard,
}

impl LawName {
    fn kind(self) -> LobeKind {
        match self {
            Self::Lambert => LobeKind::Lambert,
            Self::Phong => LobeKind::Phong,
            Self::Abg => LobeKind::Abg,
            Self::Ward => LobeKind::Ward,
            Self::Beckmann => LobeKind::Beckmann,
            Self::Ggx => LobeKind::Ggx,
            Self::MaxwellBeard => LobeKind::MaxwellBeard,
        }
    }
}

/// The geometry that the arguments give the spectrum.
fn geometry(args: &FitArgs) -> Result<SpectrumGeometry, Usage> {
    match (args.spectrum_at.as_slice(), args.spectrum_hemispherical) {
        ([theta_i_deg, theta_o_deg, azimuth_deg], _) => Ok(SpectrumGeometry::Directional {
            theta_i_deg: *theta_i_deg,
            theta_o_deg: *theta_o_deg,
            azimuth_deg: *azimuth_deg,
        }),
        ([_, ..], _) => Err(Usage(format!(
            "--spectrum-at has {} numbers, expected three: angle of incidence, of the detector, azimuth",
            args.spectrum_at.len()
        ))),
        (_, Some(theta_i_deg)) => Ok(SpectrumGeometry::Hemispherical { theta_i_deg }),
        _ => Err(Usage(
            "--spectrum: also give its geometry, --spectrum-at 30,0,0 or --spectrum-hemispherical 8"
                .into(),
        )),
    }
}

/// The colours of the parts, where a spectrum is given.
fn colour(args: &FitArgs, found: &SurfaceFit) -> anyhow::Result<Option<Coloured>> {
    let Some(path) = &args.spectrum else { return Ok(None) };
    let geometry = geometry(args)?;
    let text = sunglint_formats::read::text(path)?;
    let curve = sunglint_formats::curve::read_str(path, &text, None)?;
    let divided = divide(found, geometry, &curve.x, &curve.y);
    Ok(Some(divided.with_context(|| path.display().to_string())?))
}

/// A lobe narrower than this many times that depends on it.
const NARROW: f64 = 6.0;
const NOT_WRITTEN: &str = "no material.toml is written: peak or hemispherical reflectance are off (above). Look at the table, try --cone-deg or --theta-most-deg, or take it as it is with --accept";

/// Several parts together.
fn surface(
    args: &FitArgs,
    measured: &Samples,
    inputs: &[Input],
    console: Console,
) -> anyhow::Result<()> {
    let mut options = SurfaceOptions::of(measured);
    let Cone { detector_deg, source_deg } = options.cone;
    options.cone = Cone {
        detector_deg: args.cone_deg.unwrap_or(detector_deg),
        source_deg: args.source_deg.unwrap_or(source_deg),
    };
    for (name, deg, most) in [
        ("--cone-deg", options.cone.detector_deg, 10.0),
        ("--source-deg", options.cone.source_deg, 10.0),
        ("--theta-most-deg", args.theta_most_deg, 90.0),
    ] {
        if !(0.0..=most).contains(&deg) {
            let expected = format!("{name} is {deg}, expected an angle from 0 to {most} degrees");
            return Err(Usage(expected).into());
        }
    }
    options.wavelength_nm = args.wavelength_nm;
    options.floor_per_sr = args.floor_per_sr;
    options.additive_per_sr = args.additive_per_sr.unwrap_or(options.additive_per_sr);
    options.theta_most_deg = args.theta_most_deg;
    options.most_lobes = usize::from(args.most_lobes);
    let bar = Bar::new(console);
    let found = fit_surface(measured, &options, &bar)?;
    drop(bar);
    for flaw in &found.flaws {
        console.warn(&flaw.to_string());
    }
    let is_said = found.instrument.as_ref().is_some_and(|i| i.cone_half_angle_deg.is_some());
    if args.cone_deg.is_none()
        && !is_said
        && let Some(width) = found.narrowest_deg().filter(|w| *w < NARROW * detector_deg)
    {
        console.warn(&format!(
            "the peak is {width:.2}° wide (half), of the order of what the detector takes in, which is taken as {detector_deg}°: say the instrument's with --cone-deg"
        ));
    }
    let mut product = product_of_surface(&found, measured, inputs)?;
    let colour = colour(args, &found)?;
    let toml = match &colour {
        Some(colour) => {
            for warning in &colour.warnings {
                console.warn(warning);
            }
            product.others.push(product_of_colour(colour));
            colour.to_toml(&found, &args.name)
        }
        None => found.to_toml(&args.name),
    };
    let is_written = found.is_faithful() || args.accept;
    let folders = args.out.folders().output;
    let files = folders.iter().filter(|_| is_written);
    let files = files.map(|f| (f.join("material.toml"), toml.clone().into_bytes()));
    args.out.finish_with(&product, files.collect(), &text_of_surface(&found, &toml), console)?;
    written(is_written, folders.is_empty(), console)
}

/// Fails where the material was wanted and not written, after all else that was found is; says it where it was not wanted.
fn written(is_written: bool, is_shown_only: bool, console: Console) -> anyhow::Result<()> {
    match (is_written, is_shown_only) {
        (true, _) => Ok(()),
        (false, true) => {
            console.warn(NOT_WRITTEN);
            Ok(())
        }
        (false, false) => bail!(NOT_WRITTEN),
    }
}

/// Says where the table has σ of some values and not of others, which no fit weighs against one another.
fn without_sigma(measured: &Samples, wavelength_nm: Option<f64>) -> Option<String> {
    let is_it = |nm: &f64| wavelength_nm.is_none_or(|asked| (asked - nm).abs() < 1e-6);
    let column = measured.wavelength_nm.iter().position(is_it)?;
    let bright = || measured.rows.iter().filter(|row| row.brdf_per_sr[column] > 0.0);
    let known = |row: &&Sample| row.sigma_per_sr.get(column).is_some_and(|sigma| *sigma > 0.0);
    let (known, all) = (bright().filter(known).count(), bright().count());
    (known > 0 && known < all).then(|| {
        format!(
            "σ is missing or 0 for {} of {all} values: it is used for none, and all count alike. Give it for all, or leave the column out",
            all - known
        )
    })
}

pub(super) fn run(args: &FitArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    args.out.check_names(&["fit.ecsv", "residuals.ecsv", "incidences.ecsv", "colour.ecsv"])?;
    if args.spectrum.is_some() {
        geometry(args)?;
    }
    if let Some(additive) = args.additive_per_sr.filter(|a| !(*a >= 0.0 && a.is_finite())) {
        return Err(Usage(format!("--additive-per-sr is {additive}, expected 0 or above")).into());
    }
    let (measured, inputs) = read::samples(&args.table, args.wavelength_nm)?;
    let (measured, repeated) = once(measured);
    for warning in repeated.into_iter().chain(exchange::warnings(&measured)) {
        console.warn(&warning);
    }
    if let Some(without) = without_sigma(&measured, args.wavelength_nm) {
        console.warn(&without);
    }
    if args.law.is_empty() && args.refractive_index.is_none() && !args.gaussian {
        match surface(args, &measured, &inputs, console) {
            // One lobe needs less: the table may still do for that.
            Err(error)
                if matches!(
                    error.downcast_ref(),
                    Some(FitError::Law { .. } | FitError::TooFew { .. })
                ) && args.spectrum.is_none() =>
            {
                console.warn(&format!("{error}: laws of one lobe are fitted"));
            }
            done => return done,
        }
    }
    let index = args.refractive_index.as_deref().map(ComplexIndex::named).transpose()?;
    let mut laws = Vec::new();
    if !args.law.is_empty() {
        let azimuths = measured.has_azimuths();
        let asked: Vec<LobeKind> = args.law.iter().map(|law| law.kind()).collect();
        // What the law needs, the fit says.
        laws = Law::all(azimuths, true, true);
        laws.retain(|law| asked.contains(&law.lobe));
    }
    let options = FitOptions {
        laws,
        wavelength_nm: args.wavelength_nm,
        floor_per_sr: args.floor_per_sr,
        gaussian: args.gaussian,
        index: index.clone(),
    };
    let found = fit(&measured, &options).with_context(|| args.table.display().to_string())?;
    for warning in &found.notes {
        console.warn(&warning.to_string());
    }
    let best = found.laws.first().context("no law was fitted")?;
    let rise = index.as_ref().map(|index| Rise::new(index, found.wavelength_nm)).transpose()?;
    let product = product(&found, best, &measured, rise.as_ref(), &inputs);
    let toml = to_toml(&found, best, &args.name, args.refractive_index.as_deref());
    let is_written = found.is_faithful() || args.accept;
    for flaw in &found.flaws {
        console.warn(&flaw.to_string());
    }
    let folders = args.out.folders().output;
    let files = folders.iter().filter(|_| is_written);
    let files = files.map(|f| (f.join("material.toml"), toml.clone().into_bytes()));
    args.out.finish_with(&product, files.collect(), &text(&found, &toml), console)?;
    written(is_written, folders.is_empty(), console)
}
