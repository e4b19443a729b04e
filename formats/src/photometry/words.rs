//! Tables as texts whose words stand between blanks or tabs, and tables whose names stand in a comment.

use super::shortened;
use crate::{Column, ParseError, Table, Values};
use std::path::Path;

/// Begins of lines that are notes.
const NOTES: [char; 3] = ['#', '%', '!'];

/// A table of words between blanks, or one whose names stand in the last comment before the rows; `None` for any other, which is read as comma-separated values with names in the first line.
///
/// # Errors
/// Rows of numbers without names; a row with another number of words than there are names.
pub(super) fn read(path: &Path, text: &str) -> Result<Option<(&'static str, Table)>, ParseError> {
    let lines =
        || text.lines().enumerate().map(|(i, l)| (i, l.trim())).filter(|(_, l)| !l.is_empty());
    let Some((first, row)) = lines().find(|(_, l)| !l.starts_with(NOTES)) else {
        return Ok(None);
    };
    if row.contains(';') {
        return Ok(None);
    }
    let has_commas = row.contains(',');
    let words = |line: &str| -> Vec<String> {
        if has_commas {
            line.split(',').map(|w| w.trim().trim_matches('"').to_owned()).collect()
        } else {
            line.split_whitespace().map(|w| w.trim_matches('"').to_owned()).collect()
        }
    };
    let is_number = |word: &String| word.parse::<f64>().is_ok();
    let first_words = words(row);
    // Names are no numbers: a first line with one is a row.
    let has_names = !first_words.iter().any(is_number);
    if has_names && (has_commas || first_words.len() < 2) {
        return Ok(None);
    }
    let names = if has_names {
        first_words
    } else {
        let comment =
            text.lines().take(first).map(str::trim).filter(|l| l.starts_with(NOTES)).last();
        let named = comment.map(|l| words(l.trim_start_matches(NOTES).trim()));
        match named.filter(|names| names.len() == first_words.len() && !names.iter().any(is_number))
        {
            Some(names) => names,
            None if has_commas && !first_words.iter().all(is_number) => return Ok(None),
            None => {
                let found = format!("`{}`", shortened(row));
                let error = ParseError::new(path, found, "names of the columns in the first line");
                return Err(error.at_line(first as u64 + 1).with_hint(
                    "put a line such as `jd_utc magnitude sigma_mag` before the numbers, with as many names as columns",
                ));
            }
        }
    };
    if let Some(twice) = names.iter().enumerate().find(|(i, n)| names[..*i].contains(n)) {
        let found = format!("the name `{}` twice", shortened(twice.1));
        return Err(ParseError::new(path, found, "each name once").at_line(first as u64 + 1));
    }
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    let from = if has_names { first + 1 } else { first };
    for (number, line) in lines().filter(|(i, l)| *i >= from && !l.starts_with(NOTES)) {
        let fields = words(line);
        if fields.len() != names.len() {
            let found = format!("{} words", fields.len());
            let expected = format!("{}, as many as names", names.len());
            let error = ParseError::new(path, found, expected).at_line(number as u64 + 1);
            let hint = "a date and a time of day are one word: 2020-11-18T16:38:30; what is missing is nan";
            return Err(if has_commas { error } else { error.with_hint(hint) });
        }
        columns.iter_mut().zip(fields).for_each(|(column, field)| column.push(field));
    }
    let column = |(name, texts): (String, Vec<String>)| {
        let number = |text: &String| {
            if text.is_empty() { Some(f64::NAN) } else { text.parse::<f64>().ok() }
        };
        let values = match texts.iter().map(number).collect::<Option<Vec<f64>>>() {
            Some(numbers) => Values::F64(numbers),
            None => Values::Text(texts.into_iter().map(Some).collect()),
        };
        Column { name, unit: None, description: None, values }
    };
    let columns = names.into_iter().zip(columns).map(column).collect();
    let name = if has_commas { "CSV" } else { "text" };
    Ok(Some((name, Table { columns, ..Table::default() })))
}
