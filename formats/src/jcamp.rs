//! Spectra in JCAMP-DX 4.24 and 5.0x (McDonald and Wilks 1988, Appl. Spectrosc. 42, 151): one block with `XYDATA=(X++(Y..Y))`, plain or compressed (PAC, SQZ, DIF, DUP), or
//! `XYPOINTS=(XY..XY)`.

use crate::error::{ParseError, excerpt};
use std::path::Path;

/// A spectrum as its file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Jcamp {
    /// `##TITLE`.
    pub title: String,
    /// `##XUNITS`, as it is written.
    pub x_unit: String,
    /// `##YUNITS`, as it is written.
    pub y_unit: String,
    /// Positions, in the order of the file.
    pub x: Vec<f64>,
    /// Values, as many as there are points on the axis.
    pub y: Vec<f64>,
    /// The line of the file on which each value stands, counted from 1.
    pub line: Vec<u64>,
}

/// Reads a spectrum from text; `path` names it in errors.
///
/// # Errors
/// A [`ParseError`] with line and label: no JCAMP-DX, several blocks, another form of data, numbers that are none or missing, positions or counts that do not agree with
/// the header (abscissae to 1 % of a step or the header's own rounding, DIF check values to 1e-6).
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<Jcamp, ParseError> {
    read_str_at(path.as_ref(), text)
}

fn read_str_at(path: &Path, text: &str) -> Result<Jcamp, ParseError> {
    let mut header = Header::default();
    let mut data: Option<(Form, u64, Lines)> = None;
    let mut in_data = false;
    for (k, raw) in text.lines().enumerate() {
        let number = k as u64 + 1;
        let line = raw.split("$$").next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let Some(record) = line.strip_prefix("##") else {
            if let (true, Some((_, _, lines))) = (in_data, &mut data) {
                lines.push((number, line.to_owned()));
            }
            continue;
        };
        let Some((label, value)) = record.split_once('=') else {
            let error = ParseError::new(path, excerpt(line), "a label, `=` and a value");
            return Err(error.at_line(number));
        };
        in_data = false;
        let letters = label.chars().filter(|c| !matches!(c, ' ' | '-' | '/' | '_'));
        let label: String = letters.collect::<String>().to_uppercase();
        let value = value.trim();
        match label.as_str() {
            "XYDATA" | "XYPOINTS" => {
                let form: String = value.chars().filter(|c| !c.is_whitespace()).collect();
                let form = match form.to_uppercase().as_str() {
                    "(X++(Y..Y))" => Form::Steps,
                    "(XY..XY)" => Form::Pairs,
                    _ => {
                        let expected = "(X++(Y..Y)) or (XY..XY)";
                        let error = ParseError::new(path, excerpt(value), expected);
                        return Err(error.at_line(number).in_field(label));
                    }
                };
                if data.is_some() {
                    let error = ParseError::new(path, "a second spectrum", "one in a file");
                    return Err(error.at_line(number).in_field(label));
                }
                data = Some((form, number, Vec::new()));
                in_data = true;
            }
            "NTUPLES" | "BLOCKS" | "PEAKTABLE" => {
                let error = ParseError::new(path, format!("##{label}"), "a file of one spectrum");
                return Err(error.at_line(number).with_hint("export it as XYDATA, alone"));
            }
            "END" => break,
            _ => header.take(path, number, &label, value)?,
        }
    }
    if header.version.is_none() {
        let error = ParseError::new(path, "no ##JCAMP-DX", "a JCAMP-DX file");
        return Err(error.in_field("JCAMP-DX"));
    }
    let Some((form, number, lines)) = data else {
        return Err(ParseError::new(path, "no ##XYDATA", "a spectrum").in_field("XYDATA"));
    };
    let mut found = match form {
        Form::Steps => header.steps(path, &lines)?,
        Form::Pairs => header.pairs(path, &lines)?,
    };
    if let Some(points) = header.points.filter(|n| *n != found.x.len() as f64) {
        let error = ParseError::new(
            path,
            format!("{} values", found.x.len()),
            format!("##NPOINTS, {points}"),
        );
        return Err(error.at_line(number).in_field("NPOINTS").with_hint("the file may be cut off"));
    }
    if found.x.is_empty() {
        return Err(ParseError::new(path, "no value", "a spectrum").at_line(number));
    }
    (found.title, found.x_unit, found.y_unit) = (header.title, header.x_unit, header.y_unit);
    Ok(found)
}

