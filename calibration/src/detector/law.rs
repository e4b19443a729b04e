//! The laws of dead time, inverted: a rate, its derivatives by the measured rate, and the statistics of the counts.

use super::recovery::Recovery;
use super::table::MonotoneCubic;
use super::{DetectorError, Limit, MOST_AMPLIFICATION};
use std::f64::consts::E;
use sunglint_radiometry::station::DeadTime;

/// Values of a law at a measured rate m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct At {
    /// n, Hz.
    pub rate_hz: f64,
    /// dn/dm.
    pub slope: f64,
    /// d²n/dm², s.
    pub curvature_s: f64,
    /// Variance of the counts over their mean, in a long bin.
    pub fano: f64,
    /// dn/dm at m = 0.
    pub slope_at_zero: f64,
    /// Whether the law is trusted there.
    pub trusted: bool,
}

impl At {
    /// Whether an error of the counts is too large a one of the rate.
    pub fn amplified(&self, measured_hz: f64) -> bool {
        measured_hz > 0.0 && measured_hz * self.slope >= MOST_AMPLIFICATION * self.rate_hz
    }
}

/// A law, checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Law {
    Linear,
    NonParalysable { tau_s: f64 },
    Paralysable { tau_s: f64 },
    Recovery(Recovery),
    MultiPixel { pixel: Recovery, pixels: f64, pulse_s: f64 },
    Table(MonotoneCubic),
}

/// nτ to which laws are trusted, and the paralysable one.
pub(super) const TRUSTED: f64 = 3.0;
const TRUSTED_PARALYSABLE: f64 = 0.5;

impl Law {
    pub fn new(dead_time: &DeadTime) -> Result<Self, DetectorError> {
        let time = |field, found: f64| {
            let expected = "a time from 0 s, not infinite";
            let good = found.is_finite() && found >= 0.0;
            if good { Ok(found) } else { Err(DetectorError::Law { field, found, expected }) }
        };
        Ok(match dead_time {
            DeadTime::None => Law::Linear,
            DeadTime::NonParalysable { dead_time_s } => {
                Law::NonParalysable { tau_s: time("dead_time_s", *dead_time_s)? }
            }
            DeadTime::Paralysable { dead_time_s } => {
                Law::Paralysable { tau_s: time("dead_time_s", *dead_time_s)? }
            }
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s } => {
                let dead_s = time("dead_time_s", *dead_time_s)?;
                match time("recovery_s", *recovery_s)? {
                    0.0 => Law::NonParalysable { tau_s: dead_s },
                    recovery_s => Law::Recovery(Recovery { dead_s, recovery_s }),
                }
            }
            DeadTime::MultiPixel { pixels, recovery_s, pulse_s } => {
                let recovery_s = time("recovery_s", *recovery_s)?;
                let found = f64::from(*pixels);
                for (field, found) in [("pixels", found), ("recovery_s", recovery_s)] {
                    if found <= 0.0 {
                        let expected = "more than 0";
                        return Err(DetectorError::Law { field, found, expected });
                    }
                }
                let pixel = Recovery { dead_s: 0.0, recovery_s };
                Law::MultiPixel { pixel, pixels: found, pulse_s: time("pulse_s", *pulse_s)? }
            }
            DeadTime::Table { measured_hz, true_hz } => {
                Law::Table(MonotoneCubic::new(measured_hz, true_hz)?)
            }
            other => return Err(DetectorError::Unknown(format!("{other:?}"))),
        })
    }

    /// The rate below which the law has an inverse, Hz.
    pub fn most_hz(&self) -> f64 {
        match self {
            Law::Linear => f64::INFINITY,
            Law::NonParalysable { tau_s } => 1.0 / tau_s,
            Law::Paralysable { tau_s } => 1.0 / (E * tau_s),
            Law::Recovery(law) => 1.0 / law.dead_s,
            Law::MultiPixel { pulse_s, .. } => 1.0 / (E * pulse_s),
            Law::Table(table) => table.last().0,
        }
    }

    pub fn memory_s(&self) -> f64 {
        match self {
            Law::Linear => 0.0,
            Law::NonParalysable { tau_s } | Law::Paralysable { tau_s } => *tau_s,
            Law::Recovery(law) => law.dead_s + law.recovery_s,
            Law::MultiPixel { pixel, pulse_s, .. } => pixel.recovery_s.max(*pulse_s),
            Law::Table(table) => {
                let (measured_hz, true_hz) = table.last();
                (1.0 / measured_hz - table.slope_at_zero() / true_hz).max(0.0)
            }
        }
    }

    /// How many times more counts the law needs than that without prolonged dead time, for as little noise against its own curvature;
    /// a table's pixels are dead for longer than the loss of all of them tells.
    pub fn stiffness(&self) -> f64 {
        match self {
            Law::Paralysable { .. } | Law::MultiPixel { .. } | Law::Table(_) => 16.0,
            _ => 1.0,
        }
    }

    /// The law at a measured rate, or the limit that it has reached.
    pub fn invert(&self, measured_hz: f64) -> Result<At, (f64, Limit)> {
        let limit_hz = self.most_hz();
        let m = measured_hz;
        match self {
            Law::Linear => Ok(At {
                rate_hz: m,
                slope: 1.0,
                curvature_s: 0.0,
                fano: 1.0,
                slope_at_zero: 1.0,
                trusted: true,
            }),
            Law::NonParalysable { tau_s } => {
                let alive = 1.0 - m * tau_s;
                if alive <= 0.0 {
                    return Err((limit_hz, Limit::Law));
                }
                let rate_hz = m / alive;
                Ok(At {
                    rate_hz,
                    slope: alive.powi(-2),
                    curvature_s: 2.0 * tau_s * alive.powi(-3),
                    fano: alive * alive,
                    slope_at_zero: 1.0,
                    trusted: rate_hz * tau_s <= TRUSTED,
                })
            }
            Law::Paralysable { tau_s } => {
                let y = m * tau_s;
                let x = low_branch(y).ok_or((limit_hz, Limit::Law))?;
                let slope = x.exp() / (1.0 - x);
                Ok(At {
                    rate_hz: m * x.exp(),
                    slope,
                    curvature_s: tau_s * slope * slope * (2.0 - x) / (1.0 - x),
                    fano: 1.0 - 2.0 * y,
                    slope_at_zero: 1.0,
                    trusted: x <= TRUSTED_PARALYSABLE,
                })
            }
            Law::Recovery(law) => law.invert(m).ok_or((limit_hz, Limit::Law)),
            Law::MultiPixel { pixel, pixels, pulse_s } => {
                // First the pulses that merged, then what the pixels lost: each chain of derivatives is that of both.
                let fired = Law::Paralysable { tau_s: *pulse_s }.invert(m)?;
                let at = pixel.invert(fired.rate_hz / pixels).ok_or((limit_hz, Limit::Law))?;
                Ok(At {
                    rate_hz: pixels * at.rate_hz,
                    slope: at.slope * fired.slope,
                    curvature_s: at.curvature_s / pixels * fired.slope.powi(2)
                        + at.slope * fired.curvature_s,
                    fano: at.fano * fired.fano,
                    slope_at_zero: 1.0,
                    trusted: at.trusted && fired.trusted,
                })
            }
            Law::Table(table) => {
                let at = table.at(m).ok_or((limit_hz, Limit::TableEnd))?;
                Ok(At { trusted: true, ..at })
            }
        }
    }
}

