//! Dark frames with less of their own noise.
//!
//! The noise of a mean of a few dark frames is taken off every frame alike: a target that stays on the same pixels has it in all of its samples, and no
//! number of them averages it away. A sensor whose pixels hardly differ in the dark needs no mean of each of them. So each pixel's mean is drawn towards that of its colour by as much as
//! the noise is of the scatter between pixels (James and Stein 1961; Efron and Morris 1973): the sum of the squared errors is never larger.

use super::PhotometryError;
use super::calibrate::MasterFrame;
use ndarray::Array2;
use sunglint_formats::frame::Frame;
use sunglint_numerics::order::{median, robust_sigma};

/// Pixels at most by which noise and scatter are found.
const LOOKED_AT: usize = 40_000;
/// A pixel further off than this, in standard deviations of the scatter, is one of its own kind (hot, say): its mean stays.
const OWN_KIND: f64 = 4.0;

impl MasterFrame {
    /// The mean of dark or bias frames, ADU, with as much of their noise taken out as can be told from what pixels differ by.
    ///
    /// # Errors
    /// The errors of [`MasterFrame::mean`].
    pub fn quiet(frames: &[Frame]) -> Result<Self, PhotometryError> {
        let mut master = Self::mean(frames)?;
        if frames.len() < 2 {
            return Ok(master);
        }
        let mosaic = frames[0].bayer.is_some();
        let mut noise2 = 0.0;
        let phases = if mosaic { 4 } else { 1 };
        for phase in 0..phases {
            noise2 +=
                quiet(&mut master.pixels, frames, mosaic.then_some(phase)) / f64::from(phases);
        }
        master.noise_adu = noise2.sqrt();
        Ok(master)
    }
}

/// Draws the pixels of one colour together; gives the mean square of the noise that is left, ADU².
fn quiet(pixels: &mut Array2<f32>, frames: &[Frame], phase: Option<u8>) -> f64 {
    let is_of = |(row, column): (usize, usize)| {
        phase.is_none_or(|phase| (row % 2) * 2 + column % 2 == usize::from(phase))
    };
    let count = pixels.len() / if phase.is_some() { 4 } else { 1 };
    let step = count.div_ceil(LOOKED_AT).max(1);
    let at: Vec<(usize, usize)> =
        pixels.indexed_iter().map(|(at, _)| at).filter(|at| is_of(*at)).step_by(step).collect();
    // From frame to frame only noise changes, and perhaps the level of all.
    let of_pair = |pair: &[Frame]| {
        let values =
            at.iter().map(|at| f64::from(pair[1].pixels[*at]) - f64::from(pair[0].pixels[*at]));
        variance(values)
    };
    let Some(between) = median(frames.windows(2).filter_map(of_pair)) else { return 0.0 };
    let noise2 = 0.5 * between / frames.len() as f64;
    let values = || at.iter().map(|at| f64::from(pixels[*at]));
    let (Some(level), Some(scatter2)) = (median(values()), variance(values())) else { return 0.0 };
    if scatter2 <= 0.0 {
        return noise2;
    }
    let kept = (1.0 - noise2 / scatter2).clamp(0.0, 1.0);
    let own_kind = OWN_KIND * scatter2.sqrt();
    for (_, value) in pixels.indexed_iter_mut().filter(|(at, _)| is_of(*at)) {
        let off = f64::from(*value) - level;
        if off.abs() <= own_kind {
            *value = (level + kept * off) as f32;
        }
    }
    kept * noise2
}

