//! ECSV out.

use crate::atomic::Overwrite;
use crate::error::{EncodeError, FileError};
use crate::table::{Column, Table, Values};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;

/// Writes a table as ECSV, whole or not at all.
pub fn write_file(
    path: impl AsRef<Path>,
    table: &Table,
    overwrite: Overwrite,
) -> Result<(), FileError> {
    let path = path.as_ref();
    let text = to_string(table).map_err(|source| FileError::encode(path, source))?;
    crate::atomic::write_file(path, text.as_bytes(), overwrite)
}

/// A table as ECSV text, comma-separated. Floats have the fewest digits that read back exactly; a missing float is
/// `nan`, any other missing value an empty field.
///
/// # Errors
/// Columns of different lengths or with one name; a column of vectors (write FITS); a name that is empty or has a line
/// break; a missing text in a table of one column, which ECSV cannot tell from an empty one.
pub fn to_string(table: &Table) -> Result<String, EncodeError> {
    let mut text = head(table)?;
    rows(table, &mut text)?;
    Ok(text)
}

/// The part of [`to_string`] above the rows: for a table that is written piece by piece. It is the same for all pieces that differ in their rows alone.
///
/// # Errors
/// The errors of [`to_string`].
pub fn head(table: &Table) -> Result<String, EncodeError> {
    check(table)?;
    let mut text = String::from("# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n");
    for column in &table.columns {
        header_of(&mut text, column);
    }
    // How astropy made its own classes from columns: the tags that it needs for that are gone, and it would fail on
    // what is left.
    let meta = || table.meta.iter().filter(|(key, _)| *key != "__serialized_columns__");
    if meta().next().is_some() {
        text.push_str("# meta: !!omap\n");
        for (key, value) in meta() {
            text.push_str("# - ");
            flow(&mut text, &Value::Object([(key.clone(), value.clone())].into_iter().collect()));
            text.push('\n');
        }
    }
    text.push_str("# schema: astropy-2.0\n");
    row(&mut text, table.columns.iter(), |text, column| quote_if_needed(text, &column.name));
    Ok(text)
}

/// Adds the rows of a table to a text that has its [`head`], or that of another piece of the same table.
///
/// # Errors
/// The errors of [`to_string`].
pub fn rows(table: &Table, text: &mut String) -> Result<(), EncodeError> {
    check(table)?;
    for i in 0..table.rows() {
        row(text, table.columns.iter(), |text, column| cell(text, &column.values, i));
    }
    Ok(())
}

fn check(table: &Table) -> Result<(), EncodeError> {
    table.check_columns()?;
    for column in &table.columns {
        let bad = |found: String, expected: &str| EncodeError::new(&column.name, found, expected);
        if column.name.is_empty() || column.name.contains(['\n', '\r']) {
            return Err(bad(format!("the name {:?}", column.name), "a column name in one line"));
        }
        if let Values::Vectors { width, .. } = &column.values {
            return Err(bad(format!("vectors of {width}"), "one value a row (FITS holds vectors)"));
        }
    }
    // Its row would be blank, and a quoted nothing is the empty text.
    if let [Column { name, values: Values::Text(values), .. }] = table.columns.as_slice()
        && values.contains(&None)
    {
        let expected = "a second column beside it, or the empty text";
        return Err(EncodeError::new(name, "a missing text in a table of one column", expected));
    }
    if table.columns.is_empty() {
        return Err(EncodeError::new("table", "no columns", "at least one column"));
    }
    Ok(())
}

fn header_of(text: &mut String, column: &Column) {
    let datatype = match &column.values {
        Values::F64(_) | Values::Vectors { .. } => "float64",
        Values::I64(_) => "int64",
        Values::Bool(_) => "bool",
        Values::Text(_) => "string",
    };
    text.push_str("# - {name: ");
    scalar(text, &column.name);
    if let Some(unit) = &column.unit {
        text.push_str(", unit: ");
        scalar(text, unit);
    }
    let _ = write!(text, ", datatype: {datatype}");
    if let Some(description) = &column.description {
        text.push_str(", description: ");
        scalar(text, description);
    }
    text.push_str("}\n");
}

