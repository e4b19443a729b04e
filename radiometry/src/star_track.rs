//! A star through time: its places, its air, its rates.

use crate::air::{Air, AirError, Path, Zenith};
use crate::light_curve::{ChannelCurve, Flags, Input, LightCurve, Provenance, RateKind, Samples};
use crate::passband::ZeroPoint;
use crate::sky::{
    EarthOrientation, MoonSighting, Observer, OrientationOrigin, SkyError, Star, StarPlace,
    SunSighting, Twilight, separation_deg,
};
use crate::spectrum::{Spectrum, Transmission};
use crate::star_light::StarLight;
use crate::station::{Channel, Predicted, Station};
use hifitime::Epoch;
use rayon::prelude::*;
use std::path::PathBuf;

/// A catalogue's B−V that differs by more from its spectrum's is worth a warning, mag.
const WORTH_A_WARNING_MAG: f64 = 0.1;

/// Why there is no track of a star.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StarTrackError {
    /// A moment that the frames do not hold.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// No way through the air.
    #[error("the way of the star's light through the air")]
    Path(#[source] AirError),
    /// No transmission of the air.
    #[error(transparent)]
    Spectrum(AirError),
}

/// A star as a station sees it at one or more moments.
#[derive(Debug, Clone)]
pub struct StarTrack {
    /// The star.
    pub star: Star,
    /// Light of the star above the air.
    pub light: StarLight,
    /// The station.
    pub station: Station,
    /// The air above it.
    pub air: Air,
    /// Zero point of the star's V.
    pub zero: ZeroPoint,
    /// The files that went in.
    pub inputs: Vec<Input>,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// The moments, in the order in which they were asked for; at least one.
    pub sights: Vec<StarSight>,
}

/// A star, and what it is seen with.
#[derive(Debug, Clone)]
pub struct StarView {
    /// The star.
    pub star: Star,
    /// Light of the star above the air.
    pub light: StarLight,
    /// The station.
    pub station: Station,
    /// The air above it.
    pub air: Air,
    /// Zero point of the star's V.
    pub zero: ZeroPoint,
    /// Exposure time, s.
    pub exposure_s: f64,
}

/// A star at a moment.
#[derive(Debug, Clone)]
pub struct StarSight {
    /// The moment.
    pub epoch: Epoch,
    /// Where the star stands.
    pub place: StarPlace,
    /// The way of its light through the air; `None` below the horizon.
    pub path: Option<Path>,
    /// Relative air mass (Rayleigh) on that way.
    pub airmass: Option<f64>,
    /// Whether it is below the horizon or behind what stands there.
    pub hidden: bool,
    /// The rates of the station's channels, in their order.
    pub rates: Vec<ChannelRate>,
    /// The Sun.
    pub sun: SunSighting,
    /// How dark it makes the sky.
    pub twilight: Twilight,
    /// The Moon.
    pub moon: MoonSighting,
    /// Angle between Moon and star, degrees.
    pub moon_separation_deg: f64,
    /// Where the Earth's orientation was from.
    pub orientation: OrientationOrigin,
}

/// Count rate of a star in a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelRate {
    /// Predicted rate at the detector, after the air, Hz; `None` below the horizon.
    pub rate_hz: Option<f64>,
    /// Rate without the air, Hz.
    pub above_air_hz: f64,
    /// Width of the channel for which light or air was not tabulated, nm.
    pub uncovered_nm: f64,
    /// Arriving rate: the predicted rate over the channel's typical κ. Hz for a counter, counts of the converter per second (ADU/s) for a camera.
    /// `None` without a κ.
    pub arriving: Option<f64>,
    /// Rate that a counter reports for the arriving and its dark rate with its dead time, Hz; `None` where its law or its κ is not known.
    pub counted_hz: Option<f64>,
    /// Standard uncertainty of the predicted rate in one exposure, Hz: photons, dark counts and the statistics of the dead time of a counter; of a camera
    /// the photons alone. No scintillation. Without a κ, photons and dark counts alone.
    /// `None` below the horizon and where the counter is saturated past its law.
    pub sigma_hz: Option<f64>,
    /// Whether the counter is saturated ([`crate::station::Counter::is_saturated_by`]).
    pub saturated: bool,
}

