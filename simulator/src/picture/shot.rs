//! The picture itself: pixels, optics, wavelengths.

use super::ViewError;
use super::aim::Aim;
use super::render::{Camera, Picture};
use crate::light::Faceted;

/// Content of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum What {
    /// Radiant intensity of each pixel, one picture a wavelength.
    Intensity,
    /// Which material is where.
    Material,
    /// Distance from the observer against that of the body's origin.
    Depth,
    /// Colours as an eye might see them: 640, 550 and 450 nm over sunlight's own colour.
    Rgb,
}

/// Blur of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub enum Blur {
    /// Nothing.
    #[default]
    None,
    /// A normal distribution of this full width at half maximum, arcsec.
    Fwhm(f64),
    /// Seeing of this full width at half maximum, arcsec, and diffraction; pixels are those of the station's camera.
    Station(f64),
}

/// How a picture is taken.
#[derive(Debug, Clone)]
pub struct ShotOptions {
    /// Contents to show; empty for all.
    pub what: Vec<What>,
    /// Wavelengths of the intensity, vacuum nm.
    pub wavelength_nm: Vec<f64>,
    /// Whether intensities are over the Sun's irradiance.
    pub per_irradiance: bool,
    /// Pixels across and down (default 512, or what the body needs at the given pixel).
    pub size_px: Option<usize>,
    /// Width of a pixel at the body, m (default so that the body fits).
    pub pixel_m: Option<f64>,
    /// Blur of the picture.
    pub blur: Blur,
}

impl Default for ShotOptions {
    fn default() -> Self {
        Self {
            what: Vec::new(),
            wavelength_nm: vec![550.0],
            per_irradiance: false,
            size_px: None,
            pixel_m: None,
            blur: Blur::None,
        }
    }
}

/// Red, green and blue of a picture as an eye might see it, nm.
pub const RGB_NM: [f64; 3] = [640.0, 550.0, 450.0];
/// Pixels unless somebody says.
const SIZE_PX: usize = 512;
/// More on a side is a slip.
const MOST_PX: usize = 10_000;
/// The picture reaches so many widths of the point spread function beyond the body.
const WINGS: f64 = 2.0;
/// The picture's half width over the body's reach.
const MARGIN: f64 = 1.12;
/// Full width at half maximum of the Airy disc, in λ/D.
const AIRY: f64 = 1.029;

/// How the picture is blurred, for each of its wavelengths.
#[derive(Debug, Clone, Default)]
pub struct Optics {
    /// Angle that a pixel sees, arcsec; where there is a range.
    pub pixel_arcsec: Option<f64>,
    /// Full width at half maximum for each band, arcsec; empty where nothing is blurred.
    pub fwhm_arcsec: Vec<f64>,
    /// In words.
    pub words: Option<String>,
}

/// A picture, ready to be shown.
#[derive(Debug, Clone)]
pub struct Shot<'a> {
    /// Subject of the picture.
    pub aim: &'a Aim,
    /// The camera.
    pub camera: Camera,
    /// Wavelengths of the intensities: those that were asked for, then red, green and blue where they are wanted.
    pub bands_nm: Vec<f64>,
    /// How many of them were asked for.
    pub asked: usize,
    /// The Sun's irradiance in each, W m⁻² nm⁻¹, which the intensities hold; 1 with `--per-irradiance`.
    pub irradiance: Vec<f64>,
    /// The picture, blurred.
    pub picture: Picture,
    /// The intensity of each band before the blur, all pixels.
    pub totals: Vec<f64>,
    /// Blur of the picture.
    pub optics: Optics,
    /// Contents to show.
    pub what: Vec<What>,
    /// Whether intensities are over the irradiance.
    pub per_irradiance: bool,
}

/// Sunlight at a wavelength, W m⁻² nm⁻¹.
pub(super) fn irradiance(aim: &Aim, nm: f64) -> Result<f64, ViewError> {
    let (first, last) = aim.sun.range_nm();
    if !(first..=last).contains(&nm) {
        return Err(ViewError::Impossible(format!(
            "{nm} nm: sunlight is tabulated from {first} to {last} nm"
        )));
    }
    Ok(aim.sunlight * aim.sun.at(nm))
}

