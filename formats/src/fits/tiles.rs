//! Tile-compressed images (FITS 4.0, section 10): RICE_1, GZIP_1, GZIP_2, PLIO_1 and NOCOMPRESS, floating-point numbers with or without dither.

use super::card::CardValue;
use super::file::{Fits, Hdu};
use super::header::Header;
use super::image::{Image, Stored};
use crate::error::ParseError;
use std::io::Read as _;

/// Random numbers of the dither (section 10.2, appendix I).
const RANDOM_NUMBERS: usize = 10_000;
/// Values of quantised pixels that mean nothing, and exactly 0 (SUBTRACTIVE_DITHER_2).
const NOTHING: i64 = -2_147_483_647;
const ZERO: i64 = -2_147_483_646;

#[derive(Clone, Copy, PartialEq)]
enum Method {
    Rice { block: usize, bytes: usize },
    Gzip,
    GzipShuffled,
    Plio,
    Plain,
}

#[derive(Clone, Copy, PartialEq)]
enum Dither {
    No,
    One,
    Two,
}

/// One column: where it stands in a row, and its letter with that of the heap's values.
#[derive(Clone, Copy)]
struct Column {
    offset: usize,
    letter: u8,
    /// Bytes of one value in the heap.
    heap_bytes: usize,
}

impl Column {
    fn width(self) -> usize {
        match self.letter {
            b'Q' => 16,
            b'P' | b'D' | b'K' => 8,
            b'J' | b'E' => 4,
            b'I' => 2,
            _ => 1,
        }
    }
}

/// The columns of all tiles, by their names.
struct Table<'a> {
    columns: Vec<(String, Column)>,
    row_bytes: usize,
    data: &'a [u8],
    heap: &'a [u8],
}

impl<'a> Table<'a> {
    fn of(fits: &'a Fits, hdu: &Hdu) -> Result<Self, ParseError> {
        let [row_bytes, rows] = fits.axes(hdu)?[..] else {
            return Err(fits.bad(hdu, "NAXIS", "another number of axes", "2"));
        };
        let header = hdu.header();
        let mut columns = Vec::new();
        let mut offset = 0;
        for number in 1..=fits.count(hdu, "TFIELDS")?.min(999) {
            let keyword = format!("TFORM{number}");
            let form = header.text(&keyword).unwrap_or_default();
            let digits = form.len() - form.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let repeat = if digits == 0 { Some(1) } else { form[..digits].parse::<usize>().ok() };
            let (Some(repeat), Some(letter)) = (repeat, form.as_bytes().get(digits)) else {
                return Err(fits.bad(hdu, &keyword, form, "a format such as `1PB`"));
            };
            let heap_bytes = match form.as_bytes().get(digits + 1) {
                Some(b'I') => 2,
                Some(b'J' | b'E') => 4,
                Some(b'K' | b'D') => 8,
                _ => 1,
            };
            let column = Column { offset, letter: *letter, heap_bytes };
            let after = repeat.checked_mul(column.width()).and_then(|w| w.checked_add(offset));
            let Some(after) = after.filter(|end| *end as u64 <= row_bytes) else {
                return Err(fits.bad(
                    hdu,
                    &keyword,
                    "columns wider than the row",
                    "as NAXIS1 says",
                ));
            };
            offset = after;
            if repeat > 0 {
                let name = header.text(&format!("TTYPE{number}")).unwrap_or_default();
                columns.push((name.to_ascii_uppercase(), column));
            }
        }
        let data = fits.data(hdu);
        let main = usize::try_from(row_bytes.saturating_mul(rows)).unwrap_or(usize::MAX);
        let start = match header.get("THEAP") {
            Some(_) => usize::try_from(fits.count(hdu, "THEAP")?).unwrap_or(usize::MAX),
            None => main,
        };
        let (Some(rows), Some(heap)) = (data.get(..main), data.get(start..)) else {
            return Err(fits.bad(hdu, "THEAP", "a heap beyond the data", "one within them"));
        };
        Ok(Self { columns, row_bytes: row_bytes as usize, data: rows, heap })
    }