/// Lines of data with their numbers.
type Lines = Vec<(u64, String)>;

enum Form {
    Steps,
    Pairs,
}

#[derive(Default)]
struct Header {
    version: Option<String>,
    title: String,
    x_unit: String,
    y_unit: String,
    first: Option<f64>,
    last: Option<f64>,
    points: Option<f64>,
    x_factor: Option<f64>,
    y_factor: Option<f64>,
}

impl Header {
    fn take(&mut self, path: &Path, line: u64, label: &str, value: &str) -> Result<(), ParseError> {
        let number = || {
            value.parse::<f64>().ok().filter(|v| v.is_finite()).map(Some).ok_or_else(|| {
                ParseError::new(path, excerpt(value), "a number").at_line(line).in_field(label)
            })
        };
        match label {
            "JCAMPDX" => self.version = Some(value.to_owned()),
            "TITLE" => value.clone_into(&mut self.title),
            "XUNITS" => value.clone_into(&mut self.x_unit),
            "YUNITS" => value.clone_into(&mut self.y_unit),
            "FIRSTX" => self.first = number()?,
            "LASTX" => self.last = number()?,
            "NPOINTS" => self.points = number()?,
            "XFACTOR" => self.x_factor = number()?,
            "YFACTOR" => self.y_factor = number()?,
            _ => {}
        }
        Ok(())
    }

    fn steps(&self, path: &Path, lines: &[(u64, String)]) -> Result<Jcamp, ParseError> {
        let need = |value: Option<f64>, name: &str| {
            value.ok_or_else(|| {
                ParseError::new(path, format!("no ##{name}"), "it: X++ needs it").in_field(name)
            })
        };
        let (first, last) = (need(self.first, "FIRSTX")?, need(self.last, "LASTX")?);
        let points = need(self.points, "NPOINTS")?;
        if !(points >= 1.0 && points.fract() == 0.0 && points < 1e8) {
            let error = ParseError::new(path, points.to_string(), "a number of values");
            return Err(error.in_field("NPOINTS"));
        }
        let step = if points > 1.0 { (last - first) / (points - 1.0) } else { 0.0 };
        let y_factor = self.y_factor.unwrap_or(1.0);
        let x_factor = self.x_factor.unwrap_or(1.0);
        let mut found = empty();
        // The last value of a line of differences is said again at the beginning of the next.
        let mut check: Option<f64> = None;
        for (number, line) in lines {
            let bad = |found: String, expected: &str| {
                ParseError::new(path, found, expected).at_line(*number).in_field("XYDATA")
            };
            let (x, mut values, differences) = decoded(line).ok_or_else(|| {
                bad(excerpt(line), "a position and values (AFFN, PAC, SQZ, DIF, DUP)")
            })?;
            if let (Some(before), Some(now)) = (check, values.first()) {
                if (now - before).abs() > 1e-6 * before.abs().max(1.0) {
                    let expected = format!("{before}, the last value of the line before");
                    return Err(bad(now.to_string(), &expected));
                }
                values.remove(0);
                found.x.pop();
                found.y.pop();
                found.line.pop();
                values.insert(0, before);
            }
            let expected = first + step * found.x.len() as f64;
            // Positions are often rounded to fewer digits than the header's.
            let rounding = 0.51 * x_factor.abs() * least_digit(line);
            if (x * x_factor - expected).abs()
                > (0.01 * step.abs()).max(rounding).max(1e-9 * expected.abs())
            {
                let expected = format!("{expected}, by FIRSTX, LASTX and NPOINTS");
                return Err(
                    bad((x * x_factor).to_string(), &expected).with_hint("a line may be missing")
                );
            }
            for value in &values {
                found.x.push(first + step * found.x.len() as f64);
                found.y.push(value * y_factor);
                found.line.push(*number);
            }
            check = if differences { values.last().copied() } else { None };
        }
        Ok(found)
    }