impl ChannelRate {
    /// Signal over noise of one exposure.
    pub fn signal_to_noise(&self) -> Option<f64> {
        let ratio = self.rate_hz? / self.sigma_hz?;
        ratio.is_finite().then_some(ratio)
    }

    /// The share of the light that the air lets through.
    pub fn transmitted(&self) -> Option<f64> {
        self.rate_hz.map(|hz| hz / self.above_air_hz).filter(|t| t.is_finite())
    }
}

impl StarTrack {
    /// Computes a star at moments. They are computed side by side; their order and values do not depend on how many at once.
    ///
    /// # Errors
    /// A time outside of what time scales and frames hold; air that has no path or no spectrum.
    pub fn new(
        view: StarView,
        orientation: &EarthOrientation,
        times: Vec<Epoch>,
    ) -> Result<Self, StarTrackError> {
        let StarView { star, light, station, air, zero, exposure_s } = view;
        let above_air: Vec<f64> = station
            .channels
            .iter()
            .map(|c| station.rate_hz(c, &light.irradiance, None).value)
            .collect();
        let scene = Scene {
            star: &star,
            light: &light,
            station: &station,
            air: &air,
            above_air: &above_air,
            exposure_s,
        };
        let sights = times
            .into_par_iter()
            .map(|epoch| scene.sight(epoch, orientation))
            .collect::<Vec<_>>()
            // Only then the first error of all: which one it is must not depend on the threads.
            .into_iter()
            .collect::<Result<Vec<StarSight>, StarTrackError>>()?;
        let input = |(path, sha256): &(PathBuf, String)| Input {
            file: path.display().to_string(),
            sha256: sha256.clone(),
        };
        let inputs = station.sources.iter().map(input).collect();
        Ok(Self { star, light, station, air, zero, inputs, exposure_s, sights })
    }

    /// The transmission of the air on the way of the star's light at a moment; `None` below the horizon.
    pub fn transmission(&self, sight: &StarSight) -> Option<Spectrum<Transmission>> {
        let zenith = Zenith::Apparent(sight.path.as_ref()?.apparent_deg);
        self.air.spectrum(zenith, self.light.irradiance.range_nm()).ok()
    }

    /// Returns the warnings to read before believing the numbers.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = self.station.warnings.clone();
        let outside = self.sights.iter().map(|s| s.orientation).find(|o| o.is_outside());
        warnings.extend(outside.map(|o| format!("{o} (--earth-orientation FILE)")));
        if self.light.origin.is_fallback() {
            warnings.push(format!("the spectrum of {}: {}", self.star, self.light.origin));
        }
        if let Some(excess) = self.light.colour_excess_mag
            && excess.abs() > WORTH_A_WARNING_MAG
        {
            let reddened =
                if excess > 0.0 { "a reddened star (reddening is not modelled) or " } else { "" };
            warnings.push(format!("{}: {reddened}a wrong type", self.colour_check()));
        }
        warnings
    }

    /// How the spectrum's colour fits the catalogue's, in a sentence.
    pub fn colour_check(&self) -> String {
        match self.light.colour_excess_mag {
            None => "the spectrum's colour could not be checked, B-V is not known".into(),
            Some(excess) => {
                let word = if excess < 0.0 { "bluer" } else { "redder" };
                format!("by B-V the star is {:.3} mag {word} than its spectrum", excess.abs())
            }
        }
    }

    /// The track as a predicted light curve of the schema.
    pub fn light_curve(&self, command: &str) -> LightCurve {
        let channel = |(i, channel): (usize, &Channel)| {
            let rates = || self.sights.iter().map(|s| &s.rates[i]);
            let flags = self.sights.iter().map(|sight| {
                let rate = &sight.rates[i];
                let mut flags = Flags::empty();
                flags.set(Flags::HIDDEN, sight.hidden);
                flags.set(Flags::SATURATED, rate.saturated);
                flags.set(Flags::EXTRAPOLATED, rate.uncovered_nm > 0.0);
                let stand_in = self.light.origin.is_fallback() || sight.orientation.is_outside();
                flags.set(Flags::FALLBACK, stand_in);
                flags
            });
            ChannelCurve {
                name: channel.name.clone(),
                rate_hz: rates().map(|r| r.rate_hz.unwrap_or(f64::NAN)).collect(),
                sigma_hz: rates().map(|r| r.sigma_hz.unwrap_or(f64::NAN)).collect(),
                flags: flags.collect(),
                model_error_hz: None,
                common_sigma_hz: None,
            }
        };
        let time = self.sights.iter().map(|s| s.epoch).collect();
        let zenith_deg = self.sights.iter().map(|s| s.place.horizontal.zenith_deg()).collect();
        let provenance = Provenance {
            program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
            command: command.into(),
            station: self.station.name.clone(),
            target: self.star.to_string(),
            notes: vec![
                format!("spectrum: {}; {}", self.light.origin, self.colour_check()),
                "sigma: one exposure at the typical kappa: photons, dark counts and dead time of counters, photons alone of camera planes; no scintillation".into(),
                format!("air: {}", self.air.describe()),
                format!("V counts from {}", self.zero),
            ],
            inputs: self.inputs.clone(),
            ..Provenance::default()
        };
        LightCurve {
            kind: RateKind::Predicted,
            samples: Samples {
                zenith_deg: Some(zenith_deg),
                ..Samples::new(time, self.exposure_s)
            },
            channels: self.station.channels.iter().enumerate().map(channel).collect(),
            provenance,
            other: Default::default(),
        }
    }
}

