//! Columns of results, and the Parquet files that hold them.

use crate::StudyError;
use bytes::Bytes;
use parquet::basic::{Compression, Encoding, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::column::reader::get_typed_column_reader;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterVersion};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};
use std::path::Path;
use std::sync::Arc;

/// Rows of a row group at most.
const GROUP_ROWS: usize = 1 << 16;

/// Kind of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers.
    Integer,
    /// Numbers.
    Number,
    /// Texts.
    Text,
    /// Moments of UTC: nanoseconds after 1970, without leap seconds.
    Time,
}

/// Value of a column's row.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// No value.
    None,
    /// A whole number, or a moment.
    Integer(i64),
    /// A number; NaN is written as no value.
    Number(f64),
    /// A text.
    Text(String),
}

/// Columns of a table.
pub type Columns = Vec<(String, Kind)>;

/// Rows of a table: as many cells each as there are columns.
pub type Rows = Vec<Vec<Cell>>;

fn field(name: &str, kind: Kind) -> Result<TypePtr, ParquetError> {
    let (physical, logical) = match kind {
        Kind::Integer => (Physical::INT64, None),
        Kind::Number => (Physical::DOUBLE, None),
        Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Kind::Time => (Physical::INT64, Some(LogicalType::timestamp(true, TimeUnit::NANOS))),
    };
    Type::primitive_type_builder(name, physical)
        .with_repetition(Repetition::OPTIONAL)
        .with_logical_type(logical)
        .build()
        .map(Arc::new)
}

/// Encodes rows as a Parquet file. The same rows give the same bytes: no time, no host, no dictionary whose size decides. `path` names it in errors.
///
/// # Errors
/// The writer's: a name that no column may have.
pub fn encode(
    path: &Path,
    columns: &[(String, Kind)],
    rows: &[Vec<Cell>],
    notes: &[(&str, &str)],
) -> Result<Vec<u8>, StudyError> {
    encoded(columns, rows, notes)
        .map_err(|source| StudyError::Table { path: path.to_path_buf(), source })
}

fn encoded(
    columns: &[(String, Kind)],
    rows: &[Vec<Cell>],
    notes: &[(&str, &str)],
) -> Result<Vec<u8>, ParquetError> {
    let fields =
        columns.iter().map(|(name, kind)| field(name, *kind)).collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("study").with_fields(fields).build()?);
    let notes = notes.iter().map(|(k, v)| KeyValue::new((*k).to_owned(), (*v).to_owned()));
    let properties = WriterProperties::builder()
        .set_created_by(concat!("sunglint ", env!("CARGO_PKG_VERSION")).into())
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_encoding(Encoding::PLAIN)
        .set_dictionary_enabled(false)
        .set_compression(Compression::SNAPPY)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_key_value_metadata(Some(notes.collect()))
        .build();
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties))?;
    for group in rows.chunks(GROUP_ROWS) {
        let mut row_group = writer.next_row_group()?;
        for (i, (_, kind)) in columns.iter().enumerate() {
            let Some(mut column) = row_group.next_column()? else { break };
            // Optional columns: the values that there are, and for each row whether it has one.
            let mut levels = Vec::with_capacity(group.len());
            let mut integers = Vec::new();
            let mut numbers = Vec::new();
            let mut texts = Vec::new();
            for row in group {
                let is_there = match &row[i] {
                    Cell::Integer(v) if *kind == Kind::Number => {
                        numbers.push(*v as f64);
                        true
                    }
                    Cell::Integer(v) => {
                        integers.push(*v);
                        true
                    }
                    Cell::Number(v) if !v.is_nan() => {
                        numbers.push(*v);
                        true
                    }
                    Cell::Text(v) => {
                        texts.push(ByteArray::from(v.as_bytes().to_vec()));
                        true
                    }
                    Cell::Number(_) | Cell::None => false,
                };
                levels.push(i16::from(is_there));
            }
            match kind {
                Kind::Integer | Kind::Time => {
                    column.typed::<Int64Type>().write_batch(&integers, Some(&levels), None)?
                }
                Kind::Number => {
                    column.typed::<DoubleType>().write_batch(&numbers, Some(&levels), None)?
                }
                Kind::Text => {
                    column.typed::<ByteArrayType>().write_batch(&texts, Some(&levels), None)?
                }
            };
            column.close()?;
        }
        row_group.close()?;
    }
    writer.close()?;
    Ok(bytes)
}

