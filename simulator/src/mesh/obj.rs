//! Wavefront OBJ: polygons, with groups, objects and materials by name.
//!
//! Source: the format's "Advanced Visualizer" manual, appendix B1. Read are `v`, `vn`, `f`, `g`, `o`, `usemtl`; texture coordinates,
//! points, lines and display attributes are passed over; curves, free-form surfaces and whatever else is refused.

use super::read::NamedMesh;
use super::triangulate::{Odd, triangulate};
use glam::DVec3;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::ParseError;

/// Keywords that say nothing about the shape of polygons.
const PASSED_OVER: &[&str] = &[
    "vt",
    "l",
    "p",
    "s",
    "mg",
    "mtllib",
    "usemap",
    "maplib",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
];

/// Names of pieces may take this many times the file's size: each piece has all the names in force when it began.
const NAMES_PER_BYTE: usize = 64;

pub(super) fn parse(path: &Path, bytes: Vec<u8>) -> Result<Vec<NamedMesh>, ParseError> {
    let text = sunglint_formats::read::decode(path, bytes)?;
    let mut reader = Reader::new(path, text.len());
    let mut lines = (1_u64..).zip(text.lines());
    while let Some((number, line)) = lines.next() {
        reader.line = number;
        // A backslash at the end goes on in the next line.
        if line.trim_end().ends_with('\\') {
            let mut whole = String::new();
            let mut piece = Some(line);
            while let Some(part) = piece {
                let part = part.trim_end();
                whole.push_str(part.strip_suffix('\\').unwrap_or(part));
                whole.push(' ');
                piece = if part.ends_with('\\') { lines.next().map(|(_, l)| l) } else { None };
            }
            reader.read_line(&whole)?;
        } else {
            reader.read_line(line)?;
        }
    }
    for piece in &mut reader.pieces {
        piece.mesh.complete_normals();
    }
    Ok(reader.pieces)
}

/// A vertex, and its normal where it has one there.
type Corner = (u32, Option<u32>);

struct Reader<'p> {
    path: &'p Path,
    line: u64,
    vertices: Vec<DVec3>,
    normals: Vec<DVec3>,
    object: Vec<String>,
    groups: Vec<String>,
    material: Vec<String>,
    pieces: Vec<NamedMesh>,
    /// The piece of a combination of names.
    known: HashMap<Vec<String>, usize>,
    current: Option<usize>,
    /// For every piece, its own number of a vertex of the file with a normal.
    own: Vec<HashMap<Corner, u32>>,
    /// Bytes that names may still take, repeated for every piece.
    names_left: usize,
}

impl<'p> Reader<'p> {
    fn new(path: &'p Path, length: usize) -> Self {
        Self {
            path,
            line: 0,
            vertices: Vec::new(),
            normals: Vec::new(),
            object: Vec::new(),
            groups: Vec::new(),
            material: Vec::new(),
            pieces: Vec::new(),
            known: HashMap::new(),
            current: None,
            own: Vec::new(),
            names_left: NAMES_PER_BYTE * length + (1 << 20),
        }
    }

    fn wrong(&self, field: &str, found: impl Into<String>, expected: &str) -> ParseError {
        ParseError::new(self.path, found, expected).at_line(self.line).in_field(field)
    }

    fn read_line(&mut self, line: &str) -> Result<(), ParseError> {
        let line = line.split('#').next().unwrap_or("").trim();
        let Some(keyword) = line.split_whitespace().next() else { return Ok(()) };
        let rest = line[keyword.len()..].trim();
        match keyword {
            "v" => self.vertex(rest)?,
            "vn" => self.normal(rest)?,
            "f" | "fo" => self.face(rest)?,
            "g" => {
                self.groups = rest.split_whitespace().map(str::to_owned).collect();
                self.choose(true)?;
            }
            "o" => {
                self.object = if rest.is_empty() { vec![] } else { vec![rest.to_owned()] };
                self.choose(true)?;
            }
            "usemtl" => {
                self.material = if rest.is_empty() { vec![] } else { vec![rest.to_owned()] };
                self.choose(false)?;
            }
            known if PASSED_OVER.contains(&known) => {}
            other => {
                let expected =
                    "v, vn, vt, f, g, o, usemtl (polygons; no curves or free-form surfaces)";
                return Err(self.wrong("keyword", format!("`{}`", shorten(other)), expected));
            }
        }
        Ok(())
    }

