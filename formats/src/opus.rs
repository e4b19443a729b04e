//! Spectra in files of Bruker's OPUS.
//!
//! Little-endian: the bytes `0a 0a fe fe`, f64 version, i32 place of the directory, i32 room in it, i32 number of blocks. The directory has three i32 a block: type, length in words of four bytes, place. Bits 0–1 of a
//! type say real, imaginary or amplitude, bits 2–3 sample or reference, bits 4–9 which parameters (0: data), bits 10–16 which quantity. Parameters are three letters, i16 type, i16 length in words of two bytes, the value.
//!
//! Bruker publishes no specification. The layout is the one that brukeropus (J. Duran, MIT) and spectrochempy read; no file of a laboratory was at hand.

use crate::error::ParseError;
use std::path::Path;

const MAGIC: [u8; 4] = [0x0a, 0x0a, 0xfe, 0xfe];
/// Parameter blocks that say where a block of data begins and ends on its axis.
const DATA_STATUS: u32 = 1;
/// A file holds a handful of blocks; a directory of more is none.
const MOST_BLOCKS: usize = 4096;

/// Quantity of a block of data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quantity {
    /// Single-channel spectrum: light at the detector.
    Single,
    /// Absorbance.
    Absorbance,
    /// Transmittance.
    Transmittance,
    /// Emission.
    Emission,
    /// Reflectance.
    Reflectance,
    /// Another one, by its number: interferograms, phases, traces.
    Other(u8),
}

impl Quantity {
    fn of(code: u32) -> Self {
        match code {
            1 => Self::Single,
            4 => Self::Absorbance,
            5 => Self::Transmittance,
            11 => Self::Emission,
            12 => Self::Reflectance,
            other => Self::Other(other as u8),
        }
    }

    fn code(self) -> u32 {
        match self {
            Self::Single => 1,
            Self::Absorbance => 4,
            Self::Transmittance => 5,
            Self::Emission => 11,
            Self::Reflectance => 12,
            Self::Other(code) => u32::from(code),
        }
    }

    /// Returns the name of the quantity for people.
    pub fn name(self) -> String {
        match self {
            Self::Single => "single-channel spectrum".into(),
            Self::Absorbance => "absorbance".into(),
            Self::Transmittance => "transmittance".into(),
            Self::Emission => "emission".into(),
            Self::Reflectance => "reflectance".into(),
            Self::Other(code) => format!("data of kind {code}"),
        }
    }
}

/// Side of a measurement that a block of data is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The sample.
    Sample,
    /// The reference.
    Reference,
    /// Sample over reference, or not said.
    Ratio,
}

/// Unit of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Wavenumbers, cm⁻¹.
    WavenumberPerCm,
    /// Wavelengths, µm.
    WavelengthUm,
}

impl Axis {
    fn code(self) -> &'static str {
        match self {
            Self::WavenumberPerCm => "WN",
            Self::WavelengthUm => "MI",
        }
    }
}

/// A spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct OpusSpectrum {
    /// Quantity of the values.
    pub quantity: Quantity,
    /// Side of the measurement.
    pub side: Side,
    /// Unit of the axis.
    pub axis: Axis,
    /// Place of the first value.
    pub first: f64,
    /// Place of the last value.
    pub last: f64,
    /// Values, evenly from the first place to the last.
    pub value: Vec<f32>,
    /// Factor on the values (`CSF`).
    pub scale: f64,
}

impl OpusSpectrum {
    /// Returns the places on the axis.
    pub fn x(&self) -> Vec<f64> {
        let n = self.value.len();
        let step = if n > 1 { (self.last - self.first) / (n - 1) as f64 } else { 0.0 };
        (0..n)
            .map(|k| if k + 1 == n && n > 1 { self.last } else { self.first + step * k as f64 })
            .collect()
    }

    /// Returns the values times their factor.
    pub fn y(&self) -> Vec<f64> {
        self.value.iter().map(|v| f64::from(*v) * self.scale).collect()
    }

    /// Returns what the block is, for people.
    pub fn name(&self) -> String {
        match self.side {
            Side::Sample => format!("{} of the sample", self.quantity.name()),
            Side::Reference => format!("{} of the reference", self.quantity.name()),
            Side::Ratio => self.quantity.name(),
        }
    }
}

/// A file: its spectra, in the order of the directory. Interferograms and phases are left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpusFile {
    /// The spectra.
    pub spectra: Vec<OpusSpectrum>,
    /// Blocks of data that are no spectra over wavenumbers or wavelengths.
    pub others: usize,
}