/// A text in YAML: plain where it cannot be taken for anything else, else in double quotes, whose escapes YAML
/// shares with JSON.
fn scalar(text: &mut String, value: &str) {
    // A short word of letters may be `yes`, `null` or `nan`, and digits first may be a number.
    const WORDS: [&str; 11] =
        ["y", "n", "yes", "no", "on", "off", "true", "false", "null", "nan", "inf"];
    let plain = value.starts_with(|c: char| c.is_ascii_alphabetic())
        && value.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        && !WORDS.contains(&value.to_lowercase().as_str());
    if plain {
        text.push_str(value);
    } else {
        double_quoted(text, value);
    }
}

fn double_quoted(text: &mut String, value: &str) {
    fn escape(text: &mut String, c: char) {
        let _ = write!(text, "\\u{:04X}", u32::from(c));
    }
    text.push('"');
    for c in value.chars() {
        match c {
            '"' => text.push_str("\\\""),
            '\\' => text.push_str("\\\\"),
            '\n' => text.push_str("\\n"),
            '\t' => text.push_str("\\t"),
            // YAML wants these escaped; a line break among them would end the comment line.
            '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}' => escape(text, c),
            c if c.is_control() => escape(text, c),
            c => text.push(c),
        }
    }
    text.push('"');
}

/// A value in YAML's flow style, in one line.
fn flow(text: &mut String, value: &Value) {
    match value {
        Value::Null => text.push_str("null"),
        Value::Bool(value) => {
            let _ = write!(text, "{value}");
        }
        Value::Number(number) => number_scalar(text, number),
        Value::String(value) => double_quoted(text, value),
        Value::Array(items) => {
            text.push('[');
            for (i, item) in items.iter().enumerate() {
                text.push_str(if i == 0 { "" } else { ", " });
                flow(text, item);
            }
            text.push(']');
        }
        Value::Object(map) => {
            text.push('{');
            for (i, (key, item)) in map.iter().enumerate() {
                text.push_str(if i == 0 { "" } else { ", " });
                scalar(text, key);
                text.push_str(": ");
                flow(text, item);
            }
            text.push('}');
        }
    }
}

fn number_scalar(text: &mut String, number: &serde_json::Number) {
    match number.as_f64().filter(|_| number.is_f64()) {
        // YAML 1.1, which astropy reads, takes `1e-7` for text: it wants the point and the sign of the exponent.
        Some(value) => {
            let digits = format!("{value:?}");
            match digits.split_once('e') {
                Some((mantissa, exponent)) => {
                    let point = if mantissa.contains('.') { "" } else { ".0" };
                    let sign = if exponent.starts_with('-') { "" } else { "+" };
                    let _ = write!(text, "{mantissa}{point}e{sign}{exponent}");
                }
                None => text.push_str(&digits),
            }
        }
        None => {
            let _ = write!(text, "{number}");
        }
    }
}

fn row<'a>(
    text: &mut String,
    columns: impl Iterator<Item = &'a Column>,
    mut cell: impl FnMut(&mut String, &Column),
) {
    let start = text.len();
    for (i, column) in columns.enumerate() {
        text.push_str(if i == 0 { "" } else { "," });
        cell(text, column);
    }
    // A row of one missing value would be a blank line, which readers skip.
    if text.len() == start {
        text.push_str("\"\"");
    }
    text.push('\n');
}

fn cell(text: &mut String, values: &Values, i: usize) {
    match values {
        Values::F64(values) => {
            let value = values[i];
            // `Display` of f64 is the shortest that reads back, but writes 1e300 with 301 digits.
            let _ = match value {
                v if v.is_nan() => text.write_str("nan"),
                v if v != 0.0 && !(1e-5..1e16).contains(&v.abs()) => write!(text, "{v:e}"),
                v => write!(text, "{v:?}"),
            };
        }
        Values::I64(values) => {
            if let Some(value) = values[i] {
                let _ = write!(text, "{value}");
            }
        }
        Values::Bool(values) => match values[i] {
            Some(true) => text.push_str("True"),
            Some(false) => text.push_str("False"),
            None => {}
        },
        Values::Text(values) => match &values[i] {
            Some(value) if value.is_empty() => text.push_str("\"\""),
            Some(value) => quote_if_needed(text, value),
            None => {}
        },
        // Refused by `check`.
        Values::Vectors { .. } => {}
    }
}

fn quote_if_needed(text: &mut String, value: &str) {
    let plain =
        !value.contains([',', '"', '\n', '\r']) && !value.starts_with('#') && value.trim() == value;
    if plain {
        text.push_str(value);
    } else {
        let _ = write!(text, "\"{}\"", value.replace('"', "\"\""));
    }
}