/// x e^(−x) = y for x from 0 up to, but not at, the maximum at 1: −W₀(−y), the Lambert function's principal branch. `None` from the maximum 1/e on.
fn low_branch(y: f64) -> Option<f64> {
    if y * E >= 1.0 {
        return None;
    }
    // The series about the branch point, good to 1e-2 down to y = 0; Halley's steps, each cubing the error, do the rest.
    let p = (2.0 * (1.0 - E * y)).sqrt();
    let mut x = 1.0 - p * (1.0 - p * (1.0 / 3.0 - p * 11.0 / 72.0));
    if y < 0.1 {
        x = y * (1.0 + y * (1.0 + 1.5 * y));
    }
    for _ in 0..20 {
        // g = x − y eˣ, g' = 1 − y eˣ, g'' = −y eˣ.
        let grown = y * x.exp();
        let (g, slope) = (x - grown, 1.0 - grown);
        let step = 2.0 * g * slope / (2.0 * slope * slope + g * grown);
        if !step.is_finite() {
            break;
        }
        x -= step;
        if step.abs() <= 1e-16 * x.abs() {
            break;
        }
    }
    (x < 1.0).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the definition x e^(−x) = y, at 2,000 x over all of the branch; its rounding near the maximum, where the law is flat, is √ε.
    #[test]
    fn the_low_branch_is_the_inverse_of_the_law() {
        for i in 1..2000 {
            let x = f64::from(i) / 2000.0;
            let found = low_branch(x * (-x).exp()).unwrap();
            assert!((found - x).abs() <= 4e-16 * x / (1.0 - x).max(1e-8), "{x}: {found}");
        }
        assert!((low_branch(1e-12).unwrap() - 1e-12).abs() < 1e-23);
        assert_eq!(low_branch(0.0), Some(0.0));
        assert_eq!(low_branch(1.0 / E + 1e-15), None);
    }
}
