//! Axes, repetitions and slips summed over with their likelihoods; frequency and drift in closed form.

use super::scan::{Peak, Scan, Turned};
use super::{Spin, SpinOptions};
use glam::DVec3;
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;
use std::f64::consts::PI;
use sunglint_numerics::sphere::spread;

/// Axes of the first look, evenly over the sphere: some 6° apart.
const AXES: usize = 1000;
/// Levels of smaller cells about the axes that count, cells that are parted at most, and the share of the likelihood below which one is not.
const LEVELS: usize = 3;
const PARTED: usize = 120;
const LEAST: f64 = 1e-4;
/// Parts of a cell.
const PARTS: usize = 9;
/// Repetitions of the light to a turn.
const REPEATS: [u32; 2] = [1, 2];
/// Slips of the phase over a pass, turns: a light is no function of the bisector's longitude alone.
const SLIPS: [f64; 7] = [0.002, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16];
/// Standard deviation of the share by which the light turns more, or less, than the bisector: it lies between the Sun's longitude and the observer's, and not always in the middle. The same from the middle of the passes to their ends.
const EXCESS: f64 = 0.1;
const DAY_S: f64 = 86_400.0;

/// A number with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// The median.
    pub value: f64,
    /// Where 2.5 % lie below.
    pub from: f64,
    /// Where 2.5 % lie above.
    pub to: f64,
}

/// One axis, number of repetitions and slip.
#[derive(Debug, Clone, Copy)]
struct Part {
    axis: DVec3,
    repeats: u32,
    slip: f64,
    /// Log of its likelihood times the area of its cell.
    log_weight: f64,
    /// Log of its likelihood.
    log_height: f64,
    /// Frequency at the epoch (Hz) and drift (Hz/d), with their variances.
    hz: f64,
    hz_variance: f64,
    drift: f64,
    drift_variance: f64,
}

/// A cell of axes.
#[derive(Debug, Clone, Copy)]
struct Cell {
    axis: DVec3,
    area: f64,
    radius: f64,
}

/// The likelihood over all that is not known.
pub struct Posterior {
    parts: Vec<Part>,
    /// The moment of the frequencies, s.
    pub epoch_s: f64,
}

impl Posterior {
    /// Over some passes.
    pub fn new(scans: &[Scan], options: &SpinOptions) -> Self {
        let axes = spread(AXES, 0.0);
        let few: Vec<DVec3> = axes.iter().step_by(4).copied().collect();
        let scans: Vec<Scan> = scans
            .par_iter()
            .map(|scan| {
                let mut scan = scan.clone();
                scan.settle(&few);
                scan
            })
            .collect();
        let epoch_s = scans.iter().map(|s| s.middle_s).sum::<f64>() / scans.len() as f64;
        let area = 4.0 * PI / AXES as f64;
        let radius = (area / PI).sqrt();
        let mut cells: Vec<(Cell, Vec<Part>)> = axes
            .par_iter()
            .map(|axis| {
                let cell = Cell { axis: *axis, area, radius };
                (cell, parts(&scans, cell, epoch_s, options))
            })
            .collect();
        for _ in 0..LEVELS {
            let all: Vec<f64> = cells
                .iter()
                .map(|(_, parts)| log_sum(parts.iter().map(|p| p.log_weight)))
                .collect();
            let total = log_sum(all.iter().copied());
            let mut order: Vec<usize> =
                (0..cells.len()).filter(|k| all[*k] > total + LEAST.ln()).collect();
            order.sort_by(|a, b| all[*b].total_cmp(&all[*a]));
            order.truncate(PARTED);
            let finer: Vec<(Cell, Vec<Part>)> = order
                .par_iter()
                .flat_map_iter(|k| cells[*k].0.parted())
                .map(|cell| (cell, parts(&scans, cell, epoch_s, options)))
                .collect();
            let mut kept: Vec<bool> = vec![true; cells.len()];
            order.iter().for_each(|k| kept[*k] = false);
            let mut keep = kept.into_iter();
            cells.retain(|_| keep.next().unwrap_or(true));
            cells.extend(finer);
        }
        let parts = cells.into_iter().flat_map(|(_, parts)| parts).collect();
        Self { parts, epoch_s }
    }

