//! Range data of simulated shots as a station would deliver them: full rate and normal points in the ILRS's CRD format.

use crate::{json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_ephemeris::orbit::tle::Tle;
use sunglint_formats::EncodeError;
use sunglint_formats::crd::{self, Crd, NormalPoint, Record, Session, Shot, Station, Target};
use sunglint_formats::time::{UtcDay, format_utc, tai_nanoseconds};
use sunglint_radiometry::station::{Detector, Laser, Ranging};
use sunglint_simulator::pass::Pass;
use sunglint_simulator::ranging::{
    Detection, LEAST_SHOTS, Moments, NormalPoints, Residual, Returns, Shots,
};

/// Name of the configuration in a file.
const CONFIGURATION: &str = "std";
/// Letters of a target's name in a file.
const LONGEST_NAME: usize = 10;
/// UTC of the BIPM among the time scales of the format.
const UTC_BIPM: i64 = 7;
/// Epochs are those at which pulses leave the station.
const SENT: i64 = 2;
/// Filter flags: counts that are none of the target's, returns.
const NOISE: i64 = 1;
const DATA: i64 = 2;

#[derive(Serialize)]
struct Document<'a> {
    laser: &'a str,
    shots: u64,
    returns: usize,
    noise: usize,
    normal_points: usize,
    rejected: usize,
    in_small_bins: usize,
    rms_ps: Option<f64>,
}

/// Sessions of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Each detection.
    FullRate,
    /// Normal points alone.
    NormalPoints,
    /// Both, one after the other.
    Both,
}

impl Content {
    /// Returns the content of files with this extension (without the dot, in small letters), as the ILRS names them; `crd` has all.
    ///
    /// ```
    /// use sunglint_report::simulate::active::Content;
    ///
    /// assert_eq!(Content::of_extension("frd"), Some(Content::FullRate));
    /// assert_eq!(Content::of_extension("ecsv"), None);
    /// ```
    pub fn of_extension(extension: &str) -> Option<Self> {
        Some(match extension {
            "crd" => Self::Both,
            "frd" | "fr2" => Self::FullRate,
            "npt" | "np2" => Self::NormalPoints,
            _ => return None,
        })
    }
}

/// Why there are no range data.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RangeDataError {
    /// Nothing to deliver.
    #[error(
        "laser {laser}: of {fired} shots none was detected, so there are no range data to write"
    )]
    Nothing {
        /// The laser.
        laser: String,
        /// Shots.
        fired: u64,
    },
    /// An epoch without UTC.
    #[error("range data need epochs from 1972 to 2100")]
    Epoch,
    /// A record that cannot be written.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

/// Range data of one laser.
#[derive(Debug, Clone)]
pub struct RangeData<'a> {
    pass: &'a Pass,
    laser: &'a Laser,
    channel: usize,
    ranging: &'a Ranging,
    shots: Shots,
    day: UtcDay,
    /// The first of the pass's times, s after 0 h UTC.
    begin_s: f64,
    normal: NormalPoints,
    /// Detections that are returns: what normal points are made of.
    returns: Vec<Detection>,
}

impl<'a> RangeData<'a> {
    /// Range data of the shots that were drawn along a pass, and the normal points of those that are returns.
    ///
    /// # Errors
    /// No detection; epochs without UTC.
    pub fn new(
        pass: &'a Pass,
        returns: &Returns<'a>,
        ranging: &'a Ranging,
        shots: Shots,
    ) -> Result<Self, RangeDataError> {
        let (laser, channel) = (returns.laser, returns.channel);
        let day = UtcDay::containing(pass.times[0]).ok_or(RangeDataError::Epoch)?;
        let begin_s = (tai_nanoseconds(pass.times[0]) - day.start_tai_ns) as f64 * 1e-9;
        if shots.detections.is_empty() {
            let (laser, fired) = (laser.name.clone(), shots.count());
            return Err(RangeDataError::Nothing { laser, fired });
        }
        let returns: Vec<Detection> =
            shots.detections.iter().filter(|d| !d.is_noise).copied().collect();
        let residual = |d: &Detection| Residual {
            sent_s: begin_s + d.sent_s,
            residual_s: d.flight_s - d.predicted_s,
        };
        let residuals: Vec<Residual> = returns.iter().map(residual).collect();
        let normal = NormalPoints::new(&residuals, ranging.normal_point_s);
        Ok(Self { pass, laser, channel, ranging, shots, day, begin_s, normal, returns })
    }

    fn noise(&self) -> usize {
        self.shots.detections.len() - self.returns.len()
    }

