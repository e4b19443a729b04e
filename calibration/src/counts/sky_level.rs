//! Brightness of the sky in a camera's frames, which carries the counters' background from one look at the sky to the next.

use hifitime::{Epoch, Unit};

/// The sky in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyLevel {
    /// The middle of the exposure.
    pub time: Epoch,
    /// Brightness of a pixel, the planes' together, ADU/s.
    pub level: f64,
    /// Standard error of the level, ADU/s.
    pub sigma: f64,
    /// Number of the camera's setting: levels of different settings are not compared.
    pub setting: usize,
}

/// A brightness and its standard error, ADU/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Brightness {
    pub level: f64,
    pub sigma: f64,
}

/// Frames so near to a time, s, tell of it, and so many at least.
const NEAR: (f64, usize) = (10.0, 4);
/// Where they are fewer, the nearest ones count, so near, s.
const FAR_S: f64 = 60.0;
/// Farthest beyond the first or the last of them that their line is believed, s.
const BEYOND_S: f64 = 5.0;
/// Moments over which the brightness of a stretch is averaged.
const MOMENTS: u32 = 5;

/// The sky in the frames of a night.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SkyLevels {
    /// Levels of each setting, those of the most frames first, in the order of time.
    settings: Vec<Vec<SkyLevel>>,
    /// Times of all of them, in order.
    times: Vec<Epoch>,
}

impl SkyLevels {
    /// Levels in any order; those that are not finite, or without an uncertainty, are left out.
    pub fn new(levels: impl IntoIterator<Item = SkyLevel>) -> Self {
        let mut settings: Vec<Vec<SkyLevel>> = Vec::new();
        for level in levels {
            if !(level.level.is_finite() && level.sigma > 0.0 && level.sigma.is_finite()) {
                continue;
            }
            match settings.iter_mut().find(|known| known[0].setting == level.setting) {
                Some(known) => known.push(level),
                None => settings.push(vec![level]),
            }
        }
        for levels in &mut settings {
            levels.sort_by_key(|level| level.time);
        }
        settings.sort_by_key(|levels| std::cmp::Reverse(levels.len()));
        let mut times: Vec<Epoch> = settings.iter().flatten().map(|level| level.time).collect();
        times.sort();
        Self { settings, times }
    }

    /// Number of settings.
    pub(super) fn settings(&self) -> usize {
        self.settings.len()
    }

    /// Whether a frame of any setting is near a time.
    pub(super) fn is_near(&self, time: Epoch) -> bool {
        let next = self.times.partition_point(|at| *at < time);
        let beside = [next.checked_sub(1).and_then(|i| self.times.get(i)), self.times.get(next)];
        beside.into_iter().flatten().any(|at| (*at - time).to_seconds().abs() <= NEAR.0)
    }

    /// The brightness at a time in the frames of a setting: a line through the levels near it.
    pub(super) fn at(&self, setting: usize, time: Epoch) -> Option<Brightness> {
        let levels = self.settings.get(setting)?;
        let after_s = |level: &SkyLevel| (level.time - time).to_seconds();
        let from = levels.partition_point(|level| after_s(level) < -NEAR.0);
        let to = levels.partition_point(|level| after_s(level) <= NEAR.0);
        let (mut from, mut to) = (from, to);
        while to - from < NEAR.1 {
            let before = from.checked_sub(1).map(|i| (i, -after_s(&levels[i])));
            let next = levels.get(to).map(after_s);
            match (before, next) {
                (Some((i, a)), b) if a <= FAR_S && b.is_none_or(|b| a <= b) => from = i,
                (_, Some(b)) if b <= FAR_S => to += 1,
                _ => return None,
            }
        }
        let near = &levels[from..to];
        let [first_s, last_s] = [after_s(&near[0]), after_s(&near[near.len() - 1])];
        if first_s > BEYOND_S || last_s < -BEYOND_S {
            return None;
        }
        let [mut s0, mut s1, mut s2, mut y0, mut y1] = [0.0; 5];
        for level in near {
            let (weight, x) = (level.sigma.powi(-2), after_s(level));
            s0 += weight;
            s1 += weight * x;
            s2 += weight * x * x;
            y0 += weight * level.level;
            y1 += weight * x * level.level;
        }
        let spread = s0 * s2 - s1 * s1;
        if spread <= 0.0 {
            return None;
        }
        let (level, slope) = ((s2 * y0 - s1 * y1) / spread, (s0 * y1 - s1 * y0) / spread);
        let off = |at: &SkyLevel| ((at.level - level - slope * after_s(at)) / at.sigma).powi(2);
        // What scatters more than it should is known less.
        let scatter = near.iter().map(off).sum::<f64>() / (near.len() - 2) as f64;
        Some(Brightness { level, sigma: (s2 / spread * scatter.max(1.0)).sqrt() })
    }

    /// The mean brightness of a stretch about a time in the frames of a setting.
    pub(super) fn over(&self, setting: usize, middle: Epoch, length_s: f64) -> Option<Brightness> {
        let mut mean = Brightness { level: 0.0, sigma: 0.0 };
        for moment in 0..MOMENTS {
            let part = (f64::from(moment) + 0.5) / f64::from(MOMENTS) - 0.5;
            let at = self.at(setting, middle + part * length_s * Unit::Second)?;
            // They have frames in common.
            mean.level += at.level / f64::from(MOMENTS);
            mean.sigma += at.sigma / f64::from(MOMENTS);
        }
        Some(mean)
    }
}