    fn pairs(&self, path: &Path, lines: &[(u64, String)]) -> Result<Jcamp, ParseError> {
        let mut found = empty();
        let (x_factor, y_factor) = (self.x_factor.unwrap_or(1.0), self.y_factor.unwrap_or(1.0));
        for (number, line) in lines {
            let texts: Vec<&str> =
                line.split([',', ';', ' ', '\t']).filter(|t| !t.is_empty()).collect();
            let numbers: Option<Vec<f64>> = texts.iter().map(|t| t.parse().ok()).collect();
            let numbers = numbers.filter(|n| n.len() % 2 == 0 && n.iter().all(|v| v.is_finite()));
            let Some(numbers) = numbers else {
                let error = ParseError::new(path, excerpt(line), "pairs of numbers");
                return Err(error.at_line(*number).in_field("XYPOINTS"));
            };
            for pair in numbers.chunks_exact(2) {
                found.x.push(pair[0] * x_factor);
                found.y.push(pair[1] * y_factor);
                found.line.push(*number);
            }
        }
        Ok(found)
    }
}

fn empty() -> Jcamp {
    Jcamp {
        title: String::new(),
        x_unit: String::new(),
        y_unit: String::new(),
        x: Vec::new(),
        y: Vec::new(),
        line: Vec::new(),
    }
}

/// Returns the value of one unit in the last digit of a line's first number.
fn least_digit(line: &str) -> f64 {
    let number: String =
        line.chars().take_while(|c| c.is_ascii_digit() || matches!(c, '.' | '+' | '-')).collect();
    match number.split_once('.') {
        Some((_, decimals)) => 10_f64.powi(-(decimals.len() as i32)),
        None => 1.0,
    }
}

/// The position and the values of a line, and whether it ends with a difference. None where it makes no sense.
fn decoded(line: &str) -> Option<(f64, Vec<f64>, bool)> {
    let mut tokens: Vec<(Kind, String)> = Vec::new();
    let mut letters = line.chars().peekable();
    // After a gap or an exponent's letter.
    let (mut gap, mut exponent) = (true, false);
    while let Some(c) = letters.next() {
        let was_exponent = std::mem::take(&mut exponent);
        match c {
            ' ' | '\t' | ',' | ';' => {
                gap = true;
                continue;
            }
            '0'..='9' | '.' if !gap => {
                tokens.last_mut()?.1.push(c);
                continue;
            }
            // An exponent has a sign; without one it is the digit 5.
            'E' | 'e'
                if !gap
                    && tokens.last().is_some_and(|(kind, _)| *kind == Kind::Plain)
                    && matches!(letters.peek(), Some('+' | '-')) =>
            {
                tokens.last_mut()?.1.push('e');
                exponent = true;
                continue;
            }
            '+' | '-' if was_exponent => {
                tokens.last_mut()?.1.push(c);
                continue;
            }
            _ => {}
        }
        gap = false;
        tokens.push(match c {
            '0'..='9' | '.' | '+' | '-' => (Kind::Plain, c.to_string()),
            '@' | 'A'..='I' => (Kind::Squeezed, digit(c, '@')),
            'a'..='i' => (Kind::Squeezed, format!("-{}", digit(c, '`'))),
            '%' => (Kind::Difference, "0".into()),
            'J'..='R' => (Kind::Difference, digit(c, 'I')),
            'j'..='r' => (Kind::Difference, format!("-{}", digit(c, 'i'))),
            'S'..='Z' => (Kind::Repeat, digit(c, 'R')),
            's' => (Kind::Repeat, "9".into()),
            _ => return None,
        });
    }
    let mut numbers = tokens.into_iter();
    let x: f64 = numbers.next().filter(|(kind, _)| *kind == Kind::Plain)?.1.parse().ok()?;
    let mut values: Vec<f64> = Vec::new();
    let mut last: Option<(Kind, f64)> = None;
    for (kind, text) in numbers {
        let number: f64 = text.parse().ok()?;
        if !number.is_finite() {
            return None;
        }
        let add = |values: &mut Vec<f64>, kind, number: f64| {
            let value = if kind == Kind::Difference { values.last()? + number } else { number };
            values.push(value);
            Some(())
        };
        if kind == Kind::Repeat {
            let (kind, number_before) = last?;
            // As often as it says, the first time among them; a line is no longer than a file.
            for _ in 1..(number as u64).min(1 << 20) {
                add(&mut values, kind, number_before)?;
            }
        } else {
            add(&mut values, kind, number)?;
            last = Some((kind, number));
        }
    }
    let ends = last.is_some_and(|(kind, _)| kind == Kind::Difference);
    Some((x, values, ends))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Plain,
    Squeezed,
    Difference,
    Repeat,
}

