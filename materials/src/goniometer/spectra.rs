//! A spectrometer's readings at a place: counts per second in each channel, with the integration that suits the light.

use super::channels::{Band, SpectrometerPlan};
use crate::log::RecordError;
use crate::reading::{State, TRIES, TRY_AGAIN};
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{DeviceError, Spectrometer, Spectrum};
use sunglint_numerics::measured::Interval;

/// Why there is no spectrum.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// Somebody stopped it.
    #[error("stopped")]
    Stopped,
    /// The spectrometer's error, the last time.
    #[error(transparent)]
    Device(DeviceError),
    /// An answer that is no spectrum of this spectrometer.
    #[error(
        "the spectrometer answered {found} values, expected {expected} (is a cable loose, or is it asked by another program, too?)"
    )]
    Short {
        /// Values of the answer that are numbers.
        found: usize,
        /// Pixels.
        expected: usize,
    },
    /// A channel that no pixel lies in.
    #[error(
        "the channel at {nm} nm, {width_nm} nm wide, holds no pixel: the spectrometer's lie from {from_nm:.2} to {to_nm:.2} nm, about {step_nm:.2} nm apart; correct channels_nm or bands of [spectrometer]"
    )]
    NoPixel {
        /// Middle of the channel, nm.
        nm: f64,
        /// Width, nm.
        width_nm: f64,
        /// First pixel, nm.
        from_nm: f64,
        /// Last pixel, nm.
        to_nm: f64,
        /// Mean distance of pixels, nm.
        step_nm: f64,
    },
    /// A channel that goes beyond the spectrum.
    #[error(
        "the channel at {nm} nm, {width_nm} nm wide, goes beyond the spectrometer's pixels, which lie from {from_nm:.2} to {to_nm:.2} nm; correct channels_nm or bands of [spectrometer]"
    )]
    Beyond {
        /// Middle of the channel, nm.
        nm: f64,
        /// Width, nm.
        width_nm: f64,
        /// First pixel, nm.
        from_nm: f64,
        /// Last pixel, nm.
        to_nm: f64,
    },
    /// An integration that the spectrometer does not take.
    #[error(
        "integration_s of [spectrometer] has {asked_s} s, and the spectrometer takes {least_s} to {most_s} s{}",
        if *is_auto { "; name times within, such as integration_s = [0.01, 0.1, 1.0], in place of \"auto\"" } else { "" }
    )]
    Integration {
        /// Asked for, s.
        asked_s: f64,
        /// Shortest, s.
        least_s: f64,
        /// Longest, s.
        most_s: f64,
        /// Whether the times were those of `auto`.
        is_auto: bool,
    },
    /// The converter's end is not known.
    #[error(
        "the spectrometer does not tell where its converter ends, so that nobody sees which integration is too long: name it as saturation_counts in [spectrometer]"
    )]
    NoEnd,
    /// Readings that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
}

/// A part of the converter's range up to which the next longer integration is expected to fill it at most.
const FULL: f64 = 0.7;

/// A spectrometer with what it takes to read it.
pub struct SpectrumReader<'a> {
    /// The spectrometer.
    pub device: &'a mut dyn Spectrometer,
    /// Clock of the spectrometer.
    pub clock: &'a DeviceClock,
    /// Stops it.
    pub cancel: &'a Cancel,
    /// Keys of the spectrometer in the file.
    pub plan: &'a SpectrometerPlan,
    /// Channels.
    pub bands: &'a [Band],
    /// Readings at a place.
    pub readings: u32,
    /// Wait between readings, s.
    pub interval_s: f64,
    /// Counts of the brightest channel in the dark at each integration, which do not all grow with time; not a number where they are not known.
    pub dark_counts: &'a [f64],
    /// Integration of the spectrum before, s: the spectrometer may still be at work with it.
    pub before_s: f64,
}

/// Pixels of a channel, as places among all.
fn pixels(wavelength_nm: &[f64], band: &Band) -> std::ops::Range<usize> {
    let Interval { low: from, high: to } = band.ends_nm();
    let first = wavelength_nm.partition_point(|nm| *nm < from);
    first..wavelength_nm.partition_point(|nm| *nm < to).max(first)
}

