//! The `.bsdf` tensor file: named arrays, as Dupuy and Jakob's material database holds its measurements and Mitsuba 3
//! reads them (*An adaptive parameterization for efficient material acquisition and rendering*, ACM TOG 37, 2018).
//!
//! Little-endian: `tensor_file\0`, version 1.0, u32 number of fields; then per field a u16 length and the name, u16
//! number of axes, u8 type, u64 offset of the data from the start of the file, u64 for each axis. The last index runs
//! fastest. What the arrays mean is not known here; [`TensorFile::check_material`] only says which that a measured
//! material needs are missing.

use crate::atomic::Overwrite;
use crate::error::{EncodeError, FileError, ParseError, excerpt};
use std::collections::HashSet;
use std::path::Path;

const MAGIC: &[u8; 12] = b"tensor_file\0";
/// Bytes that a field takes at least: name length, one letter, axes, type, offset.
const LEAST_FIELD: usize = 14;

/// A tensor file in memory.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TensorFile {
    /// The arrays in their order.
    pub tensors: Vec<Tensor>,
}

/// A named array.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// The name (`theta_i`, `spectra` …).
    pub name: String,
    /// Lengths of the axes; the last index runs fastest.
    pub shape: Vec<usize>,
    /// The values, as many as the product of the shape.
    pub data: TensorData,
}

macro_rules! tensor_data {
    ($($variant:ident($type:ty) = $code:literal $name:literal,)*) => {
        /// The values of an array, in one of the eleven types.
        #[derive(Debug, Clone, PartialEq)]
        pub enum TensorData {
            $(#[doc = concat!("Type ", $code, ", ", $name, ".")] $variant(Vec<$type>),)*
        }

        impl TensorData {
            /// Number of values.
            pub fn len(&self) -> usize {
                match self { $(Self::$variant(values) => values.len(),)* }
            }

            /// Whether there is none.
            pub fn is_empty(&self) -> bool {
                self.len() == 0
            }

            /// The name of the type (`f32`).
            pub fn type_name(&self) -> &'static str {
                match self { $(Self::$variant(_) => $name,)* }
            }

            fn code(&self) -> u8 {
                match self { $(Self::$variant(_) => $code,)* }
            }

            fn encode(&self, out: &mut Vec<u8>) {
                match self {
                    $(Self::$variant(values) => {
                        out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
                    })*
                }
            }

            /// Bytes of a value of a type.
            fn width(code: u8) -> Option<u64> {
                match code { $($code => Some(size_of::<$type>() as u64),)* _ => None }
            }

            fn decode(code: u8, bytes: &[u8]) -> Option<Self> {
                match code {
                    $($code => {
                        let (chunks, _) = bytes.as_chunks::<{ size_of::<$type>() }>();
                        let values = chunks.iter().map(|&chunk| <$type>::from_le_bytes(chunk));
                        Some(Self::$variant(values.collect()))
                    })*
                    _ => None,
                }
            }
        }
    };
}

tensor_data! {
    U8(u8) = 1 "u8",
    I8(i8) = 2 "i8",
    U16(u16) = 3 "u16",
    I16(i16) = 4 "i16",
    U32(u32) = 5 "u32",
    I32(i32) = 6 "i32",
    U64(u64) = 7 "u64",
    I64(i64) = 8 "i64",
    F16(half::f16) = 9 "f16",
    F32(f32) = 10 "f32",
    F64(f64) = 11 "f64",
}

