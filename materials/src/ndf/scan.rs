//! Usable readings of a scan: in the order of their angles, those left out with the reason.

use super::{NdfError, Note, passes};
use crate::table::{Reading, RetroFlags};
use sunglint_numerics::order::median;

/// Below this many standard deviations a reading is no light that was seen.
const DETECTED: f64 = 3.0;
/// Readings below the detection that end a scan: one alone may be an outlier.
const LOST: usize = 2;

/// The readings of one azimuth.
#[derive(Debug, Clone)]
pub(super) struct Scan {
    /// Stage angles, degrees, increasing (an angle may come twice).
    pub angle_deg: Vec<f64>,
    /// Retro-reflection, sr⁻¹, above 0.
    pub f: Vec<f64>,
    /// Standard deviation of the retro-reflection, sr⁻¹; 0 where it is not known.
    pub sigma: Vec<f64>,
    /// Place of each reading among those that were cleaned.
    pub place: Vec<usize>,
}

/// The least number of readings, and how far apart the ends must be.
const LEAST: usize = 8;

impl Scan {
    /// Cleans readings.
    ///
    /// # Errors
    /// Too few, nothing above 0, a saturated peak, a peak that the angles do not resolve.
    pub fn clean(readings: &[Reading], notes: &mut Vec<Note>) -> Result<Self, NdfError> {
        notes.extend(passes::differ(readings));
        let mut places: Vec<usize> = (0..readings.len()).collect();
        if readings.windows(2).any(|pair| pair[0].angle_deg > pair[1].angle_deg) {
            notes.push(Note::Sorted);
            places.sort_by(|a, b| readings[*a].angle_deg.total_cmp(&readings[*b].angle_deg));
        }
        let readings: Vec<Reading> = places.iter().map(|place| readings[*place]).collect();
        let apart = readings.chunk_by(|a, b| a.angle_deg == b.angle_deg).count();
        if apart < LEAST {
            return Err(NdfError::TooFew { found: apart, least: LEAST });
        }
        if !readings.iter().any(|r| r.f_per_sr > 0.0) {
            return Err(NdfError::NoLight { readings: readings.len() });
        }
        saturated(&readings)?;
        let lost = |r: &Reading| r.f_per_sr <= DETECTED * r.sigma_f_per_sr || r.f_per_sr <= 0.0;
        let (from, to) = detected(&readings, lost);
        for (edge, gone) in [(from, &readings[..from]), (to, &readings[to..])] {
            if let (Some(first), Some(last)) = (gone.first(), gone.last()) {
                let angles_deg = (first.angle_deg, last.angle_deg);
                notes.push(Note::BelowDetection { angles_deg, readings: gone.len() });
                debug_assert!(edge <= readings.len());
            }
        }
        let mut scan = Self { angle_deg: vec![], f: vec![], sigma: vec![], place: vec![] };
        for (r, place) in readings[from..to].iter().zip(&places[from..to]) {
            let reason = match r.flags {
                flags if flags.contains(RetroFlags::OVER_RANGE) => "over range",
                flags if flags.contains(RetroFlags::EDGE) => "light beside the sample",
                flags if flags.contains(RetroFlags::EXTRAPOLATED) => "not measured",
                _ if !r.f_per_sr.is_finite() => "no number",
                _ if r.f_per_sr <= 0.0 => "not above 0",
                _ => {
                    scan.angle_deg.push(r.angle_deg);
                    scan.f.push(r.f_per_sr);
                    scan.sigma.push(r.sigma_f_per_sr);
                    scan.place.push(*place);
                    continue;
                }
            };
            notes.push(Note::LeftOut { angle_deg: r.angle_deg, f_per_sr: r.f_per_sr, reason });
        }
        let apart = scan.angle_deg.chunk_by(|a, b| a == b).count();
        if apart < LEAST {
            return Err(NdfError::TooFew { found: apart, least: LEAST });
        }
        scan.resolved()?;
        Ok(scan)
    }

    /// The usual distance of neighbours, degrees.
    pub fn step_deg(&self) -> f64 {
        let steps = self.angle_deg.windows(2).map(|p| p[1] - p[0]).filter(|d| *d > 1e-9);
        median(steps).unwrap_or(f64::INFINITY)
    }

    /// Whether all standard deviations are known.
    pub fn knows_sigma(&self) -> bool {
        self.sigma.iter().all(|s| *s > 0.0)
    }

    /// Weights in ln f: 1/σ² where it is known, else 1 for all.
    pub fn weights(&self) -> Vec<f64> {
        if !self.knows_sigma() {
            return vec![1.0; self.f.len()];
        }
        self.f.iter().zip(&self.sigma).map(|(f, s)| (f / s).powi(2)).collect()
    }

    /// The same after a running median over `width` readings.
    pub fn smoothed(&self, width: usize) -> Self {
        let half = width / 2;
        let median = |k: usize| {
            // Narrower towards the ends, so that it stays in the middle.
            let reach = half.min(k).min(self.f.len() - 1 - k);
            let mut part = self.f[k - reach..=k + reach].to_vec();
            part.sort_by(f64::total_cmp);
            part[reach]
        };
        Self { f: (0..self.f.len()).map(median).collect(), ..self.clone() }
    }