impl<'a> Shot<'a> {
    /// Takes a picture.
    ///
    /// # Errors
    /// Settings that exclude one another or are out of range; wavelengths without sunlight or reflectance; a target that is none.
    pub fn take(aim: &'a Aim, options: &ShotOptions) -> Result<Self, ViewError> {
        let mut what = options.what.clone();
        if what.is_empty() {
            what = vec![What::Intensity, What::Material, What::Depth, What::Rgb];
        }
        what.dedup();
        let mut bands_nm = options.wavelength_nm.clone();
        let asked = bands_nm.len();
        if what.contains(&What::Rgb) {
            bands_nm.extend(RGB_NM);
        }
        let name = || aim.target.name.clone();
        let body = Faceted::new(&aim.target)
            .map_err(|source| ViewError::Target { name: name(), source })?;
        let (_, up) = aim.axes()?;
        let optics = Optics::new(options.blur, aim, &bands_nm)?;
        let widest = optics.fwhm_arcsec.iter().copied().fold(0.0, f64::max);
        let wings_m = aim.range_m.map_or(0.0, |r| 2.0 * WINGS * widest * arcsec() * r);
        let mut camera =
            Camera::around(&body, aim.observer_body, up, options.size_px.unwrap_or(SIZE_PX));
        let field_m = field_m(aim)?.min(camera.pixel_m * camera.size_px[0] as f64) + wings_m;
        let given = match (optics.pixel_arcsec, aim.range_m) {
            (Some(pixel), Some(range_m)) => Some(pixel * arcsec() * range_m),
            _ => options.pixel_m,
        };
        if let Some(pixel_m) = given {
            if !(pixel_m.is_finite() && pixel_m > 0.0) {
                return Err(ViewError::Setting(format!(
                    "--pixel-m is {pixel_m}, expected metres above 0"
                )));
            }
            let needed = (field_m / pixel_m).ceil().max(1.0);
            if options.size_px.is_none() && needed > MOST_PX as f64 {
                return Err(ViewError::Impossible(format!(
                    "the body needs {needed} pixels of {pixel_m} m, expected at most {MOST_PX}"
                )));
            }
            // An odd number, so that the body's origin lies in the middle of a pixel.
            let needed = needed as usize | 1;
            let size = options.size_px.unwrap_or(needed);
            (camera.pixel_m, camera.size_px) = (pixel_m, [size, size]);
        } else {
            camera.pixel_m = field_m / camera.size_px[0] as f64;
        }
        if !(1..=MOST_PX).contains(&camera.size_px[0]) {
            let size = camera.size_px[0];
            let text = format!("--size-px is {size}, expected 1 to {MOST_PX}");
            return Err(ViewError::Setting(text));
        }
        let scene = body.scene();
        let mut factors = Vec::new();
        let mut irradiances = Vec::new();
        for nm in &bands_nm {
            let sun = if options.per_irradiance { 1.0 } else { irradiance(aim, *nm)? };
            let rho = scene.reflectances(*nm)?;
            factors.push(rho.iter().map(|r| sun * r).collect::<Vec<f64>>());
            irradiances.push(sun);
        }
        let sharp = Picture::render(&mut body.eye(), &camera, aim.sun_body, &factors)
            .map_err(|source| ViewError::Render { name: name(), source })?;
        let totals = sharp.bands.iter().map(|b| b.iter().sum()).collect();
        let picture = match aim.range_m {
            Some(range_m) if !optics.fwhm_arcsec.is_empty() => {
                blurred(&sharp, &optics.fwhm_arcsec, range_m)
            }
            _ => sharp,
        };
        Ok(Self {
            aim,
            camera,
            bands_nm,
            asked,
            irradiance: irradiances,
            picture,
            totals,
            optics,
            what,
            per_irradiance: options.per_irradiance,
        })
    }