    /// The text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let _ = writeln!(
            text,
            "  range data of {}: {} shots, {} recorded: {} returns, {} counts of noise",
            self.laser.name,
            self.shots.count(),
            self.shots.detections.len(),
            self.returns.len(),
            self.noise()
        );
        let _ = writeln!(
            text,
            "    {} normal points of {} s; {} returns beyond three rms are in none, {} in bins of fewer than {LEAST_SHOTS}",
            self.normal.points.len(),
            self.ranging.normal_point_s,
            self.normal.rejected,
            self.normal.in_small_bins
        );
        if let Some(moments) = self.normal.moments {
            let _ = writeln!(
                text,
                "    rms of a return {:.1} ps, skewness {}, kurtosis {}",
                1e12 * moments.rms_s,
                moments.skewness.map_or("-".to_owned(), |s| format!("{s:.3}")),
                moments.kurtosis.map_or("-".to_owned(), |k| format!("{k:.3}"))
            );
        }
        text
    }

    /// Summary with its documented keys.
    pub fn json(&self) -> Value {
        json_of(&Document {
            laser: &self.laser.name,
            shots: self.shots.count(),
            returns: self.returns.len(),
            noise: self.noise(),
            normal_points: self.normal.points.len(),
            rejected: self.normal.rejected,
            in_small_bins: self.normal.in_small_bins,
            rms_ps: self.normal.moments.map(|m| rounded(1e12 * m.rms_s)),
        })
    }

    /// Adds headers and sessions to a file.
    fn add(&self, content: Content, lines: &mut Vec<Record>) -> Result<(), RangeDataError> {
        let last = self.shots.detections.last().map_or(0.0, |d| d.sent_s + d.flight_s);
        let [year, month, day, hour, ..] = self.civil(last, 0.0)?;
        let made = [year, month, day, hour].map(|n| u16::try_from(n).unwrap_or_default());
        lines.push(Record::Made(made));
        lines.push(Record::Station(Station {
            name: self.ranging.station.clone(),
            numbers: {
                let [pad, system, occupancy] = self.ranging.numbers.map(i64::from);
                [pad, system, occupancy, UTC_BIPM]
            },
            network: Some(self.ranging.network.clone().unwrap_or_else(|| "na".into())),
        }));
        lines.push(Record::Target(self.target()));
        if content != Content::NormalPoints {
            self.full_rate(lines)?;
        }
        if content != Content::FullRate {
            self.normal_points(lines)?;
        }
        Ok(())
    }

    fn target(&self) -> Target {
        let tle = match &self.pass.orbit {
            Orbit::Tle(orbit) => Some(orbit.tle()),
            _ => None,
        };
        let name = tle.and_then(|t| t.name.clone()).unwrap_or_else(|| match tle {
            Some(tle) => tle.norad_id.to_string(),
            None => self.pass.orbit.name(),
        });
        let letters = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        let name: String = name.chars().filter(letters).take(LONGEST_NAME).collect();
        let [ilrs, sic] = self.ranging.target.map(|n| n.map(i64::from));
        Target {
            name: if name.is_empty() { "unknown".into() } else { name },
            numbers: [
                ilrs.or_else(|| tle.and_then(ilrs_number)),
                sic,
                tle.map(|t| t.norad_id.into()),
            ],
            // No transponder; a passive reflector, or nothing that is one.
            kinds: [0, i64::from(!self.pass.target.retros.cubes.is_empty())],
            // About the Earth.
            place: Some(1),
        }
    }

    /// The whole second of UTC at or before a time (s after the first of the pass's times), `later` seconds on.
    fn civil(&self, after_s: f64, later: f64) -> Result<[i64; 6], RangeDataError> {
        let whole = (self.begin_s + after_s).floor() + later;
        let ns = self.day.start_tai_ns + (whole * 1e9) as i128;
        let epoch =
            hifitime::Epoch::from_tai_duration(hifitime::Duration::from_total_nanoseconds(ns));
        let text = format_utc(epoch, 0);
        let mut parts = text.split(|c: char| !c.is_ascii_digit()).filter_map(|w| w.parse().ok());
        let mut all = [0; 6];
        for part in &mut all {
            *part = parts.next().ok_or(RangeDataError::Epoch)?;
        }
        Ok(all)
    }

    /// The second of the day, which begins again at midnight.
    fn second_s(&self, sent_s: f64) -> f64 {
        let second = self.begin_s + sent_s;
        let length = self.day.length_ns as f64 * 1e-9;
        let second = if second >= length { second - length } else { second };
        (second * 1e12).round() * 1e-12
    }

    fn session(&self, data: i64, first: f64, last: f64) -> Result<Record, RangeDataError> {
        Ok(Record::Session(Session {
            data,
            from: self.civil(first, 0.0)?,
            to: self.civil(last, 1.0)?.map(Some),
            // First release; no air in the ranges, so that nothing is left to correct for it; not to the middle of the mass; no amplitude; no delay of the station; two ways; good.
            flags: [0, 1, 0, 0, 1, 0, 2, 0],
        }))
    }

    fn configuration(&self, lines: &mut Vec<Record>) {
        let laser = self.laser;
        let nm = laser.wavelength_nm;
        let version = env!("CARGO_PKG_VERSION");
        let dark_khz = self.dark_khz().map_or("na".to_owned(), |khz| format!("{khz:.3}"));
        let records = [
            format!("C0 0 {nm:.3} {CONFIGURATION} las det tim sof"),
            format!(
                "C1 0 las simulated {nm:.2} {} {:.4} {:.1} {} na",
                laser.repetition_rate_hz,
                1e3 * laser.pulse_energy_j,
                1e12 * laser.pulse_length_s,
                laser.divergence_arcsec
            ),
            format!("C2 0 det simulated {nm:.3} na na {dark_khz} na na na na na none na na na"),
            "C3 0 tim simulated simulated simulated na 0.0".to_owned(),
            format!("C5 0 sof sunglint {version} sunglint {version}"),
        ];
        lines.extend(records.map(Record::Other));
    }

    fn dark_khz(&self) -> Option<f64> {
        match &self.pass.station.channels.get(self.channel)?.detector {
            Detector::Counter(counter) => Some(1e-3 * counter.dark_rate_hz),
            _ => None,
        }
    }

    fn full_rate(&self, lines: &mut Vec<Record>) -> Result<(), RangeDataError> {
        let all = &self.shots.detections;
        let ends = [all.first(), all.last()].map(|d| d.map_or(0.0, |d| d.sent_s));
        lines.push(self.session(0, ends[0], ends[1])?);
        self.configuration(lines);
        lines.extend(all.iter().map(|d| {
            Record::Shot(Shot {
                second_s: self.second_s(d.sent_s),
                flight_s: picoseconds(d.flight_s),
                configuration: CONFIGURATION.into(),
                flags: [SENT, if d.is_noise { NOISE } else { DATA }, 0, 0],
                amplitudes: [None, None],
            })
        }));
        lines.push(Record::EndOfSession);
        Ok(())
    }

    fn normal_points(&self, lines: &mut Vec<Record>) -> Result<(), RangeDataError> {
        let points = &self.normal.points;
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            lines.push(Record::Other(format!(
                "00 no normal points: no bin of {} s has {LEAST_SHOTS} returns",
                self.ranging.normal_point_s
            )));
            return Ok(());
        };
        let sent_s = |number: usize| self.returns[number].sent_s;
        lines.push(self.session(1, sent_s(first.nearest), sent_s(last.nearest))?);
        self.configuration(lines);
        for point in points {
            let shot = self.returns[point.nearest];
            let from_s = point.from_s - self.begin_s;
            let bin_s = self.ranging.normal_point_s;
            let fired = self.shots.fired_within(from_s, from_s + bin_s);
            let [rms, skewness, kurtosis] = statistics(&point.moments);
            let rate = 100.0 * point.moments.count as f64 / fired.max(1) as f64;
            lines.push(Record::NormalPoint(NormalPoint {
                second_s: self.second_s(shot.sent_s),
                flight_s: picoseconds(shot.flight_s + point.shift_s),
                configuration: CONFIGURATION.into(),
                event: SENT,
                bin_s: Some(bin_s),
                shots: point.moments.count as i64,
                statistics: [rms, skewness, kurtosis, None, Some(digits(rate, 2))],
                channel: Some(0),
                signal_to_noise: None,
            }));
        }
        if let Some(moments) = &self.normal.moments {
            let all = statistics(moments).map(|v| v.map_or("na".to_owned(), |v| v.to_string()));
            lines.push(Record::Other(format!("50 {CONFIGURATION} {} na 0", all.join(" "))));
        }
        lines.push(Record::EndOfSession);
        Ok(())
    }
}

