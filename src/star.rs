//! `sunglint star`: where a star stands, through how much air, and what each channel would count: at a moment or through a night.

use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs, Usage};
use crate::station::StationArgs;
use anyhow::{Context as _, anyhow, bail};
use clap::{Args, ValueEnum};
use hifitime::{Epoch, Unit};
use std::path::PathBuf;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial, Star, StarError};
use sunglint_radiometry::star_light::{self, StarColours, StarLight, VEGA_HIP};
use sunglint_radiometry::star_track::{StarTrack, StarView};
use sunglint_report::star::StarReport;

/// Where a star's spectrum comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum SpectrumChoice {
    /// Vega's own; else the library by type, else by colour, else a black body
    #[default]
    Auto,
    /// A black body of the colour's temperature
    BlackBody,
}

/// Arguments of `sunglint star`.
#[derive(Debug, Args)]
pub struct StarArgs {
    /// The star: `Vega`, `alp Lyr`, `HIP 91262`, `HD 172167`; or with --ra and --dec any name
    pub name: String,
    /// When: UTC, ISO 8601, or `now`
    #[arg(long, value_name = "TIME", default_value = "now")]
    pub at: String,
    /// Until when, for a light curve from --at on
    #[arg(long, value_name = "TIME")]
    pub to: Option<String>,
    /// Seconds between the samples of a light curve
    #[arg(
        long,
        value_name = "S",
        default_value_t = 60.0,
        requires = "to",
        allow_negative_numbers = true
    )]
    pub step_s: f64,
    /// Exposure time, s: for the photon noise
    #[arg(long, value_name = "S", default_value_t = 0.1, allow_negative_numbers = true)]
    pub exposure_s: f64,
    /// Where the spectrum comes from
    #[arg(long, value_enum, default_value_t)]
    pub spectrum: SpectrumChoice,
    /// Also write the star's spectrum, above the air and at the ground, at the first moment
    #[arg(long, value_name = "FILE")]
    pub spectrum_out: Vec<PathBuf>,
    /// A star of one's own.
    #[command(flatten)]
    pub own: OwnStarArgs,
    /// Magnitude of Vega that V counts from, or `ab`
    #[arg(long, value_name = "ZERO", default_value = "vega=0.03")]
    pub zero_point: ZeroPoint,
    /// Earth orientation to use instead of the embedded table: ECSV with its columns (see `sunglint tables earth_orientation`)
    #[arg(long, value_name = "FILE")]
    pub earth_orientation: Option<PathBuf>,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Known properties of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Known properties of a star that the catalogue lacks, or that are better known than in the catalogue.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "A star of one's own, or better known than in the catalogue")]
pub struct OwnStarArgs {
    /// Right ascension (ICRS), degrees, or hours as 18:36:56.3
    #[arg(long, value_name = "RA", requires = "dec", allow_hyphen_values = true)]
    pub ra: Option<String>,
    /// Declination (ICRS), degrees, or as +38:47:01
    #[arg(long, value_name = "DEC", requires = "ra", allow_hyphen_values = true)]
    pub dec: Option<String>,
    /// Julian year of that place
    #[arg(
        long,
        value_name = "YEAR",
        default_value_t = 2000.0,
        requires = "ra",
        allow_negative_numbers = true
    )]
    pub epoch_year: f64,
    /// Proper motion in right ascension times cos(declination), mas a year
    #[arg(long, value_name = "MAS", allow_negative_numbers = true)]
    pub pm_ra: Option<f64>,
    /// Proper motion in declination, mas a year
    #[arg(long, value_name = "MAS", allow_negative_numbers = true)]
    pub pm_dec: Option<f64>,
    /// Parallax, mas
    #[arg(long, value_name = "MAS", allow_negative_numbers = true)]
    pub parallax: Option<f64>,
    /// Johnson V
    #[arg(long, value_name = "MAG", allow_negative_numbers = true)]
    pub v: Option<f64>,
    /// B-V
    #[arg(long, value_name = "MAG", allow_negative_numbers = true)]
    pub bv: Option<f64>,
    /// Spectral type
    #[arg(long = "type", value_name = "MK")]
    pub spectral_type: Option<String>,
}

