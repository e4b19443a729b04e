//! Light curves of asteroids as DAMIT keeps them for inversion (`lc.txt`), and the same without its lines of counts.
//!
//! The layout, as convexinv reads it (from memory; the catalogue J/A+A/465/331 has the same rows): the number of light curves; before each the number of its points and 1 for a
//! calibrated one, else 0; then a row for each point: Julian date without the light's way, intensity, and the places of Sun and Earth seen from the asteroid, ecliptic, au.

use super::shortened;
use crate::text::counted;
use crate::{Column, ParseError, Table, Values};
use glam::DVec3;
use std::path::Path;

/// Distance of Earth and Sun, au, with a margin: the ellipse's ends are 0.983 and 1.017, the barycentre may stand for the Sun.
const EARTH_TO_SUN_AU: std::ops::RangeInclusive<f64> = 0.97..=1.03;
const EXPECTED: &str = "rows of 8 numbers as DAMIT's lc.txt has them: Julian date, intensity, and x, y, z of Sun and Earth, au";

/// A line's number, from 1, and its numbers.
type Line = (u64, Vec<f64>);

/// Lines of numbers alone, blank ones left out; `None` where a line is something else.
fn numbers(text: &str) -> Option<Vec<Line>> {
    let filled = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    filled
        .map(|(i, line)| {
            let words: Option<Vec<f64>> = line.split_whitespace().map(|w| w.parse().ok()).collect();
            Some((i as u64 + 1, words.filter(|w| w.iter().all(|v| v.is_finite()))?))
        })
        .collect()
}

/// Returns true for a row: the Earth is as far from the Sun as it is, seen from anywhere.
fn is_row(row: &[f64]) -> bool {
    let &[jd, intensity, sx, sy, sz, ex, ey, ez] = row else { return false };
    let apart = DVec3::new(sx, sy, sz).distance(DVec3::new(ex, ey, ez));
    (2_300_000.0..2_500_000.0).contains(&jd) && intensity >= 0.0 && EARTH_TO_SUN_AU.contains(&apart)
}

/// A whole number above 0.
fn count(value: f64) -> Option<usize> {
    (value >= 1.0 && value.fract() == 0.0 && value < 1e9).then_some(value as usize)
}

/// The table of a text in this layout; `None` for any other text. Shapes (`shape.txt`) are refused by name.
///
/// # Errors
/// A row that is none, other counts than rows: with the line.
pub(super) fn read(path: &Path, text: &str) -> Option<Result<Table, ParseError>> {
    // Most texts are something else by their first line.
    let first = text.lines().find(|line| !line.trim().is_empty())?;
    first.split_whitespace().next()?.parse::<f64>().ok()?;
    let lines = numbers(text)?;
    let second = lines.get(1).map(|(_, n)| n.as_slice());
    match (lines[0].1.as_slice(), second) {
        (&[vertices, facets], Some([_, _, _])) => {
            let (vertices, facets) = (count(vertices)?, count(facets)?);
            (lines.len() == 1 + vertices + facets).then_some(())?;
            let found =
                format!("a shape of {vertices} vertices and {facets} facets (DAMIT's shape.txt)");
            let error = ParseError::new(path, found, "light curves (lc.txt)").at_line(1);
            Some(Err(error.with_hint("as a mesh, make an OBJ file of it: v before each vertex, f before each facet, without the first line")))
        }
        (&[curves], Some(&[_, calibrated])) if calibrated == 0.0 || calibrated == 1.0 => {
            Some(with_counts(path, count(curves)?, &lines))
        }
        (row, _) if is_row(row) => Some(without_counts(path, &lines)),
        _ => None,
    }
}

fn with_counts(path: &Path, curves: usize, lines: &[Line]) -> Result<Table, ParseError> {
    let (mut rows, mut calibrated) = (Rows::default(), Vec::new());
    let mut rest = &lines[1..];
    let end = |expected: String| ParseError::new(path, "the end of the file", expected);
    for curve in 1..=curves {
        let Some(((line, head), after)) = rest.split_first() else {
            return Err(end(format!(
                "light curve {curve} of {curves}, as line {} says",
                lines[0].0
            )));
        };
        let head_line = *line;
        let points = match head.as_slice() {
            &[points, kind @ (0.0 | 1.0)] => count(points).map(|points| (points, kind)),
            _ => None,
        };
        let Some((points, kind)) = points else {
            let expected = format!("the number of points of light curve {curve}, and 0 or 1");
            return Err(ParseError::new(path, shown(head), expected).at_line(head_line));
        };
        calibrated.push(kind == 1.0);
        if after.len() < points {
            let expected = format!("{points} rows, as line {head_line} says");
            return Err(end(format!("{expected}; there are {}", after.len())));
        }
        let (own, after) = after.split_at(points);
        for (line, row) in own {
            if !is_row(row) {
                let error = ParseError::new(path, shown(row), EXPECTED).at_line(*line);
                return Err(error.with_hint(format!("line {head_line} says {points} of them")));
            }
            rows.push(row, curve);
        }
        rest = after;
    }
    if let Some((line, row)) = rest.first() {
        let expected = format!(
            "the end after {}, as line {} says",
            counted(curves, "light curve"),
            lines[0].0
        );
        return Err(ParseError::new(path, shown(row), expected).at_line(*line));
    }
    Ok(rows.table())
}

fn without_counts(path: &Path, lines: &[Line]) -> Result<Table, ParseError> {
    let mut rows = Rows::default();
    let (mut curve, mut last) = (1, lines[0].0);
    for (line, row) in lines {
        if !is_row(row) {
            return Err(ParseError::new(path, shown(row), EXPECTED).at_line(*line));
        }
        // Blank lines part the curves of such files.
        curve += usize::from(*line > last + 1);
        last = *line;
        rows.push(row, curve);
    }
    Ok(rows.table())
}

fn shown(row: &[f64]) -> String {
    let words: Vec<String> = row.iter().map(f64::to_string).collect();
    format!("`{}`", shortened(&words.join(" ")))
}

#[derive(Default)]
struct Rows {
    jd: Vec<f64>,
    intensity: Vec<f64>,
    phase_deg: Vec<f64>,
    curve: Vec<Option<String>>,
}

impl Rows {
    fn push(&mut self, row: &[f64], curve: usize) {
        let &[jd, intensity, sx, sy, sz, ex, ey, ez] = row else { return };
        let (sun, earth) = (DVec3::new(sx, sy, sz), DVec3::new(ex, ey, ez));
        self.jd.push(jd);
        self.intensity.push(intensity);
        self.phase_deg.push(sun.angle_between(earth).to_degrees());
        self.curve.push(Some(curve.to_string()));
    }

    fn table(self) -> Table {
        let text = Column {
            name: "session".into(),
            unit: None,
            description: None,
            values: Values::Text(self.curve),
        };
        let columns = vec![
            Column::f64("jd", Some("d"), self.jd),
            Column::f64("intensity", None, self.intensity),
            Column::f64("phase_deg", Some("deg"), self.phase_deg),
            text,
        ];
        let notes = vec![
            "jd: the light's way to the observer is taken off the times",
            "each light curve has a zero point of its own",
        ];
        let mut table = Table { columns, ..Table::default() };
        table.meta.insert(super::words::READING_NOTES.into(), notes.into());
        table
    }
}
