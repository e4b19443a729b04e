//! Light out of numbers that a camera or a recorder bent with a gamma.

use crate::error::wrong;
use ndarray::Array2;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::Frame;

/// Least gamma that is taken. Below it, all but the brightest numbers of 8 bits become 0.
const LEAST: f64 = 0.1;
/// Largest number of a frame, ADU.
const FULL: f64 = 65_535.0;

/// A gamma: a number was recorded as light to this power, both as parts of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gamma(f64);

impl Gamma {
    /// A gamma from 0.1 to 1.
    ///
    /// # Errors
    /// Another number; one above 1 is most often the reciprocal of what was meant.
    pub fn new(gamma: f64) -> Result<Self, DeviceError> {
        if (LEAST..=1.0).contains(&gamma) {
            return Ok(Self(gamma));
        }
        let hint = if gamma > 1.0 && gamma * LEAST <= 1.0 {
            format!("; the gamma of a screen is the reciprocal: {:.4} here", 1.0 / gamma)
        } else {
            String::new()
        };
        Err(wrong(format!(
            "gamma: found {gamma}, expected {LEAST} to 1 (recorded = light^gamma, both as parts of full scale){hint}"
        )))
    }

    /// Light of a recorded number, ADU; 65 535 is that of full scale.
    pub fn light_adu(self, recorded: f64, bits: u8) -> f64 {
        FULL * (recorded / full(bits)).powf(1.0 / self.0)
    }

    /// RMS noise, ADU, that whole recorded numbers bring at this light (ADU): the change of light from one number to the next, divided by √12.
    pub fn quantisation_adu(self, light_adu: f64, bits: u8) -> f64 {
        let recorded = full(bits) * (light_adu / FULL).powf(self.0);
        let step = |low: f64| self.light_adu(low + 1.0, bits) - self.light_adu(low, bits);
        // The mean slope over the number's own width, which ends at 0 and at full scale.
        let low = (recorded - 0.5).clamp(0.0, full(bits) - 1.0);
        step(low) / 12_f64.sqrt()
    }

    /// Puts light in place of a frame's recorded numbers, and says so.
    pub(crate) fn undo(self, frame: &mut Frame, bits: u8) {
        let table: Vec<u16> = (0..=full(bits) as u32)
            .map(|recorded| self.light_adu(recorded.into(), bits).round() as u16)
            .collect();
        frame.pixels.mapv_inplace(|recorded| table[usize::from(recorded).min(table.len() - 1)]);
        let saturation = frame.saturation_adu.unwrap_or_else(|| full(bits)).min(full(bits));
        frame.saturation_adu = Some(self.light_adu(saturation, bits).floor());
        let header = &mut frame.header;
        header.set("GAMMA", self.0, "undone: recorded = light^GAMMA of full scale");
        let median = median(&frame.pixels);
        let comment = "ADU, rms of the recorded numbers' steps at the median";
        header.set("QUANTMED", self.quantisation_adu(median, bits), comment);
        header.set("QUANTMAX", self.quantisation_adu(FULL, bits), "ADU, the same at full scale");
        if let Some(gain) = frame.gain_e_per_adu.take() {
            header.comment(&format!(
                "EGAIN: {gain} e-/ADU was that of the recorded numbers, and is left out"
            ));
        }
    }
}

/// Largest number of so many bits.
fn full(bits: u8) -> f64 {
    if bits == 8 { 255.0 } else { FULL }
}

fn median(pixels: &Array2<u16>) -> f64 {
    let mut values: Vec<u16> = pixels.iter().copied().collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    (*values.select_nth_unstable(middle).1).into()
}
