//! Data of VOTables as BINARY and BINARY2 (VOTable 1.4, sections 5.3 and 5.4): rows of big-endian values in base64.

use crate::Values;

/// One column as its FIELD describes it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form<'a> {
    pub(super) name: &'a str,
    /// The attribute `datatype`.
    pub(super) kind: &'a str,
    /// The attribute `arraysize`.
    pub(super) array: Option<&'a str>,
    /// The value that says nothing.
    pub(super) null: Option<&'a str>,
}

/// The words found and those expected.
type Fault = (String, String);

/// Number of elements of a cell.
#[derive(Clone, Copy, PartialEq)]
enum Size {
    One,
    Fixed(usize),
    /// A count of four bytes stands before the elements.
    Counted,
}

struct Layout<'a> {
    form: Form<'a>,
    size: Size,
    /// Bits of an element.
    bits: usize,
}

impl<'a> Layout<'a> {
    fn of(form: Form<'a>) -> Result<Self, Fault> {
        let wrong =
            |found: &str, expected: &str| (format!("{}: {found}", form.name), expected.to_owned());
        let bits = match form.kind {
            "bit" => 1,
            "boolean" | "unsignedByte" | "char" => 8,
            "short" | "unicodeChar" => 16,
            "int" | "float" => 32,
            "long" | "double" | "floatComplex" => 64,
            "doubleComplex" => 128,
            other => {
                return Err(wrong(&format!("datatype `{other}`"), "a datatype of VOTable 1.4"));
            }
        };
        let size = match form.array.map(str::trim) {
            None | Some("") => Size::One,
            Some(array) if array.ends_with('*') => Size::Counted,
            Some(array) => {
                let mut product = 1_usize;
                for length in array.split('x') {
                    let length = length.trim().parse::<usize>().ok();
                    let more = length.and_then(|l| product.checked_mul(l));
                    product = more.filter(|p| *p < 1 << 30).ok_or_else(|| {
                        wrong(&format!("arraysize `{array}`"), "lengths such as `3x2` or `*`")
                    })?;
                }
                Size::Fixed(product)
            }
        };
        Ok(Self { form, size, bits })
    }

    /// The bytes of a cell at the beginning of `rest`, which then begins after them.
    fn cell<'b>(&self, rest: &mut &'b [u8]) -> Option<&'b [u8]> {
        let count = match self.size {
            Size::One => 1,
            Size::Fixed(count) => count,
            Size::Counted => {
                let (count, after) = rest.split_first_chunk::<4>()?;
                *rest = after;
                u32::from_be_bytes(*count) as usize
            }
        };
        let length = count.checked_mul(self.bits)?.div_ceil(8);
        let (cell, after) = rest.split_at_checked(length)?;
        *rest = after;
        Some(cell)
    }
}

/// Values of a column as they are gathered.
enum Gathered {
    Numbers(Vec<f64>),
    Whole(Vec<Option<i64>>),
    Truth(Vec<Option<bool>>),
    Texts(Vec<Option<String>>),
}

impl Gathered {
    fn of(layout: &Layout<'_>) -> Self {
        match (layout.form.kind, layout.size) {
            ("boolean" | "bit", Size::One) => Self::Truth(Vec::new()),
            ("long", Size::One) => Self::Whole(Vec::new()),
            ("unsignedByte" | "short" | "int" | "float" | "double", Size::One) => {
                Self::Numbers(Vec::new())
            }
            _ => Self::Texts(Vec::new()),
        }
    }

