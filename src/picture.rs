//! `sunglint picture`: a body as it looks, what it sends into all directions, a sphere against phase angle.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::simulate::read;
use crate::star::when;
use crate::station::StationArgs;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::PathBuf;
use sunglint_formats::time::format_utc_shortest;
use sunglint_numerics::progress::Progress as _;
use sunglint_report::picture::{PictureReport, map, sphere};
use sunglint_simulator::pass::Overrides;
use sunglint_simulator::picture::{
    self, Aim, Blur, ModelView, ReflectionMaps, Shot, ShotOptions, ViewError,
};

/// Content of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Radiant intensity of each pixel, one picture a wavelength
    Intensity,
    /// Which material is where
    Material,
    /// Distance from the observer against that of the body's origin
    Depth,
    /// Colours as an eye might see them: 640, 550 and 450 nm over sunlight's own colour
    Rgb,
}

/// Upward direction in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Up {
    /// The celestial pole
    North,
    /// The station's zenith
    Zenith,
    /// The body's z axis
    BodyZ,
}

/// Arguments of `sunglint picture`.
#[derive(Debug, Args)]
#[allow(clippy::struct_excessive_bools, reason = "they are switches of a command line")]
pub struct PictureArgs {
    /// The scene: target, orbit, attitude, station, times (docs/pass.md)
    pub pass: Option<PathBuf>,
    /// A target alone, without orbit and station: a built-in name or a target.toml
    #[arg(long, value_name = "NAME|FILE")]
    pub model: Option<String>,
    /// When, within the pass: UTC, ISO 8601 [default: where the target stands highest]
    #[arg(long, value_name = "TIME")]
    pub at: Option<String>,
    /// With --model: phase angle, degrees, the Sun to the observer's right [default: 40]. With --map: that of the map [default: 0]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub phase: Option<f64>,
    /// With --model: direction to the Sun, body axes
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction)]
    pub sun: Option<DVec3>,
    /// With --model: direction to the observer, body axes [default: 0.75,-0.5,0.45]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction)]
    pub observer: Option<DVec3>,
    /// With --model: distance of the observer, for angles on the sky
    #[arg(long, value_name = "KM", allow_negative_numbers = true)]
    pub range_km: Option<f64>,
    /// Contents to show, separated by commas [default: all four]
    #[arg(long, value_enum, value_delimiter = ',')]
    pub what: Vec<What>,
    /// Wavelengths of the intensity, vacuum nm, separated by commas
    #[arg(
        long,
        value_name = "NM",
        value_delimiter = ',',
        default_value = "550",
        allow_negative_numbers = true
    )]
    pub wavelength_nm: Vec<f64>,
    /// Intensity over the Sun's irradiance: m² sr⁻¹ in place of W sr⁻¹ nm⁻¹
    #[arg(long)]
    pub per_irradiance: bool,
    /// Pixels across and down [default: 512, or what the body needs at the given pixel]
    #[arg(long, value_name = "N")]
    pub size_px: Option<usize>,
    /// Width of a pixel at the body, m [default: so that the body fits]
    #[arg(
        long,
        value_name = "M",
        allow_negative_numbers = true,
        conflicts_with = "station_optics"
    )]
    pub pixel_m: Option<f64>,
    /// Pixels of the station's camera at the target's range, seeing and diffraction
    #[arg(long)]
    pub station_optics: bool,
    /// Full width at half maximum of the seeing with --station-optics, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 2.0, allow_negative_numbers = true)]
    pub seeing_arcsec: f64,
    /// Blur the intensity by a normal distribution of this full width at half maximum
    #[arg(
        long,
        value_name = "ARCSEC",
        allow_negative_numbers = true,
        conflicts_with = "station_optics"
    )]
    pub psf_arcsec: Option<f64>,
    /// Upward direction [default: north, of a model body-z]
    #[arg(long, value_enum)]
    pub up: Option<Up>,
    /// The reflection map: intensity over all directions of the phase vector (the bisector of Sun and observer), body axes
    #[arg(long, conflicts_with_all = ["what", "pixel_m", "size_px", "station_optics", "psf_arcsec", "up"])]
    pub map: bool,
    /// Step of the map, degrees
    #[arg(long, value_name = "DEG", default_value_t = 1.0, allow_negative_numbers = true)]
    pub step_deg: f64,
    /// Reflection by a sphere against phase angle: rough mirrors beside Lambert's law and a mirror
    #[arg(long, conflicts_with_all = ["pass", "model", "map", "at"])]
    pub sphere: bool,
    /// Beckmann roughnesses α of the spheres
    #[arg(long, value_name = "ALPHA", value_delimiter = ',', default_values_t = [0.05, 0.1, 0.2, 0.5, 1.0], allow_negative_numbers = true)]
    pub alpha: Vec<f64>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A direction as people write it: `1,0,-0.5`.
pub(crate) fn direction(text: &str) -> Result<DVec3, String> {
    let parts: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse().map_err(|_| format!("`{part}` is no number")))
        .collect::<Result<_, _>>()?;
    let [x, y, z] = parts[..] else {
        return Err(format!("expected three numbers, X,Y,Z; found {}", parts.len()));
    };
    let direction = DVec3::new(x, y, z);
    let good = direction.is_finite() && direction.length() > 1e-9;
    good.then_some(direction)
        .ok_or_else(|| "expected a direction: three finite numbers, not all 0".into())
}

