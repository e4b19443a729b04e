//! A station: where it stands, its telescope, its channels, its camera and its lasers, as read from a `station.toml` and the curves beside it.

mod air_file;
mod curves;
mod file;
mod laser_file;
mod predicted;
mod recorded;
mod recovery;

pub use air_file::{AirFile, air_error};
pub use laser_file::{LaserFile, lasers};
pub use predicted::Predicted;
pub use recorded::RecordedError;

use crate::air::{Aerosol, AirError, AirOptions};
use crate::quadrature::{Integral, Product};
use crate::sky::Site;
use crate::spectrum::{Irradiance, Response, Spectrum, Transmission, lerp};
use glam::DVec2;
use sha2::{Digest as _, Sha256};
use std::path::{Path, PathBuf};
use sunglint_formats::FileError;
use sunglint_formats::curve;
use sunglint_formats::frame::Bayer;
use sunglint_formats::toml::Document;

/// A station.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// Name of the station: letters, digits, `_` and `-`.
    pub name: String,
    /// A sentence about it.
    pub description: String,
    /// Where it stands.
    pub site: Site,
    /// Obstacles near the horizon.
    pub horizon: Horizon,
    /// Telescope that gathers the light.
    pub telescope: Telescope,
    /// The air above it, unless the user says otherwise.
    pub air: AirDefaults,
    /// Channels of the station, at least one, names unique.
    pub channels: Vec<Channel>,
    /// Camera of the station.
    pub camera: Option<Camera>,
    /// Ranging lasers of the station.
    pub lasers: Vec<Laser>,
    /// Notes of the file on values that contradict each other or are not measured, by the table that they stand in.
    pub notes: Vec<(String, String)>,
    /// Warnings about entries of the files that may be mistakes: a curve that ends high.
    pub warnings: Vec<String>,
    /// The files that it was read from, with the SHA-256 of the bytes that were read; none of a built-in station, which the program's version names.
    pub sources: Vec<(PathBuf, String)>,
}

/// The lowest elevation that can be seen.
#[derive(Debug, Clone, PartialEq)]
pub enum Horizon {
    /// The same all around, degrees.
    Flat(f64),
    /// Elevation (degrees) against azimuth (degrees, 0 to 360, increasing), linear between and around north.
    Mask(Vec<(f64, f64)>),
}

impl Horizon {
    /// The lowest visible elevation at an azimuth, both in degrees.
    pub fn elevation_deg(&self, azimuth_deg: f64) -> f64 {
        let mask = match self {
            Horizon::Flat(elevation) => return *elevation,
            Horizon::Mask(mask) => mask,
        };
        let (Some(&first), Some(&last)) = (mask.first(), mask.last()) else { return 0.0 };
        let azimuth = azimuth_deg.rem_euclid(360.0);
        let i = mask.partition_point(|(a, _)| *a <= azimuth);
        let (a0, e0) = if i == 0 { (last.0 - 360.0, last.1) } else { mask[i - 1] };
        let (a1, e1) = if i == mask.len() { (first.0 + 360.0, first.1) } else { mask[i] };
        if a1 > a0 { e0 + (e1 - e0) * (azimuth - a0) / (a1 - a0) } else { e0 }
    }
}

/// Telescope that gathers the light.
#[derive(Debug, Clone, PartialEq)]
pub struct Telescope {
    /// Diameter of the primary mirror, m.
    pub primary_diameter_m: f64,
    /// Diameter of what stands before it, m; 0 for none.
    pub obstruction_diameter_m: f64,
    /// Focal length, m.
    pub focal_length_m: f64,
    /// How it follows a target.
    pub mount: Mount,
}

impl Telescope {
    /// Collecting area π(R₁² − R₂²), m².
    pub fn area_m2(&self) -> f64 {
        std::f64::consts::FRAC_PI_4
            * (self.primary_diameter_m.powi(2) - self.obstruction_diameter_m.powi(2))
    }
}

