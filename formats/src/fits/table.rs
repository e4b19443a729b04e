//! Binary tables in.

use super::card::CardValue;
use super::file::{Fits, Hdu};
use super::header::Header;
use crate::error::{ParseError, excerpt};
use crate::table::{Column, Meta, Table, Values};
use serde_json::Value;

/// One column as the header describes it.
struct Field {
    name: String,
    /// Number of the column, from 1.
    number: u64,
    letter: char,
    /// Values of a row; characters for text.
    repeat: usize,
    /// First byte in the row.
    offset: usize,
    scale: f64,
    zero: f64,
    null: Option<i64>,
    /// Characters of one text, if TDIM makes an array of texts.
    text_width: Option<usize>,
}

pub(super) fn decode(fits: &Fits, hdu: &Hdu) -> Result<Table, ParseError> {
    let [row_bytes, rows] = fits.axes(hdu)?[..] else {
        return Err(fits.bad(hdu, "NAXIS", "another number of axes", "2 (bytes of a row, rows)"));
    };
    if fits.integer(hdu, "BITPIX")? != 8 {
        return Err(fits.bad(hdu, "BITPIX", "another number", "8"));
    }
    // Rows of no bytes could be any number, at no cost to the one who says so.
    if row_bytes == 0 && rows > 0 {
        return Err(fits.bad(hdu, "NAXIS1", "rows of 0 bytes", "at least one byte"));
    }
    let (row_bytes, rows) = (row_bytes as usize, rows as usize);
    let fields = fields(fits, hdu, row_bytes)?;
    // With GCOUNT 0 there are none, whatever the axes say.
    let Some(data) = fits.data(hdu).get(..row_bytes * rows) else {
        return Err(fits.bad(hdu, "GCOUNT", "no data", "1, for a table"));
    };
    let mut columns: Vec<Column> = Vec::new();
    for field in fields {
        if field.repeat == 0 && field.letter != 'A' {
            continue; // nothing in it
        }
        if columns.iter().any(|column| column.name == field.name) {
            return Err(field.bad(fits, hdu, "TTYPE", "the name twice", "each name once"));
        }
        let cells = Cells { data, row_bytes, field: &field };
        let values = cells.values(fits, hdu)?;
        let text = |stem: &str| {
            hdu.header().text(&field.keyword(stem)).filter(|t| !t.is_empty()).map(str::to_owned)
        };
        let (unit, description) = (text("TUNIT"), text("TCOMM"));
        columns.push(Column { name: field.name, unit, description, values });
    }
    Ok(Table { meta: meta(&hdu.header().without_structure()), columns })
}

fn fields(fits: &Fits, hdu: &Hdu, row_bytes: usize) -> Result<Vec<Field>, ParseError> {
    let count = fits.count(hdu, "TFIELDS")?;
    if count > 999 {
        return Err(fits.bad(hdu, "TFIELDS", count.to_string(), "at most 999 columns"));
    }
    let mut fields = Vec::new();
    let mut offset = 0_usize;
    for number in 1..=count {
        let mut field = Field::new(fits, hdu, number, offset)?;
        let width = field.repeat.checked_mul(field.value_bytes());
        match width.and_then(|width| offset.checked_add(width)).filter(|&end| end <= row_bytes) {
            Some(end) => offset = end,
            None => {
                return Err(field.bad(
                    fits,
                    hdu,
                    "TFORM",
                    "columns wider than the row",
                    format!("columns of {row_bytes} bytes together, as NAXIS1 says"),
                ));
            }
        }
        field.text_width = field.text_width.filter(|&w| w > 0 && w < field.repeat);
        fields.push(field);
    }
    if offset != row_bytes {
        let found = format!("{row_bytes} bytes a row");
        return Err(fits.bad(hdu, "NAXIS1", found, format!("{offset}, the sum of the columns")));
    }
    Ok(fields)
}

