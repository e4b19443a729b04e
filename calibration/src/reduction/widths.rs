//! Widths of points at each frame of a night, and the apertures that follow them.
//!
//! Seen through more air points are wider, with the airmass to the power of 0.6 (Kolmogorov's turbulence; Roddier 1981): over a pass twice and more. One aperture for all
//! frames would leave out another part of the light of each. So the widths that some frames show are carried to all by a power of the airmass, which the night's own frames tell as
//! far as they can, and an aperture is so many of these widths.

use super::frames::APERTURE_FWHM;
use hifitime::Epoch;
use sunglint_formats::Frame;
use sunglint_numerics::measured::Interval;
use sunglint_numerics::order::median;

/// Power of the airmass by which points are wider, and its standard deviation, before a night tells.
const POWER: (f64, f64) = (0.6, 0.2);
/// Powers that a night may tell: none of the width is the air's, or all of the strongest turbulence.
const POWERS: Interval = Interval { low: 0.0, high: 1.0 };
/// Radius of an aperture at most, as a part of the shorter side of a frame: its annulus, 2.5 times as large, would leave the frame.
const OF_FRAME: f64 = 0.2;

/// Full width at half maximum of a normal profile with a pixel's own variance, px: no point is seen narrower.
const PIXEL_FWHM: f64 = 0.68;

/// Radius of an aperture for points of this width, px.
pub(super) fn aperture_px(fwhm_px: f64) -> f64 {
    APERTURE_FWHM * fwhm_px.hypot(PIXEL_FWHM)
}

/// Radius of an aperture at most on a frame of these rows and columns, px.
pub(super) fn most_px((rows, columns): (usize, usize)) -> f64 {
    OF_FRAME * rows.min(columns) as f64
}

/// Width of points on a frame, where the frame has an airmass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Looked {
    /// Full width at half maximum, unbinned px.
    pub fwhm_px: f64,
    pub airmass: f64,
}

/// Widths of points as the frames of a stay tell them.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Told {
    /// The median full width at half maximum, unbinned px; `None` where the frames do not tell.
    pub fwhm_px: Option<f64>,
    /// Whether all that tell were clipped: good enough to find the target by, but no measure of points.
    pub saturated: bool,
    /// Frames that are not.
    pub looked: Vec<Looked>,
}

/// Widths of points over a night, in unbinned pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Widths {
    of_stay: Vec<OfStay>,
    power: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct OfStay {
    /// Width with which the target is looked for, px.
    target_px: f64,
    /// Points at an unknown airmass, px.
    point_px: f64,
    /// Points in the zenith, px; `None` where no frame of the night tells.
    zenith_px: Option<f64>,
}

impl Widths {
    /// From what the stays tell, each with the airmass of its middle; `usual_px` where none does.
    pub fn of(stays: &[Told], airmasses: &[Option<f64>], usual_px: f64) -> Self {
        let power = power(stays);
        let in_zenith =
            |of: &Told| median(of.looked.iter().map(|l| l.fwhm_px / l.airmass.powf(power)));
        let zeniths: Vec<Option<f64>> = stays.iter().map(in_zenith).collect();
        let usual_zenith_px = median(zeniths.iter().flatten().copied());
        let sharp = |told: &Told| told.fwhm_px.filter(|_| !told.saturated);
        let usual_px = median(stays.iter().filter_map(sharp)).unwrap_or(usual_px);
        let of_stay = stays.iter().zip(zeniths).enumerate().map(|(k, (told, own))| {
            let zenith_px = own.or(usual_zenith_px);
            let airmass = airmasses.get(k).copied().flatten();
            let carried = airmass.zip(zenith_px).map(|(here, px)| px * here.powf(power));
            let expected_px = carried.unwrap_or(usual_px);
            OfStay {
                target_px: told.fwhm_px.unwrap_or(expected_px),
                point_px: sharp(told).unwrap_or(expected_px),
                zenith_px,
            }
        });
        Self { of_stay: of_stay.collect(), power }
    }

    /// The width of a stay's target as its frames show it, clipped or not, px.
    pub fn of_stay(&self, stay: usize) -> f64 {
        self.of_stay[stay].target_px
    }

