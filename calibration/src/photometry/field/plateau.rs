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