    /// The unit of a pixel's intensity as FITS and astropy spell it.
    pub fn unit(&self) -> &'static str {
        if self.per_irradiance { "m2 / sr" } else { "W / (sr nm)" }
    }

    /// The same for people.
    pub fn unit_words(&self) -> &'static str {
        if self.per_irradiance { "m² sr⁻¹ per pixel" } else { "W sr⁻¹ nm⁻¹ per pixel" }
    }

    /// The share of a band's light that the blur has carried out of the picture.
    pub fn lost(&self, band: usize) -> f64 {
        let total = self.totals[band];
        let left: f64 = self.picture.bands[band].iter().sum();
        if total > 0.0 { (1.0 - left / total).max(0.0) } else { 0.0 }
    }

    /// Returns the warnings to read before believing the picture.
    pub fn concerns(&self) -> Vec<String> {
        let mut concerns = Vec::new();
        let reach = 0.5 * self.camera.pixel_m * self.camera.size_px[0] as f64;
        if self.totals.first().is_some_and(|t| *t == 0.0) {
            concerns.push(format!(
                "no light at {} nm comes from {}",
                self.bands_nm[0], self.aim.target.name
            ));
        }
        let lost = self.lost(0);
        if lost > 0.01 {
            concerns.push(format!(
                "{:.1} % of the light falls outside the picture ({:.3} m from its middle to its edge): give --size-px",
                100.0 * lost,
                reach
            ));
        }
        concerns
    }
}

/// The width of the picture that the body needs about its origin, with a margin, m.
fn field_m(aim: &Aim) -> Result<f64, ViewError> {
    let (right, up) = aim.axes()?;
    let angles = aim.target.hinge_angles_rad(aim.sun_body);
    let mut most = 0.0_f64;
    for part in 0..aim.target.parts.len() {
        let mesh = aim.target.part_mesh(part, &angles);
        let reach = mesh.vertices.iter().map(|v| v.dot(right).abs().max(v.dot(up).abs()));
        most = reach.fold(most, f64::max);
    }
    Ok(2.0 * MARGIN * most)
}

/// An arcsecond in radians.
pub fn arcsec() -> f64 {
    (1.0 / 3600.0_f64).to_radians()
}

fn blurred(sharp: &Picture, fwhm_arcsec: &[f64], range_m: f64) -> Picture {
    let band = |(band, fwhm): (&Vec<f64>, &f64)| {
        let alone =
            Picture { bands: vec![band.clone()], materials: vec![], depth_m: vec![], ..*sharp };
        alone.blurred(fwhm * arcsec() * range_m).bands.swap_remove(0)
    };
    let bands = sharp.bands.iter().zip(fwhm_arcsec).map(band).collect();
    Picture { bands, ..sharp.clone() }
}

impl Optics {
    fn new(blur: Blur, aim: &Aim, bands_nm: &[f64]) -> Result<Self, ViewError> {
        let need_range = |option: &str| {
            let text =
                format!("{option} needs a distance: a pass has one, --model takes --range-km");
            aim.range_m.ok_or(ViewError::Setting(text))
        };
        let width = |option: &str, arcsec: f64| {
            let good = (0.0..=3600.0).contains(&arcsec);
            let text = format!("{option} is {arcsec}, expected 0 to 3600 arcsec");
            good.then_some(arcsec).ok_or(ViewError::Setting(text))
        };
        let seeing = match blur {
            Blur::None => return Ok(Self::default()),
            Blur::Fwhm(fwhm) => {
                need_range("--psf-arcsec")?;
                let fwhm = width("--psf-arcsec", fwhm)?;
                return Ok(Self {
                    fwhm_arcsec: vec![fwhm; bands_nm.len()],
                    words: Some(format!("blurred to {fwhm}″ (FWHM)")),
                    ..Self::default()
                });
            }
            Blur::Station(seeing) => seeing,
        };
        need_range("--station-optics")?;
        let seeing = width("--seeing-arcsec", seeing)?;
        let station = aim
            .station
            .as_ref()
            .ok_or_else(|| ViewError::Impossible("--station-optics needs --station".into()))?;
        let camera = station.camera.as_ref().ok_or_else(|| {
            ViewError::Impossible(format!(
                "the station {} has no [camera]: --station-optics takes its pixels",
                station.name
            ))
        })?;
        let diameter_m = station.telescope.primary_diameter_m;
        let fwhm_arcsec: Vec<f64> = bands_nm
            .iter()
            .map(|nm| seeing.hypot(AIRY * nm * 1e-9 / diameter_m / arcsec()))
            .collect();
        let words = format!(
            "{}: {:.3}″ a pixel; seeing {seeing}″ and diffraction make {:.2}″ (FWHM)",
            camera.name, camera.pixel_scale_arcsec, fwhm_arcsec[0]
        );
        Ok(Self { pixel_arcsec: Some(camera.pixel_scale_arcsec), fwhm_arcsec, words: Some(words) })
    }
}
