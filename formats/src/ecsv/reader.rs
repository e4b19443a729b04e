//! ECSV in.

use super::rows::{BadRow, Field, Rows};
use crate::error::{FileError, ParseError, excerpt, nearest_names};
use crate::table::{Column, Meta, Table, Values};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// Reads an ECSV file.
pub fn read(path: impl AsRef<Path>) -> Result<Table, FileError> {
    let path = path.as_ref();
    let text = crate::read::text(path)?;
    Ok(read_str(path, &text)?)
}

/// Reads an ECSV text. `path` names it in errors.
///
/// # Errors
/// A [`ParseError`] with the line and, where there is one, the column: a header that is not ECSV, a datatype that is
/// not read (see the module), columns that differ between the header and the rows, a wrong number of fields, a value
/// that is not of the datatype.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<Table, ParseError> {
    read_str_at(path.as_ref(), text)
}

fn read_str_at(path: &Path, text: &str) -> Result<Table, ParseError> {
    let (yaml, rest, line) = split_header(path, text)?;
    let header = parse_header(path, &yaml)?;
    let delimiter = match header.delimiter.as_deref() {
        None | Some(" ") => b' ',
        Some(",") => b',',
        Some(other) => {
            return Err(
                ParseError::new(path, excerpt(other), "a blank or a comma").in_field("delimiter")
            );
        }
    };
    let meta = match header.meta {
        Some(meta) => parse_meta(path, meta)?,
        None => Meta::new(),
    };
    let mut builders = header
        .datatype
        .into_iter()
        .map(|column| Builder::new(path, column))
        .collect::<Result<Vec<_>, _>>()?;
    let mut rows = Rows::new(rest, delimiter, line);
    let mut fields = Vec::new();
    let bad_row = |bad: BadRow| {
        ParseError::new(path, bad.found, "delimiter-separated values").at_line(bad.line)
    };
    check_names(path, &builders, rows.next_row(&mut fields).map_err(bad_row)?, &fields)?;
    while let Some(line) = rows.next_row(&mut fields).map_err(bad_row)? {
        if fields.len() != builders.len() {
            return Err(ParseError::new(
                path,
                format!("{} fields", fields.len()),
                format!("{} fields, one for each column", builders.len()),
            )
            .at_line(line));
        }
        for (builder, field) in builders.iter_mut().zip(&fields) {
            builder.push(field).map_err(|expected| {
                ParseError::new(path, excerpt(&field.text), expected)
                    .at_line(line)
                    .in_field(&builder.column.name)
            })?;
        }
    }
    let columns = builders.into_iter().map(|builder| builder.column).collect();
    Ok(Table { meta, columns })
}

#[derive(Deserialize)]
struct Header {
    datatype: Vec<ColumnHeader>,
    delimiter: Option<String>,
    meta: Option<Value>,
    schema: Option<String>,
}

#[derive(Deserialize)]
struct ColumnHeader {
    name: String,
    datatype: String,
    subtype: Option<String>,
    unit: Option<String>,
    description: Option<String>,
}

/// Takes the comment lines at the start apart: their YAML, the rest of the text, and the line at which that begins.
fn split_header<'a>(path: &Path, text: &'a str) -> Result<(String, &'a str, u64), ParseError> {
    let mut yaml = String::new();
    let mut rest = text;
    let mut line = 1;
    while rest.starts_with('#') {
        let end = rest.find('\n').map_or(rest.len(), |i| i + 1);
        let content = &rest[1..end];
        let content = content.strip_prefix(' ').unwrap_or(content);
        if line == 1 {
            check_version(path, content.trim_end())?;
            // Kept as an empty line, so that lines of the YAML are lines of the file.
            yaml.push('\n');
        } else if content.starts_with('#') {
            yaml.push('\n'); // `##` is a comment of the header itself
        } else {
            yaml.push_str(content);
        }
        rest = &rest[end..];
        line += 1;
    }
    if line == 1 {
        let found = excerpt(text.lines().next().unwrap_or(""));
        return Err(ParseError::new(path, found, "`# %ECSV 1.0`").at_line(1));
    }
    Ok((yaml, rest, line))
}