impl TensorFile {
    /// Reads a file.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        Ok(Self::from_bytes(path, &crate::read::bytes(path)?)?)
    }

    /// A tensor file from its bytes; `path` names it in errors. Memory is bounded by the bytes: all data together must
    /// not be more than there are, so blocks that overlap are refused where that would multiply them.
    ///
    /// # Errors
    /// A [`ParseError`] with the field: not a tensor file, another version, cut off, an unknown type, a name twice.
    pub fn from_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<Self, ParseError> {
        Self::from_bytes_at(path.as_ref(), bytes)
    }

    fn from_bytes_at(path: &Path, bytes: &[u8]) -> Result<Self, ParseError> {
        let mut reader = Reader { path, bytes, at: 0, field: "header".to_owned() };
        let magic = reader.take(MAGIC.len())?;
        if magic != MAGIC {
            let found = excerpt(&String::from_utf8_lossy(magic));
            return Err(reader.bad(found, "`tensor_file`"));
        }
        let [major, minor] = reader.array()?;
        if (major, minor) != (1, 0) {
            return Err(reader.bad(format!("version {major}.{minor}"), "version 1.0"));
        }
        let count = u32::from_le_bytes(reader.array()?) as usize;
        let mut tensors: Vec<Tensor> = Vec::with_capacity(count.min(bytes.len() / LEAST_FIELD));
        let mut names = HashSet::new();
        let mut total = 0_u64;
        for number in 0..count {
            reader.field = format!("field {number}");
            let tensor = reader.tensor(&mut total)?;
            if !names.insert(tensor.name.clone()) {
                return Err(reader.bad("the name twice", "each name once"));
            }
            tensors.push(tensor);
        }
        Ok(Self { tensors })
    }

    /// The bytes of the file; each block of data begins at a multiple of 8, as the reference writer does it.
    ///
    /// # Errors
    /// A shape that does not fit its data, a name twice, a name or a number of axes beyond 65535.
    pub fn to_bytes(&self) -> Result<Vec<u8>, EncodeError> {
        for (i, tensor) in self.tensors.iter().enumerate() {
            tensor.check()?;
            if self.tensors[..i].iter().any(|other| other.name == tensor.name) {
                return Err(EncodeError::new(&tensor.name, "the name twice", "each name once"));
            }
        }
        let head = |tensor: &Tensor| 2 + tensor.name.len() + 2 + 1 + 8 + 8 * tensor.shape.len();
        let header = MAGIC.len() + 2 + 4 + self.tensors.iter().map(head).sum::<usize>();
        let mut out = Vec::with_capacity(header);
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&[1, 0]);
        out.extend_from_slice(&(self.tensors.len() as u32).to_le_bytes());
        let mut data = Vec::new();
        for tensor in &self.tensors {
            data.resize((header + data.len()).next_multiple_of(8) - header, 0);
            out.extend_from_slice(&(tensor.name.len() as u16).to_le_bytes());
            out.extend_from_slice(tensor.name.as_bytes());
            out.extend_from_slice(&(tensor.shape.len() as u16).to_le_bytes());
            out.push(tensor.data.code());
            out.extend_from_slice(&((header + data.len()) as u64).to_le_bytes());
            out.extend(tensor.shape.iter().flat_map(|&n| (n as u64).to_le_bytes()));
            tensor.data.encode(&mut data);
        }
        out.append(&mut data);
        Ok(out)
    }

    /// Writes the file, whole or not at all.
    pub fn write_file(
        &self,
        path: impl AsRef<Path>,
        overwrite: Overwrite,
    ) -> Result<(), FileError> {
        let path = path.as_ref();
        let bytes = self.to_bytes().map_err(|source| FileError::encode(path, source))?;
        crate::atomic::write_file(path, &bytes, overwrite)
    }

    /// The array of that name.
    pub fn get(&self, name: &str) -> Option<&Tensor> {
        self.tensors.iter().find(|tensor| tensor.name == name)
    }

    /// Checks that everything is there that a measured material needs, in the right type and with the right number of
    /// axes. `path` names the file in errors. Whether the shapes fit each other, and what the values mean, is left to
    /// who uses them.
    ///
    /// # Errors
    /// A [`ParseError`] that names all missing fields together, or the field of a wrong type or shape.
    pub fn check_material(&self, path: impl AsRef<Path>) -> Result<(), ParseError> {
        self.check_material_at(path.as_ref())
    }

    fn check_material_at(&self, path: &Path) -> Result<(), ParseError> {
        const NEEDED: [(&str, &str, usize); 8] = [
            ("description", "u8", 1),
            ("theta_i", "f32", 1),
            ("phi_i", "f32", 1),
            ("ndf", "f32", 2),
            ("sigma", "f32", 2),
            ("vndf", "f32", 4),
            ("luminance", "f32", 4),
            ("jacobian", "u8", 1),
        ];
        const SPECTRAL: [(&str, &str, usize); 2] =
            [("wavelengths", "f32", 1), ("spectra", "f32", 5)];
        const COLOUR: [(&str, &str, usize); 1] = [("rgb", "f32", 5)];
        let colour = self.get("wavelengths").is_none() && self.get("rgb").is_some();
        let values: &[_] = if colour { &COLOUR } else { &SPECTRAL };
        let needed = || NEEDED.iter().chain(values);
        let missing: Vec<&str> = needed()
            .filter(|(name, ..)| self.get(name).is_none())
            .map(|&(name, ..)| name)
            .collect();
        if !missing.is_empty() {
            return Err(ParseError::new(path, "no such field", "a measured material")
                .in_field(missing.join(", ")));
        }
        for &(name, type_name, axes) in needed() {
            if let Some(tensor) = self.get(name)
                && (tensor.data.type_name() != type_name || tensor.shape.len() != axes)
            {
                let found = format!("{} with {} axes", tensor.data.type_name(), tensor.shape.len());
                let expected = format!("{type_name} with {axes} axes");
                return Err(ParseError::new(path, found, expected).in_field(name));
            }
        }
        Ok(())
    }
}

