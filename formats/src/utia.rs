//! The UTIA database's files of anisotropic reflection (Filip and Vávra 2014, *Template-based sampling of anisotropic BRDFs*, CGF 33, 91).
//!
//! f64, little-endian, no header: planes of red, green and blue; in each by elevation and azimuth of the light, then by elevation and azimuth of the view, the last fastest. Elevations are 0, 15 … 75°, azimuths every 7.5°. By
//! the layout that the database's own reader has; no file of a laboratory was at hand.

use crate::error::ParseError;
use std::path::Path;

/// Numbers of elevations and of azimuths.
pub const ELEVATIONS: usize = 6;
/// Azimuths around the circle.
pub const AZIMUTHS: usize = 48;
/// Step of the elevations, degrees.
pub const ELEVATION_STEP_DEG: f64 = 15.0;
/// Step of the azimuths, degrees.
pub const AZIMUTH_STEP_DEG: f64 = 7.5;
/// Directions of light, and of view.
const DIRECTIONS: usize = ELEVATIONS * AZIMUTHS;
const COLOURS: usize = 3;
const BYTES: usize = 8 * COLOURS * DIRECTIONS * DIRECTIONS;

/// A file.
#[derive(Debug, Clone, PartialEq)]
pub struct UtiaBrdf {
    /// Values as they are stored, sr⁻¹; negative ones are none.
    pub value_per_sr: Vec<f64>,
}

/// Returns true of as many bytes as such a file has. It has no header: the values must be numbers as reflection has them, too.
pub fn is_utia(bytes: &[u8]) -> bool {
    bytes.len() == BYTES && are_values(bytes)
}

/// Returns true of bytes that may be a part of such a file: a hundred values or more, and no text.
pub fn may_be_cut(bytes: &[u8]) -> bool {
    bytes.len() >= 800 && are_values(bytes) && std::str::from_utf8(bytes).is_err()
}

fn are_values(bytes: &[u8]) -> bool {
    let plausible = |b: &[u8; 8]| {
        let v = f64::from_le_bytes(*b);
        v.is_finite() && v.abs() < 1e6 && (v == 0.0 || v.abs() > 1e-30)
    };
    bytes.as_chunks::<8>().0.iter().all(plausible)
}

impl UtiaBrdf {
    /// Reads a file from its bytes; `path` names it in errors.
    ///
    /// # Errors
    /// A [`ParseError`]: another number of bytes, a value that is no number.
    pub fn from_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<Self, ParseError> {
        Self::from_bytes_at(path.as_ref(), bytes)
    }

    fn from_bytes_at(path: &Path, bytes: &[u8]) -> Result<Self, ParseError> {
        if bytes.len() != BYTES {
            let found = format!("{} bytes", bytes.len());
            let expected = format!("{BYTES}: 6 elevations by 48 azimuths, twice, three colours");
            return Err(ParseError::new(path, found, expected)
                .with_hint("the file is cut off, or has other steps"));
        }
        let value_per_sr: Vec<f64> =
            bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        if let Some(at) = value_per_sr.iter().position(|v| !v.is_finite()) {
            let found = format!("{} at place {at}", value_per_sr[at]);
            return Err(ParseError::new(path, found, "a number"));
        }
        Ok(Self { value_per_sr })
    }

    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.value_per_sr.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    /// The value for elevation and azimuth (numbers of steps) of light and of view, sr⁻¹; `None` where it is negative, or beyond the steps.
    pub fn value(&self, light: [usize; 2], view: [usize; 2], colour: usize) -> Option<f64> {
        let inside = |d: [usize; 2]| d[0] < ELEVATIONS && d[1] < AZIMUTHS;
        if !(inside(light) && inside(view) && colour < COLOURS) {
            return None;
        }
        let direction = |d: [usize; 2]| d[0] * AZIMUTHS + d[1];
        let at = (colour * DIRECTIONS + direction(light)) * DIRECTIONS + direction(view);
        self.value_per_sr.get(at).copied().filter(|v| *v >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure should stop the run")]
    use super::*;

    /// Truth: the index of the database's own reader: plane · nr · nc + nc (48 θ_i + φ_i) + 48 θ_v + φ_v with nr = nc = 288. Every value is its own place (synthetic).
    #[test]
    fn values_lie_where_the_databases_reader_looks() {
        let value_per_sr: Vec<f64> = (0..3 * 288 * 288).map(f64::from).collect();
        let file = UtiaBrdf { value_per_sr };
        let bytes = file.to_bytes();
        assert!(is_utia(&bytes) && !is_utia(&bytes[8..]));
        let read = UtiaBrdf::from_bytes("x", &bytes).unwrap();
        for (plane, ti, pi, tv, pv) in [(0, 1, 5, 0, 0), (2, 5, 47, 3, 11), (1, 0, 0, 5, 47)] {
            let index = plane * 288 * 288 + 288 * (48 * ti + pi) + 48 * tv + pv;
            assert_eq!(read.value([ti, pi], [tv, pv], plane), Some(index as f64));
        }
        assert_eq!(read.value([6, 0], [0, 0], 0), None);
        let error = UtiaBrdf::from_bytes("x", &bytes[1..]).unwrap_err().to_string();
        assert!(error.contains("1990655 bytes") && error.contains("cut off"), "{error}");
        // Text of the same length is none.
        assert!(!is_utia(&vec![b' '; bytes.len()]));
    }
}
