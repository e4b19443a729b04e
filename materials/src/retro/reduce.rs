//! A run as retro-reflection.

use super::readings::{Mean, means};
use super::{
    AtAngle, Components, Known, Measured, Note, Reference, Retro, RetroError, Row, Scale, Setup,
};
use crate::ndf::{NdfOptions, ZeroOrigin, extract, zero_by_law};
use crate::table::{Reading, RetroFlags, RetroTable};

/// Light below so many standard deviations is none that was seen.
const DETECTED: f64 = 3.0;
/// A change of the laser between two incident readings that is worth a warning.
const MUCH_DRIFT: f64 = 0.02;

/// Retro-reflection of a run.
///
/// # Errors
/// A number of the setup that cannot be, no readings, incident readings that are no light or over range.
pub fn reduce(measured: &Measured, setup: &Setup) -> Result<Retro, RetroError> {
    check(setup)?;
    if measured.sample.is_empty() {
        return Err(RetroError::NoReadings("the sample"));
    }
    let mut notes = Vec::new();
    let signature = Signature::new(&measured.signature);
    let incident = incident(measured, setup, &signature)?;
    if measured.signature.is_empty() {
        notes.push(Note::NoSignature);
    }
    let (stop, stop_sigma) = (&setup.stop.0, setup.stop.1);
    let solid_angle_sr = stop.solid_angle_sr();
    // f cosθ per net power over incident power.
    let (factor, scale) = match &setup.reference {
        Reference::Power { transmission, splitter, lens } => {
            let through = splitter.value * lens.value * solid_angle_sr;
            let read = mean_relative(&incident);
            let scale = Scale {
                incident: read.hypot(transmission.relative_sigma),
                splitter: splitter.relative_sigma,
                lens: lens.relative_sigma,
                solid_angle: stop_sigma,
                standard: 0.0,
            };
            // The meter saw the incident power behind a filter.
            (transmission.value / through, scale)
        }
        Reference::Standard { f_per_sr, angle_deg } => {
            let scale = Scale {
                incident: mean_relative(&incident),
                standard: f_per_sr.relative_sigma,
                ..Scale::default()
            };
            (f_per_sr.value * angle_deg.to_radians().cos(), scale)
        }
    };
    let power = means(&measured.sample);
    let mut raw = Vec::with_capacity(power.len());
    let (mut beyond_signature, mut drift_unknown) = (0, 0);
    for (at, mean) in measured.sample.iter().zip(&power) {
        let without = signature.at(at.angle_deg);
        beyond_signature += usize::from(without.beyond);
        let (incident_w, drift) = laser(&incident, at.time_s);
        drift_unknown += usize::from(drift.is_none());
        // Stray light goes with the laser, which may have changed since the scan without a sample.
        let since = if without.w == 0.0 {
            0.0
        } else {
            (incident_w / laser(&incident, without.time_s).0 - 1.0) * without.w
        };
        let clear = if mean.over > 0 { f64::NAN } else { mean.power_w };
        raw.push(Raw {
            f_cos: (clear - without.w) / incident_w * factor,
            per_watt: factor / incident_w,
            readout_w: mean.sigma_w,
            signature_w: without.sigma_w.hypot(since),
            without_w: without.w,
            incident_w,
            drift: drift.unwrap_or(0.0),
        });
    }
    let zero = zero(setup, &measured.sample, &raw, &mut notes);
    let rows = rows(setup, &measured.sample, &power, &raw, zero);
    if beyond_signature > 0 && !measured.signature.is_empty() {
        notes.push(Note::SignatureEnds { angles: beyond_signature });
    }
    if drift_unknown > 0 {
        notes.push(Note::DriftUnknown { angles: drift_unknown });
    }
    let change = |pair: &[Incident]| (pair[1].power_w / pair[0].power_w - 1.0).abs();
    let relative = incident.windows(2).map(change).fold(0.0, f64::max);
    if relative > MUCH_DRIFT {
        notes.push(Note::Drift { relative });
    }
    notes.extend(notes_of(setup, &rows));
    Ok(Retro {
        rows,
        wavelength_nm: setup.wavelength_nm,
        solid_angle_sr,
        cone_half_angle_deg: stop.cone_half_angle_deg(),
        cone_spread: stop.spread(),
        scale,
        zero,
        incident: incident.iter().map(|i| (i.time_s, i.power_w, i.sigma_w)).collect(),
        notes,
    })
}