/// Inputs that are the same at every moment.
struct Scene<'a> {
    star: &'a Star,
    light: &'a StarLight,
    station: &'a Station,
    air: &'a Air,
    above_air: &'a [f64],
    exposure_s: f64,
}

impl Scene<'_> {
    fn sight(
        &self,
        epoch: Epoch,
        orientation: &EarthOrientation,
    ) -> Result<StarSight, StarTrackError> {
        let observer = Observer::at(epoch, &self.station.site, orientation)?;
        let place = observer.star(self.star);
        let horizontal = place.horizontal;
        let zenith = Zenith::True(horizontal.zenith_deg());
        let path = match self.air.path(zenith) {
            Ok(path) => Some(path),
            Err(AirError::BelowHorizon { .. }) => None,
            Err(error) => return Err(StarTrackError::Path(error)),
        };
        let transmission = match &path {
            Some(_) => {
                let range_nm = self.light.irradiance.range_nm();
                Some(self.air.spectrum(zenith, range_nm).map_err(StarTrackError::Spectrum)?)
            }
            None => None,
        };
        let channels = self.station.channels.iter().zip(self.above_air);
        let rates = channels
            .map(|(channel, above)| self.rate(channel, *above, transmission.as_ref()))
            .collect();
        let (sun, moon) = (observer.sun(), observer.moon());
        let seen = |p: &Path| self.station.sees(90.0 - p.apparent_deg, horizontal.azimuth_deg());
        Ok(StarSight {
            epoch,
            place,
            hidden: !path.as_ref().is_some_and(seen),
            airmass: path.as_ref().map(|p| self.air.air_masses(p).rayleigh),
            path,
            rates,
            sun,
            twilight: observer.twilight(),
            moon,
            moon_separation_deg: separation_deg(
                moon.horizontal.east_north_up(),
                horizontal.east_north_up(),
            ),
            orientation: observer.frame().orientation().origin,
        })
    }

    fn rate(
        &self,
        channel: &Channel,
        above_air_hz: f64,
        air: Option<&Spectrum<Transmission>>,
    ) -> ChannelRate {
        let light = &self.light.irradiance;
        let below = air.map(|air| self.station.rate_hz(channel, light, Some(air)));
        let uncovered_nm =
            below.unwrap_or_else(|| self.station.rate_hz(channel, light, None)).uncovered_nm;
        // Where nothing of the channel is tabulated the rate is not zero but unknown.
        let rate_hz = below.filter(|b| b.is_covered() || b.value > 0.0).map(|b| b.value);
        let Predicted { arriving, counted_hz, sigma_hz, saturated } = rate_hz
            .map(|hz| self.station.predict(channel, hz, self.exposure_s))
            .unwrap_or_default();
        ChannelRate {
            rate_hz,
            above_air_hz,
            uncovered_nm,
            arriving,
            counted_hz,
            sigma_hz,
            saturated,
        }
    }
}
