//! An ephemeris from an ECSV or CSV file, an OEM or a CPF.

use super::ephemeris::{Fault, fault};
use super::{Ephemeris, EphemerisRow, messages};
use glam::DVec3;
use std::path::Path;
use sunglint_formats::time::parse_utc;
use sunglint_formats::{FileError, ParseError, Table, ecsv};

const TIME: &str = "time_utc";
const POSITION: [&str; 3] = ["x_km", "y_km", "z_km"];
const VELOCITY: [&str; 3] = ["vx_km_s", "vy_km_s", "vz_km_s"];
/// Names of the GCRS's axes.
const FRAMES: [&str; 4] = ["GCRS", "GCRF", "ICRF", "ICRS"];

impl Ephemeris {
    /// Reads a table of positions: columns `time_utc` (ISO 8601), `x_km`, `y_km`, `z_km` in the GCRS, and all or none of
    /// `vx_km_s`, `vy_km_s`, `vz_km_s`. ECSV, or CSV with the names in its first line and notes after `#`. An ECSV's
    /// `name` in the metadata names the target, else the file does; its `frame`, if it has one, must be the GCRS.
    ///
    /// Orbit ephemeris messages (OEM, CCSDS 502.0-B-3, KVN and XML; one segment) and predictions of the laser ranging service (CPF) are
    /// known by their first line and turned into the GCRS.
    ///
    /// # Errors
    /// A file that cannot be read, or a [`ParseError`] with line and field: a column that is missing or unknown, a value
    /// that is no number, times that do not increase, a place inside the Earth or absurdly far, another frame, too few rows.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        Ok(Self::parse(path, &sunglint_formats::read::text(path)?)?)
    }

    /// Returns true for a text that begins as a table of positions and not as elements.
    pub fn is_one(text: &str) -> bool {
        let header = body(text).next().map_or("", |(_, line)| line);
        messages::is_one(text) || text.starts_with("# %ECSV") || header.contains(POSITION[0])
    }

    /// The same from a text. `path` names it in errors, and gives the target's name.
    ///
    /// # Errors
    /// The errors of [`Ephemeris::read`].
    pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Self, ParseError> {
        Self::parse_at(path.as_ref(), text)
    }

    fn parse_at(path: &Path, text: &str) -> Result<Self, ParseError> {
        let stem = path.file_stem().map_or_else(|| "target".into(), |s| s.to_string_lossy());
        let (name, rows, lines) = if messages::is_one(text) {
            let found = messages::read(path, text)?;
            (found.name.unwrap_or_else(|| stem.into_owned()), found.rows, found.lines)
        } else if text.starts_with("# %ECSV") {
            let table = ecsv::read_str(path, text)?;
            if let Some(frame) = table.meta_text("frame")
                && !FRAMES.contains(&frame.to_uppercase().as_str())
            {
                return Err(ParseError::new(path, format!("`{frame}`"), "GCRS, or nothing")
                    .in_field("frame"));
            }
            let name = table.meta_text("name").unwrap_or(&stem).to_owned();
            let lines: Vec<u64> = body(text).skip(1).map(|(line, _)| line).collect();
            (name, of_table(path, &table, &lines)?, lines)
        } else {
            let (rows, lines) = of_csv(path, text)?;
            (stem.into_owned(), rows, lines)
        };
        for (index, row) in rows.iter().enumerate() {
            let before = index.checked_sub(1).map(|i| &rows[i]);
            if let Some(Fault { field, value, expected }) = fault(before, row) {
                return Err(at(
                    &lines,
                    index,
                    ParseError::new(path, value, expected).in_field(field),
                ));
            }
        }
        Self::new(name, &rows).map_err(|error| match error {
            super::OrbitError::TooFewRows { rows, needed, .. } => {
                let expected = format!("at least {needed} (2 with velocities, 4 without)");
                ParseError::new(path, format!("{rows} rows"), expected)
            }
            other => ParseError::new(path, other.to_string(), "rows of positions"),
        })
    }
}

fn at(lines: &[u64], row: usize, error: ParseError) -> ParseError {
    match lines.get(row) {
        Some(&line) => error.at_line(line),
        None => error,
    }
}