/// Returns true of bytes that begin as a file of OPUS does.
pub fn is_opus(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// A block as the directory has it.
#[derive(Debug, Clone, Copy)]
struct Block {
    kind: u32,
    from: usize,
    to: usize,
}

impl Block {
    /// Which parameters; 0 of data.
    fn parameters(self) -> u32 {
        self.kind >> 4 & 0x3f
    }

    /// Kind that data and their parameters have in common.
    fn of(self) -> (u32, u32, u32, u32) {
        (self.kind & 3, self.kind >> 2 & 3, self.kind >> 10 & 0x7f, self.kind >> 17)
    }
}

/// Parameters of data in a block.
#[derive(Debug, Default)]
struct Status {
    points: Option<i32>,
    first: Option<f64>,
    last: Option<f64>,
    scale: Option<f64>,
    unit: Option<String>,
    format: Option<i32>,
}

struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
}

impl Reader<'_> {
    fn bad(&self, field: String, found: String, expected: &str) -> ParseError {
        ParseError::new(self.path, found, expected).in_field(field)
    }

    fn array<const N: usize>(&self, at: usize, field: &str) -> Result<[u8; N], ParseError> {
        let part = at.checked_add(N).and_then(|end| self.bytes.get(at..end));
        part.and_then(|part| part.try_into().ok()).ok_or_else(|| {
            let found = format!("the end of the file after {} bytes", self.bytes.len());
            self.bad(field.to_owned(), found, &format!("{N} bytes at byte {at}"))
                .with_hint("the file is cut off")
        })
    }

    fn i32(&self, at: usize, field: &str) -> Result<i32, ParseError> {
        Ok(i32::from_le_bytes(self.array(at, field)?))
    }

    fn blocks(&self) -> Result<Vec<Block>, ParseError> {
        let (at, count) = (self.i32(12, "directory")?, self.i32(20, "number of blocks")?);
        let count = usize::try_from(count).ok().filter(|n| (1..=MOST_BLOCKS).contains(n));
        let (Ok(at), Some(count)) = (usize::try_from(at), count) else {
            let found = format!("{} at byte {at}", self.i32(20, "number of blocks")?);
            let expected = format!("1 to {MOST_BLOCKS} blocks");
            return Err(self.bad("directory".into(), found, &expected));
        };
        let mut blocks = Vec::with_capacity(count);
        for k in 0..count {
            let field = format!("block {k}");
            // Places are at most those of the directory's room, which a file bounds.
            let entry = at.saturating_add(12 * k);
            let kind = u32::from_le_bytes(self.array(entry, &field)?);
            let (words, from) = (self.i32(entry + 4, &field)?, self.i32(entry + 8, &field)?);
            if from == 0 {
                break;
            }
            let size = usize::try_from(words).ok().and_then(|w| w.checked_mul(4));
            let from_to = usize::try_from(from)
                .ok()
                .and_then(|from| Some((from, from.checked_add(size?)?)))
                .filter(|(_, to)| *to <= self.bytes.len());
            let Some((from, to)) = from_to else {
                let found = format!("{words} words at byte {from}");
                let expected = format!("a block inside the {} bytes of the file", self.bytes.len());
                let error = self.bad(field, found, &expected);
                return Err(error.with_hint("the file is cut off, or its directory is wrong"));
            };
            blocks.push(Block { kind, from, to });
        }
        Ok(blocks)
    }

    fn status(&self, block: Block) -> Result<Status, ParseError> {
        let (mut found, mut at) = (Status::default(), block.from);
        while at + 8 <= block.to {
            let head: [u8; 8] = self.array(at, "parameters")?;
            let name = String::from_utf8_lossy(&head[..3]).into_owned();
            if name == "END" {
                break;
            }
            let kind = i16::from_le_bytes([head[4], head[5]]);
            let words = u16::from_le_bytes([head[6], head[7]]);
            let (from, to) = (at + 8, at + 8 + 2 * usize::from(words));
            if to > block.to {
                let found = format!("{words} words at byte {from}");
                let expected = format!("a value before the block's end at byte {}", block.to);
                return Err(self.bad(name, found, &expected));
            }
            let wrong = |expected: &str| {
                self.bad(name.clone(), format!("type {kind} of {words} words"), expected)
            };
            let whole = || match (kind, words) {
                (0, 2..) => self.i32(from, &name),
                _ => Err(wrong("a whole number")),
            };
            let real = || match (kind, words) {
                (1, 4..) => Ok(f64::from_le_bytes(self.array(from, &name)?)),
                _ => Err(wrong("a real number")),
            };
            match name.as_str() {
                "NPT" => found.points = Some(whole()?),
                "DPF" => found.format = Some(whole()?),
                "FXV" => found.first = Some(real()?),
                "LXV" => found.last = Some(real()?),
                "CSF" => found.scale = Some(real()?),
                "DXU" => {
                    let text = self.bytes[from..to].split(|b| *b == 0).next().unwrap_or_default();
                    found.unit = Some(String::from_utf8_lossy(text).into_owned());
                }
                _ => {}
            }
            at = to;
        }
        Ok(found)
    }

    /// The spectrum of a block of data; `None` where its axis is no wavelength and no wavenumber.
    fn spectrum(&self, block: Block, status: &Status) -> Result<Option<OpusSpectrum>, ParseError> {
        let (_, side, quantity, _) = block.of();
        let axis = match status.unit.as_deref() {
            Some("WN") => Axis::WavenumberPerCm,
            Some("MI") => Axis::WavelengthUm,
            _ => return Ok(None),
        };
        let points = status.points.and_then(|n| usize::try_from(n).ok());
        let there = (block.to - block.from) / 4;
        let Some(points) = points.filter(|n| (1..=there).contains(n)) else {
            let found = format!("{:?} points for {there} values", status.points);
            return Err(self.bad("NPT".into(), found, "as many values as points, or more"));
        };
        if let Some(format) = status.format.filter(|f| *f != 1) {
            let found = format!("format {format}");
            return Err(self.bad("DPF".into(), found, "1, real numbers of four bytes"));
        }
        let (first, last) = match (status.first, status.last) {
            (Some(first), Some(last)) if first.is_finite() && last.is_finite() => (first, last),
            (first, last) => {
                let found = format!("{first:?} to {last:?}");
                return Err(self.bad("FXV".into(), found, "where the axis begins and ends"));
            }
        };
        let scale = status.scale.unwrap_or(1.0);
        let part = &self.bytes[block.from..block.from + 4 * points];
        let value = part.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let side = match side {
            1 => Side::Sample,
            2 => Side::Reference,
            _ => Side::Ratio,
        };
        let quantity = Quantity::of(quantity);
        Ok(Some(OpusSpectrum { quantity, side, axis, first, last, value, scale }))
    }
}