/// How a telescope follows a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mount {
    /// Polar axis: a pass across the meridian is interrupted.
    #[default]
    Equatorial,
    /// Azimuth and altitude: blind near the zenith.
    AltAzimuth,
}

/// The air above a station unless the user says otherwise; `None` is the profile's own column.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AirDefaults {
    /// Name of the constituent profile (`midlatitude_winter`).
    pub profile: String,
    /// Pressure at the site, hPa.
    pub pressure_hpa: Option<f64>,
    /// Ozone column, Dobson units.
    pub ozone_du: Option<f64>,
    /// Precipitable water above the site, mm.
    pub water_mm: Option<f64>,
    /// CO₂, ppm by volume.
    pub co2_ppm: Option<f64>,
    /// Aerosol; none unless the file names one.
    pub aerosol: Aerosol,
}

/// One spectral channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name of the channel: letters, digits and `_`; columns of light curves start with it.
    pub name: String,
    /// Transmissions of the optics in the light's path, 0 beyond their tables.
    pub optics: Vec<Spectrum<Response>>,
    /// Transmission of everything else in the path, the same at all wavelengths: a fraction above 0.
    pub transmission: f64,
    /// Counts per photon, 0 beyond its table.
    pub efficiency: Spectrum<Response>,
    /// Detector that counts the photons.
    pub detector: Detector,
    /// Name of the filter before the camera, as headers have it: only frames behind it are of this channel. `None`: all frames.
    pub filter: Option<String>,
    /// The star calibration's κ on a usual night (predicted = κ × measured): for planning, never for calibrating.
    pub typical_kappa: Option<f64>,
}

/// Detector that counts the photons of a channel.
#[derive(Debug, Clone, PartialEq)]
pub enum Detector {
    /// A single-photon counter.
    Counter(Counter),
    /// A plane of the camera.
    CameraPlane(Plane),
}

/// A plane of a camera: the pixels of one colour of its Bayer pattern, or all of a camera without one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
pub enum Plane {
    /// Red pixels, one in four.
    R,
    /// Green pixels, two in four.
    G,
    /// Blue pixels, one in four.
    B,
    /// All pixels of a monochrome camera.
    L,
}

/// A single-photon counter.
#[derive(Debug, Clone, PartialEq)]
pub struct Counter {
    /// Quantity that the counter's rates count.
    pub quantity: CounterQuantity,
    /// How it loses counts.
    pub dead_time: DeadTime,
    /// The rate at and above which it tells nothing, Hz, measured.
    pub saturation_hz: f64,
    /// Dark rate, Hz, measured.
    pub dark_rate_hz: f64,
    /// Active area, mm².
    pub area_mm2: Option<f64>,
    /// Where its fibre looks on the camera's frame.
    pub fibre: Option<Fibre>,
}

/// Quantity that a counter's rates count: counts or photons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CounterQuantity {
    /// Counts: the efficiency belongs in a prediction.
    #[default]
    Counts,
    /// Photons, by the linearity curve of the maker: the efficiency is left out.
    Photons,
}

/// How a counter loses counts.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum DeadTime {
    /// Not modelled.
    None,
    /// Deaf for a time after each count: m = n/(1+nτ).
    NonParalysable {
        /// τ, s.
        dead_time_s: f64,
    },
    /// Deaf for a time after each photon, counted or not: m = n e^(−nτ).
    Paralysable {
        /// τ, s.
        dead_time_s: f64,
    },
    /// Deaf, then recovering exponentially (Krause and Walenta, arXiv 2507.10361).
    ExponentialRecovery {
        /// τ, s.
        dead_time_s: f64,
        /// The recovery's time constant, s.
        recovery_s: f64,
    },
    /// Many pixels, each of which recovers exponentially after a count of its own, behind one comparator: pulses that overlap are counted as one.
    MultiPixel {
        /// Number of pixels.
        pixels: u32,
        /// Time constant of a pixel's recovery, s.
        recovery_s: f64,
        /// Width of a pulse at the comparator, s.
        pulse_s: f64,
    },
    /// A tabulated curve from measured to true rate, both Hz and increasing.
    Table {
        /// Measured rates, Hz.
        measured_hz: Vec<f64>,
        /// True rates, Hz.
        true_hz: Vec<f64>,
    },
}