    /// The apparent period of a pass by the likeliest spin, s.
    pub fn apparent_s(&self, scan: &Scan) -> Option<f64> {
        // Cells are of unlike sizes: the likelihood itself.
        let best = self.parts.iter().max_by(|a, b| a.log_height.total_cmp(&b.log_height))?;
        let sidereal = best.hz + best.drift * (scan.middle_s - self.epoch_s) / DAY_S;
        let hz = sidereal - f64::from(best.repeats) * scan.turned(best.axis)?.mean_hz;
        (hz > 0.0).then(|| 1.0 / hz)
    }

    /// The spins by repetitions.
    pub fn spins(&self) -> Vec<Spin> {
        let total = log_sum(self.parts.iter().map(|p| p.log_weight));
        REPEATS
            .iter()
            .filter_map(|n| {
                let weigh = |p: &Part| (p.log_weight - total).exp();
                let own: Vec<(f64, Part)> =
                    self.parts.iter().filter(|p| p.repeats == *n).map(|p| (weigh(p), *p)).collect();
                let share: f64 = own.iter().map(|(w, _)| w).sum();
                (share > 0.0).then(|| spin(*n, share, &own))
            })
            .collect()
    }
}

impl Cell {
    /// Smaller cells in its place: one in the middle, the others around.
    fn parted(self) -> impl Iterator<Item = Self> {
        let east = self.axis.any_orthonormal_vector();
        let north = self.axis.cross(east);
        (0..PARTS).map(move |k| {
            // A sunflower's seeds: as many to any area.
            let r = self.radius * ((k as f64 + 0.5) / PARTS as f64).sqrt();
            let angle = k as f64 * PI * (3.0 - 5.0_f64.sqrt());
            let axis = (self.axis + r * (angle.cos() * east + angle.sin() * north)).normalize();
            let parts = PARTS as f64;
            Self { axis, area: self.area / parts, radius: self.radius / parts.sqrt() }
        })
    }
}

/// All repetitions and slips of a cell.
fn parts(scans: &[Scan], cell: Cell, epoch_s: f64, options: &SpinOptions) -> Vec<Part> {
    let mut parts = Vec::new();
    let turned: Option<Vec<Turned>> = scans.iter().map(|scan| scan.turned(cell.axis)).collect();
    let Some(turned) = turned else { return parts };
    for repeats in REPEATS {
        let peaks: Vec<Peak> =
            scans.iter().zip(&turned).map(|(scan, turned)| scan.peak(turned, repeats)).collect();
        parts.extend(SLIPS.iter().filter_map(|slip| {
            part(scans, &peaks, (cell, repeats, *slip), epoch_s, options.drift_per_day)
        }));
    }
    parts
}

