//! How long a meter takes to follow the light, found from a run's own readings.
//!
//! A meter with a lag still lacks a part of the step from the place before when its first reading at a place is taken, and the part falls from reading to reading. Each place tells its
//! own, with noise; many places together tell it to a thousandth of the step.

use crate::reading::{Seen, State};

/// Part of a step that may be left at the first reading.
pub const LEFT: f64 = 1e-3;
/// Longest wait that is found, s.
const MOST_S: f64 = 60.0;
/// Least step that tells anything, over the larger level (the lamp drifts while a place is read), and over the scatter of the readings (the step is known by the same readings).
const LEAST_STEP: f64 = 0.05;
const OVER_SCATTER: f64 = 30.0;
/// Least places that tell anything, and how many are kept.
const PLACES: usize = 12;
const KEPT: usize = 48;
/// One of so many places is looked at: the others add to it.
const EACH: usize = 4;
/// Least part that is left, in its standard deviations and in [`LEFT`].
const SIGMAS: f64 = 6.0;
const CLEAR: f64 = 2.0;

/// A reading of a place: when it was taken, s, and its power, W.
pub type Timed = (f64, f64);

/// Begin of a place, over the larger level of it and of the one before.
#[derive(Debug, Clone)]
struct Place {
    /// Step from the level before.
    step: f64,
    /// Time since the first reading, s, and what was read.
    read: Vec<Timed>,
}

/// Lag of the readings that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Part of the step that was left at the first reading.
    pub left: f64,
    /// Standard uncertainty of that part.
    pub sigma: f64,
    /// Time constant with which it falls, s.
    pub constant_s: f64,
    /// Wait, s, before the first reading, after which [`LEFT`] is left.
    pub wait_s: f64,
}

/// The places of a run, and the wait that they ask for.
#[derive(Debug, Clone, Default)]
pub struct Settling {
    places: Vec<Place>,
    seen: usize,
    before_w: Option<f64>,
    found_s: f64,
}