impl Tensor {
    /// An array of `f32`, the type of nearly all fields.
    pub fn f32(name: impl Into<String>, shape: &[usize], values: Vec<f32>) -> Self {
        Self { name: name.into(), shape: shape.to_vec(), data: TensorData::F32(values) }
    }

    /// Bytes, such as a text.
    pub fn u8(name: impl Into<String>, values: impl Into<Vec<u8>>) -> Self {
        let values = values.into();
        Self { name: name.into(), shape: vec![values.len()], data: TensorData::U8(values) }
    }

    /// The values, if they are `f32`.
    pub fn as_f32(&self) -> Option<&[f32]> {
        match &self.data {
            TensorData::F32(values) => Some(values),
            _ => None,
        }
    }

    fn check(&self) -> Result<(), EncodeError> {
        let bad = |found: String, expected: &str| EncodeError::new(&self.name, found, expected);
        let product = self.shape.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
        if product != Some(self.data.len()) {
            let found = format!("{} values in the shape {:?}", self.data.len(), self.shape);
            return Err(bad(found, "as many values as the shape has places"));
        }
        if self.name.is_empty() || self.name.len() > usize::from(u16::MAX) {
            let found = format!("a name of {} bytes", self.name.len());
            return Err(bad(found, "a name of 1 to 65535 bytes"));
        }
        if self.shape.len() > usize::from(u16::MAX) {
            return Err(bad(format!("{} axes", self.shape.len()), "at most 65535"));
        }
        Ok(())
    }
}

/// Walks over the head of the file.
struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    /// Name of the field that is being read, for errors.
    field: String,
}

