//! The MERL database's files of isotropic reflection (Matusik, Pfister, Brand, McMillan 2003, *A data-driven reflectance model*, ACM TOG 22, 759).
//!
//! Three i32 (θ_h, θ_d, φ_d; 90, 90, 180), then f64 for red, green and blue, φ_d fastest; all little-endian. A cell k of θ_h is from (k/90)² to ((k+1)/90)² of π/2, those of θ_d and φ_d are even over π/2 and π. Values are to
//! be multiplied by 1/1500, 1.15/1500 and 1.66/1500; negative ones are none.

use crate::error::ParseError;
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

/// Factors of red, green and blue: from stored numbers to sr⁻¹.
pub const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];
const HEADER: usize = 12;
/// The largest number of cells along an axis: the database's are 90, 90 and 180.
const MOST: i32 = 2048;

/// A file.
#[derive(Debug, Clone, PartialEq)]
pub struct MerlBrdf {
    /// Numbers of cells: tilt of the bisector, angle to it, azimuth about it.
    pub cells: [usize; 3],
    /// Stored numbers: red, then green, then blue; azimuth fastest.
    pub stored: Vec<f64>,
}

fn cells(bytes: &[u8]) -> Option<[usize; 3]> {
    let mut cells = [0; 3];
    for (k, cell) in cells.iter_mut().enumerate() {
        let part = bytes.get(4 * k..4 * k + 4)?.try_into().ok()?;
        *cell = Some(i32::from_le_bytes(part)).filter(|n| (2..=MOST).contains(n))? as usize;
    }
    Some(cells)
}

/// Returns true of bytes that are as many as their own header promises of such a file.
pub fn is_merl(bytes: &[u8]) -> bool {
    cells(bytes).is_some_and(|c| bytes.len() == HEADER + 24 * c[0] * c[1] * c[2])
}

/// Returns true of bytes that begin as such a file does, however many they are.
pub fn has_header(bytes: &[u8]) -> bool {
    cells(bytes).is_some()
}

impl MerlBrdf {
    /// Reads a file from its bytes; `path` names it in errors.
    ///
    /// # Errors
    /// A [`ParseError`]: numbers of cells that are none, fewer or more bytes than they need, a value that is no number.
    pub fn from_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<Self, ParseError> {
        Self::from_bytes_at(path.as_ref(), bytes)
    }