    fn has(&self, name: &str) -> bool {
        self.column(name).is_some()
    }

    fn column(&self, name: &str) -> Option<Column> {
        self.columns.iter().find(|(n, _)| n == name).map(|(_, column)| *column)
    }

    fn cell(&self, row: usize, name: &str) -> Option<(u8, &'a [u8])> {
        let column = self.column(name)?;
        let start = row.checked_mul(self.row_bytes)?.checked_add(column.offset)?;
        Some((column.letter, self.data.get(start..start + column.width())?))
    }

    /// Bytes of the heap; nothing where the column is not there or its list is empty. `None` where they lie outside.
    fn list(&self, row: usize, name: &str) -> Option<&'a [u8]> {
        let (count, at) = match self.cell(row, name) {
            None => return Some(&[]),
            Some((b'P', cell)) => {
                let (count, at) = cell.split_first_chunk::<4>()?;
                let at = at.first_chunk::<4>()?;
                (u64::from(u32::from_be_bytes(*count)), u64::from(u32::from_be_bytes(*at)))
            }
            Some((b'Q', cell)) => {
                let (count, at) = cell.split_first_chunk::<8>()?;
                (u64::from_be_bytes(*count), u64::from_be_bytes(*at.first_chunk::<8>()?))
            }
            Some(_) => return None,
        };
        let (count, at) = (usize::try_from(count).ok()?, usize::try_from(at).ok()?);
        let count = count.checked_mul(self.column(name)?.heap_bytes)?;
        if count == 0 { Some(&[]) } else { self.heap.get(at..at.checked_add(count)?) }
    }

    fn number(&self, row: usize, name: &str) -> Option<f64> {
        let (letter, cell) = self.cell(row, name)?;
        match letter {
            b'D' => Some(f64::from_be_bytes(cell.try_into().ok()?)),
            b'E' => Some(f64::from(f32::from_be_bytes(cell.try_into().ok()?))),
            _ => whole(cell).map(|n| n as f64),
        }
    }
}

fn whole(cell: &[u8]) -> Option<i64> {
    Some(match *cell {
        [a] => i64::from(a),
        [a, b] => i64::from(i16::from_be_bytes([a, b])),
        [a, b, c, d] => i64::from(i32::from_be_bytes([a, b, c, d])),
        _ => i64::from_be_bytes(cell.try_into().ok()?),
    })
}

