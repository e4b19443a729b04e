//! Tables with times, as people have them: ECSV, or CSV with the names in its first line.

use crate::{Column, ParseError, Table, Values, ecsv};
use std::path::Path;

/// A table from a text: ECSV where it says so, else comma-separated values with the names in the first line and notes after `#`. A
/// column in which every value is a number is one of numbers (nothing counts as NaN), any other one of texts.
///
/// # Errors
/// No names, a row with another number of fields, with its line.
pub fn read_str(path: &Path, text: &str) -> Result<Table, ParseError> {
    if text.starts_with("# %ECSV") {
        return ecsv::read_str(path, text);
    }
    let mut rows = text.lines().enumerate().filter(|(_, line)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    let Some((first, names)) = rows.next() else {
        return Err(ParseError::new(path, "no line", "names of columns, then rows"));
    };
    let names: Vec<&str> = names.split(',').map(str::trim).collect();
    if let [one] = names[..]
        && one.contains([';', '\t'])
    {
        let error = ParseError::new(path, format!("`{one}`"), "names separated by commas");
        let hints: Vec<&str> = rows.filter_map(|(_, row)| hint(&names, row)).collect();
        let of = hints.iter().find(|h| **h == BOTH).or(hints.first()).copied();
        return Err(error.at_line(first as u64 + 1).with_hint(of.unwrap_or(COLUMNS)));
    }
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    for (line, row) in rows {
        let fields: Vec<&str> = row.split(',').map(str::trim).collect();
        if fields.len() != names.len() {
            let found = format!("{} fields", fields.len());
            let expected = format!("{}, as many as names", names.len());
            let error = ParseError::new(path, found, expected).at_line(line as u64 + 1);
            return Err(match hint(&names, row) {
                Some(hint) => error.with_hint(hint),
                None => error,
            });
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

const BOTH: &str = "semicolons or tabs stand between the columns and a comma is in the numbers: columns are separated by commas, decimals by points";
const COLUMNS: &str = "columns are separated by commas, not by semicolons or tabs";

/// Returns a hint for a row with another number of fields: semicolons or tabs between the columns, a comma in each number.
fn hint(names: &[&str], row: &str) -> Option<&'static str> {
    let other = row.contains([';', '\t']);
    let fields = if other { row.split([';', '\t']).count() } else { row.split(',').count() };
    // "12,5" is two fields, so that with all numbers written so there are up to twice as many; or one number in quotes is cut in two.
    let decimal = |field: &str| {
        let field = field.trim().trim_matches('"');
        let parts: Vec<&str> = field.split(',').collect();
        let digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        parts.len() == 2 && digits(parts[0].trim_start_matches(['-', '+'])) && digits(parts[1])
    };
    let commas = if other {
        row.split([';', '\t']).any(decimal)
    } else {
        let quoted = row.split('"').skip(1).step_by(2).any(decimal);
        quoted || (fields > names.len() && row.split(',').all(|f| f.trim().parse::<f64>().is_ok()))
    };
    match (other, commas) {
        (true, true) => Some(BOTH),
        (true, false) => Some(COLUMNS),
        (false, true) => {
            Some("is there a decimal comma in a number? Decimals are separated by points")
        }
        (false, false) => None,
    }
}