/// Notes of a Parquet file, and its number of rows; `None` where it is not there or not whole.
pub fn notes(path: &Path) -> Option<(Vec<(String, String)>, u64)> {
    let file = std::fs::File::open(path).ok()?;
    let reader = SerializedFileReader::new(file).ok()?;
    let metadata = reader.metadata().file_metadata();
    let notes = metadata.key_value_metadata()?.iter();
    let notes = notes.map(|n| (n.key.clone(), n.value.clone().unwrap_or_default())).collect();
    Some((notes, u64::try_from(metadata.num_rows()).ok()?))
}

/// Reads the rows of a file that [`write()`] wrote, with these columns in this order, out of its bytes. `path` names it in errors.
///
/// # Errors
/// Bytes that are no Parquet, or have other columns.
pub fn decode(path: &Path, bytes: Vec<u8>, columns: &[(String, Kind)]) -> Result<Rows, StudyError> {
    rows_of(bytes, columns)
        .map_err(|source| StudyError::Unread { path: path.to_path_buf(), source })
}

fn rows_of(bytes: Vec<u8>, columns: &[(String, Kind)]) -> Result<Rows, ParquetError> {
    let reader = SerializedFileReader::new(Bytes::from(bytes))?;
    let found = reader.metadata().file_metadata().schema_descr();
    let other = |what: String| ParquetError::General(what);
    if found.num_columns() != columns.len() {
        return Err(other(format!("{} columns, expected {}", found.num_columns(), columns.len())));
    }
    for (i, (name, kind)) in columns.iter().enumerate() {
        let column = found.column(i);
        let expected = field(name, *kind)?;
        if column.self_type() != &*expected {
            return Err(other(format!("column {i} is `{}`, expected `{name}`", column.name())));
        }
    }
    let mut rows = Rows::new();
    for g in 0..reader.num_row_groups() {
        let group = reader.get_row_group(g)?;
        let count = usize::try_from(group.metadata().num_rows())
            .map_err(|e| other(format!("a number of rows: {e}")))?;
        let first = rows.len();
        rows.resize(first + count, Vec::with_capacity(columns.len()));
        for (i, (name, kind)) in columns.iter().enumerate() {
            let mut levels = Vec::new();
            let mut cells: Vec<Cell> = Vec::new();
            match kind {
                Kind::Integer | Kind::Time => {
                    let mut values = Vec::new();
                    let mut column =
                        get_typed_column_reader::<Int64Type>(group.get_column_reader(i)?);
                    column.read_records(count, Some(&mut levels), None, &mut values)?;
                    cells.extend(values.into_iter().map(Cell::Integer));
                }
                Kind::Number => {
                    let mut values = Vec::new();
                    let mut column =
                        get_typed_column_reader::<DoubleType>(group.get_column_reader(i)?);
                    column.read_records(count, Some(&mut levels), None, &mut values)?;
                    cells.extend(values.into_iter().map(Cell::Number));
                }
                Kind::Text => {
                    let mut values = Vec::new();
                    let mut column =
                        get_typed_column_reader::<ByteArrayType>(group.get_column_reader(i)?);
                    column.read_records(count, Some(&mut levels), None, &mut values)?;
                    for value in values {
                        cells.push(Cell::Text(value.as_utf8()?.to_owned()));
                    }
                }
            }
            let mut cells = cells.into_iter();
            if levels.len() != count {
                return Err(other(format!("`{name}` has {} rows of {count}", levels.len())));
            }
            for (row, level) in rows[first..].iter_mut().zip(levels) {
                let cell = if level == 1 { cells.next() } else { Some(Cell::None) };
                row.push(cell.ok_or_else(|| other(format!("`{name}` has too few values")))?);
            }
        }
    }
    Ok(rows)
}

/// Writes rows to a file, whole or not at all.
///
/// # Errors
/// The writer's and the system's.
pub fn write(
    path: &Path,
    columns: &[(String, Kind)],
    rows: &[Vec<Cell>],
    with: &[(&str, &str)],
) -> Result<(), StudyError> {
    let bytes = encode(path, columns, rows, with)?;
    sunglint_formats::atomic::write_file(path, &bytes, sunglint_formats::atomic::Overwrite::Allow)?;
    Ok(())
}