    /// The width of points at an airmass in a stay, px.
    pub fn at(&self, stay: usize, airmass: Option<f64>) -> f64 {
        let OfStay { point_px, zenith_px, .. } = self.of_stay[stay];
        let carried = airmass.zip(zenith_px).map(|(here, px)| px * here.powf(self.power));
        carried.unwrap_or(point_px)
    }
}

/// A width of unbinned pixels in those of a frame, within what frames are searched for.
pub(super) fn in_frame(fwhm_px: f64, binning: [u32; 2]) -> f64 {
    (fwhm_px / binned(binning)).clamp(0.5, 100.0)
}

/// Sensor pixels along a side of one of a frame's.
pub(super) fn binned(binning: [u32; 2]) -> f64 {
    (f64::from(binning[0]) * f64::from(binning[1])).sqrt()
}

/// Power of the airmass: what stays tell whose airmass changes, beside [`POWER`], each with the weight of its uncertainty.
fn power(stays: &[Told]) -> f64 {
    let (mut xx, mut xy, mut yy, mut free) = (0.0, 0.0, 0.0, 0.0);
    for stay in stays.iter().map(|told| &told.looked).filter(|stay| stay.len() > 1) {
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
    /// `None` where all have one radius.
    widths: Option<Widths>,
    /// Radius of all, px.
    radius_px: f64,
    /// The smallest and the largest radius so far, px.
    pub used_px: Option<Interval>,
    /// The largest that had no room: radius wanted, that taken, px, and when.
    cramped: Option<(f64, f64, Epoch)>,
}

impl Apertures {
    /// Apertures that follow widths, or have this radius.
    pub fn new(radius_px: f64, widths: Option<Widths>) -> Self {
        Self { widths, radius_px, used_px: None, cramped: None }
    }

    /// Whether they follow widths.
    pub fn follow(&self) -> bool {
        self.widths.is_some()
    }

    /// The radius for a frame, px of the frame.
    pub fn radius_px(&mut self, stay: usize, airmass: Option<f64>, frame: &Frame) -> f64 {
        let radius_px = match &self.widths {
            None => self.radius_px,
            Some(widths) => {
                let wanted = aperture_px(in_frame(widths.at(stay, airmass), frame.binning));
                let most = most_px(frame.pixels.dim());
                if wanted > most && self.cramped.is_none_or(|(before, _, _)| wanted > before) {
                    self.cramped = Some((wanted, most, frame.start));
                }
                wanted.min(most)
            }
        };
        let used = self.used_px.get_or_insert(Interval { low: radius_px, high: radius_px });
        (used.low, used.high) = (used.low.min(radius_px), used.high.max(radius_px));
        radius_px
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
    use ndarray::Array2;

    /// Widths of a stay over these airmasses, as a power of them, each off by so much in turn.
    fn stay(at_zenith_px: f64, power: f64, airmass: [f64; 2], off: f64) -> Told {
        let looked: Vec<Looked> = (0..9)
            .map(|k| {
                let airmass = airmass[0] + (airmass[1] - airmass[0]) * f64::from(k) / 8.0;
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                Looked { fwhm_px: at_zenith_px * airmass.powf(power) * (1.0 + sign * off), airmass }
            })
            .collect();
        Told { fwhm_px: Some(looked[4].fwhm_px), saturated: false, looked }
    }

    fn frame(side: usize, binning: [u32; 2]) -> Frame {
        Frame {
            pixels: Array2::zeros((side + 20, side)),
            origin: [0, 0],
            binning,
            bayer: None,
            start: Epoch::from_gregorian_utc_at_midnight(2020, 11, 18),
            exposure_s: 0.1,
            gain_e_per_adu: None,
            temperature_c: None,
            saturation_adu: None,
            header: sunglint_formats::fits::Header::default(),
        }
    }

    /// Truth: the powers that were put in, by hand. A pass that climbs from airmass 4 to 1.5 tells its power in spite of 3 % of scatter (to 0.05), whether it is turbulence (0.6) or the telescope's
    /// own (0); stars, whose airmass stays, and stays without frames tell nothing, so that 0.6 it is. A visit whose frames do not tell, or are all clipped, has the width of those that do, carried to its own airmass;
    /// a target that is clipped is looked for as wide as it looks.
    #[test]
    fn a_night_tells_how_points_grow_with_the_airmass() {
        for (wanted, tolerance) in [(0.6, 0.05), (0.0, 0.06), (0.9, 0.06)] {
            let told = [stay(5.0, wanted, [4.0, 1.5], 0.03), stay(5.2, wanted, [1.2, 1.21], 0.03)];
            let widths = Widths::of(&told, &[], 9.0);
            assert!((widths.power - wanted).abs() < tolerance, "{wanted}: {}", widths.power);
            let middle = widths.at(0, Some(2.75)) / widths.of_stay(0);
            assert!((middle - 1.0).abs() < 0.04, "{wanted}: {middle}");
            let grown = widths.at(0, Some(4.0)) / widths.at(0, Some(1.5));
            assert!((grown / (4.0_f64 / 1.5).powf(wanted) - 1.0).abs() < 0.06, "{grown}");
        }
        let clipped = Told { fwhm_px: Some(11.0), saturated: true, looked: Vec::new() };
        let told = [stay(5.0, 0.0, [1.2, 1.2], 0.0), Told::default(), clipped];
        let widths = Widths::of(&told, &[None, Some(2.4), None], 7.0);
        assert_eq!(widths.power, 0.6);
        // The second stands at twice the airmass.
        let there = 5.0 * 2_f64.powf(0.6);
        for (of, wanted) in [(0, [5.0, 5.0]), (1, [there, there]), (2, [11.0, 5.0])] {
            let found = [widths.of_stay(of), widths.at(of, None)];
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{of}: {found:?}");
            let there = widths.at(of, Some(2.4));
            assert!((there / 5.0 - 2_f64.powf(0.6)).abs() < 1e-9, "{of}: {there}");
        }
        let nothing = Widths::of(&[Told::default()], &[Some(3.0)], 7.0);
        assert_eq!([nothing.of_stay(0), nothing.at(0, None), nothing.at(0, Some(3.0))], [7.0; 3]);
    }

    /// Truth: by hand: apertures are 2.5 widths of a point everywhere, in binned pixels too, and whichever other visits there are; no more than a fifth of a frame's shorter side, which is said with the
    /// largest that would be needed; one that was set by hand stays.
    #[test]
    fn apertures_follow_the_points() {
        let told = [stay(4.0, 0.6, [1.0, 1.0], 0.0), stay(4.0, 0.6, [4.0, 4.0], 0.0)];
        let wide = 2.5 * told[1].looked[0].fwhm_px.hypot(PIXEL_FWHM);
        let mut apertures = Apertures::new(8.0, Some(Widths::of(&told, &[], 4.0)));
        let mut radius =
            |stay, airmass, side| apertures.radius_px(stay, Some(airmass), &frame(side, [1, 1]));
        // As pixels see them: 4.06 and 9.21 px.
        assert!((radius(0, 1.0, 1000) - 10.144).abs() < 0.001);
        assert!((radius(1, 4.0, 1000) - wide).abs() < 1e-9);
        assert!((radius(1, 4.0, 100) - 20.0).abs() < 1e-9);
        let used = apertures.used_px.unwrap();
        assert!((used.low - 10.144).abs() < 0.001 && (used.high - wide).abs() < 1e-9);
        let warning = apertures.warning().unwrap();
        assert!(warning.contains("23.0 px") && warning.contains("20.0 px"), "{warning}");
        let mut alone = Apertures::new(8.0, Some(Widths::of(&told[..1], &[], 4.0)));
        assert!((alone.radius_px(0, Some(1.0), &frame(1000, [1, 1])) - 10.144).abs() < 0.001);
        // Points of 2 px of the frame.
        assert!((alone.radius_px(0, Some(1.0), &frame(1000, [2, 2])) - 5.281).abs() < 0.001);
        let mut by_hand = Apertures::new(6.0, None);
        assert_eq!(by_hand.radius_px(0, Some(4.0), &frame(10, [1, 1])), 6.0);
        assert_eq!(by_hand.used_px, Some(Interval { low: 6.0, high: 6.0 }));
        assert_eq!(by_hand.warning(), None);
    }
}