fn digit(c: char, zero: char) -> String {
    (c as u32 - zero as u32).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(data: &str, points: usize) -> String {
        format!(
            "##TITLE=a sample $$ remark\n##JCAMP-DX=4.24\n##DATA TYPE=INFRARED SPECTRUM\n##XUNITS=1/CM\n##YUNITS=REFLECTANCE\n##FIRSTX=599.860\n\
             ##LASTX={}\n##XFACTOR=1.0\n##YFACTOR=0.5\n##NPOINTS={points}\n##XYDATA=(X++(Y..Y))\n{data}\n##END=\n",
            599.86 + (points - 1) as f64
        )
    }

    /// Truth: the forms of one spectrum that the paper lists (McDonald and Wilks 1988, section 5: AFFN, PAC, SQZ, DIF, DUP of 1, 2, 3, 3, 2, 1, 0, −1, −2, −3), halved by YFACTOR.
    #[test]
    fn every_form_is_the_same_spectrum() {
        let expected = [1.0, 2.0, 3.0, 3.0, 2.0, 1.0, 0.0, -1.0, -2.0, -3.0].map(|v| 0.5 * v);
        for data in [
            "599.86 1 2 3 3 2 1 0 -1 -2 -3",
            "599.860,1.0E+00,2,3,3,2,1,0,-1,-2,-3.0",
            "600+1+2+3+3+2+1+0-1-2-3",
            "600ABCCBA@abc",
            "600AJJ%jjjjjj",
            "600AJT%jX",
            "599.86AJJ\n601.86C%jj\n604.86Ajjjj",
        ] {
            let read = read_str("a.jdx", &file(data, 10));
            let read = read.unwrap_or_else(|e| panic!("{data}: {e}"));
            assert_eq!(read.y, expected, "{data}");
            assert!((read.x[9] - 608.86).abs() < 1e-9 && read.x_unit == "1/CM");
            assert_eq!(read.title, "a sample");
        }
    }

    #[test]
    fn what_does_not_agree_is_refused() {
        let said = |text: &str| read_str("a.jdx", text).map(|_| ()).unwrap_err().to_string();
        assert!(
            said(&file("599.86 1 2 3", 4))
                .contains("NPOINTS: found 3 values, expected ##NPOINTS, 4")
        );
        assert!(
            said(&file("599.86 1 2 3\n607.86 4", 4)).contains("a.jdx:13: XYDATA: found 607.86")
        );
        assert!(said(&file("599.86AJJ\n601.86D%", 4)).contains("expected 3, the last value"));
        assert!(said(&file("599.86 1 ? 3", 3)).contains("a.jdx:12: XYDATA"));
        assert!(said("x,y\n1,2\n").contains("no ##JCAMP-DX"));
        let pairs = "##JCAMP-DX=5.01\n##XYPOINTS=(XY..XY)\n400, 1.5; 410, 2.5\n##END=\n";
        assert_eq!(read_str("a.jdx", pairs).map(|s| s.x), Ok(vec![400.0, 410.0]));
    }
}