    fn push(&mut self, form: &Form<'_>, cell: &[u8], is_null: bool) {
        let whole = || match *cell {
            [a] => Some(i64::from(a)),
            [a, b] => Some(i64::from(i16::from_be_bytes([a, b]))),
            [a, b, c, d] => Some(i64::from(i32::from_be_bytes([a, b, c, d]))),
            _ => cell.try_into().ok().map(i64::from_be_bytes),
        };
        let stated = |n: i64| form.null.and_then(|t| t.trim().parse::<i64>().ok()) == Some(n);
        let known = || whole().filter(|n| !is_null && !stated(*n));
        match self {
            Self::Truth(values) => values.push(match cell.first() {
                _ if is_null => None,
                // Writers do not agree which bit of the byte a single one is.
                Some(byte) if form.kind == "bit" => Some(*byte != 0),
                Some(b'T' | b't' | b'1') => Some(true),
                Some(b'F' | b'f' | b'0') => Some(false),
                _ => None,
            }),
            Self::Whole(values) => values.push(known()),
            Self::Numbers(values) => values.push(match (form.kind, cell) {
                _ if is_null => f64::NAN,
                ("float", &[a, b, c, d]) => f64::from(f32::from_be_bytes([a, b, c, d])),
                ("double", _) => cell.try_into().map_or(f64::NAN, f64::from_be_bytes),
                _ => known().map_or(f64::NAN, |n| n as f64),
            }),
            Self::Texts(values) => {
                let text = match form.kind {
                    "char" => Some(String::from_utf8_lossy(cell).into_owned()),
                    "unicodeChar" => {
                        let units = cell.as_chunks::<2>().0.iter().map(|c| u16::from_be_bytes(*c));
                        Some(char::decode_utf16(units).map(|c| c.unwrap_or('\u{fffd}')).collect())
                    }
                    // Arrays of numbers are no column of a light curve.
                    _ => None,
                };
                let text = text.map(|t| t.trim_end_matches(['\0', ' ']).to_owned());
                values.push(text.filter(|t| !is_null && !t.is_empty()));
            }
        }
    }

    fn values(self) -> Values {
        match self {
            Self::Numbers(v) => Values::F64(v),
            Self::Whole(v) => Values::I64(v),
            Self::Truth(v) => Values::Bool(v),
            Self::Texts(v) => Values::Text(v),
        }
    }
}

/// Values of each column. With `has_mask` (BINARY2) a row begins with one bit a column that says whether its value is missing.
pub(super) fn decode(
    forms: &[Form<'_>],
    base64: &str,
    has_mask: bool,
) -> Result<Vec<Values>, Fault> {
    let layouts = forms.iter().map(|f| Layout::of(*f)).collect::<Result<Vec<_>, _>>()?;
    let bytes = of_base64(base64)?;
    let mut gathered: Vec<Gathered> = layouts.iter().map(Gathered::of).collect();
    let mask_bytes = if has_mask { layouts.len().div_ceil(8) } else { 0 };
    let mut rest = bytes.as_slice();
    let mut row = 0_u64;
    while !rest.is_empty() {
        row += 1;
        let left = rest.len();
        let short = |name: &str| {
            (format!("row {row} ends within {name}"), "whole rows of all columns".to_owned())
        };
        let Some((mask, after)) = rest.split_at_checked(mask_bytes) else {
            return Err(short("its mask"));
        };
        rest = after;
        for (i, (layout, column)) in layouts.iter().zip(&mut gathered).enumerate() {
            let cell = layout.cell(&mut rest).ok_or_else(|| short(layout.form.name))?;
            let is_null = mask.get(i / 8).is_some_and(|byte| byte & (0x80 >> (i % 8)) != 0);
            column.push(&layout.form, cell, is_null);
        }
        if rest.len() == left {
            return Err(("rows of no bytes".into(), "columns that hold something".into()));
        }
    }
    Ok(gathered.into_iter().map(Gathered::values).collect())
}

/// Bytes of a text in base64 (RFC 4648), white space aside.
fn of_base64(text: &str) -> Result<Vec<u8>, Fault> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut held, mut bits, mut is_over) = (0_u32, 0, false);
    for c in text.bytes().filter(|c| !c.is_ascii_whitespace()) {
        let six = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                is_over = true;
                continue;
            }
            _ => 64,
        };
        if six == 64 || is_over {
            let found = format!("`{}` in base64", char::from(c).escape_default());
            return Err((found, "letters of base64".into()));
        }
        held = held << 6 | u32::from(six);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            bytes.push((held >> bits & 0xff) as u8);
        }
    }
    Ok(bytes)
}