fn check_version(path: &Path, content: &str) -> Result<(), ParseError> {
    let version = content.strip_prefix("%ECSV ").unwrap_or("").trim();
    // Major version 1 and the drafts 0.9 differ in nothing that is read here.
    if version.starts_with("1.") || version == "0.9" {
        return Ok(());
    }
    Err(ParseError::new(path, excerpt(content), "`%ECSV 1.0`").at_line(1))
}

fn parse_header(path: &Path, yaml: &str) -> Result<Header, ParseError> {
    use serde_saphyr::options::NonFiniteFloatPolicy;
    let options = serde_saphyr::options! {
        // JSON has no NaN: `.nan` in the metadata stays the text `.nan`.
        non_finite_float_policy: NonFiniteFloatPolicy::AsString,
        with_snippet: false,
        // Repeated by reference, a text of the file's own size would multiply; headers have no need of it.
        alias_limits: serde_saphyr::alias_limits! { max_total_replayed_events: 100 },
    };
    let header: Header = serde_saphyr::from_str_with_options(yaml, options).map_err(|error| {
        let line = error.location().map(|location| location.line());
        let message = error.to_string();
        let message = message.trim_start_matches("error: ").to_owned();
        // The message repeats its place.
        let message = match (message.starts_with("line "), message.split_once(": ")) {
            (true, Some((_, message))) => message.to_owned(),
            _ => message,
        };
        let error = ParseError::new(path, "a header that cannot be read", "an ECSV header in YAML")
            .with_hint(message);
        match line {
            Some(line) if line > 0 => error.at_line(line),
            _ => error,
        }
    })?;
    if let Some(schema) = &header.schema
        && schema != "astropy-2.0"
        && schema != "astropy-1.0"
    {
        return Err(ParseError::new(path, excerpt(schema), "`astropy-2.0`").in_field("schema"));
    }
    Ok(header)
}

/// `!!omap` is a list of maps of one key; some writers use a map.
fn parse_meta(path: &Path, meta: Value) -> Result<Meta, ParseError> {
    let wrong = || {
        ParseError::new(path, "something else", "a map, or a list of `key: value` (`!!omap`)")
            .in_field("meta")
    };
    match meta {
        Value::Null => Ok(Meta::new()),
        Value::Object(map) => Ok(map),
        Value::Array(items) => {
            let mut all = Meta::new();
            for item in items {
                let Value::Object(map) = item else { return Err(wrong()) };
                for (key, value) in map {
                    if all.contains_key(&key) {
                        return Err(ParseError::new(path, "the key twice", "each key once")
                            .in_field(format!("meta.{key}")));
                    }
                    all.insert(key, value);
                }
            }
            Ok(all)
        }
        _ => Err(wrong()),
    }
}