/// Reads a file from its bytes; `path` names it in errors. Memory is at most four times the bytes.
///
/// # Errors
/// A [`ParseError`] with the block or the parameter: no file of OPUS, cut off, blocks outside the file, a parameter of another type, fewer values than points, no spectrum.
pub fn from_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<OpusFile, ParseError> {
    from_bytes_at(path.as_ref(), bytes)
}

fn from_bytes_at(path: &Path, bytes: &[u8]) -> Result<OpusFile, ParseError> {
    let reader = Reader { path, bytes };
    if !is_opus(bytes) {
        return Err(ParseError::new(path, "other first bytes", "0a 0a fe fe, as OPUS begins"));
    }
    let blocks = reader.blocks()?;
    let mut found = OpusFile::default();
    // Blocks that overlap would multiply the bytes.
    let mut held = 0;
    for (k, block) in blocks.iter().enumerate() {
        let (_, _, quantity, _) = block.of();
        // Data of a quantity; its directory and texts have none, and amplitudes of interferograms and phases are no spectra.
        if block.parameters() != 0 || quantity == 0 || quantity == 13 {
            continue;
        }
        held += block.to - block.from;
        if held > bytes.len() {
            let found = "blocks of data that overlap".to_owned();
            return Err(reader.bad("directory".into(), found, "a place for each block"));
        }
        // Of several blocks of a kind each has the parameters at its own place among those.
        let alike = |b: &&Block| b.parameters() == 0 && b.of() == block.of();
        let before = blocks[..k].iter().filter(alike).count();
        let mut statuses =
            blocks.iter().filter(|b| b.parameters() == DATA_STATUS && b.of() == block.of());
        let status = statuses.nth(before);
        let status = status.map(|status| reader.status(*status)).transpose()?;
        let spectrum = match status {
            Some(status) if !matches!(quantity, 2 | 3 | 8) => reader.spectrum(*block, &status)?,
            _ => None,
        };
        match spectrum {
            Some(spectrum) => found.spectra.push(spectrum),
            None => found.others += 1,
        }
    }
    if found.spectra.is_empty() {
        let seen = format!("{} blocks of data, none a spectrum", found.others);
        let error = ParseError::new(path, seen, "a spectrum over wavenumbers or wavelengths");
        return Err(
            error.with_hint("interferograms and phases are no spectra: transform them in OPUS")
        );
    }
    Ok(found)
}