/// More samples are a slip of the step.
const MOST_SAMPLES: f64 = 200_000.0;
const DAY_S: f64 = 86_400.0;

/// Shows a star.
pub fn run(args: &StarArgs, console: Console) -> anyhow::Result<()> {
    let spectrum_out = OutputArgs { output: args.spectrum_out.clone(), force: args.out.force };
    if spectrum_out.is_stdout() {
        return Err(
            Usage("--spectrum-out wants a file: stdout is for the result itself".into()).into()
        );
    }
    spectrum_out.check()?;
    args.out.check_with(console)?;
    args.out.check()?;
    let station = args.station.get()?;
    let times = args.times()?;
    let star = args.star()?;
    let mut inputs = Vec::new();
    let user_orientation = match &args.earth_orientation {
        None => None,
        Some(path) => {
            let bytes = sunglint_formats::read::bytes(path)?;
            inputs.push(Input {
                file: path.display().to_string(),
                sha256: sunglint_formats::sha256(&bytes),
            });
            let table = sunglint_formats::ecsv::read_str(
                path,
                &sunglint_formats::read::decode(path, bytes)?,
            )?;
            Some(EarthOrientation::from_table(&table).with_context(|| path.display().to_string())?)
        }
    };
    let orientation = user_orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded());
    let height_m = station.site.geodetic().height_m;
    let air = args.model.air(height_m, Some(&station))?;
    let mut warnings = air.implausible();
    let light = args.light(&star)?;
    let view =
        StarView { star, light, station, air, zero: args.zero_point, exposure_s: args.exposure_s };
    let mut track = StarTrack::new(view, orientation, times)?;
    track.inputs.extend(inputs);
    warnings.extend(track.warnings());
    for warning in &warnings {
        console.warn(warning);
    }
    for (part, note) in &track.station.notes {
        console.detail(&format!("{}, {part}: {note}", track.station.name));
    }
    console.detail(&track.sights[0].orientation.to_string());
    let report = StarReport { track: &track, warnings: &warnings, is_night: args.to.is_some() };
    let product = report.product()?;
    // Both or none of them: what one refuses, the other has not written.
    let spectrum = match args.spectrum_out.is_empty() {
        true => Vec::new(),
        false => spectrum_out.files_of(&report.spectrum())?,
    };
    args.out.finish_with(&product, spectrum, &report.text(), console)
}

/// A time of the command line: ISO 8601 or `now`.
pub fn when(text: &str) -> anyhow::Result<Epoch> {
    if text.eq_ignore_ascii_case("now") {
        return Epoch::now().context("the system has no clock");
    }
    parse_utc(text).map_err(|error| anyhow!("{error}; or write now"))
}

impl StarArgs {
    fn times(&self) -> anyhow::Result<Vec<Epoch>> {
        for (option, value, least) in
            [("--exposure-s", self.exposure_s, 1e-9), ("--step-s", self.step_s, 1e-3)]
        {
            if !(least..=DAY_S).contains(&value) {
                bail!("{option} is {value:e}, expected {least:e} to {DAY_S} s");
            }
        }
        let first = when(&self.at)?;
        let Some(last) = &self.to else { return Ok(vec![first]) };
        let length_s = (when(last)? - first).to_seconds();
        let count = (length_s / self.step_s + 1e-9).floor();
        if count < 1.0 {
            bail!(
                "from --at {} to --to {last} there is no step of {} s: --to must be later",
                self.at,
                self.step_s
            );
        }
        if count > MOST_SAMPLES {
            bail!(
                "from --at {} to --to {last} by --step-s {} there are {count} samples, more than {MOST_SAMPLES}: take a longer step",
                self.at,
                self.step_s
            );
        }
        // The count is bounded above.
        Ok((0..=count as u32).map(|i| first + f64::from(i) * self.step_s * Unit::Second).collect())
    }

