//! Visits as the fit sees them: y = ln(predicted/measured) with its variances.

use super::{Measured, Options, StarsError, Visit};

/// A channel of a visit is used where its mean is expected to be known to this.
const WORST_RELATIVE: f64 = 0.2;

/// Data of a visit in one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// ln(predicted/measured), its bias by noise taken off.
    pub y: f64,
    /// Variance of y by counts.
    pub counts: f64,
    /// ln(predicted rate), for the checks of linearity.
    pub ln_predicted: f64,
    /// d y/dτ of an aerosol, above 0 where it is known.
    pub per_depth: Option<f64>,
}

/// A visit as the fit sees it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    /// Which visit.
    pub visit: usize,
    /// Which star, by number.
    pub star: usize,
    pub airmass: f64,
    pub colour: Option<f64>,
    /// Variance by scintillation, common to the channels.
    pub scintillation: f64,
    pub points: Vec<Option<Point>>,
}

/// The visits that can decide; `ln_kappa` is what is known of κ already, `None` at first.
///
/// A count's variance is taken at the rate that κ lets expect: its own estimate would give the visit that came out faint by chance the smaller
/// weight, and bend κ. With the expected rate n and the measured m it is σ²/(m n), exactly that of n for pure counts.
pub(super) fn samples(visits: &[Visit], ln_kappa: Option<&[f64]>) -> Vec<Sample> {
    let mut stars: Vec<&str> = Vec::new();
    let mut samples = Vec::new();
    for (number, visit) in visits.iter().enumerate().filter(|(_, v)| v.decides) {
        let point = |(c, measured): (usize, &Option<Measured>)| {
            point((*measured)?, ln_kappa.map(|k| k[c]).filter(|k| k.is_finite()))
        };
        let points: Vec<Option<Point>> = visit.channels.iter().enumerate().map(point).collect();
        if points.iter().all(Option::is_none) {
            continue;
        }
        let star = stars.iter().position(|s| *s == visit.star).unwrap_or_else(|| {
            stars.push(&visit.star);
            stars.len() - 1
        });
        samples.push(Sample {
            visit: number,
            star,
            airmass: visit.airmass,
            colour: visit.b_minus_v_mag,
            scintillation: visit.scintillation.powi(2),
            points,
        });
    }
    samples
}

fn point(m: Measured, ln_kappa: Option<f64>) -> Option<Point> {
    let expected_hz = ln_kappa.map_or(m.measured_hz, |k| m.predicted_hz * (-k).exp());
    let expected = m.sigma_hz / expected_hz;
    // By what is expected, not by what came out: else the faint ones that came out bright by chance would be kept.
    if !(m.measured_hz > 0.0 && expected_hz > 0.0 && expected <= WORST_RELATIVE) {
        return None;
    }
    // A dimmed visit is not known better than it was counted, nor so badly that anything would agree with it.
    let counts = m.sigma_hz.powi(2) / (m.measured_hz * expected_hz);
    let counts = counts.min(WORST_RELATIVE.powi(2));
    // E[ln m] lies half a variance below ln E[m].
    let y = (m.predicted_hz / m.measured_hz).ln() - 0.5 * counts;
    let per_depth = m.per_aerosol_depth.map(|d| -d);
    Some(Point { y, counts, ln_predicted: m.predicted_hz.ln(), per_depth })
}

/// Number of different stars among samples.
pub(super) fn stars<'a>(samples: impl IntoIterator<Item = &'a Sample>) -> usize {
    let mut stars: Vec<usize> = samples.into_iter().map(|s| s.star).collect();
    stars.sort_unstable();
    stars.dedup();
    stars.len()
}

/// Refuses what no visit and no option can be. Gives the number of channels.
pub(super) fn check(visits: &[Visit], options: &Options) -> Result<usize, StarsError> {
    let wanted = [
        ("floor", options.floor, 1e-4..=0.5, "0.0001 to 0.5"),
        ("clip_sigma", options.clip_sigma, 2.0..=20.0, "2 to 20"),
        ("most_scatter", options.most_scatter, 0.001..=1.0, "0.001 to 1"),
        ("confidence", options.confidence, 0.5..=0.999, "0.5 to 0.999"),
        ("resamples", f64::from(options.resamples), 100.0..=1e6, "100 to 1000000"),
        ("fewest_stars", options.fewest_stars as f64, 2.0..=1e6, "2 or more"),
    ];
    for (name, value, range, expected) in wanted {
        if !range.contains(&value) {
            return Err(StarsError::Option { name, value, expected });
        }
    }
    let channels = visits.first().map_or(0, |v| v.channels.len());
    for (number, visit) in visits.iter().enumerate() {
        let wrong = |what: String| {
            Err(StarsError::Input { visit: number + 1, star: visit.star.clone(), what })
        };
        if visit.channels.len() != channels {
            let found = visit.channels.len();
            return wrong(format!("{found} channels, expected {channels} as the first visit has"));
        }
        if !(visit.airmass.is_finite() && visit.airmass >= 0.0) {
            return wrong(format!("an airmass of {}", visit.airmass));
        }
        if !(0.0..=10.0).contains(&visit.scintillation) {
            return wrong(format!("a scintillation of {}, expected 0 to 10", visit.scintillation));
        }
        if visit.b_minus_v_mag.is_some_and(|c| !c.is_finite()) {
            return wrong("a colour that is no number".into());
        }
        for (channel, m) in visit.channels.iter().enumerate() {
            let Some(m) = m else { continue };
            let good = m.predicted_hz.is_finite()
                && m.predicted_hz > 0.0
                && m.measured_hz.is_finite()
                && m.sigma_hz.is_finite()
                && m.sigma_hz > 0.0
                && m.per_aerosol_depth.is_none_or(f64::is_finite);
            if !good {
                return wrong(format!(
                    "channel {}: predicted {} Hz, measured {} ± {} Hz; expected numbers, prediction and uncertainty above 0",
                    channel + 1,
                    m.predicted_hz,
                    m.measured_hz,
                    m.sigma_hz
                ));
            }
        }
    }
    Ok(channels)
}
