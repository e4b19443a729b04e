//! Pixels: big-endian bytes to arrays and back.

use super::file::{Fits, Hdu};
use super::header::Header;
use crate::error::ParseError;
use ndarray::{ArrayD, IxDyn};

/// An image or a cube with its header.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// The cards that do not describe the layout of the data (those are made from the pixels).
    pub header: Header,
    /// The values.
    pub pixels: Pixels,
}

macro_rules! pixels {
    ($($(#[doc = $doc:literal])* $variant:ident($type:ty),)*) => {
        /// The values of an image, in the order of numpy: the last index is NAXIS1.
        #[derive(Debug, Clone, PartialEq)]
        #[non_exhaustive]
        pub enum Pixels {
            $($(#[doc = $doc])* $variant(ArrayD<$type>),)*
        }

        impl Pixels {
            /// The lengths of the axes, NAXIS1 last.
            pub fn shape(&self) -> &[usize] {
                match self {
                    $(Self::$variant(array) => array.shape(),)*
                }
            }

            /// Rows and columns of an image; axes of length 1 beside these two are none. `None` for a line or a cube.
            pub fn rows_and_columns(&self) -> Option<[usize; 2]> {
                match (plane(self.shape()), self.shape()) {
                    ([rows, columns], _) => Some([*rows, *columns]),
                    (_, shape) => {
                        let long: Vec<usize> = shape.iter().copied().filter(|&n| n != 1).collect();
                        <[usize; 2]>::try_from(long).ok()
                    }
                }
            }

            /// All values as `f64`; 64-bit integers beyond 2^53 are rounded.
            pub fn to_f64(&self) -> ArrayD<f64> {
                match self {
                    $(Self::$variant(array) => array.mapv(|value| value as f64),)*
                }
            }
        }

        $(impl From<ArrayD<$type>> for Pixels {
            fn from(array: ArrayD<$type>) -> Self {
                Self::$variant(array)
            }
        })*
    };
}

/// A shape without the axes of length 1 behind the first two (before them in the order of numpy), as radio images have them for frequency and polarisation.
fn plane(shape: &[usize]) -> &[usize] {
    match shape {
        [1, rest @ ..] if rest.len() >= 2 => plane(rest),
        shape => shape,
    }
}

pixels! {
    /// BITPIX 8.
    U8(u8),
    /// BITPIX 8, BZERO −128.
    I8(i8),
    /// BITPIX 16.
    I16(i16),
    /// BITPIX 16, BZERO 32768: what cameras write.
    U16(u16),
    /// BITPIX 32.
    I32(i32),
    /// BITPIX 32, BZERO 2147483648.
    U32(u32),
    /// BITPIX 64.
    I64(i64),
    /// BITPIX 64, BZERO 9223372036854775808.
    U64(u64),
    /// BITPIX −32.
    F32(f32),
    /// BITPIX −64, or any integers with another scale or with blanks.
    F64(f64),
}

const TWO_15: f64 = 32_768.0;
const TWO_31: f64 = 2_147_483_648.0;
const TWO_63: f64 = 9_223_372_036_854_775_808.0;

pub(super) fn decode(fits: &Fits, hdu: &Hdu) -> Result<Image, ParseError> {
    let bytes = fits.data(hdu);
    for (keyword, plain) in [("PCOUNT", 0), ("GCOUNT", 1)] {
        let value = hdu.header().integer(keyword).unwrap_or(plain);
        if value != plain {
            return Err(fits.bad(
                hdu,
                keyword,
                value.to_string(),
                format!("{plain}, for an image"),
            ));
        }
    }
    let mut shape: Vec<usize> = Vec::new();
    for n in fits.axes(hdu)? {
        shape.push(usize::try_from(n).unwrap_or(usize::MAX));
    }
    shape.reverse();
    let scale = fits.real_or(hdu, "BSCALE", 1.0)?;
    let zero = fits.real_or(hdu, "BZERO", 0.0)?;
    let blank = match hdu.header().get("BLANK") {
        Some(_) => Some(fits.integer(hdu, "BLANK")?),
        None => None,
    };
    let bitpix = fits.integer(hdu, "BITPIX")?;
    let pixels = Stored { bitpix, scale, zero, blank, shape }.pixels(bytes);
    let pixels = pixels.ok_or_else(|| {
        fits.bad(hdu, "NAXIS", "axes whose product is beyond 64 bits", "a smaller image")
    })?;
    Ok(Image { header: hdu.header().without_structure(), pixels })
}

/// Pixels as they stand in a file.
pub(super) struct Stored {
    pub(super) bitpix: i64,
    pub(super) scale: f64,
    pub(super) zero: f64,
    pub(super) blank: Option<i64>,
    /// Lengths of the axes, NAXIS1 last.
    pub(super) shape: Vec<usize>,
}

impl Stored {
    /// The values of big-endian bytes; `None` if the shape is impossible.
    pub(super) fn pixels(self, bytes: &[u8]) -> Option<Pixels> {
        let Self { bitpix, scale, zero, blank, shape } = self;
        let raw = Raw { scale, zero, blank };
        match bitpix {
            8 => raw.integers(shape, values(bytes, u8::from_be_bytes), |v, shape| match zero {
                -128.0 => Some(array(shape, v.iter().map(|&v| (v ^ 0x80) as i8).collect())?.into()),
                _ => None,
            }),
            16 => raw.integers(shape, values(bytes, i16::from_be_bytes), |v, shape| match zero {
                TWO_15 => {
                    Some(array(shape, v.iter().map(|&v| v as u16 ^ 0x8000).collect())?.into())
                }
                _ => None,
            }),
            32 => raw.integers(shape, values(bytes, i32::from_be_bytes), |v, shape| match zero {
                TWO_31 => {
                    Some(array(shape, v.iter().map(|&v| v as u32 ^ 0x8000_0000).collect())?.into())
                }
                _ => None,
            }),
            64 => raw.integers(shape, values(bytes, i64::from_be_bytes), |v, shape| match zero {
                TWO_63 => {
                    Some(array(shape, v.iter().map(|&v| v as u64 ^ (1 << 63)).collect())?.into())
                }
                _ => None,
            }),
            -32 => raw.floats(shape, values(bytes, f32::from_be_bytes)),
            _ => raw.floats(shape, values(bytes, f64::from_be_bytes)),
        }
    }
}

/// How the values stand in the file.
struct Raw {
    scale: f64,
    zero: f64,
    blank: Option<i64>,
}

impl Raw {
    /// Integers as they are, shifted to unsigned by `shifted`, or scaled to `f64`. `None` if the shape is impossible.
    fn integers<T: Copy + Into<Wide>>(
        &self,
        shape: Vec<usize>,
        values: Vec<T>,
        shifted: impl FnOnce(&[T], Vec<usize>) -> Option<Pixels>,
    ) -> Option<Pixels>
    where
        Pixels: From<ArrayD<T>>,
    {
        let is_blank = |value: T| self.blank == Some(value.into().0);
        if self.scale == 1.0 && !values.iter().any(|&value| is_blank(value)) {
            if self.zero == 0.0 {
                return Some(array(shape, values)?.into());
            }
            if let Some(pixels) = shifted(&values, shape.clone()) {
                return Some(pixels);
            }
        }
        let scaled = values.iter().map(|&value| {
            if is_blank(value) { f64::NAN } else { self.zero + self.scale * value.into().0 as f64 }
        });
        Some(array(shape, scaled.collect())?.into())
    }

    fn floats<T: Copy + Into<f64>>(&self, shape: Vec<usize>, values: Vec<T>) -> Option<Pixels>
    where
        Pixels: From<ArrayD<T>>,
    {
        if self.scale == 1.0 && self.zero == 0.0 {
            return Some(array(shape, values)?.into());
        }
        let scaled = values.iter().map(|&value| self.zero + self.scale * value.into());
        Some(array(shape, scaled.collect())?.into())
    }
}

/// An integer pixel, widened.
struct Wide(i64);

macro_rules! wide {
    ($($type:ty),*) => {
        $(impl From<$type> for Wide {
            fn from(value: $type) -> Self {
                Self(i64::from(value))
            }
        })*
    };
}
wide!(u8, i16, i32, i64);

fn values<const N: usize, T>(bytes: &[u8], value: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|&chunk| value(chunk)).collect()
}

fn array<T>(shape: Vec<usize>, values: Vec<T>) -> Option<ArrayD<T>> {
    ArrayD::from_shape_vec(IxDyn(&shape), values).ok()
}

/// BITPIX, BZERO if it is not 0, and the bytes of the data.
pub(super) fn encode(pixels: &Pixels) -> (i64, Option<f64>, Vec<u8>) {
    // Iterating gives logical order, whatever the memory layout is.
    fn bytes<T: Copy, const N: usize>(array: &ArrayD<T>, encode: impl Fn(T) -> [u8; N]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(array.len() * N);
        array.iter().for_each(|&value| bytes.extend_from_slice(&encode(value)));
        bytes
    }
    match pixels {
        Pixels::U8(a) => (8, None, bytes(a, |v| [v])),
        Pixels::I8(a) => (8, Some(-128.0), bytes(a, |v| [v as u8 ^ 0x80])),
        Pixels::I16(a) => (16, None, bytes(a, i16::to_be_bytes)),
        Pixels::U16(a) => (16, Some(TWO_15), bytes(a, |v| (v ^ 0x8000).to_be_bytes())),
        Pixels::I32(a) => (32, None, bytes(a, i32::to_be_bytes)),
        Pixels::U32(a) => (32, Some(TWO_31), bytes(a, |v| (v ^ 0x8000_0000).to_be_bytes())),
        Pixels::I64(a) => (64, None, bytes(a, i64::to_be_bytes)),
        Pixels::U64(a) => (64, Some(TWO_63), bytes(a, |v| (v ^ (1 << 63)).to_be_bytes())),
        Pixels::F32(a) => (-32, None, bytes(a, f32::to_be_bytes)),
        Pixels::F64(a) => (-64, None, bytes(a, f64::to_be_bytes)),
    }
}
