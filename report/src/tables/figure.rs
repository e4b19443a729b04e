//! Figures of the tables that are curves: over wavelength, wavenumber, altitude or time.

use crate::plot::{Axis, Figure, Panel, Series};
use std::ops::Range;
use sunglint_formats::{Column, Table, Values};

/// So many lines are told apart in a panel.
const MOST_LINES: usize = 8;
/// Abscissae of tables: the beginning of the column's name, and the axis.
const ABSCISSAE: [(&str, &str); 4] = [
    ("wavelength_nm", "vacuum wavelength (nm)"),
    ("wavenumber_cm1", "wavenumber (cm⁻¹)"),
    ("altitude_km", "altitude (km)"),
    ("mjd_utc", "modified Julian date (UTC)"),
];

/// The figure of a table; `None` for one that is no curve.
pub(super) fn figure(name: &str, table: &Table) -> Option<Figure> {
    let at = table.columns.iter().take(2).position(|c| abscissa(c).is_some())?;
    let (label, x) = (abscissa(&table.columns[at])?, numbers(&table.columns[at])?);
    let groups = match at.checked_sub(1).map(|group| &table.columns[group].values) {
        Some(Values::Text(groups)) => groups_of(groups),
        _ => vec![(String::new(), 0..table.rows())],
    };
    let others: Vec<&Column> =
        table.columns[at + 1..].iter().filter(|c| numbers(c).is_some()).collect();
    if others.is_empty() {
        return None;
    }
    let mut left_out = 0;
    let panels = if groups.len() > 1 {
        // A panel a column, in it a line a group.
        let shown = spread(groups.len());
        left_out = groups.len() - shown.len();
        let panel = |column: &&Column| {
            let lines = shown.iter().map(|g| (groups[*g].0.clone(), *column, groups[*g].1.clone()));
            panel(label, x, axis_label(column), lines.collect())
        };
        others.iter().map(panel).collect()
    } else {
        // A panel a unit, in it a line a column.
        let mut units: Vec<(String, Vec<&Column>)> = Vec::new();
        for column in others {
            match units.iter_mut().find(|(unit, _)| *unit == unit_of(column)) {
                Some((_, columns)) => columns.push(column),
                None => units.push((unit_of(column), vec![column])),
            }
        }
        let panel = |(unit, columns): (String, Vec<&Column>)| {
            let shown = spread(columns.len());
            left_out += columns.len() - shown.len();
            let y = match (&columns[..], unit.as_str()) {
                ([only], _) => axis_label(only),
                (_, "") => "value".to_owned(),
                (_, unit) => unit.to_owned(),
            };
            let line = |i: &usize| (columns[*i].name.clone(), columns[*i], 0..table.rows());
            panel(label, x, y, shown.iter().map(line).collect())
        };
        units.into_iter().map(panel).collect()
    };
    let mut title = format!("{name}: {}", table.meta_text("title").unwrap_or_default());
    if left_out > 0 {
        title += &format!(" (lines not drawn: {left_out})");
    }
    Some(Figure { title, panels })
}

fn panel(
    x_label: &str,
    x: &[f64],
    y_label: String,
    lines: Vec<(String, &Column, Range<usize>)>,
) -> Panel {
    let named = lines.len() > 1;
    let mut series = Vec::new();
    let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
    for (i, (name, column, rows)) in lines.into_iter().enumerate() {
        let values = numbers(column).unwrap_or_default();
        let points: Vec<(f64, f64)> = rows.map(|row| (x[row], values[row])).collect();
        for (_, y) in points.iter().filter(|p| p.1.is_finite()) {
            (lo, hi) = (lo.min(*y), hi.max(*y));
        }
        series.push(Series::line(if named { name } else { String::new() }, i, points));
    }
    // What runs over more than three decades is seen on a logarithmic axis only.
    let y = if lo > 0.0 && hi > 1e3 * lo { Axis::log(y_label) } else { Axis::linear(y_label) };
    Panel::new(Axis::linear(x_label), y, series)
}

fn abscissa(column: &Column) -> Option<&'static str> {
    ABSCISSAE.iter().find(|(name, _)| *name == column.name).map(|(_, label)| *label)
}

fn numbers(column: &Column) -> Option<&[f64]> {
    match &column.values {
        Values::F64(values) => Some(values),
        _ => None,
    }
}

/// The unit, or for a pure number what its name ends with: parts per million stay apart from pure numbers.
fn unit_of(column: &Column) -> String {
    let suffix = if column.name.ends_with("_ppmv") { "ppmv" } else { "" };
    column.unit.clone().unwrap_or_else(|| suffix.to_owned())
}

fn axis_label(column: &Column) -> String {
    column.unit.as_ref().map_or(column.name.clone(), |unit| format!("{} ({unit})", column.name))
}

/// Names and rows of runs of one name.
fn groups_of(names: &[Option<String>]) -> Vec<(String, Range<usize>)> {
    let mut groups: Vec<(String, Range<usize>)> = Vec::new();
    for (row, name) in names.iter().enumerate() {
        let name = name.clone().unwrap_or_default();
        match groups.last_mut() {
            Some((last, rows)) if *last == name => rows.end = row + 1,
            _ => groups.push((name, row..row + 1)),
        }
    }
    groups
}

/// At most so many as can be told apart, spread evenly from the first to the last.
fn spread(n: usize) -> Vec<usize> {
    if n <= MOST_LINES {
        return (0..n).collect();
    }
    (0..MOST_LINES).map(|i| i * (n - 1) / (MOST_LINES - 1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_radiometry::tables;

    /// Truth: which tables are curves, read from their headers; a line a band, a material, a gas.
    #[test]
    fn curves_have_figures_and_catalogues_none() {
        let lines = |name: &str| -> Option<Vec<usize>> {
            let figure = figure(name, tables::get(name).unwrap().table())?;
            assert!(figure.svg().is_ok(), "{name}");
            Some(figure.panels.iter().map(|p| p.series.len()).collect())
        };
        assert_eq!(lines("sun"), Some(vec![1]));
        assert_eq!(lines("bessell_ubvri"), Some(vec![5]));
        assert_eq!(lines("refractive_indices"), Some(vec![8, 8]));
        assert_eq!(lines("stellar_library"), Some(vec![8]));
        assert_eq!(lines("aerosols"), Some(vec![6]));
        assert_eq!(lines("air_us_standard"), Some(vec![1, 1, 1, 7]));
        assert_eq!(lines("earth_orientation"), Some(vec![2, 1]));
        assert_eq!(lines("bright_stars"), None);
        for table in tables::all().iter().filter(|t| t.name != "bright_stars") {
            assert!(lines(table.name).is_some(), "{}", table.name);
        }
    }

    #[test]
    fn groups_are_runs_of_one_name() {
        let names: Vec<Option<String>> = ["a", "a", "b"].map(|n| Some(n.to_owned())).into();
        assert_eq!(groups_of(&names), [("a".to_owned(), 0..2), ("b".to_owned(), 2..3)]);
        assert_eq!(spread(3), [0, 1, 2]);
        assert_eq!(spread(9).len(), 8);
        assert_eq!(spread(100)[7], 99);
    }
}
