//! Widths of points at each frame of a night, and the apertures that follow them.
//!
//! Seen through more air points are wider, with the airmass to the power of 0.6 (Kolmogorov's turbulence; Roddier 1981): over a pass twice and more. One aperture for all
//! frames would leave out another part of the light of each. So the widths that some frames show are carried to all by a power of the airmass, which the night's own frames tell as
//! far as they can, and an aperture is so many of these widths.

use hifitime::Epoch;
use sunglint_numerics::measured::Interval;

/// Power of the airmass by which points are wider, and its standard deviation, before a night tells.
const POWER: (f64, f64) = (0.6, 0.2);
/// Powers that a night may tell: none of the width is the air's, or all of the strongest turbulence.
const POWERS: Interval = Interval { low: 0.0, high: 1.0 };
/// Radius of an aperture at most, as a part of the shorter side of a frame: its annulus, 2.5 times as large, would leave the frame.
const OF_FRAME: f64 = 0.2;

/// Full width at half maximum of a normal profile with a pixel's own variance, px: no point is seen narrower.
const PIXEL_FWHM: f64 = 0.68;

/// Width of a point of this width as pixels see it, px.
fn seen_px(fwhm_px: f64) -> f64 {
    fwhm_px.hypot(PIXEL_FWHM)
}

/// Width of points on a frame, where the frame has an airmass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Looked {
    pub fwhm_px: f64,
    pub airmass: f64,
}

/// Widths of points over a night.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Widths {
    /// The median width of points at each stay, px, and the airmass that it is of.
    of_stay: Vec<(f64, Option<f64>)>,
    /// The widest of the stays with frames that give a rate, px.
    pub widest_px: f64,
    power: f64,
}

impl Widths {
    /// The same width everywhere.
    pub fn all(fwhm_px: f64, stays: usize) -> Self {
        Self { of_stay: vec![(fwhm_px, None); stays], widest_px: fwhm_px, power: 0.0 }
    }

    /// From the median width of each stay, `None` where its frames do not tell, the widest, and single frames of each stay. `usual_px` where nothing tells.
    pub fn of(
        medians: &[Option<f64>],
        widest_px: f64,
        usual_px: f64,
        looked: &[Vec<Looked>],
    ) -> Self {
        let power = power(looked);
        let airmass = |of: &Vec<Looked>| {
            let mean = of.iter().map(|l| l.airmass.ln()).sum::<f64>() / of.len() as f64;
            (!of.is_empty()).then(|| mean.exp())
        };
        let of_stay = medians.iter().zip(looked).map(|(fwhm_px, looked)| match fwhm_px {
            Some(fwhm_px) => (*fwhm_px, airmass(looked)),
            None => (usual_px, None),
        });
        Self { of_stay: of_stay.collect(), widest_px, power }
    }

    /// In the middle of a stay, px.
    pub fn of_stay(&self, stay: usize) -> f64 {
        self.of_stay[stay].0
    }

    /// At an airmass in a stay, px.
    pub fn at(&self, stay: usize, airmass: Option<f64>) -> f64 {
        let (fwhm_px, of) = self.of_stay[stay];
        let larger = airmass.zip(of).map_or(1.0, |(here, of)| (here / of).powf(self.power));
        larger * fwhm_px
    }
}

/// Power of the airmass: what stays tell whose airmass changes, beside [`POWER`], each with the weight of its uncertainty.
fn power(looked: &[Vec<Looked>]) -> f64 {
    let (mut xx, mut xy, mut yy, mut free) = (0.0, 0.0, 0.0, 0.0);
    for stay in looked.iter().filter(|stay| stay.len() > 1) {
        let n = stay.len() as f64;
        let of = |l: &Looked| (l.airmass.ln(), l.fwhm_px.ln());
        let (x, y) = stay.iter().map(of).fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
        for (own_x, own_y) in stay.iter().map(of) {
            let (dx, dy) = (own_x - x / n, own_y - y / n);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
        }
        free += n - 1.0;
    }
    let (usual, doubt) = POWER;
    if xx <= 0.0 || free < 3.0 {
        return usual;
    }
    let told = xy / xx;
    // Scatter about the line; seeing is never steadier than that.
    let scatter2 = ((yy - told * xy) / (free - 1.0)).max(0.02_f64.powi(2));
    let (weight, prior) = (xx / scatter2, doubt.powi(-2));
    ((weight * told + prior * usual) / (weight + prior)).clamp(POWERS.low, POWERS.high)
}

/// Apertures of a night's frames.
#[derive(Debug)]
pub(super) struct Apertures {
    /// `None` where the aperture was set by hand.
    widths: Option<Widths>,
    /// Radius in widths of a point as pixels see it.
    per_fwhm: f64,
    /// The smallest and the largest radius so far, px.
    pub used_px: Option<Interval>,
    /// The largest that had no room: radius wanted, that taken, px, and when.
    cramped: Option<(f64, f64, Epoch)>,
}

impl Apertures {
    /// Apertures that are of this radius for the widest points; of the same radius for all where `widths` is `None`.
    pub fn new(radius_px: f64, widths: Option<Widths>) -> Self {
        let per_fwhm = widths.as_ref().map_or(0.0, |widths| radius_px / seen_px(widths.widest_px));
        let used_px = widths.is_none().then_some(Interval { low: radius_px, high: radius_px });
        Self { widths, per_fwhm, used_px, cramped: None }
    }