/// An image out of its tiles.
pub(super) fn decode(fits: &Fits, hdu: &Hdu) -> Result<Image, ParseError> {
    let header = hdu.header();
    let method = method(fits, hdu)?;
    let bitpix = fits.integer(hdu, "ZBITPIX")?;
    if ![8, 16, 32, 64, -32, -64].contains(&bitpix) {
        return Err(fits.bad(hdu, "ZBITPIX", bitpix.to_string(), "8, 16, 32, 64, -32 or -64"));
    }
    let bytes = (bitpix.unsigned_abs() / 8) as usize;
    let count = fits.integer(hdu, "ZNAXIS")?;
    if !(1..=9).contains(&count) {
        return Err(fits.bad(hdu, "ZNAXIS", count.to_string(), "1 to 9 axes"));
    }
    let (mut lengths, mut tile) = (Vec::new(), Vec::new());
    for i in 1..=count {
        let length = fits.count(hdu, &format!("ZNAXIS{i}"))? as usize;
        let keyword = format!("ZTILE{i}");
        let side = match (header.get(&keyword), i) {
            (Some(_), _) => fits.count(hdu, &keyword)? as usize,
            (None, 1) => length,
            (None, _) => 1,
        };
        if side == 0 {
            return Err(fits.bad(hdu, &keyword, "0", "a length above 0"));
        }
        lengths.push(length);
        tile.push(side.min(length.max(1)));
    }
    // A small file claims no more memory than it may have.
    let most = (64_usize << 20).max(fits.data(hdu).len().saturating_mul(256));
    let pixels = lengths.iter().try_fold(1_usize, |p, n| p.checked_mul(*n));
    let Some(pixels) = pixels.filter(|p| p.checked_mul(bytes).is_some_and(|b| b <= most)) else {
        let found = format!("axes of {lengths:?}");
        return Err(fits.bad(hdu, "ZNAXIS1", found, format!("an image of at most {most} bytes")));
    };
    let table = Table::of(fits, hdu)?;
    if table.has("NULL_PIXEL_MASK") {
        return Err(fits.bad(hdu, "TTYPE1", "NULL_PIXEL_MASK", "blanks as NaN or ZBLANK"));
    }
    let dither = match header.text("ZQUANTIZ").map(str::trim) {
        Some("SUBTRACTIVE_DITHER_1") => Dither::One,
        Some("SUBTRACTIVE_DITHER_2") => Dither::Two,
        _ => Dither::No,
    };
    let random = if dither == Dither::No { Vec::new() } else { random_numbers() };
    let seed = header.integer("ZDITHER0").unwrap_or(1).max(1) as usize;
    let mut out = vec![0_u8; pixels * bytes];
    let tiles: Vec<usize> = lengths.iter().zip(&tile).map(|(n, t)| n.div_ceil(*t)).collect();
    let strides: Vec<usize> =
        lengths.iter().scan(1, |s, n| Some(std::mem::replace(s, *s * n))).collect();
    for row in 0..tiles.iter().product() {
        let wrong = |found: &str, expected: &str| {
            ParseError::new(fits.path(), found, expected).in_field(format!(
                "HDU {}, tile {}",
                hdu.index,
                row + 1
            ))
        };
        // Where the tile begins, and how far it reaches.
        let (mut rest, mut begin, mut size) = (row, Vec::new(), Vec::new());
        for i in 0..lengths.len() {
            begin.push(rest % tiles[i] * tile[i]);
            rest /= tiles[i];
            size.push(tile[i].min(lengths[i] - begin[i]));
        }
        let wanted: usize = size.iter().product();
        let outside = || wrong("a list outside the heap", "compressed bytes");
        let packed = table.list(row, "COMPRESSED_DATA").ok_or_else(outside)?;
        let scale = table.number(row, "ZSCALE").or_else(|| header.get("ZSCALE")?.real());
        let zero = table.number(row, "ZZERO").or_else(|| header.get("ZZERO")?.real());
        let broken = || wrong("bytes that cannot be unpacked", "a tile's pixels");
        let filled: Vec<u8> = if packed.is_empty() {
            let packed = table.list(row, "GZIP_COMPRESSED_DATA").ok_or_else(outside)?;
            if packed.is_empty() {
                // The descriptor counts values, and the bytes of each follow from the pixels.
                return Err(wrong(
                    "no compressed data",
                    "a tile's pixels (raw tiles are not read)",
                ));
            }
            inflated(packed, wanted * bytes)
                .filter(|b| b.len() == wanted * bytes)
                .ok_or_else(broken)?
        } else {
            let is_quantised = bitpix < 0 && scale.is_some();
            match (method, is_quantised) {
                (Method::Rice { .. } | Method::Plio, false) if bitpix < 0 => return Err(broken()),
                (Method::Plain, false) => {
                    if packed.len() != wanted * bytes {
                        return Err(broken());
                    }
                    packed.to_vec()
                }
                (Method::Gzip | Method::GzipShuffled, false) => {
                    // CFITSIO packs whole numbers of 16 bits as such, or as 32 bits.
                    let raw = inflated(packed, wanted.saturating_mul(8)).ok_or_else(broken)?;
                    let width = raw.len() / wanted.max(1);
                    let is_known = width == bytes || (bitpix > 0 && width == 4 && bytes < 4);
                    if !is_known || width * wanted != raw.len() {
                        return Err(broken());
                    }
                    let raw = if method == Method::Gzip { raw } else { in_order(&raw, width) };
                    if width == bytes {
                        raw
                    } else {
                        raw.chunks_exact(width).flat_map(|v| v[width - bytes..].to_vec()).collect()
                    }
                }
                _ => {
                    let values = match method {
                        Method::Rice { block, bytes } => rice(packed, wanted, block, bytes),
                        Method::Plio => plio(packed, wanted),
                        Method::Plain => (packed.len() == wanted * 4)
                            .then(|| packed.chunks_exact(4).filter_map(whole).collect()),
                        _ => inflated(packed, wanted * 4).filter(|b| b.len() == wanted * 4).map(
                            |raw| {
                                let raw =
                                    if method == Method::Gzip { raw } else { in_order(&raw, 4) };
                                raw.chunks_exact(4).filter_map(whole).collect()
                            },
                        ),
                    };
                    let values =
                        values.filter(|v: &Vec<i64>| v.len() == wanted).ok_or_else(broken)?;
                    if is_quantised {
                        let blank = table
                            .number(row, "ZBLANK")
                            .or_else(|| header.get("ZBLANK")?.real())
                            .map_or(NOTHING, |b| b as i64);
                        let steps = Steps {
                            scale: scale.unwrap_or(1.0),
                            zero: zero.unwrap_or(0.0),
                            blank,
                            dither,
                        };
                        let numbers = steps.numbers(&values, &random, row + seed - 1);
                        let mut filled = Vec::with_capacity(wanted * bytes);
                        for number in numbers {
                            if bytes == 4 {
                                filled.extend((number as f32).to_be_bytes());
                            } else {
                                filled.extend(number.to_be_bytes());
                            }
                        }
                        filled
                    } else {
                        values.iter().flat_map(|v| v.to_be_bytes()[8 - bytes..].to_vec()).collect()
                    }
                }
            }
        };
        for (line, part) in filled.chunks_exact((size[0] * bytes).max(1)).enumerate() {
            let (mut rest, mut at) = (line, begin[0]);
            for i in 1..lengths.len() {
                at += (begin[i] + rest % size[i]) * strides[i];
                rest /= size[i];
            }
            let place = at * bytes..at * bytes + part.len();
            let Some(place) = out.get_mut(place) else { return Err(broken()) };
            place.copy_from_slice(part);
        }
    }
    lengths.reverse();
    let blank =
        ["BLANK", "ZBLANK"].iter().find_map(|key| header.integer(key)).filter(|_| bitpix > 0);
    let scale = fits.real_or(hdu, "BSCALE", 1.0)?;
    let zero = fits.real_or(hdu, "BZERO", 0.0)?;
    let stored = Stored { bitpix, scale, zero, blank, shape: lengths };
    let pixels = stored.pixels(&out).ok_or_else(|| {
        fits.bad(hdu, "ZNAXIS", "axes whose product is beyond 64 bits", "a smaller image")
    })?;
    Ok(Image { header: without_tiles(&header.without_structure()), pixels })
}

