//! Offset of a target that stands among the stars: a star that the mount follows. The estimator of satellites cannot tell it from its neighbours, because none of them moves.

use super::estimate::Found;

/// Part of a frame's difference that is taken over: seeing is averaged over three frames or so.
const GAIN: f64 = 0.4;
/// Two frames agree when the light moved by less, arcsec.
const STEADY_ARCSEC: f64 = 30.0;
/// A light that is so much fainter than the one that was followed is another one.
const FAINTER: f64 = 0.2;

/// Follows one star through frames.
#[derive(Debug, Clone)]
pub(super) struct Hold {
    /// Offset of the star from where the prediction shows it, along the growing axes, arcsec.
    pub(crate) off: [f64; 2],
    /// Offset that a person gave, arcsec: about it the star is looked for.
    given: [f64; 2],
    /// Whether it was found.
    pub locked: bool,
    /// When it was seen last, s of the path.
    pub seen_s: Option<f64>,
    /// The light of the frame before the lock.
    candidate: Option<[f64; 2]>,
    flux: Option<f64>,
    reach_arcsec: f64,
    coast_s: f64,
}

impl Hold {
    /// Looks for the star within so many arcsec of where it is believed to be, and keeps it so many seconds without light.
    pub fn new(reach_arcsec: f64, coast_s: f64) -> Self {
        let (candidate, flux, seen_s) = (None, None, None);
        let (off, given) = ([0.0; 2], [0.0; 2]);
        Self { off, given, locked: false, seen_s, candidate, flux, reach_arcsec, coast_s }
    }

    /// A person said which light is the star: its offset from the prediction, arcsec, as of now.
    pub(crate) fn lock(&mut self, off: [f64; 2], now_s: f64) {
        (self.locked, self.off, self.given, self.seen_s) = (true, off, off, Some(now_s));
        (self.candidate, self.flux) = (None, None);
    }

    /// A person said that the star is believed to be elsewhere by so much, arcsec.
    pub(crate) fn shift(&mut self, by: [f64; 2]) {
        self.off = [0, 1].map(|i| self.off[i] + by[i]);
        self.given = [0, 1].map(|i| self.given[i] + by[i]);
        self.candidate = None;
    }

    /// Forgets what frames said: the star is believed to be where a person or the prediction says.
    pub(crate) fn forget(&mut self) {
        (self.locked, self.off, self.seen_s) = (false, self.given, None);
        (self.candidate, self.flux) = (None, None);
    }

    /// Learns from a frame: offsets of the lights from the prediction, arcsec, with their brightness.
    pub(crate) fn learn(&mut self, spots: &[([f64; 2], f64)], time_s: f64) -> Found {
        let distance = |off: &[f64; 2], from: &[f64; 2]| (off[0] - from[0]).hypot(off[1] - from[1]);
        if self.locked && self.seen_s.is_some_and(|seen| time_s - seen > self.coast_s) {
            (self.locked, self.candidate, self.flux) = (false, None, None);
        }
        if self.locked {
            // A mount drifts by less than 2″ a second.
            let since_s = self.seen_s.map_or(0.0, |seen| (time_s - seen).max(0.0));
            let gate = STEADY_ARCSEC + 2.0 * since_s;
            let bright = self.flux.unwrap_or(0.0) * FAINTER;
            let near = spots
                .iter()
                .filter(|(off, flux)| distance(off, &self.off) < gate && *flux > bright)
                .min_by(|a, b| distance(&a.0, &self.off).total_cmp(&distance(&b.0, &self.off)));
            let Some((off, flux)) = near else { return Found::Nothing };
            for (own, seen) in self.off.iter_mut().zip(off) {
                *own += GAIN * (seen - *own);
            }
            self.flux = Some(self.flux.map_or(*flux, |usual| usual + 0.2 * (flux - usual)));
            self.seen_s = Some(time_s);
            return Found::Target;
        }
        let within = spots.iter().filter(|(off, _)| distance(off, &self.given) < self.reach_arcsec);
        let Some((off, flux)) = within.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            self.candidate = None;
            return Found::Nothing;
        };
        let again = self.candidate.is_some_and(|before| distance(&before, off) < STEADY_ARCSEC);
        self.candidate = Some(*off);
        if !again {
            return Found::Nothing;
        }
        (self.locked, self.off, self.flux) = (true, *off, Some(*flux));
        self.seen_s = Some(time_s);
        Found::Locked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: the brightest light that two frames agree on is taken, the nearest afterwards; a star that is brighter and comes later is not; what is not seen for long is looked for again.
    #[test]
    fn a_star_is_held() {
        let mut hold = Hold::new(600.0, 20.0);
        let faint = ([100.0, 0.0], 10.0);
        // A hot spot that jumps is no star.
        assert_eq!(hold.learn(&[faint, ([300.0, 300.0], 500.0)], 0.0), Found::Nothing);
        assert_eq!(hold.learn(&[faint, ([-200.0, 50.0], 100.0)], 1.0), Found::Nothing);
        assert_eq!(hold.learn(&[faint, ([-201.0, 51.0], 100.0)], 2.0), Found::Locked);
        assert_eq!(hold.off, [-201.0, 51.0]);
        let brighter = ([-150.0, 51.0], 5000.0);
        assert_eq!(hold.learn(&[brighter, ([-203.5, 51.0], 90.0)], 3.0), Found::Target);
        assert!((hold.off[0] + 202.0).abs() < 1e-9, "{:?}", hold.off);
        assert_eq!(hold.learn(&[([-203.0, 51.0], 5.0)], 4.0), Found::Nothing);
        // Beyond the reach there is nothing to begin with.
        let mut near = Hold::new(60.0, 20.0);
        for i in 0..5 {
            assert_eq!(near.learn(&[([-201.0, 51.0], 100.0)], f64::from(i)), Found::Nothing);
        }
        assert!(hold.locked);
        assert_eq!(hold.learn(&[faint], 30.0), Found::Nothing);
        assert!(!hold.locked);
    }
}
