//! STL, binary and text: a soup of triangles, whose equal corners are made one here.
//!
//! Normals of the file are not used: the order of the corners says what is outside, and many programs write zeros for normals.

use super::Mesh;
use super::obj::shorten;
use super::read::NamedMesh;
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;
use sunglint_formats::ParseError;

/// A name of 80 bytes and the number of triangles.
const HEADER: usize = 84;
/// A normal, three corners, an attribute.
const RECORD: usize = 50;

pub(super) fn parse(path: &Path, bytes: Vec<u8>) -> Result<Vec<NamedMesh>, ParseError> {
    let promised = bytes.get(80..HEADER).map(|n| u32::from_le_bytes([n[0], n[1], n[2], n[3]]));
    let wanted = promised.map(|n| HEADER as u64 + RECORD as u64 * u64::from(n));
    if wanted == Some(bytes.len() as u64) {
        return binary(path, &bytes);
    }
    // Binary files may begin with `solid` as well; text has no zeros and goes on with `facet`.
    let start = bytes.trim_ascii_start();
    let begins = start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    if begins && !bytes[..bytes.len().min(512)].contains(&0) {
        let text = sunglint_formats::read::decode(path, bytes)?;
        return Text { path, line: 0, solids: Vec::new() }.parse(&text);
    }
    Err(match (promised, wanted) {
        (Some(n), Some(wanted)) => {
            let found = format!("{} bytes", bytes.len());
            let expected = format!("{wanted} bytes for the {n} triangles of its header");
            ParseError::new(path, found, expected).with_hint("it may be cut off")
        }
        _ => ParseError::new(path, format!("{} bytes", bytes.len()), "an STL of 84 bytes or more"),
    })
}

/// Makes equal corners one.
#[derive(Default)]
struct Indexed {
    mesh: Mesh,
    known: HashMap<[u64; 3], u32>,
}

impl Indexed {
    fn push(&mut self, corners: [DVec3; 3]) {
        let Self { mesh, known } = self;
        let triangle = corners.map(|corner| {
            // Adding 0 makes −0 the same as 0.
            let corner = corner + DVec3::ZERO;
            *known.entry(corner.to_array().map(f64::to_bits)).or_insert_with(|| {
                mesh.vertices.push(corner);
                mesh.vertices.len() as u32 - 1
            })
        });
        mesh.triangles.push(triangle);
    }
}

fn binary(path: &Path, bytes: &[u8]) -> Result<Vec<NamedMesh>, ParseError> {
    let mut all = Indexed::default();
    for (t, record) in bytes[HEADER..].chunks_exact(RECORD).enumerate() {
        let value = |k: usize| {
            let at = 12 + 4 * k;
            f64::from(f32::from_le_bytes([
                record[at],
                record[at + 1],
                record[at + 2],
                record[at + 3],
            ]))
        };
        let corners = [0, 3, 6].map(|k| DVec3::new(value(k), value(k + 1), value(k + 2)));
        if let Some(bad) = corners.iter().find(|corner| !corner.is_finite()) {
            let error = ParseError::new(path, format!("{bad}"), "finite coordinates");
            return Err(error.in_field(format!("triangle {t}")));
        }
        all.push(corners);
    }
    Ok(vec![NamedMesh { names: vec![], mesh: all.mesh }])
}

struct Text<'p> {
    path: &'p Path,
    line: u64,
    solids: Vec<(Vec<String>, Indexed)>,
}

impl Text<'_> {
    fn wrong(&self, found: &str, expected: &str) -> ParseError {
        let found = format!("`{}`", shorten(found.trim()));
        ParseError::new(self.path, found, expected).at_line(self.line)
    }

    fn parse(mut self, text: &str) -> Result<Vec<NamedMesh>, ParseError> {
        let mut corners: Vec<DVec3> = Vec::new();
        // What may come next; the statements stand one to a line.
        let mut expected: &[&str] = &["solid"];
        for line in text.lines() {
            self.line += 1;
            let Some(first) = line.split_whitespace().next() else { continue };
            let word = first.to_ascii_lowercase();
            if !expected.contains(&word.as_str()) {
                return Err(self.wrong(line, &expected.join(" or ")));
            }
            let rest = line.trim_start()[first.len()..].trim();
            expected = match word.as_str() {
                "solid" => {
                    let names = if rest.is_empty() { vec![] } else { vec![rest.to_owned()] };
                    self.solids.push((names, Indexed::default()));
                    &["facet", "endsolid"]
                }
                "facet" => &["outer"],
                "outer" => &["vertex"],
                "vertex" => {
                    corners.push(self.vertex(line, rest)?);
                    if corners.len() < 3 { &["vertex"] } else { &["endloop"] }
                }
                "endloop" => &["endfacet"],
                "endfacet" => {
                    if let (Some((_, solid)), [a, b, c]) = (self.solids.last_mut(), &corners[..]) {
                        solid.push([*a, *b, *c]);
                    }
                    corners.clear();
                    &["facet", "endsolid"]
                }
                _ => &["solid"],
            };
        }
        if expected != ["solid"] {
            return Err(self.wrong("the end of the file", &expected.join(" or ")));
        }
        let named = |(names, solid): (Vec<String>, Indexed)| NamedMesh { names, mesh: solid.mesh };
        Ok(self.solids.into_iter().map(named).collect())
    }

    fn vertex(&self, line: &str, rest: &str) -> Result<DVec3, ParseError> {
        let expected = "vertex with three finite coordinates";
        let numbers: Option<Vec<f64>> = rest
            .split_whitespace()
            .map(|word| word.parse::<f64>().ok().filter(|x| x.is_finite()))
            .collect();
        let three = numbers.and_then(|n| <[f64; 3]>::try_from(n).ok());
        three.map(DVec3::from_array).ok_or_else(|| self.wrong(line, expected))
    }
}
