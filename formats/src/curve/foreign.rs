//! Curves in layouts of others: refractiveindex.info's YAML and exports, and the ECOSTRESS spectral library. Files of the USGS library are known and refused, since their wavelengths stand elsewhere.
//!
//! By what these sources publish, from memory; the files of the tests are made by hand.

use super::{Curve, Factor, Rows, Unit};
use crate::error::{ParseError, excerpt};
use std::path::Path;

const UM_TO_NM: Factor = Factor::Times(1000.0);

/// Reads a curve where the text is in one of these layouts.
pub(super) fn read(
    path: &Path,
    text: &str,
    column: Option<&str>,
) -> Option<Result<Curve, ParseError>> {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let first = lines.find(|line| !line.starts_with('#'))?;
    if first.trim_start().starts_with("splib") && first.contains("Record=") {
        let error = ParseError::new(
            path,
            "values of the USGS spectral library without their wavelengths",
            "columns such as wavelength_um,reflectance",
        );
        return Some(Err(error.with_hint("the library has the wavelengths in a file of their own: put both beside each other, without the rows of -1.23e34")));
    }
    if first.starts_with("Name:")
        && ["X Units:", "Y Units:"].iter().all(|key| key_of(text, key).is_some())
    {
        return Some(ecostress(path, text, column));
    }
    if header(first).is_some() {
        return Some(exported(path, text).and_then(|indices| indices.curve(path, column)));
    }
    let is_yaml = |line: &str| line.trim_start().starts_with("- type:");
    if text.lines().any(|line| line.trim_end() == "DATA:") && text.lines().any(is_yaml) {
        return Some(database(path, text).and_then(|indices| indices.curve(path, column)));
    }
    None
}

/// A line with the number that stands for its wavelength in the file, and the value.
struct Row {
    line: u64,
    um: f64,
    value: f64,
}

/// n and k of refractiveindex.info, at wavelengths in µm.
#[derive(Default)]
struct Indices {
    n: Vec<Row>,
    k: Vec<Row>,
}

