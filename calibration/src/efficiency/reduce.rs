//! From readings to efficiencies.

use super::{
    Aperture, Components, Counting, Efficiency, EfficiencyError, EfficiencyFlags, Factor, Note,
    Reading, Row, Sensor, Set,
};
use crate::detector::DetectorError;

/// h c, J nm (CODATA 2018, exact).
const HC_J_NM: f64 = 1.986_445_857_148_928e-16;
/// Light and efficiencies below so many standard deviations are none that was seen.
const DETECTED: f64 = 3.0;
/// Wavelengths closer than this are one, nm.
const SAME_NM: f64 = 1e-3;

/// The efficiency of a sensor from sets of readings. Readings of one wavelength, of one set or several, become their mean by what each has for itself.
///
/// # Errors
/// No readings; numbers that cannot be (which, and where).
pub fn reduce(sets: &[Set], sensor: &Sensor) -> Result<Efficiency, EfficiencyError> {
    check_aperture("sensor", &sensor.aperture)?;
    if let Counting::Camera { gain_e_per_adu, gain_relative_sigma, saturation_adu } =
        &sensor.counting
    {
        positive("camera's gain, e/ADU", *gain_e_per_adu)?;
        size("relative uncertainty of the gain", *gain_relative_sigma)?;
        positive("camera's saturation, ADU", *saturation_adu)?;
    }
    let mut rows = Vec::new();
    for (number, set) in sets.iter().enumerate() {
        check_set(set)?;
        let first = rows.len();
        for (k, reading) in set.readings.iter().enumerate() {
            check_reading(number + 1, k + 1, reading)?;
            rows.push(one(set, sensor, reading));
        }
        rows[first..].sort_by(|a, b| a.wavelength_nm.total_cmp(&b.wavelength_nm));
        wavelengths(&mut rows[first..], set, sensor);
    }
    if rows.is_empty() {
        return Err(EfficiencyError::NoReadings);
    }
    rows.sort_by(|a, b| a.wavelength_nm.total_cmp(&b.wavelength_nm));
    let same = |a: &Row, b: &Row| b.wavelength_nm - a.wavelength_nm < SAME_NM;
    let rows: Vec<Row> = rows.chunk_by(same).map(merged).collect();
    let notes = notes(&rows);
    Ok(Efficiency { rows, notes })
}

fn positive(name: &str, found: f64) -> Result<(), EfficiencyError> {
    let good = found.is_finite() && found > 0.0;
    let (name, expected) = (name.to_owned(), "a number above 0");
    good.then_some(()).ok_or(EfficiencyError::Number { name, found, expected })
}

fn size(name: &str, found: f64) -> Result<(), EfficiencyError> {
    let good = found.is_finite() && found >= 0.0;
    let (name, expected) = (name.to_owned(), "a number of 0 or above");
    good.then_some(()).ok_or(EfficiencyError::Number { name, found, expected })
}

fn check_aperture(of: &str, aperture: &Aperture) -> Result<(), EfficiencyError> {
    positive(&format!("{of}'s area, mm²"), aperture.area_mm2)?;
    size(&format!("relative uncertainty of the {of}'s area"), aperture.area_relative_sigma)?;
    positive(&format!("{of}'s distance, mm"), aperture.distance_mm)?;
    size(&format!("uncertainty of the {of}'s distance, mm"), aperture.distance_sigma_mm)
}

fn check_set(set: &Set) -> Result<(), EfficiencyError> {
    let diode = &set.photodiode;
    check_aperture("photodiode", &diode.aperture)?;
    positive("photodiode's load, Ω", diode.load_ohm)?;
    size("relative uncertainty of the load", diode.load_relative_sigma)?;
    size("uncertainty of the wavelength, nm", set.wavelength_sigma_nm)?;
    if let Some(beyond) = &diode.extrapolation {
        size("relative uncertainty of the extrapolation", beyond.relative_sigma)?;
    }
    let factors = set.towards_photodiode.iter().chain(&set.towards_sensor);
    for factor in factors.chain([&diode.responsivity]) {
        size(&format!("relative uncertainty of {}", factor.name), factor.relative_sigma)?;
    }
    Ok(())
}

