//! Error by the size of patches: the difference that patches of twice the size make, compared with light paths.

/// Least error of every direction, as a share of the difference in the mean: a direction's own difference may be small by chance.
const LEAST_OF_TYPICAL: f64 = 0.5;
/// Standard errors of the paths by which all light together may differ beyond the claims.
const APART: f64 = 3.0;
/// Claims stand for about two standard errors.
const ERRORS: f64 = 2.0;
/// The variance of single trials beside the paths' is trusted to this: eight scrambles know their own variance to half of it.
const OF_VARIANCE: f64 = 2.0;
/// Where claims would have to grow by more, patches are given up.
const MOST_SCALE: f64 = 4.0;

/// One pair of directions.
#[derive(Debug, Clone, Copy)]
pub struct Trial {
    /// The light by patches, what patches of twice the size change, and the claimed error of the form factors.
    pub light: f64,
    pub left: f64,
    pub noise: f64,
    /// The light by paths, and its standard error.
    pub found: f64,
    pub sigma: f64,
}

/// How claims follow from the differences.
#[derive(Debug, Clone, Copy)]
pub struct Claim {
    /// Claims are this times the differences.
    pub scale: f64,
    /// The difference of the size, of the light: root of the mean square over the trials.
    pub typical: f64,
}

impl Claim {
    /// From trials; `None` where paths find other light than the patches' size explains.
    pub fn of(trials: &[Trial]) -> Option<Self> {
        let sum = |f: &dyn Fn(&Trial) -> f64| trials.iter().map(f).sum::<f64>();
        let plain = Self::plain(trials.iter().map(|t| (t.light, t.left)));
        let typical = plain.typical;
        if sum(&|t| t.light * t.light) <= 0.0 {
            return (sum(&|t| t.found) <= 0.0).then_some(plain);
        }
        let claim = |t: &Trial| plain.of_size(t.light, t.left) + t.noise;
        let variance = sum(&|t| t.sigma * t.sigma);
        let apart = sum(&|t| t.light - t.found).abs();
        if apart > sum(&claim) + APART * variance.sqrt() {
            return None;
        }
        let square = sum(&|t| (t.light - t.found).powi(2)) - OF_VARIANCE * variance;
        let needed = ERRORS * (square.max(0.0) / sum(&|t| claim(t).powi(2))).sqrt();
        let scale = needed.max(1.0);
        (scale <= MOST_SCALE).then_some(Self { scale, typical })
    }

    /// Returns the claim before light paths say anything, from the light of some directions and what patches of twice the size change.
    pub fn plain(lights: impl Iterator<Item = (f64, f64)>) -> Self {
        let (all, left) =
            lights.fold((0.0, 0.0), |(a, l), (light, left)| (a + light * light, l + left * left));
        let typical = if all > 0.0 { f64::sqrt(left / all) } else { 0.0 };
        Self { scale: 1.0, typical }
    }

    /// The claim for some light, where patches of twice the size change it by `left`.
    pub fn of_size(&self, light: f64, left: f64) -> f64 {
        self.scale * left.max(LEAST_OF_TYPICAL * self.typical * light)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trials(off: impl Fn(usize) -> f64, left: f64, sigma: f64) -> Vec<Trial> {
        let trial = |k: usize| Trial { light: off(k), left, noise: 0.0, found: 1.0, sigma };
        (0..48).map(trial).collect()
    }

    /// Truth: by hand. Light that is 5 % low everywhere where patches claim 1 % and paths know it to 2 % each (0.3 % together) is refused; claimed 6 % it stands (2 √(5² − 2·2²)/6 times as large). Errors
    /// of either sign of 4 % with claims of 2 % make these four times as large, of 8 % too large; what paths do not know raises nothing.
    #[test]
    fn patches_are_held_against_paths() {
        assert!(Claim::of(&trials(|_| 0.95, 0.01, 0.02)).is_none());
        let scale = Claim::of(&trials(|_| 0.95, 0.06, 0.02)).unwrap().scale;
        assert!((scale - 2.0 * (17.0_f64 / 36.0).sqrt()).abs() < 0.01, "{scale}");
        let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let scale = Claim::of(&trials(|k| 1.0 + 0.04 * sign(k), 0.0201, 0.0)).unwrap().scale;
        assert!((scale - 4.0).abs() < 0.05, "{scale}");
        assert!(Claim::of(&trials(|k| 1.0 + 0.08 * sign(k), 0.02, 0.0)).is_none());
        assert_eq!(Claim::of(&trials(|k| 1.0 + 0.02 * sign(k), 0.02, 0.02)).unwrap().scale, 1.0);
    }
}