    /// The radius for a frame of these rows and columns, px; `None` for the options' own.
    pub fn radius_px(
        &mut self,
        stay: usize,
        airmass: Option<f64>,
        dim: (usize, usize),
        time: Epoch,
    ) -> Option<f64> {
        let wanted = self.per_fwhm * seen_px(self.widths.as_ref()?.at(stay, airmass));
        let most = OF_FRAME * dim.0.min(dim.1) as f64;
        let radius_px = wanted.min(most);
        if wanted > most && self.cramped.is_none_or(|(before, _, _)| wanted > before) {
            self.cramped = Some((wanted, most, time));
        }
        let used = self.used_px.get_or_insert(Interval { low: radius_px, high: radius_px });
        (used.low, used.high) = (used.low.min(radius_px), used.high.max(radius_px));
        Some(radius_px)
    }

    /// Where frames are too small for the aperture.
    pub fn warning(&self) -> Option<String> {
        let (wanted, most, time) = self.cramped?;
        let time = sunglint_formats::time::format_utc(time, 0);
        Some(format!(
            "points are so wide that an aperture of {wanted:.1} px would be needed ({time}), for which the frames have no room: at most {most:.1} px are taken, and more of the light is left out; take a larger window_px"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Widths of a stay over these airmasses, as a power of them, each off by so much in turn.
    fn stay(at_zenith_px: f64, power: f64, airmass: [f64; 2], off: f64) -> Vec<Looked> {
        (0..9)
            .map(|k| {
                let airmass = airmass[0] + (airmass[1] - airmass[0]) * f64::from(k) / 8.0;
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                Looked { fwhm_px: at_zenith_px * airmass.powf(power) * (1.0 + sign * off), airmass }
            })
            .collect()
    }

    /// Truth: the powers that were put in, by hand. A pass that climbs from airmass 4 to 1.5 tells its power in spite of 3 % of scatter (to 0.05), whether it is turbulence (0.6) or the telescope's
    /// own (0); stars, whose airmass stays, and stays without frames tell nothing, so that 0.6 it is. Widths of a stay whose frames do not tell are the usual.
    #[test]
    fn a_night_tells_how_points_grow_with_the_airmass() {
        for (wanted, tolerance) in [(0.6, 0.05), (0.0, 0.06), (0.9, 0.06)] {
            let looked =
                [stay(5.0, wanted, [4.0, 1.5], 0.03), stay(5.2, wanted, [1.2, 1.21], 0.03)];
            let medians = looked.each_ref().map(|l| Some(l[4].fwhm_px));
            let widths = Widths::of(&medians, 9.0, 6.0, &looked);
            assert!((widths.power - wanted).abs() < tolerance, "{wanted}: {}", widths.power);
            let grown = widths.at(0, Some(4.0)) / widths.at(0, Some(1.5));
            assert!((grown / (4.0_f64 / 1.5).powf(wanted) - 1.0).abs() < 0.06, "{grown}");
        }
        let steady = [stay(5.0, 0.0, [1.2, 1.2], 0.05), Vec::new()];
        let widths = Widths::of(&[Some(5.0), None], 5.0, 7.0, &steady);
        assert_eq!(widths.power, 0.6);
        assert_eq!((widths.at(1, Some(3.0)), widths.of_stay(1)), (7.0, 7.0));
        assert!((widths.at(0, Some(2.4)) / 5.0 - 2_f64.powf(0.6)).abs() < 1e-9);
        assert_eq!(widths.at(0, None), 5.0);
        assert_eq!(Widths::all(3.0, 2).at(1, Some(2.0)), 3.0);
    }

    /// Truth: by hand: apertures are as many widths of a point everywhere, as the widest has; no more than a fifth of a frame's shorter side, which is said with the largest that would be needed; one that was
    /// set by hand stays.
    #[test]
    fn apertures_follow_the_points() {
        let looked = [stay(4.0, 0.6, [1.0, 1.0], 0.0), stay(4.0, 0.6, [4.0, 4.0], 0.0)];
        let medians = looked.each_ref().map(|l| Some(l[0].fwhm_px));
        let widest_px = looked[1][0].fwhm_px;
        let mut apertures =
            Apertures::new(2.5 * widest_px, Some(Widths::of(&medians, widest_px, 4.0, &looked)));
        let start = Epoch::from_gregorian_utc_at_midnight(2020, 11, 18);
        let mut radius = |stay, airmass, side| {
            apertures.radius_px(stay, Some(airmass), (side + 20, side), start)
        };
        // As pixels see them: 4.06 and 9.21 px.
        assert!((radius(0, 1.0, 1000).unwrap() - 10.116).abs() < 0.002);
        assert!((radius(1, 4.0, 1000).unwrap() - 2.5 * widest_px).abs() < 1e-9);
        assert!((radius(1, 4.0, 100).unwrap() - 20.0).abs() < 1e-9);
        let used = apertures.used_px.unwrap();
        assert!((used.low - 10.116).abs() < 0.002 && (used.high - 2.5 * widest_px).abs() < 1e-9);
        let warning = apertures.warning().unwrap();
        assert!(warning.contains("23.0 px") && warning.contains("20.0 px"), "{warning}");
        let mut by_hand = Apertures::new(6.0, None);
        assert_eq!(by_hand.radius_px(0, Some(4.0), (10, 10), start), None);
        assert_eq!(by_hand.used_px, Some(Interval { low: 6.0, high: 6.0 }));
        assert_eq!(by_hand.warning(), None);
    }
}