/// Frequency and drift by all passes, and how likely they are together.
fn part(
    scans: &[Scan],
    peaks: &[Peak],
    (cell, repeats, slip): (Cell, u32, f64),
    epoch_s: f64,
    drift_per_day: f64,
) -> Option<Part> {
    let usual = peaks.iter().map(|p| p.hz).sum::<f64>() / peaks.len() as f64;
    // From the epoch to the furthest pass: over that the excess may change as the orbit's plane and the Sun do.
    let away = scans.iter().map(|s| (s.middle_s - epoch_s).abs() / DAY_S);
    let half_days = away.fold(1e-3, f64::max);
    // Drift and excess of the turn are expected to be none, within their standard deviations.
    let prior = [(drift_per_day * usual).powi(-2), EXCESS.powi(-2)];
    let mut normal = Matrix4::from_diagonal(&Vector4::new(0.0, prior[0], prior[1], prior[1]));
    let mut right = Vector4::zeros();
    let mut log_weight = cell.area.ln();
    let rows: Vec<(Vector4<f64>, f64, f64)> = scans
        .iter()
        .zip(peaks)
        .map(|(scan, peak)| {
            let variance = peak.variance + (slip / scan.span_s).powi(2);
            // How the phase bends within a pass is known as well as how fast it goes.
            log_weight += peak.log_likelihood * peak.variance / variance - 0.5 * variance.ln();
            let days = (scan.middle_s - epoch_s) / DAY_S;
            let row = Vector4::new(1.0, days, -peak.turn_hz, -peak.turn_hz * days / half_days);
            (row, peak.hz - usual, variance.recip())
        })
        .collect();
    for (row, y, w) in &rows {
        normal += *w * row * row.transpose();
        right += *w * *y * row;
    }
    let covariance = normal.try_inverse()?;
    let x = covariance * right;
    let off: f64 = rows.iter().map(|(row, y, w)| w * (y - row.dot(&x)).powi(2)).sum();
    let expected = prior[0] * x[1] * x[1] + prior[1] * (x[2] * x[2] + x[3] * x[3]);
    log_weight -= 0.5 * (off + expected + normal.determinant().ln() - prior[0].ln());
    Some(Part {
        axis: cell.axis,
        repeats,
        slip,
        log_weight,
        log_height: log_weight - cell.area.ln(),
        hz: usual + x[0],
        hz_variance: covariance[(0, 0)],
        drift: x[1],
        drift_variance: covariance[(1, 1)],
    })
}

fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return most;
    }
    most + logs.map(|l| (l - most).exp()).sum::<f64>().ln()
}

fn spin(repeats: u32, share: f64, parts: &[(f64, Part)]) -> Spin {
    let n = f64::from(repeats);
    // A longer period is a lower frequency.
    let hz = quantiles(parts.iter().map(|(w, p)| (*w, p.hz, p.hz_variance)).collect());
    let period_s = Interval { value: n / hz.value, from: n / hz.to, to: n / hz.from };
    let relative = |p: &Part| (-p.drift / p.hz, p.drift_variance / (p.hz * p.hz));
    let drift_per_day = quantiles(
        parts
            .iter()
            .map(|(w, p)| {
                let (drift, variance) = relative(p);
                (*w, drift, variance)
            })
            .collect(),
    );
    let mean: DVec3 = parts.iter().map(|(w, p)| *w * p.axis).sum();
    let axis = mean.try_normalize().unwrap_or(DVec3::Z);
    let same: f64 = parts.iter().filter(|(_, p)| p.axis.dot(axis) > 0.0).map(|(w, _)| w).sum();
    let mut away: Vec<(f64, f64)> = parts
        .iter()
        .map(|(w, p)| (p.axis.cross(axis).length().atan2(p.axis.dot(axis)).to_degrees(), *w))
        .collect();
    away.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sum = 0.0;
    let within = away.iter().find(|(_, w)| {
        sum += w;
        sum >= 0.95 * share
    });
    let slip: f64 = parts.iter().map(|(w, p)| w * p.slip.ln()).sum::<f64>() / share;
    Spin {
        repeats,
        share,
        period_s,
        drift_per_day,
        axis,
        axis_within_deg: within.map_or(180.0, |w| w.0),
        sense: same / share,
        slip_turns: slip.exp(),
    }
}

/// Quantiles of a mixture of normal distributions (weight, mean, variance).
fn quantiles(mut parts: Vec<(f64, f64, f64)>) -> Interval {
    parts.retain(|p| p.0 > 0.0);
    let total: f64 = parts.iter().map(|p| p.0).sum();
    let ends = parts.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (_, m, v)| {
        (a.min(m - 8.0 * v.sqrt()), b.max(m + 8.0 * v.sqrt()))
    });
    let below = |x: f64| {
        let one = |(w, m, v): &(f64, f64, f64)| w * 0.5 * libm::erfc((m - x) / (2.0 * v).sqrt());
        parts.iter().map(one).sum::<f64>() / total
    };
    let at = |share: f64| {
        let (mut a, mut b) = ends;
        for _ in 0..80 {
            let middle = 0.5 * (a + b);
            if below(middle) < share { a = middle } else { b = middle }
        }
        0.5 * (a + b)
    };
    Interval { value: at(0.5), from: at(0.025), to: at(0.975) }
}
