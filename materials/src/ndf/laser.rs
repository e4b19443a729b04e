//! The error that the incident power leaves to a run, one that neighbouring angles share.
//!
//! The power between two incident readings is that on the straight line between them. Their noise tilts all of that line, and the laser may have left it and come back. Either changes the
//! lobe's shape, and α with it, far more than the same error would that were another one at each angle.

use crate::table::RetroTable;

/// The incident readings of a run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Laser {
    /// Time, s, and relative standard uncertainty, in the order of the times.
    read: Vec<(f64, f64)>,
    /// Standard deviation of the laser's own relative change between one and the next.
    walks: Vec<f64>,
    /// By reading of the table: time, s, and standard deviation of f by the laser, sr⁻¹.
    readings: Vec<(f64, f64)>,
}

impl Laser {
    /// None where the table does not say when and how the incident power was read.
    pub fn of(run: &RetroTable) -> Option<Self> {
        let laser = run.laser.as_ref()?;
        let mut incident = laser.incident.clone();
        incident.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let read: Vec<(f64, f64)> =
            incident.iter().map(|i| (i.time_s, i.sigma_w / i.power_w)).collect();
        let walks = (incident.windows(2))
            .map(|pair| crate::retro::walk([&pair[0], &pair[1]].map(|i| (i.power_w, i.sigma_w))));
        let walks = walks.collect();
        let readings = laser.time_s.iter().copied().zip(laser.sigma_per_sr.iter().copied());
        Some(Self { read, walks, readings: readings.collect() })
    }

    /// The standard deviation of a reading by the laser, sr⁻¹.
    pub fn sigma_per_sr(&self, reading: usize) -> f64 {
        self.readings.get(reading).map_or(0.0, |r| r.1)
    }

    /// Relative errors of f at readings of the table, drawn together; without what all of them share, which is the scale's.
    pub fn drawn(&self, readings: &[usize], mut normal: impl FnMut() -> f64) -> Vec<f64> {
        let errors: Vec<f64> = self.read.iter().map(|(_, sigma)| sigma * normal()).collect();
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let mut all = vec![0.0; readings.len()];
        let mut by_time: Vec<(f64, usize)> = (readings.iter().enumerate())
            .filter_map(|(place, reading)| Some((self.readings.get(*reading)?.0, place)))
            .collect();
        by_time.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (k, pair) in self.read.windows(2).enumerate() {
            let width = pair[1].0 - pair[0].0;
            let within = |(time, _): &&(f64, usize)| *time >= pair[0].0 && *time <= pair[1].0;
            let inside: Vec<(f64, usize)> = (by_time.iter().filter(within))
                .filter(|_| width > 0.0)
                .map(|(time, place)| ((time - pair[0].0) / width, *place))
                .collect();
            // A walk from the first reading on, and then less the straight line to where it ended.
            let (mut at, mut walked) = (0.0, 0.0);
            let mut walk = Vec::with_capacity(inside.len());
            for (part, _) in &inside {
                walked += (part - at).max(0.0).sqrt() * normal();
                at = *part;
                walk.push(walked);
            }
            let end = walked + (1.0 - at).max(0.0).sqrt() * normal();
            for ((part, place), walked) in inside.iter().zip(walk) {
                let line = (1.0 - part) * errors[k] + part * errors[k + 1] - mean;
                all[*place] = line + self.walks[k] * (walked - part * end);
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{IncidentPower, LaserTrack};
    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Truth: closed forms. Of a walk from 0 to 0 of the variance s² the covariance at x ≤ y is s² x (1 − y); of the line through two noisy ends less their mean σ² (x − ½)(y − ½)·2. Tolerance 6 %
    /// of the variances: 4000 draws leave 2.2 % (one standard deviation).
    #[test]
    fn neighbours_share_what_the_laser_does() {
        let incident = |time_s: f64, power_w: f64| IncidentPower { time_s, power_w, sigma_w: 3e-6 };
        // The change is 0.8 %, of which 0.3 %·√2 is noise.
        let track = LaserTrack {
            incident: vec![incident(1000.0, 1.004e-3), incident(0.0, 0.996e-3)],
            time_s: vec![750.0, 0.0, 250.0, 1000.0],
            sigma_per_sr: vec![0.0; 4],
        };
        let run = RetroTable { laser: Some(track), ..RetroTable::default() };
        let laser = Laser::of(&run).unwrap();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut normal = || {
            let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
            (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
        };
        let draws: Vec<Vec<f64>> =
            (0..4000).map(|_| laser.drawn(&[0, 1, 2, 3], &mut normal)).collect();
        let mean = |a: usize, b: usize| {
            draws.iter().map(|d| d[a] * d[b]).sum::<f64>() / draws.len() as f64
        };
        let (walk2, noise2) = (0.008_f64.powi(2) - 2.0 * 0.003_f64.powi(2), 0.003_f64.powi(2));
        let places = [0.75_f64, 0.0, 0.25, 1.0];
        let expected = |a: usize, b: usize| {
            let (x, y) = (places[a].min(places[b]), places[a].max(places[b]));
            walk2 * x * (1.0 - y) + 2.0 * noise2 * (x - 0.5) * (y - 0.5)
        };
        for a in 0..4 {
            for b in 0..4 {
                let (found, expected) = (mean(a, b), expected(a, b));
                let scale = (mean(a, a) * mean(b, b)).sqrt();
                assert!((found - expected).abs() < 0.06 * scale, "{a} {b}: {found:e} {expected:e}");
            }
        }
    }
}