impl DeadTime {
    /// Returns the rate that the detector counts for a true rate, both Hz, by its model; `None` past the end of a table. It is for planning: the inverse, with its uncertainty, is the calibration's.
    pub fn counted_hz(&self, true_hz: f64) -> Option<f64> {
        match self {
            DeadTime::None => Some(true_hz),
            DeadTime::NonParalysable { dead_time_s } => {
                Some(true_hz / (1.0 + true_hz * dead_time_s))
            }
            DeadTime::Paralysable { dead_time_s } => Some(true_hz * (-true_hz * dead_time_s).exp()),
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s } => {
                let counts = |n| recovery::interval(n, *dead_time_s, *recovery_s).0.recip();
                Some(if true_hz > 0.0 { counts(true_hz) } else { 0.0 })
            }
            DeadTime::MultiPixel { pixels, recovery_s, pulse_s } => {
                let fired = recovery::fired(true_hz, *pixels, *recovery_s).0;
                Some(fired * (-fired * pulse_s).exp())
            }
            DeadTime::Table { measured_hz, true_hz: truth } => {
                let i = truth.partition_point(|t| *t <= true_hz);
                if i == 0 {
                    // Below its first point the table is taken as a line from the origin.
                    return Some(if truth[0] > 0.0 {
                        measured_hz[0] * true_hz / truth[0]
                    } else {
                        true_hz
                    });
                }
                if i == truth.len() {
                    return (truth[i - 1] == true_hz).then_some(measured_hz[i - 1]);
                }
                Some(lerp(truth[i - 1], measured_hz[i - 1], truth[i], measured_hz[i], true_hz))
            }
        }
    }

    /// Standard uncertainty of a true rate n that was linearised from the counts of an exposure t, Hz: √(n(1+nτ)/t) of a renewal process without, and
    /// √(n e^(nτ)(1−2nτe^(−nτ))/t)/(1−nτ) with prolonged dead time; the same of the exponential recovery's own intervals, and of many pixels with the pulses that merge; |dn/dm| √(m/t)
    /// of a table; √(n/t) without a law. `None` where counts tell nothing of the rate.
    pub fn sigma_hz(&self, true_hz: f64, exposure_s: f64) -> Option<f64> {
        let variance = match self {
            DeadTime::None => true_hz / exposure_s,
            DeadTime::NonParalysable { dead_time_s } => {
                true_hz * (1.0 + true_hz * dead_time_s) / exposure_s
            }
            DeadTime::ExponentialRecovery { .. } if true_hz <= 0.0 => 0.0,
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s } => {
                let interval = |n| recovery::interval(n, *dead_time_s, *recovery_s);
                let (mean, variance) = interval(true_hz);
                let step = 1e-4 * true_hz;
                let (up, down) = (interval(true_hz + step).0, interval(true_hz - step).0);
                let slope = (up.recip() - down.recip()) / (2.0 * step);
                variance / mean.powi(3) / (slope * slope * exposure_s)
            }
            DeadTime::MultiPixel { pixels, recovery_s, pulse_s } => {
                let (fired, fano) = recovery::fired(true_hz, *pixels, *recovery_s);
                let x = fired * pulse_s;
                if x >= 1.0 {
                    return None;
                }
                let step = 1e-4 * true_hz;
                let rate = |n| recovery::fired(n, *pixels, *recovery_s).0;
                let slope = if step > 0.0 {
                    (rate(true_hz + step) - rate(true_hz - step)) / (2.0 * step)
                } else {
                    1.0
                };
                let merged = x.exp() * (1.0 - 2.0 * x * (-x).exp()) / (1.0 - x).powi(2);
                fired * fano * merged / (slope * slope * exposure_s)
            }
            DeadTime::Paralysable { dead_time_s } => {
                let x = true_hz * dead_time_s;
                if x >= 1.0 {
                    return None;
                }
                true_hz * x.exp() * (1.0 - 2.0 * x * (-x).exp()) / ((1.0 - x).powi(2) * exposure_s)
            }
            DeadTime::Table { measured_hz, true_hz: truth } => {
                let i = truth.partition_point(|t| *t <= true_hz).min(truth.len() - 1);
                // Below its first point the table is a line from the origin.
                let (n0, m0) = if i == 0 { (0.0, 0.0) } else { (truth[i - 1], measured_hz[i - 1]) };
                let slope = (truth[i] - n0) / (measured_hz[i] - m0);
                slope * slope * self.counted_hz(true_hz)? / exposure_s
            }
        };
        Some(variance.sqrt()).filter(|sigma| sigma.is_finite())
    }
}

