//! Magnitudes of rates, by the coefficients κ of a calibration: as `sunglint apply --magnitudes V` has them.

use crate::corrected::Corrected;
use hifitime::Epoch;
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;
use sunglint_calibration::apply::{ApplyInput, PhotometryOptions, apply};
use sunglint_calibration::stars::{Nights, night_of};
use sunglint_formats::FileError;
use sunglint_formats::session::{Target, TargetKind};
use sunglint_numerics::order::{median, robust_sigma};
use sunglint_observatory::Pointing;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, Input, LightCurve, Provenance, RateKind, Samples,
};
use sunglint_radiometry::station::Station;

/// Zenith angles of the table, deg: between them the magnitude is a line, to 2 mmag at the lowest.
const STEP_DEG: f64 = 0.25;
/// Lowest altitude at which there is a magnitude, as zenith angle, deg.
const LOWEST_DEG: f64 = 85.0;
/// Bins this many σ from the median of the sky are left out, as the reduction does.
const CLIP: f64 = 5.0;
/// Fewer points tell no sky.
const LEAST: usize = 3;
/// Time for which the place of a star holds, s: 0.04° of the sky.
const STAR_S: f64 = 10.0;
/// One magnitude is this part of a natural logarithm.
const MAG: f64 = 2.5 / std::f64::consts::LN_10;

/// A calibration as `sunglint calibrate` wrote it.
#[derive(Debug, Clone)]
pub struct Calibration {
    nights: Nights,
    file: Input,
}

impl Calibration {
    /// Reads one.
    ///
    /// # Errors
    /// A file that cannot be read or is no calibration.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let bytes = sunglint_formats::read::bytes(path)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let file = Input { file: name, sha256: sunglint_formats::sha256(&bytes) };
        let text = sunglint_formats::read::decode(path, bytes)?;
        let table = sunglint_formats::ecsv::read_str(path, &text)?;
        Ok(Self { nights: Nights::from_table(path, &table)?, file })
    }
}

/// Description of the magnitudes for the person who looks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MagnitudesView {
    /// Where they come from, in a sentence.
    pub said: String,
    /// Channels that have them, with the standard uncertainty that κ adds to all of a channel's magnitudes alike, mag.
    pub channels: Vec<(String, f64)>,
    /// Doubts about them.
    pub warnings: Vec<String>,
}

/// Magnitudes of points, by channel.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(crate) struct PointMagnitudes {
    /// V magnitude above the air; `None` where there is none.
    pub magnitude: Vec<Vec<Option<f64>>>,
    /// Standard uncertainty from counting, of the target and of the sky.
    pub sigma_mag: Vec<Vec<Option<f64>>>,
}

/// Rate of the empty sky with dark counts taken off, and its standard uncertainty, Hz.
pub(crate) type Off = (f64, f64);

/// Points that are given magnitudes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Points<'a> {
    pub channels: &'a [String],
    /// Starts and lengths, s after the session's start.
    pub start_s: &'a [f64],
    pub length_s: &'a [f64],
    /// Counted rates by channel, Hz.
    pub rate_hz: &'a [Vec<f64>],
}

/// Magnitude of 1 Hz of linear rate in each channel, by zenith angle.
#[derive(Debug, Clone)]
pub(crate) struct Scale {
    zero: HashMap<String, Vec<f64>>,
    pub view: MagnitudesView,
}

impl Scale {
    /// The scale of the night in which `start` lies, or else of the calibration's last night, with a warning.
    pub fn new(calibration: &Calibration, station: &Station, start: Epoch) -> Result<Self, String> {
        let nights = &calibration.nights;
        let own = night_of(start, station.site.geodetic().longitude_deg);
        let known = nights.nights.iter().find(|night| night.night == own);
        let night = known.or_else(|| nights.nights.iter().max_by_key(|night| &night.night));
        let night = night.ok_or("the calibration has no night")?;
        let zenith: Vec<f64> =
            (0..).map(|i| f64::from(i) * STEP_DEG).take_while(|z| *z <= LOWEST_DEG).collect();
        let n = zenith.len();
        let station_has = |name: &str| station.channels.iter().any(|c| c.name == name);
        let channels = night.channels.iter().filter(|row| station_has(&row.channel));
        let one = |name: &str| ChannelCurve {
            name: name.to_owned(),
            rate_hz: vec![1.0; n],
            sigma_hz: vec![1.0; n],
            flags: vec![Flags::empty(); n],
            model_error_hz: None,
            common_sigma_hz: None,
        };
        let curve = LightCurve {
            kind: RateKind::Linear,
            samples: Samples { zenith_deg: Some(zenith), ..Samples::new(vec![start; n], 1.0) },
            channels: channels.map(|row| one(&row.channel)).collect(),
            provenance: Provenance::default(),
            other: Default::default(),
        };
        let file = calibration.file.clone();
        let input = ApplyInput { nights: nights.clone(), curve, files: [file.clone(), file] };
        let said = |error: &dyn std::fmt::Display| format!("no magnitudes: {error}");
        let mut found = apply(&input, station, Some(&night.night)).map_err(|e| said(&e))?;
        let air = station.air_options().and_then(|options| Air::new(&options));
        let air = air.map_err(|e| said(&e))?;
        let options = PhotometryOptions::default();
        found.add_photometry(station, &air, &options).map_err(|e| said(&e))?;
        let photometry = found.photometry.as_ref().ok_or("no magnitudes")?;
        let row = |name: &str| night.channel(name).map_or(f64::NAN, |row| MAG * row.relative_sigma);
        let channels = photometry.channels.iter();
        Ok(Self {
            zero: channels.clone().map(|c| (c.name.clone(), c.magnitude.clone())).collect(),
            view: MagnitudesView {
                said: format!(
                    "{} above the air, of light like {}, by κ of {} ({})",
                    options.band, photometry.spectrum, night.night, calibration.file.file
                ),
                channels: channels.map(|c| (c.name.clone(), row(&c.name))).collect(),
                warnings: found.warnings,
            },
        })
    }