fn check_reading(set: usize, reading: usize, r: &Reading) -> Result<(), EfficiencyError> {
    let bad = |name, found, expected| {
        Err(EfficiencyError::Reading { set, reading, name, found, expected })
    };
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if !positive(r.wavelength_nm) {
        return bad("wavelength_nm", r.wavelength_nm, "a number above 0");
    }
    for (name, s) in [("exposure_s", r.exposure_s), ("dark_exposure_s", r.dark_exposure_s)] {
        if !positive(s) {
            return bad(name, s, "a number above 0");
        }
    }
    for (name, counts) in [("counts", r.counts), ("dark_counts", r.dark_counts)] {
        if !counts.is_nan() && !(0.0..=1e15).contains(&counts) {
            return bad(name, counts, "0 to 1e15");
        }
    }
    if r.sigma_v.is_nan() || r.sigma_v < 0.0 {
        return bad("sigma_photodiode_v", r.sigma_v, "a number of 0 or above");
    }
    if !(r.drift_relative.is_finite() && r.drift_relative > -1.0) {
        return bad("drift_relative", r.drift_relative, "a number above -1");
    }
    if r.sigma_drift_relative.is_nan() || r.sigma_drift_relative < 0.0 {
        return bad("sigma_drift_relative", r.sigma_drift_relative, "a number of 0 or above");
    }
    Ok(())
}

/// Factor that turns U/ν into η: product of all that the light meets, W V⁻¹ on the sensor for one volt; none beyond a table.
struct Way {
    watt_per_volt: f64,
    responsivity: f64,
    transmissions: f64,
    geometry: f64,
    extrapolated: bool,
}

fn way(set: &Set, sensor: &Sensor, nm: f64) -> Option<Way> {
    let product = |factors: &[Factor]| -> Option<(f64, f64)> {
        factors.iter().try_fold((1.0, 0.0_f64), |(value, sigma), factor| {
            Some((value * factor.value.at(nm)?, sigma.hypot(factor.relative_sigma)))
        })
    };
    let diode = &set.photodiode;
    let (responsivity, responsivity_sigma, extrapolated) = diode.responsivity_at(nm)?;
    let (to_diode, diode_sigma) = product(&set.towards_photodiode)?;
    let (to_sensor, sensor_sigma) = product(&set.towards_sensor)?;
    let seen = |a: &Aperture| a.area_mm2 / (a.distance_mm * a.distance_mm);
    let seen_sigma =
        |a: &Aperture| a.area_relative_sigma.hypot(2.0 * a.distance_sigma_mm / a.distance_mm);
    // Eqs. 4.6 and 4.7: watts on the sensor for a volt.
    let share = seen(&sensor.aperture) / seen(&diode.aperture) * to_sensor / to_diode;
    let watt_per_volt = share / (diode.load_ohm * responsivity);
    Some(Way {
        watt_per_volt,
        responsivity: responsivity_sigma,
        transmissions: diode_sigma.hypot(sensor_sigma),
        geometry: seen_sigma(&sensor.aperture).hypot(seen_sigma(&diode.aperture)),
        extrapolated,
    })
    .filter(|way| way.watt_per_volt.is_finite() && way.watt_per_volt > 0.0)
}

/// A rate, Hz, what its counting leaves open, and what its linearity does.
struct Rate {
    hz: f64,
    sigma_hz: f64,
    linearity_hz: f64,
    flags: EfficiencyFlags,
}

fn rate(sensor: &Sensor, counts: f64, exposure_s: f64) -> Rate {
    let mut flags = EfficiencyFlags::empty();
    match &sensor.counting {
        Counting::Camera { gain_e_per_adu, gain_relative_sigma, saturation_adu } => {
            flags.set(EfficiencyFlags::SATURATED, counts >= *saturation_adu);
            let electrons = counts * gain_e_per_adu;
            let hz = electrons / exposure_s;
            let sigma_hz = electrons.max(1.0).sqrt() / exposure_s;
            Rate { hz, sigma_hz, linearity_hz: hz * gain_relative_sigma, flags }
        }
        Counting::Counter { linearity, dead_time_relative_sigma } => {
            // Means of several exposures are no whole numbers.
            match linearity.linearise(counts.round() as u64, exposure_s) {
                Ok(linear) => {
                    flags.set(EfficiencyFlags::UNTRUSTED, !linear.trusted);
                    Rate {
                        hz: linear.rate_hz,
                        sigma_hz: linear.sigma_hz,
                        linearity_hz: linear.dead_time_slope_hz * dead_time_relative_sigma,
                        flags,
                    }
                }
                Err(error) => {
                    let saturated = matches!(error, DetectorError::Saturated { .. });
                    let flag = if saturated {
                        EfficiencyFlags::SATURATED
                    } else {
                        EfficiencyFlags::MISSING
                    };
                    Rate { hz: f64::NAN, sigma_hz: f64::NAN, linearity_hz: f64::NAN, flags: flag }
                }
            }
        }
    }
}