/// The cards that a person wrote: those of the compression are gone.
fn without_tiles(header: &Header) -> Header {
    const WHOLE: [&str; 15] = [
        "ZIMAGE", "ZCMPTYPE", "ZBITPIX", "ZNAXIS", "ZQUANTIZ", "ZDITHER0", "ZTENSION", "ZSIMPLE",
        "ZEXTEND", "ZPCOUNT", "ZGCOUNT", "ZHECKSUM", "ZDATASUM", "ZMASKCMP", "ZBLANK",
    ];
    let of_tiles = |keyword: &str| {
        let numbered = ["ZNAXIS", "ZTILE", "ZNAME", "ZVAL"].iter().any(|stem| {
            let rest = keyword.strip_prefix(stem);
            rest.is_some_and(|r| !r.is_empty() && r.bytes().all(|b| b.is_ascii_digit()))
        });
        numbered || WHOLE.contains(&keyword)
    };
    let is_name =
        |value: &CardValue| matches!(value, CardValue::Text(t) if t == "COMPRESSED_IMAGE");
    let keep = |c: &&super::card::Card| {
        !(of_tiles(&c.keyword) || c.keyword == "EXTNAME" && is_name(&c.value))
    };
    Header { cards: header.cards.iter().filter(keep).cloned().collect() }
}