    /// The piece of the names that are in force; `open` makes one at once, so that a group without faces is known too.
    fn choose(&mut self, open: bool) -> Result<(), ParseError> {
        self.current = None;
        if open && !(self.groups.is_empty() && self.object.is_empty()) {
            self.piece()?;
        }
        Ok(())
    }

    fn piece(&mut self) -> Result<usize, ParseError> {
        if let Some(current) = self.current {
            return Ok(current);
        }
        let names = || self.groups.iter().chain(&self.object).chain(&self.material);
        let bytes: usize = names().map(|name| name.len() + size_of::<String>()).sum();
        self.names_left = self.names_left.checked_sub(bytes).ok_or_else(|| {
            let found = format!("{} names for one piece of many", names().count());
            self.wrong("g", found, "a few groups, objects and materials for each face")
        })?;
        let names: Vec<String> = names().cloned().collect();
        let next = self.pieces.len();
        let index = *self.known.entry(names).or_insert_with_key(|names| {
            self.pieces.push(NamedMesh { names: names.clone(), ..NamedMesh::default() });
            self.own.push(HashMap::new());
            next
        });
        self.current = Some(index);
        Ok(index)
    }

    /// Three finite numbers and what follows them.
    fn three<'w>(&self, key: &str, rest: &'w str) -> Result<(DVec3, Vec<&'w str>), ParseError> {
        let mut values = [0.0; 3];
        let mut words = rest.split_whitespace();
        for value in &mut values {
            let word = words.next().unwrap_or("nothing");
            let number = word.parse::<f64>().ok().filter(|x| x.is_finite());
            *value = number.ok_or_else(|| {
                self.wrong(key, format!("`{}`", shorten(word)), "three finite coordinates")
            })?;
        }
        Ok((DVec3::from_array(values), words.collect()))
    }

    fn vertex(&mut self, rest: &str) -> Result<(), ParseError> {
        let (point, more) = self.three("v", rest)?;
        // After x, y, z: nothing, w (1 for polygons), or a colour.
        if let [w] = more[..]
            && w.parse::<f64>().ok() != Some(1.0)
        {
            return Err(self.wrong("v", format!("the weight `{}`", shorten(w)), "no weight, or 1"));
        }
        self.vertices.push(point);
        Ok(())
    }

    fn normal(&mut self, rest: &str) -> Result<(), ParseError> {
        let (normal, _) = self.three("vn", rest)?;
        self.normals.push(normal.normalize_or_zero());
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), ParseError> {
        let corners: Vec<Corner> =
            rest.split_whitespace().map(|word| self.corner(word)).collect::<Result<_, _>>()?;
        if corners.len() < 3 {
            let found = format!("{} corners", corners.len());
            return Err(self.wrong("f", found, "at least three corners"));
        }
        let points: Vec<DVec3> = corners.iter().map(|c| self.vertices[c.0 as usize]).collect();
        let triangles =
            triangulate(&points).map_err(|odd| polygon_error(self.path, odd).at_line(self.line))?;
        let piece = self.piece()?;
        let (own, mesh) = (&mut self.own[piece], &mut self.pieces[piece].mesh);
        let numbers: Vec<u32> = corners
            .iter()
            .map(|&corner| {
                *own.entry(corner).or_insert_with(|| {
                    if let Some(normal) = corner.1 {
                        mesh.normals.resize(mesh.vertices.len(), DVec3::ZERO);
                        mesh.normals.push(self.normals[normal as usize]);
                    }
                    mesh.vertices.push(self.vertices[corner.0 as usize]);
                    mesh.vertices.len() as u32 - 1
                })
            })
            .collect();
        mesh.triangles.extend(triangles.into_iter().map(|t| t.map(|i| numbers[i])));
        Ok(())
    }

    /// `7`, `7/1`, `7//3`, `7/1/3` or `-2` (the last but one so far).
    fn corner(&self, word: &str) -> Result<Corner, ParseError> {
        let mut fields = word.split('/');
        let vertex =
            self.index(word, fields.next().unwrap_or(""), "vertex", self.vertices.len())?;
        let normal = match fields.nth(1) {
            Some(field) if !field.is_empty() => {
                Some(self.index(word, field, "normal", self.normals.len())?)
            }
            _ => None,
        };
        Ok((vertex, normal))
    }

    fn index(&self, word: &str, field: &str, what: &str, count: usize) -> Result<u32, ParseError> {
        let index = match field.parse::<i64>() {
            Ok(i) if i > 0 => usize::try_from(i - 1).ok(),
            Ok(i) if i < 0 => count.checked_add_signed(i as isize),
            _ => None,
        };
        index.filter(|&i| i < count).and_then(|i| u32::try_from(i).ok()).ok_or_else(|| {
            let expected = format!("a {what} from 1 to {count} (or -{count} to -1), so far");
            self.wrong("f", format!("`{}`", shorten(word)), &expected)
        })
    }
}