impl Settling {
    /// Takes what the lines of a run that was begun before tell, for one that goes on with it: as if its readings were taken once more, with `settle_s` from its plan. `is_same_light` says of two places one after the other whether the
    /// same thing was in the beam.
    pub fn of_run<'a, K: PartialEq>(
        lines: impl Iterator<Item = Seen<'a, K>>,
        settle_s: f64,
        is_same_light: impl Fn(&K, &K) -> bool,
    ) -> Self {
        let mut settling = Self::default();
        let (mut read, mut anew, mut before): (Vec<Timed>, bool, Option<K>) =
            (Vec::new(), false, None);
        for line in lines {
            if let Some(before) = before.filter(|key| *key != line.key) {
                // Readings that were broken off tell nothing.
                read.clear();
                anew = false;
                if !is_same_light(&before, &line.key) {
                    settling.other_light();
                }
            }
            match line.state {
                State::Read | State::Over => read.push((line.time_s, line.power_w)),
                State::Again => {
                    read.clear();
                    anew = true;
                }
                State::Kept => {
                    if !read.is_empty() {
                        settling.place(&read, settling.wait_s(settle_s), !anew);
                    }
                    read.clear();
                    anew = false;
                }
            }
            before = Some(line.key);
        }
        settling.other_light();
        settling
    }

    /// Wait before the first reading of a place, s: the longer one of what the plan says and what was found.
    #[must_use]
    pub fn wait_s(&self, plan_s: f64) -> f64 {
        plan_s.max(self.found_s)
    }

    /// Something else was put into the beam, at a time that nobody knows: the next step is none that the readings follow.
    pub fn other_light(&mut self) {
        self.before_w = None;
    }

    /// Takes the readings of a place, which were begun `wait_s` after the move. Gives the lag where it is longer than that wait allows; from then on [`wait_s`](Self::wait_s) is the longer one.
    /// Readings of which `is_step` is false (the range changed, the meter was over it) tell the level alone.
    pub fn place(&mut self, readings: &[Timed], wait_s: f64, is_step: bool) -> Option<Lag> {
        let later = &readings[readings.len() / 2..];
        let level = later.iter().map(|(_, w)| w).sum::<f64>() / later.len().max(1) as f64;
        let before =
            if level.is_finite() { self.before_w.replace(level) } else { self.before_w.take() };
        let (before, start) = (before?, readings.first()?.0);
        let scale = before.abs().max(level.abs());
        let step = (before - level) / scale;
        // A reading over the range has no number.
        let is_whole = readings.iter().all(|(_, w)| w.is_finite());
        if !is_step
            || !is_whole
            || readings.len() < 3
            || !step.is_finite()
            || step.abs() < LEAST_STEP
        {
            return None;
        }
        if self.places.len() == KEPT {
            self.places.remove(0);
        }
        let read = readings.iter().map(|(s, w)| (s - start, w / scale)).collect();
        self.places.push(Place { step, read });
        self.seen += 1;
        if !self.seen.is_multiple_of(EACH) {
            return None;
        }
        let (left, sigma, constant_s) = self.fit()?;
        if !(CLEAR * LEFT..=1.0).contains(&left) || left < SIGMAS * sigma {
            return None;
        }
        let wait_s = (wait_s + constant_s * (left / LEFT).ln()).min(MOST_S);
        self.places.clear();
        self.found_s = self.found_s.max(wait_s);
        Some(Lag { left, sigma, constant_s, wait_s })
    }

    /// The part of a step that is left at the first reading, its standard uncertainty by how well the places agree, and the time constant, s, that describes the readings best.
    fn fit(&self) -> Option<(f64, f64, f64)> {
        if self.places.len() < PLACES {
            return None;
        }
        let lasts = self.places.iter().filter_map(|place| Some(place.read.last()?.0));
        let longest_s = lasts.fold(0.0, f64::max);
        // Steps of a quarter, then of a twentieth about the best.
        let best = |constants: &mut dyn Iterator<Item = f64>| {
            let tried = constants.filter_map(|constant_s| {
                let (left, sigma, gain) = self.left(constant_s)?;
                Some((gain, (left, sigma, constant_s)))
            });
            tried.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, found)| found)
        };
        let (_, _, near_s) = best(&mut (0..20).map(|k| longest_s * 0.05 * 1.25_f64.powi(k)))?;
        best(&mut (-2..=2).map(|k| near_s * 1.05_f64.powi(k)))
    }

    /// The part that is left for a time constant, its standard uncertainty, and how much smaller the squares are with it.
    fn left(&self, constant_s: f64) -> Option<(f64, f64, f64)> {
        // Of each place: step · Σ g g, Σ g y of what is centred, and the scatter about their line.
        let mut lines: Vec<[f64; 4]> = Vec::with_capacity(self.places.len());
        for Place { step, read } in &self.places {
            let n = read.len() as f64;
            let falls = |s: f64| (-s / constant_s).exp();
            let mean = |of: &dyn Fn(&Timed) -> f64| read.iter().map(of).sum::<f64>() / n;
            let (g0, y0) = (mean(&|r| falls(r.0)), mean(&|r| r.1));
            let [mut gg, mut gy, mut yy] = [0.0; 3];
            for (s, y) in read {
                let (g, y) = (falls(*s) - g0, y - y0);
                gg += g * g;
                gy += g * y;
                yy += y * y;
            }
            if gg > 0.0 {
                lines.push([*step, gg, gy, (yy - gy * gy / gg).max(0.0) / (n - 2.0).max(1.0)]);
            }
        }
        let mut scatters: Vec<f64> = lines.iter().map(|line| line[3]).collect();
        scatters.sort_by(f64::total_cmp);
        let usual = *scatters.get(scatters.len() / 2)?;
        let weight = |scatter: f64| 1.0 / scatter.max(usual).max(1e-18);
        lines.retain(|[step, _, _, scatter]| {
            step * step > OVER_SCATTER.powi(2) * scatter.max(usual)
        });
        if lines.len() < PLACES {
            return None;
        }
        let [mut xx, mut xy] = [0.0; 2];
        for [step, gg, gy, scatter] in &lines {
            xx += weight(*scatter) * step * step * gg;
            xy += weight(*scatter) * step * gy;
        }
        let left = xy / xx;
        let apart = lines.iter().map(|[step, gg, gy, scatter]| {
            (weight(*scatter) * step * (gy - left * step * gg)).powi(2)
        });
        let sigma = apart.sum::<f64>().sqrt() / xx;
        (left.is_finite() && sigma.is_finite()).then_some((left, sigma, xy * xy / xx))
    }
}