impl Field {
    fn new(fits: &Fits, hdu: &Hdu, number: u64, offset: usize) -> Result<Self, ParseError> {
        let header = hdu.header();
        let keyword = |stem: &str| format!("{stem}{number}");
        let name = header.text(&keyword("TTYPE")).filter(|name| !name.is_empty());
        let name = name.map_or_else(|| format!("column_{number}"), str::to_owned);
        let form_keyword = keyword("TFORM");
        let bad = |found: String, expected: &str| {
            let mut error = fits.bad(hdu, &form_keyword, found, expected);
            error.field = error.field.take().map(|field| format!("{field} ({name})"));
            error
        };
        let Some(form) = header.text(&form_keyword) else {
            return Err(bad("no such text".to_owned(), "a format such as `1D`"));
        };
        let digits = form.len() - form.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let repeat = match &form[..digits] {
            "" => Ok(1),
            digits => digits.parse::<usize>(),
        };
        let (Ok(repeat), Some(letter)) = (repeat, form[digits..].chars().next()) else {
            return Err(bad(excerpt(form), "a format such as `1D`"));
        };
        const READ: &str = "a column of L, B, I, J, K, E, D or A";
        match letter {
            'L' | 'B' | 'I' | 'J' | 'K' | 'E' | 'D' | 'A' => {}
            'P' | 'Q' => return Err(bad(format!("variable length ({})", excerpt(form)), READ)),
            'X' => return Err(bad(format!("bits ({})", excerpt(form)), READ)),
            'C' | 'M' => return Err(bad(format!("complex numbers ({})", excerpt(form)), READ)),
            _ => return Err(bad(excerpt(form), READ)),
        }
        let null = match header.get(&keyword("TNULL")) {
            Some(_) => Some(fits.integer(hdu, &keyword("TNULL"))?),
            None => None,
        };
        // `(8,3)`: 3 texts of 8 characters.
        let text_width = header.text(&keyword("TDIM")).filter(|_| letter == 'A').and_then(|dim| {
            dim.trim_start_matches('(').split([',', ')']).next()?.trim().parse().ok()
        });
        let scale = fits.real_or(hdu, &keyword("TSCAL"), 1.0)?;
        let zero = fits.real_or(hdu, &keyword("TZERO"), 0.0)?;
        Ok(Self { name, number, letter, repeat, offset, scale, zero, null, text_width })
    }

    fn keyword(&self, stem: &str) -> String {
        format!("{stem}{}", self.number)
    }

    fn value_bytes(&self) -> usize {
        match self.letter {
            'I' => 2,
            'J' | 'E' => 4,
            'K' | 'D' => 8,
            _ => 1,
        }
    }

    fn bad(
        &self,
        fits: &Fits,
        hdu: &Hdu,
        stem: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ParseError {
        let mut error = fits.bad(hdu, &self.keyword(stem), found, expected);
        error.field = error.field.take().map(|field| format!("{field} ({})", self.name));
        error
    }
}

/// The bytes of one column.
struct Cells<'a> {
    data: &'a [u8],
    row_bytes: usize,
    field: &'a Field,
}