/// Writes the spectra as [`from_bytes`] reads them: for tests, and for programs that take OPUS files only.
pub fn to_bytes(file: &OpusFile) -> Vec<u8> {
    const HEADER: usize = 24;
    let directory = HEADER;
    let count = 2 * file.spectra.len();
    let mut data: Vec<u8> = Vec::new();
    let begin = directory + 12 * (count + 1);
    let mut entries: Vec<(u32, usize, usize)> = Vec::new();
    for spectrum in &file.spectra {
        let side = match spectrum.side {
            Side::Sample => 1,
            Side::Reference => 2,
            Side::Ratio => 3,
        };
        let kind = 3 | side << 2 | spectrum.quantity.code() << 10;
        let values: Vec<u8> = spectrum.value.iter().flat_map(|v| v.to_le_bytes()).collect();
        entries.push((kind, values.len() / 4, begin + data.len()));
        data.extend(values);
        let mut status: Vec<u8> = Vec::new();
        let mut put = |name: &str, kind: i16, value: &[u8]| {
            status.extend(name.as_bytes());
            status.push(0);
            status.extend(kind.to_le_bytes());
            status.extend(((value.len() / 2) as i16).to_le_bytes());
            status.extend(value);
        };
        put("DPF", 0, &1_i32.to_le_bytes());
        put("NPT", 0, &(spectrum.value.len() as i32).to_le_bytes());
        put("FXV", 1, &spectrum.first.to_le_bytes());
        put("LXV", 1, &spectrum.last.to_le_bytes());
        put("CSF", 1, &spectrum.scale.to_le_bytes());
        let mut unit = spectrum.axis.code().as_bytes().to_vec();
        unit.resize(4, 0);
        put("DXU", 3, &unit);
        put("END", 0, &[]);
        entries.push((kind | DATA_STATUS << 4, status.len() / 4, begin + data.len()));
        data.extend(status);
    }
    let mut out = MAGIC.to_vec();
    out.extend(920_622.0_f64.to_le_bytes());
    for number in [directory, count + 1, count] {
        out.extend((number as i32).to_le_bytes());
    }
    for (kind, words, at) in entries {
        out.extend(kind.to_le_bytes());
        out.extend((words as i32).to_le_bytes());
        out.extend((at as i32).to_le_bytes());
    }
    out.resize(begin, 0);
    out.extend(data);
    out
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure should stop the run")]
    use super::*;

    fn spectrum(quantity: Quantity, side: Side) -> OpusSpectrum {
        let value = (0..5).map(|k| 0.5 + k as f32).collect();
        let axis = Axis::WavenumberPerCm;
        OpusSpectrum { quantity, side, axis, first: 12_000.0, last: 4_000.0, value, scale: 2.0 }
    }

    /// Truth: what went in, and the places by hand: 12,000 to 4,000 cm⁻¹ in steps of 2,000, values twice what is stored.
    #[test]
    fn spectra_come_back() {
        let file = OpusFile {
            spectra: vec![
                spectrum(Quantity::Single, Side::Sample),
                spectrum(Quantity::Reflectance, Side::Ratio),
            ],
            others: 0,
        };
        let bytes = to_bytes(&file);
        let read = from_bytes("x", &bytes).unwrap();
        assert_eq!(read, file);
        assert_eq!(read.spectra[0].x(), [12_000.0, 10_000.0, 8_000.0, 6_000.0, 4_000.0]);
        assert_eq!(read.spectra[0].y(), [1.0, 3.0, 5.0, 7.0, 9.0]);
        assert_eq!(read.spectra[0].name(), "single-channel spectrum of the sample");
    }

    /// Truth: the same bytes, spoilt at places that the layout names.
    #[test]
    fn what_is_spoilt_is_refused() {
        let spectra = vec![spectrum(Quantity::Single, Side::Sample)];
        let good = to_bytes(&OpusFile { spectra, others: 0 });
        let spoil = |at: usize, with: &[u8]| {
            let mut bytes = good.clone();
            bytes[at..at + with.len()].copy_from_slice(with);
            from_bytes("x", &bytes).unwrap_err().to_string()
        };
        let cut = from_bytes("x", &good[..good.len() - 30]).unwrap_err().to_string();
        assert!(cut.contains("cut off"), "{cut}");
        for (at, with, said) in [
            (0, &[0_u8, 0][..], "OPUS begins"),
            (20, &(-1_i32).to_le_bytes()[..], "blocks"),
            (28, &1_000_000_i32.to_le_bytes()[..], "inside the"),
            (24 + 1, &[8_u8][..], "none a spectrum"),
        ] {
            let error = spoil(at, with);
            assert!(error.contains(said), "{at}: {error}");
        }
        let at = good.windows(3).position(|w| w == b"NPT").unwrap();
        let error = spoil(at + 8, &6_i32.to_le_bytes());
        assert!(error.contains("NPT") && error.contains("5 values"), "{error}");
        let error = spoil(at + 4, &[1, 0]);
        assert!(error.contains("a whole number"), "{error}");
    }
}