    fn star(&self) -> anyhow::Result<Star> {
        let own = &self.own;
        if self.name.trim().is_empty() {
            bail!("the star has no name: give one, or any name with --ra and --dec");
        }
        let mut star = match (&own.ra, &own.dec) {
            (Some(ra), Some(dec)) => {
                let place = Equatorial {
                    ra_deg: angle(ra, 15.0, "--ra")?,
                    dec_deg: angle(dec, 1.0, "--dec")?,
                };
                let mut star = Star::at(&self.name, place)?;
                star.epoch_year = own.epoch_year;
                star
            }
            _ if matches!(self.name.to_lowercase().as_str(), "sun" | "moon") => {
                bail!(
                    "`{}` is no star: where Sun and Moon stand is in the answer for every star",
                    self.name
                )
            }
            _ => Catalogue::embedded()
                .find(&self.name)
                .map_err(|error| match error {
                    StarError::Unknown { .. }
                    | StarError::NotInCatalogue { .. }
                    | StarError::OfTheSolarSystem { .. } => {
                        anyhow!("{error}: --ra RA --dec DEC --v MAG --type MK (or --bv MAG)")
                    }
                    error => error.into(),
                })?
                .clone(),
        };
        let numbers = [
            ("--pm-ra", own.pm_ra),
            ("--pm-dec", own.pm_dec),
            ("--parallax", own.parallax),
            ("--epoch-year", Some(star.epoch_year)),
        ];
        if let Some((name, value)) =
            numbers.into_iter().find(|(_, v)| v.is_some_and(|v| !v.is_finite() || v.abs() > 1e5))
        {
            bail!("{name} is {}, expected a number within 100000", value.unwrap_or_default());
        }
        star.pm_ra_mas_yr = own.pm_ra.or(star.pm_ra_mas_yr);
        star.pm_dec_mas_yr = own.pm_dec.or(star.pm_dec_mas_yr);
        star.parallax_mas = own.parallax.or(star.parallax_mas);
        star.v_mag = own.v.or(star.v_mag);
        star.bv_mag = own.bv.or(star.bv_mag);
        star.spectral_type = own.spectral_type.clone().or(star.spectral_type);
        Ok(star)
    }

    fn light(&self, star: &Star) -> anyhow::Result<StarLight> {
        let Some(v_mag) = star.v_mag else {
            bail!("no magnitude of {star} is known: give --v MAG");
        };
        let colours = StarColours {
            v_mag,
            b_minus_v_mag: star.bv_mag,
            spectral_type: star.spectral_type.as_deref(),
            zero: self.zero_point,
        };
        // Vega unless somebody says that it is another star.
        let is_vega =
            star.hip == Some(VEGA_HIP) && self.own.bv.is_none() && self.own.spectral_type.is_none();
        Ok(match self.spectrum {
            SpectrumChoice::BlackBody => star_light::black_body(colours)?,
            SpectrumChoice::Auto if is_vega => star_light::vega(colours)?,
            SpectrumChoice::Auto => star_light::of(colours)?,
        })
    }
}

/// Reads an angle in degrees that `option` was given: a decimal number, or three sexagesimal ones of which the first is in units of `unit_deg`.
///
/// # Errors
/// Where it is neither; the message names the option.
pub fn angle(text: &str, unit_deg: f64, option: &str) -> anyhow::Result<f64> {
    let wrong = || {
        anyhow!(
            "{option} is `{text}`, expected degrees (279.23) or sexagesimal numbers (18:36:56.3, -69:01:39)"
        )
    };
    let trimmed = text.trim();
    if !trimmed.contains(':') {
        return trimmed.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(wrong);
    }
    let (sign, digits) = match trimmed.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, trimmed.trim_start_matches('+')),
    };
    let parts: Vec<f64> =
        digits.split(':').map(|part| part.parse().ok()).collect::<Option<_>>().ok_or_else(wrong)?;
    let good =
        parts.len() == 3 && parts.iter().all(|v| *v >= 0.0) && parts[1] < 60.0 && parts[2] < 60.0;
    if !good {
        return Err(wrong());
    }
    Ok(sign * unit_deg * (parts[0] + parts[1] / 60.0 + parts[2] / 3600.0))
}
