//! Binary tables out.

use super::card::{Card, CardValue, is_standard_keyword};
use super::header::Header;
use crate::error::{EncodeError, excerpt};
use crate::table::{Meta, Table, Values};
use serde_json::Value;

/// A table as cards and bytes.
pub(super) struct Encoded {
    pub fields: usize,
    pub row_bytes: usize,
    pub rows: usize,
    pub cards: Vec<Card>,
    pub data: Vec<u8>,
}

/// One column: its TFORM letter, values a row, bytes a row, and the bytes of all rows.
struct Field {
    form: String,
    row_bytes: usize,
    bytes: Vec<u8>,
    null: Option<i64>,
    /// Characters of one text, where there is a vector of them.
    text_width: Option<(usize, usize)>,
}

/// `text_width` is the least width of a column of texts.
pub(super) fn encode(table: &Table, text_width: usize) -> Result<Encoded, EncodeError> {
    table.check_columns()?;
    let rows = table.rows();
    let mut header = Header::default();
    let mut fields = Vec::new();
    if table.columns.len() > 999 {
        let found = format!("{} columns", table.columns.len());
        return Err(EncodeError::new("table", found, "at most 999"));
    }
    for (i, column) in table.columns.iter().enumerate() {
        let field = field(&column.name, &column.values, text_width)?;
        let keyword = |stem: &str| format!("{stem}{}", i + 1);
        header.set(&keyword("TTYPE"), column.name.as_str(), "");
        header.set(&keyword("TFORM"), field.form.as_str(), "");
        if let Some(null) = field.null {
            header.set(&keyword("TNULL"), null, "a missing value");
        }
        if let Some((width, count)) = field.text_width {
            header.set(&keyword("TDIM"), format!("({width},{count})"), "");
        }
        if let Some(unit) = &column.unit {
            header.set(&keyword("TUNIT"), unit.as_str(), "");
        }
        if let Some(description) = &column.description {
            header.set(&keyword("TCOMM"), description.as_str(), "");
        }
        fields.push(field);
    }
    let row_bytes = fields.iter().map(|field| field.row_bytes).sum();
    let mut data = Vec::with_capacity(row_bytes * rows);
    for row in 0..rows {
        for field in &fields {
            data.extend_from_slice(&field.bytes[row * field.row_bytes..][..field.row_bytes]);
        }
    }
    Ok(Encoded { fields: fields.len(), row_bytes, rows, cards: header.cards, data })
}

fn field(name: &str, values: &Values, text_width: usize) -> Result<Field, EncodeError> {
    let (width, flat) = match values {
        Values::Vectors { width, flat } => (*width, flat.as_ref()),
        single => (1, single),
    };
    let form =
        |letter: char| if width == 1 { letter.to_string() } else { format!("{width}{letter}") };
    let plain = |letter, value_bytes: usize, bytes| Field {
        form: form(letter),
        row_bytes: width * value_bytes,
        bytes,
        null: None,
        text_width: None,
    };
    match flat {
        Values::F64(values) => {
            Ok(plain('D', 8, values.iter().flat_map(|value| value.to_be_bytes()).collect()))
        }
        Values::Bool(values) => {
            let byte = |value: &Option<bool>| match value {
                Some(true) => b'T',
                Some(false) => b'F',
                None => 0,
            };
            Ok(plain('L', 1, values.iter().map(byte).collect()))
        }
        Values::I64(values) => {
            let null = values.contains(&None).then_some(i64::MIN);
            if null.is_some() && values.contains(&null) {
                let expected = "another value, which stands for missing ones in FITS";
                return Err(EncodeError::new(name, i64::MIN.to_string(), expected));
            }
            let value = |value: &Option<i64>| value.unwrap_or(i64::MIN).to_be_bytes();
            let bytes = values.iter().flat_map(value).collect();
            Ok(Field { null, ..plain('K', 8, bytes) })
        }
        Values::Text(values) => texts(name, values, width, text_width),
        Values::Vectors { .. } => {
            Err(EncodeError::new(name, "vectors of vectors", "vectors of single values"))
        }
    }
}

fn texts(
    name: &str,
    values: &[Option<String>],
    count: usize,
    least: usize,
) -> Result<Field, EncodeError> {
    let text = |value: &Option<String>| value.as_deref().unwrap_or("").to_owned();
    let width = values.iter().map(|value| text(value).len()).max().unwrap_or(0).max(least).max(1);
    let mut bytes = Vec::with_capacity(width * values.len());
    for value in values {
        let text = text(value);
        if let Some(c) = text.chars().find(|c| !matches!(c, ' '..='~')) {
            let expected = "printable ASCII (a FITS table holds nothing else)";
            return Err(EncodeError::new(
                name,
                format!("the character {}", c.escape_unicode()),
                expected,
            ));
        }
        bytes.extend_from_slice(format!("{text:<width$}").as_bytes());
    }
    Ok(Field {
        form: format!("{}A", width * count),
        row_bytes: width * count,
        bytes,
        null: None,
        text_width: (count > 1).then_some((width, count)),
    })
}

/// Metadata as cards.
pub(super) fn meta_cards(meta: &Meta) -> Result<Header, EncodeError> {
    let mut header = Header::default();
    for (key, value) in meta {
        let capitals = key.to_ascii_uppercase();
        let keyword = if is_standard_keyword(&capitals) { capitals } else { key.clone() };
        let value = match value {
            Value::Null => CardValue::Undefined,
            Value::Bool(value) => CardValue::Logical(*value),
            Value::Number(number) => match (number.as_i64(), number.as_f64()) {
                (Some(value), _) => CardValue::Integer(value),
                (None, value) => CardValue::Real(value.unwrap_or(f64::NAN)),
            },
            Value::String(text) => text.as_str().into(),
            Value::Array(lines)
                if matches!(keyword.as_str(), "COMMENT" | "COMMENTS" | "HISTORY") =>
            {
                for line in lines {
                    let Some(line) = line.as_str() else {
                        return Err(EncodeError::new(key, excerpt(&line.to_string()), "text"));
                    };
                    if keyword == "HISTORY" {
                        header.history(line);
                    } else {
                        header.comment(line);
                    }
                }
                continue;
            }
            nested => {
                let expected = "a number, a text or a truth value (FITS holds nothing nested)";
                return Err(EncodeError::new(key, excerpt(&nested.to_string()), expected));
            }
        };
        header.cards.push(Card { keyword, value, comment: String::new() });
    }
    Ok(header)
}