/// Whether a channel lies within values at `wavelength_nm`, rising, each of which stands for half a step to both sides.
pub(super) fn is_within(wavelength_nm: &[f64], band: &Band) -> bool {
    let [first, second, ..] = *wavelength_nm else { return false };
    let [.., before, last] = *wavelength_nm else { return false };
    // A little more than half, for numbers that are rounded.
    let half = 0.5 + 1e-6;
    let Interval { low, high } = band.ends_nm();
    low >= first - half * (second - first) && high <= last + half * (last - before)
}

/// Looks whether a spectrometer has all channels and takes all integrations of a plan.
///
/// # Errors
/// A channel without a pixel, an integration out of its range.
pub fn check(
    device: &dyn Spectrometer,
    plan: &SpectrometerPlan,
    bands: &[Band],
) -> Result<(), SpectrumError> {
    let nm = device.wavelength_nm();
    for band in bands {
        if pixels(nm, band).is_empty() {
            let (from_nm, to_nm) = (nm.first(), nm.last());
            let (from_nm, to_nm) =
                (from_nm.copied().unwrap_or(f64::NAN), to_nm.copied().unwrap_or(f64::NAN));
            let step_nm = (to_nm - from_nm) / (nm.len().saturating_sub(1)).max(1) as f64;
            let Band { nm, width_nm } = *band;
            return Err(SpectrumError::NoPixel { nm, width_nm, from_nm, to_nm, step_nm });
        }
        if !is_within(nm, band) {
            let (from_nm, to_nm) = (nm[0], nm[nm.len() - 1]);
            let Band { nm, width_nm } = *band;
            return Err(SpectrumError::Beyond { nm, width_nm, from_nm, to_nm });
        }
    }
    if let Some(range) = device.integration_s() {
        for asked_s in plan.integrations_s() {
            if !(range.low..=range.high).contains(&asked_s) {
                return Err(SpectrumError::Integration {
                    asked_s,
                    least_s: range.low,
                    most_s: range.high,
                    is_auto: matches!(plan.integration_s, super::channels::Integration::Word(_)),
                });
            }
        }
    }
    Ok(())
}

/// A spectrum in channels.
struct Binned {
    /// Counts per second; infinite where a pixel is at the converter's end.
    per_s: Vec<f64>,
    /// The largest value in all channels, counts.
    most: f64,
    /// The converter's end, counts.
    end: f64,
}