impl Counter {
    /// Whether a true rate (dark counts included) saturates the counter, Hz: what it counts of it reaches its stated saturation, or lies where its
    /// law can no longer tell rates apart: past the peak of a paralysable one, past nine tenths of the most that a non-paralysable one can count (there
    /// an error of 1 % in the counts is one of 10 % in the rate), past the end of a table.
    pub fn is_saturated_by(&self, true_hz: f64) -> bool {
        let counted = self.dead_time.counted_hz(true_hz).unwrap_or(true_hz);
        let beyond_its_law = match &self.dead_time {
            DeadTime::NonParalysable { dead_time_s } => true_hz * dead_time_s >= 9.0,
            DeadTime::Paralysable { dead_time_s } => true_hz * dead_time_s >= 1.0,
            DeadTime::ExponentialRecovery { dead_time_s, .. } => true_hz * dead_time_s >= 9.0,
            DeadTime::MultiPixel { pixels, recovery_s, pulse_s } => {
                recovery::fired(true_hz, *pixels, *recovery_s).0 * pulse_s >= 1.0
            }
            DeadTime::Table { true_hz: truth, .. } => {
                truth.last().is_some_and(|last| true_hz > *last)
            }
            DeadTime::None => false,
        };
        beyond_its_law || counted >= self.saturation_hz
    }
}

/// A fibre's field on the camera's frame: a two-dimensional normal distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fibre {
    /// Centre from the frame's centre, pixels (x, y).
    pub offset_px: DVec2,
    /// Standard deviations, pixels (x, y).
    pub sigma_px: DVec2,
}

/// A camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Name of the instrument.
    pub name: String,
    /// Pixels across and down.
    pub size_px: [u32; 2],
    /// Angle that a pixel sees, arcsec.
    pub pixel_scale_arcsec: f64,
    /// The colours of the first four pixels of the sensor; `None` for a monochrome camera.
    pub bayer: Option<Bayer>,
    /// Electrons per count of the converter.
    pub gain_e_per_adu: f64,
    /// Read noise, electrons.
    pub read_noise_e: f64,
    /// Full well, electrons.
    pub full_well_e: f64,
    /// Bits of the converter.
    pub adc_bits: u8,
    /// Dark current, electrons per second.
    pub dark_e_per_s: f64,
}

impl Camera {
    /// The count at which a pixel is saturated: the full well or the converter's end, whichever comes first.
    pub fn saturation_adu(&self) -> f64 {
        (self.full_well_e / self.gain_e_per_adu).min(2_f64.powi(i32::from(self.adc_bits)) - 1.0)
    }
}