    fn from_bytes_at(path: &Path, bytes: &[u8]) -> Result<Self, ParseError> {
        let Some(cells) = cells(bytes) else {
            let found = "other numbers of cells";
            let expected = format!("three numbers from 2 to {MOST} (90, 90, 180)");
            return Err(ParseError::new(path, found, expected).in_field("header"));
        };
        let count = cells[0] * cells[1] * cells[2];
        if bytes.len() != HEADER + 24 * count {
            let found = format!("{} bytes", bytes.len());
            let expected = format!("{} for {cells:?} cells of three colours", HEADER + 24 * count);
            let error = ParseError::new(path, found, expected).in_field("header");
            return Err(error.with_hint("the file is cut off, or is no file of the MERL database"));
        }
        let stored: Vec<f64> =
            bytes[HEADER..].as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        if let Some(at) = stored.iter().position(|v| !v.is_finite()) {
            let found = format!("{} at cell {} of colour {}", stored[at], at % count, at / count);
            return Err(ParseError::new(path, found, "a number"));
        }
        Ok(Self { cells, stored })
    }

    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out: Vec<u8> = self.cells.iter().flat_map(|n| (*n as i32).to_le_bytes()).collect();
        out.extend(self.stored.iter().flat_map(|v| v.to_le_bytes()));
        out
    }

    /// The value of a cell, sr⁻¹; `None` where nothing was measured, or of a cell that there is not.
    pub fn cell(&self, [h, d, p]: [usize; 3], colour: usize) -> Option<f64> {
        let [nh, nd, np] = self.cells;
        if h >= nh || d >= nd || p >= np || colour >= 3 {
            return None;
        }
        let at = ((colour * nh + h) * nd + d) * np + p;
        self.stored.get(at).filter(|v| **v >= 0.0).map(|v| v * SCALE[colour])
    }

    /// The value between the middles of cells, sr⁻¹: linear in tilt, angle and azimuth (radians), of those of the eight cells that were measured. `None` where none was. The azimuth counts up to π, and alike beyond.
    pub fn at(&self, tilt: f64, angle: f64, azimuth: f64, colour: usize) -> Option<f64> {
        let [nh, nd, np] = self.cells;
        let held = |place: f64, n: usize| {
            let place = (place - 0.5).clamp(0.0, (n - 1) as f64);
            let low = (place as usize).min(n - 2);
            (low, place - low as f64)
        };
        let (h, s) = held((tilt / FRAC_PI_2).max(0.0).sqrt() * nh as f64, nh);
        let (d, t) = held(angle / FRAC_PI_2 * nd as f64, nd);
        // Around the half circle the last cell lies beside the first.
        let turn = azimuth.rem_euclid(PI) / PI * np as f64 - 0.5;
        let low = turn.floor();
        let (p, u) = (low.rem_euclid(np as f64) as usize % np, turn - low);
        let (mut sum, mut weight) = (0.0, 0.0);
        for (h, s) in [(h, 1.0 - s), (h + 1, s)] {
            for (d, t) in [(d, 1.0 - t), (d + 1, t)] {
                for (p, u) in [(p, 1.0 - u), ((p + 1) % np, u)] {
                    let w = s * t * u;
                    if let Some(value) = self.cell([h, d, p], colour).filter(|_| w > 0.0) {
                        sum += w * value;
                        weight += w;
                    }
                }
            }
        }
        (weight > 0.0).then(|| sum / weight)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure should stop the run")]
    use super::*;

    /// Truth: the database's own reader by its formulas: index of θ_h = ⌊√(θ_h/90° · 90 · 90)⌋, of θ_d and φ_d ⌊degrees⌋, φ_d fastest, red before green before blue. Every stored number is its own place (synthetic).
    #[test]
    fn cells_lie_where_the_databases_reader_looks() {
        let count = 90 * 90 * 180;
        let stored: Vec<f64> = (0..3 * count).map(|k| k as f64).collect();
        let file = MerlBrdf { cells: [90, 90, 180], stored };
        let bytes = file.to_bytes();
        assert!(is_merl(&bytes) && !is_merl(&bytes[1..]));
        assert_eq!(MerlBrdf::from_bytes("x", &bytes).unwrap(), file);
        for (h_deg, d_deg, p_deg) in
            [(0.3_f64, 12.2_f64, 7.7_f64), (44.4, 3.5, 170.2), (5.0, 60.1, 91.0)]
        {
            let h = (h_deg * 90.0).sqrt() as usize;
            let index = (h * 90 + d_deg as usize) * 180 + p_deg as usize;
            // The middle of that cell.
            let middle = (((h as f64 + 0.5) / 90.0).powi(2) * 90.0).to_radians();
            let [d, p] = [d_deg, p_deg].map(|v| (v.floor() + 0.5).to_radians());
            for (colour, scale) in SCALE.iter().enumerate() {
                let truth = (colour * count + index) as f64 * scale;
                let found = file.at(middle, d, p, colour).unwrap();
                assert!((found / truth - 1.0).abs() < 1e-9, "{found} {truth}");
            }
        }
    }

    /// Truth: by hand: half way between two cells of 1 and 3; beside one that was not measured the other; nothing where all are.
    #[test]
    fn cells_that_were_not_measured_are_left_out() {
        let mut file = MerlBrdf { cells: [2, 2, 2], stored: vec![1500.0; 24] };
        for p in 0..2 {
            file.stored[2 + p] = 4500.0;
        }
        let half = 0.5 * FRAC_PI_2;
        let low = (0.25_f64).powi(2) * FRAC_PI_2;
        assert!((file.at(low, half, 0.3, 0).unwrap() - 2.0).abs() < 1e-12);
        file.stored[2] = -1.0;
        file.stored[3] = -1.0;
        assert!((file.at(low, half, 0.3, 0).unwrap() - 1.0).abs() < 1e-12);
        file.stored.fill(-1.0);
        assert_eq!(file.at(low, half, 0.3, 0), None);
        let mut bytes = file.to_bytes();
        bytes.pop();
        let error = MerlBrdf::from_bytes("x", &bytes).unwrap_err().to_string();
        assert!(error.contains("203 bytes") && error.contains("204"), "{error}");
        file.stored[5] = f64::NAN;
        assert!(MerlBrdf::from_bytes("x", &file.to_bytes()).is_err());
    }
}