    /// The same with the cosine of another symmetry point in f; readings that would then lie beyond the horizon stay as they are.
    pub fn with_cosine(&self, from_deg: f64, to_deg: f64) -> Self {
        let cos = |angle: f64, zero: f64| (angle - zero).to_radians().cos();
        let factor = |angle: f64| {
            let factor = cos(angle, from_deg) / cos(angle, to_deg);
            if factor.is_finite() && factor > 0.0 { factor } else { 1.0 }
        };
        let times = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.angle_deg).map(|(v, angle)| v * factor(*angle)).collect()
        };
        Self { f: times(&self.f), sigma: times(&self.sigma), ..self.clone() }
    }

    /// Whether the angles resolve the lobe: at least three readings above half the largest, two where it is at the end of the scan.
    fn resolved(&self) -> Result<(), NdfError> {
        let top = (0..self.f.len()).max_by(|a, b| self.f[*a].total_cmp(&self.f[*b])).unwrap_or(0);
        let above = |k: &usize| self.f[*k] >= 0.5 * self.f[top];
        let count = (0..=top).rev().take_while(above).count()
            + (top + 1..self.f.len()).take_while(above).count();
        let at_end = top == 0 || top + 1 == self.f.len();
        if count >= if at_end { 2 } else { 3 } {
            return Ok(());
        }
        let beside = [top.checked_sub(1), Some(top + 1)].into_iter().flatten();
        let next = beside.filter_map(|k| self.f.get(k)).fold(0.0_f64, |a, f| a.max(*f));
        let step_deg = self.step_deg();
        // As of Beckmann's lobe, exp(−tan²θ/α²), between the peak and the higher of its neighbours.
        let alpha = step_deg.to_radians() / (self.f[top] / next).ln().sqrt();
        let needed_deg = RESOLVED * alpha.to_degrees();
        let angle_deg = self.angle_deg[top];
        Err(NdfError::TooCoarse { angle_deg, readings: count, step_deg, alpha, needed_deg })
    }
}

/// A step of this many α (as an angle) leaves D within 3e-3.
const RESOLVED: f64 = 0.43;

/// The stretch between the last readings of nothing before the peak and the first after it.
fn detected(readings: &[Reading], lost: impl Fn(&Reading) -> bool) -> (usize, usize) {
    let value = |r: &Reading| if r.f_per_sr.is_finite() { r.f_per_sr } else { f64::NEG_INFINITY };
    let top = (0..readings.len())
        .max_by(|a, b| value(&readings[*a]).total_cmp(&value(&readings[*b])))
        .unwrap_or(0);
    let end = |order: &mut dyn Iterator<Item = usize>| {
        let (mut run, mut last) = (0, top);
        for k in order {
            run = if lost(&readings[k]) { run + 1 } else { 0 };
            if run == LOST {
                break;
            }
            if run == 0 {
                last = k;
            }
        }
        last
    };
    (end(&mut (0..top).rev()), end(&mut (top + 1..readings.len())) + 1)
}

/// Refuses a peak that the meter did not follow: readings over range there, or a plateau of equal ones.
fn saturated(readings: &[Reading]) -> Result<(), NdfError> {
    let over = |r: &Reading| r.flags.contains(RetroFlags::OVER_RANGE);
    let good = |r: &&Reading| !over(r) && r.f_per_sr.is_finite();
    let top = readings.iter().filter(good).map(|r| r.f_per_sr).fold(0.0_f64, f64::max);
    let high = |r: &Reading| good(&r) && r.f_per_sr >= 0.5 * top;
    let mut k = 0;
    while k < readings.len() {
        if !over(&readings[k]) {
            k += 1;
            continue;
        }
        let end = (k..readings.len()).find(|j| !over(&readings[*j])).unwrap_or(readings.len());
        let before = k.checked_sub(1).is_none_or(|j| high(&readings[j]));
        let after = readings.get(end).is_none_or(high);
        if before && after {
            let angles_deg = (readings[k].angle_deg, readings[end - 1].angle_deg);
            return Err(NdfError::Saturated { angles_deg, readings: end - k });
        }
        k = end;
    }
    // A meter at its end says the same again and again; a sample that is the same everywhere is Lambert's.
    let equal = |r: &Reading| r.f_per_sr == top;
    let count = readings.iter().filter(|r| equal(r)).count();
    let first = readings.iter().position(equal).unwrap_or(0);
    let plateau = readings[first..].iter().take_while(|r| equal(r)).count();
    if plateau >= 3 && count == plateau && 2 * plateau < readings.len() {
        let angles_deg = (readings[first].angle_deg, readings[first + plateau - 1].angle_deg);
        return Err(NdfError::Saturated { angles_deg, readings: plateau });
    }
    Ok(())
}