fn one(set: &Set, sensor: &Sensor, r: &Reading) -> Row {
    let mut row = Row {
        wavelength_nm: r.wavelength_nm,
        efficiency: f64::NAN,
        components: Components::default(),
        photons_hz: f64::NAN,
        rate_hz: f64::NAN,
        readings: 1,
        flags: EfficiencyFlags::empty(),
    };
    row.flags.set(EfficiencyFlags::SECOND_ORDER, r.second_order);
    row.flags.set(EfficiencyFlags::DRIFT_STEP, r.drift_step);
    let read = [r.photodiode_v, r.photodiode_dark_v, r.counts, r.dark_counts];
    if read.iter().any(|x| !x.is_finite()) {
        row.flags |= EfficiencyFlags::MISSING;
        return row;
    }
    let (on, off) =
        (rate(sensor, r.counts, r.exposure_s), rate(sensor, r.dark_counts, r.dark_exposure_s));
    row.flags |= on.flags | off.flags;
    row.rate_hz = on.hz - off.hz;
    let volts = r.photodiode_v - r.photodiode_dark_v;
    let no_light = volts <= DETECTED * r.sigma_v || volts <= 0.0;
    row.flags.set(EfficiencyFlags::NO_LIGHT, no_light);
    let Some(way) = way(set, sensor, r.wavelength_nm) else {
        row.flags |= EfficiencyFlags::NOT_COVERED;
        return row;
    };
    row.flags.set(EfficiencyFlags::EXTRAPOLATED, way.extrapolated);
    row.photons_hz = volts * way.watt_per_volt * r.wavelength_nm / HC_J_NM;
    if no_light || row.flags.contains(EfficiencyFlags::SATURATED) || row.rate_hz.is_nan() {
        return row;
    }
    // Photons that would give as many counts at the run's begin.
    let photons_hz = row.photons_hz * (1.0 + r.drift_relative);
    row.efficiency = row.rate_hz / photons_hz;
    let eta = row.efficiency.abs();
    row.components = Components {
        counts: on.sigma_hz.hypot(off.sigma_hz) / photons_hz,
        photodiode: eta * r.sigma_v / volts,
        wavelength: 0.0,
        // The same dead time with light and in the dark.
        linearity: (on.linearity_hz - off.linearity_hz).abs() / photons_hz,
        responsivity: eta * way.responsivity,
        load: eta * set.photodiode.load_relative_sigma,
        geometry: eta * way.geometry,
        transmissions: eta * way.transmissions,
        drift: eta * r.sigma_drift_relative,
    };
    let own = row.components.own();
    row.flags.set(EfficiencyFlags::NEGATIVE, row.efficiency < 0.0);
    row.flags.set(EfficiencyFlags::ABOVE_ONE, row.efficiency > 1.0);
    row.flags.set(EfficiencyFlags::BELOW_DETECTION, row.efficiency < DETECTED * own);
    row
}

/// Sets the uncertainty from a wavelength that is off: by the slope of η itself and by that of its divisor.
fn wavelengths(rows: &mut [Row], set: &Set, sensor: &Sensor) {
    let sigma_nm = set.wavelength_sigma_nm;
    if sigma_nm == 0.0 {
        return;
    }
    let known: Vec<(f64, f64)> = (rows.iter())
        .filter(|r| r.efficiency.is_finite())
        .map(|r| (r.wavelength_nm, r.efficiency))
        .collect();
    for row in rows.iter_mut().filter(|r| r.efficiency.is_finite()) {
        let nm = row.wavelength_nm;
        let low = known.iter().rev().find(|(x, _)| *x < nm - SAME_NM);
        let high = known.iter().find(|(x, _)| *x > nm + SAME_NM);
        let here = (nm, row.efficiency);
        let (low, high) = (low.unwrap_or(&here), high.unwrap_or(&here));
        let width = high.0 - low.0;
        let own = if width > 0.0 { (high.1 - low.1) / width } else { 0.0 };
        let step = 0.5 * sigma_nm;
        let per_volt = |nm: f64| way(set, sensor, nm).map(|way| way.watt_per_volt * nm);
        let divided = match (per_volt(nm - step), per_volt(nm + step)) {
            (Some(low), Some(high)) => (high / low).ln() / (2.0 * step) * row.efficiency,
            _ => 0.0,
        };
        row.components.wavelength = own.hypot(divided) * sigma_nm;
    }
}

