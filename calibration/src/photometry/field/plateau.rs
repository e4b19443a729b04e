//! Pixels that are clipped below what their type holds.

use ndarray::ArrayView2;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// A value at which a frame's brightest pixels are cut off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plateau {
    /// The value, ADU.
    pub adu: f64,
    /// Pixels that have it.
    pub pixels: usize,
}

impl Plateau {
    /// The words for people.
    pub fn note(&self) -> String {
        format!(
            "{} pixels, side by side, have the frame's highest value, {} ADU: it is taken for saturation",
            self.pixels, self.adu
        )
    }
}

/// The value at which a frame's sources are cut off: several pixels side by side have exactly the frame's highest value, far above its sky. `None` of a frame whose highest values are those of
/// its light. Take it before darks and flats are applied, which spread the value.
pub fn plateau(pixels: ArrayView2<'_, f32>) -> Option<Plateau> {
    /// Fewer pixels than these may be alike by chance.
    const FEW: usize = 6;
    /// Standard deviations of the sky above its level from which a value is a source's.
    const SIGMAS: f64 = 6.0;
    let highest =
        pixels.iter().copied().filter(|v| v.is_finite()).fold(f32::NEG_INFINITY, f32::max);
    if !highest.is_finite() {
        return None;
    }
    let (mut count, mut beside) = (0, 0);
    for ((row, column), value) in pixels.indexed_iter() {
        if *value != highest {
            continue;
        }
        count += 1;
        let near = (-2..=2_isize).flat_map(|dy| (-2..=2_isize).map(move |dx| (dy, dx)));
        let is_beside = near.filter(|d| *d != (0, 0)).any(|(dy, dx)| {
            // Within two pixels, as those of one colour are.
            let at = (row.wrapping_add_signed(dy), column.wrapping_add_signed(dx));
            pixels.get(at).is_some_and(|v| *v == highest)
        });
        beside += usize::from(is_beside);
    }
    if count < FEW || 4 * beside < 3 * count {
        return None;
    }
    let some = || pixels.iter().step_by(17).map(|v| f64::from(*v)).filter(|v| v.is_finite());
    let level = median(some())?;
    let noise = SIGMA_PER_MAD * median(some().map(|v| (v - level).abs()))?;
    // Where the sky itself is at the end of the scale nothing lies above it.
    (f64::from(highest) > level + SIGMAS * noise.max(0.3))
        .then_some(Plateau { adu: f64::from(highest), pixels: count })
}

/// The value at which more than 1 % of a flat's pixels are cut off, ADU; `None` of a flat that is not saturated. `told` is the saturation by its header.
///
/// A flat has no sky below its light, as [`plateau`] needs it. It is cut off at its saturation or at the end of 16 bits; at its highest value if that is the end of another whole number of
/// bits, or if ten times as many pixels have it as any other value.
pub fn cut_flat<T: Copy + Into<f64>>(pixels: ArrayView2<'_, T>, told: Option<f64>) -> Option<f64> {
    /// Part of the pixels that may be at their end.
    const FULL: f64 = 0.01;
    /// Pixels that are looked at for a value that is not told.
    const SAMPLE: usize = 100_000;
    /// Bits of a pixel, where the value may be shifted up to the end of 16.
    const BITS: [u32; 4] = [8, 10, 12, 14];
    const OFTEN: usize = 10;
    let end = told.unwrap_or_else(|| f64::from(u16::MAX));
    let full = pixels.iter().filter(|pixel| Into::<f64>::into(**pixel) >= end).count();
    if full as f64 > FULL * pixels.len() as f64 {
        return Some(end);
    }
    let stride = (pixels.len() / SAMPLE) | 1;
    let some = pixels.iter().step_by(stride).map(|v| Into::<f64>::into(*v));
    let mut some: Vec<f64> = some.filter(|v| v.is_finite()).collect();
    some.sort_unstable_by(f64::total_cmp);
    let highest = *some.last()?;
    let mut counts = some.chunk_by(|a, b| a == b).map(<[f64]>::len);
    let at_end = counts.next_back()?;
    if at_end as f64 <= FULL * some.len() as f64 {
        return None;
    }
    let is_end = BITS.iter().any(|bits| {
        let end = f64::from((1_u32 << bits) - 1);
        [end, end * f64::from(1_u32 << (16 - bits))].contains(&highest)
    });
    // One value alone is no distribution: a flat that was made up, with a few bad pixels.
    let others = some.len() - at_end;
    let stands_out = others as f64 > FULL * some.len() as f64
        && counts.max().is_some_and(|most| at_end > OFTEN * most);
    (is_end || stands_out).then_some(highest)
}