/// Makes a picture.
pub fn run(args: &PictureArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if args.sphere {
        if let Some(bad) = args.alpha.iter().find(|a| !(1e-5..=2.0).contains(*a)) {
            return Err(Usage(format!("--alpha is {bad}, expected 1e-5 to 2")).into());
        }
        let spheres = picture::spheres::sphere_ratios(&args.alpha)?;
        let (product, text) = sphere::product(&spheres);
        return args.out.finish(&product, &text, console);
    }
    if let Some(deg) = args.phase
        && !(0.0..=180.0).contains(&deg)
    {
        return Err(Usage(format!("--phase is {deg}°, expected 0 to 180")).into());
    }
    let tabular = |p: &PathBuf| {
        p.as_os_str() == "-"
            || p.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("ecsv") || e.eq_ignore_ascii_case("csv"))
    };
    if let Some(path) = args.out.output.iter().find(|p| tabular(p)) {
        let text = format!(
            "-o {}: a picture is no table: .fits has its numbers, .png and .svg show it, .json has the summary",
            path.display()
        );
        return Err(Usage(text).into());
    }
    let bar = Bar::new(console);
    bar.begin("the body", None);
    let aim = args.aim(console)?;
    for warning in &aim.warnings {
        bar.warn(warning);
    }
    if args.map {
        let phase_deg = args.phase.unwrap_or(0.0);
        let (nm, step_deg) = (&args.wavelength_nm, args.step_deg);
        bar.begin("the reflection map", None);
        let maps = ReflectionMaps::new(&aim, nm, phase_deg, step_deg, args.per_irradiance)
            .map_err(named)?;
        let (product, text) = map::product(&maps)?;
        bar.end();
        return args.out.finish(&product, &text, console);
    }
    bar.begin("the picture", None);
    let shot = Shot::take(&aim, &args.options()).map_err(named)?;
    for warning in shot.concerns() {
        bar.warn(&warning);
    }
    let report = PictureReport { shot: &shot };
    let product = report.product()?;
    bar.end();
    args.out.finish(&product, &report.text(), console)
}

/// A setting that is wrong is a slip of the command line.
fn named(error: ViewError) -> anyhow::Error {
    match error {
        ViewError::Setting(text) => Usage(text).into(),
        other => other.into(),
    }
}

impl PictureArgs {
    fn options(&self) -> ShotOptions {
        let what = |what: &What| match what {
            What::Intensity => picture::What::Intensity,
            What::Material => picture::What::Material,
            What::Depth => picture::What::Depth,
            What::Rgb => picture::What::Rgb,
        };
        let blur = match self.psf_arcsec {
            Some(fwhm) => Blur::Fwhm(fwhm),
            None if self.station_optics => Blur::Station(self.seeing_arcsec),
            None => Blur::None,
        };
        ShotOptions {
            what: self.what.iter().map(what).collect(),
            wavelength_nm: self.wavelength_nm.clone(),
            per_irradiance: self.per_irradiance,
            size_px: self.size_px,
            pixel_m: self.pixel_m,
            blur,
        }
    }

    /// Returns the aim that was asked for.
    fn aim(&self, console: Console) -> anyhow::Result<Aim> {
        match (&self.pass, &self.model) {
            (Some(_), Some(_)) => {
                Err(Usage("give either PASS.toml or --model, not both".into()).into())
            }
            (None, None) => Err(Usage(
                "a picture of what? Give PASS.toml, --model NAME (a built-in target or a target.toml), or --sphere".into(),
            )
            .into()),
            (Some(path), None) => self.of_pass(path, console),
            (None, Some(model)) => self.of_model(model),
        }
    }

    fn of_pass(&self, path: &std::path::Path, console: Console) -> anyhow::Result<Aim> {
        let alone = [
            ("--phase", self.phase.is_some() && !self.map),
            ("--sun", self.sun.is_some()),
            ("--observer", self.observer.is_some()),
            ("--range-km", self.range_km.is_some()),
        ];
        if let Some((option, _)) = alone.iter().find(|(_, given)| *given) {
            let text = format!("{option} goes with --model: a pass says itself where all stand");
            return Err(Usage(text).into());
        }
        let pass = read(path, &self.station, Overrides::default())?;
        let at = self.at.as_deref().map(when).transpose().context("--at")?;
        let up = self.up.map(|up| match up {
            Up::North => picture::Up::North,
            Up::Zenith => picture::Up::Zenith,
            Up::BodyZ => picture::Up::BodyZ,
        });
        let aim = Aim::of_pass(pass, at, up).with_context(|| path.display().to_string())?;
        if let Some(time) = aim.time {
            console.detail(&format!(
                "{}: Sun ({:.4}), station ({:.4}), body axes",
                format_utc_shortest(time),
                aim.sun_body,
                aim.observer_body
            ));
        }
        Ok(aim)
    }

    fn of_model(&self, model: &str) -> anyhow::Result<Aim> {
        if self.at.is_some() {
            return Err(Usage("--at goes with PASS.toml: a model alone has no time".into()).into());
        }
        if matches!(self.up, Some(Up::North | Up::Zenith)) {
            let text = "a model alone has no north and no zenith: --up body-z";
            return Err(Usage(text.into()).into());
        }
        let target = crate::passes::target(model)?;
        let view = ModelView {
            observer: self.observer,
            sun: self.sun,
            phase_deg: self.phase,
            range_m: self.range_km.map(|km| km * 1e3),
            station: self.station.find()?,
        };
        Aim::of_model(target, view).map_err(named)
    }
}