/// The names above the rows must be those of the header.
fn check_names(
    path: &Path,
    columns: &[Builder],
    line: Option<u64>,
    fields: &[Field<'_>],
) -> Result<(), ParseError> {
    let Some(line) = line else {
        return Err(ParseError::new(path, "no line with the column names", "the column names"));
    };
    let at = |error: ParseError| error.at_line(line);
    for (i, column) in columns.iter().enumerate() {
        let name = &column.column.name;
        if columns[..i].iter().any(|c| &c.column.name == name) {
            return Err(
                ParseError::new(path, "the column twice", "each column once").in_field(name)
            );
        }
        match fields.get(i) {
            Some(field) if field.text == name.as_str() => {}
            Some(field) => {
                return Err(at(ParseError::new(path, excerpt(&field.text), format!("`{name}`"))
                    .with_hint("the column names must be those of the header, in its order")));
            }
            None => {
                let error = ParseError::new(path, "no such column", format!("`{name}`"));
                return Err(at(error.with_hint("the header announces it")));
            }
        }
    }
    match fields.get(columns.len()) {
        None => Ok(()),
        Some(extra) => Err(at(ParseError::new(
            path,
            excerpt(&extra.text),
            format!("{} column names", columns.len()),
        )
        .with_hint("the header announces no such column"))),
    }
}

/// Values that a datatype allows.
#[derive(Clone, Copy)]
enum Kind {
    Bool,
    Integer { name: &'static str, least: i64, most: i64 },
    F16,
    F32,
    F64,
    Text,
}

fn kind_of(datatype: &str) -> Option<Kind> {
    let integer = |name, least, most| Some(Kind::Integer { name, least, most });
    match datatype {
        "bool" => Some(Kind::Bool),
        "int8" => integer("int8", i8::MIN.into(), i8::MAX.into()),
        "int16" => integer("int16", i16::MIN.into(), i16::MAX.into()),
        "int32" => integer("int32", i32::MIN.into(), i32::MAX.into()),
        "int64" => integer("int64", i64::MIN, i64::MAX),
        "uint8" => integer("uint8", 0, u8::MAX.into()),
        "uint16" => integer("uint16", 0, u16::MAX.into()),
        "uint32" => integer("uint32", 0, u32::MAX.into()),
        "uint64" => integer("uint64", 0, i64::MAX),
        "float16" => Some(Kind::F16),
        "float32" => Some(Kind::F32),
        "float64" => Some(Kind::F64),
        "string" => Some(Kind::Text),
        _ => None,
    }
}

const DATATYPES: [&str; 13] = [
    "bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float16",
    "float32", "float64", "string",
];

/// A column that grows row by row.
struct Builder {
    column: Column,
    kind: Kind,
}

impl Builder {
    fn new(path: &Path, header: ColumnHeader) -> Result<Self, ParseError> {
        let Some(kind) = kind_of(&header.datatype) else {
            let error = ParseError::new(
                path,
                format!("the datatype {}", excerpt(&header.datatype)),
                format!("one of {}", DATATYPES.join(", ")),
            )
            .in_field(header.name);
            return Err(match nearest_names(&header.datatype, DATATYPES, 1).first() {
                Some(nearest) => error.with_hint(format!("did you mean `{nearest}`?")),
                None => error,
            });
        };
        if let Some(subtype) = header.subtype {
            return Err(ParseError::new(
                path,
                format!("the subtype {}", excerpt(&subtype)),
                "a column of plain values",
            )
            .in_field(header.name)
            .with_hint("arrays and JSON inside a column are not read"));
        }
        let values = match kind {
            Kind::Bool => Values::Bool(Vec::new()),
            Kind::Integer { .. } => Values::I64(Vec::new()),
            Kind::F16 | Kind::F32 | Kind::F64 => Values::F64(Vec::new()),
            Kind::Text => Values::Text(Vec::new()),
        };
        let ColumnHeader { name, unit, description, .. } = header;
        Ok(Self { column: Column { name, unit, description, values }, kind })
    }

    /// Adds a field, or says what was expected.
    fn push(&mut self, field: &Field<'_>) -> Result<(), String> {
        let text = field.text.as_ref();
        match (&mut self.column.values, self.kind) {
            (Values::F64(values), kind) => values.push(float(text, kind)?),
            (Values::I64(values), Kind::Integer { name, least, most }) => {
                values.push(integer(text, name, least, most)?);
            }
            (Values::Bool(values), _) => values.push(match text {
                "" => None,
                "True" | "true" => Some(true),
                "False" | "false" => Some(false),
                _ => return Err("True or False".to_owned()),
            }),
            (Values::Text(values), _) => {
                values.push((field.quoted || !text.is_empty()).then(|| text.to_owned()));
            }
            // The two enums are made together in `new`.
            _ => return Err("a value of the column's datatype".to_owned()),
        }
        Ok(())
    }
}

fn float(text: &str, kind: Kind) -> Result<f64, String> {
    if text.is_empty() {
        return Ok(f64::NAN);
    }
    let value: f64 = match kind {
        Kind::F32 => text.parse::<f32>().ok().map(f64::from),
        Kind::F16 => text.parse::<f64>().ok().map(|value| half::f16::from_f64(value).to_f64()),
        _ => text.parse().ok(),
    }
    .ok_or("a number")?;
    // `1e999` is a number that does not fit, not an infinity.
    if value.is_infinite() && text.bytes().any(|b| b.is_ascii_digit()) {
        return Err("a number that fits the datatype".to_owned());
    }
    Ok(value)
}

fn integer(text: &str, name: &str, least: i64, most: i64) -> Result<Option<i64>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    match text.parse::<i64>() {
        Ok(value) if (least..=most).contains(&value) => Ok(Some(value)),
        _ if name == "int64" => Err("a whole number of at most 64 bits".to_owned()),
        _ => Err(format!("a whole number from {least} to {most} ({name})")),
    }
}