/// Rms (ps), skewness and kurtosis in the digits of the format.
fn statistics(moments: &Moments) -> [Option<f64>; 3] {
    let three = |v: Option<f64>| v.map(|v| digits(v, 3));
    [Some(digits(1e12 * moments.rms_s, 1)), three(moments.skewness), three(moments.kurtosis)]
}

fn digits(value: f64, after: i32) -> f64 {
    let by = 10_f64.powi(after);
    (value * by).round() / by
}

fn picoseconds(seconds: f64) -> f64 {
    (seconds * 1e12).round() / 1e12
}

/// The ILRS's number of a satellite: year, launch and part of its international designator (`1976-039A` is 7603901).
fn ilrs_number(tle: &Tle) -> Option<i64> {
    let (year, launch) = tle.international_designator.as_deref()?.split_once('-')?;
    let (launch, part) = launch.split_at_checked(3)?;
    let mut letters = part.trim().chars();
    let (letter, None) = (letters.next()?, letters.next()) else { return None };
    let part = letter.is_ascii_uppercase().then(|| i64::from(letter as u8 - b'A') + 1)?;
    let year = year.parse::<i64>().ok()?.rem_euclid(100);
    Some(year * 100_000 + launch.parse::<i64>().ok()? * 100 + part)
}

/// A file of range data of some lasers.
///
/// # Errors
/// Records that cannot be written.
pub fn range_file(all: &[RangeData<'_>], content: Content) -> Result<String, RangeDataError> {
    let mut records = vec![Record::Other(format!(
        "00 SIMULATED by sunglint {}: no station measured this; the ranges have no air in them",
        env!("CARGO_PKG_VERSION")
    ))];
    for data in all {
        data.add(content, &mut records)?;
    }
    records.push(Record::EndOfFile);
    let lines = records.into_iter().map(Into::into).collect();
    Ok(crd::to_string(&Crd { version: 2, lines })?)
}