/// Result at an angle before the division by its cosine.
struct Raw {
    /// f cosθ, sr⁻¹.
    f_cos: f64,
    /// f cosθ of one watt, sr⁻¹ W⁻¹.
    per_watt: f64,
    readout_w: f64,
    signature_w: f64,
    without_w: f64,
    incident_w: f64,
    /// Relative.
    drift: f64,
}

fn check(setup: &Setup) -> Result<(), RetroError> {
    let positive = |name: &'static str, found: f64| {
        let good = found.is_finite() && found > 0.0;
        good.then_some(()).ok_or(RetroError::Number { name, found, expected: "a number above 0" })
    };
    let size = |name: &'static str, found: f64| {
        let good = found.is_finite() && found >= 0.0;
        let expected = "a number of 0 or above";
        good.then_some(()).ok_or(RetroError::Number { name, found, expected })
    };
    let known = |name: &'static str, known: &Known, most: f64| {
        positive(name, known.value)?;
        size("relative uncertainty", known.relative_sigma)?;
        if known.value > most {
            let expected = "a fraction above 0, at most 1";
            return Err(RetroError::Number { name, found: known.value, expected });
        }
        Ok(())
    };
    positive("wavelength, nm", setup.wavelength_nm)?;
    setup.stop.0.check()?;
    size("relative uncertainty of the solid angle", setup.stop.1)?;
    size("uncertainty of the angle, deg", setup.angle_sigma_deg)?;
    size("uncertainty of the zero, deg", setup.zero_sigma_deg)?;
    size("largest offset, deg", setup.most_offset_deg)?;
    if let Some((spot, most)) = &setup.spot {
        spot.check()?;
        positive("part of the beam beside the sample", *most)?;
    }
    match &setup.reference {
        Reference::Power { transmission, splitter, lens } => {
            known("transmission of the filter", transmission, 1.0)?;
            known("reflectance of the beam splitter", splitter, 1.0)?;
            known("transmission of the lens", lens, 1.0)
        }
        Reference::Standard { f_per_sr, angle_deg } => {
            known("f of the standard, sr⁻¹", f_per_sr, f64::INFINITY)?;
            if angle_deg.is_nan() || angle_deg.abs() >= 90.0 {
                let (name, expected) = ("angle on the standard, deg", "between -90 and 90");
                return Err(RetroError::Number { name, found: *angle_deg, expected });
            }
            Ok(())
        }
    }
}

/// The scan without a sample.
struct Signature {
    /// Angle, mean, time; by angle.
    points: Vec<(f64, Mean, f64)>,
}

/// Power without a sample at an angle.
struct Without {
    w: f64,
    sigma_w: f64,
    time_s: f64,
    beyond: bool,
}