/// The variance of values without those that lie far off: about their median, within [`OWN_KIND`] standard deviations of it. Not the square of a robust deviation, which whole counts
/// make a step of. `None` of fewer than three.
fn variance(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let middle = median(values.clone())?;
    let least = 12_f64.sqrt().recip();
    let reach = OWN_KIND * robust_sigma(values.clone().map(|v| v - middle))?.max(least);
    let near: Vec<f64> = values.map(|v| v - middle).filter(|v| v.abs() <= reach).collect();
    if near.len() < 3 {
        return None;
    }
    let n = near.len() as f64;
    let mean = near.iter().sum::<f64>() / n;
    Some(near.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hifitime::Epoch;
    use sunglint_formats::fits::Header;
    use sunglint_formats::frame::Bayer;

    /// A number of a standard normal distribution: twelve even ones, less their mean.
    fn normal(state: &mut u64) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            *state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (*state >> 11) as f64 / (1_u64 << 53) as f64;
        }
        sum
    }

    /// The dark of pixels that differ by so much (ADU), and frames of it with a noise of 15 ADU.
    fn darks(differ: f64, count: usize, bayer: Option<Bayer>) -> (Array2<f64>, Vec<Frame>) {
        let mut state = 7;
        let truth = Array2::from_shape_fn((60, 80), |(row, column)| {
            let colour =
                if bayer.is_some() { 9.0 * ((row % 2) * 2 + column % 2) as f64 } else { 0.0 };
            let hot = if (row * 80 + column) % 331 == 5 { 400.0 } else { 0.0 };
            300.0 + colour + hot + differ * normal(&mut state)
        });
        let frame = |_| Frame {
            pixels: truth.mapv(|level| (level + 15.0 * normal(&mut state)).round() as u16),
            origin: [0, 0],
            binning: [1, 1],
            bayer,
            start: Epoch::from_unix_seconds(1.6e9),
            exposure_s: 0.1,
            gain_e_per_adu: Some(0.3),
            temperature_c: None,
            saturation_adu: None,
            header: Header::default(),
        };
        let frames = (0..count).map(frame).collect();
        (truth, frames)
    }

    /// Truth: the dark that was put in. Root of the mean square of the error: that of the best linear estimate, σ τ/√(n τ² + σ²) for pixels that differ by τ and frames with a noise of σ
    /// (Efron and Morris 1973), within 5 % (4,800 pixels know it to 1 %, noise and scatter are themselves found to 1 %); of the mean it is σ/√n. Hot pixels stay what they are. For frames of one colour and of four.
    #[test]
    fn noise_is_taken_out_and_patterns_stay() {
        for bayer in [None, Some(Bayer::Rggb)] {
            for (differ, count) in [(0.0, 13), (3.0, 13), (15.0, 5), (60.0, 3), (2.0, 2)] {
                let (truth, frames) = darks(differ, count, bayer);
                let quiet = MasterFrame::quiet(&frames).unwrap();
                let mean = MasterFrame::mean(&frames).unwrap();
                let rms = |master: &MasterFrame| {
                    let usual = |v: &&(f64, f32)| v.0 < 550.0;
                    let all: Vec<(f64, f32)> =
                        truth.iter().copied().zip(master.pixels.iter().copied()).collect();
                    let errors = all.iter().filter(usual).map(|(t, v)| (f64::from(*v) - t).powi(2));
                    (errors.clone().sum::<f64>() / errors.count() as f64).sqrt()
                };
                let n = count as f64;
                let best = 15.0 * differ / (n * differ * differ + 225.0).sqrt();
                // What the levels of the colours are known to.
                let tolerance = 0.05 * best + 0.35;
                assert!(
                    (rms(&quiet) - best).abs() < tolerance,
                    "{differ} {count}: {} {best}",
                    rms(&quiet)
                );
                assert!((rms(&mean) / (15.0 / n.sqrt()) - 1.0).abs() < 0.05, "{}", rms(&mean));
                assert!(
                    (quiet.noise_adu - best).abs() < 0.1 * best + 1.0,
                    "{differ}: {}",
                    quiet.noise_adu
                );
                let hot = truth.iter().zip(&quiet.pixels).filter(|(t, _)| **t > 600.0);
                for (t, v) in hot {
                    assert!(
                        (f64::from(*v) - t).abs() < 5.0 * 15.0 / n.sqrt() || differ > 50.0,
                        "{t} {v}"
                    );
                }
            }
        }
    }

    /// Truth: by hand: frames without noise make the dark that they are, whatever its pattern; one frame alone is taken as it is; two frames of one level but for their own levels make their mean.
    #[test]
    fn frames_without_noise_are_their_dark() {
        let (_, frames) = darks(20.0, 1, None);
        let one = MasterFrame::quiet(&frames).unwrap();
        assert_eq!(one, MasterFrame::mean(&frames).unwrap());
        let same = [frames[0].clone(), frames[0].clone(), frames[0].clone()];
        assert_eq!(MasterFrame::quiet(&same).unwrap().pixels, one.pixels);
        let mut later = frames[0].clone();
        later.pixels.mapv_inplace(|v| v + 10);
        let both = MasterFrame::quiet(&[frames[0].clone(), later]).unwrap();
        for (a, b) in both.pixels.iter().zip(&one.pixels) {
            assert!((a - b - 5.0).abs() < 1e-3, "{a} {b}");
        }
    }
}
