//! True properties of a station's channels on a night.

use super::{ChannelTruth, CountTable, Instrument, NightError};
use crate::observatory::events::{DeadTime, Detector};
use crate::observatory::frame::{PixelFaults, Sensor};
use crate::observatory::options::Options;
use crate::observatory::random::{Purpose, seed_of};
use sunglint_radiometry::air::{Aerosol, Air, AirError};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::star_light::{self, StarColours};
use sunglint_radiometry::station::{self, Plane, Station};

pub(super) fn true_air(options: &Options, station: &Station) -> Result<Air, AirError> {
    let mut air = station.air_options()?;
    if options.air.aerosol_depth > 0.0 {
        air.aerosol = Aerosol::Angstrom {
            optical_depth: options.air.aerosol_depth,
            wavelength_nm: 550.0,
            exponent: options.air.aerosol_exponent,
            scale_height_m: 1800.0,
        };
    }
    Air::new(&air)
}

pub(super) fn sensor(options: &Options, camera: &station::Camera) -> Sensor {
    let faults = &options.camera;
    Sensor {
        bias_adu: faults.bias_adu,
        faults: PixelFaults {
            response_scatter: faults.response_scatter,
            hot_fraction: faults.hot_fraction,
            hot_e_per_s: faults.hot_e_per_s,
            cold_fraction: faults.cold_fraction,
            dead_fraction: faults.dead_fraction,
        },
        seed: seed_of(options.seed, Purpose::Part, 1000),
        ..Sensor::of_station(camera)
    }
}

/// The light of a square arcsecond of the sky: the Sun's colour.
fn sky_light(options: &Options) -> Result<Spectrum<Irradiance>, NightError> {
    let colours = StarColours {
        v_mag: options.sky.v_mag_per_arcsec2,
        b_minus_v_mag: None,
        spectral_type: Some("G2V"),
        zero: ZeroPoint::default(),
    };
    let light = star_light::of(colours);
    light
        .map(|light| light.irradiance)
        .map_err(|source| NightError::Light { star: "the sky".into(), source })
}

/// Exponent of λ/550 nm at which the change of the sky's light with its colour is taken.
const COLOUR_STEP: f64 = 0.05;

/// Light times a power of λ/550 nm.
fn tilted(light: &Spectrum<Irradiance>, exponent: f64) -> Option<Spectrum<Irradiance>> {
    let nm = light.wavelength_nm();
    let values =
        nm.iter().zip(light.value()).map(|(nm, value)| value * (nm / 550.0).powf(exponent));
    Spectrum::new(nm.to_vec(), values.collect()).ok()
}

pub(super) fn channel_truth(
    options: &Options,
    station: &Station,
    channel: &station::Channel,
    number: u64,
) -> Result<ChannelTruth, NightError> {
    let kappa = options.kappa.get(&channel.name).copied().or(channel.typical_kappa).unwrap_or(1.0);
    let light = sky_light(options)?;
    let rate_hz = |light: &Spectrum<Irradiance>| station.rate_hz(channel, light, None).value;
    let per_arcsec2 = rate_hz(&light) / kappa;
    let [bluer, redder] = [-COLOUR_STEP, COLOUR_STEP]
        .map(|exponent| tilted(&light, exponent).map_or(f64::NAN, |tilted| rate_hz(&tilted)));
    let colour = (redder / bluer).ln() / (2.0 * COLOUR_STEP);
    let sky_colour = if colour.is_finite() { colour } else { 0.0 };
    let scale = station.camera.as_ref().map_or(1.0, |camera| camera.pixel_scale_arcsec);
    let instrument = match &channel.detector {
        station::Detector::Counter(counter) => {
            // The integral of a fibre's field, in square arcseconds; without a fibre a circle of 10″.
            let field = counter.fibre.map_or(78.5, |fibre| {
                std::f64::consts::TAU * fibre.sigma_px[0] * fibre.sigma_px[1] * scale * scale
            });
            let (detector, table) = detector(options, channel, counter)?;
            Instrument::Counter {
                detector,
                table,
                fibre: counter.fibre,
                sky_hz: per_arcsec2 * field,
                sky_colour,
                seed: seed_of(options.seed, Purpose::Part, number),
            }
        }
        station::Detector::CameraPlane(plane) => {
            let gain = station.camera.as_ref().map_or(1.0, |camera| camera.gain_e_per_adu);
            let colours: &[usize] = match plane {
                Plane::R => &[0],
                Plane::G => &[1],
                Plane::B => &[2],
                Plane::L => &[0, 1, 2],
            };
            Instrument::Plane {
                colours,
                sky_e_per_s: per_arcsec2 * gain * scale * scale,
                sky_colour,
            }
        }
    };
    Ok(ChannelTruth { name: channel.name.clone(), kappa, instrument })
}

fn detector(
    options: &Options,
    channel: &station::Channel,
    counter: &station::Counter,
) -> Result<(Detector, Option<CountTable>), NightError> {
    let own = options.counter.get(&channel.name);
    let mut dark_rate_hz = own.and_then(|own| own.dark_rate_hz).unwrap_or(counter.dark_rate_hz);
    let mut table = None;
    let dead_time = match (own.and_then(|own| own.dead_time()), &counter.dead_time) {
        (Some(dead_time), _) => dead_time,
        (None, station::DeadTime::None) => DeadTime::None,
        (None, &station::DeadTime::NonParalysable { dead_time_s }) => {
            DeadTime::NonParalysable { dead_time_s }
        }
        (None, &station::DeadTime::Paralysable { dead_time_s }) => {
            DeadTime::Paralysable { dead_time_s }
        }
        (None, &station::DeadTime::ExponentialRecovery { dead_time_s, recovery_s }) => {
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s }
        }
        (None, &station::DeadTime::MultiPixel { pixels, recovery_s, pulse_s }) => {
            DeadTime::Comparator { pixels, recovery_s, pulse_s }
        }
        (None, station::DeadTime::Table { measured_hz, true_hz }) => {
            table = Some(CountTable {
                arriving_hz: true_hz.clone(),
                counted_hz: measured_hz.clone(),
                dark_rate_hz: std::mem::take(&mut dark_rate_hz),
            });
            DeadTime::None
        }
        (None, _) => return Err(NightError::DeadTime { channel: channel.name.clone() }),
    };
    let afterpulsing = own.and_then(|own| own.afterpulsing());
    Ok((Detector { dead_time, dark_rate_hz, afterpulsing }, table))
}