fn method(fits: &Fits, hdu: &Hdu) -> Result<Method, ParseError> {
    let header = hdu.header();
    let parameter = |name: &str| {
        (1..=9).find_map(|i| {
            let named = header.text(&format!("ZNAME{i}"))?.trim() == name;
            named.then(|| header.integer(&format!("ZVAL{i}")))?
        })
    };
    Ok(match header.text("ZCMPTYPE").map_or("", str::trim) {
        "RICE_1" | "RICE_ONE" => {
            let block = parameter("BLOCKSIZE").unwrap_or(32);
            let bytes = parameter("BYTEPIX").unwrap_or(4);
            if !(1..=1 << 20).contains(&block) || ![1, 2, 4].contains(&bytes) {
                let found = format!("blocks of {block}, {bytes} bytes a pixel");
                return Err(fits.bad(hdu, "ZVAL1", found, "blocks of 16 or 32, 1, 2 or 4 bytes"));
            }
            Method::Rice { block: block as usize, bytes: bytes as usize }
        }
        "GZIP_1" => Method::Gzip,
        "GZIP_2" => Method::GzipShuffled,
        "PLIO_1" => Method::Plio,
        "NOCOMPRESS" => Method::Plain,
        other => {
            let expected = "RICE_1, GZIP_1, GZIP_2, PLIO_1 or NOCOMPRESS";
            let error = fits.bad(hdu, "ZCMPTYPE", other, expected);
            return Err(error.with_hint("unpack it with funpack, or let the camera use RICE_1"));
        }
    })
}

fn inflated(packed: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut reader = flate2::read::MultiGzDecoder::new(packed).take(most as u64 + 1);
    reader.read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

/// GZIP_2 has the first bytes of all values first, then the second ones.
fn in_order(shuffled: &[u8], width: usize) -> Vec<u8> {
    let count = shuffled.len() / width;
    (0..count * width).map(|i| shuffled[i % width * count + i / width]).collect()
}

/// Bits of a stream, the highest of each byte first.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bits<'_> {
    fn bit(&mut self) -> Option<u64> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(u64::from(bit))
    }

    fn take(&mut self, mut count: u32) -> Option<u64> {
        let mut value = 0;
        while count > 0 {
            let byte = u64::from(*self.bytes.get(self.at / 8)?);
            let left = 8 - (self.at % 8) as u32;
            let n = left.min(count);
            let part = byte >> (left - n) & ((1 << n) - 1);
            value = value << n | part;
            self.at += n as usize;
            count -= n;
        }
        Some(value)
    }

    fn zeros(&mut self) -> Option<u64> {
        let mut zeros = 0;
        while self.bit()? == 0 {
            zeros += 1;
        }
        Some(zeros)
    }
}

/// Rice's code (section 10.4.1): differences of neighbours in blocks, each with its number of plain bits.
fn rice(packed: &[u8], wanted: usize, block: usize, bytes: usize) -> Option<Vec<i64>> {
    let (split_bits, raw_split) = match bytes {
        1 => (3, 6),
        2 => (4, 14),
        _ => (5, 25),
    };
    let width = 8 * bytes as u32;
    let mask = (1_u64 << width) - 1;
    let mut bits = Bits { bytes: packed, at: 0 };
    let mut last = bits.take(width)?;
    let mut values = Vec::with_capacity(wanted);
    while values.len() < wanted {
        let split = bits.take(split_bits)? as i64 - 1;
        for _ in 0..block.min(wanted - values.len()) {
            let folded = match split {
                -1 => 0,
                s if s == raw_split => bits.take(width)?,
                s => {
                    let high = bits.zeros()?;
                    high << s | bits.take(s as u32)?
                }
            };
            let difference = if folded & 1 == 1 { !(folded >> 1) } else { folded >> 1 };
            last = last.wrapping_add(difference) & mask;
            values.push(match bytes {
                1 => last as i64,
                2 => i64::from(last as u16 as i16),
                _ => i64::from(last as u32 as i32),
            });
        }
    }
    Some(values)
}

