//! Calibration of the sensor from dark frames and a flat: pixels that are wrong, and what every frame has in common.

use super::PhotometryError;
use ndarray::{Array2, Zip, s};
use sunglint_formats::frame::Frame;

bitflags::bitflags! {
    /// Faults of a pixel.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct PixelFault: u8 {
        /// Brighter in the dark than the others.
        const HOT = 1;
        /// Darker in the dark than the others.
        const COLD = 1 << 1;
        /// Never changes, or the flat finds that it does not see.
        const DEAD = 1 << 2;
    }
}

/// A mean of frames of one region of the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct MasterFrame {
    /// The means, `[row, column]`: ADU of a dark, responses (mean 1) of a flat.
    pub pixels: Array2<f32>,
    /// Sensor column and row of the first pixel, unbinned.
    pub origin: [u32; 2],
    /// Sensor columns and rows in a pixel.
    pub binning: [u32; 2],
    /// Exposure of the frames, s.
    pub exposure_s: f64,
    /// Noise of a pixel, ADU; 0 where it is not known.
    pub noise_adu: f64,
}

impl MasterFrame {
    /// The mean of dark or bias frames, ADU.
    ///
    /// # Errors
    /// [`PhotometryError::TooFew`] of none; [`PhotometryError::OtherRegion`] where they are not of one region;
    /// [`PhotometryError::DarkExposure`] where they are not of one exposure.
    pub fn mean(frames: &[Frame]) -> Result<Self, PhotometryError> {
        let stack = Stack::of(frames, 1)?;
        let scale = (frames.len() as f64).recip();
        let first = &frames[0];
        Ok(Self {
            pixels: stack.sum.mapv(|sum| (sum as f64 * scale) as f32),
            origin: first.origin,
            binning: first.binning,
            exposure_s: first.exposure_s,
            noise_adu: 0.0,
        })
    }

    /// The flat of frames of an even light: their mean less the dark, over its median, for each colour by itself.
    ///
    /// # Errors
    /// The errors of [`MasterFrame::mean`]; [`PhotometryError::OtherRegion`] where the dark is not of the same region.
    pub fn flat(frames: &[Frame], dark: &Self) -> Result<Self, PhotometryError> {
        let mut flat = Self::mean(frames)?;
        let first = &frames[0];
        let [column, row] = dark.region().offset_of(Region::of(first), "dark")?;
        for ((r, c), value) in flat.pixels.indexed_iter_mut() {
            *value -= dark.pixels[[r + row, c + column]];
        }
        for phase in 0..if first.bayer.is_some() { 4 } else { 1 } {
            let of_phase =
                |(r, c): (usize, usize)| first.bayer.is_none() || (r % 2) * 2 + c % 2 == phase;
            let mut values: Vec<f32> = flat
                .pixels
                .indexed_iter()
                .filter(|(at, _)| of_phase(*at))
                .map(|(_, v)| *v)
                .collect();
            let Some(median) = median(&mut values) else { continue };
            for (at, value) in flat.pixels.indexed_iter_mut() {
                if of_phase(at) {
                    *value = if median > 0.0 { *value / median } else { 0.0 };
                }
            }
        }
        Ok(flat)
    }

    fn region(&self) -> Region {
        Region { origin: self.origin, binning: self.binning, size: size(&self.pixels) }
    }
}

/// The pixels of a sensor's region that are not to be used.
#[derive(Debug, Clone, PartialEq)]
pub struct BadPixels {
    /// Faults, `[row, column]`.
    pub faults: Array2<PixelFault>,
    /// Sensor column and row of the first pixel, unbinned.
    pub origin: [u32; 2],
    /// Sensor columns and rows in a pixel.
    pub binning: [u32; 2],
    /// Median of the pixels' means in the dark, ADU.
    pub median_adu: f64,
    /// Their standard deviation by the median absolute deviation, ADU.
    pub sigma_adu: f64,
}