    /// Magnitude and its σ of a linear rate without sky; `None` without a rate above 0, too low in the sky, or without a κ.
    pub fn magnitude(
        &self,
        channel: &str,
        zenith_deg: f64,
        rate: f64,
        sigma: f64,
    ) -> Option<(f64, f64)> {
        let zero = self.zero.get(channel)?;
        if !(rate > 0.0 && rate.is_finite() && (0.0..=LOWEST_DEG).contains(&zenith_deg)) {
            return None;
        }
        let at = zenith_deg / STEP_DEG;
        let lower = (at as usize).min(zero.len().checked_sub(2)?);
        let part = at - lower as f64;
        let zero = zero[lower] + part * (zero[lower + 1] - zero[lower]);
        let magnitude = zero - 2.5 * rate.log10();
        (magnitude.is_finite() && sigma.is_finite()).then_some((magnitude, MAG * sigma / rate))
    }

    /// Magnitudes of counted points. `target` has the target at a time, `off` the rates of the sky by channel. A point in which one target follows another has none: it holds part of the light of each.
    pub fn points(
        &self,
        points: Points<'_>,
        corrected: &Corrected,
        pointing: &mut Pointing,
        start: Epoch,
        target: &dyn Fn(Epoch) -> Option<Target>,
        off: &dyn Fn(Epoch) -> Vec<Option<Off>>,
    ) -> PointMagnitudes {
        let each = || vec![Vec::with_capacity(points.start_s.len()); points.channels.len()];
        let mut found = PointMagnitudes { magnitude: each(), sigma_mag: each() };
        // The star's place at a time.
        let mut held: Option<(Target, f64, f64)> = None;
        for (i, (start_s, length_s)) in points.start_s.iter().zip(points.length_s).enumerate() {
            let middle_s = start_s + 0.5 * length_s;
            let utc = start + hifitime::Duration::from_seconds(middle_s);
            // An edge may be a rounding error early or late.
            let edge = hifitime::Duration::from_seconds((0.5 * length_s - 1e-6).max(0.0));
            let seen = target(utc).filter(|seen| {
                matches!(seen.target_kind, TargetKind::Star | TargetKind::Satellite)
                    && [utc - edge, utc + edge]
                        .into_iter()
                        .all(|at| target(at).as_ref() == Some(seen))
            });
            let zenith_deg = seen.and_then(|target| {
                if let Some((of, at_s, zenith_deg)) = &held
                    && target.target_kind == TargetKind::Star
                    && *of == target
                    && (middle_s - at_s).abs() < STAR_S
                {
                    return Some(*zenith_deg);
                }
                let altitude = pointing.horizontal_deg(&target, utc)?.altitude_deg;
                held = Some((target, middle_s, 90.0 - altitude));
                Some(90.0 - altitude)
            });
            let sky = if zenith_deg.is_some() { off(utc) } else { Vec::new() };
            for (c, channel) in points.channels.iter().enumerate() {
                let value = zenith_deg.and_then(|zenith_deg| {
                    let (rate, sigma) =
                        corrected.linear(channel, points.rate_hz[c][i], *length_s)?;
                    let (sky, sky_sigma) = sky.get(c).copied().flatten()?;
                    let (rate, sigma) = (rate - sky, sigma.hypot(sky_sigma));
                    // Below its own σ a rate has a magnitude that says nothing.
                    if rate < sigma {
                        None
                    } else {
                        self.magnitude(channel, zenith_deg, rate, sigma)
                    }
                });
                found.magnitude[c].push(value.map(|(magnitude, _)| magnitude));
                found.sigma_mag[c].push(value.map(|(_, sigma)| sigma));
            }
        }
        found
    }
}

/// Rate of the sky in each channel by the points of a visit to it: the mean of those within 5 σ of their median, so that a star that passes through is left out. `points` are counts by channel, length and flags.
pub(crate) fn sky_of(
    corrected: &Corrected,
    channels: &[String],
    points: &[(&[u64], f64, u32)],
) -> Vec<Option<Off>> {
    let free = sunglint_formats::CountFlags::CLOCK_FREE.bits();
    let of = |(c, channel): (usize, &String)| {
        let good = points.iter().filter(|(_, _, flags)| flags & !free == 0);
        let rates: Vec<(f64, f64)> = good
            .filter_map(|(counts, length_s, _)| {
                corrected.linear(channel, *counts.get(c)? as f64 / length_s, *length_s)
            })
            .collect();
        let middle = median(rates.iter().map(|(rate, _)| *rate))?;
        let scatter = robust_sigma(rates.iter().map(|(rate, _)| rate - middle))?;
        let kept: Vec<(f64, f64)> = rates
            .into_iter()
            .filter(|(rate, sigma)| (rate - middle).abs() <= CLIP * scatter.max(*sigma))
            .collect();
        let n = kept.len() as f64;
        if kept.len() < LEAST {
            return None;
        }
        let mean = kept.iter().map(|(rate, _)| rate).sum::<f64>() / n;
        let counting = kept.iter().map(|(_, sigma)| sigma * sigma).sum::<f64>().sqrt() / n;
        Some((mean, counting.max(scatter / n.sqrt())))
    };
    channels.iter().enumerate().map(of).collect()
}