pub(super) fn polygon_error(path: &Path, odd: Odd) -> ParseError {
    let most = super::triangulate::MOST_CORNERS;
    match odd {
        Odd::TooManyCorners(count) => {
            let found = format!("a face of {count} corners");
            ParseError::new(path, found, format!("at most {most} corners"))
        }
        Odd::CrossesItself => {
            ParseError::new(path, "a face whose outline crosses itself", "a simple polygon")
                .with_hint("let the modelling program export triangles")
        }
    }
}

/// A foreign word, short enough for a message.
pub(super) fn shorten(word: &str) -> String {
    let short: String = word.chars().take(40).flat_map(char::escape_debug).collect();
    if word.chars().nth(40).is_some() { format!("{short}…") } else { short }
}

/// Meshes as one OBJ, each under its name (`g`) and its material (`usemtl`), with normals where it has them; coordinates in shortest digits that read back the same.
pub fn write_obj<'a>(
    comment: &str,
    pieces: impl IntoIterator<Item = (&'a str, &'a str, &'a super::Mesh)>,
) -> String {
    let mut text = String::new();
    for line in comment.lines() {
        let _ = writeln!(text, "# {line}");
    }
    // A name ends at a space in this format.
    let word = |name: &str| name.split_whitespace().collect::<Vec<_>>().join("_");
    let (mut first, mut first_normal) = (1, 1);
    for (name, material, mesh) in pieces {
        let _ = writeln!(text, "g {}\nusemtl {}", word(name), word(material));
        for v in &mesh.vertices {
            let _ = writeln!(text, "v {} {} {}", v.x, v.y, v.z);
        }
        // Where a vertex has none, the others of the mesh are left out too: numbers stay those of the vertices.
        let smooth = !mesh.normals.is_empty() && mesh.normals.iter().all(|n| *n != DVec3::ZERO);
        if smooth {
            for n in &mesh.normals {
                let _ = writeln!(text, "vn {} {} {}", n.x, n.y, n.z);
            }
        }
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|k| {
                if smooth {
                    format!("{}//{}", first + k, first_normal + k)
                } else {
                    (first + k).to_string()
                }
            });
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        first += mesh.vertices.len() as u32;
        first_normal += if smooth { mesh.normals.len() as u32 } else { 0 };
    }
    text
}