/// The mean of readings of one wavelength, weighted by what each has for itself; with the larger uncertainty where they disagree.
fn merged(rows: &[Row]) -> Row {
    let good = |row: &&Row| row.efficiency.is_finite();
    let count = rows.iter().filter(good).count();
    if rows.len() == 1 || count == 0 {
        let mut row = rows[0].clone();
        row.flags = rows.iter().fold(row.flags, |flags, r| flags | r.flags);
        row.readings = rows.len();
        return row;
    }
    // Of readings without an uncertainty all count the same.
    let exact = rows.iter().filter(good).any(|r| r.components.own() <= 0.0);
    let weight = |row: &Row| if exact { 1.0 } else { row.components.own().powi(-2) };
    let all: f64 = rows.iter().filter(good).map(weight).sum();
    let mean = |value: &dyn Fn(&Row) -> f64| {
        rows.iter().filter(good).map(|row| weight(row) * value(row)).sum::<f64>() / all
    };
    // Independent parts shrink, common ones do not.
    let shrunk = |value: &dyn Fn(&Row) -> f64| {
        let square = |row: &Row| (weight(row) * value(row)).powi(2);
        rows.iter().filter(good).map(square).sum::<f64>().sqrt() / all
    };
    let efficiency = mean(&|r| r.efficiency);
    let apart = |row: &Row| ((row.efficiency - efficiency) / row.components.own()).powi(2);
    let chi2 = if exact { 0.0 } else { rows.iter().filter(good).map(apart).sum::<f64>() };
    let birge = (chi2 / (count as f64 - 1.0).max(1.0)).sqrt();
    let mut flags = rows.iter().filter(good).fold(EfficiencyFlags::empty(), |f, r| f | r.flags);
    let recomputed =
        EfficiencyFlags::NEGATIVE | EfficiencyFlags::ABOVE_ONE | EfficiencyFlags::BELOW_DETECTION;
    flags -= recomputed;
    let disagree = count > 1 && birge > DETECTED;
    let larger = if disagree { birge } else { 1.0 };
    let components = Components {
        counts: larger * shrunk(&|r| r.components.counts),
        photodiode: larger * shrunk(&|r| r.components.photodiode),
        wavelength: mean(&|r| r.components.wavelength),
        linearity: mean(&|r| r.components.linearity),
        responsivity: mean(&|r| r.components.responsivity),
        load: mean(&|r| r.components.load),
        geometry: mean(&|r| r.components.geometry),
        transmissions: mean(&|r| r.components.transmissions),
        drift: mean(&|r| r.components.drift),
    };
    flags.set(EfficiencyFlags::DISAGREE, disagree);
    flags.set(EfficiencyFlags::NEGATIVE, efficiency < 0.0);
    flags.set(EfficiencyFlags::ABOVE_ONE, efficiency > 1.0);
    flags.set(EfficiencyFlags::BELOW_DETECTION, efficiency < DETECTED * components.own());
    Row {
        wavelength_nm: mean(&|r| r.wavelength_nm),
        efficiency,
        components,
        photons_hz: mean(&|r| r.photons_hz),
        rate_hz: mean(&|r| r.rate_hz),
        readings: count,
        flags,
    }
}

fn notes(rows: &[Row]) -> Vec<Note> {
    let note = |(_, flag): (&str, EfficiencyFlags)| {
        let with: Vec<&Row> = rows.iter().filter(|row| row.flags.contains(flag)).collect();
        let (first, last) = (with.first()?, with.last()?);
        let largest = with.iter().map(|r| r.efficiency).fold(f64::NAN, f64::max);
        let range_nm = (first.wavelength_nm, last.wavelength_nm);
        Some(Note { flag, range_nm, count: with.len(), largest })
    };
    EfficiencyFlags::all().iter_names().filter_map(note).collect()
}