/// IRAF's lists of pixels (section 10.4.3): runs of 0 and of one value that goes up and down, in words of 16 bits.
fn plio(packed: &[u8], wanted: usize) -> Option<Vec<i64>> {
    let words: Vec<i64> =
        packed.as_chunks::<2>().0.iter().map(|w| i64::from(i16::from_be_bytes(*w))).collect();
    // Lists of old have a head of three words, with their length in the third.
    let (length, first) = match *words.get(2)? {
        length if length > 0 => (length, 3),
        _ => ((*words.get(4)? << 15) + *words.get(3)?, *words.get(1)?),
    };
    let (length, first) = (usize::try_from(length).ok()?, usize::try_from(first).ok()?);
    let list = words.get(first..length.max(first))?;
    let mut values: Vec<i64> = Vec::with_capacity(wanted);
    let mut high = 1_i64;
    let mut at = 0;
    while let Some(word) = list.get(at) {
        at += 1;
        // The words hold four bits of an instruction and twelve of a number.
        let (code, number) = (*word >> 12, *word & 4095);
        let run = usize::try_from(number).ok()?.min(wanted.saturating_sub(values.len()));
        match code {
            0 => values.resize(values.len() + run, 0),
            4 => values.resize(values.len() + run, high),
            5 => {
                values.resize(values.len() + run, 0);
                if let Some(last) = values.last_mut().filter(|_| run > 0) {
                    *last = high;
                }
            }
            1 => {
                high = (*list.get(at)? << 12) + number;
                at += 1;
            }
            2 | 6 => high = high.checked_add(number)?,
            3 | 7 => high = high.checked_sub(number)?,
            _ => return None,
        }
        if matches!(code, 6 | 7) && values.len() < wanted {
            values.push(high);
        }
    }
    values.resize(wanted, 0);
    Some(values)
}

fn random_numbers() -> Vec<f32> {
    let mut seed = 1_u64;
    let mut next = || {
        seed = seed * 16_807 % 2_147_483_647;
        (seed as f64 / 2_147_483_647.0) as f32
    };
    (0..RANDOM_NUMBERS).map(|_| next()).collect()
}

/// Steps that floating-point numbers were rounded to.
struct Steps {
    scale: f64,
    zero: f64,
    blank: i64,
    dither: Dither,
}

impl Steps {
    /// Numbers of a tile; `row` is its own number plus the seed's, from 0.
    fn numbers(&self, values: &[i64], random: &[f32], row: usize) -> Vec<f64> {
        let mut seed = row % RANDOM_NUMBERS;
        let begin = |seed: usize| random.get(seed).map_or(0, |r| (r * 500.0) as usize);
        let mut next = begin(seed);
        let mut numbers = Vec::with_capacity(values.len());
        for &value in values {
            let shift = match self.dither {
                Dither::No => 0.0,
                _ => f64::from(random[next]) - 0.5,
            };
            numbers.push(match value {
                v if v == self.blank => f64::NAN,
                ZERO if self.dither == Dither::Two => 0.0,
                v => (v as f64 - shift) * self.scale + self.zero,
            });
            next += 1;
            if next == RANDOM_NUMBERS {
                seed = (seed + 1) % RANDOM_NUMBERS;
                next = begin(seed);
            }
        }
        numbers
    }
}
