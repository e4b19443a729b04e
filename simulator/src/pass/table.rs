//! Tables with times, as people have them: ECSV, or CSV with the names in its first line.

use std::path::Path;
use sunglint_formats::{Column, ParseError, Table, Values, ecsv};

/// A table from a text: ECSV where it says so, else comma-separated values with the names in the first line and notes after `#`. A
/// column in which every value is a number is one of numbers (nothing counts as NaN), any other one of texts.
///
/// # Errors
/// No names, a row with another number of fields, with its line.
pub fn any(path: &Path, text: &str) -> Result<Table, ParseError> {
    if text.starts_with("# %ECSV") {
        return ecsv::read_str(path, text);
    }
    let mut rows = text.lines().enumerate().filter(|(_, line)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    let Some((_, names)) = rows.next() else {
        return Err(ParseError::new(path, "no line", "names of columns, then rows"));
    };
    let names: Vec<&str> = names.split(',').map(str::trim).collect();
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    for (line, row) in rows {
        let fields: Vec<&str> = row.split(',').map(str::trim).collect();
        if fields.len() != names.len() {
            let found = format!("{} fields", fields.len());
            let expected = format!("{}, as many as names", names.len());
            return Err(ParseError::new(path, found, expected).at_line(line as u64 + 1));
        }
        for (column, field) in columns.iter_mut().zip(fields) {
            column.push(field.trim_matches('"').to_owned());
        }
    }
    let column = |(name, texts): (&str, Vec<String>)| {
        let number = |text: &String| {
            if text.is_empty() { Some(f64::NAN) } else { text.parse::<f64>().ok() }
        };
        let values = match texts.iter().map(number).collect::<Option<Vec<f64>>>() {
            Some(numbers) => Values::F64(numbers),
            None => Values::Text(texts.into_iter().map(Some).collect()),
        };
        Column { name: name.to_owned(), unit: None, description: None, values }
    };
    let columns = names.into_iter().zip(columns).map(column).collect();
    Ok(Table { columns, ..Table::default() })
}