/// The lines that are neither blank nor notes, with their numbers.
fn body(text: &str) -> impl Iterator<Item = (u64, &str)> {
    let numbered = text.lines().enumerate().map(|(index, line)| (index as u64 + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Returns true where the columns are those of an ephemeris, with velocities or without.
fn has_velocity(path: &Path, names: &[&str]) -> Result<bool, ParseError> {
    let known = || [TIME].into_iter().chain(POSITION).chain(VELOCITY);
    for (index, name) in names.iter().enumerate() {
        if !known().any(|k| k == *name) {
            let list = known().collect::<Vec<_>>().join(", ");
            let nearest = sunglint_formats::nearest_names(name, known(), 1);
            let error = ParseError::new(path, "an unknown column", format!("one of {list}"))
                .in_field(*name);
            return Err(match nearest.first() {
                Some(nearest) => error.with_hint(format!("did you mean `{nearest}`?")),
                None => error,
            });
        }
        if names[..index].contains(name) {
            return Err(
                ParseError::new(path, "the column twice", "each column once").in_field(*name)
            );
        }
    }
    let velocity = names.iter().any(|name| VELOCITY.contains(name));
    let needed = [TIME]
        .into_iter()
        .chain(POSITION)
        .chain(velocity.then_some(VELOCITY).into_iter().flatten());
    for name in needed {
        if !names.contains(&name) {
            return Err(
                ParseError::new(path, "no such column", "a column of that name").in_field(name)
            );
        }
    }
    Ok(velocity)
}

fn of_table(path: &Path, table: &Table, lines: &[u64]) -> Result<Vec<EphemerisRow>, ParseError> {
    let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    let velocity = has_velocity(path, &names)?;
    let in_file = |error: sunglint_formats::TableError| error.in_file(path);
    let vectors = |names: [&str; 3], unit: &str| -> Result<Vec<DVec3>, ParseError> {
        let [x, y, z] = names.map(|name| table.quantity(name, unit));
        let (x, y, z) = (x.map_err(in_file)?, y.map_err(in_file)?, z.map_err(in_file)?);
        Ok((0..table.rows()).map(|i| DVec3::new(x[i], y[i], z[i]) * 1e3).collect())
    };
    let positions = vectors(POSITION, "km")?;
    let velocities = if velocity { vectors(VELOCITY, "km / s")? } else { Vec::new() };
    let times = table.text(TIME).map_err(in_file)?;
    let row = |index: usize| {
        let text = times[index].as_deref().unwrap_or("");
        let epoch =
            parse_utc(text).map_err(|e| at(lines, index, e.in_file(path).in_field(TIME)))?;
        let velocity_m_s = velocities.get(index).copied();
        Ok(EphemerisRow { epoch, position_m: positions[index], velocity_m_s })
    };
    (0..table.rows()).map(row).collect()
}

fn of_csv(path: &Path, text: &str) -> Result<(Vec<EphemerisRow>, Vec<u64>), ParseError> {
    let mut lines = body(text);
    let Some((header_line, header)) = lines.next() else {
        return Err(ParseError::new(path, "no line", "column names: time_utc,x_km,y_km,z_km"));
    };
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let velocity = has_velocity(path, &names).map_err(|error| error.at_line(header_line))?;
    let place = |wanted: &str| names.iter().position(|name| *name == wanted).unwrap_or(0);
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    for (line, text) in lines {
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        if fields.len() != names.len() {
            let expected = format!("{} fields, one for each column", names.len());
            return Err(
                ParseError::new(path, format!("{} fields", fields.len()), expected).at_line(line)
            );
        }
        let number = |name: &str| {
            fields[place(name)].parse::<f64>().map_err(|_| {
                ParseError::new(path, format!("`{}`", fields[place(name)]), "a finite number")
                    .at_line(line)
                    .in_field(name)
            })
        };
        let vector = |names: [&str; 3]| -> Result<DVec3, ParseError> {
            Ok(DVec3::new(number(names[0])?, number(names[1])?, number(names[2])?) * 1e3)
        };
        let epoch = parse_utc(fields[place(TIME)])
            .map_err(|error| error.in_file(path).at_line(line).in_field(TIME))?;
        let velocity_m_s = if velocity { Some(vector(VELOCITY)?) } else { None };
        rows.push(EphemerisRow { epoch, position_m: vector(POSITION)?, velocity_m_s });
        numbers.push(line);
    }
    Ok((rows, numbers))
}