impl BadPixels {
    /// The pixels whose mean over dark frames is more than `k_sigma` standard deviations from the median of all, and those that never
    /// change where others do (told from five frames on).
    ///
    /// The standard deviation is 1.4826 × the median absolute deviation, and no less than what whole counts leave, 1/√(12 n) ADU: of a sensor
    /// without faults it masks 0.27 % at 3.
    ///
    /// # Errors
    /// The errors of [`MasterFrame::mean`].
    pub fn from_darks(frames: &[Frame], k_sigma: f64) -> Result<Self, PhotometryError> {
        const FRAMES_TO_TELL_DEAD: usize = 5;
        let mean = MasterFrame::mean(frames)?;
        let mut values: Vec<f32> = mean.pixels.iter().copied().collect();
        let middle = median(&mut values).unwrap_or(0.0);
        for value in &mut values {
            *value = (*value - middle).abs();
        }
        let quantum = (12.0 * frames.len() as f64).sqrt().recip();
        let sigma_adu = (1.4826 * f64::from(median(&mut values).unwrap_or(0.0))).max(quantum);
        let reach = (k_sigma * sigma_adu) as f32;
        let mut faults = mean.pixels.mapv(|value| match value - middle {
            above if above > reach => PixelFault::HOT,
            above if above < -reach => PixelFault::COLD,
            _ => PixelFault::empty(),
        });
        let changes = Stack::of(frames, 1)?.changes;
        let changing = changes.iter().filter(|&&c| c).count();
        if frames.len() >= FRAMES_TO_TELL_DEAD && 10 * changing > 9 * changes.len() {
            Zip::from(&mut faults).and(&changes).for_each(|fault, &changes| {
                fault.set(PixelFault::DEAD, !changes);
            });
        }
        Ok(Self {
            faults,
            origin: mean.origin,
            binning: mean.binning,
            median_adu: f64::from(middle),
            sigma_adu,
        })
    }

    /// Adds the pixels that a flat finds to see less than `least` of the light that the others see.
    ///
    /// # Errors
    /// [`PhotometryError::OtherRegion`] where the flat does not cover the mask's region.
    pub fn add_blind(&mut self, flat: &MasterFrame, least: f32) -> Result<(), PhotometryError> {
        let [column, row] = flat.region().offset_of(self.region(), "flat")?;
        for ((r, c), fault) in self.faults.indexed_iter_mut() {
            let response = flat.pixels[[r + row, c + column]];
            if response.is_nan() || response < least {
                fault.insert(PixelFault::DEAD);
            }
        }
        Ok(())
    }

    /// How many pixels have this fault.
    pub fn count(&self, fault: PixelFault) -> usize {
        self.faults.iter().filter(|f| f.intersects(fault)).count()
    }

    fn region(&self) -> Region {
        Region { origin: self.origin, binning: self.binning, size: size(&self.faults) }
    }
}

/// Calibration of frames: what is subtracted from every frame, and which pixels are left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameCalibration {
    /// Pixels to leave out.
    pub bad: Option<BadPixels>,
    /// To be subtracted: darks of the frames' exposure.
    pub dark: Option<MasterFrame>,
    /// To be subtracted whatever the exposure; not beside a dark, which holds it.
    pub bias: Option<MasterFrame>,
    /// To divide by.
    pub flat: Option<MasterFrame>,
}

impl FrameCalibration {
    /// Whether values stay the whole counts that were read.
    pub(crate) fn keeps_counts(&self) -> bool {
        self.dark.is_none() && self.bias.is_none() && self.flat.is_none()
    }

    /// Noise of a pixel of what is subtracted, ADU.
    pub(crate) fn noise_adu(&self) -> f64 {
        self.dark.as_ref().or(self.bias.as_ref()).map_or(0.0, |master| master.noise_adu)
    }

    /// This calibration laid over a frame.
    ///
    /// # Errors
    /// [`PhotometryError::OtherRegion`], [`PhotometryError::DarkExposure`].
    pub(crate) fn over(&self, frame: &Frame) -> Result<Laid<'_>, PhotometryError> {
        let region = Region::of(frame);
        let bad = match &self.bad {
            None => None,
            Some(bad) => Some((&bad.faults, bad.region().offset_of(region, "mask")?)),
        };
        let lay = |master: &'_ Option<MasterFrame>, what| match master {
            None => Ok(None),
            Some(master) => Ok(Some(master.region().offset_of(region, what)?)),
        };
        let dark_at = lay(&self.dark, "dark")?;
        let bias_at = lay(&self.bias, "bias")?;
        let flat_at = lay(&self.flat, "flat")?;
        if let Some(dark) = &self.dark {
            let (dark_s, frame_s) = (dark.exposure_s, frame.exposure_s);
            if (dark_s - frame_s).abs() > 0.01 * frame_s {
                return Err(PhotometryError::DarkExposure { dark_s, frame_s });
            }
        }
        let level = self.dark.as_ref().zip(dark_at).or(self.bias.as_ref().zip(bias_at));
        Ok(Laid {
            bad,
            level: level.map(|(master, at)| (&master.pixels, at)),
            flat: self.flat.as_ref().zip(flat_at).map(|(master, at)| (&master.pixels, at)),
        })
    }
}