/// A ranging laser.
#[derive(Debug, Clone, PartialEq)]
pub struct Laser {
    /// Name of the instrument.
    pub name: String,
    /// Wavelength, vacuum nm.
    pub wavelength_nm: f64,
    /// Line width, nm.
    pub linewidth_nm: f64,
    /// Energy of a pulse, J.
    pub pulse_energy_j: f64,
    /// Length of a pulse, s.
    pub pulse_length_s: f64,
    /// Pulses per second.
    pub repetition_rate_hz: f64,
    /// Full angle of divergence, arcsec.
    pub divergence_arcsec: f64,
    /// Beam radius at the telescope, m.
    pub beam_radius_m: f64,
    /// How the energy is spread across the beam.
    pub beam: BeamShape,
    /// The channel that catches what comes back; the one that is most sensitive at the wavelength where none is named.
    pub receiver: Option<String>,
    /// Where it stands; beside the telescope where none is given.
    pub site: Option<Site>,
    /// Range data that it delivers, where somebody said so.
    pub ranging: Option<Ranging>,
}

/// Range data of a laser: what its files say of the station, and how a return is recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranging {
    /// Name of the station in range data, 1 to 10 letters, digits and `_-`.
    pub station: String,
    /// Numbers that the ILRS gave the station: pad, system, occupancy.
    pub numbers: [u32; 3],
    /// Network of the station.
    pub network: Option<String>,
    /// Number of the ILRS and satellite identification code of the target.
    pub target: [Option<u32>; 2],
    /// Length of a normal point, s.
    pub normal_point_s: f64,
    /// Length of the range gate, s, with the predicted return in its middle.
    pub gate_s: f64,
    /// Root mean square of the detector's and the clock's answer to a single photon, s.
    pub jitter_s: f64,
}

/// How a beam's energy is spread across it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BeamShape {
    /// The same within its radius, nothing beyond.
    #[default]
    TopHat,
    /// A normal distribution; the radius is where it has fallen to 1/e² of its middle.
    Gaussian,
}

/// A station that the program carries with it: its file, and the curves that the file names.
struct BuiltIn {
    name: &'static str,
    toml: &'static str,
    curves: &'static [(&'static str, &'static str)],
}

macro_rules! built_in {
    ($name:literal: $($curve:literal),*) => {
        BuiltIn {
            name: $name,
            toml: include_str!(concat!("../../stations/", $name, "/station.toml")),
            curves: &[$(($curve, include_str!(concat!("../../stations/", $name, "/", $curve)))),*],
        }
    };
}

const BUILT_IN: &[BuiltIn] = &[
    built_in!(
        "ufo":
        "efficiency_r.csv", "efficiency_g.csv", "efficiency_b.csv", "efficiency_id400.csv", "efficiency_spcm.csv", "efficiency_mppc.csv", "optics_camera.csv", "optics_id400.csv", "optics_spcm.csv", "optics_mppc.csv"
    ),
    built_in!("gauss6": "g531.csv", "g639.csv", "g746.csv", "g854.csv", "g961.csv", "g1069.csv"),
];