impl Signature {
    fn new(scan: &[AtAngle]) -> Self {
        let read = scan.iter().zip(means(scan)).filter(|(_, mean)| mean.used > 0);
        let mut points: Vec<_> = read.map(|(at, mean)| (at.angle_deg, mean, at.time_s)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { points }
    }

    /// Between its angles on a straight line, beyond its ends as at them. A thousandth of a step beside an angle is that angle.
    fn at(&self, angle_deg: f64) -> Without {
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else {
            return Without { w: 0.0, sigma_w: 0.0, time_s: 0.0, beyond: false };
        };
        let reach = (last.0 - first.0) / self.points.len() as f64;
        let beyond = angle_deg < first.0 - 0.5 * reach || angle_deg > last.0 + 0.5 * reach;
        let k = self.points.partition_point(|point| point.0 < angle_deg);
        let low = &self.points[k.saturating_sub(1)];
        let high = &self.points[k.min(self.points.len() - 1)];
        let width = high.0 - low.0;
        let part = if width > 0.0 { ((angle_deg - low.0) / width).clamp(0.0, 1.0) } else { 0.0 };
        let between = |a: f64, b: f64| a + part * (b - a);
        Without {
            w: between(low.1.power_w, high.1.power_w),
            sigma_w: ((1.0 - part) * low.1.sigma_w).hypot(part * high.1.sigma_w),
            time_s: between(low.2, high.2),
            beyond,
        }
    }
}

/// An incident reading.
struct Incident {
    time_s: f64,
    power_w: f64,
    sigma_w: f64,
}

fn incident(
    measured: &Measured,
    setup: &Setup,
    signature: &Signature,
) -> Result<Vec<Incident>, RetroError> {
    let mut found = Vec::new();
    // Each by itself: what lies between them may be the laser's change.
    for (k, at) in measured.incident.iter().enumerate() {
        let number = k + 1;
        if at.over > 0 {
            return Err(RetroError::IncidentOver { number });
        }
        let mean = means(std::slice::from_ref(at)).swap_remove(0);
        let (mut power_w, mut sigma_w) = (mean.power_w, mean.sigma_w);
        if matches!(setup.reference, Reference::Standard { .. }) {
            let without = signature.at(at.angle_deg);
            power_w -= without.w;
            sigma_w = sigma_w.hypot(without.sigma_w);
        }
        if power_w.is_nan() || power_w <= 0.0 {
            return Err(RetroError::NoLight { number, power_w });
        }
        found.push(Incident { time_s: at.time_s, power_w, sigma_w });
    }
    if found.is_empty() {
        return Err(RetroError::NoReadings("the incident power"));
    }
    found.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    Ok(found)
}

/// The relative standard uncertainty that the incident readings leave to all angles.
fn mean_relative(incident: &[Incident]) -> f64 {
    let square: f64 = incident.iter().map(|i| (i.sigma_w / i.power_w).powi(2)).sum();
    // Two readings share the angles between them: each counts for about half of all.
    square.sqrt() / incident.len() as f64
}

/// Standard deviation of the laser's own relative change between two incident readings (power and its standard uncertainty, W): what they differ by beyond their noise.
pub(crate) fn walk([low, high]: [(f64, f64); 2]) -> f64 {
    let middle = 0.5 * (low.0 + high.0);
    let noise = low.1.hypot(high.1) / middle;
    let change = (high.0 - low.0) / middle;
    (change * change - noise * noise).max(0.0).sqrt()
}

/// The incident power at a time, W, and its relative standard uncertainty there: of a random walk from one reading to the other, |Δ| √(x(1−x)), with Δ by [`walk`]; and of the noise of
/// the incident readings, less that of their mean, which all angles share ([`mean_relative`]). None before the first and after the last.
fn laser(incident: &[Incident], time_s: f64) -> (f64, Option<f64>) {
    let k = incident.partition_point(|i| i.time_s < time_s);
    let low = &incident[k.saturating_sub(1)];
    let high = &incident[k.min(incident.len() - 1)];
    let width = high.time_s - low.time_s;
    if width <= 0.0 {
        return (low.power_w, (low.time_s == time_s).then_some(0.0));
    }
    let part = (time_s - low.time_s) / width;
    let power_w = low.power_w + part * (high.power_w - low.power_w);
    let walk = walk([(low.power_w, low.sigma_w), (high.power_w, high.sigma_w)]);
    let share = 1.0 / incident.len() as f64;
    let variance = |i: &Incident| (i.sigma_w / i.power_w).powi(2);
    let tilt = |(j, i): (usize, &Incident)| {
        let on_line = match j {
            j if j + 1 == k => 1.0 - part,
            j if j == k => part,
            _ => 0.0,
        };
        (on_line - share).powi(2) * variance(i)
    };
    let noise: f64 = incident.iter().enumerate().map(tilt).sum();
    (power_w, Some((walk * walk * (part * (1.0 - part)).max(0.0) + noise).sqrt()))
}

/// The stage's angle at normal incidence. The cosine that f is divided by needs it; it is found from f cosθ, which is even about the normal as f is.
fn zero(
    setup: &Setup,
    sample: &[AtAngle],
    raw: &[Raw],
    notes: &mut Vec<Note>,
) -> (f64, f64, ZeroOrigin) {
    if let Some(zero_deg) = setup.zero_deg {
        return (zero_deg, setup.zero_sigma_deg, ZeroOrigin::Given);
    }
    let options = NdfOptions {
        elevations: Some(32),
        most_offset_deg: setup.most_offset_deg,
        resamplings: 0,
        diffuse: true,
        ..NdfOptions::default()
    };
    let reading = |(at, raw): (&AtAngle, &Raw)| {
        let mut flags = RetroFlags::empty();
        flags.set(RetroFlags::OVER_RANGE, raw.f_cos.is_nan());
        flags.set(RetroFlags::EDGE, spilled(setup, at.angle_deg).1);
        let sigma_w = raw.readout_w.hypot(raw.signature_w);
        Reading {
            angle_deg: at.angle_deg,
            azimuth_deg: 0.0,
            f_per_sr: raw.f_cos,
            sigma_f_per_sr: sigma_w * raw.per_watt,
            flags,
        }
    };
    let readings = sample.iter().zip(raw).map(reading).collect();
    let run = RetroTable { readings, ..RetroTable::default() };
    let reason = match extract(&run, &options) {
        Ok(ndf) => match ndf.profiles.first().map(|profile| profile.zero) {
            Some(zero) if zero.origin == ZeroOrigin::Fitted => {
                return (zero.angle_deg, zero.sigma_deg, ZeroOrigin::Fitted);
            }
            _ => {
                let shared: Vec<f64> = raw.iter().map(|raw| raw.drift).collect();
                let zero = zero_by_law(&run, &shared, setup.most_offset_deg);
                if let Some(zero) = zero.filter(|zero| zero.sigma_deg < setup.zero_sigma_deg) {
                    notes.push(Note::ZeroByLaw { sigma_deg: zero.sigma_deg });
                    return (zero.angle_deg, zero.sigma_deg, ZeroOrigin::Law);
                }
                "the readings on both sides of the normal do not decide it".into()
            }
        },
        Err(error) => error.to_string(),
    };
    notes.push(Note::ZeroAssumed { reason });
    (0.0, setup.zero_sigma_deg, ZeroOrigin::Assumed)
}

/// The part of the beam that passes beside the sample, and whether that is too much.
fn spilled(setup: &Setup, theta_deg: f64) -> (f64, bool) {
    match &setup.spot {
        None => (0.0, false),
        Some((spot, most)) => {
            let part = spot.spilled(theta_deg);
            (part, part > *most)
        }
    }
}

fn rows(
    setup: &Setup,
    sample: &[AtAngle],
    power: &[Mean],
    raw: &[Raw],
    zero: (f64, f64, ZeroOrigin),
) -> Vec<Row> {
    let cos = |k: usize| (sample[k].angle_deg - zero.0).to_radians().cos();
    let f: Vec<f64> = raw.iter().enumerate().map(|(k, raw)| raw.f_cos / cos(k)).collect();
    let mut by_angle: Vec<usize> = (0..sample.len()).filter(|k| f[*k] > 0.0).collect();
    by_angle.sort_by(|a, b| sample[*a].angle_deg.total_cmp(&sample[*b].angle_deg));
    let mut slopes = vec![0.0; sample.len()];
    for (place, k) in by_angle.iter().enumerate() {
        let low = by_angle[place.saturating_sub(1)];
        let high = by_angle[(place + 1).min(by_angle.len() - 1)];
        let width = sample[high].angle_deg - sample[low].angle_deg;
        if width > 0.0 {
            slopes[*k] = (f[high] / f[low]).ln() / width;
        }
    }
    (0..sample.len())
        .map(|k| {
            let (at, raw, mean) = (&sample[k], &raw[k], power[k]);
            let theta_deg = at.angle_deg - zero.0;
            let per_watt = raw.per_watt / cos(k);
            // The cosine with the mount's offset, and the lobe's slope with the stage's own error.
            let tan = theta_deg.to_radians().tan().abs() * zero.1.to_radians();
            let angle = tan.hypot(slopes[k] * setup.angle_sigma_deg);
            let components = Components {
                readout_per_sr: mean.sigma_w * per_watt,
                signature_per_sr: raw.signature_w * per_watt,
                drift_per_sr: raw.drift * f[k].abs(),
                angle_per_sr: angle * f[k].abs(),
            };
            let (spilled, is_edge) = spilled(setup, theta_deg);
            let seen = DETECTED * components.readout_per_sr.hypot(components.signature_per_sr);
            let mut flags = RetroFlags::empty();
            flags.set(RetroFlags::OVER_RANGE, mean.over > 0 || f[k].is_nan());
            flags.set(RetroFlags::NEGATIVE, f[k] < 0.0);
            flags.set(RetroFlags::BELOW_DETECTION, f[k] < seen);
            flags.set(RetroFlags::EDGE, is_edge);
            flags.set(RetroFlags::OUTLIERS, mean.left_out > 0);
            Row {
                angle_deg: at.angle_deg,
                time_s: at.time_s,
                f_per_sr: f[k],
                components,
                flags,
                power: mean,
                signature_w: raw.without_w,
                incident_w: raw.incident_w,
                spilled,
            }
        })
        .collect()
}

fn notes_of(setup: &Setup, rows: &[Row]) -> Vec<Note> {
    let with = |flag: RetroFlags| rows.iter().filter(move |r| r.flags.contains(flag));
    let mut notes = Vec::new();
    let ends = |(low, high): (f64, f64), r: &Row| (low.min(r.angle_deg), high.max(r.angle_deg));
    let angles = with(RetroFlags::OVER_RANGE).count();
    if angles > 0 {
        let nowhere = (f64::INFINITY, f64::NEG_INFINITY);
        let angles_deg = with(RetroFlags::OVER_RANGE).fold(nowhere, ends);
        notes.push(Note::OverRange { angles_deg, angles });
    }
    let angles = with(RetroFlags::NEGATIVE).count();
    if angles > 0 {
        notes.push(Note::Negative { angles });
    }
    let angles = with(RetroFlags::BELOW_DETECTION).count();
    if angles > 0 {
        notes.push(Note::BelowDetection { angles });
    }
    let limit = setup.spot.as_ref().and_then(|(spot, most)| spot.limit_deg(*most));
    let angles = with(RetroFlags::EDGE).count();
    if let (Some(from_deg), true) = (limit, angles > 0) {
        notes.push(Note::Edge { from_deg, angles });
    }
    let readings = rows.iter().map(|r| r.power.left_out).sum();
    if readings > 0 {
        notes.push(Note::Outliers { readings, angles: with(RetroFlags::OUTLIERS).count() });
    }
    notes
}

/// The smallest roughness that a cone lets one see: the half-vector is blurred by half of its angle.
///
/// ```
/// // A cone of 1° half-angle turns the half-vector by half a degree.
/// let alpha = sunglint_materials::retro::smallest_alpha(1.0);
/// assert!((alpha - 0.008_726_9).abs() < 1e-6);
/// ```
pub fn smallest_alpha(cone_half_angle_deg: f64) -> f64 {
    (0.5 * cone_half_angle_deg).to_radians().tan()
}