impl<'a> Reader<'a> {
    fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ParseError {
        ParseError::new(self.path, found, expected).in_field(&self.field)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], ParseError> {
        let rest = &self.bytes[self.at..];
        if rest.len() < count {
            let found = format!("the end of the file after {} bytes", self.bytes.len());
            let expected = format!("{} bytes more", count - rest.len());
            return Err(self.bad(found, expected).with_hint("the file is cut off"));
        }
        self.at += count;
        Ok(&rest[..count])
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ParseError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    /// Reads a field; `total` counts the bytes of data so far.
    fn tensor(&mut self, total: &mut u64) -> Result<Tensor, ParseError> {
        let length = u16::from_le_bytes(self.array()?);
        let name = self.take(usize::from(length))?;
        let Ok(name) = str::from_utf8(name) else {
            return Err(self.bad("a name that is not UTF-8", "a name in UTF-8"));
        };
        if name.is_empty() {
            return Err(self.bad("a name of 0 bytes", "a name"));
        }
        self.field = name.to_owned();
        let axes = u16::from_le_bytes(self.array()?);
        let [code] = self.array()?;
        let Some(width) = TensorData::width(code) else {
            return Err(self.bad(format!("type {code}"), "a type from 1 (u8) to 11 (f64)"));
        };
        let offset = u64::from_le_bytes(self.array()?);
        let sizes = self.take(usize::from(axes) * 8)?.as_chunks::<8>().0;
        let sizes: Vec<u64> = sizes.iter().map(|&bytes| u64::from_le_bytes(bytes)).collect();
        let count = if sizes.contains(&0) {
            Some(0)
        } else {
            sizes.iter().try_fold(1_u64, |product, &n| product.checked_mul(n))
        };
        let present = self.bytes.len() as u64;
        let size = count.and_then(|count| count.checked_mul(width));
        let end = size.and_then(|size| offset.checked_add(size)).filter(|&end| end <= present);
        let (Some(size), Some(end)) = (size, end) else {
            let found = format!("the shape {} at byte {offset}", shape_in_words(&sizes));
            return Err(self
                .bad(found, format!("data inside the {present} bytes of the file"))
                .with_hint("the file is cut off, or its header is wrong"));
        };
        *total += size; // both at most `present`, so no overflow before the check below
        if *total > present {
            return Err(self.bad("blocks of data that overlap", "a block for each field"));
        }
        let bytes = &self.bytes[offset as usize..end as usize];
        let Some(data) = TensorData::decode(code, bytes) else {
            return Err(self.bad(format!("type {code}"), "a type from 1 (u8) to 11 (f64)"));
        };
        // Axes beside one of length 0 may be of any length; nothing is stored for them.
        let shape = sizes.iter().map(|&n| usize::try_from(n).unwrap_or(usize::MAX)).collect();
        Ok(Tensor { name: name.to_owned(), shape, data })
    }
}

fn shape_in_words(sizes: &[u64]) -> String {
    match sizes {
        [] => "of a single value".to_owned(),
        sizes if sizes.len() > 8 => format!("of {} axes", sizes.len()),
        sizes => sizes.iter().map(u64::to_string).collect::<Vec<_>>().join(" x "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_types() -> TensorFile {
        let tensor = |name: &str, data| Tensor { name: name.into(), shape: vec![1, 3], data };
        TensorFile {
            tensors: vec![
                tensor("u8", TensorData::U8(vec![0, 1, 255])),
                tensor("i8", TensorData::I8(vec![-128, 0, 127])),
                tensor("u16", TensorData::U16(vec![0, 1, u16::MAX])),
                tensor("i16", TensorData::I16(vec![i16::MIN, 0, i16::MAX])),
                tensor("u32", TensorData::U32(vec![0, 1, u32::MAX])),
                tensor("i32", TensorData::I32(vec![i32::MIN, 0, i32::MAX])),
                tensor("u64", TensorData::U64(vec![0, 1, u64::MAX])),
                tensor("i64", TensorData::I64(vec![i64::MIN, 0, i64::MAX])),
                tensor(
                    "f16",
                    TensorData::F16([0.5, 65504.0, -0.0].map(half::f16::from_f32).into()),
                ),
                tensor("f32", TensorData::F32(vec![0.1, f32::MAX, -0.0])),
                tensor("f64", TensorData::F64(vec![0.1, f64::MAX, -0.0])),
                Tensor { name: "empty".into(), shape: vec![0, 5], data: TensorData::F64(vec![]) },
                Tensor { name: "scalar".into(), shape: vec![], data: TensorData::F64(vec![1.5]) },
            ],
        }
    }

    #[test]
    fn every_type_comes_back() {
        let file = all_types();
        assert_eq!(TensorFile::from_bytes("a.bsdf", &file.to_bytes().unwrap()).unwrap(), file);
    }

    #[test]
    fn the_bytes_are_those_of_the_format() {
        // Truth: the layout above, by hand.
        let file = TensorFile { tensors: vec![Tensor::f32("ab", &[2], vec![1.0, -2.0])] };
        let mut bytes = b"tensor_file\0\x01\x00\x01\x00\x00\x00".to_vec();
        bytes.extend(b"\x02\x00ab\x01\x00\x0a");
        bytes.extend(40_u64.to_le_bytes()); // 18 + 2 + 2 + 2 + 1 + 8 + 8 = 41, so the block lies at 48
        let at = bytes.len() - 8;
        bytes[at] = 48;
        bytes.extend(2_u64.to_le_bytes());
        bytes.resize(48, 0);
        bytes.extend([0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0]);
        assert_eq!(file.to_bytes().unwrap(), bytes);
    }

    fn refused(bytes: &[u8]) -> String {
        TensorFile::from_bytes("a.bsdf", bytes).unwrap_err().to_string()
    }

    #[test]
    fn what_is_wrong_is_named_with_its_field() {
        let good = TensorFile { tensors: vec![Tensor::f32("theta_i", &[2], vec![1.0, -2.0])] };
        let good = good.to_bytes().unwrap();
        let with = |at: usize, new: &[u8]| {
            let mut bytes = good.clone();
            bytes[at..at + new.len()].copy_from_slice(new);
            bytes
        };
        let shape = 18 + 2 + 7 + 2 + 1 + 8;
        assert_eq!(
            refused(b"hello, this is no tensor"),
            "a.bsdf: header: found `hello, this `, expected `tensor_file`"
        );
        assert_eq!(
            refused(&with(12, &[2])),
            "a.bsdf: header: found version 2.0, expected version 1.0"
        );
        assert_eq!(
            refused(&with(29, &[12])),
            "a.bsdf: theta_i: found type 12, expected a type from 1 (u8) to 11 (f64)"
        );
        assert_eq!(
            refused(&with(shape, &u64::MAX.to_le_bytes())),
            "a.bsdf: theta_i: found the shape 18446744073709551615 at byte 48, expected data inside the 56 bytes of the file \
             (the file is cut off, or its header is wrong)"
        );
        assert_eq!(
            refused(&good[..50]),
            "a.bsdf: theta_i: found the shape 2 at byte 48, expected data inside the 50 bytes of the file (the file is cut off, \
             or its header is wrong)"
        );
        assert_eq!(
            refused(&good[..25]),
            "a.bsdf: field 0: found the end of the file after 25 bytes, expected 2 bytes more (the file is cut off)"
        );
        assert_eq!(
            refused(&with(14, &u32::MAX.to_le_bytes())),
            "a.bsdf: field 1: found a name of 0 bytes, expected a name"
        );
    }

    #[test]
    fn blocks_that_overlap_are_refused_before_they_multiply() {
        let tensors: Vec<Tensor> =
            (0..100).map(|i| Tensor::u8(format!("t{i:03}"), vec![0; 200])).collect();
        let mut bytes = TensorFile { tensors }.to_bytes().unwrap();
        bytes.truncate(bytes.len() - 200 * 50);
        // Every field points at the first block.
        let first: [u8; 8] = bytes[18 + 2 + 4 + 2 + 1..][..8].try_into().unwrap();
        for i in 0..100 {
            bytes[18 + i * 25 + 9..][..8].copy_from_slice(&first);
        }
        let message = refused(&bytes);
        assert!(message.contains("found blocks of data that overlap"), "{message}");
    }

    #[test]
    fn a_material_names_all_that_it_lacks() {
        let mut file = TensorFile {
            tensors: vec![
                Tensor::u8("description", *b"white"),
                Tensor::f32("theta_i", &[1], vec![0.0]),
                Tensor::f32("phi_i", &[1], vec![0.0]),
                Tensor::f32("wavelengths", &[1], vec![500.0]),
                Tensor::f32("ndf", &[1, 1], vec![1.0]),
                Tensor::f32("sigma", &[1, 1], vec![1.0]),
                Tensor::f32("vndf", &[1, 1, 1, 1], vec![1.0]),
                Tensor::f32("spectra", &[1, 1, 1, 1, 1], vec![1.0]),
            ],
        };
        assert_eq!(
            file.check_material("a.bsdf").unwrap_err().to_string(),
            "a.bsdf: luminance, jacobian: found no such field, expected a measured material"
        );
        file.tensors.push(Tensor::f32("luminance", &[1], vec![1.0]));
        file.tensors.push(Tensor::u8("jacobian", [1]));
        assert_eq!(
            file.check_material("a.bsdf").unwrap_err().to_string(),
            "a.bsdf: luminance: found f32 with 1 axes, expected f32 with 4 axes"
        );
        file.tensors[8].shape = vec![1; 4];
        file.check_material("a.bsdf").unwrap();
    }

    #[test]
    fn a_shape_that_does_not_fit_is_not_written() {
        let file = TensorFile { tensors: vec![Tensor::f32("ndf", &[2, 2], vec![0.0; 3])] };
        assert_eq!(
            file.to_bytes().unwrap_err().to_string(),
            "ndf: found 3 values in the shape [2, 2], expected as many values as the shape has places"
        );
    }
}