impl Station {
    /// The names of the built-in stations.
    pub fn built_in_names() -> Vec<&'static str> {
        BUILT_IN.iter().map(|station| station.name).collect()
    }

    /// A built-in station; `None` if there is none of that name.
    pub fn built_in(name: &str) -> Option<Result<Self, FileError>> {
        let BuiltIn { toml, curves, .. } = BUILT_IN.iter().find(|station| station.name == name)?;
        let folder = PathBuf::from(format!("embedded:{name}"));
        let read = || {
            let document = Document::new(folder.join("station.toml"), *toml)?;
            file::station(&document, &mut |wanted| {
                let text = curves.iter().find(|(name, _)| *name == wanted).map(|(_, text)| *text);
                let path = folder.join(wanted);
                let missing = || std::io::Error::from(std::io::ErrorKind::NotFound);
                let text = text.ok_or_else(|| FileError::io("read", &path, missing()))?;
                Ok((curve::read_str(&path, text, None)?, path))
            })
        };
        Some(read())
    }

    /// A station from its file, or from the `station.toml` of a folder. Curves are looked for beside the file.
    ///
    /// # Errors
    /// A file that cannot be read, or that says what a station cannot be: with path, line and field.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_at(path.as_ref())
    }

    fn read_at(path: &Path) -> Result<Self, FileError> {
        let path = if path.is_dir() { path.join("station.toml") } else { path.to_path_buf() };
        let mut sources: Vec<(PathBuf, String)> = Vec::new();
        let mut read = |path: &Path| {
            let bytes = sunglint_formats::read::bytes(path)?;
            // Channels share curves.
            if !sources.iter().any(|(known, _)| known == path) {
                let hash = Sha256::digest(&bytes);
                sources.push((
                    path.to_path_buf(),
                    hash.iter().map(|byte| format!("{byte:02x}")).collect(),
                ));
            }
            Ok::<_, FileError>(sunglint_formats::read::decode(path, bytes)?)
        };
        let document = Document::new(&path, read(&path)?)?;
        let mut station = file::station(&document, &mut |name| {
            let path = document.resolve(name);
            Ok((curve::read_str(&path, &read(&path)?, None)?, path))
        })?;
        station.sources = sources;
        Ok(station)
    }

    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|c| c.name == name)
    }

    /// Rate of a channel under a light, Hz: ν = (A/hc) ∫ E T_a T_m η λ dλ (thesis eq. 4.16), after the air where it is given. It is the true rate
    /// of the detector, without dark counts and before its dead time. A camera plane's stands for the whole aperture, as if every pixel had its colour.
    pub fn rate_hz(
        &self,
        channel: &Channel,
        light: &Spectrum<Irradiance>,
        air: Option<&Spectrum<Transmission>>,
    ) -> Integral {
        let product = Product::of(light);
        let product = match air {
            Some(air) => product.times(air),
            None => product,
        };
        channel.times_sensitivity(product).photon_rate().times(self.telescope.area_m2())
    }

    /// The air above the station as its file describes it.
    ///
    /// # Errors
    /// A profile that there is not; a station's file that was read has none such.
    pub fn air_options(&self) -> Result<AirOptions, AirError> {
        self.air.options(self.site.geodetic().height_m)
    }

    /// Whether the station's horizon leaves the direction free: altitude as it is seen (refracted) and azimuth, degrees.
    pub fn sees(&self, apparent_altitude_deg: f64, azimuth_deg: f64) -> bool {
        apparent_altitude_deg >= self.horizon.elevation_deg(azimuth_deg)
    }
}

impl Channel {
    /// A product of spectra times the channel's effective sensitivity P(λ) = T_m η; without η where the rates are photons.
    pub fn times_sensitivity<'a>(&'a self, product: Product<'a>) -> Product<'a> {
        self.factors().fold(product, Product::times).times_number(self.transmission)
    }

    /// The curves whose product the effective sensitivity is.
    fn factors(&self) -> impl Iterator<Item = &Spectrum<Response>> {
        let efficiency = (!self.counts_photons()).then_some(&self.efficiency);
        self.optics.iter().chain(efficiency)
    }

    /// Whether the channel's rates are photons rather than counts.
    pub fn counts_photons(&self) -> bool {
        matches!(&self.detector, Detector::Counter(c) if c.quantity == CounterQuantity::Photons)
    }

    /// ∫P dλ, nm: divides a rate into a band average in Hz/nm.
    pub fn bandwidth_nm(&self) -> f64 {
        self.times_sensitivity(Product::default()).integral().value
    }

    /// Mean wavelength ∫P λ dλ / ∫P dλ, nm.
    pub fn mean_wavelength_nm(&self) -> f64 {
        let product = self.times_sensitivity(Product::default());
        product.clone().times_wavelength().integral().value / product.integral().value
    }

    /// The effective sensitivity P(λ) = T_m η at a wavelength.
    pub fn sensitivity_at(&self, nm: f64) -> f64 {
        self.transmission * self.factors().map(|curve| curve.at(nm)).product::<f64>()
    }

    /// The wavelengths at which the channel can count, nm; `None` where its curves have none in common.
    pub fn range_nm(&self) -> Option<(f64, f64)> {
        let ranges = self.factors().map(Spectrum::range_nm);
        ranges.reduce(|(a, b), (c, d)| (a.max(c), b.min(d))).filter(|(a, b)| a < b)
    }
}