impl<'a> Cells<'a> {
    /// The bytes of each row.
    fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let start = self.field.offset;
        let end = start + self.field.repeat * self.field.value_bytes();
        self.data.chunks_exact(self.row_bytes.max(1)).map(move |row| &row[start..end])
    }

    fn values(&self, fits: &Fits, hdu: &Hdu) -> Result<Values, ParseError> {
        let field = self.field;
        let (flat, width) = match field.letter {
            'A' => (
                Values::Text(self.texts()),
                field.text_width.map_or(1, |w| field.repeat.div_ceil(w)),
            ),
            'L' => {
                let values = self.rows().flatten().map(|&byte| match byte {
                    b'T' => Some(true),
                    b'F' => Some(false),
                    _ => None,
                });
                (Values::Bool(values.collect()), field.repeat)
            }
            'E' => {
                let values = self.numbers(|b: [u8; 4]| f64::from(f32::from_be_bytes(b)));
                (Values::F64(self.scaled(values)), field.repeat)
            }
            'D' => (Values::F64(self.scaled(self.numbers(f64::from_be_bytes))), field.repeat),
            letter => {
                let values = match letter {
                    'B' => self.numbers(|[byte]: [u8; 1]| i64::from(byte)),
                    'I' => self.numbers(|b: [u8; 2]| i64::from(i16::from_be_bytes(b))),
                    'J' => self.numbers(|b: [u8; 4]| i64::from(i32::from_be_bytes(b))),
                    _ => self.numbers(i64::from_be_bytes),
                };
                (self.integers(fits, hdu, &values)?, field.repeat)
            }
        };
        Ok(match width {
            1 => flat,
            width => Values::Vectors { width, flat: Box::new(flat) },
        })
    }

    fn numbers<const N: usize, T>(&self, value: impl Fn([u8; N]) -> T) -> Vec<T> {
        self.rows().flat_map(|row| row.as_chunks::<N>().0).map(|&chunk| value(chunk)).collect()
    }

    fn scaled(&self, mut values: Vec<f64>) -> Vec<f64> {
        let Field { scale, zero, .. } = *self.field;
        if scale != 1.0 || zero != 0.0 {
            values.iter_mut().for_each(|value| *value = zero + scale * *value);
        }
        values
    }

    /// Whole numbers stay whole if they are only shifted, as unsigned ones are.
    fn integers(&self, fits: &Fits, hdu: &Hdu, raw: &[i64]) -> Result<Values, ParseError> {
        let Field { scale, zero, null, .. } = *self.field;
        let is_null = |value: i64| null == Some(value);
        if scale != 1.0 || zero.fract() != 0.0 || zero.abs() > 9.3e18 {
            let value = |&v: &i64| if is_null(v) { f64::NAN } else { zero + scale * v as f64 };
            return Ok(Values::F64(raw.iter().map(value).collect()));
        }
        let shift = zero as i128;
        let mut values = Vec::with_capacity(raw.len());
        for &value in raw {
            if is_null(value) {
                values.push(None);
                continue;
            }
            let shifted = i128::from(value) + shift;
            let fits_i64 = i64::try_from(shifted).map_err(|_| {
                let expected = format!("at most {}", i64::MAX);
                self.field.bad(fits, hdu, "TZERO", format!("the value {shifted}"), expected)
            })?;
            values.push(Some(fits_i64));
        }
        Ok(Values::I64(values))
    }

    fn texts(&self) -> Vec<Option<String>> {
        let width = self.field.text_width.unwrap_or(self.field.repeat).max(1);
        let text = |bytes: &[u8]| {
            // NUL ends a text; blanks at the end do not count.
            let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
            let text = bytes[..end].iter().map(|&b| if b.is_ascii() { char::from(b) } else { '?' });
            let text: String = text.collect();
            Some(text.trim_end_matches(' ').to_owned())
        };
        if self.field.repeat == 0 {
            return self.rows().map(|_| Some(String::new())).collect();
        }
        self.rows().flat_map(|row| row.chunks(width)).map(text).collect()
    }
}

/// Cards as metadata. The block of comments in which astropy describes its own classes is left out.
fn meta(header: &Header) -> Meta {
    let mut meta = Meta::new();
    let mut inside_astropy = false;
    for card in &header.cards {
        let value = match &card.value {
            CardValue::Undefined => Value::Null,
            CardValue::Logical(value) => (*value).into(),
            CardValue::Integer(value) => (*value).into(),
            CardValue::Real(value) => (*value).into(),
            CardValue::Text(text) | CardValue::Other(text) => text.as_str().into(),
            CardValue::Commentary(text) => {
                match text.trim() {
                    "--BEGIN-ASTROPY-SERIALIZED-COLUMNS--" => inside_astropy = true,
                    "--END-ASTROPY-SERIALIZED-COLUMNS--" => inside_astropy = false,
                    _ if !inside_astropy => {
                        let keyword =
                            if card.keyword.is_empty() { "COMMENT" } else { &card.keyword };
                        let list = meta.entry(keyword).or_insert_with(|| Value::Array(Vec::new()));
                        if let Value::Array(list) = list {
                            list.push(text.trim_start().into());
                        }
                    }
                    _ => {}
                }
                continue;
            }
        };
        meta.entry(card.keyword.clone()).or_insert(value);
    }
    meta
}