/// A calibration over a frame: each array with the column and row of the frame's first pixel in it.
#[derive(Clone, Copy)]
pub(crate) struct Laid<'a> {
    bad: Option<(&'a Array2<PixelFault>, [usize; 2])>,
    level: Option<(&'a Array2<f32>, [usize; 2])>,
    flat: Option<(&'a Array2<f32>, [usize; 2])>,
}

impl Laid<'_> {
    /// Whether frames pass as they are.
    pub(crate) fn is_empty(&self) -> bool {
        self.bad.is_none() && self.level.is_none() && self.flat.is_none()
    }

    /// Calibrates the values of a row's pixels from `column` on: NaN where one is masked; what is saturated (infinite) stays so.
    pub(crate) fn over_row(&self, column: usize, row: usize, values: &mut [f32]) {
        fn with<T>(
            (array, [c, r]): &(&Array2<T>, [usize; 2]),
            [column, row]: [usize; 2],
            values: &mut [f32],
            pixel: impl Fn(&mut f32, &T),
        ) {
            let part = array.row(row + r).slice_move(s![column + c..column + c + values.len()]);
            match part.to_slice() {
                Some(part) => values.iter_mut().zip(part).for_each(|(v, of)| pixel(v, of)),
                None => values.iter_mut().zip(part).for_each(|(v, of)| pixel(v, of)),
            }
        }
        let at = [column, row];
        if let Some(level) = &self.level {
            with(level, at, values, |value, level| *value -= level);
        }
        if let Some(flat) = &self.flat {
            with(flat, at, values, |value, &response| {
                *value = if response > 0.0 { *value / response } else { f32::NAN };
            });
        }
        if let Some(bad) = &self.bad {
            with(bad, at, values, |value, fault| {
                if !fault.is_empty() {
                    *value = f32::NAN;
                }
            });
        }
    }
}

/// A region of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Region {
    origin: [u32; 2],
    binning: [u32; 2],
    /// Columns and rows, binned.
    size: [u32; 2],
}

fn size<T>(pixels: &Array2<T>) -> [u32; 2] {
    [pixels.ncols(), pixels.nrows()].map(|n| u32::try_from(n).unwrap_or(u32::MAX))
}

impl Region {
    fn of(frame: &Frame) -> Self {
        Self { origin: frame.origin, binning: frame.binning, size: size(&frame.pixels) }
    }

    fn range(&self, axis: usize) -> [u32; 2] {
        let length = self.size[axis].saturating_mul(self.binning[axis]);
        [self.origin[axis], self.origin[axis].saturating_add(length)]
    }

    /// Binned column and row of `inner`'s first pixel in this region, which must cover it.
    fn offset_of(&self, inner: Self, what: &'static str) -> Result<[usize; 2], PhotometryError> {
        let fits = (0..2).all(|axis| {
            let (outer, inner_range) = (self.range(axis), inner.range(axis));
            outer[0] <= inner_range[0]
                && inner_range[1] <= outer[1]
                && self.binning[axis] == inner.binning[axis]
                && (inner_range[0] - outer[0]).is_multiple_of(self.binning[axis].max(1))
        });
        if !fits {
            return Err(PhotometryError::OtherRegion {
                what,
                covered_columns: self.range(0),
                covered_rows: self.range(1),
                covered_binning: self.binning,
                columns: inner.range(0),
                rows: inner.range(1),
                binning: inner.binning,
            });
        }
        Ok([0, 1].map(|axis| {
            ((inner.origin[axis] - self.origin[axis]) / self.binning[axis].max(1)) as usize
        }))
    }
}

/// The sum of frames, and which of their pixels change.
struct Stack {
    sum: Array2<u64>,
    changes: Array2<bool>,
}

impl Stack {
    fn of(frames: &[Frame], needed: usize) -> Result<Self, PhotometryError> {
        let Some(first) = frames.first().filter(|_| frames.len() >= needed) else {
            return Err(PhotometryError::TooFew { found: frames.len(), needed });
        };
        let mut stack = Self {
            sum: Array2::zeros(first.pixels.raw_dim()),
            changes: Array2::from_elem(first.pixels.raw_dim(), false),
        };
        for frame in frames {
            let (region, other) = (Region::of(first), Region::of(frame));
            if region.size != other.size || region.origin != other.origin {
                // Says which region is which.
                region.offset_of(other, "first frame")?;
                other.offset_of(region, "later frame")?;
            }
            region.offset_of(other, "first frame")?;
            if (frame.exposure_s - first.exposure_s).abs() > 0.01 * first.exposure_s {
                let (dark_s, frame_s) = (first.exposure_s, frame.exposure_s);
                return Err(PhotometryError::DarkExposure { dark_s, frame_s });
            }
            Zip::from(&mut stack.sum).and(&frame.pixels).for_each(|s, &p| *s += u64::from(p));
            Zip::from(&mut stack.changes)
                .and(&frame.pixels)
                .and(&first.pixels)
                .for_each(|changes, p, q| *changes |= p != q);
        }
        Ok(stack)
    }
}

fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