impl Indices {
    /// Takes a row's numbers, which are a wavelength and a value for each name.
    fn push(
        &mut self,
        path: &Path,
        line: u64,
        names: &[char],
        words: &[&str],
    ) -> Result<(), ParseError> {
        let numbers: Option<Vec<f64>> =
            words.iter().map(|w| w.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let numbers = numbers.filter(|n| n.len() == names.len() + 1).ok_or_else(|| {
            let expected =
                format!("{} numbers: a wavelength in µm and {}", names.len() + 1, list(names));
            ParseError::new(path, excerpt(&words.join(" ")), expected).at_line(line)
        })?;
        for (name, value) in names.iter().zip(&numbers[1..]) {
            let rows = if *name == 'n' { &mut self.n } else { &mut self.k };
            rows.push(Row { line, um: numbers[0], value: *value });
        }
        Ok(())
    }

    fn curve(self, path: &Path, column: Option<&str>) -> Result<Curve, ParseError> {
        let Some(column) = column else {
            return Err(ParseError::new(path, "refractive indices", "one column of values"));
        };
        let (rows, name) = match column.to_lowercase().as_str() {
            "n" => (&self.n, "n"),
            "k" => (&self.k, "k"),
            _ => {
                let error = ParseError::new(path, "refractive indices n and k", "this column");
                return Err(error.in_field(column));
            }
        };
        if rows.is_empty() {
            let error = ParseError::new(path, "no values of it", "n and k").in_field(name);
            return Err(error.with_hint("a table without one of them is none of a conductor"));
        }
        // Who asks for both takes them row by row.
        if !self.n.is_empty() && !self.k.is_empty() {
            let other = self.n.iter().zip(&self.k).find(|(n, k)| n.um != k.um);
            let line = other.map(|(_, k)| k.line);
            let line = line.or((self.n.len() != self.k.len()).then_some(self.k[0].line));
            if let Some(line) = line {
                let error =
                    ParseError::new(path, "k at other wavelengths than n", "both at the same");
                let hint = "bring them to the same wavelengths: a CSV file with wavelength_um,n,k";
                return Err(error.at_line(line).with_hint(hint));
            }
        }
        let (um, nm) = ("wavelength_um", "wavelength_nm");
        let mut found = Rows::new(path, um, Unit::Micrometre, nm.into(), name.into());
        for row in rows {
            found.push(row.line, &row.um.to_string(), UM_TO_NM.apply(row.um), row.value)?;
        }
        found.finish()
    }
}

fn list(names: &[char]) -> String {
    names.iter().map(char::to_string).collect::<Vec<_>>().join(" and ")
}

/// The columns after the wavelength, by a header of an export: `wl,n`, with tabs, or `"Wavelength, µm",n,k`.
fn header(line: &str) -> Option<Vec<char>> {
    let plain: String = line.chars().filter(|c| !c.is_whitespace() || *c == '\t').collect();
    let plain = plain.to_lowercase().replace(['"', '\u{feff}'], "").replace('\t', ",");
    let micro = ["wl,", "wavelength,µm,", "wavelength,μm,", "wavelength,um,"];
    let rest = micro.iter().find_map(|start| plain.strip_prefix(start))?;
    match rest {
        "n" => Some(vec!['n']),
        "k" => Some(vec!['k']),
        "n,k" => Some(vec!['n', 'k']),
        _ => None,
    }
}

/// Tables under one header, or two with a header each.
fn exported(path: &Path, text: &str) -> Result<Indices, ParseError> {
    let (mut found, mut names) = (Indices::default(), Vec::new());
    for (k, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        if let Some(next) = header(line) {
            names = next;
        } else {
            let words: Vec<&str> = line.split([',', '\t']).collect();
            found.push(path, k as u64 + 1, &names, &words)?;
        }
    }
    Ok(found)
}

/// The part of the database's YAML that holds tables.
fn database(path: &Path, text: &str) -> Result<Indices, ParseError> {
    let mut found = Indices::default();
    let (mut in_data, mut names) = (false, None);
    for (k, line) in text.lines().enumerate() {
        let (number, bare) = (k as u64 + 1, line.trim());
        if bare.is_empty() || bare.starts_with('#') {
            continue;
        }
        if !line.starts_with([' ', '\t', '-']) {
            in_data = bare == "DATA:";
        } else if !in_data {
        } else if let Some(kind) = bare.strip_prefix("- type:") {
            let columns: &[char] = match kind.trim().trim_matches(['"', '\'']) {
                "tabulated nk" => &['n', 'k'],
                "tabulated n" => &['n'],
                "tabulated k" => &['k'],
                other => {
                    let error = ParseError::new(path, excerpt(other), "tabulated n, k or nk");
                    let hint =
                        "a formula is not read: make a CSV file with wavelength_um,n,k of it";
                    return Err(error.at_line(number).in_field("type").with_hint(hint));
                }
            };
            names = Some(columns);
        } else if let Some(names) = names
            && !bare.starts_with("data:")
        {
            found.push(path, number, names, &bare.split_whitespace().collect::<Vec<_>>())?;
        }
    }
    Ok(found)
}

fn key_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().take(100).find_map(|line| line.trim().strip_prefix(key)).map(str::trim)
}

/// A header of keys, an empty line, and two columns.
fn ecostress(path: &Path, text: &str, column: Option<&str>) -> Result<Curve, ParseError> {
    let units = |key: &str| key_of(text, key).unwrap_or_default().to_lowercase();
    let (x, y) = (units("X Units:"), units("Y Units:"));
    let wrong = |field: &str, found: &str, expected: &str| {
        Err(ParseError::new(path, excerpt(found), expected).in_field(field))
    };
    let to_nm = match x.as_str() {
        x if x.contains("micromet") => UM_TO_NM,
        x if x.contains("nanomet") => Factor::One,
        x => return wrong("X Units", x, "micrometers or nanometers"),
    };
    if !y.contains("reflectance") || column.is_some_and(|c| !c.eq_ignore_ascii_case("reflectance"))
    {
        return wrong("Y Units", &y, column.unwrap_or("reflectance"));
    }
    let to_fraction = if y.contains("percent") { Factor::Over(100.0) } else { Factor::One };
    let unit = Unit::of("X", to_nm);
    let mut found = Rows::new(path, "X", unit, "wavelength_nm".into(), "reflectance".into());
    let lines = text.lines().enumerate().skip_while(|(_, line)| !line.trim().is_empty());
    for (k, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |k: usize| words.get(k)?.parse().ok().filter(|v: &f64| v.is_finite());
        let (Some(x), Some(y), 2) = (number(0), number(1), words.len()) else {
            return Err(ParseError::new(path, excerpt(line), "two numbers").at_line(k as u64 + 1));
        };
        found.push(k as u64 + 1, words[0], to_nm.apply(x), to_fraction.apply(y))?;
    }
    found.finish()
}