impl SpectrumReader<'_> {
    fn within(&self, s: f64) -> Deadline {
        Deadline::after(self.clock.clock.clone(), Duration::from_secs_f64(s))
            .with_cancel(self.cancel)
    }

    fn wait(&self, s: f64) -> Result<(), SpectrumError> {
        let wait = self.within(s + 1.0).sleep(Duration::from_secs_f64(s));
        wait.map_err(|_| SpectrumError::Stopped)
    }

    /// All readings at a place, which `place` names for people. `integration` is one among the plan's that is taken whatever the light is, or (as an error) the one to begin with where the light decides.
    /// Gives the one that was taken. `keep` takes a reading, or a word about those before it, with the integration in s; what happened comes into `events`.
    ///
    /// # Errors
    /// See [`SpectrumError`]; what was read until then is kept.
    pub fn take(
        &mut self,
        place: &str,
        integration: Result<usize, usize>,
        keep: &mut dyn FnMut(Vec<f64>, State, f64) -> Result<(), RecordError>,
        events: &mut Vec<String>,
    ) -> Result<usize, SpectrumError> {
        self.wait(self.plan.settle_s.get())?;
        let all = self.plan.integrations_s();
        let last = all.len() - 1;
        let mut now = match integration {
            Ok(now) => now.min(last),
            Err(first) => self.choose(place, first.min(last), &all, events)?,
        };
        let chooses = integration.is_err();
        loop {
            let mut saturated = false;
            for number in 0..self.readings {
                if number > 0 {
                    self.wait(self.interval_s)?;
                }
                let per_s = self.reading(place, all[now], events)?;
                let is_over = per_s.iter().all(|value| value.is_infinite());
                saturated |= per_s.iter().any(|value| value.is_infinite());
                let state = if is_over { State::Over } else { State::Read };
                keep(per_s, state, all[now])?;
            }
            let blank = vec![f64::NAN; self.bands.len()];
            // With a shorter one all channels have values; at the shortest those that are saturated have none.
            if saturated && chooses && now > 0 {
                keep(blank, State::Again, all[now])?;
                now -= 1;
                continue;
            }
            keep(blank, State::Kept, all[now])?;
            return Ok(now);
        }
    }

    /// The longest integration that does not fill the converter.
    fn choose(
        &mut self,
        place: &str,
        first: usize,
        all: &[f64],
        events: &mut Vec<String>,
    ) -> Result<usize, SpectrumError> {
        if all.len() == 1 {
            return Ok(0);
        }
        let (mut now, mut most) = (first, all.len() - 1);
        loop {
            let seen = self.spectrum(place, all[now], events)?;
            let end = seen.end;
            if seen.most >= end {
                if now == 0 {
                    return Ok(0);
                }
                now -= 1;
                most = now;
                continue;
            }
            if now == most {
                return Ok(now);
            }
            // What is there in the dark does not grow as the light does.
            let dark = |k: usize| self.dark_counts.get(k).copied().filter(|d| d.is_finite());
            let (here, next) = dark(now).zip(dark(now + 1)).unwrap_or((0.0, 0.0));
            let expected = (seen.most - here) * all[now + 1] / all[now] + next;
            if expected >= FULL * end {
                return Ok(now);
            }
            now += 1;
        }
    }

    /// The mean of so many spectra as the plan says.
    fn reading(
        &mut self,
        place: &str,
        integration_s: f64,
        events: &mut Vec<String>,
    ) -> Result<Vec<f64>, SpectrumError> {
        let mut sum = vec![0.0; self.bands.len()];
        for _ in 0..self.plan.average {
            let seen = self.spectrum(place, integration_s, events)?;
            for (sum, value) in sum.iter_mut().zip(&seen.per_s) {
                *sum += value;
            }
        }
        let n = f64::from(self.plan.average);
        Ok(sum.into_iter().map(|sum| sum / n).collect())
    }

    /// A spectrum in channels; a spectrometer that fails is asked again a little later.
    fn spectrum(
        &mut self,
        place: &str,
        integration_s: f64,
        events: &mut Vec<String>,
    ) -> Result<Binned, SpectrumError> {
        for attempt in 1.. {
            // A spectrometer that runs by itself ends the exposure that it is at, throws one away and takes the next.
            let away_s = 2.0 * integration_s.max(self.before_s);
            let deadline = self.within(away_s + integration_s + self.plan.timeout_s.get());
            let answer = self.device.expose(integration_s, &deadline);
            // One that failed may have come before the exposure's end.
            self.before_s = match answer {
                Ok(_) => integration_s,
                Err(_) => integration_s.max(self.before_s),
            };
            let failed = match answer {
                Ok(spectrum) => match self.binned(&spectrum) {
                    Ok(binned) => return Ok(binned),
                    // Another spectrum does not tell it either.
                    Err(SpectrumError::NoEnd) => return Err(SpectrumError::NoEnd),
                    Err(error) => error,
                },
                Err(DeviceError::Cancelled { .. }) => return Err(SpectrumError::Stopped),
                Err(error) => SpectrumError::Device(error),
            };
            if attempt >= TRIES {
                return Err(failed);
            }
            events.push(format!("{place}, try {attempt} of {TRIES}: {failed}"));
            self.wait(TRY_AGAIN.as_secs_f64())?;
        }
        Err(SpectrumError::Stopped)
    }

    fn binned(&self, spectrum: &Spectrum) -> Result<Binned, SpectrumError> {
        let nm = self.device.wavelength_nm();
        let numbers = spectrum.counts.iter().filter(|value| value.is_finite()).count();
        let (found, expected) = (numbers.min(spectrum.wavelength_nm.len()), nm.len());
        if numbers != spectrum.counts.len() || found != expected {
            return Err(SpectrumError::Short { found, expected });
        }
        let named = self.plan.saturation_counts.map(|counts| counts.get());
        // The first dark says so, before anything else is read.
        let end = named.or(spectrum.saturation_counts).ok_or(SpectrumError::NoEnd)?;
        let mut most = f64::NEG_INFINITY;
        let one = |band: &Band| {
            let values = &spectrum.counts[pixels(nm, band)];
            let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            most = most.max(largest);
            if largest >= end {
                return f64::INFINITY;
            }
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            mean / spectrum.integration_s
        };
        let per_s: Vec<f64> = self.bands.iter().map(one).collect();
        if per_s.iter().any(|value| value.is_nan()) {
            return Err(SpectrumError::Short { found: 0, expected });
        }
        Ok(Binned { per_s, most, end })
    }
}
